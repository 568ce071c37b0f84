"""The reference of Newton's method compared with the linear reference and residuals of raw data.

What holds for the core, whose motion is that of the reference, is in the tests of the core: orders,
units, robustness, explicit subdomains. Tolerances of Newton's method are 1e-10 where nothing else
is said, so converged results are compared at 1e-8 of their size: iterations that stop differently
differ by the tolerance times the number of steps.
"""

from dataclasses import fields
from unittest import mock

import newton_chains
import newton_reference
import newton_variants
import numpy as np
import pytest
import reference
from newton_problems import (
    bilinear,
    chain,
    contact,
    cubic,
    duffing_pair,
    pendulum,
    pendulum_error,
)
from newton_reference import run, run_macro
from newton_step import ConvergenceError, Iteration, Newton, Nonlinear
from pairwise import in_turn, pairwise
from reference import Subdomain, alpha

TIGHT = Newton(tol=1e-10)
REUSE = Newton(tol=1e-10, tangent="reuse")


def largest_difference(one, other, names="uvwa"):
    return max(
        abs(getattr(x, name) - getattr(y, name)).max()
        for x, y in zip(one.subdomains, other.subdomains, strict=True)
        for name in names
    )


# ---- linear forces --------------------------------------------------------------------------


def three_linear(substeps, double):
    """Three random subdomains in a chain, under harmonic loads."""
    rng = np.random.default_rng(4)

    def matrix(n, scale, shift):
        x = rng.normal(size=(n, n))
        return scale * x @ x.T + shift * np.eye(n)

    subdomains = [
        Subdomain(
            matrix(n, 0.2, 1.0),
            matrix(n, 5.0, 1.0),
            matrix(n, 0.1, 0.0),
            substeps=ss,
            double=twice,
            force=lambda t, n=n: np.cos(3.0 * t) * np.arange(1.0, n + 1.0),
            **alpha(0.5),
        )
        for n, ss, twice in zip((3, 2, 2), substeps, double, strict=True)
    ]
    row = np.eye(2)
    first, second, third = np.zeros((2, 3)), -np.outer(row[0], row[0]), -np.outer(row[1], row[1])
    first[0, 2] = first[1, 0] = 1.0
    return subdomains, [first, second, third]


def as_internal(s, share):
    """The same subdomain with a share of K and C as internal force."""
    K, C, x = s.K, s.C, share
    values = {field.name: getattr(s, field.name) for field in fields(Subdomain)}
    values.update(K=(1.0 - x) * K, C=(1.0 - x) * C)
    return Nonlinear(internal=lambda u, v, t, q: (x * (K @ u + C @ v), x * K, x * C, q), **values)


STEPS_OF_THREE = [
    ((1, 1, 1), (False, False, False)),
    ((1, 4, 2), (False, False, False)),
    ((1, 1, 1), (True, False, False)),
    ((1, 4, 2), (True, False, True)),
]


@pytest.mark.parametrize(
    ("steps", "which", "newton"),
    pairwise(STEPS_OF_THREE, [(0, 1, 2), (0,), (1, 2)], [TIGHT, REUSE]),
)
def test_linear_internal_forces_give_the_linear_reference(steps, which, newton):
    substeps, double = steps
    subdomains, L = three_linear(substeps, double)
    others = [as_internal(s, 0.7) if i in which else s for i, s in enumerate(subdomains)]
    # values up to about 5, some thirty steps: rounding 1e-14; 1e-12 as the sizes allow
    linear, newtons = reference.run(subdomains, L, 0.1, 8), run(others, L, 0.1, 8, newton)
    assert largest_difference(linear, newtons) < 1e-12
    assert abs(linear.multipliers - newtons.multipliers).max() < 1e-12
    assert abs(linear.displacement_jump - newtons.displacement_jump).max() < 1e-12
    # a linear force converges in one iteration, as the next residual shows; a coarse subdomain
    # has a free solution before
    for i in which:
        coarse = substeps[i] < max(substeps)
        assert newtons.subdomains[i].iterations[1:].max() == (2 if coarse else 1)
    if not any(twice and ss > 1 for twice, ss in zip(double, substeps, strict=True)):
        linear = reference.run_macro(subdomains, L, 0.1, 8)
        newtons = run_macro(others, L, 0.1, 8, newton)
        assert largest_difference(linear, newtons) < 1e-12
        assert abs(linear.multipliers - newtons.multipliers).max() < 1e-12
        assert newtons.passes.max() == 2


def test_a_prescribed_motion_is_that_of_the_linear_reference():
    subdomains, L = three_linear((1, 1, 1), (False, False, False))
    g = lambda t: np.array([t**2, 0.0])  # noqa: E731
    linear = reference.run_macro(subdomains, L, 0.1, 20, g)
    others = [as_internal(s, 1.0) for s in subdomains]
    for function in (run_macro, run):  # "gc" with s = 1 is "macro" with s = 1
        newtons = function(others, L, 0.1, 20, TIGHT, g)
        assert largest_difference(linear, newtons) < 1e-12
        assert abs(newtons.velocity_jump).max() < 1e-12


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
            f, _, _, q1 = s.internal(x.u[i], x.v[i], x.t[i], q)
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
        f, _, _, q1 = s.internal(s.u0, s.v0, 0.0, s.history)
        np.testing.assert_array_equal(x.q[0], q1)
        # accelerations about 100; least squares of a few unknowns
        np.testing.assert_allclose(s.M @ x.w[0] + f, Li.T @ result.multipliers[0], atol=1e-11)
        total = total + Li @ x.w[0]
    assert abs(total).max() < 1e-11
    # first spring: d = 0.1, so p = d - d_y
    assert result.subdomains[0].q[0, 0] == pytest.approx(0.08, abs=1e-15)


# ---- constraints ----------------------------------------------------------------------------


def test_macro_without_substeps_is_gc():
    subdomains, L = duffing_pair()
    one, other = run(subdomains, L, 0.01, 30, TIGHT), run_macro(subdomains, L, 0.01, 30, TIGHT)
    assert largest_difference(one, other, "uv") < 1e-7  # v up to 10, (N16) with 10 tol
    assert 0.0 < abs(other.velocity_jump).max() < 1e-7


@pytest.mark.parametrize(
    ("schedule", "problem"),
    in_turn(["pm, s = 5", "gc, s = 1"], "plastic chain", "stiff cubic chain"),
)
def test_kept_tangents_give_the_results_of_fresh_ones(schedule, problem):
    function, values = newton_chains.SCHEDULES[schedule]
    law, more, (dt, _), _ = newton_chains.problems()[problem]
    results = []
    for newton in (TIGHT, REUSE):
        subdomains, L = chain(newton_chains.N, law, **more, **values)
        results.append(function(subdomains, L, dt, 6, newton))
    size = max(abs(x.u).max() for x in results[0].subdomains)
    assert largest_difference(*results, "u") < 1e-7 * size  # errors accumulate over 6 steps
    fresh, kept = (sum(x.iterations.sum() for x in y.subdomains) for y in results)
    assert kept > fresh


# ---- robustness -----------------------------------------------------------------------------


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


def prestressed(ss, double, grounded):
    """Two equal strings under tension at u = 0, tied end to end or each between supports."""
    m, X = 3, np.outer(np.arange(5), [1.1, 0.7])
    count = m if grounded else m + 1  # free nodes behind the support at X[0]

    def evaluate(u, v, t, q):
        x = X.copy()
        x[1 : count + 1] += u.reshape(count, 2)
        f, K = np.zeros(10), np.zeros((10, 10))
        for i in range(4):
            d = x[i + 1] - x[i]
            length, rest = np.linalg.norm(d), 0.99 * np.hypot(1.1, 0.7)
            c, N = d / length, 1e7 * (length / rest - 1.0)
            k = 1e7 / rest * np.outer(c, c) + N / length * (np.eye(2) - np.outer(c, c))
            ends = slice(2 * i, 2 * i + 4)
            f[ends] += np.concatenate([-N * c, N * c])
            K[ends, ends] += np.block([[k, -k], [-k, k]])
        free = slice(2, 2 + 2 * count)
        return f[free], K[free, free], np.zeros((2 * count, 2 * count)), q

    def mirrored(u, v, t, q):
        f, K, C, q1 = evaluate(-u, -v, t, q)
        return -f, K, C, q1

    n = 2 * count
    subdomains = [
        Nonlinear(
            M=np.eye(n),
            K=np.zeros((n, n)),
            internal=internal,
            substeps=ss[side],
            double=double and side == 0,
            **alpha(0.5),
        )
        for side, internal in enumerate((evaluate, evaluate if grounded else mirrored))
    ]
    tie = np.eye(n)[-2:]
    return subdomains, [tie, -tie]


@pytest.mark.parametrize(
    ("schedule", "grounded", "tangent"),
    [
        ("gc, s = 1", False, "full"),
        ("pm, s = 5", True, "reuse"),
        ("macro, s = 1", True, "full"),
        ("macro, double step", False, "reuse"),
    ],
)
def test_a_prestressed_string_at_rest_stays_at_rest(schedule, grounded, tangent):
    # no energy scale, and no force except in the constraint: corrections are rounding, (N9)
    function, values = newton_chains.SCHEDULES[schedule]
    double = values.get("double", False)
    subdomains, L = prestressed(values.get("ss", (1, 1)), double, grounded)
    for s, sign in zip(subdomains, (1.0, 1.0 if grounded else -1.0), strict=True):
        # a load after the first 5 steps
        load = np.full(len(s.M), sign * 1e3)
        s.force = lambda t, load=load: load * (t > 0.055)
    result = function(subdomains, L, 0.01, 8, Newton(tangent=tangent))
    for x in result.subdomains:
        still = x.t < 0.045
        # rounding 1e-16 of the tension, 1e5, and its multiple h^2 in u
        assert abs(x.u[still]).max() < 1e-12
        assert abs(x.u).max() > 1e-4
        assert x.iterations[2:].max() < 60


def test_a_wrong_tangent_is_not_taken_for_rounding():
    def law(d, q):
        return 1e4 * d, np.full(len(d), 4e4), q  # each correction leaves three quarters

    subdomains, L = chain(3, law, u0=np.linspace(0.2, 1.0, 5))
    with pytest.raises(ConvergenceError):
        run(subdomains, L, 0.5, 1)
    assert run(subdomains, L, 0.5, 1, Newton(iterations=200)).subdomains[0].iterations[1] > 40


# ---- variants that were not chosen ----------------------------------------------------------


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
