"""Which connection is that of the client: the others are turned away, and the wait goes on."""

from __future__ import annotations

import errno
import hmac
import logging
import os
import selectors
import socket
from collections.abc import Callable, Collection
from ipaddress import IPv4Network, IPv6Address, IPv6Network, ip_address, ip_network
from time import monotonic, sleep
from typing import NamedTuple

from . import wire as w

log = logging.getLogger("pmalpha.rig")
Networks = tuple[IPv4Network | IPv6Network, ...]
# Connections that may be waited for at once; more are turned away.
MOST = 32
# What accept says where the process or the system has no more descriptors or buffers; and how long
# it is then before the next attempt, in seconds.
OUT_OF_ROOM = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
PAUSE = 0.05
LOOPBACK = ("127.0.0.1", "::1", "localhost")
HEAD_BYTES = 4 * w.HEAD


class Client(NamedTuple):
    """The connection that was admitted, its name, and what it has announced, if it has already."""

    connection: socket.socket
    peer: str
    sizes: w.Sizes | None


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
        self.nonce = os.urandom(w.NONCE)
        self.need = HEAD_BYTES if secret is None else 2 * w.NONCE
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
            sizes = w.sizes_of(bytes(self.data), self.address)
        else:
            self._check_proof(self.secret)
        return Client(self.connection, f"the client {self.address}", sizes)

    def _check_proof(self, secret: bytes) -> None:
        other, proof = bytes(self.data[: w.NONCE]), bytes(self.data[w.NONCE :])
        if not hmac.compare_digest(proof, w.proof(secret, "client", self.nonce, other)):
            raise ConnectionError("it does not know the secret")
        self.connection.sendall(w.proof(secret, "server", other, self.nonce))


class Admission:
    """The wait for the client, on a server that listens.

    timeout: longest wait for a connection, and for what each one has to send.
    """

    def __init__(
        self,
        server: socket.socket,
        networks: Networks | None,
        secret: bytes | None,
        timeout: float | None,
    ):
        self.server, self.networks, self.secret = server, networks, secret
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
            visitor = Visitor(connection, name, self.secret, monotonic() + self.timeout)
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
