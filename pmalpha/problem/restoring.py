"""Restoring forces: the values that ``restoring`` of a subdomain can have, equation (R2)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import LowLevelCallable

from .._checks import vector
from .lowlevel import check_signature
from .springs import Spring, check_dofs, spring_list

Function = Callable[[np.ndarray, np.ndarray, float], Any] | LowLevelCallable
Watch = Callable[[np.ndarray, np.ndarray, np.ndarray, float], None]
Restoring = Function | tuple[Spring, ...] | None


def checked_restoring(restoring: Any, n: int) -> Restoring:
    """A user's restoring force, checked as far as possible without evaluating it."""
    springs = spring_list(restoring)
    if springs is not None:
        check_dofs(springs, n)
        return springs
    if isinstance(restoring, LowLevelCallable):
        check_signature(restoring, "restoring")
    elif restoring is not None and not callable(restoring):
        raise TypeError(f"restoring must be callable or a list of springs, got {restoring!r}")
    return restoring


def is_function(restoring: Restoring) -> bool:
    """True for a callable or LowLevelCallable, false for springs and None."""
    return restoring is not None and type(restoring) is not tuple  # as a LowLevelCallable is too


class CheckedRestoring:
    """A Python callable for the core, whose values are checked.

    Parameters
    ----------
    restoring : callable
        r(u, v, t) -> (n,)
    what : str
        Name in messages, such as "restoring of subdomain 'rig'".
    n : int
        Number of dofs.
    watch : callable, optional
        Called after each evaluation as ``watch(u, v, r, t)``.
    """

    def __init__(self, restoring: Callable, what: str, n: int, watch: Watch | None = None):
        self.restoring, self.what, self.n, self.watch = restoring, what, n, watch

    def __call__(self, u: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        before = (u.copy(), v.copy()) if self.watch else ()  # the function may change its copies
        value = self.restoring(u, v, t)
        try:
            r = vector(value, self.n, "its value")
        except (TypeError, ValueError) as error:
            raise type(error)(f"{self.what} at t = {t:g}: {error}") from None
        if self.watch:
            self.watch(*before, r, t)
        return r


def core_restoring(
    restoring: Restoring, name: str, order: np.ndarray, watch: Watch | None = None
) -> tuple | None:
    """The function of subdomain `name` in the form of the core, None for springs."""
    if not is_function(restoring):
        return None
    if isinstance(restoring, LowLevelCallable):
        return restoring, order
    what = f"restoring of subdomain {name!r}"
    return CheckedRestoring(restoring, what, order.size, watch), order
