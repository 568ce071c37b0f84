"""Several load cases of one coupled problem: `Coupler.run_each`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike
from typing import Any, NamedTuple

from .._checks import counted
from .._core import LANES
from ..errors import CasesError
from ..memory import require
from ..problem.forces import Force, checked_force, depends_on_motion
from ..problem.subdomain import Subdomain
from ..setup.constraint_rows import ConstraintRows
from ..setup.start import InitialAccelerations
from .history import History
from .initial import InitialValues, StartValues, consistent_in_lanes
from .interrupts import HeldSignals
from .keys import by_index
from .lanes import FEWEST, Crew, Group, fits, lanes_are_possible
from .loads import Loads
from .motion import Motion
from .progress import Report, reporting
from .recording import Recording
from .sampled import seen_by

ARGUMENTS = ("u0", "v0", "force")


class Case(NamedTuple):
    """Initial values and the force on each subdomain."""

    initial: InitialValues
    forces: list[Force]


def checked_case(
    keys: Sequence[tuple[str, Subdomain]],
    rows: ConstraintRows,
    u0: Any = None,
    v0: Any = None,
    force: Any = None,
) -> Case:
    """The arguments of `Coupler.reset`, with those of the `Subdomain` where none is given."""
    return Case(InitialValues(keys, rows, u0, v0), checked_forces(keys, force))


def checked_forces(keys: Sequence[tuple[str, Subdomain]], force: Any) -> list[Force]:
    """The force on each subdomain, that of the `Subdomain` where none is given."""
    given = by_index(force, keys, "force")
    return [
        _checked_force(given[i], s, name) if i in given else s.force
        for i, (name, s) in enumerate(keys)
    ]


def _checked_force(force: Any, s: Subdomain, name: str) -> Force:
    checked = checked_force(force, s.n)
    if depends_on_motion(checked) and not s.has_feedback:
        raise ValueError(
            f"force of {name!r} can only be a function of t, u and v where that of the Subdomain "
            "is one"
        )
    return checked


def checked_cases(
    cases: Any,
    keys: Sequence[tuple[str, Subdomain]],
    rows: ConstraintRows,
    motions: Sequence[Motion],
    tied: bool,
) -> list[Case]:
    """The cases of `Coupler.run_each`; the error of a wrong one names its index."""
    wrong_kind = isinstance(cases, (str, Mapping)) or hasattr(cases, "ndim")  # of arrays
    if wrong_kind or not isinstance(cases, Iterable):
        raise TypeError(f"cases must be a list of dicts, got {cases!r}")
    checked: list[Case] = []
    plain: InitialValues | None = None  # of all cases without initial values of their own
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
            forces = checked_forces(keys, case.get("force"))
            if known is None:
                initial.check(motions, tied=tied)
            checked.append(Case(initial, forces))
        except (TypeError, ValueError) as error:
            raise type(error)(f"cases[{k}]: {error}") from None
        plain = plain if has_own else initial
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
    return paths


class Results:
    """The Histories of the cases that are done, and the exceptions of those that failed."""

    def __init__(self, count: int):
        self.histories: list[Any] = [None] * count
        self.failures: dict[int, Exception] = {}

    def all(self) -> list[History]:
        """The Histories; CasesError if a case failed."""
        if self.failures:
            failures = dict(sorted(self.failures.items()))
            raise CasesError(failures, self.histories) from next(iter(failures.values()))
        return self.histories


class Plan:
    """The cases of one call, what is recorded of them, and how far they are."""

    def __init__(
        self,
        cases: Sequence[Case],
        paths: Sequence[Any],
        end: int,
        chosen: Mapping[str, Any],
        recording: Recording,
        report: Report | None,
        results: Results,
    ):
        self.cases, self.paths, self.end, self.chosen = cases, paths, end, chosen
        self.recording, self.report, self.results = recording, report, results
        self.done = 0  # macro steps of cases that are done

    def tell(self, steps: int) -> None:
        """Report macro steps of cases that are not done, if a report is due."""
        if self.report is not None:
            self.report.begin = 0
            self.report.if_due(self.done + steps)

    def finish(self, count: int) -> None:
        self.done += count * self.end
        if self.report is not None:
            self.report.begin = 0
            self.report.if_due(self.done)


class Cases:
    """The method of `Coupler` that runs several load cases."""

    _keys: Any
    _options: dict[str, Any]
    _threads_allowed: tuple[int, bool]
    _parts: Any
    _core: Any
    _require_alone: Any
    _rows: Any
    _core_rows: Any
    _initial_accelerations: InitialAccelerations | None
    _clock: Any
    _loads: Loads
    _initial: InitialValues
    _started: bool
    _was_reset: bool
    _last_history: History | None
    _entered: Any
    _guard: Any
    _recording: Any
    _run: Any
    _judge: Any
    _return_to_start: Any
    _warn_of_records: Any
    _steps: Any
    _assembly: Any
    _take: Any
    _take_first_steps: Any
    _snapshot: Any
    _restore: Any
    coupling: Any

    def run_each(
        self,
        cases: Iterable[Mapping[str, Any]],
        t_end: float | None = None,
        *,
        steps: int | None = None,
        record: Mapping[Any, Any] | None = None,
        every: int | None = None,
        energy: bool = False,
        record_to: Iterable[str | PathLike[str]] | None = None,
        overwrite: bool = False,
        record_springs: Mapping[Any, Any] | None = None,
        outputs: Mapping[Any, Any] | None = None,
        progress: Any = None,
    ) -> list[History]:
        """Run several load cases from t = 0, each equal to ``reset(**case)`` and `run`.

        Eight cases at a time advance side by side, so that matrices and factors are read once for
        all of them, and each of the ``threads`` of the `Coupler` has eight; the results are bitwise
        identical to those of single runs. The coupler itself is not changed: its present state,
        loads and `last_history` are those before the call.

        Parameters
        ----------
        cases : iterable of dict
            For each case a dict of arguments of `reset`: ``u0``, ``v0``, ``force``, each a dict by
            subdomain. What is left out is that of the `Subdomain`.
        t_end : float
            As for `run`, from t = 0. Give this or `steps`.
        steps : int
            As for `run`.
        record : dict, optional
            As for `run`, the same for all cases, and so are the next two.
        every : int, optional
            As for `run`.
        energy : bool, default False
            As for `run`.
        record_to : iterable of str or path, optional
            One HDF5 file for each case.
        overwrite : bool, default False
            Replace existing files of `record_to`.
        record_springs : dict, optional
            As for `run`, the same for all cases.
        outputs : dict, optional
            As for `run`, the same for all cases.
        progress : True or callable, optional
            As for `run`, in macro steps of all cases together.

        Returns
        -------
        list of History
            One for each case.

        Raises
        ------
        TypeError, ValueError, ConstraintError
            For wrong arguments, before the first case begins; the message names the case.
        CasesError
            When cases failed, by an InstabilityError, a ConvergenceError or an exception of a load
            or restoring force. The other cases are completed first; `CasesError.histories` has
            them and `CasesError.failures` the exceptions.
        MemoryError
            When the Histories of all cases together exceed the available memory.
        OSError
            When a file of `record_to` exists or its path cannot be written; found before the first
            case begins. A file that cannot be written later is a failure of its case.

        Warns
        -----
        AccuracyWarning, StabilityWarning, ConstraintWarning
            As `run` and `reset` do.

        Notes
        -----
        Cases advance side by side where all that is evaluated in a step is known to the core:
        constant and sampled loads, base accelerations, springs. Cases with a load that is a
        function run one after the other, and so do all cases of a coupler with restoring or
        internal forces that are functions, with callable prescribed velocities, or with
        ``drift="removed"``, and all cases with ``energy=True`` or `record_to`. Groups of less than
        three cases run one after the other too, and those in which a case fails run again so.

        Ctrl-C and an exception of `progress` end the call at once. What a Python function of the
        user itself remembers is not restored.

        Examples
        --------
        Three initial velocities, and a load:

        >>> mass = Subdomain([1.0], [4.0], scheme=Newmark(), name="mass")
        >>> coupler = Coupler([mass], dt=0.01)
        >>> cases = [{"v0": {"mass": [v]}} for v in (1.0, 2.0, 3.0)]
        >>> histories = coupler.run_each([*cases, {"force": {"mass": [1.0]}}], 1.0)
        >>> [float(np.round(history["mass"].u[-1, 0], 3)) for history in histories]
        [0.455, 0.909, 1.364, 0.354]
        >>> coupler.step_count
        0
        """
        chosen: dict[str, Any] = dict(record=record, every=every, energy=energy)
        chosen |= dict(record_springs=record_springs, outputs=outputs)
        self._require_alone("run_each")
        with self._entered():
            motions, tied = self._loads.motions, self.coupling == "mean"
            checked = checked_cases(cases, self._keys, self._rows, motions, tied)
            self._warn_of_records(checked)
            paths = checked_paths(record_to, len(checked))
            chosen |= dict(overwrite=overwrite)
            results = Results(len(checked))
            with self._kept():
                end = self._clock.end(t_end, steps, 0)
                recording = self._checked_recording(end, paths, chosen)
                with reporting(progress, 0, end * len(checked)) as report:
                    plan = Plan(checked, paths, end, chosen, recording, report, results)
                    self._run_groups(self._groups(plan), plan)
                    if report is not None:
                        report(plan.done)
            return results.all()

    def _checked_recording(
        self, end: int, paths: Sequence[Any], chosen: dict[str, Any]
    ) -> Recording:
        """Errors of the arguments of the recordings, before the first case begins.

        Returns one of them, the pattern for all where nothing is written to files.
        """
        kept = 0.0
        for path in set(paths) or {None}:
            recording = self._recording(0, end, path, **chosen)
            kept += recording.numbers_kept * paths.count(path)
        advice = "choose dofs with record= or fewer time levels with every="
        require(8.0 * kept, f"the Histories of {counted(len(paths), 'case')}", advice)
        return recording

    @contextmanager
    def _kept(self) -> Iterator[None]:
        """Everything about the coupler is restored afterwards; its steps are the first ones."""
        present = self._snapshot() if self._started else None
        steps = self._steps, self._assembly
        kept = self._initial, self._loads, self._started, self._was_reset, self._last_history
        self._was_reset = True  # the factor of M is kept for all cases
        try:
            self._take_first_steps()
            yield
        finally:
            if present is not None:
                self._restore(present)
            self._initial, loads, self._started, self._was_reset, self._last_history = kept
            if present is None:  # the start has not evaluated the functions yet
                self._take(*steps)
                self._core.set_origin(0, 0.0)
                self._loads = loads
                self._loads.to_core()

    def _groups(self, plan: Plan) -> list[list[int]]:
        """Cases that run side by side; those of one case run on the coupler itself."""
        possible = lanes_are_possible(self._parts, self._loads.motions)
        possible = possible and self._options["drift"] == "kept" and not plan.chosen["energy"]
        fitting = [
            k
            for k, (case, path) in enumerate(zip(plan.cases, plan.paths))
            if possible and path is None and fits(case.forces)
        ]
        groups = [fitting[i : i + LANES] for i in range(0, len(fitting), LANES)]
        groups = [group for group in groups if len(group) >= FEWEST]
        together = {k for group in groups for k in group}
        return groups + [[k] for k in range(len(plan.cases)) if k not in together]

    def _run_groups(self, groups: Sequence[list[int]], plan: Plan) -> None:
        together = [group for group in groups if len(group) > 1]
        threads = min(self._threads_allowed[0], len(together))
        with Crew(self._core, self._parts, threads, plan.tell) as crew:
            for group in together:
                for done in crew.room():
                    self._finish_group(done, plan)
                ready = self._prepared(group, plan)
                if ready is None:
                    self._run_one_by_one(group, plan)
                else:
                    crew.begin(group, *ready, self._loads.motions, plan.end)
            for done in crew.rest():
                self._finish_group(done, plan)
        for group in groups:
            if len(group) == 1:
                self._run_case(group[0], plan)

    def _prepared(
        self, group: list[int], plan: Plan
    ) -> tuple[StartValues, list[list[Force]], list[Recording]] | None:
        """What a group begins with, in `LANES` columns, of which the last case fills the rest; and
        the recordings. None where the initial values of a case fail."""
        cases = [plan.cases[k] for k in group]
        cases += [cases[-1]] * (LANES - len(cases))
        parts, clock = self._parts, self._clock
        forces = [
            [seen_by(part, force, clock) for part, force in zip(parts, case.forces)]
            for case in cases
        ]
        try:
            if self._initial_accelerations is None:
                p, rows = self._rows.p, self._core_rows.numbers
                self._initial_accelerations = InitialAccelerations(self._parts, p, rows)
            start = consistent_in_lanes(
                [case.initial for case in cases],
                forces,
                self._loads,
                self._core_rows,
                self._initial_accelerations,
            )
        except Exception:  # of which case, is found by running each alone
            return None
        return start, forces, [plan.recording.again() for _ in group]

    def _finish_group(self, group: Group, plan: Plan) -> None:
        if not group.is_finite:
            self._run_one_by_one(group.cases, plan)
            return
        histories = [recording.history(plan.end) for recording in group.recordings]
        for k, history in zip(group.cases, histories):
            plan.results.histories[k] = history
            try:
                self._judge(history)
            except Exception as error:  # a warning that is an error
                plan.results.failures[k] = error
        plan.finish(len(group.cases))

    def _run_one_by_one(self, group: Sequence[int], plan: Plan) -> None:
        for k in group:
            self._run_case(k, plan)

    def _run_case(self, k: int, plan: Plan) -> None:
        """One case on the coupler itself."""
        results, report = plan.results, plan.report
        self._last_history = None
        if report is not None:
            report.begin = -plan.done
        try:
            self._return_to_start(plan.cases[k])
            recording = self._recording(0, plan.end, plan.paths[k], **plan.chosen)
            with HeldSignals(self._guard) as held:
                results.histories[k] = self._run(recording, report, held)
        except Exception as error:
            if report is not None and report.failed:
                raise
            results.failures[k], results.histories[k] = error, self._last_history
        plan.finish(1)
