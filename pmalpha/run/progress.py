"""Progress reports during a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import Any

# Seconds between two reports; the binding reads its clock at the same interval.
INTERVAL = 0.05


class Report:
    """Calls ``progress(done, total)`` with the number of completed macro steps of begin..end.

    The core calls it during its steps with the number of the macro step; `if_due` calls it between
    two calls of the core.

    Attributes
    ----------
    begin : int
        The macro step at which nothing is done.
    failed : bool
        Whether `progress` raised an exception.
    """

    def __init__(self, progress: Callable[[int, int], Any], begin: int, end: int):
        self.progress, self.begin, self.total = progress, begin, end - begin
        self.last, self.failed = perf_counter(), False

    def __call__(self, step: int) -> None:
        self.last = perf_counter()
        try:
            self.progress(step - self.begin, self.total)
        except BaseException:
            self.failed = True
            raise

    def if_due(self, step: int) -> None:
        if perf_counter() - self.last >= INTERVAL:
            self(step)


@contextmanager
def reporting(progress: Any, begin: int, end: int) -> Iterator[Report | None]:
    """The reports of a run: to a tqdm bar for True, to a callable, or None."""
    if progress is None or progress is False:
        yield None
    elif progress is True:
        with _bar(end - begin) as bar:
            yield Report(lambda done, total: bar.update(done - bar.n), begin, end)
    elif callable(progress):
        yield Report(progress, begin, end)
    else:
        raise TypeError(f"progress must be True or a callable(done, total), got {progress!r}")


def _bar(total: int) -> Any:
    try:
        from tqdm.auto import tqdm
    except ImportError as error:
        raise ImportError("progress=True needs tqdm: pip install 'pmalpha[progress]'") from error
    return tqdm(total=total, unit="step")
