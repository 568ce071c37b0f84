"""Damping that substeps add under "gc" and "pm": the table of docs/couplings.md and its formula."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

import pmalpha as pm
from pmalpha import analysis

PAGE = Path(__file__).parent.parent / "docs" / "couplings.md"


def page_table():
    """c by (share, coupling, substeps)."""
    text = (
        PAGE.read_text("utf-8").partition("<!-- added damping -->")[2].partition("<!-- end -->")[0]
    )
    rows = [
        re.findall(r"[\d.]+", line) for line in text.splitlines() if re.match(r"\| 0\.\d", line)
    ]
    columns = [(c, s) for c in ("gc", "pm") for s in (2, 5, 20)]
    return {
        (float(row[0]), *key): float(x)
        for row in rows
        for key, x in zip(columns, row[1:], strict=True)
    }


def ratio_of(coupler, omega, dt):
    """The damping ratio of the mode of a coupled step."""
    values = np.linalg.eigvals(analysis.amplification_matrix(coupler))
    value = values[np.argmin(np.abs(values - np.exp(1j * omega * dt)))]
    return -np.log(abs(value)) / abs(np.angle(value))


def split(share, coupling, substeps, steps, stiffness=0.8):
    """Damping ratio of a mass on a spring, with a share of it in the subdomain with substeps."""
    dt = 2.0 * np.pi / steps
    a = pm.Subdomain([1.0 - share], [1.0 - stiffness], scheme=pm.Newmark(), name="a")
    b = pm.Subdomain(
        [share], [stiffness], scheme=pm.CentralDifference(), substeps=substeps, name="b"
    )
    return ratio_of(pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=dt, coupling=coupling), 1.0, dt)


@pytest.mark.parametrize("coupling", ["gc", "pm"])
@pytest.mark.parametrize("substeps", [2, 5, 20])
def test_the_table_of_the_page_is_that_of_the_amplification_matrix(coupling, substeps):
    table = page_table()
    shares = sorted({share for share, *_ in table})
    assert len(shares) == 6
    for share in shares:
        c = table[share, coupling, substeps]
        for steps in (100, 200):
            # two digits there, and what the next order adds at 100 steps a period
            assert steps * split(share, coupling, substeps, steps) == pytest.approx(c, abs=0.004)


@pytest.mark.parametrize("coupling", ["macro", "mean"])
def test_macro_and_mean_coupling_add_none(coupling):
    assert abs(split(0.4, coupling, 5, 63)) < 2e-5
    assert abs(split(0.4, "gc", 1, 63)) < 1e-12  # nor does "gc" without substeps
    assert split(0.4, "gc", 5, 63) > 4e-3


def test_it_does_not_depend_on_where_the_stiffness_is():
    values = [split(0.4, "gc", 5, 126, x) for x in (0.0, 0.5, 1.0)]
    assert np.ptp(values) < 2e-3 * max(values)


@pytest.mark.parametrize("coupling", ["gc", "pm"])
@pytest.mark.parametrize("mode", [0, 1, 2])
def test_a_mode_has_the_share_of_its_kinetic_energy_at_the_tied_dof(coupling, mode):
    share, substeps, steps = 0.4, 5, 200
    m = np.array([1.0, 1.6, 0.8, 1.2, 0.7])
    k = [900.0, 1500.0, 700.0, 1200.0, 1000.0]
    K = np.zeros((5, 5))
    for i in range(4):
        K[i : i + 2, i : i + 2] += k[i] * np.array([[1.0, -1.0], [-1.0, 1.0]])
    K[0, 0] += k[4]
    right = np.zeros((5, 5))
    for i in (2, 3):
        right[i : i + 2, i : i + 2] += k[i] * np.array([[1.0, -1.0], [-1.0, 1.0]])
    square, shapes = eigh(K, np.diag(m))
    omega, energy = np.sqrt(square[mode]), m[2] * shapes[2, mode] ** 2
    dt = 2.0 * np.pi / omega / steps
    left_mass, right_mass = m[:3] * [1.0, 1.0, 1.0 - share], m[2:] * [share, 1.0, 1.0]
    a = pm.Subdomain(left_mass, (K - right)[:3, :3], scheme=pm.Newmark(), name="a")
    b = pm.Subdomain(
        right_mass, right[2:, 2:], scheme=pm.CentralDifference(), substeps=substeps, name="b"
    )
    coupler = pm.Coupler([a, b], pm.tie(a, [2], b, [0]), dt=dt, coupling=coupling)
    expected = page_table()[share, coupling, substeps] * energy / steps
    # terms of the next order: some per cent of it at 200 steps, most for the first mode of "pm",
    # in whose steps the higher modes are not resolved
    assert ratio_of(coupler, omega, dt) == pytest.approx(expected, rel=0.05, abs=2e-6)


def test_the_bound_of_the_page_holds_and_is_reached():
    for (share, coupling, s), c in page_table().items():
        bound = np.pi / 6.0 * (1.0 - s**-2.0) * (1.0 - share) / (1.0 if coupling == "gc" else 2.0)
        assert c <= bound + 1e-3
        if s == 2:
            assert c == pytest.approx(bound, abs=1e-3)
    assert page_table()[0.9, "gc", 20] == pytest.approx(np.pi / 60.0, abs=1e-3)
