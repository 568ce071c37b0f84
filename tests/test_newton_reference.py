"""The reference of Newton's method against residuals of raw data, and what it needs to be right.

What holds for the package, whose motion is that of the reference, is tested there: linear forces
given as internal ones, prescribed motion, kept tangents, strings at rest, wrong tangents.
"""

from unittest import mock

import newton_chains
import newton_reference
import newton_variants
import numpy as np
import pytest
from newton_problems import (
    bilinear,
    chain,
    contact,
    cubic,
    pendulum,
    pendulum_error,
)
from newton_reference import run
from newton_step import ConvergenceError, Iteration, Newton

TIGHT = Newton(tol=1e-10)


# ---- one step -------------------------------------------------------------------------------


@pytest.mark.parametrize("schedule", newton_chains.SCHEDULES)
def test_every_time_level_is_in_equilibrium_with_the_history_of_its_own_chain(schedule):
    n = 4
    function, values = newton_chains.SCHEDULES[schedule]
    load = lambda t: 20.0 * np.sin(3.0 * t) * np.ones(2 * n - 1)  # noqa: E731
    law = bilinear(1e3, 0.05, 0.02)
    subdomains, L = chain(n, law, history=0.0, force=load, **values)
    result = function(subdomains, L, 0.05, 20, TIGHT)
    for side, (s, x) in enumerate(zip(subdomains, result.subdomains, strict=True)):
        assert abs(x.q[-1]).max() > 0.02  # they have yielded
        back = 2 if s.double else 1
        stride = (len(result.multipliers) - 1) // (len(x.t) - 1)
        for i in range(1, len(x.t)):
            q = x.q[max(i - back, 0)]
            f, _, _, q1 = s.internal(x.t[i], x.u[i], x.v[i], q)
            np.testing.assert_array_equal(x.q[i], q1)
            if stride:  # "macro" records the multipliers at the ends of macro steps only
                residual = (
                    s.M @ x.w[i] + f - s.force(x.t[i]) - L[side].T @ result.multipliers[i * stride]
                )
                assert abs(residual).max() < 1e-7  # forces are about 100


def test_the_initial_state_satisfies_the_equations_and_takes_over_its_history():
    n = 3
    law, u0 = bilinear(1e3, 0.05, 0.02), np.array([0.1, 0.15, 0.3, 0.35, 0.3])
    subdomains, L = chain(n, law, history=0.0, u0=u0, v0=np.arange(5.0))
    result = run(subdomains, L, 0.01, 1, TIGHT)
    total = 0.0
    for s, Li, x in zip(subdomains, L, result.subdomains, strict=True):
        f, _, _, q1 = s.internal(0.0, s.u0, s.v0, s.history)
        np.testing.assert_array_equal(x.q[0], q1)
        # accelerations about 100; least squares of a few unknowns
        np.testing.assert_allclose(s.M @ x.w[0] + f, Li.T @ result.multipliers[0], atol=1e-11)
        total = total + Li @ x.w[0]
    assert abs(total).max() < 1e-11
    # first spring: d = 0.1, so p = d - d_y
    assert result.subdomains[0].q[0, 0] == pytest.approx(0.08, abs=1e-15)


# ---- robustness -----------------------------------------------------------------------------


@pytest.mark.gate
@pytest.mark.parametrize("schedule", ["pm, s = 1", "gc, s = 5", "macro, s = 5"])
def test_bilinear_springs_with_little_hardening_need_the_line_search(schedule):
    function, values = newton_chains.SCHEDULES[schedule]
    law, more, (_, dt), _ = newton_chains.problems()["plastic chain"]
    subdomains, L = chain(newton_chains.N, law, **more, **values)
    function(subdomains, L, dt, 30)
    with (
        mock.patch.object(Iteration, "search", lambda self, s_1: 1.0),
        pytest.raises(ConvergenceError) as caught,
    ):
        function(subdomains, L, dt, 30)
    assert caught.value.iterations == 40
    assert caught.value.subdomain in (0, 1)
    assert 0.0 < caught.value.time <= 30 * dt


# ---- variants that were not chosen ----------------------------------------------------------


@pytest.mark.gate
def test_the_law_of_a_coarse_subdomain_has_to_be_rebased():
    values = {"ss": (1, 5), "double": True}
    error = pendulum_error(run(*pendulum(**values), 0.01, 60))
    opened = newton_variants.without_rebasing
    member = newton_reference.FineMember
    with mock.patch.multiple(member, open=opened, changed=True, create=True):
        without = pendulum_error(run(*pendulum(**values), 0.01, 60))
    # docs/method.md: 0.0036 and 0.017 up to t = 1
    assert error < 0.005
    assert without > 3.0 * error


@pytest.mark.gate
def test_multipliers_fixed_at_closing_give_up_the_constraints():
    def step(members, k, g, newton):
        return newton_variants.single_pass(members, k, g, newton, iterate=True)

    subdomains, L = newton_chains.stiff_chain(rho=0.5)
    dt = 10.0 / newton_chains.OMEGA
    coupled = run(subdomains, L, dt, 30, TIGHT)
    with mock.patch.object(newton_reference, "fine_step", step):
        fixed = run(subdomains, L, dt, 30, TIGHT)
    # the same steps on both sides, so u agrees as v does
    assert abs(coupled.displacement_jump).max() < 1e-12
    assert abs(fixed.displacement_jump).max() > 1e-3


def test_a_contact_law_has_the_tangent_of_its_force():
    # the tables rest on the laws of newton_problems
    d, q, x = np.linspace(-0.3, 0.33, 7), np.full(7, 0.01), 1e-6
    for law in (cubic(2.0, 3.0), contact(5.0, 0.02, 40.0), bilinear(7.0, 0.1, 0.05)):
        numeric = (law(d + x, q)[0] - law(d - x, q)[0]) / (2.0 * x)
        np.testing.assert_allclose(law(d, q)[1], numeric, rtol=1e-8)  # rounding 1e-16 / x
