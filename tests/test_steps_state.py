"""Changed steps in checkpoints, snapshots, files and loads; bitwise restarts."""

import numpy as np
import pytest
from agreement import assert_identical
from steps_problems import RHO, U0, K, M, pair
from test_steps import COUPLINGS

import pmalpha as pm

DOUBLE = [("gc", None), ("pm", None), ("macro", True), ("mean", True)]


def changed(coupling, double=None, after=0, **options):
    """A coupler `after` macro steps after its second change."""
    c = pair(0.1, coupling=coupling, double=double, **options)
    c.step(5)
    c.change_steps(dt=0.05, substeps={"B": 3})
    c.step(4)
    c.change_steps(dt=0.08)
    c.step(after)
    return c


# ---- restarts ------------------------------------------------------------------------------------


@pytest.mark.parametrize("after", [0, 1, 2])
@pytest.mark.parametrize(("coupling", "double"), DOUBLE)
def test_a_checkpoint_has_the_steps(tmp_path, coupling, double, after):
    """Loaded by a coupler that was made with the first steps and has not changed them."""
    c = changed(coupling, double, after)
    c.save(tmp_path / "state.npz")
    fresh = pair(0.1, coupling=coupling, double=double)
    fresh.load(tmp_path / "state.npz")
    assert (fresh.dt, fresh.step_count, fresh.time) == (c.dt, c.step_count, c.time)
    assert_identical(fresh.run(steps=6), c.run(steps=6))
    fresh.reset()
    assert (fresh.dt, fresh.time) == (0.1, 0.0)


def test_an_unchanged_checkpoint_returns_to_the_first_steps(tmp_path):
    c = pair(0.1, coupling="pm")
    c.step(5)
    c.save(tmp_path / "state.npz")
    other = changed("pm", after=2)
    other.load(tmp_path / "state.npz")
    assert other.dt == 0.1
    assert_identical(other.run(steps=6), c.run(steps=6))


def test_a_coupler_made_with_the_changed_steps_is_another_problem(tmp_path):
    c = changed("gc", after=2)
    c.save(tmp_path / "state.npz")
    with pytest.raises(ValueError, match="dt"):
        pair(0.08, (1, 3)).load(tmp_path / "state.npz")


@pytest.mark.parametrize("after", [0, 1, 2])
@pytest.mark.parametrize(("coupling", "double"), DOUBLE)
def test_a_snapshot_is_restored_across_a_change(coupling, double, after):
    c, other = (changed(coupling, double, after) for _ in range(2))
    kept = c.snapshot()
    c.step(2)
    c.change_steps(dt=0.1, substeps={"B": 1})
    c.step(3)
    c.restore(kept)
    assert c.dt == 0.08
    assert_identical(c.run(steps=6), other.run(steps=6))
    c.restore(kept)
    c.change_steps(dt=0.1, substeps={"B": 1})
    again, other = c.run(steps=4), changed(coupling, double, after)
    other.change_steps(dt=0.1, substeps={"B": 1})
    assert_identical(again, other.run(steps=4))


@pytest.mark.parametrize(("coupling", "double"), DOUBLE)
@pytest.mark.filterwarnings("ignore:reset:UserWarning")  # which undoes the steps
def test_reset_returns_to_the_first_steps(coupling, double):
    c, fresh = changed(coupling, double), pair(0.1, coupling=coupling, double=double)
    c.reset()
    assert (c.dt, c.time, c.step_count) == (0.1, 0.0, 0)
    assert_identical(c.run(steps=6), fresh.run(steps=6))


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_reset_returns_to_the_first_time_after_a_change_there_and_back(coupling):
    """The steps are the first ones again, and the time counts from the change: found at random."""

    def load(t):
        return [np.sin(t), np.cos(t)]

    c, fresh = (pair(0.1, coupling=coupling, force=load) for _ in range(2))
    c.step(2)
    c.change_steps(dt=0.05)
    c.change_steps(dt=0.1)
    c.reset()
    assert_identical(c.run(steps=4), fresh.run(steps=4))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("coupling", "double"), DOUBLE)
@pytest.mark.filterwarnings("ignore:reset:UserWarning")  # which undoes the steps
def test_after_a_reset_a_coupler_is_as_one_just_made(coupling, double, seed):
    """Whatever was done before, and whether or not the steps change before the first macro step."""

    def load(t):
        return [np.sin(t), np.cos(t)]

    def act(c, calls):
        for name, *arguments in calls:
            getattr(c, name)(*arguments)

    rng = np.random.default_rng(seed)
    calls = [("step",), ("step", 2), ("change_steps", 0.05), ("change_steps", 0.1, {"B": 3})]
    before, after = ([calls[i] for i in rng.integers(4, size=6)] for _ in range(2))
    # what was an error: steps that were reached at a later time, taken before the first one
    earlier = ("change_steps", 0.05, {"B": 1})
    before, after = [*before, calls[0], earlier], [earlier, *after]
    c, fresh = (pair(0.1, coupling=coupling, double=double, force=load) for _ in range(2))
    act(c, [*before, ("reset",), *after])
    act(fresh, after)
    assert (c.time, c.dt, c.step_count) == (fresh.time, fresh.dt, fresh.step_count)
    assert_identical(c.run(steps=3), fresh.run(steps=3))


def test_load_cases_run_with_the_first_steps():
    c, fresh = changed("pm", after=1), pair(0.1, coupling="pm")
    before = c.time, c.dt, c.state("A").u
    cases = [{}, {"v0": {"A": [0.5, 0.0]}}]
    for ours, theirs in zip(c.run_each(cases, 0.6), fresh.run_each(cases, 0.6)):
        assert_identical(ours, theirs)
    assert (c.time, c.dt) == before[:2] and np.array_equal(c.state("A").u, before[2])


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_step_by_step_with_two_threads_is_bitwise_a_run(coupling):
    a, b = changed(coupling), changed(coupling, threads=2)
    history = a.run(steps=5)
    for _ in range(5):
        b.step()
    assert np.array_equal(history["B"].u[-1], b.state("B").u)
    assert np.array_equal(history["A"].v[-1], b.state("A").v)


# ---- histories -----------------------------------------------------------------------------------


def test_pieces_with_other_steps_are_joined():
    c = pair(0.1, (1, 2))
    first = c.run(0.5)
    c.change_steps(dt=0.05, substeps={"B": 3})
    second = c.run(0.8)
    whole = pm.History.join([first, second])
    assert np.array_equal(whole["B"].t, np.concatenate([first["B"].t, second["B"].t[1:]]))
    assert np.all(np.diff(whole["B"].t) > 0.0)
    with pytest.raises(ValueError, match="constant length"):
        whole["B"].local_error()


@pytest.mark.parametrize("every", [None, 2])
@pytest.mark.parametrize("substeps", [{}, {"B": 3}])
def test_a_file_continues_over_a_change(tmp_path, every, substeps):
    pytest.importorskip("h5py")
    path = tmp_path / "run.h5"
    c, other = pair(0.1, (1, 2)), pair(0.1, (1, 2))
    c.run(0.4, record_to=path, every=every)
    pieces = [other.run(0.4, every=every)]
    for x in (c, other):
        x.change_steps(dt=0.05, substeps=substeps)
    if substeps and every is None:
        with pytest.raises(ValueError, match="other numbers of substeps"):
            c.run(0.7, record_to=path, append=True)
        return
    history = c.run(0.7, record_to=path, append=True, every=every)
    pieces.append(other.run(0.7, every=every))
    assert_identical(history, pm.History.join(pieces))
    assert_identical(pm.History.load(path), history)


@pytest.mark.parametrize(("coupling", "double"), DOUBLE)
def test_energies_go_on_over_the_double_step_of_a_change(coupling, double):
    """T + U from the recorded states; the sums of works are those of the step by step run."""
    c = changed(coupling, double)
    history = c.run(steps=8, energy=True)
    parts = [history["A"], history["B"]]
    for i, s in enumerate(parts):
        stride = (len(s.t) - 1) // 8
        u, v = s.u[::stride], s.v[::stride]
        kinetic = 0.5 * np.einsum("ki,i,ki->k", v, M[i], v)
        strain = 0.5 * np.einsum("ki,ij,kj->k", u, K[i], u)
        np.testing.assert_allclose(history.energy.kinetic[:, i], kinetic, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(history.energy.strain[:, i], strain, rtol=1e-12, atol=1e-14)
    assert np.all(np.isfinite(history.energy.balance))


@pytest.mark.parametrize(("coupling", "double"), [("macro", True), ("pm", None)])
def test_works_of_double_steps_are_summed_chain_by_chain_over_a_change(coupling, double):
    """(B3) for A, whose time levels are the macro ones; the run begins with the step over the
    change, which is the first of its chain (B14). 1e-12: rounding."""
    c = changed(coupling, double)
    history = c.run(steps=8, energy=True)
    energy = history.energy
    assert c._session.members[0].double
    u, stride = history["A"].u[:, 1], (len(history.multipliers) - 1) // 8
    q = history.multipliers[::stride, 0]
    work = np.zeros(9)
    for k in range(1, 9):
        origin = max(k - 2, 0) if k > 1 else 0
        work[k] = work[origin] + 0.5 * (u[k] - u[origin]) * (q[k] + q[origin])
        if k == 1:
            stored = energy.kinetic[:2, 0] + energy.strain[:2, 0]
            work[1] = stored[1] - stored[0] + energy.dissipated[1, 0] - energy.external[1, 0]
    np.testing.assert_allclose(energy.interface[:, 0], work, rtol=1e-12, atol=1e-12)


def test_mean_coupling_keeps_the_energy_exactly_over_changes():
    """1e-13: rounding. Newmark conserves the energy with any step length."""
    c = pair(0.1, (1, 3), coupling="mean", scheme=pm.Newmark())
    total = []
    for dt in (0.1, 0.03, 0.07, 0.1):
        c.change_steps(dt=dt)
        energy = c.run(steps=20, energy=True).energy
        total.append((energy.kinetic + energy.strain).sum(axis=1))
    total = np.concatenate(total)
    assert np.max(np.abs(total / total[0] - 1.0)) < 1e-13


def test_mean_coupling_does_not_drift_over_changes():
    c = pair(0.1, coupling="mean", double=True, scheme=pm.GeneralizedAlpha(0.5))
    for dt in (0.1, 0.03, 0.07, 0.05):
        c.change_steps(dt=dt)
        assert np.max(np.abs(c.run(steps=20).displacement_jump)) < 1e-14


def test_multiplier_times_of_mean_coupling_are_middles_of_macro_steps():
    c = pair(0.1, coupling="mean")
    c.step(3)
    c.change_steps(dt=0.04)
    times = c.run(steps=2).multiplier_times
    np.testing.assert_allclose(times, [0.25, 0.32, 0.36], rtol=1e-14)


@pytest.mark.parametrize("double", [None, True])
def test_recorded_accelerations_of_mean_coupling_are_right_after_a_change(double):
    """(K5) with two lengths. 0.05: their error at dt = 0.01; without the weights it is 0.4."""
    from steps_problems import exact

    c = pair(0.01, coupling="mean", double=double, scheme=pm.Newmark())
    c.step(30)
    c.change_steps(dt=0.004)
    history = c.run(steps=4)
    for k in range(1, 5):
        u, _ = exact(history.macro_times[k])
        w = [(history["A"].a[k, 0], -(K[0] @ u[:2])[0] / M[0][0])]
        mass = M[0][1] + M[1][0]
        w.append((history["A"].a[k, 1], -((K[0] @ u[:2])[1] + (K[1] @ u[2:])[0]) / mass))
        for got, expected in w:
            assert abs(got - expected) < (0.05 if double is None else 1.0) * 20.0


# ---- loads ---------------------------------------------------------------------------------------


def test_callables_are_evaluated_at_the_new_time_levels():
    times = []

    def force(t):
        times.append(t)
        return np.array([np.sin(t), 0.0])

    c = pair(0.1, force=force)
    c.run(0.3)
    c.change_steps(dt=0.04, substeps={"A": 2, "B": 2})
    times.clear()
    c.run(0.42)
    t0 = 3 * 0.1
    assert times == [t0 + k / 2 * 0.04 for k in range(1, 7)]


@pytest.mark.parametrize("kind", ["sampled", "base", "constant"])
@pytest.mark.parametrize("coupling", COUPLINGS)
def test_loads_go_on_over_a_change(coupling, kind):
    """A load of each form and the same one as a callable: equal to rounding."""
    samples, shape = np.sin(np.arange(40.0)), np.array([1.0, -0.5])
    times = 0.03 * np.arange(40)
    loads = {
        "sampled": (
            pm.SampledForce(samples, 0.03, shape),
            lambda t: shape * np.interp(t, times, samples),
        ),
        "base": (
            pm.BaseAcceleration(samples, shape, M[0], dt=0.03),
            lambda t: -M[0] * shape * np.interp(t, times, samples, right=0.0),
        ),
        "constant": (shape, lambda t: shape),
    }
    a, b = (changed(coupling, force=f).run(steps=12) for f in loads[kind])
    np.testing.assert_allclose(a["A"].u, b["A"].u, atol=1e-13)
    np.testing.assert_allclose(a.multipliers, b.multipliers, atol=1e-10)


def test_prescribed_motion_goes_on_over_a_change():
    def make(velocity):
        A = pm.Subdomain(M[0], K[0], scheme=pm.GeneralizedAlpha(RHO), name="A")
        return pm.Coupler([A], pm.Constraint({A: [[0.0, 1.0]]}, velocity=velocity), dt=0.1)

    c = make(lambda t: np.array([np.sin(t)]))
    c.run(0.5)
    c.change_steps(dt=0.04, substeps={"A": 2})
    history = c.run(0.9)
    np.testing.assert_allclose(history["A"].v[:, 1], np.sin(history["A"].t), atol=1e-14)


READS = {
    "state": lambda c, path: c.state("A"),
    "multipliers": lambda c, path: c.multipliers,
    "snapshot": lambda c, path: c.snapshot(),
    "save": lambda c, path: c.save(path),
}


@pytest.mark.parametrize("read", READS)
@pytest.mark.parametrize("coupling", COUPLINGS)
def test_a_read_before_an_early_change_does_not_change_the_results(tmp_path, coupling, read):
    """Bitwise, with a prescribed velocity of which g'(0) is a difference quotient."""

    def make():
        A, B = (
            pm.Subdomain(M[0], K[0], scheme=pm.GeneralizedAlpha(RHO), name=name) for name in "AB"
        )
        pulled = pm.Constraint({A: [[1.0, 0.0]]}, velocity=lambda t: np.array([np.sin(3.0 * t)]))
        return pm.Coupler([A, B], [pm.tie(A, 1, B, 0), pulled], dt=0.1, coupling=coupling)

    c, other, loaded = make(), make(), make()
    READS[read](c, tmp_path / "state.npz")
    if read == "save":
        loaded.load(tmp_path / "state.npz")
    for x in (c, other, loaded):
        x.change_steps(dt=0.03, substeps={"B": 2})
    history = c.run(steps=5)
    assert_identical(history, other.run(steps=5))
    assert_identical(history, loaded.run(steps=5))
    assert np.abs(history["B"].v).max() > 0.01  # pulled by A


# ---- internal forces and analysis ----------------------------------------------------------------


@pytest.mark.parametrize("tangent", ["full", "reuse"])
@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_iterated_linear_forces_equal_linear_subdomains_over_changes(coupling, tangent):
    """1e-7: the tolerance of Newton's method, 1e-10, times the steps and 1 / h."""

    def make(internal):
        newton = pm.Newton(tol=1e-10, tangent=tangent)
        A, B = (
            pm.Subdomain(
                M[i],
                None if internal else K[i],
                internal=(lambda t, u, v, q, S=K[i]: (S @ u, S)) if internal else None,
                scheme=pm.GeneralizedAlpha(RHO),
                substeps=1 + i,
                u0=U0[i],
                name=name,
            )
            for i, name in enumerate("AB")
        )
        tie = pm.tie(A, [1], B, [0])
        return pm.Coupler([A, B], tie, dt=0.1, coupling=coupling, newton=newton)

    a, b = make(True), make(False)
    for steps, dt, substeps in ((3, 0.05, {"B": 4}), (1, 0.05, {"B": 1}), (4, 0.1, {"B": 2})):
        for c in (a, b):
            c.step(steps)
            c.change_steps(dt, substeps)
    x, y = (c.run(steps=5) for c in (a, b))
    np.testing.assert_allclose(x["A"].u, y["A"].u, atol=1e-7)
    np.testing.assert_allclose(x["B"].v, y["B"].v, atol=1e-7)


def test_analysis_sees_the_present_steps_and_leaves_the_state():
    c, other = changed("pm"), changed("pm")
    G = pm.analysis.amplification_matrix(c)
    made = pair(0.08, (1, 3), coupling="pm")
    np.testing.assert_allclose(G, pm.analysis.amplification_matrix(made), atol=1e-12)
    assert_identical(c.run(steps=4), other.run(steps=4))


def test_the_repr_shows_the_present_steps():
    c = pair(0.1, (1, 2))
    assert "dt = 0.1," in repr(c)
    c.change_steps(dt=0.05, substeps={"B": 4})
    assert "dt = 0.05," in repr(c) and "0.0125" in repr(c)
