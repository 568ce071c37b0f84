"""Springs, callables and compiled functions in one list: their sum as a restoring force."""

import ctypes
import warnings

import numpy as np
import pytest
from agreement import assert_close
from compiled import RESTORING
from scipy import LowLevelCallable

import pmalpha as pm
from pmalpha import analysis

K = np.array([[6.0, -2.0, 0.0], [-2.0, 5.0, -1.0], [0.0, -1.0, 3.0]])
CUBIC = pm.CubicSpring([0, 0], k=[2.0, 1.0], k3=[4.0, 3.0])


def compiled(function):
    return LowLevelCallable(RESTORING(function))


def drag(t, u, v):
    return 0.3 * v * np.abs(v)


def pull(t, u, v):
    return np.array([0.0, 0.5 * np.sin(3.0 * t), 0.7 * u[2] ** 3])


@compiled
def compiled_softening(t, n, u, v, r, user):
    for i in range(n):
        r[i] = 0.5 * u[i] / (1.0 + u[i] * u[i])
    return 0


@compiled
def compiled_dashpot(t, n, u, v, r, user):
    r[1] = 0.2 * v[1]
    return 0


MIXED = [compiled_softening, drag, CUBIC, pull, compiled_dashpot]


def whole(t, u, v):
    """The sum of `MIXED`, written once more."""
    r = drag(t, u, v) + pull(t, u, v) + 0.5 * u / (1.0 + u * u)
    r[0] += 3.0 * u[0] + 7.0 * u[0] ** 3
    r[1] += 0.2 * v[1]
    return r


def coupled(restoring, coupling="pm", threads=1, **options):
    """A coarse implicit subdomain and a fine explicit one, both with this restoring force."""
    options = {"restoring": restoring, "restoring_stiffness": [3.0, 0.5, 0.5], **options}
    if restoring is None:
        options = {}
    elif restoring is CUBIC or restoring == [CUBIC]:
        options["restoring_stiffness"] = None  # it brings its own
    a = pm.Subdomain(
        [1.0, 2.0, 1.5],
        K,
        scheme=pm.GeneralizedAlpha(0.6),
        u0=[0.6, -0.4, 0.5],
        name="a",
        **options,
    )
    b = pm.Subdomain(
        [1.0, 2.0, 1.5],
        K,
        scheme=pm.GeneralizedAlpha(0.6, explicit=True),
        substeps=3,
        u0=[0.6, -0.4, 0.5],
        name="b",
        **options,
    )
    return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.06, coupling=coupling, threads=threads)


def run(restoring, coupling, threads=1, steps=100, **options):
    with warnings.catch_warnings():
        if coupling == "macro":  # warns of a restoring force with substeps
            warnings.simplefilter("ignore", pm.StabilityWarning)
        return coupled(restoring, coupling, threads, **options).run(steps=steps)


# ---- the sum -----------------------------------------------------------------------------------


@pytest.mark.parametrize("coupling", ["pm", "gc", "macro"])
def test_a_mixed_list_moves_the_structure_like_one_function_of_the_sum(coupling):
    for x, y in zip(run(MIXED, coupling, steps=1), run(whole, coupling, steps=1)):
        assert_close(x.a, y.a, 1e-13, f"acceleration of {x.name!r} under the list", times=y.t)
    mixed, one = run(MIXED, coupling), run(whole, coupling)
    linear = run(None, coupling)
    for name in "ab":
        # the same sum in another order: rounding, which 300 damped steps do not enlarge by 1000
        what = f"displacement of {name!r} under the list"
        assert_close(mixed[name].u, one[name].u, 1e-13, what, times=one[name].t)
        assert np.abs(mixed[name].u - linear[name].u).max() > 0.1


def test_compiled_functions_alone_are_summed_too_in_any_thread():
    def sum_of_both(t, u, v):
        r = 0.5 * u / (1.0 + u * u)
        r[1] += 0.2 * v[1]
        return r

    expected = run(sum_of_both, "gc")
    for threads in (1, 2):
        history = run([compiled_softening, compiled_dashpot], "gc", threads)
        for name in "ab":  # the same operations in the same order
            np.testing.assert_array_equal(history[name].u, expected[name].u)


def test_callables_are_summed_in_the_order_of_the_list():
    # 1 + 1e16 - 1e16 depends on the order: 0 or 1
    def constant(value):
        return lambda t, u, v: np.array([value])

    for values, expected in (((1.0, 1e16, -1e16), 0.0), ((1e16, -1e16, 1.0), 1.0)):
        part = pm.Subdomain(
            [1.0], None, scheme=pm.CentralDifference(), restoring=[constant(x) for x in values]
        )
        state = pm.Coupler([part], dt=0.1)
        state.step(1)
        assert state.state(0).a[0] == -expected


def test_a_function_that_is_twice_in_a_list_counts_twice():
    def half(t, u, v):
        return 0.5 * u**3

    def full(t, u, v):
        return u**3

    twice, once = run([half, half], "gc"), run(full, "gc")
    np.testing.assert_array_equal(twice["b"].u, once["b"].u)  # x / 2 + x / 2 is exact


@pytest.mark.parametrize("item", [drag, compiled_softening, CUBIC], ids=["py", "c", "spring"])
def test_a_list_of_one_is_that_one(item):
    listed, alone = run([item], "pm"), run(item, "pm")
    np.testing.assert_array_equal(listed["a"].u, alone["a"].u)
    a, b = (pm.Subdomain(np.ones(3), K, scheme=pm.Newmark(), restoring=x) for x in (item, (item,)))
    assert a.restoring == b.restoring


def test_an_empty_list_is_no_force():
    assert pm.Subdomain(np.ones(3), K, scheme=pm.Newmark(), restoring=[]).restoring is None
    with pytest.raises(TypeError, match="K must be a matrix where there is no restoring force"):
        pm.Subdomain(np.ones(3), None, scheme=pm.Newmark(), restoring=())


def test_springs_with_a_history_and_functions_do_not_disturb_each_other():
    """On dofs that nothing connects, a mixture is each force alone, bitwise."""
    isolator = pm.BoucWen([0], k=40.0, fy=1.0, hardening=0.05)
    stop = pm.Gap([(1, -1)], k=30.0, gap=0.05)

    def third(t, u, v):
        return np.array([0.0, 0.0, 4.0 * u[2] ** 3 + 0.1 * v[2]])

    def history(restoring):
        part = pm.Subdomain(
            np.ones(3),
            np.array([1.0, 8.0, 2.0]),
            scheme=pm.GeneralizedAlpha(0.7),
            restoring=restoring,
            v0=[1.0, 1.0, 1.0],
            name="part",
        )
        loops = {"part": None} if part.springs else None
        coupler = pm.Coupler([part], dt=0.02)
        return coupler.run(5.0, record_springs=loops, energy=True)

    mixed, springs = history([isolator, third, stop]), history([isolator, stop])
    function = history(third)
    np.testing.assert_array_equal(mixed["part"].u[:, :2], springs["part"].u[:, :2])
    np.testing.assert_array_equal(mixed["part"].u[:, 2], function["part"].u[:, 2])
    # the loops are those of the springs, in the order of the list, functions left out
    np.testing.assert_array_equal(mixed["part"].force, springs["part"].force)
    assert mixed["part"].force.shape[1] == 2 and np.abs(mixed["part"].force[:, 1]).max() > 0.0
    # per dof energies add; dofs 0 and 1 of `function` and dof 2 of `springs` move linearly
    linear = history(lambda t, u, v: np.zeros(3)).energy
    for x in ("strain", "dissipated"):
        parts = [getattr(e, x) for e in (springs.energy, function.energy)]
        # sums of 250 numbers below 10
        expected = parts[0] + parts[1] - getattr(linear, x)
        np.testing.assert_allclose(getattr(mixed.energy, x), expected, atol=1e-12)
    assert mixed.energy.dissipated[-1, 0] > 0.1


# ---- evaluation --------------------------------------------------------------------------------


@pytest.mark.parametrize("coupling", ["pm", "gc", "macro"])
def test_each_function_is_evaluated_once_at_the_start_and_once_per_substep(coupling):
    calls = []

    def logged(name):
        return lambda t, u, v: calls.append((name, t)) or np.zeros(3)

    def logged_compiled(name):
        return compiled(lambda t, n, u, v, r, user: calls.append((name, t)) or 0)

    items = [logged_compiled("c"), logged("p"), CUBIC, logged_compiled("d"), logged("q")]
    a = pm.Subdomain([1.0] * 3, K, scheme=pm.GeneralizedAlpha(0.6), restoring=items, name="a")
    b = pm.Subdomain([1.0] * 3, K, scheme=pm.Newmark(), substeps=4, name="b")
    coupler = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.1, coupling=coupling)
    assert not calls
    coupler.run(steps=3)
    coupler.step(2)
    # callables first, then compiled functions, each kind in the order of the list
    assert calls == [(name, n * 0.1) for n in range(6) for name in "pqcd"]  # (T1)


def test_what_a_function_writes_into_its_arguments_does_not_reach_the_next():
    def scribble(t, u, v):
        u[:], v[:] = 1e6, -1e6
        return np.zeros(3)

    @compiled
    def scribble_too(t, n, u, v, r, user):
        for i in range(n):
            u[i] = v[i] = 1e6
        return 0

    expected = run(MIXED, "pm")
    history = run([scribble_too, scribble, *MIXED], "pm")
    np.testing.assert_array_equal(history["a"].u, expected["a"].u)
    np.testing.assert_array_equal(history["b"].u, expected["b"].u)


def test_functions_may_return_the_same_array():
    shared = np.zeros(3)

    def fill(value):
        def evaluate(t, u, v):
            shared[:] = value * u
            return shared

        return evaluate

    history = run([fill(1.0), fill(2.0)], "gc")
    expected = run([lambda t, u, v: 1.0 * u, lambda t, u, v: 2.0 * u], "gc")
    np.testing.assert_array_equal(history["a"].u, expected["a"].u)


# ---- failures ----------------------------------------------------------------------------------


@pytest.mark.parametrize("threads", [1, 2])
def test_a_code_of_one_compiled_function_stops_the_run_which_can_go_on(threads):
    calls = []

    @compiled
    def fails_once(t, n, u, v, r, user):
        calls.append(t)
        return 4 if len(calls) == 9 else 0

    coupler = coupled([drag, compiled_softening, fails_once, CUBIC], threads=threads)
    with pytest.raises(
        pm.CallbackError, match="the restoring force of subdomain '[ab]' returned 4"
    ):
        coupler.step(10)
    assert 0 < coupler.step_count < 10
    coupler.step(10 - coupler.step_count)
    expected = coupled([drag, compiled_softening, CUBIC])
    expected.step(10)
    np.testing.assert_array_equal(coupler.state("b").u, expected.state("b").u)


@pytest.mark.parametrize("threads", [1, 2])
def test_an_exception_of_one_callable_reaches_the_caller(threads):
    def breaks(t, u, v):
        if t > 0.2:
            raise ArithmeticError("the actuator is at its end")
        return np.zeros(3)

    coupler = coupled([drag, breaks, compiled_softening, CUBIC], threads=threads)
    with pytest.raises(ArithmeticError, match="the actuator is at its end"):
        coupler.step(10)
    assert coupler.step_count == 3  # t = 0.18


def test_a_wrong_value_names_the_item_of_the_list():
    coupler = coupled([CUBIC, drag, lambda t, u, v: [1.0, 2.0]])
    text = r"restoring\[2\] of subdomain 'a' at t = 0: its value must have shape \(3,\), got \(2,\)"
    with pytest.raises(ValueError, match=text):
        coupler.step(1)


def refused(restoring, error, text):
    with pytest.raises(error, match=text):
        pm.Subdomain(np.ones(3), K, scheme=pm.Newmark(), restoring=restoring)


def test_bad_items_are_errors_that_name_the_item():
    refused([drag, 3.0], TypeError, r"restoring\[1\] must be a spring or callable, got 3.0")
    refused([CUBIC, [drag]], TypeError, r"restoring\[1\] must be a spring or callable, got \[<fun")
    refused([None, drag], TypeError, r"restoring\[0\] must be a spring or callable, got None")
    refused([drag, pm.Gap([3], 1.0, 0.0)], ValueError, r"dofs of a Gap must lie in 0..2, got 3")
    other = LowLevelCallable(ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(lambda x: x))
    refused([drag, other], ValueError, r"restoring\[1\] must have the signature 'int .double, intp")


# ---- stiffness ---------------------------------------------------------------------------------


def test_the_default_estimate_is_the_initial_tangent_of_the_springs_alone():
    part = pm.Subdomain(np.ones(3), K, scheme=pm.Newmark(), restoring=MIXED)
    np.testing.assert_array_equal(part.restoring_stiffness, [3.0, 0.0, 0.0])


def test_the_critical_step_counts_an_estimate_and_the_largest_tangents():
    # central difference, h = 2 / omega; the contact adds k to what is estimated for the rest
    gap = pm.Gap([0], k=5.0, gap=0.1)
    common = dict(scheme=pm.CentralDifference())

    def step(**options):
        return analysis.critical_step(pm.Subdomain([1.0], [4.0], **common, **options))

    soft = [gap, lambda t, u, v: 7.0 * u]
    assert step(restoring=soft) == pytest.approx(2.0 / np.sqrt(4.0 + 5.0), rel=1e-14)
    known = step(restoring=soft, restoring_stiffness=[7.0])
    assert known == pytest.approx(2.0 / np.sqrt(4.0 + 5.0 + 7.0), rel=1e-14)


def one_dof(restoring, **options):
    part = pm.Subdomain(
        [1.0], None, scheme=pm.Newmark(), restoring=restoring, u0=[1e-3], name="rig", **options
    )
    return pm.Coupler([part], dt=0.05)


def test_a_stiff_function_beside_springs_adds_energy():
    soft = pm.CubicSpring([0], k=1.0, k3=0.0)
    halves = [lambda t, u, v: 5e3 * u, soft, lambda t, u, v: 5e3 * u]
    coupler = one_dof(halves)
    # omega = 100 of both halves together
    with pytest.warns(pm.StabilityWarning, match="forces of subdomain 'rig' .* too stiff for it"):
        coupler.run(1.0)
    one_dof(halves, restoring_stiffness=[10001.0]).step(400)  # warnings are errors


def test_where_a_function_has_no_estimate_the_stiffness_counts_as_unknown():
    springs = pm.CubicSpring([0], k=4.0, k3=0.0)
    mixture = [springs, lambda t, u, v: 3.0 * u]
    with pytest.raises(ValueError, match="needs restoring_stiffness .* got none for 'rig'"):
        one_dof(mixture).modes(1)
    omega, _ = one_dof(mixture, restoring_stiffness=[7.0]).modes(1)
    assert omega[0] == pytest.approx(np.sqrt(7.0))
    columns = str(one_dof(mixture)).split()
    assert "-" in columns and "-" not in str(one_dof(springs)).split()


# ---- checkpoints -------------------------------------------------------------------------------


# the estimate is that of all springs, of which the gap stays open
@pytest.mark.filterwarnings("ignore:restoring_stiffness of subdomain 'a' is above")
def test_a_saved_run_with_a_mixed_list_goes_on_bitwise(tmp_path):
    items = [*MIXED, pm.BoucWen([(1, 2)], k=30.0, fy=0.2), pm.Gap([2], k=20.0, gap=0.1)]
    estimate = {"restoring_stiffness": None}
    coupler = coupled(items, **estimate)
    coupler.step(17)
    coupler.save(tmp_path / "state.npz")
    coupler.step(20)
    other = coupled(items, **estimate)
    other.load(tmp_path / "state.npz")
    other.step(20)
    for name in "ab":
        np.testing.assert_array_equal(other.state(name).u, coupler.state(name).u)
        np.testing.assert_array_equal(other.springs(name).force, coupler.springs(name).force)
    fewer = coupled(items[:-1], **estimate)
    with pytest.raises(ValueError, match="restoring of 'a' .*<Gap x 1>"):
        fewer.load(tmp_path / "state.npz")
