"""What a pose estimator gets and gives, and the sums that all of them share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import EvalkitError, FrameStatus
from evalkit.geometry import Array, apply_motion, blocks

COLLINEAR_RATIO = 0.01
"""Markers whose spread across their common line is below this part of the spread along it count as collinear:
the error of the angle about that line is then a hundred times that about the others."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Head pose of every frame: ``x = R P + T`` for a template P.

    Attributes
    ----------
    rotations : ndarray, shape (F, 3, 3)
    translations : ndarray, shape (F, 3), mm
    status : ndarray of int8, shape (F,)
        :class:`~evalkit.errors.FrameStatus` of each frame; rotation and translation are NaN unless OK.
    template : ndarray, shape (M, 3), mm
        The rigid shape that was fitted.
    weights : ndarray, shape (F, M) or (M,)
        Weight of each marker in the fit, zero where it was not used.
    """

    rotations: Array
    translations: Array
    status: np.ndarray
    template: Array
    weights: Array

    @property
    def ok(self) -> np.ndarray:
        """Frames whose pose is known, shape (F,) bool."""
        return np.asarray(self.status == FrameStatus.OK)

    @property
    def known(self) -> slice | np.ndarray:
        """Index of the frames whose pose is known: a slice that copies nothing if that is all of them."""
        ok = self.ok
        return slice(None) if ok.all() else ok

    def residuals(self, points: ArrayLike) -> Array:
        """Observed minus fitted positions of the rigid markers, mm, shape (F, M, 3), NaN where unknown."""
        return np.asarray(points, dtype=np.float64) - apply_motion(self.rotations, self.translations, self.template)


@dataclass(frozen=True)
class PoseEstimator:
    """One entry of the table of pose estimators; call it as ``estimator(template, points, weights=None)``.

    Attributes
    ----------
    function : callable
        ``(template (M, 3), points (F, M, 3), weights None | (M,) | (F, M)) -> Pose``.
    summary, source : str
        One line on the method, and the paper it comes from.
    markers : int or None
        The only number of markers that the method takes, or None for any number from three.
    orthogonal : bool
        Whether the result is a rotation; the paper's own is not under noise.
    origin : str
        Name and version of the package it comes from, empty for evalkit's own.
    peer : bool
        Whether another package's method is called for comparison: such entries answer as that package does.
    """

    function: Callable[..., Pose]
    summary: str
    source: str
    markers: int | None = None
    orthogonal: bool = True
    origin: str = ""
    peer: bool = False

    def __call__(self, template: ArrayLike, points: ArrayLike, weights: ArrayLike | None = None) -> Pose:
        """Estimate the pose of every frame."""
        return self.function(template, points, weights)


@dataclass(frozen=True, eq=False)
class Moments:
    """Weighted sums of one set of correspondences per frame, what every least-squares pose is made of.

    Attributes
    ----------
    cross : ndarray, shape (F, 3, 3)
        ``sum_m w (x - xbar)(P - Pbar)'``; the identity in frames that are not OK.
    point_mean, template_mean : ndarray, shape (F, 3), mm
    square : ndarray, shape (F,)
        ``sum_m w (|x - xbar|^2 + |P - Pbar|^2)``.
    status, template, weights
        As in :class:`Pose`.
    """

    cross: Array
    point_mean: Array
    template_mean: Array
    square: Array
    status: np.ndarray
    template: Array
    weights: Array

    def pose(self, rotations: Array) -> Pose:
        """The pose with these rotations and the translation that is best for them, ``T = xbar - R Pbar``."""
        ok = self.status == FrameStatus.OK
        r = np.where(ok[:, None, None], rotations, np.nan)
        t = self.point_mean - np.einsum("fij,fj->fi", r, self.template_mean)
        return Pose(r, t, self.status, self.template, self.weights)


def check(template: ArrayLike, points: ArrayLike) -> tuple[Array, Array]:
    """Template (M, 3) and points (F, M, 3) as arrays, or an EvalkitError that says which shape is wrong."""
    shape = np.asarray(template, dtype=np.float64)
    observed = np.asarray(points, dtype=np.float64)
    if shape.ndim != 2 or shape.shape[1] != 3:
        raise EvalkitError(f"template has shape {shape.shape}; expected (markers, 3)")
    if observed.ndim != 3 or observed.shape[1:] != shape.shape:
        raise EvalkitError(f"points have shape {observed.shape}; expected (frames, {len(shape)}, 3)")
    if len(shape) < 3:
        raise EvalkitError(f"{len(shape)} rigid markers; a rotation needs at least three that are not in one line")
    return shape, observed


def whole_markers(points: ArrayLike) -> Array:
    """Positions (F, M, 3); a marker with any coordinate that is not finite is missing: all three NaN."""
    given = whole = np.asarray(points, dtype=np.float64)
    for part in blocks(len(given)):
        x = given[part]
        partly = ~np.isfinite(x).all(axis=-1) & ~np.isnan(x).all(axis=-1)
        if partly.any():
            whole = given.copy() if whole is given else whole
            whole[part][partly] = np.nan
    return whole


def moments(template: ArrayLike, points: ArrayLike, weights: ArrayLike | None = None) -> Moments:
    """Weighted means and cross products of template and points per frame, with what is visible.

    Parameters
    ----------
    template : array_like, shape (M, 3), mm
    points : array_like, shape (F, M, 3), mm, NaN where missing
    weights : array_like, shape (M,) or (F, M), optional
        Relative inverse variances, not negative.

    Raises
    ------
    EvalkitError
        If shapes do not fit or a weight is negative or not finite.
    """
    shape, observed = check(template, points)
    count = len(shape)
    given = np.ones(count) if weights is None else np.asarray(weights, dtype=np.float64)
    if given.shape not in ((count,), (len(observed), count)):
        raise EvalkitError(f"weights have shape {given.shape}; expected ({count},) or ({len(observed)}, {count})")
    if not (np.isfinite(given).all() and (given >= 0).all()):
        raise EvalkitError("a weight is negative or not finite; weights are inverse variances")
    known = np.asarray(np.isfinite(shape).all(axis=1))
    with np.errstate(invalid="ignore"):  # two infinities of opposite sign
        visible = np.isfinite(observed[:, :, 0] + observed[:, :, 1] + observed[:, :, 2]) & known
    solid = np.nan_to_num(shape, nan=0.0, posinf=0.0, neginf=0.0)
    everything = visible.all() and given.ndim == 1
    used = given if everything else visible * given
    seen = np.broadcast_to(given > 0, visible.shape) if everything else used > 0
    status = _status(solid, seen, len(observed))
    # The centred points sum to zero, so any fixed origin of the template serves; a near one keeps the digits.
    origin = solid.sum(axis=0, where=known[:, None]) / max(known.sum(), 1)
    local = solid - origin
    cross = np.empty((len(observed), 3, 3))
    point_mean, template_mean = np.empty((2, len(observed), 3))
    square = np.empty(len(observed))
    for part in blocks(len(observed)):
        w = given[None, :] if everything else used[part]
        x = observed[part] if everything else np.where(visible[part, :, None], observed[part], 0.0)
        total = np.maximum(w.sum(axis=1), 1e-300)[:, None]
        point_mean[part] = (w[:, None, :] @ x)[:, 0] / total
        template_mean[part] = w @ solid / total
        centred = x - point_mean[part, None, :]
        weighted = centred if (w == 1).all() else centred * w[:, :, None]
        cross[part] = weighted.transpose(0, 2, 1) @ local
        second = weighted.transpose(0, 2, 1) @ centred
        # Which markers count, not how much: weights that are small but not zero must not change the status.
        spans = second if ((w == 0) | (w == 1)).all() else _second_moment(x, seen[part])
        status[part][(status[part] == FrameStatus.OK) & _in_one_line(spans)] = FrameStatus.COLLINEAR
        spread = w @ (local**2).sum(axis=1) - total[:, 0] * ((template_mean[part] - origin) ** 2).sum(axis=1)
        square[part] = second[:, 0, 0] + second[:, 1, 1] + second[:, 2, 2] + spread
    lost = status != FrameStatus.OK
    cross[lost] = np.eye(3)
    point_mean[lost] = np.nan
    return Moments(cross, point_mean, template_mean, square, status, shape, used)


def _second_moment(points: Array, seen: np.ndarray) -> Array:
    """Second moments (F, 3, 3) of the markers that are seen, about their mean, all with the same weight."""
    part = seen[:, :, None]
    count = np.maximum(part.sum(axis=1, keepdims=True), 1)
    centred = points - points.sum(axis=1, where=part, keepdims=True) / count
    return np.asarray(np.where(part, centred, 0.0).transpose(0, 2, 1) @ centred)


def _in_one_line(second: Array) -> np.ndarray:
    """Frames (F,) whose observed markers stand in one line or at one place, whatever the template says.

    With eigenvalues a >= b >= c of the second moment, half of (trace^2 - sum of squares) is ab + ac + bc:
    near a line about ab, to be compared with the same part of a^2 as in the template.
    """
    trace = second[:, 0, 0] + second[:, 1, 1] + second[:, 2, 2]
    products = 0.5 * (trace**2 - (second.reshape(-1, 9) ** 2).sum(axis=1))
    return np.asarray(products <= COLLINEAR_RATIO**2 * trace**2)


def _status(template: Array, seen: np.ndarray, frames: int) -> np.ndarray:
    """Status of every frame from which markers are seen: enough of them, and not in one line."""
    status = np.full(frames, FrameStatus.OK, dtype=np.int8)
    few = seen.sum(axis=1) < 3
    status[few] = FrameStatus.TOO_FEW_MARKERS
    if seen.all():
        masks, which = seen[:1], np.zeros(frames, dtype=int)
    else:
        patterns, which = np.unique(np.packbits(seen, axis=1), axis=0, return_inverse=True)
        masks = np.unpackbits(patterns, axis=1, count=seen.shape[1]).astype(bool)
    n = np.maximum(masks.sum(axis=1), 1)[:, None]
    centred = np.where(masks[:, :, None], template - ((masks @ template) / n)[:, None, :], 0.0)
    spread = np.linalg.eigvalsh(centred.transpose(0, 2, 1) @ centred)
    line = spread[:, 1] <= COLLINEAR_RATIO**2 * spread[:, 2]
    status[line[np.ravel(which)] & ~few] = FrameStatus.COLLINEAR
    return status
