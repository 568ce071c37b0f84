"""Ready-made problems: the two of the paper, a shear frame, a measured earthquake.

The formulas are in docs/method.md. Units are any consistent set unless stated otherwise.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
import scipy
import scipy.sparse
from numpy.typing import ArrayLike

from . import structures
from ._checks import (
    positive_number,
    real_array,
    real_number,
    require_moderate,
    vector,
    whole_number,
)
from .memory import require
from .problem.constraints import Constraint, tie
from .problem.damping import rayleigh_coefficients
from .problem.matrices import canonical, diagonal, product, sparse_diagonal
from .problem.records import Record
from .problem.schemes import CentralDifference, GeneralizedAlpha, Newmark, Scheme
from .problem.subdomain import Subdomain
from .results.history import History
from .run.coupler import Coupler

__all__ = [
    "FourDof",
    "Model",
    "el_centro",
    "four_dof",
    "modal_damping",
    "rayleigh",
    "rths",
    "shear_frame",
    "split_oscillator",
]


# The benchmark of Silva and others (2020): mass of a storey and modal damping of each case, and the
# stiffness of all.
RTHS_CASES = {1: (1000.0, 0.05), 2: (1100.0, 0.04), 3: (1300.0, 0.03), 4: (1000.0, 0.03)}
RTHS_STIFFNESS = np.array(
    [
        [26054883.879603837, -23133938.877108198, 5937035.463339146],
        [-23133938.877108198, 32560774.186380334, -14419970.777236983],
        [5937035.463339146, -14419970.777236983, 9267275.506224312],
    ]
)


def __dir__() -> list[str]:
    return sorted(__all__)


@dataclass(frozen=True, eq=False)
class Model:
    """Subdomains and their constraints: a coupled problem without the macro step.

    Attributes
    ----------
    subdomains : tuple of Subdomain
        In the order of the couplers.
    constraints : Constraint
        The ties between them.
    """

    subdomains: tuple[Subdomain, ...]
    constraints: Constraint

    def coupler(self, dt: float, **options: Any) -> Coupler:
        """A new Coupler of these subdomains with macro step `dt`.

        Parameters
        ----------
        dt : float
            Macro step.
        **options
            Further arguments of `Coupler`: coupling, which is required, threads, ...

        Returns
        -------
        Coupler
            At t = 0.

        Raises
        ------
        ValueError, TypeError
            From `Coupler`.

        Examples
        --------
        >>> from pmalpha import models
        >>> history = models.split_oscillator(10.0).coupler(0.05, coupling="pm").run(steps=3)
        >>> history["A"].u.shape
        (4, 1)
        """
        return Coupler(self.subdomains, self.constraints, dt=dt, **options)


# ---- the two problems of the paper ----------------------------------------------------------


def split_oscillator(
    b1: float,
    *,
    rho: float | None = 0.5,
    substeps: int = 1,
    mass: float = 1.0,
    stiffness: float = (2.0 * np.pi) ** 2,
    u0: float = 1.0,
    v0: float = 0.0,
    scheme_a: Scheme | None = None,
    scheme_b: Scheme | None = None,
) -> Model:
    """A single-dof oscillator, cut into an implicit subdomain "A" and an explicit "B".

    mA / mB = kB / kA = b1: with a large b1, A is heavy and soft, B light and stiff. With the
    default mass and stiffness the period of the uncut oscillator is 1.

    Parameters
    ----------
    b1 : float
        Ratio of masses and of stiffnesses, above 0.
    rho : float or None
        Spectral radius at infinity of both generalized-alpha schemes, in [0, 1]. None: the
        trapezoidal rule in A and the central difference in B (the PM method).
    substeps : int
        Substeps of B per macro step; A takes one step.
    mass, stiffness : float
        Mass and stiffness of the uncut oscillator.
    u0, v0 : float
        Initial displacement and velocity.
    scheme_a, scheme_b : scheme or None
        Schemes of A and B that replace those given by `rho`.

    Returns
    -------
    Model
        Subdomains "A" and "B", tied: L_A = 1, L_B = -1.

    Raises
    ------
    ValueError
        If b1 is not positive; from the schemes and from `Subdomain`.

    Examples
    --------
    >>> from pmalpha import models
    >>> history = models.split_oscillator(10.0).coupler(0.01, coupling="pm").run(1.0)
    >>> bool(abs(history["A"].u[-1, 0] - 1.0) < 0.01)
    True
    """
    b1, mass = positive_number(b1, "b1"), positive_number(mass, "mass")
    stiffness = positive_number(stiffness, "stiffness")
    implicit, explicit = _schemes(rho)
    # mA + mB = mass, kA + kB = stiffness, mA / mB = kB / kA = b1
    large, small = b1 / (1.0 + b1), 1.0 / (1.0 + b1)
    start: dict[str, Any] = {"u0": [real_number(u0, "u0")], "v0": [real_number(v0, "v0")]}
    a = Subdomain(
        np.array([large * mass]),
        np.array([small * stiffness]),
        scheme=scheme_a or implicit,
        name="A",
        **start,
    )
    b = Subdomain(
        np.array([small * mass]),
        np.array([large * stiffness]),
        scheme=scheme_b or explicit,
        substeps=substeps,
        name="B",
        **start,
    )
    return Model((a, b), tie(a, [0], b, [0]))


@dataclass(frozen=True, eq=False)
class FourDof(Model):
    """The four-dof system of the paper, with the uncut chain for comparison.

    Created by `four_dof`. Subdomain "A" is {u2, u3, u4}, implicit; "B" is {u1, u2}, explicit.

    Attributes
    ----------
    springs : (4,) ndarray
        Stiffnesses ground-1, 1-2, 2-3, 3-4.
    mass : (4,) ndarray
        Diagonal of the mass matrix of the uncut chain.
    stiffness : (4, 4) ndarray
        Stiffness matrix of the uncut chain.
    frequencies : (4,) ndarray
        Natural frequencies in cycles per unit of time (Hz).
    modes : (4, 4) ndarray
        Mass-normalised modes in columns: modes.T @ diag(mass) @ modes = 1.
    """

    springs: np.ndarray
    mass: np.ndarray
    stiffness: np.ndarray
    frequencies: np.ndarray
    modes: np.ndarray

    @property
    def macro_step(self) -> float:
        """The macro step of the paper: dt f1 = 1/40."""
        return 1.0 / (40.0 * float(self.frequencies[0]))

    def displacements(self, history: History) -> tuple[np.ndarray, np.ndarray]:
        """Displacements of the chain at the macro time levels of a history.

        Parameters
        ----------
        history : History
            Of a coupler of this model, with all dofs of both subdomains recorded.

        Returns
        -------
        t : (k,) ndarray
            Times of the macro time levels.
        u : (k, 4) ndarray
            Of dof 2 the mean of the two sides.

        Raises
        ------
        ValueError
            If dofs are missing from the history.
        """
        return self._joined(history, "u")

    def modal_amplitudes(self, history: History) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes of the modes of the uncut chain at the macro time levels of a history.

        The amplitude of a mode with angular frequency omega is sqrt(q^2 + (q'/omega)^2), q its
        mass-normalised coordinate: constant in free vibration.

        Parameters
        ----------
        history : History
            Of a coupler of this model, with all dofs of both subdomains recorded.

        Returns
        -------
        t : (k,) ndarray
            Times of the macro time levels.
        amplitudes : (k, 4) ndarray
            Displacement times square root of mass, in the order of `frequencies`.

        Raises
        ------
        ValueError
            If dofs are missing from the history.

        Examples
        --------
        >>> from pmalpha import models
        >>> chain = models.four_dof()
        >>> history = chain.coupler(chain.macro_step, coupling="pm").run(steps=10)
        >>> t, amplitudes = chain.modal_amplitudes(history)
        >>> amplitudes[0].round(3).tolist()
        [0.716, 0.042, 0.697, 0.0]
        """
        t, u = self._joined(history, "u")
        _, v = self._joined(history, "v")
        # q = Phi^T M u,  q' = Phi^T M v
        project = self.mass[:, None] * self.modes
        return t, np.hypot(u @ project, v @ project / (2.0 * np.pi * self.frequencies))

    def _joined(self, history: History, quantity: str) -> tuple[np.ndarray, np.ndarray]:
        a, b = history["A"], history["B"]
        xa, xb = getattr(a, quantity), getattr(b, quantity)
        if xa.shape[1] != 3 or xb.shape[1] != 2:
            raise ValueError("history must have all dofs of A and B recorded")
        # time levels of both subdomains; equal instants are bitwise identical
        t, ia, ib = np.intersect1d(a.t, b.t, assume_unique=True, return_indices=True)
        xa, xb = xa[ia], xb[ib]
        u2 = (xa[:, 0] + xb[:, 1]) / 2.0
        return t, np.column_stack([xb[:, 0], u2, xa[:, 1], xa[:, 2]])


def four_dof(rho: float | None = 0.5, *, substeps: int = 20) -> FourDof:
    """The four-dof system of the paper, in free vibration from u = (0, 0, 0, 1).

    A surrogate with the published spectrum: the paper gives the frequencies 0.47, 2.90, 4.18 and
    9.47 Hz, not the masses and springs. The surrogate is a chain of unit masses, fixed at one end,
    with springs that give these frequencies. The second mass is cut into two halves.

    Parameters
    ----------
    rho : float or None
        Spectral radius at infinity of both generalized-alpha schemes (PM-alpha), in [0, 1]. None:
        the trapezoidal rule in A and the central difference in B (PM).
    substeps : int
        Substeps of B per macro step; A takes one step.

    Returns
    -------
    FourDof
        Frequencies are in Hz if time is in seconds; the units of length and mass are arbitrary.

    Raises
    ------
    ValueError
        From the schemes and from `Subdomain`.

    Examples
    --------
    >>> from pmalpha import models
    >>> models.four_dof().frequencies.round(6).tolist()
    [0.47, 2.9, 4.18, 9.47]
    """
    mass = np.ones(4)
    springs = _chain_springs(mass, (0.47, 2.90, 4.18, 9.47), (724.281, 1564.897, 18.343, 340.108))
    stiffness = shear_frame(mass, springs)[1].toarray()
    squares, modes = scipy.linalg.eigh(stiffness, np.diag(mass))

    implicit, explicit = _schemes(rho)
    a = Subdomain(
        np.array([0.5, 1.0, 1.0]),
        shear_frame([0.5, 1.0, 1.0], [0.0, *springs[2:]])[1].toarray(),
        scheme=implicit,
        u0=np.array([0.0, 0.0, 1.0]),
        name="A",
    )
    b = Subdomain(
        np.array([1.0, 0.5]),
        shear_frame([1.0, 0.5], springs[:2])[1].toarray(),
        scheme=explicit,
        substeps=substeps,
        name="B",
    )
    frequencies = np.sqrt(squares) / (2.0 * np.pi)
    return FourDof((a, b), tie(a, [0], b, [1]), springs, mass, stiffness, frequencies, modes)


def _schemes(rho: float | None) -> tuple[Scheme, Scheme]:
    """Implicit and explicit scheme: PM-alpha with rho, PM with None."""
    if rho is None:
        return Newmark(), CentralDifference()
    return GeneralizedAlpha(rho), GeneralizedAlpha(rho, explicit=True)


def _chain_springs(
    mass: np.ndarray, frequencies: Sequence[float], guess: Sequence[float]
) -> np.ndarray:
    """Spring stiffnesses of a chain with these frequencies, by Newton's method."""
    n = len(mass)
    springs = np.array(guess, dtype=float)
    target = (2.0 * np.pi * np.array(frequencies)) ** 2
    elongation = np.eye(n) - np.eye(n, k=-1)  # row j: elongation of spring j
    for _ in range(20):
        squares, modes = scipy.linalg.eigh(elongation.T * springs @ elongation, np.diag(mass))
        error = target - squares
        if np.all(np.abs(error) <= 1e-14 * target[-1]):  # rounding error of eigh
            break
        # d omega_i^2 / d k_j = (elongation of spring j in mode i)^2
        springs += np.linalg.solve(((elongation @ modes) ** 2).T, error)
    return springs


# ---- structures and loads -------------------------------------------------------------------


def shear_frame(
    masses: ArrayLike, stiffnesses: ArrayLike
) -> tuple[scipy.sparse.csr_array, scipy.sparse.csr_array]:
    """Matrices of a shear frame (a chain of masses and springs) fixed at the ground.

    Parameters
    ----------
    masses : (n,) array_like
        Masses of the storeys, from the lowest to the roof.
    stiffnesses : (n,) array_like
        Stiffness of the columns below each mass: force per storey drift. With 0 as the first one
        the frame is floating, such as the upper subdomain of a cut frame.

    Returns
    -------
    M : (n, n) csr_array
        Mass, diagonal; ``M.diagonal()`` are the masses.
    K : (n, n) csr_array
        Stiffness, tridiagonal.

    Raises
    ------
    TypeError, ValueError
        If the lengths differ, or a value is negative or not finite.

    Examples
    --------
    >>> from pmalpha import models
    >>> M, K = models.shear_frame([2.0, 1.0], [30.0, 10.0])
    >>> K.toarray().tolist()
    [[40.0, -10.0], [-10.0, 10.0]]
    >>> (0.5 * M + 0.1 * K).toarray().tolist()  # Rayleigh damping; or Subdomain(rayleigh=...)
    [[5.0, -1.0], [-1.0, 1.5]]
    """
    m, k = real_array(masses, "masses"), real_array(stiffnesses, "stiffnesses")
    if m.shape != k.shape or len(m) == 0:
        raise ValueError(
            f"masses and stiffnesses must have equal lengths, got shapes {m.shape} and {k.shape}"
        )
    for name, values in (("masses", m), ("stiffnesses", k)):
        if not np.all(values >= 0.0):
            raise ValueError(f"{name} must be finite and not negative, got {values.tolist()}")
    beside = -k[1:]
    K = scipy.sparse.diags_array(
        [beside, k + np.append(k[1:], 0.0), beside], offsets=[-1, 0, 1], shape=(len(m), len(m))
    )
    return sparse_diagonal(m), K.tocsr()


def rayleigh(omegas: Sequence[float], ratios: Sequence[float]) -> tuple[float, float]:
    """Coefficients of Rayleigh damping :math:`C = c_m M + c_k K` from two damping ratios.

    ``Subdomain(damping_ratio={T1: ratio1, T2: ratio2})`` takes periods in place of frequencies.
    If every subdomain uses the coefficients of the uncut structure with its own M and K, the
    damping matrices of the subdomains add up to that of the uncut structure.

    Parameters
    ----------
    omegas : two floats
        Different angular frequencies, above 0.
    ratios : two floats
        Damping ratios at these frequencies, below 1, which is critical damping: 5 per cent is 0.05.

    Returns
    -------
    c_m : float
        In 1/time.
    c_k : float
        In time.

    Raises
    ------
    TypeError, ValueError
        If the frequencies are not positive or equal, or not two, and for ratios of 1 and more.

    Examples
    --------
    >>> from pmalpha import models
    >>> c_m, c_k = models.rayleigh([10.0, 30.0], [0.05, 0.05])
    >>> round(c_m, 6), round(c_k, 6)
    (0.75, 0.0025)
    """
    at, wanted = vector(omegas, 2, "omegas"), vector(ratios, 2, "ratios")
    first, second = at.tolist()
    if not (first > 0.0 and second > 0.0 and first != second):
        raise ValueError(f"omegas must be two different positive numbers, got {omegas!r}")
    return rayleigh_coefficients([first, second], wanted.tolist(), "ratios")


def modal_damping(
    M: ArrayLike, K: ArrayLike, ratios: float | Sequence[float]
) -> np.ndarray | scipy.sparse.csr_array:
    """Damping matrix that gives each mode of a structure its own damping ratio.

    :math:`C = sum_i 2 ratio_i omega_i (M x_i) (M x_i)^T` with the mass-normalised modes x_i of M
    and K (Chopra, Dynamics of Structures). C is full: n^2 entries.

    Parameters
    ----------
    M, K : (n,) array, (n, n) array or scipy.sparse matrix or array
        Mass and stiffness, positive semidefinite, without the fixed dofs (`reduce`).
    ratios : float or (k,) array_like
        Damping ratios (1 is critical damping) of the k lowest modes, rigid-body modes included
        (which remain undamped); the higher modes are undamped. One number: of all modes.

    Returns
    -------
    (n, n) ndarray or csr_array
        In force per velocity; sparse, with all entries, if K is sparse.

    Raises
    ------
    TypeError, ValueError
        For ratios that are not numbers or negative, more of them than dofs with mass, and for
        matrices that `structures.modes` refuses.
    MemoryError
        When C would not fit.

    Examples
    --------
    >>> from pmalpha import models
    >>> M, K = models.shear_frame([1.0, 1.0], [3.0, 2.0])  # omega = 1, sqrt(6)
    >>> models.modal_damping(M, K, [0.05]).toarray().round(3).tolist()
    [[0.02, 0.04], [0.04, 0.08]]
    """
    values = real_array(ratios, "ratios", (0, 1))
    mass, n = canonical(M, "M")
    massive = 0 if mass is None else np.count_nonzero(diagonal(mass) > 0.0)
    if values.ndim == 0:
        values = np.full(massive, float(values))
    if values.size == 0:
        raise ValueError("ratios must not be empty, got none")
    if values.size > massive:
        raise ValueError(
            f"ratios must be at most {massive}, one for each dof with mass, got {values.size}"
        )
    if values.min() < 0.0:
        worst = int(np.argmin(values))
        raise ValueError(f"ratios must not be negative, got {values[worst]:g} at mode {worst}")
    require_moderate(values, "ratios")
    require(16.0 * n * n, f"the modal damping matrix ({n} dofs, dense)")
    omegas, shapes = structures.modes(M, K, values.size)
    momenta = product(mass, shapes) * np.sqrt(2.0 * values * omegas)
    C = momenta @ momenta.T
    return scipy.sparse.csr_array(C) if scipy.sparse.issparse(K) else C


def el_centro() -> Record:
    """Ground acceleration of El Centro 1940, component north-south.

    Peknold's version of the measured record, as published in Chopra, Dynamics of Structures (see
    pmalpha/data/README.md). The first number of the file is at t = 0.02 s; a zero at t = 0 is added
    before it. g = 9.81 m/s^2.

    Returns
    -------
    Record
        1561 values in m/s^2, the first at t = 0, the last at t = 31.2 s; dt = 0.02 s.
        ``acceleration, dt = el_centro()``.

    Examples
    --------
    >>> from pmalpha import models
    >>> models.el_centro()
    <Record 'El Centro 1940, north-south': 1561 samples, dt = 0.02, to t = 31.2, largest 3.128>
    """
    path = resources.files(__package__) / "data" / "el_centro_1940_ns.txt"
    lines = path.read_text(encoding="ascii").splitlines()
    numbers = " ".join(line for line in lines if not line.startswith("#")).split()
    values = 9.81 * np.array([0.0, *map(float, numbers)])
    return Record(values, 0.02, "El Centro 1940, north-south")


def rths(case: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """M, C, K of the benchmark of real-time hybrid simulation of Silva and others (2020).

    Three storeys, x relative to the ground: M x'' + C x' + K x = - M 1 a, in kg, N and m. The
    published specimen is at storey 1, of mass 29.13 kg, stiffness 1.19e6 N/m and damping
    114.2209 N s/m: the numerical part is what is left of the structure without it, under the load
    of the whole mass. `rig.servo_hydraulic` is its transfer system.

    Parameters
    ----------
    case : {1, 2, 3, 4}, default 1
        Masses of 1000, 1100, 1300, 1000 kg a storey, modal damping of 5, 4, 3, 3 per cent.

    Returns
    -------
    M : (3, 3) ndarray
        Mass of the whole structure.
    C : (3, 3) ndarray
        Its damping.
    K : (3, 3) ndarray
        Its stiffness.

    Examples
    --------
    >>> from pmalpha import models
    >>> M, C, K = models.rths()
    >>> f = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K))) / (2 * np.pi)
    >>> np.sort(f).round(3).tolist()
    [3.612, 15.997, 38.086]
    """
    mass, damping = RTHS_CASES[whole_number(case, "case", low=1, high=4)]
    M = mass * np.eye(3)
    C = np.asarray(modal_damping(M, RTHS_STIFFNESS, damping))
    return M, C, RTHS_STIFFNESS.copy()
