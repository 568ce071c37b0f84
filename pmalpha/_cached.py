"""Objects whose attributes cannot be assigned after they are made."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, ClassVar, Generic, TypeVar, overload
from weakref import ref

import numpy as np
import scipy.sparse as sp

# ----  cached ------------------------------------------------------------------------------------
# What is computed at its first use and kept: properties, without a lock, and other results.

T = TypeVar("T")


class Once:
    """What is computed once for equal arguments: objects are equal to themselves only."""

    def __init__(self) -> None:
        self._known: dict[tuple[Any, ...], tuple[Any, tuple[Any, ...]]] = {}

    def __call__(self, make: Callable[[], T], objects: tuple[Any, ...], *values: Any) -> T:
        """What `make` returned for these objects, which do not change, and these values."""
        key = (*values, *map(id, objects))
        known = self._known.get(key)
        if known is None:
            known = self._known[key] = make(), objects  # which live as long as their numbers
        return known[0]

    def clear(self) -> None:
        self._known.clear()


class Living(Generic[T]):
    """Values by their keys while somebody else holds them.

    weakref.WeakValueDictionary calls a function of Python when a value goes, and a Ctrl-C that
    arrives in it is printed and lost. Here nothing is called: who stores clears away the dead.
    """

    def __init__(self) -> None:
        self._known: dict[Any, ref[Any]] = {}
        self._most = 64

    def get(self, key: Any) -> T | None:
        reference = self._known.get(key)
        return None if reference is None else reference()

    def __setitem__(self, key: Any, value: T) -> None:
        if len(self._known) >= self._most:
            # in one piece: another thread may store too
            self._known = {key: x for key, x in tuple(self._known.items()) if x() is not None}
            self._most = max(64, 2 * len(self._known))
        self._known[key] = ref(value)

    def items(self) -> list[tuple[Any, T]]:
        known = [(key, x()) for key, x in tuple(self._known.items())]
        return [(key, value) for key, value in known if value is not None]


class cached_property(functools.cached_property[T]):
    """That of Python 3.12: the one of 3.11 has a lock for all objects of a class.

    A process that another thread forks off while it is taken would wait for it for ever. So of two
    threads both may compute a value; the later one is kept.
    """

    @overload
    def __get__(self, instance: None, owner: type[Any] | None = None) -> cached_property[T]: ...

    @overload
    def __get__(self, instance: object, owner: type[Any] | None = None) -> T: ...

    def __get__(self, instance: object, owner: type[Any] | None = None) -> Any:
        if instance is None:
            return self
        assert self.attrname is not None
        value = instance.__dict__[self.attrname] = self.func(instance)
        return value


# ---- frozen -------------------------------------------------------------------------------------


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
