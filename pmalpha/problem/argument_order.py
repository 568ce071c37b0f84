"""The order of the arguments of a user's function: that of one kind is not that of another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from inspect import signature
from typing import Any

# By argument of `Subdomain`, as in argument_types.py.
OF_FORCE = ("t", "u", "v")
OF_RESTORING = ("u", "v", "t")
OF_INTERNAL = ("u", "v", "t", "q")


def required_names(function: Callable[..., Any], *, wrapped: bool = True) -> list[str] | None:
    """Names of the positional arguments that it requires; one, if it can be called with one.

    None for a function without a readable signature, such as a compiled one. `wrapped`: those of
    the function behind a decorator that says which it is.
    """
    try:
        parameters = signature(function, follow_wrapped=wrapped).parameters.values()
    except (TypeError, ValueError):
        return None
    positional = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    required = [p.name for p in positional if p.default is p.empty]
    optional = [p.name for p in parameters if p in positional or p.kind is p.VAR_POSITIONAL]
    return required or optional[:1]


def check_order(function: Callable[..., Any], expected: Sequence[str], name: str) -> None:
    """TypeError for the expected arguments in another order. Other names are the user's own."""
    # a decorator may have changed the order
    names = required_names(function, wrapped=False)
    if names is not None and names != [*expected] and sorted(names) == sorted(expected):
        raise TypeError(
            f"{name} must be a function of {', '.join(expected)} in this order, got one of "
            f"{', '.join(names)}: {function!r}"
        )
