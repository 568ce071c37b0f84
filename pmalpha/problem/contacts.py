"""Unilateral contact and dry friction as constraints, docs/method/contact.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._cached import Frozen
from .._checks import counted, plain_array, real_array
from .arguments import DofsLike
from .constraints import (
    MatricesLike,
    Selections,
    by_name,
    by_subdomain,
    chosen,
    labels_of,
    pairs,
    require_two,
)
from .loads import Load
from .subdomain import Subdomain

__all__ = ["Contact", "contact"]

# Tangents of a row.
MOST_TANGENTS = 2


class Contact(Frozen):
    """Rows whose gaps may open but not close below zero: :math:`gap + sum_i N_i u_i - d(t) >= 0`.

    A row that is closed pushes with an impulse P >= 0 in each fine step, N_i^T P on subdomain i,
    and slides with Coulomb's friction. It is one of the `constraints` of a `Coupler` under "gc",
    or "pm" where its subdomains take single steps, and all its subdomains are at the finest step.
    Impulses, friction and restitution are those of equations (U1) to (U11) of docs/method.md.

    Parameters
    ----------
    matrices : dict
        A matrix N_i, (rows, n_i) dense or scipy.sparse, for each subdomain, by the `Subdomain` or
        by its name. The mass matrix is diagonal in the rows of dofs with an entry.
    gap : float or (rows,) array, default 0
        The gap where all displacements are zero.
    tangents : sequence of dict, optional
        One or two, each a matrix T_i, (rows, n_i), for each subdomain: the tangential velocities
        of the rows, perpendicular ones of one size if there are two.
    friction : float or (rows,) array, default 0
        Coulomb's mu, at least 0: the impulse of friction is at most mu P, against the sliding.
    friction_static : float or (rows,) array, optional
        At least `friction`: mu of a row that sticks, or is at rest at t = 0, until it slides.
        Default: `friction`.
    restitution : float or (rows,) array, default 0
        Newton's e in [0, 1]: a row that closes at the velocity y opens at -e y. For elastic bodies
        in elements e = 0: they bounce by their waves; e is for lumped masses.
    motion : callable, pair of callables or SampledForce, optional
        Displacement d(t) of the obstacle, a number or (rows,), or (d, velocity): without the
        second its velocity is a central difference over a hundredth of a fine step.
    name : str, optional
        By which ``history.contacts`` finds it. Default: "contact 0", ... by its place.

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, rows without an entry, numbers out of range, friction without tangents.

    Examples
    --------
    A beam whose tip, the mean of two dofs, lands on a stop:

    >>> beam = Subdomain([1.0, 1.0], [1.0, 1.0], scheme=Newmark())
    >>> Contact({beam: [[0.5, 0.5]]}, gap=0.1)
    <Contact of 1 row on 'subdomain of 2 dofs'>
    """

    def __init__(
        self,
        matrices: MatricesLike,
        *,
        gap: Any = 0.0,
        tangents: Sequence[MatricesLike] = (),
        friction: Any = 0.0,
        friction_static: Any = None,
        restitution: Any = 0.0,
        motion: Any = None,
        name: str | None = None,
    ):
        self.matrices = by_subdomain(matrices, "matrices", "matrices")
        self.rows = next(iter(self.matrices.values())).shape[0]
        if isinstance(tangents, Mapping) or not isinstance(tangents, Sequence):
            raise TypeError(f"tangents must be a list of at most two dicts, got {tangents!r}")
        if len(tangents) > MOST_TANGENTS:
            raise ValueError(f"tangents must be at most {MOST_TANGENTS}, got {len(tangents)}")
        names = [f"tangents[{k}]" for k in range(len(tangents))]
        self.tangents = tuple(by_subdomain(*x, x[1], self.rows) for x in zip(tangents, names))
        self.gap = _numbers(gap, self.rows, "gap", -np.inf, np.inf)
        self.friction = _numbers(friction, self.rows, "friction", 0.0, np.inf)
        static = friction if friction_static is None else friction_static
        self.friction_static = _numbers(static, self.rows, "friction_static", 0.0, np.inf)
        self._check_static()
        self.restitution = _numbers(restitution, self.rows, "restitution", 0.0, 1.0)
        if self.friction.any() and not self.tangents:
            raise ValueError(
                "friction must come with one or two tangents, the directions in which rows slide, "
                f"got {self.friction.max():g} and none"
            )
        self.motion = _checked_motion(motion, self.rows)
        if name is not None and not isinstance(name, str):
            raise TypeError(f"name must be a str, got {name!r}")
        self.name = name
        self._freeze()

    def _check_static(self) -> None:
        less = np.flatnonzero(self.friction_static < self.friction)
        if less.size:
            k = less[0]
            raise ValueError(
                f"friction_static must be at least friction, {self.friction[k]:g}, got "
                f"{self.friction_static[k]:g} in row {k}"
            )
        if np.any((self.friction == 0.0) & (self.friction_static > 0.0)):
            raise ValueError(
                "friction must be positive where friction_static is, got 0: a row that slides has "
                "one too"
            )

    def __getstate__(self) -> dict[str, Any]:
        tangents = tuple(map(by_name, self.tangents))
        return {**self.__dict__, "matrices": by_name(self.matrices), "tangents": tangents}

    def __repr__(self) -> str:
        name, on = "" if self.name is None else f" {self.name!r}", labels_of(self.matrices)
        return f"<Contact{name} of {counted(self.rows, 'row')} on {' and '.join(on)}>"


def contact(
    a: Subdomain | str,
    dofs_a: DofsLike,
    b: Subdomain | str | None = None,
    dofs_b: DofsLike | None = None,
    *,
    gap: Any = 0.0,
    sign: int = 1,
    friction: Any = 0.0,
    friction_static: Any = None,
    tangents: Sequence[Any] = (),
    restitution: Any = 0.0,
    motion: Any = None,
    name: str | None = None,
) -> Contact:
    """Contact of dofs of one subdomain with an obstacle, or with dofs of another one.

    Row k has the gap :math:`gap + u_b - u_a` between two subdomains, and
    :math:`gap + sign u_a - d(t)` between a subdomain and an obstacle: below it with sign = 1, above
    it with sign = -1.

    Parameters
    ----------
    a : Subdomain or str
        A subdomain, or its name.
    dofs_a : int, (rows,) array of int, or mask
        Its dofs, one for each row.
    b, dofs_b : optional
        The other side; entry k of `dofs_a` meets entry k of `dofs_b`.
    gap : optional
        As of `Contact`.
    sign : {1, -1}, default 1
        With an obstacle alone.
    friction, friction_static : optional
        As of `Contact`.
    tangents : sequence, optional
        One or two: the dofs in which rows slide, ``dofs`` with an obstacle, ``(dofs_a, dofs_b)``
        with another subdomain.
    restitution, motion, name : optional
        As of `Contact`.

    Returns
    -------
    Contact
        For the constraints of a `Coupler`.

    Raises
    ------
    TypeError, ValueError
        For dofs out of range, repeated or of unequal number, and as `Contact`.

    Examples
    --------
    A ball that falls on the ground and is thrown back with 0.8 of its velocity:

    >>> ball = Subdomain([1.0], [0.0], scheme=Newmark(), force=[-10.0], u0=[1.0], name="ball")
    >>> ground = contact(ball, 0, restitution=0.8, name="ground")
    >>> history = Coupler([ball], ground, dt=1e-3).run(0.6)
    >>> bool(history.contacts["ground"].impulse.max() > 1.8 * 20**0.5 - 0.02)
    True

    Two masses with a clearance:

    >>> left, right = (Subdomain([1.0], [4.0], scheme=Newmark(), name=x) for x in ("l", "r"))
    >>> contact(left, [0], right, [0], gap=0.02, restitution=0.65)
    <Contact of 1 row on 'l' and 'r'>
    """
    if not isinstance(sign, (int, float, np.integer, np.floating)) or sign not in (1, -1):
        raise ValueError(f"sign must be 1 or -1, got {sign!r}")
    if (b is None) != (dofs_b is None):
        raise TypeError("b and dofs_b must be given together")
    numbers = {
        "gap": gap,
        "friction": friction,
        "friction_static": friction_static,
        "restitution": restitution,
    }
    if isinstance(tangents, (str, Mapping)) or not isinstance(tangents, Sequence):
        raise TypeError(f"tangents must be a list of dofs, got {tangents!r}")
    if b is None:
        if not isinstance(a, (Subdomain, str)):
            raise TypeError(f"a must be a Subdomain or its name, got {a!r}")
        normal = _one_sided(a, dofs_a, "dofs_a", float(sign))
        along = [_one_sided(a, dofs, f"tangents[{k}]", 1.0) for k, dofs in enumerate(tangents)]
    else:
        if sign != 1:
            raise ValueError(
                "sign must be 1 between two subdomains, whose gap is that of b - a, got -1"
            )
        require_two(a, b)
        normal = pairs(a, dofs_a, b, dofs_b, (-1.0, 1.0))
        for k, pair in enumerate(tangents):
            if not isinstance(pair, Sequence) or len(pair) != 2:
                raise TypeError(f"tangents[{k}] must be a pair (dofs_a, dofs_b), got {pair!r}")
        along = [
            pairs(a, x, b, y, (-1.0, 1.0), (f"tangents[{k}][0]", f"tangents[{k}][1]"))
            for k, (x, y) in enumerate(tangents)
        ]
    return Contact(normal, tangents=along, motion=motion, name=name, **numbers)


def _one_sided(a: Any, dofs: Any, name: str, sign: float) -> Selections:
    rows = chosen(dofs, a, sign, name)
    if not rows.shape[0]:
        raise ValueError(f"{name} must have at least one dof, got none")
    return Selections({a: rows})


def _numbers(value: Any, rows: int, name: str, low: float, high: float) -> np.ndarray:
    """One number for each row, in [low, high]."""
    numbers = real_array(value, name, (0, 1))
    if numbers.ndim == 1 and numbers.shape != (rows,):
        raise ValueError(f"{name} must be a number or of shape ({rows},), got {numbers.shape}")
    numbers = np.full(rows, numbers) if numbers.ndim == 0 else numbers
    wrong = np.flatnonzero((numbers < low) | (numbers > high))
    if wrong.size:
        rule = f"lie in [{low:g}, {high:g}]" if np.isfinite(high) else f"be at least {low:g}"
        raise ValueError(f"{name} must {rule}, got {numbers[wrong[0]]:g} in row {wrong[0]}")
    numbers.setflags(write=False)
    return numbers


def _checked_motion(motion: Any, rows: int) -> Any:
    if isinstance(motion, Load) and motion._prescribes and motion.n not in (1, rows):
        raise ValueError(f"motion must have 1 or {rows} columns, got {motion.n}")
    if motion is None or (motion._prescribes if isinstance(motion, Load) else callable(motion)):
        return motion
    if isinstance(motion, Sequence) and len(motion) == 2 and all(map(callable, motion)):
        return tuple(motion)
    raise TypeError(
        "motion must be a callable d(t), a pair of callables (d, velocity) or a SampledForce, got "
        f"{motion!r}"
    )


def on_rows(value: Any, rows: int, what: str) -> np.ndarray:
    """What a motion returned, for each row."""
    array = plain_array(value, what)
    if array.size == 1:
        array = np.full(rows, array.reshape(())[()])
    array = real_array(array, what)
    if array.shape != (rows,):
        raise ValueError(f"{what} must be a number or of shape ({rows},), got {array.shape}")
    return array
