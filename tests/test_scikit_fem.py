"""The section of docs/other-programs.md: its forms are a force and its tangent."""

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import structures

skfem = pytest.importorskip("skfem")

PAGE = Path(__file__).parent.parent / "docs" / "other-programs.md"
LAM, MU = 1.4e6, 0.36e6
E, NU = MU * (3 * LAM + 2 * MU) / (LAM + MU), LAM / (2 * (LAM + MU))
STRETCH = np.array([[1.2, 0.3], [-0.2, 0.9]])


@pytest.fixture(scope="module")
def page():
    """The names of the programs of the page, which were run."""
    names = {}
    section = re.search(r"\n## scikit-fem\n(.*?)\n## ", PAGE.read_text(), re.DOTALL)[1]
    for program in re.findall(r"```python\n(.*?)```", section, re.DOTALL):
        exec(compile(program, PAGE.name, "exec"), names)
    return names


@pytest.mark.gate
def test_the_tangent_of_the_page_is_the_derivative_of_its_force(page):
    evaluate, n = page["evaluate"], len(page["free"])
    rng = np.random.default_rng(1)
    u, direction = rng.uniform(-1e-3, 1e-3, n), rng.uniform(-1.0, 1.0, n)
    f, K = evaluate(0.0, u, np.zeros(n), np.zeros(0))
    h = 1e-7
    sides = [evaluate(0.0, u + s * h * direction, None, None)[0] for s in (1, -1)]
    # central differences: rounding of f over h, and h^2 over the square of an edge, both 1e-9
    expected = (sides[0] - sides[1]) / (2 * h)
    np.testing.assert_allclose(K @ direction, expected, atol=1e-7 * np.abs(expected).max())
    assert np.abs(f).max() > 1e-5 * np.abs(K.data).max()  # not at rest
    assert page["M"].shape == K.shape == (n, n)


def test_the_page_loads_and_holds_the_ends_of_its_strip(page):
    basis, free, end = (page[name] for name in ("basis", "free", "end"))
    # quadratic elements: 5 nodes along each end of two edges
    assert len(end) == 5 and np.isin(end, free).all()
    np.testing.assert_allclose(basis.doflocs[0, end], 0.4, rtol=1e-15)
    fixed = np.setdiff1d(np.arange(basis.N), free)
    assert len(fixed) == 10 and not basis.doflocs[0, fixed].any()
    # the mass of the strip, in two directions, without what is carried by the held end
    total = 2 * 1100.0 * 0.4 * 0.1
    assert 0.9 * total < page["M"].sum() < total


def test_a_constant_deformation_of_quadratic_triangles_has_its_stress(page):
    basis = page["basis"]
    every, X = np.arange(basis.N), basis.doflocs
    axis = np.full(basis.N, -1)
    for i in (0, 1):
        axis[basis.get_dofs(elements=np.arange(basis.mesh.nelements)).all(f"u^{i + 1}")] = i
    assert set(axis) == {0, 1}
    u = ((STRETCH - np.eye(2)) @ X)[axis, every]
    f, _ = page["neo_hookean"](basis, LAM, MU, every)(0.0, u, None, None)
    inverse = np.linalg.inv(STRETCH).T
    P = MU * (STRETCH - inverse) + LAM * np.log(np.linalg.det(STRETCH)) * inverse
    # virtual work of a linear field: sum_a f_ai X_aJ = P_iJ V
    work = np.array([[f[axis == i] @ X[j, axis == i] for j in (0, 1)] for i in (0, 1)])
    # rounding of sums over all nodes
    np.testing.assert_allclose(work, P * 0.4 * 0.1, atol=1e-13 * np.abs(P).max() * 0.4 * 0.1)


def test_on_hexahedra_the_forms_of_the_page_are_nonlinear_solid(page):
    block = structures.nonlinear_solid(3, 2, 2, 0.1, structures.NeoHookean(E, NU), rho=1.0)
    cube = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    order = [cube.index(tuple(p)) for p in skfem.MeshHex.init_refdom().p.T.astype(int)]
    mesh = skfem.MeshHex(block.points.T, block.elements["hexahedron"][:, order].T)
    # degree 2 takes two Gauss points along each axis
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex1()), intorder=2)
    fixed = block.dofs(block.nodes_at(x=0.0))
    free = np.setdiff1d(np.arange(block.n), fixed)
    theirs = basis.nodal_dofs.T.ravel()[free]  # the numbers of our dofs in scikit-fem
    evaluate = page["neo_hookean"](basis, LAM, MU, theirs)
    u = np.random.default_rng(2).uniform(-0.005, 0.005, free.size)
    f, K = evaluate(0.0, u, None, None)
    ours, K_ours, _, _ = block.internal[0].reduced(free)(u)
    scale = np.abs(K_ours.data).max()
    # rounding; F - F^-T cancels a digit, and displacements are 0.005
    np.testing.assert_allclose(f, ours, atol=1e-15 * scale)
    assert np.abs(sp.csr_array(K - K_ours).data).max() < 2e-14 * scale


@pytest.mark.gate
def test_the_strip_of_the_page_moves_as_one_of_quadrilaterals(page):
    strip = structures.nonlinear_solid(48, 12, 0.4 / 48, structures.NeoHookean(E, NU), rho=1100.0)
    held = pm.reduce(strip.M, strip.K, fixed=strip.dofs(strip.nodes_at(x=0.0)))
    load = np.zeros(strip.n)
    end = strip.dofs(strip.nodes_at(x=0.4), "uy")
    load[end] = -100.0 / len(end)
    subdomain = pm.Subdomain(
        held.M,
        None,
        internal=strip.internal[0].reduced(held.free),
        scheme=pm.GeneralizedAlpha(0.8),
        force=load[held.free],
    )
    ours = pm.solve(subdomain, dt=4e-3, t_end=0.2).u[:, held.place(end)].mean(axis=1)
    places = np.searchsorted(page["free"], page["end"])
    theirs = page["history"].u[:, places].mean(axis=1)
    largest = np.abs(theirs).max()
    assert largest > 0.04  # of a length of 0.4
    # meshes of half the edges differ from these by 2.6 % (triangles) and 0.6 % (quadrilaterals)
    np.testing.assert_allclose(ours, theirs, atol=0.03 * largest)
