"""Persons whose heads are known: the built-in head with the proportions of a real one, a photo of it, and its points.

A fit sees the photo and the points; how far the head that it makes is from the person's is measured here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from evalkit.geometry import Array
from evalkit.head import Head, load_head
from evalkit.head.fitting import carried
from evalkit.head.photo import Photo
from evalkit.head.points import LANDMARK_POINTS, Points
from evalkit.head.real_heads import aligned, proportions_mm

PHOTO_SIZE = (800, 1000)
"""Width and height, pixels."""

BACKGROUND = "#8fa3b0"

PIXELS_PER_MM = 3.0
"""Of the photo in the plane z = 0."""

MIDDLE_MM = 8.0
"""Height of the camera."""

DISTANCE_MM = 2000.0
"""Of the camera from the origin of the head, between the ears, where nothing else is said: a portrait."""


@dataclass(frozen=True, eq=False)
class Person:
    """One who has a photo taken.

    Attributes
    ----------
    head : Head
        The truth; its vertices correspond to those of `generic`.
    generic : Head
        The built-in head that the person was made of, and that a fit starts from.
    points : Points
        Where the landmarks and pupils are in the photo, by projection.
    distance_mm : float
        From which the photo is taken, from the front.
    """

    head: Head
    generic: Head
    points: Points
    distance_mm: float


@lru_cache(maxsize=4)
def person(number: int, vertices: int | None = None, distance_mm: float = DISTANCE_MM) -> Person:
    """A person by number.

    Parameters
    ----------
    number : int
        Of the drawn head whose proportions he has; see :func:`evalkit.head.real_heads.proportions_mm`.
    vertices : int, optional
        Of the head, about; as many as the template has by default.
    distance_mm : float
        Of the camera from the origin of the head, mm.
    """
    from scipy.interpolate import RBFInterpolator

    generic = load_head("template", vertices=vertices)
    moves = proportions_mm(number)
    source = np.array([generic.landmarks[name] for name in moves])
    # Thin-plate spline in space: the smoothest map that takes the landmarks there.
    spline = RBFInterpolator(source, np.array(list(moves.values())), kernel="linear", degree=1)
    made = carried(generic, lambda places: np.asarray(places + spline(places)))
    made = replace(made, name=f"person {number}")
    assert made.lids is not None
    pupils = made.lids.centres + np.array([0.0, 0.0, made.lids.radius])
    seen = {name: made.landmarks[name] for name in LANDMARK_POINTS}
    seen |= dict(zip(("pupil left", "pupil right"), pupils, strict=True))
    places = {name: _in_photo(place, distance_mm) for name, place in seen.items()}
    return Person(made, generic, Points(places), distance_mm)


def _in_photo(place: Array, distance_mm: float) -> Array:
    """Pixels (2,) of a place (3,), mm: a pinhole camera."""
    off = PIXELS_PER_MM * distance_mm / (distance_mm - place[2]) * (place[:2] - [0.0, MIDDLE_MM])
    return np.asarray(off * [1.0, -1.0] + 0.5 * np.array(PHOTO_SIZE))


def portrait(who: Person) -> Photo:
    """The person's photo.

    Raises
    ------
    EvalkitError
        If nothing can be drawn without a screen here.
    """
    from evalkit.render.head_views import View, draw_head
    from evalkit.render.offscreen import offscreen_plotter

    with offscreen_plotter(*PHOTO_SIZE) as opened:
        plotter: Any = opened
        plotter.set_background(BACKGROUND)
        draw_head(plotter, who.head, View())
        plotter.camera.position = (0.0, MIDDLE_MM, who.distance_mm)
        plotter.camera.focal_point = (0.0, MIDDLE_MM, 0.0)
        half = 0.5 * PHOTO_SIZE[1] / PIXELS_PER_MM
        plotter.camera.view_angle = 2.0 * float(np.rad2deg(np.arctan2(half, who.distance_mm)))
        plotter.camera.clipping_range = (who.distance_mm - 300.0, who.distance_mm + 300.0)
        plotter.render_window.SetMultiSamples(8)
        pixels = np.array(plotter.screenshot(None, return_img=True))
    return _photo(pixels, who)


def blank_photo(who: Person) -> Photo:
    """A photo that shows nothing: where the skin goes follows from the points alone."""
    return _photo(np.full((PHOTO_SIZE[1], PHOTO_SIZE[0], 3), 128, dtype=np.uint8), who)


def _photo(pixels: Any, who: Person) -> Photo:
    import hashlib

    return Photo(pixels, PHOTO_SIZE, f"{who.head.name}.png", hashlib.sha256(pixels.tobytes()).hexdigest())


def landmarks_off_mm(head: Head, who: Person) -> Array:
    """Where the landmarks of a head lie from the person's, (35, 3), mm, in the order of ``LANDMARK_POINTS``.

    After the similarity that brings all of them nearest: a photo has no scale, and where a head is says nothing about
    it. x and y are across the view, z along it.
    """
    ours, truth = (np.array([one.landmarks[name] for name in LANDMARK_POINTS]) for one in (head, who.head))
    return np.asarray(aligned(ours, truth) - truth)


def face_off_mm(head: Head, who: Person) -> Array:
    """The same of all vertices of face and lips that can be seen from outside, (K, 3), mm."""
    face = np.concatenate([head.regions[name] for name in ("face", "upper lip", "lower lip")])
    which = np.intersect1d(face, head.skin_vertices)
    truth = who.head.vertices[which]
    return np.asarray(aligned(head.vertices[which], truth) - truth)
