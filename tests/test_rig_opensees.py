"""Frames of OpenSees with pmalpha as their element, and a column of OpenSees as the specimen."""

import signal
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from queue import Queue

import numpy as np
import pytest
import waits

import pmalpha as pm
from pmalpha import rig

sys.path.insert(0, str(Path(__file__).parent))
import opensees_rig as own  # noqa: E402

PROGRAM = Path(own.__file__)
pytestmark = pytest.mark.gate

pytest.importorskip("openseespy", reason="OpenSeesPy is not installed")
works = subprocess.run(
    [sys.executable, "-c", "import opensees_rig; opensees_rig.example.opensees()"],
    cwd=PROGRAM.parent,
    capture_output=True,
    text=True,
    timeout=110,  # s, which only ends an import that hangs
)
if works.returncode:
    pytest.skip(f"OpenSeesPy cannot be imported: {works.stderr}", allow_module_level=True)


@contextmanager
def opensees(*words):
    program = [sys.executable, str(PROGRAM), *map(str, words)]
    pipe = subprocess.PIPE
    process = subprocess.Popen(program, stdout=pipe, stderr=subprocess.STDOUT, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def displacements(process):
    """(steps, 6) of what a frame has printed, when it has ended."""
    printed, _ = process.communicate(timeout=waits.LIMIT)
    rows = [line.split() for line in printed.splitlines() if "0x" in line]
    assert process.returncode == 0 and len(rows) == own.STEPS, printed
    return np.array([[float.fromhex(x) for x in row] for row in rows])


@cache
def alone(*words):
    with opensees("frame", 0, *words) as process:
        return displacements(process)


@contextmanager
def served(what):
    """The port of `what`, and a list of what `serve` returned or raised."""
    ports, results = Queue(), []

    def run():
        try:
            results.append(rig.serve(what, announce=ports.put, timeout=waits.LIMIT))
        except Exception as error:
            results.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    yield ports.get(), results
    thread.join(waits.LIMIT)
    assert not thread.is_alive()


def with_element(what, *words):
    with served(what) as (port, results):
        with opensees("frame", port, *words) as process:
            u = displacements(process)
    assert results == [own.STEPS]
    return u


def ground(t):
    return 3.0 * np.sin(2.0 * np.pi * t / 0.3)


def column(share=1.0, **options):
    mass = share * np.array(own.MASS)
    return pm.Subdomain(mass, own.columns(), scheme=pm.Newmark(), name="column", **options)


def column_of_two(coupling, substeps=1):
    """The column as a coupler: its stiffness and half of its mass, and the other half."""

    def load(t):
        return -0.5 * np.array(own.MASS) * [ground(t), 0.0, 0.0]

    stiff = column(0.5, force=load)
    lump = pm.Subdomain(
        0.5 * np.array(own.MASS),
        np.zeros(3),
        scheme=pm.Newmark(),
        force=load,
        substeps=substeps,
        name="lump",
    )
    interface = pm.Constraint({stiff: np.eye(3)}, velocity=rig.Command(3))
    ties = [pm.tie(stiff, range(3), lump, range(3)), interface]
    return pm.Coupler([stiff, lump], ties, dt=own.DT, coupling=coupling)


# 1e-9 is the tolerance that users need; what is compared differs by rounding, 1e-15
@pytest.mark.parametrize(
    "words", [("newmark", "Newton"), ("newmark", "Linear"), ("alpha-os", "Linear")]
)
def test_a_frame_with_a_subdomain_as_its_column_is_the_whole_frame(words):
    whole = alone("column", *words)
    difference = np.abs(with_element(column(), "column", *words) - whole).max()
    assert difference < 1e-9 * np.abs(whole).max()


@pytest.mark.parametrize("algorithm", ["Newton", "Linear"])
def test_a_frame_with_the_interface_of_a_coupler_is_the_whole_frame(algorithm):
    whole = alone("column", "newmark", algorithm)
    with_coupler = with_element(column_of_two("gc"), "column", "newmark", algorithm)
    assert np.abs(with_coupler - whole).max() < 1e-9 * np.abs(whole).max()


def test_a_frame_with_the_interface_of_a_coupler_with_substeps_is_near_the_whole_frame():
    whole = alone("column", "newmark", "Newton")
    with_coupler = with_element(column_of_two("pm", 2), "column", "newmark", "Newton")
    # double steps and substeps have other errors of the second order than the whole frame's steps
    assert np.abs(with_coupler - whole).max() < 0.02 * np.abs(whole).max()


def test_a_frame_with_springs_that_yield_is_the_one_with_the_material_of_opensees():
    spring = pm.Bilinear([0], k=2e6, fy=20e3, hardening=0.1)
    whole = alone("yielding", "newmark", "Newton")
    difference = np.abs(with_element(spring, "yielding", "newmark", "Newton") - whole).max()
    assert difference < 1e-9 * np.abs(whole).max()
    assert np.abs(whole[:, 3]).max() > 2.0 * 20e3 / 2e6  # well beyond yield


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return taken.getsockname()[1]


@contextmanager
def specimen(kind):
    """The column of OpenSees behind its `actuator` or `adapter`; with its process."""
    port = free_port()
    with opensees("actuator", port, kind) as process:
        found = []

        def try_it():
            try:
                found.append(
                    rig.connect(
                        ("127.0.0.1", port),
                        send=["displacement"],
                        commits=False,
                        timeout=waits.LIMIT,
                    )
                )
            except ConnectionRefusedError:  # it does not listen yet
                pass
            return found

        waits.until(try_it)
        yield found[0], process
        found[0].close()


def behind(kb, K):
    """Stiffness of the column in series with the spring of the element."""
    return np.linalg.inv(np.linalg.inv(K) + np.eye(len(K)) / kb)


@pytest.mark.parametrize(("kind", "n"), [("actuator", 1), ("adapter", 3)])
def test_a_column_of_opensees_is_a_specimen(kind, n):
    K = own.columns() if n == 3 else np.linalg.inv(np.linalg.inv(own.columns())[:1, :1])
    K = behind(own.STIFF, K)

    def run(restoring):
        mass = pm.Subdomain(
            [4e3, 4e3, 200.0][:n],
            None,
            scheme=pm.CentralDifference(),
            force=lambda t: [4e3 * ground(t), 0.0, 0.0][:n],
            restoring=restoring,
            restoring_stiffness=K,
            name="m",
        )
        return pm.Coupler([mass], dt=0.001).run(steps=100)["m"].u

    with specimen(kind) as (there, _):
        u = run(there)
    whole = run(lambda t, u, v: K @ u)
    assert np.abs(u - whole).max() < 1e-9 * np.abs(whole).max()


def test_opensees_that_is_killed_is_named_by_the_server():
    class Dying:
        def __init__(self):
            self.process, self.calls = None, 0

        def __call__(self, t, u, v):
            self.calls += 1
            if self.calls == 20:
                self.process.send_signal(signal.SIGKILL)
                self.process.wait(waits.LIMIT)
            return 2e6 * u

    dying = Dying()
    with served(dying) as (port, results):
        with opensees("frame", port, "yielding", "newmark", "Linear") as dying.process:
            waits.until(lambda: results)
    with pytest.raises(ConnectionError, match="the client 127.0.0.1:.* (closed|was lost)"):
        raise results[0]
    assert dying.calls == 20


def test_opensees_that_is_killed_as_a_specimen_leaves_the_coupler_at_its_last_macro_step():
    with specimen("actuator") as (there, process):
        K = float(1.0 / np.linalg.inv(own.columns())[0, 0])
        mass = pm.Subdomain(
            [4e3], None, scheme=pm.CentralDifference(), u0=[0.01], restoring=there,
            restoring_stiffness=[K], name="m",
        )  # fmt: skip
        coupler = pm.Coupler([mass], dt=0.001)
        coupler.step(30)
        process.kill()
        process.wait(waits.LIMIT)
        with pytest.raises(ConnectionError, match="the rig (closed|was lost)"):
            coupler.step(30)
        assert coupler.step_count == 30
