"""Stresses at the nodes of plates and solids, for pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import check_word, real_array

# The rows of an element of `Structure.element_stresses`, by its dimension.
COMPONENTS = {2: ("xx", "yy", "xy"), 3: ("xx", "yy", "zz", "xy", "yz", "xz")}


def nodal_stress(structure: Any, u: Any, what: str) -> np.ndarray:
    """The implementation of `Structure.stress`."""
    u = real_array(u, "u", (1, 2))
    if u.shape[-1] != structure.n:
        raise ValueError(f"u must have {structure.n} in the last dimension, got shape {u.shape}")
    S = structure.element_stresses()
    names = COMPONENTS[structure.points.shape[1]]
    check_word(what, "what", ("mises", *names))
    elements = np.asarray(u @ S.T).reshape(*u.shape[:-1], -1, len(names))
    across = [
        np.broadcast_to(own.across, len(structure.elements[kind]))
        for kind, own in structure.moduli.items()
    ]
    values = (
        _mises(elements, np.concatenate(across))
        if what == "mises"
        else elements[..., names.index(what)]
    )
    blocks = [structure.elements[kind] for kind in structure.moduli]
    nodes = np.concatenate([block.ravel() for block in blocks])
    widths = np.concatenate([np.full(len(block), block.shape[1]) for block in blocks])
    meet = sp.csr_array(
        (np.ones(nodes.size), (np.repeat(np.arange(widths.size), widths), nodes)),
        shape=(widths.size, len(structure.points)),
    )
    count = np.bincount(nodes, minlength=len(structure.points))
    result: np.ndarray = (values @ meet) / np.maximum(count, 1)
    return result


def _mises(s: np.ndarray, across: np.ndarray) -> np.ndarray:
    """sqrt(3 J2) of stresses (..., E, components); across the plane zz = across (xx + yy)."""
    d = 2 if s.shape[-1] == 3 else 3
    normal = [s[..., i] for i in range(d)]
    if d == 2:
        normal.append(across * (normal[0] + normal[1]))
    xx, yy, zz = normal
    shear = sum(s[..., i] ** 2 for i in range(d, s.shape[-1]))
    J = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * shear
    result: np.ndarray = np.sqrt(J)
    return result
