"""The procedural texture of the template: skin, brows, lips, lashes, eyes, teeth and hair, painted in texture space.

The sheet's texture coordinates are functions of the cage's rows and columns, so that one picture serves every
resolution. The lowest quarter of the picture holds the tiles of eyeballs, teeth, ears and plate.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evalkit.head import cage
from evalkit.seeds import generator

if TYPE_CHECKING:
    from evalkit.head.template import Grid

Array = NDArray[Any]
"""Pictures are worked on in single precision, coordinates in double."""

SIZE = 1024
"""Pixels along each side of the picture."""

ROWS_V = {
    "upper": (1.0, 0.965, 0.925, 0.87, 0.80, 0.725, 0.68, 0.645, 0.62),
    "middle": (0.62, 0.59, 0.56, 0.53, 0.51, 0.49, 0.455, 0.42),
    "lower": (0.42, 0.385, 0.36, 0.335, 0.31, 0.295, 0.285, 0.275, 0.265, 0.255),
}
"""Height in the picture of every cage row."""

COLUMNS_U = (0.0, 0.055, 0.115, 0.165, 0.21, 0.28, 0.36, 0.42, 0.465, 0.498)
"""Distance from the middle of the picture of every cage column."""

EYE_LENS, MOUTH_LENS = 0.012, 0.018
"""Half heights of the openings in the picture: their inner rings are painted there."""


def sheet_uv(grid: Grid) -> Array:
    """Texture coordinates of the sheet's vertices, shape (count, 2)."""
    out = np.zeros((grid.count, 2))
    across = grid.across
    u = 0.5 + np.sign(across) * np.interp(np.abs(across), np.arange(len(COLUMNS_U)), COLUMNS_U)
    for name, ids in grid.ids.items():
        row = grid.rows[name][:, None]
        out[ids, 0] = u
        out[ids, 1] = row_v(name, row, np.abs(across))
    return out


def row_v(block: str, row: Array, column: Array) -> Array:
    """Height in the picture of a place of the sheet; rows beside an opening bend around it."""
    last = len(ROWS_V[block]) - 1
    v = np.interp(row, np.arange(last + 1), ROWS_V[block])
    middle, half = 0.5 * (cage.INNER_EYE + cage.OUTER_EYE), 0.5 * (cage.OUTER_EYE - cage.INNER_EYE)
    eye = EYE_LENS * np.sqrt(np.clip(1.0 - ((column - middle) / half) ** 2, 0.0, None))
    mouth = MOUTH_LENS * np.sqrt(np.clip(1.0 - (column / cage.MOUTH_CORNER) ** 2, 0.0, None))
    if block == "upper":
        return v + eye * np.clip(row - (last - 1), 0.0, 1.0)
    if block == "middle":
        return v - eye * np.clip(1.0 - row, 0.0, 1.0) + mouth * np.clip(row - (last - 1), 0.0, 1.0)
    return v - mouth * np.clip(1.0 - row, 0.0, 1.0)


def eye_uv(polar: Array, around: Array) -> Array:
    """Tile of the eyeballs: the pole in its middle, angle from the pole as distance from it."""
    radius = 0.118 * polar / np.pi
    return np.stack(np.broadcast_arrays(0.125 + radius * np.cos(around), 0.125 + radius * np.sin(around)), axis=-1)


def teeth_uv(along: Array, down: Array) -> Array:
    """Tile of the teeth: along the arch from -1 to 1, from gum (0) to edge (1)."""
    return np.stack(np.broadcast_arrays(0.375 + 0.118 * along, 0.118 - 0.11 * down), axis=-1)


def ear_uv(share: Array) -> Array:
    """Tile of the ears: from the bowl to the rim and behind it."""
    return np.stack([0.26 + 0.23 * share, np.full_like(share, 0.19)], axis=-1)


def plate_uv(unit: Array) -> Array:
    """Tile of the plate, from (0, 0) bottom left to (1, 1)."""
    return np.array([0.505, 0.005]) + unit * [0.49, 0.235]


SKIN = np.array([224.0, 172.0, 142.0])
BLUSH = np.array([214.0, 128.0, 110.0])
LIP = np.array([186.0, 96.0, 92.0])
HAIR = np.array([52.0, 38.0, 30.0])
MOUTH = np.array([70.0, 20.0, 22.0])
LINING = np.array([206.0, 128.0, 116.0])


@lru_cache(maxsize=1)
def paint() -> NDArray[np.uint8]:
    """The picture, (SIZE, SIZE, 4), the same every time; not to be written to."""
    picture = np.zeros((SIZE, SIZE, 4), dtype=np.float32)
    picture[..., 3] = 255.0
    u = ((np.arange(SIZE) + 0.5) / SIZE).astype(np.float32)
    v = 1.0 - u
    _paint_skin(picture, u, v)
    _paint_eye(picture, u, v)
    _paint_teeth(picture, u, v)
    _paint_ears(picture, u, v)
    _paint_plate(picture, u, v)
    out = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
    out.flags.writeable = False
    return out


def _noise(size: int, blur: tuple[float, float], name: str) -> Array:
    """Smooth noise of unit standard deviation, mirror-symmetric."""
    from scipy.ndimage import gaussian_filter

    raw = gaussian_filter(generator("head texture", name, seed=0).standard_normal((size, size)), blur)
    raw = raw + raw[:, ::-1]
    return raw / raw.std()


def blob(a: Array, b: Array, a0: float, b0: float, wide: float, high: float) -> Array:
    """1 at the middle (a0, b0), falling off as a Gaussian of these widths."""
    return np.exp(-0.5 * (((a - a0) / wide) ** 2 + ((b - b0) / high) ** 2))


def ramp(x: Array, low: float, high: float) -> Array:
    """0 at ``low`` and 1 at ``high``, smooth at both ends."""
    x = np.clip((x - low) / (high - low), 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def mix(picture: Array, colour: Array, amount: Array) -> None:
    """Blend a colour into the picture by an amount of 0 to 1, in place."""
    picture[..., :3] += amount[..., None] * (colour - picture[..., :3])


def _paint_skin(picture: Array, u: Array, v: Array) -> None:
    column = np.broadcast_to(np.interp(np.abs(u - 0.5), COLUMNS_U, np.arange(len(COLUMNS_U))), (SIZE, SIZE))
    tall = np.broadcast_to(v[:, None], (SIZE, SIZE))
    face = picture
    # Rows and columns lie closer together in the picture on the neck and at the sides: no pattern there.
    even = ramp(tall, 0.29, 0.34) * (1.0 - ramp(column, 5.5, 7.0)) * (1.0 - ramp(tall, 0.78, 0.9))
    face[..., :3] = SKIN + (4.0 * even * _noise(SIZE, (9, 9), "blotches"))[..., None] * [0.6, 1.0, 1.0]
    face[..., :3] += (2.5 * even * _noise(SIZE, (1.2, 1.2), "pores"))[..., None]
    block_v = {name: (values[-1], values[0]) for name, values in ROWS_V.items()}
    rows = {name: np.interp(-tall, -np.array(values), np.arange(len(values))) for name, values in ROWS_V.items()}
    mix(face, BLUSH, 0.30 * blob(column, rows["middle"], 4.6, 2.6, 1.3, 1.0) * (tall < block_v["middle"][1] + 0.02))
    mix(face, BLUSH, 0.30 * blob(column, rows["middle"], 0.0, 3.2, 1.0, 0.7))
    # Shade in the eye sockets and around the lids.
    mix(face, SKIN * [0.74, 0.66, 0.64], 0.45 * blob(column, tall, 3.0, 0.655, 1.5, 0.022))
    mix(face, SKIN * [0.80, 0.70, 0.70], 0.35 * blob(column, tall, 3.0, 0.592, 1.6, 0.012))
    # Nostrils.
    mix(face, MOUTH * 0.8, 0.9 * blob(column, rows["middle"], 1.02, 4.46, 0.40, 0.20))
    mix(face, SKIN * [0.72, 0.6, 0.58], 0.35 * blob(column, rows["middle"], 2.1, 4.2, 0.16, 0.9))
    # Brows: between the rows above and below, from the inner end to the temple, of short strokes.
    row = rows["upper"]
    centre = 5.52 + 0.06 * np.clip(column - 4.2, 0, None) ** 2 - 0.05 * np.sin((column - 1) * 1.1)
    thick = (0.30 + 0.10 * ramp(column, 1.0, 2.0)) * (1.0 - 0.6 * ramp(column, 3.3, 5.8))
    strokes = 0.82 + 0.10 * _noise(SIZE, (2.5, 0.7), "brow")
    inside = ramp(thick - np.abs(row - centre), -0.10, 0.22) * ramp(column, 0.9, 1.7) * (1 - ramp(column, 5.1, 5.7))
    mix(face, HAIR * 1.2, np.clip(0.9 * inside * strokes, 0, 1))
    _paint_openings(face, column, tall)
    # Hair.
    line = cage.HAIRLINE - 0.12 + 0.1 * np.cos(column * 1.2) + 0.10 * _noise(SIZE, (6, 1.0), "hairline")
    temple = ramp(column, 6.1, 7.0) * 2.4
    hair = ramp(line + temple - row, -0.18, 0.22)
    # Hair behind the ears, down to the neck.
    hair = np.maximum(hair, ramp(column, 8.3, 8.7) * (tall > 0.43))
    strands = HAIR * (1.0 + 0.22 * _noise(SIZE, (5, 0.8), "strands")[..., None])
    picture[..., :3] += hair[..., None] * (strands - picture[..., :3])


def _paint_openings(face: Array, column: Array, tall: Array) -> None:
    """Lips, the dark of the mouth, lid edges and lashes: around the two openings of the sheet."""
    mouth_v, eye_v = ROWS_V["lower"][0], ROWS_V["upper"][-1]
    half = MOUTH_LENS * np.sqrt(np.clip(1.0 - (column / cage.MOUTH_CORNER) ** 2, 0.0, None))
    fade = 1.0 - ramp(column, cage.MOUTH_CORNER - 0.15, cage.MOUTH_CORNER + 0.1)
    # The red of the lips ends at the border rows in the middle and runs into the corners.
    taper = np.clip(1.0 - (column / (cage.MOUTH_CORNER + 0.03)) ** 2.6, 0.0, 1.0) ** 0.85
    upper_border = mouth_v + (ROWS_V["middle"][-2] - mouth_v) * taper
    lower_border = mouth_v + (ROWS_V["lower"][1] - mouth_v) * taper
    lip = ramp(upper_border - tall, -0.004, 0.004) * ramp(tall - lower_border, -0.005, 0.005) * fade
    mix(face, LIP, 0.92 * lip)
    mix(face, LIP * 0.72, 0.5 * np.exp(-0.5 * ((np.abs(tall - mouth_v) - half) / 0.004) ** 2) * fade)
    inside = ramp(half - np.abs(tall - mouth_v), 0.002, 0.008)
    mix(face, MOUTH, inside * fade)
    middle, wide = 0.5 * (cage.INNER_EYE + cage.OUTER_EYE), 0.5 * (cage.OUTER_EYE - cage.INNER_EYE)
    half = EYE_LENS * np.sqrt(np.clip(1.0 - ((column - middle) / wide) ** 2, 0.0, None))
    near = ramp(column, 1.75, 2.2) * (1.0 - ramp(column, 4.9, 5.25))
    above = tall - eye_v - half
    lash = np.exp(-0.5 * ((above - 0.0015) / 0.0022) ** 2) * near * ramp(column, 2.0, 2.9)
    mix(face, HAIR * 0.6, 0.9 * lash)
    below = eye_v - half - tall
    mix(face, HAIR * 1.4, 0.45 * np.exp(-0.5 * ((below - 0.001) / 0.0016) ** 2) * near * ramp(column, 2.6, 3.6))
    mix(face, LINING, ramp(half - np.abs(tall - eye_v), 0.0, 0.002))


def tile_slices(u: Array, v: Array, box: tuple[float, float, float, float]) -> tuple[slice, slice]:
    """Rows and columns of the picture within a box (left, right, low, high)."""
    rows = np.flatnonzero((v >= box[2]) & (v <= box[3]))
    columns = np.flatnonzero((u >= box[0]) & (u <= box[1]))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def _paint_eye(picture: Array, u: Array, v: Array) -> None:
    where = tile_slices(u, v, (0.0, 0.25, 0.0, 0.25))
    x, y = np.meshgrid(u[where[1]] - 0.125, v[where[0]] - 0.125)
    angle = np.hypot(x, y) / 0.118 * 180.0
    around = np.arctan2(y, x)
    tile = picture[where]
    tile[..., :3] = [226.0, 221.0, 216.0]
    mix(tile, np.array([214.0, 150.0, 140.0]), 0.55 * ramp(angle, 40.0, 75.0))
    fibres = 0.85 + 0.15 * np.sin(37 * around) * np.sin(23 * around + 1.0)
    iris = np.array([104.0, 74.0, 44.0]) * fibres[..., None]
    amount = (1.0 - ramp(angle, 22.0, 24.5))[..., None]
    tile[..., :3] += amount * (iris - tile[..., :3])
    mix(tile, np.array([40.0, 28.0, 18.0]), 0.8 * np.exp(-0.5 * ((angle - 22.5) / 1.3) ** 2))
    mix(tile, np.array([8.0, 6.0, 6.0]), 1.0 - ramp(angle, 9.0, 10.5))
    mix(tile, np.array([255.0, 255.0, 255.0]), 0.9 * blob(x, y, 0.0, 0.0075, 0.0022, 0.0022))


def _paint_teeth(picture: Array, u: Array, v: Array) -> None:
    where = tile_slices(u, v, (0.251, 0.499, 0.0, 0.124))
    along, down = np.meshgrid((u[where[1]] - 0.375) / 0.118, (0.118 - v[where[0]]) / 0.11)
    place = np.abs(along) * 8.0
    within = np.abs(place - np.floor(place) - 0.5) * 2.0
    edge = np.clip(down, 0, 1)
    tile = picture[where]
    # In the shade of the lips, and darker towards the back of the mouth, where no light gets.
    shade = 1.0 - 0.25 * ramp(within, 0.7, 1.0) - 0.55 * ramp(place, 1.5, 5.0)
    tile[..., :3] = np.array([214.0, 204.0, 184.0]) * shade[..., None]
    mix(tile, np.array([190.0, 96.0, 96.0]), 1.0 - ramp(edge + 0.12 * within**2, 0.10, 0.16))
    # Corners of the crowns are rounded: nothing there.
    corner = ramp(edge, 0.93, 1.0) * ramp(within, 0.7, 1.0)
    tile[..., 3] = 255.0 * (1.0 - ramp(corner, 0.25, 0.5)) * (1.0 - ramp(down, 0.985, 1.0))


def _paint_ears(picture: Array, u: Array, v: Array) -> None:
    where = tile_slices(u, v, (0.251, 0.499, 0.13, 0.25))
    share = np.broadcast_to((u[where[1]] - 0.26) / 0.23, picture[where].shape[:2])
    tile = picture[where]
    tile[..., :3] = SKIN * [0.98, 0.93, 0.92]
    mix(tile, SKIN * [0.62, 0.5, 0.48], 0.8 * (1.0 - ramp(share, 0.05, 0.22)))
    mix(tile, SKIN * [0.75, 0.62, 0.6], 0.45 * np.exp(-0.5 * ((share - 0.42) / 0.05) ** 2))


def _paint_plate(picture: Array, u: Array, v: Array) -> None:
    """Hair around the skull; nothing elsewhere."""
    where = tile_slices(u, v, (0.5, 1.0, 0.0, 0.2425))
    x, y = np.meshgrid((u[where[1]] - 0.505) / 0.49 * 220.0 - 110.0, (v[where[0]] - 0.005) / 0.235 * 315.0 - 150.0)
    tile = picture[where]
    noise = _noise(SIZE, (2.5, 0.8), "plate")[: tile.shape[0], : tile.shape[1]]
    tile[..., :3] = HAIR * (0.85 + 0.15 * noise[..., None])
    # An upright egg about the skull, a few millimetres wider than the mask.
    egg = np.hypot(x / 83.5, (y - 60.0) / 93.5)
    tile[..., 3] = 255.0 * (1.0 - ramp(egg + 0.006 * noise, 0.985, 1.015))
    tile[y > 164.0, 3] = 0.0
