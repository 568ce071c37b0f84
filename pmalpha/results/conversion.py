"""Results as objects of pandas and xarray."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .dof_motion import labels_of
from .quantities import OF_INTERFACE, OF_SUBDOMAIN, TIMES, growing, of_columns

if TYPE_CHECKING:
    import pandas
    import xarray

# The coordinates of columns; others have a name made of that of the quantity.
COORDINATES = {"dofs": "dof", "springs": "spring"}


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
    found = {s.name: subdomain_frame(s) for s in history.subdomains if s is not None}
    if history.multipliers.shape[1]:
        if "interface" in found:
            raise ValueError("to_pandas needs another name of the subdomain 'interface'")
        columns = [
            (name, None, getattr(history, name))
            for name in of_columns(OF_INTERFACE, "constraints")
            if OF_INTERFACE[name].levels == "fine"
        ]
        labels = ["quantity", "constraint"]
        found["interface"] = _frame(history.multiplier_times, columns, labels)
    return found


def _frame(t: np.ndarray, columns: list[tuple[Any, ...]], names: list[str]) -> pandas.DataFrame:
    """A table of quantities, the labels of their columns (None: numbers), and their values."""
    try:
        import pandas
    except ImportError as error:
        raise ImportError("to_pandas needs pandas: pip install 'pmalpha[pandas]'") from error
    labels = [
        (quantity, i if isinstance(i, str) else int(i))
        for quantity, labels_of_columns, values in columns
        for i in (range(values.shape[1]) if labels_of_columns is None else labels_of_columns)
    ]
    return pandas.DataFrame(
        np.hstack([values for _, _, values in columns]),
        index=pandas.Index(t, name="time"),
        columns=pandas.MultiIndex.from_tuples(labels, names=names),
    )


def subdomain_dataset(s: Any) -> xarray.Dataset:
    """The implementation of `SubdomainHistory.to_xarray`."""
    return _dataset(*_variables(s, ""), attrs={"name": s.name})


def dataset(history: Any) -> xarray.Dataset:
    """The implementation of `History.to_xarray`."""
    macro = TIMES["macro"]
    dimension = {"constraints": "constraint", "subdomains": "subdomain"}
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {name: getattr(history, name) for name in of_times()}
    coordinates["constraint"] = np.arange(history.multipliers.shape[1])
    for name, x in growing(history).items():
        quantity = OF_INTERFACE[name]
        if quantity.columns:
            variables[name] = ((TIMES[quantity.levels], dimension[quantity.columns]), x)
    if history.energy is not None:
        for name, x in history.energy.arrays().items():
            variables[f"energy_{name}"] = ((macro, "subdomain"), x)
    if history.substeps is not None or history.energy is not None:
        coordinates["subdomain"] = [name for name, _ in history.keys]
    for s in history.subdomains:
        if s is not None:
            own, places = _variables(s, f"{s.name}_")
            variables, coordinates = variables | own, coordinates | places
    return _dataset(variables, coordinates)


def of_times() -> list[str]:
    """The times of a History."""
    return [name for name in of_columns(OF_INTERFACE, "") if name in TIMES.values()]


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
        if columns in COORDINATES:
            coordinates[along] = _labels(s, columns)
    for name, x in s.outputs.items():
        variables[prefix + name] = ((time, f"{prefix}{name}_row"), x)
    return variables, coordinates


def _dataset(variables: Any, coordinates: Any, **options: Any) -> xarray.Dataset:
    try:
        import xarray
    except ImportError as error:
        raise ImportError("to_xarray needs xarray: pip install 'pmalpha[xarray]'") from error
    return xarray.Dataset(variables, coordinates, **options)
