"""Many cases of one problem, by the engine that a user has."""

from __future__ import annotations

import pickle
import threading
import traceback
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from os import PathLike
from time import perf_counter
from typing import Any

from .._checks import whole_number
from ..errors import CasesError, PmalphaError
from .coupler import Coupler
from .history import History
from .progress import reporting
from .study_file import StudyFile

__all__ = ["CaseResult", "Study"]

# What `Coupler.reset` takes, the keys of a case.
RESET = ("u0", "v0", "force")
# The coupler of the last study in each thread of this process.
_kept = threading.local()


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
    seconds : float
        Duration of the run, or of all cases that were run together; without the time in which the
        coupler was made.

    Examples
    --------
    >>> study = Study(dict, 1.0)
    >>> study({})
    <CaseResult failed: TypeError: make_coupler must return a Coupler, got {}>
    """

    def __init__(
        self,
        value: Any = None,
        error: Exception | None = None,
        traceback: str = "",
        seconds: float = 0.0,
    ):
        self.value, self.error, self.traceback = value, error, traceback
        self.seconds = seconds

    def __repr__(self) -> str:
        if self.error is not None:
            return f"<CaseResult failed: {type(self.error).__name__}: {self.error}>"
        return f"<CaseResult: {type(self.value).__name__} in {self.seconds:.3g} s>"


class Study:
    """Runs of one coupled problem with different initial values and loads, on any executor.

    A Study is a function of one case that can be pickled: what `map` of an executor takes, in
    threads, processes or on other machines. In each process and thread it makes one Coupler, with
    the first case, and resets that for every other: all factors are kept.

    Parameters
    ----------
    make_coupler : callable
        Makes the `Coupler`, without arguments; for processes a function of a module, or a
        ``functools.partial`` of one. Where every core of the processor has a process or thread of
        the executor, make it with ``threads=1``.
    t_end : float, optional
        As for `Coupler.run`, or `steps` as one of the options.
    result : callable, optional
        ``result(history)`` is evaluated where the case has run, and what it returns is sent back:
        peaks, say, in place of all time levels. Default: the whole History.
    together : int, default 1
        Number of cases that one worker gets at a time and runs by `Coupler.run_each`. The results
        are bitwise those of `reset` and `run`, with any number.
    **as_run
        Further options of `Coupler.run`, such as `record` and `every`; not `record_to`.

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
    >>> make = partial(models.split_oscillator(10.0).coupler, 0.05)
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

    def __call__(self, case: Mapping[str, Any]) -> CaseResult:
        """One case: a dict of what `Coupler.reset` takes, `u0`, `v0`, `force`.

        Parameters
        ----------
        case : dict

        Returns
        -------
        CaseResult
        """
        begin = perf_counter()
        try:
            coupler = self._coupler()
            begin = perf_counter()
            coupler.reset(**_checked(case))
            return self._result(coupler.run(**self.as_run), begin)
        except Exception as error:
            return _failed(error, begin)

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
            Default: the built-in one, which does one after another.
        save_to : str or path, optional
            HDF5 file to which every result is written as it arrives. `result` must return a dict of
            numbers and arrays, the same names and shapes for every case: the file has one dataset
            of (cases, ...) for each, NaN where a case failed or has not run, and the text of the
            error in ``error``, empty for success and "not run" before. Other programs can read it
            meanwhile, and after a kill. An existing file is refused.
        progress : True or callable, optional
            True: a tqdm bar. A callable is called as ``progress(done, total)``.

        Returns
        -------
        list of CaseResult
            With `save_to` without the values, which are in the file.

        Raises
        ------
        TypeError, ValueError
            For arguments of the wrong kind, and for what a `map` to processes cannot pickle.
        ImportError
            For `save_to` without h5py, for ``progress=True`` without tqdm.
        OSError
            When the file exists or cannot be written.

        Examples
        --------
        >>> from functools import partial
        >>> study = Study(partial(models.split_oscillator(10.0).coupler, 0.05), steps=10)
        >>> [case.value["A"].u.shape for case in study.run([{}, {"v0": {"A": [1.0], "B": [1.0]}}])]
        [(11, 1), (11, 1)]
        """
        if not callable(map):
            raise TypeError(f"map must be a callable(function, cases), got {map!r}")
        cases = _listed(cases)
        found: list[CaseResult] = []
        with ExitStack() as stack:
            report = stack.enter_context(reporting(progress, 0, len(cases)))
            file = None
            if save_to is not None:
                file = stack.enter_context(StudyFile(save_to, len(cases)))
            for chunk in self._results(cases, map):
                for case in chunk:
                    found.append(case if file is None else _saved(file, len(found), case))
                if report is not None:
                    report(len(found))
        return found

    def _results(self, cases: Sequence[Any], map: Callable[..., Any]) -> Iterator[list[CaseResult]]:
        """Those of `together` cases at a time."""
        chunks = [cases[k : k + self.together] for k in range(0, len(cases), self.together)]
        try:
            results = map(self._several, chunks)
            if isinstance(results, Iterable):
                yield from results
                return
        except (AttributeError, TypeError, pickle.PicklingError) as error:
            self._require_pickled(cases, error)
            raise
        raise TypeError(f"map must return an iterable of results, got {results!r}")

    def _require_pickled(self, cases: Sequence[Any], error: Exception) -> None:
        """TypeError that names what cannot be pickled, where that is why a map has failed."""
        sent = {"make_coupler": self.make_coupler, "result": self.result, "cases": cases}
        for name, value in (sent | self.as_run).items():
            try:
                pickle.dumps(value)
            except Exception:
                raise TypeError(
                    f"{name} must be what can be pickled for this map, as functions of a module "
                    f"can, got {value!r}: {error}"
                ) from error
        if "pickle" in str(error):
            raise TypeError(
                f"result must return what can be pickled for this map: {error}"
            ) from error

    def _several(self, cases: Sequence[Mapping[str, Any]]) -> list[CaseResult]:
        """Cases that one worker was given together."""
        if len(cases) == 1:
            return [self(cases[0])]
        begin, failures = perf_counter(), {}
        try:
            histories = self._coupler().run_each([_checked(c) for c in cases], **self.as_run)
        except CasesError as error:
            histories, failures = error.histories, error.failures
        except Exception:  # before the first case began: which of them was it?
            return [self(case) for case in cases]
        return [
            _failed(failures[k], begin) if k in failures else self._result(history, begin)
            for k, history in enumerate(histories)
        ]

    def _result(self, history: History, begin: float) -> CaseResult:
        try:
            value = history if self.result is None else self.result(history)
        except Exception as error:
            return _failed(error, begin)
        return CaseResult(value, seconds=perf_counter() - begin)

    def _coupler(self) -> Coupler:
        """The coupler of this thread, made when this study is new in it."""
        if getattr(_kept, "token", None) != self._token:
            _kept.token, _kept.coupler = None, None  # released before the next one is made
            coupler = self.make_coupler()
            if not isinstance(coupler, Coupler):
                raise TypeError(f"make_coupler must return a Coupler, got {coupler!r}")
            _kept.token, _kept.coupler = self._token, coupler
        return _kept.coupler


def _listed(cases: Any) -> list[Any]:
    if not isinstance(cases, Iterable) or hasattr(cases, "ndim"):  # of arrays
        raise TypeError(f"cases must be dicts of what reset takes, got {cases!r}")
    return list(cases)


def _checked(case: Any) -> dict[str, Any]:
    if not isinstance(case, Mapping):
        raise TypeError(f"a case must be a dict of what reset takes, got {case!r}")
    unknown = [key for key in case if key not in RESET]
    if unknown:
        raise ValueError(f"a case must have the keys u0, v0 and force, got {unknown[0]!r}")
    return dict(case)


def _failed(error: Exception, begin: float) -> CaseResult:
    text = "".join(traceback.format_exception(error))
    return CaseResult(None, _sendable(error), text, perf_counter() - begin)


def _sendable(error: Exception) -> Exception:
    """The exception, or one with its text where it cannot be pickled and read again."""
    try:
        if type(pickle.loads(pickle.dumps(error))) is type(error):
            return error
    except Exception:
        pass
    return PmalphaError(f"{type(error).__name__}: {error}")


def _saved(file: StudyFile, k: int, case: CaseResult) -> CaseResult:
    """The case without its value, which is in the file; failed where it does not fit."""
    if case.error is None:
        try:
            file.write(k, case.value)
        except (TypeError, ValueError) as error:
            case = CaseResult(None, error, seconds=case.seconds)
    if case.error is not None:
        file.fail(k, case.error)
    return CaseResult(None, case.error, case.traceback, case.seconds)
