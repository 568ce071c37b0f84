"""J2 plasticity: closed forms, an integration of the rate equations, plane strain as a solid."""

import numpy as np
import pytest
import scipy.integrate
import scipy.sparse as sp
import scipy.sparse.linalg

from pmalpha import structures

E, NU, YIELD = 200.0, 0.3, 2.0
KAPPA, MU = E / (3 * (1 - 2 * NU)), E / (2 * (1 + NU))
EPS = np.finfo(float).eps


def cube(**hardening):
    """One element with edges of 1."""
    steel = structures.J2Plasticity(E, NU, YIELD, **hardening)
    return structures.nonlinear_solid(1, 1, 1, 1.0, steel, rho=1.0)


def stress_of(structure, strain, q):
    """Mean stress and history after a homogeneous strain, for a body of volume 1."""
    X = structure.points
    f, _, _, q1 = structure.internal[0]((X @ strain).ravel(), q=q)
    return f.reshape(X.shape).T @ X, q1


def pulled(structure, stretches):
    """Axial force at each elongation along x of a cube that is free to contract."""
    (force,) = structure.internal
    X = structure.points
    held = [structure.dofs(structure.nodes_at(**{a: 0.0}), "u" + a) for a in "xyz"]
    end = structure.dofs(structure.nodes_at(x=1.0), "ux")
    free = np.setdiff1d(np.arange(structure.n), np.concatenate([*held, end]))
    u, q, forces = np.zeros(structure.n), force.history, []
    for stretch in stretches:
        u[end] = stretch
        for _ in range(20):
            f, K, _, q1 = force(u, q=q)
            if np.abs(f[free]).max() < 1e-13 * E * np.abs(stretches).max():
                break
            u[free] -= sp.linalg.spsolve(sp.csc_array(K[free][:, free]), f[free])
        else:
            raise AssertionError("Newton's method has not converged")
        q = q1
        forces.append(f[end].sum())
    assert len(X) == 8
    return np.array(forces)


def test_uniaxial_stress_is_bilinear_with_the_slope_of_the_textbook():
    H = 30.0
    limit = YIELD / E
    stretches = limit * np.array([0.5, 0.9, 1.5, 2.0, 6.0])
    for share in (0.0, 0.4, 1.0):
        forces = pulled(cube(isotropic=share * H, kinematic=(1 - share) * H), stretches)
        # proportional loading: the radial return is exact for any step
        beyond = YIELD + E * H / (E + H) * (stretches - limit)
        expected = np.where(stretches < limit, E * stretches, beyond)
        np.testing.assert_allclose(forces, expected, rtol=1e-12)


def test_reversed_loading_yields_early_with_kinematic_hardening_and_late_with_isotropic():
    H, limit = 30.0, YIELD / E
    slope = E * H / (E + H)
    top = YIELD + slope * 3 * limit
    for options, back in (({"kinematic": H}, top - 2 * YIELD), ({"isotropic": H}, -top)):
        elastic = 4 * limit - (top - back) / E
        path = [4 * limit, elastic + 0.1 * limit, elastic, elastic - 2 * limit]
        forces = pulled(cube(**options), path)
        expected = [top, back + 0.1 * limit * E, back, back - slope * 2 * limit]
        # 1e-12 of the stress, as zero crossings are among the values
        np.testing.assert_allclose(forces, expected, atol=1e-12 * top)


def test_pure_shear_yields_at_the_von_mises_stress():
    H = 30.0
    body = cube(isotropic=H)
    limit = YIELD / np.sqrt(3.0)
    for gamma in (0.5, 1.0, 2.0, 5.0):
        strain = np.zeros((3, 3))
        strain[0, 1] = strain[1, 0] = gamma * limit / MU / 2
        stress, q = stress_of(body, strain, None)
        # tau = G gamma, then with the slope G H / (H + 3 G)
        plastic = max(gamma - 1.0, 0.0)
        expected = limit * (min(gamma, 1.0) + plastic * H / (H + 3 * MU))
        assert stress[0, 1] == pytest.approx(expected, rel=1e-13)
        alpha = q.reshape(8, 7)[:, 6]
        # sigma_y + H alpha = sqrt(3) tau
        grown = max(np.sqrt(3) * expected - YIELD, 0.0) / H
        np.testing.assert_allclose(alpha, grown, rtol=1e-12, atol=1e-16)


def test_unloading_is_elastic_and_keeps_the_history():
    body = cube(isotropic=30.0, kinematic=10.0)
    strain = 0.03 * np.array([[1.0, 0.2, 0.0], [0.2, -0.3, 0.1], [0.0, 0.1, -0.2]])
    loaded, q = stress_of(body, strain, None)
    back, q1 = stress_of(body, 0.95 * strain, q)
    np.testing.assert_array_equal(q1, q)
    change = -0.05 * strain
    elastic = (KAPPA - 2 / 3 * MU) * np.trace(change) * np.eye(3) + 2 * MU * change
    np.testing.assert_allclose(back - loaded, elastic, atol=100 * EPS * E * 0.03)
    u = (body.points @ (0.95 * strain)).ravel()
    linear = structures.solid(1, 1, 1, 1.0, E=E, nu=NU, rho=1.0)
    K = body.internal[0](u, q=q)[1]
    assert np.abs((K - linear.K).data).max() < 20 * EPS * np.abs(linear.K.data).max()


HARDENING = {"isotropic": 25.0, "kinematic": 15.0}
START = 3 * YIELD / E * np.array([[1.0, 0.3, 0.0], [0.3, -0.8, 0.2], [0.0, 0.2, 0.1]])
OTHER = 3 * YIELD / E * np.array([[0.2, 1.0, 0.4], [1.0, 0.2, -0.6], [0.4, -0.6, 0.9]])


def strain_path(s):
    """From START, turning off towards OTHER: not proportional, yielding all the way."""
    return START + np.sin(1.2 * s) * OTHER + (1.0 - np.cos(1.2 * s)) * START


def by_rates():
    """Stress at the end of the path from the rate equations, by an adaptive Runge-Kutta method."""
    Hi, Hk = HARDENING["isotropic"], HARDENING["kinematic"]
    body = cube(**HARDENING)
    _, q = stress_of(body, START, None)  # proportional: exact
    p = q.reshape(8, 7)[0]
    plastic = np.array([[p[0], p[5], p[4]], [p[5], p[1], p[3]], [p[4], p[3], p[2]]])

    def deviator(A):
        return A - np.trace(A) / 3 * np.eye(3)

    def direction(s, plastic):
        xi = 2 * MU * (deviator(strain_path(s)) - plastic) - 2 / 3 * Hk * plastic
        return xi / np.linalg.norm(xi)

    def rates(s, y):
        n = direction(s, y.reshape(3, 3))
        h = 1e-6
        rate = (strain_path(s + h) - strain_path(s - h)) / (2 * h)
        loading = 2 * MU * np.sum(n * rate)
        assert loading > 0.0
        return (loading / (2 * MU + 2 / 3 * (Hi + Hk)) * n).ravel()

    end = scipy.integrate.solve_ivp(
        rates, (0.0, 1.0), plastic.ravel(), method="DOP853", rtol=1e-10, atol=1e-14
    )
    left = strain_path(1.0) - end.y[:, -1].reshape(3, 3)
    return (KAPPA - 2 / 3 * MU) * np.trace(left) * np.eye(3) + 2 * MU * left


def by_steps(steps):
    body = cube(**HARDENING)
    _, q = stress_of(body, START, None)
    for s in np.arange(1, steps + 1) / steps:
        stress, q = stress_of(body, strain_path(s), q)
    return stress


@pytest.mark.gate
def test_the_radial_return_converges_to_the_rate_equations():
    exact = by_rates()
    scale = np.abs(exact).max()
    errors = [np.abs(by_steps(n) - exact).max() / scale for n in (50, 100, 200)]
    assert errors[0] < 0.01 and errors[2] > 1e-6
    # an implicit Euler method: order 1
    np.testing.assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], 2.0, rtol=0.05)


def test_stress_is_never_beyond_the_yield_surface_and_plastic_strain_keeps_the_volume():
    body = cube(**HARDENING)
    _, q = stress_of(body, START, None)
    stress, q = stress_of(body, strain_path(0.7), q)
    p = q.reshape(8, 7)[3]
    plastic = np.array([[p[0], p[5], p[4]], [p[5], p[1], p[3]], [p[4], p[3], p[2]]])
    xi = stress - np.trace(stress) / 3 * np.eye(3) - 2 / 3 * HARDENING["kinematic"] * plastic
    radius = np.sqrt(2 / 3) * (YIELD + HARDENING["isotropic"] * p[6])
    assert np.linalg.norm(xi) == pytest.approx(radius, rel=1e-13)
    assert np.trace(plastic) == pytest.approx(0.0, abs=1e-16)


def test_plane_strain_is_a_layer_of_hexahedra_held_across():
    E_of = np.array([100.0, 150.0, 200.0, 250.0])
    steel = structures.J2Plasticity(E_of, NU, YIELD, **HARDENING)
    flat = structures.nonlinear_solid(2, 2, 0.5, steel, rho=1.0, t=0.5)
    layer = structures.nonlinear_solid(2, 2, 1, 0.5, steel, rho=1.0)
    rng = np.random.default_rng(6)
    q_flat, q_layer = flat.internal[0].history, layer.internal[0].history
    for _ in range(3):
        u = rng.uniform(-0.02, 0.02, (9, 2))
        f, K, _, q_flat = flat.internal[0](u.ravel(), q=q_flat)
        whole = np.zeros((9, 2, 3))  # nodes one above the other follow each other
        whole[:, :, :2] = u[:, None]
        f_layer, K_layer, _, q_layer = layer.internal[0](whole.ravel(), q=q_layer)
        f_layer = f_layer.reshape(9, 2, 3).sum(axis=1)[:, :2]
        np.testing.assert_allclose(f, f_layer.ravel(), atol=50 * EPS * np.abs(f).max())
        K_layer = K_layer.toarray().reshape(9, 2, 3, 9, 2, 3).sum(axis=(1, 4))[:, :2, :, :2]
        K = K.toarray()
        np.testing.assert_allclose(K, K_layer.reshape(18, 18), atol=50 * EPS * np.abs(K).max())
    # xx yy zz xy alpha; the Gauss points of the bottom, then those of the top
    ours, theirs = q_flat.reshape(4, 4, 5), q_layer.reshape(4, 2, 4, 7)
    assert np.all(ours[:, :, 4] > 0.0)
    for side in (0, 1):
        np.testing.assert_allclose(ours, theirs[:, side][:, :, [0, 1, 2, 5, 6]], atol=1e-15)


def test_newton_converges_quadratically_with_the_consistent_tangent():
    steel = structures.J2Plasticity(E, NU, YIELD, isotropic=5.0)
    beam = structures.nonlinear_solid(6, 2, 0.5, steel, rho=1.0)
    (force,) = beam.internal
    free = np.setdiff1d(np.arange(beam.n), beam.dofs(beam.nodes_at(x=0.0)))
    load = np.zeros(beam.n)
    load[beam.dofs(beam.nodes_at(x=3.0), "uy")] = -0.12
    u, sizes = np.zeros(beam.n), []
    for _ in range(12):
        f, K, _, q1 = force(u)
        sizes.append(np.abs((load - f)[free]).max() / 0.12)
        u[free] += sp.linalg.spsolve(sp.csc_array(K[free][:, free]), (load - f)[free])
    assert np.count_nonzero(q1.reshape(12, 4, 5)[:, :, 4]) > 8  # several points yield
    last = next(k for k, size in enumerate(sizes) if size < 1e-8)
    # once the points that yield are found, each residual is below the square of the one before,
    # 2e-3, 1e-7, rounding; without the change of direction in the tangent they gain a digit each
    assert last < 9
    assert all(sizes[k + 1] < sizes[k] ** 2 + 1e-12 for k in (last - 2, last - 1))
