"""The camera that filmed a face: a pinhole, in the axes of the person.

Axes have their origin in the camera: x to the person's left, which is to the right in the picture, y up, z from the
head towards the camera. The camera looks along -z, so that what it sees has a negative z, and a head that faces it
squarely has the rotation I. Pixels have their origin at the upper left corner of the first pixel, whose middle is
(0.5, 0.5); x to the right, y down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import EvalkitError
from evalkit.geometry import Array

ASSUMED_VIEW_DEG = 50.0
"""Field of view of the longer side of the picture where nothing is known: webcams and phones have 45 to 65 degrees."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with square pixels and no distortion.

    Attributes
    ----------
    width, height : int, pixels
    focal_px : float
        Focal length, pixels.
    centre_px : (float, float)
        Principal point, pixels.
    assumed : bool
        Whether the focal length is a guess. Distances to the head are then as wrong as the guess is; rotations are
        hardly touched.
    """

    width: int
    height: int
    focal_px: float
    centre_px: tuple[float, float]
    assumed: bool = False

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise EvalkitError(f"camera: {self.width} x {self.height} pixels make no picture")
        if not (math.isfinite(self.focal_px) and self.focal_px > 0 and np.isfinite(self.centre_px).all()):
            raise EvalkitError(
                f"camera: focal length {self.focal_px} and centre {self.centre_px} must be finite pixels, the first > 0"
            )

    @classmethod
    def assumed_for(cls, width: int, height: int, view_deg: float = ASSUMED_VIEW_DEG) -> Camera:
        """A camera with its principal point in the middle and a given field of view.

        Parameters
        ----------
        width, height : int, pixels
        view_deg : float
            Angle between the ends of the longer side of the picture.

        Raises
        ------
        EvalkitError
            If the angle is not between 1 and 170 degrees.
        """
        if not 1.0 <= view_deg <= 170.0:
            raise EvalkitError(f"camera: a field of view of {view_deg} degrees is not between 1 and 170")
        focal_px = 0.5 * max(width, height) / math.tan(math.radians(0.5 * view_deg))
        return cls(width, height, focal_px, (0.5 * width, 0.5 * height), assumed=True)

    def project(self, points_mm: ArrayLike) -> Array:
        """Pixels of points in the camera's axes; (..., 3) to (..., 2). NaN for points not in front of the camera."""
        p = np.asarray(points_mm, dtype=np.float64)
        depth = np.where(p[..., 2] < 0, -p[..., 2], np.nan)
        return np.stack(
            [
                self.centre_px[0] + self.focal_px * p[..., 0] / depth,
                self.centre_px[1] - self.focal_px * p[..., 1] / depth,
            ],
            axis=-1,
        )

    @property
    def matrix(self) -> Array:
        """Intrinsic matrix (3, 3) as OpenCV wants it: y down, z away from the camera, pixel middles at integers."""
        (x, y), f = self.centre_px, self.focal_px
        return np.array([[f, 0.0, x - 0.5], [0.0, f, y - 0.5], [0.0, 0.0, 1.0]])
