"""The kernel of BLAS that is named at the head of the tests, and the older one of the gate."""

import os
import subprocess
import sys
from pathlib import Path

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


# A kernel without fused multiply-adds and one with them round every product of matrices otherwise.
DIGITS = """
import hashlib
import warnings

import frozen_couplers
import numpy as np
from kernels import libraries_of_blas

warnings.simplefilter("ignore")
couplers = [frozen_couplers.full(c, n, t) for c in ("gc", "macro") for n, t in ((12, 5), (50, 8))]
couplers += [frozen_couplers.frame(c, "bilinear") for c in ("gc", "pm", "macro")]
for coupler in couplers:
    history = coupler.run(steps=20)
    digits = history.multipliers.tobytes() + b"".join(x.u.tobytes() for x in history)
    print(hashlib.sha256(digits).hexdigest())
A = np.sqrt(np.arange(1.0, 900.0)).reshape(29, 31)
print(hashlib.sha256((A @ A.T).tobytes()).hexdigest())
"""


def digits(**environment):
    """A check sum of each run, and last of a product by BLAS."""
    folder = Path(__file__).parent
    done = subprocess.run(
        [sys.executable, "-c", DIGITS],
        env=os.environ | environment,
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split()


def test_problems_of_some_dofs_have_the_same_digits_under_every_kernel():
    if older_kernel([kernel for _, _, kernel in libraries_of_blas()]) is None:
        pytest.skip("no older kernel of OpenBLAS")
    *present, product = digits()
    *oldest, other_product = digits(OPENBLAS_CORETYPE="Prescott")
    assert len(set(present)) == 7
    assert present == oldest
    assert product != other_product  # else the kernels do not differ here, and nothing is seen
