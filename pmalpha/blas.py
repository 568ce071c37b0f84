"""BLAS with one thread, so that results do not depend on its number of threads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock, local
from typing import Any


@cache
def _libraries() -> Any:
    """The BLAS libraries that NumPy and SciPy have loaded; the search takes milliseconds."""
    import scipy.linalg  # noqa: F401  so that its library is loaded before the search
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")


def gemm_and_trsm() -> tuple[Any, Any]:
    """The functions of SciPy's BLAS that the core calls."""
    from scipy.linalg import cython_blas

    return cython_blas.__pyx_capi__["dgemm"], cython_blas.__pyx_capi__["dtrsm"]


class _Users:
    """The threads of the process that are in `one_thread` at present."""

    lock = Lock()
    count = 0
    limiter: Any = None  # of the first of them, with the numbers of threads to restore


class _Own(local):
    """Whether this thread is in `one_thread`."""

    inside = False


_own = _Own()


@contextmanager
def one_thread() -> Iterator[None]:
    """A context in which BLAS uses one thread.

    The number of threads of BLAS belongs to the process: if several threads are in this context,
    the first sets it and the last restores it. Within the same context it does nothing.
    """
    if _own.inside:
        yield
        return
    with _Users.lock:
        limiter = _limited()  # in each thread: where OpenMP is below, the number belongs to it
        _Users.count += 1
        if _Users.count == 1:
            _Users.limiter = limiter
    _own.inside = True
    try:
        yield
    finally:
        _own.inside = False
        with _Users.lock:
            _Users.count -= 1
            if _Users.count == 0:
                _allow()
                _Users.limiter.restore_original_limits()
                _allow()


def _limited() -> Any:
    """BLAS with one thread; the result restores the number before."""
    _allow()
    limiter = _libraries().limit(limits=1)
    _allow()
    return limiter


def _allow() -> None:
    """Let any thread set the number of threads.

    Some versions of threadpoolctl ignore, without an error, all threads but the first that set it.
    """
    for library in _libraries().lib_controllers:
        if hasattr(library, "clear_controlling_thread"):
            library.clear_controlling_thread(force=True)
