"""Compiled functions of the user, given as ``scipy.LowLevelCallable``: signatures, evaluation."""

from __future__ import annotations

import ctypes
import re
import sys
from collections.abc import Callable, Sequence
from inspect import Parameter, signature
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np
from scipy import LowLevelCallable

from ..errors import PmalphaError

# ---- argument types -----------------------------------------------------------------------------
# The types of arguments, for type checkers: words, vectors, matrices, dofs. A checker without
# stubs of SciPy knows nothing of its classes, so that sparse matrices are described by what is
# used of them.

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


# ---- argument order -----------------------------------------------------------------------------
# The order of the arguments of a user's function: the time is the first, for all kinds.

# By argument of `Subdomain`, as in argument_types.py.
OF_FORCE = ("t", "u", "v")
OF_RESTORING = ("t", "u", "v")
OF_INTERNAL = ("t", "u", "v", "q")
OF_ELEMENTS = (*OF_INTERNAL, "elements")
TIME = {"t", "time"}


def required_names(function: Callable[..., Any], *, wrapped: bool = True) -> list[str] | None:
    """Names of the positional arguments that it requires; one, if it can be called with one.

    None for a function without a readable signature, such as a compiled one. `wrapped`: those of
    the function behind a decorator that says which it is.
    """
    parameters = _parameters(function, wrapped)
    if parameters is None:
        return None
    positional = _positional(parameters)
    required = [p.name for p in positional if p.default is p.empty]
    optional = [p.name for p in parameters if p in positional or p.kind is p.VAR_POSITIONAL]
    return required or optional[:1]


def check_order(function: Callable[..., Any], expected: Sequence[str], name: str) -> None:
    """TypeError for the expected arguments in another order, and for a time that is not the first.
    Other names are the user's own."""
    # a decorator may have changed the order
    parameters = _parameters(function, wrapped=False)
    if parameters is None:
        return
    names = [p.name for p in _positional(parameters)]
    late = not TIME.isdisjoint(names[1:]) and names[0] not in TIME
    required = required_names(function, wrapped=False) or []
    if late or (sorted(required) == sorted(expected) and required != [*expected]):
        raise TypeError(
            f"{name} must be a function of {', '.join(expected)} in this order, got one of "
            f"{', '.join(names)}: {function!r}"
        )


def _parameters(function: Callable[..., Any], wrapped: bool) -> list[Parameter] | None:
    try:
        return [*signature(function, follow_wrapped=wrapped).parameters.values()]
    except (TypeError, ValueError):
        return None


def _positional(parameters: Sequence[Parameter]) -> list[Parameter]:
    return [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]


# ---- lowlevel -----------------------------------------------------------------------------------

# By argument of `Subdomain`: (t, n, f, user), (t, n, u, v, r, user) and, for `internal`,
# (t, n, u, v, q, f, K, C, q1, user).
SIGNATURES = {
    "force": "int (double, intptr_t, double *, void *)",
    "restoring": "int (double, intptr_t, double *, double *, double *, void *)",
    "internal": f"int (double, intptr_t, {7 * 'double *, '}void *)",
}
# Signed types of the size of an address: names of intptr_t in ctypes, cffi, Cython and numba.
SIZES = {"long", "longint", "ssize_t", "Py_ssize_t", "ptrdiff_t", "npy_intp"}
SIZES |= {"longlong", "int64_t", "npy_int64"} if sys.maxsize > 2**32 else {"int", "int32_t"}
DOUBLES = ctypes.POINTER(ctypes.c_double)
# int (t, n, u, v, q, f, K, C, q1, user), as in lowlevel.SIGNATURES
PROTOTYPE = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_double, ctypes.c_ssize_t, *7 * [DOUBLES], ctypes.c_void_p
)


def check_signature(function: LowLevelCallable, name: str, label: str = "") -> None:
    """ValueError unless the function has the signature that an argument of `Subdomain` needs.

    `label` is the argument in the message, such as "restoring[1]" for an item of a list.
    """
    if kinds(function.signature) != kinds(SIGNATURES[name]):
        raise ValueError(
            f"{label or name} must have the signature {SIGNATURES[name]!r}, "
            f"got {function.signature!r}"
        )


def kinds(signature: str) -> list[str]:
    """The types in a signature, result first, with `intptr_t` for all names of it."""
    plain = re.sub(r"\bconst\b|\s|\(\*\)", "", signature).rstrip(")")
    return ["intptr_t" if kind in SIZES else kind for kind in re.split("[(,]", plain)]


def address_and_user(function: LowLevelCallable) -> tuple[int, int | None]:
    """The addresses of a compiled function and of its user data."""
    capsule = tuple.__getitem__(function, 0)
    api, of_object = ctypes.pythonapi, [ctypes.py_object]
    name = ctypes.PYFUNCTYPE(ctypes.c_void_p, *of_object)(("PyCapsule_GetName", api))
    context = ctypes.PYFUNCTYPE(ctypes.c_void_p, *of_object)(("PyCapsule_GetContext", api))
    pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, *of_object, ctypes.c_void_p)(
        ("PyCapsule_GetPointer", api)
    )
    return pointer(capsule, name(capsule)), context(capsule)


def evaluate_compiled(
    function: LowLevelCallable, t: float, u: np.ndarray, v: np.ndarray, q: np.ndarray, nnz: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(f, K, C, q1) with K and C the values of nnz entries; PmalphaError for a code other than 0.

    f, K, C and q1 are zero on entry.
    """
    f, K, C, q1 = (np.zeros(size) for size in (u.size, nnz, nnz, q.size))
    address, user = address_and_user(function)
    arrays = [np.ascontiguousarray(x, dtype=np.float64) for x in (u, v, q)] + [f, K, C, q1]
    pointers = [x.ctypes.data_as(DOUBLES) for x in arrays]
    code = PROTOTYPE(address)(t, u.size, *pointers, user)
    if code:
        raise PmalphaError(f"the compiled internal force returned {code} at t = {t:g}")
    return f, K, C, q1
