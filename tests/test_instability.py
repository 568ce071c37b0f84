"""Runs whose numbers leave the range of numbers: what is raised, and where the run ends."""

import numpy as np
import pytest

import pmalpha as pm

pytestmark = [
    pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning"),
    pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning"),
]


class Broken(Exception):
    """Raised by a restoring force."""


def overflowing():
    """A double-step subdomain whose load passes all numbers from t = 0.5 on."""
    samples = np.where(np.arange(40) < 5, 0.0, 1e300).reshape(-1, 1)
    load = pm.SampledForce(samples, 0.1, shape=[[1.0], [0.0]])
    scheme = pm.GeneralizedAlpha(0.5)
    return pm.Subdomain([1e-20, 1.0], [1e-20, 1.0], scheme=scheme, force=load, name="a")


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_no_restoring_force_is_evaluated_beyond_a_macro_step_that_fails(threads):
    # "a" is not finite at the end of the macro step from 0.4 on; a thread beside it may not begin
    # the next one, for a rig cannot take back what it was commanded
    times = []

    def restoring(u, v, t):
        times.append(t)
        return 0.1 * u

    a = overflowing()
    explicit = dict(scheme=pm.GeneralizedAlpha(0.5, explicit=True), substeps=5)
    b = pm.Subdomain([1.0], [1.0], restoring=restoring, name="b", **explicit)
    c = pm.Subdomain([1.0], [1.0], name="c", **explicit)
    ties = [pm.tie(a, [1], b, [0]), pm.tie(b, [0], c, [0])]
    coupler = pm.Coupler([a, b, c], ties, dt=0.1, threads=threads, coupling="pm")
    with pytest.raises(pm.InstabilityError) as caught:
        coupler.run(steps=10)
    assert (caught.value.subdomain, caught.value.step) == ("a", 4)
    assert times == [k / 5 * 0.1 for k in range(26)]  # (T1) up to t = 0.5


@pytest.mark.parametrize("coupling", ["pm", "gc", "macro"])
@pytest.mark.parametrize("threads", [1, 2, 3])
def test_the_first_failure_is_raised_though_a_later_step_was_evaluated_meanwhile(coupling, threads):
    # from t = 0.5 on a load that overflows, in the substep of "a" that begins at 0.4 (double step)
    # or 0.45; another thread has evaluated "b" for later substeps
    samples = np.where(np.arange(40) < 5, 0.0, 1e300).reshape(-1, 1)
    load = pm.SampledForce(samples, 0.1, shape=[[1.0], [0.0]])
    a = pm.Subdomain(
        [1e-20, 1.0],
        [1e-20, 1.0],
        scheme=pm.GeneralizedAlpha(0.5),
        substeps=2,
        force=load,
        name="a",
    )

    def breaks(u, v, t):
        if t > 0.455:
            raise Broken
        return 0.1 * u

    explicit = dict(scheme=pm.GeneralizedAlpha(0.5, explicit=True), substeps=10)
    b = pm.Subdomain([1.0], [1.0], restoring=breaks, name="b", **explicit)
    c = pm.Subdomain([1.0], [1.0], name="c", **explicit)
    ties = [pm.tie(a, [1], b, [0]), pm.tie(b, [0], c, [0])]
    coupler = pm.Coupler([a, b, c], ties, dt=0.1, coupling=coupling, threads=threads)
    with pytest.raises(pm.InstabilityError) as caught:
        coupler.run(steps=10, every=2)
    assert (caught.value.subdomain, caught.value.step, coupler.step_count) == ("a", 4, 4)
