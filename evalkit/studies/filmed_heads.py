"""Heads that are filmed: measured or drawn shapes, textures of a real photo, units that move them.

The shape is never that of a face tracker's own model: it is the built-in head, MakeHuman's or ICT-FaceKit's.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from evalkit.dense import Face, muscle_face, unit_face
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import Head, load_head
from evalkit.head.fitting import fit_head
from evalkit.head.ict import read_ict
from evalkit.head.model import Indices
from evalkit.head.photo import Photo, read_photo
from evalkit.head.places import all_landmarks
from evalkit.head.points import Points, read_points
from evalkit.studies.dense_takes import ICT_FILE
from evalkit.vision.points import BETWEEN, FACE_POINTS

ASTRONAUT_POINTS = Path(__file__).with_name("astronaut_points.json")
"""Points of the portrait that scikit-image ships, placed for this project."""

SMALL = 3000
"""Vertices of the built-in head where it is filmed quickly."""


@lru_cache(maxsize=1)
def astronaut() -> tuple[Photo, Points]:
    """The portrait and its points.

    Raises
    ------
    EvalkitError
        If scikit-image is not installed.
    """
    try:
        from skimage.data import astronaut as picture
    except ImportError as error:
        raise EvalkitError(f"no portrait for the head here ({error}); pip install scikit-image") from error
    from PIL import Image

    with tempfile.TemporaryDirectory(prefix="evalkit-photo-") as folder:
        portrait: Any = picture
        Image.fromarray(portrait()).save(Path(folder) / "astronaut.png")
        photo = read_photo(Path(folder) / "astronaut.png")
    return photo, read_points(ASTRONAUT_POINTS)


def wearing_photo(head: Head, photo: Photo, points: Points) -> Head:
    """A head onto which a photo is projected from the front, each landmark wearing its own point.

    Between landmarks the way from the front view to the photo is a thin-plate spline. Skin that does not face the
    front wears what the photo has beside the face.
    """
    from scipy.interpolate import RBFInterpolator

    shared = [name for name in head.landmarks if name in points.places]
    front = np.array([head.landmarks[name][:2] for name in shared])
    spline = RBFInterpolator(front, np.array([points.places[name] for name in shared]), kernel="thin_plate_spline")
    # Far from the landmarks the spline would fold; from there on it goes on straight from the nearest skin of the face.
    low, high = front.min(axis=0) - REACH_MM, front.max(axis=0) + REACH_MM
    places = head.vertices[:, :2]
    inside = np.clip(places, low, high)
    pixels = spline(inside) + (places - inside) @ _slope(front, spline(front))
    size = np.array(photo.size)
    uv = np.clip(pixels / size, 0.0, 1.0) * [1.0, -1.0] + [0.0, 1.0]
    opaque = np.full((*photo.pixels.shape[:2], 1), 255, dtype=np.uint8)
    return replace(
        head, uv=uv, texture=np.concatenate([photo.pixels, opaque], axis=2), provenance={"photo": photo.path}
    )


REACH_MM = 15.0
"""Skin so near to the landmarks' rectangle is still within the spline."""


def _slope(places: Array, pixels: Array) -> Array:
    """Matrix (2, 2) of the affine map nearest to a set of pairs."""
    found = np.linalg.lstsq(places - places.mean(axis=0), pixels - pixels.mean(axis=0), rcond=None)[0]
    return np.asarray(found)


def _template() -> Face:
    return muscle_face(load_head())


def _template_small() -> Face:
    return muscle_face(load_head(vertices=SMALL))


def _photo() -> Face:
    return muscle_face(fit_head(*astronaut(), load_head(vertices=SMALL))[0])


def _makehuman() -> Face:
    return unit_face(load_head("makehuman"))


def _makehuman_photo() -> Face:
    return unit_face(wearing_photo(load_head("makehuman"), *astronaut()))


def _ict_photo() -> Face:
    folder = os.environ.get("EVALKIT_REAL_DATA")
    if not folder:
        raise EvalkitError("head ict-photo: set EVALKIT_REAL_DATA to the folder that holds " + "/".join(ICT_FILE))
    return unit_face(wearing_photo(read_ict(Path(folder, *ICT_FILE)), *astronaut()))


HEADS: dict[str, Callable[[], Face]] = {
    "template": _template,
    "template-small": _template_small,
    "photo": _photo,
    "makehuman": _makehuman,
    "makehuman-photo": _makehuman_photo,
    "ict-photo": _ict_photo,
}
"""Head -> its face: the built-in one with its drawn skin, in full and with few vertices; the same fitted to a portrait
that it wears; MakeHuman's in its own skin and in the portrait's; ICT-FaceKit's in the portrait's."""

PROJECTED = ("makehuman-photo", "ict-photo")
"""Heads whose texture is meant for the outside only."""


@lru_cache(maxsize=2)
def filmed_face(name: str) -> Face:
    """The face of a head in :data:`HEADS`.

    Raises
    ------
    EvalkitError
        If the head is not known, or what it is made of is not here.
    """
    if name not in HEADS:
        raise EvalkitError(f"head '{name}' cannot be filmed; known are {', '.join(HEADS)}")
    return HEADS[name]()


def missing_head(name: str) -> str:
    """What a head lacks on this machine, in one line; empty if nothing."""
    try:
        if "photo" in name:
            astronaut()
        if name.startswith("makehuman"):
            load_head("makehuman")
        if name.startswith("ict") and not os.environ.get("EVALKIT_REAL_DATA"):
            return "EVALKIT_REAL_DATA names no folder"
    except EvalkitError as error:
        return str(error)
    return ""


def point_sources(head: Head) -> list[Indices]:
    """For each of the 19 points the skin vertices that it lies in the middle of.

    Landmarks that the head does not name are where the measured face of :mod:`evalkit.head.places` has them, warped
    by those that both name.
    """
    from scipy.interpolate import RBFInterpolator

    generic = all_landmarks()
    shared = [name for name in generic if name in head.landmarks]
    spline = RBFInterpolator(
        np.array([generic[name] for name in shared]), np.array([head.landmarks[name] for name in shared]),
        kernel="linear", degree=1,
    )  # fmt: skip
    wanted: dict[str, Any] = {name: BETWEEN.get(name, (name,)) for name in FACE_POINTS}
    names = [source for sources in wanted.values() for source in sources]
    places = {
        name: head.landmarks[name] if name in head.landmarks else spline(generic[name][None])[0] for name in names
    }
    near = head.nearest_vertices(places)
    return [np.array([near[source] for source in sources], dtype=np.intp) for sources in wanted.values()]
