"""Plane frames of beams, linear or with large rotations."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from .._checks import check_word, flag, listing, plain_array, real_number, require_moderate
from .checked import dimension_of, is_lumped, mesh_arguments, per_element, positive
from .element_force import Conservative, Made, Selected
from .lines import SPRING
from .pattern import Assembly, Pattern, lumped_mass
from .stress import rotations
from .structure import COINCIDENT, Structure

__all__ = ["beam_frame", "corotational_frame", "subdivide"]

# of one member
MOST_DIVISIONS = 10**9


# Inertia of a lumped end: 1/78 keeps the ratios of the consistent diagonal.
ROTARY = 1.0 / 78.0

# Cubic Hermite beam of length 1, dofs ux uy rz of both ends: stiffness for EI = 1 and EA = 0, for
# EI = 0 and EA = 1, and 420 times the mass. For length L rows and columns of rz have a factor L.
BENDING = np.zeros((6, 6))
BENDING[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = [
    [12, 6, -12, 6],
    [6, 4, -6, 2],
    [-12, -6, 12, -6],
    [6, 2, -6, 4],
]
AXIAL = np.zeros((6, 6))
AXIAL[np.ix_([0, 3], [0, 3])] = SPRING
BEAM_MASS = np.zeros((6, 6))
BEAM_MASS[np.ix_([0, 3], [0, 3])] = [[140, 70], [70, 140]]
BEAM_MASS[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = [
    [156, 22, 54, -13],
    [22, 4, 13, -3],
    [54, 13, 156, -22],
    [-13, -3, -22, 4],
]


# Timoshenko beam of length 1: 420 (1 + Phi)^2 times the mass, by powers of Phi. Dofs uy rz of both
# ends, the upper triangle row by row; and the same of the rotary inertia (Przemieniecki, Theory of
# Matrix Structural Analysis, 1968, chapter 11).
TRANSLATION = np.array(
    [
        [156, 22, 54, -13, 4, 13, -3, 156, -22, 4],
        [294, 38.5, 126, -31.5, 7, 31.5, -7, 294, -38.5, 7],
        [140, 17.5, 70, -17.5, 3.5, 17.5, -3.5, 140, -17.5, 3.5],
    ]
)
ROTATION = np.array(
    [
        [504, 42, -504, 42, 56, -42, -14, 504, -42, 56],
        [0, -210, 0, -210, 70, 210, -70, 0, 210, 70],
        [0, 0, 0, 0, 140, 0, 70, 0, 0, 140],
    ]
)


def beam_frame(
    points: ArrayLike,
    members: ArrayLike,
    *,
    EA: ArrayLike,
    EI: ArrayLike,
    rhoA: ArrayLike,
    GA: ArrayLike | None = None,
    divisions: int | ArrayLike = 1,
    mass: str = "consistent",
    rotary: float = ROTARY,
) -> Structure:
    """A plane frame of straight, extensible beams with rigid joints.

    Linear axial displacement; Euler-Bernoulli beams with cubic transverse displacement (Cook and
    others, Concepts and Applications of Finite Element Analysis), and with `GA` Timoshenko beams,
    exact for loads at their ends (Przemieniecki, Theory of Matrix Structural Analysis).

    Parameters
    ----------
    points : (N, 2) array_like
        Ends of members.
    members : (m, 2) array_like of int
        The two points that each member connects.
    EA, EI, rhoA : float or (m,) array_like
        Axial stiffness, bending stiffness, mass per length.
    GA : float or (m,) array_like, optional
        Shear stiffness, shear factor included: 5/6 G A for a rectangle. ``np.inf``: a member
        without shear deformation. The consistent mass then has the inertia rhoA EI / EA of the
        cross sections too. Default: none.
    divisions : int or (m,) array_like of int, default 1
        Number of equal elements per member, by `subdivide`: the given points keep their numbers.
    mass : {"consistent", "lumped"}
        Lumped: half the mass of an element on each node, ``rotary * mass * length**2`` on rz.
    rotary : float, at least 0, default 1/78
        1/78 keeps the ratios of the consistent diagonal (Hinton, Rock, Zienkiewicz 1976), 1/24 is
        the inertia of two rigid halves. With 0, rz has no mass, which explicit schemes refuse.

    Returns
    -------
    Structure
        Components "ux", "uy", "rz", elements "line".

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, points that no member uses, members without length, numbers that are
        not positive.

    Examples
    --------
    >>> from pmalpha import structures
    >>> frame = structures.beam_frame([[0, 0], [3, 4]], [[0, 1]], EA=5.0, EI=1.0, rhoA=2.0)
    >>> frame.K[[0], [0]].round(4).tolist()  # 9/25 EA/L + 16/25 12 EI/L^3
    [0.4214]
    """
    nodes, lines, member, values = frame_arguments(points, members, divisions, EA, EI, rhoA)
    along = nodes[lines[:, 1]] - nodes[lines[:, 0]]
    inertia = real_number(rotary, "rotary", low=0.0)
    phi = shear_ratio(GA, values[1], np.hypot(*along.T), member)
    recipe = partial(_assembled, (along, *values, phi), is_lumped(mass), inertia)
    return Structure._of(recipe, nodes, {"line": lines}, ("ux", "uy", "rz"))


def frame_arguments(
    points: Any, members: Any, divisions: Any, EA: Any, EI: Any, rhoA: Any
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Nodes, lines, the member, and EA, EI, rhoA of each element."""
    nodes, lines, member = subdivide(*mesh_arguments(points, members, "members", 2, 2), divisions)
    count = (member[-1] + 1,)
    axial, bending, density = (
        np.broadcast_to(positive(value, name, count), count)[member]
        for name, value in (("EA", EA), ("EI", EI), ("rhoA", rhoA))
    )
    return nodes, lines, member, (axial, bending, density)


def shear_ratio(GA: Any, EI: np.ndarray, L: np.ndarray, member: np.ndarray) -> np.ndarray:
    """Phi = 12 EI / (GA L^2) (E,) of each element, 0 without shear deformation."""
    if GA is None:
        return np.zeros(len(L))
    count = int(member[-1]) + 1
    values = np.asarray(plain_array(GA, "GA"), dtype=float)
    if values.shape not in ((), (count,)) or not np.all(values > 0.0):
        raise ValueError(
            f"GA must be positive numbers of shape () or ({count},), got {values.tolist()}"
        )
    finite = np.isfinite(values)
    positive(np.where(finite, values, 1.0), "GA", values.shape)  # and in the range of numbers
    result: np.ndarray = 12.0 * EI / (np.broadcast_to(values, (count,))[member] * L**2)
    return result


def _assembled(
    beams: Sequence[np.ndarray], lumped: bool, rotary: float, selected: Selected
) -> Made:
    lines, nodes = selected.elements["line"], selected.nodes
    x, EA, EI, rhoA, phi = selected.rows("line", beams)
    return *beam_matrices(lines, x, EA, EI, rhoA, lumped, rotary, nodes, phi), ()


def beam_matrices(
    lines: np.ndarray,
    x: np.ndarray,
    EA: np.ndarray,
    EI: np.ndarray,
    rhoA: np.ndarray,
    lumped: bool,
    rotary: float,
    nodes: int,
    phi: np.ndarray | None = None,
) -> tuple[Any, sp.csr_array]:
    """M, or its diagonal if lumped, and K; x (E, 2) along the elements, phi (E,) of shear."""
    L = np.hypot(*x.T)
    direction = x / L[:, None]
    pattern = Pattern.of(lines, nodes)
    if lumped:
        M = lumped_beams(lines, rhoA * L, rotary * rhoA * L**3, nodes)
    else:
        local = _scaled(rhoA * L / 420.0, BEAM_MASS, L)
        if phi is not None and phi.any():
            local = np.where(phi[:, None, None] > 0.0, _thick_mass(rhoA, EI / EA, L, phi), local)
        M = pattern.matrix(_turned(local, direction))
    bending = _scaled(EI / L**3, BENDING, L)
    if phi is not None and phi.any():
        bending = _scaled(EI / (L**3 * (1.0 + phi)), _thick_bending(phi), L)
    return M, pattern.matrix(_turned(_scaled(EA / L, AXIAL, L) + bending, direction))


def _thick_bending(phi: np.ndarray) -> np.ndarray:
    """(E, 6, 6): (1 + Phi) times the bending stiffness of length 1 and EI = 1."""
    unit = np.tile(BENDING, (len(phi), 1, 1))
    for i, j, sign in ((2, 2, 1.0), (5, 5, 1.0), (2, 5, -1.0), (5, 2, -1.0)):
        unit[:, i, j] += sign * phi
    return unit


def _thick_mass(rhoA: np.ndarray, square: np.ndarray, L: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """(E, 6, 6): the consistent mass of Timoshenko beams; square (E,): I / A."""
    powers = np.column_stack([np.ones(len(phi)), phi, phi**2])
    entries = powers @ TRANSLATION + (square / L**2)[:, None] * (powers @ ROTATION)
    unit = np.tile(BEAM_MASS, (len(phi), 1, 1))
    rows, columns = np.triu_indices(4)
    across = np.array([1, 2, 4, 5])
    for i, j, values in zip(across[rows], across[columns], entries.T):
        unit[:, i, j] = unit[:, j, i] = values / (1.0 + phi) ** 2
    return _scaled(rhoA * L / 420.0, unit, L)


def lumped_beams(
    lines: np.ndarray, mass: np.ndarray, inertia: np.ndarray, nodes: int
) -> np.ndarray:
    """(3 N,): half the mass (E,) on ux and uy of both ends, the inertia (E,) on rz."""
    half = lumped_mass(lines, mass[:, None] / 2.0, nodes)
    return np.column_stack([half, half, lumped_mass(lines, inertia[:, None], nodes)]).ravel()


def _scaled(factor: np.ndarray, unit: np.ndarray, L: np.ndarray) -> np.ndarray:
    """(E, 6, 6): the matrix of length 1 times a factor, rows and columns of rotations times L."""
    S = np.ones((len(L), 6))
    S[:, [2, 5]] = L[:, None]
    result: np.ndarray = factor[:, None, None] * S[:, :, None] * unit * S[:, None, :]
    return result


def _turned(local: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(E, 2, 3, 2, 3): element matrices (E, 6, 6) in global components."""
    R = rotations(direction)  # local = R global
    blocks = local.reshape(-1, 2, 3, 2, 3)
    result: np.ndarray = np.einsum("eki,eakbl,elj->eaibj", R, blocks, R, optimize=True)
    return result


def subdivide(
    points: ArrayLike, members: ArrayLike, divisions: int | ArrayLike
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut straight members into equal elements.

    Parameters
    ----------
    points : (N, dim) array_like
        Ends of members.
    members : (m, 2) array_like of int
        The two points that each member connects.
    divisions : int or (m,) array_like of int
        Number of elements of each member, at least 1.

    Returns
    -------
    points : (N + new, dim) ndarray
        The given points, then the new ones, member by member from its first end to its second.
    lines : (E, 2) ndarray of int
        Member by member.
    member : (E,) ndarray of int
        The member of each element.

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, points that no member uses, members without length.

    Examples
    --------
    >>> from pmalpha import structures
    >>> points, members = [[0, 0], [0, 3], [2, 3]], [[0, 1], [1, 2]]
    >>> points, lines, member = structures.subdivide(points, members, [3, 2])
    >>> points[3:].tolist()
    [[0.0, 1.0], [0.0, 2.0], [1.0, 3.0]]
    >>> lines.tolist(), member.tolist()
    ([[0, 3], [3, 4], [4, 1], [1, 5], [5, 2]], [0, 0, 0, 1, 1])
    """
    ends, lines = mesh_arguments(points, members, "members", None, 2)
    require_length(ends[lines], "members")
    counts = _divisions(divisions, len(lines))
    member = np.repeat(np.arange(len(lines)), counts)
    last = np.cumsum(counts) - 1  # last element of each member
    index = np.arange(len(member)) - (last - counts + 1)[member]  # of an element in its member
    inner = index > 0  # elements that begin at a new point
    new = np.full(len(member), -1)
    new[inner] = len(ends) + np.arange(np.count_nonzero(inner))
    first = np.where(inner, new, lines[member, 0])
    second = np.append(first[1:], 0)
    second[last] = lines[:, 1]
    fraction = (index[inner] / counts[member[inner]])[:, None]
    a, b = (ends[lines[member[inner], side]] for side in (0, 1))
    return np.vstack([ends, a + fraction * (b - a)]), np.column_stack([first, second]), member


def _divisions(value: Any, count: int) -> np.ndarray:
    divisions = plain_array(value, "divisions")
    if divisions.dtype.kind not in "iu":
        raise TypeError(f"divisions must be whole numbers, got dtype {divisions.dtype}")
    if divisions.shape not in ((), (count,)):
        raise ValueError(f"divisions must have shape () or ({count},), got {divisions.shape}")
    if np.any(divisions > MOST_DIVISIONS):
        raise ValueError(f"divisions must be at most {MOST_DIVISIONS}, got {divisions.max()}")
    if np.any(divisions < 1):
        raise ValueError(f"divisions must be at least 1, got {int(divisions.min())}")
    return np.broadcast_to(divisions, count).astype(np.int64)


def require_length(corners: np.ndarray, name: str, of: str = "") -> None:
    """ValueError for lines (E, 2 or more, d) that begin and end at one place."""
    apart = np.abs(corners[:, 1] - corners[:, 0]).max(axis=1)
    short = np.flatnonzero(~(apart > COINCIDENT * np.abs(corners).max()))
    if short.size:
        raise ValueError(f"{name} must have a length, got none in {listing(short)}{of}")


def corotational_frame(
    points: ArrayLike,
    members: ArrayLike,
    *,
    EA: ArrayLike,
    EI: ArrayLike,
    rhoA: ArrayLike,
    GA: ArrayLike | None = None,
    divisions: int | ArrayLike = 1,
    rotary: float = 1.0 / 78.0,
) -> Structure:
    """A plane frame of beams with large displacements and rotations.

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
    GA : float or (m,) array_like, optional
        Shear stiffness, as of `beam_frame`.
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
    nodes, lines, member, values = frame_arguments(points, members, divisions, EA, EI, rhoA)
    axial, bending, density = values
    X = nodes[lines[:, 1]] - nodes[lines[:, 0]]
    mass = density * np.hypot(*X.T)
    inertia = real_number(rotary, "rotary", low=0.0) * mass * np.hypot(*X.T) ** 2
    phi = shear_ratio(GA, bending, np.hypot(*X.T), member)
    recipe = partial(_corotational, (X, axial, bending, phi, mass, inertia))
    return Structure._of(recipe, nodes, {"line": lines}, ("ux", "uy", "rz"))


def _corotational(beams: Sequence[np.ndarray], selected: Selected) -> Made:
    along, EA, EI, phi, mass, inertia = selected.rows("line", beams)
    lines = selected.elements["line"]
    M = lumped_beams(lines, mass, inertia, selected.nodes)
    force = BeamForce(lines, selected.nodes, along, EA, EI, phi)
    return M, sp.csr_array((M.size, M.size)), (force,)


class BeamForce(Conservative):
    def __init__(
        self,
        lines: np.ndarray,
        nodes: int,
        along: np.ndarray,
        EA: np.ndarray,
        EI: np.ndarray,
        phi: np.ndarray,
    ):
        self._assembly = Assembly(lines, nodes, 3)
        self._along = along
        self._length = np.hypot(*self._along.T)
        self._EA = EA
        # moments for EI / L of the rotations of the same end and of the other one
        near, far = (4.0 + phi) / (1.0 + phi), (2.0 - phi) / (1.0 + phi)
        self._near, self._far = near * EI / self._length, far * EI / self._length
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
        EA = self._EA / self._length
        N = EA * elongation
        moments = self._near[:, None] * theta + self._far[:, None] * theta[:, ::-1]
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
        return f, self._assembly.tangent(self._tangents(r, z, length, N, shear, EA)), q

    def _potential(self, u: np.ndarray) -> float:
        _, _, elongation, theta = self._deformed(u)
        axial = 0.5 * self._EA / self._length * elongation**2
        bending = 0.5 * self._near * np.sum(theta**2, axis=1)
        return float(np.sum(axial + bending + self._far * theta[:, 0] * theta[:, 1]))

    def _tangents(
        self,
        r: np.ndarray,
        z: np.ndarray,
        length: np.ndarray,
        N: np.ndarray,
        shear: np.ndarray,
        EA: np.ndarray,
    ) -> np.ndarray:
        """(E, 2, 3, 2, 3) = B^T D B + N z z^T / l + (M1 + M2) / l^2 (r z^T + z r^T)."""
        near, far = self._near, self._far
        r, z = r.reshape(-1, 6), z.reshape(-1, 6)
        # rows of B: d(elongation)/du, d(theta_1)/du, d(theta_2)/du
        first, second = (-z / length[:, None] for _ in range(2))
        first[:, 2] += 1.0
        second[:, 5] += 1.0

        def outer(factor: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
            result: np.ndarray = factor[:, None, None] * a[:, :, None] * b[:, None, :]
            return result

        K = outer(EA, r, r) + outer(N / length, z, z)
        K += outer(near, first, first) + outer(near, second, second)
        K += outer(far, first, second) + outer(far, second, first)
        K += outer(shear / length, r, z) + outer(shear / length, z, r)
        result: np.ndarray = K.reshape(-1, 2, 3, 2, 3)
        return result


# ---- bars ---------------------------------------------------------------------------------------
# Bars and cables with large displacements.

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
    recipe = partial(_assembled_bars, values, strain, flag(slack, "slack"), is_lumped(mass))
    return Structure._of(recipe, nodes, {"line": lines}, ("ux", "uy", "uz")[: nodes.shape[1]])


def _assembled_bars(
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
