"""Where the energy of each subdomain goes in a run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..problem.matrices import core_matrix
from ..setup.part import Part
from .loads import Loads

__all__ = ["Energy"]

# What the core tells of each macro node and subdomain, in this order.
ENERGIES = ("kinetic", "strain", "dissipated", "external", "interface")
TOLD = (*ENERGIES, "balance")


@dataclass(frozen=True)
class Energy:
    """Where the energy of each subdomain went, (macro nodes, subdomains) arrays.

    The works are those of this stretch: zero at its first node.

    Attributes
    ----------
    t : (macro nodes,) array
    kinetic, strain : arrays
        T = v M v / 2 and U = u K u / 2 at the node, equation (B1).
    dissipated, external, interface : arrays
        The works of C v, of F and of L^T Lam, summed up over the own steps, (B2) and (B3). That of
        a restoring force is counted as dissipated, also what it would give back.
    balance : array
        kinetic + strain + dissipated - external - interface, less its value at the first node:
        what the scheme itself added, or where negative took, (B4).
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
        """With the balance of the others; `start` is kinetic + strain where the works began."""
        balance = kinetic + strain - start + dissipated - external - interface
        return cls(t, kinetic, strain, dissipated, external, interface, balance)

    def __repr__(self) -> str:
        return f"<Energy of {self.balance.shape[1]} subdomains at {self.t.size} nodes>"


@contextmanager
def summed_works(core: Any, parts: Sequence[Part], loads: Loads, wanted: bool) -> Iterator[None]:
    """The core sums up the works of each substep, and lets the memory for it go afterwards."""
    try:
        if wanted:
            lam = core.multipliers
            for i, part in enumerate(parts):
                part.core.begin_energy(core_matrix(part.M), loads.at_present(i), lam)
        yield
    finally:
        for part in parts if wanted else ():
            part.core.end_energy()
