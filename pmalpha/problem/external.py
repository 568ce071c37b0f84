"""A specimen that is not in this program: what a frozen model leaves to the loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._cached import Frozen
from .._checks import real_array
from .dofs import dof_list

__all__ = ["External"]


class External(Frozen):
    """A specimen that is not in this program, for ``restoring=`` of a `Subdomain`.

    Its force is an input of a frozen model or of an FMU: ``inputs={"column": ("specimen", "rig",
    0)}``. Here nothing can be stepped: `Coupler.run` and `step` refuse it.

    Parameters
    ----------
    dofs : int, str, or (k,) array of int or str, optional
        The dofs on which the specimen acts. Default: all of the subdomain.
    force : float, (k,) array, or dict by dof, default 0.0
        Its force at the start, on the left-hand side as restoring forces are, for the initial
        accelerations.

    Raises
    ------
    TypeError, ValueError
        For a force that is no finite number, or not one for each dof.

    Examples
    --------
    >>> column = rig.External([0], force=12.0)
    >>> frame = Subdomain([2.0, 1.0], [300.0, 200.0], scheme=Newmark(), restoring=column,
    ...                   restoring_stiffness=[250.0, 0.0], name="frame")
    >>> frame.restoring
    <External on dof 0, force 12 at the start>
    """

    repeatable = False  # as `Coupler.estimate_error` has to know

    def __init__(self, dofs: Any = None, *, force: Any = 0.0):
        self.dofs = dofs
        by_dof = isinstance(force, Mapping)
        self.force = dict(force) if by_dof else real_array(force, "force", (0, 1))
        self.at_start: np.ndarray | None = None  # (n,), in a subdomain
        self._freeze()

    def _placed(self, n: int, names: Sequence[str] | None, label: str) -> External:
        """The same with numbers of dofs of a subdomain; `label` is that of the argument."""
        what = f"{label}: dofs of an External"
        dofs = np.arange(n) if self.dofs is None else dof_list(self.dofs, n, what, names)
        values = np.zeros(n)
        if isinstance(self.force, dict):
            for dof, value in self.force.items():
                (number,) = dof_list(dof, n, f"{label}: force of an External", names)
                if number not in dofs:
                    raise ValueError(
                        f"{label}: force of an External must be on its dofs, got one on {dof!r}"
                    )
                values[number] = real_array(value, f"{label}: force of an External", (0,))
        elif self.force.ndim == 0 or self.force.size == dofs.size:
            values[dofs] = self.force
        else:
            raise ValueError(
                f"{label}: force of an External must be a number, or one for each of {dofs.size} "
                f"dofs, got {self.force.size}"
            )
        placed = object.__new__(External)
        placed.__dict__.update(dofs=dofs, force=self.force, at_start=values, _is_frozen=True)
        return placed

    def __repr__(self) -> str:
        if self.at_start is None:
            return f"<External on dofs {self.dofs!r}>" if self.dofs is not None else "<External>"
        dofs = ", ".join(map(str, self.dofs.tolist()))
        forces = ", ".join(f"{x:g}" for x in self.at_start[self.dofs])
        return f"<External on dof{'s' * (self.dofs.size > 1)} {dofs}, force {forces} at the start>"

    def __call__(self, t: float, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Its force at the start; ValueError later, since it is not in this program."""
        if t > 0.0 or self.at_start is None:
            raise ValueError(OUTSIDE)
        return self.at_start.copy()


OUTSIDE = (
    "an External specimen is not in this program, which cannot step it: freeze or export_fmu the "
    "coupler with its dofs as inputs, or give its force as a function, restoring=f"
)
