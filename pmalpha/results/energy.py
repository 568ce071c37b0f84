"""Energies of the subdomains in a run, equations (B1) to (B4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from .._checks import counted
from ..problem.loads import Force, loads_of
from ..problem.matrices import is_symmetric
from ..problem.sampled import BaseAcceleration
from ..problem.schemes import Scheme
from ..setup.member import Member
from ..setup.ranks import Ranks, joined
from ..setup.schedule import Options

__all__ = ["Energy"]


def __dir__() -> list[str]:
    return sorted(__all__)


# The energies of a subdomain that the core records at a macro time level, in this order.
ENERGIES = ("kinetic", "strain", "dissipated", "external", "interface", "contact", "conserved")
ENERGY_FIELDS = (*ENERGIES[:-2], "balance")
# Of some couplers only.
OPTIONAL = ("conserved", "contact")


@dataclass(frozen=True)
class Energy:
    """Energies of the subdomains, (macro time levels, subdomains) arrays.

    The works are zero at the beginning of the run, and their changes are those of a run with
    energies from t = 0 on, also from a snapshot or a checkpoint; but after steps without energies
    those of double steps differ by a constant at every second time level, in sum by what the scheme
    adds in a step, (B14). In checkpoints of older versions a function in `restoring` counts at the
    beginning as in the first step. They are infinite or NaN where products of the motion leave the
    range of numbers, from about 1e154 on.

    Attributes
    ----------
    t : (macro time levels,) array
        Times of the rows.
    kinetic, strain : arrays
        T = v M v / 2 and U = u K u / 2, equation (B1), and in U the energy of springs (H5) and
        the ``potential(u)`` of the internal forces that have one.
    dissipated, external, interface : arrays
        The works of C v, of F and of L^T Lam, summed over the substeps, (B2) and (B3). The works of
        restoring and internal forces count as dissipated, less the change of their energy in U: of
        a function without potential also the elastic share.
    balance : array
        kinetic + strain + dissipated - external - interface - contact, minus its value at the
        beginning: the energy that the scheme added, negative if it was removed, (B4).
    conserved : array or None
        Shares of the subdomains in what the coupled scheme conserves to rounding, in their sum:
        with the trapezoidal rule, central difference and other Newmark schemes with gamma = 1/2 in
        all subdomains, single steps, without damping, loads that vary, prescribed motion, restoring
        and internal forces. Under "macro" with any substeps, and under "gc" and "pm" with equal
        substeps in all subdomains, w (M + h^2 (beta - 1/4) K) w / 2 + v K v / 2 (M9), with the
        acceleration w and the substep h: its unit is energy by time squared. Under "gc" and "pm"
        with different substeps the same quantity never grows (A15). Under "mean" with
        the trapezoidal rule kinetic + strain - F . u. Damping and varying loads and motions change
        it.
        None with other schemes and steps, with restoring and internal forces, with
        contacts, and in files of older versions.
    contact : array or None
        Work of the impulses of contacts on each subdomain, P N (v0 + v1) / 2 in each step (U10);
        None without contacts.
    """

    t: np.ndarray
    kinetic: np.ndarray
    strain: np.ndarray
    dissipated: np.ndarray
    external: np.ndarray
    interface: np.ndarray
    balance: np.ndarray
    conserved: np.ndarray | Any = None
    contact: np.ndarray | Any = None

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays by name, those that are there.

        Returns
        -------
        dict of arrays
            As the attributes, without `t`; `conserved` only where there is such a quantity.
        """
        pairs = ((name, getattr(self, name)) for name in (*ENERGY_FIELDS, *OPTIONAL))
        return {name: x for name, x in pairs if x is not None}

    def _with_rows(self, change: Callable[[np.ndarray], np.ndarray]) -> Energy:
        """The same with other rows of all arrays."""
        changed = {name: change(x) for name, x in self.arrays().items()}
        return replace(self, t=change(self.t), **changed)

    def __repr__(self) -> str:
        subdomains = counted(self.balance.shape[1], "subdomain")
        return f"<Energy of {subdomains} at {counted(self.t.size, 'time level')}>"


def balanced(start: np.ndarray, **arrays: Any) -> Energy:
    """Energies from all arrays but the balance; `start` is T + U where the works are zero."""
    with np.errstate(over="ignore", invalid="ignore"):  # squares of numbers above 1e154
        balance = arrays["kinetic"] + arrays["strain"] - start + arrays["dissipated"]
        for work in ("external", "interface", "contact"):
            if arrays.get(work) is not None:
                balance = balance - arrays[work]
    return Energy(balance=balance, **arrays)


def conserved_quantity(
    members: Sequence[Member], options: Options, ranks: Ranks | None = None
) -> str | None:
    """Which quantity never grows: "dual" for (M9), "energy" for T + U - F . u, or None."""
    facts = [
        (_conserves(member), stiffness_weight(member.subdomain.scheme, 1.0) == 0.0)
        for member in members
    ]
    conserves, trapezoidal = zip(*joined(ranks, facts))
    if not all(conserves):
        return None
    if options.coupling == "mean":
        return "energy" if all(trapezoidal) else None
    return "dual"


def _conserves(member: Member) -> bool:
    """A linear subdomain with a Newmark scheme and single steps, whose matrices are symmetric."""
    s = member.subdomain
    return s.scheme.is_newmark and s.is_linear and not member.double and is_symmetric(s.K)


def stiffness_weight(scheme: Scheme, h: float) -> float:
    """The multiple of K beside M in (M9); an explicit scheme with am = af is central difference."""
    return -0.25 * h**2 if scheme.explicit else (scheme.beta - 0.25) * h**2


# ---- base motion --------------------------------------------------------------------------------
# The motion of the ground under a subdomain, which absolute outputs add to its own.

QUANTITIES = ("u", "v", "a")


class Loads(NamedTuple):
    """The loads of a subdomain, as given and as its steps take them: averaged ones as means."""

    force: Force
    seen: Force


def check_ground(loads: Loads, name: str) -> None:
    """ValueError unless the loads have a ground motion whose direction is known."""
    motions = [x for x in loads_of(loads.force) if x._is_ground]
    if not motions or any(x.direction is None for x in motions):
        got = "one of a reduced subdomain, without its direction" if motions else "none"
        raise ValueError(f"absolute outputs of {name!r} need a BaseAcceleration, got {got}")


def added(loads: Loads, weights: Sequence[Any], t: np.ndarray) -> Any:
    """What the ground adds to outputs at times t, (levels, rows).

    weights: (rows, n) matrices that act on u, v and a of the ground; None without entries.
    """
    total: Any = 0.0
    for ground, seen in zip(loads_of(loads.force), loads_of(loads.seen)):
        if not isinstance(ground, BaseAcceleration):
            continue
        for quantity, W in zip(QUANTITIES, weights):
            if W is not None:
                assert isinstance(seen, BaseAcceleration)
                series = seen._series(t) if quantity == "a" else integrated(ground, quantity, t)
                total = total + _product(series, (W @ ground.direction).T)
    return total


def _product(series: np.ndarray, A: np.ndarray) -> np.ndarray:
    """series @ A, row by row the same for any number of rows, as a product of BLAS is not."""
    total = np.zeros((len(series), A.shape[1]))
    for column, row in zip(series.T, A):
        total += column[:, None] * row
    return total


def integrated(ground: BaseAcceleration, quantity: str, t: np.ndarray) -> np.ndarray:
    """Velocity or displacement of the ground, (levels, k): exact integrals from rest at t = 0."""
    from scipy.interpolate import PPoly

    f, dt = ground.values, ground.dt
    if len(f) == 1:
        return np.zeros((t.size, f.shape[1]))
    end = dt * (len(f) - 1)
    v = PPoly(np.array([np.diff(f, axis=0) / dt, f[:-1]]), dt * np.arange(len(f))).antiderivative()
    within = np.minimum(t, end)
    result: np.ndarray = v(within)
    if quantity == "u":
        result = v.antiderivative()(within) + (t - within)[:, None] * v(end)
    return result
