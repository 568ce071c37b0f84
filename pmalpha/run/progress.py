"""Progress reports, and signals that are held back while what a run has done is put together."""

from __future__ import annotations

# getsignal and signal of the module signal, but for conversions to enumerations: 20 us a run
import _signal  # type: ignore[import-not-found]
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from time import perf_counter
from types import FrameType
from typing import Any

from .._core import Guard
from ..files import library

# Seconds between two reports; the binding reads its clock at the same interval.
INTERVAL = 0.05
# Signals whose handlers are written in Python in practice; to ask for all 64 takes 0.1 ms.
_NAMES = ("SIGINT", "SIGTERM", "SIGALRM", "SIGHUP", "SIGQUIT", "SIGUSR1", "SIGUSR2", "SIGXCPU")
SIGNALS = tuple(int(getattr(signal, name)) for name in _NAMES if hasattr(signal, name))


class Report:
    """Calls ``progress(done, total)`` with the number of completed macro steps of begin..end.

    The core calls it during its steps with the number of the macro step; `if_due` calls it between
    two calls of the core.

    begin: the macro step at which nothing is done.
    failed: whether `progress` raised an exception.
    """

    def __init__(self, progress: Callable[[int, int], Any], begin: int, end: int):
        self.progress, self.begin, self.total = progress, begin, end - begin
        self.last, self.failed = perf_counter(), False
        self.done = -1  # what was reported last

    def __call__(self, step: int) -> None:
        self.last, self.done = perf_counter(), step - self.begin
        try:
            self.progress(self.done, self.total)
        except BaseException:
            self.failed = True
            raise

    def if_due(self, step: int) -> None:
        """A report if one is due; that of the end is left to the caller."""
        if step - self.begin < self.total and perf_counter() - self.last >= INTERVAL:
            self(step)

    def end(self) -> None:
        """That all is done, unless this was reported."""
        if self.done < self.total:
            self(self.begin + self.total)


def reporting(progress: Any, begin: int, end: int) -> AbstractContextManager[Report | None]:
    """The reports of a run: to a tqdm bar for True, to a callable, or None."""
    if progress is None or progress is False:
        return nullcontext()
    if progress is True:
        return _on_bar(begin, end)
    if callable(progress):
        return nullcontext(Report(progress, begin, end))
    raise TypeError(f"progress must be True or a callable(done, total), got {progress!r}")


@contextmanager
def _on_bar(begin: int, end: int) -> Iterator[Report]:
    tqdm = library("tqdm.auto", "progress=True", "'pmalpha[progress]'").tqdm
    with tqdm(total=end - begin, unit="step") as bar:
        yield Report(lambda done, total: bar.update(done - bar.n), begin, end)


class DeferredSignals:
    """A context in which the handlers of `SIGNALS` wait, if they are Python functions.

    A handler that raises, as that of Ctrl-C does, can end any Python function at any point. In this
    context it is called only inside `during` and at the end; the signals that arrived before are
    then those that it is called with. It is without effect in threads other than the main one,
    which run no handlers.

    It stands inside of `guard`. Python can raise KeyboardInterrupt on entering any function, here
    `__exit__` too; handlers that were not restored therefore pass signals on as soon as the guard,
    which is C, has been left.
    """

    def __init__(self, guard: Guard) -> None:
        self._guard, self._turn = guard, guard.turns
        self.through = False  # handlers are called at once
        self._handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
        self._arrived: list[tuple[int, FrameType | None]] = []

    def __enter__(self) -> DeferredSignals:
        if threading.current_thread() is not threading.main_thread():
            return self
        try:
            for number in SIGNALS:
                handler = _signal.getsignal(number)
                if callable(handler):  # not one of SIG_DFL and SIG_IGN, nor of another language
                    self._handlers[number] = handler
                    _signal.signal(number, self._hold)
        except BaseException:
            self._restore()
            raise
        return self

    def __exit__(self, *exception: object) -> None:
        self.through = True  # from here on nothing waits, also where the next line is interrupted
        self._restore()
        self._call_handlers()

    def during(self, call: Callable[..., Any], *arguments: Any) -> Any:
        """The result of ``call(*arguments)``, in which handlers are called as ever."""
        self.through = True
        try:
            self._call_handlers()
            return call(*arguments)
        finally:
            self.through = False

    def _hold(self, number: int, frame: FrameType | None) -> None:
        if self.through or self._guard.turns != self._turn:
            self._handlers[number](number, frame)
        else:
            self._arrived.append((number, frame))

    def _call_handlers(self) -> None:
        while self._arrived:
            number, frame = self._arrived.pop(0)
            self._handlers[number](number, frame)

    def _restore(self) -> None:
        """Restore the handlers, unless a function called meanwhile has set others."""
        raised: BaseException | None = None
        for number, handler in self._handlers.items():
            try:
                if _signal.getsignal(number) == self._hold:
                    _signal.signal(number, handler)
            except BaseException as error:  # of a handler just restored
                raised = error
        if raised is not None:
            raise raised
