"""Objects whose attributes cannot be assigned after they are made."""

from __future__ import annotations

from typing import Any, ClassVar


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

    def _refusal(self, name: str) -> str:
        kind = type(self).__name__
        return f"{name} of a {kind} must not be changed after it is made: make a new {kind}"
