"""What a coupler with `comm` does at the same time in all its processes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..files import check_replaceable, checked_path
from ..setup.ranks import Elsewhere, Ranks, file_of, joined
from .appending import check_new
from .history_file import write_master
from .recording import Recording


class Together:
    """The calls of a `Coupler` that end in all processes, or with an exception in all of them."""

    _ranks: Ranks | None
    _guard: Any
    _core: Any

    def _together(self) -> Any:
        """One call at a time, as `_entered`, that all processes make."""
        return self._guard if self._ranks is None else self._ranks.entered(self._guard)

    def _check_call(self, *call: Any) -> None:
        """ValueError unless all processes make the same call."""
        if self._ranks is not None:
            self._ranks.require_equal("the call", call)

    def _any(self, happened: bool) -> bool:
        """Whether this happened in some process."""
        return any(joined(self._ranks, [happened]))

    def _require_alone(self, what: str) -> None:
        if self._ranks is not None:
            raise ValueError(f"{what} needs a Coupler without comm")

    def _own_record(self, path: Any, append: bool, overwrite: bool) -> Any:
        """`record_to` of this rank; rank 0 looks whether the master file can be written."""
        if self._ranks is None or path is None:
            return path
        if self._ranks.rank == 0:
            check_replaceable(path, "record_to")
            if not (append or overwrite):
                check_new(checked_path(path))
        return file_of(path, self._ranks.rank)

    def _write_master(self, own: Path) -> None:
        """The file that reads as one History, when those of the ranks are there; `own` is that of
        this one."""
        if self._ranks is None or self._ranks.rank > 0:
            return
        path = own.with_suffix("")  # without the rank
        files = [Path(file_of(path, rank)).name for rank in range(self._ranks.size)]
        write_master(path, files, self._ranks.first.tolist())

    def _record_present(self, recording: Recording) -> None:
        record = recording.core_record()
        if self._ranks is not None:
            self._ranks.share(None)
        elsewhere = self._core.record_present(record)
        if elsewhere is not None:
            raise Elsewhere(*elsewhere)
