"""Spectral radii and growth of coupled steps, and of loops with simulated rigs, equation (Y19)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import pmalpha._core as _core

from .._core import LANES
from ..devices.actuators import Compensated
from ..devices.linear import LinearActuator
from ..errors import InstabilityError
from ..problem import forms
from ..problem.device import Device
from ..problem.restoring import items_of
from ..problem.springs import Spring
from ..problem.subdomain import dense_whole
from .member import Member
from .ranks import check_stable
from .rows import CoreRows
from .schedule import MACRO

# ---- propagation --------------------------------------------------------------------------------
# The amplification matrix of a linear assembly, and StabilityWarning for couplings that grow.

# Growth in a macro step from which on it is one; and the rounding of an eigenvalue, divided by its
# condition and the norm of the matrix. Measured: rounding has up to 10, growth 1e7 and more.
GROWS, ROUNDING = 1e-7, 1e3 * np.finfo(float).eps
# Rates of growth below this part of the largest eigenvalue are rounding.
ROOT = 1e-7


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
    """The order of the numbers of all subdomains in X.

    memories: of each subdomain what its springs and rigs remember at rest: zeros, which X then has
        too, and counts.
    """

    def __init__(
        self,
        members: Sequence[Member],
        core: _core.Coupler,
        coupling: str,
        rows: CoreRows,
        memories: Sequence[np.ndarray] = (),
    ):
        self.members, self.core = members, core
        fine = max(p.substeps for p in self.members)
        macro = coupling in MACRO
        self.stored = [not macro and (p.double or p.substeps < fine) for p in self.members]
        # the state has the multipliers under "macro" only
        self.rows = rows if macro else CoreRows(np.arange(0), np.ones(0))
        self.memories = memories
        self.fields = tuple(self._fields())
        self.motion_size = sum(indices.size for *_, indices in self.fields)
        self.size = self.motion_size + self.rows.p
        self._blocks: dict[int, tuple[np.ndarray, list[dict[str, np.ndarray]], np.ndarray]] = {}

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
        for i, memory in enumerate(self.memories):
            yield i, "springs", np.flatnonzero(memory == 0.0)

    def places(self, name: str) -> np.ndarray:
        """Where the numbers of a field are in X."""
        ends = np.cumsum([indices.size for *_, indices in self.fields])
        fields = zip(self.fields, ends)
        return np.concatenate(
            [np.arange(end - x.size, end) for (_, field, x), end in fields if field == name]
        )

    def write(self, core: _core.Coupler, cores: Sequence[_core.Subdomain], X: np.ndarray) -> None:
        """Set the state of a coupler of the core to X, (size, lanes), after the start."""
        block, arrays, places = self._block(cores, X.shape[1])
        block[:] = 0.0
        for levels, memory in zip(arrays, self.memories):
            levels["springs"].reshape(-1, X.shape[1])[:] += memory[:, None]
        block[places] += X[: self.motion_size]
        for subdomain, levels in zip(cores, arrays):
            subdomain.set_levels(levels)
        zero = np.zeros_like(core.multipliers)
        lam = zero.copy()
        if self.rows.p:
            lam = self.rows.forces_in_core(X[self.motion_size :].T).T.ravel()
        core.start(1, lam, zero)

    def read(self, core: _core.Coupler, cores: Sequence[_core.Subdomain], lanes: int) -> np.ndarray:
        """The present state X, (size, lanes), of a coupler of the core."""
        *_, places = self._block(cores, lanes)
        levels = [x for subdomain in cores for x in subdomain.levels().values()]
        numbers = np.concatenate(levels).reshape(-1, lanes)[places]
        lam = core.multipliers.reshape(-1, lanes)[: self.rows.p]
        return np.concatenate([numbers, self.rows.forces(lam.T).T])

    def _block(
        self, cores: Sequence[_core.Subdomain], lanes: int
    ) -> tuple[np.ndarray, list[dict[str, np.ndarray]], np.ndarray]:
        """One block (., lanes) of the levels of all subdomains, these arrays in it, and the rows of
        the motion X has."""
        if lanes in self._blocks:
            return self._blocks[lanes]
        sizes = [{name: x.size for name, x in core.levels().items()} for core in cores]
        flat = np.zeros(sum(sum(x.values()) for x in sizes))
        arrays: list[dict[str, np.ndarray]] = []
        begins: list[dict[str, int]] = []
        begin = 0
        for of_names in sizes:
            arrays.append({})
            begins.append({})
            for name, size in of_names.items():
                arrays[-1][name] = flat[begin : begin + size]
                begins[-1][name] = begin // lanes
                begin += size
        places = [begins[i][field] + indices for i, field, indices in self.fields]
        made = flat.reshape(-1, lanes), arrays, np.concatenate(places)
        self._blocks[lanes] = made
        return made

    def names(self) -> tuple[str, ...]:
        names = []
        for i, field, indices in self.fields:
            member = self.members[i]
            symbol = field.removeprefix("previous_")
            when = "n" if symbol == field else "n-1"
            dofs = np.arange(member.n) if symbol != "vf" else member.order[member.n - member.nb :]
            names += [f"{symbol}[{d}] of {member.name} at {when}" for d in dofs[: indices.size]]
        return (*names, *(f"Lam[{row}]" for row in range(self.rows.p)))


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
    """The largest modulus of an eigenvalue of G, up to one those within rounding of it."""
    radius = float(np.max(np.abs(np.linalg.eigvals(G)), initial=0.0))
    if not is_growing(radius):
        return radius
    values, _, is_certain = certain_eigenvalues(G)
    return float(np.max(np.abs(values[is_certain]), initial=1.0))


def certain_eigenvalues(G: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eigenvalues and eigenvectors of G, and which are certainly larger than one.

    An eigenvalue has a rounding of `ROUNDING` |G| times its condition, in the scale in which rows
    and columns of G are alike. Double and triple ones of modulus one, of floating structures and
    of gaps that stay, have an infinite condition: they are computed to the square and third root of
    the rounding.
    """
    from scipy.linalg import eig, matrix_balance

    with np.errstate(invalid="ignore"):  # scales beyond those of whole numbers
        balanced, (scale, _) = matrix_balance(G, permute=False, separate=True)
    values, left, right = eig(balanced, left=True, right=True)
    with np.errstate(divide="ignore"):
        condition = 1.0 / np.abs(np.sum(left.conj() * right, axis=0))
    rounding = ROUNDING * np.linalg.norm(balanced, 2) * condition
    return values, scale[:, None] * right, np.abs(values) - rounding > 1.0 + GROWS


# ---- loops with rigs -----------------------------------------------------------------------------

# Dofs and numbers of the state up to which the loop is judged, and macro steps of unit states: less
# than a second.
MOST_DOFS, MOST_STATES, MOST_STEPS = 200, 700, 200_000
# A damping ratio below the negative of this is a growth; less is what a compensation leaves.
NEGLIGIBLE = 1e-4
# Size of the unit states, at which springs have their initial tangents.
TINY = 1e-12


@dataclass(frozen=True)
class Growth:
    """Of the fastest pole: growth per unit of t, frequency in cycles, growth in a macro step."""

    rate: float
    frequency: float
    radius: float


def methods_of(item: Any) -> list[str]:
    """The methods of the compensators of a device, the outermost first."""
    methods = []
    while isinstance(item, Device):
        if isinstance(item, Compensated):
            methods.append(item.method)
        item = item.specimen
    return methods


def growth_of_loop(
    members: Sequence[Member], parts: dict[str, Any], coupling: str, rows: CoreRows, dt: float
) -> Growth | None:
    """The growth of a coupled step with linear rigs, (Y19); None where it does not grow, or where
    that is not known.

    The core takes the steps, of copies without limits, noise and rounding. A ring of delayed
    commands is in its first order again after as many steps as the longest one has commands.

    parts: what the coupler of the core is made of.
    """
    if not _is_known(members):
        return None
    period = max(_length(part) for member in members for part in _filters(member))
    cores = [_quiet_core(member, period) for member in members]
    core = _core.Coupler(tuple(cores), parts)
    layout = Layout(members, core, coupling, rows, [x.levels()["springs"] for x in cores])
    layout = Layout(members, core, coupling, rows, _counters(layout, core, cores, period))
    if layout.size > MOST_STATES or layout.size * period > MOST_STEPS:
        return None
    if not all(map(_takes_numbers, cores, layout.memories)):
        return None

    def advanced(x: np.ndarray, steps: int) -> np.ndarray:
        layout.write(core, cores, x[:, None])
        check_stable(core.advance(steps, None), members, step=steps, t=steps * dt)
        return layout.read(core, cores, 1)[:, 0]

    try:
        G = np.array([advanced(TINY * e, period) for e in np.eye(layout.size)]).T / TINY
        values, vectors, is_certain = certain_eigenvalues(G)
        if not is_certain.any():
            return None
        k = np.flatnonzero(is_certain)[np.argmax(np.abs(values[is_certain]))]
        x = TINY * vectors[:, k]
        after = advanced(x.real, 1) + 1j * advanced(x.imag, 1)
    except InstabilityError:  # of a step that is too long, which has a warning of its own
        return None
    rate = float(np.log(np.abs(values[k]))) / (period * dt)
    omega = _frequency(layout, x, after, dt)
    if rate <= NEGLIGIBLE * np.hypot(rate, omega):
        return None
    return Growth(rate, omega / (2.0 * np.pi), float(np.exp(rate * dt)))


def _frequency(layout: Layout, x: np.ndarray, after: np.ndarray, dt: float) -> float:
    """The circular frequency of an eigenvector, of which a step makes `after`: its phase in a step,
    and as many turns as its velocities have."""
    u, v = (layout.places(name) for name in "uv")
    energy = np.vdot(x[u], x[u])
    if not abs(energy) > 0.0:
        return 0.0
    turn = np.angle(np.vdot(x[u], after[u]) / energy)
    turns = np.round((dt * (np.vdot(x[u], x[v]) / energy).imag - turn) / (2.0 * np.pi))
    return float(abs(turn + 2.0 * np.pi * turns) / dt)


def _is_known(members: Sequence[Member]) -> bool:
    """Whether all that is not linear are springs and linear rigs, and the problem is small."""
    return sum(member.n for member in members) <= MOST_DOFS and all(
        member.internal is None
        and not member.double
        and not member.subdomain.has_feedback
        and all(
            isinstance(item, Spring)
            or (isinstance(item, Device) and isinstance(item.innermost, LinearActuator))
            and "adaptive" not in methods_of(item)  # it does not stay as it begins
            for item in items_of(member.subdomain.restoring)
        )
        for member in members
    )


def _filters(member: Member) -> Iterator[Any]:
    """The filters and linear systems of its specimens, in the form of the core."""
    restoring = member.parts["restoring"]
    for function in () if restoring is None else restoring.functions:
        if isinstance(function, forms.Specimen):
            yield from (*function.filters, function.linear)


def _length(part: Any) -> int:
    """The commands in the ring of a filter or a linear system."""
    return 1 + int(np.max(part.lag)) if isinstance(part, (forms.Actuator, forms.Linear)) else 1


def _quiet_core(member: Member, period: int) -> _core.Subdomain:
    """A copy of a subdomain whose rigs have rings that divide this length, no limits, no noise."""

    def quiet(part: Any) -> Any:
        if not isinstance(part, (forms.Actuator, forms.Linear)):
            return part
        length = next(d for d in range(_length(part), period + 1) if period % d == 0)
        late: dict[str, Any] = {
            "lag": np.append(part.lag, length - 1),
            "weight": np.append(part.weight, 0.0),
        }
        part = part._replace(**late, largest=np.inf, noise=0.0, quantum=0.0)
        return part._replace(force_noise=0.0) if isinstance(part, forms.Linear) else part

    parts = member.parts | {"limits": None, "watch": None}
    restoring = parts["restoring"]
    if restoring is not None:
        functions = tuple(
            x._replace(filters=tuple(map(quiet, x.filters)), linear=quiet(x.linear))
            if isinstance(x, forms.Specimen)
            else x
            for x in restoring.functions
        )
        parts["restoring"] = restoring._replace(functions=functions)
    return _core.Subdomain(parts)


def _takes_numbers(core: _core.Subdomain, memory: np.ndarray) -> bool:
    """Whether what is remembered may be any numbers: not that of springs that count reversals."""
    try:
        core.check_levels(core.levels() | {"springs": np.where(memory == 0.0, TINY, memory)})
    except ValueError:
        return False
    return True


def _counters(
    layout: Layout, core: _core.Coupler, cores: Sequence[_core.Subdomain], period: int
) -> list[np.ndarray]:
    """What rigs remember at rest: numbers of evaluations, multiples of `period`; else zeros."""
    layout.write(core, cores, np.zeros((layout.size, 1)))
    memories = []
    for step in (1, 2):
        check_stable(core.advance(1, None), layout.members, step=step, t=0.0)
        memories.append([x.levels()["springs"] for x in cores])
    return [np.where(second != first, float(period), 0.0) for first, second in zip(*memories)]
