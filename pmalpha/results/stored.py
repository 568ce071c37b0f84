"""What is in a file of a History, npz or HDF5."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from os import PathLike
from typing import Any

import numpy as np

from ..files import HDF5, NPZ, checked_path, read_npz, write_npz
from . import history_file
from .contact_history import Recorded
from .energy import ENERGY_FIELDS, OPTIONAL, Energy
from .history_file import FORMAT, VERSION, output_array, whole_numbers
from .quantities import OF_INTERFACE, OF_SUBDOMAIN, Quantity, arrays_of


def write_history(path: str | PathLike[str], history: Any) -> None:
    """The implementation of `History.save`."""
    header, arrays = contents_of(history)
    wrong = history_file.not_finite(arrays)
    if wrong is not None:
        raise ValueError(f"a History must have finite states to be saved, {wrong} has others")
    is_hdf5 = checked_path(path, suffixes=NPZ + HDF5).suffix.lower() in HDF5
    write = history_file.write if is_hdf5 else write_npz
    write(path, header, arrays)


def contents_of(history: Any) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The contents of a file of a History.

    Returns
    -------
    header : dict
        Format, version, names and steps.
    arrays : dict of arrays
        By name.
    """
    header = {
        "format": FORMAT,
        "version": VERSION,
        "names": [name for name, _ in history.keys],
        "recorded": [i for i, s in enumerate(history.subdomains) if s is not None],
        "steps": [s and (s.substep, s.double_after) for s in history.subdomains],
        "outputs": [list(s.outputs) if s else [] for s in history.subdomains],
        "sizes": [s and s.n for s in history.subdomains],
        "dof_names": [
            None if s is None or s.dof_names is None else list(s.dof_names)
            for s in history.subdomains
        ],
    }
    if history.contact_layout:
        header["contacts"] = [x[:3] for x in history.contact_layout]
    arrays = arrays_of(history)
    for i, s in enumerate(history.subdomains):
        if s is not None:
            arrays |= {f"{i}.{name}": x for name, x in arrays_of(s).items()}
            arrays |= {output_array(i, k): x for k, x in enumerate(s.outputs.values())}
    if history.energy is not None:
        arrays |= {f"energy.{name}": x for name, x in history.energy.arrays().items()}
    return header, arrays


def stored_fields(path: str | PathLike[str], whole: type, kind: type) -> dict[str, Any]:
    """The fields of the History in a file; the classes are those of it and of its subdomains."""
    is_mapped = history_file.is_hdf5(path)
    if is_mapped:
        header, arrays = history_file.read(path)
    else:
        header, arrays = read_npz(path, FORMAT, VERSION)
    try:
        history_file.check_contents(header, arrays)
        wrong = None if is_mapped else history_file.not_finite(arrays)
        if wrong is not None:
            raise ValueError(f"finite numbers in {wrong}")
        subdomains: list[Any] = [None] * len(header["names"])
        steps = header.get("steps", [(None, None)] * len(header["names"]))
        outputs = header.get("outputs", [()] * len(header["names"]))
        sizes, dof_names = (
            header.get(key, [None] * len(header["names"])) for key in ("sizes", "dof_names")
        )
        for i in header["recorded"]:
            substep, double_after = steps[i]
            subdomains[i] = kind(
                name=header["names"][i],
                substep=substep,
                double_after=double_after,
                n=sizes[i],
                dof_names=dof_names[i],
                outputs={x: arrays[output_array(i, k)] for k, x in enumerate(outputs[i])},
                **_read(kind, OF_SUBDOMAIN, arrays, f"{i}."),
            )
        interface = _read(whole, OF_INTERFACE, arrays)
        energy = None
        if any(key.startswith("energy.") for key in arrays):
            energies = {key: arrays[f"energy.{key}"] for key in ENERGY_FIELDS}
            others: dict[str, Any] = {x: arrays.get(f"energy.{x}") for x in OPTIONAL}
            energy = Energy(interface["macro_times"], **energies, **others)
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise ValueError(
            f"path must lead to a complete file, {str(path)!r} lacks {error}"
        ) from None
    keys = tuple((name, None) for name in header["names"])
    layout = tuple(Recorded(*x) for x in header.get("contacts", ()))
    interface |= {"contact_layout": layout}
    return {"subdomains": tuple(subdomains), **interface, "keys": keys, "energy": energy}


def _read(
    kind: type, table: Mapping[str, Quantity], arrays: Mapping[str, np.ndarray], prefix: str = ""
) -> dict[str, Any]:
    """The arrays of a History from a file; LookupError where one is missing that all files have."""
    needed = {x.name for x in fields(kind) if x.default is MISSING}
    names = (name for name in table if name in needed or prefix + name in arrays)
    return {
        name: whole_numbers(arrays, prefix + name)
        if table[name].is_count
        else arrays[prefix + name]
        for name in names
    }
