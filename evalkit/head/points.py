"""The named points of a photo that a head is fitted to, their file, and where they start from.

The file is JSON::

    {
      "photo": {"file": "me.jpg", "width": 1200, "height": 1600, "sha256": "ab12..."},
      "points": {"nose tip": [611.5, 820.0], "chin": [608.0, 1105.5], ...}
    }

Places are ``[x, y]`` in pixels of the photo itself, upright, with the origin at its upper left corner. ``photo`` may be
left out; what it says must be true. Left and right are the person's: his left eye is on the right of the picture.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.detector import detect_face
from evalkit.head.photo import Photo
from evalkit.head.places import MIDDLE_LANDMARKS, NEEDED_LANDMARKS, PAIRED_LANDMARKS, all_landmarks

LANDMARK_POINTS = (*MIDDLE_LANDMARKS, *(f"{name} {side}" for name in PAIRED_LANDMARKS for side in ("left", "right")))
"""Points that are landmarks of the head: they say where its skin goes."""

INNER_LIPS = ("upper lip inner", "lower lip inner")
PUPILS = ("pupil left", "pupil right")

POINTS = (*LANDMARK_POINTS, *INNER_LIPS, *PUPILS)
"""All points. The inner edges of the lips, in their middle, tell how far the mouth is open, and the pupils where the
irises are; both are only looked for in the picture."""

REQUIRED = NEEDED_LANDMARKS
"""Points without which nothing can be fitted; the others make the fit better."""

SAME_PIXELS = 0.01
"""Points nearer to each other than that were put at one place."""


def partner(name: str) -> str | None:
    """The point on the other side of the face; None for one in the middle."""
    for side, other in ((" left", " right"), (" right", " left")):
        if name.endswith(side):
            return name.removesuffix(side) + other
    return None


@dataclass(frozen=True, eq=False)
class Points:
    """Named places in a photo.

    Attributes
    ----------
    places : dict of str to ndarray, shape (2,), pixels
        Name out of :data:`POINTS` -> x to the right, y down, in the photo itself.
    source : str
        Where they come from: ``file``, ``detector`` or ``mean face``.
    photo : dict
        File name, width, height and SHA-256 of the photo that they were placed on; empty if not known.
    """

    places: dict[str, Array]
    source: str = "file"
    photo: dict[str, Any] = field(default_factory=dict)

    @property
    def missing(self) -> list[str]:
        """Required points that are not placed yet."""
        return [name for name in REQUIRED if name not in self.places]


def photo_facts(photo: Photo) -> dict[str, Any]:
    """What a file of points says about its photo."""
    return {
        "file": Path(photo.path).name, "width": photo.size[0], "height": photo.size[1], "sha256": photo.sha256,
    }  # fmt: skip


def read_points(path: str | Path, photo: Photo | None = None) -> Points:
    """Read a file of points.

    Parameters
    ----------
    path : str or Path
    photo : Photo, optional
        The photo that they must belong to.

    Returns
    -------
    Points
        Not yet complete, perhaps: :func:`check_points` says.

    Raises
    ------
    EvalkitError
        If the file cannot be read, a place is no pair of numbers, or the points belong to another photo.
    """
    path = Path(path)
    try:
        facts = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=_once)
    except OSError as error:
        raise EvalkitError(f"{path}: cannot be read ({error.strerror or error})") from error
    except EvalkitError as error:
        raise EvalkitError(f"{path}: {error}") from error
    except ValueError as error:
        raise EvalkitError(f"{path}: no valid JSON ({error})") from error
    if not isinstance(facts, dict) or not isinstance(facts.get("points"), dict):
        raise EvalkitError(f"{path}: 'points' is missing: an object of names and places [x, y]")
    about = facts.get("photo", {})
    if not isinstance(about, dict):
        raise EvalkitError(f"{path}: 'photo' is not an object")
    if photo is not None:
        for key, value in photo_facts(photo).items():
            if key != "file" and about.get(key, value) != value:
                raise EvalkitError(
                    f"{path}: belongs to another photo than {photo.path} ({key} {about[key]}, not {value}); "
                    "remove 'photo' from it to use it all the same"
                )
    try:
        return Points(_as_places(facts["points"]), photo=about)
    except EvalkitError as error:
        raise EvalkitError(f"{path}: {error}") from error


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object in which nothing is named twice: Python's reader would keep the last one."""
    names = [name for name, _ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise EvalkitError(f"'{name}' is there twice")
    return dict(pairs)


def _as_places(values: Mapping[str, ArrayLike]) -> dict[str, Array]:
    out = {}
    for name, value in values.items():
        if name not in POINTS:
            raise EvalkitError(f"unknown point '{name}'; known are {', '.join(POINTS)}")
        numbers = isinstance(value, np.ndarray) or (
            isinstance(value, list | tuple)
            and all(isinstance(x, int | float) and not isinstance(x, bool) for x in value)
        )
        place = np.asarray(value, dtype=np.float64) if numbers else np.zeros(0)
        if place.shape != (2,) or not np.isfinite(place).all():
            raise EvalkitError(f"point '{name}' is not a place [x, y] of two numbers: {json.dumps(value, default=str)}")
        out[name] = place
    return out


def write_points(path: str | Path, points: Points, photo: Photo) -> None:
    """Write a file of points, complete or not at all.

    Raises
    ------
    EvalkitError
        If it cannot be written.
    """
    path = Path(path)
    facts = {
        "photo": photo_facts(photo),
        # A thousandth of a pixel is finer than anyone can point at.
        "points": {name: [round(float(x), 3) for x in points.places[name]] for name in POINTS if name in points.places},
    }
    temporary = path.with_name(path.name + ".part")
    try:
        temporary.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise EvalkitError(f"{path}: cannot write the points ({error.strerror or error})") from error


def check_points(places: Mapping[str, ArrayLike], photo: Photo) -> dict[str, Array]:
    """The places as arrays, if a head can be fitted to them.

    Parameters
    ----------
    places : mapping of str to array_like, shape (2,), pixels
    photo : Photo

    Returns
    -------
    dict of str to ndarray, shape (2,)

    Raises
    ------
    EvalkitError
        If a name is unknown, a required point is missing, or a point is outside of the photo, at the place of
        another one, or on the wrong side.
    """
    out = _as_places(places)
    missing = [name for name in REQUIRED if name not in out]
    if missing:
        raise EvalkitError(f"{photo.path}: points are missing: {', '.join(missing)}")
    for name, place in out.items():
        if not ((place >= 0).all() and (place <= photo.size).all()):
            raise EvalkitError(
                f"{photo.path}: point '{name}' ({place[0]:g}, {place[1]:g}) is outside of the photo, "
                f"{photo.size[0]} x {photo.size[1]}"
            )
    names, values = list(out), np.array(list(out.values()))
    gap = np.linalg.norm(values[:, None] - values, axis=2) + np.diag(np.full(len(names), np.inf))
    # Upper and lower edge are one place where the lips are closed.
    inner = [k for k, name in enumerate(names) if name in INNER_LIPS]
    gap[np.ix_(inner, inner)] = np.inf
    if gap.min() < SAME_PIXELS:
        first, second = np.unravel_index(gap.argmin(), gap.shape)
        raise EvalkitError(f"{photo.path}: points '{names[first]}' and '{names[second]}' are at the same place")
    _check_sides(out, photo)
    return out


def _check_sides(places: dict[str, Array], photo: Photo) -> None:
    """Left and right must not be exchanged, neither of one pair nor of all."""
    across = {name: places[name] - places[str(partner(name))] for name in places if _is_pair(name, places)}
    axis = np.sum([vector / np.linalg.norm(vector) for vector in across.values()], axis=0)
    down = places["chin"] - places["nasion"]
    # y is down: with the person's left on the right of the picture, the turn from the one to the other is positive.
    if axis[0] * down[1] - axis[1] * down[0] <= 0:
        raise EvalkitError(
            f"{photo.path}: left and right are exchanged; they are the person's, whose left eye is on the right of the "
            "picture"
        )
    for name, vector in across.items():
        if vector @ axis <= 0:
            raise EvalkitError(f"{photo.path}: points '{name}' and '{partner(name)}' are exchanged")


def _is_pair(name: str, places: dict[str, Array]) -> bool:
    return name.endswith(" left") and partner(name) in places


def propose_points(photo: Photo, eyes: ArrayLike | None = None, weights: str | Path | None = None) -> Points:
    """Points to start from: those of a face detector, or a mean face on two given eyes.

    Parameters
    ----------
    photo : Photo
    eyes : array_like, shape (2, 2), optional, pixels
        Middles of both eyes, in any order, for the mean face: the landmarks of the built-in head.
    weights : str or Path, optional
        Of the detector; see :func:`evalkit.head.detector.landmarker_weights`.

    Returns
    -------
    Points

    Raises
    ------
    EvalkitError
        If the eyes make no sense, or without them: if there is no detector here, or it finds no face.
    """
    if eyes is not None:
        return Points(_mean_face(np.asarray(eyes, dtype=np.float64), photo), "mean face", photo_facts(photo))
    found = detect_face(photo, weights)
    return Points({name: found[name] for name in POINTS}, "detector", photo_facts(photo))


def _mean_face(eyes: Array, photo: Photo) -> dict[str, Array]:
    if eyes.shape != (2, 2) or not np.isfinite(eyes).all() or np.ptp(eyes[:, 0]) <= 0:
        raise EvalkitError("eyes: give the middles of two eyes beside each other as x,y,x,y in pixels of the photo")
    right, left = eyes[np.argsort(eyes[:, 0])]
    places = all_landmarks()
    seen = {name: place[:2] * [1.0, -1.0] for name, place in places.items()}
    middle = {side: 0.5 * (seen[f"eye inner {side}"] + seen[f"eye outer {side}"]) for side in ("left", "right")}
    seen |= {"pupil left": middle["left"], "pupil right": middle["right"]}
    line = 0.5 * (seen["mouth corner left"] + seen["mouth corner right"])
    seen |= dict.fromkeys(INNER_LIPS, line)
    # As complex numbers a similarity is one factor.
    factor = complex(*(left - right)) / complex(*(middle["left"] - middle["right"]))
    out = {}
    for name in POINTS:
        moved = complex(*right) + factor * complex(*(seen[name] - middle["right"]))
        out[name] = np.clip([moved.real, moved.imag], 0.0, photo.size)
    return out
