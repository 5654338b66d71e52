"""The paper's preprocessing: a local origin near the expected pivot, from what is known of heads."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.capture.model import Capture
from evalkit.errors import CaptureError, EvalkitError

DOWN_MM = 110.0
BACK_MM = 90.0
"""From the middle of forehead markers down and back to the upper neck: a starting point good to a few
centimetres, not a measurement. Anything better belongs into the ``offset_mm`` of :func:`local_origin`."""

DIRECTIONS = {
    f"{sign}{axis}": (1.0 if sign == "+" else -1.0) * np.eye(3)[k] for k, axis in enumerate("XYZ") for sign in "+-"
}


def screen_axes(take: Capture) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors up and forward, shape (3,) each: from the file's screen axes, else +y and +z.

    A performer who faces the operator's screen looks along right x up.

    Raises
    ------
    CaptureError
        If the screen axes are not two different world axes.
    """
    right, up = take.axes if take.axes is not None else ("+X", "+Y")
    if right not in DIRECTIONS or up not in DIRECTIONS or right[-1] == up[-1]:
        raise CaptureError(f"screen axes {right!r}, {up!r} are not two different axes such as +X and +Z")
    return DIRECTIONS[up], np.cross(DIRECTIONS[right], DIRECTIONS[up])


def local_origin(
    take: Capture, columns: ArrayLike, offset_mm: tuple[float, float] = (DOWN_MM, BACK_MM)
) -> NDArray[np.float64]:
    """A point near the pivot: below and behind the rigid markers' mean position.

    Parameters
    ----------
    take : Capture
    columns : array_like of int
        Columns of the rigid markers.
    offset_mm : (float, float)
        How far down and how far back.

    Returns
    -------
    ndarray, shape (3,), mm, in the capture's world axes

    Raises
    ------
    EvalkitError
        If the rigid markers are never seen.
    """
    points = take.points[:, np.asarray(columns)]
    if not np.isfinite(points).any():
        raise EvalkitError("the rigid markers are missing in every frame; choose others")
    up, forward = screen_axes(take)
    return np.nanmean(points, axis=(0, 1)) - offset_mm[0] * up - offset_mm[1] * forward


def translate(take: Capture, origin: ArrayLike) -> Capture:
    """The take in coordinates relative to an origin (3,), mm; angles, forces and the like stay as they are."""
    moved = take.points.copy()
    positions = [k for k, kind in enumerate(take.quantities) if kind == "position"]
    moved[:, positions] -= np.asarray(origin, dtype=np.float64)
    return take.with_points(moved)
