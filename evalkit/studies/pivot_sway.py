"""Pivot, head motion and expression when the neck drifts.

Question: what does a drifting neck do to the pivot, the rotation and the expression, and what is its model worth?

Finding: with 40 seeds and 20 mm of sway the joint estimate with its automatic spline is off by 1.3 mm, 1.13 [0.88,
1.39] times the bound, where the methods that hold the pivot still are off by 17 (SCoRE), 24 (SVD) to 99 mm
(Gamage-Lasenby) and, with one take 1.2 m astray, 207 mm (six-directions). Told of no sway, the joint estimate is the
worst of all for the head: rotation 4.6 times and expression 5.3 times the error of each frame by itself, and 1.4 times
the expression already at 5 mm. At rest the automatic choice costs nothing. Knots too far apart (2.5 s) leave 12 mm and
1.5 times the expression error; knots too close cost the pivot (0.31 s: 3.4 mm) more than the expression (0.53 times
per-frame, automatic 0.51). The 0.45 that was expected of the expression is NOT MET by joint, and is out of its reach:
even at rest, with no spline to pay for, it has 0.49, which is what the exact pivot would leave (1.00 times that
bound). Smoothing over time passes below, 0.39, by what neighbouring frames know of each other. Methods that give a
pivot and no poses leave the head motion as it was.

Command: ``evalkit study run pivot-sway --budget full``.
"""

from __future__ import annotations

from typing import Any

from evalkit.pivot import Pivot
from evalkit.pose import Pose
from evalkit.studies.takes import (
    HEAD_COLUMNS,
    PAPER,
    PIVOT_COLUMNS,
    SMOOTHED,
    HeadTake,
    estimate_pivot,
    head_take,
    one_per_family,
    score_head,
    score_pivot,
    told,
)
from evalkit.study.command import script
from evalkit.study.description import Budget, Expected, Study
from evalkit.study.statistics import error_over_bound, relative_to, root_mean_square

FREE = "svd"
"""The method whose poses are those of each frame by itself: what the expression is compared with."""

SPACINGS = ("joint 2.5 s", "joint 1.25 s", "joint 0.625 s", "joint 0.3125 s")
"""Knots as the automatic choice tries them, each forced."""


def prepare(seed: int, sway_mm: float) -> HeadTake:
    """A talk on a torso that sways this far; 0.3 mm of noise."""
    return head_take("talking", seed, sway=sway_mm)


def score(data: HeadTake, result: tuple[Pivot, Pose]) -> dict[str, Any]:
    """Errors of the pivot, of the head motion and of the expression."""
    return {**score_pivot(data, result), **score_head(data, result[1])}


question, finding = told(__doc__)

study = Study(
    name="pivot-sway",
    question=question,
    finding=finding,
    axes={"sway_mm": (0.0, 5.0, 20.0)},
    methods=(PAPER, "joint none", SMOOTHED, *SPACINGS, *one_per_family()),
    prepare=prepare,
    run=estimate_pivot,
    score=score,
    columns={**PIVOT_COLUMNS, **HEAD_COLUMNS},
    statistics=(
        root_mean_square("pivot_mm", "pivot error", "mm"),
        error_over_bound("pivot_mm", "bound_mm"),
        root_mean_square("rotation_deg", "rotation error", "deg"),
        relative_to("rotation_deg", FREE, "rotation over per-frame"),
        root_mean_square("expression_mm", "expression error", "mm"),
        relative_to("expression_mm", FREE, "expression over per-frame"),
        error_over_bound("expression_mm", "expression_bound_mm", "expression over bound"),
    ),
    full=Budget(seeds=40),
    small=Budget(seeds=2, axes={"sway_mm": (0.0, 20.0)}),
    expected=(
        # With the spline known the bound is 1; the choice of its knots may cost something.
        Expected("error over bound", "joint", 1.3, where={"sway_mm": 20.0}),
        # The lever arm of the pivot over that of the forehead triangle, as the first prototype had it (0.73 / 1.77 on
        # another face). On these takes a known pivot leaves 0.49; the limit stays, and so does the miss.
        Expected("expression over per-frame", "joint", 0.45, where={"sway_mm": 20.0}),
        Expected("expression over per-frame", SMOOTHED, 0.45, where={"sway_mm": 20.0}),
    ),
)

if __name__ == "__main__":
    script(study)
