"""What was recorded of contacts: `History.contacts`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .._checks import counted
from .._rooms import outer
from ..problem.contacts import Contact
from .quantities import times_of

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
