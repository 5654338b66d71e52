"""Distances and interpolation along the surface of a mesh, where a mouth slit keeps the lips apart."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from evalkit.errors import EvalkitError
from evalkit.geometry import Array

SMALLEST_SINE = 1e-4
"""Sharper corners of a triangle count as this sharp: a sliver must not outweigh all other triangles."""


def edges(triangles: ArrayLike) -> np.ndarray:
    """Edges of a triangle mesh, each once, lower vertex first; shape (E, 2)."""
    t = np.asarray(triangles)
    return np.unique(np.sort(np.concatenate([t[:, :2], t[:, 1:], t[:, ::2]]), axis=1), axis=0)


def edge_graph(vertices: Array, triangles: ArrayLike) -> sp.csr_array:
    """Lengths of the edges as a sparse symmetric matrix (V, V)."""
    # SciPy's shortest paths, until 1.14 at least, take indices of 32 bits only.
    a, b = edges(triangles).astype(np.int32).T
    length = np.linalg.norm(vertices[a] - vertices[b], axis=1)
    # A length of zero would read as "no edge".
    half = sp.coo_array((np.maximum(length, 1e-12), (a, b)), shape=(len(vertices),) * 2)
    return (half + half.T).tocsr()


def edge_distance(graph: sp.csr_array, sources: ArrayLike, limit: float = np.inf) -> Array:
    """Length of the shortest path along edges from the nearest of the sources, (V,); infinite beyond the limit."""
    indices = np.asarray(sources, dtype=np.int64)
    if not indices.size:
        return np.full(graph.shape[0], np.inf)
    return np.asarray(dijkstra(graph, directed=False, indices=indices, min_only=True, limit=limit))


def nearest_vertices(vertices: Array, points: Array) -> tuple[np.ndarray, Array]:
    """Index of the vertex nearest to each point, and how far it is."""
    distance, index = cKDTree(vertices).query(points)
    return np.asarray(index), np.asarray(distance)


def spread_out(points: Array, count: int) -> np.ndarray:
    """Indices of points far from one another: each next one is the farthest from those chosen before.

    The first is the one farthest from the mean, so that the choice depends on the shape alone.
    """
    count = min(count, len(points))
    chosen = np.empty(count, dtype=np.int64)
    gap = np.linalg.norm(points - points.mean(axis=0), axis=1)
    for i in range(count):
        # Of equally far ones, as left and right of a face, the first: rounding must not choose.
        chosen[i] = np.argmax(gap >= gap.max() * (1 - 1e-9))
        step = np.linalg.norm(points - points[chosen[i]], axis=1)
        gap = step if i == 0 else np.minimum(gap, step)
    return chosen


def heat_distances(vertices: Array, triangles: ArrayLike, sources: np.ndarray) -> Array:
    """Geodesic distance from each source vertex to every vertex by the heat method, shape (N, V).

    Infinite where no path leads. Made symmetric between the sources, which the method itself is not.

    Raises
    ------
    EvalkitError
        If potpourri3d is not installed.

    References
    ----------
    Crane, Weischedel, Wardetzky, "Geodesics in heat", ACM Trans. Graph. 32(5), 2013, doi:10.1145/2516971.2516977;
    for any triangle mesh: Sharp, Crane, SGP 2020, doi:10.1111/cgf.14069.
    """
    if find_spec("potpourri3d") is None:
        raise EvalkitError("geodesic distances need potpourri3d: pip install 'evalkit[surface]'")
    import potpourri3d

    solver = potpourri3d.MeshHeatMethodDistanceSolver(vertices, np.asarray(triangles, dtype=np.int64))
    distance = np.array([solver.compute_distance(int(source)) for source in sources])
    among = distance[:, sources]
    distance[:, sources] = 0.5 * (among + among.T)
    distance[np.arange(len(sources)), sources] = 0.0
    part = components(triangles, len(vertices))
    return np.where(part[sources][:, None] == part, distance, np.inf)


def bilaplacian(vertices: Array, triangles: ArrayLike, sources: np.ndarray) -> Array:
    """Weights (V, N) of the smoothest surface field through values at the sources.

    Minimises the squared cotangent Laplacian ``u' L M^-1 L u``, M the lumped mass matrix, with ``u`` given at the
    source vertices.

    References
    ----------
    Botsch, Sorkine, "On linear variational surface deformation methods", IEEE TVCG 14(1), 2008,
    doi:10.1109/TVCG.2007.1054; cotangents: Pinkall, Polthier, Experimental Mathematics 2, 1993.
    """
    laplacian, mass = cotangent_laplacian(vertices, triangles)
    energy = (laplacian @ sp.diags_array(1.0 / mass) @ laplacian).tocsc()
    weights = np.zeros((len(vertices), len(sources)))
    weights[sources, np.arange(len(sources))] = 1.0
    part = components(triangles, len(vertices))
    reached = np.isin(part, part[sources])
    free = reached.copy()
    free[sources] = False
    inside = np.flatnonzero(free)
    if inside.size:
        # Positive definite: without pivoting the factor keeps its sparsity, ten times faster.
        factor = splu(
            energy[inside][:, inside],
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        weights[inside] = factor.solve(-energy[inside][:, sources].toarray())
    return from_nearest(weights, vertices, reached)


def cotangent_laplacian(vertices: Array, triangles: ArrayLike) -> tuple[sp.csr_array, Array]:
    """Cotangent Laplacian (V, V), positive semi-definite, and the lumped mass (V,): a third of the triangles' area."""
    t = np.asarray(triangles)
    count = len(vertices)
    rows, columns, values = [], [], []
    mass = np.zeros(count)
    for corner in range(3):
        i, j, k = t[:, corner], t[:, (corner + 1) % 3], t[:, (corner + 2) % 3]
        a, b = vertices[j] - vertices[i], vertices[k] - vertices[i]
        twice_area = np.linalg.norm(np.cross(a, b), axis=1)
        lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
        cotangent = (a * b).sum(axis=1) / np.maximum(twice_area, SMALLEST_SINE * lengths + 1e-300)
        rows += [j, k]
        columns += [k, j]
        values += [0.5 * cotangent] * 2
        np.add.at(mass, i, twice_area / 6.0)
    off = sp.coo_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(count, count))
    laplacian = (sp.diags_array(np.asarray(off.sum(axis=1)).ravel()) - off).tocsr()
    used = mass > 0
    smallest = mass[used].mean() * 1e-6 if used.any() else 1.0
    return laplacian, np.maximum(mass, smallest)


def from_nearest(weights: Array, vertices: Array, reached: np.ndarray) -> Array:
    """Weights in which parts of the mesh without any centre follow the nearest vertex of a part with one."""
    if reached.all():
        return weights
    known = np.flatnonzero(reached)
    near, _ = nearest_vertices(vertices[known], vertices[~reached])
    out = weights.copy()
    out[~reached] = weights[known[near]]
    return out


def components(triangles: ArrayLike, count: int) -> np.ndarray:
    """Number of the connected part that each of the vertices belongs to, (V,)."""
    a, b = edges(triangles).T
    graph = sp.coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])
