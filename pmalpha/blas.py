"""BLAS with one thread, so that results do not depend on its number of threads."""

from __future__ import annotations

import ctypes
import os
from contextlib import AbstractContextManager
from typing import Any

from . import _core

# Functions that set and return the number of threads, by what threadpoolctl calls the library.
SYMBOLS = {
    "openblas": [
        (f"{prefix}openblas_set_num_threads{suffix}", f"{prefix}openblas_get_num_threads{suffix}")
        for prefix in ("", "scipy_")
        for suffix in ("", "64_", "_64")
    ],
    "mkl": [("MKL_Set_Num_Threads", "MKL_Get_Max_Threads")],
    "blis": [("bli_thread_set_num_threads", "bli_thread_get_num_threads")],
    "flexiblas": [("flexiblas_set_num_threads", "flexiblas_get_num_threads")],
}
# ... of an OpenBLAS that is compiled with OpenMP, whose number belongs to each thread
OPENMP = [("omp_set_num_threads", "omp_get_max_threads")]

_found: dict[str, _core.OneThread] = {}


def gemm_and_trsm() -> tuple[Any, Any]:
    """The functions of SciPy's BLAS that the core calls."""
    from scipy.linalg import cython_blas

    return cython_blas.__pyx_capi__["dgemm"], cython_blas.__pyx_capi__["dtrsm"]


def one_thread() -> AbstractContextManager[None]:
    """A context in which BLAS uses one thread.

    The number of threads of BLAS belongs to the process: if several threads are in this context,
    the first sets it and the last restores it, also where Ctrl-C ends it. Within the same context
    it does nothing. In a process forked off only the thread that has forked is still in it.
    """
    return _found.get("one") or _search()


def _search() -> _core.OneThread:
    """The context of the libraries that NumPy and SciPy have loaded, which takes milliseconds.

    Without a lock, which a thread could hold while another one forks: of several the first counts.
    """
    import scipy.linalg  # noqa: F401  so that its library is loaded before the search
    from threadpoolctl import ThreadpoolController

    libraries = ThreadpoolController().select(user_api="blas").lib_controllers
    context = _core.OneThread(tuple(pair for x in libraries for pair in _addresses(x)))
    one = _found.setdefault("one", context)
    if one is context and hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=one.after_fork)
    return one


def _addresses(library: Any) -> list[tuple[int, int]]:
    """The functions of a library that is found; none of one that threadpoolctl alone knows."""
    names = SYMBOLS.get(library.internal_api, [])
    if getattr(library, "threading_layer", "") == "openmp" and library.internal_api == "openblas":
        names = [*OPENMP, *names]
    for pair in names:
        if all(hasattr(library.dynlib, name) for name in pair):
            functions = [getattr(library.dynlib, name) for name in pair]
            set_threads, get_threads = (ctypes.cast(f, ctypes.c_void_p).value for f in functions)
            return [(set_threads or 0, get_threads or 0)]
    return []
