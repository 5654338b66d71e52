"""From a head to the face in a photo: a similarity in the picture's plane, then a warp of that plane.

The view is taken as orthographic: a photo says nothing about depth, so every place of the head moves in the plane
alone, as far as the landmarks around it, whatever its depth. Skin, lids, teeth and eyeballs stay in order that way, and
the head is folded nowhere if the plane is not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from evalkit.deform.interpolation import rbf
from evalkit.deform.kernels import euclidean, thin_plate
from evalkit.errors import EvalkitError
from evalkit.geometry import Array

RELAXATIONS = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3)
"""Weights of smoothness against the points; the first without a fold is taken. Kernel values are of order one."""

SMALLEST_AREA = 0.15
"""A place of the plane that shrinks to less than this part of its area counts as folded: its pixels would be smeared
over seven times their area."""

STEP_MM = 0.25
"""Of the finite differences that the local change of area is taken from."""


@dataclass(frozen=True)
class Similarity:
    """Head (x to the left, y up, mm) to photo (x to the right, y down, pixels): ``turn * (x, -y) * scale + shift``.

    Attributes
    ----------
    factor : complex
        Scale in pixels per mm and turn in the picture's plane, clockwise, as one complex number.
    shift : ndarray, shape (2,), pixels
    """

    factor: complex
    shift: Array

    @property
    def pixels_per_mm(self) -> float:
        """Scale."""
        return abs(self.factor)

    @property
    def roll_deg(self) -> float:
        """Turn of the head in the picture, clockwise."""
        return float(np.rad2deg(np.angle(self.factor)))

    def to_photo(self, places: Array) -> Array:
        """Pixels (..., 2) of places (..., 2 or 3), mm; the view is along z."""
        moved = self.factor * (places[..., 0] - 1j * places[..., 1])
        return np.stack([moved.real, moved.imag], axis=-1) + self.shift

    def to_head(self, pixels: Array) -> Array:
        """Places (..., 2), mm, that are seen at pixels (..., 2)."""
        off = pixels - self.shift
        back = (off[..., 0] + 1j * off[..., 1]) / self.factor
        return np.stack([back.real, -back.imag], axis=-1)


def similarity(places: Array, pixels: Array) -> Similarity:
    """The similarity from places (N, 2 or 3), mm, to pixels (N, 2) with the least squares error.

    References
    ----------
    Umeyama, "Least-squares estimation of transformation parameters between two point patterns", IEEE PAMI 13, 1991,
    doi:10.1109/34.88573; in the plane it is a regression of complex numbers.
    """
    a, b = places[:, 0] - 1j * places[:, 1], pixels[:, 0] + 1j * pixels[:, 1]
    off_a, off_b = a - a.mean(), b - b.mean()
    factor = complex(np.vdot(off_a, off_b) / np.vdot(off_a, off_a).real)
    shift = b.mean() - factor * a.mean()
    return Similarity(factor, np.array([shift.real, shift.imag]))


@dataclass(frozen=True, eq=False)
class Warp:
    """A smooth map of the plane that takes N places to others: thin-plate splines with an affine part.

    Attributes
    ----------
    source, target : ndarray, shape (N, 2), mm
    unit_mm : float
        Length that distances are measured by.
    relaxed : float
        Weight of smoothness; 0 interpolates.

    References
    ----------
    Bookstein, "Principal warps: thin-plate splines and the decomposition of deformations", IEEE PAMI 11, 1989,
    doi:10.1109/34.24792.
    """

    source: Array
    target: Array
    unit_mm: float
    relaxed: float = 0.0

    def weights(self, places: Array) -> Array:
        """Matrix (K, N) from values at the source to values at places (K, 2 or 3), mm."""
        centres, points = (_flat(p) / self.unit_mm for p in (self.source, places))
        among = thin_plate(euclidean(centres, centres)) + self.relaxed * np.eye(len(centres))
        return rbf(among, thin_plate(euclidean(points, centres)), centres, points, degree=1).weights

    def __call__(self, places: Array) -> Array:
        """Places (K, 2 or 3) with x and y moved, mm."""
        out = np.array(places, dtype=np.float64)
        out[:, :2] += self.weights(places) @ self.moves
        return out

    @cached_property
    def moves(self) -> Array:
        """Displacements (N, 2) of the source, mm."""
        return self.target - self.source

    def area_change(self, places: Array) -> Array:
        """Determinant (K,) of the map's derivative: below 0 where the plane is folded."""
        step = STEP_MM * np.eye(3)[:, : places.shape[1]]
        right, up = ((self(places + s) - self(places - s))[:, :2] / (2 * STEP_MM) for s in step[:2])
        return np.asarray(right[:, 0] * up[:, 1] - right[:, 1] * up[:, 0])


def _flat(places: Array) -> Array:
    """Places with z = 0: the kernels are those of space."""
    return np.column_stack([places[:, :2], np.zeros(len(places))])


def warp_without_folds(source: Array, target: Array, names: list[str], unit_mm: float, places: Array) -> Warp:
    """The warp that follows the points as closely as it can without folding the plane at some places (K, 2 or 3).

    Raises
    ------
    EvalkitError
        If even a loose one folds: it names the point whose surroundings are folded most.
    """
    for weight in RELAXATIONS:
        warp = Warp(source, target, unit_mm, weight)
        area = warp.area_change(places)
        if area.min() >= SMALLEST_AREA:
            return warp
    worst = names[int(np.linalg.norm(source - places[area.argmin(), :2], axis=1).argmin())]
    raise EvalkitError(f"the points fold the face near '{worst}'; check that point and those around it")
