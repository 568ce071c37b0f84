"""The tree of a frozen model: what the core was made of, its present, inputs and outputs."""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

import pmalpha._core as _core

from .._checks import counted, listing, numbered, real_number, whole_number
from ..problem import forms
from ..problem.arguments import Coupling
from ..problem.device import Device
from ..problem.dofs import dof_list
from ..problem.restoring import external_of, items_of
from ..problem.springs import Spring, Wheels
from ..problem.subdomain import Subdomain
from ..results.quantities import position
from ..setup.assembly import Assembly
from ..setup.member import Member
from ..setup.rows import CoreRows

# ---- ports --------------------------------------------------------------------------------------
# Inputs and outputs of a frozen model, as a user gives them and as its file has them.

# What is given by subdomain and dof, and by subdomain and spring.
OF_DOFS, OF_SPRINGS = ("u", "v", "a"), ("deformation", "spring force")
# As FMI has structured names.
NAME = re.compile(r"[A-Za-z_]\w*(\[\d+\])?(\.[A-Za-z_]\w*(\[\d+\])?)*", re.ASCII)
Keys: TypeAlias = Sequence[tuple[str, Subdomain]]


class Input(NamedTuple):
    """An input: kind, subdomain and dof, or the row of a velocity; its value at the start."""

    name: str
    kind: str
    subdomain: int
    dof: int
    value: float | None  # None: not given

    @property
    def place(self) -> tuple[str, int, int]:
        return self.kind, self.subdomain, self.dof


class Output(NamedTuple):
    """An output: quantity, subdomain and dof or spring, or the row of a multiplier."""

    name: str
    what: str
    subdomain: int
    number: int


@dataclass(frozen=True)
class Ports:
    """The inputs and outputs of a model."""

    inputs: tuple[Input, ...]
    outputs: tuple[Output, ...]

    @classmethod
    def of(cls, inputs: Any, outputs: Any, keys: Keys, rows: int) -> Ports:
        """Checked; ValueError for what does not exist, by its name.

        keys: the names and subdomains of the coupler.
        rows: number of rows of its constraints.
        """
        for ports, argument in ((inputs, "inputs"), (outputs, "outputs")):
            if ports is not None and not isinstance(ports, Mapping):
                raise TypeError(f"{argument} must be a dict by name, got {ports!r}")
        names = [*(inputs or {}), *(outputs or {})]
        for name in names:
            if not isinstance(name, str) or not NAME.fullmatch(name):
                raise ValueError(
                    "names of inputs and outputs must be identifiers, with dots between them, got "
                    f"{name!r}"
                )
            if names.count(name) > 1:
                raise ValueError(
                    f"inputs and outputs must have different names, got {name!r} twice"
                )
        made = cls(
            tuple(_checked_input(name, x, keys, rows) for name, x in (inputs or {}).items()),
            tuple(_output(name, x, keys, rows) for name, x in (outputs or {}).items()),
        )
        places = [x.place for x in made.inputs]
        for x in made.inputs:
            if places.count(x.place) > 1:
                raise ValueError(f"inputs must be of different dofs, but that of {x.name!r} is not")
        return made

    def of_kind(self, kind: str, subdomain: int) -> list[Input]:
        return [x for x in self.inputs if x.kind == kind and x.subdomain == subdomain]


def _checked_input(name: str, value: Any, keys: Keys, rows: int) -> Input:
    what = f"inputs[{name!r}]"
    kind, *where = _entry(value, what, ("specimen", "force", "velocity"))
    length = 1 if kind == "velocity" else 2
    start = None
    if len(where) == length + 1:
        start = real_number(where.pop(), f"the value at the start of {what}")
    if kind == "velocity":
        _check_length(where, length, what, '("velocity", row) or ("velocity", row, value)')
        return Input(name, kind, 0, _row(where[0], rows, what), start)
    form = f"({kind!r}, subdomain, dof)"
    _check_length(where, length, what, f"{form} or {form[:-1]}, value)")
    return Input(name, kind, *_dof(where, keys, what), start)


def _row(value: Any, rows: int, what: str) -> int:
    row = whole_number(value, what, low=0)
    if row >= rows:
        raise ValueError(f"{what} must be one of {rows} rows, got {row}")
    return row


def _output(name: str, value: Any, keys: Keys, rows: int) -> Output:
    what = f"outputs[{name!r}]"
    quantity, *where = _entry(value, what, (*OF_DOFS, *OF_SPRINGS, "multiplier"))
    if quantity == "multiplier":
        _check_length(where, 1, what, '("multiplier", row)')
        return Output(name, quantity, 0, _row(where[0], rows, what))
    _check_length(where, 2, what, f"({quantity!r}, subdomain, number)")
    if quantity in OF_DOFS:
        return Output(name, quantity, *_dof(where, keys, what))
    i = _subdomain(where[0], keys, what)
    springs = sum(len(spring) for spring in keys[i][1].springs)
    spring = whole_number(where[1], what, low=0)
    if spring >= springs:
        raise ValueError(
            f"{what} must be one of {springs} springs of subdomain {keys[i][0]!r}, got {spring}"
        )
    return Output(name, quantity, i, spring)


def _entry(value: Any, what: str, words: Sequence[str]) -> tuple[Any, ...]:
    if not isinstance(value, tuple) or not value or value[0] not in words:
        raise ValueError(f"{what} must be a tuple that begins with one of {words}, got {value!r}")
    return value


def _check_length(where: Sequence[Any], length: int, what: str, form: str) -> None:
    if len(where) != length:
        raise ValueError(f"{what} must be {form}")


def _subdomain(key: Any, keys: Keys, what: str) -> int:
    try:
        return position(key, keys)
    except LookupError as error:
        raise ValueError(f"{what}: {error.args[0]}") from None


def _dof(where: Sequence[Any], keys: Keys, what: str) -> tuple[int, int]:
    i = _subdomain(where[0], keys, what)
    s = keys[i][1]
    dofs = np.asarray(dof_list([where[1]], s.n, what, s.dof_names))
    return i, int(dofs[0])


# ---- tree ---------------------------------------------------------------------------------------
# A tree of None, numbers, words, arrays, tuples and dicts as the bytes of a file. The form is
# that of csrc/core/describe/file.h: what the core is made of, written down.

FORMAT = 2
HEADER, NODE = 64, 40
ORDER = 0x01020304
TEXT, ARRAY = 8, 64  # alignment
NONE, INTEGER, REAL, WORD, TUPLE, DICT = range(6)
ARRAYS = {np.dtype(np.float64): 6, np.dtype(np.int64): 7, np.dtype(np.int32): 8}


# Nodes that one array may have: readers take what all nodes ask for up to this times the file.
SHARES = 8


class _Data:
    """What nodes point to, behind them: equal words once, equal arrays for up to eight nodes."""

    def __init__(self) -> None:
        self.pieces: list[tuple[int, Any]] = []  # alignment, bytes
        self.known: dict[Any, tuple[int, int]] = {}  # number of the piece, uses of it

    def add(self, key: Any, alignment: int, content: Any) -> int:
        """The number of the piece."""
        number, uses = self.known.get(key, (-1, 0))
        if number < 0 or (alignment == ARRAY and uses == SHARES):
            number, uses = len(self.pieces), 0
            self.pieces.append((alignment, content))
        self.known[key] = number, uses + 1
        return number

    def places(self, begin: int) -> list[int]:
        """Where each piece begins, and the end."""
        places = []
        for alignment, content in self.pieces:
            begin = -(-begin // alignment) * alignment
            places.append(begin)
            begin += memoryview(content).nbytes
        return [*places, -(-begin // 8) * 8]


def file_of(tree: Any) -> bytearray:
    """The bytes of a file with this tree.

    Raises TypeError for anything that is no data, with its place in the tree.
    """
    nodes: list[tuple[Any, ...]] = []  # kind, axes, three extents, content
    data, items = _Data(), [(tree, "")]
    at = 0
    while at < len(items):
        item, place = items[at]
        nodes.append(_node(item, place, data, items))
        at += 1
    begin = HEADER + NODE * len(nodes)
    places = data.places(begin)
    result = bytearray(places[-1])
    for i, (kind, axes, extents, content) in enumerate(nodes):
        value = struct.pack("<q", places[content]) if kind in (WORD, *ARRAYS.values()) else content
        struct.pack_into("<II3q8s", result, HEADER + NODE * i, kind, axes, *extents, value)
    for (_, content), begin_of in zip(data.pieces, places):
        flat = memoryview(content).cast("B")
        result[begin_of : begin_of + flat.nbytes] = flat
    total = _core.check_sum(memoryview(result)[HEADER:])
    header = b"pmalpha\0", FORMAT, ORDER, len(result), len(nodes), begin, total
    struct.pack_into("<8sIIQQQQ", result, 0, *header)
    return result


def _node(item: Any, place: str, data: _Data, items: list[tuple[Any, str]]) -> tuple[Any, ...]:
    """A node; its children are added to what is to be made nodes of."""
    if item is None:
        return NONE, 0, (0, 0, 0), bytes(8)
    if isinstance(item, (bool, int, np.integer)):
        return INTEGER, 0, (0, 0, 0), struct.pack("<q", int(item))
    if isinstance(item, (float, np.floating)):
        return REAL, 0, (0, 0, 0), struct.pack("<d", float(item))
    if isinstance(item, str):
        text = item.encode()
        return WORD, 0, (len(text), 0, 0), data.add(text, TEXT, text + b"\0")
    if isinstance(item, np.ndarray) and item.dtype in ARRAYS and 1 <= item.ndim <= 3:
        array = np.ascontiguousarray(item)
        kind = ARRAYS[item.dtype]
        flat = array.reshape(-1).view(np.uint8)
        key = kind, array.shape, blake2b(flat.data, digest_size=16).digest()
        extents = (*array.shape, *(0,) * (3 - array.ndim))
        return kind, array.ndim, extents, data.add(key, ARRAY, flat.data)
    pairs = _pairs(item)
    if pairs is not None:
        family = [(x, f"{place}.{key}") for key, value in pairs for x in (key, value)]
        return _parent(DICT, family, items)
    if isinstance(item, tuple):
        return _parent(TUPLE, [(x, f"{place}[{i}]") for i, x in enumerate(item)], items)
    raise TypeError(f"{place.lstrip('.')} is no data that a file can have, got {item!r}")


def _pairs(item: Any) -> Any:
    """Keys and values of a dict or a named tuple, None of anything else."""
    if isinstance(item, Mapping):
        return item.items()
    fields = getattr(item, "_fields", None)
    return zip(fields, item) if isinstance(item, tuple) and fields is not None else None


def _parent(
    kind: int, family: list[tuple[Any, str]], items: list[tuple[Any, str]]
) -> tuple[Any, ...]:
    first = len(items)
    items.extend(family)
    return kind, 0, (len(family), 0, 0), struct.pack("<q", first)


# ---- installed ----------------------------------------------------------------------------------
# Where the C library of frozen models is.

__all__ = ["c_library"]


def __dir__() -> list[str]:
    return sorted(__all__)


def c_library() -> Path:
    """The folder with the C library that steps frozen models: header, archive, shared library.

    Returns
    -------
    pathlib.Path
        With ``pmalpha.h``, ``libpmalpha.a``, the shared library of this system and the licence, of
        the same objects as this package.

    Raises
    ------
    FileNotFoundError
        For an installation without them; ``make install-c`` makes them of the sources.

    See Also
    --------
    Coupler.freeze : Writes what it reads.

    Examples
    --------
    >>> (c_library() / "pmalpha.h").exists()
    True
    """
    folder = Path(__file__).parent.parent / "c"
    if not (folder / "pmalpha.h").exists():
        raise FileNotFoundError(
            "this installation has no C library: `make install-c PREFIX=...` in a folder of the "
            "sources makes it"
        )
    return folder


# ---- model --------------------------------------------------------------------------------------

# Words in place of functions: csrc/library/open.c.
INPUTS = "inputs"


# ---- subdomains ----------------------------------------------------------------------------------


def subdomain(member: Member, load: Any, levels: Mapping[str, np.ndarray]) -> Any:
    """A subdomain with its load at a present, after `check_functions`."""
    fields = dict(member.parts)
    restoring: forms.Restoring | None = fields.get("restoring")
    if restoring is not None:
        functions = tuple(_with_inputs(x) if is_outside(x) else x for x in restoring.functions)
        fields["restoring"] = restoring._replace(functions=functions)
    fields["load"] = load
    if fields.get("iterate") is not None:
        iterate = fields["iterate"]
        fields["iterate"] = iterate._replace(threads=1, pattern=_with_loops(iterate.pattern))
    return {
        "name": member.name,
        "parts": fields,
        "order": np.ascontiguousarray(member.order, dtype=np.int64),
        "levels": levels,
        "iteration": member.core.iteration(),
    }


def is_outside(function: Any) -> bool:
    """Whether an entry of `forms.Restoring` is or has a function, which no file can have."""
    if isinstance(function, forms.Wheels):
        return False
    return not isinstance(function, forms.Specimen) or function.function is not None


def _with_inputs(function: Any) -> Any:
    """The word in place of a function."""
    return function._replace(function=INPUTS) if isinstance(function, forms.Specimen) else INPUTS


def check_functions(member: Member, inputs: Sequence[Input], coupling: Coupling) -> None:
    """ValueError for functions of a subdomain that these inputs do not replace."""
    where = f"subdomain {member.name!r}"
    if member.feedback is not None:
        raise ValueError(
            f"force of {where} depends on the motion, which no frozen model has: let it be the "
            "negative restoring force, and that an input"
        )
    _check_internal(member)
    items = items_of(member.subdomain.restoring)
    specimens = [x for x in items if _is_specimen(x)]
    acting = _acting_dofs(specimens, member.n)
    names = listing([x.name for x in inputs])
    beyond = [x for x in inputs if x.dof not in acting]
    missing = sorted(acting - {x.dof for x in inputs})
    if beyond:
        raise ValueError(
            f"input {beyond[0].name!r}: no specimen acts on dof {beyond[0].dof} of {where}; let "
            "its restoring= have a function or rig.External, whose place inputs take"
        )
    if missing:
        raise ValueError(
            f"restoring of {where} is {_described(specimens, member.n)}, which no file can have: "
            f'give all of these dofs as inputs, inputs={{"...": ("specimen", {member.name!r}, '
            f"dof)}}; missing {numbered('dof', missing)}. A specimen that acts on some dofs alone "
            "is rig.External(dofs)"
        )
    restoring = member.parts.get("restoring")
    functions = () if restoring is None else restoring.functions
    if sum(map(is_outside, functions)) > 1 or _are_mixed(specimens):
        raise ValueError(
            f"restoring of {where} has several functions or specimens, of which inputs {names} can "
            "replace one: let the others be in subdomains of their own, or springs"
        )
    if inputs and coupling in ("macro", "mean") and member.substeps > 1:
        raise ValueError(
            f"{where} must have one substep under {coupling!r} coupling to have a specimen as "
            f"input, got {member.substeps}: commands would be ahead of the interface force"
        )
    _check_devices(functions, where)


def _is_specimen(item: Any) -> bool:
    """Whether a restoring force is or ends in a function."""
    if isinstance(item, Device):
        return not item.springs and not isinstance(item.innermost, Device)
    return not isinstance(item, (Spring, Wheels))


def _acting_dofs(specimens: Sequence[Any], n: int) -> set[int]:
    """The dofs on which they act: a function on all of its subdomain."""
    dofs: set[int] = set()
    for item in specimens:
        external = external_of(item)
        dofs |= set(range(n) if external is None else map(int, external.dofs))
    return dofs


def _are_mixed(specimens: Sequence[Any]) -> bool:
    """Whether what is outside of this program acts where another specimen acts too."""
    external = [x for x in map(external_of, specimens) if x is not None]
    dofs = [int(dof) for x in external for dof in x.dofs]
    return bool(external) and (len(external) < len(specimens) or len(set(dofs)) < len(dofs))


def _described(specimens: Sequence[Any], n: int) -> str:
    if any(external_of(x) is None for x in specimens):
        return f"a function, which acts on all of its {counted(n, 'dof')}"
    return listing([repr(external_of(x)) for x in specimens])


def _check_devices(functions: Sequence[Any], where: str) -> None:
    """ValueError for what is between commands and an input that no loop outside can serve."""
    for function in functions:
        if not (isinstance(function, forms.Specimen) and is_outside(function)):
            continue
        if any(isinstance(x, forms.LinkageMatrix | forms.LinkageArms) for x in function.filters):
            raise ValueError(
                f"restoring of {where} has a Linkage, whose commands are of no dof, which an input "
                "must have: let the loop turn the command of the dofs into those of the actuators"
            )
        if any(_measures(x) for x in function.filters):
            raise ValueError(
                f"restoring of {where} has a compensator that needs the measured displacement of "
                'its specimen, which no input has: take method="polynomial", "inverse", or "model" '
                "without feedback and variations"
            )


def _measures(x: forms.Filter) -> bool:
    learns = isinstance(x, forms.Inverse) and not (x.feedback is None and x.regressors is None)
    return learns or isinstance(x, forms.Adaptive)


def _check_internal(member: Member) -> None:
    internal = member.parts.get("internal")
    forces = () if internal is None else internal.forces
    if any(x.function is not None or x.potential is not None for x in forces):
        raise ValueError(
            f"internal of subdomain {member.name!r} has functions, which no file can have: take "
            "springs"
        )


def _with_loops(pattern: forms.Numeric) -> forms.Numeric:
    """The same without routines of BLAS."""
    return pattern._replace(dgemm=None, dtrsm=None)


# ---- the coupler ---------------------------------------------------------------------------------


def coupler(assembly: Assembly, free: Sequence[int]) -> dict[str, Any]:
    """The coupler, for one thread; `free`: further rows with a velocity, as the core has them."""
    fields = dict(assembly.parts)
    fields["options"] = dict(fields["options"], threads=1, worthwhile=False)
    further = (forms.Motion(np.array([row], dtype=np.int64), None) for row in free)
    fields["motions"] = (*fields["motions"], *further)
    iteration, contact = fields.get("iteration"), fields.get("contact")
    if isinstance(iteration, forms.Iteration):
        fields["iteration"] = iteration._replace(pattern=_with_loops(iteration.pattern))
    if contact is not None:
        fields["contact"] = contact._replace(dgemm=None, dtrsm=None)
    return fields


def state(
    assembly: Assembly,
    origin: int,
    t0: float,
    numbers: Mapping[str, np.ndarray],
    has_free_motions: bool,
) -> dict[str, Any]:
    arrays = dict(numbers)
    if has_free_motions:
        arrays.setdefault("moved", np.zeros(arrays["prescribed"].size))
    return {"step": assembly.core.step_count, "origin": origin, "t0": float(t0), "arrays": arrays}


# ---- inputs and outputs --------------------------------------------------------------------------


def input_of(
    x: Input,
    value: float,
    members: Sequence[Member],
    rows: CoreRows,
    places: Mapping[int, tuple[int, int]],
) -> dict[str, Any]:
    """places: the number of the motion and the row of it, by row of the user."""
    fields: dict[str, Any] = {"name": x.name, "kind": x.kind, "value": float(value)}
    if x.kind == "velocity":
        motion, row = places[x.dof]
        return fields | {"motion": motion, "row": row, "scale": float(rows.scale[x.dof])}
    member = members[x.subdomain]
    place = {"dof": x.dof, "position": int(member.position[x.dof])}
    return fields | {"subdomain": x.subdomain} | place


def output(x: Output, members: Sequence[Member], rows: CoreRows) -> Mapping[str, Any]:
    made: dict[str, Any] = {"name": x.name, "what": x.what, "scale": 1.0}
    if x.what == "multiplier":
        place = {"position": int(rows.position[x.number]), "scale": float(rows.scale[x.number])}
        return made | place
    member = members[x.subdomain]
    of_spring = x.what in ("deformation", "spring force")
    number = x.number if of_spring else int(member.position[x.number])
    return made | {"subdomain": x.subdomain, "position": number}
