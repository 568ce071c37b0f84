"""Random problems and a checksum of each result: are two versions bitwise identical?

    python tests/bitwise.py 1000 > before.txt      # with one version of the package installed
    python tests/bitwise.py 1000 > after.txt       # with the other
    diff before.txt after.txt

A line is the seed, what was drawn, and a SHA-256 of every array, error and call of the user's
functions. Only what users may call is called, so one script serves both versions. Not a test: it
shows that two versions differ, not which one is right. `1 --first SEED --detail` prints a checksum
for each array of one problem, to find the first that differs. One problem in three is repeated with
another number of threads, and marked if that makes a difference.
"""

import argparse
import ctypes
import hashlib
import tempfile
import warnings
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy import LowLevelCallable

import pmalpha as pm

DOUBLES = ctypes.POINTER(ctypes.c_double)
HEAD = (ctypes.c_int, ctypes.c_double, ctypes.c_ssize_t)
FORCE = ctypes.CFUNCTYPE(*HEAD, DOUBLES, ctypes.c_void_p)
RESTORING = ctypes.CFUNCTYPE(*HEAD, DOUBLES, DOUBLES, DOUBLES, ctypes.c_void_p)
DT = 0.05
SIZES = ["small", "medium", "large", "long"]
IMPLICIT = {
    **{f"alpha{rho}": pm.GeneralizedAlpha(rho) for rho in (0.0, 0.3, 0.5, 0.8, 1.0)},
    "trapezoidal": pm.Newmark(),
    "newmark": pm.Newmark(beta=0.3, gamma=0.6),
    "hht": pm.HHT(0.2),
    "wbz": pm.WBZ(0.15),
}
EXPLICIT = {
    **{f"explicit{rho}": pm.GeneralizedAlpha(rho, explicit=True) for rho in (0.0, 0.5, 0.9, 1.0)},
    "central": pm.CentralDifference(),
}
DENSE = [np.asarray, np.asfortranarray]
SPARSE = [sp.csr_array, sp.csc_matrix, sp.coo_array, sp.dia_array]


# ---- functions of the user's -------------------------------------------------------------------


class Broken(Exception):
    """Raised by a load or a restoring force at a chosen call."""


class Interrupt(KeyboardInterrupt):
    """Ctrl-C while a function of the user's is evaluated."""


class Function:
    """A function of time, or of u, v and time, that keeps a checksum of its arguments."""

    def __init__(self, function):
        self.function, self.fails_in, self.error = function, None, Broken
        self.seen = hashlib.sha256()

    def fails(self, *args):
        for x in args:
            self.seen.update(np.asarray(x, dtype=float).tobytes())
        if self.fails_in is None:
            return False
        self.fails_in -= 1
        return self.fails_in < 0

    def __call__(self, *args):
        if self.fails(*args):
            raise self.error
        return self.function(*args)

    def compiled_force(self):
        def force(t, n, f, user):
            if self.fails(t):
                return 7
            np.ctypeslib.as_array(f, (n,))[:] = self.function(t)
            return 0

        return LowLevelCallable(FORCE(force))

    def compiled_restoring(self):
        def restoring(t, n, u, v, r, user):
            u, v, r = (np.ctypeslib.as_array(x, (n,)) for x in (u, v, r))
            if self.fails(u, v, t):
                return 8
            r[:] = self.function(u, v, t)
            return 0

        return LowLevelCallable(RESTORING(restoring))


# ---- what is drawn: one subdomain --------------------------------------------------------------


# Estimated from what a run recorded; says nothing about the numbers of the run.
JUDGED = {"AccuracyWarning"}


def chance(rng, probability):
    return bool(rng.random() < probability)


def one_of(rng, items):
    return items[int(rng.integers(len(items)))]


@dataclass
class Member:
    """A subdomain before it is made; `words` describe it."""

    M: object
    K: object
    C: object
    scheme: pm.Scheme
    words: list
    face: tuple = ()  # dofs at its left and right end, of a plate or a solid
    substeps: int = 1
    double: bool | None = None
    lagged: bool = False
    massless: object = None  # (n,) bool
    force: str = "none"
    restoring: str = "none"
    K_r: object = None
    D_r: object = None
    u0: object = None
    v0: object = None

    @property
    def n(self):
        return self.K.shape[0]


def semidefinite(rng, n):
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.5)
    return A @ A.T / n


def path(n):
    diagonals = [-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)]
    return sp.csr_array(sp.diags_array(diagonals, offsets=[-1, 0, 1]))


def small_matrices(rng):
    n = int(rng.integers(1, 9))
    M = np.diag(rng.uniform(1.0, 3.0, n))
    if chance(rng, 0.4):
        M = M + 0.3 * semidefinite(rng, n)
    K = 20.0 * semidefinite(rng, n) + np.eye(n)
    if chance(rng, 0.15):
        K = np.diag(rng.uniform(1.0, 40.0, n))
    form = one_of(rng, DENSE + SPARSE)
    if np.count_nonzero(M) == n and chance(rng, 0.5):
        return np.diag(M).copy(), form(K), ["dense" if form in DENSE else "sparse"]
    return form(M), form(K), ["dense" if form in DENSE else "sparse"]


def medium_matrices(rng):
    n = int(rng.integers(20, 300))
    K, word = path(n), "chain"
    if chance(rng, 0.4):
        one = path(int(rng.integers(6, 14)))
        side, word = sp.eye_array(one.shape[0]), "grid"
        K, n = sp.csr_array(sp.kron(one, side) + sp.kron(side, one)), one.shape[0] ** 2
    K = sp.csr_array(10.0 * K + 0.1 * sp.eye_array(n))
    mass = rng.uniform(1.0, 2.0, n)
    if chance(rng, 0.3):
        return sp.csr_array(sp.diags_array(mass + 1.0) - 0.1 * path(n)), K, [word]
    return mass, K, [word]


def large_structure(rng, shape, at):
    """A plate or a solid that begins at x = `at`, and its two faces to tie it by."""
    kind, length, *rest = shape
    material = dict(E=4.0, nu=0.3, rho=1.0, mass=one_of(rng, ["lumped", "consistent"]))
    make = pm.structures.plate if kind == "plate" else pm.structures.solid
    made = make(length, *rest, 1.0, origin=(float(at), *[0.0] * len(rest)), **material)
    x = made.points[:, 0]
    return made, tuple(made.dofs(np.flatnonzero(np.isclose(x, end))) for end in (at, at + length))


def large_matrices(rng, shape, at):
    made, faces = large_structure(rng, shape, at)
    floor = 0.01 * sp.eye_array(made.n)
    # a lumped mass is 1-D in one version and a sparse diagonal in another
    full = made.M.ndim == 2 and made.M.nnz > made.n
    mass = made.M if full or made.M.ndim == 1 else made.M.diagonal()
    return mass, sp.csr_array(made.K + floor), [f"{shape[0]}{made.n}"], faces


def long_matrices(rng, n):
    return rng.uniform(1.0, 2.0, n), path(n), [f"long{n}"]


def draw_matrices(rng, size, first, shape, at):
    """M, K, words, faces."""
    if size == "large":
        return large_matrices(rng, shape, at)
    if isinstance(size, int) and first:
        return *long_matrices(rng, size), ()
    if size == "medium" and chance(rng, 0.7):
        return *medium_matrices(rng), ()
    return *small_matrices(rng), ()


def draw_scheme(rng, explicit):
    name = one_of(rng, sorted(EXPLICIT if explicit else IMPLICIT))
    return (EXPLICIT if explicit else IMPLICIT)[name], name


def proportional(M, K, a, b):
    M, K = (sp.diags_array(A) if A.ndim == 1 else A for A in (M, K))
    whole = a * M + b * K
    return np.asarray(whole) if not sp.issparse(whole) else sp.csr_array(whole)


def draw_member(rng, size, first, shape=None, at=0):
    M, K, words, faces = draw_matrices(rng, size, first, shape, at)
    explicit = chance(rng, 0.4) or (isinstance(size, int) and first)
    scheme, name = draw_scheme(rng, explicit)
    part = Member(M, K, None, scheme, [name, *words], faces, massless=np.zeros(K.shape[0], bool))
    if isinstance(size, int) and first:
        part.C = None if chance(rng, 0.5) else np.full(part.n, 0.1)
    elif chance(rng, 0.6):
        part.C = proportional(M, K, 0.2, 0.003)
    if part.C is not None:
        part.words.append("damped")
    if not explicit and scheme.radius_at_infinity() < 0.9 and words[0] == "dense":
        draw_massless(rng, part)
    if part.C is not None and not part.massless.any() and not isinstance(size, int):
        part.lagged = chance(rng, 0.4)
        part.words += ["lagged"] * part.lagged
    part.force = one_of(rng, FORCES)
    if not (isinstance(size, int) and first):
        draw_restoring(rng, part)
    part.words += [f"f:{part.force}"] * (part.force != "none")
    return part


def draw_massless(rng, part):
    if part.M.ndim == 1 or not chance(rng, 0.4):
        return
    i = int(rng.integers(part.n))
    part.M[i, :] = part.M[:, i] = 0.0
    part.massless[i] = True
    part.words.append("massless")
    if part.C is not None:
        part.C = proportional(part.M, part.K, 0.2, 0.003)


# ---- loads and restoring forces -----------------------------------------------------------------

FORCES = ["none", "constant", "shaped", "sampled", "base", "called", "compiled"]


def make_force(part, kind, rng, functions, huge=False):
    """A load of this kind; one that is a function is added to `functions`."""
    direction = np.where(part.massless, 0.0, rng.normal(size=part.n))
    samples = rng.normal(size=9)
    if huge:
        return pm.SampledForce(np.where(np.arange(40) < 5, 0.0, 1e300), 0.08, shape=direction)
    if kind == "constant":
        return direction
    if kind == "shaped":
        two = np.column_stack([direction, direction[::-1] * ~part.massless])
        return pm.SampledForce(samples[:8].reshape(4, 2), 0.07, shape=two)
    if kind == "sampled":
        return pm.SampledForce(samples[:, None] * direction, 0.07)
    if kind == "base":
        return pm.BaseAcceleration(samples, 0.06, direction, part.M)
    if kind in ("called", "compiled"):
        functions.append(Function(lambda t: direction * np.cos(3.0 * t)))
        return functions[-1] if kind == "called" else functions[-1].compiled_force()
    return None


def draw_restoring(rng, part):
    if not chance(rng, 0.4):
        return
    part.restoring = one_of(rng, ["called", "compiled", "springs", "springs"])
    part.words.append(f"r:{part.restoring}")
    estimate = np.where(part.massless, 0.0, 0.7)
    if chance(rng, 0.5):
        part.K_r = np.diag(estimate) if part.n < 50 else sp.diags_array(estimate)
        part.words.append("K_r")
    if chance(rng, 0.5):
        part.D_r = 0.1 * estimate
        part.words.append("D_r")


def make_springs(part, rng):
    """Springs of all four laws, some to the ground."""
    dofs = np.flatnonzero(~part.massless)

    def some():
        first = rng.choice(dofs, int(rng.integers(1, 5)))
        second = rng.choice(np.append(dofs, -1), first.size)
        return np.column_stack([first, np.where(second == first, -1, second)])

    laws = [
        lambda: pm.CubicSpring(some(), 1.0, 5.0),
        lambda: pm.Gap(some(), 8.0, 0.1),
        lambda: pm.Bilinear(some(), 4.0, 0.2, 0.1),
        lambda: pm.BoucWen(some(), 3.0, 0.3, 0.05, n=float(rng.choice([1.0, 1.5, 2.0]))),
    ]
    chosen = rng.permutation(4)[: int(rng.integers(1, 5))]
    return [laws[k]() for k in chosen]


def make_restoring(part, rng, functions):
    if part.restoring == "none":
        return None
    if part.restoring == "springs":
        return make_springs(part, rng)
    c = np.where(part.massless, 0.0, 1.0 + 0.1 * np.arange(part.n) / part.n)
    functions.append(Function(lambda u, v, t: c * (u / (1.0 + u * u) + 0.1 * v + 0.2 * np.sin(t))))
    return functions[-1] if part.restoring == "called" else functions[-1].compiled_restoring()


# ---- the interface ------------------------------------------------------------------------------


def draw_rows(rng, parts):
    """Independent rows (kind, {member: (dofs, values)}): ties, and constraints of up to three."""
    total = sum(part.n for part in parts)
    p = int(rng.integers(1, 1 + min(6, total - 1)))
    while True:
        rows = [draw_row(rng, parts) for _ in range(p)]
        L = np.vstack([np.concatenate(whole_row(row, parts)) for _, row in rows])
        touched = np.flatnonzero(L.any(axis=0))
        if np.linalg.matrix_rank(L[:, touched], tol=1e-3) == p:
            return rows


def draw_row(rng, parts):
    if len(parts) > 1 and chance(rng, 0.6):
        i, j = (int(k) for k in rng.choice(len(parts), 2, replace=False))
        ends = (int(rng.integers(parts[k].n)) for k in (i, j))
        return "tie", {k: ([dof], [s]) for k, dof, s in zip((i, j), ends, (1.0, -1.0))}
    chosen = rng.permutation(len(parts))[:3]
    return "general", {
        int(k): ([int(rng.integers(parts[k].n))], [float(rng.normal())]) for k in chosen
    }


def face_rows(parts):
    """Ties of each member's right face to the left one of the next."""
    return [
        ("tie", {i: ([a], [1.0]), i + 1: ([b], [-1.0])})
        for i in range(len(parts) - 1)
        for a, b in zip(parts[i].face[1].tolist(), parts[i + 1].face[0].tolist())
    ]


def whole_row(row, parts):
    out = [np.zeros(part.n) for part in parts]
    for i, (dofs, values) in row.items():
        out[i][dofs] = values
    return out


def draw_initial(rng, problem):
    """(u0, v0) of all members without what would break the constraints; None where it is rest."""
    parts, rows = problem.parts, problem.rows
    if any(part.massless.any() for part in parts) or problem.size == "large":
        return [touched_at_rest(rng, i, part, rows) for i, part in enumerate(parts)]
    touched = sorted({(i, d) for _, row in rows for i, (dofs, _) in row.items() for d in dofs})
    place = {key: k for k, key in enumerate(touched)}
    L = np.zeros((len(rows), len(touched)))
    for k, (_, row) in enumerate(rows):
        for i, (dofs, values) in row.items():
            for d, value in zip(dofs, values):
                L[k, place[i, d]] = value
    states = []
    for _ in range(2):
        x = [rng.normal(size=part.n) for part in parts]
        b = np.array([x[i][d] for i, d in touched])
        b = b - np.linalg.pinv(L) @ (L @ b) if len(rows) else b
        for (i, d), value in zip(touched, b):
            x[i][d] = value if abs(value) > 1e-12 else 0.0  # what rows leave no room for
        states.append(x)
    return list(zip(*states))


def touched_at_rest(rng, i, part, rows):
    if part.massless.any() or part.words[1] in ("dense", "sparse"):
        return None, None
    dofs = [d for _, row in rows if i in row for d in row[i][0]]
    u, v = rng.normal(size=(2, part.n))
    u[dofs] = v[dofs] = 0.0
    return u, v


# ---- a whole problem ----------------------------------------------------------------------------


def draw_size(seed, rng):
    """A problem of 250 000 unknowns twice in a thousand."""
    if seed % 500 == 77:
        return 250_000
    size = SIZES[int(rng.choice(4, p=[0.60, 0.23, 0.15, 0.02]))]
    return int(rng.integers(15_000, 40_000)) if size == "long" else size


def draw_shape(rng):
    """Of plates or solids in a row."""
    if chance(rng, 0.35):
        return ["plate", *one_of(rng, [(2, 40), (4, 40), (10, 30), (30, 30), (25, 8)])]
    short = [(1, 6, 6), (1, 7, 7), (2, 7, 7), (2, 8, 8)]
    return ["solid", *one_of(rng, [*short, (3, 5, 5), (8, 8, 8), (10, 3, 3), (5, 7, 7)])]


class Problem:
    """All that a seed draws; every coupler of it has functions of its own."""

    def __init__(self, seed):
        self.seed = seed
        rng = np.random.default_rng([seed, 20])
        self.size = draw_size(seed, rng)
        self.long = isinstance(self.size, int)
        self.coupling = str(rng.choice(["pm", "pm", "gc", "macro"]))
        self.start = "plain" if chance(rng, 0.3) else "rebased"
        self.threads = int(rng.integers(1, 5))
        self.factorize = "superlu" if chance(rng, 0.2) else None  # of 0.2.0; drawn, not used
        few = self.long or self.size == "large"
        count = int(rng.choice([1, 2, 3, 3, 4])) if few else int(rng.integers(1, 6))
        shape = draw_shape(rng)
        self.parts = [
            draw_member(rng, self.size, i == 0, shape, i * shape[1]) for i in range(count)
        ]
        self.draw_steps(rng)
        self.draw_interface(rng)
        for part, (u0, v0) in zip(self.parts, draw_initial(rng, self)):
            part.u0, part.v0 = u0, v0
        self.unstable = self.draw_instability(rng)
        self.pieces = draw_pieces(rng, self)

    def draw_steps(self, rng):
        """Substeps that are equal, or divide the largest, or under "macro" any; double steps."""
        parts, macro = self.parts, self.coupling == "macro"
        fine = 1 if chance(rng, 0.2) else int(rng.choice([1, 2, 3, 4, 6, 12]))
        allowed = [d for d in range(1, fine + 1) if fine % d == 0]
        if macro:
            allowed = [1, 1, 2, 3, 5, 7]
        for part in parts:
            part.substeps = int(rng.choice(allowed))
            part.double = one_of(rng, [None, None, True, False])
            if macro and part.substeps > 1 and part.double:
                part.double = None
        single = one_of(rng, parts)  # of the finest step, not double
        if not macro:
            single.substeps = fine
        if not macro or all(part.double for part in parts):
            single.double = False
        for part in parts:
            part.words[1] += f"/{part.substeps}" + {None: "", True: "D", False: "S"}[part.double]

    def draw_interface(self, rng):
        self.rows, self.motion = [], "none"
        if self.size == "large":
            self.rows = face_rows(self.parts)
        elif sum(part.n for part in self.parts) > 1 and chance(rng, 0.93):
            self.rows = draw_rows(rng, self.parts)
        if self.rows and self.size != "large":
            self.motion = one_of(rng, ["none", "none", "sampled", "called"])

    def draw_instability(self, rng):
        """None, an explicit member far above its critical step, or a load beyond all numbers."""
        word = one_of(rng, ["none"] * 12 + ["step", "load"])
        explicit = [part for part in self.parts if part.scheme.explicit]
        if self.long or self.size == "large" or (word == "step" and not explicit):
            return "none"
        if word == "step":
            part = one_of(rng, explicit)
            part.K = part.K * 1e20
            part.words.append("unstable")
        elif word == "load":
            part = one_of(rng, self.parts)
            part.words, part.force = [*part.words, "huge"], "huge"
        return word

    @property
    def words(self):
        kinds = Counter(kind for kind, _ in self.rows)
        rows = " ".join(f"{kinds[k]} {k}" for k in sorted(kinds)) or "no rows"
        moved = "" if self.motion == "none" else f", moved {self.motion}"
        options = [self.coupling, self.start, f"threads={self.threads}", f"{self.factorize}"]
        members = " | ".join(" ".join(part.words) for part in self.parts)
        pieces = " ".join(":".join(str(x) for x in piece) for piece in self.pieces)
        return f"{' '.join(options)}; {members}; {rows}{moved}; {pieces}"

    def coupler(self, threads):
        """A coupler and the functions in it."""
        rng = np.random.default_rng([self.seed, 21])
        functions = []
        subdomains = [self.subdomain(i, part, rng, functions) for i, part in enumerate(self.parts)]
        made = pm.Coupler(
            subdomains,
            self.constraints(subdomains, functions),
            dt=DT,
            coupling=self.coupling,
            start=self.start,
            threads=threads,
        )
        return made, functions

    @staticmethod
    def subdomain(i, part, rng, functions):
        return pm.Subdomain(
            part.M,
            part.K,
            part.C,
            scheme=part.scheme,
            substeps=part.substeps,
            double_step=part.double,
            force=make_force(part, part.force, rng, functions, part.force == "huge"),
            restoring=make_restoring(part, rng, functions),
            restoring_stiffness=part.K_r,
            restoring_damping=part.D_r,
            damping="lagged" if part.lagged else "implicit",
            u0=part.u0,
            v0=part.v0,
            name=f"s{i}",
        )

    def constraints(self, subdomains, functions):
        def matrices(rows):
            out = {}
            for k, (_, row) in enumerate(rows):
                for i, (dofs, values) in row.items():
                    data = out.setdefault(i, ([], [], []))
                    for x, more in zip(data, (values, [k] * len(dofs), dofs)):
                        x.extend(more)
            return {
                subdomains[i]: sp.csr_array((v, (r, c)), (len(rows), self.parts[i].n))
                for i, (v, r, c) in out.items()
            }

        held = self.rows if self.motion == "none" else self.rows[:-1]
        made = [
            pm.tie(*(x for i, (dofs, _) in row.items() for x in (subdomains[i], dofs)))
            for kind, row in held
            if kind == "tie"
        ]
        general = [row for row in held if row[0] == "general"]
        made += [pm.Constraint(matrices(general))] if general else []
        if self.motion == "sampled":
            velocity = pm.SampledForce(np.sin(np.arange(12.0)).reshape(-1, 1), 0.06)
            made.append(pm.Constraint(matrices(self.rows[-1:]), velocity=velocity))
        elif self.motion == "called":
            functions.append(Function(lambda t: [np.sin(5.0 * t)]))
            made.append(pm.Constraint(matrices(self.rows[-1:]), velocity=functions[-1]))
        return made


# ---- what is done with it -----------------------------------------------------------------------


def draw_pieces(rng, problem):
    """(verb, numbers): runs, steps, saves, resets and stops, one after the other."""
    long = problem.long or problem.size == "large"
    verbs = ["run", "run", "step", "save", "reset", "stop", "stop"]
    pieces = [("run", int(rng.integers(1, 5 if long else 15)))]
    for _ in range(int(rng.integers(1, 3 if long else 5))):
        verb = one_of(rng, verbs)
        pieces.append((verb, int(rng.integers(1, 4 if long else 10))))
    return pieces


class Play:
    """Does the pieces with couplers of a problem, and keeps a checksum of all that is seen."""

    def __init__(self, problem, threads, folder, detail=None):
        self.problem, self.threads, self.folder = problem, threads, folder
        self.detail, self.digest = detail, hashlib.sha256()
        self.rng = np.random.default_rng([problem.seed, 22])
        self.stopped, self.forced, self.all_functions = False, None, []
        self.done = {verb for verb, _ in problem.pieces}  # for the counts alone

    def see(self, label, value):
        data = value.encode() if isinstance(value, str) else np.ascontiguousarray(value).tobytes()
        shape = "" if isinstance(value, str) else f"{value.dtype}{value.shape}"
        self.digest.update(f"{label} {shape} {len(data)} ".encode() + data)
        if self.detail is not None:
            word = value if isinstance(value, str) else hashlib.sha256(data).hexdigest()[:16]
            self.detail.append(f"{label} {shape} {word}")

    def all(self):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            if self.attempt("make", self.make):
                for i, (verb, steps) in enumerate(self.problem.pieces):
                    self.attempt(f"{i} {verb}", getattr(self, verb), steps)
                    self.attempt(f"{i} present", self.see_present)
        ours = {
            w.category.__name__ for w in caught if w.category.__module__.startswith("pmalpha")
        } - JUDGED
        self.see("warnings", " ".join(sorted(ours)))
        if not self.stopped:  # how many were evaluated before a stop depends on the threads
            for k, function in enumerate(self.all_functions):
                self.see(f"calls {k}", function.seen.hexdigest())
        return self.digest.hexdigest()

    def attempt(self, label, do, *args):
        """Whether it went well; else the error is seen."""
        try:
            do(*args)
            return True
        except (pm.PmalphaError, ValueError, Broken, Interrupt) as error:
            self.stopped = True
            names = ("step", "time", "subdomain", "code", "dof", "inertia")
            told = [f"{x}={getattr(error, x)!r}" for x in names if hasattr(error, x)]
            self.see(f"{label} error", f"{type(error).__name__} {' '.join(told)}")
            self.done.add(f"{label.split()[-1]} {type(error).__name__}")
            return False

    def make(self):
        self.coupler, self.functions = self.problem.coupler(self.threads)
        self.all_functions += self.functions

    def see_present(self):
        self.see("step count", np.array(self.coupler.step_count))
        for i, part in enumerate(self.problem.parts):
            state = self.coupler.state(i)
            for name in "uva":
                self.see(f"state {i}.{name}", getattr(state, name))
            if part.restoring == "springs":
                springs = self.coupler.springs(i)
                self.see(f"springs {i}.d", springs.deformation)
                self.see(f"springs {i}.f", springs.force)
        self.see("multipliers", self.coupler.multipliers)

    def see_history(self, history):
        for i, own in enumerate(history.subdomains):
            for name in ("t", "u", "v", "a", "dofs", "deformation", "force", "springs"):
                value = None if own is None else getattr(own, name)
                self.see(f"{i}.{name}", "none" if value is None else value)
        for name in ("multipliers", "multiplier_times", "velocity_jump", "displacement_jump"):
            self.see(name, getattr(history, name))
        self.see("macro times", history.macro_times)
        energies = ("kinetic", "strain", "dissipated", "external", "interface", "balance")
        for name in energies if history.energy is not None else ():
            self.see(f"energy.{name}", getattr(history.energy, name))

    def record(self):
        """Everything, or some dofs of some subdomains; all that a run takes besides."""
        parts, rng = self.problem.parts, self.rng
        options = {"every": one_of(rng, [None, None, 1, 2, 3])}
        if self.problem.long or chance(rng, 0.3):
            options["record"] = {
                f"s{i}": np.sort(rng.choice(part.n, min(part.n, 3), replace=False))
                for i, part in enumerate(parts)
                if chance(rng, 0.8)
            }
        recorded = options.get("record", [f"s{i}" for i in range(len(parts))])
        with_springs = [
            i for i, part in enumerate(parts) if part.restoring == "springs" and f"s{i}" in recorded
        ]
        if with_springs and chance(rng, 0.7):
            options["record_springs"] = {f"s{i}": None for i in with_springs}
        energy = chance(rng, 0.35)
        # works summed up in an aborted macro step are no matter of this comparison
        return options | {"energy": energy and self.problem.unstable == "none"}

    def run(self, steps, **others):
        options = self.record() | others
        self.done |= {key for key, value in options.items() if value}
        try:
            self.see_history(self.coupler.run(steps=steps, **options))
        except BaseException:
            if self.coupler.last_history is not None:
                self.see_history(self.coupler.last_history)
            raise

    def step(self, steps):
        self.coupler.step(steps)

    def save(self, steps):
        """Goes on in another coupler."""
        path = self.folder / "state.npz"
        self.coupler.save(path)
        self.make()
        self.coupler.step(1)
        if self.forced is not None:
            self.coupler.reset(force=self.forced)
        self.coupler.load(path)
        self.see_present()

    def reset(self, steps):
        """With other initial values, and another load on one subdomain."""
        u0, v0 = ({f"s{i}": x[k] for i, x in enumerate(self.initial())} for k in (0, 1))
        i = int(self.rng.integers(len(self.problem.parts)))
        part, kind = self.problem.parts[i], one_of(self.rng, ["constant", "shaped", "base"])
        self.forced = {f"s{i}": make_force(part, kind, self.rng, [])}
        self.coupler.reset(
            **{
                name: {key: x for key, x in given.items() if x is not None}
                for name, given in (("u0", u0), ("v0", v0), ("force", self.forced))
            }
        )
        self.run(steps)

    def initial(self):
        return draw_initial(self.rng, self.problem)

    def stop(self, steps):
        """A function fails at some evaluation, the run ends there, and goes on."""
        count = int(self.rng.integers(12))
        interrupts = chance(self.rng, 0.3)
        which = self.rng.random()
        if not self.functions:
            self.run(steps)
            return
        function = self.functions[int(which * len(self.functions))]
        function.fails_in, function.error = count, Interrupt if interrupts else Broken
        self.attempt("stopped", lambda: self.run(steps, energy=False))
        function.fails_in = None
        self.see_present()
        self.run(steps)


def line(seed, folder):
    problem = Problem(seed)
    digest = Play(problem, problem.threads, folder).all()
    mark = ""
    if seed % 3 == 0:
        other = 1 if problem.threads > 1 else 3
        if Play(problem, other, folder).all() != digest:
            mark = "  THREADS DIFFER"
    return f"{seed} {problem.words} {digest}{mark}"


# ---- the command --------------------------------------------------------------------------------


def features(seed, folder):
    """What is drawn and done for a seed, as words."""
    problem = Problem(seed)
    play = Play(problem, problem.threads, folder)
    play.all()
    members = {word.split("/")[0] for part in problem.parts for word in part.words}
    doubles = {f"double_step={part.double}" for part in problem.parts}
    steps = {part.substeps for part in problem.parts}
    divide = all(max(steps) % s == 0 for s in steps)
    kind = "equal" if len(steps) == 1 else "dividing" if divide else "coprime"
    options = {problem.coupling, problem.start, f"threads={problem.threads}", f"substeps {kind}"}
    rows = {f"{kind} rows" for kind, _ in problem.rows} | {f"moved {problem.motion}"}
    count = {f"{len(problem.parts)} subdomains"}
    of_size = {
        word.rstrip("0123456789") if word[:2] in ("pl", "so", "lo") else word for word in members
    }
    return of_size | doubles | options | rows | count | play.done


def main():
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("number", type=int, nargs="?", default=100, help="of problems")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--detail", action="store_true", help="a line for each array")
    parser.add_argument("--count", action="store_true", help="only count what the seeds draw")
    options = parser.parse_args()
    seeds, counts = range(options.first, options.first + options.number), Counter()
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            if options.count:
                counts.update(features(seed, Path(folder)))
                continue
            print(line(seed, Path(folder)), flush=True)
            if options.detail:
                problem, seen = Problem(seed), []
                Play(problem, problem.threads, Path(folder), seen).all()
                print(*(f"    {entry}" for entry in seen), sep="\n")
    for word in sorted(counts):
        print(f"{counts[word]:6} {word}")


if __name__ == "__main__":
    main()
