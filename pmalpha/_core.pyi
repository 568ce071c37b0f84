"""The C core. Private: arrays must be C-contiguous and of the exact type, in elimination order."""

from collections.abc import Callable
from typing import Any, Literal, final

import numpy as np
from scipy import LowLevelCallable

from .problem import forms

SPRING_LAWS: dict[str, int]  # number of each law of springs
MOST_SWEEPS: int  # over contacts with friction
LANES: int  # vectors side by side: unit responses of one pass, load cases

# With named tuples for dicts, see pmalpha.problem.forms; None is zero
_Matrix = np.ndarray | forms.Band | forms.Compressed | forms.Strips | None
_Schedule = Literal["fine", "iterated", "macro", "shooting", "mean", "mean shooting", "contact"]
_Load = (
    np.ndarray  # constant
    | tuple[np.ndarray, np.ndarray | None, float, bool]  # samples, shape, dt, hold
    | tuple[np.ndarray, int]  # a row for each substep, number of the first
    | tuple[LowLevelCallable, np.ndarray]  # f, the user's dof at each position
    | None
)
_AnyLoad = _Load | list[_Load]  # whose sum acts
# position, u, v, w, and optionally (spring, deformation, force), (output, of_u, of_v, of_w) with
# (start, position, weight) of each
_Selection = tuple[Any, ...] | None
# begin, every, selections, multipliers, velocity and displacement jumps, optionally energy, and
# impulses and gaps of contacts
_Record = tuple[Any, ...]
# rank, remote subdomains (None for own), first of each rank, all, counts, starts, gather
_Processes = tuple[
    int,
    tuple[tuple[Any, ...] | None, ...],
    np.ndarray,
    np.ndarray,
    np.ndarray,
    np.ndarray,
    Callable[[], Any] | tuple[int, int, int],
]

@final
class Subdomain:
    entries: int
    gain: tuple[float, float, float]
    added_mass: float
    def __new__(cls, parts: dict[str, Any]) -> Subdomain: ...
    def set_load(self, load: _AnyLoad | tuple[_AnyLoad, ...], /) -> None: ...
    def start(self, u: np.ndarray, v: np.ndarray, w: np.ndarray, lam: np.ndarray, /) -> None: ...
    def rebase(self, twice: bool, lam: np.ndarray, /) -> None: ...
    def state(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]: ...
    def force(self, t: float, /) -> np.ndarray | int: ...
    def restoring(
        self, t: float, u: np.ndarray, v: np.ndarray, /
    ) -> np.ndarray | int | tuple[int, str, int, float, float, float, bool]: ...
    def springs(self) -> np.ndarray: ...
    def levels(self) -> tuple[np.ndarray, ...]: ...
    def set_levels(self, levels: tuple[np.ndarray, ...], /) -> None: ...
    def in_lanes(self) -> Subdomain: ...
    def iteration(self) -> tuple[float, np.ndarray | None, bool] | None: ...
    def set_iteration(self, scale: float, entries: np.ndarray | None, twice: bool, /) -> None: ...
    def evaluate_present(self, t: float, /) -> int | None: ...
    def limit(
        self,
        displacement: np.ndarray | None,
        velocity: np.ndarray | None,
        acceleration: np.ndarray | None,
        force: np.ndarray | None,
        energy: float,
        /,
    ) -> None: ...
    def watch(self, M: _Matrix, K_r: _Matrix, /) -> None: ...
    def begin_energy(
        self, M: _Matrix, skew: _Matrix, load: np.ndarray, lam: np.ndarray, weight: float = ..., /
    ) -> None: ...
    def works(self) -> np.ndarray | None: ...
    def resume_works(self, works: np.ndarray, /) -> None: ...
    def follow_energy(self, other: Subdomain, /) -> None: ...
    def end_energy(self) -> None: ...
    def compliance(self, twice: bool, rows: np.ndarray, /) -> np.ndarray: ...
    def unit_responses(
        self,
        rows: np.ndarray,
        end: np.ndarray,
        mean: np.ndarray,
        states: np.ndarray | None,
        twice: bool = False,
        threads: int = 1,
        /,
    ) -> bool: ...
    def accelerate(self, lam: np.ndarray, /) -> np.ndarray: ...
    def store_responses(self, rows: np.ndarray, states: np.ndarray, /) -> None: ...

@final
class Coupler:
    step_count: int
    multipliers: np.ndarray
    prescribed: np.ndarray
    instants: int
    paced: bool
    threads: int
    workers: tuple[int | None, ...]
    def __new__(
        cls,
        subdomains: tuple[Subdomain, ...],
        parts: dict[str, Any],
        processes: _Processes | None = None,
    ) -> Coupler: ...
    def start(self, step_count: int, lam: np.ndarray, g: np.ndarray, /) -> None: ...
    def set_origin(self, number: int, t: float, /) -> None: ...
    def set_motion(self, i: int, load: _Load, /) -> None: ...
    def advance(
        self, steps: int, record: _Record | None, report: Callable[[int], Any] | None = None, /
    ) -> (
        int
        | tuple[int]
        | tuple[int, int, str]
        | tuple[int, float | None, int | None, int, int, bool]
        | tuple[int, float]
        | tuple[int, str, int, float, float, float, bool]
        | tuple[()]
        | tuple[str, int]
        | None
    ): ...
    def set_ring(self, steps: np.ndarray | None, /) -> None: ...
    def ring(self, read: int, /) -> tuple[int, int]: ...
    def set_pace(
        self,
        # period, stops, signals, state, times and shifts; positions and last values by subdomain,
        # all values; what is called when a signal arrives
        pace: tuple[
            float,
            bool,
            int,
            np.ndarray,
            np.ndarray,
            tuple[tuple[np.ndarray, np.ndarray] | None, ...],
            np.ndarray,
            Callable[[], object],
        ]
        | None,
        /,
    ) -> None: ...
    def record_present(self, record: _Record, /) -> tuple[int] | None: ...
    def in_lanes(self, subdomains: tuple[Subdomain, ...], /) -> Coupler: ...
    def numbers(self, name: str, /) -> np.ndarray: ...
    def set_numbers(self, name: str, numbers: np.ndarray, /) -> None: ...
    def contact_compliance(self, start: bool, /) -> np.ndarray: ...
    def contact_turns(self) -> int: ...
    def set_obstacle(self, load: _Load, /) -> None: ...

@final
class Guard:
    @property
    def turns(self) -> int: ...
    def __enter__(self) -> None: ...
    def __exit__(self, *exception: object) -> None: ...

@final
class OneThread:
    def __new__(cls, libraries: tuple[tuple[int, int], ...], /) -> OneThread: ...
    def __enter__(self) -> None: ...
    def __exit__(self, *exception: object) -> None: ...
    def after_fork(self) -> None: ...

def graph_of_groups(
    ptr: np.ndarray, index: np.ndarray, group: np.ndarray, groups: int, /
) -> tuple[np.ndarray, np.ndarray]: ...
def count_factor(ptr: np.ndarray, index: np.ndarray, /) -> np.ndarray: ...
def postorder(ptr: np.ndarray, index: np.ndarray, nb: int, /) -> np.ndarray: ...
def supernodes(ptr: np.ndarray, index: np.ndarray, nb: int, /) -> tuple[np.ndarray, ...]: ...
def factor_panels(
    matrix: forms.Compressed,
    structure: tuple[np.ndarray, ...],
    values: np.ndarray,
    inverse: np.ndarray,
    lost: float,
    growth: float,
    dgemm: Any,
    dtrsm: Any,
    threads: int,
    /,
) -> int | None: ...
def strips(matrix: forms.Compressed, /) -> tuple[np.ndarray, ...]: ...
def solve(factor: forms.Factor, b: np.ndarray, /) -> np.ndarray: ...
def permuted(
    matrix: forms.Compressed, order: np.ndarray, /
) -> tuple[np.ndarray, np.ndarray, np.ndarray]: ...
def follow_specimen(
    specimen: forms.Specimen, t: np.ndarray, u: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]: ...
def follow_springs(
    springs: tuple[forms.Springs, ...], u: np.ndarray, levels: np.ndarray | None, /
) -> tuple[np.ndarray, np.ndarray, np.ndarray]: ...

# u, v, a, levels x dofs; converted where they are not as above
_Motion = tuple[np.ndarray, np.ndarray, np.ndarray]

def step_errors(motion: _Motion, begin: np.ndarray, end: np.ndarray, h: float, /) -> np.ndarray: ...
def split_lanes(x: np.ndarray, vectors: tuple[np.ndarray, ...], /) -> None: ...
