"""What every head tracker answers, and how it is called: one frame at a time, so that a camera can feed it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from evalkit.geometry import Array
from evalkit.vision.camera import Camera

Picture = NDArray[np.uint8]
"""A frame (H, W) or (H, W, 3), blue, green, red as OpenCV has it, first row on top."""


class TrackStatus(IntEnum):
    """How far the pose of one frame can be trusted."""

    TRACKED = 0
    WEAK = 1
    """Little of the face supports the pose, it is carried over from frames before, or the picture is a smear."""
    LOST = 2
    """No pose."""

    @property
    def text(self) -> str:
        """The status as it is written in tables."""
        return self.name.lower()


class HeadPose(NamedTuple):
    """Pose of one frame: ``x = R P + T`` from the head to the camera's axes (see :mod:`evalkit.vision.camera`).

    Attributes
    ----------
    rotation : ndarray, shape (3, 3)
        NaN where lost.
    translation : ndarray, shape (3,), mm
        Of the head's origin, the point on the cylinder's axis at the height of the face's middle; NaN where lost. One
        camera cannot see size: millimetres hold for a face with the eye distance of the mean face.
    status : TrackStatus
    confidence : float
        0 to 1.
    """

    rotation: Array
    translation: Array
    status: TrackStatus
    confidence: float


LOST = HeadPose(np.full((3, 3), np.nan), np.full(3, np.nan), TrackStatus.LOST, 0.0)


class HeadTracker(Protocol):
    """One tracker at work on one video."""

    def start(self, frame: Picture, camera: Camera, points_px: Array) -> HeadPose:
        """Begin with a frame and the 19 points in it.

        Parameters
        ----------
        frame : ndarray of uint8, shape (H, W) or (H, W, 3)
        camera : Camera
        points_px : ndarray, shape (19, 2)
            In the order of :data:`evalkit.vision.points.FACE_POINTS`.

        Raises
        ------
        EvalkitError
            If no head can have those points.
        """
        ...

    def step(self, frame: Picture) -> HeadPose:
        """Pose of the next frame."""
        ...


@dataclass(frozen=True)
class TrackerMethod:
    """An entry of the table of trackers.

    Attributes
    ----------
    build : callable
        Makes a tracker for one video.
    text : str
        One line for a human.
    source : str
        Where it was published.
    """

    build: Callable[[], HeadTracker]
    text: str
    source: str = ""
    origin: str = ""


@dataclass(frozen=True, eq=False)
class HeadTrack:
    """Head pose of every frame of a video.

    Attributes
    ----------
    rotations : ndarray, shape (F, 3, 3)
    translations : ndarray, shape (F, 3), mm
        See :class:`HeadPose`; both are NaN where the head is lost.
    status : ndarray of int8, shape (F,)
        :class:`TrackStatus`.
    confidence : ndarray, shape (F,)
        0 to 1.
    times_s : ndarray, shape (F,)
    camera : Camera
    method : str
    """

    rotations: Array
    translations: Array
    status: NDArray[np.int8]
    confidence: Array
    times_s: Array
    camera: Camera
    method: str
