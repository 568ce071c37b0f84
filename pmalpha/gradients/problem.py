"""What of a coupler its adjoint needs, and the couplers that run in reversed time."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._cached import cached_property
from .._checks import numbered
from ..problem.constraints import Constraint
from ..problem.forces import SampledForce
from ..problem.matrices import is_symmetric
from ..problem.schemes import require_generalized_alpha
from ..problem.subdomain import Subdomain
from .adjoint import Adjoint, AdjointMember, MeanAdjoint, MeanAdjointMember, Sources, reversed_load
from .ground import acceleration
from .parameters import Parameters

TRAPEZOIDAL = (0.0, 0.0, 0.25, 0.5)  # alpha_m, alpha_f, beta, gamma


class Problem:
    """A linear coupled problem.

    single, steady: of the first macro step, whose steps are single, and of the others; one object
        where all steps are single.
    """

    def __init__(self, coupler: Any, session: Any):
        self.coupler, self.keys = coupler, session.keys
        layout, self.matrices = session.steps.layout, session.rows.matrices
        self.dt, self.mean = layout.dt, session.coupling == "mean"
        self.macro = self.mean or session.coupling == "macro"
        self._members = session.members
        self.options = session.options
        self.fine = 1 if self.macro else max(layout.substeps)
        self.symmetric = all(is_symmetric(s.C) and is_symmetric(s.K) for _, s in self.keys)
        self.forces = session.loads.seen
        self.prescribed = bool(session.loads.motions)
        self.doubles = layout.doubles
        self.substeps = {name: s.substeps for name, s in self.keys}
        self.single = self._adjoint([False] * len(self.keys))
        self.steady = self._adjoint(self.doubles) if any(self.doubles) else self.single

    def accelerations(self) -> list[np.ndarray]:
        """w of each subdomain at present, without what multipliers add under "mean"."""
        return [member.core.state()[2][member.position] for member in self._members]

    def ground(self, name: str, first: int, last: int) -> np.ndarray:
        """The acceleration of the ground at levels first to last of a subdomain, (levels, n);
        (1, 1) without a ground motion."""
        i = next(i for i, (key, _) in enumerate(self.keys) if key == name)
        t = np.arange(first, last + 1) / self.substeps[name] * self.dt  # (T1)
        return acceleration(self.forces[i], t)

    def motions(self, run: Any, beginning: Sequence[np.ndarray]) -> dict[str, Any]:
        """What dM, dC and dK are multiplied by in (A9), at all levels of a run from t = 0.

        `beginning` is w of each subdomain at t = 0.
        """
        out = {}
        members = zip(self.single.members, self.steady.members)
        for (first, x), w, history in zip(members, beginning, run.subdomains):
            if history is None:
                continue
            out[x.name] = motion = x.motion(history, w)
            single = slice(0, 1 if self.invariant else first.substeps + 1)
            motion["K"][single] = history.u[single] - first.al1_beside_K * history.a[single]
            motion["K"][0] = history.u[0]
            motion["M"] = motion["M"] + self.ground(x.name, 0, len(history.u) - 1)
        return out

    @property
    def invariant(self) -> bool:
        """Whether all macro steps are alike."""
        return self.single is self.steady

    def unit_loads(self, name: str, dof: int, before: int, what: str, steps: int) -> dict[str, Any]:
        """Loads of the reversed run of one dof, some substeps before the end."""
        loads: dict[str, Any] = {}
        for x in self.single.members:
            if x.name != name:
                loads[x.name] = np.zeros(x.n)
                continue
            unit, none = np.zeros((2, steps * x.substeps, 1))
            unit[before] = 1.0
            u, v, w = (unit if what == kind else none for kind in "uva")
            loads[name] = reversed_load(x, Sources(np.array([dof]), u, v, w))
        return loads

    def require_constant_interface(self, what: str) -> None:
        """ValueError where H multiplies what depends on the parameters, (A10)."""
        if not self.macro and any(s.substeps < self.fine for _, s in self.keys):
            raise ValueError(
                f'{what} needs coupling "macro", or equal substeps: under '
                f'"{self.options.coupling}" the H beside interpolated velocities depends on the '
                "parameters. Coupler.gradient has no such limit"
            )

    def sensitive(self, cases: Sequence[Mapping[str, Any]], steps: int, record: Any) -> list[Any]:
        """Runs from rest, each under loads on one subdomain by name."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # their loads are not those of a structure
            return self._from_rest(self._unmoved, cases, steps, record)

    def _adjoint(self, doubles: Sequence[bool]) -> Adjoint:
        of_member, of_all = (
            (MeanAdjointMember, MeanAdjoint) if self.mean else (AdjointMember, Adjoint)
        )
        members = []
        for (name, s), L, double in zip(self.keys, self.matrices, doubles):
            ratio = 1 if self.macro else self.fine // s.substeps
            members.append(of_member(name, s, L, self.dt, ratio, double))

        def reverse(forces: Any, steps: int, g: np.ndarray | None, double: bool) -> Any:
            return self.reversed_runs([forces], steps, None, g, double)[0]

        return of_all(members, self.macro, self.dt, self.fine, reverse)

    def reversed_runs(
        self,
        cases: Sequence[Mapping[str, Any]],
        steps: int,
        record: Any,
        g: np.ndarray | None = None,
        double: bool = False,
    ) -> list[Any]:
        """Runs with the transposed matrices from rest, each under loads by name."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # their loads are not those of a structure
            coupler = self._transposed if g is None else self._copy(g, double, True)
            return self._from_rest(coupler, cases, steps, record)

    def _from_rest(
        self, coupler: Any, cases: Sequence[Mapping[str, Any]], steps: int, record: Any
    ) -> list[Any]:
        rest = {name: np.zeros(s.n) for name, s in self.keys}
        runs = [{"u0": rest, "v0": rest, "force": {**rest, **forces}} for forces in cases]
        return list(coupler.run_each(runs, steps=steps, record=record))

    @cached_property
    def _unmoved(self) -> Any:
        """The coupler, or one like it without prescribed velocities."""
        return self._copy(None, True, False) if self.prescribed else self.coupler

    @cached_property
    def _transposed(self) -> Any:
        """The same of the transposed matrices."""
        return self._unmoved if self.symmetric else self._copy(None, True, True)

    def _copy(self, g: np.ndarray | None, double: bool, transposed: bool) -> Any:
        """A coupler of the same matrices, or the transposed ones, without loads."""

        def turned(A: Any) -> Any:
            return A.T if transposed and A is not None else A

        subdomains = [
            Subdomain(
                s.M,
                np.zeros(s.n) if s.K is None else turned(s.K),
                C=turned(s.C),
                scheme=s.scheme,
                substeps=s.substeps,
                double_step=steady and (double or g is None),
                symmetric=s.symmetric,
                name=name,
            )
            for (name, s), steady in zip(self.keys, self.doubles)
        ]
        velocity = None if g is None else SampledForce(g, self.dt / self.fine)
        rows = None
        if self.single.p:
            rows = Constraint({s: L for s, L in zip(subdomains, self.matrices) if L.nnz}, velocity)
        o = self.options
        return type(self.coupler)(subdomains, rows, dt=self.dt, coupling=o.coupling)


def subdomain_of(keys: Any, p: Parameters) -> str:
    for name, s in keys:
        if p.subdomain in (name, s):
            p._check_size(s.n, name)
            result: str = name
            return result
    names = ", ".join(repr(name) for name, _ in keys)
    other = p.name in dict(keys) and "; it is another object of this name: give the name alone"
    raise KeyError(f"parameters must be of one of the subdomains {names}, got {p!r}{other or ''}")


def require_adjoint(session: Any, what: str) -> None:
    """ValueError where the adjoint of a linear run is not such a run, with the reason."""
    options = session.options
    for name, s in session.keys:
        require_generalized_alpha(s.scheme, what, name)
    if options.coupling == "mean":
        _require_trapezoidal(session, what)
    if options.start != "rebased":
        raise ValueError(f'{what} needs start="rebased", got "{options.start}"')
    for name, s in session.keys:
        if s.damping == "lagged":
            raise ValueError(f'{what} needs damping="implicit", got "lagged" of {name!r}')
        if s.massless.size:
            dofs = numbered("dof", s.massless)
            raise ValueError(f"{what} needs a mass at each dof, got none at {dofs} of {name!r}")


def _require_trapezoidal(session: Any, what: str) -> None:
    """ValueError where a run under "mean" is not reciprocal."""
    for name, s in session.keys:
        x = s.scheme
        if x.explicit or x.parameters != TRAPEZOIDAL:
            raise ValueError(
                f'{what} needs the trapezoidal rule under "mean", Newmark(), got {x!r} of {name!r}'
            )
    if any(session.steps.layout.doubles):
        raise ValueError(f'{what} needs single steps under "mean", got double ones')
    if session.loads.motions:
        raise ValueError(f'{what} needs constraints without velocity under "mean"')
