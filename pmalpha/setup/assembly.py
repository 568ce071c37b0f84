"""From checked subdomains and conditions to the objects of the C core.

Everything here happens once, when a `Coupler` is made: ordering, factors, the interface matrix.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotri

from .. import _core
from ..blas import one_thread
from ..errors import PerformanceWarning
from ..memory import require
from ..problem.matrices import Matrix, combination, core_matrix, core_sparse, dense, permuted
from ..problem.restoring import core_restoring
from ..problem.schemes import Scheme
from ..problem.springs import core_springs
from ..problem.subdomain import Subdomain
from .elimination import Elimination, elimination
from .external import External
from .factors import Factor, Names, factorize, interface_block
from .ordering import elimination_order, graph_of
from .paths import compliance_along_paths

# Below so many entries (0.8 MB) a factor stays in the caches, and sweeping it is soon done.
NOTABLE_FACTOR = 100_000
# Numbers that a step reads and writes for each dof without any matrix.
STEP_NUMBERS = 12
# An interface matrix with more than this share of entries is factored as a dense one.
DENSE_SHARE = 0.1


@dataclass
class Part:
    """A subdomain in its elimination order, with its own core object.

    Attributes
    ----------
    order, place : (n,) array of int
        Dof at each place, and place of each dof.
    L : (p, n) csc_array
        Its conditions, columns in elimination order, rows in the order of the multipliers.
    nb : int
        Interface dofs, the last of the order.
    mass_factor : Factor or None
        Of M, where Mbar is M itself: explicit, with no damping in Mbar.
    stiffness, damping : matrices
        What al1 and al2 multiply in Mbar, equations (12), (R3) and (R4).
    D_r, K_r : matrices
        Estimates of the damping and the stiffness of the restoring force.
    factors : list of Factor
        Of Mbar(h) and, for a double step, of Mbar(2 h).
    elimination : Elimination
        How its sparse matrices are factored.
    external : External or None
        Factors them instead.
    blocks : dict
        Its blocks of H that are already known, by whether they are of the double step.
    ramped : bool
        Substeps under macro coupling.
    response : pair of Block, or None
        If ramped: its block of H (M4), and the same from the mean velocities inside the macro step.
    """

    subdomain: Subdomain
    name: str
    double: bool
    h: float
    elimination: Elimination
    place: np.ndarray
    M: Matrix
    K: Matrix
    C: Matrix
    stiffness: Matrix
    damping: Matrix
    D_r: Matrix
    K_r: Matrix
    L: sp.csc_array
    nb: int
    core: Any = None
    mass_factor: Factor | None = None
    factors: list[Factor] = field(default_factory=list)
    external: External | None = None
    blocks: dict[bool, Any] = field(default_factory=dict)
    ramped: bool = False
    response: tuple[Block, Block] | None = None

    @property
    def order(self) -> np.ndarray:
        return self.elimination.order

    @property
    def n(self) -> int:
        return self.order.size

    def factor(self, A: Matrix, what: str) -> Factor:
        """The factor of a matrix of this subdomain, in elimination order."""
        if self.external is not None and A is not None and A.ndim == 2:
            return self.external.factor(permuted(A, self.place), what)
        return self.elimination.factor(A, Names(what, self.order, self.name))

    def reorder(self, place: np.ndarray) -> None:
        """Conditions in another order: row k of L becomes row place[k]."""
        L = self.L
        rows = place[L.indices].astype(L.indices.dtype)
        self.L = sp.csc_array((L.data, rows, L.indptr), shape=L.shape)
        self.L.sort_indices()

    def block(self, twice: bool) -> Block:
        """al2 L Mbar^-1 L^T for the single or the double step; kept while a coupler is made."""
        if twice in self.blocks:
            return self.blocks[twice]
        h = 2.0 * self.h if twice else self.h
        al2 = self.subdomain.scheme.coefficients(h)[1]
        diagonal = self.diagonal_mbar(h)
        if diagonal is not None:
            block = diagonal_compliance(al2 / diagonal, self.L)
        else:
            block = compliance(self.factors[1 if twice else 0], self.L, self.nb, self.name)
            block = Block(block.rows, al2 * block.values)
        self.blocks[twice] = block
        return block

    def mbar(self, h: float) -> Matrix:
        return mbar(self.subdomain.scheme, h, self.M, self.damping, self.stiffness)

    def diagonal_mbar(self, h: float) -> Matrix:
        """Mbar where it is diagonal, else None."""
        plain = all(A is None or A.ndim == 1 for A in (self.M, self.damping, self.stiffness))
        return self.mbar(h) if plain else None

    def operator(self, h: float) -> tuple:
        """Step and factor of Mbar(h) as the core takes them."""
        if self.mass_factor is not None:
            return (h, *self.mass_factor)
        if self.external is not None and h == self.h:
            factor = self.external.first  # made when the order was asked for
        else:
            factor = self.factor(self.mbar(h), name_of_mbar(self.subdomain.scheme, self.name))
        if self.stiffness is None and self.damping is None:
            self.mass_factor = factor
        return (h, *factor)


def mbar(scheme: Scheme, h: float, M: Matrix, damping: Matrix, stiffness: Matrix) -> Matrix:
    """M + al2 C + al1 K, explicit without K, equation (12); with estimates (R3)."""
    al1, al2 = scheme.coefficients(h)
    return combination([(1.0, M), (al2, damping), (al1, stiffness)])


def name_of_mbar(scheme: Scheme, subdomain: str) -> str:
    if scheme.explicit:
        return f"M + al2 C of explicit subdomain {subdomain!r}"
    return f"Mbar = M + al2 C + al1 K of subdomain {subdomain!r}"


def make_part(
    subdomain: Subdomain,
    name: str,
    double: bool,
    h: float,
    L: sp.csc_array,
    factorize: Any = None,
    *,
    ramped: bool = False,
) -> Part:
    """Order a subdomain, interface last."""
    n, scheme = subdomain.n, subdomain.scheme
    last = np.flatnonzero(np.diff(L.indptr)).astype(np.int64)
    stiffness, damping = subdomain.implicit_stiffness, subdomain.implicit_damping
    graph = graph_of([subdomain.M, damping, stiffness])
    external = None
    if callable(factorize) and graph is not None:
        external = External(factorize, graph, last, name)
        whole = mbar(scheme, h, subdomain.M, damping, stiffness)
        external.factor(whole, name_of_mbar(scheme, name))
        eliminated = Elimination(external.perm, last.size)
    else:
        eliminated = elimination(n, graph, last, superlu=factorize == "superlu")
    order = eliminated.order
    place = np.empty(n, dtype=np.int64)
    place[order] = np.arange(n)
    matrices = (
        subdomain.M,
        subdomain.K,
        subdomain.C,
        stiffness,
        damping,
        subdomain.restoring_damping,
        subdomain.restoring_stiffness,
    )
    different = {id(A): permuted(A, order) for A in {id(A): A for A in matrices}.values()}
    conditions = sp.csc_array(L[:, order])
    return Part(
        subdomain,
        name,
        double,
        h,
        eliminated,
        place,
        *(different[id(A)] for A in matrices),
        conditions,
        last.size,
        external=external,
        ramped=ramped,
    )


def core_subdomain(
    part: Part,
    scheme: Scheme,
    L: sp.csc_array,
    single: tuple,
    *,
    twice: tuple | None = None,
    substeps: int = 1,
    K: Matrix = None,
    C: Matrix = None,
    restoring: tuple | None = None,
    D_r: Matrix = None,
    lagged: bool = False,
    ramped: bool = False,
    K_r: Matrix = None,
    springs: tuple = (),
) -> Any:
    """The core's object for a part with these matrices and operators."""
    columns = sp.csc_array(L[:, part.n - part.nb :])
    columns.sort_indices()
    return _core.Subdomain(
        n=part.n,
        nb=part.nb,
        substeps=substeps,
        K=core_matrix(K),
        C=core_matrix(C),
        scheme=(scheme.am, scheme.af, scheme.beta, scheme.gamma),
        single=single,
        twice=twice,
        link=(L.shape[0], *core_sparse(columns)),
        restoring=restoring,
        D_r=core_matrix(D_r),
        lagged=lagged,
        ramped=ramped,
        K_r=core_matrix(K_r),
        springs=springs,
    )


def warn_of_factor(part: Part) -> None:
    """PerformanceWarning when sweeping a factor is most of an explicit subdomain's step."""
    solved = {"M": part.M, "C": part.damping}
    full = [name for name, A in solved.items() if A is not None and A.ndim == 2]
    if not part.subdomain.scheme.explicit or not full:
        return
    structure = part.elimination.structure
    entries = part.n * (part.n + 1) // 2 if structure is None else part.elimination.swept // 2
    K = part.K
    product = 0 if K is None else K.nnz if sp.issparse(K) else K.size
    rest = STEP_NUMBERS * part.n + product
    if entries < NOTABLE_FACTOR or 2 * entries <= rest:
        return
    advice = {"M": "lump the mass, M as a 1-D array", "C": 'take damping="lagged"'}
    warnings.warn(
        f"{' and '.join(full)} of explicit subdomain {part.name!r} being no diagonal, every step "
        f"sweeps a factor of {entries} entries "
        f"({8e-6 * entries:.3g} MB), more than all the rest of it; "
        f"{' and '.join(advice[name] for name in full)}",
        PerformanceWarning,
        stacklevel=4,
    )


def build(part: Part) -> None:
    """Factor Mbar and make the core's object of a part."""
    single = part.operator(part.h)
    twice = part.operator(2.0 * part.h) if part.double else None
    part.factors = [operator[1:] for operator in (single, twice) if operator is not None]
    part.core = core_subdomain(
        part,
        part.subdomain.scheme,
        part.L,
        single,
        twice=twice,
        substeps=part.subdomain.substeps,
        K=part.K,
        C=part.C,
        restoring=core_restoring(part.subdomain.restoring, part.name, part.order),
        D_r=part.D_r,
        lagged=part.subdomain.damping == "lagged",
        ramped=part.ramped,
        K_r=part.K_r if part.ramped else None,
        springs=core_springs(part.subdomain.springs, part.place),
    )


# ---- interface -------------------------------------------------------------------------------


def row_order(parts: Sequence[Part], p: int) -> np.ndarray:
    """The order of the multipliers in which the interface matrix fills little."""
    diagonal = [part.diagonal_mbar(part.h) is not None and not part.ramped for part in parts]
    members = [conditions_of(part.L) for part in parts]
    blocks = sum(float(m.size) ** 2 for m, plain in zip(members, diagonal) if not plain)
    if blocks > DENSE_SHARE * p**2:
        return np.arange(p)  # these blocks alone make the matrix dense
    require(40.0 * blocks, f"the pattern of the interface matrix of {p} conditions")
    graphs = []
    for part, rows, plain in zip(parts, members, diagonal):
        if plain:
            graphs.append(diagonal_compliance(np.ones(part.n), abs(part.L).sign()))
        else:
            graphs.append(Block(rows, np.ones((rows.size, rows.size))))
    return elimination_order(p, graph_of([total(graphs, p)]), np.arange(0))


def conditions_of(L: sp.csc_array) -> np.ndarray:
    """The rows of L that have an entry."""
    return np.unique(L.indices).astype(np.int64)


def own_rows(L: sp.csc_array) -> tuple[np.ndarray, sp.csr_array]:
    """The rows of L that have an entry, and L without the others."""
    rows, local = np.unique(L.indices, return_inverse=True)
    own = sp.csc_array((L.data, local.reshape(-1), L.indptr), shape=(rows.size, L.shape[1]))
    return rows.astype(np.int64), sp.csr_array(own)


def interface_matrix(parts: Sequence[Part], p: int, *, start: bool, mean: bool = False) -> Matrix:
    """H = sum_i al2_i L_i Mbar_i^-1 L_i^T, equations (18) and (F6); of ramped parts (M4).

    Parameters
    ----------
    parts : sequence of Part
        With their factors.
    p : int
        Number of conditions.
    start : bool
        Everybody single, as in the first macro step.
    mean : bool
        Of ramped parts the mean inside the macro step instead of what is at its end.
    """
    blocks = []
    for part in parts:
        if part.response is not None:
            blocks.append(part.response[1 if mean else 0])
            continue
        blocks.append(part.block(part.double and not start))
    return summed(blocks, p)


@dataclass(frozen=True)
class Block:
    """A block of H.

    Attributes
    ----------
    rows : (k,) array of int
        The conditions it stands on.
    values : (k, k) array or csr_array
    """

    rows: np.ndarray
    values: np.ndarray | sp.csr_array

    @property
    def is_dense(self) -> bool:
        return not sp.issparse(self.values)

    def entries(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(values, rows, columns) of its entries in H."""
        rows = self.rows.astype(np.int32)
        if self.is_dense:
            return self.values.ravel(), np.repeat(rows, rows.size), np.tile(rows, rows.size)
        own = sp.coo_array(self.values)
        return own.data, rows[own.row], rows[own.col]


def diagonal_compliance(inverse: np.ndarray, L: sp.csc_array) -> Block:
    """L A^-1 L^T of a diagonal A, from the reciprocals of its entries."""
    rows, own = own_rows(L)
    return Block(rows, sp.csr_array(own @ sp.diags_array(inverse) @ own.T))


def compliance(factor: Factor, L: sp.csc_array, nb: int, name: str) -> Block:
    """L A^-1 L^T = L_b S^-1 L_b^T on the conditions of L, from the factor of A."""
    rows, own = own_rows(L[:, L.shape[1] - nb :])
    if not rows.size:
        return Block(rows, np.zeros((0, 0)))
    size = 8.0 * (3.0 * rows.size**2 + 4.0 * nb * max(nb, rows.size))
    require(size, f"the interface matrix of {rows.size} conditions of {name!r}")
    inverse, R = factor
    if isinstance(R, tuple) and len(R) == 7:
        block = compliance_along_paths(inverse, R, own)
    else:
        block = _compliance_of_last(inverse[inverse.size - nb :], interface_block(factor, nb), own)
    return Block(rows, 0.5 * (block + block.T))  # symmetric but for rounding


def _compliance_of_last(inverse: np.ndarray, R_bb: np.ndarray, L_b: sp.csr_array) -> np.ndarray:
    """L_b S^-1 L_b^T, S = R_bb D_b R_bb^T, (F6).

    S^-1 as a whole takes a third of the work of nb solutions, of which few conditions need fewer.
    """
    few = 3 * L_b.shape[0] < inverse.size
    with one_thread():
        if few:
            X = solve_triangular(
                R_bb, L_b.toarray().T, lower=True, unit_diagonal=True, overwrite_b=True
            )
            return X.T @ (inverse[:, None] * X)
        root = 1.0 / np.sqrt(inverse)
        G = np.asfortranarray(R_bb * root)
        np.fill_diagonal(G, root)
        half, _ = dpotri(G, lower=True, overwrite_c=True)
    whole = np.tril(half)
    whole += np.tril(half, k=-1).T
    return L_b @ np.ascontiguousarray((L_b @ whole).T)


def total(blocks: Sequence[Block], p: int) -> sp.csr_array:
    """The sum of blocks as a (p, p) matrix, in one pass."""
    values, rows, columns = (np.concatenate(x) for x in zip(*(b.entries() for b in blocks)))
    H = sp.csr_array((values, (rows, columns)), shape=(p, p))
    H.sort_indices()
    return H


def summed(blocks: Sequence[Block], p: int) -> Matrix:
    """The sum of the subdomains' blocks of H, in the form in which it is best factored."""
    if p == 0:
        return None
    largest = max((b.rows.size for b in blocks if b.is_dense), default=0)
    if largest**2 > DENSE_SHARE * p**2:
        return _dense_sum(blocks, p)
    H = total(blocks, p)
    if H.nnz == np.count_nonzero(H.diagonal()):
        return H.diagonal()
    return dense(H) if H.nnz > DENSE_SHARE * p * p else H


def _dense_sum(blocks: Sequence[Block], p: int) -> Matrix:
    """The sum where one block alone makes it dense."""
    if p == 1:
        return total(blocks, p).diagonal()
    require(8.0 * p**2, f"the interface matrix of {p} conditions")
    H = np.zeros((p, p))
    for block in blocks:
        if not block.is_dense:
            values, rows, columns = block.entries()
            H[rows, columns] += values
        elif block.rows.size == p:
            H += block.values
        else:
            H[np.ix_(block.rows, block.rows)] += block.values
    return H


def interface_factor(
    H: Matrix, rows: np.ndarray, what: str = "the interface matrix H", *, superlu: bool = False
) -> Factor:
    """The factor of H; without conditions an empty one. `rows` are the conditions in its order."""
    if H is None:
        return np.empty(0), None
    return factorize(H, Names(what, rows), superlu=superlu)
