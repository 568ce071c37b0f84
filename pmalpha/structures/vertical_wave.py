"""The free field of a vertical wave in horizontally layered ground, from a column of its elements.

An element of a plate whose motion does not depend on x is a rod between its lower and its upper
edge, with the modulus mu or lam + 2 mu and the same mass. So the motion of the column is one of the
mesh, with its speeds of waves, where that of the continuum differs by a phase.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from .._checks import check_word, positive_number, time_step
from ..problem.records import Record
from ..problem.sampled import SampledForce
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from ..run.coupler import solve
from .elasticity import of_elements

__all__ = ["VerticalWave"]

# Equal materials and levels differ by less than this, relative to the largest.
SAME = 1e-9


@dataclass(frozen=True, eq=False)
class VerticalWave:
    """Motion of the ground under a vertical wave, from `AbsorbingLayer.vertical_wave`.

    ``wave(t, points)`` returns displacements, velocities and accelerations at the points, linear
    between levels and between steps.

    Attributes
    ----------
    levels : (l,) ndarray
        Coordinates y of the nodes, from below; the first is one element below the soil.
    t : (m,) ndarray
        The steps.
    u, v, w : (m, l) ndarray
        Motion along x (SV) or y (P); w is the acceleration that satisfies equation (1).
    """

    levels: np.ndarray
    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    w: np.ndarray
    component: int

    def __repr__(self) -> str:
        kind = ("SV", "P")[self.component]
        return f"<VerticalWave {kind}, {self.levels.size} levels, to t = {self.t[-1]:g}>"

    def __call__(self, t: float, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """u, v and w at points (k, 2), each (k, 2)."""
        end = float(self.t[-1])
        step = end / (len(self.t) - 1)
        if not -SAME * step <= t <= end + SAME * step:
            raise ValueError(f"t must lie in 0..{end:g}, where the wave is known, got {t:g}")
        y = np.asarray(points, dtype=float)[:, 1]
        near = SAME * np.abs(self.levels).max()
        if not (y.min() >= self.levels[0] - near and y.max() <= self.levels[-1] + near):
            raise ValueError(
                f"points must lie in y = {self.levels[0]:g}..{self.levels[-1]:g}, got "
                f"{y.min():g}..{y.max():g}"
            )
        x = t / step
        j = min(int(x), len(self.t) - 2)
        share = min(x - j, 1.0)
        result = []
        for motion in (self.u, self.v, self.w):
            values = np.zeros((len(y), 2))
            level = (1.0 - share) * motion[j] + share * motion[j + 1]
            values[:, self.component] = np.interp(y, self.levels, level)
            result.append(values)
        return result[0], result[1], result[2]


def vertical_wave(
    structure: Any,
    sides: Sequence[Any],
    velocity: Any,
    t_end: float,
    scheme: Scheme,
    step: float,
    *,
    dt: float | None,
    wave: str,
    lumped: bool,
) -> VerticalWave:
    """Of `AbsorbingLayer.vertical_wave`."""
    check_word(wave, "wave", ("SV", "P"))
    step, end = time_step(step, "step"), positive_number(t_end, "t_end")
    if dt is None and not isinstance(velocity, Record):
        raise TypeError("dt must be given with samples that are no Record")
    levels, modulus, density = _column(structure, sides, wave)
    h = np.diff(levels)
    n = len(levels)
    K = _assembled(modulus / h, [[1.0, -1.0], [-1.0, 1.0]], n)
    share = [[0.5, 0.0], [0.0, 0.5]] if lumped else [[1 / 3, 1 / 6], [1 / 6, 1 / 3]]
    M = _assembled(density * h, share, n)
    Z = np.sqrt(modulus[0] * density[0])
    base = np.zeros(n)
    base[0] = Z  # (V1)
    shape = 2.0 * base  # (V2)
    if isinstance(velocity, Record):
        velocity, dt = velocity.values, velocity.dt if dt is None else dt
    assert dt is not None
    load = SampledForce(velocity, dt, shape=shape)
    column = Subdomain(
        M.diagonal() if lumped else M, K, C=base, scheme=scheme, force=load, name="column"
    )
    steps = int(np.ceil(end / step - SAME))
    motion = solve(column, dt=step, steps=steps, every=1)
    loads = np.array([load(t) for t in motion.t])
    rest = (loads - motion.u @ K - motion.v * base).T
    w = rest.T / M.diagonal() if lumped else spsolve(sp.csc_array(M), rest).T
    return VerticalWave(levels, motion.t, motion.u, motion.v, w, ("SV", "P").index(wave))


def _assembled(values: np.ndarray, block: Any, n: int) -> sp.csr_array:
    """The sum of values[e] times the block on the nodes e and e + 1."""
    nodes = np.arange(n - 1)[:, None] + np.arange(2)
    rows, columns = np.repeat(nodes, 2, axis=1), np.tile(nodes, (1, 2))
    entries = values[:, None] * np.ravel(block)
    return sp.csr_array((entries.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n))


def _column(
    structure: Any, sides: Sequence[Any], wave: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Levels (l,), modulus and density (l - 1,) of the elements between them."""
    lateral = [side for side in sides if side.axis == 0]
    lower = [side for side in sides if side.axis == 1 and side.outward < 0.0]
    if not lateral or len(lower) != 1 or len(lateral) + 1 != len(sides):
        raise ValueError(
            "vertical_wave needs a layer at the lower side and one side along y or both, with a "
            f"free surface above, got {', '.join(side.name for side in sides)}; a lower side alone "
            "takes Structure.absorbing(nodes).incident"
        )
    columns = [_of_side(structure, side, wave) for side in lateral]
    levels, modulus, density = columns[0]
    for other in columns[1:]:
        if any(
            len(a) != len(b) or not np.allclose(a, b, rtol=SAME, atol=SAME * np.abs(a).max())
            for a, b in zip(columns[0], other)
        ):
            raise ValueError(
                "vertical_wave needs horizontal layers, got other levels or materials at "
                f"{lateral[1].name} than at {lateral[0].name}"
            )
    base = lower[0]
    below = _materials(structure, base.owners, wave)
    for name, x, y in zip(("stiffness", "density"), below, (modulus[0], density[0]), strict=True):
        if not np.allclose(x, y, rtol=SAME, atol=0.0):
            raise ValueError(
                f"vertical_wave needs horizontal layers, got a {name} of {x.min():g}..{x.max():g} "
                f"along {base.name} and {y:g} at its end"
            )
    levels = np.insert(levels, 0, levels[0] - base.size)
    return levels, np.insert(modulus, 0, modulus[0]), np.insert(density, 0, density[0])


def _of_side(structure: Any, side: Any, wave: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Levels, modulus and density of the elements of a side, from below."""
    ends = np.sort(structure.points[side.edges][:, :, 1], axis=1)
    order = np.argsort(ends[:, 0])
    modulus, density = _materials(structure, side.owners[order], wave)
    return np.append(ends[order, 0], ends[order[-1], 1]), modulus, density


def _materials(structure: Any, elements: np.ndarray, wave: str) -> tuple[np.ndarray, np.ndarray]:
    """Modulus and density of elements, times their thickness."""
    lam, mu, density, thickness = (of_elements(x, elements) for x in structure.moduli["quad"][:4])
    modulus = mu if wave == "SV" else lam + 2.0 * mu
    return modulus * thickness, density * thickness
