"""What the studies of head tracking share: trackers that can run here, a tracker run over a filmed head, its errors.

A tracker starts from the 19 points of the first frame as a user places them, with an error of a pixel; where the head
really is it is never told. Its own zero is arbitrary. So what is compared is the turn since the first frame,
``R_f R_0'`` in the camera's axes, in which a constant turn of the head's own axes, ``R_f = R_true,f Q``, drops out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array, rotation_angle
from evalkit.metrics import rms, rotation_error_deg
from evalkit.studies.filmed import FilmedHead
from evalkit.studies.filmed_heads import missing_head
from evalkit.study.description import Scalar
from evalkit.study.statistics import Statistic, largest, mean, relative_to
from evalkit.vision.angles import AXES, head_angles_deg
from evalkit.vision.tracker import HeadTracker, TrackStatus
from evalkit.vision.trackers import missing, trackers

NEAR_DEG = 5.0
"""A head is recovered when its pose is this near to the truth: what the trackers' errors stay below otherwise."""


TRACKERS: dict[str, Callable[[], HeadTracker]] = {name: method.build for name, method in trackers.items()}
"""Name -> what builds the tracker."""


def trackers_here() -> tuple[str, ...]:
    """Names of the trackers; one that lacks its package or weights on this machine is left out, see :func:`missing`."""
    return tuple(name for name in TRACKERS if not missing(name))


def left_out() -> str:
    """What cannot run on this machine and why, as the end of a finding."""
    reasons = [f"{name} ({missing(name)})" for name in TRACKERS if missing(name)]
    return f" Left out on this machine: {'; '.join(reasons)}." if reasons else ""


def heads_here(study: str, heads: Sequence[Scalar]) -> list[str]:
    """Those of a study's heads that can be filmed here.

    Raises
    ------
    EvalkitError
        If none can, or no tracker can run.
    """
    names = [str(head) for head in heads]
    here = [name for name in names if not missing_head(name)]
    if not trackers_here():
        raise EvalkitError(f"{study}: no tracker can run here:{left_out().partition(':')[2]}")
    if not here:
        raise EvalkitError(f"{study}: head {names[0]} cannot be filmed here: {missing_head(names[0])}")
    return here


@dataclass(frozen=True, eq=False)
class Tracked:
    """Poses of every frame: rotations (F, 3, 3) and translations (F, 3), mm, NaN where lost, and the status (F,)."""

    rotations: Array
    translations: Array
    status: NDArray[np.int8]


def track(build: Callable[[], HeadTracker], data: FilmedHead) -> Tracked:
    """A tracker over a filmed head."""
    tracker = build()
    poses = [tracker.start(data.frames[0], data.truth.camera, data.truth.clicked_px)]
    poses += [tracker.step(frame) for frame in data.frames[1:]]
    return Tracked(
        np.stack([pose.rotation for pose in poses]),
        np.stack([pose.translation for pose in poses]),
        np.array([pose.status for pose in poses], dtype=np.int8),
    )


def since_first(rotations: Array) -> Array:
    """Turns (F, 3, 3) since the first frame, in the camera's axes."""
    return np.asarray(rotations @ rotations[0].T)


POSE_COLUMNS = {
    **{
        f"{axis}_deg": f"error in {axis} of the turn since the first frame, mean over frames with face and pose, deg"
        for axis in AXES
    },
    "mean_deg": "mean of the three, deg",
    "centred_yaw_deg": "error in yaw as above less its median: without what the first frame alone has put in, deg",
    "aligned_deg": "rms angle between estimated and true rotation after the one constant turn that fits best, deg",
    "worst_deg": "largest angle between estimated and true turn since the first frame, deg",
    "late_deg": "mean of that angle over the last third of the video: what has gathered by then, deg",
    "posed": "share of the frames with a face that have a pose",
    "weak": "share of the frames with a face whose pose is called weak",
    "false": "share of the frames without a face for which a pose is called tracked; empty where there is none",
    "recovery_frames": f"frames from the end of the disturbance to a pose within {NEAR_DEG:g} deg; empty without one, "
    "the frames that were left where the head was not found again",
}
"""Columns of :func:`score_pose`."""


def score_pose(data: FilmedHead, result: Tracked) -> dict[str, Any]:
    """Errors of a tracker's poses against the truth.

    Raises
    ------
    EvalkitError
        If the tracker has no pose in the first frame, or in none after it.
    """
    truth = data.truth
    if not np.isfinite(result.rotations[0]).all():
        raise EvalkitError("the tracker has no pose of the first frame")
    turned, true = since_first(result.rotations), since_first(truth.rotations)
    with_pose = np.isfinite(result.rotations).all(axis=(1, 2)) & truth.present
    # The first frame's error is zero by definition.
    judged = np.flatnonzero(with_pose)[1:]
    if not len(judged):
        raise EvalkitError("the tracker has no pose after the first frame")
    errors = _turn_errors_deg(turned, true)[judged]
    by_axis = np.abs(errors).mean(axis=0)
    angle = np.full(len(turned), np.nan)
    angle[judged] = np.degrees(rotation_angle(turned[judged] @ true[judged].transpose(0, 2, 1)))
    late = judged[judged >= 2 * len(turned) // 3]
    away = ~truth.present
    return {
        **{f"{axis}_deg": float(value) for axis, value in zip(AXES, by_axis, strict=True)},
        "mean_deg": float(by_axis.mean()),
        "centred_yaw_deg": float(np.abs(errors[:, 1] - np.median(errors[:, 1])).mean()),
        "aligned_deg": rms(rotation_error_deg(result.rotations, truth.rotations, with_pose)[with_pose]),
        "worst_deg": float(angle[judged].max()),
        "late_deg": float(angle[late].mean()) if len(late) else None,
        "posed": float(with_pose.sum() / truth.present.sum()),
        "weak": float(((result.status == TrackStatus.WEAK) & truth.present).sum() / truth.present.sum()),
        "false": float((result.status[away] == TrackStatus.TRACKED).mean()) if away.any() else None,
        "recovery_frames": _recovery(data, angle),
    }


def score_turn(data: FilmedHead, rotations: Array) -> dict[str, float]:
    """Mean error of pitch, yaw and roll of the turn since the first frame, over the frames with a pose, deg."""
    errors = np.abs(_turn_errors_deg(since_first(rotations), since_first(data.truth.rotations)))[1:]
    return {f"{axis}_deg": float(value) for axis, value in zip(AXES, np.nanmean(errors, axis=0), strict=True)}


def _turn_errors_deg(turned: Array, true: Array) -> Array:
    apart = head_angles_deg(turned) - head_angles_deg(true)
    return np.asarray((apart + 180.0) % 360.0 - 180.0)


def _recovery(data: FilmedHead, angle: Array) -> int | None:
    """Frames from the end of the disturbance until the pose is near the truth."""
    disturbed = np.flatnonzero((data.truth.covered > 0.0) | ~data.truth.present)
    if not len(disturbed):
        return None
    after = angle[disturbed[-1] + 1 :]
    near = np.flatnonzero(after <= NEAR_DEG)
    return int(near[0]) if len(near) else len(after)


POSE_STATISTICS: tuple[Statistic, ...] = (
    mean("yaw_deg", "yaw", "deg"),
    mean("pitch_deg", "pitch", "deg"),
    mean("roll_deg", "roll", "deg"),
    mean("mean_deg", "mean of the axes", "deg"),
    mean("centred_yaw_deg", "yaw less its median", "deg"),
    mean("aligned_deg", "after alignment", "deg"),
    largest("worst_deg", "worst frame", "deg"),
    mean("late_deg", "last third", "deg"),
    mean("posed", "frames posed", "", less=False),
    mean("false", "posed without a face", ""),
    largest("recovery_frames", "recovery", "frames"),
)
"""What is made of them in every study."""


def over(method: str) -> Statistic:
    """Yaw error over that of another method on the same videos."""
    return relative_to("yaw_deg", method, f"yaw over {method}'s")
