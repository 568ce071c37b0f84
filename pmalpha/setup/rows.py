"""The stacked constraints of a coupler, sum_i L_i v_i = g(t): their rank and form in the core."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from .._cached import cached_property
from .._checks import counted, listing, numbered
from ..errors import ConstraintError, ConstraintWarning, warn
from ..memory import require
from ..problem.matrices import Matrix, row_of_entries, sparse
from ..problem.subdomain import Subdomain
from .contact_rows import Contacts
from .link import Link
from .ranks import Ranks, joined
from .schedule import Rows

# Below this squared distance of a row from the others its group of rows is factored once more.
SUSPICIOUS = 1e-6
# Largest number of connected rows that are factored as a dense matrix; there, a row at a distance
# below DEPENDENT from the others is dependent.
FEW, DEPENDENT = 1500, 1e-9
# Up to this number of entries all rows are: sparse matrices take longer.
AT_ONCE = 100
# Tolerance of the initial velocities in a constraint, relative to its terms: the rounding of
# velocities that were computed.
ROUNDING = 1e-9
# The largest number of a row, at least: its multiplier is the force divided by it.
TINY = 1e-300
# The same relative to the largest velocity anywhere, for the end of a pulse that only rounding
# carries to an interface.
FAR = 1e-13


def require_sizes(sizes: np.ndarray, name: Callable[[int], str]) -> None:
    """ConstraintError for a row whose multiplier would not be finite, by the largest entries."""
    row = int(np.argmin(sizes))
    if 0.0 < sizes[row] < TINY:
        raise ConstraintError(
            f"the largest number of a constraint must be at least {TINY:g}, got {sizes[row]:g} in "
            f"row {name(row)}; a multiple of a constraint is the same one"
        )


def require_independent(L: sp.csr_array, name: Callable[[int], str]) -> None:
    """ConstraintError unless L has full row rank, determined from L alone with rows of length 1.

    `name` returns the name of a row in messages.
    """
    p = L.shape[0]
    unit = rows_of_size_one(L)
    shared = np.bincount(L.indices, minlength=L.shape[1]).astype(float)
    require(16.0 * np.sum(shared**2), f"the rank of {p} constraints that share dofs")
    rows = row_of_entries(unit)
    unit.data /= np.sqrt(np.bincount(rows, unit.data**2))[rows]
    dependent = _dependent_rows(unit)
    if not dependent.size:
        return
    row = int(dependent[0])
    terms = _combination(unit, np.setdiff1d(np.arange(p), dependent), row)
    raise ConstraintError(
        f"the constraints must be linearly independent: row {name(row)} is a combination of "
        f"row{'s' * (terms.size > 1)} {listing([name(int(r)) for r in terms], 10)}; "
        f"{dependent.size} of {counted(p, 'row')} "
        f"{'is' if dependent.size == 1 else 'are'} redundant and must be removed"
    )


def _dependent_rows(unit: sp.csr_array) -> np.ndarray:
    """Rows to remove so that the others are independent.

    The pivots of L L^T are the squared distances of a row from those eliminated before it: zero
    for a dependent row, at least about 2 / p for the ties of p + 1 dofs in a tree. A shift far
    below lets the factorization continue past a zero pivot. Connected rows with a small pivot, or
    with constraints that are not ties, then get a QR factorization where they are few enough.
    """
    from scipy.sparse.csgraph import connected_components
    from scipy.sparse.linalg import splu

    p = unit.shape[0]
    if unit.nnz <= AT_ONCE:
        return np.sort(_dependent_of_few(unit))
    shift, threshold = 1e-14, 1e-13 * (p + 100)
    gram = sp.csc_array(unit @ unit.T) + shift * sp.eye_array(p, format="csc")
    lu = splu(
        gram, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=dict(SymmetricMode=True)
    )
    pivots = lu.U.diagonal()[lu.perm_c]
    count, group = connected_components(gram, directed=False)
    sizes = np.bincount(group)
    closer = (pivots <= SUSPICIOUS) | (~_is_tie(unit) & (sizes[group] > 1))
    dependent = [np.flatnonzero((pivots <= threshold) & (sizes[group] > FEW))]
    order = np.argsort(group, kind="stable")
    members = np.split(order, np.cumsum(sizes)[:-1])
    for g in np.unique(group[closer]):
        if sizes[g] <= FEW:
            dependent.append(members[g][_dependent_of_few(unit[members[g]])])
    return np.sort(np.concatenate(dependent))


def _is_tie(unit: sp.csr_array) -> np.ndarray:
    """Rows of one entry, or of two of the same size: the bound of the pivots holds for them."""
    entries = np.diff(unit.indptr)
    result: np.ndarray = (entries == 1) | ((entries == 2) & (row_sizes(unit) <= 0.71))
    return result


def _dependent_of_few(unit: sp.csr_array) -> np.ndarray:
    """Dependent rows by a rank-revealing QR factorization with pivoting."""
    from scipy.linalg import qr

    touched, place = np.unique(unit.indices, return_inverse=True)
    columns = np.zeros((touched.size, unit.shape[0]))
    columns[place.reshape(-1), row_of_entries(unit)] = unit.data
    R, order = qr(columns, mode="r", pivoting=True)
    rank = int(np.sum(np.abs(np.diagonal(R)) > DEPENDENT))
    result: np.ndarray = order[rank:]
    return result


def row_sizes(L: sp.csr_array) -> np.ndarray:
    """The largest entry of each row, (p,)."""
    sizes = np.zeros(L.shape[0])
    np.maximum.at(sizes, row_of_entries(L), np.abs(L.data))
    return sizes


def rows_of_size_one(L: sp.csr_array) -> sp.csr_array:
    """L with each row divided by its largest entry: a multiple of a constraint is the same one."""
    scale = 1.0 / row_sizes(L)
    return sp.csr_array((scale[row_of_entries(L)] * L.data, L.indices, L.indptr), shape=L.shape)


def _combination(unit: sp.csr_array, independent: np.ndarray, row: int) -> np.ndarray:
    """The independent rows whose combination is the dependent row."""
    from scipy.sparse.linalg import splu

    block = unit[independent]
    gram = sp.csc_array(block @ block.T)
    weights = splu(gram).solve((block @ unit[[row]].T).toarray()[:, 0])
    result: np.ndarray = independent[np.abs(weights) > 1e-6]
    return result


class CoreRows:
    """Positions and scales of the user's constraints in the core, for results and given values.

    A multiple of a constraint is the same constraint, but pivots are compared with each other, and
    Broyden's method compares multipliers. So each row is divided by the power of two below its
    largest entry, which leaves all digits as they are; rows of ties keep their entries of 1 and -1.

    With L = s * (row of the core), a jump is s times that of the core, and a multiplier is that of
    the core divided by s.

    position: (p,) array of int, position of each constraint in the core's order.
    scale: (p,) array, s of each constraint.
    """

    def __init__(self, position: np.ndarray, scale: np.ndarray, contacts: Contacts | None = None):
        self.position, self.scale, self.contacts = position, scale, contacts
        self._in_order = np.array_equal(position, np.arange(position.size))
        self._of_size_one = bool(np.all(scale == 1.0))

    @property
    def p(self) -> int:
        return self.position.size

    @cached_property
    def numbers(self) -> np.ndarray:
        """The user's number of each constraint, in the core's order."""
        return np.argsort(self.position)

    def forces(self, lam: np.ndarray) -> np.ndarray:
        """Multipliers of the core, (..., p), as the user's."""
        return self._divided(self._in_users_order(lam))

    def jumps(self, x: np.ndarray) -> np.ndarray:
        """Jumps or prescribed velocities of the core, (..., p), as the user's."""
        x = self._in_users_order(x)
        return x if self._of_size_one else x * self.scale

    def forces_in_core(self, lam: np.ndarray) -> np.ndarray:
        """Multipliers of the user's, (..., p), as the core has them."""
        lam = lam if self._of_size_one else lam * self.scale
        return lam[..., self.numbers]

    def jumps_in_core(self, x: np.ndarray) -> np.ndarray:
        """Jumps or prescribed velocities of the user's, (..., p), as the core has them."""
        return self._divided(x)[..., self.numbers]

    def _in_users_order(self, x: np.ndarray) -> np.ndarray:
        return x if self._in_order else x[..., self.position]

    def _divided(self, x: np.ndarray) -> np.ndarray:
        return x if self._of_size_one else x / self.scale


class ConstraintRows:
    """The stacked constraints of a coupler, equation (2), in the user's order of rows and dofs.

    subdomains: of all processes.
    part: those of this process. Default: all.
    scale: (p,) array, what each row is divided by for the core.
    of_constraints: numbers of rows of each constraint.
    links: L_i of every subdomain of this process, with the rows divided by `scale`.
    matrices: list of (p, n_i) csc_array, L_i as given, for products.
    """

    def __init__(
        self,
        constraints: Sequence[Rows],
        subdomains: Sequence[Subdomain],
        part: slice = slice(None),
        ranks: Ranks | None = None,
        contacts: Contacts | None = None,
    ):
        self.ranks, self.contacts = ranks, contacts
        self.of_constraints = tuple(int(c.p) for c in constraints)
        self.starts = np.cumsum([0, *self.of_constraints])
        self.p = int(self.starts[-1])
        begins = np.cumsum([0] + [s.n for s in subdomains])
        stacked = self._stacked(constraints, begins)
        self._sizes = np.zeros(self.p)
        np.maximum.at(self._sizes, stacked.index, np.abs(stacked.values))
        if constraints:
            require_sizes(self._sizes, self.name)
            if stacked.shares_dofs:
                require_independent(sp.csr_array(stacked.matrix), self.name)
        self.scale = np.ldexp(1.0, np.frexp(self._sizes)[1] - 1)  # powers of two at or below them
        blocks = [*zip(begins.tolist(), begins[1:].tolist())][part]
        scaled = stacked.with_rows_divided(self.scale)
        self._given = [stacked.of_dofs(i, j) for i, j in blocks]
        self.links = self._given
        if scaled is not stacked:
            self.links = [scaled.of_dofs(i, j) for i, j in blocks]

    def _stacked(self, constraints: Sequence[Rows], begins: np.ndarray) -> Link:
        """(L_1, L_2, ...), whose columns begin at `begins`."""
        pieces = [
            (L, first, begins[i])
            for c, first in zip(constraints, self.starts)
            for i, L in c.matrices.items()
        ]
        if not pieces:
            return Link.empty(int(begins[-1]))
        values = np.concatenate([L.data for L, _, _ in pieces])
        rows = np.concatenate([_rows(L) + first for L, first, _ in pieces])
        columns = np.concatenate([L.indices + begin for L, _, begin in pieces])
        return Link.of_entries(self.p, int(begins[-1]), values, rows, columns)

    @cached_property
    def matrices(self) -> list[sp.csc_array]:
        return [link.matrix for link in self._given]

    @property
    def scaled(self) -> list[sp.csc_array]:
        return [link.matrix for link in self.links]

    def of(self, i: int) -> np.ndarray:
        return np.arange(self.starts[i], self.starts[i + 1])

    def name(self, row: int) -> str:
        """The name of a row in messages."""
        if len(self.starts) <= 2:
            return str(row)
        c = int(np.searchsorted(self.starts, row, side="right")) - 1
        return f"{row} (row {row - self.starts[c]} of constraint {c})"

    def check_velocities(
        self,
        velocities: Sequence[np.ndarray],
        g: np.ndarray,
        later: Callable[[], np.ndarray] | None = None,
    ) -> None:
        """ConstraintError unless sum L_i v_i = g at t = 0.

        later: returns the largest |g| (p,) of later times: what is rounding of them is allowed too.
        """
        rows, amounts = self._violated(velocities, g)
        if rows.size and later is not None:
            counts = np.abs(amounts) > ROUNDING * later()[rows]
            rows, amounts = rows[counts], amounts[counts]
        if rows.size:
            raise ConstraintError(
                "the initial velocities v0 must satisfy the constraints, violated in "
                f"{self._listed(rows, amounts, ' by')}"
            )

    @cached_property
    def held(self) -> np.ndarray:
        """(p,) array of bool: rows of one dof alone, which leave no gap where it is displaced."""
        rows = joined(self.ranks, [link.index for link in self._given])
        counts = np.bincount(np.concatenate([np.empty(0, np.int32), *rows]), minlength=self.p)
        result: np.ndarray = counts == 1
        return result

    def warn_of_displacements(self, displacements: Sequence[np.ndarray]) -> None:
        """ConstraintWarning unless sum L_i u_i = 0 at t = 0, or the row is held."""
        if violated := self._gaps(displacements, self.held):
            warn(
                "the initial displacements u0 violate constraints; velocity constraints will not "
                f"close the gaps in {violated}",
                ConstraintWarning,
            )

    def check_displacements(
        self, displacements: Sequence[np.ndarray], driven: Sequence[np.ndarray]
    ) -> None:
        """ConstraintError unless sum L_i u_i = 0 at t = 0, or the row is held.

        driven: rows with a prescribed velocity, which begin at the displacement that they have.
        """
        relative = np.zeros(self.p, dtype=bool)
        for rows in driven:
            relative[rows] = self.held[rows]
        if violated := self._gaps(displacements, relative):
            raise ConstraintError(
                'the initial displacements u0 must satisfy the constraints under coupling="mean", '
                f"which ties displacements, violated in {violated}"
            )

    def _gaps(self, displacements: Sequence[np.ndarray], relative: np.ndarray) -> str:
        """The names and gaps of rows that are not relative to their start, or empty."""
        rows, amounts = self._violated(displacements, 0.0)
        gaps = ~relative[rows]
        return self._listed(rows[gaps], amounts[gaps], ":")

    def _listed(self, rows: np.ndarray, amounts: np.ndarray, by: str) -> str:
        """The names and amounts of violated rows, or empty."""
        names = [f"{self.name(int(r))}{by} {x:g}" for r, x in zip(rows, amounts)]
        return numbered("row", names) if names else ""

    def _violated(
        self, values: Sequence[np.ndarray], g: np.ndarray | float
    ) -> tuple[np.ndarray, np.ndarray]:
        """The rows in which sum L_i x_i differs from g by more than rounding, and the differences.

        Each row is scaled by its largest entry, since the multiple of a constraint is the same
        constraint.
        """
        terms = joined(
            self.ranks,
            [
                (link.rows, *link.products(x), float(np.max(np.abs(x))))
                for link, x in zip(self._given, values)
                if x.any()
            ],
        )
        if not terms and not np.any(g):
            return np.empty(0, dtype=np.int64), np.empty(0)
        jump, size = np.zeros(self.p), np.zeros(self.p)
        for rows, jump_of, size_of, _ in terms:
            jump[rows] += jump_of
            size[rows] += size_of
        jump, size = jump - g, size + np.abs(g)
        largest = np.max(size / self._sizes, initial=0.0)
        far = max((far for _, _, _, far in terms), default=0.0)
        rows = np.flatnonzero(np.abs(jump) / self._sizes > max(ROUNDING * largest, FAR * far))
        return rows, jump[rows]


def _rows(L: sp.csr_array) -> np.ndarray:
    """The row of each entry of a matrix most of whose rows are empty."""
    rows: np.ndarray = L.indptr.searchsorted(np.arange(L.indices.size), side="right") - 1
    return rows


# ---- eliminated rows ----------------------------------------------------------------------------
# The structure before it was cut: matrices of the subdomains with the constraints eliminated.

# An entry of the elimination below this multiple of the largest one, 1 or so, is rounding.
ELIMINATED_ROUNDING = 1e-14


class Assembled(NamedTuple):
    """The assembled structure, from `Coupler.assembled`."""

    # M, C, K: (n, n) csr_array
    M: sp.csr_array
    C: sp.csr_array
    K: sp.csr_array
    # the dofs of a subdomain from those of the structure, u_i = map[name] @ u. Entries are 0 and 1
    # for ties.
    map: dict[str, sp.csr_array]

    def __repr__(self) -> str:
        subdomains, dofs = counted(len(self.map), "subdomain"), counted(self.n, "dof")
        return f"<Assembled structure of {subdomains}, {dofs}>"

    @property
    def n(self) -> int:
        """Number of dofs."""
        return int(self.K.shape[0])


def assembled(
    names: Sequence[str],
    matrices: Sequence[tuple[Matrix, Matrix, Matrix]],
    constraints: Sequence[sp.csc_array],
) -> Assembled:
    """M, C and K on the motions that satisfy the constraints.

    matrices: sequence of (M, C, K) in inner form, (n_i, n_i) each.
    """
    sizes = [L.shape[1] for L in constraints]
    T = kernel(sp.csr_array(sp.hstack(constraints)))
    if T.shape[1] == 0:
        raise ValueError("the constraints must leave a motion, got all dofs fixed")
    parts = np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1])
    maps = [T[rows] for rows in parts]
    M, C, K = (_sum(maps, [triple[kind] for triple in matrices]) for kind in range(3))
    return Assembled(M, C, K, dict(zip(names, maps)))


def _sum(maps: Sequence[sp.csr_array], matrices: Sequence[Matrix]) -> sp.csr_array:
    """sum_i T_i^T A_i T_i"""
    n = maps[0].shape[1]
    total = sp.csr_array((n, n))
    for T, A in zip(maps, matrices):
        if A is not None:
            total = total + T.T @ sparse(A, T.shape[0]) @ T
    total = sp.csr_array(total)
    total.sort_indices()
    return total


def kernel(L: sp.csr_array) -> sp.csr_array:
    """T (n, n - p), a sparse basis of the motions with L T = 0.

    The columns are the dofs that are kept, in their order, with the entry 1. Rows with one or two
    entries are eliminated exactly, whatever their number; the others in groups of rows that share
    dofs, by a QR factorization with pivoting.
    """
    L = sp.csr_array(L, copy=True)
    L.eliminate_zeros()
    tied = _kernel_of_ties(L)
    left = sp.csr_array(L[np.diff(L.indptr) > 2] @ tied)
    return sp.csr_array(tied @ _kernel_of_groups(left)) if left.shape[0] else tied


def _kernel_of_ties(L: sp.csr_array) -> sp.csr_array:
    """The same for the rows of one entry, u_a = 0, and of two, l_a u_a + l_b u_b = 0."""
    from scipy.sparse.csgraph import connected_components

    n, entries = L.shape[1], np.diff(L.indptr)
    fixed = L.indices[L.indptr[:-1][entries == 1]]
    first = L.indptr[:-1][entries == 2]
    a, b = L.indices[first], L.indices[first + 1]
    ratio = -L.data[first] / L.data[first + 1]  # u_b = ratio u_a
    edges = sp.csr_array((np.ones(a.size), (a, b)), shape=(n, n))
    count, group = connected_components(edges, directed=False)
    factor = _factors(n, a, b, ratio)
    free = np.ones(count, dtype=bool)
    free[group[fixed]] = False
    # as many independent rows as dofs: such as u_a = u_b and u_a = -u_b
    free[np.bincount(group[a], minlength=count) >= np.bincount(group)] = False
    first_dof = np.full(count, n)  # the first dof of each group
    np.minimum.at(first_dof, group, np.arange(n))
    order = np.argsort(first_dof[free])
    column = np.full(count, -1)
    column[np.flatnonzero(free)[order]] = np.arange(order.size)
    rows = np.flatnonzero(free[group])
    values = factor[rows] / factor[first_dof[group[rows]]]
    return sp.csr_array((values, (rows, column[group[rows]])), shape=(n, order.size))


def _factors(n: int, a: np.ndarray, b: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """Values x (n,) of a motion that satisfies x_b = ratio x_a, not zero."""
    factor = np.ones(n)
    if np.all(ratio == 1.0):
        return factor
    neighbours: list[list[tuple[int, float]]] = [[] for _ in range(n)]
    for i, j, r in zip(a, b, ratio):
        neighbours[i].append((int(j), r))
        neighbours[j].append((int(i), 1.0 / r))
    seen = np.zeros(n, dtype=bool)
    for start in range(n):
        waiting = [] if seen[start] else [start]
        seen[start] = True
        while waiting:
            i = waiting.pop()
            for j, r in neighbours[i]:
                if not seen[j]:
                    seen[j], factor[j] = True, r * factor[i]
                    waiting.append(j)
    return factor


def _kernel_of_groups(L: sp.csr_array) -> sp.csr_array:
    """The same for general rows, in groups of rows that share dofs."""
    from scipy.linalg import qr, solve_triangular
    from scipy.sparse.csgraph import connected_components

    n = L.shape[1]
    count, group = connected_components(sp.csr_array(abs(L) @ abs(L.T)), directed=False)
    removed = np.zeros(n, dtype=bool)
    rows: list[np.ndarray] = []
    columns: list[np.ndarray] = []
    values: list[np.ndarray] = []
    order = np.argsort(group, kind="stable")
    for members in np.split(order, np.cumsum(np.bincount(group, minlength=count))[:-1]):
        block = sp.csc_array(L[members])
        dofs = np.flatnonzero(np.diff(block.indptr))
        require(24.0 * members.size * dofs.size, f"the elimination of {members.size} constraints")
        R, pivots = qr(block[:, dofs].toarray(), mode="r", pivoting=True)
        p = members.size
        weights = -solve_triangular(R[:p, :p], R[:p, p:])
        weights[np.abs(weights) < ELIMINATED_ROUNDING * np.max(np.abs(weights), initial=1.0)] = 0.0
        i, j = np.nonzero(weights)
        removed[dofs[pivots[:p]]] = True
        rows.append(dofs[pivots[i]])
        columns.append(dofs[pivots[p + j]])
        values.append(weights[i, j])
    free = np.flatnonzero(~removed)
    column = np.full(n, -1)
    column[free] = np.arange(free.size)
    row, col = np.concatenate([free, *rows]), column[np.concatenate([free, *columns])]
    return sp.csr_array(
        (np.concatenate([np.ones(free.size), *values]), (row, col)), shape=(n, free.size)
    )
