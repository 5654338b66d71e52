"""Accuracy that must not get worse: every own estimator on a few presets, compared by ``evalkit regress``.

Question: is every method still as accurate as it was?

Finding: the baselines in ``tests/baselines/`` are the answer; ``evalkit regress`` compares with them and says what
changed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from evalkit.compensation import compensate
from evalkit.control.stream import Control
from evalkit.head import Head
from evalkit.head.fit_report import FitReport
from evalkit.head.fitting import fit_head
from evalkit.metrics import expression_error_mm, rms, rotation_error_deg
from evalkit.pivot import Pivot, pivot_estimators
from evalkit.pose import Pose, pose_estimators, reference_pose
from evalkit.seeds import generator
from evalkit.studies.control_examples import Examples, examples
from evalkit.studies.filmed import FilmedHead, VideoParameters, film
from evalkit.studies.persons import Person, blank_photo, face_off_mm, landmarks_off_mm, person
from evalkit.studies.takes import PAPER, HeadTake, estimate_pivot, head_take, own, score_pivot, told
from evalkit.studies.tracked import TRACKERS, Tracked, score_pose, track
from evalkit.studies.transfers import Task, acted_by, over, own_training, rms_mm, run_method
from evalkit.study.command import script
from evalkit.study.description import Budget, Condition, Study
from evalkit.study.statistics import root_mean_square

QUICK = ("joint", "score", "svd", "sphere", "gamage-lasenby")
"""Pivot estimators that are measured on every preset; the searches are slow, and one preset shows if they break."""

COMPENSATIONS: dict[str, dict[str, Any]] = {"forehead": {}, "auto": {"rigid": "auto"}, "smooth": {"smooth": True}}
"""Ways to compensate whose expression error is watched."""


PERSON = "person"
"""The preset that is no take: a person whose head is known, for fits to a photo."""

PERSON_VERTICES = 3000

FAR_MM = 1e6
"""Persons are seen from so far: perspective, which a fit takes for a part of the face, would hide what the fit does; at
two metres a fit that goes half the way scores no worse across the view."""

FITS: dict[str, Callable[[Head, FitReport, Person], float]] = {
    "reprojection": lambda head, report, who: report.reprojection_rms_px,
    "landmarks across": lambda head, report, who: rms(np.linalg.norm(landmarks_off_mm(head, who)[:, :2], axis=1)),
    "face across": lambda head, report, who: rms(np.linalg.norm(face_off_mm(head, who)[:, :2], axis=1)),
    "face along": lambda head, report, who: rms(face_off_mm(head, who)[:, 2]),
}
"""Measures of a fit to a photo: pixels at the points, then mm from the person's head, across and along the view."""

CHARACTER = "character"
"""The preset that is no take either: a character whose sculptor is known."""

TRANSFERS = ("character transfer", "local regression", "position deltas")
"""Ways from rough to fine shapes; their error is told over that of the rough shapes."""

NEW_SHAPES = 8

FILM = "film"
"""The preset that is a video of a head whose pose is known."""

FILMED = VideoParameters(head="template-small", frames=30, width=180, height=144, rate_hz=15.0)

FOLLOWERS = ("learnt-relief", "cylinder")
"""Trackers; their error is the mean of the three axes'."""

CONTROL = "control"
"""The preset that is a motion database, and control parameters of another performance with noise."""

NOISE = 0.3
"""Of those parameters, in spreads of the database."""

STEPS = ("filter", "markers")
"""Errors of the filtered parameters over their noise, and of the markers over their motion."""

Data = HeadTake | Person | Task | FilmedHead | Examples


@dataclass(frozen=True, eq=False)
class Found:
    """What a method found: poses, a pivot with them, a compensation's points, poses of a video, or an error."""

    pose: Pose | None = None
    pivot: tuple[Pivot, Pose] | None = None
    points: Any = None
    tracked: Tracked | None = None
    error: float | None = None


def prepare(seed: int, preset: str) -> Data:
    """A short take, a person, a video, or a character with its own examples and some shapes to be made."""
    if preset == CONTROL:
        return examples("held out", seed, "template 3000", 1500, 120)
    if preset == FILM:
        return film(FILMED, seed)
    if preset == CHARACTER:
        task = own_training(acted_by("template", seed), seed)
        some = generator("shapes of the gate", seed=seed).choice(task.new, NEW_SHAPES, replace=False)
        return replace(task, new=some)
    return person(seed, PERSON_VERTICES, FAR_MM) if preset == PERSON else head_take(preset, seed, frames=300)


@lru_cache(maxsize=1)
def fitted(who: Person) -> tuple[Head, FitReport]:
    """The head that is fitted to a person's points, once for all measures."""
    return fit_head(blank_photo(who), who.points, who.generic, picture=False)


def run(data: Data, method: str) -> Found:
    """One method.

    ``rotation NAME``, ``pivot NAME``, ``expression NAME``, ``transfer NAME``, ``track NAME``, ``control NAME``, or the
    measure ``fit NAME`` of a fit.
    """
    kind, _, name = method.partition(" ")
    if isinstance(data, Examples):
        return Found(error=_controlled(data)[STEPS.index(name)])
    if isinstance(data, FilmedHead):
        return Found(tracked=track(TRACKERS[name], data))
    if isinstance(data, Task):
        off, rough = rms_mm(run_method(data, name) - data.fine), rms_mm(data.rough - data.fine)
        return Found(error=over(off, rough))
    if isinstance(data, Person):
        return Found(error=FITS[name](*fitted(data), data))
    if kind == "rotation":
        points = data.points[:, :3] if pose_estimators[name].markers == 3 else data.points
        return Found(pose=reference_pose(pose_estimators[name], points))
    if kind == "pivot":
        return Found(pivot=estimate_pivot(data, name))
    options: dict[str, Any] = {"rigid": list(data.truth.rigid), **COMPENSATIONS[name]}
    return Found(points=compensate(data.take, **options).capture.points)


@lru_cache(maxsize=1)
def _controlled(data: Examples) -> tuple[float | None, float | None]:
    """Errors of both steps."""
    noise = NOISE * generator("noise of the gate").standard_normal(data.signal.shape)
    found = Control(data).run(data.signal + noise)
    left = (found.parameters - data.signal)[:, data.known]
    return over(rms(left), rms(noise[:, data.known])), over(rms(found.displacements - data.truth), rms(data.truth))


def score(data: Data, found: Found) -> dict[str, Any]:
    """The error that the method is about."""
    if isinstance(data, FilmedHead):
        assert found.tracked is not None
        return {"error": score_pose(data, found.tracked)["mean_deg"]}
    if not isinstance(data, HeadTake):
        return {"error": found.error}
    truth = data.truth
    if found.pose is not None:
        return {"error": rms(rotation_error_deg(found.pose.rotations, truth.rotations))}
    if found.pivot is not None:
        return {"error": score_pivot(data, found.pivot)["pivot_mm"]}
    return {"error": rms(expression_error_mm(found.points[:, data.others], truth.clean[:, data.others]))}


def applies(condition: Condition, method: str) -> bool:
    """What is slow, on the one preset that it is about."""
    kind, _, name = method.partition(" ")
    for own_preset, own_kind in ((PERSON, "fit"), (CHARACTER, "transfer"), (FILM, "track"), (CONTROL, "control")):
        if condition["preset"] == own_preset or kind == own_kind:
            return condition["preset"] == own_preset and kind == own_kind
    if name == "auto":
        return condition["preset"] == "skin"
    return kind != "pivot" or name in QUICK or condition["preset"] == "talking"


_question, _finding = told(__doc__)

study = Study(
    name="regression",
    question=_question,
    finding=_finding,
    axes={"preset": ("talking", "sway", "small-motion", "gaps", "outliers", "skin", PERSON, CHARACTER, FILM, CONTROL)},
    methods=(
        *(f"rotation {name}" for name in own(pose_estimators)),
        *(f"pivot {name}" for name in (PAPER, *own(pivot_estimators))),
        *(f"expression {name}" for name in COMPENSATIONS),
        *(f"fit {name}" for name in FITS),
        *(f"transfer {name}" for name in TRANSFERS),
        *(f"track {name}" for name in FOLLOWERS),
        *(f"control {name}" for name in STEPS),
    ),
    prepare=prepare,
    run=run,
    score=score,
    columns={
        "error": "rotation error, deg rms; pivot error, mm; expression error, mm rms; of a fit to a photo, "
        "pixels rms or mm rms: as the method's name says; of a transfer, rms error over that of the rough shapes; "
        "of a video's head, mean of three axes, deg; of control, over the noise and over the motion",
    },
    statistics=(root_mean_square("error", "error", ""),),
    full=Budget(seeds=12),
    small=Budget(seeds=2),
    applies=applies,
)

if __name__ == "__main__":
    script(study)
