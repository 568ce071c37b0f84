"""The recorded motion of one subdomain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from .._checks import counted
from .._rooms import outer
from .conversion import subdomain_dataset, subdomain_frame
from .quantities import OF_INTERFACE
from .stored import write_history
from .times import (
    DofMotion,
    Peak,
    State,
    columns_of,
    label_of,
    local_error,
    one_time,
    peak,
    resampled_one,
    rising,
    state,
)

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes


__all__ = ["SubdomainHistory"]


@dataclass(frozen=True)
class RigRecord:
    """What a structure and its specimens behind actuators and compensators told each other.

    Of several specimens in one subdomain the columns follow each other.

    Attributes
    ----------
    t : (k,) array
        Times of the time levels.
    command : (k, n) array
        The predictor at the dofs of the specimen.
    sent : (k, n) array
        What compensators and linkages make of it: the command of the (simulated) actuators.
    measured, force : (k, n) arrays
        Displacements that were measured, and forces, at the dofs.
    """

    t: np.ndarray
    command: np.ndarray
    sent: np.ndarray
    measured: np.ndarray
    force: np.ndarray


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
        Displacement, velocity and true acceleration (w of the equations); with contacts a is that
        between impacts, without the mean M^-1 N^T force of `ContactHistory` over the step.
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
        of its beginning and its end together, under "macro" those of all passes. None of an
        explicit subdomain and without ``Subdomain(internal=)``.
    q : (k, m) array, or None
        The history of the internal forces. None without ``InternalForce(evaluate, history)``, and
        where only some dofs are recorded: leave out those of ``run(record=)``.
    rig_command, rig_sent, rig_measured, rig_force : (k, commands) arrays, or None
        With ``rig=True``, those of `rig`.
    substep : float or None
        The length h of its substeps; None where it changed in the History, of a scheme of two
        stages, whose lengths differ, and for one from a file of an older version.
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
    rig_command: np.ndarray | None = None
    rig_sent: np.ndarray | None = None
    rig_measured: np.ndarray | None = None
    rig_force: np.ndarray | None = None
    n: int | None = None
    dof_names: Sequence[str] | None = None

    @property
    def rig(self) -> RigRecord | None:
        """Commands to the specimen and what came back, with ``run(rig=True)``, else None."""
        names = "command", "sent", "measured", "force"
        arrays = {name: getattr(self, f"rig_{name}") for name in names}
        if any(x is None for x in arrays.values()):
            return None
        return RigRecord(self.t, **arrays)

    def __getitem__(self, key: int | str) -> DofMotion:
        (j,) = columns_of(key, self.dofs, self.n, self.dof_names, f"dof of {self.name!r}", one=True)
        name = label_of(self.dofs, self.dof_names, j)
        return DofMotion(name, self.u[:, j], self.v[:, j], self.a[:, j], self.t)

    def __iter__(self) -> NoReturn:  # else dof after dof up to an error
        raise TypeError("a SubdomainHistory has dofs by name or number: take its u, v or a")

    def at(self, t: float) -> State:
        """The motion at one time of the run, as `History.at`, whose errors it raises.

        Parameters
        ----------
        t : float
            Within the run.

        Returns
        -------
        State
            With ``.u``, ``.v`` and ``.a``, (dofs,); ``["roof"]`` is one dof.

        Examples
        --------
        >>> one = solve(Subdomain([1.0], [4.0], scheme=Newmark(), v0=[-1.0]), dt=0.01, t_end=1.0)
        >>> one.at(0.123).u.round(4).tolist()  # -sin(0.246) / 2
        [-0.1218]
        """
        return state(self, one_time(t, self.t))

    def resampled(self, times: Any) -> SubdomainHistory:
        """The motion at other times of the run, as `History.resampled`, whose errors it raises.

        Parameters
        ----------
        times : (k,) array_like
            In rising order.

        Returns
        -------
        SubdomainHistory
            With these times as ``.t``.
        """
        result: SubdomainHistory = resampled_one(self, rising(times, self.t)[1])
        return result

    def peak(self) -> Peak:
        """The largest absolute values, as `History.peak` has them by subdomain.

        Returns
        -------
        Peak
            With ``.u``, ``.v``, ``.a`` and ``.times``; ``["roof"]`` is one dof.
        """
        return peak(self)

    def local_error(self) -> np.ndarray:
        """Estimate of the displacement error that each step adds, from recorded u, v and a.

        Returns
        -------
        (k - 1, dofs) array
            Row i is for the step that ends at ``t[i + 1]``, in the unit of u: equation (D1),
            :math:`e = u_1 - [u + h v + h^2 (2 w + w_1) / 6]`, of order h^3. A double step begins
            two time levels before its end; NaN where that level was before the beginning of the
            run.

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
        alone = OneSubdomain(self)
        axes: Axes = outer("time_histories")(
            alone, dofs, quantity=quantity, title=title, units=units, ax=ax
        )
        return axes

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
        write_history(path, OneSubdomain(self))

    def to_pyvista(self, mesh: Any, t: float | None = None) -> Any:
        """The motion of a mesh as an unstructured grid of pyvista.

        Parameters
        ----------
        mesh : Structure or Cut
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

    def __repr__(self) -> str:
        levels, dofs = counted(self.t.size, "time level"), counted(self.dofs.size, "dof")
        outputs = f", {counted(len(self.outputs), 'output')}" if self.outputs else ""
        return f"<{self.name!r}: {levels}, {dofs}{outputs}>"


class OneSubdomain:
    """What a History of one subdomain has, without constraints."""

    coupling = energy = dt = None
    contact_layout = warnings = constraint_rows = ()

    def __init__(self, motion: SubdomainHistory):
        arrays = {"": motion.t, "constraints": np.empty((motion.t.size, 0))}
        self.subdomains, self.keys = (motion,), ((motion.name, None),)
        for name, quantity in OF_INTERFACE.items():
            setattr(self, name, arrays.get(quantity.columns))

    def __getitem__(self, i: int) -> SubdomainHistory:
        return self.subdomains[i]

    def __len__(self) -> int:
        return 1
