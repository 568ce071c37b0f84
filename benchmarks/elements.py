"""Force and tangent of nonlinear elements, against scikit-fem where it is installed.

10 000 hexahedra with full integration: the time of a call (force and tangent), of the force alone,
and of set-up; then the same number of quadrilaterals, corotational beams and bars.
"""

from functools import partial

import numpy as np
from timing import in_turn, once, run

from pmalpha import structures

try:
    import skfem
    from skfem import helpers
except ImportError:
    skfem = None

E, NU = 210.0, 0.3
CUBE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]


def makers(quick):
    """Makers of the structures by name, and the size of their random displacements."""
    box, flat = ((4, 3, 2), (6, 4)) if quick else ((25, 20, 20), (100, 100))
    lines = 24 if quick else 10000
    steel = structures.J2Plasticity(E, NU, yield_stress=1.0, isotropic=2.0)
    kirchhoff, rubber = structures.StVenantKirchhoff(E, NU), structures.NeoHookean(E, NU)
    member = {"points": [[0, 0], [lines, 0]], "members": [[0, 1]], "divisions": lines}
    member |= {"EA": 1.0, "rhoA": 1.0}
    solid = partial(structures.nonlinear_solid, rho=1.0)
    return {
        "hex8 StVenantKirchhoff": partial(distorted, box, kirchhoff),
        "hex8 NeoHookean": partial(distorted, box, rubber),
        "hex8 J2Plasticity": partial(distorted, box, steel),
        "hex8 NeoHookean, equal elements": partial(solid, *box, 1.0, rubber),
        "quad4 NeoHookean": partial(solid, *flat, 1.0, rubber),
        "corotational beam": partial(structures.corotational_frame, **member, EI=1.0),
        "bar": partial(structures.truss, **member),
    }


def distorted(counts, material):
    """Hexahedra of different shapes, so that no element can stand for another."""
    box = structures.solid(*counts, 1.0, E=E, nu=NU, rho=1.0)
    points = box.points + 0.05 * np.sin(7.0 * box.points)
    return structures.nonlinear_solid_on(points, box.elements["hexahedron"], material, rho=1.0)


def by_scikit_fem(structure):
    """The force and tangent of the neo-Hookean material as a function of u, by scikit-fem."""
    order = [CUBE.index(tuple(p)) for p in skfem.MeshHex.init_refdom().p.T.astype(int)]
    cells = structure.elements["hexahedron"][:, order]
    mesh = skfem.MeshHex(structure.points.T, cells.T)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex1()), intorder=2)
    dofs = basis.nodal_dofs.T.ravel()
    lam, mu = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))

    def state(w):
        F = helpers.grad(w["u"]) + helpers.eye(1.0 + 0.0 * w.x[0], 3)
        return F, helpers.transpose(helpers.inv(F)), np.log(helpers.det(F))

    @skfem.LinearForm
    def residual(v, w):
        F, G, logarithm = state(w)
        return helpers.ddot(mu * (F - G) + lam * logarithm * G, helpers.grad(v))

    @skfem.BilinearForm
    def tangent(du, v, w):
        _, G, logarithm = state(w)
        dF = helpers.grad(du)
        turned = helpers.mul(helpers.mul(G, helpers.transpose(dF)), G)
        change = mu * dF + (mu - lam * logarithm) * turned + lam * helpers.ddot(G, dF) * G
        return helpers.ddot(change, helpers.grad(v))

    def force(u):
        values = np.zeros(structure.n)
        values[dofs] = u
        at = {"u": basis.interpolate(values)}
        return residual.assemble(basis, **at)[dofs], tangent.assemble(basis, **at)

    return force


def row(name, make, quick):
    """Times of one structure, in ms."""
    setup, structure = once(make)
    (force,) = structure.internal
    (elements,) = structure.elements.values()
    u = 0.01 * np.sin(np.arange(force.n))
    calls = [partial(force, u), partial(force.residual, u)]
    theirs = ""
    if skfem and name == "hex8 NeoHookean":
        other = by_scikit_fem(structure)
        f = force.residual(u)
        assert np.abs(other(u)[0] - f).max() < 1e-10 * np.abs(f).max()  # rounding
        (theirs,) = in_turn(partial(other, u), rounds=1 if quick else 3)
        theirs = f"{1e3 * theirs:.4g}"
    whole, alone = in_turn(*calls, rounds=3 if quick else 9)
    return {
        "elements": name,
        "number": len(elements),
        "dofs": force.n,
        "force and tangent ms": 1e3 * whole,
        "force ms": 1e3 * alone,
        "force over both": alone / whole,
        "set-up ms": 1e3 * setup,
        "scikit-fem ms": theirs,
    }


def rows(quick):
    if not skfem:
        print("scikit-fem is not installed: left out")
    return [row(name, make, quick) for name, make in makers(quick).items()]


if __name__ == "__main__":
    run("elements", rows, about=__doc__)
