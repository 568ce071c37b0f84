"""Contact of nodes with rigid obstacles, by penalty, without friction."""

from __future__ import annotations

import math
from copy import copy
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from .._checks import flag, plain_array, positive_number, vector
from ..problem.dofs import dof_list
from .checked import positive
from .element_force import Conservative
from .pattern import Assembly
from .structure import Structure

__all__ = ["plane_contact", "sphere_contact"]


def plane_contact(
    structure: Structure, nodes: Any, *, point: ArrayLike, normal: ArrayLike, stiffness: ArrayLike
) -> ContactForce:
    """Contact of nodes with a rigid plane, or in two dimensions a line, without friction.

    With the gap g = n . (x - p), negative inside, the force on a node is -k g n where g < 0, else
    zero: the penetration under a force R is R / k. In the equation of motion it is an internal
    force, f = k g n.

    Parameters
    ----------
    structure : Structure
        In the plane or in space; what is used are its points and dofs.
    nodes : int or (m,) array of int
        The nodes that can touch the plane.
    point : (dim,) array_like
        A point p of the plane.
    normal : (dim,) array_like
        Towards the free side, of any length above 0.
    stiffness : float or (m,) array_like
        Penalty k of each node, force per length, above 0: ten to a hundred times the stiffness of
        the structure at a node. In an explicit subdomain the critical step is at most
        2 sqrt(m / k) for the mass m of the node.

    Returns
    -------
    ElementForce
        To be added by `Structure.with_internal`.

    Raises
    ------
    TypeError, ValueError
        For nodes out of range or repeated, vectors of another length, a normal of zero, and
        stiffnesses that are not positive.

    Examples
    --------
    >>> from pmalpha import structures
    >>> bar = structures.truss([[0, 0], [0, 1]], [[0, 1]], EA=1.0, rhoA=1.0)
    >>> floor = structures.plane_contact(bar, 0, point=[0, -0.1], normal=[0, 1], stiffness=50.0)
    >>> floor.residual([0.0, -0.3, 0.0, 0.0]).round(12).tolist()  # pushed up by 10
    [0.0, -10.0, 0.0, 0.0]
    """
    dim = _dimension(structure)
    direction = vector(normal, dim, "normal")
    size = math.hypot(*direction)
    if not 0.0 < size < np.inf:
        raise ValueError(
            f"normal must not be zero, and its length must be finite, got {direction.tolist()}"
        )
    return PlaneContact(structure, nodes, stiffness, vector(point, dim, "point"), direction / size)


def sphere_contact(
    structure: Structure,
    nodes: Any,
    *,
    center: ArrayLike,
    radius: float,
    stiffness: ArrayLike,
    inside: bool = False,
) -> ContactForce:
    """Contact of nodes with a rigid sphere, or in two dimensions a circle, without friction.

    As `plane_contact`, with the gap ``g = |x - c| - R`` and n from the center to the node; with
    `inside` the nodes are held within the sphere, and both have the other sign.

    Parameters
    ----------
    structure : Structure
        Whose nodes they are.
    nodes : int or (m,) array of int
        The nodes that can touch the sphere.
    center : (dim,) array_like
        Its coordinates.
    radius : float
        Above 0.
    stiffness : float or (m,) array_like
        Penalty k of each node, force per length, above 0.
    inside : bool, default False
        Whether the nodes are held within the sphere.

    Returns
    -------
    ElementForce
        To be added by `Structure.with_internal`.

    Raises
    ------
    TypeError, ValueError
        For nodes out of range or repeated, a center of another length, and numbers that are not
        positive.

    Examples
    --------
    >>> from pmalpha import structures
    >>> bar = structures.truss([[0, 0, 1], [0, 0, 3]], [[0, 1]], EA=1.0, rhoA=1.0)
    >>> ball = structures.sphere_contact(bar, 0, center=[0, 0, 0], radius=0.9, stiffness=50.0)
    >>> ball.residual([0.0, 0.0, -0.3, 0.0, 0.0, 0.0]).round(12).tolist()
    [0.0, 0.0, -10.0, 0.0, 0.0, 0.0]
    """
    centre = vector(center, _dimension(structure), "center")
    size = positive_number(radius, "radius")
    sign = -1.0 if flag(inside, "inside") else 1.0
    return SphereContact(structure, nodes, stiffness, centre, size, sign)


def _dimension(structure: Any) -> int:
    if not isinstance(structure, Structure):
        raise TypeError(f"structure must be a Structure, got {structure!r}")
    result: int = structure.points.shape[1]
    return result


class ContactForce(Conservative):
    def __init__(self, structure: Structure, nodes: Any, stiffness: ArrayLike):
        chosen = dof_list(plain_array(nodes, "nodes"), len(structure.points), "nodes")
        if not chosen.size:
            raise ValueError("nodes must not be empty")
        d = structure.dofs_per_node
        self._assembly = Assembly(chosen[:, None], len(structure.points), d)
        self._start = structure.points[chosen]
        k = positive(stiffness, "stiffness", (chosen.size,))
        self._k = np.broadcast_to(k, chosen.size)
        super().__init__(self._assembly.pattern)

    def of_nodes(self, number: np.ndarray, nodes: int) -> ContactForce | None:
        new_nodes = number[self._assembly.elements[:, 0]]
        mask = new_nodes >= 0
        if not mask.any():
            return None
        part = copy(self)
        part._assembly = Assembly(new_nodes[mask][:, None], nodes, self._assembly.d)
        part._start, part._k = self._start[mask], self._k[mask]
        super(ContactForce, part).__init__(part._assembly.pattern)
        return part

    def _gaps(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gaps (m,), normals n (m, dim), and the curvature c of dn/dx = c (1 - n n^T)."""
        raise NotImplementedError

    def _at(self, u: np.ndarray) -> np.ndarray:
        moved = u.reshape(self._assembly.nodes, -1)[self._assembly.elements[:, 0]]
        result: np.ndarray = self._start + moved[:, : self._start.shape[1]]
        return result

    def _evaluate(
        self, u: np.ndarray, q: np.ndarray, tangent: bool
    ) -> tuple[np.ndarray, Any, np.ndarray]:
        x = self._at(u)
        gap, n, curvature = self._gaps(x)
        touching = gap < 0.0
        dim, d = x.shape[1], self._assembly.d
        forces = np.zeros((len(x), 1, d))
        push = np.where(touching, self._k * gap, 0.0)
        forces[:, 0, :dim] = push[:, None] * n
        f = self._assembly.force(forces)
        if not tangent:
            return f, None, q
        # df/dx = k n n^T + k g c (1 - n n^T)
        across = push * curvature
        K = (np.where(touching, self._k, 0.0) - across)[:, None, None] * n[:, :, None] * n[:, None]
        K += across[:, None, None] * np.eye(dim)
        values = np.zeros((len(x), 1, d, 1, d))
        values[:, 0, :dim, 0, :dim] = K
        return f, self._assembly.tangent(values), q

    def largest_tangent(self) -> sp.csr_array:
        """k n n^T of every node, or k where the normal turns; on spheres k g c is left out."""
        dim, d = self._start.shape[1], self._assembly.d
        values = np.zeros((len(self._start), 1, d, 1, d))
        values[:, 0, :dim, 0, :dim] = self._k[:, None, None] * self._directions()
        return self._assembly.tangent(values)

    def _directions(self) -> np.ndarray:
        """(dim, dim): at least n n^T for every normal."""
        return np.eye(self._start.shape[1])

    def _potential(self, u: np.ndarray) -> float:
        gap, _, _ = self._gaps(self._at(u))
        return float(np.sum(0.5 * self._k * np.minimum(gap, 0.0) ** 2))


class PlaneContact(ContactForce):
    def __init__(
        self,
        structure: Structure,
        nodes: Any,
        stiffness: ArrayLike,
        point: np.ndarray,
        normal: np.ndarray,
    ):
        super().__init__(structure, nodes, stiffness)
        self._point, self._normal = point, normal

    def _directions(self) -> np.ndarray:
        return np.outer(self._normal, self._normal)

    def _gaps(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        gap = (x - self._point) @ self._normal
        return gap, np.broadcast_to(self._normal, x.shape), np.zeros(len(x))


class SphereContact(ContactForce):
    def __init__(
        self,
        structure: Structure,
        nodes: Any,
        stiffness: ArrayLike,
        center: np.ndarray,
        radius: float,
        sign: float,
    ):
        super().__init__(structure, nodes, stiffness)
        self._center, self._radius, self._sign = center, radius, sign

    def _gaps(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        away = x - self._center
        distance = np.sqrt(np.sum(away * away, axis=1))
        with np.errstate(divide="ignore", invalid="ignore"):
            normal = self._sign * away / distance[:, None]
            curvature = self._sign / distance
        return self._sign * (distance - self._radius), normal, curvature
