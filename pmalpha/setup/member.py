"""A subdomain in its elimination order: its matrices, factors and object of the core."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from types import MappingProxyType
from typing import Any, cast

import numpy as np
import scipy.sparse as sp

import pmalpha._core as _core

from .._cached import Once
from ..problem import forms
from ..problem.device import limits_of_dofs
from ..problem.forms import Factor, Operator
from ..problem.matrices import (
    Matrix,
    combination,
    core_matrix,
    diagonal,
    is_symmetric,
    permuted,
    sparse,
)
from ..problem.restoring import Feedback, core_restoring
from ..problem.schemes import Scheme
from ..problem.springs import core_springs
from ..problem.subdomain import Subdomain
from ..reduction.ordering import graph_of
from .factors import Elimination, Eliminations, Names
from .internal_forces import (
    InternalForces,
    TangentPattern,
    core_internal,
    core_size,
    internal_forces,
    tangent_pattern,
)
from .link import Block, Link, compliance, diagonal_compliances
from .stability import StepRatio

# Parts of the entries of C that are rounding of a0 M + a1 K.
ROUNDING_OF_C = 1e-12

# Of a subdomain whose tangents are factored in the core.
NO_FACTOR = Factor(None, None)  # type: ignore[arg-type]

# Numbers per dof that a step reads and writes, without the matrices.
STEP_NUMBERS = 12


@dataclass(kw_only=True)
class Ordered:
    """A subdomain in its elimination order, for steps of all lengths.

    order, position: (n,) array of int, dof at each position, and position of each dof.
    """

    subdomain: Subdomain
    name: str
    elimination: Elimination  # the factorization of its sparse matrices
    position: np.ndarray
    M: Matrix
    K: Matrix | None
    C: Matrix | None
    # stiffness, damping: the matrices in Mbar with the factors al1 and al2, equations (12), (R3)
    # and (R4)
    stiffness: Matrix | None
    damping: Matrix | None
    # D_r, K_r: estimates of the damping and the stiffness of the restoring force
    D_r: Matrix | None
    K_r: Matrix | None
    L: Link  # its constraints, dofs in elimination order, rows in the order of the multipliers
    nb: int  # number of interface dofs, the last of the order
    N: Link | None = None  # the rows of contacts on it, dofs in elimination order
    internal: InternalForces | None = None
    # where its steps are iterated: implicit, with internal forces
    tangent: TangentPattern | None = None
    reuses: bool = False  # whether tangents are kept from step to step
    mean: bool = False  # responds to a constant acceleration of the interface (K3)
    feedback: Feedback | None = None  # its load if that depends on the motion
    mass_factor: Factor | None = None  # of M, where Mbar = M: explicit, with no damping in Mbar
    # tangents at t = 0 in place of internal forces made Mbar indefinite: pivots of any sign
    indefinite: bool = False
    once: Once = field(default_factory=Once)  # what equal subdomains share, during set-up

    @property
    def order(self) -> np.ndarray:
        return self.elimination.order

    @property
    def n(self) -> int:
        return self.order.size

    @property
    def symmetric(self) -> bool:
        """Whether Mbar, K and C of its steps are symmetric."""
        return self.subdomain.has_symmetric_steps

    @property
    def has_symmetric_block(self) -> bool:
        """Whether its block of H is symmetric: under mean coupling with damping, (K8)."""
        damped = self.mean and self.is_damped and not self._is_trapezoidal
        return self.symmetric and not self.indefinite and not damped

    @property
    def is_damped(self) -> bool:
        """Whether it has C or a C_t of internal forces."""
        return self.C is not None or (self.internal is not None and self.internal.C is not None)

    @property
    def _is_trapezoidal(self) -> bool:
        """Whether the mean velocity of a step is the mean of those at its ends, that of C too."""
        s, scheme = self.subdomain, self.subdomain.scheme
        mean = math.isclose(scheme.gamma, 2.0 * scheme.beta, rel_tol=1e-15)
        return mean and not scheme.explicit and s.damping == "implicit"

    @property
    def massless(self) -> np.ndarray:
        """The positions of dofs without mass, rising."""
        return self.once(self._massless, (self.M, self.order), "massless")

    def _massless(self) -> np.ndarray:
        massless = self.subdomain.massless
        return np.flatnonzero(np.isin(self.order, massless)) if massless.size else massless

    @property
    def regular_mass(self) -> Matrix:
        """M, with ones where dofs have no mass."""
        if not self.massless.size:
            return self.M
        ones = np.zeros(self.n)
        ones[self.massless] = 1.0
        return combination([(1.0, self.M), (1.0, ones)])

    def factor_of_mass(self) -> Factor:
        """The factor of `regular_mass`."""
        what = f"M of subdomain {self.name!r}"
        return self.mass_factor or self.once(
            lambda: self.factor(self.regular_mass, what), (self.M, self.elimination), "M"
        )

    def factor(self, A: Matrix | None, what: str, *, symmetric: bool = True) -> Factor:
        """The factor of a matrix of this subdomain, in elimination order."""
        names = Names(what, self.order, self.name)
        return self.elimination.factor(A, names, symmetric=symmetric)

    def compliance(self, factor: Factor, L: Link) -> Block:
        """L A^-1 L^T on the constraints of L, from the factor of A."""
        places = L.ptr.tobytes(), L.local.tobytes(), L.values.tobytes()
        make = partial(compliance, factor, L, self.nb, self.name)
        return replace(self.once(make, tuple(factor), "compliance", *places), rows=L.rows)

    def core_matrix(self, A: Matrix | None) -> Any:
        """A matrix of the subdomain in a form of the core."""
        if A is None or A.ndim == 1:
            return core_matrix(A)
        symmetric = self.symmetric
        return self.once(lambda: core_matrix(A, symmetric=symmetric), (A,), "core", symmetric)

    @property
    def is_diagonal(self) -> bool:
        """Whether Mbar is diagonal."""
        return all(A is None or A.ndim == 1 for A in (self.M, self.damping, self.stiffness))

    def mbar(self, h: float) -> Matrix:
        return mbar(self.subdomain.scheme, h, self.M, self.damping, self.stiffness)

    def tangent_threads(self, most: int) -> int:
        """How many threads, of `most`, share the factorization of its tangents."""
        structure = self.elimination.structure
        return 1 if self.tangent is None or structure is None else structure.threads(most)


@dataclass(kw_only=True)
class Stepped(Ordered):
    """The same for steps of one length, not built yet."""

    # h, substeps: length and number of its substeps in a macro step
    h: float
    substeps: int
    double: bool
    # length of its double steps, where they span a change of the steps and are not of length 2 h
    over: float | None = None
    has_responses: bool = False  # link responses (M3): several substeps under macro coupling
    # step length and factor of Mbar in the form of the core, by length: those of its steps, and
    # before it is built others that have been made
    known: dict[float, Operator] = field(default_factory=dict)

    @property
    def step(self) -> float:
        """The length of the steps after the first macro step: 2 h if they are double."""
        return 2.0 * self.h if self.double else self.h

    @property
    def lengths(self) -> tuple[float, ...]:
        """The lengths of its steps: the single one and, if it takes them, the double one."""
        if not self.double:
            return (self.h,)
        return (self.h, 2.0 * self.h if self.over is None else self.over)

    def is_double(self, *, start: bool) -> bool:
        """Whether it takes double steps in the first macro step (`start`), or after it."""
        return self.double and (self.over is not None or not start)

    @property
    def deferred(self) -> bool:
        """Whether its single steps under mean coupling wait for the multipliers (K7)."""
        explicit = self.subdomain.scheme.explicit
        if not self.mean or self.substeps > 1 or explicit or self.internal is not None:
            return False
        return self.C is None or self._is_trapezoidal

    def diagonal_inverse(self, twice: bool) -> np.ndarray:
        """al2 Mbar^-1 of a diagonal Mbar for the single or the double step."""
        h = self.lengths[twice]
        return self.subdomain.scheme.coefficients(h)[1] / self.mbar(h)

    def operator(self, h: float) -> Operator:
        """Step length and factor of Mbar(h)."""
        if self.tangent is not None:
            return Operator(h, NO_FACTOR)  # the core factors the tangents
        if self.mass_factor is not None:
            return Operator(h, self.mass_factor)
        if h in self.known:
            return self.known[h]
        make = partial(self._factor_of_mbar, h)
        matrices = self.M, self.damping, self.stiffness, self.elimination
        scheme, signs = self.subdomain.scheme, (self.symmetric, self.indefinite)
        factor = self.once(make, matrices, "Mbar", scheme, h, *signs)
        if self.stiffness is None and self.damping is None:
            self.mass_factor = factor
        return Operator(h, factor)

    def _factor_of_mbar(self, h: float) -> Factor:
        explicit = self.subdomain.scheme.explicit
        form = "Mbar = M + al2 C + al1 K of" if not explicit else "M + al2 C of explicit"
        what = f"{form} subdomain {self.name!r}"
        symmetric = self.symmetric or is_symmetric(self.damping) and is_symmetric(self.stiffness)
        return self.factor(self.mbar(h), what, symmetric=symmetric and not self.indefinite)

    def unbuilt(self, **changes: Any) -> Stepped:
        """The same with some fields changed, such as those of its steps."""
        return Stepped(**{x.name: getattr(self, x.name) for x in fields(Stepped)} | changes)


@dataclass(kw_only=True)
class Member(Stepped):
    """The same with its factors and its object of the core."""

    parts: dict[str, Any]  # what the core is made of, by the names of csrc/core/describe
    core: _core.Subdomain
    factors: list[Factor]  # of Mbar(h) and, for a double step, of Mbar(2 h)
    # its blocks of H computed so far, by whether they are of the double step
    blocks: dict[bool, Block] = field(default_factory=dict)
    # if it has link responses: its block of H (M4), and the one from the mean velocities in the
    # macro step
    response_blocks: tuple[Block, Block] | None = None
    # its step divided by its critical step, as far as set-up computed it
    step_ratio: StepRatio | None = None
    # whether the energy that its forces add, and the mass of an estimate, were warned of since the
    # last start
    reported: bool = False
    slowed: bool = False

    def block(self, twice: bool) -> Block:
        """al2 L Mbar^-1 L^T for the single or the double step; cached during set-up."""
        if twice in self.blocks:
            return self.blocks[twice]
        if self.is_diagonal:
            (block,) = diagonal_compliances([self.diagonal_inverse(twice)], [self.L])
        else:
            al2 = self.subdomain.scheme.coefficients(self.lengths[twice])[1]
            block = self.compliance(self.factors[twice], self.L).times(al2)
        self.blocks[twice] = block
        return block

    def store(self, responses: forms.Responses) -> None:
        """Unit responses of all its constraints, which are then not repeated (M8)."""
        self.parts["responses"] = responses
        self.core.store_responses(responses)

    def present(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """u and v in the user's order, the histories, and what springs remember."""
        levels, m = self.core.levels(), 0 if self.internal is None else self.internal.initial.size
        u, v = (levels[name][self.position] for name in "uv")
        return u, v, levels["history"][:m], self.core.springs()


def mbar(scheme: Scheme, h: float, M: Matrix, damping: Matrix, stiffness: Matrix) -> Matrix:
    """M + al2 C + al1 K, explicit without K, equation (12); with estimates (R3)."""
    al1, al2 = scheme.coefficients(h)
    return combination([(1.0, M), (al2, damping), (al1, stiffness)])


def make_member(
    subdomain: Subdomain,
    name: str,
    double: bool,
    h: float,
    substeps: int,
    L: Link,
    eliminations: Eliminations,
    once: Once,
    *,
    threads: int = 1,
    has_responses: bool = False,
    N: Link | None = None,
    **does: bool,
) -> Stepped:
    """Put a subdomain in its elimination order, interface dofs last.

    `eliminations` are those of all subdomains, `once` is what equal ones share, `threads` is the
    maximum number of threads that make a factor, and `does` has the values of `reuses` and `mean`.
    """
    n, last = subdomain.n, L.dofs
    if N is not None:
        last = np.union1d(last, N.dofs)
    stiffness, damping = subdomain.implicit_stiffness, subdomain.implicit_damping
    matrices = {"M": subdomain.M, "K": subdomain.K, "C": subdomain.C}
    matrices |= {"stiffness": stiffness, "damping": damping}
    matrices |= {"D_r": subdomain.restoring_damping, "K_r": subdomain.restoring_stiffness}
    internal = None if subdomain.internal is None else internal_forces(subdomain, name)
    tangent = None
    if internal is not None and subdomain.iterates:
        tangent = tangent_pattern(internal.pattern, last)

    def ordered() -> tuple[Elimination, np.ndarray, list[Matrix | None]]:
        if tangent is not None:
            eliminated = Elimination(tangent.order, last.size, tangent.symbolic)
        else:
            graph = graph_of([subdomain.M, damping, stiffness])
            eliminated = eliminations.of(n, graph, last)
        order = eliminated.order
        known = {id(A): permuted(A, order) for A in {id(A): A for A in matrices.values()}.values()}
        in_order = [known[id(A)] for A in matrices.values()]
        return replace(eliminated, threads=threads), np.argsort(order), in_order

    objects = (tangent, *matrices.values())
    eliminated, position, in_order = once(ordered, objects, "order", n, last.tobytes())
    order = eliminated.order
    in_fields: dict[str, Any] = dict(zip(matrices, in_order)) | does
    return Stepped(
        subdomain=subdomain,
        name=name,
        double=double,
        h=h,
        substeps=substeps,
        elimination=eliminated,
        position=position,
        L=L.in_order(order),
        nb=last.size,
        internal=internal,
        tangent=tangent,
        **in_fields,
        has_responses=has_responses and internal is None,
        feedback=Feedback(f"force of subdomain {name!r}", n) if subdomain.has_feedback else None,
        N=None if N is None else N.in_order(order),
        once=once,
    )


def core_parts(
    member: Ordered,
    scheme: Scheme,
    L: Link,
    single: Operator,
    *,
    twice: Operator | None = None,
    substeps: int = 1,
    matrices: Mapping[str, Matrix] = MappingProxyType({}),
    **parts: Any,
) -> dict[str, Any]:
    """What the core takes of a subdomain with this operator, by name: csrc/core/describe."""
    matrices = {x: member.core_matrix(A) for x, A in matrices.items()}
    sizes = {"n": member.n, "nb": member.nb, "substeps": substeps}
    steps = {"single": _in_core(scheme, single)}
    steps |= {} if twice is None else {"twice": _in_core(scheme, twice)}
    steps |= {"second": cast(Any, scheme).second_stage(single.h)} if scheme.is_of_two_stages else {}
    link = {"link": L.core(member.n - member.nb)}
    return sizes | steps | link | matrices | parts


def _in_core(scheme: Scheme, operator: Operator) -> forms.StepOperator:
    return forms.StepOperator(scheme.constants(operator.h), *operator.factor)


def parts_of_steps(
    member: Stepped, operators: Sequence[Operator], *, K_r: Matrix, **parts: Any
) -> dict[str, Any]:
    """The same for the steps of a subdomain, with the operators of its lengths."""
    single, *twice = operators
    matrices = {"K": member.K, "C": member.C, "D_r": member.D_r, "K_r": K_r}
    return core_parts(
        member,
        member.subdomain.scheme,
        member.L,
        single,
        twice=twice[0] if twice else None,
        substeps=member.substeps,
        matrices=matrices,
        lagged=member.subdomain.damping == "lagged",
        has_responses=member.has_responses,
        continues=member.over is not None,
        **parts,
    )


def build(member: Stepped, mass: Factor | None = None, threads: int = 1) -> Member:
    """Factor Mbar and make the object of the core, which factors tangents in `threads`."""
    operators, springs = list(map(member.operator, member.lengths)), member.subdomain.springs
    parts = parts_of_steps(
        member,
        operators,
        restoring=core_restoring(
            member.subdomain.restoring,
            member.name,
            member.order,
            member.h,
            member.feedback,
        ),
        K_r=member.K_r if member.has_responses or member.tangent is not None else None,
        springs=core_springs(springs, member.position) if springs else (),
        **_internal(member, threads),
        mass=mass,
        deferred=member.deferred,
        impulse=impulse_parts(member),
        limits=_limits(member),
        watch=_watch(member),
    )
    return built(member, parts, operators)


def built(member: Stepped, parts: dict[str, Any], operators: Sequence[Operator]) -> Member:
    """The same with its object of the core, of its parts and the operators of its lengths."""
    made = vars(member) | {"known": {operator.h: operator for operator in operators}}
    factors = [operator.factor for operator in operators]
    return Member(**made, parts=parts, core=_core.Subdomain(parts), factors=factors)


def _limits(member: Ordered) -> forms.Limits | None:
    if (limits := member.subdomain.limits) is None:
        return None
    u, v, a, f = (x if x is None else x[member.order] for x in limits_of_dofs(limits, member.n))
    return forms.Limits(u, v, a, f, math.inf if limits.energy is None else limits.energy)


def _watch(member: Ordered) -> forms.Watch | None:
    s = member.subdomain
    if s.restoring is None and member.internal is None and not s.has_feedback:
        return None
    K_r = None if s.scheme.explicit else member.K_r
    M, K_r = member.core_matrix(member.M), member.core_matrix(K_r)
    return forms.Watch(M, K_r, s.scheme.explicit)


def _internal(member: Stepped, threads: int) -> dict[str, Any]:
    """What the core has to know of internal forces."""
    if member.internal is None:
        return {}
    internal = core_internal(member.internal, member.order, member.tangent, member.symmetric)
    if member.tangent is None:
        return {"M": core_matrix(member.M), "internal": internal}
    base, *twice = (member.tangent.values(member.mbar(h)) for h in member.lengths)
    forces = member.subdomain.internal
    springs = forces is not None and bool(forces.springs)
    structure = member.elimination.structure
    scratch = 0.0 if structure is None or threads == 1 else structure.scratch(threads)
    pattern = member.tangent.core(member.name, member.symmetric, scratch)
    over = twice[0] if twice else None
    size = core_size(member.M)
    iterate = forms.Iterate(springs, member.reuses, pattern, base, over, size, threads)
    return {"M": core_matrix(member.M), "internal": internal, "iterate": iterate}


# ---- impulses of contacts ----------------------------------------------------------------------


def impulse_parts(member: Stepped) -> forms.Impulse | None:
    """What impulses meet in a subdomain, for the core: equation (U4)."""
    if member.N is None:
        return None
    s, begin = member.subdomain, member.n - member.nb
    reached = np.diff(member.N.ptr)[begin:] > 0
    inverse = np.zeros(member.nb)
    inverse[reached] = 1.0 / diagonal(member.M)[begin:][reached]
    al1, al2 = s.scheme.coefficients(member.h)
    rates = _rates(member, np.flatnonzero(reached) + begin)
    if rates is not None and not s.scheme.explicit:
        a0, a1 = rates
        alpha = (a1 + 0.5 * member.h) / (al1 + al2 * a1)
        return forms.Impulse(inverse, alpha, a0 - alpha * (1.0 + al2 * a0), None)
    stiffness = combination([(1.0, member.K), (1.0, member.K_r)])
    B = combination([(1.0, member.damping), (0.5 * member.h, stiffness)])
    return forms.Impulse(inverse, 0.0, 0.0, Link.of(_columns(B, member.n)).core(begin))


def _columns(A: Matrix | None, n: int) -> sp.csc_array:
    result = sp.csc_array(sparse(A, n))
    result.sort_indices()
    return result


def _rates(member: Stepped, dofs: np.ndarray) -> tuple[float, float] | None:
    """(a0, a1) of Mbar = M + al2 C + al1 K with C = a0 M + a1 K, where K and C act as such on
    impulses at these dofs; None elsewhere, and for restoring forces, whose balance reads w."""
    s = member.subdomain
    if s.restoring is not None or s.has_feedback:
        return None
    if member.damping is None or not abs(_columns(member.damping, member.n)[:, dofs]).sum():
        return 0.0, 0.0
    if s.rayleigh is None or s.K is None:
        return None
    a0, a1 = s.rayleigh
    proportional = combination([(a0, s.M), (a1, s.K)])
    rest = combination([(1.0, s.C), (-1.0, proportional)])
    size = abs(_columns(s.C, member.n)).max()
    if rest is None or abs(_columns(rest, member.n)).max() <= ROUNDING_OF_C * size:
        return float(a0), float(a1)
    return None
