"""What is attached to the nodes of a structure: point masses, springs, dashpots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from .._checks import listing, real_array
from ..problem.dofs import GROUND, dof_list, spring_dofs

__all__ = ["Attached"]


class Attached(NamedTuple):
    """Masses and dashpots at single nodes, and springs with dampers between two dofs."""

    mass: np.ndarray  # (n,)
    dashpots: sp.csr_array  # (n, n), between the dofs of a node alone
    dofs: np.ndarray  # (m, 2) int, -1 for the ground
    k: np.ndarray  # (m,)
    c: np.ndarray  # (m,)

    @classmethod
    def none(cls, n: int) -> Attached:
        pairs = np.zeros((0, 2), dtype=np.int64)
        return cls(np.zeros(n), sp.csr_array((n, n)), pairs, np.zeros(0), np.zeros(0))

    @property
    def K(self) -> sp.csr_array:
        return _between(self.dofs, self.k, self.mass.size)

    @property
    def C(self) -> sp.csr_array:
        return sp.csr_array(self.dashpots + _between(self.dofs, self.c, self.mass.size))

    def on(self, dofs: np.ndarray, at_nodes: np.ndarray, springs: np.ndarray) -> Attached:
        """What of it belongs to a part with these dofs, numbered in their order.

        at_nodes: (n,) bool, whether what is at the node of a dof belongs to it.
        springs: (m,) bool, which springs do; their dofs are of the part.
        """
        number = np.full(self.mass.size + 1, GROUND)
        number[dofs] = np.arange(dofs.size)
        chosen = np.where(at_nodes, 1.0, 0.0)
        dashpots = sp.csr_array(sp.diags_array(chosen) @ self.dashpots)[dofs][:, dofs]
        pairs = number[self.dofs[springs]]
        mass = (chosen * self.mass)[dofs]
        return Attached(mass, dashpots, pairs, self.k[springs], self.c[springs])


def _between(dofs: np.ndarray, values: np.ndarray, n: int) -> sp.csr_array:
    """sum B^T k B, (n, n), of springs between dofs (m, 2)."""
    first, second = dofs.T
    rows = np.concatenate([first, second, first, second])
    columns = np.concatenate([first, second, second, first])
    entries = np.concatenate([values, values, -values, -values])
    inside = (rows != GROUND) & (columns != GROUND)
    return sp.csr_array((entries[inside], (rows[inside], columns[inside])), shape=(n, n))


def not_negative(value: Any, name: str, count: int) -> np.ndarray:
    """(count,) from a number or an array."""
    numbers = real_array(value, name, (0, 1))
    if numbers.ndim == 1 and numbers.shape != (count,):
        raise ValueError(f"{name} must be a number or of shape ({count},), got {numbers.shape}")
    if np.any(numbers < 0.0):
        raise ValueError(f"{name} must not be negative, got {numbers.min():g}")
    return np.array(np.broadcast_to(numbers, (count,)), dtype=float)


def placed_springs(dofs: Any, n: int, names: Any) -> np.ndarray:
    """(m, 2) numbers of dofs, -1 for the ground, of springs as they are given to `CubicSpring`."""
    pairs = spring_dofs(dofs)
    if pairs.dtype != object:
        dof_list(np.unique(pairs[pairs != GROUND]), n, "dofs")
        return pairs
    placed = [
        [GROUND if x is None else int(dof_list(x, n, "dofs", names)[0]) for x in pair]
        for pair in pairs
    ]
    return np.array(placed, dtype=np.int64)


def moved_masses(
    M: Any, elements: Mapping[str, np.ndarray], light: np.ndarray, d: int, share: float
) -> np.ndarray:
    """(n,) what is added to a lumped mass where a share of that of the light nodes goes to the
    other nodes of their elements."""
    A = sp.coo_array(M)
    if np.any((A.row != A.col) & (A.data != 0.0)):
        raise ValueError('lump needs a lumped mass, as of mass="lumped", got a consistent one')
    masses = sp.csr_array(M).diagonal().reshape(-1, d)
    N = len(light)
    weights = sp.csr_array((N, N))  # of the light nodes to the others
    for nodes in elements.values():
        e, a = nodes.shape
        first, second = np.repeat(nodes, a, axis=1).ravel(), np.tile(nodes, (1, a)).ravel()
        chosen = light[first] & ~light[second]
        heavy = np.repeat(np.maximum((~light[nodes]).sum(axis=1), 1), a * a)[chosen]
        where = (first[chosen], second[chosen])
        weights = weights + sp.csr_array((1.0 / heavy, where), shape=(N, N))
    sums = weights.sum(axis=1)
    alone = np.flatnonzero(light & (sums == 0.0))
    if alone.size:
        raise ValueError(
            "away_from must leave a neighbour to every node, an element that has nodes of both "
            f"kinds, got none at {listing(alone)}"
        )
    shares = sp.diags_array(np.where(light, share / np.where(sums > 0.0, sums, 1.0), 0.0)) @ weights
    added: np.ndarray = (shares.T @ masses) - np.where(light, share, 0.0)[:, None] * masses
    return added.ravel()
