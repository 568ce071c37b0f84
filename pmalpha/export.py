"""Time series on a mesh as files for ParaView. Requires only NumPy."""

from __future__ import annotations

import base64
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TypeAlias
from xml.etree import ElementTree as xml

import numpy as np

from ._checks import listing, real_array, whole_number
from .errors import warn
from .files import checked_path, package_version, replacing, uninterrupted
from .meshes.mesh import KINDS, Mesh, checked_mesh, nodal_values, nodal_vectors, padded
from .results.array_file import Output
from .results.history import History, SubdomainHistory
from .results.times import on_mesh

__all__ = ["write_series"]


def __dir__() -> list[str]:
    return sorted(__all__)


ORDER = {"little": "Little", "big": "Big"}[sys.byteorder]
# Maximum number of times in a .pvd file by default: each is a file of its own
MOST_FILES = 1000


# Writes an array and returns the element of XDMF that says where it is.
Item: TypeAlias = Callable[[np.ndarray], xml.Element]


class Series(NamedTuple):
    """The data of the files: fields by name, (k, N, dim) vectors or (k, N) numbers.

    Of the k times, those with the numbers `steps` are written. `cells` are numbers by element,
    the same at all times.
    """

    mesh: Mesh
    times: np.ndarray
    fields: Mapping[str, np.ndarray]
    steps: np.ndarray
    cells: Mapping[str, np.ndarray]

    def at(self, step: int) -> Iterator[tuple[str, np.ndarray]]:
        """Names and values of the fields, vectors with three components."""
        for name, values in self.fields.items():
            value = np.asarray(values[step], dtype=np.float64)
            yield name, np.ascontiguousarray(padded(value, 3) if value.ndim == 2 else value)


def write_series(
    path: str | os.PathLike[str],
    points: Any,
    elements: Any,
    times: Any = None,
    u: Any = None,
    v: Any = None,
    a: Any = None,
    *,
    data: Mapping[str, Any] | None = None,
    cells: Mapping[str, Any] | None = None,
    most_times: int | None = None,
) -> None:
    """Write the motion of a mesh for ParaView.

    ``write_series(path, points, elements, times, u, v, a)``, or ``write_series(path, structure,
    motion)`` with a `Structure`, or a `Cut` and what `Cut.gather` returns or a History of its
    subdomains.

    The suffix of the path chooses the format. ``.xdmf``: an XML description, and the numbers in an
    HDF5 file next to it, ``run.xdmf.h5`` for ``run.xdmf``, which meshio's TimeSeriesReader reads
    too; without h5py in a binary file, ``run.bin``. ``.pvd``: an XML list of the times, and a
    folder of the same name with a ``.vtu`` file for each time. In ParaView, the filter "Warp By
    Vector" shows the displacements. Numbers are written time by time, in double precision, without
    a copy of all.

    Parameters
    ----------
    path : str or path
        With suffix .xdmf or .pvd. Existing files are replaced.
    points : (N, dim) array_like, or Structure or Cut
        Coordinates of the nodes; dim is 1, 2 or 3.
    elements : array_like of int, or dict; SubdomainHistory
        Nodes of elements by the name of their kind, in the order of nodes of meshio and VTK:
        "line", "triangle", "quad", "tetra", "pyramid", "wedge", "hexahedron", and of second order
        "line3", "triangle6", "quad8", "quad9", "tetra10", "pyramid13", "wedge15", "hexahedron20".
        An array is taken as lines (m, 2), triangles (m, 3), quadrilaterals (m, 4) or hexahedra
        (m, 8). After a Structure or Cut its motion, with all dofs.
    times : (k,) array_like
        In rising order.
    u, v, a : (k, N * d) or (k, N, d) array_like
        Displacements, velocities and accelerations, d >= dim dofs per node; dofs beyond dim, such
        as rotations, are dropped. For example ``history["rig"].u``; ``reduction.expand`` adds fixed
        dofs. v and a are optional.
    data : dict, optional
        Further fields at the nodes: (k, N) numbers by name.
    cells : dict, optional
        Numbers of the elements, the same at all times, such as the subdomain of each: (elements,)
        by name, kind by kind in the order of `elements`.
    most_times : int, optional
        Maximum number of times in the files, at least 2. Of more times, the first, each n-th after
        it and the last are written, with the smallest n that suffices. Default: all for .xdmf,
        1000 for .pvd.

    Raises
    ------
    TypeError, ValueError
        For another suffix, and inconsistent shapes.
    OSError
        When a file cannot be written.

    Warns
    -----
    UserWarning
        If a .pvd file would have more than 1000 times, and `most_times` is not given.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from pmalpha.export import write_series
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "bar.xdmf")
    ...     write_series(path, [[0.0], [1.0]], [[0, 1]], [0.0, 0.1], [[0.0, 0.0], [0.0, 0.2]])
    ...     '"displacement"' in path.read_text()
    True
    """
    if hasattr(points, "gather"):
        points.export(path, elements, data=data, cells=cells or {}, most_times=most_times)
        return
    if hasattr(points, "elements"):
        if not isinstance(elements, SubdomainHistory) or times is not None:
            raise TypeError(f"a Structure must come with a motion alone, got {elements!r}")
        motion = elements
        times, (u, v, a) = motion.t, (on_mesh(motion, kind) for kind in "uva")
        points, elements = points.points, points.elements
    if isinstance(points, (History, SubdomainHistory)):
        raise TypeError(f"the mesh must come before its motion, got {points!r}")
    path = checked_path(path)
    writers = {".xdmf": _write_xdmf, ".pvd": _write_pvd}
    if path.suffix.lower() not in writers:
        raise ValueError(f"path must end in .xdmf or .pvd, got {str(path)!r}")
    times = real_array(times, "times")
    if times.size == 0:
        raise ValueError("times must not be empty")
    not_rising = np.flatnonzero(np.diff(times) <= 0.0) + 1
    if not_rising.size:
        raise ValueError(f"times must rise, which they do not at entries {listing(not_rising)}")
    if most_times is not None:
        most_times = whole_number(most_times, "most_times", low=2)
    mesh = checked_mesh(points, elements)
    fields = _fields(mesh, times.size, u, v, a, {} if data is None else data)
    if most_times is None and path.suffix.lower() == ".pvd":
        most_times = MOST_FILES
        _warn_if_thinned(times.size)
    numbers = _cell_numbers(mesh, {} if cells is None else cells)
    series = Series(mesh, times, fields, _written(times.size, most_times), numbers)
    writers[path.suffix.lower()](path, series)


def _interval(count: int, most: int) -> int:
    """The smallest n such that the first, each n-th and the last of `count` are at most `most`."""
    return max(1, -(-(count - 1) // (most - 1)))


def _written(count: int, most: int | None) -> np.ndarray:
    """Numbers of the times that are written."""
    if most is None:
        return np.arange(count)
    return np.unique(np.append(np.arange(0, count, _interval(count, most)), count - 1))


def _warn_if_thinned(count: int) -> None:
    if count > MOST_FILES:
        n, times = _interval(count, MOST_FILES), _written(count, MOST_FILES).size
        warn(
            f"{times} of {count} times are written, one in {n} and the last, since a .pvd file has "
            f"a .vtu file for each; most_times={count} writes all, .xdmf has all in two files",
            UserWarning,
        )


def _fields(
    mesh: Mesh, k: int, u: Any, v: Any, a: Any, data: Mapping[str, Any]
) -> dict[str, np.ndarray]:
    fields = {"displacement": nodal_vectors(u, mesh, "u", times=k)}
    if v is not None:
        fields["velocity"] = nodal_vectors(v, mesh, "v", times=k)
    if a is not None:
        fields["acceleration"] = nodal_vectors(a, mesh, "a", times=k)
    for name, values in _items(data, "data"):
        if not isinstance(name, str) or name in fields:
            raise ValueError(
                f"data must have strings as names, other than {', '.join(fields)}, got {name!r}"
            )
        fields[name] = nodal_values(values, mesh, f"data[{name!r}]", times=k)
    return fields


def _items(mapping: Any, argument: str) -> Iterable[tuple[Any, Any]]:
    if not isinstance(mapping, Mapping):
        raise TypeError(f"{argument} must be a dict, got {mapping!r}")
    return mapping.items()


def _cell_numbers(mesh: Mesh, cells: Mapping[str, Any]) -> dict[str, np.ndarray]:
    count, numbers = sum(len(block.nodes) for block in mesh.blocks), {}
    for name, values in _items(cells, "cells"):
        if not isinstance(name, str):
            raise ValueError(f"cells must have strings as names, got {name!r}")
        numbers[name] = real_array(values, f"cells[{name!r}]")
        if numbers[name].size != count:
            raise ValueError(
                f"cells[{name!r}] must have shape ({count},), got {numbers[name].shape}"
            )
    return numbers


# ---- XDMF -----------------------------------------------------------------------------------


def _write_xdmf(path: Path, series: Series) -> None:
    root = xml.Element("Xdmf", Version="3.0")
    domain = xml.SubElement(root, "Domain")
    steps = xml.SubElement(
        domain, "Grid", Name="steps", GridType="Collection", CollectionType="Temporal"
    )
    with _numbers_beside(path) as item:
        topology, geometry = _xdmf_mesh(item, series.mesh)
        fixed = [_attribute(item, name, values, "Cell") for name, values in series.cells.items()]
        for step in series.steps:
            grid = xml.SubElement(steps, "Grid", Name="mesh", GridType="Uniform")
            xml.SubElement(grid, "Time", Value=repr(float(series.times[step])))
            grid.extend([topology, geometry, *fixed])
            for name, values in series.at(step):
                grid.append(_attribute(item, name, values, "Node"))
    _write_xml(path, root)


def _attribute(item: Item, name: str, values: np.ndarray, center: str) -> xml.Element:
    kind = "Vector" if values.ndim == 2 else "Scalar"
    field = xml.Element("Attribute", Name=name, AttributeType=kind, Center=center)
    field.append(item(values))
    return field


def _xdmf_mesh(item: Item, mesh: Mesh) -> tuple[xml.Element, xml.Element]:
    count = str(sum(len(block.nodes) for block in mesh.blocks))
    if len(mesh.blocks) == 1:
        (block,) = mesh.blocks
        kind = KINDS[block.kind]
        topology = xml.Element(
            "Topology",
            TopologyType=kind.xdmf[0],
            NumberOfElements=count,
            NodesPerElement=str(kind.nodes),
        )
        topology.append(item(block.nodes))
    else:
        topology = xml.Element("Topology", TopologyType="Mixed", NumberOfElements=count)
        topology.append(item(_mixed(mesh)))
    geometry = xml.Element("Geometry", GeometryType="XYZ")
    geometry.append(item(np.ascontiguousarray(padded(mesh.points, 3))))
    return topology, geometry


def _mixed(mesh: Mesh) -> np.ndarray:
    """Elements of several kinds: XDMF number of the kind, number of nodes (lines only), nodes."""
    rows = []
    for kind, nodes in mesh.blocks:
        before = [KINDS[kind].xdmf[1]] + [2] * (kind == "line")
        rows.append(np.insert(nodes, [0] * len(before), before, axis=1).ravel())
    return np.concatenate(rows)


@contextmanager
def _numbers_beside(path: Path) -> Iterator[Item]:
    """A function that writes an array beside the file and returns the element with its place.

    In HDF5, which all readers of XDMF find from any folder, or without h5py as plain numbers, which
    ParaView reads.
    """
    try:
        import h5py
    except ImportError:
        with replacing(path.with_suffix(".bin")) as file:
            yield partial(_binary_item, file, path.with_suffix(".bin").name)
        return
    beside = path.with_name(f"{path.name}.h5")
    with replacing(beside) as file:
        output = Output(file)
        numbers = uninterrupted(h5py.File, output, "w")
        try:
            yield partial(_hdf5_item, output, numbers, beside.name)
        finally:
            uninterrupted(numbers.close)
        output.check()


def _hdf5_item(output: Output, file: Any, name: str, array: np.ndarray) -> xml.Element:
    key = f"data{len(file)}"
    uninterrupted(partial(file.create_dataset, key, data=array))
    output.check()
    return _item("HDF", array, f"{name}:/{key}")


def _binary_item(file: BinaryIO, name: str, array: np.ndarray) -> xml.Element:
    item = _item("Binary", array, name, Endian=ORDER, Seek=str(file.tell()))
    file.write(array.data)
    return item


def _item(form: str, array: np.ndarray, text: str, **attributes: str) -> xml.Element:
    item = xml.Element(
        "DataItem",
        attributes,
        Format=form,
        DataType="Float" if array.dtype.kind == "f" else "Int",
        Precision="8",
        Dimensions=" ".join(str(size) for size in array.shape),
    )
    item.text = text
    return item


# ---- VTK ------------------------------------------------------------------------------------


def _write_pvd(path: Path, series: Series) -> None:
    folder = path.with_suffix("")
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        message = f"path cannot be written: {error.strerror}"
        raise OSError(error.errno, message, str(folder)) from error
    root = xml.Element("VTKFile", type="Collection", version="0.1", byte_order=f"{ORDER}Endian")
    collection = xml.SubElement(root, "Collection")
    for step in series.steps:
        file = folder / f"{step:06d}.vtu"
        _write_vtu(file, series.mesh, series.at(step), series.cells)
        xml.SubElement(
            collection,
            "DataSet",
            timestep=repr(float(series.times[step])),
            part="0",
            file=f"{folder.name}/{file.name}",
        )
    _write_xml(path, root)


def _write_vtu(
    path: Path,
    mesh: Mesh,
    fields: Iterator[tuple[str, np.ndarray]],
    numbers: Mapping[str, np.ndarray],
) -> None:
    root = xml.Element(
        "VTKFile",
        type="UnstructuredGrid",
        version="1.0",
        byte_order=f"{ORDER}Endian",
        header_type="UInt64",
    )
    counts = np.array([len(block.nodes) for block in mesh.blocks])
    kinds = [KINDS[block.kind] for block in mesh.blocks]
    sizes = np.repeat([kind.nodes for kind in kinds], counts)
    types = np.repeat(np.array([kind.vtk for kind in kinds], dtype=np.uint8), counts)
    grid = xml.SubElement(root, "UnstructuredGrid")
    piece = xml.SubElement(
        grid, "Piece", NumberOfPoints=str(len(mesh.points)), NumberOfCells=str(len(sizes))
    )
    points = xml.SubElement(piece, "Points")
    _data_array(points, "Points", np.ascontiguousarray(padded(mesh.points, 3)))
    cells = xml.SubElement(piece, "Cells")
    _data_array(
        cells, "connectivity", np.concatenate([block.nodes.ravel() for block in mesh.blocks])
    )
    _data_array(cells, "offsets", np.cumsum(sizes))
    _data_array(cells, "types", types)
    data = xml.SubElement(piece, "PointData", Vectors="displacement")
    for name, values in fields:
        _data_array(data, name, values)
    if numbers:
        data = xml.SubElement(piece, "CellData")
        for name, values in numbers.items():
            _data_array(data, name, values)
    _write_xml(path, root)


def _data_array(parent: xml.Element, name: str, array: np.ndarray) -> None:
    """Append an array to the XML: its length in bytes and its bytes, in base 64."""
    kind = {"f": "Float", "i": "Int", "u": "UInt"}[array.dtype.kind]
    item = xml.SubElement(
        parent, "DataArray", type=f"{kind}{8 * array.itemsize}", Name=name, format="binary"
    )
    if array.ndim == 2:
        item.set("NumberOfComponents", str(array.shape[1]))
    item.text = base64.b64encode(np.uint64(array.nbytes).tobytes() + array.tobytes()).decode()


def _write_xml(path: Path, root: xml.Element) -> None:
    root.insert(0, xml.Comment(f" pmalpha {package_version()} "))
    xml.indent(root)
    with replacing(path) as file:
        xml.ElementTree(root).write(file, encoding="utf-8", xml_declaration=True)
