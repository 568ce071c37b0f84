"""In any format of a matrix or a vector, the results are those of dense float64."""

from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp
import waits
from pairwise import in_turn, pairwise

import pmalpha as pm

# 1.5, 0.25 and whole numbers are the same in every type, float32 too, so the problem itself does
# not change with the format. What changes is the order of sums: some 40 steps of a few products
# each, rounding 1e-16 apiece, in a problem whose Mbar and H have a condition number below 100.
ROUNDING = 1e-12

N = 5
M = np.diag([2.0, 1.0, 3.0, 1.0, 2.0])
FULL_M = M + np.diag([0.25] * 4, 1) + np.diag([0.25] * 4, -1)
K = 8.0 * np.eye(N) - 3.0 * np.eye(N, k=1) - 3.0 * np.eye(N, k=-1)
C = 0.25 * np.eye(N) - 0.0625 * np.eye(N, k=1) - 0.0625 * np.eye(N, k=-1)
K_B = np.array([[9.0, -2.0, 0.0], [-2.0, 9.0, -2.0], [0.0, -2.0, 9.0]])
L_A = np.array([[1.0, 0.0, 0.0, 0.0, 0.5], [0.0, 0.0, 0.0, 1.0, 0.0]])
L_B = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, -2.0]])
U0 = np.array([1.0, 0.5, -0.25, 2.0, 0.0])
V0 = np.array([0.5, -1.0, 0.25, 1.0, 1.0])
U0_B, V0_B = np.array([1.0, 0.25, 1.0]), np.array([1.0, 0.0, 0.5])  # L_A x_A + L_B x_B = 0
FORCE = np.array([1.0, 0.0, -0.5, 0.25, 2.0])
PLAIN = {"M": M, "K": K, "C": C, "L": L_A, "u0": U0, "v0": V0, "force": FORCE}


IMPLICIT = pm.GeneralizedAlpha(0.5)


def history(scheme=IMPLICIT, **given):
    """A run of two subdomains tied by general rows, with these in place of the plain arrays."""
    x = PLAIN | given
    options = {name: x[name] for name in ("u0", "v0", "force")}
    a = pm.Subdomain(x["M"], x["K"], C=x["C"], scheme=scheme, substeps=2, name="a", **options)
    b = pm.Subdomain(np.ones(3), K_B, scheme=pm.GeneralizedAlpha(0.8), u0=U0_B, v0=V0_B, name="b")
    return pm.Coupler([a, b], pm.Constraint({a: x["L"], b: L_B}), dt=0.125, coupling="pm").run(
        steps=20
    )


def check_same(ours, theirs):
    for name in "ab":
        for x in "uva":
            expected = getattr(theirs[name], x)
            size = np.max(np.abs(expected))
            np.testing.assert_allclose(
                getattr(ours[name], x), expected, rtol=0.0, atol=ROUNDING * size
            )
    size = np.max(np.abs(theirs.multipliers))
    np.testing.assert_allclose(ours.multipliers, theirs.multipliers, rtol=0.0, atol=ROUNDING * size)


# ---- formats of matrices --------------------------------------------------------------------


def strided(A):
    """A view into a larger array, contiguous in neither direction."""
    large = np.full((3 * A.shape[0], 2 * A.shape[1]), np.nan)
    large[::3, ::2] = A
    return large[::3, ::2]


def backwards(A):
    """A view with negative strides."""
    return A[::-1, ::-1].copy()[::-1, ::-1]


def unaligned(A):
    """Numbers whose address is off by one byte."""
    raw = np.zeros(A.nbytes + 1, dtype=np.uint8)
    view = raw[1:].view(np.float64).reshape(A.shape)
    view[...] = A
    assert not view.flags.aligned
    return view


def read_only(A):
    A = A.copy()
    A.flags.writeable = False
    return A


class Subclass(np.ndarray):
    pass


DENSE = {
    "C order": np.ascontiguousarray,
    "Fortran order": np.asfortranarray,
    "strided view": strided,
    "backwards": backwards,
    "unaligned": unaligned,
    "read-only": read_only,
    "list": lambda A: A.tolist(),
    "tuple": lambda A: tuple(map(tuple, A.tolist())),
    "np.matrix": lambda A: np.array(A).view(np.matrix),
    "subclass": lambda A: np.array(A).view(Subclass),
    "memoryview": lambda A: memoryview(np.ascontiguousarray(A)),
    "float32": lambda A: A.astype(np.float32),
    "float16": lambda A: A.astype(np.float16),
    "longdouble": lambda A: A.astype(np.longdouble),
    "big-endian": lambda A: A.astype(">f8"),
    "big-endian float32": lambda A: A.astype(">f4"),
}


def sparse_formats():
    for name in ("csr", "csc", "coo", "lil", "dok", "bsr", "dia"):
        for kind in ("array", "matrix"):
            yield f"{name}_{kind}", getattr(sp, f"{name}_{kind}")


def as_csr(A):
    return sp.csr_array(A)


def unsorted(A):
    """Column indices of each row from right to left."""
    S = as_csr(A)
    order = np.concatenate(
        [np.arange(b, a, -1) - 1 for a, b in zip(S.indptr[:-1], S.indptr[1:], strict=True)]
    )
    T = sp.csr_array((S.data[order], S.indices[order], S.indptr), shape=S.shape)
    assert not T.has_sorted_indices or np.diff(S.indptr).max() == 1
    return T


def duplicated(A):
    """Every entry as a sum: half of it, and twice a quarter."""
    S = sp.coo_array(A)
    values = np.concatenate([0.5 * S.data, 0.25 * S.data, 0.25 * S.data])
    where = [np.concatenate([x, x, x]) for x in S.coords]
    return sp.coo_array((values, where), shape=S.shape)


def duplicated_csr(A):
    """A csr array with each entry twice, next to each other and not summed."""
    S = as_csr(A)
    twice = np.repeat(np.arange(S.nnz), 2)
    T = sp.csr_array((0.5 * S.data[twice], S.indices[twice], 2 * S.indptr), shape=S.shape)
    assert T.nnz == 2 * S.nnz
    return T


def cancelling(A):
    """Entries where A has none, that cancel to zero."""
    rows, columns = np.nonzero(np.asarray(A) == 0.0)
    S = sp.coo_array(A)
    values = np.concatenate([S.data, np.full(rows.size, 7.0), np.full(rows.size, -7.0)])
    where = [np.concatenate([S.coords[k], x, x]) for k, x in enumerate((rows, columns))]
    return sp.coo_array((values, where), shape=S.shape)


def with_zeros(A):
    """Every entry stored, also the zeros."""
    rows, columns = np.indices(A.shape)
    values = np.asarray(A).ravel()
    return sp.csr_array((values, (rows.ravel(), columns.ravel())), shape=A.shape)


def with_zero_on_one_side(A):
    """A zero stored above the diagonal alone, so that the pattern is not symmetric."""
    S = sp.coo_array(A)
    rows, columns = np.append(S.row, 0), np.append(S.col, A.shape[1] - 1)
    T = sp.csr_array((np.append(S.data, 0.0), (rows, columns)), shape=A.shape)
    assert T.nnz == S.nnz + 1 or A[0, -1] != 0.0
    return T


def long_indices(A):
    S = as_csr(A)
    S.indices, S.indptr = S.indices.astype(np.int64), S.indptr.astype(np.int64)
    assert S.indices.dtype == np.int64
    return S


def long_indices_csc(A):
    S = sp.csc_array(A)
    S.indices, S.indptr = S.indices.astype(np.int64), S.indptr.astype(np.int64)
    return S


def read_only_csr(A):
    S = as_csr(A)
    for x in (S.data, S.indices, S.indptr):
        x.flags.writeable = False
    return S


SPARSE = dict(sparse_formats()) | {
    "csr, unsorted": unsorted,
    "csr, read-only": read_only_csr,
    "csr, int64 indices": long_indices,
    "csc, int64 indices": long_indices_csc,
    "csr, float32": lambda A: as_csr(A).astype(np.float32),
    "csr, duplicates": duplicated_csr,
    "csr, explicit zeros": with_zeros,
    "csr, a zero on one side": with_zero_on_one_side,
    "coo, duplicates": duplicated,
    "coo, cancelling duplicates": cancelling,
}
FORMATS = DENSE | SPARSE


def snapshot(x):
    """Bytes and arrays of an input, to see afterwards that it was not touched."""
    if sp.issparse(x):
        if x.format in ("lil", "dok"):
            return x.toarray().tobytes()
        names = ("data", "indices", "indptr", "offsets", "row", "col")
        arrays = [getattr(x, name) for name in names if hasattr(x, name)]
        return x.format, x.shape, [(a.dtype.str, a.tobytes()) for a in arrays]
    return (str(x), getattr(x, "strides", None), np.asarray(x).tobytes())


@pytest.fixture(scope="module")
def plain():
    return history()


def given_in(form, names):
    """These arrays in the format, which must be as they were when the run has been made."""
    given = {name: form(PLAIN[name]) for name in names}
    before = {name: snapshot(x) for name, x in given.items()}
    yield given
    assert {name: snapshot(x) for name, x in given.items()} == before


@pytest.mark.parametrize("form", FORMATS)
def test_matrices_in_any_format_give_the_results_of_dense_ones(plain, form):
    for given in given_in(FORMATS[form], "MKCL"):
        check_same(history(**given), plain)


@cache
def full_mass(scheme):
    return history(scheme, M=FULL_M)


@pytest.mark.parametrize(
    ("form", "scheme"), in_turn(FORMATS, pm.CentralDifference(), pm.GeneralizedAlpha(0.5)), ids=str
)
def test_a_full_mass_matrix_may_have_any_format_too(form, scheme):
    check_same(history(scheme, M=FORMATS[form](FULL_M)), full_mass(scheme))


@pytest.mark.parametrize(
    "form, dtype",
    [(np.asfortranarray, np.int8), (np.asarray, np.int16), (sp.csr_array, np.int32)]
    + [(sp.coo_matrix, np.int64), (sp.csr_array, np.int64), (np.asarray, ">i8")],
)
def test_whole_numbers_are_numbers(form, dtype):
    whole = {"M": M, "K": K, "C": np.diag([1.0, 0.0, 2.0, 0.0, 1.0])}
    whole |= {"L": np.array([[1.0, 0, 0, 0, 1.0], [0, 0, 0, 1.0, 0]]), "u0": [1, 0, 2, 2, 0]}
    whole |= {"v0": [1, 3, 0, 1, 0], "force": [1, 0, 2, 0, 3]}
    matrices = {name: form(np.asarray(whole[name]).astype(dtype)) for name in "MKCL"}
    vectors = {name: np.asarray(whole[name]).astype(dtype) for name in ("u0", "v0", "force")}
    exact = {name: np.asarray(x, dtype=np.float64) for name, x in whole.items()}
    check_same(history(**matrices, **vectors), history(**exact))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.uint32, np.uint64])
def test_numbers_without_sign_are_numbers(dtype):
    # a difference K - K^T in such a type would wrap around
    spring = np.array([[2, 1], [1, 2]])
    for form in (np.asarray, sp.csr_array):
        ours = pm.Subdomain(
            np.ones(2, dtype), form(spring.astype(dtype)), scheme=pm.Newmark(), u0=[1, 0]
        )
        theirs = pm.Subdomain([1.0, 1.0], 1.0 * spring, scheme=pm.Newmark(), u0=[1.0, 0.0])
        u, expected = (pm.solve(s, dt=0.1, t_end=1.0).u for s in (ours, theirs))
        np.testing.assert_allclose(u, expected, rtol=0.0, atol=ROUNDING)


@pytest.mark.parametrize("name", "MC")
def test_a_diagonal_may_be_given_as_one_axis_or_two(name):
    diagonal = np.array([2.0, 1.0, 3.0, 1.0, 2.0])
    expected = history(**{name: np.diag(diagonal)})
    forms = {x: DENSE[x] for x in ("C order", "float32", "list", "big-endian", "read-only")}
    forms["strided"] = lambda x: np.repeat(x, 2)[::2]
    forms["backwards"] = lambda x: x[::-1].copy()[::-1]
    forms["dia"] = lambda x: sp.dia_array(np.diag(x))
    for form in forms.values():
        given = form(diagonal)
        before = snapshot(given)
        check_same(history(**{name: given}), expected)
        assert snapshot(given) == before


def test_no_damping_is_none_or_zeros():
    expected = history(C=None)
    for zeros in (
        np.zeros(N),
        np.zeros((N, N)),
        sp.csr_array((N, N)),
        with_zeros(np.zeros((N, N))),
    ):
        check_same(history(C=zeros), expected)


@pytest.mark.parametrize("name, i, j", [("M", 2, 2), ("C", 1, 2), ("K", 1, 2), ("L", 0, 4)])
def test_a_format_that_changed_an_entry_a_little_would_be_detected(plain, name, i, j):
    # so the comparison can fail; with 1e-9 the initial velocities still satisfy the constraints
    changed = PLAIN[name].copy()
    changed[i, j] *= 1.0 + 1e-9
    if name != "L":
        changed[j, i] = changed[i, j]
    with pytest.raises(AssertionError):
        check_same(history(**{name: changed}), plain)


# ---- a larger one, where the sparse factor has panels and an order of its own -----------------


def plate(m):
    """Stiffness of a square net of m x m nodes between walls."""
    side = np.full(m - 1, -1.0)
    line = sp.diags_array([np.full(m, 2.0), side, side], offsets=[0, 1, -1])
    return sp.csr_array(sp.kron(line, sp.eye_array(m)) + sp.kron(sp.eye_array(m), line))


def woven(n):
    """A definite matrix with entries all over, whose factor fills in."""
    rng = np.random.default_rng(1)
    A = sp.random_array((n, n), density=0.05, rng=rng)
    return sp.csr_array(A @ A.T + sp.eye_array(n))


LARGE = {"plate": plate(9), "woven": woven(90)}
EXPLICIT = pm.GeneralizedAlpha(0.5, explicit=True)


def large_history(K, mass=None, explicit_mass=None):
    """K as stiffness, or as mass of an explicit subdomain; tied in the middle and at a corner."""
    n = K.shape[0]
    force = np.cos(np.arange(n))
    if explicit_mass is None:
        a = pm.Subdomain(mass, K, scheme=pm.GeneralizedAlpha(0.5), force=force, name="a")
    else:
        a = pm.Subdomain(explicit_mass, np.ones(n), scheme=EXPLICIT, force=force, name="a")
    b = pm.Subdomain(np.ones(2), [3.0, 5.0], scheme=pm.GeneralizedAlpha(0.8), name="b")
    return pm.Coupler([a, b], pm.tie(a, [n // 2, 0], b, [0, 1]), dt=0.1, coupling="pm").run(
        steps=10
    )


# in float32 the numbers would be others, and hundreds of diagonals are nothing for dia
LARGE_FORMS = [form for form in SPARSE if "float32" not in form and "dia" not in form]


@cache
def dense_history(name, role):
    return large_role(LARGE[name].toarray(), LARGE[name].toarray(), role)


def large_role(A, given, role):
    if role == "with mass":
        return large_history(given, np.ones(len(A)))
    return large_history(A, explicit_mass=given)


@pytest.mark.parametrize(
    ("form", "name", "role"), pairwise(LARGE_FORMS, list(LARGE), ["with mass", "explicit mass"])
)
def test_a_large_sparse_matrix_gives_the_results_of_a_dense_one(form, name, role):
    A = LARGE[name].toarray()
    check_same(large_role(A, SPARSE[form](A), role), dense_history(name, role))


ONE_SIDED = """
from test_formats import *

def with_zeros_above(A):
    # a zero stored above the diagonal wherever A has no entry, and none below
    rows, columns = np.nonzero(np.triu(A == 0.0))
    S = sp.coo_array(A)
    where = np.append(S.row, rows), np.append(S.col, columns)
    return sp.csr_array((np.append(S.data, np.zeros(rows.size)), where), shape=A.shape)

blocks = np.kron(np.eye(2), np.ones((60, 60))) + 99.0 * np.eye(120)
for A in (blocks, plate(14).toarray(), woven(150).toarray()):
    dense = large_history(A, explicit_mass=A)
    for given in (with_zeros_above(A), sp.csr_array(with_zeros_above(A).T)):
        for _ in range(3):  # a write beyond an array shows at the next allocation
            ours = large_history(A, explicit_mass=given)
        check_same(ours, dense)
print("the same")
"""


def test_zeros_stored_on_one_side_of_the_diagonal_are_no_crash_and_no_error():
    # symmetric numbers in a pattern that is not symmetric, as differences of matrices and boundary
    # conditions produce it
    done = waits.program(ONE_SIDED)
    assert done.stdout == "the same\n", done.stderr[-1000:]


# ---- vectors --------------------------------------------------------------------------------

VECTORS = {
    "C order": np.ascontiguousarray,
    "strided": lambda x: np.repeat(x, 3)[::3],
    "backwards": lambda x: x[::-1].copy()[::-1],
    "column of a matrix": lambda x: np.stack([x, x + 1.0], axis=1)[:, 0],
    "unaligned": unaligned,
    "read-only": read_only,
    "list": lambda x: x.tolist(),
    "tuple": lambda x: tuple(x.tolist()),
    "subclass": lambda x: x.view(Subclass),
    "memoryview": lambda x: memoryview(x),
    "float32": lambda x: x.astype(np.float32),
    "longdouble": lambda x: x.astype(np.longdouble),
    "big-endian": lambda x: x.astype(">f8"),
}


@pytest.mark.parametrize("form", VECTORS)
def test_vectors_in_any_format_give_the_same_results(plain, form):
    for given in given_in(VECTORS[form], ("u0", "v0", "force")):
        check_same(history(**given), plain)
    # and what a callable returns
    values = VECTORS[form](FORCE)
    check_same(history(force=lambda t: values), plain)


SAMPLES, DIRECTION = np.array([0.0, 1.0, -0.5, 0.25]), np.array([1.0, 0.0, 2.0, 0.5, 0.0])
SERIES = np.array([[0.0, 1.0], [1.0, -0.5], [0.25, 2.0]])
SPATIAL = np.array([[1.0, 0.0], [0.0, 2.0], [0.5, 0.5], [0.0, 0.0], [1.0, -1.0]])


@pytest.fixture(scope="module")
def sampled():
    """Runs with samples as plain arrays."""
    return {
        "shape": history(force=pm.SampledForce(SAMPLES, 0.25, shape=DIRECTION)),
        "base": history(force=pm.BaseAcceleration(SAMPLES, DIRECTION, M, dt=0.25)),
        "series": history(force=pm.SampledForce(SERIES, 0.5, shape=SPATIAL)),
        "full": history(M=FULL_M, force=pm.BaseAcceleration(SAMPLES, DIRECTION, FULL_M, dt=0.5)),
    }


@pytest.mark.parametrize("form", VECTORS)
def test_samples_and_their_shapes_may_have_any_format(sampled, form):
    samples, direction = VECTORS[form](SAMPLES), VECTORS[form](DIRECTION)
    ours = pm.SampledForce(samples, 0.25, shape=direction)
    check_same(history(force=ours), sampled["shape"])
    ours = pm.BaseAcceleration(samples, direction, M, dt=0.25)
    check_same(history(force=ours), sampled["base"])


@pytest.mark.parametrize("form", DENSE)
def test_several_series_of_samples_may_have_any_format(sampled, form):
    ours = pm.SampledForce(DENSE[form](SERIES), 0.5, shape=DENSE[form](SPATIAL))
    check_same(history(force=ours), sampled["series"])
    whole = DENSE[form](SERIES @ SPATIAL.T)
    check_same(history(force=pm.SampledForce(whole, 0.5)), sampled["series"])


@pytest.mark.parametrize("form", FORMATS)
def test_the_mass_of_a_base_acceleration_may_have_any_format(sampled, form):
    given = FORMATS[form](FULL_M)
    before = snapshot(given)
    force = pm.BaseAcceleration(SAMPLES, DIRECTION, given, dt=0.5)
    check_same(history(M=FULL_M, force=force), sampled["full"])
    assert snapshot(given) == before


@pytest.mark.parametrize("form", VECTORS)
def test_a_prescribed_velocity_may_have_any_format(form):
    # one row of zeros for its initial velocity; samples of 0, 1, 0
    samples = np.array([0.0, 1.0, 0.0])

    def driven(velocity):
        a = pm.Subdomain([1.0, 1.0], [2.0, 2.0], scheme=pm.Newmark())
        motion = pm.Constraint({a: [[1.0, 1.0]]}, velocity=velocity)
        return pm.Coupler([a], motion, dt=0.25).run(steps=8)[0].u

    ours = driven(pm.SampledForce(VECTORS[form](samples), 0.5))
    expected = driven(pm.SampledForce(samples, 0.5))
    assert np.max(np.abs(expected)) > 0.1
    np.testing.assert_array_equal(ours, expected)


@pytest.mark.parametrize("form", VECTORS)
def test_reset_takes_vectors_in_any_format(plain, form):
    a = pm.Subdomain(M, K, C=C, scheme=IMPLICIT, substeps=2, name="a")
    b = pm.Subdomain(np.ones(3), K_B, scheme=pm.GeneralizedAlpha(0.8), name="b")
    coupler = pm.Coupler([a, b], pm.Constraint({a: L_A, b: L_B}), dt=0.125, coupling="pm")
    coupler.step(3)
    given = {"u0": {"a": U0, "b": U0_B}, "v0": {"a": V0, "b": V0_B}, "force": {"a": FORCE}}
    coupler.reset(**{k: {s: VECTORS[form](x) for s, x in v.items()} for k, v in given.items()})
    check_same(coupler.run(steps=20), plain)


# ---- lists of dofs --------------------------------------------------------------------------

DOFS = {
    "list": list,
    "tuple": tuple,
    "int64": np.array,
    "int8": lambda x: np.array(x, dtype=np.int8),
    "uint64": lambda x: np.array(x, dtype=np.uint64),
    "big-endian": lambda x: np.array(x, dtype=">i4"),
    "strided": lambda x: np.repeat(x, 2)[::2],
    "backwards": lambda x: np.array(x)[::-1].copy()[::-1],
    "read-only": lambda x: read_only(np.array(x)),
    "memoryview": lambda x: memoryview(np.array(x)),
}


@pytest.mark.parametrize("form", DOFS)
def test_dofs_to_record_may_be_any_whole_numbers_in_any_order(plain, form):
    a = pm.Subdomain(
        M, K, C=C, scheme=pm.GeneralizedAlpha(0.5), u0=U0, v0=V0, force=FORCE, name="a"
    )
    coupler = pm.Coupler([a], dt=0.125)
    everything = coupler.run(steps=5)["a"]
    coupler.reset()
    chosen = coupler.run(steps=5, record={"a": DOFS[form]([3, 0, 4])})["a"]
    assert chosen.dofs.tolist() == [3, 0, 4]
    for x in "uva":
        np.testing.assert_array_equal(getattr(chosen, x), getattr(everything, x)[:, [3, 0, 4]])


@pytest.mark.parametrize("form", DOFS)
def test_dofs_of_a_tie_may_be_any_whole_numbers_in_any_order(form):
    def run(dofs_a, dofs_b):
        a = pm.Subdomain(M, K, scheme=pm.GeneralizedAlpha(0.5), force=FORCE)
        b = pm.Subdomain(np.ones(3), K_B, scheme=pm.GeneralizedAlpha(0.8))
        return pm.Coupler([a, b], pm.tie(a, dofs_a, b, dofs_b), dt=0.125, coupling="pm").run(
            steps=5
        )

    given_a, given_b = DOFS[form]([3, 0]), DOFS[form]([2, 1])
    before = snapshot(given_a)
    ours, expected = run(given_a, given_b), run([3, 0], [2, 1])
    np.testing.assert_array_equal(ours[0].u, expected[0].u)
    np.testing.assert_array_equal(ours.multipliers, expected.multipliers)
    assert np.max(np.abs(expected.multipliers)) > 0.1
    assert snapshot(given_a) == before


# ---- steps and counts -----------------------------------------------------------------------

NUMBERS = {
    "float32": np.float32,
    "float64": np.float64,
    "longdouble": np.longdouble,
    "0-D array": np.array,
    "big-endian": lambda x: np.array(x, dtype=">f8"),
}


@pytest.mark.parametrize("form", NUMBERS)
def test_numbers_may_have_any_real_type(form):
    number = NUMBERS[form]
    a = pm.Subdomain([1.0], [2.0], scheme=pm.GeneralizedAlpha(number(0.5)), u0=[1.0])
    ours = pm.Coupler([a], dt=number(0.125)).run(number(1.0))[0].u
    b = pm.Subdomain([1.0], [2.0], scheme=pm.GeneralizedAlpha(0.5), u0=[1.0])
    np.testing.assert_array_equal(ours, pm.Coupler([b], dt=0.125).run(1.0)[0].u)


@pytest.mark.parametrize("whole", [np.int8, np.uint16, np.int64, np.array])
def test_counts_may_have_any_whole_type(whole):
    a = pm.Subdomain([1.0], [2.0], scheme=pm.Newmark(), u0=[1.0], substeps=whole(3))
    coupler = pm.Coupler([a], dt=0.125)
    assert coupler.run(steps=whole(4), every=whole(2))[0].t.tolist() == [0.0, 0.25, 0.5]
    coupler.step(whole(2))
    assert coupler.step_count == 6
