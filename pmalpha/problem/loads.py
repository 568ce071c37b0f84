"""Loads: what ``force`` of a subdomain can be, and the one interface behind it.

A load is evaluated at the end of a step only, as its value there or as a mean (docs/method.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from numbers import Number
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from scipy import LowLevelCallable

from .._cached import Frozen
from .._checks import counted, vector
from . import forms
from .arguments import OF_FORCE, check_order, check_signature, required_names
from .matrices import Matrix, checksum, product

# ---- one load ------------------------------------------------------------------------------------

# Who evaluates a load: the core and formulas; the run, ahead of the core; the core with restoring
# forces; a compiled function that the core calls.
Kind: TypeAlias = Literal["known", "of t", "of t, u and v", "compiled"]


class Samples(NamedTuple):
    """The series of a load that is linear between samples."""

    values: np.ndarray  # (m, k)
    dt: float
    hold: bool  # the last sample, later
    weights: np.ndarray  # (k,), how much each series counts


class Load(Frozen):
    """One of the loads that act on a subdomain together.

    A type of load is a class with the number of its dofs `n`, its value F(t), `_core`, and what of
    the rest it can do; what it cannot do is refused by its name.
    """

    n: Any
    function: Any  # of the user, unless the kind is "known"
    average: bool = False  # its steps take means of it (`run/loads.py`)
    direction: np.ndarray | None = None  # of a ground motion
    _kind: Kind = "known"
    _is_ground = False
    _in_lanes = True  # several cases can have it side by side
    _prescribes = False  # can be a velocity of constraints or the motion of a contact
    _samples: Samples | None = None  # of which steps can skip some

    def __call__(self, t: float) -> np.ndarray:
        """F(t), shape (n,), for t >= 0, evaluated like in the core."""
        raise NotImplementedError

    @property
    def _term(self) -> Term:
        """What the user gave."""
        return self

    @property
    def _label(self) -> str:
        """What it is in messages: "a ..."."""
        return type(self).__name__

    def _of(self, mass: Mass, n: int, name: str) -> Load:
        """The load of a subdomain with this mass and number of dofs."""
        return self

    def _with_mass(self, M: Matrix | None) -> Load:
        """The load of the same subdomain with another mass matrix."""
        return self

    def _core(self, order: np.ndarray, scale: np.ndarray | None = None) -> forms.Load:
        """In a form of the core, in elimination order, where `_kind` lets the core evaluate it.

        scale: by which its entries are divided; None is 1.
        """
        raise NotImplementedError

    def _at_times(self, t: np.ndarray, n: int) -> np.ndarray:
        """At (m,) times, (m, n)."""
        return np.array([vector(self(float(x)), n, f"a force at t = {x:g}") for x in t])

    def _part(self, dofs: np.ndarray, share: np.ndarray | float = 1.0) -> Any:
        """What `force` is for a subdomain with some of the dofs, each entry times its share."""
        raise TypeError(
            f"force must not be a {self._label}, which cannot be divided; give each subdomain its "
            "own by pm.Subdomain"
        )

    def _projected(self, T: np.ndarray) -> Any:
        """The force T^T F(t) on other coordinates, with the displacements T u; T is (n, r)."""
        raise ValueError(f"force must not be a {self._label} for a reduction")

    def _facts(self) -> str:
        """A description for checkpoints and other processes; equal loads have equal ones."""
        raise NotImplementedError

    def _largest(self) -> np.ndarray:
        """The largest |F| at any time, (n,); of a load that prescribes."""
        raise NotImplementedError

    def _slope(self) -> np.ndarray:
        """F'(0); of a load that prescribes."""
        raise NotImplementedError


class Constant(Load):
    """The same values (n,) at all times."""

    _prescribes = True

    def __init__(self, values: np.ndarray):
        self.values, self.n = values, values.size

    @property
    def _term(self) -> Term:
        return self.values

    def __call__(self, t: float) -> np.ndarray:
        return self.values

    def _core(self, order: np.ndarray, scale: np.ndarray | None = None) -> forms.Load:
        values: np.ndarray = self.values[order]
        return values if scale is None else values / scale

    def _at_times(self, t: np.ndarray, n: int) -> np.ndarray:
        return np.broadcast_to(self.values, (len(t), n))

    def _part(self, dofs: np.ndarray, share: np.ndarray | float = 1.0) -> np.ndarray:
        part: np.ndarray = share * self.values[dofs]
        return part

    def _projected(self, T: np.ndarray) -> np.ndarray:
        projected: np.ndarray = T.T @ self.values
        return projected

    def _facts(self) -> str:
        return checksum(self.values)

    def _largest(self) -> np.ndarray:
        largest: np.ndarray = np.abs(self.values)
        return largest

    def _slope(self) -> np.ndarray:
        return np.zeros(self.n)


class OfUser(Load):
    """A function of the user, which is the term as it is."""

    def __init__(self, function: Any):
        self.function = function

    @property
    def _term(self) -> Term:
        return self.function

    def _facts(self) -> str:
        return "a callable"


class OfTime(OfUser):
    """A Python function of t."""

    _kind: Kind = "of t"
    _prescribes = True

    def __call__(self, t: float) -> Any:
        return self.function(t)

    def _part(self, dofs: np.ndarray, share: np.ndarray | float = 1.0) -> DividedForce:
        return DividedForce(self.function, dofs, share)

    def _projected(self, T: np.ndarray) -> ProjectedForce:
        return ProjectedForce(self.function, T)


class OfMotion(OfUser):
    """A Python function of t, u and v, which is evaluated like a restoring force."""

    _kind: Kind = "of t, u and v"
    _label = "function of t, u and v"


class Compiled(OfUser):
    """A `scipy.LowLevelCallable`."""

    _kind: Kind = "compiled"
    _label = "compiled function"

    def _core(self, order: np.ndarray, scale: np.ndarray | None = None) -> forms.Load:
        return forms.Called(self.function, order)

    def _facts(self) -> str:
        return "a compiled function"


class DividedForce:
    """The part of a callable load on the dofs of one subdomain.

    The load is evaluated for each subdomain separately, at the ends of its own substeps.
    """

    def __init__(self, force: Any, dofs: np.ndarray, share: np.ndarray | float):
        self._force, self._dofs, self._share = force, dofs, share

    def __call__(self, t: float) -> np.ndarray:
        values = np.asarray(self._force(t))
        if values.ndim != 1 or values.size <= self._dofs[-1]:
            raise ValueError(
                f"force must return a value for each dof of the uncut structure, got {values.shape}"
            )
        result: np.ndarray = self._share * values[self._dofs]
        return result


class ProjectedForce:
    """T^T F(t) of a function F."""

    def __init__(self, force: Callable[[float], Any], T: np.ndarray):
        self.force, self.T = force, T

    def __call__(self, t: float) -> np.ndarray:
        result: np.ndarray = self.T.T @ vector(self.force(t), len(self.T), "the value of force")
        return result


def as_load(term: Term) -> Load:
    """A user's load, checked, by its interface."""
    if isinstance(term, Load):
        return term
    if isinstance(term, LowLevelCallable):
        return Compiled(term)
    if isinstance(term, np.ndarray):
        return Constant(term)
    return OfMotion(term) if required_arguments(term) == 3 else OfTime(term)


def is_function(value: Any) -> bool:
    """Whether it is a Python function of the user, and no load."""
    return callable(value) and not isinstance(value, Load)


# ---- loads together ------------------------------------------------------------------------------

Term: TypeAlias = np.ndarray | Load | Callable[..., Any] | LowLevelCallable
# Several loads act together, as a tuple.
Force: TypeAlias = Term | tuple[Term, ...] | None


def has_ground(force: Any) -> bool:
    """Whether a user's force has a ground motion."""
    if isinstance(force, (list, tuple)) and not isinstance(force, LowLevelCallable):
        return any(map(has_ground, force))
    return isinstance(force, Load) and force._is_ground


def is_list_of_loads(force: Any) -> bool:
    """Whether something in it is a load; a list with a number is the force on each dof."""
    if not isinstance(force, (list, tuple)) or isinstance(force, LowLevelCallable):
        return False
    return not any(isinstance(x, Number) for x in force) and any(
        x is None
        or callable(x)
        or isinstance(x, LowLevelCallable)
        or isinstance(x, np.ndarray)
        and x.ndim > 0
        or is_list_of_loads(x)
        for x in force
    )


def _together(terms: Sequence[Term]) -> Force:
    """Loads that act together, in their order; constant ones are added."""
    constant = [x for x in terms if isinstance(x, np.ndarray)]
    loads = [x for x in terms if not isinstance(x, np.ndarray)]
    result = [sum(constant[1:], constant[0]), *loads] if constant else loads
    if len(result) < 2:
        return result[0] if result else None
    return tuple(result)


def terms_of(force: Force) -> tuple[Term, ...]:
    """The loads that act together."""
    if force is None:
        return ()
    if isinstance(force, tuple) and not isinstance(force, LowLevelCallable):
        return force
    return (force,)


def each_load(force: Force, change: Callable[[Load], Any]) -> Force:
    """The sum of changed loads."""
    terms = [change(x) for x in loads_of(force)]
    return _together([x._term if isinstance(x, Load) else x for x in terms])


def required_arguments(function: Callable[..., Any]) -> int:
    """Number of positional arguments that a function requires; 1 where its signature is not
    readable, as of a compiled one."""
    names = required_names(function)
    return 1 if names is None else len(names)


def loads_of(force: Force) -> tuple[Load, ...]:
    """The loads that act together, each by its interface."""
    return tuple(map(as_load, terms_of(force)))


def functions_of(force: Force, kind: Kind) -> list[Callable[..., Any]]:
    """The user's functions of one kind among the loads that act together."""
    return [x.function for x in loads_of(force) if x._kind == kind]


def depends_on_motion(force: Force) -> bool:
    """Whether some of it is a force f(t, u, v)."""
    return any(x._kind == "of t, u and v" for x in loads_of(force))


def core_load(
    force: Force, order: np.ndarray, tables: Sequence[forms.Table] = ()
) -> forms.Load | tuple[forms.Load, ...]:
    """A force in a form of the core, in elimination order, without Python callables.

    tables: values of callables of t.
    """
    terms = [x._core(order) for x in loads_of(force) if x._kind in ("known", "compiled")]
    terms += tables
    return tuple(terms) if len(terms) > 1 else terms[0] if terms else None


def summed(functions: Sequence[Callable[..., Any]], n: int, what: str) -> Callable[..., Any] | None:
    """The sum of functions of the same arguments, t first, each (n,); None without.

    what: its name in messages, such as "force of subdomain 'rig'".
    """
    if len(functions) < 2:
        return functions[0] if functions else None

    def total(t: float, *motion: np.ndarray) -> np.ndarray:
        values = [f(t, *(x.copy() for x in motion)) for f in functions]
        try:
            return sum((vector(x, n, "the value of each function") for x in values), np.zeros(n))
        except (TypeError, ValueError) as error:
            raise type(error)(f"{what} at t = {t:g}: {error}") from None

    return total


# ---- checks --------------------------------------------------------------------------------------


def checked_force(force: Any, n: int, name: str = "force", mass: Mass | None = None) -> Force:
    """A user's force, checked against the number of dofs as far as possible without calling it.

    mass: that of the dofs, of which ground motions are; None where there are none.
    """
    if isinstance(force, (list, tuple)) and not isinstance(force, LowLevelCallable):
        if not force:
            one = "a velocity" if name == "velocity" else "a load, or a list of loads"
            raise ValueError(f"{name} must be {one}, got an empty list; None is none")
        if any(x is None for x in force):
            i = next(i for i, x in enumerate(force) if x is None)
            raise TypeError(f"{name}[{i}] must be a load or a number, got None")
    if name != "velocity" and is_list_of_loads(force):
        terms = [checked_force(x, n, f"{name}[{i}]", mass) for i, x in enumerate(force)]
        return _together([x for term in terms for x in terms_of(term)])
    if force is None:
        return None
    if isinstance(force, Load):
        if mass is not None and force.n in (0, n):
            force = force._of(mass, n, name)
        if force.n != n:
            kind = type(force).__name__
            what = counted(n, "row" if name == "velocity" else "dof")
            raise ValueError(f"{name} must act on {what}, got a {kind} on {force.n}")
        return force
    if isinstance(force, LowLevelCallable) and name != "velocity":
        check_signature(force, "force")
        return force
    if isinstance(force, LowLevelCallable):
        raise TypeError(f"{name} must not be a LowLevelCallable")
    if callable(force):
        count = required_arguments(force)
        if count == 1 or count == 3 and name != "velocity":
            check_order(force, OF_FORCE, name)
            return force
        rule = "t alone" if name == "velocity" else "t alone, or of t, u and v"
        raise TypeError(
            f"{name} must be a function of {rule}, got one with {count} required arguments: "
            f"{force!r}"
        )
    return vector(force, n, name)


class Mass:
    """A mass matrix in inner form, None is zero, and its forces against unit ground motions.

    names: those of its dofs, or None.
    """

    def __init__(self, M: Matrix | None, names: Sequence[str] | None = None):
        self.M, self.names = M, names
        self._forces: dict[tuple[Any, ...], np.ndarray] = {}

    def against(self, direction: np.ndarray) -> np.ndarray:
        """-M direction, finite; that of equal directions is one array."""
        key = direction.shape, direction.tobytes()
        if key not in self._forces:
            self._forces[key] = against(self.M, direction)
        return self._forces[key]


def against(M: Matrix | None, direction: np.ndarray) -> np.ndarray:
    """-M direction, finite."""
    with np.errstate(over="ignore"):  # refused next
        shape = -product(M, direction)
    if not np.all(np.isfinite(shape)):
        raise ValueError("M times direction must be finite")
    return shape


# ---- with supports -------------------------------------------------------------------------------


def load_of_free(
    force: Any, reduced: Any, M: Matrix | None, names: Sequence[str] | None = None
) -> Any:
    """A load of all dofs, of a structure with mass M, as that of the free ones, of a `Reduction`;
    other loads as they are. `names` are those of all dofs."""
    if is_list_of_loads(force):
        return [load_of_free(x, reduced, M, names) for x in force]
    if isinstance(force, Load):
        if force.n not in (0, reduced.n):
            return force
        return force._of(Mass(M, names), reduced.n, "force")._part(reduced.free)
    if callable(force):
        return _function_of_free(force, reduced)
    if isinstance(force, LowLevelCallable) or np.shape(force) != (reduced.n,):
        return force
    return reduced.reduce_load(force)


def _function_of_free(force: Callable[..., Any], reduced: Any) -> Callable[..., Any]:
    """A function whose value is of all dofs or of the free ones, and which sees all of them."""
    if not reduced.fixed.size:
        return force
    check_order(force, OF_FORCE, "force")
    kind = {1: LoadOfFree, 3: MotionLoadOfFree}.get(required_arguments(force))
    return force if kind is None else kind(force, reduced)


class LoadOfFree:
    """A load f(t) of a structure with supports, as that of its free dofs."""

    def __init__(self, function: Callable[..., Any], reduced: Any):
        self.function, self.reduced = function, reduced

    def __repr__(self) -> str:
        return repr(self.function)

    def __call__(self, t: float) -> Any:
        return self._of_free(self.function(t))

    def _of_free(self, value: Any) -> Any:
        reduced = self.reduced
        return reduced.reduce_load(value) if np.shape(value) == (reduced.n,) else value


class MotionLoadOfFree(LoadOfFree):
    """A load f(t, u, v) of a structure with supports, with u and v of all dofs."""

    def __call__(self, t: float, u: np.ndarray, v: np.ndarray) -> Any:  # type: ignore[override]
        return self._of_free(self.function(t, self.reduced.expand(u), self.reduced.expand(v)))
