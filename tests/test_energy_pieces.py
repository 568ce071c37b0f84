"""Works of runs in pieces are those of the whole run: what they go on with belongs to the state.

Compared is what is added after the beginning of a piece, with the differences of the whole run,
to rounding: the forces and displacements are the same numbers.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import pmalpha as pm

STEPS, DT = 40, 0.1
WORKS = ("dissipated", "external", "interface")


def coupler(coupling, scheme=pm.GeneralizedAlpha(0.8), double=True, substeps=2):  # noqa: B008
    """Double steps, restoring forces in both subdomains, a spring that yields, random loads, one
    of which depends on the motion."""
    rng = np.random.default_rng(2)
    K = 36.0 * np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    a = pm.Subdomain(
        [1.0, 2.0, 1.0],
        K,
        C=0.02 * K,
        scheme=scheme,
        force=[
            pm.SampledForce(rng.standard_normal((300, 3)), 0.05),
            lambda t, u, v: np.array([0.0, 0.2 * np.sin(t) * v[1], 0.0]),
        ],
        restoring=[lambda t, u, v: 2.0 * v + 5.0 * u, pm.Bilinear(2, 9.0, 0.3, 0.1)],
        double_step=None if coupling == "gc" else double,
        u0=[0.0, 0.0, 0.1],
        name="a",
    )
    b = pm.Subdomain(
        [1.0],
        [40.0],
        scheme=scheme,
        restoring=lambda t, u, v: 3.0 * v + 7.0 * u,
        substeps=substeps,
        name="b",
    )
    return pm.Coupler([a, b], pm.tie("a", [0], "b", [0]), dt=DT, coupling=coupling)


def check(energy, whole, begin):
    """The works of a piece that begins at this macro step."""
    count = len(energy.t)
    for name in (*WORKS, "balance"):
        x = getattr(whole, name)
        expected = x[begin : begin + count] - x[begin]
        # of sums of works of size 1 to 10
        np.testing.assert_allclose(getattr(energy, name), expected, rtol=0, atol=1e-12)


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
@pytest.mark.parametrize("coupling", ["pm", "macro", "gc"])
def test_energies_of_pieces_are_those_of_the_whole_run(coupling, tmp_path):
    """Also from a checkpoint and after a snapshot, with other runs in between."""
    rng = np.random.default_rng(3)
    whole = coupler(coupling).run(steps=STEPS, energy=True).energy
    assert np.abs(whole.dissipated).max() > 0.1
    pieces, done = coupler(coupling), 0
    for i in range(6):
        n = int(rng.integers(1, 8))
        if i % 3 == 1:
            pieces.save(tmp_path / "state.npz")
            pieces = coupler(coupling)
            pieces.load(tmp_path / "state.npz")
        if i % 3 == 2:
            snapshot = pieces.snapshot()
            pieces.run(steps=3, energy=True)
            pieces.step(2)
            pieces.restore(snapshot)
        check(pieces.run(steps=n, energy=True).energy, whole, done)
        done += n


def test_works_go_on_from_the_state_in_which_they_ended_only():
    """Not after steps without energies, nor from the beginning again."""
    c = coupler("pm")
    first = c.run(steps=5, energy=True).energy
    c.reset()
    np.testing.assert_array_equal(c.run(steps=5, energy=True).energy.dissipated, first.dissipated)
    c.step(1)
    later = c.run(steps=5, energy=True).energy
    other = coupler("pm")
    other.step(6)
    np.testing.assert_array_equal(
        other.run(steps=5, energy=True).energy.dissipated, later.dissipated
    )


# ---- energies that begin after steps without them ------------------------------------------------

SCHEMES = [pm.Newmark(), pm.GeneralizedAlpha(0.5)]


def begun_later(tmp_path, how, begin, *problem):
    """Energies from this macro step on, before which there are none."""
    c = coupler(*problem)
    c.step(begin)
    if how == "loaded":
        c.save(tmp_path / "state.npz")
        c = coupler(*problem)
        c.load(tmp_path / "state.npz")
    if how == "restored":
        snapshot = c.snapshot()
        c.step(3)
        c.restore(snapshot)
    if how == "loaded and saved again":
        c.restore(c.snapshot())
        c.save(tmp_path / "state.npz")
        c = coupler(*problem)
        c.load(tmp_path / "state.npz")
    return c.run(steps=STEPS - begin, energy=True).energy


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
@pytest.mark.parametrize(
    ("how", "coupling"),
    [("stepped", "gc"), ("restored", "pm"), ("loaded", "macro"), ("loaded and saved again", "gc")],
)
def test_energies_of_single_steps_begun_later_are_those_of_the_whole_run(tmp_path, how, coupling):
    problem = (coupling, pm.GeneralizedAlpha(0.8), False)
    whole = coupler(*problem).run(steps=STEPS, energy=True).energy
    check(begun_later(tmp_path, how, 13, *problem), whole, 13)


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
@pytest.mark.parametrize("coupling", ["pm", "macro"])
def test_double_steps_begun_later_have_the_works_of_one_chain_and_the_sum_of_the_other(
    tmp_path, coupling, scheme
):
    """(B14): from the beginning on every second time level has the works of the whole run; the
    others have in sum what keeps the energy in the first step, and then what is added to it."""
    problem, begin = (coupling, scheme, True), 13
    whole = coupler(*problem).run(steps=STEPS, energy=True).energy
    later = begun_later(tmp_path, "loaded", begin, *problem)
    for name in (*WORKS, "balance"):  # of size 1 to 10, as above
        x = getattr(whole, name)[begin:]
        y = getattr(later, name)
        assert_allclose(y[::2], (x - x[0])[::2], rtol=0, atol=1e-12)
        assert_allclose(y[1::2] - y[1], (x - x[1])[1::2], rtol=0, atol=1e-12)
        assert_allclose(y[:, 1], x[:, 1] - x[0, 1], rtol=0, atol=1e-12)  # single steps
    assert_allclose(later.balance[1, 0], 0.0, atol=1e-12)
    added = whole.balance[begin + 1] - whole.balance[begin]
    tail = whole.balance[begin:] - whole.balance[begin]
    tail[1::2, 0] -= added[0]
    assert_allclose(later.balance, tail, rtol=0, atol=1e-12)
