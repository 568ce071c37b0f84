"""The stacked constraints of a coupler: sum_i L_i v_i = g(t)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from .._checks import numbered
from ..errors import ConstraintError, ConstraintWarning, warn
from ..problem.subdomain import Subdomain
from .contact_rows import Contacts
from .core_rows import scale_of_rows
from .link import Link
from .rank import require_independent
from .ranks import Ranks, joined
from .schedule import Rows

# Tolerance of the initial velocities in a constraint, relative to its terms: the rounding of
# velocities that were computed.
ROUNDING = 1e-9
# The same relative to the largest velocity anywhere, for the end of a pulse that only rounding
# carries to an interface.
FAR = 1e-13


class ConstraintRows:
    """The stacked constraints of a coupler, equation (2), in the user's order of rows and dofs.

    Parameters
    ----------
    constraints : sequence of Rows
    subdomains : sequence of Subdomain
        Of all processes.
    own : slice, optional
        Those of this process. Default: all.
    ranks : Ranks, optional
    contacts : Contacts, optional
        Beside them.

    Attributes
    ----------
    p : int
        Number of rows.
    scale : (p,) array
        What each row is divided by for the core.
    links : list of Link
        L_i of every subdomain of this process, with the rows divided by `scale`.
    matrices : list of (p, n_i) csc_array
        L_i as given, for products.

    Raises
    ------
    ConstraintError
        When the rows are linearly dependent.
    """

    def __init__(
        self,
        constraints: Sequence[Rows],
        subdomains: Sequence[Subdomain],
        own: slice = slice(None),
        ranks: Ranks | None = None,
        contacts: Contacts | None = None,
    ):
        self.ranks, self.contacts = ranks, contacts
        self.starts = np.cumsum([0] + [c.p for c in constraints])
        self.p = int(self.starts[-1])
        begins = np.cumsum([0] + [s.n for s in subdomains])
        whole = self._stacked(constraints, begins)
        if constraints:
            require_independent(sp.csr_array(whole), self.name)
        self._sizes = np.zeros(self.p)  # the largest entry of each row
        np.maximum.at(self._sizes, whole.indices, np.abs(whole.data))
        self.scale = scale_of_rows(self._sizes)
        stacked = Link.of(whole)
        self._given = [stacked.of_dofs(i, j) for i, j in zip(begins, begins[1:])][own]
        self.links = [link.with_rows_divided(self.scale) for link in self._given]

    def _stacked(self, constraints: Sequence[Rows], begins: np.ndarray) -> sp.csc_array:
        """(L_1, L_2, ...), whose columns begin at `begins`."""
        pieces = [
            (L, first, begins[i])
            for c, first in zip(constraints, self.starts)
            for i, L in c.matrices.items()
        ]
        shape = (self.p, int(begins[-1]))
        if not pieces:
            return sp.csc_array(shape)
        values = np.concatenate([L.data for L, _, _ in pieces])
        rows = np.concatenate([_rows(L) + first for L, first, _ in pieces])
        columns = np.concatenate([L.indices + begin for L, _, begin in pieces])
        return sp.csc_array((values, (rows, columns)), shape=shape)

    @cached_property
    def matrices(self) -> list[sp.csc_array]:
        return [link.matrix for link in self._given]

    @property
    def scaled(self) -> list[sp.csc_array]:
        """The matrices of `links`."""
        return [link.matrix for link in self.links]

    def of(self, i: int) -> np.ndarray:
        """The rows of constraint i."""
        return np.arange(self.starts[i], self.starts[i + 1])

    def name(self, row: int) -> str:
        """The name of a row in messages."""
        if len(self.starts) <= 2:
            return str(row)
        c = int(np.searchsorted(self.starts, row, side="right")) - 1
        return f"{row} (row {row - self.starts[c]} of constraint {c})"

    def check_velocities(self, velocities: Sequence[np.ndarray], g: np.ndarray) -> None:
        """ConstraintError unless sum L_i v_i = g at t = 0."""
        rows, gaps = self._violated(velocities, g)
        if rows.size:
            amounts = [f"{self.name(int(r))} by {x:g}" for r, x in zip(rows, gaps)]
            raise ConstraintError(
                "the initial velocities v0 must satisfy the constraints, violated in "
                f"{numbered('row', amounts)}"
            )

    def warn_of_gaps(self, displacements: Sequence[np.ndarray]) -> None:
        """ConstraintWarning unless sum L_i u_i = 0 at t = 0."""
        rows, gaps = self._violated(displacements, 0.0)
        if rows.size:
            amounts = [f"{self.name(int(r))}: {x:g}" for r, x in zip(rows, gaps)]
            warn(
                "the initial displacements u0 violate constraints; velocity constraints will not "
                f"close the gaps in {numbered('row', amounts)}",
                ConstraintWarning,
            )

    def check_gaps(self, displacements: Sequence[np.ndarray]) -> None:
        """ConstraintError unless sum L_i u_i = 0 at t = 0."""
        rows, gaps = self._violated(displacements, 0.0)
        if rows.size:
            amounts = [f"{self.name(int(r))}: {x:g}" for r, x in zip(rows, gaps)]
            raise ConstraintError(
                'the initial displacements u0 must satisfy the constraints under coupling="mean", '
                f"which ties displacements, violated in {numbered('row', amounts)}"
            )

    def gaps(self, displacements: Sequence[np.ndarray]) -> np.ndarray:
        """sum L_i u_i, (p,), zero where it is rounding."""
        rows, amounts = self._violated(displacements, 0.0)
        gaps = np.zeros(self.p)
        gaps[rows] = amounts
        return gaps

    def _violated(
        self, values: Sequence[np.ndarray], g: np.ndarray | float
    ) -> tuple[np.ndarray, np.ndarray]:
        """The rows in which sum L_i x_i differs from g by more than rounding, and the differences.

        Each row is scaled by its largest entry, since the multiple of a constraint is the same
        constraint.
        """
        terms = joined(
            self.ranks,
            [
                (link.matrix @ x, abs(link.matrix) @ np.abs(x), float(np.max(np.abs(x))))
                for link, x in zip(self._given, values)
                if x.any()
            ],
        )
        if not terms and not np.any(g):
            return np.empty(0, dtype=np.int64), np.empty(0)
        jump = sum((jump for jump, _, _ in terms), np.zeros(self.p)) - g
        size = sum((size for _, size, _ in terms), np.zeros(self.p)) + np.abs(g)
        largest = np.max(size / self._sizes, initial=0.0)
        far = max((far for _, _, far in terms), default=0.0)
        rows = np.flatnonzero(np.abs(jump) / self._sizes > max(ROUNDING * largest, FAR * far))
        return rows, jump[rows]


def _rows(L: sp.csr_array) -> np.ndarray:
    """The row of each entry of a matrix most of whose rows are empty."""
    return np.searchsorted(L.indptr, np.arange(L.nnz), side="right") - 1
