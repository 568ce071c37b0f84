"""A simulated test rig: an actuator with delay and noise that loads a yielding specimen.

It replaces a laboratory: a separate process that receives commands over TCP. It prints the port on
which it listens and serves one client. `python simulated_rig.py --help` lists the options.

    command    number, t, displacement      !Qdd
    reply      number, measured force       !Qd
    when the client has closed its side: 0, k and the k commands in the order received
"""

import argparse
import random
import socket
import struct
import time
from bisect import bisect_right

COMMAND, REPLY = struct.Struct("!Qdd"), struct.Struct("!Qd")


class Yielding:
    """Force of a spring with kinematic hardening, stiffness k up to fy and hardening k beyond."""

    def __init__(self, k, fy, hardening):
        self.k, self.fy = k, fy
        self.back = hardening * k / (1.0 - hardening)  # back stress per plastic deformation
        self.plastic = 0.0

    def __call__(self, d):
        trial = self.k * (d - self.plastic) - self.back * self.plastic
        beyond = abs(trial) - self.fy
        if beyond > 0.0:
            self.plastic += (beyond if trial > 0.0 else -beyond) / (self.k + self.back)
        return self.k * (d - self.plastic)


class Actuator:
    """Position of the piston: the command of `delay` ago, linear between commands."""

    def __init__(self, delay):
        self.delay, self.times, self.commands = delay, [], []

    def __call__(self, t, d):
        while self.times and self.times[-1] >= t:  # repeated command: the later one counts
            self.times.pop()
            self.commands.pop()
        self.times.append(t)
        self.commands.append(d)
        if self.delay == 0.0:
            return d
        t -= self.delay
        right = bisect_right(self.times, t)
        if right == 0:
            return self.commands[0]
        t0, t1 = self.times[right - 1 : right + 1]
        d0, d1 = self.commands[right - 1 : right + 1]
        return d0 + (d1 - d0) * (t - t0) / (t1 - t0)


def commands(connection):
    """The commands of the client, until it closes its side."""
    data = b""
    while more := connection.recv(4096):
        data += more
        while len(data) >= COMMAND.size:
            yield COMMAND.unpack(data[: COMMAND.size])
            data = data[COMMAND.size :]


def serve(connection, actuator, specimen, noise, wait):
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    log = []
    for number, t, d in commands(connection):
        log.append(COMMAND.pack(number, t, d))
        time.sleep(wait)
        force = specimen(actuator(t, d)) + noise()
        connection.sendall(REPLY.pack(number, force))
    connection.sendall(REPLY.pack(0, len(log)) + b"".join(log))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for option, value in (("k", 1.0), ("fy", 1.0), ("hardening", 0.0)):
        parser.add_argument(f"--{option}", type=float, default=value, help="of the specimen")
    parser.add_argument("--delay", type=float, default=0.0, help="of the actuator, in units of t")
    parser.add_argument("--noise", type=float, default=0.0, help="of the force, standard deviation")
    parser.add_argument("--seed", type=int, default=0, help="of the noise")
    parser.add_argument("--wait", type=float, default=0.0, help="seconds until it replies")
    parser.add_argument("--timeout", type=float, default=60.0, help="seconds, for the client")
    args = parser.parse_args()
    generator = random.Random(args.seed)
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(args.timeout)
        print(server.getsockname()[1], flush=True)
        connection, _ = server.accept()
    with connection:
        connection.settimeout(args.timeout)
        actuator = Actuator(args.delay)
        specimen = Yielding(args.k, args.fy, args.hardening)
        serve(connection, actuator, specimen, lambda: generator.gauss(0.0, args.noise), args.wait)


if __name__ == "__main__":
    main()
