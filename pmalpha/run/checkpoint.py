"""The state of a coupler in a file, with what tells its problem from another.

A state is what `nodes` of the core's subdomains hold, the multipliers, the prescribed velocities
and the number of the macro step. It is kept in the user's order of dofs and conditions, so that a
file outlives the choice of an elimination order.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy import LowLevelCallable

from .._checks import MOST, listing
from ..files import read_npz, write_npz
from ..problem.forces import SampledForce
from ..setup.part import Part
from .motion import Motion

# What a file that holds a state says of itself.
FORMAT, VERSION = "pmalpha checkpoint", 1
# The arrays of `nodes` of the core, for the present and for the own node before it.
FIELDS = ("u", "v", "w", "a", "vf", "springs")
# Of a restoring force the stiffness and the damping.
ESTIMATES = ("restoring_stiffness", "restoring_damping")
# More differences than these are counted only.
SHOWN = 6


# ---- the problem -----------------------------------------------------------------------------


def constants(
    words: Mapping[str, Any], parts: Sequence[Part], matrices: Sequence[sp.csc_array]
) -> dict[str, Any]:
    """All of a problem that never changes, each fact under the name an error calls it by.

    Parameters
    ----------
    words : dict
        The options of the coupler.
    parts : sequence of Part
    matrices : sequence of (p, n_i) csc_array
        L_i, in the user's order.
    """
    facts = {**words, "names": [part.name for part in parts], "conditions": matrices[0].shape[0]}
    for part, L in zip(parts, matrices):
        s, of = part.subdomain, f"of {part.name!r}"
        scheme = s.scheme
        facts |= {
            f"dofs {of}": part.n,
            f"interface dofs {of}": part.nb,
            f"substeps {of}": s.substeps,
            f"double step {of}": part.double,
            f"scheme {of}": [scheme.am, scheme.af, scheme.beta, scheme.gamma, scheme.explicit],
        }
        facts |= {f"{x} {of}": checksum(getattr(s, x)) for x in (*"MKC", *ESTIMATES)}
        facts[f"damping {of}"] = s.damping
        facts[f"restoring {of}"] = "none" if s.restoring is None else load(s.restoring)
        facts[f"conditions on {part.name!r}"] = checksum(sp.csr_array(L))
    return facts


def loads(
    parts: Sequence[Part], forces: Sequence[Any], motions: Sequence[Motion]
) -> dict[str, str]:
    """The loads of a problem, which `reset` can change. Of a callable only that it is one."""
    facts = {f"force of {part.name!r}": load(force) for part, force in zip(parts, forces)}
    return facts | {motion.what: load(motion.velocity) for motion in motions}


def load(force: Any) -> str:
    if isinstance(force, SampledForce):
        shape = "" if force.shape is None else f", shape {checksum(force.shape)}"
        return f"{type(force).__name__} {checksum(force.values)}, dt {force.dt!r}{shape}"
    if isinstance(force, LowLevelCallable):
        return "a compiled function"
    if isinstance(force, tuple):
        return ", ".join(f"{spring!r} {checksum(spring.numbers)}" for spring in force)
    return "a callable" if callable(force) else checksum(force)


def checksum(A: Any) -> str:
    """A word that two matrices or arrays share only when all their entries are equal."""
    if A is None:
        return "zero"
    arrays = [A]
    if sp.issparse(A):
        arrays = [A.indptr.astype(np.int64), A.indices.astype(np.int64), A.data]
    digest = hashlib.sha256(repr(A.shape).encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array))
    return f"checksum {digest.hexdigest()[:16]}"


def differences(theirs: Mapping[str, Any], ours: Mapping[str, Any]) -> list[str]:
    """What differs between the problem of a file and the one here."""
    return [
        f"{fact} ({theirs.get(fact, 'not given')} in the file, {ours.get(fact, 'not given')} here)"
        for fact in dict.fromkeys([*theirs, *ours])
        if theirs.get(fact) != ours.get(fact)
    ]


# ---- the state -------------------------------------------------------------------------------


def order_of(part: Part, name: str, x: np.ndarray) -> np.ndarray:
    """Places of the entries of x, which belong to the last dofs of the elimination order.

    What springs remember is in the user's order already.
    """
    if name.endswith("springs"):
        return np.arange(x.size)
    return np.argsort(part.order[part.n - x.size :])


def state_arrays(parts: Sequence[Part], core: Any, row_place: np.ndarray) -> dict[str, np.ndarray]:
    """The state of a coupler by name, in the user's order."""
    arrays = {}
    for i, part in enumerate(parts):
        for name, x in zip(names(part), part.core.levels()):
            arrays[f"{i}.{name}"] = x[order_of(part, name, x)]
    arrays["multipliers"] = core.multipliers[row_place]
    arrays["prescribed"] = core.prescribed[row_place]
    return arrays


def names(part: Part) -> list[str]:
    return [*FIELDS, *(f"previous_{name}" for name in FIELDS if part.double)]


class CoreState(NamedTuple):
    """The state of a coupler as the core takes it: nodes by subdomain, and (p,) arrays."""

    nodes: list[tuple[np.ndarray, ...]]
    multipliers: np.ndarray
    prescribed: np.ndarray


def core_state(
    path: str | PathLike,
    arrays: Mapping[str, np.ndarray],
    parts: Sequence[Part],
    row_place: np.ndarray,
) -> CoreState:
    """The inverse of `state_arrays`; ValueError for what does not fit."""
    p = row_place.size
    try:
        nodes = [core_nodes(part, i, arrays) for i, part in enumerate(parts)]
        lam, g = np.empty((2, p))
        lam[row_place] = checked(arrays, "multipliers", p)
        g[row_place] = checked(arrays, "prescribed", p)
    except (LookupError, ValueError) as error:
        raise damaged(path, error) from None
    return CoreState(nodes, lam, g)


def core_nodes(part: Part, i: int, arrays: Mapping[str, np.ndarray]) -> tuple[np.ndarray, ...]:
    """The nodes of a subdomain; ValueError for what does not fit."""
    nodes = []
    for name, mine in zip(names(part), part.core.levels()):
        x = np.empty(mine.size)
        x[order_of(part, name, x)] = checked(arrays, f"{i}.{name}", mine.size)
        nodes.append(x)
    return tuple(nodes)


def checked(arrays: Mapping[str, np.ndarray], name: str, size: int) -> np.ndarray:
    x = arrays[name]
    if x.shape != (size,) or x.dtype != np.float64 or not np.all(np.isfinite(x)):
        raise ValueError(f"{name} is not {size} finite numbers")
    return x


# ---- files -----------------------------------------------------------------------------------


def write(
    path: str | PathLike, problem: Mapping[str, Any], step: int, arrays: Mapping[str, np.ndarray]
) -> None:
    header = {"format": FORMAT, "version": VERSION, "problem": dict(problem), "step_count": step}
    write_npz(path, header, arrays)


def read(path: str | PathLike, problem: Mapping[str, Any]) -> tuple[int, dict[str, np.ndarray]]:
    """Macro step and arrays of a file that `write` wrote for the same problem.

    Raises
    ------
    OSError
        When there is no such file.
    ValueError
        For any other file, a damaged one, or another problem, saying what differs.
    """
    header, arrays = read_npz(path, FORMAT, VERSION)
    theirs, step = header.get("problem"), header.get("step_count")
    if not isinstance(theirs, dict) or type(step) is not int or not 0 <= step <= MOST:
        raise damaged(path, "its header is not whole")
    found = differences(theirs, problem)
    if found:
        raise ValueError(
            "path must lead to a checkpoint of the same problem, but in "
            f"{str(path)!r} these differ: {listing(found, SHOWN)}"
        )
    return step, arrays


def damaged(path: str | PathLike, reason: object) -> ValueError:
    return ValueError(
        f"path must lead to a whole file of format {FORMAT!r}, {str(path)!r}: {reason}"
    )
