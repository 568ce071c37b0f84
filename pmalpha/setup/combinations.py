"""What does not go with what in a coupler, as far as it is known before a run: a row for each pair.

`require_combinations` is called with all subdomains before anything is ordered or factored.
docs/combinations.md shows what follows, and tests/test_combinations.py tries each row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

from ..problem.schemes import explicit_rho
from ..problem.subdomain import Subdomain

LEAST_EXPLICIT_RHO = 0.5  # of mean coupling, near the critical step


class Placed(NamedTuple):
    """A subdomain in a coupler, and what is around it."""

    name: str
    s: Subdomain
    coupling: str
    start: str
    double: bool
    touches: bool  # a contact has rows on it
    beside_contact: bool  # a contact is in the coupler


class Refusal(NamedTuple):
    """Two features by their words in `FEATURES`, and what the user is told, of {name}."""

    one: str
    other: str
    words: str


Feature = Callable[[Placed], bool]

FEATURES: dict[str, Feature] = {
    "contact on it": lambda x: x.touches,
    "contact beside it": lambda x: x.beside_contact,
    '"macro" or "mean"': lambda x: x.coupling in ("macro", "mean"),
    '"mean"': lambda x: x.coupling == "mean",
    "internal forces": lambda x: x.s.internal is not None,
    "iterated forces": lambda x: x.s.iterates,
    "unsymmetric matrices": lambda x: not x.s.has_symmetric_steps,
    "restoring forces": lambda x: x.s.restoring is not None,
    "a force of the motion": lambda x: x.s.has_feedback,
    "explicit with a low rho": lambda x: (
        x.s.scheme.explicit and explicit_rho(x.s.scheme) < LEAST_EXPLICIT_RHO
    ),
    "internal forces and restoring functions": lambda x: (
        x.s.internal is not None and x.s.has_functions
    ),
    "internal forces and a force of the motion": lambda x: (
        x.s.internal is not None and x.s.has_feedback
    ),
    "plain start": lambda x: x.start == "plain" and x.coupling == "pm",
    "iterated double steps": lambda x: x.s.iterates and x.double,
}

REFUSALS = (
    Refusal(
        "contact beside it",
        '"macro" or "mean"',
        'contacts need coupling "gc" or "pm", got "{coupling}", where gaps between the ends of '
        "macro steps would not be seen",
    ),
    Refusal(
        "contact on it",
        "internal forces",
        "contacts need subdomains without internal forces, got some on {name!r}: the impulses "
        "would be part of Newton's iteration; springs as restoring= are possible",
    ),
    Refusal(
        "contact beside it",
        "iterated forces",
        "contacts need a Coupler without internal forces that are iterated, got some on {name!r}: "
        "the multipliers of their iteration would have to know the impulses; springs as restoring= "
        "are possible",
    ),
    Refusal(
        "contact on it",
        "unsymmetric matrices",
        "contacts need symmetric matrices, got others of {name!r}",
    ),
    Refusal(
        '"mean"',
        "restoring forces",
        'coupling must be "macro", "pm" or "gc" with restoring forces, got "mean" and restoring '
        "forces in {name!r}: the free macro run has no multipliers, so that forces would be "
        "evaluated away from the motion",
    ),
    Refusal(
        '"mean"',
        "a force of the motion",
        'coupling must be "macro", "pm" or "gc" with a force that is a function of t, u and v, got '
        '"mean" and such a force on {name!r}: it would be evaluated away from the motion',
    ),
    Refusal(
        '"mean"',
        "explicit with a low rho",
        f'coupling="mean" needs rho >= {LEAST_EXPLICIT_RHO} in explicit subdomains, below which it '
        "is unstable near the critical step, got {rho:g} in {name!r}",
    ),
    Refusal(
        '"macro" or "mean"',
        "internal forces and restoring functions",
        "restoring of {name!r} must have no functions where there are internal forces under "
        'coupling="{coupling}", which repeats its substeps; take "pm" or "gc", or put the '
        "restoring force into a subdomain of its own",
    ),
    Refusal(
        '"macro" or "mean"',
        "internal forces and a force of the motion",
        "force of {name!r} must not be a function of t, u and v where there are internal forces "
        'under coupling="{coupling}", which repeats its substeps; take "pm" or "gc"',
    ),
    Refusal(
        "plain start",
        "iterated double steps",
        'start must be "rebased" with internal forces in subdomains with double steps, got "plain" '
        "and {name!r}",
    ),
)


def require_combinations(subdomains: Iterable[Placed]) -> None:
    """ValueError for the first subdomain with two features that do not go together."""
    for x in subdomains:
        for refusal in REFUSALS:
            if FEATURES[refusal.one](x) and FEATURES[refusal.other](x):
                rho = explicit_rho(x.s.scheme) if x.s.scheme.explicit else 1.0
                raise ValueError(refusal.words.format(name=x.name, coupling=x.coupling, rho=rho))
