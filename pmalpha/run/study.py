"""Many cases of one problem, by the executor that a user has."""

from __future__ import annotations

import pickle
import threading
import traceback
import uuid
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from os import PathLike
from typing import Any

import numpy as np

from .._checks import listed, whole_number
from ..errors import CasesError, PmalphaError, for_line, users_line
from ..results.history import History
from ..results.study_file import StudyFile
from .coupler import Coupler
from .progress import reporting

__all__ = ["CaseResult", "Study"]


def __dir__() -> list[str]:
    return sorted(__all__)


_kept = threading.local()  # the coupler of the last study in each thread of this process


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
            New HDF5 file to which every result is written as it arrives; one of a study that ended
            before its first result is replaced. `result` must return a dict of numbers and arrays,
            the same names and shapes for every case: the file has one dataset of (cases, ...) for
            each, NaN where a case failed or has not run, and the text of the error in ``error``,
            empty for success and "not run" before. Other programs can read it meanwhile, and after
            a kill.
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
            When the file exists or cannot be written, at the latest with the result that it does
            not take; those before are in it.

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
        items, n = list[CaseResult](), self.together
        file = nullcontext() if save_to is None else StudyFile(save_to, len(cases))
        with reporting(progress, 0, len(cases)) as report, file as saved:
            work = partial(for_line, users_line(), self._several)
            results = map(work, [cases[k : k + n] for k in range(0, len(cases), n)])
            if not isinstance(results, Iterable):
                raise TypeError(f"map must return an iterable of results, got {results!r}")
            for several in results:
                for case in several:
                    items.append(case if saved is None else _saved(saved, len(items), case))
                if report is not None:
                    report(len(items))
        return items

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


def _saved(file: StudyFile, k: int, case: CaseResult) -> CaseResult:
    """Case k without its value, which is in the file; a failed one if no file can have it."""
    if case.error is None:
        try:
            file.write(k, case.value)
        except (TypeError, ValueError) as error:
            case = _failed(error)
    text = "" if case.error is None else f"{type(case.error).__name__}: {case.error}"
    file.write_text(k, text)
    return CaseResult(None, case.error, case.traceback)
