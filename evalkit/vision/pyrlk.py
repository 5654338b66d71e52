"""Baseline: corners of the face followed from frame to frame by optical flow, and the pose of a rigid face from them.

Pyramidal Lucas-Kanade (Bouguet 2001; Lucas & Kanade 1981) on the 19 points and on further corners (Shi & Tomasi 1994,
doi:10.1109/CVPR.1994.323794), each checked by following it back (Kalal et al. 2010, doi:10.1109/ICPR.2010.675), and
perspective n points with RANSAC (Fischler & Bolles 1981, doi:10.1145/358669.358692). Depths are those of the mean face:
there is no texture, no light model and no memory but the first frame.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.places import all_landmarks
from evalkit.vision.camera import Camera
from evalkit.vision.initial import mean_cylinder
from evalkit.vision.points import mean_face_points
from evalkit.vision.tracker import LOST, HeadPose, Picture, TrackStatus

CORNERS = 80
"""Corners that are looked for beside the 19 points."""

APART_SHARE = 0.03
"""Distance of two corners, relative to the width of the face."""

WINDOW = (15, 15)
LEVELS = 3
BACK_PX = 1.0
"""A point that comes back so far from where it was is lost."""

MISS_PX = 3.0
"""Distance of an inlier from the projection of the rigid face."""

FEWEST = 8
"""Inliers under which there is no pose: six are the least that PnP takes, and two must agree with them."""

FIRM_SHARE = 0.5
"""Share of inliers under which a pose is weak."""

TO_CAMERA = np.diag([1.0, -1.0, -1.0])
"""From OpenCV's axes of the camera (y down, z away) to ours, and back."""


class PyrLkTracker:
    """See the module."""

    def start(self, frame: Picture, camera: Camera, points_px: Array) -> HeadPose:
        """Begin with a frame; see :class:`evalkit.vision.tracker.HeadTracker`."""
        pixels = np.asarray(points_px, dtype=np.float64)
        if pixels.shape != (19, 2) or not np.isfinite(pixels).all():
            raise EvalkitError(f"19 finite points are needed, not an array of shape {pixels.shape}")
        self._matrix = camera.matrix
        # OpenCV counts from the middle of the first pixel.
        clicked = pixels - 0.5
        found: Any
        turn: Any
        shift: Any
        found, turn, shift = cv2.solvePnP(
            mean_face_points() @ TO_CAMERA, clicked, self._matrix, None, flags=cv2.SOLVEPNP_SQPNP
        )
        if not found or shift[2, 0] <= 0:
            raise EvalkitError("no face has the 19 points like this")
        rotation, centre = _turned(turn), np.asarray(shift, dtype=np.float64).ravel()
        picture = _grey(frame)
        corners = self._corners(picture, clicked)
        self._places = np.concatenate([clicked, corners]).astype(np.float32)
        self._model = self._lifted(rotation, centre)
        self._first = (picture, self._places.copy())
        self._last, self._pose = picture, (turn, shift)
        self._lost = False
        return self._answer(rotation, centre, 1.0)

    def _corners(self, picture: NDArray[np.uint8], clicked: Array) -> Array:
        """Corners within the outline of the points, widened by a tenth."""
        middle = clicked.mean(axis=0)
        outline = cv2.convexHull((middle + 1.1 * (clicked - middle)).astype(np.float32))
        mask = np.zeros_like(picture)
        cv2.fillConvexPoly(mask, np.rint(outline).astype(np.int32), 255)
        apart = max(APART_SHARE * float(np.ptp(clicked[:, 0])), 2.0)
        found: Any = cv2.goodFeaturesToTrack(picture, CORNERS, 0.01, apart, mask=mask)
        return np.zeros((0, 2)) if found is None else np.asarray(found, dtype=np.float64).reshape(-1, 2)

    def _lifted(self, rotation: Array, centre: Array) -> NDArray[np.float32]:
        """Places of the points on the mean face, (N, 3), in its own axes: on their rays, at its depths."""
        from scipy.interpolate import RBFInterpolator

        face = np.array(list(all_landmarks().values())) @ TO_CAMERA @ rotation.T + centre
        seen = face[:, :2] / face[:, 2:]
        rays = (self._places - self._matrix[:2, 2]) / self._matrix[[0, 1], [0, 1]]
        # Smoothed a little: landmarks are few, and a spline through all of them would be steep beside the nose.
        depth = RBFInterpolator(seen, face[:, 2], kernel="thin_plate_spline", smoothing=1e-4)(rays)
        placed = np.column_stack([rays, np.ones(len(rays))]) * depth[:, None]
        return np.asarray((placed - centre) @ rotation, dtype=np.float32)

    def step(self, frame: Picture) -> HeadPose:
        """Pose of the next frame; once lost, the first frame's points are looked for where they were last."""
        picture = _grey(frame)
        old, places = self._first if self._lost else (self._last, self._places)
        guess = self._places if self._lost else None
        moved, good = _followed(old, picture, places, guess)
        self._last = picture
        if good.sum() < FEWEST:
            return self._gone()
        found, turn, shift, inliers = cv2.solvePnPRansac(
            self._model[good], moved[good], self._matrix, None, self._pose[0].copy(), self._pose[1].copy(),
            useExtrinsicGuess=True, reprojectionError=MISS_PX, iterationsCount=100,
        )  # fmt: skip
        count = 0 if inliers is None else len(inliers)
        share = count / len(self._model)
        # A face that is found again must be whole, or any few points of the room would do.
        if not found or count < FEWEST or shift[2, 0] <= 0 or (self._lost and share < FIRM_SHARE):
            return self._gone()
        chosen = np.flatnonzero(good)[inliers.ravel()]
        turn, shift = cv2.solvePnPRefineLM(self._model[chosen], moved[chosen], self._matrix, None, turn, shift)
        # Points that were lost go on from where the rigid face has them.
        projected: Any = cv2.projectPoints(self._model, turn, shift, self._matrix, None)[0]
        self._places = projected.reshape(-1, 2).astype(np.float32)
        self._places[chosen] = moved[chosen]
        self._pose, self._lost = (turn, shift), False
        return self._answer(_turned(turn), np.asarray(shift, dtype=np.float64).ravel(), share)

    def _gone(self) -> HeadPose:
        self._lost = True
        return LOST

    def _answer(self, rotation: Array, centre: Array, share: float) -> HeadPose:
        status = TrackStatus.TRACKED if share >= FIRM_SHARE else TrackStatus.WEAK
        turned = TO_CAMERA @ rotation @ TO_CAMERA
        return HeadPose(turned, TO_CAMERA @ centre + turned @ mean_cylinder()[0], status, float(share))


def _followed(
    old: NDArray[np.uint8], new: NDArray[np.uint8], places: NDArray[np.float32], guess: NDArray[np.float32] | None
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Where points of one picture are in another, and which of them come back to where they were."""
    options: dict[str, Any] = {"winSize": WINDOW, "maxLevel": LEVELS}
    begin: Any = None if guess is None else guess.astype(np.float32).copy()
    moved: Any
    flags = 0 if guess is None else cv2.OPTFLOW_USE_INITIAL_FLOW
    moved, there, _ = cv2.calcOpticalFlowPyrLK(old, new, places, begin, flags=flags, **options)
    back, again, _ = cv2.calcOpticalFlowPyrLK(
        new, old, moved, places.copy(), flags=cv2.OPTFLOW_USE_INITIAL_FLOW, **options
    )
    apart = np.linalg.norm(back - places, axis=1)
    return moved, there.ravel().astype(bool) & again.ravel().astype(bool) & (apart < BACK_PX)


def _turned(turn: Any) -> Array:
    """The rotation matrix of a rotation vector."""
    return np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64)


def _grey(frame: Picture) -> NDArray[np.uint8]:
    return frame if frame.ndim == 2 else np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
