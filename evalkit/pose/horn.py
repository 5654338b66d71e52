"""Rotation as the principal eigenvector of Horn's quaternion matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evalkit.geometry import Array
from evalkit.pose.model import Pose, moments


def key_matrix(cross: Array) -> Array:
    """Horn's symmetric 4x4 matrix N of a cross-covariance ``H = sum w x P'``: ``q' N q = trace(R(q)' H)``.

    Parameters
    ----------
    cross : ndarray, shape (3, 3, F)

    Returns
    -------
    ndarray, shape (4, 4, F), for quaternions (w, x, y, z)
    """
    h = cross
    n = np.empty((4, 4, h.shape[2]))
    xx, yy, zz = h[0, 0], h[1, 1], h[2, 2]
    n[0, 0], n[1, 1] = xx + yy + zz, xx - yy - zz
    n[2, 2], n[3, 3] = -xx + yy - zz, -xx - yy + zz
    for i, j, value in (
        (0, 1, h[2, 1] - h[1, 2]), (0, 2, h[0, 2] - h[2, 0]), (0, 3, h[1, 0] - h[0, 1]),
        (1, 2, h[0, 1] + h[1, 0]), (1, 3, h[0, 2] + h[2, 0]), (2, 3, h[1, 2] + h[2, 1]),
    ):  # fmt: skip
        n[i, j] = n[j, i] = value
    return n


def rotation_from_quaternion(quaternions: Array) -> Array:
    """Rotation matrices of unit quaternions (w, x, y, z); shape (F, 4) to (F, 3, 3)."""
    w, x, y, z = quaternions.T
    r = np.empty((len(quaternions), 3, 3))
    r[:, 0, 0], r[:, 0, 1], r[:, 0, 2] = w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)
    r[:, 1, 0], r[:, 1, 1], r[:, 1, 2] = 2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)
    r[:, 2, 0], r[:, 2, 1], r[:, 2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z
    return r


def horn(template: ArrayLike, points: ArrayLike, weights: ArrayLike | None = None) -> Pose:
    """Weighted least-squares pose by unit quaternions: a second, independent route to the optimum of ``svd``.

    Parameters
    ----------
    template : array_like, shape (M, 3), mm
    points : array_like, shape (F, M, 3), mm, NaN where missing
    weights : array_like, shape (M,) or (F, M), optional

    Raises
    ------
    EvalkitError
        If shapes or weights do not fit.

    References
    ----------
    Horn, J. Opt. Soc. Am. A 4 (1987), doi:10.1364/JOSAA.4.000629.
    """
    sums = moments(template, points, weights)
    _, vectors = np.linalg.eigh(key_matrix(sums.cross.transpose(1, 2, 0)).transpose(2, 0, 1))
    return sums.pose(rotation_from_quaternion(vectors[:, :, 3]))
