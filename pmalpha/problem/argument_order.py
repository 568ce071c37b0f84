"""The order of the arguments of a user's function: the time is the first, for all kinds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from inspect import Parameter, signature
from typing import Any

# By argument of `Subdomain`, as in argument_types.py.
OF_FORCE = ("t", "u", "v")
OF_RESTORING = ("t", "u", "v")
OF_INTERNAL = ("t", "u", "v", "q")
OF_ELEMENTS = (*OF_INTERNAL, "elements")
TIME = {"t", "time"}


def required_names(function: Callable[..., Any], *, wrapped: bool = True) -> list[str] | None:
    """Names of the positional arguments that it requires; one, if it can be called with one.

    None for a function without a readable signature, such as a compiled one. `wrapped`: those of
    the function behind a decorator that says which it is.
    """
    parameters = _parameters(function, wrapped)
    if parameters is None:
        return None
    positional = _positional(parameters)
    required = [p.name for p in positional if p.default is p.empty]
    optional = [p.name for p in parameters if p in positional or p.kind is p.VAR_POSITIONAL]
    return required or optional[:1]


def check_order(function: Callable[..., Any], expected: Sequence[str], name: str) -> None:
    """TypeError for the expected arguments in another order, and for a time that is not the first.
    Other names are the user's own."""
    # a decorator may have changed the order
    parameters = _parameters(function, wrapped=False)
    if parameters is None:
        return
    names = [p.name for p in _positional(parameters)]
    late = not TIME.isdisjoint(names[1:]) and names[0] not in TIME
    required = required_names(function, wrapped=False) or []
    if late or (sorted(required) == sorted(expected) and required != [*expected]):
        raise TypeError(
            f"{name} must be a function of {', '.join(expected)} in this order, got one of "
            f"{', '.join(names)}: {function!r}"
        )


def _parameters(function: Callable[..., Any], wrapped: bool) -> list[Parameter] | None:
    try:
        return [*signature(function, follow_wrapped=wrapped).parameters.values()]
    except (TypeError, ValueError):
        return None


def _positional(parameters: Sequence[Parameter]) -> list[Parameter]:
    return [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
