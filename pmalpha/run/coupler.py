"""The coupled problem: subdomains with different time steps, advanced by the C core."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, get_args

import numpy as np

from .._checks import check_word, flag, time_step, whole_number
from .._core import Guard
from ..problem.arguments import Coupling, Drift, Start
from ..problem.constraints import Constraint
from ..problem.newton import DEFAULT, Newton
from ..problem.subdomain import Subdomain
from ..setup.assembly import Assemblies, Layout
from ..setup.constraint_rows import ConstraintRows
from ..setup.core_rows import CoreRows
from ..setup.ranks import Ranks, described, require_equal_problems
from ..setup.schedule import (
    MACRO,
    check_drift,
    check_factorize,
    check_newton,
    checked_constraints,
    checked_subdomains,
    double_steps,
    finest,
    most_threads,
    names_of,
)
from ..setup.start import InitialAccelerations
from .accuracy import estimated_error, warn_if_coarse
from .cases import Case, Cases, checked_case
from .changes import Changes
from .clock import Clock
from .description import Description
from .drift import warn_if_drifting
from .energy import conserved_quantity, summed_works
from .history import History
from .initial import InitialValues
from .interrupts import HeldSignals
from .loads import Loads
from .motion import motions_of
from .present import Present
from .progress import Report, reporting
from .recording import FiledRecording, Recording, recording_class
from .sampled import warn_of_skipped
from .saving import Saving
from .snapshot import Snapshots
from .stiffening import warn_of_present_steps
from .together import Together
from .transfer import Steps
from .uncut import Uncut

__all__ = ["Coupler"]


class Coupler(Cases, Changes, Description, Present, Saving, Snapshots, Together, Uncut):
    """Subdomains with different schemes and time steps, coupled by velocity constraints.

    Parameters
    ----------
    subdomains : sequence of `Subdomain`
        At least one. They are not changed.
    constraints : `Constraint` or list of them, optional
        The interface constraints, from `tie` or general ones. They must be independent.
    dt : float
        The macro step, in any consistent unit, positive. The substeps of subdomain i have the
        length dt / substeps_i; the largest number of substeps must be a multiple of all others,
        except under "macro" and "mean".
    coupling : {"pm", "gc", "macro", "mean"}, default "pm"
        "pm": interfield parallel, with double steps (PM-alpha; with Newmark schemes the PM
        method). "gc": staggered, single steps (GC-alpha). "macro": one interface problem per macro
        step, multipliers linear over it, velocities tied at its end; order 2 with any numbers of
        substeps, double steps only with ``double_step=True`` (and ``substeps=1``). "mean": one
        interface problem per macro step, multipliers constant over it, displacements tied at its
        end; like "macro", and without displacement drift, and with Newmark schemes without loss or
        gain of energy. docs/couplings.md compares them.
    start : {"rebased", "plain"}, default "rebased"
        "rebased": the stored free velocity of a double-step subdomain is replaced when its double
        steps begin, after the first macro step, equation (S3). "plain": it is kept, as in the
        paper. No effect under "macro", where no step reads a stored free velocity.
    drift : {"kept", "removed"}, default "kept"
        "removed", with "gc" only: second multipliers tie the displacements at the ends of macro
        steps too, equations (V1) to (V5), so that `History.displacement_jump` keeps its value at
        t = 0 (plus the integral of prescribed velocities) to rounding. Costs two sweeps and a
        product with K per subdomain and macro step. Not with internal forces. Where all steps
        have algorithmic damping (rho < 1) no growth was found. "mean" ties displacements by itself.
    newton : Newton, default Newton()
        How internal forces are iterated; no effect without them.
    threads : int, optional
        Maximum number of threads, including the caller; 1 runs serially. Results are bitwise
        identical for any number. Default: the number of processors of this process if equations
        (W1) to (W3) of docs/method.md predict from the sizes alone that threads save a fifth of
        the time, else 1. `Coupler.threads` is the number in use: larger than the number of
        subdomains only if a large one is split among threads. Large factors, those
        of tangents in the steps too, and unit responses are made by several threads.
    factorize : None, "superlu" or callable, optional
        The factorization of the sparse matrices Mbar and M of the subdomains. None: the supernodal
        code of this package, and SciPy's SuperLU for a matrix with little fill. "superlu": always
        SuperLU, slower and larger. A callable ``factorize(A, last) -> (L, D, perm)``: see Notes.
    comm : mpi4py.MPI.Intracomm, optional
        Communicator of the processes that share the problem: `subdomains` are those of this rank,
        possibly none, and `constraints` the same list, in names, on every rank. The same calls are
        made on all ranks; see docs/mpi.md. The communicator is duplicated.

    Raises
    ------
    TypeError, ValueError
        For arguments of the wrong kind, equal names, numbers of substeps that do not divide the
        largest, double steps in all subdomains of the finest step, an initial state of the wrong
        shape; for a wrong result of `factorize`; under "macro" and "mean" for a double step with
        substeps, and for unit responses that would take longer than a day; under "mean" for an
        explicit scheme with rho < 0.5, interface dofs without mass, restoring
        forces; with `comm` for interface dofs without mass. An error on one rank ends the call on
        all: there with its own exception, elsewhere with the same class if it is of pmalpha, else
        with a PmalphaError; both name the rank.
    ConstraintError
        For constraints that are dependent or that the initial velocities violate; under "mean" also
        for initial displacements that do.
    FactorizationError
        For a singular or indefinite Mbar or mass matrix, with subdomain, dof and inertia.
    MemoryError
        For a problem whose predicted size exceeds the available memory.

    Warns
    -----
    StabilityWarning
        When the step of a subdomain is above its critical step; under "macro" when a subdomain
        resonates with the macro step, and for a double step without algorithmic damping (rho = 1);
        under "mean" for damping in a subdomain with one substep and algorithmic damping (rho < 1).
    PerformanceWarning
        When the unit responses of "macro" take long; when M or C of an explicit subdomain is not
        diagonal and the sweeps over the factor that it needs take longer than the rest of its step,
        from 100 000 entries on (smaller factors stay in the caches); for a long factorization
        without pymetis.
    ConstraintWarning
        When the initial displacements violate a constraint; for a subdomain beside others that no
        constraint reaches, and a floating one that its constraints leave loose; under "macro" for
        interface dofs without mass in a subdomain with substeps.

    Notes
    -----
    Equations (1) to (18) of docs/method.md; Bursi, He, Bonelli and Pegon 2008.

    A callable `factorize` is called when the Coupler is made, once for each matrix of a subdomain
    that has sparse matrices, with `A`, an (n, n) csc_array of both triangles in the user's order of
    dofs, and `last`, a sorted (nb,) array of the interface dofs. It returns `L`, (n, n) lower
    triangular with a diagonal of ones or none, sparse or dense, `D`, (n,) positive, and `perm`,
    (n,) int, ending with the dofs of `last` in any order, so that
    ``A[perm][:, perm] = L @ diag(D) @ L.T``. All matrices of a subdomain have the same pattern,
    with stored zeros, and must get the same `perm`. Diagonal and dense matrices and the interface
    matrix are factored by the package.

    The repr, and the output of a notebook, is a table of what each subdomain will do: the length of
    its steps (2 h if they are double, from the second macro step on), the step divided by the
    critical step (an upper bound from 200 dofs on), form and entries of its factor, and its thread.

    Examples
    --------
    A mass split in two halves, one with twenty substeps in each step of the other:

    >>> a = Subdomain([0.5], [2.0], scheme=GeneralizedAlpha(0.5), u0=[1.0], name="a")
    >>> b = Subdomain([0.5], [2.0], scheme=GeneralizedAlpha(0.5, explicit=True), substeps=20,
    ...               u0=[1.0], name="b")
    >>> coupler = Coupler([a, b], tie(a, [0], b, [0]), dt=0.01)
    >>> history = coupler.run(1.0)
    >>> history["a"].u.shape, history["b"].u.shape, history.multipliers.shape
    ((101, 1), (2001, 1), (2001, 1))
    >>> bool(abs(history["b"].u[-1, 0] - np.cos(2.0)) < 1e-3)
    True
    """

    def __init__(
        self,
        subdomains: Sequence[Subdomain],
        constraints: Constraint | Sequence[Constraint] | None = None,
        *,
        dt: float,
        coupling: Coupling = "pm",
        start: Start = "rebased",
        drift: Drift = "kept",
        newton: Newton = DEFAULT,
        threads: int | None = None,
        factorize: Any = None,
        comm: Any = None,
    ):
        self._guard = Guard()
        self._ranks = None if comm is None else Ranks(comm)
        with self._together():
            options = {"coupling": coupling, "start": start, "drift": drift, "newton": newton}
            self._set_up(subdomains, constraints, dt, threads, factorize, options)

    def _set_up(
        self,
        subdomains: Any,
        constraints: Any,
        dt: float,
        threads: int | None,
        factorize: Any,
        options: dict[str, Any],
    ) -> None:
        """As in the table of docs/architecture.md."""
        coupling, start, drift, newton = options.values()
        ranks = self._ranks
        subdomains = checked_subdomains(subdomains, may_be_empty=ranks is not None)
        check_word(coupling, "coupling", get_args(Coupling))
        check_word(start, "start", get_args(Start))
        check_drift(drift, coupling)
        check_newton(newton)
        self._threads_allowed = most_threads(threads)
        check_factorize(factorize)
        clock = Clock(time_step(dt, "dt"))
        everything = subdomains if ranks is None else described(ranks, subdomains)
        own = slice(None) if ranks is None else ranks.own
        names = names_of(everything)
        rows = checked_constraints(constraints, everything, names)
        if ranks is not None:
            require_equal_problems(ranks, rows, (clock.dt, coupling, start, drift, repr(newton)))
        substeps = tuple(s.substeps for s in everything)
        fine = finest(substeps, coupling)
        self._everything, self._keys = everything, tuple(zip(names[own], subdomains))
        self._options = {"dt": clock.dt, **options}
        doubles = double_steps(everything, coupling, substeps)
        layout = Layout(clock.dt, substeps, tuple(doubles))

        self._rows = ConstraintRows(rows, everything, own, ranks)
        motions = motions_of(rows, self._rows, 1 if coupling in MACRO else fine, clock)
        self._initial = InitialValues(self._keys, self._rows)
        self._initial.check(motions, tied=coupling == "mean")
        with np.errstate(over="ignore"):  # a matrix that overflows is refused as singular
            self._assemblies = Assemblies(
                self._keys,
                self._rows.links,
                self._rows.p,
                layout,
                [motion.rows for motion in motions],
                **options,
                threads=self._threads_allowed,
                factorize=factorize,
                ranks=ranks,
            )
        self._take(Steps(layout, clock), self._assemblies.first)
        self._core_rows = CoreRows(self._assemblies.row_position, self._rows.scale)
        self._initial_accelerations: InitialAccelerations | None = self._assemblies.accelerations

        self._last_history: History | None = None
        self._constants: dict[str, Any] | None = None  # of the problem, for a checkpoint
        self._started = self._was_reset = False
        forces = [s.force for s in subdomains]
        warn_of_skipped(self._parts, forces, motions, clock.dt / self._fine)
        self._loads = Loads(self._core, self._parts, clock, forces, motions, newton, names)
        self._take_loads()

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError("a Coupler cannot be copied or pickled: its state is in the C core")

    # ---- running -----------------------------------------------------------------------------

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
        tolerance: float | Mapping[Any, float] | None = None,
        progress: Any = None,
    ) -> History:
        """Advance from the present time and record.

        Parameters
        ----------
        t_end : float
            End of the run, absolute time. A whole number of macro steps from 0, within 1e-6 of a
            macro step, not before the present time. Give this or `steps`.
        steps : int
            Number of macro steps, 0 or more.
        record : dict, optional
            Dofs to record by subdomain: their numbers, one number, or a mask, None for all dofs of
            one; a subdomain left out is not recorded. Default: all dofs of all subdomains.
        every : int, optional
            Record only time levels at which `step_count` is a multiple of this, and the first of
            the run, in all arrays. Default: every time level of each subdomain.
        energy : bool, default False
            Record the energies of all subdomains, with works counted from the beginning of this
            run, in ``history.energy``, an `Energy`. Results are unchanged. Costs a product with C
            per substep, products with M and K per recorded macro step, and the memory of 13 vectors
            of each subdomain; under "macro" 3 more per substep, and stored link responses are not
            used but computed again.
        record_to : str or path, optional
            HDF5 file to which the History is written during the run, about three times per second
            and with 16 MB of it in memory. An existing file is refused. The arrays of the returned
            History, and of `last_history`, are mapped from the file and read on access.
            `History.load` and other programs can read it during the run and after a kill. With
            `comm` each rank writes a file of its own, with ``.0``, ``.1`` and so on added; the file
            itself leads to them and reads as one History.
        append : bool, default False
            Continue an existing file of `record_to` from the present state, which it must contain;
            rows written after it, by a run that was killed after a checkpoint, are replaced. The
            returned History is that of the whole file. Without such a file a new one is made.
            Not with energies, whose works count from the beginning of a run.
        overwrite : bool, default False
            Replace an existing file before the first step.
        record_springs : dict, optional
            Springs whose deformation and force are recorded: indices by subdomain, None for all
            springs of one. Default: none.
        outputs : dict, optional
            Linear combinations of the motion, base shears or element forces say, that are recorded
            as ``history[name].outputs[output]``, by subdomain and by name of the output: a matrix
            W, (rows, n) dense or scipy.sparse or (n,) for one row, for W u; or a dict of such
            matrices by "u", "v" and "a" for W_u u + W_v v + W_a a. They are computed during the run
            from all dofs, recorded or not: with ``record={}`` only outputs are recorded.
        tolerance : float or dict of float, optional
            With "gc": local error of the displacements per unit of time, one number or by
            subdomain (with `comm` of this rank), below which the substeps of every macro step are
            chosen to stay; see Notes.
        progress : True or callable, optional
            True: a tqdm bar. A callable is called as ``progress(done, total)``, in macro steps of
            this call, about every 50 ms and at the end. It may not use the coupler. An exception
            in it ends the run as Ctrl-C does.

        Returns
        -------
        History
            From the present time to the end of the run.

        Raises
        ------
        TypeError, ValueError
            For wrong arguments, and for a wrong result of a load.
        ConvergenceError
            When the iteration of internal forces does not converge.
        InstabilityError
            When a value is not finite, or after that StabilityWarning has left all bounds.
        CallbackError
            When a compiled function did not return 0.
        MemoryError
            When the History exceeds the available memory.
        ImportError
            For ``progress=True`` without tqdm, and for `record_to` without h5py.
        OSError
            When `record_to` cannot be written or exists; for a wrong path before any load is
            evaluated.

        Warns
        -----
        AccuracyWarning, StabilityWarning
            When the recorded steps are too coarse for the motion, or under "macro" the macro step
            for the multipliers; when steps are above the critical step for the stiffness seen in a
            restoring callable without ``restoring_stiffness``, or, once at the beginning, for the
            tangents of the internal forces of explicit subdomains in the present state.

        Notes
        -----
        An exception of a load or of a restoring force reaches the caller, and so does Ctrl-C,
        within 0.1 s or a fine step, whichever is longer. After any exception the coupler is at the
        last completed macro step, `last_history` has the run up to it, and the run can continue.

        With `tolerance`, (Q5) and (Q6), a macro step with more than four times the tolerance is
        repeated. All substeps become powers of two, at most 4096 (else an AccuracyWarning), and
        stay after the run; a `record_to` file is written at its end. The estimate does not see the
        error at the interface, of order 1 where substeps differ: errors at the end were 0.08 to 1.7
        of tolerance times duration for 10 to 0.2 per cent of the motion, and more below.

        Examples
        --------
        The force of a spring of stiffness 4, and no dof:

        >>> mass = Subdomain([1.0], [4.0], scheme=Newmark(), v0=[1.0], name="mass")
        >>> history = Coupler([mass], dt=0.01).run(1.0, record={}, outputs={"mass": {"N": [4.0]}})
        >>> history["mass"].outputs["N"].shape
        (101, 1)
        """
        if tolerance is not None:
            chosen = dict(record=record, every=every, energy=energy)
            chosen |= dict(record_springs=record_springs, outputs=outputs)
            files = record_to, append, overwrite
            return self._run_with_tolerance(tolerance, (t_end, steps), chosen, files, progress)
        with self._together(), HeldSignals(self._guard) as held:
            begin = self._steps_done()
            end = self._clock.end(t_end, steps, begin)
            self._check_call("run", end, every, energy)
            recording = self._recording(
                begin,
                end,
                record_to,
                append=append,
                overwrite=overwrite,
                record=record,
                every=every,
                energy=energy,
                record_springs=record_springs,
                outputs=outputs,
            )
            with reporting(progress, begin, recording.end) as report:
                history = self._run(recording, report, held)
        self._last_history = None
        return history

    def _recording(
        self,
        begin: int,
        end: int,
        record_to: str | PathLike[str] | None = None,
        *,
        append: bool = False,
        overwrite: bool = False,
        energy: bool = False,
        **chosen: Any,
    ) -> Recording:
        """The arrays of a run between two macro steps; `chosen` are arguments of `run`."""
        energy, conserved = flag(energy, "energy"), None
        if energy:
            conserved = conserved_quantity(self._parts, self._options, self._ranks)
        record_to = self._own_record(record_to, append, overwrite)
        make = recording_class(record_to, append=append, overwrite=overwrite)
        return make(
            self._parts,
            self._keys,
            self._core_rows,
            fine=self._fine,
            middle=self.coupling == "mean",
            begin=begin,
            end=end,
            clock=self._clock,
            energy=energy,
            conserved=conserved,
            **chosen,
        )

    def _run(self, recording: Recording, report: Report | None, held: HeldSignals) -> History:
        """Run through an interval from the present on, and judge the result.

        `last_history` is the result too: the caller replaces it when the result is safe.
        """
        self._last_history = None
        held.during(self._start)
        energies = recording.has_energy, recording.conserved
        with summed_works(self, *energies), recording:
            self._record_present(recording)
            try:
                self._advance_in_intervals(recording, report, held)
            except BaseException:
                self._last_history = recording.history(self._core.step_count)
                raise
        self._last_history = history = recording.history(recording.end)  # if a warning is an error
        held.during(self._judge, history)
        return history

    def _judge(self, history: History) -> None:
        """The warnings about a result."""
        rows, motions = self._rows, self._loads.motions
        found = estimated_error(history.subdomains, self._parts, rows, motions)
        warn_if_coarse(found, history.macro_times[-1])
        warn_if_drifting(history, self._parts, rows, motions)

    def _advance_in_intervals(
        self, recording: Recording, report: Report | None, held: HeldSignals
    ) -> None:
        begin, end = recording.begin, recording.end
        if end > begin and (begin or self._was_reset):  # else the set-up has warned
            held.during(warn_of_present_steps, self._parts, self._clock.time(begin))
        for pause in recording.pauses():
            if isinstance(recording, FiledRecording) and recording.begin == begin:
                self._write_master(recording.path)
            held.during(self._advance, pause, recording, report)
            recording.keep(pause)
        if isinstance(recording, FiledRecording) and end == begin:
            self._write_master(recording.path)
        if report is not None:
            held.during(report, end)

    def step(self, n: int = 1) -> None:
        """Advance by n macro steps without a History.

        Raises as `run` does; the states are bitwise identical to those of `run`.

        Parameters
        ----------
        n : int, default 1
            Number of macro steps, 0 or more.
        """
        with self._together():
            n = whole_number(n, "n")
            self._check_call("step", n)
            self._start()
            self._advance(self._core.step_count + n, None)

    def reset(
        self,
        u0: Mapping[Any, Any] | None = None,
        v0: Mapping[Any, Any] | None = None,
        force: Mapping[Any, Any] | None = None,
    ) -> None:
        """Return to t = 0 and the steps with which the coupler was made, with all factors kept.

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
        with self._together():
            self._check_call("reset")
            case = checked_case(self._keys, self._rows, u0, v0, force)
            case.initial.check(self._loads.motions, tied=self.coupling == "mean")
            self._warn_of_records([case])
            kept = self._initial, self._loads, self._started, self._steps, self._assembly
            self._was_reset = True
            try:
                self._return_to_start(case)
            except BaseException:
                self._initial, self._loads, self._started, steps, assembly = kept
                self._take(steps, assembly)
                self._core.set_origin(steps.clock.origin, steps.clock.t0)
                self._loads.to_core()
                raise
            self._last_history = None

    def _warn_of_records(self, cases: Sequence[Case]) -> None:
        """Warn of loads of which steps skip samples, but for those of the `Subdomain`, of which
        the set-up has warned."""
        parts = self._assemblies.first.parts
        for case in cases:
            forces = [
                None if force is part.subdomain.force else force
                for part, force in zip(parts, case.forces)
            ]
            warn_of_skipped(parts, forces)

    def _return_to_start(self, case: Case) -> None:
        self._take_first_steps()
        self._initial, self._started = case.initial, False
        self._loads = self._loads.renewed(case.forces)
        self._take_loads()  # changes the core in its last lines only

    # ---- inside ------------------------------------------------------------------------------

    def _entered(self) -> Guard:
        """One call at a time: a load that used its own coupler would see an incomplete step."""
        return self._guard

    def _require_linear(self, what: str) -> None:
        self._require_alone(what)
        for name, s in self._keys:
            if s.restoring is not None or s.internal is not None:
                kind = "a restoring force" if s.internal is None else "an internal force"
                raise ValueError(f"{what} needs linear subdomains, got {kind} on {name!r}")
            if s.has_feedback:
                raise ValueError(
                    f"{what} needs loads that do not depend on the motion, got a force that is a "
                    f"function of t, u and v on {name!r}"
                )

    def _steps_done(self) -> int:
        return self._core.step_count if self._started else 0

    def _take_loads(self) -> None:
        """Give the core the loads, and start unless the start has to evaluate functions."""
        self._loads.to_core()
        if self._ranks is not None or not self._loads.has_functions:
            self._start()  # otherwise `run` or `step` starts, and may raise an exception of theirs

    def _start(self) -> None:
        """Consistent initial values, unless computed before, equation (S1)."""
        if self._started:
            return
        solver = self._initial.start(
            self._core, self._parts, self._loads, self._core_rows, self._initial_accelerations
        )
        self._started = True
        # only a reset needs the factor of M again: kept from the first reset on
        self._initial_accelerations = solver if self._was_reset else None
