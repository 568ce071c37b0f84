"""Wheels for all platforms, and the source distribution that they are made from, on Linux.

    python packaging/wheels.py build/wheels                           all of PLATFORMS
    python packaging/wheels.py build/wheels manylinux_2_17_x86_64     this one

The folder gets the files and nothing else. zig, of the wheel ziglang, compiles for every platform,
the headers of NumPy are those of its wheels. Two runs of one commit give the same bytes.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import io
import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import time
import zipfile
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import abi3info
import numpy
import setuptools  # before distutils, which it brings
import ziglang

ZIG = str(Path(ziglang.__file__).parent / "zig")
OLDEST = (3, 11)  # Python


@dataclass(frozen=True)
class Platform:
    """A platform: what zig calls it, the oldest platform with wheels of NumPy, its libraries."""

    target: str
    numpy: str
    extension: str = "_core.abi3.so"
    shared: str = "libpmalpha.so"
    link: tuple[str, ...] = ("-pthread", "-lm")
    of_python: tuple[str, ...] = ()  # for the extension alone

    def of_library(self) -> dict[str, str]:
        """The files of `pmalpha.c_library()` that are compiled, and what each is."""
        suffix = Path(self.shared).suffix
        fmus = {f"fmu{v}{suffix}": f"fmu{v}" for v in (2, 3)}
        return {"libpmalpha.a": "archive", self.shared: "shared", **fmus}


MACOS = ("-undefined", "dynamic_lookup", "-install_name", "@rpath/_core.abi3.so")
APPLE: dict[str, Any] = {"shared": "libpmalpha.dylib", "link": (), "of_python": MACOS}
WINDOWS: dict[str, Any] = {
    "extension": "_core.pyd",
    "shared": "pmalpha.dll",
    "link": ("-Wl,/Brepro",),  # a hash in place of the time of the link
    "of_python": ("python3.lib",),
}
PLATFORMS = {
    "manylinux_2_17_x86_64": Platform("x86_64-linux-gnu.2.17", "manylinux_2_28_x86_64"),
    "manylinux_2_17_aarch64": Platform("aarch64-linux-gnu.2.17", "manylinux_2_28_aarch64"),
    "musllinux_1_2_x86_64": Platform("x86_64-linux-musl", "musllinux_1_2_x86_64"),
    "macosx_11_0_x86_64": Platform("x86_64-macos.11.0", "macosx_14_0_x86_64", **APPLE),
    "macosx_11_0_arm64": Platform("aarch64-macos.11.0", "macosx_14_0_arm64", **APPLE),
    "win_amd64": Platform("x86_64-windows-gnu", "win_amd64", **WINDOWS),
}

# What Python.h has to know for the limited API, by what the compiler says of its target.
PYCONFIG = """\
#include <stdio.h>
#define SIZEOF_INT __SIZEOF_INT__
#define SIZEOF_LONG __SIZEOF_LONG__
#define SIZEOF_LONG_LONG __SIZEOF_LONG_LONG__
#define SIZEOF_SIZE_T __SIZEOF_SIZE_T__
#define SIZEOF_VOID_P __SIZEOF_POINTER__
#define SIZEOF_WCHAR_T __SIZEOF_WCHAR_T__
#define HAVE_SSIZE_T 1
#ifdef _WIN32
#define MS_WINDOWS 1
#define HAVE_DECLSPEC_DLL 1
#define Py_ENABLE_SHARED 1
#endif
"""


def run(*command: str | Path, **options: Any) -> None:
    subprocess.run([str(word) for word in command], check=True, **options)


def epoch() -> int:
    """The time that all files get, in s: SOURCE_DATE_EPOCH, by default that of the last commit."""
    given = os.environ.get("SOURCE_DATE_EPOCH")
    if given is None:
        command = ["git", "-c", "safe.directory=*", "log", "-1", "--format=%ct"]
        given = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return int(given)


# ---- the source distribution --------------------------------------------------------------------


def source_distribution(folder: Path, seconds: int) -> Path:
    """The file, made anew without times, owners and an order of this machine."""
    with tempfile.TemporaryDirectory() as scratch:
        run(sys.executable, "-m", "build", "--sdist", "--no-isolation", "--outdir", scratch, ".",
            stdout=subprocess.DEVNULL)  # fmt: skip
        (made,) = Path(scratch).iterdir()
        content = io.BytesIO()
        with tarfile.open(made) as old, tarfile.open(fileobj=content, mode="w") as new:
            for member in sorted(old.getmembers(), key=lambda member: member.name):
                if member.isfile():
                    new.addfile(_plain(member, seconds), old.extractfile(member))
    (folder / made.name).write_bytes(gzip.compress(content.getvalue(), mtime=seconds))
    return folder / made.name


def _plain(member: tarfile.TarInfo, seconds: int) -> tarfile.TarInfo:
    plain = tarfile.TarInfo(member.name)
    plain.size, plain.mtime = member.size, seconds
    plain.mode = 0o755 if member.mode & 0o100 else 0o644
    return plain


# ---- headers and libraries ----------------------------------------------------------------------


def python_headers(folder: Path) -> Path:
    """Those of this Python, which knows its own platform only, with another pyconfig.h."""
    out = folder / "python"
    shutil.copytree(sysconfig.get_path("include"), out)
    (out / "pyconfig.h").write_text(PYCONFIG)
    return out


def numpy_headers(platform: Platform, folder: Path) -> Path:
    """Sizes of types differ; a wheel of the present version for this platform has them."""
    version = f"{sys.version_info[0]}.{sys.version_info[1]}"
    run(sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary", ":all:",
        "--platform", platform.numpy, "--python-version", version, "--dest", folder,
        f"numpy=={numpy.__version__}")  # fmt: skip
    (wheel,) = folder.glob("numpy-*.whl")
    with zipfile.ZipFile(wheel) as whole:
        whole.extractall(folder, [n for n in whole.namelist() if "/_core/include/" in n])
    return folder / "numpy" / "_core" / "include"


def stable_abi() -> dict[str, str]:
    """The names of the limited API of the oldest Python, with DATA where one is a variable."""

    def there(entry: Any) -> bool:
        added = entry.added.major, entry.added.minor
        return added <= OLDEST and (entry.ifdef is None or entry.ifdef.name == "MS_WINDOWS")

    kinds = (abi3info.FUNCTIONS, ""), (abi3info.DATAS, " DATA")
    return {s.name: kind for all_, kind in kinds for s, entry in all_.items() if there(entry)}


STABLE_ABI = stable_abi()


def import_library(out: Path) -> None:
    """Of python3.dll: nothing else of Python can be linked."""
    definition = out.with_suffix(".def")
    names = [name + kind for name, kind in sorted(STABLE_ABI.items())]
    definition.write_text("\n".join(["LIBRARY python3.dll", "EXPORTS", *names, ""]))
    run(ZIG, "dlltool", "-m", "i386:x86-64", "-d", definition, "-l", out)


# ---- extension, library, wheel ------------------------------------------------------------------


class Compiler:
    """Compiles for a platform, of the sources in the present folder, without symbols of it."""

    def __init__(self, platform: Platform, extension: Any, python: Path, folder: Path) -> None:
        folder.mkdir()
        self.platform, self.folder = platform, folder
        include = [*extension.include_dirs[:2], numpy_headers(platform, folder), python]
        self.flags = ["-target", platform.target, *extension.extra_compile_args, "-DNDEBUG", "-g0"]
        self.flags += ["-fPIC", *(f"-I{path}" for path in include)]
        self.flags += [f"-D{name}={value}" for name, value in extension.define_macros]

    def objects(self, sources: Iterable[str]) -> list[Path]:
        def compile_one(source: str) -> Path:
            out = self.folder / (source.replace("/", "_") + ".o")
            # objects for Windows have a name, by itself that of a temporary file
            name = "-Xclang", f"-object-file-name={out.name}"
            run(ZIG, "cc", *self.flags, *name, "-c", source, "-o", out)
            return out

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            return list(pool.map(compile_one, sources))

    def linked(self, name: str, objects: Iterable[Path], *words: str | Path) -> bytes:
        """A shared library."""
        out, target = self.folder / name, self.platform.target
        # without optimization zig compiles its sanitizer, for nothing
        run(ZIG, "cc", "-target", target, "-O3", "-shared", "-s", *objects, *words,
            *self.platform.link, "-o", out)  # fmt: skip
        return out.read_bytes()

    def archive(self, name: str, objects: Iterable[Path]) -> bytes:
        out = self.folder / name
        kind = "darwin" if "macos" in self.platform.target else "gnu"
        run(ZIG, "ar", f"--format={kind}", "rcsD", out, *objects)
        return out.read_bytes()


def compiled(compiler: Compiler, extension: Any, build: Any) -> dict[str, bytes]:
    """The extension, and of the same objects the C library and what FMUs are made of."""
    platform, objects = compiler.platform, compiler.objects(extension.sources)
    core = [o for o, s in zip(objects, extension.sources) if s.startswith("csrc/core/")]
    if "python3.lib" in platform.of_python:
        import_library(compiler.folder / "python3.lib")
    words = [compiler.folder / x if x.endswith(".lib") else x for x in platform.of_python]
    files = {f"pmalpha/{platform.extension}": compiler.linked(platform.extension, objects, *words)}
    core += compiler.objects(build.of_library)
    of_fmu = compiler.objects(build.of_fmu)
    for name, kind in platform.of_library().items():
        own = ["-install_name", f"@rpath/{name}"] if platform.of_python == MACOS else []
        if kind == "archive":
            content = compiler.archive(name, core)
        elif kind == "shared":
            content = compiler.linked(name, core, *own)
        else:
            version = compiler.objects([build.of_version[kind]])
            content = compiler.linked(name, [*core, *of_fmu, *version], *own)
        files[f"{build.LIBRARY}/{name}"] = content
    return files


def of_setup(folder: Path) -> tuple[setuptools.Distribution, dict[str, bytes]]:
    """What setup.py says, and the files of a wheel but those that are compiled."""
    from distutils.core import run_setup

    folder.mkdir()
    distribution = run_setup("setup.py", ["--quiet"], stop_after="config")
    distribution.get_command_obj("build_py").build_lib = str(folder)
    distribution.get_command_obj("dist_info").output_dir = str(folder)
    for command in ("build_py", "dist_info"):
        distribution.run_command(command)
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    content = {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
    build = distribution.get_command_class("build_ext")
    content |= {f"{build.LIBRARY}/{name}": text for name, text in build.texts().items()}
    return distribution, content


def wheel(folder: Path, tag: str, files: Mapping[str, bytes], seconds: int) -> Path:
    """A wheel of these files and a record of them."""
    (info,) = {name.split("/")[0] for name in files if ".dist-info/" in name}
    about = ("Wheel-Version: 1.0", "Generator: packaging/wheels.py", "Root-Is-Purelib: false")
    files = {**files, f"{info}/WHEEL": "\n".join([*about, f"Tag: {tag}", ""]).encode()}
    files[f"{info}/RECORD"] = record(files, info)
    path = folder / f"{info.removesuffix('.dist-info')}-{tag}.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as whole:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, time.gmtime(seconds)[:6])
            entry.external_attr, entry.compress_type = 0o100644 << 16, zipfile.ZIP_DEFLATED
            whole.writestr(entry, content)
    return path


def record(files: Mapping[str, bytes], info: str) -> bytes:
    """RECORD of a wheel: check sums and sizes."""
    lines = [f"{name},{_digest(content)},{len(content)}\n" for name, content in files.items()]
    return "".join([*lines, f"{info}/RECORD,,\n"]).encode()


def _digest(content: bytes) -> str:
    whole = base64.urlsafe_b64encode(hashlib.sha256(content).digest())
    return f"sha256={whole.decode().rstrip('=')}"


def main(out: Path, tags: Iterable[str]) -> None:
    seconds = epoch()
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    out = out.resolve()
    source = source_distribution(out, seconds)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        with tarfile.open(source) as whole:
            whole.extractall(folder, filter="data")
        os.chdir(folder / source.name.removesuffix(".tar.gz"))  # names of files in it are relative
        distribution, files = of_setup(folder / "files")
        (extension,) = distribution.ext_modules
        build = distribution.get_command_class("build_ext")
        python = python_headers(folder)
        for tag in tags:
            compiler = Compiler(PLATFORMS[tag], extension, python, folder / tag)
            whole_files = files | compiled(compiler, extension, build)
            name = f"cp{OLDEST[0]}{OLDEST[1]}-abi3-{tag}"
            print(wheel(out, name, whole_files, seconds), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or PLATFORMS)
