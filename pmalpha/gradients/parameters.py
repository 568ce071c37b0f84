"""What a gradient is taken with respect to: derivatives of the matrices of a subdomain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import real_array
from ..problem.frozen import Frozen
from ..problem.subdomain import Subdomain

__all__ = ["Parameters"]


class Parameters(Frozen):
    """Derivatives of the matrices of one subdomain with respect to m parameters.

    Parameters
    ----------
    subdomain : Subdomain or str
        The subdomain, or its name.
    dofs : (m, k) array of int, optional
        Dofs of the element that belongs to each parameter. Then K, C and M are element matrices.
    K, C, M : (k, k) or (m, k, k) array, or list of m (n, n) matrices
        Derivatives of these matrices: with `dofs` one element matrix for all parameters or one
        for each; without, m dense or sparse matrices. With Rayleigh damping a stiffness
        parameter has ``C = c_k * K``. Those left out are zero.

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
    ):
        if not isinstance(subdomain, (Subdomain, str)):
            raise TypeError(
                f"subdomain must be a Subdomain or the name of one, got {type(subdomain).__name__}"
            )
        given = {name: x for name, x in (("K", K), ("C", C), ("M", M)) if x is not None}
        if not given:
            raise ValueError("K, C or M must be given, got none of them")
        self.subdomain = subdomain
        self.dofs: np.ndarray | None = None
        self.matrices: dict[str, Any]  # element matrices, or lists of matrices
        if dofs is None:
            self.matrices = {x: _listed(value, x) for x, value in given.items()}
            counts = {name: len(value) for name, value in self.matrices.items()}
            if len(set(counts.values())) != 1:
                raise ValueError(f"K, C and M must be lists of one length, got {counts}")
            self.m = next(iter(counts.values()))
        else:
            self.dofs = _whole(dofs)
            self.m = len(self.dofs)
            self.matrices = {x: _element(value, x, self.dofs) for x, value in given.items()}
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
            if self.dofs.max(initial=-1) >= n:
                raise ValueError(
                    f"dofs of Parameters must be below {n}, the number of dofs of {name!r}, got "
                    f"{self.dofs.max()}"
                )
            return
        for kind, matrices in self.matrices.items():
            for j, matrix in enumerate(matrices):
                if matrix.shape != (n, n):
                    raise ValueError(
                        f"{kind}[{j}] of Parameters must have shape {(n, n)}, got {matrix.shape}"
                    )

    def _products(self, mu: np.ndarray, motion: dict[str, np.ndarray]) -> np.ndarray:
        """- sum_k mu_k . (dM w_k + dC v_k + dK u_k) for each parameter, (A9).

        Parameters
        ----------
        mu : (levels, n) array
        motion : dict
            What stands beside "M", "C" and "K": w, v and u (levels, n); of an explicit scheme the
            predictor for u.
        """
        total = np.zeros(self.m)
        for kind, matrices in self.matrices.items():
            x = motion[kind]
            if self.dofs is None:
                total -= [np.vdot(mu, (D @ x.T).T) for D in matrices]
            else:
                of_elements = np.einsum("lmi,lmj->mij", mu[:, self.dofs], x[:, self.dofs])
                total -= np.einsum(
                    "mij,mij->m", of_elements, np.broadcast_to(matrices, of_elements.shape)
                )
        return total

    def _force(self, j: int, motion: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Dofs, and -(dM w + dC v + dK u) on them, (levels, dofs), for parameter j."""
        if self.dofs is not None:
            dofs = self.dofs[j]
            total = np.zeros((len(motion["K"]), dofs.size))
            for kind, element in self.matrices.items():
                D = element if element.ndim == 2 else element[j]
                total -= motion[kind][:, dofs] @ D.T
            return dofs, total
        total = np.zeros_like(motion["K"])
        for kind, listed in self.matrices.items():
            total -= (listed[j] @ motion[kind].T).T
        dofs = np.flatnonzero(np.any(total, axis=0))
        dofs = dofs if dofs.size else np.zeros(1, int)
        return dofs, total[:, dofs]

    def _traces(self, Y: np.ndarray, Z: np.ndarray, weights: dict[str, float]) -> np.ndarray:
        """tr(dMbar_j Y Z^T) with dMbar = sum of weights times dM, dC, dK, for (A10)."""
        total = np.zeros(self.m)
        for kind, matrices in self.matrices.items():
            if weights[kind] == 0.0:
                continue
            if self.dofs is None:
                total += [weights[kind] * np.sum(Z * (D @ Y)) for D in matrices]
            else:
                of_elements = np.einsum("mip,mjp->mij", Z[self.dofs], Y[self.dofs])
                total += weights[kind] * np.einsum(
                    "mij,mij->m", of_elements, np.broadcast_to(matrices, of_elements.shape)
                )
        return total


def _whole(dofs: Any) -> np.ndarray:
    array = np.asarray(dofs)
    if array.ndim != 2 or array.size == 0 or not np.issubdtype(array.dtype, np.integer):
        raise ValueError(
            "dofs must be an (m, k) array of whole numbers, a row for each parameter, got "
            f"shape {array.shape} of {array.dtype}"
        )
    if array.min() < 0:
        raise ValueError(f"dofs must be 0 or more, got {array.min()}")
    return array


def _element(value: Any, name: str, dofs: np.ndarray) -> np.ndarray:
    m, k = dofs.shape
    array = real_array(value, name, (2, 3))
    if array.shape not in ((k, k), (m, k, k)):
        raise ValueError(f"{name} must have shape {(k, k)} or {(m, k, k)}, got {array.shape}")
    return array


def _listed(value: Any, name: str) -> list[Any]:
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise TypeError(
            f"{name} must be a list of matrices where no dofs are given, got {type(value).__name__}"
        )
    return [sp.csr_array(x) if sp.issparse(x) else real_array(x, f"{name}[i]", (2,)) for x in value]
