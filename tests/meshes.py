"""Boxes of elements of every kind, for tests."""

import itertools

import numpy as np

from pmalpha.meshes.mesh import KINDS, SHAPES

PLANE = ["triangle", "triangle6", "quad", "quad8", "quad9"]
SOLID = ["tetra", "tetra10", "wedge", "wedge15", "hexahedron", "hexahedron20"]
FIRST = {
    "triangle6": "triangle",
    "quad8": "quad",
    "quad9": "quad",
    "tetra10": "tetra",
    "wedge15": "wedge",
    "hexahedron20": "hexahedron",
}


def order_of(kind):
    return 2 if kind in FIRST else 1


def box(kind, n, size=1.0):
    """Points in [0, size]^d and elements of one kind, in n cells along each axis."""
    d = KINDS[kind].dimension
    index = np.indices((n,) * d).reshape(d, -1).T
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    first = FIRST.get(kind, kind)
    cells = {
        "triangle": [[square[i] for i in corners] for corners in ((0, 1, 2), (0, 2, 3))],
        "quad": [square],
        "tetra": [
            [
                offset
                for offset in np.cumsum([(0, 0, 0), *np.eye(3, dtype=int)[list(order)]], axis=0)
            ]
            for order in itertools.permutations(range(3))
        ],
        "wedge": [
            [(*square[i], z) for z in (0, 1) for i in corners] for corners in ((0, 1, 2), (0, 2, 3))
        ],
        "hexahedron": [[(x, y, z) for z in (0, 1) for x, y in square]],
    }[first]
    elements = []
    for cell in cells:
        corners = [np.ravel_multi_index((index + offset).T, (n + 1,) * d) for offset in cell]
        if first == "tetra" and np.linalg.det(np.diff(cell, axis=0)) < 0.0:
            corners[2], corners[3] = corners[3], corners[2]
        elements.append(np.column_stack(corners))
    points = np.indices((n + 1,) * d).reshape(d, -1).T * (size / n)
    return second_order(points, np.concatenate(elements), kind)


def second_order(points, corners, kind):
    """The elements with nodes in the middles of their straight edges, if they are to have them."""
    if kind == FIRST.get(kind, kind):
        return points, corners
    shape = SHAPES[kind]
    middles = shape.nodes[shape.corners :]
    N = SHAPES[FIRST[kind]].values(middles)
    where = np.einsum("ma,eax->emx", N, points[corners])
    new, number = np.unique(
        np.round(where.reshape(-1, points.shape[1]), 9), axis=0, return_inverse=True
    )
    nodes = len(points) + number.reshape(len(corners), -1)
    exact = np.empty_like(new)
    exact[number.ravel()] = where.reshape(-1, points.shape[1])
    return np.concatenate([points, exact]), np.column_stack([corners, nodes])


def distorted(kind, n, amount=0.1):
    """A box whose corners inside have moved, with straight edges."""
    first = FIRST.get(kind, kind)
    points, corners = box(first, n)
    inside = np.all((points > 1e-9) & (points < 1.0 - 1e-9), axis=1)
    rng = np.random.default_rng(3)
    points = points + amount / n * inside[:, None] * rng.uniform(-1.0, 1.0, points.shape)
    return second_order(points, corners, kind)


def moved_inside(grid, share=0.25):
    """Points of a regular mesh with edges 0.5, those inside moved by up to a share of an edge.

    And which of them are inside.
    """
    low, high = grid.points.min(axis=0), grid.points.max(axis=0)
    inside = np.all((grid.points > low) & (grid.points < high), axis=1)
    shift = np.random.default_rng(8).uniform(-0.5 * share, 0.5 * share, grid.points.shape)
    return grid.points + inside[:, None] * shift, inside
