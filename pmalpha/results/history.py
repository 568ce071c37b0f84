"""The result of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from os import PathLike
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from .._checks import counted
from ..files import checked_path, read_npz, write_npz
from ..problem.subdomain import Subdomain
from . import history_file
from .conversion import dataset, frames, subdomain_dataset, subdomain_frame
from .dof_motion import DofMotion, columns_of, label_of
from .energy import ENERGY_FIELDS, Energy
from .history_file import FORMAT, VERSION, output_array, whole_numbers
from .joining import joined
from .keys import position
from .local_error import local_error
from .pacing import Pacing
from .quantities import OF_INTERFACE, OF_SUBDOMAIN, Quantity, arrays_of

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

__all__ = ["History", "SubdomainHistory"]


@dataclass(frozen=True)
class SubdomainHistory:
    """The recorded motion of one subdomain.

    ``motion["roof"]``, by a name or number of a dof, is the `DofMotion` of that dof, with ``.t``,
    ``.u``, ``.v`` and ``.a``; negative numbers count from the end.

    Attributes
    ----------
    name : str
        Of the subdomain.
    t : (k,) array
        Times of the recorded time levels; the first is the beginning of the run.
    u, v, a : (k, dofs) arrays
        Displacement, velocity and true acceleration (w of the equations).
    dofs : (dofs,) array of int
        The dofs of the columns.
    deformation, force : (k, springs) arrays, or None
        Hysteresis loops of the springs, with ``record_springs``. See `SpringState`.
    springs : (springs,) array of int, or None
        The springs of these columns.
    outputs : dict of (k, rows) arrays
        The outputs of ``run(outputs=)`` by name.
    iterations : (k,) array of int, or None
        Newton iterations of each substep with internal forces, zero at the first time level: those
        of its beginning and its end together, under "macro" those of all passes.
    q : (k, m) array, or None
        The history of the internal forces, where all dofs are recorded.
    substep : float or None
        The length h of its substeps; None where it changed in the History, and for one from a file
        of an older version.
    double_after : float or None
        The time after which its steps are double, of length 2 h; None if they are single.
    n : int or None
        Number of all dofs of the subdomain; None from a file of an older version.
    dof_names : sequence of str, or None
        Names of the dofs of the columns.
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
    substep: float | None = None
    double_after: float | None = None
    outputs: Mapping[str, np.ndarray] = field(default_factory=dict)
    iterations: np.ndarray | None = None
    q: np.ndarray | None = None
    n: int | None = None
    dof_names: Sequence[str] | None = None

    def __getitem__(self, key: int | str) -> DofMotion:
        (j,) = columns_of(key, self.dofs, self.n, self.dof_names, f"dof of {self.name!r}", one=True)
        name = label_of(self.dofs, self.dof_names, j)
        return DofMotion(name, self.u[:, j], self.v[:, j], self.a[:, j], self.t)

    def __iter__(self) -> NoReturn:  # else dof after dof up to an error
        raise TypeError("a SubdomainHistory has dofs by name or number: take its u, v or a")

    def local_error(self) -> np.ndarray:
        """Estimate of the displacement error that each step adds, from recorded u, v and a.

        Returns
        -------
        (k - 1, dofs) array
            Row i is for the step that ends at ``t[i + 1]``, in the unit of u: equation (D1),
            e = u_1 - [u + h v + h^2 (2 w + w_1) / 6], of order h^3. A double step begins two time
            levels before its end; NaN where that level was before the beginning of the run.

        Raises
        ------
        ValueError
            For a run with ``every``, unless all substeps are at recorded macro time levels, for
            steps that changed, and for a file of an older version.

        Notes
        -----
        The estimate does not contain the error of the interface, of order 1 with substeps under
        "pm" and "gc".

        Examples
        --------
        The trapezoidal rule adds h^3 / 12 times the third derivative, here 8 cos(2 t):

        >>> one = Subdomain([1.0], [4.0], scheme=Newmark(), v0=[-1.0])
        >>> e = solve(one, dt=0.01, t_end=1.0).local_error()
        >>> e.shape, float(np.round(e[0, 0] / (0.01**3 / 12), 2))
        ((100, 1), 4.0)
        """
        return local_error(self)

    def plot(
        self,
        dofs: Any = None,
        *,
        quantity: str = "u",
        title: str | None = None,
        units: Mapping[str, str] | None = None,
        ax: Axes | None = None,
    ) -> Axes:
        """Plot time histories of dofs, as `History.plot`, whose errors it raises.

        Parameters
        ----------
        dofs : int, list of int or None
            At most 16. Default: at most four, with the largest range and different motion.
        quantity : {"u", "v", "a"}, default "u"
            Displacement, velocity or acceleration.
        title : str, optional
            Default: none.
        units : dict, optional
            As for `History.plot`.
        ax : matplotlib.axes.Axes, optional
            Axes to draw into. Default: those of a new figure of pyplot.

        Returns
        -------
        matplotlib.axes.Axes
            As of `History.plot`.

        Examples
        --------
        >>> oscillator = Subdomain([1.0], [4.0], scheme=Newmark(), u0=[1.0])
        >>> ax = solve(oscillator, dt=0.1, t_end=9.0).plot(units={"time": "s"})
        >>> ax.get_xlabel()
        'time $t$ (s)'
        """
        return self._alone().plot(dofs, quantity=quantity, title=title, units=units, ax=ax)

    def save(self, path: str | PathLike[str]) -> None:
        """Write to a file, as `History.save`: a History of this subdomain only.

        Parameters
        ----------
        path : str or path
            As for `History.save`.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> motion = solve(Subdomain([1.0], [4.0], scheme=Newmark(), u0=[1.0]), dt=0.1, t_end=1.0)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder, "run.npz")
        ...     motion.save(path)
        ...     bool(np.all(History.load(path)[0].u == motion.u))
        True
        """
        self._alone().save(path)

    def to_xarray(self) -> xarray.Dataset:
        """The motion with the coordinates time and dof; the arrays are shared, not copied.

        Returns
        -------
        xarray.Dataset
            With u, v and a over ``time`` and ``dof``, and ``deformation`` and ``force`` of recorded
            springs over ``time`` and ``spring``; outputs are variables by their names over
            ``time`` and rows.

        Raises
        ------
        ImportError
            If xarray is missing.
        """
        return subdomain_dataset(self)

    def to_pandas(self) -> pandas.DataFrame:
        """The motion as a table, a row for each time level.

        Returns
        -------
        pandas.DataFrame
            The index is ``time``, the columns are (quantity, dof), dofs by name where they have
            names: u, v and a, with recorded
            springs also deformation and force, whose second label is the spring, with internal
            forces iterations and q, and outputs by their names, whose second label is the row.

        Raises
        ------
        ImportError
            If pandas is missing.

        Examples
        --------
        >>> motion = solve(Subdomain([1.0], [4.0], scheme=Newmark(), u0=[1.0]), dt=0.1, t_end=1.0)
        >>> motion.to_pandas()["u"].shape  # doctest: +SKIP
        (11, 1)
        """
        return subdomain_frame(self)

    def _alone(self) -> History:
        """A History of this subdomain only, without constraints."""
        none = np.empty((self.t.size, 0))
        return History(
            subdomains=(self,),
            multipliers=none,
            multiplier_times=self.t,
            velocity_jump=none,
            displacement_jump=none,
            macro_times=self.t,
            keys=((self.name, None),),
        )

    def __repr__(self) -> str:
        levels, dofs = counted(self.t.size, "time level"), counted(self.dofs.size, "dof")
        outputs = f", {counted(len(self.outputs), 'output')}" if self.outputs else ""
        return f"<{self.name!r}: {levels}, {dofs}{outputs}>"


@dataclass(frozen=True)
class History:
    """The results of one call of `Coupler.run`.

    ``history["rig"]``, ``history[rig]`` or ``history[1]`` is a `SubdomainHistory`. The first row of
    every array is at the beginning of the run. The arrays of a run are parts of one block of
    memory, which is released with the last of them: copy what has to outlive the History.

    Attributes
    ----------
    subdomains : tuple of `SubdomainHistory` or None
        None for a subdomain that was not recorded.
    multipliers : (k, p) array
        The interface force is + L^T Lam: on a tie, +Lam pushes the first and pulls the second
        subdomain.
    multiplier_times : (k,) array
        Every time level at which the interface problem is solved, or with ``every`` the recorded
        macro time levels. Under "mean" the middles of the macro steps, 0 at the start.
    velocity_jump : (k, p) array
        sum_i L_i v_i at the same times (under "mean" at `macro_times`), from total velocities; for
        a subdomain within a step, from its interpolated free velocity and its link velocity.
    displacement_jump : (macro time levels, p) array
        sum_i L_i u_i at `macro_times`: the displacement drift, where only velocities are tied.
    macro_times : (macro time levels,) array
        Ends of the recorded macro steps, the beginning of the run first.
    keys : tuple of (str, `Subdomain` or None)
        Names and subdomains in their order; for a History from a file only the names.
    energy : `Energy` or None
        With ``run(energy=True)``.
    substeps : (macro time levels, subdomains) array of int, or None
        Row k has those of the macro step that ends at ``macro_times[k]``, row 0 those with which
        the run began; they vary with ``run(tolerance=)``. None for a file of an older version.
    pacing : `Pacing` or None
        With `Coupler.run_paced`: the times of its fine steps. Not in files.
    """

    subdomains: tuple[SubdomainHistory | None, ...]
    multipliers: np.ndarray
    multiplier_times: np.ndarray
    velocity_jump: np.ndarray
    displacement_jump: np.ndarray
    macro_times: np.ndarray
    keys: tuple[tuple[str, Subdomain | None], ...]
    # not | None: a checker would want a test at each use of what was requested
    energy: Energy | Any = None
    substeps: np.ndarray | Any = None
    pacing: Pacing | Any = None

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
            f"{counted(self.multipliers.shape[1], 'constraint')}; {names}>"
        )

    # ---- figures -----------------------------------------------------------------------------

    def plot(
        self,
        dofs: Any = None,
        *,
        conditions: Any = None,
        quantity: str = "u",
        title: str | None = None,
        units: Mapping[str, str] | None = None,
        ax: Axes | None = None,
    ) -> Axes:
        """Plot time histories of dofs, the jumps at the interface and the multipliers.

        Panels one above another with a common time axis; without constraints only the panel of the
        dofs. Long histories are drawn as their envelope. A jump that is a rounding error, below
        1e-12 of the largest recorded velocity or displacement, has no panel but a sentence below
        the panels that states its size; usually that is the velocity jump.

        Parameters
        ----------
        dofs : dict, or int or list of int
            Dofs, one or several, by subdomain, None for all recorded dofs of one; at most 16 in
            total. An int or a list: dofs of the only subdomain. Default: at most four in total, the
            dofs of each subdomain with the largest range and different motion.
        conditions : int or list of int
            Constraints, as rows of L, at most 16. Default: at most four, chosen in the same way by
            their multipliers. A grey band shows the range of all if there are more.
        quantity : {"u", "v", "a"}, default "u"
            Displacement, velocity or acceleration.
        title : str, optional
            Default: none.
        units : dict, optional
            For the labels of the axes: units of "length", "time" and "force", such as
            ``{"length": "m", "time": "s", "force": "N"}``. Numbers are not converted. A quantity
            whose unit does not follow from those given is labelled without.
        ax : matplotlib.axes.Axes, optional
            Axes to draw into, without the panels of the interface. Default: a new figure of pyplot.

        Returns
        -------
        matplotlib.axes.Axes
            `ax`, or the first panel of the new figure ``ax.figure``, whose ``axes`` are all panels.
            A notebook shows it at the end of the cell, a script with ``matplotlib.pyplot.show()``;
            ``matplotlib.pyplot.close(ax.figure)`` releases it. `pmalpha.plot.save` writes it to a
            file.

        Raises
        ------
        ImportError
            If matplotlib is missing.
        TypeError, ValueError
            For dofs that were not recorded, constraints that do not exist, and unknown units.

        Examples
        --------
        >>> history = models.four_dof().coupler(0.05, coupling="pm").run(steps=40)
        >>> ax = history.plot({"A": [2], "B": [0, 1]}, units={"length": "m", "force": "N"})
        >>> [panel.get_ylabel() for panel in ax.figure.axes][::2]
        ['displacement (m)', 'multiplier (N)']
        """
        from ..plot.histories import time_histories

        return time_histories(
            self, dofs, conditions=conditions, quantity=quantity, title=title, units=units, ax=ax
        )

    # ---- files and other libraries -----------------------------------------------------------

    def save(self, path: str | PathLike[str]) -> None:
        """Write the history to a file; `load` reads it back bitwise identically.

        An npz file without pickled objects, which ``numpy.load`` opens too, or HDF5. Written
        atomically; an existing file survives an interrupted save.

        Parameters
        ----------
        path : str or path
            Used as given; no suffix is added. With the suffix ".h5" or ".hdf5" the file is HDF5;
            its groups are called by the subdomains, attributes describe its arrays and their units.

        Raises
        ------
        TypeError, OSError
            For a wrong type of path, and for a file that cannot be written.
        ValueError
            For times, states or multipliers that are not finite, which no run records.
        ImportError
            For an HDF5 file without h5py.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> history = models.split_oscillator(10.0).coupler(0.05, coupling="pm").run(steps=3)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder, "run.npz")
        ...     history.save(path)
        ...     bool(np.all(History.load(path)["A"].u == history["A"].u))
        True
        """
        header, arrays = self.contents()
        wrong = history_file.not_finite(arrays)
        if wrong is not None:
            raise ValueError(f"a History must have finite states to be saved, {wrong} has others")
        is_hdf5 = checked_path(path).suffix in (".h5", ".hdf5")
        write = history_file.write if is_hdf5 else write_npz
        write(path, header, arrays)

    def contents(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """The contents of a file of this History.

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
            "names": [name for name, _ in self.keys],
            "recorded": [i for i, s in enumerate(self.subdomains) if s is not None],
            "steps": [s and (s.substep, s.double_after) for s in self.subdomains],
            "outputs": [list(s.outputs) if s else [] for s in self.subdomains],
            "sizes": [s and s.n for s in self.subdomains],
            "dof_names": [
                None if s is None or s.dof_names is None else list(s.dof_names)
                for s in self.subdomains
            ],
        }
        arrays = arrays_of(self)
        for i, s in enumerate(self.subdomains):
            if s is not None:
                arrays |= {f"{i}.{name}": x for name, x in arrays_of(s).items()}
                arrays |= {output_array(i, k): x for k, x in enumerate(s.outputs.values())}
        if self.energy is not None:
            arrays |= {f"energy.{name}": x for name, x in self.energy.arrays().items()}
        return header, arrays

    @classmethod
    def load(cls, path: str | PathLike[str]) -> History:
        """Read a History from a file of `save`, or of a run with ``record_to``.

        The file has the names of the subdomains, not the objects: index the History by name or
        number. The arrays of a run with ``record_to`` are mapped and read on access, up to the
        last macro step that the run has written, also during the run and after a kill.

        Parameters
        ----------
        path : str or path
            An npz or HDF5 file.

        Returns
        -------
        History

        Raises
        ------
        TypeError, OSError
            For a wrong type of path, and for a file that cannot be read.
        ValueError
            For any other file, or a damaged one, and for states in an npz file that are not finite
            (those of an HDF5 file are not read here); the message has the reason.
        ImportError
            For an HDF5 file without h5py.
        """
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
            subdomains: list[SubdomainHistory | None] = [None] * len(header["names"])
            steps = header.get("steps", [(None, None)] * len(header["names"]))
            outputs = header.get("outputs", [()] * len(header["names"]))
            sizes, dof_names = (
                header.get(key, [None] * len(header["names"])) for key in ("sizes", "dof_names")
            )
            for i in header["recorded"]:
                substep, double_after = steps[i]
                subdomains[i] = SubdomainHistory(
                    name=header["names"][i],
                    substep=substep,
                    double_after=double_after,
                    n=sizes[i],
                    dof_names=dof_names[i],
                    outputs={x: arrays[output_array(i, k)] for k, x in enumerate(outputs[i])},
                    **_read(SubdomainHistory, OF_SUBDOMAIN, arrays, f"{i}."),
                )
            interface = _read(cls, OF_INTERFACE, arrays)
            energy = None
            if any(key.startswith("energy.") for key in arrays):
                energies = {key: arrays[f"energy.{key}"] for key in ENERGY_FIELDS}
                conserved = arrays.get("energy.conserved")
                energy = Energy(interface["macro_times"], **energies, conserved=conserved)
        except (AttributeError, LookupError, TypeError, ValueError) as error:
            raise ValueError(
                f"path must lead to a complete file, {str(path)!r} lacks {error}"
            ) from None
        keys = tuple((name, None) for name in header["names"])
        return cls(subdomains=tuple(subdomains), **interface, keys=keys, energy=energy)

    @classmethod
    def join(cls, pieces: Iterable[History]) -> History:
        """One History of consecutive runs.

        Parameters
        ----------
        pieces : sequence of History
            In the order of time, with the same subdomains, recorded dofs and constraints; each
            begins where the one before ends. The row of the common time level is taken once.

        Returns
        -------
        History
            The arrays are copies, in memory.

        Raises
        ------
        ValueError
            For pieces that are not consecutive, differ in what is recorded, or have energies.

        Examples
        --------
        >>> coupler = models.split_oscillator(10.0).coupler(0.05, coupling="pm")
        >>> whole = History.join([coupler.run(steps=3), coupler.run(steps=4)])
        >>> whole["A"].u.shape, whole.macro_times.round(2).tolist()[-1]
        ((8, 1), 0.35)
        """
        result: History = joined(tuple(pieces))
        return result

    def to_pandas(self) -> dict[str, pandas.DataFrame]:
        """The history as pandas.DataFrames by name of the recorded subdomains.

        Each as of `SubdomainHistory.to_pandas`. With constraints there is "interface", with the
        index ``time``, the times at which the interface problem is solved, and the columns
        (quantity, constraint) for ``multipliers`` and ``velocity_jump``.

        Returns
        -------
        dict of pandas.DataFrame
            With the recorded subdomains in their order.

        Raises
        ------
        ImportError
            If pandas is missing.
        ValueError
            If a subdomain is called "interface".
        """
        return frames(self)

    def to_xarray(self) -> xarray.Dataset:
        """The history as an xarray.Dataset; the arrays are shared, not copied.

        Each recorded subdomain, here "rig", has the variables ``rig_u``, ``rig_v``, ``rig_a`` with
        the coordinates ``rig_time`` and ``rig_dof``, and with recorded springs ``rig_deformation``
        and ``rig_force`` with ``rig_time`` and ``rig_spring``. An output "base shear" is
        ``rig_base shear`` with ``rig_time`` and ``rig_base shear_row``. The interface has
        ``multipliers`` and ``velocity_jump`` with ``multiplier_times`` and ``constraint`` (a row of
        L), and ``displacement_jump`` with ``macro_times`` and ``constraint``. Dofs with names have
        these as coordinates. A run with ``energy=True`` has ``energy_kinetic`` and so on with
        ``macro_times`` and ``subdomain``.

        Returns
        -------
        xarray.Dataset
            Of all that was recorded.

        Raises
        ------
        ImportError
            If xarray is missing.
        """
        return dataset(self)


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
