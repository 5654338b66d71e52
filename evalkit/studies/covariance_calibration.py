"""Whether stated uncertainties are honest.

Question: do pivots and rotations err by as much as the covariance that their estimator states?

Finding: the joint estimate is honest where its model holds: with 16 seeds the truth lies in its 95 % ellipsoid in 16
of 16 takes (15.2 expected) with noise of 0.3 or 1 mm, a range of 5 or 2 degrees, or 20 % of gaps, in 15 with 5 mm of
sway, and the squared error over what is stated averages 0.77 to 0.98. NOT MET with 20 mm of sway, 13 of 16 and an
average of 1.8: its covariance takes the knots that it chose for given. NOT MET with skin that slides by 2 mm, 11 of 16
and 2.7; no method sees that, the others have 7 to 10. SCoRE is too sure even at rest, 12 of 16 and 2.0; SVD has 13,
the sphere fits 14, the paper's search 15. With sway, the methods that hold the pivot still have 4 to 8. Rotation
errors are as predicted, within 1 % for each frame by itself and 3 % turned about the pivot, but for skin, where the
frames err by 0.82 of it; smoothed, they are 0.94 to 1.15 of what is predicted and 1.4 with skin. Methods of other
packages state nothing.

Command: ``evalkit study run covariance-calibration --budget full``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.metrics import rms, rotation_error_deg
from evalkit.pivot import Pivot
from evalkit.pose import Pose
from evalkit.pose.smooth import smooth
from evalkit.studies.takes import SMOOTHED, HeadTake, estimate_pivot, head_take, one_per_family, told
from evalkit.study.command import script
from evalkit.study.description import Budget, Expected, Study
from evalkit.study.statistics import error_over_bound, mean, median

TAKES: dict[str, dict[str, float]] = {
    "talking": {},
    "noise 1 mm": {"noise": 1.0},
    "range 5 deg": {"range_deg": 5.0},
    "range 2 deg": {"range_deg": 2.0},
    "sway 5 mm": {"sway": 5.0},
    "sway 20 mm": {"sway": 20.0},
    "gaps 20 %": {"gaps": 0.2},
    "skin 2 mm": {"skin": 2.0},
}
"""What differs from an ordinary talk within 20 degrees and with 0.3 mm of noise."""

STATED_POSES = ("svd", "joint", SMOOTHED)
"""Methods whose rotations have a stated error: each frame's pose, turned about the pivot, and smoothed."""

Answer = tuple[Pivot, Pose, float]


def prepare(seed: int, take: str) -> HeadTake:
    """One of :data:`TAKES`."""
    return head_take("talking", seed, **TAKES[take])


def run(data: HeadTake, method: str) -> Answer:
    """Pivot, pose, and the rms rotation error that :func:`evalkit.pose.smooth.smooth` predicts, deg; NaN if none."""
    pivot, pose = estimate_pivot(data, "joint" if method == SMOOTHED else method)
    if method not in STATED_POSES:
        return pivot, pose, float("nan")
    about = None if method == "svd" else pivot.position
    found = smooth(pose, data.points, rate=data.take.rate, about=about)
    return (pivot, found.pose, found.smoothed_deg) if method == SMOOTHED else (pivot, pose, found.measured_deg)


def score(data: HeadTake, result: Answer) -> dict[str, Any]:
    """Squared error in units of what is stated, over the principal axes that have a finite deviation."""
    from scipy.stats import chi2

    pivot, pose, predicted = result
    truth = data.truth
    error = pivot.principal_axes @ (pivot.position - (truth.pivot + truth.sway.mean(axis=0)))
    shown = np.isfinite(pivot.principal_std)
    count = int(shown.sum())
    square = float(((error[shown] / pivot.principal_std[shown]) ** 2).sum()) if count else None
    inside = {
        f"inside_{share}": None if square is None else int(square <= chi2.ppf(share / 100, count)) for share in (50, 95)
    }
    stated = np.isfinite(predicted)
    return {
        "pivot_mm": float(np.linalg.norm(error)),
        "stated_mm": float(np.sqrt((pivot.principal_std[shown] ** 2).sum())) if count else None,
        "axes": count,
        "normalised": None if square is None else square / count,
        **inside,
        # A smoothed path bridges frames without a pose; what is predicted is the error of the others.
        "rotation_deg": rms(rotation_error_deg(pose.rotations, truth.rotations, pose.ok)) if stated else None,
        "rotation_stated_deg": float(predicted) if stated else None,
    }


question, finding = told(__doc__)

study = Study(
    name="covariance-calibration",
    question=question,
    finding=finding,
    axes={"take": tuple(TAKES)},
    methods=(SMOOTHED, *one_per_family()),
    prepare=prepare,
    run=run,
    score=score,
    columns={
        "pivot_mm": "distance of the pivot from its true mean place, mm",
        "stated_mm": "what the covariance says of it: root of the sum of the variances along axes that have one, mm",
        "axes": "number d of principal axes with a finite variance; none from methods that state no covariance",
        "normalised": "sum of (error / stated deviation)² over these axes, over d; 1 on average if honest",
        "inside_50": "1 if the truth lies in the stated ellipsoid of 50 %, by chi-square of d freedoms, else 0",
        "inside_95": "the same of 95 %",
        "rotation_deg": "rotation error, rms over the frames that have a pose, deg",
        "rotation_stated_deg": "what the method predicts of it, deg; empty from methods that predict nothing",
    },
    statistics=(
        mean("normalised", "normalised error², honest 1", "", less=None),
        median("normalised", "its median, honest 0.79", "", less=None),
        mean("inside_50", "inside 50 %, honest 0.5", "", less=None),
        mean("inside_95", "inside 95 %, honest 0.95", "", less=None),
        error_over_bound("pivot_mm", "stated_mm", "pivot error over stated"),
        error_over_bound("rotation_deg", "rotation_stated_deg", "rotation error over stated"),
    ),
    full=Budget(seeds=16),
    small=Budget(seeds=2),
    expected=(
        # 16 honest takes fall below 0.85 in one run of 143 (binomial).
        Expected("inside 95 %, honest 0.95", "joint", 0.85, least=True),
    ),
)

if __name__ == "__main__":
    script(study)
