"""docs/method/contact.md once more in plain NumPy: equal steps, dense matrices, rows enumerated.

Independent of the program in every stage: the coupled step is one linear system in all
accelerations and multipliers, W comes from its solutions, and complementarity is solved by trying
all sets of rows.
"""

from itertools import product

import numpy as np


def dense(A, n):
    return np.zeros((n, n)) if A is None else np.diag(A) if A.ndim == 1 else A


class Step:
    """The step of all subdomains together, of length h: linear in loads and impulses."""

    def __init__(self, subdomains, L, N, h):
        self.h, self.L, self.N = h, L, N  # lists of (p, n_i) and (q, n_i)
        self.s = subdomains
        self.M = [dense(s.M, s.n) for s in subdomains]
        self.C = [dense(s.C, s.n) for s in subdomains]
        self.K = [dense(s.K, s.n) for s in subdomains]
        self.al = [s.scheme.coefficients(h) for s in subdomains]
        n, p = sum(s.n for s in subdomains), L[0].shape[0]
        self.ends = np.cumsum([s.n for s in subdomains])[:-1]
        # [Mbar -L^T; al2 L 0] [w; Lam] = [r; g - sum L vt]
        A = np.zeros((n + p, n + p))
        at = 0
        for M, C, K, (al1, al2), Li, s in zip(self.M, self.C, self.K, self.al, L, subdomains):
            own = slice(at, at + s.n)
            A[own, own] = M + al2 * C + (0.0 if s.scheme.explicit else al1 * K)
            A[own, n:] = -Li.T
            A[n:, own] = al2 * Li
            at += s.n
        self.inverse = np.linalg.inv(A)

    def solve(self, ut, vt, F, P):
        """u1, v1, w1 and Lam under impulses P: (U2) and (U3)."""
        J = [np.linalg.solve(M, N.T @ P) for M, N in zip(self.M, self.N)]
        ut = [u + 0.5 * self.h * j for u, j in zip(ut, J)]
        vt = [v + j for v, j in zip(vt, J)]
        r = [f - C @ v - K @ u for f, C, K, u, v in zip(F, self.C, self.K, ut, vt)]
        jump = -sum(L @ v for L, v in zip(self.L, vt))
        x = self.inverse @ np.concatenate([*r, jump])
        p = self.L[0].shape[0]
        w = np.split(x[: x.size - p], self.ends)
        u = [a + al[0] * b for a, al, b in zip(ut, self.al, w)]
        v = [a + al[1] * b for a, al, b in zip(vt, self.al, w)]
        return u, v, w, x[x.size - p :]

    def rows(self, x):
        return sum(N @ own for N, own in zip(self.N, x))


def predictors(s, h, u, v, w, a):
    am, af, beta, gamma = s.scheme.am, s.scheme.af, s.scheme.beta, s.scheme.gamma
    d = 1.0 - am
    ut = u + h * v + h**2 * (0.5 - beta / d) * a + h**2 * beta * af / d * w
    return ut, v + h * (1.0 - gamma / d) * a + h * gamma * af / d * w


def complementarity(W, b):
    """P >= 0, W P + b >= 0, P . (W P + b) = 0: the set of rows with the smallest violation."""
    best = None
    for pushes in product([False, True], repeat=b.size):
        F = np.array(pushes, dtype=bool)
        P = np.zeros(b.size)
        P[F] = np.linalg.solve(W[np.ix_(F, F)], -b[F]) if F.any() else P[F]
        worst = min(np.min(P, initial=0.0), np.min((W @ P + b)[~F], initial=0.0))
        if best is None or worst > best[0]:
            best = worst, P
    return best[1]


def violation(state, mu, P, y):
    """Of (U5) and (U7) at a contact in this state, P and y in the normal and the tangent."""
    if state == "open":
        return -y[0]
    if state == "stick":
        return max(-P[0], abs(P[1]) - mu * P[0])
    return max(-P[0], y[1] * state)


def on_cones(W, b, mu):
    """Impulses (2 q) in q normals and their tangents, (U5) and (U7): of all combinations of states,
    the one with the smallest violation. A state that slides is the sign of its P_t."""
    q, best = mu.size, None
    for states in product(["open", "stick", -1.0, 1.0], repeat=q):
        A, r = np.eye(2 * q), np.zeros(2 * q)
        for k, state in enumerate(states):
            if state == "open":
                continue
            A[k], r[k] = W[k], -b[k]
            if state == "stick":
                A[q + k], r[q + k] = W[q + k], -b[q + k]
            else:
                A[q + k, k] = -state * mu[k]
        P = np.linalg.solve(A, r)
        y = W @ P + b
        worst = max(violation(x, mu[k], P[k::q], y[k::q]) for k, x in enumerate(states))
        if best is None or worst < best[0]:
            best = worst, P
    return best[1]


def with_friction(W, b, closed, mu, static, slides, y0):
    """(U12): contacts that reach the static friction go on with the kinetic one, and those of which
    the sliding turns, y0 before the step, are tried once with the static one."""
    P, own = np.zeros(b.size), np.where(slides, mu, static)
    rows, may_turn = np.concatenate([closed, closed]), slides & closed & (static > mu)
    while closed.any():
        P[rows] = on_cones(W[np.ix_(rows, rows)], b[rows], own[closed])
        limit = own * P[: mu.size]
        begins = closed & (own > mu) & (limit > 0.0) & (abs(P[mu.size :]) >= (1 - 1e-9) * limit)
        own[begins] = mu[begins]
        turns = may_turn & ((W @ P + b)[mu.size :] * y0 < 0.0) & ~begins.any()
        if not (begins.any() or turns.any()):
            break
        own[turns], may_turn[turns] = static[turns], False
    return P


def run(subdomains, L, N, gap, e, h, steps, w0, friction=None):
    """u, v (lists over steps of lists) and P (steps, rows).

    friction: mu and mu_s (q,); N has the tangents of the q contacts below their normals, one each.
    """
    step = Step(subdomains, L, N, h)
    u, v = [s.u0.copy() for s in subdomains], [s.v0.copy() for s in subdomains]
    w, a = [x.copy() for x in w0], [x.copy() for x in w0]
    q, rows = gap.size, N[0].shape[0]
    none = [np.zeros(s.n) for s in subdomains]
    W = np.array([step.rows(step.solve(none, none, none, x)[1]) for x in np.eye(rows)]).T
    path = [(u, v, np.zeros(rows))]
    for _ in range(steps):
        pairs = [predictors(s, h, *x) for s, x in zip(subdomains, zip(u, v, w, a))]
        ut, vt = [x for x, _ in pairs], [x for _, x in pairs]
        F = [np.zeros(s.n) if s.force is None else s.force for s in subdomains]
        y0, last = step.rows(v), path[-1][2]
        uf, vf, _, _ = step.solve(ut, vt, F, np.zeros(rows))
        closed = gap + step.rows(uf)[:q] <= 0.0  # (U5)
        b, P = step.rows(vf), np.zeros(rows)
        b[:q] += np.where(y0[:q] > 0.0, 1.0, e) * y0[:q]
        if friction is not None:
            limit = friction[0] * last[:q]
            is_on = abs(abs(last[q:]) - limit) <= 1e-9 * limit
            slides = is_on & (abs(y0[q:]) > 1e-9 * np.diag(W)[q:] * last[:q])
            P = with_friction(W, b, closed, *friction, slides, y0[q:])
        elif closed.any():
            P[closed] = complementarity(W[np.ix_(closed, closed)], b[closed])
        u, v, w1, _ = step.solve(ut, vt, F, P)
        a = [
            ((1.0 - s.scheme.af) * new + s.scheme.af * old - s.scheme.am * b) / (1.0 - s.scheme.am)
            for s, new, old, b in zip(subdomains, w1, w, a)
        ]
        w = w1
        path.append((u, v, P))
    return path
