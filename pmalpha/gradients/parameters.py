"""What a gradient is taken with respect to: derivatives of the matrices of a subdomain."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from .._cached import Frozen
from .._checks import check_word, counted, plain_array, positive_number, real_array, real_number
from ..problem.dofs import dof_array, dof_list
from ..problem.loads import Force, each_load, loads_of
from ..problem.matrices import product, rectangular
from ..problem.sampled import BaseAcceleration
from ..problem.subdomain import Subdomain
from ..results.quantities import position
from ..results.times import columns_of, within

__all__ = ["Goal", "Misfit", "Parameters"]

# Numbers in the largest arrays of products by element: 32 MB
NUMBERS = 2**22


class Parameters(Frozen):
    """Derivatives of the matrices of one subdomain with respect to m parameters.

    Parameters
    ----------
    subdomain : Subdomain or str
        The subdomain, or its name.
    dofs : (e, k) array of int or str, optional
        Dofs of the element that belongs to each parameter, by name where `subdomain` is a
        Subdomain that has names. Then K, C and M are element matrices.
    K, C, M : (k, k) or (e, k, k) array, or list of m (n, n) matrices
        Derivatives of these matrices: with `dofs` one element matrix for all parameters or one
        for each; without, m dense or sparse matrices. With Rayleigh damping a stiffness
        parameter has ``C = c_k * K``. Those left out are zero.
    labels : (e,) array_like, optional
        With `dofs` of e elements: those with the same label, a number or a name, share a parameter,
        such as the modulus of a material. The parameters are in rising order of the labels.
        Default: each element has its own.

    Attributes
    ----------
    m : int
        Number of parameters.
    labels : (m,) ndarray
        Of each parameter; without `labels` its number.

    Raises
    ------
    TypeError, ValueError
        For shapes that do not fit, and for no matrix at all.

    Examples
    --------
    The springs of a chain of three masses, fixed at the left:

    >>> import pmalpha as pm
    >>> chain = pm.Subdomain([1.0] * 3, [[2.0, -1, 0], [-1, 2, -1], [0, -1, 1]],
    ...                      scheme=pm.Newmark(), name="chain")
    >>> springs = pm.Parameters(chain, dofs=[[0, 1], [1, 2]], K=[[1.0, -1.0], [-1.0, 1.0]])
    >>> springs.m
    2
    """

    def __init__(
        self,
        subdomain: Subdomain | str,
        *,
        dofs: Any = None,
        K: Any = None,
        C: Any = None,
        M: Any = None,
        labels: Any = None,
    ):
        if not isinstance(subdomain, (Subdomain, str)):
            raise TypeError(
                f"subdomain must be a Subdomain or the name of one, got {type(subdomain).__name__}"
            )
        matrices = {name: x for name, x in (("K", K), ("C", C), ("M", M)) if x is not None}
        if not matrices:
            raise ValueError("K, C or M must be given, got none of them")
        self.subdomain = subdomain
        self.dofs: np.ndarray | None = None
        self.matrices: dict[str, Any]  # element matrices, or lists of matrices
        if dofs is None:
            if labels is not None:
                raise ValueError("labels must come with the dofs of elements")
            self.matrices = {x: _listed(value, x) for x, value in matrices.items()}
            counts = {name: len(value) for name, value in self.matrices.items()}
            if len(set(counts.values())) != 1:
                raise ValueError(f"K, C and M must be lists of one length, got {counts}")
            self.labels = np.arange(next(iter(counts.values())))
        else:
            self.dofs = _elements(subdomain, dofs)
            self.matrices = {x: _element(value, x, self.dofs) for x, value in matrices.items()}
            self.labels, self._of = labelled(labels, len(self.dofs))
        self.m = len(self.labels)
        self._freeze()

    @property
    def name(self) -> str | None:
        """The name of the subdomain."""
        return self.subdomain if isinstance(self.subdomain, str) else self.subdomain.name

    def __repr__(self) -> str:
        return f"<Parameters of {self.name!r}: {self.m} by {', '.join(self.matrices)}>"

    def _check_size(self, n: int, name: str) -> None:
        """ValueError unless the dofs and matrices are those of a subdomain with n dofs."""
        if self.dofs is not None:
            dof_array(self.dofs, n, f"dofs of {name!r} in Parameters")
            return
        for kind, matrices in self.matrices.items():
            for j, matrix in enumerate(matrices):
                if matrix.shape != (n, n):
                    raise ValueError(
                        f"{kind}[{j}] of Parameters must have shape {(n, n)}, got {matrix.shape}"
                    )

    def _products(self, mu: np.ndarray, motion: dict[str, np.ndarray]) -> np.ndarray:
        """- sum_k mu_k . (dM w_k + dC v_k + dK u_k) for each parameter, (A9).

        motion: what stands beside "M", "C" and "K": w, v and u (levels, n); of an explicit scheme
            the predictor for u.
        """
        if self.dofs is None:
            terms = [
                [np.vdot(mu, (D @ motion[kind].T).T) for D in matrices]
                for kind, matrices in self.matrices.items()
            ]
            sums: np.ndarray = -np.sum(terms, axis=0)
            return sums
        e, k = self.dofs.shape
        total = np.zeros(e)
        levels = max(NUMBERS // (e * k), 1)
        for first in range(0, len(mu), levels):
            rows = slice(first, first + levels)
            at = mu[rows][:, self.dofs].transpose(1, 2, 0)
            for kind, matrices in self.matrices.items():
                products = at @ motion[kind][rows][:, self.dofs].transpose(1, 0, 2)
                total -= np.sum(products * matrices, axis=(1, 2))
        return self._summed(total)

    def _spectrum(self, mu: np.ndarray, motion: dict[str, np.ndarray]) -> np.ndarray:
        """`_products` of spectra, frequency by frequency: (frequencies, m), complex."""
        if self.dofs is None:
            terms = [
                [np.sum(mu * (D @ motion[kind].T).T, axis=1) for D in matrices]
                for kind, matrices in self.matrices.items()
            ]
            sums: np.ndarray = -np.sum(terms, axis=0).T
            return sums
        frequencies, (e, k) = len(mu), self.dofs.shape
        total = np.zeros((frequencies, self.m), complex)
        together = max(NUMBERS // (frequencies * k), 1)
        for first in range(0, e, together):
            rows = slice(first, first + together)
            dofs = self.dofs[rows]
            at = mu.T[dofs]  # (elements, k, frequencies)
            for kind, matrices in self.matrices.items():
                D = matrices if len(matrices) == 1 else matrices[rows]
                products = np.sum(at * (D @ motion[kind].T[dofs]), axis=1)
                np.subtract.at(total.T, self._of[rows], products)
        return total

    def _summed(self, of_elements: np.ndarray) -> np.ndarray:
        return np.bincount(self._of, of_elements, self.m)

    def _force(self, j: int, motion: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Dofs, and -(dM w + dC v + dK u) on them, (levels, dofs), for parameter j."""
        if self.dofs is not None:
            dofs = np.unique(self.dofs[self._of == j])
            total = np.zeros((len(motion["K"]), dofs.size))
            for kind in self.matrices:
                total -= (self._matrix(kind, j, dofs) @ motion[kind][:, dofs].T).T
            return dofs, total
        total = np.zeros_like(motion["K"])
        for kind, listed in self.matrices.items():
            total -= (listed[j] @ motion[kind].T).T
        dofs = np.flatnonzero(np.any(total, axis=0))
        dofs = dofs if dofs.size else np.zeros(1, int)
        return dofs, total[:, dofs]

    def _matrix(self, kind: str, j: int, dofs: np.ndarray) -> Any:
        """Parameter j's dM, dC or dK for these dofs of the subdomain, which are in rising order."""
        matrices = self.matrices[kind]
        if self.dofs is None:
            return matrices[j][dofs][:, dofs]
        elements = np.flatnonzero(self._of == j)
        local = np.searchsorted(dofs, self.dofs[elements])
        entries = matrices if len(matrices) == 1 else matrices[elements]
        rows, columns, values = np.broadcast_arrays(local[:, :, None], local[:, None], entries)
        shape = (dofs.size, dofs.size)
        return sp.csr_array((values.ravel(), (rows.ravel(), columns.ravel())), shape)

    def _traces(self, Y: np.ndarray, Z: np.ndarray, weights: dict[str, float]) -> np.ndarray:
        """tr(dMbar_j Y Z^T) with dMbar = sum of weights times dM, dC, dK, for (A10)."""
        used = {kind: x for kind, x in self.matrices.items() if weights[kind] != 0.0}
        if self.dofs is None:
            terms = [[weights[kind] * np.sum(Z * (D @ Y)) for D in x] for kind, x in used.items()]
            return np.sum(terms, axis=0) if terms else np.zeros(self.m)
        pairs = Z[self.dofs] @ Y[self.dofs].transpose(0, 2, 1)
        total = np.zeros(len(self.dofs))
        for kind, x in used.items():
            total += weights[kind] * np.sum(pairs * x, axis=(1, 2))
        return self._summed(total)


def _elements(subdomain: Subdomain | str, dofs: Any) -> np.ndarray:
    if isinstance(subdomain, Subdomain):
        array = dof_array(dofs, subdomain.n, "dofs", subdomain.dof_names)
    elif plain_array(dofs, "dofs").dtype.kind == "U":
        raise TypeError(f"dofs by name need the Subdomain itself, got its name {subdomain!r}")
    else:
        array = np.asarray(dofs)
        array = dof_array(dofs, None, "dofs") if array.ndim == 2 else array
    if array.ndim != 2 or array.size == 0:
        raise ValueError(
            f"dofs must be an (e, k) array, a row for each element, got shape {array.shape}"
        )
    return array


def _element(value: Any, name: str, dofs: np.ndarray) -> np.ndarray:
    m, k = dofs.shape
    array = real_array(value, name, (2, 3))
    if array.shape not in ((k, k), (1, k, k), (m, k, k)):
        raise ValueError(f"{name} must have shape {(k, k)} or {(m, k, k)}, got {array.shape}")
    return array if array.ndim == 3 else array[None]


def labelled(labels: Any, e: int) -> tuple[np.ndarray, np.ndarray]:
    """The different labels in rising order, and the number of that of each element."""
    array = np.arange(e) if labels is None else plain_array(labels, "labels")
    if array.shape != (e,):
        raise ValueError(f"labels must have shape ({e},), one each element, got {array.shape}")
    if array.dtype.kind == "O" and all(isinstance(x, str) for x in array):
        array = array.astype(str)
    if array.dtype.kind not in "iuU":
        raise TypeError(f"labels must be whole numbers or names, got dtype {array.dtype}")
    return np.unique(array, return_inverse=True)


def _listed(value: Any, name: str) -> list[Any]:
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise TypeError(
            f"{name} must be a list of matrices where no dofs are given, got {type(value).__name__}"
        )
    return [sp.csr_array(x) if sp.issparse(x) else real_array(x, f"{name}[i]", (2,)) for x in value]


# ---- misfit -------------------------------------------------------------------------------------
# Functions of a run whose gradients are wanted: weighted squares of differences from data.

KINDS = ("u", "v", "a")
MULTIPLIERS = "multipliers"


class Misfit(Frozen):
    """Sum of weight (x - data)^2 / 2 over the levels of a run, x what was measured.

    Parameters
    ----------
    measured : dict
        By name of the subdomain ``dict(dofs=..., u=data, v=data, a=data, weight=1.0)``: dofs by
        number or name, one or several of u, v, a with data (levels, dofs) at all time levels of the
        subdomain from t = 0 on; nan where nothing was measured. `weight`: a number or (dofs,), such
        as one over the square of the standard deviation of the noise. In place of `dofs` a matrix
        ``W``, (rows, n) dense or sparse, for combinations W u, W v or W a, such as strains, drifts
        of storeys or what is measured in another direction; data are then (levels, rows). A list of
        such dicts where dofs are measured in several ways. ``"multipliers"``: ``dict(rows=...,
        data=..., weight=1.0)``, the rows of the multipliers at the interface levels, such as forces
        of a load cell.

    Raises
    ------
    TypeError, ValueError
        For other keys, and shapes that do not fit.

    Examples
    --------
    >>> import numpy as np
    >>> misfit = Misfit({"frame": dict(dofs=[0, 2], a=np.zeros((101, 2)), weight=4.0)})
    >>> misfit
    <Misfit of 'frame': a of 2 dofs, 101 levels>

    The drift of a storey and a force at the interface:

    >>> Misfit({"frame": dict(W=[[0.0, -1.0, 1.0]], u=np.zeros((101, 1))),
    ...         "multipliers": dict(rows=[0], data=np.zeros((101, 1)))})
    <Misfit of 'frame': u of 1 row, 101 levels; 'multipliers': 1 row, 101 levels>
    """

    def __init__(self, measured: Mapping[str, Any]):
        if not isinstance(measured, Mapping) or not measured:
            raise TypeError(f"measured must be a dict by subdomain, got {measured!r}")
        self.measured: dict[str, list[dict[str, Any]]] = {}
        for name, value in measured.items():
            several = value if isinstance(value, (list, tuple)) else [value]
            for of in several:
                if not isinstance(of, Mapping):
                    raise TypeError(
                        f"measured[{name!r}] must be a dict or a list of dicts, got {of!r}"
                    )
            check = _of_multipliers if name == MULTIPLIERS else _of_motion
            self.measured[name] = [check(name, dict(of)) for of in several]
        self._freeze()

    def __repr__(self) -> str:
        parts = []
        for name, of in self._each():
            what = counted(len(of["sensors"]), "dof" if "dofs" in of else "row")
            kinds = ", ".join(k for k in KINDS if k in of["data"])
            levels = len(next(iter(of["data"].values())))
            parts.append(f"{name!r}: {kinds + ' of ' if kinds else ''}{what}, {levels} levels")
        return f"<Misfit of {'; '.join(parts)}>"

    def _each(self) -> Iterator[tuple[str, dict[str, Any]]]:
        return ((name, of) for name, several in self.measured.items() for of in several)

    @property
    def record(self) -> dict[str, np.ndarray]:
        """What a run has to record for it: dofs by name of the subdomain."""
        return {
            name: np.unique(np.concatenate([_dofs(of) for of in several]))
            for name, several in self.measured.items()
            if name != MULTIPLIERS
        }

    def _placed(self, subdomains: Mapping[str, Subdomain], p: int) -> Misfit:
        """The same with numbers of dofs that fit the subdomains of a coupler."""
        placed = copy(self)
        measured = {
            name: [_placed(name, of, subdomains, p) for of in several]
            for name, several in self.measured.items()
        }
        object.__setattr__(placed, "measured", measured)
        return placed

    def __call__(self, history: Any) -> tuple[float, dict[str, Any]]:
        """The value, and its derivatives with respect to what `record` names and multipliers."""
        value = 0.0
        sources: dict[str, Any] = {}
        for name, of in self._each():
            if name == MULTIPLIERS:
                source = sources.setdefault(name, np.zeros_like(history.multipliers))
                value += _added(name, MULTIPLIERS, of, history.multipliers, of["sensors"], source)
                continue
            run = history[name]
            if "dofs" in of:
                what = f"dofs of {name!r} in the Misfit"
                columns: Any = columns_of(of["dofs"], run.dofs, run.n, run.dof_names, what)
            else:
                columns = places(run.dofs, of["columns"])
            derivatives = sources.setdefault(name, {})
            for kind in of["data"]:
                motion = getattr(run, kind)
                source = derivatives.setdefault(kind, np.zeros((len(motion), len(run.dofs))))
                value += _added(name, kind, of, motion, columns, source)
        return value, sources


def _placed(
    name: str, of: dict[str, Any], subdomains: Mapping[str, Subdomain], p: int
) -> dict[str, Any]:
    """What was measured in one way, with numbers of dofs or rows."""
    if name == MULTIPLIERS:
        return of | {"sensors": dof_list(of["sensors"], p, "rows of 'multipliers' in the Misfit")}
    if name not in subdomains:
        raise KeyError(f"the Misfit must be of {sorted(subdomains)}, got {name!r}")
    n, names = subdomains[name].n, subdomains[name].dof_names
    if "dofs" in of:
        dofs = dof_list(of["dofs"], n, f"dofs of {name!r} in the Misfit", names)
        if dofs.size != len(of["sensors"]):
            raise ValueError(
                f"dofs of {name!r} in the Misfit must be {len(of['sensors'])}, as the columns of "
                f"its data, got {dofs.size}"
            )
        return of | {"dofs": dofs}
    if of["n"] != n:
        raise ValueError(
            f"W of {name!r} in the Misfit must have {counted(n, 'column')}, got {of['n']}"
        )
    return of


def _added(
    name: str, kind: str, of: Mapping[str, Any], motion: np.ndarray, columns: Any, source: Any
) -> float:
    """The value, whose derivative with respect to the motion is added to the source."""
    x, data, W = motion[:, columns], of["data"][kind], of.get("W")
    if W is not None:
        x = (W @ x.T).T
    if x.shape != data.shape:
        raise ValueError(
            f"{kind} of {name!r} in the Misfit must have shape {x.shape}, the levels of the run "
            f"and what is measured, got {data.shape}"
        )
    difference = np.where(np.isnan(data), 0.0, x - data)
    weighted = of["weight"] * difference
    source[:, columns] += weighted if W is None else (W.T @ weighted.T).T
    return 0.5 * float(np.sum(weighted * difference))


def _dofs(of: Mapping[str, Any]) -> np.ndarray:
    dofs: np.ndarray = of["dofs"] if "dofs" in of else of["columns"]
    return dofs


def places(recorded: np.ndarray, dofs: np.ndarray) -> np.ndarray:
    """The columns of some dofs among those that were recorded."""
    order = np.argsort(recorded)
    return order[np.searchsorted(recorded, dofs, sorter=order)]


def _of_motion(name: str, of: dict[str, Any]) -> dict[str, Any]:
    _require_keys(name, of, {"dofs", "W", "weight", *KINDS})
    if ("dofs" in of) == ("W" in of):
        raise ValueError(f"measured[{name!r}] must have dofs or W, one of them")
    out: dict[str, Any] = {}
    if "dofs" in of:
        out["dofs"] = _given_dofs(of["dofs"], f"dofs of {name!r}")
        out["sensors"] = np.arange(len(out["dofs"]))
    else:
        W = rectangular(of["W"], None, f"W of {name!r}")
        out["sensors"], out["columns"] = np.arange(W.shape[0]), np.unique(W.indices)
        out["W"], out["n"] = sp.csr_array(W[:, out["columns"]]), W.shape[1]
    if not out["sensors"].size:
        raise ValueError(f"dofs of {name!r} must be at least one, got none")
    arrays = {k: of[k] for k in KINDS if k in of}
    if not arrays:
        raise ValueError(f"measured[{name!r}] must have data of u, v or a")
    return _with_data(name, out, arrays, of)


def _given_dofs(value: Any, what: str) -> Any:
    """As they are where they are names or count from the end: what they are of is not known."""
    array = np.atleast_1d(plain_array(value, what))
    if array.ndim == 1 and (
        array.dtype.kind in "UO" or (array.dtype.kind == "i" and array.min(initial=0) < 0)
    ):
        return [value] if isinstance(value, str) else list(value)
    return dof_list(value, None, what)


def _of_multipliers(name: str, of: dict[str, Any]) -> dict[str, Any]:
    _require_keys(name, of, {"rows", "data", "weight"})
    if missing := [x for x in ("rows", "data") if x not in of]:
        raise ValueError(f"measured[{name!r}] must have {missing[0]}")
    rows = dof_list(of["rows"], None, f"rows of {name!r}")
    return _with_data(name, {"sensors": rows}, {MULTIPLIERS: of["data"]}, of)


def _require_keys(name: str, of: Mapping[str, Any], known: set[str]) -> None:
    if unknown := set(of) - known:
        raise ValueError(f"measured[{name!r}] has unknown keys: {sorted(unknown)}")


def _with_data(
    name: str, out: dict[str, Any], arrays: Mapping[str, Any], of: Mapping[str, Any]
) -> dict[str, Any]:
    """`out` with the weight and the data by kind, checked."""
    count = out["sensors"].size
    out["weight"] = real_array(of.get("weight", 1.0), "weight", (0, 1))
    if out["weight"].shape not in ((), (count,)):
        raise ValueError(
            f"weight of {name!r} must be a number or have shape {(count,)}, got "
            f"{out['weight'].shape}"
        )
    out["data"] = {}
    for kind, values in arrays.items():
        data = np.array(values, float)
        if np.any(np.isinf(data)):
            raise ValueError(
                f"{kind} of {name!r} must be finite, or nan where nothing was measured"
            )
        if data.ndim != 2 or data.shape[1] != count:
            raise ValueError(
                f"{kind} of {name!r} must have shape (levels, {count}), got {data.shape}"
            )
        out["data"][kind] = data
    return out


# ---- ground -------------------------------------------------------------------------------------
# What a ground motion adds to accelerations in derivatives with respect to masses, (A18).

# Rounding of M times a direction, relative to its largest entry.
ROUNDING = 1e-12


def of_own_mass(force: Any, M: Any) -> bool:
    """Whether a ground motion is that of this mass matrix, -M direction record."""
    assert force.shape is not None
    if force.direction is None:
        return False
    error = np.abs(force.shape + product(M, force.direction)).max()
    return bool(error <= ROUNDING * np.abs(force.shape).max())


def with_mass(force: Force, M: Any) -> Force:
    """The loads of a subdomain for another mass matrix."""

    return each_load(force, lambda load: load._with_mass(M))


def check_masses(
    keys: Sequence[tuple[str, Subdomain]],
    forces: Sequence[Force],
    parameters: Sequence[Parameters],
    names: Sequence[str],
) -> None:
    """ValueError where masses have parameters and a ground motion is that of another mass matrix.

    `names` are the subdomains of the parameters.
    """
    subdomains = {name: (s, force) for (name, s), force in zip(keys, forces)}
    for p, name in zip(parameters, names):
        s, force = subdomains[name]
        if "M" not in p.matrices:
            continue
        if not all(of_own_mass(x, s.M) for x in loads_of(force) if x._is_ground):
            raise ValueError(
                "parameters of M need a BaseAcceleration that is made of the M of the same "
                f"subdomain, got another one on {name!r}, whose dependence on the parameters is "
                "not known"
            )


def acceleration(force: Force, t: np.ndarray) -> np.ndarray:
    """Acceleration of the ground in the direction of each dof, (levels, n), as the load has it;
    without a ground motion (1, 1), zero."""
    motions = (x for x in loads_of(force) if isinstance(x, BaseAcceleration))
    directed = ((x, x.direction) for x in motions if x.direction is not None)
    return sum((x._series(t) @ along.T for x, along in directed), np.zeros((1, 1)))


# ---- goal ----------------------------------------------------------------------------------------
# A linear functional of a motion: what an error budget is made for.

# Three Gauss points in [0, 1] and their weights: exact to degree 5.
GAUSS = tuple(zip(0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0]), np.array([5.0, 8.0, 5.0]) / 18))


class Basis(NamedTuple):
    """What u0, v0, u1, v1 of a step are multiplied by, for the motion and its derivatives."""

    u: tuple[Any, ...]
    v: tuple[Any, ...]
    a: tuple[Any, ...]


def basis(s: Any, h: Any) -> Basis:
    """The cubic Hermite polynomial of a step of length h at the share s of it."""
    r = 1.0 - s
    return Basis(
        (r * r * (1.0 + 2.0 * s), h * s * r * r, s * s * (3.0 - 2.0 * s), -h * s * s * r),
        (-6.0 * s * r / h, r * (1.0 - 3.0 * s), 6.0 * s * r / h, s * (3.0 * s - 2.0)),
        (
            (12.0 * s - 6.0) / h**2,
            (6.0 * s - 4.0) / h,
            (6.0 - 12.0 * s) / h**2,
            (6.0 * s - 2.0) / h,
        ),
    )


class Goal(Frozen):
    """A displacement or velocity at a time, or its integral with a weight over the run.

    For `Coupler.error_budget`; `Coupler.gradient` takes it as an objective too. Between two time
    levels the motion is that of `History.at`, a cubic Hermite polynomial and its derivative.

    Parameters
    ----------
    subdomain : str, int or Subdomain
        Of the coupler.
    weights : str, int, dict or (n,) array
        A dof by name or number, or weights by dof, ``{"roof": 1.0, "ground": -1.0}``, or of all
        dofs: the goal is the sum of weights times their motion.
    at : float
        A time, positive. Give this or `weight`.
    weight : callable
        ``w(t)``, a number: the goal is the integral of w times the motion from t = 0 to the end of
        the run, by three Gauss points in each step of the subdomain.
    what : {"u", "v"}, default "u"
        Displacement or velocity.

    Raises
    ------
    TypeError, ValueError
        For none or both of `at` and `weight`, and weights that are all zero or not finite.

    Examples
    --------
    >>> Goal("frame", "roof", at=2.5)
    <Goal: u of 'roof' of 'frame' at t = 2.5>
    >>> Goal("frame", {0: -1.0, 2: 1.0}, weight=lambda t: np.sin(t), what="v")
    <Goal: v of 2 dofs of 'frame', weighted over the run>
    """

    def __init__(
        self,
        subdomain: str | int | Subdomain,
        weights: Any,
        *,
        at: float | None = None,
        weight: Callable[[float], float] | None = None,
        what: str = "u",
    ):
        if (at is None) == (weight is None):
            raise TypeError("give either at or weight, not both or none")
        if weight is not None and not callable(weight):
            raise TypeError(f"weight must be a function of t, got {weight!r}")
        check_word(what, "what", ("u", "v"))
        if not isinstance(subdomain, (str, int, np.integer, Subdomain)):
            raise TypeError(f"subdomain must be a name, a number or a Subdomain, got {subdomain!r}")
        self.subdomain, self.what, self.weight = subdomain, what, weight
        self.at = None if at is None else positive_number(at, "at")
        self.dofs, self.weights = _weighted(weights)
        self._of_all = np.ndim(weights) > 0 and not isinstance(weights, Mapping)
        self._freeze()

    def __repr__(self) -> str:
        s = self.subdomain
        of = repr(s.name if isinstance(s, Subdomain) else s)
        count = len(self.weights)
        one = repr(self.dofs[0]) if isinstance(self.dofs[0], str) else f"dof {self.dofs[0]}"
        when = ", weighted over the run" if self.at is None else f" at t = {self.at:g}"
        return f"<Goal: {self.what} of {one if count == 1 else f'{count} dofs'} of {of}{when}>"

    def __call__(self, history: Any) -> tuple[float, dict[str, dict[str, np.ndarray]]]:
        """The value in a History, and its derivatives, as an objective of a gradient."""
        motion = history[self.subdomain]
        name = history.keys[position(self.subdomain, history.keys)][0]
        what = f"dofs of {name!r} in the Goal"
        columns = columns_of(list(self.dofs), motion.dofs, motion.n, motion.dof_names, what)
        levels, shares = self._points(motion.t)
        h = np.diff(motion.t)[levels]
        u0, v0, u1, v1 = getattr(basis(shares[0], h), self.what)
        sources = {kind: np.zeros(motion.u.shape) for kind in "uv"}
        value = 0.0
        for kind, begin, end in (("u", u0, u1), ("v", v0, v1)):
            of_level = np.zeros(len(motion.t))
            np.add.at(of_level, levels, shares[1] * begin)
            np.add.at(of_level, levels + 1, shares[1] * end)
            sources[kind][:, columns] = np.outer(of_level, self.weights)
            value += float(of_level @ getattr(motion, kind)[:, columns] @ self.weights)
        return value, {name: sources}

    def _points(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Levels before the points in time, and their places in the steps and factors, (2, k)."""
        if self.at is not None:
            time = within(t, np.array([self.at]), "at of the Goal")
            level = np.clip(np.searchsorted(t, time, side="right") - 1, 0, len(t) - 2)
            share = (time - t[level]) / np.diff(t)[level]
            return level, np.array([share, [1.0]])
        assert self.weight is not None
        levels, h = np.arange(len(t) - 1).repeat(len(GAUSS)), np.diff(t).repeat(len(GAUSS))
        places, factors = (np.tile(x, len(t) - 1) for x in zip(*GAUSS))
        times = t[levels] + places * h
        values = np.array([_number(self.weight(float(x)), x) for x in times])
        return levels, np.array([places, factors * h * values])

    def _check(self, keys: Sequence[tuple[str, Subdomain]]) -> str:
        """The name of the subdomain among those of a coupler, whose dofs are checked."""
        name, s = keys[position(self.subdomain, keys)]
        if self._of_all and len(self.weights) != s.n:
            raise ValueError(
                f"weights of the Goal must have shape ({s.n},) as the dofs of {name!r}, got "
                f"{self.weights.shape}"
            )
        dof_list(list(self.dofs), s.n, f"dofs of {name!r} in the Goal", s.dof_names)
        return name


def _weighted(weights: Any) -> tuple[tuple[Any, ...], np.ndarray]:
    """Dofs by name or number, and their weights."""
    if isinstance(weights, (str, int, np.integer)) and not isinstance(weights, bool):
        return (weights,), np.ones(1)
    if isinstance(weights, Mapping):
        dofs = tuple(weights)
        numbers = [real_number(x, f"weights[{dof!r}]") for dof, x in weights.items()]
        values = np.array(numbers)
    else:
        values = real_array(weights, "weights")
        dofs = tuple(range(values.size))
    if not np.any(values):
        raise ValueError("weights must have an entry that is not zero, got none")
    return dofs, values


def _number(value: Any, t: float) -> float:
    array = np.asarray(value)
    if array.size != 1:
        raise ValueError(f"weight must return a number, got shape {array.shape} at t = {t:g}")
    return real_number(array.item(), f"weight at t = {t:g}")
