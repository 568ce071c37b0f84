"""Tangents Mbar_t that are indefinite, where Newton's method goes through.

A double pendulum of stiff bars, whose geometric stiffness in compression is negative, with steps of
up to 1/25 s: compared with Newton's method for the trapezoidal rule by a plain LU of NumPy.
"""

import functools

import numpy as np
import pytest

import pmalpha as pm

EA, GRAVITY, END, ANGLE = 2e5, 9.81, 2.0, 1.5
WEIGHT = np.array([0.0, -GRAVITY])
ALONG = np.array([np.cos(ANGLE), np.sin(ANGLE)])  # of both bars at the start


def bar(x):
    """Force at the end of a bar of length 1 that leads to x, and its tangent."""
    length = np.linalg.norm(x)
    c, N = x / length, EA * (length - 1.0)
    return N * c, EA * np.outer(c, c) + N / length * (np.eye(2) - np.outer(c, c))


def upper(t, u, v, q):
    return bar(ALONG + u)


def lower(t, u, v, q):
    f, K = bar(ALONG + u[2:] - u[:2])
    return np.concatenate([-f, f]), np.block([[K, -K], [-K, K]])


def both(t, u, v, q):
    f, K = lower(t, u, v, q)
    p, k = upper(t, u[:2], v, q)
    f[:2] += p
    K[:2, :2] += k
    return f, K


@functools.cache
def with_lu(steps):
    """u and v after END, u1 = u0 + h (v0 + v1) / 2, v1 = v0 + h (a0 + a1) / 2.

    And the number of iterations with an indefinite matrix.
    """
    h, u, v, indefinite = END / steps, np.zeros(4), np.zeros(4), 0
    F = np.tile(WEIGHT, 2)
    a = F - both(0.0, u, v, None)[0]
    for _ in range(steps):
        u0, v0, a0 = u, v, a
        v = v0
        for _ in range(30):
            u = u0 + 0.5 * h * (v0 + v)
            a = 2.0 * (v - v0) / h - a0
            f, K = both(0.0, u, v, None)
            A = np.eye(4) + 0.25 * h * h * K
            indefinite += np.linalg.eigvalsh(A)[0] < 0.0
            dv = np.linalg.solve(A, 0.5 * h * (F - f - a))
            v = v + dv
            if abs(dv).max() < 1e-13:
                break
        else:
            raise AssertionError("no convergence")
        u, a = u0 + 0.5 * h * (v0 + v), 2.0 * (v - v0) / h - a0
    return u, v, indefinite


TRAPEZOIDAL = pm.GeneralizedAlpha(1.0)
MASSES = np.array([0.5, 0.5]), np.array([0.5, 0.5, 1.0, 1.0])


def whole(steps, **options):
    s = pm.Subdomain(
        np.ones(4), None, scheme=TRAPEZOIDAL, internal=both, force=np.tile(WEIGHT, 2), name="B"
    )
    return pm.Coupler([s], dt=END / steps, **options)


def cut(steps, coupling, ss=(1, 1), tangent="full"):
    """The upper bar with half of the middle mass, and the lower one."""
    A, B = (
        pm.Subdomain(
            M, None, scheme=TRAPEZOIDAL, internal=internal, force=M * np.tile(WEIGHT, len(M) // 2),
            substeps=s, double_step=False, name=name,
        )
        for name, M, internal, s in zip("AB", MASSES, (upper, lower), ss)
    )  # fmt: skip
    newton = pm.Newton(tol=1e-10, tangent=tangent)
    tie = pm.tie(A, [0, 1], B, [0, 1])
    return pm.Coupler([A, B], tie, dt=END / steps, coupling=coupling, newton=newton)


@pytest.mark.gate
def test_a_pendulum_of_stiff_bars_moves_as_with_a_plain_lu():
    ends = []
    for steps in (50, 100, 200):
        u, v, indefinite = with_lu(steps)
        assert (indefinite > 0) == (steps == 50)
        c = whole(steps, newton=pm.Newton(tol=1e-12))
        c.run(steps=steps)
        # iterations of both end at 1e-12 in each step; errors grow by less than 1e3 in 2 s
        np.testing.assert_allclose(c.state("B").u, u, rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(c.state("B").v, v, rtol=0.0, atol=1e-7)
        ends.append(u)
    differences = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    assert 1.9 < np.log2(differences[0] / differences[1]) < 2.3


@pytest.mark.gate
@pytest.mark.parametrize(
    ("coupling", "tangent"),
    [("gc", "reuse"), ("pm", "full"), ("macro", "reuse"), ("mean", "full")],
)
def test_a_pendulum_cut_in_two_moves_as_one(coupling, tangent):
    # "mean" with one substep on each side is the uncut scheme too; multipliers to 1e-10 of the
    # motion there and under "macro", which 50 steps magnify
    c = cut(50, coupling, tangent=tangent)
    c.run(steps=50)
    np.testing.assert_allclose(c.state("B").u, with_lu(50)[0], rtol=0.0, atol=1e-4)


@pytest.mark.gate
@pytest.mark.parametrize("coupling, ss", [("gc", (2, 1)), ("macro", (1, 2))])
def test_substeps_go_through_indefinite_tangents(coupling, ss):
    exact = with_lu(200)[0]
    errors = []
    for steps in (50, 100):
        c = cut(steps, coupling, ss)
        c.run(steps=steps)
        errors.append(np.linalg.norm(c.state("B").u - exact))
    assert errors[1] < errors[0] / 1.8  # a half of it at least: order 1 in the limit


@pytest.mark.gate
def test_an_indefinite_tangent_of_many_dofs_is_factored_in_panels():
    n, steps = 48, 50
    Q = np.linalg.qr(np.random.default_rng(0).normal(size=(n, n)))[0]
    mixed = Q[:, :4]  # the pendulum in a rotated space with free masses beside it

    def internal(t, u, v, q):
        f, K = both(t, mixed.T @ u, None, q)
        K = mixed @ K @ mixed.T
        return mixed @ f, 0.5 * (K + K.T)

    load = mixed @ np.tile(WEIGHT, 2)
    s = pm.Subdomain(np.ones(n), None, scheme=TRAPEZOIDAL, internal=internal, force=load, name="B")
    c = pm.Coupler([s], dt=END / steps, newton=pm.Newton(tol=1e-12))
    c.run(steps=steps)
    np.testing.assert_allclose(mixed.T @ c.state("B").u, with_lu(steps)[0], rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro", "mean"])
def test_a_start_with_an_indefinite_tangent(coupling):
    # m = 1, k1 = -3 / al1 at u = 0: Mbar_t = -2 at the start, and the motion falls to the branch
    # where the cubic term holds it. One mass of 1, or two of 1/2 that are tied
    dt = 0.1
    al1 = TRAPEZOIDAL.coefficients(dt)[0]
    k = 3.0 / al1

    def mass(share, name):
        def internal(t, u, v, q):
            return share * k * (u**3 - u), share * k * (3.0 * u**2 - 1.0)

        how = dict(scheme=TRAPEZOIDAL, internal=internal, v0=[1.0], double_step=False)
        return pm.Subdomain([share], None, name=name, **how)

    alone = pm.Coupler([mass(1.0, "a")], dt=dt)
    a, b = mass(0.5, "a"), mass(0.5, "b")
    c = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=dt, coupling=coupling)
    alone.run(steps=3)
    c.run(steps=3)
    np.testing.assert_allclose(c.state("a").u, alone.state("a").u, rtol=0.0, atol=1e-5)
