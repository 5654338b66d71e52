"""Frame rate and length of a take.

Question: what are a higher frame rate and a longer take worth?

Finding: -

Command: ``evalkit study run capture-rate --budget full``
"""

from __future__ import annotations

from evalkit.compensation import Compensation
from evalkit.studies.compensated import (
    COMPENSATION_COLUMNS,
    COMPENSATION_FIGURES,
    SMOOTH,
    compensate_by,
    score_compensation,
)
from evalkit.studies.takes import HeadTake, head_take, told
from evalkit.study.command import script
from evalkit.study.description import Budget, Expected, Study
from evalkit.study.figures import mean, root_mean_square


def prepare(seed: int, rate_hz: int, length_s: int) -> HeadTake:
    """An ordinary talk at this rate and of this length."""
    return head_take("talking", seed, rate=float(rate_hz), frames=rate_hz * length_s)


def run(data: HeadTake, method: str) -> Compensation:
    """The take without its head motion."""
    return compensate_by(data, method)


QUESTION, FINDING = told(__doc__)

study = Study(
    name="capture-rate",
    question=QUESTION,
    finding=FINDING,
    axes={"rate_hz": (30, 60, 120, 240), "length_s": (3, 10, 60)},
    methods=("svd", "svd" + SMOOTH, "joint", "joint" + SMOOTH, "auto"),
    prepare=prepare,
    run=run,
    score=score_compensation,
    columns=COMPENSATION_COLUMNS,
    figures=(
        *COMPENSATION_FIGURES[1:],
        root_mean_square("pivot_mm", "pivot", "mm"),
        mean("stated", "normalised error", "", less=None),
        mean("sound", "called ok", "", less=None),
    ),
    full=Budget(seeds=4),
    small=Budget(seeds=1, axes={"rate_hz": (30, 120), "length_s": (3, 10)}),
    # What it learns from a thousand frames spread over ten seconds it does not learn better from more.
    applies=lambda condition, method: method != "auto" or int(condition["length_s"]) <= 10,
    expected=(
        # Each frame by itself: neither rate nor length can change its rotation, 0.98 deg with three markers.
        Expected("rotation", "svd", 1.1),
        Expected("rotation", "svd", 0.85, least=True),
    ),
)

if __name__ == "__main__":
    script(study)
