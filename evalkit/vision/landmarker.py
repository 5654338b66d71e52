"""Baseline: MediaPipe's face landmarker, a trained network, asked anew about every frame.

Its rotation is that of the facial transformation matrix, the rigid fit of its canonical face to the landmarks that the
network finds; it assumes a camera of its own. The translation is made here from the landmarks for the camera given.
"""

from __future__ import annotations

import weakref
from contextlib import ExitStack

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.detector import DETECTED, Face, landmarker
from evalkit.vision.camera import Camera
from evalkit.vision.initial import mean_cylinder
from evalkit.vision.points import face_points, mean_face_points
from evalkit.vision.tracker import LOST, HeadPose, Picture, TrackStatus


class LandmarkerTracker:
    """See the module. The 19 points of the first frame only tell which face is meant."""

    def start(self, frame: Picture, camera: Camera, points_px: Array) -> HeadPose:
        """Begin with a frame; see :class:`evalkit.vision.tracker.HeadTracker`.

        Raises
        ------
        EvalkitError
            If MediaPipe or its weights are missing.
        """
        with ExitStack() as stack:
            self._detect = stack.enter_context(landmarker())
            # The network is given back when the tracker is gone: its interface knows no end.
            weakref.finalize(self, stack.pop_all().close)
        self._camera = camera
        self._at = np.asarray(points_px, dtype=np.float64).mean(axis=0)
        return self.step(frame)

    def step(self, frame: Picture) -> HeadPose:
        """Pose of the face that is nearest to where it was."""
        colour = np.repeat(frame[..., None], 3, axis=2) if frame.ndim == 2 else frame[..., ::-1]
        faces: list[Face] = self._detect(colour)
        if not faces:
            return LOST
        seen = [face_points({name: face.landmarks[k, :2] for name, k in DETECTED.items()}) for face in faces]
        nearest = int(np.argmin([np.linalg.norm(points.mean(axis=0) - self._at) for points in seen]))
        self._at = seen[nearest].mean(axis=0)
        rotation = np.asarray(faces[nearest].rotation, dtype=np.float64)
        translation = placed(rotation, mean_face_points() - mean_cylinder()[0], seen[nearest], self._camera)
        if not np.isfinite(rotation).all() or translation[2] >= 0:
            return LOST
        return HeadPose(rotation, translation, TrackStatus.TRACKED, 1.0)


def placed(rotation: Array, points_mm: Array, points_px: Array, camera: Camera) -> Array:
    """Translation (3,), mm, that brings points of a turned head (N, 3) nearest to their pixels (N, 2).

    Linear least squares of ``x' (R p + T)_z + f (R p + T)_x = 0`` with x' from the principal point, and the same of y.

    Raises
    ------
    EvalkitError
        If the shapes differ.
    """
    if len(points_mm) != len(points_px):
        raise EvalkitError(f"{len(points_mm)} points of the head and {len(points_px)} of the picture")
    turned = points_mm @ rotation.T
    across = (points_px - np.array(camera.centre_px)) * [1.0, -1.0]
    f, count = camera.focal_px, len(turned)
    rows = np.zeros((count, 2, 3))
    rows[:, 0, 0] = rows[:, 1, 1] = f
    rows[:, :, 2] = across
    right = -(across * turned[:, 2:] + f * turned[:, :2])
    return np.asarray(np.linalg.lstsq(rows.reshape(-1, 3), right.ravel(), rcond=None)[0])
