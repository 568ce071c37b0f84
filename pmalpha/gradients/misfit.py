"""Functions of a run whose gradients are wanted: weighted squares of differences from data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import copy
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import counted, plain_array, real_array
from ..problem.dofs import dof_list
from ..problem.frozen import Frozen
from ..problem.matrices import rectangular
from ..problem.subdomain import Subdomain
from ..results.dof_motion import columns_of

__all__ = ["Misfit"]

KINDS = ("u", "v", "a")
MULTIPLIERS = "multipliers"


class Misfit(Frozen):
    """Sum of weight (x - data)^2 / 2 over the levels of a run, x what was measured.

    Parameters
    ----------
    measured : dict
        By name of the subdomain ``dict(dofs=..., u=data, v=data, a=data, weight=1.0)``: dofs by
        number or name, one or several of u, v, a with data (levels, dofs) at all time levels of the
        subdomain from t = 0 on; nan where nothing was measured. `weight`: a number or (dofs,), such
        as one over the square of the standard deviation of the noise. In place of `dofs` a matrix
        ``W``, (rows, n) dense or sparse, for combinations W u, W v or W a, such as strains, drifts
        of storeys or what is measured in another direction; data are then (levels, rows). A list of
        such dicts where dofs are measured in several ways. ``"multipliers"``: ``dict(rows=...,
        data=..., weight=1.0)``, the rows of the multipliers at the interface levels, such as forces
        of a load cell.

    Raises
    ------
    TypeError, ValueError
        For other keys, and shapes that do not fit.

    Examples
    --------
    >>> import numpy as np
    >>> misfit = Misfit({"frame": dict(dofs=[0, 2], a=np.zeros((101, 2)), weight=4.0)})
    >>> misfit
    <Misfit of 'frame': a of 2 dofs, 101 levels>

    The drift of a storey and a force at the interface:

    >>> Misfit({"frame": dict(W=[[0.0, -1.0, 1.0]], u=np.zeros((101, 1))),
    ...         "multipliers": dict(rows=[0], data=np.zeros((101, 1)))})
    <Misfit of 'frame': u of 1 row, 101 levels; 'multipliers': 1 row, 101 levels>
    """

    def __init__(self, measured: Mapping[str, Any]):
        if not isinstance(measured, Mapping) or not measured:
            raise TypeError(f"measured must be a dict by subdomain, got {measured!r}")
        self.measured: dict[str, list[dict[str, Any]]] = {}
        for name, value in measured.items():
            several = value if isinstance(value, (list, tuple)) else [value]
            for of in several:
                if not isinstance(of, Mapping):
                    raise TypeError(
                        f"measured[{name!r}] must be a dict or a list of dicts, got {of!r}"
                    )
            check = _of_multipliers if name == MULTIPLIERS else _of_motion
            self.measured[name] = [check(name, dict(of)) for of in several]
        self._freeze()

    def __repr__(self) -> str:
        parts = []
        for name, of in self._each():
            what = counted(len(of["sensors"]), "dof" if "dofs" in of else "row")
            kinds = ", ".join(k for k in KINDS if k in of["data"])
            levels = len(next(iter(of["data"].values())))
            parts.append(f"{name!r}: {kinds + ' of ' if kinds else ''}{what}, {levels} levels")
        return f"<Misfit of {'; '.join(parts)}>"

    def _each(self) -> Iterator[tuple[str, dict[str, Any]]]:
        return ((name, of) for name, several in self.measured.items() for of in several)

    @property
    def record(self) -> dict[str, np.ndarray]:
        """What a run has to record for it: dofs by name of the subdomain."""
        return {
            name: np.unique(np.concatenate([_dofs(of) for of in several]))
            for name, several in self.measured.items()
            if name != MULTIPLIERS
        }

    def _placed(self, subdomains: Mapping[str, Subdomain], p: int) -> Misfit:
        """The same with numbers of dofs that fit the subdomains of a coupler."""
        placed = copy(self)
        measured = {
            name: [_placed(name, of, subdomains, p) for of in several]
            for name, several in self.measured.items()
        }
        object.__setattr__(placed, "measured", measured)
        return placed

    def __call__(self, history: Any) -> tuple[float, dict[str, Any]]:
        """The value, and its derivatives with respect to what `record` names and multipliers."""
        value = 0.0
        sources: dict[str, Any] = {}
        for name, of in self._each():
            if name == MULTIPLIERS:
                source = sources.setdefault(name, np.zeros_like(history.multipliers))
                value += _added(name, MULTIPLIERS, of, history.multipliers, of["sensors"], source)
                continue
            run = history[name]
            if "dofs" in of:
                what = f"dofs of {name!r} in the Misfit"
                columns: Any = columns_of(of["dofs"], run.dofs, run.n, run.dof_names, what)
            else:
                columns = places(run.dofs, of["columns"])
            derivatives = sources.setdefault(name, {})
            for kind in of["data"]:
                motion = getattr(run, kind)
                source = derivatives.setdefault(kind, np.zeros((len(motion), len(run.dofs))))
                value += _added(name, kind, of, motion, columns, source)
        return value, sources


def _placed(
    name: str, of: dict[str, Any], subdomains: Mapping[str, Subdomain], p: int
) -> dict[str, Any]:
    """What was measured in one way, with numbers of dofs or rows."""
    if name == MULTIPLIERS:
        return of | {"sensors": dof_list(of["sensors"], p, "rows of 'multipliers' in the Misfit")}
    if name not in subdomains:
        raise KeyError(f"the Misfit must be of {sorted(subdomains)}, got {name!r}")
    n, names = subdomains[name].n, subdomains[name].dof_names
    if "dofs" in of:
        dofs = dof_list(of["dofs"], n, f"dofs of {name!r} in the Misfit", names)
        if dofs.size != len(of["sensors"]):
            raise ValueError(
                f"dofs of {name!r} in the Misfit must be {len(of['sensors'])}, as the columns of "
                f"its data, got {dofs.size}"
            )
        return of | {"dofs": dofs}
    if of["n"] != n:
        raise ValueError(
            f"W of {name!r} in the Misfit must have {counted(n, 'column')}, got {of['n']}"
        )
    return of


def _added(
    name: str, kind: str, of: Mapping[str, Any], motion: np.ndarray, columns: Any, source: Any
) -> float:
    """The value, whose derivative with respect to the motion is added to the source."""
    x, data, W = motion[:, columns], of["data"][kind], of.get("W")
    if W is not None:
        x = (W @ x.T).T
    if x.shape != data.shape:
        raise ValueError(
            f"{kind} of {name!r} in the Misfit must have shape {x.shape}, the levels of the run "
            f"and what is measured, got {data.shape}"
        )
    difference = np.where(np.isnan(data), 0.0, x - data)
    weighted = of["weight"] * difference
    source[:, columns] += weighted if W is None else (W.T @ weighted.T).T
    return 0.5 * float(np.sum(weighted * difference))


def _dofs(of: Mapping[str, Any]) -> np.ndarray:
    dofs: np.ndarray = of["dofs"] if "dofs" in of else of["columns"]
    return dofs


def places(recorded: np.ndarray, dofs: np.ndarray) -> np.ndarray:
    """The columns of some dofs among those that were recorded."""
    order = np.argsort(recorded)
    return order[np.searchsorted(recorded, dofs, sorter=order)]


def _of_motion(name: str, of: dict[str, Any]) -> dict[str, Any]:
    _require_keys(name, of, {"dofs", "W", "weight", *KINDS})
    if ("dofs" in of) == ("W" in of):
        raise ValueError(f"measured[{name!r}] must have dofs or W, one of them")
    out: dict[str, Any] = {}
    if "dofs" in of:
        out["dofs"] = _given_dofs(of["dofs"], f"dofs of {name!r}")
        out["sensors"] = np.arange(len(out["dofs"]))
    else:
        W = rectangular(of["W"], None, f"W of {name!r}")
        out["sensors"], out["columns"] = np.arange(W.shape[0]), np.unique(W.indices)
        out["W"], out["n"] = sp.csr_array(W[:, out["columns"]]), W.shape[1]
    if not out["sensors"].size:
        raise ValueError(f"dofs of {name!r} must be at least one, got none")
    arrays = {k: of[k] for k in KINDS if k in of}
    if not arrays:
        raise ValueError(f"measured[{name!r}] must have data of u, v or a")
    return _with_data(name, out, arrays, of)


def _given_dofs(value: Any, what: str) -> Any:
    """As they are where they are names or count from the end: what they are of is not known."""
    array = np.atleast_1d(plain_array(value, what))
    if array.ndim == 1 and (
        array.dtype.kind in "UO" or (array.dtype.kind == "i" and array.min(initial=0) < 0)
    ):
        return [value] if isinstance(value, str) else list(value)
    return dof_list(value, None, what)


def _of_multipliers(name: str, of: dict[str, Any]) -> dict[str, Any]:
    _require_keys(name, of, {"rows", "data", "weight"})
    if missing := [x for x in ("rows", "data") if x not in of]:
        raise ValueError(f"measured[{name!r}] must have {missing[0]}")
    rows = dof_list(of["rows"], None, f"rows of {name!r}")
    return _with_data(name, {"sensors": rows}, {MULTIPLIERS: of["data"]}, of)


def _require_keys(name: str, of: Mapping[str, Any], known: set[str]) -> None:
    if unknown := set(of) - known:
        raise ValueError(f"measured[{name!r}] has unknown keys: {sorted(unknown)}")


def _with_data(
    name: str, out: dict[str, Any], arrays: Mapping[str, Any], of: Mapping[str, Any]
) -> dict[str, Any]:
    """`out` with the weight and the data by kind, checked."""
    count = out["sensors"].size
    out["weight"] = real_array(of.get("weight", 1.0), "weight", (0, 1))
    if out["weight"].shape not in ((), (count,)):
        raise ValueError(
            f"weight of {name!r} must be a number or have shape {(count,)}, got "
            f"{out['weight'].shape}"
        )
    out["data"] = {}
    for kind, values in arrays.items():
        data = np.array(values, float)
        if np.any(np.isinf(data)):
            raise ValueError(
                f"{kind} of {name!r} must be finite, or nan where nothing was measured"
            )
        if data.ndim != 2 or data.shape[1] != count:
            raise ValueError(
                f"{kind} of {name!r} must have shape (levels, {count}), got {data.shape}"
            )
        out["data"][kind] = data
    return out
