"""The coupled problem: subdomains with their own steps, advanced by the C core."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from os import PathLike
from time import perf_counter
from typing import Any

import numpy as np
from scipy import LowLevelCallable

from .. import _core
from .._checks import (
    MOST,
    check_word,
    flag,
    listing,
    positive_number,
    real_number,
    vector,
    whole_number,
)
from ..errors import CallbackError, ConstraintError, ConstraintWarning, InstabilityError
from ..problem.constraints import Constraint, RowNames, stacked
from ..problem.forces import CallbackLoad, checked_force, core_load, is_callback
from ..problem.matrices import core_matrix
from ..problem.restoring import is_function
from ..problem.springs import SpringState
from ..problem.subdomain import Subdomain
from ..setup.assembly import (
    build,
    interface_factor,
    interface_matrix,
    make_part,
    row_order,
    warn_of_factor,
)
from ..setup.macro import prepare, warn_of_resonance
from ..setup.schedule import (
    check_factorize,
    checked_constraints,
    checked_subdomains,
    double_steps,
    finest,
    most_threads,
    names_of,
)
from ..setup.stability import warn_if_above_critical
from ..setup.start import InitialAccelerations, initial_terms
from ..setup.static import static_displacements
from . import checkpoint
from .history import History, State, SubdomainHistory, by_place, position
from .motion import Motion
from .progress import Report, reporting
from .recording import FiledRecording, Recording

__all__ = ["Coupler", "solve"]

# t_end must be a whole number of macro steps up to this part of one.
WHOLE = 1e-6
# Initial velocities satisfy a condition up to this part of its terms: what rounding leaves of
# velocities that were computed.
ROUNDING = 1e-9
# Loads of Python callables are asked for ahead, at most this many bytes at a time; while a table is
# filled the last one still lives, so that they take 64 MB.
AHEAD = 32_000_000
# They are first asked for so many macro steps at a time, then for twice as many while asking and
# stepping takes less than this, so that Ctrl-C and reports of progress need not wait long.
FIRST_CHUNK, CHUNK_SECONDS = 32, 0.03


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
        self._dt = positive_number(dt, "dt")
        self._macro = coupling == "macro"
        fine = finest(subdomains, coupling)
        self._fine = 1 if self._macro else fine  # interface problems in a macro step
        self._p = sum(c.p for c in constraints)
        names = names_of(subdomains)
        self._keys = tuple(zip(names, subdomains))
        self._options = {"dt": self._dt, "coupling": coupling, "start": start}
        doubles = double_steps(subdomains, coupling)

        self._matrices = stacked(constraints, subdomains)  # L_i in the user's order
        self._row_name = RowNames(constraints)
        self._motions = [
            Motion(i, c, self._row_name.rows(i), self._fine, self._dt)
            for i, c in enumerate(constraints)
            if c.velocity is not None
        ]
        self._initial = [(s.u0, s.v0) for s in subdomains]
        self._row_size = np.zeros(self._p)
        for L in self._matrices:
            np.maximum.at(self._row_size, L.indices, np.abs(L.data))
        self._check_initial_velocities(self._initial)
        self._warn_of_gaps(self._initial)
        self._assemble(names, doubles, start, threads_allowed, factorize)
        for s, name, double in zip(subdomains, names, doubles):
            warn_if_above_critical(s, (2.0 if double else 1.0) * self._dt / s.substeps, name)
        self._last_history: History | None = None
        self._constants: dict[str, Any] | None = None  # of the problem, for a checkpoint
        self._started = self._was_reset = False
        self._busy = False
        self._callbacks: dict[int, CallbackLoad] = {}
        self._set_forces([s.force for s in subdomains])
        if not self._has_callables():
            self._start()  # callables are asked by run or step, which may have to raise

    def _assemble(
        self,
        names: Sequence[str],
        doubles: Sequence[bool],
        start: str,
        threads_allowed: tuple[int, bool],
        factorize: Any,
    ) -> None:
        """Order, factor, and make the objects of the core."""
        p = self._p
        parts = [
            make_part(
                s,
                name,
                double,
                self._dt / s.substeps,
                L,
                factorize,
                ramped=self._macro and s.substeps > 1,
            )
            for (_, s), name, double, L in zip(self._keys, names, doubles, self._matrices)
        ]
        for part in parts:
            warn_of_factor(part)
        rows = row_order(parts, p)
        self._row_place = np.argsort(rows)
        for part in parts:
            part.reorder(self._row_place)
            build(part)
        if self._macro:
            prepare(parts)
        superlu = factorize == "superlu"
        matrix = interface_matrix(parts, p, start=False)
        H = interface_factor(matrix, rows, superlu=superlu)
        if any(part.response for part in parts):
            mean = interface_matrix(parts, p, start=False, mean=True)
            warn_of_resonance(matrix, mean, H, parts, self._row_place)
        H_start = H
        if any(doubles):
            H_start = interface_matrix(parts, p, start=True)
            H_start = interface_factor(H_start, rows, superlu=superlu)
        for part in parts:
            part.blocks.clear()
        self._parts = parts
        self._initial_accelerations = InitialAccelerations(parts, p, rows)
        self._core = _core.Coupler(
            tuple(part.core for part in parts),
            p,
            H_start,
            H,
            self._dt,
            start == "rebased",
            tuple(self._row_place[motion.rows] for motion in self._motions),
            *threads_allowed,
            self._macro,
        )

    # ---- the present -------------------------------------------------------------------------

    @property
    def dt(self) -> float:
        """The macro step."""
        return self._dt

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
        return self._instant(self.step_count)

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
        return State(u[part.place], v[part.place], w[part.place])

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
        return f"<Coupler of {names}; dt = {self._dt:g}, {self._p} conditions>"

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
            end = self._end(t_end, steps, begin)
            make = Recording if record_to is None else partial(FiledRecording, record_to)
            recording = make(
                self._parts,
                self._keys,
                self._row_place,
                fine=self._fine,
                begin=begin,
                end=end,
                dt=self._dt,
                record=record,
                every=every,
                energy=flag(energy, "energy"),
                record_springs=record_springs,
            )
            with reporting(progress, begin, end) as report:
                self._last_history = None
                self._start()
                with self._summing_works(energy), recording:
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
            initial = self._with_others(u0, v0)
            given = by_place(force, self._keys, "force")
            forces = [
                checked_force(given[i], s.n) if i in given else s.force
                for i, (_, s) in enumerate(self._keys)
            ]
            self._check_initial_velocities(initial)
            self._warn_of_gaps(initial)
            kept = self._initial, self._forces, self._callbacks, self._started
            asked = [motion.callback for motion in self._motions]
            self._was_reset = True
            try:
                self._initial, self._started = initial, False
                self._set_forces(forces)
                if not self._has_callables():
                    self._start()  # changes the core in its last lines only
            except BaseException:
                self._initial, self._forces, self._callbacks, self._started = kept
                for motion, callback in zip(self._motions, asked):
                    motion.callback = callback
                self._load_core()
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
            arrays = checkpoint.state_arrays(self._parts)
            arrays["multipliers"] = self._core.multipliers[self._row_place]
            arrays["prescribed"] = self._core.prescribed[self._row_place]
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
            try:
                nodes = [checkpoint.core_nodes(p, i, arrays) for i, p in enumerate(self._parts)]
                lam, g = np.empty((2, self._p))
                lam[self._row_place] = checkpoint.checked(arrays, "multipliers", self._p)
                g[self._row_place] = checkpoint.checked(arrays, "prescribed", self._p)
            except (LookupError, ValueError) as error:
                raise checkpoint.damaged(path, error) from None
            self._set_forces(self._forces)  # callables have been asked for other times
            for part, own in zip(self._parts, nodes):
                part.core.set_nodes(own)
            self._core.start(step, lam, g)
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
            loads = [self._force_at_start(i)[p.place] for i, p in enumerate(self._parts)]
            subdomains = [s for _, s in self._keys]
            u = static_displacements([s.K for s in subdomains], self._matrices, loads)
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

    @contextmanager
    def _summing_works(self, energy: bool) -> Iterator[None]:
        """The core sums up works of each own step, and lets the memory for it go afterwards."""
        try:
            if energy:
                lam = self._core.multipliers
                for i, part in enumerate(self._parts):
                    mass = core_matrix(part.M)
                    part.core.begin_energy(mass, self._force_at_present(i), lam)
            yield
        finally:
            for part in self._parts if energy else ():
                part.core.end_energy()

    def _problem(self) -> dict[str, Any]:
        """What tells this problem from another; the matrices are read once."""
        if self._constants is None:
            self._constants = checkpoint.constants(self._options, self._parts, self._matrices)
        return self._constants | checkpoint.loads(self._parts, self._forces, self._motions)

    def _require_linear(self, what: str) -> None:
        for name, s in self._keys:
            if s.restoring is not None:
                raise ValueError(
                    f"{what} needs linear subdomains, got a restoring force on {name!r}"
                )

    def _steps_done(self) -> int:
        return self._core.step_count if self._started else 0

    def _instant(self, step: int) -> float:
        return step * self._dt  # (T1)

    def _end(self, t_end: float | None, steps: int | None, begin: int) -> int:
        """The macro step at which a run ends."""
        if (t_end is None) == (steps is None):
            raise TypeError("give either t_end or steps, not both or none")
        if steps is not None:
            return begin + whole_number(steps, "steps")
        t_end = real_number(t_end, "t_end")
        if not abs(t_end / self._dt) < MOST:
            raise ValueError(f"t_end must be within {MOST} steps of {self._dt:g}, got {t_end!r}")
        count = round(t_end / self._dt)
        if abs(t_end / self._dt - count) > WHOLE:
            raise ValueError(
                f"t_end must be a whole number of macro steps dt = {self._dt:g}, got {t_end!r}, "
                f"which is {t_end / self._dt:.9g} of them"
            )
        if count < begin:
            raise ValueError(
                f"t_end must not be behind the present, t = {self._instant(begin):g}, got {t_end!r}"
            )
        return count

    def _set_forces(self, forces: Sequence[Any]) -> None:
        self._forces = forces
        self._callbacks = {
            i: CallbackLoad(
                force,
                f"force of subdomain {part.name!r}",
                part.order,
                part.subdomain.substeps,
                self._dt,
            )
            for i, (part, force) in enumerate(zip(self._parts, forces))
            if is_callback(force)
        }
        for motion in self._motions:
            motion.callback = None if motion.known else motion.new_callback()
        self._load_core()

    def _load_core(self) -> None:
        """Give the core all loads but those of callables, which are asked before each advance."""
        for i, (part, force) in enumerate(zip(self._parts, self._forces)):
            if i not in self._callbacks:
                part.core.set_load(core_load(force, part.order))
        for i, motion in enumerate(self._motions):
            if motion.known:
                self._core.set_motion(i, core_load(motion.velocity, np.arange(motion.rows.size)))

    def _has_callables(self) -> bool:
        """Whether functions of the user's have a say, which only `run` and `step` may ask."""
        return (
            bool(self._callbacks)
            or any(isinstance(force, LowLevelCallable) for force in self._forces)
            or not all(motion.known for motion in self._motions)
            or any(is_function(s.restoring) for _, s in self._keys)
        )

    def _prescribed(self, name: str) -> np.ndarray:
        """g(0) or g'(0), (p,), in the user's order of rows."""
        g = np.zeros(self._p)
        for motion in self._motions:
            g[motion.rows] = getattr(motion, name)()
        return g

    def _force_at_start(self, i: int) -> np.ndarray:
        """F(0) of a subdomain, in elimination order."""
        force, part = self._forces[i], self._parts[i]
        if i in self._callbacks:
            return self._callbacks[i].ask_near_start(0.0)
        if force is None:
            return np.zeros(part.n)
        if isinstance(force, LowLevelCallable):
            return self._answered(part.core.force(0.0), "force", i)
        return (force(0.0) if callable(force) else force)[part.order]

    def _restoring_at_start(self, i: int, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """r(u_0, v_0, 0) of a subdomain, in elimination order."""
        return self._answered(self._parts[i].core.restore(0.0, u, v), "restoring force", i)

    def _answered(self, values: np.ndarray | int, what: str, i: int) -> np.ndarray:
        """What a function gave where the coupler stands, unless it is a code."""
        if isinstance(values, int):
            step = self._steps_done()
            raise CallbackError(values, what, step, self._instant(step), self._parts[i].name)
        return values

    def _force_at_present(self, i: int) -> np.ndarray:
        """F of a subdomain where the coupler stands, in elimination order."""
        step, part = self._core.step_count, self._parts[i]
        if step == 0:
            return self._force_at_start(i)
        if i in self._callbacks:
            return self._callbacks[i].ask_again(step * part.subdomain.substeps)
        force = self._forces[i]
        if force is None:
            return np.zeros(part.n)
        if isinstance(force, LowLevelCallable):
            return self._answered(part.core.force(self._instant(step)), "force", i)
        return (force(self._instant(step)) if callable(force) else force)[part.order]

    def _start(self) -> None:
        """Consistent initial values, if that was not done yet."""
        if self._started:
            return
        states = [
            (u[part.order], v[part.order]) for part, (u, v) in zip(self._parts, self._initial)
        ]
        loads = [self._force_at_start(i) for i in range(len(self._parts))]
        with np.errstate(over="ignore", invalid="ignore"):  # seen below
            terms = [initial_terms(p, F, *x) for p, F, x in zip(self._parts, loads, states)]
        for i, (part, x) in enumerate(zip(self._parts, states)):
            if part.subdomain.restoring is not None:
                terms[i].append(-self._restoring_at_start(i, *x))
        rows = np.argsort(self._row_place)
        g, slope = self._prescribed("value")[rows], self._prescribed("slope")[rows]
        if not all(motion.known for motion in self._motions):
            self._check_initial_velocities(self._initial, asked=True)
        solver = self._initial_accelerations or InitialAccelerations(self._parts, self._p, rows)
        accelerations, lam = solver.solve(terms, slope)
        for part, w in zip(self._parts, accelerations):
            if not np.all(np.isfinite(w)):
                raise InstabilityError(0, 0.0, part.name)
        for part, (u, v), w in zip(self._parts, states, accelerations):
            part.core.start(u, v, w, lam)
        self._core.start(0, lam, g)
        self._started = True
        # the factor of M serves nobody but a later reset; who resets once will do it again
        self._initial_accelerations = solver if self._was_reset else None

    def _warn_of_gaps(self, initial) -> None:
        rows, gaps = self._broken_rows([u for u, _ in initial])
        if rows.size:
            amounts = [f"{self._row_name(int(r))}: {x:g}" for r, x in zip(rows, gaps)]
            warnings.warn(
                f"the initial displacements leave a gap, which stays for ever, in rows "
                f"{listing(amounts)}",
                ConstraintWarning,
                stacklevel=3,
            )

    def _check_initial_velocities(self, initial, *, asked: bool = False) -> None:
        """ConstraintError unless sum L v_0 = g(0), once g(0) can be known."""
        if not asked and not all(motion.known for motion in self._motions):
            return
        rows, gaps = self._broken_rows([v for _, v in initial], self._prescribed("value"))
        if rows.size:
            amounts = [f"{self._row_name(int(r))} by {x:g}" for r, x in zip(rows, gaps)]
            raise ConstraintError(
                f"the initial velocities v0 break the interface conditions, rows {listing(amounts)}"
            )

    def _broken_rows(
        self, values: Sequence[np.ndarray], g: np.ndarray | float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """The rows in which sum L_i x_i is not g but for rounding, and by how much it is not.

        Rows are compared with their largest entry divided out, since a condition times a number is
        the same condition.
        """
        pairs = [(L, x) for L, x in zip(self._matrices, values) if x.any()]
        if not pairs and not np.any(g):
            return np.empty(0, dtype=np.int64), np.empty(0)
        jump = sum((L @ x for L, x in pairs), np.zeros(self._p)) - g
        size = sum((abs(L) @ np.abs(x) for L, x in pairs), np.zeros(self._p)) + np.abs(g)
        largest = np.max(size / self._row_size, initial=0.0)
        rows = np.flatnonzero(np.abs(jump) / self._row_size > ROUNDING * largest)
        return rows, jump[rows]

    def _with_others(self, u0, v0) -> list[tuple[np.ndarray, np.ndarray]]:
        chosen = []
        for name, others in (("u0", u0), ("v0", v0)):
            given = by_place(others, self._keys, name)
            chosen.append(
                [
                    vector(given[i], s.n, f"{name} of {key!r}") if i in given else getattr(s, name)
                    for i, (key, s) in enumerate(self._keys)
                ]
            )
        return list(zip(*chosen))

    def _advance(self, end: int, recording: Recording | None, report: Report | None = None) -> None:
        """Macro steps up to number `end`, in chunks for which the loads are asked ahead."""
        record = None if recording is None else recording.core_record()
        for chunk in self._chunks(end):
            ready, failure = self._prepare(self._core.step_count, chunk)
            failed = self._core.advance(ready - self._core.step_count, record, report)
            if failed is not None:
                raise self._failure(failed)
            if failure is not None:
                raise failure
            if report is not None:
                report.if_due(self._core.step_count)

    def _chunks(self, end: int) -> Iterator[int]:
        """Ends of chunks of macro steps; with callables of so many as take about 50 ms.

        A chunk ends before more is asked than fits, and soon enough for Ctrl-C and for a report.
        """
        size = sum(c.bytes_per_macro_step for c in self._all_callbacks())
        most = max(1, AHEAD // size) if size else end
        steps = min(FIRST_CHUNK, most) if size else most
        while self._core.step_count < end:
            begin = perf_counter()
            yield min(end, self._core.step_count + steps)
            seconds = perf_counter() - begin
            steps = min(2 * steps, most) if seconds < CHUNK_SECONDS else max(1, steps // 2)

    def _failure(self, failed: int | tuple[int, int, str]) -> Exception:
        """What became of a macro step that the core did not finish."""
        step = self._core.step_count
        names = [name for name, _ in self._keys] + ["interface"]
        if isinstance(failed, tuple):
            place, code, what = failed
            return CallbackError(code, what, step, self._instant(step), names[place])
        return InstabilityError(step, self._instant(step), names[failed])

    def _prepare(self, begin: int, end: int) -> tuple[int, BaseException | None]:
        """Ask the callables; the macro step up to which all loads are there, and why no further."""
        first_failure = None
        for callback in self._all_callbacks():
            end, failure = callback.prepare(begin, end)
            first_failure = failure if failure is not None else first_failure
        for i, callback in self._callbacks.items():
            self._parts[i].core.set_load((callback.rows, callback.first))
        for i, motion in enumerate(self._motions):
            if motion.callback is not None:
                self._core.set_motion(i, (motion.callback.rows, motion.callback.first))
        return end, first_failure

    def _all_callbacks(self) -> list[CallbackLoad]:
        moved = [motion.callback for motion in self._motions if motion.callback is not None]
        return [*self._callbacks.values(), *moved]


def solve(
    subdomain: Subdomain,
    dt: float,
    t_end: float | None = None,
    *,
    threads: int | None = None,
    **as_run: Any,
) -> SubdomainHistory:
    """One uncoupled subdomain, with the same schemes and the same core.

    Parameters
    ----------
    subdomain : Subdomain
        Its own step is dt / substeps.
    dt : float
        As for `Coupler`.
    t_end, **as_run
        As for `Coupler.run`.
    threads : int, optional
        As for `Coupler`.

    Returns
    -------
    SubdomainHistory

    Examples
    --------
    >>> oscillator = Subdomain([1.0], [4.0], scheme=Newmark(), u0=[1.0])
    >>> float(np.round(solve(oscillator, dt=0.001, t_end=1.0).u[-1, 0], 4))
    -0.4161
    """
    return Coupler([subdomain], dt=dt, threads=threads).run(t_end, **as_run)[0]
