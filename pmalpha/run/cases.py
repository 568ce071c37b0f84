"""Several load cases of one coupled problem, side by side in the core: `Coupler.run_each`."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as NotDone
from contextlib import contextmanager
from os import PathLike
from threading import Event
from typing import Any

import numpy as np

import pmalpha._core as _core

from .._checks import counted
from .._core import LANES, split_lanes
from ..errors import CasesError
from ..files import HDF5, checked_path
from ..memory import require
from ..problem.loads import Force, core_load, loads_of
from ..problem.subdomain import Subdomain
from ..results.cases import REDUCTIONS, CaseValues, Reducer
from ..results.energy import Loads
from ..results.history import History
from ..results.quantities import OF_CONSTRAINTS, CoreSelection, OutputRows
from ..results.recording import Recording, Wanted
from ..setup.member import Member
from ..setup.rows import ConstraintRows
from ..setup.start import InitialAccelerations
from .loads import InitialValues, StartValues, consistent_in_lanes, taken_from_start
from .motion import Motion, all_known
from .progress import INTERVAL, DeferredSignals, Report, reporting
from .recorded_run import recorded, recording_of
from .session import (
    Case,
    Session,
    checked_forces,
    masses_of,
    require_alone,
    return_to_start,
    take,
    take_first_steps,
    warn_of_records,
)
from .snapshot import restore_snapshot, snapshot_of

# Fewer cases are run one after the other: a step of all lanes takes about twice that of one case.
FEWEST = 3
ARGUMENTS = ("u0", "v0", "force")


def lanes_are_possible(members: Sequence[Member], motions: Sequence[Motion]) -> bool:
    """Whether no function of the user is evaluated by these subdomains and motions, and no
    specimen has limits."""
    functions = any(
        p.subdomain.has_functions
        or p.subdomain.limits is not None
        or p.feedback is not None
        or p.internal is not None
        for p in members
    )
    return not functions and all_known(motions)


def fits(forces: Sequence[Force]) -> bool:
    """Whether a case with these forces can be one of several side by side."""
    return not any(
        x._kind in ("of t", "compiled") or not x._in_lanes for f in forces for x in loads_of(f)
    )


class Lanes:
    """`LANES` cases of one coupled problem.

    Number i of lane l is at ``i * LANES + l`` of every array of the core.
    """

    def __init__(self, core: _core.Coupler, members: Sequence[Member]):
        self.members = members
        self.cores = tuple(member.core.in_lanes() for member in members)
        self.core = core.in_lanes(self.cores)
        self.interface: list[np.ndarray] = []  # kept from one group to the next

    def start(
        self, start: StartValues, forces: Sequence[Sequence[Force]], motions: Sequence[Motion]
    ) -> None:
        """Set initial values, in `LANES` columns, and the forces of each case."""
        lam, g = start.lam.ravel(), start.g.ravel()
        for i, (member, core) in enumerate(zip(self.members, self.cores)):
            u, v, w = (x.ravel() for x in start.states[i])
            core.start(u, v, w, lam)
            core.set_load(tuple(core_load(loads[i], member.order) for loads in forces))
        for k, motion in enumerate(motions):
            for lane in range(LANES):
                self.core.set_motion(k * LANES + lane, motion.core_load())
        self.core.start(0, lam, g)
        line = {"end_multipliers": np.concatenate([lam, lam, np.zeros(2)])}
        self.core.set_numbers(self.core.numbers() | line)

    def advance(
        self, recordings: Sequence[Recording], end: int, report: Callable[[int], None] | None
    ) -> bool:
        """Run to macro step `end` and fill the recordings, one for each case.

        False when a value of any case is not finite, or its steps have added energy that is to be
        reported; the recordings are then not filled, and what it was is found by each case alone.
        """
        records = [recording.core_record() for recording in recordings]
        selections = tuple(
            tuple(
                _in_lane(records[lane].selections[i], lane) if lane < len(records) else None
                for lane in range(LANES)
            )
            for i in range(len(self.members))
        )
        shapes = [(x.shape[0], x.shape[1] * LANES) for x in records[0].interface]
        if [x.shape for x in self.interface] != shapes:
            self.interface = [np.empty(shape) for shape in shapes]
        arrays: dict[str, Any] = dict(zip(OF_CONSTRAINTS, self.interface, strict=True))
        record = records[0]._replace(selections=selections, **arrays)
        self.core.record_present(record)
        if self.core.advance(end, record, report) is not None:
            return False
        if any(core.gain[2] > 0.0 or core.stiff[3] > 0.0 for core in self.cores):
            return False
        for all_lanes, *cases in zip(self.interface, *(x.interface for x in records)):
            split_lanes(all_lanes, tuple(cases))
        return True


class Group:
    """Cases that advance side by side, in a thread of their own or in that of the caller.

    steps: macro steps done, of all cases together.
    is_sound: False where a value of one of the cases was not finite, or steps added energy.
    """

    def __init__(self, lanes: Lanes, cases: list[int], recordings: list[Recording]):
        self.lanes, self.cases, self.recordings = lanes, cases, recordings
        self.steps, self.is_sound = 0, True
        self.future: Future[None] | None = None

    def advance(self, end: int, report: Callable[[], None]) -> None:
        def count(step: int) -> None:
            self.steps = step * len(self.cases)
            report()

        self.is_sound = self.lanes.advance(self.recordings, end, count)


class Crew:
    """Threads that advance groups of cases, at most `threads` at a time.

    With one thread it is that of the caller. An exception in the caller, Ctrl-C for example, ends
    the groups at hand within about 50 ms.

    tell: called by the caller's thread with the macro steps done of the groups at hand.
    """

    def __init__(
        self,
        core: _core.Coupler,
        members: Sequence[Member],
        threads: int,
        tell: Callable[[int], None],
    ):
        self.core, self.members, self.threads, self.tell = core, members, threads, tell
        self.pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self.free: list[Lanes] = []
        self.at_hand: deque[Group] = deque()
        self.stop = Event()

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, *exception: object) -> None:
        self.stop.set()
        if self.pool is not None:
            self.pool.shutdown()

    def room(self) -> Iterator[Group]:
        """The first group at hand when it is done, if no thread is free."""
        if self.at_hand and len(self.at_hand) >= self.threads:
            yield self._awaited()

    def rest(self) -> Iterator[Group]:
        """All groups at hand, each when it is done."""
        while self.at_hand:
            yield self._awaited()

    def begin(
        self,
        cases: list[int],
        start: StartValues,
        forces: Sequence[Sequence[Force]],
        recordings: list[Recording],
        motions: Sequence[Motion],
        end: int,
    ) -> None:
        """Begin to advance a group of cases; with one thread it is then done."""
        lanes = self.free.pop() if self.free else Lanes(self.core, self.members)
        lanes.start(start, forces, motions)
        group = Group(lanes, cases, recordings)
        self.at_hand.append(group)
        if self.pool is None:
            group.advance(end, lambda: self.tell(group.steps))
        else:
            group.future = self.pool.submit(group.advance, end, self._check)

    def _check(self) -> None:
        if self.stop.is_set():
            raise InterruptedError

    def _awaited(self) -> Group:
        group = self.at_hand[0]
        while group.future is not None:
            try:
                group.future.result(timeout=INTERVAL)
                break
            except NotDone:
                self.tell(sum(other.steps for other in self.at_hand))
        self.free.append(self.at_hand.popleft().lanes)
        return group


def _in_lane(selection: CoreSelection | None, lane: int) -> CoreSelection | None:
    """What a case records of a subdomain, in the form of the core, for its lane."""
    if selection is None:
        return None
    springs, outputs = selection.springs, selection.outputs
    if springs is not None:
        springs = springs._replace(number=springs.number * LANES + lane)
    if outputs is not None:
        values, *combinations = outputs
        moved = (x and x._replace(position=x.position * LANES + lane) for x in combinations)
        outputs = OutputRows(values, *moved)
    position = selection.position * LANES + lane
    return selection._replace(position=position, springs=springs, outputs=outputs)


def checked_cases(
    cases: Any,
    keys: Sequence[tuple[str, Subdomain]],
    rows: ConstraintRows,
    motions: Sequence[Motion],
    tied: bool,
) -> list[Case]:
    wrong_kind = isinstance(cases, (str, Mapping)) or hasattr(cases, "ndim")  # of arrays
    if wrong_kind or not isinstance(cases, Iterable):
        raise TypeError(f"cases must be a list of dicts, got {cases!r}")
    checked: list[Case] = []
    plain: InitialValues | None = None  # of all cases without initial values of their own
    masses = masses_of(keys)
    for k, case in enumerate(cases):
        if not isinstance(case, Mapping):
            raise TypeError(f"cases[{k}] must be a dict of arguments of reset, got {case!r}")
        wrong = [repr(name) for name in case if name not in ARGUMENTS]
        if wrong:
            allowed = ", ".join(map(repr, ARGUMENTS))
            raise TypeError(f"cases[{k}] must have no other keys than {allowed}, got {wrong[0]}")
        has_own = bool(case.keys() - {"force"})
        known = None if has_own else plain
        try:
            initial = known or InitialValues(keys, rows, case.get("u0"), case.get("v0"))
            forces = checked_forces(keys, case.get("force"), masses)
            if known is None:
                initial.check(motions, tied=tied)
            checked.append(Case(initial, forces))
        except (TypeError, ValueError) as error:
            raise type(error)(f"cases[{k}]: {error}") from None
        plain = plain if has_own else initial
    if not checked:
        raise ValueError(
            f"cases must have at least one case, got none in {cases!r}; a generator is read once"
        )
    return checked


def checked_paths(record_to: Any, count: int) -> list[Any]:
    """One path for each case, or None."""
    if record_to is None:
        return [None] * count
    if isinstance(record_to, (str, bytes, PathLike)) or not isinstance(record_to, Iterable):
        raise TypeError(f"record_to must be a list of paths, one for each case, got {record_to!r}")
    paths = list(record_to)
    if len(paths) != count:
        raise ValueError(
            f"record_to must have one path for each of {counted(count, 'case')}, got {len(paths)}"
        )
    if len({str(path) for path in paths}) != count:
        raise ValueError("record_to must have a path of its own for each case, got one twice")
    for path in paths:
        checked_path(path, "record_to", HDF5)
    return paths


class Results:
    """The Histories of the cases that are done, and the exceptions of those that failed.

    reducer: what takes the Histories in their place, or None.
    """

    def __init__(self, count: int, reducer: Reducer | None):
        self.histories: list[Any] = [None] * count
        self.reducer = reducer
        self.failures: dict[int, Exception] = {}

    def put(self, k: int, history: History) -> None:
        if self.reducer is None:
            self.histories[k] = history
        else:
            self.reducer.take(k, history)

    def fail(self, k: int, error: Exception, history: History | None) -> None:
        self.failures[k] = error
        if self.reducer is None:
            self.histories[k] = history

    def all(self) -> list[History] | CaseValues:
        """The Histories or their values; CasesError if a case failed."""
        values = None if self.reducer is None else self.reducer.values
        if self.failures:
            failures = dict(sorted(self.failures.items()))
            error = CasesError(failures, self.histories, values)
            raise error from next(iter(failures.values()))
        return self.histories if values is None else values


class Plan:
    """The cases of one call, what is recorded of them, and how far they are."""

    def __init__(
        self,
        cases: Sequence[Case],
        paths: Sequence[Any],
        end: int,
        wanted: Wanted,
        recording: Recording,
        report: Report | None,
        results: Results,
    ):
        self.cases, self.paths, self.end, self.wanted = cases, paths, end, wanted
        self.recording, self.report, self.results = recording, report, results
        self.done = 0  # macro steps of cases that are done
        self.spare: list[Recording] = []  # of cases that are reduced, for others

    def tell(self, steps: int) -> None:
        """Report macro steps of cases that are not done, if a report is due."""
        if self.report is not None:
            self.report.begin = 0
            self.report.if_due(self.done + steps)

    def memory(self, count: int) -> Sequence[Recording | np.ndarray]:
        """In what some cases record: records that are done, or one block for all, of which the
        system gives larger pages at a time."""
        if len(self.spare) >= count:
            return [self.spare.pop() for _ in range(count)]
        return list(np.empty((count, self.recording.block.size)))

    def finish(self, count: int) -> None:
        self.done += count * self.end
        self.tell(0)


def run_each(
    session: Session,
    cases: Iterable[Mapping[str, Any]],
    end: tuple[float | None, int | None],
    wanted: Wanted,
    progress: Any,
    reduce: str | None,
) -> list[History] | CaseValues:
    """`Coupler.run_each`; `end` is t_end and steps, and `record_to` a file for each case."""
    require_alone(session, "run_each")
    check_reduce(reduce, wanted.record_to, wanted.energy)
    with session.guard:
        motions, tied = session.loads.motions, session.coupling == "mean"
        checked = checked_cases(cases, session.keys, session.rows, motions, tied)
        warn_of_records(session, checked)
        paths = checked_paths(wanted.record_to, len(checked))
        reducer = None if reduce is None else Reducer(reduce, len(checked))
        results = Results(len(checked), reducer)
        with restoration(session):
            last = session.clock.end(*end, 0)
            together = LANES * max(session.threads_allowed[0], 1)
            at_hand = paths if reduce is None else paths[:together]
            recording = checked_recording(session, last, at_hand, wanted)
            with reporting(progress, 0, last * len(checked)) as report:
                plan = Plan(checked, paths, last, wanted, recording, report, results)
                run_groups(session, groups_of(session, plan), plan)
                if report is not None:
                    report.end()
        return results.all()


def check_reduce(reduce: Any, record_to: Any, energy: Any) -> None:
    if reduce is None:
        return
    if reduce not in REDUCTIONS:
        names = ", ".join(map(repr, REDUCTIONS))
        raise ValueError(f"reduce must be one of {names}, or None, got {reduce!r}")
    for name, value in (("record_to", record_to), ("energy", energy)):
        if value not in (None, False):
            raise ValueError(f"reduce must be None with {name}, got {reduce!r}")


def checked_recording(
    session: Session, end: int, paths: Sequence[Any], wanted: Wanted
) -> Recording:
    """Errors of the arguments of the recordings, before the first case begins.

    Returns one of them, the pattern for all where nothing is written to files.
    """
    count = 0.0
    for path in set(paths) or {None}:
        recording = recording_of(session, 0, end, wanted.to(path), checks_loads=False)
        recording.release()
        count += recording.numbers_kept * paths.count(path)
    advice = "choose dofs with record= or fewer time levels with every="
    require(8.0 * count, f"the Histories of {counted(len(paths), 'case')}", advice)
    return recording


@contextmanager
def restoration(session: Session) -> Iterator[None]:
    """Everything about the coupler is restored afterwards; its steps are the first ones."""
    present = snapshot_of(session) if session.started else None
    steps = session.steps, session.assembly
    facts = session.initial, session.loads, session.started, session.was_reset, session.last_history
    session.was_reset = True  # the factor of M is kept for all cases
    try:
        take_first_steps(session)
        yield
    finally:
        if present is not None:
            restore_snapshot(session, present)
        session.initial, loads, session.started, session.was_reset, session.last_history = facts
        if present is None:  # the start has not evaluated the functions yet
            take(session, *steps)
            session.core.set_origin(0, 0.0)
            session.loads = loads
            session.loads.to_core()


def groups_of(session: Session, plan: Plan) -> list[list[int]]:
    """Cases that run side by side; those of one case run on the coupler itself."""
    possible = lanes_are_possible(session.members, session.loads.motions)
    possible = possible and not plan.wanted.energy and session.rows.contacts is None
    fitting = [
        k
        for k, (case, path) in enumerate(zip(plan.cases, plan.paths))
        if possible and path is None and fits(case.forces)
    ]
    groups = [fitting[i : i + LANES] for i in range(0, len(fitting), LANES)]
    groups = [group for group in groups if len(group) >= FEWEST]
    together = {k for group in groups for k in group}
    return groups + [[k] for k in range(len(plan.cases)) if k not in together]


def run_groups(session: Session, groups: Sequence[list[int]], plan: Plan) -> None:
    together = [group for group in groups if len(group) > 1]
    threads = min(session.threads_allowed[0], len(together))
    with Crew(session.core, session.members, threads, plan.tell) as crew:
        for group in together:
            for done in crew.room():
                finish_group(session, done, plan)
            ready = prepared(session, group, plan)
            if ready is None:
                for k in group:
                    run_case(session, k, plan)
            else:
                crew.begin(group, *ready, session.loads.motions, plan.end)
        for done in crew.rest():
            finish_group(session, done, plan)
    for group in groups:
        if len(group) == 1:
            run_case(session, group[0], plan)


def prepared(
    session: Session, group: list[int], plan: Plan
) -> tuple[StartValues, list[list[Force]], list[Recording]] | None:
    """What a group begins with, in `LANES` columns, of which the last case fills the rest; and
    the recordings. None where the initial values of a case fail."""
    cases = [plan.cases[k] for k in group]
    cases += [cases[-1]] * (LANES - len(cases))
    members, clock = session.members, session.clock
    forces = [
        [taken_from_start(member, force, clock) for member, force in zip(members, case.forces)]
        for case in cases
    ]
    try:
        recordings = [
            plan.recording.again([Loads(*pair) for pair in zip(plan.cases[k].forces, seen)], memory)
            for k, seen, memory in zip(group, forces, plan.memory(len(group)))
        ]
        if session.accelerations is None:
            p, rows = session.rows.p, session.core_rows.numbers
            session.accelerations = InitialAccelerations(session.members, p, rows)
        start = consistent_in_lanes(
            [case.initial for case in cases],
            forces,
            session.loads,
            session.core_rows,
            session.accelerations,
        )
    except Exception:  # of which case, is found by running each alone
        return None
    return start, forces, recordings


def finish_group(session: Session, group: Group, plan: Plan) -> None:
    if not group.is_sound:
        for k in group.cases:
            run_case(session, k, plan)
        return
    for k, recording in zip(group.cases, group.recordings):
        plan.results.put(k, recording.history(plan.end))
        if plan.results.reducer is not None:
            plan.spare.append(recording)
    plan.finish(len(group.cases))


def run_case(session: Session, k: int, plan: Plan) -> None:
    """One case on the coupler itself."""
    results, report = plan.results, plan.report
    session.last_history = None
    if report is not None:
        report.begin = -plan.done
    try:
        return_to_start(session, plan.cases[k])
        recording = recording_of(session, 0, plan.end, plan.wanted.to(plan.paths[k]))
        with recording, DeferredSignals(session.guard) as signals:
            results.put(k, recorded(session, recording, report, signals))
    except Exception as error:
        if report is not None and report.failed:
            raise
        results.fail(k, error, session.last_history)
    plan.finish(1)
