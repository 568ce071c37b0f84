"""Perfectly matched layers of plates, as subdomains with steps of their own.

Equations (V3) to (V6) of docs/method/loads.md. A layer continues the elements of the soil outward
and has, beside their displacements, the time integral of the stress at their points of quadrature.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import counted, real_number, whole_number
from ..errors import StabilityWarning, warn
from ..problem.arguments import DofsLike
from ..problem.constraints import Constraint
from ..problem.dofs import dof_list
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from .elasticity import Moduli, elastic_matrices, of_elements
from .element_force import Selected
from .layer_matrices import matrices, stretch_of
from .layer_sides import Side, extruded, sides_of, snapped
from .vertical_wave import VerticalWave, vertical_wave

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
