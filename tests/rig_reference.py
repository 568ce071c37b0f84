"""The benchmark of 2020 once more, in NumPy: structure, plant and compensation, step by step.

Several tests at a time, an array (tests, ...) each. Nothing here is of the package; compensators
are transfer functions, discretized by scipy, where the package has modal forms.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, expm
from scipy.signal import butter, cont2discrete, lfilter, ss2tf, tf2ss

RATE = 4096.0
H = 1.0 / RATE
NOISE, FORCE_NOISE = 16.0e-6, 2.18  # sqrt(power x rate) of the published powers
K = np.array(
    [
        [26054883.879603837, -23133938.877108198, 5937035.463339146],
        [-23133938.877108198, 32560774.186380334, -14419970.777236981],
        [5937035.463339146, -14419970.777236985, 9267275.506224312],
    ]
)
K = 0.5 * (K + K.T)
CASES = {1: (1000.0, 0.05), 2: (1100.0, 0.04), 3: (1300.0, 0.03), 4: (1000.0, 0.03)}
MASS, STIFFNESS, RATIO = 29.13, 1.19e6, 0.0097
DRAWN = np.random.default_rng(20).standard_normal((20, 4)) * [5e4, 3.3, 3.3e3, 1.3]


def structure(case):
    """M, C, K of the whole structure."""
    m, zeta = CASES[case]
    w2, phi = eigh(K / m)
    C = m * phi @ np.diag(2.0 * zeta * np.sqrt(w2)) @ phi.T
    return m * np.eye(3), C, K


@dataclass(frozen=True)
class Plant:
    """Of the transfer system (Y13), with differences to the nominal one."""

    stiffness: float = STIFFNESS
    b1: float = 425.0
    b2: float = 9.9976e4
    leakage: float = 3.3
    gain: float = 1.0261
    mass: float = MASS

    @property
    def damping(self):
        return 2.0 * RATIO * np.sqrt(self.stiffness * self.mass)

    @property
    def matrices(self):
        """A, B, displacement, force"""
        m, c, k = self.mass, self.damping, self.stiffness
        A = np.array(
            [
                [0, 1, 0, 0, 0],
                [-k / m, -c / m, 1 / m, 0, 0],
                [0, -4.2297e6, -self.leakage, 1, 0],
                [0, 0, 0, 0, 1],
                [-2.1283e13, 0, 0, -self.b2, -self.b1],
            ]
        )
        return A, np.array([0, 0, 0, 0, self.gain * 2.1283e13]), np.eye(5)[0], np.eye(5)[2]

    @property
    def inverse(self):
        """Coefficients of D/N (R2), the highest first."""
        m, c, k = self.mass, self.damping, self.stiffness
        valve = np.poly1d([1.0, self.b1, self.b2])
        chamber = np.poly1d([m, c, k]) * np.poly1d([1.0, self.leakage])
        D = valve * (chamber + np.poly1d([4.2297e6, 0.0])) + 2.1283e13
        return D.coeffs / (self.gain * 2.1283e13)


def perturbed(row):
    k, b1, b2, a3 = DRAWN[row]
    return Plant(STIFFNESS + k, 425.0 + b1, 9.9976e4 + b2, 3.3 + a3)


def ground(record, dt, seconds, rest=5.0):
    """0.4 times a record after a rest, linear between its points, at the rate."""
    t = np.arange(round(seconds * RATE) + 1) * H
    at = rest + dt * np.arange(len(record))
    return 0.4 * np.interp(t, at, record, left=0.0, right=0.0)


def response(case, a):
    """Displacements (k, 3) of the whole structure, exact for a ground motion linear in steps."""
    m, zeta = CASES[case]
    w2, phi = eigh(K / m)
    u = np.zeros((len(a), 3))
    for w, shape in zip(np.sqrt(w2), phi.T):
        mode = tf2ss([-shape.sum()], [1.0, 2.0 * zeta * w, w**2])
        discrete = ss2tf(*cont2discrete(mode, H, "foh")[:4])
        u += np.outer(lfilter(discrete[0][0], discrete[1], a), shape)
    return u


# ---- compensation --------------------------------------------------------------------------------


def bilinear(numerator, denominator):
    """A, B, C, D of a transfer function by the trapezoidal rule, in a time of milliseconds."""
    scaled = [
        np.trim_zeros(np.asarray(p) * 1e3 ** np.arange(len(p) - 1, -1, -1), "f")
        for p in (numerator, denominator)
    ]
    system = tf2ss(*scaled)
    return cont2discrete(system, 1e3 * H, "bilinear")[:4]


def low_pass(order, frequency):
    """The denominator, 1 at s = 0, the highest power first."""
    poles = np.roots(butter(order, 2.0 * np.pi * frequency, analog=True)[1])
    return np.poly(poles).real / np.poly(poles)[-1].real


class Filter:
    """A bilinear filter for an input of each test."""

    def __init__(self, system, tests, rest=None):
        self.A, B, C, D = system
        self.B, self.C, self.D = B[:, 0], C[0], D[0, 0]
        self.z = np.zeros((tests, len(self.B)))
        if rest is not None:  # under a constant input
            steady = np.linalg.solve(np.eye(len(self.B)) - self.A, self.B)
            self.z = np.outer(rest, steady)

    def __call__(self, u):
        y = self.z @ self.C + self.D * u
        self.z = self.z @ self.A.T + np.outer(u, self.B)
        return y


class ModelInverse:
    """(Y14) and (Y15) of the nominal plant."""

    def __init__(self, tests, feedback=0.0):
        D, W = Plant().inverse, low_pass(5, 100.0)
        self.l1, self.l2 = W[-2], W[-3]
        self.forward = Filter(bilinear(D, W), tests, rest=np.zeros(tests))
        self.integral = None
        if feedback:
            Q = low_pass(5, 60.0)
            system = bilinear(2.0 * np.pi * feedback * D, np.append(Q, 0.0))
            self.integral = Filter(system, tests)

    def __call__(self, d, v, a, error):
        c = self.forward(d + self.l1 * v + self.l2 * a)
        return c if self.integral is None else c + self.integral(error)


# ---- the loop ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Loop:
    """u (k, tests, 3), and (k, tests): what was sent, displacement and force of the plant."""

    u: np.ndarray
    sent: np.ndarray
    x: np.ndarray
    f: np.ndarray


def run(cases, plants, a, compensation):
    """Tests side by side: cases and plants of each, all at rest at first; no noise."""
    tests, steps = len(cases), len(a)
    whole = [structure(case) for case in cases]
    M, C, Kn = (np.array([one[i] for one in whole]) for i in range(3))
    load = M @ np.ones(3)  # the whole mass: the specimen is not shaken
    for i, plant in enumerate(plants):
        M[i, 0, 0] -= plant.mass
        C[i, 0, 0] -= plant.damping
        Kn[i, 0, 0] -= plant.stiffness
    S = np.linalg.inv(M + 0.5 * H * C)
    phi, G0, G1 = _held(plants)
    u, v, w = (np.zeros((tests, 3)) for _ in range(3))
    last_w, z, c, error = w, np.zeros((tests, 5)), np.zeros(tests), np.zeros(tests)
    out = Loop(np.zeros((steps, tests, 3)), *(np.zeros((steps, tests)) for _ in range(3)))
    for k in range(1, steps):
        change = w - last_w
        rate, acceleration = v + H * w + 0.5 * H * change, w + change
        u = u + H * v + 0.5 * H**2 * w
        sent = compensation(u[:, 0], rate[:, 0], acceleration[:, 0], error)
        z = (phi @ z[:, :, None])[:, :, 0] + G0 * c[:, None] + G1 * sent[:, None]
        x, f = z[:, 0], z[:, 2]
        r = -load * a[k] - (C @ (v + 0.5 * H * w)[:, :, None] + Kn @ u[:, :, None])[:, :, 0]
        r[:, 0] -= f
        last_w, w = w, (S @ r[:, :, None])[:, :, 0]
        v = v + 0.5 * H * (last_w + w)
        c, error = sent, u[:, 0] - x
        out.u[k], out.sent[k], out.x[k], out.f[k] = u, sent, x, f
    return out


def _held(plants):
    """Phi, and the columns of the last command and of this one, of each plant."""
    parts = []
    for plant in plants:
        A, B, _, _ = plant.matrices
        E = np.zeros((7, 7))
        E[:5, :5], E[:5, 5], E[5, 6] = A, B, RATE
        E = expm(H * E)[:5]
        parts.append((E[:, :5], E[:, 5] - E[:, 6], E[:, 6]))
    return [np.array(x) for x in zip(*parts)]
