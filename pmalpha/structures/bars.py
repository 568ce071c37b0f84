"""Bars and cables with large displacements."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from .._checks import check_word, flag, require_moderate
from .checked import dimension_of, is_lumped, mesh_arguments, per_element, positive
from .element_force import Conservative, Made, Selected
from .frames import subdivide
from .pattern import Assembly, Pattern, lumped_mass
from .structure import Structure

__all__ = ["truss"]


def truss(
    points: ArrayLike,
    members: ArrayLike,
    *,
    EA: ArrayLike,
    rhoA: ArrayLike,
    divisions: int | ArrayLike = 1,
    strain: str = "engineering",
    prestress: ArrayLike = 0.0,
    unstressed: ArrayLike | None = None,
    slack: bool = False,
    mass: str = "consistent",
) -> Structure:
    """Bars or cables with large displacements, in the plane or in space.

    With l the present length and L0 the unstressed one, the force of a bar is, by `strain`,

    * "engineering": :math:`N = EA (l - L_0) / L_0 + N_0` along the bar;
    * "green": :math:`N = (EA (l^2 - L_0^2) / (2 L_0^2) + N_0) l / L_0` along the bar (Crisfield,
      Non-linear Finite Element Analysis of Solids and Structures).

    Parameters
    ----------
    points : (N, 2) or (N, 3) array_like
        Coordinates of the nodes.
    members : (m, 2) array_like of int
        The two points that each member connects.
    EA, rhoA : float or (m,) array_like
        Axial stiffness (force) and mass per length between the points.
    divisions : int or (m,) array_like of int, default 1
        Number of equal elements per member, by `subdivide`: cables are mostly cut, bars are not.
    strain : {"engineering", "green"}
    prestress : float or (m,) array_like, default 0
        N0, the force at u = 0 if `unstressed` is not given; tension is positive.
    unstressed : float or (m,) array_like, optional
        Length L0 of each member without force. Default: the distance of its points.
    slack : bool, default False
        Members without compression, such as cables: where N < 0 the force and the tangent are zero.
    mass : {"consistent", "lumped"}
        Lumped: half the mass of an element on each of its nodes.

    Returns
    -------
    Structure
        K has no entries, `internal` has one force. Components "ux", "uy" and, in space, "uz",
        elements "line".

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, points that no member uses, members without length, numbers that are
        not positive.

    Notes
    -----
    A bar without force has no stiffness across its axis. Chains of elements without force, such as
    an unstressed cable, have a singular tangent; an implicit step has that of the mass besides.

    Examples
    --------
    Two bars that snap through (von Mises truss), and their force on the way:

    >>> from pmalpha import structures
    >>> arch = structures.truss([[-1, 0], [0, 0.2], [1, 0]], [[0, 1], [1, 2]], EA=100.0, rhoA=1.0)
    >>> def force(drop):
    ...     u = np.zeros(arch.n)
    ...     u[arch.dofs(1, "uy")] = -drop
    ...     return round(float(arch.internal[0].residual(u)[3]), 4)
    >>> force(0.1), force(0.2), force(0.3), force(0.4)
    (-0.2891, 0.0, 0.2891, 0.0)
    """
    check_word(strain, "strain", ("engineering", "green"))
    ends, bars = mesh_arguments(points, members, "members", dimension_of(points), 2)
    nodes, lines, member = subdivide(ends, bars, divisions)
    count = (len(bars),)
    stiffness, density = (
        np.broadcast_to(positive(value, name, count), count)[member]
        for name, value in (("EA", EA), ("rhoA", rhoA))
    )
    force = np.broadcast_to(per_element(prestress, "prestress", count), count)[member]
    require_moderate(force, "prestress")
    X = nodes[lines[:, 1]] - nodes[lines[:, 0]]
    length = np.sqrt(np.sum(X * X, axis=1))
    rest = length
    if unstressed is not None:
        unstressed_lengths = np.broadcast_to(positive(unstressed, "unstressed", count), count)
        rest = (unstressed_lengths / np.bincount(member))[member]
    values = (X, rest, stiffness, force, density * length)
    recipe = partial(_assembled, values, strain, flag(slack, "slack"), is_lumped(mass))
    return Structure._of(recipe, nodes, {"line": lines}, ("ux", "uy", "uz")[: nodes.shape[1]])


def _assembled(
    values: Sequence[np.ndarray], strain: str, slack: bool, lumped: bool, selected: Selected
) -> Made:
    lines, nodes, d = selected.elements["line"], selected.nodes, values[0].shape[1]
    X, rest, EA, prestress, m = selected.rows("line", values)
    force = BarForce(lines, nodes, X, rest, EA, prestress, strain, slack)
    if lumped:
        M = np.repeat(lumped_mass(lines, (m / 2.0)[:, None], nodes), d)
    else:
        unit = (m / 6.0)[:, None, None] * [[2.0, 1.0], [1.0, 2.0]]
        M = sp.csr_array(sp.kron(Pattern.of(lines, nodes).matrix(unit), sp.eye_array(d)))
    return M, sp.csr_array((d * nodes, d * nodes)), (force,)


class BarForce(Conservative):
    def __init__(
        self,
        lines: np.ndarray,
        nodes: int,
        along: np.ndarray,
        rest: np.ndarray,
        EA: np.ndarray,
        prestress: np.ndarray,
        strain: str,
        slack: bool,
    ):
        self._assembly = Assembly(lines, nodes, along.shape[1])
        self._along = along
        self._rest, self._EA, self._prestress = rest, EA, prestress
        self._green, self._slack = strain == "green", slack
        # l^2 - L0^2 at u = 0
        self._excess = np.sum(self._along**2, axis=1) - rest**2
        # without the rounding of the root
        self._excess[rest == np.sqrt(np.sum(self._along**2, axis=1))] = 0.0
        super().__init__(self._assembly.pattern)

    def _strained(self, u: np.ndarray) -> tuple[np.ndarray, ...]:
        """Vectors along the bars, their lengths, strains, and the force before slack."""
        moved = u.reshape(self._assembly.nodes, -1)
        lines = self._assembly.elements
        change = moved[lines[:, 1]] - moved[lines[:, 0]]
        x = self._along + change
        # l^2 - L0^2 = (|X|^2 - L0^2) + (x + X) . (x - X), without cancellation
        grown = self._excess + np.sum((x + self._along) * change, axis=1)
        length = np.sqrt(np.sum(x * x, axis=1))
        L0 = self._rest
        e = 0.5 * grown / L0**2 if self._green else grown / (L0 * (length + L0))
        return x, length, e, self._EA * e + self._prestress

    def _evaluate(
        self, u: np.ndarray, q: np.ndarray, tangent: bool
    ) -> tuple[np.ndarray, Any, np.ndarray]:
        x, length, _, N = self._strained(u)
        EA = self._EA
        if self._slack:
            EA, N = np.where(N > 0.0, EA, 0.0), np.maximum(N, 0.0)
        # f = s x at the second end; df = s dx + k x (x . dx)
        if self._green:
            s, k = N / self._rest, EA / self._rest**3
        else:
            with np.errstate(divide="ignore", invalid="ignore"):
                s = N / length
                k = (EA / self._rest - s) / length**2
        pull = s[:, None] * x
        f = self._assembly.force(np.stack([-pull, pull], axis=1))
        if not tangent:
            return f, None, q
        block = k[:, None, None] * x[:, :, None] * x[:, None, :]
        block += s[:, None, None] * np.eye(x.shape[1])
        signs = np.array([[1.0, -1.0], [-1.0, 1.0]])
        values = signs[None, :, None, :, None] * block[:, None, :, None, :]
        return f, self._assembly.tangent(values), q

    def _potential(self, u: np.ndarray) -> float:
        _, _, e, N = self._strained(u)
        start: Any = self._prestress
        if self._slack:
            N, start = np.maximum(N, 0.0), np.maximum(start, 0.0)
        # int N de from e = 0 = (N^2 - N0^2) / (2 EA)
        return float(np.sum(self._rest * (N + start) * (N - start) / (2.0 * self._EA)))
