"""The types of arguments, for type checkers: words, vectors, matrices, dofs.

A checker without stubs of SciPy knows nothing of its classes, so that sparse matrices are described
by what is used of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np

__all__ = [
    "Coupling",
    "Damping",
    "DofsLike",
    "InternalForceFunction",
    "Load",
    "MatrixLike",
    "MotionLoad",
    "RestoringForce",
    "Start",
    "TangentPolicy",
    "VectorLike",
]


def __dir__() -> list[str]:
    return sorted(__all__)


class Load(Protocol):
    """``force=``: the load at time t, evaluated in advance at the end of each substep."""

    def __call__(self, t: float, /) -> Any: ...


class MotionLoad(Protocol):
    """``force=``: a load that depends on the motion, evaluated like a restoring force."""

    def __call__(self, t: float, u: np.ndarray, v: np.ndarray, /) -> Any: ...


class RestoringForce(Protocol):
    """``restoring=``: the force (n,), evaluated once for each substep, in the order of time."""

    def __call__(self, t: float, u: np.ndarray, v: np.ndarray, /) -> Any: ...


class InternalForceFunction(Protocol):
    """``internal=``: (f, K_t), (f, K_t, C_t) or (f, K_t, C_t, q1), called any number of times."""

    def __call__(
        self, t: float, u: np.ndarray, v: np.ndarray, q: np.ndarray, /
    ) -> tuple[Any, ...]: ...


# Values of coupling= and start= of a Coupler, damping= of a Subdomain, tangent= of Newton.
Coupling = Literal["pm", "gc", "macro", "mean"]
Start = Literal["rebased", "plain"]
Damping = Literal["implicit", "lagged"]
TangentPolicy = Literal["full", "reuse"]


class SupportsArray(Protocol):
    """What NumPy converts to an array: arrays themselves, series of pandas, data arrays."""

    def __array__(self) -> np.ndarray: ...


class SparseLike(Protocol):
    """A matrix or array of scipy.sparse, in any format."""

    @property
    def nnz(self) -> Any: ...

    def tocsr(self, copy: bool = ...) -> Any: ...


# A number for one dof.
VectorLike: TypeAlias = float | Sequence[float] | np.ndarray | SupportsArray
# (n,) for a diagonal, (n, n), or sparse.
MatrixLike: TypeAlias = VectorLike | Sequence[Sequence[float]] | Sequence[np.ndarray] | SparseLike
# One dof, numbers or names of dofs, or a mask.
DofsLike: TypeAlias = int | str | Sequence[int | str] | np.ndarray | SupportsArray
