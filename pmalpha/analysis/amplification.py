"""Amplification matrices of linear couplers, from macro steps of unit states in the core."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from .._core import LANES
from ..errors import InstabilityError
from ..run.coupler import Coupler
from ..run.session import require_linear
from ..setup.core_rows import CoreRows
from ..setup.schedule import MACRO
from .kept_state import checked_coupler, state_kept, unloaded

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
    InstabilityError
        When one macro step of a unit state leaves the range of floating-point numbers.

    Notes
    -----
    The cost is N macro steps, eight of them side by side as in `Coupler.run_each`, one by one with
    ``drift="removed"``.

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
    require_linear(checked_coupler(coupler)._session, "amplification_matrix")
    layout = Layout(coupler)
    size, rows = layout.size, coupler._session.core_rows
    G, lam = np.empty((size, size)), np.empty((rows.p, size))
    with coupler._session.guard, _stepper(coupler, layout) as (core, cores, lanes):
        for begin in range(0, size, lanes):
            layout.write(core, cores, np.eye(size, lanes, -begin))
            unstable = core.advance(1, None)
            if unstable is not None:
                names = [part.name for part in layout.parts]
                raise InstabilityError(1, coupler.dt, [*names, "interface"][unstable])
            end = min(begin + lanes, size)
            G[:, begin:end] = layout.read(core, cores, lanes)[:, : end - begin]
            now = core.multipliers.reshape(-1, lanes)[:, : end - begin]
            lam[:, begin:end] = rows.forces(now.T).T
    return G, lam


@contextmanager
def _stepper(coupler: Coupler, layout: Layout) -> Iterator[tuple[Any, Sequence[Any], int]]:
    """A coupler of the core for unit states, its subdomains, and how many states are side by side.

    Second multipliers have no lanes: the coupler itself is borrowed where drift is removed.
    """
    if coupler._session.options.drift == "removed":
        with state_kept(coupler), unloaded(coupler):
            yield layout.core, [part.core for part in layout.parts], 1
    else:
        cores = tuple(part.core.in_lanes() for part in layout.parts)
        yield layout.core.in_lanes(cores), cores, LANES


class Layout:
    """The order of the numbers of all subdomains in X.

    Attributes
    ----------
    parts : tuple of Part
    core : _core.Coupler
        Of the present steps of the coupler, as `parts`.
    size : int
        Numbers in X.
    """

    def __init__(self, coupler: Coupler):
        assembly = coupler._session.assemblies.of(coupler._session.steps.layout)
        self.parts, self.core = assembly.parts, assembly.core
        fine = max(p.substeps for p in self.parts)
        macro = coupler._session.options.coupling in MACRO
        self.stored = [not macro and (p.double or p.substeps < fine) for p in self.parts]
        self.motion_size = sum(
            (2 if p.double else 1) * (4 * p.n + stored * p.nb)
            for p, stored in zip(self.parts, self.stored)
        )
        # the state has the multipliers under "macro" only
        self.rows = coupler._session.core_rows if macro else CoreRows(np.arange(0), np.ones(0))
        self.size = self.motion_size + self.rows.p

    def fields(self) -> Iterator[tuple[int, int, np.ndarray]]:
        """Index of the subdomain, of its array in the core, and dofs in elimination order, as X has
        them.

        The core has the present time level first, X the one before it.
        """
        for i, (part, stored) in enumerate(zip(self.parts, self.stored)):
            interface = np.arange(part.nb) if stored else np.arange(0)
            for first in (LEVEL_FIELDS, 0) if part.double else (0,):
                for field in range(4):
                    yield i, first + field, part.position
                yield i, first + 4, interface

    def write(self, core: Any, cores: Sequence[Any], X: np.ndarray) -> None:
        """Set the state of a coupler of the core to X, (size, lanes), after the start."""
        lanes = X.shape[1]
        arrays = [[np.zeros((x.size // lanes, lanes)) for x in own.levels()] for own in cores]
        begin = 0
        for i, field, indices in self.fields():
            arrays[i][field][indices] = X[begin : begin + indices.size]
            begin += indices.size
        for own, levels in zip(cores, arrays):
            own.set_levels(tuple(x.ravel() for x in levels))
        zero = np.zeros_like(core.multipliers)
        lam = zero.copy()
        if self.rows.p:
            lam = self.rows.forces_in_core(X[self.motion_size :].T).T.ravel()
        core.start(1, lam, zero)

    def read(self, core: Any, cores: Sequence[Any], lanes: int) -> np.ndarray:
        """The present state X, (size, lanes), of a coupler of the core."""
        arrays = [[x.reshape(-1, lanes) for x in own.levels()] for own in cores]
        numbers = [arrays[i][field][indices] for i, field, indices in self.fields()]
        lam = core.multipliers.reshape(-1, lanes)[: self.rows.p]
        return np.concatenate([*numbers, self.rows.forces(lam.T).T])

    def names(self) -> tuple[str, ...]:
        names = []
        for i, field, indices in self.fields():
            part = self.parts[i]
            symbol = ("u", "v", "w", "a", "vf")[field % LEVEL_FIELDS]
            when = "n-1" if field >= LEVEL_FIELDS else "n"
            dofs = np.arange(part.n) if field % LEVEL_FIELDS < 4 else part.order[part.n - part.nb :]
            names += [f"{symbol}[{d}] of {part.name} at {when}" for d in dofs[: indices.size]]
        return (*names, *(f"Lam[{row}]" for row in range(self.rows.p)))
