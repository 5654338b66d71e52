"""Peak memory of one way to compensate a capture, measured in a process of its own: the tests start this as a script.

``python tests/peak_memory.py take.c3d joint`` prints one line of JSON: the peak of the resident memory above what the
process held after its imports, in MB and in multiples of the take's positions, and the time.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import evalkit

RIGID = ["ForeheadC", "ForeheadL", "ForeheadR"]
WAYS = {
    "joint": {"rigid": RIGID},
    "joint-smooth": {"rigid": RIGID, "smooth": True},
    "score": {"rigid": RIGID, "pivot": "score"},
    "svd": {"rigid": RIGID, "pivot": "svd"},
    "auto": {},
    "auto-smooth": {"smooth": True},
}
COMMANDS = {
    "command": [],
    "command-named": ["--rigid", ",".join(RIGID)],
    "command-score": ["--rigid", ",".join(RIGID), "--pivot", "score"],
    "command-smooth": ["--smooth"],
}


def long_capture(path: Path, frames: int, gaps: float = 0.0) -> None:
    """A C3D file of any length: a talking head there and back again, with noise, and samples lost, of its own."""
    take, _ = evalkit.synthesize("talking", seed=1, sway=10.0, frames=min(frames, 6000))
    random = np.random.default_rng(1)
    there_and_back = np.concatenate([take.points, take.points[::-1]])
    points = np.empty((frames, *take.points.shape[1:]))
    for start in range(0, frames, len(there_and_back)):
        part = points[start : start + len(there_and_back)]
        part[:] = there_and_back[: len(part)] + 0.1 * random.standard_normal(part.shape)
        part[random.random(part.shape[:2]) < gaps] = np.nan
    evalkit.write_capture(evalkit.Capture(points, take.labels, take.rate), path)


def resident_mb(field: str) -> float:
    """VmRSS or VmHWM, its peak, of this process; getrusage would count what the parent held, too."""
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return int(status[field].split()[0]) * 1024 / 1e6


def run(way: str, path: Path) -> tuple[int, int]:
    """Do the work; number of positions and of frames with a pose."""
    if way in COMMANDS:
        from evalkit.cli import main

        with tempfile.TemporaryDirectory(dir=path.parent) as out:
            sys.argv = ["evalkit", "compensate", str(path), "-o", out, "--no-report", *COMMANDS[way]]
            with contextlib.redirect_stdout(sys.stderr), contextlib.suppress(SystemExit):
                main()
            summary = json.loads((Path(out) / "summary.json").read_text())
        return summary["input"]["frames"] * summary["input"]["markers"], summary["frames"]["ok"]
    hoard = way.startswith("hoard-")
    take = evalkit.read_capture(path)
    result = evalkit.compensate(take, **WAYS[way.removeprefix("hoard-")])
    if hoard:
        copies = [take.points + k for k in range(4)]
        assert len(copies) == 4
    return take.points.shape[0] * take.points.shape[1], int((result.frame_status == 0).sum())


if __name__ == "__main__":
    for name in ("evalkit.compensation", "evalkit.results", "evalkit.cli.compensate", "scipy.linalg", "scipy.optimize"):
        importlib.import_module(name)
    before, start = resident_mb("VmRSS"), time.perf_counter()
    positions, ok = run(sys.argv[2], Path(sys.argv[1]))
    seconds = time.perf_counter() - start
    peak, size = resident_mb("VmHWM") - before, positions * 24 / 1e6
    found = {"peak_mb": peak, "positions_mb": size, "multiple": peak / size, "seconds": seconds, "ok": ok}
    print(json.dumps(found))
