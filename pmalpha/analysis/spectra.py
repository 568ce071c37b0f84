"""Spectral radii, stability limits, zero stability, periods and damping."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from .._checks import real_array, real_number, require_moderate
from ..errors import StabilityWarning
from ..problem.constraints import Constraint
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from ..run.coupler import Coupler
from .amplification import amplification_matrix, checked_coupler, layout_of, propagated

__all__ = ["period_and_damping", "spectral_radius", "stability_limit", "zero_stability"]

# Error of the computed modulus of an eigenvalue of modulus 1, simple or double.
STABLE = 1e-6
# An eigenvector is observable if it changes a multiplier by more than this rounding error.
OBSERVABLE = 1e-10


def spectral_radius(G: np.ndarray, drop: Sequence[complex] = (), tol: float = 1e-6) -> float:
    """Largest modulus of the eigenvalues of a matrix, without those near given values.

    Parameters
    ----------
    G : (n, n) array
        Such as `amplification_matrix`.
    drop : sequence of numbers
        Eigenvalues within `tol` of one of these are omitted: 1, the displacement drift that
        velocity constraints do not determine, or -1, the two chains of a double-step subdomain.
    tol : float, default 1e-6
        Not below about 1e-8: the computed value of a defective eigenvalue, such as that of a motion
        at constant velocity, has an error of the square root of the rounding error.

    Returns
    -------
    float
        0 if no eigenvalue remains.

    Raises
    ------
    TypeError, ValueError
        For a matrix that is not square or not finite, and for a wrong `drop` or `tol`.

    Examples
    --------
    >>> from pmalpha import analysis, models
    >>> oscillator = models.split_oscillator(10.0)
    >>> G = analysis.amplification_matrix(oscillator.coupler(0.05, coupling="pm"))
    >>> radius = analysis.spectral_radius(G)
    >>> abs(radius - 1.0) < 1e-9, analysis.spectral_radius(G, drop=[1.0]) < 1.0
    (True, True)
    """
    G = real_array(G, "G", 2)
    if G.shape[0] != G.shape[1]:
        raise ValueError(f"G must be square, got shape {G.shape}")
    tol = real_number(tol, "tol", low=0.0)
    try:
        omitted = np.atleast_1d(np.asarray(drop, dtype=complex))
    except (TypeError, ValueError):
        raise TypeError(f"drop must be a sequence of numbers, got {drop!r}") from None
    values = np.linalg.eigvals(G)
    far = np.abs(values[:, None] - omitted.ravel()) > tol
    return float(np.max(np.abs(values[far.all(axis=1)]), initial=0.0))


def stability_limit(make_coupler: Callable[[float], Coupler], lo: float, hi: float) -> float:
    """The largest stable x of a family of couplers, by bisection.

    A coupler counts as stable if no eigenvalue of its amplification matrix has a modulus above
    1 + 1e-6: the eigenvalues 1 and -1 caused by velocity constraints may be defective, and their
    computed moduli differ from 1 by about 1e-7.

    Parameters
    ----------
    make_coupler : callable
        ``make_coupler(x)`` returns the coupler at x, such as a step or a frequency times a step.
    lo, hi : float
        Stable at lo, unstable at hi, lo < hi. There should be one stability limit between them.

    Returns
    -------
    float
        The largest stable x, up to 1e-7 hi and up to the change of x that changes the spectral
        radius by 1e-6.

    Raises
    ------
    ValueError
        When the coupler is unstable at lo or stable at hi.

    Examples
    --------
    >>> from pmalpha import analysis, models
    >>> def oscillator(Omega):  # B has angular frequency 1
    ...     oscillator = models.split_oscillator(1.0, rho=0.5, stiffness=1.0)
    ...     return oscillator.coupler(Omega, coupling="pm")
    >>> limit = analysis.stability_limit(oscillator, 1.0, 10.0)
    >>> bool(limit >= np.sqrt(12 * 1.5 * 1.5 / 7.75))
    True
    """
    lo, hi = real_number(lo, "lo"), real_number(hi, "hi")
    if not lo < hi:
        raise ValueError(f"lo must be below hi, got {lo!r} and {hi!r}")
    for x, name, stable in ((lo, "lo", True), (hi, "hi", False)):
        radius = _radius_at(make_coupler, x)
        if (radius <= 1.0 + STABLE) != stable:
            rule = "stable" if stable else "unstable"
            raise ValueError(
                f"the coupler must be {rule} at {name}, got spectral radius {radius:.9g} at {x:g}"
            )
    tolerance = 1e-7 * max(abs(lo), abs(hi))
    while hi - lo > tolerance:
        middle = 0.5 * (lo + hi)
        stable = _radius_at(make_coupler, middle) <= 1.0 + STABLE
        lo, hi = (middle, hi) if stable else (lo, middle)
    return lo


def _radius_at(make_coupler: Callable[[float], Coupler], x: float) -> float:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StabilityWarning)  # stability is computed here
        coupler = make_coupler(x)
    return spectral_radius(amplification_matrix(coupler))


def zero_stability(coupler: Coupler) -> float:
    """Spectral radius of the loop Lam -> vf -> Lam as dt -> 0; below 1 the method is zero-stable.

    As dt -> 0, terms with K dt^2 and C dt vanish against M. The limit of (5) to (18) is the same
    coupler without stiffness and damping, for any dt. In it an error of Lam changes a and w by (14)
    and (9), the next free velocities by (6) and (13), and the next Lam by (15) and (18). With X the
    state (20) of this coupler, G its amplification matrix and B the map from X to the next Lam::

        X_{n+1} = G X_n,    Lam_{n+1} = B X_n

    The eigenvalues of the loop are the eigenvalues of G that are observable in Lam: B x != 0 for
    the eigenvector x. Not observable are the common velocity (eigenvalue 1), displacements,
    interior dofs, and the root -am / (1 - am) of recursion (9) without forces.

    Parameters
    ----------
    coupler : Coupler
        Only its masses, schemes, substeps and constraints have an effect.

    Returns
    -------
    float
        The largest modulus of the eigenvalues that are observable in Lam.

    Raises
    ------
    ValueError
        Without constraints, and with dofs without mass: the loop or its limit does not exist.

    Notes
    -----
    Kuebler and Schiehlen 2000; figure 4 of the paper. For "gc" with equal steps and equal rho the
    roots are -rho and -(3 rho - 1)/(3 - rho) for any masses.

    Examples
    --------
    >>> from pmalpha import analysis, models
    >>> coupler = models.split_oscillator(10.0, rho=0.5).coupler(0.01, coupling="gc")
    >>> round(analysis.zero_stability(coupler), 9)
    0.5
    """
    masses = _masses_alone(coupler)
    G, B = propagated(masses)
    # without stiffness, displacements have no effect
    used = np.array([not name.startswith("u") for name in layout_of(masses).names()])
    values, vectors = np.linalg.eig(G[np.ix_(used, used)])
    B = B[:, used] / np.linalg.norm(B[:, used], axis=1, keepdims=True)
    observable = np.max(np.abs(B @ vectors), axis=0) > OBSERVABLE
    return float(np.max(np.abs(values[observable]), initial=0.0))


def _masses_alone(coupler: Coupler) -> Coupler:
    """The same coupler without stiffness, damping and loads; dt = 1."""
    if not checked_coupler(coupler)._session.core_rows.p:
        raise ValueError("coupler must have constraints, got none")
    for member in coupler._session.members:
        if member.subdomain.massless.size:
            raise ValueError(
                f"coupler must have mass at all dofs, got dofs without mass in {member.name!r}"
            )
    subdomains = [
        Subdomain(
            s.M,
            np.zeros(s.n),
            scheme=s.scheme,
            substeps=member.substeps,
            double_step=member.double,
            name=member.name,
        )
        for member, (_, s) in zip(coupler._session.members, coupler._session.keys)
    ]
    matrices = {s: L for s, L in zip(subdomains, coupler._session.rows.matrices) if L.nnz}
    return Coupler(subdomains, Constraint(matrices), dt=1.0, coupling="pm")


def period_and_damping(
    scheme: Scheme, Omega: ArrayLike, xi: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Period elongation and algorithmic damping ratio of a scheme, on a single-dof oscillator.

    Parameters
    ----------
    scheme : Scheme
        Of any family, implicit or explicit.
    Omega : array_like
        Omega = omega h, angular frequency of the undamped oscillator times step; positive.
    xi : float, default 0
        Viscous damping ratio of the oscillator, in [0, 1).

    Returns
    -------
    elongation : ndarray, the shape of Omega
        Period elongation (T_h - T) / T, with T the period of the damped oscillator and T_h the
        period of the solution of the scheme.
    damping : ndarray, the shape of Omega
        Algorithmic damping: the ratio of decay rate and frequency, -ln|lam| / arg(lam), minus its
        exact value xi / sqrt(1 - xi^2).

        Both are NaN where the solution of the scheme has no period: beyond the bifurcation, where a
        real root is dominant.

    Raises
    ------
    TypeError, ValueError
        For a wrong type of scheme, Omega not positive, xi outside [0, 1).

    Notes
    -----
    lam is the complex eigenvalue of one step in the upper half-plane; its exact value is
    exp(-xi Omega + i Omega sqrt(1 - xi^2)). Hughes, The Finite Element Method, section 9.3.

    Examples
    --------
    The trapezoidal rule has no damping, and period elongation Omega^2 / 12:

    >>> from pmalpha import analysis
    >>> elongation, damping = analysis.period_and_damping(Newmark(), [0.01, 0.02])
    >>> (elongation / np.array([0.01, 0.02]) ** 2 * 12).round(3).tolist()
    [1.0, 1.0]
    >>> bool(abs(damping).max() < 1e-12)
    True
    """
    if not isinstance(scheme, Scheme):
        raise TypeError(f"scheme must be a pmalpha scheme, got {scheme!r}")
    Omega = real_array(Omega, "Omega", tuple(range(33)))
    require_moderate(Omega, "Omega")
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
    """The eigenvalue in the upper half-plane, NaN if there is none or a real one is larger."""
    upper = values[np.argmax(values.imag)]
    # a spurious root, such as -1 at rho = 1, has the same modulus up to rounding
    dominant = np.abs(upper) > np.max(np.abs(values)) - 1e-6
    return upper if upper.imag > 0.0 and dominant else complex(np.nan)
