"""Signatures of compiled functions, and functions of Python with these by cffi and numba."""

import ctypes

import numpy as np
import pytest
from scipy import LowLevelCallable

DOUBLES = ctypes.POINTER(ctypes.c_double)
HEAD = ctypes.c_int, ctypes.c_double, ctypes.c_ssize_t
FORCE = ctypes.CFUNCTYPE(*HEAD, DOUBLES, ctypes.c_void_p)
RESTORING = ctypes.CFUNCTYPE(*HEAD, *3 * [DOUBLES], ctypes.c_void_p)
INTERNAL = ctypes.CFUNCTYPE(*HEAD, *7 * [DOUBLES], ctypes.c_void_p)


def by_cffi(function, arrays, size="intptr_t"):
    """A function of t, n, this number of arrays, and user data, as a callback of cffi."""
    ffi = pytest.importorskip("cffi").FFI()
    signature = f"int(double, {size}, {'double *, ' * arrays}void *)"
    return LowLevelCallable(ffi.callback(signature, function))


def by_numba(function, arrays):
    """The same, compiled by numba."""
    numba = pytest.importorskip("numba")
    types = numba.types
    doubles = arrays * [types.CPointer(types.float64)]
    signature = types.intc(types.float64, types.intp, *doubles, types.voidptr)
    return LowLevelCallable(numba.cfunc(signature)(function).ctypes)


def low_level(kind, function):
    """A function of Python as a compiled load, "force", or restoring force; 7 where it raises."""

    def called(t, n, *pointers):
        *given, value = (np.ctypeslib.as_array(x, (n,)) for x in pointers[:-1])
        try:
            value[:] = function(t, *given)
        except BaseException:
            return 7
        return 0

    return LowLevelCallable({"force": FORCE, "restoring": RESTORING}[kind](called))
