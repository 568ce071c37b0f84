"""The scheme of Bathe and Noh: two stages to a step, tied at both, under "gc"."""

import warnings

import numpy as np
import pytest
from c_models import Library
from scipy.linalg import block_diag

import pmalpha as pm
from pmalpha import analysis

GAMMA = 2.0 - np.sqrt(2.0)


def matrices(n, rng):
    A, B, D = rng.normal(size=(3, n, n))
    return A @ A.T + n * np.eye(n), D @ D.T + np.eye(n), 0.1 * B @ B.T


def subdomains(schemes=(None, None), substeps=(2, 2), **options):
    """Three and two dofs, the first with a load."""
    rng = np.random.default_rng(0)
    made = []
    for n, name, scheme, count in zip((3, 2), "ab", schemes, substeps):
        M, K, C = matrices(n, rng)
        how = dict(scheme=pm.Bathe() if scheme is None else scheme, substeps=count, name=name)
        force = load if name == "a" else None
        v0 = np.linspace(0.5, 0.2, n)
        made.append(pm.Subdomain(M, K, C=C, force=force, v0=v0, **how, **options))
    return made


def load(t):
    return np.array([np.sin(t), 0.0, np.cos(2.0 * t)])


def coupled(dt=0.1, velocity=None, coupling="gc", threads=1, **options):
    a, b = subdomains(**options)
    b = pm.Subdomain(b.M, b.K, C=b.C, scheme=b.scheme, substeps=b.substeps, v0=[0.5, 0.2], name="b")
    rows = pm.Constraint({a: [[1.0, 0.0, 0.0]], b: [[-1.0, 0.0]]}, velocity=velocity)
    return pm.Coupler([a, b], rows, dt=dt, coupling=coupling, threads=threads)


def dense(h, steps, g=lambda t: 0.0):
    """Both as one system: the stages as they are published, with a multiplier at each of them.

    Stage: w1 = c v1 + cv and v1 = c u1 + cu, with what these are of the levels before.
    """
    a, b = subdomains()
    M, K, C = (block_diag(*(getattr(s, x) for s in (a, b))) for x in "MKC")
    L, n = np.array([[1.0, 0.0, 0.0, -1.0, 0.0]]), 5

    def force(t):
        return np.append(load(t), [0.0, 0.0])

    def solved(S, right, rows):
        x = np.linalg.solve(np.block([[S, -L.T], [L, np.zeros((1, 1))]]), np.append(right, rows))
        return x[:n], x[n]

    def stage(t, c, cv, cu):
        v, lam = solved(c * M + C + K / c, force(t) - M @ cv + K @ cu / c, g(t))
        return (v - cu) / c, v, c * v + cv, lam

    u, v = np.zeros(n), np.array([0.5, 0.35, 0.2, 0.5, 0.2])
    w, _ = solved(M, force(0.0) - C @ v - K @ u, 0.0)
    rows = [(0.0, u, v, w, np.nan)]
    for step in range(steps):
        t, c = step * h, 2.0 / (GAMMA * h)
        middle = stage(t + GAMMA * h, c, -c * v - w, -c * u - v)
        c1, c2 = (1.0 - GAMMA) / (GAMMA * h), -1.0 / ((1.0 - GAMMA) * GAMMA * h)
        c3 = (2.0 - GAMMA) / ((1.0 - GAMMA) * h)
        end = stage(t + h, c3, c1 * v + c2 * middle[1], c1 * u + c2 * middle[0])
        rows += [(t + GAMMA * h, *middle), (t + h, *end)]
        u, v, w, _ = end
    return [np.array(x) for x in zip(*rows)]


def compare(history, expected, tolerance):
    t, u, v, w, lam = expected
    close = dict(rtol=0.0, atol=tolerance)
    for s in history.subdomains:
        np.testing.assert_allclose(s.t, t, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(history.multiplier_times, t, rtol=0.0, atol=1e-14)
    for x, name in zip((u, v, w), "uva"):
        np.testing.assert_allclose(np.hstack([getattr(s, name) for s in history]), x, **close)
    np.testing.assert_allclose(history.multipliers[1:, 0], lam[1:], **close)


# numbers of order 1 and systems of condition below 1e3, in 60 damped steps: 6e-14 is measured
CLOSE = 3e-13


def test_both_stages_are_those_of_a_dense_system_with_multipliers_at_both():
    history = coupled(dt=0.2, substeps=(4, 4)).run(steps=30)
    expected = dense(0.1, 60)
    compare(history, expected, CLOSE)
    assert np.abs(expected[-1][1:]).max() > 0.1


def test_a_prescribed_velocity_is_taken_at_the_ends_of_the_stages():
    def g(t):
        return 0.3 * np.sin(3.0 * t) ** 12  # whose differences at t = 0 are 0 to rounding

    history = coupled(velocity=lambda t: [g(t)]).run(steps=40)
    compare(history, dense(0.1, 40, g), CLOSE)
    # the jump of displacements is the integral of g by the trapezoidal rule over unequal stages
    assert np.abs(history.displacement_jump - history.displacement_jump[0]).max() < 1e-3


def test_it_is_of_order_2_tied_to_itself():
    def error(dt):
        u = coupled(dt=dt).run(1.6)["a"].u[-1]
        return np.abs(u - fine).max()

    fine = coupled(dt=0.0025).run(1.6)["a"].u[-1]
    # the reference has an error of 1/64 of that of the smallest step
    assert analysis.observed_order(error, [0.08, 0.04, 0.02]) == pytest.approx(2.0, abs=0.08)


def test_beside_coarser_newmark_velocities_agree_at_the_ends_of_all_stages():
    history = coupled(schemes=(None, pm.Newmark()), substeps=(4, 1)).run(steps=40)
    assert np.abs(history.velocity_jump).max() < 1e-14  # of velocities of order 1
    assert history["b"].t.tolist() == [k * 0.1 for k in range(41)]

    def error(dt):
        run = coupled(dt=dt, schemes=(None, pm.Newmark()), substeps=(4, 1)).run(1.6)
        return np.abs(run["a"].u[-1] - fine).max()

    fine = coupled(dt=0.0025, substeps=(4, 4)).run(1.6)["a"].u[-1]
    steps = [0.04, 0.02, 0.01]
    assert error(steps[-1]) < 0.02
    assert analysis.observed_order(error, steps) > 0.9  # "gc" with substeps is of order 1


def test_of_a_stiff_mode_nothing_is_left_after_40_steps():
    M, K, u0 = [1.0, 1.0], np.diag([1.0, 1e8]), [1.0, 1.0]
    left = {}
    for scheme, substeps in ((pm.Bathe(), 2), (pm.Newmark(), 1)):
        s = pm.Subdomain(M, K, scheme=scheme, substeps=substeps, u0=u0)
        left[substeps] = np.abs(pm.solve(s, dt=0.1, t_end=4.0).u[-substeps:, 1]).max()
    assert left[2] < 1e-12 and left[1] > 0.9


def test_a_step_of_an_oscillator_is_that_of_the_amplification_matrix():
    scheme, Omega, xi = pm.Bathe(), 2.5, 0.1
    G = scheme.amplification(Omega, xi)
    s = pm.Subdomain(
        [1.0], [Omega**2], C=[2.0 * xi * Omega], scheme=scheme, substeps=2, u0=[1.0], v0=[0.5]
    )
    history = pm.solve(s, dt=1.0, t_end=3.0)
    state = np.array([1.0, 0.5, history.a[0, 0], history.a[0, 0]])
    for row in history.u[2::2, 0]:
        state = G @ state
        assert row == pytest.approx(state[0], abs=1e-14)
    assert scheme.radius_at_infinity() == 0.0
    assert np.abs(np.linalg.eigvals(scheme.amplification(1e6))).max() < 1e-5
    assert max(abs(np.linalg.eigvals(scheme.amplification(x)).max()) for x in (0.1, 1, 10)) < 1.0
    elongation, damping = analysis.period_and_damping(scheme, [0.01, 0.02])
    assert elongation[1] / elongation[0] == pytest.approx(4.0, rel=1e-3)
    found = analysis.amplification_matrix(pm.Coupler([s], dt=1.0))
    np.testing.assert_allclose(
        np.sort(np.abs(np.linalg.eigvals(found))),
        np.sort(np.abs(np.linalg.eigvals(G))),
        rtol=0.0,
        atol=1e-7,  # a double eigenvalue 0, by the root of rounding
    )


def bits(history):
    return [x.tobytes() for s in history for x in (s.t, s.u, s.v, s.a)] + [
        history.multipliers.tobytes()
    ]


def test_a_run_is_bitwise_the_same_from_a_checkpoint_and_with_threads(tmp_path):
    whole = coupled().run(steps=20)
    coupler = coupled()
    coupler.run(steps=7)
    coupler.save(tmp_path / "state.npz")
    other = coupled(threads=2)
    other.load(tmp_path / "state.npz")
    rest = other.run(steps=13)
    for s, w in zip(rest.subdomains, whole.subdomains):
        assert s.t.tobytes() == w.t[14:].tobytes()
        assert s.u.tobytes() == w.u[14:].tobytes()


def test_files_have_both_stages(tmp_path):
    expected = coupled().run(steps=10)
    expected.save(tmp_path / "run.npz")
    coupled().run(steps=10, record_to=tmp_path / "run.h5")
    for name in ("run.npz", "run.h5"):
        read = pm.History.load(tmp_path / name)
        assert bits(read) == bits(expected)
        assert read.multiplier_times.tobytes() == expected.multiplier_times.tobytes()


def test_cases_side_by_side_are_the_runs_alone():
    v0 = [{"a": k * np.array([0.5, 0.3, 0.2]), "b": k * np.array([0.5, 0.2])} for k in (1, 2, 3)]
    study = coupled().run_each([{"v0": x} for x in v0], steps=10)
    for x, case in zip(v0, study):
        alone = coupled()
        alone.reset(v0=x)
        assert bits(case) == bits(alone.run(steps=10))


def with_samples():
    a, b = subdomains()
    samples = pm.SampledForce(np.random.default_rng(3).normal(size=(40, 3)), 0.05)
    a = pm.Subdomain(a.M, a.K, C=a.C, scheme=a.scheme, substeps=2, force=samples, name="a")
    b = pm.Subdomain(b.M, b.K, C=b.C, scheme=b.scheme, substeps=2, name="b")
    return pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.1, coupling="gc")


def test_a_frozen_model_takes_both_stages_bitwise(tmp_path):
    coupler, path = with_samples(), tmp_path / "model.pma"
    outputs = {f"{x}{d}": (x, "a", d) for x in "uva" for d in range(3)}
    coupler.freeze(path, outputs=outputs)
    model = Library(pm.c_library() / "libpmalpha.so").model(path)
    rows, a = model.rows(40), coupler.run(steps=20)["a"]
    assert np.array_equal(rows, np.hstack([a.u, a.v, a.a]))
    assert model.time() == a.t[-1]


REFUSED = r"needs a scheme of one stage, got Bathe\(\) of 'a'"


def restored(s):
    return pm.Subdomain(
        s.M, s.K, scheme=s.scheme, substeps=2, restoring=pm.CubicSpring([0], 1.0, 0.0), name="a"
    )


CALLS = {
    "estimate_error": lambda: coupled().estimate_error(1.0),
    "run_paced": lambda: coupled().run_paced(1.0),
    "tolerance": lambda: coupled().run(1.0, tolerance=1e-3),
    "export_fmu": lambda: with_samples().export_fmu("model.fmu", outputs={"u": ("u", "a", 0)}),
    "restoring=": lambda: pm.Coupler([restored(subdomains()[0])], dt=0.1),
}


@pytest.mark.parametrize("what", CALLS)
def test_what_was_derived_for_equal_steps_refuses_it_by_name(what):
    with pytest.raises(ValueError, match=what + " " + REFUSED):
        CALLS[what]()


FAMILY = r"needs a scheme of the generalized-alpha family, got Bathe\(\) of 'a'"


@pytest.mark.parametrize("coupling", ["pm", "macro", "mean"])
def test_other_couplings_refuse_it_by_name(coupling):
    with pytest.raises(ValueError, match=f'coupling="{coupling}" {FAMILY}'):
        coupled(coupling=coupling)


def test_energies_and_a_change_of_steps_refuse_it_by_name():
    with pytest.raises(ValueError, match=f"energy=True {FAMILY}"):
        coupled().run(1.0, energy=True)
    with pytest.raises(ValueError, match=f"a change of steps {FAMILY}"):
        coupled().change_steps(dt=0.05)
    with pytest.raises(ValueError, match="of a scheme of two stages"):
        coupled().run(1.0)["a"].local_error()


@pytest.mark.parametrize(
    ("substeps", "schemes", "reason"),
    [
        ((3, 3), (None, None), "substeps of 'a' must be even, two stages to a step"),
        ((2, 4), (None, None), "substeps of 'a' with Bathe.* must be the largest of all, 4"),
        ((2, 4), (None, pm.Newmark()), "substeps of 'a' with Bathe.* must be the largest of all"),
        ((2, 2), (None, pm.Newmark()), "substeps of 'b' must be whole steps of Bathe.* divide 1"),
        ((4, 4), (None, pm.Newmark()), "substeps of 'b' must be whole steps of Bathe.* divide 2"),
    ],
)
def test_numbers_of_substeps_that_do_not_fit_its_stages_are_refused(substeps, schemes, reason):
    with pytest.raises(ValueError, match=reason):
        coupled(substeps=substeps, schemes=schemes)


def test_another_gamma_is_refused():
    assert pm.Bathe(2.0 - 2.0**0.5) == pm.Bathe() and hash(pm.Bathe()) == hash(pm.Bathe())
    with pytest.raises(ValueError, match=r"gamma must be None or 2 - sqrt 2 = 0.58578.*, got 0.5"):
        pm.Bathe(0.5)


def test_a_run_of_it_gives_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        coupled().run(1.0)
