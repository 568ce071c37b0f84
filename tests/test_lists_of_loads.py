"""Lists of loads: the sum of all acts, of whatever kinds, wherever a force is given."""

import numpy as np
import pytest
from compiled import FORCE
from scipy import LowLevelCallable

import pmalpha as pm
from pmalpha import structures

M, K = np.array([2.0, 1.0, 3.0]), 20.0 * np.array([[2, -1, 0], [-1, 2, -1], [0, -1, 2.0]])
HALF = pm.GeneralizedAlpha(0.8)


def kinds(rng):
    """A load of each kind on three dofs, as given in a list and as a function of t."""
    constant, shape = rng.normal(size=(2, 3))
    samples, record = rng.normal(size=12), rng.normal(size=9)
    sampled = pm.SampledForce(samples, 0.13, shape)
    quake = pm.BaseAcceleration(record, dt=0.11)
    own = pm.BaseAcceleration(record, np.ones(3), M, dt=0.11)
    wave = lambda t: np.sin(7.0 * t) * shape  # noqa: E731
    late = lambda t: np.cos(3.0 * t) * constant  # noqa: E731
    return [
        (constant, lambda t: constant),
        (sampled, sampled),
        (quake, own),
        (wave, wave),
        (late, late),
        (2.0 * constant, lambda t: 2.0 * constant),
        (pm.BaseAcceleration(record[::-1], [1.0, 0.0, 2.0], M, dt=0.07),) * 2,
    ]


def pair(force, coupling="gc", name="a"):
    a = pm.Subdomain(M, K, scheme=HALF, force=force, substeps=2, name=name)
    b = pm.Subdomain([1.0], [9.0], scheme=HALF, v0=[0.0], name="b")
    return pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.1, coupling=coupling)


def close(found, expected):
    # sums in another order; stable steps do not enlarge it: 40 of them
    for name in "uva":
        x, y = (getattr(h["a"], name) for h in (found, expected))
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-12 * np.abs(y).max())


@pytest.mark.parametrize("seed", range(12))
def test_a_list_of_loads_acts_as_their_sum(seed):
    rng = np.random.default_rng(seed)
    chosen = [kinds(rng)[i] for i in rng.permutation(7)[: rng.integers(1, 6)]]
    given = [x for x, _ in chosen]
    if seed % 3 == 0:  # lists in lists
        given = [given[:2], *given[2:]] if any(callable(x) for x in given[:2]) else given
    coupling = ("gc", "pm", "macro")[seed % 3]

    def total(t):
        return sum(f(t) for _, f in chosen)

    expected = pair(total, coupling).run(steps=20)
    close(pair(given, coupling).run(steps=20), expected)
    coupler = pair(None, coupling)
    coupler.reset(force={"a": given})
    close(coupler.run(steps=20), expected)
    cases = [{"force": {"a": given}}] * 4
    for history in pair(None, coupling).run_each(cases, steps=20):
        close(history, expected)


def test_compiled_functions_and_forces_of_the_motion_are_among_them():
    def push(t, n, f, user):
        f[0], f[2] = np.cos(2.0 * t), -t
        return 0

    compiled = LowLevelCallable(FORCE(push))
    wave = lambda t: np.sin(t) * np.ones(3)  # noqa: E731
    damper = lambda t, u, v: -0.3 * v + t  # noqa: E731
    alone = [pair(x).run(steps=20) for x in (compiled, wave)]
    both = pair([wave, compiled]).run(steps=20)
    # linear: responses from rest add up
    for name in "uva":
        x, y = (getattr(h["a"], name) for h in alone)
        z = getattr(both["a"], name)
        np.testing.assert_allclose(z, x + y, rtol=0, atol=1e-12 * np.abs(z).max())
    found = pair([damper, np.ones(3), lambda t, u, v: -0.1 * v]).run(steps=20)
    close(found, pair(lambda t, u, v: -0.4 * v + t + 1.0).run(steps=20))


@pytest.mark.parametrize("seed", range(4))
def test_means_of_several_loads_keep_each_its_impulse(seed, tmp_path):
    rng = np.random.default_rng(seed)
    pulses = []
    for _ in range(3):
        samples = np.zeros(40)
        samples[rng.integers(5, 30)] = 1.0 / 0.013
        pulses.append(pm.SampledForce(samples, 0.013, [1.0], average=True))
    mass = pm.Subdomain([1.0], [0.0], scheme=pm.Newmark(), force=pulses, name="a")
    coupler = pm.Coupler([mass], dt=0.05)
    coupler.step(4)
    coupler.change_steps(dt=0.02)
    coupler.step(3)
    coupler.save(tmp_path / "state.npz")
    whole = coupler.run(steps=30)
    # three unit impulses on a unit mass
    assert whole["a"].v[-1, 0] == pytest.approx(3.0, rel=1e-12)
    again = pm.Coupler([mass], dt=0.05)
    again.load(tmp_path / "state.npz")
    np.testing.assert_array_equal(again.run(steps=30)["a"].v, whole["a"].v)


def test_a_mesh_takes_a_list_of_loads_of_all_dofs_or_of_the_free_ones():
    bar = structures.rod(4, 4.0, EA=9.0, rhoA=1.0, mass="lumped")
    weight, quake = np.arange(5.0), pm.BaseAcceleration([0.0, 1.0, -2.0, 0.5], dt=0.1)
    held = bar.subdomain(scheme=HALF, fixed=0, force=[weight, quake, np.ones(4)], name="a")
    expected = weight[1:] + 1.0 - held.M * 1.0
    total = sum(x(0.1) if callable(x) else x for x in held.force)
    np.testing.assert_allclose(total, expected, rtol=1e-14)
    parts = pm.cut(bar, [0, 0, 1, 1], scheme=HALF, fixed=0, force=[weight, quake])
    run = parts.gather(parts.coupler(dt=0.05, coupling="gc").run(steps=30))
    alone = pm.solve(bar.subdomain(scheme=HALF, fixed=0, force=[quake, weight]), 0.05, steps=30)
    # equal steps under "gc" are those of the uncut structure: rounding
    size = np.abs(alone.u).max()
    np.testing.assert_allclose(run.u[:, 1:], alone.u, rtol=0, atol=1e-11 * size)
    elements = structures.rod(2, 2.0, EA=9.0, rhoA=1.0)
    small = elements.subdomain(scheme=HALF, force=[np.ones(3), quake]).reduced([0, 2], modes=1)[0]
    assert len(small.force) == 2


@pytest.mark.parametrize(
    ("force", "error", "message"),
    [
        ([np.ones(3), np.ones(2)], ValueError, r"force\[1\] must have shape \(3,\)"),
        (
            [np.ones(3), [lambda t: 0, lambda t, u: 0]],
            TypeError,
            r"force\[1\]\[1\] must be a funct",
        ),
        (
            [np.ones(3), pm.SampledForce([1.0], 0.1, [1.0, 1.0])],
            ValueError,
            r"force\[1\] must act on 3 dofs, got a SampledForce on 2",
        ),
        (
            [pm.BaseAcceleration([1.0], np.ones(3), 10.0 * M, dt=0.1), np.ones(3)],
            ValueError,
            r"BaseAcceleration in force\[0\] must be the mass matrix .* -30 at dof 2 .* -3",
        ),
        ([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]], ValueError, "force must be a 1-D array"),
        (["wind", np.ones(3)], TypeError, r"force\[0\] must hold real numbers"),
    ],
)
def test_what_is_wrong_in_a_list_is_named_by_its_place(force, error, message):
    with pytest.raises(error, match=message):
        pair(force)


def test_values_of_the_wrong_shape_are_named():
    with pytest.raises(ValueError, match="force of subdomain 'a' at t = 0: .* of each function"):
        pair([lambda t: np.ones(3), lambda t: np.ones(2)]).run(steps=2)


def test_a_list_of_numbers_remains_the_force_on_each_dof():
    s = pm.Subdomain(M, K, scheme=HALF, force=[1, 2.0, np.float64(3.0)])
    assert s.force.tolist() == [1.0, 2.0, 3.0]
    assert pm.Subdomain(M, K, scheme=HALF, force=[np.ones(3), 2 * np.ones(3)]).force.tolist() == [
        3.0,
        3.0,
        3.0,
    ]


def test_the_mass_of_a_ground_motion_is_that_of_its_subdomain():
    # ten times the mass was ten times the response, in silence
    record = np.random.default_rng(1).normal(size=20)
    expected = pair(pm.BaseAcceleration(record, np.ones(3), np.diag(M), dt=0.1)).run(steps=20)
    close(pair(pm.BaseAcceleration(record, dt=0.1)).run(steps=20), expected)
    with pytest.raises(
        ValueError, match="must be the mass matrix of the subdomain, or be left out"
    ):
        pair(pm.BaseAcceleration(record, np.ones(3), 10.0 * M, dt=0.1))
    coupler = pair(None)
    with pytest.raises(ValueError, match="must be the mass matrix of the subdomain"):
        coupler.reset(force={"a": pm.BaseAcceleration(record, np.ones(3), 10.0 * M, dt=0.1)})
