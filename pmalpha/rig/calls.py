"""A function served in another process or on another machine, called like one of this process.

For a test rig, or a program that cannot be imported: the other side calls `serve`, this side makes
a `Client` and gives it as `restoring` or as a load. Numbers and arrays are sent as bytes, nothing
is unpickled, and no side can make the other execute anything. There is no password and no
encryption: serve on 127.0.0.1, the default, and connect machines by an SSH tunnel.
"""

from __future__ import annotations

import os
import socket
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from threading import Thread
from time import monotonic
from typing import IO, Any

import numpy as np

from ..errors import PmalphaError
from .wire import Admission, FirstToSpeak

__all__ = ["Client", "RemoteError", "serve", "started"]

# Start of a message: mark, kind, number of the call, number of arrays. Each array: dimensions,
# shape, and its numbers as float64, most significant byte first.
HEAD, LENGTH = struct.Struct("!4sBQB"), struct.Struct("!Q")
MARK, CALL, RESULT, FAILURE, HELLO = b"pmr1", 0, 1, 2, 3
# Largest message, in bytes: a wrong length is then no order to allocate memory.
LARGEST = 1 << 32
DIMENSIONS = 8
CHUNK = 1 << 16
# Of the line in which a program prints its port.
LONGEST_LINE = 64


class RemoteError(PmalphaError):
    """The function on the other side has raised an exception, whose text this one has."""


class Client:
    """A function on the other side of a connection.

    Parameters
    ----------
    address : (str, int)
        Host and port of `serve`.
    timeout : float, default 5.0
        Longest wait for the connection and for each whole reply, in seconds.
    name : str, default "the server"
        Its name in messages.

    Raises
    ------
    OSError
        When there is no connection.

    Examples
    --------
    >>> import threading, queue
    >>> ports = queue.Queue()
    >>> server = threading.Thread(target=serve, args=(lambda t, u, v: 4.0 * u,),
    ...                           kwargs=dict(announce=ports.put))
    >>> server.start()
    >>> with Client(("127.0.0.1", ports.get())) as spring:
    ...     mass = Subdomain([1.0], None, scheme=Newmark(), restoring=spring, u0=[1.0], name="m")
    ...     history = Coupler([mass], dt=0.01).run(0.5)
    >>> server.join()
    >>> bool(abs(history["m"].u[-1, 0] - np.cos(1.0)) < 1e-4)
    True
    """

    repeatable = False  # as `Coupler.estimate_error` has to know

    def __init__(self, address: tuple[str, int], *, timeout: float = 5.0, name: str = "the server"):
        self.name, self.number = name, 0
        self.connection = socket.create_connection(address, timeout)
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._messages = _Messages(self.connection)
        self.connection.sendall(_message(HELLO, 0, ()))  # others look whether the port is open
        self._sending = False  # a call was interrupted in the middle of its message

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *exception: Any) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Client of {self.name}, {self.number} calls>"

    def __call__(self, *arguments: Any) -> Any:
        """Call the function with numbers and arrays.

        Parameters
        ----------
        *arguments : float or array
            Up to 255.

        Returns
        -------
        array or tuple of arrays
            As the function returns them, of float64.

        Raises
        ------
        RemoteError
            When the function has raised an exception. The next call is served.
        TimeoutError
            Without a reply in time. A late one is skipped by the next call.
        ConnectionError
            When the other side has ended, or is no `serve`.
        """
        message = _message(CALL, self.number + 1, arguments)
        if self._sending:
            raise ConnectionError(f"call {self.number} of {self.name} was interrupted half sent")
        self.number += 1
        try:
            self._sending = True
            self.connection.sendall(message)
            self._sending = False
            replied = 0
            self._messages.begin()
            while replied < self.number:  # after Ctrl-C or a time-out an old one may still come
                kind, replied, arrays = self._messages.next()
        except TimeoutError as error:
            raise TimeoutError(f"no reply of {self.name} to call {self.number}") from error
        except ConnectionError as error:
            raise ConnectionError(f"{self.name} was lost at call {self.number}: {error}") from error
        if kind == FAILURE:
            raise RemoteError(f"{self.name} at call {self.number}: {_text(arrays)}")
        if kind != RESULT or replied != self.number:
            raise ConnectionError(f"{self.name} sent no reply to call {self.number}")
        return arrays[0] if len(arrays) == 1 else tuple(arrays)

    def close(self) -> None:
        """Close the connection, which ends `serve` on the other side."""
        self.connection.close()


def serve(
    function: Callable[..., Any],
    host: str = "127.0.0.1",
    port: int = 0,
    *,
    timeout: float | None = 60.0,
    announce: Callable[[int], Any] | None = None,
) -> int:
    """Serve a function to one client, until that closes the connection.

    Parameters
    ----------
    function : callable
        Called with the numbers (as () arrays) and arrays of the client; returns a number, an array,
        or a tuple of them. An exception is sent to the client, and the next call is served.
    host : str, default "127.0.0.1"
        The address on which to listen; the default is reached from this machine only.
    port : int, default 0
        The port; 0 for any that is free.
    timeout : float, optional
        Longest wait for the client, for the begin of each of its calls, and then for all of the
        call, in seconds; None for ever.
    announce : callable, optional
        Called with the port when it is open. Default: prints it as the first line of output, which
        `started` reads.

    Returns
    -------
    int
        Number of calls served.

    Raises
    ------
    TimeoutError
        When there was no client in time, or it was silent for too long. Connections that send
        nothing are waited for beside it, up to 32 at once.
    ConnectionError
        When it is no `Client`, or has ended without closing the connection.
    """
    with socket.create_server((host, port)) as server:
        opened = server.getsockname()[1]
        if announce is None:
            print(opened, flush=True)
        else:
            announce(opened)
        connection = _caller(server, timeout)
    messages, number = _Messages(connection), 0
    with connection:
        while messages.has_next():
            messages.begin()
            kind, number, arguments = messages.next()
            if kind == HELLO:
                continue
            if kind != CALL:
                raise ConnectionError(f"a message of kind {kind} is no call")
            connection.sendall(_reply(function, number, arguments))
    return number


def _caller(server: socket.socket, timeout: float | None) -> socket.socket:
    """The first connection that sends something.

    Others may close or be silent: such as those of a program which looks for open ports.
    """
    connection = Admission(server, None, None, timeout, FirstToSpeak).client().connection
    connection.settimeout(timeout)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


@contextmanager
def started(
    program: Sequence[Any], *, host: str = "127.0.0.1", timeout: float = 60.0
) -> Iterator[tuple[tuple[str, int], subprocess.Popen[bytes]]]:
    """A program that calls `serve`, as a process that ends with the block.

    Parameters
    ----------
    program : sequence of str or path
        The program and its arguments; a path that ends with ``.py`` is run by this Python.
    host : str, default "127.0.0.1"
        Where it serves.
    timeout : float, default 60.0
        Longest wait for its port, and after the block for its end, in seconds. It is then killed,
        at once when the block raises an exception.

    Yields
    ------
    (address, process)
        What a `Client` needs, and the `subprocess.Popen`.

    Raises
    ------
    TimeoutError
        When it has not printed its port, or has not ended, in time.
    ConnectionError
        When it ends, or prints something else, before its port.

    Examples
    --------
    >>> program = "from pmalpha.rig.calls import serve; serve(lambda x: 2.0 * x)"
    >>> with started([sys.executable, "-c", program]) as (address, process):
    ...     with Client(address) as double:
    ...         print(double([1.0, 2.0]))
    [2. 4.]
    """
    command = [str(word) for word in program]
    if command[0].endswith(".py"):
        command.insert(0, sys.executable)
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    assert process.stdout is not None
    try:
        line = _first_line(process.stdout, timeout)
        if line is None:
            raise TimeoutError(f"{command} must print its port first, nothing in {timeout:g} s")
        if not line.strip().isdigit():
            raise ConnectionError(f"{command} must print its port first, got {line.strip()!r}")
        yield (host, int(line)), process
        try:
            process.communicate(timeout=timeout)  # what it prints at last must not hold it up
        except subprocess.TimeoutExpired:
            raise TimeoutError(f"{command} has not ended {timeout:g} s after its block") from None
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def _first_line(stream: IO[bytes], seconds: float) -> bytes | None:
    """The first line of what a process prints, b"" if it ends without; None after this time.

    Read in a thread, since a pipe has no time-out, and from a descriptor of its own: the stream can
    be closed although a process that the first one has started keeps the pipe open.
    """
    lines, descriptor = SimpleQueue[bytes](), os.dup(stream.fileno())

    def read() -> None:
        with open(descriptor, "rb", buffering=0) as pipe:  # takes nothing behind the line
            lines.put(pipe.readline(LONGEST_LINE))

    Thread(target=read, daemon=True).start()
    try:
        return lines.get(timeout=seconds)
    except Empty:
        return None


# ---- messages -----------------------------------------------------------------------------------


def _message(kind: int, number: int, values: Sequence[Any]) -> bytes:
    """The bytes of a message with these numbers and arrays."""
    if len(values) > 255:
        raise ValueError(f"a message has up to 255 arrays, got {len(values)}")
    pieces = [HEAD.pack(MARK, kind, number, len(values))]
    for value in values:
        array = np.asarray(value)
        if array.dtype.kind not in "biuf" or array.ndim > DIMENSIONS:
            raise TypeError(f"only real numbers and arrays of them can be sent, got {value!r}")
        pieces.append(struct.pack(f"!B{array.ndim}Q", array.ndim, *array.shape))
        pieces.append(array.astype(">f8").tobytes())
    body = b"".join(pieces)
    return LENGTH.pack(len(body)) + body


def _reply(function: Callable[..., Any], number: int, arguments: Sequence[np.ndarray]) -> bytes:
    """The result of the function, or the text of its exception."""
    try:
        result = function(*arguments)
        return _message(RESULT, number, result if isinstance(result, tuple) else (result,))
    except Exception as error:
        text = _description(error).encode("utf-8", "backslashreplace")
        return _message(FAILURE, number, (np.frombuffer(text, dtype=np.uint8),))


def _description(error: Exception) -> str:
    """Class and text of an exception, also of one that cannot say what it is."""
    try:
        return f"{type(error).__name__}: {error}"
    except Exception:
        return type(error).__name__


def _text(arrays: Sequence[np.ndarray]) -> str:
    """The text of an exception on the other side, a byte in each number."""
    numbers = arrays[0].ravel() if arrays else np.empty(0)
    codes = np.where((numbers >= 0.0) & (numbers < 256.0), numbers, ord("?"))
    return codes.astype(np.uint8).tobytes().decode("utf-8", "replace")


class _Messages:
    """The messages that come in on a connection."""

    def __init__(self, connection: socket.socket):
        self.connection, self.buffer = connection, bytearray()
        self.timeout = connection.gettimeout()
        self._end = np.inf

    def begin(self) -> None:
        """From now on the time is counted in which the next messages have to be here."""
        self._end = np.inf if self.timeout is None else monotonic() + self.timeout

    def has_next(self) -> bool:
        """Waits for a message; False when the other side has closed the connection before one."""
        self.begin()
        return bool(self.buffer) or self._receive()

    def next(self) -> tuple[int, int, list[np.ndarray]]:
        """Kind, number and arrays; what has come of it stays in the buffer if this is ended."""
        self._need(LENGTH.size)
        (size,) = LENGTH.unpack_from(self.buffer)
        if not HEAD.size <= size <= LARGEST:
            raise ConnectionError(f"a message of {size} bytes is none of pmalpha.rig.calls")
        self._need(LENGTH.size + size)
        body = bytes(self.buffer[LENGTH.size : LENGTH.size + size])
        del self.buffer[: LENGTH.size + size]
        try:
            return _parsed(body)
        except (struct.error, OverflowError, ValueError) as error:
            raise ConnectionError(f"the message is none of pmalpha.rig.calls: {error}") from error

    def _need(self, size: int) -> None:
        while len(self.buffer) < size:
            if not self._receive():
                raise ConnectionError("the other side has closed the connection")

    def _receive(self) -> bool:
        if self.timeout is not None:
            left = self._end - monotonic()
            if left <= 0.0:
                raise TimeoutError("timed out")
            self.connection.settimeout(left)
        try:
            piece = self.connection.recv(CHUNK)
        finally:
            self.connection.settimeout(self.timeout)
        self.buffer += piece
        return bool(piece)


def _parsed(body: bytes) -> tuple[int, int, list[np.ndarray]]:
    mark, kind, number, count = HEAD.unpack_from(body)
    if mark != MARK or kind > HELLO:
        raise ValueError(f"it begins with {mark!r}")
    at, arrays = HEAD.size, []
    for _ in range(count):
        ndim = body[at] if at < len(body) else 255
        if ndim > DIMENSIONS:
            raise ValueError(f"it has an array of {ndim} dimensions")
        shape = struct.unpack_from(f"!{ndim}Q", body, at + 1)
        at += 1 + 8 * ndim
        size = 1
        for length in shape:
            size *= length  # of Python: no overflow
        if 8 * size > len(body) - at:
            raise ValueError(f"it is too short for an array of shape {shape}")
        arrays.append(np.frombuffer(body, ">f8", size, at).reshape(shape).astype(np.float64))
        at += 8 * size
    return kind, number, arrays
