"""How far a run is, told while it runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import Any

# Seconds between two reports; the binding looks at its clock as often.
EVERY = 0.05


class Report:
    """Tells ``tell(done, total)`` how many of the macro steps begin..end are done.

    The core calls it with the number of the step now and then; between two calls of the core
    `if_due` does.
    """

    def __init__(self, tell: Callable[[int, int], Any], begin: int, end: int):
        self.tell, self.begin, self.end = tell, begin, end
        self.last = perf_counter()

    def __call__(self, step: int) -> None:
        self.last = perf_counter()
        self.tell(step - self.begin, self.end - self.begin)

    def if_due(self, step: int) -> None:
        if perf_counter() - self.last >= EVERY:
            self(step)


@contextmanager
def reporting(progress: Any, begin: int, end: int) -> Iterator[Report | None]:
    """What reports on a stretch: None, or for True with a tqdm bar, or to a callable."""
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
