"""A slow, obvious renderer of videos with known head pose: one ray a sample, nothing shared with evalkit.

The camera stands at the origin and looks along -z, x to the right of the picture, y up; a pixel's middle is at +0.5.
The head is an upright cylinder or an ellipsoid about its own origin with a texture drawn on it by angle and height; a
solid rectangle in front of the camera may pass, and the mouth may open.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import Rotation

RADIUS_MM = 72.0
EYE_HEIGHT_MM = 20.0
MOUTH_HEIGHT_MM = -45.0

SPOTS = {
    # name: angle to the person's left in degrees, height in mm
    "brow inner": (9, 45), "brow outer": (51, 42), "eye inner": (15, 21), "eye outer": (39, 22),
    "upper lid": (27, 26), "lower lid": (27, 17), "nose wing": (11, -25), "mouth corner": (20, -46),
    "nose tip": (0, -12), "upper lip": (0, -38), "lower lip": (0, -53),
}  # fmt: skip
ORDER = (
    "brow inner left", "brow outer left", "brow inner right", "brow outer right",
    "eye inner left", "eye outer left", "upper lid left", "lower lid left",
    "eye inner right", "eye outer right", "upper lid right", "lower lid right",
    "nose tip", "nose wing left", "nose wing right",
    "upper lip", "lower lip", "mouth corner left", "mouth corner right",
)  # fmt: skip


@dataclass
class Film:
    """What is filmed, and with what camera."""

    axes_mm: tuple[float, float, float] = (RADIUS_MM, np.inf, RADIUS_MM)
    """Half axes of the ellipsoid; an infinite one in the middle makes it a cylinder."""
    half_height_mm: float = 105.0
    width: int = 176
    height: int = 144
    focal_px: float = 240.0
    seed: int = 0
    shading: float = 0.0
    """0: none; 1: as dark as can be at the side away from a light that stands still beside the camera."""
    noise_grey: float = 2.0
    samples: int = 2
    """Rays along each side of a pixel."""
    texture: np.ndarray = field(init=False, repr=False)
    background: np.ndarray = field(init=False, repr=False)

    def __post_init__(self):
        draw = np.random.default_rng([self.seed, 1])
        self.texture = face_texture(draw)
        self.background = 110 + 45 * band(draw, (self.height, self.width), (3, 10))
        self.noise = np.random.default_rng([self.seed, 2])


def band(draw, shape, sigmas):
    """Random pattern of several sizes, standard deviation 1."""
    total = sum(gaussian_filter(draw.standard_normal(shape), s, mode="wrap") * s for s in sigmas)
    return (total - total.mean()) / total.std()


DEGREES = np.linspace(-180, 180, 361)
HEIGHTS = np.linspace(-130, 130, 261)


def face_texture(draw):
    """Grey levels by height (rows, from below) and angle (columns): skin, dark brows, eyes, nostrils and lips."""
    angle, height = np.meshgrid(DEGREES, HEIGHTS)
    grey = 150 + 9 * band(draw, angle.shape, (2, 6, 15))

    def blot(at, size, depth):
        nonlocal grey
        distance = ((angle - at[0]) / size[0]) ** 2 + ((height - at[1]) / size[1]) ** 2
        grey = grey - depth / (1 + np.exp(np.minimum(6 * (distance - 1), 50)))

    for side in (-1, 1):
        blot((side * 30, 45), (20, 4), 60)
        blot((side * 27, 21), (11, 4), -40)
        blot((side * 27, 21), (4.5, 4.5), 110)
        blot((side * 7, -24), (4, 3), 50)
        blot((side * 90, 0), (12, 25), 35)
    blot((0, MOUTH_HEIGHT_MM), (20, 6), 45)
    blot((0, MOUTH_HEIGHT_MM), (19, 1.2), 40)
    hair = 70 / (1 + np.exp(-(height - 78 + 4 * np.sin(np.radians(angle * 9))) / 3))
    return grey - hair * (1 + 0.2 * band(draw, angle.shape, (1, 2.5)))


def texture_at(film, angle, height, opening_mm):
    """Texture as skin that moves: below the mouth it goes down with the jaw, and between the lips it is dark."""
    if opening_mm > 0:
        across = np.exp(-((angle / 28.0) ** 2))
        gap = opening_mm * across
        below = np.clip((MOUTH_HEIGHT_MM - height) / np.maximum(gap, 1e-6), 0, 1)
        fade = np.clip((height + 105.0) / (105.0 + MOUTH_HEIGHT_MM), 0, 1)
        inside = (height < MOUTH_HEIGHT_MM) & (height > MOUTH_HEIGHT_MM - gap) & (np.abs(angle) < 22)
        height = height + below * gap * fade
    rows = (height - HEIGHTS[0]) / (HEIGHTS[1] - HEIGHTS[0])
    columns = (angle - DEGREES[0]) / (DEGREES[1] - DEGREES[0])
    grey = map_coordinates(film.texture, [rows, columns], order=1, mode="nearest")
    return np.where(inside, 25.0, grey) if opening_mm > 0 else grey


def render(film, rotation, translation, opening_mm=0.0, occluder=None):
    """One frame (H, W) of uint8. The occluder is (x, y, half width, half height) in pixels, textured, or None."""
    n = film.samples
    v, u = np.meshgrid((np.arange(film.height * n) + 0.5) / n, (np.arange(film.width * n) + 0.5) / n, indexing="ij")
    right, up = (u - 0.5 * film.width) / film.focal_px, (0.5 * film.height - v) / film.focal_px
    rays = np.stack([right, up, -np.ones_like(u)], -1)
    picture = map_coordinates(film.background, [v - 0.5, u - 0.5], order=1, mode="nearest")
    if rotation is not None:
        # The ray o + s d in the head's own axes, scaled so that the surface is the unit sphere or cylinder.
        scale = 1.0 / np.array(film.axes_mm)
        origin = -(rotation.T @ translation)
        way = rays @ rotation
        o, d = origin * scale, way * scale
        a, b, c = (d * d).sum(-1), d @ o, o @ o - 1.0
        root = b * b - a * c
        hit = root > 0
        s = (-b - np.sqrt(np.where(hit, root, 0.0))) / a
        place = origin + s[..., None] * way
        hit &= (s > 0) & (np.abs(place[..., 1]) < film.half_height_mm)
        place = place[hit]
        angle = np.degrees(np.arctan2(place[:, 0] / film.axes_mm[0], place[:, 2] / film.axes_mm[2]))
        grey = texture_at(film, angle, place[:, 1], opening_mm)
        normal = place * scale**2
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True) @ rotation.T
        light = np.array([0.6, 0.3, 0.75]) / np.linalg.norm([0.6, 0.3, 0.75])
        picture[hit] = grey * (1 - film.shading + film.shading * (0.15 + 0.95 * np.clip(normal @ light, 0, 1)))
    if occluder is not None:
        x, y, half_width, half_height = occluder
        covered = (np.abs(u - x) < half_width) & (np.abs(v - y) < half_height)
        # Its pattern goes along with it.
        pattern = 50 * np.sin((u - x) / 4.0) * np.cos((v - y) / 5.0) + 20 * np.sin((u - x) / 11)
        picture[covered] = 95 + pattern[covered]
    picture = picture.reshape(film.height, n, film.width, n).mean(axis=(1, 3))
    picture = picture + film.noise_grey * film.noise.standard_normal(picture.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def spots_mm(film):
    """The 19 points on the surface, head axes, (19, 3)."""
    out = []
    for name in ORDER:
        side = -1 if name.endswith("right") else 1
        angle, height = SPOTS[name.removesuffix(" left").removesuffix(" right")]
        angle = np.radians(side * angle)
        shrink = np.sqrt(1 - (height / film.axes_mm[1]) ** 2)
        out.append([film.axes_mm[0] * shrink * np.sin(angle), height, film.axes_mm[2] * shrink * np.cos(angle)])
    return np.array(out)


def spots_px(film, rotation, translation):
    """Where the 19 points are seen, (19, 2)."""
    x, y, z = (spots_mm(film) @ rotation.T + translation).T
    return np.stack([0.5 * film.width - film.focal_px * x / z, 0.5 * film.height + film.focal_px * y / z], -1)


def turns(pitch_deg, yaw_deg, roll_deg):
    """Rotations about x, y and z, the roll applied first; positive yaw to the person's left, positive pitch down."""
    angles = np.stack(np.broadcast_arrays(yaw_deg, pitch_deg, roll_deg), -1)
    return Rotation.from_euler("YXZ", angles, degrees=True).as_matrix()


def angles_deg(rotations):
    """Pitch, yaw and roll of rotations, (..., 3)."""
    return Rotation.from_matrix(rotations).as_euler("YXZ", degrees=True)[..., [1, 0, 2]]


def apart_deg(first, second):
    """Angle between rotations, degrees; NaN where one is unknown."""
    known = np.isfinite(first).all(axis=(-2, -1)) & np.isfinite(second).all(axis=(-2, -1))
    out = np.full(len(first), np.nan)
    out[known] = np.degrees(Rotation.from_matrix(first[known].transpose(0, 2, 1) @ second[known]).magnitude())
    return out
