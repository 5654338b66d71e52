"""What a tracker found, drawn over the frames of the video: cylinder, axes and points, and the status in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from evalkit.geometry import Array
from evalkit.render import colours
from evalkit.vision.parameters import PARAMETERS
from evalkit.vision.surface import Surface
from evalkit.vision.track import Track
from evalkit.vision.tracker import Picture, TrackStatus

STATUS_COLOURS = {TrackStatus.TRACKED: colours.GREEN, TrackStatus.WEAK: "#E69F00", TrackStatus.LOST: colours.VERMILION}

LEAST_HEIGHT = 480
"""Smaller pictures are enlarged by a whole factor, so that lines and letters have room."""

RINGS, STAVES = 7, 9
"""Lines of the cylinder around the head and along its axis."""

AXIS_MM = 60.0

SUBPIXEL_BITS = 4
"""Lines are drawn to a sixteenth of a pixel: whole ones tremble."""


@dataclass(frozen=True, eq=False)
class Overlay:
    """Pictures of one video.

    Attributes
    ----------
    track : Track
    surface : Surface
        The cylinder, in the head's axes.
    first_frame : int
        Number, in the video, of the first frame that was tracked.
    """

    track: Track
    surface: Surface
    first_frame: int = 0

    def size(self, width: int, height: int) -> tuple[int, int]:
        """Width and height of the pictures for frames of this size."""
        scale = _scale(height)
        return scale * width, scale * height

    def drawn(self, frame: Picture, index: int) -> Picture:
        """A frame with what was found in it.

        Parameters
        ----------
        frame : ndarray of uint8, shape (H, W) or (H, W, 3)
        index : int
            Its place in the track, from 0.

        Returns
        -------
        ndarray of uint8, shape (s H, s W, 3)
            Blue, green, red. A lost head has a frame around the picture and nothing else.
        """
        scale = _scale(frame.shape[0])
        picture = frame if frame.ndim == 3 else cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR)
        larger = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        out = np.ascontiguousarray(larger, dtype=np.uint8)
        head = self.track.head
        status = TrackStatus(int(head.status[index]))
        if status != TrackStatus.LOST:
            self._cylinder(out, index, scale, colours.bgr(STATUS_COLOURS[status]))
            self._axes(out, index, scale)
            self._points(out, index, scale)
        self._words(out, index, status)
        return out

    def _project(self, points_mm: Array, index: int, scale: int) -> Array:
        head = self.track.head
        return scale * head.camera.project(points_mm @ head.rotations[index].T + head.translations[index])

    def _cylinder(self, out: Picture, index: int, scale: int, colour: tuple[int, int, int]) -> None:
        head = self.track.head
        grid = self.surface.grids[0]
        rows, columns = grid.shape
        points = grid.points.reshape(rows, columns, 3).astype(np.float64)
        normals = grid.normals.reshape(rows, columns, 3) @ head.rotations[index].T
        placed = points @ head.rotations[index].T + head.translations[index]
        facing = (normals * placed).sum(axis=2) < 0
        pixels = scale * head.camera.project(placed)
        layer = out.copy()
        lines = [(pixels[k], facing[k]) for k in np.linspace(0, rows - 1, RINGS).round().astype(int)]
        lines += [(pixels[:, k], facing[:, k]) for k in np.linspace(0, columns - 1, STAVES).round().astype(int)]
        for line, seen in lines:
            for part in np.split(np.arange(len(line)), np.flatnonzero(np.diff(seen)) + 1):
                if seen[part[0]] and len(part) > 1:
                    _polyline(layer, line[part], colour, 1)
        cv2.addWeighted(layer, 0.6, out, 0.4, 0.0, dst=out)

    def _axes(self, out: Picture, index: int, scale: int) -> None:
        """x, y, z from the front of the cylinder in vermilion, green and blue."""
        start = np.array([0.0, 0.0, float(self.surface.radii_mm.mean())])
        ends = self._project(np.vstack([start, start + AXIS_MM * np.eye(3)]), index, scale)
        for end, colour in zip(ends[1:], colours.AXES, strict=True):
            _polyline(out, np.stack([ends[0], end]), colours.bgr(colour), 3)

    def _points(self, out: Picture, index: int, scale: int) -> None:
        """Dots that are the fainter, the less sure the point is."""
        radius = max(round(out.shape[0] / 160), 2)
        for place, sure in zip(self.track.points_px[index], self.track.confidence[index], strict=True):
            if np.isfinite(place).all():
                at = _fixed(scale * place)
                _dot(out, at, radius + 1, (0, 0, 0))
                grey = round(120 + 135 * float(np.clip(sure, 0.0, 1.0)))
                _dot(out, at, radius, (grey, grey, grey))

    def _words(self, out: Picture, index: int, status: TrackStatus) -> None:
        height, width = out.shape[:2]
        colour = colours.bgr(STATUS_COLOURS[status])
        head, known = self.track.head, int(np.isfinite(self.track.parameters[index]).sum())
        text = f"{status.text.upper()}  frame {self.first_frame + index}  {head.times_s[index]:.2f} s"
        if status == TrackStatus.LOST:
            cv2.rectangle(out, (0, 0), (width - 1, height - 1), colour, 2 * max(height // 120, 2))
        else:
            text += f"  confidence {head.confidence[index]:.2f}  {known}/{len(PARAMETERS)} parameters"
        font, thick = cv2.FONT_HERSHEY_SIMPLEX, 1
        size = height / 900
        (wide, high), base = cv2.getTextSize(text, font, size, thick)
        size *= min(1.0, (width - 16) / wide)
        (wide, high), base = cv2.getTextSize(text, font, size, thick)
        bottom = height - 1
        cv2.rectangle(out, (0, bottom - high - 2 * base), (wide + 16, bottom), colour, cv2.FILLED)
        cv2.putText(out, text, (8, bottom - base), font, size, (255, 255, 255), thick, cv2.LINE_AA)


def _scale(height: int) -> int:
    return max(-(-LEAST_HEIGHT // height), 1)


def _fixed(pixels: Array) -> NDArray[np.int32]:
    """Pixels as OpenCV's whole numbers of sixteenths, counted from the middle of the first pixel."""
    limited = np.clip(pixels - 0.5, -1e5, 1e5)
    return np.asarray(np.rint(limited * 2**SUBPIXEL_BITS), dtype=np.int32)


def _polyline(out: Picture, pixels: Array, colour: tuple[int, int, int], thickness: int) -> None:
    if np.isfinite(pixels).all():
        cv2.polylines(out, [_fixed(pixels)], False, colour, thickness, cv2.LINE_AA, SUBPIXEL_BITS)


def _dot(out: Picture, at: Any, radius: int, colour: tuple[int, int, int]) -> None:
    cv2.circle(out, tuple(int(x) for x in at), radius << SUBPIXEL_BITS, colour, cv2.FILLED, cv2.LINE_AA, SUBPIXEL_BITS)
