"""Internal forces as a user gives them: accepted kinds, checks, evaluation over one pattern."""

import copy
import ctypes
import pickle

import numpy as np
import pytest
import scipy.sparse as sp
from compiled import DOUBLES, RESTORING
from compiled import INTERNAL as COMPILED
from scipy import LowLevelCallable

import pmalpha as pm
from pmalpha.problem.internal import Internal, checked_internal
from pmalpha.problem.tangents import CheckedInternal, first_tangent

IMPLICIT = pm.GeneralizedAlpha(0.5)
EXPLICIT = pm.CentralDifference()
NONE = np.zeros(0)
F = np.zeros(2)
BROKEN = sp.csr_array(([1.0], [0], [0, 1, 1]), shape=(2, 2))
BROKEN.indices[0] = 5


def cubic(t, u, v, q):
    """Cubic springs to the ground: a diagonal tangent."""
    return u + u**3, 1.0 + 3.0 * u**2


def chain_matrix(n):
    return sp.csr_array(sp.diags_array([2.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(n, n)))


def chain(t, u, v, q):
    """Springs d + d^3 between neighbouring dofs: a tridiagonal tangent."""
    d = np.diff(u)
    end = d + d**3
    slope = 1.0 + 3.0 * d**2
    f = np.append(0.0, end) - np.append(end, 0.0)
    main = np.append(slope, 0.0) + np.append(0.0, slope)
    K = sp.diags_array([main, -slope, -slope], offsets=[0, 1, -1])
    return f, sp.csr_array(K)


def friction(t, u, v, q):
    """Elastic and perfectly plastic, with the plastic displacement as history."""
    f = np.clip(100.0 * (u - q), -1.0, 1.0)
    return f, np.where(np.abs(f) < 1.0, 100.0, 0.0), None, u - f / 100.0


def drag(t, u, v, q):
    return np.abs(v) * v, None, 2.0 * np.abs(v)


class Element:
    """What pmalpha.structures has: an object with history, pattern, __call__ and more."""

    history = None

    def __init__(self, n):
        self.pattern = chain_matrix(n)
        self.calls = []

    def __call__(self, t, u, v, q):
        self.calls.append("all")
        return chain(t, u, v, q)

    def residual(self, t, u, v, q):
        self.calls.append("residual")
        return chain(t, u, v, q)[0]

    def potential(self, u):
        d = np.diff(u)
        return float(np.sum(d**2 / 2 + d**4 / 4))


def subdomain(n=2, scheme=IMPLICIT, **arguments):
    return pm.Subdomain(np.ones(n), arguments.pop("K", np.ones(n)), scheme=scheme, **arguments)


def at_start(forces, n, u0=None, v0=None, name="x"):
    """(adapter, dense K, dense C or None) at t = 0."""
    forces = checked_internal(forces, n).forces
    u0 = np.zeros(n) if u0 is None else np.asarray(u0, dtype=float)
    v0 = np.zeros(n) if v0 is None else np.asarray(v0, dtype=float)
    q0 = np.concatenate([NONE, *(force.history for force in forces)])
    pattern, K, C = first_tangent(forces, n, u0, v0, q0, name)
    adapter = CheckedInternal(forces, name, pattern, C is not None, symmetric=False)
    adapter.pattern = pattern
    return adapter, dense(pattern, K), None if C is None else dense(pattern, C)


def dense(pattern, values):
    return sp.csr_array((values, pattern.indices, pattern.indptr), shape=pattern.shape).toarray()


# ---- compiled functions ---------------------------------------------------------------------

PAIR = sp.csr_array([[1.0, 1.0], [1.0, 1.0]])


def spring_between(t, n, u, v, q, f, K, C, q1, user):
    """k (d + d^3) + c d' between dofs 0 and 1, with k the user data; q counts the evaluations."""
    k = ctypes.cast(user, DOUBLES)[0] if user else 1.0
    if any(x[i] for x, m in ((f, 2), (K, 4), (C, 4), (q1, 1)) for i in range(m)):
        return 9  # they must be zero on entry
    d = u[0] - u[1]
    f[0] = k * (d + d**3) + 0.5 * (v[0] - v[1])
    f[1] = -f[0]
    for i in range(4):
        K[i] = (1.0, -1.0, -1.0, 1.0)[i] * k * (1.0 + 3.0 * d * d)
        C[i] = (0.5, -0.5, -0.5, 0.5)[i]
    q1[0] = q[0] + 1.0
    return 0


def compiled(function=spring_between, **options):
    return pm.InternalForce(LowLevelCallable(COMPILED(function)), pattern=PAIR, **options)


def test_a_compiled_force_has_the_values_of_its_python_twin():
    force = compiled(history=[3.0])
    u, v = np.array([0.3, -0.1]), np.array([0.2, 0.4])
    f, K, C, q1 = force(0.5, u, v, force.history)
    first = 0.4 + 0.4**3 - 0.5 * 0.2
    # 1e-15: the same few operations, in another order
    np.testing.assert_allclose(f, [first, -first], rtol=0, atol=1e-15)
    np.testing.assert_allclose(K.toarray(), 1.48 * np.array([[1, -1], [-1, 1]]), atol=1e-15)
    np.testing.assert_array_equal(C.toarray(), 0.5 * np.array([[1, -1], [-1, 1]]))
    assert q1.tolist() == [4.0]


def test_a_compiled_force_receives_its_user_data():
    stiffness = ctypes.c_double(7.0)
    data = ctypes.cast(ctypes.pointer(stiffness), ctypes.c_void_p)
    function = LowLevelCallable(COMPILED(spring_between), user_data=data)
    force = pm.InternalForce(function, history=[0.0], pattern=PAIR)
    K = force(0.0, np.zeros(2), np.zeros(2), np.zeros(1))[1]
    assert K[0, 0] == 7.0


def test_the_tangents_of_a_compiled_force_can_be_checked():
    right = compiled(history=[0.0]).check(0.0, [0.3, -0.1], [0.2, 0.4])
    assert right.error < 1e-8  # of a cubic law differences have ten digits

    def wrong(*args):
        code = spring_between(*args)
        args[7][3] = 0.75  # in C
        return code

    report = compiled(wrong, history=[0.0]).check(0.0, [0.3, -0.1], [0.2, 0.4])
    assert (report.matrix, report.row, report.column, report.given) == ("C_t", 1, 1, 0.75)
    assert report.difference == pytest.approx(0.5, rel=1e-8)


def test_a_code_of_a_compiled_force_is_an_error():
    force = compiled(lambda *args: 3)
    with pytest.raises(pm.PmalphaError, match="returned 3 at t = 0.5"):
        force(0.5, np.zeros(2), np.zeros(2), NONE)


def test_a_compiled_force_and_a_python_force_are_summed():
    adapter, K, C = at_start([compiled(history=[0.0]), cubic], 2)
    np.testing.assert_array_equal(K, [[2.0, -1.0], [-1.0, 2.0]])
    np.testing.assert_array_equal(C, [[0.5, -0.5], [-0.5, 0.5]])
    assert adapter(0.0, np.ones(2), np.zeros(2), np.zeros(1), True)[3].tolist() == [1.0]


def test_compiled_forces_are_refused_with_the_reason():
    function = LowLevelCallable(COMPILED(spring_between))
    unsorted = sp.csr_array(([1.0] * 4, [1, 0, 0, 1], [0, 2, 4]), shape=(2, 2))
    text = "pattern must be a sparse matrix for a LowLevelCallable, .*got None"
    with pytest.raises(ValueError, match=text):
        pm.InternalForce(function)
    text = r"internal must have the signature 'int \(double, intptr_t, (double \*, ){7}void \*\)'"
    with pytest.raises(ValueError, match=text):
        pm.InternalForce(LowLevelCallable(RESTORING(lambda *x: 0)), pattern=PAIR)
    with pytest.raises(ValueError, match="pattern must have sorted columns without duplicates"):
        pm.InternalForce(function, pattern=unsorted)
    text = r"internal must be InternalForce\(function, pattern=...\) for a LowLevelCallable"
    with pytest.raises(TypeError, match=text):
        subdomain(internal=function)
    with pytest.raises(ValueError, match="restoring must have the signature"):
        subdomain(restoring=function)


# ---- InternalForce --------------------------------------------------------------------------


def test_an_internal_force_holds_copies_and_is_frozen():
    history, pattern = np.array([1.0, 2.0]), chain_matrix(3)
    force = pm.InternalForce(friction, history, pattern)
    history[0] = pattern.data[0] = 9.0
    assert force.history.tolist() == [1.0, 2.0] and force.evaluate is friction
    assert force.pattern.data.tolist() == [1.0] * 7
    for name in ("history", "pattern", "evaluate", "histroy"):
        with pytest.raises(AttributeError, match=f"{name} of a InternalForce must not be changed"):
            setattr(force, name, None)
    for array in (force.history, force.pattern.data):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    for other in (copy.copy(force), pickle.loads(pickle.dumps(force))):
        assert other.evaluate is friction and other.history.tolist() == [1.0, 2.0]
        assert other.pattern.nnz == 7


def test_the_defaults_are_no_history_and_no_pattern():
    value = (1.0, "K")
    assert pm.InternalForce(lambda t, u, v, q: value)(None, None, 0.0, None) is value
    force = pm.InternalForce(cubic)
    assert force.history.shape == (0,) and force.history.dtype == np.float64
    assert force.pattern is None and force.residual is None and force.potential is None
    assert repr(force) == "<InternalForce cubic>"
    shown = repr(pm.InternalForce(cubic, [0.0, 1.0], chain_matrix(2)))
    assert shown == "<InternalForce cubic: 2 numbers of history, pattern of 4 values>"


def test_stored_zeros_are_part_of_a_pattern_in_every_format():
    entries = ([0.0, 1.0, 0.0], ([0, 1, 0], [0, 1, 1]))  # two of three are zero
    by_entries = sp.coo_array(entries, shape=(2, 2))
    diagonals = sp.dia_array((np.array([[0.0, 1.0], [5.0, 0.0]]), [0, 1]), shape=(2, 2))
    rows = by_entries.tocsr()
    for pattern in (by_entries, rows, by_entries.tocsc(), sp.csr_matrix(rows), diagonals):
        kept = pm.InternalForce(cubic, pattern=pattern).pattern
        assert kept.indices.tolist() == [0, 1, 1] and kept.indptr.tolist() == [0, 2, 3]


@pytest.mark.parametrize(
    "arguments, error, text",
    [
        (dict(evaluate=3.0), TypeError, "evaluate must be callable, got 3.0"),
        (dict(evaluate=None), TypeError, "evaluate must be callable, got None"),
        (dict(history=[1j]), TypeError, "history must hold real numbers"),
        (dict(history=[[1.0]]), ValueError, "history must be a 1-D array"),
        (dict(history=[np.nan]), ValueError, "history must be finite"),
        (dict(pattern=np.eye(2)), TypeError, "pattern must be a scipy.sparse matrix or array"),
        (dict(pattern=sp.eye_array(2, 3)), ValueError, "pattern must be square and not empty"),
        (dict(pattern=sp.csr_array((0, 0))), ValueError, "pattern must be square and not empty"),
    ],
)
def test_bad_arguments_of_an_internal_force_are_errors(arguments, error, text):
    with pytest.raises(error, match=text):
        pm.InternalForce(**{"evaluate": cubic, **arguments})


# ---- check ----------------------------------------------------------------------------------


@pytest.mark.parametrize("given", [cubic, chain, Element(4)], ids=["diagonal", "sparse", "element"])
def test_consistent_tangents_pass_the_check(given):
    u = np.array([0.3, -0.2, 0.5, 0.1])
    # 1e-8: differences of cubic laws have ten digits
    assert pm.InternalForce(given).check(u).error < 1e-8


def test_the_check_names_the_worst_column_and_its_values():
    def wrong(t, u, v, q):
        f, K = chain(t, u, v, q)
        K = K.toarray()
        K[1, 2] *= 2.0  # d = 0.7
        return f, K

    report = pm.InternalForce(wrong).check([0.3, -0.2, 0.5, 0.1])
    slope = 1.0 + 3.0 * 0.7**2
    assert (report.matrix, report.row, report.column) == ("K_t", 1, 2)
    assert report.given == pytest.approx(-2.0 * slope, rel=1e-14)
    assert report.difference == pytest.approx(-slope, rel=1e-8)
    # the largest entry is the wrong one or a diagonal one: 2 slope = 4.94 > 1.75 + 2.47
    assert report.scale == pytest.approx(2.0 * slope, rel=1e-8)
    assert report.error == pytest.approx(0.5, rel=1e-8)
    text = "in K_t in the column of dof 2: -4.94 given at [1, 2], -2.47 by differences"
    assert str(report).endswith(text)


def test_a_forgotten_velocity_tangent_and_values_that_are_not_finite_are_found():
    report = pm.InternalForce(lambda t, u, v, q: (u, np.array([1.0, np.nan]))).check([1.0, 2.0])
    assert report.error == np.inf and report.column == 1
    report = pm.InternalForce(lambda t, u, v, q: (u + 0.1 * v, 1.0)).check(0.5)
    assert (report.matrix, report.given) == ("C_t", 0.0)
    assert report.error == pytest.approx(1.0, rel=1e-8)
    fixed = pm.InternalForce(lambda t, u, v, q: (u + 0.1 * v, 1.0, 0.1)).check(0.0, 0.5, 2.0)
    assert fixed.error < 1e-8


@pytest.mark.parametrize("force", [drag, lambda t, u, v, q: (u**3, 3.0 * u**2)])
def test_a_tangent_that_is_zero_where_differences_are_only_small_passes(force):
    assert pm.InternalForce(force).check(np.zeros(2)).error == 0.0


def test_the_check_is_at_the_given_time_and_history():
    seen = []

    def law(t, u, v, q):
        seen.append((t, q.tolist()))
        return friction(t, u, v, q)

    force = pm.InternalForce(law, history=[0.25])
    assert force.check(0.255).error < 1e-8 and set(map(str, seen)) == {"(0.0, [0.25])"}
    seen.clear()
    assert force.check(2.0, 0.255, q=[0.0]).error == 0.0  # it slides
    assert set(map(str, seen)) == {"(2.0, [0.0])"}


@pytest.mark.parametrize(
    "arguments, error, text",
    [
        (dict(u=[1.0]), ValueError, r"u must have shape \(2,\), got \(1,\)"),
        (dict(u=[]), ValueError, r"u must have shape \(2,\), got \(0,\)"),
        (dict(u=[1.0, np.inf]), ValueError, "u must be finite"),
        (dict(v=[1.0]), ValueError, r"v must have shape \(2,\)"),
        (dict(t="now"), TypeError, "t must be a real number"),
        (dict(q=[1.0]), ValueError, r"q must have shape \(0,\)"),
        (dict(step=0.0), ValueError, "step must be positive"),
    ],
)
def test_bad_arguments_of_the_check_are_errors(arguments, error, text):
    force = pm.InternalForce(chain, pattern=chain_matrix(2))
    with pytest.raises(error, match=text):
        force.check(**{"u": [0.1, 0.2], **arguments})
    with pytest.raises(TypeError, match="evaluate at t = 0: its value must be the tuple"):
        pm.InternalForce(lambda t, u, v, q: u).check(1.0)  # as in a run


# ---- internal= of a subdomain ---------------------------------------------------------------


def test_every_kind_and_lists_of_them_are_accepted():
    force, spring, element = pm.InternalForce(cubic), pm.CubicSpring([0], 1.0, 1.0), Element(2)
    assert checked_internal(None, 2) is None
    assert checked_internal(force, 2) == Internal((), (force,), ("internal",))
    assert checked_internal(spring, 2) == Internal((spring,), ())
    wrapped = checked_internal(cubic, 2).forces[0]
    assert wrapped.evaluate is cubic and wrapped.history.size == 0 and wrapped.pattern is None
    mixed = checked_internal([force, spring, cubic, element, compiled()], 2)
    assert mixed.springs == (spring,) and len(mixed.forces) == 4
    assert mixed.forces[0] is force and mixed.forces[2].evaluate is element
    assert checked_internal((spring, force), 2) == Internal((spring,), (force,), ("internal[1]",))
    assert subdomain(internal=[force, spring]).internal == Internal(
        (spring,), (force,), ("internal[0]",)
    )


def test_an_element_gives_its_history_pattern_and_methods():
    element = Element(3)
    element.history = [1.0, 2.0]
    force = checked_internal(element, 3).forces[0]
    assert force.history.tolist() == [1.0, 2.0] and force.pattern.nnz == 7
    assert force.potential([0.0, 1.0, 1.0]) == 0.75
    assert force.residual(0.0, np.array([0.0, 1.0, 1.0]), None, None).tolist() == [-2.0, 2.0, 0.0]


def test_a_callable_with_a_history_of_another_kind_is_only_a_callable():
    class Logged:
        def __init__(self):
            self.history = ["a log of calls"]

        __call__ = staticmethod(cubic)

    assert checked_internal(Logged(), 2).forces[0].history.size == 0


@pytest.mark.parametrize(
    "arguments, error, text",
    [
        (dict(internal=3.0), TypeError, "internal must be callable, an InternalForce, springs, or"),
        (dict(internal=[cubic, None]), TypeError, r"internal\[1\] must be callable.* got None"),
        (dict(internal=[[cubic]]), TypeError, r"internal\[0\] must be callable"),
        (dict(internal=Element(3)), ValueError, r"a pattern of shape \(2, 2\), got \(3, 3\)"),
        (dict(internal=pm.Gap([2], 1.0, 0.1)), ValueError, r"dofs of a Gap must lie in 0..1"),
        (
            dict(internal=[cubic, pm.Gap([0], 1.0, 0.1)], restoring=pm.Gap([0], 1.0, 0.1)),
            ValueError,
            "springs must be either in restoring, .*, or in internal, .*, got some in both",
        ),
        (dict(internal=cubic, restoring_stiffness=[1.0, 1.0]), ValueError, "with a restoring"),
        (dict(K=None, internal=[]), TypeError, "K must be .* no restoring force and no"),
    ],
)
def test_bad_internal_forces_of_a_subdomain_are_errors(arguments, error, text):
    with pytest.raises(error, match=text):
        subdomain(**arguments)


def test_implicit_subdomains_with_internal_forces_iterate_and_need_no_stiffness():
    assert subdomain(internal=cubic).iterates
    assert subdomain(internal=pm.CubicSpring([0], 1.0, 1.0)).iterates
    assert not subdomain(internal=cubic, scheme=EXPLICIT).iterates
    assert not subdomain(restoring=lambda t, u, v: u).iterates
    s = subdomain(K=None, internal=cubic)
    assert s.K is None and len(s.internal.forces) == 1
    assert subdomain().internal is None
    assert subdomain(internal=()).internal is None  # as of a structure without nonlinear elements


def test_springs_are_found_in_either_and_estimated_among_the_restoring_ones_only():
    spring = pm.CubicSpring([0], 5.0, 1.0)
    inside, outside = subdomain(internal=[spring, cubic]), subdomain(restoring=spring)
    assert inside.springs == outside.springs == (spring,)
    assert inside.restoring_springs == () and outside.restoring_springs == (spring,)
    assert inside.restoring_stiffness is None and inside.tangent.tolist() == [1.0, 1.0]
    assert inside.largest_tangent.tolist() == [1.0, 1.0]
    assert outside.largest_tangent.tolist() == [6.0, 1.0]
    both = subdomain(restoring=lambda t, u, v: u, internal=spring)
    assert both.springs == (spring,) and both.restoring_springs == ()


# ---- the first tangents ---------------------------------------------------------------------


FORMATS = ("csr", "csc", "coo", "bsr", "lil", "dok", "dia")
OTHERS = [np.asarray, np.float32, lambda K: K.tolist(), sp.csr_matrix]


@pytest.mark.parametrize(
    "convert", [*OTHERS, *(lambda K, x=x: sp.csr_array(K).asformat(x) for x in FORMATS)]
)
def test_every_format_has_the_same_values(convert):
    K = np.array([[2.0, -1.0, 0.0], [-1.0, 3.0, -2.0], [0.0, -2.0, 4.0]])
    adapter, first, C = at_start(lambda t, u, v, q: (K @ u, convert(K)), 3)
    np.testing.assert_array_equal(first, K)
    assert C is None
    for scale in (1.0, 2.0):  # the second and third evaluation, with known places
        K = scale * K
        f, values, C, q1 = adapter(0.1, np.ones(3), np.zeros(3), NONE, True)
        np.testing.assert_array_equal(dense(adapter.pattern, values), K)
        np.testing.assert_array_equal(f, K @ np.ones(3))
        assert C is None and q1.shape == (0,)
        for x in (f, values):
            assert x.dtype == np.float64 and x.flags.c_contiguous


def test_the_pattern_is_the_symmetric_union_with_the_diagonal():
    one = pm.InternalForce(
        lambda t, u, v, q: (0.0 * u, None), pattern=sp.coo_array(([1.0], ([0], [2])), shape=(4, 4))
    )

    def two(t, u, v, q):  # stored zeros count
        return 0.0 * u, None, sp.coo_array(([0.0, 0.0], ([1, 3], [3, 1])), shape=(4, 4))

    adapter, K, C = at_start([one, two], 4)
    expected = np.eye(4)
    expected[0, 2] = expected[2, 0] = expected[1, 3] = expected[3, 1] = 1.0
    np.testing.assert_array_equal(adapter.pattern.toarray(), expected)
    assert adapter.pattern.has_sorted_indices and not K.any() and not C.any()


def test_a_dense_tangent_has_all_entries_and_zeros_may_fill_later():
    at_rest = np.eye(3)
    adapter, _, _ = at_start(lambda t, u, v, q: (u, at_rest + np.outer(u, u)), 3)
    u = np.array([1.0, 2.0, 3.0])
    values = adapter(0.0, u, u, NONE, True)[1]
    np.testing.assert_array_equal(dense(adapter.pattern, values), at_rest + np.outer(u, u))


@pytest.mark.parametrize("symbol", ["K_t", "C_t"])
def test_the_first_tangents_must_be_symmetric(symbol):
    def law(t, u, v, q):
        A = np.array([[2.0, skewed], [1.0, 2.0]])
        return (u, A) if symbol == "K_t" else (u, None, A)

    skewed = 1.0 + 1e-10  # rounding of an assembly
    at_start(law, 2)
    skewed = 1.0 + 1e-8
    where = "at t = 0 must be symmetric .*at .0, 1. and .* at .1, 0."
    text = f"{symbol} of internal of subdomain 'rig' {where}"
    with pytest.raises(ValueError, match=text):
        at_start(law, 2, name="rig")


@pytest.mark.parametrize(
    "value, text",
    [
        (([np.nan, 0.0], None), "f of internal of subdomain 'x' at t = 0 must be finite"),
        (([0.0, 0.0], [1.0, np.inf]), "stored entries of K_t of internal of subdomain 'x' at t"),
        (([0.0, 0.0], None, [np.nan, 1.0]), "stored entries of C_t of internal"),
    ],
)
def test_the_first_values_must_be_finite(value, text):
    with pytest.raises(ValueError, match=text):
        at_start(lambda t, u, v, q: value, 2)


@pytest.mark.parametrize("call", [at_start, lambda force, n: pm.InternalForce(force).check(F)])
def test_a_damaged_first_tangent_is_an_error(call):
    with pytest.raises(ValueError, match="at t = 0: K_t must have arrays that fit: indices"):
        call(lambda t, u, v, q: (u, BROKEN), 2)


def test_the_first_tangents_are_evaluated_once_at_the_initial_values():
    calls = []

    def law(t, u, v, q):
        calls.append((u.tolist(), v.tolist(), t, q.tolist()))
        return u, None, None, q

    at_start(pm.InternalForce(law, history=[5.0]), 1, [1.0], [2.0])
    assert calls == [([1.0], [2.0], 0.0, [5.0])]


# ---- evaluation -----------------------------------------------------------------------------


def test_forces_tangents_and_histories_are_summed_and_joined():
    plastic = [pm.InternalForce(friction, history=[a, b]) for a, b in ((0.0, 0.1), (0.2, 0.3))]
    adapter, _, _ = at_start([plastic[0], drag, plastic[1], chain], 2)
    assert adapter.history.tolist() == [0.0, 0.1, 0.2, 0.3]
    # dof 0 slides in the first element, dof 1 in the second
    u, v, q = np.array([0.15, 0.105]), np.array([1.0, -2.0]), np.array([0.1, 0.1, 0.145, 0.2])
    f, K, C, q1 = adapter(0.3, u, v, q, True)
    d = -0.045
    spring, slope = d + d**3, 1.0 + 3.0 * d**2
    # 1e-13: differences of 0.1 times 100, then sums
    np.testing.assert_allclose(f, [1.0 + 0.5 + 1.0 - spring, 0.5 - 1.0 - 4.0 + spring], rtol=1e-13)
    np.testing.assert_allclose(q1, [0.14, 0.1, 0.145, 0.115], rtol=1e-13)
    expected = np.diag([100.0, 100.0]) + slope * np.array([[1.0, -1.0], [-1.0, 1.0]])
    np.testing.assert_allclose(dense(adapter.pattern, K), expected, rtol=1e-13)
    np.testing.assert_array_equal(dense(adapter.pattern, C), np.diag([2.0, 4.0]))


def random_law(rng, n):
    """A law whose symmetric sparse tangents have random values, zeros and formats each time."""
    shape = rng.random((n, n)) < 0.3
    shape |= shape.T

    def law(t, u, v, q):
        tangents = []
        for part in (shape, np.eye(n, dtype=bool)):
            A = np.where(part, rng.integers(-3, 4, (n, n)), 0)
            A = np.triu(A) + np.triu(A, 1).T
            given = sp.csr_array((A[np.nonzero(part)], np.nonzero(part)), shape=(n, n))
            kinds = FORMATS[:4] if t == 0.0 else FORMATS  # the others have no stored zeros
            tangents.append((A, given.asformat(rng.choice(kinds))))
        dense_sums.append([A for A, _ in tangents])
        return u, tangents[0][1], tangents[1][1]

    dense_sums = []
    return law, dense_sums


@pytest.mark.parametrize("seed", range(10))
def test_random_tangents_are_summed_like_dense_matrices(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    laws, sums = zip(*(random_law(rng, n) for _ in range(rng.integers(1, 4))))
    adapter, *first = at_start(list(laws), n)
    for k in range(6):
        made = first
        if k:
            f, K, C, _ = adapter(1.0, np.ones(n), np.zeros(n), NONE, True)
            made = [dense(adapter.pattern, K), dense(adapter.pattern, C)]
        for symbol in range(2):  # whole numbers: sums are exact
            np.testing.assert_array_equal(made[symbol], sum(x[k][symbol] for x in sums))


def test_without_tangents_none_are_returned_and_residual_is_used():
    element = Element(3)
    adapter, _, _ = at_start(element, 3)
    u = np.array([0.1, 0.5, 0.2])
    element.calls.clear()
    with_tangents = adapter(0.0, u, u, NONE, True)
    f, K, C, q1 = adapter(0.0, u, u, NONE, False)
    assert element.calls == ["all", "residual"] and K is None and C is None
    np.testing.assert_array_equal(f, with_tangents[0])
    plain, _, _ = at_start(chain, 3)
    assert plain(0.0, u, u, NONE, False)[1] is None
    element.residual = lambda t, u, v, q: 100.0 * u + 10.0 * v + t
    f = adapter(5.0, np.arange(1.0, 4.0), np.arange(4.0, 7.0), NONE, False)[0]
    assert f.tolist() == [145.0, 255.0, 365.0]


def test_a_force_with_a_history_is_evaluated_whole_since_q1_is_needed():
    class Plastic:
        history, pattern = [0.0], None
        __call__ = staticmethod(friction)

        def residual(self, t, u, v, q):
            raise AssertionError("q1 would be missing")

    adapter, _, _ = at_start(Plastic(), 1)
    f, K, C, q1 = adapter(0.0, np.array([0.5]), np.zeros(1), np.zeros(1), False)
    assert f.tolist() == [1.0] and K is None and q1.tolist() == [0.49]


def test_the_user_receives_copies_and_may_keep_or_change_them():
    def spoiler(t, u, v, q):
        f = u + q
        u[:], v[:], q[:] = np.nan, np.nan, np.nan
        return f, np.ones(2), None, np.ones(2)

    forces = [pm.InternalForce(spoiler, history=[0.0, 0.0]) for _ in range(2)]
    adapter, _, _ = at_start(forces, 2)
    u, v, q = np.array([1.0, 2.0]), np.array([3.0, 4.0]), np.arange(4.0)
    u.setflags(write=False)  # as views of the core may be
    f = adapter(0.0, u, v, q, True)[0]
    assert f.tolist() == [4.0, 8.0]  # 2 u + q[:2] + q[2:]
    assert v.tolist() == [3.0, 4.0] and q.tolist() == [0.0, 1.0, 2.0, 3.0]


def test_an_array_that_the_user_fills_again_and_again_is_copied():
    K, out = chain_matrix(3), np.zeros(3)

    def law(t, u, v, q):
        out[:] = K @ u
        K.data[:] = K.data * 2.0
        return out, K

    adapter, _, _ = at_start(law, 3)
    first = adapter(0.0, np.ones(3), np.ones(3), NONE, True)
    kept = [first[0].copy(), first[1].copy()]
    second = adapter(0.0, np.ones(3), np.ones(3), NONE, True)
    np.testing.assert_array_equal(first[0], kept[0])
    np.testing.assert_array_equal(first[1], kept[1])
    np.testing.assert_array_equal(second[1], 2.0 * kept[1])


def test_values_that_are_not_finite_pass_to_the_core():
    value = (np.zeros(2), np.ones(2), np.ones(2))
    adapter, _, _ = at_start(lambda t, u, v, q: value, 2)
    value = (np.array([np.nan, 0.0]), np.array([np.inf, 1.0]), np.array([np.nan, 1.0]))
    f, K, C, _ = adapter(0.0, np.zeros(2), np.zeros(2), NONE, True)
    assert np.isnan(f[0]) and np.isinf(K[0]) and np.isnan(C[0])


def test_index_arrays_that_change_in_place_are_noticed():
    A = sp.csr_array(([1.0, 2.0], [0, 1], [0, 1, 2]), shape=(2, 2))
    pattern = sp.csr_array(np.ones((2, 2)))
    adapter, _, _ = at_start(pm.InternalForce(lambda t, u, v, q: (u, A), pattern=pattern), 2)
    one_each = [0, 1, 2]
    cases = ([0, 1], one_each), ([1, 0], one_each), ([1, 0], [0, 2, 2]), ([0, 1], one_each)
    for indices, indptr in cases:
        A.indices[:], A.indptr[:] = indices, indptr
        values = adapter(0.0, np.zeros(2), np.zeros(2), NONE, True)[1]
        np.testing.assert_array_equal(dense(adapter.pattern, values), A.toarray())


def test_unsorted_and_repeated_entries_are_summed():
    A = sp.csr_array(([1.0, 2.0, 4.0, 8.0], [1, 0, 1, 1], [0, 3, 4]), shape=(2, 2))
    pattern = sp.csr_array(np.ones((2, 2)))
    adapter, first, _ = at_start(
        pm.InternalForce(lambda t, u, v, q: (u, A + A.T if t == 0.0 else A), pattern=pattern), 2
    )
    for _ in range(2):
        values = adapter(1.0, np.zeros(2), np.zeros(2), NONE, True)[1]
        np.testing.assert_array_equal(dense(adapter.pattern, values), [[2.0, 5.0], [0.0, 8.0]])


def test_tangents_may_change_their_format_within_the_pattern():
    K = chain_matrix(3)
    forms = [K, K.toarray(), K.diagonal(), None, K.tocoo(), K]
    number = iter(range(6))
    adapter, first, _ = at_start(lambda t, u, v, q: (u, forms[next(number)]), 3)
    results = [adapter(0.0, np.zeros(3), np.zeros(3), NONE, True)[1] for _ in range(5)]
    whole, part = K.toarray(), np.diag(K.diagonal())
    for values, expected in zip(results, [whole, part, 0.0 * part, whole, whole]):
        np.testing.assert_array_equal(dense(adapter.pattern, values), expected)


OUTSIDE = r"must be within the pattern of the first tangents, or of InternalForce\(pattern=\), got"


@pytest.mark.parametrize(
    "later",
    [
        np.array([[1.0, 0.0], [7.0, 1.0]]),
        sp.csr_array([[1.0, 0.0], [7.0, 1.0]]),
        sp.coo_array([[1.0, 0.0], [7.0, 1.0]]),
    ],
    ids=["dense", "csr", "coo"],
)
@pytest.mark.parametrize("symbol", ["K_t", "C_t"])
def test_entries_outside_the_pattern_are_named(later, symbol):
    def law(t, u, v, q):
        A = np.ones(2) if t == 0.0 else later
        return (u, A, np.ones(2)) if symbol == "K_t" else (u, np.ones(2), A)

    adapter, _, _ = at_start(law, 2, name="rig")
    text = rf"internal of subdomain 'rig' at t = 0.25: {symbol} {OUTSIDE} 7 at \[1, 0\]"
    with pytest.raises(ValueError, match=text):
        adapter(0.25, np.zeros(2), np.zeros(2), NONE, True)
    # it can be given in advance
    pattern = sp.csr_array(np.ones((2, 2)))
    adapter, _, _ = at_start(pm.InternalForce(law, pattern=pattern), 2)
    adapter(0.25, np.zeros(2), np.zeros(2), NONE, True)


def test_the_first_tangent_must_be_within_a_given_pattern():
    force = pm.InternalForce(chain, pattern=sp.eye_array(3))
    with pytest.raises(ValueError, match=rf"at t = 0: K_t {OUTSIDE} -1 at \[0, 1\]"):
        at_start(force, 3)


def test_stored_zeros_outside_the_pattern_are_no_error():
    A = sp.csr_array(([1.0, 0.0, 2.0], [0, 1, 1], [0, 2, 3]), shape=(2, 2))
    adapter, _, _ = at_start(lambda t, u, v, q: (u, np.ones(2) if t == 0.0 else A), 2)
    for _ in range(2):
        values = adapter(1.0, np.zeros(2), np.zeros(2), NONE, True)[1]
        assert values.tolist() == [1.0, 2.0]
    A.data[1] = 3.0  # the same index arrays
    with pytest.raises(ValueError, match=OUTSIDE):
        adapter(1.0, np.zeros(2), np.zeros(2), NONE, True)


# ---- bad values -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "value, error, text",
    [
        (F, TypeError, r"must be the tuple \(f, K_t\), .*, got ndarray"),
        ([F, F], TypeError, "got list"),
        (None, TypeError, "got NoneType"),
        ((F,), TypeError, "got 1 values"),
        ((F, F, F, F, F), TypeError, "got 5 values"),
        ((np.zeros(3), F), ValueError, r"f must have shape \(2,\), got \(3,\)"),
        ((0.0, F), ValueError, r"f must have shape \(2,\), got \(\)"),
        ((F + 0j, F), TypeError, "f must hold real numbers, got dtype complex128"),
        ((np.array([None, 1.0]), F), TypeError, "f must hold real numbers, got dtype object"),
        (([[1.0], [1.0, 2.0]], F), ValueError, "f must be a regular array"),
        ((F, np.zeros(3)), ValueError, r"K_t must have shape \(2,\) or \(2, 2\), got \(3,\)"),
        ((F, np.zeros((2, 3))), ValueError, r"K_t must have shape .* got \(2, 3\)"),
        ((F, 1.0), ValueError, r"K_t must have shape .* got \(\)"),
        ((F, sp.eye_array(3)), ValueError, r"K_t must have shape \(2, 2\), got \(3, 3\)"),
        ((F, F + 1j), TypeError, "K_t must hold real numbers"),
        ((F, sp.eye_array(2, dtype=complex)), TypeError, "K_t must hold real numbers"),
        ((F, BROKEN), ValueError, "K_t must have arrays that fit: indices .*, in a damaged csr"),
        ((F, "K"), TypeError, "K_t must hold real numbers"),
        ((F, F, np.zeros(3)), ValueError, "C_t must have shape"),
        ((F, F, None, [1.0]), ValueError, r"q1 must have shape \(0,\), got \(1,\)"),
    ],
)
def test_wrong_values_name_the_subdomain_the_time_and_the_rule(value, error, text):
    right = (F, np.ones(2), np.ones(2))
    adapter, _, _ = at_start(lambda t, u, v, q: right if t == 0.0 else value, 2, name="rig")
    with pytest.raises(error, match=rf"internal of subdomain 'rig' at t = 0.5: .*{text}"):
        adapter(0.5, np.zeros(2), np.zeros(2), NONE, True)


@pytest.mark.parametrize(
    "q1, error, text",
    [
        ((), ValueError, r"q1 must be returned where there is a history, of shape \(1,\)"),
        ((None,), ValueError, "q1 must be returned where there is a history"),
        (([1.0, 2.0],), ValueError, r"q1 must have shape \(1,\), got \(2,\)"),
        (([1j],), TypeError, "q1 must hold real numbers"),
    ],
)
def test_wrong_histories_are_errors(q1, error, text):
    def law(t, u, v, q):
        return (F, F, None, q) if t == 0.0 else (F, F, None, *q1)

    adapter, _, _ = at_start(pm.InternalForce(law, history=[0.0]), 2)
    for wanted in (True, False):
        with pytest.raises(error, match=f"internal of subdomain 'x' at t = 0.5: {text}"):
            adapter(0.5, F, F, np.zeros(1), wanted)


def test_a_velocity_tangent_that_appears_later_is_an_error():
    adapter, _, _ = at_start(lambda t, u, v, q: (u, u, u if t else None), 2)
    text = "internal of subdomain 'x' at t = 1: C_t must be returned at t = 0 too"
    with pytest.raises(ValueError, match=text):
        adapter(1.0, F, F, NONE, True)


def test_of_several_forces_the_wrong_one_is_named():
    adapter, _, _ = at_start([chain, lambda t, u, v, q: (u, None) if t == 0.0 else u], 2)
    with pytest.raises(TypeError, match="internal\\[1\\] of subdomain 'x' at t = 1: its value"):
        adapter(1.0, F, F, NONE, True)


def test_a_wrong_residual_is_named():
    element = Element(2)
    element.residual = lambda t, u, v, q: np.zeros(3)
    adapter, _, _ = at_start(element, 2)
    with pytest.raises(ValueError, match=r"'x' at t = 1: residual must have shape \(2,\)"):
        adapter(1.0, F, F, NONE, False)


def test_an_exception_of_the_user_is_not_changed():
    def fails(t, u, v, q):
        raise failure

    failure = ValueError("the material is at its end")
    with pytest.raises(ValueError) as caught:
        at_start(fails, 2)
    assert caught.value is failure


# ---- Newton and ConvergenceError ------------------------------------------------------------


def test_newton_has_its_defaults_and_converts():
    assert vars(pm.Newton()) == dict(tol=1e-8, iterations=40, tangent="full")
    newton = pm.Newton(np.float32(0.5), np.int64(3), "reuse")
    assert vars(newton) == dict(tol=0.5, iterations=3, tangent="reuse")
    assert type(newton.tol) is float and type(newton.iterations) is int
    assert pm.Newton() == pm.Newton(1e-8) and hash(pm.Newton()) == hash(pm.Newton(1e-8))
    assert pickle.loads(pickle.dumps(newton)) == newton
    for name in ("tol", "iterations", "tangent", "tolerance"):
        with pytest.raises(AttributeError):
            setattr(newton, name, 1)


@pytest.mark.parametrize(
    "arguments, error, text",
    [
        (dict(tol=0.0), ValueError, "tol must be above 0 and below 1, got 0.0"),
        (dict(tol=1), ValueError, "tol must be above 0 and below 1, got 1"),
        (dict(tol=-1e-8), ValueError, "tol must be above 0"),
        (dict(tol=np.nan), ValueError, "tol must"),
        (dict(tol="1e-8"), TypeError, "tol must be a real number"),
        (dict(iterations=0), ValueError, "iterations must be at least 1, got 0"),
        (dict(iterations=4.5), TypeError, "iterations must be a whole number"),
        (dict(iterations=True), TypeError, "iterations must be a whole number"),
        (dict(tangent="stale"), ValueError, "tangent must be 'full' or 'reuse', got 'stale'"),
        (dict(tangent=None), ValueError, "tangent must be 'full' or 'reuse'"),
    ],
)
def test_bad_arguments_of_newton_are_errors(arguments, error, text):
    with pytest.raises(error, match=text):
        pm.Newton(**arguments)


def test_a_convergence_error_says_what_where_and_what_to_do():
    error = pm.ConvergenceError("rig", 0.25, 40)
    assert isinstance(error, pm.PmalphaError)
    assert (error.subdomain, error.time, error.iterations, error.cause) == ("rig", 0.25, 40, "")
    assert str(error) == (
        "Newton's method for subdomain 'rig' did not converge in 40 iterations at t = 0.25; "
        "InternalForce.check compares the tangents with differences of f, and smaller steps "
        "converge faster"
    )
    caused = pm.ConvergenceError("interface", 0.5, 1, "a value is not finite")
    text = "end of the macro step to t = 0.5 did not converge in 1 pass: a value is not finite;"
    assert text in str(caused)
    for one in (error, caused):
        other = pickle.loads(pickle.dumps(one))
        assert str(other) == str(one) and vars(other) == vars(one)
        assert type(other) is pm.ConvergenceError
