"""The terms of the paper's objective, their weights and scales, and what they are compared with.

Question: which terms, scales and reference of the paper's objective put its minimum near the pivot?

Finding: with 10 seeds the reference matters more than any weight: about frame 0, whose own noise enters every term,
six-directions has 3.6 [2.7, 5.0] times the error that it has about the mean (2.1 against 0.59 mm, all terms), and 8.3
[5.3, 17] times with the length term alone (2.2 against 0.26). The median does as the mean. Of the terms the length
alone is the best, 1.1 times the bound; the angle alone is off by 7.4 mm, and the more it weighs the worse: 0.28 mm
with l = 10, 0.59 with l = 100, 2.8 with l = 1000. The pull is nothing at C = 100, and a bias once it is felt: 1.5 mm
with C = 0.1 and 18 mm with C = 0.01, towards a local origin some 30 mm from the pivot. The search adds nothing to
that: NLopt's Subplex ends with the same errors. The squared variant is better where the length rules, 0.22 mm alone,
0.43 with all terms, and worse where the angle or the pull does.

Command: ``evalkit study run objective-terms --budget full``.
"""

from __future__ import annotations

from typing import Any

from evalkit.pivot import Pivot, pivot_estimators
from evalkit.studies.takes import PIVOT_COLUMNS, HeadTake, head_take, score_pivot, told
from evalkit.study.command import script
from evalkit.study.description import Budget, Study
from evalkit.study.statistics import error_over_bound, mean, median, relative_to, root_mean_square

TERMS: dict[str, dict[str, float]] = {
    "all": {},
    "no pull": {"pull_weight": 0.0},
    "length alone": {"angle_weight": 0.0, "pull_weight": 0.0},
    "angle alone": {"length_weight": 0.0, "pull_weight": 0.0},
    "l 10": {"length_scale_mm": 10.0},
    "l 1000": {"length_scale_mm": 1000.0},
    "C 0.1": {"pull_scale_mm": 0.1},
    "C 0.01": {"pull_scale_mm": 0.01},
}
"""What differs from w1 = w2 = w3 = 1 and l = C = 100 mm in Eq. (5).

Only two ratios move its minimum, ``w1 l / w2`` and ``w3 / (w2 C)``: other weights would be other scales.
"""

SEARCHES = ("six-directions", "nlopt-sbplx", "nlopt-lbfgs")
"""The paper's search; one that gets nearer to the same minimum; and one of the squared variant."""

REFERENCES = ("frame 0", "mean", "median")

METHODS = tuple(
    f"{search}, {reference}"
    for search in SEARCHES
    for reference in REFERENCES
    # The squared variant takes the median as the mean.
    if reference != "median" or search == "six-directions"
)

ASTRAY_MM = 1000.0
"""A pivot this far from the truth is no pivot of a head, whatever the noise."""

Terms = tuple[HeadTake, dict[str, float]]


def prepare(seed: int, terms: str) -> Terms:
    """An ordinary talk, and the objective's settings."""
    return head_take("talking", seed), TERMS[terms]


def run(data: Terms, method: str) -> Pivot:
    """The minimum as one search finds it from the local origin, with one reference."""
    take, options = data
    search, _, reference = method.partition(", ")
    return pivot_estimators[search](
        take.points, take.free, initial=take.origin, origin=take.origin,
        reference=int(reference.removeprefix("frame ")) if reference.startswith("frame ") else reference, **options,
    )  # fmt: skip


def score(data: Terms, result: Pivot) -> dict[str, Any]:
    """Errors of the pivot."""
    found = score_pivot(data[0], (result, data[0].free))
    return {**found, "astray": int(not found["pivot_mm"] <= ASTRAY_MM)}


question, finding = told(__doc__)

study = Study(
    name="objective-terms",
    question=question,
    finding=finding,
    axes={"terms": tuple(TERMS)},
    methods=METHODS,
    prepare=prepare,
    run=run,
    score=score,
    columns={**PIVOT_COLUMNS, "astray": f"1 if the pivot is more than {ASTRAY_MM:g} mm off, else 0"},
    statistics=(
        root_mean_square("pivot_mm", "pivot error", "mm"),
        median("pivot_mm", "median error", "mm"),
        error_over_bound("pivot_mm", "bound_mm"),
        relative_to("pivot_mm", "six-directions, mean", "error over six-directions with the mean"),
        mean("astray", "share astray", ""),
    ),
    full=Budget(seeds=10),
    small=Budget(seeds=2, axes={"terms": ("all", "length alone", "angle alone")}),
)

if __name__ == "__main__":
    script(study)
