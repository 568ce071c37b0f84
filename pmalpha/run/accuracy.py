"""Local errors of the steps of a run, and the error of its result; AccuracyWarning.

The estimates are equations (D1) to (D3) of docs/method.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import gcd

import numpy as np
import scipy

from .._checks import listing
from .._core import follow_recursion
from ..errors import AccuracyWarning, warn
from ..problem.matrices import product
from ..problem.restoring import devices_of, functions_of, is_compiled
from ..problem.schemes import Scheme
from ..results.local_error import is_complete
from ..results.subdomain_history import SubdomainHistory
from ..setup.constraint_rows import ConstraintRows
from ..setup.member import Member
from ..setup.ranks import Ranks, joined
from .motion import Motion

# A run warns from this error on, relative to the largest displacement; what it advises gives FINE.
COARSE, FINE = 0.03, 0.01
# A run of fewer levels is not judged.
FEWEST_LEVELS = 8
# Time levels of which shapes are made, and the first ones among them; shapes at most.
SNAPSHOTS, FIRST, SHAPES = 48, 8, 40
# Shapes below this share of the motion are left out.
OF_DISPLACEMENT = 1e-3
# Of the shapes at functions, whose dofs may be few.
OF_FUNCTIONS = 1e-6
# Of the levels of long records that are read: omega times their distance, and how much the force
# changes between them.
RESOLVED, CHANGE = 0.5, 0.1
# Fourth over second differences of a force from which on it is taken as linear between levels.
ROUGH = 0.7
# Of a force, against the accelerations: what is left of it in free motion.
NOISE = 1e-6
# Levels at which the error of each dof is looked at.
WORST = 64


# ---- the error of a run --------------------------------------------------------------------------


@dataclass(frozen=True)
class Estimate:
    """The error of a run (D3), and where it comes from."""

    size: float  # largest displacement error of any dof, divided by the largest displacement
    lasting: float  # the same without the modes that the steps do not resolve
    # what it would be if the error did not end at the size of the motion; it goes with dt^2
    expected: float
    place: tuple[str, int]  # the subdomain and the dof of the largest error
    omega: float  # circular frequency of the mode that contributes most to it
    # of each subdomain, of any process: name, step, whether it is double, substep, and the error
    # that its steps add in this mode per unit of time
    shares: list[tuple[str, float, bool, float, float]]


def estimated_error(
    histories: Sequence[SubdomainHistory | None],
    members: Sequence[Member],
    rows: ConstraintRows,
    motions: Sequence[Motion],
) -> Estimate | None:
    """The error of a run (D3), None where its records do not suffice.

    They do with eight time levels that all subdomains have in common, the displacements of all
    dofs and steps up to the critical ones. All processes of `rows` call it.
    """
    ranks = rows.ranks
    own = [_levels(history, member) for history, member in zip(histories, members)]
    found = joined(ranks, own)
    count = gcd(*found) if found and min(found) else 0
    if count < FEWEST_LEVELS:
        return None
    recorded = [history for history in histories if history is not None]
    strides = [(history.t.size - 1) // count for history in recorded]
    records = [(h.u[::k], h.v[::k], h.a[::k]) for h, k in zip(recorded, strides)]
    with np.errstate(all="ignore"):
        largest = _largest(ranks, [u for u, _, _ in records])
        reduced = _reduced(records, count + 1, members, rows, motions)
        if reduced is None or not 0.0 < largest < np.inf:
            return None
        step = max(joined(ranks, [(h.t[-1] - h.t[0]) / count for h in recorded]))
        complete = all(joined(ranks, [is_complete(h) for h in recorded]))
        return _judged(reduced, records, count + 1, members, ranks, step, largest, complete)


def _levels(history: SubdomainHistory | None, member: Member) -> int:
    """Intervals of the record of a subdomain; 0 if it is not judged."""
    if member.step_ratio is not None and not member.step_ratio.is_judged:
        return 0  # unstable, which has a warning of its own
    if history is None or history.substep is None or history.t.size < FEWEST_LEVELS + 1:
        return 0
    t = history.t
    mean = (t[-1] - t[0]) / (t.size - 1)
    whole = np.array_equal(history.dofs, np.arange(member.n))
    return t.size - 1 if whole and abs(t[1] - t[0] - mean) < 1e-6 * mean else 0


def _largest(ranks: Ranks | None, arrays: Sequence[np.ndarray]) -> float:
    result: float = max(
        joined(ranks, [max(np.max(x), -np.min(x)) for x in arrays if x.size] or [0.0])
    )
    return result


def _total(ranks: Ranks | None, terms: Sequence[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    return sum(joined(ranks, list(terms)), np.zeros(shape))


Rows = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Reduced:
    """The structure in r shapes of its motion, M = 1 and K diagonal but for rounding."""

    # Phi, M Phi, and what gives Phi . M w without the lag of explicit steps, (n_i, r) by subdomain
    shapes: list[np.ndarray]
    masses: list[np.ndarray]
    forces: list[np.ndarray]
    K: np.ndarray  # (r, r), as C
    C: np.ndarray
    omega: np.ndarray  # (r,)


def _reduced(
    records: Sequence[Rows],
    levels: int,
    members: Sequence[Member],
    rows: ConstraintRows,
    motions: Sequence[Motion],
) -> Reduced | None:
    """The structure in the shapes of which the recorded displacements consist, (D2)."""
    ranks, some = rows.ranks, _snapshots(levels)
    U = [(u[some] - u[:1]).T for u, _, _ in records]
    MU = [product(member.subdomain.M, x) for member, x in zip(members, U)]
    k = some.size
    products = _total(ranks, [x.T @ y for x, y in zip(U, MU)], (k, k))
    if not np.all(np.isfinite(products)):
        return None
    values, T = np.linalg.eigh(products)
    if not values[-1] > 0.0:
        return None
    kept = values > OF_DISPLACEMENT**2 * values[-1]
    T = (T[:, kept] / np.sqrt(values[kept]))[:, -SHAPES:]
    T = T @ _at_rest(ranks, [x @ T for x in U], T.shape[1], rows, motions)

    # and its modes
    terms = [_times(member, "K", x @ T) for member, x in zip(members, U)]
    r = T.shape[1]
    K = _total(ranks, [T.T @ (x.T @ Kx) for x, Kx in zip(U, terms)], (r, r))
    if not r or not np.all(np.isfinite(K)):
        return None
    squares, X = np.linalg.eigh(0.5 * (K + K.T))
    T, shapes = T @ X, [x @ (T @ X) for x in U]
    damped = [_times(member, "C", x) for member, x in zip(members, shapes)]
    C = _total(ranks, [x.T @ Cx for x, Cx in zip(shapes, damped)], (r, r))
    masses = [x @ T for x in MU]
    forces = [
        _without_lag(member, Mx, Kx @ X, Cx)
        for member, Mx, Kx, Cx in zip(members, masses, terms, damped)
    ]
    return Reduced(shapes, masses, forces, X.T @ K @ X, C, np.sqrt(np.maximum(squares, 0.0)))


def _snapshots(levels: int) -> np.ndarray:
    """Some levels, not at equal distances, which could be those of a period."""
    if levels <= SNAPSHOTS + FIRST:
        return np.arange(levels)
    x = np.arange(SNAPSHOTS) + 0.5 * np.sin(np.arange(SNAPSHOTS) ** 2)
    spread = np.clip(x * ((levels - 1) / (SNAPSHOTS - 1)), 0, levels - 1)
    return np.unique(np.append(np.arange(FIRST), spread.round().astype(np.int64)))


def _at_rest(
    ranks: Ranks | None,
    shapes: Sequence[np.ndarray],
    r: int,
    rows: ConstraintRows,
    motions: Sequence[Motion],
) -> np.ndarray:
    """Combinations of r shapes in which the rows of prescribed velocities are at rest, (r, k)."""
    if not motions:
        return np.eye(r)
    prescribed = np.concatenate([motion.rows for motion in motions])
    own = [L[prescribed] @ x for L, x in zip(rows.matrices, shapes)]
    B = _total(ranks, own, (prescribed.size, r))
    size = _total(
        ranks,
        [abs(L[prescribed]) @ np.abs(x) for L, x in zip(rows.matrices, shapes)],
        (prescribed.size, r),
    )
    _, sizes, vectors = np.linalg.svd(B.T @ B)
    result: np.ndarray = vectors[sizes <= 1e-12 * np.sum(size**2)].T
    return result


def _times(member: Member, kind: str, x: np.ndarray) -> np.ndarray:
    """K x or C x, with estimates of restoring forces and tangents of internal ones at t = 0."""
    s = member.subdomain
    estimate = s.restoring_stiffness if kind == "K" else s.restoring_damping
    Ax: np.ndarray = product(getattr(s, kind), x) + product(estimate, x)
    return Ax if member.internal is None else Ax + product(getattr(member.internal, kind), x)


def _without_lag(member: Member, Mx: np.ndarray, Kx: np.ndarray, Cx: np.ndarray) -> np.ndarray:
    """M w - al1 K w: explicit steps evaluate K at the predictor, and lagged ones C."""
    s = member.subdomain
    if not s.scheme.explicit:
        return Mx
    al1, al2 = s.scheme.coefficients(member.step)
    return Mx - al1 * Kx - (al2 * Cx if s.damping == "lagged" else 0.0)


def _judged(
    reduced: Reduced,
    records: Sequence[Rows],
    levels: int,
    members: Sequence[Member],
    ranks: Ranks | None,
    step: float,
    largest: float,
    complete: bool,
) -> Estimate | None:
    stride = _stride(reduced, records, levels, ranks, step)
    own = [_fitted(member, x) for member, x in zip(members, reduced.shapes)]
    fits = [fit for fit in joined(ranks, own) if fit is not None]
    known = [
        fit is not None or not p.subdomain.has_unknown_stiffness for p, fit in zip(members, own)
    ]
    unknown = not all(joined(ranks, known))
    for some in dict.fromkeys([stride, 1]):
        motion = _projected(reduced, records, slice(0, levels, some), levels, ranks)
        e, is_smooth = _errors(reduced, motion, some * step, fits, unknown)
        if is_smooth:
            break
    else:
        if not complete:
            return None  # the load between the levels is not known
    if not np.all(np.isfinite(e)):
        return None
    return _located(reduced, e, motion[0], members, ranks, some * step, largest)


def _stride(
    reduced: Reduced, records: Sequence[Rows], levels: int, ranks: Ranks | None, step: float
) -> int:
    """Of how many levels one is read: so that the modes are resolved, and the force."""
    some = _snapshots(levels - 1)
    first, next_one = (_projected(reduced, records, x, levels, ranks) for x in (some, some + 1))
    f, change = (reduced.K @ q + reduced.C @ v + w for q, v, w in (first, next_one - first))
    size = np.linalg.norm(f) + np.linalg.norm(reduced.K @ first[0])
    most = CHANGE * size / (np.linalg.norm(change) + 1e-300)
    resolved = RESOLVED / (reduced.omega[-1] * step + 1e-300)
    return max(1, int(min((levels - 1) // 16, resolved, most)))


def _projected(
    reduced: Reduced,
    records: Sequence[Rows],
    some: np.ndarray | slice,
    levels: int,
    ranks: Ranks | None,
) -> np.ndarray:
    """q, its velocity and acceleration at some of the levels, (3, r, levels); a slice is not copied
    from a file."""
    own = []
    for (u, v, w), Mx, Wx in zip(records, reduced.masses, reduced.forces):
        own.append(np.array([(u[some] @ Mx).T, (v[some] @ Mx).T, (w[some] @ Wx).T]))
    return _total(ranks, own, (3, reduced.omega.size, np.arange(levels)[some].size))


def _errors(
    reduced: Reduced, motion: np.ndarray, step: float, fits: Sequence[Fit], unknown: bool
) -> tuple[np.ndarray, bool]:
    """The recorded q less the exact one under the recorded forces (D3), and whether these are
    smooth: (r, levels)."""
    q, v, w = motion
    K, C = reduced.K, reduced.C
    f = w + K @ q + C @ v
    for fit in fits:
        K, C = K - fit.K, C - fit.C
        f = f - fit.K @ (q - fit.lag_of_u * w)
        f = f - fit.C @ (v - fit.lag_of_v * np.gradient(w, step, axis=1))
    if unknown:
        K, C, f = _with_fitted(K, C, q, v, f)
    P, *G = _propagators(K, C, step)
    bend, is_smooth = _bends(f, NOISE * np.max(np.abs(w)))
    into = G[0] @ f[:, :-1] + G[1] @ (np.diff(f) - 0.5 * bend) + G[2] @ bend
    start = np.concatenate([q[:, 0], v[:, 0]])
    exact = follow_recursion(P, np.ascontiguousarray(np.vstack([start, into.T])))
    return q - exact[:, : len(q)].T, is_smooth


@dataclass(frozen=True)
class Fit:
    """What the estimates of restoring functions have beyond their values, which are linear but for
    a rest, in the shapes; and where they are evaluated: at u - lag_of_u w and v - lag_of_v w'."""

    K: np.ndarray
    C: np.ndarray
    lag_of_u: float
    lag_of_v: float


def _fitted(member: Member, shapes: np.ndarray) -> Fit | None:
    """The fit to the sampled values of the Python functions of a subdomain, None where there are
    too few, and beside springs, which have a part in the estimates."""
    s, watch = member.subdomain, member.watch
    if watch is None or s.springs or member.has_responses or not watch.samples:
        return None
    if any(map(is_compiled, functions_of(s.restoring))) or devices_of(s.restoring):
        return None
    basis, sizes, turned = np.linalg.svd(shapes, full_matrices=False)
    kept = sizes > OF_FUNCTIONS * sizes[:1]
    into, k = sizes[kept, None] * turned[kept], int(np.sum(kept))
    if len(watch.samples) <= 6 * k:
        return None
    u, v, r = (basis[:, kept].T @ x for x in np.moveaxis(np.array(watch.samples), 0, 2))
    fit = _linear(np.vstack([u, v]), r)
    K_r, C_r = (shapes.T @ product(A, shapes) for A in (s.restoring_stiffness, s.restoring_damping))
    return Fit(
        K_r - into.T @ fit[:, :k] @ into,
        C_r - into.T @ fit[:, k:] @ into,
        s.scheme.coefficients(member.step)[0],
        0.5 * member.step**2,
    )


def _linear(X: np.ndarray, F: np.ndarray) -> np.ndarray:
    """A of F = A X + constant, by least squares over the columns."""
    X, F = (x - x.mean(axis=1, keepdims=True) for x in (X, F))
    size = np.linalg.norm(X, axis=1, keepdims=True) + 1e-300
    result: np.ndarray = (np.linalg.lstsq((X / size).T, F.T, rcond=1e-6)[0] / size).T
    return result


def _with_fitted(
    K: np.ndarray, C: np.ndarray, q: np.ndarray, v: np.ndarray, f: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K and C with what the force contains of q and v, where functions give an unknown part."""
    r, levels = q.shape
    if levels <= 6 * r:
        return K, C, f
    fit = _linear(np.vstack([q, v]), f)
    K, C = K - fit[:, :r], C - fit[:, r:]
    return K, C, f - fit[:, :r] @ q - fit[:, r:] @ v


def _propagators(K: np.ndarray, C: np.ndarray, step: float) -> tuple[np.ndarray, ...]:
    """P of (q, v) over a step, and G of a force, of one that rises to it, and of x^2 / 2 of it."""
    r = len(K)
    A = np.zeros((5 * r, 5 * r))
    A[:r, r : 2 * r] = np.eye(r)
    A[r : 2 * r, :r], A[r : 2 * r, r : 2 * r] = -K, -C
    for k in (1, 2, 3):
        A[k * r : (k + 1) * r, (k + 1) * r : (k + 2) * r] = np.eye(r) / (step if k > 1 else 1.0)
    whole = scipy.linalg.expm(A * step)[: 2 * r]
    return tuple(np.ascontiguousarray(x) for x in np.split(whole, [2 * r, 3 * r, 4 * r], axis=1))


def _bends(f: np.ndarray, noise: float) -> tuple[np.ndarray, bool]:
    """The second difference of a force within each step, 0 where the force is rough; and whether
    it is smooth everywhere, but for noise."""
    second = np.diff(f, 2)
    bend = np.concatenate([second[:, :1], second, second[:, -1:]], axis=1)
    fourth = np.zeros_like(f)
    fourth[:, 2:-2] = np.abs(np.diff(f, 4))
    rough = _around(fourth) > ROUGH * _around(np.abs(bend))
    mean = np.where(rough, 0.0, 0.5 * (bend[:, 1:] + bend[:, :-1]))
    return mean, not np.any(rough & (_around(fourth) > noise))


def _around(x: np.ndarray) -> np.ndarray:
    """The largest of each six levels about a step."""
    steps = x.shape[1] - 1
    padded = np.pad(x, ((0, 0), (2, 2)))
    result: np.ndarray = np.max([padded[:, k : k + steps] for k in range(6)], axis=0)
    return result


def _located(
    reduced: Reduced,
    e: np.ndarray,
    q: np.ndarray,
    members: Sequence[Member],
    ranks: Ranks | None,
    step: float,
    largest: float,
) -> Estimate:
    """The largest error of a dof, and the mode that contributes most to it."""
    r, omega = len(e), reduced.omega
    # no mode is wrong by more than the distance it moves
    moved, wrong = np.ptp(q, axis=1), np.max(np.abs(e), axis=1)
    e = e * np.minimum(1.0, moved / np.maximum(wrong, 1e-300))[:, None]
    peaks = [np.max(np.abs(x), axis=0, initial=0.0) for x in reduced.shapes]
    bound = np.max(np.vstack([np.zeros((1, r)), *joined(ranks, peaks)]), axis=0) @ np.abs(e)
    worst = np.argsort(bound)[-WORST:]
    own = [_largest_of(member, x, e[:, worst], omega) for member, x in zip(members, reduced.shapes)]
    size, name, dof, mode, _ = max(joined(ranks, own))
    shares = [
        _share(member, x, Mx, mode, omega)
        for member, x, Mx in zip(members, reduced.shapes, reduced.masses)
    ]
    shares = list(joined(ranks, shares))
    high = omega * max(x[1] for x in shares) > 1.0
    rest = [
        _largest_of(member, x, e[:, worst] * ~high[:, None], omega)[0]
        for member, x in zip(members, reduced.shapes)
    ]
    lasting = max(joined(ranks, rest))
    return Estimate(
        size / largest,
        lasting / largest,
        _expected(e[mode], moved[mode], size / largest),
        (name, dof),
        float(omega[mode]),
        shares,
    )


def _largest_of(
    member: Member, shapes: np.ndarray, e: np.ndarray, omega: np.ndarray
) -> tuple[float, str, int, int, float]:
    """The largest error of a dof of a subdomain: size, name, dof, mode, and its omega."""
    errors = np.abs(shapes @ e)
    if not errors.size:
        return 0.0, member.name, 0, 0, 0.0
    dof, level = np.unravel_index(np.argmax(errors), errors.shape)
    mode = int(np.argmax(np.abs(shapes[dof] * e[:, level])))
    return float(errors[dof, level]), member.name, int(dof), mode, float(omega[mode])


def _share(
    member: Member, shapes: np.ndarray, masses: np.ndarray, mode: int, omega: np.ndarray
) -> tuple[str, float, bool, float, float]:
    """What `Estimate.shares` has of a subdomain: its mass in the mode, and the error of its steps
    per unit of time."""
    mass = float(shapes[:, mode] @ masses[:, mode])
    rate = _step_error(member.subdomain.scheme, float(omega[mode]) * member.step) / member.step
    return member.name, member.step, member.double, member.h, mass * rate


def _step_error(scheme: Scheme, Omega: float) -> float:
    """|z - exp(i Omega)| of a step of a free oscillator, with the eigenvalue z that is nearest."""
    if not 0.0 < Omega < 1e6:
        return 0.0
    values = np.linalg.eigvals(scheme.amplification(Omega))
    return float(np.min(np.abs(values - np.exp(1j * Omega))))


def _expected(e: np.ndarray, moved: float, size: float) -> float:
    """The error without its end at the size of the motion: as it began, where it came near that."""
    largest = float(np.max(np.abs(e)))
    if not largest > 0.4 * moved:
        return size
    first = int(np.argmax(np.abs(e) >= largest / 3.0))
    return max(size, size / 3.0 * (e.size - 1) / max(first, 1))


def warn_if_coarse(estimate: Estimate | None, end: float) -> None:
    """AccuracyWarning that names the subdomains whose steps are too coarse for the motion."""
    if estimate is None or not COARSE < estimate.size < np.inf:
        return
    x = estimate
    worst = max(share for *_, share in x.shares)
    coarse = [own for own in x.shares if own[-1] >= 0.5 * worst]
    doubles = [f", a double step of 2 x {h:g}" if double else "" for _, _, double, h, _ in coarse]
    if len(coarse) == 1:
        name, step = coarse[0][:2]
        text = f"the step {step:g}{doubles[0]}{',' * bool(doubles[0])} of subdomain {name!r} is"
    else:
        each = [f"{own[0]!r} ({own[1]:g}{double})" for own, double in zip(coarse, doubles)]
        text = f"the steps of subdomains {listing(each)} are"
    name, dof = x.place
    warn(
        f"{text} too coarse for {'its' if len(coarse) == 1 else 'their'} motion: the error until "
        f"t = {end:g} is about {_percent(x.size)} of the largest displacement, most at dof {dof} "
        f"of {name!r}{_period(x, coarse[0][1])}; steps of {_advised(x, coarse[0][1])} would give "
        "about 1 per cent",
        AccuracyWarning,
    )


def _percent(size: float) -> str:
    return f"{100.0 * size:.2g} per cent" if size < 0.99 else "100 per cent or more"


def _period(x: Estimate, step: float) -> str:
    """What moves there."""
    if not x.omega > 0.0:
        return ""
    period = 2.0 * np.pi / x.omega
    steps = f"{period / step:.2g}" if period < 100.0 * step else f"{period / step:.0f}"
    text = f", in its motion of period {period:.3g} ({steps} steps)"
    if 0.0 < x.lasting < COARSE:
        text += f"; without such high modes it is {_percent(x.lasting)}"
    return text


def _advised(x: Estimate, step: float) -> str:
    """A step with which the error is `FINE`, of order 2, and which resolves the mode."""
    advised = step * np.sqrt(FINE / x.expected)
    if x.omega > 0.0:
        advised = min(advised, 1.0 / x.omega)
    return f"{advised:.1g}"
