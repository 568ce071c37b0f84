"""What a gradient is taken with respect to: derivatives of the matrices of a subdomain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import plain_array, real_array
from ..problem.dofs import dof_array
from ..problem.frozen import Frozen
from ..problem.subdomain import Subdomain

__all__ = ["Parameters"]

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
