"""Nearest windows of a database: the table of searchers, and those that always find them all.

A searcher is made of ``(parameters (N, P), segments (S, 2), window)``, the known columns of a database's parameters,
and answers ``nearest(queries (Q, W P), k)`` with distances (Q, k), nearest first, and the rows (Q, k) in which the
windows begin. Queries come in the order of time; a searcher may use what it found for the last one, and ``reset()``
makes it forget.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.control.graph import GraphSearcher
from evalkit.control.motion_windows import MotionWindows, Rows
from evalkit.errors import EvalkitError
from evalkit.geometry import Array

COMPONENTS = 24
"""Principal components of the windows that a lower bound is made of."""

SAMPLE = 20_000
"""Windows that the components are found from; any others would be right, too, only less quick."""

BATCH = 16
"""Queries whose bounds are worked out together, where more than one is asked."""

MANY = 8
"""Windows, for every one that is asked for, beyond which a better upper bound is looked for."""

SLACK = 1e-5
"""Part of the largest squared length by which squared distances in single precision may be wrong: some ten times
2^-24, times the square root of the number of terms."""


class Searcher(Protocol):
    """What every searcher does."""

    windows: MotionWindows

    def nearest(self, queries: ArrayLike, k: int) -> tuple[Array, Rows]:
        """Distances (Q, k) and first rows (Q, k) of the nearest windows, nearest first; fewer if there are fewer."""
        ...

    def reset(self) -> None:
        """Forget the queries so far: the next one begins another stream."""
        ...


class _OneByOne:
    """Answers that are found for one query after the other."""

    windows: MotionWindows

    def nearest(self, queries: ArrayLike, k: int) -> tuple[Array, Rows]:
        """See :class:`Searcher`."""
        points, k = self.windows.checked(queries, k)
        distances, rows = np.empty((len(points), k)), np.empty((len(points), k), dtype=np.int64)
        for q, point in enumerate(points):
            distances[q], rows[q] = self.windows.answer(point, self._candidates(point, k), k)
        return distances, rows

    def _candidates(self, point: Array, k: int) -> Rows:
        raise NotImplementedError

    def reset(self) -> None:
        """See :class:`Searcher`; nothing is kept here."""


class ExactSearcher(_OneByOne):
    """Brute force: the distances of all windows, in single precision by matrix products, then exactly for the nearest.

    The windows are never copied: ``w_i · q = sum_t x_{i+t} · q_t`` is summed up from the products of rows. Works on
    parameters that are mapped from a file larger than memory.
    """

    BLOCK = 16_384

    def __init__(self, parameters: ArrayLike, segments: ArrayLike, window: int) -> None:
        self.windows = MotionWindows(parameters, segments, window)
        self._lengths = np.empty(len(self.windows), dtype=np.float32)
        for part, points in self.windows.blocks():
            self._lengths[part] = np.einsum("ij,ij->i", points, points)

    def _candidates(self, point: Array, k: int) -> Rows:
        own, width = self.windows, self.windows.window
        frames = point.reshape(width, -1).astype(np.float32).T
        squares = np.empty(len(own), dtype=np.float32)
        for start in range(0, len(own), self.BLOCK):
            part = slice(start, min(start + self.BLOCK, len(own)))
            first, last = own.starts[part][[0, -1]]
            products = own.parameters[first : last + width] @ frames
            # The sums along the diagonals are the products of the windows.
            step = products.strides[0]
            along = np.lib.stride_tricks.as_strided(
                products, (last - first + 1, width), (step, step + products.itemsize), writeable=False
            )
            squares[part] = along.sum(axis=1)[own.starts[part] - first]
        squares *= -2.0
        squares += self._lengths
        limit = np.partition(squares, k - 1)[k - 1]
        return np.flatnonzero(squares <= limit + 2.0 * SLACK * (self._lengths.max() + point @ point))


class PrunedSearcher(_OneByOne):
    """All of the nearest windows, most others ruled out by a lower bound of their distance.

    With z the leading principal components of a window and r the length of what they leave,
    ``|w - q|^2 >= |z_w - z_q|^2 + (r_w - r_q)^2``. Neighbours of the last query and their successors give an upper
    bound of the k-th distance; windows whose lower bound is above it are no answer. Whatever that bound is, the
    answers are the nearest ones.

    Takes memory for :data:`COMPONENTS` + 2 numbers a window.
    """

    def __init__(self, parameters: ArrayLike, segments: ArrayLike, window: int, components: int = COMPONENTS) -> None:
        self.windows = MotionWindows(parameters, segments, window)
        count = len(self.windows)
        some = self.windows.points(np.unique(np.linspace(0, count - 1, min(count, SAMPLE)).astype(np.int64)))
        self._mean = some.mean(axis=0, dtype=np.float64)
        off = some - self._mean.astype(np.float32)
        _, vectors = np.linalg.eigh((off.T @ off).astype(np.float64))
        self._basis = vectors[:, ::-1][:, :components].astype(np.float32)
        kept = self._basis.shape[1]
        # The columns of one array, so that one product gives the whole bound.
        self._table = np.empty((count, kept + 1), dtype=np.float32)
        self._constant = np.empty(count, dtype=np.float32)
        for part, points in self.windows.blocks():
            off = points - self._mean.astype(np.float32)
            lead = off @ self._basis
            whole = np.einsum("ij,ij->i", off, off)
            left = np.sqrt(np.maximum(whole - np.einsum("ij,ij->i", lead, lead), 0.0))
            self._table[part, :kept], self._table[part, kept] = lead, left
            self._constant[part] = np.einsum("ij,ij->i", lead, lead) + left**2
        self._largest = float(self._constant.max())
        self._near: Rows = np.empty(0, dtype=np.int64)

    def reset(self) -> None:
        """See :class:`Searcher`."""
        self._near = np.empty(0, dtype=np.int64)

    def nearest(self, queries: ArrayLike, k: int) -> tuple[Array, Rows]:
        """See :class:`Searcher`."""
        points, k = self.windows.checked(queries, k)
        distances, rows = np.empty((len(points), k)), np.empty((len(points), k), dtype=np.int64)
        off = points - self._mean
        lead = off @ self._basis
        left = np.sqrt(np.maximum((off**2).sum(axis=1) - (lead**2).sum(axis=1), 0.0))
        folded = np.column_stack([lead, left]).astype(np.float32)
        for q, point in enumerate(points):
            if q % BATCH == 0:
                batch = folded[q : q + BATCH] @ self._table.T
            bounds = batch[q % BATCH]
            bounds *= -2.0
            bounds += self._constant
            own = float((folded[q].astype(np.float64) ** 2).sum())
            beyond = 2.0 * SLACK * (self._largest + own) - own
            left_over = np.flatnonzero(bounds <= self._kth(point, self._seeds(bounds, k), k) + beyond)
            if len(left_over) > MANY * k:  # the last answer was of little use: the stream has jumped
                lowest = left_over[np.argpartition(bounds[left_over], 2 * k)[: 2 * k]]
                left_over = left_over[bounds[left_over] <= self._kth(point, lowest, k) + beyond]
            distances[q], rows[q] = self.windows.answer(point, left_over, k)
            self._near = rows[q]
        return distances, rows

    def _kth(self, point: Array, which: Rows, k: int) -> float:
        """Squared distance of the k-th nearest among some windows: no answer is further."""
        return float(np.partition(self.windows.squares(point, which), k - 1)[k - 1])

    def _seeds(self, bounds: NDArray[np.float32], k: int) -> Rows:
        """At least k windows that are likely to be near."""
        numbers = self.windows.number_of(np.unique(np.concatenate([self._near, self._near + 1])))
        numbers = numbers[numbers >= 0]
        return numbers if len(numbers) >= k else np.argpartition(bounds, k - 1)[:k]


class TreeSearcher:
    """SciPy's k-d tree over all windows, which it holds in memory in double precision."""

    def __init__(self, parameters: ArrayLike, segments: ArrayLike, window: int) -> None:
        from scipy.spatial import cKDTree

        self.windows = MotionWindows(parameters, segments, window)
        self._tree = cKDTree(self.windows.points(slice(None)))

    def nearest(self, queries: ArrayLike, k: int) -> tuple[Array, Rows]:
        """See :class:`Searcher`."""
        points, k = self.windows.checked(queries, k)
        distances, numbers = self._tree.query(points, k=range(1, k + 1))
        return np.asarray(distances), self.windows.starts[numbers]

    def reset(self) -> None:
        """See :class:`Searcher`; nothing is kept here."""


class _FaissSearcher:
    """An index of faiss over all windows, which it holds in memory in single precision."""

    def __init__(self, parameters: ArrayLike, segments: ArrayLike, window: int) -> None:
        self.windows = MotionWindows(parameters, segments, window)
        self._index = self._empty(_faiss(), self.windows.dimensions)
        for _, points in self.windows.blocks():
            self._index.add(points)

    def _empty(self, faiss: Any, dimensions: int) -> Any:
        raise NotImplementedError

    def _prepare(self, k: int) -> None:
        """Settings that depend on k."""

    def nearest(self, queries: ArrayLike, k: int) -> tuple[Array, Rows]:
        """See :class:`Searcher`."""
        points, k = self.windows.checked(queries, k)
        self._prepare(k)
        _, numbers = self._index.search(points.astype(np.float32), k)
        distances, rows = np.empty(numbers.shape), np.empty(numbers.shape, dtype=np.int64)
        for q, point in enumerate(points):
            found = numbers[q][numbers[q] >= 0]
            if len(found) < k:  # a graph of few windows may not reach them all
                found = np.concatenate([found, np.setdiff1d(np.arange(len(self.windows)), found)[: k - len(found)]])
            # faiss sums in single precision; the order of its answers is settled in double.
            distances[q], rows[q] = self.windows.answer(point, found, k)
        return distances, rows

    def reset(self) -> None:
        """See :class:`Searcher`; nothing is kept here."""


class FlatSearcher(_FaissSearcher):
    """Brute force by faiss."""

    def _empty(self, faiss: Any, dimensions: int) -> Any:
        return faiss.IndexFlatL2(dimensions)


class HnswSearcher(_FaissSearcher):
    """Hierarchical navigable small worlds (Malkov & Yashunin 2018, doi:10.1109/TPAMI.2018.2889473), by faiss."""

    LINKS, BUILD = 24, 100

    def _empty(self, faiss: Any, dimensions: int) -> Any:
        index = faiss.IndexHNSWFlat(dimensions, self.LINKS)
        index.hnsw.efConstruction = self.BUILD
        return index

    def _prepare(self, k: int) -> None:
        # The list of candidates must be longer than the answer.
        self._index.hnsw.efSearch = 2 * k


def _faiss() -> Any:
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its wrapper uses what newer Pythons deprecate
        import faiss
    return faiss


@dataclass(frozen=True)
class SearchMethod:
    """A searcher of the table.

    Attributes
    ----------
    build : callable
        ``build(parameters, segments, window) -> Searcher``.
    text : str
        What it does, in a line.
    source : str
    exact : bool
        Whether it always finds the nearest.
    package : str
        What it needs besides evalkit's own requirements; empty if nothing.
    """

    build: Callable[..., Searcher]
    text: str
    source: str
    exact: bool
    package: str = ""

    def __call__(self, parameters: ArrayLike, segments: ArrayLike, window: int, **options: Any) -> Searcher:
        """Make one.

        Raises
        ------
        EvalkitError
            If its package is missing or the windows cannot be made.
        """
        if self.package and find_spec(self.package) is None:
            raise EvalkitError(f"this search needs {self.package}: pip install 'evalkit[control]'")
        return self.build(parameters, segments, window, **options)


searchers: dict[str, SearchMethod] = {
    "pruned": SearchMethod(
        PrunedSearcher, "all of the nearest, by a lower bound from principal components and rests", "this project", True
    ),
    "exact": SearchMethod(ExactSearcher, "all of the nearest, by brute force without copies", "brute force", True),
    "k-d tree": SearchMethod(TreeSearcher, "all of the nearest, by SciPy's k-d tree", "Bentley 1975", True),
    "graph": SearchMethod(
        GraphSearcher, "successors and neighbours of the last answer, and random windows", "Chai et al. 2003", False
    ),
    "graph only": SearchMethod(
        GraphSearcher.without_random, "successors and neighbours of the last answer", "Chai et al. 2003", False
    ),
    "faiss": SearchMethod(
        FlatSearcher, "all of the nearest, by brute force of faiss", "Douze et al. 2024", True, "faiss"
    ),
    "hnsw": SearchMethod(
        HnswSearcher, "a hierarchy of navigable graphs, by faiss", "Malkov & Yashunin 2018", False, "faiss"
    ),
}
"""Name -> searcher."""

DEFAULT = "pruned"
"""The searcher that is taken if none is asked for: exact, and quick enough for 70,000 windows at 30 frames a second
(study ``knn``)."""


def searchers_here() -> Sequence[str]:
    """Names of those whose package is installed."""
    return tuple(name for name, method in searchers.items() if not method.package or find_spec(method.package))
