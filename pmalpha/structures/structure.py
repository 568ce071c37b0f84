"""Finite-element structures with their meshes: chains, rods, plane frames, plates, solids.

Each function returns a `Structure`: mass and stiffness of all dofs, none of them fixed, with the
points and elements that pictures need. Dof of node i, component c: dofs_per_node * i + c. Elements
have the names and the order of corners of meshio and VTK. Units are any consistent set.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from .._checks import (
    listing,
    plain_array,
    positive_number,
    real_array,
    real_number,
    vector,
    whole_number,
)
from ..problem.constraints import dof_list
from ..problem.matrices import Matrix, canonical, combination, dense, diagonal, product
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain

__all__ = [
    "Structure",
    "beam_frame",
    "chain",
    "modes",
    "plate",
    "plate_on",
    "rod",
    "solid",
    "solid_on",
    "subdivide",
    "submesh",
]

# Corners of the reference elements, in meshio's order.
QUAD = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
HEXAHEDRON = np.array([[x, y, z] for z in (-1, 1) for x, y in QUAD])
# Coordinates that differ by less, relative to the largest one, are the same.
SAME_PLACE = 1e-9


@dataclass(frozen=True, eq=False)
class Structure:
    """Matrices of a structure and the mesh they belong to.

    Attributes
    ----------
    M : (n,) ndarray or (n, n) csr_array
        Mass; 1-D when lumped.
    K : (n, n) csr_array
        Stiffness.
    points : (N, dim) ndarray
        Where the nodes are.
    elements : dict
        By meshio's name ("line", "quad", "hexahedron"): (E, corners) array of node numbers.
    components : tuple of str
        Of the dofs of a node, in their order: "ux", "uy", "uz" are displacements along the axes,
        "rz" is a rotation, counter-clockwise.

    Raises
    ------
    ValueError
        If M and K do not have one row for each component of each point.

    Examples
    --------
    >>> from pmalpha import models
    >>> wall = models.plate(4, 2, 0.5, E=30e9, nu=0.2, rho=2500.0, t=0.3)
    >>> foot = wall.dofs(wall.nodes_at(y=0.0))
    >>> wall.n, foot.tolist()
    (30, [0, 1, 6, 7, 12, 13, 18, 19, 24, 25])
    """

    M: Any
    K: Any
    points: np.ndarray
    elements: Mapping[str, np.ndarray]
    components: tuple[str, ...]

    def __post_init__(self):
        n = len(self.points) * len(self.components)
        for name, rows in (("M", self.M.shape[0]), ("K", self.K.shape[0])):
            if rows != n:
                raise ValueError(
                    f"{name} must have {n} rows, {len(self.components)} for each of "
                    f"{len(self.points)} points, got {rows}"
                )

    def __repr__(self) -> str:
        counts = ", ".join(f"{len(e)} {name}" for name, e in self.elements.items())
        return f"<Structure {len(self.points)} points, {counts}, {self.n} dofs>"

    @property
    def dofs_per_node(self) -> int:
        """How many components a node has."""
        return len(self.components)

    @property
    def n(self) -> int:
        """How many dofs there are."""
        return len(self.points) * len(self.components)

    def nodes(self, where: Callable[..., Any]) -> np.ndarray:
        """The nodes where a condition on the coordinates holds, in rising order.

        Parameters
        ----------
        where : callable
            Gets each coordinate of all nodes as an (N,) array, ``where(x, y)`` in the plane, and
            returns N truth values.

        Raises
        ------
        ValueError
            If the answer is not of shape (N,) and boolean, or holds nowhere.

        Examples
        --------
        >>> from pmalpha import models
        >>> bar = models.rod(4, 2.0, EA=1.0, rhoA=1.0)
        >>> bar.nodes(lambda x: x > 0.9).tolist()
        [2, 3, 4]
        """
        chosen = np.asarray(where(*self.points.T))
        if chosen.shape != (len(self.points),) or chosen.dtype != bool:
            raise ValueError(
                f"where must return {len(self.points)} truth values, got dtype {chosen.dtype} "
                f"and shape {chosen.shape}"
            )
        if not chosen.any():
            raise ValueError(f"where must hold at one node at least, got none of {len(chosen)}")
        return np.flatnonzero(chosen)

    def nodes_at(
        self, *, x: float | None = None, y: float | None = None, z: float | None = None
    ) -> np.ndarray:
        """The nodes with these coordinates, up to rounding (1e-9 of the largest coordinate).

        Parameters
        ----------
        x, y, z : float, optional
            One at least; None stands for any.

        Raises
        ------
        ValueError
            If no node is there, or the points do not have that coordinate.

        Examples
        --------
        >>> from pmalpha import models
        >>> box = models.solid(2, 1, 1, 0.1, E=1.0, nu=0.3, rho=1.0)
        >>> box.nodes_at(x=0.2, z=0.1).tolist()
        [9, 11]
        """
        asked = {axis: v for axis, v in zip("xyz", (x, y, z)) if v is not None}
        dim = self.points.shape[1]
        if not asked or max("xyz".index(axis) for axis in asked) >= dim:
            raise ValueError(f"nodes_at needs one or more of {', '.join('xyz'[:dim])}, got {asked}")
        columns = ["xyz".index(axis) for axis in asked]
        away = np.abs(self.points[:, columns] - [real_number(v, a) for a, v in asked.items()])
        found = np.flatnonzero(np.all(away <= SAME_PLACE * np.abs(self.points).max(), axis=1))
        if not found.size:
            low, high = self.points.min(axis=0), self.points.max(axis=0)
            raise ValueError(
                f"nodes_at must meet a node, got {asked}; the points lie between "
                f"{low.tolist()} and {high.tolist()}"
            )
        return found

    def dofs(self, nodes: Any, component: str | Sequence[str] | None = None) -> np.ndarray:
        """Dofs of nodes, node by node.

        Parameters
        ----------
        nodes : int or (k,) array of int
        component : str or sequence of str, optional
            Of `components`. Default: all.

        Returns
        -------
        (k * chosen components,) ndarray of int

        Raises
        ------
        TypeError, ValueError
            For nodes out of range or repeated, and components that are not there.

        Examples
        --------
        >>> from pmalpha import models
        >>> frame = models.beam_frame([[0, 0], [0, 3]], [[0, 1]], EA=1.0, EI=1.0, rhoA=1.0)
        >>> frame.dofs([0, 1], "ux").tolist(), frame.dofs(1, ["ux", "rz"]).tolist()
        ([0, 3], [3, 5])
        """
        chosen = dof_list(np.atleast_1d(nodes), len(self.points), "nodes")
        names = (component,) if isinstance(component, str) else component or self.components
        unknown = [name for name in names if name not in self.components]
        if unknown:
            raise ValueError(f"component must be of {self.components}, got {unknown[0]!r}")
        places = [self.components.index(name) for name in names]
        return (self.dofs_per_node * chosen[:, None] + places).ravel()

    def damping(self, c_m: float, c_k: float) -> Matrix:
        """Rayleigh damping C = c_m M + c_k K, with coefficients as `rayleigh` returns them.

        Parameters
        ----------
        c_m, c_k : float
            In 1/time and in time, at least 0.

        Returns
        -------
        (n,) ndarray, csr_array or None
            1-D where only a lumped mass contributes, None where nothing does.

        Raises
        ------
        TypeError, ValueError
            For coefficients that are not finite or negative.

        Examples
        --------
        >>> from pmalpha import models
        >>> masses = models.chain(2, 3.0, 5.0)
        >>> masses.damping(0.1, 0.01).toarray().round(3).tolist()
        [[0.35, -0.05], [-0.05, 0.35]]
        """
        c_m, c_k = real_number(c_m, "c_m", low=0.0), real_number(c_k, "c_k", low=0.0)
        return combination([(c_m, self.M), (c_k, self.K)])

    def subdomain(self, *, scheme: Scheme, **options) -> Subdomain:
        """A Subdomain of this M and K with nothing fixed; options are those of `Subdomain`.

        Parameters
        ----------
        scheme : Scheme
        **options
            Whatever else `Subdomain` takes: C, substeps, force, u0, name, ...

        Raises
        ------
        TypeError, ValueError, FactorizationError
            From `Subdomain`.

        Examples
        --------
        >>> from pmalpha import GeneralizedAlpha, models
        >>> bar = models.rod(4, 2.0, EA=1.0, rhoA=1.0, mass="lumped")
        >>> bar.subdomain(scheme=GeneralizedAlpha(0.5, explicit=True), name="bar").n
        5
        """
        return Subdomain(self.M, self.K, scheme=scheme, **options)


# ---- along a line ---------------------------------------------------------------------------

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
        How many masses, at least 1.
    mass : float or (n,) array_like
    stiffness : float or (n - 1,) array_like
        Of the spring between masses i and i + 1.
    ground : two floats, default (0, 0)
        Stiffness between the ground and the first mass, and between the last mass and the ground.
    spacing : float, default 1
        Distance of neighbours, in pictures only.

    Returns
    -------
    Structure
        Component "ux", elements "line", M of shape (n,).

    Raises
    ------
    TypeError, ValueError
        For numbers that are not finite, negative ones, and wrong lengths.

    Examples
    --------
    >>> from pmalpha import models
    >>> models.chain(3, 1.0, [10.0, 20.0], ground=(5.0, 0.0)).K.toarray().tolist()
    [[15.0, -10.0, 0.0], [-10.0, 30.0, -20.0], [0.0, -20.0, 20.0]]
    """
    n = whole_number(n, "n", low=1)
    M = np.broadcast_to(_values(mass, "mass", (n,)), n).copy()
    k = _values(stiffness, "stiffness", (n - 1,))
    ends = _values(vector(ground, 2, "ground"), "ground", (2,))
    held = np.zeros(n)
    held[0] += ends[0]
    held[-1] += ends[1]
    lines = _path(n)
    K = _Pattern.of(lines, n).matrix(k[:, None, None] * SPRING) + sp.diags_array(held)
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

    Waves run at c = sqrt(EA / rhoA). With lumped mass and central differences the step h / c of
    the element length h is the critical one, and there the solution at the nodes is exact (Hughes,
    The Finite Element Method).

    Parameters
    ----------
    n : int
        How many elements, at least 1.
    length : float
    EA, rhoA : float or (n,) array_like
        Axial stiffness (force) and mass per length.
    mass : {"consistent", "lumped"}
        Lumped: half the mass of an element on each of its nodes.
    origin : float, default 0
        Where the rod begins, on the x axis.

    Returns
    -------
    Structure
        n + 1 nodes, component "ux", elements "line".

    Raises
    ------
    TypeError, ValueError
        For numbers that are not positive, and wrong lengths.

    Examples
    --------
    >>> from pmalpha import models
    >>> bar = models.rod(2, 1.0, EA=3.0, rhoA=12.0)
    >>> bar.M.toarray().tolist(), models.rod(2, 1.0, EA=3.0, rhoA=12.0, mass="lumped").M.tolist()
    ([[2.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 2.0]], [3.0, 6.0, 3.0])
    """
    n = whole_number(n, "n", low=1)
    h = positive_number(length, "length") / n
    stiffness, density = _positive(EA, "EA", (n,)), _positive(rhoA, "rhoA", (n,))
    lines = _path(n + 1)
    pattern = _Pattern.of(lines, n + 1)
    if _is_lumped(mass):
        M = _lumped(lines, (density * h / 2.0)[:, None], n + 1)
    else:
        M = pattern.matrix((density * h / 6.0)[:, None, None] * [[2.0, 1.0], [1.0, 2.0]])
    K = pattern.matrix((stiffness / h)[:, None, None] * SPRING)
    points = real_number(origin, "origin") + h * np.arange(n + 1.0)[:, None]
    return Structure(M, K, points, {"line": lines}, ("ux",))


def _path(n: int) -> np.ndarray:
    """(n - 1, 2): each of n nodes and its right neighbour."""
    return np.column_stack([np.arange(n - 1), np.arange(1, n)])


# ---- plane frames ---------------------------------------------------------------------------

# Hermite's cubic beam of length 1, dofs ux uy rz of both ends: EI = 1 and EA = 0, the reverse,
# and 420 times the mass. For length L each rz takes a factor L.
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


def beam_frame(
    points: ArrayLike,
    members: ArrayLike,
    *,
    EA: ArrayLike,
    EI: ArrayLike,
    rhoA: ArrayLike,
    divisions: int | ArrayLike = 1,
    mass: str = "consistent",
    rotary: float = 1.0 / 78.0,
) -> Structure:
    """A plane frame of straight Euler-Bernoulli beams with rigid joints, stiff in tension too.

    Linear axial and cubic transverse displacement (Cook and others, Concepts and Applications of
    Finite Element Analysis).

    Parameters
    ----------
    points : (N, 2) array_like
    members : (m, 2) array_like of int
        Which points each member joins.
    EA, EI, rhoA : float or (m,) array_like
        Axial stiffness, bending stiffness, mass per length.
    divisions : int or (m,) array_like of int, default 1
        Equal elements of a member, by `subdivide`: the points given stay the first ones.
    mass : {"consistent", "lumped"}
        Lumped: half the mass of an element on each node, ``rotary * mass * length**2`` on rz.
    rotary : float, at least 0, default 1/78
        1/78 keeps the ratios of the consistent diagonal (Hinton, Rock, Zienkiewicz 1976), 1/24 is
        that of two rigid halves; dofs without mass, as with 0, are refused by explicit schemes.

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
    >>> from pmalpha import models
    >>> frame = models.beam_frame([[0, 0], [3, 4]], [[0, 1]], EA=5.0, EI=1.0, rhoA=2.0)
    >>> frame.K[[0], [0]].round(4).tolist()  # 9/25 EA/L + 16/25 12 EI/L^3
    [0.4214]
    """
    nodes, lines, member = subdivide(*_mesh(points, members, "members", 2, 2), divisions)
    count = (member[-1] + 1,)
    per_element = [
        np.broadcast_to(_positive(value, name, count), count)[member]
        for name, value in (("EA", EA), ("EI", EI), ("rhoA", rhoA))
    ]
    M, K = _beams(nodes, lines, *per_element, mass, real_number(rotary, "rotary", low=0.0))
    return Structure(M, K, nodes, {"line": lines}, ("ux", "uy", "rz"))


def _beams(
    nodes: np.ndarray,
    lines: np.ndarray,
    EA: np.ndarray,
    EI: np.ndarray,
    rhoA: np.ndarray,
    mass: str,
    rotary: float,
) -> tuple[Any, sp.csr_array]:
    """M and K; EA, EI, rhoA of each element."""
    along = nodes[lines[:, 1]] - nodes[lines[:, 0]]
    L = np.hypot(*along.T)
    direction = along / L[:, None]
    pattern = _Pattern.of(lines, len(nodes))
    if _is_lumped(mass):
        M = _lumped_beams(lines, rhoA * L, rotary * rhoA * L**3, len(nodes))
    else:
        M = pattern.matrix(_turned(_scaled(rhoA * L / 420.0, BEAM_MASS, L), direction))
    stiffness = _scaled(EA / L, AXIAL, L) + _scaled(EI / L**3, BENDING, L)
    return M, pattern.matrix(_turned(stiffness, direction))


def _lumped_beams(
    lines: np.ndarray, mass: np.ndarray, inertia: np.ndarray, nodes: int
) -> np.ndarray:
    """(3 N,): half the mass (E,) on ux and uy of both ends, the inertia (E,) on rz."""
    half = _lumped(lines, mass[:, None] / 2.0, nodes)
    return np.column_stack([half, half, _lumped(lines, inertia[:, None], nodes)]).ravel()


def _scaled(factor: np.ndarray, unit: np.ndarray, L: np.ndarray) -> np.ndarray:
    """(E, 6, 6): the matrix of length 1 times a factor, rotations times length."""
    S = np.ones((len(L), 6))
    S[:, [2, 5]] = L[:, None]
    return factor[:, None, None] * S[:, :, None] * unit * S[:, None, :]


def _turned(local: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(E, 2, 3, 2, 3): element matrices (E, 6, 6) in global components."""
    c, s = direction.T
    R = np.zeros((len(c), 3, 3))  # local = R global
    R[:, 0, 0], R[:, 0, 1] = c, s
    R[:, 1, 0], R[:, 1, 1] = -s, c
    R[:, 2, 2] = 1.0
    blocks = local.reshape(-1, 2, 3, 2, 3)
    return np.einsum("eki,eakbl,elj->eaibj", R, blocks, R, optimize=True)


def subdivide(
    points: ArrayLike, members: ArrayLike, divisions: int | ArrayLike
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut straight members into equal elements.

    Parameters
    ----------
    points : (N, dim) array_like
    members : (m, 2) array_like of int
    divisions : int or (m,) array_like of int
        Elements of each member, at least 1.

    Returns
    -------
    points : (N + new, dim) ndarray
        Those given first, then the new ones, member by member from its first end to its second.
    lines : (E, 2) ndarray of int
        Member by member.
    member : (E,) ndarray of int
        Which member an element is a piece of.

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, points that no member uses, members without length.

    Examples
    --------
    >>> from pmalpha import models
    >>> points, lines, member = models.subdivide([[0, 0], [0, 3], [2, 3]], [[0, 1], [1, 2]], [3, 2])
    >>> points[3:].tolist()
    [[0.0, 1.0], [0.0, 2.0], [1.0, 3.0]]
    >>> lines.tolist(), member.tolist()
    ([[0, 3], [3, 4], [4, 1], [1, 5], [5, 2]], [0, 0, 0, 1, 1])
    """
    ends, lines = _mesh(points, members, "members", None, 2)
    _require_length(ends, lines)
    counts = _divisions(divisions, len(lines))
    member = np.repeat(np.arange(len(lines)), counts)
    last = np.cumsum(counts) - 1  # element of each member
    place = np.arange(len(member)) - (last - counts + 1)[member]  # of an element in its member
    inner = place > 0  # elements that begin at a new point
    fresh = np.full(len(member), -1)
    fresh[inner] = len(ends) + np.arange(np.count_nonzero(inner))
    first = np.where(inner, fresh, lines[member, 0])
    second = np.append(first[1:], 0)
    second[last] = lines[:, 1]
    part = (place[inner] / counts[member[inner]])[:, None]
    a, b = (ends[lines[member[inner], side]] for side in (0, 1))
    return np.vstack([ends, a + part * (b - a)]), np.column_stack([first, second]), member


def _divisions(value: Any, count: int) -> np.ndarray:
    divisions = plain_array(value, "divisions")
    if divisions.dtype.kind not in "iu":
        raise TypeError(f"divisions must be whole numbers, got dtype {divisions.dtype}")
    if divisions.shape not in ((), (count,)):
        raise ValueError(f"divisions must be one or {count}, got shape {divisions.shape}")
    if np.any(divisions < 1):
        raise ValueError(f"divisions must be at least 1, got {int(divisions.min())}")
    return np.broadcast_to(divisions, count).astype(np.int64)


def _require_length(points: np.ndarray, lines: np.ndarray) -> None:
    apart = np.abs(points[lines[:, 1]] - points[lines[:, 0]]).max(axis=1)
    short = np.flatnonzero(~(apart > SAME_PLACE * np.abs(points).max()))
    if short.size:
        raise ValueError(f"members must have a length, got none in {listing(short)}")


# ---- plates and solids ----------------------------------------------------------------------


def plate(
    nx: int,
    ny: int,
    h: float | Sequence[float],
    *,
    E: ArrayLike,
    nu: ArrayLike,
    rho: ArrayLike,
    t: ArrayLike = 1.0,
    mass: str = "consistent",
    origin: Sequence[float] = (0.0, 0.0),
) -> Structure:
    """A rectangle in plane stress, nx by ny elements: `plate_on` a regular mesh.

    Node (i, j), at origin + (i hx, j hy), has the number (ny + 1) i + j; element (i, j) the number
    ny i + j. To place a second plate at the right: ``origin=(nx * h, 0)``.

    Parameters
    ----------
    nx, ny : int
        Elements along x and y, at least 1.
    h : float or two floats
        Edge of an element, or (hx, hy).
    E, nu, rho, t : float, (nx, ny) or (nx * ny,) array_like
        Young's modulus, Poisson's ratio in (-1, 0.5], density, thickness; as arrays by element,
        for plates of several materials.
    mass : {"consistent", "lumped"}
    origin : two floats, default (0, 0)
        Where the lower left corner is.

    Returns
    -------
    Structure
        Components "ux", "uy", elements "quad".

    Raises
    ------
    TypeError, ValueError
        For numbers that are not positive or not finite, and wrong shapes.

    Examples
    --------
    >>> from pmalpha import models
    >>> models.plate(99, 24, 0.1, E=1000.0, nu=0.3, rho=100.0)
    <Structure 2500 points, 2376 quad, 5000 dofs>
    """
    counts = whole_number(nx, "nx", low=1), whole_number(ny, "ny", low=1)
    points, quads, corners = _grid(counts, h, origin, QUAD)
    lam, mu, area_density = _plane_stress(E, nu, rho, t, counts)
    M, K = _continuum(quads, corners, QUAD, len(points), (lam, mu, area_density), mass)
    return Structure(M, K, points, {"quad": quads}, ("ux", "uy"))


def plate_on(
    points: ArrayLike,
    quads: ArrayLike,
    *,
    E: ArrayLike,
    nu: ArrayLike,
    rho: ArrayLike,
    t: ArrayLike = 1.0,
    mass: str = "consistent",
) -> Structure:
    """Plane stress on any mesh of quadrilaterals, bilinear, with 2 x 2 Gauss points.

    With n_a the shape functions and d_i their derivatives, the stiffness between component i of
    corner a and component j of corner b is the integral over the element of
    t (lam d_i n_a d_j n_b + mu d_j n_a d_i n_b + mu delta_ij sum_k d_k n_a d_k n_b), with
    mu = E / (2 (1 + nu)) and in plane stress lam = E nu / (1 - nu^2) (Hughes, The Finite Element
    Method). Full integration: thin shapes in bending need several elements through the depth.

    Parameters
    ----------
    points : (N, 2) array_like
    quads : (elements, 4) array_like of int
        Corners, counter-clockwise.
    E, nu, rho, t : float or (elements,) array_like
        Young's modulus, Poisson's ratio in (-1, 0.5], density, thickness.
    mass : {"consistent", "lumped"}
        Lumped: the row sums of the consistent one, which are positive.

    Returns
    -------
    Structure
        Components "ux", "uy", elements "quad".

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, points that no element uses, elements that are folded or numbered
        clockwise, numbers that are not positive.

    Examples
    --------
    A part of another plate, by `submesh`:

    >>> from pmalpha import models
    >>> whole = models.plate(4, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
    >>> points, quads, nodes = models.submesh(whole.points, whole.elements["quad"][:4])
    >>> models.plate_on(points, quads, E=1.0, nu=0.3, rho=1.0)
    <Structure 9 points, 4 quad, 18 dofs>
    """
    nodes, elements = _mesh(points, quads, "quads", 2, 4)
    lam, mu, area_density = _plane_stress(E, nu, rho, t, (len(elements),))
    coefficients = (lam, mu, area_density)
    M, K = _continuum(elements, nodes[elements], QUAD, len(nodes), coefficients, mass)
    return Structure(M, K, nodes, {"quad": elements}, ("ux", "uy"))


def solid(
    nx: int,
    ny: int,
    nz: int,
    h: float | Sequence[float],
    *,
    E: ArrayLike,
    nu: ArrayLike,
    rho: ArrayLike,
    mass: str = "consistent",
    origin: Sequence[float] = (0.0, 0.0, 0.0),
) -> Structure:
    """A box of nx by ny by nz elements: `solid_on` a regular mesh.

    Node (i, j, k), at origin + (i hx, j hy, k hz), has the number
    ((ny + 1) i + j) (nz + 1) + k; element (i, j, k) the number (ny i + j) nz + k.

    Parameters
    ----------
    nx, ny, nz : int
        Elements along the axes, at least 1.
    h : float or three floats
        Edge of an element, or (hx, hy, hz).
    E, nu, rho : float, (nx, ny, nz) or (nx * ny * nz,) array_like
        Young's modulus, Poisson's ratio in (-1, 0.5), density; as arrays by element.
    mass : {"consistent", "lumped"}
    origin : three floats, default (0, 0, 0)
        The corner with the smallest coordinates.

    Returns
    -------
    Structure
        Components "ux", "uy", "uz", elements "hexahedron".

    Raises
    ------
    TypeError, ValueError
        For numbers that are not positive or not finite, and wrong shapes.

    Examples
    --------
    >>> from pmalpha import models
    >>> models.solid(20, 4, 4, 0.25, E=30e9, nu=0.2, rho=2500.0, mass="lumped")
    <Structure 525 points, 320 hexahedron, 1575 dofs>
    """
    sizes = zip(("nx", "ny", "nz"), (nx, ny, nz))
    counts = tuple(whole_number(value, name, low=1) for name, value in sizes)
    points, hexahedra, corners = _grid(counts, h, origin, HEXAHEDRON)
    coefficients = _isotropic(E, nu, rho, counts)
    M, K = _continuum(hexahedra, corners, HEXAHEDRON, len(points), coefficients, mass)
    return Structure(M, K, points, {"hexahedron": hexahedra}, ("ux", "uy", "uz"))


def solid_on(
    points: ArrayLike,
    hexahedra: ArrayLike,
    *,
    E: ArrayLike,
    nu: ArrayLike,
    rho: ArrayLike,
    mass: str = "consistent",
) -> Structure:
    """A solid on any mesh of hexahedra, trilinear, with 2 x 2 x 2 Gauss points.

    The formula of `plate_on` without t and with lam = E nu / ((1 + nu) (1 - 2 nu)).

    Parameters
    ----------
    points : (N, 3) array_like
    hexahedra : (elements, 8) array_like of int
        Corners in meshio's order: one face counter-clockwise as seen from inside the element,
        then the opposite face from the corner above the first.
    E, nu, rho : float or (elements,) array_like
        Young's modulus, Poisson's ratio in (-1, 0.5), density.
    mass : {"consistent", "lumped"}
        Lumped: the row sums of the consistent one, which are positive.

    Returns
    -------
    Structure
        Components "ux", "uy", "uz", elements "hexahedron".

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, points that no element uses, elements that are folded or numbered
        otherwise, numbers that are not positive.

    Examples
    --------
    >>> from pmalpha import models
    >>> box = models.solid(2, 2, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
    >>> points = box.points + 0.1 * box.points[:, ::-1] ** 2
    >>> models.solid_on(points, box.elements["hexahedron"], E=1.0, nu=0.3, rho=1.0)
    <Structure 27 points, 8 hexahedron, 81 dofs>
    """
    nodes, elements = _mesh(points, hexahedra, "hexahedra", 3, 8)
    coefficients = _isotropic(E, nu, rho, (len(elements),))
    M, K = _continuum(elements, nodes[elements], HEXAHEDRON, len(nodes), coefficients, mass)
    return Structure(M, K, nodes, {"hexahedron": elements}, ("ux", "uy", "uz"))


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
    corners = _node_numbers(elements, "elements", len(places), None)
    nodes, renumbered = np.unique(corners, return_inverse=True)
    return places[nodes], renumbered.reshape(corners.shape), nodes


def _plane_stress(E, nu, rho, t, shape: tuple[int, ...]) -> tuple[np.ndarray, ...]:
    """t lam, t mu and t rho, each (1,) or (elements,)."""
    young, thickness = _positive(E, "E", shape), _positive(t, "t", shape)
    ratio = _poisson(nu, shape, incompressible=True)
    lam, mu = young * ratio / (1.0 - ratio**2), young / (2.0 * (1.0 + ratio))
    return thickness * lam, thickness * mu, thickness * _positive(rho, "rho", shape)


def _isotropic(E, nu, rho, shape: tuple[int, ...]) -> tuple[np.ndarray, ...]:
    """lam, mu and rho of a solid, each (1,) or (elements,)."""
    young, ratio = _positive(E, "E", shape), _poisson(nu, shape, incompressible=False)
    lam = young * ratio / ((1.0 + ratio) * (1.0 - 2.0 * ratio))
    return lam, young / (2.0 * (1.0 + ratio)), _positive(rho, "rho", shape)


def _poisson(nu: Any, shape: tuple[int, ...], *, incompressible: bool) -> np.ndarray:
    values = _per_element(nu, "nu", shape)
    fits = (values > -1.0) & ((values <= 0.5) if incompressible else (values < 0.5))
    if not fits.all():
        bracket = "]" if incompressible else ")"
        raise ValueError(f"nu must lie in (-1, 0.5{bracket}, got {values[~fits][0]:g}")
    return values


def _grid(
    counts: tuple[int, ...], h: Any, origin: Any, reference: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and elements of a regular mesh, and the corners (1, a, d) of one element."""
    d = len(counts)
    edges, start = plain_array(h, "h"), real_array(origin, "origin")
    if edges.shape not in ((), (d,)):
        raise ValueError(f"h must be one number or {d}, got shape {edges.shape}")
    if start.shape != (d,):
        raise ValueError(f"origin must have shape ({d},), got {start.shape}")
    size = np.array([positive_number(e, "h") for e in np.broadcast_to(edges, d).tolist()])
    places = np.indices([c + 1 for c in counts]).reshape(d, -1).T
    ahead = (reference + 1) // 2  # of each corner, in elements
    shape = [c + 1 for c in counts]
    first = np.indices(counts).reshape(d, -1).T
    numbers = [np.ravel_multi_index((first + step).T, shape) for step in ahead]
    return start + size * places, np.column_stack(numbers), (size * ahead)[None]


def _continuum(
    elements: np.ndarray,
    corners: np.ndarray,
    reference: np.ndarray,
    nodes: int,
    coefficients: tuple[np.ndarray, ...],
    mass: str,
) -> tuple[Any, sp.csr_array]:
    """M and K; corners and coefficients for each element or, with one row, for all."""
    lam, mu, density = coefficients
    shapes, slopes = _at_gauss_points(reference)
    volumes, gradients = _gradients(corners, slopes)
    weights = density[:, None] * volumes
    pattern = _Pattern.of(elements, nodes)
    d = reference.shape[1]
    if _is_lumped(mass):
        M = np.repeat(_lumped(elements, weights @ shapes, nodes), d)
    else:
        squares = shapes[:, :, None] * shapes[:, None, :]  # (q, a, b)
        scalar = pattern.matrix(np.tensordot(weights, squares, axes=1))
        M = sp.csr_array(sp.kron(scalar, sp.eye_array(d), format="csr"))
    return M, _stiffness(pattern, volumes, gradients, lam[:, None, None], mu[:, None, None])


def _at_gauss_points(reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """n_a (q, a) and their slopes (q, a, d) at the 2^d Gauss points, which have weight 1."""
    # n_a(x) = prod_i (1 + x_ai x_i) / 2, at x = x_q / sqrt 3
    factors = (1.0 + reference[None] * reference[:, None] / np.sqrt(3.0)) / 2.0
    slopes = [
        reference[:, i] / 2.0 * np.delete(factors, i, axis=2).prod(axis=2)
        for i in range(reference.shape[1])
    ]
    return factors.prod(axis=2), np.stack(slopes, axis=2)


def _gradients(corners: np.ndarray, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Volumes (E, q) of the Gauss points, and derivatives (d, E, q, a) along the axes."""
    jacobian = np.swapaxes(corners, 1, 2)[:, None] @ slopes  # dx_i / dxi_j, (E, q, d, d)
    volumes = np.linalg.det(jacobian)
    folded = np.flatnonzero(~(volumes > 0.0).all(axis=1))
    if folded.size:
        raise ValueError(
            "elements must be convex with corners in meshio's order (counter-clockwise), got a "
            f"Jacobian determinant of {volumes[folded[0]].min():g} in {listing(folded)}"
        )
    along = slopes @ np.linalg.inv(jacobian)
    return volumes, np.ascontiguousarray(np.moveaxis(along, 3, 0))


def _stiffness(
    pattern: _Pattern, volumes: np.ndarray, gradients: np.ndarray, lam: np.ndarray, mu: np.ndarray
) -> sp.csr_array:
    """K of an isotropic material, one pair of components after the other to save memory."""
    g = np.sqrt(volumes)[:, :, None] * gradients
    d = len(g)

    def pair(i, j):
        """The integral of d_i n_a d_j n_b, (E, a, b)."""
        return np.swapaxes(g[i], 1, 2) @ g[j]

    shear = mu * sum(pair(k, k) for k in range(d))
    blocks = np.empty((pattern.indices.size, d, d))
    for i in range(d):
        for j in range(i + 1):
            G = pair(i, j)
            block = lam * G + mu * np.swapaxes(G, 1, 2) + (shear if i == j else 0.0)
            blocks[:, i, j] = pattern.sums(block)
            blocks[:, j, i] = pattern.sums(np.swapaxes(block, 1, 2)) if i != j else blocks[:, i, i]
    return pattern.of_blocks(blocks)


# ---- assembly -------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Pattern:
    """Which nodes share an element, as compressed rows, and where each element adds to them."""

    indptr: np.ndarray  # (N + 1,)
    indices: np.ndarray  # (pairs,)
    place: np.ndarray  # (E, a, a): of corners a, b of an element, among the pairs

    @classmethod
    def of(cls, elements: np.ndarray, nodes: int) -> _Pattern:
        keys = elements[:, :, None].astype(np.int64) * nodes + elements[:, None, :]
        pairs, place = np.unique(keys, return_inverse=True)
        rows, columns = np.divmod(pairs, nodes)
        indptr = np.searchsorted(rows, np.arange(nodes + 1))
        return cls(indptr, columns, place.reshape(keys.shape))

    def sums(self, values: np.ndarray) -> np.ndarray:
        """(pairs,): values (E or 1, a, a) added up."""
        spread = np.broadcast_to(values, self.place.shape)
        return np.bincount(self.place.ravel(), spread.ravel(), minlength=self.indices.size)

    def matrix(self, values: np.ndarray) -> sp.csr_array:
        """The sum of element matrices (E, a, a), or (E, a, d, a, d) with d dofs for each node."""
        if values.ndim == 3:
            values = values[:, :, None, :, None]
        d = values.shape[2]
        blocks = np.empty((self.indices.size, d, d))
        for i, j in np.ndindex(d, d):
            blocks[:, i, j] = self.sums(values[:, :, i, :, j])
        return self.of_blocks(blocks)

    def of_blocks(self, blocks: np.ndarray) -> sp.csr_array:
        """The matrix with blocks (pairs, d, d)."""
        n = (self.indptr.size - 1) * blocks.shape[1]
        return sp.bsr_array((blocks, self.indices, self.indptr), shape=(n, n)).tocsr()


def _lumped(elements: np.ndarray, shares: np.ndarray, nodes: int) -> np.ndarray:
    """(N,): shares (E or 1, a or 1) of the corners added up."""
    spread = np.broadcast_to(shares, elements.shape)
    return np.bincount(elements.ravel(), spread.ravel(), minlength=nodes)


# ---- checks ---------------------------------------------------------------------------------


def _is_lumped(mass: Any) -> bool:
    if mass not in ("consistent", "lumped"):
        raise ValueError(f'mass must be "consistent" or "lumped", got {mass!r}')
    return mass == "lumped"


def _per_element(value: Any, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """(1,) or (elements,) array of a number or of an array of that shape, flat or not."""
    values = real_array(value, name, plain_array(value, name).ndim)
    flat = (int(np.prod(shape)),)
    if values.shape not in ((), shape, flat):
        allowed = " or ".join(str(s) for s in dict.fromkeys((shape, flat)))
        raise ValueError(f"{name} must be a number or of shape {allowed}, got {values.shape}")
    return values.reshape(-1)


def _values(value: Any, name: str, shape: tuple[int, ...]) -> np.ndarray:
    values = _per_element(value, name, shape)
    if not (values >= 0.0).all():
        raise ValueError(f"{name} must not be negative, got {values.min():g}")
    return values


def _positive(value: Any, name: str, shape: tuple[int, ...]) -> np.ndarray:
    values = _per_element(value, name, shape)
    if not (values > 0.0).all():
        raise ValueError(f"{name} must be positive, got {values.min():g}")
    return values


def _mesh(
    points: Any, elements: Any, name: str, dim: int | None, corners: int
) -> tuple[np.ndarray, np.ndarray]:
    """Points and elements, each point in one element at least."""
    places = real_array(points, "points", 2)
    if dim is not None and places.shape[1] != dim:
        raise ValueError(f"points must have shape (points, {dim}), got {places.shape}")
    numbers = _node_numbers(elements, name, len(places), corners)
    unused = np.flatnonzero(np.bincount(numbers.ravel(), minlength=len(places)) == 0)
    if unused.size:
        raise ValueError(f"{name} must use every point (see submesh), not {listing(unused)}")
    return places, numbers


def _node_numbers(value: Any, name: str, nodes: int, corners: int | None) -> np.ndarray:
    numbers = plain_array(value, name)
    if numbers.dtype.kind not in "iu":
        raise TypeError(f"{name} must be whole numbers, got dtype {numbers.dtype}")
    if numbers.ndim != 2 or numbers.shape[1] != (corners or numbers.shape[1]) or not numbers.size:
        raise ValueError(
            f"{name} must have shape (elements, {corners or 'corners'}), got {numbers.shape}"
        )
    outside = numbers[(numbers < 0) | (numbers >= nodes)]
    if outside.size:
        raise ValueError(f"{name} must lie in 0..{nodes - 1}, got {listing(outside)}")
    return numbers.astype(np.int64)


# ---- modes ----------------------------------------------------------------------------------

# The problem is solved for theta = 1 / (omega^2 + shift), so that a free structure can be factored.
# The shift is a part of the largest K_ii / M_ii: small for ARPACK, that low modes stay apart;
# halfway through the spectrum where all modes come at once, since theta is good to eps / shift.
ARPACK_SHIFT = 1e-10
DENSE_SHIFT = 1e-4
# Up to this many free dofs, or for a larger part of the modes than a quarter, all is dense.
DENSE = 200
# x^T K x is rounded by this much of |x|^T |K| |x|; a square below counts as zero.
ROUNDING = 8.0 * np.finfo(float).eps
# A matrix that went through a text file may have lost two digits more: only a square further below
# zero says that K is indefinite.
EXPORTED = 100.0


def modes(
    M: Any, K: Any, k: int = 6, *, fixed: ArrayLike | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The lowest frequencies and modes: K x = omega^2 M x.

    Dense up to 200 free dofs or for a large share of all modes, otherwise ARPACK about a small
    negative shift, with one factor of K + shift M.

    Parameters
    ----------
    M, K : (n,) array, (n, n) array or scipy.sparse matrix or array
        Positive semidefinite. Free structures and dofs without mass are allowed.
    k : int, default 6
        How many modes, rigid-body ones included.
    fixed : (f,) array of int, optional
        Dofs held at zero.

    Returns
    -------
    omegas : (k,) ndarray
        Rising, in radians per time. A rigid-body mode has 0: squares that rounding cannot tell
        from zero are set to it.
    modes : (n, k) ndarray
        In columns, on all dofs, zero at the fixed ones. Mass-normalised, modes.T @ M @ modes = 1;
        the largest entry of each is positive.

    Raises
    ------
    TypeError, ValueError
        For matrices that are not symmetric and semidefinite, dofs without mass and stiffness, dofs
        out of range, more modes than free dofs with mass.
    scipy.sparse.linalg.ArpackError
        When ARPACK does not converge.

    Examples
    --------
    >>> from pmalpha import models
    >>> masses = models.chain(3, 2.0, 8.0)  # free: 2 sqrt(k/m) sin(i pi / 6)
    >>> models.modes(masses.M, masses.K, 3)[0].round(6).tolist()
    [0.0, 2.0, 3.464102]
    """
    mass, n = canonical(M, "M")
    if mass is None:
        raise ValueError("M must not be zero")
    stiffness, _ = canonical(K, "K", n)
    held = dof_list([] if fixed is None else fixed, n, "fixed")
    free = np.delete(np.arange(n), held)
    B = _block(mass, free)
    A = np.zeros(free.size) if stiffness is None else _block(stiffness, free)
    k = whole_number(k, "k", low=1)
    massive = np.flatnonzero(diagonal(B) > 0.0)
    if k > massive.size:
        raise ValueError(f"k must be at most {massive.size}, the free dofs with mass, got {k}")
    scale = float(np.max(diagonal(A)[massive] / diagonal(B)[massive]))
    squares, shapes = _lowest(A, B, k, scale if scale > 0.0 else 1.0)
    full = np.zeros((n, k))
    full[free] = shapes * np.sign(shapes[np.abs(shapes).argmax(axis=0), np.arange(k)])
    return np.sqrt(squares), full


def _block(A: Any, dofs: np.ndarray) -> Any:
    """Rows and columns of some dofs."""
    if A.ndim == 1:
        return A[dofs]
    return A[dofs][:, dofs]


def _lowest(A: Any, B: Any, k: int, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """The k lowest omega^2 and the modes, from the space they span."""
    n = B.shape[0]
    try:
        X = _dense_space(A, B, k, scale) if n <= DENSE or 4 * k > n else _space(A, B, k, scale)
        # Ritz: of all vectors X y those that K and M leave apart
        squares, y = scipy.linalg.eigh(X.T @ product(A, X), X.T @ product(B, X))
    except np.linalg.LinAlgError as error:
        raise ValueError(
            "K must be positive semidefinite and every dof have mass or stiffness, got a singular "
            "or indefinite K + shift M"
        ) from error
    X = X @ y
    rounding = ROUNDING * np.sum(np.abs(X) * product(abs(A), np.abs(X)), axis=0)
    if np.any(squares < -EXPORTED * rounding):
        raise ValueError(f"K must be positive semidefinite, got omega^2 = {squares.min():g}")
    return np.where(squares > rounding, squares, 0.0), X


def _dense_space(A: Any, B: Any, k: int, scale: float) -> np.ndarray:
    """X (n, k) of B x = theta (A + shift B) x for the k largest theta."""
    n = B.shape[0]
    shifted = combination([(1.0, A), (DENSE_SHIFT * scale, B)])
    return scipy.linalg.eigh(dense(B), dense(shifted), subset_by_index=[n - k, n - 1])[1]


def _space(A: Any, B: Any, k: int, scale: float) -> np.ndarray:
    """The same by ARPACK."""
    n, shift = B.shape[0], ARPACK_SHIFT * scale
    shifted = combination([(1.0, A), (shift, B)])
    S, mass = (sp.csc_array(sp.diags_array(x) if x.ndim == 1 else x) for x in (shifted, B))
    solve = _positive_definite(S).solve
    start = np.random.default_rng(0).standard_normal(n)  # the same digits in every run
    operator = LinearOperator((n, n), matvec=solve, dtype=float)
    return eigsh(S, k, M=mass, sigma=-shift, OPinv=operator, v0=start)[1]


def _positive_definite(S: sp.csc_array) -> Any:
    """SuperLU's factors of S, pivots on the diagonal; LinAlgError if one is not positive."""
    try:
        symmetric = {"SymmetricMode": True}
        factors = splu(S, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric)
    except RuntimeError as error:
        raise np.linalg.LinAlgError(str(error)) from error
    if not np.all(factors.U.diagonal() > 0.0):
        raise np.linalg.LinAlgError("a pivot is not positive")
    return factors
