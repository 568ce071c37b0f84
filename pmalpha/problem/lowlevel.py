"""Signatures of compiled functions of the user, given as ``scipy.LowLevelCallable``."""

from __future__ import annotations

import re
import sys

from scipy import LowLevelCallable

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
