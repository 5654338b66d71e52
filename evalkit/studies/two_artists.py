"""Two artists' shapes of the same expressions: a truth that nobody here has made.

Question: from a few of one artist's sculpts, how near to that artist's other expressions do the methods come when they
start from another artist's shapes, carried over by Deformation Transfer?

Finding: to be measured.

Command: ``evalkit study run two-artists --budget full``, the folder with ICT-FaceKit named in ``EVALKIT_REAL_DATA``.
"""

from __future__ import annotations

from evalkit.dense.two_artists import DIRECTIONS
from evalkit.studies.takes import told
from evalkit.studies.transfers import (
    COLUMNS,
    HAND_DRAWN,
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
from evalkit.study.description import Budget, Condition, Expected, Study
from evalkit.transfer.methods import methods

COUNTS = (2, 4, 8, 16)
OURS = "local regression"
SIMPLE = ("gain", "position deltas", "position deltas, one region")


def prepare(seed: int, direction: str, examples: int) -> Task:
    """Examples drawn at random, and what sixteen of them leave to be made."""
    return drawn_training(acted_by(direction, seed), examples, max(COUNTS), seed)


def applies(condition: Condition, method: str) -> bool:
    """The rig takes as long as all others together and changes next to nothing: four examples show it."""
    rig = method == "example-based rigging" and condition["examples"] != 4
    return not rig and where_present(ROUGH, "direction")(condition, method)


QUESTION, FINDING = told(__doc__)

study = Study(
    name="two-artists",
    question=QUESTION,
    finding=FINDING,
    axes={"direction": DIRECTIONS, "examples": COUNTS},
    methods=tuple(methods),
    prepare=prepare,
    run=run_method,
    score=score_shapes,
    columns=COLUMNS,
    statistics=(*STATISTICS, *(over_method(name) for name in (*SIMPLE, "one region", "hand-drawn regions"))),
    full=Budget(seeds=6),
    small=Budget(
        seeds=1,
        axes={"direction": DIRECTIONS[:1], "examples": (4,)},
        methods=(ROUGH, *SIMPLE, "character transfer", OURS),
    ),
    applies=applies,
    expected=(
        # In the paper's Table 1 regions of its own finding are better than a user's.
        Expected(HAND_DRAWN, "character transfer", 1.0),
        Expected("all over one region", "character transfer", 1.0),
        # What a variant must save to be worth more than the simplest that there is.
        *(Expected(f"all over {name}", OURS, 0.9) for name in SIMPLE),
    ),
)

if __name__ == "__main__":
    script(study)
