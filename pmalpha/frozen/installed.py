"""Where the C library of frozen models is."""

from __future__ import annotations

from pathlib import Path

__all__ = ["c_library"]


def __dir__() -> list[str]:
    return sorted(__all__)


def c_library() -> Path:
    """The folder with the C library that steps frozen models: header, archive, shared library.

    Returns
    -------
    pathlib.Path
        With ``pmalpha.h``, ``libpmalpha.a``, the shared library of this system and the licence, of
        the same objects as this package.

    Raises
    ------
    FileNotFoundError
        For an installation without them; ``make install-c`` makes them of the sources.

    See Also
    --------
    Coupler.freeze : Writes what it reads.

    Examples
    --------
    >>> (c_library() / "pmalpha.h").exists()
    True
    """
    folder = Path(__file__).parent.parent / "c"
    if not (folder / "pmalpha.h").exists():
        raise FileNotFoundError(
            "this installation has no C library: `make install-c PREFIX=...` in a folder of the "
            "sources makes it"
        )
    return folder
