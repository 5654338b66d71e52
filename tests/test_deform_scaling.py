"""From a performer's proportions to the head's."""

from __future__ import annotations

import numpy as np
import pytest
from contracts.faces import face

from evalkit import EvalkitError
from evalkit.deform import performer_scaling
from evalkit.deform.scaling import LOWER_FACE, MEASURES, ScaleWarning

HEAD = face(31, 41)


def performer(upper=(1.0, 1.0, 1.0), lower=None):
    """The head's own sites, the part above and the part below the nose scaled about the nose."""
    lower = upper if lower is None else lower
    nose = 0.5 * (HEAD.marker_sites["NoseL"] + HEAD.marker_sites["NoseR"])
    return {
        name: nose + (place - nose) * (lower if name in LOWER_FACE else upper)
        for name, place in HEAD.marker_sites.items()
    }


def test_the_same_face_has_scale_one():
    scaling = performer_scaling(HEAD, performer())
    np.testing.assert_array_equal(scaling.scales, np.ones((23, 3)))
    assert scaling.labels == tuple(HEAD.marker_sites) and set(scaling.ratios) == set(MEASURES)


def test_a_face_of_other_proportions_is_scaled_back():
    upper, lower = np.array([1.1, 0.8, 1.25]), np.array([0.9, 1.3, 1.25])
    neutral = performer(upper, lower)
    scaling = performer_scaling(HEAD, neutral)
    for name, scale in zip(scaling.labels, scaling.scales, strict=True):
        # Quotients of differences of coordinates of 1e2 mm.
        np.testing.assert_allclose(scale, 1 / (lower if name in LOWER_FACE else upper), rtol=1e-12)
    # Control: one axis alone changes one scale alone.
    wide = performer_scaling(HEAD, performer((1.2, 1.0, 1.0)))
    np.testing.assert_allclose(wide.scales, np.broadcast_to([1 / 1.2, 1.0, 1.0], (23, 3)), rtol=1e-12)


def test_a_performer_elsewhere_in_the_room_has_the_same_scales():
    moved = {name: place + np.array([140.0, 1520.0, 260.0]) for name, place in performer((1.1, 0.9, 1.0)).items()}
    expected = performer_scaling(HEAD, performer((1.1, 0.9, 1.0))).scales
    np.testing.assert_allclose(performer_scaling(HEAD, moved).scales, expected, rtol=1e-11)


def test_extra_markers_belong_to_the_upper_face():
    neutral = performer((1.0, 1.0, 1.0), (1.0, 0.5, 1.0)) | {"Ear": np.array([80.0, 20.0, 0.0])}
    assert performer_scaling(HEAD, neutral).scales[-1].tolist() == [1.0, 1.0, 1.0]


def test_an_unlikely_ratio_warns_with_both_distances():
    with pytest.warns(ScaleWarning) as caught:
        scaling = performer_scaling(HEAD, {name: place / 10 for name, place in HEAD.marker_sites.items()})
    assert len(caught) == len(MEASURES)
    line = str(caught[0].message)
    ratio = scaling.ratios["upper x"]
    assert "between the lower eyelids" in line and "\n" not in line
    assert f"{ratio.performer_mm:.4g} mm" in line and f"{ratio.head_mm:.4g} mm" in line
    # Control: warnings are errors here, so a likely ratio gives none.
    performer_scaling(HEAD, performer((1.9, 1.9, 1.9)))


@pytest.mark.parametrize("fault", ["missing", "nan", "zero"])
def test_a_distance_that_cannot_be_taken_is_named(fault):
    neutral = performer()
    if fault == "missing":
        del neutral["Chin"]
    elif fault == "nan":
        neutral["Chin"] = np.array([0.0, np.nan, 100.0])
    else:
        neutral["MouthR"] = neutral["MouthL"]
    words = "width of the mouth is zero" if fault == "zero" else "performer has no marker Chin.*nose tip to chin"
    with pytest.raises(EvalkitError, match=words):
        performer_scaling(HEAD, neutral)
