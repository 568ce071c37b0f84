"""Strangers on a connection of rig.remote: wrong bytes, half messages, huge lengths, sudden ends.

A stranger takes the place of the client or of the server. Its bytes are those of good messages with
damage, in pieces of any size, and it may stop, close or reset the connection at any of them. The
side of pmalpha returns or raises a documented exception; the served function is called with
arrays of float64 alone, and no memory is taken for bytes that did not come (the child process of
campaign_input.py has a limit).
"""

import socket
import struct
import threading
from functools import partial
from queue import Queue
from time import monotonic

import campaign_input
import numpy as np
from entries import one

from pmalpha.rig import calls as remote

WAIT = 0.05  # s, the timeout of a side whose stranger falls silent
LIMIT = 600.0  # s, the other timeouts, which only a hang takes
SILENT = 0.2  # of the strangers
DOCUMENTED = (ConnectionError, TimeoutError, remote.RemoteError)


def message(rng, kind, number):
    """The bytes of a good message."""
    arrays = one(rng, (), (1.0,), (np.arange(6.0).reshape(2, 3), [np.nan]), (np.zeros((0, 3)),))
    if kind == remote.FAILURE:
        arrays = (np.frombuffer("TypeError: é".encode(), np.uint8),)
    return remote._message(kind, number, arrays)


def forged(rng, kind, number):
    """A message whose length, head or shape claims something else."""
    mark = one(rng, remote.MARK, remote.MARK, remote.MARK, b"else")
    kind, number = one(rng, kind, kind, 0, 1, 2, 255), one(rng, number, number, 0, 2, 2**64 - 1)
    claim = one(rng, 0, 1, 2**31, 2**40, 2**63, 2**64 - 1)
    arrays = one(
        rng,
        b"",
        b"\xff",
        struct.pack("!B2Q", 2, one(rng, 0, 1, 2**62), claim),
        struct.pack("!B2d", 0, one(rng, 1.0, np.nan, -1.0, 1e300), 0.0),
    )
    body = remote.HEAD.pack(mark, kind, number, one(rng, 0, 1, 1, 1, 2)) + arrays
    return remote.LENGTH.pack(one(rng, *4 * [len(body)], claim)) + body


def damaged(rng, data):
    """Bytes with one of them changed, some lost, or others in front."""
    i, kind = int(rng.integers(len(data))), int(rng.integers(5))
    if kind == 0:
        return data[:i]
    if kind == 1:
        return data[:i] + rng.bytes(1) + data[i + 1 :]
    if kind == 2:
        return data[:i] + data[i + int(rng.integers(1, 9)) :]
    if kind == 3:
        return rng.bytes(int(rng.integers(1, 40))) + data
    return data


def stream(rng, kind):
    """What a stranger sends: some messages, the last ones with damage."""
    pieces = [message(rng, kind, 1) for _ in range(int(rng.integers(3)))]
    spoil = forged if rng.random() < 0.4 else lambda *x: damaged(rng, message(*x))
    return b"".join([*pieces, spoil(rng, one(rng, kind, remote.FAILURE, remote.CALL), 1)])


def talk(rng, connection, data, silent):
    """Send in pieces, read some of what comes, and end in one of several ways, or not."""
    cut = sorted(rng.integers(len(data) + 1, size=int(rng.integers(4))))
    try:
        for begin, end in zip([0, *cut], [*cut, len(data)]):
            connection.sendall(data[begin:end])
        end = 3 if silent else int(rng.integers(3))
        if end == 0:  # reset
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        elif end == 1:
            connection.shutdown(socket.SHUT_WR)
        if end > 0:
            connection.settimeout(LIMIT if end != 2 else 0.001)
            while connection.recv(1 << 16):
                pass
    except OSError:  # the other side has ended it
        pass
    finally:
        connection.close()


def outcome(call):
    """(what came out, the fault or None) of one side."""
    begin = monotonic()
    try:
        call()
        what, fault = "works", None
    except DOCUMENTED as error:
        what, fault = type(error).__name__, None if str(error) else "an error without a message"
    except Exception as error:
        what = type(error).__name__
        fault = f"{what}: {error}"
    late = monotonic() - begin > LIMIT
    return what, "it took too long" if late and fault is None else fault


def against_server(rng):
    """A stranger calls a function that is served."""
    opened, found, wrong, silent = Queue(), [], [], rng.random() < SILENT

    def function(*x):
        wrong.extend(y for y in x if type(y) is not np.ndarray or y.dtype != np.float64)
        return one(rng, 1.0, (np.zeros(3), 2.0), "text", np.zeros(300_000))

    def connect(port):
        """Before the server begins to wait, so that its timeout cannot pass first."""
        opened.put(socket.create_connection(("127.0.0.1", port)))

    def run():
        wait = WAIT if silent else LIMIT
        found.append(outcome(lambda: remote.serve(function, timeout=wait, announce=connect)))

    thread = threading.Thread(target=run)
    thread.start()
    talk(rng, opened.get(), stream(rng, remote.CALL), silent)
    thread.join()
    what, fault = found[0]
    return what, f"called with {wrong}" if wrong else fault


def against_client(rng):
    """A stranger replies to a client."""
    data, silent = stream(rng, remote.RESULT), rng.random() < SILENT
    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=lambda: talk(rng, server.accept()[0], data, silent))
        thread.start()
        try:
            with remote.Client(server.getsockname(), timeout=WAIT if silent else LIMIT) as client:
                found = [outcome(lambda: client(1.0)) for _ in range(int(rng.integers(1, 4)))]
        except ConnectionError:  # reset before it was made
            found = [("no connection", None)]
        thread.join()
    faults = [fault for _, fault in found if fault is not None]
    return found[0][0], faults[0] if faults else None


def attempt(seed, counts):
    """One connection; the fault that was found, or None."""
    rng = np.random.default_rng([seed, 17])
    side = one(rng, against_server, against_client)
    what, fault = side(rng)
    counts["calls"] += 1
    counts[what] += 1
    return None if fault is None else f"{side.__name__}: {fault}"


campaign = partial(campaign_input.campaign, script=__file__)

if __name__ == "__main__":
    campaign_input.main(__doc__, attempt, __file__)
