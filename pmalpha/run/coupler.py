"""The coupled problem: subdomains with different time steps, advanced by the C core."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from .._checks import without
from .._core import Guard
from ..problem.arguments import Coupling, Start
from ..problem.constraints import Constraint
from ..problem.forms import DEFAULT, Newton
from ..problem.springs import SpringState
from ..problem.subdomain import Subdomain
from ..results.history import History, SubdomainHistory
from ..results.recording import Wanted
from ..results.times import Instant
from ..setup.ranks import Ranks
from ..setup.schedule import Options
from . import advance, recorded_run, session
from . import snapshot as snapshots
from . import state as present
from .progress import reporting
from .session import (
    acting,
    begin,
    begun,
    checked_problem,
    checked_ties,
    factored,
    require_alone,
    require_linear,
)
from .snapshot import Snapshot
from .state import State, html_of, text_of

if TYPE_CHECKING:
    from ..gradients.gradient import Gradient
    from ..gradients.parameters import Misfit, Parameters
    from ..results.cases import CaseValues
    from ..setup.rows import Assembled
    from .error_budget import ErrorBudget
    from .estimate import ErrorEstimate
    from .growth import Growth

__all__ = ["Coupler", "solve"]


class Coupler:
    """Subdomains with different schemes and time steps, coupled by velocity constraints.

    Parameters
    ----------
    subdomains : sequence of `Subdomain`
        At least one. They are not changed.
    constraints : `Constraint` or list of them, optional
        The interface constraints, from `tie` or general ones. They must be independent.
    dt : float
        The macro step. Subdomain i takes substeps of dt / substeps_i; under "pm" and "gc" the
        largest number of substeps must be a multiple of all others.
    coupling : {"pm", "gc", "macro", "mean"}
        Required with more than one subdomain. "pm": interfield parallel, with double steps. "gc":
        staggered, single steps. "macro": one interface problem per macro step, order 2 with any
        numbers of substeps. "mean": as "macro", with tied displacements. docs/choosing.md helps to
        choose.
    start : {"rebased", "plain"}, default "rebased"
        "plain" begins double steps as the paper does, without re-basing their free velocity,
        equation (S3).
    newton : Newton, default Newton()
        How internal forces are iterated.
    threads : int, optional
        Maximum number of threads, including the caller, up to the number of processors on which the
        process may run; results are bitwise identical. Default: that number if the costs of
        equations (W1) to (W3) of docs/method.md predict a gain, else 1; while macro steps are
        faster in one thread than in several, which is timed now and then, one.
    comm : mpi4py.MPI.Intracomm, optional
        Processes that share the problem: `subdomains` are those of this rank, `constraints` the
        same on every rank, and all ranks make the same calls; see docs/many.md.

    Raises
    ------
    TypeError, ValueError
        For arguments of the wrong kind, and what the coupling does not do (docs/couplings.md). With
        `comm`, an error on one rank ends the call on all.
    ConstraintError
        For constraints that are dependent or that the initial velocities violate; under "mean" also
        for initial displacements that do.
    FactorizationError
        For a singular or indefinite matrix, with subdomain, dof and inertia.
    MemoryError
        For a problem whose predicted size exceeds the available memory.

    Warns
    -----
    StabilityWarning
        When a step is above its critical step, or the coupled step can grow; of small linear
        problems, when it does.
    PerformanceWarning
        When set-up takes long, or an explicit subdomain needs a large factor.
    ConstraintWarning
        When the initial displacements violate a constraint, and for a subdomain that the
        constraints do not reach or do not hold.
    AccuracyWarning
        When steps skip samples of a record that change the motion.

    Notes
    -----
    Equations (1) to (18) of docs/method.md; Bursi, He, Bonelli and Pegon 2008. The repr is a table
    of what each subdomain does: the length of its steps (2 h if they are double), the step divided
    by the critical step (an upper bound from 200 dofs on), its factor, and its thread.

    Examples
    --------
    A mass split in two halves, one with twenty substeps in each step of the other:

    >>> a = Subdomain([0.5], [2.0], scheme=GeneralizedAlpha(0.5), u0=[1.0], name="a")
    >>> b = Subdomain([0.5], [2.0], scheme=GeneralizedAlpha(0.5, explicit=True), substeps=20,
    ...               u0=[1.0], name="b")
    >>> coupler = Coupler([a, b], tie(a, [0], b, [0]), dt=0.01, coupling="pm")
    >>> history = coupler.run(1.0)
    >>> history["a"].u.shape, history["b"].u.shape, history.multipliers.shape
    ((101, 1), (2001, 1), (2001, 1))
    >>> bool(abs(history["b"].u[-1, 0] - np.cos(2.0)) < 1e-3)
    True
    """

    @without(drift='is gone since version 0.4; take coupling="mean", which has no drift')
    def __init__(
        self,
        subdomains: Sequence[Subdomain],
        constraints: Constraint | Sequence[Constraint] | None = None,
        *,
        dt: float,
        coupling: Coupling | None = None,
        start: Start = "rebased",
        newton: Newton = DEFAULT,
        threads: int | None = None,
        comm: Any = None,
    ):
        guard, ranks = Guard(), None if comm is None else Ranks(comm)
        with guard if ranks is None else ranks.entered(guard):
            options = Options(
                dt=dt,
                coupling=coupling,  # type: ignore[arg-type]  # None is resolved there
                start=start,
                newton=newton,
            )
            problem = checked_problem(subdomains, constraints, options, threads, ranks)
            ties = checked_ties(problem)
            assemblies = factored(problem, ties)
            loads = acting(problem, ties, assemblies.first)
            self._session = begun(guard, problem, ties, assemblies, loads)

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError("a Coupler cannot be copied or pickled: its state is in the C core")

    def __repr__(self) -> str:
        return text_of(self._session)

    def _repr_html_(self) -> str:
        return html_of(self._session)

    # ---- what it is ------------------------------------------------------------------------------

    @property
    def dt(self) -> float:
        """The macro step at present."""
        return self._session.steps.layout.dt

    @property
    def coupling(self) -> str:
        """The schedule by which the subdomains advance: "pm", "gc", "macro" or "mean"."""
        return self._session.coupling

    @property
    def subdomains(self) -> tuple[Subdomain, ...]:
        """The subdomains in their order; they cannot be changed here."""
        return tuple(subdomain for _, subdomain in self._session.keys)

    @property
    def threads(self) -> int:
        """Number of threads in use at present, including the caller."""
        return self._session.core.threads

    # ---- the present ----------------------------------------------------------------------------

    @property
    def step_count(self) -> int:
        """Number of completed macro steps."""
        with self._session.guard:
            return self._session.done

    @property
    def time(self) -> float:
        """The present time, equation (T1)."""
        with self._session.guard:
            return self._session.clock.time(self._session.done)

    @property
    def multipliers(self) -> np.ndarray:
        """Lam, (p,), at the present time; a copy."""
        s = self._session
        with s.guard:
            begin(s)
            return present.multipliers_of(s)

    def state(self, key: str | int | Subdomain) -> State:
        """Displacement, velocity and true acceleration of a subdomain at the present time.

        Parameters
        ----------
        key : str, int or Subdomain
            Its name, its index, or the subdomain itself.

        Returns
        -------
        State
            Copies.

        Raises
        ------
        KeyError, IndexError
            When there is no such subdomain.
        """
        return present.state(self._session, key)

    def springs(self, key: str | int | Subdomain) -> SpringState:
        """Deformation and force of the springs of a subdomain at the present time.

        Parameters
        ----------
        key : str, int or Subdomain
            Its name, its index, or the subdomain itself.

        Returns
        -------
        SpringState
            Copies.

        Raises
        ------
        KeyError, IndexError
            When there is no such subdomain.

        Examples
        --------
        >>> joint = Bilinear([0], k=4.0, fy=1.0)
        >>> frame = Subdomain([1.0], None, scheme=Newmark(), restoring=joint, u0=[1.0], name="f")
        >>> Coupler([frame], dt=0.1).springs("f").force
        array([1.])
        """
        return present.springs(self._session, key)

    @property
    def last_history(self) -> History | Any:  # not | None, which a checker would have tested
        """After an exception or Ctrl-C in `run`: the History up to the last complete macro step.

        After a run to the present time, which computes nothing: the History of the run before, if
        it still exists. Otherwise None.
        """
        return self._session.last_history

    # ---- running --------------------------------------------------------------------------------

    def run(
        self,
        t_end: float | None = None,
        *,
        steps: int | None = None,
        record: Mapping[Any, Any] | None = None,
        every: int | None = None,
        energy: bool = False,
        record_to: str | PathLike[str] | None = None,
        append: bool = False,
        overwrite: bool = False,
        record_springs: Mapping[Any, Any] | None = None,
        outputs: Mapping[Any, Any] | None = None,
        rig: bool = False,
        tolerance: float | Mapping[Any, float] | None = None,
        until: Callable[[Instant], bool] | None = None,
        progress: Any = None,
    ) -> History:
        """Advance from the present time and record.

        Parameters
        ----------
        t_end : float
            End of the run, a whole number of macro steps from 0. Give this or `steps`.
        steps : int
            Number of macro steps, 0 or more.
        record : dict, optional
            Dofs by subdomain: numbers, names or a mask, None for all of them; a subdomain left out
            is not recorded. Default: all.
        every : int, optional
            Record the first time level, and those at which `step_count` is a multiple of this.
        energy : bool, default False
            Record the energies of all subdomains in ``history.energy``, an `Energy`.
        record_to : str or path, optional
            New HDF5 file to which the History is written during the run; `History.load` reads it
            meanwhile and after a kill or a power failure. With `comm` one file per rank. It is
            locked: another run with the same file is refused.
        append : bool, default False
            Continue the file of `record_to` from the present state; rows after it are replaced. Not
            with energies.
        overwrite : bool, default False
            Replace an existing file before the first step.
        record_springs : dict, optional
            Springs of which deformation and force are recorded: indices by subdomain, None for all.
        outputs : dict, optional
            Linear combinations of the motion, such as base shears, by subdomain and name: a matrix
            W, (rows, n) or (n,), for W u, weights by dof, ``{"roof": 1.0, "floor": -1.0}``, names
            of dofs, or a dict of these by "u", "v" and "a"; in ``history[name].outputs[output]``.
            "absolute u", "absolute v" and "absolute a" add the motion of the ground under a
            `BaseAcceleration`: its exact integrals, from rest.
        rig : bool, default False
            Record what specimens behind actuators and compensators are commanded and give back, in
            ``history[name].rig``, a `RigRecord`.
        tolerance : float or dict of float, optional
            With "gc": choose substeps so that the local error of the displacements per unit of time
            stays below this, by the estimate and the rule of equations (Q5) and (Q6).
        until : callable, optional
            A condition, ``until(now) -> bool``, evaluated after each macro step: the run ends at
            the first at which it is True, at `t_end` at the latest. `now` is an `Instant`, as
            ``history.at(t)`` returns it: ``now.t``, ``now["frame"].u``, ``now.multipliers``. Not
            evaluated before the first step. Not with `comm`.
        progress : True or callable, optional
            True: a tqdm bar; or called as ``progress(done, total)`` about every 50 ms.

        Returns
        -------
        History
            From the present time to the end of the run.

        Raises
        ------
        TypeError, ValueError
            For wrong arguments or loads, and where `until` returns no bool.
        ConvergenceError
            When the iteration of internal forces does not converge.
        InstabilityError
            When a value is not finite, or the motion is beyond 1e100 of its beginning.
        CallbackError
            When a compiled function did not return 0.
        MemoryError, ImportError, OSError
            For a History beyond the memory, without tqdm or h5py, or if `record_to` exists, cannot
            be written, or is truncated, removed or replaced by another program during the run;
            `last_history` then has the rows, from the file and from memory.

        Warns
        -----
        StabilityWarning
            When steps are above a critical step found in the run, or forces add energy, equation
            (B10).
        AccuracyWarning
            When an estimate of the stiffness above that of the forces has acted as more than a
            fiftieth of the mass, equation (B13); when tied displacements have parted in the first
            steps by more than a tenth of the motion. With `tolerance`, when substeps reach their
            largest number.
        UserWarning
            For a run to the present time, which computes nothing.

        Notes
        -----
        After any exception, and after Ctrl-C, the coupler is at the last completed macro step,
        `last_history` has the run up to it, and the run can continue.

        Examples
        --------
        The force of a spring of stiffness 4, and no dof:

        >>> mass = Subdomain([1.0], [4.0], scheme=Newmark(), v0=[1.0], name="mass")
        >>> history = Coupler([mass], dt=0.01).run(1.0, record={}, outputs={"mass": {"N": [4.0]}})
        >>> history["mass"].outputs["N"].shape
        (101, 1)

        Up to the first macro step at which the displacement is falling:

        >>> coupler = Coupler([mass], dt=0.01)
        >>> history = coupler.run(1.0, until=lambda now: now["mass"].v[0] < 0.0)
        >>> coupler.time, coupler.time - 0.01 < np.pi / 4.0 < coupler.time
        (0.79, True)
        """
        s, end, file = self._session, (t_end, steps), (record_to, append, overwrite)
        wanted = Wanted(record, every, energy, record_springs, outputs, rig, *file)
        if tolerance is not None:
            from . import tolerance as tolerance_run

            return tolerance_run.run(s, tolerance, end, wanted, until, progress)
        return recorded_run.run(s, end, wanted, until, progress)

    def estimate_error(
        self,
        t_end: float | None = None,
        *,
        steps: int | None = None,
        halvings: int = 1,
        progress: Any = None,
    ) -> ErrorEstimate:
        """Estimate the error of the run from t = 0, by the same run with half the steps.

        With the present initial values, loads and steps. Half the macro step halves all substeps
        and double steps; with ``halvings=2`` there is a third run with a quarter of them, and the
        order of convergence is observed. The runs are those of new couplers: this one stays as it
        is. It takes the time of 3 runs, with two halvings of 7, and as many set-ups as runs.

        Parameters
        ----------
        t_end : float
            As for `run`, from t = 0. Give this or `steps`.
        steps : int
            As for `run`, at least 1.
        halvings : {1, 2}, default 1
            Number of finer runs.
        progress : True or callable, optional
            As for `run`, in macro steps of all runs together.

        Returns
        -------
        ErrorEstimate
            Has ``.relative``, ``.by_subdomain``, ``.place``, ``.order``, ``.dt_for(relative)`` and
            ``.history``, that of the run. Printed, it is a sentence.

        Raises
        ------
        ValueError
            Where a run cannot be repeated: with a specimen outside of this program (`rig.connect`,
            `rig.Client`), a function with the attribute ``repeatable = False``, and one whose first
            value in the second run differs from that in the first, since it has a memory. With
            `comm`.
        TypeError, ValueError, and others
            As `run`; an error of a finer run has a note that says so.

        Warns
        -----
        AccuracyWarning, StabilityWarning
            Of the first run, as `run` does.

        Notes
        -----
        Richardson's extrapolation, equation (D5) of docs/method.md. It is an estimate, as good as
        the difference of the two runs is small, and says nothing of what both have in common: the
        model, and means or samples of a load that no step sees. docs/right.md has measured values.

        Examples
        --------
        >>> coupler = models.split_oscillator(10.0).coupler(0.05, coupling="macro")
        >>> round(coupler.estimate_error(5.0).relative, 3)
        0.034
        >>> coupler.step_count
        0
        """
        from .estimate import estimate_error

        return estimate_error(self._session, type(self), (t_end, steps), halvings, progress)

    def growth(self, steps: int = 1000, *, seed: int = 0) -> Growth:
        """How the motion of this linear coupler grows without loads, for problems of any size.

        A power iteration: macro steps of eight random states side by side, with the present steps.
        Where it grows, so does every run, from a part of it that may be as small as rounding. The
        coupler stays as it is.

        Parameters
        ----------
        steps : int, default 1000
            Number of macro steps, at least 16. Slow growth takes many: see ``.settled``.
        seed : int, default 0
            Of the random velocities, which keep the constraints.

        Returns
        -------
        Growth
            Has ``.factor`` by which the largest motion grows in a macro step, ``.settled``,
            ``.subdomain`` and ``.grows``. Printed, it is a sentence.

        Raises
        ------
        ValueError
            For restoring and internal forces, loads ``f(t, u, v)`` and contact; with `comm`.
        InstabilityError
            When the motion leaves the range of floating-point numbers within a few steps.
        MemoryError
            For eight states beyond the memory.

        Notes
        -----
        `analysis.amplification_matrix` has all eigenvalues of a small problem.

        Examples
        --------
        >>> coupler = models.split_oscillator(10.0).coupler(0.05, coupling="macro")
        >>> found = coupler.growth(200)
        >>> round(found.factor, 3), found.grows
        (1.0, False)
        """
        from .growth import growth

        return growth(self._session, steps, seed)

    def error_budget(
        self, goal: Any, t_end: float, *, weights: str = "half", progress: Any = None
    ) -> ErrorBudget:
        """Where the error of one goal of the run comes from: which subdomain, or the coupling.

        Residuals of the run from t = 0, weighted by the adjoint of a run with half of all steps,
        equations (X1) to (X6) of docs/method.md. With the present initial values and loads; the
        runs are those of new couplers, this one stays as it is. It takes the time of some ten runs,
        and memory for the motion of all dofs at all time levels, about eight times.

        Parameters
        ----------
        goal : Goal or callable
            A `Goal`, or a function of a History that returns the value and its derivatives by u
            and v, as for `gradient`; it is called with runs of different steps.
        t_end : float
            As for `run`, from t = 0. A goal at a time before it ends the run there.
        weights : {"half", "same"}, default "half"
            The steps of the run of the adjoint. "same" takes the steps of the run itself: less
            work, and less reliable while steps are coarse.
        progress : True or callable, optional
            As for `run`, in macro steps of all runs together.

        Returns
        -------
        ErrorBudget
            Has ``.value``, ``.own``, ``.coupling``, ``.total``, ``.bound``, ``.corrected``,
            ``.by_step`` and ``.steps(tolerance)``. Printed, it is a sentence.

        Raises
        ------
        ValueError
            For what `gradient` refuses without differences, double steps, "gc" and "pm" with
            different numbers of substeps, and after `change_steps`; for functions that cannot be
            repeated, as `estimate_error`; for fewer than four macro steps.
        TypeError, KeyError, ValueError
            For a goal of the wrong kind, or dofs and times that the run does not have.

        Examples
        --------
        >>> coupler = models.split_oscillator(10.0).coupler(0.05, coupling="macro")
        >>> budget = coupler.error_budget(Goal("A", 0, at=2.0), 2.0)
        >>> max(budget.own, key=lambda name: abs(budget.own[name]))
        'A'
        >>> dt, substeps = budget.steps(0.01 * abs(budget.value))
        """
        from .error_budget import error_budget

        return error_budget(self._session, type(self), goal, t_end, weights, progress)

    def run_paced(
        self,
        t_end: float,
        *,
        rate: float = 1.0,
        on_late: str = "stop",
        priority: int | None = None,
        lock_memory: bool = False,
        record: Mapping[Any, Any] | None = None,
        every: int | None = None,
        energy: bool = False,
        record_to: str | PathLike[str] | None = None,
        append: bool = False,
        overwrite: bool = False,
        record_springs: Mapping[Any, Any] | None = None,
        outputs: Mapping[Any, Any] | None = None,
        rig: bool = False,
        progress: Any = None,
    ) -> History:
        """`run` at the pace of a clock: each fine step begins at its absolute time.

        For a specimen in a laboratory, given as ``restoring=``. Fine steps are those of the largest
        number of substeps; step k is due k h / `rate` after the first, equation (Y10). The command
        of a fine step is computed and given to the specimen when it begins. Limits of velocity and
        acceleration are checked by the clock too, equation (Y12). Results are bitwise those of
        `run`.

        Parameters
        ----------
        t_end : float
            As for `run`. The times of the problem are in seconds.
        rate : float, default 1
            Time of the problem per time of the clock: 0.01 is a slow test, a hundredfold.
        on_late : {"stop", "continue"}, default "stop"
            When a fine step ends after the next one was due. "stop": a `PacingError`. "continue":
            the next one, and all later ones, are due later, so that its command comes a period
            after the last; ``pacing.shift`` has by how much. No command is left out.
        priority : int, optional
            Priority of SCHED_FIFO for the calling thread during the steps, 1 to 99 on Linux. Needs
            special rights. Other threads do not inherit it. Default: that of the thread.
        lock_memory : bool, default False
            Lock all memory of the process during the steps, so that none is paged. Needs rights.
        record, every, energy : optional
            As for `run`.
        record_to : str or path, optional
            As for `run`, but a thread of its own writes the file, from a ring of 16 MB. The steps
            never wait for it: macro steps that find the ring full are NaN in the file, and counted
            in ``pacing.lost``. A file that cannot be written ends the run at once, and
            `last_history` has all of its steps.
        append, overwrite, record_springs, outputs, rig : optional
            As for `run`.
        progress : True or callable, optional
            As for `run`. It takes the GIL every 50 ms.

        Returns
        -------
        History
            With `Pacing` as ``pacing``: when each fine step was due, began, gave its command and
            had its force.

        Raises
        ------
        PacingError
            With ``on_late="stop"``.
        LimitError
            When the specimen would leave its `Limits`.
        OSError
            For `priority` and `lock_memory` without the rights, before the first step; the message
            has what is needed. For `record_to` as of `run`.
        ValueError
            Under "macro" and "mean", whose commands have no times of their own; with `comm`.
        TypeError, ValueError, and others
            As `run`.

        Notes
        -----
        The steps run in C in the calling thread, which sleeps until each is due. Nothing is
        allocated, no lock is waited for, and with compiled loads and a compiled specimen the GIL is
        not taken, so that other Python threads cannot delay a step. A Python callable takes it in
        each evaluation; ``f(t)`` is evaluated before the run, as far as 32 MB suffice. Under "pm"
        the double steps of coarse subdomains run in other threads, and delay a fine step only where
        it waits for them. docs/laboratory.md has measured times.

        Examples
        --------
        Ten steps at 1 kHz:

        >>> mass = Subdomain([1.0], [4.0], scheme=Newmark(), v0=[1.0], name="mass")
        >>> coupler = Coupler([mass], dt=0.001, coupling="gc")
        >>> history = coupler.run_paced(0.01, on_late="continue")
        >>> due = history.pacing.due - history.pacing.shift
        >>> due.round(6).tolist()[:3], bool(np.all(history.pacing.lateness >= 0.0))
        ([0.0, 0.001, 0.002], True)
        """
        from . import paced

        pace = paced.Pace(rate, on_late, priority, lock_memory)
        file = record_to, append, overwrite
        wanted = Wanted(record, every, energy, record_springs, outputs, rig, *file)
        return paced.run_paced(self._session, t_end, pace, wanted, progress)

    def monitor(
        self,
        path: str | PathLike[str] | None,
        dofs: Mapping[Any, Any] | None = None,
        *,
        rows: int = 10_000,
    ) -> None:
        """Let another process look at paced runs, through a file.

        Later `run_paced` write their last fine steps into the file, twenty times a second by a
        thread of its own: times, commands and measured forces. `pmalpha.rig.read_monitor` reads
        it; examples/live.py draws it.

        Parameters
        ----------
        path : str or path, or None
            Replaced when a run begins; in memory (/dev/shm on Linux) is best. None: no longer.
        dofs : dict, optional
            Dofs of specimens, subdomains with a restoring function, by name; None for all of one.
            Default: the first eight of each.
        rows : int, default 10 000
            Fine steps that are kept.

        Raises
        ------
        TypeError, ValueError, KeyError
            For arguments of the wrong kind.
        """
        from . import paced

        paced.monitor(self._session, path, dofs, rows)

    def step(self, n: int = 1) -> None:
        """Advance by n macro steps without a History.

        Raises as `run` does; the states are bitwise identical to those of `run`.

        Parameters
        ----------
        n : int, default 1
            Number of macro steps, 0 or more.
        """
        recorded_run.step(self._session, n)

    @overload
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
        reduce: None = None,
        progress: Any = None,
    ) -> list[History]: ...

    @overload
    def run_each(
        self,
        cases: Iterable[Mapping[str, Any]],
        t_end: float | None = None,
        *,
        steps: int | None = None,
        record: Mapping[Any, Any] | None = None,
        every: int | None = None,
        record_springs: Mapping[Any, Any] | None = None,
        outputs: Mapping[Any, Any] | None = None,
        reduce: Literal["peak", "last", "sum"],
        progress: Any = None,
    ) -> CaseValues: ...

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
        reduce: str | None = None,
        progress: Any = None,
    ) -> list[History] | CaseValues:
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
        every, energy : optional
            As for `run`.
        record_to : iterable of str or path, optional
            One HDF5 file for each case.
        overwrite : bool, default False
            Replace existing files of `record_to`.
        record_springs, outputs : dict, optional
            As for `run`, the same for all cases.
        reduce : {"peak", "last", "sum"}, optional
            Keep one value of each recorded quantity in place of its History: the largest absolute
            value, that at the end, or the sum over the recorded time levels. Not with `record_to`
            or `energy`.
        progress : True or callable, optional
            As for `run`, in macro steps of all cases together.

        Returns
        -------
        list of History
            One for each case; arrays of times are shared by them and read-only. With `reduce` a
            `results.case_values.CaseValues`: arrays with a row for each case,
            ``values["frame"].u`` (cases, dofs).

        Raises
        ------
        TypeError, ValueError, ConstraintError
            For wrong arguments, before the first case begins; the message names the case.
        CasesError
            When cases failed, by an InstabilityError, a ConvergenceError or an exception of a load
            or restoring force. The other cases are completed first; `CasesError.histories` has
            them and `CasesError.failures` the exceptions.
        MemoryError
            When the Histories of all cases together exceed the available memory; with `reduce`
            those that are at hand.
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
        internal forces that are functions or with callable prescribed velocities, and all cases
        with ``energy=True`` or `record_to`. Groups of less than
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
        >>> coupler.run_each(cases, 1.0, reduce="peak")["mass"].u.round(1).tolist()
        [[0.5], [1.0], [1.5]]
        """
        from . import cases as load_cases

        file = record_to, False, overwrite
        wanted = Wanted(record, every, energy, record_springs, outputs, False, *file)
        s, end = self._session, (t_end, steps)
        return load_cases.run_each(s, cases, end, wanted, progress, reduce)

    def reset(
        self,
        u0: Mapping[Any, Any] | None = None,
        v0: Mapping[Any, Any] | None = None,
        force: Mapping[Any, Any] | None = None,
    ) -> None:
        """Return to t = 0 and the steps with which the coupler was made, with all factors kept.

        If `change_steps` had changed them, a UserWarning says so.

        Exception: the factor of M for the initial accelerations. It is released after the start,
        computed again by the first reset, and kept from then on.

        Parameters
        ----------
        u0, v0, force : dict, optional
            Other initial values or loads by subdomain. Default: those of the `Subdomain`.

        Raises
        ------
        TypeError, ValueError, ConstraintError, InstabilityError
            As when the coupler was made. The coupler is then unchanged.
        """
        session.reset(self._session, u0, v0, force)

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
            When a new step is above its critical step, as when a Coupler is made.

        See Also
        --------
        run : With ``tolerance`` it chooses substeps.

        Notes
        -----
        The state is handed over by equations (Q1) to (Q4) of docs/method.md. Times are counted from
        the change: time levels are t_change + (k / max ss) dt, and `t_end` of `run` is a whole
        number of macro steps after t_change. `step_count` goes on.

        Under "pm", which subdomains take double steps follows from the new numbers as it does when
        a Coupler is made. One with one substep that took double steps before takes a double step of
        length dt_old + dt_new over the change; others begin with a macro step of single steps.

        The steps belong to the state: `save`, `load`, `snapshot` and `restore` keep them, and
        `reset` returns to those with which the coupler was made, as `run_each` does for its cases.

        Examples
        --------
        >>> coupler = models.split_oscillator(10.0).coupler(0.05, coupling="pm")
        >>> first = coupler.run(1.0)
        >>> coupler.change_steps(dt=0.01, substeps={"B": 2})
        >>> coupler.dt, coupler.step_count, coupler.time
        (0.01, 20, 1.0)
        >>> coupler.run(1.5)["B"].t.size
        101
        """
        advance.change_steps(self._session, dt, substeps)

    def gradient(
        self,
        objective: Misfit | Callable[[History], tuple[float, Mapping[str, Any]]],
        t_end: float | None = None,
        *,
        steps: int | None = None,
        parameters: Parameters | Sequence[Parameters] = (),
        block: int | None = None,
        differences: float | None = None,
        progress: Any = None,
    ) -> Gradient:
        """Value and gradient of a function of a linear run, for the price of about two more runs.

        The run begins at t = 0 with the present initial values and loads. The gradient is exact, to
        rounding, for the discrete run itself, and costs the same for any number of parameters: the
        adjoint of a run is a run of the same coupler in reversed time. The coupler stays as it is;
        no other thread may use it meanwhile.

        Parameters
        ----------
        objective : Misfit or callable
            A `Misfit`, or a function of the History that returns the value and its derivatives: by
            subdomain a dict with "u", "v", "a" of arrays (levels, dofs) like those of the History,
            and "multipliers", (levels, p); what is left out is zero.
        t_end : float
            As for `run`, from t = 0. Give this or `steps`.
        steps : int
            As for `run`.
        parameters : Parameters or sequence of them, optional
            What the matrices depend on. The gradients with respect to loads and initial values
            are always computed.
        block : int, optional
            Macro steps between two states that are kept. The memory is that of the states, and of
            the motion in one block. Default: what fits, at most 100. Rounding grows with it.
        differences : float, optional
            For problems without such an adjoint, see Raises: parameters only, by central
            differences of whole runs with each one changed by this step to both sides, two runs
            and two set-ups for each. Their error is that of the third derivatives, with the
            square of the step, and rounding of the value divided by the step: 1e-4 of a parameter
            leaves five to eight digits of what is smooth.
        progress : True or callable, optional
            As for `run`, in macro steps, twice those of the run; by differences in runs.

        Returns
        -------
        Gradient
            The value, its derivatives, and the History of the run.

        Raises
        ------
        ValueError
            Without `differences` for couplings and subdomains whose adjoint is not such a run:
            "mean" with another scheme than the trapezoidal rule, the plain start,
            restoring and internal forces, contacts, lagged damping, dofs without mass; always for
            `comm`, and after `change_steps`.
        TypeError, KeyError, ValueError
            For arguments and sources of the wrong kind or shape.

        Notes
        -----
        The adjoint of the discrete run, equations (A1) to (A17) of docs/method.md. Unsymmetric
        matrices, prescribed velocities and functions of the multipliers need couplers of their own
        for the reversed run.

        Examples
        --------
        The stiffness of a spring, from a displacement that was measured:

        >>> import pmalpha as pm
        >>> def spring(k):
        ...     return Coupler([Subdomain([1.0], [k], v0=[1.0], scheme=pm.Newmark(), name="m")],
        ...                    dt=0.1)
        >>> data = spring(4.0).run(2.0)["m"].u
        >>> misfit = pm.Misfit({"m": dict(dofs=[0], u=data)})
        >>> k = pm.Parameters("m", dofs=[[0]], K=[[1.0]])
        >>> value = lambda x: spring(x).gradient(misfit, 2.0).value
        >>> exact = spring(4.5).gradient(misfit, 2.0, parameters=k).parameters[0][0]
        >>> bool(abs((value(4.5 + 1e-5) - value(4.5 - 1e-5)) / 2e-5 / exact - 1.0) < 1e-7)
        True
        """
        from ..gradients import gradient as gradients

        if differences is None:
            require_linear(self._session, "gradient without differences=")
        require_alone(self._session, "gradient")
        end, report = (t_end, steps), partial(reporting, progress, 0)
        return gradients.gradient(
            self, self._session, objective, end, parameters, block, differences, report
        )

    def jacobian(
        self,
        sensors: Mapping[str, Any],
        t_end: float | None = None,
        *,
        steps: int | None = None,
        parameters: Parameters | Sequence[Parameters],
        what: str = "a",
        differences: float | None = None,
        progress: Any = None,
    ) -> dict[str, np.ndarray]:
        """How the motion at some dofs depends on parameters, for a linear run.

        Exact, to rounding: by one run for each parameter, or, where that is cheaper and u0 and v0
        are zero, by one run in reversed time for each sensor and each of its substeps in a macro
        step; eight runs at a time side by side. With dozens of parameters this and Gauss-Newton
        steps take less time than `gradient`; with hundreds of them and many sensors `gradient`
        does.

        Parameters
        ----------
        sensors : dict
            Dofs, an array of int, by name of the subdomain.
        t_end : float
            As for `run`, from t = 0 with the present initial values and loads. Give this or
            `steps`.
        steps : int
            As for `run`.
        parameters : Parameters or sequence of them
            What the matrices depend on.
        what : {"a", "v", "u"}
            The motion that is measured.
        differences : float, optional
            As for `gradient`.
        progress : True or callable, optional
            Called with the number of runs that are done.

        Returns
        -------
        dict of (levels, sensors, m) arrays
            By name of the subdomain; parameters in their order, of all `Parameters` one after the
            other.

        Raises
        ------
        ValueError
            As `gradient`, and for "pm" and "gc" with different substeps, where the interface matrix
            depends on the parameters.
        TypeError, KeyError
            For arguments of the wrong kind.

        Examples
        --------
        >>> import pmalpha as pm
        >>> mass = Subdomain([1.0], [4.0], v0=[1.0], scheme=Newmark(), name="mass")
        >>> k = pm.Parameters(mass, dofs=[[0]], K=[[1.0]])
        >>> S = Coupler([mass], dt=0.05).jacobian({"mass": [0]}, 1.0, parameters=k, what="u")
        >>> S["mass"].shape  # d/dk sin(sqrt(k) t) / sqrt(k) at k = 4, t = 1: -0.1088
        (21, 1, 1)
        >>> float(S["mass"][-1, 0, 0].round(3))
        -0.109
        """
        from ..gradients import gradient as gradients

        if differences is None:
            require_linear(self._session, "jacobian without differences=")
        require_alone(self._session, "jacobian")
        end, report = (t_end, steps), partial(reporting, progress, 0)
        return gradients.jacobian(
            self, self._session, sensors, end, parameters, what, differences, report
        )

    # ---- states that are kept -------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """The whole present state in memory, for `restore`.

        Displacements, velocities and accelerations, multipliers, the memory of springs and
        histories of internal forces, the previous time level of double steps, what iterations
        continue with, and the loads and initial values of the last `reset`. What a Python function
        of the user itself remembers is not part of it, nor is a file or a History.

        Returns
        -------
        Snapshot
            For this coupler only. It takes the memory of the state, without matrices and factors.

        Notes
        -----
        Before the first step the initial accelerations are computed first, as by `state`; an
        exception of a callable load reaches the caller.

        Examples
        --------
        Two continuations of one run:

        >>> coupler = models.split_oscillator(10.0).coupler(0.05, coupling="pm")
        >>> coupler.step(7)
        >>> present = coupler.snapshot()
        >>> first = coupler.run(steps=3)
        >>> coupler.restore(present)
        >>> second = coupler.run(steps=3)
        >>> coupler.step_count, bool(np.all(first["A"].u == second["A"].u))
        (10, True)
        """
        return snapshots.snapshot(self._session)

    def restore(self, snapshot: Snapshot) -> None:
        """Return to the state of a snapshot of this coupler.

        The continued run is bitwise identical to the one that followed the snapshot, if callables
        return the same values: those of loads are evaluated again from the restored time on.
        `last_history` is None afterwards.

        Parameters
        ----------
        snapshot : Snapshot
            Of `snapshot`.

        Raises
        ------
        TypeError
            For an object that is not a Snapshot.
        ValueError
            For a snapshot of another coupler, also one of the same problem: `save` and `load`
            transfer a state between those. The coupler is then unchanged.
        """
        snapshots.restore(self._session, snapshot)

    def freeze(
        self,
        path: str | PathLike[str],
        inputs: Mapping[str, tuple[Any, ...]] | None = None,
        outputs: Mapping[str, tuple[Any, ...]] | None = None,
    ) -> None:
        """Write this coupler, from its present on, as a model for the C library `pmalpha.h`.

        The library steps it without Python, bitwise as `run` does, in one thread. The file has
        matrices, factors, loads, springs and the present; docs/embedded.md shows the loop. Written
        atomically; the same coupler frozen twice gives equal files.

        Parameters
        ----------
        path : str or path
            Used as given; no suffix is added.
        inputs : dict, optional
            What the loop sets, by name: ``("specimen", subdomain, dof)``, the force of a specimen
            at its last command, in place of `rig.External` or of a restoring function, which acts
            on all dofs of its subdomain: all of them are inputs, or none; ``("force", subdomain,
            dof)``, what is added to all loads; ``("velocity", row)``, what is added to the velocity
            of a row of the constraints, or to none. One more entry is the value at the start, which
            is in the initial accelerations: default 0, of a specimen what its function or External
            gave. Names are identifiers, with dots between them.
        outputs : dict, optional
            What the loop reads, by name, as a run records it: ``("u", subdomain, dof)``, "v" or
            "a"; ``("multiplier", row)``; ``("deformation", subdomain, spring)`` or
            "spring force".

        Raises
        ------
        ValueError
            For functions in `force`, `internal` and velocities, with the subdomain, and those in
            `restoring` that inputs do not replace; moving obstacles; a force or a specimen of
            several substeps under "macro" or "mean"; a linkage, or a compensator that needs the
            measured displacement, before an input; a coupler with `comm`; the macro step across a
            change of steps; names that are no identifiers or not unique; what does not exist. No
            file is written then.
        OSError
            For a file that cannot be written.

        See Also
        --------
        save : The present alone, to go on in Python.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> coupler = models.split_oscillator(10.0).coupler(0.05, coupling="pm")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder, "oscillator.pma")
        ...     coupler.freeze(path, {"push": ("force", "A", 0)}, {"u": ("u", "B", 0)})
        ...     path.read_bytes()[:7]
        b'pmalpha'
        """
        from .freeze import freeze

        freeze(self._session, path, inputs, outputs)

    def export_fmu(
        self,
        path: str | PathLike[str],
        inputs: Mapping[str, tuple[Any, ...]] | None = None,
        outputs: Mapping[str, tuple[Any, ...]] | None = None,
        *,
        fmi: str = "2.0",
        license: str | None = None,
        units: Mapping[str, str] | None = None,
    ) -> None:
        """Write this coupler, from its present on, as an FMU for co-simulation.

        It contains the model of `freeze`, the binary of this system, and all sources, which compile
        with C11 and no other header; no compiler is needed here, and no Python there. Each
        specimen has, beside its input, the next command as outputs ``name.u``, ``.v`` and ``.a``.
        It begins at the present time. Communication steps are whole numbers of fine steps; inputs
        of the initialization are those at the start; states can be saved and restored. A
        force that hardware returns between two steps answers the command before, one sample late:
        docs/embedded.md.

        Parameters
        ----------
        path : str or path
            Such as "tower.fmu"; its name makes the model identifier.
        inputs, outputs : dict, optional
            As for `freeze`.
        fmi : {"2.0", "3.0"}, default "2.0"
            The version of the standard.
        license : str, optional
            The licence of the model, a text, beside that of this package.
        units : dict, optional
            Units by the names of inputs, outputs and commands, such as ``{"column": "N",
            "column.u": "m"}``, which masters show. Default: none are stated.

        Raises
        ------
        TypeError, ValueError, OSError
            As `freeze`; ValueError for units of a name that the FMU does not have.

        Examples
        --------
        >>> import tempfile, pathlib, zipfile
        >>> coupler = models.split_oscillator(10.0).coupler(0.05, coupling="pm")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder, "oscillator.fmu")
        ...     coupler.export_fmu(path, {"push": ("force", "A", 0)}, {"u": ("u", "B", 0)})
        ...     "modelDescription.xml" in zipfile.ZipFile(path).namelist()
        True
        """
        from .freeze import export_fmu

        export_fmu(self._session, path, inputs, outputs, fmi, license, units)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the present state to a file; a run continues from it bitwise identically.

        An npz file without pickled objects: the state and a description of the problem with
        checksums of its matrices, not the matrices themselves. Written atomically; an existing file
        survives an interrupted save.

        Parameters
        ----------
        path : str or path
            Used as given; no suffix is added. With `comm` each rank writes a file of its own, with
            the number of the macro step, a token of this save and the number of the rank added, and
            this one, written last, leads to them: keep them together. The files of states that were
            saved there before, whole or not, are removed.

        Raises
        ------
        TypeError, OSError
            For a wrong type of path, and for a file that cannot be written.

        Before the first step the initial accelerations are computed first, as by `state`; an
        exception of a callable load reaches the caller.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> model = models.split_oscillator(10.0)
        >>> coupler, other = (model.coupler(0.05, coupling="pm") for _ in range(2))
        >>> coupler.step(7)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     coupler.save(pathlib.Path(folder, "state.npz"))
        ...     other.load(pathlib.Path(folder, "state.npz"))
        >>> coupler.step(), other.step()
        (None, None)
        >>> other.step_count, bool(other.state("A").u == coupler.state("A").u)
        (8, True)
        """
        snapshots.save(self._session, path)

    def load(self, path: str | PathLike[str]) -> None:
        """Restore the state that a coupler of the same problem saved.

        The two couplers must be built the same way, in the same process or another. The continued
        run is bitwise identical to an uninterrupted one, with the same build, CPU and packages.
        Initial values may differ (with internal forces under "macro" the continued run then agrees
        to the tolerance of `Newton`, not bitwise). Constant and sampled loads are compared by their
        numbers; callables cannot be compared: the caller provides the same functions, which are
        evaluated from the restored time on.

        Parameters
        ----------
        path : str or path
            A file written by `save`, by any number of ranks, or by a coupler without `comm`.

        Raises
        ------
        TypeError, OSError
            For a wrong type of path, and for a file that cannot be read.
        ValueError
            For another problem, with a list of what differs, for any other file, or a damaged one.
            The coupler is then unchanged.
        """
        snapshots.load(self._session, path)

    # ---- the whole structure --------------------------------------------------------------------

    def static(self, *, steps: int = 1) -> dict[str, np.ndarray]:
        """Static equilibrium under F(0) with displacements tied, such as u0 under dead load.

        Rows with a prescribed velocity are held at zero. The coupler itself is unchanged; use
        ``coupler.reset(u0=coupler.static())``. With `comm` every rank solves for the whole
        structure, with all matrices, and returns the displacements of its own subdomains. With
        springs or internal forces the equilibrium is iterated by Newton's method, from the initial
        displacements: those of the `Subdomain`, or of the last `reset`. Of several equilibria it
        finds one near to them. A force that is a function of t, u and v is a constant load with its
        value at t = 0 and the initial values.

        Parameters
        ----------
        steps : int, default 1
            Number of equal load steps, in which the residual of the initial displacements is
            removed. One that does not converge is halved, so that more than 1 are needed only to
            stay on a branch of solutions. No effect for linear subdomains.

        Returns
        -------
        dict of (n_i,) arrays by name
            Displacements.

        Raises
        ------
        FactorizationError
            For a floating structure, a mechanism at the solution, or an indefinite stiffness: an
            equilibrium that is not stable. An unsymmetric stiffness is only required to be regular.
        ConvergenceError
            When the iteration does not converge in small load steps; its time is 0.
        TypeError, ValueError
            For `steps` that is not a whole number above 0; for a function among restoring forces,
            whose equilibrium needs an experiment: `internal` takes forces that can be
            iterated.

        Notes
        -----
        Newton's method by load steps, equations (N18) to (N20) of docs/method.md. Springs and
        forces with a history are evaluated at the end of one path from their history at t = 0, as
        the start of a run evaluates them, equation (N17), whatever the load steps: so the run stays
        at rest. Where yielding depends on the path of the load, apply it in a run.

        Exception: under "mean" explicit subdomains with `GeneralizedAlpha` rest in another
        equilibrium, equation (K9): K acts at a distance of 0.25 to 0.3 h^2 y from it, with the
        acceleration y that the multipliers alone would give the masses. Central difference,
        implicit schemes and other couplings do rest.

        Examples
        --------
        >>> a = Subdomain([1.0], [2.0], scheme=Newmark(), force=[3.0], name="a")
        >>> b = Subdomain([1.0], [1.0], scheme=CentralDifference(), name="b")
        >>> coupler = Coupler([a, b], tie(a, [0], b, [0]), dt=0.1, coupling="pm")
        >>> {name: float(u[0]) for name, u in coupler.static().items()}
        {'a': 1.0, 'b': 1.0}

        With a hardening spring, 2 u + u + u^3 = 4:

        >>> b = Subdomain([1.0], [1.0], scheme=Newmark(), internal=CubicSpring([0], 0.0, 1.0))
        >>> a = Subdomain([1.0], [2.0], scheme=Newmark(), force=[4.0], name="a")
        >>> coupler = Coupler([a, b], tie(a, [0], b, [0]), dt=0.1, coupling="pm")
        >>> float(coupler.static()["a"][0].round(12))
        1.0
        """
        from . import whole_structure

        return whole_structure.static(self._session, steps)

    def assembled(self) -> Assembled:
        """The structure before it was cut: M, C and K with the constraints eliminated exactly.

        Dofs that ties connect are one dof; the others follow in the order of the subdomains. Rows
        with a prescribed velocity are held at zero. A general constraint removes one of its dofs,
        expressed by the others.

        K and C are those of small motions about the present state of the coupler: with the tangents
        of internal forces and springs at its displacements, velocities, histories and time, and
        with the estimates of restoring functions. Springs with a memory (`Bilinear`, `BoucWen`)
        count with their initial tangent if it is larger, since one that yields unloads in small
        motions; gaps count where they are closed. Before the first step the initial accelerations
        are computed first, as by `state`; a force that is a function of t, u and v is a load and
        has no part in K. The coupler
        itself is unchanged.

        Returns
        -------
        Assembled
            A tuple ``(M, C, K, map)``: (n, n) csr_array matrices, and by name the (n_i, n)
            csr_array with u_i = map[name] @ u. Displacements, velocities and accelerations are
            mapped alike; a force f_i on a subdomain is map[name].T @ f_i on the structure.

        Raises
        ------
        ValueError
            For a restoring force without `restoring_stiffness`, which may have any stiffness; when
            the constraints hold all dofs.
        MemoryError
            When many constraints that are not ties share dofs.

        Examples
        --------
        >>> a = Subdomain([1.0, 2.0], [[3.0, -1.0], [-1.0, 1.0]], scheme=Newmark(), name="a")
        >>> b = Subdomain([4.0], [5.0], scheme=Newmark(), name="b")
        >>> M, C, K, map = Coupler([a, b], tie(a, [1], b, [0]), dt=0.1, coupling="pm").assembled()
        >>> M.diagonal().tolist(), K.toarray().tolist(), map["b"].toarray().tolist()
        ([1.0, 6.0], [[3.0, -1.0], [-1.0, 6.0]], [[0.0, 1.0]])
        """
        from . import whole_structure

        return whole_structure.assembled(self._session)

    def modes(self, k: int = 6) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """The lowest natural frequencies and modes of the structure with its ties.

        Those of M and K of `assembled`, for small motions about the present state of the coupler:
        for frequencies under dead load take ``coupler.reset(u0=coupler.static())`` first. Undamped:
        C has no influence, neither a gyroscopic one,
        whose frequencies of whirl are complex eigenvalues, nor have the steps of the subdomains.

        Parameters
        ----------
        k : int, default 6
            Number of modes, including rigid-body modes.

        Returns
        -------
        omega : (k,) ndarray
            Angular frequencies in rising order, radians per unit of time; 0 for rigid-body modes.
        modes : dict of (n_i, k) ndarray by name
            In columns, on all dofs of each subdomain; tied dofs have equal values. Mass-normalised:
            the sum of modes[name].T @ M_i @ modes[name] is the identity.

        Raises
        ------
        BucklingError
            For a motion of negative stiffness, with its mode and rate of growth: the state is not a
            stable equilibrium. A ValueError too.
        TypeError, ValueError
            As `assembled`; for a k that is not a whole number or larger than the number of dofs
            with mass; for a stiffness that is not symmetric.
        scipy.sparse.linalg.ArpackError
            When ARPACK does not converge.

        Examples
        --------
        A chain of three equal masses, cut at the second: omega = 2 sqrt(k/m) sin(i pi / 6).

        >>> K = [[4.0, -4.0], [-4.0, 4.0]]
        >>> a = Subdomain([1.0, 0.5], K, scheme=Newmark(), name="a")
        >>> b = Subdomain([0.5, 1.0], K, scheme=Newmark(), name="b")
        >>> omega, shapes = Coupler([a, b], tie(a, [1], b, [0]), dt=0.1, coupling="pm").modes(3)
        >>> omega.round(6).tolist(), shapes["b"].shape
        ([0.0, 2.0, 3.464102], (2, 3))

        A mass on a hardening spring u + u^3 under a force of 10, at rest at u = 2:

        >>> mass = Subdomain([1.0], None, scheme=Newmark(), force=[10.0],
        ...                  internal=CubicSpring([0], k=1.0, k3=1.0))
        >>> coupler = Coupler([mass], dt=0.1)
        >>> coupler.modes(1)[0].round(6).tolist()  # unloaded
        [1.0]
        >>> coupler.reset(u0=coupler.static())
        >>> coupler.modes(1)[0].round(6).tolist()  # sqrt(1 + 3 u^2)
        [3.605551]
        """
        from . import whole_structure

        return whole_structure.modes(self._session, k)

    def harmonic(self, omega: ArrayLike, force: Mapping[Any, Any]) -> dict[str, np.ndarray]:
        """The steady motion of the structure with its ties under harmonic forces.

        The complex amplitudes x of :math:`u(t) = Re(x exp(i omega t))` under
        :math:`F(t) = Re(f exp(i omega t))`, with M, C and K of `assembled` about the present state
        of the coupler: :math:`(K + i omega C - omega^2 M) x = f`, one solution for each frequency.
        Steps and schemes have no influence; rows with a prescribed velocity are held.

        Parameters
        ----------
        omega : float or (k,) array_like
            Angular frequencies, radians per unit of time, at least 0.
        force : dict
            Amplitudes f (n_i,), real or complex, by subdomain or name; 0 on the others.

        Returns
        -------
        dict of (k, n_i) complex ndarray by name
            ``abs(x)`` is the amplitude, ``np.angle(x)`` the phase before the force.

        Raises
        ------
        TypeError, ValueError
            As `assembled`; for other shapes, negative frequencies, and a natural frequency of an
            undamped structure.

        Examples
        --------
        At resonance the amplitude is f / (c omega), a quarter of a period behind the force:

        >>> mass = Subdomain([1.0], [4.0], C=[0.1], scheme=Newmark(), name="mass")
        >>> x = Coupler([mass], dt=0.1).harmonic([0.0, 2.0], {"mass": [1.0]})["mass"][:, 0]
        >>> abs(x).round(6).tolist(), round(float(np.angle(x[1], deg=True)), 6)
        ([0.25, 5.0], -90.0)
        """
        from . import whole_structure

        return whole_structure.harmonic(self._session, omega, force)


def solve(
    subdomain: Subdomain,
    dt: float,
    t_end: float | None = None,
    *,
    threads: int | None = None,
    **as_run: Any,
) -> SubdomainHistory:
    """Solve one uncoupled subdomain, with the same schemes and the same core.

    Parameters
    ----------
    subdomain : Subdomain
        Its step is dt / substeps.
    dt : float
        As for `Coupler`.
    t_end : float, optional
        As for `Coupler.run`.
    threads : int, optional
        As for `Coupler`.
    **as_run
        Further arguments of `Coupler.run`.

    Returns
    -------
    SubdomainHistory
        With methods `plot`, `save`, `to_xarray` and `to_pandas`.

    Examples
    --------
    >>> oscillator = Subdomain([1.0], [4.0], scheme=Newmark(), u0=[1.0])
    >>> float(np.round(solve(oscillator, dt=0.001, t_end=1.0).u[-1, 0], 4))
    -0.4161
    """
    if not isinstance(subdomain, Subdomain):
        raise TypeError(
            f"subdomain must be one Subdomain, not a list of them; several are for Coupler, got "
            f"{subdomain!r}"
        )
    # only here: one subdomain needs none of them
    options = set(as_run) & set(inspect.signature(Coupler).parameters)
    if wrong := sorted(options - set(inspect.signature(Coupler.run).parameters)):
        raise TypeError(
            f"solve() has no {wrong[0]!r}, got {as_run[wrong[0]]!r}: that is an option of a "
            f"Coupler; Coupler([subdomain], dt, {wrong[0]}=...).run(t_end)[0] has it"
        )
    return Coupler([subdomain], dt=dt, threads=threads).run(t_end, **as_run)[0]
