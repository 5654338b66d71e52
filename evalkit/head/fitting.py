"""Fitting a head to a photo: its points go where they are seen, everything else is carried along.

The head keeps its size in mm as a whole, since a photo has no scale, and its depths, since a view from the front shows
none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.fit_report import FitReport, report_fit
from evalkit.head.model import Head, Jaw, Lids
from evalkit.head.photo import Photo
from evalkit.head.photo_texture import textured
from evalkit.head.photo_warp import Similarity, similarity, warp_without_folds
from evalkit.head.places import on_skin
from evalkit.head.points import LANDMARK_POINTS, Points, check_points

Map = Callable[[Array], Array]
"""Places (K, 3), mm, to where they go."""

TURNED_PARTS = ("upper teeth", "lower teeth", "tongue")
"""Parts that are hard or hidden: they are stretched as a whole and not bent."""

BALL_REACH_MM = 9.0
"""Skin so near to an eyeball rides on it; beyond, it keeps its depth."""


def fit_head(photo: Photo, points: Points, head: Head | None = None, *, picture: bool = True) -> tuple[Head, FitReport]:
    """A head whose landmarks are seen where the points are, with the photo on it.

    Orthographic view: a similarity brings the head's landmarks to the points, a thin-plate spline takes up what is
    left, and depth is carried along. Regions, marker sites, jaw, lids and units go with it.

    Parameters
    ----------
    photo : Photo
        Of one person from the front, neutral, mouth closed.
    points : Points
        At least :data:`evalkit.head.points.REQUIRED`.
    head : Head, optional
        The head to fit, by default the built-in one; it must have texture coordinates.
    picture : bool
        Whether the head gets the photo for its texture and on its plate, which takes most of the time; without, they
        stay its own.

    Returns
    -------
    Head
        As large as the given one.
    FitReport

    Raises
    ------
    EvalkitError
        If points are missing, misplaced or fold the face, or the head has no texture coordinates.

    References
    ----------
    Huang, Lin & Ouhyoung 2000, section 3.1.
    """
    if head is None:
        from evalkit.head import load_head

        head = load_head()
    if head.uv is None or head.texture is None:
        raise EvalkitError(f"{head.name}: has no texture coordinates, so that it cannot wear a photo")
    places = check_points(points.places, photo)
    names = [name for name in LANDMARK_POINTS if name in places and name in head.landmarks]
    source = np.array([head.landmarks[name] for name in names])
    seen = np.array([places[name] for name in names])
    view = similarity(source, seen)
    eyes = np.linalg.norm(source[names.index("eye outer left")] - source[names.index("eye outer right")])
    soft = head.vertices[head.soft_vertices]
    warp = warp_without_folds(source[:, :2], view.to_head(seen), names, float(eyes), soft)
    fitted = replace(carried(head, warp), name=f"{head.name} fitted to a photo")
    if picture:
        fitted = replace(textured(fitted, photo, view, places), provenance=_provenance(photo, points, view, head))
    return fitted, report_fit(head, fitted, photo, view, warp, places)


def _provenance(photo: Photo, points: Points, view: Similarity, head: Head) -> dict[str, Any]:
    return {
        "fitted from": head.name,
        "photo": {"size": list(photo.size), "sha256": photo.sha256},
        "points": {name: [float(x) for x in place] for name, place in points.places.items()},
        "points from": points.source,
        "view": {"pixels_per_mm": view.pixels_per_mm, "roll_deg": view.roll_deg, "shift": view.shift.tolist()},
    }


def carried(head: Head, warp: Map) -> Head:
    """A head with all that it is made of moved by a smooth map: in a fit, a warp of the plane.

    Eyeballs stay balls, as much larger or smaller as the opening between the corners becomes wider; lids ride on them.
    What moves by joints or units moves to where its places at the end of the motion are carried.
    """
    new = warp(head.vertices)
    for part in TURNED_PARTS:
        if part in head.parts:
            which = head.part_vertices(part)
            new[which] = _as_a_whole(head.vertices[which], new[which])
    jaw = head.jaw
    if jaw is not None:
        # The condyles lie at the sides, where the axis passes through the skin.
        ends = jaw.axis + np.array([[65.0, 0.0, 0.0], [-65.0, 0.0, 0.0]])
        jaw = Jaw(np.array([0.0, *warp(ends).mean(axis=0)[1:]]), jaw.weights)
    lids = head.lids
    if lids is not None:
        new, lids = _with_eyes(head, lids, warp, new)
    skin = head.part_triangles("skin", "lids")
    return replace(
        head,
        vertices=new,
        landmarks=_carried_places(head.landmarks, warp, new, skin),
        marker_sites=_carried_places(head.marker_sites, warp, new, skin),
        jaw=jaw,
        lids=lids,
        blendshapes={
            name: (which, moves + (warp(head.vertices[which] + moves) - warp(head.vertices[which]) - moves))
            for name, (which, moves) in head.blendshapes.items()
        },
    )  # fmt: skip


def _carried_places(places: dict[str, Array], warp: Map, vertices: Array, skin: Any) -> dict[str, Array]:
    if not places:
        return {}
    moved = warp(np.array(list(places.values())))
    return on_skin(dict(zip(places, moved, strict=True)), vertices, skin)


def _as_a_whole(before: Array, after: Array) -> Array:
    """The affine map of the plane nearest to what happened to some places, applied to them."""
    one = np.column_stack([before[:, :2], np.ones(len(before))])
    found, *_ = np.linalg.lstsq(one, after[:, :2], rcond=None)
    return np.column_stack([one @ found, after[:, 2]])


def _with_eyes(head: Head, lids: Lids, warp: Map, new: Array) -> tuple[Array, Lids]:
    """Vertices with eyeballs that are balls and lids that ride on them, and how those lids close."""
    closed = warp(head.posed(lids_closed=1.0))
    opened = new.copy()
    balls = head.part_vertices("eyeballs")
    side = np.where(head.vertices[:, 0] > 0, 0, 1)
    centres = lids.centres.copy()
    # One radius for both: the wider eye's ball would push the lids of the other.
    widths = []
    for eye, name in enumerate(("left", "right")):
        ends = np.array([head.landmarks[f"eye inner {name}"], head.landmarks[f"eye outer {name}"]])
        widths.append(np.linalg.norm(np.diff(warp(ends)[:, :2], axis=0)) / np.linalg.norm(np.diff(ends[:, :2], axis=0)))
        centres[eye] = warp(lids.centres[eye][None])[0]
    size = float(np.mean(widths))
    radius = lids.radius * size
    # The front of the ball keeps its depth.
    centres[:, 2] += lids.radius - radius
    for eye in (0, 1):
        mine = balls[side[balls] == eye]
        opened[mine] = centres[eye] + size * (head.vertices[mine] - lids.centres[eye])
    soft = head.soft_vertices
    for shape, rest in ((opened, head.vertices), (closed, head.posed(lids_closed=1.0))):
        arm = rest[soft] - lids.centres[side[soft]]
        off = np.linalg.norm(arm, axis=1) - lids.radius
        share = np.clip((BALL_REACH_MM - off) / BALL_REACH_MM, 0.0, 1.0)
        beside = ((shape[soft] - centres[side[soft]])[:, :2] ** 2).sum(axis=1)
        on_ball = centres[side[soft], 2] + np.sqrt(np.maximum((radius + off) ** 2 - beside, 0.0))
        rides = (arm[:, 2] > 0) & (beside < (radius + off) ** 2)
        smooth = share * share * (3.0 - 2.0 * share) * rides
        shape[soft, 2] += smooth * (on_ball - shape[soft, 2])
    which = np.flatnonzero(lids.eye >= 0)
    before, after = (shape[which] - centres[lids.eye[which]] for shape in (opened, closed))
    turn, lift = np.zeros(len(new)), np.zeros(len(new))
    turn[which] = np.arctan2(before[:, 1], before[:, 2]) - np.arctan2(after[:, 1], after[:, 2])
    lift[which] = np.linalg.norm(after, axis=1) - np.linalg.norm(before, axis=1)
    return opened, Lids(centres, radius, lids.eye, turn, lift)
