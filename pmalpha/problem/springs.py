"""Springs between two dofs or a dof and the ground, as restoring forces of a subdomain.

An object holds any number of springs of one law, which the core evaluates. Equations (H1) to (H5)
and (H9) to (H14) of docs/method.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

import pmalpha._core as _core

from .._cached import Frozen
from .._checks import counted, real_array
from . import forms
from .dofs import GROUND, dof_list, spring_dofs
from .moving import MovingPoint

__all__ = [
    "Bilinear",
    "BoucWen",
    "CubicSpring",
    "Gap",
    "Multilinear",
    "RambergOsgood",
    "SpringState",
]


def __dir__() -> list[str]:
    return sorted(__all__)


# Range of the deformation at first yield: its powers and inverse are finite.
LARGEST = 1e100
MOST_POINTS = 32  # of a backbone, two parameters each and one


@dataclass(frozen=True)
class SpringState:
    """State of the springs of a subdomain at one time level, in the order in which they were given.

    Attributes
    ----------
    deformation : (springs,) array
        d = u_first - u_second of the last evaluation, at the predictor of the displacement, which
        differs from u by O(h^2).
    force : (springs,) array
        Force of the same evaluation, positive in the direction of a positive deformation.
    """

    deformation: np.ndarray
    force: np.ndarray


class Spring(Frozen):
    """Base class: springs of one law.

    Attributes
    ----------
    dofs : (springs, 2) array
        First and second dof of each spring, -1 for the ground. Names, and numbers that count from
        the end, are those that were given, with None for the ground; `Subdomain.springs` has
        numbers.
    parameters : tuple of (springs,) arrays
        Parameters of the law as given by the user.
    """

    law: str  # name in the core
    # whether the force depends on the path, so that the tangent is another one in unloading
    has_memory: bool = False
    names: tuple[str, ...]
    k: np.ndarray

    def __init__(self, dofs: Any, *, sign: Any = 1, **parameters: Any):
        self.dofs = _signed(_pairs(dofs), sign)
        self.parameters = tuple(
            _spread(value, name, len(self.dofs)) for name, value in parameters.items()
        )
        self.names = tuple(parameters)
        for array, name in zip(self.parameters, self.names):
            setattr(self, name, array)
        self._freeze()

    def __len__(self) -> int:
        return len(self.dofs)

    def __repr__(self) -> str:
        ends, pairs = (GROUND, None), self.dofs.tolist()
        moves = [any(isinstance(x, MovingPoint) for x in pair) for pair in pairs]
        moving = sum(moves)
        still = [pair for pair, is_moving in zip(pairs, moves) if not is_moving]
        ground = sum(first in ends or second in ends for first, second in still)
        counts = {
            "to the ground": ground,
            "between two dofs": len(self) - ground - moving,
            "with an end that moves": moving,
        }
        kinds = [f"{counted(n, 'spring')} {where}" for where, n in counts.items() if n]
        return f"<{type(self).__name__}: {', '.join(kinds)}>"

    def _moved(self, dofs: np.ndarray) -> Spring:
        """The same springs between other dofs, (springs, 2)."""
        return type(self)(dofs, **dict(zip(self.names, self.parameters)))

    @property
    def moves(self) -> bool:
        """Whether some of its ends are points that move."""
        return any(isinstance(x, MovingPoint) for x in self.dofs.flat)

    def _require_still(self, label: str) -> None:
        if self.moves:
            raise ValueError(
                f"{label} must have springs between dofs, got one with an end that moves: such "
                "springs are given as restoring= of the subdomain that has the path"
            )

    def _placed(self, n: int, names: Sequence[str] | None, label: str) -> Spring:
        """The same springs with numbers of dofs of a subdomain; `label` is that of the argument."""
        self._require_still(label)
        if self.dofs.dtype != object:
            if self.dofs.max() >= n:
                raise ValueError(
                    f"{label}: dofs of a {type(self).__name__} must lie in 0..{n - 1}, got "
                    f"{self.dofs.max()}"
                )
            return self
        what = f"{label}: dofs of a {type(self).__name__}"
        pairs = [
            [GROUND if x is None else int(dof_list(x, n, what, names)[0]) for x in pair]
            for pair in self.dofs
        ]
        return self._moved(np.array(pairs))

    @property
    def initial_tangent(self) -> np.ndarray:
        """Stiffness of each spring at zero deformation."""
        return self.k

    @property
    def largest_tangent(self) -> np.ndarray:
        """Largest stiffness of each spring, for the critical step; of a cubic spring only k."""
        return self.k

    @property
    def largest_damping(self) -> np.ndarray | None:
        """Largest df/dd' of each spring, for the critical step; None where there is none."""
        return None

    @property
    def numbers(self) -> np.ndarray:
        """Dofs and parameters, a row for each spring; equal for equal springs of the same law."""
        return np.column_stack([self.dofs, *self.parameters])

    def _for_core(self) -> tuple[np.ndarray, ...]:
        """The parameters in the order of the law in the core, (springs,) arrays."""
        return self.parameters

    def _require(self, holds: np.ndarray, name: str, rule: str) -> None:
        if not holds.all():
            i = int(np.argmin(holds))
            raise ValueError(f"{name} must {rule}, got {getattr(self, name)[i]:g} at spring {i}")


class CubicSpring(Spring):
    """A Duffing spring: :math:`f = k d + k_3 d^3`, equation (H1).

    Parameters
    ----------
    dofs : int, str, (m,) or (m, 2) array of them
        Dofs of the subdomain, numbers or names. One dof for each spring: between that dof and the
        ground, d = u, so that ``[0, 1]`` are two springs to the ground, ``[-1]`` is one at the last
        dof. A pair for each spring: d = u_first - u_second, so that ``[(0, 1)]`` is one spring
        between two dofs; in pairs -1 and ``"ground"`` are the ground. A single pair without the
        list, ``(0, 1)``, is refused. In pairs an end may be a `MovingPoint`, ``[("body", point)]``,
        as ``restoring=`` of the subdomain that has its path.
    k, k3 : float or (m,) array
        Linear stiffness, not negative, and cubic stiffness of any sign.
    c : float or (m,) array, optional
        Of a damper parallel to it, c d', equation (H14); not negative. As ``restoring=``, evaluated
        once a step, it limits the step as lagged damping does.

    Raises
    ------
    TypeError, ValueError
        For dofs that are not whole numbers, a spring from a dof to itself, wrong shapes, numbers
        that are not finite, and a negative stiffness.

    Examples
    --------
    >>> spring = CubicSpring([0], k=1.0, k3=1.0)
    >>> duffing = Subdomain([1.0], None, scheme=CentralDifference(), v0=[1.0], restoring=spring)
    >>> float(np.round(solve(duffing, dt=0.001, t_end=1.0).u[-1, 0], 4))
    0.8044
    """

    law = "cubic"
    k3: np.ndarray
    c: np.ndarray

    def __init__(self, dofs: Any, k: Any, k3: Any, *, c: Any = None):
        if c is not None:
            self.law = "damped cubic"
        super().__init__(dofs, k=k, k3=k3, **({} if c is None else {"c": c}))
        for name in set(self.names) - {"k3"}:
            self._require(getattr(self, name) >= 0.0, name, "not be negative")

    @property
    def largest_damping(self) -> np.ndarray | None:
        """Damping of each spring, if there is a damper."""
        return self.c if "c" in self.names else None


class Gap(Spring):
    """A stop: :math:`f = k (d - gap)` of a deformation d above the gap, else 0, equation (H2).

    With a damper, :math:`f = k (d - gap) + c d'` there, where that is positive: it does not pull
    (Kelvin-Voigt, equation (H13)).

    Parameters
    ----------
    dofs : int, (m,) or (m, 2) array of int
        As for `CubicSpring`.
    k, gap : float or (m,) array
        Stiffness of the contact and clearance, neither negative.
    sign : {1, -1} or (m,) array of them, default 1
        -1: a stop on the negative side, for deformations below -gap. It is the spring with its two
        dofs exchanged: deformation and force are recorded so, positive where it pushes.
    c : float or (m,) array, optional
        Of the damper, not negative. A mass m that meets the stop with a damping ratio of
        :math:`zeta = c / (2 sqrt(k m))` leaves it with the share
        :math:`exp(-zeta / sqrt(1 - zeta^2) arctan2(2 zeta sqrt(1 - zeta^2), 2 zeta^2 - 1))` of its
        velocity, for zeta < 1.

    Raises
    ------
    TypeError, ValueError
        As for `CubicSpring`.

    Notes
    -----
    The initial tangent is zero if gap > 0. A step that does not resolve the contact adds energy,
    less where it is iterated, as ``internal=``, and none by `DiscreteGradient`. A damper that is
    evaluated once a step, as ``restoring=``, limits the step as lagged damping does.

    Examples
    --------
    >>> stops = [Gap([0], k=1e4, gap=0.1), Gap([0], k=1e4, gap=0.1, sign=-1)]
    >>> ball = Subdomain([1.0], None, scheme=CentralDifference(), v0=[1.0], restoring=stops)
    >>> bool(np.abs(solve(ball, dt=0.001, t_end=2.0).u).max() < 0.12)
    True
    """

    law = "gap"
    gap: np.ndarray
    c: np.ndarray

    def __init__(self, dofs: Any, k: Any, gap: Any, *, sign: Any = 1, c: Any = None):
        damper = {} if c is None else {"c": c}
        if damper:
            self.law = "damped gap"
        super().__init__(dofs, sign=sign, k=k, gap=gap, **damper)
        for name in self.names:
            self._require(getattr(self, name) >= 0.0, name, "not be negative")

    @property
    def largest_damping(self) -> np.ndarray | None:
        """Largest damping of each spring: of the damper, if there is one."""
        return self.c if "c" in self.names else None

    @property
    def initial_tangent(self) -> np.ndarray:
        """Stiffness of each spring at zero deformation: 0 where there is a clearance."""
        return np.where(self.gap > 0.0, 0.0, self.k)


class Bilinear(Spring):
    """Elastic up to fy, then stiffness hardening * k, equation (H3): kinematic hardening.

    Parameters
    ----------
    dofs : int, (m,) or (m, 2) array of int
        As for `CubicSpring`.
    k, fy : float or (m,) array
        Initial stiffness and force at first yield, both positive.
    hardening : float or (m,) array, default 0
        Stiffness after yield over k, in [0, 1].

    Raises
    ------
    TypeError, ValueError
        As for `CubicSpring`.

    Examples
    --------
    >>> joint = Bilinear([(0, 1)], k=100.0, fy=2.0, hardening=0.1)
    >>> joint.fy / joint.k
    array([0.02])
    """

    law = "bilinear"
    has_memory = True
    fy: np.ndarray
    hardening: np.ndarray

    def __init__(self, dofs: Any, k: Any, fy: Any, hardening: Any = 0.0):
        super().__init__(dofs, k=k, fy=fy, hardening=hardening)
        _check_yield(self)

    def _for_core(self) -> tuple[np.ndarray, ...]:
        """Stiffnesses of two springs in parallel, elastic and elastic-plastic, and fy / k."""
        return (self.hardening * self.k, (1.0 - self.hardening) * self.k, self.fy / self.k)


class BoucWen(Spring):
    """The smooth hysteresis of Bouc and Wen: :math:`f = a k d + (1 - a) fy z`, equation (H4).

    a is the hardening and d the deformation, which z follows within [-1, 1], with d_y = fy / k, by
    :math:`z' = d' / d_y (1 - (gamma + beta sgn(d' z)) |z|^n)`.

    Parameters
    ----------
    dofs : int, (m,) or (m, 2) array of int
        As for `CubicSpring`.
    k, fy : float or (m,) array
        Initial stiffness and yield force, both positive: with beta + gamma = 1 the hysteretic term
        of the force tends to (1 - hardening) fy.
    hardening : float or (m,) array, default 0
        Stiffness far beyond yield over k, in [0, 1].
    n : float or (m,) array, default 1
        Sharpness of the yield, at least 1. 1 and 2 are evaluated fastest.
    beta, gamma : float or (m,) array, default 0.5
        Shape of the loop: beta not negative, beta + gamma positive. gamma > beta can generate
        energy in small cycles, which is not physical.

    Raises
    ------
    TypeError, ValueError
        As for `CubicSpring`.

    Examples
    --------
    >>> isolator = BoucWen([0], k=50.0, fy=1.0, hardening=0.1, n=2)
    >>> isolator
    <BoucWen: 1 spring to the ground>
    >>> BoucWen([(0, 1)], k=50.0, fy=1.0)
    <BoucWen: 1 spring between two dofs>
    """

    law = "Bouc-Wen"
    has_memory = True
    fy: np.ndarray
    hardening: np.ndarray
    beta: np.ndarray
    gamma: np.ndarray
    n: np.ndarray

    def __init__(
        self,
        dofs: Any,
        k: Any,
        fy: Any,
        hardening: Any = 0.0,
        n: Any = 1.0,
        beta: Any = 0.5,
        gamma: Any = 0.5,
    ):
        super().__init__(dofs, k=k, fy=fy, hardening=hardening, n=n, beta=beta, gamma=gamma)
        _check_yield(self)
        self._require(self.n >= 1.0, "n", "be at least 1")
        self._require(self.beta >= 0.0, "beta", "not be negative")
        self._require(self.beta + self.gamma > 0.0, "gamma", "be above -beta")

    @property
    def largest_tangent(self) -> np.ndarray:
        """Largest stiffness of each spring: k, or more on unloading where beta > gamma."""
        # unloading from the limit |z|^n = 1 / (beta + gamma): dz/dx = 2 beta / (beta + gamma)
        steepest = np.maximum(1.0, 2.0 * self.beta / (self.beta + self.gamma))
        result: np.ndarray = self.k * (self.hardening + (1.0 - self.hardening) * steepest)
        return result

    def _for_core(self) -> tuple[np.ndarray, ...]:
        """Hardening k, (1 - hardening) fy, k / fy, n, beta, gamma, largest rate of z, (H4)."""
        n, beta, gamma = self.n, self.beta, self.gamma
        limit = (beta + gamma) ** (-1.0 / n)  # of |z|
        rate = n * (beta + np.abs(gamma)) * limit ** (n - 1.0)
        hard, soft = self.hardening * self.k, (1.0 - self.hardening) * self.fy
        return hard, soft, self.k / self.fy, n, beta, gamma, rate


class RambergOsgood(Spring):
    """The hysteresis of Ramberg and Osgood with Masing's rules, equation (H11).

    On first loading ``d = f/k (1 + alpha |f/fy|^(n - 1))``; after each reversal the same curve from
    there, twice as large. A loop that closes is forgotten, and the branch before it goes on.

    Parameters
    ----------
    dofs : int, (m,) or (m, 2) array of int
        As for `CubicSpring`.
    k, fy : float or (m,) array
        Initial stiffness and force at which the plastic deformation is alpha fy/k, both positive.
    n : float or (m,) array
        Exponent, at least 1: 5 to 10 for steel.
    alpha : float or (m,) array, default 1
        Plastic over elastic deformation at fy, positive.

    Raises
    ------
    TypeError, ValueError
        As for `CubicSpring`.

    Notes
    -----
    Twelve reversals whose loops are open are kept; beyond, the smallest loop is forgotten.

    Examples
    --------
    >>> damper = RambergOsgood([(0, 1)], k=50.0, fy=2.0, n=7)
    >>> damper
    <RambergOsgood: 1 spring between two dofs>
    """

    law = "Ramberg-Osgood"
    has_memory = True
    fy: np.ndarray
    n: np.ndarray
    alpha: np.ndarray

    def __init__(self, dofs: Any, k: Any, fy: Any, n: Any, alpha: Any = 1.0):
        super().__init__(dofs, k=k, fy=fy, n=n, alpha=alpha)
        _check_yield(self)
        self._require((self.n >= 1.0) & (self.n <= 1000.0), "n", "lie in [1, 1000]")
        within = (self.alpha >= 1.0 / LARGEST) & (self.alpha <= LARGEST)
        self._require(within, "alpha", f"be positive, in {1 / LARGEST:g}..{LARGEST:g}")

    @property
    def initial_tangent(self) -> np.ndarray:
        """Stiffness of each spring at zero deformation."""
        return np.where(self.n > 1.0, self.k, self.k / (1.0 + self.alpha))

    def _for_core(self) -> tuple[np.ndarray, ...]:
        """The elastic deformation fy / k at the force fy, then fy, n and alpha, (H11)."""
        return self.fy / self.k, self.fy, self.n, self.alpha


class Multilinear(Spring):
    """A force that is linear between points of a backbone, equations (H9) and (H10).

    Parameters
    ----------
    dofs : int, (m,) or (m, 2) array of int
        As for `CubicSpring`.
    points : (p, 2) array
        Deformation and force of the backbone, both increasing from (0, 0), which is left out; the
        same for all springs and both directions, at most 32. Beyond the last point its slope goes
        on.
    rule : {"kinematic", "elastic"}
        "kinematic": elastic-plastic elements in parallel (Iwan), so that loops are the backbone
        twice as large (Masing); its slopes must not increase. "elastic": back along the backbone.

    Raises
    ------
    TypeError, ValueError
        As for `CubicSpring`.

    Examples
    --------
    >>> joint = Multilinear([0], [(0.01, 1.0), (0.03, 1.6), (0.1, 2.0)])
    >>> joint.k
    array([100.])
    """

    points: np.ndarray
    rule: str

    def __init__(self, dofs: Any, points: Any, rule: str = "kinematic"):
        if rule not in ("kinematic", "elastic"):
            raise ValueError(f"rule must be 'kinematic' or 'elastic', got {rule!r}")
        self.dofs, self.parameters, self.names = _pairs(dofs), (), ()
        self.points, self.rule = _backbone(points), rule
        self.law = "multilinear" if rule == "kinematic" else "multilinear elastic"
        self.has_memory = rule == "kinematic"
        slopes = self._slopes()
        if rule == "kinematic" and np.any(np.diff(slopes) > 0.0):
            i = int(np.argmax(np.diff(slopes) > 0.0)) + 1
            raise ValueError(
                "points must have slopes that do not increase, with rule='kinematic', got "
                f"{slopes[i]:g} after {slopes[i - 1]:g} at point {i}"
            )
        self.k = _spread(slopes[0], "k", len(self.dofs))
        self._freeze()

    def _slopes(self) -> np.ndarray:
        d, f = np.diff(self.points, axis=0, prepend=0.0).T
        slopes: np.ndarray = f / d
        return slopes

    def _moved(self, dofs: np.ndarray) -> Multilinear:
        """The same springs between other dofs, (springs, 2)."""
        return Multilinear(dofs, self.points, self.rule)

    @property
    def largest_tangent(self) -> np.ndarray:
        """Largest stiffness of each spring, for the critical step."""
        return np.full(len(self), self._slopes().max())

    @property
    def numbers(self) -> np.ndarray:
        """Dofs, points and rule, a row for each spring; equal for equal springs."""
        law = np.append(self.points.ravel(), float(self.rule == "elastic"))
        return np.column_stack([self.dofs, np.tile(law, (len(self), 1))])

    def _for_core(self) -> tuple[np.ndarray, ...]:
        """The stiffness beyond the last point, and that of each element with its limit."""
        slopes = self._slopes()
        elements = np.column_stack([-np.diff(slopes), self.points[:-1, 0]]).ravel()
        return tuple(np.full(len(self), x) for x in [slopes[-1], *elements])


def _backbone(points: Any) -> np.ndarray:
    """(p, 2) array of increasing points, without (0, 0)."""
    array = np.array(real_array(points, "points", (2,)))
    if array.shape[1] == 2 and len(array) and not array[0].any():
        array = array[1:]
    if array.shape[1] != 2 or not 1 <= len(array) <= MOST_POINTS:
        raise ValueError(
            f"points must be of shape (p, 2), p in 1..{MOST_POINTS}, got {np.shape(points)}"
        )
    steps = np.diff(array, axis=0, prepend=0.0)
    for i, name in enumerate(("deformations", "forces")):
        rises = steps[:, i] > 0.0 if i == 0 else steps[:, i] >= 0.0
        if not (rises.all() and array[0, i] > 0.0):
            raise ValueError(f"points must have {name} that increase from 0, got {array[:, i]}")
    array.setflags(write=False)
    return array


def _signed(pairs: np.ndarray, sign: Any) -> np.ndarray:
    """(m, 2) dofs, exchanged where the sign is -1."""
    signs = _spread(sign, "sign", len(pairs))
    wrong = np.abs(signs) != 1.0
    if wrong.any():
        raise ValueError(f"sign must be 1 or -1, got {signs[wrong][0]:g}")
    signed = np.where(signs[:, None] > 0.0, pairs, pairs[:, ::-1])
    signed.setflags(write=False)
    return signed


def _check_yield(spring: Any) -> None:
    spring._require(spring.k > 0.0, "k", "be positive")
    spring._require(spring.fy > 0.0, "fy", "be positive")
    with np.errstate(over="ignore"):
        deformation = spring.fy / spring.k
    within = (deformation <= LARGEST) & (deformation >= 1.0 / LARGEST)
    spring._require(within, "fy", f"be k times a deformation in {1 / LARGEST:g}..{LARGEST:g}")
    if "hardening" in spring.names:
        within = (spring.hardening >= 0.0) & (spring.hardening <= 1.0)
        spring._require(within, "hardening", "lie in [0, 1]")


def _spread(value: Any, name: str, count: int) -> np.ndarray:
    """A number, or one for each spring, as (count,) array."""
    array = real_array(value, name, (0, 1))
    if array.ndim == 1 and array.size != count:
        raise ValueError(f"{name} must be a number or of shape ({count},), got {array.shape}")
    spread = np.array(np.broadcast_to(array, (count,)), order="C")
    spread.setflags(write=False)
    return spread


# ---- with ends that move -----------------------------------------------------------------------


def _pairs(dofs: Any) -> np.ndarray:
    """(m, 2) ends of springs as `spring_dofs`, some of which may be points that move.

    Of these an array of objects, None for the ground.
    """
    items = [dofs] if isinstance(dofs, MovingPoint) else dofs
    if not isinstance(items, (list, tuple)) or not any(map(_has_point, items)):
        return spring_dofs(dofs)
    if not isinstance(items, list) or not all(isinstance(x, (list, tuple)) for x in items):
        raise TypeError(
            "dofs must be pairs [(dof, point)] where an end is a MovingPoint, got "
            f"{type(dofs).__name__} {dofs!r}"
        )
    if not all(len(pair) == 2 for pair in items):
        raise ValueError(f"dofs must be of shape (m, 2), m > 0, got {dofs!r}")
    ends = np.empty((len(items), 2), dtype=object)
    for at in np.ndindex(ends.shape):
        x = items[at[0]][at[1]]
        if not isinstance(x, (str, int, np.integer, MovingPoint)) or isinstance(x, bool):
            raise TypeError(f"dofs must be whole numbers, names or MovingPoints, got {x!r}")
        ends[at] = None if x in ("ground", GROUND) else x
    same = [i for i, (a, b) in enumerate(ends) if a == b]
    if same:
        raise ValueError(f"dofs of a spring must differ, got the same at springs {same}")
    ends.setflags(write=False)
    return ends


def _has_point(item: Any) -> bool:
    return isinstance(item, MovingPoint) or (
        isinstance(item, (list, tuple)) and any(isinstance(x, MovingPoint) for x in item)
    )


class Wheels:
    """Springs with ends that move, placed in a subdomain; the core evaluates them.

    spring: as the user made it.
    ends, points: (springs, 2) array of int, the dof of each end and its place among `paths`; -1.
    paths: points with numbers of the dofs of the subdomain.
    """

    def __init__(self, spring: Spring, n: int, names: Sequence[str] | None, label: str):
        self.spring = spring
        points = list({id(x): x for x in spring.dofs.flat if isinstance(x, MovingPoint)}.values())
        self.paths = tuple(x._placed(n, names, label) for x in points)
        self.ends, self.points = (np.full(spring.dofs.shape, -1) for _ in range(2))
        what = f"{label}: dofs of a {type(spring).__name__}"
        for at, x in np.ndenumerate(spring.dofs):
            if isinstance(x, MovingPoint):
                self.points[at] = next(k for k, point in enumerate(points) if point is x)
            elif x is not None:
                self.ends[at] = int(dof_list(x, n, what, names)[0])
        self.ends.setflags(write=False)
        self.points.setflags(write=False)

    def __repr__(self) -> str:
        return repr(self.spring)

    @property
    def numbers(self) -> np.ndarray:
        """Equal for equal springs of the same law."""
        law = self.spring._moved(np.arange(2 * len(self.spring)).reshape(-1, 2)).numbers
        arrays = self.ends, self.points, law, *(x._numbers for x in self.paths)
        return np.concatenate([np.ravel(x) for x in arrays])

    def for_core(self, n: int) -> forms.Wheels:
        """In the form of the core, with dofs in the order of the user."""
        in_turn = np.arange(2 * len(self.spring)).reshape(-1, 2)
        return forms.Wheels(
            core_springs((self.spring._moved(in_turn),), np.arange(in_turn.size)),
            self.ends,
            self.points,
            tuple(x._core(np.arange(n)) for x in self.paths),
        )


# ---- for a subdomain ---------------------------------------------------------------------------


def stiffness(springs: tuple[Spring, ...], tangent: str, n: int) -> sp.csr_array:
    """sum B^T k B, (n, n), with the initial or the largest tangent k of each spring."""
    return assembled(springs, [getattr(spring, tangent) for spring in springs], n)


def assembled(springs: tuple[Spring, ...], tangents: Sequence[np.ndarray], n: int) -> sp.csr_array:
    """sum B^T k B, (n, n), with the tangents k of the springs of each object."""
    total = sp.csr_array((n, n))
    for spring, k in zip(springs, tangents):
        first, second = spring.dofs.T
        rows = np.concatenate([first, second, first, second])
        columns = np.concatenate([first, second, second, first])
        values = np.concatenate([k, k, -k, -k])
        inside = (rows != GROUND) & (columns != GROUND)
        where = (rows[inside], columns[inside])
        total = total + sp.csr_array((values[inside], where), shape=(n, n))
    return total


def core_springs(springs: tuple[Spring, ...], position: np.ndarray) -> tuple[forms.Springs, ...]:
    """Springs in the form of the core, for the position of each dof in the elimination order."""
    with_ground = np.append(position, GROUND).astype(np.int32)  # index -1 is the ground
    return tuple(
        forms.Springs(
            _core.SPRING_LAWS[spring.law],
            np.ascontiguousarray(with_ground[spring.dofs[:, 0]]),
            np.ascontiguousarray(with_ground[spring.dofs[:, 1]]),
            tuple(np.ascontiguousarray(x) for x in spring._for_core()),
        )
        for spring in springs
    )
