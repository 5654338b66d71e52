"""Every method on one take: how a user without ground truth chooses for his own data."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from evalkit.capture import Capture
from evalkit.compensation import Compensation, compensate
from evalkit.errors import EvalkitError, FrameStatus
from evalkit.geometry import Array, apply_motion, undo_motion
from evalkit.metrics import expression_error_mm, pivot_error_mm, rms, rotation_error_deg
from evalkit.pivot import pivot_estimators
from evalkit.pose import pose_estimators, reference_pose

if TYPE_CHECKING:
    from evalkit.synthetic import Truth

MAX_FRAMES = 1000
"""Frames, spread evenly, that the methods are compared on."""

TRUTH_COLUMNS = ("pivot_error_mm", "rotation_error_deg", "expression_error_mm")

COLUMNS = (
    "kind", "method", "chosen", "status", "message", "frames", "frames_ok", "rigid_residual_mm", "held_out_mm",
    "pivot_x_mm", "pivot_y_mm", "pivot_z_mm", "pivot_std_mm", *TRUTH_COLUMNS, "seconds", "evaluations",
)  # fmt: skip
"""Keys of every row; numbers are NaN where a method has none, ``pivot_std_mm`` infinite where not observable."""

UNCOMPENSATED = "none (raw)"


def compare_methods(
    take: Capture,
    result: Compensation,
    *,
    pose: str | None = None,
    pivot: str | None = None,
    truth: Truth | None = None,
    progress: Callable[[int, int, str], None] | None = None,
    max_frames: int = MAX_FRAMES,
) -> list[dict[str, Any]]:
    """Every pose estimator with the chosen pivot, and every pivot estimator with the chosen pose, on this take.

    Rigid markers, reference, sway and local origin are those of the result; of markers that were weighted by
    their skin motion, which the other methods cannot do, those that tell most. The measure without truth is
    ``held_out_mm``: with at least four rigid markers each is left out in turn, the head pose is estimated from
    the others and undone, and the held-out marker's movement about its mean, which would be zero on a true
    skull, is pooled (rms). The row ``none (raw)`` has the same for the take as it is.

    Parameters
    ----------
    take : Capture
    result : Compensation
        Of this take.
    pose, pivot : str, optional
        The chosen ones; by default the result's.
    truth : Truth, optional
        Of a synthetic take; adds errors in :data:`TRUTH_COLUMNS`.
    progress : callable, optional
        ``progress(done, total, method)`` before each method.
    max_frames : int
        In longer takes this many frames, spread evenly, are used; a reference frame is always among them.

    Returns
    -------
    list of dict
        One row per method with the keys :data:`COLUMNS`. A method that cannot work on this take has a row
        with status ``not-applicable`` or ``failed`` and the reason as its message.
    """
    pose = result.pose_method if pose is None else pose
    pivot = result.pivot_method if pivot is None else pivot
    rigid, own = result.rigid, []
    if pose not in pose_estimators:
        # Markers weighted by their skin: the others, which cannot weight so, get those that tell most.
        rigid, own, pose = [result.rigid[k] for k in result.chosen.leading], [_weighted(take, result, truth)], "svd"
    some, reference = _some_frames(take.frames, max_frames, result.reference)
    # The rate of the thinned take keeps seconds what they are.
    rate = take.rate * max(len(some) - 1, 1) / max(take.frames - 1, 1)
    thin = Capture(take.points[some], take.labels, rate, axes=take.axes, quantities=take.quantities)
    options: dict[str, Any] = {
        "rigid": rigid,
        "reference": reference,
        "sway": result.sway_mode,
        "origin": result.origin,
        "prior": False,
    }
    # Peers are for studies: some go through the frames one by one, and they are not evalkit's to recommend.
    pairs = [("pose", name, name, pivot) for name, entry in pose_estimators.items() if not entry.peer]
    pairs += [("pivot", name, pose, name) for name, entry in pivot_estimators.items() if not entry.peer]
    held_out: dict[tuple[str, str], float] = {}
    rows = [_raw(thin, result, some, truth), *own]
    for done, (kind, name, with_pose, with_pivot) in enumerate(pairs):
        if progress is not None:
            progress(done, len(pairs), name)
        row = _empty(kind, name, len(some)) | {
            "chosen": name == (pose if kind == "pose" else pivot) and not (own and kind == "pose")
        }
        rows.append(row)
        wanted = pose_estimators[with_pose].markers
        if wanted is not None and wanted != len(rigid):
            row |= {
                "status": "not-applicable",
                "message": f"takes exactly {wanted} rigid markers; this take has {len(rigid)}",
            }
            continue
        start = time.perf_counter()
        try:
            # Poses are compared free; turned about a pivot they would all be the pivot estimator's own.
            sway = {"sway": "per-frame"} if kind == "pose" else {}
            got = compensate(thin, pose=with_pose, pivot=with_pivot, **options | sway)
        except Exception as error:  # a mistake in one method, perhaps not ours, must not cost the others' rows
            reason = str(error) if isinstance(error, EvalkitError) else f"{type(error).__name__}: {error}"
            row |= {"status": "failed", "message": reason, "seconds": time.perf_counter() - start}
            continue
        row["seconds"] = time.perf_counter() - start
        row |= _measured(thin, got)
        # With every frame's own translation the pivot cancels out of the undoing.
        key = (with_pose, "" if got.sway_used == "per-frame" else with_pivot)
        if key not in held_out:
            held_out[key] = held_out_rms(thin, with_pose, with_pivot, **options | {"sway": got.sway_used})
        row["held_out_mm"] = held_out[key]
        if truth is not None:
            row |= _errors(got, truth, some)
    return rows


def held_out_rms(take: Capture, pose: str, pivot: str, *, rigid: list[str], sway: str | float, **options: Any) -> float:
    """Movement about their mean of rigid markers that the head pose was estimated without, mm rms.

    Parameters
    ----------
    take : Capture
    pose, pivot, sway, **options
        As in :func:`evalkit.compensate`.
    rigid : list of str

    Returns
    -------
    float
        NaN with fewer than four rigid markers, or where the others cannot give a pose.
    """
    if len(rigid) < 4:
        return float("nan")
    columns = take.indices(rigid)
    moved = []
    for k, column in enumerate(columns):
        others = rigid[:k] + rigid[k + 1 :]
        try:
            if sway == "per-frame":
                points = take.points[:, columns[:k] + columns[k + 1 :]]
                posed = reference_pose(pose_estimators[pose], points, options["reference"], labels=others)
                still = undo_motion(posed.rotations, posed.translations, take.points[:, [column]])[:, 0]
            else:
                got = compensate(take, others, pose=pose, pivot=pivot, sway=sway, **options)
                still = got.capture.points[:, column]
        except EvalkitError:
            return float("nan")
        moved.append(movement(still))
    return rms(np.concatenate(moved))


def movement(points: Array) -> Array:
    """Distance of a marker (F, 3) from its mean place in every frame where it is known, mm."""
    seen = points[np.isfinite(points).all(axis=1)]
    return np.linalg.norm(seen - seen.mean(axis=0), axis=1) if len(seen) else np.empty(0)


def _some_frames(frames: int, most: int, reference: str | int) -> tuple[np.ndarray, str | int]:
    """Evenly spread frames, and the reference as it is numbered among them."""
    some = np.unique(np.linspace(0, frames - 1, min(frames, most)).astype(int))
    if isinstance(reference, str):
        return some, reference
    some = np.unique(np.append(some, reference))
    return some, int(np.searchsorted(some, reference))


def _empty(kind: str, method: str, frames: int) -> dict[str, Any]:
    row: dict[str, Any] = dict.fromkeys(COLUMNS, float("nan"))
    return row | {
        "kind": kind, "method": method, "chosen": False, "status": "", "message": "", "frames": frames,
        "frames_ok": 0, "evaluations": 0,
    }  # fmt: skip


def _raw(thin: Capture, result: Compensation, some: np.ndarray, truth: Truth | None) -> dict[str, Any]:
    """The take as it is: what doing nothing scores in the frames that have a head pose."""
    ok = result.frame_status[some] == FrameStatus.OK
    row = _empty("none", UNCOMPENSATED, len(some)) | {"status": "ok", "frames_ok": int(ok.sum())}
    if len(result.rigid) >= 4:
        moved = [movement(thin.points[ok, column]) for column in result.chosen.columns]
        row["held_out_mm"] = rms(np.concatenate(moved))
    if truth is not None:
        row["expression_error_mm"] = rms(expression_error_mm(thin.points[ok], truth.clean[some][ok]))
    return row


def _weighted(take: Capture, result: Compensation, truth: Truth | None) -> dict[str, Any]:
    """The result itself, on all its frames, where no other method can be given its weights."""
    row = _empty("pose", result.pose_method, take.frames) | {"chosen": True} | _measured(take, result)
    return row | (_errors(result, truth, np.arange(take.frames)) if truth is not None else {})


def _measured(thin: Capture, got: Compensation) -> dict[str, Any]:
    points = thin.points[:, got.chosen.columns]
    residual = points - apply_motion(got.rotations, got.translations, got.template)
    return {
        "status": got.status,
        "message": got.estimate.message,
        "frames_ok": int((got.frame_status == FrameStatus.OK).sum()),
        "rigid_residual_mm": rms(np.linalg.norm(residual, axis=2)),
        "pivot_x_mm": float(got.pivot[0]),
        "pivot_y_mm": float(got.pivot[1]),
        "pivot_z_mm": float(got.pivot[2]),
        "pivot_std_mm": float(got.estimate.principal_std[0]),
        "evaluations": got.estimate.evaluations,
    }


def _errors(got: Compensation, truth: Truth, some: np.ndarray) -> dict[str, float]:
    ok = got.frame_status == FrameStatus.OK
    return {
        "pivot_error_mm": pivot_error_mm(got.pivot, got.sway, truth.pivot, truth.sway[some], ok),
        "rotation_error_deg": rms(rotation_error_deg(got.rotations, truth.rotations[some], ok)),
        "expression_error_mm": rms(expression_error_mm(got.capture.points, truth.clean[some])),
    }
