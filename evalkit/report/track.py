"""The folder of a tracked video: tables of pose, points and parameters, and what a machine may want to know."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from evalkit import __version__
from evalkit.geometry import Array, quaternion_from_rotation
from evalkit.report.measures import runs
from evalkit.results import write_json
from evalkit.vision.angles import head_angles_deg
from evalkit.vision.parameters import NAMES, PARAMETERS, SMALLEST_LENGTH, neutral_parameters, normalise
from evalkit.vision.points import FACE_POINTS
from evalkit.vision.track import Track
from evalkit.vision.tracker import TrackStatus
from evalkit.vision.video import PICTURES, Video

if TYPE_CHECKING:
    import pandas as pd

POSE_COLUMNS = (
    "frame", "time_s", "status", "confidence", "qw", "qx", "qy", "qz", "pitch_deg", "yaw_deg", "roll_deg",
    "tx_mm", "ty_mm", "tz_mm",
)  # fmt: skip
"""Of pose.csv: frame of the video from 0; unit quaternion and angles of R, and T (:mod:`evalkit.vision.tracker`)."""

FILES = (
    "pose.csv", "parameters.csv", "parameters_normalised.csv", "points.csv", "summary.json", "overlay.mp4",
    "report.html",
)  # fmt: skip
"""What may be written into the folder."""


@dataclass(frozen=True, eq=False)
class TrackedVideo:
    """A video and what was found in it.

    Attributes
    ----------
    video : Video
    track : Track
    start : int
        Frame of the video that is the track's first.
    points_px : ndarray, shape (19, 2)
        In that frame, where tracking began.
    points_from : str
        ``file``, ``eyes`` or ``detector``.
    depth : str
        See :class:`evalkit.vision.features.FeatureTracker`.
    warnings : list of str
    """

    video: Video
    track: Track
    start: int
    points_px: Array
    points_from: str
    depth: str
    warnings: list[str] = field(default_factory=list)

    @property
    def frames(self) -> NDArray[np.int_]:
        """Numbers of the frames in the video."""
        return self.start + np.arange(len(self.track.head.status))

    @property
    def times_s(self) -> Array:
        """Times since the beginning of the video."""
        return np.asarray(self.frames / self.video.rate_hz)


def neutral_of(tracked: TrackedVideo) -> tuple[Array, list[str]]:
    """Parameters of the face at rest (15,), and what they lack: a length near zero allows no ratio and is NaN."""
    # Nothing is known of the face where its pose is weak.
    sure = tracked.track.head.status == TrackStatus.TRACKED
    rows = np.where(sure[:, None], tracked.track.parameters, np.nan)
    neutral = neutral_parameters(rows)
    ratio = np.array([parameter.form == "ratio" for parameter in PARAMETERS])
    small = ratio & (np.abs(neutral) < SMALLEST_LENGTH)
    notes = [
        f"{NAMES[k]} is {neutral[k]:.3f} eye distances at rest, too small for a ratio; its normalised column is empty"
        for k in np.flatnonzero(small)
    ]
    notes += [f"{NAMES[k]} was measured in no frame" for k in np.flatnonzero(np.isnan(neutral))]
    return np.where(small, np.nan, neutral), notes


def normalised_parameters(tracked: TrackedVideo) -> Array:
    """Parameters (F, 15) against the face at rest: lengths as their ratio less 1, the others as the difference."""
    return normalise(tracked.track.parameters, neutral_of(tracked)[0])


def write_tables(tracked: TrackedVideo, folder: Path) -> None:
    """Write pose.csv, parameters.csv, parameters_normalised.csv and points.csv; empty cells where nothing is known."""
    track, head = tracked.track, tracked.track.head
    pose = [quaternion_from_rotation(head.rotations), head_angles_deg(head.rotations), head.translations]
    names = np.array([status.text for status in TrackStatus])[head.status]
    _write(folder / "pose.csv", _table(tracked, POSE_COLUMNS[4:], np.hstack(pose), names, head.confidence))
    _write(folder / "parameters.csv", _table(tracked, NAMES, track.parameters))
    _write(folder / "parameters_normalised.csv", _table(tracked, NAMES, normalised_parameters(tracked)))
    _write(folder / "points.csv", _points(tracked))


def _table(
    tracked: TrackedVideo, names: Sequence[str], values: Array, status: Any = None, confidence: Any = None
) -> pd.DataFrame:
    import pandas as pd

    found = pd.DataFrame(np.round(values, 6), columns=list(names))
    if status is not None:
        found.insert(0, "status", status)
        found.insert(1, "confidence", np.round(confidence, 3))
    found.insert(0, "frame", tracked.frames)
    found.insert(1, "time_s", np.round(tracked.times_s, 6))
    return found


def _points(tracked: TrackedVideo) -> pd.DataFrame:
    """A row for each frame and point."""
    import pandas as pd

    track, count = tracked.track, len(FACE_POINTS)
    numbers = np.concatenate([track.points_px, track.frontal_mm], axis=2).reshape(-1, 4)
    found = pd.DataFrame(np.round(numbers, 3), columns=["x_px", "y_px", "x_mm", "y_mm"])
    found.insert(0, "frame", np.repeat(tracked.frames, count))
    found.insert(1, "point", list(FACE_POINTS) * len(tracked.frames))
    found["confidence"] = np.round(track.confidence.ravel(), 3)
    return found


def _write(path: Path, table: pd.DataFrame) -> None:
    table.to_csv(path, index=False, lineterminator="\n")


def summary(tracked: TrackedVideo) -> dict[str, Any]:
    """What a machine may want to know; a number that is not known is None."""
    head, camera = tracked.track.head, tracked.track.head.camera
    neutral, notes = neutral_of(tracked)
    lost = runs(head.status == TrackStatus.LOST)
    view = 2 * np.degrees(np.arctan(0.5 * max(camera.width, camera.height) / camera.focal_px))
    return {
        "evalkit": __version__,
        "input": {
            "file": Path(str(tracked.video.source)).name, "sha256": checksum(tracked.video.source),
            "width": camera.width, "height": camera.height, "rate_hz": tracked.video.rate_hz,
            "first_frame": tracked.start, "frames": len(head.status),
        },
        "method": {"pose": head.method, "depth": tracked.depth},
        "camera": {
            "view_deg": round(float(view), 3), "focal_px": camera.focal_px, "centre_px": list(camera.centre_px),
            "assumed": camera.assumed,
        },
        "points": {
            "from": tracked.points_from,
            "places_px": dict(zip(FACE_POINTS, np.round(tracked.points_px, 3).tolist(), strict=True)),
        },
        "frames": {status.text: int((head.status == status).sum()) for status in TrackStatus},
        "lost": [[tracked.start + first, tracked.start + end - 1] for first, end in lost],
        "parameters_known": float(np.isfinite(tracked.track.parameters).mean()),
        "eye_distance_mm": tracked.track.unit_mm,
        "neutral": {
            name: float(value) if np.isfinite(value) else None for name, value in zip(NAMES, neutral, strict=True)
        },
        "warnings": [*tracked.warnings, *notes],
        "versions": {
            "python": platform.python_version(), "numpy": np.__version__, "scipy": scipy.__version__,
            "opencv": cv2.__version__,
        },
    }  # fmt: skip


def checksum(source: Path | int) -> str | None:
    """SHA-256 of a file, or of the pictures of a folder one after the other in the order of their names."""
    if isinstance(source, int):
        return None
    files = [source]
    if source.is_dir():
        files = sorted(path for path in source.iterdir() if path.suffix.lower() in PICTURES)
    digest = hashlib.sha256()
    for path in files:
        with path.open("rb") as file:
            while part := file.read(1 << 20):
                digest.update(part)
    return digest.hexdigest()


def write_summary(content: dict[str, Any], folder: Path) -> None:
    """Write summary.json."""
    write_json(content, folder / "summary.json")
