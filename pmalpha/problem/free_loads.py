"""Loads of all dofs of a structure with supports, as those of its free dofs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy import LowLevelCallable

from .arguments import OF_FORCE, check_order
from .loads import BaseAcceleration, Mass, SampledForce, is_list_of_loads, required_arguments
from .matrices import Matrix


def load_of_free(
    force: Any, reduced: Any, M: Matrix | None, names: Sequence[str] | None = None
) -> Any:
    """A load of all dofs, of a structure with mass M, as that of the free ones, of a `Reduction`;
    other loads as they are. `names` are those of all dofs."""
    if is_list_of_loads(force):
        return [load_of_free(x, reduced, M, names) for x in force]
    if isinstance(force, BaseAcceleration) and force.n in (0, reduced.n):
        return force._of(Mass(M, names), reduced.n, "force")._part(reduced.free)
    if isinstance(force, SampledForce):
        return force._part(reduced.free) if force.n == reduced.n else force
    if callable(force) and not isinstance(force, LowLevelCallable):
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
