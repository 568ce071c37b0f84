"""What is decided before a structure is cut: labels, names, schemes, substeps, partitions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from .._checks import counted, listing, whole_number
from ..gradients.parameters import labelled
from ..problem.schemes import GeneralizedAlpha, Scheme
from ..reduction.ordering import has_nested_dissection
from ..setup.stability import critical_product
from .whole import Blocks, Whole

# Steps are at most this fraction of the critical step of every element.
FRACTION = 0.95
# Elements whose matrices are held at a time.
CHUNK = 4096
# lambda_max <= |B^16|_F^(1/16), at most the 32nd root of the number of dofs above lambda_max: up to
# 1.05 times the frequency for 24 dofs
SQUARINGS = 4
# Numbers of substeps of elements that share a node differ by this factor at most, 2^2.
GRADE = 2
# A group of connected elements of up to this number becomes finer if all its neighbours are.
ISLAND = 8
# Levels above this one are refused: 2^20 substeps.
FINEST = 20
# METIS takes weights as whole numbers; their sum has to fit into 32 bits.
TOTAL_WEIGHT = 2**30
# The scheme where none is given.
RHO = 0.5
# Cost of a step of an implicit subdomain over that of an explicit one, for the first selection of
# candidates only: twice the fill of a small plate.
IMPLICIT = 8.0


def frequencies(model: Whole) -> np.ndarray:
    """(elements,): upper bounds of the highest circular frequency of each element alone.

    The largest of them is an upper bound of the highest frequency of any assembly of the elements
    (Irons and Treharne, 1971), with any dofs fixed or tied. inf for an element with stiffness at a
    dof without mass.
    """
    omega = np.empty(model.count)
    for blocks in model.blocks(CHUNK):
        omega[blocks.numbers] = np.sqrt(_largest(blocks))
    return omega


def _largest(blocks: Blocks) -> np.ndarray:
    """(e,) or (1,): bounds of the largest eigenvalue of K with respect to M."""
    free = blocks.free
    K = np.where(free[:, :, None] & free[:, None, :], blocks.K, 0.0)
    if blocks.M.ndim == 2:
        return _of_lumped(K, np.broadcast_to(blocks.M, free.shape))
    k = free.shape[1]
    mass = np.einsum("ekk->ek", blocks.M)
    free = free & ((mass > 0.0) | (np.abs(K).max(axis=2) > 0.0))  # not rotations of a solid
    M = np.where(free[:, :, None] & free[:, None, :], blocks.M, np.eye(k))
    if len(M) < len(K):
        M = np.broadcast_to(M, K.shape)
    smallest = np.linalg.eigvalsh(M)[:, 0]
    definite = smallest > 1e-12 * np.abs(M).max(axis=(1, 2))
    values = np.full(len(K), np.inf)
    R = np.linalg.cholesky(M[definite])  # M = R R^T
    half = np.linalg.solve(R, K[definite])
    values[definite] = _bound(np.linalg.solve(R, np.swapaxes(half, 1, 2)))
    return values


def _of_lumped(K: np.ndarray, mass: np.ndarray) -> np.ndarray:
    loaded = np.abs(K).max(axis=2) > 0.0
    massless = (loaded & ~(mass > 0.0)).any(axis=1)
    root = np.where(mass > 0.0, mass, np.inf) ** -0.5
    values = _bound(root[:, :, None] * K * root[:, None, :])
    values[massless] = np.inf
    return values


def _bound(B: np.ndarray) -> np.ndarray:
    """(e,): |B^16|_F^(1/16), an upper bound of the eigenvalues of symmetric matrices (e, k, k)."""
    size = np.sqrt(np.einsum("eij,eij->e", B, B))
    S = B / np.where(size > 0.0, size, 1.0)[:, None, None]
    for _ in range(SQUARINGS):
        S = S @ S
    power = 0.5 / 2**SQUARINGS
    result: np.ndarray = size * np.einsum("eij,eij->e", S, S) ** power
    return result


def levels_of(omega: np.ndarray, dt: float, scheme: Scheme, *, check: bool = True) -> np.ndarray:
    """The smallest levels l >= 0 with dt / 2^l up to 0.95 times the critical step."""
    limit = critical_product(scheme)
    if not np.isfinite(limit):
        return np.zeros(omega.shape, dtype=np.int64)
    with np.errstate(divide="ignore"):
        ratio = np.log2(dt * omega / (FRACTION * limit))
    most = float(np.max(ratio))
    if check and most > FINEST:
        cause = f"it is {2.0**most:.3g} times the shortest of them"
        if np.isinf(most):
            cause = "some elements have no mass where they have stiffness"
        raise ValueError(
            f"dt must be at most 2^{FINEST} times the critical steps of elements in an explicit "
            f"subdomain, got {dt:g}: {cause}"
        )
    # a ratio of exactly 2^l must not become l + 1 by rounding
    return np.maximum(np.ceil(ratio - 1e-9), 0.0).astype(np.int64)


def graded(model: Whole, levels: np.ndarray) -> np.ndarray:
    """Levels that are not lower, without islands, and 2 apart at most where elements meet."""
    levels = levels.copy()
    while True:
        before = levels.copy()
        while _raise_to_neighbours(model, levels):
            pass
        _absorb_islands(model, levels)
        if np.array_equal(levels, before):
            return levels


def _raise_to_neighbours(model: Whole, levels: np.ndarray) -> bool:
    """Raise levels to 2 below the highest of the elements with a common node, in place."""
    element, link = model.incidence
    at, needed = (np.zeros(size, dtype=levels.dtype) for size in (model.link_count, model.count))
    np.maximum.at(at, link, levels[element])
    np.maximum.at(needed, element, at[link])
    needed -= GRADE
    raised = bool(np.any(needed > levels))
    np.maximum(levels, needed, out=levels)
    return raised


def _absorb_islands(model: Whole, levels: np.ndarray) -> None:
    """Give a few connected elements among finer ones the lowest level around them, in place."""
    group, size = _connected(model, levels)
    element, link = model.incidence
    most = np.iinfo(levels.dtype).max
    lowest = np.full(size.size, most)
    coarser = np.zeros(size.size, dtype=bool)
    for level in np.unique(levels)[::-1]:  # from the finest, so that the lowest one remains
        at, touched = (np.zeros(size, dtype=bool) for size in (model.link_count, model.count))
        at[link[levels[element] == level]] = True
        touched[element[at[link]]] = True
        lowest[group[touched & (levels < level)]] = level
        coarser[group[touched & (levels > level)]] = True
    change = ((size <= ISLAND) & ~coarser & (lowest < most))[group]
    levels[change] = lowest[group[change]]


def _connected(model: Whole, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The group of each element, connected through nodes with elements of its level; sizes."""
    from scipy.sparse.csgraph import connected_components

    element, link = model.incidence
    pair = link.astype(np.int64) * (int(levels.max()) + 1) + levels[element]  # link and level
    _, column = np.unique(pair, return_inverse=True)
    n = model.count + int(column.max()) + 1
    entries = np.ones(element.size, dtype=bool), (element, model.count + column)
    graph = sp.coo_array(entries, shape=(n, n))
    group = connected_components(graph, directed=False)[1][: model.count]
    return group, np.bincount(group)


def partition(model: Whole, parts: int, costs: np.ndarray) -> np.ndarray:
    """(elements,): labels 0 .. parts - 1 of nearly equal sums of costs, none without an element."""
    k = whole_number(parts, "parts", low=1)
    if k > model.count:
        raise ValueError(f"parts must be at most the number of elements, {model.count}, got {k}")
    if k == 1:
        return np.zeros(model.count, dtype=np.int64)
    if has_nested_dissection():
        labels = _by_metis(model, k, costs)
        if np.unique(labels).size == k:
            return labels
    if model.centroids is None:
        raise ValueError(
            "points, the centres of the elements, must be given for parts= of Elements where "
            "pymetis is not installed or leaves a part empty"
        )
    return bisected(model.centroids, k, costs)


def bisected(points: np.ndarray, parts: int, costs: np.ndarray) -> np.ndarray:
    """Labels by recursive bisection across the longest extent of the points."""
    labels = np.zeros(len(points), dtype=np.int64)
    waiting = [(np.arange(len(points)), 0, parts)]
    while waiting:
        elements, first, k = waiting.pop()
        if k == 1:
            labels[elements] = first
            continue
        extent = np.ptp(points[elements], axis=0)
        order = elements[np.argsort(points[elements, int(np.argmax(extent))], kind="stable")]
        left = k // 2
        share = np.cumsum(costs[order]) - 0.5 * costs[order]
        at = int(np.searchsorted(share, costs[order].sum() * left / k))
        at = min(max(at, left), elements.size - (k - left))  # an element at least for each label
        waiting += [(order[:at], first, left), (order[at:], first + left, k - left)]
    return labels


def _by_metis(model: Whole, parts: int, costs: np.ndarray) -> np.ndarray:
    import pymetis

    graph = adjacency(model)
    weights = np.maximum(1, costs / costs.sum() * TOTAL_WEIGHT).astype(np.int32)
    _, labels = pymetis.part_graph(
        parts,
        adjacency=pymetis.CSRAdjacency(
            adj_starts=graph.indptr.astype(np.int32), adjacent=graph.indices.astype(np.int32)
        ),
        vweights=weights,
        options=pymetis.Options(seed=1, numbering=0),
    )
    return np.array(labels, dtype=np.int64)


def adjacency(model: Whole) -> sp.csr_array:
    """Elements that share a face, as far as this can be seen: of two elements with common nodes
    those that have more than half as many as one of them has with any other element."""
    entries = np.ones(model.incidence[0].size, dtype=np.int32), model.incidence
    member = sp.csr_array(entries, shape=(model.count, model.link_count))
    common = sp.csr_array(member @ member.T)
    row = np.repeat(np.arange(model.count, dtype=np.int32), np.diff(common.indptr))
    apart = row != common.indices
    most = np.zeros(model.count, dtype=common.data.dtype)
    np.maximum.at(most, row[apart], common.data[apart])
    least = np.minimum(most[row], most[common.indices])
    faces = apart & (2 * common.data > least)
    ptr = np.concatenate([[0], np.cumsum(np.bincount(row[faces], minlength=model.count))])
    index = common.indices[faces]
    return sp.csr_array((np.ones(index.size, dtype=np.int32), index, ptr), shape=common.shape)


class CutMember(NamedTuple):
    """What one subdomain is made of, its elements apart."""

    name: str
    scheme: Scheme
    substeps: int


class Choice(NamedTuple):
    """The subdomain of each element, and the subdomains."""

    labels: np.ndarray
    members: list[CutMember]


class Candidates(NamedTuple):
    """Choices by name, for this macro step; scheme and steps of the uncut run they replace."""

    dt: float
    choices: dict[str, Choice]
    uncut: tuple[Scheme, int] | None


def _choice(labels: np.ndarray, names: Any, schemes: Any, substeps: Any) -> Choice:
    return Choice(
        labels, [CutMember(*facts) for facts in zip(names, schemes, substeps, strict=True)]
    )


def by_steps(model: Whole, labels: str, parts: Any, dt: float | None, scheme: Any) -> Choice:
    """Explicit subdomains by critical steps of elements."""
    if labels != "steps":
        raise ValueError(f'labels must be an array or "steps", got {labels!r}')
    if parts is not None:
        raise TypeError('parts must not be given with labels="steps"')
    if dt is None:
        raise TypeError('dt must be given with labels="steps"')
    one = GeneralizedAlpha(RHO, explicit=True) if scheme is None else scheme
    if not isinstance(one, Scheme) or not np.isfinite(critical_product(one)):
        raise ValueError(
            f'scheme must be one explicit or conditionally stable scheme with labels="steps", got '
            f"{one!r}"
        )
    levels = graded(model, levels_of(frequencies(model), dt, one))
    present, numbers = np.unique(levels, return_inverse=True)
    substeps = [2**level for level in present.tolist()]
    names = [counted(count, "substep") for count in substeps]
    return _choice(numbers, names, [one] * len(names), substeps)


def automatic(model: Whole, labels: Any, parts: str, dt: float | None, scheme: Any) -> Candidates:
    """Explicit levels; the finest levels implicit; all implicit."""
    if parts != "auto":
        raise ValueError(f'parts must be a number or "auto", got {parts!r}')
    if labels is not None:
        raise TypeError('labels must not be given with parts="auto"')
    if dt is None:
        raise TypeError('dt must be given with parts="auto"')
    if not model.linear:
        raise ValueError(
            'structure must be linear with parts="auto", got one with internal forces, whose '
            "iterations are known in a run only"
        )
    explicit, implicit = _pair(scheme)
    omega = frequencies(model)
    possible = np.isfinite(omega)
    levels = np.full(omega.size, FINEST + 1)
    if possible.any():
        levels[possible] = np.minimum(levels_of(omega[possible], dt, explicit, check=False), FINEST)
    levels = graded(model, levels)
    choices = {"implicit": _levels_below(np.zeros(omega.size, dtype=int), 0, explicit, implicit)}
    for top in _thresholds(levels, model.costs()):
        name = f"implicit from {counted(2**top, 'substep')} on"
        choices[name] = _levels_below(levels, top, explicit, implicit)
    uncut = None
    if levels.max() < FINEST:
        uncut = explicit, 2 ** int(levels.max())
        choices["explicit"] = _levels_below(levels, int(levels.max()) + 1, explicit, implicit)
    return Candidates(dt, choices, uncut)


def _pair(scheme: Any) -> tuple[Scheme, Scheme]:
    """The explicit and the implicit scheme, from two in any order."""
    if scheme is None:
        return GeneralizedAlpha(RHO, explicit=True), GeneralizedAlpha(RHO)
    schemes = list(scheme) if isinstance(scheme, Sequence) else [scheme]
    one = [s for s in schemes if isinstance(s, Scheme) and np.isfinite(critical_product(s))]
    other = [s for s in schemes if isinstance(s, Scheme) and not np.isfinite(critical_product(s))]
    if len(schemes) != 2 or len(one) != 1 or len(other) != 1:
        raise ValueError(
            f'scheme must be an explicit and an implicit one with parts="auto", got {scheme!r}'
        )
    return one[0], other[0]


def _thresholds(levels: np.ndarray, costs: np.ndarray) -> list[int]:
    """Up to two levels from which on an implicit subdomain is likely to pay."""
    present = np.unique(levels)[1:].tolist()
    explicit = costs * 2.0**levels

    def estimate(top: int) -> float:
        fine = levels >= top
        return float(explicit[~fine].sum() + IMPLICIT * costs[fine].sum())

    return sorted(sorted(present, key=estimate)[:2])


def _levels_below(levels: np.ndarray, top: int, explicit: Scheme, implicit: Scheme) -> Choice:
    """Explicit subdomains of the levels below `top`, and an implicit one of the others."""
    merged = np.minimum(levels, top)
    present, numbers = np.unique(merged, return_inverse=True)
    fine = present == top
    substeps = [1 if last else 2**level for level, last in zip(present.tolist(), fine)]
    names = [
        "implicit" if last else counted(count, "substep") for count, last in zip(substeps, fine)
    ]
    schemes = [implicit if last else explicit for last in fine]
    return _choice(numbers, names, schemes, substeps)


def by_labels(model: Whole, labels: Any, parts: Any, dt: float | None, scheme: Any) -> Choice:
    """By the labels of the user, or in subdomains of equal cost."""
    if (labels is None) == (parts is None):
        raise TypeError("labels or parts must be given, and not both")
    omega = None
    if dt is not None and _any_limit(scheme):
        omega = frequencies(model)
    if labels is None:
        costs = model.costs()
        if omega is not None and dt is not None and isinstance(scheme, Scheme):
            costs = costs * 2.0 ** levels_of(omega, dt, scheme)
        numbers = partition(model, parts, costs)
        names = [f"part {i}" for i in range(int(numbers.max()) + 1)]
    else:
        tags, numbers = labelled(labels, model.count)
        names = [_named(tag) for tag in tags.tolist()]
    schemes = _schemes(scheme, names)
    substeps = [1] * len(names)
    if omega is not None and dt is not None:
        substeps = [
            2 ** int(levels_of(omega[numbers == i], dt, s).max()) for i, s in enumerate(schemes)
        ]
    return _choice(numbers, names, schemes, substeps)


def by_layer(
    model: Whole, layer_of: Any, labels: Any, parts: Any, dt: float | None, scheme: Any
) -> Choice:
    """A layer of elements around nodes, at the finest step, and the bulk."""
    if labels is not None or parts is not None:
        raise TypeError("labels and parts must not be given with layer_of")
    nodes, depth = layer_of if isinstance(layer_of, tuple) and len(layer_of) == 2 else (layer_of, 1)
    depth = whole_number(depth, "depth of layer_of", low=1)
    chosen = model.around(model.nodes(nodes, "layer_of"), depth)
    if chosen.all():
        raise ValueError(
            f"layer_of must leave elements for the bulk, got all {model.count} up to depth {depth}"
        )
    if scheme is None:
        scheme = {"layer": GeneralizedAlpha(RHO, explicit=True), "bulk": GeneralizedAlpha(RHO)}
    choice = by_labels(model, np.where(chosen, "layer", "bulk"), None, dt, scheme)
    # what contact requires, should the bulk have smaller elements
    bulk, layer = choice.members
    layer = layer._replace(substeps=max(layer.substeps, bulk.substeps))
    return Choice(choice.labels, [bulk, layer])


def with_substeps(choice: Choice, substeps: Any) -> Choice:
    """The choice with the user's numbers of substeps, by name or label."""
    if substeps is None:
        return choice
    if not isinstance(substeps, Mapping):
        raise TypeError(f"substeps must be a dict by subdomain, got {substeps!r}")
    numbers = {
        _named(label): whole_number(count, f"substeps[{label!r}]", low=1)
        for label, count in substeps.items()
    }
    names = [member.name for member in choice.members]
    if unknown := [name for name in numbers if name not in names]:
        raise KeyError(f"substeps must be of {listing(names)}, got {unknown[0]!r}")
    members = [x._replace(substeps=numbers.get(x.name, x.substeps)) for x in choice.members]
    return choice._replace(members=members)


def _any_limit(scheme: Any) -> bool:
    schemes = scheme.values() if isinstance(scheme, Mapping) else scheme
    if not isinstance(schemes, Iterable) or hasattr(schemes, "ndim"):  # of arrays
        schemes = [schemes]
    return any(isinstance(s, Scheme) and np.isfinite(critical_product(s)) for s in schemes)


def _named(label: Any) -> Any:
    """The name of the subdomain with this label."""
    return f"part {label}" if isinstance(label, (int, np.integer)) else label


def _schemes(scheme: Any, names: Sequence[str]) -> list[Scheme]:
    if scheme is None:
        scheme = GeneralizedAlpha(RHO)
    if isinstance(scheme, Mapping):
        scheme = {_named(label): s for label, s in scheme.items()}
        unknown = [name for name in scheme if name not in names]
        missing = [name for name in names if name not in scheme]
        if unknown or missing:
            raise ValueError(
                f"scheme must have one for each of {listing(names)}, got {listing(list(scheme))}"
            )
        schemes = [scheme[name] for name in names]
    elif isinstance(scheme, Sequence):
        schemes = list(scheme)
        if len(schemes) != len(names):
            raise ValueError(
                f"scheme must be one or one for each of {counted(len(names), 'subdomain')}, got "
                f"{len(schemes)}"
            )
    else:
        schemes = [scheme] * len(names)
    for one in schemes:
        if not isinstance(one, Scheme):
            raise TypeError(f"scheme must be a Scheme, got {one!r}")
    return schemes
