"""The 19 points of a first frame out of a file.

The file is that of :mod:`evalkit.head.points`; it may also name the points of
:data:`evalkit.vision.points.FACE_POINTS` themselves, of which the middles of the lids are no points of a photo.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.vision.points import FACE_POINTS, face_points


def read_face_points(path: str | Path, size: tuple[int, int]) -> Array:
    """Read the points.

    Parameters
    ----------
    path : str or Path
    size : (int, int)
        Width and height of the frame, pixels.

    Returns
    -------
    ndarray, shape (19, 2), pixels
        In the order of :data:`~evalkit.vision.points.FACE_POINTS`.

    Raises
    ------
    EvalkitError
        If the file cannot be read, a point is missing, no pair of numbers or outside of the frame, or the file says
        that its points were placed on a picture of another size.
    """
    path = Path(path)
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise EvalkitError(f"{path}: cannot be read ({error.strerror or error})") from error
    except ValueError as error:
        raise EvalkitError(f"{path}: no valid JSON ({error})") from error
    if not isinstance(facts, dict) or not isinstance(facts.get("points"), dict):
        raise EvalkitError(f"{path}: 'points' is missing: an object of names and places [x, y]")
    photo = facts.get("photo")
    for side, wanted in zip(("width", "height"), size, strict=True):
        found = photo.get(side, wanted) if isinstance(photo, dict) else wanted
        if found != wanted:
            raise EvalkitError(
                f"{path}: its points are of a picture whose {side} is {found} pixels, the frame's is {wanted}"
            )
    for name, place in facts["points"].items():
        if not _is_place(place):
            raise EvalkitError(f"{path}: point '{name}' is not a place [x, y] of two numbers: {json.dumps(place)}")
    try:
        places = face_points(facts["points"])
    except EvalkitError as error:
        raise EvalkitError(f"{path}: {error}") from error
    check_inside(places, size, str(path))
    return places


def _is_place(value: Any) -> bool:
    numbers = isinstance(value, list) and len(value) == 2
    return numbers and all(isinstance(x, int | float) and not isinstance(x, bool) and np.isfinite(x) for x in value)


def check_inside(points_px: Array, size: tuple[int, int], source: str) -> None:
    """Refuse points (19, 2) outside of a picture of some width and height.

    Raises
    ------
    EvalkitError
        If one is outside, with its name and what the points are from.
    """
    for name, (x, y) in zip(FACE_POINTS, points_px, strict=True):
        if not (0 <= x <= size[0] and 0 <= y <= size[1]):
            raise EvalkitError(
                f"{source}: point '{name}' ({x:g}, {y:g}) is outside of the frame, {size[0]} x {size[1]} pixels"
            )
