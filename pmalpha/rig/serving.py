"""An element for a program that integrates: OpenSees' genericClient, or another pmalpha."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from .._checks import whole_number
from ..run.coupler import Coupler
from . import wire as w
from .admission import HEAD_BYTES, LOOPBACK, admitted, checked_networks
from .served import Element, Trial, check_served, element_of


def serve(
    what: Any,
    port: int = 0,
    *,
    host: str = "127.0.0.1",
    allow: Collection[str] | None = None,
    secret: bytes | str | None = None,
    stiffness: Any = None,
    damping: Any = None,
    mass: Any = None,
    timeout: float | None = 60.0,
    announce: Callable[[int], Any] | None = None,
) -> int:
    """Serve one client that has this as an element, until it ends.

    The client is OpenSees' ``element genericClient``, OpenFresco's generic control, or `connect`.
    It sends trial displacements, velocities and times, and is given the resisting force without
    inertia and damping, and the matrices it asks for.

    Parameters
    ----------
    what : callable, springs, Subdomain or Coupler
        A specimen ``r(t, u, v)``, evaluated once for each trial state that a force is wanted of,
        and for the one that is accepted; it may return (r, x), and have a method ``commit()``,
        called at the end of each step. Springs go on from their last committed state. A Subdomain
        without load has all its dofs on the interface; it gives M, C and its tangent too. A Coupler
        has one constraint with ``velocity=rig.Command(p)``, its interface: it takes a macro step
        for each step of the client, which must have the same length, from the velocity committed
        last to the trial velocity, and gives the multipliers.
    port : int, default 0
        On which to listen; 0 for any that is free.
    host : str, default "127.0.0.1"
        The address on which to listen; the default is reached from this machine only. Any other
        needs `allow` or `secret`.
    allow : collection of str, optional
        Numerical addresses and networks of clients, ``["10.0.0.12", "10.1.0.0/24"]``; others are
        turned away.
    secret : bytes or str, optional
        That a `connect` with the same one proves to know before anything else; other programs have
        no way to. Neither it nor the data are encrypted, and who pretends to be the server can try
        words on the proof at leisure: take 16 random bytes.
    stiffness, damping, mass : (n, n) or (n,) array, optional
        Of a function (of springs the latter two), for clients that ask. Default: zero.
    timeout : float, optional
        Longest wait for a connection, for what that has to send to be the client (with the secret
        its proof, else its first message), and for each later message, in seconds; None for ever.
        A connection that closes, is silent or sends anything else is turned away, and the wait goes
        on; up to 32 are waited for at once.
    announce : callable, optional
        Called with the port when it is open. Default: prints it.

    Returns
    -------
    int
        Number of steps that were committed.

    Raises
    ------
    TimeoutError
        When there is no client in time, or it was silent for too long.
    ConnectionError
        When the client has ended without saying so, or asks for what it does not know.
    ValueError, TypeError
        For arguments of the wrong kind, what cannot be served, or another number of dofs than the
        client has; whatever `what` raises. OpenSees is not told and has to be ended: it waits for
        ever.

    Examples
    --------
    >>> import threading, queue
    >>> ports = queue.Queue()
    >>> server = threading.Thread(target=rig.serve, args=(lambda t, u, v: 4.0 * u,),
    ...                           kwargs=dict(announce=ports.put))
    >>> server.start()
    >>> with rig.connect(("127.0.0.1", ports.get())) as spring:
    ...     mass = Subdomain([1.0], None, scheme=Newmark(), restoring=spring, u0=[1.0], name="m")
    ...     history = Coupler([mass], dt=0.01).run(0.5)
    >>> server.join()
    >>> bool(abs(history["m"].u[-1, 0] - np.cos(1.0)) < 1e-4)
    True
    """
    check_served(what)
    port = whole_number(port, "port", high=65535)
    networks, known = checked_networks(allow), checked_secret(secret)
    if host not in LOOPBACK and allow is None and known is None:
        raise ValueError(
            f"allow or secret must be given with host {host!r}, which other machines can reach"
        )
    connection, peer, announced = admitted(
        host, port, networks, known, timeout, announce or _print_port
    )
    link = w.Wire(connection, timeout, peer)
    try:
        sizes = announced or w.sizes_of(link.receive(HEAD_BYTES, "the first message"), peer)
        matrices = dict(stiffness=stiffness, damping=damping, mass=mass)
        # a program that sends accelerations integrates: it adds C v and M a itself
        splits = sizes.control[w.KINDS.index("acceleration")] > 0
        element = element_of(what, sizes.n, matrices, splits=splits)
        if isinstance(what, Coupler) and sizes.control[w.KINDS.index("velocity")] == 0:
            raise ValueError(
                "a coupler needs the velocities of its interface, the client sends none"
            )
        try:
            return _Session(w.Doubles(link, sizes), element).run()
        finally:
            element.end()
    finally:
        link.close()


def _print_port(port: int) -> None:
    print(port, flush=True)


def checked_secret(secret: bytes | str | None) -> bytes | None:
    if secret is None:
        return None
    if not isinstance(secret, (bytes, str)) or not secret:
        raise TypeError(f"secret must be text or bytes that are not empty, got {secret!r}")
    return secret.encode() if isinstance(secret, str) else secret


class _Session:
    """The messages of one client."""

    def __init__(self, doubles: w.Doubles, element: Element):
        self.doubles, self.element, self.sizes = doubles, element, doubles.sizes
        n = self.sizes.n
        self.trial = Trial(None, np.zeros(n), np.zeros(n))
        self.commits = 0
        self.fields: dict[str, np.ndarray] = {}

    def run(self) -> int:
        """Until the client ends; the number of commits."""
        while True:
            message = self.doubles.receive("the next action")
            action = message[0]
            if action == w.END:
                return self.commits
            if action == w.TRIAL:
                self._take(message)
            elif action == w.COMMIT:
                self.element.commit(self.trial)
                self.commits += 1
            elif action in w.VALUES:
                self.doubles.send(self._values())
            elif action in w.MATRICES:
                self.doubles.send(self._matrix(int(action)))
            elif action not in w.SILENT:
                raise ConnectionError(f"{self.doubles.wire.peer} asks for {action:g}, no action")

    def _take(self, message: np.ndarray) -> None:
        self.fields = w.fields(self.sizes.control, message[1:])
        for kind, values in self.fields.items():
            if not np.isfinite(values).all():
                raise ValueError(f"{kind} must be finite, got {values} from the client")
        u, v = (self.fields.get(x, np.zeros(self.sizes.n)) for x in ("displacement", "velocity"))
        t = float(self.fields["time"][0]) if "time" in self.fields else None
        self.trial = Trial(t, u, v, self.fields.get("acceleration"))

    def _values(self) -> np.ndarray:
        r, x = self.element.force(self.trial)
        zero, t = np.zeros(self.sizes.n), self.trial.t
        values = {
            "displacement": x,
            "velocity": self.trial.v,
            "acceleration": self.fields.get("acceleration", zero),
            "force": r,
            "time": np.array([0.0 if t is None else t]),
        }
        counts = zip(w.KINDS, self.sizes.daq)
        return np.concatenate([values[kind] for kind, count in counts if count])

    def _matrix(self, action: int) -> np.ndarray:
        """A matrix by columns."""
        n = self.sizes.n
        if n * n > self.sizes.doubles:
            raise ConnectionError(
                f"{self.doubles.wire.peer} asks for a matrix of {n} x {n} in messages of "
                f"{self.sizes.doubles} doubles"
            )
        if action == w.DAMPING:
            A = self.element.damping()
        elif action == w.MASS:
            A = self.element.mass()
        else:
            A = self.element.stiffness(self.trial, initial=action == w.INITIAL_STIFFNESS)
        return np.asarray(A).T.ravel()
