"""Checks of the subdomains, constraints and options of a coupler; which steps are double."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, get_args

import numpy as np
import scipy.sparse as sp

from .._checks import check_word, counted, listed, listing, time_step, whole_number
from ..problem.arguments import Coupling, Start
from ..problem.constraints import Chosen, Constraint
from ..problem.contacts import Contact
from ..problem.forms import DEFAULT, Newton
from ..problem.subdomain import Subdomain

MOST_SUBSTEPS = 2**31
# With one interface problem in a macro step.
MACRO = ("macro", "mean")
# What each coupling is for, in a line; docs/choosing.md says more.
COUPLINGS: dict[Coupling, str] = {
    "pm": "test rigs, stiff restoring forces, a large coarse subdomain; double steps of 2 dt; "
    "substeps add up to 0.26 dt / T of critical damping",
    "gc": "the same and contact, with single steps; explicit levels of a cut mesh; substeps add up "
    "to 0.52 dt / T",
    "macro": "linear subdomains with substeps: order 2, where the first two are of order 1",
    "mean": "no drift, and exact energy without damping; for long runs",
}


def stages(subdomains: Sequence[Subdomain], substeps: Sequence[int]) -> int:
    """The number of fine steps, if they are the stages of schemes of two, else 0.

    ValueError for numbers of substeps and for forces with which those do not go.
    """
    names, fine = names_of(subdomains), max(substeps)
    staged = [s.scheme.is_of_two_stages for s in subdomains]
    if not any(staged):
        return 0
    scheme = repr(subdomains[staged.index(True)].scheme)
    for s, name, count, is_staged in zip(subdomains, names, substeps, staged):
        if is_staged:
            _check_staged(s, name, count, fine)
        elif fine // count % 2:
            raise ValueError(
                f"substeps of {name!r} must be whole steps of {scheme}, of two stages each: they "
                f"must divide {fine // 2}, got {count}"
            )
    return fine


def _check_staged(s: Subdomain, name: str, count: int, fine: int) -> None:
    if count % 2:
        raise ValueError(
            f"substeps of {name!r} must be even, two stages to a step of {s.scheme!r}, got {count}"
        )
    if count < fine:
        raise ValueError(
            f"substeps of {name!r} with {s.scheme!r} must be the largest of all, {fine}, since "
            f"all others are tied at the ends of its stages, got {count}"
        )


def double_steps(
    subdomains: Sequence[Subdomain], coupling: str, substeps: Sequence[int]
) -> tuple[bool, ...]:
    """Whether each subdomain takes double steps, with these numbers of substeps."""
    if coupling == "gc" or len(subdomains) == 1:
        return (False,) * len(subdomains)
    if coupling in MACRO:
        return macro_double_steps(subdomains, coupling, substeps)
    fine = finest(substeps, coupling)
    double = [
        not s.scheme.explicit and count < fine if s.double_step is None else s.double_step
        for s, count in zip(subdomains, substeps)
    ]
    if min(substeps) == fine and all(s.double_step is None for s in subdomains):
        implicit = [i for i, s in enumerate(subdomains) if not s.scheme.explicit]
        if implicit:
            double[implicit[0]] = True
    if all(d for d, count in zip(double, substeps) if count == fine):
        raise ValueError(
            "double_step must not be True on all subdomains of the finest step, or odd and even "
            f"time levels would be two unrelated runs; got it on all with substeps = {fine}"
        )
    return tuple(double)


def macro_double_steps(
    subdomains: Sequence[Subdomain], coupling: str, substeps: Sequence[int]
) -> tuple[bool, ...]:
    """Under macro coupling: the subdomains with double_step=True, which must have one substep."""
    double = tuple(bool(s.double_step) for s in subdomains)
    for i, count in enumerate(substeps):
        if double[i] and count > 1:
            raise ValueError(
                "double_step must not be True with more than one substep under "
                f'coupling="{coupling}", '
                f"got substeps = {count} for {names_of(subdomains)[i]!r}"
            )
    if all(double):
        raise ValueError(
            "double_step must not be True on all subdomains, or odd and even macro steps would be "
            "two unrelated runs"
        )
    return double


def checked_subdomains(subdomains: Any, *, may_be_empty: bool = False) -> tuple[Subdomain, ...]:
    if isinstance(subdomains, Subdomain):
        raise TypeError("subdomains must be a list of Subdomains, got a single one")
    items = tuple(listed(subdomains, "subdomains", "a list of Subdomains"))
    for s in items:
        if not isinstance(s, Subdomain):
            raise TypeError(f"subdomains must be Subdomains, got {s!r}")
    if not items and not may_be_empty:
        raise ValueError("subdomains must not be empty")
    if len(set(map(id, items))) < len(items):
        raise ValueError("subdomains must be different, got one of them twice")
    return items


@dataclass(frozen=True)
class Rows:
    """A constraint whose subdomains are known: the rows L_i by index of the subdomain, and g."""

    p: int
    matrices: dict[int, sp.csr_array]
    velocity: Any


def checked_constraints(
    constraints: Sequence[Constraint],
    subdomains: Sequence[Subdomain],
    names: Sequence[str],
    coupling: str,
) -> tuple[Rows, ...]:
    """The constraints of a user, with names looked up and numbers of dofs compared."""
    lookup = Lookup(subdomains, names)
    rows = [
        Rows(c.p, lookup.matrices(c.matrices, f"constraint {k}"), c.velocity)
        for k, c in enumerate(constraints)
    ]
    return _relative_to_start(rows) if coupling == "mean" else tuple(rows)


def _relative_to_start(groups: Sequence[Rows]) -> tuple[Rows, ...]:
    """Under mean coupling rows that hold single dofs keep the displacement with which they begin,
    by a prescribed velocity of zero."""
    return tuple(
        replace(group, velocity=np.zeros(group.p))
        if group.velocity is None and _holds_single_dofs(group)
        else group
        for group in groups
    )


def _holds_single_dofs(group: Rows) -> bool:
    entries = sum(np.diff(L.indptr) for L in group.matrices.values())
    return bool(np.all(entries == 1))


def two_sided_and_contacts(constraints: Any) -> tuple[tuple[Constraint, ...], tuple[Contact, ...]]:
    """The constraints of a user, and the contacts among them."""
    if constraints is None:
        return (), ()
    if isinstance(constraints, (Constraint, Contact)):
        constraints = (constraints,)
    constraints = listed(constraints, "constraints", "Constraints")
    for c in constraints:
        if not isinstance(c, (Constraint, Contact)):
            raise TypeError(f"constraints must be Constraints, got {c!r}")
    contacts = tuple(c for c in constraints if isinstance(c, Contact))
    return tuple(c for c in constraints if isinstance(c, Constraint)), contacts


class Lookup:
    """The subdomains of a coupler, found by themselves or by their names."""

    def __init__(self, subdomains: Sequence[Subdomain], names: Sequence[str]):
        self.subdomains, self.names = subdomains, names
        self.numbers: dict[Any, int] = {s: i for i, s in enumerate(subdomains)}
        self.numbers |= {name: i for i, name in enumerate(names)}

    def matrices(self, entries: Mapping[Any, Any], what: str) -> dict[int, sp.csr_array]:
        """Matrices by subdomain or name, by index of the subdomain."""
        matrices: dict[int, sp.csr_array] = {}
        for s, L in entries.items():
            i = self._number(s, what)
            if i in matrices:
                raise ValueError(f"{what} must not hold {self.names[i]!r} twice")
            matrices[i] = _rows(L, self.subdomains[i], s, what)
        return matrices

    def _number(self, s: Any, what: str) -> int:
        """The index of a subdomain of a constraint."""
        if s in self.numbers:
            return self.numbers[s]
        if isinstance(s, str):
            known = listing([repr(name) for name in self.names])
            raise ValueError(f"{what} must name subdomains of this coupler, {known}, got {s!r}")
        raise ValueError(f"{what} must hold subdomains of this coupler, got [{s!r}]")


def _rows(L: Any, subdomain: Any, s: Any, what: str) -> sp.csr_array:
    """The rows of a constraint on a subdomain that is given as s."""
    n = subdomain.n
    if isinstance(L, Chosen):
        try:
            return L.matrix(n, subdomain.dof_names)
        except (TypeError, ValueError) as error:
            raise type(error)(f"{what}: {error} of {s!r}") from None
    if L.shape[1] != n:
        raise ValueError(
            f"{what} must fit {s!r} of {counted(n, 'dof')}, got {counted(L.shape[1], 'column')}"
        )
    return L


def chosen_coupling(coupling: Any, count: int) -> Any:
    """The coupling of this number of subdomains: one subdomain needs none."""
    if coupling is not None:
        return coupling
    if count == 1:
        return "gc"  # single steps, as under all couplings; the one with every option
    lines = "".join(f"\n  {repr(name):8} {what}" for name, what in COUPLINGS.items())
    raise TypeError(f"coupling must be given for {counted(count, 'subdomain')}, one of{lines}")


class Options(NamedTuple):
    """The options of a coupler that are part of its problem, as it was made.

    Those with a default are not in a checkpoint where they have it: older versions lack them.
    """

    dt: float
    coupling: Coupling
    start: Start
    newton: Newton = DEFAULT

    @property
    def facts(self) -> dict[str, Any]:
        """The options by name, in the form in which problems are compared."""
        return {**self._asdict(), "newton": repr(self.newton)}

    def of_core(self, dt: float, threads: int, worthwhile: bool) -> dict[str, Any]:
        """The options of coupler.h by name, with the present macro step."""
        rebased = self.start == "rebased"
        return dict(dt=dt, rebased=rebased, threads=threads, worthwhile=worthwhile)


def checked_options(options: Options, count: int) -> Options:
    """The options of a coupler of this number of subdomains, with dt as a number; TypeError and
    ValueError for others than there are."""
    options = options._replace(coupling=chosen_coupling(options.coupling, count))
    check_word(options.coupling, "coupling", get_args(Coupling))
    check_word(options.start, "start", get_args(Start))
    if not isinstance(options.newton, Newton):
        raise TypeError(f"newton must be a Newton, got {options.newton!r}")
    return options._replace(dt=time_step(options.dt, "dt"))


def finest(substeps: Sequence[int], coupling: str) -> int:
    """The largest number of substeps; a multiple of all others, except under macro coupling."""
    fine = max(substeps)
    if fine > MOST_SUBSTEPS:
        raise ValueError(f"substeps must be at most {MOST_SUBSTEPS}, got {fine}")
    for count in substeps:
        if fine % count and coupling not in MACRO:
            raise ValueError(f"substeps must divide the largest, {fine}, got {count}")
    return fine


def most_threads(threads: int | None) -> tuple[int, bool]:
    """The maximum number of threads, and whether to use fewer where more are not faster."""
    if threads is not None:
        return useful_threads(whole_number(threads, "threads", low=1)), False
    return processors(), True


def useful_threads(threads: int) -> int:
    """A number of threads that have a processor each."""
    return min(threads, processors())


def processors() -> int:
    """The number of processors on which this process may run."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def names_of(subdomains: Sequence[Subdomain]) -> list[str]:
    names = [f"subdomain {i}" if s.name is None else s.name for i, s in enumerate(subdomains)]
    if len(set(names)) < len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise ValueError(f"names of subdomains must be different, got {listing(twice)} twice")
    return names


@dataclass(frozen=True)
class Layout:
    """The lengths of all steps of a coupled problem, of the subdomains of all processes."""

    dt: float  # macro step
    substeps: tuple[int, ...]  # by subdomain
    doubles: tuple[bool, ...]  # which subdomains take double steps
    # lengths of the double steps that span a change of the steps, in the macro step after it; None
    # for the others. Default: no subdomain has one.
    overs: tuple[float | None, ...] = ()
    staged: int = 0  # fine steps in a macro step where they are stages of a scheme of two, else 0

    def of(self, i: int) -> tuple[float, int, bool, float | None]:
        """Length and number of the substeps of subdomain i of all, whether steps are double, and
        the entry of `overs`."""
        over = self.overs[i] if self.overs else None
        return self.dt / self.substeps[i], self.substeps[i], self.doubles[i], over

    @property
    def spans_change(self) -> bool:
        return any(over is not None for over in self.overs)
