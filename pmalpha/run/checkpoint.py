"""The state of a coupler in a file, with a description of its problem.

A state is the arrays of all subdomains (`levels` of the core), the multipliers, the prescribed
velocities and the number of the macro step. Dofs and constraints are in the user's order, so that
the file does not depend on the elimination order.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy import LowLevelCallable

from .._checks import MOST, counted, listing
from ..files import read_npz, write_npz
from ..problem.forces import SampledForce
from ..setup.part import Part
from .motion import Motion

# In the header of the file.
FORMAT, VERSION = "pmalpha checkpoint", 1
# The arrays of a subdomain in the core at the present time level; a double-step subdomain has them
# at the previous time level as well.
FIELDS = ("u", "v", "w", "a", "vf", "springs", "history")
# Stiffness and damping of a restoring force, (R2).
ESTIMATES = ("restoring_stiffness", "restoring_damping")
# Number of differences that an error lists.
SHOWN = 6


# ---- the problem -----------------------------------------------------------------------------


def constants(
    options: Mapping[str, Any], parts: Sequence[Part], matrices: Sequence[sp.csc_array]
) -> dict[str, Any]:
    """The constant facts of a problem, by the name that an error shows.

    Parameters
    ----------
    options : dict
        The options of the coupler.
    parts : sequence of Part
    matrices : sequence of (p, n_i) csc_array
        L_i, in the user's order.
    """
    facts = {**options, "names": [part.name for part in parts], "conditions": matrices[0].shape[0]}
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
    """The loads of a problem, which `reset` can change. Callables cannot be compared."""
    facts = {f"force of {part.name!r}": load(force) for part, force in zip(parts, forces)}
    return facts | {motion.what: load(motion.velocity) for motion in motions}


def load(force: Any) -> str:
    """A description of a load; equal loads have equal descriptions."""
    if isinstance(force, SampledForce):
        shape = "" if force.shape is None else f", shape {checksum(force.shape)}"
        return f"{type(force).__name__} {checksum(force.values)}, dt {force.dt!r}{shape}"
    if isinstance(force, LowLevelCallable):
        return "a compiled function"
    if isinstance(force, tuple):
        # these words are in files of all versions; repr may change
        laws = (f"<{type(spring).__name__} x {len(spring)}>" for spring in force)
        return ", ".join(f"{law} {checksum(spring.numbers)}" for law, spring in zip(laws, force))
    return "a callable" if callable(force) else checksum(force)


def checksum(A: Any) -> str:
    """A checksum of shape and entries of a matrix or array."""
    if A is None:
        return "zero"
    arrays = [A]
    if sp.issparse(A):
        arrays = [A.indptr.astype(np.int64), A.indices.astype(np.int64), A.data]
    digest = hashlib.sha256(repr(A.shape).encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array))
    return f"checksum {digest.hexdigest()[:16]}"


def differences(saved: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """The facts that differ between the problem of a file and the one here."""
    return [
        f"{fact} ({saved.get(fact, 'not given')} in the file, {here.get(fact, 'not given')} here)"
        for fact in dict.fromkeys([*saved, *here])
        if saved.get(fact) != here.get(fact)
    ]


# ---- the state -------------------------------------------------------------------------------


def order_of(part: Part, name: str, x: np.ndarray) -> np.ndarray:
    """Order of the entries of x, those of the last eliminated dofs, by the user's numbers.

    The history variables of springs are in the user's order already.
    """
    if name.endswith("springs"):
        return np.arange(x.size)
    return np.argsort(part.order[part.n - x.size :])


def state_arrays(
    parts: Sequence[Part], core: Any, row_position: np.ndarray
) -> dict[str, np.ndarray]:
    """The state of a coupler by name, in the user's order."""
    arrays = {}
    for i, part in enumerate(parts):
        for name, x in zip(names(part), part.core.levels()):
            arrays[f"{i}.{name}"] = x[order_of(part, name, x)]
    arrays["multipliers"] = core.multipliers[row_position]
    arrays["prescribed"] = core.prescribed[row_position]
    return arrays


def names(part: Part) -> list[str]:
    return [*FIELDS, *(f"previous_{name}" for name in FIELDS if part.double)]


class CoreState(NamedTuple):
    """The state of a coupler in the core's order: arrays by subdomain, and (p,) arrays."""

    levels: list[tuple[np.ndarray, ...]]
    multipliers: np.ndarray
    prescribed: np.ndarray


def core_state(
    path: str | PathLike,
    arrays: Mapping[str, np.ndarray],
    parts: Sequence[Part],
    row_position: np.ndarray,
) -> CoreState:
    """The inverse of `state_arrays`; ValueError for missing or wrong arrays."""
    p = row_position.size
    try:
        states = [core_arrays(part, i, arrays) for i, part in enumerate(parts)]
        lam, g = np.empty((2, p))
        lam[row_position] = checked(arrays, "multipliers", p)
        g[row_position] = checked(arrays, "prescribed", p)
    except (LookupError, ValueError) as error:
        raise damaged(path, error) from None
    return CoreState(states, lam, g)


def core_arrays(part: Part, i: int, arrays: Mapping[str, np.ndarray]) -> tuple[np.ndarray, ...]:
    """The arrays of subdomain i for the core; ValueError for missing or wrong arrays."""
    state = []
    for name, present in zip(names(part), part.core.levels()):
        x = np.empty(present.size)
        x[order_of(part, name, x)] = checked(arrays, f"{i}.{name}", present.size)
        state.append(x)
    return tuple(state)


def checked(arrays: Mapping[str, np.ndarray], name: str, size: int) -> np.ndarray:
    x = arrays[name]
    if x.shape != (size,) or x.dtype != np.float64 or not np.all(np.isfinite(x)):
        raise ValueError(f"{name} is not an array of {counted(size, 'finite number')}")
    return x


# ---- files -----------------------------------------------------------------------------------


def write(
    path: str | PathLike, problem: Mapping[str, Any], step: int, arrays: Mapping[str, np.ndarray]
) -> None:
    header = {"format": FORMAT, "version": VERSION, "problem": dict(problem), "step_count": step}
    write_npz(path, header, arrays)


def read(path: str | PathLike, problem: Mapping[str, Any]) -> tuple[int, dict[str, np.ndarray]]:
    """Macro step and arrays of a file that `write` wrote for the same problem.

    Parameters
    ----------
    path : str or path
    problem : dict
        The facts of the problem here, from `constants` and `loads`.

    Raises
    ------
    OSError
        When there is no such file.
    ValueError
        For any other file, a damaged one, or another problem; the message lists what differs.
    """
    header, arrays = read_npz(path, FORMAT, VERSION)
    saved, step = header.get("problem"), header.get("step_count")
    if not isinstance(saved, dict) or type(step) is not int or not 0 <= step <= MOST:
        raise damaged(path, "its header is incomplete")
    found = differences(saved, problem)
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
