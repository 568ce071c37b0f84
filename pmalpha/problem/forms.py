"""What the core takes by name: matrices, factors and the parts of a subdomain.

Each is a dict of the tree that `_core` reads, with its fields for keys (csrc/core/describe).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, TypeAlias, get_args

import numpy as np
from scipy import LowLevelCallable

from .._cached import Frozen
from .._checks import check_word, real_number, whole_number
from .._core import MOST_ITERATIONS
from .arguments import TangentPolicy


class Band(NamedTuple):
    """Diagonals of a matrix, (width + 1, n), or columns of a factor, (n, width)."""

    band: np.ndarray


class Compressed(NamedTuple):
    """A sparse matrix by rows, or a factor or link by columns."""

    ptr: np.ndarray
    indices: np.ndarray
    values: np.ndarray


class Strips(NamedTuple):
    """A sparse matrix whose adjacent rows with the same columns are stored together."""

    first: np.ndarray
    ptr: np.ndarray
    indices: np.ndarray
    start: np.ndarray
    values: np.ndarray


class Supernodes(NamedTuple):
    """The structure of a factor in panels, and the supernode of each column."""

    first: np.ndarray
    row_ptr: np.ndarray
    rows: np.ndarray
    start: np.ndarray
    owner: np.ndarray


class Panels(NamedTuple):
    """A factor in panels."""

    first: np.ndarray
    row_ptr: np.ndarray
    rows: np.ndarray
    start: np.ndarray
    values: np.ndarray


class Factor(NamedTuple):
    """The reciprocals of D, and R in a form of the core.

    Of an unsymmetric matrix, values have one axis more, the first, of length 2: for R and Q, which
    has the same pattern.
    """

    inverse: np.ndarray
    R: Any


class Operator(NamedTuple):
    """Step length and factor of Mbar."""

    h: float
    factor: Factor


class StepOperator(NamedTuple):
    """The same for the core: with the constants of the step."""

    step: Any
    inverse: np.ndarray | None
    R: Any


class Columns(NamedTuple):
    """Columns of a link with p rows."""

    p: int
    ptr: np.ndarray
    indices: np.ndarray
    values: np.ndarray


class Numeric(NamedTuple):
    """A pattern that is factored again and again; structure is None of a diagonal."""

    ptr: np.ndarray
    indices: np.ndarray
    structure: Supernodes | None
    dgemm: Any
    dtrsm: Any
    unsymmetric: bool


class Springs(NamedTuple):
    """Springs of one law, between positions; -1 is the ground."""

    law: int
    first: np.ndarray
    second: np.ndarray
    parameters: tuple[np.ndarray, ...]


class Restoring(NamedTuple):
    """Functions whose sum counts, the dof at each position, and a load among their results."""

    functions: tuple[Any, ...]
    order: np.ndarray
    load: np.ndarray | None


class Actuator(NamedTuple):
    """A filter of commands: (Y1) to (Y3)."""

    lag: np.ndarray
    weight: np.ndarray
    largest: float
    phi: np.ndarray
    before: np.ndarray
    after: np.ndarray
    slope: np.ndarray
    noise: float
    quantum: float
    seed: int


class Adaptive(NamedTuple):
    """A filter that adapts: (Y6), (Y7). limits: rows of start, least, most and change."""

    h: float
    limits: np.ndarray
    threshold: float
    every: int
    window: int
    section: np.ndarray


class Modal(NamedTuple):
    """A linear filter y = C z + D u, z := A z + B u, with its poles in pairs: of A what a state has
    of itself and of the other one of its pair. rest: z under a constant u."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    rest: np.ndarray


class Inverse(NamedTuple):
    """A filter that inverts a model, (Y14) to (Y16). rate, acceleration: factors of d' and d''."""

    h: float
    rate: float
    acceleration: float
    command: Modal
    feedback: Modal | None
    regressors: Modal | None
    low: Modal | None
    sigma: float
    largest: float


class LinkageMatrix(NamedTuple):
    """A filter of commands J d, forces J^T f."""

    matrix: np.ndarray
    inverse: np.ndarray


class LinkageArms(NamedTuple):
    """The same by two arms, length and angle of each, (Y17)."""

    arms: np.ndarray


Filter: TypeAlias = Actuator | Adaptive | Inverse | LinkageMatrix | LinkageArms


class Linear(NamedTuple):
    """A specimen that is a linear system, (Y13)."""

    phi: np.ndarray
    before: np.ndarray
    after: np.ndarray
    rest: np.ndarray
    displacement: np.ndarray
    force: np.ndarray
    lag: np.ndarray
    weight: np.ndarray
    largest: float
    noise: float
    force_noise: float
    quantum: float
    seed: int


class Specimen(NamedTuple):
    """Filters, the outermost first, and what follows them: a linear system, or springs and a
    function.

    dofs: of the commands; None: all. leading: number of the first filters that are no part of a
    simulated rig; compensators: of those up to the last compensator among them. h: of a step, 0
    where no filter needs accelerations.
    """

    filters: tuple[Filter, ...]
    linear: Linear | None
    springs: tuple[Springs, ...]
    function: Any
    dofs: np.ndarray | None
    compensators: int
    leading: int
    h: float


class Path(NamedTuple):
    """A path (segments, width) of dofs, their shape functions (segments, width, 4) along it, and
    how a point runs there."""

    ends: np.ndarray
    dofs: np.ndarray
    shape: np.ndarray
    start: float
    speed: float


class Wheels(NamedTuple):
    """Springs of which ends run along paths: of each end, (springs, 2), dof and path, or -1."""

    springs: tuple[Springs, ...]
    ends: np.ndarray
    points: np.ndarray
    paths: tuple[Path, ...]


class InternalForce(NamedTuple):
    """A function, numbers in its history, where each value of its pattern is in that of the tangent
    and which one is across the diagonal from it, and its potential."""

    function: Any
    history: int
    where: np.ndarray | None
    across: np.ndarray | None
    potential: Any


class Sampled(NamedTuple):
    """A sampled load: series by columns, and the dofs on which each acts."""

    values: np.ndarray
    shape: np.ndarray | None
    dt: float
    hold: bool
    begin: float


class Table(NamedTuple):
    """Loads of substeps, by rows, from the substep `first` on."""

    rows: np.ndarray
    first: int


class Moving(NamedTuple):
    """A load along a path: samples (m,) of its size."""

    values: np.ndarray
    dt: float
    hold: bool
    begin: float
    path: Path


class Called(NamedTuple):
    """A load that is a compiled function, and the dof at each position."""

    function: LowLevelCallable
    order: np.ndarray


Load: TypeAlias = np.ndarray | Sampled | Table | Moving | Called | None


class Limits(NamedTuple):
    """What a specimen may be commanded and may return; None is not limited."""

    displacement: np.ndarray | None
    velocity: np.ndarray | None
    acceleration: np.ndarray | None
    force: np.ndarray | None
    energy: float


class Watch(NamedTuple):
    """The matrices with which evaluated forces are watched; K acts where they are evaluated."""

    M: Any
    K_r: Any
    is_explicit: bool


class Responses(NamedTuple):
    """States at the end of a macro step, (k, 4, n), for unit multipliers of these constraints."""

    rows: np.ndarray
    states: np.ndarray


class Internal(NamedTuple):
    order: np.ndarray
    initial: np.ndarray
    forces: tuple[InternalForce, ...]


class Iterate(NamedTuple):
    """What an iterated subdomain needs: its pattern and the constant part of Mbar."""

    springs: bool
    keeps: bool
    pattern: Numeric
    base: np.ndarray
    base_twice: np.ndarray | None
    M_size: Any
    threads: int


class Impulse(NamedTuple):
    """What impulses meet (U4)."""

    inverse: np.ndarray
    alpha: float
    beta: float
    B: Columns | None


class Iteration(NamedTuple):
    """How a fine step is iterated: the pattern of H and the entries of its constant part."""

    tolerance: float
    iterations: int
    reuse: bool
    pattern: Numeric
    start: np.ndarray
    later: np.ndarray


class Shooting(NamedTuple):
    """How a macro step is iterated: the linear subdomains' part of H, and the size of H."""

    tolerance: float
    iterations: int
    reuse: bool
    response_start: Any
    response: Any
    H_size: Any


class Motion(NamedTuple):
    """The rows of a prescribed velocity, which may be set later."""

    rows: np.ndarray
    velocity: Load


class Remote(NamedTuple):
    """A subdomain of another process; rows are its constraints if its steps are iterated."""

    nb: int
    substeps: int
    h: float
    doubled: bool
    continues: bool
    has_internal: bool
    link: Columns
    rows: np.ndarray | None


class Allgatherv(NamedTuple):
    """The function of MPI, and the handles that it takes."""

    address: int
    type: int
    communicator: int


class Processes(NamedTuple):
    """Subdomains of the other processes, None for own, the first one of each rank, and what is
    exchanged: numbers of all ranks, how many each has, where they begin, and how they gather."""

    rank: int
    remotes: tuple[Remote | None, ...]
    first: np.ndarray
    all: np.ndarray
    counts: np.ndarray
    starts: np.ndarray
    gather: Callable[[], None] | Allgatherv


class Monitored(NamedTuple):
    """Commands and forces of a subdomain at these positions, (2, count)."""

    positions: np.ndarray
    last: np.ndarray


class CorePace(NamedTuple):
    """How fine steps are paced: ns between two, whether a late one ends the run, the file to which
    signals are written and what is then called, and the arrays of `Times` and `Watched`."""

    period: float
    stops: bool
    signals: int
    woken: Callable[[], object]
    state: np.ndarray
    times: np.ndarray
    monitored: tuple[Monitored | None, ...]
    values: np.ndarray


class Side(NamedTuple):
    """A subdomain of contacts, and their rows on it."""

    member: int
    N: Columns


class Contact(NamedTuple):
    """The first row of each contact, and its numbers."""

    first: np.ndarray
    gap: np.ndarray
    restitution: np.ndarray
    friction: np.ndarray
    friction_static: np.ndarray
    sides: tuple[Side, ...]
    dgemm: Any
    dtrsm: Any


# ---- newton -------------------------------------------------------------------------------------
# How the iteration of internal forces is controlled.

__all__ = ["Newton"]


@dataclass(frozen=True)
class Newton(Frozen):
    """Control of the Newton-Raphson iteration of ``internal=``, for ``newton=`` of a `Coupler`.

    Parameters
    ----------
    tol : float, default 1e-8
        Relative accuracy of forces and motion, in (0, 1). An iterate is accepted when in every row
        the residual is at most ``tol`` of the forces that act there, or did when the step began,
        and the error that is left, estimated from the rate of convergence, at most ``tol`` of the
        largest motion in a step so far. Where all residuals are rounding, as at rest or in a
        subdomain that constraints hold, they decide alone.
    iterations : int, default 40
        Largest number of iterations in a substep; more are a `ConvergenceError`. In 1..1000.
    tangent : {"full", "reuse"}, default "full"
        "full": a new tangent and its factor in each iteration. "reuse": factors are kept, over
        substeps too, as long as an iteration reduces the error to a fifth; for subdomains whose
        factorization takes more time than several evaluations of the force.

    Raises
    ------
    TypeError, ValueError
        For a value of the wrong kind or out of its range.

    Examples
    --------
    >>> Newton()
    Newton(tol=1e-08, iterations=40, tangent='full')
    >>> Newton(tol=1e-10, tangent="reuse").tol
    1e-10
    """

    _is_frozen: ClassVar[bool] = True  # the fields by the dataclass, others by Frozen

    tol: float = 1e-8
    iterations: int = 40
    tangent: TangentPolicy = "full"

    def __post_init__(self) -> None:
        tol = real_number(self.tol, "tol")
        if not 0.0 < tol < 1.0:
            raise ValueError(f"tol must be above 0 and below 1, got {self.tol!r}")
        object.__setattr__(self, "tol", tol)
        iterations = whole_number(self.iterations, "iterations", low=1, high=MOST_ITERATIONS)
        object.__setattr__(self, "iterations", iterations)
        check_word(self.tangent, "tangent", get_args(TangentPolicy))


DEFAULT = Newton()
