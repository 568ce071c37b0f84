"""A hybrid test: the frame is computed, its lowest columns are tested in a (simulated) test rig.

Four storeys under El Centro 1940. The frame is implicit with the double step, dt = 10 ms. The
columns of the first storey yield and are the specimen: explicit, ten substeps of 1 ms, each of
which sends a displacement to the rig and receives the measured force. The rig is another process
behind a socket; here it simulates an actuator and a specimen. `python examples/rig.py` runs six
seconds in real time.
"""

import time
from pathlib import Path

import numpy as np

import pmalpha as pm
from pmalpha import models

# N, kg, m, s
m, k = np.full(4, 20e3), np.full(4, 30e6)
specimen = dict(k=30e6, fy=150e3, hardening=0.05)
dt, substeps = 0.01, 10


class Rig:
    """r(t, u, v) of a specimen in a laboratory: sends a displacement, receives a force."""

    def __init__(self, address, timeout=5.0):
        self.client = pm.rig.Client(address, timeout=timeout, name="the rig")

    def __call__(self, t, u, v):
        return self.client(t, u)

    @property
    def number(self):
        """Commands sent."""
        return self.client.number

    def close(self):
        """Ends the test. Returns the commands received by the rig, (k, 3): number, t, d."""
        with self.client:
            return self.client()


def simulated_rig(**options):
    """A rig in a separate process, which ends with the block: its address and the process."""
    program = Path(__file__).with_name("simulated_rig.py")
    return pm.rig.started([program, *(f"--{name}={x}" for name, x in options.items())])


def hybrid(restoring, dt=dt, coupling="pm", **options):
    """Frame and specimen; each has half of the first floor."""
    record, record_step = models.el_centro()
    M, K = models.shear_frame([m[0] / 2, *m[1:]], [0.0, *k[1:]])  # floating without the specimen
    frame = pm.Subdomain(
        M,
        K,
        C=0.002 * K,
        scheme=pm.GeneralizedAlpha(0.8),
        double_step=True,
        force=pm.BaseAcceleration(record, np.ones(4), M, dt=record_step),
        name="frame",
    )
    rig = pm.Subdomain(
        m[:1] / 2,
        None,
        scheme=pm.GeneralizedAlpha(0.8, explicit=True),
        substeps=substeps,
        force=pm.BaseAcceleration(record, np.ones(1), m[:1] / 2, dt=record_step),
        restoring=restoring,
        restoring_stiffness=[specimen["k"]],
        name="rig",
    )
    return pm.Coupler(
        [rig, frame], pm.tie(frame, [0], rig, [0]), dt=dt, coupling=coupling, **options
    )


def paced(coupler, steps, period):
    """Macro steps, one per `period` seconds: delay of each begin, and duration, in seconds."""
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
    # the actuator is 2 ms late, which would add energy
    with simulated_rig(**specimen, delay=2e-3, noise=200.0) as (address, _):
        rig = Rig(address)
        coupler = hybrid(pm.rig.Compensated(rig, 2e-3))
        late, took = paced(coupler, steps, dt)
        commands = rig.close()
    drift = 1e3 * np.abs(commands[:, 2]).max()
    print(f"{coupler.time:g} s, {len(commands)} commands, largest storey drift {drift:.1f} mm")
    for what, seconds in (("delay", late), ("duration", took)):
        median, p99, p999 = 1e3 * np.quantile(seconds, [0.5, 0.99, 0.999])
        print(f"{what} of a macro step: median {median:.2f} ms, p99 {p99:.2f}, p99.9 {p999:.2f}")


if __name__ == "__main__":
    main()
