"""What a cut will cost, predicted from sizes before anything is factored."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .._checks import counted
from .._tables import text_table
from ..setup.foreseen import entries_of_union, foreseen

__all__ = ["Plan", "PlanRow"]


def __dir__() -> list[str]:
    return sorted(__all__)


# Work beside the reading of entries, as entries that take as long (benchmarks/cut_plan.py): of a
# constraint in a fine step (free velocities interpolated and summed up), of an interface dof in a
# step of its subdomain (multipliers gathered, the link solution added), and of a step as such.
ROW, CLOSING, STEP = 12, 40, 500


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
    seen, interface = foreseen(cut.subdomains, ties, cut.p, dt)
    rows = tuple(
        PlanRow(str(s.name), s.scheme, s.substeps, s.n, *x) for s, x in zip(cut.subdomains, seen)
    )
    finest = max(cut.subdomains, key=lambda s: s.substeps)
    scheme, steps = cut._uncut or (finest.scheme, finest.substeps)
    uncut = entries_of_union(cut.subdomains, list(cut.dofs.values()), cut.n, cut.p, scheme)
    return Plan(float(dt), rows, cut.p, interface, uncut, steps)
