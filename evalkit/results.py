"""The files that a compensated take leaves behind."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import platform
import shutil
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from evalkit import __version__
from evalkit.capture import write_capture
from evalkit.compensation import Compensation
from evalkit.errors import EvalkitError, FrameStatus
from evalkit.geometry import blocks, quaternion_from_rotation, rotation_angle
from evalkit.leak import AXES, Leak
from evalkit.pivot.model import TRACE_COLUMNS

MOTION_COLUMNS = (
    "frame", "time_s", "qw", "qx", "qy", "qz", "tx_mm", "ty_mm", "tz_mm",
    "sway_x_mm", "sway_y_mm", "sway_z_mm", "residual_mm", "status",
)  # fmt: skip
"""Columns of motion.csv: frame from 0, unit quaternion of R, T and s, residual of the rigid markers (rms)."""


@contextlib.contextmanager
def staged(directory: Path) -> Iterator[Path]:
    """A folder to write into whose files appear in ``directory`` together, or not at all.

    Raises
    ------
    EvalkitError
        If the folder cannot be made or written.
    """
    made: list[Path] = []
    stage: Path | None = None
    try:
        for parent in [*reversed(directory.parents), directory]:
            if not parent.exists():
                parent.mkdir()
                made.append(parent)
        stage = Path(tempfile.mkdtemp(prefix=".evalkit-", dir=directory))
        yield stage
        for file in sorted(stage.iterdir()):
            file.replace(directory / file.name)
        made.clear()
    except OSError as error:
        reason = error.strerror or str(error)
        raise EvalkitError(f"{directory}: cannot write there ({reason}); choose another output folder") from error
    finally:
        if stage is not None:
            shutil.rmtree(stage, ignore_errors=True)
        for folder in reversed(made):
            with contextlib.suppress(OSError):
                folder.rmdir()


def check_output(directory: Path) -> None:
    """Refuse an output folder that cannot be written, before any work is done.

    Raises
    ------
    EvalkitError
        If the path is a file, or the nearest existing folder cannot be written.
    """
    existing = next(p for p in [directory, *directory.parents] if p.exists() or p == p.parent)
    if not existing.is_dir():
        raise EvalkitError(f"{existing}: is a file, not a folder; choose another output folder")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise EvalkitError(f"{existing}: no permission to write there; choose another output folder")


def write_motion(result: Compensation, path: Path) -> None:
    """Head motion per frame as CSV with the columns :data:`MOTION_COLUMNS`; empty cells where unknown."""
    quaternions = quaternion_from_rotation(_orthogonal(result.rotations))
    digits = [6, *[9] * 4, *[4] * 7]  # microseconds, 1e-9 of a turn, 0.1 micrometre
    texts = np.array([FrameStatus(code).text for code in range(len(FrameStatus))], dtype=bytes)
    with path.open("wb") as file:
        file.write((",".join(MOTION_COLUMNS) + "\n").encode())
        for rows in blocks(len(quaternions), 50_000):
            frame = np.arange(rows.start, rows.stop, dtype=np.float64)
            own = (quaternions[rows], result.translations[rows], result.sway[rows], result.frame_residual[rows])
            numbers = np.column_stack([frame / result.capture.rate, *own])
            cells = [_decimal(frame, 0)]
            cells += [_decimal(column, d) for column, d in zip(numbers.T, digits, strict=True)]
            cells.append(_letters(texts[result.frame_status[rows]]))
            file.write(_joined(cells))


def _letters(texts: np.ndarray) -> np.ndarray:
    """Byte strings as a matrix of letters, zero where a string is shorter."""
    return np.ascontiguousarray(texts).view(np.uint8).reshape(len(texts), -1)


def _decimal(values: np.ndarray, digits: int) -> np.ndarray:
    """Numbers with fixed decimals as a matrix of letters, zero where there is none; NaN is an empty cell.

    Digit by digit over the whole column: several times faster than formatting the numbers one by one.
    """
    known = np.isfinite(values)
    size = np.abs(np.where(known, values, 0.0)) * 10.0**digits
    if size.max(initial=0.0) > 1e15:
        return _letters(np.where(known, np.char.mod(f"%.{digits}f", values), "").astype(bytes))
    rest = np.rint(size).astype(np.int64)
    places = max(len(str(int(rest.max(initial=0)))), digits + 1)
    letters = np.zeros((len(values), places + 2), dtype=np.uint8)
    letters[:, 0] = np.where((values < 0) & (rest > 0), ord("-"), 0)
    point = places - digits + 1
    letters[:, point] = ord(".") if digits else 0
    for place in range(places):
        column = places - place + (place < digits)
        quotient = rest // 10
        letters[:, column] = rest - 10 * quotient + ord("0")
        if place > digits:
            letters[rest == 0, column] = 0
        rest = quotient
    letters[~known] = 0
    return letters


def _joined(cells: list[np.ndarray]) -> bytes:
    """Rows of comma-separated cells, the gaps between their letters closed."""
    comma = np.full((len(cells[0]), 1), ord(","), dtype=np.uint8)
    parts = [part for cell in cells for part in (cell, comma)]
    block = np.concatenate([*parts[:-1], np.full_like(comma, ord("\n"))], axis=1)
    return block[block != 0].tobytes()


def _orthogonal(rotations: np.ndarray) -> np.ndarray:
    """Rotations a quaternion can hold; the paper's raw matrix is projected for this file only."""
    from evalkit.geometry import nearest_rotation

    first = rotations[np.flatnonzero(np.isfinite(rotations[:, 0, 0]))[:50]]
    raw = not np.allclose(first @ first.transpose(0, 2, 1), np.eye(3), atol=1e-9)
    return nearest_rotation(rotations) if raw else rotations


def summary(
    result: Compensation,
    source: Path | None = None,
    sha256: str | None = None,
    errors: dict[str, float] | None = None,
    leak: Leak | None = None,
) -> dict[str, Any]:
    """What a machine may want to know of a compensated take; infinite and unknown numbers become None.

    Parameters
    ----------
    result : Compensation
    source : Path, optional
        The capture file.
    sha256 : str, optional
        Its checksum.
    errors : dict, optional
        Measures against truth.
    leak : Leak, optional
        How much of the head motion the face's own motion explains.
    """
    ok = result.frame_status == FrameStatus.OK
    counts = np.bincount(result.frame_status, minlength=len(FrameStatus))
    angles = np.degrees(rotation_angle(result.rotations[ok]))
    estimate = result.estimate
    content = {
        "evalkit": __version__,
        "input": {
            "file": source.name if source else None,
            "sha256": sha256,
            "frames": result.capture.frames,
            "markers": len(result.capture.labels),
            "rate_hz": result.capture.rate,
            "unit": result.capture.unit,
        },
        "method": {
            "pose": result.pose_method,
            "pivot": result.pivot_method,
            "reference": result.reference,
            "sway": result.sway_mode,
            "sway_used": result.sway_used,
            "local_origin_mm": result.origin.tolist(),
            "smoothing": _smoothing(result),
        },
        "pivot": {
            "status": result.status,
            "message": estimate.message,
            "position_mm": result.pivot.tolist(),
            "covariance_mm2": result.pivot_covariance.tolist(),
            "principal_axes": estimate.principal_axes.tolist(),
            "principal_std_mm": estimate.principal_std.tolist(),
            "turn_rms_deg": estimate.turn_deg.tolist(),
            "evaluations": estimate.evaluations,
        },
        "frames": {FrameStatus(k).text: int(counts[k]) for k in range(len(counts))},
        "head": {
            "rotation_rms_deg": float(np.sqrt(np.mean(angles**2))),
            "rotation_max_deg": float(angles.max()),
            "sway_rms_mm": float(np.sqrt(np.mean((result.sway[ok] ** 2).sum(axis=1)))),
        },
        "rigid": {
            "labels": result.rigid,
            "automatic": result.chosen.automatic,
            "reason": result.chosen.reason,
            "weights": dict(zip(result.rigid, result.chosen.weights.tolist(), strict=True)),
            "residual_rms_mm": dict(zip(result.rigid, result.marker_residual.tolist(), strict=True)),
        },
        "expression_leak": None if leak is None else _leak(leak),
        "outer_iterations": result.outer,
        "errors_against_truth": errors,
        "warnings": result.warnings,
        "versions": {"python": platform.python_version(), "numpy": np.__version__},
    }
    return _plain(content)


def _smoothing(result: Compensation) -> dict[str, Any] | None:
    done = result.smoothing
    if done is None:
        return None
    return {
        "acceleration_deg_s2": done.acceleration_deg_s2,
        "effective_freedom": done.freedom,
        "predicted_rotation_error_deg": {"measured": done.measured_deg, "smoothed": done.smoothed_deg},
    }


def _leak(leak: Leak) -> dict[str, Any]:
    return {
        "status": leak.status,
        "message": leak.message,
        "score": leak.score,
        "r2": leak.r2,
        "baseline_mean": leak.baseline_mean,
        "baseline_95": leak.baseline_95,
        "p_value": leak.p_value,
        "axis_share": dict(zip(AXES, leak.axis_share.tolist(), strict=True)),
        "axis_size_deg_mm": dict(zip(AXES, leak.axis_size.tolist(), strict=True)),
        "markers": leak.markers,
    }


def write_json(content: Any, path: Path) -> None:
    """JSON of the strict kind, with a newline at the end."""
    path.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def write_trace(result: Compensation, path: Path) -> None:
    """Every iteration of a pivot search as CSV."""
    np.savetxt(path, result.estimate.trace, "%.9g", ",", header=",".join(TRACE_COLUMNS), comments="")


def write_results(
    result: Compensation,
    directory: Path,
    source: Path | None = None,
    errors: dict[str, float] | None = None,
    leak: Leak | None = None,
) -> dict[str, Any]:
    """Write compensated.c3d, motion.csv and summary.json (and trace.csv of a search) into a folder.

    Returns
    -------
    dict
        The summary.

    Raises
    ------
    EvalkitError
        If a file cannot be written.
    """
    with ThreadPoolExecutor(2) as pool:
        # Hashing and writing wait for memory and disk; the table of motion is formatted meanwhile.
        notes = pool.submit(write_capture, result.capture, directory / "compensated.c3d")
        digest = pool.submit(file_sha256, source) if source is not None else None
        write_motion(result, directory / "motion.csv")
    content = summary(result, source, digest.result() if digest else None, errors, leak)
    content["warnings"] += notes.result()
    if len(result.estimate.trace):
        write_trace(result, directory / "trace.csv")
    write_json(content, directory / "summary.json")
    return content


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
