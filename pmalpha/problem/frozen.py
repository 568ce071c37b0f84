"""Objects whose attributes cannot be assigned after they are made."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp


class Frozen:
    """Base class of what describes a problem: the checks of the constructor stay true.

    A constructor assigns attributes as usual and ends with ``self._freeze()``.
    """

    _is_frozen: ClassVar[bool] = False

    def _freeze(self) -> None:
        object.__setattr__(self, "_is_frozen", True)

    def __setattr__(self, name: str, value: Any) -> None:
        if self._is_frozen:
            raise AttributeError(self._refusal(name))
        object.__setattr__(self, name, value)

    def __delattr__(self, name: str) -> None:
        if self._is_frozen:
            raise AttributeError(self._refusal(name))
        object.__delattr__(self, name)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Of a copy and of a pickle, which lose that arrays are read-only."""
        self.__dict__.update(state)
        for value in state.values():
            _lock(value)

    def _refusal(self, name: str) -> str:
        kind = type(self).__name__
        return f"{name} of a {kind} must not be changed after it is made: make a new {kind}"


# Arrays of the formats of sparse matrices
OF_SPARSE = ("data", "indices", "indptr", "offsets", "coords")


def _lock(value: Any) -> None:
    """Make the arrays of a value read-only."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif sp.issparse(value):
        for name in OF_SPARSE:
            _lock(getattr(value, name, None))
    elif isinstance(value, (tuple, list)):
        for item in value:
            _lock(item)
    elif isinstance(value, dict):
        for item in value.values():
            _lock(item)
