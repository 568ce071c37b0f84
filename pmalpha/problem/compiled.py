"""Evaluation of a compiled internal force by Python, in set-up; in a step the core calls it."""

from __future__ import annotations

import ctypes

import numpy as np
from scipy import LowLevelCallable

from ..errors import PmalphaError

DOUBLES = ctypes.POINTER(ctypes.c_double)
# int (t, n, u, v, q, f, K, C, q1, user), as in lowlevel.SIGNATURES
PROTOTYPE = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_double, ctypes.c_ssize_t, *7 * [DOUBLES], ctypes.c_void_p
)


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
    function: LowLevelCallable, u: np.ndarray, v: np.ndarray, t: float, q: np.ndarray, nnz: int
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
