"""Functions of a run whose gradients are wanted: weighted squares of differences from data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._checks import counted, real_array
from ..problem.dofs import dof_list
from ..problem.frozen import Frozen

__all__ = ["Misfit"]

KINDS = ("u", "v", "a")


class Misfit(Frozen):
    """Sum of weight (x - data)^2 / 2 over recorded levels and dofs, x one of u, v, a.

    Parameters
    ----------
    measured : dict
        By name of the subdomain ``dict(dofs=..., u=data, v=data, a=data, weight=1.0)``: one or
        several of u, v, a with data (levels, dofs) at all time levels of the subdomain from t = 0
        on; nan where nothing was measured. `weight`: a number or (dofs,), such as one over the
        square of the standard deviation of the noise.

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
    """

    def __init__(self, measured: Mapping[str, Mapping[str, Any]]):
        if not isinstance(measured, Mapping) or not measured:
            raise TypeError(f"measured must be a dict by subdomain, got {measured!r}")
        self.measured = {name: _checked(name, dict(of)) for name, of in measured.items()}
        self._freeze()

    def __repr__(self) -> str:
        each = []
        for name, of in self.measured.items():
            kinds = [k for k in KINDS if k in of]
            dofs, levels = counted(len(of["dofs"]), "dof"), len(of[kinds[0]])
            each.append(f"{name!r}: {', '.join(kinds)} of {dofs}, {levels} levels")
        return f"<Misfit of {'; '.join(each)}>"

    @property
    def record(self) -> dict[str, np.ndarray]:
        """What a run has to record for it."""
        return {name: of["dofs"] for name, of in self.measured.items()}

    def __call__(self, history: Any) -> tuple[float, dict[str, dict[str, np.ndarray]]]:
        """The value, and its derivatives with respect to what `record` names."""
        value = 0.0
        sources: dict[str, dict[str, np.ndarray]] = {}
        for name, of in self.measured.items():
            run, weight = history[name], of["weight"]
            columns = places(run.dofs, of["dofs"])
            sources[name] = {}
            for kind in (k for k in KINDS if k in of):
                x, data = getattr(run, kind)[:, columns], of[kind]
                if x.shape != data.shape:
                    raise ValueError(
                        f"{kind} of {name!r} in the Misfit must have shape {x.shape}, the levels "
                        f"of the run and its dofs, got {data.shape}"
                    )
                difference = np.where(np.isnan(data), 0.0, x - data)
                value += 0.5 * float(np.sum(weight * difference**2))
                sources[name][kind] = np.zeros((len(x), len(run.dofs)))
                sources[name][kind][:, columns] = weight * difference
        return value, sources


def places(recorded: np.ndarray, dofs: np.ndarray) -> np.ndarray:
    """The columns of some dofs among those that were recorded."""
    order = np.argsort(recorded)
    return order[np.searchsorted(recorded, dofs, sorter=order)]


def _checked(name: str, of: dict[str, Any]) -> dict[str, Any]:
    if unknown := set(of) - {"dofs", "weight", *KINDS}:
        raise ValueError(f"measured[{name!r}] has unknown keys: {sorted(unknown)}")
    dofs = dof_list(of.get("dofs", ()), None, f"dofs of {name!r}")
    if not dofs.size:
        raise ValueError(f"dofs of {name!r} must be at least one, got none")
    out: dict[str, Any] = {
        "dofs": dofs,
        "weight": real_array(of.get("weight", 1.0), "weight", (0, 1)),
    }
    if out["weight"].shape not in ((), dofs.shape):
        raise ValueError(
            f"weight of {name!r} must be a number or have shape {dofs.shape}, got "
            f"{out['weight'].shape}"
        )
    for kind in (k for k in KINDS if k in of):
        out[kind] = np.array(of[kind], float)
        if np.any(np.isinf(out[kind])):
            raise ValueError(
                f"{kind} of {name!r} must be finite, or nan where nothing was measured"
            )
        if out[kind].ndim != 2 or out[kind].shape[1] != dofs.size:
            raise ValueError(
                f"{kind} of {name!r} must have shape (levels, {dofs.size}), got {out[kind].shape}"
            )
    if not any(k in out for k in KINDS):
        raise ValueError(f"measured[{name!r}] must have data of u, v or a")
    return out
