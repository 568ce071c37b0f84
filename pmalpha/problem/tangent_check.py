"""Comparison of the tangents of an internal force with central differences of the force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from .evaluation import evaluated
from .matrices import dense, sparse
from .tangents import Tangent

__all__ = ["TangentCheck"]


def __dir__() -> list[str]:
    return sorted(__all__)


@dataclass(frozen=True)
class TangentCheck:
    """How well the tangents of an `InternalForce` agree with central differences of its force.

    Attributes
    ----------
    error : float
        Largest disagreement over `scale`, less the estimated error of the difference itself; inf
        where a value is not finite. A consistent tangent has less than 1e-6.
    matrix : {"K_t", "C_t"}
        The tangent with the largest error.
    row, column : int
        Where it is: the force on dof `row`, and the dof `column` that was moved.
    given, difference : float
        The entry as returned, zero for a tangent that is None, and by central differences.
    scale : float
        Largest magnitude in that tangent, returned or by differences.
    """

    error: float
    matrix: str
    row: int
    column: int
    given: float
    difference: float
    scale: float

    def __str__(self) -> str:
        return (
            f"K_t and C_t differ from differences of f by up to {self.error:.2g} of the largest "
            f"entry, in {self.matrix} in the column of dof {self.column}: {self.given:g} given at "
            f"[{self.row}, {self.column}], {self.difference:g} by differences"
        )


def check_tangents(
    force: Any, t: float, u: np.ndarray, v: np.ndarray, q: np.ndarray, step: float
) -> TangentCheck:
    """The check of `InternalForce.check`; u, v (n,), q (m,)."""

    def f(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return evaluated(force, "evaluate", t, u, v, q)[0]

    _, K, C, _ = evaluated(force, "evaluate", t, u, v, q)
    of_u = _worst("K_t", K, lambda x: f(x, v), u, step)
    of_v = _worst("C_t", C, lambda x: f(u, x), v, step)
    return of_v if of_v.error > of_u.error else of_u


def _worst(
    name: str, A: Tangent, f: Callable[..., Any], x: np.ndarray, step: float
) -> TangentCheck:
    """The entry of A that differs most from differences of f, column by column."""
    h = step * (float(np.max(np.abs(x))) or 1.0)
    worst, scale = (-1.0, 0, 0, 0.0, 0.0), 0.0
    matrix = sparse(A, x.size)
    columns = sp.csc_array(matrix) if sp.issparse(A) else matrix.toarray()
    for j in range(x.size):
        values = dense(columns[:, [j]]).ravel()
        difference, doubt = _difference(f, x, j, h)
        with np.errstate(invalid="ignore"):
            apart = np.abs(difference - values) - doubt
        apart[np.isnan(apart)] = np.inf
        i = int(np.argmax(apart))
        if apart[i] > worst[0]:
            worst = (max(0.0, float(apart[i])), i, j, float(values[i]), float(difference[i]))
        scale = float(max(scale, np.max(np.abs(values)), np.max(np.abs(difference))))
    most, i, j, one, other = worst
    error = np.inf if not np.isfinite(most) else most / scale if scale else 0.0
    return TangentCheck(error, name, i, j, one, other, scale)


def _difference(
    f: Callable[..., Any], x: np.ndarray, j: int, h: float
) -> tuple[np.ndarray, np.ndarray]:
    """df/dx_j by (f(x + h) - f(x - h)) / 2 h, and by how much twice the h changes it.

    The latter bounds the truncation error of laws such as abs(v) v at v = 0, where all entries are
    zero and those of a difference only small.
    """
    slopes = []
    for distance in (h, 2.0 * h):
        up, down = x.copy(), x.copy()
        up[j], down[j] = x[j] + distance, x[j] - distance
        slopes.append((f(up) - f(down)) / (up[j] - down[j]))
    return slopes[0], np.abs(slopes[1] - slopes[0])
