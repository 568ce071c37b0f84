"""Mass and stiffness of a structure with its mesh."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from .._cached import cached_property
from .._checks import counted, flag, listing, plain_array, real_number
from .._tables import html_facts
from ..problem.arguments import DofsLike
from ..problem.dofs import NodeNames, along, as_nodes, dof_list
from ..problem.loads import load_of_free
from ..problem.matrices import Matrix, combination, sparse_diagonal
from ..problem.moving import MovingPoint
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from ..reduction.fixed_dofs import Reduction, reduce
from .absorbing import AbsorbingBoundary, boundary, graded
from .absorbing_layer import AbsorbingLayer, absorbing_layer
from .attached import Attached, moved_masses, not_negative, placed_springs
from .elasticity import Moduli, stresses
from .element_force import ElementForce, Recipe, Selected
from .moving import moving_point
from .stress import (
    BAR,
    BEAM,
    base_shear,
    grid_of,
    line_forces,
    nodal_stress,
    storey_drifts,
    storey_shears,
)

__all__ = ["Structure"]

# Coordinates are equal if they differ by less than this multiple of the largest one.
COINCIDENT = 1e-9


@dataclass(frozen=True, eq=False)
class Structure:
    """Matrices of a structure and its mesh.

    Attributes
    ----------
    M : (n, n) csr_array
        Mass; a sparse diagonal when lumped. A 1-D array is converted to it.
    K : (n, n) csr_array
        Stiffness; of nonlinear elements without entries.
    points : (N, dim) ndarray
        Coordinates of the nodes.
    elements : dict
        By meshio's name ("line", "quad", "hexahedron"): (E, corners) array of node numbers.
    components : tuple of str
        Names of the dofs of a node, in their order: "ux", "uy", "uz" are displacements along the
        axes, "rz" is a rotation, counter-clockwise.
    internal : tuple of ElementForce
        Forces of nonlinear elements and of contact, added to K u.
    moduli : dict
        Of linear elastic plates and solids, by the name of the elements: Lame's constants ``lam``,
        ``mu`` (in plane stress those of the plane), ``density``, ``thickness`` and ``across`` (zz
        over xx + yy in a plate), each (E,), or (1,) where they are equal.
    recipe : callable or None
        Makes M, K and forces of some of the elements, for `pmalpha.cut`; None where the elements of
        the matrices are not known.
    C : (n, n) csr_array or None
        Damping of what is attached, `with_damper` and `with_damping`; None without.
    attached : Attached or None
        What `with_mass`, `with_spring`, `with_damper`, `with_damping` and `lump` have added to M, C
        and K, for `pmalpha.cut`.
    groups, sets : dict
        Numbers of elements, counted through all kinds in the order of `elements`, and numbers of
        nodes, by the names of a mesh file (`from_mesh`).

    Raises
    ------
    TypeError, ValueError
        If M, K or a force in `internal` do not have one row for each component of each point.

    Examples
    --------
    >>> from pmalpha import structures
    >>> wall = structures.plate(4, 2, 0.5, E=30e9, nu=0.2, rho=2500.0, t=0.3)
    >>> foot = wall.dofs(wall.nodes_at(y=0.0))
    >>> wall.n, foot.tolist()
    (30, [0, 1, 6, 7, 12, 13, 18, 19, 24, 25])
    """

    M: Any
    K: Any
    points: np.ndarray
    elements: Mapping[str, np.ndarray]
    components: tuple[str, ...]
    internal: tuple[ElementForce, ...] = ()
    moduli: Mapping[str, Moduli] = field(default_factory=dict)
    recipe: Recipe | None = None
    groups: Mapping[str, np.ndarray] = field(default_factory=dict)
    sets: Mapping[str, np.ndarray] = field(default_factory=dict)
    C: Any = None
    attached: Attached | None = None

    @classmethod
    def _of(
        cls,
        recipe: Recipe,
        points: np.ndarray,
        elements: Mapping[str, np.ndarray],
        components: tuple[str, ...],
        moduli: Mapping[str, Moduli] | None = None,
    ) -> Structure:
        """The structure of all elements of a mesh."""
        everything = dict.fromkeys(elements, slice(None))
        M, K, internal = recipe(Selected(everything, elements, len(points)))
        return cls(M, K, points, elements, components, internal, moduli or {}, recipe)

    def __post_init__(self) -> None:
        n = len(self.points) * len(self.components)
        object.__setattr__(self, "internal", tuple(self.internal))
        rows_of = [("M", self.M.shape[0]), ("K", self.K.shape[0])]
        rows_of += [] if self.C is None else [("C", self.C.shape[0])]
        for force in self.internal:
            if not isinstance(force, ElementForce):
                raise TypeError(f"internal must hold forces of elements, got {force!r}")
            rows_of.append(("internal", force.n))
        for name, rows in rows_of:
            if rows != n:
                raise ValueError(
                    f"{name} must have {n} rows, {len(self.components)} for each of "
                    f"{counted(len(self.points), 'point')}, got {rows}"
                )
        if self.M.ndim == 1:
            object.__setattr__(self, "M", sparse_diagonal(self.M))

    def __repr__(self) -> str:
        counts = ", ".join(f"{len(e)} {name}" for name, e in self.elements.items())
        points, dofs = counted(len(self.points), "point"), counted(self.n, "dof")
        forces = f", {counted(len(self.internal), 'internal force')}" if self.internal else ""
        damped = ", dampers" if self.C is not None else ""
        return f"<Structure {points}, {counts}, {dofs}{forces}{damped}{self._separate()}>"

    def _separate(self) -> str:
        """What a mesh that should be one body must not have, or nothing."""
        words = ""
        if self.bodies > 1:
            words += f", {self.bodies} bodies that no element connects"
            if set(self.moduli) == set(self.elements):
                words += f", {self.bodies * (3 if self.points.shape[1] == 2 else 6)} rigid modes"
        if self.coincident:
            words += f", {counted(self.coincident, 'point')} at the place of another one"
        return words

    def _repr_html_(self) -> str:
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        facts = [
            ("nodes", str(len(self.points))),
            ("elements", ", ".join(f"{len(e)} {name}" for name, e in self.elements.items())),
            ("dofs", f"{self.n}, of a node {', '.join(self.components)}"),
            ("extent", " x ".join(f"{a:g} .. {b:g}" for a, b in zip(low, high))),
        ]
        if self.internal:
            facts.append(("internal forces", str(len(self.internal))))
        facts += [
            (what, ", ".join(map(str, names)))
            for what, names in (("groups", self.groups), ("sets", self.sets))
            if names
        ]
        return html_facts("Structure", facts)

    @cached_property
    def bodies(self) -> int:
        """Number of parts of the mesh that no element connects."""
        N = len(self.points)
        edges = [np.empty((0, 2), dtype=np.int64)]
        for nodes in self.elements.values():
            first = np.broadcast_to(nodes[:, :1], nodes[:, 1:].shape)
            edges.append(np.stack([first, nodes[:, 1:]], axis=-1).reshape(-1, 2))
        i, j = np.concatenate(edges).T
        graph = sp.coo_array((np.ones(i.size, dtype=bool), (i, j)), shape=(N, N))
        return int(connected_components(graph, directed=False)[0])

    @cached_property
    def coincident(self) -> int:
        """Number of points at the place of another one, which no element joins to it."""
        size = np.abs(self.points).max(initial=0.0) or 1.0
        places = np.round(self.points / (COINCIDENT * size)).astype(np.int64)
        factors = np.random.default_rng(0).integers(1, 2**62, size=places.shape[1])
        keys = places @ (2 * factors + 1)  # one number of each place, modulo 2^64
        return len(keys) - len(np.unique(keys))

    @property
    def dofs_per_node(self) -> int:
        """Number of components of a node."""
        return len(self.components)

    @property
    def n(self) -> int:
        """Number of dofs."""
        return len(self.points) * len(self.components)

    @property
    def dof_names(self) -> NodeNames:
        """Names of the dofs, the component and the number of the node: "ux 12"."""
        return NodeNames(self.components, np.arange(self.n), self.n)

    @property
    def unused(self) -> np.ndarray:
        """Dofs without mass and stiffness, to be fixed: "rz" of nodes at which no beam ends."""
        return np.flatnonzero(idle_dofs(self.M, self.K, self.internal))

    def labels(self, *names: str) -> np.ndarray:
        """For each element the name of the group it is in, as labels of `pmalpha.cut`.

        Parameters
        ----------
        *names : str
            Of `groups`, each element in one of them. Default: all.

        Returns
        -------
        (elements,) ndarray of str
            The name of the group of each element.

        Raises
        ------
        ValueError
            For unknown names, and elements in none or in several of the groups.

        Examples
        --------
        >>> import dataclasses
        >>> from pmalpha import structures
        >>> bar = structures.rod(3, 1.0, EA=1.0, rhoA=1.0)
        >>> bar = dataclasses.replace(bar, groups={"left": np.array([0]), "rest": np.array([1, 2])})
        >>> bar.labels().tolist()
        ['left', 'rest', 'rest']
        """
        chosen = names or tuple(self.groups)
        labels = np.full(sum(map(len, self.elements.values())), "", dtype=object)
        for name in chosen:
            members = _named(self.groups, name, "group")
            twice = members[labels[members] != ""]
            if twice.size:
                raise ValueError(
                    f"names must be of groups without common elements, got {labels[twice[0]]!r} "
                    f"and {name!r} with elements {listing(twice)}"
                )
            labels[members] = name
        without = np.flatnonzero(labels == "")
        if without.size:
            raise ValueError(f"names must cover every element, got none for {listing(without)}")
        return labels.astype(str)

    def nodes(self, where: Callable[..., Any]) -> np.ndarray:
        """The nodes whose coordinates satisfy a predicate.

        Parameters
        ----------
        where : callable
            Called with each coordinate of all nodes as an (N,) array, ``where(x, y)`` in the
            plane; returns N booleans.

        Returns
        -------
        (k,) ndarray of int
            In rising order.

        Raises
        ------
        ValueError
            If the result is not of shape (N,) and boolean, or False at all nodes.

        Examples
        --------
        >>> from pmalpha import structures
        >>> bar = structures.rod(4, 2.0, EA=1.0, rhoA=1.0)
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
        return as_nodes(np.flatnonzero(chosen), self.dofs_per_node)

    def nodes_at(
        self, *, x: float | None = None, y: float | None = None, z: float | None = None
    ) -> np.ndarray:
        """The nodes with these coordinates, up to rounding (1e-9 of the largest coordinate).

        Parameters
        ----------
        x, y, z : float, optional
            At least one; None for any coordinate.

        Returns
        -------
        (k,) ndarray of int
            In rising order. Where nodes have several dofs they are not taken for numbers of dofs:
            ``fixed=`` and the like refuse them by name, and take those of `dofs`.

        Raises
        ------
        ValueError
            If there is no such node, or the points do not have that coordinate.

        Examples
        --------
        >>> from pmalpha import structures
        >>> box = structures.solid(2, 1, 1, 0.1, E=1.0, nu=0.3, rho=1.0)
        >>> box.nodes_at(x=0.2, z=0.1).tolist()
        [9, 11]
        """
        axes = {axis: v for axis, v in zip("xyz", (x, y, z)) if v is not None}
        dim = self.points.shape[1]
        if not axes or max("xyz".index(axis) for axis in axes) >= dim:
            raise ValueError(f"nodes_at needs one or more of {', '.join('xyz'[:dim])}, got {axes}")
        columns = ["xyz".index(axis) for axis in axes]
        away = np.abs(self.points[:, columns] - [real_number(v, a) for a, v in axes.items()])
        nodes = np.flatnonzero(np.all(away <= COINCIDENT * np.abs(self.points).max(), axis=1))
        if not nodes.size:
            low, high = self.points.min(axis=0), self.points.max(axis=0)
            raise ValueError(
                f"nodes_at must match a node, got {axes}; the coordinates are within "
                f"{low.tolist()} and {high.tolist()}"
            )
        return as_nodes(nodes, self.dofs_per_node)

    def dofs(self, nodes: Any, component: str | Sequence[str] | None = None) -> np.ndarray:
        """Dofs of nodes, node by node.

        Parameters
        ----------
        nodes : int, (k,) array of int, or str
            Such as of `nodes_at`; a str is one of `sets`.
        component : str or sequence of str, optional
            One or several of `components`. Default: all.

        Returns
        -------
        (k * chosen components,) ndarray of int
            In the order of `nodes`, then of the components.

        Raises
        ------
        TypeError, ValueError
            For nodes out of range or repeated, and unknown components and sets.

        Examples
        --------
        >>> from pmalpha import structures
        >>> frame = structures.beam_frame([[0, 0], [0, 3]], [[0, 1]], EA=1.0, EI=1.0, rhoA=1.0)
        >>> frame.dofs([0, 1], "ux").tolist(), frame.dofs(1, ["ux", "rz"]).tolist()
        ([0, 3], [3, 5])
        """
        if isinstance(nodes, str):
            nodes = _named(self.sets, nodes, "set of nodes")
        chosen = dof_list(np.atleast_1d(plain_array(nodes, "nodes")), len(self.points), "nodes")
        names = (component,) if isinstance(component, str) else component or self.components
        unknown = [name for name in names if name not in self.components]
        if unknown:
            raise ValueError(f"component must be of {self.components}, got {unknown[0]!r}")
        offsets = [self.components.index(name) for name in names]
        return (self.dofs_per_node * chosen[:, None] + offsets).ravel()

    def with_internal(self, *forces: ElementForce) -> Structure:
        """The same structure with further internal forces, such as contact.

        Parameters
        ----------
        *forces : ElementForce
            Of n dofs, from `plane_contact`, `sphere_contact` or another structure of these nodes.

        Returns
        -------
        Structure
            A new one.

        Raises
        ------
        TypeError, ValueError
            For what is not a force of elements, and for another number of dofs.

        Examples
        --------
        >>> from pmalpha import structures
        >>> ball = structures.nonlinear_solid(2, 2, 0.5, structures.NeoHookean(1e6, 0.3), rho=1e3)
        >>> floor = structures.plane_contact(ball, ball.nodes_at(y=0.0), point=[0.0, 0.0],
        ...                              normal=[0.0, 1.0], stiffness=1e7)
        >>> ball.with_internal(floor)
        <Structure 9 points, 4 quad, 18 dofs, 2 internal forces>
        """
        return replace(self, internal=(*self.internal, *forces))

    def with_mass(self, nodes: Any, mass: Any, *, inertia: Any = 0.0) -> Structure:
        """The same structure with point masses.

        Parameters
        ----------
        nodes : int, (k,) array of int, or str
            As for `dofs`.
        mass : float or (k,) array_like
            Added to every displacement of the nodes, at least 0.
        inertia : float or (k,) array_like, default 0
            Added to their rotation "rz", at least 0.

        Returns
        -------
        Structure
            A new one.

        Raises
        ------
        TypeError, ValueError
            As of `dofs`; for negative masses, and an inertia of nodes without rotation.

        Examples
        --------
        >>> from pmalpha import structures
        >>> beam = structures.beam_frame([[0, 0], [2, 0]], [[0, 1]], EA=1.0, EI=1.0, rhoA=0.5,
        ...                              divisions=2, mass="lumped")
        >>> beam.with_mass(2, 10.0).M.diagonal()[beam.dofs(2)].round(4).tolist()
        [10.5, 10.5, 0.0128]
        """
        moving = [name for name in self.components if name.startswith("u")]
        dofs = self.dofs(nodes, moving).reshape(-1, len(moving))
        masses = not_negative(mass, "mass", len(dofs))
        turning = not_negative(inertia, "inertia", len(dofs))
        added = np.zeros(self.n)
        added[dofs] = masses[:, None]
        if turning.any():
            if "rz" not in self.components:
                raise ValueError(f"inertia needs nodes with 'rz', got {self.components}")
            added[self.dofs(nodes, "rz")] = turning
        return self._with(self._attached()._replace(mass=self._attached().mass + added))

    def with_spring(self, dofs: Any, k: Any, c: Any = 0.0) -> Structure:
        """The same structure with linear springs, and dampers parallel to them.

        Parameters
        ----------
        dofs : int, str, (m,) or (m, 2) array of them
            As for `CubicSpring`: ``["uy 3"]`` is a spring to the ground, ``[("uy 3", "uy 7")]`` one
            between two dofs.
        k, c : float or (m,) array_like
            Stiffness and viscous damping, at least 0.

        Returns
        -------
        Structure
            A new one. `subdomain` and `cut` take its C; a cut needs both ends of a spring at one
            of its elements, or in one subdomain.

        Raises
        ------
        TypeError, ValueError
            As of `CubicSpring`.

        Examples
        --------
        >>> from pmalpha import structures
        >>> bar = structures.rod(2, 1.0, EA=1.0, rhoA=1.0).with_spring(["ux 0"], k=3.0, c=0.5)
        >>> bar.K.diagonal().tolist(), bar.C.diagonal().tolist()
        ([5.0, 4.0, 2.0], [0.5, 0.0, 0.0])
        """
        pairs, before = placed_springs(dofs, self.n, self.dof_names), self._attached()
        stiffness, damping = (not_negative(x, name, len(pairs)) for x, name in ((k, "k"), (c, "c")))
        return self._with(
            before._replace(
                dofs=np.concatenate([before.dofs, pairs]),
                k=np.concatenate([before.k, stiffness]),
                c=np.concatenate([before.c, damping]),
            )
        )

    def with_damper(self, dofs: Any, c: Any) -> Structure:
        """The same structure with viscous dampers: `with_spring` of the stiffness 0.

        Parameters
        ----------
        dofs : int, str, (m,) or (m, 2) array of them
            As for `with_spring`.
        c : float or (m,) array_like
            Force per velocity, at least 0.

        Returns
        -------
        Structure
            A new one.

        Raises
        ------
        TypeError, ValueError
            As of `with_spring`.

        Examples
        --------
        >>> from pmalpha import structures
        >>> structures.chain(2, 1.0, [4.0]).with_damper([(0, 1)], 0.5).C.toarray().tolist()
        [[0.5, -0.5], [-0.5, 0.5]]
        """
        return self.with_spring(dofs, 0.0, c)

    def with_damping(self, C: Any) -> Structure:
        """The same structure with a damping matrix between the dofs of each node.

        Parameters
        ----------
        C : (n, n) sparse
            Such as of `absorbing`, without entries between different nodes.

        Returns
        -------
        Structure
            A new one.

        Raises
        ------
        ValueError
            For another shape, and entries between two nodes.

        Examples
        --------
        >>> from pmalpha import structures
        >>> soil = structures.plate(1, 1, 1.0, E=2.0, nu=0.0, rho=1.0)
        >>> soil.with_damping(soil.absorbing(soil.nodes_at(y=0.0)).C)
        <Structure 4 points, 1 quad, 8 dofs, dampers>
        """
        if np.shape(C) != (self.n, self.n):
            raise ValueError(f"C must have shape ({self.n}, {self.n}), got {np.shape(C)}")
        A, d, before = sp.coo_array(C), self.dofs_per_node, self._attached()
        apart = (A.row // d != A.col // d) & (A.data != 0.0)
        if apart.any():
            raise ValueError(
                f"C must have no entries between two nodes, got one of dofs {A.row[apart][0]} and "
                f"{A.col[apart][0]}; give such a matrix to the Subdomain"
            )
        return self._with(before._replace(dashpots=sp.csr_array(before.dashpots + A)))

    def absorbing(
        self,
        nodes: Any,
        *,
        rho: float | None = None,
        c_p: float | None = None,
        c_s: float | None = None,
    ) -> AbsorbingBoundary:
        """Dashpots that let plane waves leave through a boundary (Lysmer and Kuhlemeyer 1969).

        They absorb what arrives perpendicular to the boundary, and reflect a part of what arrives
        at another angle.

        Parameters
        ----------
        nodes : int, (k,) array of int, or str
            As for `dofs`: all nodes of the sides of elements that are meant.
        rho, c_p, c_s : float, optional
            Density, and speeds of pressure and shear waves, of what continues beyond the boundary.
            Default: those of the elements there.

        Returns
        -------
        AbsorbingBoundary
            With the matrix ``C``, for `with_damping`, and ``incident(velocity, direction)``, the
            load of a wave that comes in.

        Raises
        ------
        TypeError, ValueError
            For structures other than of linear plates and solids, solids with middle nodes, nodes
            without a side of an element, and numbers that are not positive.

        Examples
        --------
        A column of soil on rock whose waves are twice as fast:

        >>> from pmalpha import structures
        >>> soil = structures.plate(1, 3, 1.0, E=2.0, nu=0.0, rho=1.0, plane="strain")
        >>> soil.absorbing(soil.nodes_at(y=0.0), c_p=2.8, c_s=2.0).C.diagonal()[:2].tolist()
        [1.0, 1.4]
        """
        places = np.unique(self.dofs(nodes) // self.dofs_per_node)
        return boundary(self, places, rho, c_p, c_s)

    def absorbing_layer(
        self, nodes: Any, elements: int = 8, *, reflection: float = 1e-3, across: float = 0.0
    ) -> AbsorbingLayer:
        """A perfectly matched layer beyond sides of a plate, with steps of its own.

        It absorbs waves of any angle, and surface waves: of Lamb's problem 10 elements leave an
        error below 1 per cent where dashpots leave 55. The layer is made of the elements of the
        plate at the side, so layers of the ground go on in it.

        Parameters
        ----------
        nodes : int, (k,) array of int, or str
            As for `dofs`: all nodes of one to four sides of the mesh, each a line along an axis at
            the end of the mesh.
        elements : int, default 8
            Number of elements through its thickness, at least 3.
        reflection : float, default 1e-3
            Of a pressure wave perpendicular to it, by the continuum, in (0, 1]: less makes the
            layer steeper, which its elements have to resolve.
        across : float, default 0
            Share of the stretch along the normal that is across it too, in 0..1. A layer between
            free or fixed edges, such as on both sides of soil on rigid rock, can grow without:
            0.25 is stable, and reflects some per cent, of long waves more.

        Returns
        -------
        AbsorbingLayer
            With M, C and K, ``subdomain``, ``tie`` and ``free_field``.

        Raises
        ------
        TypeError, ValueError
            For triangles and elements of second order at the sides, solids, other structures, nodes
            that are not all of a side, ground that is nearly incompressible (nu above 0.479), and
            numbers out of range.

        Notes
        -----
        Beside the layer, under "macro" the soil has at most 5 substeps and a scheme with rho of at
        most 0.8; beyond that take "gc". 20 steps of the layer in a period leave 1 per cent of
        error, 10 leave 6.

        Examples
        --------
        >>> from pmalpha import structures
        >>> soil = structures.plate(20, 10, 0.1, E=2.5, nu=0.25, rho=1.0, plane="strain")
        >>> edge = soil.nodes(lambda x, y: (x < 0.01) | (x > 1.99) | (y < 0.01))
        >>> soil.absorbing_layer(edge, elements=5)
        <AbsorbingLayer at x = 0, x = 2, y = 0: 250 elements, 3612 unknowns>
        """
        places = np.unique(self.dofs(nodes) // self.dofs_per_node)
        return absorbing_layer(self, places, elements, reflection, across)

    def graded_damping(
        self,
        nodes: Any,
        elements: int = 20,
        reflection: float = 0.5,
        *,
        dashpots: bool = True,
    ) -> Structure:
        """The same structure with damping in its own elements next to a side, for waves that leave.

        Damping grows linearly with the depth in elements that the mesh has for it, and the side
        has dashpots (absorbing layer with increasing damping, Semblat, Lenti and Gandomzadeh 2011).
        It is for all linear plates and solids, where `absorbing_layer` is for four-node elements in
        the plane, and needs many more elements.

        Parameters
        ----------
        nodes : int, (k,) array of int, or str
            As for `dofs`: all nodes of the outer sides.
        elements : int, default 20
            Number of elements through the thickness of the damped zone.
        reflection : float, default 0.5
            Share of a pressure wave perpendicular to it that returns from a rigid end, in (0, 1).
            Less damps more, and reflects more where the damping begins.
        dashpots : bool, default True
            False: without those of `absorbing` on the side, which takes no solids of second order.

        Returns
        -------
        Structure
            A new one: C of each element is proportional to its lumped mass. `cut` takes it
            along, and every scheme.

        Raises
        ------
        TypeError, ValueError
            As of `absorbing`; for a zone that is the whole mesh, and numbers out of range.

        Examples
        --------
        >>> from pmalpha import structures
        >>> bar = structures.plate(6, 1, 1.0, E=1.0, nu=0.0, rho=1.0, mass="lumped")
        >>> damped = bar.graded_damping(bar.nodes_at(x=6.0), elements=3, dashpots=False)
        >>> damped.C.diagonal()[::4].round(3).tolist()
        [0.0, 0.0, 0.0, 0.019, 0.077, 0.154, 0.096]
        """
        places = np.unique(self.dofs(nodes) // self.dofs_per_node)
        C = graded(self, places, elements, reflection)
        if flag(dashpots, "dashpots"):
            C = C + boundary(self, places, None, None, None).C
        return self.with_damping(C)

    def lump(self, *, away_from: Any, left: float = 0.01) -> Structure:
        """The same structure with the mass of some nodes at their neighbours, for contact.

        What a contact without restitution takes is the energy of the mass at its nodes. With little
        mass there it takes little. Take an implicit scheme: an explicit step would have to resolve
        the light nodes.

        Parameters
        ----------
        away_from : int, (k,) array of int, or str
            Nodes as for `dofs`. Their mass goes to the other nodes of their elements, in equal
            shares.
        left : float, default 0.01
            The share that they keep, above 0 and below 1, which contact needs.

        Returns
        -------
        Structure
            A new one.

        Raises
        ------
        TypeError, ValueError
            For a mass matrix that is not lumped, nodes all of whose neighbours are among them, and
            a share out of range.

        Examples
        --------
        >>> from pmalpha import structures
        >>> bar = structures.rod(3, 3.0, EA=1.0, rhoA=1.0, mass="lumped")
        >>> bar.lump(away_from=0).M.diagonal().round(6).tolist()
        [0.005, 1.495, 1.0, 0.5]
        """
        share = real_number(left, "left", low=0.0)
        if not 0.0 < share < 1.0:
            raise ValueError(f"left must be above 0 and below 1, got {share:g}")
        d = self.dofs_per_node
        light = np.zeros(len(self.points), dtype=bool)
        light[self.dofs(away_from) // d] = True
        moved = moved_masses(self.M, self.elements, light, d, 1.0 - share)
        return self._with(self._attached()._replace(mass=self._attached().mass + moved))

    def _attached(self) -> Attached:
        return Attached.none(self.n) if self.attached is None else self.attached

    def _with(self, attached: Attached) -> Structure:
        """The same structure with other attachments, whose difference is added to the matrices."""
        before = self._attached()
        new = sp.diags_array(attached.mass - before.mass)
        M = sp.csr_array(self.M + new)
        K = sp.csr_array(self.K + (attached.K - before.K))
        C = None if self.C is None else sp.csr_array(self.C - before.C)
        C = attached.C if C is None else sp.csr_array(C + attached.C)
        if not C.nnz or not np.any(C.data):
            C = None
        return replace(self, M=M, K=K, C=C, attached=attached)

    def tangent(self, u: Any = None) -> Any:
        """K plus the tangents of the internal forces.

        Parameters
        ----------
        u : (n,) array_like, optional
            Displacements. Default: zeros, for the modes of the structure as it is built.

        Returns
        -------
        (n, n) csr_array
            Symmetric.

        Raises
        ------
        ValueError
            If u has another shape.

        Examples
        --------
        A string under the tension of 4, with unit mass per length, has the wave speed 2:

        >>> from pmalpha import structures
        >>> string = structures.truss([[0, 0], [1, 0]], [[0, 1]], EA=1e4, rhoA=1.0, divisions=50,
        ...                       prestress=4.0)
        >>> held = reduce(string.M, string.tangent(), fixed=[0, 1, 2, 3])
        >>> omega, _ = structures.modes(held.M, held.K, 1)
        >>> round(float(omega[0] / (2.0 * np.pi)), 3)
        1.0
        """
        where = np.zeros(self.n) if u is None else u
        return sum((force(where)[1] for force in self.internal), start=self.K)

    def damping(self, c_m: float, c_k: float) -> Matrix:
        """Rayleigh damping :math:`C = c_m M + c_k K`, with coefficients as `rayleigh` returns them.

        K includes the tangents of the internal forces at u = 0.

        Parameters
        ----------
        c_m, c_k : float
            In 1/time and in time, at least 0.

        Returns
        -------
        (n, n) csr_array or None
            None if both coefficients are 0.

        Raises
        ------
        TypeError, ValueError
            For coefficients that are not finite or negative.

        Examples
        --------
        >>> from pmalpha import structures
        >>> masses = structures.chain(2, 3.0, 5.0)
        >>> masses.damping(0.1, 0.01).toarray().round(3).tolist()
        [[0.35, -0.05], [-0.05, 0.35]]
        """
        c_m, c_k = real_number(c_m, "c_m", low=0.0), real_number(c_k, "c_k", low=0.0)
        return combination([(c_m, self.M), (c_k, self.tangent())])

    def element_forces(self) -> sp.csr_array:
        """The matrix S from displacements of all dofs to forces of the line elements.

        For ``run(outputs=)``, with the columns of the free dofs if some are fixed.

        Returns
        -------
        csr_array
            Of chains and rods (E, n): the normal force, tension positive. Of plane frames (6 E, n):
            the forces on the first end of each element and those on its second end, each in its
            axes (along the element, across, moment counter-clockwise). So the normal force is row
            6 e + 3, the shear force row 6 e + 4 and the moment at the second end row 6 e + 5.

        Raises
        ------
        ValueError
            For other elements, several elements between the same two nodes, and internal forces.

        Notes
        -----
        From K alone: the blocks between two nodes are those of the element, and rigid-body motions
        are without force. Inertia forces within the elements (of a consistent mass) and damping
        forces are not contained.

        Examples
        --------
        >>> from pmalpha import structures
        >>> structures.chain(3, 1.0, [10.0, 20.0]).element_forces().toarray().tolist()
        [[-10.0, 10.0, 0.0], [0.0, -20.0, 20.0]]
        """
        self._require_linear("element_forces")
        if set(self.elements) != {"line"} or self.components not in (BAR, BEAM):
            raise ValueError(
                f"element_forces needs elements 'line' with components {BAR} or {BEAM}, got "
                f"{sorted(self.elements)} with {self.components}"
            )
        return line_forces(
            self._element_stiffness(), self.points, self.elements["line"], self.components
        )

    def element_stresses(self) -> sp.csr_array:
        """The matrix S from displacements of all dofs to stresses in the middle of each element.

        For ``run(outputs=)``, with the columns of the free dofs if some are fixed. Of linear plates
        and solids; line elements have no rows.

        Returns
        -------
        (s * E, n) csr_array
            Rows s e to s e + s - 1 belong to element e, in the order of `elements`. In the plane
            s = 3: xx, yy, xy; in plane strain zz is nu (xx + yy). In space s = 6: xx, yy, zz, xy,
            yz, xz. Tension is positive.

        Raises
        ------
        ValueError
            For structures without `moduli`, and internal forces.

        Examples
        --------
        >>> from pmalpha import structures
        >>> strip = structures.plate(2, 1, 1.0, E=10.0, nu=0.25, rho=1.0)
        >>> stretched = np.column_stack([0.01 * strip.points[:, 0], np.zeros(6)]).ravel()
        >>> (strip.element_stresses() @ stretched).reshape(-1, 3).round(4).tolist()
        [[0.1067, 0.0267, 0.0], [0.1067, 0.0267, 0.0]]
        """
        self._require_linear("element_stresses")
        if not self.moduli:
            raise ValueError(
                "element_stresses needs linear plates or solids, got elements "
                f"{', '.join(map(repr, self.elements)) or 'of no kind'}"
            )
        parts = [
            stresses(kind, self.points, self.elements[kind], moduli, self.dofs_per_node)
            for kind, moduli in self.moduli.items()
        ]
        return sp.csr_array(sp.vstack(parts, format="csr"))

    def stress(self, u: Any, what: str = "mises") -> np.ndarray:
        """Stresses at the nodes, the mean of the elements that meet there, for pictures.

        ``plot.deformed(structure, u, values="mises")`` draws them.

        Parameters
        ----------
        u : (n,) or (k, n) array_like
            Displacements.
        what : str, default "mises"
            "mises" (von Mises) or a component of `element_stresses`: "xx", "yy", "xy", in space
            also "zz", "yz" and "xz".

        Returns
        -------
        (N,) or (k, N) ndarray
            Zero at nodes of lines alone.

        Raises
        ------
        TypeError, ValueError
            As of `element_stresses`, and for displacements of another shape.

        Examples
        --------
        >>> from pmalpha import structures
        >>> strip = structures.plate(2, 1, 1.0, E=10.0, nu=0.0, rho=1.0)
        >>> stretched = np.column_stack([0.01 * strip.points[:, 0], np.zeros(6)]).ravel()
        >>> strip.stress(stretched, "xx").round(6).tolist()
        [0.1, 0.1, 0.1, 0.1, 0.1, 0.1]
        """
        return nodal_stress(self, u, what)

    def to_pyvista(self, motion: Any = None, t: float | None = None) -> Any:
        """The mesh as an unstructured grid of pyvista, for solids in a notebook.

        ``grid.warp_by_vector("displacement", factor=50).plot()`` draws it deformed.

        Parameters
        ----------
        motion : (n,) array_like or SubdomainHistory, optional
            Displacements, or a motion with all dofs. Default: at rest.
        t : float, optional
            Time of a motion: the recorded level nearest to it is taken. Default: the last.

        Returns
        -------
        pyvista.UnstructuredGrid
            With "displacement", of a motion also "velocity" and "acceleration", (N, 3) at the
            points, and "time" as field data.

        Raises
        ------
        ImportError
            Without pyvista.
        TypeError, ValueError
            For other shapes, and times outside of the motion.
        """
        return grid_of(self, motion, t)

    def storey_drifts(self, component: str = "ux") -> sp.csr_array:
        """The matrix W from displacements of all dofs to the drifts of the storeys.

        For ``run(outputs=)`` of a subdomain that `subdomain` made, whatever is fixed.

        Parameters
        ----------
        component : str, default "ux"
            Direction of the drifts.

        Returns
        -------
        (storeys, n) csr_array
            Of frames of lines: mean displacement of the nodes of a level minus that of the level
            below. The first level are the lowest nodes, the others those where horizontal members
            end. Of chains and rods: the elongations of the elements, the spring to the ground
            first if there is one.

        Raises
        ------
        ValueError
            For other elements, and fewer than two levels.

        Examples
        --------
        >>> from pmalpha import GeneralizedAlpha, solve, structures
        >>> frame = structures.chain(2, 1.0, [4.0], ground=(6.0, 0.0))
        >>> frame.storey_drifts().toarray().tolist(), frame.base_shear().toarray().tolist()
        ([[1.0, 0.0], [-1.0, 1.0]], [[-6.0, 0.0]])
        >>> model = frame.subdomain(scheme=GeneralizedAlpha(0.5), v0=[0.0, 1.0], name="frame")
        >>> outputs = {"frame": {"drift": frame.storey_drifts(), "shear": frame.base_shear()}}
        >>> solve(model, dt=0.1, steps=5, outputs=outputs).outputs["drift"].shape
        (6, 2)
        """
        return storey_drifts(self, component)

    def storey_shears(self, component: str = "ux") -> sp.csr_array:
        """The matrix W from displacements of all dofs to the shear forces of the storeys.

        For ``run(outputs=)`` of a subdomain that `subdomain` made, whatever is fixed.

        Parameters
        ----------
        component : str, default "ux"
            Direction of the forces.

        Returns
        -------
        (storeys, n) csr_array
            Storeys as of `storey_drifts`. The force acts on all that is above the lower level of
            the storey: under a static load it is minus the load there, and that of the first storey
            is `base_shear`. Forces of damping are rows of C in the same way.

        Raises
        ------
        ValueError
            As of `storey_drifts`; for a structure with internal forces.

        Examples
        --------
        >>> from pmalpha import structures
        >>> structures.chain(2, 1.0, [4.0], ground=(6.0, 0.0)).storey_shears().toarray().tolist()
        [[-6.0, 0.0], [4.0, -4.0]]
        """
        self._require_linear("storey_shears")
        return storey_shears(self, component)

    def base_shear(self, nodes: Any = None, component: str = "ux") -> sp.csr_array:
        """The matrix W from displacements of all dofs to the force of the supports at some nodes.

        For ``run(outputs=)`` of a subdomain that `subdomain` made, whatever is fixed.

        Parameters
        ----------
        nodes : int or (k,) array of int, optional
            Nodes that are fixed. Default: the springs to the ground where there are any, else the
            lowest nodes.
        component : str, default "ux"
            Direction of the force; for "rz" the sum of the clamping moments.

        Returns
        -------
        (1, n) csr_array
            The sum of the rows of K. The force acts on the structure: under a static load it is
            minus the load in this direction. Forces of damping, and of a consistent mass at the
            supports, are rows of C and M in the same way.

        Raises
        ------
        TypeError, ValueError
            As of `dofs`; for a structure with internal forces.

        Examples
        --------
        A rod fixed at its first node, of stiffness 2 / 0.5 next to it:

        >>> from pmalpha import GeneralizedAlpha, reduce, solve, structures
        >>> bar = structures.rod(4, 2.0, EA=2.0, rhoA=1.0)
        >>> fixed = reduce(bar.M, bar.K, fixed=[0])
        >>> model = Subdomain(fixed.M, fixed.K, scheme=GeneralizedAlpha(0.5), v0=np.ones(4))
        >>> outputs = {0: {"base": bar.base_shear(0)[:, fixed.free]}}
        >>> motion = solve(model, dt=0.1, steps=5, record={0: 0}, outputs=outputs)
        >>> bool(np.all(motion.outputs["base"] == -4.0 * motion.u))
        True
        """
        self._require_linear("base_shear")
        return base_shear(self, nodes, component)

    def _element_stiffness(self) -> sp.csr_array:
        """K without what is attached."""
        if self.attached is None or self.recipe is None:
            return sp.csr_array(self.K)
        everything = dict.fromkeys(self.elements, slice(None))
        elements = self.recipe(Selected(everything, self.elements, len(self.points)))
        return sp.csr_array(elements[1])

    def _require_linear(self, what: str) -> None:
        if self.internal:
            raise ValueError(f"{what} needs a linear structure, got one with internal forces")

    def direction(self, component: str | Mapping[str, float]) -> np.ndarray:
        """A unit displacement of all nodes, for `BaseAcceleration`, M times it for weights.

        Parameters
        ----------
        component : str, or dict of str and float
            One of `components`, "ux"; or several with factors, ``{"ux": 1.0, "uy": 0.4}``.

        Returns
        -------
        (n,) ndarray
            Of all dofs, those of supports included: with a consistent mass their share acts too.

        Raises
        ------
        ValueError
            For a component that the structure does not have.

        Examples
        --------
        >>> from pmalpha import structures
        >>> wall = structures.plate(1, 1, 1.0, E=1.0, nu=0.3, rho=1.0)
        >>> wall.direction({"uy": 0.5}).tolist()
        [0.0, 0.5, 0.0, 0.5, 0.0, 0.5, 0.0, 0.5]
        """
        return along(component, self.dof_names, "component")

    def moving_point(
        self,
        path: Any,
        speed: float,
        start: float = 0.0,
        *,
        direction: str | Mapping[str, float] | None = None,
        fixed: DofsLike = (),
    ) -> MovingPoint:
        """A point that runs along beams or the edge of a mesh, for `MovingLoad` and for springs.

        Parameters
        ----------
        path : (k,) array of int
            Nodes along edges of elements, in any order: one chain, from that of its two ends which
            is named first.
        speed : float
            Constant, along the path; negative: backward, zero: the point stands.
        start : float, default 0
            Distance from the beginning of the path at t = 0, negative before it: the second axle
            of a vehicle has ``start=-axle_distance``.
        direction : str, or dict of str and float, optional
            Component of the displacement that it has, "uy", and along which forces act; or
            several with factors. Default: the last one of "ux", "uy", "uz".
        fixed : int, str, array of them, or (n,) array of bool, optional
            Dofs of supports, which the subdomain does not have; `subdomain` knows those that are
            given to it.

        Returns
        -------
        MovingPoint
            Its displacement is interpolated by the elements: linear or quadratic along edges of
            solids and bars; of beams cubic across them, with their shear deformation.

        Raises
        ------
        TypeError, ValueError
            For nodes that are no chain, curved edges, beams with large rotations, unknown
            components.

        Examples
        --------
        A force crosses a beam in two seconds:

        >>> from pmalpha import GeneralizedAlpha, MovingLoad, solve, structures
        >>> beam = structures.beam_frame([[0, 0], [10, 0]], [[0, 1]], EA=1e9, EI=1e6, rhoA=50.0,
        ...                              divisions=8)
        >>> wheel = beam.moving_point(beam.nodes_at(y=0.0), speed=5.0)
        >>> bridge = beam.subdomain(scheme=GeneralizedAlpha(0.9), name="bridge",
        ...     fixed=["ux 0", "uy 0", "uy 1"], force=MovingLoad(wheel, -1000.0))
        >>> motion = solve(bridge, dt=0.01, t_end=2.0)
        >>> bool(-0.03 < motion["uy 5"].u.min() < -0.02)  # static: P L^3 / 48 EI = 0.0208
        True
        """
        return moving_point(self, path, speed, start, direction, fixed)

    def subdomain(self, *, scheme: Scheme, fixed: DofsLike = (), **options: Any) -> Subdomain:
        """A Subdomain with this M, K and internal forces, and the names of the dofs.

        Parameters
        ----------
        scheme : Scheme
            As for `Subdomain`.
        fixed : int, str, array of them, or (n,) array of bool, optional
            Dofs of supports, which the Subdomain does not have. Default: none.
        **options
            Further arguments of `Subdomain`, of the dofs that are not fixed: C, substeps, name, ...
            An `internal` is added to the forces of the structure. `force` (an array, samples, the
            value of a function), `u0` and `v0` may also be of all n dofs, as for `cut`: supports
            carry what acts on them. A force f(t, u, v) has u and v of all n dofs.

        Returns
        -------
        Subdomain
            Its dofs have the names of the structure, "ux 12", whatever is fixed.

        Raises
        ------
        TypeError, ValueError, FactorizationError
            From `Subdomain`.

        Examples
        --------
        >>> from pmalpha import GeneralizedAlpha, structures
        >>> bar = structures.rod(4, 2.0, EA=1.0, rhoA=1.0, mass="lumped")
        >>> bar.subdomain(scheme=GeneralizedAlpha(0.5, explicit=True), name="bar").n
        5

        Fixed at its first node:

        >>> held = bar.subdomain(scheme=GeneralizedAlpha(0.5), fixed=["ux 0"])
        >>> held.n, held.dof_names[0]
        (4, 'ux 1')
        """
        for name in ("M", "K"):
            if name in options:
                raise TypeError(
                    f"{name} must not be given: a structure has its own; springs and masses are "
                    "added by with_spring and with_mass, other matrices are of Subdomain(M, K, ...)"
                )
        reduced = reduce(self.M, self.K, fixed=fixed, dof_names=self.dof_names)
        if self.internal:
            internal = options.get("internal") or []
            further = (
                internal if type(internal) in (list, tuple) else [internal]
            )  # a LowLevelCallable is one
            forces = [force.reduced(reduced.free) for force in self.internal]
            options["internal"] = [*(forces if reduced.fixed.size else self.internal), *further]
        M, K = (reduced.M, reduced.K) if reduced.fixed.size else (self.M, self.K)
        if self.C is not None:
            C = sp.csr_array(self.C)[reduced.free][:, reduced.free]
            options["C"] = _damping_sum(options.get("C"), C)
        options |= {x: _of_free(options[x], reduced) for x in ("u0", "v0") if x in options}
        if "force" in options:
            options["force"] = load_of_free(options["force"], reduced, self.M, self.dof_names)
        options.setdefault("dof_names", reduced.dof_names)
        return Subdomain(M, K, scheme=scheme, **options)


def _damping_sum(matrix: Any, C: sp.csr_array) -> Any:
    """C plus the damping matrix of a user: a diagonal, dense or sparse."""
    if matrix is None:
        return C
    A = matrix if sp.issparse(matrix) else plain_array(matrix, "C")
    if A.ndim == 1:
        A = sparse_diagonal(A)
    if A.shape != C.shape:
        raise ValueError(f"C must have shape {C.shape}, got {A.shape}")
    return A + C


def _of_free(value: Any, reduced: Reduction) -> Any:
    """Initial values of all dofs as those of the free ones; others as they are."""
    return reduced.reduce_motion(value) if np.shape(value) == (reduced.n,) else value


def idle_dofs(M: Any, K: Any, forces: Sequence[ElementForce]) -> np.ndarray:
    """(n,) bool: dofs without mass, stiffness and internal force; M and K are semidefinite."""
    idle = (M if M.ndim == 1 else M.diagonal()) == 0.0
    idle &= K.diagonal() == 0.0
    for force in forces:
        idle &= np.diff(force.pattern.indptr) == 0
    result: np.ndarray = idle
    return result


def _named(known: Mapping[str, np.ndarray], name: str, what: str) -> np.ndarray:
    if name not in known:
        names = ", ".join(map(repr, known)) or "none"
        raise ValueError(f"a {what} must be one of the mesh ({names}), got {name!r}")
    return known[name]
