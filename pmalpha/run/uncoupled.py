"""Solution of one uncoupled subdomain."""

from __future__ import annotations

from typing import Any

from ..problem.subdomain import Subdomain
from ..results.history import SubdomainHistory
from .coupler import Coupler

__all__ = ["solve"]


def solve(
    subdomain: Subdomain,
    dt: float,
    t_end: float | None = None,
    *,
    threads: int | None = None,
    **as_run: Any,
) -> SubdomainHistory:
    """Solve one uncoupled subdomain, with the same schemes and the same core.

    Parameters
    ----------
    subdomain : Subdomain
        Its step is dt / substeps.
    dt : float
        As for `Coupler`.
    t_end : float, optional
        As for `Coupler.run`.
    threads : int, optional
        As for `Coupler`.
    **as_run
        Further arguments of `Coupler.run`.

    Returns
    -------
    SubdomainHistory
        With methods `plot`, `save`, `to_xarray` and `to_pandas`.

    Examples
    --------
    >>> oscillator = Subdomain([1.0], [4.0], scheme=Newmark(), u0=[1.0])
    >>> float(np.round(solve(oscillator, dt=0.001, t_end=1.0).u[-1, 0], 4))
    -0.4161
    """
    return Coupler([subdomain], dt=dt, threads=threads).run(t_end, **as_run)[0]
