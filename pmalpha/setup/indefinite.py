"""Subdomains whose stiffness is indefinite, so that their motion grows by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from .._checks import listing
from ..blas import one_thread
from ..errors import StabilityWarning, warn
from ..problem.matrices import Matrix, dense, diagonal, is_symmetric
from ..problem.subdomain import Subdomain
from .link import Link

# Up to this number of dofs the eigenvalues of dense matrices are computed: some milliseconds.
SMALL = 200
# Up to this number of dofs a subdomain that grows is judged with its ties.
TIED = 400
# A negative eigenvalue of K scaled to a unit diagonal that is not rounding of exported matrices.
NEGATIVE = 1e-6


def warn_of_growing(
    keys: Sequence[tuple[str, Subdomain]], links: Sequence[Link], *, complete: bool
) -> None:
    """StabilityWarning for linear subdomains with indefinite K, and its rate of growth.

    Decided by the eigenvalues up to `SMALL` dofs, beyond by the signs of the minors of order 1 and
    2, which take a pass over the entries: most sign errors. Where the subdomains have up to `TIED`
    dofs together, the structure with its ties decides.

    Parameters
    ----------
    keys : sequence of (name, Subdomain)
    links : sequence of Link
        L_i, independent rows.
    complete : bool
        Whether these are all subdomains, and not those of one process of several.
    """
    found = {name: rate for name, s in keys if (rate := _rate(s)) > 0.0}
    if not found:
        return
    tied = any(L.values.size > 0 for L in links)
    subdomains = [s for _, s in keys]
    fastest, doubt = max(found.values()), ", unless its constraints hold it" if tied else ""
    if tied and complete and all(map(_is_linear, subdomains)):
        if sum(s.n for s in subdomains) <= TIED:
            fastest, doubt = _rate_with_ties(subdomains, links), ""
    if not fastest > 0.0:
        return
    kind = "subdomain" if len(found) == 1 else "subdomains"
    grows = (
        f"grows as exp({fastest:.3g} t), a factor of ten in {np.log(10.0) / fastest:.3g}"
        if np.isfinite(fastest)
        else "grows at once, since no mass resists it"
    )
    warn(
        f"K of {kind} {listing([repr(name) for name in found])} is not positive semidefinite: the "
        f"motion itself {grows}{doubt}; a sign or an entry is wrong, or it is meant to buckle",
        StabilityWarning,
    )


def _is_linear(s: Subdomain) -> bool:
    return s.restoring is None and s.internal is None and is_symmetric(s.K)


def _rate(s: Subdomain) -> float:
    """The rate of growth of a free subdomain, 0 if none; nearly, of many dofs."""
    if s.K is None or s.M is None or not _is_linear(s):
        return 0.0
    if s.n <= SMALL:
        with one_thread():
            return _dense_rate(dense(s.K), dense(s.M))
    x = _negative_direction(s.K)
    return 0.0 if x is None else _quotient(x, s.K, s.M)


def _quotient(x: sp.csr_array, K: Matrix, M: Matrix) -> float:
    """The rate of growth in the direction x (n, 1)."""
    k, m = (float((x.T @ (_sparse(A) @ x)).toarray()[0, 0]) for A in (K, M))
    return float(np.sqrt(-k / m)) if m > 0.0 else np.inf


def _sparse(A: Matrix) -> sp.csr_array:
    return sp.csr_array(sp.diags_array(A) if A.ndim == 1 else A)


def _negative_direction(K: Matrix) -> sp.csr_array | None:
    """A vector (n, 1) of at most two entries with x . K x < 0, or None where there is none."""
    from scipy.linalg import eigh

    d, n = diagonal(K), K.shape[0]
    i = int(np.argmin(d))
    if d[i] < 0.0:
        return sp.csr_array(([1.0], ([i], [0])), shape=(n, 1))
    if K.ndim == 1:
        return None
    A = sp.coo_array(K)
    excess = np.abs(A.data) - (1.0 + NEGATIVE) * np.sqrt(d[A.row] * d[A.col])
    if not excess.size or not excess.max() > NEGATIVE * d.max():
        return None
    k = int(np.argmax(excess))
    i, j = A.row[k], A.col[k]
    # the eigenvector of the block of i and j
    block = np.array([[d[i], A.data[k]], [A.data[k], d[j]]])
    return sp.csr_array((eigh(block)[1][:, 0], ([i, j], [0, 0])), shape=(n, 1))


def _dense_rate(K: np.ndarray, M: np.ndarray) -> float:
    """sqrt(-omega^2) of the lowest omega^2; inf without mass in its way, 0 where none grows."""
    from scipy.linalg import eigh

    size = np.abs(np.diag(K))
    size = np.where(size > 0.0, size, np.max(np.abs(K), axis=1))
    root = 1.0 / np.sqrt(np.where(size > 0.0, size, 1.0))
    values, x = eigh(root[:, None] * K * root, subset_by_index=[0, 0])
    if values[0] > -NEGATIVE:
        return 0.0
    try:
        lowest = eigh(K, M, eigvals_only=True, subset_by_index=[0, 0])[0]
    except np.linalg.LinAlgError:  # dofs without mass
        y = root * x[:, 0]
        m = y @ M @ y
        return float(np.sqrt(-(y @ K @ y) / m)) if m > 0.0 else np.inf
    return float(np.sqrt(max(-lowest, 0.0)))


def _rate_with_ties(subdomains: Sequence[Subdomain], links: Sequence[Link]) -> float:
    """The rate of growth of the structure, with the displacements that its constraints allow."""
    from scipy.linalg import null_space

    rows = np.hstack([L.matrix.toarray() for L in links])
    K, M = (
        sp.block_diag([np.diag(A) if A.ndim == 1 else A for A in each]).toarray()
        for each in (
            [np.zeros(s.n) if s.K is None else s.K for s in subdomains],
            [np.zeros(s.n) if s.M is None else s.M for s in subdomains],
        )
    )
    with one_thread():
        Z = null_space(rows)
        return _dense_rate(Z.T @ K @ Z, Z.T @ M @ Z) if Z.shape[1] else 0.0
