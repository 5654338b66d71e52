"""What anatomy says of the ways of the 19 points: how far each goes, which go together, what of a patch is theirs.

The ways of all points from their neutral places are taken as jointly normal. A patch that does not show in which
direction a point went (a brow along itself, a lid sideways), or shows something else, is helped out by this.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from evalkit.geometry import Array
from evalkit.vision.points import FACE_POINTS, SIDES


class Kind(NamedTuple):
    """What anatomy says of a point's way, and which part of its patch belongs to it.

    Attributes
    ----------
    family : str
        Points that tend to move together, mirrored on the other side.
    spread_mm : (float, float)
        Standard deviation of the way from the neutral place, sideways and up and down.
    spread_affine : float
        Standard deviation of the entries of the affine matrix; 0 for a patch that keeps its form.
    middle_mm : (float, float)
        Middle of the weights, away from the nose and up from the point.
    width_mm : (float, float)
        Standard deviation of the weights.
    """

    family: str
    spread_mm: tuple[float, float]
    spread_affine: float
    middle_mm: tuple[float, float]
    width_mm: tuple[float, float]


KINDS = {
    "brow": Kind("brows", (2.5, 4.0), 0.1, (0.0, 0.0), (7.0, 7.0)),
    # Of corners and lids, only the skin outside of the slit counts: what lies in it turns with the gaze, and stays when
    # a lid goes.
    "eye inner": Kind("corners", (0.5, 0.5), 0.0, (-2.5, 0.0), (4.0, 5.0)),
    "eye outer": Kind("corners", (0.5, 0.5), 0.0, (2.5, 0.0), (4.0, 5.0)),
    "upper lid": Kind("upper lids", (0.2, 8.0), 0.0, (0.0, 2.0), (5.0, 3.0)),
    "lower lid": Kind("lower lids", (0.2, 4.0), 0.0, (0.0, -4.0), (6.0, 3.0)),
    "nose": Kind("nose", (2.0, 2.0), 0.1, (0.0, 0.0), (5.0, 5.0)),
    # The skin beyond the lips counts more: what opens between them is teeth, tongue or dark.
    "upper lip": Kind("mouth", (4.0, 4.0), 0.05, (0.0, 3.0), (6.0, 5.0)),
    "lower lip": Kind("mouth", (4.0, 14.0), 0.05, (0.0, -3.0), (6.0, 5.0)),
    "mouth": Kind("mouth", (6.0, 6.0), 0.05, (0.0, 0.0), (5.0, 5.0)),
}
"""First words of a point's name -> its kind. Ways: brows are raised by 10 and drawn together by 5 mm, lids close by 10
and go up and down only, a jaw opens by 40, corners of the mouth go 15 mm in any direction, corners of the eyes stay
(Ekman & Friesen 1978; ICT-FaceKit's shapes)."""

TOGETHER = {"brows": 0.6, "corners": 0.0, "upper lids": 0.7, "lower lids": 0.5, "nose": 0.3, "mouth": 0.2}
"""Family -> correlation of the ways of its points, mirrored between the sides."""

MIDDLE_TOGETHER = 0.8
"""Correlation of the sideways ways of both lips' middles."""

COMMON_MM = 4.0
"""Spread of a shift of all points together, which an error of the head's pose makes."""


def _kind(name: str) -> Kind:
    return next(KINDS[words] for words in sorted(KINDS, key=len, reverse=True) if name.startswith(words))


POINT_KINDS = [_kind(name) for name in FACE_POINTS]
"""Kind of each point."""

SPREAD_MM = np.array([kind.spread_mm for kind in POINT_KINDS])
"""Shape (19, 2)."""

UPRIGHT = np.array([kind.family.endswith("lids") for kind in POINT_KINDS])
"""Points that go up and down only, shape (19,): their patches are not asked where they are sideways."""

SKULL = np.array([kind.family == "corners" for kind in POINT_KINDS])
"""Points that do not move on the skull, shape (19,)."""

_WITHOUT_SIDE = [name.removesuffix(" left").removesuffix(" right") for name in FACE_POINTS]
MIRRORED = np.array([_WITHOUT_SIDE.index(name) for name in _WITHOUT_SIDE])
"""A number for each point, shape (19,), that it shares with the one on the other side."""

LIDS = [[FACE_POINTS.index(f"{lid} lid {side}") for lid in ("upper", "lower")] for side in SIDES]
CORNERS = [[FACE_POINTS.index(f"eye {end} {side}") for end in ("inner", "outer")] for side in SIDES]
"""Numbers of the lids and of the corners of each eye."""

LIPS = [FACE_POINTS.index(f"{lip} lip") for lip in ("upper", "lower")]


def ways_precision() -> Array:
    """Inverse of the covariance of all ways, 1/mm², shape (38, 38): x and y of each point in turn."""
    count = len(FACE_POINTS)
    side = np.array([name.endswith("left") * 1.0 - name.endswith("right") for name in FACE_POINTS])
    families = np.array([kind.family for kind in POINT_KINDS])
    rho = np.array([TOGETHER[family] for family in families])[:, None] * (families[:, None] == families)
    out = np.zeros((2 * count, 2 * count))
    middle = side == 0
    for axis, sign in enumerate((side, np.ones(count))):
        correlation = rho * np.outer(sign, sign)
        if axis == 0:
            # What lies in the middle of the face goes to one side together.
            correlation[np.ix_(middle, middle)] = (rho[np.ix_(middle, middle)] > 0) * MIDDLE_TOGETHER
        np.fill_diagonal(correlation, 1.0)
        spread = SPREAD_MM[:, axis]
        out[axis::2, axis::2] = correlation * np.outer(spread, spread) + COMMON_MM**2
    return np.asarray(np.linalg.inv(out), dtype=np.float64)
