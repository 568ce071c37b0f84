"""Schemes of the generalized-alpha family: four parameters, equilibrium at the end of the step.

The numbers of equations refer to ``docs/method.md``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._cached import Frozen, cached_property
from .._checks import flag, positive_number, real_number

# ---- step constants -----------------------------------------------------------------------------
# The nine numbers of a step of one length, all that a step knows of its scheme.


class StepConstants(NamedTuple):
    """What a scheme does in a step of length h, as `pma_step` of the core has it.

    ::

        ut = u + h v + u_a a + u_w w     (5)
        vt = v + v_a a + v_w w           (6)
        u1 = ut + al1 w1                 (8)
        v1 = vt + al2 w1                 (8)
        a1 = a_a a + a_w w + a_w1 w1     (9)

    w1 follows from equilibrium at the end of the step, with K u1 or, in an explicit scheme, K ut.
    """

    h: float
    al1: float
    al2: float
    u_a: float
    u_w: float
    v_a: float
    v_w: float
    a_a: float
    a_w: float
    a_w1: float

    def predictors(self) -> np.ndarray:
        """ut and vt, the (2, 4) matrix that acts on (u, v, w, a)."""
        return np.array([[1.0, self.h, self.u_w, self.u_a], [0.0, 1.0, self.v_w, self.v_a]])

    def closed(self, w1: np.ndarray) -> np.ndarray:
        """The state (u, v, w, a) at the end, a (4, 4) matrix as `w1` is a row that acts on it; of
        several rows (..., 4) as many matrices."""
        ut, vt = self.predictors()
        a1 = np.array([0.0, 0.0, self.a_w, self.a_a]) + self.a_w1 * w1
        return np.stack([ut + self.al1 * w1, vt + self.al2 * w1, w1, a1], axis=-2)

    def amplification(self, Omega: ArrayLike, xi: float, explicit: bool) -> np.ndarray:
        """The (4, 4) matrix of a step of h = 1 of an oscillator, which acts on (u, v, w, a); of
        several Omega (...) as many matrices."""
        ut, vt = self.predictors()
        Omega = np.asarray(Omega, dtype=np.float64)[..., None]
        c, k = 2.0 * xi * Omega, Omega**2
        mbar = 1.0 + self.al2 * c + (0.0 if explicit else self.al1 * k)  # (12)
        return self.closed(-(c * vt + k * ut) / mbar)  # (11)


# ---- schemes ------------------------------------------------------------------------------------

# Parameters are in a range in which products of a few of them are neither zero nor infinite.
SMALLEST, LARGEST = 1e-50, 1e50

__all__ = ["HHT", "WBZ", "Bathe", "CentralDifference", "GeneralizedAlpha", "Newmark", "Scheme"]


@dataclass(frozen=True, eq=False)
class Scheme(Frozen):
    """A scheme with four given parameters; the classes below choose them by one or two numbers.

    ``am`` and ``af`` weight the old state (Chung and Hulbert's convention). Attributes cannot be
    assigned: with another rho all four parameters are others.

    Attributes
    ----------
    am, af, beta, gamma : float
        The parameters of equations (5) to (9).
    explicit : bool
        Equilibrium is taken with ``K ut`` (10) instead of ``K u1`` (7).
    is_generalized_alpha : bool
        Whether it has the four parameters; True of all schemes of the package but `Bathe`.
    is_of_two_stages : bool
        Whether substeps are the two stages of a step in turn, as of `Bathe`.
    """

    _is_frozen: ClassVar[bool] = True  # the four parameters by the dataclass, others by Frozen
    # Whether it has the four parameters. A scheme that has not gives `constants`, `parameters` and
    # `order` of its own, and what is derived from the four refuses it: `require_generalized_alpha`.
    is_generalized_alpha: ClassVar[bool] = True
    # Whether substeps are the two stages of a step in turn; then there is `second_stage(h)`, and
    # what was derived for steps of one length refuses it: a row of setup/combinations.py.
    is_of_two_stages: ClassVar[bool] = False

    am: float
    af: float
    beta: float
    gamma: float
    explicit: bool = False

    def __post_init__(self) -> None:
        flag(self.explicit, "explicit")
        self._take("am", -LARGEST, 1.0 - 1e-6)
        self._take("af", -LARGEST, 1.0 - 1e-6)
        self._take("beta", 0.0, LARGEST)
        positive_number(self.gamma, "gamma")
        self._take("gamma", SMALLEST, LARGEST)
        if 0.0 < self.beta < SMALLEST:
            raise ValueError(f"beta must be 0 or at least {SMALLEST:g}, got {self.beta!r}")
        if self.beta == 0.0 and not self.explicit:
            raise ValueError("beta must be positive in an implicit scheme, got 0")

    def _take(self, name: str, low: float, high: float) -> None:
        number = real_number(getattr(self, name), name, low=low, high=high)
        object.__setattr__(self, name, number)

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self._steps == other._steps

    def __hash__(self) -> int:
        return hash(self._steps)

    @cached_property
    def _steps(self) -> tuple[StepConstants, bool]:
        return self.constants(1.0), self.explicit

    def constants(self, h: float) -> StepConstants:
        """The nine numbers of a step, equations (5) to (9): all that the core knows of a scheme.

        Parameters
        ----------
        h : float
            Length of the step.

        Returns
        -------
        StepConstants
            A named tuple: h; al1, al2 of equation (P2); u_a, u_w of (5); v_a, v_w of (6); a_a, a_w,
            a_w1 of (9).

        Examples
        --------
        >>> step = Newmark().constants(0.2)
        >>> round(step.al1, 12), step.al2  # h^2 / 4, h / 2
        (0.01, 0.1)
        """
        am, af, beta, gamma = self.am, self.af, self.beta, self.gamma
        d = 1.0 - am
        return StepConstants(
            h=h,
            al1=h * h * beta * (1.0 - af) / d,
            al2=h * gamma * (1.0 - af) / d,
            u_a=h * h * (0.5 - beta / d),
            u_w=h * h * beta * af / d,
            v_a=h * (1.0 - gamma / d),
            v_w=h * gamma * af / d,
            a_a=-am / d,
            a_w=af / d,
            a_w1=(1.0 - af) / d,
        )

    def coefficients(self, h: float) -> tuple[float, float]:
        """The factors of the new acceleration in the corrector, equation (P2).

        Parameters
        ----------
        h : float
            Length of the step.

        Returns
        -------
        al1 : float
            Of the displacement.
        al2 : float
            Of the velocity.
        """
        step = self.constants(h)
        return step.al1, step.al2

    def amplification(self, Omega: float, xi: float = 0.0) -> np.ndarray:
        """Amplification matrix of one step of a free single-dof oscillator.

        Parameters
        ----------
        Omega : float
            Circular frequency times step, omega h.
        xi : float, default 0
            Viscous damping ratio, c / (2 m omega).

        Returns
        -------
        (4, 4) ndarray
            The matrix that maps :math:`(u, h v, h^2 w, h^2 a)` to the next time level.
        """
        return self._amplification(Omega, xi, self.explicit)

    def _amplification(self, Omega: ArrayLike, xi: float, explicit: bool) -> np.ndarray:
        """The same in steps of h = 1, implicit or explicit."""
        return self.constants(1.0).amplification(Omega, xi, explicit)

    def radius_at_infinity(self) -> float:
        """Spectral radius of an implicit scheme as Omega goes to infinity.

        Returns
        -------
        float
            1 without algorithmic damping of the highest frequencies, 0 if they are annihilated.
        """
        step = self.constants(1.0)
        # u1 = 0 there, so that w1 = -ut / al1; of u = 0 remains the state (v, w, a)
        amplification = step.closed(-step.predictors()[0] / step.al1)
        return float(np.max(np.abs(np.linalg.eigvals(amplification[1:, 1:]))))

    @property
    def parameters(self) -> tuple[float, ...]:
        """The numbers that make the scheme: am, af, beta, gamma."""
        return self.am, self.af, self.beta, self.gamma

    @property
    def order(self) -> int:
        """Order of accuracy, 1 or 2."""
        return 2 if abs(self.gamma - 0.5 + self.am - self.af) < 1e-12 else 1

    @property
    def is_newmark(self) -> bool:
        """Whether its steps are those of a Newmark scheme with gamma = 1/2, where a = w."""
        return self.is_generalized_alpha and self.gamma == 0.5 and self.am == self.af

    @property
    def is_trapezoidal(self) -> bool:
        """Whether its steps are those of the trapezoidal rule."""
        return self.is_newmark and not self.explicit and self.beta == 0.25


class GeneralizedAlpha(Scheme):
    """Generalized-alpha scheme, chosen by its spectral radius at high frequency.

    Parameters
    ----------
    rho : float
        In [0, 1]. Implicit: the spectral radius at infinite frequency. Explicit: the spectral
        radius at the bifurcation, :math:`Omega = (1 + rho) sqrt(2 - rho)`. 1 is without algorithmic
        damping, 0 damps the most.
    explicit : bool, default False
        The explicit scheme, stable up to
        :math:`Omega = sqrt(12 (1 + rho) (2 - rho) / (10 - 5 rho + rho^2))`.

    Raises
    ------
    ValueError
        When rho is outside [0, 1].

    Notes
    -----
    Second order. Its constants follow from rho by equation (P1); Chung and Hulbert
    1993, Hulbert and Chung 1996, with equilibrium at the end of the step (Arnold and Bruels 2007;
    Bursi et al. 2008).

    Examples
    --------
    >>> scheme = GeneralizedAlpha(0.5)
    >>> scheme.am, round(scheme.af, 4), round(scheme.gamma, 4), round(scheme.beta, 4)
    (0.0, 0.3333, 0.8333, 0.4444)
    """

    rho: float

    def __init__(self, rho: float, explicit: bool = False):
        rho = real_number(rho, "rho", low=0.0, high=1.0)
        am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        super().__init__(*_of_order_two(am, af), explicit=explicit)
        object.__setattr__(self, "rho", rho)

    def __repr__(self) -> str:
        return f"GeneralizedAlpha({self.rho}, explicit={self.explicit})"


class Newmark(Scheme):
    """Newmark's schemes: :math:`am = af = 0`. The default is the trapezoidal rule.

    Parameters
    ----------
    beta : float, default 1/4
        Not negative; 0 makes the scheme explicit.
    gamma : float, default 1/2
        At least 1/2 (less is unstable at every step); second order only at 1/2.

    Raises
    ------
    ValueError
        When beta is negative or gamma below 1/2.

    Examples
    --------
    >>> Newmark().explicit, Newmark(beta=0.0).explicit
    (False, True)
    """

    def __init__(self, beta: float = 0.25, gamma: float = 0.5):
        beta = real_number(beta, "beta", low=0.0)
        gamma = real_number(gamma, "gamma", low=0.5)
        super().__init__(0.0, 0.0, beta, gamma, explicit=beta == 0.0)

    def __repr__(self) -> str:
        return f"Newmark(beta={self.beta}, gamma={self.gamma})"


class CentralDifference(Newmark):
    """The explicit Newmark scheme, :math:`beta = 0, gamma = 1/2`; stable up to :math:`Omega = 2`.

    Examples
    --------
    >>> CentralDifference().beta, CentralDifference().gamma
    (0.0, 0.5)
    """

    def __init__(self) -> None:
        super().__init__(0.0, 0.5)

    def __repr__(self) -> str:
        return "CentralDifference()"


class HHT(Scheme):
    """Hilber, Hughes and Taylor's scheme: :math:`am = 0, af = alpha`, implicit.

    Parameters
    ----------
    alpha : float
        In [0, 1/3]; 0 is the trapezoidal rule, 1/3 damps the most. The authors' alpha, of many
        programs too, has the opposite sign: their -0.1 is 0.1 here.

    Raises
    ------
    ValueError
        When alpha is outside [0, 1/3].

    Examples
    --------
    >>> HHT(0.1).gamma
    0.6
    """

    alpha: float

    def __init__(self, alpha: float):
        alpha = _damping_parameter(alpha, "HHT", 1.0 / 3.0)
        super().__init__(*_of_order_two(0.0, alpha))
        object.__setattr__(self, "alpha", alpha)

    def __repr__(self) -> str:
        return f"HHT({self.alpha})"


class WBZ(Scheme):
    """Wood, Bossak and Zienkiewicz's scheme: :math:`am = -alpha, af = 0`, implicit.

    Parameters
    ----------
    alpha : float
        In [0, 1]; 0 is the trapezoidal rule, 1 annihilates the highest frequencies. The authors'
        alpha has the opposite sign.

    Raises
    ------
    ValueError
        When alpha is outside [0, 1].

    Examples
    --------
    >>> WBZ(0.1).am, WBZ(0.1).gamma
    (-0.1, 0.6)
    """

    alpha: float

    def __init__(self, alpha: float):
        alpha = _damping_parameter(alpha, "WBZ", 1.0)
        super().__init__(*_of_order_two(-alpha, 0.0))
        object.__setattr__(self, "alpha", alpha)

    def __repr__(self) -> str:
        return f"WBZ({self.alpha})"


class Bathe(Scheme):
    """The two-stage scheme of Bathe and Noh: the trapezoidal rule, then a backward difference.

    Second order, and of the highest frequencies nothing is left after a step: for stiff parts that
    are not resolved. ``substeps`` of a `Subdomain` counts stages, two to a step and so an even
    number; both are time levels, the first at gamma of the step. It has the largest number of all
    subdomains, and all are tied at the ends of its stages.

    Parameters
    ----------
    gamma : float, optional
        End of the first stage in a step. Default and only value: 2 - sqrt 2, with which both stages
        have one matrix, and so one factor and one interface matrix.

    Raises
    ------
    ValueError
        When gamma is another number.

    Notes
    -----
    Equation (P3); Bathe and Baig 2005, Bathe and Noh 2012. It goes with ``coupling="gc"``, linear
    subdomains, frozen models, files and checkpoints; the rest refuses it by name.

    Examples
    --------
    A mass on a spring, and a stiff one of which 40 steps leave nothing:

    >>> import numpy as np
    >>> import pmalpha as pm
    >>> two = pm.Subdomain([1.0, 1.0], np.diag([1.0, 1e8]), scheme=pm.Bathe(), substeps=2,
    ...                    u0=[1.0, 1.0])
    >>> motion = pm.solve(two, dt=0.1, t_end=4.0)
    >>> motion.t[:3].round(4).tolist()
    [0.0, 0.0586, 0.1]
    >>> bool(abs(motion.u[-1, 0] - np.cos(4.0)) < 2e-3), bool(abs(motion.u[-1, 1]) < 1e-8)
    (True, True)
    """

    is_generalized_alpha = False
    is_of_two_stages = True

    gamma: float

    def __init__(self, gamma: float | None = None):
        exact = 2.0 - np.sqrt(2.0)
        number = exact if gamma is None else real_number(gamma, "gamma")
        if abs(number - exact) > 1e-12:
            raise ValueError(
                f"gamma must be None or 2 - sqrt 2 = {exact:.15g}, where both stages have one "
                f"matrix, got {gamma!r}"
            )
        object.__setattr__(self, "gamma", float(exact))
        object.__setattr__(self, "explicit", False)

    def constants(self, h: float) -> StepConstants:
        """The nine numbers of the first stage, where h is the mean length of both.

        Parameters
        ----------
        h : float
            Half a step: dt / substeps.

        Returns
        -------
        StepConstants
            A named tuple, as of other schemes; its h is the length of the stage.

        Examples
        --------
        >>> step = Bathe().constants(0.5)
        >>> round(step.h, 4), round(step.al2, 4)
        (0.5858, 0.2929)
        """
        b = self.gamma * h
        return StepConstants(2.0 * b, b * b, b, 0.0, b * b, 0.0, b, 0.0, 1.0, 0.0)

    def second_stage(self, h: float) -> StepConstants:
        """The same of the second stage, which begins with a = w of the beginning of the step.

        Parameters
        ----------
        h : float
            Half a step: dt / substeps.

        Returns
        -------
        StepConstants
            With al1 and al2 of the first stage.

        Examples
        --------
        >>> step = Bathe().second_stage(0.5)
        >>> round(step.h, 4), round(step.al2, 4)
        (0.4142, 0.2929)
        """
        b, root = self.gamma * h, float(np.sqrt(2.0))
        v = 0.5 * b * (root - 1.0)
        return StepConstants(b * root, b * b, b, 0.0, 0.0, v, v, 0.0, 0.0, 1.0)

    def _amplification(self, Omega: ArrayLike, xi: float, explicit: bool) -> np.ndarray:
        stages = self.constants(0.5), self.second_stage(0.5)  # of a step of h = 1
        first, second = (x.amplification(Omega, xi, explicit) for x in stages)
        both: np.ndarray = second @ first
        return both

    def radius_at_infinity(self) -> float:
        """Spectral radius as Omega goes to infinity.

        Returns
        -------
        float
            0: what a step does not resolve is gone after it.
        """
        return 0.0

    @property
    def parameters(self) -> tuple[float, ...]:
        """The number that makes the scheme: gamma."""
        return (self.gamma,)

    @property
    def order(self) -> int:
        """Order of accuracy, 2."""
        return 2

    def __repr__(self) -> str:
        return "Bathe()"


def _damping_parameter(alpha: Any, name: str, high: float) -> float:
    """alpha in [0, high]; an error states the sign convention."""
    number = real_number(alpha, "alpha")
    if -high <= number < 0.0:
        raise ValueError(
            f"alpha must lie in [0, {high:g}], got {alpha!r}; the alpha of the authors has the "
            f"opposite sign, so that their {number:g} is {name}({-number:g})"
        )
    return real_number(alpha, "alpha", low=0.0, high=high)


def require_generalized_alpha(scheme: Scheme, what: str, name: str | None) -> None:
    """ValueError for a scheme of the subdomain `name` that is not of the family.

    what: the option or function that is derived from the four parameters.
    """
    if not scheme.is_generalized_alpha:
        of = "" if name is None else f" of {name!r}"
        raise ValueError(
            f"{what} needs a scheme of the generalized-alpha family, got {scheme!r}{of}"
        )


def explicit_rho(scheme: Scheme) -> float:
    """rho of an explicit scheme with the four numbers of `GeneralizedAlpha`; 1 of other schemes."""
    rho: float = getattr(scheme, "rho", round(scheme.af / (1.0 - scheme.af), 12))
    if not 0.0 <= rho <= 1.0:
        return 1.0
    like = GeneralizedAlpha(rho, explicit=True)
    same = np.allclose(scheme.parameters, like.parameters, rtol=0.0, atol=1e-11)
    return rho if same else 1.0


def _of_order_two(am: float, af: float) -> tuple[float, float, float, float]:
    """am, af, beta, gamma: gamma for order 2, beta for the most damping, (P1)."""
    gamma = 0.5 - am + af
    return am, af, (0.5 + gamma) ** 2 / 4.0, gamma
