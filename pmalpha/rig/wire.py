"""Which connection is that of the client: the others are turned away, and the wait goes on."""

from __future__ import annotations

import errno
import hashlib
import hmac
import logging
import os
import selectors
import socket
import struct
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from ipaddress import IPv4Network, IPv6Address, IPv6Network, ip_address, ip_network
from time import monotonic, sleep
from typing import NamedTuple

import numpy as np

# ---- wire ---------------------------------------------------------------------------------------
# Messages of OpenSees' genericClient, actuator and adapter, and of OpenFresco's generic control.
# The client sends eleven int32, the numbers of values of each kind in both directions and the
# length of the messages, and then messages of that length in doubles, the first of them an
# action.

# The kinds of values, in the order in which they are announced and packed.
KINDS = ("displacement", "velocity", "acceleration", "force", "time")
# What a client asks for.
OPEN, SETUP, TRIAL, EXECUTE, COMMIT, DAQ = 1, 2, 3, 4, 5, 6
DISPLACEMENT, VELOCITY, ACCELERATION, FORCE, TIME = 7, 8, 9, 10, 11
INITIAL_STIFFNESS, TANGENT, DAMPING, MASS = 12, 13, 14, 15
ACQUIRE, SHUTDOWN, END = 50, 98, 99
VALUES = (DAQ, DISPLACEMENT, VELOCITY, ACCELERATION, FORCE, TIME)
MATRICES = (INITIAL_STIFFNESS, TANGENT, DAMPING, MASS)
SILENT = (OPEN, SETUP, EXECUTE, ACQUIRE, SHUTDOWN)
# Largest number of values of a kind and length of a message: a wrong one is no order to allocate.
MOST_VALUES, MOST_DOUBLES = 1 << 16, 1 << 24
HEAD = 11
# Proof that both sides know the secret.
NONCE = 32
BYTE_ORDERS = {"little": "<", "big": ">"}


class Sizes(NamedTuple):
    """The first message: numbers of values sent by the client and by the server, and the length."""

    # control, daq: by `KINDS`
    control: tuple[int, ...]
    daq: tuple[int, ...]
    doubles: int  # length of each later message
    order: str = "<"  # {"<", ">"}, byte order

    @property
    def n(self) -> int:
        return max(*self.control[:4], *self.daq[:4])

    def bytes(self) -> bytes:
        return struct.pack(f"{self.order}{HEAD}i", *self.control, *self.daq, self.doubles)

    def problem(self, matrices: bool = False) -> str | None:
        """What is wrong with them; None for nothing."""
        several = {x for x in (*self.control[:4], *self.daq[:4]) if x}
        if any(not 0 <= x <= MOST_VALUES for x in (*self.control, *self.daq)):
            return "numbers of values must lie in [0, 65536]"
        if len(several) != 1 or max(self.control[4], self.daq[4]) > 1:
            return "all kinds must have the same number of values, and time at most one"
        need = max(1 + sum(self.control), sum(self.daq), self.n**2 if matrices else 0)
        if not need <= self.doubles <= MOST_DOUBLES:
            return f"messages must have {need} to {MOST_DOUBLES} doubles, got {self.doubles}"
        return None


def sizes_of(head: bytes, peer: str) -> Sizes:
    """The first message in the byte order in which it makes sense."""
    all_sizes = []
    for order in BYTE_ORDERS.values():
        numbers = struct.unpack(f"{order}{HEAD}i", head)
        all_sizes.append(Sizes(numbers[:5], numbers[5:10], numbers[10], order))
    for sizes in all_sizes:
        if sizes.problem() is None:
            return sizes
    raise ConnectionError(
        f"{peer} does not speak the protocol of rigs: {all_sizes[0].problem()}; its first message, "
        f"eleven int32, is {all_sizes[0].control}, {all_sizes[0].daq}, {all_sizes[0].doubles}"
    )


class Wire:
    """A connection on which messages have a known length.

    timeout: longest wait for a message, in seconds.
    peer: the other side in messages.
    """

    def __init__(self, connection: socket.socket, timeout: float | None, peer: str):
        self.connection, self.timeout, self.peer = connection, timeout, peer
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection.settimeout(timeout)
        # without it a peer that sends two small messages in a row waits 40 ms after the first
        self._quick = getattr(socket, "TCP_QUICKACK", None)

    def close(self) -> None:
        self.connection.close()

    def send(self, data: bytes) -> None:
        """Send all; ConnectionError or TimeoutError otherwise."""
        try:
            self.connection.sendall(data)
        except TimeoutError:
            raise TimeoutError(f"{self.peer} takes no data within {self.timeout:g} s") from None
        except OSError as error:
            raise ConnectionError(f"{self.peer} was lost: {error}") from error

    def receive(self, size: int, what: str) -> bytes:
        """So many bytes, which have to be here in time."""
        data = bytearray()
        end = None if self.timeout is None else monotonic() + self.timeout
        while len(data) < size:
            piece = self._some(size - len(data), end, what)
            if not piece:
                state = f"after {len(data)} of {size} bytes" if data else "and sent nothing"
                raise ConnectionError(f"{self.peer} closed the connection {state} of {what}")
            data += piece
        return bytes(data)

    def _some(self, size: int, end: float | None, what: str) -> bytes:
        if end is not None:
            left = end - monotonic()
            if left <= 0.0:
                raise TimeoutError(f"no {what} of {self.peer} within {self.timeout:g} s")
            self.connection.settimeout(left)
        try:
            if self._quick is not None:  # the flag does not stay set
                self.connection.setsockopt(socket.IPPROTO_TCP, self._quick, 1)
            return self.connection.recv(size)
        except TimeoutError:
            raise TimeoutError(f"no {what} of {self.peer} within {self.timeout:g} s") from None
        except OSError as error:
            raise ConnectionError(f"{self.peer} was lost: {error}") from error
        finally:
            with suppress(OSError):
                self.connection.settimeout(self.timeout)

    def check_silent(self) -> None:
        """ConnectionError where more has come than was asked for."""
        self.connection.setblocking(False)
        try:
            byte = self.connection.recv(1, socket.MSG_PEEK)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            raise ConnectionError(f"{self.peer} was lost: {error}") from error
        finally:
            self.connection.settimeout(self.timeout)
        if byte:
            raise ConnectionError(f"{self.peer} sends more than was asked for")
        raise ConnectionError(f"{self.peer} closed the connection")


class Doubles:
    """Messages of a fixed number of doubles."""

    def __init__(self, wire: Wire, sizes: Sizes):
        self.wire, self.sizes = wire, sizes
        self.type = np.dtype(f"{sizes.order}f8")

    def send(self, values: Sequence[float] | np.ndarray) -> None:
        """The values, and zeros up to the length of messages."""
        message = np.zeros(self.sizes.doubles, self.type)
        message[: len(values)] = values
        self.wire.send(message.tobytes())

    def receive(self, what: str) -> np.ndarray:
        data = self.wire.receive(self.sizes.doubles * self.type.itemsize, what)
        return np.frombuffer(data, self.type).astype(np.float64)


def fields(counts: Sequence[int], values: np.ndarray) -> dict[str, np.ndarray]:
    """The values of each kind that was announced."""
    arrays, at = {}, 0
    for kind, count in zip(KINDS, counts):
        if count:
            arrays[kind] = values[at : at + count]
        at += count
    return arrays


# ---- who may connect -----------------------------------------------------------------------------


def proof(secret: bytes, role: str, other: bytes, nonce: bytes) -> bytes:
    """What shows that one side knows the secret, without sending it.

    role: {"client", "server"}. other, nonce: random bytes of both sides, new ones each time. The
    key is a hash of the secret: HMAC itself takes no notice of zeros at the end of a key.
    """
    key = hashlib.sha256(secret).digest()
    return hmac.new(key, role.encode() + other + nonce, hashlib.sha256).digest()


def prove(wire: Wire, secret: bytes) -> None:
    """The client proves that it knows the secret, and then the server, which sends nothing before
    that a stranger could try words on."""
    other, nonce = wire.receive(NONCE, "the proof of the secret"), os.urandom(NONCE)
    wire.send(nonce + proof(secret, "client", other, nonce))
    try:
        shown = wire.receive(NONCE, "the proof of the secret")
    except ConnectionError as error:
        raise ConnectionError(f"{error}: it may have another secret") from None
    if not hmac.compare_digest(shown, proof(secret, "server", nonce, other)):
        raise ConnectionError(f"{wire.peer} does not know the secret")


# ---- admission ----------------------------------------------------------------------------------

log = logging.getLogger("pmalpha.rig")
Networks = tuple[IPv4Network | IPv6Network, ...]
# Connections that may be waited for at once; more are turned away.
MOST = 32
# What accept says where the process or the system has no more descriptors or buffers; and how long
# it is then before the next attempt, in seconds.
OUT_OF_ROOM = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
PAUSE = 0.05
LOOPBACK = ("127.0.0.1", "::1", "localhost")
HEAD_BYTES = 4 * HEAD


class Client(NamedTuple):
    """The connection that was admitted, its name, and what it has announced, if it has already."""

    connection: socket.socket
    peer: str
    sizes: Sizes | None


def checked_networks(allow: Collection[str] | None) -> Networks | None:
    """The addresses and networks of `allow`, which are numerical."""
    if allow is None:
        return None
    if isinstance(allow, (str, bytes)) or not isinstance(allow, Collection):
        raise TypeError(f'allow must be a list of addresses, ["10.0.0.12"], got {allow!r}')
    networks = []
    for text in allow:
        if not isinstance(text, str):  # a number is an address too: True would be 0.0.0.1
            raise TypeError(f"allow must have addresses as text, got {text!r}")
        try:
            networks.append(ip_network(text))
        except ValueError as error:
            raise ValueError(
                'allow must have numerical addresses and networks, as "10.0.0.12" and '
                f'"10.0.0.0/24", got {text!r}: {error}; a name is not accepted, since another '
                "system decides which address it has"
            ) from None
    if not networks:
        raise ValueError("allow must have an address or network, got none")
    return tuple(networks)


def is_allowed(address: str, networks: Networks | None) -> bool:
    if networks is None:
        return True
    ip = ip_address(address.partition("%")[0])
    if isinstance(ip, IPv6Address) and ip.ipv4_mapped is not None:
        ip = ip.ipv4_mapped
    return any(ip.version == network.version and ip in network for network in networks)


class Visitor:
    """A connection of which is not known yet whether it is the client's.

    With a secret it has to prove first that it knows it, without one to announce its messages.
    """

    def __init__(self, connection: socket.socket, address: str, secret: bytes | None, end: float):
        self.connection, self.address, self.secret, self.end = connection, address, secret, end
        self.data = bytearray()
        self.nonce = os.urandom(NONCE)
        self.need = HEAD_BYTES if secret is None else 2 * NONCE
        connection.setblocking(False)
        if secret is not None:
            connection.sendall(self.nonce)

    def receive(self) -> Client | None:
        """The client, once that is known. ConnectionError where it is another one."""
        try:
            piece = self.connection.recv(self.need - len(self.data))
        except (BlockingIOError, InterruptedError):
            return None
        if not piece:
            raise ConnectionError("it has closed the connection")
        self.data += piece
        if len(self.data) < self.need:
            return None
        sizes = None
        if self.secret is None:
            sizes = sizes_of(bytes(self.data), self.address)
        else:
            self._check_proof(self.secret)
        return Client(self.connection, f"the client {self.address}", sizes)

    def _check_proof(self, secret: bytes) -> None:
        other, shown = bytes(self.data[:NONCE]), bytes(self.data[NONCE:])
        if not hmac.compare_digest(shown, proof(secret, "client", self.nonce, other)):
            raise ConnectionError("it does not know the secret")
        self.connection.sendall(proof(secret, "server", other, self.nonce))


class FirstToSpeak(Visitor):
    """A connection that is the client's when it sends something, which is left to be read."""

    def receive(self) -> Client | None:
        try:
            piece = self.connection.recv(1, socket.MSG_PEEK)
        except (BlockingIOError, InterruptedError):
            return None
        if not piece:
            raise ConnectionError("it has closed the connection")
        return Client(self.connection, f"the client {self.address}", None)


class Admission:
    """The wait for the client, on a server that listens.

    timeout: longest wait for a connection, and for what each one has to send. kind: which of the
    visitors is the client.
    """

    def __init__(
        self,
        server: socket.socket,
        networks: Networks | None,
        secret: bytes | None,
        timeout: float | None,
        kind: type[Visitor] = Visitor,
    ):
        self.server, self.networks, self.secret, self.kind = server, networks, secret, kind
        self.timeout = float("inf") if timeout is None else timeout
        self.end = monotonic() + self.timeout
        self.visitors: dict[socket.socket, Visitor] = {}

    def client(self) -> Client:
        """The first that proves to be it; TimeoutError when there is none in time."""
        self.server.setblocking(False)
        with selectors.DefaultSelector() as selector:
            selector.register(self.server, selectors.EVENT_READ)
            client = None
            try:
                while client is None:
                    client = self._look(selector)
            finally:
                for connection in self.visitors:
                    if client is None or connection is not client.connection:
                        connection.close()
        return client

    def _look(self, selector: selectors.BaseSelector) -> Client | None:
        now = monotonic()
        for late in [x for x in self.visitors.values() if x.end <= now]:
            self._turn_away(selector, late, "it has sent nothing in time")
        if not self.visitors and self.end <= now:
            raise TimeoutError(f"no client within {self.timeout:g} s")
        end = min([x.end for x in self.visitors.values()], default=self.end)
        left = None if end == float("inf") else end - now
        for key, _ in selector.select(left):
            if key.fileobj is self.server:
                self._accept(selector)
                continue
            visitor: Visitor = key.data
            try:
                client = visitor.receive()
            except OSError as error:
                self._turn_away(selector, visitor, str(error))
            else:
                if client is not None:
                    return client
        return None

    def _accept(self, selector: selectors.BaseSelector) -> None:
        try:
            connection, address = self.server.accept()
        except OSError as error:
            if error.errno in OUT_OF_ROOM:
                self._make_room(selector)
            return  # else it was closed meanwhile
        name = f"{address[0]}:{address[1]}"
        if not is_allowed(address[0], self.networks) or len(self.visitors) >= MOST:
            log.warning("pmalpha.rig turned away %s", name)
            connection.close()
            return
        try:
            visitor = self.kind(connection, name, self.secret, monotonic() + self.timeout)
        except OSError:
            connection.close()
            return
        self.visitors[connection] = visitor
        selector.register(connection, selectors.EVENT_READ, visitor)

    def _make_room(self, selector: selectors.BaseSelector) -> None:
        """Where no further connection can be opened: the oldest visitor goes, or the wait does."""
        if self.visitors:
            self._turn_away(selector, next(iter(self.visitors.values())), "there is no room")
        else:
            sleep(PAUSE)  # the connection stays in the queue, so that selectors do not wait

    def _turn_away(self, selector: selectors.BaseSelector, visitor: Visitor, why: str) -> None:
        log.warning("pmalpha.rig turned away %s: %s", visitor.address, why)
        selector.unregister(visitor.connection)
        del self.visitors[visitor.connection]
        visitor.connection.close()


def admitted(
    host: str,
    port: int,
    networks: Networks | None,
    secret: bytes | None,
    timeout: float | None,
    announce: Callable[[int], object],
) -> Client:
    """The client that connects to this address; `announce` is called with the port."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.create_server((host, port), family=family) as server:
        opened = server.getsockname()[1]
        if host not in LOOPBACK:
            of = "clients with the secret" if networks is None else ", ".join(map(str, networks))
            log.warning("pmalpha.rig listens on %s:%d, for %s", host, opened, of)
        announce(opened)
        return Admission(server, networks, secret, timeout).client()
