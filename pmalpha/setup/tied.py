"""Set-up of `drift="removed"`: displacements tied at macro time levels under gc, (V1) to (V5).

The second multipliers need one more matrix, S_mu of (V4), which is factored once. It is the matrix
of the interface compliances where all subdomains have the same alpha_1 / alpha_2; elsewhere the
shifts change velocities, and S_mu is not symmetric.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from .._checks import counted, listing
from ..blas import one_thread
from ..errors import FactorizationError
from ..memory import require
from ..problem.matrices import Matrix, core_sparse, dense, sparse
from ..problem.schemes import Scheme, explicit_rho
from ..reduction.eigenmodes import scales_to_one
from .constraint_rows import row_sizes
from .factors import LOST
from .interface import interface_matrix, is_symmetric_sum, summed
from .link import Block
from .macro import RATE, warn_of_work
from .member import Member
from .ranks import Ranks, joined

# The largest spectral radius at infinity of implicit schemes beside any explicit scheme, and the
# range of rho in which explicit and implicit schemes were stable together.
MOST_BESIDE, LEAST_ALIKE, MOST_ALIKE = 0.5, 0.3, 0.8
# The same of implicit schemes without explicit ones.
MOST_ALONE = 0.9
# Of a coupling that grows with other schemes.
UNSTABLE = (
    'drift="removed" is unstable with these schemes and steps; coupling="mean" has no drift '
    "without it"
)

# Entries between two checks for Ctrl-C.
BLOCK = 5e7
# Of a spectral radius, a triple eigenvalue.
ROUNDING = 1e-4
# Bytes for each entry of two dense triangles while they are made and copied for the core.
TRIANGLE_BYTES = 40


def check_tied(members: Sequence[Member]) -> None:
    """ValueError for internal forces, which are evaluated before or iterated with the predictor."""
    internal = [member.name for member in members if member.subdomain.internal is not None]
    if internal:
        raise ValueError(
            'drift must be "kept" with internal forces, whose equilibrium the shift of the '
            'predictor would leave, got drift="removed" and internal forces in '
            f"{', '.join(map(repr, internal))}"
        )


class _Stepped(NamedTuple):
    """How a subdomain, possibly of another process, is stepped."""

    name: str
    scheme: Scheme
    substeps: int


def doubts_of_schemes(members: Sequence[Member], ranks: Ranks | None = None) -> list[str]:
    """Why steps can grow, for schemes with which some were found to; docs/couplings.md."""
    own = [_Stepped(member.name, member.subdomain.scheme, member.substeps) for member in members]
    everything = joined(ranks, own)
    substeps = {s.substeps for s in everything}
    explicit = [s for s in everything if s.scheme.explicit]
    coarse = [s for s in explicit if s.substeps < max(substeps)]
    rhos = [explicit_rho(s.scheme) for s in explicit]
    alike = all(LEAST_ALIKE <= rho <= MOST_ALIKE for rho in rhos)
    beside = MOST_ALIKE if alike else MOST_BESIDE
    most = ROUNDING + (beside if explicit else MOST_ALONE)
    undamped = [
        s for s in everything if not s.scheme.explicit and s.scheme.radius_at_infinity() > most
    ]
    if coarse:
        return [_doubt("explicit subdomains with fewer substeps than others", coarse)]
    if explicit and undamped:
        what = "implicit subdomains with little or no algorithmic damping and explicit ones"
        return [_doubt(what, undamped, f"; rho <= {MOST_BESIDE:g} is safe there")]
    if len(undamped) > 1 and len(substeps) > 1:
        what = "several subdomains without algorithmic damping and with different substeps"
        return [_doubt(what, undamped, f"; rho <= {MOST_ALONE:g} in all but one of them is safe")]
    return []


def _doubt(what: str, subdomains: Sequence[_Stepped], advice: str = "") -> str:
    names = listing([repr(s.name) for s in subdomains])
    return (
        f'drift="removed" can be unstable with {what} ({names}){advice}; coupling="mean" has no '
        "drift without it"
    )


def displacement_factors(
    members: Sequence[Member], p: int, ranks: Ranks | None = None
) -> tuple[Any, ...]:
    """The factors L U of S_mu, equation (V4), for the core.

    members: with their factors and objects of the core, single steps.
    """
    if p == 0:
        return lu_factors(np.empty(0), 0)
    found = [
        (*member.subdomain.scheme.coefficients(member.h), member.block(False)) for member in members
    ]
    *scheme, blocks = zip(*joined(ranks, found))
    al1, al2 = map(np.array, scheme)
    G = [block.times(1.0 / a) for block, a in zip(blocks, al2)]  # L Y
    if np.ptp(al1 / al2) <= 4.0 * np.finfo(float).eps * np.max(al1 / al2):
        return lu_factors(summed(G, p), p)
    check_work(members)
    symmetric = is_symmetric_sum(members, ranks)
    N = joined(ranks, [shifts(member) for member in members])  # L Z
    H = interface_matrix(members, p, start=False, ranks=ranks)
    A = summed([g.times(a) for g, a in zip(G, al1)], p)
    B = summed([n.times(a) for n, a in zip(N, al2)], p)
    D = summed([*G, *(n.times(-a) for n, a in zip(N, al1))], p)
    if H.ndim == 1:  # A too
        return lu_factors(sp.csr_array(sparse(D, p) + sp.diags_array(A / H) @ sparse(B, p)), p)
    if sp.issparse(H):
        return lu_factors(sp.block_array([[H, -sparse(B, p)], [sparse(A, p), sparse(D, p)]]), p)
    require(6.0 * 8.0 * p**2, f"the displacement constraints of {counted(p, 'constraint')}")
    with one_thread():
        S = dense(D) + dense(A) @ _solution(H, dense(B), symmetric)
    return lu_factors(S, p)


def _solution(H: np.ndarray, B: np.ndarray, symmetric: bool) -> np.ndarray:
    """H^-1 B. Compliances of light and of heavy dofs are brought to one size, by powers of two."""
    from scipy.linalg import solve as dense_solution

    s = scales_to_one(np.diagonal(H))[:, None]
    result: np.ndarray = s * dense_solution(
        s * H * s.T, s * B, assume_a="pos" if symmetric else "gen"
    )
    return result


def check_work(members: Sequence[Member]) -> None:
    """PerformanceWarning when the shifts take long, ValueError for more than a day."""
    works = {
        member.name: float(member.core.entries) * member.L.rows.size
        for member in members
        if not member.is_diagonal
    }
    remedy = 'take drift="kept", or schemes and steps with one beta h / gamma'
    why = "two sweeps for each of its constraints"
    warn_of_work(works, RATE, 'drift="removed"', why, remedy)


def shifts(member: Member) -> Block:
    """L Z = L Mbar^-1 (K + K_r) Mbar^-1 L^T on the constraints of a subdomain."""
    if member.is_diagonal:
        rows = member.L.rows
        Y = sp.csr_array(member.L.own() @ sp.diags_array(1.0 / member.mbar(member.h))).T
        N = sp.csr_array((rows.size, rows.size))
        for K in (member.K, member.K_r):
            if K is not None:
                N = N + Y.T @ ((K if K.ndim == 2 else sp.diags_array(K)) @ Y)
        if not sp.issparse(N):
            return Block(rows, np.asarray(N))
        N = sp.coo_array(N)
        return Block(rows, N.data, (N.row, N.col))
    rows = member.L.rows
    k = rows.size
    require(16.0 * k**2, f"the shifts of {member.name!r} by {counted(k, 'constraint')}")
    out = np.empty((k, k))
    columns = max(1, int(BLOCK // member.core.entries))
    for begin in range(0, k, columns):  # Ctrl-C between
        member.core.shift_block(rows, begin, out[begin : min(begin + columns, k)])
    if not member.symmetric:
        return Block(rows, np.ascontiguousarray(out.T))  # row k of out is column k of L Z
    return Block(rows, 0.5 * (out + out.T))


def lu_factors(A: Matrix, p: int) -> tuple[Any, ...]:
    """Factors of a matrix, of whose unknowns the last p are wanted, in the form of the core."""
    n = A.shape[0]
    if A.ndim == 1:
        none = sp.csc_array((n, n))
        diagonal, lower, upper, row, column = A, none, none, np.arange(n), np.arange(n)
    elif sp.issparse(A):
        diagonal, lower, upper, row, column = _sparse_factors(sp.csc_array(A))
    else:
        diagonal, lower, upper, row, column = _dense_factors(A)
    sizes = np.empty(n)  # of the rows, at the places where they are eliminated
    sizes[row] = _row_sizes(A)
    if not np.all(np.abs(diagonal) > LOST * sizes):
        raise singular()
    wanted = slice(n - p, n)
    places = (x[wanted].astype(np.int32) for x in (row, column))
    return (1.0 / diagonal, core_sparse(lower), core_sparse(upper), *places)


def _row_sizes(A: Matrix) -> np.ndarray:
    """The largest entry of each row: those of rows on light and on heavy dofs are far apart."""
    if A.ndim == 1:
        return np.abs(A)
    return row_sizes(sp.csr_array(A)) if sp.issparse(A) else np.max(np.abs(A), axis=1)


def _sparse_factors(A: sp.csc_array) -> tuple[Any, ...]:
    from scipy.sparse.linalg import splu

    try:
        with one_thread():
            factors = splu(A)
    except RuntimeError:  # exactly singular
        raise singular() from None
    L, U = sp.csc_array(factors.L), sp.csc_array(factors.U)
    strict = sp.csc_array(sp.tril(L, -1)), sp.csc_array(sp.triu(U, 1))
    return U.diagonal(), *strict, factors.perm_r, factors.perm_c


def _dense_factors(A: np.ndarray) -> tuple[Any, ...]:
    from scipy.linalg.lapack import dgetrf

    n = len(A)
    require(
        TRIANGLE_BYTES * n * float(n), f"the factors of {counted(n, 'displacement constraint')}"
    )
    with one_thread():
        LU, pivots, _ = dgetrf(A)
    row_at = np.arange(n)  # the row that is eliminated at each place
    for k, other in enumerate(pivots):
        row_at[[k, other]] = row_at[[other, k]]
    strict = sp.csc_array(np.tril(LU, -1)), sp.csc_array(np.triu(LU, 1))
    return np.diagonal(LU), *strict, np.argsort(row_at), np.arange(n)


def singular() -> FactorizationError:
    return FactorizationError(
        "the matrix S_mu of the displacement constraints (V4) is singular; another dt, or "
        'drift="kept"'
    )
