"""A structure cut into subdomains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from .._checks import counted, listing, real_array, time_step
from ..errors import FactorizationError
from ..problem.arguments import VectorLike
from ..problem.constraints import Constraint
from ..problem.damping import checked_rayleigh
from ..problem.dofs import names_at
from ..problem.matrices import diagonal
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from ..structures.structure import Structure
from .choice import (
    Candidates,
    Choice,
    CutMember,
    automatic,
    by_labels,
    by_layer,
    by_steps,
    with_substeps,
)
from .division import Division, checked_motion
from .elements import Elements
from .result import Cut
from .whole import Whole, whole_of

__all__ = ["cut"]


def cut(
    structure: Structure | Elements | Sequence[Elements],
    labels: Any = None,
    *,
    parts: int | str | None = None,
    layer_of: Any = None,
    dt: float | None = None,
    scheme: Scheme | Sequence[Scheme] | Mapping[str, Scheme] | None = None,
    force: Any = None,
    u0: VectorLike | None = None,
    v0: VectorLike | None = None,
    rayleigh: Any = None,
    damping_ratio: Mapping[float, float] | None = None,
    points: Any = None,
    fixed: Any = None,
    substeps: Mapping[Any, int] | None = None,
) -> Cut:
    """Cut a structure into subdomains along the boundaries of its elements.

    Masses, stiffness, damping, internal forces and loads are divided: summed over the subdomains
    they are those of the uncut structure. Nodes of several subdomains are tied.

    Parameters
    ----------
    structure : Structure, Elements, or list of Elements
        Linear or with internal forces.
    labels : (elements,) array of int or str, or "steps"
        Which subdomain an element belongs to: whole numbers, such as the tags 3, 7, 11 of a mesh,
        of subdomains named "part 3", "part 7", "part 11"; or their names. Subdomains are in rising
        order of these. Elements are counted group by group; those of a Structure kind by kind. The
        elements of a subdomain need not be connected.
        "steps": explicit subdomains named "1 substep", "2 substeps", "4 substeps", ... by the
        critical steps of the elements, see Notes.
    parts : int, optional
        In place of labels, the number of subdomains: of nearly equal cost (entries of the element
        matrices, times substeps where dt is given) with small interfaces, by METIS where pymetis is
        installed, else by bisection of coordinates.
        "auto": the cheapest of a few cuts for this dt, by their plans: explicit as by "steps"; the
        same with the elements of the finest steps in one implicit subdomain, from two levels on;
        all implicit. `Cut.choices` has the plans. For linear structures.
    layer_of : (k,) array of int, str or (nodes, depth), optional
        In place of labels, nodes of a Structure or the name of a set of them: the elements at these
        nodes are the subdomain "layer", the others "bulk"; with a pair, `depth` elements deep. With
        `dt` the layer has at least as many substeps as the bulk: for contact at these nodes.
    dt : float, optional
        The macro step. With it, subdomains of explicit and conditionally stable schemes have
        1, 2, 4, ... substeps, so that these are no longer than 0.95 times the critical step of each
        of their elements at rest. Default: one substep.
    scheme : Scheme, or one for each subdomain: a sequence, or a dict by name or label
        Default: ``GeneralizedAlpha(0.5)``, with "steps" ``GeneralizedAlpha(0.5, explicit=True)``.
        With "auto" an explicit one and an implicit one, by default these two; with `layer_of` the
        explicit one for the layer, the implicit one for the bulk.
    force : (n,) array, callable, `SampledForce` or `BaseAcceleration`, or list of these, optional
        Load of the uncut structure, as for `Subdomain`. On a dof of several subdomains it is
        divided in proportion to their masses, those of a ground motion like the mass matrix. A
        callable is evaluated for each subdomain.
    u0, v0 : (n,) array, optional
        Initial values of the uncut structure, zero at fixed dofs.
    rayleigh : (float, float), optional
        C = c_m M + c_k K in all subdomains, as for `Subdomain`.
    damping_ratio : dict, optional
        In place of `rayleigh`, damping ratios at two periods, as for `Subdomain`.
    points : (elements, dim) array, optional
        Centres of the elements of `Elements`, for `parts` without METIS; a Structure has them.
    fixed : int, str, array of them, or (n,) array of bool, optional
        Dofs that do not move. They remain in u0, v0, loads and what `Cut.gather` returns.
    substeps : dict of int, optional
        By name or label, in place of the numbers that `dt` gives: for accuracy, of implicit
        subdomains too, such as those of `ErrorBudget.steps`. Not with "auto".

    Returns
    -------
    Cut
        The subdomains, their ties, and the way back.

    Raises
    ------
    TypeError, ValueError
        For labels of another number or kind, more than one of labels, parts and layer_of, a layer
        that leaves no element for the bulk, a subdomain without an element or without a free dof,
        a structure that does not know the matrices of its elements, dofs without an element, and
        what `Subdomain` refuses.
    FactorizationError
        For dofs without mass in an explicit subdomain.

    Notes
    -----
    The highest frequency of a subdomain, fixed and tied in any way, is not above the highest one of
    its single elements, for which an upper bound is computed that is at most 5 per cent above it
    for 24 dofs. With "steps" each element has the smallest of the numbers 1, 2, 4, ... of substeps
    that suffices for it, except that elements with a common node differ by a factor of 4 at most,
    and that up to 8 connected elements with finer neighbours only take over the number of these.

    Examples
    --------
    A rod, its right half with twice the speed of sound and two substeps. Here the cut costs more
    than it saves, as predicted from the sizes:

    >>> from pmalpha import structures
    >>> rod = structures.rod(4, 4.0, EA=[1.0, 1.0, 4.0, 4.0], rhoA=1.0, mass="lumped")
    >>> parts = cut(rod, ["soft", "soft", "stiff", "stiff"], dt=0.9,
    ...             scheme=CentralDifference(), fixed=0)
    >>> parts
    <Cut into 2 subdomains, 1 constraint
      soft   2 dofs  1 interface dof  CentralDifference()  1 substep
      stiff  3 dofs  1 interface dof  CentralDifference()  2 substeps
      macro step of 0.9: 134 entries read, 132 uncut at the finest step, gain 0.767, 0.00134 MB>
    """
    model = whole_of(structure, fixed, points)
    motion = checked_motion(u0, model.free, "u0"), checked_motion(v0, model.free, "v0")
    damping = checked_rayleigh(rayleigh, damping_ratio)
    step = None if dt is None else time_step(dt, "dt")
    _check_centres(model)
    values = Values(force, *motion, damping)
    if layer_of is not None:
        layer = by_layer(model, layer_of, labels, parts, step, scheme)
        return _divided(structure, model, with_substeps(layer, substeps), step, values)
    if isinstance(parts, str):
        if substeps is not None:
            raise TypeError('substeps must not be given with parts="auto"')
        return _cheapest(structure, model, automatic(model, labels, parts, step, scheme), values)
    choose = by_steps if isinstance(labels, str) else by_labels
    choice = with_substeps(choose(model, labels, parts, step, scheme), substeps)
    return _divided(structure, model, choice, step, values)


class Values(NamedTuple):
    """What of the uncut structure is divided besides its matrices, checked."""

    force: Any
    u0: np.ndarray
    v0: np.ndarray
    rayleigh: Any


def _cheapest(structure: Any, model: Whole, candidates: Candidates, values: Values) -> Cut:
    """The Cut with the least predicted cost, of those that are possible."""
    best, plans, failure = None, {}, None
    for name, choice in candidates.choices.items():
        try:
            made = _divided(structure, model, choice, candidates.dt, values)
            made = replace(made, _uncut=candidates.uncut)
        except FactorizationError as error:  # dofs without mass in an explicit subdomain
            failure = error
            continue
        plans[name] = made.plan()
        if best is None or plans[name].cost < best[1].cost:
            best = made, plans[name]
    if best is None:
        assert failure is not None
        raise failure
    return replace(best[0], choices=plans)


def _divided(structure: Any, model: Whole, choice: Choice, dt: float | None, values: Values) -> Cut:
    labels, members = choice.labels, choice.members
    portions = _portions(model, labels, members)
    masses = [np.maximum(diagonal(portion.M), 0.0) for portion in portions]
    division = Division(model.n, [portion.dofs for portion in portions], masses)
    for member, portion, mass in zip(members, portions, masses):
        if member.scheme.explicit:
            _require_mass(member, portion.dofs, mass)
    masses_of = [portion.M for portion in portions]
    names = getattr(structure, "dof_names", None)
    loads = division.divided(values.force, masses_of, model.mass, names)
    u0, v0 = (division.scatter(x) for x in (values.u0, values.v0))
    subdomains = []
    for i, member in enumerate(members):
        portion = portions[i]
        portions[i] = None  # frees its matrices, which a Subdomain copies
        subdomains.append(
            Subdomain(
                portion.M,
                portion.K,
                C=portion.C,
                scheme=member.scheme,
                substeps=member.substeps,
                force=loads[i],
                internal=portion.internal or None,
                rayleigh=values.rayleigh,
                u0=u0[i],
                v0=v0[i],
                name=member.name,
                dof_names=names_at(names, division.dofs[i], np.flatnonzero(~model.free)),
            )
        )
    labels.setflags(write=False)
    sides = {s: L for s, L in zip(subdomains, division.ties()) if L.nnz}
    ties = [Constraint(sides)] if sides else []
    return Cut(structure, labels, tuple(subdomains), ties, dt, {}, None, division)


def _portions(model: Whole, labels: np.ndarray, members: Sequence[CutMember]) -> list[Any]:
    """The matrices of each subdomain; contact belongs to the first one that has the node."""
    left = np.ones(model.link_count, dtype=bool)
    groups = model.by_group(labels)
    portions = []
    for i, member in enumerate(members):
        portion = model.portion(labels == i, left)
        if not portion.dofs.size:
            raise ValueError(f"labels must leave {member.name!r} a free dof, got only fixed ones")
        for links, numbers in zip(model.links, groups):
            nodes = links[numbers == i]
            left[nodes[nodes >= 0]] = False
        portions.append(portion)
    return portions


def _require_mass(member: CutMember, dofs: np.ndarray, mass: np.ndarray) -> None:
    massless = dofs[mass == 0.0]
    if massless.size:
        raise FactorizationError(
            f"{member.name!r} is explicit and none of its elements has mass at "
            f"{counted(massless.size, 'dof')} of the uncut structure, {listing(massless)}; give it "
            "an implicit scheme, or elements with mass there",
            subdomain=member.name,
            dof=int(massless[0]),
        )


def _check_centres(model: Whole) -> None:
    """ValueError unless the centres are (elements, dim), finite."""
    if model.centroids is None:
        return
    model.centroids = real_array(model.centroids, "points", 2)
    if len(model.centroids) != model.count:
        raise ValueError(
            f"points must have a row for each of {counted(model.count, 'element')}, got "
            f"{len(model.centroids)}"
        )
