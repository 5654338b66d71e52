"""Rotation by the quaternion characteristic polynomial: the optimum of ``svd`` and ``horn`` without a decomposition."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import FrameStatus
from evalkit.geometry import Array, blocks, det3
from evalkit.pose.horn import key_matrix, rotation_from_quaternion
from evalkit.pose.model import Pose, moments

MAX_NEWTON = 60


def qcp(template: ArrayLike, points: ArrayLike, weights: ArrayLike | None = None) -> Pose:
    """Weighted least-squares pose; the largest eigenvalue of Horn's matrix by Newton, its vector from the adjugate.

    The characteristic polynomial of the traceless 4x4 matrix is ``l^4 + c2 l^2 + c1 l + c0`` with
    ``c2 = -2 |H|^2``, ``c1 = -8 det H`` and ``c0 = det N``. Newton starts at ``sum w (|x|^2 + |P|^2) / 2``,
    never below the largest root, and so decreases onto it. Everything is elementwise over the frames, which
    makes it the fastest of the estimators.

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
    Theobald, Acta Cryst. A61 (2005), doi:10.1107/S0108767305015266.
    """
    sums = moments(template, points, weights)
    square = np.where(sums.status == FrameStatus.OK, sums.square, 6.0)
    return sums.pose(best_rotations(sums.cross, square))


def best_rotations(cross: Array, square: Array) -> Array:
    """Rotations that maximise ``trace(R' H)`` for cross-covariances ``H = sum w x P'``.

    Parameters
    ----------
    cross : ndarray, shape (F, 3, 3)
    square : ndarray, shape (F,)
        ``sum w (|x|² + |P|²)``, twice an upper bound of the maximum.

    Returns
    -------
    ndarray, shape (F, 3, 3)
    """
    rotations = np.empty((len(cross), 3, 3))
    for part in blocks(len(cross)):
        rotations[part] = _best_rotations(cross[part], square[part])
    return rotations


def _best_rotations(cross: Array, square: Array) -> Array:
    # Scaled so that the root lies near one: the polynomial of a millimetre-sized face would reach 1e16.
    scale = np.maximum(square, 1e-300) / 2.0
    # Frames last: every step below is elementwise, and a component of all frames is then one run of memory.
    h = np.ascontiguousarray(cross.transpose(1, 2, 0)) / scale
    n = key_matrix(h)
    c2 = -2.0 * np.einsum("ijf,ijf->f", h, h)
    c1 = -8.0 * det3(h)
    low, high = _minors(n)
    c0 = low[0] * high[5] - low[1] * high[4] + low[2] * high[3] + low[3] * high[2] - low[4] * high[1] + low[5] * high[0]
    root = np.ones(len(cross))
    for _ in range(MAX_NEWTON):
        square = root * root
        slope = 4.0 * square * root + 2.0 * c2 * root + c1
        step = ((square + c2) * square + c1 * root + c0) / np.where(slope > 0, slope, np.inf)
        root = root - step
        if np.max(np.abs(step), initial=0.0) < 1e-15:
            break
    n[range(4), range(4)] -= root
    return rotation_from_quaternion(_largest_adjugate_column(n))


def _minors(a: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The six 2x2 minors of the upper and of the lower two rows, columns in the order 01 02 03 12 13 23."""
    pairs = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
    upper = [a[0, i] * a[1, j] - a[0, j] * a[1, i] for i, j in pairs]
    lower = [a[2, i] * a[3, j] - a[2, j] * a[3, i] for i, j in pairs]
    return upper, lower


def _largest_adjugate_column(a: np.ndarray) -> np.ndarray:
    """Unit null vectors (F, 4) of singular symmetric matrices (4, 4, F): their adjugate is a multiple of v v'."""
    s, c = _minors(a)
    adj = np.empty_like(a)
    adj[0, 0] = a[1, 1] * c[5] - a[1, 2] * c[4] + a[1, 3] * c[3]
    adj[1, 1] = a[0, 0] * c[5] - a[0, 2] * c[2] + a[0, 3] * c[1]
    adj[2, 2] = a[3, 0] * s[4] - a[3, 1] * s[2] + a[3, 3] * s[0]
    adj[3, 3] = a[2, 0] * s[3] - a[2, 1] * s[1] + a[2, 2] * s[0]
    for i, j, value in (
        (0, 1, -a[0, 1] * c[5] + a[0, 2] * c[4] - a[0, 3] * c[3]),
        (0, 2, a[3, 1] * s[5] - a[3, 2] * s[4] + a[3, 3] * s[3]),
        (0, 3, -a[2, 1] * s[5] + a[2, 2] * s[4] - a[2, 3] * s[3]),
        (1, 2, -a[3, 0] * s[5] + a[3, 2] * s[2] - a[3, 3] * s[1]),
        (1, 3, a[2, 0] * s[5] - a[2, 2] * s[2] + a[2, 3] * s[1]),
        (2, 3, -a[2, 0] * s[4] + a[2, 1] * s[2] - a[2, 3] * s[0]),
    ):  # fmt: skip
        adj[i, j] = adj[j, i] = value
    best = np.argmax(np.abs(np.einsum("iif->if", adj)), axis=0)
    q = adj[best, :, np.arange(a.shape[2])]
    norm = np.linalg.norm(q, axis=1, keepdims=True)
    return q / np.where(norm > 0, norm, 1.0)
