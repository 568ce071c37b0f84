# `make demo` and `make test` do all the set-up themselves, in .venv. They need a C compiler and
# Python >= 3.11; if that is not python3, say which: make test PYTHON=python3.12

PYTHON   ?= python3
VENV     := .venv
HEADERS  := $(wildcard csrc/core/*.h csrc/core/*/*.h)
CORE     := $(wildcard csrc/core/*.c csrc/core/*/*.c)
BINDING  := $(wildcard csrc/binding/*.[ch])
TESTS    := $(wildcard csrc/tests/*.[ch])
# pointers are checked where they are used, which halves the time of the compiler
SANITIZE := -fsanitize=address,undefined,float-cast-overflow -fno-sanitize=pointer-overflow \
	-fno-sanitize-recover=all -fno-omit-frame-pointer

# allocations go through allocations.c, which lets them fail
WRAPPED  := -DWRAPPED_ALLOCATORS -Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc

# the scripts of benchmarks/ that measure
MEASURE  := $(filter-out $(addprefix benchmarks/,draw.py memory.py peers.py timing.py), \
              $(wildcard benchmarks/*.py))

# what is tested with an extension under sanitizers
SANITIZED := test_binding test_binding_arrays test_binding_panels test_binding_threads test_snapshot test_rig_delays
RACES     := test_threads test_waiting
LIBRARY    = $(shell $(CC) -print-file-name=$(1))

# Each process of a test, and each rewrite of its assertions, would compile all modules again.
unexport PYTHONDONTWRITEBYTECODE

# a test or a compilation for each processor
JOBS     := $(shell getconf _NPROCESSORS_ONLN)
# BLAS alone: its threads would wait for each other by spinning while another test has the processor
PYTEST    = OPENBLAS_NUM_THREADS=1 $(VENV)/bin/python -m pytest -n $(JOBS) --dist worksteal

.PHONY: ALWAYS archive-c install-c demo test older-kernel others campaigns ctest tsan sanitized races coverage analyze release cross example lint \
	notebooks docs wheels release-files free-threaded benchmarks clean

demo: $(VENV)/.plot,fast
	$(VENV)/bin/python -m pmalpha

test: $(VENV)/.test
	@echo "8500 tests of the package and its files on $(JOBS) processors: about 90 seconds on two idle cores."
	@echo "Not among them: make others (4 to 10 minutes), make ctest (1 to 2), make campaigns (two hours)."
	$(PYTEST) -m "not gate and not campaign" $(ARGS)

# Tests of iterations and of stability once more, under a kernel of OpenBLAS that is older than the one
# it takes for this processor and adds in another order; or under any: make older-kernel KERNEL=Nehalem
NEAR_DIGITS := newton mean macro contact stability agreement initial spring
KERNEL       = $(shell $(VENV)/bin/python tests/kernels.py)

older-kernel: $(VENV)/.test
	$(if $(KERNEL),OPENBLAS_CORETYPE=$(KERNEL) $(PYTEST) -m "not gate and not campaign" $(sort \
		$(foreach word,$(NEAR_DIGITS),$(wildcard tests/test_*$(word)*.py))) $(ARGS), \
		@echo "no kernel of OpenBLAS is older than that of this processor")

# The tests that take long or need other programs: notebooks, MPI, type checkers, OpenSees, FMI,
# benchmarks, and the campaigns in a short form. Only files with such tests are read, and a file is
# tested by one process, since most of them prepare something for all of their tests; the longest first.
LONGEST  := tests/test_notebooks.py
GATED     = $(LONGEST) $(filter-out $(LONGEST),$(shell grep -l 'mark\.gate' tests/test_*.py))

others: $(VENV)/.gate
	$(PYTEST) --dist loadfile -m "gate and not campaign" $(GATED) $(ARGS)

# all of what the tests take samples of, then random input, histories of calls, signals and files:
# each campaign for ten minutes
campaigns: $(VENV)/.gate
	$(PYTEST) -m campaign
	for script in tests/campaign_?*.py; do \
		echo $$script; $(VENV)/bin/python $$script --seconds 600 || exit; done

ctest: build/test_core_asan
	$<

# those tests in which threads work, where ThreadSanitizer watches
tsan: build/test_core_tsan
	TSAN_OPTIONS=halt_on_error=1 build/test_core_tsan threads

# Some of the Python tests with an extension under the address and undefined-behaviour sanitizers.
# They run in the folder of a copy of the package: Python looks in the present folder first.
sanitized: build/sanitized/_core.abi3.so $(VENV)/.test
	$(call COPY,build/sanitized)
	cd build/sanitized && PYTHONMALLOC=malloc ASAN_OPTIONS=detect_leaks=0:allocator_may_return_null=1 \
		LD_PRELOAD="$(call LIBRARY,libasan.so) $(call LIBRARY,libubsan.so)" \
		$(TESTED) $(SANITIZED:%=$(CURDIR)/tests/%.py)

# The same under the thread sanitizer, for gcc on Linux. Reports in libraries that are compiled
# without it, whose locks it does not see, are left out.
races: build/races/_core.abi3.so $(VENV)/.test
	$(call COPY,build/races)
	cd build/races && TSAN_OPTIONS="ignore_noninstrumented_modules=1 exitcode=66" \
		LD_PRELOAD="$(call LIBRARY,libtsan.so)" $(TESTED) $(RACES:%=$(CURDIR)/tests/%.py)

# What the tests reach of the core, the binding and the package, in lines and branches, without
# optimization and assertions, which takes two to three times as long as the tests. It writes the
# table of CONTRIBUTING.md, and lists in build/covered what is not reached: core.txt, package.txt.
# Tests run in small groups, since a process that dies loses its counts; those of Ctrl-C without
# coverage.py, which holds a lock that an exception within leaves locked.
COVERED := $(CURDIR)/build/covered
GCOVR    = $(VENV)/bin/python -m gcovr --root . --filter csrc/core/ --filter csrc/binding/ \
	--merge-mode-functions separate build/covered
TRACED   = cd build/covered && PYTHONPATH=$(COVERED) OPENBLAS_NUM_THREADS=1 \
	COVERAGE_FILE=$(COVERED)/.coverage COVERAGE_RCFILE=$(CURDIR)/pyproject.toml
UNTRACED = pytest -q -p no:cacheprovider -p no:xdist -m "not gate and not campaign" $(ARGS)

coverage: build/test_core_covered build/covered/_core.abi3.so $(VENV)/.coverage
	$(call COPY,build/covered)
	find build/covered -name '*.gcda' -delete
	$<
	$(GCOVR) --json build/covered/c.json
	find build/covered -name '*.gcda' -delete
	rm -f build/covered/.coverage*
	printf '%s\n' $(CURDIR)/tests/test_*.py | ($(TRACED) xargs -P $(JOBS) -n 5 \
		$(CURDIR)/$(VENV)/bin/python -m coverage run -m $(UNTRACED) -k "not exports and not ctrl_c and not interrupt")
	printf '%s\n' $(CURDIR)/tests/test_*.py | ($(TRACED) xargs \
		$(CURDIR)/$(VENV)/bin/python -m $(UNTRACED) -k "ctrl_c or interrupt")
	$(GCOVR) --json build/covered/python.json
	cd build/covered && $(CURDIR)/$(VENV)/bin/coverage combine -q --rcfile $(CURDIR)/pyproject.toml
	cd build/covered && $(CURDIR)/$(VENV)/bin/coverage json -q --rcfile $(CURDIR)/pyproject.toml \
		-o package.json
	cd build/covered && $(CURDIR)/$(VENV)/bin/coverage report -m --skip-covered \
		--rcfile $(CURDIR)/pyproject.toml >package.txt
	$(VENV)/bin/python -m gcovr --root . -a build/covered/c.json -a build/covered/python.json \
		--txt build/covered/core.txt
	$(VENV)/bin/python benchmarks/surveys/covered.py build/covered

# Mistakes that can be found without a run: gcc -fanalyzer without OpenMP, of whose reductions it
# reports variables that do not exist; and without values that are not initialized, which it takes
# vectors for that {0} made zero, and which the two others look for; clang-tidy, what it leaves out is in .clang-tidy, and with
# DEEP=1 the analyzer of clang, which takes three times as long as all others; cppcheck,
# without `(void)a, (void)b;` for unused arguments, casts of blocks that are laid out by hand, and
# an array that is filled up to its use; mypy on the package; the stub of the extension.
analyze: $(VENV)/.lint,test
	mkdir -p build/analyzed
	printf '%s\n' $(CORE) | xargs -P $(JOBS) -I {} sh -c '$(CC) -std=c11 -O1 -fanalyzer -Werror \
		-Wall -Wextra -Icsrc/core -Wno-unknown-pragmas -Wno-analyzer-use-of-uninitialized-value \
		-c {} -o build/analyzed/$$$$.o || exit 255'
	printf '%s\n' $(CORE) | xargs -n 8 -P $(JOBS) $(VENV)/bin/clang-tidy --quiet \
		$(if $(DEEP),,--checks=-clang-analyzer-*) \
		--extra-arg=-std=c11 --extra-arg=-Icsrc/core
	$(VENV)/bin/cppcheck -j $(JOBS) --quiet --error-exitcode=1 --std=c11 --language=c -Icsrc/core \
		--enable=warning,performance,portability --suppress=constStatement \
		--suppress=invalidPointerCast --suppress=uninitvar:csrc/core/algebra/kernel_loops.h csrc/core
	PYTHONPATH=. $(VENV)/bin/python -m mypy
	PYTHONPATH=. $(VENV)/bin/python -m mypy.stubtest pmalpha._core --ignore-disjoint-bases \
		--mypy-config-file pyproject.toml

# the same tests as users compile the core, without assertions
release: build/test_core_release
	$<

# The same tests compiled by zig for other processors and systems, and run where an emulator is
# installed. The emulator of ARM has one processor: with several, QEMU 7.2 on x86 lets a load pass an
# earlier sequentially consistent store, and a thread is not woken.
CROSS    := aarch64-linux-musl aarch64-linux-gnu aarch64-macos x86_64-macos x86_64-windows-gnu
WINE     := $(firstword $(shell command -v wine64) $(wildcard /usr/lib/wine/wine64))

cross: $(CROSS:%=build/cross/%.exe)
	$(if $(shell command -v qemu-aarch64-static), \
		taskset -c 0 qemu-aarch64-static build/cross/aarch64-linux-musl.exe, \
		@echo "no qemu-aarch64-static: only compiled")
	$(if $(WINE),WINEDEBUG=-all $(WINE) build/cross/x86_64-windows-gnu.exe, \
		@echo "no wine64: only compiled")

# two oscillators, coupled by the core alone
example: build/example
	build/example

lint: $(VENV)/.lint
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/clang-format --dry-run -Werror $(HEADERS) $(CORE) $(BINDING) csrc/example.c $(TESTS) \
		benchmarks/programs/*.c

notebooks: $(VENV)/.notebook
	$(VENV)/bin/python -c "$$EXECUTE" notebooks/*.ipynb
	$(VENV)/bin/python docs/gallery.py

# The site, build/docs/html. Its sources are a copy, since the reference writes a page for each name;
# the notebooks appear with their stored output.
docs: $(VENV)/.docs
	$(VENV)/bin/python docs/combinations.py --check
	rm -rf build/docs/source
	mkdir -p build/docs/source
	cp -Rp CHANGELOG.md CONTRIBUTING.md benchmarks docs examples notebooks build/docs/source
	$(VENV)/bin/sphinx-build -q -W --keep-going -c docs -d build/docs/trees \
		build/docs/source build/docs/html
	$(VENV)/bin/python docs/check.py build/docs/html

# Wheels for Python 3.11 or later on Linux, macOS and Windows, in build/wheels, compiled by zig and
# checked without being run; or those of some platforms: make wheels PLATFORMS=win_amd64
wheels: build/packaging/bin/zig
	build/packaging/bin/python -m pytest -q -p no:cacheprovider packaging
	build/packaging/bin/python packaging/wheels.py build/wheels $(PLATFORMS)
	build/packaging/bin/python packaging/check_wheels.py build/wheels

# What would be uploaded, with check sums, from a commit: made twice and compared to the byte.
release-files: build/packaging/bin/zig
	build/packaging/bin/python packaging/release.py

# A wheel for a Python without the GIL, which has no stable ABI, and for the processors and the glibc
# of zig's name: make free-threaded FREE=python3.13t
free-threaded: build/packaging/bin/zig
	rm -rf build/free build/free-threaded build/free-threaded-made
	$(FREE) -m venv build/free
	build/free/bin/pip install --quiet --no-compile build
	PIP_ONLY_BINARY=numpy CC="$(CURDIR)/$<" LDSHARED="$(CURDIR)/$< -shared" \
		build/free/bin/python -m build --wheel --outdir build/free-threaded-made .
	PATH="$(CURDIR)/build/packaging/bin:$$PATH" auditwheel repair \
		--plat manylinux_2_17_x86_64 --wheel-dir build/free-threaded \
		build/free-threaded-made/*.whl

build/cross/%.exe: $(TESTS) $(CORE) $(HEADERS) | build/packaging/bin/zig
	mkdir -p build/cross
	build/packaging/bin/python -m ziglang cc -target $* -std=c11 -O1 -ffp-contract=off \
		-fopenmp-simd -pthread -Wall -Wextra -Icsrc/core $(filter %.c,$^) -lm -o $@

build/packaging/bin/zig: packaging/requirements.txt
	$(PYTHON) -m venv build/packaging
	build/packaging/bin/pip install --quiet --no-compile -r $<
	printf '#!/bin/sh\nexec "%s" -m ziglang cc -target x86_64-linux-gnu.2.17 "$$@"\n' \
		"$(CURDIR)/build/packaging/bin/python" >$@
	chmod +x $@

# half an hour; best on a machine with nothing else to do
benchmarks: $(VENV)/.plot,fast
	for script in $(MEASURE); do $(VENV)/bin/python $$script || exit; done
	$(VENV)/bin/python benchmarks/draw.py

# what `jupyter execute --inplace` does, but without a time stamp in each cell
define EXECUTE
import sys, nbclient, nbformat
for path in sys.argv[1:]:
    notebook = nbformat.read(path, as_version=4)
    nbclient.execute(notebook, cwd="notebooks", record_timing=False)
    nbformat.write(notebook, path)
endef
export EXECUTE

# Installed in place, with the extras named by the stem: what changes in Python is seen at once,
# what changes in C is compiled again. Python compiles what is imported of ten thousand files.
$(VENV)/.%: pyproject.toml setup.py $(HEADERS) $(CORE) $(BINDING) | $(VENV)/bin/pip
	$(VENV)/bin/python -m pip install --quiet --no-compile --editable '.[$*]'
	touch $@

$(VENV)/bin/pip:
	$(PYTHON) -m venv $(VENV)

# The C tests in three builds, of objects that `make -j` compiles at once. Those of the sanitizers are
# for an extension too; those of threads are also those of processors without AVX2.
BUILDS         := asan tsan release covered
FLAGS_asan     := -O1 -g -fPIC $(SANITIZE) $(if $(filter Linux,$(shell uname)),$(WRAPPED))
FLAGS_tsan     := -O1 -g -fPIC -fsanitize=thread -DPMA_PLAIN
FLAGS_release  := -O3 -DNDEBUG
FLAGS_covered  := -O0 -g -fPIC --coverage -DNDEBUG $(if $(filter Linux,$(shell uname)),$(WRAPPED))
OBJECTS         = $(patsubst %.c,build/$(1)/%.o,$(filter %.c,$(2)))

# the tests themselves, half of what is compiled, which take as long without optimization
OF_TESTS := -O0

define BUILD
build/$(1)/%.o: %.c $(HEADERS) $(filter %.h,$(TESTS))
	@mkdir -p $$(@D)
	$$(CC) -std=c11 $$(FLAGS_$(1)) $$(if $$(filter csrc/tests/%,$$<),$$(OF_TESTS)) \
		-ffp-contract=off -fopenmp-simd -pthread -Wall -Wextra -Icsrc/core -Icsrc -c $$< -o $$@

build/test_core_$(1): $(call OBJECTS,$(1),$(TESTS) $(CORE))
	$$(CC) $$(FLAGS_$(1)) -pthread $$^ -lm -o $$@
endef
$(foreach build,$(BUILDS),$(eval $(call BUILD,$(build))))

# A copy of the package with this extension. Not tested with it: symbols, memory, forks, what is
# interrupted or faults on purpose, and a process of a limited time, which starts slower.
define COPY
	rm -rf $(1)/pmalpha
	cp -Rp pmalpha $(1)
	rm -f $(1)/pmalpha/_core*.so
	cp $(1)/_core.abi3.so $(1)/pmalpha
endef
TESTED = $(CURDIR)/$(VENV)/bin/python -m pytest -q -p no:cacheprovider \
	-k "not exports and not memory_of_the_core and not interrupt and not fork and not a_fault_in \
	and not beyond_its_rows"

build/sanitized/_core.abi3.so: FLAGS := $(filter-out $(WRAPPED),$(FLAGS_asan))
build/races/_core.abi3.so:     FLAGS := $(FLAGS_tsan)
build/covered/_core.abi3.so:   FLAGS := $(filter-out $(WRAPPED),$(FLAGS_covered))
build/sanitized/_core.abi3.so: $(call OBJECTS,asan,$(CORE))
build/races/_core.abi3.so:     $(call OBJECTS,tsan,$(CORE))
build/covered/_core.abi3.so:   $(call OBJECTS,covered,$(CORE))
build/sanitized/_core.abi3.so build/races/_core.abi3.so build/covered/_core.abi3.so: $(BINDING) | $(VENV)/.test
	mkdir -p $(@D)
	$(CC) -std=c11 $(FLAGS) -shared -ffp-contract=off -fno-trapping-math -fopenmp-simd \
		-pthread -D_POSIX_C_SOURCE=200809L -D_XOPEN_SOURCE=700 -DPy_LIMITED_API=0x030B0000 \
		-DNPY_NO_DEPRECATED_API=NPY_2_0_API_VERSION -DNPY_TARGET_VERSION=NPY_1_23_API_VERSION \
		-Icsrc/core $$($(VENV)/bin/python -c "import numpy, sysconfig; \
			print('-I', numpy.get_include(), '-I', sysconfig.get_path('include'))") \
		$(filter %.c %.o,$^) -lm -o $@

# The C library by a compiler and make alone: make install-c PREFIX=/usr/local. THREADS=none leaves
# threads out, for systems that have none; CFLAGS come last. Each compiler has objects of its own, which are
# compiled again when one of these words has changed: $(C_BUILD)/commands is written only then.
PREFIX      ?= /usr/local
OF_THREADS  := csrc/core/workers/thread.c
C_LIBRARY   := $(filter-out $(OF_THREADS),$(CORE)) $(wildcard csrc/library/*.c) \
	$(if $(filter none,$(THREADS)),csrc/library/none/thread.c,$(OF_THREADS))
C_BUILD     := build/c-$(subst $() ,-,$(notdir $(CC)))$(if $(filter none,$(THREADS)),-none)
C_OBJECTS   := $(C_LIBRARY:%.c=$(C_BUILD)/%.o)
PTHREAD     := $(if $(filter none,$(THREADS)),,-pthread)
C_COMPILE    = $(CC) -std=c11 -O2 -DNDEBUG -fPIC -fvisibility=hidden -fno-trapping-math -fopenmp-simd \
	$(or $(PTHREAD),-DPMA_ONE_THREAD) -Wall -Wextra -Icsrc/core -Icsrc $(CFLAGS) -ffp-contract=off
C_LINK       = $(CC) -shared $(PTHREAD) $(LDFLAGS)
export C_COMMANDS = $(C_COMPILE) / $(C_LINK) / $(AR)
C_VERSION    = $(shell sed -n 's/^version = "\([^"]*\)".*/\1/p' pyproject.toml)

$(C_BUILD)/commands: ALWAYS
	@mkdir -p $(@D)
	@printf '%s\n' "$$C_COMMANDS" | cmp -s - $@ || printf '%s\n' "$$C_COMMANDS" >$@

$(C_BUILD)/%.o: %.c $(C_BUILD)/commands $(HEADERS) $(wildcard csrc/library/*.h)
	@mkdir -p $(@D)
	$(C_COMPILE) -c $< -o $@

$(C_BUILD)/libpmalpha.a: $(C_OBJECTS)
	rm -f $@
	$(AR) rcs $@ $^

$(C_BUILD)/libpmalpha.so: $(C_OBJECTS)
	$(C_LINK) $^ -lm -o $@

# what opens damaged models under the sanitizers: tests/campaign_frozen.py
build/frozen_fuzz: tests/frozen_fuzz.c $(call OBJECTS,asan,$(CORE) $(wildcard csrc/library/*.c))
	$(CC) $(FLAGS_asan) -std=gnu11 -Wall -Wextra -Icsrc/core -Icsrc -pthread $^ -lm -o $@

# the header and the archive alone, for targets that have no shared libraries
archive-c: $(C_BUILD)/libpmalpha.a
	mkdir -p $(PREFIX)/include $(PREFIX)/lib
	cp csrc/library/pmalpha.h $(PREFIX)/include
	cp $< $(PREFIX)/lib

install-c: $(C_BUILD)/libpmalpha.a $(C_BUILD)/libpmalpha.so
	mkdir -p $(PREFIX)/include $(PREFIX)/lib/pkgconfig $(PREFIX)/lib/cmake/pmalpha
	cp csrc/library/pmalpha.h $(PREFIX)/include
	cp $^ $(PREFIX)/lib
	sed 's|@PREFIX@|$(abspath $(PREFIX))|; s|@VERSION@|$(C_VERSION)|; s|@PTHREAD@|$(PTHREAD)|' \
		csrc/library/pmalpha.pc.in >$(PREFIX)/lib/pkgconfig/pmalpha.pc
	cp csrc/library/pmalpha-config.cmake $(PREFIX)/lib/cmake/pmalpha
	sed 's|@VERSION@|$(C_VERSION)|' csrc/library/pmalpha-config-version.cmake.in \
		>$(PREFIX)/lib/cmake/pmalpha/pmalpha-config-version.cmake

build/example: csrc/example.c $(CORE) $(HEADERS)
	mkdir -p build
	$(CC) -std=c11 -O2 -ffp-contract=off -fopenmp-simd -pthread -Wall -Wextra \
		-Icsrc/core $(filter %.c,$^) -lm -o $@

clean:
	rm -rf $(VENV) build dist *.egg-info pmalpha/*.so .pytest_cache .ruff_cache
	find . -name __pycache__ -prune -exec rm -rf {} +
