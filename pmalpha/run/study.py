"""Many cases of one problem, by the executor that a user has."""

from __future__ import annotations

import pickle
import threading
import traceback
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from os import PathLike
from typing import Any

import numpy as np

from .._checks import listed, whole_number
from ..errors import CasesError, PmalphaError, for_line, users_line
from ..files import HDF5, checked_path, package_version
from ..results.history import History
from ..results.history_file import hdf5_library
from .coupler import Coupler
from .progress import reporting

__all__ = ["CaseResult", "Study"]


def __dir__() -> list[str]:
    return sorted(__all__)


_kept = threading.local()  # the coupler of the last study in each thread of this process
NOT_RUN, TEXT = b"not run", 400  # of the dataset "error"; bytes of a text that are kept


@dataclass(frozen=True)
class CaseResult:
    """The result of one case of a `Study`.

    Attributes
    ----------
    value : object
        What the function `result` of the study has returned, else the `History`; None if the case
        failed.
    error : Exception or None
        Why it failed. One that cannot be pickled is replaced by a `PmalphaError` with its text.
    traceback : str
        Where it failed, or empty.
    """

    value: Any = None
    error: Exception | None = None
    traceback: str = ""

    def __repr__(self) -> str:
        if self.error is not None:
            return f"<CaseResult failed, {type(self.error).__name__}: {self.error}>"
        if isinstance(self.value, np.ndarray):
            return f"<CaseResult {np.array2string(self.value, precision=4, threshold=8)}>"
        return f"<CaseResult {self.value!r}>"


class Study:
    """Runs of one coupled problem with different initial values and loads, on any executor.

    In each process and thread it makes one Coupler and keeps all factors. A Study can be pickled;
    ``study(case)`` is the `CaseResult` of one case.

    Parameters
    ----------
    make_coupler : callable
        Makes the `Coupler`, without arguments; for processes a function of a module. Where every
        core of the processor has a worker, make it with ``threads=1``.
    t_end : float, optional
        As for `Coupler.run`, or `steps` as one of the options.
    result : callable, optional
        ``result(history)`` is evaluated by the worker, and what it returns is sent back, such as
        peaks. Default: the whole History.
    together : int, default 1
        Number of cases that one worker gets at a time and runs by `Coupler.run_each`, bitwise the
        single ones.
    **as_run
        Further options of `Coupler.run`; not `record_to`.

    Raises
    ------
    TypeError, ValueError
        For arguments of the wrong kind.

    Notes
    -----
    An exception of a case is its result; the others go on. Ctrl-C ends all.

    Examples
    --------
    >>> from functools import partial
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> make = partial(models.split_oscillator(10.0).coupler, 0.05, coupling="pm")
    >>> study = Study(make, steps=100, result=lambda history: abs(history["A"].u).max())
    >>> cases = [{"v0": {"A": [v], "B": [v]}} for v in (1.0, 2.0, 4.0)]
    >>> with ThreadPoolExecutor(2) as pool:
    ...     found = study.run(cases, map=pool.map)
    >>> [bool(case.value > 0.0) for case in found]
    [True, True, True]
    """

    def __init__(
        self,
        make_coupler: Callable[[], Coupler],
        t_end: float | None = None,
        *,
        result: Callable[[History], Any] | None = None,
        together: int = 1,
        **as_run: Any,
    ):
        if not callable(make_coupler):
            raise TypeError(f"make_coupler must be a callable, got {make_coupler!r}")
        if result is not None and not callable(result):
            raise TypeError(f"result must be a callable, got {result!r}")
        if as_run.get("record_to") is not None:
            raise ValueError("record_to is of one run; give `result` and save the study to a file")
        self.make_coupler, self.result = make_coupler, result
        self.together = whole_number(together, "together", low=1)
        self.as_run = as_run if t_end is None else {"t_end": t_end, **as_run}
        self._token = uuid.uuid4().hex
        self._line = users_line()  # that of the call may be one of an executor

    def __call__(self, case: Mapping[str, Any]) -> CaseResult:
        """One case: a dict of what `Coupler.reset` takes, `u0`, `v0`, `force`.

        Its warnings point at the line that made the study.

        Parameters
        ----------
        case : dict

        Returns
        -------
        CaseResult
        """
        result: CaseResult = for_line(self._line, self._one, case)
        return result

    def _one(self, case: Mapping[str, Any]) -> CaseResult:
        try:
            if not isinstance(case, Mapping):
                raise TypeError(f"a case must be a dict of arguments of reset, got {case!r}")
            coupler = self._coupler()
            coupler.reset(**case)
            return self._result(coupler.run(**self.as_run))
        except Exception as error:
            return _failed(error)

    def run(
        self,
        cases: Iterable[Mapping[str, Any]],
        *,
        map: Callable[[Callable[..., Any], Sequence[Any]], Iterable[list[CaseResult]]] = map,
        save_to: str | PathLike[str] | None = None,
        progress: Any = None,
    ) -> list[CaseResult]:
        """All cases, in order.

        Parameters
        ----------
        cases : iterable of dict
            Each what `Coupler.reset` takes: `u0`, `v0`, `force`.
        map : callable, optional
            ``map(function, cases)`` returns the results in order, as `map` of an executor does.
            Default: the built-in one, one after another.
        save_to : str or path, optional
            New HDF5 file to which every result is written as it arrives. `result` must return a
            dict of numbers and arrays, the same names and shapes for every case: the file has one
            dataset of (cases, ...) for each, NaN where a case failed or has not run, and the text
            of the error in ``error``, empty for success and "not run" before. Other programs can
            read it meanwhile, and after a kill.
        progress : True or callable, optional
            True: a tqdm bar. A callable is called as ``progress(done, total)``.

        Returns
        -------
        list of CaseResult
            With `save_to` without the values, which are in the file.

        Raises
        ------
        TypeError, ValueError
            For arguments of the wrong kind. A `map` to processes has errors of its own for what it
            cannot pickle.
        ImportError
            For `save_to` without h5py, for ``progress=True`` without tqdm.
        OSError
            When the file exists or cannot be written.

        Examples
        --------
        >>> from functools import partial
        >>> make = partial(models.split_oscillator(10.0).coupler, 0.05, coupling="pm")
        >>> study = Study(make, steps=10)
        >>> [case.value["A"].u.shape for case in study.run([{}, {"v0": {"A": [1.0], "B": [1.0]}}])]
        [(11, 1), (11, 1)]
        """
        if not callable(map):
            raise TypeError(f"map must be a callable(function, cases), got {map!r}")
        cases = listed(cases, "cases", "dicts of what reset takes")
        found, n = list[CaseResult](), self.together
        file = nullcontext(lambda k, case: case) if save_to is None else _file(save_to, len(cases))
        with reporting(progress, 0, len(cases)) as report, file as kept:
            work = partial(for_line, users_line(), self._several)
            results = map(work, [cases[k : k + n] for k in range(0, len(cases), n)])
            if not isinstance(results, Iterable):
                raise TypeError(f"map must return an iterable of results, got {results!r}")
            for several in results:
                for case in several:
                    found.append(kept(len(found), case))
                if report is not None:
                    report(len(found))
        return found

    def _several(self, cases: Sequence[Mapping[str, Any]]) -> list[CaseResult]:
        """Cases that one worker was given together."""
        if len(cases) == 1:
            return [self._one(cases[0])]
        failures: Mapping[int, Exception] = {}
        try:
            histories = self._coupler().run_each(cases, **self.as_run)
        except CasesError as error:
            histories, failures = error.histories, error.failures
        except Exception:  # before the first case began: of which of them, each alone shows
            return [self._one(case) for case in cases]
        return [
            _failed(failures[k]) if k in failures else self._result(history)
            for k, history in enumerate(histories)
        ]

    def _result(self, history: History) -> CaseResult:
        try:
            return CaseResult(history if self.result is None else self.result(history))
        except Exception as error:
            return _failed(error)

    def _coupler(self) -> Coupler:
        """The coupler of this thread, made when this study is new in it."""
        if getattr(_kept, "token", None) != self._token:
            _kept.token = _kept.coupler = None  # released before the next one is made
            coupler = self.make_coupler()
            if not isinstance(coupler, Coupler):
                raise TypeError(f"make_coupler must return a Coupler, got {coupler!r}")
            _kept.token, _kept.coupler = self._token, coupler
        result: Coupler = _kept.coupler
        return result


def _failed(error: Exception) -> CaseResult:
    """A failed case, with its error, or one with its text where it cannot be pickled and read."""
    text, sent = "".join(traceback.format_exception(error)), error
    try:
        readable = type(pickle.loads(pickle.dumps(error))) is type(error)
    except Exception:
        readable = False
    if not readable:
        sent = PmalphaError(f"{type(error).__name__}: {error}")
    return CaseResult(None, sent, text)


@contextmanager
def _file(path: Any, count: int) -> Iterator[Callable[[int, CaseResult], CaseResult]]:
    """A function that writes the result of case k to the file, and returns it without its value.

    All rows of a dataset exist from the first result on, so that a later one changes no structure
    of the file: it can be read meanwhile, and after a kill.
    """
    h5py, whole = hdf5_library(), checked_path(path, "save_to", HDF5)
    try:
        file = h5py.File(whole, "x", locking=False)
    except OSError as error:
        message = f"save_to must lead to a new file that can be written: {error}"
        raise type(error)(error.errno, message, str(whole)) from error
    with file:
        file.attrs.update({"format": "pmalpha Study", "pmalpha_version": package_version()})
        errors = file.create_dataset("error", data=np.full(count, NOT_RUN, dtype=f"S{TEXT}"))
        shapes: dict[str, tuple[int, ...]] = {}

        def kept(k: int, case: CaseResult) -> CaseResult:
            try:
                if case.error is None:
                    arrays = _arrays(case.value, shapes)
                    for name, x in arrays.items():
                        if name not in file:
                            file[name] = np.full((count, *x.shape), np.nan)
                        file[name][k] = x
                    shapes.update({name: x.shape for name, x in arrays.items()})
            except (TypeError, ValueError) as error:
                case = _failed(error)
            text = "" if case.error is None else f"{type(case.error).__name__}: {case.error}"
            errors[k] = text.encode("ascii", "replace")[:TEXT]
            file.flush()
            return CaseResult(None, case.error, case.traceback)

        yield kept


def _arrays(value: Any, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, np.ndarray]:
    """The result of a case as arrays by name; these shapes if there was one before."""
    if not isinstance(value, Mapping) or not value:
        raise TypeError(f"result must return a dict of numbers and arrays, got {value!r}")
    if any(not isinstance(name, str) or name in ("error", "") or "/" in name for name in value):
        raise ValueError(f"result must have names that a file can have, got {list(value)}")
    found = {name: np.asarray(x) for name, x in value.items()}
    wrong = [name for name, x in found.items() if x.dtype.kind not in "biuf"]
    if wrong:
        raise TypeError(f"result[{wrong[0]!r}] must hold real numbers, got {value[wrong[0]]!r}")
    got = {name: x.shape for name, x in found.items()}
    if shapes and got != shapes:
        raise ValueError(f"result must have the shapes of the first, {dict(shapes)}, got {got}")
    return {name: x.astype(np.float64) for name, x in found.items()}
