"""Submeshes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._checks import real_array
from .checked import node_numbers

__all__ = ["submesh"]


def submesh(points: ArrayLike, elements: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The mesh of some elements of another mesh, without unused points.

    Parameters
    ----------
    points : (N, dim) array_like
        Coordinates of all nodes.
    elements : (E, corners) array_like of int
        The elements to keep.

    Returns
    -------
    points : (k, dim) ndarray
        Coordinates of the nodes that the elements have.
    elements : (E, corners) ndarray of int
        In the numbers of the remaining points.
    nodes : (k,) ndarray of int
        Numbers of these points in the given mesh, in rising order.

    Raises
    ------
    TypeError, ValueError
        For wrong shapes and numbers of points that do not exist.

    Examples
    --------
    >>> from pmalpha import structures
    >>> points, lines, nodes = structures.submesh([[0.0], [1.0], [2.0], [3.0]], [[3, 2]])
    >>> points.tolist(), lines.tolist(), nodes.tolist()
    ([[2.0], [3.0]], [[1, 0]], [2, 3])
    """
    coordinates = real_array(points, "points", 2)
    corners = node_numbers(elements, "elements", len(coordinates), None)
    nodes, renumbered = np.unique(corners, return_inverse=True)
    return coordinates[nodes], renumbered.reshape(corners.shape), nodes
