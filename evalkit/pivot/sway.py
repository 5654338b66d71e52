"""Smooth motion of the pivot itself: a cubic B-spline over time."""

from __future__ import annotations

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array


def smooth_sway(path: Array, ok: np.ndarray, rate: float, knot_seconds: float) -> Array:
    """Least-squares cubic B-spline through the pivot's displacement, shape (F, 3), mm.

    Parameters
    ----------
    path : ndarray, shape (F, 3), mm
        Displacement of the pivot per frame, NaN where unknown.
    ok : ndarray of bool, shape (F,)
        Frames to fit; the spline bridges the others.
    rate : float
        Hz.
    knot_seconds : float
        Distance of the knots. A light penalty on second differences decides where no frame is known.

    Raises
    ------
    EvalkitError
        If the spacing is not positive or shorter than two frames.

    References
    ----------
    Eilers & Marx, "Flexible smoothing with B-splines and penalties", Statistical Science 11 (1996),
    doi:10.1214/ss/1038425655.
    """
    from scipy.interpolate import BSpline
    from scipy.linalg import solveh_banded

    frames = len(path)
    if not (np.isfinite(knot_seconds) and knot_seconds * rate >= 2):
        raise EvalkitError(f"sway knots {knot_seconds} s apart are shorter than two frames at {rate:g} Hz")
    spans = max(round((frames - 1) / (knot_seconds * rate)), 1)
    step = max((frames - 1) / spans, 1e-9)
    knots = (np.arange(-3, spans + 4)) * step
    basis = BSpline.design_matrix(np.clip(np.arange(frames), 0.0, spans * step), knots, 3, extrapolate=True)
    used = basis[np.flatnonzero(ok)]
    normal = (used.T @ used).toarray() if spans < 8 else (used.T @ used)
    size = basis.shape[1]
    bands = np.zeros((4, size))
    for k in range(4):
        bands[k, : size - k] = normal.diagonal(k)
    # Second differences 1 -2 1: their normal matrix has these bands inside, and small ends.
    second = np.zeros((4, size))
    for row in range(size - 2):
        for a, ca in enumerate((1.0, -2.0, 1.0)):
            for b, cb in enumerate((1.0, -2.0, 1.0)):
                if b >= a:
                    second[b - a, row + a] += ca * cb
    weight = 1e-6 * max(float(bands[0].max()), 1.0)
    bands += weight * second
    bands[0] += 1e-12 * float(bands[0].max())
    right = used.T @ np.where(ok[:, None], path, 0.0)[ok]
    return basis @ solveh_banded(bands, right, lower=True)
