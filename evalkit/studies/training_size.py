"""How many sculpts it takes.

Question: what does each further example bring, from one to eight drawn at random?

Finding: with 3 seeds, over the rough shapes, for 1 / 2 / 4 / 8 examples drawn at random: on the template the paper's
method 0.89 / 0.77 / 0.74 / 0.59, hand-drawn regions 0.88 / 0.76 / 0.72 / 0.57, position deltas 1.00 / 0.78 / 0.92 /
0.56, local regression 0.95 / 0.75 / 0.74 / 0.53; on MakeHuman identities 0.93 / 0.92 / 0.86 / 0.80, 0.95 / 0.94 /
0.84 / 0.84, 0.96 / 0.90 / 0.80 / 0.74 and 0.88 / 0.88 / 0.78 / 0.64. One gain is never better than 0.81. Local
regression is the best or level from two examples on; four that a sculptor would choose are worth more than eight at
random (0.42 and 0.54 by the paper's method, study transfer-methods).

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
