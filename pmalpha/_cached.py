"""What is computed at its first use and kept: properties, without a lock, and other results."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeVar, overload

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
