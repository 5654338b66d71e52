"""A whole video: head pose, the 19 points and the control parameters of every frame."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.vision.camera import Camera
from evalkit.vision.features import FeatureTracker
from evalkit.vision.parameters import control_parameters, eye_distance
from evalkit.vision.threads import one_thread
from evalkit.vision.tracker import HeadPose, HeadTrack, HeadTracker, Picture, TrackStatus
from evalkit.vision.trackers import DEFAULT, trackers
from evalkit.vision.video import Video


@dataclass(frozen=True, eq=False)
class Track:
    """What a video shows of a face.

    Attributes
    ----------
    head : HeadTrack
        Pose, status and confidence of every frame.
    points_px : ndarray, shape (F, 19, 2)
        The points in the frames; NaN where the head is lost or a point is not recognised.
    frontal_mm : ndarray, shape (F, 19, 2), mm
        The same seen from the front: x to the person's left, y up, in the head's axes.
    confidence : ndarray, shape (F, 19)
        Of each point, 0 to 1.
    parameters : ndarray, shape (F, 15)
        See :data:`evalkit.vision.parameters.PARAMETERS`; NaN where a point that it is made from is not known.
    unit_mm : float
        Distance between the eyes in the first frame, the parameters' unit of length.
    """

    head: HeadTrack
    points_px: Array
    frontal_mm: Array
    confidence: Array
    parameters: Array
    unit_mm: float


def track(
    video: Video | Iterable[Picture],
    points_px: ArrayLike,
    camera: Camera | None = None,
    tracker: HeadTracker | None = None,
    method: str = DEFAULT,
    depth: str = "learnt",
    rate_hz: float | None = None,
    progress: Callable[[int], None] | None = None,
) -> Track:
    """Follow a face through a video.

    Parameters
    ----------
    video : Video or iterable of ndarray of uint8, shape (H, W) or (H, W, 3)
        Gone through once, a frame at a time; the first frame shows the face at rest.
    points_px : array_like, shape (19, 2)
        The points of :data:`evalkit.vision.points.FACE_POINTS` in the first frame.
    camera : Camera, optional
        By default one with an assumed field of view.
    tracker : HeadTracker, optional
        For the head's pose, by default the one of that name.
    method : str
        Key of :data:`evalkit.vision.trackers.trackers`; with a tracker of one's own, its name for the record.
    depth : {"learnt", "face", "cylinder"}
        See :class:`evalkit.vision.features.FeatureTracker`.
    rate_hz : float, optional
        Frames per second, if not as the video says; 25 for plain frames.
    progress : callable, optional
        Called with the number of frames done after each.

    Returns
    -------
    Track

    Raises
    ------
    EvalkitError
        If there are no frames, or the points fit no face.

    Notes
    -----
    Depths of the points are learnt along the way (:mod:`evalkit.vision.depths`). Since the whole video is at hand in
    the end, its first frames are read off at the depths learnt in its last one; fed live, :class:`FeatureTracker` can
    only use what it has seen.
    """
    rate = rate_hz or (video.rate_hz if isinstance(video, Video) else 25.0)
    frames = iter(video)
    first = next(frames, None)
    if first is None:
        raise EvalkitError("the video has no frames")
    points = np.asarray(points_px, dtype=np.float64)
    seen_by = camera or Camera.assumed_for(first.shape[1], first.shape[0])
    with one_thread():
        poses, found = _follow(first, frames, points, seen_by, tracker or trackers[method].build(), depth, progress)
    frontal, confidence, pixels, slopes, offsets = (np.array(values) for values in zip(*found, strict=True))
    frontal += (offsets[-1] - offsets)[:, :, None] * slopes
    unit = float(eye_distance(frontal[0]))
    head = HeadTrack(
        rotations=np.array([pose.rotation for pose in poses]),
        translations=np.array([pose.translation for pose in poses]),
        status=np.array([pose.status for pose in poses], dtype=np.int8),
        confidence=np.array([pose.confidence for pose in poses]),
        times_s=np.arange(len(poses)) / rate,
        camera=seen_by,
        method=method,
    )
    return Track(head, pixels, frontal, confidence, control_parameters(frontal, unit), unit)


Found = tuple[Array, Array, Array, Array, Array]


def _follow(
    first: Picture,
    frames: Iterator[Picture],
    points_px: Array,
    camera: Camera,
    tracker: HeadTracker,
    depth: str,
    progress: Callable[[int], None] | None,
) -> tuple[list[HeadPose], list[Found]]:
    """Pose of every frame; and of its points, place, confidence, pixels, slopes and depths."""
    features = FeatureTracker(camera, depth)
    poses: list[HeadPose] = []
    found: list[Found] = []
    for frame in itertools.chain([first], frames):
        if poses:
            pose = tracker.step(frame)
            place, confidence = features.step(frame, pose)
        else:
            pose = tracker.start(frame, camera, points_px)
            place, confidence = features.start(frame, pose, points_px)
        poses.append(pose)
        lost = pose.status == TrackStatus.LOST
        slopes = np.full_like(place, np.nan) if lost else features.slopes.copy()
        found.append((place, confidence, features.points_px.copy(), slopes, features.offset_mm.copy()))
        if progress is not None:
            progress(len(poses))
    return poses, found
