"""Pivot estimators over noise, a neck at rest.

Question: how near does each pivot estimator come to the Cramér-Rao bound as the noise grows?

Finding: -

Command: ``evalkit study run pivot-noise --budget full``.
"""

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
from evalkit.study.figures import (
    efficiency,
    efficiency_of_form,
    error_over_bound,
    median,
    relative_to,
    root_mean_square,
)

STILL = "joint none"
"""``joint`` told that the neck rests: the model of these takes."""

FIGURES = (
    root_mean_square("pivot_mm", "pivot error", "mm"),
    median("pivot_mm", "median error", "mm"),
    root_mean_square("bound_mm", "bound", "mm"),
    error_over_bound("pivot_mm", "bound_mm"),
    efficiency_of_form("form"),
    efficiency("pivot_mm", "bound_mm", "efficiency of the trace"),
    relative_to("pivot_mm", STILL, "error over that of joint none"),
)
"""What is made of the errors of pivots at rest."""


def prepare(seed: int, noise_mm: float) -> HeadTake:
    """An ordinary talk with this much noise."""
    return head_take("talking", seed, noise=noise_mm)


question, finding = told(__doc__)

study = Study(
    name="pivot-noise",
    question=question,
    finding=finding,
    axes={"noise_mm": (0.1, 0.3, 1.0)},
    methods=(PAPER, STILL, *one_per_family()),
    prepare=prepare,
    run=estimate_pivot,
    score=score_pivot,
    columns=PIVOT_COLUMNS,
    figures=FIGURES,
    full=Budget(seeds=40),
    small=Budget(seeds=5, axes={"noise_mm": (0.3,)}),
    expected=(
        # An efficient estimator has 1; 40 seeds of three coordinates know that to some 13 %.
        Expected("efficiency", STILL, 0.9, least=True),
        # A choice that never took noise for sway would have 1.
        Expected("error over that of joint none", "joint", 1.05),
    ),
)

if __name__ == "__main__":
    script(study)
