"""Structures along a line: chains of masses, rods."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from .._checks import positive_number, real_number, vector, whole_number
from .arguments import is_lumped, not_negative, positive
from .pattern import Pattern, lumped_mass
from .structure import Structure

__all__ = ["chain", "rod"]

SPRING = np.array([[1.0, -1.0], [-1.0, 1.0]])


def chain(
    n: int,
    mass: ArrayLike,
    stiffness: ArrayLike,
    *,
    ground: Sequence[float] = (0.0, 0.0),
    spacing: float = 1.0,
) -> Structure:
    """Masses in a row with springs between neighbours.

    Parameters
    ----------
    n : int
        Number of masses, at least 1.
    mass : float or (n,) array_like
        Of each.
    stiffness : float or (n - 1,) array_like
        Stiffness of the spring between masses i and i + 1.
    ground : two floats, default (0, 0)
        Stiffness between the ground and the first mass, and between the last mass and the ground.
    spacing : float, default 1
        Distance of neighbours; affects `points` only.

    Returns
    -------
    Structure
        Component "ux", elements "line", M of shape (n,).

    Raises
    ------
    TypeError, ValueError
        For numbers that are not finite or negative, and for wrong lengths.

    Examples
    --------
    >>> from pmalpha import models
    >>> models.chain(3, 1.0, [10.0, 20.0], ground=(5.0, 0.0)).K.toarray().tolist()
    [[15.0, -10.0, 0.0], [-10.0, 30.0, -20.0], [0.0, -20.0, 20.0]]
    """
    n = whole_number(n, "n", low=1)
    M = np.broadcast_to(not_negative(mass, "mass", (n,)), n).copy()
    k = not_negative(stiffness, "stiffness", (n - 1,))
    ends = not_negative(vector(ground, 2, "ground"), "ground", (2,))
    held = np.zeros(n)
    held[0] += ends[0]
    held[-1] += ends[1]
    lines = _path(n)
    K = Pattern.of(lines, n).matrix(k[:, None, None] * SPRING) + sp.diags_array(held)
    points = positive_number(spacing, "spacing") * np.arange(float(n))[:, None]
    return Structure(M, K.tocsr(), points, {"line": lines}, ("ux",))


def rod(
    n: int,
    length: float,
    *,
    EA: ArrayLike,
    rhoA: ArrayLike,
    mass: str = "consistent",
    origin: float = 0.0,
) -> Structure:
    """A rod under axial force, of n elements of equal length with linear displacement.

    The wave speed is c = sqrt(EA / rhoA). With lumped mass and central differences the critical
    step is h / c for the element length h, and with this step the solution at the nodes is exact
    (Hughes, The Finite Element Method).

    Parameters
    ----------
    n : int
        Number of elements, at least 1.
    length : float
        Of the whole rod.
    EA, rhoA : float or (n,) array_like
        Axial stiffness (force) and mass per length.
    mass : {"consistent", "lumped"}
        Lumped: half the mass of an element on each of its nodes.
    origin : float, default 0
        Coordinate x of the first node.

    Returns
    -------
    Structure
        With n + 1 nodes, component "ux", elements "line".

    Raises
    ------
    TypeError, ValueError
        For numbers that are not positive, and wrong lengths.

    Examples
    --------
    >>> from pmalpha import models
    >>> bar = models.rod(2, 1.0, EA=3.0, rhoA=12.0)
    >>> bar.M.toarray().tolist()
    [[2.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 2.0]]
    >>> models.rod(2, 1.0, EA=3.0, rhoA=12.0, mass="lumped").M.diagonal().tolist()
    [3.0, 6.0, 3.0]
    """
    n = whole_number(n, "n", low=1)
    h = positive_number(length, "length") / n
    stiffness, density = positive(EA, "EA", (n,)), positive(rhoA, "rhoA", (n,))
    lines = _path(n + 1)
    pattern = Pattern.of(lines, n + 1)
    if is_lumped(mass):
        M = lumped_mass(lines, (density * h / 2.0)[:, None], n + 1)
    else:
        M = pattern.matrix((density * h / 6.0)[:, None, None] * [[2.0, 1.0], [1.0, 2.0]])
    K = pattern.matrix((stiffness / h)[:, None, None] * SPRING)
    points = real_number(origin, "origin") + h * np.arange(n + 1.0)[:, None]
    return Structure(M, K, points, {"line": lines}, ("ux",))


def _path(n: int) -> np.ndarray:
    """(n - 1, 2): each of n nodes and its right neighbour."""
    return np.column_stack([np.arange(n - 1), np.arange(1, n)])
