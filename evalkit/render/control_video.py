"""A video and the character that it drives, side by side; or the character alone."""

from __future__ import annotations

from types import TracebackType
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike

from evalkit.animation.head_motion import NECK_MM
from evalkit.geometry import Array
from evalkit.head import Head
from evalkit.render import colours
from evalkit.render.head_scene import HeadScene
from evalkit.vision.tracker import Picture

MULTISAMPLES = 4
"""Against jagged outlines, which crawl when a head turns."""

HELD_COLOUR = colours.VERMILION
"""Of the bar under frames in which the character is held because nothing is known."""

HEAD_WIDE_MM = 180.0
"""Width, over the ears, of the head that the neck's place is told for."""


class SideBySide:
    """Pictures of a character beside the video's; a context manager.

    Parameters
    ----------
    head : Head
    height : int
        Of the pictures, pixels; even.
    video_size : (int, int), optional
        Width and height of the video's frames. Without it, the character alone.
    """

    def __init__(self, head: Head, height: int, video_size: tuple[int, int] | None = None) -> None:
        self.height = height
        self._left = 0 if video_size is None else 2 * round(0.5 * height * video_size[0] / video_size[1])
        self._right = 2 * round(0.45 * height)
        self._scene = HeadScene(head, (self._right, height), multisamples=MULTISAMPLES)
        self._neck = np.array(NECK_MM) * np.ptp(head.vertices[head.skin_vertices, 0]) / HEAD_WIDE_MM

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures."""
        return self._left + self._right, self.height

    def drawn(self, vertices: ArrayLike, rotation: Array, frame: Picture | None = None, held: bool = False) -> Picture:
        """One picture.

        Parameters
        ----------
        vertices : array_like, shape (V, 3), mm
            In the head's axes.
        rotation : ndarray, shape (3, 3)
            Of the head, as seen by the camera; NaN for straight ahead.
        frame : ndarray of uint8, shape (H, W, 3) or (H, W), optional
            The video's, blue, green, red.
        held : bool
            Marks the picture: nothing is known of the face in this frame.

        Returns
        -------
        ndarray of uint8, shape (height, width, 3)
            Blue, green, red.
        """
        turn = rotation if np.isfinite(rotation).all() else np.eye(3)
        self._scene.pose(turn, self._neck - turn @ self._neck)
        character = self._scene.frame(vertices)[..., ::-1]
        out: Any = np.empty((self.height, self._left + self._right, 3), dtype=np.uint8)
        out[:, self._left :] = character
        if self._left and frame is not None:
            seen = frame if frame.ndim == 3 else cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR)
            larger = seen.shape[0] < self.height
            how = cv2.INTER_CUBIC if larger else cv2.INTER_AREA
            out[:, : self._left] = cv2.resize(seen, (self._left, self.height), interpolation=how)
        if held:
            thick = max(self.height // 80, 3)
            out[-thick:, self._left :] = colours.bgr(HELD_COLOUR)
        return out

    def close(self) -> None:
        """Give back the window behind the pictures."""
        self._scene.close()

    def __enter__(self) -> SideBySide:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()
