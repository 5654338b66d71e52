"""First pose and cylinder out of the 19 points of one frame.

One picture cannot tell depth. The mean face's depths stand in: the pose is the one that brings the mean face, made
longer or shorter and deeper or flatter within what people differ by, nearest to the points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.optimize import least_squares

from evalkit.errors import EvalkitError
from evalkit.geometry import Array, rotation_from_vector
from evalkit.head.places import all_landmarks
from evalkit.vision.camera import Camera
from evalkit.vision.points import FACE_POINTS, mean_face_points
from evalkit.vision.surface import FINEST, HALF_ANGLE_DEG, Surface

SCATTER_MM = 2.5
"""How far a rigid point of a person lies from the mean face's, once that is stretched."""

LOOSE = {"upper lid": 1.5, "lower lid": 1.5, "brow": 2.0, "lip": 3.0, "mouth corner": 2.0}
"""Points that an expression moves scatter more, by these factors."""

NOD_SD_DEG = 6.0
"""Standard deviation of the first frame's nod: people look about at the camera. A long or short face, or a nose that
points down, cannot be told from a nod by the points alone; this decides."""

STRETCH_SD = 0.06
"""Standard deviation of a person's height and depth of face relative to its width, as a fraction."""

ABOVE_MM, BELOW_MM = 75.0, 95.0
"""How far the texture reaches above and below the middle of the mean face: from the hairline to the chin."""

SMOOTHING = 500.0
"""Of the mean face's depths: the rounding of forehead and chin stays, the nose becomes a hill. A sharp nose would have
to lie exactly on the person's, and takes a cheek out of sight at every turn."""

MOST_SCATTER = 12.0
"""Points that miss the fitted mean face by more than this many times their scatter, in the mean, are no face."""


@dataclass(frozen=True, eq=False)
class Start:
    """Where tracking starts.

    Attributes
    ----------
    rotation, translation : ndarray, shape (3, 3) and (3,), mm
    surface : Surface
        The cylinder.
    points_mm : ndarray, shape (19, 3)
        The stretched mean face in the head's axes, for those who want depths.
    stretch : ndarray, shape (3,)
        Of the mean face along x, y, z.
    """

    rotation: Array
    translation: Array
    surface: Surface
    points_mm: Array
    stretch: Array


@cache
def mean_cylinder() -> tuple[Array, float]:
    """Origin on the axis (3,) and radius of the cylinder nearest to the mean face's landmarks, mm.

    All landmarks but those of the nose, which stands out of any cylinder; least squares of the distances from the
    cylinder. Its origin is at the mean height of the 19 points.
    """
    places = np.array([place for name, place in all_landmarks().items() if "nose" not in name])
    found = least_squares(lambda q: np.hypot(places[:, 0], places[:, 2] - q[0]) - q[1], [30.0, 70.0])
    return np.array([0.0, mean_face_points()[:, 1].mean(), found.x[0]]), float(found.x[1])


def mean_face_surface(stretch: Array) -> Surface:
    """Depths of the mean face's landmarks, spread smoothly over angle and height, in the head's axes.

    A smoothing thin-plate spline of the landmarks' distance from the axis, minus the radius of the cylinder. Beyond
    the landmarks the cylinder goes on.
    """
    origin, radius = mean_cylinder()
    places = (np.array(list(all_landmarks().values())) - origin) * stretch
    top, bottom = ABOVE_MM * stretch[1], -BELOW_MM * stretch[1]
    angle, excess = np.arctan2(places[:, 0], places[:, 2]), np.hypot(places[:, 0], places[:, 2]) - radius
    # Where there are no landmarks: the sides beyond the ears and the scalp above the forehead.
    sides = [(side * np.radians(HALF_ANGLE_DEG), height) for side in (-1, 1) for height in (bottom, 0.0, top)]
    at = np.vstack([np.stack([angle * radius, places[:, 1]], axis=1), [(a * radius, y) for a, y in sides]])
    spline = RBFInterpolator(at, np.concatenate([excess, np.zeros(len(sides))]), smoothing=SMOOTHING)
    part = np.linspace(0.0, 1.0, FINEST + 1)
    column, row = np.meshgrid(np.radians(HALF_ANGLE_DEG) * (2 * part - 1) * radius, top + (bottom - top) * part)
    grown = spline(np.stack([column.ravel(), row.ravel()], axis=1)).reshape(column.shape)
    return Surface(radius + np.clip(grown, -0.3 * radius, 0.3 * radius), float(top), float(bottom))


def start_from_points(points_px: Array, camera: Camera) -> Start:
    """Pose, and the cylinder's radius and height, from the 19 points of one frame.

    Parameters
    ----------
    points_px : ndarray, shape (19, 2)
        In the order of :data:`evalkit.vision.points.FACE_POINTS`.
    camera : Camera

    Raises
    ------
    EvalkitError
        If a point is not finite, left and right are exchanged, or no face has its points there.
    """
    pixels = np.asarray(points_px, dtype=np.float64)
    if pixels.shape != (len(FACE_POINTS), 2):
        raise EvalkitError(f"{len(FACE_POINTS)} points of two numbers are needed, not an array of shape {pixels.shape}")
    for name, pixel in zip(FACE_POINTS, pixels, strict=True):
        if not np.isfinite(pixel).all():
            raise EvalkitError(f"point '{name}' has no place in the first frame")
    origin, radius = mean_cylinder()
    mean = mean_face_points() - origin
    scatter = np.array([max((f for part, f in LOOSE.items() if part in name), default=1.0) for name in FACE_POINTS])
    left = np.array([name.endswith("left") for name in FACE_POINTS])
    right = np.array([name.endswith("right") for name in FACE_POINTS])
    across = pixels[left].mean(axis=0) - pixels[right].mean(axis=0)
    width_mm = 2.0 * mean[left, 0].mean()
    width_px = float(np.linalg.norm(across))
    if width_px < 4.0:
        raise EvalkitError("the points lie within a few pixels of each other: the face is too small to be tracked")
    depth = camera.focal_px * width_mm / width_px
    middle = pixels.mean(axis=0)
    first = np.zeros(8)
    # In the picture y goes down; a face whose left is on the left of the picture stands on its head or is mirrored.
    first[2] = -np.arctan2(across[1], across[0])
    first[3:6] = [
        (middle[0] - camera.centre_px[0]) * depth / camera.focal_px,
        (camera.centre_px[1] - middle[1]) * depth / camera.focal_px,
        -depth - mean[:, 2].mean(),
    ]

    def shape(x: Array) -> Array:
        return mean * [1.0, np.exp(x[6]), np.exp(x[7])]

    def misses(x: Array) -> Array:
        rotation = rotation_from_vector(x[:3])
        placed = shape(x) @ rotation.T + x[3:6]
        z = np.minimum(placed[:, 2:], -1.0)
        seen = np.array(camera.centre_px) + camera.focal_px * placed[:, :2] * [-1.0, 1.0] / z
        # Pixels as mm at the face.
        apart = (seen - pixels) * (depth / camera.focal_px) / (SCATTER_MM * scatter[:, None])
        nod = np.arcsin(rotation[1, 2])
        return np.concatenate([apart.ravel(), [nod / np.radians(NOD_SD_DEG)], x[6:] / STRETCH_SD])

    found = least_squares(misses, first, loss="soft_l1", x_scale=[0.1, 0.1, 0.1, 5.0, 5.0, 20.0, 0.05, 0.05])
    x = found.x
    apart = misses(x)[: pixels.size]
    rotation = rotation_from_vector(x[:3])
    if float(np.sqrt((apart**2).mean())) > MOST_SCATTER or rotation[2, 2] < 0.2 or x[5] > -1.0:
        raise EvalkitError(
            "no face has the 19 points like this; left and right are the person's, whose left eye is on the right of "
            "the picture, and pixels count from the upper left corner"
        )
    stretch = np.array([1.0, np.exp(x[6]), np.exp(x[7])])
    # A deeper face on the same width lies on a narrower cylinder; the width of the head says no more than the points.
    surface = Surface.cylinder(radius, ABOVE_MM * stretch[1], -BELOW_MM * stretch[1])
    return Start(rotation, x[3:6], surface, shape(x), stretch)
