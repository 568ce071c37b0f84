"""The inverse of a model of a transfer system as filters of the core, equations (Y14) to (Y16)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from .._checks import positive_number, real_number
from ..problem import forms
from .linear import LinearActuator

# Least order of the low-pass filter of commands, and what a coefficient of a variation may be.
LEAST_ORDER, LARGEST = 4, 3.0
# In cycles per unit of t: the low-pass filter of the feedback, at most, and of least squares.
FEEDBACK, LEARNING = 60.0, 20.0
# A zero of the model has a singular value that falls there by this factor, against points nearby;
# modal form and inverse agree within the tolerance, else the zeros are not simple.
FALLS, TOLERANCE = 0.05, 1e-6
# A residue is the mean over so many points of a circle, whose radius is this share of the distance
# to the next pole: an error of 0.1^16.
POINTS, SHARE = 16, 0.1


class Rows(NamedTuple):
    """A matrix of functions of s, (n, n), and its poles.

    zeros: those of a model, which are its poles, of rank one.
    """

    value: Callable[[complex], np.ndarray]
    zeros: np.ndarray


class ModelInverse:
    """What method="model" is made of.

    Attributes
    ----------
    model : LinearActuator
        Which is inverted.
    measures : bool
        Whether it needs the measured displacement.
    """

    def __init__(
        self,
        model: LinearActuator,
        delay: float,
        bandwidth: float,
        feedback: float,
        variations: Any,
        sigma: float | None,
    ):
        self.model = model
        self.delay = delay + model.delay
        self.bandwidth = positive_number(bandwidth, "bandwidth")
        self.feedback = real_number(feedback, "feedback", low=0.0)
        self.inverse = inverse_of(model, "model")
        self.order = max(LEAST_ORDER, growth(self.inverse))
        self.variations, self.label = _variations(variations, model, self.inverse)
        self.sigma = _sigma(sigma, variations)
        self.measures = self.feedback > 0.0 or bool(self.variations)

    @property
    def facts(self) -> str:
        """The parameters, for the comparison of problems."""
        return (
            f"model {self.model.facts}, bandwidth={self.bandwidth!r}, feedback={self.feedback!r}, "
            f"variations={self.label}, sigma={self.sigma!r}"
        )

    def filter(self, h: float) -> forms.Inverse:
        """The filter for the core, with steps of length h."""
        if not self.bandwidth <= 0.25 / h * (1.0 + 1e-9):
            raise ValueError(
                f"bandwidth must be at most a quarter of 1/h = {1.0 / h:g}, got {self.bandwidth:g}"
            )
        low_pass = butterworth(self.order, self.bandwidth)
        c1, c2 = np.poly(low_pass)[[-2, -3]].real / np.poly(low_pass)[-1].real
        tau, rows = self.delay, [self.inverse, *self.variations]
        command = modal(rows, low_pass, h)
        feedback = regressors = low = None
        if self.feedback > 0.0:
            feedback = modal([self._integral(h)], self._feedback_poles(h), h, at_zero=True)
        if self.variations:
            learning = butterworth(self.order + 1, min(LEARNING, 0.25 / h))
            regressors = modal(rows, learning, h)
            low = modal([Rows(partial(_unit, self.model.n), np.empty(0))], learning, h)
        factors = c1 + tau, c2 + c1 * tau + 0.5 * tau**2  # l1, l2
        sigma = 1.0 if self.sigma is None else self.sigma
        return forms.Inverse(h, *factors, command, feedback, regressors, low, sigma, LARGEST)

    def _integral(self, h: float) -> Rows:
        """(Y15), but for its low-pass filter"""
        rate = 2.0 * np.pi * self.feedback
        return Rows(partial(_integrated, rate, self.inverse), self.inverse.zeros)

    def _feedback_poles(self, h: float) -> np.ndarray:
        return butterworth(self.order, min(FEEDBACK, 0.6 * self.bandwidth, 0.25 / h))


# ---- what is uncertain ---------------------------------------------------------------------------


def _sigma(sigma: Any, variations: Any) -> float | None:
    if (sigma is None) != (variations is None):
        raise ValueError(
            "sigma and variations must be given together, got "
            f"sigma={sigma!r}, variations={'None' if variations is None else '...'}"
        )
    return None if sigma is None else positive_number(sigma, "sigma")


def _variations(
    variations: Any, model: LinearActuator, inverse: Rows
) -> tuple[tuple[Rows, ...], str]:
    """The changes V_j of the inverse (Y16), and a description."""
    if variations is None:
        return (), "None"
    if isinstance(variations, (list, tuple)):
        if not variations:
            raise ValueError("variations must be a share or at least one model, got none")
        for i, other in enumerate(variations):
            if not isinstance(other, LinearActuator) or other.n != model.n:
                raise ValueError(
                    f"variations[{i}] must be a LinearActuator of {model.n} commands, got {other!r}"
                )
        named = enumerate(variations)
        inverses = [inverse_of(other, f"variations[{i}]") for i, other in named]
        changes = tuple(_difference(other, inverse) for other in inverses)
        return changes, str([other.facts for other in variations])
    share = real_number(variations, "variations")
    if not 0.0 < share < 1.0:
        raise ValueError(f"variations must be a share between 0 and 1, got {share:g}")
    if model.n > 1:
        raise ValueError(
            f"variations must be a list of models for {model.n} commands, a share is for one"
        )
    coefficients = np.poly(model.poles)[::-1]  # of s^0, s^1, ...
    numerator = np.atleast_1d(np.poly(inverse.zeros))
    point = 1.0 + np.max(np.abs(model.poles))
    gain = model.transfer(point)[0, 0] * np.polyval(coefficients[::-1], point)
    gain /= np.polyval(numerator, point)
    terms = tuple(
        Rows(partial(_term, share * c, j, gain, numerator), inverse.zeros)
        for j, c in enumerate(coefficients)
    )
    return terms, repr(share)


def _difference(other: Rows, inverse: Rows) -> Rows:
    zeros = np.concatenate([other.zeros, inverse.zeros])
    return Rows(partial(_less, other, inverse), zeros)


# Functions of s of a module, not lambdas: what they are part of can be pickled.


def _less(other: Rows, inverse: Rows, s: complex) -> np.ndarray:
    difference: np.ndarray = other.value(s) - inverse.value(s)
    return difference


def _inverted(model: LinearActuator, s: complex) -> np.ndarray:
    inverse: np.ndarray = np.linalg.inv(model.transfer(s))
    return inverse


def _integrated(rate: float, inverse: Rows, s: complex) -> np.ndarray:
    return rate / s * inverse.value(s)


def _term(factor: float, power: int, gain: float, numerator: np.ndarray, s: complex) -> np.ndarray:
    return np.array([[factor * s**power / (gain * np.polyval(numerator, s))]])


def _unit(n: int, s: complex) -> np.ndarray:
    return np.eye(n)


# ---- inverses ------------------------------------------------------------------------------------


def inverse_of(model: LinearActuator, name: str) -> Rows:
    """The inverse of displacements over commands; ValueError where it would grow."""
    zeros = zeros_of(model)
    worst = zeros[np.argmax(zeros.real)] if zeros.size else -1.0
    if worst.real >= 0.0:
        raise ValueError(
            f"{name} must have zeros with negative real parts, got {worst:g}: its inverse grows"
        )
    return Rows(partial(_inverted, model), zeros)


def zeros_of(model: LinearActuator) -> np.ndarray:
    """Where displacements over commands have a singular matrix, (zeros,), complex.

    The finite eigenvalues of a pencil, in which infinite ones appear as large finite ones: a zero
    is where the smallest singular value vanishes.
    """
    from scipy.linalg import eigvals, matrix_balance

    A, T = matrix_balance(model.A)
    B, C = np.linalg.solve(T, model.B), model.C @ T
    s, n = B.shape
    scale = float(np.max(np.abs(model.poles))) or 1.0
    B, C = B * (scale / np.max(np.abs(B))), C / np.max(np.abs(C))
    pencil = np.block([[A / scale, B / scale], [C, np.zeros((n, n))]])
    mass = np.zeros_like(pencil)
    mass[:s, :s] = np.eye(s)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = scale * eigvals(pencil, mass)
    values = values[np.isfinite(values)]

    def least(x: complex) -> float:
        singular = np.linalg.svd(model.transfer(x), compute_uv=False)
        return float(singular[-1])

    # beside it in both directions: a pole is near one point, or none
    nearby = [min(least(z * 1.01), least(z * (1.0 + 0.01j)), least(z * 0.99)) for z in values]
    zeros = [z for z, value in zip(values, nearby) if least(z) < FALLS * value]
    return np.array(zeros, dtype=complex)


def growth(inverse: Rows) -> int:
    """The power of s with which an inverse grows at high frequency."""
    far = 30.0 * max(1.0, float(np.max(np.abs(inverse.zeros), initial=0.0)))
    while True:  # beyond all poles, where the slope is that of a power
        low, high = (np.linalg.norm(inverse.value(far * x)) for x in (1.0, 2.0))
        slope = np.log2(high / low)
        if abs(slope - round(slope)) < 0.02:
            return int(round(slope))
        far *= 2.0


def butterworth(order: int, frequency: float) -> np.ndarray:
    """The poles of a Butterworth low-pass filter, in radians per unit of t."""
    angle = np.pi * (2 * np.arange(1, order + 1) + order - 1) / (2 * order)
    poles: np.ndarray = 2.0 * np.pi * frequency * np.exp(1j * angle)
    return poles


# ---- modal form ----------------------------------------------------------------------------------


def modal(
    rows: Sequence[Rows], low_pass: np.ndarray, h: float, *, at_zero: bool = False
) -> forms.Modal:
    """The rows behind a low-pass filter, by the trapezoidal rule; `at_zero`: they have a pole at 0.

    A pole and its conjugate are two states; of a pole of the filter there are as many as inputs.
    """

    def value(s: complex) -> np.ndarray:
        return np.vstack([x.value(s) for x in rows]) / low_pass_at(low_pass, s)

    modes = list(_modes_of_filter(rows, low_pass))
    zeros = _different(np.concatenate([x.zeros for x in rows]))
    simple = np.concatenate([zeros, [0.0 + 0.0j]]) if at_zero else zeros
    for pole in simple:
        modes += _modes_at(value, pole, np.concatenate([simple, low_pass]))
    modes = [mode for mode in modes if mode[0].imag >= 0.0]
    scale = float(np.max(np.abs(low_pass)))

    def of_modes(s: complex) -> np.ndarray:
        terms = [np.outer(c, b) / (s - p) for p, c, b in modes]
        terms += [np.outer(c, b).conj() / (s - np.conj(p)) for p, c, b in modes if p.imag]
        return np.asarray(np.sum(terms, axis=0))

    D = (value(scale) - of_modes(scale)).real
    for s in (0.2j * scale, 1.1j * scale, 3.0j * scale):
        error = np.linalg.norm(value(s) - of_modes(s) - D)
        if not error < TOLERANCE * np.linalg.norm(value(s)):
            raise ValueError(
                "model must have simple zeros, apart from each other and from the poles of its "
                f"low-pass filters: the modal form of its inverse is wrong by {error:g}"
            )
    return _discrete(modes, D, h)


def low_pass_at(poles: np.ndarray, s: complex) -> complex:
    """W(s), 1 at 0"""
    return complex(np.prod(1.0 - s / poles))


def _different(poles: np.ndarray) -> np.ndarray:
    """Poles without those that are the same number within rounding."""
    different: list[complex] = []
    for p in poles:
        if all(abs(p - other) > 1e-6 * abs(p) for other in different):
            different.append(p)
    return np.array(different, dtype=complex)


def _modes_of_filter(
    rows: Sequence[Rows], low_pass: np.ndarray
) -> list[tuple[complex, np.ndarray, np.ndarray]]:
    """(pole, c, b) of residues c b^T at the poles of the filter, one for each input."""
    modes = []
    for k, p in enumerate(low_pass):
        rest = np.prod(np.delete(1.0 - p / low_pass, k)) * (-1.0 / p)  # W'(p)
        residue = np.vstack([x.value(p) for x in rows]) / rest
        modes += [(p, residue[:, i], one) for i, one in enumerate(np.eye(residue.shape[1]))]
    return [(complex(_on_axis(p)), c, b) for p, c, b in modes]


def _modes_at(
    value: Callable[[complex], np.ndarray], pole: complex, poles: np.ndarray
) -> list[tuple[complex, np.ndarray, np.ndarray]]:
    """The same at a simple pole of other rows: of rank one, or at 0 of full rank."""
    distances = np.abs(poles - pole)
    radius = SHARE * np.min(distances[distances > 1e-9 * np.max(np.abs(poles))])
    circle = radius * np.exp(2j * np.pi * (np.arange(POINTS) + 0.5) / POINTS)
    residue = np.mean([value(pole + x) * x for x in circle], axis=0)
    if abs(pole.imag) < 1e-9 * abs(pole) or pole == 0.0:
        pole, residue = complex(pole.real), residue.real.astype(complex)
    u, size, vh = np.linalg.svd(residue, full_matrices=False)
    rank = len(size) if pole == 0.0 else 1
    return [(pole, u[:, i] * size[i], vh[i]) for i in range(rank)]


def _on_axis(p: complex) -> complex:
    """A pole without the rounding of an imaginary part."""
    return complex(p.real) if abs(p.imag) < 1e-9 * abs(p) else p


def _discrete(
    modes: Sequence[tuple[complex, np.ndarray, np.ndarray]], D: np.ndarray, h: float
) -> forms.Modal:
    """Real states of the modes: pairs first, then single ones, by twos."""
    pairs = [mode for mode in modes if mode[0].imag]
    singles = [mode for mode in modes if not mode[0].imag]
    A, B, C, rest = [], [], [], []
    D = D.copy()
    for p, c, b in [*pairs, *singles]:
        half = 1.0 - 0.5 * h * p
        a, gain, out = (1.0 + 0.5 * h * p) / half, h / half * b, c / half
        steady = np.zeros_like(b) if p == 0.0 else -b / p
        through = np.outer(out, 0.5 * h * b)
        if p.imag:
            A += [[a.real, -a.imag], [a.real, a.imag]]
            B += [gain.real, gain.imag]
            C += [2.0 * out.real, -2.0 * out.imag]
            rest += [steady.real, steady.imag]
            D += 2.0 * through.real
        else:
            A.append([a.real, 0.0])
            B.append(gain.real)
            C.append(out.real)
            rest.append(steady.real)
            D += through.real
    if len(A) % 2:
        A.append([0.0, 0.0])
        B.append(np.zeros(D.shape[1]))
        C.append(np.zeros(D.shape[0]))
        rest.append(np.zeros(D.shape[1]))
    columns = np.array(C).reshape(len(A), len(D)).T
    arrays = np.array(A), np.array(B), columns, D, np.array(rest)
    return forms.Modal(*(np.ascontiguousarray(x, dtype=float) for x in arrays))
