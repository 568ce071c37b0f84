"""Odd values in place of good ones: what users, other programs and accidents put into arguments.

``odd(rng, value)`` is the value in another form, the value with a fault, or something else.
"""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import scipy.sparse as sp

NUMBERS = (0.0, -1.0, np.nan, np.inf, -np.inf, 1e308, -1e308, 1e155, 1e-155, 1e-308, 5e-324, 2**70)
NUMBERS += (1e30, -0.0, 1e10, 1e-10, 0.5, 1.0)
COUNTS = (0, -1, 1, 2, 3, 7, 2**31 - 1, 2**31, 2**32, 2**63 - 1, 2**63, 2**70, -(2**63))
WORDS = ("", "x", "\0", "é" * 300, "../x", "/", "\udcff", "pm", "all", "None", "lumped")
DTYPES = ("i1", "u1", "i4", "u8", "?", "f2", "f4", ">f8", "g", "c16", "O", "U8", "S8", "M8[s]")


class Other:
    """An object that is nothing of what a function expects; its class can be called with all."""

    def __init__(self, *_):
        pass


def others(rng):
    """Something of another kind."""
    choices = (None, True, "x", b"x", 1j, Other(), Other, [], {}, (), set(), 0, 1, -1, 1.5, [[]])
    choices += (np.nan, [1.0], [[1.0, 2.0], [3.0]], [None], {"a": 1}, np.zeros((0, 0)), range(3))
    choices += (np.zeros(3), np.eye(3), np.array(1.0), sp.eye_array(3), lambda *_: None, slice(1))
    return choices[int(rng.integers(len(choices)))]


def odd(rng, value):
    """Another value in place of this one."""
    if rng.random() < 0.15:
        return others(rng)
    for kinds, change in CHANGES:
        if isinstance(value, kinds):
            return change(rng, value)
    return value if callable(value) and rng.random() < 0.3 else others(rng)


def odd_flag(rng, value):
    return (not value, np.bool_(value), int(value), "yes", None)[int(rng.integers(5))]


def odd_count(rng, value):
    forms = (np.int8, np.uint64, np.array, float, np.float64, str, Fraction, lambda x: [x])
    if rng.random() < 0.4 and 0 <= value < 100:
        return forms[int(rng.integers(len(forms)))](value)
    return COUNTS[int(rng.integers(len(COUNTS)))]


def odd_number(rng, value):
    forms = (np.float16, np.float32, np.longdouble, np.array, Decimal, Fraction, str, complex)
    forms += (lambda x: [x], lambda x: -x, lambda x: np.array([x]), lambda x: np.array([[x, x]]))
    if rng.random() < 0.4:
        return forms[int(rng.integers(len(forms)))](value)
    return NUMBERS[int(rng.integers(len(NUMBERS)))]


def odd_word(rng, value):
    forms = (str.upper, str.encode, lambda x: x + " ", lambda x: [x], lambda x: np.array(x))
    if rng.random() < 0.4:
        return forms[int(rng.integers(len(forms)))](value)
    return WORDS[int(rng.integers(len(WORDS)))]


def odd_list(rng, value):
    """A list with one entry changed, lost, twice, or as an array, an iterator, a set of keys."""
    if not value:
        return others(rng)
    i, kind = int(rng.integers(len(value))), int(rng.integers(6))
    new = list(value)
    if kind == 0:
        del new[i]
    elif kind == 1:
        new.append(new[i])
    elif kind == 2:
        return iter(new)
    elif kind == 3 and all(isinstance(x, int | float) for x in new):
        return odd_array(rng, np.array(new))
    else:
        new[i] = odd(rng, new[i])
    return tuple(new) if isinstance(value, tuple) else new


def odd_dict(rng, value):
    """A dict with another key or value, without one, or as a list of pairs."""
    if not value:
        return others(rng)
    key, kind = list(value)[int(rng.integers(len(value)))], int(rng.integers(5))
    new = dict(value)
    if kind == 0:
        del new[key]
    elif kind == 1:
        new[odd_key(rng, key)] = new.pop(key)
    elif kind == 2:
        return list(new.items())
    else:
        new[key] = odd(rng, new[key])
    return new


def odd_key(rng, key):
    choices = ("nobody", 0, 7, None, -1, "", (1, 2), np.int64(0), key)
    return choices[int(rng.integers(len(choices)))]


# ---- arrays ----------------------------------------------------------------------------------


def odd_array(rng, A):
    return ARRAYS[int(rng.integers(len(ARRAYS)))](rng, A)


def with_entry(rng, A):
    """One entry is something else, if the type can hold it."""
    if A.dtype.kind not in "iuf" or not A.size:
        return ~A if A.dtype.kind == "b" else A[..., None]
    B = np.array(A, dtype=float if A.dtype.kind == "f" else np.int64)
    values = NUMBERS if A.dtype.kind == "f" else COUNTS
    value = values[int(rng.integers(len(values)))]
    with np.errstate(over="ignore"):
        place = int(rng.integers(B.size))
        B.flat[place] = value if B.dtype.kind == "f" else np.int64(max(min(value, 2**62), -(2**62)))
    return B


def of_dtype(rng, A):
    dtype = np.dtype(DTYPES[int(rng.integers(len(DTYPES)))])
    with np.errstate(all="ignore"):
        return A.astype(np.int64).astype(dtype) if dtype.kind == "M" else A.astype(dtype)


def in_steps(rng, A):
    """The same numbers with other strides: not contiguous, backwards, by columns, not aligned."""
    kind = int(rng.integers(4))
    if kind == 0:
        B = np.zeros(tuple(2 * k for k in A.shape), A.dtype)[
            tuple(slice(None, None, 2) for _ in A.shape)
        ]
    elif kind == 1:
        B = np.zeros_like(A)[tuple(slice(None, None, -1) for _ in A.shape)]
    elif kind == 2:
        B = np.zeros(A.shape, A.dtype, order="F")
    else:
        raw = np.zeros(A.nbytes + 1, np.uint8)[1:]
        B = raw.view(A.dtype).reshape(A.shape)
    B[...] = A
    return B


def of_shape(rng, A):
    """More or fewer axes or entries."""
    forms = (
        np.atleast_2d,
        lambda A: A[..., None],
        lambda A: A[None],
        lambda A: A[:0],
        lambda A: A.T,
    )
    forms += (lambda A: A[1:], lambda A: np.concatenate([A, A]), np.ravel, lambda A: A[:, :0])
    forms += (lambda A: np.broadcast_to(A.ravel()[:1], (2**40,)), lambda A: A.ravel()[0])
    forms += (lambda A: np.broadcast_to(A.ravel()[:1], A.shape), lambda A: np.zeros((1,) * 33))
    try:
        return forms[int(rng.integers(len(forms)))](A)
    except (IndexError, ValueError):
        return A[..., None]


def of_kind(rng, A):
    """Lists, subclasses, other containers of the same numbers."""
    forms = (lambda A: A.tolist(), np.matrix, np.ma.masked_array, lambda A: tuple(A.tolist()), iter)
    forms += (memoryview, lambda A: np.ma.masked_less(A, 1), str, lambda A: A.astype(object))
    forms += (lambda A: [[*A.ravel().tolist()], []], lambda A: A.view(np.recarray))
    try:
        return forms[int(rng.integers(len(forms)))](A)
    except (TypeError, ValueError):
        return A.tolist()


def scaled(rng, A):
    with np.errstate(all="ignore"):
        return A * NUMBERS[int(rng.integers(len(NUMBERS) - 7))]


def as_sparse(rng, A):
    if A.ndim != 2 or A.dtype.kind not in "biuf":
        return A[None]
    return odd_sparse(rng, sp.csr_array(A))


ARRAYS = (with_entry,) * 3 + (of_dtype, in_steps, of_shape, of_shape, of_kind, scaled, as_sparse)


# ---- sparse matrices -------------------------------------------------------------------------


def odd_sparse(rng, A):
    """In another format, and then perhaps with one of its arrays changed by hand."""
    formats = ("csr", "csc", "coo", "dia", "bsr", "lil", "dok")
    A = sp.csr_array(A).asformat(formats[int(rng.integers(7))]).copy()
    if rng.random() < 0.3:
        A = sp.csr_matrix(A).asformat(A.format)
    if rng.random() < 0.6:
        corrupt(rng, A)
    return A


def corrupt(rng, A):
    """Change one of the arrays of a sparse matrix so that the others do not fit it."""
    arrays = {"csr": ("indptr", "indices", "data"), "coo": ("coords", "data")}
    arrays |= {"csc": arrays["csr"], "bsr": arrays["csr"], "dia": ("offsets", "data")}
    arrays |= {"lil": ("rows", "data"), "dok": ()}
    names = arrays[A.format]
    if not names:
        return
    name = names[int(rng.integers(len(names)))]
    if A.format == "lil":
        row = getattr(A, name)[int(rng.integers(A.shape[0]))]
        row.append(int(COUNTS[int(rng.integers(len(COUNTS)))]))
        return
    if name == "coords":
        name = ("row", "col")[int(rng.integers(2))]
    x = getattr(A, name)
    if x.size and rng.random() < 0.7:
        limits = np.iinfo(x.dtype) if x.dtype.kind in "iu" else None
        values = COUNTS if limits else NUMBERS
        value = values[int(rng.integers(len(values)))]
        x.flat[int(rng.integers(x.size))] = (
            max(min(value, limits.max), limits.min) if limits else value
        )
    else:
        changed = (
            x[:-1],
            np.concatenate([x, x]),
            x.astype(float),
            x.astype("c16"),
            x[None],
            x.astype(object),
        )
        setattr(A, name, changed[int(rng.integers(len(changed)))])


CHANGES = (
    (bool, odd_flag),
    (int, odd_count),
    (float, odd_number),
    (str, odd_word),
    (np.ndarray, odd_array),
    ((sp.sparray, sp.spmatrix), odd_sparse),
    ((list, tuple), odd_list),
    (dict, odd_dict),
)
