"""The performer's face at rest, found in the take itself."""

from __future__ import annotations

import warnings

import numpy as np

from evalkit.geometry import Array

CLOSED_SHARE = 0.2
"""Part of the frames, those with the least open mouth, among which the rest is looked for. Their middle is the tenth
percentile of the opening: neither the half-open mouth of talk nor lips pressed together."""

FEWEST_FRAMES = 10
"""Taken at least, so that the noise of a marker is averaged down to a third."""


def rest_pose(points: Array, lips: tuple[int, int] | None) -> tuple[Array, int]:
    """Position of every marker at rest, and the frame that is most like it.

    Of the frames with the least distance between the lips, the quarter nearest to their common median is taken; the
    rest is each marker's median over these frames. A smile or a raised brow with the mouth closed is out of it as
    long as it fills less than half of them.

    Parameters
    ----------
    points : ndarray, shape (F, n, 3), mm
        Head motion removed, NaN where missing; every marker is seen in some frame.
    lips : (int, int), optional
        Columns of an upper and a lower lip marker. Without, all frames count as closed.

    Returns
    -------
    rest : ndarray, shape (n, 3), mm
    frame : int
    """
    some = np.arange(len(points))
    if lips is not None:
        opening = np.linalg.norm(points[:, lips[0]] - points[:, lips[1]], axis=1)
        seen = np.flatnonzero(np.isfinite(opening))
        if seen.size:
            count = max(round(CLOSED_SHARE * len(seen)), min(FEWEST_FRAMES, len(seen)))
            some = np.sort(seen[np.argsort(opening[seen], kind="stable")[:count]])
    with warnings.catch_warnings():
        # A marker or frame without anything seen has no median; NaN says so and is dealt with below.
        warnings.simplefilter("ignore", RuntimeWarning)
        middle = np.nanmedian(points[some], axis=0)
        unlike = np.nanmean(np.linalg.norm(points[some] - middle, axis=2), axis=1)
        # A frame that shows few markers would look alike by what it does not show.
        unlike = unlike / np.maximum(np.isfinite(points[some, :, 0]).mean(axis=1), 1e-9)
        unlike = np.where(np.isfinite(unlike), unlike, np.inf)
        order = np.argsort(unlike, kind="stable")
        nearest = some[order[: max(len(some) // 4, min(FEWEST_FRAMES, len(some)))]]
        rest = np.nanmedian(points[nearest], axis=0)
        for wider in (points[some], points):
            rest = np.where(np.isfinite(rest), rest, np.nanmedian(wider, axis=0))
    return rest, int(some[order[0]])
