"""Set-up of a `Coupler`, step by step as in the table of docs/architecture.md."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from .. import _core
from ..problem.newton import Newton
from ..problem.subdomain import Subdomain
from .factors import Factor
from .interface import interface_factor, interface_matrix, row_order
from .iteration import iteration_of, prepare_iterated
from .loose import warn_of_loose
from .macro import prepare, warn_of_resonance
from .mean import check_mean, doubled_part, mass_of_interface, prepare_mean
from .part import Part, build, make_part, warn_of_factors, warn_of_order
from .stability import step_ratio, warn_of_steps
from .start import InitialAccelerations


@dataclass(frozen=True)
class Assembly:
    """A coupled problem before its initial values are set.

    Attributes
    ----------
    parts : tuple of Part
        The subdomains in elimination order, each with its object of the core.
    row_position : (p,) array of int
        Position of each constraint in the core's order.
    accelerations : InitialAccelerations
    core : the coupler of the core
    """

    parts: tuple[Part, ...]
    row_position: np.ndarray
    accelerations: InitialAccelerations
    core: Any


def assemble(
    keys: Sequence[tuple[str, Subdomain]],
    matrices: Sequence[sp.csc_array],
    doubles: Sequence[bool],
    prescribed: Sequence[np.ndarray],
    *,
    dt: float,
    coupling: str,
    start: str,
    newton: Newton,
    threads: tuple[int, bool],
    factorize: Any,
) -> Assembly:
    """Order, factor and couple subdomains.

    Parameters
    ----------
    keys : sequence of (name, Subdomain)
    matrices : sequence of (p, n_i) csc_array
        L_i, independent rows, in the user's order.
    doubles : sequence of bool
        Which subdomains take double steps.
    prescribed : sequence of arrays of int
        The rows of each prescribed velocity.
    dt, coupling, start, newton, factorize
        As for `Coupler`.
    threads : (int, bool)
        Maximum number of threads, and whether to use fewer where more are not faster.
    """
    macro, mean, superlu = coupling == "macro", coupling == "mean", factorize == "superlu"
    p = matrices[0].shape[0]
    warn_of_loose(keys, matrices)

    # elimination order of each subdomain, and of the rows
    parts = _ordered(keys, matrices, doubles, dt, coupling, newton, factorize)
    if mean:
        check_mean(parts)
    _check_factorize(parts, factorize)
    _check_start(parts, start, coupling)
    rows = row_order(parts, p)
    position = np.argsort(rows)

    # Mbar = R D R^T
    for part in parts:
        part.reorder(position)
        build(part, mass_of_interface(part) if mean else None)
    if macro:
        prepare(parts)  # unit responses
    if mean:
        prepare_mean(parts)
    prepare_iterated(parts, macro)  # and their part of H, with internal forces

    # H = sum_i al2_i L_i Mbar_i^-1 L_i^T, and its factor
    H, H_start = _interface_factors(parts, rows, position, superlu, macro)
    iteration = iteration_of(parts, p, newton, macro)
    doubled = (doubled_part(parts, p),) if mean else ()
    for part in parts:
        part.blocks.clear()

    # M = R D R^T, for the initial accelerations
    accelerations = InitialAccelerations(parts, p, rows)

    motions = tuple(position[r] for r in prescribed)
    cores = tuple(part.core for part in parts)
    core = _core.Coupler(
        cores, p, H_start, H, dt, start == "rebased", motions, *threads, macro, iteration, *doubled
    )

    # explicit steps above the critical step
    for part in parts:
        internal = None if part.internal is None else part.internal.K
        part.step_ratio = step_ratio(part.subdomain, part.step, internal)
    warn_of_steps((part.name, part.subdomain, part.step, part.step_ratio) for part in parts)
    return Assembly(parts, position, accelerations, core)


def _check_start(parts: Sequence[Part], start: str, coupling: str) -> None:
    """ValueError for the plain start of iterated double steps, for which it is not defined."""
    double = [part.name for part in parts if part.tangent is not None and part.double]
    if double and start == "plain" and coupling == "pm":
        raise ValueError(
            'start must be "rebased" with internal forces in subdomains with double steps, got '
            f'"plain" and {", ".join(map(repr, double))}'
        )


def _check_factorize(parts: Sequence[Part], factorize: Any) -> None:
    """ValueError for another factorization where the core factors tangents."""
    iterated = [part.name for part in parts if part.tangent is not None]
    if iterated and factorize is not None:
        raise ValueError(
            "factorize must be None with internal forces in implicit subdomains, whose tangents "
            f"the core factors itself, got {factorize!r} and internal forces in "
            f"{', '.join(map(repr, iterated))}"
        )


def _ordered(
    keys: Sequence[tuple[str, Subdomain]],
    matrices: Sequence[sp.csc_array],
    doubles: Sequence[bool],
    dt: float,
    coupling: str,
    newton: Newton,
    factorize: Any,
) -> tuple[Part, ...]:
    """The subdomains in elimination order, with warnings of factors that are large."""
    parts = tuple(
        make_part(
            s,
            name,
            double,
            dt / s.substeps,
            L,
            factorize,
            responds=coupling == "mean" or (coupling == "macro" and s.substeps > 1),
            mean=coupling == "mean",
            reuses=newton.tangent == "reuse",
        )
        for (name, s), L, double in zip(keys, matrices, doubles)
    )
    warn_of_factors(parts)
    warn_of_order(parts)
    return parts


def _interface_factors(
    parts: Sequence[Part], rows: np.ndarray, position: np.ndarray, superlu: bool, macro: bool
) -> tuple[Factor, Factor]:
    """The factor of H, and that of the first macro step, where all subdomains take single steps.

    With internal forces, macro coupling begins with those of the tangents at t = 0; pm and gc make
    their own, and get unit matrices.
    """
    if not macro and any(part.tangent is not None for part in parts):
        unit = (np.ones(rows.size), None)
        return unit, unit
    matrix = interface_matrix(parts, rows.size, start=False)
    H = interface_factor(matrix, rows, superlu=superlu)
    if macro:
        warn_of_resonance(matrix, H, parts, position)
    H_start = H
    if any(part.double for part in parts):
        matrix = interface_matrix(parts, rows.size, start=True)
        H_start = interface_factor(matrix, rows, superlu=superlu)
    return H, H_start
