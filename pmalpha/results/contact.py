"""What was recorded of contacts: `History.contacts`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from .._checks import counted, numbered
from .._rooms import outer
from ..problem.contacts import Contact
from ..setup.schedule import Lookup
from .quantities import position, times_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes


__all__ = ["ContactHistory"]

# Steps whose lengths differ by less are of one length.
ROUNDING = 1e-6


class Recorded(NamedTuple):
    """A contact in a History: rows, and tangents of each row; of a file without the object."""

    name: str
    rows: int
    tangents: int
    contact: Contact | None = None


@dataclass(frozen=True)
class ContactHistory:
    """Impulses and gaps of one `Contact`.

    Attributes
    ----------
    name : str
    t : (k,) array
        The end of each fine step, the beginning of the run first; with ``every`` of the recorded
        ones.
    impulse : (k, rows) array
        P of the normal rows in the step that ends there, 0 at the beginning; with ``every`` the sum
        over all steps since the row before. Where the run before has ended between two of its rows,
        the first row has the sum since the last one.
    friction : (k, rows, tangents) array
        The same of the tangential rows.
    gap : (k, rows) array
        The gaps at these times. In lasting contact the part of a step is below zero, which does not
        grow.
    """

    name: str
    t: np.ndarray
    impulse: np.ndarray
    friction: np.ndarray
    gap: np.ndarray

    @property
    def force(self) -> np.ndarray:
        """The mean force, (k, rows): impulse / h over the step that ends at t.

        With ``every`` over the time since the row before; an impact has any force, by its step.
        """
        h = np.diff(self.t)
        if h.size and np.ptp(h) <= ROUNDING * h[0]:
            h = np.full(h.size, (self.t[-1] - self.t[0]) / h.size)
        force = np.zeros_like(self.impulse)
        force[1:] = self.impulse[1:] / h[:, None]
        return force

    @property
    def closed(self) -> np.ndarray:
        """Whether a row pushed in the step that ends at t, (k, rows) bool."""
        result: np.ndarray = self.impulse > 0.0
        return result

    def plot(self, rows: Any = None, *, title: str | None = None, ax: Axes | None = None) -> Axes:
        """Plot gaps and mean forces of rows, one panel above the other.

        Parameters
        ----------
        rows : int or list of int, optional
            Default: the sum of all forces and the smallest gap.
        title : str, optional
            Default: the name.
        ax : matplotlib.axes.Axes, optional
            Axes to draw the gaps into, without forces. Default: a new figure of pyplot.

        Returns
        -------
        matplotlib.axes.Axes
            `ax`, or the panel of the gaps of the new figure.

        Examples
        --------
        >>> ball = Subdomain([1.0], [0.0], scheme=Newmark(), force=[-10.0], u0=[1.0])
        >>> history = Coupler([ball], contact(ball, 0), dt=1e-2).run(1.0)
        >>> len(history.contacts[0].plot().figure.axes)
        2
        """
        axes: Axes = outer("gaps_and_forces")(self, rows, title=title, ax=ax)
        return axes

    def __repr__(self) -> str:
        k, rows = self.impulse.shape
        return f"<{self.name!r}: {counted(k, 'time level')}, {counted(rows, 'row')}>"


class Contacts(Sequence[ContactHistory]):
    """All contacts of a History, by the `Contact`, by name or by index."""

    def __init__(
        self, t: np.ndarray, impulses: np.ndarray, gaps: np.ndarray, recorded: Sequence[Recorded]
    ):
        self._recorded, self._contacts = tuple(recorded), []
        row = begin = 0
        for name, rows, tangents, _ in self._recorded:
            size = rows * (1 + tangents)
            block = impulses[:, begin : begin + size].reshape(t.size, rows, 1 + tangents)
            gap = gaps[:, row : row + rows]
            self._contacts.append(ContactHistory(name, t, block[..., 0], block[..., 1:], gap))
            row, begin = row + rows, begin + size

    def __getitem__(self, key: Any) -> Any:
        for recorded, contact in zip(self._recorded, self._contacts):
            if (isinstance(key, str) and key == recorded.name) or (
                key is recorded.contact and key is not None
            ):
                return contact
        if isinstance(key, (str, Contact)):
            names = ", ".join(repr(x.name) for x in self._recorded) or "none"
            raise KeyError(f"no contact {key!r}; there are {names}")
        return self._contacts[key]

    def __len__(self) -> int:
        return len(self._contacts)

    def __iter__(self) -> Iterator[ContactHistory]:
        return iter(self._contacts)

    def __repr__(self) -> str:
        return f"<{', '.join(map(repr, self._contacts)) or 'no contacts'}>"


def layouts(contacts: Any) -> tuple[Recorded, ...]:
    """The contacts of a coupler, as a History has them."""
    return tuple(
        Recorded(name, c.rows, len(c.tangents), c)
        for name, c in zip(contacts.names, contacts.contacts)
    )


def recorded_contacts(history: Any) -> Contacts:
    """`History.contacts`."""
    t, impulses = times_of(history, "contact_impulses"), history.contact_impulses
    if impulses is None:
        return Contacts(t, np.empty((t.size, 0)), np.empty((t.size, 0)), ())
    return Contacts(t, impulses, history.contact_gaps, history.contact_layout)


# ---- contact nodes -------------------------------------------------------------------------------
# Contact at the nodes of a mesh: `History.contact_fields`.

FIELDS = ("contact", "gap", "contact impulse", "contact force", "slip")
OPEN, CLOSED = 1.0, 2.0


def contact_fields(history: Any, structure: Any, subdomain: Any, reduced: Any) -> dict[str, Any]:
    """`History.contact_fields`."""
    i = position(subdomain, history.keys)
    motion = history[i]
    count = len(structure.points)
    dofs = _dofs(structure, motion, reduced)
    nodes = {i: dofs // (structure.n // count)}
    return nodal_fields(history, nodes, count, np.asarray(motion.t))


def nodal_fields(
    history: Any, nodes: Mapping[int, np.ndarray], count: int, times: np.ndarray
) -> dict[str, np.ndarray]:
    """The fields at `count` nodes, from the node of each dof of subdomains, by their index."""
    shape = times.size, count
    fields = {name: np.zeros(shape) for name in FIELDS}
    reach = np.zeros(count)
    for recorded, contact in zip(history.contact_layout, history.contacts):
        if recorded.contact is None:
            raise ValueError(
                f"history must be that of a run, got one of a file, without the rows of {contact!r}"
            )
        at = _rows_at(np.asarray(contact.t), times, contact.name)
        impulse = np.diff(np.cumsum(contact.impulse, axis=0)[at], axis=0, prepend=0.0)
        slip = _slip(history, recorded, times)
        for i, N in _matrices(history, recorded.contact.matrices, contact.name).items():
            if i not in nodes:
                continue
            row, node, weight = _reach(N, nodes[i])
            A = sp.csr_array((weight, (row, node)), shape=(contact.impulse.shape[1], count))
            fields["contact impulse"] += impulse @ A
            # of the row that reaches the node most
            last = np.lexsort((-row, weight, node))
            last = last[np.append(node[last][1:] != node[last][:-1], True)[: last.size]]
            last = last[weight[last] > reach[node[last]]]
            row, node = row[last], node[last]
            reach[node] = weight[last]
            fields["gap"][:, node], fields["slip"][:, node] = contact.gap[at][:, row], slip[:, row]
            fields["contact"][:, node] = np.where(impulse[:, row] > 0.0, CLOSED, OPEN)
    h = np.diff(times, prepend=-np.inf)[:, None]
    fields["contact force"] = fields["contact impulse"] / h
    return fields


def _dofs(structure: Any, motion: Any, reduced: Any) -> np.ndarray:
    """The dof of the mesh of each dof of a subdomain: by `reduced`, by the names, or all."""
    if reduced is not None:
        dofs = np.asarray(reduced.free)
    elif motion.n == structure.n:
        dofs = np.arange(motion.n)
    else:
        known = {name: k for k, name in enumerate(structure.dof_names)}
        dofs = np.array([known.get(name, -1) for name in motion.dof_names or ()], dtype=np.int64)
    if dofs.size != motion.n or np.any(dofs < 0) or np.any(dofs >= structure.n):
        raise ValueError(
            f"subdomain {motion.name!r} must have the {structure.n} dofs of the mesh, dofs named "
            f"as there, or come with reduced=, got {motion.n} dofs"
        )
    return dofs


def _matrices(history: Any, matrices: Any, name: str) -> dict[int, sp.csr_array]:
    subdomains = [s for _, s in history.keys]
    lookup = Lookup(subdomains, [x for x, _ in history.keys])
    return lookup.matrices(matrices, f"contact {name!r}")


def _rows_at(t: np.ndarray, times: np.ndarray, what: str) -> np.ndarray:
    at = np.minimum(np.searchsorted(t, times), t.size - 1)
    missing = times[t[at] != times]
    if missing.size:
        raise ValueError(
            f"{what!r} must be recorded at all times of the motion, which it is not at "
            f"t = {missing[0]:g}"
        )
    return at


def _reach(N: sp.csr_array, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row, node and the length of the entries there."""
    entries = sp.coo_array(N)
    squares = sp.coo_array(
        (entries.data**2, (entries.coords[0], nodes[entries.coords[1]])),
        shape=(N.shape[0], nodes.max() + 1),
    ).tocsr()
    sums = squares.tocoo()
    mask = sums.data > 0.0
    return sums.coords[0][mask], sums.coords[1][mask], np.sqrt(sums.data[mask])


def _slip(history: Any, recorded: Any, times: np.ndarray) -> np.ndarray:
    """Relative displacement along the tangents, (k, rows): of one with its sign, of two the
    length."""
    along = []
    for T in recorded.contact.tangents:
        slip = np.zeros((times.size, recorded.rows))
        for i, A in _matrices(history, T, recorded.name).items():
            motion = history[i]
            at = _rows_at(np.asarray(motion.t), times, motion.name)
            there = A[:, motion.dofs]
            lost = np.setdiff1d(np.flatnonzero(np.diff(sp.csc_array(A).indptr)), motion.dofs)
            if lost.size:
                raise ValueError(
                    f"the dofs of {recorded.name!r} must be recorded, which "
                    f"{numbered('dof', lost)} of {motion.name!r} are not"
                )
            slip += np.asarray(motion.u)[at] @ there.T
        along.append(slip)
    if not along:
        return np.zeros((times.size, recorded.rows))
    return along[0] if len(along) == 1 else np.hypot(*along)
