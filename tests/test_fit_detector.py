"""A head fitted automatically to a portrait, seen by a face detector, beside the same photo on an ellipsoid."""

from __future__ import annotations

import pytest
from PIL import Image
from realdata import real_data

from evalkit.errors import EvalkitError
from evalkit.render.offscreen import require_offscreen


@pytest.mark.slow
def test_a_fitted_portrait_turns_as_a_head_does_and_the_ellipsoid_does_not(tmp_path, monkeypatch):
    pytest.importorskip("mediapipe", reason="pip install evalkit[vision]")
    data = pytest.importorskip("skimage.data", reason="pip install scikit-image")
    try:
        require_offscreen()
    except EvalkitError as error:
        pytest.skip(str(error))
    monkeypatch.setenv("EVALKIT_LANDMARKER", str(real_data("models", "face_landmarker_v2.task")))
    from evalkit.studies.photo_fit import ELLIPSOID, FITTED, TURNS_DEG, prepare, run, score

    Image.fromarray(data.astronaut()).save(tmp_path / "astronaut.png")
    head = prepare(0, str(tmp_path / "astronaut.png"))
    found = {method: score(head, run(head, method)) for method in (FITTED, ELLIPSOID)}
    for method, facts in found.items():
        print(method, facts)
    assert found[FITTED]["found"] == len(TURNS_DEG)
    # That a shape is that of a face shows in where its features go when it turns; no limit but the control's is known.
    assert found[FITTED]["nose_percent"] < found[ELLIPSOID]["nose_percent"]
    assert found[FITTED]["chin_percent"] < found[ELLIPSOID]["chin_percent"]
