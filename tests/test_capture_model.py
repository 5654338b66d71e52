"""The Capture type: what it accepts, keeps apart and refuses."""

from __future__ import annotations

import numpy as np
import pytest

from evalkit.capture import Capture
from evalkit.errors import CaptureError


def test_a_point_with_any_coordinate_missing_is_occluded_and_the_input_is_left_alone():
    points = np.arange(18.0).reshape(3, 2, 3)
    points[1, 0, 2], points[2, 1, 0], points[0, 0, 1] = np.nan, np.inf, 1e308
    given = points.copy()
    take = Capture(points, ["A", "B"], 60)
    np.testing.assert_array_equal(points, given)
    np.testing.assert_array_equal(take.visible, [[True, True], [False, True], [True, False]])
    assert np.isnan(take.points[~take.visible]).all()
    take.points[0] = 0.0
    np.testing.assert_array_equal(points, given)
    assert take.times.tolist() == [0, 1 / 60, 2 / 60]


@pytest.mark.parametrize(
    "change, words",
    [
        ({"points": np.ones((3, 2))}, "shape"),
        ({"points": [[1, [2]]]}, "no array of numbers"),
        ({"points": "points"}, "no array of numbers"),
        ({"labels": ["A"]}, "1 labels for 2 markers"),
        ({"labels": ["A", "A"]}, "'A' is given twice"),
        ({"rate": 0.0}, "frame rate"),
        ({"rate": float("nan")}, "frame rate"),
        ({"unit": "ell"}, "unit 'ell'"),
        ({"quantities": ["position"]}, "1 quantities for 2 markers"),
        ({"quantities": ["position", "colour"]}, "quantity 'colour'"),
    ],
)
def test_refusals(change, words):
    contents = {"points": np.ones((3, 2, 3)), "labels": ["A", "B"], "rate": 60.0} | change
    with pytest.raises(CaptureError, match=words) as caught:
        Capture(**contents)
    assert "\n" not in str(caught.value)


def test_a_processed_copy_keeps_all_but_the_points():
    take = Capture(np.ones((3, 2, 3)), ["A", "B"], 60.0, "cm", 5, ("+X", "+Z"), ["position", "angle"], ["w"], "s")
    other = take.with_points(np.zeros((3, 2, 3)))
    for name in ("labels", "rate", "unit", "first_frame", "axes", "quantities", "warnings", "source"):
        assert getattr(other, name) == getattr(take, name)
    with pytest.raises(CaptureError, match="shape"):
        take.with_points(np.zeros((3, 1, 3)))


def test_unknown_labels_suggest_the_nearest():
    take = Capture(np.ones((1, 2, 3)), ["NoseTop", "Chin"], 60.0)
    assert take.indices(["Chin", "NoseTop"]) == [1, 0]
    with pytest.raises(CaptureError, match="did you mean NoseTop"):
        take.indices(["nosetip"])
