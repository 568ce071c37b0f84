"""BLAS with one thread, so that results do not depend on its number of threads."""

from __future__ import annotations

from functools import cache

from threadpoolctl import ThreadpoolController


@cache
def _libraries() -> ThreadpoolController:
    """The BLAS libraries that NumPy and SciPy have loaded; the search takes milliseconds."""
    import scipy.linalg  # noqa: F401  so that its library is loaded before the search

    return ThreadpoolController().select(user_api="blas")


def one_thread():
    """A context in which BLAS uses one thread."""
    return _libraries().limit(limits=1)
