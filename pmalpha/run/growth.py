"""How the motion of a linear coupler grows without loads: `Coupler.growth`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._checks import whole_number
from .._core import LANES
from ..memory import require
from ..problem.matrices import product
from ..setup.amplification import Layout, advance_state
from .session import Session, require_linear

__all__ = ["Growth"]

# Times at which the motion is compared, four of them in each quarter at least.
SAMPLES, FEWEST = 100, 16
# Growth in a macro step from which on it is one: above rounding and what a start leaves.
GROWS = 1e-6
# Copies of the state that exist at a time: in the core, in NumPy, and its energy.
COPIES = 4


def __dir__() -> list[str]:
    return sorted(__all__)


@dataclass(frozen=True, repr=False)
class Growth:
    """How the motion of a coupler grows without loads, from `Coupler.growth`.

    Printed, it is a sentence.

    Attributes
    ----------
    factor : float
        By which the largest motion grows in a macro step, in the second half of all steps; 1 where
        it neither grows nor decays.
    settled : float
        By how much that factor differs between the third and the last quarter: as small as the
        growth itself at most, or take more steps.
    subdomain : str
        In which most of the energy is at the end.
    steps : int
        Number of macro steps.

    Examples
    --------
    >>> bar = Subdomain([1.0], [4.0], scheme=CentralDifference(), name="bar")
    >>> bar = Coupler([bar], dt=0.9).growth(100)
    >>> bar.grows, bar.subdomain
    (False, 'bar')
    """

    factor: float
    settled: float
    subdomain: str
    steps: int

    @property
    def grows(self) -> bool:
        """Whether it grows by more than it is settled to."""
        return self.factor - 1.0 > max(self.settled, GROWS)

    def __repr__(self) -> str:
        words = "the motion grows" if self.grows else "no growth: the motion changes"
        return (
            f"{words} by a factor of {1.0 + float(f'{self.factor - 1.0:.3g}'):.12g} in a macro "
            f"step, settled to {self.settled:.2g} after {self.steps} of them, most in "
            f"{self.subdomain!r}"
        )


def growth(session: Session, steps: int, seed: int) -> Growth:
    """`Coupler.growth`."""
    require_linear(session, "growth")
    steps = whole_number(steps, "steps", low=FEWEST)
    seed = whole_number(seed, "seed")
    with session.guard:
        assembly = session.assemblies.of(session.steps.layout)
        coupling, rows = session.options.coupling, session.core_rows
        layout = Layout(assembly.members, assembly.core, coupling, rows)
        require(8.0 * COPIES * LANES * layout.size, "growth of this coupler")
        times, energies = [], []
        for k, logarithms in _powers(session, layout, steps, seed):
            times.append(k)
            energies.append(logarithms)
    names = [name for name, _ in session.keys]
    return _growth(np.array(times, float), np.array(energies), names)


def _growth(times: np.ndarray, energies: np.ndarray, names: list[str]) -> Growth:
    """From the logarithms of the energies of all subdomains, (samples, subdomains)."""
    steps, largest = times[-1], int(np.argmax(energies[-1]))
    total = np.logaddexp.reduce(energies, axis=1)
    if not np.isfinite(total[-1]):  # nothing is left of the motion
        return Growth(0.0, 0.0, names[largest], int(steps))

    def factor(begin: float, end: float) -> float:
        chosen = (times >= begin * steps) & (times <= end * steps)
        return float(np.exp(0.5 * np.polyfit(times[chosen], total[chosen], 1)[0]))

    settled = abs(factor(0.75, 1.0) - factor(0.5, 0.75))
    return Growth(factor(0.5, 1.0), settled, names[largest], int(steps))


def _powers(
    session: Session, layout: Layout, steps: int, seed: int
) -> Iterator[tuple[int, np.ndarray]]:
    """Macro steps of random states, and the logarithms of the energies of all subdomains."""
    members = layout.members
    cores = tuple(member.core.in_lanes() for member in members)
    core = layout.core.in_lanes(cores)
    X, scale, done = _random_state(session, layout, seed), 0.0, 0
    ends = np.unique(np.linspace(1, steps, min(steps, SAMPLES)).astype(int))
    for end in ends:
        X = advance_state(layout, core, cores, X, int(end) - done, session.steps.layout.dt)
        energies = _energies(layout, X)
        size = float(np.max(np.abs(X), initial=0.0))
        with np.errstate(divide="ignore"):
            yield int(end), scale + np.log(energies)
        if size == 0.0:
            return
        X, scale, done = X / size, scale + 2.0 * float(np.log(size)), int(end)


def _random_state(session: Session, layout: Layout, seed: int) -> np.ndarray:
    """X of random velocities that keep the constraints, without displacements, (size, lanes)."""
    from scipy.sparse.linalg import splu

    rng, rows = np.random.default_rng(seed), session.rows
    v = [rng.standard_normal((member.n, LANES)) for member in layout.members]
    if rows.p:
        product_of_rows = sum(L @ L.T for L in rows.matrices)
        jump = sum(L @ v_i for L, v_i in zip(rows.matrices, v))
        lam = splu(product_of_rows.tocsc()).solve(np.asarray(jump))
        v = [v_i - L.T @ lam for L, v_i in zip(rows.matrices, v)]
    X, begin = np.zeros((layout.size, LANES)), 0
    for i, field, indices in layout.fields:
        member = layout.members[i]
        if field.endswith("v"):
            X[begin : begin + indices.size] = v[i]
        elif field.endswith("vf"):
            X[begin : begin + indices.size] = v[i][member.order[member.n - member.nb :]][
                : indices.size
            ]
        begin += indices.size
    return X


def _energies(layout: Layout, X: np.ndarray) -> np.ndarray:
    """Kinetic energy and the size of the strain energy of each subdomain, of all lanes together."""
    result, begin = np.zeros(len(layout.members)), 0
    for i, field, indices in layout.fields:
        if field in ("u", "v"):
            x, s = X[begin : begin + indices.size], layout.members[i].subdomain
            A: Any = s.M if field == "v" else s.K
            result[i] += 0.5 * float(np.abs(np.sum(x * product(A, x), axis=0)).sum())
        begin += indices.size
    return result
