"""Collecting the vertices and faces of a head part by part."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evalkit.geometry import Array
from evalkit.head.model import Indices

PARTS = (
    "skin",
    "lids",
    "mouth pocket",
    "upper teeth",
    "lower teeth",
    "eyeballs",
    "ears",
    "plate",
)
"""Parts of the template in the order of their triangles."""


class Assembly:
    """Vertices with their texture coordinates, region and motion; faces by part."""

    def __init__(self) -> None:
        self._columns: dict[str, list[Array]] = {
            name: [] for name in ("place", "uv", "region", "jaw", "eye", "turn", "lift")
        }
        self._faces: dict[str, list[Indices]] = {name: [] for name in PARTS}
        self.count = 0

    def add(
        self,
        place: Array,
        uv: Array,
        *,
        region: ArrayLike = -1,
        jaw: ArrayLike = 0.0,
        eye: ArrayLike = -1,
        turn: ArrayLike = 0.0,
        lift: ArrayLike = 0.0,
    ) -> Indices:
        """Add vertices; returns their numbers in the shape of ``place`` without its last axis."""
        shape = place.shape[:-1]
        values = {"region": region, "jaw": jaw, "eye": eye, "turn": turn, "lift": lift}
        self._columns["place"].append(place.reshape(-1, 3))
        self._columns["uv"].append(np.broadcast_to(uv, (*shape, 2)).reshape(-1, 2))
        for name, value in values.items():
            self._columns[name].append(np.broadcast_to(np.asarray(value, dtype=np.float64), shape).ravel())
        ids = self.count + np.arange(int(np.prod(shape))).reshape(shape)
        self.count += ids.size
        return ids

    def faces(self, part: str, quads: Indices) -> None:
        """Add quadrilaterals (N, 4), counter-clockwise from outside; those with a doubled corner become triangles."""
        self._faces[part].append(np.asarray(quads, dtype=np.intp).reshape(-1, 4))

    def column(self, name: str) -> Array:
        """One property of every vertex."""
        return np.concatenate(self._columns[name])

    def triangles(self) -> tuple[Indices, dict[str, tuple[int, int]]]:
        """All triangles and the range of each part."""
        places = self.column("place")
        pieces, ranges, start = [], {}, 0
        for part in PARTS:
            triangles = _split(np.concatenate(self._faces[part]), places)
            pieces.append(triangles)
            ranges[part] = (start, start + len(triangles))
            start += len(triangles)
        return np.concatenate(pieces), ranges


def grid_quads(ids: Indices) -> Indices:
    """Faces between neighbouring rows (downwards) and columns (to the left side of the head), shape (N, 4)."""
    return np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1).reshape(-1, 4)


def ring_quads(outer: Indices, inner: Indices) -> Indices:
    """Faces between two closed rings that go clockwise as seen from outside, the second one further inside."""
    a, b = outer, np.roll(outer, -1)
    return np.stack([b, a, inner, np.roll(inner, -1)], axis=-1)


def _split(quads: Indices, places: Array) -> Indices:
    """Cut every quadrilateral along its shorter diagonal, mirror images alike."""
    corner = places[quads]
    first = np.linalg.norm(corner[:, 0] - corner[:, 2], axis=1)
    second = np.linalg.norm(corner[:, 1] - corner[:, 3], axis=1)
    # A mirrored face has its corners the other way round: equal diagonals must swap with the side.
    left = corner[:, :, 0].sum(axis=1) > 0
    tie = np.abs(first - second) < 1e-6
    along_first = np.where(tie, left, first < second)
    a, b, c, d = quads.T
    triangles = np.where(
        along_first[:, None, None],
        np.stack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)], 1),
        np.stack([np.stack([a, b, d], 1), np.stack([b, c, d], 1)], 1),
    ).reshape(-1, 3)
    distinct = (
        (triangles[:, 0] != triangles[:, 1])
        & (triangles[:, 1] != triangles[:, 2])
        & (triangles[:, 2] != triangles[:, 0])
    )
    return triangles[distinct]
