"""What a coupler shows of itself: a table with a row for each subdomain."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from html import escape
from typing import Any

import numpy as np

from .._checks import counted
from ..problem.schemes import CentralDifference, Scheme
from ..problem.subdomain import Subdomain
from ..setup.constraint_rows import ConstraintRows
from ..setup.factors import Factor
from ..setup.part import Part
from ..setup.stability import SMALL, limit_of

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


class Description:
    """What a `Coupler` was made from, as properties and as a table.

    Examples
    --------
    >>> a = Subdomain([0.5], [2.0], scheme=Newmark(), name="a")
    >>> b = Subdomain([0.5], [2.0], scheme=CentralDifference(), substeps=20, name="b")
    >>> coupler = Coupler([a, b], tie(a, [0], b, [0]), dt=0.01)
    >>> coupler  # doctest: +ELLIPSIS
    <Coupler: coupling = 'pm', dt = 0.01, 1 constraint, 1 thread>
    subdomain  dofs  scheme             rho    step  double  substeps  step / critical ...
    a             1  Newmark, implicit    1    0.02     yes         1         no limit ...
    b             1  CentralDifference    1  0.0005      no        20           0.0005 ...
    >>> coupler.coupling, coupler.dt
    ('pm', 0.01)
    """

    _keys: tuple[tuple[str, Subdomain], ...]
    _options: dict[str, Any]
    _steps: Any
    _parts: tuple[Part, ...]
    _rows: ConstraintRows
    _core: Any

    @property
    def dt(self) -> float:
        """The macro step at present."""
        return self._steps.layout.dt

    @property
    def coupling(self) -> str:
        """The schedule by which the subdomains advance: "pm", "gc", "macro" or "mean"."""
        return self._options["coupling"]

    @property
    def drift(self) -> str:
        """Whether the displacement drift is "kept", or "removed" by second multipliers."""
        return self._options["drift"]

    @property
    def subdomains(self) -> tuple[Subdomain, ...]:
        """The subdomains in their order; they cannot be changed here."""
        return tuple(subdomain for _, subdomain in self._keys)

    @cached_property
    def _table(self) -> list[tuple[str, ...]]:
        """The rows below `HEADINGS`, until the steps change."""
        return [row_of(part, thread) for part, thread in zip(self._parts, self._core.workers)]

    @property
    def _title(self) -> str:
        constraints = counted(self._rows.p, "constraint")
        threads = counted(self._core.threads, "thread")
        drift = "" if self.drift == "kept" else ", drift removed"
        start = f"Coupler: coupling = {self.coupling!r}{drift}, dt = {self.dt:g}"
        return f"{start}, {constraints}, {threads}"

    def __repr__(self) -> str:
        return f"<{self._title}>\n{text_table(HEADINGS, self._table)}"

    def _repr_html_(self) -> str:
        return f"<p>{escape(self._title)}</p>{html_table(HEADINGS, self._table)}"


def row_of(part: Part, thread: int | None) -> tuple[str, ...]:
    """The entries of a subdomain in the order of `HEADINGS`."""
    s = part.subdomain
    return (
        part.name,
        str(part.n),
        word_of(s.scheme),
        radius_of(s.scheme),
        f"{part.step:g}",
        "yes" if part.double else "no",
        str(part.substeps),
        step_ratio(part),
        factor_of(part),
        "all" if thread is None else str(thread),
    )


def word_of(scheme: Scheme) -> str:
    """The family of a scheme and its kind; a CentralDifference is explicit by its name."""
    name = type(scheme).__name__
    return name if name == "CentralDifference" else f"{name}, {kind_of(scheme)}"


def kind_of(scheme: Scheme) -> str:
    return "explicit" if scheme.explicit else "implicit"


def radius_of(scheme: Scheme) -> str:
    """rho as given, or the spectral radius at infinite frequency; "-" for other explicit ones."""
    rho = 1.0 if type(scheme) is CentralDifference else getattr(scheme, "rho", None)
    if rho is None and not scheme.explicit:
        rho = scheme.radius_at_infinity()
    return "-" if rho is None else f"{rho:.3g}"


def step_ratio(part: Part) -> str:
    """Step divided by critical step; "-" for a restoring function without estimated stiffness.

    Above `SMALL` dofs it is an upper bound, "<= 0.7", unless set-up needed the exact one.
    """
    s = part.subdomain
    if part.step_ratio is None or s.has_unknown_stiffness:
        return "-"
    ratio, is_bound = part.step_ratio.value, part.step_ratio.is_bound
    if ratio == 0.0:
        return "no limit"
    if is_bound and part.n <= SMALL:
        internal = None if part.internal is None else part.internal.K
        ratio, is_bound = part.step / limit_of(s, internal), False
    return f"<= {ratio:.3g}" if is_bound else f"{ratio:.3g}"


def factor_of(part: Part) -> str:
    """The form of the factor of a substep; of one that is iterated, that of its tangents."""
    if part.tangent is not None:
        return f"of each tangent, {part.tangent.entries}"
    return factor_form(part.factors[-1], along_paths=part.elimination.paths is not None)


def factor_form(factor: Factor, *, along_paths: bool) -> str:
    """The form of a factor and the number of its entries, the diagonal included."""
    inverse, R = factor
    n = inverse.size
    if R is None:
        return f"diagonal, {n}"
    if isinstance(R, np.ndarray):
        return f"dense, {n * (n + 1) // 2}"
    if len(R) == 1:
        return f"band, {n + R[0].size}"
    if len(R) == 3:
        return f"columns, {n + R[2].size}"
    order = "panels in the ordinary order" if along_paths else "panels"
    return f"{order}, {R[4].size}"


def text_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in fixed-width text; words to the left, numbers to the right."""
    whole = [headings, *rows]
    widths = [max(map(len, column)) for column in zip(*whole)]
    aligned = [
        [x.ljust(w) if name in LEFT else x.rjust(w) for name, x, w in zip(headings, row, widths)]
        for row in whole
    ]
    return "\n".join("  ".join(row).rstrip() for row in aligned)


def html_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """The same table in HTML, for notebooks."""

    def line(tag: str, row: Sequence[str]) -> str:
        sides = ["left" if name in LEFT else "right" for name in headings]
        cells = (
            f'<{tag} style="text-align: {side}">{escape(x)}</{tag}>' for side, x in zip(sides, row)
        )
        return f"<tr>{''.join(cells)}</tr>"

    body = "".join(line("td", row) for row in rows)
    return f"<table><thead>{line('th', headings)}</thead><tbody>{body}</tbody></table>"
