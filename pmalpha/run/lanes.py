"""Several load cases side by side in the core, which reads every matrix and factor once for all."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as NotDone
from threading import Event
from typing import Any

import numpy as np
from scipy import LowLevelCallable

from .._core import LANES, split_lanes
from ..problem.forces import Force, core_load, is_callback
from ..results.recording import Recording
from ..setup.part import Part
from .initial import StartValues
from .motion import Motion, all_known
from .progress import INTERVAL

# Fewer cases are run one after the other: a step of all lanes takes about twice that of one case.
FEWEST = 3


def lanes_are_possible(parts: Sequence[Part], motions: Sequence[Motion]) -> bool:
    """Whether no function of the user is evaluated by these subdomains and motions, and no
    specimen has limits."""
    functions = any(
        p.subdomain.has_functions
        or p.subdomain.limits is not None
        or p.feedback is not None
        or p.internal is not None
        for p in parts
    )
    return not functions and all_known(motions)


def fits(forces: Sequence[Force]) -> bool:
    """Whether a case with these forces can be one of several side by side."""
    return not any(isinstance(f, LowLevelCallable) or is_callback(f) for f in forces)


class Lanes:
    """`LANES` cases of one coupled problem.

    Number i of lane l is at ``i * LANES + l`` of every array of the core.

    Parameters
    ----------
    core : _core.Coupler
    parts : sequence of Part
    """

    def __init__(self, core: Any, parts: Sequence[Part]):
        self.parts = parts
        self.cores = tuple(part.core.in_lanes() for part in parts)
        self.core = core.in_lanes(self.cores)
        self.interface: list[np.ndarray] = []  # kept from one group to the next

    def start(
        self, start: StartValues, forces: Sequence[Sequence[Force]], motions: Sequence[Motion]
    ) -> None:
        """Set initial values, in `LANES` columns, and the forces of each case."""
        lam, g = start.lam.ravel(), start.g.ravel()
        for i, (part, core) in enumerate(zip(self.parts, self.cores)):
            core.start(*(x.ravel() for x in start.states[i]), lam)
            core.set_load(tuple(core_load(own[i], part.order) for own in forces))
        for k, motion in enumerate(motions):
            for lane in range(LANES):
                self.core.set_motion(k * LANES + lane, motion.core_load())
        self.core.start(0, lam, g)
        self.core.set_end_multipliers(np.concatenate([lam, lam, np.zeros(2)]))

    def advance(
        self, recordings: Sequence[Recording], end: int, report: Callable[[int], None] | None
    ) -> bool:
        """Run to macro step `end` and fill the recordings, one for each case.

        False when a value of any case is not finite; the recordings are then not filled.
        """
        records = [recording.core_record() for recording in recordings]
        begin, every = records[0][:2]
        selections = tuple(
            tuple(
                _in_lane(records[lane][2][i], lane) if lane < len(records) else None
                for lane in range(LANES)
            )
            for i in range(len(self.parts))
        )
        shapes = [(x.shape[0], x.shape[1] * LANES) for x in records[0][3:6]]
        if [x.shape for x in self.interface] != shapes:
            self.interface = [np.empty(shape) for shape in shapes]
        record = (begin, every, selections, *self.interface)
        self.core.record_present(record)
        if self.core.advance(end, record, report) is not None:
            return False
        for k, all_lanes in enumerate(self.interface):
            split_lanes(all_lanes, tuple(own[3 + k] for own in records))
        return True


class Group:
    """Cases that advance side by side, in a thread of their own or in that of the caller.

    Attributes
    ----------
    cases : list of int
    recordings : list of Recording
        One for each case.
    steps : int
        Macro steps done, of all cases together.
    is_finite : bool
        False where a value of one of the cases was not finite.
    """

    def __init__(self, lanes: Lanes, cases: list[int], recordings: list[Recording]):
        self.lanes, self.cases, self.recordings = lanes, cases, recordings
        self.steps, self.is_finite = 0, True
        self.future: Future[None] | None = None

    def advance(self, end: int, report: Callable[[], None]) -> None:
        def count(step: int) -> None:
            self.steps = step * len(self.cases)
            report()

        self.is_finite = self.lanes.advance(self.recordings, end, count)


class Crew:
    """Threads that advance groups of cases, at most `threads` at a time.

    With one thread it is that of the caller. An exception in the caller, Ctrl-C for example, ends
    the groups at hand within about 50 ms.

    Parameters
    ----------
    core : _core.Coupler
    parts : sequence of Part
    threads : int
    tell : callable
        Called by the caller's thread with the macro steps done of the groups at hand.
    """

    def __init__(self, core: Any, parts: Sequence[Part], threads: int, tell: Callable[[int], None]):
        self.core, self.parts, self.threads, self.tell = core, parts, threads, tell
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
        lanes = self.free.pop() if self.free else Lanes(self.core, self.parts)
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


def _in_lane(selection: tuple[Any, ...] | None, lane: int) -> tuple[Any, ...] | None:
    """What a case records of a subdomain, in the form of the core, for its lane."""
    if selection is None:
        return None
    position, u, v, w, springs, outputs, history = selection
    if springs is not None:
        springs = (springs[0] * LANES + lane, *springs[1:])
    if outputs is not None:
        combinations = (
            None if x is None else (x[0], x[1] * LANES + lane, x[2]) for x in outputs[1:]
        )
        outputs = (outputs[0], *combinations)
    return position * LANES + lane, u, v, w, springs, outputs, history
