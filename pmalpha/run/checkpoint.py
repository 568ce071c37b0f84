"""The state of a coupler in a file, with a description of its problem.

A state is the arrays of all subdomains (`levels` of the core), the multipliers, the prescribed
velocities and the number of the macro step. Dofs and constraints are in the user's order, so that
the file does not depend on the elimination order.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import scipy.sparse as sp
from scipy import LowLevelCallable

import pmalpha._core as _core

from .._checks import MOST, counted, listing
from ..files import read_npz, write_npz
from ..memory import one_thread
from ..problem.device import Device
from ..problem.loads import as_load, depends_on_motion
from ..problem.matrices import checksum
from ..problem.restoring import devices_of
from ..problem.springs import Spring, Wheels
from ..results.stored import SHOWN, differences
from ..results.times import Clock
from ..setup.assembly import Assembly
from ..setup.contact_rows import Contacts
from ..setup.member import Member
from ..setup.rows import CoreRows
from ..setup.schedule import Options
from .motion import Motion

# In the header of the file.
FORMAT, VERSION = "pmalpha checkpoint", 1
# Stiffness and damping of a restoring force, (R2).
ESTIMATES = ("restoring_stiffness", "restoring_damping")
# Multipliers from which accelerations are recorded under mean coupling.
LINE = ("end_multipliers", "multipliers_before")
# Lengths of the last two macro steps under mean coupling.
LENGTHS = "lengths"
# What is added to the name of a checkpoint for that of a rank: macro step, token and rank.
OF_A_RANK = r"\.\d+\.[0-9a-f]{8}\.\d+"
# Bytes of the name of a file.
LONGEST_NAME = 255
# Numbers of the rows of contacts.
OF_CONTACTS = ("gap", "friction", "restitution")


# ---- the problem -----------------------------------------------------------------------------


def constants(
    options: Options,
    names: Sequence[str],
    p: int,
    members: Sequence[Member],
    matrices: Sequence[sp.csc_array],
    *,
    iterates: bool,
    contacts: Contacts | None = None,
) -> dict[str, Any]:
    """The constant facts of a problem, by the name that an error shows.

    names: of the subdomains of all processes.
    members: of this process.
    """
    same = {name for name, x in Options._field_defaults.items() if getattr(options, name) == x}
    same = same - {"newton"} if iterates else same | {"newton"}  # which nothing uses
    facts = {name: x for name, x in options.facts.items() if name not in same}
    facts |= {"names": list(names), "conditions": p}
    if len(names) == 1 and options.coupling == "gc":
        facts["coupling"] = "pm"  # the same; files of older versions have it
    for member, L in zip(members, matrices):
        s, of = member.subdomain, f"of {member.name!r}"
        scheme = s.scheme
        facts |= {
            f"dofs {of}": member.n,
            f"interface dofs {of}": member.nb,
            f"substeps {of}": member.substeps,
            f"double step {of}": member.double,
            f"scheme {of}": [*scheme.parameters, scheme.explicit],
        }
        facts |= {f"{x} {of}": checksum(getattr(s, x)) for x in (*"MKC", *ESTIMATES)}
        facts[f"damping {of}"] = s.damping
        if s.internal is not None:
            facts[f"internal forces {of}"] = internal(member)
        facts[f"restoring {of}"] = "none" if s.restoring is None else load(s.restoring)
        facts[f"conditions on {member.name!r}"] = checksum(sp.csr_array(L))
    if contacts is not None:
        facts |= {
            f"rows of contacts on {members[i].name!r}": checksum(N) for i, N in contacts.N.items()
        }
        facts |= {f"{x} of contacts": checksum(contacts.numbers(x)) for x in OF_CONTACTS}
        static = contacts.numbers("friction_static")
        if np.any(static != contacts.numbers("friction")):  # older versions lack it
            facts["friction_static of contacts"] = checksum(static)
    return facts


def loads(
    members: Sequence[Member], forces: Sequence[Any], motions: Sequence[Motion]
) -> dict[str, str]:
    """The loads of a problem, which `reset` can change. Callables cannot be compared."""
    facts = {
        f"force of {member.name!r}": load(force) + depends_on_motion(force) * " of t, u and v"
        for member, force in zip(members, forces)
    }
    return facts | {motion.what: load(motion.velocity) for motion in motions}


def load(force: Any) -> str:
    """A description of a load; equal loads have equal descriptions."""
    if isinstance(force, Device):
        return f"{force.facts} of {load(force.specimen)}"
    if isinstance(force, tuple) and not isinstance(force, LowLevelCallable):
        return ", ".join(load(item) for item in force)
    if isinstance(force, Spring):
        # these words are in files of all versions; repr may change
        return f"<{type(force).__name__} x {len(force)}> {checksum(force.numbers)}"
    if isinstance(force, Wheels):
        return f"<{type(force.spring).__name__} that move> {checksum(force.numbers)}"
    return checksum(force) if force is None else as_load(force)._facts()


def internal(member: Member) -> str:
    """A description of internal forces: their springs, pattern and history; not the functions."""
    forces, argument = member.internal, member.subdomain.internal
    assert forces is not None and argument is not None
    springs = load(argument.springs)
    sizes = [force.history.size for force in argument.forces]
    count = counted(len(sizes), "function") + (f" with {sizes} numbers of history" if sizes else "")
    where = checksum(forces.pattern)
    return ", ".join(x for x in (springs, count, f"pattern {where}", checksum(forces.initial)) if x)


# ---- the state -------------------------------------------------------------------------------


def order_of(member: Member, name: str, x: np.ndarray) -> np.ndarray:
    """Order of the entries of x, those of the last eliminated dofs, by the user's numbers.

    What springs and internal forces remember is in the user's order already.
    """
    if name.endswith(("springs", "history")):
        return np.arange(x.size)
    return np.argsort(member.order[member.n - x.size :])


def state_arrays(assembly: Assembly, rows: CoreRows, options: Options) -> dict[str, np.ndarray]:
    """The state of a coupler with these options, by name, in the user's order.

    Subdomains have their numbers among those of all processes.
    """
    arrays, p, core = {}, rows.p, assembly.core
    for i, member in enumerate(assembly.members, assembly.first):
        for name, x in member.core.levels().items():
            if x.size or not name.endswith("history"):
                arrays[f"{i}.{name}"] = x[order_of(member, name, x)]
        if (iteration := member.core.iteration()) is not None:
            entries, twice = iteration["entries"], float(iteration["twice"])
            has_tangent = float(entries is not None)
            arrays[f"{i}.iteration"] = np.array([iteration["scale"], has_tangent, twice])
            if entries is not None:
                arrays[f"{i}.tangent"] = entries[places_of(member)]
    numbers = core.numbers()
    if "shooting" in numbers:
        arrays["shooting"] = reordered(numbers["shooting"], rows.position, rows.scale)
    if options.coupling == "mean":
        *line, arrays[LENGTHS] = np.split(numbers["end_multipliers"], [p, 2 * p])
        for name, lam in zip(LINE, line):
            arrays[name] = rows.forces(lam)
    if "contact" in numbers:
        arrays["contacts"] = numbers["contact"]
    arrays["multipliers"] = rows.forces(numbers["multipliers"])
    arrays["prescribed"] = rows.jumps(numbers["prescribed"])
    if "moved" in numbers:
        arrays["moved"] = rows.jumps(numbers["moved"])
    return arrays


# What the iteration of a subdomain keeps: scale, entries of a tangent, and whether they are of the
# double step.
Iteration: TypeAlias = dict[str, Any]


class CoreState(NamedTuple):
    """The state of a coupler in the core's order, by the names that the core has for its arrays."""

    levels: list[dict[str, np.ndarray]]  # of each subdomain
    iterations: list[Iteration | None]
    numbers: dict[str, np.ndarray]


def core_state(
    path: str | PathLike[str],
    arrays: Mapping[str, np.ndarray],
    assembly: Assembly,
    rows: CoreRows,
    options: Options,
) -> CoreState:
    """The inverse of `state_arrays`; ValueError for missing or wrong arrays, and for numbers that
    the core counts with and that are no counts."""
    p, numbers = rows.p, assembly.core.numbers()
    members = list(enumerate(assembly.members, assembly.first))
    try:
        states = [core_arrays(member, i, arrays) for i, member in members]
        iterations = [core_iteration(member, i, arrays) for i, member in members]
        if "shooting" in numbers:
            shooting = checked(arrays, "shooting", numbers["shooting"].size)
            scale = 1.0 / rows.scale[rows.numbers]
            numbers["shooting"] = reordered(shooting, rows.numbers, scale)
        line, lengths = list(np.zeros((2, p))), np.zeros(2)
        if options.coupling == "mean":
            line = [rows.forces_in_core(checked(arrays, name, p)) for name in LINE]
            lengths = checked(arrays, LENGTHS, 2)
        numbers["end_multipliers"] = np.concatenate([*line, lengths])
        if "contact" in numbers:
            numbers["contact"] = contacts_of(arrays, numbers["contact"].size)
        numbers["multipliers"] = rows.forces_in_core(checked(arrays, "multipliers", p))
        numbers["prescribed"] = rows.jumps_in_core(checked(arrays, "prescribed", p))
        if "moved" in numbers:  # files of before version 0.4 lack it
            moved = checked(arrays, "moved", p) if "moved" in arrays else np.zeros(p)
            numbers["moved"] = rows.jumps_in_core(moved)
        for (_, member), levels in zip(members, states):
            member.core.check_levels(levels)
        assembly.core.check_numbers(numbers)
    except (LookupError, ValueError) as error:
        raise damaged(path, error) from None
    return CoreState(states, iterations, numbers)


def contacts_of(arrays: Mapping[str, np.ndarray], size: int) -> np.ndarray:
    """What the core has of contacts; files of before version 0.4 have no sums of impulses, the last
    of its numbers."""
    x = arrays["contacts"]
    if x.ndim == 1 and x.size < size:
        arrays = {"contacts": np.concatenate([x, np.zeros(size - x.size)])}
    return checked(arrays, "contacts", size)


def core_arrays(member: Member, i: int, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of subdomain i for the core; ValueError for missing or wrong arrays."""
    levels = member.core.levels()
    for name, x in levels.items():
        if not x.size and name.endswith("history"):
            continue
        if name.endswith("springs") and devices_of(member.subdomain.restoring):
            check_rigs(arrays, f"{i}.{name}", x.size)
        x[order_of(member, name, x)] = checked(arrays, f"{i}.{name}", x.size)
    return levels


def check_rigs(arrays: Mapping[str, np.ndarray], name: str, size: int) -> None:
    """ValueError for what version 0.3 kept of actuators and compensators, without commands."""
    if arrays[name].size < size:
        raise ValueError(
            f"{name} has {counted(arrays[name].size, 'number')}, {size} are needed: version 0.3 "
            "kept fewer for simulated actuators and compensators, and only it continues such a run"
        )


def core_iteration(member: Member, i: int, arrays: Mapping[str, np.ndarray]) -> Iteration | None:
    """What the iteration of subdomain i continues with, for the core; None if it is linear."""
    if member.tangent is None:
        return None
    scale, has_tangent, twice = checked(arrays, f"{i}.iteration", 3)
    size = member.tangent.pattern.nnz
    tangent = None
    if has_tangent:
        tangent = np.empty(size)
        tangent[places_of(member)] = checked(arrays, f"{i}.tangent", size)
    return {"scale": float(scale), "entries": tangent, "twice": bool(twice)}


def places_of(member: Member) -> np.ndarray:
    """Where the values of a tangent in the user's order of dofs are in that of the core."""
    assert member.tangent is not None and member.internal is not None
    return member.tangent.places(member.internal.pattern)


def reordered(shooting: np.ndarray, rows: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """What shooting continues with, with the constraints in another order and times `scale`, so
    that multipliers are divided by it.

    Its first numbers are a scale and the increment of the multipliers. Up to 500 constraints a
    matrix follows, for more a number and pairs of vectors.
    """
    p = rows.size
    head, rest = shooting[:1], shooting[1 + p :]
    if rest.size == p * p:
        B = rest.reshape(p, p)[np.ix_(rows, rows)]  # of jumps it makes multipliers
        tail = (B / scale[:, None] / scale).ravel()
    else:
        pairs = rest[1:].reshape(-1, 2, p)[:, :, rows]  # x += a (s . x)
        pairs = np.stack([pairs[:, 0] / scale, pairs[:, 1] * scale], axis=1)
        tail = np.concatenate([rest[:1], pairs.ravel()])
    return np.concatenate([head, shooting[1 : 1 + p][rows] / scale, tail])


def checked(arrays: Mapping[str, np.ndarray], name: str, size: int) -> np.ndarray:
    x = arrays[name]
    if x.shape != (size,) or x.dtype != np.float64 or not np.all(np.isfinite(x)):
        raise ValueError(f"{name} is not an array of {counted(size, 'finite number')}")
    return x


def restore(
    state: CoreState, members: Sequence[Member], core: _core.Coupler, clock: Clock, step: int
) -> None:
    """Set a state in the core, at this macro step of the clock.

    Raises ValueError for a kept tangent that is singular; the state is then unchanged.
    """
    set_iterations(state.iterations, members)
    for member, levels in zip(members, state.levels):
        member.core.set_levels(levels)
    core.set_origin(clock.origin, clock.t0)
    core.start(step, state.numbers["multipliers"], state.numbers["prescribed"])
    core.set_numbers(state.numbers)


def set_iterations(iterations: Sequence[Iteration | None], members: Sequence[Member]) -> None:
    iterated = [(member, new) for member, new in zip(members, iterations) if new is not None]
    before = [member.core.iteration() for member, _ in iterated]
    with one_thread():  # the core factors kept tangents
        try:
            for member, new in iterated:
                member.core.set_iteration(new)
        except (RuntimeError, ValueError) as error:
            for (member, _), old in zip(iterated, before):
                assert old is not None  # as the new one
                member.core.set_iteration(old)
            raise ValueError(f"a kept tangent is singular: {error}") from None


# ---- files -----------------------------------------------------------------------------------


def write(
    path: str | PathLike[str],
    problem: Mapping[str, Any],
    step: int,
    arrays: Mapping[str, np.ndarray],
    steps: Mapping[str, Any] | None,
) -> None:
    """Write a state; `steps` are those of the coupler if they have changed."""
    header = {"format": FORMAT, "version": VERSION, "problem": dict(problem), "step_count": step}
    write_npz(path, header if steps is None else header | {"steps": dict(steps)}, arrays)


def write_master(path: Path, files: Sequence[str], first: Sequence[int]) -> None:
    """Write the file that leads to those of several processes, and remove those of older states
    and of saves that were interrupted: files of this name with what `snapshot.save` adds.

    first: the number of the first subdomain of each rank, and the number of all.
    """
    pattern = re.escape(path.name) + OF_A_RANK
    older = [x.name for x in path.parent.iterdir() if re.fullmatch(pattern, x.name)]
    header = {"format": FORMAT, "version": VERSION, "files": list(files), "first": list(first)}
    write_npz(path, header, {})
    for name in older:
        if name not in files:
            path.with_name(name).unlink(missing_ok=True)


def read(
    path: str | PathLike[str], problem: Mapping[str, Any], numbers: range
) -> tuple[int, dict[str, np.ndarray], dict[str, Any] | None]:
    """Macro step, arrays and changed steps of a file that was written for the same problem.

    numbers: those of the subdomains of this process among all: the others are not read.
    """
    header, arrays = read_npz(path, FORMAT, VERSION)
    if "files" in header:
        header, arrays = _of_ranks(path, header, numbers)
    saved, step = header.get("problem"), header.get("step_count")
    if not isinstance(saved, dict) or type(step) is not int or not 0 <= step <= MOST:
        raise damaged(path, "its header is incomplete")
    elsewhere = [name for i, name in enumerate(problem["names"]) if i not in numbers]
    facts = differences(saved, problem, elsewhere)
    if facts:
        raise ValueError(
            "path must lead to a checkpoint of the same problem, but in "
            f"{str(path)!r} these differ: {listing(facts, SHOWN)}"
        )
    return step, arrays, header.get("steps")


def _of_ranks(
    path: str | PathLike[str], master: Mapping[str, Any], numbers: range
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of those files beside a master that have these subdomains."""
    files: Any = master["files"]
    first: Any = master.get("first")
    is_complete = (
        isinstance(files, list) and isinstance(first, list) and len(first) == len(files) + 1
    )
    if not (is_complete and files and all(type(number) is int for number in first)):
        raise damaged(path, "its header is incomplete")
    if not all(map(_is_file_name, files)):
        raise damaged(path, f"it must lead to files in its folder, got {files}")
    has = enumerate(pairwise(first))
    wanted = [k for k, (a, b) in has if max(a, numbers.start) < min(b, numbers.stop)] or [0]
    contents = [read_npz(Path(path).with_name(files[k]), FORMAT, VERSION) for k in wanted]
    header: dict[str, Any] = dict(contents[0][0], problem={})
    arrays: dict[str, np.ndarray] = {}
    for other, theirs in contents:
        if not isinstance(other.get("problem"), dict):
            raise damaged(path, "a file next to it has no description of the problem")
        if any(other.get(fact) != header.get(fact) for fact in ("step_count", "steps")):
            raise damaged(path, "the files next to it are of different macro steps")
        header["problem"] |= other["problem"]
        arrays |= theirs
    return header, arrays


def _is_file_name(x: Any) -> bool:
    """Whether it is a name that a file in a folder can have."""
    try:
        return Path(x).name == x != "" and "\0" not in x and len(os.fsencode(x)) <= LONGEST_NAME
    except (TypeError, UnicodeEncodeError):
        return False


def damaged(path: str | PathLike[str], reason: object) -> ValueError:
    return ValueError(
        f"path must lead to a whole file of format {FORMAT!r}, {str(path)!r}: {reason}"
    )
