"""Structures on meshes of files, with materials by the names in them; meshes of some elements."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from .._checks import check_word, listing, plain_array, real_array
from ..meshes.mesh import KINDS, SHAPES, FileMesh, are_sides, dimension_of_kind
from ..problem.dofs import as_nodes
from ..readers.mesh_files import read_mesh
from ..readers.text import Unread
from .checked import is_lumped, node_numbers, positive
from .continuum import moduli_of
from .elasticity import RULES, Moduli, Rule, elastic_matrices, lumped_shares
from .element_force import Made, Selected
from .frames import ROTARY, beam_matrices, require_length
from .pattern import Pattern, lumped_mass
from .structure import COINCIDENT, Structure

__all__ = ["from_mesh", "submesh"]

# Numbers of a material, by what it makes of elements; a thickness t besides where surfaces are
LAWS = {"elastic": ("E", "nu", "rho"), "bar": ("EA", "rhoA"), "beam": ("EA", "EI", "rhoA")}


def bar_matrices(
    kind: str,
    lines: np.ndarray,
    corners: np.ndarray,
    EA: np.ndarray,
    rhoA: np.ndarray,
    nodes: int,
    lumped: bool,
) -> tuple[Any, sp.csr_array]:
    """M, or its diagonal if lumped, and K; corners (E, a, d) are the coordinates of the nodes."""
    shape, (stiff, heavy) = SHAPES[kind], RULES[kind]
    d = corners.shape[2]
    pattern = Pattern.of(lines, nodes)
    _, weights = _along(kind, corners, heavy)
    weights = weights * rhoA[:, None]
    N = shape.values(heavy.points)
    if lumped:
        M = np.repeat(lumped_mass(lines, lumped_shares(kind, N, weights), nodes), d)
    else:
        scalar = pattern.matrix(np.einsum("eq,qa,qb->eab", weights, N, N))
        M = sp.csr_array(sp.kron(scalar, sp.eye_array(d), format="csr"))
    B, lengths = _along(kind, corners, stiff)
    return M, pattern.matrix(np.einsum("e,eq,eqai,eqbj->eaibj", EA, lengths, B, B, optimize=True))


def _along(kind: str, corners: np.ndarray, rule: Rule) -> tuple[np.ndarray, np.ndarray]:
    """Strains (E, q, a, d) of unit displacements of the nodes, and lengths (E, q) of the points.

    With x' = dx / dxi the strain is x' . u' / |x'|^2.
    """
    slopes = SHAPES[kind].slopes(rule.points)[:, :, 0]
    tangent = np.einsum("qa,eai->eqi", slopes, corners)
    square = np.sum(tangent**2, axis=2)
    B = slopes[None, :, :, None] * (tangent / square[:, :, None])[:, :, None, :]
    return B, rule.weights * np.sqrt(square)


def embedded(A: Any, old: int, new: int) -> Any:
    """A matrix, or its diagonal, on nodes with more dofs, the first `old` of which it has."""
    if old == new:
        return A
    nodes = A.shape[0] // old
    dofs = (new * np.arange(nodes)[:, None] + np.arange(old)).ravel()
    if A.ndim == 1:
        diagonal = np.zeros(new * nodes)
        diagonal[dofs] = A
        return diagonal
    A = sp.csr_array(A)
    counts = np.zeros(new * nodes, dtype=A.indptr.dtype)
    counts[dofs] = np.diff(A.indptr)
    start = np.concatenate([[0], np.cumsum(counts)])
    return sp.csr_array((A.data, dofs[A.indices], start), shape=(new * nodes, new * nodes))


def from_mesh(
    mesh: str | os.PathLike[str] | Any,
    material: Mapping[str, Any],
    *,
    plane: str = "stress",
    mass: str = "consistent",
    names: str | None = None,
    ignore: Iterable[str] = (),
) -> Structure:
    """A linear structure on a mesh of gmsh, Abaqus, VTK or another program that meshlane reads.

    Plates of the surfaces of a mesh in the plane z = constant (which then has points (x, y)),
    solids of the cells of a mesh in space, bars and plane beams of its lines; see `plate_on`,
    `solid_on` and `beam_frame` for the elements. Groups and sets of the file are known by their
    names. Cells of lower dimension without a material, such as the lines on the edge of a plate,
    only make sets of nodes; those that are no side or edge of another cell are warned of. Points
    that no element uses are left out; the others keep their order.

    Parameters
    ----------
    mesh : path, or a mesh of meshlane, meshio or scikit-fem
        Files need one of the two (``pip install pmalpha[mesh]``; meshlane is used where both are),
        except those of Abaqus and Nastran: gmsh, VTK (``.vtk``, ``.vtu``), MED, CGNS, Medit,
        Netgen, STL, Ansys (``.msh``) and others. For formats whose readers may read other files, or
        not end, such as XDMF, give ``meshlane.read(path)``. Of ``.inp`` files of Abaqus and
        CalculiX and of bulk data of Nastran (``.bdf``, ``.dat``, ``.fem``, ``.nas``) nodes,
        elements, sets and groups by property are read, of element types the shape; for what else is
        in such a file see Warns. A model of pyNastran is taken too. Subdomains of a mesh of
        scikit-fem are groups, its boundaries sets of nodes.
    material : dict
        ``{"E": ..., "nu": ..., "rho": ...}`` of plates and solids, for plates also "t", the
        thickness, default 1; ``{"EA": ..., "rhoA": ...}`` of bars, ``{"EA": ..., "EI": ...,
        "rhoA": ...}`` of plane beams. Numbers, or arrays with the elements in the order of the
        file. Or a dict of such dicts by the name of a group; None leaves the elements of a group
        out. Every element of the highest dimension in the mesh must have a material or None.
    plane : {"stress", "strain"}
        Of plates.
    mass : {"consistent", "lumped"}
    names : str, optional
        The name of cell data of whole numbers, such as "material", whose values are the names of
        groups ("1", "2"): for formats without names, such as VTK.
    ignore : sequence of str, optional
        Names that the file is read without, in silence: of keywords, cards or types of elements in
        it ("TIE", "CONM2", "S4R"), or of families of them: "AXISYMMETRIC", "BEAM", "CONNECTION",
        "DAMPER", "GEOMETRY", "MASS", "MATRIX", "PLANE", "SHELL", "SPRING", "UNKNOWN".

    Returns
    -------
    Structure
        With `groups` and `sets`. Elements of the highest dimension come first, each kind in the
        order of the file.

    Raises
    ------
    ImportError
        When meshlane and meshio are missing.
    FileNotFoundError
        When there is no such file.
    TypeError, ValueError
        For entries of a file that move, make or remove nodes or elements in a way that is not read,
        such as ``*NCOPY`` or offsets of beams, cells of different kinds with the same nodes,
        elements that are unknown, flat or inverted (by their numbers), without a material or with
        two, surfaces that are not in a plane z = constant, names that the mesh does not have,
        materials with other numbers, or not positive ones.

    Warns
    -----
    UserWarning
        For what is left out or taken as something else, with its number: springs, masses, ties and
        all other entries of the file that are not read, nodes beyond those of an element, shells
        beside solids, shells of a plane mesh, which have no bending, clockwise surfaces, which are
        turned, elements of a file that have the nodes of another one, and what a library prints on
        the file. Cells without a material that are no side or edge of another one, such as bars
        between solids; ``ignore=("line",)`` silences it.

    Examples
    --------
    A square of two triangles, supported at a named line:

    >>> import meshlane
    >>> from pmalpha import structures
    >>> points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    >>> cells = [("triangle", [[0, 1, 2], [0, 2, 3]]), ("line", [[3, 0]])]
    >>> mesh = meshlane.Mesh(points, cells, cell_sets={"wall": [[], [0]], "upper": [[1], []]})
    >>> plate = structures.from_mesh(mesh, {"E": 30e9, "nu": 0.2, "rho": 2500.0, "t": 0.2})
    >>> plate, plate.dofs("wall").tolist(), plate.groups["upper"].tolist()
    (<Structure 4 points, 2 triangle, 8 dofs>, [0, 1, 6, 7], [1])
    """
    check_word(plane, "plane", ("stress", "strain"))
    is_lumped(mass)
    unread = Unread(
        os.path.basename(mesh) if isinstance(mesh, (str, os.PathLike)) else "mesh", ignore
    )
    read = read_mesh(mesh, names, unread)
    top, d = _dimensions(read)
    if d == 2:
        read = _counter_clockwise(read, unread)
    choice = _chosen(read, material, top, d)
    _say_of_types(read, choice, top, plane, unread)
    _say_of_others(read, choice, top, unread)
    unread.warn()
    order = sorted(choice, key=lambda number: -KINDS[read.blocks[number].kind].dimension)
    return _structure(read, {number: choice[number] for number in order}, d, plane, mass)


class MaterialElements(NamedTuple):
    """Elements of a block with a material: their numbers, and its law and values (e,) of each."""

    numbers: np.ndarray
    law: np.ndarray
    values: dict[str, np.ndarray]


def _dimensions(read: FileMesh) -> tuple[int, int]:
    """The highest dimension of cells, and that of the structure."""
    unknown = [b.kind for b in read.blocks if b.kind not in KINDS and b.kind != "vertex"]
    known = [b for b in read.blocks if b.kind in KINDS and len(b.nodes)]
    if unknown or not known:
        raise ValueError(
            f"mesh must have elements of {', '.join(SHAPES)}, got "
            f"{listing(dict.fromkeys(unknown)) or 'none'}"
            + ("; gmsh writes others with Mesh.SecondOrderIncomplete=1" * _is_complete(unknown))
        )
    top = max(KINDS[block.kind].dimension for block in known)
    if read.points.shape[1] < 3:
        return top, 2
    height = np.concatenate([read.points[b.nodes.ravel(), 2] for b in known])
    flat = np.ptp(height) <= COINCIDENT * np.abs(read.points).max()
    return top, 2 if flat and top < 3 else 3


def _is_complete(kinds: Iterable[str]) -> bool:
    """Whether there is one with nodes in its faces or its middle."""
    return not {"hexahedron27", "wedge18", "pyramid14", "hexahedron24"}.isdisjoint(kinds)


def _counter_clockwise(read: FileMesh, unread: Unread) -> FileMesh:
    """With surfaces in a plane as seen from above, where the file has them from below."""
    blocks = []
    for block in read.blocks:
        kind = KINDS.get(block.kind)
        if kind is None or kind.dimension != 2 or not len(block.nodes):
            blocks.append(block)
            continue
        x, y = np.moveaxis(read.points[block.nodes[:, : len(kind.edges)], :2], 2, 0)
        area = np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1)
        turned = area < 0.0
        count = int(np.count_nonzero(turned))
        what = "surfaces {} are clockwise, and turned"
        unread.leave_out(what, block.kind, "GEOMETRY", count)
        nodes = block.nodes.copy()
        nodes[turned] = nodes[turned][:, _reversed(block.kind)]
        blocks.append(block._replace(nodes=nodes))
    return read._replace(blocks=blocks)


def _reversed(kind: str) -> list[int]:
    """The nodes of a surface the other way around, from the same first one."""
    corners = len(KINDS[kind].edges)
    order = [0, *range(corners - 1, 0, -1)]
    if KINDS[kind].nodes > corners:
        order += range(2 * corners - 1, corners - 1, -1)
    return order + list(range(2 * corners, KINDS[kind].nodes))


# What is said of elements that are used, by their family
USED = {
    "SHELL": "elements of type {} are taken as plane, without bending",
    "AXISYMMETRIC": "elements of type {} are taken as plane",
    "PLANE STRAIN": 'elements of type {} are of plane strain, but plane is "stress"',
    "PLANE STRESS": 'elements of type {} are of plane stress, but plane is "strain"',
}


def _say_of_types(
    read: FileMesh, choice: dict[int, MaterialElements], top: int, plane: str, unread: Unread
) -> None:
    """Count elements of a file that are no such ones in the structure."""
    for i, (block, element) in enumerate(zip(read.blocks, read.types)):
        used = len(choice[i].numbers) if i in choice else 0
        if used and element.family in USED and element.family != f"PLANE {plane.upper()}":
            family = "PLANE" if element.family.startswith("PLANE") else element.family
            unread.leave_out(USED[element.family], element.name, family, used)
        if element.name and dimension_of_kind(block.kind) < top:
            what = "elements of type {} are left out"
            unread.leave_out(what, element.name, element.family, len(block.nodes) - used)


def _say_of_others(
    read: FileMesh, choice: dict[int, MaterialElements], top: int, unread: Unread
) -> None:
    """Count cells without a material that are no side or edge of another one: bars between solids,
    say. Where the file has types of elements they have been counted."""
    for i, (block, element) in enumerate(zip(read.blocks, read.types)):
        if element.name or block.kind not in KINDS or dimension_of_kind(block.kind) == top:
            continue
        left = np.ones(len(block.nodes), dtype=bool)
        left[choice[i].numbers if i in choice else []] = False
        if left.any():
            left &= ~are_sides(read.blocks, i)
        what = "elements {} that are no side or edge of another one have no material: left out"
        family = "BEAM" if dimension_of_kind(block.kind) == 1 else "SHELL"
        unread.leave_out(what, block.kind, family, int(np.count_nonzero(left)))


def _chosen(read: FileMesh, material: Any, top: int, d: int) -> dict[int, MaterialElements]:
    """By the number of a block the elements of it that have a material."""
    if not isinstance(material, Mapping) or not material:
        raise TypeError(f"material must be a dict, got {material!r}")
    by_group = all(value is None or isinstance(value, Mapping) for value in material.values())
    counts = [len(block.nodes) for block in read.blocks]
    owner = [np.full(count, "", dtype=object) for count in counts]
    law = [np.full(count, "", dtype=object) for count in counts]
    values: list[dict[str, np.ndarray]] = [{} for _ in counts]
    for name, properties in material.items() if by_group else [("", material)]:
        label = f"material[{name!r}]" if by_group else "material"
        members = _members(read, name) if by_group else dict(enumerate(map(np.arange, counts)))
        kind = _law(properties, label)
        dimension = top if not by_group or kind is None else 1 if kind != "elastic" else d
        cells = [
            members[i]
            if i in members and dimension_of_kind(block.kind) == dimension
            else np.empty(0, dtype=np.int64)
            for i, block in enumerate(read.blocks)
        ]
        _require_fitting(read, kind, cells, label, dimension, d)
        split = np.cumsum([len(x) for x in cells])
        arrays = {} if properties is None else _values(properties, label, int(split[-1]), d)
        for i, numbers in enumerate(cells):
            _require_single(owner[i][numbers], numbers, read.blocks[i].kind, name)
            owner[i][numbers], law[i][numbers] = label, kind or "none"
            for key, value in arrays.items():
                column = values[i].setdefault(key, np.full(counts[i], np.nan))
                column[numbers] = value[split[i] - len(numbers) : split[i]]
    return _parts(read, law, values, top)


def _members(read: FileMesh, name: str) -> dict[int, np.ndarray]:
    if name not in read.groups:
        known = listing([repr(x) for x in read.groups]) or "none"
        raise ValueError(f"material must have names of groups ({known}), got {name!r}")
    return read.groups[name]


def _law(properties: Any, label: str) -> str | None:
    """What the material is of, by the names of its numbers."""
    if properties is None:
        return None
    for law, keys in LAWS.items():
        if set(properties) in ({*keys}, {*keys, "t"} if law == "elastic" else {*keys}):
            return law
    raise ValueError(
        f"{label} must have E, nu, rho (and t) of plates and solids, EA, rhoA of bars or "
        f"EA, EI, rhoA of beams, got {', '.join(map(str, properties))}"
    )


def _require_fitting(
    read: FileMesh, law: str | None, cells: list[np.ndarray], label: str, dimension: int, d: int
) -> None:
    kinds = {block.kind for block, numbers in zip(read.blocks, cells) if numbers.size}
    what = {"elastic": "plates or solids", "bar": "bars", "beam": "beams", None: "elements"}[law]
    if not kinds:
        raise ValueError(
            f"{label} must be of {what}, got a group without cells of dimension {dimension}"
        )
    if law == "elastic" and dimension != d:
        raise ValueError(
            f"{label} must be of plates in a plane z = constant or of solids, got "
            f"{', '.join(sorted(kinds))} in {'space' if d == 3 else 'the plane'}; there are no "
            "shells"
        )
    if law in ("bar", "beam") and dimension != 1:
        raise ValueError(f"{label} must have E, nu and rho for {', '.join(sorted(kinds))}")
    if law == "beam" and (d != 2 or kinds != {"line"}):
        raise ValueError(
            f"{label} must be of bars where lines are in space or have three nodes, got EI"
        )
    unknown = kinds - set(SHAPES)
    if law is not None and unknown:
        raise ValueError(f"mesh must have elements of {', '.join(SHAPES)}, got {listing(unknown)}")


def _values(properties: Mapping[str, Any], label: str, count: int, d: int) -> dict[str, np.ndarray]:
    """(count,) arrays; those of nu are checked later, with the plane."""
    if d == 3 and "t" in properties:
        raise ValueError(f"{label} must not have a thickness t of solids")
    values = {}
    for key, value in properties.items():
        if np.ndim(plain_array(value, key)) and np.shape(value) != (count,):
            raise ValueError(
                f"{label}[{key!r}] must be a number or of shape ({count},), got {np.shape(value)}"
            )
        if key != "nu":
            positive(value, f"{label}[{key!r}]", (count,))
        values[key] = np.broadcast_to(np.asarray(value, dtype=float), count)
    return values


def _require_single(owners: np.ndarray, numbers: np.ndarray, kind: str, name: str) -> None:
    twice = np.flatnonzero(owners != "")
    if twice.size:
        raise ValueError(
            f"material must have every element once, got {kind!r} {listing(numbers[twice])} both "
            f"in {owners[twice[0]]} and in material[{name!r}]"
        )


def _parts(
    read: FileMesh, law: list[np.ndarray], values: list[dict[str, np.ndarray]], top: int
) -> dict[int, MaterialElements]:
    parts = {}
    for i, block in enumerate(read.blocks):
        without = np.flatnonzero(law[i] == "")
        if dimension_of_kind(block.kind) == top and without.size:
            groups = [
                repr(name)
                for name, members in read.groups.items()
                if i in members and np.isin(without, members[i]).any()
            ]
            raise ValueError(
                f"material must cover every element, got none for {block.kind!r} "
                f"{listing(without)}, in groups {listing(groups) or 'without a name'}; None leaves "
                "a group out"
            )
        numbers = np.flatnonzero((law[i] != "") & (law[i] != "none"))
        if numbers.size:
            columns = {key: value[numbers] for key, value in values[i].items()}
            parts[i] = MaterialElements(numbers, law[i][numbers], columns)
    if not parts:
        raise ValueError("material must be of at least one element")
    return parts


# ---- the structure --------------------------------------------------------------------------


def _structure(
    read: FileMesh, parts: dict[int, MaterialElements], d: int, plane: str, mass: str
) -> Structure:
    blocks = {i: read.blocks[i].nodes[part.numbers] for i, part in parts.items()}
    kinds = list(dict.fromkeys(read.blocks[i].kind for i in parts))
    nodes = np.unique(np.concatenate([x.ravel() for x in blocks.values()]))
    number = np.full(len(read.points), -1)
    number[nodes] = np.arange(nodes.size)
    points = np.ascontiguousarray(read.points[nodes, :d])

    def joined(of: Any, kind: str) -> np.ndarray:
        return np.concatenate([of(i) for i in parts if read.blocks[i].kind == kind])

    elements = {kind: joined(lambda i: number[blocks[i]], kind).astype(np.int64) for kind in kinds}
    moduli, lines = {}, {}
    for kind in kinds:
        properties = {
            key: joined(lambda i: _column(parts[i], key), kind)  # noqa: B023
            for key in ("E", "nu", "rho", "t", "EA", "EI", "rhoA")
        }
        if KINDS[kind].dimension == d:
            moduli[kind] = moduli_of(
                d,
                properties["E"],
                properties["nu"],
                properties["rho"],
                properties["t"],
                plane,
                properties["E"].shape,
            )
        else:
            require_length(points[elements[kind]], "elements", f" of {kind!r}")
            lines[kind] = properties["EA"], properties["EI"], properties["rhoA"]
    beams = any(np.isfinite(EI).any() for _, EI, _ in lines.values())
    components = (*("ux", "uy", "uz")[:d], *(["rz"] if beams else []))
    recipe = partial(_assembled, points, elements, moduli, lines, len(components), is_lumped(mass))
    structure = Structure._of(recipe, points, elements, components, moduli)
    groups, sets = _named(read, parts, kinds, number)
    sets = {name: as_nodes(nodes, len(components)) for name, nodes in sets.items()}
    return replace(structure, groups=groups, sets=sets)


def _column(part: MaterialElements, key: str) -> np.ndarray:
    """Values of the elements; of what the material does not have, NaN, and 1 for t."""
    missing = 1.0 if key == "t" else np.nan
    values = part.values.get(key, np.full(len(part.numbers), missing))
    return np.where(np.isnan(values), missing, values)


def _assembled(
    points: np.ndarray,
    mesh: Mapping[str, np.ndarray],
    moduli: Mapping[str, Moduli],
    lines: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]],
    dofs: int,
    lumped: bool,
    selected: Selected,
) -> Made:
    d, nodes = points.shape[1], selected.nodes
    solid = {kind: elements for kind, elements in selected.elements.items() if kind in moduli}
    M: Any = 0
    K: Any = 0
    if solid:
        of_solid = selected._replace(elements=solid)
        M, K, _ = elastic_matrices(points, mesh, moduli, lumped, None, of_solid)
        M, K = embedded(M, d, dofs), embedded(K, d, dofs)
    for kind, (EA, EI, rhoA) in lines.items():
        if kind not in selected.elements:
            continue
        elements = selected.elements[kind]
        values = np.column_stack(selected.rows(kind, (EA, EI, rhoA)))
        corners = points[mesh[kind][selected.chosen[kind]]]
        bar = np.isnan(values[:, 1])
        if bar.any():
            EA, _, rhoA = values[bar].T
            matrices = bar_matrices(kind, elements[bar], corners[bar], EA, rhoA, nodes, lumped)
            M, K = (A + embedded(B, d, dofs) for A, B in zip((M, K), matrices))
        if not bar.all():
            along = corners[~bar, 1] - corners[~bar, 0]
            EA, EI, rhoA = values[~bar].T
            matrices = beam_matrices(elements[~bar], along, EA, EI, rhoA, lumped, ROTARY, nodes)
            M, K = (A + B for A, B in zip((M, K), matrices))
    return M, K, ()


def _named(
    read: FileMesh, parts: dict[int, MaterialElements], kinds: list[str], number: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Groups of elements and sets of nodes, by name."""
    place, start = {}, 0
    for kind in kinds:
        for i, part in parts.items():
            if read.blocks[i].kind == kind:
                place[i] = np.full(len(read.blocks[i].nodes), -1)
                place[i][part.numbers] = start + np.arange(len(part.numbers))
                start += len(part.numbers)
    groups, sets = {}, {}
    for name, members in read.groups.items():
        arrays = [place[i][numbers] for i, numbers in members.items() if i in place]
        elements = np.concatenate([np.empty(0, dtype=np.int64), *arrays])
        if (elements >= 0).any():
            groups[name] = np.sort(elements[elements >= 0])
        nodes = [read.blocks[i].nodes[x].ravel() for i, x in members.items()]
        sets[name] = np.concatenate([np.empty(0, dtype=np.int64), *nodes])
    sets.update(read.points_of)
    sets = {name: np.unique(number[nodes]) for name, nodes in sets.items()}
    sets = {name: nodes[nodes >= 0] for name, nodes in sets.items()}
    return groups, {name: nodes for name, nodes in sets.items() if nodes.size}


def submesh(points: ArrayLike, elements: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The mesh of some elements of another mesh, without unused points.

    Parameters
    ----------
    points : (N, dim) array_like
        Coordinates of all nodes.
    elements : (E, corners) array_like of int
        The elements to keep.

    Returns
    -------
    points : (k, dim) ndarray
        Coordinates of the nodes that the elements have.
    elements : (E, corners) ndarray of int
        In the numbers of the remaining points.
    nodes : (k,) ndarray of int
        Numbers of these points in the given mesh, in rising order.

    Raises
    ------
    TypeError, ValueError
        For wrong shapes and numbers of points that do not exist.

    Examples
    --------
    >>> from pmalpha import structures
    >>> points, lines, nodes = structures.submesh([[0.0], [1.0], [2.0], [3.0]], [[3, 2]])
    >>> points.tolist(), lines.tolist(), nodes.tolist()
    ([[2.0], [3.0]], [[1, 0]], [2, 3])
    """
    coordinates = real_array(points, "points", 2)
    corners = node_numbers(elements, "elements", len(coordinates), None)
    nodes, renumbered = np.unique(corners, return_inverse=True)
    return coordinates[nodes], renumbered.reshape(corners.shape), nodes
