"""What ended a macro step in the core, by names: its one description in Python.

Positions of dofs are those of the core, None where there is none; subdomains are counted over all
processes.
"""

from __future__ import annotations

from typing import Literal, TypeAlias, TypedDict


class Unstable(TypedDict):
    """A value that is not finite, or a motion out of bounds; after all subdomains the interface."""

    kind: Literal["unstable"]
    subdomain: int


class NotConverged(TypedDict):
    """An iteration of a subdomain, at t; the dof where its tangent is singular, and the one where
    the force of its compiled functions is not finite; whether all values were."""

    kind: Literal["iteration"]
    subdomain: int
    t: float
    corrections: int
    singular: int | None
    spoiled: int | None
    finite: bool


class InterfaceNotConverged(TypedDict):
    """The iteration of the interface, whose matrix of the tangents may be singular."""

    kind: Literal["interface"]
    singular: bool


class Unsymmetric(TypedDict):
    """A tangent that should be symmetric, at t."""

    kind: Literal["unsymmetric"]
    subdomain: int
    t: float


class FunctionFailed(TypedDict):
    """A compiled function returned a code; what it is to the subdomain."""

    kind: Literal["function"]
    subdomain: int
    code: int
    what: str


class Limited(TypedDict):
    """A command or a force beyond a limit of a rig."""

    kind: Literal["limit"]
    subdomain: int
    what: str
    position: int
    value: float
    limit: float
    t: float
    by_clock: bool


class NoImpulses(TypedDict):
    """The impulses of contacts do not come to an end, furthest in this row."""

    kind: Literal["contact"]
    row: int


class Late(TypedDict):
    """A step of a paced run ended late."""

    kind: Literal["late"]


class FailedElsewhere(TypedDict):
    """Something failed in another process; in this one when the exchange did."""

    kind: Literal["elsewhere"]
    rank: int


Failure: TypeAlias = (
    Unstable
    | NotConverged
    | InterfaceNotConverged
    | Unsymmetric
    | FunctionFailed
    | Limited
    | NoImpulses
    | Late
    | FailedElsewhere
)
