"""Compiled functions as restoring force and force: ctypes, cffi, numba, capsules as of Cython.

Each does the same operations in the same order as its Python twin, so results are equal in bits.
"""

import ctypes
import gc
import weakref

import compiled
import numpy as np
import pytest
from compiled import FORCE, RESTORING
from pairwise import in_turn
from scipy import LowLevelCallable

import pmalpha as pm

N = 3
CENTRAL = pm.CentralDifference()


def python_restoring(t, u, v):
    return 0.5 * u * u * u + 0.25 * v + 0.125 * t


def python_force(t):
    return np.array([0.5, 1.0, 1.5]) * t


def restore_ctypes(t, n, u, v, r, user):
    for k in range(n):
        r[k] = 0.5 * u[k] * u[k] * u[k] + 0.25 * v[k] + 0.125 * t
    return 0


def force_ctypes(t, n, f, user):
    for k in range(n):
        f[k] = 0.5 * (k + 1) * t
    return 0


def by_ctypes():
    return LowLevelCallable(RESTORING(restore_ctypes)), LowLevelCallable(FORCE(force_ctypes))


def capsule(function, signature):
    """A capsule as Cython puts it into __pyx_capi__: the signature as name, the address inside."""
    new, pointer = ctypes.pythonapi.PyCapsule_New, ctypes.c_void_p
    new.restype, new.argtypes = ctypes.py_object, [pointer, ctypes.c_char_p, pointer]
    made = new(ctypes.cast(function, ctypes.c_void_p), signature, None)
    KEPT.append((function, signature, made))  # a capsule owns neither
    return LowLevelCallable(made)


KEPT = []


def by_capsule():
    signature = b"int (double, Py_ssize_t, double *, double *, double *, void *)"
    restoring = capsule(RESTORING(restore_ctypes), signature)
    return restoring, capsule(FORCE(force_ctypes), b"int (double, npy_intp, double *, void *)")


def by_cffi():
    return compiled.by_cffi(restore_ctypes, 3), compiled.by_cffi(force_ctypes, 1, "int64_t")


def by_numba():
    return compiled.by_numba(restore_ctypes, 3), compiled.by_numba(force_ctypes, 1)


def coupled(restoring, force, threads=1):
    """Two parts, an implicit double-step and an explicit one, with the same functions on both."""
    K = np.array([[3.0, -1.0, 0.0], [-1.0, 3.0, -1.0], [0.0, -1.0, 1.0]])
    common = dict(restoring=restoring, force=force, u0=[0.3, -0.2, 0.4])
    a = pm.Subdomain([1.0, 2.0, 1.5], K, scheme=pm.GeneralizedAlpha(0.6), name="a", **common)
    fast = pm.GeneralizedAlpha(0.6, explicit=True)
    b = pm.Subdomain([1.0, 2.0, 1.5], K, scheme=fast, substeps=4, name="b", **common)
    return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.1, threads=threads, coupling="pm")


@pytest.mark.parametrize(
    ("make", "threads"), in_turn([by_ctypes, by_capsule, by_cffi, by_numba, by_ctypes], 1, 2)
)
def test_a_compiled_function_gives_the_bits_of_its_python_twin(make, threads):
    expected = coupled(python_restoring, python_force).run(steps=20)
    history = coupled(*make(), threads=threads).run(steps=20)
    for name in "ab":
        np.testing.assert_array_equal(history[name].u, expected[name].u)
        np.testing.assert_array_equal(history[name].a, expected[name].a)
    np.testing.assert_array_equal(history.multipliers, expected.multipliers)


def test_it_is_evaluated_at_the_start_and_once_a_substep_in_order():
    times, loads = [], []

    def restoring(t, n, u, v, r, user):
        times.append(t)
        return 0

    def force(t, n, f, user):
        loads.append(t)
        return 0

    how = dict(
        restoring=LowLevelCallable(RESTORING(restoring)), force=LowLevelCallable(FORCE(force))
    )
    part = pm.Subdomain([1.0], [1.0], scheme=pm.CentralDifference(), substeps=3, **how)
    coupler = pm.Coupler([part], dt=0.3)
    assert times == loads == []  # not before it must be
    coupler.run(steps=2)
    coupler.step(2)
    np.testing.assert_array_equal(times, np.arange(13) / 3 * 0.3)  # (T1)
    assert loads == times


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_a_force_of_a_double_step_subdomain_is_evaluated_in_its_turn_and_not_ahead(threads):
    times = []

    def force(t, n, f, user):
        times.append(t)
        f[0] = t
        return 0

    half, fast = pm.GeneralizedAlpha(0.5), pm.GeneralizedAlpha(0.5, explicit=True)
    load = LowLevelCallable(FORCE(force))
    a = pm.Subdomain([1.0], [1.0], scheme=half, substeps=2, force=load, name="a")
    b, c = (pm.Subdomain([1.0], [1.0], scheme=fast, substeps=6, name=name) for name in "bc")
    ties = [pm.tie(a, [0], b, [0]), pm.tie(b, [0], c, [0])]
    coupler = pm.Coupler([a, b, c], ties, dt=0.3, threads=threads, coupling="pm")
    for steps in (1, 4, 7):  # in each call up to its end
        coupler.step(steps - coupler.step_count)
        assert times == [k / 2 * 0.3 for k in range(2 * steps + 1)]  # (T1)


def test_forces_arrive_zeroed():
    def restoring(t, n, u, v, r, user):
        return 0 if all(r[k] == 0.0 for k in range(n)) and not fill(r, n) else 9

    def force(t, n, f, user):
        return 0 if all(f[k] == 0.0 for k in range(n)) and not fill(f, n) else 9

    def fill(x, n):
        for k in range(n):
            x[k] = 1.0

    coupled(LowLevelCallable(RESTORING(restoring)), LowLevelCallable(FORCE(force))).step(3)


@pytest.mark.parametrize(("what", "code"), [("force", 3), ("restoring force", -7)])
def test_a_code_stops_the_run_at_a_macro_step_and_reaches_the_caller(what, code):
    calls = []

    def fails_once():
        calls.append(1)
        return code if len(calls) == 10 else 0

    def restoring(t, n, u, v, r, user):
        return restore_ctypes(t, n, u, v, r, user) or fails_once()

    def force(t, n, f, user):
        return force_ctypes(t, n, f, user) or fails_once()

    functions = list(by_ctypes())
    if what == "force":
        functions[1] = LowLevelCallable(FORCE(force))
    else:
        functions[0] = LowLevelCallable(RESTORING(restoring))
    coupler = coupled(*functions)
    with pytest.raises(pm.CallbackError, match=f"the {what} of subdomain 'b' returned {code}") as e:
        coupler.run(steps=10)
    error = e.value
    assert (error.code, error.what, error.subdomain, error.step) == (code, what, "b", 1)
    assert coupler.step_count == 1 and coupler.last_history["a"].u.shape == (2, N)
    coupler.step(9)
    expected = coupled(*by_ctypes())
    expected.step(10)
    np.testing.assert_array_equal(coupler.state("b").a, expected.state("b").a)


@pytest.mark.parametrize("what", ["force", "restoring force"])
def test_a_code_at_the_start_reaches_the_caller(what):
    functions = [None, LowLevelCallable(FORCE(lambda t, n, f, user: 5))]
    if what != "force":
        functions = [LowLevelCallable(RESTORING(lambda *_: 5)), None]
    coupler = coupled(*functions)
    with pytest.raises(pm.CallbackError, match=f"the {what} of subdomain 'a' returned 5 in macro"):
        coupler.run(steps=1)


def test_user_data_is_handed_over_and_kept_alive():
    class Stiffness(ctypes.Structure):
        _fields_ = [("k", ctypes.c_double)]

    def restoring(t, n, u, v, r, user):
        k = ctypes.cast(user, ctypes.POINTER(Stiffness)).contents.k
        for i in range(n):
            r[i] = k * u[i]
        return 0

    def make():
        data = Stiffness(7.0)
        user = ctypes.cast(ctypes.pointer(data), ctypes.c_void_p)
        function = LowLevelCallable(RESTORING(restoring), user)
        part = pm.Subdomain([1.0], None, scheme=CENTRAL, restoring=function, u0=[1.0])
        return pm.Coupler([part], dt=0.1), weakref.ref(data)

    coupler, data = make()
    gc.collect(1)
    coupler.step(5)
    assert data() is not None
    linear = pm.Subdomain([1.0], [7.0], scheme=CENTRAL, u0=[1.0])
    expected = pm.Coupler([linear], dt=0.1)
    expected.step(5)
    np.testing.assert_array_equal(coupler.state(0).u, expected.state(0).u)


def test_nan_from_a_compiled_function_is_an_instability():
    def restoring(t, n, u, v, r, user):
        r[0] = np.nan if t > 0.25 else 0.0
        return 0

    coupler = coupled(LowLevelCallable(RESTORING(restoring)), None)
    with pytest.raises(pm.InstabilityError):
        coupler.run(steps=10)
    assert coupler.step_count == 2


GOOD = ["long", "long int", "ssize_t", "Py_ssize_t", "intptr_t", "ptrdiff_t", "npy_intp"]
GOOD += ["int64_t", "long long", "npy_int64"]


@pytest.mark.parametrize("size", GOOD)
def test_all_spellings_of_a_size_are_accepted(size):
    signature = f"int (double, {size}, double *, void *)".encode()
    force = capsule(FORCE(force_ctypes), signature)
    part = pm.Subdomain(np.ones(N), np.ones(N), scheme=pm.Newmark(), force=force)
    pm.solve(part, dt=0.1, t_end=0.1)


OTHERS = [f"int (double, {size}, double *, void *)" for size in ("int", "size_t", "unsigned long")]
OTHERS += ["void (double, long, double *, void *)", "int (long, double, double *, void *)"]
OTHERS += ["int (double, long, float *, void *)", "int (double, long, double *)"]
OTHERS += ["int (double, long, double *, double *, double *, void *)", "double (double)", ""]


@pytest.mark.parametrize("signature", OTHERS)
def test_another_signature_is_refused_with_the_one_wanted(signature):
    function = capsule(FORCE(force_ctypes), signature.encode())
    with pytest.raises(ValueError, match="force must have the signature 'int .double, intptr_t"):
        pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), force=function)


def test_a_force_in_the_place_of_a_restoring_force_is_refused():
    with pytest.raises(ValueError, match="restoring must have the signature"):
        pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), restoring=by_ctypes()[1])


def test_a_prescribed_velocity_must_not_be_compiled():
    a = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark())
    with pytest.raises(TypeError, match="velocity must not be a LowLevelCallable"):
        pm.Constraint({a: [[1.0]]}, velocity=by_ctypes()[1])


def test_reset_can_bring_another_compiled_force():
    coupler = coupled(python_restoring, None)
    coupler.step(3)
    coupler.reset(force={"a": by_ctypes()[1], "b": by_ctypes()[1]})
    coupler.step(3)
    expected = coupled(python_restoring, python_force)
    expected.step(3)
    np.testing.assert_array_equal(coupler.state("a").u, expected.state("a").u)
    s = pm.Subdomain(np.ones(N), np.ones(N), scheme=CENTRAL, force=by_ctypes()[1], name="s")
    np.testing.assert_array_equal(pm.Coupler([s], dt=0.1).static()["s"], 0.0)  # F(0) is zero


def test_a_checkpoint_says_that_a_function_is_compiled(tmp_path):
    coupler = coupled(*by_ctypes())
    coupler.step(3)
    coupler.save(tmp_path / "state")
    again = coupled(*by_ctypes())
    again.load(tmp_path / "state")
    for c in (coupler, again):
        c.step(4)
    np.testing.assert_array_equal(again.state("b").a, coupler.state("b").a)
    with pytest.raises(ValueError, match="restoring of 'a' .a compiled function in the file"):
        coupled(python_restoring, by_ctypes()[1]).load(tmp_path / "state")


def test_the_work_of_a_compiled_force_is_that_of_its_python_twin():
    expected, coupler = coupled(python_restoring, python_force), coupled(*by_ctypes())
    for c in (expected, coupler):
        c.step(3)
    ours, theirs = (c.run(steps=5, energy=True).energy for c in (coupler, expected))
    np.testing.assert_array_equal(ours.external, theirs.external)
    np.testing.assert_array_equal(ours.dissipated, theirs.dissipated)
