"""Warnings of subdomains that the constraints do not reach or do not hold."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import counted, listing
from ..errors import ConstraintWarning, warn
from ..problem.matrices import is_symmetric
from ..problem.positive import FLOATING, scales_to_one, softest
from ..problem.subdomain import Subdomain
from .link import Link
from .rank import rows_of_size_one

# Dofs of a node for which translations are tried: a translation moves every d-th dof by one.
DOFS_OF_A_NODE = (6, 3, 2, 1)
# Force of a translation relative to that of its single entries: the digits of exported matrices.
ROUNDING = 1e-9
# Up to this number of dofs a sparse matrix takes more time than the same one dense.
SMALL = 200
# A translation is tried on this number of rows before it is tried on all of them.
SAMPLE = 64
# Largest number of entries of K + L^T L that is factored only for a warning: some hundredths of a
# second.
MOST = 100_000


def warn_of_loose(
    keys: Sequence[tuple[str, Subdomain]], links: Sequence[Link], contacts: Container[int] = ()
) -> None:
    """ConstraintWarning for subdomains beside others without a constraint, and for loose ones.

    A subdomain is loose if it is floating and a rigid-body motion satisfies its constraints.
    Translations are found for any size; rotations where K + L^T L has up to `MOST` entries, and
    only of subdomains that no support holds against translation. Subdomains with a restoring
    function without `restoring_stiffness` are left out, since their stiffness is not known, as are
    those without any stiffness: single masses.

    Parameters
    ----------
    keys : sequence of (name, Subdomain)
    links : sequence of Link
        L_i, independent rows.
    contacts : container of int
        Subdomains that have contacts, which may be loose.
    """
    reached = [L.values.size > 0 for L in links]
    alone = [not found and i not in contacts for i, found in enumerate(reached)]
    if len(keys) > 1 and any(alone):
        names = [repr(name) for (name, _), found in zip(keys, alone) if found]
        warn(
            f"no constraint reaches {'subdomain' if len(names) == 1 else 'subdomains'} "
            f"{listing(names)}: no force is exchanged with the others; a `tie` is missing, or the "
            "subdomain can be run alone by `solve`",
            ConstraintWarning,
        )
    loose = {}
    for i, ((name, s), L, found) in enumerate(zip(keys, links, reached)):
        if found and i not in contacts and _is_loose(s, L):
            loose[name] = counted(L.rows.size, "constraint")
    if len(loose) == 1:
        ((name, count),) = loose.items()
        verb = "does" if count.startswith("1 ") else "do"
        text = f"subdomain {name!r} is floating, and its {count} {verb} not hold it: it can move"
    elif loose:
        each = [f"{name!r} ({count})" for name, count in loose.items()]
        text = (
            f"subdomains {listing(each)} are floating, and their constraints do not hold them: "
            "each can move"
        )
    else:
        return
    warn(
        f"{text} as a rigid body while all constraints are satisfied; further dofs are to be "
        "tied, or a support is missing in K",
        ConstraintWarning,
    )


def _is_loose(s: Subdomain, L: Link) -> bool:
    """Whether a rigid-body motion satisfies the constraints."""
    if s.has_unknown_stiffness or s.has_feedback:  # which may hold it
        return False
    K = s.largest_tangent
    if K is None:
        return False
    if K.ndim == 1:
        return bool(np.any((K == 0.0) & (np.diff(L.ptr) == 0)))
    if not isinstance(K, np.ndarray) and s.n <= SMALL:
        K = K.toarray()
    translations = _translations(K, s.n)
    if not translations.shape[1]:
        return False
    entries = K.size if isinstance(K, np.ndarray) else K.nnz
    entries += float(np.sum(np.bincount(L.local).astype(float) ** 2))
    own = L.dense() if isinstance(K, np.ndarray) and entries <= MOST else L.own()
    if np.linalg.matrix_rank(_rows_of_size_one(own) @ translations) < translations.shape[1]:
        return True
    return entries <= MOST and _is_singular(K, own)


def _rows_of_size_one(L: np.ndarray | sp.csr_array) -> np.ndarray | sp.csr_array:
    if isinstance(L, np.ndarray):
        return L / np.max(np.abs(L), axis=1, keepdims=True)
    return rows_of_size_one(L)


def _translations(K: Any, n: int) -> np.ndarray:
    """(n, t): translations without force in K, for the dofs per node with the largest number."""
    best, size = np.empty((n, 0)), abs(K)
    tried = [(K, size)] if n <= SAMPLE else [(K[:SAMPLE], size[:SAMPLE]), (K, size)]
    for d in DOFS_OF_A_NODE:
        if n % d or d <= best.shape[1]:
            continue
        found = np.tile(np.eye(d), (n // d, 1))
        for rows in tried:
            found = found[:, _are_free(*rows, found)] if found.shape[1] else found
        best = found if found.shape[1] > best.shape[1] else best
    return best


def _are_free(K: Any, size: Any, x: np.ndarray) -> np.ndarray:
    """Whether K x is rounding for each column of x, in rows of K; `size` is |K|."""
    result: np.ndarray = np.all(np.abs(K @ x) <= ROUNDING * (size @ x), axis=0)
    return result


def _is_singular(K: Any, L: np.ndarray | sp.csr_array) -> bool:
    """Whether K + L^T L, the constraints replaced by springs, has a motion without stiffness."""
    scale = scales_to_one(K.diagonal())
    if isinstance(K, np.ndarray) and is_symmetric(K):
        springs = _rows_of_size_one(L * scale)
        return bool(softest(scale[:, None] * K * scale + springs.T @ springs) <= FLOATING)
    by = sp.diags_array(scale)
    springs = rows_of_size_one(sp.csr_array(sp.csr_array(L) @ by))
    G = sp.csc_array(by @ sp.csc_array(K) @ by + springs.T @ springs)
    return bool(softest(G) <= FLOATING)
