"""A mesh as a file has it, and what is computed from its faces."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array

Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices and faces in the order of a file, and that file with other positions in it.

    Attributes
    ----------
    path : Path
    vertices : ndarray, shape (V, 3)
        In the unit of the file.
    sizes : ndarray of int, shape (F,)
        Corners of each face.
    corners : ndarray of int, shape (sum of sizes,)
        Vertices of the faces, one face after the other.
    rewritten : callable
        ``rewritten(vertices, targets)``: the file with these positions instead of its own and, for glTF, these morph
        targets instead of those of the same names; all positions in place, not displacements. Faces, texture
        coordinates and materials stay; normals that are stored are computed anew or left out.
    targets : dict of str to ndarray, shape (V, 3)
        Morph targets of glTF by name, as positions in place.
    """

    path: Path
    vertices: Array
    sizes: Indices
    corners: Indices
    rewritten: Callable[[Array, Mapping[str, Array]], bytes]
    targets: dict[str, Array] = field(default_factory=dict)

    def checked(self) -> Mesh:
        """The mesh itself.

        Raises
        ------
        EvalkitError
            If it has no face, a face has fewer than three corners or names a vertex that is not there, or a position
            is not finite; with the number, from 0.
        """
        starts = np.cumsum(self.sizes) - self.sizes
        if not len(self.sizes):
            raise EvalkitError(f"{self.path}: holds no faces; export the mesh with its faces")
        bad = np.flatnonzero(self.sizes < 3)
        if len(bad):
            raise EvalkitError(f"{self.path}: face {bad[0]} has {self.sizes[bad[0]]} corners; remove it")
        bad = np.flatnonzero((self.corners < 0) | (self.corners >= len(self.vertices)))
        if len(bad):
            face = np.searchsorted(starts, bad[0], side="right") - 1
            raise EvalkitError(
                f"{self.path}: face {face} names vertex {self.corners[bad[0]]}, of {len(self.vertices)}; the file is "
                "damaged, export it again"
            )
        for name, places in (("", self.vertices), *self.targets.items()):
            bad = np.flatnonzero(~np.isfinite(places).all(axis=1))
            if len(bad):
                where = f"{self.path}: target '{name}':" if name else f"{self.path}:"
                raise EvalkitError(f"{where} vertex {bad[0]} is not finite ({len(bad)} such); mend the mesh")
        return self

    def triangles(self) -> Indices:
        """Faces as triangles (T, 3), in the order of the faces.

        A face of n corners is a fan from that corner from which the smallest triangle is largest: across a quad with
        three corners on a line, or with a notch, only one of the two diagonals will do.
        """
        starts, first = np.cumsum(self.sizes) - self.sizes, np.cumsum(self.sizes - 2) - (self.sizes - 2)
        out = np.empty((int((self.sizes - 2).sum()), 3), dtype=np.intp)
        for n in np.unique(self.sizes):
            which = np.flatnonzero(self.sizes == n)
            faces = self.corners[starts[which][:, None] + np.arange(n)]
            fans = np.stack([_fan(np.roll(faces, -k, axis=1)) for k in range(n if n > 3 else 1)], axis=1)
            if n > 3:
                a, b, c = (self.vertices[fans[..., k]] for k in range(3))
                normal = np.cross(b - a, c - a)
                # The sum of a fan's cross products is the same from every corner: the face's own normal.
                least = np.einsum("fkti,fi->fkt", normal, normal[:, 0].sum(axis=1)).min(axis=2)
                # Fans that differ by rounding alone: the first of them, on every machine.
                best = (least >= least.max(axis=1, keepdims=True) * (1.0 - 1e-9)).argmax(axis=1)
            else:
                best = np.zeros(len(which), dtype=np.intp)
            out[first[which][:, None] + np.arange(n - 2)] = fans[np.arange(len(which)), best]
        return out


def _fan(faces: Indices) -> Indices:
    """Triangles (F, n - 2, 3) from the first corner of faces (F, n)."""
    return np.stack([np.repeat(faces[:, :1], faces.shape[1] - 2, axis=1), faces[:, 1:-1], faces[:, 2:]], axis=2)


def check_same_faces(mesh: Mesh, other: Mesh) -> None:
    """Refuse two meshes that are not shapes of one another.

    Raises
    ------
    EvalkitError
        If the number of vertices or a face differs; names both files.
    """
    if len(mesh.vertices) != len(other.vertices):
        raise EvalkitError(
            f"{other.path} has {len(other.vertices)} vertices, {mesh.path} has {len(mesh.vertices)}; shapes need one "
            "topology: export both from the same mesh, without modifiers that change it"
        )
    if np.array_equal(mesh.sizes, other.sizes) and np.array_equal(mesh.corners, other.corners):
        return
    if len(mesh.sizes) != len(other.sizes):
        raise EvalkitError(
            f"{other.path} has {len(other.sizes)} faces, {mesh.path} has {len(mesh.sizes)}; shapes need one topology"
        )
    pair = [np.split(m.corners, np.cumsum(m.sizes)[:-1]) for m in (mesh, other)]
    face = next(k for k, (a, b) in enumerate(zip(*pair, strict=True)) if not np.array_equal(a, b))
    raise EvalkitError(
        f"{other.path}: face {face} has vertices {pair[1][face].tolist()}, {pair[0][face].tolist()} in {mesh.path}; "
        "the order of vertices must be the same: export both with it kept"
    )


def welded(stack: Array) -> tuple[Indices, Indices]:
    """Vertices that lie on each other in every shape, as one.

    Formats that store texture coordinates per vertex (PLY, glTF) split the mesh along its seams, where it would tear.

    Parameters
    ----------
    stack : ndarray, shape (K, V, 3)
        The shapes.

    Returns
    -------
    kept : ndarray of int, shape (U,)
        The first vertex of each, in ascending order.
    of : ndarray of int, shape (V,)
        For each vertex, which of those.
    """
    # Adding zero makes minus zero plus zero, whose bytes differ.
    rows = np.ascontiguousarray(stack.transpose(1, 0, 2).reshape(stack.shape[1], -1) + 0.0)
    _, first, of = np.unique(rows.view(f"V{rows.strides[0]}").ravel(), return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[of]


def seams_welded(vertices: Array, triangles: Indices) -> tuple[Indices, Indices]:
    """The same for one shape alone: only vertices on open edges, since lips and lids may lie on each other at rest.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
    triangles : ndarray of int, shape (T, 3)
    """
    sides = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, times = np.unique(sides, axis=0, return_counts=True)
    own = np.arange(1, len(vertices) + 1, dtype=np.float64)
    own[edges[times == 1].ravel()] = 0.0
    return welded(np.stack([vertices, np.repeat(own[:, None], 3, axis=1)]))


def vertex_normals(vertices: Array, triangles: Indices) -> Array:
    """Unit normals (V, 3), the mean over the triangles around weighted by their areas; +z where there are none."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    face = np.cross(b - a, c - a)
    sums = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(sums, triangles[:, k], face)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    # Formats ask for unit length also where triangles without area leave none.
    return np.where(length > 0.0, sums / np.where(length > 0.0, length, 1.0), [0.0, 0.0, 1.0])
