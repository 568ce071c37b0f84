"""Functions of the user in runs that are repeated: they must return the same again."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import update_wrapper
from typing import Any

import numpy as np
from scipy import LowLevelCallable

from ..problem.actuators import Device
from ..problem.forces import SampledForce
from ..problem.restoring import items_of
from ..problem.springs import Spring
from .session import Session

# Relative difference of two values of a function without memory: rounding of another order of
# summation.
SAME = 1e-9


class Repeated:
    """A function of the user, whose first value in each run is compared with that of the first.

    what: its name in messages, such as "restoring of subdomain 'rig'".
    """

    def __init__(self, function: Callable[..., Any], what: str):
        update_wrapper(self, function, updated=())  # keeps the signature
        self.function, self.what = function, what
        self.first: tuple[list[np.ndarray], list[np.ndarray]] | None = None
        self.begins = True  # the next call is the first of a run

    def __call__(self, *arguments: Any) -> Any:
        if not self.begins:
            return self.function(*arguments)
        self.begins = False
        known = [np.array(x, dtype=float) for x in arguments]  # the function may change them
        value = self.function(*arguments)
        values = [np.array(x) for x in (value if isinstance(value, tuple) else (value,))]
        if self.first is None:
            self.first = known, values
        elif _all_same(known, self.first[0], 0.0) and not _all_same(values, self.first[1], SAME):
            raise ValueError(
                f"{self.what} must return the same in each run, got {values[0]} after "
                f"{self.first[1][0]} for the same arguments: it has a memory or is random; a model "
                "with a memory is internal= with a history, or springs"
            )
        return value


def _all_same(a: list[np.ndarray], b: list[np.ndarray], tolerance: float) -> bool:
    if len(a) != len(b):
        return False
    for x, y in zip(a, b):
        if x.shape != y.shape or x.dtype.kind not in "biuf" or y.dtype.kind not in "biuf":
            return x.shape == y.shape  # what is wrong with it, the caller of the function finds
        size = float(np.max(np.abs(y), initial=0.0))
        if np.max(np.abs(x - y), initial=0.0) > tolerance * size:
            return False
    return True


class RepeatedFunctions:
    """The functions of the user in one problem, each wrapped once."""

    def __init__(self) -> None:
        self.known: dict[int, Repeated] = {}

    def begin(self) -> None:
        """A run begins."""
        for function in self.known.values():
            function.begins = True

    def of(self, function: Any, what: str) -> Any:
        """The same, wrapped where it is a Python function."""
        if not callable(function) or isinstance(function, (SampledForce, LowLevelCallable)):
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
            if item.springs:
                return item
            moved = copy(item)
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
    for x in (function, getattr(function, "__self__", None)):
        if getattr(x, "repeatable", True) is False:
            raise ValueError(
                f"{call} repeats the run: {what} must be a function in this program without a "
                f"memory, got {x!r}, whose `repeatable` is False"
            )
