"""What every searcher of the table must do, and broken searchers that must not get through."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from importlib.util import find_spec

import numpy as np
import pytest
from oracles.search_oracles import nearest_slow, windows_slow

from evalkit import EvalkitError
from evalkit.control.motion_windows import MotionWindows
from evalkit.control.search import ExactSearcher, searchers

WINDOW, K = 6, 7
SEGMENTS = np.array([[0, 60], [60, 63], [63, 130], [130, 136], [140, 240]])
"""One too short for a window, one that is just long enough, rows between two that belong to none."""


def motion(seed=0, rows=240, columns=3):
    """Smooth, like a face."""
    random = np.random.default_rng(seed)
    walk = np.cumsum(random.standard_normal((rows + 8, columns)), axis=0)
    return np.stack([walk[k : k + rows] for k in range(8)]).mean(axis=0).astype(np.float32)


PARAMETERS = motion()
QUERIES = np.lib.stride_tricks.sliding_window_view(motion(1), WINDOW, axis=0)[:40].transpose(0, 2, 1).reshape(40, -1)

everyone = pytest.mark.parametrize(
    "method",
    [
        pytest.param(
            method, id=name,
            marks=() if not method.package or find_spec(method.package) else pytest.mark.skip("needs evalkit[control]"),
        )
        for name, method in searchers.items()
    ],
)  # fmt: skip


def answers_are_windows_of_the_database(method):
    """Each once, within its segment, nearest first, with its true distance, and as many as there are."""
    distances, rows = method(PARAMETERS, SEGMENTS, WINDOW).nearest(QUERIES, K)
    assert distances.shape == rows.shape == (len(QUERIES), K)
    assert distances.dtype == np.float64 and rows.dtype == np.int64
    legal = windows_slow(SEGMENTS, WINDOW)
    assert np.isin(rows, legal).all()
    assert (np.diff(distances, axis=1) >= 0).all()
    for query, found, away in zip(QUERIES, rows, distances, strict=True):
        assert len(set(found)) == K
        true = [np.linalg.norm(PARAMETERS[row : row + WINDOW].ravel() - query) for row in found]
        # Single precision of numbers up to 20, over 18 of them.
        np.testing.assert_allclose(away, true, rtol=0, atol=1e-4)
    assert method(PARAMETERS, SEGMENTS, WINDOW).nearest(QUERIES[:1], 10_000)[1].shape == (1, len(legal))


@lru_cache(maxsize=1)
def enumerated():
    return [[row for _, row in nearest_slow(PARAMETERS, SEGMENTS, WINDOW, query, K)] for query in QUERIES]


def finds_what_an_enumeration_finds(method):
    """All of the nearest if it says so; of the others, those of the first query, and the nearest of most."""
    _, rows = method(PARAMETERS, SEGMENTS, WINDOW).nearest(QUERIES, K)
    truth = enumerated()
    if method.exact:
        assert rows.tolist() == truth
    else:
        shares = [len({*found} & {*true}) / K for found, true in zip(rows.tolist(), truth, strict=True)]
        # Two hundred windows: whatever follows the motion at all finds half of them.
        assert shares[0] == 1.0 and np.mean(shares) >= 0.5


def a_window_of_the_database_finds_itself(method):
    """Also far from zero, where differences of squares lose their digits."""
    far = PARAMETERS + np.float32(100.0)
    search = method(far, SEGMENTS, WINDOW)
    for row in (0, 54, 63, 130, 234):
        search.reset()
        distances, rows = search.nearest(far[row : row + WINDOW].reshape(1, -1), 1)
        assert rows[0, 0] == row and distances[0, 0] == pytest.approx(0.0, abs=1e-6)


def a_stream_begins_again_after_a_reset(method):
    """And another searcher of the same makes the same of it; one by one or at once is no matter."""
    search = method(PARAMETERS, SEGMENTS, WINDOW)
    once = search.nearest(QUERIES, K)
    search.reset()
    single = [search.nearest(query, K) for query in QUERIES]
    other = method(PARAMETERS, SEGMENTS, WINDOW).nearest(QUERIES, K)
    for part in range(2):
        np.testing.assert_array_equal(np.concatenate([answer[part] for answer in single]), once[part])
        np.testing.assert_array_equal(other[part], once[part])


def leaves_its_inputs_alone(method):
    parameters, segments, queries = PARAMETERS.copy(), SEGMENTS.copy(), QUERIES.copy()
    for array in (parameters, segments, queries):
        array.setflags(write=False)
    method(parameters, segments, WINDOW).nearest(queries, K)
    np.testing.assert_array_equal(parameters, PARAMETERS)


def refuses_what_it_cannot_answer(method):
    with pytest.raises(EvalkitError, match="is as long as a window of 200 frames"):
        method(PARAMETERS, SEGMENTS, 200)
    search = method(PARAMETERS, SEGMENTS, WINDOW)
    with pytest.raises(EvalkitError, match=r"expected \(queries, 18\)"):
        search.nearest(QUERIES[:, 1:], K)
    unknown = QUERIES.copy()
    unknown[3, 5] = np.nan
    with pytest.raises(EvalkitError, match="query 3 has parameters that are not known"):
        search.nearest(unknown, K)
    with pytest.raises(EvalkitError, match="at least 1"):
        search.nearest(QUERIES, 0)


CONTRACT = (
    answers_are_windows_of_the_database,
    finds_what_an_enumeration_finds,
    a_window_of_the_database_finds_itself,
    a_stream_begins_again_after_a_reset,
    leaves_its_inputs_alone,
    refuses_what_it_cannot_answer,
)


@everyone
@pytest.mark.parametrize("rule", CONTRACT, ids=lambda rule: rule.__name__)
def test_searchers_keep_the_contract(rule, method):
    rule(method)


# --- controls ----------------------------------------------------------------------------------------------


class AcrossSegments(ExactSearcher):
    """Takes all rows for one segment."""

    def __init__(self, parameters, segments, window):
        super().__init__(parameters, np.array([[0, len(parameters)]]), window)


class Unsorted(ExactSearcher):
    def nearest(self, queries, k):
        distances, rows = super().nearest(queries, k)
        return distances[:, ::-1], rows[:, ::-1]


class Single(ExactSearcher):
    """Single precision and nothing else: |w|^2 - 2 w q + |q|^2."""

    def nearest(self, queries, k):
        points = np.atleast_2d(queries).astype(np.float32)
        k = self.windows.checked(points, k)[1]
        windows = self.windows.points(slice(None))
        squares = (windows**2).sum(axis=1) - 2 * points @ windows.T + (points**2).sum(axis=1)[:, None]
        order = np.argsort(squares, axis=1)[:, :k]
        return np.sqrt(np.maximum(np.take_along_axis(squares, order, 1), 0)).astype(float), self.windows.starts[order]


class Remembers(ExactSearcher):
    """Leaves out what it answered before, and does not forget it."""

    seen = 0

    def nearest(self, queries, k):
        self.seen += 1
        distances, rows = super().nearest(queries, k + 1)
        return distances[:, self.seen > 20 :][:, :k], rows[:, self.seen > 20 :][:, :k]


class OneMissed(ExactSearcher):
    """Never sees one of the windows."""

    def _candidates(self, point, k):
        missed = self.windows.number_of(np.array(enumerated()[0][:1]))
        return np.setdiff1d(super()._candidates(point, k + 1), missed)


@pytest.mark.parametrize(
    ("broken", "rule"),
    [
        (AcrossSegments, answers_are_windows_of_the_database),
        (Unsorted, answers_are_windows_of_the_database),
        (Single, a_window_of_the_database_finds_itself),
        (Remembers, a_stream_begins_again_after_a_reset),
        (OneMissed, finds_what_an_enumeration_finds),
    ],
)
def test_control_broken_searchers_are_noticed(broken, rule):
    with pytest.raises(AssertionError):
        rule(replace(searchers["exact"], build=broken))


def test_the_windows_are_no_copy():
    windows = MotionWindows(PARAMETERS, SEGMENTS, WINDOW)
    assert np.shares_memory(windows._points, PARAMETERS)
