"""Where the grid lines of the template run: rows follow the face, columns pass through the corners of eyes and mouth.

Every entry is a ray that is followed inward until it meets the surface, so the numbers here steer where
vertices lie along the skin and never how far out they are. Only the left half is listed; the middle column has
x = 0. The sheet comes in three blocks (crown to upper lid, lower lid to upper lip, lower lip to neck) that are
joined outside the eyes and the mouth and open between their corners.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

CUT_Z_MM = -35.0
"""The mask ends in this frontal plane, behind the ears."""

INNER_EYE, MOUTH_CORNER, OUTER_EYE = 2, 3, 5
"""Columns that pass through the corners."""

HAIRLINE, UPPER_LIP_ROW, LOWER_LIP_ROW, NECK_ROW = 3.0, 5.0, 2.0, 5.5
"""Rows at which hair, upper lip (block "middle"), lower lip and neck (block "lower") begin or end."""

LIP_COLUMN, REAR_COLUMN = 3.5, 7.5
"""Columns up to which the lips reach and from which the rear of the head begins."""


class Ray(NamedTuple):
    """A point outside the head and the unit vector along which the surface is looked for."""

    origin: tuple[float, float, float]
    direction: tuple[float, float, float]


def front(x: float, y: float) -> Ray:
    """Straight from the front."""
    return Ray((x, y, 200.0), (0.0, 0.0, -1.0))


def side(y: float, z: float) -> Ray:
    """Straight from the left."""
    return Ray((180.0, y, z), (-1.0, 0.0, 0.0))


def crown(polar_deg: float, around_deg: float) -> Ray:
    """Towards the middle of the skull: angle from the forward axis, angle about it from the top."""
    polar, around = math.radians(polar_deg), math.radians(around_deg)
    out = (math.sin(polar) * math.sin(around), math.sin(polar) * math.cos(around), math.cos(polar))
    middle = (0.0, 55.0, CUT_Z_MM)
    return Ray(tuple(m + 200.0 * d for m, d in zip(middle, out, strict=True)), tuple(-d for d in out))  # type: ignore[arg-type]


def around(x: float, y: float, z: float, rise: float = 0.0) -> Ray:
    """Through a point near the surface, towards the upright axis of the neck; rising by so much per mm."""
    out = np.array([x, 0.0, z - CUT_Z_MM])
    out /= np.linalg.norm(out)
    out[1] = -rise
    out /= np.linalg.norm(out)
    start = np.array([x, y, z]) + 60.0 * out
    return Ray(tuple(start.tolist()), tuple((-out).tolist()))


def neck(y: float, around_deg: float) -> Ray:
    """Level, towards the axis of the neck: 0 degrees is the front."""
    angle = math.radians(around_deg)
    return Ray(
        (200.0 * math.sin(angle), y, CUT_Z_MM + 200.0 * math.cos(angle)), (-math.sin(angle), 0.0, -math.cos(angle))
    )


def below(x: float, z: float) -> Ray:
    """Straight from below."""
    return Ray((x, -140.0, z), (0.0, 1.0, 0.0))


AROUND = (0, 6, 13, 19, 25, 34, 45, 59, 71, 83)
NECK = (0, 8, 17, 26, 35, 46, 57, 68, 79, 90)

UPPER = (
    [crown(90, a) for a in AROUND],
    [crown(74, a) for a in AROUND[:8]] + [crown(77, 73), crown(90, 90)],
    [crown(57, a) for a in AROUND[:7]] + [crown(62, 62), crown(74, 79), side(46, CUT_Z_MM)],
    [front(0, 106), front(9, 106), front(19, 105), front(27, 104), front(34, 102), front(46, 97), front(58, 86),
     side(72, 34), side(60, 2), side(38, CUT_Z_MM)],
    [front(0, 84), front(9, 84), front(19, 84), front(27, 84), front(34, 83), front(46, 79), front(60, 70),
     side(58, 37), side(50, 4), side(32, CUT_Z_MM)],
    [front(0, 66), front(9, 66), front(18.5, 67), front(26.5, 68), front(34, 68.5), front(46, 66), front(61, 57),
     side(47, 40), side(42, 5), side(27, CUT_Z_MM)],
    [front(0, 55), front(9, 55.5), front(18.4, 57), front(26, 58), front(33.5, 58), front(45.5, 55), front(61, 48),
     side(40, 41), side(36, 5), side(22, CUT_Z_MM)],
    [front(0, 43), front(8, 42.5), front(16.8, 39.5), front(25.8, 44.2), front(33, 45.3), front(46.2, 39.6),
     front(61, 40), side(34, 42), side(30, 5), side(17, CUT_Z_MM)],
    [front(0, 33), front(8, 32.6), front(18.4, 32.5), front(26, 38.7), front(33, 40.3), front(44.6, 34.3),
     front(61, 33), side(28, 42), side(24, 5), side(12, CUT_Z_MM)],
)  # fmt: skip
"""Crown, scalp, scalp, hairline, forehead, above the brow, below the brow, crease of the lid, edge of the upper lid."""

MIDDLE = (
    [front(0, 33), front(8, 32.6), front(18.4, 32.5), front(26, 30.9), front(33, 30.0), front(44.6, 34.3),
     front(61, 33), side(28, 42), side(24, 5), side(12, CUT_Z_MM)],
    [front(0, 24), front(7, 24), front(16, 25), front(26, 23.5), front(34, 22.5), front(46.5, 25.5),
     front(61, 24), side(19, 43), side(16, 6), side(4, CUT_Z_MM)],
    [front(0, 13), front(7, 13), front(14.5, 13), front(25, 10), front(35, 8), front(48, 9),
     front(62, 10), side(7, 44), side(5, 8), side(-6, CUT_Z_MM)],
    [front(0, 4), front(6.5, 4), front(15.5, 4), front(24, -3), front(35, -5), front(48, -6),
     front(62, -6), side(-4, 45), side(-6, 9), side(-17, CUT_Z_MM)],
    [front(0, -6), front(6, -6), front(15.5, -4), front(24, -10), front(34.5, -12), front(48, -14),
     front(61.5, -16), side(-13, 45), side(-17, 10), side(-27, CUT_Z_MM)],
    [front(0, -14), front(6.5, -13), front(14, -12.5), front(23, -17), front(34, -20), front(48, -23),
     front(60.5, -25), side(-22, 45), side(-26, 10), side(-37, CUT_Z_MM)],
    [front(0, -24.8), front(7.5, -24.2), front(17, -27.8), front(25.8, -33.2), front(34, -31), front(47, -32),
     front(59, -34), side(-29, 44), side(-34, 10), side(-46, CUT_Z_MM)],
    [front(0, -33.4), front(8, -33.2), front(17, -33.7), front(25.3, -35.2), front(34, -37), front(46, -39),
     front(57, -41), side(-36, 42), side(-41, 9), side(-55, CUT_Z_MM)],
)  # fmt: skip
"""Edge of the lower lid, its crease, cheek, tip of the nose, under it, base of the nose, border and edge of the lip."""

LOWER = (
    [front(0, -33.5), front(8, -33.3), front(17, -33.8), front(25.3, -35.2), front(34, -37), front(46, -39),
     front(57, -41), side(-36, 42), side(-41, 9), side(-55, CUT_Z_MM)],
    [front(0, -44), front(8, -43.6), front(17.2, -41), front(25.8, -37.3), front(34.5, -43), front(45.5, -46.5),
     front(55, -49), side(-44, 39), side(-48, 8), side(-64, CUT_Z_MM)],
    [front(0, -51.5), front(8.3, -51.5), front(17.6, -50.5), front(26.5, -49), front(35, -52), front(45, -55),
     front(53, -56.5), side(-51, 36), side(-54, 7), side(-73, CUT_Z_MM)],
    [front(0, -63), front(8.7, -63), front(18, -62), front(27, -60.5), front(35.5, -59.5), front(44, -58.5),
     around(53, -58, 52), side(-56, 31), side(-61, 5), side(-82, CUT_Z_MM)],
    [around(0, -75, 102, 0.8), around(9, -75, 100, 0.8), around(18, -73, 95, 0.8), around(27, -71, 88, 0.8),
     around(36, -68, 79, 0.8), around(45, -65, 68, 0.7), around(53, -63, 52, 0.5), around(59, -62, 30, 0.2),
     around(60, -70, 4), side(-92, CUT_Z_MM)],
    [below(0, 86), below(9, 85), below(18, 81), below(27, 75), below(35.5, 67), around(45, -73, 55, 1.2),
     around(51, -72, 42, 0.7), around(56, -72, 22, 0.3), around(57, -80, 0), side(-102, CUT_Z_MM)],
    [below(0, 68), below(9, 67), below(18, 64), below(27, 59), around(36, -81, 52, 2.0), around(45, -80, 40, 1.0),
     around(49, -80, 30, 0.5), around(53, -83, 14, 0.2), around(54, -91, -5), side(-111, CUT_Z_MM)],
    [around(0, -91, 50, 0.9), around(9, -91, 49, 0.9), around(18, -90, 46, 0.8), around(28, -90, 41, 0.7),
     around(37, -89, 36, 0.5), around(44, -90, 27, 0.3), around(49, -92, 17, 0.1), around(52, -97, 3), side(-106, -14),
     side(-120, CUT_Z_MM)],
    [neck(-115, a) for a in NECK[:6]] + [neck(-116, 57), neck(-118, 68), neck(-122, 79), neck(-132, 90)],
    [neck(-148, a) for a in NECK],
)  # fmt: skip
"""Edge and border of the lower lip, fold below it, chin, jaw line, under the jaw (twice), throat, neck, its end."""

ROWS = {"upper": (4, 4, 4, 5, 4, 3, 4, 5), "middle": (4, 4, 4, 4, 4, 4, 5), "lower": (4, 4, 4, 5, 4, 3, 4, 4, 4)}
COLUMNS = (6, 6, 4, 4, 6, 5, 4, 4, 3)
"""Steps between neighbouring rows and columns at the default resolution."""
