"""The error of a goal from the residuals of a run and the adjoint, equations (X1) to (X6).

The run is continued between its time levels: u by cubic Hermite polynomials of u and v, v by those
of v and w, the multipliers straight between the levels of the interface.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from ..problem.loads import OfTime, loads_of
from ..problem.matrices import product
from ..results.times import linear
from .parameters import GAUSS, basis

# Bytes of the motion at one Gauss point of a block of steps.
BLOCK = 4_000_000
# Samples of a load are at ends of steps, or of equal parts of them, up to this part of a sample; in
# other steps this number of parts has at most one kink, and a step has at most so many parts.
ALIGNED = 1e-6
FINER = 4
MOST_PIECES = 256


class Line(NamedTuple):
    """Columns that are straight between times, or steps, of which row k is before time k."""

    t: np.ndarray
    x: np.ndarray
    steps: bool = False

    def at(self, t: np.ndarray) -> np.ndarray:
        if self.steps:
            result: np.ndarray = self.x[np.searchsorted(self.t, t)]
            return result
        return linear(t, self.t, self.x)


class Weights(NamedTuple):
    """The adjoint of a goal up to its time `end`, and the multipliers of the run."""

    z: Line
    nu: Line
    lam: Line
    end: float
    tied: str  # "v", or "u" under "mean", whose steps are tied by their displacements


class Share(NamedTuple):
    """Shares in the error of a goal: of each own step, and of each step of the interface."""

    residual: np.ndarray
    coupling: np.ndarray


def averaged(x: np.ndarray, width: int, first: int) -> np.ndarray:
    """(X3): means over `width` levels of x, (levels, n), whose adjoint alternates within them.

    Half weights at the ends of an even width; width 1 has [1 2 1]/4. Levels before `first`, the
    last one, and those whose mean would need them are extrapolated.
    """
    half = max(width // 2, 1 if width == 1 else 0)
    kernel = np.full(2 * half + 1, 1.0 / max(width, 1))
    if width == 1:
        kernel = np.array([0.25, 0.5, 0.25])
    elif width % 2 == 0:
        kernel[[0, -1]] *= 0.5
    begin, end = first + half, len(x) - 1 - half
    out = np.empty_like(x)
    inner = np.zeros((end - begin, x.shape[1]))
    for k, share in enumerate(kernel):
        inner += share * x[begin - half + k : end - half + k]
    out[begin:end] = inner
    apart = min(max(width, 1), len(inner) - 1)
    before, after = np.arange(begin) - begin, np.arange(end, len(x)) - end + 1
    out[:begin] = inner[0] + np.outer(before / apart, inner[apart] - inner[0])
    out[end:] = inner[-1] + np.outer(after / apart, inner[-1] - inner[-1 - apart])
    return out


def of_subdomain(
    s: Any,
    L: sp.csr_array,
    motion: Any,
    force: Load,
    weights: Weights,
) -> Share:
    """(X4), and the share in (X5), of a subdomain, by its own steps.

    motion: u, v and w at all its time levels, from t = 0 on.
    """
    z, nu, lam, end, tied = weights
    steps = len(motion.t) - 1
    residuals, coupling = np.zeros((2, steps))
    length = max(1, BLOCK // (8 * s.n))
    for first in range(0, steps, length):
        part = slice(first, min(first + length, steps))
        t, h = motion.t[part], np.diff(motion.t)[part]
        later = slice(part.start + 1, part.stop + 1)
        until = np.minimum(motion.t[later], end)
        duration = np.maximum(until - t, 0.0)
        at_begin, at_end = z.at(t), z.at(until)
        u, v, w = motion.u, motion.v, motion.a
        ends = u[part], v[part], u[later], v[later]
        of_velocity = v[part], w[part], v[later], w[later]
        for place, factor in GAUSS:
            time, share = t + place * duration, place * duration / h
            p = basis(share[:, None], h[:, None])
            between = [sum(c * x for c, x in zip(row, ends)) for row in p]
            # what the interface sees: under "macro" velocities between tied ones, whose integral is
            # not the displacement of a coarse step
            continued = between[1]
            if tied == "v":
                continued = sum(c * x for c, x in zip(p.u, of_velocity))
            residual = lam.at(time) @ L
            for A, x in zip((s.K, s.C, s.M), between):
                residual = residual - product(A, x.T).T
            here = nu.at(time)
            weighted = (1.0 - place) * at_begin + place * at_end
            gap = ((L @ (between[1] - continued).T) * here.T).sum(axis=0)
            factor = factor * duration
            residuals[part] += factor * (np.einsum("kn,kn->k", weighted, residual) - gap)
            coupling[part] -= factor * ((L @ continued.T) * here.T).sum(axis=0)
        residuals[part] += force.work(t, duration, at_begin, at_end)
    return Share(residuals, coupling)


def of_prescribed(g: Callable[[np.ndarray], np.ndarray], t: np.ndarray, nu: Line) -> np.ndarray:
    """The share in (X5) of prescribed velocities between these times."""
    duration = np.diff(t)
    sums = np.zeros(len(duration))
    for place, factor in GAUSS:
        time = t[:-1] + place * duration
        sums += factor * duration * np.sum(nu.at(time) * g(time), axis=1)
    return sums


class Load:
    """A load at all times.

    compiled: the sum of its compiled functions, (n,) at a time; None without.
    """

    def __init__(self, force: Any, n: int, compiled: Callable[[float], np.ndarray] | None = None):
        self.n = n
        self.terms = [x for x in loads_of(force) if x._kind != "compiled"]
        if compiled is not None:
            self.terms.append(OfTime(compiled))

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """At (k,) times, (k, n)."""
        return sum((x._at_times(t, self.n) for x in self.terms), np.zeros((len(t), self.n)))

    def work(
        self, t: np.ndarray, duration: np.ndarray, z0: np.ndarray, z1: np.ndarray
    ) -> np.ndarray:
        """The integral of z . F over each step, z straight from z0 to z1, (k,)."""
        sums = np.zeros(len(t))
        count = self._pieces(float(duration.max(initial=0.0))) if self.terms else 0
        for j in range(count):
            for place, factor in GAUSS:
                s = (j + place) / count
                z = (1.0 - s) * z0 + s * z1
                sums += factor / count * duration * np.einsum("kn,kn->k", z, self(t + s * duration))
        return sums

    def _pieces(self, h: float) -> int:
        """Pieces of a step between whose ends samples are straight, or nearly so."""
        pieces = 1
        for x in self.terms:
            if (samples := x._samples) is not None:
                ratio = h / samples.dt
                r = max(ratio, 1.0 / ratio) if ratio > 0.0 else 1.0
                aligned = abs(r - round(r)) < ALIGNED
                pieces = max(pieces, ceil(ratio - ALIGNED) * (1 if aligned else FINER))
        return min(pieces, MOST_PIECES)
