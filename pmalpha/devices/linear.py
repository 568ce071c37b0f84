"""Specimens with their transfer systems as linear systems, equations (Y13) and (Y14)."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from hashlib import sha256
from math import comb
from typing import Any

import numpy as np

from .._checks import check_word, positive_number, real_array, real_number, whole_number
from ..problem import forms
from ..problem.device import DEFAULT_STEPS, Device
from ..problem.dofs import dof_list

# ---- command filters ----------------------------------------------------------------------------
# Filters of commands in the form of the core: delays, dynamics, least squares: (Y1) to (Y7).

# Largest lag of a command, in steps.
LARGEST_LAG = 1 << 20
# Of the adaptive compensation: the low-pass filter, samples in a second, and limits of the
# coefficients and of their change in a second, for delays up to 0.06 s.
CUTOFF, SAMPLES, LONGEST = 20.0, 64, 0.06
LEAST, MOST = np.array([0.7, 0.0, 0.0]), np.array([1.3, 0.06, 0.0032])
CHANGE = np.array([2.0, 0.05, 0.001])
# It rests while the motion of the last second is below this share of the largest one.
THRESHOLD = 0.05
# Periods of an actuator in a step: above it rounding exceeds what the dynamics do in a step.
FASTEST = 1e4


def delayed(delay: float, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Lags in steps and their weights: (Y1), a cubic between the commands around t - delay."""
    steps = delay / h
    if steps > LARGEST_LAG:
        raise ValueError(f"delay must be at most {LARGEST_LAG} steps of {h:g}, got {delay:g}")
    step_count = round(steps)
    if abs(steps - step_count) < 1e-9 * max(1.0, steps):
        return np.array([step_count], dtype=np.int64), np.ones(1)
    lags = max(0, int(steps) - 1) + np.arange(4)
    weights = [
        np.prod([(steps - other) / (lag - other) for other in lags if other != lag]) for lag in lags
    ]
    return lags.astype(np.int64), np.array(weights)


def held_dynamics(
    order: int, frequency: float | None, damping: float, h: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """phi, before, after and slope of (Y2): exact for commands that are linear in a step."""
    from scipy.linalg import expm

    if frequency is None:
        return np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros(1)
    if frequency * h > FASTEST:
        raise ValueError(
            f"frequency of an actuator must be at most {FASTEST:g} in a step of {h:g}, got "
            f"{frequency:g}; without dynamics leave it out"
        )
    w = 2.0 * np.pi * frequency
    # coefficients of x', x'', ... in w^-order x^(order) + ... + x = c
    of_lag, of_pair = np.array([1.0 / w, 1.0]), np.array([1.0 / w**2, 2.0 * damping / w, 1.0])
    polynomial = {1: of_lag, 2: of_pair, 3: np.polymul(of_lag, of_pair)}[order]
    A = np.zeros((order + 2, order + 2))
    A[: order - 1, 1:order] = np.eye(order - 1)
    A[order - 1, :order] = -polynomial[:0:-1] / polynomial[0]
    A[order - 1, order] = 1.0 / polynomial[0]  # the command, and its increment over the step
    A[order, order + 1] = 1.0 / h
    E = expm(h * A)[:order]
    before, after = E[:, order] - E[:, order + 1], E[:, order + 1]
    slope = np.array([-w, w]) if order == 1 else np.eye(order + 1)[1]
    return tuple(map(np.ascontiguousarray, (E[:, :order], before, after, slope)))  # type: ignore


def adaptive(delay: float, h: float) -> forms.Adaptive:
    """The adaptive compensation, (Y6) and (Y7), for steps of length h."""
    from scipy.signal import butter

    every = max(1, round(1.0 / (SAMPLES * h)))
    window = max(8, round(1.0 / (every * h)))
    # larger limits for a larger delay, of a1 in proportion and of a2 to its square
    scale = max(1.0, 3.0 * delay / LONGEST) ** np.arange(3)
    start = np.array([1.0, delay, 0.5 * delay**2])
    limits = np.array([start, LEAST, scale * MOST, scale * CHANGE * every * h])
    sections = butter(6, min(CUTOFF, 0.25 / h), fs=1.0 / h, output="sos")[:, [0, 1, 2, 4, 5]]
    return forms.Adaptive(h, limits, THRESHOLD, every, window, np.ascontiguousarray(sections))


def inverse_of_lag(delay: float, h: float) -> forms.Actuator:
    """(Y5)"""
    lead = delay / h
    return _weighted(np.array([0, 1]), np.array([1.0 + lead, -lead]), h)


def extrapolation(order: int, delay: float, h: float) -> forms.Actuator:
    """(Y4)"""
    taps = [
        ((-1.0) ** i * comb(order + 1, i + 1), *delayed(i * delay, h)) for i in range(order + 1)
    ]
    lags, at = np.unique(np.concatenate([lag for _, lag, _ in taps]), return_inverse=True)
    weights = np.bincount(at, np.concatenate([a * weight for a, _, weight in taps]))
    return _weighted(lags, weights, h)


def _weighted(lags: np.ndarray, weights: np.ndarray, h: float) -> forms.Actuator:
    lags = np.ascontiguousarray(lags, dtype=np.int64)
    return forms.Actuator(lags, weights, np.inf, *held_dynamics(1, None, 1.0, h), 0.0, 0.0, 0)


# ---- linear actuator ----------------------------------------------------------------------------

# Real parts above this share of the largest pole grow; below it they are rounding.
ROUNDING = 1e-9
HOLDS = ("linear", "zero")


class LinearActuator(Device):
    """A specimen with its transfer system: linear, from commands to displacements and forces.

    With commands c the state follows x' = A x + B c; C x are the displacements that are measured,
    F x the forces on the structure. Commands are delayed, held within the saturation and rounded
    to the quantum; the system is integrated exactly. It is at rest where the first command is. All
    is compiled, and the state is part of that of the coupler.

    Parameters
    ----------
    A : (s, s) array_like
        No pole may have a positive real part.
    B : (s, n) array_like
        Of the n commands.
    C, F : (n, s) array_like
        Displacements and forces.
    dofs : (n,) list of int or str, optional
        Of the subdomain, which are commanded and have the forces. Default: the first n.
    delay : float, default 0.0
        Dead time of commands, in the unit of t; need not be a multiple of the step.
    hold : {"linear", "zero"}
        The command between two steps: linear, by a controller that is given the next one in
        advance; or that of the last step, held.
    noise, force_noise : float, default 0.0
        Standard deviations of the displacements and forces, of each step. A noise power (as some
        publications give it) times the sampling rate is the square of it.
    saturation : float, optional
        Largest command that is followed, in both directions.
    quantum : float, optional
        Step of the converters of commands and displacements.
    seed : int, optional
        Of the noise, which is the same in each run. Default: another one for each object.
    max_steps : int, default 100
        As of `SimulatedActuator`.

    Examples
    --------
    A lag of 20 ms in front of a spring of stiffness 3:

    >>> lag = rig.LinearActuator([[-50.0]], [[50.0]], [[1.0]], [[3.0]])
    >>> lag.respond([0.0, 1.0, 1.0], 0.1).force.round(3).tolist()
    [0.0, 2.404, 2.996]
    """

    def __init__(
        self,
        A: Any,
        B: Any,
        C: Any,
        F: Any,
        *,
        dofs: Any = None,
        delay: float = 0.0,
        hold: str = "linear",
        noise: float = 0.0,
        force_noise: float = 0.0,
        saturation: float | None = None,
        quantum: float | None = None,
        seed: int | None = None,
        max_steps: int = DEFAULT_STEPS,
    ):
        self.specimen = ()
        self.delay = real_number(delay, "delay", low=0.0)
        self.max_steps = whole_number(max_steps, "max_steps", low=1)
        self.A, self.B, self.C, self.F = _system(A, B, C, F)
        check_word(hold, "hold", HOLDS)
        self.hold = hold
        self.noise = real_number(noise, "noise", low=0.0)
        self.force_noise = real_number(force_noise, "force_noise", low=0.0)
        self.saturation = None if saturation is None else positive_number(saturation, "saturation")
        self.quantum = None if quantum is None else positive_number(quantum, "quantum")
        drawn = int(np.random.SeedSequence().generate_state(1)[0])
        self.seed = drawn if seed is None else whole_number(seed, "seed")
        self._dofs = dofs
        if dofs is not None and np.atleast_1d(np.asarray(dofs, dtype=object)).shape != (self.n,):
            raise ValueError(f"dofs must be {self.n}, one for each command, got {dofs!r}")

    @classmethod
    def from_zpk(
        cls,
        zeros: Any,
        poles: Any,
        gain: Any,
        *,
        stiffness: Any,
        damping: Any = 0.0,
        mass: Any = 0.0,
        **options: Any,
    ) -> LinearActuator:
        """Of the zeros, poles and gains of displacements over commands.

        Parameters
        ----------
        zeros, poles : lists
            In radians per unit of t, complex ones with their conjugates; nested n by n for n
            commands, [i][j] of displacement i over command j.
        gain : float or (n, n) array_like
            Factors of the products: ``gain prod(s - zeros) / prod(s - poles)``.
        stiffness, damping, mass : float or (n, n) array_like
            Of the specimen: the force is stiffness x + damping x' + mass x''. The latter two need
            2 and 3 poles more than zeros.
        **options
            As of `LinearActuator`.

        Returns
        -------
        LinearActuator
            With one state for each pole of a column, where all of a column are the same.

        Examples
        --------
        >>> lag = rig.LinearActuator.from_zpk([], [-50.0], 50.0, stiffness=3.0)
        >>> lag.response(0.0), lag.poles
        ((1+0j), array([-50.+0.j]))
        """
        return cls(*_of_zpk(zeros, poles, gain, (stiffness, damping, mass)), **options)

    @property
    def n(self) -> int:
        """Number of commands."""
        return int(self.B.shape[1])

    @property
    def width(self) -> int:
        """Number of commands."""
        return self.n

    @property
    def dofs(self) -> np.ndarray | None:
        """The dofs of the commands, as they were given or, in a subdomain, as numbers."""
        return self._dofs  # type: ignore[no-any-return]

    @property
    def innermost(self) -> Any:
        """The linear system itself."""
        return self

    @property
    def poles(self) -> np.ndarray:
        """Eigenvalues of A, (s,), in radians per unit of t, by modulus."""
        values = np.linalg.eigvals(self.A).astype(complex)
        return values[np.lexsort([values.imag, np.abs(values).round(9)])]

    def response(self, frequency: Any) -> Any:
        """Displacements over commands at frequencies, dead time included.

        Parameters
        ----------
        frequency : float or (k,) array
            In cycles per unit of t.

        Returns
        -------
        complex or array
            For one command a number, or (k,); else (n, n) or (k, n, n).
        """
        f = real_array(np.asarray(frequency, dtype=float), "frequency", (0, 1))
        s = 2j * np.pi * np.atleast_1d(f)
        G = np.array([self.transfer(x) for x in s]) * np.exp(-s * self.delay)[:, None, None]
        G = G[:, 0, 0] if self.n == 1 else G
        return (complex(G[0]) if self.n == 1 else G[0]) if f.ndim == 0 else G

    def transfer(self, s: complex) -> np.ndarray:
        """Displacements over commands at s, (n, n), without dead time.

        Parameters
        ----------
        s : complex
            In radians per unit of t.

        Returns
        -------
        (n, n) array
            Complex.
        """
        return np.asarray(self.C @ np.linalg.solve(s * np.eye(len(self.A)) - self.A, self.B))

    @property
    def facts(self) -> str:
        """Its parameters, for the comparison of problems."""
        names = ["delay", "hold", "noise", "force_noise", "saturation", "quantum"]
        if self.noise or self.force_noise:
            names.append("seed")
        parameters = ", ".join(f"{name}={getattr(self, name)!r}" for name in names)
        digest = sha256(b"".join(x.tobytes() for x in (self.A, self.B, self.C, self.F)))
        return f"LinearActuator {digest.hexdigest()[:16]}, {parameters}"

    def _placed(self, n: int, names: Sequence[str] | None, label: str) -> LinearActuator:
        what = f"{label}: dofs of a LinearActuator"
        moved = copy(self)
        if self._dofs is None and self.n > n:
            raise ValueError(f"{what} must be those of {self.n} commands, got a subdomain of {n}")
        dofs = range(self.n) if self._dofs is None else self._dofs
        moved._dofs = np.array(dof_list(dofs, n, what, names), dtype=np.int64)
        return moved

    def _linear(self, h: float) -> forms.Linear:
        """The system for the core, with steps of length h."""
        from scipy.linalg import expm

        s, n = self.B.shape
        E = np.zeros((s + 2 * n, s + 2 * n))
        E[:s, :s], E[:s, s : s + n] = self.A, self.B
        E[s : s + n, s + n :] = np.eye(n) / h  # the command, and its increment over the step
        E = expm(h * E)[:s]
        after = E[:, s + n :]
        before = E[:, s : s + n] - after
        if self.hold == "zero":
            before, after = before + after, np.zeros_like(after)
        rest = at_rest(self.A, self.B)
        lag, weight = delayed(self.delay, h)
        return forms.Linear(
            phi=np.ascontiguousarray(E[:, :s]),
            before=np.ascontiguousarray(before),
            after=np.ascontiguousarray(after),
            rest=np.ascontiguousarray(rest),
            displacement=self.C,
            force=self.F,
            lag=lag,
            weight=weight,
            largest=np.inf if self.saturation is None else self.saturation,
            noise=self.noise,
            force_noise=self.force_noise,
            quantum=self.quantum or 0.0,
            seed=self.seed,
        )


def servo_hydraulic(
    *,
    mass: float,
    stiffness: float,
    damping: float,
    gain: float = 1.0261,
    valve: Sequence[float] = (2.1283e13, 425.0, 9.9976e4),
    leakage: float = 3.3,
    interaction: float = 4.2297e6,
    **options: Any,
) -> LinearActuator:
    """A servo-hydraulic actuator with its specimen, of five states, equation (Y13).

    The defaults are those of the benchmark of Silva, Gomez, Maghareh, Dyke and Spencer (2020), in
    N, m and s.

    Parameters
    ----------
    mass, stiffness, damping : float
        Of the specimen.
    gain : float
        Of the command.
    valve : (3,) floats
        Gain of the valve and its displacement feedback, and the two coefficients of its dynamics,
        q'' + valve[1] q' + valve[2] q = valve[0] (gain c - x).
    leakage : float
        Of the chambers: f' + leakage f = q - interaction x'.
    interaction : float
        Control-structure interaction, of the velocity.
    **options
        As of `LinearActuator`.

    Returns
    -------
    LinearActuator
        With one command; the force is a state.

    Examples
    --------
    >>> plant = rig.servo_hydraulic(mass=29.13, stiffness=1.19e6, damping=114.2209)
    >>> round(abs(plant.response(0.0)), 5), round(abs(plant.response(3.6)), 4)
    (1.00751, 0.9159)
    """
    m, k = positive_number(mass, "mass"), real_number(stiffness, "stiffness")
    c, g = real_number(damping, "damping"), real_number(gain, "gain")
    a3, a2 = real_number(leakage, "leakage"), real_number(interaction, "interaction")
    a1b0, b1, b2 = real_array(valve, "valve") if len(valve) == 3 else _refuse_valve(valve)
    A = [
        [0.0, 1.0, 0.0, 0.0, 0.0],
        [-k / m, -c / m, 1.0 / m, 0.0, 0.0],
        [0.0, -a2, -a3, 1.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 1.0],
        [-a1b0, 0.0, 0.0, -b2, -b1],
    ]
    B = [[0.0], [0.0], [0.0], [0.0], [g * a1b0]]
    x, f = [[1.0, 0.0, 0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0, 0.0, 0.0]]
    return LinearActuator(A, B, x, f, **options)


def at_rest(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """States of A x + B = 0, (s, n); with a pole at 0 those of least size."""
    from scipy.linalg import matrix_balance

    balanced, T = matrix_balance(A)
    return -np.asarray(T @ np.linalg.lstsq(balanced, np.linalg.solve(T, B), rcond=None)[0])


def _refuse_valve(valve: Any) -> Any:
    raise ValueError(f"valve must be three numbers, got {valve!r}")


def _system(A: Any, B: Any, C: Any, F: Any) -> tuple[np.ndarray, ...]:
    """The matrices, checked."""
    A, B = real_array(A, "A", 2), real_array(B, "B", 2)
    C, F = real_array(C, "C", 2), real_array(F, "F", 2)
    s, n = len(A), B.shape[1]
    if A.shape != (s, s) or s == 0:
        raise ValueError(f"A must be square, got shape {A.shape}")
    if B.shape != (s, n) or n == 0:
        raise ValueError(f"B must have {s} rows as A, and a column for each command, got {B.shape}")
    for name, matrix in (("C", C), ("F", F)):
        if matrix.shape != (n, s):
            raise ValueError(f"{name} must have shape {(n, s)}, got {matrix.shape}")
    poles = np.linalg.eigvals(A)
    worst = poles[np.argmax(poles.real)]
    if worst.real > ROUNDING * np.max(np.abs(poles)):
        raise ValueError(f"A must have no pole with positive real part, got {worst:g}: it grows")
    return tuple(map(np.ascontiguousarray, (A, B, C, F)))


# ---- zeros and poles -----------------------------------------------------------------------------


def _of_zpk(zeros: Any, poles: Any, gain: Any, specimen: Sequence[Any]) -> tuple[np.ndarray, ...]:
    """A, B, C and F; specimen: stiffness, damping and mass."""
    from scipy.linalg import block_diag

    gains = real_array(np.atleast_2d(np.asarray(gain, dtype=float)), "gain", 2)
    n = len(gains)
    if gains.shape != (n, n):
        raise ValueError(f"gain must be a number or n by n, got shape {gains.shape}")
    Z, P = _nested(zeros, n, "zeros", np.ndim(gain)), _nested(poles, n, "poles", np.ndim(gain))
    excess = min(len(p) - len(z) for row in zip(Z, P) for z, p in zip(*row))
    if excess < 1:
        raise ValueError("poles must be more than zeros: a specimen has no force at once")
    blocks = [_column([row[j] for row in Z], [row[j] for row in P], gains[:, j]) for j in range(n)]
    A = block_diag(*(block for block, _, _ in blocks))
    B = block_diag(*(b[:, None] for _, b, _ in blocks))
    C = np.hstack([c for _, _, c in blocks])
    k, c, m = (
        _of_specimen(x, n, name) for x, name in zip(specimen, ("stiffness", "damping", "mass"))
    )
    for name, matrix, needed in (("damping", c, 2), ("mass", m, 3)):
        if np.any(matrix) and excess < needed:
            raise ValueError(
                f"{name} must be 0 without {needed} poles more than zeros, got {excess} more"
            )
    return A, B, C, k @ C + c @ (C @ A) + m @ (C @ A @ A)


def _of_specimen(x: Any, n: int, name: str) -> np.ndarray:
    matrix = real_array(np.asarray(x, dtype=float), name, (0, 2))
    matrix = matrix * np.eye(n) if matrix.ndim == 0 else matrix
    if matrix.shape != (n, n):
        raise ValueError(f"{name} must be a number or {n} by {n}, got shape {matrix.shape}")
    return matrix


def _nested(roots: Any, n: int, name: str, ndim: int) -> list[list[np.ndarray]]:
    """Roots by row and column; a flat list where the gain is a number."""
    rows = [[roots]] if ndim == 0 else roots
    try:
        table = [[np.asarray(x, dtype=complex).ravel() for x in row] for row in rows]
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be lists of numbers, {n} by {n}, got {roots!r}") from None
    if len(table) != n or any(len(row) != n for row in table):
        raise ValueError(f"{name} must be nested {n} by {n} as gain")
    for x in (x for row in table for x in row):
        if not np.all(np.isfinite(x)):
            raise ValueError(f"{name} must be finite, got {x}")
        coefficients = np.atleast_1d(np.poly(x))
        if np.max(np.abs(coefficients.imag)) > ROUNDING * np.max(np.abs(coefficients)):
            raise ValueError(f"{name} must have complex numbers with their conjugates, got {x}")
    return table


def _polynomial(roots: np.ndarray) -> np.ndarray:
    """Its coefficients, the highest power first."""
    return np.asarray(np.atleast_1d(np.poly(roots)).real)


def _column(
    zeros: Sequence[np.ndarray], poles: Sequence[np.ndarray], gains: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, b and C of one command: of one denominator where all rows have the same poles."""
    if all(np.array_equal(poles[0], p) for p in poles[1:]):
        scale = float(np.max(np.abs(poles[0]))) or 1.0  # of time, so that numbers are alike
        denominator = _polynomial(poles[0] / scale)
        s = len(denominator) - 1
        A = np.eye(s, k=1)
        A[-1] = -denominator[:0:-1]
        C = np.zeros((len(gains), s))
        for i, (z, g) in enumerate(zip(zeros, gains)):
            numerator = g * _polynomial(z / scale) * scale ** (len(z) - s)
            C[i, : len(numerator)] = numerator[::-1]
        return scale * A, scale * np.eye(s)[-1], C
    from scipy.linalg import block_diag

    parts = [_column([z], [p], np.array([g])) for z, p, g in zip(zeros, poles, gains)]
    A, C = block_diag(*(x[0] for x in parts)), block_diag(*(x[2] for x in parts))
    return A, np.concatenate([x[1] for x in parts]), C
