"""The subdomains of a cut structure, and the way back."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from .._checks import counted, sampling_step
from .._tables import html_table, text_table
from ..export import write_series
from ..gradients.parameters import Parameters
from ..plot.meshes import deformed
from ..problem.constraints import Constraint
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from ..results.contact import nodal_fields
from ..results.history import History, SubdomainHistory
from ..results.quantities import position
from ..run.coupler import Coupler
from ..structures.stress import grid_of
from ..structures.structure import Structure
from .division import Division, checked_levels
from .plan import Plan, plan_of
from .whole import factors, whole_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes


__all__ = ["Cut"]

# Subdomains that repr lists.
MOST_ROWS = 16
# Up to this number of dofs repr makes the plan.
QUICK = 100_000


HEADINGS = ("subdomain", "dofs", "interface dofs", "scheme", "substeps")


@dataclass(frozen=True, eq=False, repr=False)
class Cut:
    """Subdomains of a structure, made by `cut`.

    Attributes
    ----------
    structure : Structure, Elements, or list of Elements
        What was cut.
    subdomains : tuple of Subdomain
    constraints : list of Constraint
        The ties: one Constraint with a row for each dof and each of its subdomains but one, +1 on
        the first and -1 on the other one; empty where no dof is shared.
    labels : (elements,) array of int
        The index in `subdomains` of the subdomain of each element.
    dt : float or None
        The macro step for which the numbers of substeps were chosen.
    choices : dict of Plan by name
        What ``parts="auto"`` compared; else empty.

    Examples
    --------
    >>> from pmalpha import structures
    >>> wall = structures.plate(8, 4, 0.5, E=30e9, nu=0.2, rho=2500.0, mass="lumped")
    >>> left = wall.points[wall.elements["quad"], 0].mean(axis=1) < 2.0
    >>> halves = cut(wall, np.where(left, 0, 1), fixed=wall.dofs(wall.nodes_at(y=0.0)))
    >>> halves.constraints
    [<8 constraints on 'part 0' and 'part 1'>]
    >>> history = halves.coupler(dt=1e-4, coupling="gc").run(steps=3)
    >>> halves.gather(history).u.shape
    (4, 90)
    """

    structure: Any
    labels: np.ndarray
    subdomains: tuple[Subdomain, ...]
    constraints: list[Constraint]
    dt: float | None
    choices: dict[str, Plan]
    _uncut: tuple[Scheme, int] | None
    _division: Division

    def _repr_html_(self) -> str:
        what = f"Cut into {counted(len(self.subdomains), 'subdomain')}, "
        rows = [
            (str(s.name), str(s.n), str(int(interface.sum())), repr(s.scheme), str(s.substeps))
            for s, interface in zip(self.subdomains, self._division.interface)
        ]
        left = len(rows) - MOST_ROWS
        rest = f"<p>... {left} more</p>" if left > 0 else ""
        plan = f"<p>{escape(self.plan().summary)}</p>" if self._is_quick else ""
        table = html_table(HEADINGS, rows[:MOST_ROWS], ("subdomain", "scheme"))
        return f"<p>{what}{counted(self.p, 'constraint')}</p>{table}{rest}{plan}"

    def __repr__(self) -> str:
        rows = [
            (
                str(s.name),
                counted(s.n, "dof"),
                counted(int(interface.sum()), "interface dof"),
                repr(s.scheme),
                counted(s.substeps, "substep"),
            )
            for s, interface in zip(self.subdomains, self._division.interface)
        ]
        shown = rows[:MOST_ROWS]
        lines = text_table(shown[0], shown[1:], left=shown[0]).split("\n")
        if len(rows) > MOST_ROWS:
            lines.append(f"... ({len(rows)} in all)")
        if self._is_quick:
            lines.append(self.plan().summary)
        what = f"<Cut into {counted(len(rows), 'subdomain')}, {counted(self.p, 'constraint')}"
        return "\n  ".join([what, *lines]) + ">"

    @property
    def _is_quick(self) -> bool:
        """Whether a plan can be shown at once."""
        return self.dt is not None and self.n <= QUICK

    @property
    def p(self) -> int:
        """Number of constraints."""
        return sum(constraint.p for constraint in self.constraints)

    @property
    def n(self) -> int:
        """Number of dofs of the uncut structure, the fixed ones included."""
        return self._division.n

    @property
    def dofs(self) -> dict[str, np.ndarray]:
        """By name of a subdomain the uncut dofs of its dofs."""
        return dict(zip(self._names, self._division.dofs))

    @property
    def _names(self) -> list[str]:
        return [str(s.name) for s in self.subdomains]

    def parameters(self, labels: Any = None, *, scales: str = "stiffness") -> list[Parameters]:
        """Factors of the stiffness, mass or thickness of elements, for `Coupler.gradient`.

        An element belongs to one subdomain, a label to several: each subdomain has all factors,
        and the gradient with respect to them is the sum of those of the subdomains.

        Parameters
        ----------
        labels, scales : optional
            As for `element_parameters`, for all elements of the structure.

        Returns
        -------
        list of Parameters
            One for each subdomain, with the same labels.

        Raises
        ------
        ValueError
            For bad labels, and internal forces.

        Examples
        --------
        >>> from pmalpha import structures
        >>> wall = structures.plate(8, 4, 0.5, E=30e9, nu=0.2, rho=2500.0)
        >>> halves = cut(wall, np.repeat([0, 1], 16), fixed=wall.dofs(wall.nodes_at(y=0.0)))
        >>> halves.parameters(np.tile(["lower", "upper"], 16))
        [<Parameters of 'part 0': 2 by K>, <Parameters of 'part 1': 2 by K>]
        """
        fixed = np.ones(self.n, bool)
        fixed[self._division.present] = False
        model = whole_of(self.structure, fixed, None)
        tags = np.zeros(model.count, int) if labels is None else labels
        return [
            factors(model, s, dofs, self.labels == i, tags, scales)
            for i, (s, dofs) in enumerate(zip(self.subdomains, self._division.dofs))
        ]

    def coupler(self, dt: float | None = None, **options: Any) -> Coupler:
        """A Coupler of the subdomains with their ties.

        Parameters
        ----------
        dt : float, optional
            The macro step. Default: the one for which the cut was made.
        **options
            Further arguments of `Coupler`: coupling, required unless there is one part, threads,
            ...

        Returns
        -------
        Coupler
            Of all subdomains and ties.

        Raises
        ------
        TypeError
            Without dt, if the cut was made without one; from `Coupler`.
        """
        step = self.dt if dt is None else dt
        if step is None:
            raise TypeError("dt must be given here or to cut")
        return Coupler(self.subdomains, self.constraints, dt=step, **options)

    def plan(self, dt: float | None = None) -> Plan:
        """What a macro step will cost, predicted from sizes; nothing is factored.

        Parameters
        ----------
        dt : float, optional
            The macro step, to compare the steps with the critical ones; the numbers of substeps are
            those of the cut. Default: the one for which the cut was made.

        Returns
        -------
        Plan
            A table of the costs.

        Raises
        ------
        TypeError, ValueError
            Without dt, if the cut was made without one; for one that is not positive.

        Examples
        --------
        >>> from pmalpha import structures
        >>> masses = structures.chain(6, 1.0, 4.0)
        >>> cut(masses, parts=2).plan(dt=0.1).entries > 0
        True
        """
        step = self.dt if dt is None else sampling_step(dt, "dt")
        if step is None:
            raise TypeError("dt must be given here or to cut")
        return plan_of(self, step)

    def scatter(self, u: Any) -> dict[str, np.ndarray]:
        """Values of the uncut dofs, by subdomain.

        Parameters
        ----------
        u : (..., n) array_like
            Displacements or velocities; not forces, which have to be divided.

        Returns
        -------
        dict of (..., n_i) arrays by name
            Copies.

        Raises
        ------
        TypeError, ValueError
            For values that are not finite numbers, and another number of dofs.

        Examples
        --------
        >>> from pmalpha import structures
        >>> parts = cut(structures.chain(3, 1.0, 2.0), [0, 1])
        >>> {name: u.tolist() for name, u in parts.scatter([1.0, 2.0, 3.0]).items()}
        {'part 0': [1.0, 2.0], 'part 1': [2.0, 3.0]}
        """
        return dict(zip(self._names, self._division.scatter(checked_levels(u, self.n))))

    def gather(self, history: History) -> SubdomainHistory:
        """The motion of the uncut structure.

        Parameters
        ----------
        history : History
            Of a run with all dofs of all subdomains recorded.

        Returns
        -------
        SubdomainHistory
            On all dofs of the uncut structure at the recorded macro times. Fixed dofs are zero. On
            dofs of several subdomains, whose displacements can drift apart under "pm" and "gc", the
            mean weighted by their masses.

        Raises
        ------
        TypeError, ValueError
            For what is not a History of these subdomains with all dofs.

        Examples
        --------
        >>> from pmalpha import structures
        >>> parts = cut(structures.chain(3, 1.0, 2.0), [0, 1], v0=[0.0, 0.0, 1.0])
        >>> parts.gather(parts.coupler(dt=0.1, coupling="pm").run(steps=2)).v[0].tolist()
        [0.0, 0.0, 1.0]
        """
        if not isinstance(history, History):
            raise TypeError(f"history must be a History, got {history!r}")
        motions = [self._recorded(history, name) for name in self._names]
        t = np.asarray(history.macro_times)
        rows = [np.searchsorted(np.asarray(one.t), t) for one in motions]
        for one, at in zip(motions, rows):
            if at.max(initial=0) >= len(one.t) or np.any(np.asarray(one.t)[at] != t):
                raise ValueError(f"history must have all macro times, not those of {one.name!r}")
        u, v, a = (
            self._division.gather([getattr(one, x) for one in motions], rows)
            for x in ("u", "v", "a")
        )
        names = getattr(self.structure, "dof_names", None)
        return SubdomainHistory(
            name="uncut", t=t, u=u, v=v, a=a, dofs=np.arange(self.n), n=self.n, dof_names=names
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """The mesh, each subdomain in a colour of its own: the more substeps, the darker.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Default: those of a new figure of pyplot.

        Returns
        -------
        matplotlib.axes.Axes
            With a legend of names and substeps for up to 12 subdomains.

        Raises
        ------
        ImportError
            If matplotlib is missing.
        ValueError
            For `Elements`, which have no mesh.

        Examples
        --------
        >>> from pmalpha import structures
        >>> halves = cut(structures.plate(4, 2, 0.5, E=1.0, nu=0.3, rho=1.0), parts=2)
        >>> [text.get_text() for text in halves.plot().get_legend().get_texts()]
        ['part 0, 1 substep', 'part 1, 1 substep']
        """

        return drawn(self, self._mesh("plot"), ax)

    def export(
        self, path: str | PathLike[str], history: History | SubdomainHistory, **options: Any
    ) -> None:
        """Write the motion of the uncut structure for ParaView, with the subdomains.

        Parameters
        ----------
        path : str or path
            As for `pmalpha.export.write_series`.
        history : History or SubdomainHistory
            As for `gather`, or what it has returned.
        **options
            Further arguments of `write_series`. Elements have the numbers "part" and "substeps",
            nodes the fields of `History.contact_fields` where a History has contacts.

        Raises
        ------
        TypeError, ValueError, OSError
            As of `gather` and `write_series`; for `Elements`, which have no mesh.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> from pmalpha import structures
        >>> halves = cut(structures.plate(4, 2, 0.5, E=1.0, nu=0.3, rho=1.0), parts=2)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder, "run.xdmf")
        ...     halves.export(path, halves.coupler(dt=0.1, coupling="pm").run(steps=2))
        ...     '"part"' in path.read_text()
        True
        """
        structure = self._mesh("export")
        motion = history if isinstance(history, SubdomainHistory) else self.gather(history)
        cells = self._numbers() | options.pop("cells", {})
        if isinstance(history, History):
            options["data"] = self._contacts(history, motion.t) | (options.get("data") or {})
        fields = (motion.t, motion.u, motion.v, motion.a)
        write_series(path, structure.points, structure.elements, *fields, cells=cells, **options)

    def _contacts(self, history: History, times: np.ndarray) -> dict[str, np.ndarray]:
        """Fields of contacts at the nodes of the uncut mesh; a file has not the rows for them."""
        layout = history.contact_layout
        if not layout or any(x.contact is None for x in layout):
            return {}
        count = len(self.structure.points)
        nodes = {
            position(name, history.keys): dofs // (self.n // count)
            for name, dofs in self.dofs.items()
        }
        return nodal_fields(history, nodes, count, times)

    def to_pyvista(self, motion: Any = None, t: float | None = None) -> Any:
        """The uncut mesh as an unstructured grid of pyvista, with its subdomains.

        Parameters
        ----------
        motion : History, SubdomainHistory or (n,) array_like, optional
            A History of the subdomains, what `gather` has returned, or displacements.
        t : float, optional
            As for `Structure.to_pyvista`.

        Returns
        -------
        pyvista.UnstructuredGrid
            As of `Structure.to_pyvista`; the cells have "part" and "substeps".

        Raises
        ------
        ImportError
            Without pyvista.
        TypeError, ValueError
            As of `gather` and `Structure.to_pyvista`; for `Elements`, which have no mesh.
        """
        field = self.gather(motion) if isinstance(motion, History) else motion
        return grid_of(self._mesh("to_pyvista"), field, t, self._numbers())

    def _numbers(self) -> dict[str, np.ndarray]:
        substeps = np.array([s.substeps for s in self.subdomains])
        return {"part": self.labels, "substeps": substeps[self.labels]}

    def _mesh(self, what: str) -> Structure:
        if not isinstance(self.structure, Structure):
            raise ValueError(f"{what} needs a Structure with a mesh, got {self.structure!r}")
        return self.structure

    def _recorded(self, history: History, name: str) -> SubdomainHistory:
        try:
            one = history[name]
        except KeyError:
            raise ValueError(f"history must have a subdomain {name!r}, got {history!r}") from None
        size = self._division.dofs[self._names.index(name)].size
        if not np.array_equal(one.dofs, np.arange(size)):
            raise ValueError(
                f"history must have all {counted(size, 'dof')} of {name!r}, got {len(one.dofs)}"
            )
        return one


# ---- drawing ------------------------------------------------------------------------------------
# The picture of a cut.

# Subdomains that a legend lists.
LEGEND = 12


def drawn(cut: Any, structure: Structure, ax: Axes | None) -> Axes:
    colours = _colours(np.array([s.substeps for s in cut.subdomains]))
    for i, (s, colour) in enumerate(zip(cut.subdomains, colours)):
        points, elements = _submesh(structure, cut.labels == i)
        label = f"{s.name}, {counted(s.substeps, 'substep')}"
        if s.name == counted(s.substeps, "substep"):
            label = s.name
        ax = deformed(
            points,
            elements,
            np.zeros(points.shape),
            scale=1.0,
            color=colour,
            label=label if len(cut.subdomains) <= LEGEND else None,
            ax=ax,
        )
    assert ax is not None
    ax.set_title("", loc="right")
    return ax


def _submesh(structure: Structure, chosen: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Points and elements of the chosen elements of all kinds."""
    ends = np.cumsum([len(e) for e in structure.elements.values()])[:-1]
    kinds = zip(structure.elements.items(), np.split(chosen, ends))
    elements = {kind: nodes[mask] for (kind, nodes), mask in kinds if mask.any()}
    used = np.unique(np.concatenate([nodes.ravel() for nodes in elements.values()]))
    number = np.zeros(len(structure.points), dtype=np.int64)
    number[used] = np.arange(used.size)
    return structure.points[used], {kind: number[nodes] for kind, nodes in elements.items()}


def _colours(substeps: np.ndarray) -> np.ndarray:
    """(k, 4): by substeps from light to dark; of subdomains with equal ones different hues."""
    from matplotlib import colormaps

    if np.unique(substeps).size == substeps.size:
        ranks = np.argsort(np.argsort(substeps))
        return np.array(colormaps["viridis"](np.linspace(0.95, 0.1, substeps.size)[ranks]))
    shade = 1.0 - 0.5 * np.log2(substeps) / max(1.0, np.log2(substeps.max()))
    hues = colormaps["tab20"](np.arange(substeps.size) % 20)
    return np.column_stack([hues[:, :3] * shade[:, None], hues[:, 3]])
