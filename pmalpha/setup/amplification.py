"""Spectral radii and growth of coupled steps, and of loops with simulated rigs, equation (Y19)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

import pmalpha._core as _core

from .._core import LANES
from ..devices.actuators import Compensated
from ..devices.linear import LinearActuator, at_rest
from ..errors import InstabilityError
from ..problem import forms
from ..problem.device import Device, core_specimen
from ..problem.restoring import items_of
from ..problem.springs import Spring, stiffness
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


# ---- loop ---------------------------------------------------------------------------------------

# Dofs of the structure, and numbers of the state of the loop, up to which it takes less than a
# second; modes above 1/h are left out, which explicit schemes do not resolve.
MOST_DOFS, MOST_STATES, RESOLVED = 200, 500, 1.0
# A damping ratio below the negative of this is a growth; less is what a compensation leaves.
NEGLIGIBLE = 1e-4


@dataclass(frozen=True)
class Growth:
    """Of the fastest pole: growth per unit of t, frequency in cycles, spectral radius of a step."""

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


def growth_of(members: Sequence[Member], rigs: Sequence[tuple[Member, Device]]) -> Growth | None:
    """The growth of the loop; None where it does not grow, or where that is not known."""
    if not _is_known(members, rigs):
        return None
    structure = _structure(members, rigs)
    if structure is None:
        return None
    loop = Loop(structure, rigs)
    if loop.size > MOST_STATES:
        return None
    z = np.linalg.eigvals(loop.step(np.eye(loop.size)))
    z = z[np.abs(z) > 0.5]
    s = np.log(z) / loop.h
    growing = s[s.real > NEGLIGIBLE * np.abs(s)]
    growing = growing[growing.real * loop.h > 1e-9]  # rounding of rigid motions
    if not growing.size:
        return None
    worst = growing[np.argmax(growing.real)]
    rate = float(worst.real)
    return Growth(rate, float(abs(worst.imag) / (2.0 * np.pi)), float(np.exp(rate * loop.h)))


def _is_known(members: Sequence[Member], rigs: Sequence[tuple[Member, Device]]) -> bool:
    """Whether all that is not linear are these rigs, all with one step, and small enough."""
    devices = [item for _, item in rigs]
    if any("adaptive" in methods_of(item) for item in devices):
        return False  # it does not stay as it begins
    steps = {member.h for member, _ in rigs}
    return (
        sum(member.n for member in members) <= MOST_DOFS
        and len(steps) == 1
        and not any(member.double for member, _ in rigs)
        and all(member.subdomain.internal is None for member in members)
        and all(
            isinstance(item, Spring) or any(item is one for one in devices)
            for member in members
            for item in items_of(member.subdomain.restoring)
        )
        and not any(member.subdomain.has_feedback for member in members)
    )


@dataclass(frozen=True)
class Structure:
    """M, C and K of the numerical part in the modes, (n, modes), of the whole structure."""

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    modes: np.ndarray
    first: dict[int, int]  # of each member, by its id, its first dof in `modes`


def _structure(
    members: Sequence[Member], rigs: Sequence[tuple[Member, Device]]
) -> Structure | None:
    """The tied structure; None where it is not definite."""
    from scipy.linalg import LinAlgError, eigh, null_space

    subdomains = [member.subdomain for member in members]
    M, C, K = (dense_whole(subdomains, name) for name in "MCK")
    starts = np.concatenate([[0], np.cumsum([s.n for s in subdomains])])
    first = {id(member): int(at) for member, at in zip(members, starts)}
    for member, (begin, end) in zip(members, pairwise(starts)):
        springs = member.subdomain.springs
        K[begin:end, begin:end] += stiffness(springs, "initial_tangent", member.n).toarray()
    L = np.hstack([member.L.matrix[:, member.position].toarray() for member in members])
    Z = null_space(L) if L.size else np.eye(len(K))
    K_static = K.copy()
    for member, item in rigs:
        actuator, at = item.innermost, first[id(member)] + np.asarray(item.dofs)
        rig = _static_stiffness(actuator)
        K_static[np.ix_(at, at)] += 0.5 * (rig + rig.T)
    try:
        # of M against K: dofs without mass have the value 0
        values, vectors = eigh(Z.T @ M @ Z, Z.T @ K_static @ Z)
    except LinAlgError:
        return None
    h = rigs[0][0].h
    resolved = values > (h / RESOLVED) ** 2
    modes = Z @ vectors[:, resolved]
    M, C, K = (modes.T @ A @ modes for A in (M, C, K))
    return Structure(M, C, K, modes, first)


def _static_stiffness(actuator: LinearActuator) -> np.ndarray:
    """Forces over displacements under a constant command."""
    rest = at_rest(actuator.A, actuator.B)
    return np.asarray(actuator.F @ rest @ np.linalg.inv(actuator.C @ rest))


# ---- one step of the loop ------------------------------------------------------------------------


class Loop:
    """A step of structure and rigs, as a linear map of states (size, columns).

    The structure by central differences, its predictor the command; filters as the core has them,
    without limits, noise and least squares.
    """

    def __init__(self, structure: Structure, rigs: Sequence[tuple[Member, Device]]):
        self.structure, self.h = structure, rigs[0][0].h
        self.rows, self.rigs = [], []
        for member, item in rigs:
            specimen = core_specimen(item, member.n, self.h, member.name)
            dofs = structure.first[id(member)] + np.asarray(specimen.dofs)
            self.rows.append(structure.modes[dofs])
            self.rigs.append(Chain(specimen, len(dofs)))
        self.n = structure.modes.shape[1]
        self.size = 4 * self.n + sum(rig.size for rig in self.rigs)

    def step(self, states: np.ndarray) -> np.ndarray:
        """The states after a step."""
        s, h, n = self.structure, self.h, self.n
        u, v, a, last = (states[i * n : (i + 1) * n] for i in range(4))
        change = a - last
        u1 = u + h * v + 0.5 * h**2 * a
        half = v + 0.5 * h * a
        r = -s.C @ half - s.K @ u1
        begin, ends = 4 * n, []
        for row, rig in zip(self.rows, self.rigs):
            rates = v + h * a + 0.5 * h * change, a + change
            command = [row @ x for x in (u1, *rates)]
            force, end = rig.step(command, states[begin : begin + rig.size])
            r -= row.T @ force
            ends.append(end)
            begin += rig.size
        a1 = np.linalg.solve(s.M + 0.5 * h * s.C, r)
        return np.concatenate([u1, half + 0.5 * h * a1, a1, a, *ends])


class Chain:
    """Filters and the linear system behind them; its state is a list of blocks of rows."""

    def __init__(self, specimen: forms.Specimen, width: int):
        assert specimen.linear is not None
        self.specimen, self.width = specimen, width
        # velocities go as far as a filter reads them: rings of them would double the poles
        inverses = [i for i, x in enumerate(specimen.filters) if isinstance(x, forms.Inverse)]
        self.last = inverses[-1] if inverses else -1
        self.sizes = [
            _size(part, width, width if i < self.last else 0)
            for i, part in enumerate((*specimen.filters, specimen.linear))
        ]
        self.size = sum(self.sizes)

    def step(self, command: list[np.ndarray], state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The forces under this command with its rates, and the state after it."""
        blocks = np.split(state, np.cumsum(self.sizes)[:-1])
        after, desired = [], []
        for i, (part, block) in enumerate(zip(self.specimen.filters, blocks)):
            desired.append(command[0])
            if i > self.last:
                command = command[:1]
            command, block = _send(part, command, block)
            after.append(block)
        linear = self.specimen.linear
        assert linear is not None
        x, f, end = _move(linear, command[0], blocks[-1])
        for i in reversed(range(len(after))):
            part = self.specimen.filters[i]
            if isinstance(part, (forms.LinkageMatrix, forms.LinkageArms)):
                J = _jacobian(part)
                x, f = np.linalg.solve(J, x), J.T @ f
            elif isinstance(part, forms.Inverse):
                after[i] = np.concatenate([after[i], desired[i] - x])
        return f, np.concatenate([*after, end])


def _ring(lag: np.ndarray) -> int:
    return int(np.max(lag))


def _size(part: Any, width: int, rates: int) -> int:
    """Numbers of the state of a filter or of the linear system, with so many velocities."""
    if isinstance(part, forms.Linear):
        return (_ring(part.lag) + 1) * width + len(part.phi)
    if isinstance(part, forms.Actuator):
        return _ring(part.lag) * (width + rates) + (1 + len(part.phi)) * width
    if isinstance(part, forms.Inverse):
        feedback = 0 if part.feedback is None else len(part.feedback.A)
        return len(part.command.A) + feedback + 3 * width
    return 0


def _late(part: Any, u: np.ndarray, ring: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The weighted sum (Y1) of commands, the last ones first, and the ring after it."""
    width = len(u)
    all_of_them = np.concatenate([u, ring])
    total = np.zeros_like(u)
    for lag, weight in zip(part.lag, part.weight):
        total = total + weight * all_of_them[lag * width : (lag + 1) * width]
    return total, all_of_them[: len(ring)]


def _move(
    part: forms.Linear, u: np.ndarray, state: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacements, forces and the state after a step."""
    width = len(u)
    ring, last, z = np.split(state, [_ring(part.lag) * width, (_ring(part.lag) + 1) * width])
    c, ring = _late(part, u, ring)
    z = part.phi @ z + part.before @ last + part.after @ c
    return part.displacement @ z, part.force @ z, np.concatenate([ring, c, z])


def _send(
    part: Any, command: list[np.ndarray], state: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray]:
    """What becomes of a command, and the state after it; of an inverse without its error."""
    if isinstance(part, forms.Actuator):
        return _delay(part, command, state)
    if isinstance(part, forms.Inverse):
        return _invert(part, command, state)
    J = _jacobian(part)
    return [J @ x for x in command], state


def _delay(
    part: forms.Actuator, command: list[np.ndarray], state: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray]:
    u, *rates = command  # rates: velocity and acceleration, or none
    width, order = len(u), len(part.phi)
    late, start = [], 0
    for x in command[:2]:
        end = start + _ring(part.lag) * width
        late.append(_late(part, x, state[start:end]))
        start = end
    (c, _), sent = late[0], [x for x, _ in late]
    last, z = np.split(state[start:], [width])
    if order:
        z = np.tensordot(part.phi, z.reshape(order, width, -1), 1)
        z += part.before[:, None, None] * last + part.after[:, None, None] * c
        rate = np.tensordot(part.slope[:order], z, 1) + part.slope[order] * c
        sent = [z[0], rate][: len(sent)]
        z = z.reshape(order * width, -1)
    return [*sent, *rates[1:]], np.concatenate([*(ring for _, ring in late), c, z])


def _invert(
    part: forms.Inverse, command: list[np.ndarray], state: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray]:
    u, v, a = command
    width, n = len(u), len(part.command.A)
    feedback = 0 if part.feedback is None else len(part.feedback.A)
    sizes = np.cumsum([n, feedback, width, width])
    z, y, last, rate, error = np.split(state, sizes)
    c, z = _filter(part.command, u + part.rate * v + part.acceleration * a, z)
    c = c[:width]
    if part.feedback is not None:
        correction, y = _filter(part.feedback, error, y)
        c = c + correction
    now = (c - last) / part.h
    return [c, now, (now - rate) / part.h], np.concatenate([z, y, c, now])


def _filter(part: forms.Modal, u: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    other = z.reshape(-1, 2, z.shape[1])[:, ::-1].reshape(z.shape)
    return part.C @ z + part.D @ u, part.A[:, :1] * z + part.A[:, 1:] * other + part.B @ u


def _jacobian(part: forms.LinkageMatrix | forms.LinkageArms) -> np.ndarray:
    """At rest."""
    if isinstance(part, forms.LinkageMatrix):
        return part.matrix
    length, angle = part.arms.T
    return np.column_stack([np.ones(2), length * np.sin(angle)])
