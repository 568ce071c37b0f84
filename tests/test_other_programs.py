"""A coupler as an FMU and as a participant of preCICE, coupled to a spring outside.

An iterated coupling to a spring is the spring in the matrix: with the force of the spring at the
end of the step, the equations are the same ones.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import waits

EXAMPLES = Path(__file__).parent.parent / "examples"
sys.path.insert(0, str(EXAMPLES))

import precice_tower  # noqa: E402
from precice_tower import SPRING  # noqa: E402
from tower_on_rig import DT, ROOF, tower_on_rig  # noqa: E402

pytestmark = pytest.mark.gate

STEPS = 200


def roof_of(history):
    return history["tower"].u[:, 2]


@pytest.fixture(scope="module")
def monolithic():
    """Displacements of the roof with the spring in the stiffness matrix."""
    return roof_of(tower_on_rig(lambda t: 0.0, SPRING).run(steps=STEPS))


@pytest.fixture(scope="module")
def lagged():
    """The same with the force of the spring at the beginning of each macro step."""
    roof = [ROOF]
    coupler = tower_on_rig(lambda t: -SPRING * roof[-1])
    for _ in range(STEPS):
        coupler.step()
        roof.append(coupler.state("tower").u[2])
    return np.array(roof)


def test_a_lag_of_one_step_can_be_seen(monolithic, lagged):
    assert abs(lagged - monolithic).max() > 0.005 * ROOF


# ---- FMI ----------------------------------------------------------------------------------------


INPUTS = {"force": ("force", "tower", 2)}
OUTPUTS = {
    "displacement": ("u", "tower", 2),
    "velocity": ("v", "tower", 2),
    "multiplier": ("multiplier", 0),
}


def exported(folder, force):
    """An FMU whose initial accelerations are those of this force."""
    pytest.importorskip("fmpy")
    path = folder / "tower.fmu"
    inputs = {"force": (*INPUTS["force"], force)}
    tower_on_rig(None).export_fmu(path, inputs, OUTPUTS)
    return str(path)


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    return exported(tmp_path_factory.mktemp("fmu"), -SPRING * ROOF)


class Instance:
    """An instance of the FMU, initialized with a force."""

    def __init__(self, path, force):
        import fmpy
        from fmpy.fmi2 import FMU2Slave

        model = fmpy.read_model_description(path)
        self.references = {v.name: v.valueReference for v in model.modelVariables}
        self.slave = FMU2Slave(
            guid=model.guid,
            unzipDirectory=fmpy.extract(path),
            modelIdentifier=model.coSimulation.modelIdentifier,
            instanceName="tower",
        )
        self.slave.instantiate()
        self.slave.setupExperiment(startTime=0.0)
        self.slave.enterInitializationMode()
        self.set(force)
        self.slave.exitInitializationMode()
        self.t = 0.0

    def set(self, force):
        self.slave.setReal([self.references["force"]], [force])

    def get(self, name="displacement"):
        return self.slave.getReal([self.references[name]])[0]

    def step(self, length=DT):
        self.slave.doStep(self.t, length)
        self.t += length

    def state(self):
        return self.t, self.slave.getFMUstate()

    def restore(self, state):
        self.t = state[0]
        self.slave.setFMUstate(state[1])

    def close(self):
        self.slave.terminate()
        self.slave.freeInstance()


def test_the_fmu_is_valid_and_gives_the_plain_run(tmp_path):
    fmu = exported(tmp_path, 0.0)
    import fmpy

    description = fmpy.read_model_description(fmu, validate=True)
    assert description.coSimulation.canGetAndSetFMUstate
    assert description.coSimulation.canSerializeFMUstate
    t = DT * np.arange(STEPS + 1)
    force = np.sin(3.0 * t)
    signal = np.array(list(zip(t, force)), dtype=[("time", float), ("force", float)])
    found = fmpy.simulate_fmu(
        fmu,
        stop_time=t[-1],
        step_size=DT,
        output_interval=DT,
        input=signal,
        output=["displacement", "velocity", "multiplier"],
    )
    # the input set at the beginning of a communication step acts until its end
    history = tower_on_rig(lambda t: force[max(0, round(t / DT) - 1)]).run(steps=STEPS)
    assert abs(roof_of(history)).max() > ROOF
    # equal but for one rounding of the inputs, which fmpy interpolates
    for name, expected in (
        ("displacement", roof_of(history)),
        ("velocity", history["tower"].v[:, 2]),
        ("multiplier", history.multipliers[:, 0]),
    ):
        np.testing.assert_allclose(found[name], expected, rtol=0.0, atol=1e-14)


def test_a_communication_step_of_several_macro_steps_is_these_steps(fmu):
    one, other = Instance(fmu, 1.0), Instance(fmu, 1.0)
    for _ in range(10):
        one.step(5 * DT)
        for _ in range(5):
            other.step()
        assert one.get() == other.get() and one.get("multiplier") == other.get("multiplier")
    one.close()
    other.close()


def test_a_serialized_state_continues_in_another_instance(fmu):
    one, other = Instance(fmu, 1.0), Instance(fmu, 0.0)
    one.step(5 * DT)
    t, state = one.state()
    data = one.slave.serializeFMUstate(state)
    one.set(0.5)
    one.step(5 * DT)
    found = one.get()
    assert len(one.slave.serializeFMUstate(state)) == len(data) and one.get() == found
    other.restore((t, other.slave.deSerializeFMUstate(data)))
    other.set(0.5)
    other.step(5 * DT)
    assert other.get() == found and other.get("multiplier") == one.get("multiplier")
    one.close()
    other.close()


def test_explicit_co_simulation_lags_and_iterated_co_simulation_is_the_monolithic_run(
    fmu, monolithic, lagged
):
    explicit, iterated = Instance(fmu, -SPRING * ROOF), Instance(fmu, -SPRING * ROOF)
    roofs, force = ([ROOF], [ROOF]), -SPRING * ROOF
    for _ in range(STEPS):
        explicit.set(-SPRING * roofs[0][-1])
        explicit.step()
        roofs[0].append(explicit.get())
        begin = iterated.state()
        for _ in range(20):
            iterated.set(force)
            iterated.step()
            before, force = force, -SPRING * iterated.get()
            if abs(force - before) < 1e-15:
                break
            iterated.restore(begin)
        else:
            raise AssertionError("no convergence")
        iterated.slave.freeFMUstate(begin[1])
        roofs[1].append(iterated.get())
    np.testing.assert_array_equal(roofs[0], lagged)
    # iterations that end at 1e-15, over 200 steps; measured 2e-15
    np.testing.assert_allclose(roofs[1], monolithic, rtol=0.0, atol=1e-13 * ROOF)
    explicit.close()
    iterated.close()


def test_a_value_that_is_refused_is_an_error_and_a_state_leads_back(fmu):
    from fmpy import fmi1

    one, other = Instance(fmu, 1.0), Instance(fmu, 1.0)
    one.step()
    other.step()
    begin = one.state()
    with pytest.raises(fmi1.FMICallException, match="error"):
        one.set(np.nan)
    one.step()  # with the force before
    one.restore(begin)
    for each in (one, other):
        each.set(0.5)
        each.step()
    assert one.get() == other.get()
    one.close()
    other.close()


# ---- preCICE ------------------------------------------------------------------------------------


class StandIn:
    """The calls of preCICE that the tower makes, with the spring in place of a second process.

    A window is repeated until the force at its end is that of the spring; within a window the force
    is linear in time. With explicit coupling it is that of the beginning.
    """

    def __init__(self, implicit, window=DT, end=STEPS * DT):
        self.implicit, self.window, self.end = implicit, window, end
        self.begun = self.done = 0.0  # begin of the window, and of the step
        self.forces = [0.0, 0.0]  # at the begin and at the end of the window
        self.complete, self.repeat, self.iterations = True, False, 0

    def set_mesh_vertices(self, mesh, positions):
        assert mesh == "Tower-Mesh"
        return np.arange(len(positions))

    def requires_initial_data(self):
        return True

    def write_data(self, mesh, name, vertices, values):
        assert (mesh, name, len(vertices), len(values)) == ("Tower-Mesh", "Displacement", 1, 1)
        self.u = values[0]

    def initialize(self):
        self.forces = [-SPRING * self.u] * 2

    def is_coupling_ongoing(self):
        return self.begun < self.end - 1e-9

    def requires_writing_checkpoint(self):
        return self.implicit and self.complete

    def get_max_time_step_size(self):
        return self.begun + self.window - self.done

    def read_data(self, mesh, name, vertices, ahead):
        assert (mesh, name, len(vertices)) == ("Tower-Mesh", "Force", 1)
        share = (self.done + ahead - self.begun) / self.window
        return np.array([self.forces[0] + share * (self.forces[1] - self.forces[0])])

    def advance(self, step):
        self.done += step
        self.complete = self.repeat = False
        if self.get_max_time_step_size() > 1e-9:
            return
        force, before = -SPRING * self.u, self.forces[1]
        self.iterations += 1
        self.repeat = self.implicit and abs(force - before) > 1e-15
        self.complete = not self.repeat
        self.forces = [self.forces[0] if self.repeat else force, force]
        if self.complete:
            self.begun += self.window
        self.done = self.begun

    def requires_reading_checkpoint(self):
        return self.repeat

    def is_time_window_complete(self):
        return self.complete

    def finalize(self):
        pass


def test_the_participant_repeats_windows_until_it_is_the_monolithic_run(monolithic, lagged):
    np.testing.assert_array_equal(precice_tower.tower(StandIn(implicit=False)), lagged)
    iterated = StandIn(implicit=True)
    roof = precice_tower.tower(iterated)
    assert iterated.iterations > 2 * STEPS
    # as in the FMU
    np.testing.assert_allclose(roof, monolithic, rtol=0.0, atol=1e-13 * ROOF)


def test_a_window_of_several_macro_steps_has_a_force_that_is_linear_in_it(monolithic):
    roof = precice_tower.tower(StandIn(implicit=True, window=4 * DT))
    # linear interpolation over 0.04 s of a motion with frequencies around 3: 1e-3 of its amplitude
    np.testing.assert_allclose(roof, monolithic[::4], rtol=0.0, atol=2e-3 * ROOF)
    assert abs(roof - monolithic[::4]).max() > 1e-6 * ROOF


def test_a_window_that_is_no_whole_number_of_macro_steps_is_refused():
    with pytest.raises(ValueError, match="time windows must be whole numbers of 0.01, 0.005"):
        precice_tower.tower(StandIn(implicit=False, window=1.5 * DT))


@pytest.mark.parametrize("kind", ["explicit", "implicit"])
def test_the_participants_run_under_precice(kind, monolithic, lagged, tmp_path):
    pytest.importorskip("precice")
    program = [sys.executable, EXAMPLES / "precice_tower.py"]
    configuration = EXAMPLES / f"precice_{kind}.xml"
    other = subprocess.Popen([*program, "Spring", configuration], cwd=tmp_path)
    try:
        printed = subprocess.check_output(
            [*program, "Tower", configuration], cwd=tmp_path, text=True, timeout=waits.LIMIT
        )
        assert other.wait(60) == 0
    finally:
        other.kill()
        other.wait()
    roof = [float.fromhex(x) for x in printed.splitlines()[-1].split()]
    if kind == "explicit":
        np.testing.assert_array_equal(roof, lagged)
    else:
        # its iterations end at 1e-13 of the force; measured 1.2e-15
        np.testing.assert_allclose(roof, monolithic, rtol=0.0, atol=1e-11 * ROOF)
