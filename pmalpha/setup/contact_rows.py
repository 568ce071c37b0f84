"""The contacts of a coupler: their rows, what the core is given of them, and what is refused."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

import pmalpha._core as _core

from .._cached import cached_property
from .._checks import counted, numbered
from ..errors import ConstraintError
from ..memory import gemm_and_trsm, require
from ..problem import forms
from ..problem.contacts import Contact
from ..problem.matrices import diagonal
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from .link import Link
from .member import Member
from .schedule import Lookup

# Rows with tangents: W is dense.
MOST_ROWS = 4000
# An initial gap below zero by this part of its terms is rounding.
ROUNDING = 1e-12
# A W_kk below this part of N M^-1 N^T is rounding.
LOST = 1e-12
# (1 - rho)^2 / 4 bounds what is left of W beside ties: at rho = 1 the tie rings.
UNDAMPED = 1.0 - 1e-9


class Contacts:
    """The contacts of a coupler, with the rows of all of them one after the other.

    Each contact row is a normal one and the tangents that follow it.

    first: (contact rows + 1,) array of int, the row of each contact row, and the number of all.
    N: dict of (rows, n_i) csc_array, by index of the subdomain.
    """

    def __init__(
        self, contacts: Sequence[Contact], subdomains: Sequence[Subdomain], names: Sequence[str]
    ):
        self.contacts = tuple(contacts)
        self.names = tuple(
            f"contact {k}" if c.name is None else c.name for k, c in enumerate(self.contacts)
        )
        twice = sorted({name for name in self.names if self.names.count(name) > 1})
        if twice:
            raise ValueError(f"names of contacts must be different, got {twice[0]!r} twice")
        self.counts = [c.rows for c in self.contacts]
        sizes = [np.full(c.rows, 1 + len(c.tangents)) for c in self.contacts]
        self.first = np.concatenate([[0], np.cumsum(np.concatenate([[], *sizes]))]).astype(np.int64)
        if self.rows > MOST_ROWS:
            raise ValueError(
                f"contacts must have at most {MOST_ROWS} rows with their tangents, got {self.rows}"
            )
        self.N = self._stacked(subdomains, names)

    def __bool__(self) -> bool:
        return bool(self.contacts)

    @property
    def rows(self) -> int:
        return int(self.first[-1])

    @property
    def count(self) -> int:
        return self.first.size - 1

    @property
    def starts(self) -> np.ndarray:
        """The contact row with which each Contact begins, and the number of all."""
        starts: np.ndarray = np.cumsum([0, *self.counts])
        return starts

    @property
    def move(self) -> bool:
        return any(c.motion is not None for c in self.contacts)

    def numbers(self, name: str) -> np.ndarray:
        """`gap`, `friction`, `friction_static` or `restitution` of all contact rows."""
        return np.concatenate([getattr(c, name) for c in self.contacts])

    def name(self, row: int) -> str:
        """The name of a contact row in messages."""
        k = int(np.searchsorted(self.starts, row, side="right")) - 1
        return f"row {row - self.starts[k]} of {self.names[k]!r}"

    def name_of_core_row(self, row: int) -> str:
        """The same for a row of W."""
        return self.name(int(np.searchsorted(self.first, row, side="right")) - 1)

    def _stacked(
        self, subdomains: Sequence[Subdomain], names: Sequence[str]
    ) -> dict[int, sp.csc_array]:
        """N of each subdomain, with normal and tangential rows where `first` says."""
        entries: dict[int, list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = {}
        lookup = Lookup(subdomains, names)
        for k, c in enumerate(self.contacts):
            begin = self.first[self.starts[k] : self.starts[k] + c.rows]
            for offset, matrices in enumerate((c.matrices, *c.tangents)):
                what = f"contact {self.names[k]!r}"
                for i, A in lookup.matrices(matrices, what).items():
                    A = sp.coo_array(A)
                    blocks = entries.setdefault(i, [])
                    blocks.append((A.data, begin[A.coords[0]] + offset, A.coords[1]))
        return {
            i: sp.csc_array(
                (
                    np.concatenate([x for x, _, _ in blocks]),
                    (
                        np.concatenate([x for _, x, _ in blocks]),
                        np.concatenate([x for *_, x in blocks]),
                    ),
                ),
                shape=(self.rows, subdomains[i].n),
            )
            for i, blocks in sorted(entries.items())
        }

    @cached_property
    def dofs(self) -> dict[int, np.ndarray]:
        """The dofs of each subdomain that rows reach."""
        return {i: np.flatnonzero(np.diff(N.indptr)) for i, N in self.N.items()}

    # ---- what is refused -----------------------------------------------------------------------

    def check(self, subdomains: Sequence[Subdomain], names: Sequence[str]) -> None:
        """ValueError for masses that contacts do not go with."""
        for i in self.N:
            self._check_subdomain(subdomains[i], names[i], i)

    def _check_subdomain(self, s: Subdomain, name: str, i: int) -> None:
        dofs, N = self.dofs[i], self.N[i]
        masses = np.zeros(dofs.size) if s.M is None else diagonal(s.M)[dofs]
        if not np.all(masses > 0.0):
            massless = dofs[masses <= 0.0]
            raise ValueError(
                f"contacts need dofs with mass, got none at {numbered('dof', massless)} of "
                f"{name!r} ({self._row_at(N, massless[0])})"
            )
        if s.M is not None and s.M.ndim == 2:
            off = abs(sp.csr_array(s.M)[dofs])
            coupled = dofs[off.sum(axis=1) > masses * (1.0 + ROUNDING)]
            if coupled.size:
                raise ValueError(
                    "contacts need rows of M that are diagonal at their dofs (lump the mass), got "
                    f"others at {numbered('dof', coupled)} of {name!r} "
                    f"({self._row_at(N, coupled[0])})"
                )

    def _row_at(self, N: sp.csc_array, dof: int) -> str:
        """The name of the first row that reaches a dof."""
        return self.name_of_core_row(int(N.indices[N.indptr[dof]]))

    def check_steps(
        self, names: Sequence[str], substeps: Sequence[int], doubles: Sequence[bool]
    ) -> None:
        """ValueError unless all subdomains of contacts take single steps of the finest length."""
        fine = max(substeps)
        for i, N in self.N.items():
            row = self.name_of_core_row(int(N.indices.min()))
            if substeps[i] != fine:
                raise ValueError(
                    f"subdomains of contacts must be at the finest step, {fine} substeps, got "
                    f"{substeps[i]} of {names[i]!r} ({row}): a coarser one is unstable in lasting "
                    "contact; give it as many, or cut a thin layer at the contact that has them "
                    "and is tied to the rest, such as by pm.cut with layer_of"
                )
            if doubles[i]:
                raise ValueError(
                    f"subdomains of contacts must take single steps, got double steps of "
                    f"{names[i]!r} ({row}): an impulse would have to enter both chains of time "
                    'levels; set double_step=False or coupling="gc"'
                )

    def check_gaps(self, displacements: Sequence[np.ndarray], d: np.ndarray) -> None:
        """ConstraintError for a gap that is closed by more than rounding at t = 0."""
        normal = self.first[:-1]
        terms = [(N @ displacements[i])[normal] for i, N in self.N.items()]
        gap = self.numbers("gap") + sum(terms) - d
        size = np.abs(self.numbers("gap")) + np.abs(d) + sum(map(np.abs, terms))
        wrong = np.flatnonzero(gap < -ROUNDING * np.max(size, initial=0.0))
        if wrong.size:
            k = wrong[np.argmin(gap[wrong])]
            raise ConstraintError(
                "the gaps of contacts must not be negative at t = 0, got "
                f"{gap[k]:g} in {self.name(int(k))}"
            )

    # ---- the core --------------------------------------------------------------------------------

    def core(self, members: Sequence[Member]) -> forms.Contact:
        """The contacts in the form of the core."""
        require(8.0 * 3.0 * self.rows**2, f"the contacts of {counted(self.rows, 'row')}")
        sides = []
        for i in self.N:
            member = members[i]
            assert member.N is not None
            sides.append(forms.Side(i, member.N.core(member.n - member.nb)))
        return forms.Contact(
            self.first,
            self.numbers("gap"),
            self.numbers("restitution"),
            self.numbers("friction"),
            self.numbers("friction_static"),
            tuple(sides),
            *gemm_and_trsm(),
        )

    def links(self, count: int) -> list[Link | None]:
        return [Link.of(self.N[i]) if i in self.N else None for i in range(count)]

    def check_compliance(self, core: _core.Coupler, members: Sequence[Member]) -> None:
        """ValueError unless W has a positive diagonal: a step below the critical one, and rows that
        constraints do not hold."""
        free = np.zeros(self.rows)
        for i, N in self.N.items():
            M = members[i].subdomain.M
            inverse = np.zeros(N.shape[1])
            inverse[self.dofs[i]] = 1.0 / diagonal(M)[self.dofs[i]]
            free += N.power(2) @ inverse
        for start in (True, False):
            W = core.contact_compliance(start)[:: self.rows + 1]
            wrong = np.flatnonzero(~(W > LOST * free))
            if wrong.size:
                row = int(wrong[0])
                raise ValueError(
                    f"impulses must be able to change velocities, got W = {W[row]:g} in "
                    f"{self.name_of_core_row(row)}: its dofs are held by constraints, or an "
                    "explicit step is above the critical one"
                )


def is_undamped(scheme: Scheme) -> bool:
    """Whether rho is 1."""
    if scheme.explicit:
        return scheme.is_newmark
    return scheme.radius_at_infinity() > UNDAMPED
