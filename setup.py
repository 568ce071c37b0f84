"""The C extension; everything else about the package stands in pyproject.toml."""

import os
import sys
import sysconfig
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


WITHOUT_A_COMPILER = "a C compiler is needed; without one, see docs/install.md#without-a-compiler"


class Build(build_ext):
    """With all processors, and without earlier libraries for one version of Python.

    Those would be imported. In place a stamp says of which sources it is.
    """

    def build_extension(self, ext):
        compiler = self.compiler.compile

        def together(sources, **options):
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                return sum(pool.map(lambda source: compiler([source], **options), sources), [])

        self.compiler.compile = together
        super().build_extension(ext)

    def run(self):
        try:
            super().run()
        except CCompilerError as error:
            raise CCompilerError(f"{error}\n{WITHOUT_A_COMPILER}") from None
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
            include_dirs=["csrc/core", numpy.get_include()],
            define_macros=[
                ("NPY_NO_DEPRECATED_API", "NPY_2_0_API_VERSION"),
                ("NPY_TARGET_VERSION", "NPY_1_23_API_VERSION"),
                *([("Py_LIMITED_API", "0x030B0000")] if STABLE else []),
            ],
            py_limited_api=STABLE,
            extra_compile_args=[
                "-std=c11",
                "-O3",
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
