"""Meshes cut out of other meshes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._checks import real_array
from .arguments import node_numbers

__all__ = ["submesh"]


def submesh(points: ArrayLike, elements: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The mesh of some elements of another one, without the points that they do not use.

    Parameters
    ----------
    points : (N, dim) array_like
    elements : (E, corners) array_like of int
        Those to keep.

    Returns
    -------
    points : (k, dim) ndarray
    elements : (E, corners) ndarray of int
        Numbered by the points that are left.
    nodes : (k,) ndarray of int
        Which of the points given these are, rising.

    Raises
    ------
    TypeError, ValueError
        For wrong shapes and points that are not there.

    Examples
    --------
    >>> from pmalpha import models
    >>> points, lines, nodes = models.submesh([[0.0], [1.0], [2.0], [3.0]], [[3, 2]])
    >>> points.tolist(), lines.tolist(), nodes.tolist()
    ([[2.0], [3.0]], [[1, 0]], [2, 3])
    """
    places = real_array(points, "points", 2)
    corners = node_numbers(elements, "elements", len(places), None)
    nodes, renumbered = np.unique(corners, return_inverse=True)
    return places[nodes], renumbered.reshape(corners.shape), nodes
