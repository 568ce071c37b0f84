"""What is in a file of a History, npz or HDF5, and its rows, which a run continues."""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from .._checks import listing
from ..files import (
    HDF5,
    NPZ,
    Held,
    check_replaceable,
    checked_path,
    held,
    npz_contents,
    reading,
    write_npz,
)
from . import history_file
from .array_file import hdf5_library
from .contact import Recorded
from .energy import ENERGY_FIELDS, OPTIONAL, Energy
from .history_file import (
    FORMAT,
    VERSION,
    output_array,
    read_open,
    row_count,
    whole_numbers,
)
from .quantities import IN_SUBDOMAIN, NO_ENERGY, OF_INTERFACE, OF_SUBDOMAIN, Quantity, arrays_of

# Number of differences of two problems that an error lists.
SHOWN = 6


def write_history(path: str | PathLike[str], history: Any) -> None:
    header, arrays = contents_of(history)
    wrong = history_file.not_finite(arrays)
    if wrong is not None:
        raise ValueError(f"a History must have finite states to be saved, {wrong} has others")
    is_hdf5 = checked_path(path, suffixes=NPZ + HDF5).suffix.lower() in HDF5
    write = history_file.write if is_hdf5 else write_npz
    write(path, header, arrays)


def contents_of(history: Any) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The contents of a file of a History."""
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
        "coupling": history.coupling,
        "macro_step": history.dt,
        "constraint_rows": list(history.constraint_rows),
        "warnings": list(history.warnings),
    }
    if history.contact_layout:
        header["contacts"] = [x[:3] for x in history.contact_layout]
    arrays = arrays_of(history)
    for i, s in enumerate(history.subdomains):
        if s is not None:
            arrays |= {f"{i}.{name}": x for name, x in arrays_of(s).items()}
            arrays |= {output_array(i, k): x for k, x in enumerate(s.outputs.values())}
    if history.energy:
        arrays |= {f"energy.{name}": x for name, x in history.energy.arrays().items()}
    return header, arrays


def stored_fields(path: str | PathLike[str], history: type, kind: type) -> dict[str, Any]:
    """The fields of the History in a file; the classes are those of it and of its subdomains."""
    with reading(path) as file:
        is_hdf5 = history_file.is_hdf5(file)
        if is_hdf5:
            header, arrays = history_file.read_open(file, path)
        else:
            header, arrays = npz_contents(file, path, FORMAT, VERSION)
    return fields_of(header, arrays, path, history, kind, finite=not is_hdf5)


def fields_of(
    header: Mapping[str, Any],
    arrays: Mapping[str, np.ndarray],
    path: str | PathLike[str],
    history: type,
    kind: type,
    *,
    finite: bool = False,
) -> dict[str, Any]:
    """The fields of a History with the contents of the file `path`, checked to be `finite`."""
    try:
        history_file.check_contents(header, arrays)
        wrong = history_file.not_finite(arrays) if finite else None
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
        interface = _read(history, OF_INTERFACE, arrays)
        energy: Any = NO_ENERGY
        if any(key.startswith("energy.") for key in arrays):
            energies = {key: arrays[f"energy.{key}"] for key in ENERGY_FIELDS}
            extras: dict[str, Any] = {x: arrays.get(f"energy.{x}") for x in OPTIONAL}
            energy = Energy(interface["macro_times"], **energies, **extras)
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise ValueError(
            f"path must lead to a complete file, {str(path)!r} lacks {error}"
        ) from None
    keys = tuple((name, None) for name in header["names"])
    layout = tuple(Recorded(*x) for x in header.get("contacts", ()))
    interface |= {"contact_layout": layout, "coupling": header.get("coupling")}
    interface |= {"warnings": tuple(header.get("warnings", ())), "dt": header.get("macro_step")}
    interface |= {"constraint_rows": tuple(header.get("constraint_rows", ()))}
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


def target(record_to: str | PathLike[str], *, may_exist: bool) -> Path:
    """The path of the file of a run; OSError for one that cannot be written.

    FileExistsError for a file that neither `append` nor `overwrite` allows to change.
    """
    hdf5_library()
    check_replaceable(record_to, "record_to")
    path = checked_path(record_to, "record_to")
    if path.exists() and not may_exist:
        why = (
            "record_to must lead to a new file, got one that exists; append=True continues it, "
            "overwrite=True replaces it"
        )
        raise FileExistsError(errno.EEXIST, why, str(path))
    return path


def old_file(path: Path) -> Held | None:
    """The file of an earlier run that a run continues or replaces, locked, if there is one."""
    try:
        return held(Path(os.path.realpath(path)), "record_to")
    except FileNotFoundError:
        return None


def differences(
    saved: Mapping[str, Any], here: Mapping[str, Any], elsewhere: Sequence[str] = ()
) -> list[str]:
    """The facts that differ between the problem of a file and the one here, without those of
    subdomains that are `elsewhere`, in other processes."""
    apart = tuple(f" {word} {name!r}" for name in elsewhere for word in ("of", "on"))
    return [
        f"{fact} ({saved.get(fact, 'not given')} in the file, {here.get(fact, 'not given')} here)"
        for fact in dict.fromkeys([*saved, *here])
        if saved.get(fact) != here.get(fact) and not fact.endswith(apart)
    ]


class EarlierRows:
    """The complete rows of a file of ``run(record_to=)`` up to the present macro step.

    file: it is open and locked.
    present: the macro step at which the run continues. Rows after it are left out: those that were
        written after the checkpoint from which the run continues.
    """

    def __init__(self, file: Held, present: int):
        self.path, self.present = file.path, present
        with file.reader() as content:
            self.header, self.all_rows = read_open(content, file.path)
        if not self.header["nodes"]:
            self._refuse("must be a file of run(record_to=), not of History.save")
        self.begin, last = self.header["begin"], self.header["step_count"]
        if present > last or (present <= self.begin and present != last):
            advice = "" if present > last else ": load the checkpoint of that run first"
            self._refuse(
                f"must reach macro step {present}, the present, from an earlier one; it has those "
                f"from {self.begin} to {last}{advice}"
            )
        self.arrays = {
            name: x[: self._rows(name)] if name in self.header["nodes"] else x
            for name, x in self.all_rows.items()
        }

    def _rows(self, name: str) -> int:
        levels = self.header["nodes"][name]
        return row_count(self.begin, self.present, self.header["every"], levels)

    def check(self, header: Mapping[str, Any], first: Mapping[str, np.ndarray]) -> None:
        """ValueError unless a run with this header and these first rows continues the file."""
        for name in ("names", "recorded", "every", "fixed", "dt", "outputs", "coupling"):
            if name in self.header and name in header and self.header[name] != header[name]:
                self._refuse("must be of the same coupler, dt and recorded quantities")
        nodes = self.header["nodes"]
        if nodes.keys() != header["nodes"].keys():
            self._refuse("must be of the same coupler, dt and recorded quantities")
        if header["every"] == 0 and nodes != header["nodes"]:
            self._refuse(
                "must be of the present numbers of substeps, it has other numbers of substeps; "
                "record to a new file after a change, or with every"
            )
        for name, x in self.arrays.items():
            if name in header["fixed"]:
                same = np.array_equal(x, first[name])
            else:
                same = x.shape[1:] == first[name].shape[1:]
            if not same:
                self._refuse("must be of the same coupler, dt and recorded quantities")
        self._check_problem(header.get("problem", {}))
        every = header["every"]
        if every and self.present % every and self.present != self.begin:
            return  # the last rows are not at the present
        motion = tuple(f".{name}" for name in ("t", *IN_SUBDOMAIN["dofs"]))
        states = [x for x in header["nodes"] if x.endswith(motion) or ".outputs." in x]
        if any(not np.array_equal(self.arrays[x][-1], first[x][0]) for x in states):
            self._refuse("must have the present state of the coupler, it has another at this time")

    def _check_problem(self, here: Mapping[str, Any]) -> None:
        """ValueError for another problem than that of the file, by the facts that the file has."""
        saved = self.header.get("problem", {})  # files of before version 0.4 have none
        if not isinstance(saved, dict):
            self._refuse(f"must have a description of its problem, got {saved!r}")
        changes = differences(saved, {fact: x for fact, x in here.items() if fact in saved})
        if changes:
            self._refuse(
                f"must be of the same problem, but these differ: {listing(changes, SHOWN)}"
            )

    def same_steps(self, steps: Sequence[Any]) -> list[Any]:
        """The lengths of the steps of each subdomain; None where those of the file are others."""
        earlier = self.header.get("steps", [None] * len(steps))  # older versions have none
        if not isinstance(earlier, list) or len(earlier) != len(steps):
            self._refuse(f"must have the steps of {len(steps)} subdomains, got {earlier!r}")
        for pair in earlier:
            if pair is not None and not (isinstance(pair, list) and len(pair) == 2):
                self._refuse(f"must have two lengths of steps of a subdomain, got {pair!r}")
        return [(None, None) if a and b and a[0] != b[0] else b for a, b in zip(earlier, steps)]

    def _refuse(self, rule: str) -> None:
        raise ValueError(f"append: {str(self.path)!r} {rule}")
