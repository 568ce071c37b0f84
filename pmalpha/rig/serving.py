"""What `serve` can serve as an element: forces of trial states, matrices, and commits of a step."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy import LowLevelCallable

import pmalpha._core as _core

from .._checks import real_array, vector, whole_number
from ..problem.arguments import OF_RESTORING, check_order
from ..problem.device import divided
from ..problem.internal import InternalForce
from ..problem.matrices import dense
from ..problem.restoring import functions_of
from ..problem.springs import Spring, assembled, core_springs
from ..problem.subdomain import Subdomain
from ..problem.tangents import evaluated
from ..run.coupler import Coupler
from . import wire as w
from .wire import HEAD_BYTES, LOOPBACK, admitted, checked_networks


class Trial(NamedTuple):
    """A trial state of n dofs; time and acceleration are None where the client sends none."""

    t: float | None
    u: np.ndarray
    v: np.ndarray
    a: np.ndarray | None = None


class Element(Protocol):
    """An element of a program that integrates the motion."""

    def force(self, trial: Trial) -> tuple[np.ndarray, np.ndarray]:
        """Resisting force without inertia and damping, and the displacement measured."""

    def commit(self, trial: Trial) -> None:
        """The trial state is accepted."""

    def end(self) -> None:
        """No more comes, whatever the reason: trial states that were not accepted are undone."""

    def stiffness(self, trial: Trial, *, initial: bool) -> np.ndarray: ...

    def damping(self) -> np.ndarray: ...

    def mass(self) -> np.ndarray: ...


class Command:
    """A prescribed velocity that another program commands, by `serve`.

    Given as ``velocity`` of a `Constraint` on the interface of a coupler. In a macro step the
    velocity is a parabola from velocity and acceleration at the begin to the velocity at the end:
    by straight lines substeps of the trapezoidal rule would keep their first acceleration.

    Parameters
    ----------
    p : int
        The number of constraints.

    Examples
    --------
    >>> mass = Subdomain([1.0], [4.0], scheme=Newmark(), name="m")
    >>> wall = Constraint({mass: [[1.0]]}, velocity=rig.Command(1))
    >>> coupler = Coupler([mass], wall, dt=0.01)     # rig.serve(coupler)
    """

    repeatable = False  # as `Coupler.estimate_error` has to know

    def __init__(self, p: int):
        self.p = whole_number(p, "p", low=1)
        self.begin, self.slope, self.end = np.zeros((3, self.p))
        self.t0, self.t1 = 0.0, 1.0

    def __call__(self, t: float) -> np.ndarray:
        step = self.t1 - self.t0
        share = (t - self.t0) / step
        bend = self.end - self.begin - step * self.slope
        result: np.ndarray = self.begin + share * (step * self.slope + share * bend)
        return result

    def __repr__(self) -> str:
        return f"Command({self.p})"


# ---- functions and springs -----------------------------------------------------------------------


class FunctionElement:
    """A specimen r(t, u, v), which is evaluated once for each trial state."""

    def __init__(self, function: Callable[..., Any], n: int, matrices: dict[str, np.ndarray]):
        self.function, self.n, self.matrices = function, n, matrices
        self.last: tuple[Trial, tuple[np.ndarray, np.ndarray]] | None = None

    def force(self, trial: Trial) -> tuple[np.ndarray, np.ndarray]:
        if self.last is None or not _same(self.last[0], trial):
            t = 0.0 if trial.t is None else trial.t
            r, x = divided(self.function(t, trial.u.copy(), trial.v.copy()), self.n)
            measured = trial.u if x is None else vector(x, self.n, "measured displacement x")
            self.last = trial, (vector(r, self.n, "the value of the function"), measured)
        return self.last[1]

    def commit(self, trial: Trial) -> None:
        self.force(trial)  # the function has seen the state that is accepted
        commit = getattr(self.function, "commit", None)
        if commit is not None:
            commit()

    def end(self) -> None:
        pass

    def stiffness(self, trial: Trial, *, initial: bool) -> np.ndarray:
        return _matrix(self.matrices, "stiffness", self.n)

    def damping(self) -> np.ndarray:
        return _matrix(self.matrices, "damping", self.n)

    def mass(self) -> np.ndarray:
        return _matrix(self.matrices, "mass", self.n)


def _matrix(matrices: dict[str, np.ndarray], name: str, n: int) -> np.ndarray:
    """The matrix of this name, zero where there is none."""
    return matrices[name] if name in matrices else np.zeros((n, n))


def _same(a: Trial, b: Trial) -> bool:
    return a.t == b.t and np.array_equal(a.u, b.u) and np.array_equal(a.v, b.v)


class Springs:
    """Springs with what they remember of the last commit."""

    def __init__(self, springs: tuple[Spring, ...], n: int):
        self.springs, self.n = springs, n
        self.core = core_springs(springs, np.arange(n))
        self.levels: np.ndarray | None = None

    def follow(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What they remember at u, their tangents and their force."""
        if not self.springs:
            return np.zeros((0, 0)), np.zeros(0), np.zeros(self.n)
        levels, slopes, f = _core.follow_springs(self.core, np.ascontiguousarray(u), self.levels)
        return levels, slopes, f

    def commit(self, u: np.ndarray) -> None:
        if self.springs:
            self.levels = self.follow(u)[0]

    def tangent(self, u: np.ndarray, *, initial: bool) -> np.ndarray:
        ends = np.cumsum([len(spring) for spring in self.springs])
        slopes = np.split(self.follow(u)[1], ends[:-1]) if self.springs else []
        if initial:
            slopes = [spring.initial_tangent for spring in self.springs]
        total: np.ndarray = assembled(self.springs, slopes, self.n).toarray()
        return total


# ---- subdomains ----------------------------------------------------------------------------------


class StructureElement:
    """All dofs of a subdomain, or springs: K u, restoring and internal forces, C and M."""

    def __init__(
        self,
        n: int,
        springs: tuple[Spring, ...],
        matrices: dict[str, Any],
        internal: tuple[InternalForce, ...] = (),
        functions: tuple[Any, ...] = (),
    ):
        self.n, self.springs, self.internal = n, Springs(springs, n), internal
        # absent ones take no memory: n is what a client announces
        self.matrices = {name: dense(A) for name, A in matrices.items() if A is not None}
        self.functions, self.q = functions, [force.history.copy() for force in internal]

    def force(self, trial: Trial) -> tuple[np.ndarray, np.ndarray]:
        t = 0.0 if trial.t is None else trial.t
        r = self.springs.follow(trial.u)[2]
        if "stiffness" in self.matrices:
            r = r + self.matrices["stiffness"] @ trial.u
        for function in self.functions:
            value, _ = divided(function(t, trial.u.copy(), trial.v.copy()), self.n)
            r = r + vector(value, self.n, "the value of restoring")
        for f, _, _, _ in self._internal(trial):
            r = r + f
        return r, trial.u

    def _internal(self, trial: Trial) -> list[Any]:
        t = 0.0 if trial.t is None else trial.t
        pairs = zip(self.internal, self.q)
        return [evaluated(f, "internal", t, trial.u, trial.v, q) for f, q in pairs]

    def commit(self, trial: Trial) -> None:
        q = [q1 for _, _, _, q1 in self._internal(trial)]
        self.springs.commit(trial.u)
        self.q = q

    def end(self) -> None:
        pass

    def stiffness(self, trial: Trial, *, initial: bool) -> np.ndarray:
        K: np.ndarray = self.springs.tangent(trial.u, initial=initial)
        for name in ("stiffness", "estimate"):
            if name in self.matrices:
                K = K + self.matrices[name]
        for _, K_t, _, _ in self._internal(trial):
            if K_t is not None:
                K = K + dense(K_t)
        return K

    def damping(self) -> np.ndarray:
        return _matrix(self.matrices, "damping", self.n)

    def mass(self) -> np.ndarray:
        return _matrix(self.matrices, "mass", self.n)


def of_subdomain(s: Subdomain) -> StructureElement:
    if s.force is not None:
        raise ValueError(
            f"subdomain {s.name!r} must be without force to be served, got {s.force!r}: loads are "
            "those of the program that integrates"
        )
    functions = functions_of(s.restoring)
    if not all(callable(x) and not isinstance(x, LowLevelCallable) for x in functions):
        raise TypeError(
            f"restoring of subdomain {s.name!r} must be springs and Python callables to be served, "
            "got compiled functions or actuators, which are evaluated once in a step"
        )
    internal = () if s.internal is None else s.internal.forces
    estimate = s.restoring_stiffness if functions else None
    matrices = dict(stiffness=s.K, damping=s.C, mass=s.M, estimate=estimate)
    return StructureElement(s.n, s.springs, matrices, internal, functions)


# ---- couplers ------------------------------------------------------------------------------------


class CouplerElement:
    """The interface of a coupler that a `Command` moves: one macro step for each of the client.

    The force of a trial is the multiplier of the macro step that ends with its velocity. Where the
    client adds C v, that share is the damping C = dLam/dv and the force the rest.
    """

    def __init__(self, coupler: Coupler, *, splits: bool):
        motions = [(motion.velocity, motion.rows) for motion in coupler._session.loads.motions]
        commands = [(velocity, rows) for velocity, rows in motions if isinstance(velocity, Command)]
        if len(commands) != 1:
            raise ValueError(
                "a coupler to be served must have one constraint with velocity=rig.Command(p), got "
                f"{len(commands)}"
            )
        self.coupler, self.splits = coupler, splits
        self.command, self.rows = commands[0]
        self.n = self.command.p
        self.last: tuple[Trial, np.ndarray] | None = None
        self._begin_step(np.zeros(self.n), np.zeros(self.n))
        self.slopes: dict[int, np.ndarray] = {}

    def _begin_step(self, v: np.ndarray, a: np.ndarray) -> None:
        """The macro step after the present begins with this velocity and acceleration."""
        command, coupler = self.command, self.coupler
        command.t0, command.t1 = coupler.time, coupler.time + coupler.dt
        command.begin[:] = command.end[:] = v
        command.slope[:] = a
        self.present, self.last = coupler.snapshot(), None

    def force(self, trial: Trial) -> tuple[np.ndarray, np.ndarray]:
        if self._is_present(trial):
            lam = self._back()
        else:
            lam = self._step(trial)
        return lam - self.damping() @ trial.v if self.splits else lam, trial.u

    def _is_present(self, trial: Trial) -> bool:
        return trial.t is not None and abs(trial.t - self.command.t0) < 1e-6 * self.coupler.dt

    def _back(self) -> np.ndarray:
        """The coupler at the last commit, and the multipliers there."""
        self.coupler.restore(self.present)
        self.last = None
        result: np.ndarray = self.coupler.multipliers[self.rows]
        return result

    def _step(self, trial: Trial) -> np.ndarray:
        if self.last is not None and _same(self.last[0], trial):
            return self.last[1]
        t0, t1, dt = self.command.t0, self.command.t1, self.coupler.dt
        if trial.t is not None and abs(trial.t - t1) > 1e-6 * dt:
            raise ValueError(
                f"steps of the client must be those of the coupler, dt = {dt:g}, got one from "
                f"{t0:g} to {trial.t:g}"
            )
        self._back()
        self.command.end[:] = trial.v
        self.coupler.step()
        lam: np.ndarray = self.coupler.multipliers[self.rows]
        self.last = trial, lam
        return lam

    def commit(self, trial: Trial) -> None:
        if not self._is_present(trial):
            self._step(trial)
            # as the trapezoidal rule has it, where the client does not say
            mean = (trial.v - self.command.begin) / self.coupler.dt
            a = 2.0 * mean - self.command.slope if trial.a is None else trial.a
            self._begin_step(trial.v, a)

    def end(self) -> None:
        self._back()

    def stiffness(self, trial: Trial, *, initial: bool) -> np.ndarray:
        return np.zeros((self.n, self.n))

    def damping(self) -> np.ndarray:
        """dLam/dv of the next macro step: of the first, the second and all later ones."""
        step = min(round(self.command.t0 / self.coupler.dt), 2)
        if step not in self.slopes:
            zero = Trial(None, np.zeros(self.n), np.zeros(self.n))
            rest = self._step(zero).copy()
            columns = [self._step(zero._replace(v=e)) - rest for e in np.eye(self.n)]
            self._back()
            self.slopes[step] = np.array(columns).T
        return self.slopes[step]

    def mass(self) -> np.ndarray:
        return np.zeros((self.n, self.n))


# ---- which one -----------------------------------------------------------------------------------


def element_of(what: Any, n: int, matrices: dict[str, Any], *, splits: bool) -> Element:
    """The element of n dofs that `what` is; ValueError where it has another number."""
    arrays = {name: A for name, A in matrices.items() if A is not None}
    if isinstance(what, (Subdomain, Coupler)) and arrays:
        raise ValueError(f"{next(iter(arrays))} must not be given with a {type(what).__name__}")
    if isinstance(what, Subdomain):
        return _of_size(of_subdomain(what), n, f"subdomain {what.name!r}")
    if isinstance(what, Coupler):
        return _of_size(CouplerElement(what, splits=splits), n, "the interface of the coupler")
    checked = {name: _square(A, n, name) for name, A in arrays.items()}
    if not callable(what):
        springs = tuple(spring._placed(n, None, "what") for spring in springs_in(what))
        return StructureElement(n, springs, checked)
    return FunctionElement(what, n, checked)


def springs_in(what: Any) -> tuple[Spring, ...]:
    springs = what if isinstance(what, (list, tuple)) else (what,)
    return tuple(x for x in springs if isinstance(x, Spring))


def check_served(what: Any) -> None:
    springs = what.springs if isinstance(what, Subdomain) else springs_in(what)
    for spring in springs:
        if spring.largest_damping is not None:
            raise ValueError(f"springs to be served must have no damper, got c of {spring!r}")
    several = len(what) if isinstance(what, (list, tuple)) else 1
    if isinstance(what, (Subdomain, Coupler)) or springs and len(springs) == several:
        return
    if not callable(what) or isinstance(what, LowLevelCallable):
        raise TypeError(
            "what must be a Subdomain, a Coupler, springs, or a function r(t, u, v), got "
            f"{what!r}; actuators and compiled functions are evaluated once in a step"
        )
    check_order(what, OF_RESTORING, "what")


def _square(A: Any, n: int, name: str) -> np.ndarray:
    array = real_array(A, name, (0, 1, 2))
    if array.ndim < 2:
        array = np.diag(array.reshape(-1))
    if array.shape != (n, n):
        raise ValueError(f"{name} must have shape ({n}, {n}), got {array.shape}")
    return array


def _of_size(element: Any, n: int, what: str) -> Element:
    if element.n != n:
        raise ValueError(f"{what} has {element.n} dofs, but the client announces {n}")
    result: Element = element
    return result


# ---- serving ------------------------------------------------------------------------------------
# An element for a program that integrates: OpenSees' genericClient, or another pmalpha.


def serve(
    what: Any,
    port: int = 0,
    *,
    host: str = "127.0.0.1",
    allow: Collection[str] | None = None,
    secret: bytes | str | None = None,
    stiffness: Any = None,
    damping: Any = None,
    mass: Any = None,
    timeout: float | None = 60.0,
    announce: Callable[[int], Any] | None = None,
) -> int:
    """Serve one client that has this as an element, until it ends.

    The client is OpenSees' ``element genericClient``, OpenFresco's generic control, or `connect`.
    It sends trial displacements, velocities and times, and is given the resisting force without
    inertia and damping, and the matrices it asks for.

    Parameters
    ----------
    what : callable, springs, Subdomain or Coupler
        A specimen ``r(t, u, v)``, evaluated once for each trial state that a force is wanted of,
        and for the one that is accepted; it may return (r, x), and have a method ``commit()``,
        called at the end of each step. Springs go on from their last committed state. A Subdomain
        without load has all its dofs on the interface; it gives M, C and its tangent too. A Coupler
        has one constraint with ``velocity=rig.Command(p)``, its interface: it takes a macro step
        for each step of the client, which must have the same length, from the velocity committed
        last to the trial velocity, and gives the multipliers.
    port : int, default 0
        On which to listen; 0 for any that is free.
    host : str, default "127.0.0.1"
        The address on which to listen; the default is reached from this machine only. Any other
        needs `allow` or `secret`.
    allow : collection of str, optional
        Numerical addresses and networks of clients, ``["10.0.0.12", "10.1.0.0/24"]``; others are
        turned away.
    secret : bytes or str, optional
        That a `connect` with the same one proves to know before anything else; other programs have
        no way to. Neither it nor the data are encrypted, and who pretends to be the server can try
        words on the proof at leisure: take 16 random bytes.
    stiffness, damping, mass : (n, n) or (n,) array, optional
        Of a function (of springs the latter two), for clients that ask. Default: zero.
    timeout : float, optional
        Longest wait for a connection, for what that has to send to be the client (with the secret
        its proof, else its first message), and for each later message, in seconds; None for ever.
        A connection that closes, is silent or sends anything else is turned away, and the wait goes
        on; up to 32 are waited for at once.
    announce : callable, optional
        Called with the port when it is open. Default: prints it.

    Returns
    -------
    int
        Number of steps that were committed.

    Raises
    ------
    TimeoutError
        When there is no client in time, or it was silent for too long.
    ConnectionError
        When the client has ended without saying so, or asks for what it does not know.
    ValueError, TypeError
        For arguments of the wrong kind, what cannot be served, or another number of dofs than the
        client has; whatever `what` raises. OpenSees is not told and has to be ended: it waits for
        ever.

    Examples
    --------
    >>> import threading, queue
    >>> ports = queue.Queue()
    >>> server = threading.Thread(target=rig.serve, args=(lambda t, u, v: 4.0 * u,),
    ...                           kwargs=dict(announce=ports.put))
    >>> server.start()
    >>> with rig.connect(("127.0.0.1", ports.get())) as spring:
    ...     mass = Subdomain([1.0], None, scheme=Newmark(), restoring=spring, u0=[1.0], name="m")
    ...     history = Coupler([mass], dt=0.01).run(0.5)
    >>> server.join()
    >>> bool(abs(history["m"].u[-1, 0] - np.cos(1.0)) < 1e-4)
    True
    """
    check_served(what)
    port = whole_number(port, "port", high=65535)
    networks, known = checked_networks(allow), checked_secret(secret)
    if host not in LOOPBACK and allow is None and known is None:
        raise ValueError(
            f"allow or secret must be given with host {host!r}, which other machines can reach"
        )
    connection, peer, announced = admitted(
        host, port, networks, known, timeout, announce or _print_port
    )
    link = w.Wire(connection, timeout, peer)
    try:
        sizes = announced or w.sizes_of(link.receive(HEAD_BYTES, "the first message"), peer)
        matrices = dict(stiffness=stiffness, damping=damping, mass=mass)
        # a program that sends accelerations integrates: it adds C v and M a itself
        splits = sizes.control[w.KINDS.index("acceleration")] > 0
        element = element_of(what, sizes.n, matrices, splits=splits)
        if isinstance(what, Coupler) and sizes.control[w.KINDS.index("velocity")] == 0:
            raise ValueError(
                "a coupler needs the velocities of its interface, the client sends none"
            )
        try:
            return _Session(w.Doubles(link, sizes), element).run()
        finally:
            element.end()
    finally:
        link.close()


def _print_port(port: int) -> None:
    print(port, flush=True)


def checked_secret(secret: bytes | str | None) -> bytes | None:
    if secret is None:
        return None
    if not isinstance(secret, (bytes, str)) or not secret:
        raise TypeError(f"secret must be text or bytes that are not empty, got {secret!r}")
    return secret.encode() if isinstance(secret, str) else secret


class _Session:
    """The messages of one client."""

    def __init__(self, doubles: w.Doubles, element: Element):
        self.doubles, self.element, self.sizes = doubles, element, doubles.sizes
        n = self.sizes.n
        self.trial = Trial(None, np.zeros(n), np.zeros(n))
        self.commits = 0
        self.fields: dict[str, np.ndarray] = {}

    def run(self) -> int:
        """Until the client ends; the number of commits."""
        while True:
            message = self.doubles.receive("the next action")
            action = message[0]
            if action == w.END:
                return self.commits
            if action == w.TRIAL:
                self._take(message)
            elif action == w.COMMIT:
                self.element.commit(self.trial)
                self.commits += 1
            elif action in w.VALUES:
                self.doubles.send(self._values())
            elif action in w.MATRICES:
                self.doubles.send(self._matrix(int(action)))
            elif action not in w.SILENT:
                raise ConnectionError(f"{self.doubles.wire.peer} asks for {action:g}, no action")

    def _take(self, message: np.ndarray) -> None:
        self.fields = w.fields(self.sizes.control, message[1:])
        for kind, values in self.fields.items():
            if not np.isfinite(values).all():
                raise ValueError(f"{kind} must be finite, got {values} from the client")
        u, v = (self.fields.get(x, np.zeros(self.sizes.n)) for x in ("displacement", "velocity"))
        t = float(self.fields["time"][0]) if "time" in self.fields else None
        self.trial = Trial(t, u, v, self.fields.get("acceleration"))

    def _values(self) -> np.ndarray:
        r, x = self.element.force(self.trial)
        zero, t = np.zeros(self.sizes.n), self.trial.t
        values = {
            "displacement": x,
            "velocity": self.trial.v,
            "acceleration": self.fields.get("acceleration", zero),
            "force": r,
            "time": np.array([0.0 if t is None else t]),
        }
        counts = zip(w.KINDS, self.sizes.daq)
        return np.concatenate([values[kind] for kind, count in counts if count])

    def _matrix(self, action: int) -> np.ndarray:
        """A matrix by columns."""
        n = self.sizes.n
        if n * n > self.sizes.doubles:
            raise ConnectionError(
                f"{self.doubles.wire.peer} asks for a matrix of {n} x {n} in messages of "
                f"{self.sizes.doubles} doubles"
            )
        if action == w.DAMPING:
            A = self.element.damping()
        elif action == w.MASS:
            A = self.element.mass()
        else:
            A = self.element.stiffness(self.trial, initial=action == w.INITIAL_STIFFNESS)
        return np.asarray(A).T.ravel()
