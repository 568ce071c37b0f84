"""Attributes in the HDF5 file of a History, for readers that do not know the package.

`History.load` reads the header only. The units are written in terms of those of the problem: u and
t, and F for forces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..files import package_version
from .quantities import OF_INTERFACE, OF_SUBDOMAIN

# By the last component of the HDF5 path: what the array is, and its unit.
ARRAYS = {name: (x.what, x.unit) for name, x in (OF_SUBDOMAIN | OF_INTERFACE).items()}
ARRAYS["step_count"] = ("macro steps up to which all rows are written", "1")
ENERGY = ("a row for each macro time level, a column for each subdomain", "F u")
CONSERVED = (
    "a share in the conserved quantity, " + ENERGY[0],
    "F u / t^2; F u under mean coupling",
)
OUTPUT = "linear combinations of u, v and a, a row for each time level"
UNITS = "any consistent system, that of the matrices, u and dt; F is the unit of K u"


def describe(whole: Any, header: Mapping[str, Any]) -> None:
    """Write the attributes of a file whose datasets exist.

    Parameters
    ----------
    whole : h5py.File
    header : dict
        From `contents_of`.
    """
    whole.attrs.update(
        {
            "format": header["format"],
            "format_version": header["version"],
            "pmalpha_version": package_version(),
            "units": UNITS,
        }
    )
    numbers = {group: i for i, group in enumerate(header["groups"])}
    for key, item in whole.items():
        if key in numbers:
            i = numbers[key]
            item.attrs["name"] = storable(header["names"][i])
            _name_outputs(item.get("outputs", {}), header["outputs"][i])
            _name_dofs(item, header["dof_names"][i])
        for name, array in item.items() if hasattr(item, "items") else [(key, item)]:
            of_energy = CONSERVED if name == "conserved" else ENERGY
            known = of_energy if key == "energy" else ARRAYS.get(name)
            if known is not None:
                array.attrs.update(zip(("description", "units"), known))


def _name_outputs(group: Mapping[str, Any], names: Sequence[str]) -> None:
    for k, array in group.items():
        array.attrs.update({"name": storable(names[int(k)]), "description": OUTPUT})


def _name_dofs(group: Any, names: Sequence[str] | None) -> None:
    """The names of the columns of u, v and a, which `History.load` takes from the header."""
    if names:
        group["dof_names"] = np.array([storable(name).encode() for name in names])
        group["dof_names"].attrs["description"] = "names of the recorded dofs, utf-8"


def storable(name: str) -> str:
    """The name without what HDF5 cannot store in a string: lone surrogates and zeros."""
    return name.encode("utf-8", "replace").decode().replace("\0", "?")
