"""What a run did not record, in the place of what it would have recorded."""

from __future__ import annotations

from typing import Any, NoReturn

__all__ = ["NotRecorded"]


class NotRecorded:
    """False in ``if``; its attributes are an AttributeError that names the call that records them.

    Attributes
    ----------
    what, call : str
    """

    what: str
    call: str

    def __init__(self, what: str, call: str):
        self.what, self.call = what, call

    def __bool__(self) -> bool:
        return False

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, NotRecorded) and self.what == other.what

    def __hash__(self) -> int:
        return hash(self.what)

    def __repr__(self) -> str:
        return f"<no {self.what}: {self.call} records it>"

    def __getattr__(self, name: str) -> NoReturn:
        if name in ("what", "call"):  # of an object that is being copied
            raise AttributeError(name)
        raise AttributeError(
            f"{self.what} was not recorded, so that it has no {name!r}: {self.call} records it"
        )


ENERGY = NotRecorded("energy", "Coupler.run(..., energy=True)")
PACING = NotRecorded("pacing", "Coupler.run_paced(...)")
