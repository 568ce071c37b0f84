"""csrc/example.c, compiled with the core alone: its numbers are those of the package."""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import pmalpha as pm

CSRC = Path(__file__).parents[1] / "csrc"


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """The table that the example prints: t, u_A, u_B, cos(omega t), Lam."""
    compiler = os.environ.get("CC", "cc")
    if shutil.which(compiler) is None:
        pytest.skip("no C compiler")
    program = tmp_path_factory.mktemp("example") / "example"
    sources = [CSRC / "example.c", *sorted((CSRC / "core").rglob("*.c"))]
    flags = [
        "-std=c11",
        "-O0",
        "-ffp-contract=off",
        "-fopenmp-simd",
        "-pthread",
        "-Wall",
        "-Wextra",
    ]
    subprocess.run(
        [compiler, *flags, "-Werror", "-I", CSRC / "core", "-o", program, *sources, "-lm"],
        check=True,
    )
    done = subprocess.run([program], check=True, capture_output=True, text=True)
    return np.loadtxt(done.stdout.splitlines())


def oscillators():
    a = pm.Subdomain([3.0], [10.0], scheme=pm.Newmark(), u0=[1.0], name="a")
    b = pm.Subdomain([1.0], [30.0], scheme=pm.CentralDifference(), substeps=4, u0=[1.0], name="b")
    return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.01, coupling="pm")


@pytest.mark.gate
def test_the_example_in_c_computes_what_the_package_computes(printed):
    coupler = oscillators()
    for t, u_a, u_b, exact, lam in printed:
        # to the digits that are printed
        assert abs(coupler.time - t) < 0.006
        assert abs(coupler.state("a").u[0] - u_a) < 1e-12
        assert abs(coupler.state("b").u[0] - u_b) < 1e-12
        assert abs(coupler.multipliers[0] - lam) < 1e-11
        assert abs(np.cos(np.sqrt(10.0) * coupler.time) - exact) < 1e-12
        coupler.step(50)
    assert len(printed) == 11


@pytest.mark.gate
def test_the_example_in_c_follows_the_closed_form(printed):
    # of order 1 with substeps: within omega dt over these 16 radians, and not exact
    error = np.abs(printed[:, 1] - printed[:, 3])
    assert 1e-6 < error.max() < np.sqrt(10.0) * 0.01


def test_the_example_is_short_enough_to_read():
    assert len((CSRC / "example.c").read_text().splitlines()) < 100
