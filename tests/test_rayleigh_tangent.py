"""Rayleigh damping where stiffness is internal forces or springs: the tangent at u0."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import structures

C_M, C_K = 0.3, 0.02
SCHEME = pm.GeneralizedAlpha(0.9)
H = 1e-6  # of differences of forces of size 1 to 10: 1e-9 of truncation and rounding


def dense(A, n):
    return A.toarray() if sp.issparse(A) else np.diag(A) if A.ndim == 1 else A


def hardening(rng, n, unsymmetric=False):
    """A random f(u) of cubic growth with its tangent."""
    B = rng.normal(size=(n + 1, n))
    skew = rng.normal(size=(n, n)) if unsymmetric else np.zeros((n, n))

    def f(t, u, v, q):
        d = B @ u
        skewed = skew - skew.T
        return B.T @ (d + d**3) + skewed @ u, (B.T * (1.0 + 3.0 * d**2)) @ B + skewed

    return f


def slope(f, u):
    """df/du by central differences."""
    columns = [(f(u + H * e) - f(u - H * e)) / (2.0 * H) for e in np.eye(u.size)]
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("unsymmetric", [False, True])
def test_damping_has_the_tangent_of_internal_forces_at_u0(unsymmetric):
    rng = np.random.default_rng(0)
    for n in (1, 3, 5):
        f, u0 = hardening(rng, n, unsymmetric), 0.4 * rng.normal(size=n)
        M, K, own = rng.uniform(1.0, 2.0, n), np.diag(rng.uniform(1.0, 2.0, n)), 0.1 * np.eye(n)
        s = pm.Subdomain(
            M,
            K,
            C=own,
            internal=f,
            rayleigh=(C_M, C_K),
            scheme=SCHEME,
            u0=u0,
            symmetric=not unsymmetric,
        )
        tangent = K + slope(lambda u, f=f: f(0.0, u, None, None)[0], u0)
        expected = own + C_M * np.diag(M) + C_K * tangent
        np.testing.assert_allclose(dense(s.C, n), expected, rtol=0, atol=1e-8 * C_K)


def test_damping_has_the_tangent_of_springs_at_u0():
    """A cubic spring at its deformation, a closed stop, and one that has not yielded."""
    for where in ("internal", "restoring"):
        springs = [
            pm.CubicSpring([[0, 1]], 2.0, 5.0),
            pm.Gap([1], 7.0, 0.1),
            pm.Bilinear([[1, 2]], 3.0, 10.0, 0.1),
        ]
        u0 = np.array([0.2, 0.5, 0.3])
        s = pm.Subdomain(
            np.ones(3), None, **{where: springs}, rayleigh=(C_M, C_K), scheme=SCHEME, u0=u0
        )
        k = 2.0 + 3.0 * 5.0 * 0.3**2
        expected = C_M * np.eye(3) + C_K * np.array(
            [[k, -k, 0.0], [-k, k + 7.0 + 3.0, -3.0], [0.0, -3.0, 3.0]]
        )
        np.testing.assert_allclose(dense(s.C, 3), expected, rtol=0, atol=1e-14)


def test_damping_has_the_estimate_for_a_function_beside_springs():
    """restoring_stiffness is that of springs and function together."""
    s = pm.Subdomain(
        [1.0],
        None,
        restoring=[pm.CubicSpring(0, 2.0, 5.0), lambda t, u, v: 4.0 * u],
        restoring_stiffness=[6.0],
        rayleigh=(C_M, C_K),
        scheme=SCHEME,
        u0=[0.2],
    )
    assert s.C[0] == pytest.approx(C_M + C_K * (2.0 + 3.0 * 5.0 * 0.2**2 + 4.0), rel=1e-14)


def test_modes_of_internal_forces_have_the_damping_ratio_that_was_asked_for():
    """Free vibrations of a chain whose stiffness is internal, in both modes, for some periods:
    the amplitudes fall by exp(-zeta omega t), up to the dispersion of the steps, 1e-4."""
    K, M = np.array([[50.0, -20.0], [-20.0, 20.0]]), np.array([1.0, 2.0])
    squares, shapes = scipy.linalg.eigh(K, np.diag(M))
    omegas = np.sqrt(squares)
    ratios = {2.0 * np.pi / omega: 0.05 for omega in omegas}
    for omega, shape in zip(omegas, shapes.T):
        s = pm.Subdomain(
            M,
            None,
            internal=lambda t, u, v, q: (K @ u, K),
            damping_ratio=ratios,
            scheme=pm.Newmark(),
            u0=1e-3 * shape,
            name="chain",
        )
        steps, dt = 600, 2.0 * np.pi / omega / 200
        h = pm.Coupler([s], dt=dt).run(steps=steps)["chain"]
        energy = 0.5 * np.sum(M * h.v**2, axis=1) + 0.5 * np.sum((h.u @ K) * h.u, axis=1)
        # after whole half periods of the damped motion the energy is that of the amplitude
        t = np.pi * np.arange(1, 6) / (omega * np.sqrt(1.0 - 0.05**2))
        at = np.interp(t, h.t, np.log(energy / energy[0]))
        np.testing.assert_allclose(at, -2.0 * 0.05 * omega * t, rtol=2e-3)


def test_a_structure_and_its_cut_have_the_same_damping():
    """Of a net of cables that are stretched by u0: summed over the subdomains."""
    nodes = np.array([[0.0, 0.0], [1.0, 0.1], [2.0, 0.0], [1.0, 1.0]])
    cells = np.array([[0, 1], [1, 2], [1, 3], [0, 3], [2, 3]])
    net = structures.truss(nodes, cells, EA=3.0, rhoA=1.0)
    fixed = [0, 1, 4, 5]
    u0 = np.zeros(net.n)
    u0[[2, 3, 6, 7]] = [0.05, -0.1, 0.1, 0.2]
    whole = net.subdomain(scheme=SCHEME, fixed=fixed, rayleigh=(C_M, C_K), u0=u0)
    force = net.subdomain(scheme=SCHEME, fixed=fixed).internal.forces
    free = u0[[2, 3, 6, 7]]
    tangent = slope(lambda u: sum(f(0.0, u, 0.0 * u, f.history)[0] for f in force), free)
    expected = C_M * dense(whole.M, 4) + C_K * tangent
    np.testing.assert_allclose(dense(whole.C, 4), expected, rtol=0, atol=1e-8 * C_K)

    labels = [0, 0, 1, 0, 1]
    cut = pm.cut(net, labels, fixed=fixed, scheme=SCHEME, rayleigh=(C_M, C_K), u0=u0)
    total = np.zeros((net.n, net.n))
    for s, dofs in zip(cut.subdomains, cut.dofs.values()):
        total[np.ix_(dofs, dofs)] += dense(s.C, s.n)
    np.testing.assert_allclose(
        total[np.ix_([2, 3, 6, 7], [2, 3, 6, 7])], dense(whole.C, 4), rtol=0, atol=1e-14
    )
