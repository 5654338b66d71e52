"""Linear algebra on one thread: a frame's systems are small, and threads that share a busy core wait for each other."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import lru_cache
from typing import Any

from threadpoolctl import ThreadpoolController


def one_thread() -> AbstractContextManager[Any]:
    """A context in which BLAS uses one thread: with another process on one of two cores, a fourth of the time."""
    return _libraries().limit(limits=1, user_api="blas")


@lru_cache(maxsize=1)
def _libraries() -> ThreadpoolController:
    # SciPy brings a BLAS of its own, which must be there to be found.
    import scipy.linalg  # noqa: F401

    return ThreadpoolController()
