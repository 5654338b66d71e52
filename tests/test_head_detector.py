"""What a face detector makes of the built-in head, beside a relief-free ellipsoid with the same texture.

Views, the detector's landmark for each of ours, the definition of the error and the limits were fixed before the
detector was run on this head for the first time. That run failed on one point of its own making: nose tip was
compared with number 1 of the detector's mesh (8.7 % in the mean, 10.3 % at most; chin 1.7 % and 2.6 %), but number 1
lies below the tip: the most forward vertex of the detector's canonical face is number 4, which is what a nose tip
is here. With that assignment, and with views that had not been looked at before, the test was run again; nothing
else was changed: nose tip 2.0 % in the mean and 3.1 % at most, chin 1.9 % and 2.8 %. Since then the nostrils were
given openings, for their look and not for the detector (2.2 % and 3.9 %; 1.9 % and 2.9 %).
None of the views is among those that the head was judged by while it was made.

That a detector finds a face says little: it finds one on the ellipsoid, too. Only the places of nose tip and chin
depend on the relief.
"""

from __future__ import annotations

import numpy as np
import pytest
from realdata import real_data
from test_head import ellipsoid, template

from evalkit.errors import EvalkitError
from evalkit.head import Head, detector
from evalkit.render.head_views import BACKGROUND, View, draw_head
from evalkit.render.offscreen import offscreen_plotter, require_offscreen

VIEWS = [View(yaw_deg=yaw, pitch_deg=pitch) for yaw, pitch in (
    (-24.0, -3.0), (-19.0, 8.0), (-12.0, -11.0), (-6.0, 5.0), (3.0, -8.0), (9.0, 12.0), (16.0, -5.0), (21.0, 6.0),
)]  # fmt: skip

PIXELS = 512

DETECTED = {
    name: detector.DETECTED[name]
    for name in (
        "nose tip", "chin", "subnasale", "upper lip", "lower lip", "eye outer left", "eye outer right",
        "eye inner left", "eye inner right", "mouth corner left", "mouth corner right",
    )
}  # fmt: skip
"""Landmark -> number in the detector's mesh."""

CONFIDENCE = 0.8

LIMIT_PERCENT = 6.0
"""For nose tip and chin. About 5 mm; a relief-free ellipsoid was off by 11 % and 29 % in an earlier trial."""


def pictures(head: Head) -> tuple[list[np.ndarray], list[dict[str, np.ndarray]], float]:
    """Pictures of a head, the pixels of its landmarks in each, and the outer eye corners' distance in pixels.

    The distance is that in a picture straight from the front.
    """
    images, places = [], []
    for view in [View(), *VIEWS]:
        with offscreen_plotter(PIXELS, PIXELS) as plotter:
            plotter.set_background(BACKGROUND)
            draw_head(plotter, head, view)
            images.append(np.array(plotter.screenshot(None, return_img=True)))
            seen = {}
            for name in DETECTED:
                plotter.renderer.SetWorldPoint(*head.landmarks[name], 1.0)
                plotter.renderer.WorldToDisplay()
                x, y, _ = plotter.renderer.GetDisplayPoint()
                seen[name] = np.array([x, PIXELS - y])
            places.append(seen)
    eyes = np.linalg.norm(places[0]["eye outer left"] - places[0]["eye outer right"])
    return images[1:], places[1:], float(eyes)


def errors_percent(head: Head) -> tuple[int, dict[str, np.ndarray]]:
    """Views in which a face is found, and per landmark the errors in % of the outer eye corners' distance."""
    mediapipe = pytest.importorskip("mediapipe", reason="pip install evalkit[vision]")
    vision = mediapipe.tasks.vision
    options = vision.FaceLandmarkerOptions(
        base_options=mediapipe.tasks.BaseOptions(model_asset_path=str(real_data("models", "face_landmarker_v2.task"))),
        min_face_detection_confidence=CONFIDENCE,
        min_face_presence_confidence=CONFIDENCE,
    )
    images, places, eyes = pictures(head)
    found, errors = 0, {name: [] for name in DETECTED}
    with vision.FaceLandmarker.create_from_options(options) as detector:
        for image, seen in zip(images, places, strict=True):
            result = detector.detect(
                mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=np.ascontiguousarray(image[..., :3]))
            )
            if not result.face_landmarks:
                continue
            found += 1
            for name, number in DETECTED.items():
                point = result.face_landmarks[0][number]
                place = np.array([point.x, point.y]) * PIXELS
                errors[name].append(100.0 * np.linalg.norm(place - seen[name]) / eyes)
    return found, {name: np.array(values) for name, values in errors.items()}


@pytest.fixture(scope="module")
def drawing() -> None:
    pytest.importorskip("mediapipe", reason="pip install evalkit[vision]")
    try:
        require_offscreen()
    except EvalkitError as error:
        pytest.skip(str(error))


def report(title: str, found: int, errors: dict[str, np.ndarray]) -> None:
    print(f"\n{title}: found in {found} of {len(VIEWS)} views at confidence {CONFIDENCE}; error, % (mean, max)")
    for name, values in errors.items():
        if len(values):
            print(f"  {name:<20}{values.mean():5.1f}{values.max():6.1f}")


def passes(found: int, errors: dict[str, np.ndarray]) -> bool:
    """Found everywhere, nose tip and chin within the limit in every view."""
    return found == len(VIEWS) and max(errors["nose tip"].max(), errors["chin"].max()) <= LIMIT_PERCENT


def test_nose_tip_and_chin_are_where_the_detector_sees_them(drawing):
    found, errors = errors_percent(template())
    report("template", found, errors)
    assert passes(found, errors)


def test_control_the_ellipsoid_fails(drawing):
    found, errors = errors_percent(ellipsoid())
    report("ellipsoid", found, errors)
    assert not passes(found, errors)
