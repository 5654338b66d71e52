"""What the studies of character transfer share: examples to learn from, shapes to make, errors by part of the face."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit.dense import Character, character
from evalkit.dense.actors import ICT_FILE
from evalkit.dense.two_artists import DIRECTIONS, two_artists
from evalkit.geometry import Array
from evalkit.head.makehuman import cached_head
from evalkit.head.model import Indices
from evalkit.seeds import generator
from evalkit.study.description import Condition
from evalkit.study.statistics import Statistic, mean, relative_to
from evalkit.transfer.gradients import flipped
from evalkit.transfer.methods import Examples, methods

ROUGH = "rough"
"""The reference row: shapes as Deformation Transfer, or whatever made them, left them."""

EYES_CM = 50.0
"""Distance of the inner corners of the eyes in the paper, whose errors are in cm."""

STYLES = (0.7, 1.3)
"""Strengths of a character's individuality that seeds above 0 draw from; seed 0 is the character itself."""

MOST_NEW = 26
"""New shapes that are scored, as many as the template has besides four examples; where a character has more, they are
drawn at random. Characters then weigh alike, and a head with 68 shapes takes no longer."""

PARTS = ("lips", "lids", "brows")

DEFORMATION_TRANSFER = "all over rough"
HAND_DRAWN = "all over hand-drawn regions"


@dataclass(frozen=True, eq=False)
class Task:
    """A character, and which of its expressions are learnt from and which are made.

    Attributes
    ----------
    one : Character
    training, new : ndarray of int
        Rows of the character's expressions.
    """

    one: Character
    training: Indices
    new: Indices

    @property
    def examples(self) -> Examples:
        """What a method may see of the character, besides new rough shapes."""
        one = self.one
        return Examples(one.rest, one.triangles, one.rough[self.training], one.fine[self.training], drawn_labels(one))

    @property
    def rough(self) -> Array:
        """Rough shapes (N, V, 3) to start from, mm."""
        return self.one.rough[self.new]

    @property
    def fine(self) -> Array:
        """The sculptor's (N, V, 3), mm."""
        return self.one.fine[self.new]

    @cached_property
    def folded(self) -> NDArray[np.bool_]:
        """Triangles (N, T) that the sculptor turned over."""
        return flipped(self.one.rest, self.fine, self.one.triangles)


def drawn_labels(one: Character) -> NDArray[np.intp]:
    """Hand-drawn region of each vertex."""
    labels = np.zeros(len(one.rest), dtype=np.intp)
    for number, which in enumerate(one.hand_drawn.values()):
        labels[which] = number
    return labels


def acted_by(name: str, seed: int) -> Character:
    """A character of the axis ``character``.

    The seed is the number of a person where the name ends with ``identity``; it is not used with two artists, whose
    shapes are what they are; elsewhere it draws the strength of the individuality, 1 with seed 0.

    Raises
    ------
    EvalkitError
        If there is no such character or its head is not on this machine.
    """
    if name in DIRECTIONS:
        return _between(name)
    if name.endswith("identity"):
        return character(f"{name} {seed}")
    return character(name, float(generator("style", name, seed=seed).uniform(*STYLES)) if seed else 1.0)


@lru_cache(maxsize=1)
def _between(direction: str) -> Character:
    return two_artists(direction)


def present(name: str) -> bool:
    """Whether the heads that a character needs are on this machine."""
    words = name.split()
    folder = os.environ.get("EVALKIT_REAL_DATA", "")
    ict = "ict" not in words or (bool(folder) and Path(folder, *ICT_FILE).is_file())
    return ict and ("makehuman" not in words or cached_head().is_file())


def where_present(first: str, axis: str = "character") -> Callable[[Condition, str], bool]:
    """For ``applies`` of a study: a head that is not here is one failed row, under the first method, not one each."""

    def applies(condition: Condition, method: str) -> bool:
        return method == first or present(str(condition[axis]))

    return applies


def own_training(one: Character, seed: int) -> Task:
    """The character's four training expressions, and :data:`MOST_NEW` others to be made."""
    training = one.rows(one.training)
    others = np.setdiff1d(np.arange(len(one.names)), training)
    some = generator("new expressions", one.name, seed=seed).permutation(others)[:MOST_NEW]
    return Task(one, training, np.sort(some))


def drawn_training(one: Character, count: int, most: int, seed: int) -> Task:
    """Training expressions drawn at random, and :data:`MOST_NEW` of those that ``most`` of them would leave to be made.

    More examples thus come on top of fewer, and the same shapes are scored for any count.
    """
    order = generator("training expressions", one.name, seed=seed).permutation(len(one.names))
    return Task(one, order[:count], np.sort(order[max(count, most) :][:MOST_NEW]))


def run_method(task: Task, method: str) -> Array:
    """Fine shapes by a method of :data:`evalkit.transfer.methods.methods`."""
    return methods[method](task.examples, task.rough)


def rms_mm(errors: Array) -> float | None:
    """Root mean square length of differences (..., 3), or None where there are none."""
    return float(np.sqrt((errors**2).sum(axis=-1).mean())) if errors.size else None


def over(value: float | None, reference: float | None) -> float | None:
    """A ratio, or None where there is nothing to compare with."""
    return value / reference if value is not None and reference else None


def score_shapes(task: Task, found: Array) -> dict[str, Any]:
    """Errors against the sculptor's shapes; the columns of :data:`COLUMNS`."""
    one, fine, rough = task.one, task.fine, task.rough
    turned = flipped(one.rest, found, one.triangles) & ~task.folded
    return {**errors_by_part(one, found - fine, rough - fine), "flipped": float(turned.sum(axis=1).mean())}


def errors_by_part(one: Character, errors: Array, reference: Array) -> dict[str, Any]:
    """Errors (..., V, 3), mm, as columns: of all vertices and of parts, and over those of the reference."""
    where: dict[str, Any] = {"all": slice(None), **{part: one.regions[part] for part in PARTS}}
    size = {part: rms_mm(errors[..., which, :]) for part, which in where.items()}
    base = {part: rms_mm(reference[..., which, :]) for part, which in where.items()}
    eyes = one.eye_distance_mm
    return {
        "all_share": over(size["all"], eyes),
        **{f"{part}_cm": None if mm is None else EYES_CM * mm / eyes for part, mm in size.items()},
        **{f"{part}_ratio": over(size[part], base[part]) for part in where},
    }


def _told(what: str, which: str) -> dict[str, str]:
    return {
        f"{which}_cm": f"sqrt(mean |x - x_sculpt|^2) over all {what} of all new shapes, cm where the inner corners of "
        "the eyes are 50 cm apart",
        f"{which}_ratio": f"{which}_cm over that of the rough shapes (Deformation Transfer) of the same cell",
    }


ERROR_COLUMNS: Mapping[str, str] = {
    "all_share": "rms distance of all vertices from the sculpt over the distance of the inner corners of the eyes",
    **_told("vertices", "all"),
    **_told("vertices of the lips", "lips"),
    **_told("vertices of the lids", "lids"),
    **_told("vertices of the brows", "brows"),
}

COLUMNS: Mapping[str, str] = {
    **ERROR_COLUMNS,
    "flipped": "triangles a shape that are turned over (evalkit.transfer.gradients.flipped) and are not in the sculpt",
}

ERROR_STATISTICS = (
    mean("all_cm", "all", "cm"),
    mean("all_ratio", DEFORMATION_TRANSFER, ""),
    *(mean(f"{part}_ratio", f"{part} over rough", "") for part in PARTS),
)

STATISTICS: tuple[Statistic, ...] = (*ERROR_STATISTICS, mean("flipped", "flipped", "triangles"))


def over_method(method: str) -> Statistic:
    """Error of all vertices over another method's on the same cells."""
    return relative_to("all_cm", method, f"all over {method}")
