"""Mouth and eyes: slits in the skin, whose two sides must neither be matched with each other nor follow each other."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array, nearest_rotation
from evalkit.head.model import Head
from evalkit.head.places import all_landmarks

Sides = NDArray[np.int8]
"""Shape (K, 3): on which side of mouth, left and right eye places are; 1 above, -1 below, 0 beside."""

SLITS = {
    "mouth": ("mouth corner right", "mouth corner left"),
    "left eye": ("eye inner left", "eye outer left"),
    "right eye": ("eye outer right", "eye inner right"),
}
"""Slit -> landmarks at its ends, from the person's right to the left."""

LIDS_REACH = 0.75
"""Skin so near to the middle of an eye, in widths of the eye, is that of its lids: 20 mm, half of the way to brow and
cheek bone beyond the lids' own margins."""

CORNER = 0.1
"""What lies so near to a corner, in widths of the slit, belongs to both sides: 3 to 5 mm, a marker's own size."""

FEWEST = 4


def head_axes(landmarks: Mapping[str, Array], name: str = "head") -> Array:
    """Rows: the head's left, up and forward, those of the mean face laid on its landmarks; shape (3, 3).

    Raises
    ------
    EvalkitError
        If fewer than four landmarks have a known name.
    """
    mean = all_landmarks()
    names = [known for known in mean if known in landmarks]
    if len(names) < FEWEST:
        raise EvalkitError(f"{name}: {len(names)} landmarks with a known name; {FEWEST} tell where its front is")
    points, onto = np.array([landmarks[known] for known in names]), np.array([mean[known] for known in names])
    return nearest_rotation((onto - onto.mean(axis=0)).T @ (points - points.mean(axis=0)))


def sides_of_slits(landmarks: Mapping[str, Array], points: Array) -> Sides:
    """Sides of points (K, 3), by the line between the corners of each slit.

    A point is above or below if its foot on that line lies between them, however far it is, and not at a corner.
    """
    up = head_axes(landmarks)[1]
    out = np.zeros((len(points), len(SLITS)), dtype=np.int8)
    for k, (right, left) in enumerate(SLITS.values()):
        start, along = landmarks[right], landmarks[left] - landmarks[right]
        share = (points - start) @ along / (along @ along)
        upward = up - along * (up @ along) / (along @ along)
        out[:, k] = np.where(np.abs(share - 0.5) < 0.5 - CORNER, np.sign((points - start) @ upward), 0.0)
    return out


def vertex_sides(head: Head) -> Sides:
    """Sides of a head's vertices (V, 3): lips by their regions, lids as far as they reach; all other skin is beside."""
    out = sides_of_slits(head.landmarks, head.vertices)
    out[:, 0] = 0
    for lip, side in (("upper lip", 1), ("lower lip", -1)):
        out[head.regions[lip], 0] = side
    for k, names in list(enumerate(SLITS.values()))[1:]:
        corners = np.array([head.landmarks[name] for name in names])
        width = np.linalg.norm(corners[1] - corners[0])
        out[np.linalg.norm(head.vertices - corners.mean(axis=0), axis=1) > LIDS_REACH * width, k] = 0
    return out


def opposite(a: Sides, b: Sides) -> NDArray[np.bool_]:
    """Whether places lie on opposite sides of any slit; shapes (..., 3), broadcast."""
    return np.asarray((a * b < 0).any(axis=-1))
