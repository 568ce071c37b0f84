"""Forces at the ends of line elements, from the assembled stiffness.

The block K_ij of two nodes is that of the one element between them. Rigid-body motions leave an
element without force, which determines its other blocks: with the motion B of node i when node j
moves rigidly, K_jj = -K_ji B.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

# Components of a node for which the rigid-body motions are known.
BAR, BEAM = ("ux",), ("ux", "uy", "rz")


def line_forces(
    K: sp.csr_array, points: np.ndarray, lines: np.ndarray, components: tuple[str, ...]
) -> sp.csr_array:
    """The implementation of `Structure.element_forces`."""
    if np.unique(np.sort(lines, axis=1), axis=0).shape != lines.shape:
        raise ValueError("element_forces needs one element at most between two nodes")
    first, second = lines.T
    d = len(components)
    of_first, of_second = _blocks(K, first, second, d), _blocks(K, second, first, d)
    along = points[second] - points[first]
    if components == BAR:  # the normal force is the force at the second end
        rows = np.concatenate([of_second, -of_second], axis=2)
        return _placed(rows, lines, d, K.shape[1])
    at_first = np.concatenate([-of_first @ _rigid(along), of_first], axis=2)
    at_second = np.concatenate([of_second, -of_second @ _rigid(-along)], axis=2)
    R = _rotation(along)
    return _placed(np.concatenate([R @ at_first, R @ at_second], axis=1), lines, d, K.shape[1])


def _blocks(K: sp.csr_array, i: np.ndarray, j: np.ndarray, d: int) -> np.ndarray:
    """(E, d, d): K between the dofs of nodes i and those of nodes j."""
    rows = np.repeat(d * i[:, None] + np.arange(d), d, axis=1)
    columns = np.tile(d * j[:, None] + np.arange(d), (1, d))
    return np.asarray(K[rows.ravel(), columns.ravel()]).reshape(-1, d, d)


def _rigid(along: np.ndarray) -> np.ndarray:
    """(E, 3, 3): motion of the other node, at this distance, per motion of a node."""
    B = np.broadcast_to(np.eye(3), (len(along), 3, 3)).copy()
    B[:, 0, 2], B[:, 1, 2] = -along[:, 1], along[:, 0]
    return B


def _rotation(along: np.ndarray) -> np.ndarray:
    """(E, 3, 3): from global axes to those of the element."""
    c, s = (along / np.hypot(*along.T)[:, None]).T
    R = np.zeros((len(c), 3, 3))
    R[:, 0, 0], R[:, 0, 1] = c, s
    R[:, 1, 0], R[:, 1, 1] = -s, c
    R[:, 2, 2] = 1.0
    return R


def _placed(rows: np.ndarray, lines: np.ndarray, d: int, n: int) -> sp.csr_array:
    """The matrices (E, r, 2 d) of the elements, one below the other, on all dofs."""
    elements, height, width = rows.shape
    columns = (d * lines[:, :, None] + np.arange(d)).reshape(elements, 1, width)
    columns = np.repeat(columns, height, axis=1)
    start = width * np.arange(elements * height + 1)
    whole = sp.csr_array((rows.ravel(), columns.ravel(), start), shape=(elements * height, n))
    whole.eliminate_zeros()
    return whole
