"""Time and memory over the length of a take.

Question: do time and memory grow with the frames, and no faster?

Finding: both are linear up to a million frames of 23 markers (4.6 hours at 60 Hz). From 100,000 to a million frames the
time of a whole compensation grows 7-fold (slope 0.85: what does not depend on the length is still felt), that of the
joint pivot 6-fold (0.80), that of the pose 10-fold (1.00); of the algebraic pivots, a tenth of the rest, ``score`` has
a slope of 0.98 and ``svd`` had 1.48 in this one run. At a million frames, on one core of a machine that had other work,
a whole compensation took 73 µs a frame (joint pivot 49, pose 22, algebraic pivots 3 to 6) and 3.0 times the memory of
the take's positions beside the take itself, the joint pivot 2.5 times, the pose 0.9 times. Weighting all markers
automatically is an order of magnitude dearer: 950 µs a frame and 5.8 times the memory at 100,000 frames, where what it
learns from a thousand frames no longer counts. Below 100,000 frames the memory found is a lower limit, since what
making the take had freed serves first. Times of a few milliseconds have slopes that scatter by tenths.

Command: ``evalkit study run scaling --budget full``
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from evalkit.capture import Capture
from evalkit.compensation import compensate
from evalkit.errors import EvalkitError
from evalkit.pivot import pivot_estimators
from evalkit.pose import Pose, pose_estimators, reference_pose
from evalkit.seeds import generator
from evalkit.studies.takes import told
from evalkit.study.command import script
from evalkit.study.description import Budget, Study
from evalkit.study.statistics import median
from evalkit.synthetic import synthesize

BASE_FRAMES = 6000
"""Frames that are made; longer takes go through them there and back again, with noise of their own."""

WARM_FRAMES = 300
PATIENCE_S = 2.0
"""Time within which a measurement is repeated."""

LONGEST_AUTO = 100_000
"""Frames beyond which the automatic weighting, a millisecond a frame, is not waited for."""

CHILD = """
import json, sys
from evalkit.studies.scaling import measure
print(json.dumps(measure(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])))
"""
"""What the measuring process runs."""


def long_take(frames: int, seed: int) -> tuple[Capture, list[int]]:
    """A talking head of any length with 23 markers, and the columns of the rigid ones."""
    take, truth = synthesize("talking", seed=seed, frames=min(frames, BASE_FRAMES))
    random = generator("scaling", "noise", seed=seed)
    there_and_back = np.concatenate([take.points, take.points[::-1]])
    points = np.empty((frames, *take.points.shape[1:]))
    for start in range(0, frames, len(there_and_back)):
        part = points[start : start + len(there_and_back)]
        part[:] = there_and_back[: len(part)] + 0.1 * random.standard_normal(part.shape)
    return Capture(points, take.labels, take.rate), take.indices(truth.rigid)


def _pose(take: Capture, columns: list[int]) -> Pose:
    return reference_pose(pose_estimators["svd"], take.points[:, columns])


def _pivot(name: str) -> Callable[[Capture, list[int]], Callable[[], object]]:
    def prepared(take: Capture, columns: list[int]) -> Callable[[], object]:
        points, pose = take.points[:, columns], _pose(take, columns)
        return lambda: pivot_estimators[name](points, pose, rate=take.rate)

    return prepared


WORK: dict[str, Callable[[Capture, list[int]], Callable[[], object]]] = {
    "pose svd": lambda take, columns: lambda: _pose(take, columns),
    "pivot svd": _pivot("svd"),
    "pivot score": _pivot("score"),
    "pivot joint": _pivot("joint"),
    "compensate": lambda take, columns: lambda: compensate(take, [take.labels[k] for k in columns]),
    "compensate auto": lambda take, columns: lambda: compensate(take),
}
"""Method -> from a take to the work that is measured, everything before it done."""


def memory_mb(field: str) -> float:
    """VmRSS or VmHWM, its peak, of this process; getrusage would count what the parent held, too.

    Raises
    ------
    EvalkitError
        If the system does not tell.
    """
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError as error:
        raise EvalkitError("scaling: memory is read from /proc, which this system does not have; use Linux") from error
    status = dict(line.split(":", 1) for line in lines if ":" in line)
    return int(status[field].split()[0]) * 1024 / 1e6


def measure(frames: int, seed: int, method: str) -> dict[str, float]:
    """Time and peak memory of one method on one take, in this process, which should do nothing else.

    Before it comes the same work on a short take, so that neither loading libraries nor their first call counts, and
    on a tenth of the frames, to compare with.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        WORK[method](*long_take(WARM_FRAMES, seed))()
        tenth = _best_seconds(WORK[method](*long_take(frames // 10, seed)))
        take, columns = long_take(frames, seed)
        work = WORK[method](take, columns)
        # Forgets the peak so far (proc(5)): making the take has one of its own.
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
        before = memory_mb("VmRSS")
        start = time.perf_counter()
        work()
        first = time.perf_counter() - start
        peak = memory_mb("VmHWM") - before
        whole = first if first > PATIENCE_S else min(first, _best_seconds(work))
    return {
        "us_per_frame": 1e6 * whole / frames,
        "slope": float(np.log10(whole / tenth)),
        "peak_mb": peak,
        "multiple": peak / (take.points.nbytes / 1e6),
    }


def _best_seconds(work: Callable[[], object]) -> float:
    """Shortest of up to five runs that fit into the patience: other work on the machine only ever adds."""
    best, spent = np.inf, 0.0
    for _ in range(5):
        start = time.perf_counter()
        work()
        seconds = time.perf_counter() - start
        best, spent = min(best, seconds), spent + seconds
        if spent + seconds > PATIENCE_S:
            break
    return float(best)


def prepare(seed: int, frames: int) -> tuple[int, int]:
    """Nothing but what to measure: every measurement makes its own take in a process of its own."""
    return frames, seed


def run(data: tuple[int, int], method: str) -> dict[str, float]:
    """Measure in a fresh process.

    Raises
    ------
    EvalkitError
        If the process fails, with its last words.
    """
    frames, seed = data
    done = subprocess.run(
        [sys.executable, "-c", CHILD, str(frames), str(seed), method], capture_output=True, text=True, check=False
    )
    if done.returncode:
        words = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise EvalkitError(f"{method}, {frames} frames: the measuring process failed: {words[-1]}")
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def score(data: tuple[int, int], found: dict[str, float]) -> dict[str, Any]:
    """What was measured."""
    return found


QUESTION, FINDING = told(__doc__)

study = Study(
    name="scaling",
    question=QUESTION,
    finding=FINDING,
    axes={"frames": (1_000, 10_000, 100_000, 1_000_000)},
    methods=tuple(WORK),
    prepare=prepare,
    run=run,
    score=score,
    columns={},
    machine={
        "us_per_frame": "time for a frame, best of up to five runs, microseconds",
        "slope": "log10 of the time over that of a tenth of the frames in the same process; 1 is linear",
        "peak_mb": "peak of the resident memory above what the process held with the take loaded, MB",
        "multiple": "the same in multiples of the take's positions, 23 x 3 x 8 bytes a frame",
    },
    statistics=(
        median("us_per_frame", "time a frame", "µs"),
        median("slope", "slope", ""),
        median("peak_mb", "peak", "MB"),
        median("multiple", "peak over take", ""),
    ),
    full=Budget(seeds=1),
    small=Budget(seeds=1, axes={"frames": (3_000, 30_000)}, methods=("pose svd", "pivot svd", "pivot joint")),
    applies=lambda condition, method: method != "compensate auto" or int(condition["frames"]) <= LONGEST_AUTO,
    serial=True,
)

if __name__ == "__main__":
    script(study)
