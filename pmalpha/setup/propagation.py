"""The amplification matrix of a linear assembly, and StabilityWarning for couplings that grow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from .. import _core
from .._core import LANES
from ..errors import InstabilityError, StabilityWarning, warn
from ..problem.subdomain import dense_whole
from .constraint_rows import CoreRows
from .member import Member
from .ranks import check_stable
from .schedule import MACRO

# Numbers of a state up to which the amplification matrix of any coupled problem is made: as long as
# the rest of the set-up takes. And where there is a reason to, up to a tenth of a second.
ALWAYS, CHEAP = 100, 300
# Growth in a macro step from which on it is one; and the rounding of an eigenvalue, divided by its
# condition and the norm of the matrix. Measured: rounding has up to 10, growth 1e7 and more.
GROWS, ROUNDING = 1e-7, 1e3 * np.finfo(float).eps
# Rates of growth up to this multiple of that of the structure are its own, with the errors of steps
# that resolve it; rates below this part of the largest eigenvalue are rounding.
OWN, ROOT = 1.1, 1e-7


def propagation(layout: Layout, rows: CoreRows, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """One macro step of each unit state: the next states, (N, N), and Lam, (p, N)."""
    cores = [member.core.in_lanes() for member in layout.members]
    core = layout.core.in_lanes(tuple(cores))
    size = layout.size
    G, lam = np.empty((size, size)), np.empty((rows.p, size))
    for begin in range(0, size, LANES):
        layout.write(core, cores, np.eye(size, LANES, -begin))
        check_stable(core.advance(1, None), layout.members, step=1, t=dt)
        end = min(begin + LANES, size)
        G[:, begin:end] = layout.read(core, cores, LANES)[:, : end - begin]
        now = core.multipliers.reshape(-1, LANES)[:, : end - begin]
        lam[:, begin:end] = rows.forces(now.T).T
    return G, lam


def advance_state(
    layout: Layout,
    core: _core.Coupler,
    cores: Sequence[_core.Subdomain],
    X: np.ndarray,
    steps: int,
    dt: float,
) -> np.ndarray:
    """X, (size, LANES), after this number of macro steps, of copies of the core in lanes."""
    layout.write(core, cores, X)
    check_stable(core.advance(steps, None), layout.members, step=steps, t=steps * dt)
    return layout.read(core, cores, LANES)


class Layout:
    """The order of the numbers of all subdomains in X."""

    def __init__(
        self, members: Sequence[Member], core: _core.Coupler, coupling: str, rows: CoreRows
    ):
        self.members, self.core = members, core
        fine = max(p.substeps for p in self.members)
        macro = coupling in MACRO
        self.stored = [not macro and (p.double or p.substeps < fine) for p in self.members]
        self.motion_size = sum(
            (2 if p.double else 1) * (4 * p.n + stored * p.nb)
            for p, stored in zip(self.members, self.stored)
        )
        # the state has the multipliers under "macro" only
        self.rows = rows if macro else CoreRows(np.arange(0), np.ones(0))
        self.size = self.motion_size + self.rows.p
        self.fields = tuple(self._fields())

    def _fields(self) -> Iterator[tuple[int, str, np.ndarray]]:
        """Index of the subdomain, name of its array in the core, and dofs in elimination order, as
        X has them.

        The core has the present time level first, X the one before it.
        """
        for i, (member, stored) in enumerate(zip(self.members, self.stored)):
            interface = np.arange(member.nb) if stored else np.arange(0)
            for level in ("previous_", "") if member.double else ("",):
                for name in "uvwa":
                    yield i, level + name, member.position
                yield i, level + "vf", interface

    def write(self, core: _core.Coupler, cores: Sequence[_core.Subdomain], X: np.ndarray) -> None:
        """Set the state of a coupler of the core to X, (size, lanes), after the start."""
        lanes = X.shape[1]
        arrays = [
            {name: np.zeros((x.size // lanes, lanes)) for name, x in subdomain.levels().items()}
            for subdomain in cores
        ]
        begin = 0
        for i, field, indices in self.fields:
            arrays[i][field][indices] = X[begin : begin + indices.size]
            begin += indices.size
        for subdomain, levels in zip(cores, arrays):
            subdomain.set_levels({name: x.ravel() for name, x in levels.items()})
        zero = np.zeros_like(core.multipliers)
        lam = zero.copy()
        if self.rows.p:
            lam = self.rows.forces_in_core(X[self.motion_size :].T).T.ravel()
        core.start(1, lam, zero)

    def read(self, core: _core.Coupler, cores: Sequence[_core.Subdomain], lanes: int) -> np.ndarray:
        """The present state X, (size, lanes), of a coupler of the core."""
        levels = [subdomain.levels() for subdomain in cores]
        numbers = [
            levels[i][field].reshape(-1, lanes)[indices] for i, field, indices in self.fields
        ]
        lam = core.multipliers.reshape(-1, lanes)[: self.rows.p]
        return np.concatenate([*numbers, self.rows.forces(lam.T).T])

    def names(self) -> tuple[str, ...]:
        names = []
        for i, field, indices in self.fields:
            member = self.members[i]
            symbol = field.removeprefix("previous_")
            when = "n" if symbol == field else "n-1"
            dofs = np.arange(member.n) if symbol != "vf" else member.order[member.n - member.nb :]
            names += [f"{symbol}[{d}] of {member.name} at {when}" for d in dofs[: indices.size]]
        return (*names, *(f"Lam[{row}]" for row in range(self.rows.p)))


def warn_of_growth(
    doubts: Sequence[str],
    otherwise: str | None,
    members: Sequence[Member],
    radius: float | None,
    dt: float,
) -> None:
    """StabilityWarning for each of the doubts, unless no step grows more than the structure does.

    doubts: why a coupling of these schemes can grow.
    otherwise: what to say if it grows and there are none; None where that is said elsewhere.
    """
    amount, texts = "", list(doubts)
    if radius is not None:
        if not is_growing(radius):
            return
        growth = growth_of_structure(members) * dt
        if np.log(radius) <= OWN * growth + GROWS:
            return
        amount = f": here by a factor of {_factor(radius)} in a macro step"
        if growth > 0.0:
            amount += f", of which {_factor(np.exp(growth))} is the growth of the structure itself"
        texts = texts or ([] if otherwise is None else [otherwise])
    for text in texts:
        warn(text + amount, StabilityWarning)


def _factor(radius: float) -> str:
    """A factor with three digits of what it adds."""
    return f"{1.0 + float(f'{radius - 1.0:.3g}'):.12g}"


def is_growing(radius: float) -> bool:
    """Whether a macro step with this spectral radius grows."""
    return not radius <= 1.0 + GROWS


def cheap_radius(
    members: Sequence[Member], core: _core.Coupler, coupling: str, rows: CoreRows, most: int
) -> float | None:
    """The spectral radius of a macro step as far as it is certain; None where a subdomain is not
    linear or the state has more than `most` numbers.

    members, core: the whole problem.
    """
    if not all(member.subdomain.is_linear for member in members):
        return None
    layout = Layout(members, core, coupling, rows)
    return _radius(layout, rows) if layout.size <= most else None


def growth_of_structure(members: Sequence[Member]) -> float:
    """The rate at which the tied structure itself grows, 0 where it does not.

    That is the largest real part of z with (z^2 M + z C + K) u = 0, L u = 0.
    """
    from scipy.linalg import eigvals, null_space

    M, C, K = (dense_whole([member.subdomain for member in members], name) for name in "MCK")
    L = np.hstack([member.L.matrix[:, member.position].toarray() for member in members])
    Z = null_space(L)
    M, C, K = (Z.T @ A @ Z for A in (M, C, K))
    one, zero = np.eye(len(K)), np.zeros_like(K)
    z = eigvals(np.block([[zero, one], [-K, -C]]), np.block([[one, zero], [zero, M]]))
    z = z[np.isfinite(z)]  # dofs without mass
    # double eigenvalues, rigid motions and their drift among them, to the root of the rounding
    rounding = ROOT * float(np.max(np.abs(z), initial=0.0))
    rate = float(np.max(z.real, initial=0.0))
    return rate if rate > rounding else 0.0


def _radius(layout: Layout, rows: CoreRows) -> float:
    try:
        G = propagation(layout, rows, 1.0)[0]
    except InstabilityError:
        return np.inf
    return certain_radius(G)


def certain_radius(G: np.ndarray) -> float:
    """The largest modulus of an eigenvalue of G, up to one those within rounding of it.

    An eigenvalue has a rounding of `ROUNDING` |G| times its condition, in the scale in which rows
    and columns of G are alike. Double and triple ones of modulus one, of floating structures and
    of gaps that stay, have an infinite condition: they are computed to the square and third root of
    the rounding.
    """
    from scipy.linalg import eig, matrix_balance

    radius = float(np.max(np.abs(np.linalg.eigvals(G)), initial=0.0))
    if not is_growing(radius):
        return radius
    with np.errstate(invalid="ignore"):  # scales beyond those of whole numbers
        balanced = matrix_balance(G, permute=False)[0]
    values, left, right = eig(balanced, left=True, right=True)
    with np.errstate(divide="ignore"):
        condition = 1.0 / np.abs(np.sum(left.conj() * right, axis=0))
    moduli = np.abs(values)
    certain = moduli - ROUNDING * np.linalg.norm(balanced, 2) * condition > 1.0 + GROWS
    return float(np.max(moduli[certain], initial=1.0))
