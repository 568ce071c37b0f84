"""Quadrature in the reference elements of `SHAPES`, by one table."""

from __future__ import annotations

from itertools import permutations
from typing import NamedTuple

import numpy as np

from ..problem.shapes import SHAPES


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
_A = (5.0 - np.sqrt(5.0)) / 20.0
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
