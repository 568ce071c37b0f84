"""Checks of the subdomains, constraints and options of a coupler; which steps are double."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Any

from .._checks import listing, whole_number
from ..problem.constraints import Constraint
from ..problem.newton import Newton
from ..problem.subdomain import Subdomain

MOST_SUBSTEPS = 2**31
# With one interface problem in a macro step.
MACRO = ("macro", "mean")


def double_steps(subdomains: Sequence[Subdomain], coupling: str) -> list[bool]:
    """Whether each subdomain takes double steps.

    Raises
    ------
    ValueError
        When all subdomains of the finest step would: odd and even time levels would be two
        unrelated runs.
    """
    if coupling == "gc" or len(subdomains) == 1:
        return [False] * len(subdomains)
    if coupling in MACRO:
        return macro_double_steps(subdomains, coupling)
    fine = finest(subdomains, coupling)
    double = [
        not s.scheme.explicit and s.substeps < fine if s.double_step is None else s.double_step
        for s in subdomains
    ]
    if all(s.substeps == fine and s.double_step is None for s in subdomains):
        implicit = [i for i, s in enumerate(subdomains) if not s.scheme.explicit]
        if implicit:
            double[implicit[0]] = True
    if all(d for s, d in zip(subdomains, double) if s.substeps == fine):
        raise ValueError(
            "double_step must not be True on all subdomains of the finest step, or odd and even "
            f"time levels would be two unrelated runs; got it on all with substeps = {fine}"
        )
    return double


def macro_double_steps(subdomains: Sequence[Subdomain], coupling: str) -> list[bool]:
    """Under macro coupling: the subdomains with double_step=True, which must have one substep."""
    double = [bool(s.double_step) for s in subdomains]
    for i, s in enumerate(subdomains):
        if double[i] and s.substeps > 1:
            raise ValueError(
                "double_step must not be True with more than one substep under "
                f'coupling="{coupling}", '
                f"got substeps = {s.substeps} for {names_of(subdomains)[i]!r}"
            )
    if all(double):
        raise ValueError(
            "double_step must not be True on all subdomains, or odd and even macro steps would be "
            "two unrelated runs"
        )
    return double


def checked_subdomains(subdomains: Any) -> tuple[Subdomain, ...]:
    if isinstance(subdomains, Subdomain):
        raise TypeError("subdomains must be a list of Subdomains, got a single one")
    if not isinstance(subdomains, Iterable):
        raise TypeError(f"subdomains must be a list of Subdomains, got {subdomains!r}")
    subdomains = tuple(subdomains)
    for s in subdomains:
        if not isinstance(s, Subdomain):
            raise TypeError(f"subdomains must be Subdomains, got {s!r}")
    if not subdomains:
        raise ValueError("subdomains must not be empty")
    if len(set(map(id, subdomains))) < len(subdomains):
        raise ValueError("subdomains must be different, got one of them twice")
    return subdomains


def checked_constraints(
    constraints: Any, subdomains: Sequence[Subdomain]
) -> tuple[Constraint, ...]:
    if constraints is None:
        return ()
    if isinstance(constraints, Constraint):
        constraints = (constraints,)
    if not isinstance(constraints, Iterable):
        raise TypeError(f"constraints must be Constraints, got {constraints!r}")
    constraints = tuple(constraints)
    known = set(subdomains)
    for i, c in enumerate(constraints):
        if not isinstance(c, Constraint):
            raise TypeError(f"constraints must be Constraints, got {c!r}")
        unknown = [s for s in c.matrices if s not in known]
        if unknown:
            raise ValueError(f"constraint {i} must hold subdomains of this coupler, got {unknown}")
    return constraints


def check_factorize(value: Any) -> None:
    if value is None or callable(value):
        return
    if not isinstance(value, str):
        raise TypeError(f"factorize must be None, 'superlu' or a callable, got {value!r}")
    if value != "superlu":
        raise ValueError(f"factorize must be None, 'superlu' or a callable, got {value!r}")


def check_newton(value: Any) -> None:
    if not isinstance(value, Newton):
        raise TypeError(f"newton must be a Newton, got {value!r}")


def finest(subdomains: Sequence[Subdomain], coupling: str) -> int:
    """The largest number of substeps; a multiple of all others, except under macro coupling."""
    fine = max(s.substeps for s in subdomains)
    if fine > MOST_SUBSTEPS:
        raise ValueError(f"substeps must be at most {MOST_SUBSTEPS}, got {fine}")
    for s in subdomains:
        if fine % s.substeps and coupling not in MACRO:
            raise ValueError(f"substeps must divide the largest, {fine}, got {s.substeps}")
    return fine


def most_threads(threads: int | None) -> tuple[int, bool]:
    """The maximum number of threads, and whether to use fewer where more are not faster."""
    if threads is not None:
        return whole_number(threads, "threads", low=1), False
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0)), True
    return os.cpu_count() or 1, True


def names_of(subdomains: Sequence[Subdomain]) -> list[str]:
    names = [f"subdomain {i}" if s.name is None else s.name for i, s in enumerate(subdomains)]
    if len(set(names)) < len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise ValueError(f"names of subdomains must be different, got {listing(twice)} twice")
    return names
