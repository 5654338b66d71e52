"""The 19 points of the first frame that a tracker starts from: four of the brows, eight of the eyes, three of the nose
and four of the mouth (Chai et al. 2003). Left and right are the person's.

Their file is that of :mod:`evalkit.head.points`. A point that it does not name directly is taken from those that it
does name, if possible: the middle of an upper lid lies between its inner and its outer point.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.places import all_landmarks

SIDES = ("left", "right")
FACE_POINTS = (
    *(f"{name} {side}" for side in SIDES for name in ("brow inner", "brow outer")),
    *(f"{name} {side}" for side in SIDES for name in ("eye inner", "eye outer", "upper lid", "lower lid")),
    "nose tip", "nose wing left", "nose wing right",
    "upper lip", "lower lip", "mouth corner left", "mouth corner right",
)  # fmt: skip
"""Names in the order of every array of 19 points. The lips are their outer edges, whose distance is never zero."""

BETWEEN = {
    f"{lid} {side}": (f"{lid} inner {side}", f"{lid} outer {side}")
    for side in SIDES
    for lid in ("upper lid", "lower lid")
}
"""Points in the middle of two landmarks of the head."""


def face_points(places: Mapping[str, ArrayLike]) -> Array:
    """The 19 points out of named places of any dimension, in the order of :data:`FACE_POINTS`.

    Parameters
    ----------
    places : mapping of str to array_like, shape (D,)
        Such as a head's ``landmarks`` (mm) or :attr:`evalkit.head.points.Points.places` (pixels); other names are
        ignored.

    Returns
    -------
    ndarray, shape (19, D)

    Raises
    ------
    EvalkitError
        If a point is missing.
    """
    found = []
    for name in FACE_POINTS:
        sources = (name,) if name in places else BETWEEN.get(name, (name,))
        missing = [source for source in sources if source not in places]
        if missing:
            raise EvalkitError(f"point '{name}' is missing; the 19 points are {', '.join(FACE_POINTS)}")
        found.append(np.mean([np.asarray(places[source], dtype=np.float64) for source in sources], axis=0))
    return np.array(found)


def mean_face_points() -> Array:
    """The 19 points on the measured face of :mod:`evalkit.head.places`, mm, shape (19, 3)."""
    return face_points(all_landmarks())
