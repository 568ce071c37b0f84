"""Structures along a line: chains of masses, rods."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from .._checks import real_number, vector, whole_number
from .checked import is_lumped, measure, not_negative, positive
from .element_force import Made, Selected, of_chosen
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
    >>> from pmalpha import structures
    >>> structures.chain(3, 1.0, [10.0, 20.0], ground=(5.0, 0.0)).K.toarray().tolist()
    [[15.0, -10.0, 0.0], [-10.0, 30.0, -20.0], [0.0, -20.0, 20.0]]
    """
    n = whole_number(n, "n", low=1)
    masses = np.broadcast_to(not_negative(mass, "mass", (n,)), n).copy()
    k = not_negative(stiffness, "stiffness", (n - 1,))
    ends = not_negative(vector(ground, 2, "ground"), "ground", (2,))
    lines = _path(n)
    points = measure(spacing, "spacing") * np.arange(float(n))[:, None]
    if n == 1:
        return Structure(masses, sp.csr_array([[ends.sum()]]), points, {"line": lines}, ("ux",))
    # of each mass a half belongs to the spring on either side, the whole at the ends
    masses[1:-1] /= 2.0
    recipe = partial(_springs, masses[lines], k, ends)
    return Structure._of(recipe, points, {"line": lines}, ("ux",))


def _springs(masses: np.ndarray, k: np.ndarray, ends: np.ndarray, selected: Selected) -> Made:
    """M and K of springs with the masses (E, 2) at their ends; those on the ground have numbers."""
    path, nodes = selected.elements["line"], selected.nodes
    numbers = np.arange(len(masses))[selected.chosen["line"]]
    held = np.zeros(nodes)
    held[path[numbers == 0, 0]] += ends[0]
    held[path[numbers == len(masses) - 1, 1]] += ends[1]
    springs = of_chosen(k, selected.chosen["line"])[:, None, None] * SPRING
    K = Pattern.of(path, nodes).matrix(springs) + sp.diags_array(held)
    return lumped_mass(path, masses[numbers], nodes), K.tocsr(), ()


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

    The wave speed is :math:`c = sqrt(EA / rhoA)`. With lumped mass and central differences the
    critical step is h / c for the element length h, and with this step the solution at the nodes is
    exact (Hughes, The Finite Element Method).

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
    >>> from pmalpha import structures
    >>> bar = structures.rod(2, 1.0, EA=3.0, rhoA=12.0)
    >>> bar.M.toarray().tolist()
    [[2.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 2.0]]
    >>> structures.rod(2, 1.0, EA=3.0, rhoA=12.0, mass="lumped").M.diagonal().tolist()
    [3.0, 6.0, 3.0]
    """
    n = whole_number(n, "n", low=1)
    h = measure(length, "length") / n
    stiffness, density = positive(EA, "EA", (n,)), positive(rhoA, "rhoA", (n,))
    lines = _path(n + 1)
    points = real_number(origin, "origin") + h * np.arange(n + 1.0)[:, None]
    recipe = partial(_rods, stiffness / h, density * h, is_lumped(mass))
    return Structure._of(recipe, points, {"line": lines}, ("ux",))


def _rods(stiffness: np.ndarray, masses: np.ndarray, lumped: bool, selected: Selected) -> Made:
    path, nodes = selected.elements["line"], selected.nodes
    k, m = selected.rows("line", (stiffness, masses))
    pattern = Pattern.of(path, nodes)
    if lumped:
        M = lumped_mass(path, (m / 2.0)[:, None], nodes)
    else:
        M = pattern.matrix((m / 6.0)[:, None, None] * [[2.0, 1.0], [1.0, 2.0]])
    return M, pattern.matrix(k[:, None, None] * SPRING), ()


def _path(n: int) -> np.ndarray:
    """(n - 1, 2): each of n nodes and its right neighbour."""
    return np.column_stack([np.arange(n - 1), np.arange(1, n)])
