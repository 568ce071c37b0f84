"""A hybrid test: the frame is computed, its lowest columns stand in a (simulated) test rig.

Four storeys under El Centro 1940. The frame is implicit with the double step, dt = 10 ms; the
columns of the first storey yield and are tested: explicit, ten substeps of 1 ms, each of which
sends a displacement to the rig and gets the measured force back. The rig is another process behind
a socket; here it simulates an actuator and a specimen. `python examples/rig.py` runs six seconds
against the clock.
"""

import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from simulated_rig import COMMAND, REPLY

import pmalpha as pm
from pmalpha import models

# N, kg, m, s
m, k = np.full(4, 20e3), np.full(4, 30e6)
specimen = dict(k=30e6, fy=150e3, hardening=0.05)
dt, substeps = 0.01, 10


class Rig:
    """r(u, v, t) of a specimen in a laboratory: a displacement goes out, a force comes back."""

    def __init__(self, address, timeout=5.0):
        self.connection = socket.create_connection(address, timeout)
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.received, self.number = b"", 0

    def __call__(self, u, v, t):
        self.number += 1
        answered = 0
        try:
            self.connection.sendall(COMMAND.pack(self.number, t, u[0]))
            while answered < self.number:  # Ctrl-C may have left an answer nobody waited for
                answered, force = REPLY.unpack(self.receive(REPLY.size))
        except TimeoutError as error:
            raise TimeoutError(f"no answer of the rig to command {self.number}") from error
        except ConnectionError as error:
            raise ConnectionError(f"the rig was lost at command {self.number}") from error
        return [force]

    def receive(self, size):
        while len(self.received) < size:
            more = self.connection.recv(4096)
            if not more:
                raise ConnectionError("the rig has closed the connection")
            self.received += more
        data, self.received = self.received[:size], self.received[size:]
        return data

    def close(self):
        """Says that this was all; the commands as the rig got them, (k, 3): number, t, d."""
        self.connection.shutdown(socket.SHUT_WR)
        with self.connection:
            number = None
            while number != 0:  # the log has number 0
                number, count = REPLY.unpack(self.receive(REPLY.size))
            log = self.receive(int(count) * COMMAND.size)
        return np.array(list(COMMAND.iter_unpack(log)))


@contextmanager
def simulated_rig(**options):
    """A rig in a process of its own: its address and the process, which ends with the block."""
    program = Path(__file__).with_name("simulated_rig.py")
    words = [f"--{name}={value}" for name, value in options.items()]
    process = subprocess.Popen([sys.executable, program, *words], stdout=subprocess.PIPE)
    try:
        yield ("127.0.0.1", int(process.stdout.readline())), process
        process.wait(timeout=5.0)  # it ends by itself when its client has said all
    finally:
        process.kill()
        process.communicate()


def hybrid(restoring, dt=dt, **options):
    """Frame and specimen; each has half of the first floor."""
    record, record_step = models.el_centro()
    M, K = models.shear_frame([m[0] / 2, *m[1:]], [0.0, *k[1:]])  # floats on the specimen
    frame = pm.Subdomain(
        M,
        K,
        0.002 * K,
        scheme=pm.GeneralizedAlpha(0.8),
        double_step=True,
        force=pm.BaseAcceleration(record, record_step, np.ones(4), M),
        name="frame",
    )
    rig = pm.Subdomain(
        m[:1] / 2,
        None,
        scheme=pm.GeneralizedAlpha(0.8, explicit=True),
        substeps=substeps,
        force=pm.BaseAcceleration(record, record_step, np.ones(1), m[:1] / 2),
        restoring=restoring,
        restoring_stiffness=[specimen["k"]],
        name="rig",
    )
    return pm.Coupler([rig, frame], pm.tie(frame, [0], rig, [0]), dt=dt, **options)


def paced(coupler, steps, period):
    """Macro steps, one each `period` seconds: how late each began, how long it took."""
    late, took = np.empty((2, steps))
    begin = time.perf_counter()
    for n in range(steps):
        due = begin + n * period
        time.sleep(max(0.0, due - time.perf_counter()))
        started = time.perf_counter()
        coupler.step()
        late[n], took[n] = started - due, time.perf_counter() - started
    return late, took


def main(steps=600):
    with simulated_rig(**specimen, delay=2e-3, noise=200.0) as (address, _):
        rig = Rig(address)
        coupler = hybrid(rig)
        late, took = paced(coupler, steps, dt)
        commands = rig.close()
    drift = 1e3 * np.abs(commands[:, 2]).max()
    print(
        f"{coupler.time:g} s, {len(commands)} commands, largest drift of the columns {drift:.1f} mm"
    )
    for what, seconds in (("begins late by", late), ("takes", took)):
        middle, most, last = 1e3 * np.quantile(seconds, [0.5, 0.99, 0.999])
        print(f"a macro step {what} {middle:.2f} ms, p99 {most:.2f}, p99.9 {last:.2f}")


if __name__ == "__main__":
    main()
