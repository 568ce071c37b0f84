"""Mistakes that are easily made, refused by a message that says what is meant instead."""

import functools
import warnings

import numpy as np
import pytest

import pmalpha as pm
from pmalpha import rig, structures

RECORD = pm.readers.Record(np.sin(0.1 * np.arange(200)), 0.02)


def mass(**arguments):
    return pm.Subdomain([1.0], [1.0], **({"scheme": pm.Newmark()} | arguments))


# ---- the order of arguments ------------------------------------------------------------------


class Controller:
    def __call__(self, u, v, t):
        return 0.0 * u


@pytest.mark.parametrize(
    ("argument", "function", "expected", "found"),
    [
        ("force", lambda u, v, t: u, "t, u, v", "u, v, t"),
        ("force", Controller(), "t, u, v", "u, v, t"),
        ("force", lambda x, y, time: x, "t, u, v", "x, y, time"),
        ("restoring", lambda u, v, t: u, "t, u, v", "u, v, t"),
        ("restoring", lambda x, rate, t=0.0, k=2.0: k * x, "t, u, v", "x, rate, t, k"),
        ("restoring", lambda t, v, u: u, "t, u, v", "t, v, u"),
        ("restoring", functools.partial(lambda k, u, v, t: u, 2.0), "t, u, v", "u, v, t"),
        ("internal", lambda u, v, t, q: (u, 1.0), "t, u, v, q", "u, v, t, q"),
        ("internal", lambda t, u, q, v: (u, 1.0), "t, u, v, q", "t, u, q, v"),
    ],
)
def test_a_time_that_is_not_the_first_argument_is_a_type_error(argument, function, expected, found):
    message = f"{argument} must be a function of {expected} in this order, got one of {found}:"
    with pytest.raises(TypeError, match=message):
        mass(**{argument: function})


@pytest.mark.parametrize(
    ("call", "rule"),
    [
        (
            lambda: rig.Compensated(lambda u, v, t: u, 0.01),
            "specimen must be a function of t, u, v",
        ),
        (lambda: rig.serve(lambda u, v, t: u), "what must be a function of t, u, v"),
        (
            lambda: pm.Elements([[0]], None, None, internal=lambda u, v, t, q, elements: (u, u)),
            "internal must be a function of t, u, v, q, elements",
        ),
        (lambda: pm.InternalForce(Late()), "residual of internal must be a function of t, u, v, q"),
    ],
)
def test_all_functions_of_the_user_have_the_time_first(call, rule):
    with pytest.raises(TypeError, match=f"{rule} in this order"):
        call()


class Late:
    def __call__(self, t, u, v, q):
        return u, np.eye(u.size)

    def residual(self, u, v, t, q):
        return u


def test_the_tangents_are_checked_at_a_time_which_is_the_first_argument():
    growing = pm.InternalForce(lambda t, u, v, q: (t * u + v, t, 1.0))
    assert growing.check(3.0, [0.5], [2.0]).error < 1e-8
    report = pm.InternalForce(lambda t, u, v, q: (t * u, t * t)).check(3.0, 0.5)
    np.testing.assert_allclose([report.given, report.difference], [9.0, 3.0], rtol=1e-8)
    assert pm.InternalForce(lambda t, u, v, q: (u + t, 1.0)).check(0.5).error < 1e-8  # t = 0
    with pytest.raises(TypeError, match="t must be a real number"):
        growing.check([0.5], [2.0])


def test_an_element_force_that_is_called_with_the_time_last_is_a_type_error():
    (force,) = structures.truss([[0, 0], [2, 0]], [[0, 1]], EA=1.0, rhoA=1.0).internal
    u = np.array([0.0, 0.0, 0.1, 0.0])
    np.testing.assert_array_equal(force(0.0, u)[0], force.residual(u))
    for call in (force, force.residual):
        with pytest.raises(TypeError, match="t must be a number, the first argument"):
            call(u, 0.0 * u, 0.0)


def test_a_damping_matrix_by_position_is_a_type_error_that_names_it():
    M, C, K = [1.0], [0.1], [4.0]
    with pytest.raises(TypeError, match="C must be given by name, C=.*only M and K"):
        pm.Subdomain(M, C, K, scheme=pm.Newmark())
    with pytest.raises(TypeError, match="C must be given by name, C=.*only dofs, M and K"):
        pm.Elements([[0]], [[1.0]], [[[1.0]]], [[[0.1]]])
    with pytest.raises(TypeError, match="C must be given by name, C=.*only basis, M and K"):
        pm.Elements.from_skfem(None, None, None, None)
    assert pm.Subdomain(M, K, C=C, scheme=pm.Newmark()).C.tolist() == C


def test_a_wrapper_that_changes_the_order_has_its_own_order():
    def force(u, v, t):
        return u

    @functools.wraps(force)
    def restoring(t, u, v):
        return force(u, v, t)

    assert mass(restoring=restoring).restoring is restoring
    with pytest.raises(TypeError, match="got one of u, v, t"):
        mass(restoring=force)


@pytest.mark.parametrize("function", [lambda x, w, s: x, np.add, lambda *motion: motion[0]])
def test_other_names_and_functions_without_names_are_in_the_order_of_the_user(function):
    assert mass(restoring=function).restoring is function


# ---- ground motions --------------------------------------------------------------------------


def tied(force_a, force_b, M_b=1.0):
    a = mass(name="a", force=force_a)
    b = pm.Subdomain([M_b], [1.0], scheme=pm.GeneralizedAlpha(0.5), name="b", force=force_b)
    return pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.01, coupling="gc")


def test_a_ground_motion_of_one_of_two_tied_masses_is_a_warning_that_names_the_other():
    quake = pm.BaseAcceleration(RECORD)
    with pytest.warns(pm.ConstraintWarning, match="'b' has none, tied to 'a', which has one"):
        tied(quake, None)
    with pytest.warns(pm.ConstraintWarning, match="'a' has none, tied to 'b'"):
        tied([1.0], [quake, [1.0]])


def test_a_ground_motion_of_all_that_have_mass_is_no_warning():
    quake = pm.BaseAcceleration(RECORD)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tied(quake, quake)  # one object is the load of both, each with its own mass
        tied(quake, None, M_b=0.0)
        tied(None, None)


def portal(**options):
    points = np.array([[0.0, 0.0], [0.0, 3.0], [5.0, 3.0], [5.0, 0.0]])
    return structures.beam_frame(points, [[0, 1], [1, 2], [2, 3]], EA=1e6, EI=1e3, rhoA=2.0)


def test_a_ground_motion_of_a_mesh_without_direction_is_refused_and_says_what_to_give():
    frame = portal()
    fixed = frame.dofs([0, 3])
    message = "must be given where dofs are of several components, ux, uy, rz: 'ux', a dict"
    for load in (pm.BaseAcceleration(RECORD), [np.ones(frame.n), pm.BaseAcceleration(RECORD)]):
        with pytest.raises(ValueError, match=message):
            frame.subdomain(scheme=pm.Newmark(), fixed=fixed, force=load)
    held = pm.reduce(frame.M, frame.K, fixed=fixed, dof_names=frame.dof_names)
    arguments = dict(scheme=pm.Newmark(), dof_names=held.dof_names, name="portal")
    for load in (pm.BaseAcceleration(RECORD), pm.BaseAcceleration(RECORD, M=held.M)):
        with pytest.raises(ValueError, match="several components"):
            pm.Subdomain(held.M, held.K, force=load, **arguments)
    with pytest.raises(ValueError, match="several components"):
        pm.cut(
            frame, [0, 0, 1], fixed=fixed, scheme=pm.Newmark(), force=pm.BaseAcceleration(RECORD)
        )
    coupler = pm.Coupler([pm.Subdomain(held.M, held.K, **arguments)], dt=0.01)
    with pytest.raises(ValueError, match="several components"):
        coupler.run_each([{"force": {"portal": pm.BaseAcceleration(RECORD)}}], 0.1)
    # one component, and names of the user's own
    bar = structures.rod(2, 1.0, EA=1.0, rhoA=1.0)
    ones = bar.subdomain(scheme=pm.Newmark(), force=pm.BaseAcceleration(RECORD)).force.direction
    assert ones.tolist() == [[1.0]] * 3
    own = pm.Subdomain([1.0, 1.0], [1.0, 1.0], scheme=pm.Newmark(), dof_names=["floor", "roof"],
                       force=pm.BaseAcceleration(RECORD))  # fmt: skip
    assert own.force.direction.tolist() == [[1.0]] * 2


@pytest.mark.parametrize("along", ["ux", "uy", {"ux": 1.0, "uy": 0.4}])
def test_a_component_is_a_direction_of_all_nodes_supports_included(along):
    frame = portal()
    fixed = frame.dofs([0, 3])
    factors = {along: 1.0} if isinstance(along, str) else along
    direction = np.array([factors.get(name.split()[0], 0.0) for name in frame.dof_names])
    np.testing.assert_array_equal(frame.direction(along), direction)
    held = pm.reduce(frame.M, frame.K, fixed=fixed)
    load = frame.subdomain(
        scheme=pm.Newmark(), fixed=fixed, force=pm.BaseAcceleration(RECORD, along)
    )
    expected = -(frame.M @ direction)[held.free]  # M is consistent: the supports' share acts too
    np.testing.assert_allclose(load.force.shape[:, 0], expected, rtol=1e-13, atol=1e-13)
    assert abs(expected + held.M @ direction[held.free]).max() > 1e-3
    one, other = (
        pm.cut(frame, [0, 0, 1], fixed=fixed, force=pm.BaseAcceleration(RECORD, x))
        for x in (direction, along)
    )
    for a, b in zip(one.subdomains, other.subdomains):
        np.testing.assert_array_equal(a.force.shape, b.force.shape)


def test_a_record_of_several_series_has_a_component_for_each():
    frame = portal()
    both = pm.BaseAcceleration(np.ones((5, 2)), ["ux", {"uy": 0.5}], dt=0.1)
    s = frame.subdomain(scheme=pm.Newmark(), force=both)
    expected = [frame.direction("ux"), 0.5 * frame.direction("uy")]
    np.testing.assert_array_equal(s.force.direction.T, expected)


@pytest.mark.parametrize(
    ("direction", "error", "message"),
    [
        ("uz", ValueError, "must be a component of the dofs, ux, uy, rz, got 'uz'"),
        ({"ux": 1.0, "x": 1.0}, ValueError, "got 'x'"),
        ({}, ValueError, "must have a component of ux, uy, rz, got none"),
        ({"ux": np.nan}, ValueError, r"\['ux'\] must be finite"),
        (["ux", 1.0], TypeError, "components for all series of the record, or numbers"),
        (["ux", "uy"], ValueError, "a column for each of the 1 series of record, got 2"),
    ],
)
def test_a_direction_that_is_no_component_is_refused_by_name(direction, error, message):
    with pytest.raises(error, match=message):
        portal().subdomain(scheme=pm.Newmark(), force=pm.BaseAcceleration(RECORD, direction))


def test_a_component_needs_the_names_of_the_dofs_and_their_mass():
    with pytest.raises(ValueError, match="a number for each dof, where dofs have no names"):
        mass(force=pm.BaseAcceleration(RECORD, "ux"))
    with pytest.raises(ValueError, match="M must be left out where direction is a component"):
        pm.BaseAcceleration(RECORD, "ux", [1.0])


# ---- functions of the user -------------------------------------------------------------------


def held_rod(force):
    rod = structures.rod(3, 1.0, EA=1.0, rhoA=1.0)
    return rod, rod.subdomain(scheme=pm.Newmark(), fixed=["ux 0"], force=force, name="rod")


@pytest.mark.parametrize("size", [4, 3])
def test_a_function_of_time_has_all_dofs_of_a_structure_or_the_free_ones(size):
    values = np.array([7.0, 1.0, -2.0, 3.0])[-size:]
    _, s = held_rod(lambda t: np.cos(t) * values)
    _, constant = held_rod(pm.SampledForce(np.outer(np.cos(0.01 * np.arange(60)), values), 0.01))
    one, other = (pm.Coupler([x], dt=0.01).run(0.5)["rod"].u for x in (s, constant))
    np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-15)


def test_a_function_of_the_motion_sees_that_of_all_dofs_of_a_structure():
    seen = []

    def controller(t, u, v):
        seen.append((u, v))
        return -2.0 * v if t < 0.3 else -2.0 * v[1:]

    _, s = held_rod(controller)
    rod, damped = held_rod(None)
    damped = rod.subdomain(
        scheme=pm.Newmark(),
        fixed=["ux 0"],
        restoring=lambda t, u, v: 2.0 * v,
        v0=[1.0, 0, 0],
        name="rod",
    )
    s = rod.subdomain(
        scheme=pm.Newmark(), fixed=["ux 0"], force=controller, v0=[1.0, 0, 0], name="rod"
    )
    one, other = (pm.Coupler([x], dt=0.01).run(0.5)["rod"].u for x in (s, damped))
    np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-15)
    assert (
        all(u.shape == v.shape == (4,) and u[0] == v[0] == 0.0 for u, v in seen) and len(seen) > 50
    )
    with pytest.raises(TypeError, match="force must be a function of t, u, v in this order"):
        held_rod(lambda u, v, t: u)


def failing(*arguments):
    if arguments[0] > 0.05:
        raise ZeroDivisionError("of the user")
    u = arguments[1] if len(arguments) > 1 else np.zeros(1)
    return (u, np.eye(1)) if len(arguments) == 4 else 0.0 * u


@pytest.mark.parametrize(
    ("argument", "function"),
    [
        ("force", lambda t: failing(t)),
        ("force", lambda t, u, v: failing(t, u, v)),
        ("restoring", lambda t, u, v: failing(t, u, v)),
        ("internal", lambda t, u, v, q: failing(t, u, v, q)),
        ("velocity", lambda t: failing(t)),
    ],
)
def test_an_exception_in_a_function_of_the_user_has_a_note_of_argument_subdomain_and_time(
    argument, function
):
    arguments = {} if argument == "velocity" else {argument: function}
    s = mass(name="tower", **arguments)
    moved = [pm.Constraint({s: [[1.0]]}, velocity=function)] if argument == "velocity" else []
    with pytest.raises(ZeroDivisionError, match="of the user") as caught:
        pm.Coupler([s], moved, dt=0.01).run(0.1)
    (note,) = caught.value.__notes__
    assert note.startswith(f"in {argument}") and note.endswith("at t = 0.06")
    assert ("'tower'" in note) == (argument != "velocity")


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (
            lambda: mass(force=[None, [1.0]]),
            TypeError,
            r"force\[0\] must be a load or a number, got N",
        ),
        (
            lambda: mass(force=[1.0, None]),
            TypeError,
            r"force\[1\] must be a load or a number, got N",
        ),
        (lambda: mass(force=[]), ValueError, "force must be a load, .*got an empty list"),
        (
            lambda: pm.Constraint({mass(name="a"): [[1.0]]}, velocity=[]),
            ValueError,
            "velocity must be a velocity, got an empty list",
        ),
        (
            lambda: pm.Coupler([mass(name="a")], dt=0.1).run(
                steps=1, outputs={"a": {"absolute a": [1.0]}}
            ),
            ValueError,
            r"must have names of outputs, got 'absolute a', a quantity: \{'roof'",
        ),
    ],
)
def test_what_is_no_load_and_no_output_is_refused_by_name(call, error, message):
    with pytest.raises(error, match=message):
        call()


# ---- delays ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "device", [rig.Compensated, lambda f, tau, **o: rig.SimulatedActuator(f, delay=tau, **o)]
)
def test_a_delay_of_more_than_100_substeps_is_refused_unless_it_is_said(device):
    def coupler(delay, **options):
        specimen = device(lambda t, u, v: u, delay, **options)
        return pm.Coupler([mass(restoring=specimen, substeps=2)], dt=0.02)

    message = "at most max_steps = 100 substeps of 0.01, got 8, 800 substeps; it is in the unit"
    with pytest.raises(ValueError, match=message):
        coupler(8.0)
    coupler(1.0)  # 100 substeps
    with pytest.raises(ValueError, match="got 1.001"):
        coupler(1.001)
    assert coupler(8.0, max_steps=800).dt == 0.02


def test_a_delay_behind_another_device_is_looked_at_too():
    late = rig.SimulatedActuator(pm.CubicSpring([0], k=1.0, k3=0.0), delay=8.0)
    with pytest.raises(ValueError, match="delay of SimulatedActuator"):
        pm.Coupler([mass(restoring=rig.Compensated(late, 0.01))], dt=0.01)


def test_the_halved_steps_of_an_error_estimate_may_have_delays_of_more_substeps():
    late = rig.SimulatedActuator(pm.CubicSpring([0], k=1.0, k3=0.0), delay=0.9)
    coupler = pm.Coupler([mass(restoring=rig.Compensated(late, 0.8), u0=1.0)], dt=0.01)
    assert coupler.estimate_error(steps=4, halvings=1).dt == 0.01


# ---- memory of internal forces ---------------------------------------------------------------


def plastic(u, q):
    f = np.clip(100.0 * (u - q), -1.0, 1.0)
    return f, np.where(np.abs(f) < 1.0, 100.0, 0.0), None, u - f / 100.0


def test_an_internal_force_that_remembers_outside_of_q_is_an_error_that_explains_q():
    slip = np.zeros(1)

    def remembering(t, u, v, q):
        f, K, _, slip[:] = plastic(u, slip.copy())
        return f, K

    message = r"function of t, u, v and q alone.*InternalForce\(evaluate, history=...\)"
    with pytest.raises(ValueError, match=message):
        pm.Coupler([mass(internal=remembering, v0=10.0)], dt=0.01).run(0.1)


@pytest.mark.parametrize("scheme", [pm.Newmark(), pm.CentralDifference()])
def test_an_internal_force_with_a_history_is_evaluated_once_more_in_a_run(scheme):
    calls = []

    def force(t, u, v, q):
        calls.append((u[0], v[0], t, q[0]))
        return plastic(u, q)

    with_history = pm.InternalForce(force, history=[0.0])
    coupler = pm.Coupler([mass(internal=with_history, v0=1.0, scheme=scheme)], dt=0.01)
    calls.clear()
    coupler.run(0.1)
    # the arguments of the first evaluation come once more, right after the first other ones
    other = next(i for i, x in enumerate(calls) if x != calls[0])
    assert calls[other + 1] == calls[0]
    assert calls[0] not in calls[other + 2 :]


# ---- files and cases -------------------------------------------------------------------------


def test_a_file_of_run_each_is_continued_by_a_run_of_its_case_alone(tmp_path):
    pytest.importorskip("h5py")
    path, u0 = tmp_path / "case.h5", {"m": [2.0]}
    coupler = pm.Coupler([mass(name="m")], dt=0.01)
    coupler.run_each([{"u0": u0}], 0.1, record_to=[path])
    stiffer = pm.Coupler([pm.Subdomain([1.0], [2.0], scheme=pm.Newmark(), name="m")], dt=0.01)
    for other in (stiffer, coupler):
        other.reset(u0=u0)
        other.step(10)
    with pytest.raises(ValueError, match="same problem, but these differ: K of 'm'"):
        stiffer.run(0.2, record_to=path, append=True)
    whole = coupler.run(0.2, record_to=path, append=True)
    coupler.reset(u0=u0)
    np.testing.assert_array_equal(whole["m"].u, coupler.run(0.2)["m"].u)


def test_a_file_is_not_continued_by_a_run_of_another_problem(tmp_path):
    pytest.importorskip("h5py")
    path = tmp_path / "run.h5"
    pm.Coupler([mass(name="m")], dt=0.01).run(0.1, record_to=path)
    stiffer = pm.Coupler([pm.Subdomain([1.0], [2.0], scheme=pm.Newmark(), name="m")], dt=0.01)
    stiffer.step(10)  # at rest, as the other one
    with pytest.raises(ValueError, match="same problem, but these differ: K of 'm'"):
        stiffer.run(0.2, record_to=path, append=True)
    pushed = pm.Coupler([mass(name="m", force=pm.SampledForce([0.0, 1.0], 9.0))], dt=0.01)
    pushed.reset(force={"m": [0.0]})
    pushed.step(10)
    with pytest.raises(ValueError, match="these differ: force of 'm'"):
        pushed.run(0.2, record_to=path, append=True)
    same = pm.Coupler([mass(name="m")], dt=0.01)
    with pytest.raises(ValueError, match="load the checkpoint of that run first"):
        same.run(0.2, record_to=path, append=True)
    same.step(10)
    assert same.run(0.2, record_to=path, append=True).macro_times.size == 21


def test_a_file_without_a_description_of_its_problem_is_continued(tmp_path, monkeypatch):
    """As older versions have written them."""
    pytest.importorskip("h5py")
    path = tmp_path / "run.h5"
    coupler = pm.Coupler([mass(name="m")], dt=0.01)
    with monkeypatch.context() as patch:
        patch.setattr("pmalpha.run.recorded_run.problem_of", lambda session: None)
        coupler.run(0.1, record_to=path)
    assert coupler.run(0.2, record_to=path, append=True).macro_times.size == 21


def test_a_generator_of_cases_that_was_read_already_is_an_error():
    coupler = pm.Coupler([mass(name="m")], dt=0.01)
    cases = ({"u0": {"m": [x]}} for x in (1.0, 2.0))
    assert len(coupler.run_each(cases, 0.1)) == 2
    with pytest.raises(ValueError, match="at least one case, got none.*a generator is read once"):
        coupler.run_each(cases, 0.1)


# ---- messages --------------------------------------------------------------------------------

TABLE = np.column_stack([0.01 * np.arange(200), RECORD.values])
POINTS = [[0.0, 0.0, 3.0], [1.0, 0.0, 3.0], [0.0, 1.0, 3.0]]


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: pm.BaseAcceleration(TABLE), TypeError, "first column is time.*from_times"),
        (
            lambda: mass(force=pm.BaseAcceleration(TABLE, dt=0.01)),
            ValueError,
            "first column is time.*from_times",
        ),
        (
            lambda: pm.tie(mass(name="tower"), 0, mass(name="tower"), 0),
            ValueError,
            "a and b must have different names, both are named 'tower'",
        ),
        (
            lambda: pm.solve([mass()], 0.01, 1.0),
            TypeError,
            "subdomain must be one Subdomain, not a list of them; several are for Coupler",
        ),
        (lambda: mass(substeps=5.0), TypeError, "whole number, got 5.0, a float: give the int 5"),
        (lambda: mass(substeps=5.5), TypeError, "whole number, got 5.5$"),
        (
            lambda: pm.Coupler([mass()], dt=0.1).run(steps=10.0),
            TypeError,
            "steps must be a whole number, got 10.0, a float: give the int 10",
        ),
        (
            lambda: pm.tie(mass(), 0.0, mass(), 0),
            TypeError,
            "dofs_a must be a 1-D array of whole numbers, got 0.0, a float: give the int 0",
        ),
        (
            lambda: pm.tie(mass(), 0, mass(), np.array([0.0, 1.0])),
            TypeError,
            r"array\(\[0., 1.\]\), floats: give ints",
        ),
        (
            lambda: pm.Parameters("a", dofs=-1, K=[[1.0]]),
            ValueError,
            r"dofs must be an \(e, k\) array, a row for each element, got shape \(\)",
        ),
        (
            lambda: structures.plate_on(POINTS, [[0, 1, 2]], E=1.0, nu=0.3, rho=1.0),
            ValueError,
            r"points must have shape \(points, 2\), .*; all have z = 3: give points\[:, :2\]",
        ),
    ],
)
def test_the_message_says_what_is_meant_instead(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_what_was_not_recorded_says_which_call_records_it():
    history = pm.Coupler([mass()], dt=0.01).run(0.1)
    for one in (history, history.resampled([0.0, 0.05])):
        with pytest.raises(AttributeError, match=r"has no 'kinetic': .*energy=True"):
            _ = one.energy.kinetic
    with pytest.raises(AttributeError, match=r"has no 'missed': Coupler.run_paced"):
        _ = history.pacing.missed
    assert not history.energy and not history.pacing
    assert repr(history.energy) == "<no energy: Coupler.run(..., energy=True) records it>"
