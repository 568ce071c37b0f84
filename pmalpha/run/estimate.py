"""The error of a run, by the same run with shorter steps: `Coupler.estimate_error`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import update_wrapper
from typing import Any

import numpy as np
from scipy import LowLevelCallable

from .._checks import MOST, real_number, whole_number
from ..errors import AccuracyWarning, silent, warn
from ..memory import require
from ..problem.device import Device
from ..problem.loads import is_function
from ..problem.restoring import items_of
from ..problem.springs import Spring
from ..results.history import History
from ..results.times import Clock
from ..setup.ranks import remade
from .progress import Report, reporting
from .session import Session, require_alone, require_possible

# ---- repeated -----------------------------------------------------------------------------------
# Functions of the user in runs that are repeated: they must return the same again.

# Relative difference of two values of a function without memory: rounding of another order of
# summation.
SAME = 1e-9


class Repeated:
    """A function of the user, of which some calls of the first run are evaluated again after it.

    what: its name in messages, such as "restoring of subdomain 'rig'".
    """

    def __init__(self, function: Callable[..., Any], what: str):
        update_wrapper(self, function, updated=())  # keeps the signature
        self.function, self.what = function, what
        self.count: int | None = 0  # of calls in the first run, then None
        self.calls: list[tuple[list[Any], list[np.ndarray]]] = []  # of calls 1, 2, 4, 8, ...

    def __call__(self, *arguments: Any) -> Any:
        if self.count is None:
            return self.function(*arguments)
        self.count += 1
        if self.count & (self.count - 1):
            return self.function(*arguments)
        copies = [copy(x) for x in arguments]  # the function may change them
        value = self.function(*arguments)
        self.calls.append((copies, _arrays(value)))
        return value

    def check(self) -> None:
        """ValueError unless it returns the same again, from the last call that was kept to the
        first: what remembers has another past then."""
        self.count = None
        while self.calls:
            arguments, values = self.calls.pop()
            again = _arrays(self.function(*arguments))
            if not all(map(_is_same, again, values)):
                raise ValueError(
                    f"{self.what} must return the same in each run, got {again[0]} after "
                    f"{values[0]} for the same arguments: it has a memory, or is random. Springs, "
                    "and internal= with a history, have a memory that is known; a function that "
                    "begins anew at t = 0 may say so by the attribute repeatable = True"
                )


def _arrays(value: Any) -> list[np.ndarray]:
    """A value, or several of a tuple, as copies."""
    return [np.array(x) for x in (value if isinstance(value, tuple) else (value,))]


def _is_same(a: np.ndarray, b: np.ndarray) -> bool:
    if a.shape != b.shape or a.dtype.kind not in "biuf":
        return a.shape == b.shape
    size = float(np.max(np.abs(b), initial=0.0))
    return float(np.max(np.abs(a - b), initial=0.0)) <= SAME * size


class RepeatedFunctions:
    """The functions of the user in one problem, each wrapped once."""

    def __init__(self) -> None:
        self.known: dict[int, Repeated] = {}

    def check(self) -> None:
        """ValueError for one that does not return the same again, after the first run."""
        for function in self.known.values():
            function.check()

    def of(self, function: Any, what: str) -> Any:
        """The same, wrapped where it is a Python function that may have a memory."""
        if not is_function(function):
            return function
        if stated(function) is True:
            return function
        if id(function) not in self.known:
            self.known[id(function)] = Repeated(function, what)
        return self.known[id(function)]

    def of_restoring(self, restoring: Any, name: str) -> Any:
        """A restoring force with its functions wrapped."""
        what = f"restoring of subdomain {name!r}"
        items = [self._item(item, what) for item in items_of(restoring)]
        return items or None

    def _item(self, item: Any, what: str) -> Any:
        if isinstance(item, Device):
            moved = copy(item)
            moved.max_steps = MOST  # checked with the steps of the coupler, which are halved here
            if not isinstance(item.specimen, tuple) or isinstance(item.specimen, LowLevelCallable):
                moved.specimen = self._item(item.specimen, what)
            return moved
        return item if isinstance(item, Spring) else self.of(item, what)


def require_repeatable(session: Session, call: str) -> None:
    """ValueError for what says that it cannot be repeated, ``repeatable = False``."""
    for name, s in session.keys:
        for item in items_of(s.restoring):
            function = item.innermost if isinstance(item, Device) else item
            _require(function, f"restoring of subdomain {name!r}", call)
    for (name, _), force in zip(session.keys, session.loads.forces):
        _require(force, f"force of subdomain {name!r}", call)
    for motion in session.loads.motions:
        _require(motion.velocity, motion.what, call)
    contacts = session.rows.contacts
    for label, c in () if contacts is None else zip(contacts.names, contacts.contacts):
        for f in c.motion if isinstance(c.motion, tuple) else (c.motion,):
            _require(f, f"motion of {label!r}", call)


def _require(function: Any, what: str, call: str) -> None:
    if stated(function) is False:
        raise ValueError(
            f"{call} repeats the run: {what} must be a function in this program, got {function!r}, "
            "which says that it cannot be repeated (repeatable = False)"
        )


def stated(function: Any) -> bool | None:
    """What a function, or the object that it is a method of, says of itself."""
    statement = getattr(function, "repeatable", None)
    result: bool | None = getattr(getattr(function, "__self__", None), "repeatable", statement)
    return result


# ---- error estimate -----------------------------------------------------------------------------

__all__ = ["ErrorEstimate"]

# Bytes of the motion of a finer run that exists at a time.
PIECE = 16_000_000
# Numbers that a run records of each dof at a time level: u, v and a.
RECORDED = 3
# Below this part of the largest displacement, a difference of two runs is rounding.
ROUNDING = 1e-11
# Observed order from which on the runs converge.
LEAST_ORDER = 0.5
# Error from which on the step for one of 1 per cent is printed: not far from the present step.
FAR = 1e-3
# The smallest error for which there is a step.
SMALLEST = 1e-300
# Most by which `dt_for` changes the step: an observed order reaches no further.
REACH = 4.0


def __dir__() -> list[str]:
    return sorted(__all__)


@dataclass(frozen=True, repr=False)
class ErrorEstimate:
    """The estimated error of a run, from `Coupler.estimate_error`.

    Printed, it is a sentence.

    Attributes
    ----------
    relative : float
        The largest estimated error of a displacement, of any dof at any time level of the run,
        divided by the largest displacement of the structure. Where the runs do not converge, the
        difference of the first two.
    by_subdomain : dict of float
        The largest error in each subdomain, by name, divided by the same.
    place : (str, int or str, float)
        Where it is largest: subdomain, dof or its name, time.
    order : float
        The observed order of convergence at the dof of `place`, with ``halvings=2``; else, and
        where the runs differ by rounding only, nan.
    dt : float
        The macro step of the run.
    history : History
        The run.
    assumed_order : float
        That of the coupling, which is taken where none is observed: 1 for "gc" and "pm" with
        different numbers of substeps, otherwise 2.

    Examples
    --------
    The trapezoidal rule delays this oscillator by (omega dt)^2 / 12 of the time; at t = 10, where
    the phase is 20, the error is 0.067 sin(20):

    >>> mass = Subdomain([1.0], [4.0], scheme=Newmark(), u0=[1.0], name="mass")
    >>> found = Coupler([mass], dt=0.1).estimate_error(10.0, halvings=2)
    >>> bool(abs(found.relative / 0.061 - 1.0) < 0.05), round(found.order, 1)
    (True, 2.0)
    """

    relative: float
    by_subdomain: dict[str, float]
    place: tuple[str, int | str, float]
    order: float
    dt: float
    history: History = field(compare=False)
    assumed_order: float

    @property
    def converges(self) -> bool:
        """Whether the observed order is at least 0.5; True where none was observed."""
        return not self.order < LEAST_ORDER

    def dt_for(self, relative: float = 0.01) -> float:
        """The macro step with which the error would be this large.

        Parameters
        ----------
        relative : float, default 0.01
            The error, like `relative`.

        Returns
        -------
        float
            From the observed order, else from that of the coupling; nan where the runs do not
            converge. At least a quarter of `dt` and at most four times as much, with a warning
            where that is the bound: make another estimate there.

        Raises
        ------
        TypeError, ValueError
            For a number that is not positive.

        Warns
        -----
        AccuracyWarning
            Where the step would be more than four times as long or short as `dt`.
        """
        target = real_number(relative, "relative", low=SMALLEST)
        step, bound = self._step_for(target)
        if bound:
            what = "no error was found" if self.relative == 0.0 else f"{_percent(self.relative)}"
            warn(
                f"dt_for: an error of {_percent(target)} is too far from that of the run, {what}: "
                f"the step is {bound}, {step:.3g}; make another estimate there",
                AccuracyWarning,
            )
        return step

    def _step_for(self, target: float) -> tuple[float, str]:
        """The macro step, and the bound that it is, in words, or empty."""
        if not self.converges:
            return float("nan"), ""
        order = self.assumed_order if np.isnan(self.order) else self.order
        ratio = (target / self.relative) ** (1.0 / order) if self.relative > 0.0 else np.inf
        bound = "at most 4 dt" if ratio > REACH else "at least dt / 4" if ratio < 1 / REACH else ""
        return float(self.dt * min(max(ratio, 1.0 / REACH), REACH)), bound

    def __repr__(self) -> str:
        name, dof, t = self.place
        if self.relative == 0.0:
            return f"error 0, the runs with dt = {self.dt:g} and half of it are equal"
        dof = f"dof {dof}" if isinstance(dof, int) else repr(dof)
        size = f"{_percent(self.relative)} of the largest displacement"
        where = f"at {dof} of {name!r}, t = {t:.4g}"
        if not self.converges:
            return (
                f"no convergence, order {self.order:.2g}; half of dt = {self.dt:g} changes the run "
                f"by {size}, {where}"
            )
        assumed = np.isnan(self.order)
        order = f"order {self.assumed_order:g} assumed" if assumed else f"order {self.order:.2g}"
        step, bound = self._step_for(0.01)
        words = f"; dt = {step:.3g} for 1 %{bound and ', ' + bound}" if self.relative > FAR else ""
        return f"error about {size}, {where}; {order}{words}"


def _percent(x: float) -> str:
    return f"{100.0 * x:.2g} %" if x < 0.995 else f"{100.0 * x:.0f} %"


def estimate_error(
    session: Session,
    make: Callable[..., Any],
    end: tuple[float | None, int | None],
    halvings: int,
    progress: Any,
) -> ErrorEstimate:
    """`Coupler.estimate_error`; `make` makes a coupler, `end` is t_end and steps."""
    require_alone(session, "estimate_error")
    with session.guard:
        runs = Runs(session, make)
        steps = Clock(runs.dt).end(*end, 0)
    count = whole_number(halvings, "halvings", low=1)
    if count > 2:
        raise ValueError(f"halvings must be 1 or 2, got {count}")
    if steps == 0:
        raise ValueError("an error estimate needs a run of at least one macro step, got none")
    with reporting(progress, 0, steps * (2 ** (count + 1) - 1)) as report:
        history = runs.coarse(steps, report)
        motions = [x.u for x in history.subdomains if x is not None]
        if count == 2:
            size = 8.0 * sum(u.size for u in motions)
            require(size, "the motion with half the step", "take halvings=1 or a shorter run")
        half = runs.compared(1, steps, motions, report, keep=count == 2)
        finest = half
        if count == 2:
            finest = runs.compared(
                2,
                steps,
                half.motions,
                report,
                keep=False,
                watched=[dof for _, dof in half.places],
            )
        if report is not None:
            report.end()
    return _estimate(runs, history, half, finest)


def _estimate(runs: Runs, history: History, half: Compared, finest: Compared) -> ErrorEstimate:
    """From the differences of the first two runs, and of the last two; equation (D5)."""
    names = [name for name, _ in history.keys]
    order = float("nan")
    i = int(np.argmax(half.differences))
    if finest is not half and half.difference > ROUNDING * finest.largest:
        with np.errstate(divide="ignore"):
            order = float(np.log2(half.difference / np.float64(finest.watched[i])))
    used = runs.order if np.isnan(order) else order
    factor = 1.0 / (1.0 - 2.0**-used) if used >= LEAST_ORDER else 1.0
    scale = factor / finest.largest if finest.largest > 0.0 else 0.0
    level, dof = half.places[i]
    motion = history[i]
    labels = motion.dof_names
    return ErrorEstimate(
        relative=half.difference * scale,
        by_subdomain={name: x * scale for name, x in zip(names, half.differences)},
        place=(names[i], dof if labels is None else labels[dof], float(motion.t[level])),
        order=order,
        dt=runs.dt,
        history=history,
        assumed_order=runs.order,
    )


@dataclass
class Compared:
    """A run beside one with twice its steps, at the time levels of the coarsest one.

    differences: the largest one in each subdomain; `places` has time level and dof of it.
    largest: the largest displacement.
    motions: the displacements of each subdomain, (levels, n), or none of them.
    watched: the largest differences at dofs that were given, one of each subdomain.
    """

    differences: list[float]
    places: list[tuple[int, int]]
    largest: float
    motions: list[np.ndarray]
    dofs_watched: Sequence[int] = ()
    watched: list[float] = field(default_factory=list)

    @property
    def difference(self) -> float:
        """The largest of all."""
        return max(self.differences)

    def take(
        self, rows: Sequence[slice], motions: Sequence[np.ndarray], coarser: Sequence[np.ndarray]
    ) -> None:
        """A piece of the run at these time levels of each subdomain, and the coarser run there."""
        for i, (part, u, other) in enumerate(zip(rows, motions, coarser)):
            size = np.abs(u - other[part])
            level, dof = np.unravel_index(int(np.argmax(size)), size.shape)
            if size[level, dof] > self.differences[i]:
                self.differences[i] = float(size[level, dof])
                self.places[i] = part.start + int(level), int(dof)
            self.largest = max(self.largest, float(np.max(np.abs(u))))
            if self.dofs_watched:
                difference = float(np.max(size[:, self.dofs_watched[i]]))
                self.watched[i] = max(self.watched[i], difference)
            if self.motions:
                self.motions[i][part] = u


class Runs:
    """The run of a coupler from t = 0, and the same with shorter steps, each by a new coupler.

    The coupler itself is not used, so that it stays as it is whatever happens.
    """

    def __init__(self, session: Session, make: Callable[..., Any], call: str = "estimate_error"):
        require_repeatable(session, call)
        require_possible(session, call)
        self.session, self.make, self.functions = session, make, RepeatedFunctions()
        layout = session.steps.layout
        self.dt, self.substeps = layout.dt, layout.substeps
        mixed = session.coupling in ("gc", "pm") and len(set(layout.substeps)) > 1
        self.order = 1.0 if mixed else 2.0
        self.names = [name for name, _ in session.keys]

    def coupler(self, halvings: int) -> Any:
        """A coupler at t = 0 with all steps halved so many times."""
        return self.with_step(self.dt * 0.5**halvings)

    def with_step(self, dt: float) -> Any:
        """A coupler at t = 0 with this macro step."""
        threads, may_take_less = self.session.threads_allowed
        with silent():  # the set-up of the coupler itself has warned
            return remade(
                self.session,
                self.make,
                self._change,
                of_motion=self.functions.of,
                dt=dt,
                threads=None if may_take_less else threads,
            )

    def _change(self, name: str, arguments: dict[str, Any]) -> None:
        arguments["substeps"] = self.substeps[self.names.index(name)]
        arguments["force"] = self.functions.of(arguments["force"], f"force of subdomain {name!r}")
        arguments["restoring"] = self.functions.of_restoring(arguments["restoring"], name)

    def coarse(self, steps: int, report: Report | None) -> History:
        """The run itself, with the warnings of `Coupler.run`."""
        history: History = self.coupler(0).run(steps=steps, progress=_from(report, 0))
        self.functions.check()
        return replace(history, keys=self.session.keys)

    def compared(
        self,
        halvings: int,
        steps: int,
        coarser: Sequence[np.ndarray],
        report: Report | None,
        *,
        keep: bool,
        watched: Sequence[int] = (),
    ) -> Compared:
        """The run with steps halved so many times, compared with the motions of the one before."""
        count, ratio = len(self.names), 2**halvings
        arrays = [np.empty_like(u) for u in coarser] if keep else []
        zeros, none = [0.0] * count, [(0, 0)] * count
        comparison = Compared(zeros, none, 0.0, arrays, watched, list(zeros))
        coupler, done = self.coupler(halvings), steps * (ratio - 1)
        try:
            for first, last in self._pieces(steps, ratio, coarser):
                with silent():
                    piece = coupler.run(
                        steps=(last - first) * ratio, progress=_from(report, done + first * ratio)
                    )
                rows = [slice(first * k, last * k + 1) for k in self.substeps]
                motions = [x.u[::ratio] for x in piece.subdomains]
                comparison.take(rows, motions, coarser)
        except Exception as error:
            error.add_note(f"in the run with dt = {coupler.dt:g} of estimate_error")
            raise
        return comparison

    def _pieces(
        self, steps: int, ratio: int, motions: Sequence[np.ndarray]
    ) -> Iterator[tuple[int, int]]:
        """Macro steps of the coarsest run between which a finer one is recorded at a time."""
        size = sum(k * u.shape[1] for k, u in zip(self.substeps, motions))
        length = max(1, PIECE // (8 * RECORDED * ratio * max(size, 1)))
        for first in range(0, steps, length):
            yield first, min(first + length, steps)


def _from(report: Report | None, begin: int) -> Callable[[int, int], None] | None:
    """The progress of a run that begins when this number of macro steps is done."""
    if report is None:
        return None
    return lambda done, total: report.if_due(begin + done)
