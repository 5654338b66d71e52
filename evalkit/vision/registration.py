"""Registration of a textured surface to a picture: Gauss-Newton on intensity differences.

With texture ``t`` and the picture unwrapped onto the surface at the current pose, ``I``, both normalised by their local
mean and contrast, the pose minimises ``sum w (I - t)^2``. A small motion of the head moves a point P by
``d = omega x P + v``; along the line of sight that is a slide ``d - e (n . d)/(n . e)`` in the surface (n the normal,
e the direction of sight), so that ``I`` changes by the gradient of the texture along the slide. The gradient is the
mean of those of ``I`` and ``t`` (Benhimane & Malis 2007, doi:10.1177/0278364907080252: second order at the price of
the first). The weights ``w`` are the product of

- visibility: the cosine of the angle between normal and line of sight, 0 outside of the picture;
- how rigid the place is (a mouth is not);
- agreement: the correlation of ``I`` and ``t`` in a window, which an occluder destroys over all of its area;
- the robust weight of the single difference, 1 up to a bound and falling with its square beyond, by iteratively
  reweighted least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np

from evalkit.geometry import Array
from evalkit.vision.camera import Camera
from evalkit.vision.surface import LEVELS, Grid, Levels, Map, Surface
from evalkit.vision.tracker import Picture

GRAZING = (0.3, 0.6)
"""Cosines between which a place turned away from the camera gains its full weight: nearer to the rim a pixel of the
reduced picture holds background, which stood still and pulled the yaw by a degree."""

WINDOW = 0.18
"""Side of the window of local contrast, of the grid's side: about the width of an eye with its brow."""

LEAST_WINDOW = 5
"""Places along the side of that window on the coarse grids: a plane takes three, the rest is the texture."""

CONTRAST_FLOOR = 3.0
"""Grey levels added to the local contrast: flat skin with the noise of a sensor is no texture."""

SHARP_WINDOWS = (0.12, 0.53)
"""Sides of the windows of :func:`sharpness`, of the grid's side: an eye's height, and half a face."""

AGREEMENT_WINDOW = 0.14
"""Side of the window of local correlation, of the grid's side."""

AGREEMENT = (0.1, 0.6)
"""Correlations between which a window gains its full weight."""

LEAST_AGREEMENT = 0.03
"""Weight that disagreement leaves: where all disagrees because the start is far off, something must still pull."""

ROBUST = 2.0
"""Differences of up to this many standard deviations count fully: weights that fall at once make Gauss-Newton's steps
too short."""

SPREAD = (0.1, 0.5)
"""Bounds of the standard deviation of the differences: half of the pixels may be occluded."""


PIXELS_PER_SPACING = 1.2
"""Pixels of the reduced picture that is read, between two places of the grid, as near as halving comes."""

COARSEST_PICTURE = 5
"""Most times that a frame is halved."""

DAMPING = 1e-4
COARSE_DAMPING = 0.05
"""Share of the mean diagonal that is added to the normal matrix. Coarse grids cannot tell a small yaw from a move
sideways: there that direction is held, or the finest grid would start from a worse place than the prediction."""

OVER = 1.2
"""Steps are made longer by this factor: along the same direction reweighting makes them too short."""

LEAST_STEP = 0.02
"""Share of the grid's spacing: what moves less is done, noise moves it as much."""

UNITS = np.array([80.0, 80.0, 80.0, 1.0, 1.0, 1.0])
"""A radian moves the skin by about this many mm: in these units all six parameters are of one size."""


class Texture(NamedTuple):
    """What a frame showed of the surface at one level.

    Attributes
    ----------
    grey : ndarray, shape (H, W)
    weight : ndarray, shape (H, W)
        0 where the place was not seen, 1 where it was seen squarely.
    """

    grey: Map
    weight: Map


Template = Sequence[Texture]
"""Texture of the surface at every level, finest first."""


@dataclass(frozen=True)
class Fit:
    """Where a registration ended.

    Attributes
    ----------
    rotation, translation : ndarray
    score : float
        Mean correlation of picture and texture over what the texture could show, 1 where they agree wholly.
    agreement : ndarray, shape (H, W)
        Weight of each place of the finest level by local correlation.
    seen : ndarray, shape (H, W)
        The picture unwrapped, grey levels, finest level.
    visible : ndarray, shape (H, W)
    """

    rotation: Array
    translation: Array
    score: float
    agreement: Map
    seen: Map
    visible: Map


class View:
    """One frame, reduced by halves, and unwrapped on demand."""

    def __init__(self, frame: Picture, camera: Camera) -> None:
        grey = frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        self._levels: dict[int, Map] = {0: grey.astype(np.float32)}
        self._camera = camera

    def picture(self, level: int) -> Map:
        """The frame, halved ``level`` times, or as often as it was :meth:`reduced`."""
        level = max(level, min(self._levels))
        if level not in self._levels:
            self._levels[level] = np.asarray(cv2.pyrDown(self.picture(level - 1)), dtype=np.float32)
        return self._levels[level]

    def level_for(self, spacing_mm: float, distance_mm: float) -> int:
        """How often the frame is halved until a pixel is about as wide as a length on the head."""
        pixels = spacing_mm * self._camera.focal_px / max(distance_mm, 1.0)
        level = int(np.clip(round(np.log2(max(pixels, 1e-6) / PIXELS_PER_SPACING)), 0, COARSEST_PICTURE))
        return max(level, min(self._levels))

    def reduced(self, grid: Grid, translation: Array) -> View:
        """The same without what is finer than a grid at about that place reads: small enough to be kept."""
        level = self.level_for(grid.spacing_mm, -float(translation[2]))
        small = copy(self)
        small._levels = {level: self.picture(level)}
        return small

    def project(self, grid: Grid, rotation: Array, translation: Array) -> Array:
        """Pixels (H, W, 2) of a surface's places at a pose."""
        return self._camera.project(grid.points @ rotation.T + translation).reshape(*grid.shape, 2)

    def unwrap(self, grid: Grid, rotation: Array, translation: Array) -> tuple[Map, Map]:
        """Grey levels (H, W) of a surface at a pose, and whether each place is inside of the picture (0 or 1)."""
        camera = self._camera
        placed = rotation.astype(np.float32) @ grid.points.T + translation.astype(np.float32)[:, None]
        level = self.level_for(grid.spacing_mm, -float(translation[2]))
        picture = self.picture(level)
        scale = 1.0 / (1 << level)
        x, y, z = placed
        nearness = np.float32(camera.focal_px * scale) / np.minimum(z, np.float32(-1.0))
        u = x * -nearness + np.float32((camera.centre_px[0] - 0.5) * scale)
        v = y * nearness + np.float32((camera.centre_px[1] - 0.5) * scale)
        grey = np.asarray(
            cv2.remap(
                picture, u.reshape(grid.shape), v.reshape(grid.shape), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            ),
            dtype=np.float32,
        )
        height, width = picture.shape
        if u.min() > 0 and v.min() > 0 and u.max() < width - 1 and v.max() < height - 1 and z.max() < -1.0:
            return grey, np.ones(grid.shape, np.float32)
        inside = (u > 0) & (v > 0) & (u < width - 1) & (v < height - 1) & (z < -1.0)
        return grey, inside.reshape(grid.shape).astype(np.float32)

    def template(self, surface: Surface, rotation: Array, translation: Array, own: Map | None = None) -> Template:
        """What this frame shows on a surface, if told with a weight (H, W) of what belongs to it."""

        def made(level: int) -> Texture:
            grid = surface.grids[level]
            grey, inside = self.unwrap(grid, rotation, translation)
            weight = inside * facing(grid, sight_of(grid, rotation, translation))
            if own is not None:
                weight *= cv2.resize(own, grid.shape[::-1], interpolation=cv2.INTER_AREA)
            return Texture(grey, weight)

        return Levels(made)


def sight_of(grid: Grid, rotation: Array, translation: Array) -> Map:
    """Directions from the camera to each place, in the head's axes, (3, N)."""
    ray = grid.points.T + (translation @ rotation).astype(np.float32)[:, None]
    return np.asarray(ray / np.sqrt(_dot(ray, ray)))


def facing(grid: Grid, sight: Map) -> Map:
    """Weight of each place by the angle at which it is seen, (H, W)."""
    cosine = -_dot(grid.normals.T, sight)
    return _clipped((cosine - np.float32(GRAZING[0])) * np.float32(1 / (GRAZING[1] - GRAZING[0])), 0.0).reshape(
        grid.shape
    )


def _dot(one: Map, other: Map) -> Map:
    """Scalar products of vectors (3, N)."""
    return np.asarray(one[0] * other[0] + one[1] * other[1] + one[2] * other[2])


def _clipped(values: Map, low: float) -> Map:
    """Between a bound and 1; numpy's own takes longer than everything else that is done with maps of this size."""
    return np.minimum(np.maximum(values, np.float32(low)), np.float32(1.0))


class LocalContrast:
    """Normalisation of textures within one mask: less a plane fitted around each place, over the contrast left.

    A plane and not a mean, because at the rim of the mask the window is one-sided: a shadow that stands still would
    leave a pattern there that stands still, too.

    Parameters
    ----------
    weight : ndarray, shape (H, W)
        Places of weight 0 do not count.
    """

    def __init__(self, weight: Map) -> None:
        self._size = max(_odd(WINDOW * len(weight)), LEAST_WINDOW)
        self._weight = weight
        side = (np.arange(len(weight), dtype=np.float32) - np.float32(0.5 * len(weight))) / np.float32(self._size)
        self._x, self._y = np.broadcast_to(side, weight.shape), np.broadcast_to(side[:, None], weight.shape)
        x, y = self._x, self._y
        self._wx, self._wy = weight * x, weight * y
        m, mx, my = (box_mean(values, self._size) for values in (weight, self._wx, self._wy))
        self._mass = m + np.float32(1e-3)
        mx, my = mx / self._mass, my / self._mass
        xx, xy, yy = (box_mean(weight * values, self._size) / self._mass for values in (x * x, x * y, y * y))
        # Moments about the middle of what the window sees; the floor keeps a window with a sliver from a steep plane.
        floor = np.float32(0.002)
        xx, xy, yy = xx - mx * mx + floor, xy - mx * my, yy - my * my + floor
        scale = 1.0 / (xx * yy - xy * xy)
        self._mx, self._my = mx, my
        dx, dy = x - mx, y - my
        # The plane's value at the place itself is mean + cx * cov(x) + cy * cov(y).
        self._cx, self._cy = (yy * dx - xy * dy) * scale, (xx * dy - xy * dx) * scale

    def __call__(self, texture: Map) -> Map:
        """Texture (H, W) normalised; 0 outside of the mask."""
        size, mass, w = self._size, self._mass, self._weight
        mean = box_mean(w * texture, size) / mass
        along_x = box_mean(self._wx * texture, size) / mass - self._mx * mean
        along_y = box_mean(self._wy * texture, size) / mass - self._my * mean
        rest = texture - (mean + self._cx * along_x + self._cy * along_y)
        variance = box_mean(w * rest * rest, size) / mass
        return (rest / np.sqrt(variance + np.float32(CONTRAST_FLOOR**2))) * (w > 0)


class Plain:
    """Textures as they are, in units of a usual contrast: what the tracker is without :class:`LocalContrast`."""

    def __init__(self, weight: Map) -> None:
        self._seen = weight > 0

    def __call__(self, texture: Map) -> Map:
        """Texture (H, W) in units of 40 grey levels; 0 outside of the mask."""
        return (texture - np.float32(128.0)) / np.float32(40.0) * self._seen


def box_mean(values: Map, size: int) -> Map:
    """Mean over a square window about each place, of an odd size; 0 beyond the rim.

    Two products with a band of ones, which on maps as small as these take half the time of a filter.
    """
    band = _band(len(values), size)
    return np.asarray(band @ values @ band)


@cache
def _band(count: int, size: int) -> Map:
    place = np.arange(count)
    return (np.abs(place[:, None] - place) <= size // 2).astype(np.float32) / np.float32(size)


def _odd(size: float) -> int:
    return 2 * int(size / 2) + 1


def sharpness(texture: Map, weight: Map) -> float:
    """Contrast of eyes, brows, nostrils and lips over that of light and shade, 0 where there is nothing to be seen.

    Standard deviation of what a window of some 20 mm takes out of the texture, over that of what is left of it in
    windows of 100 mm. Smears of an encoder and a lens out of focus take the first and leave the second.

    Parameters
    ----------
    texture : ndarray, shape (H, W)
        Grey levels, finest level.
    weight : ndarray, shape (H, W)
    """
    fine, coarse = (_odd(part * len(texture)) for part in SHARP_WINDOWS)
    smooth, light = (
        box_mean(weight * texture, size) / (box_mean(weight, size) + np.float32(1e-3)) for size in (fine, coarse)
    )
    detail, shade = (float((weight * (values * values)).sum()) for values in (texture - smooth, smooth - light))
    floor = CONTRAST_FLOOR**2 * float(weight.sum())
    return float(np.sqrt(detail / shade)) if shade > floor else 0.0


def agreement_of(seen: Map, texture: Map, weight: Map) -> tuple[Map, Map]:
    """Correlation of two textures in a window about each place, and how much texture there is to compare."""
    size = _odd(AGREEMENT_WINDOW * len(texture))
    product = box_mean(weight * seen * texture, size)
    energy = box_mean(weight * texture * texture, size)
    other = box_mean(weight * seen * seen, size)
    mass = box_mean(weight, size) + np.float32(1e-3)
    # The floor keeps windows without texture from a correlation of noise.
    return product / np.sqrt((energy + 0.05 * mass) * (other + 0.05 * mass)), energy / mass


def register(
    view: View,
    surface: Surface,
    template: Template,
    rigid: tuple[Map, ...],
    rotation: Array,
    translation: Array,
    iterations: tuple[int, ...] = (4, 4, 4),
    normalised: bool = True,
    robust: bool = True,
) -> Fit:
    """Fit the pose of a textured surface to a picture, from a start.

    Parameters
    ----------
    view : View
    surface : Surface
    template : sequence of Texture
    rigid : tuple of ndarray, shape (H, W)
        Weight of each place, by level.
    rotation, translation : ndarray, shape (3, 3) and (3,)
        Start.
    iterations : tuple of int
        At most, by level, finest first; 0 leaves a level out.
    normalised, robust : bool
        See :class:`evalkit.vision.cylinder.Settings`.

    Returns
    -------
    Fit
    """
    start = (rotation, translation)
    for level in range(LEVELS - 1, -1, -1):
        if not iterations[level]:
            continue
        grid = surface.grids[level]
        sight = sight_of(grid, rotation, translation)
        # One window of contrast for both, or what comes into sight at the rim would pull the middle along.
        front = facing(grid, sight)
        known = template[level]
        grey, inside = view.unwrap(grid, rotation, translation)
        common = known.weight * front * inside
        normalise = LocalContrast(common) if normalised else Plain(common)
        texture = normalise(known.grey)
        slides = _slides(grid, sight)
        base = common * rigid[level]
        for _ in range(iterations[level]):
            seen = normalise(grey)
            weight = base * inside
            if robust:
                weight = weight * _weights(seen, texture, weight)
            step = _step(slides, seen, texture, weight, COARSE_DAMPING if level else DAMPING)
            step *= OVER
            rotation = rotation @ cv2.Rodrigues(step[:3])[0]
            translation = translation + rotation @ step[3:]
            grey, inside = view.unwrap(grid, rotation, translation)
            if np.abs(step * UNITS).max() < LEAST_STEP * grid.spacing_mm:
                break
    if not _sane(rotation, translation):
        return judge(view, surface, template, rigid, *start, normalised)
    # The last steps are short: what was in sight before them is in sight now.
    visible = inside * front
    return _fit(rotation, translation, normalise(grey), texture, grey, visible, known.weight * rigid[level])


def judge(
    view: View,
    surface: Surface,
    template: Template,
    rigid: tuple[Map, ...],
    rotation: Array,
    translation: Array,
    normalised: bool = True,
) -> Fit:
    """How well a picture agrees with a textured surface at a pose."""
    grid = surface.grids[0]
    grey, inside = view.unwrap(grid, rotation, translation)
    visible = inside * facing(grid, sight_of(grid, rotation, translation))
    known = template[0]
    common = known.weight * visible
    normalise = LocalContrast(common) if normalised else Plain(common)
    seen, texture = normalise(grey), normalise(known.grey)
    return _fit(rotation, translation, seen, texture, grey, visible, known.weight * rigid[0])


def _fit(rotation: Array, translation: Array, seen: Map, texture: Map, grey: Map, visible: Map, worth: Map) -> Fit:
    """The fit of a pose at which both textures are known, normalised, and what each place is worth if it is seen."""
    correlation, energy = agreement_of(seen, texture, worth * visible)
    # Places that the template shows and the picture does not are no evidence for the pose.
    worth = np.minimum(energy, 1.0) * worth
    score = float((worth * visible * correlation).sum() / max(float(worth.sum()), 1e-6))
    return Fit(rotation, translation, score, _agreeing(correlation), grey, visible)


def _agreeing(correlation: Map) -> Map:
    low, high = AGREEMENT
    return _clipped((correlation - np.float32(low)) * np.float32(1 / (high - low)), LEAST_AGREEMENT)


def _weights(seen: Map, texture: Map, weight: Map) -> Map:
    agreeing = _agreeing(agreement_of(seen, texture, weight)[0])
    difference = np.abs(seen - texture)
    counted = difference[weight * agreeing > 0.25]
    # The middle of a sample of them is as good.
    counted = counted[:: max(1, counted.size // 512)]
    spread = 1.4826 * float(np.partition(counted, counted.size // 2)[counted.size // 2]) if counted.size > 32 else 1.0
    spread = min(max(spread, SPREAD[0]), SPREAD[1])
    return agreeing * np.square(np.minimum(1.0, np.float32(ROBUST * spread) / (difference + np.float32(1e-6))))


def _slides(grid: Grid, sight: Map) -> tuple[Map, Map]:
    """How far each place's column and row move under the six small motions of the head, (6, N) each."""
    normals, (x, y, z) = grid.normals.T, grid.points.T
    slope = np.float32(-1.0) / np.minimum(_dot(normals, sight), np.float32(-0.05))
    out = np.empty((2, 6, len(x)), np.float32)
    for slides, along in zip(out, (grid.along_row.T, grid.along_column.T), strict=True):
        pull = slides[3:]
        np.multiply(normals, _dot(along, sight) * slope, out=pull)
        pull += along
        a, b, c = pull
        slides[0], slides[1], slides[2] = y * c - z * b, z * a - x * c, x * b - y * a
    return out[0], out[1]


def gradients(texture: Map) -> tuple[Map, Map]:
    """Differences along columns and rows, smoothed across: noise in them would pass for information."""
    across = cv2.Sobel(texture, -1, 1, 0, scale=0.125, borderType=cv2.BORDER_REPLICATE)
    down = cv2.Sobel(texture, -1, 0, 1, scale=0.125, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(across, dtype=np.float32), np.asarray(down, dtype=np.float32)


def _step(slides: tuple[Map, Map], seen: Map, texture: Map, weight: Map, damping: float) -> Array:
    """One Gauss-Newton step: rotation vector (rad) and translation (mm) in the head's axes."""
    across, down = gradients(np.float32(0.5) * (seen + texture))
    jacobian = slides[0] * across.ravel()
    jacobian += slides[1] * down.ravel()
    weighted = jacobian * weight.ravel()
    matrix = (weighted @ jacobian.T).astype(np.float64) / np.outer(UNITS, UNITS)
    right = -(weighted @ (seen - texture).ravel()).astype(np.float64) / UNITS
    # A little damping for what nothing shows; with no weight at all nothing moves.
    matrix += (damping * np.trace(matrix) / 6 + 1e-9) * np.eye(6)
    return np.linalg.solve(matrix, right) / UNITS


def _sane(rotation: Array, translation: Array) -> bool:
    """Whether a pose is one, and before the camera."""
    return bool(np.isfinite(rotation).all() and np.isfinite(translation).all() and translation[2] < -50.0)
