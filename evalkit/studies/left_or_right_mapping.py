"""On which side of the new shape's gradient the mapping goes, and what head motion left in rough shapes does.

Question: does it matter whether the mapping is applied from the left, as in the paper, or from the right?

New rough shapes are turned together, about the middle of the face and an axis drawn at random, as if head motion had
not been taken out wholly; the truth turns with them. Errors are told after turning back.

Finding: with 2 seeds, over the rough shapes, left / right, for 0, 2, 5 and 10 degrees of head motion left in:
template 0.42 / 0.40, 0.47 / 0.44, 0.66 / 0.62 and 0.95 / 0.90, MakeHuman identities 0.54 / 0.53, 0.58 / 0.57, 0.74 /
0.76 and 1.13 / 1.21. The side hardly matters; head motion does, and by way of the coefficients: with those of the
shapes before they were turned, the right side does not feel it at all (0.40 and 0.53 at any angle) and the left one
little (0.44 and 0.55 at 10 degrees). It must be taken out first with either.

Command: ``evalkit study run left-or-right-mapping --budget full``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from evalkit.geometry import Array, rotation_from_vector
from evalkit.seeds import generator
from evalkit.studies.takes import told
from evalkit.studies.transfers import (
    COLUMNS,
    ROUGH,
    STATISTICS,
    Task,
    acted_by,
    own_training,
    score_shapes,
    where_present,
)
from evalkit.study.command import script
from evalkit.study.description import Budget, Study
from evalkit.study.statistics import relative_to
from evalkit.transfer.character import CharacterTransfer

KNOWN = ", true coefficients"
"""At the end of a method: coefficients of the shapes before they were turned, to tell the mapping's share apart."""


class Turned(NamedTuple):
    """A task and the rotation (3, 3) of its new shapes."""

    task: Task
    rotation: Array

    def there(self, shapes: Array) -> Array:
        """Shapes turned about the middle of the face at rest."""
        middle = self.task.one.rest.mean(axis=0)
        return np.asarray((shapes - middle) @ self.rotation.T + middle)

    def back(self, shapes: Array) -> Array:
        """The inverse."""
        middle = self.task.one.rest.mean(axis=0)
        return np.asarray((shapes - middle) @ self.rotation + middle)


def prepare(seed: int, character: str, turn_deg: float) -> Turned:
    """The character's own four examples, and an axis that is the same for all angles."""
    axis = generator("axis of turn", seed=seed).standard_normal(3)
    rotation = rotation_from_vector(np.deg2rad(turn_deg) * axis / np.linalg.norm(axis))
    return Turned(own_training(acted_by(character, seed), seed), rotation)


def run(data: Turned, method: str) -> Array:
    """Fine shapes out of turned rough ones."""
    rough, known = data.task.rough, data.task.examples
    turned = data.there(rough)
    if method == ROUGH:
        return turned
    side = method.removesuffix(KNOWN)
    transfer = CharacterTransfer(known.rest, known.rough, known.fine, known.triangles, side=side)
    return transfer(turned, transfer.coefficients(rough) if method.endswith(KNOWN) else None)


def score(data: Turned, found: Array) -> dict[str, Any]:
    """Errors against the sculpt."""
    return score_shapes(data.task, data.back(found))


QUESTION, FINDING = told(__doc__)

study = Study(
    name="left-or-right-mapping",
    question=QUESTION,
    finding=FINDING,
    axes={"character": ("template", "makehuman identity"), "turn_deg": (0.0, 2.0, 5.0, 10.0)},
    methods=(ROUGH, "left", "right", "left" + KNOWN, "right" + KNOWN),
    prepare=prepare,
    run=run,
    score=score,
    columns=COLUMNS,
    statistics=(*STATISTICS, relative_to("all_cm", "left", "all over left")),
    full=Budget(seeds=2),
    small=Budget(seeds=1, axes={"character": ("template",), "turn_deg": (0.0, 5.0)}, methods=(ROUGH, "left", "right")),
    applies=where_present(ROUGH),
)

if __name__ == "__main__":
    script(study)
