"""Compiled functions of the user, given as ``scipy.LowLevelCallable``: signatures, evaluation."""

from __future__ import annotations

import ctypes
import re
import sys

import numpy as np
from scipy import LowLevelCallable

from ..errors import PmalphaError

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
