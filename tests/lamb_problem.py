"""Lamb's problem in the plane: a box of soil, its edges, and what they are compared with.

A half-space with nu = 0.25 and speeds of waves 1 and sqrt(3) under a vertical line load at its
surface, a Ricker pulse of the frequency 0.5: waves of shear are 2 long. The box has 8 x 4.
"""

from functools import lru_cache

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

import pmalpha as pm
from pmalpha import structures

C_P = np.sqrt(3.0)
PEAK = 2.4  # of the pulse: it is below 4e-5 at 0
RECEIVERS = [(1.0, 0.0), (3.8, 0.0), (3.8, -3.8), (0.0, -3.8), (2.0, -2.0)]


def ricker(t, frequency=0.5):
    x = (np.pi * frequency * (t - PEAK)) ** 2
    return (1.0 - 2.0 * x) * np.exp(-x)


def step_of(h):
    """0.87 of h / c_p."""
    return 0.87 * h / C_P


def soil(h=0.1, beyond=0.0, stiffness=None):
    """The box, and as much more on three sides; stiffness (x, y) times that of the soil."""
    half, depth = 4.0 + beyond, 4.0 + beyond
    nx, ny = round(2.0 * half / h), round(depth / h)
    E = 2.5
    if stiffness is not None:
        x = -half + h * (np.arange(nx) + 0.5)
        y = -depth + h * (np.arange(ny) + 0.5)
        E = 2.5 * stiffness(*np.meshgrid(x, y, indexing="ij"))
    return structures.plate(
        nx, ny, h, E=E, nu=0.25, rho=1.0, plane="strain", mass="lumped", origin=(-half, -depth)
    )


def edge(structure):
    """The nodes of both sides and of the lower side."""
    low, high = structure.points.min(axis=0), structure.points.max(axis=0)
    return structure.nodes(
        lambda x, y: (x < low[0] + 1e-6) | (x > high[0] - 1e-6) | (y < low[1] + 1e-6)
    )


def dofs_at(structure, places, component=None):
    nodes = [
        structure.nodes(lambda x, y, a=a, b=b: (abs(x - a) < 1e-6) & (abs(y - b) < 1e-6))[0]
        for a, b in places
    ]
    return structure.dofs(nodes, component)


def pulse(structure):
    """The load, downward at (0, 0)."""
    shape = np.zeros((structure.n, 1))
    shape[dofs_at(structure, [(0.0, 0.0)], "uy")] = -1.0
    return pm.SampledForce(ricker(0.01 * np.arange(4000)), 0.01, shape)


def alone(structure, steps, h=0.1):
    """Motion of the receivers without a layer, (steps + 1, 10)."""
    model = structure.subdomain(scheme=pm.CentralDifference(), force=pulse(structure))
    record = {0: dofs_at(structure, RECEIVERS)}
    return pm.solve(model, dt=step_of(h), steps=steps, every=1, record=record).u


@lru_cache(maxsize=1)
def reference(steps=398):
    """Of a mesh from whose ends nothing returns within 20 units of time."""
    return alone(soil(beyond=17.5), steps)


def with_layer(elements, ratio=1, steps=398, coupling="macro", **options):
    """The receivers every `ratio` steps of the soil, with a layer of that many times its step."""
    box = soil()
    layer = box.absorbing_layer(edge(box), elements, **options)
    ground = box.subdomain(
        scheme=pm.CentralDifference(), force=pulse(box), substeps=ratio, name="soil"
    )
    beyond = layer.subdomain(scheme=pm.Newmark())
    ties = [layer.tie(ground, beyond)]
    coupler = pm.Coupler([ground, beyond], ties, dt=ratio * step_of(0.1), coupling=coupling)
    record = {"soil": dofs_at(box, RECEIVERS)}
    return coupler.run(steps=steps // ratio, every=1, record=record)["soil"].u


def error(motion, exact, ratio=1):
    """The largest difference over the peak of each receiver, largest of all, and the rms of all."""
    compared = exact[::ratio][: len(motion)]
    sizes = [np.linalg.norm(x.reshape(len(x), -1, 2), axis=2) for x in (motion - compared, exact)]
    rms = np.linalg.norm(motion - compared) / np.linalg.norm(compared)
    return (sizes[0].max(axis=0) / sizes[1].max(axis=0)).max(), rms


def lamb(t, x):
    """Vertical displacement of the surface at the distance x: the solution of the continuum.

    By Cagniard's method (de Hoop 1960): the response to an impulse is -g(t / x) / (pi mu x) with g
    below, whose pole at the slowness of the Rayleigh wave is a principal value. mu = rho = 1.
    """
    a, b = 1.0 / C_P, 1.0

    def rayleigh(p):
        return (b**2 - 2 * p**2) ** 2 - 4 * p**2 * np.sqrt(p**2 - a**2) * np.sqrt(p**2 - b**2)

    pole = brentq(rayleigh, b * 1.001, 2.0 * b)

    def between(p):  # the two speeds
        A = (b**2 - 2 * p**2) ** 2
        B = 4 * p**2 * np.sqrt(p**2 - a**2) * np.sqrt(b**2 - p**2)
        return np.sqrt(p**2 - a**2) * b**2 * A / (A**2 + B**2)

    def after(p):
        return np.sqrt(p**2 - a**2) * b**2 / rayleigh(p)

    def value(time):
        def force(p):
            return ricker(time - p * x)

        ends = sorted({b, 2 * pole - b, max(time / x, 2 * pole)})
        total = quad(lambda p: between(p) * force(p), a, b, limit=200)[0]
        total += quad(
            lambda p: after(p) * (p - pole) * force(p) if p != pole else slope * force(p),
            *ends[:2],
            weight="cauchy",
            wvar=pole,
            limit=200,
        )[0]
        total += quad(lambda p: after(p) * force(p), *ends[1:], limit=200)[0]
        return -total / np.pi

    small = 1e-6
    slope = np.sqrt(pole**2 - a**2) * b**2 * 2 * small
    slope /= rayleigh(pole + small) - rayleigh(pole - small)
    return np.array([value(time) for time in t])
