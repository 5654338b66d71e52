"""Expressions that are like none of the examples, as in the paper's Fig. 8.

Question: what happens to expressions that no example is like?

Finding: with 2 seeds, over the rough shapes, what is unlike the examples against all others: the paper's method 0.33
and 0.45 on the template, 0.24 and 0.38 on the muzzle, 0.41 and 0.55 on MakeHuman identities, 1.11 and 1.06 with two
artists; differences of positions 0.32 and 0.37, 0.37 and 0.29, 0.33 and 0.47, 1.31 and 1.84; local regression 0.40
and 0.45, 0.39 and 0.37, 0.33 and 0.42, 0.90 and 0.89. The muzzle, the character that is nearest to the paper's, is
where the paper's method is much better than differences of positions on unlike expressions (0.61 cm against 0.93).
Unlike the examples are expressions as a whole; region by region they are not, and where a sculptor follows rules
coefficients by region carry them over. With two artists they make such expressions worse than they were. The
template's and the muzzle's seeds change how strong the individuality is, and ratios hardly at all: their intervals
say nothing about other faces.

Command: ``evalkit study run unlike-expressions --budget full``.
"""

from __future__ import annotations

import numpy as np

from evalkit.studies.takes import told
from evalkit.studies.transfers import (
    COLUMNS,
    DEFORMATION_TRANSFER,
    ROUGH,
    STATISTICS,
    Task,
    acted_by,
    own_training,
    run_method,
    score_shapes,
    where_present,
)
from evalkit.study.command import script
from evalkit.study.description import Budget, Expected, Study

UNLIKE, OTHERS = "unlike", "others"


def prepare(seed: int, character: str, expressions: str) -> Task:
    """The character's own four examples, and either what is unlike them or all others."""
    task = own_training(acted_by(character, seed), seed)
    unlike = task.one.rows(task.one.unlike)
    return Task(task.one, task.training, unlike if expressions == UNLIKE else np.setdiff1d(task.new, unlike))


QUESTION, FINDING = told(__doc__)

study = Study(
    name="unlike-expressions",
    question=QUESTION,
    finding=FINDING,
    axes={
        "character": ("template", "muzzle", "makehuman identity", "ict to makehuman"),
        "expressions": (UNLIKE, OTHERS),
    },
    methods=(ROUGH, "gain", "position deltas", "hand-drawn regions", "character transfer", "local regression"),
    prepare=prepare,
    run=run_method,
    score=score_shapes,
    columns=COLUMNS,
    statistics=STATISTICS,
    full=Budget(seeds=2),
    small=Budget(seeds=1, axes={"character": ("template",)}, methods=(ROUGH, "position deltas", "character transfer")),
    applies=where_present(ROUGH),
    # In the paper "some of the features were correctly modified": the least is to be no worse than no method.
    expected=(Expected(DEFORMATION_TRANSFER, "character transfer", 1.0, where={"expressions": UNLIKE}),),
)

if __name__ == "__main__":
    script(study)
