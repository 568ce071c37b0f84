"""The C extension; everything else about the package stands in pyproject.toml."""

import io
import os
import sys
import sysconfig
import zipfile
from concurrent.futures import ThreadPoolExecutor
from glob import glob
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy
from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.errors import CCompilerError

spec = spec_from_file_location("stale", Path("pmalpha", "stale.py"))
stale = module_from_spec(spec)
spec.loader.exec_module(stale)

# The stable ABI: one wheel for Python 3.11 and later. Interpreters without the GIL have none. On
# Windows, where Microsoft's C has no atomics, setuptools links other compilers with the library of
# one version of Python; packaging/wheels.py makes wheels for Windows elsewhere.
STABLE = not sysconfig.get_config_var("Py_GIL_DISABLED") and sys.platform != "win32"
OPTIONS = {
    "bdist_wheel": {"py_limited_api": "cp311"} if STABLE else {},
    "build_ext": {"compiler": "mingw32"} if sys.platform == "win32" else {},
}


SHARED = {"win32": "pmalpha.dll", "darwin": "libpmalpha.dylib"}.get(sys.platform, "libpmalpha.so")
WITHOUT_A_COMPILER = "a C compiler is needed; without one, see docs/install.md#without-a-compiler"


def newer(path, other):
    return path.exists() and path.stat().st_mtime >= other.stat().st_mtime


class Build(build_ext):
    """With all processors, and without earlier libraries for one version of Python.

    Those would be imported. In place a stamp says of which sources it is. Of the objects of the
    extension is the C library too, in LIBRARY; packaging/wheels.py makes it of the same lists.
    """

    LIBRARY = "pmalpha/c"
    of_library = sorted(path.replace("\\", "/") for path in glob("csrc/library/*.c"))
    of_fmu = ("csrc/fmu/fmu.c", "csrc/fmu/resource.c")
    of_version = {"fmu2": "csrc/fmu/fmu2.c", "fmu3": "csrc/fmu/fmu3.c"}

    @staticmethod
    def texts():
        """What the folder of the library has on every system: header, licence, sources."""
        content = io.BytesIO()
        with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in sorted(Path("csrc").glob("**/*.[ch]")):
                top, *rest = path.relative_to("csrc").parts
                if top in ("core", "library", "fmu") and "none" not in rest:
                    name = "/".join(rest if top == "core" else [top, *rest])
                    info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))  # the same in each build
                    info.compress_type = zipfile.ZIP_DEFLATED
                    archive.writestr(info, path.read_bytes())
        files = {Path(x).name: Path(x).read_bytes() for x in ("csrc/library/pmalpha.h", "LICENSE")}
        return {**files, "sources.zip": content.getvalue()}

    def build_extension(self, ext):
        # skipped where it is newer than all that the library and it are made of, and the library is
        # newer than it: that of a build which was interrupted is not
        ext.depends = [
            *ext.depends,
            "setup.py",
            *glob("csrc/library/*.[ch]"),
            *glob("csrc/fmu/*.[ch]"),
        ]
        extension, last = Path(self.get_ext_fullpath(ext.name)), self.path_of_library("fmu3")
        if extension.exists() and not newer(last, extension):
            self.force = True
        compiler = self.compiler.compile
        core, core_options = [], {}

        def together(sources, **options):
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                objects = list(pool.map(lambda source: compiler([source], **options), sources))
            of_core = [x.startswith(("csrc/core", "csrc\\core")) for x in sources]
            core.extend(x[0] for x, is_one in zip(objects, of_core) if is_one)
            if not core_options:
                core_options.update(options)
            return sum(objects, [])

        self.compiler.compile = together
        super().build_extension(ext)
        if core:
            library = core + together(self.of_library, **core_options)
            fmu = together([*self.of_fmu, *self.of_version.values()], **core_options)
            self.build_library(library, fmu)

    def path_of_library(self, stem):
        return Path(self.build_lib, self.LIBRARY, stem).with_suffix(Path(SHARED).suffix)

    def build_library(self, objects, fmu):
        """`pmalpha.c_library()` beside the extension, and what FMUs are made of."""
        folder = Path(self.build_lib, self.LIBRARY)
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in self.texts().items():
            (folder / name).write_bytes(content)
        (folder / "libpmalpha.a").unlink(missing_ok=True)  # objects are only ever added to it
        self.compiler.create_static_lib(objects, "pmalpha", output_dir=str(folder))
        small = ["-Wl,--strip-debug"] if sys.platform == "linux" else []
        link = {"libraries": ["m"], "extra_postargs": ["-pthread", *small]}
        self.compiler.link_shared_object(objects, str(folder / SHARED), **link)
        count = len(self.of_fmu)
        for name, version in zip(self.of_version, fmu[count:]):
            path = str(self.path_of_library(name))
            self.compiler.link_shared_object([*objects, *fmu[:count], version], path, **link)

    def run(self):
        try:
            super().run()
        except CCompilerError as error:
            raise CCompilerError(f"{error}\n{WITHOUT_A_COMPILER}") from None
        if self.inplace:
            Path(self.LIBRARY).mkdir(exist_ok=True)
            for path in sorted(Path(self.build_lib, self.LIBRARY).iterdir()):
                self.copy_file(str(path), self.LIBRARY)
        if self.inplace and STABLE:
            for path in Path("pmalpha").glob("_core.cpython-*"):
                path.unlink()
        if self.inplace:
            stale.write_stamp(Path("."))


setup(
    cmdclass={"build_ext": Build},
    options=OPTIONS,
    ext_modules=[
        Extension(
            "pmalpha._core",
            sources=sorted(glob("csrc/core/**/*.c", recursive=True) + glob("csrc/binding/*.c")),
            depends=sorted(glob("csrc/core/**/*.h", recursive=True) + glob("csrc/binding/*.h")),
            include_dirs=["csrc/core", "csrc", numpy.get_include()],
            define_macros=[
                ("NPY_NO_DEPRECATED_API", "NPY_2_0_API_VERSION"),
                ("NPY_TARGET_VERSION", "NPY_1_23_API_VERSION"),
                ("PMALPHA_BUILD", "1"),  # of the functions of pmalpha.h, for Windows
                *([("Py_LIMITED_API", "0x030B0000")] if STABLE else []),
            ],
            py_limited_api=STABLE,
            extra_compile_args=[
                "-std=c11",
                "-O3",
                "-g0",  # after the -g of Python: debug information has the path of the build
                "-ffp-contract=off",  # a fused multiply-add would round otherwise than written
                "-fno-trapping-math",  # no value changes; a select may compute both sides
                "-fopenmp-simd",
                "-pthread",
                "-fvisibility=hidden",
                "-Wall",
                "-Wextra",
            ],
            extra_link_args=["-pthread"],
            libraries=["m"],
        )
    ],
)
