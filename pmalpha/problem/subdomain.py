"""One subdomain of a structure: matrices, scheme, substeps, loads and initial values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
import scipy.sparse as sp

from .._cached import Frozen
from .._checks import (
    check_word,
    counted,
    damping_by_name,
    flag,
    listing,
    numbered,
    vector,
    whole_number,
)
from .._rooms import outer
from .._tables import html_facts
from ..errors import FactorizationError
from .arguments import (
    Damping,
    DofsLike,
    InternalForceFunction,
    Load,
    MatrixLike,
    MotionLoad,
    RestoringForce,
    VectorLike,
)
from .damping import checked_rayleigh, damping_matrix, stiffness_at_start
from .device import Limits, limits_of_dofs
from .dofs import checked_names, dof_array, numbers_along
from .internal import Internal, internal_for
from .loads import Mass, checked_force, depends_on_motion, terms_of
from .matrices import (
    EXPORTED,
    Matrix,
    canonical,
    combination,
    dense,
    diagonal,
    is_symmetric,
    plain_matrices,
    sparse,
)
from .restoring import Restoring, checked_restoring, functions_of, springs_of
from .schemes import Scheme, explicit_rho, require_generalized_alpha
from .springs import Spring, stiffness

__all__ = ["ReducedBasis", "Subdomain"]

# Dofs up to which periods are computed.
FEW = 100
# From this spectral radius at infinity on, the velocity of a dof without mass grows.
UNDAMPED = 1.0 - 1e-9


def facts(s: Any) -> Iterator[tuple[str, str]]:
    """What it is, by name."""
    yield "dofs", str(s.n)
    if s.dof_names is not None:
        shown = ", ".join(s.dof_names[:4])
        yield "names of dofs", shown if s.n <= 4 else f"{shown}, ..."
    kind = "explicit" if s.scheme.explicit else "implicit"
    yield "scheme", f"{s.scheme!r}, {kind}, of order {s.scheme.order}"
    yield "substeps", str(s.substeps)
    yield "matrices", ", ".join(f"{x} {form(getattr(s, x))}" for x in "MKC")
    if s.rayleigh is not None:
        c_m, c_k = s.rayleigh
        yield "Rayleigh damping", f"c_m = {c_m:.4g}, c_k = {c_k:.4g}"
    for name in ("force", "restoring", "internal"):
        if getattr(s, name) is not None:
            yield name, described(s, name)
    periods = longest_periods(s)
    if periods is not None:
        yield "longest periods", ", ".join(f"{x:.4g}" for x in periods) or "none"


def form(A: Any) -> str:
    """The form of a matrix."""
    if A is None:
        return "zero"
    if isinstance(A, np.ndarray):
        return "diagonal" if A.ndim == 1 else "dense"
    return f"sparse with {A.nnz} entries"


def described(s: Any, name: str) -> str:
    """A load, or the number of springs and whether there are functions."""
    value = getattr(s, name)
    if name == "force":
        terms = ("constant" if isinstance(x, np.ndarray) else repr(x) for x in terms_of(value))
        return " and ".join(terms)
    springs = s.restoring_springs if name == "restoring" else value.springs
    count = sum(len(spring) for spring in springs)
    functions = s.has_functions if name == "restoring" else bool(value.forces)
    return " and ".join([counted(count, "spring")] * bool(count) + ["functions"] * functions)


def longest_periods(s: Any) -> np.ndarray | None:
    """The three longest of the linear subdomain alone; None where dofs are many or have no mass."""
    K = s.tangent
    if s.n > FEW or s.massless.size or K is None or not is_symmetric(K):
        return None
    from scipy.linalg import eigh

    squares = eigh(dense(K), dense(s.M), eigvals_only=True)
    oscillating = squares[squares > 1e-10 * np.abs(squares).max()]
    periods: np.ndarray = 2.0 * np.pi / np.sqrt(oscillating[:3])
    return periods


class Subdomain(Frozen):
    """One subdomain of the coupled problem (1): :math:`M w + C v + K u + r + f = F(t) + L^T Lam`.

    Most have six arguments: the matrices M and K, a `scheme`, its number of `substeps` in a macro
    step, a load `force`, and a `name`::

        scheme = pm.GeneralizedAlpha(0.8)
        tower = pm.Subdomain(M, K, scheme=scheme, substeps=5, force=f, name="tower")

    Then the motion at t = 0: `u0`, `v0`; damping: C, `rayleigh` or `damping_ratio`; forces that
    depend on the motion: `internal` for what is iterated, and for a test rig `restoring`, evaluated
    once a substep, with its estimates and `limits`. Arrays are copied, and several couplers can
    contain the same subdomain.

    Parameters
    ----------
    M, K : (n,) array, (n, n) array, scipy.sparse matrix or array, a number, or a reader's result
        Mass and stiffness, symmetric; a 1-D array is a diagonal. A dof without mass, a zero row and
        column of M, requires an implicit scheme that damps at infinite frequency. K may be None
        with a restoring or internal force.
    C : like M and K, optional
        By name only. Viscous damping, symmetric unless `symmetric` is False. Default: none.
    scheme : Scheme
        `GeneralizedAlpha`, `Newmark`, `CentralDifference`, `HHT` or `WBZ`.
    substeps : int, default 1
        Substeps in a macro step dt.
    force : (n,) array, callable, LowLevelCallable, `SampledForce` or `BaseAcceleration`, optional
        External load at the end of each substep; of a list of these, ``[gravity, earthquake]``,
        the sum. A callable ``f(t)`` is evaluated in advance;
        ``f(t, u, v)``, such as a controller, when `restoring` is. A ``scipy.LowLevelCallable`` is
        ``int (double t, intptr_t n, double *f, void *user)``.
    name : str, optional
        Default: "subdomain i", with its index in the Coupler.
    u0, v0 : (n,) array, optional; a number for one dof
        Initial displacement and velocity. Default: zero.
    damping : {"implicit", "lagged"}, default "implicit"
        "lagged": C acts on the extrapolated velocity, equation (R4): no factor in an explicit
        subdomain, and a smaller critical step, equation (C2).
    rayleigh : (c_m, c_k), optional
        Rayleigh damping c_m M + c_k K, added to C. K is the stiffness at u0: with the tangents
        there of internal forces and springs, and with restoring_stiffness for functions in
        restoring. It stays as it is when the tangents change.
    damping_ratio : dict, optional
        The same by damping ratios at two periods: ``{1.2: 0.05, 0.1: 0.05}``.
    internal : callable, `InternalForce`, springs, or a list of them, optional
        A further force that an implicit subdomain iterates with its tangents: ``f(t, u, v, q)``
        returns ``(f, K_t)``, ``(f, K_t, C_t)`` or ``(f, K_t, C_t, q1)`` of its arguments alone.
    restoring : callable, LowLevelCallable, springs, or a list of these, optional
        A further force, equation (R2), such as a specimen: ``r(t, u, v)`` is evaluated exactly
        once a substep, in the order of time, at predicted displacements and velocities. A
        ``scipy.LowLevelCallable`` is ``int (double t, intptr_t n, double *u, double *v, double *r,
        void *user)``. It gives back at most what it has taken: a force that feeds in energy, of a
        controller, the wind or a moving support, is a load ``force=f(t, u, v)``.
    restoring_stiffness, restoring_damping : like M and K, optional
        Estimates K_r, D_r of the stiffness and damping of functions; an implicit subdomain is
        stable if K_r is at least the tangent. Springs alone bring theirs, the initial
        tangents; beside functions K_r is that of both. Far above the tangent it acts as a mass.
    limits : `pmalpha.rig.Limits`, optional
        Of a test specimen: a command or a measured force beyond them is a `LimitError`, before
        the command is given.
    double_step : bool, optional
        Whether to take double steps, from t_{n-1} to t_{n+1}. Default under "pm": if implicit and
        coarser than the finest, or the first of equal ones; else False.
    symmetric : bool, default True
        False admits unsymmetric K, C, estimates and tangents, as of gyroscopic and follower forces.
    dof_names : sequence of n str, optional
        Names of the dofs, such as "roof", accepted wherever numbers of dofs are, and in
        ``history["frame"]["roof"]``. Subdomains of a mesh have the component and the number of the
        node, "ux 12".

    Raises
    ------
    TypeError, ValueError
        For wrong arguments, unsymmetric or infinite entries.
    FactorizationError
        For a dof without mass in an explicit subdomain.

    Warns
    -----
    PerformanceWarning
        For a dense C where K is sparse or diagonal.

    Examples
    --------
    >>> import numpy as np
    >>> tower = Subdomain([2.0, 1.0], np.array([[3.0, -1.0], [-1.0, 1.0]]),
    ...                   scheme=GeneralizedAlpha(0.5), name="tower")
    >>> tower.n
    2

    A Duffing oscillator, explicit:

    >>> duffing = Subdomain([1.0], None, scheme=CentralDifference(), v0=[1.0],
    ...                     restoring=lambda t, u, v: u + u**3)
    >>> float(np.round(solve(duffing, dt=0.001, t_end=1.0).u[-1, 0], 4))
    0.8044
    """

    # not Matrix: a checker would then want a test for None, a zero matrix, at each use of tower.M
    M: Any
    K: Any
    C: Any
    # whether a function among the restoring forces has no estimate of its stiffness
    has_unknown_stiffness: bool

    @damping_by_name
    def __init__(
        self,
        M: MatrixLike,
        K: MatrixLike | None,
        *,
        C: MatrixLike | None = None,
        scheme: Scheme,
        substeps: int = 1,
        force: VectorLike | Load | MotionLoad | Any = None,
        name: str | None = None,
        u0: VectorLike | None = None,
        v0: VectorLike | None = None,
        damping: Damping = "implicit",
        rayleigh: tuple[float, float] | None = None,
        damping_ratio: Mapping[float, float] | None = None,
        internal: InternalForceFunction | Sequence[Any] | Any = None,
        restoring: RestoringForce | Sequence[Any] | Any = None,
        restoring_stiffness: MatrixLike | None = None,
        restoring_damping: MatrixLike | None = None,
        limits: Limits | None = None,
        double_step: bool | None = None,
        symmetric: bool = True,
        dof_names: Sequence[str] | np.ndarray | None = None,
    ):
        _check_kinds(M, scheme, damping, name)
        M, K, C = plain_matrices(M=M, K=K, C=C)
        self.scheme = scheme
        self.substeps = whole_number(substeps, "substeps", low=1)
        self.double_step = None if double_step is None else flag(double_step, "double_step")
        self.name = name
        self.symmetric = flag(symmetric, "symmetric")
        self.M, self.n = canonical(M, "M")
        self.dof_names = names = checked_names(dof_names, self.n)
        self.internal: Internal | None = internal_for(internal, scheme, self.n, names)
        self.restoring: Restoring = checked_restoring(restoring, self.n, names)
        if K is None and self.restoring is None and self.internal is None:
            raise TypeError(
                "K must be a matrix where there is no restoring force and no internal one, got None"
            )
        self.K = self._matrix(K, "K")
        self.damping = damping
        self.force = checked_force(force, self.n, mass=Mass(self.M, names))
        self.has_unknown_stiffness = self.has_functions and restoring_stiffness is None
        if self.restoring_springs and self.internal is not None and self.internal.springs:
            raise ValueError(
                "springs must be either in restoring, evaluated once per substep, or in internal, "
                "iterated, got some in both"
            )
        self.restoring_stiffness = self._stiffness_estimate(restoring_stiffness)
        self.restoring_damping = self._estimate(restoring_damping, "restoring_damping")
        self.limits = self._limits(limits)
        self.u0, self.v0 = self._initial(u0, "u0"), self._initial(v0, "v0")
        self.rayleigh = checked_rayleigh(rayleigh, damping_ratio)
        self.C = self._damping(C, K)
        self._check_lagged()
        self._check_mass()
        self._freeze()

    def _stiffness_estimate(self, argument: MatrixLike | None) -> Matrix | None:
        """The estimate K_r: springs bring their own, which no other may replace."""
        estimate = self._estimate(argument, "restoring_stiffness")
        if not self.restoring_springs or (argument is not None and self.has_functions):
            return estimate
        tangents = stiffness(self.restoring_springs, "initial_tangent", self.n)
        spring_stiffness = self._estimate(tangents, "restoring_stiffness")
        excess = combination([(1.0, estimate), (-1.0, spring_stiffness)])
        if argument is not None and excess is not None:
            if not abs(excess).max() <= 1e-12 * abs(tangents).max():
                raise ValueError(
                    "restoring_stiffness must be the initial tangents where all restoring forces "
                    "are springs, which bring them, got another estimate: stops that the step does "
                    "not resolve are given as internal="
                )
        return spring_stiffness

    def __repr__(self) -> str:
        label = "" if self.name is None else f"{self.name!r}, "
        label += counted(self.n, "dof")
        return f"<Subdomain {label}, {self.scheme!r}, substeps={self.substeps}>"

    def _repr_html_(self) -> str:
        label = "without a name" if self.name is None else repr(self.name)
        return html_facts(f"Subdomain {label}", facts(self))

    def reduced(
        self,
        keep: DofsLike,
        *,
        modes: int | None = None,
        omega: float | None = None,
        **changes: Any,
    ) -> tuple[Subdomain, ReducedBasis]:
        """A small subdomain in place of this one: Guyan or Craig-Bampton reduction.

        Its coordinates are the kept dofs, such as those of an interface, and modes of the others
        with the kept dofs fixed: u = T (u_keep, q). M, C, K and the force become T^T M T, T^T C T,
        T^T K T and T^T F. It is exact for static forces on kept dofs and for rigid motions;
        otherwise its frequencies are too high, and the error falls with the number of modes. Modes
        up to 1.5 to 2 times the highest frequency in the load are customary.

        Parameters
        ----------
        keep : int or (b,) array of int, or mask
            The dofs to be kept, such that the subdomain does not float when they are fixed.
        modes : int
            Number m of modes: 0 for Guyan reduction, which keeps static shapes only.
        omega : float
            In place of `modes`, all modes up to this angular frequency (radians per unit of time).
        **changes
            Arguments of the new subdomain in place of those of this one: scheme, substeps,
            double_step, damping, name. A reduced explicit subdomain has a larger critical step,
            but a full mass matrix.

        Returns
        -------
        subdomain : Subdomain
            With b + m dofs, the kept ones first, in the order of `keep`. Springs remain, if all
            their dofs are kept. Initial values are those of the kept dofs and their projection on
            the modes.
        basis : ReducedBasis
            ``basis.expand(history[name].u)`` has the displacements of all dofs, ``basis.place``
            the new numbers of kept ones.

        Raises
        ------
        TypeError, ValueError
            For dofs that do not hold the subdomain, more modes than other dofs with mass, K=None,
            restoring or internal forces other than springs on kept dofs, a compiled force.
        MemoryError
            When the basis, b + m times the number of dofs, does not fit.

        Warns
        -----
        UserWarning
            If u0 or v0 lie more than 1 % outside of the basis.

        Notes
        -----
        Guyan, Reduction of stiffness and mass matrices, 1965; Craig and Bampton, Coupling of
        substructures for dynamic analyses, 1968. Time and memory are those of `structures.modes`,
        and of a static shape for each kept dof.

        Examples
        --------
        A rod of 50 elements by its ends and eight modes has the first frequency of a free rod:

        >>> from pmalpha import structures
        >>> rod = structures.rod(50, 1.0, EA=1.0, rhoA=1.0)
        >>> small, basis = rod.subdomain(scheme=GeneralizedAlpha(0.9)).reduced([0, 50], modes=8)
        >>> small
        <Subdomain 10 dofs, GeneralizedAlpha(0.9, explicit=False), substeps=1>
        >>> structures.modes(small.M, small.K, 2)[0].round(2).tolist()  # 0 and pi
        [0.0, 3.14]
        """
        allowed = ("scheme", "substeps", "double_step", "damping", "name")
        unknown = [name for name in changes if name not in allowed]
        if unknown:
            raise TypeError(f"changes must be of {', '.join(allowed)}, got {unknown[0]!r}")
        arguments, basis = outer("reduced_arguments")(self, keep, modes, omega)
        attributes = {name: getattr(self, name) for name in allowed}
        return Subdomain(**{**attributes, **arguments, **changes}), basis

    @property
    def massless(self) -> np.ndarray:
        """The dofs without mass: zero rows of M."""
        if self.M is None:
            return np.arange(self.n)
        # in a semidefinite matrix a zero on the diagonal means a zero row
        return np.flatnonzero(diagonal(self.M) == 0.0)

    @property
    def tangent(self) -> Matrix | None:
        """K + K_r, the stiffness with the estimate for the restoring force; no internal ones."""
        if self.restoring_stiffness is None:
            return self.K
        return combination([(1.0, self.K), (1.0, self.restoring_stiffness)])

    @property
    def has_symmetric_steps(self) -> bool:
        """Whether Mbar, K and C of all its steps are symmetric, with tangents and estimates."""
        if self.symmetric:
            return True
        estimates = (self.restoring_stiffness, self.restoring_damping)
        return self.internal is None and all(map(is_symmetric, (self.K, self.C, *estimates)))

    @property
    def restoring_springs(self) -> tuple[Spring, ...]:
        """The springs among the restoring forces."""
        return springs_of(self.restoring)

    @property
    def has_functions(self) -> bool:
        """Whether functions of the user are among the restoring forces."""
        return bool(functions_of(self.restoring))

    @property
    def has_feedback(self) -> bool:
        """Whether the force is a function of the motion, f(t, u, v)."""
        return depends_on_motion(self.force)

    @property
    def is_linear(self) -> bool:
        """Whether no force on it depends on the motion."""
        return self.restoring is None and self.internal is None and not self.has_feedback

    @property
    def springs(self) -> tuple[Spring, ...]:
        """All springs: those among the restoring forces, or those among the internal ones."""
        return self.restoring_springs or (() if self.internal is None else self.internal.springs)

    @property
    def iterates(self) -> bool:
        """Whether a substep is solved by Newton's method: implicit, with internal forces."""
        return not self.scheme.explicit and self.internal is not None

    @property
    def largest_tangent(self) -> Matrix | None:
        """The stiffness for the critical step, with the largest tangents of springs.

        It is K + K_r without springs. Of springs alone K_r is not used, and beside functions it
        counts as the initial tangents with an estimate for the functions. Without internal forces.
        """
        springs = self.restoring_springs
        if not springs:
            return self.tangent
        tangents = stiffness(springs, "largest_tangent", self.n)
        if self.has_functions:
            tangents = tangents - stiffness(springs, "initial_tangent", self.n)
        rest = self.tangent if self.has_functions else self.K
        return combination([(1.0, rest), (1.0, canonical(tangents, "springs", self.n)[0])])

    @property
    def initial_tangent(self) -> Matrix | None:
        """The same with the initial tangents of springs: contact with a clearance is open."""
        springs = self.restoring_springs
        if not springs or self.has_functions:
            return self.tangent
        tangents = stiffness(springs, "initial_tangent", self.n)
        return combination([(1.0, self.K), (1.0, canonical(tangents, "springs", self.n)[0])])

    @property
    def dampers(self) -> Matrix | None:
        """The largest damping of springs that are evaluated once a step, None without any."""
        springs = self.springs if self.scheme.explicit else self.restoring_springs
        damped = tuple(x for x in springs if x.largest_damping is not None)
        if not damped:
            return None
        return canonical(stiffness(damped, "largest_damping", self.n), "springs", self.n)[0]

    @property
    def implicit_stiffness(self) -> Matrix | None:
        """The matrix with the factor al1 in Mbar (R3): K + K_r, None if explicit."""
        return None if self.scheme.explicit else self.tangent

    @property
    def implicit_damping(self) -> Matrix | None:
        """The matrix with the factor al2 in Mbar: C + D_r (R3), without C if it is lagged (R4)."""
        C = None if self.damping == "lagged" else self.C
        if self.restoring_damping is None:
            return C
        return combination([(1.0, C), (1.0, self.restoring_damping)])

    def _matrix(self, value: Any, name: str) -> Matrix | None:
        if value is None:
            return None
        return canonical(value, name, self.n, symmetric=self.symmetric)[0]

    def _damping(self, C: Any, K: Any) -> Matrix | None:
        """The damping matrix; C and K as given."""
        tangent = self.K
        if self.rayleigh is not None and self.rayleigh[1] > 0.0:
            tangent = stiffness_at_start(self)
        arguments = dict(M=self.M, K=tangent, K_argument=K, symmetric=self.symmetric)
        return damping_matrix(C, self.rayleigh, self.n, **arguments)

    def _estimate(self, value: Any, name: str) -> Matrix | None:
        if value is not None and self.restoring is None:
            raise ValueError(f"{name} must come with a restoring force, got restoring=None")
        return self._matrix(value, name)

    def _limits(self, limits: Any) -> Limits | None:
        if limits is None:
            return None
        if not isinstance(limits, Limits):
            raise TypeError(f"limits must be of type pmalpha.rig.Limits, got {limits!r}")
        if self.restoring is None:
            raise ValueError("limits must come with a restoring force, got restoring=None")
        limits_of_dofs(limits, self.n)
        return limits

    def _initial(self, value: Any, name: str) -> np.ndarray:
        if value is None:
            zeros = np.zeros(self.n)
            zeros.setflags(write=False)
            return zeros
        return vector(value, self.n, name)

    def _check_lagged(self) -> None:
        """ValueError for a skew part of C at vs, which no scheme but that of rho_b = 0 bears."""
        s = self.scheme
        if self.damping != "lagged":
            return
        require_generalized_alpha(s, 'damping="lagged"', self.name)
        if not (is_symmetric(self.C) or (s.explicit and explicit_rho(s) == 0.0)):
            raise ValueError(
                "damping must be 'implicit' where C is not symmetric, unless the scheme is "
                "explicit with rho = 0: gyroscopic forces at the extrapolated velocity make "
                f"practically every step unstable, got 'lagged' and {s!r}"
            )

    def _check_negative_mass(self, digits: float) -> None:
        """ValueError for negative masses; up to `digits` only under a scheme without damping."""
        d = np.zeros(0) if self.M is None else diagonal(self.M)
        if not (d < 0.0).any():
            return
        undamped = not self.scheme.explicit and self.scheme.radius_at_infinity() > UNDAMPED
        negative = np.flatnonzero(d < (0.0 if undamped else -digits))
        if negative.size:
            raise ValueError(
                f"M must be positive semidefinite, got a negative diagonal entry at "
                f"{numbered('dof', negative)}: {d[negative].min():g}"
            )

    def _check_mass(self) -> None:
        if self.M is not None and (diagonal(self.M) > 0.0).all():
            return
        label = "the subdomain" if self.name is None else f"subdomain {self.name!r}"
        digits = 0.0 if self.M is None else EXPORTED * float(np.max(np.abs(diagonal(self.M))))
        self._check_negative_mass(0.0 if self.scheme.explicit else digits)
        massless = self.massless
        if not massless.size:
            return
        if self.M is not None and self.M.ndim == 2 and abs(self.M[massless, :]).max() > digits:
            raise ValueError(
                f"M must be positive semidefinite, got a zero diagonal entry in a row that is "
                f"not zero, among {numbered('dof', massless)}"
            )
        if self.scheme.explicit:
            raise FactorizationError(
                f"{label} is explicit and its mass matrix singular: no mass at "
                f"{numbered('dof', massless)}; give mass there or take an implicit scheme",
                subdomain=self.name,
                dof=int(massless[0]),
            )
        if self.damping == "lagged":
            raise ValueError(
                f"damping must be 'implicit' where dofs have no mass, got 'lagged' and no mass at "
                f"{numbered('dof', massless)} of {label}"
            )
        if self.scheme.radius_at_infinity() > UNDAMPED:
            raise ValueError(
                f"scheme must damp at infinite frequency (rho < 1) for dofs without mass, got "
                f"{self.scheme!r} and no mass at {numbered('dof', massless)} of {label}; take "
                "GeneralizedAlpha(0.999), which hardly damps the rest, or condense these dofs: "
                f".reduced(keep, modes=0, scheme={self.scheme!r}) of that, keep the other dofs"
            )


def dense_whole(subdomains: Sequence[Subdomain], name: str) -> np.ndarray:
    """M, C or K of all subdomains, block by block."""
    blocks = [sparse(getattr(s, name), s.n) for s in subdomains]
    matrix: np.ndarray = sp.block_diag(blocks).toarray()
    return matrix


def _check_kinds(M: Any, scheme: Any, damping: Any, name: Any) -> None:
    """Errors of arguments of the wrong kind."""
    if not isinstance(scheme, Scheme):
        raise TypeError(f"scheme must be a pmalpha scheme, got {scheme!r}")
    if name is not None and not (isinstance(name, str) and name):
        raise TypeError(f"name must be a string that is not empty, got {name!r}")
    if M is None:
        raise TypeError("M must be a matrix, got None")
    check_word(damping, "damping", get_args(Damping))


@dataclass(frozen=True, eq=False)
class ReducedBasis:
    """The displacements of a subdomain from those of its reduced one, `Subdomain.reduced`.

    Attributes
    ----------
    matrix : (n, r) ndarray
        T: displacements of all dofs for unit values of the r = b + m coordinates, the b kept dofs
        and the m modes.
    keep : (b,) ndarray of int
        The kept dofs; coordinate k < b is the displacement of dof ``keep[k]``.
    omega : (m,) ndarray
        Angular frequencies of the modes, in rising order; the kept dofs are fixed in them.
    all_names : sequence of str or None
        The `dof_names` of the whole subdomain.

    Examples
    --------
    A chain of four masses by its ends and one mode:

    >>> K = 6.0 * (np.diag([1, 2, 2, 1]) - np.eye(4, k=1) - np.eye(4, k=-1))
    >>> chain = Subdomain(np.ones(4), K, scheme=GeneralizedAlpha(0.5))
    >>> small, basis = chain.reduced([0, 3], modes=1)
    >>> small.n, basis.omega.round(6).tolist()
    (3, [2.44949])
    >>> basis.expand([[1.0, 0.0, 0.0]]).round(4).tolist()
    [[1.0, 0.6667, 0.3333, 0.0]]
    """

    matrix: np.ndarray
    keep: np.ndarray
    omega: np.ndarray
    all_names: Sequence[str] | None = None

    def __repr__(self) -> str:
        n, _ = self.matrix.shape
        dofs, shapes = counted(self.keep.size, "dof"), counted(self.omega.size, "mode")
        return f"<ReducedBasis of {counted(n, 'dof')}: {dofs} kept, {shapes}>"

    def expand(self, u: Any) -> np.ndarray:
        """Displacements, velocities or accelerations of all dofs.

        Parameters
        ----------
        u : (..., r) array_like
            Such as ``history["tower"].u`` of the reduced subdomain.

        Returns
        -------
        (..., n) ndarray
            On all dofs.

        Raises
        ------
        ValueError
            For another last dimension.

        Examples
        --------
        >>> bar = Subdomain([1.0, 1.0, 1.0], np.diag([2.0, 2.0, 2.0]), scheme=Newmark())
        >>> small, basis = bar.reduced([2], modes=0)
        >>> basis.expand([[3.0], [5.0]]).tolist()
        [[0.0, 0.0, 3.0], [0.0, 0.0, 5.0]]
        """
        result: np.ndarray = numbers_along(u, self.matrix.shape[1], "u") @ self.matrix.T
        return result

    def place(self, dofs: Any) -> np.ndarray:
        """Numbers of kept dofs in the reduced subdomain, for `tie`, `record` or springs.

        Parameters
        ----------
        dofs : array_like of int or str, any shape
            Kept dofs, in the numbering of the whole subdomain.

        Returns
        -------
        ndarray of int, shape of `dofs`
            Their numbers in the reduced subdomain.

        Raises
        ------
        TypeError, ValueError
            For what is not a number of a dof, and dofs that are not kept.

        Examples
        --------
        >>> bar = Subdomain([1.0, 1.0, 1.0], np.diag([2.0, 2.0, 2.0]), scheme=Newmark())
        >>> bar.reduced([2, 0], modes=0)[1].place([0, 2]).tolist()
        [1, 0]
        """
        n = self.matrix.shape[0]
        wanted = dof_array(dofs, n, "dofs", self.all_names)
        missing = np.setdiff1d(wanted, self.keep)
        if missing.size:
            raise ValueError(f"dofs must be kept ones, got {listing(missing)}")
        number = np.zeros(n, dtype=np.int64)
        number[self.keep] = np.arange(self.keep.size)
        result: np.ndarray = number[wanted]
        return result
