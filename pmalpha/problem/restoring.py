"""Restoring forces: the values that ``restoring`` of a subdomain can have, equation (R2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from scipy import LowLevelCallable

from .._checks import called, vector
from . import forms
from .arguments import OF_RESTORING, check_order, check_signature
from .device import Device, External, core_specimen, divided
from .springs import Spring, Wheels

Function: TypeAlias = (
    Callable[[float, np.ndarray, np.ndarray], Any] | LowLevelCallable | Device | Wheels
)
# A function, springs, or at least one of each or several functions, in the user's order.
Restoring = Function | tuple[Spring | Function, ...] | None


def labelled(argument: Any, name: str) -> list[tuple[Any, str]]:
    """The forces of an argument, one or a list of them, each with its name in messages.

    None and an empty list are no force: the sum of none.
    """
    # a LowLevelCallable is a tuple too
    if isinstance(argument, (list, tuple)) and not isinstance(argument, LowLevelCallable):
        return [(item, f"{name}[{i}]") for i, item in enumerate(argument)]
    return [] if argument is None else [(argument, name)]


def checked_restoring(restoring: Any, n: int, names: Sequence[str] | None = None) -> Restoring:
    """A user's restoring force, checked as far as possible without evaluating it."""
    forces: list[Spring | Function] = []
    for item, label in labelled(restoring, "restoring"):
        if isinstance(item, Wheels):  # of another subdomain
            item = item.spring
        if isinstance(item, Spring) and item.moves:
            forces.append(Wheels(item, n, names, label))
            continue
        if isinstance(item, (Spring, Device, External)):
            forces.append(item._placed(n, names, label))
            continue
        if isinstance(item, LowLevelCallable):
            check_signature(item, "restoring", label)
        elif not callable(item):
            rule = "callable or a list of springs" if item is restoring else "a spring or callable"
            raise TypeError(f"{label} must be {rule}, got {item!r}")
        else:
            check_order(item, OF_RESTORING, label)
        forces.append(item)
    if len(forces) == 1 and not isinstance(forces[0], Spring):
        return forces[0]
    return tuple(forces) or None


def items_of(restoring: Restoring) -> tuple[Spring | Function, ...]:
    """The springs and functions of a checked restoring force, in the user's order."""
    if restoring is None:
        return ()
    return restoring if type(restoring) is tuple else (restoring,)


def springs_of(restoring: Restoring) -> tuple[Spring, ...]:
    return tuple(item for item in items_of(restoring) if isinstance(item, Spring))


def functions_of(restoring: Restoring) -> tuple[Function, ...]:
    """The callables and LowLevelCallables, in the user's order."""
    return tuple(item for item in items_of(restoring) if not isinstance(item, Spring))


def wheels_of(restoring: Restoring) -> tuple[Wheels, ...]:
    """The springs with an end that moves."""
    return tuple(item for item in items_of(restoring) if isinstance(item, Wheels))


def devices_of(restoring: Restoring) -> tuple[Device, ...]:
    """The specimens behind actuators and compensators."""
    return tuple(item for item in items_of(restoring) if isinstance(item, Device))


def external_of(item: Any) -> External | None:
    """The specimen outside of this program that a restoring force is, or has behind devices."""
    inner = item.innermost if isinstance(item, Device) else item
    return inner if isinstance(inner, External) else None


class Feedback:
    """A force f(t, u, v) of a subdomain, which is evaluated with its restoring forces.

    what: its name in messages, such as "force of subdomain 'rig'".
    function: callable or None, the present one; None while the load is another one, by
        `Coupler.reset`.
    last: (n,) array, its last value, which the core reads for its work.
    """

    def __init__(self, what: str, n: int):
        self.what, self.last = what, np.zeros(n)
        self.function: Callable[..., Any] | None = None

    def __call__(self, t: float, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        if self.function is None:
            return np.zeros(self.last.size)
        value = called(self.what, self.function, t, u, v)
        return _checked(value, self.last.size, f"{self.what} at t = {t:g}")


def _checked(value: Any, n: int, where: str) -> np.ndarray:
    try:
        return vector(value, n, "its value")
    except (TypeError, ValueError) as error:
        raise type(error)(f"{where}: {error}") from None


class CheckedRestoring:
    """The sum of Python callables for the core, whose values are checked.

    functions: sequence of (callable, str), r(t, u, v) -> (n,), and its name in messages, such as
        "restoring of subdomain 'rig'". Each gets copies of u and v, and is evaluated once in a
        call, in this order.
    feedback: a load, evaluated after them; the sum contains it with a minus.
    """

    def __init__(
        self,
        functions: Sequence[tuple[Callable[..., Any], str]],
        n: int,
        feedback: Feedback | None = None,
    ):
        self.functions, self.n, self.feedback = functions, n, feedback
        self.last = np.zeros(n)  # what they returned last
        self.preset: np.ndarray | None = None  # what counts in their place, without a call
        # a function may change its arguments, the core's copies
        self.copies = len(functions) + (feedback is not None) > 1

    def __call__(self, t: float, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        if self.preset is not None:
            return self.preset
        values = []
        for function, what in self.functions:
            value = called(what, function, t, *self._motion(u, v))
            values.append(_checked(divided(value, self.n)[0], self.n, f"{what} at t = {t:g}"))
        r = sum(values[1:], values[0]) if values else np.zeros(self.n)
        self.last = r
        if self.feedback is None:
            return r
        f = self.feedback(t, *self._motion(u, v))
        self.feedback.last[:] = f
        result: np.ndarray = r - f
        return result

    def _motion(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (u.copy(), v.copy()) if self.copies else (u, v)


def is_compiled(function: Function) -> bool:
    return isinstance(function, LowLevelCallable)


def core_restoring(
    restoring: Restoring,
    name: str,
    order: np.ndarray,
    h: float,
    feedback: Feedback | None = None,
) -> forms.Restoring | None:
    """The functions of subdomain `name` in the form of the core, None without functions.

    The Python callables are one function of the core, which comes first, with a load that depends
    on the motion; each compiled function is another one, and each specimen behind an actuator or
    a compensator, for substeps of length h.
    """
    items = items_of(restoring)
    label = "restoring" if len(items) == 1 else "restoring[{}]"
    named = [(item, f"{label.format(i)} of subdomain {name!r}") for i, item in enumerate(items)]
    functions: list[Any] = []
    called: list[Any] = [
        x for x in named if not isinstance(x[0], (Spring, Device, Wheels)) and not is_compiled(x[0])
    ]
    if called or feedback is not None:
        functions.append(CheckedRestoring(called, order.size, feedback))
    for item, what in named:
        if isinstance(item, Device):
            functions.append(core_specimen(item, order.size, h, what))
        elif isinstance(item, Wheels):
            functions.append(item.for_core(order.size))
        elif is_compiled(item):
            functions.append(item)
    load = None if feedback is None else feedback.last
    return forms.Restoring(tuple(functions), order, load) if functions else None
