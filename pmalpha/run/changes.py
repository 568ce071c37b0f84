"""Other steps in mid-run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from .._checks import real_number, time_step, whole_number
from ..problem.subdomain import Subdomain
from ..setup.assembly import Assemblies, Assembly, Layout
from ..setup.ranks import joined
from ..setup.schedule import double_steps, finest
from . import history_file
from .advance import advance
from .checkpoint import damaged
from .clock import Clock
from .history import History
from .interrupts import HeldSignals
from .keys import by_index
from .loads import Loads
from .progress import Report, reporting
from .recording import Recording
from .sampled import warn_of_skipped
from .tolerance import Controller, Pieces, checked_file, checked_tolerance, chosen_run
from .transfer import Steps, follow_energies, moves, take_over


class Changes:
    """The methods of `Coupler` that change its steps."""

    _keys: tuple[tuple[str, Subdomain], ...]
    _everything: Sequence[Any]
    _assemblies: Assemblies
    _loads: Loads
    _started: bool
    _last_history: History | None
    _entered: Any
    _guard: Any
    _together: Any
    _check_call: Any
    _own_record: Any
    _write_master: Any
    _ranks: Any
    _steps_done: Any
    coupling: Any

    def change_steps(
        self, dt: float | None = None, substeps: Mapping[Any, int] | None = None
    ) -> None:
        """Change the macro step, or numbers of substeps, from the present macro time level on.

        Displacements, velocities, accelerations and multipliers stay; the method keeps its order of
        accuracy over any sequence of changes. The factors of the 32 sets of steps used last are
        kept: a change back to one of them factors nothing.

        Parameters
        ----------
        dt : float, optional
            The new macro step, positive. Default: the present one.
        substeps : dict of int, optional
            New numbers of substeps by subdomain; with `comm` of those of this rank. Default: the
            present ones.

        Raises
        ------
        TypeError, ValueError, FactorizationError, MemoryError
            As when a Coupler is made with these steps, and if nothing is given. The coupler is then
            unchanged.

        Warns
        -----
        StabilityWarning
            When a new step is above its critical step.

        See Also
        --------
        run : With ``tolerance`` it chooses substeps.

        Notes
        -----
        Equations (Q1) to (Q4) of docs/method.md. Times are counted from the change: time levels
        are t_change + (k / max ss) dt, and `t_end` of `run` is a whole number of macro steps after
        t_change. `step_count` goes on.

        Under "pm", which subdomains take double steps follows from the new numbers as it does when
        a Coupler is made. One with one substep that took double steps before takes a double step of
        length dt_old + dt_new over the change; others begin with a macro step of single steps.

        The steps belong to the state: `save`, `load`, `snapshot` and `restore` keep them, and
        `reset` returns to those with which the coupler was made, as `run_each` does for its cases.

        Examples
        --------
        >>> coupler = models.split_oscillator(10.0).coupler(0.05)
        >>> first = coupler.run(1.0)
        >>> coupler.change_steps(dt=0.01, substeps={"B": 2})
        >>> coupler.dt, coupler.step_count, coupler.time
        (0.01, 20, 1.0)
        >>> coupler.run(1.5)["B"].t.size
        101
        """
        with self._together():
            self._check_call("change_steps", dt)
            self._change(*self._checked_steps(dt, substeps))

    def _checked_steps(self, dt: Any, substeps: Any) -> tuple[float, tuple[int, ...]]:
        if dt is None and substeps is None:
            raise TypeError("give dt, substeps or both")
        present, first = self._steps.layout, self._assembly.first
        counts = list(present.substeps[first : first + len(self._keys)])
        for i, count in by_index(substeps, self._keys, "substeps").items():
            counts[i] = whole_number(count, f"substeps of {self._keys[i][0]!r}", low=1)
        all_counts = tuple(joined(self._ranks, counts))
        return present.dt if dt is None else time_step(dt, "dt"), all_counts

    def _change(self, dt: float, substeps: tuple[int, ...], clock: Clock | None = None) -> None:
        """Change to these steps at the present; nothing has changed after an error.

        With a clock, that of the present, time is counted on (without double steps).
        """
        finest(substeps, self.coupling)
        doubles = double_steps(self._everything, self.coupling, substeps)
        layout, step = Layout(dt, substeps, doubles), self._steps_done()
        if layout == self._steps.layout:
            return
        steps = self._steps.changed(layout, step) if clock is None else Steps(layout, clock)
        self._assemblies.of(layout)  # what it lacks is found now, not after the first macro step
        new, old, before = self._assemblies.of(steps.present), self._assembly, self._steps
        loads = self._loads.with_steps(new.core, new.parts, steps.clock)
        found = None
        if self._started:
            found = moves(
                old,
                new,
                lambda i: before.lengths(i, step),
                lambda i: steps.lengths(i, step),
                first=True,
            )
        if clock is None:
            fine = layout.dt / new.core.instants
            warn_of_skipped(new.parts, loads.forces, loads.motions, fine)
        if self._ranks is not None:
            self._ranks.share(None)  # from here on nothing fails
        loads.to_core()
        if found is not None:
            take_over(old, new, found, steps.clock)
        else:  # an assembly of earlier steps has the time of theirs
            new.core.set_origin(steps.clock.origin, steps.clock.t0)
        self._take(steps, new)
        self._loads, self._last_history = loads, None

    # ---- chosen steps ------------------------------------------------------------------------

    def _run_with_tolerance(
        self,
        tolerance: Any,
        end: tuple[float | None, int | None],
        chosen: dict[str, Any],
        files: tuple[Any, bool, bool],
        progress: Any,
    ) -> History:
        """`Coupler.run` with a tolerance."""
        with self._together(), HeldSignals(self._guard) as held:
            tolerances = checked_tolerance(tolerance, self.coupling, self._keys)
            path, begin = checked_file(self._own_record(*files), *files[1:]), self._steps_done()
            last = self._clock.end(*end, begin)
            self._check_call("run", last, chosen["every"], chosen["energy"], path is None)
            pieces = Pieces(self, chosen)
            controller = Controller(tolerances, self._parts, self._clock.dt)
            with reporting(progress, begin, last) as report:
                history = chosen_run(self, controller, pieces, last, report, held)
            if path is not None:
                history_file.write(path, *history.contents())
                self._write_master(path)
        self._last_history = None
        return history

    def _choose(self, own: Sequence[int]) -> None:
        """Other substeps in macro steps that are counted on, under "gc"."""
        substeps = tuple(joined(self._ranks, own))
        steps, last = self._steps, self._last_history
        if substeps != steps.layout.substeps:
            self._change(steps.layout.dt, substeps, steps.clock)
            self._last_history = last

    # ---- checkpoints -------------------------------------------------------------------------

    def _steps_facts(self) -> dict[str, Any] | None:
        """What a checkpoint says of the steps; None if they are those of the beginning."""
        steps = self._steps
        if steps == Steps(self._assemblies.first_layout, Clock(self._assemblies.first_layout.dt)):
            return None
        overs = None if steps.first is None else list(steps.first.overs)
        facts = {"substeps": list(steps.layout.substeps), "first": overs}
        return facts | asdict(steps.clock)

    def _steps_of(self, path: Any, facts: Mapping[str, Any] | None) -> tuple[Steps, Assembly]:
        """The inverse, with the assembly of the next macro step."""
        if facts is None:
            layout = self._assemblies.first_layout
            return Steps(layout, Clock(layout.dt)), self._assemblies.first
        try:
            clock = Clock(
                time_step(facts["dt"], "dt"),
                whole_number(facts["origin"], "origin"),
                *(real_number(facts[name], name, low=0.0) for name in ("t0", "before")),
            )
            substeps = tuple(whole_number(k, "substeps", low=1) for k in facts["substeps"])
            if len(substeps) != len(self._everything):
                raise ValueError(
                    f"substeps of {len(self._everything)} subdomains, got {len(substeps)}"
                )
            finest(substeps, self.coupling)
            doubles = double_steps(self._everything, self.coupling, substeps)
            layout = Layout(clock.dt, substeps, doubles)
            first = (
                None if facts["first"] is None else replace(layout, overs=_overs(facts["first"]))
            )
            if first is not None and len(first.overs) not in (0, len(substeps)):
                raise ValueError(f"first of {len(substeps)} subdomains, got {len(first.overs)}")
        except (LookupError, TypeError, ValueError) as error:
            raise damaged(path, error) from None
        self._assemblies.of(layout)
        steps = Steps(layout, clock, first)
        return steps, self._assemblies.of(steps.present)

    # ---- inside ------------------------------------------------------------------------------

    def _take(self, steps: Steps, assembly: Assembly) -> None:
        """Continue with these steps and this assembly."""
        self._steps, self._assembly = steps, assembly
        self.__dict__.pop("_table", None)  # of the description

    def _take_first_steps(self) -> None:
        """The steps with which the coupler was made, for a start."""
        layout, first = self._assemblies.first_layout, self._assemblies.first
        self._take(Steps(layout, Clock(layout.dt)), first)
        first.core.set_origin(0, 0.0)
        if self._loads.core is not first.core or self._loads.clock != self._clock:
            self._loads = self._loads.with_steps(first.core, first.parts, self._clock)

    @property
    def _clock(self) -> Clock:
        return self._steps.clock

    @property
    def _parts(self) -> tuple[Any, ...]:
        return self._assembly.parts

    @property
    def _core(self) -> Any:
        return self._assembly.core

    @property
    def _fine(self) -> int:
        """Interface problems in a macro step."""
        return self._core.instants

    def _advance(self, end: int, recording: Recording | None, report: Report | None = None) -> None:
        record = None if recording is None else recording.core_record()
        if self._steps.first is not None and end > self._clock.origin:
            try:
                advance(
                    self._core, self._loads, self._clock.origin + 1, record, report, self._ranks
                )
            finally:
                self._take_regular_steps()
        advance(self._core, self._loads, end, record, report, self._ranks)

    def _take_regular_steps(self) -> None:
        """After the first macro step that follows a change, double steps are of length 2 h."""
        steps, old = self._steps, self._assembly
        if self._core.step_count == steps.clock.origin:
            return  # the macro step was not completed
        regular = Steps(steps.layout, steps.clock)
        new = self._assemblies.of(regular.layout)
        found = moves(
            old,
            new,
            steps.lengths_after_first,
            lambda i: regular.lengths(i, steps.clock.origin + 1),
            first=False,
        )
        loads = self._loads.moved_to(new.core, new.parts)
        follow_energies(old, new)
        take_over(old, new, found, steps.clock)
        self._take(regular, new)
        self._loads = loads


def _overs(given: Sequence[Any]) -> tuple[float | None, ...]:
    """The `overs` of a Layout from a file."""
    return tuple(None if x is None else time_step(x, "first") for x in given)
