"""Viscous boundaries of plates and solids, and the load of a wave that comes in through them.

Equations (V1) and (V2) of docs/method/loads.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from .._checks import (
    check_word,
    counted,
    positive_number,
    real_number,
    time_step,
    vector,
    whole_number,
)
from ..meshes.mesh import KINDS, unshared
from ..problem.corrections import is_acceleration
from ..problem.records import Record
from ..problem.sampled import SampledForce
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from ..run.coupler import solve
from .elasticity import lumped_shares, masses_at_points, of_elements

__all__ = ["AbsorbingBoundary", "VerticalWave"]

# Parts of a side at its nodes, in the order of its kind; others would have negative ones.
SHARES = {
    "line": (1 / 2, 1 / 2),
    "line3": (1 / 6, 1 / 6, 2 / 3),
    "triangle": (1 / 3,) * 3,
    "quad": (1 / 4,) * 4,
}


@dataclass(frozen=True, eq=False)
class AbsorbingBoundary:
    """Dashpots on a boundary, from `Structure.absorbing`.

    Attributes
    ----------
    C : (n, n) csr_array
        Their damping matrix, between the dofs of each node alone: for `Structure.with_damping`.
    nodes : (k,) ndarray of int
        The nodes that have one.
    """

    C: sp.csr_array
    nodes: np.ndarray
    _components: int

    def __repr__(self) -> str:
        return f"<AbsorbingBoundary of {counted(self.nodes.size, 'node')}>"

    def incident(self, velocity: Any, direction: Any, *, dt: float | None = None) -> SampledForce:
        """The load of a plane wave that comes in through the boundary, perpendicular to it.

        Parameters
        ----------
        velocity : (m,) array_like or Record
            Velocity of the particles in the incident wave alone, at the boundary: half of what a
            free surface of the same ground has in the same wave. `Record.integrated` makes it of
            an acceleration.
        direction : (dim,) array_like
            Of the particles, of any length above 0: along the normal for a pressure wave, across
            it for a shear wave.
        dt : float, optional
            Step of the samples; a Record has it.

        Returns
        -------
        SampledForce
            2 C v, equation (V2), on the n dofs of the structure: for `force` of
            `Structure.subdomain` or `cut`.

        Raises
        ------
        TypeError, ValueError
            For a direction of another length, a Record in a unit of acceleration, and as
            `SampledForce`.

        Examples
        --------
        >>> from pmalpha import structures
        >>> soil = structures.plate(1, 2, 1.0, E=2.0, nu=0.0, rho=1.0, plane="strain")
        >>> base = soil.absorbing(soil.nodes_at(y=0.0))
        >>> load = base.incident([0.0, 1.0, 0.0], [1.0, 0.0], dt=0.1)
        >>> load(0.1)[soil.dofs(soil.nodes_at(y=0.0), "ux")].tolist()  # 2 rho c_s v / 2 at each
        [1.0, 1.0]
        """
        samples = velocity if isinstance(velocity, Record) else np.asarray(velocity)
        if isinstance(samples, Record) and is_acceleration(samples.unit):
            raise ValueError(
                f"velocity must be one of particles, got an acceleration in {samples.unit}: its "
                "velocity is .integrated()[0]"
            )
        along = vector(direction, self._components, "direction")
        size = float(np.linalg.norm(along))
        if not size > 0.0:
            raise ValueError(f"direction must not be zero, got {along.tolist()}")
        motion = np.tile(along / size, self.C.shape[0] // self._components)
        shape = (2.0 * (self.C @ motion))[:, None]
        if isinstance(samples, Record):
            return SampledForce(samples.values, samples.dt if dt is None else dt, shape=shape)
        if dt is None:
            raise TypeError("dt must be given with samples that are no Record")
        return SampledForce(samples, dt, shape=shape)


def boundary(structure: Any, nodes: Any, rho: Any, c_p: Any, c_s: Any) -> AbsorbingBoundary:
    """Of `Structure.absorbing`."""
    if not structure.moduli or set(structure.moduli) != set(structure.elements):
        raise ValueError(
            "absorbing needs linear plates or solids, got elements "
            f"{', '.join(map(repr, structure.elements)) or 'of no kind'}; on others a dashpot "
            "rho c A is one of with_damper"
        )
    chosen = np.zeros(len(structure.points), dtype=bool)
    chosen[nodes] = True
    beyond = {
        name: None if x is None else positive_number(x, name)
        for name, x in (("rho", rho), ("c_p", c_p), ("c_s", c_s))
    }
    pairs = [
        (sides, _impedances(structure, kind, sides, elements, beyond))
        for kind, sides, elements in _sides(structure, chosen)
    ]
    if not pairs:
        raise ValueError(
            "nodes must be those of a boundary, all nodes of a side of an element at least, got "
            f"{counted(int(chosen.sum()), 'node')} without"
        )
    where = np.concatenate([sides.ravel() for sides, _ in pairs])
    values = np.concatenate([Z.reshape(-1, *Z.shape[2:]) for _, Z in pairs])
    n, d, dim = structure.n, structure.dofs_per_node, structure.points.shape[1]
    rows = np.broadcast_to(d * where[:, None, None] + np.arange(dim)[:, None], values.shape)
    columns = np.swapaxes(rows, 1, 2)
    C = sp.csr_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n))
    return AbsorbingBoundary(C, np.unique(where), d)


def graded(structure: Any, nodes: np.ndarray, elements: Any, reflection: Any) -> sp.csr_array:
    """Of `Structure.graded_damping`: C = sum of alpha_e M_e, lumped, with (V7)."""
    if not structure.moduli or set(structure.moduli) != set(structure.elements):
        raise ValueError(
            "graded_damping needs linear plates or solids, got elements "
            f"{', '.join(map(repr, structure.elements)) or 'of no kind'}"
        )
    count = whole_number(elements, "elements", low=1)
    R = real_number(reflection, "reflection", low=0.0, high=1.0)
    if not 0.0 < R < 1.0:
        raise ValueError(f"reflection must lie in (0, 1), got {R:g}")
    depth = {kind: np.zeros(len(x), dtype=int) for kind, x in structure.elements.items()}
    reached = np.zeros(len(structure.points), dtype=bool)
    reached[nodes] = True
    for ring in range(count, 0, -1):  # the outermost elements are `count` deep
        rings = {k: (depth[k] == 0) & reached[x].any(axis=1) for k, x in structure.elements.items()}
        for kind, ring_of_kind in rings.items():
            depth[kind][ring_of_kind] = ring
            reached[structure.elements[kind][ring_of_kind]] = True
    if all((x > 0).all() for x in depth.values()):
        raise ValueError(
            f"elements must leave some of the mesh without damping, got {count}, which are all of "
            "it: the layer is a part of the mesh"
        )
    n, d = structure.n, structure.dofs_per_node
    dim = structure.points.shape[1]
    damping = np.zeros(len(structure.points))
    for kind, cells in structure.elements.items():
        lam, mu, density, thickness, _ = structure.moduli[kind]
        inside = np.flatnonzero(depth[kind])
        if not inside.size:
            continue
        N, masses = masses_at_points(kind, structure.points[cells[inside]], np.ones(1))
        volume = masses.sum(axis=1)
        c_p, rho, t = (
            of_elements(x, inside)
            for x in (np.sqrt((lam + 2.0 * mu) / density), density, thickness)
        )
        share = (depth[kind][inside] - 0.5) / count
        alpha = 2.0 * c_p * np.log(1.0 / R) / (count * volume ** (1.0 / dim)) * share
        nodal = lumped_shares(kind, N, (alpha * rho * t)[:, None] * masses)
        damping += np.bincount(cells[inside].ravel(), nodal.ravel(), minlength=len(damping))
    of_dofs = np.zeros((len(damping), d))
    of_dofs[:, :dim] = damping[:, None]
    return sp.csr_array(sp.diags_array(of_dofs.ravel(), shape=(n, n)))


def _impedances(
    structure: Any,
    kind: str,
    sides: np.ndarray,
    elements: np.ndarray,
    beyond: dict[str, float | None],
) -> np.ndarray:
    """(s, a, dim, dim) at the nodes of sides: A (rho c_p n n^T + rho c_s (1 - n n^T))      (V1)"""
    dim = structure.points.shape[1]
    area, normal = _measured(structure.points[sides], dim)
    m = {name: of_elements(x, elements) for name, x in structure.moduli[kind]._asdict().items()}
    at_sides = {
        "rho": m["density"],
        "c_p": np.sqrt((m["lam"] + 2.0 * m["mu"]) / m["density"]),
        "c_s": np.sqrt(m["mu"] / m["density"]),
    }
    rho, c_p, c_s = (
        at_sides[x] if beyond[x] is None else np.full(len(sides), beyond[x]) for x in at_sides
    )
    area = area * m["thickness"]
    along = normal[:, :, None] * normal[:, None, :]
    Z = (area * rho * c_p)[:, None, None] * along
    Z += (area * rho * c_s)[:, None, None] * (np.eye(dim) - along)
    shares = np.array(SHARES[_name(sides.shape[1], dim)])
    result: np.ndarray = shares[:, None, None] * Z[:, None]
    return result


def _name(nodes: int, dim: int) -> str:
    return {2: "line", 3: "line3"}[nodes] if dim == 2 else {3: "triangle", 4: "quad"}[nodes]


def _sides(structure: Any, chosen: np.ndarray) -> Any:
    """Kind, nodes (s, a) and elements (s,) of the outer sides all of whose nodes are chosen."""
    of_kinds, keys, dim = [], [], structure.points.shape[1]
    for kind, elements in structure.elements.items():
        local = _local_sides(kind)
        sides = np.concatenate([elements[:, list(x)] for x in local])
        owners = np.tile(np.arange(len(elements)), len(local))
        inside = chosen[sides].all(axis=1)
        of_kinds.append((kind, sides[inside], owners[inside]))
        # the two ends of an edge, three corners of a face
        keys.append(np.sort(sides[inside, : 2 * dim - 2], axis=1)[:, :dim])
    # a side of two elements, of one kind or of two, is inside of the body
    masks = np.split(unshared(np.concatenate(keys)), np.cumsum([len(x) for x in keys])[:-1])
    for (kind, sides, owners), outer in zip(of_kinds, masks, strict=True):
        if outer.any():
            yield kind, sides[outer], owners[outer]


def _local_sides(kind: str) -> list[tuple[int, ...]]:
    """Node numbers in the element of its sides, all of one number of nodes."""
    shape = KINDS[kind]
    if shape.dimension == 2:
        corners = len(shape.edges)
        if shape.nodes == corners:
            return [tuple(edge) for edge in shape.edges]
        return [(*edge, corners + i) for i, edge in enumerate(shape.edges)]
    kinds = {name for name, _ in shape.faces}
    if len(kinds) > 1 or not kinds <= SHARES.keys():
        raise ValueError(
            "absorbing takes solids of 'tetra' and 'hexahedron', and all kinds of plates, got "
            f"{kind!r}"
        )
    return [tuple(face) for _, face in shape.faces]


def _measured(corners: np.ndarray, dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Length or area (s,) and unit normal (s, dim) of sides with these corners (s, a, dim)."""
    if dim == 2:
        along = corners[:, 1] - corners[:, 0]
        across = np.column_stack([along[:, 1], -along[:, 0]])
    elif corners.shape[1] == 3:
        across = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    else:
        across = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    size = np.linalg.norm(across, axis=1)
    return size, across / size[:, None]


# ---- vertical wave -------------------------------------------------------------------------------
# The free field of a vertical wave in horizontally layered ground, from a column of its elements.
#
# An element of a plate whose motion does not depend on x is a rod between its lower and its upper
# edge, with the modulus mu or lam + 2 mu and the same mass. So the motion of the column is one of
# the mesh, with its speeds of waves, where that of the continuum differs by a phase.

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
