"""The arrays that a run writes into, and the History they become."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ._checks import whole_number
from .assembly import Part
from .constraints import dof_list
from .history import ENERGIES, Energy, History, SubdomainHistory, by_place
from .memory import require
from .subdomain import Subdomain


class Recording:
    """One stretch of a run, from macro step `begin` to at most `end`.

    Parameters
    ----------
    parts : sequence of Part
    keys : sequence of (name, Subdomain)
    row_place : (p,) array of int
        Place of each condition in the core's order.
    fine : int
        Interface problems in a macro step.
    begin, end : int
        Macro steps.
    dt : float
        Macro step.
    record : dict or None
        Dofs (or None for all) by subdomain; None records everything.
    every : int or None
    energy : bool
    """

    def __init__(
        self,
        parts: Sequence[Part],
        keys: Sequence[tuple[str, Subdomain]],
        row_place: np.ndarray,
        *,
        fine: int,
        begin: int,
        end: int,
        dt: float,
        record: Mapping[Any, Any] | None,
        every: int | None,
        energy: bool = False,
    ):
        self.parts, self.keys, self.row_place = parts, tuple(keys), row_place
        self.begin, self.dt = begin, dt
        self.every = None if every is None else whole_number(every, "every", low=1)
        self.fine = fine
        self.dofs = chosen_dofs(record, self.keys)
        self.energy_columns = len(parts) * len(ENERGIES) if energy else 0
        self._require_memory(end)
        self.nodes = [
            None if dofs is None else self._allocate(part.subdomain.substeps, dofs.size, end, 3)
            for part, dofs in zip(parts, self.dofs)
        ]
        p = row_place.size
        self.multipliers, self.velocity_jump = self._allocate(self.fine, p, end, 2)
        (self.displacement_jump,) = self._allocate(1, p, end, 1)
        (self.energy,) = self._allocate(1, self.energy_columns, end, 1)

    def rows(self, nodes: int, end: int) -> int:
        """Rows of a grid with this many nodes in a macro step, the first included."""
        if self.every is None:
            return 1 + (end - self.begin) * nodes
        return 1 + end // self.every - self.begin // self.every

    def times(self, nodes: int, end: int) -> np.ndarray:
        """The times of these rows, equation (T1)."""
        if self.every is None:
            return np.arange(self.begin * nodes, end * nodes + 1) / nodes * self.dt
        later = np.arange(self.begin // self.every + 1, end // self.every + 1) * self.every
        return np.concatenate([[self.begin], later]) * self.dt

    def core_record(self) -> tuple:
        """The record as the core takes it."""
        nodes = tuple(
            None if arrays is None else (part.place[dofs], *arrays)
            for part, dofs, arrays in zip(self.parts, self.dofs, self.nodes)
        )
        interface = self.multipliers, self.velocity_jump, self.displacement_jump
        energy = self._energies(self.energy) if self.energy_columns else None
        return (self.begin, self.every or 0, nodes, *interface, energy)

    def _energies(self, rows: np.ndarray) -> np.ndarray:
        """By macro node, subdomain and kind."""
        return rows.reshape(len(rows), len(self.parts), len(ENERGIES))

    def history(self, end: int) -> History:
        """What was recorded up to macro step `end`."""
        subdomains = []
        for part, dofs, arrays in zip(self.parts, self.dofs, self.nodes):
            substeps = part.subdomain.substeps
            rows = self.rows(substeps, end)
            subdomains.append(
                None
                if arrays is None
                else SubdomainHistory(
                    part.name, self.times(substeps, end), *(x[:rows] for x in arrays), dofs
                )
            )
        fine, macro = self.rows(self.fine, end), self.rows(1, end)
        return History(
            subdomains=tuple(subdomains),
            multipliers=self._in_users_order(self.multipliers[:fine]),
            multiplier_times=self.times(self.fine, end),
            velocity_jump=self._in_users_order(self.velocity_jump[:fine]),
            displacement_jump=self._in_users_order(self.displacement_jump[:macro]),
            macro_times=self.times(1, end),
            keys=self.keys,
            energy=self._told_energy(macro, end) if self.energy_columns else None,
        )

    def _told_energy(self, rows: int, end: int) -> Energy:
        kinds = np.moveaxis(self._energies(self.energy[:rows]), -1, 0)
        return Energy.balanced(self.times(1, end), *(np.ascontiguousarray(x) for x in kinds))

    def _in_users_order(self, columns: np.ndarray) -> np.ndarray:
        if np.array_equal(self.row_place, np.arange(self.row_place.size)):
            return columns
        return columns[:, self.row_place]

    def _allocate(self, nodes: int, columns: int, end: int, count: int) -> list[np.ndarray]:
        return [np.empty((self.rows(nodes, end), columns)) for _ in range(count)]

    def _require_memory(self, end: int) -> None:
        p = self.row_place.size
        numbers = 2.0 * self.rows(self.fine, end) * p
        numbers += self.rows(1, end) * (p + 2.0 * self.energy_columns)  # and as they are told
        for part, dofs in zip(self.parts, self.dofs):
            if dofs is not None:
                numbers += 3.0 * self.rows(part.subdomain.substeps, end) * dofs.size
        require(8.0 * numbers, "the History", "choose dofs with record= or fewer nodes with every=")


def chosen_dofs(
    record: Mapping[Any, Any] | None, keys: Sequence[tuple[str, Subdomain]]
) -> list[np.ndarray | None]:
    """The dofs to record of each subdomain, None for those left out."""
    if record is None:
        return [np.arange(s.n) for _, s in keys]
    chosen: list[np.ndarray | None] = [None] * len(keys)
    for i, dofs in by_place(record, keys, "record").items():
        name, subdomain = keys[i]
        every_dof = np.arange(subdomain.n)
        chosen[i] = every_dof if dofs is None else dof_list(dofs, subdomain.n, f"record[{name!r}]")
    return chosen
