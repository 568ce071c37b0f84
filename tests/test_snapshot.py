"""States in memory: a restored coupler continues bitwise identically."""

import copy
import pickle

import numpy as np
import pytest
import scipy.sparse as sp
from pairwise import pairwise
from test_checkpoint import coupler, require_same_history, snapshot

import pmalpha as pm
from pmalpha import analysis
from pmalpha.analysis.amplification import state_kept
from pmalpha.run.snapshot import Snapshot

DAMPED = pm.GeneralizedAlpha(0.5)


def nonlinear(coupling, tangent="full", threads=None):
    """An iterated subdomain with a history, iterated springs, and explicit ones with springs."""

    def friction(t, u, v, q):
        f = np.clip(50.0 * (u - q), -1.0, 1.0)
        return f, np.where(np.abs(f) < 1.0, 50.0, 0.0), None, u - f / 50.0

    # coarse, so that it takes double steps under pm
    a = pm.Subdomain(
        [2.0, 1.0],
        [[30.0, -10.0], [-10.0, 10.0]],
        scheme=DAMPED,
        internal=[pm.InternalForce(friction, history=[0.0, 0.0])],
        v0=[1.0, 0.5],
        name="a",
    )
    joints = [pm.Bilinear([(0, 1)], 40.0, 0.3, 0.1), pm.BoucWen([0], 20.0, 0.5, n=2)]
    b = pm.Subdomain([1.0, 1.0], None, scheme=DAMPED, internal=joints, v0=[0.5, 0.0], name="b")
    stops = [pm.Gap([0], 200.0, 0.02), pm.Bilinear([1], 30.0, 0.2)]
    c = pm.Subdomain(
        [1.0, 1.0],
        [[20.0, -20.0], [-20.0, 20.0]],
        scheme=pm.CentralDifference(),
        substeps=1 if coupling == "macro" else 4,  # the others are warned of with springs
        restoring=stops,
        name="c",
    )
    return pm.Coupler(
        [a, b, c],
        [pm.tie(a, [1], b, [0]), pm.tie(b, [1], c, [1])],
        dt=0.05,
        coupling=coupling,
        newton=pm.Newton(tangent=tangent),
        threads=threads,
    )


def bits_of(history):
    """All numbers of a History, and its springs' where they are recorded."""
    parts = [getattr(x, n) for x in history.subdomains for n in "tuva"]
    return [x.tobytes() for x in (*parts, history.multipliers)]


@pytest.mark.parametrize(
    ("steps", "coupling", "tangent"),
    pairwise([0, 1, 6], ["pm", "gc", "macro"], ["full", "reuse"]),
)
def test_a_restored_coupler_repeats_the_run_bitwise(coupling, tangent, steps):
    ours = nonlinear(coupling, tangent)
    ours.step(steps)
    present = ours.snapshot()
    first = bits_of(ours.run(steps=7))
    last = snapshot(ours)
    for _ in range(2):  # any number of times
        ours.restore(present)
        assert ours.step_count == steps
        assert bits_of(ours.run(steps=7)) == first
        assert snapshot(ours) == last


@pytest.mark.filterwarnings("ignore:.*grows with damping:pmalpha.StabilityWarning")
def test_a_state_under_mean_coupling_has_the_multipliers_of_its_accelerations():
    ours = coupler(coupling="mean")
    ours.step(5)
    present, before = ours.snapshot(), [ours.state(name) for name in "abc"]
    ours.step(3)
    ours.restore(present)
    for x, name in zip(before, "abc"):
        assert ours.state(name).a.tobytes() == x.a.tobytes()


@pytest.mark.parametrize("coupling", ["pm", "gc", "macro"])
def test_threads_that_run_ahead_are_part_of_no_state(coupling):
    """Linear subdomains are opened before the last macro step is complete."""
    a, b, c = (s for _, s in coupler()._session.keys)
    ties = [pm.tie(a, [5], b, [0]), pm.tie(b, [5], c, [0])]
    linear = pm.Coupler([a, b, c], ties, dt=0.1, coupling=coupling, threads=2)
    assert linear.threads == 2
    ours = nonlinear(coupling, threads=2)
    for x in (linear, ours):
        x.step(5)
        present = x.snapshot()
        first = bits_of(x.run(steps=7))
        x.restore(present)
        assert bits_of(x.run(steps=7)) == first
    one = nonlinear(coupling, threads=1)
    one.step(12)
    assert snapshot(one) == snapshot(ours)


def test_the_springs_slip_and_yield_in_these_runs():
    ours = nonlinear("pm")
    history = ours.run(steps=13, record_springs={"b": None, "c": None})
    assert abs(history["a"].q).max() > 0.0
    assert abs(history["b"].force[:, 1]).max() > 0.3  # Bouc-Wen, fy = 0.5, early
    assert history["c"].force[:, 0].max() > 0.0  # the stop is hit


def test_a_snapshot_is_that_of_its_instant():
    ours, other = nonlinear("pm"), nonlinear("pm")
    ours.step(3)
    present = ours.snapshot()
    before = snapshot(ours)
    ours.step(5)
    assert snapshot(ours) != before  # else this test could not fail
    ours.restore(present)
    assert snapshot(ours) == before
    other.step(8)
    ours.step(5)
    assert snapshot(ours) == snapshot(other)


@pytest.mark.filterwarnings("ignore:.*grows with damping:pmalpha.StabilityWarning")
@pytest.mark.parametrize(
    "variant", [{}, {"double": True}, {"coupling": "macro"}, {"coupling": "mean"}, {"moved": True}]
)
def test_callable_loads_and_motions_are_evaluated_again(variant):
    times = []

    def force(t):
        times.append(t)
        return np.full(6, np.sin(3.0 * t))

    ours = coupler(force=force, **variant)
    ours.step(40)  # more than one chunk of values
    present = ours.snapshot()
    first = ours.run(steps=9)
    ours.restore(present)
    del times[:]
    require_same_history(ours.run(steps=9), first)
    assert min(times) > 40 * 0.1 - 1e-9


def test_the_loads_and_initial_values_of_the_last_reset_return():
    ours = coupler()
    ours.reset(force={"a": np.ones(6)}, u0={"b": np.zeros(6)})
    ours.step(4)
    present = ours.snapshot()
    first = bits_of(ours.run(steps=5))
    ours.reset()
    ours.step(2)
    ours.restore(present)
    assert bits_of(ours.run(steps=5)) == first
    ours.restore(present)
    assert np.array_equal(ours._session.initial.values[1][0], np.zeros(6))


def test_before_the_first_step_the_start_is_computed():
    ours = coupler(force=lambda t: np.ones(6))
    present = ours.snapshot()
    ours.step(3)
    ours.restore(present)
    assert ours.step_count == 0 and ours.time == 0.0


def test_a_run_that_failed_can_begin_again():
    fails = [True]

    def force(t):
        if fails[0] and t > 0.95:
            raise ZeroDivisionError
        return np.zeros(6)

    ours = coupler(force=force)
    ours.step(2)
    present = ours.snapshot()
    with pytest.raises(ZeroDivisionError):
        ours.run(steps=20)
    assert ours.last_history is not None
    fails[0] = False
    ours.restore(present)
    assert ours.last_history is None
    other = coupler(force=lambda t: np.zeros(6))
    other.step(2)
    require_same_history(ours.run(steps=20), other.run(steps=20))


def test_another_coupler_is_refused():
    ours, other = coupler(), coupler()
    present = ours.snapshot()
    before = snapshot(other)
    with pytest.raises(ValueError, match="one of this coupler, got <Snapshot at step_count = 0>"):
        other.restore(present)
    assert snapshot(other) == before
    with pytest.raises(ValueError, match="got <Snapshot of no coupler>"):
        ours.restore(Snapshot())
    with pytest.raises(TypeError, match="must be a Snapshot, got 3"):
        ours.restore(3)


def test_a_snapshot_is_opaque():
    present = coupler().snapshot()
    for copied in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="cannot be copied or pickled"):
            copied(present)
    with pytest.raises(AttributeError):
        present.u = 1.0


def test_a_load_cannot_use_it_in_a_step():
    errors = []

    def force(t):
        for call in (ours.snapshot, lambda: ours.restore(present)):
            if t > 0.0:
                with pytest.raises(RuntimeError, match="being stepped"):
                    call()
                errors.append(t)
        return np.zeros(6)

    present = coupler().snapshot()
    ours = coupler(force=force)
    present = ours.snapshot()
    ours.step(1)
    assert errors


def test_analysis_leaves_the_coupler_with_what_iterations_keep():
    ours, other = nonlinear("pm", "reuse"), nonlinear("pm", "reuse")
    for x in (ours, other):
        x.step(5)
    with state_kept(ours):
        ours.step(4)
    assert snapshot(ours) == snapshot(other)
    assert bits_of(ours.run(steps=6)) == bits_of(other.run(steps=6))


def test_the_error_of_a_state_keeps_the_last_history():
    K = sp.csr_array(np.diag([4.0, 9.0]))
    a = pm.Subdomain([1.0, 1.0], K, scheme=DAMPED, v0=[1.0, 0.0], name="a")
    ours = pm.Coupler([a], dt=0.1)
    ours.step(3)
    before = snapshot(ours)
    analysis.amplification_matrix(ours)
    assert snapshot(ours) == before
