"""Functions of the user in runs that are repeated: they must return the same again."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import update_wrapper
from typing import Any

import numpy as np
from scipy import LowLevelCallable

from .._checks import MOST
from ..problem.device import Device
from ..problem.forces import SampledForce
from ..problem.restoring import items_of
from ..problem.springs import Spring
from .session import Session

# Relative difference of two values of a function without memory: rounding of another order of
# summation.
SAME = 1e-9


class Repeated:
    """A function of the user, of which some calls of the first run are evaluated again after it.

    what: its name in messages, such as "restoring of subdomain 'rig'".
    """

    def __init__(self, function: Callable[..., Any], what: str):
        update_wrapper(self, function, updated=())  # keeps the signature
        self.function, self.what = function, what
        self.count: int | None = 0  # of calls in the first run, then None
        self.calls: list[tuple[list[Any], list[np.ndarray]]] = []  # of calls 1, 2, 4, 8, ...

    def __call__(self, *arguments: Any) -> Any:
        if self.count is None:
            return self.function(*arguments)
        self.count += 1
        if self.count & (self.count - 1):
            return self.function(*arguments)
        copies = [copy(x) for x in arguments]  # the function may change them
        value = self.function(*arguments)
        self.calls.append((copies, _arrays(value)))
        return value

    def check(self) -> None:
        """ValueError unless it returns the same again, from the last call that was kept to the
        first: what remembers has another past then."""
        self.count = None
        while self.calls:
            arguments, values = self.calls.pop()
            again = _arrays(self.function(*arguments))
            if not all(map(_is_same, again, values)):
                raise ValueError(
                    f"{self.what} must return the same in each run, got {again[0]} after "
                    f"{values[0]} for the same arguments: it has a memory, or is random. Springs, "
                    "and internal= with a history, have a memory that is known; a function that "
                    "begins anew at t = 0 may say so by the attribute repeatable = True"
                )


def _arrays(value: Any) -> list[np.ndarray]:
    """A value, or several of a tuple, as copies."""
    return [np.array(x) for x in (value if isinstance(value, tuple) else (value,))]


def _is_same(a: np.ndarray, b: np.ndarray) -> bool:
    if a.shape != b.shape or a.dtype.kind not in "biuf":
        return a.shape == b.shape
    size = float(np.max(np.abs(b), initial=0.0))
    return float(np.max(np.abs(a - b), initial=0.0)) <= SAME * size


class RepeatedFunctions:
    """The functions of the user in one problem, each wrapped once."""

    def __init__(self) -> None:
        self.known: dict[int, Repeated] = {}

    def check(self) -> None:
        """ValueError for one that does not return the same again, after the first run."""
        for function in self.known.values():
            function.check()

    def of(self, function: Any, what: str) -> Any:
        """The same, wrapped where it is a Python function that may have a memory."""
        if not callable(function) or isinstance(function, (SampledForce, LowLevelCallable)):
            return function
        if stated(function) is True:
            return function
        if id(function) not in self.known:
            self.known[id(function)] = Repeated(function, what)
        return self.known[id(function)]

    def of_restoring(self, restoring: Any, name: str) -> Any:
        """A restoring force with its functions wrapped."""
        what = f"restoring of subdomain {name!r}"
        items = [self._item(item, what) for item in items_of(restoring)]
        return items or None

    def _item(self, item: Any, what: str) -> Any:
        if isinstance(item, Device):
            moved = copy(item)
            moved.max_steps = MOST  # checked with the steps of the coupler, which are halved here
            if not isinstance(item.specimen, tuple) or isinstance(item.specimen, LowLevelCallable):
                moved.specimen = self._item(item.specimen, what)
            return moved
        return item if isinstance(item, Spring) else self.of(item, what)


def require_repeatable(session: Session, call: str) -> None:
    """ValueError for what says that it cannot be repeated, ``repeatable = False``."""
    for name, s in session.keys:
        for item in items_of(s.restoring):
            function = item.innermost if isinstance(item, Device) else item
            _require(function, f"restoring of subdomain {name!r}", call)
    for (name, _), force in zip(session.keys, session.loads.forces):
        _require(force, f"force of subdomain {name!r}", call)
    for motion in session.loads.motions:
        _require(motion.velocity, motion.what, call)
    contacts = session.rows.contacts
    for label, c in () if contacts is None else zip(contacts.names, contacts.contacts):
        for f in c.motion if isinstance(c.motion, tuple) else (c.motion,):
            _require(f, f"motion of {label!r}", call)


def _require(function: Any, what: str, call: str) -> None:
    if stated(function) is False:
        raise ValueError(
            f"{call} repeats the run: {what} must be a function in this program, got {function!r}, "
            "which says that it cannot be repeated (repeatable = False)"
        )


def stated(function: Any) -> bool | None:
    """What a function, or the object that it is a method of, says of itself."""
    statement = getattr(function, "repeatable", None)
    result: bool | None = getattr(getattr(function, "__self__", None), "repeatable", statement)
    return result
