"""The processes of a coupler with `comm`: what they tell each other, and errors on one of them.

All processes make the same sequence of collective calls. Each call also carries an error: a process
in which something failed takes part in the next call, whichever it is, and all of them raise there.
"""

from __future__ import annotations

import ctypes
import hashlib
import inspect
import pickle
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias, TypedDict, TypeVar

import numpy as np
import scipy.sparse as sp

from ..errors import InstabilityError, PmalphaError
from ..files import checked_path, library
from ..problem import forms
from ..problem.constraints import Constraint
from ..problem.contacts import Contact
from ..problem.loads import as_load
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from .member import Member

# ---- core failure -------------------------------------------------------------------------------
# What ended a macro step in the core, by names: its one description in Python. Positions of dofs
# are those of the core, None where there is none; subdomains are counted over all processes.


class Unstable(TypedDict):
    """A value that is not finite, or a motion out of bounds; after all subdomains the interface."""

    kind: Literal["unstable"]
    subdomain: int


class NotConverged(TypedDict):
    """An iteration of a subdomain, at t; the dof where its tangent is singular, and the one where
    the force of its compiled functions is not finite; whether all values were."""

    kind: Literal["iteration"]
    subdomain: int
    t: float
    corrections: int
    singular: int | None
    spoiled: int | None
    finite: bool


class InterfaceNotConverged(TypedDict):
    """The iteration of the interface, whose matrix of the tangents may be singular."""

    kind: Literal["interface"]
    singular: bool


class Unsymmetric(TypedDict):
    """A tangent that should be symmetric, at t."""

    kind: Literal["unsymmetric"]
    subdomain: int
    t: float


class FunctionFailed(TypedDict):
    """A compiled function returned a code; what it is to the subdomain."""

    kind: Literal["function"]
    subdomain: int
    code: int
    what: str


class Limited(TypedDict):
    """A command or a force beyond a limit of a rig."""

    kind: Literal["limit"]
    subdomain: int
    what: str
    position: int
    value: float
    limit: float
    t: float
    by_clock: bool


class NoImpulses(TypedDict):
    """The impulses of contacts do not come to an end, furthest in this row."""

    kind: Literal["contact"]
    row: int


class Late(TypedDict):
    """A step of a paced run ended late."""

    kind: Literal["late"]


class FailedElsewhere(TypedDict):
    """Something failed in another process; in this one when the exchange did."""

    kind: Literal["elsewhere"]
    rank: int


Failure: TypeAlias = (
    Unstable
    | NotConverged
    | InterfaceNotConverged
    | Unsymmetric
    | FunctionFailed
    | Limited
    | NoImpulses
    | Late
    | FailedElsewhere
)


# ---- remade -------------------------------------------------------------------------------------
# A coupler of the same problem as another one at t = 0, with other steps or matrices.

# What a Subdomain is made of; its C has these already.
IN_C = {"rayleigh", "damping_ratio"}
ARGUMENTS = [name for name in inspect.signature(Subdomain).parameters if name not in IN_C]


def remade(
    session: Any,
    make: Callable[..., Any],
    change: Callable[[str, dict[str, Any]], None],
    *,
    of_motion: Callable[[Any, str], Any] = lambda motion, _: motion,
    constraints: Any = None,
    **options: Any,
) -> Any:
    """The coupler at t = 0, with the present initial values and loads.

    make: makes a coupler, with the arguments of `Coupler`.
    change: changes the arguments of the `Subdomain` of this name, a dict.
    of_motion: ``of_motion(motion, what)`` is taken in place of a prescribed velocity and of the
        motion of a contact, `what` being its name in messages.
    constraints: in place of those of the coupler.
    options: those of `Coupler` in place of those with which it was made.
    """
    subdomains = []
    present = zip(session.keys, session.loads.forces, session.initial.values)
    for (key, s), force, (u0, v0) in present:
        arguments: dict[str, Any] = {x: getattr(s, x) for x in ARGUMENTS}
        arguments |= dict(name=key, force=force, u0=u0, v0=v0)
        for matrix in "MK":  # None is one of zeros
            arguments[matrix] = np.zeros(s.n) if arguments[matrix] is None else arguments[matrix]
        change(key, arguments)
        subdomains.append(Subdomain(**arguments))
    if constraints is None:
        constraints = [*_constraints(session, of_motion), *_contacts(session, of_motion)]
    options = {**session.options._asdict(), **options}
    return make(subdomains, constraints, **options)


def _constraints(session: Any, of_motion: Callable[[Any, str], Any]) -> Iterator[Constraint]:
    rows, names = session.rows, [name for name, _ in session.keys]
    motions = {int(motion.rows[0]): motion for motion in session.loads.motions}
    for first, last in zip(rows.starts, rows.starts[1:]):
        matrices = {name: sp.csr_array(L)[first:last] for name, L in zip(names, rows.matrices)}
        sides: Mapping[str, Any] = {name: L for name, L in matrices.items() if L.nnz}
        motion = motions.get(int(first))
        velocity = None if motion is None else of_motion(motion.velocity, motion.what)
        yield Constraint(sides, velocity)


def _contacts(session: Any, of_motion: Callable[[Any, str], Any]) -> Iterator[Contact]:
    names = {s: name for name, s in session.keys}
    known = session.rows.contacts
    for c, label in () if known is None else zip(known.contacts, known.names):
        matrices, *tangents = (
            {names.get(s, s): N for s, N in x.items()} for x in (c.matrices, *c.tangents)
        )
        numbers = ("gap", "friction", "friction_static", "restitution", "name")
        arguments = {x: getattr(c, x) for x in numbers}
        what = f"motion of {label!r}"
        motion: Any = (
            tuple(of_motion(f, what) for f in c.motion)
            if isinstance(c.motion, tuple)
            else of_motion(c.motion, what)
        )
        yield Contact(matrices, tangents=tangents, motion=motion, **arguments)


# ---- ranks --------------------------------------------------------------------------------------

T = TypeVar("T")
# Pieces of its interface values that the core sends of a subdomain at a time, at most, and numbers
# that measure an iteration, with whether its residual is finite (pma_exchange_size).
PIECES, MEASURES = 3, 9


@dataclass(frozen=True)
class Described:
    """A subdomain of another process, before it is set up: what is decided for all together."""

    name: str | None
    n: int
    substeps: int
    scheme: Scheme
    double_step: bool | None
    dof_names: Sequence[str] | None = None
    # its own process refuses these
    restoring: ClassVar[None] = None
    internal: ClassVar[None] = None
    has_feedback: ClassVar[bool] = False


class Elsewhere(Exception):
    """The core says that another process has failed; replaced by what that has to say."""


class Ranks:
    """The processes of a communicator.

    comm: it is duplicated, so that no message of the user can be taken for one of these.
    first: (size + 1,) array of int, the number of the first subdomain of each rank, from
        `described` on.
    """

    def __init__(self, comm: Any):
        MPI = _library()
        if not isinstance(comm, MPI.Intracomm):
            raise TypeError(f"comm must be a communicator of mpi4py, got {comm!r}")
        self.comm = comm.Dup()
        self.rank, self.size = self.comm.rank, self.comm.size
        self.first = np.zeros(self.size + 1, dtype=np.int64)
        self._interrupted = False
        self._agreed: BaseException | None = None  # the exception that all processes know of
        self._inside = False

    def __del__(self) -> None:
        # freed together by MPI_Finalize: Free is collective, and this is called at any time
        self.comm = None

    @property
    def part(self) -> slice:
        """The subdomains of this process among all of them."""
        return slice(*self.first[self.rank : self.rank + 2].tolist())

    # ---- what all know -----------------------------------------------------------------------

    def share(self, value: T) -> list[T]:
        """The value of every process, by rank; raises on all if one has failed."""
        if self._interrupted:
            self._interrupted = False
            raise KeyboardInterrupt
        answers = self.comm.allgather((None, value))
        self._raise_of_others([error for error, _ in answers])
        return [value for _, value in answers]

    def joined(self, values: Sequence[T]) -> list[T]:
        """The entries of all processes, in the order of subdomains."""
        return [entry for entries in self.share(list(values)) for entry in entries]

    def require_equal(self, what: str, value: Any) -> None:
        """ValueError unless all processes have the same value."""
        values = self.share(value)
        for rank, other in enumerate(values):
            if other != values[0]:
                raise ValueError(f"{what} must be the same on all ranks, differs on {rank} and 0")

    # ---- errors ------------------------------------------------------------------------------

    @contextmanager
    def together(self) -> Iterator[None]:
        """A call that all processes make: it ends on all, or with an exception on all.

        Ctrl-C waits for a place where it can be told to the others.
        """
        if self._inside:
            yield
            return
        self._inside, self._agreed = True, None
        try:
            with self._interrupts_noted():
                try:
                    yield
                    self.share(None)
                except BaseException as error:
                    if error is not self._agreed:
                        self._tell(error)
                    raise
        finally:
            self._inside = self._interrupted = False

    @contextmanager
    def entered(self, guard: Any) -> Iterator[None]:
        """The same, of a coupler with this guard."""
        with self.together(), guard:
            yield

    def report(self, report: Callable[[int], Any] | None) -> Callable[[int], Any]:
        """What the core calls every 50 ms: also raises a Ctrl-C that has arrived."""

        def call(step: int) -> None:
            if self._interrupted:
                self._interrupted = False
                raise KeyboardInterrupt
            if report is not None:
                report(step)

        return call

    def _tell(self, error: BaseException) -> None:
        """Takes part in the next call with an exception of this process."""
        sent = None if isinstance(error, Elsewhere) else _sendable(error)
        answers = self.comm.allgather((sent or (None, str(error)), None))
        if sent is None:
            self._raise_of_others([other for other, _ in answers], elsewhere=True)

    def _raise_of_others(self, errors: Sequence[Any], elsewhere: bool = False) -> None:
        known = [(r, e) for r, e in enumerate(errors) if e is not None and e[0] is not None]
        if known:
            self._agreed = _received(*known[0])
            raise self._agreed from None
        if elsewhere or any(e is not None for e in errors):
            self._agreed = PmalphaError("the processes could not exchange their interface values")
            raise self._agreed from None

    @contextmanager
    def _interrupts_noted(self) -> Iterator[None]:
        usual = signal.getsignal(signal.SIGINT)
        if usual is None or threading.current_thread() is not threading.main_thread():
            yield
            return

        def note(number: int, frame: Any) -> None:
            self._interrupted = True

        signal.signal(signal.SIGINT, note)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, usual)

    # ---- the core ----------------------------------------------------------------------------

    def gather(self, size: int) -> tuple[Any, ...]:
        """(all, counts, starts, function) for the core: the function fills `all` from all ranks."""
        MPI = _library()
        values = np.zeros(size)
        counts, starts = np.zeros((2, self.size), dtype=np.intc)
        received = [values, counts, starts, MPI.DOUBLE]

        def fill() -> None:
            self.comm.Allgatherv(MPI.IN_PLACE, received)

        direct = self._address()
        works = self.share(direct is not None and self._is_right(*direct))
        return values, counts, starts, direct if all(works) else fill

    def _address(self) -> forms.Allgatherv | None:
        """MPI_Allgatherv in the library that mpi4py has loaded, and the handles it takes."""
        MPI = _library()
        try:
            library = ctypes.CDLL(MPI.__file__)
            address = ctypes.cast(library.MPI_Allgatherv, ctypes.c_void_p).value
            double, comm = (
                ctypes.c_ssize_t(MPI._handleof(x)).value for x in (MPI.DOUBLE, self.comm)
            )
        except (OSError, AttributeError):
            return None
        return None if address is None else forms.Allgatherv(address, double, comm)

    def _is_right(self, address: int, double: int, comm: int) -> bool:
        """Does a call by address what it should?"""
        word, pointer = ctypes.c_ssize_t, ctypes.c_void_p
        kinds = (pointer, ctypes.c_int, word, pointer, pointer, pointer, word, word)
        function = ctypes.CFUNCTYPE(ctypes.c_int, *kinds)(address)
        sent, received = np.array([1.5 + self.rank]), np.zeros(self.size)
        counts = np.ones(self.size, dtype=np.intc)
        starts = np.arange(self.size, dtype=np.intc)
        buffers = (x.ctypes.data for x in (received, counts, starts))
        failed = function(sent.ctypes.data, 1, double, *buffers, double, comm)
        return not failed and bool(np.array_equal(received, 1.5 + np.arange(self.size)))


def joined(ranks: Ranks | None, values: Sequence[T]) -> Sequence[T]:
    """The entries of all processes; of a single one its own."""
    return values if ranks is None else ranks.joined(values)


def described(ranks: Ranks, subdomains: Sequence[Subdomain]) -> list[Any]:
    """All subdomains, of other processes as `Described`."""
    sent = [
        Described(s.name, s.n, s.substeps, s.scheme, s.double_step, s.dof_names) for s in subdomains
    ]
    descriptions = ranks.share(sent)
    ranks.first = np.cumsum([0] + [len(x) for x in descriptions]).astype(np.int64)
    if ranks.first[-1] == 0:
        raise ValueError("subdomains must not be empty on all ranks")
    everything: list[Any] = [s for x in descriptions for s in x]
    everything[ranks.part] = subdomains
    return everything


def require_equal_problems(ranks: Ranks, rows: Sequence[Any], options: dict[str, Any]) -> None:
    """ValueError unless constraints and options are the same on all ranks."""
    *names, last = options
    ranks.require_equal(f"{', '.join(names)} and {last}", options)
    members = [
        (i, L.indptr, L.indices, L.data) for row in rows for i, L in sorted(row.matrices.items())
    ]
    # the values of callables are compared in the run
    velocities = [None if row.velocity is None else as_load(row.velocity)._facts() for row in rows]
    sizes = [row.p for row in rows]
    ranks.require_equal("constraints", hashlib.sha256(pickle.dumps((sizes, members))).digest())
    ranks.require_equal("velocity of the constraints", velocities)


def file_of(path: Any, rank: int) -> str:
    """The file of a rank beside that of the others."""
    return f"{checked_path(path)}.{rank}"


def _library() -> Any:
    return library("mpi4py.MPI", "comm", "'pmalpha[mpi]'")


def _sendable(error: BaseException) -> tuple[bytes | None, str]:
    """A pmalpha exception itself if it can be pickled, and the text of any."""
    text = f"{type(error).__name__}: {error}".removesuffix(": ")
    if isinstance(error, PmalphaError):
        try:
            return pickle.dumps(error), text
        except Exception:
            pass
    return b"", text


def _received(rank: int, sent: tuple[bytes, str]) -> PmalphaError:
    """The exception of another process, as it is raised here."""
    pickled, text = sent
    error = pickle.loads(pickled) if pickled else PmalphaError(f"rank {rank}: {text}")
    if pickled:
        error.args = (f"rank {rank}: {error}",)
    return error


def check_stable(
    failure: Failure | None,
    members: Sequence[Member],
    ranks: Ranks | None = None,
    step: int = 0,
    t: float = 0.0,
) -> None:
    """InstabilityError for a value that the core has found not to be finite, or `Elsewhere`."""
    if failure is None:
        return
    if failure["kind"] != "unstable":
        raise Elsewhere(failure)
    names = joined(ranks, [member.name for member in members])
    raise InstabilityError(step, t, [*names, "interface"][failure["subdomain"]])


def _remote(parts: Mapping[str, Any]) -> forms.Remote:
    """What other processes have to know of a subdomain whose object of the core has these parts."""
    link = parts["link"]
    return forms.Remote(
        parts["nb"],
        parts["substeps"],
        parts["single"].step.h,
        "twice" in parts,
        parts.get("continues", False),
        "M" in parts,
        link,
        np.unique(link.indices).astype(np.int64) if "iterate" in parts else None,
    )


def _numbers(remote: forms.Remote) -> int:
    """Of a subdomain, at most, in an exchange of the core."""
    block = 0 if remote.rows is None else remote.rows.size**2
    return max(PIECES * remote.nb + MEASURES, block)


def processes(
    ranks: Ranks | None, subdomains: Sequence[Mapping[str, Any]]
) -> forms.Processes | None:
    """The argument of that name of the core's coupler, from the parts of each own subdomain."""
    if ranks is None:
        return None
    remotes: list[Any] = list(ranks.joined(list(map(_remote, subdomains))))
    size = ranks.size + sum(map(_numbers, remotes))
    remotes[ranks.part] = [None] * len(subdomains)
    return forms.Processes(ranks.rank, tuple(remotes), ranks.first, *ranks.gather(size))
