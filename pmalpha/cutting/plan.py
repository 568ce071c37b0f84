"""What a cut will cost, predicted from sizes before anything is factored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import counted
from .._tables import text_table
from ..problem.matrices import Matrix, sparse
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from ..reduction.ordering import graph_of
from ..setup.factors import elimination
from ..setup.interface import DENSE_SHARE, total
from ..setup.link import Block, Link, diagonal_compliances
from ..setup.member import STEP_NUMBERS
from ..setup.stability import step_ratio

__all__ = ["Plan", "PlanRow"]


def __dir__() -> list[str]:
    return sorted(__all__)


# Work beside the reading of entries, as entries that take as long (benchmarks/cut_plan.py): of a
# constraint in a fine step (free velocities interpolated and summed up), of an interface dof in a
# step of its subdomain (multipliers gathered, the link solution added), and of a step as such.
ROW, CLOSING, STEP = 12, 40, 500
# Bytes of an entry of a matrix: of the Subdomain by rows, and of the core.
BYTES, CORE_BYTES = 12, 9
# Vectors of a subdomain: states, right-hand sides, scratch.
VECTORS = 24


@dataclass(frozen=True)
class PlanRow:
    """What one subdomain will cost.

    Attributes
    ----------
    name : str
    scheme : Scheme
    substeps : int
        Steps in a macro step.
    dofs, interface : int
        Number of dofs, and of those that it shares.
    entries : int
        Matrix entries that one of its steps reads, 12 for each dof included: the measure of its
        duration in (W1).
    bytes : int
        Its matrices, its factor and its vectors, about.
    ratio : float
        Its step divided by its critical step, an upper bound; 0 where there is no limit.
    """

    name: str
    scheme: Any
    substeps: int
    dofs: int
    interface: int
    entries: int
    bytes: int
    ratio: float


@dataclass(frozen=True, repr=False)
class Plan:
    """What a macro step of a cut will cost, from `Cut.plan`.

    Work of internal forces, loads and recording is not contained.

    Attributes
    ----------
    dt : float
        The macro step.
    subdomains : tuple of PlanRow
    constraints : int
        Number of ties.
    interface : int
        Matrix entries that each of the max(substeps) interface problems of a macro step reads.
    uncut, uncut_steps : int
        Matrix entries that one step of the uncut structure reads, and its steps in a macro step,
        with the scheme and the step of the finest subdomain. For all choices of "auto" those of
        the uncut explicit run, where it is possible.

    Examples
    --------
    >>> from pmalpha import structures
    >>> EA = np.repeat([1.0, 64.0], [1900, 100])
    >>> rod = structures.rod(2000, 2.0, EA=EA, rhoA=1.0, mass="lumped")
    >>> plan = cut(rod, "steps", dt=8e-4).plan()
    >>> [row.substeps for row in plan.subdomains], [row.dofs for row in plan.subdomains]
    ([1, 2, 8], [1900, 2, 101])
    >>> round(plan.gain, 1)
    5.0
    """

    dt: float
    subdomains: tuple[PlanRow, ...]
    constraints: int
    interface: int
    uncut: int
    uncut_steps: int

    @property
    def entries(self) -> int:
        """Matrix entries that a macro step reads, all subdomains and interface problems."""
        steps = sum(row.substeps * row.entries for row in self.subdomains)
        return steps + self.fine_steps * self.interface

    @property
    def cost(self) -> int:
        """Duration of a macro step on one thread, with the interface, in entries read."""
        steps = sum(row.substeps * (STEP + CLOSING * row.interface) for row in self.subdomains)
        return self.entries + steps + self.fine_steps * (STEP + ROW * self.constraints)

    @property
    def uncut_cost(self) -> int:
        """That of the uncut structure at the finest step."""
        return self.uncut_steps * (self.uncut + 2 * STEP)

    @property
    def fine_steps(self) -> int:
        """Interface problems in a macro step under "pm" and "gc"."""
        return max(row.substeps for row in self.subdomains)

    @property
    def gain(self) -> float:
        """How many times as long the uncut structure takes at the finest step, predicted."""
        return self.uncut_cost / self.cost

    @property
    def bytes(self) -> int:
        """Memory of the subdomains, about."""
        return sum(row.bytes for row in self.subdomains)

    @property
    def stable(self) -> bool:
        """Whether no step is above the critical one."""
        return all(row.ratio <= 1.0 + 1e-9 for row in self.subdomains)

    @property
    def summary(self) -> str:
        """Entries, gain and memory in words."""
        return (
            f"macro step of {self.dt:g}: {self.entries:.3g} entries read, "
            f"{self.uncut_steps * self.uncut:.3g} uncut at the finest step, gain {self.gain:.3g}, "
            f"{self.bytes / 1e6:.3g} MB"
        )

    def __repr__(self) -> str:
        heading = ("", "dofs", "shared", "steps", "entries", "step/critical")
        rows = [
            (
                row.name,
                str(row.dofs),
                str(row.interface),
                str(row.substeps),
                str(row.entries),
                f"{row.ratio:.2f}" if row.ratio else "-",
            )
            for row in self.subdomains
        ]
        shown = rows if len(rows) <= 16 else [*rows[:15], ("...", *[""] * 5)]
        lines = text_table(heading, shown, left=("",)).splitlines()
        ties = f"{counted(self.constraints, 'constraint')}, {self.interface} entries a fine step"
        return "\n  ".join([f"<Plan of a {self.summary}", *lines, ties]) + ">"


def plan_of(cut: Any, dt: float) -> Plan:
    ties = cut.constraints[0].matrices if cut.constraints else {}
    p = cut.p
    swept = [_swept(s, _last(ties.get(s))) for s in cut.subdomains]
    rows = tuple(_row(s, _last(ties.get(s)), sweep, dt) for s, sweep in zip(cut.subdomains, swept))
    blocks = [_block(s, ties[s]) for s in cut.subdomains if s in ties]
    interface = _interface(blocks, p) if p else 0
    finest = max(cut.subdomains, key=lambda s: s.substeps)
    scheme, steps = cut._uncut or (finest.scheme, finest.substeps)
    return Plan(float(dt), rows, p, interface, _uncut_entries(cut, scheme), steps)


def _last(L: Any) -> np.ndarray:
    """The interface dofs."""
    return np.empty(0, dtype=np.int64) if L is None else np.unique(L.indices).astype(np.int64)


def _row(s: Subdomain, last: np.ndarray, swept: int, dt: float) -> PlanRow:
    entries = swept + _size(s.K) + _size(s.C) + STEP_NUMBERS * s.n
    stored = sum(_size(A) for A in (s.M, s.K, s.C))
    size = (BYTES + CORE_BYTES) * stored + 4 * swept + 8 * VECTORS * s.n
    ratio = step_ratio(s, dt / s.substeps) if s.internal is None else None
    value = 0.0 if ratio is None else float(ratio.value)
    return PlanRow(
        str(s.name), s.scheme, s.substeps, s.n, last.size, int(entries), int(size), value
    )


def _size(A: Matrix | None) -> int:
    return 0 if A is None else int(A.size if isinstance(A, np.ndarray) else A.nnz)


def _is_plain(s: Subdomain) -> bool:
    """Whether Mbar is diagonal."""
    terms = (s.M, s.implicit_damping, s.implicit_stiffness)
    return all(A is None or A.ndim == 1 for A in terms)


def _swept(s: Subdomain, last: np.ndarray) -> int:
    """Entries of the factor of Mbar, twice."""
    if _is_plain(s):
        return 2 * s.n
    graph = graph_of([s.M, s.implicit_damping, s.implicit_stiffness])
    return s.n * (s.n + 1) if graph is None else elimination(s.n, graph, last).swept


def _block(s: Subdomain, L: Any) -> Block:
    """The pattern of its block of H."""
    link = Link.of(sp.csc_array(L))
    if _is_plain(s):
        return diagonal_compliances([np.ones(s.n)], [link.pattern])[0]
    return Block(link.rows, np.ones((link.rows.size, link.rows.size)))


def _interface(blocks: Sequence[Block], p: int) -> int:
    """Entries of the factor of H, twice."""
    largest = max((float(b.rows.size) for b in blocks if b.is_dense), default=0.0)
    if largest**2 > DENSE_SHARE * p**2:
        return p * (p + 1)
    H = total(blocks, p)
    if H.nnz <= p:
        return 2 * p
    if H.nnz > DENSE_SHARE * p * p:
        return p * (p + 1)
    return elimination(p, graph_of([H]), np.arange(0)).swept


def _uncut_entries(cut: Any, scheme: Scheme) -> int:
    """Entries that a step of the uncut structure reads."""
    dofs = list(cut.dofs.values())
    K, C, M = (_union([getattr(s, x) for s in cut.subdomains], dofs, cut.n) for x in "KCM")
    n: int = sum(numbers.size for numbers in dofs) - cut.p
    fixed = STEP_NUMBERS * n + _size(K) + _size(C)
    implicit = [M, C] if scheme.explicit else [M, C, K]
    if all(A is None or A.ndim == 1 for A in implicit):
        return fixed + 2 * n
    graph = graph_of(implicit)
    if graph is None:
        return fixed + n * (n + 1)
    return fixed + elimination(cut.n, graph, np.arange(0)).swept


def _union(matrices: Sequence[Matrix], dofs: Sequence[np.ndarray], n: int) -> Matrix | None:
    present = [(A, numbers) for A, numbers in zip(matrices, dofs) if A is not None]
    if not present:
        return None
    if all(A.ndim == 1 for A, _ in present):
        return np.ones(n)
    rows, columns = [np.arange(0)], [np.arange(0)]
    for A, numbers in present:
        entries = sp.coo_array(sparse(A, numbers.size))
        rows.append(numbers[entries.row])
        columns.append(numbers[entries.col])
    row, column = np.concatenate(rows), np.concatenate(columns)
    return sp.coo_array((np.ones(row.size), (row, column)), shape=(n, n)).tocsr()
