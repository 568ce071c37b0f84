"""Where the error of a goal comes from: `Coupler.error_budget`.

The residuals of a run, weighted by the adjoint of one with half of all steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from math import ceil, floor, sqrt
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import check_word, positive_number, real_number
from ..errors import CallbackError
from ..gradients.gradient import gradient
from ..gradients.parameters import MULTIPLIERS, Goal, Misfit
from ..gradients.residuals import Line, Load, Weights, averaged, of_prescribed, of_subdomain
from ..memory import require
from ..problem.loads import loads_of
from ..results.times import TOLERANCE, Clock
from ..setup.schedule import MACRO
from ..setup.stability import critical_step
from .estimate import Runs
from .progress import reporting
from .session import Session, require_linear
from .state import form_and_entries

__all__ = ["ErrorBudget"]

# Fewer macro steps have no mean of their adjoint away from its ends.
LEAST_STEPS = 4
# Steps of explicit subdomains stay below their critical step by this factor.
FRACTION = 0.95
# The steps are chosen for this part of the tolerance.
AIM = 0.9
# Work of a step beside the reading of entries, as entries that take as long.
STEP = 500
# Ratio of two macro steps that are compared, and shares of the tolerance that count as nothing.
CANDIDATES = 1.03
NOTHING = 1e-3


def __dir__() -> list[str]:
    return sorted(__all__)


@dataclass(frozen=True, repr=False)
class ErrorBudget:
    """The error of a goal by its sources, from `Coupler.error_budget`.

    Printed, it is a sentence. Errors are exact values less those of the run.

    Attributes
    ----------
    value : float
        The goal in the run.
    own : dict of float
        The error that the steps of each subdomain make, by name.
    coupling : float
        That of the interface, between the ends of macro steps.
    by_step : dict of (steps,) arrays
        By name, of each step of the subdomain; their sum is `own`.
    coupling_by_step : (interface steps,) array
        That of the coupling in each step of the interface.
    dt : float
        The macro step of the run.
    substeps : dict of int
        By name.
    t_end : float
        The end of the run that was asked for, a whole number of macro steps.
    """

    value: float
    own: dict[str, float]
    coupling: float
    by_step: dict[str, np.ndarray] = field(compare=False)
    coupling_by_step: np.ndarray = field(compare=False)
    dt: float
    substeps: dict[str, int]
    t_end: float
    # of each subdomain: order of its scheme, critical step, entries that a step reads
    _facts: dict[str, tuple[int, float, float]] = field(compare=False)
    _interface: float = field(compare=False)  # entries that a macro step reads at the interface
    _macro: bool = True

    @property
    def total(self) -> float:
        """The estimated error, with its sign."""
        return float(sum(self.own.values()) + self.coupling)

    @property
    def bound(self) -> float:
        """The sum of the sizes of all shares: in practice the error is not larger."""
        return float(sum(map(abs, self.own.values())) + abs(self.coupling))

    @property
    def corrected(self) -> float:
        """The value with the estimated error added."""
        return self.value + self.total

    def __repr__(self) -> str:
        size = abs(self.value)
        relative = self.bound < size
        least = 5e-3 * self.bound

        def text(x: float) -> str:
            if abs(x) < least or x == 0.0:
                return "0"
            return f"{100.0 * x / size:.2g} %" if relative else f"{x:.2g}"

        shares = [*self.own.items(), ("coupling", self.coupling)]
        listed = ", ".join(f"{name} {text(x)}" for name, x in shares)
        return (
            f"value {self.value:.4g}, error about {text(self.total)}: {listed}; at most "
            f"{text(self.bound)}"
        )

    def steps(
        self,
        tolerance: float,
        *,
        work: Mapping[str, float] | None = None,
        growth: float = 2.0,
    ) -> tuple[float, dict[str, int]]:
        """The steps of least work with which the goal would have this error, equation (X7).

        The shares are taken to grow with the order of each scheme, 2, and the fourth power of the
        macro step. Make the coupler with these steps and its budget: two or three turns end with
        one whose `bound` is below the tolerance.

        Parameters
        ----------
        tolerance : float
            Positive, in the unit of the value.
        work : dict of float, optional
            By name, the work of one step of a subdomain, in any unit. Default: the matrix entries
            that it reads, and 500 for the step itself.
        growth : float, default 2
            At least 1: no step grows by more in one turn, since the shares are not known so far.

        Returns
        -------
        (float, dict of int)
            The macro step, of which `t_end` is a multiple, and the substeps by name, for "macro" or
            "mean". Steps of explicit subdomains are at most 0.95 of their critical step.

        Raises
        ------
        TypeError, ValueError, KeyError
            For arguments of the wrong kind; under "gc" and "pm".
        """
        tol = AIM * positive_number(tolerance, "tolerance")
        growth = real_number(growth, "growth", low=1.0)
        if not self._macro:
            raise ValueError('steps needs a budget of a coupler with coupling "macro" or "mean"')
        cost = self._work(work)
        # subdomains with one step meet at the ends of their steps, where the coupling has no error:
        # what it would have in a longer step is not known, and not above theirs
        hidden = sum(abs(x) for name, x in self.own.items() if self.substeps[name] == 1)
        b = abs(self.coupling) / self.dt**4
        b_longer = max(abs(self.coupling), hidden) / self.dt**4
        n = max(1, ceil(self.t_end / (growth * self.dt) - TOLERANCE))
        shortest = min(self.dt / k for k in self.substeps.values())
        enough = min((NOTHING * tol / b) ** 0.25, self.dt) if b > 0.0 else self.dt
        best: tuple[float, float, dict[str, int]] | None = None
        while True:
            dt = self.t_end / n
            left = tol - (b if dt <= self.dt * (1.0 + TOLERANCE) else b_longer) * dt**4
            if left > 0.0:
                substeps = self._substeps(dt, left, cost, growth)
                total = sum(cost[name] * k for name, k in substeps.items()) + self._interface
                if best is None or total / dt < best[0]:
                    best = total / dt, dt, substeps
            if best is not None and (dt <= enough or dt <= shortest):
                return best[1:]
            n = max(n + 1, floor(n * CANDIDATES))

    def _work(self, work: Mapping[str, float] | None) -> dict[str, float]:
        cost = {name: entries for name, (_, _, entries) in self._facts.items()}
        if work is not None and not isinstance(work, Mapping):
            raise TypeError(f"work must be a dict by subdomain, got {work!r}")
        for name, x in (work or {}).items():
            if name not in cost:
                raise KeyError(f"work must be of {sorted(cost)}, got {name!r}")
            cost[name] = positive_number(x, f"work[{name!r}]")
        return cost

    def _substeps(
        self, dt: float, tol: float, cost: Mapping[str, float], growth: float
    ) -> dict[str, int]:
        """Of least work with this macro step and sum a h^q = tol, by bisection for mu of (X7)."""
        now = {name: self.dt / k for name, k in self.substeps.items()}
        factor = {name: abs(x) / now[name] ** self._facts[name][0] for name, x in self.own.items()}

        def lengths(mu: float) -> dict[str, float]:
            result = {}
            for name, (q, critical, _) in self._facts.items():
                h = min(dt, growth * now[name], FRACTION * critical)
                if factor[name] > 0.0:
                    h = min(h, (cost[name] / (q * mu * factor[name])) ** (1.0 / (q + 1)))
                result[name] = h
            return result

        def error(h: Mapping[str, float]) -> float:
            return sum(factor[name] * h[name] ** self._facts[name][0] for name in h)

        low, high = 1e-300, 1e300
        if error(lengths(low)) > tol:
            while high > low * (1.0 + 1e-9):
                middle = sqrt(low) * sqrt(high)
                low, high = (middle, high) if error(lengths(middle)) > tol else (low, middle)
        h = lengths(high if error(lengths(low)) > tol else low)
        return {name: max(1, ceil(dt / x - TOLERANCE)) for name, x in h.items()}


def error_budget(
    session: Session,
    make: Callable[..., Any],
    goal: Any,
    t_end: float,
    weights: str,
    progress: Any,
) -> ErrorBudget:
    """`Coupler.error_budget`; `make` makes a coupler."""
    call = "error_budget"
    require_linear(session, call)
    check_word(weights, "weights", ("half", "same"))
    layout = session.steps.layout
    _require_steps(session, layout)
    objective = Objective(goal, session.keys)
    with session.guard:
        runs = Runs(session, make, call)
        clock = Clock(runs.dt)
        last, end = _ends(clock, t_end, objective.at)
    ratio = 2 if weights == "half" else 1
    of_run = 8 * last * sum(s.n * k for (_, s), k in zip(session.keys, layout.substeps))
    require(4 * of_run, "the motion for the error budget", "take fewer macro steps")
    with reporting(progress, 0, (2 * ratio + 1) * last) as report:
        history = runs.coarse(last, report)
        value = objective(history)[0]
        finer = runs.with_step(end / (ratio * last))

        @contextmanager
        def reported(_: int) -> Iterator[Any]:
            yield None if report is None else lambda done: report.if_due(last + done)

        steps = None, ratio * last
        adjoint = gradient(finer, finer._session, objective, steps, (), None, None, reported)
        if report is not None:
            report.end()
    return _budget(session, history, value, adjoint, end, clock.time(clock.end(t_end, None, 0)))


def _require_steps(session: Session, layout: Any) -> None:
    """ValueError for steps whose adjoint is not near that of the continuous problem."""
    if session.changed:
        raise ValueError(
            "error_budget needs the steps with which the coupler was made, got those of "
            "change_steps; make another Coupler with these steps"
        )
    if session.coupling not in MACRO and len(set(layout.substeps)) > 1:
        raise ValueError(
            f'error_budget needs coupling "macro" or "mean", or equal substeps: the adjoint under '
            f'"{session.coupling}" with substeps is not near that of the continuous problem, got '
            f"substeps {', '.join(map(str, layout.substeps))}"
        )


def _ends(clock: Clock, t_end: Any, at: float | None) -> tuple[int, float]:
    """Macro steps of the run, and the time of the goal or the end of the run."""
    steps = clock.end(t_end, None, 0)
    end = clock.time(steps)
    if at is not None:
        if at > end * (1.0 + 1e-12):
            raise ValueError(f"at of the Goal must be at most t_end, {t_end:g}, got {at:g}")
        steps = ceil(at / clock.dt - TOLERANCE)
        on_level = abs(at / clock.dt - steps) <= TOLERANCE
        end = clock.time(steps) if on_level else at
    if steps < LEAST_STEPS:
        raise ValueError(
            f"error_budget needs at least {LEAST_STEPS} macro steps up to its goal, got {steps}"
        )
    return steps, end


class Objective:
    """The goal as a function of a History with its sources, checked, in terms of these keys."""

    def __init__(self, goal: Any, keys: Any):
        if isinstance(goal, Misfit) or not callable(goal):
            data = ", whose data are at the levels of one set of steps"
            raise TypeError(
                "goal must be a Goal or a function of a History, got "
                f"{f'a Misfit{data}' if isinstance(goal, Misfit) else repr(goal)}"
            )
        self.goal, self.keys, self.at = goal, keys, None
        if isinstance(goal, Goal):
            goal._check(keys)
            self.at = goal.at

    def __call__(self, history: Any) -> Any:
        result = self.goal(replace(history, keys=self.keys))
        if not isinstance(result, tuple) or len(result) != 2 or not isinstance(result[1], Mapping):
            raise TypeError(f"goal must return its value and the derivatives, got {result!r}")
        for name, sources in result[1].items():
            if name == MULTIPLIERS or np.any(dict(sources).get("a", 0.0)):
                what = MULTIPLIERS if name == MULTIPLIERS else f"a of {name!r}"
                raise ValueError(f"goal must be a function of u and v, got a source of {what}")
        return result


def _budget(
    session: Session, history: Any, value: float, adjoint: Any, end: float, t_end: float
) -> ErrorBudget:
    """(X1) to (X6); the run up to `end` has the adjoint of another one with other steps."""
    mean, macro = session.coupling == "mean", session.coupling in MACRO
    levels = history.macro_times if macro else history.multiplier_times
    clipped = np.minimum(levels, end)
    nu = Line(clipped, _constraint_weights(adjoint.velocity, end, mean).at(clipped))
    lam = Line(levels, history.multipliers, steps=mean)
    by_step, coupling = {}, np.zeros(len(levels) - 1)
    rows = zip(session.keys, session.rows.matrices, session.loads.forces, session.members)
    for (name, s), L, force, member in rows:
        motion = history[name]
        width = s.substeps if macro else 1
        mu = adjoint.force.pop(name)
        times = np.linspace(0.0, end, len(mu))
        mu /= times[1]
        z = averaged(mu, width, 1)
        share = of_subdomain(
            s,
            sp.csr_array(L),
            motion,
            Load(force, s.n, _compiled(force, member)),
            Weights(Line(times, z), nu, lam, end, "u" if mean else "v"),
        )
        by_step[name] = share.residual
        coupling += share.coupling.reshape(len(coupling), -1).sum(axis=1)
    coupling += of_prescribed(lambda t: _prescribed(session, t), clipped, nu)
    return ErrorBudget(
        value=float(value),
        own={name: float(x.sum()) for name, x in by_step.items()},
        coupling=float(coupling.sum()),
        by_step=by_step,
        coupling_by_step=coupling,
        dt=session.steps.layout.dt,
        substeps={name: s.substeps for name, s in session.keys},
        t_end=t_end,
        _facts={
            name: (s.scheme.order, critical_step(s), member.core.entries + STEP)
            for (name, s), member in zip(session.keys, session.members)
        },
        _interface=_interface_work(session),
        _macro=macro,
    )


def _constraint_weights(x: np.ndarray, end: float, mean: bool) -> Line:
    """nu of (X3), from the derivatives by what is prescribed at the levels of the interface."""
    times = np.linspace(0.0, end, len(x))
    if mean:  # by displacements: a velocity changes all later ones
        later = np.cumsum(x[::-1], axis=0)[::-1]
        x = later.copy()
        x[:-1] = 0.5 * (later[:-1] + later[1:])
    else:
        x = x / times[1]
    return Line(times, averaged(x, 1, 2))


def _prescribed(session: Session, t: np.ndarray) -> np.ndarray:
    """g at (k,) times, (k, p)."""
    g = np.zeros((len(t), session.rows.p))
    for motion in session.loads.motions:
        g[:, motion.rows] = Load(motion.velocity, motion.rows.size)(t)
    return g


def _compiled(force: Any, member: Any) -> Callable[[float], np.ndarray] | None:
    """The compiled functions among the loads of a subdomain, which the core calls."""
    if not any(x._kind == "compiled" for x in loads_of(force)):
        return None

    def value(t: float) -> np.ndarray:
        values = member.core.force(t)
        if isinstance(values, int):
            raise CallbackError(values, "force", 0, t, member.name)
        out = np.empty(member.n)
        out[member.order] = values
        return out

    return value


def _interface_work(session: Session) -> float:
    """Matrix entries that an interface problem reads, with unit responses, and STEP for itself."""
    if not session.rows.p:
        return 0.0
    H = form_and_entries(session.assembly.parts["H"])[1]
    return float(STEP + 2 * H + sum(4 * x.n * x.L.rows.size for x in session.members))
