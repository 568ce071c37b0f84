"""Linkages between dofs of a structure and actuators, equation (Y17)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._checks import real_array
from ..problem import forms
from ..problem.device import DEFAULT_STEPS, Device

# A matrix with a smaller ratio of its singular values is taken as singular.
SINGULAR = 1e-12


class Linkage(Device):
    """A specimen whose actuators move combinations of the dofs of a structure.

    Actuators get the commands J d and, for compensators among them, J d' and J d'' + J' d';
    the structure gets the forces J^T f, and the displacements that were measured as those of its
    dofs. Give a matrix J, or the two arms of a displacement and a rotation (in radians), which turn
    by finite angles.

    Parameters
    ----------
    specimen : callable, LowLevelCallable, springs, LinearActuator, SimulatedActuator, Compensated
        In the displacements of the actuators, of which there are as many as dofs.
    matrix : (n, n) array_like, optional
        J.
    arms : [(length, angle), (length, angle)], optional
        Of two actuators, angles in radians: actuator i moves by
        ``x + length (cos(theta - angle) - cos(angle))``.

    Examples
    --------
    >>> two = rig.Linkage(lambda t, u, v: 3.0 * u, arms=[(0.3, 0.45), (0.3, -0.45)])
    >>> two.to_actuators([0.02, 0.01]).round(6).tolist()
    [0.021291, 0.018682]
    >>> two.to_dofs(two.to_actuators([0.02, 0.01])).round(12).tolist()
    [0.02, 0.01]
    """

    leads = needs_acceleration = True

    def __init__(self, specimen: Any, matrix: Any = None, *, arms: Any = None):
        super().__init__(specimen, 0.0, DEFAULT_STEPS)
        if (matrix is None) == (arms is None):
            raise TypeError("give one of matrix and arms")
        self.arms = None if arms is None else _arms(arms)
        self.matrix = self.jacobian(np.zeros(2)) if matrix is None else _square(matrix)
        sizes = np.linalg.svd(self.matrix, compute_uv=False)
        if not sizes[-1] > SINGULAR * sizes[0]:
            name = "matrix" if arms is None else "arms"
            raise ValueError(
                f"{name} must not be singular, got {(matrix if arms is None else arms)!r}"
            )

    def to_actuators(self, d: Any) -> np.ndarray:
        """Displacements of actuators, (n,) or (k, n), for those of the dofs.

        Parameters
        ----------
        d : (n,) or (k, n) array_like
            Displacements of the dofs.

        Returns
        -------
        array
            Shaped as d.
        """
        d = real_array(d, "d", (1, 2))
        if self.arms is None:
            return np.asarray(d @ self.matrix.T)
        length, angle = self.arms.T
        x, theta = d[..., :1], d[..., 1:]
        return np.asarray(x + length * (np.cos(theta - angle) - np.cos(angle)))

    def to_dofs(self, x: Any) -> np.ndarray:
        """Displacements of the dofs, (n,) or (k, n), for those of the actuators.

        Parameters
        ----------
        x : (n,) or (k, n) array_like
            Displacements of the actuators.

        Returns
        -------
        array
            Shaped as x.
        """
        x = real_array(x, "x", (1, 2))
        if self.arms is None:
            return np.asarray(np.linalg.solve(self.matrix, x.T).T)
        length, angle = self.arms.T
        P, Q = (float(y[0] - y[1]) for y in (length * np.cos(angle), length * np.sin(angle)))
        turn = np.arcsin((x[..., 0] - x[..., 1] + P) / np.hypot(P, Q))
        theta = np.copysign(1.0, Q) * (turn - np.arctan2(P, abs(Q)))
        first = x[..., 0] - length[0] * (np.cos(theta - angle[0]) - np.cos(angle[0]))
        return np.stack([first, theta], axis=-1)

    def jacobian(self, d: Any) -> np.ndarray:
        """J at displacements of the dofs, (n, n).

        Parameters
        ----------
        d : (n,) array_like
            Of the dofs.

        Returns
        -------
        (n, n) array
            A row for each actuator.
        """
        d = real_array(d, "d")
        if self.arms is None:
            return self.matrix
        length, angle = self.arms.T
        return np.column_stack([np.ones(2), -length * np.sin(d[1] - angle)])

    @property
    def facts(self) -> str:
        """Its parameters, for the comparison of problems."""
        of = self.matrix if self.arms is None else self.arms
        return f"Linkage {'matrix' if self.arms is None else 'arms'}={of.tolist()!r}"

    def _check_width(self, n: int, label: str) -> None:
        width = n if self.width is None else self.width
        if len(self.matrix) != width:
            raise ValueError(
                f"{label}: a Linkage of {len(self.matrix)} dofs must have as many commands behind "
                f"it, got {width}"
            )

    def _filter(self, h: float, width: int) -> forms.Filter:
        if self.arms is not None:
            return forms.LinkageArms(self.arms)
        inverse = np.ascontiguousarray(np.linalg.inv(self.matrix))
        return forms.LinkageMatrix(self.matrix, inverse)


def _arms(arms: Sequence[Any]) -> np.ndarray:
    array = real_array(arms, "arms", 2)
    if array.shape != (2, 2):
        raise ValueError(f"arms must be two pairs of length and angle, got shape {array.shape}")
    return np.ascontiguousarray(array)


def _square(matrix: Any) -> np.ndarray:
    J = real_array(matrix, "matrix", 2)
    if J.shape[0] != J.shape[1] or J.size == 0:
        raise ValueError(f"matrix must be square, got shape {J.shape}")
    return np.ascontiguousarray(J)
