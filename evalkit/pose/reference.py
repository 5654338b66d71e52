"""The rigid shape that poses are measured against: one frame of the take, or the mean or median over all frames."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import EvalkitError
from evalkit.geometry import Array, undo_motion
from evalkit.pose.model import COLLINEAR_RATIO, Pose, PoseEstimator, whole_markers
from evalkit.pose.qcp import qcp

MAX_ROUNDS = 50
TOLERANCE = 1e-10
SUBSET = 2000
"""Frames that the shape is taken from."""

Reference = int | str


def reference_pose(
    estimator: PoseEstimator,
    points: ArrayLike,
    reference: Reference = "mean",
    weights: ArrayLike | None = None,
    labels: Sequence[str] | None = None,
) -> Pose:
    """Pose of every frame against a reference shape.

    Parameters
    ----------
    estimator : PoseEstimator
    points : array_like, shape (F, M, 3), mm
        The rigid markers, NaN where missing.
    reference : "mean", "median" or int
        ``int`` is the paper's way: the shape and pose of that frame, its noise included. ``"mean"`` and
        ``"median"`` take the shape from all frames and place it in the pose of one complete frame.
    weights : array_like, shape (M,) or (F, M), optional
    labels : sequence of str, optional
        Names used in messages.

    Raises
    ------
    EvalkitError
        If no frame can serve, or the frame asked for is outside the take or lacks a marker.
    """
    x = whole_markers(points)
    return estimator(reference_shape(x, reference, weights, labels), x, weights)


def reference_shape(
    points: Array, reference: Reference, weights: ArrayLike | None = None, labels: Sequence[str] | None = None
) -> Array:
    """Template (M, 3), mm, in world axes; parameters and errors as :func:`reference_pose`.

    At most :data:`SUBSET` frames are used unless a marker is seen in others only. The mean is the fixed point of
    generalised Procrustes analysis without scale: align every frame to the template, average, repeat (Gower,
    Psychometrika 40 (1975), doi:10.1007/BF02291478).
    """
    check_reference(reference, len(points))
    names = list(labels) if labels is not None else [f"marker {k}" for k in range(points.shape[1])]
    visible = np.asarray(np.isfinite(points).all(axis=2))
    never = [names[k] for k in np.flatnonzero(~visible.any(axis=0))]
    if never:
        raise EvalkitError(f"marker {', '.join(never)} is missing in every frame; choose other rigid markers")
    if not isinstance(reference, str):
        return _frame_shape(points, int(reference), visible, names)
    anchor = _anchor(points, visible, names)
    template = points[anchor]
    extent = np.sqrt(np.nanmax(((template - np.nanmean(template, axis=0)) ** 2).sum(axis=1)))
    # Frames spread over the take: a shape from that many has a hundredth of one frame's variance or less.
    some = np.unique(np.linspace(0, len(points) - 1, min(len(points), SUBSET)).astype(int))
    given = None if weights is None else np.asarray(weights, dtype=np.float64)
    for frames in (some, slice(None)):
        x = points[frames]
        w = given[frames] if given is not None and given.ndim == 2 else given
        for _ in range(MAX_ROUNDS):
            shape = _round(template, x, w, reference)
            change = np.abs(shape - template).max()  # NaN while a marker enters for the first time
            stuck = np.array_equal(np.isnan(shape), np.isnan(template))
            template = shape
            if change <= TOLERANCE * extent or (np.isnan(change) and stuck):
                break
        if np.isfinite(template).all():
            break
    lost = [names[k] for k in np.flatnonzero(~np.isfinite(template).all(axis=1))]
    if lost:
        raise EvalkitError(
            f"marker {', '.join(lost)} is never seen together with three other rigid markers; leave it out"
        )
    at = qcp(template, points[anchor : anchor + 1], weights if weights is None or np.ndim(weights) < 2 else None)
    return template @ at.rotations[0].T + at.translations[0]


def check_reference(reference: Reference, frames: int) -> None:
    """EvalkitError unless the reference is "mean", "median" or the number of one of so many frames."""
    if isinstance(reference, str) and reference in ("mean", "median"):
        return
    if isinstance(reference, bool) or not isinstance(reference, Integral):
        raise EvalkitError(f"reference '{reference}' is not known; use mean, median or a frame number")
    if not 0 <= reference < frames:
        raise EvalkitError(f"reference frame {reference} is outside the take; it has frames 0 to {frames - 1}")


def _round(template: Array, points: Array, weights: ArrayLike | None, reference: str) -> Array:
    """Align every frame to the template and average: one round of generalised Procrustes analysis."""
    pose = qcp(template, points, weights)
    still = undo_motion(pose.rotations, pose.translations, points)
    shape = np.full_like(template, np.nan)
    if reference == "median":
        seen = np.isfinite(still[:, :, 0]).any(axis=0)
        shape[seen] = np.nanmedian(still[:, seen], axis=0)
        return shape
    there = np.isfinite(still[:, :, 0])
    count = there.sum(axis=0)
    total = still.sum(axis=0) if there.all() else np.where(there[:, :, None], still, 0.0).sum(axis=0)
    shape[count > 0] = total[count > 0] / count[count > 0, None]
    return shape


def _frame_shape(points: Array, frame: int, visible: np.ndarray, names: list[str]) -> Array:
    hidden = [names[k] for k in np.flatnonzero(~visible[frame])]
    if hidden:
        raise EvalkitError(f"reference frame {frame} lacks {', '.join(hidden)}; choose another frame, or mean")
    return points[frame]


def _anchor(points: Array, visible: np.ndarray, names: list[str]) -> int:
    """A frame with as many rigid markers as any, not in one line: the one in the middle of such frames."""
    count = visible.sum(axis=1)
    if count.max(initial=0) < 3:
        raise EvalkitError(
            f"no frame shows three of the rigid markers {', '.join(names)} at once; choose other rigid markers"
        )
    fullest = np.flatnonzero(count == count.max())
    some = fullest[np.linspace(0, len(fullest) - 1, min(len(fullest), 1001)).astype(int)]
    centred = np.nan_to_num(points[some] - np.nanmean(points[some], axis=1, keepdims=True))
    spread = np.linalg.eigvalsh(centred.transpose(0, 2, 1) @ centred)
    solid = spread[:, 1] > COLLINEAR_RATIO**2 * spread[:, 2]
    if not solid.any():
        raise EvalkitError(
            f"rigid markers {', '.join(names)} stand in one line; rotation about it cannot be seen: add one beside it"
        )
    kept = some[solid]
    return int(kept[len(kept) // 2])
