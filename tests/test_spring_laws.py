"""Springs of several inner variables: multilinear and Ramberg-Osgood."""

import numpy as np
import pytest

import pmalpha as pm

BACKBONE = [(0.01, 1.0), (0.03, 2.0), (0.08, 2.5), (0.2, 2.8)]
LAWS = {
    "multilinear": lambda dofs: pm.Multilinear(dofs, BACKBONE),
    "elastic": lambda dofs: pm.Multilinear(dofs, BACKBONE, rule="elastic"),
    "Ramberg-Osgood": lambda dofs: pm.RambergOsgood(dofs, k=100.0, fy=2.0, n=5.0),
}
DT = 0.002


def load(scale=1.0):
    t = DT * np.arange(500)
    return pm.SampledForce(scale * np.outer(np.sin(9.0 * t) * t * 8.0, [1.0, 0.5]), DT)


def frame(springs, where="internal", **more):
    scheme = pm.Newmark() if where == "internal" else pm.CentralDifference()
    return pm.Subdomain(
        [1.0, 1.0],
        np.array([[8.0, -4.0], [-4.0, 4.0]]),
        scheme=scheme,
        force=load(),
        name="frame",
        **{where: springs},
        **more,
    )


def coupled(springs, where="internal", coupling="gc"):
    mass = pm.Subdomain([0.5], [3.0], scheme=pm.CentralDifference(), substeps=2, name="mass")
    ours = frame(springs, where)
    return pm.Coupler([ours, mass], pm.tie(ours, [1], mass, [0]), dt=DT, coupling=coupling)


@pytest.mark.parametrize("where", ["internal", "restoring"])
def test_a_multilinear_spring_is_bilinear_springs_in_parallel(where):
    """Elements with the differences of the slopes 100, 50, 10, 2.5 that yield at the points."""
    yields = [(50.0, 0.01), (40.0, 0.03), (7.5, 0.08)]
    parallel = [pm.Bilinear([0], k=k, fy=k * d, hardening=0.0) for k, d in yields]
    parallel.append(pm.CubicSpring([0], k=2.5, k3=0.0))
    ours = pm.solve(frame(pm.Multilinear([0], BACKBONE), where), dt=DT, steps=500)
    theirs = pm.solve(frame(parallel, where), dt=DT, steps=500)
    assert abs(ours.u[:, 0]).max() > 0.1
    # sums in another order, 500 steps of some roundings
    np.testing.assert_allclose(ours.u, theirs.u, rtol=0, atol=1e-12)


@pytest.mark.parametrize("where", ["internal", "restoring"])
def test_ramberg_osgood_is_the_limit_of_a_multilinear_spring(where):
    """Both follow Masing's rules; chords between 32 points of the curve miss it by 0.4 per cent."""
    f = np.append(np.linspace(0.0, 6.0, 32)[1:], 12.0)
    points = np.column_stack([f / 100.0 * (1.0 + (f / 2.0) ** 4), f])
    ours = pm.solve(frame(LAWS["Ramberg-Osgood"]([0]), where), dt=DT, steps=500)
    theirs = pm.solve(frame(pm.Multilinear([0], points), where), dt=DT, steps=500)
    assert abs(ours.u[:, 0]).max() > 0.1
    np.testing.assert_allclose(ours.u, theirs.u, rtol=0, atol=0.01 * abs(ours.u).max())


@pytest.mark.parametrize("law", LAWS)
def test_loops_of_small_and_large_swings_lose_energy_and_never_make_any(law):
    history = coupled(LAWS[law]([0])).run(steps=500, energy=True)
    lost = history.energy.dissipated[:, 0]
    # the trapezoidal rule of the work on a path with corners: second order in steps of 1e-3
    assert np.all(np.diff(lost) > -1e-3)
    assert (lost[-1] < 0.02) if law == "elastic" else (lost[-1] > 0.1)
    assert abs(history.energy.balance).max() < 1e-2 * history.energy.kinetic.max()


@pytest.mark.parametrize("where", ["internal", "restoring"])
@pytest.mark.parametrize("law", LAWS)
def test_a_saved_run_goes_on_with_what_its_springs_remember(law, where, tmp_path):
    springs = [LAWS[law]([0]), pm.Bilinear([(0, 1)], k=20.0, fy=0.3)]
    whole, other = coupled(springs, where), coupled(springs, where)
    whole.step(300)
    whole.save(tmp_path / "state")
    other.load(tmp_path / "state")
    for c in (whole, other):
        c.step(100)
    assert whole.state("frame").u.tobytes() == other.state("frame").u.tobytes()
    assert whole.springs("frame").force.tobytes() == other.springs("frame").force.tobytes()


@pytest.mark.parametrize("law", LAWS)
def test_cases_side_by_side_are_single_runs(law):
    c = coupled([LAWS[law]([0]), pm.CubicSpring([1], k=1.0, k3=1.0)], "restoring")
    cases = [{"force": {"frame": load(0.3 * i)}} for i in range(3)]
    together = c.run_each(cases, steps=300)
    for case, ours in zip(cases, together):
        c.reset(**case)
        alone = c.run(steps=300)
        np.testing.assert_allclose(ours["frame"].u, alone["frame"].u, rtol=0, atol=1e-13)


def test_numbers_of_points_tell_springs_apart():
    a, b = pm.Multilinear([0], BACKBONE), pm.Multilinear([0], BACKBONE, rule="elastic")
    assert not np.array_equal(a.numbers, b.numbers)
    assert a._moved(np.array([[1, -1]])).points.tolist() == a.points.tolist()


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: pm.Multilinear([0], BACKBONE, rule="x"), "rule must be 'kinematic' or 'elastic'"),
        (lambda: pm.Multilinear([0], [1.0, 2.0]), "points must be a 2-D array"),
        (lambda: pm.Multilinear([0], np.ones((40, 2))), r"p in 1..32, got \(40, 2\)"),
        (lambda: pm.Multilinear([0], [(1.0, 1.0), (1.0, 2.0)]), "deformations that increase"),
        (lambda: pm.Multilinear([0], [(1.0, 1.0), (2.0, 0.5)]), "forces that increase"),
        (lambda: pm.Multilinear([0], [(1.0, 1.0), (2.0, 3.0)]), "got 2 after 1 at point 1"),
        (lambda: pm.RambergOsgood([0], 1.0, 1.0, 0.5), r"n must lie in \[1, 1000\], got 0.5"),
        (lambda: pm.RambergOsgood([0], 1.0, 1.0, 5, alpha=0), "alpha must be positive"),
        (lambda: pm.RambergOsgood([0], -1.0, 1.0, 5), "k must be positive, got -1 at spring 0"),
    ],
)
def test_bad_arguments_are_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()
