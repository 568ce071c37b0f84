"""Elements and specimens of other processes, by the protocol of OpenSees and OpenFresco."""

import errno
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Queue

import numpy as np
import pytest
import waits

import pmalpha as pm
from pmalpha import rig
from pmalpha.rig import wire as admission

PEER = Path(__file__).parent / "rig_peer.py"
LOCAL = "127.0.0.1"


@contextmanager
def served(what, **options):
    """The address of `what`, served in a thread, and a list of what that returned or raised."""
    ports, results = Queue(), []

    def run():
        try:
            options.setdefault("timeout", waits.LIMIT)
            results.append(rig.serve(what, announce=ports.put, **options))
        except Exception as error:
            results.append(error)
            ports.put(0)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield (LOCAL, ports.get()), results
    finally:
        thread.join(waits.LIMIT)
        assert not thread.is_alive()


def connected(address, **options):
    return rig.connect(address, **(dict(timeout=waits.LIMIT) | options))


@contextmanager
def peer(*words):
    """The stranger of rig_peer.py, which ends with the block."""
    program = [sys.executable, str(PEER), *map(str, words)]
    process = subprocess.Popen(program, stdout=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@contextmanager
def serving_peer(*words, mode="serve"):
    with peer(mode, *words) as process:
        yield (LOCAL, int(process.stdout.readline()))


def mass(restoring, **options):
    return pm.Subdomain(
        [1.0],
        None,
        scheme=pm.CentralDifference(),
        u0=[1.0],
        restoring=restoring,
        name="m",
        **options,
    )


def run(restoring, t_end=0.5):
    return pm.Coupler([mass(restoring)], dt=0.01).run(t_end)["m"].u


# ---- what is served ------------------------------------------------------------------------------


def specimen(t, u, v):
    return 4.0 * u + 0.1 * v**3 + 0.01 * np.sin(t)


@pytest.mark.parametrize("byte_order", ["little", "big"])
def test_a_served_function_gives_the_run_of_a_local_one(byte_order):
    with served(specimen) as (address, results):
        with connected(address, byte_order=byte_order) as there:
            np.testing.assert_array_equal(run(there), run(specimen))
            assert repr(there) == "<Connected to the rig, 51 calls>"
    assert results == [51]  # every command was committed


def test_served_springs_remember_what_was_committed():
    def spring():
        return pm.Bilinear([0], k=4.0, fy=1.0, hardening=0.1)

    with served([spring()]) as (address, _), connected(address) as there:
        far = run(there, 5.0)
    near = run(spring(), 5.0)
    np.testing.assert_allclose(far, near, rtol=0.0, atol=1e-14)
    assert abs(near).max() > 0.25  # beyond d_y


def test_trial_states_leave_no_trace_before_they_are_committed():
    with served(pm.Bilinear([0], k=4.0, fy=1.0, hardening=0.1)) as (address, _):
        with Driver(address, 1) as client:
            yields = client.force([1.0])
            np.testing.assert_allclose(yields, 1.0 + 0.4 * 0.75, rtol=1e-14)
            np.testing.assert_allclose(client.force([0.1]), 0.4, rtol=1e-14)
            client.force([1.0])
            client.send(5, [1.0])
            # back by twice f_y elastically, 0.5, and 0.4 on with the hardening stiffness
            np.testing.assert_allclose(client.force([0.1]), yields - 2.0 - 0.4 * 0.4, rtol=1e-13)


def _left(connection):
    """Has the other side closed the connection, having read all of it or not?"""
    try:
        return connection.recv(1) == b""
    except ConnectionError:
        return True


class Driver:
    """A client as OpenSees' genericClient is one."""

    def __init__(self, address, n, doubles=256):
        self.n, self.doubles = n, doubles
        self.socket = socket.create_connection(address, waits.LIMIT)
        self.socket.sendall(struct.pack("<11i", n, n, n, 0, 1, 0, 0, 0, n, 0, doubles))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        with self.socket, suppress(OSError):  # the server may have gone
            self.send(99)

    def is_left(self):
        return _left(self.socket)

    def send(self, action, u=(), v=None, t=0.0, a=None):
        message = np.zeros(self.doubles)
        message[0] = action
        if len(u):
            zero = np.zeros(self.n)
            values = [u, zero if v is None else v, zero if a is None else a, [t]]
            message[1 : 2 + 3 * self.n] = np.concatenate(values)
        self.socket.sendall(message.tobytes())

    def ask(self, action):
        self.send(action)
        data = b""
        while len(data) < 8 * self.doubles:
            data += self.socket.recv(8 * self.doubles - len(data))
        return np.frombuffer(data)

    def force(self, u, v=None, t=0.0):
        self.send(3, u, v, t)
        return self.ask(10)[: self.n]

    def matrix(self, action):
        return self.ask(action)[: self.n**2].reshape(self.n, self.n).T  # sent by columns


def test_a_served_subdomain_gives_its_force_and_its_matrices():
    K, C = np.array([[2.0, -1.5], [-0.5, 3.0]]), np.array([[0.2, 0.1], [0.0, 0.3]])
    own = pm.Subdomain(
        [5.0, 7.0],
        K,
        C=C,
        symmetric=False,
        scheme=pm.Newmark(),
        internal=[
            pm.CubicSpring([0], k=1.0, k3=2.0),
            lambda t, u, v, q: (u**3, np.diag(3.0 * u**2)),
        ],
        name="own",
    )
    u = np.array([0.3, -0.2])
    with served(own) as (address, results), Driver(address, 2) as client:
        r = K @ u + u**3 + [0.3 + 2.0 * 0.3**3, 0.0]
        np.testing.assert_allclose(client.force(u), r, rtol=1e-14)
        tangent = K + np.diag(3.0 * u**2) + np.diag([1.0 + 6.0 * 0.3**2, 0.0])
        np.testing.assert_allclose(client.matrix(13), tangent, rtol=1e-14)
        np.testing.assert_array_equal(client.matrix(14), C)
        np.testing.assert_array_equal(client.matrix(15), np.diag([5.0, 7.0]))
        for silent in (1, 2, 4, 50, 98):
            client.send(silent)
        client.send(5, u)
    assert results == [1]


class Committing:
    def __init__(self):
        self.evaluated, self.committed = [], []

    def __call__(self, t, u, v):
        self.evaluated.append(u[0])
        return 2.0 * u, 0.5 * u

    def commit(self):
        self.committed.append(self.evaluated[-1])


def test_a_function_is_evaluated_once_for_each_trial_and_told_which_one_was_accepted():
    function = Committing()
    matrices = dict(stiffness=[[3.0]], damping=[0.5], mass=[7.0])
    with served(function, **matrices) as (address, _), Driver(address, 1) as client:
        for u in (0.1, 0.2):
            client.send(3, [u])
            for _ in range(2):
                assert client.ask(10)[0] == 2.0 * u
        client.send(3, [0.3])
        assert [client.matrix(x)[0, 0] for x in (12, 13, 14, 15)] == [3.0, 3.0, 0.5, 7.0]
        client.send(5, [0.3])
        client.ask(10)
    assert function.evaluated == [0.1, 0.2, 0.3] and function.committed == [0.3]


# ---- a coupler -----------------------------------------------------------------------------------


def structure(command, coupling="gc", substeps=1):
    lower = pm.Subdomain([2.0], [30.0], C=[0.4], scheme=pm.Newmark(), name="lower")
    upper = pm.Subdomain([1.0], [20.0], scheme=pm.Newmark(), substeps=substeps, name="upper")
    ties = [pm.tie(lower, [0], upper, [0]), pm.Constraint({lower: [[1.0]]}, velocity=command)]
    return pm.Coupler([lower, upper], ties, dt=0.05, coupling=coupling)


def integrated(coupler, steps=39):
    """A mass with a spring, integrated here by Newmark's method, with the coupler as its element.

    Displacements from u = 1 at rest, and from an acceleration of zero.
    """
    dt, m, k = 0.05, 3.0, 10.0
    u, v, a = 1.0, 0.0, 0.0
    reached = []
    with served(coupler) as (address, results), Driver(address, 1) as client:
        for step in range(1, steps + 1):
            C = client.matrix(14)[0, 0]
            b = client.force([u], [0.0], step * dt)[0]
            # m a1 + C v1 + k u1 + b = 0,  u1 = u + dt v + dt^2/4 (a + a1),  v1 = v + dt/2 (a + a1)
            free = u + dt * v + dt**2 / 4 * a
            left = -b - C * (v + dt / 2 * a) - k * free
            a1 = left / (m + C * dt / 2 + k * dt**2 / 4)
            u, v, a = free + dt**2 / 4 * a1, v + dt / 2 * (a + a1), a1
            for action in (3, 5):
                client.send(action, [u], [v], step * dt, [a])
            reached.append(u)
    assert results == [steps]
    return np.array(reached)


def test_a_served_coupler_is_an_element_of_newmark_steps():
    dt, reached = 0.05, integrated(structure(rig.Command(1)))
    # the coupler is undeformed where the client begins: M u'' + C u' + 50 (u - 1) + 10 u = 0 with
    # the three-term recurrence of Newmark's method
    before, here, after = reached[:-2], reached[1:-1], reached[2:]
    forces = 6.0 * (after - 2 * here + before) / dt**2 + 0.4 * (after - before) / (2 * dt)
    forces += 60.0 * (after + 2 * here + before) / 4 - 50.0
    # rounding of second differences, 1e-16 M / dt^2 = 2e-13, summed up over the steps
    assert np.abs(forces).max() < 1e-10


@pytest.mark.parametrize("coupling", ["gc", "pm"])
def test_a_served_coupler_may_take_substeps(coupling):
    whole = integrated(structure(rig.Command(1)))
    several = integrated(structure(rig.Command(1), coupling, substeps=2))
    # both have errors of (omega dt)^2 / 12 = 0.2 per cent in the frequency, and pm double steps;
    # with velocities that were straight lines in a macro step 17 per cent
    assert np.abs(several - whole).max() < 0.03


def test_a_coupler_needs_a_command_and_steps_of_its_own_length():
    with pytest.raises(ValueError, match="must have one constraint with velocity=rig.Command"):
        with served(structure(lambda t: [0.0])) as (address, results):
            with Driver(address, 1):
                pass
        raise results[0]
    with served(structure(rig.Command(1))) as (address, results):
        with Driver(address, 1) as client:
            client.send(3, [0.0], [1.0], 0.04)
            client.send(10)
            assert client.is_left()
    with pytest.raises(ValueError, match="must be those of the coupler, dt = 0.05, .* 0 to 0.04"):
        raise results[0]


def test_a_coupler_is_at_its_last_commit_when_the_client_is_gone():
    coupler = structure(rig.Command(1))
    with served(coupler) as (address, results):
        with Driver(address, 1) as client:
            for step in (1, 2):
                client.send(3, [0.0], [0.3], 0.05 * step)
                client.send(5, [0.0], [0.3], 0.05 * step)
            kept = client.force([0.0], [0.9], 0.15)
            client.socket.shutdown(socket.SHUT_RDWR)
    assert isinstance(results[0], ConnectionError) and np.isfinite(kept).all()
    assert coupler.step_count == 2
    assert abs(coupler.state("lower").v[0] - 0.3) < 1e-14


def test_a_coupler_needs_velocities():
    with served(structure(rig.Command(1))) as (address, results):
        with connected(address, send=["displacement"]) as there:
            with pytest.raises(ConnectionError, match="the rig"):
                there(0.05, np.ones(1), np.ones(1))
    with pytest.raises(ValueError, match="a coupler needs the velocities of its interface"):
        raise results[0]


# ---- what is refused -----------------------------------------------------------------------------


def test_what_cannot_be_served_is_refused_before_it_listens():
    heard = []
    late = rig.SimulatedActuator(lambda t, u, v: u)
    for wrong in (3.0, None, [], [specimen], late, [late]):
        with pytest.raises(TypeError, match="what must be a Subdomain, a Coupler, springs, or"):
            rig.serve(wrong, announce=heard.append)
    with pytest.raises(ValueError, match="port must be at most 65535"):
        rig.serve(specimen, 70000, announce=heard.append)
    with pytest.raises(ValueError, match="allow or secret must be given with host '0.0.0.0'"):
        rig.serve(specimen, host="0.0.0.0", announce=heard.append)
    with pytest.raises(TypeError, match="secret must be text or bytes"):
        rig.serve(specimen, secret=b"", announce=heard.append)
    assert not heard


@pytest.mark.parametrize(
    ("what", "options", "message"),
    [
        (pm.CubicSpring([3], k=1.0, k3=0.0), {}, "dof"),
        (specimen, dict(stiffness=np.eye(3)), r"stiffness must have shape \(1, 1\), got \(3, 3\)"),
    ],
)
def test_what_does_not_fit_the_client_ends_the_server(what, options, message):
    with served(what, **options) as (address, results):
        with socket.create_connection(address) as client:
            client.sendall(struct.pack("<11i", 1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 256))
            assert _left(client)
    with pytest.raises((ValueError, TypeError), match=message):
        raise results[0]


def test_a_subdomain_with_another_number_of_dofs_or_a_load_is_refused():
    free = pm.Subdomain([1.0, 1.0], [1.0, 1.0], scheme=pm.Newmark(), name="two")
    loaded = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), force=[1.0], name="loaded")
    for what, message in (
        (free, "subdomain 'two' has 2 dofs, but the client announces 1"),
        (loaded, "subdomain 'loaded' must be without force"),
    ):
        with served(what) as (address, results):
            with Driver(address, 1) as client:
                assert client.is_left()
        with pytest.raises(ValueError, match=message):
            raise results[0]


@pytest.mark.parametrize(
    ("head", "message"),
    [
        ((-1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 256), "must lie in"),
        ((1, 2, 0, 0, 0, 0, 0, 0, 1, 0, 256), "the same number of values"),
        ((0,) * 10 + (256,), "the same number of values"),
        ((1, 0, 0, 0, 2, 0, 0, 0, 1, 0, 256), "time at most one"),
        ((300, 0, 0, 0, 1, 0, 0, 0, 300, 0, 256), "messages must have 302 to"),
        ((1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 2**30), "messages must have 2 to"),
    ],
)
def test_a_client_that_announces_nonsense_is_turned_away(head, message, caplog):
    with served(specimen) as (address, results):
        with socket.create_connection(address) as client:
            client.sendall(struct.pack("<11i", *head))
            assert _left(client)
        command(address)
    assert results == [1]
    why = f"does not speak the protocol of rigs: .*{message}"
    assert re.search(f"turned away .* {why}", caplog.text)


@pytest.mark.parametrize(
    ("behaviour", "error", "message"),
    [
        ("unknown", ConnectionError, "asks for 42, no action"),
        ("infinite", ValueError, "displacement must be finite"),
    ],
)
def test_a_client_that_misbehaves_ends_the_server(behaviour, error, message):
    with served(lambda t, u, v: 4.0 * u) as (address, results):
        with peer("drive", address[1], behaviour, 1) as process:
            process.wait(waits.LIMIT)
    with pytest.raises(error, match=message):
        raise results[0]


def test_a_matrix_that_does_not_fit_in_a_message_is_refused():
    with served(pm.CubicSpring([0], k=1.0, k3=0.0)) as (address, results):
        with Driver(address, 20) as client:
            client.send(13)
            assert client.is_left()
    with pytest.raises(ConnectionError, match="a matrix of 20 x 20 in messages of 256 doubles"):
        raise results[0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (dict(send=["force"]), "send must have"),
        (dict(send="displacement"), "send must be a list"),
        (dict(receive=["displacement"]), "receive must have"),
        (dict(receive=["strain"]), "receive must be a list"),
        (dict(byte_order="middle"), "byte_order must be"),
        (dict(timeout=0.0), "timeout must be positive"),
    ],
)
def test_bad_options_of_a_connection_are_refused_before_it_is_made(options, message):
    with pytest.raises(ValueError, match=message):
        rig.connect((LOCAL, 1), **options)


def test_an_address_is_a_host_and_a_port():
    with pytest.raises(TypeError, match="address must be a host and a port, .* got 'localhost:1'"):
        rig.connect("localhost:1")


# ---- who may connect -----------------------------------------------------------------------------


def test_both_sides_have_to_know_the_secret():
    with served(specimen, secret="two") as (address, results):
        with connected(address, secret=b"two") as there:
            assert there(0.0, np.ones(1), np.zeros(1))[0].shape == (1,)
    assert results == [1]
    with served(specimen, secret="two") as (address, results):
        with pytest.raises(ConnectionError, match="it may have another secret"):
            connected(address, secret="three", name="the rig")
        command(address, secret="two")
    assert results == [1]


def test_a_secret_with_zeros_after_it_is_another_one():
    with served(specimen, secret="two") as (address, results):
        with pytest.raises(ConnectionError, match="it may have another secret"):
            connected(address, secret="two\0")
        command(address, secret="two")
    assert results == [1]


def test_without_descriptors_the_wait_goes_on_and_does_not_spin(monkeypatch):
    """Two attempts without room, each of which is one pause; then the client is admitted."""
    attempts, pauses = [], []
    accept = socket.socket.accept

    def without_room(self):
        attempts.append(self)
        if len(attempts) <= 2:
            raise OSError(errno.EMFILE, "too many open files")
        return accept(self)

    monkeypatch.setattr(socket.socket, "accept", without_room)
    monkeypatch.setattr(admission, "sleep", pauses.append)
    with served(specimen, secret="two") as (address, results):
        command(address, secret="two")
    assert results == [1]
    assert pauses == 2 * [admission.PAUSE]


def command(address, **options):
    """A command by the client that is invited."""
    with connected(address, **options) as there:
        there(0.0, np.ones(1), np.zeros(1))


def test_the_server_shows_nothing_that_a_stranger_could_try_words_on():
    with served(specimen, secret="two") as (address, results):
        with socket.create_connection(address, waits.LIMIT) as stranger:
            nonce = stranger.recv(1000)
            stranger.sendall(bytes(64))  # no proof
            assert len(nonce) == 32 and _left(stranger)
        command(address, secret="two")
    assert results == [1]


def test_the_client_leaves_a_server_that_does_not_know_the_secret():
    with socket.create_server((LOCAL, 0)) as server:
        address = server.getsockname()

        def pretend():
            connection, _ = server.accept()
            with connection:
                connection.sendall(bytes(32))
                proof = b""
                while len(proof) < 64:
                    proof += connection.recv(64)
                connection.sendall(proof[32:])

        thread = threading.Thread(target=pretend)
        thread.start()
        with pytest.raises(ConnectionError, match="the rig does not know the secret"):
            connected(address, secret="two", name="the rig")
        thread.join()


def test_strangers_are_turned_away_and_the_next_client_is_served(caplog):
    with served(specimen, host="0.0.0.0", allow=["127.0.0.0/31"]) as (address, results):
        command(address)
    assert results == [1]
    assert "pmalpha.rig listens on 0.0.0.0" in caplog.text
    with served(specimen, allow=["127.0.0.2"]) as (address, results):
        with socket.create_connection(address, waits.LIMIT) as stranger:
            assert _left(stranger)
        allowed = socket.create_connection(address, waits.LIMIT, ("127.0.0.2", 0))
        allowed.sendall(struct.pack("<11i", 1, 0, 0, 0, 1, 1, 0, 0, 1, 0, 256))
        allowed.close()
    with pytest.raises(ConnectionError, match="127.0.0.2:.* closed the connection"):
        raise results[0]


@pytest.mark.parametrize("secret", [None, "two"])
def test_a_connection_that_is_not_the_clients_does_not_keep_the_client_out(secret, caplog):
    with served(specimen, secret=secret) as (address, results):
        with socket.create_connection(address, waits.LIMIT):  # it is silent to the end
            with socket.create_connection(address, waits.LIMIT) as stranger:
                greeting = stranger.recv(32) if secret else b""
                stranger.sendall(b"GET / HTTP/1.1\r\n" + bytes(100))
                assert len(greeting) in (0, 32) and _left(stranger)
            socket.create_connection(address, waits.LIMIT).close()
            command(address, secret=secret)
    assert results == [1] and caplog.text.count("turned away") >= 1


def test_without_a_client_the_wait_ends():
    silent = []

    def connect(port):
        silent.append(socket.create_connection((LOCAL, port), waits.LIMIT))

    for announce in (lambda port: None, connect):
        with pytest.raises(TimeoutError):
            rig.serve(specimen, timeout=0.05, announce=announce)
    assert _left(silent[0])
    silent[0].close()


@pytest.mark.parametrize(
    ("allow", "error", "message"),
    [
        ("127.0.0.11", TypeError, "allow must be a list of addresses"),
        (b"127.0.0.1", TypeError, "allow must be a list of addresses"),
        (["rig-pc"], ValueError, "allow must have numerical addresses.*got 'rig-pc'.*name"),
        (["10.0.0.12/24"], ValueError, "got '10.0.0.12/24': .*host bits"),
        ([], ValueError, "allow must have an address"),
        ([2130706433], TypeError, "allow must have addresses as text, got 2130706433"),
        ([b"\x7f\0\0\1"], TypeError, "allow must have addresses as text"),
    ],
)
def test_who_is_allowed_is_said_by_numerical_addresses(allow, error, message):
    heard = []
    with pytest.raises(error, match=message):
        rig.serve(specimen, allow=allow, announce=heard.append)
    assert not heard


def test_an_address_of_both_families_is_the_same_one():
    networks = admission.checked_networks(["10.0.0.0/24", "fe80::/16"])
    for address in ("10.0.0.1", "::ffff:10.0.0.1", "fe80::1%eth0"):
        assert admission.is_allowed(address, networks)
    for address in ("10.0.1.1", "::ffff:10.0.1.1", "::1"):
        assert not admission.is_allowed(address, networks)


def test_a_client_of_many_dofs_takes_no_memory_before_it_asks_for_a_matrix():
    n = 65536  # a dense matrix would have 34 GB
    with served(pm.CubicSpring([n - 1], k=4.0, k3=0.0)) as (address, results):
        with connected(address) as there:
            assert there(0.0, np.ones(n), np.zeros(n))[0][-1] == 4.0
    assert results == [1]


# ---- ends ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [0, 1, 4, 7])
def test_a_client_that_is_killed_is_named(k):
    behaviour = ("die", "half")[k % 2]
    with served(lambda t, u, v: 4.0 * u) as (address, results):
        with peer("drive", address[1], behaviour, k):
            waits.until(lambda: results)
    with pytest.raises(ConnectionError, match="closed the connection|was lost"):
        raise results[0]


# before the first macro step, after it, and later; all of them in the campaigns
KILLS = [k if k in (1, 2, 7) else pytest.param(k, marks=pytest.mark.campaign) for k in range(1, 11)]


@pytest.mark.gate
@pytest.mark.parametrize("k", KILLS)
def test_a_coupler_that_is_killed_is_named_by_the_server_of_its_specimen(k):
    commands = []

    def specimen(t, u, v):
        commands.append(t)
        return 4.0 * u

    with served(specimen) as (address, results):
        with peer("couple", address[1], k) as process:
            assert process.wait(waits.LIMIT) == -signal.SIGKILL
            waits.until(lambda: results)
    with pytest.raises(ConnectionError, match="closed the connection|was lost"):
        raise results[0]
    # an evaluation at the start and in each step before, and in this one if it comes first
    assert len(commands) in (k, k + 1)


@pytest.mark.gate
@pytest.mark.parametrize("k", KILLS)
def test_a_served_specimen_that_is_killed_leaves_the_coupler_at_its_last_macro_step(k):
    with serving_peer(k, mode="serve-own") as address:
        coupler = pm.Coupler([mass(connected(address))], dt=0.01)
        with pytest.raises(ConnectionError, match="the rig (closed the connection|was lost)"):
            coupler.run(2.0)
        assert coupler.step_count == max(0, k - 2)


def test_a_client_that_ends_is_no_error():
    with served(lambda t, u, v: 4.0 * u) as (address, results):
        with peer("drive", address[1], "end", 5):
            waits.until(lambda: results)
    assert results == [5]


@pytest.mark.parametrize("k", [1, 2, 5, 10])
def test_a_rig_that_is_killed_leaves_the_coupler_at_its_last_macro_step(k):
    with serving_peer(("die", "half")[k % 2], 3 * k) as address:
        there = connected(address)
        subdomain = mass(there, substeps=4)
        coupler = pm.Coupler([subdomain], dt=0.04)
        with pytest.raises(ConnectionError, match="the rig (closed the connection|was lost)"):
            coupler.run(2.0)
        done = (3 * k - 2) // 4  # one evaluation at t = 0, four in each macro step
        assert coupler.step_count == done and there.calls == 3 * k - 1
        assert coupler.last_history is None or coupler.last_history.macro_times.size == done + 1
        local = pm.Coupler([mass(lambda t, u, v: 4.0 * u, substeps=4)], dt=0.04)
        local.step(done)
        np.testing.assert_array_equal(coupler.state("m").u, local.state("m").u)
        with pytest.raises(ConnectionError, match="the connection to the rig is closed"):
            coupler.step()
        there.close()  # nothing left to do


def test_a_rig_that_sends_more_than_was_asked_for_ends_the_run():
    with serving_peer("more", 5) as address:
        there = connected(address)
        coupler = pm.Coupler([mass(there)], dt=0.01)
        coupler.step(4)
        there.link.connection.recv(1, socket.MSG_PEEK)  # until it is here
        with pytest.raises(ConnectionError, match="the rig sends more than was asked for"):
            coupler.step()
        assert coupler.step_count == 4


def test_a_silent_rig_is_a_timeout():
    with serving_peer("silent", 2) as address:
        coupler = pm.Coupler([mass(connected(address, timeout=0.2))], dt=0.01)
        with pytest.raises(TimeoutError, match=r"no reply of the rig within 0\.2 s"):
            coupler.run(1.0)
        assert coupler.step_count == 0


def test_a_silent_client_is_a_timeout():
    with served(specimen, timeout=0.2) as (address, results):
        with socket.create_connection(address):
            waits.until(lambda: results)
    with pytest.raises(TimeoutError, match=r"no client within 0\.2 s"):
        raise results[0]


def test_without_a_rig_there_is_no_connection():
    with socket.create_server((LOCAL, 0)) as taken:
        address = taken.getsockname()
    with pytest.raises(ConnectionError):
        rig.connect(address)


def test_an_exception_of_a_served_function_ends_both_sides():
    def broken(t, u, v):
        raise RuntimeError("torn off")

    with served(broken) as (address, results):
        with connected(address) as there, pytest.raises(ConnectionError, match="the rig"):
            there(0.0, np.ones(1), np.zeros(1))
    with pytest.raises(RuntimeError, match="torn off"):
        raise results[0]
