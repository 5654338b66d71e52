"""Pivot estimators over the head's range of motion, a neck at rest.

Question: what does each pivot estimator still know of the pivot when the head turns by 20, 5 or 2 degrees?

Finding: -

Command: ``evalkit study run pivot-range-of-motion --budget full``.
"""

from evalkit.studies.pivot_noise import FIGURES, STILL
from evalkit.studies.takes import (
    PAPER,
    PIVOT_COLUMNS,
    HeadTake,
    estimate_pivot,
    head_take,
    one_per_family,
    score_pivot,
    told,
)
from evalkit.study.command import script
from evalkit.study.description import Budget, Expected, Study


def prepare(seed: int, range_deg: float) -> HeadTake:
    """A talk in which no angle goes beyond the range; 0.3 mm of noise."""
    return head_take("talking", seed, range_deg=range_deg)


question, finding = told(__doc__)

study = Study(
    name="pivot-range-of-motion",
    question=question,
    finding=finding,
    axes={"range_deg": (20.0, 5.0, 2.0)},
    methods=(PAPER, STILL, *one_per_family()),
    prepare=prepare,
    run=estimate_pivot,
    score=score_pivot,
    columns=PIVOT_COLUMNS,
    figures=FIGURES,
    full=Budget(seeds=16),
    small=Budget(seeds=3, axes={"range_deg": (20.0, 2.0)}),
    expected=(
        # As in pivot-noise. At 5 and 2 degrees the bound, a linearisation at the truth, is no promise.
        Expected("efficiency", STILL, 0.9, least=True, where={"range_deg": 20.0}),
        Expected("error over that of joint none", "joint", 1.05, where={"range_deg": 20.0}),
    ),
)

if __name__ == "__main__":
    script(study)
