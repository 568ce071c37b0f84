"""The C extension; everything else about the package stands in pyproject.toml."""

import sys
from glob import glob

import numpy
from setuptools import Extension, setup

if sys.platform not in ("linux", "darwin"):
    sys.exit(f"pmalpha builds on Linux and macOS only, not on {sys.platform}.")

setup(
    ext_modules=[
        Extension(
            "pmalpha._core",
            sources=sorted(glob("csrc/core/**/*.c", recursive=True) + glob("csrc/binding/*.c")),
            depends=sorted(glob("csrc/core/**/*.h", recursive=True) + glob("csrc/binding/*.h")),
            include_dirs=["csrc/core", numpy.get_include()],
            define_macros=[
                ("NPY_NO_DEPRECATED_API", "NPY_2_0_API_VERSION"),
                ("NPY_TARGET_VERSION", "NPY_1_23_API_VERSION"),
            ],
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
    ]
)
