"""Markers that were not seen for a while: short gaps are bridged, long ones held or bridged and marked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation, Slerp

from evalkit.geometry import Array, nearest_rotation

SHORT_GAP_S = 0.1
"""Gaps up to this are bridged in a straight line: at 10 mm per syllable of a quarter second, a few millimetres at
most are invented. Also the time in which a held marker goes over to where it is seen again."""

SPIKE_S = 0.12
SPIKE_MM = 8.0
"""A displacement that is further than this from its median over so long a time is no skin: a closing lid, the
quickest thing on a face, differs by half of its 8 mm."""

MODES = ("hold", "interpolate")


@dataclass(frozen=True, eq=False)
class Filled:
    """Values without gaps.

    Attributes
    ----------
    values : ndarray, shape (F, n, k)
    short, long : ndarray of bool, shape (F, n)
        Where a value stands for a missing one, in short and in long gaps.
    """

    values: Array
    short: np.ndarray
    long: np.ndarray


def fill_gaps(values: Array, rate_hz: float, mode: str = "hold") -> Filled:
    """Replace missing values over time.

    Parameters
    ----------
    values : ndarray, shape (F, n, k)
        NaN where missing; every one of the n must be seen at least once.
    rate_hz : float
    mode : {"hold", "interpolate"}
        What happens in gaps longer than `SHORT_GAP_S`: the last value is held and goes over to the next one within
        `SHORT_GAP_S` before it is seen again, or the gap is bridged in a straight line. Before the first and
        after the last value either holds.
    """
    out = values.copy()
    missing = np.asarray(~np.isfinite(values).all(axis=2))
    short = np.zeros_like(missing)
    at = np.arange(len(values), dtype=np.float64)
    for k in np.flatnonzero(missing.any(axis=0)):
        knots, source, long = _knots(~missing[:, k], rate_hz, mode)
        short[:, k] = missing[:, k] & ~long
        for axis in range(values.shape[2]):
            out[missing[:, k], k, axis] = np.interp(at[missing[:, k]], knots, values[source, k, axis])
    return Filled(out, short, missing & ~short)


def spikes(values: Array, rate_hz: float) -> np.ndarray:
    """Where (F, n) a displacement (F, n, 3), mm, without gaps, is a spike of a few frames: an outlier or a wrong label.

    Takes so slow that `SPIKE_S` is less than two frames show a quick motion in one frame alone, and have none.
    """
    window = 2 * round(0.5 * SPIKE_S * rate_hz) + 1
    if window < 3:
        return np.zeros(values.shape[:2], dtype=bool)
    median = median_filter(values, size=(window, 1, 1), mode="nearest")
    return np.asarray(np.linalg.norm(values - median, axis=2) > SPIKE_MM)


def fill_rotations(rotations: Array, rate_hz: float, mode: str = "hold") -> Array:
    """The same for rotations (F, 3, 3), along the shortest turn."""
    known = np.asarray(np.isfinite(rotations).all(axis=(1, 2)))
    if known.all():
        return rotations
    knots, source, _ = _knots(known, rate_hz, mode)
    turns = Rotation.from_matrix(nearest_rotation(rotations[source]))
    at = np.clip(np.arange(len(rotations)), knots[0], knots[-1])
    # Slerp needs two knots; a take with one known pose keeps it.
    filled = Slerp(knots, turns)(at).as_matrix() if len(knots) > 1 else np.repeat(turns.as_matrix(), len(at), axis=0)
    return np.where(known[:, None, None], rotations, filled)


def _knots(seen: np.ndarray, rate_hz: float, mode: str) -> tuple[Array, np.ndarray, np.ndarray]:
    """Frames between which to interpolate, the frame that each takes its value from, and which are in long gaps."""
    frames = np.flatnonzero(seen)
    width = max(round(SHORT_GAP_S * rate_hz), 1)
    bounds = np.concatenate([[-1], frames, [len(seen)]])
    lengths = np.diff(bounds) - 1
    long = np.zeros(len(seen), dtype=bool)
    for start, length in zip(bounds[:-1][lengths > width], lengths[lengths > width], strict=True):
        long[start + 1 : start + 1 + length] = True
    if mode == "interpolate":
        return frames.astype(np.float64), frames, long
    before = frames[:-1][np.diff(frames) - 1 > width]
    after = frames[1:][np.diff(frames) - 1 > width]
    knots = np.concatenate([frames, after - width])
    source = np.concatenate([frames, before])
    order = np.argsort(knots, kind="stable")
    return knots[order].astype(np.float64), source[order], long
