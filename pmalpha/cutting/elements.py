"""Elements with their matrices, from any program."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._cached import Frozen
from .._checks import counted, damping_by_name, flag, listing, plain_array, real_array
from ..problem.arguments import OF_ELEMENTS, check_order

__all__ = ["Elements"]

# Rounding of an element matrix, relative to its largest entry: that of a file with ten digits.
SYMMETRY = 1e-10
# Elements that are checked at a time.
CHUNK = 4096


class Elements(Frozen):
    """Elements of one kind with their matrices, for `cut`.

    Parameters
    ----------
    dofs : (e, k) array of int
        The dofs of each element in the structure, 0, 1, ...; a negative number is a fixed dof.
    M : (e, k), (e, k, k) array, or with 1 in place of e, or None
        Mass matrices of the elements, (e, k) for lumped masses. One row is that of all elements.
        None: no mass.
    K : (e, k, k) or (1, k, k) array, or None
        Stiffness matrices, symmetric. None is allowed with `internal`.
    C : (e, k, k) or (1, k, k) array, optional
        Damping matrices, symmetric. Default: none.
    internal : callable, optional
        Internal forces of elements, added to K u: ``internal(t, u, v, q, elements)`` returns
        ``(f, K_t)``, ``(f, K_t, C_t)`` or ``(f, K_t, C_t, q1)`` with f (m, k), the tangents
        (m, k, k) or None, and the history q1 (m, h) at the end of the step, for the m elements
        whose numbers in this group are in ``elements`` (m,); u and v are (m, k), zero at fixed
        dofs, q is (m, h). A pure function.
    history : (e, h) array, optional
        History of each element at t = 0. Default: none.

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, values that are not finite, matrices that are not symmetric, and negative
        masses, which elements with a negative volume have.

    Examples
    --------
    Three rods in a row, the first of them fixed at its left end:

    >>> k = 4.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    >>> rods = Elements([[-1, 0], [0, 1], [1, 2]], M=[[0.5, 0.5]], K=[k])
    >>> rods
    <Elements: 3 elements of 2 dofs, lumped mass>
    >>> cut(rods, [0, 0, 1]).subdomains[0].K.toarray().tolist()
    [[8.0, -4.0], [-4.0, 4.0]]
    """

    @damping_by_name
    def __init__(
        self,
        dofs: ArrayLike,
        M: ArrayLike | None,
        K: ArrayLike | None,
        *,
        C: ArrayLike | None = None,
        internal: Callable[..., Any] | None = None,
        history: ArrayLike | None = None,
    ):
        self.dofs = _checked_dofs(dofs)
        self.M = None if M is None else self._matrices(M, "M", (2, 3))
        self.K = None if K is None else self._matrices(K, "K", (3,))
        self.C = None if C is None else self._matrices(C, "C", (3,))
        if self.M is not None:
            self._require_mass()
        if internal is not None and not callable(internal):
            raise TypeError(f"internal must be callable, got {internal!r}")
        if internal is not None:
            check_order(internal, OF_ELEMENTS, "internal")
        if K is None and internal is None:
            raise TypeError("K must not be None without internal forces")
        if history is not None and internal is None:
            raise TypeError("history must come with internal forces")
        self.internal = internal
        values = np.zeros((len(self.dofs), 0)) if history is None else history
        self.history = real_array(values, "history", 2)
        if len(self.history) != len(self.dofs):
            raise ValueError(
                f"history must have {counted(len(self.dofs), 'row')}, got {len(self.history)}"
            )
        self._freeze()

    @classmethod
    @damping_by_name
    def from_skfem(
        cls,
        basis: Any,
        M: Any,
        K: Any,
        *,
        C: Any = None,
        fixed: Any = (),
        lumped: bool = False,
    ) -> Elements:
        """Elements of scikit-fem, by its basis and bilinear forms.

        Parameters
        ----------
        basis : skfem.CellBasis
            Of one element, which may be a vector of elements.
        M, K : skfem.BilinearForm
            Mass and stiffness, symmetric.
        C : skfem.BilinearForm, optional
            Damping. Default: none.
        fixed : array of int, or what ``basis.get_dofs`` returns, optional
            Fixed dofs. Dof i of the structure is dof ``basis.complement_dofs(fixed)[i]`` of the
            basis.
        lumped : bool, default False
            Row sums of the mass matrices: for displacements with linear shape functions.

        Raises
        ------
        TypeError, ValueError
            For what is no basis or no form of scikit-fem, and as of `Elements`.

        Examples
        --------
        >>> import skfem
        >>> from skfem.helpers import dot, grad
        >>> mesh = skfem.MeshTri().refined(2).with_boundaries({"left": lambda x: x[0] == 0.0})
        >>> basis = skfem.Basis(mesh, skfem.ElementTriP1())
        >>> mass = skfem.BilinearForm(lambda u, v, w: u * v)
        >>> stiffness = skfem.BilinearForm(lambda u, v, w: dot(grad(u), grad(v)))
        >>> Elements.from_skfem(basis, mass, stiffness, fixed=basis.get_dofs("left"), lumped=True)
        <Elements: 32 elements of 3 dofs, lumped mass>
        """
        if not all(hasattr(basis, name) for name in ("element_dofs", "complement_dofs", "N")):
            raise TypeError(f"basis must be a basis of scikit-fem, got {basis!r}")
        if isinstance(fixed, (tuple, list)):
            fixed = np.asarray(fixed, dtype=np.int64)
        free = basis.complement_dofs(fixed)
        number = np.full(basis.N, -1)
        number[free] = np.arange(free.size)
        mass = _local(basis, M, "M")
        return cls(
            number[basis.element_dofs.T],
            mass.sum(axis=2) if flag(lumped, "lumped") else mass,
            _local(basis, K, "K"),
            C=None if C is None else _local(basis, C, "C"),
        )

    def __repr__(self) -> str:
        e, k = self.dofs.shape
        facts = [f"{counted(e, 'element')} of {counted(k, 'dof')}"]
        if self.M is None or self.M.ndim == 2:
            facts.append("no mass" if self.M is None else "lumped mass")
        if self.internal is not None:
            facts.append("internal forces")
        return f"<Elements: {', '.join(facts)}>"

    def _matrices(self, value: ArrayLike, name: str, ndim: tuple[int, ...]) -> np.ndarray:
        e, k = self.dofs.shape
        array = plain_array(value, name)
        if array.dtype.kind not in "iuf":
            raise TypeError(f"{name} must hold real numbers, got dtype {array.dtype}")
        rows = array.shape[:1]
        if array.ndim not in ndim or array.shape[1:] != (k,) * (array.ndim - 1):
            rows = ()
        if rows not in ((e,), (1,)):
            shapes = " or ".join(str((e, *(k,) * (d - 1))) for d in ndim)
            raise ValueError(
                f"{name} must have shape {shapes}, or one row for all elements, got {array.shape}"
            )
        array = np.asarray(array, dtype=np.float64)
        for first in range(0, len(array), CHUNK):
            _check_chunk(array[first : first + CHUNK], name, first)
        return array

    def _require_mass(self) -> None:
        assert self.M is not None
        masses = self.M if self.M.ndim == 2 else np.einsum("ekk->ek", self.M)
        negative = np.flatnonzero((masses < 0.0).any(axis=1))
        if negative.size:
            raise ValueError(
                f"M must not be negative, got {masses[negative[0]].min():g} in "
                f"{counted(negative.size, 'element')}, {listing(negative)}: is their volume "
                "negative?"
            )


def _local(basis: Any, form: Any, name: str) -> np.ndarray:
    """The element matrices (e, k, k) of a bilinear form; its rows are those of test functions."""
    if not hasattr(form, "elemental"):
        raise TypeError(f"{name} must be a BilinearForm of scikit-fem, got {form!r}")
    local: np.ndarray = form.elemental(basis).tolocal()
    return local


def _checked_dofs(value: ArrayLike) -> np.ndarray:
    dofs = plain_array(value, "dofs")
    if dofs.dtype.kind not in "iu":
        raise TypeError(f"dofs must hold whole numbers, got dtype {dofs.dtype}")
    if dofs.ndim != 2 or not dofs.size:
        raise ValueError(f"dofs must have shape (elements, dofs of one), got {dofs.shape}")
    if not np.any(dofs >= 0):
        raise ValueError("dofs must not all be fixed")
    return dofs.astype(np.int64)


def _check_chunk(values: np.ndarray, name: str, first: int) -> None:
    finite = np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    if not finite.all():
        raise ValueError(f"{name} must be finite, not in element {first + int(np.argmin(finite))}")
    if values.ndim != 3:
        return
    skew = np.abs(values - np.swapaxes(values, 1, 2)).max(axis=(1, 2))
    wrong = np.flatnonzero(skew > SYMMETRY * np.abs(values).max(axis=(1, 2)))
    if wrong.size:
        raise ValueError(
            f"{name} must be symmetric, got a difference of {skew[wrong[0]]:g} from its transpose "
            f"in element {first + int(wrong[0])}"
        )
