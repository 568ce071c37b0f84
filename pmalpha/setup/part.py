"""A subdomain in its elimination order, from checked matrices to its object in the core."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp

from .. import _core
from ..errors import PerformanceWarning, warn
from ..problem.matrices import Matrix, combination, core_matrix, core_sparse, permuted
from ..problem.restoring import core_restoring
from ..problem.schemes import Scheme
from ..problem.springs import core_springs
from ..problem.subdomain import Subdomain
from .compliance import Block, compliance, diagonal_compliance
from .elimination import Elimination, elimination
from .external import External
from .factors import Factor, Names
from .ordering import graph_of

# Below so many entries (0.8 MB) a factor stays in the caches, and sweeping it is soon done.
NOTABLE_FACTOR = 100_000
# Numbers that a step reads and writes for each dof without any matrix.
STEP_NUMBERS = 12


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
    warn(
        f"{' and '.join(full)} of explicit subdomain {part.name!r} being no diagonal, every step "
        f"sweeps a factor of {entries} entries "
        f"({8e-6 * entries:.3g} MB), more than all the rest of it; "
        f"{' and '.join(advice[name] for name in full)}",
        PerformanceWarning,
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
