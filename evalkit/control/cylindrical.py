"""Dense correspondence: which place of one surface is seen where a vertex of another is, from the axis of the head.

Both surfaces, brought to one place by a warp, are unrolled from a cylinder about the head. A vertex of the one belongs
to the place of the other that has its angle and height. On a head's skin that is nearly a bijection; where it is not,
it is counted: places over one another (the wings of the nose, the ears), and holes (eyes, mouth, the end of a mask).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from evalkit.control.slits import Sides, head_axes, opposite
from evalkit.geometry import Array
from evalkit.head.model import Indices
from evalkit.transfer.registration import closest_on_triangles

INSIDE = -1e-9
"""A point on the common edge of two triangles is in both; rounding must not leave it in none."""

SAME_DEPTH = 0.02
"""Two places over one another are one, on the common edge of two triangles, if their distances from the axis differ by
less than this share of the radius: 1.5 mm, thinner than any fold of skin."""

CANDIDATES = 8
"""Near vertices whose triangles are tried for the closest place."""


@dataclass(frozen=True, eq=False)
class Cylinder:
    """A cylinder about a head.

    Attributes
    ----------
    middle : ndarray, shape (3,), mm
        A point of its axis.
    axes : ndarray, shape (3, 3)
        Rows: the head's left, up and forward.
    radius_mm : float
    """

    middle: Array
    axes: Array
    radius_mm: float

    def unrolled(self, points: Array) -> Array:
        """Points (..., 3) as way along the circumference from the front, height, and distance from the axis, mm."""
        x, y, z = np.moveaxis((points - self.middle) @ self.axes.T, -1, 0)
        return np.stack([self.radius_mm * np.arctan2(x, z), y, np.hypot(x, z)], axis=-1)


def cylinder_about(landmarks: Mapping[str, Array], name: str = "head") -> Cylinder:
    """The cylinder whose circle comes nearest to a head's landmarks, seen from above.

    Up and forward are those of the mean face laid on the landmarks, so that a mesh may face any way.

    Raises
    ------
    EvalkitError
        If fewer than four landmarks have a known name.
    """
    axes = head_axes(landmarks, name)
    points = np.array(list(landmarks.values()))
    middle = points.mean(axis=0)
    x, _, z = ((points - middle) @ axes.T).T
    # Symmetric about the middle plane; Kasa's circle: 2 c z + (R^2 - c^2) = x^2 + z^2.
    side = x.mean()
    (twice, rest), *_ = np.linalg.lstsq(np.column_stack([2.0 * z, np.ones_like(z)]), (x - side) ** 2 + z**2, rcond=None)
    radius = float(np.sqrt(max(rest + twice**2, 1e-12)))
    return Cylinder(middle + np.array([side, 0.0, twice]) @ axes, axes, radius)


class Cover(NamedTuple):
    """Triangles that have a point inside, pair by pair.

    Attributes
    ----------
    point, triangle : ndarray of int, shape (P,)
    shares : ndarray, shape (P, 3)
        Barycentric coordinates.
    """

    point: Indices
    triangle: Indices
    shares: Array


def covering(points: Array, vertices: Array, triangles: Indices) -> Cover:
    """All triangles (T, 3) of the plane that contain each of the points (K, 2), found by a grid of cells."""
    corners = vertices[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    size = max(float(np.median(high - low)), 1e-9)
    origin = low.min(axis=0) if len(low) else np.zeros(2)
    first, last = (np.floor((edge - origin) / size).astype(np.intp) for edge in (low, high))
    wide, tall = (last - first + 1).T if len(low) else np.zeros((2, 0), dtype=np.intp)
    count = wide * tall
    owner = np.repeat(np.arange(len(triangles)), count)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    column, row = first[owner, 0] + number % wide[owner], first[owner, 1] + number // wide[owner]
    width = int(last[:, 0].max(initial=0)) + 1
    order = np.argsort(row * width + column, kind="stable")
    cells = (row * width + column)[order]
    at = np.floor((points - origin) / size).astype(np.intp)
    within = (at >= 0).all(axis=1) & (at[:, 0] < width)
    cell = np.where(within, at[:, 1] * width + at[:, 0], -1)
    start, stop = np.searchsorted(cells, cell), np.searchsorted(cells, cell, side="right")
    many = stop - start
    point = np.repeat(np.arange(len(points)), many)
    rank = np.arange(len(point)) - np.repeat(np.cumsum(many) - many, many)
    triangle = owner[order][start[point] + rank]
    shares = barycentric(points[point], corners[triangle])
    inside = (shares >= INSIDE).all(axis=1)
    return Cover(point[inside], triangle[inside], shares[inside])


def barycentric(points: Array, corners: Array) -> Array:
    """Barycentric coordinates (K, 3) of points (K, D) in triangles (K, 3, D), of their feet where D is 3.

    A triangle without area gives -1: nothing is inside.
    """
    a, b, to = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    aa, ab, bb, pa, pb = ((p * q).sum(axis=1) for p, q in ((a, a), (a, b), (b, b), (to, a), (to, b)))
    area = aa * bb - ab * ab
    flat = area <= 1e-12 * np.maximum(aa * bb, 1e-300)
    area = np.where(flat, 1.0, area)
    v, w = (bb * pa - ab * pb) / area, (aa * pb - ab * pa) / area
    return np.where(flat[:, None], -1.0, np.stack([1.0 - v - w, v, w], axis=1))


@dataclass(frozen=True, eq=False)
class Bijectivity:
    """How far a correspondence is from one to one. Counts are of vertices of the target's skin, unless said otherwise.

    Attributes
    ----------
    vertices : int
    overlaps : ndarray of bool, shape (V,)
        More than one place of the source lies there.
    holes : ndarray of bool, shape (V,)
        None does, or none on the same side of mouth and eyes: the closest place stands for it.
    turned_source, turned_target : int
        Triangles that show the axis their other side: a fold of the surface in the projection.
    """

    vertices: int
    overlaps: NDArray[np.bool_]
    holes: NDArray[np.bool_]
    turned_source: int
    turned_target: int

    @property
    def text(self) -> str:
        """One line."""
        once = self.vertices - int((self.overlaps | self.holes).sum())
        return (
            f"{once} of {self.vertices} vertices correspond one to one; {self.overlaps.sum()} where the source lies "
            f"over itself, {self.holes.sum()} beside it (closest place taken); triangles that face the axis: "
            f"{self.turned_source} of the source, {self.turned_target} of the target"
        )


@dataclass(frozen=True, eq=False)
class Dense:
    """The place on the source for each vertex of the target.

    Attributes
    ----------
    corners : ndarray of int, shape (V, 3)
        Vertices of the source's triangle.
    shares : ndarray, shape (V, 3)
        Barycentric coordinates in it.
    report : Bijectivity
    """

    corners: Indices
    shares: Array
    report: Bijectivity

    def matrix(self, count: int) -> csr_array:
        """Sparse (V, count): from values at the source's vertices to values at the target's."""
        rows = np.repeat(np.arange(len(self.corners)), 3)
        return csr_array((self.shares.ravel(), (rows, self.corners.ravel())), shape=(len(self.corners), count))


def correspond(
    cylinder: Cylinder,
    source: Array,
    source_triangles: Indices,
    target: Array,
    target_triangles: Indices,
    source_sides: Sides,
    target_sides: Sides,
) -> Dense:
    """Places of a source surface, warped onto a target, for all of the target's vertices.

    Parameters
    ----------
    cylinder : Cylinder
        About the target.
    source : ndarray, shape (Vs, 3), mm
        Warped.
    source_triangles : ndarray of int, shape (Ts, 3)
        Outer skin only.
    target : ndarray, shape (V, 3), mm
    target_triangles : ndarray of int, shape (Tt, 3)
        For the report.
    source_sides, target_sides : ndarray of int8, shape (Vs, 3) and (V, 3)
        See :func:`~evalkit.control.slits.vertex_sides`: opposite sides of a slit are never matched.
    """
    flat, points = cylinder.unrolled(source), cylinder.unrolled(target)
    half_turn = np.pi * cylinder.radius_mm
    triangles = source_triangles[_unbroken(flat, source_triangles, half_turn)]
    side = np.sign(source_sides[triangles].sum(axis=1)).astype(np.int8)
    found = covering(points[:, :2], flat[:, :2], triangles)
    same = ~opposite(target_sides[found.point], side[found.triangle])
    point, triangle, shares = found.point[same], found.triangle[same], found.shares[same]
    depth = (flat[triangles[triangle], 2] * shares).sum(axis=1)
    off = np.abs(depth - points[point, 2])
    turned = [
        _twice_area(where, which[_unbroken(where, which, half_turn)]) < 0.0
        for where, which in ((flat, source_triangles), (points, target_triangles))
    ]
    # Skin goes with skin and lining with lining, then what is nearest in depth.
    lining = _mostly(turned[1], target_triangles[_unbroken(points, target_triangles, half_turn)], len(target))
    best = np.lexsort((off, turned[0][triangle] != lining[point], point))
    first = best[np.unique(point[best], return_index=True)[1]]
    corners, weights = np.zeros((len(target), 3), dtype=np.intp), np.zeros((len(target), 3))
    corners[point[first]], weights[point[first]] = triangles[triangle[first]], shares[first]
    near, far = np.full(len(target), np.inf), np.full(len(target), -np.inf)
    np.minimum.at(near, point, depth)
    np.maximum.at(far, point, depth)
    holes = ~np.isfinite(near)
    overlaps = ~holes & (far - np.where(holes, 0.0, near) > SAME_DEPTH * cylinder.radius_mm)
    lost = np.flatnonzero(holes)
    if len(lost):
        corners[lost], weights[lost] = closest_places(target[lost], target_sides[lost], source, triangles, side)
    return Dense(corners, weights, Bijectivity(len(target), overlaps, holes, *(int(one.sum()) for one in turned)))


def closest_places(
    points: Array, sides: Sides, vertices: Array, triangles: Indices, triangle_sides: Sides
) -> tuple[Indices, Array]:
    """Corners (K, 3) and barycentric coordinates (K, 3) of the places closest to points on their side of the slits."""
    corners, shares = np.zeros((len(points), 3), dtype=np.intp), np.zeros((len(points), 3))
    for side in np.unique(sides, axis=0):
        mine = np.flatnonzero((sides == side).all(axis=1))
        allowed = triangles[~opposite(side, triangle_sides)]
        used = np.unique(allowed)
        _, near = cKDTree(vertices[used]).query(points[mine], k=min(CANDIDATES, len(used)))
        around = _around(allowed, len(vertices))
        tried = allowed[around[used[near.reshape(len(mine), -1)]].reshape(len(mine), -1)]
        place = closest_on_triangles(points[mine, None], *(vertices[tried[..., k]] for k in range(3)))
        best = ((place - points[mine, None]) ** 2).sum(axis=2).argmin(axis=1)
        row = np.arange(len(mine))
        corners[mine] = tried[row, best]
        found = barycentric(place[row, best], vertices[corners[mine]])
        found = np.clip(np.where(found.sum(axis=1, keepdims=True) > 0.0, found, 1.0 / 3.0), 0.0, 1.0)
        shares[mine] = found / found.sum(axis=1, keepdims=True)
    return corners, shares


def _around(triangles: Indices, count: int) -> Indices:
    """Triangles around each vertex (count, most), padded with repetitions of the last."""
    corner = triangles.ravel()
    order = np.argsort(corner, kind="stable")
    start = np.searchsorted(corner[order], np.arange(count + 1))
    most = int(np.diff(start).max(initial=1))
    slot = np.minimum(start[:-1, None] + np.arange(most), np.maximum(start[1:, None] - 1, start[:-1, None]))
    return np.asarray(order[np.minimum(slot, len(order) - 1)] // 3)


def _unbroken(flat: Array, triangles: Indices, half_turn: float) -> NDArray[np.bool_]:
    """Triangles that do not lie across the back, where the cylinder is cut open."""
    along = flat[triangles, 0]
    return np.asarray(along.max(axis=1) - along.min(axis=1) < half_turn)


def _twice_area(flat: Array, triangles: Indices) -> Array:
    """Signed; positive where a triangle is seen from outside."""
    a, b, c = (flat[triangles[:, k], :2] for k in range(3))
    return np.asarray((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def _mostly(which: NDArray[np.bool_], triangles: Indices, count: int) -> NDArray[np.bool_]:
    """Vertices (count,) more than half of whose triangles are among some."""
    among, around = (np.bincount(some.ravel(), minlength=count) for some in (triangles[which], triangles))
    return np.asarray(2 * among > around)
