"""What gradients are taken with respect to, by the elements of a structure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._checks import check_word, counted
from ..gradients.parameters import Parameters, labelled
from ..problem.subdomain import Subdomain
from ..structures.element_force import of_chosen
from .whole import Whole, whole_of

__all__ = ["element_parameters"]

# What a factor of elements multiplies.
SCALED = {"stiffness": "K", "mass": "M", "thickness": "MK"}
# Elements whose matrices are made at once.
CHUNK = 4096


def element_parameters(
    structure: Any,
    subdomain: Subdomain | str,
    *,
    labels: Any = None,
    scales: str = "stiffness",
    fixed: Any = None,
) -> Parameters:
    """Factors of the stiffness, mass or thickness of elements, at 1, for `Coupler.gradient`.

    Parameters
    ----------
    structure : Structure, Elements, or list of Elements
        Of which the matrices of the subdomain were made. `Cut.parameters` is for those that
        were cut.
    subdomain : Subdomain or str
        Its dofs are the free dofs in rising order. With Rayleigh damping a Subdomain, not its
        name: its C then changes with M and K.
    labels : (elements,) array_like, optional
        Elements with the same label share a factor, such as ``structure.labels()`` for the
        groups of a mesh, or ``np.arange(...)`` for a factor of each element. The elements are
        counted through all kinds and groups. Default: one factor for all.
    scales : {"stiffness", "mass", "thickness"}
        What the factor multiplies: K (Young's modulus), M (density), or both.
    fixed : array_like, optional
        As for `cut`: the dofs that the subdomain has not.

    Returns
    -------
    Parameters
        With ``labels``.

    Raises
    ------
    TypeError, ValueError
        For bad labels, internal forces, and another number of free dofs than the subdomain has.

    Examples
    --------
    The moduli of two halves of a cantilever:

    >>> import numpy as np, pmalpha as pm
    >>> from pmalpha import structures
    >>> wall = structures.plate(8, 2, 0.5, E=30e9, nu=0.2, rho=2500.0)
    >>> foot = wall.dofs(wall.nodes_at(x=0.0))
    >>> held = pm.reduce(wall.M, wall.K, fixed=foot)
    >>> beam = pm.Subdomain(held.M, held.K, scheme=pm.Newmark(), name="beam")
    >>> halves = np.where(np.arange(16) < 8, "left", "right")
    >>> moduli = pm.element_parameters(wall, beam, labels=halves, fixed=foot)
    >>> moduli, moduli.labels.tolist()
    (<Parameters of 'beam': 2 by K>, ['left', 'right'])
    """
    model = whole_of(structure, fixed, None)
    n = np.count_nonzero(model.free)
    if isinstance(subdomain, Subdomain) and subdomain.n != n:
        raise ValueError(
            f"structure must have the {counted(subdomain.n, 'dof')} of {subdomain.name!r} free,"
            f" got {n}: give the others as fixed"
        )
    tags = np.zeros(model.count, int) if labels is None else labels
    every = np.ones(model.count, bool)
    return factors(model, subdomain, np.flatnonzero(model.free), every, tags, scales)


def factors(
    model: Whole,
    subdomain: Subdomain | str,
    dofs: np.ndarray,
    chosen: np.ndarray,
    labels: Any,
    scales: str,
) -> Parameters:
    """`element_parameters` for the chosen (elements,) of a structure, with all of its labels.

    `dofs` are those of the structure that the subdomain has, in its order.
    """
    if not model.linear:
        raise ValueError("structure must have no internal forces: they have no gradients here")
    check_word(scales, "scales", tuple(SCALED))
    names, of = labelled(labels, model.count)
    place = np.full(model.n + 1, -1)  # the last entry is that of negative dofs
    place[dofs] = np.arange(dofs.size)
    # a label without elements here has one without entries
    where, own_labels = [np.zeros((names.size, 1), int)], [names]
    matrices = {kind: [np.zeros((names.size, 1, 1))] for kind in SCALED[scales]}
    for block in model.blocks(CHUNK):
        rows = np.flatnonzero(chosen[block.numbers])
        local = place[block.dofs[rows]]
        free = (local >= 0) & of_chosen(block.free, rows)
        pairs = free[:, :, None] & free[:, None, :]
        where.append(np.where(free, local, 0))
        own_labels.append(names[of[block.numbers[rows]]])
        for kind, listed in matrices.items():
            values = of_chosen(getattr(block, kind), rows)
            if values.ndim == 2:
                values = values[:, :, None] * np.eye(values.shape[1])
            listed.append(np.where(pairs, values, 0.0))
    terms = {kind: _stacked(listed) for kind, listed in matrices.items()}
    rayleigh = getattr(subdomain, "rayleigh", None)
    if rayleigh is not None:
        shares = dict(zip("MK", rayleigh))
        terms["C"] = np.sum([shares[kind] * x for kind, x in terms.items()], axis=0)
    return Parameters(subdomain, dofs=_stacked(where), labels=np.concatenate(own_labels), **terms)


def _stacked(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """One below the other, with zeros at the end of shorter rows and columns."""
    width = max(x.shape[1] for x in arrays)
    return np.concatenate(
        [np.pad(x, [(0, 0), *[(0, width - x.shape[1])] * (x.ndim - 1)]) for x in arrays]
    )
