"""The result of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from .._checks import counted
from .._rooms import outer
from ..problem.subdomain import Subdomain
from .contact import Contacts, Recorded, contact_fields, recorded_contacts
from .conversion import dataset, frames, history_html
from .energy import Energy
from .history_file import check_mapping
from .pacing import Pacing
from .quantities import NO_ENERGY, NO_PACING, joined, position
from .stored import stored_fields, write_history
from .subdomain import SubdomainHistory
from .times import Instant, Peak, at, peak, resampled

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes


__all__ = ["History", "Resolution", "SubdomainHistory"]


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
        sum_i L_i u_i at `macro_times`: the displacement drift, where only velocities are tied. A
        row with a prescribed velocity is relative to the displacement of its support, the integral
        of that velocity from t = 0, by the trapezoidal rule over the `multiplier_times`.
    macro_times : (macro time levels,) array
        Ends of the recorded macro steps, the beginning of the run first.
    keys : tuple of (str, `Subdomain` or None)
        Names and subdomains in their order; for a History from a file only the names.
    energy : `Energy`
        With ``run(energy=True)``; without, an object that is false and says so.
    substeps : (macro time levels, subdomains) array of int, or None
        Row k has those of the macro step that ends at ``macro_times[k]``, row 0 those with which
        the run began; they vary with ``run(tolerance=)``. None for a file of an older version.
    pacing : `Pacing`
        With `Coupler.run_paced`: the times of its fine steps. Not in files. False as `energy` is.
    coupling : str or None
        That of the `Coupler`; None for a file of an older version.
    warnings : tuple of str
        Those about this run; ``run(record_to=)`` writes its file without them.
    dt : float or None
        The length of all its macro steps; None where it changed, for other times, and for a file of
        an older version.
    constraint_rows : tuple of int
        The rows of each constraint of the coupler; empty for a file of an older version.
    contact_impulses, contact_gaps, contact_layout
        Those of all contacts, of which `contacts` is made.
    """

    subdomains: tuple[SubdomainHistory | None, ...]
    multipliers: np.ndarray
    multiplier_times: np.ndarray
    velocity_jump: np.ndarray
    displacement_jump: np.ndarray
    macro_times: np.ndarray
    keys: tuple[tuple[str, Subdomain | None], ...]
    # not | None: a checker would want a test at each use of what was requested
    energy: Energy | Any = NO_ENERGY
    substeps: np.ndarray | Any = None
    pacing: Pacing | Any = NO_PACING
    coupling: str | None = None
    warnings: tuple[str, ...] = ()
    dt: float | None = None
    constraint_rows: tuple[int, ...] = ()
    contact_impulses: np.ndarray | Any = None
    contact_gaps: np.ndarray | Any = None
    contact_layout: tuple[Recorded, ...] = ()

    def __getitem__(self, key: str | int | Subdomain) -> SubdomainHistory:
        i = position(key, self.keys)
        motion = self.subdomains[i]
        if motion is None:
            raise KeyError(f"subdomain {self.keys[i][0]!r} was not recorded")
        check_mapping(motion.u)
        return motion

    def __contains__(self, key: Any) -> bool:
        """Whether there is a subdomain of this name, number or object."""
        try:
            position(key, self.keys)
        except LookupError:
            return False
        return True

    if not TYPE_CHECKING:  # a checker refuses by itself what is not there

        def __getattr__(self, name):
            of_one = name in SubdomainHistory.__dataclass_fields__
            where = f"; each subdomain has: history[name].{name}" if of_one else ""
            raise AttributeError(f"a History has no {name!r}{where}", name=name, obj=self)

    @property
    def contacts(self) -> Contacts:
        """What was recorded of contacts.

        ``contacts[joint]``, ``contacts["joint"]`` or ``contacts[0]`` is a `ContactHistory`.
        """
        return recorded_contacts(self)

    def contact_fields(
        self, structure: Any, subdomain: str | int | Subdomain, *, reduced: Any = None
    ) -> dict[str, np.ndarray]:
        """Contacts at the nodes of a mesh, for ParaView: ``data=`` of `export.write_series`.

        `Cut.export` writes these fields by itself.

        Parameters
        ----------
        structure : Structure
            The mesh of the subdomain.
        subdomain : str, int or Subdomain
            Its dofs are all of the mesh, or have their names.
        reduced : Reduction, optional
            Which dofs of the mesh it has, where neither is so.

        Returns
        -------
        dict of (k, N) ndarray
            At the times of ``history[subdomain]``: "contact", 0 at nodes without, 1 open, 2 where a
            row has pushed since the time before; "gap"; "contact impulse" since then, and the mean
            "contact force"; "slip", the relative displacement along one tangent, or its length
            along two. Impulses of a row are given to its nodes by its entries; gap and slip are
            those of the row that reaches the node most, 0 without contact.

        Raises
        ------
        KeyError, ValueError
            For a History from a file, dofs that are not of the mesh, and times or dofs that were
            not recorded.

        Examples
        --------
        A plate that falls on the ground:

        >>> from pmalpha import structures
        >>> mesh = structures.plate(2, 1, 1.0, E=100.0, nu=0.0, rho=1.0, mass="lumped")
        >>> plate = mesh.subdomain(scheme=Newmark(), force=np.tile([0.0, -1.0], 6), name="plate")
        >>> ground = contact(plate, ["uy 0", "uy 1", "uy 2"], gap=0.01)
        >>> history = Coupler([plate], ground, dt=0.01).run(0.5)
        >>> history.contact_fields(mesh, "plate")["contact"].max(axis=0).tolist()
        [2.0, 2.0, 2.0, 0.0, 0.0, 0.0]
        """
        return contact_fields(self, structure, subdomain, reduced)

    def __len__(self) -> int:
        return len(self.subdomains)

    def __repr__(self) -> str:
        names = ", ".join(repr(s) for s in self.subdomains if s is not None)
        return (
            f"<History t = {self.macro_times[0]:g} .. {self.macro_times[-1]:g}, "
            f"{counted(self.multipliers.shape[1], 'constraint')}; {names}>"
        )

    def _repr_html_(self) -> str:
        return history_html(self)

    # ---- other times -------------------------------------------------------------------------

    def at(self, t: float) -> Instant:
        """All recorded subdomains at one time.

        Parameters
        ----------
        t : float
            Within the run.

        Returns
        -------
        Instant
            ``history.at(t)["frame"].u`` has shape (dofs,). Between two time levels of a subdomain
            u is the cubic Hermite polynomial of u and v there, v its derivative, a linear.

        Raises
        ------
        TypeError, ValueError
            For a t that is not a number, or outside of the run.

        Examples
        --------
        >>> one = Subdomain([1.0], [4.0], scheme=Newmark(), u0=[1.0], dof_names=["top"])
        >>> history = Coupler([one], dt=0.01).run(1.0)
        >>> round(float(history.at(0.5037)[0]["top"].u), 3)  # cos(2 t)
        0.534
        """
        return at(self, t)

    def resampled(self, times: ArrayLike) -> History:
        """All that was recorded at other times, the same for all subdomains.

        Parameters
        ----------
        times : (k,) array_like
            In rising order, within the run.

        Returns
        -------
        History
            Motions as of `at`; multipliers, jumps, gaps, springs and outputs linear between their
            times (of multipliers under "mean" the middles of macro steps). Impulses of contacts are
            those since the time before, 0 at the first, as if evenly spread over their steps: their
            sum is that of the run between the first and the last time. Without energies, and
            without iterations and histories of internal forces.

        Raises
        ------
        TypeError, ValueError
            For times that do not rise, or are outside of the run.

        Examples
        --------
        >>> history = models.split_oscillator(10.0).coupler(0.05, coupling="gc").run(1.0)
        >>> both = history.resampled(np.linspace(0.0, 1.0, 5))
        >>> both["A"].u.shape == both["B"].u.shape == (5, 1)
        True
        """
        result: History = resampled(self, times)
        return result

    def peak(self) -> dict[str, Peak]:
        """The largest absolute values of the recorded subdomains, by name.

        Returns
        -------
        dict of Peak
            ``history.peak()["frame"].u``, of each dof; ``.times["u"]``, when.

        Examples
        --------
        >>> one = Subdomain([1.0], [4.0], scheme=Newmark(), v0=[-1.0], name="one")
        >>> largest = Coupler([one], dt=0.01).run(2.0).peak()["one"]
        >>> largest.u.round(3).tolist(), largest.times["u"].round(2).tolist()  # pi / 4
        ([0.5], [0.79])
        """
        return {s.name: peak(s) for s in self.subdomains if s is not None}

    # ---- the interface -----------------------------------------------------------------------

    @property
    def corrected_multipliers(self) -> np.ndarray:
        """The interface force with an error of fourth order in the macro step, (M13) of the method.

        Multipliers under "macro" have an error of dt^2 / 12 times their second derivative, and
        second differences of them remove it: 4 to 30 times more accurate at the same steps, while
        the error of the own steps remains. Under "mean", whose multipliers are those of the
        middles, the means of two neighbours are corrected, to the same order. Only where no load
        jumps, and far from a motion that begins with a jump: there both leave an alternation.

        Returns
        -------
        (macro time levels, p) ndarray
            At `macro_times`. At t = 0 under "macro" the multiplier itself, which is exact; else the
            first and the last are by one-sided differences, under "mean" by extrapolation.

        Raises
        ------
        ValueError
            Under "gc" and "pm", whose multipliers are those of fine steps; with ``every``, for
            other times, fewer than 3 macro steps (5 under "mean"), and a file of an older version.

        Examples
        --------
        >>> history = models.split_oscillator(10.0).coupler(0.05, coupling="macro").run(2.0)
        >>> history.corrected_multipliers.shape == history.multipliers.shape
        True
        """
        return corrected(self)

    def resolution(self) -> Resolution:
        """How well the macro steps resolve what crosses the interface.

        D is the largest second difference of the multipliers over 12 times the largest multiplier:
        the part of the force that `corrected_multipliers` adds. The errors are those of the
        coupling alone, over the largest displacement: what own steps do is not in them. Loads that
        jump raise D in single steps.

        Returns
        -------
        Resolution
            Has ``.by_group``, by number of the constraint, and ``.largest``. Printed, it is a
            sentence with what D means.

        Raises
        ------
        ValueError
            As `corrected_multipliers`.

        Examples
        --------
        >>> history = models.split_oscillator(10.0).coupler(0.025, coupling="macro").run(20.0)
        >>> history.resolution()
        D = 0.0026: in four periods the coupling errs by up to 3e-4, usually
        """
        return resolution(self)

    # ---- figures -----------------------------------------------------------------------------

    def plot(
        self,
        dofs: Any = None,
        *,
        constraints: Any = None,
        quantity: str = "u",
        title: str | None = None,
        units: Mapping[str, str] | None = None,
        ax: Axes | None = None,
    ) -> Axes:
        """Plot time histories of dofs, the jumps at the interface and the multipliers.

        Panels one above another with a common time axis; without constraints only the panel of the
        dofs, and with ``run(energy=True)`` one of the energies, as `plot_energy`. Long histories
        are drawn as their envelope. A jump that is a rounding error, below 1e-12 of the largest
        recorded velocity or displacement, has no panel but a sentence below the panels that states
        its size; usually that is the velocity jump.

        Parameters
        ----------
        dofs : dict, or int or list of int
            Dofs, one or several, by subdomain, None for all recorded dofs of one; at most 16 in
            total. An int or a list: dofs of the only subdomain. Default: at most four in total, the
            dofs of each subdomain with the largest range and different motion.
        constraints : int or list of int
            Constraints by number, at most 16. Default: at most four, chosen in the same way by
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
            Axes to draw into, without the other panels. Default: a new figure of pyplot.

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
        axes: Axes = outer("time_histories")(
            self, dofs, constraints=constraints, quantity=quantity, title=title, units=units, ax=ax
        )
        return axes

    def plot_energy(self, *, title: str | None = None, ax: Axes | None = None) -> Axes:
        """Plot the energies of a run with ``energy=True``, each summed over the subdomains.

        Kinetic and strain energy, what was dissipated, the works of loads, of constraints that
        prescribe a motion and of contacts, and what the steps have added. What is zero to rounding
        has no curve.

        Parameters
        ----------
        title : str, optional
            Default: none.
        ax : matplotlib.axes.Axes, optional
            Axes to draw into. Default: a new figure of pyplot.

        Returns
        -------
        matplotlib.axes.Axes
            `ax`, or that of the new figure.

        Raises
        ------
        ImportError
            If matplotlib is missing.
        ValueError
            For a run without energies.

        Examples
        --------
        >>> coupler = models.four_dof().coupler(0.05, coupling="pm")
        >>> ax = coupler.run(steps=40, energy=True).plot_energy()
        >>> [line.get_label() for line in ax.lines]
        ['kinetic', 'strain', 'work of constraints', 'added by the steps']
        """
        axes: Axes = outer("energies")(self, title=title, ax=ax)
        return axes

    # ---- files and other libraries -----------------------------------------------------------

    def save(self, path: str | PathLike[str]) -> None:
        """Write the history to a file; `load` reads it back bitwise identically.

        An npz file without pickled objects, which ``numpy.load`` opens too, or HDF5. Written
        atomically; an existing file survives an interrupted save.

        Parameters
        ----------
        path : str or path
            Used as given; no suffix is added. With the suffix ".npz" or none the file is that of
            NumPy, with ".h5" or ".hdf5" it is HDF5, others are refused. In HDF5 the groups are
            called by the subdomains, attributes describe its arrays and their units.

        Raises
        ------
        TypeError, OSError
            For a wrong type of path, and for a file that cannot be written.
        ValueError
            For another suffix, and times, states or multipliers that are not finite, which no run
            records.
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
        write_history(path, self)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> History:
        """Read a History from a file of `save`, or of a run with ``record_to``.

        The file has the names of the subdomains, not the objects: index the History by name or
        number. The arrays of a run with ``record_to`` have all up to the last macro step that the
        run has counted, also during the run and after a kill. Together above 16 MB they are mapped
        and read on access. A file that is replaced meanwhile, as this package does, changes nothing
        of them; one that is truncated in its place by another program must not be used any more:
        ``history[name]`` is an OSError then, and arrays taken before end the process.

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
        return cls(**stored_fields(path, cls, SubdomainHistory))

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
        (quantity, constraint) for ``multipliers`` and ``velocity_jump``. Under "mean" it has the
        multipliers, at the middles of macro steps, and a table "velocity_jump" has these.

        Returns
        -------
        dict of pandas.DataFrame
            With the recorded subdomains in their order.

        Raises
        ------
        ImportError
            If pandas is missing.
        ValueError
            If a subdomain is called "interface", under "mean" also "velocity_jump".
        """
        return frames(self)

    def to_pyvista(self, mesh: Any, t: float | None = None) -> Any:
        """The motion of a cut structure as an unstructured grid of pyvista.

        Parameters
        ----------
        mesh : Cut
            What moves.
        t : float, optional
            As for `Structure.to_pyvista`.

        Returns
        -------
        pyvista.UnstructuredGrid
            That of ``mesh.to_pyvista(self, t)``.
        """
        return mesh.to_pyvista(self, t)

    def to_xarray(self) -> xarray.Dataset:
        """The history as an xarray.Dataset; the arrays are shared, not copied.

        Each recorded subdomain, here "rig", has the variables ``rig_u``, ``rig_v``, ``rig_a`` with
        the coordinates ``rig_time`` and ``rig_dof``, and with recorded springs ``rig_deformation``
        and ``rig_force`` with ``rig_time`` and ``rig_spring``. An output "base shear" is
        ``rig_base shear`` with ``rig_time`` and ``rig_base shear_row``. The interface has
        ``multipliers`` and ``velocity_jump`` with ``multiplier_times`` and ``constraint`` (a row of
        L), and ``displacement_jump`` with ``macro_times`` and ``constraint``; under "mean"
        ``velocity_jump`` has ``macro_times`` too. Contacts have ``contact_impulses`` and
        ``contact_gaps`` with ``contact_row`` and ``contact``. Dofs with names have
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


# ---- multipliers ---------------------------------------------------------------------------------
# Multipliers of a higher order, and how well macro steps resolve what crosses the interface.

# Macro steps are as long as each other up to this part of one.
ROUNDING = 1e-6
# By D, the error of the coupling alone that nine in ten of 160 random runs over four periods did
# not exceed, relative to the largest displacement (error_budgets.py resolution 3000 40).
ERRORS = ((0.003, "3e-4"), (0.01, "2e-3"), (0.03, "2e-2"), (0.1, "0.2"))


@dataclass(frozen=True, repr=False)
class Resolution:
    """How well macro steps resolve the multipliers, from `History.resolution`; printed, a sentence.

    Attributes
    ----------
    by_group : dict of float
        By number of the constraint of the coupler, in their order, D of its rows: the largest
        (M13) correction in the run over the largest multiplier.
    """

    by_group: dict[int, float]

    @property
    def largest(self) -> float:
        """The largest of all; 0 without constraints."""
        return max(self.by_group.values(), default=0.0)

    def __repr__(self) -> str:
        if not self.by_group:
            return "no constraints, no error of a coupling"
        D = self.largest
        worst = max(self.by_group, key=self.by_group.__getitem__)
        where = f" in constraint {worst}" if len(self.by_group) > 1 else ""
        error = next((text for limit, text in ERRORS if limit > D), None)
        if error is None:
            return f"D = {D:.2g}{where}: macro steps do not resolve the coupling, take shorter ones"
        return f"D = {D:.2g}{where}: in four periods the coupling errs by up to {error}, usually"


def corrected(history: Any) -> np.ndarray:
    """(M13), (macro time levels, p)."""
    lam = at_levels(history, "corrected_multipliers")
    second = second_differences(lam)
    if history.coupling == "mean":
        second[[1, -2]] = second[[2, -3]]
    result = lam + second / _sign(history)
    if history.coupling == "mean":
        for rows in (result[:4], result[:-5:-1]):  # quadratic in the level
            rows[0] = 3.0 * rows[1] - 3.0 * rows[2] + rows[3]
    elif history.macro_times[0] == 0.0:
        result[0] = lam[0]  # of the initial accelerations: exact
    return result


def _sign(history: Any) -> float:
    """The means of (M10) leave the multipliers of "macro" too small by this part of their second
    difference, and the means of neighbours of "mean" too large."""
    return -12.0 if history.coupling == "mean" else 12.0


def at_levels(history: Any, call: str) -> np.ndarray:
    """The multipliers at macro time levels; under "mean" means of the two middles about them."""
    if history.coupling not in ("macro", "mean"):
        raise ValueError(
            f'{call} needs a run with coupling "macro" or "mean", got {history.coupling!r}'
        )
    lengths = np.diff(history.macro_times)
    least = 5 if history.coupling == "mean" else 3
    if history.dt is None or np.any(np.abs(lengths - history.dt) > ROUNDING * history.dt):
        raise ValueError(
            f"{call} needs the multipliers of every macro step, of one length, got a History with "
            "every=, of other times, of steps that changed, or of an older version"
        )
    if len(lengths) < least:
        raise ValueError(f"{call} needs at least {least} macro steps, got {len(lengths)}")
    lam: np.ndarray = history.multipliers
    if history.coupling == "macro":
        return lam
    out = np.empty_like(lam)
    out[1:-1] = 0.5 * (lam[1:-1] + lam[2:])
    out[0] = 2.0 * out[1] - out[2]
    out[-1] = 2.0 * out[-2] - out[-3]
    return out


def second_differences(x: np.ndarray) -> np.ndarray:
    """Of all rows; that of the first and the last is the one of its neighbour."""
    out = np.empty_like(x)
    out[1:-1] = x[2:] - 2.0 * x[1:-1] + x[:-2]
    out[0], out[-1] = out[1], out[-2]
    return out


def resolution(history: Any) -> Resolution:
    """D by constraint."""
    lam = at_levels(history, "resolution")
    ends = np.cumsum(history.constraint_rows or (lam.shape[1],))
    size = np.abs(second_differences(lam)).max(axis=0) / 12.0
    largest = np.abs(lam).max(axis=0)
    by_group = {}
    for i, (first, last) in enumerate(zip((0, *ends[:-1]), ends)):
        most = largest[first:last].max(initial=0.0)
        by_group[i] = float(size[first:last].max() / most) if most > 0.0 else 0.0
    return Resolution(by_group if lam.shape[1] else {})
