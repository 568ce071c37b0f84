"""The result of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Union

import numpy as np

from .subdomain import Subdomain

__all__ = ["History", "State", "SubdomainHistory"]


@dataclass(frozen=True)
class State:
    """Displacement, velocity and acceleration of a subdomain at one time, (n,) each."""

    u: np.ndarray
    v: np.ndarray
    a: np.ndarray


@dataclass(frozen=True)
class SubdomainHistory:
    """What was recorded of one subdomain.

    Attributes
    ----------
    name : str
    t : (k,) array
        Times of the nodes; the first is where the stretch began.
    u, v, a : (k, dofs) arrays
        Displacement, velocity and true acceleration (w of the equations).
    dofs : (dofs,) array of int
        Which dofs the columns are.
    """

    name: str
    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    a: np.ndarray
    dofs: np.ndarray

    def __repr__(self) -> str:
        return f"<{self.name!r}: {self.t.size} nodes, {self.dofs.size} dofs>"


@dataclass(frozen=True)
class History:
    """What a run recorded; ``history["rig"]``, ``history[rig]`` or ``history[1]``.

    The first node of every array is the one where the stretch began.

    Attributes
    ----------
    subdomains : tuple of `SubdomainHistory` or None
        None for a subdomain that was not recorded.
    multipliers : (k, p) array
        At `multiplier_times`: every fine node, or with ``every`` every such macro node.
        They act as + L^T Lam: on a tie, +Lam pushes the first and pulls the second subdomain.
    velocity_jump : (k, p) array
        sum_i L_i v_i at the same times, from total velocities; of a subdomain in the middle of an
        own step, from its interpolated free and its link velocity.
    displacement_jump : (macro nodes, p) array
        sum_i L_i u_i at `macro_times`: the drift, since only velocities are tied.
    """

    subdomains: tuple[SubdomainHistory | None, ...]
    multipliers: np.ndarray
    multiplier_times: np.ndarray
    velocity_jump: np.ndarray
    displacement_jump: np.ndarray
    macro_times: np.ndarray
    keys: tuple[tuple[str, Subdomain], ...]

    def __getitem__(self, key: Union[str, int, Subdomain]) -> SubdomainHistory:
        i = position(key, self.keys)
        found = self.subdomains[i]
        if found is None:
            raise KeyError(f"subdomain {self.keys[i][0]!r} was not recorded")
        return found

    def __len__(self) -> int:
        return len(self.subdomains)

    def __repr__(self) -> str:
        names = ", ".join(repr(s) for s in self.subdomains if s is not None)
        return (
            f"<History t = {self.macro_times[0]:g} .. {self.macro_times[-1]:g}, "
            f"{self.multipliers.shape[1]} conditions; {names}>"
        )


def position(
    key: Union[str, int, Subdomain], keys: Sequence[tuple[str, Subdomain]]
) -> int:
    """Place of a subdomain given by name, by itself or by its place; KeyError or IndexError."""
    for i, (name, subdomain) in enumerate(keys):
        if key is subdomain or (isinstance(key, str) and key == name):
            return i
    if isinstance(key, (int, np.integer)) and not isinstance(key, bool):
        if -len(keys) <= key < len(keys):
            return int(key) % len(keys)
        raise IndexError(f"there are {len(keys)} subdomains, got {key}")
    names = ", ".join(repr(name) for name, _ in keys)
    raise KeyError(f"no subdomain {key!r}; there are {names}")
