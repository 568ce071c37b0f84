"""What a coupler shows: the motion of a subdomain, its springs, and a table of all subdomains."""

from __future__ import annotations

from html import escape

import numpy as np

from .._checks import counted
from .._tables import html_table, text_table
from ..problem.forms import Band, Compressed, Factor
from ..problem.matrices import combination
from ..problem.schemes import CentralDifference, Scheme
from ..problem.springs import SpringState
from ..problem.subdomain import Subdomain
from ..results.quantities import position
from ..results.times import State
from ..setup.internal_forces import closing_tangent
from ..setup.member import Member
from ..setup.stability import SMALL, limit_of
from .session import Session, begin

__all__ = ["State"]


def __dir__() -> list[str]:
    return sorted(__all__)


HEADINGS = (
    "subdomain",
    "dofs",
    "scheme",
    "rho",
    "step",
    "double",
    "substeps",
    "step / critical",
    "factor",
    "thread",
)
LEFT = ("subdomain", "scheme", "factor")  # columns of words


def state(session: Session, key: str | int | Subdomain) -> State:
    i = position(key, session.keys)
    with session.guard:  # another thread may change the steps, and with them the members
        begin(session)
        return state_of(session, i)


def state_of(session: Session, i: int) -> State:
    """The motion of subdomain i, within a call."""
    member = session.members[i]
    u, v, w = member.core.state()
    if member.mean:
        lam = session.core.numbers()["end_multipliers"][: session.core_rows.p]
        w = w + member.core.accelerate(lam)
    u, v, w = (x[member.position] for x in (u, v, w))
    return State(u, v, w, n=member.n, dof_names=member.subdomain.dof_names)


def multipliers_of(session: Session) -> np.ndarray:
    """The interface force in the rows of the user, within a call."""
    forces: np.ndarray = session.core_rows.forces(session.core.multipliers)
    return forces


def springs(session: Session, key: str | int | Subdomain) -> SpringState:
    i = position(key, session.keys)
    with session.guard:
        begin(session)
        deformation, force = session.members[i].core.springs()[:2]
    return SpringState(deformation, force)


def title(session: Session) -> str:
    """What a coupler is, in a line."""
    threads = counted(session.core.threads, "thread")
    start = f"Coupler: coupling = {session.coupling!r}, dt = {session.steps.layout.dt:g}"
    return f"{start}, {counted(session.rows.p, 'constraint')}, {threads}"


def table(session: Session) -> list[tuple[str, ...]]:
    """The rows below `HEADINGS`, made once for the present steps."""
    assembly, known = session.assembly, session.table
    if known is None or known[0] is not assembly:  # another thread may change the steps meanwhile
        rows = [row_of(*x) for x in zip(assembly.members, assembly.core.workers)]
        session.table = known = assembly, rows
    return known[1]


def text_of(session: Session) -> str:
    """The repr of a coupler."""
    return f"<{title(session)}>\n{text_table(HEADINGS, table(session), LEFT)}"


def html_of(session: Session) -> str:
    return f"<p>{escape(title(session))}</p>{html_table(HEADINGS, table(session), LEFT)}"


def row_of(member: Member, thread: int | None) -> tuple[str, ...]:
    """The entries of a subdomain in the order of `HEADINGS`."""
    s, tangent = member.subdomain, member.tangent
    name, kind = type(s.scheme).__name__, "explicit" if s.scheme.explicit else "implicit"
    iterated = None if tangent is None else f"of each tangent, {tangent.entries}"
    return (
        member.name,
        str(member.n),
        name if name == "CentralDifference" else f"{name}, {kind}",
        radius_of(s.scheme),
        f"{member.step:g}",
        "yes" if member.double else "no",
        str(member.substeps),
        step_ratio(member),
        iterated or factor_form(member.factors[-1]),
        "all" if thread is None else str(thread),
    )


def radius_of(scheme: Scheme) -> str:
    """rho as given, or the spectral radius at infinite frequency; "-" for other explicit ones."""
    rho = 1.0 if type(scheme) is CentralDifference else getattr(scheme, "rho", None)
    if rho is None and not scheme.explicit:
        rho = scheme.radius_at_infinity()
    return "-" if rho is None else f"{rho:.3g}"


def step_ratio(member: Member) -> str:
    """Step divided by critical step; "-" for a restoring function without estimated stiffness.

    Above `SMALL` dofs it is an upper bound, "<= 0.7", unless set-up needed the exact one.
    """
    s = member.subdomain
    if member.step_ratio is None or s.has_unknown_stiffness:
        return "-"
    ratio, is_bound = member.step_ratio.value, member.step_ratio.is_bound
    if ratio == 0.0:
        return "no limit"
    if is_bound and member.n <= SMALL:
        internal = None if member.internal is None else member.internal.K
        K = combination([(1.0, internal), (1.0, closing_tangent(s))])
        ratio, is_bound = member.step / limit_of(s, K), False
    return f"<= {ratio:.3g}" if is_bound else f"{ratio:.3g}"


def factor_form(factor: Factor) -> str:
    """The form of a factor and the number of its entries, the diagonal included."""
    return "{}, {}".format(*form_and_entries(factor))


def form_and_entries(factor: Factor) -> tuple[str, int]:
    """The form of a factor, and the number of its entries, the diagonal included."""
    inverse, R = factor
    n = inverse.size
    if R is None:
        return "diagonal", n
    if isinstance(R, np.ndarray):
        return "dense", n * (n + 1) // 2
    if isinstance(R, Band):
        return "band", n + R.band.size
    if isinstance(R, Compressed):
        return "columns", n + R.values.size
    return "panels", R.values.size
