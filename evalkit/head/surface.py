"""The skin as the zero level of a signed distance field: smoothly joined ellipsoids and round cones.

The field is only approximately a distance (exact for round cones, first order for ellipsoids), which is all
that stepping onto its zero level needs.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from evalkit.geometry import Array, rotation_from_vector

MIRROR = np.array([-1.0, 1.0, 1.0])


class Ellipsoid(NamedTuple):
    """An ellipsoid; off the middle plane it stands for a pair.

    Attributes
    ----------
    name : str
    centre, radii : tuple of 3 floats, mm
    turn : tuple of 3 floats, rad
        Rotation vector of its axes.
    blend : float, mm
        Width over which it merges with what came before it.
    carve : bool
        Taken away instead of added.
    """

    name: str
    centre: tuple[float, float, float]
    radii: tuple[float, float, float]
    turn: tuple[float, float, float]
    blend: float
    carve: bool = False

    def field(self, points: Array) -> Array:
        """First-order distance, mm, of points (N, 3), negative inside."""
        local = (points - self.centre) @ _axes(self.turn) / self.radii
        k0 = np.sqrt(np.einsum("nd,nd->n", local, local) + 1e-12)
        local /= self.radii
        k1 = np.sqrt(np.einsum("nd,nd->n", local, local) + 1e-12)
        return k0 * (k0 - 1.0) / k1

    @property
    def ball(self) -> tuple[Array, float]:
        """Middle and radius of a ball that contains it."""
        return np.array(self.centre), max(self.radii)

    @property
    def paired(self) -> bool:
        """Whether it has a mirror image."""
        return self.centre[0] != 0.0


class RoundCone(NamedTuple):
    """A line segment with a thickness that varies along it; off the middle plane it stands for a pair.

    Attributes
    ----------
    name : str
    start, end : tuple of 3 floats, mm
    radii : tuple of 2 floats, mm
        At the start and at the end.
    blend : float, mm
    carve : bool
    """

    name: str
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radii: tuple[float, float]
    blend: float
    carve: bool = False

    def field(self, points: Array) -> Array:
        """Distance, mm, of points (N, 3), negative inside."""
        start = np.array(self.start)
        axis = np.array(self.end) - start
        along = np.clip((points - start) @ axis / (axis @ axis), 0.0, 1.0)
        thickness = self.radii[0] + (self.radii[1] - self.radii[0]) * along
        return np.linalg.norm(points - start - along[:, None] * axis, axis=1) - thickness

    @property
    def ball(self) -> tuple[Array, float]:
        """Middle and radius of a ball that contains it."""
        start, end = np.array(self.start), np.array(self.end)
        return 0.5 * (start + end), 0.5 * float(np.linalg.norm(end - start)) + max(self.radii)

    @property
    def paired(self) -> bool:
        """Whether it has a mirror image."""
        return self.start[0] != 0.0


Primitive = Ellipsoid | RoundCone


@lru_cache(maxsize=256)
def _axes(turn: tuple[float, float, float]) -> Array:
    return rotation_from_vector(np.array(turn))


def smooth_minimum(a: Array, b: Array, blend: float) -> Array:
    """Minimum of two fields with a cubic transition of this width (Quilez's cubic polynomial smooth minimum)."""
    overlap = np.maximum(blend - np.abs(a - b), 0.0) / blend
    return np.minimum(a, b) - overlap**3 * (blend / 6.0)


def field(points: Array, primitives: tuple[Primitive, ...]) -> Array:
    """Signed distance field of a mirror-symmetric shape.

    Parameters
    ----------
    points : ndarray, shape (N, 3)
        mm.
    primitives : tuple
        Joined in this order; the first one is in the middle plane.

    Returns
    -------
    ndarray, shape (N,)
        mm, negative inside.
    """
    total = primitives[0].field(points)
    here, there = _beyond_reach(points, primitives), _beyond_reach(points * MIRROR, primitives)
    for k, part in enumerate(primitives[1:], start=1):
        sign = -1.0 if part.carve else 1.0
        beyond = np.minimum(here[:, k], there[:, k]) if part.paired else here[:, k]
        near = np.flatnonzero(beyond < sign * total)
        value = part.field(points[near])
        if part.paired:
            other = part.field(points[near] * MIRROR)
            value = np.minimum(value, other) if part.carve else smooth_minimum(value, other, part.blend)
        total[near] = sign * smooth_minimum(sign * total[near], value, part.blend)
    return total


def _beyond_reach(points: Array, primitives: tuple[Primitive, ...]) -> Array:
    """Distance (N, P) from where a primitive can change a field that is zero there."""
    middles, reaches = zip(*(part.ball for part in primitives), strict=True)
    middle = np.array(middles)
    squared = (points**2).sum(axis=1)[:, None] - 2.0 * points @ middle.T + (middle**2).sum(axis=1)
    blends = np.array([part.blend for part in primitives])
    return np.sqrt(np.maximum(squared, 0.0)) - (np.array(reaches) + blends + MARGIN_MM)


MARGIN_MM = 8.0
"""An ellipsoid's field may be so much smaller than the distance from its surrounding ball."""


ROUNDING_MM = 0.8
"""Half edge of the tetrahedron over which the field is averaged: it rounds creases between primitives that are
finer than that."""


def gradient(points: Array, primitives: tuple[Primitive, ...], step_mm: float = ROUNDING_MM) -> tuple[Array, Array]:
    """Field (N,) and its gradient (N, 3) from four points of a tetrahedron; both are averages over its size."""
    corners = np.array([[1.0, -1, -1], [-1, -1, 1], [-1, 1, -1], [1, 1, 1]])
    values = np.stack([field(points + step_mm * corner, primitives) for corner in corners])
    return values.mean(axis=0), np.einsum("kn,kd->nd", values, corners) / (4.0 * step_mm)


def project(points: Array, primitives: tuple[Primitive, ...], steps: int = 8, longest_mm: float = 3.0) -> Array:
    """Points moved onto the surface along the field's gradient by Newton's steps, none longer than given."""
    out = np.array(points, dtype=np.float64)
    for _ in range(steps):
        value, slope = gradient(out, primitives)
        step = value / np.maximum((slope**2).sum(axis=1), 1e-3)
        out -= np.clip(step, -longest_mm, longest_mm)[:, None] * slope
    return out
