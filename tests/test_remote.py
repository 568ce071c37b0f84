"""Functions of other processes, and what can happen to them."""

import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from queue import Queue

import numpy as np
import pytest
import waits

import pmalpha as pm
from pmalpha.rig import calls as remote

TWICE = "from pmalpha.rig.calls import serve; serve(lambda x: 2.0 * x, timeout=600.0)"


@pytest.fixture
def served():
    """Serves functions in threads; yields a function that makes a client of one."""
    threads, clients, results = [], [], []

    def client(function, timeout=waits.LIMIT, **options):
        ports = Queue()

        def run():
            try:
                results.append(remote.serve(function, announce=ports.put, **options))
            except OSError as error:
                results.append(error)

        threads.append(threading.Thread(target=run))
        threads[-1].start()
        clients.append(remote.Client(("127.0.0.1", ports.get()), timeout=timeout, name="the rig"))
        return clients[-1]

    client.results = results
    yield client
    for each in clients:
        each.close()
    for thread in threads:
        thread.join(waits.LIMIT)
        assert not thread.is_alive()


def test_numbers_and_arrays_come_back_unchanged(served):
    client = served(lambda *x: x)
    sent = np.pi, np.arange(6.0).reshape(2, 3), [np.nan, -np.inf, -0.0, 5e-324], np.zeros((0, 3))
    for one, other in zip(sent, client(*sent), strict=True):
        assert other.dtype == np.float64 and other.shape == np.shape(one)
        assert other.tobytes() == np.asarray(one, dtype=np.float64).tobytes()
    big = np.random.default_rng(0).standard_normal(300_000)  # many pieces of the stream
    np.testing.assert_array_equal(client(big), big)
    assert client(3).shape == () and client.number == 3
    assert repr(client) == "<Client of the rig, 3 calls>"
    client.close()


def test_the_number_of_calls_is_returned(served):
    client = served(lambda: 1.0)
    assert [client(), client()] == [1.0, 1.0]
    client.close()
    waits.until(lambda: served.results)
    assert served.results == [2]


def test_a_served_specimen_gives_the_run_of_a_local_one(served):
    def specimen(t, u, v):
        return 4.0 * u + 0.1 * v**3

    def run(restoring):
        mass = pm.Subdomain([1.0], None, scheme=pm.Newmark(), restoring=restoring, u0=[1.0])
        return pm.solve(mass, 0.01, 0.5).u

    np.testing.assert_array_equal(run(served(specimen)), run(specimen))


def test_an_exception_of_the_function_is_raised_here_and_the_next_call_is_served(served):
    client = served(lambda x: np.sqrt(x) if x >= 0.0 else (_ for _ in ()).throw(ValueError("no")))
    with pytest.raises(remote.RemoteError, match="the rig at call 1: ValueError: no"):
        client(-1.0)
    assert client(4.0) == 2.0
    assert issubclass(remote.RemoteError, pm.PmalphaError)


def test_what_no_message_can_have_is_refused_on_both_sides(served):
    client = served(lambda x: "text")
    with pytest.raises(TypeError, match="only real numbers and arrays of them can be sent, got 'a"):
        client("a")
    with pytest.raises(remote.RemoteError, match="only real numbers and arrays of them"):
        client(1.0)
    with pytest.raises(ValueError, match="up to 255 arrays, got 256"):
        client(*range(256))
    assert client.number == 1


def test_a_late_reply_is_a_timeout_and_then_skipped(served):
    released = threading.Event()

    def slow(x):
        if x == 1.0:
            released.wait(waits.LIMIT)
        return x

    client = served(slow)
    client._messages.timeout = 0.2
    with pytest.raises(TimeoutError, match="no reply of the rig to call 1"):
        client(1.0)
    released.set()
    client._messages.timeout = waits.LIMIT
    assert client(2.0) == 2.0


@pytest.mark.gate
def test_a_server_that_dies_is_named():
    with remote.started([sys.executable, "-c", TWICE]) as (address, process):
        client = remote.Client(address, name="the rig")
        assert client(2.0) == 4.0
        process.kill()
        process.wait()
        with pytest.raises(ConnectionError, match="the rig was lost at call 2"):
            client(2.0)
        client.close()


@pytest.mark.gate
def test_a_program_ends_when_its_client_has_closed():
    with remote.started([sys.executable, "-c", TWICE]) as (address, process):
        with remote.Client(address) as client:
            np.testing.assert_array_equal(client([1.0, 2.0]), [2.0, 4.0])
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("program", "got"), [("print('hello')", "b'hello'"), ("print(10**6 * 'x')", "b'x{64}'$")]
)
def test_a_program_without_a_port_is_refused(tmp_path, program, got):
    (tmp_path / "other.py").write_text(program)
    with pytest.raises(ConnectionError, match=f"must print its port first, got {got}"):
        with remote.started([tmp_path / "other.py"]):
            pass


@pytest.mark.parametrize("program", ["exec sleep 60", "printf 12; exec sleep 60"])
def test_a_program_that_never_prints_a_port_is_ended_in_time(program, monkeypatch):
    made, popen = [], subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", lambda *x, **y: made.append(popen(*x, **y)) or made[0])
    with pytest.raises(TimeoutError, match=r"must print its port first, nothing in 0\.2 s"):
        with remote.started(["sh", "-c", program], timeout=0.2):
            pass
    assert made[0].returncode == -signal.SIGKILL  # ended and reaped
    assert made[0].stdout.closed


def test_a_process_that_the_program_has_started_is_not_waited_for(tmp_path):
    program = f"sleep 60 & echo $! >{tmp_path / 'number'}; exec sleep 60"
    number = tmp_path / "number"
    for timeout in (0.2, 2.0, 20.0, 200.0):  # on a busy machine the shell has not come so far
        with pytest.raises(TimeoutError, match="must print its port first"):
            with remote.started(["sh", "-c", program], timeout=timeout):
                pass
        if number.exists() and number.read_text():
            break
    os.kill(int(number.read_text()), signal.SIGKILL)  # it is still there


def test_a_program_that_does_not_end_is_killed_after_its_block(monkeypatch):
    # a busy machine may take longer to print the port
    first_line = remote._first_line
    monkeypatch.setattr(remote, "_first_line", lambda stream, _: first_line(stream, waits.LIMIT))
    with pytest.raises(TimeoutError, match=r"has not ended 0\.1 s after its block"):
        with remote.started(["sh", "-c", "echo 5; exec sleep 60"], timeout=0.1) as (_, process):
            pass
    assert process.returncode == -signal.SIGKILL


def test_what_a_program_prints_at_its_end_does_not_hold_it_up():
    program = "print(5, flush=True); print(1_000_000 * 'x')"  # more than a pipe holds
    with remote.started([sys.executable, "-c", program]) as (_, process):
        pass
    assert process.returncode == 0


def test_a_silent_client_is_a_timeout():
    ports, errors = Queue(), []

    def run():
        try:
            remote.serve(lambda: 1.0, timeout=0.2, announce=ports.put)
        except TimeoutError as error:
            errors.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    with socket.create_connection(("127.0.0.1", ports.get())):
        thread.join(waits.LIMIT)
    assert len(errors) == 1


def test_a_silent_connection_does_not_keep_the_client_out():
    ports, calls = Queue(), []

    def run():
        calls.append(remote.serve(lambda: 1.0, timeout=waits.LIMIT, announce=ports.put))

    thread = threading.Thread(target=run)
    thread.start()
    address = "127.0.0.1", ports.get()
    with socket.create_connection(address), socket.create_connection(address):
        with remote.Client(address, timeout=waits.LIMIT) as client:
            assert client() == 1.0
        thread.join(waits.LIMIT)
        assert calls == [1]


HEAD = struct.Struct("!4sBQB")


@pytest.mark.parametrize(
    "sent",
    [
        b"GET / HTTP/1.1\r\n\r\n",  # its first bytes are a huge length
        struct.pack("!Q", 3) + b"abc",
        struct.pack("!Q", HEAD.size) + HEAD.pack(b"else", 0, 1, 0),
        struct.pack("!Q", HEAD.size) + HEAD.pack(b"pmr1", 9, 1, 0),
        struct.pack("!Q", HEAD.size) + HEAD.pack(b"pmr1", 0, 1, 1),  # an array that is not there
        struct.pack("!Q", HEAD.size + 9) + HEAD.pack(b"pmr1", 0, 1, 1) + b"\x01" + b"\xff" * 8,
        struct.pack("!Q", HEAD.size + 1) + HEAD.pack(b"pmr1", 0, 1, 1) + b"\xff",
        struct.pack("!Q", 100) + b"half a message",
    ],
)
def test_a_stranger_makes_the_server_neither_execute_nor_allocate(sent):
    ports, found, called = Queue(), [], []

    def run():
        try:
            remote.serve(lambda *x: called.append(x), timeout=waits.LIMIT, announce=ports.put)
        except Exception as error:
            found.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    with socket.create_connection(("127.0.0.1", ports.get())) as stranger:
        stranger.sendall(sent)
        stranger.shutdown(socket.SHUT_WR)
        thread.join(waits.LIMIT)
    assert not thread.is_alive() and not called
    assert [type(error) for error in found] == [ConnectionError]


def test_without_a_server_there_is_no_client():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = taken.getsockname()
    with pytest.raises(ConnectionError):
        remote.Client(address)


def replied(sent, timeout=waits.LIMIT, pause=0.0):
    """What a client raises whose server sends these bytes."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def run():
            connection, _ = server.accept()
            with connection:
                connection.recv(1 << 16)
                try:
                    for k in range(len(sent)) if pause else [slice(None)]:
                        connection.sendall(sent[k : k + 1] if pause else sent)
                        time.sleep(pause)  # so that the whole takes hours
                    while connection.recv(4096):  # what the client sends, until it goes
                        pass
                except OSError:  # the client has gone
                    pass

        thread = threading.Thread(target=run)
        thread.start()
        with remote.Client(server.getsockname(), timeout=timeout, name="the rig") as client:
            with pytest.raises((OSError, pm.PmalphaError)) as found:
                client(1.0)
        thread.join(waits.LIMIT)
        assert not thread.is_alive()
    return found.value


def reply(kind, number=1, count=0, rest=b""):
    body = HEAD.pack(b"pmr1", kind, number, count) + rest
    return struct.pack("!Q", len(body)) + body


@pytest.mark.parametrize(
    ("sent", "error", "words"),
    [
        (reply(2), remote.RemoteError, "the rig at call 1: "),
        (reply(2, 1, 1, b"\0" + struct.pack("!d", np.nan)), remote.RemoteError, r"call 1: \?"),
        (reply(0), ConnectionError, "the rig sent no reply to call 1"),
        (reply(1, 2**64 - 1), ConnectionError, "the rig sent no reply to call 1"),
        (
            reply(1, 1, 1, struct.pack("!B2Q", 2, 0, 2**64 - 1)),
            ConnectionError,
            "the rig was lost at call 1: the message is none",
        ),
        (100 * reply(1, 0), TimeoutError, "no reply of the rig to call 1"),
    ],
)
def test_a_stranger_that_replies_ends_the_call(sent, error, words):
    found = replied(sent, 0.2 if error is TimeoutError else waits.LIMIT)
    assert isinstance(found, error)
    with pytest.raises(error, match=words):
        raise found


def test_a_reply_that_drips_is_a_timeout():
    # each byte comes in time, until the client has gone
    found = replied(reply(1, 1, 1, b"\0" + 800_000 * b"\0"), timeout=0.3, pause=0.1)
    assert isinstance(found, TimeoutError)


class Unspeakable(Exception):
    def __str__(self):
        raise RuntimeError("no text")


@pytest.mark.parametrize(
    ("error", "text"),
    [(ValueError("file \udcff"), r"ValueError: file \\udcff"), (Unspeakable(), "Unspeakable")],
)
def test_an_exception_whose_text_cannot_be_sent_does_not_end_the_server(served, error, text):
    def fail(x):
        raise error

    client = served(fail)
    for _ in range(2):
        with pytest.raises(remote.RemoteError, match=text):
            client(1.0)


def test_connections_that_are_closed_without_a_word_do_not_end_the_server():
    """As those of a program that looks for open ports; also a reset is none."""
    ports, results = Queue(), []
    thread = threading.Thread(
        target=lambda: results.append(remote.serve(lambda x: 2.0 * x, announce=ports.put))
    )
    thread.start()
    address = "127.0.0.1", ports.get()
    for linger in (None, struct.pack("ii", 1, 0)):
        with socket.create_connection(address, waits.LIMIT) as stranger:
            if linger:
                stranger.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
    with remote.Client(address, timeout=waits.LIMIT) as double:
        assert double(4.0) == 8.0
    thread.join(waits.LIMIT)
    assert results == [1]


def test_a_client_without_calls_ends_the_server(served):
    served(lambda x: x).close()
