"""What does not go with what, as far as it is known before a run: a row for each pair.

`SCHEMES` are compared with what subdomains and the coupling ask for, before steps are known,
`REFUSALS` when they are, before anything is ordered or factored; `CALLS` are of what one does with
a coupler. Elsewhere are refused: arguments of one object by that object, what depends on numbers of
several subdomains (substeps, ratios of steps, rows) where they are compared.

docs/combinations.md shows what follows, and tests/test_combinations.py tries each row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from .._checks import numbered
from ..problem.schemes import Newmark, explicit_rho
from ..problem.subdomain import Subdomain

LEAST_EXPLICIT_RHO = 0.5  # of mean coupling, near the critical step


class Placed(NamedTuple):
    """A subdomain in a coupler, and what is around it."""

    name: str
    s: Subdomain
    coupling: str
    start: str = "rebased"
    double: bool = False
    touches: bool = False  # a contact has rows on it
    beside_contact: bool = False  # a contact is in the coupler
    moved: bool = False  # a constraint of the coupler has a velocity
    is_shared: bool = False  # by several processes


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
    'plain start under "pm"': lambda x: x.start == "plain" and x.coupling == "pm",
    "iterated double steps": lambda x: x.s.iterates and x.double,
    "other scheme": lambda x: not x.s.scheme.is_generalized_alpha,
    "scheme of two stages": lambda x: x.s.scheme.is_of_two_stages,
    'other than "gc"': lambda x: x.coupling != "gc",
    "comm": lambda x: x.is_shared,
    "double_step=True": lambda x: bool(x.s.double_step),
    '"pm"': lambda x: x.coupling == "pm",
    "double steps": lambda x: x.double,
    '"mean" and double steps': lambda x: x.coupling == "mean" and x.double,
    '"mean" and not the trapezoidal rule': lambda x: (
        x.coupling == "mean"
        and (x.s.scheme.explicit or x.s.scheme.parameters != Newmark().parameters)
    ),
    '"mean" and a prescribed velocity': lambda x: x.coupling == "mean" and x.moved,
    "plain start": lambda x: x.start == "plain",
    "lagged damping": lambda x: x.s.damping == "lagged",
    "no mass at a dof": lambda x: x.s.massless.size > 0,
    "a function of the motion": lambda x: x.s.has_functions or x.s.has_feedback,
}

OF_FAMILY = "needs a scheme of the generalized-alpha family, got {scheme!r} of {name!r}"
OF_ONE_STAGE = "needs a scheme of one stage, got {scheme!r} of {name!r}"

SCHEMES = (
    Refusal("comm", "scheme of two stages", "comm " + OF_ONE_STAGE),
    Refusal('other than "gc"', "other scheme", 'coupling="{coupling}" ' + OF_FAMILY),
    Refusal("double_step=True", "other scheme", "double_step=True " + OF_FAMILY),
    Refusal("restoring forces", "scheme of two stages", "restoring= " + OF_ONE_STAGE),
    Refusal("internal forces", "scheme of two stages", "internal= " + OF_ONE_STAGE),
    Refusal(
        "a force of the motion",
        "scheme of two stages",
        "a force that is a function of t, u and v " + OF_ONE_STAGE,
    ),
)

REFUSALS = (
    Refusal("contact on it", "other scheme", "a contact " + OF_FAMILY),
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
        'plain start under "pm"',
        "iterated double steps",
        'start must be "rebased" with internal forces in subdomains with double steps, got "plain" '
        "and {name!r}",
    ),
)


# ---- calls --------------------------------------------------------------------------------------

GRADIENT, JACOBIAN = "gradient without differences=", "jacobian without differences="
# derived for linear runs, and of these by runs back in time
ADJOINT = ("error_budget", GRADIENT, JACOBIAN)
LINEAR = (*ADJOINT, "growth", "amplification_matrix", "exact_solution", "local_error")

# calls, a feature, and what the user is told after the name of the call
CALLS: tuple[tuple[tuple[str, ...], str, str], ...] = (
    ((*LINEAR, "tolerance", "static"), "contact beside it", "needs a Coupler without contacts"),
    (LINEAR, "internal forces", "needs linear subdomains, got an internal force on {name!r}"),
    (LINEAR, "restoring forces", "needs linear subdomains, got a restoring force on {name!r}"),
    (
        LINEAR,
        "a force of the motion",
        "needs loads that do not depend on the motion, got a force that is a function of t, "
        "u and v on {name!r}",
    ),
    ((*ADJOINT, "energy=True", "a change of steps"), "other scheme", OF_FAMILY),
    (
        ("tolerance", "run_paced", "estimate_error", "export_fmu"),
        "scheme of two stages",
        OF_ONE_STAGE,
    ),
    (
        ADJOINT,
        '"mean" and not the trapezoidal rule',
        'needs the trapezoidal rule under "mean", Newmark(), got {scheme!r} of {name!r}',
    ),
    (
        ADJOINT,
        '"mean" and double steps',
        'needs single steps under "mean", got double ones of {name!r}',
    ),
    (
        ADJOINT,
        '"mean" and a prescribed velocity',
        'needs constraints without velocity under "mean"',
    ),
    (ADJOINT, "plain start", 'needs start="rebased", got "{start}"'),
    (ADJOINT, "lagged damping", 'needs damping="implicit", got "lagged" of {name!r}'),
    (ADJOINT, "no mass at a dof", "needs a mass at each dof, got none at {dofs} of {name!r}"),
    (("error_budget",), "double steps", "needs single steps, got double ones of {name!r}"),
    (
        ("tolerance",),
        '"pm"',
        'needs coupling="gc", got "pm", whose double steps would begin anew at each change; '
        "change_steps changes steps under every coupling",
    ),
    (
        ("tolerance",),
        '"macro" or "mean"',
        'needs coupling="gc", got "{coupling}", where the error of the multipliers over dt is not '
        "seen by it; change_steps changes steps under every coupling",
    ),
    (
        ("tolerance",),
        "a function of the motion",
        "must come without restoring functions and forces that are functions of t, u and v, "
        "which are evaluated once for every substep, since macro steps can be repeated; got one on "
        "{name!r}",
    ),
    (
        ("run_paced",),
        '"macro" or "mean"',
        "needs coupling 'pm' or 'gc', whose interface problem is solved in every fine step: "
        "under {coupling!r} the substeps of a macro step are a free run ahead of the interface "
        "force, so that commands have no times of their own",
    ),
)


def require_schemes(subdomains: Iterable[Placed]) -> None:
    """ValueError for the first scheme that does not go with its subdomain or the coupling."""
    _require(SCHEMES, subdomains)


def require_combinations(subdomains: Iterable[Placed]) -> None:
    """ValueError for the first subdomain with two features that do not go together."""
    _require(REFUSALS, subdomains)


def _require(refusals: Sequence[Refusal], subdomains: Iterable[Placed]) -> None:
    for x in subdomains:
        for refusal in refusals:
            if FEATURES[refusal.one](x) and FEATURES[refusal.other](x):
                raise ValueError(words_of(refusal.words, x))


def require_call(what: str, subdomains: Sequence[Placed]) -> None:
    """ValueError for the first row of the call `what` with a feature of a subdomain."""
    rows = [(feature, words) for calls, feature, words in CALLS if what in calls]
    assert rows, what
    for feature, words in rows:
        for x in subdomains:
            if FEATURES[feature](x):
                raise ValueError(f"{what} {words_of(words, x)}")


def words_of(words: str, x: Placed) -> str:
    """The words of a row for a subdomain."""
    return words.format(
        name=x.name,
        coupling=x.coupling,
        start=x.start,
        scheme=x.s.scheme,
        rho=explicit_rho(x.s.scheme) if x.s.scheme.explicit else 1.0,
        dofs=numbered("dof", x.s.massless),
    )
