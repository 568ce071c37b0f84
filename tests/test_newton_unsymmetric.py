"""Newton's method with unsymmetric tangents, `symmetric=False`; section 14 of docs/method.md."""

import numpy as np
import pytest
import scipy.sparse as sp
from compiled import INTERNAL
from newton_coupled import assert_agrees, coupler, same_bits
from newton_problems import bilinear, chain, cubic, springs
from newton_step import Nonlinear
from reference import alpha
from scipy import LowLevelCallable
from scipy.integrate import solve_ivp
from test_newton import SCHEDULES, both, doubled, iterations_agree

import pmalpha as pm

pytestmark = pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")

N = 4
V0 = np.random.default_rng(1).normal(size=2 * N - 1)
HALF = pm.GeneralizedAlpha(0.5)


def whirling(internal, n, size=1.0):
    """An internal force with circulatory and gyroscopic terms beside, which have no potential."""
    rng = np.random.default_rng(n)
    A, G = size * rng.normal(size=(n, n)), size * rng.normal(size=(n, n))
    G = G - G.T

    def evaluate(t, u, v, q):
        f, K, C, q1 = internal(t, u, v, q)
        f = f + A @ np.sin(u) + G @ (v + v**3)
        return f, K + A * np.cos(u), C + G * (1.0 + 3.0 * v**2), q1

    evaluate.is_unsymmetric = True
    return evaluate


def whirling_chain(law, n=N, size=1.0, **values):
    subdomains, L = chain(n, law, **values)
    for s in subdomains:
        s.internal = whirling(s.internal, n, size)
    return subdomains, L


LAWS = {"cubic": (cubic(1.0, 1e3), None), "plastic": (bilinear(1e3, 0.05, 0.01), 0.0)}


@pytest.mark.parametrize(
    ("coupling", "double", "ss", "law", "tangent"),
    [
        (*schedule, list(LAWS)[i % 2], ("full", "reuse")[i // 2 % 2])
        for i, schedule in enumerate(SCHEDULES)
    ],
)
def test_chains_move_and_iterate_as_in_the_reference(coupling, double, ss, law, tangent):
    """1e-9 and, where Broyden's matrix magnifies rounding, 1e-7: as in test_newton.py."""
    force, q = LAWS[law]
    subdomains, L = whirling_chain(force, history=q, ss=ss, v0=V0)
    subdomains = doubled(subdomains, double, ss)
    ours, theirs = both(subdomains, L, 0.01, 6, coupling, pm.Newton(tangent=tangent))
    iterations_agree(ours, theirs)
    assert_agrees(ours, theirs, 1e-7 if coupling == "macro" else 1e-9)


@pytest.mark.parametrize(
    ("n", "form"), [(2, "dense"), (3, "sparse"), (12, "dense"), (40, "sparse"), (40, "dense")]
)
def test_bands_and_panels_iterate_as_in_the_reference(n, form):
    """Full tangents: bands up to a width of 32, panels above."""
    values = np.random.default_rng(n).normal(size=2 * n - 1)
    subdomains, L = whirling_chain(cubic(10.0, 1e3), n, 0.3, v0=values)
    ours, theirs = both(subdomains, L, 0.01, 5, "gc", pm.Newton(), form=form)
    iterations_agree(ours, theirs)
    assert_agrees(ours, theirs, 1e-9)


def conveyed(n):
    """A long chain with springs that pull on one neighbour more than on the other, a band."""

    def evaluate(t, u, v, q):
        d = np.diff(np.append(0.0, u))
        f = np.zeros(n)
        force, k = 100.0 * d + 1e3 * d**3, 100.0 + 3e3 * d**2
        f += force
        f[:-1] -= 0.8 * force[1:]
        K = np.diag(k) - np.diag(k[1:], -1)
        K[:-1, :-1] += np.diag(0.8 * k[1:])
        K[:-1, 1:] -= np.diag(0.8 * k[1:])
        return f, K, np.zeros((n, n)), q

    evaluate.is_unsymmetric = True
    return evaluate


@pytest.mark.parametrize("coupling", ["gc", "macro"])
def test_a_band_and_many_constraints_are_those_of_the_reference(coupling):
    """20 ties: the compliance is computed by BLAS, all columns at once."""
    n = 24
    rng = np.random.default_rng(3)
    tied = slice(4, n)
    L = np.zeros((n - 4, n))
    L[:, tied] = np.eye(n - 4)
    v0 = 0.1 * rng.normal(size=n)
    v0[:4] = 0.0
    row = springs([(i - 1, i) for i in range(n)], cubic(50.0, 1e3))
    how = dict(M=np.eye(n), K=np.zeros((n, n)), v0=v0, **alpha(0.5))
    subdomains = [Nonlinear(internal=conveyed(n), **how)]
    subdomains.append(Nonlinear(internal=whirling(row, n, 0.1), substeps=2, **how))
    ours, theirs = both(subdomains, [L, -L], 0.01, 4, coupling, pm.Newton(), form="sparse")
    assert_agrees(ours, theirs, 1e-7 if coupling == "macro" else 1e-9)
    assert len(ours.multipliers[0]) == 20


def test_threads_are_bitwise_the_same():
    subdomains, L = whirling_chain(cubic(1.0, 1e3), ss=(1, 5), v0=V0)
    runs = [
        coupler(doubled(subdomains, True, (1, 5)), L, 0.01, "pm", threads=threads).run(steps=20)
        for threads in (1, 3)
    ]
    same_bits(*runs)


def test_a_follower_force_has_order_two():
    """A double pendulum with a force along its last bar (Ziegler), dashpots and gravity left out,
    cut at its joint into one dof each; DOP853 with a tolerance of 1e-12."""
    k, P, c = 1.0, 1.2, 0.1

    chain = np.array([[2.0, -1.0], [-1.0, 1.0]])

    def evaluate(t, u, v, q):
        # linearized inertia, nonlinear springs and follower force: M u'' + f(u, v) = 0
        d = u[1] - u[0]
        f = chain @ (k * u + c * v) + [P * np.sin(d), 0.3 * d**3]
        return f, k * chain + np.outer([P * np.cos(d), 0.9 * d**2], [-1.0, 1.0]), c * chain

    def rates(t, x):
        return np.append(x[2:], -np.linalg.solve(M, evaluate(t, x[:2], x[2:], None)[0]))

    M, u0, v0 = np.array([[3.0, 1.0], [1.0, 1.0]]), [0.3, -0.2], [0.0, 0.5]
    exact = solve_ivp(rates, (0.0, 4.0), [*u0, *v0], "DOP853", rtol=1e-12, atol=1e-13).y[:2, -1]
    how = dict(scheme=pm.GeneralizedAlpha(0.6), u0=u0, v0=v0, symmetric=False)
    s, errors = pm.Subdomain(M, None, internal=evaluate, **how), []
    for steps in (200, 400):
        errors.append(np.max(np.abs(pm.solve(s, 4.0 / steps, 4.0).u[-1] - exact)))
    assert abs(np.log2(errors[0] / errors[1]) - 2.0) < 0.05
    assert errors[1] < 1e-3


# ---- tangents that become unsymmetric ------------------------------------------------------------


def late(t, u, v, q):
    """Circulatory from t = 0.35 on."""
    g = 0.5 if t > 0.35 else 0.0
    K = np.array([[4.0, g], [-g, 4.0]])
    return K @ u, K


def compiled_late(t, n, u, v, q, f, K, C, q1, user):
    g = 0.5 if t > 0.35 else 0.0
    f[0], f[1] = 4.0 * u[0] + g * u[1], 4.0 * u[1] - g * u[0]
    if K:
        K[0], K[1], K[2], K[3] = 4.0, g, -g, 4.0
    return 0


KINDS = {"Python": lambda: late, "compiled": lambda: LowLevelCallable(INTERNAL(compiled_late))}


def turning(kind, symmetric):
    force = pm.InternalForce(KINDS[kind](), pattern=sp.csr_array(np.ones((2, 2))))
    how = dict(scheme=HALF, internal=force, v0=[1.0, 0.0], symmetric=symmetric, name="seal")
    s = pm.Subdomain([1.0, 1.0], None, **how)
    other = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), v0=[1.0], name="other")
    return pm.Coupler([s, other], pm.tie(s, 0, other, 0), dt=0.1, coupling="gc")


@pytest.mark.parametrize("kind", KINDS)
def test_a_tangent_that_becomes_unsymmetric_is_an_error_at_its_time(kind):
    """Half of it would be left out without a word; the state stays that of the last macro step."""
    coupler = turning(kind, True)
    with pytest.raises(ValueError, match=r"'seal'.* t = 0.4.*symmetric=False"):
        coupler.run(steps=10)
    assert coupler.step_count == 3
    np.testing.assert_array_equal(coupler.state("seal").u, coupler.last_history["seal"].u[-1])
    admitted = turning(kind, False)
    admitted.step(10)
    assert np.max(np.abs(admitted.state("seal").u)) > 0.01


def test_compiled_and_python_tangents_are_bitwise_the_same():
    same_bits(*(turning(kind, False).run(steps=10) for kind in KINDS))


def test_entries_of_one_side_alone_are_unsymmetric():
    """A pattern with (0, 1) and without (1, 0)."""
    pattern = sp.csr_array(np.array([[1.0, 1.0], [0.0, 1.0]]))

    def law(t, n, u, v, q, f, K, C, q1, user):
        g = 0.5 if t > 0.05 else 0.0
        f[0], f[1] = 4.0 * u[0] + g * u[1], 4.0 * u[1]
        if K:
            K[0], K[1], K[2] = 4.0, g, 4.0
        return 0

    force = pm.InternalForce(LowLevelCallable(INTERNAL(law)), pattern=pattern)
    options = dict(scheme=HALF, internal=force, v0=[0.0, 1.0], name="x")
    with pytest.raises(ValueError, match="'x' must be symmetric"):
        pm.solve(pm.Subdomain([1.0, 1.0], None, **options), 0.1, 1.0)
    K = [[4.0, 0.5], [0.0, 4.0]]
    linear = pm.Subdomain([1.0, 1.0], K, scheme=HALF, v0=[0.0, 1.0], symmetric=False)
    ours = pm.solve(pm.Subdomain([1.0, 1.0], None, symmetric=False, **options), 0.1, 1.0)
    assert np.max(np.abs(ours.u - pm.solve(linear, 0.1, 1.0).u)) < 1e-12


# ---- statics -------------------------------------------------------------------------------------


def test_a_static_equilibrium_with_an_unsymmetric_tangent_stays_at_rest():
    """Springs and a follower load on two dofs, tied to a linear one; residual of the raw data."""

    def evaluate(t, u, v, q):
        d = u[1] - u[0]
        f = np.array([3.0 * u[0] - d + 0.4 * np.sin(d), d + d**3])
        K = np.array(
            [[4.0 - 0.4 * np.cos(d), -1.0 + 0.4 * np.cos(d)], [-1.0 - 3 * d**2, 1.0 + 3 * d**2]]
        )
        return f, K

    how = dict(internal=evaluate, force=[0.5, 1.0], symmetric=False)
    a = pm.Subdomain([1.0, 1.0], None, scheme=HALF, name="a", **how)
    b = pm.Subdomain([1.0], [0.5], scheme=HALF, force=[0.25], name="b")
    c = pm.Coupler([a, b], pm.tie(a, 1, b, 0), dt=0.05, coupling="gc")
    u = c.static()
    f = evaluate(0.0, u["a"], None, None)[0]
    residual = [0.5 - f[0], 1.25 - f[1] - 0.5 * u["b"][0]]
    assert np.max(np.abs(residual)) < 1e-12 and abs(u["a"][1] - u["b"][0]) < 1e-14
    c.reset(u0=u)
    assert np.max(np.abs(c.run(steps=40)["a"].v)) < 1e-10
