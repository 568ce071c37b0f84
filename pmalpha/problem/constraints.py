"""Interface constraints sum_i L_i v_i = g(t) between subdomains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from .._cached import Frozen
from .._checks import counted, listing, numbered, plain_array
from .arguments import DofsLike, MatrixLike
from .dofs import dof_list, has_names
from .loads import Load, checked_force
from .matrices import read_only, rectangular
from .subdomain import Subdomain

__all__ = ["Constraint", "tie"]


# Up to this number of rows a selection of dofs is made once for equal ties.
FEW = 20

# Keys of a Mapping are invariant: a dict of one kind is none of both.
MatricesLike: TypeAlias = (
    Mapping[Subdomain, MatrixLike] | Mapping[str, MatrixLike] | Mapping[Subdomain | str, MatrixLike]
)


class Constraint(Frozen):
    """Constraints :math:`sum_i L_i v_i = g(t)` on velocities of subdomains, equation (2).

    Without `velocity`, g is zero and the subdomains are tied. With `velocity`, the motion of a
    support or a driven end is prescribed.

    The multipliers act as + L_i^T Lam on the right-hand side of (1). A row and its g
    times a factor are the same constraint, whose multiplier is divided by this factor.

    Parameters
    ----------
    matrices : dict
        A matrix L_i, (p, n_i) dense or scipy.sparse, for each of the one or more subdomains that
        the constraints involve, by the `Subdomain` or by its name. A name is looked up, and n_i
        compared, by the `Coupler`. A list of p names of dofs is the matrix that selects them:
        ``Constraint({"frame": ["left", "right"]}, velocity=SupportMotion(...))``.
    velocity : callable, `SampledForce` or (p,) array, optional
        Right-hand side g(t) of the p rows. It is evaluated at every fine step, in advance like a
        load, and the initial velocities must satisfy it. Its derivative at t = 0, which the initial
        accelerations need, equation (S1), is the slope of the first two samples; for a callable, a
        difference of order 2 over an eighth of the fine step with which the coupler was made.

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, entries that are not finite, a row without any entry, or a name twice.

    Notes
    -----
    A pickled or copied Constraint has names in place of the subdomains that have one: it needs none
    of their matrices, and fits every `Coupler` that has subdomains of these names and sizes.

    Examples
    --------
    The mean of two dofs of a tied to a dof of b:

    >>> a = Subdomain([1.0, 1.0], [1.0, 1.0], scheme=GeneralizedAlpha(0.5))
    >>> b = Subdomain([1.0], [1.0], scheme=GeneralizedAlpha(0.5))
    >>> Constraint({a: [[0.5, 0.5]], b: [[-1.0]]}).p
    1

    A driven end:

    >>> Constraint({b: [[1.0]]}, velocity=lambda t: [np.sin(t)]).p
    1

    In names:

    >>> Constraint({"tower": [[0.5, 0.5]], "rig": [[-1.0]]})
    <1 constraint on 'tower' and 'rig'>
    """

    def __init__(self, matrices: MatricesLike, velocity: Any = None):
        self.matrices = by_subdomain(matrices, "matrices", "L")
        self.p = next(iter(self.matrices.values())).shape[0]
        if isinstance(velocity, Load) and not velocity._prescribes:
            raise TypeError("velocity must be a SampledForce, a callable or an array, not a force")
        if isinstance(velocity, Load) and velocity.average:
            raise ValueError("velocity must be a SampledForce without average, got average=True")
        self.velocity = checked_force(velocity, self.p, "velocity")
        self._freeze()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "matrices": by_name(self.matrices)}

    def __repr__(self) -> str:
        *labels, last = labels_of(self.matrices)
        names = f"{', '.join(labels)} and {last}" if labels else last
        motion, v = "", self.velocity
        if isinstance(v, np.ndarray):
            motion = np.array2string(v, precision=4, threshold=6, separator=", ")
        elif v is not None:
            motion = repr(v)
        motion = motion and f", velocity = {motion}"
        return f"<{counted(self.p, 'constraint')} on {names}{motion}>"


def name_of(subdomain: Subdomain | str) -> str | None:
    """The name of a subdomain that is given as itself or by its name."""
    return subdomain if isinstance(subdomain, str) else subdomain.name


def by_name(matrices: Mapping[Any, Any]) -> dict[Any, Any]:
    """The same, by the names of the subdomains that have one: a copy finds them by it."""
    return {name_of(s) or s: L for s, L in matrices.items()}


def labels_of(matrices: Mapping[Any, Any]) -> list[str]:
    """What a repr says of the subdomains."""
    return [
        repr(name_of(s) or f"subdomain of {counted(L.shape[1] or 0, 'dof')}")
        for s, L in matrices.items()
    ]


@dataclass(frozen=True)
class Chosen:
    """Rows with one entry, in dofs of a subdomain that is given by its name.

    Their numbers are known where the subdomain is, in the `Coupler`.
    """

    dofs: Sequence[Any]  # numbers and names, one a row
    entry: float  # of all rows
    what: str  # the argument, for errors

    @property
    def shape(self) -> tuple[int, None]:
        return len(self.dofs), None

    def matrix(self, n: int, names: Sequence[str] | None) -> sp.csr_array:
        """The rows, for a subdomain of n dofs with these names."""
        return selection(dof_list(self.dofs, n, self.what, names), self.entry, n)


class Selections(dict[Any, Any]):
    """Rows with one entry each by subdomain, which need no other check."""


def selection(dofs: np.ndarray, entry: float, n: int) -> sp.csr_array:
    """Rows with one entry each, (dofs, n), read-only."""
    if dofs.size <= FEW:
        return _few_rows(tuple(dofs.tolist()), entry, n)
    return _selection(dofs, entry, n)


@lru_cache(maxsize=256)
def _few_rows(dofs: tuple[int, ...], entry: float, n: int) -> sp.csr_array:
    return _selection(np.array(dofs, dtype=np.int64), entry, n)


def _selection(dofs: np.ndarray, entry: float, n: int) -> sp.csr_array:
    p = dofs.size
    L = sp.csr_array((np.full(p, entry), dofs, np.arange(p + 1)), shape=(p, n))
    return read_only(L)


def by_subdomain(
    matrices: Any, name: str, label: str, rows: int | None = None
) -> dict[Subdomain | str, sp.csr_array | Chosen]:
    """Checked matrices of constraints or contacts, `label` in errors, with this number of rows."""
    if not isinstance(matrices, Mapping) or not matrices:
        raise TypeError(f"{name} must be a dict of matrices by subdomain, got {matrices!r}")
    selected = isinstance(matrices, Selections)
    blocks = {s: L if selected else _rows_on(s, L, name, label) for s, L in matrices.items()}
    names = [name_of(s) for s in blocks]
    if len(set(names) - {None}) < len(names) - names.count(None):
        raise ValueError(f"{name} must not name a subdomain twice, got {listing(names)}")
    counts = {L.shape[0] for L in blocks.values()} | ({rows} if rows is not None else set())
    if len(counts) > 1:
        raise ValueError(f"{name} must have the same number of rows, got {sorted(counts)}")
    if selected:
        return blocks
    counts_of = [
        np.ones(L.shape[0], int) if isinstance(L, Chosen) else np.diff(L.indptr)
        for L in blocks.values()
    ]
    entries = np.sum(counts_of, axis=0)
    if not entries.size:
        raise ValueError(f"{name} must have at least one row, got none")
    if np.any(entries == 0):
        empty = np.flatnonzero(entries == 0)
        raise ValueError(
            f"every row of {name} must have an entry, got none in {numbered('row', empty)}"
        )
    return blocks


def _rows_on(subdomain: Any, L: Any, name: str, label: str) -> sp.csr_array | Chosen:
    if not isinstance(subdomain, (Subdomain, str)):
        raise TypeError(f"{name} must be keyed by Subdomain or name, got {subdomain!r}")
    if has_names(L):
        return chosen(L, subdomain, 1.0, f"dofs of {name_of(subdomain)!r}")
    if isinstance(L, Mapping) and not sp.issparse(L):  # a dok_matrix is both
        raise TypeError(
            f"{label} of {name_of(subdomain)!r} must be a matrix of p rows, or names of p dofs, "
            f"got {L!r}"
        )
    columns = None if isinstance(subdomain, str) else subdomain.n
    return rectangular(L, columns, f"{label} of {subdomain!r}", ndim=2)


def chosen(
    value: Any, subdomain: Subdomain | str, entry: float, what: str
) -> sp.csr_array | Chosen:
    """Rows with one entry each, in dofs as a user gives them."""
    if isinstance(subdomain, Subdomain):
        dofs = dof_list(value, subdomain.n, what, subdomain.dof_names)
        return selection(dofs, entry, subdomain.n)
    array = plain_array(value, what)
    if array.dtype.kind == "b" and array.ndim == 1:
        value = array = np.flatnonzero(array)
    if array.dtype.kind not in "UO" and not (array.dtype.kind == "i" and array.min(initial=0) < 0):
        dof_list(array, None, what)  # its errors do not depend on the subdomain
    elif array.ndim > 1:
        raise TypeError(f"{what} must be a 1-D array of whole numbers or names, got {value!r}")
    items = [value] if array.ndim == 0 else list(value)
    if len(set(items)) < len(items):
        twice = sorted({str(x) for x in items if items.count(x) > 1})
        raise ValueError(f"{what} must not repeat a dof, got {listing(twice)} twice")
    return Chosen(tuple(items), entry, what)


def tie(a: Subdomain | str, dofs_a: DofsLike, b: Subdomain | str, dofs_b: DofsLike) -> Constraint:
    """Tie dofs of two subdomains, with equal velocities: +1 on a, -1 on b.

    A positive multiplier is a positive force on a and a negative force on b.

    Parameters
    ----------
    a : Subdomain or str
        One side, or its name.
    dofs_a : int, str, (p,) array of them, or (n,) array of bool
        Its dofs: numbers, of which negative ones count from the end, names (`dof_names`), or a
        mask.
    b : Subdomain or str
        The other side, or its name.
    dofs_b : int, str, (p,) array of them, or (n,) array of bool
        Its dofs; entry k of `dofs_a` is tied to entry k of `dofs_b`.

    Returns
    -------
    Constraint
        With p rows, in the order of the dofs.

    Raises
    ------
    TypeError, ValueError
        For dofs that are not whole numbers or names, out of range, repeated, or of unequal number.
        Where a side is given by name, the `Coupler` looks its dofs up.

    Examples
    --------
    >>> a = Subdomain([1.0, 1.0], [1.0, 1.0], scheme=GeneralizedAlpha(0.5))
    >>> b = Subdomain([1.0], [1.0], scheme=GeneralizedAlpha(0.5))
    >>> tie(a, 1, b, 0)
    <1 constraint on 'subdomain of 2 dofs' and 'subdomain of 1 dof'>
    >>> tie("tower", [0, 1], "rig", [3, 4])
    <2 constraints on 'tower' and 'rig'>
    """
    require_two(a, b)
    return Constraint(pairs(a, dofs_a, b, dofs_b, (1.0, -1.0)))


def pairs(
    a: Subdomain | str,
    dofs_a: Any,
    b: Subdomain | str,
    dofs_b: Any,
    entries: tuple[float, float],
    names: tuple[str, str] = ("dofs_a", "dofs_b"),
) -> Selections:
    rows_a, rows_b = map(chosen, (dofs_a, dofs_b), (a, b), entries, names)
    counts = rows_a.shape[0], rows_b.shape[0]
    if counts[0] != counts[1] or counts[0] == 0:
        raise ValueError(
            f"{names[0]} and {names[1]} must have the same length, at least one, got "
            f"{counts[0]} and {counts[1]}"
        )
    return Selections({a: rows_a, b: rows_b})


def require_two(a: Any, b: Any) -> None:
    for s in (a, b):
        if not isinstance(s, (Subdomain, str)):
            raise TypeError(f"a and b must be Subdomains or their names, got {s!r}")
    if a is b:
        raise ValueError(f"a and b must be two different subdomains, got {a!r} twice")
    if name_of(a) is not None and name_of(a) == name_of(b):
        raise ValueError(f"a and b must have different names, both are named {name_of(a)!r}")
