"""Triangle meshes: the nearest point on one, edges, normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from evalkit.geometry import Array
from evalkit.head.model import Indices


def closest_points(points: Array, vertices: Array, triangles: Indices) -> tuple[Array, Array]:
    """Nearest point of a mesh to each of a few points.

    Ericson, "Real-Time Collision Detection" (2005), section 5.1.5, over all triangles that can be nearest.

    Parameters
    ----------
    points : ndarray, shape (N, 3)
    vertices : ndarray, shape (V, 3)
    triangles : ndarray of int, shape (T, 3)

    Returns
    -------
    places : ndarray, shape (N, 3)
    distances : ndarray, shape (N,)
    """
    used = np.unique(triangles)
    bound, _ = cKDTree(vertices[used]).query(points)
    corners = vertices[triangles]
    middle = corners.mean(axis=1)
    size = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    out = np.empty_like(points)
    for k, point in enumerate(points):
        near = np.linalg.norm(middle - point, axis=1) <= bound[k] + size + 1e-9
        candidates = _on_triangles(point, corners[near])
        out[k] = candidates[np.linalg.norm(candidates - point, axis=1).argmin()]
    return out, np.linalg.norm(out - points, axis=1)


def _on_triangles(point: Array, corners: Array) -> Array:
    """Nearest point of each triangle (T, 3, 3) to one point."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    candidates = [_on_segments(point, a, b), _on_segments(point, b, c), _on_segments(point, c, a)]
    ab, ac, ap = b - a, c - a, point - a
    d00, d01, d11 = (ab * ab).sum(1), (ab * ac).sum(1), (ac * ac).sum(1)
    d20, d21 = (ap * ab).sum(1), (ap * ac).sum(1)
    area = np.maximum(d00 * d11 - d01 * d01, 1e-300)
    v, w = (d11 * d20 - d01 * d21) / area, (d00 * d21 - d01 * d20) / area
    inside = (v >= 0) & (w >= 0) & (v + w <= 1)
    foot = a + v[:, None] * ab + w[:, None] * ac
    best = np.stack(candidates)[np.linalg.norm(np.stack(candidates) - point, axis=2).argmin(axis=0), np.arange(len(a))]
    return np.where(inside[:, None], foot, best)


def _on_segments(point: Array, a: Array, b: Array) -> Array:
    along = b - a
    share = ((point - a) * along).sum(1) / np.maximum((along**2).sum(1), 1e-300)
    return a + np.clip(share, 0.0, 1.0)[:, None] * along


def directed_edges(triangles: Indices) -> Indices:
    """Edges (3 T, 2) in the direction in which the triangles go round them."""
    return np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])


def triangle_normals(vertices: Array, triangles: Indices) -> Array:
    """Normals (T, 3) whose length is twice the area."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def components(triangles: Indices) -> tuple[int, NDArray[np.int32]]:
    """Number of connected pieces, and the piece of each triangle."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    used, local = np.unique(triangles, return_inverse=True)
    local = local.reshape(-1, 3)
    edges = directed_edges(local)
    graph = coo_array((np.ones(len(edges)), edges.T), shape=(len(used), len(used)))
    count, label = connected_components(graph, directed=False)
    return int(count), label[local[:, 0]]
