"""What the subdomains of a cut share: dofs, their loads, their ties, and the way back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import counted, require_finite, vector
from ..problem.loads import Load, Mass, checked_force, has_ground, loads_of
from ..problem.matrices import product

# Rounding of zeros in a computed motion, relative to its largest entry.
ROUNDING = 1e-12


class Division:
    """The dofs of an uncut structure in the subdomains.

    dofs: sequence of (n_i,) arrays, uncut dofs of each subdomain, in rising order.
    weights: sequence of (n_i,) arrays, of each dof of a subdomain, not negative: a load on a dof of
        several subdomains is divided in proportion. Equal shares where all are zero.
    """

    def __init__(self, n: int, dofs: Sequence[np.ndarray], weights: Sequence[np.ndarray]):
        self.n, self.dofs = n, list(dofs)
        self.sizes = np.array([numbers.size for numbers in dofs])
        every = np.concatenate(dofs)
        part = np.repeat(np.arange(len(dofs)), self.sizes)
        self.order = np.lexsort((part, every))  # by dof, then by subdomain
        ordered = every[self.order]
        self._first = np.flatnonzero(np.diff(ordered, prepend=-1))
        self.present = ordered[self._first]
        self.multiplicity = np.diff(np.append(self._first, ordered.size))
        self.shares = self._split(self._shares(np.concatenate(weights)))

    def _shares(self, weights: np.ndarray) -> np.ndarray:
        count = np.repeat(self.multiplicity, self.multiplicity)
        w = weights[self.order]
        w = np.ldexp(w, -int(np.frexp(w.max(initial=0.0))[1]))  # their sums are then finite
        total = np.repeat(np.add.reduceat(w, self._first), self.multiplicity)
        with np.errstate(invalid="ignore", divide="ignore"):
            ordered = np.where(total > 0.0, w / total, 1.0 / count)
        ordered[count == 1] = 1.0
        shares = np.empty(w.size)
        shares[self.order] = ordered
        return shares

    def _split(self, values: np.ndarray) -> list[np.ndarray]:
        return np.split(values, np.cumsum(self.sizes)[:-1])

    def ties(self) -> list[sp.csr_array]:
        """L_i (p, n_i): +1 on the first subdomain of a dof and -1 on each other one, a row each.

        Rows are ordered by dof, then by subdomain; p = 0 without shared dofs.
        """
        hub = np.repeat(self._first, self.multiplicity)
        other = np.flatnonzero(hub != np.arange(hub.size))
        p = other.size
        rows = np.concatenate([np.arange(p), np.arange(p)])
        columns = self.order[np.concatenate([hub[other], other])]
        signs = np.repeat([1.0, -1.0], p)
        L = sp.csc_array((signs, (rows, columns)), shape=(p, int(self.sizes.sum())))
        starts = np.concatenate([[0], np.cumsum(self.sizes)])
        return [sp.csr_array(L[:, a:b]) for a, b in zip(starts, starts[1:])]

    @property
    def interface(self) -> list[np.ndarray]:
        """Of each subdomain, which of its dofs other subdomains have too: (n_i,) of bool."""
        shared = np.empty(self.order.size, dtype=bool)
        shared[self.order] = np.repeat(self.multiplicity > 1, self.multiplicity)
        return self._split(shared)

    def scatter(self, u: np.ndarray) -> list[np.ndarray]:
        """(..., n_i) of each subdomain, from (..., n)."""
        return [u[..., numbers] for numbers in self.dofs]

    def divided(
        self,
        force: Any,
        masses: Sequence[Any],
        mass: Callable[[], Any],
        names: Sequence[str] | None = None,
    ) -> list[Any]:
        """The load of each subdomain; their sum is the load of the uncut structure.

        A ground motion is that of the mass of each subdomain, `masses`, and of what couples fixed
        dofs to free ones by shares. `mass` returns that of the uncut structure, with dofs of these
        names.
        """
        known = Mass(mass() if has_ground(force) else None, names)
        terms = loads_of(checked_force(force, self.n, mass=known))
        divided = [self._divided(term, masses) for term in terms]
        return [list(loads) or None for loads in zip(*divided)] or [None] * len(self.dofs)

    def _divided(self, force: Load, masses: Sequence[Any]) -> list[Any]:
        if force.direction is not None:
            return self._of_ground(force, force.direction, masses)
        return [force._part(numbers, share) for numbers, share in zip(self.dofs, self.shares)]

    def _of_ground(self, force: Any, direction: np.ndarray, masses: Sequence[Any]) -> list[Any]:
        shapes = [-product(M, direction[numbers]) for M, numbers in zip(masses, self.dofs)]
        rest = force.shape.copy()
        for numbers, shape in zip(self.dofs, shapes):
            rest[numbers] -= shape
        rest[np.abs(rest) <= ROUNDING * np.abs(force.shape).max()] = 0.0
        return [
            force._part(numbers)._changed(shape=shape + share[:, None] * rest[numbers])
            for numbers, shape, share in zip(self.dofs, shapes, self.shares)
        ]

    def gather(self, parts: Sequence[Any], rows: Sequence[np.ndarray]) -> np.ndarray:
        """(levels, n) from arrays (levels_i, n_i), of which some rows are taken; the mean of all
        sides by their shares, zero at fixed dofs."""
        total, levels = int(self.sizes.sum()), len(rows[0])
        values = np.empty((levels, self.n))
        values.fill(0.0)  # np.take into memory that is new takes several times as long
        source = np.full(self.n, total)  # of a fixed dof: the zero at the end
        source[self.present] = self.order[self._first]
        mean, shared = self._mean()
        row = np.zeros(total + 1)
        for level in range(levels):
            np.concatenate(
                [part[part_rows[level]] for part, part_rows in zip(parts, rows)], out=row[:-1]
            )
            np.take(row, source, out=values[level], mode="clip")
            if shared.size:
                values[level, shared] = mean @ row[:-1]
        return values

    def _mean(self) -> tuple[sp.csr_array, np.ndarray]:
        """The matrix from the dofs of all subdomains to the shared dofs, and these."""
        several = self.multiplicity > 1
        entries = self.order[np.repeat(several, self.multiplicity)]
        values = np.concatenate(self.shares)[entries]
        start = np.concatenate([[0], np.cumsum(self.multiplicity[several])])
        shape = (int(several.sum()), int(self.sizes.sum()))
        return sp.csr_array((values, entries, start), shape=shape), self.present[several]


def checked_motion(value: Any, free: np.ndarray, name: str) -> np.ndarray:
    """u0 or v0 of all dofs, zero at the fixed ones."""
    if value is None:
        return np.zeros(free.size)
    motion = vector(value, free.size, name)
    size = np.abs(motion[~free])
    if size.max(initial=0.0) > ROUNDING * np.abs(motion).max(initial=0.0):
        raise ValueError(f"{name} must be zero at fixed dofs, got up to {size.max():g}")
    return motion


def checked_levels(u: Any, n: int) -> np.ndarray:
    """(..., n) values of the uncut structure."""
    values = np.asarray(u)
    if values.dtype.kind not in "iuf":
        raise TypeError(f"u must hold real numbers, got dtype {values.dtype}")
    if values.ndim == 0 or values.shape[-1] != n:
        raise ValueError(
            f"u must have the {counted(n, 'dof')} of the uncut structure in its last dimension, "
            f"got shape {values.shape}"
        )
    require_finite(values, "u")
    return values
