"""The examples run, and their results are asserted."""

import re
import runpy
import signal
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import waits
from agreement import assert_identical, assert_same_levels

import pmalpha as pm

EXAMPLES = Path(__file__).parent.parent / "examples"
sys.path.insert(0, str(EXAMPLES))

import rig  # noqa: E402
import simulated_rig  # noqa: E402
import train_on_bridge  # noqa: E402


class InProcess:
    """The specimen without a rig, and a log of its calls; lost at one of them if that is given."""

    def __init__(self, lost=None):
        self.specimen, self.calls = simulated_rig.Yielding(**rig.specimen), []
        self.lost = lost

    def __call__(self, t, u, v):
        self.calls.append((len(self.calls) + 1, t, u[0]))
        if len(self.calls) == self.lost:
            raise ConnectionError(f"the rig was lost at call {self.lost}")
        return [self.specimen(u[0])]


class Until:
    """A rig that calls `happens` before its commands with these numbers."""

    def __init__(self, rig, numbers, happens):
        self.rig, self.numbers, self.happens = rig, numbers, happens

    def __call__(self, t, u, v):
        if self.rig.number + 1 in self.numbers:
            self.happens()
        return self.rig(t, u, v)


# ---- a test rig -----------------------------------------------------------------------------


@pytest.mark.gate
def test_a_rig_without_delay_and_noise_is_the_same_model_in_one_process():
    alone = InProcess()
    expected = rig.hybrid(alone).run(steps=150)
    with rig.simulated_rig(**rig.specimen) as (address, process):
        client = rig.Rig(address)
        history = rig.hybrid(client).run(steps=150)
        commands = client.close()
    assert process.returncode == 0  # it has ended by itself
    # a double sent through a socket is unchanged, and so is the whole run
    assert_identical(history, expected)
    np.testing.assert_array_equal(commands, alone.calls)
    # one for the initial accelerations, one for each substep, in order
    np.testing.assert_array_equal(commands[:, 0], 1 + np.arange(1 + 150 * rig.substeps))
    times = np.arange(1 + 150 * rig.substeps) / rig.substeps * rig.dt  # (T1)
    np.testing.assert_array_equal(commands[:, 1], times)
    # the specimen yields: well beyond the elastic limit
    assert np.abs(commands[:, 2]).max() > 2.0 * rig.specimen["fy"] / rig.specimen["k"]


def test_the_specimen_in_the_rig_is_the_spring_of_the_core():
    by_rig = rig.hybrid(InProcess()).run(steps=200)
    by_core = rig.hybrid(pm.Bilinear([0], **rig.specimen)).run(steps=200)
    largest = np.abs(by_core["rig"].u).max()
    # 1e-13: the same law in another order of operations, a rounding of 1e-16 in each of 2000
    # substeps, of both signs and decaying with the motion
    np.testing.assert_allclose(by_rig["rig"].u, by_core["rig"].u, atol=1e-13 * largest)


def test_noise_of_the_same_seed_is_the_same_noise(monkeypatch):
    def forces(seed):
        options = {**rig.specimen, "noise": 100.0, "seed": seed}
        monkeypatch.setattr(sys, "argv", ["rig", *(f"--{k}={x}" for k, x in options.items())])
        served = []
        monkeypatch.setattr(simulated_rig, "serve", lambda call, timeout: served.append(call))
        simulated_rig.main()
        measured = [served[0](np.array([t]), np.array([1e-3]))[0] for t in np.arange(200) * 1e-3]
        return np.array(measured) - 1e-3 * rig.specimen["k"]

    noise = forces(1)
    np.testing.assert_array_equal(noise, forces(1))
    assert not np.any(noise == forces(2))
    # 0.2: four times the relative standard deviation of that of 200 numbers, 1 / sqrt(400)
    assert np.std(noise) == pytest.approx(100.0, rel=0.2)


# the warning of macro coupling for a restoring force with substeps
@pytest.mark.gate
@pytest.mark.filterwarnings("ignore:the restoring force:pmalpha.StabilityWarning")
@pytest.mark.parametrize(
    ("command", "coupling", "killed"),
    # in mid-step, and at its end; the rig itself is killed, or its error raised
    [(75, "pm", True), (82, "gc", False), (81, "macro", False)],
)
def test_when_the_rig_dies_coupler_and_file_are_at_the_last_whole_macro_step(
    command, coupling, killed, tmp_path
):
    pytest.importorskip("h5py")
    shorter, path = rig.hybrid(InProcess(), coupling=coupling), tmp_path / "test.h5"
    expected = shorter.run(steps=(command - 2) // rig.substeps)

    def ended_by(restoring):
        coupler = rig.hybrid(restoring, coupling=coupling, threads=1 if killed else 2)
        with pytest.raises(ConnectionError, match=f"the rig was lost at call {command}"):
            coupler.run(steps=50, record_to=path)
        assert coupler.step_count == (command - 2) // rig.substeps
        assert_identical(coupler.last_history, expected)
        assert_identical(pm.History.load(path), expected)
        assert_same_levels(coupler, shorter)

    if not killed:
        ended_by(InProcess(command))
        return
    with rig.simulated_rig(**rig.specimen) as (address, process):

        def die():
            process.kill()
            process.wait()

        client = rig.Rig(address)
        ended_by(Until(client, [command], die))
        client.client.close()
        with pytest.raises(ConnectionError):  # a wrong address, before the run
            rig.Rig(address)


@pytest.mark.gate
@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="needs a process that can be stopped")
def test_a_silent_rig_ends_the_run_which_resumes_with_the_rig():
    expected = rig.hybrid(InProcess()).run(steps=8)
    ss, silent = rig.substeps, threading.Event()
    with rig.simulated_rig(**rig.specimen) as (address, process):

        def stop():
            process.send_signal(signal.SIGSTOP)
            by_ctrl_c = client.number > 40
            client.client._messages.timeout = waits.LIMIT if by_ctrl_c else 0.1
            if by_ctrl_c:
                silent.set()

        def ended(error):
            with pytest.raises(error):
                coupler.run(steps=8)
            client.client._messages.timeout = waits.LIMIT
            process.send_signal(signal.SIGCONT)
            return coupler.last_history

        client = rig.Rig(address, timeout=waits.LIMIT)
        coupler = rig.hybrid(Until(client, [36, 58], stop))
        first = ended(TimeoutError)
        assert coupler.step_count == 3
        with waits.ctrl_c_when(silent.is_set, after=0.1):
            second = ended(KeyboardInterrupt)
        assert coupler.step_count == 5
        rest = coupler.run(steps=3)
        number, t, _ = client.close().T
    # elastic so far, so the commands of the lost macro steps have no effect on the specimen
    for name in ("frame", "rig"):
        joined = np.vstack([first[name].u, second[name].u[1:], rest[name].u[1:]])
        np.testing.assert_array_equal(joined, expected[name].u)
    # the commands of those macro steps are sent again, under new numbers
    instants = np.arange(1 + 8 * ss) / ss * rig.dt
    np.testing.assert_array_equal(number, 1 + np.arange(len(number)))
    sent = [instants[:36], instants[1 + 3 * ss : 53], instants[1 + 5 * ss :]]
    np.testing.assert_array_equal(t, np.concatenate(sent))


def test_the_rig_may_not_call_the_coupler_that_commands_it():
    coupler = rig.hybrid(lambda t, u, v: [coupler.time])
    with pytest.raises(RuntimeError, match="being stepped"):
        coupler.step()
    assert coupler.step_count == 0


@pytest.mark.parametrize("force", ["nan", "-inf"])
def test_a_measurement_that_is_not_finite_names_rig_and_time(force):
    def broken(t, u, v):
        return [float(force) if t > 0.0255 else 0.0]

    coupler = rig.hybrid(broken)
    words = "restoring of subdomain 'rig' at t = 0.026: .*must be finite"
    with pytest.raises(ValueError, match=words):
        coupler.run(steps=5)
    assert coupler.step_count == 2


def test_delay_of_the_actuator_is_a_lag_on_a_line_between_commands():
    actuator = simulated_rig.Actuator(0.25)
    assert actuator(0.0, 1.0) == 1.0  # before any other command
    # commands are 1 + t: after a quarter, the position is the command of a quarter earlier
    reached = [actuator(t, 1.0 + t) for t in (0.2, 0.4, 0.6, 0.8)]
    np.testing.assert_allclose(reached, [1.0, 1.15, 1.35, 1.55], rtol=1e-15)


def test_the_rig_example_runs(capsys):
    rig.main(steps=20)
    printed = capsys.readouterr().out
    assert printed.startswith("0.2 s, 201 commands") and "p99.9" in printed


def test_the_specimen_dissipates_the_area_of_its_loop():
    k, fy, hardening, d = 3.0, 2.0, 0.1, 5.0
    specimen = simulated_rig.Yielding(k, fy, hardening)
    turns = np.concatenate([np.linspace(0, d, 2001), np.linspace(d, -d, 4001)[1:]])
    turns = np.concatenate([turns, np.linspace(-d, d, 4001)[1:]])
    force = np.array([specimen(x) for x in turns])
    loop = slice(2000, None)  # from d to d
    work = np.sum(0.5 * (force[loop][1:] + force[loop][:-1]) * np.diff(turns[loop]))
    # a parallelogram: 4 (1 - hardening) fy (d - fy / k); 1e-3: the corners between two points
    assert work == pytest.approx(4 * (1 - hardening) * fy * (d - fy / k), rel=1e-3)


def test_the_structure_of_the_readme_prints_its_motion(capsys):
    runpy.run_path(str(EXAMPLES / "tower_on_rig.py"), run_name="__main__")
    largest, last = map(float, re.findall(r"-?\d+\.\d+", capsys.readouterr().out))
    # free vibration from 0.1, which algorithmic damping alone does not let exceed the start
    assert largest == 0.1 and abs(last) < largest


# ---- a vehicle on a bridge ------------------------------------------------------------------


def test_a_vehicle_rests_on_the_road_before_the_bridge_and_bends_both_spans_as_it_crosses():
    example = train_on_bridge
    weight = (example.BODY + example.WHEEL) * example.GRAVITY
    deflection, forces = example.crossing(40.0, dt=0.001)
    before = slice(0, int(4.0 / 40.0 / 0.001))  # the first axle is in front of the joint
    # in equilibrium at the start, on supports: rounding of forces of 1e5
    assert abs(forces[:, before] / weight - 1.0).max() < 1e-6
    assert forces.min() > 0.5 * weight and abs(deflection[before]).max() < 1e-9
    # up and down: the other span lifts this one. 2 P L^3 / 48 EI of a single span is 7.4 mm
    static = 2.0 * weight * 20.0**3 / (48.0 * 6e9)
    assert -1.5 * static < deflection.min() < -0.4 * static and deflection.max() > 0.05 * static
    finer, _ = example.crossing(40.0, dt=0.0005)
    # second order in the step: a quarter of the difference is left
    assert abs(finer[::2] - deflection).max() < 0.01 * abs(deflection).max()
