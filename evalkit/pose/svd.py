"""Rotation by the singular value decomposition of the cross-covariance."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evalkit.geometry import det3
from evalkit.pose.model import Pose, moments


def svd(template: ArrayLike, points: ArrayLike, weights: ArrayLike | None = None) -> Pose:
    """Weighted least-squares pose: minimises ``sum_m w |x_m - R P_m - T|^2`` over rotations and translations.

    With ``H = sum w (x - xbar)(P - Pbar)' = U S V'`` the rotation is ``R = U diag(1, 1, det U V') V'``.

    Parameters
    ----------
    template : array_like, shape (M, 3), mm
    points : array_like, shape (F, M, 3), mm, NaN where missing
    weights : array_like, shape (M,) or (F, M), optional

    Raises
    ------
    EvalkitError
        If shapes or weights do not fit. Frames that cannot answer get a status instead.

    References
    ----------
    Kabsch, Acta Cryst. A32 (1976), doi:10.1107/S0567739476001873;
    Umeyama, IEEE PAMI 13 (1991), doi:10.1109/34.88573 (the sign of the determinant).
    """
    sums = moments(template, points, weights)
    left, _, right = np.linalg.svd(sums.cross)
    rotations = left @ right
    mirrored = det3(rotations.transpose(1, 2, 0)) < 0
    left[mirrored, :, 2] *= -1.0
    rotations[mirrored] = left[mirrored] @ right[mirrored]
    return sums.pose(rotations)
