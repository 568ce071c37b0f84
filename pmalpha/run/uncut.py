"""What a coupler returns of the structure before it was cut: equilibrium, matrices, modes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .._checks import whole_number
from ..errors import BucklingError
from ..problem.eigenmodes import IndefiniteStiffness, modes
from ..problem.matrices import Matrix, is_symmetric
from ..problem.subdomain import Subdomain
from ..setup.constraint_rows import ConstraintRows
from ..setup.equilibrium import Equilibrium
from ..setup.evaluated import REMEMBERED, matrices_at
from ..setup.part import Part
from ..setup.ranks import Ranks, joined
from ..setup.static import static_displacements
from ..setup.uncut import Assembled, assembled


class Uncut:
    """The methods of `Coupler` that solve for the whole structure, with displacements tied."""

    _keys: tuple[tuple[str, Subdomain], ...]
    _require_alone: Any
    _rows: ConstraintRows
    _parts: Any
    _loads: Any
    _together: Any
    _check_call: Any
    _ranks: Ranks | None
    _initial: Any
    _steps_done: Any
    _entered: Any
    _start: Any
    _clock: Any
    _core: Any

    def static(self, *, steps: int = 1) -> dict[str, np.ndarray]:
        """Static equilibrium under F(0) with displacements tied, such as u0 under dead load.

        Rows with a prescribed velocity are held at zero. The coupler itself is unchanged; use
        ``coupler.reset(u0=coupler.static())``. With `comm` every rank solves for the whole
        structure, with all matrices, and returns the displacements of its own subdomains. With
        springs or internal forces the equilibrium is iterated by Newton's method, from the initial
        displacements: those of the `Subdomain`, or of the last `reset`. Of several equilibria it
        finds one near to them. A force that is a function of t, u and v is a constant load with its
        value at t = 0 and the initial values.

        Parameters
        ----------
        steps : int, default 1
            Number of equal load steps, in which the residual of the initial displacements is
            removed. One that does not converge is halved, so that more than 1 are needed only to
            stay on a branch of solutions. No effect for linear subdomains.

        Returns
        -------
        dict of (n_i,) arrays by name
            Displacements.

        Raises
        ------
        FactorizationError
            For a floating structure, a mechanism at the solution, or an indefinite stiffness: an
            equilibrium that is not stable. An unsymmetric stiffness is only required to be regular.
        ConvergenceError
            When the iteration does not converge in small load steps; its time is 0.
        TypeError, ValueError
            For `steps` that is not a whole number above 0; for a function among restoring forces,
            whose equilibrium needs an experiment: `internal` takes forces that can be
            iterated.

        Notes
        -----
        Equations (N18) to (N20) of docs/method.md. Springs and forces with a history are evaluated
        at the end of one path from their history at t = 0, as the start of a run evaluates them,
        (N17), whatever the load steps: so the run stays at rest. Where yielding depends on the path
        of the load, apply it in a run.

        Exception: under "mean" explicit subdomains with `GeneralizedAlpha` rest in another
        equilibrium, (K9), which differs by 0.1 to 0.3 (omega h)^2 of the displacements. Central
        difference, implicit schemes and other couplings do rest.

        Examples
        --------
        >>> a = Subdomain([1.0], [2.0], scheme=Newmark(), force=[3.0], name="a")
        >>> b = Subdomain([1.0], [1.0], scheme=CentralDifference(), name="b")
        >>> coupler = Coupler([a, b], tie(a, [0], b, [0]), dt=0.1)
        >>> {name: float(u[0]) for name, u in coupler.static().items()}
        {'a': 1.0, 'b': 1.0}

        With a hardening spring, 2 u + u + u^3 = 4:

        >>> b = Subdomain([1.0], [1.0], scheme=Newmark(), internal=CubicSpring([0], 0.0, 1.0))
        >>> a = Subdomain([1.0], [2.0], scheme=Newmark(), force=[4.0], name="a")
        >>> coupler = Coupler([a, b], tie(a, [0], b, [0]), dt=0.1)
        >>> float(coupler.static()["a"][0].round(12))
        1.0
        """
        with self._together():
            self._check_call("static", steps)
            steps = whole_number(steps, "steps", low=1)
            for name, s in self._keys:
                if s.has_functions:
                    raise ValueError(
                        "static needs springs as restoring forces, and functions as internal ones, "
                        f"got a restoring function on {name!r}"
                    )
            done = self._steps_done()
            motions = self._initial.values
            forces = [
                self._loads.static(i, motions[i], done)[part.position]
                for i, part in enumerate(self._parts)
            ]
            u = self._equilibrium(forces, steps)
        return dict(zip((name for name, _ in self._keys), u))

    def _equilibrium(self, forces: list[np.ndarray], steps: int) -> list[np.ndarray]:
        internal, matrices = [part.internal for part in self._parts], self._rows.scaled
        iterated = [bool(s.springs) or x is not None for (_, s), x in zip(self._keys, internal)]
        if any(joined(self._ranks, iterated)):
            newton, ranks = self._loads.newton, self._ranks
            problem = Equilibrium(self._keys, internal, matrices, forces, newton, ranks)
            return problem.solve([u for u, _ in self._initial.values], steps)
        terms = [(s.K, L, F) for (_, s), L, F in zip(self._keys, matrices, forces)]
        u = static_displacements(*zip(*joined(self._ranks, terms)))
        return u if self._ranks is None else u[self._ranks.own]

    def assembled(self) -> Assembled:
        """The structure before it was cut: M, C and K with the constraints eliminated exactly.

        Dofs that ties connect are one dof; the others follow in the order of the subdomains. Rows
        with a prescribed velocity are held at zero. A general constraint removes one of its dofs,
        expressed by the others.

        K and C are those of small motions about the present state of the coupler: with the tangents
        of internal forces and springs at its displacements, velocities, histories and time, and
        with the estimates of restoring functions. Springs with a memory (`Bilinear`, `BoucWen`)
        count with their initial tangent if it is larger, since one that yields unloads in small
        motions; gaps count where they are closed. Before the first step the initial accelerations
        are computed first, as by `state`; a force that is a function of t, u and v is a load and
        has no part in K. The coupler
        itself is unchanged.

        Returns
        -------
        Assembled
            A tuple ``(M, C, K, map)``: (n, n) csr_array matrices, and by name the (n_i, n)
            csr_array with u_i = map[name] @ u. Displacements, velocities and accelerations are
            mapped alike; a force f_i on a subdomain is map[name].T @ f_i on the structure.

        Raises
        ------
        ValueError
            For a restoring force without `restoring_stiffness`, which may have any stiffness; when
            the constraints hold all dofs.
        MemoryError
            When many constraints that are not ties share dofs.

        Examples
        --------
        >>> a = Subdomain([1.0, 2.0], [[3.0, -1.0], [-1.0, 1.0]], scheme=Newmark(), name="a")
        >>> b = Subdomain([4.0], [5.0], scheme=Newmark(), name="b")
        >>> M, C, K, map = Coupler([a, b], tie(a, [1], b, [0]), dt=0.1).assembled()
        >>> M.diagonal().tolist(), K.toarray().tolist(), map["b"].toarray().tolist()
        ([1.0, 6.0], [[3.0, -1.0], [-1.0, 6.0]], [[0.0, 1.0]])
        """
        with self._entered():
            return self._assembled("assembled")

    def _assembled(self, what: str) -> Assembled:
        self._require_alone(what)
        for name, s in self._keys:
            if s.has_unknown_stiffness:
                raise ValueError(
                    "the assembled structure needs restoring_stiffness where there is a restoring "
                    f"force, got none for {name!r}"
                )
        self._start()
        t = self._clock.time(self._core.step_count)
        matrices = [_present_matrices(part, t) for part in self._parts]
        for part, (_, _, K) in zip(self._parts, matrices):
            if what == "modes" and not (part.subdomain.symmetric or is_symmetric(K)):
                raise ValueError(
                    "modes needs a symmetric stiffness, got an unsymmetric one of "
                    f"{part.name!r}; M, C and K of assembled() have complex eigenvalues, of "
                    "[[0, 1], [-M^-1 K, -M^-1 C]]"
                )
        return assembled([name for name, _ in self._keys], matrices, self._rows.matrices)

    def modes(self, k: int = 6) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """The lowest natural frequencies and modes of the structure with its ties.

        Those of M and K of `assembled`, for small motions about the present state of the coupler:
        for frequencies under dead load take ``coupler.reset(u0=coupler.static())`` first. Undamped:
        C has no influence, neither a gyroscopic one,
        whose frequencies of whirl are complex eigenvalues, nor have the steps of the subdomains.

        Parameters
        ----------
        k : int, default 6
            Number of modes, including rigid-body modes.

        Returns
        -------
        omega : (k,) ndarray
            Angular frequencies in rising order, radians per unit of time; 0 for rigid-body modes.
        modes : dict of (n_i, k) ndarray by name
            In columns, on all dofs of each subdomain; tied dofs have equal values. Mass-normalised:
            the sum of modes[name].T @ M_i @ modes[name] is the identity.

        Raises
        ------
        BucklingError
            For a motion of negative stiffness, with its mode and rate of growth: the state is not a
            stable equilibrium. A ValueError too.
        TypeError, ValueError
            As `assembled`; for a k that is not a whole number or larger than the number of dofs
            with mass; for a stiffness that is not symmetric.
        scipy.sparse.linalg.ArpackError
            When ARPACK does not converge.

        Examples
        --------
        A chain of three equal masses, cut at the second: omega = 2 sqrt(k/m) sin(i pi / 6).

        >>> K = [[4.0, -4.0], [-4.0, 4.0]]
        >>> a = Subdomain([1.0, 0.5], K, scheme=Newmark(), name="a")
        >>> b = Subdomain([0.5, 1.0], K, scheme=Newmark(), name="b")
        >>> omega, shapes = Coupler([a, b], tie(a, [1], b, [0]), dt=0.1).modes(3)
        >>> omega.round(6).tolist(), shapes["b"].shape
        ([0.0, 2.0, 3.464102], (2, 3))

        A mass on a hardening spring u + u^3 under a force of 10, at rest at u = 2:

        >>> mass = Subdomain([1.0], None, scheme=Newmark(), force=[10.0],
        ...                  internal=CubicSpring([0], k=1.0, k3=1.0))
        >>> coupler = Coupler([mass], dt=0.1)
        >>> coupler.modes(1)[0].round(6).tolist()  # unloaded
        [1.0]
        >>> coupler.reset(u0=coupler.static())
        >>> coupler.modes(1)[0].round(6).tolist()  # sqrt(1 + 3 u^2)
        [3.605551]
        """
        with self._entered():
            whole, t = self._assembled("modes"), self._clock.time(self._core.step_count)
        try:
            omega, shapes = modes(whole.M, whole.K, k)
        except IndefiniteStiffness as error:
            raise _buckling(error, whole, t) from None
        return omega, {name: T @ shapes for name, T in whole.map.items()}


def _present_matrices(part: Part, t: float) -> tuple[Matrix, Matrix, Matrix]:
    """M, C and K of a subdomain about its present state."""
    levels, internal = part.core.levels(), part.internal
    u, v = (levels[i][part.position] for i in (0, 1))
    springs, history = levels[5].reshape(REMEMBERED, -1), levels[6]
    q = history[: 0 if internal is None else internal.initial.size]
    return part.subdomain.M, *matrices_at(part.subdomain, internal, u, v, t, q, springs)


def _buckling(error: IndefiniteStiffness, whole: Assembled, t: float) -> BucklingError:
    growth = math.sqrt(-error.square)
    mode = {name: T @ error.shape for name, T in whole.map.items()}
    name = max(mode, key=lambda name: float(np.max(np.abs(mode[name]), initial=0.0)))
    dof = int(np.argmax(np.abs(mode[name])))
    return BucklingError(
        f"the structure must be stable in its present state, at t = {t:g}, but has a motion of "
        f"negative stiffness, buckling or softening: omega^2 = {error.square:g}, which grows like "
        f"exp({growth:.3g} t); its largest displacement is that of dof {dof} of {name!r}, and "
        "`mode` of this error has it",
        growth,
        mode,
    )
