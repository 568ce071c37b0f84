"""The uncut structure: its elements and dofs, and matrices of some elements or of a subdomain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from .._cached import cached_property
from .._checks import check_word, counted, listing, numbered, plain_array
from ..gradients.parameters import Parameters, labelled
from ..problem.dofs import GROUND, dof_array
from ..problem.internal import InternalForce
from ..problem.matrices import combination, sparse
from ..problem.subdomain import Subdomain
from ..structures.attached import Attached
from ..structures.element_force import Selected, of_chosen
from ..structures.pattern import Pattern
from ..structures.structure import Structure, idle_dofs
from .elements import Elements

# Possible numbers of dofs per node.
NODE_SIZES = (6, 3, 2)


def assembled(dofs: np.ndarray, values: np.ndarray, n: int) -> sp.csr_array:
    """The (n, n) matrix of element matrices (e or 1, k, k); negative dofs are left out.

    Where dofs come in nodes, the pairs of nodes are sorted instead of the pairs of dofs, of which
    there are up to 36 times as many.
    """
    e, k = dofs.shape
    b = _node_size(dofs, n)
    if b > 1:
        nodes = dofs[:, ::b] // b
        blocks = np.broadcast_to(values, (e, k, k)).reshape(e, k // b, b, k // b, b)
        return Pattern.of(nodes, n // b).matrix(blocks)
    rows, columns = (np.broadcast_to(x, (e, k, k)) for x in (dofs[:, :, None], dofs[:, None, :]))
    pairs = (rows >= 0) & (columns >= 0)
    entries = np.broadcast_to(values, (e, k, k))[pairs]
    return sp.coo_array((entries, (rows[pairs], columns[pairs])), shape=(n, n)).tocsr()


def assembled_mass(dofs: np.ndarray, values: np.ndarray, n: int) -> Any:
    """The (n, n) matrix, or its diagonal (n,) of lumped masses (e or 1, k)."""
    if values.ndim == 3:
        return assembled(dofs, values, n)
    free = dofs >= 0
    return np.bincount(dofs[free], np.broadcast_to(values, dofs.shape)[free], minlength=n)


def _node_size(dofs: np.ndarray, n: int) -> int:
    """b, where the dofs of each element are blocks of b in a row, beginning at multiples of b."""
    e, k = dofs.shape
    for b in NODE_SIZES:
        if k % b == 0 and n % b == 0:
            blocks = dofs.reshape(e, k // b, b)
            first = blocks[:, :, :1]
            if np.all(first >= 0) and np.all(first % b == 0):
                if np.array_equal(blocks, first + np.arange(b)):
                    return b
    return 1


class GroupForce:
    """The internal force of some elements of a group in the dofs of a subdomain."""

    def __init__(self, elements: Elements, numbers: np.ndarray, dofs: np.ndarray, n: int):
        e, k = dofs.shape
        self._internal, self._numbers, self._dofs, self._n = elements.internal, numbers, dofs, n
        self._kept = dofs >= 0
        pairs = self._kept[:, :, None] & self._kept[:, None, :]
        keys = (dofs[:, :, None] * n + dofs[:, None, :])[pairs]
        entries, self._slot = np.unique(keys, return_inverse=True)
        self._pairs = pairs
        row, self._column = np.divmod(entries, n)
        self._start = np.searchsorted(row, np.arange(n + 1))
        self._shape = elements.history[numbers].shape

    def force(self, history: np.ndarray) -> InternalForce:
        ones = np.ones(self._column.size)
        return InternalForce(self, history=history.ravel(), pattern=self._matrix_of(ones))

    def __call__(self, t: float, u: np.ndarray, v: np.ndarray, q: np.ndarray) -> tuple[Any, ...]:
        assert self._internal is not None
        # the dof -1 is the zero at the end
        at = [np.append(x, 0.0)[self._dofs] for x in (u, v)]
        f, *tangents = self._internal(t, *at, q.reshape(self._shape), self._numbers)
        q1 = [np.asarray(tangents.pop()).ravel()] if len(tangents) == 3 else []
        values = self._checked(f, self._dofs.shape, "f")
        total = np.bincount(self._dofs[self._kept], values[self._kept], minlength=self._n)
        matrices = [self._tangent(A, name) for A, name in zip(tangents, ("K_t", "C_t"))]
        return (total, *matrices, *q1)

    def _tangent(self, values: Any, name: str) -> sp.csr_array | None:
        if values is None:
            return None
        e, k = self._dofs.shape
        tangents = self._checked(values, (e, k, k), name)
        return self._matrix_of(
            np.bincount(self._slot, tangents[self._pairs], minlength=self._column.size)
        )

    def _matrix_of(self, values: np.ndarray) -> sp.csr_array:
        return sp.csr_array((values, self._column, self._start), shape=(self._n, self._n))

    @staticmethod
    def _checked(values: Any, shape: tuple[int, ...], name: str) -> np.ndarray:
        array = np.asarray(values, dtype=np.float64)
        if array.shape != shape:
            raise ValueError(f"internal must return {name} of shape {shape}, got {array.shape}")
        return array


class Portion(NamedTuple):
    """The free dofs (n_i,) of some elements, rising, and the matrices of these elements."""

    dofs: np.ndarray
    M: Any
    K: Any
    C: Any
    internal: list[Any]


class Blocks(NamedTuple):
    """Numbers and dofs (e, k) of some elements with their matrices, (e, k, k), or one row where all
    are equal; M (e, k) where lumped."""

    numbers: np.ndarray
    dofs: np.ndarray
    M: np.ndarray
    K: np.ndarray
    free: np.ndarray  # (e, k): which of the dofs are free


class Whole:
    """What is cut.

    n: number of dofs, the fixed ones included.
    linear: without internal forces.
    links: list of (e, a) arrays of int, of each group of elements what connects them: nodes of a
        mesh or dofs, -1 for none.
    entries: of each group, the entries of an element matrix.
    centroids: (elements, dim) array, or None where coordinates are not known.
    """

    n: int
    free: np.ndarray
    linear: bool
    links: list[np.ndarray]
    entries: list[int]
    centroids: np.ndarray | None

    @property
    def count(self) -> int:
        """Number of elements of all groups, which are numbered consecutively."""
        return sum(map(len, self.links))

    def by_group(self, values: np.ndarray) -> list[np.ndarray]:
        """Values of all elements, split into the groups."""
        return np.split(values, np.cumsum([len(links) for links in self.links])[:-1])

    @cached_property
    def incidence(self) -> tuple[np.ndarray, np.ndarray]:
        """The element and the link of each link of an element, fixed ones left out."""
        places = [np.nonzero(links >= 0) for links in self.links]
        begins = np.cumsum([0, *map(len, self.links)])
        elements = [begin + rows for begin, (rows, _) in zip(begins, places)]
        links = [links[place] for links, place in zip(self.links, places)]
        return np.concatenate(elements).astype(np.int32), np.concatenate(links).astype(np.int32)

    def costs(self) -> np.ndarray:
        """(elements,): entries of the element matrices, to which the time of a step is
        proportional."""
        counts = [len(links) for links in self.links]
        return np.repeat(np.array(self.entries, dtype=float), counts)

    def mass(self) -> Any:
        """The mass matrix of all dofs; None without."""
        raise NotImplementedError

    def portion(self, chosen: np.ndarray, owned: np.ndarray) -> Portion:
        """The matrices of some elements.

        owned: array of bool, of what `links` numbers: whose forces that belong to no element, such
            as contact, this portion has.
        """
        raise NotImplementedError

    def blocks(self, chunk: int) -> Iterator[Blocks]:
        """The matrices of the single elements, tangents at rest included, up to `chunk` at once."""
        raise NotImplementedError

    def nodes(self, value: Any, name: str) -> np.ndarray:
        """Numbers of nodes that are given by these, by a mask or by the name of a set."""
        raise TypeError(f"{name} must be nodes of a Structure, which pm.Elements do not have")

    def around(self, nodes: np.ndarray, depth: int) -> np.ndarray:
        """(elements,) array of bool: those at most `depth` elements away from nodes."""
        reached = np.zeros(self.link_count, dtype=bool)
        reached[nodes] = True
        element, link = self.incidence
        chosen = np.zeros(self.count, dtype=bool)
        for _ in range(min(depth, self.count)):
            chosen[element[reached[link]]] = True
            reached[link[chosen[element]]] = True
            if reached.all():
                break
        return chosen

    @property
    def link_count(self) -> int:
        return 1 + max(int(links.max()) for links in self.links)


class WholeStructure(Whole):
    """A structure of `pmalpha.structures`."""

    def __init__(self, structure: Structure, fixed: Any):
        if structure.recipe is None:
            raise ValueError(
                "structure must know the matrices of its elements, which one that was made of M "
                "and K does not; give them as pm.Elements"
            )
        self._structure = structure
        self.n, self._d = structure.n, structure.dofs_per_node
        self.linear = not structure.internal
        self._kinds = tuple(structure.elements)
        self.links = [structure.elements[kind] for kind in self._kinds]
        self.entries = [(links.shape[1] * self._d) ** 2 for links in self.links]
        self.free = _free(fixed, self.n, structure.dof_names)
        means = [structure.points[links].mean(axis=1) for links in self.links]
        self.centroids = np.concatenate(means)
        self._homes = None if structure.attached is None else self._homes_of(structure.attached)
        self._used = ~idle_dofs(structure.M, structure.K, structure.internal)
        used = np.zeros(len(structure.points), dtype=bool)
        for links in self.links:
            used[links] = True
        if not used.all():
            unused = listing(np.flatnonzero(~used))
            raise ValueError(f"structure must have an element at every node, not at {unused}")

    def mass(self) -> Any:
        """The mass matrix of all dofs."""
        return self._structure.M

    def nodes(self, value: Any, name: str) -> np.ndarray:
        sets = self._structure.sets
        if isinstance(value, str):
            if value not in sets:
                known = listing(list(sets)) if sets else "none"
                raise ValueError(f"{name} must be a set of nodes, of {known}, got {value!r}")
            value = sets[value]
        numbers = dof_array(plain_array(value, name), len(self._structure.points), name)
        if not numbers.size:
            raise ValueError(f"{name} must have a node, got none")
        return numbers

    def portion(self, chosen: np.ndarray, owned: np.ndarray) -> Portion:
        picked, d = self._picked(chosen), self._d
        nodes = np.unique(np.concatenate([links.ravel() for _, links in picked.values()]))
        number = np.full(len(self._structure.points), -1)
        number[nodes] = np.arange(nodes.size)
        elements = {kind: number[links] for kind, (_, links) in picked.items()}
        numbers = {kind: numbers for kind, (numbers, _) in picked.items()}
        assert self._structure.recipe is not None
        M, K, internal = self._structure.recipe(Selected(numbers, elements, nodes.size))
        C = None
        dofs = (d * nodes[:, None] + np.arange(d)).ravel()
        if self._homes is not None:
            added = self._attached(chosen, dofs)
            M = _sum(M, added.mass)
            K, C = K + added.K, added.C if added.C.nnz else None
        further = self._structure.internal[len(internal) :]
        number[~owned] = -1
        forces = [*internal, *_parts_of(further, number, nodes.size)]
        # such as the rotation of a node at which another subdomain has a beam
        free = self.free[dofs] & ~(idle_dofs(M, K, forces) & self._used[dofs])
        if not free.all():
            rows = np.flatnonzero(free)
            M = M[rows] if M.ndim == 1 else M[rows][:, rows]
            K = K[rows][:, rows]
            C = None if C is None else C[rows][:, rows]
            forces = [force.reduced(rows) for force in forces] if rows.size else []
        return Portion(dofs[free], M, K, C, forces)

    def _homes_of(self, attached: Attached) -> tuple[np.ndarray, np.ndarray]:
        """The element to which what is at each node (N,) belongs, and each spring (m,): one that
        has both of its nodes, if there is one."""
        element, node = self.incidence
        home = np.full(len(self._structure.points), -1)
        home[node[::-1]] = element[::-1]  # the first of each
        ends = np.where(attached.dofs == GROUND, attached.dofs[:, ::-1], attached.dofs) // self._d
        springs = home[ends[:, 0]]
        apart = np.flatnonzero(ends[:, 0] != ends[:, 1])
        at_nodes = sp.csr_array((np.ones(node.size), (node, element)))
        both = sp.csr_array(at_nodes[ends[apart, 0]] * at_nodes[ends[apart, 1]])
        some = np.diff(both.indptr) > 0
        springs[apart[some]] = both.indices[both.indptr[:-1][some]]  # the first of each
        return home, springs

    def _attached(self, chosen: np.ndarray, dofs: np.ndarray) -> Attached:
        """What is attached to the chosen elements, in their dofs."""
        assert self._homes is not None and self._structure.attached is not None
        attached, (home, springs) = self._structure.attached, self._homes
        ends = attached.dofs[chosen[springs]]
        outside = ends[~np.isin(ends, dofs) & (ends != GROUND)]
        if outside.size:
            raise ValueError(
                "a spring must have both ends in one subdomain, got one with dof "
                f"{outside[0]} in another; cut elsewhere, or give it as restoring= of a subdomain "
                "with ties to both"
            )
        return attached.on(dofs, np.repeat(chosen[home], self._d), chosen[springs])

    def _picked(self, chosen: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Numbers and nodes of the chosen elements of each kind that has some."""
        return {
            kind: (np.flatnonzero(mask), links[mask])
            for kind, links, mask in zip(self._kinds, self.links, self.by_group(chosen))
            if mask.any()
        }

    def blocks(self, chunk: int) -> Iterator[Blocks]:
        begin = 0
        for kind, links in zip(self._kinds, self.links):
            for first in range(0, len(links), chunk):
                nodes = links[first : first + chunk]
                yield self._exploded(kind, first, nodes, begin)
            begin += len(links)

    def _exploded(self, kind: str, first: int, nodes: np.ndarray, begin: int) -> Blocks:
        """Element matrices: those of the elements with a node of its own for each corner."""
        e, a = nodes.shape
        numbers = first + np.arange(e)
        apart = np.arange(e * a).reshape(e, a)
        assert self._structure.recipe is not None
        M, K, internal = self._structure.recipe(Selected({kind: numbers}, {kind: apart}, e * a))
        k = a * self._d
        for force in internal:
            K = K + force(np.zeros(force.n))[1]
        dofs = (self._d * nodes[:, :, None] + np.arange(self._d)).reshape(e, k)
        masses = M.reshape(e, k) if M.ndim == 1 else _diagonal_blocks(M, e, k)
        idle = idle_dofs(M, K, internal).reshape(e, k)
        free = self.free[dofs] & ~(idle & self._used[dofs])
        return Blocks(begin + numbers, dofs, masses, _diagonal_blocks(K, e, k), free)


class WholeElements(Whole):
    """Groups of `Elements`."""

    def __init__(self, groups: Sequence[Elements], fixed: Any, points: Any):
        self._groups = tuple(groups)
        self.n = 1 + max(int(group.dofs.max()) for group in groups)
        self._require_elements()
        self.free = _free(fixed, self.n)
        self.linear = all(group.internal is None for group in groups)
        self.links = [group.dofs for group in groups]
        self.entries = [group.dofs.shape[1] ** 2 for group in groups]
        self.centroids = points

    def _require_elements(self) -> None:
        """ValueError for dofs without, before arrays of n dofs are made."""
        numbers = np.unique(np.concatenate([group.dofs.ravel() for group in self._groups]))
        dofs = numbers[numbers >= 0]
        if dofs.size < self.n:
            missing = np.setdiff1d(np.arange(min(self.n, dofs.size + 6)), dofs)
            raise ValueError(
                f"structure must have an element at every dof in 0..{self.n - 1}, not at "
                f"{numbered('dof', missing)}; a fixed dof has a negative number"
            )

    def mass(self) -> Any:
        """The mass matrix of all dofs in inner form; None without."""
        masses = [
            assembled_mass(group.dofs, group.M, self.n)
            for group in self._groups
            if group.M is not None
        ]
        return combination([(1.0, M) for M in masses])

    def portion(self, chosen: np.ndarray, owned: np.ndarray) -> Portion:
        picked = [
            (group, np.flatnonzero(mask))
            for group, mask in zip(self._groups, self.by_group(chosen))
        ]
        present = np.zeros(self.n + 1, dtype=bool)  # the last entry is that of negative dofs
        for group, numbers in picked:
            present[group.dofs[numbers]] = True
        dofs = np.flatnonzero(present[:-1] & self.free)
        number = np.full(self.n + 1, -1)
        number[dofs] = np.arange(dofs.size)
        local = [
            (group, numbers, number[np.maximum(group.dofs[numbers], -1)])
            for group, numbers in picked
        ]
        parts = [(group, numbers, where) for group, numbers, where in local if numbers.size]
        terms: dict[str, Any] = {"M": None, "K": None, "C": None}
        for name in terms:
            for group, numbers, where in parts:
                values = getattr(group, name)
                if values is not None:
                    values = values if len(values) == 1 else values[numbers]
                    make = assembled_mass if name == "M" else assembled
                    terms[name] = _sum(terms[name], make(where, values, dofs.size))
        forces = [
            GroupForce(group, numbers, where, dofs.size).force(group.history[numbers])
            for group, numbers, where in parts
            if group.internal is not None and dofs.size
        ]
        M = np.zeros(dofs.size) if terms["M"] is None else terms["M"]
        return Portion(dofs, M, terms["K"], terms["C"], forces)

    def blocks(self, chunk: int) -> Iterator[Blocks]:
        begin = 0
        for group in self._groups:
            e, k = group.dofs.shape
            for first in range(0, e, chunk):
                numbers = np.arange(first, min(first + chunk, e))
                M = np.zeros((1, k)) if group.M is None else group.M
                K = np.zeros((1, k, k)) if group.K is None else group.K
                M, K = (x if len(x) == 1 else x[numbers] for x in (M, K))
                if group.internal is not None:
                    rest = np.zeros((numbers.size, k))
                    tangent = group.internal(0.0, rest, rest, group.history[numbers], numbers)[1]
                    K = K if tangent is None else K + np.asarray(tangent)
                where = group.dofs[numbers]
                free = (where >= 0) & self.free[where]
                if free.all() and len(M) == len(K) == 1:
                    free = free[:1]  # all elements are equal
                yield Blocks(begin + numbers, where, M, K, free)
            begin += e


def whole_of(structure: Any, fixed: Any, points: Any) -> Whole:
    if isinstance(structure, Structure):
        if points is not None:
            raise TypeError("points must not be given for a structure, which has them")
        return WholeStructure(structure, fixed)
    groups = (structure,) if isinstance(structure, Elements) else structure
    if not isinstance(groups, Sequence) or not all(isinstance(g, Elements) for g in groups):
        raise TypeError(
            "structure must be a Structure, pm.Elements or a list of these groups, got "
            f"{structure!r}"
        )
    if not groups:
        raise ValueError("structure must have elements, got an empty list")
    return WholeElements(groups, fixed, points)


def _free(fixed: Any, n: int, names: Any = None) -> np.ndarray:
    free = np.ones(n, dtype=bool)
    if fixed is not None:
        free[dof_array(fixed, n, "fixed", names)] = False
    if not free.any():
        raise ValueError(f"fixed must leave a dof free, got all {counted(n, 'dof')}")
    return free


def _sum(one: Any, other: Any) -> Any:
    if one is None:
        return other
    if one.ndim == other.ndim:
        return one + other
    return sparse(one, other.shape[0]) + sparse(other, other.shape[0])


def _parts_of(forces: Sequence[Any], number: np.ndarray, nodes: int) -> list[Any]:
    parts = [force.of_nodes(number, nodes) for force in forces]
    return [part for part in parts if part is not None]


def _diagonal_blocks(A: Any, e: int, k: int) -> np.ndarray:
    """(e, k, k): the blocks of a sparse matrix that has no other entries."""
    blocks = np.zeros((e, k, k))
    A = sp.coo_array(sp.csr_array(A))
    A.sum_duplicates()
    blocks[A.row // k, A.row % k, A.col % k] = A.data
    return blocks


# ---- element factors ----------------------------------------------------------------------------
# What gradients are taken with respect to, by the elements of a structure.

__all__ = ["element_parameters"]

# What a factor of elements multiplies.
SCALED = {"stiffness": "K", "mass": "M", "thickness": "MK"}
# Elements whose matrices are made at once.
CHUNK = 4096


def element_parameters(
    structure: Any,
    subdomain: Subdomain | str,
    *,
    labels: Any = None,
    scales: str = "stiffness",
    fixed: Any = None,
) -> Parameters:
    """Factors of the stiffness, mass or thickness of elements, at 1, for `Coupler.gradient`.

    Parameters
    ----------
    structure : Structure, Elements, or list of Elements
        Of which the matrices of the subdomain were made. `Cut.parameters` is for those that
        were cut.
    subdomain : Subdomain or str
        Its dofs are the free dofs in rising order. With Rayleigh damping a Subdomain, not its
        name: its C then changes with M and K.
    labels : (elements,) array_like, optional
        Elements with the same label share a factor, such as ``structure.labels()`` for the
        groups of a mesh, or ``np.arange(...)`` for a factor of each element. The elements are
        counted through all kinds and groups. Default: one factor for all.
    scales : {"stiffness", "mass", "thickness"}
        What the factor multiplies: K (Young's modulus), M (density), or both.
    fixed : array_like, optional
        As for `cut`: the dofs that the subdomain has not.

    Returns
    -------
    Parameters
        With ``labels``.

    Raises
    ------
    TypeError, ValueError
        For bad labels, internal forces, and another number of free dofs than the subdomain has.

    Examples
    --------
    The moduli of two halves of a cantilever:

    >>> import numpy as np, pmalpha as pm
    >>> from pmalpha import structures
    >>> wall = structures.plate(8, 2, 0.5, E=30e9, nu=0.2, rho=2500.0)
    >>> foot = wall.dofs(wall.nodes_at(x=0.0))
    >>> held = pm.reduce(wall.M, wall.K, fixed=foot)
    >>> beam = pm.Subdomain(held.M, held.K, scheme=pm.Newmark(), name="beam")
    >>> halves = np.where(np.arange(16) < 8, "left", "right")
    >>> moduli = pm.element_parameters(wall, beam, labels=halves, fixed=foot)
    >>> moduli, moduli.labels.tolist()
    (<Parameters of 'beam': 2 by K>, ['left', 'right'])
    """
    model = whole_of(structure, fixed, None)
    n = np.count_nonzero(model.free)
    if isinstance(subdomain, Subdomain) and subdomain.n != n:
        raise ValueError(
            f"structure must have the {counted(subdomain.n, 'dof')} of {subdomain.name!r} free,"
            f" got {n}: give the others as fixed"
        )
    tags = np.zeros(model.count, int) if labels is None else labels
    every = np.ones(model.count, bool)
    return factors(model, subdomain, np.flatnonzero(model.free), every, tags, scales)


def factors(
    model: Whole,
    subdomain: Subdomain | str,
    dofs: np.ndarray,
    chosen: np.ndarray,
    labels: Any,
    scales: str,
) -> Parameters:
    """`element_parameters` for the chosen (elements,) of a structure, with all of its labels.

    `dofs` are those of the structure that the subdomain has, in its order.
    """
    if not model.linear:
        raise ValueError("structure must have no internal forces: they have no gradients here")
    check_word(scales, "scales", tuple(SCALED))
    names, of = labelled(labels, model.count)
    place = np.full(model.n + 1, -1)  # the last entry is that of negative dofs
    place[dofs] = np.arange(dofs.size)
    # a label without elements here has one without entries
    where, own_labels = [np.zeros((names.size, 1), int)], [names]
    matrices = {kind: [np.zeros((names.size, 1, 1))] for kind in SCALED[scales]}
    for block in model.blocks(CHUNK):
        rows = np.flatnonzero(chosen[block.numbers])
        local = place[block.dofs[rows]]
        free = (local >= 0) & of_chosen(block.free, rows)
        pairs = free[:, :, None] & free[:, None, :]
        where.append(np.where(free, local, 0))
        own_labels.append(names[of[block.numbers[rows]]])
        for kind, listed in matrices.items():
            values = of_chosen(getattr(block, kind), rows)
            if values.ndim == 2:
                values = values[:, :, None] * np.eye(values.shape[1])
            listed.append(np.where(pairs, values, 0.0))
    terms = {kind: _stacked(listed) for kind, listed in matrices.items()}
    rayleigh = getattr(subdomain, "rayleigh", None)
    if rayleigh is not None:
        shares = dict(zip("MK", rayleigh))
        terms["C"] = np.sum([shares[kind] * x for kind, x in terms.items()], axis=0)
    return Parameters(subdomain, dofs=_stacked(where), labels=np.concatenate(own_labels), **terms)


def _stacked(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """One below the other, with zeros at the end of shorter rows and columns."""
    width = max(x.shape[1] for x in arrays)
    return np.concatenate(
        [np.pad(x, [(0, 0), *[(0, width - x.shape[1])] * (x.ndim - 1)]) for x in arrays]
    )
