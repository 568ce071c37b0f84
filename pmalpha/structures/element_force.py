"""Internal forces of nonlinear elements, with their tangents and their history.

How the matrices of a structure are made of its elements, for all or for some of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import scipy.sparse as sp

from .._checks import plain_array
from ..problem.dofs import dof_list

__all__ = ["ElementForce"]


class Selected(NamedTuple):
    """Elements of a structure, all or some, and numbers for their nodes, which only say which
    elements are connected: with a node of its own for each corner matrices are of single elements.
    """

    chosen: Mapping[str, Any]  # by kind, the numbers of the elements, or slice(None) for all
    elements: Mapping[str, np.ndarray]  # by kind, (chosen elements, corners)
    nodes: int  # how many

    def rows(self, kind: str, values: Iterable[np.ndarray]) -> list[np.ndarray]:
        """The values of these elements, from those of all."""
        return [of_chosen(x, self.chosen[kind]) for x in values]


# recipe(selected) -> (M, K, forces) of the elements on the dofs of their nodes: M (n,) or (n, n).
Made: TypeAlias = "tuple[Any, Any, tuple[ElementForce, ...]]"
Recipe: TypeAlias = Callable[[Selected], Made]


def of_chosen(values: np.ndarray, chosen: Any) -> np.ndarray:
    """The rows of the chosen elements; one row is that of every element."""
    return values if len(values) == 1 else values[chosen]


class ElementForce:
    """An internal force f(u) of elements on all dofs of a structure, with its tangent.

    Made by `truss`, `corotational_frame`, `nonlinear_solid`, `nonlinear_solid_on`, `plane_contact`
    and `sphere_contact`; `Structure.internal` holds them. f is on the left-hand side of
    :math:`M a + C v + K u + f(u) = F`. A call changes nothing, neither the object nor its
    arguments. Forces that are the derivative of an energy have, besides the methods below,
    ``potential(u)``, which returns that energy; those of plastic solids have not.

    Attributes
    ----------
    n : int
        Number of dofs.
    pattern : (n, n) csr_array
        Entries that the tangent can have, with the value 1; indices are sorted. Rows of dofs on
        which the force does not depend are empty.
    history : (m,) ndarray
        Internal variables at t = 0; m = 0 where the force depends on u alone.

    Examples
    --------
    A cable of two pieces between (0, 0) and (2, 0), its middle pulled up by 0.1 and pushed down:

    >>> from pmalpha import structures
    >>> cable = structures.truss([[0, 0], [2, 0]], [[0, 1]], EA=100.0, rhoA=1.0, divisions=2,
    ...                      prestress=5.0, slack=True)
    >>> (force,) = cable.internal
    >>> u = np.zeros(force.n)
    >>> u[cable.dofs(2, "uy")] = 0.1
    >>> f, K_t, C_t, q1 = force(0.0, u, np.zeros(force.n), force.history)
    >>> f[cable.dofs(2)].round(4).tolist()
    [0.0, 1.0943]
    >>> K_t.shape == force.pattern.shape and C_t is None
    True
    """

    n: int
    pattern: sp.csr_array
    history: np.ndarray

    def __init__(self, pattern: sp.csr_array, history: np.ndarray | None = None):
        self.n, self.pattern = pattern.shape[0], pattern
        self.history = np.zeros(0) if history is None else history
        self.history.setflags(write=False)

    def __repr__(self) -> str:
        history = f", {self.history.size} of history" if self.history.size else ""
        return f"<{type(self).__name__} of {self.n} dofs{history}>"

    def __call__(
        self, t: Any = 0.0, u: Any = None, v: Any = None, q: Any = None
    ) -> tuple[np.ndarray, sp.csr_array, None, np.ndarray]:
        """The force, its tangents and the history.

        Parameters
        ----------
        t : float, optional
            The time, on which no element of this package depends: it can be left out, ``(u)``.
        u : (n,) array_like
            Displacements.
        v : optional
            Velocities, on which no element depends either.
        q : (m,) array_like, optional
            The history at the beginning of the step. Default: that at t = 0.

        Returns
        -------
        f : (n,) ndarray
        K_t : (n, n) csr_array
            df/du, symmetric, with the entries of `pattern`. With history it is the derivative of
            what this function returns for a fixed q (the consistent tangent).
        C_t : None
            df/dv is zero.
        q1 : (m,) ndarray
            The history at the end of the step.

        Raises
        ------
        ValueError
            If u or q have another shape.
        """
        f, K, q1 = self._evaluate(
            self._displacements(*((t,) if u is None else (u, t))), self._before(q), True
        )
        return f, K, None, q1

    def residual(self, t: Any = 0.0, u: Any = None, v: Any = None, q: Any = None) -> np.ndarray:
        """The force alone, which takes a quarter of the time of force and tangent.

        Parameters
        ----------
        t : float, optional
            Time. Default: 0, where u is given alone: ``residual(u)``.
        u, v, q : (n,) and (m,) array_like
            As for a call.

        Returns
        -------
        (n,) ndarray
            Bitwise identical to f of a call.

        Raises
        ------
        ValueError
            If u or q have another shape.

        Examples
        --------
        >>> from pmalpha import structures
        >>> bar = structures.truss([[0, 0], [2, 0]], [[0, 1]], EA=100.0, rhoA=1.0)
        >>> bar.internal[0].residual([0.0, 0.0, 0.02, 0.0]).round(12).tolist()
        [-1.0, 0.0, 1.0, 0.0]
        """
        return self._evaluate(
            self._displacements(*((t,) if u is None else (u, t))), self._before(q), False
        )[0]

    def largest_tangent(self) -> sp.csr_array | None:
        """The stiffest tangent, for the critical step of an explicit subdomain.

        Returns
        -------
        csr_array or None
            Of contact that is closed at all of its nodes; None where the tangent at u stands for
            it.
        """
        return None

    def reduced(self, free: Any) -> ElementForce:
        """The force on some of the dofs, the others being fixed at zero.

        Parameters
        ----------
        free : (k,) array of int or (n,) array of bool
            The dofs that remain, such as `Reduction.free`.

        Returns
        -------
        ElementForce
            Of k dofs, with the same history.

        Raises
        ------
        TypeError, ValueError
            For dofs out of range or repeated.

        Examples
        --------
        >>> from pmalpha import structures
        >>> bar = structures.truss([[0, 0], [2, 0]], [[0, 1]], EA=100.0, rhoA=1.0)
        >>> free = reduce(bar.M, bar.K, fixed=[0, 1, 3]).free
        >>> f, K_t, _, _ = bar.internal[0].reduced(free)([0.02])
        >>> f.round(12).tolist(), K_t.toarray().round(12).tolist()
        ([1.0], [[50.0]])
        """
        dofs = dof_list(free, self.n, "free")
        kind = _ReducedConservative if isinstance(self, Conservative) else _Reduced
        return kind(self, dofs)

    def of_nodes(self, number: np.ndarray, nodes: int) -> ElementForce | None:
        """The force at some of the nodes, which `pmalpha.cut` gives to a subdomain.

        Forces at nodes, such as contact, implement it; those of elements are made anew by the
        `recipe` of their structure.

        Parameters
        ----------
        number : (N,) array of int
            The new number of each node, -1 for those that are left out.
        nodes : int
            How many have a number.

        Returns
        -------
        ElementForce or None
            On the dofs of these nodes in their new numbers; None if it has none there.

        Raises
        ------
        TypeError
            If the force does not know its nodes.
        """
        raise TypeError(
            f"structure must have internal forces of its elements and contact only, got {self!r}"
        )

    def _displacements(self, u: Any, t: Any = 0.0) -> np.ndarray:
        if np.ndim(t) > 0:
            raise TypeError(f"t must be a number, the first argument, got shape {np.shape(t)}")
        values = plain_array(u, "u")
        if values.shape != (self.n,):
            raise ValueError(f"u must have shape ({self.n},), got {values.shape}")
        return np.ascontiguousarray(values, dtype=np.float64)

    def _before(self, q: Any) -> np.ndarray:
        values = self.history if q is None else plain_array(q, "q")
        if values.shape != self.history.shape:
            raise ValueError(f"q must have shape {self.history.shape}, got {values.shape}")
        return np.ascontiguousarray(values, dtype=np.float64)

    def _evaluate(
        self, u: np.ndarray, q: np.ndarray, tangent: bool
    ) -> tuple[np.ndarray, Any, np.ndarray]:
        """f, K_t (None without `tangent`) and q1."""
        raise NotImplementedError


class Conservative(ElementForce):
    """An ElementForce that is the gradient of a potential."""

    def potential(self, u: Any) -> float:
        """The energy, zero without strain, whose derivative by u, (n,) array, is the force."""
        return self._potential(self._displacements(u))

    def _potential(self, u: np.ndarray) -> float:
        raise NotImplementedError


class _Reduced(ElementForce):
    """A force on some of its dofs."""

    def __init__(self, force: ElementForce, free: np.ndarray):
        pattern = force.pattern
        numbered = sp.csr_array(
            (np.arange(pattern.nnz), pattern.indices, pattern.indptr), shape=pattern.shape
        )
        block = numbered[free][:, free]
        block.sort_indices()
        self._whole, self._free, self._entries = force, free, block.data
        ones = np.ones(block.nnz)
        super().__init__(in_pattern(ones, block), force.history)

    def __repr__(self) -> str:
        return repr(self._whole).replace(" dofs", f" dofs reduced to {self.n}")

    def largest_tangent(self) -> sp.csr_array | None:
        tangent = self._whole.largest_tangent()
        return None if tangent is None else sp.csr_array(tangent[self._free][:, self._free])

    def _expanded(self, u: np.ndarray) -> np.ndarray:
        displacements = np.zeros(self._whole.n)
        displacements[self._free] = u
        return displacements

    def _evaluate(
        self, u: np.ndarray, q: np.ndarray, tangent: bool
    ) -> tuple[np.ndarray, Any, np.ndarray]:
        f, K, q1 = self._whole._evaluate(self._expanded(u), q, tangent)
        if tangent:
            K = in_pattern(K.data[self._entries], self.pattern)
        return f[self._free], K, q1


class _ReducedConservative(_Reduced, Conservative):
    _whole: Conservative

    def _potential(self, u: np.ndarray) -> float:
        return self._whole._potential(self._expanded(u))


def in_pattern(values: np.ndarray, pattern: sp.csr_array) -> sp.csr_array:
    """The matrix with these entries in a pattern of sorted indices, which it shares."""
    matrix = sp.csr_array((values, pattern.indices, pattern.indptr), shape=pattern.shape)
    matrix.has_canonical_format = True
    return matrix
