"""Energies of the subdomains in a run, equations (B1) to (B4)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._checks import counted
from ..problem.matrices import core_matrix
from ..setup.part import Part
from .loads import Loads

__all__ = ["Energy"]

# The energies of a subdomain that the core records at a macro time level, in this order.
ENERGIES = ("kinetic", "strain", "dissipated", "external", "interface")
ENERGY_FIELDS = (*ENERGIES, "balance")


@dataclass(frozen=True)
class Energy:
    """Energies of the subdomains, (macro time levels, subdomains) arrays.

    The works are zero at the beginning of the run.

    Attributes
    ----------
    t : (macro time levels,) array
        Times of the rows.
    kinetic, strain : arrays
        T = v M v / 2 and U = u K u / 2, equation (B1), and in U the energy of springs (H5) and
        the ``potential(u)`` of the internal forces that have one.
    dissipated, external, interface : arrays
        The works of C v, of F and of L^T Lam, summed over the substeps, (B2) and (B3). The works of
        restoring and internal forces count as dissipated, less the change of their energy in U: of
        a function without potential also the elastic share.
    balance : array
        kinetic + strain + dissipated - external - interface, minus its value at the beginning: the
        energy that the scheme added, negative if it was removed, (B4).
    """

    t: np.ndarray
    kinetic: np.ndarray
    strain: np.ndarray
    dissipated: np.ndarray
    external: np.ndarray
    interface: np.ndarray
    balance: np.ndarray

    @classmethod
    def balanced(
        cls,
        t: np.ndarray,
        kinetic: np.ndarray,
        strain: np.ndarray,
        dissipated: np.ndarray,
        external: np.ndarray,
        interface: np.ndarray,
        *,
        start: np.ndarray,
    ) -> Energy:
        """Energies with their balance.

        Parameters
        ----------
        t, kinetic, strain, dissipated, external, interface : arrays
            As the attributes.
        start : (subdomains,) array
            Kinetic and strain energy where the works are zero.

        Returns
        -------
        Energy
            With `balance`.
        """
        balance = kinetic + strain - start + dissipated - external - interface
        return cls(t, kinetic, strain, dissipated, external, interface, balance)

    def __repr__(self) -> str:
        subdomains = counted(self.balance.shape[1], "subdomain")
        return f"<Energy of {subdomains} at {counted(self.t.size, 'time level')}>"


@contextmanager
def summed_works(core: Any, parts: Sequence[Part], loads: Loads, wanted: bool) -> Iterator[None]:
    """Sum the works of each substep in the core; its memory for them is released afterwards."""
    try:
        if wanted:
            lam = core.multipliers
            for i, part in enumerate(parts):
                loads.evaluate_present(i)
                part.core.begin_energy(core_matrix(part.M), loads.at_present(i), lam)
        yield
    finally:
        for part in parts if wanted else ():
            part.core.end_energy()
