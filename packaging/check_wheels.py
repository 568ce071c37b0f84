"""Checks wheels without running them: python packaging/check_wheels.py build/wheels

Of each: the tag, the record, the same files as in the others but for those that are compiled, the
stable ABI (abi3audit), that the extension and the libraries of `pmalpha.c_library()` take from the
system only what its oldest version has, the libraries nothing of Python, what they export, and that
a program in C can be made of header and archive.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import lief
import ziglang
from wheels import PLATFORMS, STABLE_ABI, ZIG, record

lief.logging.disable()

# Libraries that each system has, beside python3.dll.
LIBRARIES = {
    "manylinux": r"lib(c\.so\.6|m\.so\.6|pthread\.so\.0)|ld-linux-(aarch64\.so\.1|x86-64\.so\.2)",
    "musllinux": r"libc\.so",
    "macosx": r"/usr/lib/libSystem\.B\.dylib",
    "win": r"python3\.dll|KERNEL32\.dll|api-ms-win-crt-\w+-l1-1-0\.dll",
}
GLIBC = (2, 17)
C = "pmalpha/c/"
PROGRAM = b"""\
#include <pmalpha.h>
int main(int count, char **words)
{
    pmalpha_model *m;
    return count < 2 || pmalpha_open(words[1], 0, &m) || pmalpha_advance(m, 1);
}
"""
OF_LINKERS = {"", "init", "fini", "__dso_handle", "_mh_dylib_header", "mh_dylib_header"}
PROCESSORS = {
    "x86_64": ("X86_64", "AMD64"),
    "amd64": ("X86_64", "AMD64"),
    "aarch64": ("AARCH64",),
    "arm64": ("ARM64",),
}


def require(holds: bool, message: str) -> None:
    if not holds:
        sys.exit(f"refused: {message}")


def of_elf(binary: lief.ELF.Binary, system: str) -> set[str]:
    """What is taken from the system; glibc names the version that each symbol needs."""
    undefined = [s for s in binary.dynamic_symbols if s.shndx == 0 and s.name]
    for symbol in undefined:
        version = symbol.symbol_version
        if version is not None and version.has_auxiliary_version:
            name = version.symbol_version_auxiliary.name
            found = tuple(map(int, re.findall(r"\d+", name)))
            require(name.startswith("GLIBC_") and found <= GLIBC, f"{symbol.name} of {name}")
    if system == "musllinux":
        known = Path(ziglang.__file__).parent / "lib" / "libc" / "musl" / "libc.S"
        there = set(re.findall(r"^(\w+):", known.read_text(), re.MULTILINE))
        weak = {s.name for s in undefined if s.binding == lief.ELF.Symbol.BINDING.WEAK}
        missing = {s.name for s in undefined} - there - weak - set(STABLE_ABI)
        require(not missing, f"musl has no {sorted(missing)}")
    return {symbol.name for symbol in undefined}


def of_macho(binary: lief.MachO.Binary) -> set[str]:
    """Python's names are found at run time; all others have to be of a library that is linked.

    What the system looks up are the bindings. The table of symbols also has names that only code
    without callers refers to, which the linker has left out: zig's runtime library asks for the
    version of macOS by `_availability_version_check`.
    """
    require(binary.build_version.minos[:2] == [11, 0], f"for macOS {binary.build_version.minos}")
    taken = {bound.symbol.name[1:] for bound in binary.bindings}
    of_libraries = {bound.symbol.name[1:] for bound in binary.bindings if bound.has_library}
    missing = taken - of_libraries - set(STABLE_ABI)
    require(not missing, f"of no library: {sorted(missing)}")
    return taken


def outside(content: bytes, tag: str, own: str) -> tuple[set[str], set[str]]:
    """The names that a library takes from Python and the system, and those that it exports."""
    system, processor = tag.split("_")[0], tag.split("_", 1)[1]
    binary = lief.parse(content)
    libraries = {getattr(library, "name", library) for library in binary.libraries}
    for name in libraries - {f"@rpath/{own}"}:  # its own name, on macOS
        require(bool(re.fullmatch(LIBRARIES[system], name)), f"{tag} needs {name}")
    if isinstance(binary, lief.ELF.Binary):
        taken, machine = of_elf(binary, system), binary.header.machine_type
    elif isinstance(binary, lief.MachO.Binary):
        taken, machine = of_macho(binary), binary.header.cpu_type
    else:  # the import library had the names of the stable ABI only
        taken, machine = {i.name for d in binary.imports for i in d.entries}, binary.header.machine
    kinds = next(kinds for name, kinds in PROCESSORS.items() if processor.endswith(name))
    require(machine.name in kinds, f"{tag} is for {machine.name}")
    return taken, {f.name.removeprefix("_") for f in binary.exported_functions} - OF_LINKERS


def check_extension(content: bytes, tag: str) -> int:
    """The number of names that the extension takes from Python and the system."""
    taken, exported = outside(content, tag, "_core.abi3.so")
    require(exported == {"PyInit__core"}, f"{tag} exports {sorted(exported)[:5]}")
    return len(taken)


def check_shared(content: bytes, tag: str, name: str, exports: str) -> None:
    """A library without Python, all of whose names match, of which there are some."""
    taken, exported = outside(content, tag, name)
    of_python = sorted(taken & set(STABLE_ABI))
    require(not of_python, f"{name} of {tag} takes {of_python[:5]} from Python")
    others = sorted(x for x in exported if not re.fullmatch(exports, x))
    require(bool(exported) and not others, f"{name} of {tag} exports {others[:5]}")


def check_archive(header: bytes, content: bytes, tag: str) -> None:
    """That a program is compiled and linked with them, and where they were made is not in them."""
    platform = PLATFORMS[tag]
    require(b"/zig/" not in content, f"the archive of {tag} has the path of a temporary file")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for name, data in ("pmalpha.h", header), ("libpmalpha.a", content), ("main.c", PROGRAM):
            (folder / name).write_bytes(data)
        flags = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1", "-I."]
        command = [ZIG, "cc", "-target", platform.target, *flags, "main.c", "libpmalpha.a"]
        command += [*platform.link, "-o", "main.exe"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        require(done.returncode == 0, f"no program of the archive of {tag}: {done.stderr[:500]}")


def check_library(files: dict[str, bytes], tag: str) -> None:
    """`pmalpha.c_library()`; what is compiled leaves the dict."""
    header = files.get(f"{C}pmalpha.h", b"")
    functions = set(re.findall(r"\b(pmalpha_\w+)\(", header.decode()))
    require(bool(functions), f"{tag} has no pmalpha.h")
    for name, kind in PLATFORMS[tag].of_library().items():
        require(C + name in files, f"{tag} has no {C}{name}")
        content = files.pop(C + name)
        if kind == "archive":
            check_archive(header, content, tag)
        elif kind == "shared":
            check_shared(content, tag, name, "|".join(functions))
        else:
            names = rf"{kind.replace('fmu', 'fmi')}[A-Z]\w+"
            # and the functions of the library, of whose objects it is made
            check_shared(content, tag, name, "|".join([names, *functions]))
    for name in "sources.zip", "LICENSE":
        require(C + name in files, f"{tag} has no {C}{name}")


def contents(path: Path, tag: str) -> dict[str, bytes]:
    """The files that are the same in all wheels; the others are checked."""
    extension = f"pmalpha/{PLATFORMS[tag].extension}"
    with zipfile.ZipFile(path) as whole:
        files = {name: whole.read(name) for name in whole.namelist()}
    (info,) = {name.split("/")[0] for name in files if ".dist-info/" in name}
    require(files.pop(f"{info}/RECORD") == record(files, info), f"the record of {path.name}")
    said = files.pop(f"{info}/WHEEL").decode()
    require(f"Tag: cp311-abi3-{tag}\n" in said, f"{path.name} says {said!r}")
    count = check_extension(files.pop(extension), tag)
    check_library(files, tag)
    print(f"{path.name}: {path.stat().st_size} bytes, {count} names from outside")
    return files


def main(folder: Path) -> None:
    wheels = sorted(folder.glob("*.whl"))
    found = [contents(path, path.stem.split("-abi3-")[1]) for path in wheels]
    require(bool(found), f"no wheel in {folder}")
    for path, files in zip(wheels, found):
        require(files == found[0], f"{path.name} has other files than {wheels[0].name}")
    audit = Path(sys.executable).with_name("abi3audit")
    subprocess.run([audit, "--strict", "--assume-minimum-abi3", "3.11", *wheels], check=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
