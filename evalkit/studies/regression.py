"""Accuracy that must not get worse: every own estimator on a few presets, compared by ``evalkit regress``.

Question: is every method still as accurate as it was?

Finding: the baselines in ``tests/baselines/`` are the answer; ``evalkit regress`` compares with them and says what
changed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from evalkit.compensation import compensate
from evalkit.metrics import expression_error_mm, rms, rotation_error_deg
from evalkit.pivot import Pivot, pivot_estimators
from evalkit.pose import Pose, pose_estimators, reference_pose
from evalkit.studies.takes import PAPER, HeadTake, estimate_pivot, head_take, own, score_pivot, told
from evalkit.study.command import script
from evalkit.study.description import Budget, Condition, Study
from evalkit.study.statistics import root_mean_square

QUICK = ("joint", "score", "svd", "sphere", "gamage-lasenby")
"""Pivot estimators that are measured on every preset; the searches are slow, and one preset shows if they break."""

COMPENSATIONS: dict[str, dict[str, Any]] = {"forehead": {}, "auto": {"rigid": "auto"}, "smooth": {"smooth": True}}
"""Ways to compensate whose expression error is watched."""


@dataclass(frozen=True, eq=False)
class Found:
    """What a method found: the pose of every frame, a pivot with it, or a whole compensation's points."""

    pose: Pose | None = None
    pivot: tuple[Pivot, Pose] | None = None
    points: Any = None


def prepare(seed: int, preset: str) -> HeadTake:
    """A short take."""
    return head_take(preset, seed, frames=300)


def run(data: HeadTake, method: str) -> Found:
    """One method: ``rotation NAME``, ``pivot NAME`` or ``expression NAME``."""
    kind, _, name = method.partition(" ")
    if kind == "rotation":
        points = data.points[:, :3] if pose_estimators[name].markers == 3 else data.points
        return Found(pose=reference_pose(pose_estimators[name], points))
    if kind == "pivot":
        return Found(pivot=estimate_pivot(data, name))
    options: dict[str, Any] = {"rigid": list(data.truth.rigid), **COMPENSATIONS[name]}
    return Found(points=compensate(data.take, **options).capture.points)


def score(data: HeadTake, found: Found) -> dict[str, Any]:
    """The error that the method is about."""
    truth = data.truth
    if found.pose is not None:
        return {"error": rms(rotation_error_deg(found.pose.rotations, truth.rotations))}
    if found.pivot is not None:
        return {"error": score_pivot(data, found.pivot)["pivot_mm"]}
    return {"error": rms(expression_error_mm(found.points[:, data.others], truth.clean[:, data.others]))}


def applies(condition: Condition, method: str) -> bool:
    """What is slow, on the one preset that it is about."""
    kind, _, name = method.partition(" ")
    if name == "auto":
        return condition["preset"] == "skin"
    return kind != "pivot" or name in QUICK or condition["preset"] == "talking"


_question, _finding = told(__doc__)

study = Study(
    name="regression",
    question=_question,
    finding=_finding,
    axes={"preset": ("talking", "sway", "small-motion", "gaps", "outliers", "skin")},
    methods=(
        *(f"rotation {name}" for name in own(pose_estimators)),
        *(f"pivot {name}" for name in (PAPER, *own(pivot_estimators))),
        *(f"expression {name}" for name in COMPENSATIONS),
    ),
    prepare=prepare,
    run=run,
    score=score,
    columns={"error": "rotation error, deg rms; pivot error, mm; expression error, mm rms: as the method's name says"},
    statistics=(root_mean_square("error", "error", ""),),
    full=Budget(seeds=12),
    small=Budget(seeds=2),
    applies=applies,
)

if __name__ == "__main__":
    script(study)
