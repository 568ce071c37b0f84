"""The table of what a run records: all arrays of a History, by name.

What is recorded, allocated, written to files and described there, read, continued, joined,
converted and drawn follows from it; nothing is inferred from a name or a unit. A new quantity is a
line here, a field of `SubdomainHistory` or `History`, and what computes it: a function in the line,
or the core. Units are in terms of those of the problem: u and t, and F for forces.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, NoReturn, TypeVar

import numpy as np

from .._checks import counted
from ..problem.dofs import dof_list, names_at
from ..problem.restoring import devices_of
from ..problem.subdomain import Subdomain
from ..setup.member import Member

# The times of rows, by their axis; under "mean", whose interface problems are those of macro steps,
# the fine steps are the macro steps.
TIMES = {
    "levels": "t",
    "fine": "multiplier_times",
    "middles": "multiplier_times",
    "macro": "macro_times",
    "": "",
}
Record = TypeVar("Record", bound=Any)
WORKS = "works count from the beginning of a run, and the chains of a double step begin there anew"
# Times are equal up to the rounding of two ways to compute them.
ROUNDING = 1e-12


class Quantity(NamedTuple):
    """An array of a History."""

    # of what its columns are, such as "dofs", of `column_counts`; "" for an array without
    columns: str
    # what, unit: its description in files
    what: str
    unit: str
    # {"levels", "fine", "middles", "macro", ""}, the times of its rows: time levels of the
    # subdomain; ends of the fine steps; the same, under "mean" the middles of macro steps; macro
    # time levels. "" for an array without, the numbers of the columns
    axis: str = "levels"
    # {"cubic", "linear", "sum", ""}, what it is between two rows: the motion, by its derivatives;
    # linear; a sum since the row before, which grows evenly. "": it has no value there
    between: str = ""
    is_state: bool = False  # finite in every run. Others are sums of products.
    is_count: bool = False  # whole numbers; one column is then an array of one dimension
    # {"forces", "jumps", ""}, the method of `CoreRows` that makes the constraints of the user of
    # those of the core; "" where columns are not constraints
    rows: str = ""
    # ``made(recording, end, filled)``, the array up to macro step `end`; `filled` are those of the
    # core, with the constraints of the user. None: the core fills it
    made: Callable[[Any, int, Mapping[str, np.ndarray]], np.ndarray] | None = None
    label: str = ""  # of an axis in figures; "" for an array without a panel
    # the motion whose violation of the constraints it is: rounding errors of it are not drawn
    jump_of: str = ""


# ---- the table -----------------------------------------------------------------------------------

OF_SUBDOMAIN = {
    "t": Quantity("", "times of the time levels", "t", is_state=True),
    "u": Quantity(
        "dofs",
        "displacement, a row for each time level, a column for each recorded dof",
        "u",
        between="cubic",
        is_state=True,
        label="displacement",
    ),
    "v": Quantity(
        "dofs", "velocity, as u", "u/t", between="cubic", is_state=True, label="velocity"
    ),
    "a": Quantity(
        "dofs", "acceleration, as u", "u/t^2", between="cubic", is_state=True, label="acceleration"
    ),
    "dofs": Quantity("", "the recorded dofs, from 0", "1", axis="", is_state=True),
    "deformation": Quantity(
        "springs", "deformation of springs, a row for each time level", "u", between="linear"
    ),
    "force": Quantity("springs", "force of springs, as deformation", "F", between="linear"),
    "springs": Quantity("", "the recorded springs, from 0", "1", axis=""),
    "iterations": Quantity("iterated", "Newton iterations of each substep", "1", is_count=True),
    "q": Quantity(
        "memory", "history of internal forces, a row for each time level", "any", is_state=True
    ),
    "rig_command": Quantity("commands", "commands of the structure to its rig", "u"),
    "rig_sent": Quantity("commands", "what compensation makes of them, as rig_command", "u"),
    "rig_measured": Quantity("commands", "displacements measured, as rig_command", "u"),
    "rig_force": Quantity("commands", "forces of the rig, as rig_command", "F"),
}
OF_INTERFACE = {
    "multipliers": Quantity(
        "constraints",
        "interface forces, a column for each constraint",
        "F",
        "middles",
        "linear",
        is_state=True,
        rows="forces",
        label="multiplier",
    ),
    "multiplier_times": Quantity(
        "",
        "times of multipliers",
        "t",
        "middles",
        is_state=True,
        made=lambda recording, end, filled: recording.multiplier_times(end),
    ),
    "velocity_jump": Quantity(
        "constraints",
        "violation of the velocity constraints, as multipliers",
        "u/t",
        "fine",
        "linear",
        rows="jumps",
        label="velocity\njump",
        jump_of="v",
    ),
    "contact_impulses": Quantity(
        "contact rows", "impulses of contacts since the row before", "F t", "fine", "sum"
    ),
    "contact_gaps": Quantity(
        "contacts", "gaps of contacts, as contact_impulses", "u", "fine", "linear"
    ),
    "displacement_jump": Quantity(
        "constraints",
        "displacement drift, a column for each constraint",
        "u",
        "macro",
        "linear",
        rows="jumps",
        label="displacement\njump",
        jump_of="u",
    ),
    "macro_times": Quantity(
        "",
        "times of displacement_jump and of the energies",
        "t",
        "macro",
        is_state=True,
        made=lambda recording, end, filled: recording.times(1, end),
    ),
    "substeps": Quantity(
        "subdomains",
        "substeps in the macro step that ends at macro_times, by subdomain",
        "1",
        "macro",
        is_count=True,
        made=lambda recording, end, filled: recording.substeps(end),
    ),
}


def column_counts(
    member: Member, dofs: np.ndarray, springs: np.ndarray | None, rig: bool
) -> dict[str, int | None]:
    """Numbers of columns of what the core records of a subdomain, None where it does not."""
    internal = member.internal
    memory = None
    if internal is not None and internal.initial.size and dofs.size == member.n:
        memory = internal.initial.size
    return {
        "dofs": dofs.size,
        "springs": None if springs is None else springs.size,
        "iterated": None if internal is None or member.tangent is None else 1,
        "memory": memory,
        "commands": commands_of(member) if rig else None,
    }


def commands_of(member: Member) -> int | None:
    """Number of commands to the rigs of a subdomain, None where it has none."""
    devices = devices_of(member.subdomain.restoring)
    return sum(member.n if x.width is None else x.width for x in devices) if devices else None


# ---- what is made of it --------------------------------------------------------------------------


def by_columns(table: Mapping[str, Quantity]) -> dict[str, list[str]]:
    """The names of the quantities, by their columns."""
    names: dict[str, list[str]] = {}
    for name, x in table.items():
        names.setdefault(x.columns, []).append(name)
    return names


IN_SUBDOMAIN, IN_INTERFACE = by_columns(OF_SUBDOMAIN), by_columns(OF_INTERFACE)


def table_of(record: Any) -> dict[str, Quantity]:
    """The table of a `History` or a `SubdomainHistory`."""
    return OF_SUBDOMAIN if hasattr(record, "dofs") else OF_INTERFACE


def arrays_of(record: Any) -> dict[str, np.ndarray]:
    """The arrays of a `History` or a `SubdomainHistory` that are there, without outputs."""
    pairs = ((name, getattr(record, name)) for name in table_of(record))
    return {name: x for name, x in pairs if x is not None}


def growing(record: Any) -> dict[str, np.ndarray]:
    """Those with a row for each time level."""
    table = table_of(record)
    return {name: x for name, x in arrays_of(record).items() if table[name].axis}


def times_name(quantity: Quantity, coupling: str | None) -> str:
    """The name of the array with the times of its rows, "" for an array without.

    coupling: that of the History; None, of files of older versions, is no mean coupling.
    """
    fine_is_macro = coupling == "mean" and quantity.axis == "fine"
    return TIMES["macro" if fine_is_macro else quantity.axis]


def in_units(quantity: Quantity, units: Mapping[str, str]) -> str | None:
    """The unit of a quantity where u, t and F have these units; None where it does not follow."""
    symbols = set(re.findall("[A-Za-z]+", quantity.unit))
    if not symbols or not symbols <= units.keys():
        return None
    powers = re.sub(r"\^(\d+)", r"$^\1$", quantity.unit)
    return re.sub("[A-Za-z]+", lambda symbol: units[symbol[0]], powers)


def times_of(history: Any, name: str) -> np.ndarray:
    """The times of the rows of an array of the interface of a History."""
    times: np.ndarray = getattr(history, times_name(OF_INTERFACE[name], history.coupling))
    return times


def with_rows(record: Record, change: Callable[..., np.ndarray], *records: Record) -> Record:
    """The record with ``change(x, ...)`` for each array x with rows and those of further records.

    An array that one of the records lacks is None.
    """
    several = [growing(one) for one in (record, *records)]
    fields: dict[str, Any] = {
        name: change(*(arrays[name] for arrays in several))
        if all(name in x for x in several)
        else None
        for name in several[0]
    }
    if hasattr(record, "outputs"):
        fields["outputs"] = {
            name: change(*(one.outputs[name] for one in (record, *records)))
            for name in record.outputs
        }
    return replace(record, **fields)


def with_dofs(s: Record, dofs: np.ndarray) -> Record:
    """Some dofs of the motion of a subdomain; what internal forces remember only with all."""
    fields: dict[str, Any] = {x: getattr(s, x)[:, dofs] for x in IN_SUBDOMAIN["dofs"]}
    if dofs.size < s.dofs.size:
        fields |= dict.fromkeys(IN_SUBDOMAIN["memory"])
    return replace(s, **fields, dofs=dofs.copy(), dof_names=names_at(s.dof_names, dofs))


def reduced(
    history: Any, rows: Callable[[np.ndarray], np.ndarray], dofs: Sequence[np.ndarray | None]
) -> Any:
    """Some rows of all arrays of a History, with these dofs of each subdomain, None for none."""
    subdomains = tuple(
        None if s is None or numbers is None else with_dofs(with_rows(s, rows), numbers)
        for s, numbers in zip(history.subdomains, dofs)
    )
    energy = history.energy and history.energy._with_rows(rows)
    return replace(with_rows(history, rows), subdomains=subdomains, energy=energy)


def joined(pieces: Sequence[Any]) -> Any:
    pieces = tuple(pieces)
    if not pieces:
        raise ValueError("pieces must be at least one History, got none")
    if len(pieces) > 1 and any(piece.energy for piece in pieces):
        raise ValueError(f"pieces must have no energies: {WORKS}")
    history = pieces[0]
    for i, piece in enumerate(pieces[1:], start=1):
        if _content(history) != _content(piece):
            raise ValueError(
                "pieces must have the same subdomains, recorded dofs, springs and outputs, and "
                f"constraints, piece {i} differs from those before"
            )
        _check_times(history.macro_times, piece.macro_times, i)
        history = stacked([history, _without_common_row(history, piece)])
    return history


def _content(piece: Any) -> list[Any]:
    recorded = [
        None
        if s is None
        else (
            s.dofs.tolist(),
            None if s.springs is None else np.asarray(s.springs).tolist(),
            [(name, x.shape[1]) for name, x in s.outputs.items()],
        )
        for s in piece.subdomains
    ]
    names = [name for name, _ in piece.keys]
    return [names, recorded, piece.multipliers.shape[1], [x[:3] for x in piece.contact_layout]]


def _check_times(first: np.ndarray, second: np.ndarray, i: int) -> None:
    """ValueError unless the second begins where the first ends.

    With ``every`` the end of a run is recorded only if it is a multiple: then the second begins
    within less than a recorded interval after the last row.
    """
    later = second[0] - first[-1]
    largest = max(np.max(np.diff(t), initial=0.0) for t in (first, second))
    rounding = ROUNDING * abs(first[-1])
    if later < -rounding or (later > rounding and not later < (1.0 - 1e-6) * largest):
        raise ValueError(
            f"pieces must be consecutive, piece {i} begins at t = {second[0]:g} where the one "
            f"before ends at t = {first[-1]:g}"
        )


def _without_common_row(first: Any, second: Any) -> Any:
    """The second without its first rows, if they are at the last time level of the first."""
    common = second.macro_times[0] - first.macro_times[-1] <= ROUNDING * first.macro_times[-1]
    if not common:
        return second
    return with_rows_of_all(lambda x: x[1:], second)


def stacked(pieces: Sequence[Any]) -> Any:
    """The rows of all pieces, one after the other, without energies."""
    history = with_rows_of_all(lambda *x: np.concatenate(x), *pieces)
    subdomains = [
        s and replace(s, substep=s.substep if len({x.substep for x in motions}) == 1 else None)
        for s, *motions in zip(history.subdomains, *(piece.subdomains for piece in pieces))
    ]
    dt = history.dt if len({piece.dt for piece in pieces}) == 1 else None
    return replace(history, subdomains=tuple(subdomains), dt=dt, energy=NO_ENERGY)


def with_rows_of_all(change: Callable[..., np.ndarray], *pieces: Any) -> Any:
    """The first History with ``change(x, ...)`` for each array of those of all of them."""
    subdomains = [
        motions[0] and with_rows(motions[0], change, *motions[1:])
        for motions in zip(*(piece.subdomains for piece in pieces))
    ]
    first = with_rows(pieces[0], change, *pieces[1:])
    return replace(first, subdomains=tuple(subdomains))


def recorded_columns(
    member: Member, dofs: np.ndarray | None, springs: np.ndarray | None, rig: bool
) -> dict[str, int]:
    """The number of columns of each array that the core records of a subdomain."""
    if dofs is None:
        return {}
    counts = column_counts(member, dofs, springs, rig)
    known = ((x, count) for x, count in counts.items() if count is not None)
    return {name: count for x, count in known for name in IN_SUBDOMAIN[x]}


# ---- keys ---------------------------------------------------------------------------------------
# Subdomains of a coupler by name, by index or by the object.


def position(key: str | int | Subdomain, keys: Sequence[tuple[str, Subdomain | None]]) -> int:
    """Index of a subdomain given by name, object or index; KeyError or IndexError."""
    for i, (name, subdomain) in enumerate(keys):
        if (isinstance(key, str) and key == name) or (key is subdomain and key is not None):
            return i
    if isinstance(key, (int, np.integer)) and not isinstance(key, bool):
        if -len(keys) <= key < len(keys):
            return int(key) % len(keys)
        raise IndexError(f"there are {counted(len(keys), 'subdomain')}, got index {key}")
    names = ", ".join(repr(name) for name, _ in keys)
    if isinstance(key, Subdomain) and any(subdomain is None for _, subdomain in keys):
        raise KeyError(
            f"a History from a file has names and indices only, got {key!r}; use {names}"
        )
    raise KeyError(f"no subdomain {key!r}; there are {names}")


def by_index(
    values: Mapping[Any, Any] | None, keys: Sequence[tuple[str, Any]], name: str
) -> dict[int, Any]:
    """Values given by subdomain, by its index; ValueError for unknown or repeated subdomains."""
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise TypeError(f"{name} must be a dict by subdomain, got {values!r}")
    result: dict[int, Any] = {}
    for key, value in values.items():
        try:
            i = position(key, keys)
        except LookupError as error:
            raise ValueError(f"{name}: {error.args[0]}") from None
        if i in result:
            raise ValueError(f"{name} must not name a subdomain twice, got {keys[i][0]!r} twice")
        result[i] = value
    return result


def chosen_springs(
    record_springs: Mapping[Any, Any] | None,
    keys: Sequence[tuple[str, Subdomain]],
    dofs: Sequence[np.ndarray | None],
) -> list[np.ndarray | None]:
    """The springs to record of each subdomain, None for a subdomain left out."""
    chosen: list[np.ndarray | None] = [None] * len(keys)
    for i, springs in by_index(record_springs, keys, "record_springs").items():
        name, subdomain = keys[i]
        count = sum(len(spring) for spring in subdomain.springs)
        what = f"record_springs[{name!r}]"
        if count == 0 or dofs[i] is None:
            lack = "springs" if count == 0 else "recorded dofs"
            raise ValueError(f"{what} must be of a subdomain with {lack}, got one without")
        chosen[i] = np.arange(count) if springs is None else dof_list(springs, count, what)
    return chosen


# ---- core record --------------------------------------------------------------------------------
# The record of a run as the core takes it, by names: its one description in Python.

# The arrays of a record with a column for each constraint.
OF_CONSTRAINTS = ("multipliers", "velocity_jump", "displacement_jump")


class SpringRows(NamedTuple):
    """Springs, and rows with a column for each."""

    number: np.ndarray
    deformation: np.ndarray
    force: np.ndarray


class Combination(NamedTuple):
    """Weights of dofs by rows: the first of each row, and one more."""

    start: np.ndarray
    position: np.ndarray
    weight: np.ndarray


class OutputRows(NamedTuple):
    """Rows with a column for each output, and the matrices that act on u, v and a."""

    values: np.ndarray
    of_u: Combination | None
    of_v: Combination | None
    of_a: Combination | None


class InternalRows(NamedTuple):
    """Numbers of iterations, and histories of internal forces."""

    iterations: np.ndarray | None
    q: np.ndarray | None


class RigRows(NamedTuple):
    """Rows with a column for each command of specimens behind filters."""

    command: np.ndarray
    sent: np.ndarray
    measured: np.ndarray
    force: np.ndarray


class ContactRows(NamedTuple):
    """Rows with a column for each row of contacts, and for each contact."""

    impulse: np.ndarray
    gap: np.ndarray


class CoreSelection(NamedTuple):
    """What is recorded of a subdomain; rows of arrays are its time levels."""

    position: np.ndarray  # of the recorded dofs, in the order of the core
    u: np.ndarray
    v: np.ndarray
    a: np.ndarray
    springs: SpringRows | None
    outputs: OutputRows | None
    internal: InternalRows
    rig: RigRows | None = None


class CoreRecord(NamedTuple):
    """What is recorded of a coupler, in its order of constraints."""

    begin: int
    every: int
    selections: tuple[Any, ...]  # of each subdomain, None for none; in lanes a tuple of them
    multipliers: np.ndarray
    velocity_jump: np.ndarray
    displacement_jump: np.ndarray
    energy: np.ndarray | None = None
    contacts: ContactRows | None = None

    @property
    def interface(self) -> tuple[np.ndarray, ...]:
        """The arrays with a column for each constraint."""
        return tuple(getattr(self, name) for name in OF_CONSTRAINTS)


# ---- what was not recorded ----------------------------------------------------------------------


class NotRecorded:
    """False in ``if``; its attributes are an AttributeError that names the call that records them.

    Attributes
    ----------
    what, call : str
    """

    what: str
    call: str

    def __init__(self, what: str, call: str):
        self.what, self.call = what, call

    def __bool__(self) -> bool:
        return False

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, NotRecorded) and self.what == other.what

    def __hash__(self) -> int:
        return hash(self.what)

    def __repr__(self) -> str:
        return f"<no {self.what}: {self.call} records it>"

    def __getattr__(self, name: str) -> NoReturn:
        if name in ("what", "call"):  # of an object that is being copied
            raise AttributeError(name)
        raise AttributeError(
            f"{self.what} was not recorded, so that it has no {name!r}: {self.call} records it"
        )


NO_ENERGY = NotRecorded("energy", "Coupler.run(..., energy=True)")
NO_PACING = NotRecorded("pacing", "Coupler.run_paced(...)")
