"""Loads: their values at each instant, the evaluation of callables, and the state after errors.

The acceleration of a mass without spring is its load, M w = F(t): `a` of the history is F / M at
every time level, to one rounding of the division. Most tests below use this.
"""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from pairwise import in_turn, pairwise

import pmalpha as pm

SOFT = pm.GeneralizedAlpha(0.5)
FAST = pm.GeneralizedAlpha(0.5, explicit=True)


def loads_seen(force, n, dt, steps, substeps=1, scheme=SOFT, M=None):
    """t (k,) and F (k, n) on free masses, a unit mass at each dof by default."""
    M = np.ones(n) if M is None else M
    mass = pm.Subdomain(M, np.zeros(n), scheme=scheme, substeps=substeps, force=force)
    history = pm.solve(mass, dt=dt, steps=steps)
    return history.t, history.a * M if np.ndim(M) == 1 else history.a @ M


def pair(force_a, force_b, *, coupling="pm", n=2):
    """A double-step subdomain with one substep and an explicit one with four, tied, these loads."""
    K = 30.0 * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    a = pm.Subdomain(np.full(n, 2.0), K, scheme=SOFT, force=force_a, u0=np.ones(n), name="a")
    b = pm.Subdomain(
        np.ones(n), sp.csr_array(K), scheme=FAST, substeps=4, force=force_b, u0=np.ones(n), name="b"
    )
    return pm.Coupler([a, b], pm.tie(a, [0], b, [n - 1]), dt=0.05, coupling=coupling)


def columns(history):
    """All arrays of a History of `pair`, each with its number of substeps in a macro step."""
    found = [(1, history.macro_times), (4, history.multiplier_times), (4, history.multipliers)]
    found += [(4, history.velocity_jump), (1, history.displacement_jump)]
    for subdomain, levels in zip(history.subdomains, (1, 4)):
        found += [(levels, getattr(subdomain, x)) for x in ("t", "u", "v", "a")]
    return found


def assert_same_rows(history, whole, begin=0, end=None):
    """history is bitwise identical to the macro steps begin..end of `whole`."""
    for (levels, x), (_, y) in zip(columns(history), columns(whole)):
        last = len(y) if end is None else end * levels + 1
        np.testing.assert_array_equal(x, y[begin * levels : last])


def wave(t):
    return np.array([np.sin(9.0 * t), np.cos(4.0 * t)])


class LoggedLoad:
    """A load that logs the times at which it is evaluated, and may raise at one of them."""

    def __init__(self, load=wave):
        self.load, self.times, self.refused = load, [], []
        self.breaks_after, self.error = np.inf, None

    def __call__(self, t):
        if t > self.breaks_after:
            self.refused.append(t)
            raise self.error
        self.times.append(t)
        return self.load(t)


# ---- none, constant, callable ---------------------------------------------------------------


def test_no_load_is_a_load_of_zero():
    t, F = loads_seen(None, 3, 0.1, 4)
    np.testing.assert_array_equal(F, np.zeros((5, 3)))
    one, two = (pair(f, f).run(steps=6) for f in (None, [0.0, 0.0]))
    assert_same_rows(one, two)


@pytest.mark.parametrize("scheme", [SOFT, FAST], ids=["implicit", "explicit"])
def test_a_constant_load_acts_at_every_time_level_from_the_start(scheme):
    for value in ([1.5, -2.0, 0.25], (1, 2, 3), np.arange(3, dtype=np.int8), np.float32([1, 2, 4])):
        _, F = loads_seen(value, 3, 0.1, 4, 2, scheme)
        np.testing.assert_array_equal(F, np.tile(np.array(value, dtype=float), (9, 1)))


def test_a_callable_acts_with_its_value_at_the_end_of_each_substep():
    t, F = loads_seen(wave, 2, 0.1, 10, substeps=3)
    np.testing.assert_array_equal(t, np.arange(31) / 3 * 0.1)
    np.testing.assert_array_equal(F, [wave(ti) for ti in t])


def test_a_callable_that_returns_a_constant_is_bitwise_identical_to_the_constant():
    value = np.array([0.3, -0.7])
    one, two = pair(value, None).run(steps=9), pair(lambda t: value, None).run(steps=9)
    assert_same_rows(one, two)


KEPT = np.zeros(2)
VECTORS = {
    "list": list,
    "tuple": tuple,
    "array": np.array,
    "strided": lambda x: np.repeat(x, 2)[::2],
    "reversed": lambda x: x[::-1].copy()[::-1],
    "longdouble": lambda x: np.array(x, dtype=np.longdouble),
    "the same array again": lambda x: np.add(x, 0.0, out=KEPT),
}


@pytest.mark.parametrize("give", VECTORS.values(), ids=VECTORS)
def test_a_callable_may_return_anything_that_is_a_vector(give):
    _, F = loads_seen(lambda t: give(wave(t)), 2, 0.1, 5)
    np.testing.assert_array_equal(F, [wave(k * 0.1) for k in range(6)])


# ---- evaluation of callables ----------------------------------------------------------------


@pytest.mark.parametrize("coupling", ["pm", "gc"])
def test_a_callable_is_evaluated_once_at_zero_and_once_per_substep_in_the_order_of_time(coupling):
    a, b = LoggedLoad(), LoggedLoad()
    coupler = pair(a, b, coupling=coupling)
    assert a.times == b.times == []  # creating a coupler evaluates no load
    history = coupler.run(steps=10)
    np.testing.assert_array_equal(a.times, history["a"].t)
    np.testing.assert_array_equal(b.times, history["b"].t)


def test_a_callable_is_never_evaluated_beyond_the_end_of_the_call_nor_twice():
    a, b = LoggedLoad(), LoggedLoad()
    coupler = pair(a, b)
    coupler.state("a")
    assert a.times == b.times == [0.0]  # the initial accelerations need it
    for call, end in (
        (lambda: coupler.multipliers, 0),
        (lambda: coupler.run(steps=0), 0),
        (lambda: coupler.step(), 1),
        (lambda: coupler.run(0.05 * 7), 7),
        (lambda: coupler.step(3), 10),
        (lambda: coupler.state("b"), 10),
    ):
        call()
        np.testing.assert_array_equal(a.times, np.arange(end + 1) * 0.05)
        np.testing.assert_array_equal(b.times, np.arange(4 * end + 1) / 4 * 0.05)


def test_refused_arguments_evaluate_no_load():
    a = LoggedLoad()
    coupler = pair(a, None)
    for arguments in ({"t_end": 0.07}, {"steps": -1}, {"steps": 2, "every": 0}, {}):
        with pytest.raises((ValueError, TypeError)):
            coupler.run(**arguments)
    with pytest.raises(ValueError, match="n must"):
        coupler.step(-1)
    assert a.times == []


def spread(log):
    """Largest number of macro steps by which one load was evaluated ahead of the other."""
    latest, most = {"a": 0.0, "b": 0.0}, 0.0
    for name, t in log:
        latest[name] = t
        most = max(most, abs(latest["a"] - latest["b"]) / 0.05)
    return most


# 8 bytes for each of 2 dofs, and 1 + 4 substeps: a macro step takes 80 bytes
@pytest.mark.parametrize(("ahead", "chunk"), [(1, 1), (80, 1), (239, 2), (240, 3), (10**9, 20)])
def test_callables_are_evaluated_ahead_in_chunks_and_the_result_is_the_same(
    ahead, chunk, thresholds
):
    expected = pair(wave, wave).run(steps=20)
    thresholds(AHEAD=ahead)
    log = []
    note = lambda name: lambda t: log.append((name, t)) or wave(t)  # noqa: E731
    assert_same_rows(pair(note("a"), note("b")).run(steps=20), expected)
    # until the second is evaluated, the first is at most one chunk ahead
    assert spread(log) == pytest.approx(chunk, rel=1e-12)
    assert sorted(t for name, t in log if name == "b") == [t for name, t in log if name == "b"]
    assert len(log) == 21 + 81


def test_loads_evaluated_ahead_take_at_most_64_megabytes():
    assert pm.run.advance.AHEAD <= 64_000_000


# ---- samples --------------------------------------------------------------------------------

SAMPLES = np.array([0.5, -1.0, 2.0, 0.25, -3.0, 4.0])
TWO = np.column_stack([SAMPLES, SAMPLES[::-1] + 0.3])
SHAPE = np.array([[1.0, -2.0], [0.5, 0.0], [0.0, 3.0]])


def interpolated(values, dt, right):
    """samples (m, k) as a function of time, by np.interp; `right` after the end, None holds."""
    times = dt * np.arange(len(values))
    return lambda t: np.array([np.interp(t, times, s, right=right) for s in values.T])


# 0.061 does not meet the record's end at 0.35 in 12 steps of a third of it
@pytest.mark.parametrize(
    ("values", "shape", "expected"),
    [
        (TWO, SHAPE, lambda s: SHAPE @ s),
        (SAMPLES, [1.0, 0.0, 2.5], lambda s: np.array([1.0, 0.0, 2.5]) * s),
        (SAMPLES[:, None], np.array([[1.0], [0.0], [2.5]]), lambda s: [1.0, 0.0, 2.5] * s),
        (np.column_stack([TWO, SAMPLES]), None, lambda s: s),
        (TWO.astype(np.float32), SHAPE.astype(int), lambda s: SHAPE.astype(int) @ s),
    ],
)
def test_a_sampled_force_is_the_interpolation_of_its_samples(values, shape, expected):
    force = pm.SampledForce(values, 0.07, shape=shape)
    t, F = loads_seen(force, 3, 0.061, 12, substeps=3)
    series = np.array(values, dtype=float).reshape(6, -1)
    wanted = [expected(interpolated(series, 0.07, None)(ti)) for ti in t]
    # samples up to 4 times shapes up to 3, a few roundings of the weight t / dt up to 5
    np.testing.assert_allclose(F, wanted, rtol=0, atol=1e-13)
    np.testing.assert_allclose([force(ti) for ti in t], wanted, rtol=0, atol=1e-13)
    assert np.abs(np.diff(F, axis=0)).max() > 0.1  # it moves
    # after the end the last sample is held
    np.testing.assert_array_equal(F[t > 0.36], np.tile(F[-1], (int((t > 0.36).sum()), 1)))
    np.testing.assert_allclose(F[-1], expected(series[-1]), rtol=1e-15)


DENSE_M = np.array([[2.0, 0.5, 0.0], [0.5, 1.0, 0.25], [0.0, 0.25, 3.0]])


RECORDS = (SAMPLES, [1.0, 1.0, 0.0]), (TWO, SHAPE), (SAMPLES[:, None], [[1.0], [1.0], [0.0]])


@pytest.mark.parametrize(
    ("M", "given"),
    in_turn(
        [DENSE_M, np.array([2.0, 1.0, 3.0]), sp.csc_array(DENSE_M), sp.coo_matrix(DENSE_M)],
        *RECORDS,
    ),
)
def test_a_base_acceleration_is_minus_M_direction_record_and_zero_after_its_end(M, given):
    record, direction = given
    force = pm.BaseAcceleration(record, direction, M, dt=0.07)
    t, F = loads_seen(force, 3, 0.061, 12, substeps=3, M=M)
    dense = M.toarray() if sp.issparse(M) else np.diag(M) if M.ndim == 1 else M
    weight = -dense @ np.reshape(direction, (3, -1))
    series = np.reshape(record, (6, -1))
    wanted = [weight @ interpolated(series, 0.07, 0.0)(ti) for ti in t]
    # samples up to 4 times weights up to 9, a few roundings of the weight t / dt up to 5
    np.testing.assert_allclose(F, wanted, rtol=0, atol=1e-12)
    assert (F[t > 0.35] == 0.0).all()
    assert np.abs(F[t < 0.35]).max() > 1.0


def test_a_sampled_force_equals_a_callable_of_the_same_samples_in_a_coupled_run():
    force = pm.SampledForce(TWO, 0.07, shape=SHAPE[:2])
    values = interpolated(TWO, 0.07, None)
    one = pair(force, force).run(steps=30)
    two = pair(lambda t: SHAPE[:2] @ values(t), lambda t: SHAPE[:2] @ values(t)).run(steps=30)
    for (_, x), (_, y) in zip(columns(one), columns(two)):
        # loads agree to a few roundings, and stable steps do not make that larger: 120 of them
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-12 * max(np.abs(y).max(), 1.0))


def at_decimals(samples, spacing, times, hold):
    """The force at decimal times, in exact arithmetic but for the last product."""
    found = []
    for t in times:
        x = t / Fraction(spacing)
        j = int(x)
        if x > len(samples) - 1:
            found.append(samples[-1] if hold else 0.0)
        elif x == len(samples) - 1:
            found.append(samples[-1])
        else:
            theta = float(x - j)
            found.append((1.0 - theta) * samples[j] + theta * samples[j + 1])
    return np.array(found)


DECIMALS = [
    ("0.1", "0.1"), ("0.1", "0.02"), ("0.07", "0.07"), ("0.07", "0.01"), ("0.02", "0.005"),
    ("0.3", "0.1"), ("0.0006", "0.0002"), ("0.15", "0.05"), ("0.7", "0.1"), ("0.012", "0.004"),
]  # fmt: skip


# spacing of the samples, macro step, which divides it, and number of its substeps
@pytest.mark.parametrize(
    ("spacing", "dt", "substeps"), [(*x, k) for x, k in in_turn(DECIMALS, 3, 10, 1, 7, 3)]
)
def test_a_record_ends_at_its_last_sample_also_where_decimals_round(spacing, dt, substeps):
    # a fine instant is that of the last sample, whose force must act in full, though the two times
    # may differ by a rounding; one instant later the force is zero or held
    samples = np.array([0.0, 1.0, -1.0, 2.0, 5.0])
    per_sample = int(Fraction(spacing) / Fraction(dt))
    steps = 4 * per_sample + 2
    times = [Fraction(k, substeps) * Fraction(dt) for k in range(steps * substeps + 1)]
    for kind, hold in ((pm.SampledForce, True), (pm.BaseAcceleration, False)):
        force = kind(samples, **({} if hold else {"direction": [-1.0]}), dt=float(spacing))
        t, F = loads_seen(force, 1, float(dt), steps, substeps)
        # a few roundings of t / dt, which is up to 6, times slopes up to 3
        expected = at_decimals(samples, spacing, times, hold)
        np.testing.assert_allclose(F[:, 0], expected, rtol=0, atol=1e-13)
        one = pm.Subdomain([1.0], [1.0], scheme=SOFT, force=force).force
        np.testing.assert_allclose([one(ti) for ti in t], F, rtol=0, atol=1e-13)
        assert F[4 * per_sample * substeps, 0] == 5.0


def test_a_record_of_one_sample_is_held_or_a_kick_at_zero():
    _, F = loads_seen(pm.SampledForce([3.0], 0.1, shape=[1.0, 2.0]), 2, 0.1, 3)
    np.testing.assert_array_equal(F, np.tile([3.0, 6.0], (4, 1)))
    _, F = loads_seen(pm.BaseAcceleration([3.0], [1.0, 2.0], [1.0, 1.0], dt=0.1), 2, 0.1, 3)
    np.testing.assert_array_equal(F, [[-3.0, -6.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])


def test_a_record_finer_than_the_step_is_sampled_not_averaged():
    spikes = np.zeros(101)
    spikes[1::2] = 1000.0
    _, F = loads_seen(pm.SampledForce(spikes, 0.01, shape=[1.0]), 1, 0.02, 50)
    # every second sample is a zero of the record, up to rounding of t / dt = 100
    np.testing.assert_allclose(F, 0.0, rtol=0, atol=1000.0 * 1e-13)


@pytest.mark.parametrize("steps", [100_000, pytest.param(10**6, marks=pytest.mark.campaign)])
def test_a_long_record_is_at_its_samples_far_out(steps):
    samples = np.cos(np.arange(steps + 1) ** 2 % 1000.0)
    force = pm.SampledForce(samples, 0.01, shape=[1.0])
    mass = pm.Subdomain([1.0], [0.0], scheme=FAST, force=force)
    history = pm.solve(mass, dt=0.01, steps=steps)
    # t / dt is the sample's number but for rounding, which must not cause interpolation
    np.testing.assert_array_equal(history.a[:, 0], samples)


# ---- loads that raise -----------------------------------------------------------------------


class Broken(Exception):
    pass


ERRORS = [
    *(Broken("cable"), StopIteration(), ZeroDivisionError()),
    *(KeyError("x"), MemoryError(), RecursionError("x")),
]


@pytest.mark.parametrize(
    ("where", "error"), in_turn(pairwise(["a", "b"], [1, 240, 64_000_000]), *ERRORS)
)
def test_after_a_load_raised_the_run_is_at_the_last_whole_macro_step_and_can_continue(
    where, error, thresholds
):
    which, ahead = where
    thresholds(AHEAD=ahead)
    whole = pair(wave, wave).run(steps=12)
    loads = {"a": LoggedLoad(), "b": LoggedLoad()}
    coupler = pair(loads["a"], loads["b"])
    coupler.run(steps=1)
    # macro step 8 needs times in (0.35, 0.40]; "a" is evaluated at the last one
    loads[which].breaks_after, loads[which].error = 0.38, error
    with pytest.raises(type(error)) as caught:
        coupler.run(steps=11)
    assert caught.value is error
    assert coupler.step_count == 7
    assert coupler.time == whole.macro_times[7]
    assert_same_rows(coupler.last_history, whole, 1, 7)
    for name, row in (("a", 7), ("b", 28)):
        state = coupler.state(name)
        for x in "uva":
            np.testing.assert_array_equal(getattr(state, x), getattr(whole[name], x)[row])
    np.testing.assert_array_equal(coupler.multipliers, whole.multipliers[28])

    # the cause is still there, then gone
    with pytest.raises(type(error)) as caught:
        coupler.step()
    assert caught.value is error and coupler.step_count == 7
    loads[which].breaks_after = np.inf
    assert_same_rows(coupler.run(steps=5), whole, 7)
    # their earlier values were not evaluated again
    np.testing.assert_array_equal(loads["a"].times, whole["a"].t)
    np.testing.assert_array_equal(loads["b"].times, whole["b"].t)
    assert set(loads[which].refused) == {min(loads[which].refused)}  # nor any later one


@pytest.mark.parametrize("which", ["a", "b"])
def test_values_evaluated_before_another_load_raised_are_kept_for_any_next_call(which):
    # "a" may be evaluated to the end of the run before "b" raises, or the reverse
    whole = pair(wave, wave).run(steps=12)
    loads = {"a": LoggedLoad(), "b": LoggedLoad()}
    coupler = pair(loads["a"], loads["b"])
    loads[which].breaks_after, loads[which].error = 0.23, Broken()
    with pytest.raises(Broken):
        coupler.run(steps=12)
    loads[which].breaks_after = np.inf
    coupler.step()
    coupler.step(2)
    done = coupler.step_count
    assert_same_rows(coupler.run(steps=12 - done), whole, done)
    np.testing.assert_array_equal(loads["a"].times, whole["a"].t)
    np.testing.assert_array_equal(loads["b"].times, whole["b"].t)


def test_the_first_load_is_evaluated_once_at_zero_though_the_second_raised_there():
    first, second = LoggedLoad(), LoggedLoad()
    second.breaks_after, second.error = -1.0, Broken()
    coupler = pair(first, second)
    with pytest.raises(Broken):
        coupler.step()
    second.breaks_after = np.inf
    coupler.step()
    np.testing.assert_array_equal(first.times, [0.0, 0.05])


def test_a_run_after_a_failed_one_and_a_reset_forget_its_history():
    load = LoggedLoad()
    coupler = pair(wave, load)
    assert coupler.last_history is None
    for _ in range(2):
        load.breaks_after, load.error = 0.12, Broken()
        with pytest.raises(Broken):
            coupler.run(steps=4)
        assert coupler.last_history.macro_times.tolist() == [0.0, 0.05, 0.1]
        load.breaks_after = np.inf
        coupler.run(steps=1)
        assert coupler.last_history is None
        coupler.reset()
    load.breaks_after = 0.12
    with pytest.raises(Broken):
        coupler.run(steps=4)
    coupler.reset()
    load.breaks_after = -1.0
    with pytest.raises(Broken):
        coupler.run(steps=4)
    # the coupler is at zero: a history up to 0.1 would be of another run
    assert coupler.last_history is None or coupler.last_history.macro_times.tolist() == [0.0]


# ---- loads that call their coupler ----------------------------------------------------------

CALLS = {
    "time": lambda c: c.time,
    "step_count": lambda c: c.step_count,
    "multipliers": lambda c: c.multipliers,
    "state": lambda c: c.state("a"),
    "run": lambda c: c.run(steps=1),
    "step": lambda c: c.step(),
    "reset": lambda c: c.reset(),
}


@pytest.mark.parametrize(("call", "when"), [*in_turn(CALLS, 0.0, 0.1), ("run", 0.0)])
def test_a_load_that_calls_its_coupler_gets_a_runtime_error(call, when):
    whole = pair(wave, wave).run(steps=5)
    caught = []

    def curious(t):
        if t == when and not caught:
            with pytest.raises(RuntimeError) as refusal:
                CALLS[call](coupler)
            caught.append(refusal.value)
            raise refusal.value
        return wave(t)

    coupler = pair(curious, wave)
    with pytest.raises(RuntimeError, match="may not use it") as error:
        coupler.run(steps=5)
    assert error.value is caught[0]
    done = 0 if when == 0.0 else 1
    assert coupler.step_count == done
    assert_same_rows(coupler.run(steps=5 - done), whole, done)


def test_a_load_that_swallows_the_refusal_does_no_harm():
    whole = pair(wave, wave).run(steps=5)
    refused = []

    def curious(t):
        for call in CALLS.values():
            try:
                call(coupler)
            except RuntimeError as error:
                refused.append(error)
        return wave(t)

    coupler = pair(wave, curious)
    assert_same_rows(coupler.run(steps=5), whole)
    assert len(refused) == len(CALLS) * 21


def test_a_load_may_run_another_coupler_even_one_of_the_same_subdomains():
    a = pm.Subdomain([1.0], [4.0], scheme=SOFT, u0=[1.0])
    other = pm.Coupler([a], dt=0.1)

    def feed(t):
        if t > 0.0:
            other.step()
        return other.state(0).u

    b = pm.Subdomain([1.0], [0.0], scheme=SOFT, force=feed)
    history = pm.Coupler([a, b], dt=0.1, coupling="gc").run(steps=5)
    # the acceleration of the mass of b is its load, the other run of a
    np.testing.assert_array_equal(history[1].a, history[0].u)


def test_a_mass_that_does_not_fit_the_direction_is_named():
    with pytest.raises(ValueError, match="M must be of size 1 like direction, got size 2"):
        pm.BaseAcceleration([3.0], [1.0], [1.0, 1.0], dt=0.1)
