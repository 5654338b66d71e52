"""The front of a face and where its movable parts are: what a sculptor looks at, the same for every head."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from evalkit.deform.surface import edge_distance, edge_graph
from evalkit.dense.face_units import hinge
from evalkit.dense.mouth import lip_contact
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import Head
from evalkit.head.model import SOFT, Indices

FRONT = ("face", "upper lip", "lower lip")
"""Regions of a head that are kept: no neck, no rear of the head."""

RIM_MM = 60.0
"""So much of the head above the brows is kept around the face, over the surface: skin that stays still, by which the
solution of a method is held in place."""

SIDES = {"left": 1.0, "right": -1.0}
"""Side of the person -> sign of x."""

MIDDLE_MM = 8.0
"""How far the lips part is measured so near to the middle of the face."""

LIP_NODES, LIP_NODE_MM = 17, 4.0
"""A lip's axis is a curve through so many places across the mouth, each a mean over so much width."""

LID_MIDDLE_MM = 4.0
"""The margins of the lids are looked for so near to the middle of the eye."""

EVEN_MM = 0.01
"""Places that lie as far as each other on the left and the right may differ by so much."""

SHUT = 0.5
"""An eye that is narrowed by less than this when it should be closed does not close."""

REACH_MM = {
    "corner": 34.0, "cheek": 26.0, "brow": 24.0, "nose": 18.0, "mouth": 34.0, "lips": 12.0, "eye": 11.0,
    "forehead": 40.0, "glabella": 18.0,
}  # fmt: skip
"""Beyond this distance from its middle (of the eyes: from :data:`SOCKET_MM`) a part ends; it fades as ``cos²``."""

SOCKET_MM = 17.0
"""So near to the middle of the eyeball all is lid."""

SCORED_MM = {"brows": 12.0, "cheeks": 18.0, "nose": 14.0, "lids": 9.0}
"""Regions in which errors are told apart: the skin so near, over the surface, to their middle or margin."""


@dataclass(frozen=True, eq=False)
class Front:
    """The part of a head that a character keeps.

    Attributes
    ----------
    kept : ndarray of int, shape (V,)
        Vertices of the head.
    rest : ndarray, shape (V, 3), mm
    triangles : ndarray of int, shape (T, 3)
    """

    kept: Indices
    rest: Array
    triangles: Indices

    def of(self, vertices: Indices) -> Indices:
        """New numbers of vertices of the head; those that are not kept are left out."""
        return np.flatnonzero(np.isin(self.kept, vertices))


@dataclass(frozen=True, eq=False)
class Anatomy:
    """Where the parts of a face are.

    Attributes
    ----------
    share : ndarray, shape (V,)
        Part of the jaw's angle by which a vertex follows it, 0 to 1.
    hinge : ndarray, shape (3,), mm
        A point of the jaw's axis, which is parallel to x.
    eyes : dict of str to ndarray, shape (3,), mm
        Middle of the eyeball of either side.
    shut : dict of str to float
        By how much of its height, measured at the middle of the lids, the head narrows either eye when it closes.
    places : dict of str to int
        Vertices: ``corner``, ``cheek``, ``brow``, ``upper lid``, ``lower lid``, ``eye inner``, each with its side.
    contact : ndarray of int, shape (2, P)
        Vertices of the lower lip, and of the upper lip opposite, where the lips touch near the middle.
    weights : dict of str to ndarray, shape (V,)
        Soft parts by the names of :data:`REACH_MM`, with their side where there are two; 0 to 1, smooth in space, and
        the same on both lips where they touch.
    gather, spread : ndarray, shapes (LIP_NODES, V) and (V, LIP_NODES)
        Rows with the sum one that gather the places along a lip, and give them to the vertices beside.
    """

    share: Array
    hinge: Array
    eyes: dict[str, Array]
    shut: dict[str, float]
    places: dict[str, int]
    contact: Indices
    weights: dict[str, Array]
    gather: Array
    spread: Array


def front_of(head: Head) -> Front:
    """The largest connected component of face, lips and a rim around them.

    Raises
    ------
    EvalkitError
        If the head lacks a region.
    """
    for region in FRONT:
        if not len(head.regions.get(region, ())):
            raise EvalkitError(f"{head.name}: no region '{region}'; its front cannot be told from the rest")
    triangles = head.part_triangles(*SOFT)
    wanted = np.zeros(len(head.vertices), dtype=bool)
    wanted[np.concatenate([head.regions[region] for region in FRONT])] = True
    rim = edge_distance(edge_graph(head.vertices, triangles), np.flatnonzero(wanted), RIM_MM) < RIM_MM
    # Above the brows only, further back only higher up: the edge passes above the ears.
    face = head.vertices[head.regions["face"]]
    behind = np.maximum(face[:, 2].min() - head.vertices[:, 2], 0.0)
    rim &= head.vertices[:, 1] > _place(head, "brow inner left")[1] + behind
    wanted |= rim
    triangles = triangles[wanted[triangles].all(axis=1)]
    _, label = connected_components(edge_graph(head.vertices, triangles))
    largest = np.bincount(label[triangles[:, 0]]).argmax()
    triangles = triangles[label[triangles[:, 0]] == largest]
    kept, local = np.unique(triangles, return_inverse=True)
    return Front(kept, head.vertices[kept], local.reshape(-1, 3))


def anatomy_of(head: Head, front: Front, opened: Array, closed: Array) -> Anatomy:
    """Find the parts of a face.

    Parameters
    ----------
    head : Head
        With landmarks, marker sites and eyeballs.
    front : Front
    opened, closed : ndarray, shape (V, 3), mm
        The front with the jaw open, and with both eyes closed.

    Raises
    ------
    EvalkitError
        If a landmark is missing or the lips do not touch at rest.
    """
    rest = front.rest
    axis = hinge(rest, opened) if head.jaw is None else head.jaw.axis
    eyes: dict[str, Array] = {}
    places: dict[str, int] = {}
    balls = head.vertices[head.part_vertices("eyeballs")]
    for side, sign in SIDES.items():
        own = balls[sign * balls[:, 0] > 0.0]
        if not len(own):
            raise EvalkitError(f"{head.name}: it has no {side} eyeball")
        eyes[side] = 0.5 * (own.min(axis=0) + own.max(axis=0))
        mark = side[0].upper()
        sites = {"corner": "Mouth", "cheek": "Cheek", "brow inner": "BrowIn", "brow outer": "BrowOut"}
        places |= {f"{name} {side}": _nearest(head, rest, site + mark) for name, site in sites.items()}
        places[f"eye inner {side}"] = _nearest(head, rest, f"eye inner {side}")
    # The right lids are the left ones mirrored: of equally good vertices either side could take another.
    lids = _margins(rest, closed, eyes["left"])
    tree = cKDTree(rest)
    shut = {}
    for side, sign in SIDES.items():
        found = [int(tree.query(rest[vertex] * [sign, 1.0, 1.0])[1]) for vertex in lids]
        places |= {f"upper lid {side}": found[0], f"lower lid {side}": found[1]}
        shut[side] = float(narrowed(rest, closed[None], eyes[side], found)[0])
        if shut[side] < SHUT:
            raise EvalkitError(f"{head.name}: its {side} eye does not close; it needs shapes that close both eyes")
    contact = lip_contact(head)
    pairs = np.stack([contact.lower, contact.upper[np.arange(len(contact.share)), (contact.share > 0.5).astype(int)]])
    pairs = pairs[:, np.isin(pairs, front.kept).all(axis=0)]
    if not pairs.size:
        raise EvalkitError(f"{head.name}: its lips do not touch at rest")
    pairs = np.searchsorted(front.kept, pairs)
    # As far on either side: the contact may end at another vertex on the left than on the right.
    ends = rest[pairs[0], 0]
    pairs = pairs[:, np.abs(ends) <= min(ends.max(), -ends.min()) + EVEN_MM]
    middle = pairs[:, np.abs(rest[pairs[0], 0]) < MIDDLE_MM]
    gather, spread = _along(rest, pairs)
    return Anatomy(
        share=_jaw_share(rest, opened, axis),
        hinge=axis,
        eyes=eyes,
        shut=shut,
        places=places,
        contact=middle,
        weights=_weights(head, rest, places, eyes, pairs),
        gather=gather,
        spread=spread,
    )


def scored_regions(head: Head, front: Front, anatomy: Anatomy) -> dict[str, Indices]:
    """Lips, lids, brows, cheeks and nose: where errors are told apart; they do not cover the face."""
    graph = edge_graph(front.rest, front.triangles)
    seeds = {
        "brows": [k for name, k in anatomy.places.items() if name.startswith("brow")],
        "cheeks": [anatomy.places[f"cheek {side}"] for side in SIDES],
        "nose": [_nearest(head, front.rest, name) for name in ("nose tip", "NoseL", "NoseR")],
        "lids": [k for name, k in anatomy.places.items() if " lid " in name],
    }
    found = {name: np.flatnonzero(edge_distance(graph, at) < SCORED_MM[name]) for name, at in seeds.items()}
    lips = np.union1d(head.regions["upper lip"], head.regions["lower lip"])
    return {"lips": front.of(np.intersect1d(lips, head.skin_vertices))} | found


def hand_drawn_regions(head: Head, front: Front, anatomy: Anatomy) -> dict[str, Indices]:
    """A partition into 15 regions as a user would draw it: what is nearest, over the surface, to the middle of each."""
    rest, places = front.rest, anatomy.places
    graph = edge_graph(rest, front.triangles)
    lips = {f"{lip} lip": front.of(head.regions[f"{lip} lip"]) for lip in ("upper", "lower")}
    seeds: dict[str, list[int]] = {
        "nose": [_nearest(head, rest, name) for name in ("nose tip", "NoseL", "NoseR", "NoseBridge")],
        "chin": [_nearest(head, rest, "Chin")],
        "forehead": [_nearest(head, rest, name) for name in ("ForeheadC", "ForeheadL", "ForeheadR")],
    }
    for side, sign in SIDES.items():
        seeds[f"brow {side}"] = [places[f"brow inner {side}"], places[f"brow outer {side}"]]
        seeds[f"cheek {side}"] = [places[f"cheek {side}"]]
        for lid in ("upper", "lower"):
            seeds[f"{lid} lid {side}"] = [places[f"{lid} lid {side}"]]
        for lip, which in lips.items():
            seeds[f"{lip} {side}"] = list(which[sign * rest[which, 0] >= 0.0])
    names = list(seeds)
    label = np.argmin([edge_distance(graph, seeds[name]) for name in names], axis=0)
    # Lips belong to their region altogether, whatever is near them.
    for side, sign in SIDES.items():
        for lip, which in lips.items():
            label[which[sign * rest[which, 0] >= 0.0]] = names.index(f"{lip} {side}")
    return {name: np.flatnonzero(label == k) for k, name in enumerate(names)}


def fading(distance: Array, reach_mm: float) -> Array:
    """``cos²(pi d / (2 reach))``, zero beyond the reach."""
    return np.asarray(np.cos(0.5 * np.pi * np.minimum(distance / reach_mm, 1.0)) ** 2)


def _nearest(head: Head, rest: Array, name: str) -> int:
    return int(cKDTree(rest).query(_place(head, name))[1])


def _place(head: Head, name: str) -> Array:
    place = head.landmarks.get(name, head.marker_sites.get(name))
    if place is None:
        raise EvalkitError(f"{head.name}: no landmark '{name}'; its face cannot be sculpted")
    return place


def elevation(shapes: Array, eye: Array, which: int | slice = slice(None)) -> Array:
    """Angle above the horizon at which vertices of shapes (N, V, 3) are seen from the middle of an eye, rad."""
    arm = shapes[:, which] - eye
    return np.asarray(np.arctan2(arm[..., 1], arm[..., 2]))


def narrowed(rest: Array, shapes: Array, eye: Array, lids: list[int]) -> Array:
    """Part of the height of an eye that shapes (N, V, 3) take away, between an upper and a lower vertex of its lids."""
    gap, before = (elevation(s, eye, lids[0]) - elevation(s, eye, lids[1]) for s in (shapes, rest[None]))
    return np.asarray(1.0 - gap / before)


def _margins(rest: Array, closed: Array, eye: Array) -> tuple[int, int]:
    """The vertex of the upper lid that goes furthest when the eye closes, and that of the lower lid that it meets."""
    way = np.linalg.norm(closed - rest, axis=1)
    near = (np.abs(rest[:, 0] - eye[0]) < LID_MIDDLE_MM) & (np.linalg.norm(rest - eye, axis=1) < SOCKET_MM + 4.0)
    upper = np.flatnonzero(near)[way[near].argmax()]
    still = np.flatnonzero(near & (way < 0.5 * way[upper]) & (rest[:, 1] < rest[upper, 1]))
    lower = still[np.linalg.norm(closed[still] - closed[upper], axis=1).argmin()]
    return int(upper), int(lower)


def _jaw_share(rest: Array, opened: Array, axis: Array) -> Array:
    """Angle about the axis by which each vertex turns when the jaw opens, as a part of that of the chin."""
    before, after = rest - axis, opened - axis
    angle = np.arctan2(after[:, 2], after[:, 1]) - np.arctan2(before[:, 2], before[:, 1])
    angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
    way = np.linalg.norm(opened - rest, axis=1)
    full = np.median(angle[way > 0.85 * way.max()])
    return np.clip(angle / full, 0.0, 1.0)


def _along(rest: Array, pairs: Indices) -> tuple[Array, Array]:
    """Weights that gather the skin near the lips into places across the mouth, and give them back."""
    line = rest[pairs[0]]
    near = fading(cKDTree(line).query(rest)[0], REACH_MM["lips"])
    nodes = np.linspace(line[:, 0].min(), line[:, 0].max(), LIP_NODES)
    kernel = np.exp(-0.5 * ((rest[:, 0] - nodes[:, None]) / LIP_NODE_MM) ** 2)
    beside = np.exp(-0.5 * ((np.clip(rest[:, 0], nodes[0], nodes[-1]) - nodes[:, None]) / LIP_NODE_MM) ** 2)
    return kernel * near, (beside / beside.sum(axis=0)).T


def _weights(
    head: Head, rest: Array, places: dict[str, int], eyes: dict[str, Array], pairs: Indices
) -> dict[str, Array]:
    """Soft parts. All distances are through space: places that touch have the same weight, so nothing is torn apart."""
    line = cKDTree(rest[pairs[0]])
    middle = 0.5 * (rest[places["corner left"]] + rest[places["corner right"]])
    brows = {side: [places[f"brow inner {side}"], places[f"brow outer {side}"]] for side in SIDES}

    def at(part: str, *points: Array) -> Array:
        return fading(cKDTree(np.array(points)).query(rest)[0], REACH_MM[part])

    found = {
        "mouth": at("mouth", middle, rest[pairs[1]].mean(axis=0)),
        "lips": fading(line.query(rest)[0], REACH_MM["lips"]),
        "nose": at("nose", rest[_nearest(head, rest, "nose tip")]),
        "forehead": at("forehead", rest[_nearest(head, rest, "ForeheadC")]),
        "glabella": at("glabella", 0.5 * (rest[brows["left"][0]] + rest[brows["right"][0]])),
    }
    for side in SIDES:
        from_eye = np.linalg.norm(rest - eyes[side], axis=1)
        found[f"eye {side}"] = fading(np.maximum(from_eye - SOCKET_MM, 0.0), REACH_MM["eye"])
        for part in ("corner", "cheek"):
            found[f"{part} {side}"] = at(part, rest[places[f"{part} {side}"]])
        inner, outer = rest[brows[side]]
        curve = [inner + t * (outer - inner) for t in np.linspace(0.0, 1.0, 9)]
        found[f"brow {side}"] = at("brow", *curve) * (1.0 - found[f"eye {side}"])
    return found
