"""The other side of a rig: a program that dies or misbehaves.

By the standard library alone:

serve BEHAVIOUR K      prints its port; replies r = 4 u, x = u, and at request K what it is told
drive PORT BEHAVIOUR K sends K steps of one dof, and then what it is told

By pmalpha:
serve-own K            prints its port; a specimen r = 4 u that dies in its evaluation K
couple PORT K          a mass on the specimen there, which dies in step K
"""

import os
import signal
import socket
import struct
import sys

DOUBLES = 256


def die():
    os.kill(os.getpid(), signal.SIGKILL)


def exactly(connection, size):
    data = b""
    while len(data) < size:
        more = connection.recv(size - len(data))
        if not more:
            sys.exit(1)
        data += more
    return data


def doubles(*values):
    return struct.pack(f"<{DOUBLES}d", *values, *[0.0] * (DOUBLES - len(values)))


def serve(behaviour, k):
    with socket.create_server(("127.0.0.1", 0)) as server:
        print(server.getsockname()[1], flush=True)
        connection, _ = server.accept()
    head = struct.unpack("<11i", exactly(connection, 44))
    assert head[10] == DOUBLES
    asked, u = 0, 0.0
    while True:
        action, *values = struct.unpack(f"<{DOUBLES}d", exactly(connection, 8 * DOUBLES))
        if action == 99.0:
            return
        if action == 3.0:
            u = values[0]
        if action == 10.0:
            asked += 1
            last = asked == k
            if last and behaviour == "die":
                die()
            if last and behaviour == "half":
                connection.sendall(doubles(u, 4.0 * u)[:1000])
                die()
            if last and behaviour == "silent":
                connection.recv(1)
                return
            connection.sendall(doubles(u, 4.0 * u))
            if last and behaviour == "more":
                connection.sendall(b"x")


def drive(port, behaviour, k):
    connection = socket.create_connection(("127.0.0.1", int(port)))
    if behaviour == "http":
        connection.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nAccept: */*\r\n\r\n")
        exactly(connection, 1)
    connection.sendall(struct.pack("<11i", 1, 1, 1, 0, 1, 0, 0, 0, 1, 0, DOUBLES))
    for step in range(1, k + 1):
        trial = (0.1 * step, 1.0, 0.0, 0.01 * step)
        connection.sendall(doubles(3.0, *trial))
        connection.sendall(doubles(10.0))
        (force,) = struct.unpack("<d", exactly(connection, 8 * DOUBLES)[:8])
        assert abs(force - 0.4 * step) < 1e-12
        connection.sendall(doubles(5.0, *trial))
    if behaviour == "die":
        die()
    if behaviour == "half":
        connection.sendall(doubles(3.0)[:100])
        die()
    if behaviour == "unknown":
        connection.sendall(doubles(42.0))
    if behaviour == "infinite":
        connection.sendall(doubles(3.0, float("inf")))
    if behaviour == "end":
        connection.sendall(doubles(99.0))
    exactly(connection, 1)  # until the server has gone


def serve_own(k):
    from pmalpha import rig

    calls = []

    def specimen(t, u, v):
        calls.append(t)
        if len(calls) == k:
            die()
        return 4.0 * u

    rig.serve(specimen, announce=lambda port: print(port, flush=True))


def couple(port, k):
    import pmalpha as pm

    def load(t, u, v):
        if t > (k - 0.5) * 0.01:
            die()
        return 0.0 * u

    there = pm.rig.connect(("127.0.0.1", port))
    scheme = pm.CentralDifference()
    mass = pm.Subdomain([1.0], None, scheme=scheme, v0=[1.0], force=load, restoring=there)
    pm.Coupler([mass], dt=0.01).run(1.0)


if __name__ == "__main__":
    if sys.argv[1] == "serve-own":
        serve_own(int(sys.argv[2]))
    elif sys.argv[1] == "couple":
        couple(int(sys.argv[2]), int(sys.argv[3]))
    elif sys.argv[1] == "serve":
        serve(sys.argv[2], int(sys.argv[3]))
    else:
        drive(sys.argv[2], sys.argv[3], int(sys.argv[4]))
