"""Sparse matrices whose arrays were changed by hand: an error, not the end of the process."""

import numpy as np
import pytest
import scipy.sparse as sp
import waits

import pmalpha as pm

N = 6
FORMATS = ("csr", "csc", "bsr", "coo", "dia", "lil", "dok")
PLAIN = sp.csr_array(4.0 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1))


def made(form):
    return PLAIN.tobsr((2, 2)) if form == "bsr" else PLAIN.asformat(form, copy=True)


def put(name, place, value):
    def damage(A):
        getattr(A, name)[place] = value

    return damage


def replace(name, value):
    return lambda A: setattr(A, name, value(getattr(A, name)))


COMPRESSED = {
    "a far start of a row": put("indptr", 3, 2**20),
    "a negative start of a row": put("indptr", 3, -7),
    "a late first row": put("indptr", 0, 5),
    "starts that decrease": put("indptr", 2, 1),
    "an end behind the entries": put("indptr", -1, 2**30),
    "too few starts": replace("indptr", lambda x: x[:-1]),
    "too many starts": replace("indptr", lambda x: np.append(x, x[-1])),
    "a far index": put("indices", 2, 10**8),
    "a negative index": put("indices", 2, -1),
    "too few indices": replace("indices", lambda x: x[:-2]),
    "too few data": replace("data", lambda x: x[:-2]),
    "indices that are no whole numbers": replace("indices", lambda x: x + 0.5),
}
DAMAGES = {
    "csr": COMPRESSED,
    "csc": COMPRESSED,
    "bsr": COMPRESSED | {"blocks of another size": replace("data", lambda x: x[:, :, :0])},
    "coo": {
        "a far row": lambda A: A.coords[0].__setitem__(1, 10**8),
        "a negative column": lambda A: A.coords[1].__setitem__(1, -2),
        "too few data": replace("data", lambda x: x[:-1]),
    },
    "dia": {
        "fewer offsets than diagonals": replace("offsets", lambda x: x[:-1]),
        "an offset beyond 32 bits": replace("offsets", lambda x: x.astype(np.int64) + 2**40),
        "an offset twice": replace("offsets", lambda x: np.zeros_like(x)),
        "one list of data": replace("data", lambda x: x[0]),
    },
    "lil": {
        "rows of unequal length": lambda A: A.rows[2].append(1),
        "a far column": lambda A: A.rows[2].__setitem__(0, 10**8),
        "a negative column": lambda A: A.rows[2].__setitem__(0, -3),
        "too few rows": replace("rows", lambda x: x[:-1]),
        "a row that is no list": put("rows", 1, 7),
    },
}
CASES = [(form, name) for form, damages in DAMAGES.items() for name in damages]

CALLS = {
    "K": lambda A: pm.Subdomain(np.ones(N), A, scheme=pm.Newmark()),
    "M": lambda A: pm.Subdomain(A, np.ones(N), scheme=pm.Newmark()),
    "C": lambda A: pm.Subdomain(np.ones(N), np.ones(N), C=A, scheme=pm.Newmark()),
    "L": lambda A: pm.Constraint({pm.Subdomain(np.ones(N), np.ones(N), scheme=pm.Newmark()): A}),
    "reduce": lambda A: pm.reduce(np.ones(N), A, fixed=[0]),
    "pattern": lambda A: pm.InternalForce(lambda t, u, v, q: (u, PLAIN), pattern=A),
    "symmetrized": lambda A: pm.readers.symmetrized(A, tol=0.1),
    "completed": lambda A: pm.readers.completed(A),
}


def refused(form, name, call):
    """The message of the ValueError, or what happened instead."""
    A = made(form)
    DAMAGES[form][name](A)
    try:
        CALLS[call](A)
    except ValueError as error:
        return f"ok {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "accepted"


def test_a_sparse_matrix_with_damaged_arrays_is_a_value_error_that_names_it():
    # in a process of its own, which SciPy would end
    code = "from test_sparse_arrays import *\nfor c in CASES:\n for call in CALLS:\n"
    code += "  print(*c, call, refused(*c, call), sep=' | ', flush=True)\n"
    done = waits.program(code)
    lines = done.stdout.splitlines()
    assert done.returncode == 0, f"{done.returncode} after {lines[-1:]}: {done.stderr[-500:]}"
    assert len(lines) == len(CASES) * len(CALLS)
    assert not [line for line in lines if " | ok " not in line]
    assert all(f"in a damaged {line[:3]} matrix" in line for line in lines)


@pytest.mark.parametrize("form", FORMATS)
def test_a_sound_sparse_matrix_is_accepted_in_every_format(form):
    given = pm.Subdomain(np.ones(N), made(form), scheme=pm.Newmark()).K
    np.testing.assert_array_equal(given.toarray(), PLAIN.toarray())
    empty = sp.csr_array((N, N)).asformat(form)
    assert pm.Subdomain(np.ones(N), empty, scheme=pm.Newmark()).n == N


def test_entries_behind_the_end_and_in_any_order_are_no_damage():
    data, indices = np.append(PLAIN.data, 7.0), np.append(PLAIN.indices, 0)
    A = sp.csr_array((N, N))
    A.data, A.indices, A.indptr = data, indices, PLAIN.indptr.copy()
    given = pm.Subdomain(np.ones(N), A, scheme=pm.Newmark()).K
    np.testing.assert_array_equal(given.toarray(), PLAIN.toarray())
