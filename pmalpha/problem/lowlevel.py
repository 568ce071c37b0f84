"""Compiled functions of the user's, as ``scipy.LowLevelCallable``: their signatures."""

from __future__ import annotations

import re
import sys

from scipy import LowLevelCallable

# By argument of a `Subdomain`: (t, n, f, user) and (t, n, u, v, r, user).
SIGNATURES = {
    "force": "int (double, intptr_t, double *, void *)",
    "restoring": "int (double, intptr_t, double *, double *, double *, void *)",
}
# The signed types of an address' size: how ctypes, cffi, Cython and numba may spell intptr_t.
SIZES = {"long", "longint", "ssize_t", "Py_ssize_t", "ptrdiff_t", "npy_intp"}
SIZES |= {"longlong", "int64_t", "npy_int64"} if sys.maxsize > 2**32 else {"int", "int32_t"}


def check_signature(function: LowLevelCallable, name: str) -> None:
    """ValueError unless the function has the signature that `force` or `restoring` needs."""
    if kinds(function.signature) != kinds(SIGNATURES[name]):
        raise ValueError(
            f"{name} must have the signature {SIGNATURES[name]!r}, got {function.signature!r}"
        )


def kinds(signature: str) -> list[str]:
    """The types in a signature, result first, with one spelling for all sizes."""
    plain = re.sub(r"\bconst\b|\s|\(\*\)", "", signature).rstrip(")")
    return ["intptr_t" if kind in SIZES else kind for kind in re.split("[(,]", plain)]
