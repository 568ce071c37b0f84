"""Inputs and outputs of a frozen model, as a user gives them and as its file has them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from .._checks import real_number, whole_number
from ..problem.dofs import dof_list
from ..problem.subdomain import Subdomain
from ..results.keys import position

# What is given by subdomain and dof, and by subdomain and spring.
OF_DOFS, OF_SPRINGS = ("u", "v", "a"), ("deformation", "spring force")
# As FMI has structured names.
NAME = re.compile(r"[A-Za-z_]\w*(\[\d+\])?(\.[A-Za-z_]\w*(\[\d+\])?)*", re.ASCII)
Keys: TypeAlias = Sequence[tuple[str, Subdomain]]


class Input(NamedTuple):
    """An input: kind, subdomain and dof, or the row of a velocity; its value at the start."""

    name: str
    kind: str
    subdomain: int
    dof: int
    value: float | None  # None: not given

    @property
    def place(self) -> tuple[str, int, int]:
        return self.kind, self.subdomain, self.dof


class Output(NamedTuple):
    """An output: quantity, subdomain and dof or spring, or the row of a multiplier."""

    name: str
    what: str
    subdomain: int
    number: int


@dataclass(frozen=True)
class Ports:
    """The inputs and outputs of a model."""

    inputs: tuple[Input, ...]
    outputs: tuple[Output, ...]

    @classmethod
    def of(cls, inputs: Any, outputs: Any, keys: Keys, rows: int) -> Ports:
        """Checked; ValueError for what does not exist, by its name.

        keys: the names and subdomains of the coupler.
        rows: number of rows of its constraints.
        """
        for ports, argument in ((inputs, "inputs"), (outputs, "outputs")):
            if ports is not None and not isinstance(ports, Mapping):
                raise TypeError(f"{argument} must be a dict by name, got {ports!r}")
        names = [*(inputs or {}), *(outputs or {})]
        for name in names:
            if not isinstance(name, str) or not NAME.fullmatch(name):
                raise ValueError(
                    "names of inputs and outputs must be identifiers, with dots between them, got "
                    f"{name!r}"
                )
            if names.count(name) > 1:
                raise ValueError(
                    f"inputs and outputs must have different names, got {name!r} twice"
                )
        made = cls(
            tuple(_input(name, x, keys, rows) for name, x in (inputs or {}).items()),
            tuple(_output(name, x, keys, rows) for name, x in (outputs or {}).items()),
        )
        places = [x.place for x in made.inputs]
        for x in made.inputs:
            if places.count(x.place) > 1:
                raise ValueError(f"inputs must be of different dofs, but that of {x.name!r} is not")
        return made

    def of_kind(self, kind: str, subdomain: int) -> list[Input]:
        return [x for x in self.inputs if x.kind == kind and x.subdomain == subdomain]


def _input(name: str, value: Any, keys: Keys, rows: int) -> Input:
    what = f"inputs[{name!r}]"
    kind, *where = _entry(value, what, ("specimen", "force", "velocity"))
    length = 1 if kind == "velocity" else 2
    start = None
    if len(where) == length + 1:
        start = real_number(where.pop(), f"the value at the start of {what}")
    if kind == "velocity":
        _check_length(where, length, what, '("velocity", row) or ("velocity", row, value)')
        return Input(name, kind, 0, _row(where[0], rows, what), start)
    form = f"({kind!r}, subdomain, dof)"
    _check_length(where, length, what, f"{form} or {form[:-1]}, value)")
    return Input(name, kind, *_dof(where, keys, what), start)


def _row(value: Any, rows: int, what: str) -> int:
    row = whole_number(value, what, low=0)
    if row >= rows:
        raise ValueError(f"{what} must be one of {rows} rows, got {row}")
    return row


def _output(name: str, value: Any, keys: Keys, rows: int) -> Output:
    what = f"outputs[{name!r}]"
    quantity, *where = _entry(value, what, (*OF_DOFS, *OF_SPRINGS, "multiplier"))
    if quantity == "multiplier":
        _check_length(where, 1, what, '("multiplier", row)')
        return Output(name, quantity, 0, _row(where[0], rows, what))
    _check_length(where, 2, what, f"({quantity!r}, subdomain, number)")
    if quantity in OF_DOFS:
        return Output(name, quantity, *_dof(where, keys, what))
    i = _subdomain(where[0], keys, what)
    springs = sum(len(spring) for spring in keys[i][1].springs)
    spring = whole_number(where[1], what, low=0)
    if spring >= springs:
        raise ValueError(
            f"{what} must be one of {springs} springs of subdomain {keys[i][0]!r}, got {spring}"
        )
    return Output(name, quantity, i, spring)


def _entry(value: Any, what: str, words: Sequence[str]) -> tuple[Any, ...]:
    if not isinstance(value, tuple) or not value or value[0] not in words:
        raise ValueError(f"{what} must be a tuple that begins with one of {words}, got {value!r}")
    return value


def _check_length(where: Sequence[Any], length: int, what: str, form: str) -> None:
    if len(where) != length:
        raise ValueError(f"{what} must be {form}")


def _subdomain(key: Any, keys: Keys, what: str) -> int:
    try:
        return position(key, keys)
    except LookupError as error:
        raise ValueError(f"{what}: {error.args[0]}") from None


def _dof(where: Sequence[Any], keys: Keys, what: str) -> tuple[int, int]:
    i = _subdomain(where[0], keys, what)
    s = keys[i][1]
    dofs = np.asarray(dof_list([where[1]], s.n, what, s.dof_names))
    return i, int(dofs[0])
