"""What a person does to the points of a photo: place, move, mirror, take back, save. Knows of no screen."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.photo import Photo
from evalkit.head.points import (
    POINTS,
    PUPILS,
    REQUIRED,
    Points,
    partner,
    photo_facts,
    propose_points,
    read_points,
    write_points,
)

MOST_UNDONE = 200
"""Steps that can be taken back."""


class Editing:
    """The points of one photo while they are edited.

    Attributes
    ----------
    photo : Photo
    places : dict of str to ndarray, shape (2,), pixels
        What is placed so far.
    symmetric : bool
        Whether a point takes its partner on the other side of the face with it.
    source : str
        Where the points come from.
    """

    def __init__(self, photo: Photo, points: Points | None = None) -> None:
        self.photo = photo
        self.places: dict[str, Array] = {}
        self.symmetric = False
        self.source = "editor"
        self._undone: list[dict[str, Array]] = []
        self._done: list[dict[str, Array]] = []
        if points is not None:
            self.places, self.source = dict(points.places), points.source

    @property
    def missing(self) -> list[str]:
        """Points that are not placed, those first that a fit needs."""
        return [n for n in REQUIRED if n not in self.places] + [
            n for n in POINTS if n not in self.places and n not in REQUIRED
        ]

    @property
    def next(self) -> str | None:
        """The point that the next click places: the eyes first, which a whole face follows from."""
        if not self._begun:
            return next(name for name in reversed(PUPILS) if name not in self.places)
        return self.missing[0] if self.missing else None

    @property
    def _begun(self) -> bool:
        return set(self.places) > set(PUPILS) or bool(set(self.places) - set(PUPILS))

    @property
    def can_undo(self) -> bool:
        """Whether there is a step to take back."""
        return bool(self._done)

    @property
    def can_redo(self) -> bool:
        """Whether there is a step to do again."""
        return bool(self._undone)

    def points(self) -> Points:
        """The points as a fit takes them."""
        return Points(dict(self.places), self.source, photo_facts(self.photo))

    def put(self, place: ArrayLike, name: str | None = None) -> str:
        """Place a point, by default the next one, and return its name; with the second eye, a whole mean face.

        Raises
        ------
        EvalkitError
            If all points are placed, or both eyes are at one place.
        """
        name = name or self.next
        if name is None:
            raise EvalkitError("all points are placed")
        begun = self._begun
        after = {**self.places, name: self._inside(place)}
        if not begun and all(pupil in after for pupil in PUPILS):
            eyes = [after[pupil] for pupil in PUPILS]
            after = {**propose_points(self.photo, eyes).places, **after}
        self._step(after)
        return name

    def move(self, name: str, place: ArrayLike) -> None:
        """Move a point, and its partner with it if :attr:`symmetric`."""
        after = {**self.places, name: self._inside(place)}
        other = partner(name)
        if self.symmetric and other in self.places:
            after[other] = self._inside(self._mirrored(after[name], {name, other}))
        self._step(after)

    def remove(self, name: str) -> None:
        """Take a point away."""
        self._step({key: place for key, place in self.places.items() if key != name})

    def undo(self) -> bool:
        """Take the last step back; False if there is none."""
        return self._swap(self._done, self._undone)

    def redo(self) -> bool:
        """Do again what was taken back; False if there is nothing."""
        return self._swap(self._undone, self._done)

    def replace(self, points: Points) -> None:
        """All points anew, as one step."""
        self._step(dict(points.places))
        self.source = points.source

    def save(self, path: Path) -> None:
        """Write the points, complete or not.

        Raises
        ------
        EvalkitError
            As :func:`evalkit.head.points.write_points`.
        """
        write_points(path, self.points(), self.photo)

    def load(self, path: Path) -> None:
        """Read points of this photo, as one step.

        Raises
        ------
        EvalkitError
            As :func:`evalkit.head.points.read_points`.
        """
        self.replace(read_points(path, self.photo))

    def _inside(self, place: ArrayLike) -> Array:
        return np.clip(np.asarray(place, dtype=np.float64), 0.0, self.photo.size)

    def _mirrored(self, place: Array, without: set[str | None]) -> Array:
        """A place on the other side of the face's middle line, which all other points tell."""
        others = {name: at for name, at in self.places.items() if name not in without}
        pairs = [(at, others[str(partner(name))]) for name, at in others.items() if _left_of_pair(name, others)]
        if not pairs:
            # Nothing else to go by: the middle between the two as they are.
            pairs = [tuple(self.places[str(name)] for name in sorted(map(str, without)))]  # type: ignore[list-item]
        ways = np.array([a - b for a, b in pairs])
        lengths = np.linalg.norm(ways, axis=1, keepdims=True)
        # A pair in one place has no direction; where none has, or they cancel, the face is taken to be upright.
        across = np.divide(ways, lengths, out=np.zeros_like(ways), where=lengths > 0).sum(axis=0)
        size = np.linalg.norm(across)
        normal = across / size if size > 1e-9 else np.array([1.0, 0.0])
        middle = np.mean([0.5 * (a + b) @ normal for a, b in pairs])
        return np.asarray(place - 2.0 * (place @ normal - middle) * normal)

    def _step(self, after: dict[str, Array]) -> None:
        self._done = [*self._done[1 - MOST_UNDONE :], self.places]
        self._undone = []
        self.places = after
        self.source = "editor"

    def _swap(self, source: list[dict[str, Array]], target: list[dict[str, Array]]) -> bool:
        if not source:
            return False
        target.append(self.places)
        self.places = source.pop()
        return True


def _left_of_pair(name: str, places: Mapping[str, Array]) -> bool:
    return name.endswith(" left") and partner(name) in places
