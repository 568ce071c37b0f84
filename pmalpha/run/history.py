"""The result of a run."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files import checked_path, read_npz, write_npz
from ..problem.subdomain import Subdomain
from . import history_file
from .energy import TOLD, Energy
from .history_file import FORMAT, VERSION
from .keys import position

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

__all__ = ["History", "State", "SubdomainHistory"]

# The arrays in a file that holds a History.
NODAL = ("t", "u", "v", "a", "dofs")
LOOPS = ("deformation", "force", "springs")
INTERFACE = (
    "multipliers",
    "multiplier_times",
    "velocity_jump",
    "displacement_jump",
    "macro_times",
)


@dataclass(frozen=True)
class State:
    """Displacement, velocity and acceleration of a subdomain at one time, (n,) each."""

    u: np.ndarray
    v: np.ndarray
    a: np.ndarray


@dataclass(frozen=True)
class SubdomainHistory:
    """What was recorded of one subdomain.

    Attributes
    ----------
    name : str
    t : (k,) array
        Times of the nodes; the first is where the stretch began.
    u, v, a : (k, dofs) arrays
        Displacement, velocity and true acceleration (w of the equations).
    dofs : (dofs,) array of int
        Which dofs the columns are.
    deformation, force : (k, springs) arrays, or None
        Of springs, with ``record_springs``: hysteresis loops. See `SpringState`.
    springs : (springs,) array of int, or None
        Which springs these columns are.
    """

    name: str
    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    a: np.ndarray
    dofs: np.ndarray
    deformation: np.ndarray | None = None
    force: np.ndarray | None = None
    springs: np.ndarray | None = None

    def __repr__(self) -> str:
        return f"<{self.name!r}: {self.t.size} nodes, {self.dofs.size} dofs>"


@dataclass(frozen=True)
class History:
    """What a run recorded; ``history["rig"]``, ``history[rig]`` or ``history[1]``.

    The first node of every array is the one where the stretch began. `plot` draws it, `save` and
    `load` keep it in a file, `to_xarray` hands it on.

    Attributes
    ----------
    subdomains : tuple of `SubdomainHistory` or None
        None for a subdomain that was not recorded.
    multipliers : (k, p) array
        At `multiplier_times`: every fine node, or with ``every`` every such macro node.
        They act as + L^T Lam: on a tie, +Lam pushes the first and pulls the second subdomain.
    velocity_jump : (k, p) array
        sum_i L_i v_i at the same times, from total velocities; of a subdomain in the middle of an
        own step, from its interpolated free and its link velocity.
    displacement_jump : (macro nodes, p) array
        sum_i L_i u_i at `macro_times`: the drift, since only velocities are tied.
    keys : tuple of (str, `Subdomain` or None)
        Names and subdomains by place; of a file's subdomains only the names are known.
    energy : `Energy` or None
        Of a run with ``energy=True``.
    """

    subdomains: tuple[SubdomainHistory | None, ...]
    multipliers: np.ndarray
    multiplier_times: np.ndarray
    velocity_jump: np.ndarray
    displacement_jump: np.ndarray
    macro_times: np.ndarray
    keys: tuple[tuple[str, Subdomain | None], ...]
    energy: Energy | None = None

    def __getitem__(self, key: str | int | Subdomain) -> SubdomainHistory:
        i = position(key, self.keys)
        found = self.subdomains[i]
        if found is None:
            raise KeyError(f"subdomain {self.keys[i][0]!r} was not recorded")
        return found

    def __len__(self) -> int:
        return len(self.subdomains)

    def __repr__(self) -> str:
        names = ", ".join(repr(s) for s in self.subdomains if s is not None)
        return (
            f"<History t = {self.macro_times[0]:g} .. {self.macro_times[-1]:g}, "
            f"{self.multipliers.shape[1]} conditions; {names}>"
        )

    # ---- pictures ----------------------------------------------------------------------------

    def plot(
        self,
        dofs: Any = None,
        *,
        conditions: Any = None,
        quantity: str = "u",
        title: str | None = None,
    ) -> Figure:
        """Time histories of chosen dofs, the jumps at the interface and the multipliers.

        One panel above another with one axis of time; without interface conditions only that
        of the dofs. Of long histories what is drawn is their envelope.

        Parameters
        ----------
        dofs : dict, or int or list of int
            Dofs, one or several, by subdomain, None for all of one that were recorded; at most
            16 in all. A number or a list stands for the dofs of a single subdomain. Default: of
            each subdomain those of the largest range that move differently, four in all at most.
        conditions : int or list of int
            Which conditions to draw, at most 16. Default: up to four, chosen likewise by their
            multipliers. Where there are more, a grey band shows the extent of all.
        quantity : {"u", "v", "a"}, default "u"
            Displacement, velocity or acceleration.
        title : str, optional

        Returns
        -------
        matplotlib.figure.Figure
            `pmalpha.plot.save` writes it to a file.

        Raises
        ------
        ImportError
            If matplotlib is missing.
        TypeError, ValueError
            For dofs that were not recorded and conditions that do not exist.

        Examples
        --------
        >>> history = models.four_dof().coupler(0.05).run(steps=40)
        >>> figure = history.plot({"A": [2], "B": [0, 1]})
        >>> [ax.get_ylabel() for ax in figure.axes][::3]
        ['displacement', 'multiplier']
        """
        from ..plot.histories import time_histories

        return time_histories(self, dofs, conditions=conditions, quantity=quantity, title=title)

    # ---- files and other libraries -----------------------------------------------------------

    def save(self, path: str | PathLike) -> None:
        """Write the history to a file, which `load` reads back bit for bit.

        An npz file without pickled objects, which ``numpy.load`` opens too, or HDF5. It takes its
        place when it is whole: a file that stood there stays good if saving is interrupted.

        Parameters
        ----------
        path : str or path
            Taken as it is; no ending is added. With the ending ".h5" or ".hdf5" the file is HDF5.

        Raises
        ------
        TypeError, OSError
            For what is no path, and for a file that cannot be written.
        ImportError
            For an HDF5 file without h5py.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> history = models.split_oscillator(10.0).coupler(0.05).run(steps=3)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder, "run.npz")
        ...     history.save(path)
        ...     bool(np.all(History.load(path)["A"].u == history["A"].u))
        True
        """
        header, arrays = self.contents()
        is_hdf5 = checked_path(path).suffix in (".h5", ".hdf5")
        write = history_file.write if is_hdf5 else write_npz
        write(path, header, arrays)

    def contents(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """What a file says of this History, and its arrays by name."""
        header = {
            "format": FORMAT,
            "version": VERSION,
            "names": [name for name, _ in self.keys],
            "recorded": [i for i, part in enumerate(self.subdomains) if part is not None],
        }
        arrays = {name: getattr(self, name) for name in INTERFACE}
        for i, part in enumerate(self.subdomains):
            if part is not None:
                kept = NODAL if part.springs is None else NODAL + LOOPS
                arrays |= {f"{i}.{name}": getattr(part, name) for name in kept}
        if self.energy is not None:
            arrays |= {f"energy.{name}": getattr(self.energy, name) for name in TOLD}
        return header, arrays

    @classmethod
    def load(cls, path: str | PathLike) -> History:
        """A history from a file that `save` wrote, or a run with ``record_to``.

        The file knows its subdomains by name and place, not as objects: index it with those. The
        arrays of a run with ``record_to`` are mapped, not read into memory: what is looked at is
        read then, up to the macro step that the run had counted last, also while it goes on or
        after it was killed.

        Parameters
        ----------
        path : str or path

        Returns
        -------
        History

        Raises
        ------
        TypeError, OSError
            For what is no path, and for a file that cannot be read.
        ValueError
            For any other file, or a damaged one, saying why.
        ImportError
            For an HDF5 file without h5py.
        """
        if history_file.is_hdf5(path):
            header, arrays = history_file.read(path)
        else:
            header, arrays = read_npz(path, FORMAT, VERSION)
        try:
            parts: list[SubdomainHistory | None] = [None] * len(header["names"])
            for i in header["recorded"]:
                kept = NODAL + LOOPS if f"{i}.springs" in arrays else NODAL
                nodal = {key: arrays[f"{i}.{key}"] for key in kept}
                parts[i] = SubdomainHistory(name=header["names"][i], **nodal)
            interface = {key: arrays[key] for key in INTERFACE}
            energy = None
            if any(key.startswith("energy.") for key in arrays):
                told = {key: arrays[f"energy.{key}"] for key in TOLD}
                energy = Energy(interface["macro_times"], **told)
        except (LookupError, TypeError) as error:
            raise ValueError(
                f"path must lead to a whole file, {str(path)!r} lacks {error}"
            ) from None
        keys = tuple((name, None) for name in header["names"])
        return cls(subdomains=tuple(parts), **interface, keys=keys, energy=energy)

    def to_xarray(self) -> xarray.Dataset:
        """The history as an xarray.Dataset, whose arrays are those of the history, not copies.

        Of each recorded subdomain, here "rig", the variables ``rig_u``, ``rig_v``, ``rig_a`` with
        the coordinates ``rig_time`` and ``rig_dof``; of the interface ``multipliers`` and
        ``velocity_jump`` over ``multiplier_times`` and ``condition``, ``displacement_jump`` over
        ``macro_times`` and ``condition``; of the energy, if asked for, ``energy_kinetic`` and
        so on over ``macro_times`` and ``subdomain``; of springs, if asked for,
        ``rig_deformation`` and ``rig_force`` over ``rig_time`` and ``rig_spring``.

        Returns
        -------
        xarray.Dataset

        Raises
        ------
        ImportError
            If xarray is missing.
        """
        try:
            import xarray
        except ImportError as error:
            raise ImportError("to_xarray needs xarray: pip install 'pmalpha[xarray]'") from error
        fine, macro = ("multiplier_times", "condition"), ("macro_times", "condition")
        variables: dict[str, Any] = {
            "multipliers": (fine, self.multipliers),
            "velocity_jump": (fine, self.velocity_jump),
            "displacement_jump": (macro, self.displacement_jump),
        }
        coordinates: dict[str, Any] = {
            "multiplier_times": self.multiplier_times,
            "macro_times": self.macro_times,
            "condition": np.arange(self.multipliers.shape[1]),
        }
        if self.energy is not None:
            coordinates["subdomain"] = [name for name, _ in self.keys]
            told = (macro[0], "subdomain")
            for name in TOLD:
                variables[f"energy_{name}"] = (told, getattr(self.energy, name))
        for part in self.subdomains:
            if part is not None:
                time, dof = f"{part.name}_time", f"{part.name}_dof"
                coordinates |= {time: part.t, dof: part.dofs}
                variables |= {f"{part.name}_{q}": ((time, dof), getattr(part, q)) for q in "uva"}
            if part is not None and part.springs is not None:
                time, spring = f"{part.name}_time", f"{part.name}_spring"
                coordinates[spring] = part.springs
                variables |= {
                    f"{part.name}_{q}": ((time, spring), getattr(part, q)) for q in LOOPS[:2]
                }
        return xarray.Dataset(variables, coordinates)
