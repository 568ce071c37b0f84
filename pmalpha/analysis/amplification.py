"""Amplification matrices, spectra, stability limits and errors of linear couplers.

Every figure comes from pushing states through the core that runs, so that what is analysed is
what is used. Equations in docs/method.md.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from .._checks import positive_number, real_array, real_number, vector, whole_number
from ..errors import ConstraintWarning, StabilityWarning
from ..problem.constraints import Constraint
from ..problem.matrices import dense
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from ..run.coupler import Coupler
from ..setup.assembly import Part, core_subdomain
from ..setup.stability import critical_step

__all__ = [
    "AmplificationMatrix",
    "amplification_matrix",
    "critical_step",
    "exact_solution",
    "global_error",
    "local_error",
    "observed_order",
    "period_and_damping",
    "spectral_radius",
    "stability_limit",
    "start_error",
    "zero_stability",
]

# An eigenvalue of modulus 1, alone or double, comes out of an eigenvalue routine this close to it.
STABLE = 1e-6
# Arrays of a node of the core: u, v, w, a, vf, and what springs remember.
NODE_FIELDS = 6
# An eigenvector shows in the multipliers if it moves one of them by more than rounding.
SHOWS = 1e-10

# What an exact solution says at a time: (u, v, w) by name of the subdomain, and Lam.
Instant = tuple[Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]], np.ndarray]


class AmplificationMatrix(np.ndarray):
    """A square array with a name for each row (and column) in `names`."""

    names: tuple[str, ...]

    def __array_finalize__(self, other: Any) -> None:
        same = getattr(other, "shape", None) == self.shape
        self.names = getattr(other, "names", ()) if same else ()

    def __array_wrap__(self, array: np.ndarray, context: Any = None, scalar: bool = False) -> Any:
        """Results of arithmetic are plain: their rows have no names."""
        plain = np.asarray(array)
        return plain[()] if plain.ndim == 0 else plain


def amplification_matrix(coupler: Coupler) -> AmplificationMatrix:
    """G with X_{n+1} = G X_n over one macro step, equation (19).

    The coupler is taken past its start: double steps where they are taken. Loads are left out. The
    coupler itself stays as it is.

    Parameters
    ----------
    coupler : Coupler

    Returns
    -------
    G : (N, N) AmplificationMatrix
        The state X_n, subdomain by subdomain, equation (20):

        - single, at the finest step: u, v, w, a;
        - single and coarser: u, v, w, a and, on its interface dofs, the stored free velocity vf;
        - double: all of these at the own node before t_n, then at t_n.

        Under macro coupling u, v, w, a of all, twice if double, and at last the multipliers Lam.

        ``names`` says which row is what, such as ``"u[2] of tower at n-1"``. For a double-step
        subdomain with substeps, n-1 means the own node before.

    Raises
    ------
    ValueError
        When a subdomain has a restoring force, which no matrix represents.

    Notes
    -----
    Costs one macro step for each of the N states.

    Examples
    --------
    >>> from pmalpha import models
    >>> G = amplification_matrix(models.split_oscillator(10.0, substeps=2).coupler(0.1))
    >>> G.shape, G.names[0]
    ((14, 14), 'u[0] of A at n-1')
    """
    matrix = _propagation(coupler)[0].view(AmplificationMatrix)
    matrix.names = _Layout(coupler).names()
    return matrix


def _propagation(coupler: Coupler) -> tuple[np.ndarray, np.ndarray]:
    """What one macro step makes of the unit states: the next states, (N, N), and Lam, (p, N)."""
    _checked(coupler)._require_linear("amplification_matrix")
    layout = _Layout(coupler)
    G = np.empty((layout.size, layout.size))
    lam = np.empty((coupler._row_place.size, layout.size))
    with coupler._entered(), _state_kept(coupler), _unloaded(coupler):
        for k, unit in enumerate(np.eye(layout.size)):
            layout.write(unit)
            coupler._core.advance(1, None)
            G[:, k] = layout.read()
            lam[:, k] = coupler._core.multipliers[coupler._row_place]
    return G, lam


def _checked(coupler: Any) -> Coupler:
    if not isinstance(coupler, Coupler):
        raise TypeError(f"coupler must be a Coupler, got {coupler!r}")
    return coupler


class _Layout:
    """Where the numbers of each subdomain stand in X."""

    def __init__(self, coupler: Coupler):
        self.coupler = coupler
        self.parts = coupler._parts
        macro = coupler._macro
        self.stored = [
            not macro and (p.double or p.subdomain.substeps < coupler._fine) for p in self.parts
        ]
        self.nodal = sum(
            (2 if p.double else 1) * (4 * p.n + stored * p.nb)
            for p, stored in zip(self.parts, self.stored)
        )
        # of the multipliers "pm" and "gc" remember nothing
        self.conditions = coupler._row_place if macro else np.arange(0)
        self.size = self.nodal + self.conditions.size

    def fields(self) -> Iterator[tuple[Part, int, np.ndarray]]:
        """Subdomain, index in the core's nodes, and places in elimination order, in the order of X.

        The core has the present first, X the node before it.
        """
        for part, stored in zip(self.parts, self.stored):
            interface = np.arange(part.nb) if stored else np.arange(0)
            for first in (NODE_FIELDS, 0) if part.double else (0,):
                for field in range(4):
                    yield part, first + field, part.place
                yield part, first + 4, interface

    def write(self, X: np.ndarray) -> None:
        """Put the whole problem into the state X, past its start."""
        nodes = {part.name: [x * 0.0 for x in part.core.nodes()] for part in self.parts}
        begin = 0
        for part, field, places in self.fields():
            nodes[part.name][field][places] = X[begin : begin + places.size]
            begin += places.size
        for part in self.parts:
            part.core.set_nodes(tuple(nodes[part.name]))
        zero = np.zeros(self.coupler._row_place.size)
        lam = zero.copy()
        lam[self.conditions] = X[self.nodal :]
        self.coupler._core.start(1, lam, zero)

    def read(self) -> np.ndarray:
        nodes = {part.name: part.core.nodes() for part in self.parts}
        numbers = [nodes[p.name][field][places] for p, field, places in self.fields()]
        return np.concatenate([*numbers, self.coupler._core.multipliers[self.conditions]])

    def names(self) -> tuple[str, ...]:
        names = []
        for part, field, places in self.fields():
            symbol = ("u", "v", "w", "a", "vf")[field % NODE_FIELDS]
            when = "n-1" if field >= NODE_FIELDS else "n"
            dofs = np.arange(part.n) if field % NODE_FIELDS < 4 else part.order[part.n - part.nb :]
            names += [f"{symbol}[{d}] of {part.name} at {when}" for d in dofs[: places.size]]
        return (*names, *(f"Lam[{row}]" for row in range(self.conditions.size)))


@contextmanager
def _state_kept(coupler: Coupler) -> Iterator[None]:
    """Afterwards the coupler stands where it stood, to the last bit."""
    coupler._start()
    core = coupler._core
    nodes = [part.core.nodes() for part in coupler._parts]
    step_count, lam, g = core.step_count, core.multipliers, core.prescribed
    try:
        yield
    finally:
        for part, kept in zip(coupler._parts, nodes):
            part.core.set_nodes(kept)
        core.start(step_count, lam, g)


@contextmanager
def _unloaded(coupler: Coupler) -> Iterator[None]:
    """No loads and no prescribed motion meanwhile."""
    for part in coupler._parts:
        part.core.set_load(None)
    for i in range(len(coupler._motions)):
        coupler._core.set_motion(i, None)
    try:
        yield
    finally:
        coupler._load_core()


# ---- spectra and stability ------------------------------------------------------------------


def spectral_radius(G: np.ndarray, drop: Sequence[complex] = (), tol: float = 1e-6) -> float:
    """Largest modulus of the eigenvalues of a matrix, some of them left out by value.

    Parameters
    ----------
    G : (n, n) array
    drop : sequence of numbers
        Eigenvalues within `tol` of one of these are left out: 1, the drift that velocity ties
        leave undetermined, or -1, the two chains of a double-step subdomain.
    tol : float, default 1e-6
        Not below about 1e-8: a defective eigenvalue, such as that of a motion at constant
        velocity, comes out of an eigenvalue routine with the square root of the rounding.

    Returns
    -------
    float
        0 if none is left.

    Raises
    ------
    ValueError
        For a matrix that is not square or holds NaN or infinity.

    Examples
    --------
    >>> from pmalpha import analysis, models
    >>> G = analysis.amplification_matrix(models.split_oscillator(10.0).coupler(0.05))
    >>> radius = analysis.spectral_radius(G)
    >>> abs(radius - 1.0) < 1e-9, analysis.spectral_radius(G, drop=[1.0]) < 1.0
    (True, True)
    """
    G = real_array(G, "G", 2)
    if G.shape[0] != G.shape[1]:
        raise ValueError(f"G must be square, got shape {G.shape}")
    values = np.linalg.eigvals(G)
    far = np.abs(values[:, None] - np.atleast_1d(np.asarray(drop, dtype=complex))) > tol
    return float(np.max(np.abs(values[far.all(axis=1)]), initial=0.0))


def stability_limit(make_coupler: Callable[[float], Coupler], lo: float, hi: float) -> float:
    """The largest stable x of a family of couplers, by bisection.

    A coupler is taken for stable when no eigenvalue of its amplification matrix has a modulus
    above 1 + 1e-6: the eigenvalues 1 and -1 that velocity ties bring along, which may be
    defective, come out of an eigenvalue routine within 1e-7 or so of the unit circle.

    Parameters
    ----------
    make_coupler : callable
        ``make_coupler(x)`` gives the coupler at x, such as a step or a frequency times a step.
    lo, hi : float
        Stable at lo, unstable at hi, lo < hi. Between them stability should be lost once.

    Returns
    -------
    float
        Where stability is lost, to 1e-7 of hi and to what an excess of 1e-6 in the radius means
        for x.

    Raises
    ------
    ValueError
        When the coupler is unstable at lo or stable at hi.

    Examples
    --------
    >>> from pmalpha import analysis, models
    >>> def oscillator(Omega):  # B has circular frequency 1
    ...     return models.split_oscillator(1.0, rho=0.5, stiffness=1.0).coupler(Omega)
    >>> limit = analysis.stability_limit(oscillator, 1.0, 10.0)
    >>> bool(limit >= np.sqrt(12 * 1.5 * 1.5 / 7.75))
    True
    """
    lo, hi = real_number(lo, "lo"), real_number(hi, "hi")
    if not lo < hi:
        raise ValueError(f"lo must be below hi, got {lo!r} and {hi!r}")
    for x, name, wanted in ((lo, "lo", True), (hi, "hi", False)):
        radius = _radius_at(make_coupler, x)
        if (radius <= 1.0 + STABLE) != wanted:
            rule = "stable" if wanted else "unstable"
            raise ValueError(
                f"the coupler must be {rule} at {name}, got spectral radius {radius:.9g} at {x:g}"
            )
    small = 1e-7 * max(abs(lo), abs(hi))
    while hi - lo > small:
        middle = 0.5 * (lo + hi)
        stable = _radius_at(make_coupler, middle) <= 1.0 + STABLE
        lo, hi = (middle, hi) if stable else (lo, middle)
    return lo


def _radius_at(make_coupler: Callable[[float], Coupler], x: float) -> float:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StabilityWarning)  # the question is asked here
        coupler = make_coupler(x)
    return spectral_radius(amplification_matrix(coupler))


def zero_stability(coupler: Coupler) -> float:
    """Spectral radius of the loop Lam -> vf -> Lam as dt -> 0; below 1 the method is zero-stable.

    As dt -> 0, terms with K dt^2 and C dt vanish against M. What is left of (5) to (18) is the same
    coupler without stiffness and damping, whatever its dt. In it an error of Lam goes through
    (14) and (9) into a and w, through (6) and (13) into the next free velocities, and through (15)
    and (18) into the next Lam. With X the state (20) of this coupler, G its amplification matrix
    and B the map from X to the next Lam::

        X_{n+1} = G X_n,    Lam_{n+1} = B X_n

    The loop consists of those eigenvalues of G that show in Lam: B x != 0 for the eigenvector x.
    Not among them are the common velocity (eigenvalue 1), displacements, inner dofs, and the root
    -am / (1 - am) that recursion (9) has without forces.

    Parameters
    ----------
    coupler : Coupler
        Only masses, schemes, substeps and conditions matter.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        Without conditions there is no loop; with dofs without mass it has no limit.

    Notes
    -----
    Kuebler and Schiehlen 2000; figure 4 of the paper. For "gc" with equal steps and one rho the
    roots are -rho and -(3 rho - 1)/(3 - rho) for any masses.

    Examples
    --------
    >>> from pmalpha import analysis, models
    >>> coupler = models.split_oscillator(10.0, rho=0.5).coupler(0.01, coupling="gc")
    >>> round(analysis.zero_stability(coupler), 9)
    0.5
    """
    masses = _masses_alone(coupler)
    G, B = _propagation(masses)
    acts = np.array([not name.startswith("u") for name in _Layout(masses).names()])
    values, vectors = np.linalg.eig(G[np.ix_(acts, acts)])
    B = B[:, acts] / np.linalg.norm(B[:, acts], axis=1, keepdims=True)
    shows = np.max(np.abs(B @ vectors), axis=0) > SHOWS
    return float(np.max(np.abs(values[shows]), initial=0.0))


def _masses_alone(coupler: Coupler) -> Coupler:
    """The same coupler without stiffness, damping and loads; dt = 1."""
    if not _checked(coupler)._row_place.size:
        raise ValueError("coupler must have conditions, got none")
    for part in coupler._parts:
        if part.subdomain.massless.size:
            raise ValueError(
                f"coupler must have mass everywhere, got dofs without in {part.name!r}"
            )
    subdomains = [
        Subdomain(
            s.M,
            np.zeros(s.n),
            scheme=s.scheme,
            substeps=s.substeps,
            double_step=part.double,
            name=part.name,
        )
        for part, (_, s) in zip(coupler._parts, coupler._keys)
    ]
    matrices = {s: L for s, L in zip(subdomains, coupler._matrices) if L.nnz}
    return Coupler(subdomains, Constraint(matrices), dt=1.0)


def period_and_damping(
    scheme: Scheme, Omega: ArrayLike, xi: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Period elongation and algorithmic damping ratio of a scheme, on a single-dof oscillator.

    Parameters
    ----------
    scheme : Scheme
    Omega : array_like
        omega h, circular frequency of the undamped oscillator times step; positive.
    xi : float, default 0
        Viscous damping ratio of the oscillator, in [0, 1).

    Returns
    -------
    elongation : ndarray, the shape of Omega
        (T_h - T) / T, with T the period of the damped oscillator and T_h that of the scheme's
        solution.
    damping : ndarray, the shape of Omega
        What the scheme adds to the ratio of decay rate and frequency: -ln|lam| / arg(lam) minus its
        exact value xi / sqrt(1 - xi^2).

    NaN where the scheme's solution does not oscillate with a period: beyond the bifurcation, where
    a real root takes the lead.

    Raises
    ------
    TypeError, ValueError
        For a scheme that is none, Omega not positive, xi outside [0, 1).

    Notes
    -----
    lam is the complex eigenvalue of one step in the upper half-plane, exactly
    exp(-xi Omega + i Omega sqrt(1 - xi^2)). Hughes, The Finite Element Method, section 9.3.

    Examples
    --------
    The trapezoidal rule has no damping, and a period too long by Omega^2 / 12:

    >>> from pmalpha import analysis
    >>> elongation, damping = analysis.period_and_damping(Newmark(), [0.01, 0.02])
    >>> (elongation / np.array([0.01, 0.02]) ** 2 * 12).round(3).tolist()
    [1.0, 1.0]
    >>> bool(abs(damping).max() < 1e-12)
    True
    """
    if not isinstance(scheme, Scheme):
        raise TypeError(f"scheme must be a pmalpha scheme, got {scheme!r}")
    Omega = real_array(np.asarray(Omega), "Omega", tuple(range(33)))
    if not np.all(Omega > 0.0):
        raise ValueError(f"Omega must be positive, got {Omega.min()}")
    xi = real_number(xi, "xi", low=0.0)
    if not xi < 1.0:
        raise ValueError(f"xi must be below 1, got {xi!r}")
    steps = [scheme.amplification(x, xi) for x in Omega.ravel()]
    lam = np.array([_oscillating(np.linalg.eigvals(G)) for G in steps]).reshape(Omega.shape)
    exact, angle = np.sqrt(1.0 - xi**2), np.angle(lam)
    return exact * Omega / angle - 1.0, -np.log(np.abs(lam)) / angle - xi / exact


def _oscillating(values: np.ndarray) -> complex:
    """The eigenvalue in the upper half-plane, NaN if there is none or a larger real one."""
    upper = values[np.argmax(values.imag)]
    # an idle root, such as the -1 at rho = 1, is as large but for rounding
    leads = np.abs(upper) > np.max(np.abs(values)) - 1e-6
    return upper if upper.imag > 0.0 and leads else complex(np.nan)


# ---- errors ---------------------------------------------------------------------------------


def observed_order(run: Callable[[float], float], steps: Sequence[float]) -> float:
    """Slope of log(error) over log(dt), by least squares.

    Parameters
    ----------
    run : callable
        ``run(dt)`` gives the error at this step, a positive number.
    steps : sequence of float
        At least two different steps, positive.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        For fewer than two different steps, and for an error that is not positive and finite.

    Notes
    -----
    An error c1 dt^q + c2 dt^(q+1) shows a slope that differs from q by about dt c2 / c1.

    Examples
    --------
    >>> from pmalpha import analysis
    >>> round(analysis.observed_order(lambda dt: 7.0 * dt**2, [0.1, 0.05, 0.025]), 10)
    2.0
    """
    steps = [positive_number(dt, "steps") for dt in steps]
    if len(set(steps)) < 2:
        raise ValueError(f"steps must hold at least two different ones, got {steps}")
    errors = [_positive_error(run(dt), dt) for dt in steps]
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def _positive_error(error: Any, dt: float) -> float:
    error = float(error)
    if not 0.0 < error < np.inf:
        raise ValueError(f"run must return a positive finite error, got {error!r} at dt = {dt:g}")
    return error


def exact_solution(coupler: Coupler) -> Callable[[float], Instant]:
    """The exact motion of the linear problem (1), (2) that a coupler approximates.

    Dense and for small problems: the matrix exponential of the uncut structure at every call.

    Parameters
    ----------
    coupler : Coupler
        Any number of subdomains, without loads or with constant ones. Its initial values are
        those it starts from, also after ``reset(u0=..., v0=...)``.

    Returns
    -------
    exact : callable
        ``exact(t)``, t >= 0, returns a dict with (u, v, w), (n_i,) each, by name of the subdomain,
        and Lam, (p,).

    Raises
    ------
    ValueError
        For loads that change with time, prescribed motion, restoring forces, and a structure whose
        mass matrix is singular.

    Notes
    -----
    With the columns of Z a basis of the null space of L = [L_1 ... L_N], u = u_0 + Z q satisfies
    (2), and Z^T times (1) is the uncut structure::

        Z^T M Z q'' + Z^T C Z q' + Z^T K (u_0 + Z q) = Z^T F

    w = Z q'', and Lam follows from (1): L L^T Lam = L (M w + C v + K u - F).

    Examples
    --------
    >>> from pmalpha import analysis, models
    >>> exact = analysis.exact_solution(models.split_oscillator(10.0).coupler(0.05))
    >>> state, lam = exact(0.25)
    >>> u, v, w = state["B"]
    >>> bool(abs(v[0] + 2 * np.pi) < 1e-12)
    True
    """
    _checked(coupler)._require_linear("exact_solution")
    with coupler._entered():
        return _Exact(coupler)


class _Exact:
    """The uncut structure in the coordinates q, with a one appended for what is constant."""

    def __init__(self, coupler: Coupler):
        if coupler._motions:
            raise ValueError("coupler must have no prescribed motion for an exact solution")
        subdomains = [s for _, s in coupler._keys]
        self.names = [name for name, _ in coupler._keys]
        self.ends = np.cumsum([s.n for s in subdomains])[:-1]
        M, C, K = (
            scipy.linalg.block_diag(*(_full(getattr(s, X), s.n) for s in subdomains)) for X in "MCK"
        )
        self.M, self.C, self.K = M, C, K
        self.L = np.hstack([dense(L) for L in coupler._matrices])
        self.F = np.concatenate([_constant(coupler, i) for i in range(len(subdomains))])
        self.u0, v0 = (np.concatenate(x) for x in zip(*coupler._initial))
        self.Z = Z = scipy.linalg.null_space(self.L)
        m = Z.shape[1]
        mass = Z.T @ M @ Z
        if np.linalg.cond(mass) > 1e12:
            raise ValueError(
                "coupler must have mass in every motion of the uncut structure for an exact "
                f"solution, got a mass matrix of condition {np.linalg.cond(mass):.1e}"
            )
        right = Z.T @ np.column_stack([-K @ Z, -C @ Z, self.F - K @ self.u0])
        self.A = np.zeros((2 * m + 1, 2 * m + 1))  # d/dt (q, q', 1)
        self.A[:m, m : 2 * m] = np.eye(m)
        self.A[m : 2 * m] = np.linalg.solve(mass, right)
        self.x0 = np.concatenate([np.zeros(m), Z.T @ v0, [1.0]])

    def __call__(self, t: float) -> Instant:
        m, Z = self.Z.shape[1], self.Z
        x = scipy.linalg.expm(self.A * t) @ self.x0
        u, v = self.u0 + Z @ x[:m], Z @ x[m : 2 * m]
        w = Z @ (self.A @ x)[m : 2 * m]
        force = self.M @ w + self.C @ v + self.K @ u - self.F  # L^T Lam, (1)
        lam = np.linalg.lstsq(self.L.T, force, rcond=None)[0]
        parts = zip(*(np.split(x, self.ends) for x in (u, v, w)))
        return dict(zip(self.names, parts)), lam


def _full(A: Any, n: int) -> np.ndarray:
    return np.zeros((n, n)) if A is None else dense(A)


def _constant(coupler: Coupler, i: int) -> np.ndarray:
    """The constant load of subdomain i, in the user's order."""
    force, part = coupler._forces[i], coupler._parts[i]
    if force is not None and not isinstance(force, np.ndarray):
        raise ValueError(
            f"coupler must have no loads or constant ones for an exact solution, got {force!r} on "
            f"subdomain {part.name!r}"
        )
    return np.zeros(part.n) if force is None else force


def global_error(
    coupler: Coupler, exact: Callable[[float], Instant], t_end: float
) -> dict[str, float]:
    """Errors at t_end of a run from t = 0; the coupler itself stays as it is.

    Parameters
    ----------
    coupler : Coupler
        Loads included.
    exact : callable
        ``exact(t) -> (dict, Lam)``, as from `exact_solution`: by name of the subdomain (u, v, w),
        (n_i,) each, and Lam, (p,).
    t_end : float
        A positive whole number of macro steps.

    Returns
    -------
    dict
        The largest absolute errors: "u", "v" and "a" (of the true acceleration w) over all dofs of
        all subdomains, "multipliers" over the conditions.

    Raises
    ------
    ValueError, InstabilityError
        As from `Coupler.run`; for an exact solution whose shapes do not fit.

    Examples
    --------
    >>> from pmalpha import analysis, models
    >>> coupler = models.split_oscillator(10.0).coupler(0.01)
    >>> errors = analysis.global_error(coupler, analysis.exact_solution(coupler), 1.0)
    >>> errors["u"] < 0.01
    True
    """
    with _checked(coupler)._entered(), _state_kept(coupler):
        steps = coupler._end(t_end, None, 0)
        _from_the_start(coupler, steps)
        return _errors(coupler, exact(coupler._instant(steps)))


def start_error(coupler: Coupler, exact: Callable[[float], Instant]) -> dict[str, float]:
    """Errors after the first two macro steps: the initialization error e2 of the paper.

    The first macro step is single for everybody, the second is the first with double steps. For
    unequal steps it depends on the `start` of the coupler: "rebased" (S3) or "plain", the paper's.

    Parameters
    ----------
    coupler, exact
        As for `global_error`.

    Returns
    -------
    dict
        As from `global_error`.

    Examples
    --------
    >>> from pmalpha import analysis, models
    >>> oscillator = models.split_oscillator(10.0, substeps=5, v0=6.0)
    >>> def error_of_v(dt, start):
    ...     coupler = oscillator.coupler(dt, start=start)
    ...     return analysis.start_error(coupler, analysis.exact_solution(coupler))["v"]
    >>> steps = [1 / 640, 1 / 1280]
    >>> [round(analysis.observed_order(lambda dt: error_of_v(dt, start), steps))
    ...  for start in ("plain", "rebased")]
    [1, 2]
    """
    return global_error(coupler, exact, 2.0 * _checked(coupler).dt)


def _from_the_start(coupler: Coupler, steps: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConstraintWarning)  # said when the coupler was made
        coupler._started = False
        coupler._start()
    coupler._advance(steps, None)


def local_error(
    coupler: Coupler, exact: Callable[[float], Instant], *, n: int = 3
) -> dict[str, float]:
    """Errors that one macro step makes, past the start, from exact data: the paper's tau_n.

    Exact data at t_n = n dt means: u, v and w are those of `exact`, a = w, and the stored free
    velocity is the one that belongs to the exact v and Lam, equation (S2) with the operators in
    force (those of 2 h for a double-step subdomain)::

        vf = v - al2 Mbar^-1 L^T Lam

    A double-step subdomain has exact data at its own node before t_n too. (a = w is a choice: the
    a of a run is close to the true acceleration to first order only, and exact data in another
    sense, a on the scheme's own smooth path, would give other local errors.)

    Parameters
    ----------
    coupler, exact
        As for `global_error`.
    n : int, default 3
        The macro step goes from n dt to (n + 1) dt; at least 1, so that it is past the start.

    Returns
    -------
    dict
        As from `global_error`, at t_{n+1}.

    Examples
    --------
    O(dt^2) in the velocity for rho < 1:

    >>> from pmalpha import analysis, models
    >>> oscillator = models.split_oscillator(10.0, rho=0.5, v0=6.0)
    >>> def error_of_v(dt):
    ...     coupler = oscillator.coupler(dt)
    ...     return analysis.local_error(coupler, analysis.exact_solution(coupler))["v"]
    >>> round(analysis.observed_order(error_of_v, [1 / 640, 1 / 1280]), 1)
    2.0
    """
    n = whole_number(n, "n", low=1)
    _checked(coupler)._require_linear("local_error")
    with coupler._entered(), _state_kept(coupler):
        for part in coupler._parts:
            part.core.set_nodes(_exact_nodes(coupler, part, exact, n))
        nothing = np.zeros(coupler._row_place.size)  # no step reads these multipliers
        coupler._core.start(n, nothing, nothing)
        coupler._advance(n + 1, None)
        return _errors(coupler, exact(coupler._instant(n + 1)))


def _exact_nodes(
    coupler: Coupler, part: Part, exact: Callable[[float], Instant], n: int
) -> tuple[np.ndarray, ...]:
    """What the core keeps of a part at t_n, from exact data."""
    u, v, w, lam = _exact_at(coupler, part, exact, coupler._instant(n))
    h = 2.0 * part.h if part.double else part.h
    # a subdomain of its own, whose single step is the step in force, starts with (S2)
    core = core_subdomain(part, part.subdomain.scheme, part.L, part.operator(h))
    core.start(u, v, w, lam)
    nodes = core.nodes()
    if part.double:
        before = ((n * part.subdomain.substeps - 1) / part.subdomain.substeps) * coupler.dt
        u, v, w, _ = _exact_at(coupler, part, exact, before)
        # no step reads this free velocity, and there are no springs
        nodes += (u, v, w, w, np.zeros(part.nb), np.zeros(0))
    return nodes


def _exact_at(
    coupler: Coupler, part: Part, exact: Callable[[float], Instant], t: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """u, v, w and Lam at a time in the core's order."""
    states, lam = exact(t)
    state = [
        vector(x, part.n, f"{name} of {part.name!r} from exact({t:g})")[part.order]
        for x, name in zip(states[part.name], "uvw")
    ]
    p = coupler._row_place.size
    rows = np.empty(p)
    rows[coupler._row_place] = vector(lam, p, f"Lam from exact({t:g})")
    return (*state, rows)


def _errors(coupler: Coupler, truth: Instant) -> dict[str, float]:
    states, lam = truth
    p = coupler._row_place.size
    got = coupler._core.multipliers[coupler._row_place]
    errors = {"u": 0.0, "v": 0.0, "a": 0.0}
    for part in coupler._parts:
        for name, x, y in zip(errors, part.core.state(), states[part.name]):
            y = vector(y, part.n, f"{name} of {part.name!r} from exact")
            errors[name] = max(errors[name], float(np.max(np.abs(x[part.place] - y))))
    jump = np.abs(got - vector(lam, p, "Lam from exact"))
    return errors | {"multipliers": float(np.max(jump, initial=0.0))}
