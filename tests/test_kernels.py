"""The kernel of BLAS that is named at the head of the tests, and the older one of the gate."""

import numpy as np
import pytest
import scipy
from kernels import header, libraries_of_blas, older_kernel


def test_the_head_of_the_tests_names_what_their_last_digits_depend_on():
    line = header()
    assert f"NumPy {np.__version__}, SciPy {scipy.__version__}, BLAS: " in line
    for name, version, kernel in libraries_of_blas():
        assert f"{name} {version} {kernel or ''}".rstrip() in line


@pytest.mark.parametrize(
    ("kernels", "older"),
    [
        (["SkylakeX"], "Haswell"),
        (["Haswell", "Cooperlake"], "Haswell"),  # two versions of OpenBLAS, one of which is older
        (["Haswell"], "Prescott"),
        (["Zen", "Zen"], "Prescott"),
        (["Katmai"], None),  # as which OpenBLAS reports Prescott, the oldest
        (["neoversen1"], None),
        ([None], None),  # of another library
        ([], None),
    ],
)
def test_the_older_kernel_is_one_that_the_processor_can_execute(kernels, older):
    assert older_kernel(kernels) == older
