"""Contact at the nodes of a mesh: `History.contact_fields`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import numbered
from ..setup.schedule import Lookup
from .quantities import position

FIELDS = ("contact", "gap", "contact impulse", "contact force", "slip")
OPEN, CLOSED = 1.0, 2.0


def contact_fields(history: Any, structure: Any, subdomain: Any, reduced: Any) -> dict[str, Any]:
    """`History.contact_fields`."""
    i = position(subdomain, history.keys)
    motion = history[i]
    count = len(structure.points)
    dofs = _dofs(structure, motion, reduced)
    nodes = {i: dofs // (structure.n // count)}
    return nodal_fields(history, nodes, count, np.asarray(motion.t))


def nodal_fields(
    history: Any, nodes: Mapping[int, np.ndarray], count: int, times: np.ndarray
) -> dict[str, np.ndarray]:
    """The fields at `count` nodes, from the node of each dof of subdomains, by their index."""
    shape = times.size, count
    fields = {name: np.zeros(shape) for name in FIELDS}
    reach = np.zeros(count)
    for recorded, contact in zip(history.contact_layout, history.contacts):
        if recorded.contact is None:
            raise ValueError(
                f"history must be that of a run, got one of a file, without the rows of {contact!r}"
            )
        at = _rows_at(np.asarray(contact.t), times, contact.name)
        impulse = np.diff(np.cumsum(contact.impulse, axis=0)[at], axis=0, prepend=0.0)
        slip = _slip(history, recorded, times)
        for i, N in _matrices(history, recorded.contact.matrices, contact.name).items():
            if i not in nodes:
                continue
            row, node, weight = _reach(N, nodes[i])
            A = sp.csr_array((weight, (row, node)), shape=(contact.impulse.shape[1], count))
            fields["contact impulse"] += impulse @ A
            # of the row that reaches the node most
            last = np.lexsort((-row, weight, node))
            last = last[np.append(node[last][1:] != node[last][:-1], True)[: last.size]]
            last = last[weight[last] > reach[node[last]]]
            row, node = row[last], node[last]
            reach[node] = weight[last]
            fields["gap"][:, node], fields["slip"][:, node] = contact.gap[at][:, row], slip[:, row]
            fields["contact"][:, node] = np.where(impulse[:, row] > 0.0, CLOSED, OPEN)
    h = np.diff(times, prepend=-np.inf)[:, None]
    fields["contact force"] = fields["contact impulse"] / h
    return fields


def _dofs(structure: Any, motion: Any, reduced: Any) -> np.ndarray:
    """The dof of the mesh of each dof of a subdomain: by `reduced`, by the names, or all."""
    if reduced is not None:
        dofs = np.asarray(reduced.free)
    elif motion.n == structure.n:
        dofs = np.arange(motion.n)
    else:
        known = {name: k for k, name in enumerate(structure.dof_names)}
        dofs = np.array([known.get(name, -1) for name in motion.dof_names or ()], dtype=np.int64)
    if dofs.size != motion.n or np.any(dofs < 0) or np.any(dofs >= structure.n):
        raise ValueError(
            f"subdomain {motion.name!r} must have the {structure.n} dofs of the mesh, dofs named "
            f"as there, or come with reduced=, got {motion.n} dofs"
        )
    return dofs


def _matrices(history: Any, matrices: Any, name: str) -> dict[int, sp.csr_array]:
    subdomains = [s for _, s in history.keys]
    lookup = Lookup(subdomains, [x for x, _ in history.keys])
    return lookup.matrices(matrices, f"contact {name!r}")


def _rows_at(t: np.ndarray, times: np.ndarray, what: str) -> np.ndarray:
    at = np.minimum(np.searchsorted(t, times), t.size - 1)
    missing = times[t[at] != times]
    if missing.size:
        raise ValueError(
            f"{what!r} must be recorded at all times of the motion, which it is not at "
            f"t = {missing[0]:g}"
        )
    return at


def _reach(N: sp.csr_array, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row, node and the length of the entries there."""
    entries = sp.coo_array(N)
    squares = sp.coo_array(
        (entries.data**2, (entries.coords[0], nodes[entries.coords[1]])),
        shape=(N.shape[0], nodes.max() + 1),
    ).tocsr()
    sums = squares.tocoo()
    mask = sums.data > 0.0
    return sums.coords[0][mask], sums.coords[1][mask], np.sqrt(sums.data[mask])


def _slip(history: Any, recorded: Any, times: np.ndarray) -> np.ndarray:
    """Relative displacement along the tangents, (k, rows): of one with its sign, of two the
    length."""
    along = []
    for T in recorded.contact.tangents:
        slip = np.zeros((times.size, recorded.rows))
        for i, A in _matrices(history, T, recorded.name).items():
            motion = history[i]
            at = _rows_at(np.asarray(motion.t), times, motion.name)
            there = A[:, motion.dofs]
            lost = np.setdiff1d(np.flatnonzero(np.diff(sp.csc_array(A).indptr)), motion.dofs)
            if lost.size:
                raise ValueError(
                    f"the dofs of {recorded.name!r} must be recorded, which "
                    f"{numbered('dof', lost)} of {motion.name!r} are not"
                )
            slip += np.asarray(motion.u)[at] @ there.T
        along.append(slip)
    if not along:
        return np.zeros((times.size, recorded.rows))
    return along[0] if len(along) == 1 else np.hypot(*along)
