"""`Coupler.estimate_error`: the run with half the steps, and what is made of the two."""

import warnings

import numpy as np
import pytest
from agreement import assert_close
from error_cases import named_cases, random_chain
from reference_problems import random_problem
from test_snapshot import bits_of, nonlinear

import pmalpha as pm
from pmalpha import models

ALPHA = pm.GeneralizedAlpha


def oscillator(dt=0.1, scheme=None, **options):
    options = {"u0": [1.0], "name": "mass"} | options
    return pm.Coupler([pm.Subdomain([1.0], [4.0], scheme=scheme or pm.Newmark(), **options)], dt=dt)


def pair(dt, coupling="gc", substeps=2, force=None, **options):
    a = pm.Subdomain([1.0, 1.0], [[3.0, -1.0], [-1.0, 3.0]], scheme=ALPHA(0.8), name="a", **options)
    b = pm.Subdomain([1.0], [9.0], scheme=ALPHA(0.8), substeps=substeps, force=force, name="b")
    return pm.Coupler([a, b], pm.tie(a, 1, b, 0), dt=dt, coupling=coupling)


# ---- the runs ------------------------------------------------------------------------------------


def moved_support(dt):
    """A prescribed velocity, and a load that is averaged."""
    quake = pm.BaseAcceleration(np.sin(np.arange(60.0)), [1.0], [1.0], dt=0.07, average=True)
    a = pm.Subdomain([1.0], [4.0], scheme=ALPHA(0.5), force=quake, name="a")
    b = pm.Subdomain([1.0], [9.0], scheme=ALPHA(0.5), substeps=4, v0=[1.0], name="b")
    move = pm.Constraint({a: [[1.0]], b: [[-1.0]]}, velocity=lambda t: [-np.cos(3.0 * t)])
    return pm.Coupler([a, b], move, dt=dt, coupling="pm", threads=1)


def bouncing(dt):
    a = pm.Subdomain([1.0], [4.0], scheme=ALPHA(0.5), v0=[1.0], name="a")
    b = pm.Subdomain([1.0], [1.0], scheme=ALPHA(0.5, explicit=True), substeps=2, name="b")
    stops = [
        pm.contact(a, [0], b, [0], gap=0.1, restitution=0.5),
        pm.contact(b, [0], gap=0.2, motion=lambda t: 0.01 * np.sin(t)),
    ]
    a = pm.Subdomain([1.0], [4.0], scheme=ALPHA(0.5), substeps=2, v0=[1.0], name="a")
    stops[0] = pm.contact(a, [0], b, [0], gap=0.1, restitution=0.5)
    return pm.Coupler([a, b], stops, dt=dt, coupling="gc")


def actuated(dt):
    """A specimen behind an actuator, whose state is that of a coupler, and a feedback force."""
    specimen = pm.rig.SimulatedActuator(lambda t, u, v: 3.0 * u, delay=0.1)
    a = pm.Subdomain([1.0], [4.0], scheme=ALPHA(0.5), restoring=specimen, force=[1.0], name="a")
    b = pm.Subdomain([1.0], [1.0], scheme=ALPHA(0.5), force=lambda t, u, v: -0.1 * v, name="b")
    return pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=dt, coupling="gc", start="plain")


def random(seed, dt):
    problem = random_problem(seed)
    problem.dt = dt
    return problem.coupler()


MAKERS = {
    **{f"random {k}": (lambda dt, k=k: random(k, dt)) for k in range(3)},
    **{c: (lambda dt, c=c: pair(dt, c, v0=[1.0, 0.0])) for c in ("gc", "pm", "macro")},
    "mean": lambda dt: models.split_oscillator(10.0).coupler(dt, coupling="mean"),
    "moved support": moved_support,
    "contact": bouncing,
    "actuator": actuated,
}


def by_hand(make, dt, steps, order):
    """The largest difference of the runs with dt and dt / 2, over 1 - 2^-order and the motion."""
    coarse, half = make(dt).run(steps=steps), make(0.5 * dt).run(steps=2 * steps)
    pairs = [(x.u, y.u[::2]) for x, y in zip(coarse.subdomains, half.subdomains)]
    largest = max(np.abs(y).max() for _, y in pairs)
    own = [np.abs(x - y).max() / (1.0 - 2.0**-order) / largest for x, y in pairs]
    return coarse, dict(zip([s.name for s in coarse.subdomains], own))


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning", "ignore::pmalpha.ConstraintWarning")
@pytest.mark.parametrize("name", MAKERS)
def test_it_is_the_difference_to_a_coupler_with_half_the_steps(name, thresholds):
    make, dt, steps = MAKERS[name], 0.02, 23
    coupler = make(dt)
    found = coupler.estimate_error(steps=steps)
    coarse, own = by_hand(make, dt, steps, found.assumed_order)
    assert bits_of(found.history) == bits_of(coarse) == bits_of(coupler.run(steps=steps))
    # the same arithmetic, but for the order of two divisions
    for subdomain, value in own.items():
        np.testing.assert_allclose(found.by_subdomain[subdomain], value, rtol=1e-14, err_msg=name)
    assert found.relative == max(found.by_subdomain.values()) > 0.0
    thresholds(PIECE=1)  # a piece for each macro step
    again = make(dt).estimate_error(steps=steps)
    assert (again.by_subdomain, again.place) == (found.by_subdomain, found.place)


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_springs_and_iterated_forces_with_a_history_are_repeated(coupling):
    coupler = nonlinear(coupling)
    coupler.step(3)
    found = coupler.estimate_error(steps=10)
    assert bits_of(found.history) == bits_of(nonlinear(coupling).run(steps=10))
    assert 0.0 < found.relative < 1.0


def test_the_place_is_where_the_runs_differ_most():
    names = ["left", "right"]
    make = lambda dt: pair(dt, v0=[1.0, 0.0], dof_names=names)  # noqa: E731
    found = make(0.1).estimate_error(3.0)
    one, half = make(0.1).run(3.0)["a"], make(0.05).run(3.0)["a"]
    level, dof = np.unravel_index(np.argmax(np.abs(one.u - half.u[::2])), one.u.shape)
    assert found.place == ("a", names[dof], one.t[level])
    assert found.by_subdomain["a"] == found.relative
    assert repr(names[dof]) in repr(found)


def test_steps_initial_values_and_loads_are_the_present_ones():
    coupler = pair(0.1, v0=[1.0, 0.0])
    coupler.reset(v0={"a": [0.0, 1.0], "b": [1.0]}, force={"b": lambda t: [np.sin(t)]})
    coupler.step(4)
    coupler.change_steps(dt=0.05, substeps={"b": 4})
    found = coupler.estimate_error(2.0)
    other = pair(0.05, substeps=4, force=lambda t: [np.sin(t)])
    other.reset(v0={"a": [0.0, 1.0], "b": [1.0]})
    assert found.dt == 0.05
    assert bits_of(found.history) == bits_of(other.run(2.0))


def test_the_history_is_indexed_by_the_subdomains_of_the_coupler():
    coupler = pair(0.1, v0=[1.0, 0.0])
    found = coupler.estimate_error(1.0)
    assert found.history[coupler.subdomains[1]] is found.history["b"]


# ---- the coupler stays as it is ------------------------------------------------------------------


class Load:
    """It raises in some call."""

    def __init__(self):
        self.left = np.inf

    def __call__(self, t):
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt
        return [np.sin(t)]


@pytest.mark.parametrize("kind", ["first", "second", "progress", "none"])
@pytest.mark.parametrize("coupling", ["gc", "pm", "macro", "mean"])
def test_the_coupler_stays_as_it_is(kind, coupling):
    def report(done, total):
        if kind == "progress":
            raise KeyboardInterrupt

    load = Load()
    coupler, other = (pair(0.05, coupling, force=f) for f in (load, lambda t: [np.sin(t)]))
    coupler.step(7)
    # 41 evaluations are those of the first run, and 6 its check
    load.left = {"first": 30, "second": 100}.get(kind, np.inf)
    if kind == "none":
        coupler.estimate_error(steps=20, progress=report)
    else:
        with pytest.raises(KeyboardInterrupt):
            coupler.estimate_error(steps=20, progress=report)
    assert coupler.step_count == 7 and coupler.time == 7 * 0.05 and coupler.last_history is None
    other.step(7)
    assert bits_of(coupler.run(steps=5)) == bits_of(other.run(steps=5))


def test_a_coupler_whose_load_has_not_been_evaluated_does_not_evaluate_it():
    times = []
    coupler = pair(0.1, force=lambda t: times.append(t) or [1.0])
    coupler.estimate_error(steps=2)
    assert not coupler._session.started
    first, half = [0.0, *(0.05 * np.arange(1, 5))], [0.0, *(0.025 * np.arange(1, 9))]
    assert times == [*first, first[3], first[1], first[0], *half]  # calls 4, 2 and 1 again


def test_progress_counts_the_macro_steps_of_all_runs(thresholds):
    thresholds(PROGRESS_INTERVAL=0.0)
    thresholds(PIECE=1)
    reports = []
    pair(0.1).estimate_error(steps=4, halvings=2, progress=lambda *x: reports.append(x))
    done, totals = zip(*reports)
    assert set(totals) == {4 + 8 + 16} and list(done) == sorted(set(done)) and done[-1] == 28
    assert {4, 12} <= set(done)


def test_an_error_of_a_finer_run_says_which_run_it_was():
    def load(t):
        if 0.1 < t < 0.2 and round(t / 0.05) % 2:  # between two time levels of the first run
            raise ZeroDivisionError
        return [1.0]

    with pytest.raises(ZeroDivisionError) as caught:
        oscillator(0.1, force=load).estimate_error(1.0)
    assert caught.value.__notes__ == [
        "in force of subdomain 'mass' at t = 0.15",
        "in the run with dt = 0.05 of estimate_error",
    ]


def test_set_up_and_finer_runs_do_not_warn_again():
    with pytest.warns(pm.ConstraintWarning):
        coupler = pair(0.1, u0=[0.0, 0.1])  # a gap
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", pm.AccuracyWarning)  # of the first run, as `run` has it
        coupler.estimate_error(1.0)


# ---- the numbers ---------------------------------------------------------------------------------


def test_two_halvings_observe_the_order_and_the_error_of_an_oscillator():
    """The trapezoidal rule has the frequency (2 / h) atan(omega h / 2)."""
    h, omega = 0.05, 2.0
    t = h * np.arange(201)
    true = np.abs(np.cos(2.0 / h * np.arctan(0.5 * omega * h) * t) - np.cos(omega * t)).max()
    found = oscillator(h).estimate_error(10.0, halvings=2)
    # the phase is wrong by 1 / 60; the next terms of the expansion are the square of that
    np.testing.assert_allclose(found.relative, true, rtol=5e-3)
    np.testing.assert_allclose(found.order, 2.0, atol=0.02)
    step = found.dt_for(1e-3)
    reached = oscillator(10.0 / np.ceil(10.0 / step)).estimate_error(10.0)
    np.testing.assert_allclose(reached.relative, 1e-3, rtol=0.05)


@pytest.mark.parametrize(
    ("coupling", "substeps", "order"),
    [("gc", 2, 1.0), ("pm", 2, 1.0), ("gc", 1, 2.0), ("pm", 1, 2.0), ("macro", 2, 2.0)],
)
def test_with_one_halving_the_order_is_that_of_the_coupling(coupling, substeps, order):
    found = pair(0.1, coupling, substeps, v0=[1.0, 0.0]).estimate_error(2.0)
    assert found.assumed_order == order and np.isnan(found.order) and found.converges
    np.testing.assert_allclose(
        found.dt_for(found.relative / 4.0), 0.1 * 0.25 ** (1.0 / order), rtol=1e-12
    )


def test_the_order_is_that_of_the_dof_with_the_largest_error():
    """The second difference is largest in a small fast oscillator, which no step resolves."""
    slow = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), u0=[1.0], name="slow")
    for n in (1, 2):  # beside others in its subdomain too
        K, u0 = np.full(n, (2.0 * np.pi * 37.3) ** 2), np.full(n, 1e-4)
        K[1:], u0[1:] = 4.0, 1.0
        fast = pm.Subdomain(np.ones(n), K, scheme=pm.Newmark(), u0=u0, name="fast")
        parts = [slow, fast] if n == 1 else [fast]
        found = pm.Coupler(parts, dt=0.01, coupling="macro").estimate_error(10.0, halvings=2)
        np.testing.assert_allclose(found.order, 2.0, atol=0.01)  # the next term of the expansion
        assert found.place[:2] == (("slow", 0) if n == 1 else ("fast", 1))


def test_the_step_for_an_error_is_at_most_four_times_and_at_least_a_quarter_of_the_present_one():
    found = oscillator(0.05).estimate_error(10.0, halvings=2)  # 1.5 per cent
    for relative, step, words in (
        (20.0 * found.relative, 0.2, "at most 4 dt, 0.2; make"),
        (found.relative / 20.0, 0.0125, "at least dt / 4, 0.0125; make"),
    ):
        with pytest.warns(pm.AccuracyWarning, match=words):
            assert found.dt_for(relative) == pytest.approx(step, rel=1e-15)
    far = oscillator(0.02).estimate_error(10.0)  # 0.24 per cent, of order 1
    object.__setattr__(far, "assumed_order", 1.0)
    assert repr(far).endswith("; dt = 0.08 for 1 %, at most 4 dt")


@pytest.mark.gate
@pytest.mark.parametrize("nonlinear", [False, True])
@pytest.mark.parametrize("coupling", ["gc", "pm", "macro", "mean"])
@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")  # of springs under macro coupling
def test_random_chains_have_about_the_error_that_is_estimated(coupling, nonlinear):
    """Against modes or DOP853 of the uncut chain; benchmarks/surveys has more of them."""
    case = random_chain(20, coupling, nonlinear=nonlinear)
    found = case.estimate(2)
    true = case.error(found.history)
    # below a tenth the next term of the expansion is small; above, the two runs are far apart
    low, high = (0.8, 1.25) if true < 0.1 else (0.5, 3.0)
    if found.converges:
        assert low < found.relative / true < high, (true, found)
    else:
        assert true > 0.1, (true, found)


@pytest.mark.gate
@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")  # of a gap that is never reached
@pytest.mark.filterwarnings("ignore:restoring_stiffness of subdomain")  # beyond that of a function
def test_named_cases_have_the_error_that_is_estimated():
    for name, case in named_cases():
        found = case.estimate(2)
        true = case.error(found.history)
        if "never reached" in name:
            assert not found.converges and found.relative > 1.0 and true > 1.0
        else:  # a stop is between two time levels by chance
            assert abs(found.relative / true - 1.0) < (0.25 if "stop" in name else 0.05), name


def test_without_motion_the_error_is_zero():
    found = oscillator(u0=[0.0]).estimate_error(1.0, halvings=2)
    assert found.relative == 0.0 and found.by_subdomain == {"mass": 0.0} and np.isnan(found.order)
    with pytest.warns(pm.AccuracyWarning, match="no error was found: the step is at most 4 dt"):
        assert found.dt_for() == 0.4
    assert repr(found) == "error 0, the runs with dt = 0.1 and half of it are equal"


def test_runs_that_differ_by_rounding_have_no_order():
    """Under constant acceleration the trapezoidal rule is exact."""
    mass = pm.Subdomain([3.0], [0.0], scheme=pm.Newmark(), force=[1.0], name="mass")
    found = pm.Coupler([mass], dt=0.1).estimate_error(10.0, halvings=2)
    assert np.isnan(found.order) and found.converges
    assert found.relative < 1e-12  # rounding of 200 steps


def test_runs_that_do_not_converge_are_said_not_to():
    """A load that is seen by one run only."""

    def load(t):
        return [1.0 if round(t / 0.025) % 4 == 1 else 0.0]  # at quarters of the step

    found = oscillator(0.1, u0=[1e-3], force=load).estimate_error(1.0, halvings=2)
    one, half = (oscillator(x, u0=[1e-3], force=load).run(1.0)["mass"].u for x in (0.1, 0.05))
    finest = oscillator(0.025, u0=[1e-3], force=load).run(1.0)["mass"].u[::4]
    assert found.order < 0.5 and not found.converges and np.isnan(found.dt_for())
    difference = np.abs(one - half[::2]).max() / np.abs(finest).max()
    np.testing.assert_allclose(found.relative, difference, rtol=1e-14)
    assert repr(found).startswith("no convergence, order ")


def test_the_line_can_be_read_aloud():
    found = oscillator(0.05).estimate_error(10.0, halvings=2)
    level = found.history["mass"].t[np.argmin(np.abs(found.history["mass"].t - found.place[2]))]
    assert repr(found) == (
        f"error about 1.5 % of the largest displacement, at dof 0 of 'mass', t = {level:.4g}; "
        f"order 2; dt = {found.dt_for():.3g} for 1 %"
    )
    assert "; order 2 assumed; dt" in repr(oscillator(0.05).estimate_error(10.0))
    assert "for 1 %" not in repr(oscillator(0.01).estimate_error(1.0))  # far below


# ---- what is refused -----------------------------------------------------------------------------


class Friction:
    """A specimen that remembers."""

    def __init__(self):
        self.slip = 0.0

    def __call__(self, t, u, v):
        f = np.clip(20.0 * (u - self.slip), -1.0, 1.0)
        self.slip = u - f / 20.0
        return f


class Outside:
    repeatable = False

    def __call__(self, *arguments):
        raise AssertionError("must not be evaluated")

    def force(self, t, u, v):
        raise AssertionError("must not be evaluated")

    def load(self, t, u, v):
        raise AssertionError("must not be evaluated")


@pytest.mark.parametrize(
    "specimen",
    [Friction(), pm.rig.SimulatedActuator(Friction()), [pm.Gap([0], 1.0, 0.5), Friction()]],
)
def test_a_function_with_a_memory_is_refused(specimen):
    coupler = oscillator(restoring=specimen)
    with pytest.raises(ValueError, match="restoring of subdomain 'mass' must return the same"):
        coupler.estimate_error(2.0)


def test_a_function_that_begins_anew_by_itself_may_say_so():
    specimen, other = Friction(), Friction()
    specimen.repeatable = True
    found = oscillator(restoring=specimen).estimate_error(2.0)
    assert bits_of(found.history) == bits_of(oscillator(restoring=other).run(2.0))


def test_a_random_load_is_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="force of subdomain 'mass' must return the same"):
        oscillator(force=lambda t: rng.normal(size=1)).estimate_error(2.0)


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"restoring": Outside()}, "restoring of subdomain 'mass'"),
        ({"restoring": Outside().force}, "restoring of subdomain 'mass'"),
        ({"restoring": pm.rig.Compensated(Outside(), 0.1)}, "restoring of subdomain 'mass'"),
        ({"force": Outside().load}, "force of subdomain 'mass'"),
    ],
)
def test_what_says_that_it_cannot_be_repeated_is_refused_before_a_run(options, what):
    coupler = oscillator(**options)
    with pytest.raises(ValueError, match=f"estimate_error repeats the run: {what} must be"):
        coupler.estimate_error(1.0)


def test_specimens_and_commands_of_other_programs_say_so():
    from pmalpha.rig.connecting import Connected

    assert not any(x.repeatable for x in (Connected, pm.rig.Client, pm.rig.Command))
    mass = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), name="m")
    wall = pm.Constraint({mass: [[1.0]]}, velocity=pm.rig.Command(1))
    with pytest.raises(ValueError, match="velocity of constraint 0 must be a function in this"):
        pm.Coupler([mass], wall, dt=0.01).estimate_error(1.0)


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"t_end": 1.0, "halvings": 3}, ValueError, "halvings must be 1 or 2, got 3"),
        ({"t_end": 1.0, "halvings": 0}, ValueError, "halvings must be"),
        ({"steps": 0}, ValueError, "at least one macro step, got none"),
        ({}, TypeError, "give either t_end or steps"),
        ({"t_end": 0.15}, ValueError, "whole number of macro steps"),
        ({"steps": 1, "progress": 3}, TypeError, "progress must be True or a callable"),
    ],
)
def test_wrong_arguments_are_refused(options, error, match):
    with pytest.raises(error, match=match):
        oscillator().estimate_error(**options)


@pytest.mark.parametrize("relative", [0.0, -1.0, np.nan])
def test_the_error_that_is_wanted_must_be_positive(relative):
    with pytest.raises(ValueError, match="relative must be"):
        oscillator().estimate_error(1.0).dt_for(relative)


def test_the_finer_motion_is_that_of_the_first_run_where_they_are_equal():
    """Both stand on the same time levels: those of the first run, with its times."""
    found = pair(0.1, "pm", 4, v0=[1.0, 0.0]).estimate_error(1.0)
    half = pair(0.05, "pm", 4, v0=[1.0, 0.0]).run(1.0)
    for x, y in zip(found.history.subdomains, half.subdomains):
        assert_close(x.t, y.t[::2], 0.0, f"times of {x.name!r}", size=1.0)
