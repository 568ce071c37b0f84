"""Amplification matrices, spectra, stability limits and errors of linear couplers.

Every figure comes from pushing states through the core that runs, so that what is analysed is
what is used. Equations in docs/method.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from .assembly import Part
from .coupler import Coupler

__all__ = ["AmplificationMatrix", "amplification_matrix"]


class AmplificationMatrix(np.ndarray):
    """A square array with a name for each row (and column) in `names`."""

    names: tuple[str, ...]

    def __array_finalize__(self, other: Any) -> None:
        self.names = getattr(other, "names", ())


def amplification_matrix(coupler: Coupler) -> AmplificationMatrix:
    """G with X_{n+1} = G X_n over one macro step, equation (19).

    The coupler is taken past its start: double steps where they are taken. Loads are left out. The
    coupler itself stays as it is.

    Parameters
    ----------
    coupler : Coupler

    Returns
    -------
    (N, N) AmplificationMatrix
        The state X_n, subdomain by subdomain, equation (20):

        - single, at the finest step: u, v, w, a;
        - single and coarser: u, v, w, a and, on its interface dofs, the stored free velocity vf;
        - double: all of these at the own node before t_n, then at t_n.

        ``names`` says which row is what, such as ``"u[2] of tower at n-1"``. For a double-step
        subdomain with substeps, n-1 means the own node before.

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
    layout = _Layout(coupler)
    G = np.empty((layout.size, layout.size))
    with coupler._entered(), _state_kept(coupler):
        for k in range(layout.size):
            unit = np.zeros(layout.size)
            unit[k] = 1.0
            layout.write(unit)
            coupler._core.advance(1, None)
            G[:, k] = layout.read()
    matrix = G.view(AmplificationMatrix)
    matrix.names = layout.names()
    return matrix


class _Layout:
    """Where the numbers of each subdomain stand in X."""

    def __init__(self, coupler: Coupler):
        self.coupler = coupler
        self.parts = coupler._parts
        self.stored = [p.double or p.subdomain.substeps < coupler._fine for p in self.parts]
        self.size = sum(
            (2 if p.double else 1) * (4 * p.n + stored * p.nb)
            for p, stored in zip(self.parts, self.stored)
        )

    def fields(self) -> Iterator[tuple[Part, int, np.ndarray]]:
        """Subdomain, index in the core's nodes, and places in elimination order, in the order of X.

        The core has the present first, X the node before it.
        """
        for part, stored in zip(self.parts, self.stored):
            interface = np.arange(part.nb) if stored else np.arange(0)
            for first in (5, 0) if part.double else (0,):
                for field in range(4):
                    yield part, first + field, part.place
                yield part, first + 4, interface

    def write(self, X: np.ndarray) -> None:
        """Put the whole problem into the state X, past its start."""
        nodes = {part.name: [x * 0.0 for x in part.core.nodes()] for part in self.parts}
        begin = 0
        for part, field, places in self.fields():
            nodes[part.name][field][places] = X[begin : begin + places.size]
            begin += places.size
        for part in self.parts:
            part.core.set_nodes(tuple(nodes[part.name]))
        lam = np.zeros(self.coupler._row_place.size)  # no step reads it
        self.coupler._core.start(1, lam)

    def read(self) -> np.ndarray:
        nodes = {part.name: part.core.nodes() for part in self.parts}
        return np.concatenate([nodes[p.name][field][places] for p, field, places in self.fields()])

    def names(self) -> tuple[str, ...]:
        names = []
        for part, field, places in self.fields():
            symbol = ("u", "v", "w", "a", "vf")[field % 5]
            when = "n-1" if field >= 5 else "n"
            dofs = np.arange(part.n) if field % 5 < 4 else part.order[part.n - part.nb :]
            names += [f"{symbol}[{d}] of {part.name} at {when}" for d in dofs[: places.size]]
        return tuple(names)


@contextmanager
def _state_kept(coupler: Coupler) -> Iterator[None]:
    """No loads meanwhile; afterwards everything is as it was."""
    coupler._start()
    nodes = [part.core.nodes() for part in coupler._parts]
    step_count, lam = coupler._core.step_count, coupler._core.multipliers
    for part in coupler._parts:
        part.core.set_load(None)
    try:
        yield
    finally:
        for part, kept in zip(coupler._parts, nodes):
            part.core.set_nodes(kept)
        coupler._core.start(step_count, lam)
        coupler._load_core()
