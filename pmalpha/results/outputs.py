"""Outputs of a run: linear combinations of displacements, velocities and accelerations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import real_number
from ..problem.constraints import selection
from ..problem.dofs import NodeNames, dof_list, has_names
from ..problem.matrices import rectangular
from ..problem.subdomain import Subdomain
from .quantities import OF_SUBDOMAIN, Combination, by_index

QUANTITIES = ("u", "v", "a")
# Those with the motion of the ground added.
ABSOLUTE = tuple(f"absolute {quantity}" for quantity in QUANTITIES)
# Names of other columns of `to_pandas` and `to_xarray`.
RESERVED = (*OF_SUBDOMAIN, "time", "dof", "spring")


@dataclass(frozen=True)
class Outputs:
    """The outputs of a subdomain, y = W_u u + W_v v + W_a a, one below the other."""

    sizes: dict[str, int]  # number of rows by name
    # W_u, W_v and W_a of all outputs; None without entries
    weights: tuple[sp.csr_array | None, ...]
    ground: tuple[
        sp.csr_array | None, ...
    ] = ()  # those of them that act on the ground's motion too

    @property
    def rows(self) -> int:
        return sum(self.sizes.values())

    def split(self, values: np.ndarray) -> dict[str, np.ndarray]:
        """The columns of each output, views."""
        ends = np.cumsum(list(self.sizes.values()))[:-1]
        return dict(zip(self.sizes, np.split(values, ends, axis=1)))

    def in_order(self, position: np.ndarray) -> tuple[Combination | None, ...]:
        """The weights in the form of the core; `position` is that of each dof in its order."""
        return tuple(
            None
            if W is None
            else Combination(
                W.indptr.astype(np.int64), position[W.indices].astype(np.int64), W.data
            )
            for W in self.weights
        )


def chosen_outputs(
    outputs: Mapping[Any, Any] | None, keys: Sequence[tuple[str, Subdomain]]
) -> list[Outputs | None]:
    """The outputs of each subdomain, None for a subdomain without."""
    chosen: list[Outputs | None] = [None] * len(keys)
    for i, matrices in by_index(outputs, keys, "outputs").items():
        name, subdomain = keys[i]
        chosen[i] = _outputs(matrices, subdomain, f"outputs[{name!r}]")
    return chosen


def _outputs(matrices: Any, subdomain: Subdomain, what: str) -> Outputs:
    if not isinstance(matrices, Mapping) or not matrices:
        raise TypeError(f"{what} must be a dict of matrices by name, got {matrices!r}")
    for name, value in matrices.items():
        if name in ABSOLUTE and (not _is_dict(value) or _is_weights(value)):
            raise ValueError(
                f"{what} must have names of outputs, got {name!r}, a quantity: "
                f"{{'roof': {{{name!r}: weights}}}}"
            )
        if not isinstance(name, str) or not name or name in RESERVED:
            raise ValueError(
                f"{what} must have names other than {', '.join(map(repr, RESERVED))}, got {name!r}"
            )
    n = subdomain.n
    blocks = {
        name: _terms(value, subdomain, f"{what}[{name!r}]") for name, value in matrices.items()
    }
    sizes = {name: next(iter(terms.values())).shape[0] for name, terms in blocks.items()}
    weights = tuple(_stacked(blocks, sizes, n, x) for x in zip(QUANTITIES, ABSOLUTE))
    ground = tuple(_stacked(blocks, sizes, n, [x]) for x in ABSOLUTE)
    return Outputs(sizes, weights, () if all(W is None for W in ground) else ground)


def _terms(value: Any, subdomain: Subdomain, what: str) -> dict[str, sp.csr_array]:
    """The matrices of an output, (rows, n), by the quantity that each acts on."""
    by_quantity = _is_dict(value) and not _is_weights(value)
    matrices: Any = value if by_quantity else {"u": value}
    if not matrices or any(quantity not in QUANTITIES + ABSOLUTE for quantity in matrices):
        raise ValueError(
            f"{what} must be a matrix, weights by dof, or a dict of these by 'u', 'v' or 'a', got "
            f"keys {list(matrices)}; 'absolute a' and so on add the motion of the ground"
        )
    terms = {
        quantity: _weights(W, subdomain, f"{what}[{quantity!r}]" if by_quantity else what)
        for quantity, W in matrices.items()
    }
    rows = {W.shape[0] for W in terms.values()}
    if len(rows) > 1 or 0 in rows:
        raise ValueError(f"{what} must have one number of rows, at least 1, got {sorted(rows)}")
    return terms


def _is_dict(value: Any) -> bool:
    return isinstance(value, Mapping) and not sp.issparse(value)  # a dok_matrix is both


def _is_weights(value: Mapping[Any, Any]) -> bool:
    """Whether it is a number for each of some dofs."""
    return bool(value) and all(isinstance(x, (Real, np.number)) for x in value.values())


def _weights(W: Any, subdomain: Subdomain, what: str) -> sp.csr_array:
    """The matrix, (rows, n), from one, from weights by dof, or from that of a whole mesh."""
    n, names = subdomain.n, subdomain.dof_names
    if _is_dict(W):
        numbers = {key: real_number(x, f"{what}[{key!r}]") for key, x in W.items()}
        columns = dof_list(list(numbers), n, what, names)
        entries = np.array(list(numbers.values())), (np.zeros(columns.size, int), columns)
        return sp.csr_array(entries, shape=(1, n))
    if has_names(W):
        return selection(dof_list(W, n, what, names), 1.0, n)
    size = names.model_size if isinstance(names, NodeNames) else n
    if isinstance(names, NodeNames) and size > n and np.shape(W)[-1:] == (size,):
        return sp.csr_array(rectangular(W, size, what)[:, names.numbers])  # the rest is fixed
    return rectangular(W, n, what)


def _stacked(
    blocks: Mapping[str, Mapping[str, sp.csr_array]],
    sizes: Mapping[str, int],
    n: int,
    quantities: Sequence[str],
) -> sp.csr_array | None:
    """The matrices of all outputs for some quantities, one below the other."""
    matrix = sp.vstack(
        [
            sum((terms[x] for x in quantities if x in terms), sp.csr_array((sizes[name], n)))
            for name, terms in blocks.items()
        ],
        format="csr",
    )
    return matrix if matrix.nnz else None
