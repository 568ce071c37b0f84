"""What sums of works go on with from one run to the next: forces and sums at the last time levels.

They belong to the state where a run with energies has ended. Else works begin with what restoring
functions gave at the present, which belongs to every state, and those of double steps by (B14).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..setup.member import Member

# Vectors of n dofs at a time level: u, F, C v + r.
VECTORS = 3
# Of the largest displacement, between the same state in two orders of sums.
ROUNDING = 1e-12


class Works(NamedTuple):
    """Those at the end of a run with energies, and in a saved state what functions gave."""

    step: int = 0  # the macro step
    arrays: tuple[np.ndarray | None, ...] = ()  # of each subdomain
    functions: tuple[np.ndarray | None, ...] = ()  # of each subdomain


def works_of(members: Sequence[Member], step: int) -> Works:
    return Works(step, tuple(member.core.works() for member in members))


def saved(members: Sequence[Member], works: Works, count: int) -> Works:
    """The same with what restoring functions gave at the present, `count` steps from the origin."""
    return works._replace(functions=tuple(member.core.functions(count) for member in members))


def restore_functions(members: Sequence[Member], works: Works, count: int) -> None:
    """They are those of the present again."""
    for member, x in zip(members, works.functions):
        if x is not None:
            member.core.set_functions(count, x)


def resume(members: Sequence[Member], works: Works, step: int) -> None:
    """Let works that have been begun go on, where they are of the present state."""
    for member, x in zip(members, works.arrays if works.step == step else ()):
        if x is not None and _is_present(member, x):
            member.core.resume_works(x)


def _is_present(member: Member, x: np.ndarray) -> bool:
    """Whether their displacements are those of the state, at both time levels of double steps.

    Under "macro" the works add what multipliers change in another order: they differ by rounding.
    """
    levels = member.core.levels()
    u = [levels[name] for name in ("u", "previous_u") if name in levels]
    rounding = [ROUNDING * np.abs(y).max(initial=0.0) for y in u]
    return all(
        np.abs(level[: member.n] - y).max(initial=0.0) <= bound
        for level, y, bound in zip(np.split(x, 2), u, rounding)
    )


def to_arrays(members: Sequence[Member], works: Works, first: int) -> dict[str, np.ndarray]:
    """For a checkpoint, dofs in the user's order; `first` is the number of the first subdomain."""
    arrays = {}
    for i, (member, x) in enumerate(zip(members, works.arrays), first):
        if x is not None:
            arrays[f"{i}.works"] = x.copy()
            for part, order in _parts(member, arrays[f"{i}.works"]):
                part[:] = part[order]
    for i, (member, x) in enumerate(zip(members, works.functions), first):
        if x is not None:
            arrays[f"{i}.functions"] = x.reshape(2, -1)[:, member.position].ravel()
    return arrays


def of_arrays(
    members: Sequence[Member], arrays: Mapping[str, np.ndarray], first: int, step: int
) -> Works:
    """The inverse; ValueError for wrong arrays."""
    works: list[np.ndarray | None] = []
    functions: list[np.ndarray | None] = []
    for i, member in enumerate(members, first):
        x = arrays.get(f"{i}.works")
        if x is not None:
            if x.dtype != np.float64 or x.ndim != 1 or x.size % 2 or not np.isfinite(x).all():
                raise ValueError(f"{i}.works is not an array of finite numbers")
            x = x.copy()
            if x.size < 2 * (VECTORS * member.n + member.nb):
                raise ValueError(f"{i}.works has {x.size} numbers")
            for part, order in _parts(member, x):
                part[order] = part.copy()
        works.append(x)
        f = arrays.get(f"{i}.functions")
        if f is not None:
            if f.dtype != np.float64 or f.shape != (2 * member.n,) or not np.isfinite(f).all():
                raise ValueError(f"{i}.functions is not an array of {2 * member.n} finite numbers")
            f = f.reshape(2, -1)[:, member.order].ravel()
        functions.append(f)
    return Works(step, tuple(works), tuple(functions))


def _parts(member: Member, x: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The vectors of dofs, and for each dof in the user's order its position there."""
    n, nb = member.n, member.nb
    for level in np.split(x, 2):
        for k in range(VECTORS):
            yield level[k * n : (k + 1) * n], member.position
        pull = level[VECTORS * n : VECTORS * n + nb]
        yield pull, np.argsort(member.order[n - nb :])
