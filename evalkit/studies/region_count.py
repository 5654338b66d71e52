"""Into how many regions the face is split.

Question: how many regions should have coefficients of their own?

Finding: with 2 seeds, over the rough shapes, for 1 / 2 / 4 / 8 / 16 / 32 regions: the paper's method 0.53 / 0.54 /
0.45 / 0.48 / 0.42 / 0.40 on the template and 0.68 / 0.65 / 0.63 / 0.52 / 0.54 / 0.55 on MakeHuman identities,
differences of positions 0.52 / 0.49 / 0.40 / 0.42 / 0.36 / 0.35 and 0.57 / 0.56 / 0.58 / 0.44 / 0.44 / 0.49. Sixteen
are a fair choice; more are no better where shapes are many. The lips gain little; lids and brows, which examples move
together with the mouth, need regions of their own (brows of the template 1.46 with one region, 0.27 with 16, by the
paper's method).

Command: ``evalkit study run region-count --budget full``.
"""

from __future__ import annotations

from typing import NamedTuple

from evalkit.geometry import Array
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
from evalkit.transfer.character import CharacterTransfer
from evalkit.transfer.methods import position_deltas


class Split(NamedTuple):
    """A task, and how many times the face is split in two."""

    task: Task
    levels: int


def prepare(seed: int, character: str, regions: int) -> Split:
    """The character's own four examples; the number of regions is a power of two."""
    return Split(own_training(acted_by(character, seed), seed), int(regions).bit_length() - 1)


def run(data: Split, method: str) -> Array:
    """A method with so many regions."""
    task, levels = data
    if method == ROUGH:
        return task.rough
    if method == "position deltas":
        return position_deltas(levels)(task.examples, task.rough)
    known = task.examples
    return CharacterTransfer(known.rest, known.rough, known.fine, known.triangles, regions=levels)(task.rough)


def score(data: Split, found: Array) -> dict[str, object]:
    """Errors against the sculpt."""
    return score_shapes(data.task, found)


QUESTION, FINDING = told(__doc__)

study = Study(
    name="region-count",
    question=QUESTION,
    finding=FINDING,
    axes={"character": ("template", "makehuman identity"), "regions": (1, 2, 4, 8, 16, 32)},
    methods=(ROUGH, "position deltas", "character transfer"),
    prepare=prepare,
    run=run,
    score=score,
    columns=COLUMNS,
    statistics=STATISTICS,
    full=Budget(seeds=2),
    small=Budget(seeds=1, axes={"character": ("template",), "regions": (1, 16)}),
    applies=where_present(ROUGH),
)

if __name__ == "__main__":
    script(study)
