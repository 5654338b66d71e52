"""Head trackers on filmed heads, one difficulty at a time.

Question: how wrong are the angles of a head tracked in an ordinary video, and what makes them worse?

Finding: not measured yet, since the study is younger than its trackers; the command prints the figures of every tracker
that can run here.

Command: ``evalkit study run head-pose --budget full``
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from evalkit.studies.filmed import FilmedHead, VideoParameters, film
from evalkit.studies.takes import told
from evalkit.studies.tracked import (
    POSE_COLUMNS,
    POSE_STATISTICS,
    TRACKERS,
    Tracked,
    heads_here,
    left_out,
    over,
    score_pose,
    track,
    trackers_here,
)
from evalkit.study.command import script
from evalkit.study.description import Budget, Condition, Scalar, Study

LIGHT: dict[str, dict[str, Any]] = {
    "camera": {"light": "camera"},
    "even": {"light": "even"},
    "lamp": {"light": "lamp"},
    "flicker": {"light": "lamp", "flicker": 0.15},
}
DISTURBED: dict[str, dict[str, Any]] = {
    "nothing": {},
    "hand": {"occluder": "hand", "frames": 120},
    "bar": {"occluder": "bar", "frames": 120},
    "face away": {"away": 0.4, "frames": 120},
}
PICTURE: dict[str, dict[str, Any]] = {
    "usual": {},
    "blurred": {"shutter": 0.6, "speed": 120.0},
    "poor": {"noise": 6.0, "crf": 32},
}
"""Value of an axis -> parameters of the video."""

SIZES = {"360x288": (360, 288), "180x144": (180, 144), "720x576": (720, 576)}


def conditions(axes: Mapping[str, tuple[Scalar, ...]]) -> Iterator[Condition]:
    """The first value of every axis, and then one axis at a time through its other values, for every head."""
    usual = {axis: values[0] for axis, values in axes.items()}
    here = heads_here("head-pose", axes["head"])
    yield from ({**usual, "head": head} for head in here)
    usual["head"] = here[0]
    for axis, values in axes.items():
        if axis != "head":
            yield from ({**usual, axis: value} for value in values[1:])


def prepare(
    seed: int, head: str, turn_deg: float, light: str, disturbed: str, picture: str, size: str, rate_hz: float
) -> FilmedHead:
    """The video of a cell."""
    width, height = SIZES[size]
    given: dict[str, Any] = {"frames": 90, **LIGHT[light], **DISTURBED[disturbed], **PICTURE[picture]}
    given["frames"] = round(given["frames"] * rate_hz / 30.0)
    return film(
        VideoParameters(
            head=head, range_deg=(10.0, float(turn_deg), 8.0), width=width, height=height, rate_hz=rate_hz, **given
        ),
        seed,
    )


def run(data: FilmedHead, method: str) -> Tracked:
    """Poses of every frame."""
    return track(TRACKERS[method], data)


QUESTION, FINDING = told(__doc__)

study = Study(
    name="head-pose",
    question=QUESTION,
    finding=FINDING + left_out(),
    axes={
        "head": ("photo", "makehuman-photo", "ict-photo", "makehuman", "template"),
        "turn_deg": (20.0, 10.0, 30.0, 40.0),
        "light": tuple(LIGHT),
        "disturbed": tuple(DISTURBED),
        "picture": tuple(PICTURE),
        "size": tuple(SIZES),
        "rate_hz": (30.0, 15.0, 10.0),
    },
    methods=trackers_here(),
    prepare=prepare,
    run=run,
    score=score_pose,
    columns=POSE_COLUMNS,
    statistics=(*POSE_STATISTICS, over("mediapipe"), over("pyrlk")),
    full=Budget(seeds=3),
    small=Budget(
        seeds=1,
        axes={
            "head": ("template-small",), "turn_deg": (20.0,), "light": ("camera",), "disturbed": ("nothing", "hand"),
            "picture": ("usual",), "size": ("360x288",), "rate_hz": (10.0,),
        },
    ),
    conditions=conditions,
)  # fmt: skip

if __name__ == "__main__":
    script(study)
