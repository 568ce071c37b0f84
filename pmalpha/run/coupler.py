"""The coupled problem: subdomains with different time steps, advanced by the C core."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike
from typing import Any, get_args

from .._checks import check_word, flag, time_step, whole_number
from ..problem.arguments import Coupling, Start
from ..problem.constraints import Constraint
from ..problem.forces import checked_force
from ..problem.newton import DEFAULT, Newton
from ..problem.subdomain import Subdomain
from ..setup.assembly import assemble
from ..setup.constraint_rows import ConstraintRows
from ..setup.schedule import (
    MACRO,
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
from . import checkpoint
from .accuracy import warn_if_coarse
from .advance import advance
from .clock import Clock
from .description import Description
from .drift import warn_if_drifting
from .energy import summed_works
from .history import History
from .initial import InitialValues
from .keys import by_index
from .loads import Loads
from .motion import motions_of
from .present import Present
from .progress import Report, reporting
from .recording import Recording, recording_class
from .snapshot import Snapshots
from .stiffening import warn_of_present_steps
from .uncut import Uncut

__all__ = ["Coupler"]


class Coupler(Description, Present, Snapshots, Uncut):
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
    newton : Newton, default Newton()
        How internal forces are iterated; no effect without them.
    threads : int, optional
        Maximum number of threads, including the caller; 1 runs serially. Results are bitwise
        identical for any number. Default: the number of processors of this process if equations
        (W1) to (W3) of docs/method.md predict from the sizes alone that threads save a fifth of
        the time, else 1. `Coupler.threads` is the number in use: larger than the number of
        subdomains only if a large explicit one is split among threads.
    factorize : None, "superlu" or callable, optional
        The factorization of the sparse matrices Mbar and M of the subdomains. None: the supernodal
        code of this package, and SciPy's SuperLU for a matrix with little fill. "superlu": always
        SuperLU, slower and larger. A callable ``factorize(A, last) -> (L, D, perm)``: see Notes.

    Raises
    ------
    TypeError, ValueError
        For arguments of the wrong kind, equal names, numbers of substeps that do not divide the
        largest, double steps in all subdomains of the finest step, an initial state of the wrong
        shape; for a wrong result of `factorize`; under "macro" and "mean" for a double step with
        substeps, and for unit responses that would take longer than a day; under "mean" for an
        explicit scheme with rho < 0.5, interface dofs without mass, and internal forces.
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
        resonates with the macro step, and for a double step without algorithmic damping (rho = 1).
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
        newton: Newton = DEFAULT,
        threads: int | None = None,
        factorize: Any = None,
    ):
        subdomains = checked_subdomains(subdomains)
        constraints = checked_constraints(constraints, subdomains)
        check_word(coupling, "coupling", get_args(Coupling))
        check_word(start, "start", get_args(Start))
        check_newton(newton)
        threads_allowed = most_threads(threads)
        check_factorize(factorize)
        self._clock = Clock(time_step(dt, "dt"))
        fine = finest(subdomains, coupling)
        self._fine = 1 if coupling in MACRO else fine  # interface problems in a macro step
        self._keys = tuple(zip(names_of(subdomains), subdomains))
        self._options = {
            "dt": self._clock.dt,
            "coupling": coupling,
            "start": start,
            "newton": newton,
        }
        doubles = double_steps(subdomains, coupling)

        self._rows = ConstraintRows(constraints, subdomains)
        motions = motions_of(constraints, self._rows, self._fine, self.dt)
        self._initial = InitialValues(self._keys, self._rows)
        self._initial.check(motions, tied=coupling == "mean")
        assembly = assemble(
            self._keys,
            self._rows.matrices,
            doubles,
            [motion.rows for motion in motions],
            **self._options,
            threads=threads_allowed,
            factorize=factorize,
        )
        self._parts, self._core = assembly.parts, assembly.core
        self._row_position = assembly.row_position
        self._initial_accelerations: InitialAccelerations | None = assembly.accelerations

        self._last_history: History | None = None
        self._constants: dict[str, Any] | None = None  # of the problem, for a checkpoint
        self._started = self._was_reset = False
        self._busy = False
        forces = [s.force for s in subdomains]
        self._loads = Loads(self._core, self._parts, self._clock, forces, motions, newton)
        self._take_loads()

    def __reduce__(self) -> tuple:
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
        record_to: str | PathLike | None = None,
        append: bool = False,
        overwrite: bool = False,
        record_springs: Mapping[Any, Any] | None = None,
        outputs: Mapping[Any, Any] | None = None,
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
        outputs : dict, optional
            Linear combinations of the motion, base shears or element forces say, that are recorded
            as ``history[name].outputs[output]``, by subdomain and by name of the output: a matrix
            W, (rows, n) dense or scipy.sparse or (n,) for one row, for W u; or a dict of such
            matrices by "u", "v" and "a" for W_u u + W_v v + W_a a. They are computed during the run
            from all dofs, recorded or not: with ``record={}`` only outputs are recorded.
        energy : bool, default False
            Record the energies of all subdomains, with works counted from the beginning of this
            run, in ``history.energy``, an `Energy`. Results are unchanged. Costs a product with C
            per substep, products with M and K per recorded macro step, and the memory of 13 vectors
            of each subdomain; under "macro" 3 more per substep, and stored link responses are not
            used but computed again.
        record_to : str or path, optional
            HDF5 file to which the History is written during the run, with about 16 MB of it in
            memory. An existing file is refused. The arrays of the returned History, and of
            `last_history`, are mapped from the file and read on access. `History.load` and other
            programs can read the file during the run and after a kill, up to the last write; there
            are about three per second.
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
        progress : True or callable, optional
            True: a tqdm bar. A callable is called as ``progress(done, total)``, in macro steps of
            this call, about every 50 ms and at the end. It may not use the coupler. An exception
            in it ends the run as Ctrl-C does.

        Returns
        -------
        History
            From the present time to the end of the run.

        Examples
        --------
        The force of a spring of stiffness 4, and no dof:

        >>> mass = Subdomain([1.0], [4.0], scheme=Newmark(), v0=[1.0], name="mass")
        >>> history = Coupler([mass], dt=0.01).run(1.0, record={}, outputs={"mass": {"N": [4.0]}})
        >>> history["mass"].outputs["N"].shape
        (101, 1)

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

        An exception of a load or of a restoring force reaches the caller, and so does Ctrl-C,
        within 0.1 s or a fine step, whichever is longer. After any exception the coupler is at the
        last completed macro step, `last_history` has the run up to it, and the run can continue.
        """
        with self._entered():
            begin = self._steps_done()
            end = self._clock.end(t_end, steps, begin)
            make = recording_class(record_to, append=append, overwrite=overwrite)
            recording = make(
                self._parts,
                self._keys,
                self._row_position,
                fine=self._fine,
                middle=self.coupling == "mean",
                begin=begin,
                end=end,
                dt=self.dt,
                record=record,
                every=every,
                energy=flag(energy, "energy"),
                record_springs=record_springs,
                outputs=outputs,
            )
            with reporting(progress, begin, end) as report:
                self._last_history = None
                self._start()
                if end > begin and (begin or self._was_reset):  # else the set-up has warned
                    warn_of_present_steps(self._parts, self._clock.time(begin))
                with summed_works(self._core, self._parts, self._loads, energy), recording:
                    self._core.record_present(recording.core_record())
                    try:
                        self._advance_in_intervals(recording, report)
                    except BaseException:
                        self._last_history = recording.history(self._core.step_count)
                        raise
            self._last_history = history = recording.history(end)  # if the warning is an error
            warn_if_coarse(history.subdomains, self._parts, *history.macro_times[[0, -1]])
            warn_if_drifting(history, self._parts, self._rows, self._loads.motions)
            self._last_history = None
            return history

    def _advance_in_intervals(self, recording: Recording, report: Report | None) -> None:
        # not a loop directly under `try`, which does not cover the jump at its end (CallbackLoad)
        for pause in recording.pauses():
            self._advance(pause, recording, report)
            recording.keep(pause)
        if report is not None:
            report(recording.end)

    def step(self, n: int = 1) -> None:
        """Advance by n macro steps without a History.

        Raises as `run` does; the states are bitwise identical to those of `run`.

        Parameters
        ----------
        n : int, default 1
            Number of macro steps, 0 or more.
        """
        n = whole_number(n, "n")
        with self._entered():
            self._start()
            self._advance(self._core.step_count + n, None)

    def reset(
        self,
        u0: Mapping[Any, Any] | None = None,
        v0: Mapping[Any, Any] | None = None,
        force: Mapping[Any, Any] | None = None,
    ) -> None:
        """Return to t = 0, with all factors kept.

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
        with self._entered():
            initial = InitialValues(self._keys, self._rows, u0, v0)
            given = by_index(force, self._keys, "force")
            forces = [
                checked_force(given[i], s.n) if i in given else s.force
                for i, (_, s) in enumerate(self._keys)
            ]
            initial.check(self._loads.motions, tied=self.coupling == "mean")
            kept = self._initial, self._loads, self._started
            self._was_reset = True
            try:
                self._initial, self._started = initial, False
                self._loads = self._loads.renewed(forces)
                self._take_loads()  # changes the core in its last lines only
            except BaseException:
                self._initial, self._loads, self._started = kept
                self._loads.to_core()
                raise
            self._last_history = None

    def save(self, path: str | PathLike) -> None:
        """Write the present state to a file; a run continues from it bitwise identically.

        An npz file without pickled objects: the state and a description of the problem with
        checksums of its matrices, not the matrices themselves. Written atomically; an existing file
        survives an interrupted save.

        Parameters
        ----------
        path : str or path
            Used as given; no suffix is added.

        Raises
        ------
        TypeError, OSError
            For a wrong type of path, and for a file that cannot be written.

        Before the first step the initial accelerations are computed first, as by `state`; an
        exception of a callable load reaches the caller.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> coupler, other = (models.split_oscillator(10.0).coupler(0.05) for _ in range(2))
        >>> coupler.step(7)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     coupler.save(pathlib.Path(folder, "state.npz"))
        ...     other.load(pathlib.Path(folder, "state.npz"))
        >>> coupler.step(), other.step()
        (None, None)
        >>> other.step_count, bool(other.state("A").u == coupler.state("A").u)
        (8, True)
        """
        with self._entered():
            self._start()
            arrays = checkpoint.state_arrays(self._parts, self._core, self._row_position)
            checkpoint.write(path, self._problem(), self._core.step_count, arrays)

    def load(self, path: str | PathLike) -> None:
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
            A file written by `save`.

        Raises
        ------
        TypeError, OSError
            For a wrong type of path, and for a file that cannot be read.
        ValueError
            For another problem, with a list of what differs, for any other file, or a damaged one.
            The coupler is then unchanged.
        """
        with self._entered():
            step, arrays = checkpoint.read(path, self._problem())
            state = checkpoint.core_state(path, arrays, self._parts, self._core, self._row_position)
            self._loads = self._loads.renewed()  # stored values of callables are of other times
            self._loads.to_core()
            checkpoint.restore(state, self._parts, self._core, step)
            self._started, self._last_history = True, None

    # ---- inside ------------------------------------------------------------------------------

    @contextmanager
    def _entered(self) -> Iterator[None]:
        """One call at a time: a load that used its own coupler would see an incomplete step."""
        if self._busy:
            raise RuntimeError(
                "the coupler is being stepped: a load, a restoring force or another thread may not "
                "use it meanwhile"
            )
        self._busy = True
        try:
            yield
        finally:
            self._busy = False

    def _problem(self) -> dict[str, Any]:
        """The description of this problem for a checkpoint; the matrices are read once."""
        if self._constants is None:
            matrices = self._rows.matrices
            self._constants = checkpoint.constants(self._options, self._parts, matrices)
        loads = self._loads
        return self._constants | checkpoint.loads(self._parts, loads.forces, loads.motions)

    def _require_linear(self, what: str) -> None:
        for name, s in self._keys:
            if s.restoring is not None or s.internal is not None:
                kind = "a restoring force" if s.internal is None else "an internal force"
                raise ValueError(f"{what} needs linear subdomains, got {kind} on {name!r}")

    def _steps_done(self) -> int:
        return self._core.step_count if self._started else 0

    def _take_loads(self) -> None:
        """Give the core the loads, and start unless the start has to evaluate functions."""
        self._loads.to_core()
        if not self._loads.has_functions:
            self._start()  # otherwise `run` or `step` starts, and may raise an exception of theirs

    def _start(self) -> None:
        """Consistent initial values, unless computed before, equation (S1)."""
        if self._started:
            return
        solver = self._initial.start(
            self._core, self._parts, self._loads, self._row_position, self._initial_accelerations
        )
        self._started = True
        # only a reset needs the factor of M again: kept from the first reset on
        self._initial_accelerations = solver if self._was_reset else None

    def _advance(self, end: int, recording: Recording | None, report: Report | None = None) -> None:
        record = None if recording is None else recording.core_record()
        advance(self._core, self._loads, end, record, report)
