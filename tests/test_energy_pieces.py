"""Works of runs in pieces are those of the whole run: what they go on with belongs to the state.

Compared is what is added after the beginning of a piece, with the differences of the whole run,
to rounding: the forces and displacements are the same numbers.
"""

import numpy as np
import pytest

import pmalpha as pm

STEPS, DT = 40, 0.1
WORKS = ("dissipated", "external", "interface")


def coupler(coupling):
    """Double steps, restoring forces in both subdomains, a spring that yields, random loads."""
    rng = np.random.default_rng(2)
    K = 36.0 * np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    a = pm.Subdomain(
        [1.0, 2.0, 1.0],
        K,
        0.02 * K,
        scheme=pm.GeneralizedAlpha(0.8),
        force=pm.SampledForce(rng.standard_normal((300, 3)), 0.05),
        restoring=[lambda u, v, t: 2.0 * v + 5.0 * u, pm.Bilinear(2, 9.0, 0.3, 0.1)],
        double_step=None if coupling == "gc" else True,
        u0=[0.0, 0.0, 0.1],
        name="a",
    )
    b = pm.Subdomain(
        [1.0],
        [40.0],
        scheme=pm.GeneralizedAlpha(0.8),
        restoring=lambda u, v, t: 3.0 * v + 7.0 * u,
        substeps=2,
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
