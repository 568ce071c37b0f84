"""Springs of the core: laws, loops, histories, coupled runs, and errors."""

import numpy as np
import pytest
from agreement import assert_identical
from scipy.integrate import solve_ivp
from test_restoring import three_subdomains

import pmalpha as pm
from pmalpha import analysis
from pmalpha.models import el_centro

CD = pm.CentralDifference()
IMPLICIT = pm.GeneralizedAlpha(0.6)
EXPLICIT = pm.GeneralizedAlpha(0.6, explicit=True)


def driven(spring, path, dt=1e-3):
    """Deformation and force of a spring whose dof follows a path by prescribed motion."""
    velocity = pm.SampledForce(np.append(np.diff(path), 0.0)[:, None] / dt, dt)
    subdomain = pm.Subdomain(
        [1.0], None, scheme=CD, restoring=spring, v0=[velocity(0.0)[0]], name="s"
    )
    constraint = pm.Constraint({subdomain: [[1.0]]}, velocity=velocity)
    coupler = pm.Coupler([subdomain], constraint, dt=dt)
    history = coupler.run(steps=len(path) - 1, record_springs={"s": None})["s"]
    return history.deformation[:, 0], history.force[:, 0]


# ---- loops against independent integration ---------------------------------------------------


def rested(z, s, length, n, beta, gamma):
    """z after a path of this length in direction s, by DOP853 at a tight tolerance."""

    def slope(x, z):
        return s * (1.0 - np.abs(z) ** n * (gamma + beta * np.sign(s * z)))

    return solve_ivp(slope, (0.0, length), [z], method="DOP853", rtol=1e-12, atol=1e-13).y[0, -1]


def bouc_wen_truth(d, k, fy, hardening, n, beta, gamma):
    """Forces along a path of straight pieces."""
    z, forces = 0.0, []
    for a, b in zip(np.append(0.0, d[:-1]), d):
        length = abs(b - a) * k / fy
        if length > 0.0:
            z = rested(z, np.sign(b - a), length, n, beta, gamma)
        forces.append(hardening * k * b + (1.0 - hardening) * fy * z)
    return np.array(forces)


@pytest.mark.parametrize(
    "law",
    [
        dict(hardening=0.1, n=1.0, beta=0.5, gamma=0.5),
        dict(hardening=0.0, n=2.0, beta=0.6, gamma=-0.2),
        dict(hardening=0.3, n=3.5, beta=0.1, gamma=0.9),
        dict(hardening=0.1, n=1.3, beta=2.0, gamma=0.5),
    ],
)
def test_bouc_wen_loops_agree_with_an_independent_integration(law):
    spring = pm.BoucWen([0], k=50.0, fy=2.0, **law)
    t = np.linspace(0.0, 6.0 * np.pi, 601)
    d, f = driven(spring, 0.02 * t * np.sin(t))
    assert np.ptp(d) > 10 * 2.0 / 50.0  # deep into the loops
    # Runge-Kutta of order 4 in steps of half a natural length at most, mostly of a tenth of that;
    # below n = 2 the slope has a kink at z = 0, which costs more
    tolerance = 1e-3 if law["n"] < 2.0 else 1e-4
    np.testing.assert_allclose(f, bouc_wen_truth(d, 50.0, 2.0, **law), atol=tolerance)


def test_a_jump_of_many_yield_deformations_ends_at_the_limit_of_bouc_wen():
    for n, beta, gamma in ((1.0, 0.5, 0.5), (2.0, 0.3, 0.4), (5.0, 1.0, -0.5)):
        spring = pm.BoucWen([0], k=10.0, fy=1.0, n=n, beta=beta, gamma=gamma)
        subdomain = pm.Subdomain([1.0], None, scheme=CD, restoring=spring, u0=[-1e7], name="s")
        limit = (beta + gamma) ** (-1.0 / n)
        force = pm.Coupler([subdomain], dt=0.001).springs("s").force
        assert force[0] == pytest.approx(-limit, rel=1e-12)


def bilinear_truth(d, k, fy, hardening):
    """The elastic deformation as a clipped sum of increments, without the plastic deformation."""
    e, forces = 0.0, []
    for a, b in zip(np.append(0.0, d[:-1]), d):
        e = np.clip(e + (b - a), -fy / k, fy / k)
        forces.append(hardening * k * b + (1.0 - hardening) * k * e)
    return np.array(forces)


@pytest.mark.parametrize("hardening", [0.0, 0.1, 1.0])
def test_bilinear_loops_agree_with_an_independent_integration(hardening):
    t = np.linspace(0.0, 6.0 * np.pi, 301)
    d, f = driven(pm.Bilinear([0], 50.0, 2.0, hardening), 0.02 * t * np.sin(t))
    # rounding of sums of 300 increments
    np.testing.assert_allclose(f, bilinear_truth(d, 50.0, 2.0, hardening), atol=1e-12)


def test_the_area_of_a_bilinear_loop_is_the_closed_form():
    t = np.arange(0, 4 * 400 + 1) * (2.0 * np.pi / 400)
    d, f = driven(pm.Bilinear([0], k=50.0, fy=2.0, hardening=0.1), 0.2 * np.sin(t))
    one = slice(800, 1201)  # the third cycle
    area = np.sum(np.diff(d[one]) * (f[one][1:] + f[one][:-1]) / 2.0)
    top = np.ptp(d[one]) / 2.0
    # parallelogram: 4 (1 - alpha) fy (d_max - d_y)
    assert area == pytest.approx(4 * 0.9 * 2.0 * (top - 0.04), rel=1e-3)  # corners cut by steps


def test_a_sharp_bouc_wen_loop_tends_to_the_bilinear_one():
    t = np.linspace(0.0, 4.0 * np.pi, 801)
    path = 0.2 * np.sin(t)
    _, sharp = driven(pm.BoucWen([0], 50.0, 2.0, 0.1, n=50.0, beta=0.5, gamma=0.5), path)
    _, bilinear = driven(pm.Bilinear([0], 50.0, 2.0, 0.1), path)
    # a corner of width d_y / n
    assert np.abs(sharp - bilinear).max() < 2.0 * 0.03


# ---- in motion -------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", [IMPLICIT, EXPLICIT, pm.Newmark(), CD], ids=repr)
def test_a_cubic_spring_equals_its_python_counterpart(scheme):
    common = dict(scheme=scheme, u0=[1.0, -0.5], v0=[0.5, 0.0])
    spring = pm.CubicSpring([0, 1], k=[1.0, 2.0], k3=[1.0, 0.5])
    python = pm.Subdomain(
        [1.0, 1.5],
        None,
        restoring=lambda t, u, v: u * (np.array([1.0, 2.0]) + np.array([1.0, 0.5]) * u * u),
        restoring_stiffness=[1.0, 2.0],
        **common,
    )
    ours = pm.Subdomain([1.0, 1.5], None, restoring=spring, **common)
    np.testing.assert_array_equal(
        pm.solve(ours, dt=0.05, t_end=5.0).u, pm.solve(python, dt=0.05, t_end=5.0).u
    )


def bouc_wen_motion(times, k=20.0, fy=0.5, hardening=0.1):
    """u of a mass on a Bouc-Wen spring (n = 2) under a load, by DOP853."""

    def slope(s, x):
        u, v, z = x
        dz = (k / fy) * (v - 0.5 * np.abs(v) * np.abs(z) * z - 0.5 * v * z * z)
        return [v, 2.0 * np.sin(3.0 * s) - hardening * k * u - (1.0 - hardening) * fy * z, dz]

    options = dict(method="DOP853", rtol=1e-11, atol=1e-13, t_eval=times)
    return solve_ivp(slope, (0.0, times[-1]), [0.0] * 3, **options).y[0]


@pytest.mark.parametrize("scheme", [IMPLICIT, EXPLICIT, pm.Newmark(), CD], ids=repr)
def test_a_mass_on_a_bouc_wen_spring_converges_with_order_two(scheme):
    spring = pm.BoucWen([0], k=20.0, fy=0.5, hardening=0.1, n=2.0)
    subdomain = pm.Subdomain(
        [1.0], None, scheme=scheme, restoring=spring, force=lambda t: [2.0 * np.sin(3.0 * t)]
    )
    exact = bouc_wen_motion(np.linspace(0.0, 4.0, 41))

    def error(dt):
        return np.abs(pm.solve(subdomain, dt=dt, t_end=4.0).u[:: round(0.1 / dt), 0] - exact).max()

    # 0.3: reversals fall into steps differently at each refinement
    assert np.log2(error(0.02) / error(0.005)) / 2.0 == pytest.approx(2.0, abs=0.3)


def test_a_mass_that_hits_a_stop_leaves_it_with_the_closed_form():
    # half a period in contact: it leaves with its velocity, at t = 0.1 + pi / 20 + ...
    stop = pm.Gap([0], k=400.0, gap=0.1)
    ball = pm.Subdomain([1.0], None, scheme=CD, restoring=stop, v0=[1.0])
    history = pm.solve(ball, dt=1e-4, t_end=0.4)
    t = history.t
    contact = np.pi / 20.0
    free = np.where(t <= 0.1, t, np.where(t >= 0.1 + contact, 0.1 - (t - 0.1 - contact), np.nan))
    inside = 0.1 + np.sin(20.0 * (t - 0.1)) / 20.0
    exact = np.where(np.isnan(free), inside, free)
    # the force has a kink where contact begins and ends: O(h) there, once; h = 1e-4
    assert np.abs(history.u[:, 0] - exact).max() < 1e-5
    both = pm.Gap([(0, -1), (-1, 0)], k=400.0, gap=0.1)
    ball = pm.Subdomain([1.0], None, scheme=CD, restoring=both, v0=[1.0])
    u = pm.solve(ball, dt=1e-4, t_end=2.0).u[:, 0]
    assert u.max() == pytest.approx(0.15, abs=1e-4) and u.min() == pytest.approx(-0.15, abs=1e-4)


def isolated_frame():
    """A two-storey frame on an isolator: M, K, C and the quake; dof 0 is the base."""
    record, step = el_centro()
    M = np.array([4.0, 2.0, 2.0])
    K = 800.0 * np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    C = 0.002 * K
    return M, K, C, record, step


@pytest.mark.parametrize("dofs", [[0], [(0, 1)], ["a"], [("b", "a")]])
def test_a_stop_of_the_negative_sign_is_that_with_its_dofs_exchanged(dofs):
    options = dict(scheme=pm.CentralDifference(), v0=[-1.0, 0.3], dof_names=["a", "b"])
    below = pm.Gap(dofs, k=400.0, gap=0.1, sign=-1)
    pairs = [(-1, 0)] if dofs in ([0], ["a"]) else [(1, 0)] if dofs == [(0, 1)] else [(0, 1)]
    exchanged = pm.Gap(pairs, k=400.0, gap=0.1)
    runs = [
        pm.solve(pm.Subdomain([1.0, 1.0], [1.0, 1.0], restoring=x, **options), dt=0.001, t_end=2.0)
        for x in (below, exchanged)
    ]
    assert np.array_equal(runs[0].u, runs[1].u)
    free = pm.Subdomain([1.0, 1.0], [1.0, 1.0], **options)
    free_run = pm.solve(free, dt=0.001, t_end=2.0)
    reached = dofs != [("b", "a")]  # u_a - u_b stays negative, so its stop is not
    assert np.array_equal(runs[0].u, free_run.u) != reached


def test_an_isolated_frame_under_el_centro_coupled_and_uncut():
    M, K, C, record, step = isolated_frame()
    dt = 0.0025
    isolator = dict(k=400.0, fy=4.0, hardening=0.1, n=2.0)
    uncut = pm.Subdomain(
        M,
        K,
        C=C,
        scheme=IMPLICIT,
        restoring=pm.BoucWen([0], **isolator),
        force=pm.BaseAcceleration(record, np.ones(3), M, dt=step),
    )
    whole = pm.solve(uncut, dt=dt, t_end=20.0, record_springs={0: None})
    half = M.copy()
    half[0] = 2.0
    frame = pm.Subdomain(
        half,
        K,
        C=C,
        scheme=IMPLICIT,
        force=pm.BaseAcceleration(record, np.ones(3), half, dt=step),
        name="frame",
    )
    rig = pm.Subdomain(
        [2.0],
        None,
        scheme=EXPLICIT,
        restoring=pm.BoucWen([0], **isolator),
        force=pm.BaseAcceleration(record, [1.0], [2.0], dt=step),
        name="rig",
    )
    coupler = pm.Coupler([frame, rig], pm.tie(frame, [0], rig, [0]), dt=dt, coupling="pm")
    history = coupler.run(20.0, record_springs={"rig": None})
    scale = np.abs(whole.u).max()
    assert np.abs(whole.deformation).max() > 3 * 4.0 / 400.0  # it yields
    # both are of order two; a hundredth at a three hundredth of the shortest period
    assert np.abs(history["frame"].u - whole.u).max() < 0.01 * scale
    force = np.abs(whole.force).max()
    assert np.abs(history["rig"].force - whole.force).max() < 0.03 * force


# ---- histories -------------------------------------------------------------------------------


def springs_of_all_laws():
    return [
        pm.CubicSpring([(0, 1)], 3.0, 1.0),
        pm.Gap([(1, -1)], 30.0, 0.05),
        pm.Bilinear([(0, -1), (1, 0)], 8.0, [0.3, 0.2], 0.1),
        pm.BoucWen([1], 8.0, 0.4, 0.1, n=1.5),
    ]


def coupled(substeps=(1, 4, 2), doubles=(True, False, True), threads=1, coupling="pm"):
    springs = [springs_of_all_laws() for _ in range(3)]
    return three_subdomains(springs, substeps, doubles, coupling, threads, 0.05, v0=[1.5, 1.5])


def all_springs(coupler):
    return np.concatenate([coupler.springs(name).force for name in "ABC"])


ALL = {"A": None, "B": None, "C": None}


@pytest.mark.parametrize("coupling", ["pm", "gc"])
def test_each_chain_of_a_double_step_subdomain_has_its_own_history(coupling):
    """The same springs written in Python, with a history per chain: equal to rounding."""
    coupler = coupled(coupling=coupling)
    ours = coupler.run(steps=40, record_springs=ALL)
    for name, ss, double in zip("ABC", (1, 4, 2), (True, False, True)):
        d, f = ours[name].deformation, ours[name].force
        for j in (2, 3):  # the bilinear ones
            fy = (0.3, 0.2)[j - 2]
            e, expected = [], []
            for n in range(len(d)):
                back = 2 if double and coupling == "pm" and n > ss else 1
                d0, e0 = (d[n - back, j], e[n - back]) if n else (0.0, 0.0)
                e.append(np.clip(e0 + d[n, j] - d0, -fy / 8.0, fy / 8.0))
                expected.append(0.1 * 8.0 * d[n, j] + 0.9 * 8.0 * e[n])
            assert np.abs(e).max() == fy / 8.0  # it yields
            np.testing.assert_allclose(f[:, j], expected, atol=1e-13)


def test_an_aborted_macro_step_leaves_no_trace_in_a_history():
    def counted(t, u, v):  # in the middle of a macro step, when springs have moved
        if 1.01 < t < 1.04 and fails.pop(0):
            raise ArithmeticError
        return 0.0 * u

    def with_a_fourth():
        subdomains = [s for _, s in coupled()._session.keys]
        fourth = pm.Subdomain(
            [1.0], [1.0], scheme=EXPLICIT, substeps=4, restoring=counted, v0=[1.5]
        )
        ties = [
            pm.tie(subdomains[0], [1], subdomains[1], [1]),
            pm.tie(subdomains[1], [0], subdomains[2], [0]),
            pm.tie(subdomains[2], [0], fourth, [0]),
        ]
        return pm.Coupler([*subdomains, fourth], ties, dt=0.05, coupling="pm")

    expected, interrupted = with_a_fourth(), with_a_fourth()
    fails = [False] * 9
    expected.step(40)
    fails = [False, True] + [False] * 9
    with pytest.raises(ArithmeticError):
        interrupted.step(40)
    assert interrupted.step_count == 20
    interrupted.step(20)
    np.testing.assert_array_equal(all_springs(interrupted), all_springs(expected))


def test_a_saved_history_resumes_bitwise_identically(tmp_path):
    coupler = coupled()
    coupler.step(17)
    coupler.save(tmp_path / "state")
    again = coupled()
    again.load(tmp_path / "state")
    np.testing.assert_array_equal(all_springs(again), all_springs(coupler))
    for c in (coupler, again):
        c.step(20)
    np.testing.assert_array_equal(all_springs(again), all_springs(coupler))
    subdomains = [
        pm.Subdomain([1.0], None, scheme=CD, restoring=pm.Bilinear([0], 1.0, fy)) for fy in (1, 2)
    ]
    pm.Coupler([subdomains[0]], dt=0.1).save(tmp_path / "other")
    with pytest.raises(ValueError, match="restoring of 'subdomain 0' .<Bilinear x 1>"):
        pm.Coupler([subdomains[1]], dt=0.1).load(tmp_path / "other")


# ---- results, tangent, critical step, energy --------------------------------------------------


def test_force_and_deformation_are_those_of_the_last_time_level():
    coupler = coupled()
    history = coupler.run(steps=10, record_springs={"A": None, "B": [4, 0]})
    assert history["A"].force.shape == (11, 5) and history["B"].deformation.shape == (41, 2)
    np.testing.assert_array_equal(history["B"].springs, [4, 0])
    assert history["C"].force is None
    np.testing.assert_array_equal(coupler.springs("B").force[[4, 0]], history["B"].force[-1])
    np.testing.assert_array_equal(coupler.springs("A").deformation, history["A"].deformation[-1])
    u = history["B"].u
    # deformations are at the predictors: O(h^2) of accelerations of some units, h = 0.0125
    assert np.abs(history["B"].deformation[:, 0] - u[:, 1]).max() < 2e-3
    every = coupler.run(steps=6, every=3, record_springs={"B": [0]})
    assert every["B"].force.shape == every["B"].u[:, :1].shape


def test_loops_go_to_an_hdf5_file_while_running(tmp_path):
    pytest.importorskip("h5py")
    expected = coupled().run(steps=30, record_springs={"B": [1, 2]})
    history = coupled().run(steps=30, record_springs={"B": [1, 2]}, record_to=tmp_path / "run.h5")
    np.testing.assert_array_equal(history["B"].force, expected["B"].force)
    np.testing.assert_array_equal(history["B"].deformation, expected["B"].deformation)
    np.testing.assert_array_equal(history["B"].springs, [1, 2])


@pytest.mark.parametrize("ending", [".npz", ".h5"])
def test_loops_of_a_saved_history_are_bitwise_those_before(tmp_path, ending):
    if ending == ".h5":
        pytest.importorskip("h5py")
    before = coupled().run(steps=10, record_springs={"A": None, "B": [4, 0]})
    before.save(tmp_path / f"run{ending}")
    after = pm.History.load(tmp_path / f"run{ending}")
    assert_identical(after, before)
    assert after["C"].force is None and after["C"].springs is None
    np.testing.assert_array_equal(after["B"].springs, [4, 0])
    assert np.ptp(after["A"].force[:, 0]) > 0.0


def test_the_initial_tangent_is_the_estimate_and_another_is_refused():
    springs = [
        pm.Bilinear([(0, 1)], 3.0, 1.0),
        pm.Gap([0], 100.0, 0.1),
        pm.CubicSpring([1], 2.0, 9),
    ]
    subdomain = pm.Subdomain([1.0, 1.0], [1.0, 1.0], scheme=IMPLICIT, restoring=springs)
    expected = [[3.0, -3.0], [-3.0, 5.0]]
    np.testing.assert_array_equal(subdomain.restoring_stiffness.toarray(), expected)
    with pytest.raises(ValueError, match="restoring_stiffness must be the initial tangents"):
        pm.Subdomain(
            [1.0, 1.0], None, scheme=IMPLICIT, restoring=springs, restoring_stiffness=[7.0, 0.0]
        )


def test_a_stop_that_is_not_reached_leaves_the_motion_alone():
    """An estimate of its k would act on the open stop too, as a mass of h^2 k / 4 = 2.5 here."""
    options = dict(scheme=pm.Newmark(), v0=[1.0], name="mass")
    free = pm.Subdomain([1.0], [100.0], **options)
    stopped = pm.Subdomain([1.0], [100.0], restoring=pm.Gap([0], 1e5, 0.2), **options)
    with pytest.warns(pm.StabilityWarning, match="when contact is closed"):
        u = pm.solve(stopped, dt=0.01, t_end=2.0).u
    assert np.abs(u).max() < 0.2  # v0 / omega = 0.1
    np.testing.assert_allclose(u, pm.solve(free, dt=0.01, t_end=2.0).u, atol=1e-14)


def test_the_critical_step_includes_springs_at_their_stiffest():
    def critical(spring):
        subdomain = pm.Subdomain([1.0], [4.0], scheme=CD, restoring=spring)
        return analysis.critical_step(subdomain)

    assert critical(pm.Gap([0], 96.0, 0.1)) == pytest.approx(0.2, rel=1e-11)
    assert critical(pm.Bilinear([0], 96.0, 0.1)) == pytest.approx(0.2, rel=1e-11)
    steep = pm.BoucWen([0], 48.0, 0.1, beta=1.0, gamma=0.0)  # unloads twice as steeply
    assert critical(steep) == pytest.approx(0.2, rel=1e-11)


def test_a_stiff_bilinear_spring_in_an_implicit_subdomain_is_stable_at_any_step():
    subdomain = pm.Subdomain(
        [1.0], None, scheme=IMPLICIT, restoring=pm.Bilinear([0], 1e6, 1e4), v0=[1.0]
    )
    assert np.abs(pm.solve(subdomain, dt=0.1, t_end=5.0).u).max() < 1.0


def test_many_springs_are_as_good_as_a_few():
    """More springs of all laws than a chunk of the core, compared with one at a time."""
    rng = np.random.default_rng(5)
    m, n = 700, 40
    dofs = np.array([rng.choice(n, 2, replace=False) for _ in range(m)])
    dofs[::7, 1] = -1
    k, fy = rng.uniform(1.0, 2.0, m), rng.uniform(0.01, 0.1, m)
    many = [pm.Bilinear(dofs, k, fy, 0.1), pm.BoucWen(dofs, k, fy, 0.1, n=2.0)]
    few = [
        cls(dofs[i], k[i], fy[i], 0.1, *more)
        for cls, *more in ((pm.Bilinear,), (pm.BoucWen, 2))
        for i in (slice(0, 1), slice(1, 300), slice(300, m))
    ]
    runs = [
        pm.solve(
            pm.Subdomain(np.ones(n), None, scheme=CD, restoring=springs, v0=rng.normal(size=n)),
            dt=0.01,
            t_end=0.5,
            record_springs={0: None},
        )
        for springs, rng in ((many, np.random.default_rng(1)), (few, np.random.default_rng(1)))
    ]
    np.testing.assert_array_equal(runs[0].force, runs[1].force)
    np.testing.assert_array_equal(runs[0].u, runs[1].u)


def test_the_energy_of_springs_is_strain_and_what_they_lose_is_dissipated():
    spring = pm.Bilinear([0], k=50.0, fy=1.0, hardening=0.2)
    subdomain = pm.Subdomain([1.0], None, scheme=CD, restoring=spring, v0=[1.0], name="s")

    def run(dt):
        coupler = pm.Coupler([subdomain], dt=dt)
        return coupler.run(2.0, energy=True, record_springs={"s": None})

    history = run(0.002)
    d, f = history["s"].deformation[:, 0], history["s"].force[:, 0]
    e = (f - 10.0 * d) / 40.0  # elastic deformation
    stored = 0.5 * (10.0 * d**2 + 40.0 * e**2)
    np.testing.assert_allclose(history.energy.strain[:, 0], stored, atol=1e-12)
    work = np.append(0.0, np.cumsum(np.diff(d) * (f[1:] + f[:-1]) / 2.0))
    np.testing.assert_allclose(history.energy.dissipated[:, 0], work - stored, atol=1e-12)
    assert history.energy.dissipated[-1, 0] > 0.3  # of 0.5 at the start
    # d is that of the predictor: at the distance of O(h^2) from u, and so is the balance
    coarse, fine = (np.abs(run(dt).energy.balance).max() for dt in (0.004, 0.002))
    assert fine < 1e-3 and coarse / fine > 3.0


def test_each_chain_sums_up_what_its_springs_dissipate():
    coupler = coupled()
    coupler.step(10)
    history = coupler.run(steps=60, energy=True)
    assert np.all(history.energy.dissipated[-1] > 0.0)
    scale = np.abs(history.energy.kinetic).max()
    # 0.1: the double steps of A and C are 0.1 and 0.05 at periods from 1.2 on
    assert np.abs(history.energy.balance).max() < 0.1 * scale


@pytest.mark.parametrize("begin", [0, 1, 5])
def test_what_springs_dissipate_is_summed_up_from_where_the_energy_begins(begin):
    """(H5) and (B3) from recorded loops: the first step counts as a single one from the present."""
    k, hardening, fy = 8.0, 0.1, 0.3
    springs = pm.Bilinear([0, 1], k, fy, hardening)
    parts = [
        pm.Subdomain(
            [1.0, 2.0],
            np.array([[3.0, -1.0], [-1.0, 1.0]]),
            scheme=scheme,
            substeps=substeps,
            restoring=springs if name == "A" else None,
            v0=[1.5, 1.5],
            name=name,
        )
        for scheme, substeps, name in ((IMPLICIT, 1, "A"), (EXPLICIT, 4, "B"))
    ]
    coupler = pm.Coupler(parts, pm.tie(parts[0], [1], parts[1], [1]), dt=0.05, coupling="pm")
    coupler.step(begin)
    history = coupler.run(steps=40, energy=True, record_springs={"A": None})
    d, f = history["A"].deformation, history["A"].force
    hard, soft = hardening * k, (1.0 - hardening) * k
    stored = 0.5 * (hard * d**2 + (f - hard * d) ** 2 / soft)
    expected = np.zeros(len(d))
    for n in range(1, len(d)):
        # in the first macro step of a run all steps are single; so is what is counted first
        back = n - 1 if n == 1 or begin + n == 1 else n - 2
        work = 0.5 * (d[n] - d[back]) * (f[n] + f[back]) - (stored[n] - stored[back])
        expected[n] = expected[back] + work.sum()
    assert expected[-1] > 0.1  # they yield
    # 40 sums of numbers below 10
    np.testing.assert_allclose(history.energy.dissipated[:, 0], expected, atol=1e-13)


# ---- bad input -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "make, error, text",
    [
        (lambda: pm.CubicSpring([0], -1.0, 0.0), ValueError, "k must not be negative, got -1"),
        (lambda: pm.CubicSpring([0, 1], [1.0, -2.0], 0.0), ValueError, "got -2 at spring 1"),
        (lambda: pm.Gap([0], -1.0, 0.0), ValueError, "k must not be negative"),
        (lambda: pm.Gap([0], 1.0, -0.1), ValueError, "gap must not be negative"),
        (lambda: pm.Gap([0], 1.0, 0.1, sign=2), ValueError, "sign must be 1 or -1, got 2"),
        (lambda: pm.Gap([0], 1.0, 0.1, sign=[1, -1]), ValueError, "sign must be a number or of"),
        (lambda: pm.Bilinear([0], 0.0, 1.0), ValueError, "k must be positive"),
        (lambda: pm.Bilinear([0], 1.0, 0.0), ValueError, "fy must be positive"),
        (lambda: pm.Bilinear([0], 1.0, 1.0, 1.5), ValueError, r"hardening must lie in \[0, 1\]"),
        (lambda: pm.BoucWen([0], 1.0, 1.0, n=0.5), ValueError, "n must be at least 1"),
        (lambda: pm.BoucWen([0], 1.0, 1.0, beta=-1.0), ValueError, "beta must not be negative"),
        (lambda: pm.BoucWen([0], 1.0, 1.0, gamma=-0.5), ValueError, "gamma must be above -beta"),
        (lambda: pm.Gap([0], np.nan, 0.0), ValueError, "k must be finite, got nan$"),
        (lambda: pm.Gap([0.0], 1.0, 0.0), TypeError, "dofs must be whole numbers"),
        (lambda: pm.Gap([True], 1.0, 0.0), TypeError, "dofs must be whole numbers"),
        (lambda: pm.Gap([], 1.0, 0.0), ValueError, "shape .m,. or .m, 2., m > 0, got .0,."),
        (lambda: pm.Gap(np.zeros((2, 3), int), 1.0, 0.0), ValueError, "dofs must be of shape"),
        (lambda: pm.Gap([(-2, 0)], 1.0, 0.0), ValueError, "dofs must not be below -1"),
        (lambda: pm.Gap([(0, 1), (2, 2)], 1.0, 0.0), ValueError, "the same at springs 1"),
        (lambda: pm.Gap([(-1, -1)], 1.0, 0.0), ValueError, "the same at springs 0"),
        (lambda: pm.Gap([0, 1], [1.0] * 3, 0.0), ValueError, r"of shape \(2,\), got \(3,\)"),
        (lambda: pm.Gap([0], "soft", 0.0), TypeError, "k must hold real numbers"),
    ],
)
def test_bad_springs_are_errors_that_name_the_argument(make, error, text):
    with pytest.raises(error, match=text):
        make()


def test_springs_that_do_not_fit_a_subdomain_are_errors():
    spring = pm.Gap([(0, 3)], 1.0, 0.0)
    with pytest.raises(ValueError, match="dofs of a Gap must lie in 0..2, got 3"):
        pm.Subdomain(np.ones(3), None, scheme=CD, restoring=spring)
    for bad, text in (
        ([spring, 1.0], r"restoring\[1\] must be a spring or callable, got 1.0"),
        ([[spring]], r"restoring\[0\] must be a spring or callable, got \[<Gap"),
    ):
        with pytest.raises(TypeError, match=text):
            pm.Subdomain(np.ones(4), None, scheme=CD, restoring=bad)


def test_springs_that_cannot_be_recorded_are_errors():
    coupler = coupled()
    for bad, text in (({"A": [5]}, r"record_springs\['A'\]"), ({"nobody": None}, "record_springs")):
        with pytest.raises(ValueError, match=text):
            coupler.run(steps=1, record_springs=bad)
    with pytest.raises(ValueError, match="a subdomain with recorded dofs"):
        coupler.run(steps=1, record={"A": None}, record_springs={"B": None})
    linear = pm.Coupler([pm.Subdomain([1.0], [1.0], scheme=CD)], dt=0.1)
    with pytest.raises(ValueError, match="a subdomain with springs"):
        linear.run(steps=1, record_springs={0: None})
    with pytest.raises(ValueError, match="needs linear subdomains"):
        analysis.amplification_matrix(coupler)
