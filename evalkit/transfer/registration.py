"""Non-rigid registration: one head's mesh bent onto another head, so that places of the two can be compared.

Sumner and Popovic, "Deformation transfer for triangle meshes", SIGGRAPH 2004, doi:10.1145/1015706.1015736, section 4.
Landmarks are met exactly; between them the deformation changes as little as possible from triangle to triangle, then
the surface is drawn onto the other in rounds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from evalkit.deform.surface import components
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.real_heads import aligned
from evalkit.meshes.model import vertex_normals
from evalkit.transfer.gradients import Indices, checked_mesh, edge_frames
from evalkit.transfer.matrices import inverse
from evalkit.transfer.solver import factorised

SMOOTHNESS, IDENTITY = 1.0, 1e-3
"""Weights of the paper for the change between neighbouring triangles and for the distance from no deformation."""

CLOSEST = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
"""Weight of the closest-point term in each round. Distances count in median edge lengths of the source, so that the
weights do not depend on the unit or the resolution."""

CANDIDATES = 12
"""So many near vertices are tried for one that faces the same way and may be met."""

FEWEST = 4
"""Landmarks that are not in one plane fix a similarity."""

MINGLE = (("skin", "upper lip"), ("skin", "lower lip"))
"""Different labels keep apart, but for these: where a lip ends is drawn differently on every head."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh with names for some of its places.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3)
    triangles : ndarray of int, shape (T, 3)
    landmarks : dict of str to ndarray, shape (3,)
        Places on the mesh at rest.
    labels : ndarray of str, shape (V,), optional
        Kind of each vertex, such as ``upper lip`` and ``lower lip``: only vertices of one kind (or of two that
        :data:`MINGLE`) are matched with each other. Without labels on both sides, none is kept apart.
    name : str
        For messages: the file.
    """

    vertices: Array
    triangles: Indices
    landmarks: Mapping[str, Array] = field(default_factory=dict)
    labels: NDArray[np.str_] | None = None
    name: str = "mesh"


def register(
    source: Surface,
    target: Surface,
    *,
    closest: tuple[float, ...] = CLOSEST,
    mingle: tuple[tuple[str, str], ...] = MINGLE,
) -> Array:
    """Vertices of the source moved onto the target.

    Minimises ``S sum |T_i - T_j|^2 + I sum |T_i - 1|^2 + C sum |x_k - c_k|^2`` over neighbouring triangles i, j, with
    T the deformation gradient of each triangle, in rounds with rising C; c_k is the point of the target closest to the
    vertex k where that was in the round before. Landmarks that both have are met exactly, their vertices eliminated.
    Vertices whose closest point is on the edge of the target, faces away or has a label that keeps apart are not drawn.

    Parameters
    ----------
    source, target : Surface
    closest : tuple of float
        Weight C of each round, distances in median edge lengths of the source; empty for landmarks alone.
    mingle : tuple of pairs of str
        Different labels that may be matched.

    Returns
    -------
    ndarray, shape (V, 3)
        In the frame and unit of the target.

    Raises
    ------
    EvalkitError
        If a mesh is broken, or fewer than four landmarks are shared or they lie on a line.
    """
    from scipy import sparse

    vertices, triangles = checked_mesh(source.vertices, source.triangles, source.name)
    on, faces = checked_mesh(target.vertices, target.triangles, target.name)
    for one in (source, target):
        if one.labels is not None and len(one.labels) != len(one.vertices):
            raise EvalkitError(f"{one.name}: {len(one.labels)} labels for {len(one.vertices)} vertices")
    held, places = shared_landmarks(source, target)
    rest = _similar(vertices[held], places, vertices)
    part = components(triangles, len(vertices))
    alone = np.flatnonzero(~np.isin(part, part[held]))
    if len(alone):
        raise EvalkitError(
            f"{source.name}: the part with vertex {alone[0]} has no landmark; give it one or take the part away"
        )

    count, number = len(rest), len(triangles)
    # Unknowns: the vertices, then each triangle's fourth vertex; the paper's form, as neighbours' whole gradients are
    # compared, not only what lies in their planes.
    rows = inverse(edge_frames(rest, triangles))
    weights = np.stack([-rows.sum(axis=0), rows[0], rows[1], rows[2]])
    columns = np.concatenate([triangles.T, count + np.arange(number)[None]])
    gradient = sparse.csr_matrix(
        (
            weights.transpose(2, 1, 0).ravel(),
            (np.repeat(np.arange(3 * number), 4), np.repeat(columns.T, 3, axis=0).ravel()),
        ),
        shape=(3 * number, count + number),
    )
    pairs = neighbours(triangles)
    lines = np.arange(len(pairs))
    difference = sparse.csr_matrix(
        (np.tile([1.0, -1.0], len(pairs)), (np.repeat(lines, 2), pairs.ravel())), shape=(len(pairs), number)
    )
    change = sparse.kron(difference, sparse.identity(3), format="csr") @ gradient
    energy = (SMOOTHNESS * (change.T @ change) + IDENTITY * (gradient.T @ gradient)).tocsr()
    right = IDENTITY * (gradient.T @ np.tile(np.eye(3), (number, 1)))

    edge = np.linalg.norm(rest[triangles[:, 0]] - rest[triangles[:, 1]], axis=1)
    unit = 1.0 / float(np.median(edge)) ** 2
    free = np.setdiff1d(np.arange(count + number), held)
    inner, coupling = energy[free][:, free], energy[free][:, held]
    base = right[free] - coupling @ places
    search = ClosestPoints(on, faces, target.labels, mingle)
    drawn = np.setdiff1d(np.arange(count), held)
    # Indices of the drawn vertices among the free unknowns: the held ones are all among the vertices.
    slot = np.searchsorted(free, drawn)
    moved = np.zeros((count, 3))
    for weight in (0.0, *closest):
        matrix, wanted = inner, base
        if weight:
            found, valid = search(moved[drawn], vertex_normals(moved, triangles)[drawn], _of(source.labels, drawn))
            amount = np.zeros(len(free))
            amount[slot[valid]] = weight * unit
            matrix = inner + sparse.diags(amount)
            wanted = base.copy()
            wanted[slot[valid]] += weight * unit * found[valid]
        solution = factorised(matrix).solve(wanted)
        moved[held] = places
        moved[drawn] = solution[slot]
    return moved


def shared_landmarks(source: Surface, target: Surface) -> tuple[Indices, Array]:
    """Vertices of the source, and where they belong on the target, of the landmarks that both have.

    Raises
    ------
    EvalkitError
        If there are fewer than four, they lie on a line, or two stand for one vertex.
    """
    from scipy.spatial import cKDTree

    names = sorted(set(source.landmarks) & set(target.landmarks))
    if len(names) < FEWEST:
        raise EvalkitError(
            f"{source.name} and {target.name}: {len(names)} landmarks of the same name; at least {FEWEST} are needed"
        )
    at = np.array([source.landmarks[name] for name in names], dtype=np.float64)
    _, held = cKDTree(source.vertices).query(at)
    _, first, counts = np.unique(held, return_index=True, return_counts=True)
    if counts.max() > 1:
        twice = [names[k] for k in np.flatnonzero(held == held[first[counts.argmax()]])]
        raise EvalkitError(f"{source.name}: landmarks '{twice[0]}' and '{twice[1]}' are the same vertex; leave one out")
    places = np.array([target.landmarks[name] for name in names], dtype=np.float64)
    for points, whose in ((at, source.name), (places, target.name)):
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if not spread[1] > 1e-6 * spread[0]:
            raise EvalkitError(f"{whose}: the {len(names)} shared landmarks lie on a line; add one beside it")
    return held.astype(np.intp), places


def _similar(points: Array, onto: Array, others: Array) -> Array:
    """Further points under the similarity that takes points onto others with the least squares error."""
    there = aligned(points, onto)
    a, b = points - points.mean(axis=0), there - there.mean(axis=0)
    # Between points and their image it is exact, up to a mirroring that four of them out of a plane exclude.
    scale = np.sqrt((b**2).sum() / (a**2).sum())
    u, _, vt = np.linalg.svd(a.T @ b)
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return np.asarray(scale * (others - points.mean(axis=0)) @ turn + there.mean(axis=0))


def neighbours(triangles: Indices) -> Indices:
    """Pairs of triangles that share an edge, (P, 2)."""
    sides = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    order = np.lexsort((sides[:, 1], sides[:, 0]))
    same = (sides[order[1:]] == sides[order[:-1]]).all(axis=1)
    owner = order // 3
    return np.stack([owner[:-1][same], owner[1:][same]], axis=1)


def border(triangles: Indices, count: int) -> NDArray[np.bool_]:
    """Vertices on an edge of the mesh, (V,)."""
    sides = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    found, times = np.unique(sides, axis=0, return_counts=True)
    out = np.zeros(count, dtype=bool)
    out[found[times == 1].ravel()] = True
    return out


class ClosestPoints:
    """Closest points of a mesh that face the same way and have a label that may be met.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
    triangles : ndarray of int, shape (T, 3)
    labels : ndarray of str, shape (V,), optional
    mingle : tuple of pairs of str
    """

    def __init__(
        self, vertices: Array, triangles: Indices, labels: NDArray[np.str_] | None, mingle: tuple[tuple[str, str], ...]
    ) -> None:
        from scipy.spatial import cKDTree

        self.vertices, self.triangles, self.labels, self.mingle = vertices, triangles, labels, mingle
        self._normals, self._border = vertex_normals(vertices, triangles), border(triangles, len(vertices))
        self._used = np.unique(triangles)
        self._tree = cKDTree(vertices[self._used])
        # Triangles around each vertex, padded with a repetition of the first.
        corner = triangles.ravel()
        order = np.argsort(corner, kind="stable")
        start = np.searchsorted(corner[order], np.arange(len(vertices) + 1))
        most = int(np.diff(start).max())
        slot = np.minimum(start[:-1, None] + np.arange(most), np.maximum(start[1:, None] - 1, start[:-1, None]))
        self._around = order[np.minimum(slot, len(order) - 1)] // 3

    def __call__(
        self, points: Array, normals: Array, labels: NDArray[np.str_] | None
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Closest points (P, 3) of points (P, 3), and which of them there are, (P,)."""
        near = self._used[self._tree.query(points, k=min(CANDIDATES, len(self._used)))[1].reshape(len(points), -1)]
        fits = np.einsum("pi,pki->pk", normals, self._normals[near]) > 0.0
        if labels is not None and self.labels is not None:
            fits &= matching(labels[:, None], self.labels[near], self.mingle)
        best = near[np.arange(len(points)), fits.argmax(axis=1)]
        faces = self.triangles[self._around[best]]
        closest = closest_on_triangles(points[:, None], *(self.vertices[faces[..., k]] for k in range(3)))
        off = ((closest - points[:, None]) ** 2).sum(axis=-1)
        # The triangles around a vertex that fits may themselves reach over a label's border, by less than one edge.
        return closest[np.arange(len(points)), off.argmin(axis=1)], fits.any(axis=1) & ~self._border[best]


def matching(a: NDArray[np.str_], b: NDArray[np.str_], mingle: tuple[tuple[str, str], ...]) -> NDArray[np.bool_]:
    """Which pairs of labels may be matched with each other."""
    out = a == b
    for one, other in mingle:
        out = out | ((a == one) & (b == other)) | ((a == other) & (b == one))
    return np.asarray(out)


def closest_on_triangles(points: Array, a: Array, b: Array, c: Array) -> Array:
    """Point of each triangle closest to a point; shapes (..., 3), broadcast.

    The foot of the perpendicular where it is inside, else the closest of the closest points of the three sides.
    """
    ab, ac, ap = b - a, c - a, points - a
    d00, d01, d11 = ((p * q).sum(axis=-1) for p, q in ((ab, ab), (ab, ac), (ac, ac)))
    d20, d21 = (ap * ab).sum(axis=-1), (ap * ac).sum(axis=-1)
    scale = d00 * d11 - d01**2
    v, w = (d11 * d20 - d01 * d21) / scale, (d00 * d21 - d01 * d20) / scale
    inside = (v >= 0.0) & (w >= 0.0) & (v + w <= 1.0)
    out = a + v[..., None] * ab + w[..., None] * ac
    best = np.where(inside, 0.0, np.inf)
    for start, side in ((a, ab), (a, ac), (b, c - b)):
        share = np.clip(((points - start) * side).sum(axis=-1) / (side**2).sum(axis=-1), 0.0, 1.0)
        on = start + share[..., None] * side
        off = ((points - on) ** 2).sum(axis=-1)
        nearer = off < best
        out, best = np.where(nearer[..., None], on, out), np.where(nearer, off, best)
    return np.asarray(out)


def _of(labels: NDArray[np.str_] | None, which: Indices) -> NDArray[np.str_] | None:
    return None if labels is None else np.asarray(labels)[which]
