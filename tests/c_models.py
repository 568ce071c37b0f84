"""Frozen models by ctypes, as any program would use the C library."""

import ctypes
from ctypes import POINTER, byref, c_char_p, c_double, c_int, c_int64, c_size_t, c_void_p

import numpy as np

OK, NO_MEMORY, BAD_FILE, BAD_ARGUMENT, LIMITED, FAILED = range(6)
SPECIMEN_FUNCTION = ctypes.CFUNCTYPE(
    c_int, c_double, POINTER(c_double), POINTER(c_double), c_void_p
)
SIGNATURES = {
    "abi": (c_int, []),
    "version": (c_char_p, []),
    "open": (c_int, [c_char_p, c_char_p, POINTER(c_void_p)]),
    "open_memory": (c_int, [c_void_p, c_size_t, c_char_p, POINTER(c_void_p)]),
    "room": (c_size_t, [c_void_p, c_size_t]),
    "open_in": (
        c_int,
        [c_void_p, c_size_t, c_void_p, c_size_t, c_char_p, POINTER(c_void_p)],
    ),
    "close": (None, [c_void_p]),
    "message": (c_char_p, [c_void_p]),
    "step_size": (c_double, [c_void_p]),
    "substeps": (c_size_t, [c_void_p]),
    "count": (c_int64, [c_void_p]),
    "time": (c_double, [c_void_p]),
    "inputs": (c_size_t, [c_void_p]),
    "outputs": (c_size_t, [c_void_p]),
    "input_name": (c_char_p, [c_void_p, c_int]),
    "output_name": (c_char_p, [c_void_p, c_int]),
    "find_input": (c_int, [c_void_p, c_char_p]),
    "find_output": (c_int, [c_void_p, c_char_p]),
    "input_kind": (c_int, [c_void_p, c_int]),
    "command": (c_int, [c_void_p, c_int, POINTER(c_double)]),
    "set": (c_int, [c_void_p, c_int, c_double]),
    "given": (c_double, [c_void_p, c_int]),
    "lead": (c_int, [c_void_p, c_int]),
    "begin": (c_int, [c_void_p]),
    "get": (c_double, [c_void_p, c_int]),
    "advance": (c_int, [c_void_p, c_size_t]),
    "attach": (c_int, [c_void_p, c_int, c_void_p, c_void_p]),
    "state_size": (c_size_t, [c_void_p]),
    "save": (c_int, [c_void_p, c_void_p, c_size_t]),
    "restore": (c_int, [c_void_p, c_void_p, c_size_t]),
    "reset": (None, [c_void_p]),
    "clock": (None, [c_void_p, c_void_p, c_void_p]),
    "longest": (c_int64, [c_void_p]),
}


class Refused(Exception):
    """A file that the library refuses, with its status and message."""


class Library:
    """The shared library at a path."""

    def __init__(self, path):
        self.loaded = ctypes.CDLL(str(path))
        for name, (result, arguments) in SIGNATURES.items():
            function = getattr(self.loaded, f"pmalpha_{name}")
            function.restype, function.argtypes = result, arguments
            setattr(self, name, function)

    def model(self, path, room=None):
        return Model(self, path, room)


class Model:
    """A model of a file, or of the bytes of one, which several models share."""

    def __init__(self, library, content, room=None):
        self.functions, self.handle, self.attached = library, c_void_p(), []
        message = ctypes.create_string_buffer(256)
        if room is not None:
            self.bytes, self.room = content, room
            both = content.ctypes.data, content.nbytes, room.ctypes.data, room.nbytes
            status = library.open_in(*both, message, byref(self.handle))
        elif isinstance(content, np.ndarray):
            self.bytes = content
            status = library.open_memory(
                content.ctypes.data, content.nbytes, message, byref(self.handle)
            )
        else:
            status = library.open(str(content).encode(), message, byref(self.handle))
        if status != OK:
            assert not self.handle
            raise Refused(status, message.value.decode())

    def __del__(self):
        self.functions.close(self.handle)

    def __getattr__(self, name):
        function = getattr(self.functions, name)
        return lambda *arguments: function(self.handle, *arguments)

    @property
    def why(self):
        return self.message().decode()

    def command_of(self, i):
        """(1 or 0, [d, d', d''])."""
        c = (c_double * 3)()
        return self.command(i, c), list(c)

    def attach_function(self, i, function):
        """`function(t, c)` returns the force, or None to fail."""

        def call(t, c, force, user):
            value = function(t, c[:3])
            if value is None:
                return 1
            force[0] = value
            return 0

        self.attached.append(SPECIMEN_FUNCTION(call))
        self.attach(i, self.attached[-1], None)

    @property
    def values(self):
        """All outputs."""
        return [self.get(i) for i in range(self.outputs())]

    def rows(self, steps):
        """All outputs at the present and after each of some fine steps, which succeed."""
        rows = [self.values]
        for _ in range(steps):
            assert self.advance(1) == OK, self.why
            rows.append(self.values)
        return np.array(rows)

    def state(self):
        block = np.zeros(self.state_size() // 8)
        assert self.save(block.ctypes.data, block.nbytes) == OK
        return block


def words(path):
    """The bytes of a file, aligned."""
    with open(path, "rb") as file:
        return np.frombuffer(file.read(), np.int64).copy()
