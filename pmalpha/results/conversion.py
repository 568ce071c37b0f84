"""Results as objects of pandas and xarray, and in HTML."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from .._checks import counted
from .._tables import html_table
from ..files import library
from .quantities import (
    IN_INTERFACE,
    OF_INTERFACE,
    OF_SUBDOMAIN,
    TIMES,
    growing,
    times_name,
    times_of,
)
from .times import label_of, labels_of

if TYPE_CHECKING:
    import pandas
    import xarray

# The coordinates of columns; others have a name made of that of the quantity.
COORDINATES = {
    "dofs": "dof",
    "springs": "spring",
    "constraints": "constraint",
    "subdomains": "subdomain",
    "commands": "actuator",
    "contact rows": "contact_row",
    "contacts": "contact",
}
HEADINGS = (
    "subdomain",
    "dofs",
    "time levels",
    "substep",
    "largest |u|",
    "largest |v|",
    "largest |a|",
)

# Numbers in the motion of a subdomain that are read for its largest values.
MOST_READ = 20_000_000


def subdomain_frame(s: Any) -> pandas.DataFrame:
    """The implementation of `SubdomainHistory.to_pandas`."""
    columns = [
        (name, _labels(s, OF_SUBDOMAIN[name].columns), x.reshape(len(x), -1))
        for name, x in growing(s).items()
        if name != "t"
    ]
    columns += [(name, None, x) for name, x in s.outputs.items()]
    return _frame(s.t, columns, ["quantity", "dof"])


def _labels(s: Any, columns: str) -> Any:
    """The names or numbers of columns; None where they have none."""
    if columns == "dofs":
        return labels_of(s.dofs, s.dof_names)
    return getattr(s, columns, None)


def frames(history: Any) -> dict[str, pandas.DataFrame]:
    """The implementation of `History.to_pandas`."""
    result = {s.name: subdomain_frame(s) for s in history.subdomains if s is not None}
    if history.multipliers.shape[1]:
        of_fine_steps = [x for x in IN_INTERFACE["constraints"] if OF_INTERFACE[x].axis != "macro"]
        tables: dict[str, list[str]] = {}  # one index each
        for name in of_fine_steps:
            at_multipliers = times_of(history, name) is history.multiplier_times
            tables.setdefault("interface" if at_multipliers else name, []).append(name)
        for table, names in tables.items():
            if table in result:
                raise ValueError(f"to_pandas needs another name of the subdomain {table!r}")
            columns = [(name, None, getattr(history, name)) for name in names]
            result[table] = _frame(times_of(history, names[0]), columns, ["quantity", "constraint"])
    return result


def _frame(t: np.ndarray, columns: list[tuple[Any, ...]], names: list[str]) -> pandas.DataFrame:
    """A table of quantities, the labels of their columns (None: numbers), and their values."""
    pd = library("pandas", "to_pandas", "'pmalpha[pandas]'")
    labels = [
        (quantity, i if isinstance(i, str) else int(i))
        for quantity, labels_of_columns, values in columns
        for i in (range(values.shape[1]) if labels_of_columns is None else labels_of_columns)
    ]
    values = np.hstack([values for _, _, values in columns])
    index = pd.MultiIndex.from_tuples(labels, names=names)
    table: pandas.DataFrame = pd.DataFrame(values, pd.Index(t, name="time"), index)
    return table


def subdomain_dataset(s: Any) -> xarray.Dataset:
    """The implementation of `SubdomainHistory.to_xarray`."""
    return _dataset(*_variables(s, ""), attrs={"name": s.name})


def dataset(history: Any) -> xarray.Dataset:
    """The implementation of `History.to_xarray`."""
    macro = TIMES["macro"]
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {
        name: getattr(history, name) for name in OF_INTERFACE if name in TIMES.values()
    }
    coordinates["constraint"] = np.arange(history.multipliers.shape[1])
    for name, x in growing(history).items():
        quantity = OF_INTERFACE[name]
        if quantity.columns:
            times = times_name(quantity, history.coupling)
            variables[name] = ((times, COORDINATES[quantity.columns]), x)
    if history.energy:
        for name, x in history.energy.arrays().items():
            variables[f"energy_{name}"] = ((macro, "subdomain"), x)
    if history.substeps is not None or history.energy:
        coordinates["subdomain"] = [name for name, _ in history.keys]
    for s in history.subdomains:
        if s is not None:
            arrays, places = _variables(s, f"{s.name}_")
            variables, coordinates = variables | arrays, coordinates | places
    return _dataset(variables, coordinates)


def _variables(s: Any, prefix: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Variables and coordinates of a subdomain; their names begin with the prefix."""
    time = f"{prefix}time"
    variables: dict[str, Any] = {}
    coordinates = {time: s.t}
    for name, x in growing(s).items():
        columns = OF_SUBDOMAIN[name].columns
        along = f"{prefix}{COORDINATES.get(columns, f'{name}_column')}"
        if columns:
            variables[prefix + name] = ((time, along) if x.ndim > 1 else (time,), x)
        labels = _labels(s, columns) if columns in COORDINATES else None
        if labels is not None:
            coordinates[along] = labels
    for name, x in s.outputs.items():
        variables[prefix + name] = ((time, f"{prefix}{name}_row"), x)
    return variables, coordinates


def _dataset(variables: Any, coordinates: Any, **options: Any) -> xarray.Dataset:
    make = library("xarray", "to_xarray", "'pmalpha[xarray]'").Dataset
    dataset: xarray.Dataset = make(variables, coordinates, **options)
    return dataset


def history_html(history: Any) -> str:
    """The implementation of `History._repr_html_`."""
    lines = [title(history), *energy_lines(history)]
    recorded = [s for s in history.subdomains if s is not None]
    table = html_table(HEADINGS, [row_of(s) for s in recorded], ("subdomain",))
    names = [name for (name, _), s in zip(history.keys, history.subdomains) if s is None]
    if names:
        lines.append(f"not recorded: {', '.join(names)}")
    paragraphs = "".join(f"<p>{escape(line)}</p>" for line in lines)
    warned = "".join(f"<li>{escape(text)}</li>" for text in history.warnings)
    return f"{paragraphs}{table}" + (f"<p>warnings:</p><ul>{warned}</ul>" if warned else "")


def title(history: Any) -> str:
    t, p = history.macro_times, history.multipliers.shape[1]
    coupling = "" if history.coupling is None else f", coupling = {history.coupling!r}"
    levels = counted(len(t), "macro time level")
    return f"History: t = {t[0]:g} .. {t[-1]:g}, {levels}{coupling}, {counted(p, 'constraint')}"


def energy_lines(history: Any) -> list[str]:
    if not history.energy:
        return []
    energy = history.energy
    stored = (energy.kinetic + energy.strain).sum(axis=1)
    added = float(energy.balance.sum(axis=1)[-1])
    return [
        f"energy: largest {stored.max():.4g}, at the end {stored[-1]:.4g}; "
        f"the scheme {'added' if added > 0.0 else 'removed'} {abs(added):.2g}"
    ]


def row_of(s: Any) -> tuple[str, ...]:
    step = "changed" if s.substep is None else f"{s.substep:g}"
    step += "" if s.double_after is None else ", double"
    return (s.name, str(s.dofs.size), str(s.t.size), step, *(largest(s, name) for name in "uva"))


def largest(s: Any, quantity: str) -> str:
    """The largest absolute value with its dof and time."""
    x = getattr(s, quantity)
    if x.size == 0 or x.size > MOST_READ:
        return "-"
    row, column = np.unravel_index(int(np.abs(x).argmax()), x.shape)
    dof = label_of(s.dofs, s.dof_names, int(column))
    dof = f"dof {dof}" if s.dof_names is None else dof
    return f"{abs(x[row, column]):.4g} ({dof}, t = {s.t[row]:g})"
