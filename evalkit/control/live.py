"""A face before a camera moves the markers of a database, frame by frame."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from evalkit.control.database import Database
from evalkit.control.signal_windows import SignalStatus
from evalkit.control.signals import neutral_of_first, usable
from evalkit.control.stream import VIDEO, Control, ControlFrame, Settings
from evalkit.geometry import Array
from evalkit.vision.camera import Camera
from evalkit.vision.features import FeatureTracker
from evalkit.vision.parameters import NAMES, control_parameters, eye_distance, normalise
from evalkit.vision.threads import one_thread
from evalkit.vision.tracker import HeadPose, HeadTracker, Picture
from evalkit.vision.trackers import DEFAULT, trackers


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """What is known of a frame of the camera once it comes out.

    Attributes
    ----------
    frame : int
        From 0, the one with the points.
    displacements : ndarray, shape (M, 3), mm
        Of the database's markers.
    status : SignalStatus
    pose : HeadPose
    """

    frame: int
    displacements: Array
    status: SignalStatus
    pose: HeadPose


class LiveControl:
    """Tracker, points, parameters, filter and synthesis in a row; one frame in, one out, some frames later.

    Parameters
    ----------
    database : Database
    camera : Camera
    rate_hz : float
        Of the frames.
    frame : ndarray of uint8, shape (H, W, 3) or (H, W)
        The first one, blue, green, red; the face in it is at rest.
    points_px : array_like, shape (19, 2)
        The points in it.
    settings : Settings, optional
        By default :data:`evalkit.control.stream.VIDEO`.
    tracker : HeadTracker, optional

    Attributes
    ----------
    latency : int
        Frames by which the answer is later.
    first : LiveFrame or None
        The answer of the first frame, if the latency is 0.

    Raises
    ------
    EvalkitError
        If the points fit no face, or the database does not know enough of what they give.
    """

    def __init__(
        self, database: Database, camera: Camera, rate_hz: float, frame: Picture, points_px: ArrayLike,
        settings: Settings | None = None, tracker: HeadTracker | None = None,
    ) -> None:  # fmt: skip
        points = np.asarray(points_px, dtype=np.float64)
        self._tracker = tracker or trackers[DEFAULT].build()
        self._features = FeatureTracker(camera)
        pose = self._tracker.start(frame, camera, points)
        frontal, _ = self._features.start(frame, pose, points)
        self._unit = float(eye_distance(frontal))
        first = control_parameters(frontal[None], self._unit)
        self._neutral, self._spread = usable(neutral_of_first(first)), database.spread
        given = [name for name, value in zip(NAMES, self._neutral, strict=True) if np.isfinite(value)]
        self._control = Control(database, rate_hz, settings or VIDEO, given)
        self.latency = self._control.layout.latency
        self._poses = deque([pose])
        out = self._control.step(normalise(first, self._neutral, self._spread)[0])
        self.first = None if out is None else self._with_pose(out)

    def step(self, frame: Picture) -> LiveFrame | None:
        """The next frame in; out comes that of ``latency`` frames ago, or None in the beginning."""
        with one_thread():
            pose = self._tracker.step(frame)
            frontal, _ = self._features.step(frame, pose)
            self._poses.append(pose)
            row = normalise(control_parameters(frontal[None], self._unit), self._neutral, self._spread)[0]
            out = self._control.step(row)
        return None if out is None else self._with_pose(out)

    def finish(self) -> list[LiveFrame]:
        """The last frames."""
        return [self._with_pose(out) for out in self._control.finish()]

    def _with_pose(self, out: ControlFrame) -> LiveFrame:
        return LiveFrame(out.frame, out.displacements, out.status, self._poses.popleft())
