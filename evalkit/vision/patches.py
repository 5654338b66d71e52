"""Patches about the 19 points in the frontal view: reading them, and the references that they are compared with.

Grey levels count less their weighted mean and over their weighted standard deviation, so that light does not.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from evalkit.geometry import Array
from evalkit.vision.anatomy import POINT_KINDS, UPRIGHT
from evalkit.vision.frontal import PIXEL_MM, Map
from evalkit.vision.points import FACE_POINTS

HALF = 9
"""Pixels of a patch to each side of its middle: an eye is about 26 wide and 10 high."""

REFERENCES = 6
"""References that a point may have: neutral, and what a mouth or an eye shows besides."""

FLOOR = 4.0
"""Grey levels that count as contrast in any patch: noise on smooth skin is no texture."""

COARSE = HALF // 2
"""The same patch at half resolution."""

_COUNT = len(FACE_POINTS)


def _weights(half: int, scale: float) -> Map:
    """Weights of the pixels of every patch, (19, side²), with sum 1; rows go down."""
    steps = scale * np.arange(-half, half + 1)
    rows = []
    for name, kind in zip(FACE_POINTS, POINT_KINDS, strict=True):
        outward = kind.middle_mm[0] if name.endswith("left") else -kind.middle_mm[0]
        x = np.exp(-0.5 * ((steps - outward) / kind.width_mm[0]) ** 2)
        y = np.exp(-0.5 * ((-steps - kind.middle_mm[1]) / kind.width_mm[1]) ** 2)
        rows.append(np.outer(y, x).ravel())
    out = np.array(rows)
    return (out / out.sum(axis=1, keepdims=True)).astype(np.float32)


def _grid(half: int) -> tuple[Map, Map]:
    x, y = np.meshgrid(*2 * [np.arange(-half, half + 1, dtype=np.float32)])
    return x.ravel(), y.ravel()


WEIGHT = _weights(HALF, PIXEL_MM)
COARSE_WEIGHT = _weights(COARSE, 2 * PIXEL_MM)
"""Shape (19, pixels of a patch), sum 1."""

_X, _Y = _grid(HALF)
_COARSE_GRID = _grid(COARSE)


class References:
    """Pictures of each point's patch that it may look like, with what registration needs of them.

    Parameters
    ----------
    form_stiffness : ndarray, shape (19,)
        What the entries of a patch's affine matrix are held by, see :mod:`evalkit.vision.features`.

    Attributes
    ----------
    generation : ndarray of int, shape (19, REFERENCES)
        0 for the neutral face; one more than that of the reference by which it was found; -1 where there is none.
    coarse : ndarray, shape (19, REFERENCES, pixels)
        Patches at half resolution.
    relative : ndarray, shape (19, REFERENCES)
        :func:`relative_contrast` of those.
    texture : ndarray, shape (19, REFERENCES, pixels)
    descent : ndarray, shape (19, REFERENCES, 6, pixels)
        Weighted change of the patch with x, y and the four entries of the matrix.
    moves, mixed, cross, form : ndarray, shapes (..., 2, 2), (..., 2, 4), (..., 2, 4), (..., 4, 4)
        With the normal equations ``[[A, B], [B', D]]`` of place and matrix: ``A - B D^-1 B'``, ``B D^-1``, ``B``,
        ``D^-1``.
    """

    def __init__(self, form_stiffness: Array) -> None:
        size = (_COUNT, REFERENCES)
        self._stiffness = form_stiffness
        self.generation = np.full(size, -1)
        self._used = np.zeros(size, dtype=int)
        self.coarse = np.zeros((*size, (2 * COARSE + 1) ** 2), dtype=np.float32)
        self.relative = np.zeros(size, dtype=np.float32)
        self.texture = np.zeros((*size, (2 * HALF + 1) ** 2), dtype=np.float32)
        self.descent = np.zeros((*size, 6, (2 * HALF + 1) ** 2), dtype=np.float32)
        self.moves = np.zeros((*size, 2, 2))
        self.mixed = np.zeros((*size, 2, 4))
        self.cross = np.zeros((*size, 2, 4))
        self.form = np.zeros((*size, 4, 4))

    def use(self, points: NDArray[np.intp], slots: NDArray[np.intp], clock: int) -> None:
        """Note which references were of use."""
        self._used[points, slots] = clock

    def add(
        self, seen: Map, half: Map, points: NDArray[np.intp], place: Array, generation: NDArray[np.int_], clock: int
    ) -> None:
        """Make the patches at places (N, 2) of a frontal view, in full and half resolution, references of N points."""
        # The neutral one is never given up; of the others, the one that was of use longest ago.
        age = np.where(self.generation < 0, -1, self._used)[points]
        age[self.generation[points] == 0] = np.iinfo(int).max
        slots = age.argmin(axis=1)
        weight = WEIGHT[points]
        still = np.repeat(np.eye(2)[None], len(points), axis=0)
        texture, contrast = normalised(read(seen, place, still), weight)
        x, y = (
            0.5 * (read(seen, place + step, still) - read(seen, place - step, still)) / contrast for step in np.eye(2)
        )
        images = np.stack([x, y, x * _X, x * _Y, y * _X, y * _Y], axis=1)
        # What a change of brightness or contrast would do is taken out: both are normalised away in every frame.
        images = images - np.matmul(images, weight[:, :, None])
        images = images - np.matmul(images, (weight * texture)[:, :, None]) * texture[:, None]
        images[UPRIGHT[points], 0] = 0.0
        descent = weight[:, None] * images
        hessian = np.matmul(descent, images.transpose(0, 2, 1)).astype(np.float64)
        cross = hessian[:, :2, 2:]
        form = np.linalg.inv(hessian[:, 2:, 2:] + self._stiffness[points, None, None] * np.eye(4))
        mixed = np.matmul(cross, form)
        at = (points, slots)
        self.moves[at] = hessian[:, :2, :2] - np.matmul(mixed, cross.transpose(0, 2, 1))
        self.mixed[at], self.form[at], self.cross[at] = mixed, form, cross
        self.texture[at], self.descent[at] = texture, descent
        coarse = _read(half, place / 2 - 0.25, still, *_COARSE_GRID)
        self.coarse[at], contrast = normalised(coarse, COARSE_WEIGHT[points])
        mean = (COARSE_WEIGHT[points] * coarse).sum(axis=1)
        self.relative[at] = relative_contrast(mean, contrast[:, 0])
        self.generation[at] = generation
        self._used[at] = clock


def halved(seen: Map) -> Map:
    """A frontal view at half resolution; place ``p`` becomes ``p / 2 - 0.25``."""
    rows, columns = seen.shape
    even = seen[: rows // 2 * 2, : columns // 2 * 2]
    return np.asarray(cv2.resize(even, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.float32)


def read(seen: Map, place: Array, matrix: Array) -> Map:
    """Grey levels of patches (N, pixels): pixel ``g`` of a patch is read at ``place + matrix g``."""
    return _read(seen, place, matrix, _X, _Y)


def _read(seen: Map, place: Array, matrix: Array, x: Map, y: Map) -> Map:
    p, m = place.astype(np.float32)[:, :, None], matrix.astype(np.float32)[..., None]
    u, v = p[:, 0] + m[:, 0, 0] * x + m[:, 0, 1] * y, p[:, 1] + m[:, 1, 0] * x + m[:, 1, 1] * y
    return np.asarray(cv2.remap(seen, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.float32)


def normalised(patches: Map, weight: Map) -> tuple[Map, Map]:
    """Patches (N, pixels) less their mean and over their contrast, and that contrast (N, 1)."""
    centred = patches - (weight * patches).sum(axis=1, keepdims=True)
    contrast = np.sqrt((weight * centred**2).sum(axis=1, keepdims=True) + np.float32(FLOOR**2))
    return centred / contrast, contrast


def relative_contrast(mean: Map, contrast: Map) -> Map:
    """Logarithm of a patch's contrast over its brightness (Weber), which a gain of the light does not change."""
    return np.asarray(np.log(contrast / (mean + np.float32(FLOOR))), dtype=np.float32)
