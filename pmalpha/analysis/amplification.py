"""Amplification matrices of linear couplers, by pushing unit states through the core."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..run.coupler import Coupler
from ..setup.part import Part
from .borrowed import checked_coupler, state_kept, unloaded

__all__ = ["AmplificationMatrix", "amplification_matrix"]

# Arrays of a node of the core: u, v, w, a, vf, and what springs remember.
NODE_FIELDS = 6


class AmplificationMatrix(np.ndarray):
    """A square array with a name for each row (and column) in `names`."""

    names: tuple[str, ...]

    def __array_finalize__(self, other: Any) -> None:
        same = getattr(other, "shape", None) == self.shape
        self.names = getattr(other, "names", ()) if same else ()

    def __array_wrap__(self, array: np.ndarray, context: Any = None, scalar: bool = False) -> Any:
        """Results of arithmetic are plain: their rows have no names."""
        plain = np.asarray(array)
        return plain[()] if plain.ndim == 0 else plain


def amplification_matrix(coupler: Coupler) -> AmplificationMatrix:
    """G with X_{n+1} = G X_n over one macro step, equation (19).

    The coupler is taken past its start: double steps where they are taken. Loads are left out. The
    coupler itself stays as it is.

    Parameters
    ----------
    coupler : Coupler

    Returns
    -------
    G : (N, N) AmplificationMatrix
        The state X_n, subdomain by subdomain, equation (20):

        - single, at the finest step: u, v, w, a;
        - single and coarser: u, v, w, a and, on its interface dofs, the stored free velocity vf;
        - double: all of these at the own node before t_n, then at t_n.

        Under macro coupling u, v, w, a of all, twice if double, and at last the multipliers Lam.

        ``names`` says which row is what, such as ``"u[2] of tower at n-1"``. For a double-step
        subdomain with substeps, n-1 means the own node before.

    Raises
    ------
    ValueError
        When a subdomain has a restoring force, which no matrix represents.

    Notes
    -----
    Costs one macro step for each of the N states.

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
    """What one macro step makes of the unit states: the next states, (N, N), and Lam, (p, N)."""
    checked_coupler(coupler)._require_linear("amplification_matrix")
    layout = Layout(coupler)
    G = np.empty((layout.size, layout.size))
    lam = np.empty((coupler._row_place.size, layout.size))
    with coupler._entered(), state_kept(coupler), unloaded(coupler):
        for k, unit in enumerate(np.eye(layout.size)):
            layout.write(unit)
            coupler._core.advance(1, None)
            G[:, k] = layout.read()
            lam[:, k] = coupler._core.multipliers[coupler._row_place]
    return G, lam


class Layout:
    """Where the numbers of each subdomain stand in X."""

    def __init__(self, coupler: Coupler):
        self.coupler = coupler
        self.parts = coupler._parts
        macro = coupler._options["coupling"] == "macro"
        self.stored = [
            not macro and (p.double or p.subdomain.substeps < coupler._fine) for p in self.parts
        ]
        self.nodal = sum(
            (2 if p.double else 1) * (4 * p.n + stored * p.nb)
            for p, stored in zip(self.parts, self.stored)
        )
        # of the multipliers "pm" and "gc" remember nothing
        self.conditions = coupler._row_place if macro else np.arange(0)
        self.size = self.nodal + self.conditions.size

    def fields(self) -> Iterator[tuple[Part, int, np.ndarray]]:
        """Subdomain, index in the core's nodes, and places in elimination order, in the order of X.

        The core has the present first, X the node before it.
        """
        for part, stored in zip(self.parts, self.stored):
            interface = np.arange(part.nb) if stored else np.arange(0)
            for first in (NODE_FIELDS, 0) if part.double else (0,):
                for field in range(4):
                    yield part, first + field, part.position
                yield part, first + 4, interface

    def write(self, X: np.ndarray) -> None:
        """Put the whole problem into the state X, past its start."""
        nodes = {part.name: [x * 0.0 for x in part.core.levels()] for part in self.parts}
        begin = 0
        for part, field, places in self.fields():
            nodes[part.name][field][places] = X[begin : begin + places.size]
            begin += places.size
        for part in self.parts:
            part.core.set_levels(tuple(nodes[part.name]))
        zero = np.zeros(self.coupler._row_place.size)
        lam = zero.copy()
        lam[self.conditions] = X[self.nodal :]
        self.coupler._core.start(1, lam, zero)

    def read(self) -> np.ndarray:
        nodes = {part.name: part.core.levels() for part in self.parts}
        numbers = [nodes[p.name][field][places] for p, field, places in self.fields()]
        return np.concatenate([*numbers, self.coupler._core.multipliers[self.conditions]])

    def names(self) -> tuple[str, ...]:
        names = []
        for part, field, places in self.fields():
            symbol = ("u", "v", "w", "a", "vf")[field % NODE_FIELDS]
            when = "n-1" if field >= NODE_FIELDS else "n"
            dofs = np.arange(part.n) if field % NODE_FIELDS < 4 else part.order[part.n - part.nb :]
            names += [f"{symbol}[{d}] of {part.name} at {when}" for d in dofs[: places.size]]
        return (*names, *(f"Lam[{row}]" for row in range(self.conditions.size)))
