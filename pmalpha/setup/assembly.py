"""Set-up of a `Coupler`: `assemble` is its steps in order, line by line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import pmalpha._core as _core

from .._cached import Living, Once
from ..memory import one_thread
from ..problem import forms
from ..problem.forms import Factor, Operator
from ..problem.subdomain import Subdomain
from .combinations import Placed, require_combinations
from .contact_rows import Contacts
from .factors import Eliminations
from .interface import (
    check_mean,
    doubled_part,
    interface_factor,
    interface_matrix,
    is_symmetric_sum,
    iteration_of,
    prepare,
    prepare_iterated,
    prepare_mean,
    row_order,
)
from .judging import Made, judge, judge_steps, warn_of_order
from .link import Link
from .member import Member, Stepped, build, make_member
from .ranks import Ranks, joined, processes
from .rows import CoreRows
from .schedule import Layout, Options, Rows
from .start import InitialAccelerations

# Assemblies that are kept beside the first one, those used last.
KEPT = 32


@dataclass(frozen=True)
class Assembly:
    """A coupled problem for steps of one layout."""

    members: tuple[
        Member, ...
    ]  # the subdomains in elimination order, each with its object of the core
    core: _core.Coupler
    parts: dict[str, Any]  # what that is made of, by the names of csrc/core/describe/describe.h
    first: int = 0  # the number of the first of these subdomains among those of all processes


class Assemblies:
    """A coupled problem, ordered once, and its assemblies for the layouts that were asked for.

    links: L_i, independent rows, in the user's order.
    threads: (int, bool), maximum number of threads, and whether to use fewer where more are not
        faster.
    ranks: the processes, of which each has the subdomains in `keys`, and in other arguments.
    contacts: under "pm" and "gc".
    groups: the constraints of the user, of the subdomains of all processes.
    row_position: (p,) array of int, position of each constraint in the core's order.
    """

    def __init__(
        self,
        keys: Sequence[tuple[str, Subdomain]],
        links: Sequence[Link],
        p: int,
        layout: Layout,
        prescribed: Sequence[np.ndarray],
        *,
        options: Options,
        threads: tuple[int, bool],
        ranks: Ranks | None = None,
        contacts: Contacts | None = None,
        groups: Sequence[Rows] = (),
    ):
        self.ranks = ranks
        self.first_own = 0 if ranks is None else ranks.part.start
        self.options, self.coupling, self.threads = options, options.coupling, threads
        self.contacts = contacts
        self.keys = keys
        self._require_combinations(layout)

        # elimination order of each subdomain, and of the rows
        self._once = Once()
        steps = [layout.of(i) for i in range(self.first_own, self.first_own + len(keys))]
        N = [None] * len(keys) if contacts is None else contacts.links(len(keys))
        members = _ordered(keys, links, N, steps, options, threads[0], self._once)
        if options.coupling == "mean":
            check_mean(members)
        self.rows = row_order(members, p, ranks)
        self.row_position = np.argsort(self.rows)
        for member in members:
            member.L = member.L.with_rows(self.row_position)
        self.motions = tuple(forms.Motion(self.row_position[r], None) for r in prescribed)

        self._known: Living[Member] = Living()
        self._made: dict[Layout, Assembly] = {}
        self._masses: dict[str, Factor] = {}
        self.accelerations: InitialAccelerations | None = None
        self.first_layout = layout
        self.first = self._assemble(layout, members, (keys, links, groups))

    def of(self, layout: Layout) -> Assembly:
        """The assembly of a layout: a known one, or one with the factors that are known.

        Errors and warnings as of `Coupler`; nothing has changed after an error.
        """
        if layout == self.first_layout:
            return self.first
        made = self._made.pop(layout, None)
        if made is None:
            self._require_combinations(layout)
            try:
                made = self._assemble(layout, self._parts_of(layout))
            except MemoryError:
                if self.ranks is not None:
                    raise  # the others do not repeat it
                self._made.clear()  # and once more with their memory
                made = self._assemble(layout, self._parts_of(layout))
        self._made[layout] = made
        while len(self._made) > KEPT:
            del self._made[next(iter(self._made))]
        return made

    def _require_combinations(self, layout: Layout) -> None:
        touched = {} if self.contacts is None else self.contacts.N
        require_combinations(
            Placed(
                name,
                s,
                self.coupling,
                self.options.start,
                layout.doubles[i],
                touches=i in touched,
                beside_contact=self.contacts is not None,
            )
            for i, (name, s) in enumerate(self.keys, self.first_own)
        )

    def _parts_of(self, layout: Layout) -> tuple[Stepped, ...]:
        """The subdomains with these steps: known ones, and others that are not built yet."""
        members: list[Stepped] = []
        made: dict[int, dict[float, Operator]] = {}
        for (i, *_), member in self._known.items():
            made[i] = made.get(i, {}) | member.known
        for i, first in enumerate(self.first.members, self.first_own):
            known = self._known.get((i, *layout.of(i)))
            if known is None:
                h, substeps, double, over = layout.of(i)
                responds = _has_responses(self.coupling, substeps) and first.internal is None
                members.append(
                    first.unbuilt(
                        h=h,
                        substeps=substeps,
                        double=double,
                        over=over,
                        has_responses=responds,
                        known=made.get(i, {}),
                    )
                )
            else:
                members.append(known)
        return tuple(members)

    def _assemble(
        self, layout: Layout, ordered: tuple[Stepped, ...], first: tuple[Any, ...] | None = None
    ) -> Assembly:
        """Factor, couple and judge subdomains, of which some may be built already.

        first: what is judged of the first assembly besides.
        """
        # once, not for each factor; of a decorator a frame would be outside the package for `warn`
        try:
            with one_thread():
                members, new = self._built(layout, ordered)
                assembly = self._coupled(layout, members, new)
                made = Made(
                    members,
                    assembly.core,
                    self.coupling,
                    layout,
                    CoreRows(self.row_position, np.ones(self.rows.size)),
                    assembly.parts,
                    self.ranks,
                    self.contacts,
                )
                judge_steps(made, new) if first is None else judge(made, *first)
                for member in members:
                    if member.internal is None and self.coupling != "mean":
                        member.blocks.clear()  # they cost more than a sweep
                return assembly
        finally:
            self._once.clear()

    def _built(
        self, layout: Layout, ordered: Sequence[Stepped]
    ) -> tuple[tuple[Member, ...], list[Member]]:
        """All subdomains with their factors, Mbar = R D R^T, and those that had none."""
        if self.contacts is not None:
            names = [member.name for member in ordered]
            self.contacts.check_steps(names, layout.substeps, layout.doubles)
        shared = self._threads_of_tangents(ordered)
        members, new = [], []
        for member in ordered:
            if not isinstance(member, Member):
                if self.coupling == "mean" and member.name not in self._masses:
                    self._masses[member.name] = member.factor_of_mass()
                mass, threads = self._masses.get(member.name), member.tangent_threads(shared)
                member = build(member, mass, threads)
                new.append(member)
            members.append(member)
        return tuple(members), new

    def _coupled(
        self, layout: Layout, members: tuple[Member, ...], new: Sequence[Member]
    ) -> Assembly:
        macro, mean = self.coupling == "macro", self.coupling == "mean"
        p = self.rows.size
        if macro:
            prepare(new)  # unit responses
        if mean:
            prepare_mean(new)
        prepare_iterated(new, self.coupling)  # and their part of H, with internal forces

        # H = sum_i al2_i L_i Mbar_i^-1 L_i^T, and its factor
        H, H_start = self._interface_factors(layout, members)
        iteration = iteration_of(members, p, self.options.newton, macro or mean, self.ranks)

        # M = R D R^T, for the initial accelerations
        if self.accelerations is None:
            self.accelerations = InitialAccelerations(members, p, self.rows, self.ranks)

        schedule = self._schedule(iterated=iteration is not None)
        parts = {"p": p, "H_start": H_start, "H": H, "motions": self.motions}
        parts |= {"schedule": schedule, "iteration": iteration}
        parts |= {"options": self.options.of_core(layout.dt, *self.threads)}
        parts |= self._of_the_schedule(members)
        core = _core.Coupler(
            tuple(member.core for member in members),
            parts,
            processes(self.ranks, [member.parts for member in members]),
        )
        if self.contacts is not None:
            self.contacts.check_compliance(core, members)

        pairs = enumerate(members, self.first_own)
        for i, member in pairs:
            self._known[i, *layout.of(i)] = member
        return Assembly(members, core, parts, self.first_own)

    def _threads_of_tangents(self, members: Sequence[Stepped]) -> int:
        """The maximum number of threads that factor a tangent: subdomains whose tangents are large
        are factored at the same time, and share them."""
        most = self.threads[0]
        return max(1, most // max(1, sum(member.tangent_threads(most) > 1 for member in members)))

    def _schedule(self, *, iterated: bool) -> _core._Schedule:
        """The word of the core for what is done in a macro step."""
        if self.contacts is not None:
            return "contact"
        if self.coupling == "macro":
            return "shooting" if iterated else "macro"
        if self.coupling == "mean":
            return "mean shooting" if iterated else "mean"
        if iterated:
            return "iterated"
        return "fine"

    def _of_the_schedule(self, members: Sequence[Member]) -> dict[str, Any]:
        """What else the core needs of contacts and of mean coupling."""
        parts: dict[str, Any] = {}
        if self.contacts is not None:
            parts["contact"] = self.contacts.core(members)
        if self.coupling == "mean":
            parts["doubled"] = doubled_part(members, self.rows.size, self.ranks)
        return parts

    def _interface_factors(
        self, layout: Layout, members: Sequence[Member]
    ) -> tuple[Factor, Factor]:
        """The factor of H, and that of the first macro step, where all subdomains take single
        steps, or double steps that span a change.

        With internal forces, macro and mean coupling begin with those of the tangents at t = 0; pm
        and gc make their own, and get unit matrices.
        """
        p = self.rows.size
        iterated = joined(self.ranks, [member.tangent is not None for member in members])
        if self.coupling in ("pm", "gc") and any(iterated):
            unit = Factor(np.ones(p), None)
            return unit, unit
        start = layout.spans_change  # whose assembly takes the first macro step alone
        matrix = interface_matrix(members, p, start=start, ranks=self.ranks)
        symmetric = is_symmetric_sum(members, self.ranks)
        options: dict[str, Any] = {"symmetric": symmetric, "threads": self.threads[0]}
        H = interface_factor(matrix, self.rows, **options)
        H_start = H
        if any(joined(self.ranks, [member.double for member in members])) and not start:
            matrix = interface_matrix(members, p, start=True, ranks=self.ranks)
            H_start = interface_factor(matrix, self.rows, **options)
        return H, H_start


def _ordered(
    keys: Sequence[tuple[str, Subdomain]],
    links: Sequence[Link],
    contacts: Sequence[Link | None],
    steps: Sequence[tuple[float, int, bool, float | None]],
    options: Options,
    threads: int,
    once: Once,
) -> tuple[Stepped, ...]:
    """The subdomains in elimination order, with a warning of factors that take long to make."""
    eliminations = Eliminations()
    members = tuple(
        make_member(
            s,
            name,
            double,
            h,
            substeps,
            L,
            eliminations,
            once,
            threads=threads,
            has_responses=_has_responses(options.coupling, substeps),
            mean=options.coupling == "mean",
            reuses=options.newton.tangent == "reuse",
            N=N,
        )
        for (name, s), L, N, (h, substeps, double, _) in zip(keys, links, contacts, steps)
    )
    warn_of_order(members)
    return members


def _has_responses(coupling: str, substeps: int) -> bool:
    """Whether subdomains with `substeps` have link responses."""
    return coupling == "mean" or (coupling == "macro" and substeps > 1)
