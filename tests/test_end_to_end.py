"""The study of the whole chain: every way of driving a filmed head answers, and who knows more does better."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from evalkit.studies import end_to_end
from evalkit.studies.end_to_end import LIVE, OWN, POINTS, REST, TRUE_MARKERS, TRUE_POINTS


@pytest.fixture(scope="module")
def filmed():
    return end_to_end.prepare(7, "template-small", OWN, 1800, 40, "180x144")


@pytest.fixture(scope="module")
def scores(filmed):
    wanted = (LIVE, TRUE_POINTS, TRUE_MARKERS, REST)
    return {name: end_to_end.score(filmed, end_to_end.run(filmed, name)) for name in wanted}


def test_every_way_answers_and_who_knows_more_does_better(scores):
    assert all(math.isfinite(row[key]) for row in scores.values() for key in ("vertex_mm", "relative", "opening_mm"))
    assert scores[REST]["relative"] == pytest.approx(1.0)
    # What is left of true points and true markers is the way onto the head, measured in the study retarget.
    assert max(scores[TRUE_MARKERS]["relative"], scores[TRUE_POINTS]["relative"]) < 0.5
    assert scores[TRUE_POINTS]["relative"] < scores[LIVE]["relative"] < 0.9
    assert scores[LIVE]["frames_per_second"] > 1.0 and scores[REST]["frames_per_second"] is None


@pytest.mark.slow
def test_the_ways_over_a_whole_video_answer_too(filmed, scores):
    for name in (*end_to_end.SETTINGS, POINTS):
        found = end_to_end.score(filmed, end_to_end.run(filmed, name))["relative"]
        assert scores[TRUE_POINTS]["relative"] < found < 1.2


def test_the_truth_scores_zero_and_another_performance_scores_badly(filmed):
    assert end_to_end.score(filmed, end_to_end.Driven(filmed.truth))["vertex_mm"] == 0.0
    # Control: the same motion backwards in time is no better than none.
    backwards = end_to_end.score(filmed, end_to_end.Driven(np.ascontiguousarray(filmed.truth[::-1])))
    assert backwards["relative"] > 0.9


def test_a_database_of_other_numbers_is_noticed(filmed):
    """Parameters of the database in disorder: the chain finds wrong motions."""
    mixed = np.random.default_rng(0).permutation(filmed.database.motions)
    broken = replace(filmed, database=replace(filmed.database, motions=mixed))
    whole = end_to_end.score(filmed, end_to_end.run(filmed, TRUE_POINTS))["relative"]
    assert end_to_end.score(broken, end_to_end.run(broken, TRUE_POINTS))["relative"] > 1.3 * whole
