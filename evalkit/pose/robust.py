"""Rotation that a few displaced or swapped markers cannot pull away."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import FrameStatus
from evalkit.geometry import Array
from evalkit.pose.model import Pose, moments
from evalkit.pose.qcp import qcp
from evalkit.pose.svd import svd

CUTOFF = 4.0
"""Residual length, in units of the noise per axis, at which a marker's weight has fallen to a quarter."""

ANNEAL = 1.4
"""Factor by which the graduation of non-convexity tightens from one pass to the next."""


def robust(template: ArrayLike, points: ArrayLike, weights: ArrayLike | None = None) -> Pose:
    """Iteratively re-weighted pose with the Geman-McClure loss, graduated from convex to robust.

    Each pass solves ``svd`` with weights ``w (mu c^2 / (r^2 + mu c^2))^2``, r the residual length and c the
    cutoff in units of the take's own noise (median of the residuals); mu falls from a value at which every
    marker counts to one. Frames with three visible markers are left at least squares: nothing would contradict
    an outlier there. Only frames whose residuals stand out are iterated.

    Parameters
    ----------
    template : array_like, shape (M, 3), mm
    points : array_like, shape (F, M, 3), mm, NaN where missing
    weights : array_like, shape (M,) or (F, M), optional
        Relative inverse variances; the robust weights multiply them.

    Raises
    ------
    EvalkitError
        If shapes or weights do not fit.

    References
    ----------
    Geman & McClure (1987); Yang et al., "Graduated non-convexity for robust spatial perception",
    IEEE RA-L 5 (2020), doi:10.1109/LRA.2020.2965893.
    """
    first = svd(template, points, weights)
    x = np.asarray(points, dtype=np.float64)
    used = np.broadcast_to(first.weights, x.shape[:2])
    seen = (used > 0) & first.ok[:, None]
    square = _squares(first, x)
    if not seen.any():
        return first
    noise = _noise(square, seen)
    cutoff = CUTOFF * noise
    suspects = first.ok & (seen.sum(axis=1) > 3) & (np.where(seen, square, 0.0).max(axis=1) > cutoff**2)
    if not suspects.any():
        return first
    rows = np.flatnonzero(suspects)
    base, xs, rs = used[rows], x[rows], np.where(seen[rows], square[rows], 0.0)
    mu = max(2.0 * float(rs.max()) / cutoff**2, 1.0)
    pose = first
    while True:
        factor = (mu * cutoff**2 / (rs + mu * cutoff**2)) ** 2
        pose = qcp(template, xs, base * factor)
        rs = np.where(seen[rows], _squares(pose, xs), 0.0)
        if mu == 1.0:
            break
        mu = max(mu / ANNEAL, 1.0)
    final = base * (cutoff**2 / (rs + cutoff**2)) ** 2
    pose = svd(template, xs, final)
    # Three markers that agree must remain, and not in one line; otherwise the outliers are the majority.
    relied = moments(template, xs, np.where(final > 0.05 * base.max(axis=1, keepdims=True), 1.0, 0.0)).status
    rotations, translations, status = first.rotations.copy(), first.translations.copy(), first.status.copy()
    weights_out = np.array(used, dtype=np.float64)
    good = relied == FrameStatus.OK
    rotations[rows] = np.where(good[:, None, None], pose.rotations, np.nan)
    translations[rows] = np.where(good[:, None], pose.translations, np.nan)
    status[rows] = np.where(good, FrameStatus.OK, FrameStatus.NOT_CONVERGED)
    weights_out[rows] = np.where(good[:, None], final, 0.0)
    return Pose(rotations, translations, status, first.template, weights_out)


def _squares(pose: Pose, points: Array) -> Array:
    residual = pose.residuals(points)
    return np.einsum("fmi,fmi->fm", residual, residual)


def _noise(square: Array, seen: np.ndarray) -> float:
    """Noise per axis from the median squared residual, corrected for what six pose parameters absorb."""
    count = seen.sum(axis=1)
    share = np.maximum(3.0 * count - 6.0, 1.0) / np.maximum(3.0 * count, 1.0)
    scaled = (square / share[:, None])[seen]
    # 2.366 is the median of chi-square with three degrees of freedom.
    noise = float(np.sqrt(np.median(scaled) / 2.366))
    extent = float(np.sqrt(np.nanmax(square[seen], initial=0.0)))
    return max(noise, 1e-9 * extent, 1e-9)
