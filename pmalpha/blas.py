"""BLAS with one thread, so that digits do not depend on how many it would take."""

from __future__ import annotations

from functools import cache

from threadpoolctl import ThreadpoolController


@cache
def _libraries() -> ThreadpoolController:
    """The BLAS libraries that NumPy and SciPy have loaded; looking for them takes milliseconds."""
    import scipy.linalg  # noqa: F401  before the look, so that its library is there

    return ThreadpoolController().select(user_api="blas")


def one_thread():
    """A context in which BLAS uses one thread."""
    return _libraries().limit(limits=1)
