"""Amplification matrices of linear couplers, from macro steps of unit states in the core."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..run.coupler import Coupler
from ..setup.part import Part
from ..setup.schedule import MACRO
from .borrowed import checked_coupler, state_kept, unloaded

__all__ = ["AmplificationMatrix", "amplification_matrix"]

# Arrays of a time level in the core: u, v, w, a, vf, and history variables of springs.
LEVEL_FIELDS = 7


class AmplificationMatrix(np.ndarray):
    """A square array with the names of its rows (and columns) in `names`."""

    names: tuple[str, ...]

    def __array_finalize__(self, other: Any) -> None:
        same = getattr(other, "shape", None) == self.shape
        self.names = getattr(other, "names", ()) if same else ()

    def __array_wrap__(self, array: np.ndarray, context: Any = None, scalar: bool = False) -> Any:
        """Results of arithmetic are plain arrays, without names."""
        plain = np.asarray(array)
        return plain[()] if plain.ndim == 0 else plain


def amplification_matrix(coupler: Coupler) -> AmplificationMatrix:
    """G with X_{n+1} = G X_n over one macro step, equation (19).

    The step is after the start, so that double-step subdomains take double steps. Loads are not
    included. The state of the coupler is unchanged.

    Parameters
    ----------
    coupler : Coupler
        Of linear subdomains.

    Returns
    -------
    (N, N) AmplificationMatrix
        The state X_n, subdomain by subdomain, equation (20):

        - single step, the finest: u, v, w, a;
        - single step, coarser: u, v, w, a and, on the interface dofs, the stored free velocity vf;
        - double step: all of these at the time level of the subdomain before t_n, then at t_n.

        Under macro coupling u, v, w, a of all subdomains, at two time levels for a double step, and
        then the multipliers Lam.

        ``names`` has the names of the rows, such as ``"u[2] of tower at n-1"``. For a double-step
        subdomain with substeps, n-1 is its time level before t_n.

    Raises
    ------
    ValueError
        For a restoring force on a subdomain, which no matrix represents.

    Notes
    -----
    The cost is N macro steps.

    Examples
    --------
    >>> from pmalpha import models
    >>> G = amplification_matrix(models.split_oscillator(10.0, substeps=2).coupler(0.1))
    >>> G.shape, G.names[0]
    ((14, 14), 'u[0] of A at n-1')
    """
    matrix = propagation(coupler)[0].view(AmplificationMatrix)
    matrix.names = Layout(coupler).names()
    return matrix


def propagation(coupler: Coupler) -> tuple[np.ndarray, np.ndarray]:
    """One macro step of each unit state: the next states, (N, N), and Lam, (p, N)."""
    checked_coupler(coupler)._require_linear("amplification_matrix")
    layout = Layout(coupler)
    G = np.empty((layout.size, layout.size))
    lam = np.empty((coupler._row_position.size, layout.size))
    with coupler._entered(), state_kept(coupler), unloaded(coupler):
        for k, unit in enumerate(np.eye(layout.size)):
            layout.write(unit)
            coupler._core.advance(1, None)
            G[:, k] = layout.read()
            lam[:, k] = coupler._core.multipliers[coupler._row_position]
    return G, lam


class Layout:
    """The order of the numbers of all subdomains in X."""

    def __init__(self, coupler: Coupler):
        self.coupler = coupler
        self.parts = coupler._assemblies.of(coupler._steps.layout).parts  # as within state_kept
        fine = max(p.substeps for p in self.parts)
        macro = coupler._options["coupling"] in MACRO
        self.stored = [not macro and (p.double or p.substeps < fine) for p in self.parts]
        self.motion_size = sum(
            (2 if p.double else 1) * (4 * p.n + stored * p.nb)
            for p, stored in zip(self.parts, self.stored)
        )
        # the state has the multipliers under "macro" only
        self.rows = coupler._row_position if macro else np.arange(0)
        self.size = self.motion_size + self.rows.size

    def fields(self) -> Iterator[tuple[Part, int, np.ndarray]]:
        """Subdomain, index of its array in the core, and dofs in elimination order, as X has them.

        The core has the present time level first, X the one before it.
        """
        for part, stored in zip(self.parts, self.stored):
            interface = np.arange(part.nb) if stored else np.arange(0)
            for first in (LEVEL_FIELDS, 0) if part.double else (0,):
                for field in range(4):
                    yield part, first + field, part.position
                yield part, first + 4, interface

    def write(self, X: np.ndarray) -> None:
        """Set the state of the coupler to X, after the start."""
        arrays = {part.name: [x * 0.0 for x in part.core.levels()] for part in self.parts}
        begin = 0
        for part, field, indices in self.fields():
            arrays[part.name][field][indices] = X[begin : begin + indices.size]
            begin += indices.size
        for part in self.parts:
            part.core.set_levels(tuple(arrays[part.name]))
        zero = np.zeros(self.coupler._row_position.size)
        lam = zero.copy()
        lam[self.rows] = X[self.motion_size :]
        self.coupler._core.start(1, lam, zero)

    def read(self) -> np.ndarray:
        """The present state X."""
        arrays = {part.name: part.core.levels() for part in self.parts}
        numbers = [arrays[p.name][field][indices] for p, field, indices in self.fields()]
        return np.concatenate([*numbers, self.coupler._core.multipliers[self.rows]])

    def names(self) -> tuple[str, ...]:
        names = []
        for part, field, indices in self.fields():
            symbol = ("u", "v", "w", "a", "vf")[field % LEVEL_FIELDS]
            when = "n-1" if field >= LEVEL_FIELDS else "n"
            dofs = np.arange(part.n) if field % LEVEL_FIELDS < 4 else part.order[part.n - part.nb :]
            names += [f"{symbol}[{d}] of {part.name} at {when}" for d in dofs[: indices.size]]
        return (*names, *(f"Lam[{row}]" for row in range(self.rows.size)))
