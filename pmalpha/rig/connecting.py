"""A specimen behind a connection: another pmalpha, OpenFresco, or a model of OpenSees."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from typing import Any

import numpy as np

from .._checks import check_word, positive_number
from . import wire as w
from .serving import checked_secret

# Doubles of a message unless more are needed, as OpenSees and OpenFresco have it.
USUAL = 256


def connect(
    address: tuple[str, int],
    *,
    send: Sequence[str] = ("displacement", "velocity", "time"),
    receive: Sequence[str] = ("displacement", "force"),
    commits: bool = True,
    secret: bytes | str | None = None,
    byte_order: str = "little",
    timeout: float = 5.0,
    name: str = "the rig",
) -> Connected:
    """A specimen on the other side of a connection, for ``restoring=``.

    Parameters
    ----------
    address : (str, int)
        Host and port of `serve`, of OpenSees' ``actuator`` or ``adapter``, of OpenFresco's element
        server, or of a controller.
    send : sequence of str, default ("displacement", "velocity", "time")
        The values of a command, of "displacement", "velocity" and "time"; OpenSees and most
        controllers know displacements only: ``send=["displacement"]``.
    receive : sequence of str, default ("displacement", "force")
        The values that come back; "force" among them. With "displacement", the measured one, the
        specimen returns (r, x).
    commits : bool, default True
        Whether a command is followed by a commit, when the next one comes. False for OpenSees'
        ``actuator`` and ``adapter``, which have none.
    secret : bytes or str, optional
        That `serve` of pmalpha was given.
    byte_order : {"little", "big"}
        Of all numbers.
    timeout : float, default 5.0
        Longest wait for the connection and for each reply, in seconds.
    name : str, default "the rig"
        Its name in messages.

    Returns
    -------
    Connected
        A callable r(t, u, v), and a context that closes the connection.

    Raises
    ------
    OSError
        When there is no connection.
    ConnectionError
        When the other side does not know the secret.
    """
    check_word(byte_order, "byte_order", tuple(w.BYTE_ORDERS))
    sent, received = _checked(send, "send"), _checked(receive, "receive")
    if "displacement" not in sent or set(sent) - {"displacement", "velocity", "time"}:
        raise ValueError(
            f'send must have "displacement", and "velocity" and "time" at will, got {list(send)}'
        )
    if "force" not in received:
        raise ValueError(f'receive must have "force", got {list(receive)}')
    if not isinstance(address, Sequence) or isinstance(address, str) or len(address) != 2:
        raise TypeError(f'address must be a host and a port, ("localhost", 8090), got {address!r}')
    timeout, known = positive_number(timeout, "timeout"), checked_secret(secret)
    connection = socket.create_connection(address, timeout)
    link = w.Wire(connection, timeout, name)
    try:
        if known is not None:
            w.prove(link, known)
    except BaseException:
        link.close()
        raise
    return Connected(link, sent, received, w.BYTE_ORDERS[byte_order], commits=bool(commits))


def _checked(kinds: Sequence[str], name: str) -> tuple[str, ...]:
    if isinstance(kinds, str) or not all(kind in w.KINDS for kind in kinds):
        raise ValueError(f"{name} must be a list of {', '.join(map(repr, w.KINDS))}, got {kinds!r}")
    return tuple(kinds)


class Connected:
    """A specimen on the other side of a connection; made by `connect`.

    Parameters
    ----------
    link : Wire
        The connection, which it will close.
    send, receive : tuple of str
        What is exchanged.
    order : {"<", ">"}
        Byte order.
    commits : bool
        Whether commands are followed by commits.

    Attributes
    ----------
    calls : int
        Commands that were answered.
    """

    repeatable = False  # as `Coupler.estimate_error` has to know

    def __init__(
        self,
        link: w.Wire,
        send: tuple[str, ...],
        receive: tuple[str, ...],
        order: str,
        *,
        commits: bool,
    ):
        self.link, self.kinds, self.order, self.commits = link, (send, receive), order, commits
        self.calls = 0
        self.open = True
        self.doubles: w.Doubles | None = None
        self.last: np.ndarray | None = None  # the command that is to be committed
        self.time = -np.inf

    def __enter__(self) -> Connected:
        return self

    def __exit__(self, *exception: Any) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Connected to {self.link.peer}, {self.calls} calls>"

    def __call__(self, t: float, u: Any, v: Any) -> Any:
        """Send a command and wait for the force.

        Parameters
        ----------
        t : float
        u, v : (n,) array

        Returns
        -------
        r : (n,) array
            Or (r, x) where displacements are received.

        Raises
        ------
        TimeoutError
            Without a reply in time.
        ConnectionError
            When the other side has ended, or sends more than it was asked for; every later call
            raises it too.
        """
        if not self.open:
            raise ConnectionError(f"the connection to {self.link.peer} is closed")
        try:
            return self._exchange(float(t), np.asarray(u, float), np.asarray(v, float))
        except BaseException:
            self._abandon()  # a late reply would be taken for that of the next command
            raise

    def _exchange(self, t: float, u: np.ndarray, v: np.ndarray) -> Any:
        doubles = self._doubles(u.size)
        self.link.check_silent()
        if self.commits and self.last is not None and t > self.time:
            self.last[0] = w.COMMIT
            doubles.send(self.last)
        values = {"displacement": u, "velocity": v, "time": np.array([t])}
        sent = [values[kind] for kind in w.KINDS if kind in self.kinds[0]]
        command = np.concatenate([[w.TRIAL], *sent])
        doubles.send(command)
        self.last, self.time = command.copy(), t
        command[0] = w.FORCE
        doubles.send(command)
        reply = w.fields(doubles.sizes.daq, doubles.receive("reply"))
        self.calls += 1
        return (
            (reply["force"], reply["displacement"]) if "displacement" in reply else reply["force"]
        )

    def _doubles(self, n: int) -> w.Doubles:
        """The messages for n dofs, announced before the first."""
        if self.doubles is None:
            control, daq = (
                tuple((1 if kind == "time" else n) * (kind in kinds) for kind in w.KINDS)
                for kinds in self.kinds
            )
            need = max(USUAL, 1 + sum(control), sum(daq))
            sizes = w.Sizes(control, daq, need, self.order)
            self.link.send(sizes.bytes())
            self.doubles = w.Doubles(self.link, sizes)
        if self.doubles.sizes.n != n:
            raise ValueError(f"u must have {self.doubles.sizes.n} dofs as before, got {n}")
        return self.doubles

    def _abandon(self) -> None:
        self.open = False
        self.link.close()

    def close(self) -> None:
        """Commit the last command and end the other side; after an error nothing is left to do."""
        if not self.open:
            return
        try:
            if self.doubles is not None:
                if self.commits and self.last is not None:
                    self.last[0] = w.COMMIT
                    self.doubles.send(self.last)
                self.doubles.send([w.END])
        except OSError:
            pass  # it has ended before
        finally:
            self._abandon()
