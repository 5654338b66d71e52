"""The face as it would be seen squarely from the front, whatever the head's pose is.

The frontal view is the parallel projection of the head along its z axis: x to the person's left, which is to the right
in the picture, y up, millimetres. A pixel of it gets its colour from where its place on the face stands in the frame.
For that every place needs a depth. The cylinder of Chai et al. (2003) gives one that is wrong by up to 25 mm at the tip
of the nose, which then moves by 25 mm times the sine of a turn in a face that does not move at all; the depths of the
mean face are wrong by what a person differs from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.places import all_landmarks
from evalkit.vision.camera import Camera
from evalkit.vision.initial import mean_cylinder
from evalkit.vision.points import FACE_POINTS, mean_face_points
from evalkit.vision.tracker import HeadPose, Picture

Map = NDArray[np.float32]

PIXEL_MM = 1.0
"""Side of a pixel of the frontal view: that of a 360 x 288 picture in which a face is half as high as the picture."""

MARGIN_MM = (26.0, 30.0, 60.0)
"""Of the view beyond the points: to the sides, above the brows, below the lower lip, where the jaw goes."""

SMOOTH = 1.0
"""Weight of smoothness in the surface through the mean face's landmarks: about 1 mm off each of them."""

DEPTHS = ("face", "cylinder")
"""What the depth of a place may be taken from."""


@dataclass(frozen=True, eq=False)
class FrontalView:
    """A frontal view of one person.

    Attributes
    ----------
    depth_mm : ndarray, shape (H, W)
        z of the middle of every pixel, in the head's axes.
    left_mm, top_mm : float
        x and y of the upper left corner.
    camera : Camera
    """

    depth_mm: Array
    left_mm: float
    top_mm: float
    camera: Camera

    @classmethod
    def of(
        cls, pose: HeadPose, camera: Camera, points_px: ArrayLike, depth: str = "face", origin_mm: float | None = None
    ) -> FrontalView:
        """The view of a person whose points are seen in one frame.

        Parameters
        ----------
        pose : HeadPose
            Of that frame.
        camera : Camera
        points_px : array_like, shape (19, 2)
        depth : {"face", "cylinder"}
            Depth of the mean face laid on the points, or the cylinder about the head's origin through them (as
            published).
        origin_mm : float, optional
            z of the head's origin in the axes of the mean face: which depth the pose speaks of cannot be seen in one
            picture. By default that of the trackers, the axis of the mean cylinder.

        Raises
        ------
        EvalkitError
            If the points do not fit a head in that pose.
        """
        if depth not in DEPTHS:
            raise EvalkitError(f"depth '{depth}' is not one of {', '.join(DEPTHS)}")
        names = all_landmarks()
        origin = mean_cylinder()[0][2] if origin_mm is None else origin_mm
        laid, scale, shift = _laid_on(np.asarray(points_px, dtype=np.float64), pose, camera, origin)
        across, above, below = MARGIN_MM
        left, right = laid[:, 0].min() - across, laid[:, 0].max() + across
        top, bottom = laid[:, 1].max() + above, laid[:, 1].min() - below
        columns, rows = (int(np.ceil(length / PIXEL_MM)) for length in (right - left, top - bottom))
        x = left + PIXEL_MM * (np.arange(columns) + 0.5)
        y = top - PIXEL_MM * (np.arange(rows) + 0.5)
        if depth == "face":
            surface = _surface(scale * np.array(list(names.values())) + shift, x, y)
        else:
            radius = float(np.median(np.hypot(laid[:, 0], laid[:, 2])))
            surface = np.broadcast_to(np.sqrt(np.maximum(radius**2 - x**2, (0.3 * radius) ** 2)), (rows, columns))
        return cls(np.ascontiguousarray(surface), float(left), float(top), camera)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.depth_mm.shape
        return rows, columns

    def warp(self, frame: Picture, pose: HeadPose) -> Map:
        """A frame seen from the front: grey levels, shape (H, W), rows from top to bottom.

        Where the frame ends, its edge goes on; what the head itself hides shows what hides it.
        """
        grey = frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        camera = self.camera
        # Of a larger picture every pixel of the view would read one pixel in many: noise and jagged edges.
        shrink = max(round(-camera.focal_px / pose.translation[2] * PIXEL_MM / 1.25), 1)
        if shrink > 1:
            grey = cv2.resize(grey, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA)
        rotation = pose.rotation.astype(np.float32)
        placed = rotation @ self._grid + pose.translation.astype(np.float32)[:, None]
        away = np.float32(camera.focal_px / shrink) / np.maximum(-placed[2], np.float32(1.0))
        u = placed[0] * away + np.float32(camera.centre_px[0] / shrink - 0.5)
        v = np.float32(camera.centre_px[1] / shrink - 0.5) - placed[1] * away
        warped = cv2.remap(
            grey, u.reshape(self.shape), v.reshape(self.shape), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(warped, dtype=np.float32)

    @property
    def _grid(self) -> Map:
        """The middles of all pixels in the head's axes, shape (3, H W)."""
        found = self.__dict__.get("_places")
        if found is None:
            rows, columns = self.shape
            x = self.left_mm + PIXEL_MM * (np.arange(columns) + 0.5)
            y = self.top_mm - PIXEL_MM * (np.arange(rows) + 0.5)
            xx, yy = np.meshgrid(x, y)
            found = np.stack([xx.ravel(), yy.ravel(), self.depth_mm.ravel()]).astype(np.float32)
            self.__dict__["_places"] = found
        return found

    def pixels(self, points_mm: ArrayLike) -> Array:
        """Columns and rows of places of the view, (..., 2), counted from the middle of the first pixel."""
        p = np.asarray(points_mm, dtype=np.float64)
        return np.stack(
            [(p[..., 0] - self.left_mm) / PIXEL_MM - 0.5, (self.top_mm - p[..., 1]) / PIXEL_MM - 0.5], axis=-1
        )

    def places(self, pixels: ArrayLike) -> Array:
        """Inverse of :meth:`pixels`, mm."""
        p = np.asarray(pixels, dtype=np.float64)
        return np.stack(
            [self.left_mm + PIXEL_MM * (p[..., 0] + 0.5), self.top_mm - PIXEL_MM * (p[..., 1] + 0.5)], axis=-1
        )

    def lifted(self, points_mm: ArrayLike) -> Array:
        """Places of the view with their depth, (N, 2) to (N, 3), mm; beyond the view, the depth of its edge."""
        p = np.asarray(points_mm, dtype=np.float64)
        at = self.pixels(p).astype(np.float32)
        z = cv2.remap(
            self.depth_mm.astype(np.float32), at[:, 0], at[:, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.concatenate([p, z.reshape(-1, 1)], axis=1)

    def to_picture(self, points_mm: ArrayLike, pose: HeadPose) -> Array:
        """Pixels of the frame at which places of the view stand; (N, 2) to (N, 2)."""
        return self.camera.project(self.lifted(points_mm) @ pose.rotation.T + pose.translation)

    def from_picture(self, points_px: ArrayLike, pose: HeadPose) -> Array:
        """Places of the view, mm, of pixels of the frame; inverse of :meth:`to_picture` on the visible side."""
        wanted = np.asarray(points_px, dtype=np.float64)
        sight = _sight(wanted, self.camera) @ pose.rotation
        eye = -pose.translation @ pose.rotation
        depth = np.full(len(wanted), float(self.depth_mm.mean()))
        # Half the way each time: on skin that slopes as much as the line of sight, whole steps would go to and fro.
        for _ in range(30):
            place = eye + (depth - eye[2])[:, None] / sight[:, 2:] * sight
            depth = 0.5 * (depth + self.lifted(place[:, :2])[:, 2])
        return place[:, :2]

    def normals(self, points_mm: ArrayLike) -> Array:
        """Directions in which the skin faces at places of the view, in the head's axes; (N, 2) to (N, 3)."""
        p = np.asarray(points_mm, dtype=np.float64)
        # Over about the width of a patch: the skin there is what must be seen.
        steps = 6.0 * np.eye(2)
        slope = [(self.lifted(p + step)[:, 2] - self.lifted(p - step)[:, 2]) / 12.0 for step in steps]
        normals = np.stack([-slope[0], -slope[1], np.ones(len(p))], axis=1)
        return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def _sight(points_px: Array, camera: Camera) -> Array:
    """Directions (N, 3), in the camera's axes, in which pixels are seen."""
    x = (points_px[:, 0] - camera.centre_px[0]) / camera.focal_px
    y = (camera.centre_px[1] - points_px[:, 1]) / camera.focal_px
    return np.stack([x, y, -np.ones(len(x))], axis=1)


def _laid_on(points_px: Array, pose: HeadPose, camera: Camera, origin_mm: float) -> tuple[Array, float, Array]:
    """The mean face's points (19, 3) in the head's axes so that they are seen at the pixels; its scale and shift."""
    origin = np.array([0.0, 0.0, origin_mm])
    mean = mean_face_points() - origin
    if points_px.shape != (len(FACE_POINTS), 2) or not np.isfinite(points_px).all():
        raise EvalkitError(f"points of the first frame have shape {points_px.shape}; expected 19 finite places (19, 2)")
    sight = _sight(points_px, camera)
    # A point at distance d along its line of sight: x = -z sight_x, so that each gives two linear equations.
    across = np.stack([np.array([[1, 0, s[0]], [0, 1, s[1]]]) for s in sight])
    turned = np.einsum("pij,jk->pik", across, pose.rotation)
    columns = np.concatenate([np.einsum("pij,pj->pi", turned, mean)[..., None], turned[:, :, :2]], axis=2)
    wanted = -across @ pose.translation
    (scale, *shift), *_ = np.linalg.lstsq(columns.reshape(-1, 3), wanted.ravel())
    if not 0.4 < scale < 2.5:
        raise EvalkitError(f"points of the first frame: a face {scale:.2f} times as large as the mean one is no head's")
    moved = np.array([*shift, 0.0])
    return scale * mean + moved, float(scale), moved - scale * origin


def _surface(places: Array, x: Array, y: Array) -> Array:
    """Depth over x and y of the thin-plate spline through places (N, 3)."""
    from scipy.interpolate import RBFInterpolator

    spline = RBFInterpolator(places[:, :2], places[:, 2], kernel="thin_plate_spline", smoothing=SMOOTH)
    xx, yy = np.meshgrid(x, y)
    return np.asarray(spline(np.stack([xx.ravel(), yy.ravel()], axis=1)).reshape(xx.shape))
