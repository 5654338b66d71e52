"""How many sculpts it takes.

Question: what does each further example bring, from one to eight drawn at random?

Finding: with the small budget so far (1 of the 3 seeds, template), over the rough shapes: one random example 0.81 by
the paper's method and 0.77 by differences of positions, four 0.59 and 0.54. Four that a sculptor would choose have
0.42 and 0.36 (study transfer-methods).

Command: ``evalkit study run training-size --budget full``.
"""

from __future__ import annotations

from evalkit.studies.takes import told
from evalkit.studies.transfers import (
    COLUMNS,
    ROUGH,
    STATISTICS,
    Task,
    acted_by,
    drawn_training,
    over_method,
    run_method,
    score_shapes,
    where_present,
)
from evalkit.study.command import script
from evalkit.study.description import Budget, Study

MOST = 8


def prepare(seed: int, character: str, examples: int) -> Task:
    """Examples drawn at random, and what eight of them leave to be made."""
    return drawn_training(acted_by(character, seed), examples, MOST, seed)


QUESTION, FINDING = told(__doc__)

study = Study(
    name="training-size",
    question=QUESTION,
    finding=FINDING,
    axes={"character": ("template", "makehuman identity"), "examples": tuple(range(1, MOST + 1))},
    methods=(ROUGH, "gain", "position deltas", "hand-drawn regions", "character transfer", "local regression"),
    prepare=prepare,
    run=run_method,
    score=score_shapes,
    columns=COLUMNS,
    statistics=(*STATISTICS, over_method("position deltas")),
    full=Budget(seeds=3),
    small=Budget(
        seeds=1,
        axes={"character": ("template",), "examples": (1, 4)},
        methods=(ROUGH, "position deltas", "character transfer"),
    ),
    applies=where_present(ROUGH),
)

if __name__ == "__main__":
    script(study)
