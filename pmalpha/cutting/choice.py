"""What is decided before a structure is cut: labels, names, schemes and substeps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .._checks import counted, listing, plain_array, whole_number
from ..problem.schemes import GeneralizedAlpha, Scheme
from ..setup.stability import critical_product
from .partition import partition
from .steps import FINEST, frequencies, graded, levels_of
from .whole import Whole

# The scheme where none is given.
RHO = 0.5
# Cost of a step of an implicit subdomain over that of an explicit one, for the first selection of
# candidates only: twice the fill of a small plate.
IMPLICIT = 8.0


class Part(NamedTuple):
    """What one subdomain is made of, its elements apart."""

    name: str
    scheme: Scheme
    substeps: int


class Choice(NamedTuple):
    """The subdomain of each element, and the subdomains."""

    labels: np.ndarray
    parts: list[Part]


class Candidates(NamedTuple):
    """Choices by name, for this macro step; scheme and steps of the uncut run they replace."""

    dt: float
    choices: dict[str, Choice]
    uncut: tuple[Scheme, int] | None


def _choice(labels: np.ndarray, names: Any, schemes: Any, substeps: Any) -> Choice:
    return Choice(labels, [Part(*facts) for facts in zip(names, schemes, substeps, strict=True)])


def by_steps(whole: Whole, labels: str, parts: Any, dt: float | None, scheme: Any) -> Choice:
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
    levels = graded(whole, levels_of(frequencies(whole), dt, one))
    present, numbers = np.unique(levels, return_inverse=True)
    substeps = [2**level for level in present.tolist()]
    names = [counted(count, "substep") for count in substeps]
    return _choice(numbers, names, [one] * len(names), substeps)


def automatic(whole: Whole, labels: Any, parts: str, dt: float | None, scheme: Any) -> Candidates:
    """Explicit levels; the finest levels implicit; all implicit."""
    if parts != "auto":
        raise ValueError(f'parts must be a number or "auto", got {parts!r}')
    if labels is not None:
        raise TypeError('labels must not be given with parts="auto"')
    if dt is None:
        raise TypeError('dt must be given with parts="auto"')
    if not whole.linear:
        raise ValueError(
            'structure must be linear with parts="auto", got one with internal forces, whose '
            "iterations are known in a run only"
        )
    explicit, implicit = _pair(scheme)
    omega = frequencies(whole)
    possible = np.isfinite(omega)
    levels = np.full(omega.size, FINEST + 1)
    if possible.any():
        levels[possible] = np.minimum(levels_of(omega[possible], dt, explicit, check=False), FINEST)
    levels = graded(whole, levels)
    found = {"implicit": _levels_below(np.zeros(omega.size, dtype=int), 0, explicit, implicit)}
    for top in _thresholds(levels, whole.costs()):
        name = f"implicit from {counted(2**top, 'substep')} on"
        found[name] = _levels_below(levels, top, explicit, implicit)
    uncut = None
    if levels.max() < FINEST:
        uncut = explicit, 2 ** int(levels.max())
        found["explicit"] = _levels_below(levels, int(levels.max()) + 1, explicit, implicit)
    return Candidates(dt, found, uncut)


def _pair(scheme: Any) -> tuple[Scheme, Scheme]:
    """The explicit and the implicit scheme, from two in any order."""
    if scheme is None:
        return GeneralizedAlpha(RHO, explicit=True), GeneralizedAlpha(RHO)
    given = list(scheme) if isinstance(scheme, Sequence) else [scheme]
    one = [s for s in given if isinstance(s, Scheme) and np.isfinite(critical_product(s))]
    other = [s for s in given if isinstance(s, Scheme) and not np.isfinite(critical_product(s))]
    if len(given) != 2 or len(one) != 1 or len(other) != 1:
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


def by_labels(whole: Whole, labels: Any, parts: Any, dt: float | None, scheme: Any) -> Choice:
    """By the labels of the user, or in parts of equal cost."""
    if (labels is None) == (parts is None):
        raise TypeError("labels or parts must be given, and not both")
    omega = None
    if dt is not None and _any_limit(scheme):
        omega = frequencies(whole)
    if labels is None:
        costs = whole.costs()
        if omega is not None and dt is not None and isinstance(scheme, Scheme):
            costs = costs * 2.0 ** levels_of(omega, dt, scheme)
        numbers = partition(whole, parts, costs)
        names = [f"part {i}" for i in range(int(numbers.max()) + 1)]
    else:
        names, numbers = checked_labels(labels, whole.count)
    schemes = _schemes(scheme, names)
    substeps = [1] * len(names)
    if omega is not None and dt is not None:
        substeps = [
            2 ** int(levels_of(omega[numbers == i], dt, own).max()) for i, own in enumerate(schemes)
        ]
    return _choice(numbers, names, schemes, substeps)


def by_layer(
    whole: Whole, layer_of: Any, labels: Any, parts: Any, dt: float | None, scheme: Any
) -> Choice:
    """A layer of elements around nodes, at the finest step, and the bulk."""
    if labels is not None or parts is not None:
        raise TypeError("labels and parts must not be given with layer_of")
    nodes, depth = layer_of if isinstance(layer_of, tuple) and len(layer_of) == 2 else (layer_of, 1)
    depth = whole_number(depth, "depth of layer_of", low=1)
    chosen = whole.around(whole.nodes(nodes, "layer_of"), depth)
    if chosen.all():
        raise ValueError(
            f"layer_of must leave elements for the bulk, got all {whole.count} up to depth {depth}"
        )
    if scheme is None:
        scheme = {
            "layer": GeneralizedAlpha(RHO, explicit=True),
            "bulk": GeneralizedAlpha(RHO),
        }
    choice = by_labels(whole, np.where(chosen, "layer", "bulk"), None, dt, scheme)
    # what contact requires, should the bulk have smaller elements
    bulk, layer = choice.parts
    layer = layer._replace(substeps=max(layer.substeps, bulk.substeps))
    return Choice(choice.labels, [bulk, layer])


def _any_limit(scheme: Any) -> bool:
    schemes = scheme.values() if isinstance(scheme, Mapping) else scheme
    if not isinstance(schemes, Iterable) or hasattr(schemes, "ndim"):  # of arrays
        schemes = [schemes]
    return any(isinstance(s, Scheme) and np.isfinite(critical_product(s)) for s in schemes)


def checked_labels(labels: Any, count: int) -> tuple[list[str], np.ndarray]:
    """Names of the subdomains, and the number of that of each element."""
    given = plain_array(labels, "labels")
    if given.shape != (count,):
        raise ValueError(f"labels must have shape ({count},), one each element, got {given.shape}")
    if given.dtype.kind == "O" and all(isinstance(x, str) for x in given):
        given = given.astype(str)
    if given.dtype.kind == "U":
        names, numbers = np.unique(given, return_inverse=True)
        return names.tolist(), numbers
    if given.dtype.kind not in "iu":
        raise TypeError(f"labels must be whole numbers or names, got dtype {given.dtype}")
    tags, numbers = np.unique(given, return_inverse=True)
    return [f"part {tag}" for tag in tags.tolist()], numbers


def _schemes(scheme: Any, names: Sequence[str]) -> list[Scheme]:
    """The scheme of each subdomain."""
    if scheme is None:
        scheme = GeneralizedAlpha(RHO)
    if isinstance(scheme, Mapping):
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
