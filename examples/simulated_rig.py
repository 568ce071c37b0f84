"""A simulated test rig: an actuator with delay and noise that loads a yielding specimen.

It replaces a laboratory: a separate process that is called with t and a displacement and returns
the measured force. It prints the port on which it listens and serves one client. A call without
arguments returns the commands received, (k, 3): number, t, displacement.
`python simulated_rig.py --help` lists the options.
"""

import argparse
import random
import time
from bisect import bisect_right

import numpy as np

from pmalpha.rig.calls import serve


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


class Rig:
    """Actuator and specimen, with noise; a call takes `wait` seconds."""

    def __init__(self, actuator, specimen, noise, wait):
        self.actuator, self.specimen, self.noise, self.wait = actuator, specimen, noise, wait
        self.log = []

    def __call__(self, *command):
        if not command:
            return np.reshape(self.log, (-1, 3))
        t, d = (x.item() for x in command)
        self.log.append((len(self.log) + 1, t, d))
        time.sleep(self.wait)
        return [self.specimen(self.actuator(t, d)) + self.noise()]


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
    specimen = Yielding(args.k, args.fy, args.hardening)
    rig = Rig(Actuator(args.delay), specimen, lambda: generator.gauss(0.0, args.noise), args.wait)
    serve(rig, timeout=args.timeout)


if __name__ == "__main__":
    main()
