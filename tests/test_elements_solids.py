"""Hyperelastic solids: patch tests, matrices by hand, scikit-fem."""

import numpy as np
import pytest
import scipy.sparse as sp
from meshes import moved_inside

from pmalpha import structures

E, NU = 7.0, 0.3
LAM, MU = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
EPS = np.finfo(float).eps
THICKNESS = 0.2


def patch(d, material, plane="strain"):
    """A distorted mesh of a box with edges of 1.5, and which of its nodes are inside."""
    if d == 2:
        grid, t = structures.plate(3, 3, 0.5, E=1.0, nu=0.3, rho=1.0), THICKNESS
    else:
        grid, t = structures.solid(3, 3, 3, 0.5, E=1.0, nu=0.3, rho=1.0), 1.0
    points, inside = moved_inside(grid)
    (elements,) = grid.elements.values()
    options = {"t": t, "plane": plane}
    return structures.nonlinear_solid_on(points, elements, material, rho=1.0, **options), inside


# F of the patch tests: large, and neither symmetric nor diagonal.
STRETCH = np.array([[1.2, 0.3, -0.1], [-0.2, 0.9, 0.15], [0.1, 0.05, 1.1]])


def kirchhoff(F, lam=LAM, mu=MU):
    """P and W by matrices."""
    strain = (F.T @ F - np.eye(len(F))) / 2
    S = lam * np.trace(strain) * np.eye(len(F)) + 2 * mu * strain
    return F @ S, lam / 2 * np.trace(strain) ** 2 + mu * np.sum(strain**2)


def kirchhoff_in_plane_stress(F):
    """The strain E_zz for which S_zz = 0, found from its condition in three dimensions."""
    whole = np.zeros((3, 3))
    whole[:2, :2] = (F.T @ F - np.eye(2)) / 2
    whole[2, 2] = -LAM / (LAM + 2 * MU) * np.trace(whole)
    S = LAM * np.trace(whole) * np.eye(3) + 2 * MU * whole
    assert abs(S[2, 2]) < 10 * EPS * np.abs(S).max()
    return F @ S[:2, :2], LAM / 2 * np.trace(whole) ** 2 + MU * np.sum(whole**2)


def rubber(F):
    """P and W in three dimensions; in plane strain F_zz = 1."""
    d = len(F)
    whole = np.eye(3)
    whole[:d, :d] = F
    J, inverse = np.linalg.det(whole), np.linalg.inv(whole).T
    P = MU * (whole - inverse) + LAM * np.log(J) * inverse
    W = MU / 2 * (np.sum(whole**2) - 3) - MU * np.log(J) + LAM / 2 * np.log(J) ** 2
    return P[:d, :d], W


CASES = [
    (2, structures.StVenantKirchhoff, "strain", kirchhoff),
    (2, structures.StVenantKirchhoff, "stress", kirchhoff_in_plane_stress),
    (2, structures.NeoHookean, "strain", rubber),
    (3, structures.StVenantKirchhoff, "strain", kirchhoff),
    (3, structures.NeoHookean, "strain", rubber),
]


@pytest.mark.parametrize("d, law, plane, by_hand", CASES)
def test_a_constant_deformation_has_its_stress_on_a_distorted_mesh(d, law, plane, by_hand):
    structure, inside = patch(d, law(E, NU), plane)
    (force,) = structure.internal
    X = structure.points
    F = STRETCH[:d, :d]
    u = (X @ (F - np.eye(d)).T).ravel()
    f = force.residual(u).reshape(X.shape)
    P, W = by_hand(F)
    volume = 1.5**d * (THICKNESS if d == 2 else 1.0)
    # rounding of sums over up to 8 elements and Gauss points; stresses are of the size of E
    assert np.abs(f[inside]).max() < 50 * EPS * E
    # the virtual work of a linear field: sum_a f_ai X_aJ = P_iJ V
    np.testing.assert_allclose(f.T @ X, P * volume, atol=100 * EPS * E)
    assert force.potential(u) == pytest.approx(W * volume, rel=1e-13)


@pytest.mark.parametrize("d, law, plane, by_hand", CASES)
def test_inner_nodes_follow_a_constant_deformation_of_the_boundary(d, law, plane, by_hand):
    structure, inside = patch(d, law(E, NU), plane)
    (force,) = structure.internal
    exact = structure.points @ (STRETCH[:d, :d] - np.eye(d)).T
    free = np.flatnonzero(np.repeat(inside, d))
    u = exact.ravel().copy()
    u[free] += 0.02 * np.sin(np.arange(free.size))
    for _ in range(6):  # quadratic: 1e-2, 1e-3, 1e-5, 1e-10, rounding
        f, K, _, _ = force(u)
        u[free] -= sp.linalg.spsolve(sp.csc_array(K[free][:, free]), f[free])
    np.testing.assert_allclose(u, exact.ravel(), atol=100 * EPS)


def test_small_strains_have_a_stress_without_cancellation():
    # at a strain of 1e-9 the force is the linear one to 1e-9, not to the rounding of 1 + 1e-9
    for d in (2, 3):
        for law in (structures.StVenantKirchhoff, structures.NeoHookean):
            structure, _ = patch(d, law(E, NU))
            u = 1e-9 * np.random.default_rng(1).uniform(-1.0, 1.0, structure.n)
            linear = structure.tangent() @ u
            f = structure.internal[0].residual(u)
            np.testing.assert_allclose(f, linear, atol=1e-7 * np.abs(linear).max())
            energy = structure.internal[0].potential(u)
            if law is structures.StVenantKirchhoff:  # of rubber, W is a difference of large numbers
                assert energy == pytest.approx(0.5 * u @ linear, rel=1e-7)


def test_rubber_turned_inside_out_has_no_finite_force_and_no_warning():
    cell = structures.nonlinear_solid(1, 1, 1, 1.0, structures.NeoHookean(E, NU), rho=1.0)
    u = np.zeros((8, 3))
    u[cell.nodes_at(z=1.0), 2] = -1.5
    f, K, _, _ = cell.internal[0](u.ravel())
    assert not np.isfinite(f).all() and not np.isfinite(K.data).all()
    assert not np.isfinite(cell.internal[0].potential(u.ravel()))


def test_kirchhoff_softens_in_strong_compression():
    # uniaxial strain, F = s: P = (lam + 2 mu) s (s^2 - 1) / 2, with its least value at s = 1/sqrt 3
    cell = structures.nonlinear_solid(1, 1, 1, 1.0, structures.StVenantKirchhoff(E, NU), rho=1.0)
    top = cell.nodes_at(z=1.0)
    across = np.zeros(cell.n)
    across[cell.dofs(top, "uz")] = 1.0

    def stiffness(s):
        return across @ cell.tangent((s - 1.0) * across) @ across

    for s in (1.2, 0.9, 0.5):
        modulus = (LAM + 2 * MU) * (3 * s**2 - 1) / 2
        assert stiffness(s) == pytest.approx(modulus, rel=1e-13)
    assert stiffness(1 / np.sqrt(3.0)) == pytest.approx(0.0, abs=1e-13 * LAM)


# ---- scikit-fem -----------------------------------------------------------------------------

CUBE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]


def forms(law):
    """P(H) and its change dP(H, dH) at the quadrature points of scikit-fem."""
    from skfem.helpers import ddot, det, eye, inv, mul, trace, transpose

    def one(H):
        return eye(1.0 + 0.0 * H[0, 0], len(H))

    def kirchhoff_stress(H):
        F = one(H) + H
        strain = 0.5 * (mul(transpose(F), F) - one(H))
        return F, LAM * eye(trace(strain), len(H)) + 2 * MU * strain

    def kirchhoff_change(H, dH):
        F, S = kirchhoff_stress(H)
        strain = 0.5 * (mul(transpose(F), dH) + mul(transpose(dH), F))
        return mul(dH, S) + mul(F, LAM * eye(trace(strain), len(H)) + 2 * MU * strain)

    def rubber_stress(H):
        F = one(H) + H
        inverse = transpose(inv(F))
        return MU * (F - inverse) + LAM * np.log(det(F)) * inverse

    def rubber_change(H, dH):
        F = one(H) + H
        inverse = transpose(inv(F))
        turned = mul(mul(inverse, transpose(dH)), inverse)
        pull = LAM * ddot(inverse, dH) * inverse
        return MU * dH + (MU - LAM * np.log(det(F))) * turned + pull

    if law is structures.NeoHookean:
        return rubber_stress, rubber_change
    return lambda H: mul(*kirchhoff_stress(H)), kirchhoff_change


@pytest.mark.parametrize("law", [structures.StVenantKirchhoff, structures.NeoHookean])
@pytest.mark.parametrize("d", [2, 3])
def test_force_and_tangent_are_those_of_scikit_fem(d, law):
    skfem = pytest.importorskip("skfem")
    from skfem.helpers import ddot, grad

    structure, _ = patch(d, law(E, NU))
    (elements,) = structure.elements.values()
    if d == 2:
        mesh, element = skfem.MeshQuad(structure.points.T, elements.T), skfem.ElementQuad1()
    else:
        order = [CUBE.index(tuple(p)) for p in skfem.MeshHex.init_refdom().p.T.astype(int)]
        mesh = skfem.MeshHex(structure.points.T, elements[:, order].T)
        element = skfem.ElementHex1()
    # degree 2 takes two Gauss points along each axis
    basis = skfem.Basis(mesh, skfem.ElementVector(element), intorder=2)
    stress, change = forms(law)
    u = np.random.default_rng(5).uniform(-0.05, 0.05, structure.n)
    dofs = basis.nodal_dofs.T.ravel()
    theirs = np.zeros(structure.n)
    theirs[dofs] = u
    H = {"H": basis.interpolate(theirs).grad}
    residual = skfem.LinearForm(lambda v, w: ddot(stress(w["H"]), grad(v)))
    tangent = skfem.BilinearForm(lambda du, v, w: ddot(change(w["H"], grad(du)), grad(v)))
    t = THICKNESS if d == 2 else 1.0
    f_theirs = t * residual.assemble(basis, **H)[dofs]
    K_theirs = t * sp.csr_array(tangent.assemble(basis, **H))[dofs][:, dofs]
    f, K, _, _ = structure.internal[0](u)
    # rounding of sums over up to 8 elements and 8 points; F - F^-T cancels a digit
    np.testing.assert_allclose(f, f_theirs, atol=1e-14 * np.abs(K.data).max())
    assert np.abs((K - K_theirs).data).max() < 2e-14 * np.abs(K.data).max()
    assert np.abs(f).max() > 0.01 * np.abs(K.data).max()
