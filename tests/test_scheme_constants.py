"""A scheme is the nine numbers of its step: one that is not of the generalized-alpha family runs,
and what is derived from the four parameters refuses it by name."""

import warnings

import numpy as np
import pytest
from scipy.linalg import block_diag

import pmalpha as pm
from pmalpha import analysis
from pmalpha.problem.schemes import StepConstants


class BackwardEuler(pm.Scheme):
    """u1 = u + h v1, v1 = v + h w1: no member of the family has u_a = 0 with al1 = h^2."""

    is_generalized_alpha = False
    parameters, order = (), 1

    def __init__(self):
        object.__setattr__(self, "explicit", False)

    def constants(self, h):
        return StepConstants(h, h * h, h, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)

    def __repr__(self):
        return "BackwardEuler()"


FAMILY = [
    pm.Newmark(),
    pm.CentralDifference(),
    pm.GeneralizedAlpha(0.6),
    pm.GeneralizedAlpha(0.3, explicit=True),
    pm.HHT(0.2),
    pm.WBZ(0.4),
    pm.Scheme(-0.2, 0.1, 0.5, 0.7),
]


@pytest.mark.parametrize("scheme", FAMILY, ids=repr)
def test_the_constants_satisfy_the_equations_of_the_family(scheme):
    """(8) as it is written for generalized-alpha, with (9) in it, for random states."""
    h, rng = 0.3, np.random.default_rng(1)
    u, v, w, a, w1 = rng.normal(size=5)
    am, af, beta, gamma = scheme.parameters
    # (1 - am) a1 + am a = (1 - af) w1 + af w
    a1 = ((1.0 - af) * w1 + af * w - am * a) / (1.0 - am)
    expected = [
        u + h * v + h * h * ((0.5 - beta) * a + beta * a1),
        v + h * ((1.0 - gamma) * a + gamma * a1),
        a1,
    ]
    c = scheme.constants(h)
    found = [
        u + h * v + c.u_a * a + c.u_w * w + c.al1 * w1,
        v + c.v_a * a + c.v_w * w + c.al2 * w1,
        c.a_a * a + c.a_w * w + c.a_w1 * w1,
    ]
    # a few roundings of numbers up to 10
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("scheme", FAMILY, ids=repr)
def test_schemes_are_equal_where_their_class_and_steps_are(scheme):
    *three, gamma = scheme.parameters
    same = [pm.Scheme(*three, gamma, explicit=scheme.explicit) for _ in range(2)]
    assert same[0] == same[1] and hash(same[0]) == hash(same[1])
    assert (same[0] == scheme) == (type(scheme) is pm.Scheme)
    assert same[0] != pm.Scheme(*three, gamma + 0.1, explicit=scheme.explicit)
    if scheme.explicit and scheme.beta > 0.0:
        assert same[0] != pm.Scheme(*three, gamma)


def rng_matrices(n, seed):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    B = rng.normal(size=(n, n))
    M, K, C = np.diag(rng.uniform(1.0, 2.0, n)), A @ A.T + np.eye(n), 0.1 * B @ B.T
    return {"M": M, "K": K, "C": C}


def tied(scheme=None, coupling="gc", substeps=(1, 2), **options):
    """Three and two dofs, tied at one."""
    a, b = (
        pm.Subdomain(
            **rng_matrices(n, seed),
            scheme=BackwardEuler() if scheme is None else scheme,
            substeps=count,
            u0=np.zeros(n),
            v0=np.linspace(1.0, 0.5, n),
            name=name,
            **options,
        )
        for n, seed, count, name in zip((3, 2), (1, 2), substeps, "ab")
    )
    return pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.1, coupling=coupling)


def dense_backward_euler(subdomains, h, steps):
    """Both subdomains with equal steps as one system with a multiplier, (steps + 1, 5) u and v."""
    M = np.diag(np.concatenate([s.M for s in subdomains]))
    C, K = (block_diag(*(getattr(s, x) for s in subdomains)) for x in "CK")
    L = np.array([[1.0, 0.0, 0.0, -1.0, 0.0]])
    u, v = (np.concatenate([getattr(s, x) for s in subdomains]) for x in ("u0", "v0"))
    A = np.block([[M + h * C + h * h * K, -L.T], [h * L, np.zeros((1, 1))]])
    us, vs, lams = [u], [v], []
    for _ in range(steps):
        # M w1 + C (v + h w1) + K (u + h (v + h w1)) = L^T lam, L (v + h w1) = 0
        x = np.linalg.solve(A, np.append(-C @ v - K @ (u + h * v), -L @ v))
        v = v + h * x[:-1]
        u = u + h * v
        us.append(u), vs.append(v), lams.append(x[-1])
    return np.array(us), np.array(vs), np.array(lams)


def test_a_scheme_outside_of_the_family_is_that_of_a_dense_system():
    history = tied(substeps=(1, 1)).run(steps=40)
    u, v, lam = dense_backward_euler([s for _, s in history.keys], 0.1, 40)
    # both solve systems of condition below 1e3 in each of 40 damped steps
    close = dict(rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(np.hstack([s.u for s in history.subdomains]), u, **close)
    np.testing.assert_allclose(np.hstack([s.v for s in history.subdomains]), v, **close)
    np.testing.assert_allclose(history.multipliers[1:, 0], lam, **close)
    assert np.abs(lam).max() > 0.1


def test_with_substeps_the_velocities_agree_and_each_subdomain_takes_its_steps():
    history = tied().run(steps=20)
    assert np.abs(history.velocity_jump).max() < 1e-14  # velocities of order 1
    for s, h in zip(history.subdomains, (0.1, 0.05)):
        np.testing.assert_allclose(np.diff(s.u, axis=0), h * s.v[1:], rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(np.diff(s.v, axis=0), h * s.a[1:], rtol=0.0, atol=1e-13)


def test_what_follows_from_the_constants_is_right_for_any_scheme():
    scheme = BackwardEuler()
    assert scheme == BackwardEuler() and hash(scheme) == hash(BackwardEuler())
    assert scheme != pm.Newmark()
    # eigenvalues 1 / (1 +- i Omega) of a step of v' = -Omega^2 u, u' = v
    radius = max(abs(np.linalg.eigvals(scheme.amplification(2.0))))
    assert radius == pytest.approx(1.0 / np.sqrt(5.0), rel=1e-14)
    assert scheme.radius_at_infinity() < 1e-7  # a double eigenvalue 0, by the root of rounding
    one = pm.Subdomain([1.0], [4.0], scheme=scheme)
    assert analysis.critical_step(one) == np.inf
    assert "BackwardEuler(), implicit, of order 1" in one._repr_html_()
    G = analysis.amplification_matrix(pm.Coupler([one], dt=1.0))  # Omega = 2, of the core
    assert max(abs(np.linalg.eigvals(G))) == pytest.approx(radius, rel=1e-14)


REFUSED = "needs a scheme of the generalized-alpha family, got BackwardEuler"


@pytest.mark.parametrize("coupling", ["pm", "macro", "mean"])
def test_couplings_that_were_derived_for_the_family_refuse_another_scheme(coupling):
    with pytest.raises(ValueError, match=f'coupling="{coupling}" {REFUSED}.* of .a.'):
        tied(coupling=coupling)


def contact_of(scheme):
    ball = pm.Subdomain([1.0], [0.0], scheme=scheme, u0=[1.0], name="ball")
    return pm.Coupler([ball], pm.contact(ball, 0), dt=0.01)


def averaged(scheme):
    force = pm.SampledForce(np.ones(10), 0.01, average=True)
    return pm.Coupler([pm.Subdomain([1.0], [1.0], scheme=scheme, force=force)], dt=0.1).run(0.1)


def changed(scheme):
    coupler = tied(scheme)
    coupler.run(0.1)
    coupler.change_steps(dt=0.05)


FEATURES = {
    "double_step=True": lambda x: tied(x, double_step=True),
    'damping="lagged"': lambda x: tied(x, damping="lagged"),
    "energy=True": lambda x: tied(x).run(0.1, energy=True),
    "a change of steps": changed,
    "a contact": contact_of,
    "a force with average=True": averaged,
}


@pytest.mark.parametrize("what", FEATURES)
def test_what_is_derived_from_the_four_parameters_refuses_another_scheme(what):
    with pytest.raises(ValueError, match=what + " " + REFUSED):
        FEATURES[what](BackwardEuler())


# double steps are of other couplings than "gc", which refuse another scheme themselves
@pytest.mark.parametrize("what", [x for x in FEATURES if x != "double_step=True"])
def test_the_same_is_done_for_the_family(what):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.AccuracyWarning)
        FEATURES[what](pm.Newmark())
