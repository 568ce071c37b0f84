"""The C library of frozen models as a C program finds it."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from c_models import OK, Library
from frozen_couplers import frame

import pmalpha as pm
from pmalpha import rig

ROOT = Path(__file__).parent.parent
EXAMPLES = ROOT / "examples" / "c"
pytestmark = [
    pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler"),
    pytest.mark.skipif(sys.platform != "linux", reason="needs the tools of Linux"),
    # the drift of the tie is that of all programs
    pytest.mark.filterwarnings("ignore:tied displacements:pmalpha.AccuracyWarning"),
]
STEPS = 240
# Counts what is allocated.
WRAPPED = """
#include <pmalpha.h>
#include <stdio.h>
#include <stdlib.h>
static long made;
void *__real_malloc(size_t n);
void *__real_calloc(size_t k, size_t n);
void *__real_realloc(void *p, size_t n);
void *__wrap_malloc(size_t n) { made++; return __real_malloc(n); }
void *__wrap_calloc(size_t k, size_t n) { made++; return __real_calloc(k, n); }
void *__wrap_realloc(void *p, size_t n) { made++; return __real_realloc(p, n); }
"""
# After a model is open.
COUNTING = f"""{WRAPPED}
int main(int count, char **words)
{{
    pmalpha_model *m;
    (void)count;
    if (pmalpha_open(words[1], NULL, &m)) return 1;
    long opened = made;
    static uint64_t block[4096];
    if (pmalpha_state_size(m) > sizeof block) return 1;
    for (int k = 0; k < 240; k++) {{
        double c[3];
        pmalpha_command(m, 0, c);
        pmalpha_set(m, 0, 300.0 * c[0]);
        if (pmalpha_advance(m, 1)) return 1;
    }}
    if (pmalpha_save(m, block, sizeof block) || pmalpha_restore(m, block, sizeof block)) return 1;
    pmalpha_reset(m);
    printf("%ld %ld\\n", opened, made - opened);
    pmalpha_close(m);
    return 0;
}}
"""


def run(*words, **options):
    made = subprocess.run(list(map(str, words)), capture_output=True, text=True, **options)
    assert made.returncode == 0, made.stderr
    return made.stdout


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A frozen model with a specimen, which is a spring of 300, and what its run records."""
    path = tmp_path_factory.mktemp("model") / "model.pma"
    outside = frame("pm", "bilinear", restoring=rig.External([1], force=300.0 * -0.02))
    outside.freeze(path, {"column": ("specimen", "a", 1)}, {"u": ("u", "a", 1)})
    coupler = frame("pm", "bilinear", restoring=lambda t, u, v: np.array([0.0, 300.0 * u[1], 0.0]))
    history = coupler.run(steps=STEPS // 3)
    return path, history["a"].u[-1, 1]


# ---- header and symbols --------------------------------------------------------------------------


@pytest.mark.parametrize("compiler", ["cc -x c -std=c99", "c++ -x c++ -std=c++11"])
def test_the_header_compiles_in_c99_and_cxx11(tmp_path, compiler):
    if shutil.which(compiler.split()[0]) is None:
        pytest.skip("needs the compiler")
    (tmp_path / "x.h").write_text("#include <pmalpha.h>\n#include <pmalpha.h>\n")
    flags = ["-pedantic", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-I", pm.c_library()]
    run(*compiler.split(), *flags, tmp_path / "x.h")


def test_the_shared_library_exports_what_the_header_declares():
    library = pm.c_library() / "libpmalpha.so"
    lines = run("nm", "-D", "--defined-only", library).splitlines()
    names = {line.split()[-1] for line in lines}
    header = (pm.c_library() / "pmalpha.h").read_text()
    assert names == set(re.findall(r"\b(pmalpha_\w+)\(", header)) - {"pmalpha_specimen"}
    needed = run("objdump", "-p", library)
    assert "python" not in needed.lower()
    # the loader has the variables of threads
    found = set(re.findall(r"NEEDED\s+(\S+?)\.so", needed)) - {"ld-linux-x86-64"}
    assert found <= {"libc", "libm", "libpthread"}


def test_only_what_opens_a_path_needs_the_files_of_the_c_library():
    """So a program that opens bytes links without stdio, and without a file of the system."""
    lines = run("nm", "-A", "--undefined-only", pm.c_library() / "libpmalpha.a").splitlines()
    needs = {}
    for line in lines:
        where, name = line.split()[0], line.split()[-1]
        needs.setdefault(name, set()).add(where.split(":")[-2])
    of_files = {"fopen", "fclose", "fread", "fseek", "ftell", "stat", "strerror"}
    assert of_files <= needs.keys() | {"__xstat"}
    assert {x for name in of_files & needs.keys() for x in needs[name]} == {"file.o"}
    written = {x for x in needs if re.search("printf|puts|stdout|stderr", x)}
    assert written <= {"__assert_fail"}


# ---- programs ------------------------------------------------------------------------------------


def compiled(source, tmp_path, *options):
    """A program with the archive of the package."""
    program = tmp_path / "program"
    compiler = "c++" if str(source).endswith(".cpp") else "cc"
    folder = pm.c_library()
    run(
        compiler,
        "-O1",
        "-Wall",
        "-I",
        folder,
        source,
        *options,
        folder / "libpmalpha.a",
        "-lm",
        "-pthread",
        "-o",
        program,
    )
    return program


# Opens a model in memory of the program, where what allocates is not linked.
WITHIN = f"""{WRAPPED}
static union {{ uint64_t words[1 << 16]; long double aligned; }} file, room;
int main(int count, char **words)
{{
    pmalpha_model *m;
    FILE *f = fopen(words[1], "rb");
    const size_t size = f ? fread(&file, 1, sizeof file, f) : 0;
    const size_t needed = pmalpha_room(&file, size);
    char why[PMALPHA_MESSAGE];
    (void)count;
    if (needed == 0 || needed > sizeof room) return 1;
    if (pmalpha_open_in(&file, size, &room, needed - 1, why, &m) != PMALPHA_NO_MEMORY) return 2;
    made = 0;
    if (pmalpha_open_in(&file, size, &room, needed, why, &m)) return 3;
    for (int k = 0; k < 240; k++) {{
        double c[3];
        pmalpha_command(m, 0, c);
        if (pmalpha_set(m, 0, 300.0 * c[0]) || pmalpha_advance(m, 1)) return 4;
    }}
    pmalpha_close(m);
    if (made) return 5;
    printf("%.17g\\n", pmalpha_get(m, 0));
    return 0;
}}
"""


def test_a_model_in_memory_of_the_program_allocates_nothing(model, tmp_path):
    (tmp_path / "within.c").write_text(WITHIN)
    wrapped = "-Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc"
    program = compiled(tmp_path / "within.c", tmp_path, wrapped)
    assert float(run(program, model[0])) == model[1]


def test_nothing_is_allocated_between_open_and_close(model, tmp_path):
    (tmp_path / "count.c").write_text(COUNTING)
    wrapped = "-Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc"
    program = compiled(tmp_path / "count.c", tmp_path, wrapped)
    opened, later = map(int, run(program, model[0]).split())
    assert opened > 10
    assert later == 0


@pytest.mark.gate
@pytest.mark.parametrize("source", ["loop.c", "loop.cpp"])
def test_examples_print_the_figure_of_the_run(model, tmp_path, source):
    if shutil.which("c++" if source.endswith("pp") else "cc") is None:
        pytest.skip("needs the compiler")
    program = compiled(EXAMPLES / source, tmp_path)
    assert float(run(program, model[0], STEPS)) == model[1]


def test_the_s_function_prints_the_figure_of_the_run(model, tmp_path):
    """With stubs in place of Simulink's headers."""
    program = compiled(EXAMPLES / "sfunction.c", tmp_path, "-I", ROOT / "tests")
    assert float(run(program, model[0], STEPS)) == model[1]


def test_the_example_of_ctypes_prints_the_figure_of_the_run(model):
    library = pm.c_library() / "libpmalpha.so"
    script = EXAMPLES / "ctypes_loop.py"
    assert float(run(sys.executable, "-I", "-S", script, library, model[0], STEPS)) == model[1]


def test_the_example_of_julia_prints_the_figure_of_the_run(model):
    if shutil.which("julia") is None:
        pytest.skip("needs Julia")
    library = pm.c_library() / "libpmalpha.so"
    assert float(run("julia", EXAMPLES / "loop.jl", library, model[0], STEPS)) == model[1]


def test_the_example_of_fortran_prints_the_figure_of_the_run(model, tmp_path):
    if shutil.which("gfortran") is None:
        pytest.skip("needs gfortran")
    folder = pm.c_library()
    program = tmp_path / "program"
    run(
        "gfortran", EXAMPLES / "loop.f90", folder / "libpmalpha.a", "-lm", "-pthread", "-o", program
    )
    assert float(run(program, model[0], STEPS)) == model[1]


# ---- what is printed ---------------------------------------------------------------------------

STRICT = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Werror"]
# A specimen, which is a spring of 300, ends the loop by a force that is no number.
AROUND = """
#include <math.h>
#include <pmalpha.h>
#include <stdio.h>
static double commanded;
static int samples;
static void give(double d) { commanded = d; }
static double measured(void) { return ++samples > %d ? NAN : 300.0 * commanded; }
#define pmalpha_close(m) (printf("%%.17g\\n", pmalpha_get(m, 0)), pmalpha_close(m))
int main(void)
{
%s
return 0;
}
"""


def loops():
    """The loops that the header and the page print, by the name of their model."""
    header = (pm.c_library() / "pmalpha.h").read_text()
    lines = re.findall(r"^ \*     (.*)$", header.split("*/")[0], re.MULTILINE)
    page = (ROOT / "docs" / "embedded.md").read_text()
    (block,) = re.findall(r"```c\n(.*?)```", page, re.DOTALL)
    return {"model.pma": "\n".join(lines), "tower.pma": block}


def write_loop(name, model, folder):
    shutil.copy(model, folder / name)
    path = folder / "loop.c"
    path.write_text(AROUND % (STEPS, loops()[name]))
    return path


@pytest.mark.parametrize("name", ["model.pma", "tower.pma"])
def test_the_loops_that_are_printed_move_as_a_run(model, tmp_path, name):
    program = compiled(write_loop(name, model[0], tmp_path), tmp_path, *STRICT)
    *_, why, number = run(program, cwd=tmp_path).split("\n")[:-1]
    assert float(number) == model[1] and "must be finite" in why


@pytest.mark.skipif(not shutil.which("arm-none-eabi-gcc"), reason="needs a compiler for 32 bits")
@pytest.mark.parametrize("name", ["model.pma", "tower.pma"])
def test_the_loops_that_are_printed_compile_for_32_bits(model, tmp_path, name):
    source = write_loop(name, model[0], tmp_path)
    run("arm-none-eabi-gcc", *STRICT, "-I", pm.c_library(), "-c", source, "-o", tmp_path / "x.o")


def test_examples_compile_without_a_warning(tmp_path):
    for name in ("loop.c", "sfunction.c"):
        flags = [x for x in STRICT if x not in ("-std=c99", "-pedantic")] + ["-std=gnu99"]
        flags += ["-I", pm.c_library(), "-I", ROOT / "tests"]
        run("cc", *flags, "-c", EXAMPLES / name, "-o", tmp_path / "x.o")


@pytest.mark.gate
@pytest.mark.parametrize("line", [1, 2])
def test_the_compile_lines_of_the_page_make_a_program(model, tmp_path, line):
    page = (ROOT / "docs" / "embedded.md").read_text()
    first, *lines = re.findall(r"^    (F=.*|cc loop.c .*)$", page, re.MULTILINE)
    assert len(lines) == 2
    first = first.replace("python3", sys.executable)
    write_loop("tower.pma", model[0], tmp_path)
    script = f"{first}\n{lines[line - 1]}\n./loop"
    folder = dict(os.environ, PYTHONPATH=str(ROOT))
    output = run("sh", "-e", "-c", script, cwd=tmp_path, env=folder)
    assert float(output.split("\n")[-2]) == model[1]


# ---- installation --------------------------------------------------------------------------------


def installed(folder, *options):
    """The library, installed by make and a compiler alone; seconds of processor time."""
    before = os.times()
    run("make", "-s", "-C", ROOT, "install-c", f"PREFIX={folder}", *options)
    after = os.times()
    return (
        after.children_user + after.children_system - before.children_user - before.children_system
    )


@pytest.mark.gate
def test_make_installs_what_pkg_config_and_cmake_find(model, tmp_path):
    prefix = tmp_path / "usr"
    assert installed(prefix) < 120.0  # a minute on a processor that is not shared
    source, program = EXAMPLES / "loop.cpp", tmp_path / "loop"
    environment = dict(
        os.environ,
        PKG_CONFIG_PATH=str(prefix / "lib" / "pkgconfig"),
        LD_LIBRARY_PATH=str(prefix / "lib"),
    )
    flags = run("pkg-config", "--cflags", "--libs", "pmalpha", env=environment).split()
    run("c++", source, *flags, "-o", program)
    assert float(run(program, model[0], STEPS, env=environment)) == model[1]
    version = run("pkg-config", "--modversion", "pmalpha", env=environment).strip()
    assert version == pm.__version__
    if shutil.which("cmake") is None:
        pytest.skip("needs CMake for the rest")
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.10)\nproject(x CXX)\nfind_package(pmalpha REQUIRED)\n"
        f"add_executable(x {source})\ntarget_link_libraries(x pmalpha::pmalpha)\n"
    )
    run("cmake", "-S", tmp_path, "-B", tmp_path / "made", f"-DCMAKE_PREFIX_PATH={prefix}")
    run("cmake", "--build", tmp_path / "made")
    assert float(run(tmp_path / "made" / "x", model[0], STEPS, env=environment)) == model[1]


@pytest.mark.gate
def test_without_threads_it_needs_libc_and_libm_and_gives_the_same_numbers(model, tmp_path):
    installed(tmp_path, "THREADS=none")
    library = tmp_path / "lib" / "libpmalpha.so"
    needed = re.findall(r"NEEDED\s+(\S+?)\.so", run("objdump", "-p", library))
    assert set(needed) <= {"libc", "libm"}
    assert "pthread_create" not in run("nm", "-D", library)
    one = Library(library).model(model[0])
    for _ in range(STEPS):
        one.set(0, 300.0 * one.command_of(0)[1][0])
        assert one.advance(1) == OK
    assert one.get(0) == model[1]


@pytest.mark.gate
def test_other_flags_are_not_answered_with_the_objects_of_earlier_ones(tmp_path):
    """Of a copy of the sources, with one file, so that the objects of this tree stay."""
    shutil.copytree(ROOT / "csrc", tmp_path / "csrc")
    for name in ("Makefile", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)

    def compile_(*options, check=True):
        words = ["make", "-C", tmp_path, "build/c-cc/csrc/core/status.o", "CC=cc", *options]
        return subprocess.run(words, check=check, capture_output=True, text=True)

    compile_("CFLAGS=-O1")
    assert "status.c" not in compile_("CFLAGS=-O1").stdout
    assert "-O0" in compile_("CFLAGS=-O0").stdout
    assert "-O1" in compile_("CFLAGS=-O1").stdout
    nonsense = compile_("CFLAGS=-O1 --no-such-option", check=False)
    assert nonsense.returncode != 0 and "--no-such-option" in nonsense.stderr
    quoted = """CFLAGS=-O1 -DWORD='"a b"'"""
    compile_(quoted)
    assert "status.c" not in compile_(quoted).stdout


# ---- a processor without a system --------------------------------------------------------------

CORTEX, OF_CORTEX = "arm-none-eabi-gcc", "-mcpu=cortex-m7 -mfpu=fpv5-d16 -mfloat-abi=hard -mthumb"
WITHOUT_A_SYSTEM = """
#include <pmalpha.h>
static const uint64_t MODEL[64] = {1};
static uint64_t room[1024];
int main(void)
{
    pmalpha_model *m;
    double c[3];
    if (pmalpha_open_in(MODEL, sizeof MODEL, room, sizeof room, NULL, &m) != PMALPHA_OK)
        return 1;
    do
        pmalpha_command(m, 0, c);
    while (pmalpha_set(m, 0, 300.0 * c[0]) == PMALPHA_OK && pmalpha_advance(m, 1) == PMALPHA_OK);
    return 0;
}
"""


@pytest.mark.gate
@pytest.mark.skipif(not shutil.which(CORTEX), reason=f"needs {CORTEX}")
def test_the_archive_links_on_a_cortex_m_with_libc_and_libm_alone(tmp_path):
    words = [f"CC={CORTEX}", "AR=arm-none-eabi-ar", "THREADS=none", f"PREFIX={tmp_path}"]
    run("make", "-s", "-C", ROOT, "archive-c", *words, f"CFLAGS={OF_CORTEX} -fno-pic -O1")
    (tmp_path / "x.c").write_text(WITHOUT_A_SYSTEM)
    program, archive = tmp_path / "x.elf", tmp_path / "lib" / "libpmalpha.a"
    strict = "-std=c99 -Wall -Wextra -pedantic -Wconversion -Werror".split()
    flags = [*OF_CORTEX.split(), *strict, "-I", tmp_path / "include"]
    run(CORTEX, *flags, "-c", tmp_path / "x.c", "-o", tmp_path / "x.o")
    ends = ["-lm", "-specs=nosys.specs", "-o", program]
    run(CORTEX, *OF_CORTEX.split(), tmp_path / "x.o", archive, *ends)
    names = {line.split()[-1] for line in run("arm-none-eabi-nm", program).splitlines()}
    assert "pmalpha_open_in" in names
    assert not [x for x in names if x in ("fopen", "printf", "stat") or "__atomic" in x]


# ---- another processor ---------------------------------------------------------------------------

ARM, EMULATOR = "arm-linux-gnueabihf-gcc", "qemu-arm-static"
# Prints the output at each fine step, as it is in memory.
PRINTING = """
#include <pmalpha.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
int main(int count, char **words)
{
    pmalpha_model *m;
    (void)count;
    if (pmalpha_open(words[1], NULL, &m)) return 1;
    for (int k = 0; k < 240; k++) {
        double c[3], u;
        uint64_t bits;
        pmalpha_command(m, 0, c);
        pmalpha_set(m, 0, 300.0 * c[0]);
        if (pmalpha_advance(m, 1)) return 2;
        u = pmalpha_get(m, 0);
        memcpy(&bits, &u, sizeof bits);
        printf("%016llx\\n", (unsigned long long)bits);
    }
    pmalpha_close(m);
    return 0;
}
"""


@pytest.mark.gate
@pytest.mark.skipif(
    not (shutil.which(ARM) and shutil.which(EMULATOR)), reason=f"needs {ARM} and {EMULATOR}"
)
def test_a_32_bit_arm_gives_the_same_numbers(model, tmp_path):
    installed(tmp_path, f"CC={ARM}", "AR=arm-linux-gnueabihf-ar", "CFLAGS=-O1")
    (tmp_path / "print.c").write_text(PRINTING)
    program, folder = tmp_path / "print", tmp_path / "lib"
    words = ["-static", "-I", tmp_path / "include", tmp_path / "print.c", folder / "libpmalpha.a"]
    run(ARM, *words, "-lm", "-pthread", "-o", program)
    assert "ARM" in run("readelf", "-h", program)
    here = compiled(tmp_path / "print.c", tmp_path)
    numbers = run(EMULATOR, program, model[0]).split()
    assert len(set(numbers)) > STEPS // 4  # the output is held over three fine steps
    assert numbers == run(here, model[0]).split()


def compiles_for_32_bits(*flags):
    """Whether gcc has a library of C for x86 of 32 bits, and these flags compile the core."""
    source = '#include <float.h>\n#include <stdio.h>\n#include "status.h"\nint main(void) {}\n'
    words = ["gcc", "-m32", *flags, "-std=c11", "-I", ROOT / "csrc" / "core", "-x", "c", "-"]
    words += ["-o", os.devnull]
    return subprocess.run(words, input=source, capture_output=True, text=True)


X86 = pytest.mark.skipif(
    shutil.which("gcc") is None or compiles_for_32_bits("-msse2", "-mfpmath=sse").returncode != 0,
    reason="needs gcc with libraries for x86 of 32 bits",
)


@pytest.mark.gate
@X86
def test_a_32_bit_x86_gives_the_same_numbers_by_registers_of_doubles(model, tmp_path):
    installed(tmp_path, "CC=gcc -m32", "CFLAGS=-O1 -msse2 -mfpmath=sse")
    (tmp_path / "print.c").write_text(PRINTING)
    program, folder = tmp_path / "print", tmp_path / "lib"
    words = ["-I", tmp_path / "include", tmp_path / "print.c", folder / "libpmalpha.a"]
    run("gcc", "-m32", *words, "-lm", "-pthread", "-o", program)
    here = compiled(tmp_path / "print.c", tmp_path)
    assert run(program, model[0]).split() == run(here, model[0]).split()


@pytest.mark.gate
@X86
@pytest.mark.parametrize("flags", [[], ["-msse2"]])
def test_a_32_bit_x86_without_registers_of_doubles_is_refused_in_one_sentence(flags):
    errors = compiles_for_32_bits(*flags).stderr
    assert errors.count("error:") == 1
    assert "for x86 of 32 bits: -msse2 -mfpmath=sse" in errors
