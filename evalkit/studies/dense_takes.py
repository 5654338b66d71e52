"""What the studies of deformation share: a dense performance with its markers, maps by name, errors of all vertices."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from evalkit.deform import Deformer, deformation_report
from evalkit.deform.kernels import OWN
from evalkit.deform.surface import edge_distance, edge_graph
from evalkit.dense import Face, LipContact, Performance, lip_contact, muscle_face, perform, skin_of_ict, unit_face
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import load_head
from evalkit.metrics import inverted_triangles, lip_penetration_mm, vertex_error_mm
from evalkit.study.statistics import Statistic, mean, root_mean_square

FRAMES = 300
"""Ten seconds: every action at least once."""

ICT_FILE = ("meshes", "ict_facekit_subset.npz")
"""Where in the folder of real data ICT-FaceKit's arrays are."""

STILL = "no motion"
"""The reference row: a face that stays as it is."""

KERNELS = tuple(name for name in OWN if name != "geodesic-exponential" or find_spec("potpourri3d"))
"""Kernels that can be measured here: geodesic distances need an optional package."""

MOVES_MM = 0.1
"""A vertex that never goes so far does not move."""

CROSSED_MM = 0.1
"""Lips that are so much deeper in each other than in truth have crossed; half of what a renderer shows."""

FLIP_STEP = 5
"""Inverted triangles are counted in every fifth frame."""


@lru_cache(maxsize=2)
def dense_face(name: str) -> Face:
    """A face by name.

    ``template`` and ``template 3000`` (vertices) have muscles; ``ict`` is ICT-FaceKit from the folder that the
    environment variable EVALKIT_REAL_DATA names; anything else is what :func:`evalkit.load_head` takes, with its own
    face units if it has them.

    Raises
    ------
    EvalkitError
        If there is no such head.
    """
    if name == "ict":
        folder = os.environ.get("EVALKIT_REAL_DATA")
        if not folder:
            raise EvalkitError("head ict: set EVALKIT_REAL_DATA to the folder that holds " + "/".join(ICT_FILE))
        return unit_face(skin_of_ict(Path(folder, *ICT_FILE)))
    first, _, count = name.partition(" ")
    if first == "template" and count:
        if not count.isdigit():
            raise EvalkitError(f"head '{name}': after template comes a number of vertices")
        return muscle_face(load_head(first, vertices=int(count)))
    head = load_head(name)
    return unit_face(head) if "jawOpen" in head.blendshapes else muscle_face(head)


@dataclass(frozen=True, eq=False)
class DenseTake:
    """A dense performance as a map sees it, and its truth beside it.

    Attributes
    ----------
    performance : Performance
    markers : dict of str to int
        Label to vertex.
    displacement : ndarray, shape (F, n, 3), mm
        Of the markers from rest, with noise.
    truth : ndarray of float32, shape (F, V, 3), mm
        Kept, since many methods are held against it; a study's takes are short.
    moving : ndarray of bool, shape (V,)
        Vertices that move in truth.
    contact : LipContact
    """

    performance: Performance
    markers: dict[str, int]
    displacement: Array
    truth: Any
    moving: Any
    contact: LipContact

    @property
    def face(self) -> Face:
        """Who performs."""
        return self.performance.face


def paper_markers(face: Face) -> dict[str, int]:
    """The head's own marker sites, each at its nearest vertex."""
    return face.head.nearest_vertices(face.head.marker_sites)


def more_markers(face: Face, count: int) -> dict[str, int]:
    """Any number of markers: the paper's sites in the order of their use, then skin far from all markers.

    The first four are on the lips and at their corners, so that either lip has markers of its own; then follows
    whatever is furthest, over the surface, from those taken before: first of the marker sites, then of the skin of face
    and lips.
    """
    head = face.head
    graph = edge_graph(head.vertices, head.triangles)
    sites = paper_markers(face)
    skin = np.intersect1d(
        np.concatenate([head.regions[r] for r in ("face", "upper lip", "lower lip")]), head.skin_vertices
    )
    chosen = {name: sites[name] for name in ("UpperLipC", "LowerLipC", "MouthL", "MouthR")}
    labels = {vertex: name for name, vertex in sites.items()}
    distance = edge_distance(graph, list(chosen.values()))
    while len(chosen) < count:
        pool = np.array([v for v in sites.values() if v not in chosen.values()]) if len(chosen) < len(sites) else skin
        reachable = np.where(np.isfinite(distance[pool]), distance[pool], -1.0)
        vertex = int(pool[np.argmax(reachable)])
        chosen[labels.get(vertex, f"Skin{len(chosen) + 1:03d}")] = vertex
        distance = np.minimum(distance, edge_distance(graph, [vertex]))
    return dict(list(chosen.items())[:count])


def dense_take(head: str, seed: int, noise_mm: float = 0.0, markers: Mapping[str, int] | None = None) -> DenseTake:
    """The data of a cell."""
    face = dense_face(head)
    performance = perform(face, frames=FRAMES, seed=seed)
    worn = dict(markers or paper_markers(face))
    points = performance.capture(worn, noise_mm=noise_mm, seed=seed)[0].points
    rest = face.head.vertices
    truth = np.empty((FRAMES, *rest.shape), dtype=np.float32)
    furthest = np.zeros(len(rest))
    for part, vertices in performance.batches():
        truth[part] = vertices
        furthest = np.maximum(furthest, vertex_error_mm(vertices, rest[None]).max(axis=0))
    moving = (furthest > MOVES_MM) & np.isin(np.arange(len(rest)), face.head.soft_vertices)
    return DenseTake(performance, worn, points - rest[list(worn.values())], truth, moving, lip_contact(face.head))


def build_map(data: DenseTake, kernel: str, **options: Any) -> tuple[Array, float]:
    """Weights (V, n) of a map and the largest condition number of its fields; all zero for :data:`STILL`."""
    head = data.face.head
    if kernel == STILL:
        return np.zeros((len(head.vertices), len(data.markers))), 1.0
    found = deformation_report(head, data.markers, kernel, **options)
    return found.weights, max(field.condition for field in found.fields)


DENSE_COLUMNS = {
    "all_mm": "rms distance from truth of the vertices of the outer skin that move in truth, over all frames, mm",
    "face_mm": "the same of those of the face region",
    "upper_mm": "the same of those of the upper lip",
    "lower_mm": "the same of those of the lower lip",
    "lips_mm": "the same of both",
    "inside_mm": "the same of the lining of the mouth; empty for a head without one",
    "rim_mm": "rms distance of vertices of hindbrain and neck that do not move in truth, mm",
    "worst_mm": "largest error of a moving vertex of the outer skin in any frame, mm",
    "crossed_percent": f"frames with lips more than {CROSSED_MM:g} mm deeper in each other than in truth, %",
    "penetration_mm": "deepest the lips go through each other, mm; empty if they do not touch at rest",
    "inverted": f"triangles of the skin turned over against truth, mean over every {FLIP_STEP}th frame",
    "condition": "largest condition number of the systems solved",
}
"""Columns of :func:`score_map`."""

DENSE_STATISTICS: tuple[Statistic, ...] = (
    root_mean_square("all_mm", "all moving", "mm"),
    root_mean_square("face_mm", "face", "mm"),
    root_mean_square("lips_mm", "lips", "mm"),
    root_mean_square("upper_mm", "upper lip", "mm"),
    root_mean_square("lower_mm", "lower lip", "mm"),
    mean("penetration_mm", "lips through each other", "mm"),
    mean("crossed_percent", "frames with crossed lips", "%"),
    mean("inverted", "inverted triangles", ""),
)
"""What is made of them in every study."""


def groups(data: DenseTake) -> dict[str, Any]:
    """Column of :data:`DENSE_COLUMNS` to the vertices that it is about."""
    head, moving = data.face.head, data.moving
    skin = head.skin_vertices
    lips = {name: np.intersect1d(head.regions[f"{name} lip"], skin) for name in ("upper", "lower")}
    rim = np.concatenate([head.regions["hindbrain"], head.regions["neck"]])
    found = {
        "all_mm": skin,
        "face_mm": np.intersect1d(head.regions["face"], skin),
        "upper_mm": lips["upper"],
        "lower_mm": lips["lower"],
        "lips_mm": np.concatenate(list(lips.values())),
        "inside_mm": np.setdiff1d(head.part_vertices("mouth pocket"), skin),
    }
    return {name: which[moving[which]] for name, which in found.items()} | {"rim_mm": rim[~moving[rim]]}


def score_map(data: DenseTake, result: tuple[Array, float]) -> dict[str, Any]:
    """Errors of a map against the true vertices."""
    weights, condition = result
    head, contact = data.face.head, data.contact
    parts = groups(data)
    deform = Deformer(weights, head.vertices)
    triangles = head.part_triangles("skin", "lids")
    squares = dict.fromkeys(parts, 0.0)
    worst, depth, inverted = 0.0, [np.zeros(0)], [np.zeros(0)]
    for part, truth in _blocks(data.truth):
        vertices = np.ascontiguousarray(deform(data.displacement[part]))
        errors = vertex_error_mm(vertices, truth)
        for name, which in parts.items():
            squares[name] += float((errors[:, which] ** 2).sum())
        worst = max(worst, float(errors[:, parts["all_mm"]].max(initial=0.0)))
        if len(contact.lower):
            deep = lip_penetration_mm(vertices, truth, contact.lower, contact.upper, contact.share)
            depth.append(deep.max(axis=1))
        some = np.flatnonzero(np.arange(part.start, part.stop) % FLIP_STEP == 0)
        inverted.append(inverted_triangles(vertices[some], truth[some], triangles))
    frames = len(data.truth)
    deepest = np.concatenate(depth)
    found = {n: np.sqrt(squares[n] / (frames * len(which))) if len(which) else None for n, which in parts.items()}
    return {
        **found,
        "worst_mm": worst,
        "crossed_percent": 100.0 * float((deepest > CROSSED_MM).mean()) if deepest.size else None,
        "penetration_mm": float(deepest.max()) if deepest.size else None,
        "inverted": float(np.concatenate(inverted).mean()),
        "condition": condition,
    }


def _blocks(truth: Any, frames: int = 50) -> Any:
    for start in range(0, len(truth), frames):
        part = slice(start, min(start + frames, len(truth)))
        yield part, truth[part].astype(np.float64)
