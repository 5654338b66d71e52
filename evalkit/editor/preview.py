"""The fitted head as pictures that turn and open the mouth, drawn offscreen."""

from __future__ import annotations

import io

import numpy as np

from evalkit.geometry import rotation_from_vector
from evalkit.head.fit_report import FitReport
from evalkit.head.fitting import fit_head
from evalkit.head.model import Head
from evalkit.head.photo import Photo
from evalkit.head.points import Points
from evalkit.render.head_scene import HeadScene
from evalkit.render.head_views import View, posed

SIZE = 420
"""Pixels of the picture."""

JAW_DEG = 18.0
"""Of the mouth wide open."""


class Preview:
    """A head fitted to a photo as long as its points change; call it from one thread only, as OpenGL asks."""

    def __init__(self, photo: Photo, generic: Head) -> None:
        self.photo, self.generic = photo, generic
        self.head: Head | None = None
        self.report: FitReport | None = None
        self._scene: HeadScene | None = None

    def fit(self, points: Points) -> FitReport:
        """Fit the head anew.

        Raises
        ------
        EvalkitError
            As :func:`evalkit.head.fitting.fit_head`; the head fitted before stays.
        """
        head, report = fit_head(self.photo, points, self.generic)
        # The plate is as large as the photo: only what is around the skin is shown.
        skin = np.ptp(head.vertices[head.skin_vertices], axis=0)[:2].max()
        whole = round(SIZE * max(1.0, float(np.ptp(head.vertices, axis=0)[:2].max() / (1.25 * skin))))
        scene = HeadScene(head, (whole, whole), multisamples=4)
        self.close()
        self.head, self.report, self._scene = head, report, scene
        return report

    def picture(self, yaw_deg: float = 0.0, mouth: float = 0.0) -> bytes:
        """PNG of the head turned to its left by an angle, its mouth open from 0 to 1."""
        from PIL import Image

        if self.head is None or self._scene is None:
            raise LookupError("nothing is fitted yet")
        vertices = posed(self.head, View(jaw_deg=JAW_DEG * mouth))
        middle = 0.5 * (self.head.vertices.min(axis=0) + self.head.vertices.max(axis=0))
        rotation = rotation_from_vector(np.deg2rad([0.0, yaw_deg, 0.0]))
        self._scene.pose(rotation, middle - rotation @ middle)
        file = io.BytesIO()
        picture = self._scene.frame(vertices)
        edge = (len(picture) - SIZE) // 2
        picture = np.ascontiguousarray(picture[edge : edge + SIZE, edge : edge + SIZE])
        Image.fromarray(picture).save(file, "png", compress_level=1)
        return file.getvalue()

    def close(self) -> None:
        """Give the scene's memory back."""
        if self._scene is not None:
            self._scene.close()
            self._scene = None
