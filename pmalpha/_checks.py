"""Checks of arguments for several modules; messages give the name, the rule and the value got."""

from __future__ import annotations

import functools
import inspect
import operator
import re
from collections.abc import Callable, Collection, Iterable, Sequence
from numbers import Real
from typing import Any, TypeVar, cast

import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])


def without(**removed: str) -> Callable[[Function], Function]:
    """The function, which refuses arguments of earlier versions by what replaces them."""

    def refusing(function: Function) -> Function:
        @functools.wraps(function)
        def called(*args: Any, **options: Any) -> Any:
            for name in removed.keys() & options.keys():
                raise TypeError(f"{name} {removed[name]}, got {options[name]!r}")
            return function(*args, **options)

        return cast(Function, called)

    return refusing


def called(what: str, function: Callable[..., Any], t: float, *motion: Any) -> Any:
    """function(t, *motion) of a user, `what` in messages; its exceptions have a note of both."""
    try:
        return function(t, *motion)
    except Exception as error:
        error.add_note(f"in {what} at t = {t:g}")
        raise


def damping_by_name(function: Function) -> Function:
    """A method of M and K last, which refuses a further matrix by position: (M, C, K) is as
    common."""
    parameters = list(inspect.signature(function).parameters.values())
    names = [x.name for x in parameters if x.kind is x.POSITIONAL_OR_KEYWORD][1:]
    allowed = f"{', '.join(names[:-1])} and {names[-1]}"

    @functools.wraps(function)
    def called(self: Any, *args: Any, **options: Any) -> Any:
        if len(args) > len(names):
            raise TypeError(
                "C must be given by name, C=, got a further argument by position: only "
                f"{allowed} are, in this order"
            )
        return function(self, *args, **options)

    return cast(Function, called)


def real_number(value: Any, name: str, *, low: float = -np.inf, high: float = np.inf) -> float:
    """A finite float in [low, high]."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (Real, np.number)):
        if not (isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "iuf"):
            raise TypeError(f"{name} must be a real number, got {value!r}")
    if np.iscomplexobj(value):
        raise TypeError(f"{name} must be a real number, got {value!r}")
    try:
        number = float(value)
    except OverflowError:
        number = np.inf  # a whole number above the largest double
    if not low <= number <= high or not np.isfinite(number):
        raise ValueError(f"{name} must {_range(low, high)}, got {value!r}")
    return number


def _range(low: float, high: float) -> str:
    if np.isinf(low) and np.isinf(high):
        return "be finite"
    if np.isinf(high):
        return f"be finite and at least {low:g}"
    return f"lie in [{low:g}, {high:g}]"


def positive_number(value: Any, name: str) -> float:
    number = real_number(value, name)
    if not number > 0.0:
        raise ValueError(f"{name} must be positive, got {value!r}")
    return number


def time_step(value: Any, name: str) -> float:
    """A positive number; for what may be a vector of times the error gives advice."""
    if plain_array(value, name).ndim == 1 and np.size(value) > 2:
        raise TypeError(
            f"{name} must be a real number, the step, got an array of shape {np.shape(value)}; of "
            "a vector t of equidistant times give t[1] - t[0]"
        )
    number = positive_number(value, name)
    if not number * number < np.inf:
        raise ValueError(f"{name} must have a finite square, got {value!r}")
    return number


def sampling_step(value: Any, name: str) -> float:
    """A time step with which quotients are in the range of numbers."""
    number = time_step(value, name)
    require_moderate(np.array([number, 1.0 / number]), f"{name} and 1 / {name}")
    return number


# Largest whole number for which no counter of the core overflows.
MOST = 2**53


def whole_number(value: Any, name: str, *, low: int = 0, high: int = MOST) -> int:
    """An int in low..high."""
    if isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} must be a whole number, got {value!r}")
    try:
        number = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} must be a whole number, got {value!r}{as_int(value)}") from None
    if number < low:
        raise ValueError(f"{name} must be at least {low}, got {number}")
    if number > high:
        raise ValueError(f"{name} must be at most {high}, got {number}")
    return number


def as_int(value: Any) -> str:
    """What an error adds for floats, or an array of them, that are whole: which type is needed."""
    try:
        array = np.asarray(value)
    except ValueError:  # lists of several lengths
        return ""
    if array.dtype.kind != "f" or not array.size or np.any(array != np.rint(array)):
        return ""
    return (
        f", a float: give the int {array.item():.0f}" if array.size == 1 else ", floats: give ints"
    )


def flag(value: Any, name: str) -> bool:
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} must be True or False, got {value!r}")
    return bool(value)


def check_word(value: Any, name: str, words: Sequence[str]) -> None:
    """ValueError unless the value is one of these words."""
    if not isinstance(value, str) or value not in words:
        raise ValueError(f"{name} must be {' or '.join(map(repr, words))}, got {value!r}")


def listed(values: Any, name: str, what: str) -> list[Any]:
    """The items of an iterable that is no array."""
    if not isinstance(values, Iterable) or hasattr(values, "ndim"):
        raise TypeError(f"{name} must be {what}, got {values!r}")
    return list(values)


def plain_array(value: Any, name: str) -> np.ndarray:
    """A value as an array; errors name the argument."""
    if isinstance(value, np.ma.MaskedArray):
        raise TypeError(f"{name} must not be a masked array")
    try:
        return np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name} must be a regular array, got a ragged one: {error}") from None


def not_real(array: np.ndarray, name: str) -> TypeError:
    """The error for an array without real numbers, such as one of another object."""
    got = f"dtype {array.dtype}"
    if array.dtype == object and array.ndim == 0:
        one = array.item()
        got = "None" if one is None else f"a {type(one).__name__}"
    return TypeError(f"{name} must hold real numbers, got {got}")


def real_array(value: Any, name: str, ndim: int | tuple[int, ...] = 1) -> np.ndarray:
    """A new C-contiguous float64 array of finite numbers with one of these dimensions.

    It is read-only, so that it cannot change after the check.
    """
    array = plain_array(value, name)
    if array.dtype.kind not in "iuf" or array.dtype.itemsize > 8 and array.dtype.kind != "f":
        raise not_real(array, name)
    dimensions = (ndim,) if isinstance(ndim, int) else ndim
    if array.ndim not in dimensions:
        wanted = " or ".join(f"{d}-D" for d in dimensions)
        raise ValueError(f"{name} must be a {wanted} array, got shape {array.shape}")
    with np.errstate(over="ignore"):  # a longer float may become infinite, which is refused next
        # where a long double is a double, as on Windows, np.array would leave its type
        array = array.astype(np.float64, order="C", subok=False)
    require_finite(array, name)
    array.setflags(write=False)
    return array


def vector(value: Any, n: int, name: str) -> np.ndarray:
    """A new float64 array of shape (n,), finite; a number too where n is 1."""
    if n == 1 and plain_array(value, name).ndim == 0:
        value = plain_array(value, name).reshape(1)
    array = real_array(value, name)
    if array.shape != (n,):
        raise ValueError(f"{name} must have shape ({n},), got {array.shape}")
    return array


def require_finite(array: np.ndarray, name: str) -> None:
    """ValueError that names the first entry that is NaN or infinite."""
    finite = np.isfinite(array)
    if not finite.all():
        where = np.unravel_index(int(np.argmin(finite)), array.shape)
        at = f" at [{', '.join(str(int(i)) for i in where)}]" if where else ""
        raise ValueError(f"{name} must be finite, got {array[where]}{at}")


def require_moderate(array: np.ndarray, name: str, largest: float = 1e50) -> None:
    """ValueError for entries of which products of a few leave the range of numbers."""
    size = np.abs(array).max(initial=0.0)
    if not size <= largest:
        raise ValueError(f"{name} must not exceed {largest:g} in absolute value, got {size:g}")


def counted(count: int, noun: str) -> str:
    """``1 dof``, ``2 dofs``"""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def numbered(noun: str, numbers: Sequence[Any] | np.ndarray) -> str:
    """``dof 3``, ``dofs 1, 2``"""
    return f"{noun}{'' if len(numbers) == 1 else 's'} {listing(numbers)}"


def listing(numbers: Collection[Any] | np.ndarray, most: int = 5) -> str:
    """``1, 2, 3, ... (12 in all)``"""
    shown = ", ".join(str(x) for x in list(numbers)[:most])
    return shown if len(numbers) <= most else f"{shown}, ... ({len(numbers)} in all)"


# "3.+5", "-1.25D-3", "2.5+10": the letter of the exponent is optional
FORTRAN = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[EeDd]?([+-]\d+)|[EeDd](\d+))?")


def fortran_real(text: str) -> float:
    """A number as Python or Fortran writes it; ValueError for other text."""
    try:
        return float(text)
    except ValueError:
        pass
    match = FORTRAN.fullmatch(text.strip())
    if match is None:
        raise ValueError(f"must have numbers, got {text!r}")
    return float(f"{match[1]}e{match[2] or match[3] or 0}")
