"""Head trackers on filmed heads, one difficulty at a time.

Question: how wrong are the angles of a head tracked in an ordinary video, and what makes them worse?

Finding: the learnt relief is the most exact over all 20 conditions, and in yaw level with MediaPipe's network: mean
error of yaw 1.17 against 1.21 deg, of the three axes 1.13 against 1.87, one seed. The aim of 1.5 deg for the mean is
met on the three heads in a portrait, which are neither tracker's own (turns within 20 deg since the first frame, which
starts from placed points): 0.73 deg on the portrait fitted to the built-in head, 0.74 on MakeHuman's head, 1.19 on ICT-
FaceKit's; MediaPipe has 2.00, 1.04 and 1.05. The aim of a yaw below MediaPipe's is met on MakeHuman's head (0.57
against 0.64 deg) and missed on the other two (1.19 against 0.69, 1.00 against 0.85). On three more seeds that nothing
was tuned on (30, 31, 32) yaw is 1.16 against 1.14 deg in the mean of the three heads, and the mean of the axes 1.06
against 1.14: missed by 0.02 deg. What is left is a turn that is measured too small, on all heads alike. Smooth skins
are hard: 1.75 deg of yaw on MakeHuman's own and 3.32 on the drawn one, where MediaPipe has 0.73 and 1.38; optical flow,
with 0.66 deg, is best on the latter. Of the others, same heads and order as above, the relief of the mean face has a
mean of 2.20, 1.34 and 0.92 deg, the cylinder 3.00, 2.73 and 1.55, optical flow 3.41, 1.12 and 1.66. Light, motion blur,
noise and coarse H.264 cost the learnt relief nothing; 10 frames a second 0.7 deg, half the resolution 0.4, turns to 40
deg 1.1 (mean of the axes). Behind a passing hand it is never more than 6.8 deg off and back after 2 frames, behind a
bar 5.8 deg and at once (MediaPipe 20 and 22 deg, 3 and 2 frames; optical flow is lost for good). While the face is away
no tracker calls a pose tracked; while it leaves, the learnt relief is up to 31 deg off in a frame, the others 8 to 9.

Command: ``evalkit study run head-pose --budget full --seeds 1``, the weights of MediaPipe's detector named in
``EVALKIT_LANDMARKER`` and the folder of ICT-FaceKit in ``EVALKIT_REAL_DATA``.
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
    full=Budget(seeds=2),
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
