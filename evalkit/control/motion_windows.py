"""Windows of a database: a few frames of control parameters in a row, the points among which a search looks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array

Rows = NDArray[np.int64]

GATHER = 4096
"""Windows that are copied at a time: of 300 numbers, 5 MB."""


def legal_starts(segments: ArrayLike, window: int) -> Rows:
    """Rows at which a window of so many frames begins that stays within its segment, ascending, shape (n,).

    Parameters
    ----------
    segments : array_like of int, shape (S, 2)
        Rows [start, stop).
    window : int
    """
    runs = np.asarray(segments, dtype=np.int64).reshape(-1, 2)
    runs = runs[np.argsort(runs[:, 0], kind="stable")]
    counts = np.maximum(runs[:, 1] - runs[:, 0] - window + 1, 0)
    first = np.repeat(runs[:, 0] - np.concatenate([[0], np.cumsum(counts)[:-1]]), counts)
    return first + np.arange(int(counts.sum()))


class MotionWindows:
    """The windows of a database, without a copy of them.

    Window number k begins in row ``starts[k]`` and is the point ``parameters[row : row + W].ravel()`` of W P
    dimensions. Parameters may be mapped from a file larger than memory: windows overlap and lie in it as they are.

    Parameters
    ----------
    parameters : array_like, shape (N, P)
    segments : array_like of int, shape (S, 2)
    window : int
        Frames, W.

    Raises
    ------
    EvalkitError
        If no segment is as long as a window, or parameters and segments do not belong together.
    """

    def __init__(self, parameters: ArrayLike, segments: ArrayLike, window: int) -> None:
        values = np.asanyarray(parameters)
        if values.ndim != 2 or not values.shape[1]:
            raise EvalkitError(f"parameters have shape {values.shape}; expected (rows, parameters), at least one")
        runs = np.asarray(segments, dtype=np.int64).reshape(-1, 2)
        if window < 1:
            raise EvalkitError(f"a window of {window} frames; at least 1 is needed")
        if len(runs) and (runs.min() < 0 or runs.max() > len(values)):
            raise EvalkitError(f"segments reach to row {runs.max()}, the database has {len(values)}")
        self.parameters: NDArray[np.float32] = np.ascontiguousarray(values, dtype=np.float32)
        self.window = window
        self.starts = legal_starts(runs, window)
        if not len(self.starts):
            raise EvalkitError(
                f"no segment of the database is as long as a window of {window} frames; add longer takes"
            )
        self.dimensions = window * values.shape[1]
        count, step = len(values) - window + 1, self.parameters.strides[0]
        self._points = np.lib.stride_tricks.as_strided(
            self.parameters, (count, self.dimensions), (step, self.parameters.itemsize), writeable=False
        )

    def __len__(self) -> int:
        return len(self.starts)

    def points(self, which: Rows | slice) -> NDArray[np.float32]:
        """Windows by their numbers, (m, W P)."""
        return self._points[self.starts[which]]

    def blocks(self) -> Iterator[tuple[slice, NDArray[np.float32]]]:
        """All windows, a few thousand at a time."""
        for start in range(0, len(self), GATHER):
            part = slice(start, min(start + GATHER, len(self)))
            yield part, self.points(part)

    def number_of(self, rows: Rows) -> Rows:
        """Numbers of the windows that begin in these rows; -1 where none does."""
        at = np.minimum(np.searchsorted(self.starts, rows), len(self) - 1)
        return np.where(self.starts[at] == rows, at, -1)

    def squares(self, query: Array, which: Rows) -> Array:
        """Squared distances (m,) of windows from one query (W P,), in double precision."""
        off = self.points(which) - query
        return np.asarray(np.einsum("ij,ij->i", off, off))

    def checked(self, queries: ArrayLike, k: int) -> tuple[Array, int]:
        """Queries (Q, W P) in double precision, and k, at most the number of windows.

        Raises
        ------
        EvalkitError
            If the queries have another length or are not finite, or k is less than 1.
        """
        points = np.atleast_2d(np.asarray(queries, dtype=np.float64))
        if points.ndim != 2 or points.shape[1] != self.dimensions:
            raise EvalkitError(
                f"queries have shape {points.shape}; expected (queries, {self.dimensions}): {self.window} frames of "
                f"{self.parameters.shape[1]} parameters"
            )
        wrong = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if len(wrong):
            raise EvalkitError(f"query {wrong[0]} has parameters that are not known; fill them before searching")
        if k < 1:
            raise EvalkitError(f"{k} nearest windows are asked for; at least 1")
        return points, min(k, len(self))

    def answer(self, query: Array, which: Rows, k: int) -> tuple[Array, Rows]:
        """Distances and rows of the k nearest among some windows, nearest first; the earlier one of equal ones."""
        squares = self.squares(query, which)
        if k < len(which):
            near = np.flatnonzero(squares <= np.partition(squares, k - 1)[k - 1])
            which, squares = which[near], squares[near]
        order = np.lexsort((which, squares))[:k]
        return np.sqrt(squares[order]), self.starts[which[order]]
