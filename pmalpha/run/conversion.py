"""Results as objects of pandas and xarray."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas
    import xarray

MOTION, LOOPS = ("u", "v", "a"), ("deformation", "force")


def subdomain_frame(s: Any) -> pandas.DataFrame:
    """The implementation of `SubdomainHistory.to_pandas`."""
    columns = [(q, s.dofs, getattr(s, q)) for q in MOTION]
    if s.springs is not None:
        columns += [(q, s.springs, getattr(s, q)) for q in LOOPS]
    columns += [(q, range(x.shape[1]), x) for q, x in s.outputs.items()]
    return _frame(s.t, columns, ["quantity", "dof"])


def frames(history: Any) -> dict[str, pandas.DataFrame]:
    """The implementation of `History.to_pandas`."""
    found = {s.name: subdomain_frame(s) for s in history.subdomains if s is not None}
    rows = np.arange(history.multipliers.shape[1])
    if rows.size:
        if "interface" in found:
            raise ValueError("to_pandas needs another name of the subdomain 'interface'")
        columns = [(q, rows, getattr(history, q)) for q in ("multipliers", "velocity_jump")]
        labels = ["quantity", "constraint"]
        found["interface"] = _frame(history.multiplier_times, columns, labels)
    return found


def _frame(t: np.ndarray, columns: list[tuple[Any, ...]], names: list[str]) -> pandas.DataFrame:
    try:
        import pandas
    except ImportError as error:
        raise ImportError("to_pandas needs pandas: pip install 'pmalpha[pandas]'") from error
    labels = [(quantity, int(i)) for quantity, numbers, _ in columns for i in numbers]
    return pandas.DataFrame(
        np.hstack([values for _, _, values in columns]),
        index=pandas.Index(t, name="time"),
        columns=pandas.MultiIndex.from_tuples(labels, names=names),
    )


def subdomain_dataset(s: Any) -> xarray.Dataset:
    """The implementation of `SubdomainHistory.to_xarray`."""
    try:
        import xarray
    except ImportError as error:
        raise ImportError("to_xarray needs xarray: pip install 'pmalpha[xarray]'") from error
    variables: dict[str, tuple[str | tuple[str, str], Any]] = {
        q: (("time", "dof"), getattr(s, q)) for q in MOTION
    }
    coordinates = {"time": s.t, "dof": s.dofs}
    if s.springs is not None:
        variables |= {q: (("time", "spring"), getattr(s, q)) for q in LOOPS}
        coordinates["spring"] = s.springs
    if s.iterations is not None:
        variables["iterations"] = ("time", s.iterations)
    if s.q is not None:
        variables["q"] = (("time", "q_column"), s.q)
    variables |= {q: (("time", f"{q}_row"), x) for q, x in s.outputs.items()}
    return xarray.Dataset(variables, coordinates, attrs={"name": s.name})
