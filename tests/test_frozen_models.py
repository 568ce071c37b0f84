"""Frozen couplers, stepped by the C library, do what `run` does, bitwise."""

import ctypes
import os

import numpy as np
import pytest
from c_models import BAD_ARGUMENT, FAILED, LIMITED, OK, Library, Refused, words
from compiled import FORCE, RESTORING
from frozen_couplers import (
    COUPLINGS,
    SPRINGS,
    all_outputs,
    bouncing,
    chain,
    frame,
    full,
    iterated,
    plate,
    recorded,
)
from scipy import LowLevelCallable

import pmalpha as pm
import pmalpha.frozen.model
import pmalpha.run.freeze
from pmalpha import rig
from pmalpha.frozen.model import file_of

# the drift of the tie is that of both, and long steps show it
pytestmark = pytest.mark.filterwarnings("ignore:tied displacements:pmalpha.AccuracyWarning")
STEPS = 60


@pytest.fixture(scope="module")
def library():
    return Library(pm.c_library() / "libpmalpha.so")


def frozen(coupler, library, tmp_path, inputs=None, outputs=None):
    """The model of a coupler, and that of its outputs."""
    path = tmp_path / "model.pma"
    coupler.freeze(path, inputs, all_outputs(coupler) if outputs is None else outputs)
    return library.model(path)


def assert_equal_motion(model, coupler, steps=STEPS):
    """The model goes on as the coupler does, in all outputs at all fine steps."""
    fine = steps * model.substeps()
    rows = model.rows(fine)
    history = coupler.run(steps=steps)
    assert np.array_equal(rows, recorded(coupler, history, fine))
    assert np.ptp(rows[:, 0]) > 0.0
    return history


# ---- the motion --------------------------------------------------------------------------------


# mean coupling has no restoring forces
CASES = [(c, s) for c in COUPLINGS for s in SPRINGS if c != "mean" or s == "none"]


@pytest.mark.parametrize("coupling, springs", CASES)
def test_a_frozen_coupler_moves_as_a_run(library, tmp_path, coupling, springs):
    coupler = frame(coupling, springs)
    assert_equal_motion(frozen(coupler, library, tmp_path), coupler)


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_a_model_frozen_in_a_run_goes_on_as_it(library, tmp_path, coupling):
    coupler = frame(coupling, "none" if coupling == "mean" else "bilinear")
    coupler.run(0.5)
    model = frozen(coupler, library, tmp_path)
    assert model.time() == 0.5
    assert model.count() == 25 * model.substeps()
    assert_equal_motion(model, coupler)


def test_a_coupler_frozen_twice_gives_equal_bytes_and_is_not_changed(tmp_path):
    coupler, other = frame("pm", "bilinear"), frame("pm", "bilinear")
    coupler.step(3)
    other.step(3)
    outputs = all_outputs(coupler)
    coupler.freeze(tmp_path / "a.pma", outputs=outputs)
    coupler.freeze(tmp_path / "b.pma", outputs=outputs)
    assert (tmp_path / "a.pma").read_bytes() == (tmp_path / "b.pma").read_bytes()
    assert np.array_equal(coupler.run(steps=5)["a"].u, other.run(steps=5)["a"].u)


def test_steps_that_were_changed_are_frozen(library, tmp_path):
    coupler = frame("gc", "bilinear")
    coupler.step(4)
    coupler.change_steps(dt=0.01)
    coupler.step(1)
    assert_equal_motion(frozen(coupler, library, tmp_path), coupler)


def test_a_sparse_structure_in_panels_moves_as_a_run(library, tmp_path):
    n, K = 17, plate(17**2)
    u0 = np.sin(np.arange(n * n)) * 0.01
    a = pm.Subdomain(
        np.ones(n * n), K, C=0.001 * K, scheme=pm.GeneralizedAlpha(0.7), u0=u0, name="a"
    )
    b = pm.Subdomain(
        [0.5],
        [100.0],
        scheme=pm.GeneralizedAlpha(0.7, explicit=True),
        substeps=4,
        u0=u0[:1],
        name="b",
    )
    coupler = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.02, coupling="pm")
    assert_equal_motion(frozen(coupler, library, tmp_path), coupler, 20)


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("coupling", ["gc", "pm", "macro", "mean"])
def test_iterated_springs_move_as_in_a_run(library, tmp_path, coupling, substeps):
    coupler = iterated(coupling, substeps=substeps)
    model = frozen(coupler, library, tmp_path)
    assert_equal_motion(model, coupler)
    model.reset()
    model.rows(17)
    state, rest = model.state(), model.rows(20)
    assert model.restore(state.ctypes.data, state.nbytes) == OK
    assert np.array_equal(model.rows(20), rest)


@pytest.mark.parametrize("n, ties", [(40, 1), (50, 8), (120, 20)])
@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_tangents_in_panels_are_bitwise_those_of_a_run(library, tmp_path, coupling, n, ties):
    coupler = full(coupling, n, ties)
    assert_equal_motion(frozen(coupler, library, tmp_path), coupler, 10)


@pytest.mark.gate
def test_a_structure_of_narrow_panels_moves_as_in_a_run(library, tmp_path):
    coupler = iterated("gc", n=34**2)  # up to a width of 32 it would be a band
    assert_equal_motion(frozen(coupler, library, tmp_path), coupler, 5)


def test_large_tangents_are_factored_without_blas(library, tmp_path):
    coupler = full("gc", 420, 3)
    model = frozen(coupler, library, tmp_path)
    rows = model.rows(5)
    expected = recorded(coupler, coupler.run(steps=5), 5)
    # sums of products in another order than those of BLAS: 1e-16 of the terms, over 5 steps
    assert np.allclose(rows, expected, rtol=0.0, atol=1e-10 * np.max(np.abs(expected)))


def test_impulses_of_contacts_are_those_of_a_run(library, tmp_path):
    coupler = bouncing()
    coupler.step(5)
    history = assert_equal_motion(frozen(coupler, library, tmp_path), coupler)
    assert np.any(np.abs(np.diff(history["a"].v[:, 0])) > 0.3)


@pytest.mark.parametrize("average", [False, True])
@pytest.mark.parametrize("coupling", COUPLINGS)
def test_sampled_loads_go_along(library, tmp_path, coupling, average):
    samples = np.random.default_rng(1).normal(size=(150, 1))
    load = pm.SampledForce(samples, 0.007, np.array([1.0, 0.0, -2.0]), average=average)
    coupler = frame(coupling, force=[load, np.array([1.0, 2.0, 3.0])])
    assert_equal_motion(frozen(coupler, library, tmp_path), coupler)


# ---- specimens ---------------------------------------------------------------------------------


def specimen(d, v):
    return 300.0 * d + 50.0 * d**3 + 0.1 * v


def hybrid(coupling, substeps=1, limits=None, device=None, **rest):
    """The frame with a specimen at its second dof, behind a device."""

    def restoring(t, u, v):
        return np.array([0.0, specimen(u[1], v[1]), 0.0])

    return frame(
        coupling,
        restoring=restoring if device is None else device(restoring),
        substeps=substeps,
        restoring_stiffness=np.diag([0.0, 300.0, 0.0]),
        **({} if limits is None else {"limits": limits}),
        **rest,
    )


# a function acts on all dofs of its subdomain: of the others it returns zero, which is held
PORT = {f"column.d{i}": ("specimen", "a", i) for i in (1, 0, 2)}


def assert_set_forces_are_those_of_the_function(model, coupler, substeps):
    """With the force of the specimen set where a command is new."""
    fine, news = STEPS * model.substeps(), 0
    rows = [model.values]
    for _ in range(fine):
        new, (d, v, _) = model.command_of(0)
        news += new
        if new:
            model.set(0, specimen(d, v))
        assert model.advance(1) == OK
        rows.append(model.values)
    assert np.array_equal(rows, recorded(coupler, coupler.run(steps=STEPS), fine))
    assert news == STEPS * substeps


@pytest.mark.parametrize(
    "coupling, substeps, finest",
    [("gc", 1, 3), ("pm", 1, 3), ("gc", 3, 3), ("macro", 1, 3), ("gc", 2, 6)],
)
def test_forces_that_are_set_between_steps_are_those_of_a_function(
    library, tmp_path, coupling, substeps, finest
):
    coupler = hybrid(coupling, substeps, fine=finest)
    model = frozen(coupler, library, tmp_path, PORT)
    assert model.substeps() == (1 if coupling == "macro" else finest)
    assert_set_forces_are_those_of_the_function(model, coupler, substeps)


@pytest.mark.parametrize("method", ["polynomial", "inverse", "model"])
def test_an_input_behind_a_compensator_gets_its_command(library, tmp_path, method):
    one = np.eye(3)
    lag = rig.LinearActuator(-50.0 * one, 50.0 * one, one, one) if method == "model" else None

    def device(restoring):
        return rig.Compensated(restoring, 0.03, method=method, model=lag, bandwidth=10.0)

    coupler, plain = hybrid("gc", device=device), hybrid("gc")
    for one in (coupler, plain):
        one.step(1)
    model = frozen(plain, library, tmp_path, PORT)
    command = model.command_of(0)[1][0]
    model = frozen(coupler, library, tmp_path, PORT)
    assert abs(model.command_of(0)[1][0] - command) > 1e-3  # it is ahead by 30 ms
    assert_set_forces_are_those_of_the_function(model, coupler, 1)


@pytest.mark.parametrize("coupling", ["gc", "pm"])
def test_an_attached_function_is_called_with_the_command(library, tmp_path, coupling):
    coupler = hybrid(coupling)
    model = frozen(coupler, library, tmp_path, PORT)
    times = []

    def force(t, c):
        assert c == model.command_of(0)[1]
        times.append(t)
        return specimen(c[0], c[1])

    model.attach_function(0, force)
    history = assert_equal_motion(model, coupler)
    assert np.array_equal(times, history["a"].t[1:])


@pytest.mark.gate
def test_the_command_is_the_displacement_at_which_a_run_evaluates(library, tmp_path):
    commands = []

    def restoring(t, u, v):
        commands.append((u[1], v[1]))
        return np.array([0.0, specimen(u[1], v[1]), 0.0])

    coupler = frame("pm", restoring=restoring)
    coupler.step(1)
    model = frozen(coupler, library, tmp_path, PORT)
    coupler.step(1)
    assert model.command_of(0)[1][:2] == list(commands[-1])


def wind(t):
    return 5.0 * np.sin(9.0 * t)


def table(t):
    return 0.3 * np.sin(7.0 * max(0.0, t - 0.005))  # no input has a slope at the start


@pytest.mark.parametrize("samples", [False, True])
@pytest.mark.parametrize("coupling", COUPLINGS)
def test_inputs_add_to_loads_and_to_prescribed_velocities(library, tmp_path, coupling, samples):
    load = pm.SampledForce(np.cos(np.arange(90.0)), 0.013, [1.0, 2.0, 3.0])
    moved = pm.SampledForce(np.sin(np.arange(90.0)) * (np.arange(90) > 3), 0.017)

    def all_of_it(t):
        return moved(t)[0] * samples + table(t)

    given = {"force": load, "velocity": moved} if samples else {}
    if not samples:
        given = {"velocity": [0.0]}  # a row that is held
    coupler = frame(coupling, **given)
    force = [*([load] if samples else []), lambda t: np.array([0.0, 0.0, wind(t)])]
    reference = frame(coupling, force=force, velocity=all_of_it)
    model = frozen(coupler, library, tmp_path, {"wind": ("force", "a", 2), "t": ("velocity", 1)})
    fine = STEPS * model.substeps()
    assert [model.given(0), model.given(1)] == [0.0, 0.0]
    rows = [model.values]
    for k in range(fine):
        for i, f in enumerate((wind, table)):
            t = coupler.dt * ((k + model.lead(i)) / model.substeps())
            assert model.set(i, f(t)) == OK
        assert model.advance(1) == OK
        rows.append(model.values)
    assert np.array_equal(rows, recorded(reference, reference.run(steps=STEPS), fine))


@pytest.mark.gate
def test_a_velocity_may_be_an_input_on_one_row_of_a_constraint_without(library, tmp_path):
    def held_at(velocity):
        s = pm.Subdomain(np.ones(3), chain(3, 50.0), scheme=pm.Newmark(), name="s")
        return pm.Coupler([s], pm.Constraint({s: np.eye(3)[:2]}, velocity=velocity), dt=0.02)

    model = frozen(held_at(None), library, tmp_path, {"table": ("velocity", 1)})
    rows = [model.values]
    for k in range(STEPS):
        model.set(0, table(0.02 * (k + 1)))
        assert model.advance(1) == OK
        rows.append(model.values)
    reference = held_at(lambda t: np.array([0.0, table(t)]))
    assert np.array_equal(rows, recorded(reference, reference.run(steps=STEPS), STEPS))


# ---- the start ---------------------------------------------------------------------------------


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_values_at_the_start_are_in_the_initial_accelerations(library, tmp_path, coupling):
    model = frozen(frame(coupling), library, tmp_path, {"wind": ("force", "a", 2, 5.0)})
    reference = frame(coupling, force=lambda t: np.array([0.0, 0.0, 5.0 * np.cos(t)]))
    rows = [model.values]
    for k in range(STEPS * model.substeps()):
        t = reference.dt * ((k + model.lead(0)) / model.substeps())
        model.set(0, 5.0 * np.cos(t))
        assert model.advance(1) == OK
        rows.append(model.values)
    history = reference.run(steps=STEPS)
    assert np.array_equal(rows, recorded(reference, history, len(rows) - 1))


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_begin_takes_the_inputs_of_the_loop_into_the_initial_accelerations(
    library, tmp_path, coupling
):
    """As if they had been frozen, up to rounding of what they change."""
    has_specimen = coupling != "mean"
    pull = 300.0 * -0.02
    specimens = {"column": ("specimen", "a", 1)} if has_specimen else {}

    def made(force, wind):
        restoring = rig.External([1], force=force) if has_specimen else None
        inputs = specimens | {"wind": ("force", "a", 2, wind)}
        coupler = frame(coupling, "cubic" if has_specimen else "none", restoring=restoring)
        return frozen(coupler, library, tmp_path, inputs)

    model, expected = made(0.0, 0.0), made(pull, 5.0)
    before = model.rows(0)
    values = [pull, 5.0] if has_specimen else [5.0]
    for i, x in enumerate(values):
        assert model.set(i, x) == OK
    assert model.begin() == OK and model.count() == 0
    assert [model.given(i) for i in range(len(values))] == values
    rows, ours = expected.rows(20), model.rows(20)
    assert np.max(np.abs(ours[0] - before)) > 0.5
    # the sum of three terms in another order, then 60 steps
    assert np.allclose(ours, rows, rtol=0.0, atol=1e-12 * np.max(np.abs(rows)))
    assert model.begin() == BAD_ARGUMENT and "first step" in model.why
    model.reset()
    assert np.array_equal(model.rows(0), before)


@pytest.mark.gate
def test_begin_refuses_a_model_of_a_run_and_a_velocity_that_the_structure_has_not(
    library, tmp_path
):
    coupler = frame("gc", velocity=[0.0])
    model = frozen(coupler, library, tmp_path, {"table": ("velocity", 1)})
    assert model.begin() == OK
    model.set(0, 0.1)
    assert model.begin() == BAD_ARGUMENT and "velocity at the start" in model.why
    coupler.step(1)
    model = frozen(coupler, library, tmp_path, {"table": ("velocity", 1)})
    assert model.begin() == BAD_ARGUMENT and "in a run" in model.why
    with pytest.raises(ValueError, match=r"inputs\['t'\] must be 0 where a run has begun"):
        coupler.freeze(tmp_path / "x.pma", {"t": ("velocity", 1, 0.1)})
    with pytest.raises(pm.ConstraintError, match="v0 must satisfy"):
        frame("gc", velocity=[0.0]).freeze(tmp_path / "x.pma", {"t": ("velocity", 1, 0.1)})


def test_a_coupler_with_an_external_specimen_is_frozen_and_never_run(library, tmp_path):
    coupler = frame("pm", restoring=rig.External([1]))
    for call in (coupler.step, lambda: coupler.run(steps=1), lambda: coupler.run_paced(0.02)):
        with pytest.raises(ValueError, match="restoring of subdomain 'a': an External specimen"):
            call()
    with pytest.raises(ValueError, match="restoring of subdomain 'a'.*External"):
        coupler.estimate_error(steps=2)
    assert coupler.step_count == 0
    inputs = {"column": ("specimen", "a", 1, 3.0)}
    assert frozen(coupler, library, tmp_path, inputs).given(0) == 3.0
    assert coupler.state("a").a[1] == frame("pm").state("a").a[1]  # as it was


# ---- inputs of the library ---------------------------------------------------------------------


def test_what_is_no_input_or_no_number_is_refused_and_changes_nothing(library, tmp_path):
    model = frozen(hybrid("gc"), library, tmp_path, PORT | {"wind": ("force", "a", 2)})
    before = model.state()
    for i in (-1, 4, model.find_input(b"colum")):
        assert model.set(i, 1.0) == BAD_ARGUMENT and "no input" in model.why
        assert model.attach(i, None, None) == BAD_ARGUMENT and "no specimen" in model.why
        assert np.isnan(model.given(i)) and model.lead(i) == 0 and model.input_name(i) is None
        assert np.isnan(model.get(-1)) and model.command_of(i) == (0, [0.0, 0.0, 0.0])
    assert model.attach(3, None, None) == BAD_ARGUMENT  # a force
    for x in (np.nan, np.inf):
        assert model.set(0, x) == BAD_ARGUMENT and "finite" in model.why
    assert np.array_equal(model.state().view(np.int64), before.view(np.int64))
    assert model.set(0, 1.0) == OK and model.why == ""


def test_a_function_that_returns_no_number_ends_the_step(library, tmp_path):
    model = frozen(hybrid("gc"), library, tmp_path, PORT)
    model.attach_function(0, lambda t, c: np.nan)
    assert model.advance(1) == FAILED and "restoring" in model.why
    assert model.set(0, 0.0) == OK and model.why == ""
    assert model.advance(1) == FAILED and "restoring" in model.why
    assert model.save(None, 0) == BAD_ARGUMENT and model.why


@pytest.mark.gate
@pytest.mark.parametrize("coupling, leads", [("gc", [3, 5, 4]), ("pm", [3, 5, 4])])
def test_an_input_leads_by_what_is_left_of_the_substep_that_sees_it(
    library, tmp_path, coupling, leads
):
    model = frozen(frame(coupling), library, tmp_path, {"w": ("force", "a", 0)})
    found = []
    for _ in range(6):
        found.append(model.lead(0))
        model.advance(1)
    assert found == 2 * leads


def simulated(rig):
    spring = pm.CubicSpring(1, k=300.0, k3=50.0)
    actuator = rig.SimulatedActuator(spring, delay=0.02, noise=1e-5, seed=3)
    return rig.Compensated(actuator, 0.02)


def lag(rig, n=1, dofs=(1,), rate=50.0, **options):
    """Actuators that follow at a rate, and springs behind them."""
    one = np.eye(n)
    return rig.LinearActuator(-rate * one, rate * one, one, 300.0 * one, dofs=dofs, **options)


def measuring(rig, n=1, dofs=(1,)):
    options = {"delay": 0.03, "noise": 1e-4, "force_noise": 1e-3, "quantum": 1e-6, "seed": 2}
    return lag(rig, n, dofs, saturation=0.04, **options)


def inverse(rig, n=1, dofs=(1,), **options):
    model = {"method": "model", "model": lag(rig, n, dofs, rate=60.0), "bandwidth": 10.0}
    return rig.Compensated(measuring(rig, n, dofs), 0.03, **model, **options)


DEVICES = {
    "simulated actuator": simulated,
    "linear actuator": measuring,
    "held command": lambda rig: lag(rig, hold="zero"),
    "adaptive": lambda rig: rig.Compensated(measuring(rig), 0.04, method="adaptive"),
    "model": inverse,
    "feedback": lambda rig: inverse(rig, feedback=0.5),
    "least squares": lambda rig: inverse(rig, variations=0.03, sigma=1e-3),
    "matrix": lambda rig: rig.Linkage(inverse(rig, 2, (0, 2)), [[1.0, 0.2], [1.0, -0.2]]),
    "arms": lambda rig: rig.Linkage(inverse(rig, 2, (1, 2)), arms=[(0.3, 0.4), (0.3, -0.4)]),
    "all": lambda rig: rig.Linkage(
        inverse(rig, 2, (1, 2), feedback=0.5, variations=[lag(rig, 2, (1, 2))], sigma=1e-3),
        [[1.0, 0.2], [1.0, -0.2]],
    ),
}


# extrapolation from double steps makes the motion grow
BEHIND = [(d, c) for d in DEVICES for c in ("gc", "pm") if (d, c) != ("simulated actuator", "pm")]


# of rigs that are late, and of an estimate that is that of the spring alone
@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning", "ignore::pmalpha.AccuracyWarning")
@pytest.mark.parametrize("device, coupling", BEHIND)
def test_a_specimen_that_is_compiled_with_its_rig_goes_along(library, tmp_path, device, coupling):
    coupler = hybrid(coupling, device=lambda _: DEVICES[device](rig))
    coupler.step(7)
    model = frozen(coupler, library, tmp_path)
    assert_equal_motion(model, coupler)
    model.reset()
    model.rows(17)
    state, rest = model.state(), model.rows(20)
    assert model.restore(state.ctypes.data, state.nbytes) == OK
    assert np.array_equal(model.rows(20), rest)


# ---- states ------------------------------------------------------------------------------------


def driven(model, k):
    """A fine step with a force of its number, and the specimen if there is one."""
    force = np.sin(0.1 * k)
    if model.inputs() > 1:
        model.set(0, 200.0 * model.command_of(0)[1][0] + force)
    model.set(model.inputs() - 1, force)
    assert model.advance(1) == OK
    return model.values


@pytest.mark.parametrize("coupling", COUPLINGS)
@pytest.mark.parametrize("where", [30, 31, 32])
def test_a_state_goes_on_bitwise_in_the_same_and_in_another_model(
    library, tmp_path, coupling, where
):
    if coupling == "mean":
        coupler, inputs = frame(coupling), {}
    else:
        coupler, inputs = frame(coupling, "bilinear", restoring=lambda t, u, v: 0.0 * u), PORT
    where_pushed = "b" if coupling in ("gc", "pm") else "a"  # of several substeps, or of one
    model = frozen(coupler, library, tmp_path, inputs | {"push": ("force", where_pushed, 1)})
    other = library.model(tmp_path / "model.pma")
    begin = [driven(model, k) for k in range(where)]
    state, time = model.state(), model.time()
    rest = [driven(model, k) for k in range(where, 60)]
    for one in (model, other):
        assert one.restore(state.ctypes.data, state.nbytes) == OK
        assert one.time() == time
        assert one.values == begin[-1]
        assert [driven(one, k) for k in range(where, 60)] == rest
    model.reset()
    assert [driven(model, k) for k in range(60)] == begin + rest


def test_a_state_that_does_not_fit_is_refused_and_changes_nothing(library, tmp_path):
    model = frozen(frame("gc"), library, tmp_path)
    state = model.state()
    model.advance(5)
    before = model.state()
    damaged, foreign = state.copy(), frozen(frame("gc", "gap"), library, tmp_path).state()
    damaged[7] += 1.0
    for block, size in (
        (state, state.nbytes - 8),
        (damaged, state.nbytes),
        (foreign, foreign.nbytes),
    ):
        assert model.restore(block.ctypes.data, size) == BAD_ARGUMENT
        assert model.why
        assert np.array_equal(model.state().view(np.int64), before.view(np.int64))


def yielding():
    """A mass on a spring; a state: u, v, w, a, then d, f and the number of open loops."""
    spring = pm.RambergOsgood([0], 10.0, 1.0, 5.0)
    a = pm.Subdomain([1.0], [5.0], scheme=pm.Newmark(), restoring=spring, u0=[1.0], name="a")
    return pm.Coupler([a], dt=0.01)


@pytest.mark.parametrize(
    "place, number",
    [(1, 4), (1, -1), (2, -5), (2, 2**63 - 1), (2, -(2**63)), (2, 2**53)]
    + [(9, x) for x in (-1.0, 0.5, 13.0, 1e9, np.nan, -np.inf)],
)
def test_a_state_with_a_number_that_is_no_count_is_refused(library, tmp_path, place, number):
    """Fine steps since the macro step, macro steps, and open loops, with the sum made right."""
    model = frozen(yielding(), library, tmp_path)
    model.advance(5)
    state = model.state()
    before = state.copy()
    state.view(np.int64 if place < 3 else float)[place] = number
    state.view(np.uint64)[-1] = pmalpha._core.check_sum(state[:-1].view(np.uint8))
    assert model.restore(state.ctypes.data, state.nbytes) == BAD_ARGUMENT
    assert model.why == "the state is damaged"
    assert np.array_equal(model.state().view(np.int64), before.view(np.int64))
    assert model.advance(1) == OK


def test_a_state_whose_tangent_is_singular_is_refused_with_nothing_changed(library, tmp_path):
    model = frozen(iterated("gc", newton=pm.Newton(tangent="reuse")), library, tmp_path)
    model.advance(5)
    good = model.state()
    model.advance(2)
    before, reasons = model.state().view(np.int64), set()
    for k in range(3, good.size - 1):
        for number in (0.0, 1e300, np.nan):
            bad = good.copy()
            bad[k] = number
            bad.view(np.uint64)[-1] = pmalpha._core.check_sum(bad[:-1].view(np.uint8))
            if model.restore(bad.ctypes.data, bad.nbytes) == BAD_ARGUMENT:
                reasons.add(model.why)
                assert np.array_equal(model.state().view(np.int64), before)
            else:
                good_again = before.view(float)
                assert model.restore(good_again.ctypes.data, good_again.nbytes) == OK
    assert "the state is damaged: a kept tangent is singular" in reasons
    assert model.advance(1) == OK


@pytest.mark.parametrize("number", [0, 1001, 2**62])
def test_a_model_that_may_iterate_for_ever_is_refused(library, tmp_path, monkeypatch, number):
    def damaged(tree):
        tree["coupler"]["iteration"] = tree["coupler"]["iteration"]._replace(iterations=number)
        return file_of(tree)

    monkeypatch.setattr(pmalpha.run.freeze, "file_of", damaged)
    iterated("gc").freeze(tmp_path / "x.pma")
    with pytest.raises(Refused, match="iterations must be at least 1|iterations is too large"):
        library.model(tmp_path / "x.pma")


def test_a_frozen_state_with_a_number_that_is_no_count_is_refused(library, tmp_path, monkeypatch):
    def damaged(tree):
        levels = tree["subdomains"][0]["levels"]
        levels["springs"] = np.array([*levels["springs"][:2], 1e9, *levels["springs"][3:]])
        return file_of(tree)

    monkeypatch.setattr(pmalpha.run.freeze, "file_of", damaged)
    yielding().freeze(tmp_path / "x.pma")
    with pytest.raises(
        Refused, match=r"springs must have a whole number in 0..12 at 2, got 1000000000"
    ):
        library.model(tmp_path / "x.pma")


@pytest.mark.gate
def test_a_specimen_that_fails_ends_the_step_and_reset_leads_back(library, tmp_path):
    model = frozen(hybrid("pm"), library, tmp_path, PORT)
    model.attach_function(0, lambda t, c: None if t > 0.1 else specimen(c[0], c[1]))
    first = model.rows(9)
    assert model.advance(100) == FAILED
    assert "restoring" in model.why and "'a'" not in model.why and " a " in model.why
    assert model.advance(1) == FAILED
    model.reset()
    assert np.array_equal(model.rows(9), first)


def test_models_of_the_same_bytes_do_not_meet(library, tmp_path):
    coupler = frame("pm", "bilinear")
    alone = frozen(coupler, library, tmp_path).rows(60)
    content = words(tmp_path / "model.pma")
    content.flags.writeable = False
    pair = [library.model(content), library.model(content)]
    rows = [[model.values for model in pair]]
    for _ in range(60):
        for model in pair:
            assert model.advance(1) == OK
        rows.append([model.values for model in pair])
    assert np.array_equal(np.array(rows)[:, 0], alone)
    assert np.array_equal(np.array(rows)[:, 1], alone)


# ---- memory of the caller ----------------------------------------------------------------------


def aligned(size):
    """Bytes at a multiple of 64."""
    block = np.zeros(size + 64, np.uint8)
    begin = -block.ctypes.data % 64
    return block[begin : begin + size]


@pytest.mark.parametrize(
    "make",
    [
        lambda: frame("gc", "bilinear"),
        lambda: frame("pm", "cubic"),
        lambda: frame("macro", "gap"),
        lambda: frame("mean"),
        bouncing,
        lambda: iterated("gc"),
        lambda: iterated("macro", substeps=3),
        lambda: full("gc", 50, 8),
        lambda: hybrid("gc", device=lambda f: simulated(rig)),
    ],
)
def test_a_model_in_a_room_moves_as_elsewhere(library, tmp_path, make):
    elsewhere = frozen(make(), library, tmp_path)
    content = words(tmp_path / "model.pma")
    needed = library.room(content.ctypes.data, content.nbytes)
    room = aligned(needed + 64)
    model = library.model(content, room[:needed])
    assert np.array_equal(model.rows(30), elsewhere.rows(30))
    state = model.state()
    rest = model.rows(9)
    assert model.restore(state.ctypes.data, state.nbytes) == OK
    assert np.array_equal(model.rows(9), rest)
    assert not room[needed:].any()  # nothing is behind it
    with pytest.raises(Refused, match="the room is too small"):
        library.model(content, aligned(needed - 16))
    with pytest.raises(Refused, match="aligned"):
        library.model(content, aligned(needed + 8)[8:])
    damaged = content.copy()
    damaged[-1] ^= 1
    assert library.room(damaged.ctypes.data, damaged.nbytes) == 0
    assert library.room(None, 800) == 0


# ---- limits ------------------------------------------------------------------------------------


def commands_of(restoring):
    """A function, and the list of the displacements and velocities at which it is evaluated."""
    commands = []

    def function(t, u, v):
        commands.append((u[1], v[1]))
        return restoring(t, u, v)

    return function, commands


@pytest.mark.gate
@pytest.mark.parametrize("what", ["displacement", "velocity", "acceleration"])
def test_a_command_beyond_the_limits_is_never_given(library, tmp_path, what):
    def restoring(t, u, v):
        return np.array([0.0, specimen(u[1], v[1]), 0.0])

    t = 0.01 * np.arange(1000)
    load = pm.SampledForce(30.0 * t * np.sin(12.0 * t), 0.01, np.array([0.0, 1.0, 0.0]))
    function, commands = commands_of(restoring)
    frame("gc", force=load, restoring=function).run(1.0)
    d, v = np.array(commands).T
    first = {"displacement": d, "velocity": v, "acceleration": np.diff(d, 2) / 0.02**2}[what]
    limits = rig.Limits(**{what: 1.05 * np.max(np.abs(first))})
    coupler = frame("gc", force=load, restoring=restoring, limits=limits)
    model = frozen(coupler, library, tmp_path, PORT)
    with pytest.raises(pm.LimitError) as caught:
        coupler.run(10.0)
    status, last = OK, None
    while status == OK:
        last = model.command_of(0)[1]
        model.set(0, specimen(*last[:2]))
        status = model.advance(1)
    assert status == LIMITED
    assert model.time() > 0.0
    assert abs(model.time() + coupler.dt - caught.value.time) < 1e-9
    assert model.command_of(0) == (0, last)
    assert f"{what} " in model.why and f"t = {caught.value.time:.9g}" in model.why
    assert model.advance(1) == FAILED
    model.reset()
    assert model.advance(1) == OK


# ---- what cannot be frozen -----------------------------------------------------------------------


def test_what_no_file_can_have_is_refused_by_name_and_leaves_no_file(tmp_path):
    def function(t, u, v):
        return 0.0 * u

    moving = frame("gc", restoring=function)
    outside = frame("gc", restoring=rig.External([0, 2]))
    beyond = frame("gc", force=lambda t: np.zeros(3), velocity=lambda t: 0.0)
    driven = frame("gc", velocity=lambda t: 0.0)
    both = {"x": ("force", "a", 0), "y": ("velocity", 1)}
    with pytest.warns(pm.StabilityWarning):
        macro = frame("macro", restoring=rig.External([1]), substeps=2)
    stepped = frame("pm")
    stepped.step(1)
    stepped.change_steps(dt=0.01)
    plain, one = frame("gc", "bilinear"), {"x": ("specimen", "a", 1)}
    several = frame("gc", restoring=[rig.External([1]), rig.External([1])])
    beside = frame("gc", restoring=rig.Compensated(function, 0.02), force=[1.0, 0.0, 0.0])
    cases = [
        (moving, {}, {}, r"restoring of subdomain 'a' is a function.*missing dofs 0, 1, 2"),
        (moving, one, {}, r"acts on all of its 3 dofs.*\"specimen\", 'a'.*missing dofs 0, 2"),
        (beside, one, {}, r"restoring of subdomain 'a' is a function.*missing dofs 0, 2"),
        (outside, {"x": ("specimen", "a", 0)}, {}, r"'a' is <External on dofs 0, 2.*missing dof 2"),
        (outside, PORT, {}, r"input 'column.d1': no specimen acts on dof 1 of subdomain 'a'"),
        (several, one, {}, r"restoring of subdomain 'a' has several .*specimens"),
        (beyond, both, {}, r"force of subdomain 'a' has a function"),
        (driven, both, {}, r"velocity of constraint 1 is a function.*\"velocity\", row\)}, row 1"),
        (macro, one, {}, r"'a' must have one substep under 'macro'"),
        (
            frame("macro", substeps=2),
            {"x": ("force", "a", 1)},
            {},
            r"'x': .*'a' must have one",
        ),
        (plain, one, {}, r"input 'x': no specimen acts on dof 1 of subdomain 'a'"),
        (plain, {"x": ("force", "c", 1)}, {}, r"inputs\['x'\].*'c'"),
        (plain, {"x": ("force", "a", 3)}, {}, r"inputs\['x'\].*3"),
        (plain, {"x": ("velocity", 1)}, {}, r"inputs\['x'\] must be one of 1 rows, got 1"),
        (plain, {"x": ("force", "a", 1, np.nan)}, {}, r"at the start of inputs\['x'\].*finite"),
        (plain, {"x": ("pull", "a", 0)}, {}, r"inputs\['x'\].*'pull'"),
        (plain, {"x": ("force", "a", 0), "y": ("force", "a", 0)}, {}, r"different dofs.*'x'"),
        (plain, {"x y": ("force", "a", 0)}, {}, r"identifiers.*'x y'"),
        (plain, {"x": ("force", "a", 0)}, {"x": ("u", "a", 0)}, r"different names.*'x'"),
        (plain, {}, {"x": ("w", "a", 0)}, r"outputs\['x'\].*'w'"),
        (plain, {}, {"x": ("multiplier", 1)}, r"outputs\['x'\].*1 rows, got 1"),
        (plain, {}, {"x": ("spring force", "a", 2)}, r"2 springs of subdomain 'a', got 2"),
        (stepped, {}, {}, r"across a change of steps"),
    ]
    for coupler, inputs, outputs, message in cases:
        with pytest.raises(ValueError, match=message):
            coupler.freeze(tmp_path / "x.pma", inputs, outputs)
        assert not list(tmp_path.iterdir())


def test_internal_forces_and_loads_of_the_motion_are_refused_by_name(tmp_path):
    def load(t, u, v):
        return -u

    scheme = pm.GeneralizedAlpha(0.8)
    s = pm.Subdomain([1.0], [4.0], scheme=scheme, force=load, name="fed")
    with pytest.raises(ValueError, match=r"force of subdomain 'fed' depends on the motion"):
        pm.Coupler([s], dt=0.1).freeze(tmp_path / "x.pma")
    force = pm.InternalForce(lambda t, u, v, q: (u**3, np.diag(3.0 * u**2)))
    s = pm.Subdomain([1.0], [4.0], scheme=scheme, internal=force, name="bent")
    with pytest.raises(ValueError, match=r"internal of subdomain 'bent' has functions"):
        pm.Coupler([s], dt=0.1).freeze(tmp_path / "x.pma")
    assert not list(tmp_path.iterdir())


def test_compiled_functions_obstacles_that_move_and_adaptive_compensators_are_refused_by_name(
    library, tmp_path
):
    compiled_restoring = LowLevelCallable(RESTORING(lambda t, n, u, v, r, user: 0))
    compiled_force = LowLevelCallable(FORCE(lambda t, n, f, user: 0))

    def measured(t, u, v):
        return 0.0 * u, u

    def behind(method, **options):
        return hybrid("gc", device=lambda _: rig.Compensated(measured, method=method, **options))

    one = np.eye(3)
    lag = rig.LinearActuator(-50.0 * one, 50.0 * one, one, one)
    linked = hybrid("gc", device=lambda f: rig.Linkage(f, matrix=2.0 * one))
    box = pm.Subdomain([2.0], [0.0], scheme=pm.Newmark(), force=[-20.0], name="box")
    lift = pm.Coupler([box], pm.contact(box, 0, motion=lambda t: 1.5 * t**2), dt=0.01)
    measures = r"restoring of subdomain 'a' has a compensator that needs the measured"
    cases = [
        (
            frame("gc", restoring=compiled_restoring),
            {},
            r"restoring of subdomain 'a' is a function",
        ),
        (frame("gc", force=compiled_force), {}, r"force of subdomain 'a' has a compiled function"),
        (linked, PORT, r"restoring of subdomain 'a' has a Linkage"),
        (behind("adaptive", delay=0.03), PORT, measures),
        (behind("model", model=lag, bandwidth=10.0, feedback=1.0), PORT, measures),
        (lift, {}, r"obstacles of contacts that move"),
    ]
    for coupler, inputs, message in cases:
        with pytest.raises(ValueError, match=message):
            coupler.freeze(tmp_path / "x.pma", inputs)
        assert not list(tmp_path.iterdir())
    frozen(frame("gc", restoring=compiled_restoring), library, tmp_path, PORT)  # in its place


# ---- files ---------------------------------------------------------------------------------------


def test_a_number_of_constraints_that_no_file_of_this_size_has_is_refused(
    library, tmp_path, monkeypatch
):
    def damaged(tree):
        parts = tree["subdomains"][0]["parts"]
        parts["link"] = parts["link"]._replace(p=2**40)
        return file_of(tree)

    monkeypatch.setattr(pmalpha.run.freeze, "file_of", damaged)
    iterated("macro").freeze(tmp_path / "x.pma")
    with pytest.raises(Refused, match="p is too large"):
        library.model(tmp_path / "x.pma")


def test_numbers_that_ask_for_memory_share_one_room(library, tmp_path, monkeypatch):
    """A link of 2**23 constraints asks for 256 MB, which a small file may once."""

    def damaged(links):
        def file(tree):
            for i in links:
                parts = tree["subdomains"][i]["parts"]
                parts["link"] = parts["link"]._replace(p=2**23)
            return file_of(tree)

        return file

    for links, message in (([0], "sizes do not agree"), ([0, 1], r"\[1\].*p is too large")):
        monkeypatch.setattr(pmalpha.run.freeze, "file_of", damaged(links))
        frame("gc").freeze(tmp_path / "x.pma")
        with pytest.raises(Refused, match=message):
            library.model(tmp_path / "x.pma")


HEADER, NODE = pmalpha.frozen.model.HEADER // 8, pmalpha.frozen.model.NODE // 8


def with_sum(content):
    content.view(np.uint64)[5] = pmalpha._core.check_sum(content[HEADER:].view(np.uint8))
    return content


@pytest.mark.gate
def test_nodes_that_share_children_are_refused(library, tmp_path):
    """Every further parent would cost nothing in the file, and memory when it is opened."""
    frame("gc").freeze(tmp_path / "x.pma")
    content = words(tmp_path / "x.pma")
    nodes = content[HEADER : HEADER + NODE * content[3]].reshape(-1, NODE)
    assert library.model(with_sum(content.copy())).advance(1) == OK
    families = [x for x in nodes if x[0] == pmalpha.frozen.model.DICT]
    first, second = next((x, y) for x in families for y in families if x[1] == y[1] and x[4] < y[4])
    first[4] = second[4]
    with pytest.raises(Refused, match="is outside, or used too often"):
        library.model(with_sum(content))


def test_an_array_of_many_nodes_is_written_again_and_refused_where_it_is_not(
    library, tmp_path, thresholds
):
    tree = {"format": "pmalpha", "subdomains": 20 * (np.ones(1000),)}
    sizes = []
    for shares, message in ((8, "inputs must be"), (20, "used too often")):
        thresholds(SHARES=shares)
        content = np.frombuffer(bytes(file_of(tree)), np.int64).copy()
        sizes.append(content.nbytes)
        with pytest.raises(Refused, match=message):
            library.model(content)
    assert 16000 <= sizes[0] - sizes[1] < 17000  # three arrays, and one


def test_after_a_state_that_failed_the_model_goes_on_from_a_good_one(library, tmp_path):
    """A velocity that nothing prescribes, and that is not finite, was kept for later steps."""
    model, other = (frozen(frame("gc"), library, tmp_path) for _ in range(2))
    model.advance(5)
    other.advance(5)
    state = model.state()
    for k in range(3, len(state) - 1):
        bad = state.copy()
        bad[k] = np.nan
        bad.view(np.uint64)[-1] = pmalpha._core.check_sum(bad[:-1].view(np.uint8))
        if model.restore(bad.ctypes.data, bad.nbytes) == OK:
            model.advance(4)
    assert model.restore(state.ctypes.data, state.nbytes) == OK
    assert np.array_equal(model.rows(9), other.rows(9))


def test_files_that_are_no_models_are_refused_with_a_message(library, tmp_path):
    frame("gc").freeze(tmp_path / "model.pma")
    good = (tmp_path / "model.pma").read_bytes()
    later = good[:8] + (9).to_bytes(4, "little") + good[12:]
    damaged = good[:2000] + bytes([good[2000] ^ 1]) + good[2001:]
    cases = [
        (b"", "not a frozen model"),
        (b"a text of some length " * 9, "not a frozen model"),
        (b"PK\x03\x04" + bytes(200), "not a frozen model"),
        (good[:-8], "not whole"),
        (later, "format 9, this library reads format 2"),
        (damaged, "check sum"),
    ]
    for content, message in cases:
        (tmp_path / "x.pma").write_bytes(content)
        with pytest.raises(Refused, match=message):
            library.model(tmp_path / "x.pma")
    os.mkfifo(tmp_path / "pipe")
    for name, reason in (
        ("none", "No such file"),
        (".", "no regular file"),
        ("pipe", "no regular"),
    ):
        with pytest.raises(Refused, match=f"cannot be opened: .*{reason}"):
            library.model(tmp_path / name)
    handle, why = ctypes.c_void_p(), ctypes.create_string_buffer(256)
    assert library.open_memory(None, 80, why, ctypes.byref(handle)) == BAD_ARGUMENT and why.value
    assert library.open(None, why, ctypes.byref(handle)) == BAD_ARGUMENT and why.value


def test_the_version_of_the_library_is_that_of_the_package(library):
    assert library.version().decode() == pm.__version__
    assert library.abi() == 2
    text = (pm.c_library() / "pmalpha.h").read_text()
    assert "#define PMALPHA_ABI 2\n" in text
    assert len(text.splitlines()) < 200


@pytest.mark.gate
def test_numbers_in_messages_are_those_of_printf(library, tmp_path):
    """The library has no printf; nine digits, also of those that round up to another power."""
    numbers = [3.0, 1e-5, 9.9999999996, 123456.7891, 9.876543215e8, 1e22, 2.5e-310, 1e300, 0.1]
    numbers += np.ldexp(np.random.default_rng(0).random(20), np.arange(-60, 60, 6)).tolist()
    for number in numbers:
        s = pm.Subdomain(
            [1.0],
            [1.0],
            scheme=pm.CentralDifference(),
            v0=[1.0],
            restoring=rig.External([0]),
            restoring_stiffness=[1.0],
            limits=rig.Limits(displacement=number),
            name="s",
        )
        coupler = pm.Coupler([s], dt=min(1.0, 1.5 * number))
        model = frozen(coupler, library, tmp_path, {"r": ("specimen", "s", 0)})
        while model.advance(1) == OK and model.count() < 3:
            pass
        if model.why:
            assert f"its limit {number:.9g}" == model.why[model.why.index("its limit") :]


def test_steps_are_timed_by_a_clock_of_the_caller(library, tmp_path):
    model = frozen(frame("gc"), library, tmp_path)
    times = iter([0, 7, 7, 12, 20, 45, 50, 60])
    clock = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(lambda _: next(times))
    model.clock(clock, None)
    assert model.advance(4) == OK
    assert model.longest() == 25
