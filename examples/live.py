"""A paced test, drawn while it runs: command, measured force and lateness, ten times a second.

python examples/live.py            # the test, and a process that draws it
python examples/live.py test.live  # draws what another process writes by Coupler.monitor
"""

import sys
import tempfile
from multiprocessing import get_context
from pathlib import Path

import numpy as np

import pmalpha as pm
from pmalpha import models

SECONDS = 10.0  # of the test
SHOWN = 2000  # fine steps


def test():
    """A frame of three storeys under El Centro on a column behind a simulated actuator.

    The actuator is 2 ms late, which is compensated: otherwise it would add energy.
    """
    M, K = models.shear_frame([2e3, 4e3, 4e3], [0.0, 8e6, 8e6])
    frame = pm.Subdomain(
        M,
        K,
        C=0.002 * K,
        scheme=pm.GeneralizedAlpha(0.8),
        name="frame",
        force=pm.BaseAcceleration(models.el_centro(), direction=np.ones(3), M=M),
    )
    column = pm.CubicSpring([0], k=4e6, k3=2e9)
    late = pm.rig.SimulatedActuator(column, delay=0.002)
    rig = pm.Subdomain(
        [2e3],
        None,
        C=[2e4],
        scheme=pm.GeneralizedAlpha(0.8, explicit=True),
        substeps=10,
        name="rig",
        force=pm.BaseAcceleration(models.el_centro(), direction=[1.0], M=[2e3]),
        restoring=pm.rig.Compensated(late, 0.002),
        limits=pm.rig.Limits(displacement=0.1, force=1e6),
    )
    return pm.Coupler([rig, frame], pm.tie(frame, [0], rig, [0]), dt=0.01, coupling="pm")


def panels(figure):
    axes = figure.subplots(3, sharex=True)
    for ax, label in zip(axes, ("command (mm)", "force (kN)", "late (µs)")):
        ax.set_ylabel(label)
    axes[-1].set_xlabel("time (s)")
    return [ax.plot([], [])[0] for ax in axes]


def update(lines, last):
    """The last fine steps of a `Monitored` into the lines of the panels."""
    name = next(iter(last.command))
    shown = slice(-SHOWN, None)
    values = 1e3 * last.command[name][:, 0], 1e-3 * last.force[name][:, 0], 1e6 * last.lateness
    for line, y in zip(lines, values):
        line.set_data(last.t[shown], y[shown])
        line.axes.relim()
        line.axes.autoscale_view()


def draw(path):
    """Ten times a second, until the window is closed."""
    from matplotlib import pyplot
    from matplotlib.animation import FuncAnimation

    figure = pyplot.figure()
    lines = panels(figure)

    def frame(number):
        if Path(path).exists():
            update(lines, pm.rig.read_monitor(path))

    # kept in a name: an animation that is lost stops
    animation = FuncAnimation(figure, frame, interval=100, cache_frame_data=False)
    pyplot.show()
    return animation


def main():
    if len(sys.argv) > 1:
        draw(sys.argv[1])
        return
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.exists() else None) as folder:
        path = str(Path(folder, "live"))
        window = get_context("spawn").Process(target=draw, args=(path,))
        window.start()
        coupler = test()
        coupler.monitor(path)
        print(coupler.run_paced(SECONDS, on_late="continue").pacing)
        window.join()


if __name__ == "__main__":
    main()
