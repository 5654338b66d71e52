"""Pivot estimators over noise, a neck at rest."""

from evalkit.pivot import pivot_estimators
from evalkit.studies.takes import PAPER, PIVOT_COLUMNS, HeadTake, estimate_pivot, head_take, score_pivot
from evalkit.study.command import script
from evalkit.study.description import Budget, Expected, Study
from evalkit.study.figures import efficiency_of_form, error_over_bound, mean, root_mean_square


def prepare(seed: int, noise_mm: float) -> HeadTake:
    """An ordinary talk with this much noise."""
    return head_take("talking", seed, noise=noise_mm)


study = Study(
    name="pivot-noise",
    question="how near does each pivot estimator come to the Cramér-Rao bound as the noise grows?",
    finding="-",
    axes={"noise_mm": (0.1, 0.3, 1.0)},
    methods=(PAPER, *pivot_estimators),
    prepare=prepare,
    run=estimate_pivot,
    score=score_pivot,
    columns=PIVOT_COLUMNS,
    figures=(
        root_mean_square("pivot_mm", "pivot error", "mm"),
        root_mean_square("bound_mm", "bound", "mm"),
        error_over_bound("pivot_mm", "bound_mm"),
        efficiency_of_form("form"),
        mean("stated", "normalised error", "", less=None),
    ),
    full=Budget(seeds=50),
    small=Budget(seeds=4, axes={"noise_mm": (0.3,)}),
    expected=(Expected("efficiency", "joint", 0.9, least=True),),
)

if __name__ == "__main__":
    script(study)
