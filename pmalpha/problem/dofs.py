"""Dofs as a user gives them: numbers, negative ones that count from the end, names, masks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any, overload

import numpy as np

from .._checks import MOST, as_int, counted, listing, plain_array, real_number

# Names among which the nearest one is looked for.
MOST_COMPARED = 20_000
GROUND = -1


class NodeNames(Sequence[str]):
    """Names of the dofs of a mesh, "ux 12": the component and the number of the node.

    They are not stored: a mesh may have millions of dofs.

    components: of a node, in the order of its dofs.
    numbers: (n,) array of int, the dofs, in the numbering of all dofs of the mesh.
    model_size: number of all dofs of the mesh.
    supports: dofs of the mesh that are fixed and so have no names, as far as that is known.
    """

    def __init__(
        self,
        components: Sequence[str],
        numbers: np.ndarray,
        model_size: int,
        supports: Sequence[int] | np.ndarray = (),
    ):
        self.components, self.numbers = tuple(components), numbers
        self.model_size = model_size
        self.supports = np.asarray(supports, dtype=np.int64)

    def __len__(self) -> int:
        return len(self.numbers)

    @overload
    def __getitem__(self, i: int) -> str: ...

    @overload
    def __getitem__(self, i: slice) -> tuple[str, ...]: ...

    def __getitem__(self, i: int | slice) -> str | tuple[str, ...]:
        if isinstance(i, slice):
            return tuple(map(self._name, self.numbers[i]))
        return self._name(self.numbers[i])

    def _name(self, dof: int) -> str:
        node, component = divmod(int(dof), len(self.components))
        return f"{self.components[component]} {node}"

    def index(self, name: Any, *limits: Any) -> int:
        component, _, node = str(name).rpartition(" ")
        if component in self.components and node.isdecimal():
            dof = len(self.components) * int(node) + self.components.index(component)
            positions = np.flatnonzero(self.numbers == dof)
            if positions.size:
                return int(positions[0])
        raise ValueError(f"{name!r} is not among the names")

    def __repr__(self) -> str:
        return f"<names of {counted(len(self), 'dof')} of nodes>"


class Nodes(np.ndarray):
    """Numbers of nodes with several dofs each, which are no numbers of dofs.

    What is computed from them is a plain array, what is selected from them are nodes.
    """

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        return array[()] if return_scalar else np.asarray(array)


def as_nodes(numbers: np.ndarray, dofs_per_node: int) -> np.ndarray:
    """Numbers of nodes; those with one dof are numbers of dofs too."""
    return numbers if dofs_per_node == 1 else numbers.view(Nodes)


def checked_names(value: Any, n: int) -> Sequence[str] | None:
    """The names of n dofs, different words."""
    if value is None:
        return None
    if isinstance(value, str) or not isinstance(value, (Sequence, np.ndarray)):
        raise TypeError(f"dof_names must be a list of {counted(n, 'name')}, got {value!r}")
    if len(value) != n:
        raise ValueError(f"dof_names must be {counted(n, 'name')}, one a dof, got {len(value)}")
    if isinstance(value, NodeNames):
        return value
    for name in value:
        if not isinstance(name, str) or not name:
            raise TypeError(f"dof_names must be words that are not empty, got {name!r}")
    names = tuple(map(str, value))
    if len(set(names)) < n:
        twice = sorted({name for name in names if names.count(name) > 1})
        raise ValueError(f"dof_names must be different, got {listing(twice)} twice")
    return names


def components_of(names: Sequence[str] | None, *, numbered: bool = False) -> list[str]:
    """The component of each dof, "ux" of "ux 12"; a name without the number of a node is its own,
    or "" where only `numbered` ones count."""
    if names is None:
        return []
    if isinstance(names, NodeNames):
        kinds = names.components
        return [kinds[i] for i in (names.numbers % len(kinds)).tolist()]
    components = []
    for name in names:
        component, _, node = name.rpartition(" ")
        otherwise = "" if numbered else name
        components.append(component if component and node.isdecimal() else otherwise)
    return components


def along(
    direction: str | Mapping[str, float], names: Sequence[str] | None, name: str
) -> np.ndarray:
    """(n,) of a direction, a component or a dict of them with factors: the factor of each dof."""
    factors = {direction: 1.0} if isinstance(direction, str) else dict(direction)
    if names is None:
        raise ValueError(
            f"{name} must be an array, a number for each dof, where dofs have no names, got "
            f"{direction!r}"
        )
    components = np.array(components_of(names))
    known = list(dict.fromkeys(components.tolist()))
    result = np.zeros(len(components))
    if not factors:
        raise ValueError(f"{name} must have a component of {listing(known)}, got none")
    for component, factor in factors.items():
        if component not in known:
            raise ValueError(
                f"{name} must be a component of the dofs, {listing(known)}, got {component!r}"
            )
        result[components == component] = real_number(factor, f"{name}[{component!r}]")
    return result


def names_at(
    names: Sequence[str] | None, dofs: np.ndarray, fixed: Sequence[int] | np.ndarray = ()
) -> Sequence[str] | None:
    """The names of some of the dofs; `fixed` are those of supports."""
    if names is None:
        return None
    if isinstance(names, NodeNames):
        supports = np.concatenate([names.supports, names.numbers[np.asarray(fixed, dtype=int)]])
        return NodeNames(names.components, names.numbers[dofs], names.model_size, supports)
    return tuple(names[i] for i in dofs)


def dof_list(
    value: Any, n: int | None, name: str, names: Sequence[str] | None = None
) -> np.ndarray:
    """Different dofs, (k,), as `dof_array`."""
    if np.ndim(plain_array(value, name)) > 1:
        raise TypeError(f"{name} must be a 1-D array of whole numbers, got {value!r}")
    dofs = np.atleast_1d(dof_array(value, n, name, names))
    if dofs.size == 1:
        return dofs
    values, counts = np.unique(dofs, return_counts=True)
    if np.any(counts > 1):
        raise ValueError(f"{name} must not repeat a dof, got {listing(values[counts > 1])} twice")
    return dofs


def dof_array(
    value: Any, n: int | None, name: str, names: Sequence[str] | None = None
) -> np.ndarray:
    """Whole numbers in 0..n-1: from numbers, of which negative ones count from the end, from names,
    from both, or from a mask of n.

    Where n is not known, None, they are numbers that are not negative.

    Returns ndarray of int, of the shape of the value; of a mask the numbers, (k,).
    """
    if isinstance(value, Nodes):
        raise TypeError(
            f"{name} must be dofs, got nodes {listing(value)} with several dofs each; their dofs "
            "are structure.dofs(nodes)"
        )
    dofs = plain_array(numbers_of(value, name, names), name)
    if dofs.size == 0:
        dofs = dofs.astype(np.int64)
    if dofs.dtype.kind == "b" and dofs.ndim == 1:
        if n is not None and dofs.shape != (n,):
            raise ValueError(f"{name} must be a mask of shape ({n},), got shape {dofs.shape}")
        return np.flatnonzero(dofs)
    beyond = dofs.dtype == object and all(type(x) is int for x in dofs.flat)  # one beyond int64
    if dofs.dtype.kind not in "iu" and not beyond:
        advice = as_int(dofs) if dofs.dtype.kind == "f" else ""
        raise TypeError(f"{name} must be a 1-D array of whole numbers, got {value!r}{advice}")
    outside = dofs[(dofs < (0 if n is None else -n)) | (dofs >= (MOST if n is None else n))]
    if outside.size and n is None:
        rule = "not be negative" if outside.min() < 0 else f"be below {MOST}"
        raise ValueError(f"{name} must {rule}, got {listing(outside)}")
    if outside.size:
        assert n is not None
        ends = f"{-n}..{n - 1}" if outside.min() < 0 else f"0..{n - 1}"
        raise ValueError(f"{name} must lie in {ends}, got {listing(outside)}")
    dofs = dofs.astype(np.int64)
    return dofs if n is None else dofs % n


def numbers_of(value: Any, name: str, names: Sequence[str] | None) -> Any:
    """The same with numbers in place of names."""
    if isinstance(value, str):
        return number_of(value, name, names)
    if isinstance(value, np.ndarray) and value.dtype.kind in "UO":
        value = value.tolist()
    if isinstance(value, (list, tuple)) and any(isinstance(x, (str, list, tuple)) for x in value):
        return [
            numbers_of(x, name, names) if isinstance(x, (str, list, tuple)) else x for x in value
        ]
    return value


def has_names(value: Any) -> bool:
    """Whether it is a name of a dof, or a list with one."""
    return isinstance(value, str) or (
        isinstance(value, (list, tuple)) and any(isinstance(x, str) for x in value)
    )


def number_of(dof_name: str, name: str, names: Sequence[str] | None) -> int:
    """The number of a dof by its name; ValueError with the nearest name."""
    if names is None:
        raise TypeError(
            f"{name} must be a 1-D array of whole numbers, since there are no dof_names, got "
            f"{dof_name!r}"
        )
    try:
        return names.index(dof_name)
    except ValueError:
        near = get_close_matches(dof_name, names[:MOST_COMPARED], n=1, cutoff=0.0)
        raise ValueError(
            f"{name} must be dofs by name, got {dof_name!r}; the nearest is {near[0]!r}"
        ) from None


def spring_dofs(dofs: Any) -> np.ndarray:
    """(m, 2) array of int, -1 for the ground; of names too an array of objects, None for it."""
    if isinstance(dofs, Nodes):
        dof_array(dofs, None, "dofs")
    array = plain_array(dofs, "dofs")
    if array.dtype.kind in "UO" and array.size:
        array = _named(np.array(dofs, dtype=object), dofs)  # or numbers beside words were words
    elif array.dtype.kind not in "iu" and array.size:
        raise TypeError(f"dofs must be whole numbers or names, got {dofs!r}")
    if isinstance(dofs, tuple) and array.shape == (2,):
        pair = tuple(array.tolist())
        raise ValueError(
            f"dofs must be [{pair}] for one spring between two dofs, or {list(pair)} for two "
            f"springs to the ground, got {pair}"
        )
    array = np.array(array)  # one without memory of its own may claim to be of any size
    if array.dtype != object and array.size and int(array.max()) >= MOST:
        raise ValueError(f"dofs must be below {MOST}, got {array.max()}")
    if array.ndim < 2:
        array = _to_ground(np.atleast_1d(array))
    if array.ndim != 2 or array.shape[1] != 2 or len(array) == 0:
        raise ValueError(f"dofs must be of shape (m,) or (m, 2), m > 0, got {np.shape(dofs)}")
    if array.dtype != object:
        if array.min() < GROUND:
            raise ValueError(f"dofs must not be below -1, the ground, got {array.min()}")
        array = array.astype(np.int64)
    same = np.flatnonzero(array[:, 0] == array[:, 1])
    if same.size:
        raise ValueError(f"dofs of a spring must differ, got the same at springs {listing(same)}")
    array.setflags(write=False)
    return array


def _named(array: np.ndarray, dofs: Any) -> np.ndarray:
    """Names and numbers as they are, in pairs None for the ground."""
    for at, x in np.ndenumerate(array):
        if isinstance(x, (bool, np.bool_)) or not isinstance(x, (str, int, np.integer)):
            raise TypeError(f"dofs must be whole numbers or names, got {dofs!r}")
        if array.ndim == 2 and x in ("ground", GROUND):
            array[at] = None
    return array


def _to_ground(first: np.ndarray) -> np.ndarray:
    """Pairs with the ground; of objects if numbers count from the end."""
    if first.dtype == object or first.size and first.min() < 0:
        return np.column_stack([first.astype(object), np.full(first.shape, None)])
    return np.column_stack([first, np.full_like(first, GROUND, dtype=np.int64)])


def numbers_along(value: Any, size: int, name: str) -> np.ndarray:
    """An array of numbers of this size in the last dimension."""
    array = plain_array(value, name)
    if array.dtype.kind not in "iufc":
        raise TypeError(f"{name} must hold numbers, got dtype {array.dtype}")
    if array.shape[-1:] != (size,):
        raise ValueError(f"{name} must have {size} in the last dimension, got shape {array.shape}")
    return array
