"""Runs that choose the substeps of every subdomain by its local error, equations (Q5) and (Q6)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np

from .._checks import listing, positive_number
from ..errors import AccuracyWarning, warn
from ..problem.subdomain import Subdomain
from ..results import history_file
from ..results.energy import ENERGIES, OPTIONAL, Energy, balanced
from ..results.history import History
from ..results.outputs import chosen_outputs
from ..results.quantities import by_index, reduced, stacked
from ..results.recording import Recording, Wanted, chosen_dofs
from ..results.stored import contents_of, target
from ..results.times import errors_of
from ..setup.member import Member
from .advance import advance_to, choose
from .progress import DeferredSignals, Report, reporting
from .recorded_run import (
    Until,
    checked_until,
    is_met,
    own_record,
    record_present,
    recording_of,
    summed_works,
    write_master_of,
)
from .session import (
    Session,
    begin,
    check_call,
    in_any,
    require_possible,
    together,
)
from .snapshot import restore_snapshot, snapshot_of

# The most substeps that are chosen, a power of two.
MOST = 4096
# A rate of the error above this many tolerances: the macro step is repeated.
REPEATED = 4.0
# The energies that are joined, the works last.
KINDS = tuple(x for x in ENERGIES if x not in OPTIONAL)
# Substeps are halved below this x of (Q6), and more by this factor than needed above 1.
FEW, RESERVE = 0.35, 1.1


def run(
    session: Session,
    tolerance: Any,
    end: tuple[float | None, int | None],
    wanted: Wanted,
    until: Any,
    progress: Any,
) -> History:
    """`Coupler.run` with a tolerance; `end` is t_end and steps."""
    with together(session), DeferredSignals(session.guard) as signals:
        require_possible(session, "tolerance")
        until = checked_until(session, until)
        tolerances = checked_tolerance(tolerance, session.keys)
        path, first = checked_file(wanted.to(own_record(session, wanted))), session.done
        last = session.clock.end(*end, first)
        check_call(session, "run", last, wanted.every, wanted.energy, path is None)
        pieces = Pieces(session, wanted.in_memory())
        controller = Controller(tolerances, session.members, session.clock.dt)
        with reporting(progress, first, last) as report:
            history = chosen_run(session, controller, pieces, last, report, signals, until)
        if path is not None:
            history_file.write(path, *contents_of(history), is_new=not wanted.overwrite)
            write_master_of(session, path)
    session.last_history = None
    return history


def checked_tolerance(tolerance: Any, keys: Sequence[tuple[str, Subdomain]]) -> list[float | None]:
    """The tolerance of each subdomain, None where its substeps are not chosen."""
    if not isinstance(tolerance, Mapping):
        return [positive_number(tolerance, "tolerance")] * len(keys)
    tolerances: list[float | None] = [None] * len(keys)
    for i, r in by_index(tolerance, keys, "tolerance").items():
        tolerances[i] = positive_number(r, f"tolerance of {keys[i][0]!r}")
    return tolerances


def power_of_two(count: float) -> int:
    """The least power of two that is not smaller, at most `MOST`."""
    return int(min(2.0 ** np.ceil(np.log2(max(count, 1.0))), MOST))


class Controller:
    """Chooses substeps from powers of two.

    tolerances: list of (float or None), r, by subdomain.
    """

    def __init__(self, tolerances: list[float | None], members: Sequence[Member], dt: float):
        self.tolerances = tolerances
        self.least = [least_substeps(member, dt) for member in members]
        self.short: set[int] = set()  # subdomains that would need more than `MOST`

    def first(self, members: Sequence[Member]) -> tuple[int, ...]:
        """The present numbers of substeps as powers of two."""
        return tuple(
            max(power_of_two(member.substeps), least) for member, least in zip(members, self.least)
        )

    def wanted(
        self, rates: Sequence[float], substeps: Sequence[int]
    ) -> tuple[tuple[Any, ...], bool]:
        """The next numbers of substeps (Q6), and whether the macro step has to be repeated, for
        these subdomains."""
        chosen, repeated = list(substeps), False
        for i, (rate, r) in enumerate(zip(rates, self.tolerances)):
            if r is None:
                continue
            x, count = np.sqrt(rate / r), substeps[i]
            if x > 1.0:
                needed = RESERVE * x * count
                chosen[i] = max(power_of_two(needed), count)
                if needed > MOST:
                    self.short.add(i)
                repeated = repeated or (rate > REPEATED * r and chosen[i] > count)
            elif x < FEW and count > 1:
                chosen[i] = max(count // 2, self.least[i])
        return tuple(chosen), repeated


def least_substeps(member: Member, dt: float) -> int:
    """The least power of two with which explicit steps are below the critical one."""
    ratio = 0.0 if member.step_ratio is None else member.step_ratio.value
    if member.subdomain.scheme.explicit and member.step_ratio is None:
        return power_of_two(member.substeps)
    return power_of_two(ratio * dt / member.h) if ratio > 0.0 else 1


class Pieces:
    """What is kept of each macro step."""

    def __init__(self, session: Session, wanted: Wanted):
        self.session, self.every = session, wanted.every
        self.energy = bool(wanted.energy)
        outputs = chosen_outputs(wanted.outputs, session.keys)
        self.dofs = chosen_dofs(wanted.record, session.keys, outputs)
        self.wanted = replace(wanted, record=None, every=None)
        recording_of(session, 0, 0, wanted)  # refuses wrong arguments
        self.histories: list[History] = []
        self.works: dict[str, Any] = {name: 0.0 for name in KINDS[2:]}

    def recording(self) -> Recording:
        """Arrays for the next macro step."""
        step = self.session.core.step_count
        return recording_of(self.session, step, step + 1, self.wanted)

    def begin(self, recording: Recording) -> None:
        """Keep the present, the first row of all arrays."""
        present = recording.history(self.session.core.step_count)
        self.histories.append(self._reduced(present, slice(0, 1)))

    def keep(self, recording: Recording) -> None:
        """Keep the macro step that was recorded."""
        step = self.session.core.step_count
        piece = recording.history(step)
        if piece.energy:
            piece = replace(piece, energy=self._continued(piece.energy))
        if self.every is None:
            self.histories.append(self._reduced(piece, slice(1, None)))
        elif step % self.every == 0:
            self.histories.append(self._reduced(piece, slice(-1, None)))

    def _continued(self, energy: Energy) -> Energy:
        """Works from the beginning of the run; the next macro step begins where this one ends."""
        summed = {name: getattr(energy, name) + x for name, x in self.works.items()}
        self.works = {name: x[-1] for name, x in summed.items()}
        return replace(energy, **summed)

    def _reduced(self, piece: History, rows: slice) -> History:
        """Chosen dofs, and some rows of all arrays."""

        def some(x: np.ndarray) -> np.ndarray:
            return x[rows]

        history: History = reduced(piece, some, self.dofs)
        subdomains = tuple(s and replace(s, substep=None) for s in history.subdomains)
        return replace(history, subdomains=subdomains)

    def history(self) -> History:
        history: History = stacked(self.histories)
        if not self.energy:
            return history
        names = ("t", *KINDS)
        rows = [piece.energy for piece in self.histories]
        kinds = {name: np.concatenate([getattr(x, name) for x in rows]) for name in names}
        start = kinds["kinetic"][0] + kinds["strain"][0]
        return replace(history, energy=balanced(start, **kinds))


def rates_of(history: History) -> list[float]:
    """The largest local error of each subdomain in a macro step per unit of time (Q5)."""
    rates = []
    for s in history.subdomains:
        assert s is not None and s.substep is not None
        e = errors_of(s, np.arange(s.t.size - 1))
        rates.append(float(np.max(np.abs(e), initial=0.0)) / s.substep)
    return rates


def chosen_run(
    session: Session,
    controller: Controller,
    pieces: Pieces,
    end: int,
    report: Report | None,
    signals: DeferredSignals,
    until: Until | None,
) -> History:
    """Run up to macro step `end`, or until a condition is met; `last_history` is what was done,
    after an exception too."""
    session.last_history = None
    signals.during(begin, session)
    choose(session, controller.first(session.members))
    try:
        is_end = False
        while not is_end:
            before = session.core.step_count
            one_step(session, controller, pieces, end, report, signals)
            is_end = session.core.step_count == end
            if until is not None and session.core.step_count > before:
                is_end = signals.during(is_met, session, until) or is_end
    finally:
        if pieces.histories:
            session.last_history = history = pieces.history()
    if report is not None:
        signals.during(report, session.core.step_count)
    if controller.short:
        names = [repr(session.members[i].name) for i in sorted(controller.short)]
        warn(
            f"tolerance was not reached for {listing(names)} with the {MOST} substeps that are "
            "chosen at most; take a smaller dt",
            AccuracyWarning,
        )
    return history


def one_step(
    session: Session,
    controller: Controller,
    pieces: Pieces,
    end: int,
    report: Report | None,
    signals: DeferredSignals,
) -> None:
    """One macro step, kept or to be repeated with more substeps; none at the end of the run."""
    before, step = snapshot_of(session), session.core.step_count
    recording = pieces.recording()
    with summed_works(session, recording.conserved) if pieces.energy else nullcontext():
        record_present(session, recording)
        if not pieces.histories:
            pieces.begin(recording)
        if step == end:
            return
        try:
            signals.during(advance_to, session, step + 1, recording, report)
        except BaseException:
            if session.core.step_count > step:
                pieces.keep(recording)
            raise
        rates = rates_of(recording.history(step + 1))
        chosen, exceeded = controller.wanted(rates, [p.substeps for p in session.members])
        repeated = in_any(session, exceeded)
        if not repeated:
            pieces.keep(recording)
    if repeated:
        restore_snapshot(session, before)
    choose(session, chosen)


def checked_file(wanted: Wanted) -> Any:
    """The path of the file that is written at the end of the run, or None."""
    if wanted.append:
        raise ValueError("append must not be True with tolerance, whose file is written at its end")
    if wanted.record_to is not None:
        return target(wanted.record_to, may_exist=wanted.overwrite)
    if wanted.overwrite:
        raise ValueError("overwrite must come with record_to, got record_to=None")
    return None
