"""Runs whose numbers leave the range of numbers: what is raised, and where the run ends."""

import pickle

import numpy as np
import pytest
from pairwise import pairwise
from refusals import EXPLICIT, as_bytes, chain, single, subdomain

import pmalpha as pm

WARNED = pytest.mark.filterwarnings(
    "ignore::pmalpha.ConstraintWarning", "ignore::pmalpha.StabilityWarning"
)


STIFF = {
    "diagonal": 1e4 * np.array([1.0, 2.0, 3.0]),
    "dense": 1e4 * chain(3).toarray(),
    "sparse": 1e4 * chain(3),
}


def unstable(form, names="ABC", tied=True):
    """Three tied subdomains, of which only B is unstable: h omega is 5 to 10, the limit 1.87."""
    given = {
        "A": subdomain(np.ones(3), chain(3), u0=[1.0, 0.5, 0.25], name="A"),
        "B": subdomain(
            np.ones(3), STIFF[form], u0=[0.25] * 3, scheme=EXPLICIT, substeps=2, name="B"
        ),
        "C": subdomain(np.ones(3), chain(3), u0=[0.25, 0.0, 0.0], scheme=EXPLICIT, name="C"),
    }
    ties = [pm.tie(given["A"], [2], given["B"], [0]), pm.tie(given["B"], [2], given["C"], [0])]
    with pytest.warns(pm.StabilityWarning, match="'B'"):
        return pm.Coupler(
            [given[name] for name in names], ties if tied else None, dt=0.1, coupling="pm"
        )


@pytest.mark.parametrize(
    ("form", "names", "tied"), pairwise(list(STIFF), ["ABC", "CBA", "BAC"], [True, False])
)
def test_an_unstable_run_is_named_with_step_time_and_subdomain(form, names, tied):
    coupler = unstable(form, names, tied)
    with pytest.raises(pm.InstabilityError) as caught:
        coupler.run(steps=10_000)
    error = caught.value
    assert isinstance(error, pm.PmalphaError)
    assert error.subdomain == "B"
    # |w| grows by (h omega)^2 < 300 per substep: 1e308 is not reached within 60 macro steps
    assert 60 < error.step < 10_000
    assert error.step == coupler.step_count and error.time == coupler.time
    assert "'B'" in str(error) and f"step {error.step}" in str(error)
    ratio = 0.05 / pm.analysis.critical_step(coupler.subdomains[names.index("B")])
    assert error.cause == f"its step 0.05 is {ratio:.3g} times the critical one; take smaller steps"
    assert_last_good_state_is_kept(coupler, unstable(form, names, tied), error.step)


def assert_last_good_state_is_kept(coupler, other, step):
    history = coupler.last_history
    assert history.macro_times.size == step + 1
    expected = other.run(steps=step)
    for name in "ABC":
        for x in "uva":
            assert np.isfinite(getattr(history[name], x)).all()
            ours, theirs = getattr(coupler.state(name), x), getattr(other.state(name), x)
            np.testing.assert_array_equal(ours, theirs)
            np.testing.assert_array_equal(getattr(history[name], x), getattr(expected[name], x))
    with pytest.raises(pm.InstabilityError) as again:  # it is at that step, and fails there again
        coupler.step()
    assert again.value.step == step


def test_an_unstable_coupler_can_be_reset_and_run():
    coupler = unstable("dense")
    with pytest.raises(pm.InstabilityError):
        coupler.step(10_000)
    coupler.reset()
    assert as_bytes(coupler) == as_bytes(unstable("dense"))


def test_an_unstable_implicit_subdomain_is_named():
    # negative stiffness: u = cosh(30 t), w = 900 u
    falling = subdomain([1.0], [-900.0], u0=[1.0], name="falling")
    with pytest.warns(pm.StabilityWarning, match=r"'falling'.* grows as exp\(30 t\)"):
        coupler = pm.Coupler([falling, single(name="other", substeps=2)], dt=0.001, coupling="pm")
    with pytest.raises(pm.InstabilityError) as caught:
        coupler.run(steps=100_000, every=1000)
    assert caught.value.subdomain == "falling"
    # 450 exp(30 t) = 1.8e308 at t = 23.456; h omega = 0.06 with the double step: (h omega)^2 / 2 of
    # it for an error of order 2
    assert abs(caught.value.time - 23.456) < 0.05


def test_an_instability_error_survives_pickling():
    # parameter studies in several processes return it in this way
    error = pickle.loads(pickle.dumps(pm.InstabilityError(3, 0.5, "rig")))
    assert (error.step, error.time, error.subdomain) == (3, 0.5, "rig")
    assert str(error) == str(pm.InstabilityError(3, 0.5, "rig"))


def test_the_errors_are_those_of_the_contract():
    for error in (pm.ConstraintError, pm.FactorizationError, pm.InstabilityError):
        assert issubclass(error, pm.PmalphaError)
    assert issubclass(pm.ConstraintError, ValueError)
    assert issubclass(pm.StabilityWarning, Warning) and issubclass(pm.ConstraintWarning, Warning)


class Broken(Exception):
    """Raised by a restoring force."""


def overflowing(**options):
    """A double-step subdomain whose load passes all numbers from t = 0.5 on."""
    samples = np.where(np.arange(40) < 5, 0.0, 1e300).reshape(-1, 1)
    load = pm.SampledForce(samples, 0.1, shape=[[1.0], [0.0]])
    scheme = pm.GeneralizedAlpha(0.5)
    return pm.Subdomain([1e-20, 1.0], [1e-20, 1.0], scheme=scheme, force=load, name="a", **options)


def in_a_row(a, restoring, substeps, **options):
    """The coupler of `a` and two explicit masses, the first of them on a restoring force."""
    explicit = dict(scheme=pm.GeneralizedAlpha(0.5, explicit=True), substeps=substeps)
    b = pm.Subdomain([1.0], [1.0], restoring=restoring, name="b", **explicit)
    c = pm.Subdomain([1.0], [1.0], name="c", **explicit)
    ties = [pm.tie(a, [1], b, [0]), pm.tie(b, [0], c, [0])]
    return pm.Coupler([a, b, c], ties, dt=0.1, **options)


@WARNED
@pytest.mark.parametrize("threads", [1, 2, 3])
def test_no_restoring_force_is_evaluated_beyond_a_macro_step_that_fails(threads):
    # "a" is not finite at the end of the macro step from 0.4 on; a thread beside it may not begin
    # the next one, for a rig cannot take back what it was commanded
    times = []

    def restoring(t, u, v):
        times.append(t)
        return 0.1 * u

    a = overflowing()
    coupler = in_a_row(a, restoring, 5, threads=threads, coupling="pm")
    with pytest.raises(pm.InstabilityError) as caught:
        coupler.run(steps=10)
    assert (caught.value.subdomain, caught.value.step) == ("a", 4)
    assert times == [k / 5 * 0.1 for k in range(26)]  # (T1) up to t = 0.5


@WARNED
@pytest.mark.parametrize(
    ("coupling", "threads"), [("pm", 1), ("pm", 2), ("pm", 3), ("gc", 3), ("macro", 2)]
)
def test_the_first_failure_is_raised_though_a_later_step_was_evaluated_meanwhile(coupling, threads):
    # from t = 0.5 on a load that overflows, in the substep of "a" that begins at 0.4 (double step)
    # or 0.45; another thread has evaluated "b" for later substeps
    a = overflowing(substeps=2)

    def breaks(t, u, v):
        if t > 0.455:
            raise Broken
        return 0.1 * u

    coupler = in_a_row(a, breaks, 10, threads=threads, coupling=coupling)
    with pytest.raises(pm.InstabilityError) as caught:
        coupler.run(steps=10, every=2)
    assert (caught.value.subdomain, caught.value.step, coupler.step_count) == ("a", 4, 4)
