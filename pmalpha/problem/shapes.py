"""Shape functions of the kinds of elements, by one table of nodes and monomials.

The reference element is the box [0, 1]^d or the simplex in it, a wedge a triangle times a line. A
shape function is the polynomial of its monomials that is 1 at its node and 0 at the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from .kinds import KINDS, Kind

_SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
_TRIANGLE = [(0, 0), (1, 0), (0, 1)]
# By dimension and number of corners
_CORNERS = {
    (1, 2): [(0,), (1,)],
    (2, 3): _TRIANGLE,
    (2, 4): _SQUARE,
    (3, 4): [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    (3, 6): [(*corner, z) for z in (0, 1) for corner in _TRIANGLE],
    (3, 8): [(*corner, z) for z in (0, 1) for corner in _SQUARE],
}


def _simplex(order: int) -> Callable[[tuple[int, ...]], bool]:
    """Polynomials of this degree."""
    return lambda e: sum(e) <= order


def _serendipity(order: int) -> Callable[[tuple[int, ...]], bool]:
    """Polynomials of this degree, not counting the variables that are linear."""
    return lambda e: sum(x for x in e if x > 1) <= order and max(e) <= order


def _wedge(order: int) -> Callable[[tuple[int, ...]], bool]:
    return lambda e: e[0] + e[1] <= order and e[2] <= order and sum(e) <= order + 1


# Whether a monomial with these exponents, of 2 at most, is one of the element.
_MONOMIALS: dict[str, Callable[[tuple[int, ...]], bool]] = {
    "line": _simplex(1),
    "line3": _simplex(2),
    "triangle": _simplex(1),
    "triangle6": _simplex(2),
    "quad": _serendipity(1),
    "quad8": _serendipity(2),
    "quad9": lambda e: True,
    "tetra": _simplex(1),
    "tetra10": _simplex(2),
    "wedge": _wedge(1),
    "wedge15": _wedge(2),
    "hexahedron": _serendipity(1),
    "hexahedron20": _serendipity(2),
}


@dataclass(frozen=True, eq=False)
class Shape:
    """Nodes of a reference element and its shape functions N_a = sum_m c_ma prod_i xi_i^e_mi."""

    corners: int
    nodes: np.ndarray  # (k, d)
    exponents: np.ndarray  # (k, d), of monomial m
    coefficients: np.ndarray  # (k, k), c_ma

    def values(self, xi: np.ndarray) -> np.ndarray:
        """N (q, k) at xi (q, d)."""
        result: np.ndarray = self._powers(xi, self.exponents) @ self.coefficients
        return result

    def slopes(self, xi: np.ndarray) -> np.ndarray:
        """dN / dxi (q, k, d) at xi (q, d)."""
        columns = []
        for axis, unit in enumerate(np.eye(xi.shape[1], dtype=int)):
            factors = self.exponents[:, axis]
            lower = self._powers(xi, np.maximum(self.exponents - unit, 0))
            columns.append((factors * lower) @ self.coefficients)
        return np.stack(columns, axis=2)

    def _powers(self, xi: np.ndarray, exponents: np.ndarray) -> np.ndarray:
        result: np.ndarray = np.prod(xi[:, None, :] ** exponents, axis=2)
        return result


def _nodes(kind: Kind, corners: np.ndarray) -> np.ndarray:
    """The corners, then the middles of the edges, then that of the element."""
    on_edges = corners[np.array(kind.edges)].mean(axis=1)
    return np.concatenate([corners, on_edges, [corners.mean(axis=0)]])[: kind.nodes]


def _shape(name: str) -> Shape:
    kind = KINDS[name]
    corners = 1 + max(map(max, kind.edges))
    nodes = _nodes(kind, np.array(_CORNERS[kind.dimension, corners], dtype=float))
    belongs = _MONOMIALS[name]
    exponents = np.array([e for e in product(range(3), repeat=kind.dimension) if belongs(e)])
    # N_a(node b) = delta_ab; with nodes at 0, 1/2 and 1 the coefficients are whole numbers
    at_nodes = np.prod(nodes[:, None, :] ** exponents, axis=2)
    return Shape(corners, nodes, exponents, np.round(np.linalg.inv(at_nodes)))


SHAPES = {name: _shape(name) for name in _MONOMIALS}
