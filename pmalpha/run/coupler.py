"""The coupled problem: subdomains with their own steps, advanced by the C core."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from os import PathLike
from typing import Any

import numpy as np

from .._checks import check_word, flag, positive_number, whole_number
from ..problem.constraints import Constraint
from ..problem.forces import checked_force
from ..problem.springs import SpringState
from ..problem.subdomain import Subdomain
from ..setup.assembly import assemble
from ..setup.constraint_rows import ConstraintRows
from ..setup.schedule import (
    check_factorize,
    checked_constraints,
    checked_subdomains,
    double_steps,
    finest,
    most_threads,
    names_of,
)
from ..setup.start import InitialAccelerations
from ..setup.static import static_displacements
from . import checkpoint
from .advance import advance
from .clock import Clock
from .energy import summed_works
from .history import History, State
from .initial import InitialValues
from .keys import by_place, position
from .loads import Loads
from .motion import motions_of
from .progress import Report, reporting
from .recording import FiledRecording, Recording

__all__ = ["Coupler"]


class Coupler:
    """Subdomains tied at their velocities, each with its own scheme and step.

    Parameters
    ----------
    subdomains : sequence of `Subdomain`
        At least one. They are not changed.
    constraints : `Constraint` or list of them, optional
        The interface conditions, from `tie` or general ones. They must be independent.
    dt : float
        The macro step, in any consistent unit, positive. Subdomain i steps by dt / substeps_i; the
        largest number of substeps must be a multiple of all, except under "macro".
    coupling : {"pm", "gc", "macro"}, default "pm"
        "pm": interfield parallel, with double steps (PM-alpha; with Newmark schemes the PM
        method). "gc": staggered, single steps (GC-alpha). "macro": multipliers linear over the
        macro step and found once in it, velocities tied at macro nodes; of order 2 with any
        substeps, double steps only where ``double_step=True`` (and ``substeps=1``). See
        docs/couplings.md for which when.
    start : {"rebased", "plain"}, default "rebased"
        What is done with the stored free velocity when a subdomain changes over to double steps
        after the first macro step, equation (S3). "plain" does nothing, as in the paper. Under
        "macro" no step reads a stored free velocity, and it makes no difference.
    threads : int, optional
        At most so many threads work on the subdomains, the calling one among them; 1 is none
        besides it. Results are the same bit for bit for any number. Default: as many as there are
        processors for this process, where equations (W1) to (W3) of docs/method.md, which know
        sizes only, say that they save a fifth of the time, else 1. `Coupler.threads` is what was
        decided: more than there are subdomains only where a large explicit one is split among
        them.
    factorize : None, "superlu" or callable, optional
        Who factors the sparse matrices Mbar and M of the subdomains. None: our own supernodal
        code, and SciPy's SuperLU where a matrix hardly fills in. "superlu": always SuperLU, slower
        and larger. A callable ``factorize(A, last) -> (L, D, perm)``: see Notes.

    Raises
    ------
    TypeError, ValueError
        For arguments of the wrong kind, equal names, substeps that do not divide the largest,
        everybody at the finest step double, an initial state that does not fit; for what
        `factorize` returns; under "macro" for a double step with substeps, and for unit runs that
        would take longer than a day.
    ConstraintError
        For conditions that depend on one another or that the initial velocities break.
    FactorizationError
        For a singular or indefinite Mbar or mass matrix, with subdomain, dof and inertia.
    MemoryError
        For a problem whose predicted size does not fit.

    Warns
    -----
    StabilityWarning
        When an own step is above the critical step of its subdomain; under "macro" when a part
        resonates with the macro step, and for a double step that damps nothing (rho = 1).
    PerformanceWarning
        When the unit runs of "macro" take long; when M or C of an explicit subdomain is not
        diagonal and sweeping the factor that it needs takes longer than all the rest of its step,
        from 100 000 entries on (smaller ones stay in the caches).
    ConstraintWarning
        When initial displacements leave a gap; under "macro" for interface dofs without mass in a
        subdomain with substeps.

    Notes
    -----
    Equations (1) to (18) of docs/method.md; Bursi, He, Bonelli and Pegon 2008.

    A `factorize` of your own is called when the Coupler is made, once for each matrix of a
    subdomain that has sparse ones, with `A`, an (n, n) csc_array of both triangles in your order of
    the dofs, and `last`, a sorted (nb,) array: the dofs of the interface. It returns `L`, (n, n)
    lower triangular with a diagonal of ones or none, sparse or dense, `D`, (n,) positive, and
    `perm`, (n,) int, ending with the dofs of `last` in any order, so that
    ``A[perm][:, perm] = L @ diag(D) @ L.T``. All matrices of a subdomain have the same pattern, in
    which zeros are stored, and must get the same `perm`. Diagonal and dense matrices and the
    interface matrix are factored by the package.

    Examples
    --------
    A mass split in two, one half with twenty steps to one of the other:

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
        coupling: str = "pm",
        start: str = "rebased",
        threads: int | None = None,
        factorize: Any = None,
    ):
        subdomains = checked_subdomains(subdomains)
        constraints = checked_constraints(constraints, subdomains)
        check_word(coupling, "coupling", ("pm", "gc", "macro"))
        check_word(start, "start", ("rebased", "plain"))
        threads_allowed = most_threads(threads)
        check_factorize(factorize)
        self._clock = Clock(positive_number(dt, "dt"))
        fine = finest(subdomains, coupling)
        self._fine = 1 if coupling == "macro" else fine  # interface problems in a macro step
        self._keys = tuple(zip(names_of(subdomains), subdomains))
        self._options = {"dt": self.dt, "coupling": coupling, "start": start}
        doubles = double_steps(subdomains, coupling)

        self._rows = ConstraintRows(constraints, subdomains)
        motions = motions_of(constraints, self._rows, self._fine, self.dt)
        self._initial = InitialValues(self._keys, self._rows)
        self._initial.check(motions)
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
        self._row_place = assembly.row_position
        self._initial_accelerations: InitialAccelerations | None = assembly.accelerations

        self._last_history: History | None = None
        self._constants: dict[str, Any] | None = None  # of the problem, for a checkpoint
        self._started = self._was_reset = False
        self._busy = False
        forces = [s.force for s in subdomains]
        self._loads = Loads(self._core, self._parts, self._clock, forces, motions)
        self._take_loads()

    # ---- the present -------------------------------------------------------------------------

    @property
    def dt(self) -> float:
        """The macro step."""
        return self._clock.dt

    @property
    def threads(self) -> int:
        """Threads that share the work, the calling one among them."""
        return self._core.threads

    @property
    def step_count(self) -> int:
        """Macro steps done."""
        with self._entered():
            return self._steps_done()

    @property
    def time(self) -> float:
        """The time where the coupler stands, equation (T1)."""
        return self._clock.time(self.step_count)

    @property
    def multipliers(self) -> np.ndarray:
        """Lam, (p,), at the present; a copy."""
        with self._entered():
            self._start()
            return self._core.multipliers[self._row_place]

    @property
    def last_history(self) -> History | None:
        """After an exception or Ctrl-C in `run`: the History up to the last whole macro step."""
        return self._last_history

    def state(self, key: str | int | Subdomain) -> State:
        """Displacement, velocity and true acceleration of a subdomain now; copies.

        Parameters
        ----------
        key : str, int or Subdomain
            Its name, its place, or itself.

        Raises
        ------
        KeyError, IndexError
            When there is no such subdomain.
        """
        part = self._parts[position(key, self._keys)]
        with self._entered():
            self._start()
            u, v, w = part.core.state()
        return State(u[part.position], v[part.position], w[part.position])

    def springs(self, key: str | int | Subdomain) -> SpringState:
        """Deformation and force of the springs of a subdomain now; copies.

        Parameters
        ----------
        key : str, int or Subdomain
            Its name, its place, or itself.

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
        part = self._parts[position(key, self._keys)]
        with self._entered():
            self._start()
            deformation, force, _ = part.core.springs()
        return SpringState(deformation, force)

    def __reduce__(self) -> tuple:
        raise TypeError("a Coupler cannot be copied or pickled: its state lives in the core")

    def __repr__(self) -> str:
        names = ", ".join(repr(name) for name, _ in self._keys)
        return f"<Coupler of {names}; dt = {self.dt:g}, {self._rows.p} conditions>"

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
        record_springs: Mapping[Any, Any] | None = None,
        progress: Any = None,
    ) -> History:
        """Go on from where the coupler is, and record.

        Parameters
        ----------
        t_end : float
            Absolute time, a whole number of macro steps from 0 up to 1e-6 of a step, and not
            behind the present. Give this or `steps`.
        steps : int
            Macro steps to do, 0 or more.
        record : dict, optional
            Dofs to keep by subdomain, None for all of one; a subdomain left out is not recorded.
            Default: everything.
        every : int, optional
            Keep macro nodes whose `step_count` is a multiple of this, and the first node of the
            stretch, in all arrays. Default: every own node of each subdomain.
        record_springs : dict, optional
            Springs whose deformation and force to keep, by subdomain, None for all of one:
            numbers in the order of the springs. Default: none.
        energy : bool, default False
            Sum up where the energy goes, from the first node of this stretch on, for all
            subdomains; at macro nodes in ``history.energy``, an `Energy`. It changes no result and
            costs a product with C in each own step, those with M and K where a macro node is
            recorded, and 13 vectors of memory; under "macro" 3 more for each substep, and stored
            responses are repeated.
        record_to : str or path, optional
            An HDF5 file that the History goes to while the run goes on, with some 16 MB of it in
            memory. A file that stands there is replaced before the first step. The History that is
            returned, and `last_history`, then have arrays that are mapped from the file: what is
            looked at is read. `History.load` and other programs can read the file meanwhile and
            after a kill, up to where it was last written, about three times a second.
        progress : True or callable, optional
            True: a tqdm bar. A callable is told ``progress(done, total)`` in macro steps of this
            call, about every 50 ms and at the end; it may not ask the coupler, and what it raises
            ends the run as Ctrl-C does.

        Returns
        -------
        History

        Raises
        ------
        TypeError, ValueError
            For arguments that do not fit, and for what a load returns.
        InstabilityError
            When a value is not finite.
        CallbackError
            When a compiled function did not return 0.
        MemoryError
            When the History does not fit.
        ImportError
            For ``progress=True`` without tqdm, and for `record_to` without h5py.
        OSError
            When `record_to` cannot be written: before anything is asked where the path is at fault.

        Whatever a load or a restoring force raises reaches the caller, and so does Ctrl-C within
        0.1 s or a fine step, whichever is longer. After any exception the coupler stands at the
        last whole macro step, `last_history` holds the run up to there, and it can go on.
        """
        with self._entered():
            begin = self._steps_done()
            end = self._clock.end(t_end, steps, begin)
            make = Recording if record_to is None else partial(FiledRecording, record_to)
            recording = make(
                self._parts,
                self._keys,
                self._row_place,
                fine=self._fine,
                begin=begin,
                end=end,
                dt=self.dt,
                record=record,
                every=every,
                energy=flag(energy, "energy"),
                record_springs=record_springs,
            )
            with reporting(progress, begin, end) as report:
                self._last_history = None
                self._start()
                with summed_works(self._core, self._parts, self._loads, energy), recording:
                    self._core.record_present(recording.core_record())
                    try:
                        for pause in recording.stretches():
                            self._advance(pause, recording, report)
                            recording.keep(pause)
                        if report is not None:
                            report(end)
                    except BaseException:
                        self._last_history = recording.history(self._core.step_count)
                        raise
            return recording.history(end)

    def step(self, n: int = 1) -> None:
        """n macro steps without a History.

        Raises as `run` does; the result is the same bit for bit.
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
        """Back to t = 0, with all factors kept.

        But for the one of M: it is given back after the start, made again by the first reset, and
        kept from then on.

        Parameters
        ----------
        u0, v0, force : dict, optional
            Other initial values or loads by subdomain. What is not named is as the subdomain
            was made.

        Raises
        ------
        TypeError, ValueError, ConstraintError, InstabilityError
            As when the coupler was made. Nothing has changed then.
        """
        with self._entered():
            initial = InitialValues(self._keys, self._rows, u0, v0)
            given = by_place(force, self._keys, "force")
            forces = [
                checked_force(given[i], s.n) if i in given else s.force
                for i, (_, s) in enumerate(self._keys)
            ]
            initial.check(self._loads.motions)
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
        """Write the present state to a file, from which `load` goes on bit for bit.

        An npz file without pickled objects: the state and a description of the problem with check
        sums of its matrices, not the matrices themselves. It takes its place when it is whole: a
        file that stood there stays good if saving is interrupted.

        Parameters
        ----------
        path : str or path
            Taken as it is; no ending is added.

        Raises
        ------
        TypeError, OSError
            For what is no path, and for a file that cannot be written.

        Before the first step the initial accelerations are found first, as `state` does, with
        what a callable load may raise then.

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
            arrays = checkpoint.state_arrays(self._parts, self._core, self._row_place)
            checkpoint.write(path, self._problem(), self._core.step_count, arrays)

    def load(self, path: str | PathLike) -> None:
        """Stand where a coupler of the same problem stood when it was saved.

        A method of a coupler that was built the same way, in this process or another. The run that
        goes on equals the one that was never interrupted bit for bit, with the same build, CPU and
        packages. Initial values do not count as part of the problem. Loads do: constant and
        sampled ones are compared by their numbers; callables cannot be compared, and it is up to
        the caller that they are the same functions. They are asked on from there.

        Parameters
        ----------
        path : str or path
            What `save` wrote.

        Raises
        ------
        TypeError, OSError
            For what is no path, and for a file that cannot be read.
        ValueError
            For another problem, saying what differs, for any other file, or a damaged one.
            Nothing has changed then.
        """
        with self._entered():
            step, arrays = checkpoint.read(path, self._problem())
            state = checkpoint.core_state(path, arrays, self._parts, self._row_place)
            self._loads = self._loads.renewed()  # callables were evaluated at other times
            self._loads.to_core()
            for part, nodes in zip(self._parts, state.nodes):
                part.core.set_levels(nodes)
            self._core.start(step, state.multipliers, state.prescribed)
            self._started, self._last_history = True, None

    def static(self) -> dict[str, np.ndarray]:
        """Static equilibrium under F(0), with displacements tied: u0 for gravity before the quake.

        Prescribed rows are held at zero. The coupler itself does not change; use
        ``coupler.reset(u0=coupler.static())``.

        Returns
        -------
        dict of (n_i,) arrays by name

        Raises
        ------
        FactorizationError
            When the structure is floating or its stiffness indefinite.
        ValueError
            When a subdomain has a restoring force: that equilibrium is nonlinear.

        Examples
        --------
        >>> a = Subdomain([1.0], [2.0], scheme=Newmark(), force=[3.0], name="a")
        >>> b = Subdomain([1.0], [1.0], scheme=CentralDifference(), name="b")
        >>> coupler = Coupler([a, b], tie(a, [0], b, [0]), dt=0.1)
        >>> {name: float(u[0]) for name, u in coupler.static().items()}
        {'a': 1.0, 'b': 1.0}
        """
        self._require_linear("static")
        with self._entered():
            step = self._steps_done()
            forces = [self._loads.at_start(i, step)[p.position] for i, p in enumerate(self._parts)]
            u = static_displacements([s.K for _, s in self._keys], self._rows.matrices, forces)
        return dict(zip((name for name, _ in self._keys), u))

    # ---- inside ------------------------------------------------------------------------------

    @contextmanager
    def _entered(self) -> Iterator[None]:
        """One call at a time: a load that asks its own coupler would see half a step."""
        if self._busy:
            raise RuntimeError(
                "the coupler is being stepped: a load, a restoring force or another thread may not "
                "ask it meanwhile"
            )
        self._busy = True
        try:
            yield
        finally:
            self._busy = False

    def _problem(self) -> dict[str, Any]:
        """What tells this problem from another; the matrices are read once."""
        if self._constants is None:
            matrices = self._rows.matrices
            self._constants = checkpoint.constants(self._options, self._parts, matrices)
        loads = self._loads
        return self._constants | checkpoint.loads(self._parts, loads.forces, loads.motions)

    def _require_linear(self, what: str) -> None:
        for name, s in self._keys:
            if s.restoring is not None:
                raise ValueError(
                    f"{what} needs linear subdomains, got a restoring force on {name!r}"
                )

    def _steps_done(self) -> int:
        return self._core.step_count if self._started else 0

    def _take_loads(self) -> None:
        """Give the core the loads, and start unless functions have to be evaluated for that."""
        self._loads.to_core()
        if not self._loads.has_functions:
            self._start()  # otherwise `run` or `step` does, which may have to raise

    def _start(self) -> None:
        """Consistent initial values, unless they were found before, equation (S1)."""
        if self._started:
            return
        solver = self._initial.start(
            self._core, self._parts, self._loads, self._row_place, self._initial_accelerations
        )
        self._started = True
        # only a later reset needs the factor of M: kept from the first one on
        self._initial_accelerations = solver if self._was_reset else None

    def _advance(self, end: int, recording: Recording | None, report: Report | None = None) -> None:
        record = None if recording is None else recording.core_record()
        advance(self._core, self._loads, end, record, report)
