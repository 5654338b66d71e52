"""Searches for the nearest windows of a motion database, along a stream of frames.

Question: how many of the K nearest windows does each search find, does it go on doing so, and how fast is it?

Finding: the default finds all of them, in every part of the stream; so do all searches that rule nothing out unseen.
One seed, K = 100. The paper's graph by itself has 0.46, 0.46 and 0.57 of them among 2,000, 10,000 and 70,000 windows of
varied motion, 0.14 to 0.27 in its worst twentieth of the stream, and 0.14 to 0.25 less in the last quarter than in the
first; what it finds instead is 6 to 13 % further away. With 200 random windows a query 0.93, 0.84 and 0.70, which does
not fall along the stream; 0.2 to 1.9 % further. On one sentence again and again it is 0.71, 0.93 and 0.94 without and
0.94 with random windows. faiss' HNSW has 0.98 or more, 0.91 in its worst part. K = 50 or 150 changes little. Speeds are
wall-clock time on a machine that had four times as much other work as cores, and not always as much, so that only their
order of magnitude counts: among 70,000 windows of varied motion 109 queries a second for the default, 71 for brute
force, 23 for that of faiss, 8 for the k-d tree, 265 for the graph with random windows, 141 for HNSW; where a sentence
comes 117 times, which leaves little to rule out, 25 for the default and 33 for brute force. The graph took 197 and
691 s to build, HNSW 98 and 29, the default 0.5 and 3.2.

Command: ``evalkit study run knn --budget full``
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from evalkit.capture import Capture
from evalkit.control.graph import neighbour_graph
from evalkit.control.motion_windows import Rows
from evalkit.control.search import DEFAULT, Searcher, searchers, searchers_here
from evalkit.control.takes import DatabaseTake, TakeOptions, database_take
from evalkit.geometry import Array
from evalkit.seeds import generator
from evalkit.studies.control_takes import RIGID_SITES, control_take
from evalkit.studies.takes import told
from evalkit.study.command import script
from evalkit.study.description import Budget, Condition, Expected, Scalar, Study
from evalkit.study.statistics import Statistic, mean, median
from evalkit.vision.parameters import PARAMETERS

WINDOW = 20
"""Frames: with 15 parameters, 300 dimensions."""

SENTENCE = 600
"""Frames of the sentence that a repetitive database consists of, ten seconds."""

MARKER_NOISE_MM, QUERY_NOISE = 0.1, 0.2
"""Noise of the database's markers; of the queries' parameters, in units of the database's spread."""

LEAST_SPREAD = np.array([0.5 if p.unit == "deg" else 0.01 if p.form == "ratio" else 0.005 for p in PARAMETERS])
"""By which a parameter is divided at least: less than in a database for video, so that windows have as many dimensions
as they can, which is what makes them hard to search."""

GAIN = 0.1
"""Standard deviation of how strongly a sentence is said."""

BLOCKS = 20
"""Parts of the stream in which recall is told apart."""

TENTH = ("exact", "k-d tree", "faiss")
"""Searches that answer every tenth query only: they keep nothing from one to the next, and take their time."""

EXACT = tuple(name for name, method in searchers.items() if method.exact)


@dataclass(frozen=True, eq=False)
class Stream:
    """Queries, and what they are looked for in.

    Attributes
    ----------
    parameters : ndarray of float32, shape (N, 15)
    segments : ndarray of int, shape (S, 2)
    queries : ndarray, shape (F, 300)
    nearest : int
    truth : tuple of ndarray, shapes (F, K)
        Distances and rows of the nearest windows.
    """

    parameters: Array
    segments: Rows
    queries: Array
    nearest: int
    truth: tuple[Array, Rows]

    @cached_property
    def graph(self) -> tuple[Any, float]:
        """Neighbour graph, the same for the searches with and without random windows, and the time that it took, s."""
        start = time.perf_counter()
        return neighbour_graph(self.parameters, self.segments, WINDOW), time.perf_counter() - start


def conditions(axes: Mapping[str, tuple[Scalar, ...]]) -> Iterator[Condition]:
    """Both kinds of database in all sizes; other numbers of neighbours in the middle size of the first kind."""
    usual = {axis: values[0] for axis, values in axes.items()}
    for windows in axes["windows"]:
        for kind in axes["database"]:
            yield {**usual, "windows": windows, "database": kind}
    for nearest in axes["nearest"][1:]:
        yield {**usual, "windows": axes["windows"][len(axes["windows"]) // 2], "nearest": nearest}


def prepare(seed: int, head: str, windows: int, database: str, nearest: int, frames: int) -> Stream:
    """The data of a cell: one performer's motion, and a stream of the same performer in another performance."""
    rows = windows + WINDOW - 1
    if database == "varied":
        base = _take(control_take(head, seed, rows).still, seed)
        stream = _take(control_take(head, seed + 1000, frames + WINDOW - 1).still, seed + 1000)
    else:
        said = control_take(head, seed, SENTENCE).still
        base = _take(_repeated(said, rows, seed), seed)
        stream = _take(_repeated(said, frames + WINDOW - 1, seed + 1000), seed + 1000)
    spread = np.maximum(base.changes.std(axis=0), LEAST_SPREAD)
    parameters = (base.changes / spread).astype(np.float32)
    signal = stream.changes / spread
    signal = signal + QUERY_NOISE * generator("knn", "queries", seed=seed).standard_normal(signal.shape)
    queries = np.lib.stride_tricks.sliding_window_view(signal, WINDOW, axis=0).transpose(0, 2, 1)
    queries = np.ascontiguousarray(queries.reshape(len(queries), -1))
    # The default is exact whatever the data; tests hold it against an enumeration.
    truth = searchers[DEFAULT](parameters, base.segments, WINDOW).nearest(queries, nearest)
    return Stream(parameters, base.segments, queries, nearest, truth)


def _repeated(said: Capture, frames: int, seed: int) -> Capture:
    """A sentence again and again, each time somewhat stronger or weaker, and fading in and out of its first frame."""
    random = generator("knn", "repetitions", seed=seed)
    count = -(-frames // len(said.points))
    rest = said.points[0]
    edge = np.minimum(np.arange(len(said.points)), np.arange(len(said.points))[::-1]) / 30.0
    moves = np.minimum(edge, 1.0)[:, None, None] * (said.points - rest)
    gains = 1.0 + GAIN * random.standard_normal(count)
    points = rest + np.concatenate([gain * moves for gain in gains])[:frames]
    return Capture(points=points, labels=said.labels, rate=said.rate)


def _take(still: Capture, seed: int) -> DatabaseTake:
    noise = generator("knn", "markers", seed=seed).standard_normal(still.points.shape)
    noisy = Capture(points=still.points + MARKER_NOISE_MM * noise, labels=still.labels, rate=still.rate)
    return database_take(noisy, "take", TakeOptions(), compensated=True, rigid=tuple(RIGID_SITES))


def run(data: Stream, method: str) -> dict[str, Any]:
    """Answers to the stream, one query after the other, as they come when a camera is followed."""
    start, given, before = time.perf_counter(), {}, 0.0
    if method.startswith("graph"):
        given["graph"], before = data.graph
        start = time.perf_counter()
    search: Searcher = searchers[method](data.parameters, data.segments, WINDOW, **given)
    built = time.perf_counter() - start + before
    asked = np.arange(0, len(data.queries), 10 if method in TENTH else 1)
    search.nearest(data.queries[:1], data.nearest)  # the first call is paid for by nobody
    search.reset()
    distances, rows = np.empty((len(asked), data.nearest)), np.empty((len(asked), data.nearest), dtype=np.int64)
    times = np.empty(len(asked))
    for k, query in enumerate(asked):
        start = time.perf_counter()
        distances[k], rows[k] = search.nearest(data.queries[query : query + 1], data.nearest)
        times[k] = time.perf_counter() - start
    return {"asked": asked, "distances": distances, "rows": rows, "times": times, "built": built}


def score(data: Stream, found: dict[str, Any]) -> dict[str, Any]:
    """Recall along the stream, and what it cost."""
    asked = found["asked"]
    true_distances, true_rows = data.truth[0][asked], data.truth[1][asked]
    pairs = zip(found["rows"], true_rows, strict=True)
    recall = np.array([np.isin(rows, truth).mean() for rows, truth in pairs])
    parts = [part.mean() for part in np.array_split(recall, BLOCKS)]
    further = found["distances"].mean(axis=1) / true_distances.mean(axis=1) - 1.0
    # The first query of a search along the graph is compared with all windows: it is no frame of the stream.
    times = found["times"][1:]
    return {
        "recall": recall.mean(),
        "recall_worst": min(parts),
        "recall_change": np.mean(parts[-5:]) - np.mean(parts[:5]),
        "further_percent": 100.0 * further.mean(),
        **{f"recall_{k + 1}": value for k, value in enumerate(parts)},
        "queries_per_second": 1.0 / times.mean(),
        "slow_ms": 1e3 * float(np.quantile(times, 0.99)),
        "built_s": found["built"],
    }


QUESTION, FINDING = told(__doc__)

STATISTICS: tuple[Statistic, ...] = (
    mean("recall", "recall", "", less=False),
    mean("recall_worst", "worst part", "", less=False),
    mean("recall_change", "change along the stream", "", less=None),
    mean("further_percent", "further", "%"),
    median("queries_per_second", "queries a second", "1/s", less=False),
    median("slow_ms", "slow query", "ms"),
    median("built_s", "built in", "s"),
)

study = Study(
    name="knn",
    question=QUESTION,
    finding=FINDING,
    axes={
        "head": ("template",),
        "windows": (2_000, 10_000, 70_000),
        "database": ("varied", "repetitive"),
        "nearest": (100, 50, 150),
        "frames": (2_000,),
    },
    methods=tuple(searchers_here()),
    prepare=prepare,
    run=run,
    score=score,
    columns={
        "recall": f"share of the K nearest windows of {WINDOW} frames that are found, mean over the stream; every "
        f"tenth frame for {', '.join(TENTH)}",
        "recall_worst": f"the lowest mean of it in a {BLOCKS}th of the stream",
        "recall_change": "its mean in the last quarter of the stream less that in the first",
        "further_percent": "how much further than the nearest the found windows are: mean distances, in % of the true",
        **{f"recall_{k + 1}": f"recall in part {k + 1} of {BLOCKS} of the stream" for k in range(BLOCKS)},
    },
    machine={
        "queries_per_second": "queries a second, one after the other, on one core",
        "slow_ms": "time that one in a hundred queries exceeds, ms",
        "built_s": "time to make the search ready, s; the graph included",
    },
    statistics=STATISTICS,
    full=Budget(seeds=1),
    small=Budget(
        seeds=1,
        axes={
            "head": ("template 3000",), "windows": (2_000,), "nearest": (100,), "frames": (200,),
        },
    ),
    conditions=conditions,
    expected=(
        *(Expected("recall", name, 1.0, least=True) for name in EXACT if name in searchers_here()),
        Expected("worst part", DEFAULT, 0.9, least=True),
    ),
    serial=True,
)  # fmt: skip

if __name__ == "__main__":
    script(study)
