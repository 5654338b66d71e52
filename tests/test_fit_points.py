"""Photos and points: what is read, what is refused, in one line that names it."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image
from realdata import real_data
from scipy.interpolate import RBFInterpolator

from evalkit.errors import EvalkitError
from evalkit.head.detector import DETECTED, landmarker_weights
from evalkit.head.photo import WORKING_PIXELS, Photo, read_photo
from evalkit.head.places import all_landmarks
from evalkit.head.points import (
    INNER_LIPS,
    LANDMARK_POINTS,
    POINTS,
    PUPILS,
    REQUIRED,
    check_points,
    partner,
    propose_points,
    read_points,
    write_points,
)
from evalkit.head.real_heads import aligned


def photo(size: tuple[int, int] = (400, 500)) -> Photo:
    return Photo(np.zeros((size[1], size[0], 3), dtype=np.uint8), size, "me.png", "ab" * 32)


def mean_face() -> dict[str, np.ndarray]:
    return propose_points(photo(), [[150.0, 200.0], [250.0, 210.0]]).places


# ---- photos -------------------------------------------------------------------------------------------------------


def test_a_photo_is_turned_upright_as_its_exif_says(tmp_path):
    pixels = np.zeros((40, 60, 3), dtype=np.uint8)
    pixels[:, :10] = 255
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned clockwise by a quarter: what is on the left comes to the top
    Image.fromarray(pixels).save(tmp_path / "turned.jpg", exif=exif, quality=95)
    found = read_photo(tmp_path / "turned.jpg")
    assert found.size == (40, 60) and found.pixels.shape == (60, 40, 3)
    assert found.pixels[:6].min() > 200 and found.pixels[20:].max() < 50


@pytest.mark.parametrize("mode", ["L", "P", "RGBA", "LA", "CMYK", "I;16", "1"])
def test_other_kinds_of_pixels_become_rgb(tmp_path, mode):
    ending = "tif" if mode == "CMYK" else "png"
    grey = Image.fromarray(np.full((30, 20), 128, dtype=np.uint8))
    image = Image.fromarray(np.full((30, 20), 30000, dtype=np.uint16)) if mode == "I;16" else grey.convert(mode)
    image.save(tmp_path / f"x.{ending}")
    assert read_photo(tmp_path / f"x.{ending}").pixels.shape == (30, 20, 3)


def test_a_photo_of_40_megapixels_is_worked_with_at_a_bounded_size(tmp_path):
    Image.new("RGB", (7300, 5480), "grey").save(tmp_path / "large.jpg")
    found = read_photo(tmp_path / "large.jpg")
    assert found.size == (7300, 5480)
    assert max(found.pixels.shape) == WORKING_PIXELS
    assert found.scale == pytest.approx(WORKING_PIXELS / 7300)


def spoiled_photo(kind: str) -> bytes:
    import io

    stream = io.BytesIO()
    frames = [Image.new("RGB", (20, 20), colour) for colour in ("red", "green", "blue")]
    if kind == "animated":
        frames[0].save(stream, "GIF", save_all=True, append_images=frames[1:])
    elif kind == "cut short":
        noise = np.random.default_rng(0).integers(0, 255, (80, 80, 3), dtype=np.uint8)
        Image.fromarray(noise).save(stream, "PNG")
        return stream.getvalue()[:3000]
    elif kind == "text":
        return b"no picture at all"
    return stream.getvalue()


@pytest.mark.parametrize(
    ("kind", "match"),
    [("empty", "is empty"), ("text", "unknown format"), ("cut short", "not a picture"), ("animated", "3 pictures")],
)
def test_what_is_no_photo_is_one_line(tmp_path, kind, match):
    (tmp_path / "x.png").write_bytes(spoiled_photo(kind))
    with pytest.raises(EvalkitError, match=match) as caught:
        read_photo(tmp_path / "x.png")
    assert "\n" not in str(caught.value) and "x.png" in str(caught.value)
    with pytest.raises(EvalkitError, match="cannot be read"):
        read_photo(tmp_path / "none.png")


# ---- points -------------------------------------------------------------------------------------------------------


def test_names():
    assert (
        set(LANDMARK_POINTS)
        == set(all_landmarks())
        == set(POINTS) - {*INNER_LIPS, *PUPILS}
        == {name for name in DETECTED if name not in (*INNER_LIPS, *PUPILS)}
    )
    assert set(REQUIRED) <= set(POINTS) == set(DETECTED)
    assert partner("chin") is None and partner("jaw left") == "jaw right"
    assert all(partner(str(partner(name))) == name for name in POINTS if partner(name))


def test_written_and_read_back(tmp_path):
    points = propose_points(photo(), [[150.0, 200.0], [250.0, 210.0]])
    write_points(tmp_path / "p.json", points, photo())
    again = read_points(tmp_path / "p.json", photo())
    assert again.missing == [] and list(again.places) == [name for name in POINTS if name in points.places]
    assert all(np.allclose(again.places[name], points.places[name], atol=5e-4) for name in POINTS)
    with pytest.raises(EvalkitError, match="belongs to another photo"):
        read_points(tmp_path / "p.json", photo((401, 500)))


def test_the_mean_face_lies_on_the_eyes():
    places = mean_face()
    # The person's right eye is on the left of the picture.
    assert np.allclose(0.5 * (places["eye inner right"] + places["eye outer right"]), [150, 200])
    assert np.allclose(0.5 * (places["eye inner left"] + places["eye outer left"]), [250, 210])
    assert places["chin"][1] > places["nose tip"][1] > places["nasion"][1]
    with pytest.raises(EvalkitError, match="eyes"):
        propose_points(photo(), [[150.0, 200.0], [150.0, 200.0]])


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"nose": [1, 2]}, "unknown point 'nose'"),
        ({"nose tip": None}, "missing: nose tip"),
        ({"nose tip": [-3.0, 20.0]}, "'nose tip' .* outside"),
        ({"nose tip": [float("nan"), 20.0]}, "'nose tip' is not a place"),
        ({"nose tip": [True, 20.0]}, "'nose tip' is not a place"),
        ({"nose tip": ["12", 20.0]}, "'nose tip' is not a place"),
        ({"nose tip": [1.0, 2.0, 3.0]}, "'nose tip' is not a place"),
        ({"nose tip": "chin"}, "'nose tip' and 'chin'|'chin' and 'nose tip'"),
        ({"eye inner left": "eye outer right", "eye outer right": "eye inner left"}, "exchanged"),
        ({"jaw left": "jaw right", "jaw right": "jaw left"}, "'jaw left' and 'jaw right' are exchanged"),
    ],
)
def test_points_that_cannot_be_are_named(change, match):
    places = mean_face()
    given = dict(places)
    for name, value in change.items():
        if value is None:
            del given[name]
        else:
            given[name] = places[value] if isinstance(value, str) else value
    with pytest.raises(EvalkitError, match=match) as caught:
        check_points(given, photo())
    assert "\n" not in str(caught.value)


def test_a_mirrored_face_is_refused():
    mirrored = {name: np.array([400.0 - x, y]) for name, (x, y) in mean_face().items()}
    with pytest.raises(EvalkitError, match="left and right are exchanged"):
        check_points(mirrored, photo())
    # Control: a face that is turned in the picture's plane is none that is mirrored.
    turned = {name: np.array([y, 400.0 - x]) for name, (x, y) in mean_face().items()}
    check_points(turned, photo((500, 400)))


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("{", "no valid JSON"),
        ("[]", "'points' is missing"),
        ('{"points": {"chin": [1, 2], "chin": [3, 4]}}', "'chin' is there twice"),
        ('{"points": {"chin": 4}}', "'chin' is not a place"),
        ('{"points": {}, "photo": 3}', "'photo' is not"),
    ],
)
def test_a_file_of_points_that_is_none(tmp_path, text, match):
    (tmp_path / "p.json").write_text(text)
    with pytest.raises(EvalkitError, match=match):
        read_points(tmp_path / "p.json")


# ---- detector -----------------------------------------------------------------------------------------------------


def test_weights_that_are_not_there(tmp_path, monkeypatch):
    monkeypatch.delenv("EVALKIT_LANDMARKER", raising=False)
    with pytest.raises(EvalkitError, match="no weights"):
        landmarker_weights(tmp_path / "x.task")
    (tmp_path / "y.task").write_bytes(b"x")
    monkeypatch.setenv("EVALKIT_LANDMARKER", str(tmp_path / "y.task"))
    assert landmarker_weights() == tmp_path / "y.task"


SURE = (
    "nasion", "nose tip", "subnasale", "upper lip", "lower lip", "chin", "eye inner left", "eye inner right",
    "eye outer left", "eye outer right", "mouth corner left", "mouth corner right",
)  # fmt: skip
LID_MARGINS = (
    263, 249, 390, 373, 374, 380, 381, 382, 362, 398, 384, 385, 386, 387, 388, 466,
    33, 7, 163, 144, 145, 153, 154, 155, 133, 173, 157, 158, 159, 160, 161, 246,
)  # fmt: skip
"""Vertices of the detector's mesh along the edges of both eyes."""


def test_numbers_of_the_detector_follow_from_its_canonical_face():
    lines = real_data("meshes", "mediapipe_canonical_face.obj").read_text().splitlines()
    mesh = 10.0 * np.array([[float(x) for x in line.split()[1:4]] for line in lines if line.startswith("v ")])
    landmarks = all_landmarks()
    source = mesh[[DETECTED[name] for name in SURE]]
    target = np.array([landmarks[name] for name in SURE])
    moved = source.mean(axis=0)
    close = aligned(source, target)
    # The same similarity for all vertices, from what it does to the sure ones.
    affine, *_ = np.linalg.lstsq(np.column_stack([source - moved, np.ones(len(source))]), close, rcond=None)
    whole = np.column_stack([mesh - moved, np.ones(len(mesh))]) @ affine
    warped = whole + RBFInterpolator(close, target - close, kernel="linear", degree=1)(whole)
    assert DETECTED["nose tip"] == mesh[:, 2].argmax()
    for name in set(LANDMARK_POINTS) - set(SURE):
        among = np.array(LID_MARGINS) if "lid" in name else np.arange(len(mesh))
        nearest = among[np.linalg.norm(warped[among] - landmarks[name], axis=1).argmin()]
        assert nearest == DETECTED[name], name


def test_points_file_is_plain_json(tmp_path):
    write_points(tmp_path / "p.json", propose_points(photo(), [[150.0, 200.0], [250.0, 210.0]]), photo())
    facts = json.loads((tmp_path / "p.json").read_text())
    assert facts["photo"] == {"file": "me.png", "width": 400, "height": 500, "sha256": "ab" * 32}
    assert len(facts["points"]["chin"]) == 2
