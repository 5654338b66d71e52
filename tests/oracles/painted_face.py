"""A face painted by formula in the axes of a head, seen by a camera by following every pixel's ray; no evalkit code.

The skin has a texture that goes with it, lids and lips are curves that open and close over eyes and a dark mouth, and
the surface is a smooth hill with a nose. The places of all points are known from the same formulas.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.ndimage

WIDTH, HEIGHT, FOCAL = 150, 180, 470.0
DISTANCE_MM = 640.0
EYE_X, EYE_HALF, EYE_Y = 31.5, 13.1, 33.4
UPPER, LOWER = 5.7, 2.6
"""Height of the lids' arcs above and below the line of the corners, mm."""
LIPS_Y, MOUTH_HALF = -34.0, 25.3
FIELD_MM = 0.5


@dataclass(frozen=True)
class Act:
    """Expression: raise of the brows, mm; closure of the eyes 0 to 1; drop of the jaw, mm; smile, mm; gaze, mm."""

    brow: float = 0.0
    blink: float = 0.0
    jaw: float = 0.0
    smile: float = 0.0
    gaze: float = 0.0


def bump(x, y, at, width):
    return np.exp(-0.5 * (((x - at[0]) / width[0]) ** 2 + ((y - at[1]) / width[1]) ** 2))


def way(x, y, act):
    """Way of the skin from its place in the neutral face."""
    dx, dy = np.zeros_like(x), np.zeros_like(y)
    for side in (-1, 1):
        dy = dy + act.brow * bump(x, y, (side * 35.0, 56.0), (24.0, 9.0))
        at_corner = bump(x, y, (side * 25.3, -35.2), (10.0, 9.0))
        dx, dy = dx + side * act.smile * at_corner, dy + 0.6 * act.smile * at_corner
        arc = eye_arc(x, side)
        above = y - (EYE_Y + UPPER * arc)
        closing = act.blink * (UPPER + LOWER) * arc
        dy = dy - np.where(above > -1e-9, closing * np.exp(-0.5 * (above / 5.0) ** 2), 0.0)
    below = LIPS_Y - y
    dy = dy - np.where(below > 0, act.jaw * mouth_arc(x) * np.exp(-0.5 * (below / 45.0) ** 2), 0.0)
    return dx, dy


def eye_arc(x, side):
    return np.maximum(1.0 - ((side * x - EYE_X) / EYE_HALF) ** 2, 0.0)


def mouth_arc(x):
    return np.maximum(1.0 - (x / MOUTH_HALF) ** 2, 0.0)


def moved(points, act):
    """Places of neutral points (N, 2) in an expression."""
    dx, dy = way(points[:, 0], points[:, 1], act)
    return points + np.stack([dx, dy], axis=1)


def depth(x, y, person=0.0):
    """Height of the hill, mm; ``person`` makes its middle flatter or its sides deeper."""
    nose = 20.0 * bump(x, y, (0.0, 2.0), (9.0, 14.0))
    return 108.0 - x**2 / 150.0 - (y - 20.0) ** 2 / 700.0 + nose + person * bump(x, y, (0, -35), (25, 18))


class Painter:
    """Paints one person, whose skin depends on the seed."""

    def __init__(self, random):
        size = int(260 / FIELD_MM)
        noise = random.standard_normal((size, size))
        fine, broad = (scipy.ndimage.gaussian_filter(noise, s / FIELD_MM) for s in (1.5, 5.0))
        self.skin = 9.0 * fine / fine.std() + 7.0 * broad / broad.std()

    def colour(self, x, y, act):
        """Grey levels at places of the head."""
        mx, my = x.copy(), y.copy()
        for _ in range(8 if act != Act(gaze=act.gaze) else 0):
            dx, dy = way(mx, my, act)
            mx, my = 0.4 * mx + 0.6 * (x - dx), 0.4 * my + 0.6 * (y - dy)
        at = [(130.0 - my) / FIELD_MM, (mx + 130.0) / FIELD_MM]
        out = 150.0 + scipy.ndimage.map_coordinates(self.skin, at, order=1, mode="nearest")
        for side in (-1, 1):
            out = self._brow(out, side * mx, my)
            out = (
                out
                - 55.0 * bump(side * mx, my, (8.0, -12.0), (3.5, 2.0))
                - 18.0 * bump(side * mx, my, (15, -6), (2, 6))
            )
        lips = 1.0 / (1.0 + np.exp(1.5 * (np.hypot(mx / 25.5, (my - LIPS_Y) / 9.5) - 1.0) * 9.5))
        out = out - 35.0 * lips
        for side in (-1, 1):
            out = self._eye(out, side, x, y, act)
        drop = act.jaw * mouth_arc(x)
        inside = (y < LIPS_Y) & (y > LIPS_Y - drop) & (np.abs(x) < MOUTH_HALF)
        out = np.where(inside, 38.0, out)
        return out - 40.0 * np.exp(-0.5 * ((my - LIPS_Y) / 0.8) ** 2) * (np.abs(mx) < MOUTH_HALF) * (act.jaw < 0.5)

    @staticmethod
    def _brow(out, x, y):
        # Distance from the line between its ends, (11.7, 59.1) and (58.2, 52.0).
        t = np.clip((x - 11.7) / 46.5, 0.0, 1.0)
        far = np.hypot(x - (11.7 + 46.5 * t), y - (59.1 - 7.1 * t + 4.0 * t * (1 - t)))
        return out - 70.0 / (1.0 + np.exp(2.0 * (far - 2.8)))

    @staticmethod
    def _eye(out, side, x, y, act):
        arc = eye_arc(x, side)
        top, bottom = EYE_Y + UPPER * arc - act.blink * (UPPER + LOWER) * arc, EYE_Y - LOWER * arc
        ball = 215.0 - 150.0 / (1.0 + np.exp(2.0 * (np.hypot(x - side * EYE_X - act.gaze, y - 35.0) - 5.0)))
        out = np.where((y < top) & (y > bottom) & (arc > 0), ball, out)
        for edge, dark in ((top, 80.0), (bottom, 35.0)):
            out = out - dark * np.exp(-0.5 * ((y - edge) / 0.9) ** 2) * (arc > 0)
        return out

    def picture(self, rotation, translation, act, person=0.0):
        """The face as the camera sees it: x right is the person's left, row 0 on top."""
        columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
        sight = np.stack([(columns - WIDTH / 2) / FOCAL, (HEIGHT / 2 - rows) / FOCAL, -np.ones(columns.shape)], axis=-1)
        sight = sight @ rotation
        eye = -rotation.T @ translation
        z = np.full(columns.shape, 100.0)
        for _ in range(60):
            x, y = (eye[k] + (z - eye[2]) / sight[..., 2] * sight[..., k] for k in (0, 1))
            change = np.maximum(depth(x, y, person), 0.0) - z
            z = z + 0.6 * change
            if np.abs(change).max() < 0.02:
                break
        out = 90.0 + 30.0 * np.sin(columns / 9.0) * np.sin(rows / 7.0)
        head = np.hypot(x / 76.0, (y - 5.0) / 105.0) < 1.0
        out[head] = self.colour(x[head], y[head], act)
        return out


def exposed(picture, random, noise=2.0, gain=1.0, slope=0.0):
    """What a sensor makes of it: brightness, a lamp from one side, noise, whole grey levels."""
    lamp = gain * (1.0 + slope * (np.arange(picture.shape[1]) / picture.shape[1] - 0.5))
    return np.clip(np.rint(picture * lamp + noise * random.standard_normal(picture.shape)), 0, 255).astype(np.uint8)
