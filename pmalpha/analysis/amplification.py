"""Amplification matrices of linear couplers, from macro steps of unit states in the core."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ..results.times import clock_of
from ..run.coupler import Coupler
from ..run.session import require_linear, take
from ..run.snapshot import restore_snapshot, snapshot_of
from ..run.transfer import Steps
from ..setup.amplification import Layout, propagation

__all__ = ["AmplificationMatrix", "amplification_matrix"]


def checked_coupler(coupler: Any) -> Coupler:
    if not isinstance(coupler, Coupler):
        raise TypeError(f"coupler must be a Coupler, got {coupler!r}")
    return coupler


@contextmanager
def state_kept(coupler: Coupler) -> Iterator[None]:
    """Restore the state of the coupler afterwards, bitwise identical.

    Meanwhile its steps are its present ones as if there had been no others.
    """
    session = coupler._session
    snapshot = snapshot_of(session)
    try:
        layout = session.steps.layout
        take(session, Steps(layout, clock_of(layout)), session.assemblies.of(layout))
        session.core.set_origin(0, 0.0)
        yield
    finally:
        restore_snapshot(session, snapshot)


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
    The cost is N macro steps, eight of them side by side as in `Coupler.run_each`.

    Examples
    --------
    >>> from pmalpha import models
    >>> oscillator = models.split_oscillator(10.0, substeps=2)
    >>> G = amplification_matrix(oscillator.coupler(0.1, coupling="pm"))
    >>> G.shape, G.names[0]
    ((14, 14), 'u[0] of A at n-1')
    """
    matrix = propagated(coupler)[0].view(AmplificationMatrix)
    matrix.names = layout_of(coupler).names()
    return matrix


def layout_of(coupler: Coupler) -> Layout:
    """The order of X for the present steps of a coupler."""
    session = coupler._session
    assembly = session.assemblies.of(session.steps.layout)
    return Layout(assembly.members, assembly.core, session.options.coupling, session.core_rows)


def propagated(coupler: Coupler) -> tuple[np.ndarray, np.ndarray]:
    """One macro step of each unit state: the next states, (N, N), and Lam, (p, N)."""
    session = checked_coupler(coupler)._session
    require_linear(session, "amplification_matrix")
    with session.guard:
        return propagation(layout_of(coupler), session.core_rows, coupler.dt)
