"""The table of what a run records: all arrays of a History, by name.

What is recorded, allocated, written to files and described there, read, continued, joined, and
converted follows from it. A new quantity is a line here, a field of `SubdomainHistory` or
`History`, and what the core computes. Units are in terms of those of the problem: u and t, and F
for forces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ..setup.part import Part


class Quantity(NamedTuple):
    """An array of a History.

    Attributes
    ----------
    columns : str
        Of what its columns are, such as "dofs", of `column_counts`; "" for an array without.
    what, unit : str
        Its description in files.
    levels : {"own", "fine", "macro", ""}
        Its rows: time levels of the subdomain, of the interface problems, or macro time levels;
        "" for an array without, the numbers of the columns.
    is_state : bool
        Finite in every run. Others are sums of products.
    is_count : bool
        Whole numbers; one column is then an array of one dimension.
    """

    columns: str
    what: str
    unit: str
    levels: str = "own"
    is_state: bool = False
    is_count: bool = False


# ---- the table -----------------------------------------------------------------------------------

OF_SUBDOMAIN = {
    "t": Quantity("", "times of the time levels", "t", is_state=True),
    "u": Quantity(
        "dofs",
        "displacement, a row for each time level, a column for each recorded dof",
        "u",
        is_state=True,
    ),
    "v": Quantity("dofs", "velocity, as u", "u/t", is_state=True),
    "a": Quantity("dofs", "acceleration, as u", "u/t^2", is_state=True),
    "dofs": Quantity("", "the recorded dofs, from 0", "1", levels="", is_state=True),
    "deformation": Quantity("springs", "deformation of springs, a row for each time level", "u"),
    "force": Quantity("springs", "force of springs, as deformation", "F"),
    "springs": Quantity("", "the recorded springs, from 0", "1", levels=""),
    "iterations": Quantity("iterated", "Newton iterations of each substep", "1", is_count=True),
    "q": Quantity(
        "memory", "history of internal forces, a row for each time level", "any", is_state=True
    ),
}
OF_INTERFACE = {
    "multipliers": Quantity(
        "constraints", "interface forces, a column for each constraint", "F", "fine", is_state=True
    ),
    "multiplier_times": Quantity(
        "", "times of multipliers and velocity_jump", "t", "fine", is_state=True
    ),
    "velocity_jump": Quantity(
        "constraints", "violation of the velocity constraints, as multipliers", "u/t", "fine"
    ),
    "contact_impulses": Quantity(
        "contact rows", "impulses of contacts since the row before", "F t", "fine"
    ),
    "contact_gaps": Quantity("contacts", "gaps of contacts, as contact_impulses", "u", "fine"),
    "displacement_jump": Quantity(
        "constraints", "displacement drift, a column for each constraint", "u", "macro"
    ),
    "macro_times": Quantity(
        "", "times of displacement_jump and of the energies", "t", "macro", is_state=True
    ),
    "substeps": Quantity(
        "subdomains",
        "substeps in the macro step that ends at macro_times, by subdomain",
        "1",
        "macro",
        is_count=True,
    ),
}
# The times of rows, by their levels.
TIMES = {"own": "t", "fine": "multiplier_times", "macro": "macro_times"}
# The parts of the record of a subdomain that the core takes by themselves; the rest is one tuple.
APART = ("", "dofs", "springs")


def column_counts(
    part: Part, dofs: np.ndarray, springs: np.ndarray | None
) -> dict[str, int | None]:
    """Numbers of columns of what the core records of a subdomain, None where it does not."""
    internal = part.internal
    memory = None
    if internal is not None and internal.initial.size and dofs.size == part.n:
        memory = internal.initial.size
    return {
        "dofs": dofs.size,
        "springs": None if springs is None else springs.size,
        "iterated": None if internal is None or part.tangent is None else 1,
        "memory": memory,
    }


# ---- what is made of it --------------------------------------------------------------------------

Record = TypeVar("Record", bound=Any)


def of_columns(table: Mapping[str, Quantity], columns: str) -> Iterator[str]:
    """The names of the quantities with these columns."""
    return (name for name, x in table.items() if x.columns == columns)


def by_columns(table: Mapping[str, Quantity]) -> dict[str, list[str]]:
    """The names of the quantities, by their columns."""
    names: dict[str, list[str]] = {}
    for name, x in table.items():
        names.setdefault(x.columns, []).append(name)
    return names


def table_of(record: Any) -> dict[str, Quantity]:
    """The table of a `History` or a `SubdomainHistory`."""
    return OF_SUBDOMAIN if hasattr(record, "dofs") else OF_INTERFACE


def arrays_of(record: Any) -> dict[str, np.ndarray]:
    """The arrays of a `History` or a `SubdomainHistory` that are there, without outputs."""
    found = ((name, getattr(record, name)) for name in table_of(record))
    return {name: x for name, x in found if x is not None}


def growing(record: Any) -> dict[str, np.ndarray]:
    """Those with a row for each time level."""
    table = table_of(record)
    return {name: x for name, x in arrays_of(record).items() if table[name].levels}


def with_rows(record: Record, change: Callable[..., np.ndarray], *others: Record) -> Record:
    """The record with ``change(x, ...)`` for each array x with rows and those of the others.

    An array that one of them lacks is None.
    """
    several = [growing(one) for one in (record, *others)]
    fields: dict[str, Any] = {
        name: change(*(own[name] for own in several)) if all(name in x for x in several) else None
        for name in several[0]
    }
    if hasattr(record, "outputs"):
        fields["outputs"] = {
            name: change(*(one.outputs[name] for one in (record, *others)))
            for name in record.outputs
        }
    return replace(record, **fields)
