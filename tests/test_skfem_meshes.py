"""Meshes and bases of scikit-fem, compared with what it assembles itself."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from agreement import assert_close

import pmalpha as pm
from pmalpha import structures

skfem = pytest.importorskip("skfem")

from skfem.helpers import dot  # noqa: E402
from skfem.models.elasticity import lame_parameters, linear_elasticity  # noqa: E402
from skfem.refdom import RefLine, RefTri  # noqa: E402

E, NU, RHO = 3.0, 0.25, 2.0
MESHES = {
    "triangle": lambda: skfem.MeshTri.init_tensor([0.0, 1, 2], [0.0, 1]),
    "triangle6": lambda: skfem.MeshTri2.from_mesh(skfem.MeshTri.init_tensor([0.0, 1, 2], [0, 1.0])),
    "quad": lambda: skfem.MeshQuad.init_tensor([0.0, 1, 3], [0.0, 1]),
    "quad9": lambda: skfem.MeshQuad2.from_mesh(skfem.MeshQuad.init_tensor([0.0, 1, 3], [0.0, 1])),
    "tetra": lambda: skfem.MeshTet.init_tensor([0.0, 1, 2], [0.0, 1], [0.0, 1]),
    "tetra10": lambda: skfem.MeshTet2.from_mesh(skfem.MeshTet()),
    "hexahedron": lambda: skfem.MeshHex.init_tensor([0.0, 1, 3], [0.0, 1], [0.0, 2]),
    "wedge": lambda: skfem.MeshWedge1(),
}
SHEAR = np.array([[1.0, 0.3, 0.2], [0.1, 1.1, -0.2], [0.2, 0.0, 0.9]])


def sheared(kind):
    """A mesh whose elements are affine images, so that both programs integrate exactly."""
    mesh = MESHES[kind]()
    d = mesh.dim()
    return type(mesh)(SHEAR[:d, :d] @ mesh.doflocs, mesh.dofs.element_dofs)


def of_wedges():
    """Points and weights over a wedge: those of scikit-fem 12 sum to 1/4, half of its volume."""
    (x, a), (z, b) = (skfem.quadrature.get_quadrature(r, 4) for r in (RefTri, RefLine))
    points = [(*x[:, i], z[0, j]) for i in range(a.size) for j in range(b.size)]
    return np.array(points).T, np.outer(a, b).ravel()


def forms(mesh):
    is_wedge = isinstance(mesh, skfem.MeshWedge1)
    rule = {"quadrature": of_wedges()} if is_wedge else {"intorder": 4}
    basis = skfem.Basis(mesh, skfem.ElementVector(mesh.elem()), **rule)
    mass = skfem.BilinearForm(lambda u, v, w: RHO * dot(u, v))
    return basis, mass, linear_elasticity(*lame_parameters(E, NU))


@pytest.mark.parametrize("kind", MESHES)
def test_a_mesh_of_scikit_fem_has_the_frequencies_that_it_assembles(kind):
    """Which are the same for every order of nodes and dofs, and for no wrong one."""
    mesh = sheared(kind)
    structure = structures.from_mesh(mesh, {"E": E, "nu": NU, "rho": RHO}, plane="strain")
    assert list(structure.elements) == [kind]
    np.testing.assert_array_equal(structure.points, mesh.doflocs.T)
    basis, mass, stiffness = forms(mesh)
    theirs = [A.assemble(basis).toarray() for A in (stiffness, mass)]
    squares = scipy.linalg.eigvalsh(*theirs)
    ours = scipy.linalg.eigvalsh(*(sp.csr_array(A).toarray() for A in (structure.K, structure.M)))
    # rounding of eigenvalues, relative to the largest
    assert_close(ours, squares, 1e-12 * squares[-1], "a squared frequency")


def test_the_order_of_nodes_of_scikit_fem_is_none_of_an_element_here():
    """So the test above can fail."""
    mesh = sheared("hexahedron")
    with pytest.raises(ValueError, match="elements must be convex"):
        structures.solid_on(mesh.doflocs.T, mesh.t.T, E=E, nu=NU, rho=RHO)


@pytest.mark.parametrize("kind", ["quad", "triangle6"])
def test_subdomains_are_groups_and_boundaries_are_sets_of_all_their_nodes(kind):
    mesh = MESHES[kind]()
    mesh = mesh.with_subdomains({"near": lambda x: x[0] < 1.0}).with_boundaries(
        {"wall": lambda x: x[0] == 0.0}
    )
    steel, rubber = {"E": E, "nu": NU, "rho": RHO}, {"E": 0.1 * E, "nu": NU, "rho": RHO}
    structure = structures.from_mesh(mesh, steel)
    np.testing.assert_array_equal(structure.groups["near"], np.sort(mesh.subdomains["near"]))
    assert sorted(structure.dofs("wall")) == sorted(structure.dofs(structure.nodes_at(x=0.0)))
    far = np.setdiff1d(np.arange(mesh.nelements), mesh.subdomains["near"])
    both = structures.from_mesh(mesh.with_subdomains({"far": far}), {"near": steel, "far": rubber})
    assert sp.csr_array(both.K - structure.K).count_nonzero()


@pytest.mark.parametrize("element", [skfem.ElementTriP1, skfem.ElementTriP2, skfem.ElementTriP3])
def test_element_matrices_sum_to_what_scikit_fem_assembles(element):
    mesh = skfem.MeshTri.init_tensor([0.0, 1, 2, 3], [0.0, 1, 2]).with_boundaries(
        {"wall": lambda x: x[0] == 0.0}
    )
    basis = skfem.Basis(mesh, skfem.ElementVector(element()), intorder=6)
    _, mass, stiffness = forms(mesh)
    fixed = basis.get_dofs("wall")
    elements = pm.Elements.from_skfem(basis, mass, stiffness, C=mass, fixed=fixed)
    (whole,) = pm.cut(elements, np.zeros(mesh.nelements, int)).subdomains
    free = basis.complement_dofs(fixed)
    for ours, form in ((whole.M, mass), (whole.K, stiffness), (whole.C, mass)):
        theirs = form.assemble(basis)[free][:, free].toarray()
        # rounding of sums over a few elements
        assert_close(sp.csr_array(ours).toarray(), theirs, 1e-14 * np.abs(theirs).max(), "entry")


def test_a_basis_is_cut_into_subdomains_that_move_as_what_it_assembles():
    mesh = skfem.MeshQuad.init_tensor(np.arange(7.0), np.arange(3.0))
    basis, mass, stiffness = forms(mesh)
    fixed = basis.get_dofs(lambda x: x[0] == 0.0)
    elements = pm.Elements.from_skfem(basis, mass, stiffness, fixed=fixed)
    free = basis.complement_dofs(fixed)
    load = np.zeros(basis.N)
    load[basis.get_dofs(lambda x: x[0] == 6.0).all("u^2")] = 1.0
    labels = (mesh.p[0, mesh.t].mean(axis=0) > 3.0).astype(int)
    scheme = pm.GeneralizedAlpha(0.8)
    division = pm.cut(elements, labels, scheme=scheme, force=load[free])
    assert len(division.subdomains) == 2
    history = division.coupler(dt=0.1, coupling="gc").run(10.0)
    M, K = (A.assemble(basis)[free][:, free] for A in (mass, stiffness))
    whole = pm.solve(pm.Subdomain(M, K, scheme=scheme, force=load[free]), dt=0.1, t_end=10.0)
    # equal steps under "gc" are those of the uncut structure; rounding grows over 100 steps
    assert_close(division.gather(history).u, whole.u, 1e-10 * np.abs(whole.u).max(), "u")


def test_lumped_masses_are_row_sums_with_the_mass_of_the_body():
    mesh = sheared("triangle")
    basis, mass, stiffness = forms(mesh)
    elements = pm.Elements.from_skfem(basis, mass, stiffness, lumped=True)
    area = 2.0 * np.linalg.det(SHEAR[:2, :2])
    assert elements.M.shape == (mesh.nelements, 6)
    np.testing.assert_allclose(elements.M.sum(), 2 * RHO * area, rtol=1e-14)  # in two directions


def test_what_is_not_of_scikit_fem_is_refused_by_its_argument():
    mesh = sheared("quad")
    basis, mass, stiffness = forms(mesh)
    with pytest.raises(TypeError, match="basis must be a basis of scikit-fem, got <skfem MeshQuad"):
        pm.Elements.from_skfem(mesh, mass, stiffness)
    with pytest.raises(TypeError, match="K must be a BilinearForm of scikit-fem, got <Compressed"):
        pm.Elements.from_skfem(basis, mass, stiffness.assemble(basis))
    with pytest.raises(ValueError, match="K must be symmetric"):
        gradient = skfem.BilinearForm(lambda u, v, w: u.grad[0, 0] * v[1])
        pm.Elements.from_skfem(basis, mass, gradient)
    cubes = skfem.MeshHex2.from_mesh(skfem.MeshHex())
    with pytest.raises(ValueError, match="mesh must have elements of .*, got MeshHex2 with 27"):
        structures.from_mesh(cubes, {"E": 1.0, "nu": 0.2, "rho": 1.0})
