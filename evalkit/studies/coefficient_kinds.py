"""What coefficients of the examples are allowed to be.

Question: should coefficients be free, non-negative, sum to one, or be both, and what does the ridge do?

Finding: with 2 seeds, over the rough shapes, ridge / non-negative / sum to one / convex: the template's own four
examples 0.42 / 0.41 / 0.47 / 0.43, eight at random 0.44 / 0.53 / 0.45 / 0.52; MakeHuman identities 0.54 / 0.55 / 0.64
/ 0.59 and 0.82 / 0.85 / 0.82 / 0.88; ICT-FaceKit to MakeHuman 1.07 / 1.01 / 1.08 / 1.01 and 1.09 / 0.99 / 1.09 /
0.96. No kind is best everywhere: bounds cost where the sculptor is consistent and save where he is not. Hardly a
ridge is the worst with random examples (0.81 and 1.12); a hundred times more than the default changes little.

Command: ``evalkit study run coefficient-kinds --budget full``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from evalkit.geometry import Array
from evalkit.studies.takes import told
from evalkit.studies.transfers import (
    COLUMNS,
    ROUGH,
    STATISTICS,
    Task,
    acted_by,
    drawn_training,
    own_training,
    score_shapes,
    where_present,
)
from evalkit.study.command import script
from evalkit.study.description import Budget, Study
from evalkit.study.statistics import mean, relative_to
from evalkit.transfer.character import CharacterTransfer
from evalkit.transfer.coefficients import kinds

OPTIONS: dict[str, dict[str, Any]] = {
    **{kind: {"coefficients": kind} for kind in kinds},
    "hardly a ridge": {"ridge": 1e-9},
    "strong ridge": {"ridge": 0.1},
}
"""Without any ridge the system is singular wherever an example leaves a region still, which is nearly always."""

OWN, DRAWN = "own four", "eight at random"
"""Examples that a sculptor would choose, and those that nobody has chosen, some of which are alike."""


class Made(NamedTuple):
    """Shapes (N, V, 3) and the coefficients (N, R, M) that they were made with."""

    shapes: Array
    weights: Array


def prepare(seed: int, character: str, examples: str) -> Task:
    """The character with one of the two sets of examples."""
    one = acted_by(character, seed)
    return own_training(one, seed) if examples == OWN else drawn_training(one, 8, 8, seed)


def run(data: Task, method: str) -> Made:
    """Shapes with one kind of coefficients."""
    if method == ROUGH:
        return Made(data.rough, np.zeros((len(data.new), 1, len(data.training))))
    known = data.examples
    transfer = CharacterTransfer(known.rest, known.rough, known.fine, known.triangles, **OPTIONS[method])
    weights = transfer.coefficients(data.rough)
    return Made(transfer(data.rough, weights), weights)


def score(data: Task, found: Made) -> dict[str, Any]:
    """Errors against the sculpt, and how large coefficients get."""
    return {
        **score_shapes(data, found.shapes),
        "largest": float(np.abs(found.weights).max()),
        "negative_percent": 100.0 * float((found.weights < 0.0).mean()),
    }


QUESTION, FINDING = told(__doc__)

study = Study(
    name="coefficient-kinds",
    question=QUESTION,
    finding=FINDING,
    axes={"character": ("template", "makehuman identity", "ict to makehuman"), "examples": (OWN, DRAWN)},
    methods=(ROUGH, *OPTIONS),
    prepare=prepare,
    run=run,
    score=score,
    columns={
        **COLUMNS,
        "largest": "the largest |w| over shapes, regions and examples",
        "negative_percent": "coefficients below zero, %",
    },
    statistics=(
        *STATISTICS,
        relative_to("all_cm", "ridge", "all over ridge"),
        mean("largest", "largest coefficient", ""),
        mean("negative_percent", "negative", "%", less=None),
    ),
    full=Budget(seeds=2),
    small=Budget(seeds=1, axes={"character": ("template",), "examples": (OWN,)}),
    applies=where_present(ROUGH),
)

if __name__ == "__main__":
    script(study)
