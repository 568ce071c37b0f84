"""The check of extensions, on small libraries that zig makes: what must be refused is.

Run by `make wheels`, since only its environment has zig and lief.
"""

import subprocess

import check_wheels
import pytest
from check_wheels import check_archive, check_extension, check_library, check_shared
from wheels import MACOS, ZIG

NOTHING = "int PyInit__core(void) { return 0; }"
LINUX, MAC = "x86_64-linux-gnu.2.17", "x86_64-macos.11.0"


def library(folder, code, target, *options):
    """The content of a library made of this C code."""
    source, out = folder / "code.c", folder / "out"
    source.write_text(code)
    subprocess.run(
        [ZIG, "cc", "-target", target, "-O3", "-g0", "-fPIC", "-shared", "-s"]
        + [str(source), "-o", str(out), *options],
        check=True,
    )
    return out.read_bytes()


def test_a_library_that_takes_nothing_from_outside_passes(tmp_path):
    assert check_extension(library(tmp_path, NOTHING, LINUX), "manylinux_2_17_x86_64") < 10


def test_names_of_python_and_of_the_system_are_counted_on_macos(tmp_path):
    code = """
        #include <sched.h>
        void *PyList_New(long size);
        int PyInit__core(void) { return sched_yield() + (PyList_New(1) != 0); }
    """
    content = library(tmp_path, code, MAC, *MACOS)
    # beside these two, the stub that binds them when they are called first
    assert 2 <= check_extension(content, "macosx_11_0_x86_64") <= 3


def test_a_name_of_no_library_is_refused_on_macos(tmp_path):
    code = "int nowhere(void); int PyInit__core(void) { return nowhere(); }"
    content = library(tmp_path, code, MAC, *MACOS)
    with pytest.raises(SystemExit, match="refused: of no library: .'nowhere'"):
        check_extension(content, "macosx_11_0_x86_64")


def test_a_name_that_only_code_without_callers_refers_to_is_not_taken_on_macos(tmp_path):
    code = """
        int nowhere(void);
        __attribute__((visibility("hidden"), noinline)) int uncalled(void) { return nowhere(); }
        int PyInit__core(void) { return 0; }
    """
    content = library(tmp_path, code, MAC, *MACOS)
    assert b"_nowhere" in content  # in the table of symbols; else this tests nothing
    check_extension(content, "macosx_11_0_x86_64")


def test_a_symbol_of_a_newer_glibc_is_refused(tmp_path, monkeypatch):
    code = "#include <sched.h>\nint PyInit__core(void) { return sched_yield(); }"
    content = library(tmp_path, code, LINUX)
    check_extension(content, "manylinux_2_17_x86_64")
    monkeypatch.setattr(check_wheels, "GLIBC", (2, 2))  # the first for this processor is 2.2.5
    with pytest.raises(SystemExit, match="refused: sched_yield of GLIBC_2.2.5"):
        check_extension(content, "manylinux_2_17_x86_64")


def test_a_library_that_not_every_system_has_is_refused(tmp_path):
    other = tmp_path / "libother.so"
    subprocess.run(
        [ZIG, "cc", "-target", LINUX, "-shared", "-x", "c", "-", "-o", str(other)],
        input=b"int other(void) { return 1; }",
        check=True,
    )
    code = "int other(void); int PyInit__core(void) { return other(); }"
    content = library(tmp_path, code, LINUX, str(other))
    with pytest.raises(SystemExit, match="needs .*libother.so"):
        check_extension(content, "manylinux_2_17_x86_64")


def test_an_extension_for_another_processor_is_refused(tmp_path):
    content = library(tmp_path, NOTHING, LINUX)
    with pytest.raises(SystemExit, match="manylinux_2_17_aarch64 is for X86_64"):
        check_extension(content, "manylinux_2_17_aarch64")


def test_an_extension_that_exports_more_than_its_module_is_refused(tmp_path):
    content = library(tmp_path, NOTHING + " int more(void) { return 1; }", LINUX)
    with pytest.raises(SystemExit, match="exports .*more"):
        check_extension(content, "manylinux_2_17_x86_64")


HEADER = b"int pmalpha_abi(void);\n"
OF_C = "pmalpha_abi"


def test_a_library_of_c_exports_the_functions_of_its_header_alone(tmp_path):
    content = library(tmp_path, "int pmalpha_abi(void) { return 1; }", LINUX)
    check_shared(content, "manylinux_2_17_x86_64", "libpmalpha.so", OF_C)
    more = library(
        tmp_path, "int pmalpha_abi(void) { return 1; } int more(void) {return 1;}", LINUX
    )
    with pytest.raises(SystemExit, match="libpmalpha.so of .* exports .'more'"):
        check_shared(more, "manylinux_2_17_x86_64", "libpmalpha.so", OF_C)


def test_a_library_of_c_that_needs_python_is_refused(tmp_path):
    code = "void *PyList_New(long size); int pmalpha_abi(void) { return PyList_New(1) != 0; }"
    content = library(tmp_path, code, LINUX)
    with pytest.raises(SystemExit, match="takes .'PyList_New'. from Python"):
        check_shared(content, "manylinux_2_17_x86_64", "libpmalpha.so", OF_C)


def test_a_wheel_without_a_file_of_the_library_is_refused():
    tag = "manylinux_2_17_x86_64"
    with pytest.raises(SystemExit, match="has no pmalpha.h"):
        check_library({}, tag)
    with pytest.raises(SystemExit, match="has no pmalpha/c/libpmalpha.a"):
        check_library({"pmalpha/c/pmalpha.h": HEADER}, tag)


def test_an_archive_without_the_functions_is_refused():
    with pytest.raises(SystemExit, match="no program of the archive of manylinux_2_17_x86_64"):
        check_archive(HEADER, b"!<arch>\n", "manylinux_2_17_x86_64")


def test_an_archive_that_says_where_it_was_made_is_refused():
    content = b"!<arch>\n/home/a/.cache/zig/tmp/b55efa0d-blas.obj"
    with pytest.raises(SystemExit, match="the archive of win_amd64 has the path of a temporary"):
        check_archive(HEADER, content, "win_amd64")
