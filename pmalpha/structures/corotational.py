"""Plane frames of beams with large rotations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from .._checks import real_number
from .element_force import Conservative
from .frames import frame_arguments, lumped_beams
from .recipe import Chosen, Made, of_chosen
from .structure import Structure
from .tangent_sums import Assembly

__all__ = ["corotational_frame"]


def corotational_frame(
    points: ArrayLike,
    members: ArrayLike,
    *,
    EA: ArrayLike,
    EI: ArrayLike,
    rhoA: ArrayLike,
    divisions: int | ArrayLike = 1,
    rotary: float = 1.0 / 78.0,
) -> Structure:
    """A plane frame of Euler-Bernoulli beams with large displacements and rotations.

    Corotational: each element is the linear beam of `beam_frame` in axes that turn with its chord
    (Crisfield, Non-linear Finite Element Analysis of Solids and Structures, volume 1, chapter 7).
    Displacements and rotations are of any size; the rotation of a node from the chord of an element
    must remain below half a turn, and is accurate while it is small, so members that bend much are
    divided.

    Parameters
    ----------
    points : (N, 2) array_like
        Coordinates of the nodes.
    members : (m, 2) array_like of int
        The two points that each member connects.
    EA, EI, rhoA : float or (m,) array_like
        Axial stiffness, bending stiffness, mass per length.
    divisions : int or (m,) array_like of int, default 1
        Number of equal elements per member, by `subdivide`: the given points keep their numbers.
    rotary : float, at least 0, default 1/78
        Inertia of an element's end on rz over mass * length**2, as for the lumped mass of
        `beam_frame`. With 0, rz has no mass, which explicit schemes refuse.

    Returns
    -------
    Structure
        K has no entries, `internal` has one force. M is lumped, so that it is the same in every
        position. Components "ux", "uy", "rz", elements "line".

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, points that no member uses, members without length, numbers that are
        not positive.

    Examples
    --------
    At rest its tangent is the stiffness of the linear frame:

    >>> from pmalpha import structures
    >>> beam = {"EA": 5.0, "EI": 1.0, "rhoA": 2.0, "divisions": 3}
    >>> turning = structures.corotational_frame([[0, 0], [3, 4]], [[0, 1]], **beam)
    >>> linear = structures.beam_frame([[0, 0], [3, 4]], [[0, 1]], **beam)
    >>> bool(abs(turning.tangent() - linear.K).max() < 1e-14 * abs(linear.K).max())
    True
    """
    nodes, lines, values = frame_arguments(points, members, divisions, EA, EI, rhoA)
    axial, bending, density = values
    X = nodes[lines[:, 1]] - nodes[lines[:, 0]]
    mass = density * np.hypot(*X.T)
    inertia = real_number(rotary, "rotary", low=0.0) * mass * np.hypot(*X.T) ** 2
    recipe = partial(_assembled, (X, axial, bending, mass, inertia))
    return Structure._of(recipe, nodes, {"line": lines}, ("ux", "uy", "rz"))


def _assembled(
    beams: Sequence[np.ndarray],
    chosen: Chosen,
    elements: Mapping[str, np.ndarray],
    nodes: int,
) -> Made:
    along, EA, EI, mass, inertia = (of_chosen(values, chosen["line"]) for values in beams)
    M = lumped_beams(elements["line"], mass, inertia, nodes)
    force = BeamForce(elements["line"], nodes, along, EA, EI)
    return M, sp.csr_array((M.size, M.size)), (force,)


class BeamForce(Conservative):
    """The internal force of corotational beams."""

    def __init__(
        self, lines: np.ndarray, nodes: int, along: np.ndarray, EA: np.ndarray, EI: np.ndarray
    ):
        self._assembly = Assembly(lines, nodes, 3)
        self._along = along
        self._length = np.hypot(*self._along.T)
        self._EA, self._EI = EA, EI
        super().__init__(self._assembly.pattern)

    def _deformed(self, u: np.ndarray) -> tuple[np.ndarray, ...]:
        """Direction (E, 2) and length of the chords, elongations, and end rotations (E, 2)."""
        ends = u.reshape(-1, 3)[self._assembly.elements]  # (E, 2, 3)
        X, L = self._along, self._length
        change = ends[:, 1, :2] - ends[:, 0, :2]
        x = X + change
        length = np.hypot(*x.T)
        # l - L = (l^2 - L^2) / (l + L), without cancellation
        elongation = np.sum((x + X) * change, axis=1) / (length + L)
        turn = np.arctan2(
            X[:, 0] * x[:, 1] - X[:, 1] * x[:, 0], X[:, 0] * x[:, 0] + X[:, 1] * x[:, 1]
        )
        # whole turns of the chord are those of its ends
        rotations = ends[:, :, 2]
        turn += 2.0 * np.pi * np.round((rotations.mean(axis=1) - turn) / (2.0 * np.pi))
        with np.errstate(divide="ignore", invalid="ignore"):
            direction = x / length[:, None]
        return direction, length, elongation, rotations - turn[:, None]

    def _evaluate(
        self, u: np.ndarray, q: np.ndarray, tangent: bool
    ) -> tuple[np.ndarray, Any, np.ndarray]:
        direction, length, elongation, theta = self._deformed(u)
        EA, EI = self._EA / self._length, self._EI / self._length
        N = EA * elongation
        moments = 2.0 * EI[:, None] * (2.0 * theta + theta[:, ::-1])
        shear = moments.sum(axis=1) / length
        c, s = direction.T
        # with r = dl/du and z / l = d(turn)/du:  f = N r - (M1 + M2) / l z + M1 e1 + M2 e2
        ends = np.array([-1.0, 1.0])
        r, z = np.zeros((len(c), 2, 3)), np.zeros((len(c), 2, 3))
        r[:, :, 0], r[:, :, 1] = c[:, None] * ends, s[:, None] * ends
        z[:, :, 0], z[:, :, 1] = -s[:, None] * ends, c[:, None] * ends
        forces = N[:, None, None] * r - shear[:, None, None] * z
        forces[:, :, 2] += moments
        f = self._assembly.force(forces)
        if not tangent:
            return f, None, q
        return f, self._assembly.tangent(_tangents(r, z, length, N, shear, EA, EI)), q

    def _potential(self, u: np.ndarray) -> float:
        _, _, elongation, theta = self._deformed(u)
        axial = 0.5 * self._EA / self._length * elongation**2
        bending = np.sum(theta**2, axis=1) + theta[:, 0] * theta[:, 1]
        return float(np.sum(axial + 2.0 * self._EI / self._length * bending))


def _tangents(
    r: np.ndarray,
    z: np.ndarray,
    length: np.ndarray,
    N: np.ndarray,
    shear: np.ndarray,
    EA: np.ndarray,
    EI: np.ndarray,
) -> np.ndarray:
    """(E, 2, 3, 2, 3) = B^T D B + N z z^T / l + (M1 + M2) / l^2 (r z^T + z r^T)."""
    r, z = r.reshape(-1, 6), z.reshape(-1, 6)
    # rows of B: d(elongation)/du, d(theta_1)/du, d(theta_2)/du
    first, second = (-z / length[:, None] for _ in range(2))
    first[:, 2] += 1.0
    second[:, 5] += 1.0

    def outer(factor: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        result: np.ndarray = factor[:, None, None] * a[:, :, None] * b[:, None, :]
        return result

    K = outer(EA, r, r) + outer(N / length, z, z)
    K += outer(4.0 * EI, first, first) + outer(4.0 * EI, second, second)
    K += outer(2.0 * EI, first, second) + outer(2.0 * EI, second, first)
    K += outer(shear / length, r, z) + outer(shear / length, z, r)
    result: np.ndarray = K.reshape(-1, 2, 3, 2, 3)
    return result
