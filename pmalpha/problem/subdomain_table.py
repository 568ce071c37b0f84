"""What a Subdomain shows of itself in a notebook."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from .._checks import counted
from .._tables import html_facts
from .matrices import dense, is_symmetric

# Dofs up to which periods are computed.
FEW = 100


def subdomain_html(s: Any) -> str:
    """The implementation of `Subdomain._repr_html_`."""
    label = "without a name" if s.name is None else repr(s.name)
    return html_facts(f"Subdomain {label}", facts(s))


def facts(s: Any) -> Iterator[tuple[str, str]]:
    """What it is, by name."""
    yield "dofs", str(s.n)
    if s.dof_names is not None:
        shown = ", ".join(s.dof_names[:4])
        yield "names of dofs", shown if s.n <= 4 else f"{shown}, ..."
    kind = "explicit" if s.scheme.explicit else "implicit"
    yield "scheme", f"{s.scheme!r}, {kind}, of order {order(s.scheme)}"
    yield "substeps", str(s.substeps)
    yield "matrices", ", ".join(f"{x} {form(getattr(s, x))}" for x in "MKC")
    if s.rayleigh is not None:
        c_m, c_k = s.rayleigh
        yield "Rayleigh damping", f"c_m = {c_m:.4g}, c_k = {c_k:.4g}"
    for name in ("force", "restoring", "internal"):
        if getattr(s, name) is not None:
            yield name, described(s, name)
    found = longest_periods(s)
    if found is not None:
        yield "longest periods", ", ".join(f"{x:.4g}" for x in found) or "none"


def order(scheme: Any) -> int:
    """2 where gamma = 1/2 - am + af, else 1."""
    return 2 if abs(scheme.gamma - 0.5 + scheme.am - scheme.af) < 1e-12 else 1


def form(A: Any) -> str:
    """The form of a matrix."""
    if A is None:
        return "zero"
    if isinstance(A, np.ndarray):
        return "diagonal" if A.ndim == 1 else "dense"
    return f"sparse with {A.nnz} entries"


def described(s: Any, name: str) -> str:
    """A load, or the number of springs and whether there are functions."""
    value = getattr(s, name)
    if name == "force":
        return "constant" if isinstance(value, np.ndarray) else repr(value)
    springs = s.restoring_springs if name == "restoring" else value.springs
    count = sum(len(spring) for spring in springs)
    functions = s.has_functions if name == "restoring" else bool(value.forces)
    return " and ".join([counted(count, "spring")] * bool(count) + ["functions"] * functions)


def longest_periods(s: Any, count: int = 3) -> np.ndarray | None:
    """Of the linear subdomain by itself; None where they take time, or dofs have no mass."""
    K = s.tangent
    if s.n > FEW or s.massless.size or K is None or not is_symmetric(K):
        return None
    from scipy.linalg import eigh

    squares = eigh(dense(K), dense(s.M), eigvals_only=True)
    oscillating = squares[squares > 1e-10 * np.abs(squares).max()]
    found: np.ndarray = 2.0 * np.pi / np.sqrt(oscillating[:count])
    return found
