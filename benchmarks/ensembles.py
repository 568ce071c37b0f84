"""Two hundred records on nine dofs: `Coupler.run_each` against a loop of NumPy over all records.

The loop advances all records at once, one column each, by the trapezoidal rule with dense K and C,
and keeps the largest displacements alone. pmalpha records one dof, all dofs, or keeps the
same peaks; and takes the structure in two subdomains, one with ten substeps. The springs of the
storeys are evaluated by both in the same way.
"""

import numpy as np
from timing import in_turn, run

import pmalpha as pm

N, SHARED, DT, SUBSTEPS = 9, 5, 0.005, 10
RECORDS, STEPS = 200, 4000
RULE = pm.Newmark(0.25, 0.5)
STOREYS = [0], [(i, i - 1) for i in range(1, N)]  # the first spring is to the ground
STIFFNESS, YIELD = 4000.0, 12.0


def matrices():
    """Masses, and dense K and C, as static condensation and modal damping leave them."""
    rng = np.random.default_rng(7)
    Q = np.linalg.qr(rng.standard_normal((N, N)))[0]
    omega = 2.0 * np.pi * np.linspace(0.7, 12.0, N)
    return np.ones(N), (Q * omega**2) @ Q.T, (Q * (0.1 * omega)) @ Q.T


def records(count, steps):
    """White noise, smoothed a little; one row for each record."""
    noise = np.random.default_rng(1).standard_normal((count, steps + 1))
    noise[:, 1:] = 0.5 * (noise[:, 1:] + noise[:, :-1])
    return 3.0 * noise


# ---- NumPy -----------------------------------------------------------------------------------


def differences():
    """Deformations of the storeys: B @ u."""
    return np.eye(N) - np.eye(N, k=-1)


class Cubic:
    def __init__(self, count):
        self.k, self.k3 = STIFFNESS, 1e6

    def __call__(self, d):
        return d * (self.k + self.k3 * d * d)

    def springs(self):
        return [pm.CubicSpring(at, self.k, self.k3) for at in STOREYS]


class Bilinear:
    def __init__(self, count):
        self.hard, self.soft = 0.05 * STIFFNESS, 0.95 * STIFFNESS
        self.d_y, self.p = YIELD / STIFFNESS, np.zeros((N, count))

    def __call__(self, d):
        np.minimum(np.maximum(self.p, d - self.d_y), d + self.d_y, out=self.p)
        return self.hard * d + self.soft * (d - self.p)

    def springs(self):
        return [pm.Bilinear(at, STIFFNESS, YIELD, 0.05) for at in STOREYS]


class BoucWen:
    """By the classical Runge-Kutta rule along d, in steps of at most half the yield deformation."""

    def __init__(self, count):
        self.z, self.d = np.zeros((N, count)), np.zeros((N, count))

    def __call__(self, d):
        x = (d - self.d) * (STIFFNESS / YIELD)
        sign, length = np.where(x < 0.0, -1.0, 1.0), abs(x)
        steps = 1.0 + np.floor(2.0 * length)
        h = length / steps
        for done in range(int(steps.max())):
            z = self.z
            a = self.slope(z, sign)
            b = self.slope(z + 0.5 * h * a, sign)
            c = self.slope(z + 0.5 * h * b, sign)
            e = self.slope(z + h * c, sign)
            after = z + h / 6.0 * (a + 2.0 * b + 2.0 * c + e)
            self.z = np.where(done < steps, after, z)
        self.d = d
        return 0.05 * STIFFNESS * d + 0.95 * YIELD * self.z

    @staticmethod
    def slope(z, sign):
        return sign * (1.0 - abs(z) * (0.5 + 0.5 * np.sign(sign * z)))

    def springs(self):
        return [pm.BoucWen(at, STIFFNESS, YIELD, 0.05) for at in STOREYS]


def newmark(M, K, C, excitation, law=None):
    """Largest displacements (N, records); excitation (steps + 1, records), as base acceleration.

    The rows of x are u, v, the excitation, and the forces of springs: one product a step.
    """
    B, h = differences(), DT
    K_law = np.zeros((N, N)) if law is None else STIFFNESS * B.T @ B
    S = np.linalg.inv(np.diag(M) + 0.5 * h * C + 0.25 * h**2 * (K + K_law))
    G = -S @ np.hstack([K, C, M[:, None], *([] if law is None else [B.T])])
    x, (a, step) = np.zeros((G.shape[1], excitation.shape[1])), np.zeros((2, *excitation[:N].shape))
    u, v, ground, forces = x[:N], x[N : 2 * N], x[2 * N], x[2 * N + 1 :]
    a[:], peak = -excitation[0], np.zeros_like(a)
    for row in excitation[1:]:
        np.multiply(v, h, out=step)
        u += step
        np.multiply(a, 0.25 * h**2, out=step)
        u += step
        a *= 0.5 * h
        v += a
        ground[:] = row
        if law is not None:
            forces[:] = law(B @ u)
        np.matmul(G, x, out=a)
        np.multiply(a, 0.25 * h**2, out=step)
        u += step
        np.multiply(a, 0.5 * h, out=step)
        v += step
        np.maximum(peak, np.abs(u, out=step), out=peak)
    return peak


# ---- pmalpha ---------------------------------------------------------------------------------


def whole(M, K, C, restoring=None):
    one = pm.Subdomain(M, K, C=C, scheme=RULE, restoring=restoring, name="frame")
    return pm.Coupler([one], dt=DT, threads=1)


def cut(M, K, C):
    """The same, with half of what acts on five dofs in a subdomain of their own."""
    low = slice(0, SHARED)
    lower = pm.Subdomain(
        0.5 * M[low],
        0.5 * K[low, low],
        C=0.5 * C[low, low],
        scheme=RULE,
        substeps=SUBSTEPS,
        name="lower",
    )
    mass, stiffness, damping = M.copy(), K.copy(), C.copy()
    mass[low] -= 0.5 * M[low]
    stiffness[low, low] -= 0.5 * K[low, low]
    damping[low, low] -= 0.5 * C[low, low]
    upper = pm.Subdomain(mass, stiffness, C=damping, scheme=RULE, name="frame")
    ties = pm.tie(upper, range(SHARED), lower, range(SHARED))
    return pm.Coupler([upper, lower], ties, dt=DT, threads=1, coupling="macro")


def cases_of(excitation, masses):
    """A case for each column; `masses` by subdomain."""
    return [
        {"force": {name: pm.BaseAcceleration(x, np.ones(len(m)), m, dt=DT) for name, m in masses}}
        for x in excitation.T.copy()
    ]


# ---- rows ------------------------------------------------------------------------------------

ONE = {"record": {"frame": [0]}}


def problems(count):
    """Name, what makes the coupler, masses by subdomain, law of the loop, and what is recorded."""
    M, K, C = matrices()
    lower = 0.5 * M[:SHARED]
    upper = M - np.append(lower, np.zeros(N - SHARED))
    frame = [("frame", M)]
    nothing = {"record": {}, "every": STEPS}
    records = {
        "one dof recorded": ONE,
        "peaks of all dofs": {"reduce": "peak"},
        "all dofs recorded": {},
        "nothing recorded": nothing,
    }
    yield "dense K and C", lambda: whole(M, K, C), frame, None, records
    two = [("frame", upper), ("lower", lower)]
    yield "cut in two, ss = 10", lambda: cut(M, K, C), two, None, {"one dof recorded": ONE}
    for name, law in {"CubicSpring": Cubic, "Bilinear": Bilinear, "BoucWen": BoucWen}.items():
        springs = law(count).springs()
        make = lambda springs=springs: whole(M, K, C, springs)  # noqa: E731
        yield name, make, frame, law, {"one dof recorded": ONE}


def rows(quick):
    count, steps = (16, 200) if quick else (RECORDS, STEPS)
    excitation, found = records(count, steps).T.copy(), []
    for name, make, masses, law, recorded in problems(count):
        coupler, cases = make(), cases_of(excitation, masses)
        loop = lambda law=law: newmark(*matrices(), excitation, law and law(count))  # noqa: E731
        calls = [
            lambda o=options, c=coupler, x=cases: c.run_each(x, steps=steps, **o)
            for options in recorded.values()
        ]
        check_peaks(loop(), coupler.run_each(cases, steps=steps, reduce="peak"))
        of_loop, *times = in_turn(loop, *calls, rounds=1 if quick else 9)
        for what, t in zip(recorded, times):
            row = {"problem": name, "what": what, "us a case": 1e6 * t / count}
            row |= {"us a case of the loop": 1e6 * of_loop / count, "over the loop": t / of_loop}
            found.append(row)
    return found


def check_peaks(loop, values):
    """The loop computes the same, but for the error of the cut."""
    peaks = values["frame"].u.T
    limit = 1e-9 if values.multipliers.shape[1] == 0 else 0.05
    assert abs(peaks - loop).max() < limit * loop.max()


if __name__ == "__main__":
    run("ensembles", rows, about=__doc__)
