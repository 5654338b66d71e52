"""Time of a frame, by stage, at 360 x 288 pixels on one core.

Question: how many frames a second does each tracker take in, and where does the time go?

Finding: the whole of the default tracker, decoding, pose with the learnt relief, points and parameters, goes at 71
frames a second on one core (two of a shared x86 server, one in use), key frames included: 0.4, 7.7, 5.7 and 0.3 ms. The
aim of 60 is met, with 18 % to spare. The pose alone takes 7.3 ms, 1.8 times as long as optical flow with PnP (4.1 ms);
the cylinder 10.6 ms, the relief of the mean face 14.2, MediaPipe's network 20.1. One video of 120 frames, one round.

Command: ``evalkit study run tracker-speed --budget full --seeds 1 --axis disturbed=nothing``, the weights of
MediaPipe's detector named in ``EVALKIT_LANDMARKER``
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from evalkit.errors import EvalkitError
from evalkit.studies.filmed import FilmedHead, VideoParameters, film
from evalkit.studies.picture_faults import write_h264
from evalkit.studies.takes import told
from evalkit.studies.tracked import TRACKERS, heads_here, left_out, trackers_here
from evalkit.study.command import script
from evalkit.study.description import Budget, Condition, Scalar, Study
from evalkit.study.statistics import median, relative_to
from evalkit.vision.parameters import control_parameters, eye_distance
from evalkit.vision.trackers import DEFAULT

ROUNDS = 3
"""Times that a video is gone through; the fastest counts, since other work on the machine only ever adds."""

WHOLE = f"{DEFAULT} + features"
"""The pose, the 19 points and the fifteen parameters: all of it."""


def conditions(axes: Mapping[str, tuple[Scalar, ...]]) -> Iterator[Condition]:
    """All combinations of the heads that are here."""
    for head in heads_here("tracker-speed", axes["head"]):
        for disturbed in axes["disturbed"]:
            for frames in axes["frames"]:
                yield {"head": head, "disturbed": disturbed, "frames": frames}


def prepare(seed: int, head: str, disturbed: str, frames: int) -> FilmedHead:
    """The video of a cell; a face that is away must be looked for."""
    given: dict[str, Any] = {"away": 0.4} if disturbed == "face away" else {}
    return film(VideoParameters(head=head, frames=frames, **given), seed)


def run(data: FilmedHead, method: str) -> dict[str, float | None]:
    """Times of the stages in the fastest of some rounds, microseconds a frame."""
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with tempfile.TemporaryDirectory(prefix="evalkit-speed-") as folder:
            path = Path(folder) / "video.mp4"
            write_h264(list(data.frames[..., ::-1]), path, data.truth.rate_hz, data.parameters.crf)
            rounds = [_round(data, path, method) for _ in range(ROUNDS)]
    finally:
        cv2.setNumThreads(before)
    return min(rounds, key=lambda times: times["us_per_frame"])


def _round(data: FilmedHead, path: Path, method: str) -> dict[str, Any]:
    from evalkit.vision.features import FeatureTracker
    from evalkit.vision.video import read_video

    truth, spent = data.truth, dict.fromkeys(("read", "pose", "features", "parameters"), 0.0)

    def timed(stage: str, work: Callable[..., Any], *given: Any) -> Any:
        start = time.perf_counter()
        found = work(*given)
        spent[stage] += time.perf_counter() - start
        return found

    frames = iter(read_video(path))
    tracker = TRACKERS[DEFAULT if method == WHOLE else method]()
    features = FeatureTracker(truth.camera) if method == WHOLE else None
    first = next(frames)
    pose = tracker.start(first, truth.camera, truth.clicked_px)
    unit = 1.0
    if features is not None:
        unit = float(eye_distance(features.start(first, pose, truth.clicked_px)[0]))
    count = 0
    while (frame := timed("read", next, frames, None)) is not None:
        count += 1
        pose = timed("pose", tracker.step, frame)
        if features is not None:
            points = timed("features", features.step, frame, pose)[0]
            timed("parameters", control_parameters, points[None], unit)
    if not count:
        raise EvalkitError("the video has one frame only")
    micro = {stage: 1e6 * seconds / count for stage, seconds in spent.items()}
    whole = sum(micro.values())
    asked = ("read", "pose", "features", "parameters") if features is not None else ("read", "pose")
    return {
        "frames_per_second": 1e6 / whole,
        "us_per_frame": whole,
        **{f"{stage}_us": micro[stage] if stage in asked else None for stage in micro},
    }


def score(data: FilmedHead, found: dict[str, float | None]) -> dict[str, Any]:
    """What was measured."""
    return found


QUESTION, FINDING = told(__doc__)

study = Study(
    name="tracker-speed",
    question=QUESTION,
    finding=FINDING + left_out(),
    axes={"head": ("photo",), "disturbed": ("nothing", "face away"), "frames": (120,)},
    methods=(*trackers_here(), WHOLE) if DEFAULT in trackers_here() else trackers_here(),
    prepare=prepare,
    run=run,
    score=score,
    columns={},
    machine={
        "frames_per_second": "frames of 360 x 288 a second, decoding included, one core",
        "us_per_frame": "time for a frame, fastest round, microseconds",
        "read_us": "of it: decoding the video",
        "pose_us": "of it: the head's pose",
        "features_us": "of it: the 19 points; empty for a tracker of the pose alone",
        "parameters_us": "of it: the fifteen parameters",
    },
    statistics=(
        median("frames_per_second", "frames a second", "1/s", less=False),
        median("us_per_frame", "time a frame", "µs"),
        median("read_us", "reading", "µs"),
        median("pose_us", "pose", "µs"),
        median("features_us", "features", "µs"),
        median("parameters_us", "parameters", "µs"),
        relative_to("pose_us", "pyrlk", "pose over pyrlk's"),
    ),
    full=Budget(seeds=3),
    small=Budget(seeds=1, axes={"head": ("template-small",), "disturbed": ("nothing",), "frames": (20,)}),
    conditions=conditions,
    serial=True,
)

if __name__ == "__main__":
    script(study)
