"""The performer's surface: a head that fits his markers at rest, and how its skin follows them.

A marker database knows the face at some fifty places. The built-in head is warped onto them (the paper has a scan of
the performer instead), and every vertex of it follows the markers around it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array
from scipy.spatial import Delaunay

from evalkit.control.cylindrical import barycentric, covering, cylinder_about
from evalkit.control.slits import opposite, sides_of_slits, vertex_sides
from evalkit.control.warp import fit_warp
from evalkit.deform import deformation_map
from evalkit.deform.surface import edge_graph, spread_out
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import Head, load_head
from evalkit.head.mesh import closest_points
from evalkit.transfer.registration import closest_on_triangles
from evalkit.vision.markers import KNOWN_LABELS
from evalkit.vision.points import BETWEEN, FACE_POINTS

FEWEST = 6
"""Markers on known points of the face that a head can be laid on: both sides, top to bottom, and something in front."""

OFF_SKIN_MM = 15.0
"""A marker that comes to lie further from the head's skin is on a helmet or a shoulder, and moves no skin."""

APART_MM = 3.0
"""Of markers nearer to each other, the later one is left out: the skin between two would be pulled apart by noise."""

ROUNDS = 3
"""A marker beyond the points that are known, as at the side of a chin, may lie off the skin before its neighbours have
drawn it near."""

HELD = 40
"""Places of the face's edge that stand still; on average 12 mm apart, closer than markers are."""


@dataclass(frozen=True, eq=False)
class Source:
    """The performer's head and his markers on it.

    Attributes
    ----------
    head : Head
        At rest, in the axes of the markers, mm.
    labels : tuple of str, length M
        All markers, in the order given.
    used : ndarray of int
        Those of them that lie on the skin.
    places : ndarray, shape (used, 3), mm
        Where they touch it.
    text : str
        One line: how the head was fitted, and which markers are left out.
    """

    head: Head
    labels: tuple[str, ...]
    used: np.ndarray
    places: Array
    text: str


def performer_surface(labels: Sequence[str], rest_mm: ArrayLike, head: Head | None = None) -> Source:
    """Fit a head to the markers of a performer at rest.

    A warp brings the head's landmarks to the markers that are known points of the face; markers of any other name are
    laid on the nearest skin, and another warp takes the skin to all of them.

    Parameters
    ----------
    labels : sequence of str
        Known points are those of :data:`evalkit.vision.markers.KNOWN_LABELS`.
    rest_mm : array_like, shape (M, 3), mm
        Frontal axes: x to the performer's left, y up, z forward.
    head : Head, optional
        The head that is fitted, by default the built-in one.

    Raises
    ------
    EvalkitError
        If shapes do not fit, a position is not finite, or too few labels are known.
    """
    rest = np.asarray(rest_mm, dtype=np.float64)
    if rest.shape != (len(labels), 3):
        raise EvalkitError(f"{len(labels)} labels and positions of shape {rest.shape}; expected ({len(labels)}, 3)")
    bad = np.flatnonzero(~np.isfinite(rest).all(axis=1))
    if len(bad):
        raise EvalkitError(f"marker {labels[bad[0]]} has no rest position; leave it out")
    head = head or load_head()
    known = point_places(head)
    anchors: dict[str, int] = {}
    for k, label in enumerate(labels):
        point = KNOWN_LABELS.get(label.rpartition(":")[2])
        if point in known:
            anchors.setdefault(point, k)
    if len(anchors) < FEWEST:
        raise EvalkitError(
            f"only {len(anchors)} markers are on a known point of the face, {FEWEST} are needed to lay a head on them; "
            f"name them after the points ({', '.join(FACE_POINTS)}); the markers are {', '.join(labels[:12])} ..."
        )
    first = fit_warp({name: known[name] for name in anchors}, {name: rest[k] for name, k in anchors.items()})
    laid = moved_head(head, first)
    used = np.zeros(0, dtype=np.intp)
    for _ in range(ROUNDS):
        on_skin, off = closest_points(rest, laid.vertices, laid.part_triangles("skin", "lids"))
        on_skin[list(anchors.values())] = rest[list(anchors.values())]
        near = np.flatnonzero(off <= OFF_SKIN_MM)
        gaps = np.linalg.norm(rest[near, None] - rest[near], axis=2)
        before, used = len(used), near[~(np.tril(gaps < APART_MM, -1)).any(axis=1)]
        if len(used) == before:
            break
        laid = moved_head(laid, fit_warp({str(k): on_skin[k] for k in used}, {str(k): rest[k] for k in used}))
    fitted = replace(laid, name="performer")
    out = np.setdiff1d(np.arange(len(labels)), used)
    text = f"{head.name} laid on {len(anchors)} points and {len(used) - len(anchors)} other markers"
    if len(out):
        text += f"; left out, off the skin or on another marker: {', '.join(labels[k] for k in out)}"
    return Source(fitted, tuple(labels), used, rest[used], text)


def point_places(head: Head) -> dict[str, Array]:
    """Face points (19 at most) on a head, by its landmarks."""
    out = {name: head.landmarks[name] for name in FACE_POINTS if name in head.landmarks}
    for name, both in BETWEEN.items():
        if all(one in head.landmarks for one in both):
            out[name] = np.mean([head.landmarks[one] for one in both], axis=0)
    return out


def moved_head(head: Head, warp: Callable[[Array], Array]) -> Head:
    """A head with vertices, landmarks and marker sites moved by a warp; what else it has of a motion is left behind."""
    places = [
        dict(zip(where, warp(np.array(list(where.values())).reshape(-1, 3)), strict=True))
        for where in (head.landmarks, head.marker_sites)
    ]
    return replace(
        head, vertices=warp(head.vertices), landmarks=places[0], marker_sites=places[1], jaw=None, lids=None,
        blendshapes={},
    )  # fmt: skip


def barycentric_spread(source: Source, slits: bool = True) -> csr_array:
    """Weights (V, M) of the markers for a source head's vertices: barycentric in the markers' triangulation.

    The markers, and places of the face's edge that stand still, are triangulated where they are seen from the axis of
    the head (Delaunay). A vertex whose triangle has a marker on the other side of mouth or eye takes the closest place
    of the triangles that have none instead.

    Parameters
    ----------
    source : Source
    slits : bool
        Whether mouth and eyes keep their sides apart; without, as in the paper, a jaw that opens pulls the upper lip.

    References
    ----------
    Chai, Xiao and Hodgins, "Vision-based control of 3D facial animation", SCA 2003, section 6.
    """
    head = source.head
    cylinder = cylinder_about(head.landmarks, head.name)
    still = held_places(head)
    flat = cylinder.unrolled(np.vstack([source.places, still]))[:, :2]
    moving = np.unique(np.concatenate([head.regions[name] for name in ("face", "upper lip", "lower lip")]))
    points = cylinder.unrolled(head.vertices[moving])[:, :2]
    triangles = Delaunay(flat).simplices.astype(np.intp)
    found = covering(points, flat, triangles)
    # On a common edge the first triangle is as good as the other.
    inside, first = np.unique(found.point, return_index=True)
    moving, points = moving[inside], points[inside]
    corners, shares = triangles[found.triangle[first]], np.clip(found.shares[first], 0.0, 1.0)
    if slits:
        marks = np.vstack([sides_of_slits(head.landmarks, source.places), np.zeros((len(still), 3), dtype=np.int8)])
        own = vertex_sides(head)[moving]
        clash = opposite(own[:, None], marks[corners]).any(axis=1)
        for side in np.unique(own[clash], axis=0):
            mine = np.flatnonzero(clash & (own == side).all(axis=1))
            allowed = triangles[~opposite(side, marks[triangles]).any(axis=1)]
            corners[mine], shares[mine] = _closest(points[mine], flat, allowed)
    seen = corners < len(source.places)
    columns = source.used[np.where(seen, corners, 0)]
    rows = np.repeat(moving, 3)
    return csr_array(
        (np.where(seen, shares, 0.0).ravel(), (rows, columns.ravel())), shape=(len(head.vertices), len(source.labels))
    )


def _closest(points: Array, flat: Array, triangles: np.ndarray) -> tuple[np.ndarray, Array]:
    """Corners and barycentric coordinates of the closest place of some triangles of the plane; few of either."""
    corners = np.pad(flat, ((0, 0), (0, 1)))[triangles]
    place = closest_on_triangles(np.pad(points, ((0, 0), (0, 1)))[:, None], *(corners[None, :, k] for k in range(3)))
    best = ((place[..., :2] - points[:, None]) ** 2).sum(axis=2).argmin(axis=1)
    shares = np.clip(barycentric(place[np.arange(len(points)), best, :2], flat[triangles[best]]), 0.0, 1.0)
    return triangles[best], shares / shares.sum(axis=1, keepdims=True)


def held_places(head: Head) -> Array:
    """Places (K, 3) around the face that no motion reaches: where its region meets neck and hindbrain."""
    around = np.zeros(len(head.vertices), dtype=bool)
    around[np.concatenate([head.regions["neck"], head.regions["hindbrain"]])] = True
    face = np.zeros(len(head.vertices), dtype=bool)
    face[head.regions["face"]] = True
    graph = edge_graph(head.vertices, head.part_triangles("skin")).astype(bool)
    edge = np.flatnonzero(around & (graph @ face))
    return np.asarray(head.vertices[edge[spread_out(head.vertices[edge], HELD)]])


def kernel_spread(source: Source) -> csr_array:
    """Weights (V, M) of the toolkit's own map from markers to vertices, :func:`evalkit.deform.deformation_map`."""
    labels = [source.labels[k] for k in source.used]
    weights = deformation_map(source.head, dict(zip(labels, source.places, strict=True)))
    out = np.zeros((len(weights), len(source.labels)))
    out[:, source.used] = weights
    return csr_array(out)


spreads: dict[str, Callable[[Source], csr_array]] = {
    "barycentric": barycentric_spread,
    "barycentric without slits": lambda source: barycentric_spread(source, slits=False),
    "kernel": kernel_spread,
}
"""How marker motion spreads over the performer's skin, name to ``source -> weights (V, M)``."""

DEFAULT_SPREAD = "kernel"
"""In the study ``retarget`` nearer to truth over the whole face than the barycentric one, which is the paper's, and as
near at lips and brows: between chin and neck, where no markers are, a barycentric field falls off too soon."""
