"""Perfectly matched layers of plates, as subdomains with steps of their own.

Equations (V3) to (V6) of docs/method/loads.md. A layer continues the elements of the soil outward
and has, beside their displacements, the time integral of the stress at their points of quadrature.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from .._checks import counted, listing, real_number, whole_number
from ..errors import StabilityWarning, warn
from ..meshes.mesh import SHAPES, unshared
from ..problem.arguments import DofsLike
from ..problem.constraints import Constraint
from ..problem.dofs import dof_list
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from .absorbing import VerticalWave, vertical_wave
from .elasticity import RULES, Moduli, elastic_matrices, gradients, of_elements
from .element_force import Selected

# ---- layer sides ---------------------------------------------------------------------------------
# The sides of a plate that have an absorbing layer, and the elements of the layer.

# Coordinates on a side differ by less than this multiple of the size of the mesh.
ON_SIDE = 1e-9
ELSEWHERE = "graded_damping and absorbing take other elements"


class Side(NamedTuple):
    """A side of the rectangle, and its elements."""

    axis: int  # along the normal
    outward: float  # +1, -1
    at: float  # coordinate
    size: float  # of the elements along the normal
    edges: np.ndarray  # (m, 2) nodes
    owners: np.ndarray  # (m,) elements

    @property
    def name(self) -> str:
        return f"{'xy'[self.axis]} = {self.at:g}"


def sides_of(structure: Any, nodes: np.ndarray) -> list[Side]:
    """The sides of the box of a mesh whose nodes are chosen, each whole."""
    no_recipe = structure.recipe is None
    if no_recipe or not structure.moduli or set(structure.moduli) != set(structure.elements):
        names = ", ".join(map(repr, structure.elements)) or "of no kind"
        raise ValueError(f"absorbing_layer needs linear plates, got elements {names}; {ELSEWHERE}")
    if structure.points.shape[1] != 2 or structure.dofs_per_node != 2:
        raise ValueError(
            "absorbing_layer needs plates of four-node elements, got solids "
            f"({', '.join(map(repr, structure.elements))}) with {structure.dofs_per_node} dofs of "
            f"a node; {ELSEWHERE}"
        )
    chosen = np.zeros(len(structure.points), dtype=bool)
    chosen[nodes] = True
    kinds = [k for k, x in structure.elements.items() if k != "quad" and chosen[x].any()]
    if kinds or "quad" not in structure.elements:
        names = ", ".join(map(repr, kinds or structure.elements))
        raise ValueError(
            f"absorbing_layer needs four-node elements 'quad' at its sides, got {names}; "
            f"{ELSEWHERE}"
        )
    quads, points = structure.elements["quad"], structure.points
    edges = np.concatenate([quads[:, [i, (i + 1) % 4]] for i in range(4)])
    owners = np.tile(np.arange(len(quads)), 4)
    outer = unshared(np.sort(edges, axis=1))
    edges, owners = edges[outer], owners[outer]
    low, high = points.min(axis=0), points.max(axis=0)
    near = ON_SIDE * np.abs(points).max()
    sides, of_sides = [], np.zeros(len(points), dtype=bool)
    for axis, outward, at in [
        (0, -1.0, low[0]),
        (0, 1.0, high[0]),
        (1, -1.0, low[1]),
        (1, 1.0, high[1]),
    ]:
        on = (np.abs(points[edges][:, :, axis] - at) <= near).all(axis=1)
        meant = chosen[edges[on]].all(axis=1)
        if not meant.any():
            continue
        name = f"{'xy'[axis]} = {at:g}"
        if not meant.all():
            raise ValueError(
                f"nodes must be all nodes of a side, got some of {name} without "
                f"{listing(np.setdiff1d(edges[on], np.flatnonzero(chosen)))}"
            )
        extent = np.ptp(points[quads[owners[on]]][:, :, axis], axis=1)
        sides.append(Side(axis, outward, float(at), float(extent.mean()), edges[on], owners[on]))
        of_sides[edges[on]] = True
    left = np.flatnonzero(chosen & ~of_sides)
    if left.size or not sides:
        x = f" {left[0]} at {points[left[0]].tolist()}" if left.size else ""
        raise ValueError(
            "nodes must be those of sides parallel to the axes that bound the mesh, all nodes of "
            f"each, got {counted(left.size, 'other')}{x}"
        )
    return sides


def snapped(points: np.ndarray, sides: Sequence[Side]) -> np.ndarray:
    """The coordinates, with those of sides exactly on them."""
    points = points.copy()
    for side in sides:
        points[side.edges.ravel(), side.axis] = side.at
    return points


def extruded(
    structure: Any, sides: Sequence[Side], count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (N, 2), elements (E, 4) and the elements (E,) of the structure that they continue."""
    points = snapped(structure.points, sides)
    boxes, owners = [], []  # (2, 2): begin and end along x, along y

    def levels(side: Side) -> np.ndarray:
        return side.at + side.outward * side.size * np.arange(count + 1)

    for side in sides:
        ends = np.sort(points[side.edges][:, :, 1 - side.axis], axis=1)
        for a, b in np.sort(np.column_stack([levels(side)[:-1], levels(side)[1:]]), axis=1):
            across = np.tile([a, b], (len(ends), 1))
            pair = [across, ends] if side.axis == 0 else [ends, across]
            boxes.append(np.stack(pair, axis=1))
            owners.append(side.owners)
    for x in (side for side in sides if side.axis == 0):
        for y in (side for side in sides if side.axis == 1):
            corner = np.intersect1d(x.edges, y.edges)
            if not corner.size:
                raise ValueError(
                    f"the sides {x.name} and {y.name} must meet at a node of both, got none: the "
                    "mesh is no rectangle there"
                )
            spans = [
                np.sort(np.column_stack([levels(s)[:-1], levels(s)[1:]]), axis=1) for s in (x, y)
            ]
            boxes.append(
                np.stack(
                    [np.repeat(spans[0], count, axis=0), np.tile(spans[1], (count, 1))], axis=1
                )
            )
            owner = x.owners[(x.edges == corner[0]).any(axis=1)]
            owners.append(np.repeat(owner, count * count))
    box = np.concatenate(boxes)
    corners = np.stack(
        [
            np.stack([box[:, 0, i], box[:, 1, j]], axis=1)
            for i, j in SHAPES["quad"].nodes.astype(int)
        ],
        axis=1,
    )
    places, numbers = np.unique(corners.reshape(-1, 2) + 0.0, axis=0, return_inverse=True)
    return places, numbers.reshape(-1, 4), np.concatenate(owners)


# ---- layer matrices ------------------------------------------------------------------------------
# The matrices of an absorbing layer, equations (V3) and (V4) of docs/method/loads.md.

# The stretch grows with this power of the depth, (V4).
POWER = 2
# Unknowns of an element beside displacements: xx, yy, xy at four points of quadrature.
STRESSES = 12
Entries = tuple[np.ndarray, np.ndarray, np.ndarray]  # values, rows, columns


def stretch_of(
    structure: Any, sides: Sequence[Side], count: int, reflection: float, across: float
) -> Callable[[np.ndarray], np.ndarray]:
    """beta_x, beta_y at points (..., 2), (V4)."""
    lam, mu, density = structure.moduli["quad"][:3]
    speed = np.sqrt((lam + 2.0 * mu) / density)
    thickness = [count * side.size for side in sides]
    largest = [
        (POWER + 1) * of_elements(speed, side.owners).max() / (2.0 * L) * np.log(1.0 / reflection)
        for side, L in zip(sides, thickness, strict=True)
    ]

    def beta(points: np.ndarray) -> np.ndarray:
        result = np.zeros(points.shape)
        for side, L, b in zip(sides, thickness, largest, strict=True):
            depth = side.outward * (points[..., side.axis] - side.at)
            profile = b * np.maximum(depth / L, 0.0) ** POWER
            result[..., side.axis] += profile
            result[..., 1 - side.axis] += across * profile
        return result

    return beta


def matrices(
    points: np.ndarray,
    quads: np.ndarray,
    moduli: Moduli,
    stretch: Callable[[np.ndarray], np.ndarray],
    lumped: bool,
) -> tuple[sp.csr_array, sp.csr_array, sp.csr_array]:
    """M, C, K of (V3): nodes first, then xx, yy, xy at the points of each element."""
    E, corners = len(quads), points[quads]
    volumes, along = gradients("quad", corners)  # (E, q), (2, E, q, a)
    N = SHAPES["quad"].values(RULES["quad"][0].points)
    lam, mu, rho, t = (np.broadcast_to(x, (E,)) for x in moduli[:4])
    w = volumes * t[:, None]
    Z = np.sqrt(rho * (lam + 2.0 * mu))
    at_nodes, at_points = stretch(corners), stretch(np.einsum("qa,eai->eqi", N, corners))
    nodal = (rho[:, None] * w) @ N
    D = np.zeros((E, 3, 3))
    D[:, 0, 0] = D[:, 1, 1] = lam + 2.0 * mu
    D[:, 0, 1] = D[:, 1, 0] = lam
    D[:, 2, 2] = mu
    flexibility = w[:, :, None, None] * ((Z**2)[:, None, None] * np.linalg.inv(D))[:, None]
    # derivatives scaled by Lam_p: d/dx by beta_y, d/dy by beta_x
    scaled = np.stack([along[0] * at_points[:, :, 1, None], along[1] * at_points[:, :, 0, None]])
    dofs = (2 * quads[:, :, None] + np.arange(2)).reshape(E, 8)
    stress = 2 * len(points) + np.arange(E * STRESSES).reshape(E, 4, 3)
    n = 2 * len(points) + E * STRESSES
    on_stress = stress[:, :, :, None], stress[:, :, None, :]

    def of_coefficients(at_nodes: np.ndarray, at_points: np.ndarray) -> list[Entries]:
        """rho w b, lumped: each node has its own stretch, as each point of the stress."""
        blocks = at_points[:, :, None, None] * flexibility
        return [(np.repeat(nodal * at_nodes, 2, axis=1), dofs, dofs), (blocks, *on_stress)]

    def of_slopes(g: np.ndarray) -> list[Entries]:
        """Z w B and its negative transpose."""
        B = np.zeros((E, 4, 3, 4, 2))
        B[:, :, 0, :, 0] = B[:, :, 2, :, 1] = g[0]
        B[:, :, 1, :, 1] = B[:, :, 2, :, 0] = g[1]
        B = (Z[:, None] * w)[:, :, None, None] * B.reshape(E, 4, 3, 8)
        of_u = dofs[:, None, None, :]
        return [(-B, stress[:, :, :, None], of_u), (B, of_u, stress[:, :, :, None])]

    mass = of_coefficients(np.ones((E, 4)), np.ones((E, 4)))
    if not lumped:
        consistent = np.einsum("eq,qa,qb,ij->eaibj", rho[:, None] * w, N, N, np.eye(2))
        mass[0] = (consistent.reshape(E, 8, 8), dofs[:, :, None], dofs[:, None, :])
    C = of_coefficients(at_nodes.sum(axis=2), at_points.sum(axis=2)) + of_slopes(along)
    K = of_coefficients(at_nodes.prod(axis=2), at_points.prod(axis=2)) + of_slopes(scaled)
    return _assembled(mass, n), _assembled(C, n), _assembled(K, n)


def _assembled(parts: list[Entries], n: int) -> sp.csr_array:
    """The sum of entries, each with its rows and columns; zeros are left out."""
    full = [np.broadcast_arrays(*part) for part in parts]
    values, rows, columns = (np.concatenate([x[i].ravel() for x in full]) for i in range(3))
    A = sp.csr_array(sp.coo_array((values, (rows, columns)), shape=(n, n)))
    A.eliminate_zeros()
    return A


__all__ = ["AbsorbingLayer", "absorbing_layer"]

# Thinner layers can grow, by the eigenvalues of layers alone,
FEWEST = 3
# and layers of ground that is nearly incompressible, with a larger c_p / c_s: nu above 0.479.
FASTEST = 5.0
# Between two edges that are free or fixed there are waves whose phase travels against their energy.
# A stretch along the normal alone makes them grow; with this share of it across they decayed.
ACROSS = 0.2
Motion = Callable[[float, np.ndarray], tuple[Any, Any, Any]]


@dataclass(frozen=True, eq=False)
class AbsorbingLayer:
    """A layer that absorbs the waves that enter it, from `Structure.absorbing_layer`.

    Unknowns are the displacements of the nodes of its mesh, then three of each point of quadrature,
    integrals of stress over time divided by an impedance, in the unit of a displacement.

    Attributes
    ----------
    M, C, K : (n, n) csr_array
        Equation (V3), of all nodes; C and K are unsymmetric.
    mesh : Structure
        The plain elements of the layer, whose nodes have the first dofs: ``layer.mesh.nodes_at``,
        ``layer.mesh.dofs``, for pictures too.
    outer : (k,) ndarray of int
        Dofs of the outer edge, which `subdomain` fixes.
    pairs : (p, 2) ndarray of int
        Nodes of the structure on its sides, and those of the layer at the same points.

    Examples
    --------
    A strip of soil whose waves leave on the right:

    >>> from pmalpha import Coupler, GeneralizedAlpha, structures
    >>> soil = structures.plate(20, 1, 0.1, E=1.0, nu=0.0, rho=1.0, plane="strain")
    >>> layer = soil.absorbing_layer(soil.nodes_at(x=2.0), elements=8)
    >>> u0 = np.zeros(soil.n)
    >>> u0[0::2] = np.exp(-(((soil.points[:, 0] - 1.0) / 0.15) ** 2))
    >>> scheme = GeneralizedAlpha(0.8)
    >>> strip = soil.subdomain(scheme=scheme, u0=u0, substeps=2, name="soil")
    >>> edge = layer.subdomain(scheme=scheme)
    >>> ties = [layer.tie(strip, edge)]
    >>> coupler = Coupler([strip, edge], ties, dt=0.05, coupling="macro")
    >>> bool(np.abs(coupler.run(8.0, every=10)["soil"].u[-1]).max() < 0.01)
    True
    """

    M: sp.csr_array
    C: sp.csr_array
    K: sp.csr_array
    mesh: Any
    outer: np.ndarray
    pairs: np.ndarray
    _structure: Any
    _sides: tuple[Side, ...]
    _guides: str = ""  # sides between free or fixed edges without a stretch across

    @property
    def points(self) -> np.ndarray:
        """(N, 2): coordinates of the nodes."""
        result: np.ndarray = self.mesh.points
        return result

    @property
    def n(self) -> int:
        """Number of unknowns, those of the outer edge included."""
        return int(self.M.shape[0])

    def __repr__(self) -> str:
        sides = ", ".join(side.name for side in self._sides)
        elements = counted(len(self.mesh.elements["quad"]), "element")
        return f"<AbsorbingLayer at {sides}: {elements}, {counted(self.n, 'unknown')}>"

    def subdomain(self, *, scheme: Scheme, fixed: DofsLike = (), **options: Any) -> Subdomain:
        """A Subdomain of the layer, without the dofs of its outer edge.

        Parameters
        ----------
        scheme : Scheme
            As for `Subdomain`, implicit.
        fixed : int, str, array of them, or mask of ``layer.mesh.n``, optional
            Further dofs of `mesh` without motion: of a plane of symmetry, or of rock below that
            goes on in the layer.
        **options
            Further arguments of `Subdomain`: substeps, name, ... The name is "layer" by default.

        Returns
        -------
        Subdomain
            Its dofs are called "ux 12" and "uy 12", with the numbers of `mesh`, and "S 0", "S 1"...

        Raises
        ------
        TypeError, ValueError
            As from `Subdomain`; for an explicit scheme.

        Examples
        --------
        >>> from pmalpha import GeneralizedAlpha, structures
        >>> soil = structures.plate(4, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
        >>> edge = soil.nodes(lambda x, y: (x > 1.99) | (y < 0.01))
        >>> layer = soil.absorbing_layer(edge, elements=3)
        >>> layer.subdomain(scheme=GeneralizedAlpha(0.8), fixed=["uy 0"]).n
        378
        """
        if scheme.explicit:
            raise ValueError(
                "scheme of an absorbing layer must be implicit, since the stretch makes its outer "
                f"elements stiff, got {scheme!r}"
            )
        for name in ("M", "K", "C", "symmetric"):
            if name in options:
                raise TypeError(f"{name} must not be given: an absorbing layer has its own")
        held = dof_list(fixed, self.mesh.n, "fixed", self.mesh.dof_names)
        free = np.setdiff1d(np.arange(self.n), np.concatenate([self.outer, held]))
        names = [*self.mesh.dof_names, *(f"S {i}" for i in range(self.n - self.mesh.n))]
        options = {"name": "layer", "dof_names": [names[i] for i in free], **options}
        M, C, K = (sp.csr_array(A[free][:, free]) for A in (self.M, self.C, self.K))
        return Subdomain(M, K, C=C, scheme=scheme, symmetric=False, **options)

    def tie(
        self, soil: Subdomain | Sequence[Subdomain], layer: Subdomain, *, velocity: Any = None
    ) -> Constraint:
        """The constraint between soil and layer at the nodes of the sides.

        Parameters
        ----------
        soil : Subdomain or list of them
            Of the structure, by `Structure.subdomain` or `cut`, with its names of dofs; of several
            the first one that has a dof.
        layer : Subdomain
            By `subdomain`.
        velocity : callable, optional
            The first one of `free_field`, equation (V5).

        Returns
        -------
        Constraint
            +1 on the soil, -1 on the layer, ux and uy of each node. A dof that is fixed in one of
            them is held in the other; one that is fixed in both has no row.

        Raises
        ------
        TypeError, ValueError
            For subdomains without these names.

        Warns
        -----
        StabilityWarning
            For a side that meets no layer at its ends, without a stretch across.

        Examples
        --------
        >>> from pmalpha import GeneralizedAlpha, structures
        >>> soil = structures.plate(4, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
        >>> edge = soil.nodes(lambda x, y: (x > 1.99) | (y < 0.01))
        >>> layer = soil.absorbing_layer(edge, elements=3)
        >>> scheme = GeneralizedAlpha(0.8)
        >>> layer.tie(soil.subdomain(scheme=scheme, name="soil"), layer.subdomain(scheme=scheme))
        <14 constraints on 'soil' and 'layer'>
        """
        sides = [soil] if isinstance(soil, Subdomain) else list(soil)
        numbers = [_numbers(s, "soil") for s in sides] + [_numbers(layer, "layer")]
        rows: list[list[tuple[int, float]]] = [[] for _ in numbers]  # of each subdomain, by row
        chosen = []
        for i, (name, name_in_layer) in enumerate(self._names()):
            first = next((k for k, x in enumerate(numbers[:-1]) if name in x), None)
            ends = {} if first is None else {first: (numbers[first][name], 1.0)}
            if name_in_layer in numbers[-1]:
                ends[len(sides)] = (numbers[-1][name_in_layer], -1.0)
            if ends:
                chosen.append(i)
                for k, of_subdomain in enumerate(rows):
                    of_subdomain.append(ends.get(k, (0, 0.0)))
        matrices = {
            s: _matrix(of_subdomain, s.n)
            for s, of_subdomain in zip([*sides, layer], rows, strict=True)
            if any(sign for _, sign in of_subdomain)
        }
        if layer not in matrices or len(matrices) < 2:
            raise ValueError(
                f"soil and layer must have free dofs of the sides by their names, such as "
                f"{self._names()[0]}, got {[*sides, layer]}"
            )
        if self._guides:
            warn(
                f"the layer at {self._guides} is between two edges that are free or fixed: waves "
                "whose phase travels against their energy can grow in it; see coupler.growth(), "
                "and take absorbing_layer(..., across=0.25), which reflects more, or a layer at "
                "the edges too",
                StabilityWarning,
            )
        if velocity is None:
            return Constraint(matrices)
        if not callable(velocity):
            raise TypeError(
                f"velocity must be the function of t that free_field returns, got {velocity!r}"
            )
        return Constraint(matrices, velocity=_rows_of(velocity, np.array(chosen)))

    def _names(self) -> list[tuple[str, str]]:
        """The dofs of the sides in the structure and in the layer, ux and uy of each node."""
        return [(f"{c} {a}", f"{c} {b}") for a, b in self.pairs for c in ("ux", "uy")]

    def free_field(self, motion: Motion) -> tuple[Callable[..., Any], Callable[..., Any]]:
        """Loads of waves that come from outside, equations (V5) and (V6).

        The soil then has the whole motion and the layer the scattered waves alone, without the free
        field. (V6) has no damping: that of the soil at its sides must be none.

        Parameters
        ----------
        motion : callable, or `vertical_wave`
            ``motion(t, points)`` returns displacements, velocities and accelerations of the ground
            without the structure, each (k, 2), at the points (k, 2). At t = 0 it is at rest. It
            must be a motion of the mesh, not only of the continuum: the difference comes in as a
            wave.

        Returns
        -------
        velocity : callable
            Of t, for ``tie(..., velocity=)``.
        force : callable
            Of t, (n,) on the dofs of the structure, for ``force`` of the soil.

        Raises
        ------
        TypeError, ValueError
            For a motion that is no function, and, when it is called, of another shape.

        Examples
        --------
        >>> from pmalpha import GeneralizedAlpha, structures
        >>> soil = structures.plate(4, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
        >>> edge = soil.nodes(lambda x, y: (x > 1.99) | (y < 0.01))
        >>> layer = soil.absorbing_layer(edge, elements=3)
        >>> def falling(t, points):
        ...     along = np.tile([0.0, -1.0], (len(points), 1))
        ...     return 0.5 * t**2 * along, t * along, along
        >>> velocity, force = layer.free_field(falling)
        >>> velocity(2.0)[:2].tolist(), force(0.0)[soil.dofs(12, "uy")].round(4).tolist()
        ([0.0, -2.0], [-0.0625])
        """
        if not callable(motion):
            raise TypeError(f"motion must be a function of t and points, got {motion!r}")
        structure, side = self._structure, self.pairs[:, 0]
        quads = structure.elements["quad"]
        near = np.flatnonzero(np.isin(quads, side).any(axis=1))
        M, K = side_matrices(structure, near)
        around = np.unique(quads[near])  # nodes, which hold the neighbours of the sides
        rows, columns = _dofs_of(side), _dofs_of(around)
        M, K = (sp.csr_array(A[rows][:, columns]) for A in (M, K))
        points, n = structure.points[around], structure.n
        on_side = _dofs_of(np.searchsorted(around, side))

        def velocity(t: float) -> np.ndarray:
            result: np.ndarray = _checked_motion(motion, t, points)[1].ravel()[on_side]
            return result

        def force(t: float) -> np.ndarray:
            u, _, w = _checked_motion(motion, t, points)
            result = np.zeros(n)
            result[rows] = M @ w.ravel() + K @ u.ravel()
            return result

        return velocity, force

    def vertical_wave(
        self,
        velocity: Any,
        t_end: float,
        *,
        scheme: Scheme,
        step: float,
        dt: float | None = None,
        wave: str = "SV",
    ) -> VerticalWave:
        """The free field of a vertical wave in horizontal layers, from a column of the elements.

        Parameters
        ----------
        velocity : (m,) array_like or Record
            Velocity of the particles in the incident wave alone, one element below the soil: half
            of what a free surface of the same ground has. Upward or to the right positive.
        t_end : float
            End of the motion; a run beyond it is an error.
        scheme : Scheme
            That of the soil, so that the free field is a motion of its mesh and step.
        step : float
            The step of the soil, dt of the Coupler over its substeps.
        dt : float, optional
            Step of the samples; a Record has it.
        wave : {"SV", "P"}
            Shear wave, along x, or pressure wave, along y.

        Returns
        -------
        VerticalWave
            For `free_field`.

        Raises
        ------
        TypeError, ValueError
            For layers without a side along y and the lower one, with the upper one, and ground that
            is not in horizontal layers at the sides.

        Examples
        --------
        The surface of homogeneous ground has twice the velocity of the incident wave:

        >>> from pmalpha import CentralDifference, structures
        >>> soil = structures.plate(4, 8, 0.1, E=2.0, nu=0.0, rho=1.0, mass="lumped")
        >>> edge = soil.nodes(lambda x, y: (x == 0.0) | (x > 0.39) | (y == 0.0))
        >>> layer = soil.absorbing_layer(edge)
        >>> pulse = np.exp(-(((0.1 * np.arange(60) - 2.0) / 0.5) ** 2))
        >>> scheme = CentralDifference()
        >>> wave = layer.vertical_wave(pulse, 6.0, dt=0.1, scheme=scheme, step=0.05)
        >>> round(float(wave.v[:, -1].max()), 2)
        2.0
        """
        return vertical_wave(
            self._structure,
            self._sides,
            velocity,
            t_end,
            scheme,
            step,
            dt=dt,
            wave=wave,
            lumped=is_lumped(self._structure),
        )


def absorbing_layer(
    structure: Any, nodes: np.ndarray, elements: Any, reflection: Any, across: Any
) -> AbsorbingLayer:
    """Of `Structure.absorbing_layer`."""
    count = whole_number(elements, "elements", low=FEWEST)
    R = real_number(reflection, "reflection", low=0.0, high=1.0)
    if not R > 0.0:
        raise ValueError(f"reflection must lie in (0, 1], got {R:g}")
    share = real_number(across, "across", low=0.0, high=1.0)
    sides = sides_of(structure, nodes)
    points, quads, owners = extruded(structure, sides, count)
    lam, mu = (of_elements(x, owners) for x in structure.moduli["quad"][:2])
    ratio = float(np.sqrt((lam + 2.0 * mu) / mu).max())
    if ratio > FASTEST:
        raise ValueError(
            f"absorbing_layer needs pressure waves of at most {FASTEST:g} times the speed of shear "
            f"waves (nu of 0.479 in plane strain), got {ratio:.3g}: a layer of such ground grows; "
            "take graded_damping"
        )
    moduli = Moduli(*(of_elements(x, owners) for x in structure.moduli["quad"]))
    lumped = is_lumped(structure)
    elements_of, moduli_of = {"quad": quads}, {"quad": moduli}
    recipe = partial(elastic_matrices, points, elements_of, moduli_of, lumped, None)
    mesh = type(structure)._of(recipe, points, elements_of, ("ux", "uy"), moduli_of)
    beta = stretch_of(structure, sides, count, R, share)
    M, C, K = matrices(points, quads, moduli, beta, lumped)
    outer = np.zeros(len(points), dtype=bool)
    for side in sides:
        depth = side.outward * (points[:, side.axis] - side.at)
        outer |= depth > (count - 0.5) * side.size
    chosen = np.unique(np.concatenate([side.edges.ravel() for side in sides]))
    number = {tuple(x): i for i, x in enumerate(points.tolist())}
    at_sides = snapped(structure.points, sides)[chosen].tolist()
    pairs = np.column_stack([chosen, [number[tuple(x)] for x in at_sides]])
    guides = [
        side.name
        for side in sides
        if all(x.axis == side.axis for x in sides) and len(side.edges) > 1
    ]
    grows = R < 1.0 and share < ACROSS
    return AbsorbingLayer(
        M,
        C,
        K,
        mesh,
        _dofs_of(np.flatnonzero(outer)),
        pairs,
        structure,
        tuple(sides),
        ", ".join(guides) if grows else "",
    )


def side_matrices(structure: Any, elements: np.ndarray) -> tuple[sp.csr_array, sp.csr_array]:
    """M and K of some elements of a structure, without what is attached."""
    quads = structure.elements["quad"][elements]
    M, K, _ = structure.recipe(Selected({"quad": elements}, {"quad": quads}, len(structure.points)))
    return sp.csr_array(sp.diags_array(M) if M.ndim == 1 else M), sp.csr_array(K)


def is_lumped(structure: Any) -> bool:
    """Whether the mass of its elements is lumped."""
    A = sp.coo_array(side_matrices(structure, np.array([0]))[0])
    return not np.any((A.row != A.col) & (A.data != 0.0))


def _dofs_of(nodes: np.ndarray) -> np.ndarray:
    result: np.ndarray = (2 * np.asarray(nodes)[:, None] + np.arange(2)).ravel()
    return result


def _numbers(subdomain: Any, name: str) -> dict[str, int]:
    """The number of each dof by its name."""
    if not isinstance(subdomain, Subdomain):
        raise TypeError(f"{name} must be a Subdomain, got {subdomain!r}")
    if subdomain.dof_names is None:
        raise ValueError(
            f"{name} must have dof_names, as of Structure.subdomain, got {subdomain!r}"
        )
    return {x: i for i, x in enumerate(subdomain.dof_names)}


def _matrix(rows: list[tuple[int, float]], n: int) -> sp.csr_array:
    """(p, n) with one entry a row, or none where it is 0."""
    dofs, signs = (np.array(x) for x in zip(*rows, strict=True))
    entries = np.flatnonzero(signs)
    where = (entries, dofs[entries].astype(np.int64))
    return sp.csr_array((signs[entries], where), shape=(len(rows), n))


def _rows_of(velocity: Callable[[float], np.ndarray], rows: np.ndarray) -> Callable[[float], Any]:
    return lambda t: velocity(t)[rows]


def _checked_motion(motion: Motion, t: float, points: np.ndarray) -> tuple[np.ndarray, ...]:
    """u, v and w at the points, each (k, 2)."""
    values = motion(t, points)
    if not isinstance(values, (tuple, list)) or len(values) != 3:
        raise TypeError(f"motion must return u, v and w, got {values!r} at t = {t:g}")
    u, v, w = (np.asarray(x, dtype=float) for x in values)
    for name, x in (("u", u), ("v", v), ("w", w)):
        if x.shape != points.shape:
            raise ValueError(
                f"{name} of motion must have shape {points.shape}, got {x.shape} at t = {t:g}"
            )
    return u, v, w
