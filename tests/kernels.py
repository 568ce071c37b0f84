"""Kernels of BLAS: which ones the tests run with, and an older one to run them with.

Kernels add in different orders; what a test expects may not depend on that. ``python
tests/kernels.py`` prints the older one, for OPENBLAS_CORETYPE, or an empty line.
"""

import numpy as np
import scipy
import scipy.linalg  # loads the BLAS of SciPy
from threadpoolctl import threadpool_info

# Of OpenBLAS on x86: kernels with AVX-512, and others that are newer than the oldest.
AVX512 = ("SkylakeX", "Cooperlake", "SapphireRapids")
OTHERS = ("Haswell", "Zen", "Sandybridge", "Nehalem", "Excavator", "Steamroller", "Piledriver")


def libraries_of_blas():
    """(name, version, kernel) of each BLAS library that is loaded."""
    return [
        (x["internal_api"], x["version"], x.get("architecture"))
        for x in threadpool_info()
        if x["user_api"] == "blas"
    ]


def older_kernel(kernels):
    """A kernel older than these that their processor can execute, or None."""
    if any(kernel in AVX512 for kernel in kernels):
        return "Haswell"
    return "Prescott" if any(kernel in OTHERS for kernel in kernels) else None


def header():
    """What last digits depend on, in one line."""
    blas = sorted({" ".join(filter(None, library)) for library in libraries_of_blas()})
    versions = f"NumPy {np.__version__}, SciPy {scipy.__version__}"
    return f"{versions}, BLAS: {', '.join(blas) or 'unknown to threadpoolctl'}"


if __name__ == "__main__":
    print(older_kernel([kernel for _, _, kernel in libraries_of_blas()]) or "")
