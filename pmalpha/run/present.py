"""What a coupler returns of the present: time, states, multipliers, and the last History."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..problem.springs import SpringState
from ..problem.subdomain import Subdomain
from ..setup.core_rows import CoreRows
from .history import History
from .keys import position

__all__ = ["State"]


@dataclass(frozen=True)
class State:
    """The motion of a subdomain at one time.

    Attributes
    ----------
    u, v, a : (n,) arrays
        Displacement, velocity and true acceleration (w of the equations).
    """

    u: np.ndarray
    v: np.ndarray
    a: np.ndarray


class Present:
    """The properties and methods of `Coupler` that return its present state."""

    _keys: tuple[tuple[str, Subdomain], ...]
    _parts: Any
    _core: Any
    _clock: Any
    _core_rows: CoreRows
    _last_history: History | None
    _entered: Any
    _start: Any
    _steps_done: Any

    @property
    def threads(self) -> int:
        """Number of threads in use, including the caller."""
        return self._core.threads

    @property
    def step_count(self) -> int:
        """Number of completed macro steps."""
        with self._entered():
            return self._steps_done()

    @property
    def time(self) -> float:
        """The present time, equation (T1)."""
        with self._entered():
            return self._clock.time(self._steps_done())

    @property
    def multipliers(self) -> np.ndarray:
        """Lam, (p,), at the present time; a copy."""
        with self._entered():
            self._start()
            return self._core_rows.forces(self._core.multipliers)

    @property
    def last_history(self) -> History | Any:  # not | None, which a checker would have tested
        """After an exception or Ctrl-C in `run`: the History up to the last complete macro step."""
        return self._last_history

    def state(self, key: str | int | Subdomain) -> State:
        """Displacement, velocity and true acceleration of a subdomain at the present time.

        Parameters
        ----------
        key : str, int or Subdomain
            Its name, its index, or the subdomain itself.

        Returns
        -------
        State
            Copies.

        Raises
        ------
        KeyError, IndexError
            When there is no such subdomain.
        """
        i = position(key, self._keys)
        with self._entered():  # another thread may change the steps, and with them the parts
            self._start()
            part = self._parts[i]
            u, v, w = part.core.state()
            if part.mean:
                w = w + part.core.accelerate(self._core.end_multipliers()[: self._core_rows.p])
        return State(u[part.position], v[part.position], w[part.position])

    def springs(self, key: str | int | Subdomain) -> SpringState:
        """Deformation and force of the springs of a subdomain at the present time.

        Parameters
        ----------
        key : str, int or Subdomain
            Its name, its index, or the subdomain itself.

        Returns
        -------
        SpringState
            Copies.

        Raises
        ------
        KeyError, IndexError
            When there is no such subdomain.

        Examples
        --------
        >>> joint = Bilinear([0], k=4.0, fy=1.0)
        >>> frame = Subdomain([1.0], None, scheme=Newmark(), restoring=joint, u0=[1.0], name="f")
        >>> Coupler([frame], dt=0.1).springs("f").force
        array([1.])
        """
        i = position(key, self._keys)
        with self._entered():
            self._start()
            part = self._parts[i]
            deformation, force, _ = part.core.springs()
        return SpringState(deformation, force)
