"""Storeys of frames: levels, drifts and the force of the supports."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

# Heights and forces are equal up to this fraction of the largest one.
EQUAL = 1e-9


def storey_drifts(structure: Any, component: str) -> sp.csr_array:
    """The implementation of `Structure.storey_drifts`."""
    if set(structure.elements) != {"line"} or component not in structure.components:
        raise ValueError(
            f"storey_drifts needs elements 'line' with a component {component!r}, got "
            f"{sorted(structure.elements)} with {structure.components}"
        )
    along = structure.points.shape[1] == 1
    levels = chain_levels(structure) if along else levels_of(structure)
    means = [_mean(structure, nodes, component) for nodes in levels]
    if along and ground_springs(structure, component)[: structure.dofs_per_node].any():
        means.insert(0, sp.csr_array((1, structure.n)))  # the ground is the level below
    if len(means) < 2:
        raise ValueError("storey_drifts needs two levels with horizontal members, got fewer")
    return sp.csr_array(sp.vstack([b - a for a, b in zip(means, means[1:])], format="csr"))


def chain_levels(structure: Any) -> list[np.ndarray]:
    """Every node of a chain or rod, along it."""
    order: np.ndarray = np.argsort(structure.points[:, 0], kind="stable")
    return [order[i : i + 1] for i in range(len(order))]


def levels_of(structure: Any) -> list[np.ndarray]:
    """The nodes of each level, from the lowest: the feet, and where horizontal members end."""
    heights = structure.points[:, -1]
    tolerance = EQUAL * np.ptp(structure.points, axis=0).max()
    ends = structure.elements["line"]
    horizontal = np.abs(heights[ends[:, 1]] - heights[ends[:, 0]]) <= tolerance
    of_beams = np.unique(ends[horizontal])
    lowest = np.flatnonzero(heights <= heights.min() + tolerance)
    nodes = np.union1d(of_beams, lowest)
    order = nodes[np.argsort(heights[nodes], kind="stable")]
    steps = np.flatnonzero(np.diff(heights[order]) > tolerance) + 1
    return np.split(order, steps)


def base_shear(structure: Any, nodes: Any, component: str) -> sp.csr_array:
    """The implementation of `Structure.base_shear`."""
    K = sp.csr_array(structure.K)
    if nodes is None:
        springs = ground_springs(structure, component)
        if springs.any():
            return sp.csr_array(-springs[None, :])
        heights = structure.points[:, -1]
        nodes = np.flatnonzero(heights <= heights.min() + EQUAL * np.ptp(heights))
    rows = K[structure.dofs(nodes, component)]
    return sp.csr_array(np.ones((1, rows.shape[0])) @ rows)


def ground_springs(structure: Any, component: str) -> np.ndarray:
    """Stiffness of springs to the ground at each dof: the forces of a unit translation."""
    unit = np.zeros(structure.n)
    unit[structure.components.index(component) :: structure.dofs_per_node] = 1.0
    K = sp.csr_array(structure.K)
    springs: np.ndarray = K @ unit
    springs[np.abs(springs) <= EQUAL * np.abs(K).max()] = 0.0
    return springs


def _mean(structure: Any, nodes: np.ndarray, component: str) -> sp.csr_array:
    """The row of the mean displacement of some nodes."""
    dofs = structure.dofs(nodes, component)
    where = (np.zeros(dofs.size, int), dofs)
    return sp.csr_array((np.full(dofs.size, 1.0 / dofs.size), where), shape=(1, structure.n))
