"""What `serve` can serve as an element: forces of trial states, matrices, and commits of a step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy import LowLevelCallable

from .. import _core
from .._checks import real_array, vector, whole_number
from ..problem.argument_order import OF_RESTORING, check_order
from ..problem.device import divided
from ..problem.evaluation import evaluated
from ..problem.internal import InternalForce
from ..problem.matrices import dense
from ..problem.restoring import functions_of
from ..problem.springs import Spring, assembled, core_springs
from ..problem.subdomain import Subdomain
from ..run.coupler import Coupler


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
