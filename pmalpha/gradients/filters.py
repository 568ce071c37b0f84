"""The scalar filters that turn a coupled run into its adjoint, equations (A1) to (A6).

A filter is a quotient of products of polynomials in z, the shift by one time level. Factors that
are in both products are cancelled, and each one is applied by itself: the product of three
integrations, multiplied out, would lose half of the digits.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..problem.schemes import Scheme

Factor = tuple[float, ...]

DIFFERENCE: Factor = (1.0, -1.0)  # d = 1 - z
# Two factors are equal up to rounding.
ROUNDING = 1e-12


class Filter:
    """gain times the product of `over` divided by that of `under`, each factor (c0, c1, ...)."""

    def __init__(self, gain: float, over: Sequence[Factor] = (), under: Sequence[Factor] = ()):
        left, right = list(over), list(under)
        for x in over:
            same = next((y for y in right if _parallel(x, y)), None)
            if same is not None:
                left.remove(x)
                right.remove(same)
                gain *= x[0] / same[0]
        self.gain, self.over, self.under = gain, left, right

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """The filtered rows of x, (levels, ...), from rest."""
        from scipy.signal import lfilter

        y = self.gain * x
        if y.size == 0:
            return y
        for c in self.over:
            x, y = y, c[0] * y
            for k in range(1, len(c)):
                y[k:] += c[k] * x[:-k]
        for c in self.under:
            y = lfilter([1.0], c, y, axis=0)
        return y


def _parallel(x: Factor, y: Factor) -> bool:
    if len(x) != len(y) or x[0] == 0.0 or y[0] == 0.0:
        return False
    return all(abs(a / x[0] - b / y[0]) <= ROUNDING for a, b in zip(x, y))


class Filters:
    """The filters of a subdomain with substeps of length `h`.

    Double steps have z^2 and 2 h in (A1), and Phi = 2 d m(z^2) / (1 + z).

    phi: (A5), from the accelerations of the reversed run to the adjoint mu.
    """

    def __init__(self, scheme: Scheme, h: float, double: bool):
        am, af, gamma = scheme.am, scheme.af, scheme.gamma
        d, sums = DIFFERENCE, [(1.0, 1.0)] if double else []
        slope, old, new, *quadratic = (
            _stretched(c) if double else c
            for c in ((gamma, 1.0 - gamma), (1.0 - am, am), (1.0 - af, af), *_displacement(scheme))
        )  # A = new / old
        two = 2.0 if double else 1.0
        self.phi = Filter(two, [d, slope, new], [old, *sums])
        self._of_u = Filter(two * h * h, quadratic, [d, d, d, slope, *sums])
        self._of_v = Filter(h, [], [d, d])
        self._of_w = Filter(1.0 / two, [old, *sums], [d, slope, new])
        self._of_a = Filter(1.0 / two, sums, [d, slope])

    def loads(self, u: np.ndarray, v: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Loads of the reversed run, (A6), for sources (levels, k) in reversed order."""
        result: np.ndarray = self._of_u(u) + self._of_v(v) + self._of_w(w)
        return result

    def impulses(self, levels: int) -> np.ndarray:
        """Loads for a unit source of u, v, w and a at the first reversed level, (levels, 4)."""
        unit = np.zeros((levels, 1))
        unit[0] = 1.0
        return np.hstack([f(unit) for f in (self._of_u, self._of_v, self._of_w, self._of_a)])


class MeanFilters:
    """Those of the trapezoidal rule under "mean", from displacements of the reversed run, (A17)."""

    def __init__(self, h: float):
        mean = (0.5, 0.5)
        self.phi = Filter(1.0, [DIFFERENCE, mean])
        self._of_u = Filter(1.0, [], [DIFFERENCE, mean])
        self._of_v = Filter(1.0 / h, [], [mean, mean])

    def loads(self, u: np.ndarray, v: np.ndarray, w: np.ndarray) -> np.ndarray:
        """As `Filters.loads`; there are no sources of w."""
        result: np.ndarray = self._of_u(u) + self._of_v(v)
        return result

    def impulses(self, levels: int) -> np.ndarray:
        """As `Filters.impulses`."""
        unit, none = np.zeros((2, levels, 1))
        unit[0] = 1.0
        return np.hstack([self._of_u(unit), self._of_v(unit), none, none])


def _stretched(c: Factor) -> Factor:
    """c with z^2 in place of z."""
    out = [0.0] * (2 * len(c) - 1)
    out[::2] = c
    return tuple(out)


def _displacement(scheme: Scheme) -> list[Factor]:
    """beta + (1/2 + gamma - 2 beta) z + (1/2 + beta - gamma) z^2, in real factors if possible."""
    beta, gamma = scheme.beta, scheme.gamma
    c0, c1, c2 = beta, 0.5 + gamma - 2.0 * beta, 0.5 + beta - gamma
    if c0 == 0.0:
        return [(0.0, 1.0), (c1, c2)]
    square = c1 * c1 - 4.0 * c0 * c2
    if square < -ROUNDING * c1 * c1:
        return [(c0, c1, c2)]
    root = np.sqrt(max(square, 0.0))
    return [(c0, (c1 + root) / 2.0), (1.0, (c1 - root) / (2.0 * c0))]


def responses_to_state(scheme: Scheme, h: float, levels: int, double: bool) -> np.ndarray:
    """u, v, a of steps after a unit in u, v, w, a at a start level, with w = 0 after it, (A11).

    Returns (units, 3, levels + 1) array, by unit, component and level. Units: u, v, w, a at level
        0; with double steps, which begin two levels before their end, the same at level -1 too.
    """
    if double:
        chain = responses_to_state(scheme, 2.0 * h, (levels + 1) // 2, False)
        out = np.zeros((2, 4, 3, levels + 1))
        out[0, ..., ::2] = chain[..., : levels // 2 + 1]
        out[1, ..., 1::2] = chain[..., 1 : (levels + 1) // 2 + 1]
        return out.reshape(8, 3, levels + 1)
    step = scheme.constants(h)
    u0, v0, w0, a0 = np.eye(4)[..., None]
    first = step.a_a * a0 + step.a_w * w0  # (9)
    a = np.hstack([a0, first * step.a_a ** np.arange(levels)])
    w = np.hstack([w0, np.zeros((4, levels))])
    of_v = step.v_a * a + step.v_w * w  # (6)
    v = np.cumsum(np.hstack([v0, of_v[:, :-1]]), axis=1)
    of_u = h * v + step.u_a * a + step.u_w * w  # (5)
    u = np.cumsum(np.hstack([u0, of_u[:, :-1]]), axis=1)
    return np.stack([u, v, a], axis=1)
