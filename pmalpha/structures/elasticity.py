"""Mass, stiffness and stresses of isotropic elastic elements of any kind of `SHAPES`.

Arrays by element have one row where all elements are equal, as in a regular mesh: it is then
computed once. Products are stacks of one per element: the rounding of one product for all of them
would depend on their number, and differ where a structure is cut.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from .._checks import listing
from ..memory import one_thread
from ..meshes.mesh import KINDS, SHAPES, Block
from .element_force import Made, Selected, of_chosen
from .pattern import Pattern, lumped_mass, upper

_A = (5.0 - np.sqrt(5.0)) / 20.0
# Numbers in the largest arrays of a chunk of elements: 8 MB
NUMBERS = 2**20
# An element is flat if its Jacobian determinant is rounding of the product of three edges.
FLAT = 1e-14


class Rule(NamedTuple):
    """Points (q, d) and weights (q,), which sum to the volume of the reference element."""

    points: np.ndarray
    weights: np.ndarray


def _gauss(d: int, n: int) -> Rule:
    """n^d points in the box, exact up to degree 2 n - 1 in each variable."""
    x, w = np.polynomial.legendre.leggauss(n)
    line = Rule((1.0 + x[:, None]) / 2.0, w / 2.0)
    rule = line
    for _ in range(d - 1):
        rule = _times(rule, line)
    return rule


def _times(a: Rule, b: Rule) -> Rule:
    """Points of a, then the variables of b."""
    points = [[*x, *y] for x in a.points for y in b.points]
    return Rule(np.array(points), np.outer(a.weights, b.weights).ravel())


def _at_corners(kind: str) -> Rule:
    """2^d points in the order of the corners next to them."""
    nodes = SHAPES[kind].nodes
    rule = _gauss(nodes.shape[1], 2)
    order = [np.flatnonzero((np.round(rule.points) == node).all(axis=1))[0] for node in nodes]
    return Rule(rule.points[order], rule.weights[order])


def _simplex(*orbits: tuple[float, tuple[float, ...]]) -> Rule:
    """A rule of orbits: a fraction of the volume, and barycentric coordinates to be permuted."""
    points, weights = [], []
    d = len(orbits[0][1]) - 1
    for weight, coordinates in orbits:
        places = sorted(set(permutations(coordinates)))
        points += [place[1:] for place in places]
        weights += len(places) * [weight]
    return Rule(np.array(points), np.array(weights) / (2.0 if d == 2 else 6.0))


def _triangle_5() -> Rule:
    """Radon's rule of degree 5."""
    s = np.sqrt(15.0)
    a, b = (6.0 - s) / 21.0, (6.0 + s) / 21.0
    return _simplex(
        (9.0 / 40.0, (1.0 / 3.0,) * 3),
        ((155.0 - s) / 1200.0, (a, a, 1.0 - 2.0 * a)),
        ((155.0 + s) / 1200.0, (b, b, 1.0 - 2.0 * b)),
    )


def _tetrahedron_5() -> Rule:
    """The rule of degree 5 with 14 points (Walkington)."""
    a, b, c = 0.31088591926330060980, 0.092735250310891226402, 0.045503704125649649492
    return _simplex(
        (0.11268792571801585080, (a, a, a, 1.0 - 3.0 * a)),
        (0.073493043116361949544, (b, b, b, 1.0 - 3.0 * b)),
        (0.042546020777081466438, (c, c, 0.5 - c, 0.5 - c)),
    )


_TRIANGLE_1 = _simplex((1.0, (1.0 / 3.0,) * 3))
_TRIANGLE_2 = _simplex((1.0 / 3.0, (1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0)))
_TRIANGLE_5 = _triangle_5()
_TETRAHEDRON_1 = _simplex((1.0, (0.25,) * 4))
_TETRAHEDRON_2 = _simplex((0.25, (_A, _A, _A, 1.0 - 3.0 * _A)))
_TETRAHEDRON_5 = _tetrahedron_5()
_WEDGE_1 = _times(_TRIANGLE_2, _gauss(1, 2))
_WEDGE_2 = _times(_TRIANGLE_5, _gauss(1, 3))

# For stiffness and mass; exact for elements with straight edges, boxes for parallelepipeds.
RULES: dict[str, tuple[Rule, Rule]] = {
    "line": (_gauss(1, 1), _gauss(1, 2)),
    "line3": (_gauss(1, 2), _gauss(1, 3)),
    "triangle": (_TRIANGLE_1, _TRIANGLE_2),
    "triangle6": (_TRIANGLE_2, _TRIANGLE_5),
    "quad": (_at_corners("quad"),) * 2,
    "quad8": (_gauss(2, 3), _gauss(2, 3)),
    "quad9": (_gauss(2, 3), _gauss(2, 3)),
    "tetra": (_TETRAHEDRON_1, _TETRAHEDRON_2),
    "tetra10": (_TETRAHEDRON_2, _TETRAHEDRON_5),
    "wedge": (_WEDGE_1, _WEDGE_1),
    "wedge15": (_WEDGE_2, _WEDGE_2),
    "hexahedron": (_at_corners("hexahedron"),) * 2,
    "hexahedron20": (_gauss(3, 3), _gauss(3, 3)),
}


class Moduli(NamedTuple):
    """Lame's constants (in plane stress those of the plane), density and thickness of elements.

    (E,) or, for equal elements, (1,) each; the thickness of a solid is 1. `across` is zz over
    xx + yy of the stresses in a plate: nu in plane strain, 0 in plane stress.
    """

    lam: np.ndarray
    mu: np.ndarray
    density: np.ndarray
    thickness: np.ndarray
    across: np.ndarray


def of_elements(values: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """The values of some elements, (k,), from those of all or the one that all have."""
    values = np.atleast_1d(np.asarray(values, dtype=float))
    return np.broadcast_to(values, elements.shape) if len(values) == 1 else values[elements]


def chunks(count: int, numbers: int) -> Iterator[slice]:
    """Slices of the elements, each of which has `numbers` numbers."""
    size = max(NUMBERS // numbers, 1)
    return (slice(first, min(first + size, count)) for first in range(0, count, size))


def elastic_matrices(
    points: np.ndarray,
    mesh: Mapping[str, np.ndarray],
    moduli: Mapping[str, Moduli],
    lumped: bool,
    corners: Mapping[str, np.ndarray] | None,
    selected: Selected,
) -> Made:
    """A `Recipe`: M, K of the chosen ones of the elements of the `mesh`, and no internal forces."""
    M: Any = 0
    K: Any = 0
    with one_thread():
        for kind, elements in selected.elements.items():
            block, pattern = Block(kind, elements), Pattern.of(elements, selected.nodes)
            lam, mu, density, t, _ = selected.rows(kind, moduli[kind])
            where = points[mesh[kind][selected.chosen[kind]]] if corners is None else corners[kind]
            M = M + mass_matrix(block, pattern, where, t * density, lumped)
            K = K + stiffness(block, pattern, where, t * lam, t * mu)
    return M, K, ()


def mass_matrix(
    block: Block, pattern: Pattern, corners: np.ndarray, density: np.ndarray, lumped: bool
) -> Any:
    """M, or its diagonal if lumped; corners (E or 1, a, d) are the coordinates of the nodes."""
    N, weights = masses_at_points(block.kind, corners, density)
    d, a = corners.shape[2], N.shape[1]
    if lumped:
        shares = lumped_shares(block.kind, N, weights)
        return np.repeat(lumped_mass(block.nodes, shares, pattern.indptr.size - 1), d)
    squares = (N[:, :, None] * N[:, None, :]).reshape(-1, a * a)
    sums = np.zeros((1, pattern.indices.size))
    for part in chunks(len(block.nodes), a * a):
        pattern.add(sums, part, [(of_chosen(weights, part)[:, None] @ squares).reshape(-1, a, a)])
    scalar = pattern.of_blocks(sums.reshape(-1, 1, 1))
    return sp.csr_array(sp.kron(scalar, sp.eye_array(d), format="csr"))


def masses_at_points(
    kind: str, corners: np.ndarray, density: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions (q, a), and masses (E or 1, q), at the points of quadrature."""
    shape, (_, rule) = SHAPES[kind], RULES[kind]
    N, slopes = shape.values(rule.points), shape.slopes(rule.points)
    d = corners.shape[2]
    volumes, size = (np.empty((len(corners), len(N))) for _ in range(2))
    for part in chunks(len(corners), len(N) * d * d):
        J = _jacobian(corners[part], slopes)
        volumes[part], size[part] = _determinant(J, cofactors_of(J)), _size(J)
    _require_positive(volumes, size, kind)
    return N, density[:, None] * rule.weights * volumes


def lumped_shares(kind: str, N: np.ndarray, masses: np.ndarray) -> np.ndarray:
    """Masses (E or 1, a) of the nodes.

    Row sums of the consistent mass; of elements of second order, where those are not positive, its
    diagonal scaled to the mass of the element (Hinton, Rock, Zienkiewicz 1976).
    """
    if N.shape[1] == SHAPES[kind].corners:
        result: np.ndarray = (masses[:, None] @ N)[:, 0]
        return result
    diagonal = (masses[:, None] @ N**2)[:, 0]
    result = diagonal * (masses.sum(axis=1) / diagonal.sum(axis=1))[:, None]
    return result


def stiffness(
    block: Block, pattern: Pattern, corners: np.ndarray, lam: np.ndarray, mu: np.ndarray
) -> sp.csr_array:
    """K, by pairs of components to save memory."""
    d = corners.shape[2]
    rule, _ = RULES[block.kind]
    sums = np.zeros((len(upper(d)), pattern.indices.size))
    for part in chunks(len(block.nodes), rule.weights.size * block.nodes.shape[1] * d):
        volumes, along = gradients(block.kind, of_chosen(corners, part), part.start)
        g = np.sqrt(volumes)[:, :, None] * along
        moduli = (of_chosen(x, part)[:, None, None] for x in (lam, mu))
        pattern.add(sums, part, _blocks(g, *moduli))
    return pattern.symmetric(sums, d)


def _blocks(g: np.ndarray, lam: np.ndarray, mu: np.ndarray) -> Iterator[np.ndarray]:
    """(e, a, b) for each pair of components i <= j; g (d, e, q, a)."""
    d = len(g)

    def pair(i: int, j: int) -> np.ndarray:
        """The integral of d_i n_a d_j n_b, (e, a, b)."""
        result: np.ndarray = np.swapaxes(g[i], 1, 2) @ g[j]
        return result

    shear = mu * sum(pair(k, k) for k in range(d))
    for i, j in upper(d):
        G = pair(i, j)
        yield lam * G + mu * np.swapaxes(G, 1, 2) + (shear if i == j else 0.0)


def gradients(kind: str, corners: np.ndarray, first: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Volumes (E, q) of the points of quadrature of the stiffness, and dN_a / dx_i (d, E, q, a).

    `first` is the number of the first element, for messages.
    """
    shape, (rule, _) = SHAPES[kind], RULES[kind]
    slopes = shape.slopes(rule.points)
    J = _jacobian(corners, slopes)
    cofactors = cofactors_of(J)
    volumes = _determinant(J, cofactors)
    _require_positive(volumes, _size(J), kind, first)
    return rule.weights * volumes, _along(slopes, cofactors, volumes)


def _jacobian(corners: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """J_ij = dx_i / dxi_j, (d, d, E, q)."""
    q, a, d = slopes.shape
    J = np.moveaxis(slopes, 2, 0).reshape(d * q, a) @ corners  # (E, d q, d)
    return np.ascontiguousarray(J.reshape(-1, d, q, d).transpose(3, 1, 0, 2))


def cofactors_of(J: np.ndarray) -> np.ndarray:
    """det(J) J^-T of J_ij, (d, d, ...)."""
    d = len(J)
    if d == 2:
        return np.array([[J[1, 1], -J[1, 0]], [-J[0, 1], J[0, 0]]])
    cofactors = np.empty_like(J)
    for i, j in np.ndindex(d, d):
        (k, m), (p, r) = (((x + 1) % 3, (x + 2) % 3) for x in (i, j))
        cofactors[i, j] = J[k, p] * J[m, r] - J[k, r] * J[m, p]
    return cofactors


def _determinant(J: np.ndarray, cofactors: np.ndarray) -> np.ndarray:
    result: np.ndarray = np.einsum("jeq,jeq->eq", J[0], cofactors[0])
    return result


def _size(J: np.ndarray) -> np.ndarray:
    """What the determinant would be if edges of this length were at right angles."""
    with np.errstate(over="ignore"):  # infinite, and the element refused
        result: np.ndarray = np.abs(J).max(axis=(0, 1)) ** len(J)
    return result


def _along(slopes: np.ndarray, cofactors: np.ndarray, volumes: np.ndarray) -> np.ndarray:
    """dN_a / dx_i, (d, E, q, a)."""
    along = np.empty((len(cofactors), *volumes.shape, slopes.shape[1]))
    for i, row in enumerate(cofactors):
        along[i] = sum((x / volumes)[:, :, None] * slopes[:, :, j] for j, x in enumerate(row))
    return along


def _require_positive(volumes: np.ndarray, size: np.ndarray, kind: str, first: int = 0) -> None:
    invalid = np.flatnonzero(~(volumes > FLAT * size).all(axis=1))
    if invalid.size:
        middles = "" if KINDS[kind].nodes == SHAPES[kind].corners else " and middles of edges near"
        raise ValueError(
            f"elements must be convex with corners in meshio's order (counter-clockwise){middles}, "
            f"got a Jacobian determinant of {volumes[invalid[0]].min():g} in "
            f"{listing(first + invalid)} of {kind!r}"
        )


def stresses(
    kind: str, points: np.ndarray, nodes: np.ndarray, moduli: Moduli, dofs: int
) -> sp.csr_array:
    """The implementation of `Structure.element_stresses`, with this number of dofs of a node."""
    shape, d = SHAPES[kind], KINDS[kind].dimension
    middle = shape.nodes[: shape.corners].mean(axis=0, keepdims=True)
    slopes = shape.slopes(middle)
    J = _jacobian(points[nodes], slopes)
    cofactors = cofactors_of(J)
    g = _along(slopes, cofactors, _determinant(J, cofactors))[:, :, 0]  # dN_a / dx_i, (d, E, a)
    lam, mu = (x[:, None] for x in moduli[:2])
    shear = [(0, 1), (1, 2), (0, 2)][: d * (d - 1) // 2]
    E, a = nodes.shape
    s = d + len(shear)
    values = np.zeros((E, s, a, d))
    for i, k in np.ndindex(d, d):
        values[:, i, :, k] = (lam + 2.0 * mu * (i == k)) * g[k]
    for row, (i, j) in enumerate(shear, start=d):
        values[:, row, :, i], values[:, row, :, j] = mu * g[j], mu * g[i]
    columns = (dofs * nodes[:, :, None] + np.arange(d)).reshape(E, 1, a * d)
    start = a * d * np.arange(E * s + 1)
    entries = values.ravel(), np.repeat(columns, s, axis=1).ravel(), start
    return sp.csr_array(entries, shape=(E * s, dofs * len(points)))
