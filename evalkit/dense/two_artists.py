"""Two artists, one list of expressions: the hand-made shapes of ICT-FaceKit and of MakeHuman on each other's head.

A truth that nobody here has made: rough is what Deformation Transfer makes of one artist's shapes on the other's head,
fine is what that other artist sculpted under the same name.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from evalkit.deform.surface import edge_distance, edge_graph
from evalkit.dense.actors import CORRECTIVE, ICT_FILE
from evalkit.dense.anatomy import SIDES, anatomy_of, front_of, hand_drawn_regions, scored_regions
from evalkit.dense.characters import Character, shared_names
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import Head, load_head
from evalkit.head.ict import ict_face, read_ict
from evalkit.head.model import SOFT, Indices
from evalkit.transfer.correspondence import Correspondence, corresponding
from evalkit.transfer.deformation_transfer import DeformationTransfer, still_vertices
from evalkit.transfer.registration import Surface

DIRECTIONS = ("ict to makehuman", "makehuman to ict")
"""Whose shapes go onto whose head."""

MAKEHUMAN_CURVES = {
    "upper lid": (4306, 4310, 4298, 4303, 4322), "lower lid": (4306, 4308, 4316, 4320, 4322),
    "upper lip outer": (455, 2651, 2606, 2598), "lower lip outer": (492, 2671, 2601, 2598),
    "upper lip inner": (474, 2663, 2615, 2628), "lower lip inner": (493, 2672, 2633, 2628),
}  # fmt: skip
"""Vertices along each margin of the left side, from the middle of the face outward; those between are found."""

ICT_CURVES = {
    "upper lid": (43, 44, 45, 46), "lower lid": (43, 48, 47, 46),
    "upper lip outer": (52, 53, 54, 55), "lower lip outer": (58, 57, 56, 55),
    "upper lip inner": (63, 64, 65), "lower lip inner": (67, 66, 65),
}  # fmt: skip
"""The same by the numbers (from 1) of the 300-W scheme."""

ON_CURVES = ("mouth corner", "eye inner", "eye outer", "upper lip", "lower lip", "lid")
"""A head's own landmarks with these words in their names are on the curves."""

TRAINING = ("jawOpen", "mouthSmileLeft", "browInnerUp", "eyeBlinkLeft")
UNLIKE = ("mouthFunnel", "noseSneerRight", "mouthRollLower")


@dataclass(frozen=True, eq=False)
class Artist:
    """A head with what its artist sculpted.

    Attributes
    ----------
    head : Head
    soft : ndarray of int, shape (V,)
        Vertices of the head that the surface has.
    surface : Surface
        The soft parts at rest, mm, with landmarks and labels.
    curves : dict of str to ndarray of int
        Vertices of the surface along the margins of lids and lips; the names of :data:`ICT_CURVES`, each with a side.
    shapes : dict of str to ndarray, shape (all vertices of the head, 3), mm
        Displacements.
    """

    head: Head
    soft: Indices
    surface: Surface
    curves: dict[str, Indices]
    shapes: dict[str, Array]


def two_artists(direction: str, path: str | Path | None = None) -> Character:
    """One artist's shapes on the other's head beside what the other sculpted.

    A shape that is made to go together with another (mouthClose with jawOpen) goes together with it.

    Parameters
    ----------
    direction : str
        One of :data:`DIRECTIONS`.
    path : str or Path, optional
        ICT-FaceKit as :func:`evalkit.head.ict.ict_face` takes it; by default in the folder ``EVALKIT_REAL_DATA``.

    Returns
    -------
    Character
        The front of the target's head.

    Raises
    ------
    EvalkitError
        If there is no such direction or a head is not there.
    """
    if direction not in DIRECTIONS:
        raise EvalkitError(f"direction '{direction}' is not known; known are {' and '.join(DIRECTIONS)}")
    if path is None and not os.environ.get("EVALKIT_REAL_DATA"):
        raise EvalkitError("two artists: set EVALKIT_REAL_DATA to the folder that holds " + "/".join(ICT_FILE))
    both = artists(Path(path) if path else Path(os.environ["EVALKIT_REAL_DATA"], *ICT_FILE))
    source, target = (both[name] for name in direction.split(" to "))
    names, between = tuple(source.shapes), heads_correspondence(source, target)
    a, b = source.surface, target.surface
    shapes = a.vertices + np.stack([source.shapes[name][source.soft] for name in names])
    pinned = still_vertices(a.vertices, a.triangles, shapes, b.triangles, between)
    transfer = DeformationTransfer(a.vertices, a.triangles, b.vertices, b.triangles, between, pinned)
    head, front, fine = target.head, front_of(target.head), target.shapes
    opened = front.rest + fine["jawOpen"][front.kept]
    closed = front.rest + (fine["eyeBlinkLeft"] + fine["eyeBlinkRight"])[front.kept]
    anatomy = anatomy_of(head, front, opened, closed)
    inner = [front.rest[anatomy.places[f"eye inner {side}"]] for side in SIDES]
    return Character(
        name=direction,
        rest=front.rest,
        triangles=front.triangles,
        names=names,
        rough=transfer.transfer(shapes)[:, np.searchsorted(target.soft, front.kept)],
        fine=front.rest + np.stack([fine[name][front.kept] for name in names]),
        regions=scored_regions(head, front, anatomy),
        hand_drawn=hand_drawn_regions(head, front, anatomy),
        eye_distance_mm=float(np.linalg.norm(inner[0] - inner[1])),
        training=TRAINING,
        unlike=UNLIKE,
    )


@lru_cache(maxsize=1)
def artists(path: Path) -> dict[str, Artist]:
    """Both, with the expressions that both have by MakeHuman's names."""
    makehuman, ict, listed = load_head("makehuman"), read_ict(path), ict_face(path).landmarks
    parts = shared_names(ict, makehuman)
    curves = {name: tuple(int(listed[k - 1]) for k in numbers) for name, numbers in ICT_CURVES.items()}
    return {
        "ict": _artist(ict, curves, parts),
        "makehuman": _artist(makehuman, MAKEHUMAN_CURVES, {name: (name,) for name in parts}),
    }


def _artist(head: Head, curves: dict[str, tuple[int, ...]], parts: dict[str, tuple[str, ...]]) -> Artist:
    soft = head.soft_vertices
    number = np.full(len(head.vertices), -1)
    number[soft] = np.arange(len(soft))
    vertices, triangles = head.vertices[soft], number[head.part_triangles(*SOFT)]
    graph = edge_graph(vertices, triangles)
    margins = _both_sides(vertices, graph, {name: number[list(along)] for name, along in curves.items()})
    shapes = {}
    for name in parts:
        moves = np.zeros_like(head.vertices)
        for unit in (*parts[name], *parts.get(CORRECTIVE.get(name, ""), ())):
            which, by = head.blendshapes[unit]
            moves[which] += by
        shapes[name] = moves
    labels = _labels(head, vertices, graph, margins)
    return Artist(head, soft, Surface(vertices, triangles, head.landmarks, labels, head.name), margins, shapes)


def _both_sides(vertices: Array, graph: csr_array, curves: dict[str, Indices]) -> dict[str, Indices]:
    """Vertices along the curves; on the right through the vertices opposite."""
    tree = cKDTree(vertices)
    return {
        f"{name} {side}": _path(graph, tree.query(vertices[along] * [sign, 1.0, 1.0])[1])
        for name, along in curves.items()
        for side, sign in SIDES.items()
    }


def _path(graph: csr_array, along: Indices) -> Indices:
    """The shortest way along edges through some vertices."""
    out = [int(along[0])]
    for start, end in pairwise(along):
        _, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
        way = [int(end)]
        while way[-1] != start:
            way.append(int(before[way[-1]]))
        out += way[-2::-1]
    return np.array(out)


def _labels(head: Head, vertices: Array, graph: csr_array, curves: dict[str, Indices]) -> NDArray[np.str_]:
    """Kind of each vertex: skin, either lip, and what lies behind the margins of either lip and of the lids."""
    nose = int(np.linalg.norm(vertices - head.landmarks["nose tip"], axis=1).argmin())
    out = np.full(len(vertices), "skin", dtype="<U16")
    for lip in ("upper lip", "lower lip"):
        out[np.searchsorted(head.soft_vertices, np.intersect1d(head.regions[lip], head.soft_vertices))] = lip

    def behind(rim: list[Indices]) -> NDArray[np.bool_]:
        kept = np.setdiff1d(np.arange(len(vertices)), np.concatenate(rim))
        part = connected_components(graph[kept][:, kept], directed=False)[1]
        hidden = np.zeros(len(vertices), dtype=bool)
        hidden[kept] = part != part[np.searchsorted(kept, nose)]
        return hidden

    for side in SIDES:
        out[behind([curves[f"{lid} lid {side}"] for lid in ("upper", "lower")])] = "eye socket"
    rims = {lip: [curves[f"{lip} lip inner {side}"] for side in SIDES] for lip in ("upper", "lower")}
    mouth = behind(rims["upper"] + rims["lower"])
    upper, lower = (edge_distance(graph, np.concatenate(rim)) for rim in rims.values())
    out[mouth & (upper <= lower)], out[mouth & (upper > lower)] = "upper pocket", "lower pocket"
    for lip, rim in rims.items():
        out[np.concatenate(rim)] = f"{lip} lip"
    return out


def with_curves(source: Artist, target: Artist) -> tuple[Surface, Surface]:
    """Both surfaces with landmarks along the margins: the source's vertices, each at its share of the target's."""
    a, b = (
        {name: place for name, place in artist.surface.landmarks.items() if not any(word in name for word in ON_CURVES)}
        for artist in (source, target)
    )
    taken: set[int] = set()
    for name, along in source.curves.items():
        places, onto = source.surface.vertices[along], target.surface.vertices[target.curves[name]]
        share, known = _shares(places), _shares(onto)
        for k, vertex in enumerate(along):
            # Margins end in common corners.
            if int(vertex) not in taken:
                taken.add(int(vertex))
                a[f"{name} {k}"] = places[k]
                b[f"{name} {k}"] = np.array([np.interp(share[k], known, onto[:, axis]) for axis in range(3)])
    return replace(source.surface, landmarks=a), replace(target.surface, landmarks=b)


def _shares(places: Array) -> Array:
    """Share of a curve's length that lies before each of its vertices."""
    before = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))]
    return np.asarray(before / before[-1])


def heads_correspondence(source: Artist, target: Artist) -> Correspondence:
    """Corresponding triangles of two heads."""
    # The coarser head is bent: its vertices along the margins are the landmarks.
    bent, other = sorted((source, target), key=lambda artist: len(artist.soft))
    a, b = with_curves(bent, other)
    return corresponding(a, b) if bent is source else corresponding(b, a)
