"""`Coupler.modes` and `Coupler.assembled` about the present state; buckling."""

import pickle

import numpy as np
import pytest

import pmalpha as pm

SCHEMES = [pm.GeneralizedAlpha(0.5), pm.GeneralizedAlpha(0.5, explicit=True)]
G, LENGTH, EA = 10.0, 2.0, 1e5


def test_the_mass_on_a_hardening_spring_under_its_load():
    """k = k3 = 1, F = 10: u = 2 and omega^2 = 1 + 3 u^2, given either way."""
    for kind in ("internal", "restoring"):
        spring = {kind: pm.CubicSpring([0], k=1.0, k3=1.0)}
        mass = pm.Subdomain([1.0], None, scheme=pm.Newmark(), force=[10.0], u0=[2.0], **spring)
        coupler = pm.Coupler([mass], dt=0.01)
        assert coupler.modes(1)[0] == pytest.approx([np.sqrt(13.0)], rel=1e-12)
        coupler.reset(u0={0: [0.0]})
        assert coupler.modes(1)[0] == pytest.approx([1.0], rel=1e-12)
        coupler.reset(u0=coupler.static())
        assert coupler.modes(1)[0] == pytest.approx([np.sqrt(13.0)], rel=1e-7)  # of Newton


def softening(t, u, v, q):
    """f = (1 - q) k u + c v with damage q = max |u| / 4 at the end of a step; k, c of two dofs."""
    k, c = np.array([30.0, 20.0]), np.array([0.3, 0.2])
    K = np.diag((1.0 - q) * k)
    return (
        (1.0 - q) * k * u + (1.0 + t) * c * v,
        K,
        np.diag((1.0 + t) * c),
        np.maximum(q, abs(u) / 4),
    )


def expected_of_b(u, q, t):
    """K and C of b by hand: its matrices, springs and function at the present state."""
    K = np.array([[12.0, -4.0], [-4.0, 9.0]])
    d = u[0] - u[1]
    K += (2.0 + 3.0 * 5.0 * d * d) * np.array([[1.0, -1.0], [-1.0, 1.0]])
    K[1, 1] += 7.0 * (u[1] > 0.05)
    K += np.diag((1.0 - q) * [30.0, 20.0])
    return K, np.diag((1.0 + t) * np.array([0.3, 0.2]))


@pytest.mark.parametrize("scheme", SCHEMES, ids=["implicit", "explicit"])
@pytest.mark.parametrize("coupling", ["gc", "pm", "macro", "mean"])
def test_matrices_are_those_of_the_displacements_histories_and_time_of_a_run(coupling, scheme):
    springs = [pm.CubicSpring([(0, 1)], k=2.0, k3=5.0), pm.Gap([1], k=7.0, gap=0.05)]
    damaged = pm.InternalForce(softening, history=np.zeros(2))
    b = pm.Subdomain(
        [1.0, 2.0],
        [[12.0, -4.0], [-4.0, 9.0]],
        scheme=scheme,
        internal=[*springs, damaged],
        u0=[0.3, -0.2],
        v0=[0.0, 6.0],
        substeps=2,
        name="b",
    )
    a = pm.Subdomain([1.5], [10.0], scheme=SCHEMES[0], u0=[0.3], name="a")
    coupler = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.02, coupling=coupling)
    seen = set()
    for _ in range(4):
        whole = coupler.assembled()
        u, t = coupler.state("b").u, coupler.time
        q = coupler.run(steps=0)["b"].q[-1]
        K, C = expected_of_b(u, q, t)
        K[0, 0] += 10.0
        # some ten roundings
        assert np.allclose(whole.K.toarray(), K, rtol=0.0, atol=1e-13 * 60.0)
        assert np.allclose(whole.C.toarray(), C, rtol=0.0, atol=1e-14)
        squares = np.linalg.eigvals(np.linalg.solve(np.diag([2.5, 2.0]), K))
        assert coupler.modes(2)[0] == pytest.approx(np.sqrt(np.sort(squares)), rel=1e-9)
        seen.add((u[1] > 0.05, *q))
        coupler.step(5)
    assert len(seen) > 2 and {gap for gap, *_ in seen} == {False, True}
    coupler.reset()
    assert np.array_equal(
        coupler.assembled().K.toarray()[1], expected_of_b(b.u0, q := np.abs(b.u0) / 4, 0.0)[0][1]
    )


def test_springs_with_a_memory_unload_in_small_motions():
    """Beyond yielding too, where the tangent of the path is zero."""
    for u0 in (0.1, 0.25, 1.0, -3.3):
        for kind in ("internal", "restoring"):
            joint = {kind: pm.Bilinear([0], k=4.0, fy=1.0)}
            s = pm.Subdomain([1.0], None, scheme=pm.Newmark(), u0=[u0], **joint)
            assert pm.Coupler([s], dt=0.01).modes(1)[0] == pytest.approx([2.0], rel=1e-12)


def test_estimates_of_functions_stay_beside_the_tangents_of_springs():
    """K_r = 9 is that of the sum: 4 of the function and 5 of the spring, whose tangent is 5 + 3."""
    s = pm.Subdomain(
        [1.0],
        [1.0],
        scheme=pm.Newmark(),
        restoring=[lambda t, u, v: 4.0 * u, pm.CubicSpring([0], 5.0, 1.0)],
        restoring_stiffness=[9.0],
        u0=[1.0],
    )
    assert pm.Coupler([s], dt=0.01).assembled().K.toarray().tolist() == [[13.0]]
    s = pm.Subdomain(
        [1.0],
        [1.0],
        scheme=pm.Newmark(),
        restoring=pm.CubicSpring([0], 5.0, 1.0),
        u0=[1.0],
    )
    assert pm.Coupler([s], dt=0.01).assembled().K.toarray().tolist() == [[9.0]]


# ---- dead load and buckling ----------------------------------------------------------------------


def bar(t, u, v, q):
    """A bar from the origin to (0, -LENGTH) + u, with its tangent."""
    x = np.array([u[0], u[1] - LENGTH])
    length = np.linalg.norm(x)
    e, pull = x / length, EA * (length / LENGTH - 1.0)
    along = np.outer(e, e)
    return pull * e, EA / LENGTH * along + pull / length * (np.eye(2) - along)


def pendulum(gravity, u0=None):
    mass = pm.Subdomain(
        [1.0, 1.0],
        None,
        scheme=pm.Newmark(),
        internal=bar,
        force=[0.0, gravity],
        u0=u0,
        name="mass",
    )
    return pm.Coupler([mass], dt=0.01)


def test_a_pendulum_has_its_frequency_under_its_weight_only():
    """omega^2 = g / l with the length under load, l = L (1 + m g / EA)."""
    coupler = pendulum(-G)
    assert coupler.modes(1)[0].tolist() == [0.0]  # no geometric stiffness yet
    coupler.reset(u0=coupler.static())
    omega, modes = coupler.modes(2)
    length = LENGTH * (1.0 + G / EA)
    assert omega[0] == pytest.approx(np.sqrt(G / length), rel=1e-8)
    assert abs(modes["mass"][0, 0]) == pytest.approx(1.0)


def test_a_pendulum_upside_down_buckles():
    """The bar is pressed to l = L (1 - m g / EA): omega^2 = - g / l, for motions to the side."""
    coupler = pendulum(G, u0=[0.0, LENGTH * G / EA])
    with pytest.raises(pm.BucklingError, match=r"omega\^2 = -5.*dof 0 of 'mass'") as found:
        coupler.modes(1)
    growth = np.sqrt(G / (LENGTH * (1.0 - G / EA)))
    assert found.value.growth == pytest.approx(growth, rel=1e-8)
    assert abs(found.value.mode["mass"]) == pytest.approx([1.0, 0.0], abs=1e-8)
    again = pickle.loads(pickle.dumps(found.value))  # as from a process of a Study
    assert str(again) == str(found.value) and again.growth == found.value.growth
    assert np.array_equal(again.mode["mass"], found.value.mode["mass"])
    assert coupler.assembled().K.toarray()[0, 0] < 0.0  # which is not refused


@pytest.mark.parametrize(("n", "down"), [(3, 1e-3), (3, 30.0), (250, 0.5)])
def test_the_motion_that_grows_is_found_in_structures_of_any_size(n, down):
    """A chain on springs of negative stiffness: K of the chain - (its lowest omega^2 + down)."""
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    lowest = 2.0 - 2.0 * np.cos(np.pi / (n + 1))
    k = np.full(n, -lowest - down)
    s = pm.Subdomain(
        np.ones(n), K, scheme=pm.Newmark(), internal=lambda t, u, v, q: (k * u, k), name="chain"
    )
    with pytest.raises(
        pm.BucklingError, match="negative stiffness, buckling or softening"
    ) as found:
        pm.Coupler([s], dt=0.01).modes(2)
    # the lowest omega^2 are 1e-4 apart for n = 250; Lanczos' method has them to 1e-6 of the shift
    assert found.value.growth == pytest.approx(np.sqrt(down), rel=1e-4)
    shape = found.value.mode["chain"]
    assert shape @ shape == pytest.approx(1.0)
    assert shape @ (K @ shape) == pytest.approx(lowest, rel=1e-4, abs=1e-4 * down)
