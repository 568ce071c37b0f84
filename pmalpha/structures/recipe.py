"""How the matrices of a structure are made of its elements, for all or for some of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from .element_force import ElementForce

# The elements that are meant, by kind: their numbers, or slice(None) for all.
Chosen = Mapping[str, Any]

# recipe(chosen, elements, nodes) -> (M, K, forces) of the chosen elements: M (n,) or (n, n), K and
# the internal forces on the dofs of `nodes` nodes, whose numbers are those in `elements`, by kind
# an array (chosen elements, corners). Numbers of nodes only say which elements are connected: with
# a node of its own for each corner the matrices consist of those of the single elements.
Made: TypeAlias = "tuple[Any, Any, tuple[ElementForce, ...]]"
Recipe: TypeAlias = Callable[[Chosen, Mapping[str, np.ndarray], int], Made]


def of_chosen(values: np.ndarray, chosen: Any) -> np.ndarray:
    """The rows of the chosen elements; one row is that of every element."""
    return values if len(values) == 1 else values[chosen]


def all_of(elements: Mapping[str, np.ndarray]) -> Chosen:
    return dict.fromkeys(elements, slice(None))
