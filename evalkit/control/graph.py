"""Search along a neighbour graph, as in Chai, Xiao & Hodgins (2003): what is near now was near a moment ago.

Every window knows its nearest windows. Of a stream of queries, each is compared only with what follows on the answers
of the query before, with the neighbours of these, and, which the paper does not have, with some windows at random:
without them a stream that has taken a wrong way stays on it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.control.database import Database
from evalkit.control.motion_windows import MotionWindows, Rows
from evalkit.geometry import Array
from evalkit.results import staged
from evalkit.seeds import generator

DEGREE = 16
"""Neighbours of every window."""

RANDOM = 200
"""Random windows that every query is compared with."""

FOLLOWED = 32
"""Answers of the last query, the nearest ones, whose successors' neighbours are candidates; of the others only the
successors are."""


def neighbour_graph(parameters: ArrayLike, segments: ArrayLike, window: int, degree: int = DEGREE) -> NDArray[np.int32]:
    """Numbers (n, degree) of the windows nearest to each window, itself left out, nearest first.

    Found by the exact search, which follows the windows in their order, so that tens of thousands take seconds.
    -1 where there are fewer windows.
    """
    from evalkit.control.search import PrunedSearcher

    search = PrunedSearcher(parameters, segments, window)
    windows = search.windows
    graph = np.full((len(windows), degree), -1, dtype=np.int32)
    for part, points in windows.blocks():
        _, rows = search.nearest(points, degree + 1)
        numbers = windows.number_of(rows)
        own = np.arange(part.start, part.stop)[:, None]
        # Windows that are equal to it may stand before itself; it goes last and is cut off.
        order = np.argsort(numbers == own, axis=1, kind="stable")
        kept = np.take_along_axis(numbers, order, axis=1)[:, : min(degree, len(windows) - 1)]
        graph[part, : kept.shape[1]] = kept
    return graph


def stored_graph(database: Database, window: int, degree: int = DEGREE) -> NDArray[np.int32]:
    """The neighbour graph of a database, out of its folder; made and kept there the first time.

    Parameters
    ----------
    database : Database
    window, degree : int

    Returns
    -------
    ndarray of int, shape (n, degree)
        For ``GraphSearcher(..., graph=...)``, mapped from its file.
    """
    # The digest in the name: the graph of a database that has grown since is another one.
    path = database.folder / f"graph-{window}-{degree}-{database.digest[:16]}.npy"
    if not path.is_file():
        graph = neighbour_graph(database.parameters[:, database.known], database.segments, window, degree)
        with staged(database.folder) as stage:
            np.save(stage / path.name, graph)
    return np.asanyarray(np.load(path, mmap_mode="r"))


class GraphSearcher:
    """The neighbour graph, followed by a stream of queries.

    The first query, and the first after a reset, is compared with all windows.

    Parameters
    ----------
    parameters, segments, window
        As of every searcher.
    random : int
        Windows at random for every query; 0 is the paper's way.
    degree : int
        Neighbours of every window.
    seed : int
    graph : ndarray of int, shape (n, degree), optional
        Made before by :func:`neighbour_graph`.
    """

    def __init__(
        self,
        parameters: ArrayLike,
        segments: ArrayLike,
        window: int,
        random: int = RANDOM,
        degree: int = DEGREE,
        seed: int = 0,
        graph: NDArray[np.int32] | None = None,
    ) -> None:
        self.windows = MotionWindows(parameters, segments, window)
        self.graph = neighbour_graph(self.windows.parameters, segments, window, degree) if graph is None else graph
        self._count, self._seed = random, seed
        self.reset()

    @classmethod
    def without_random(
        cls, parameters: ArrayLike, segments: ArrayLike, window: int, **options: object
    ) -> GraphSearcher:
        """The paper's way: no windows at random."""
        return cls(parameters, segments, window, **{**options, "random": 0})  # type: ignore[arg-type]

    def reset(self) -> None:
        """Forget the queries so far."""
        self._last: Rows = np.empty(0, dtype=np.int64)
        self._random = generator("graph search", seed=self._seed)

    def nearest(self, queries: ArrayLike, k: int) -> tuple[Array, Rows]:
        """Distances (Q, k) and first rows (Q, k) of the nearest windows that were looked at, nearest first."""
        points, k = self.windows.checked(queries, k)
        distances, rows = np.empty((len(points), k)), np.empty((len(points), k), dtype=np.int64)
        for q, point in enumerate(points):
            distances[q], rows[q] = self.windows.answer(point, self._candidates(k), k)
            self._last = rows[q]
        return distances, rows

    def _candidates(self, k: int) -> Rows:
        everything = np.arange(len(self.windows))
        if not len(self._last):
            return everything
        rows = np.concatenate([self._last, self._last + 1])
        reached = self.windows.number_of(rows)
        followed = self.windows.number_of(self._last[:FOLLOWED] + 1)
        followed = followed[followed >= 0]
        drawn = self._random.integers(len(self.windows), size=self._count)
        found = np.unique(np.concatenate([reached, self.graph[followed].ravel(), drawn]))
        found = found[found >= 0]
        # At the end of all segments there may be too few to answer with.
        return found if len(found) >= k else everything
