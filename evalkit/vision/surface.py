"""The surface that a face's texture lies on: a cylinder, or a head's depths, over a grid of angle and height.

A surface has its axes in the head: x to the person's left, y up, z forward, with the origin on the axis of the
cylinder at the height of the face's middle. Rows of the grid go down, columns go to the person's left, so that an
unwrapped face looks like its picture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from evalkit.geometry import Array

Map = NDArray[np.float32]

HALF_ANGLE_DEG = 80.0
"""The texture reaches this far to both sides of the nose: beyond lie the ears."""

FINEST = 48
"""Rows and columns of the finest grid, some 4 mm apart: with 64 poses were no better and took half as long again."""

LEVELS = 3

T = TypeVar("T")


class Levels(Sequence[T], Generic[T]):
    """Something at every level, finest first, each made when it is first asked for: most frames need the finest alone.

    Parameters
    ----------
    make : callable
        Gives the value at a level.
    """

    def __init__(self, make: Callable[[int], T]) -> None:
        self._make = make
        self._made: dict[int, T] = {}

    @overload
    def __getitem__(self, level: int) -> T: ...
    @overload
    def __getitem__(self, level: slice) -> Sequence[T]: ...
    def __getitem__(self, level: int | slice) -> T | Sequence[T]:
        if isinstance(level, slice):
            return [self[k] for k in range(*level.indices(LEVELS))]
        if not 0 <= level < LEVELS:
            raise IndexError(level)
        if level not in self._made:
            self._made[level] = self._make(level)
        return self._made[level]

    def __len__(self) -> int:
        return LEVELS


@dataclass(frozen=True, eq=False)
class Grid:
    """A surface at one resolution.

    Attributes
    ----------
    points : ndarray of float32, shape (N, 3), mm
        Row by row; like all of these laid out with the N of a coordinate side by side, which is read in one go.
    normals : ndarray of float32, shape (N, 3)
        Outward, length 1.
    along_row, along_column : ndarray of float32, shape (N, 3), 1/mm
        Dual basis of the tangent plane: a move by ``m`` mm in it goes ``along_row . m`` columns to the left of the
        person and ``along_column . m`` rows down.
    shape : (int, int)
    spacing_mm : float
        Between neighbouring points.
    """

    points: Map
    normals: Map
    along_row: Map
    along_column: Map
    shape: tuple[int, int]
    spacing_mm: float


@dataclass(frozen=True, eq=False)
class Surface:
    """Distance of the skin from the axis over angle and height.

    Attributes
    ----------
    radii_mm : ndarray, shape (FINEST + 1, FINEST + 1)
        Rows from ``top_mm`` down to ``bottom_mm``, columns from -80 to 80 degrees; one value makes a cylinder.
    top_mm, bottom_mm : float
        Ends along the axis.
    """

    radii_mm: Array
    top_mm: float
    bottom_mm: float

    @classmethod
    def cylinder(cls, radius_mm: float, top_mm: float, bottom_mm: float) -> Surface:
        """A cylinder."""
        return cls(np.full((FINEST + 1, FINEST + 1), radius_mm), top_mm, bottom_mm)

    @cached_property
    def grids(self) -> Levels[Grid]:
        """From the finest to the coarsest, each with half the rows and columns of the one before."""
        return Levels(lambda level: self._grid(FINEST >> level))

    def _grid(self, size: int) -> Grid:
        # Middles of the cells, so that every level covers the same patch of skin.
        at = (np.arange(size) + 0.5) / size
        radii = _resample(self.radii_mm, at)
        angle = np.radians(HALF_ANGLE_DEG) * (2 * at - 1)[None, :]
        height = (self.top_mm + (self.bottom_mm - self.top_mm) * at)[:, None]
        points = np.stack([radii * np.sin(angle), height + 0 * radii, radii * np.cos(angle)], axis=-1)
        across, down = np.gradient(points, axis=1), np.gradient(points, axis=0)
        normals = np.cross(down, across)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        # Dual basis: orthogonal to the other tangent and to the normal.
        along_row, along_column = np.cross(down, normals), np.cross(normals, across)
        along_row /= (along_row * across).sum(axis=-1, keepdims=True)
        along_column /= (along_column * down).sum(axis=-1, keepdims=True)
        flat = [
            np.ascontiguousarray(a.reshape(-1, 3).T, np.float32).T for a in (points, normals, along_row, along_column)
        ]
        spacing_mm = float(np.sqrt(np.linalg.norm(across, axis=-1).mean() * np.linalg.norm(down, axis=-1).mean()))
        return Grid(flat[0], flat[1], flat[2], flat[3], (size, size), spacing_mm)


def _resample(values: Array, at: Array) -> Array:
    """Bilinear values of a square table at fractions of its sides."""
    place = at * (len(values) - 1)
    low = np.minimum(place.astype(int), len(values) - 2)
    part = place - low
    rows = values[low] * (1 - part)[:, None] + values[low + 1] * part[:, None]
    return rows[:, low] * (1 - part) + rows[:, low + 1] * part
