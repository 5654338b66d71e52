"""Rotations and rigid motions, batched over frames.

Axes are right-handed: x to the performer's left, y up, z forward. Positions are column vectors in mm and a
head pose maps the reference pose to the world by ``x = R P + T``. Angles are in radians unless a name ends in
``_deg``. A frame whose pose is unknown carries NaN and stays NaN in everything computed from it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

BLOCK = 2048
"""Frames that are worked on at a time where a whole take would not fit the processor's cache."""


def blocks(count: int, size: int = BLOCK) -> Iterator[slice]:
    """Runs of at most ``size`` frames that together make ``count``."""
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


def nearest_rotation(matrices: ArrayLike) -> Array:
    """Rotation nearest to each matrix in the Frobenius norm (orthogonal polar factor with determinant +1).

    Parameters
    ----------
    matrices : array_like, shape (..., 3, 3)
        Any matrices; NaN gives NaN.

    Returns
    -------
    ndarray, shape (..., 3, 3)

    References
    ----------
    Higham, "Computing the polar decomposition", SIAM J. Sci. Stat. Comput. 7 (1986), doi:10.1137/0907079.
    """
    array = np.asarray(matrices, dtype=np.float64)
    known = np.asarray(np.isfinite(array).all(axis=(-2, -1)))
    left, _, right = np.linalg.svd(np.where(known[..., None, None], array, np.eye(3)))
    left[..., :, 2] *= np.sign(np.linalg.det(left @ right))[..., None]
    return np.where(known[..., None, None], left @ right, np.nan)


def det3(m: Array) -> Array:
    """Determinants of matrices stored frames last, shape (3, 3, F) to (F,)."""
    return (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )


def cross_matrix(vectors: ArrayLike) -> Array:
    """Matrices ``[v]x`` with ``[v]x w = v x w``; shape (..., 3) to (..., 3, 3)."""
    v = np.asarray(vectors, dtype=np.float64)
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def rotation_from_vector(vectors: ArrayLike) -> Array:
    """Rotation matrices of rotation vectors (axis times angle, rad) by Rodrigues' formula; (..., 3) to (..., 3, 3)."""
    v = np.asarray(vectors, dtype=np.float64)
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    k = cross_matrix(v)
    # np.sinc keeps both factors exact at angle zero, where the quotients are 0/0.
    return np.eye(3) + np.sinc(angle / np.pi) * k + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (k @ k)


def quaternion_from_rotation(rotations: ArrayLike) -> Array:
    """Unit quaternions (w, x, y, z) of rotation matrices, continuous in sign along the first axis.

    Parameters
    ----------
    rotations : array_like, shape (F, 3, 3)
        Rotation matrices; frames with NaN give NaN and do not interrupt the choice of sign.

    Returns
    -------
    ndarray, shape (F, 4)

    References
    ----------
    Bar-Itzhack, "New method for extracting the quaternion from a rotation matrix" (2000),
    doi:10.2514/2.4654: the largest of the four squared components is the safe one to divide by.
    """
    r = np.asarray(rotations, dtype=np.float64)
    out = np.full((len(r), 4), np.nan)
    known = np.isfinite(r).all(axis=(1, 2))
    m = r[known]
    if not len(m):
        return out
    w = 1.0 + m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2]
    near = w > 1.0  # turns below 120 degrees: dividing by the scalar part is safe
    q = np.empty((len(m), 4))
    q[:, 0], q[:, 1] = w, m[:, 2, 1] - m[:, 1, 2]
    q[:, 2], q[:, 3] = m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    if not near.all():
        q[~near] = _largest_component(m[~near])
    q /= np.sqrt(np.einsum("fi,fi->f", q, q))[:, None]
    flips = np.where(np.einsum("fi,fi->f", q[1:], q[:-1]) < 0, -1.0, 1.0)
    q[1:] *= np.cumprod(flips)[:, None]
    out[known] = q if q[0, 0] >= 0 else -q
    return out


def _largest_component(m: Array) -> Array:
    """Quaternions, not normalised: the row of q q' with the largest diagonal is q times its largest component."""
    outer = np.empty((len(m), 4, 4))
    xx, yy, zz = m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]
    outer[:, 0, 0], outer[:, 1, 1] = 1 + xx + yy + zz, 1 + xx - yy - zz
    outer[:, 2, 2], outer[:, 3, 3] = 1 - xx + yy - zz, 1 - xx - yy + zz
    for i, j, value in (
        (0, 1, m[:, 2, 1] - m[:, 1, 2]), (0, 2, m[:, 0, 2] - m[:, 2, 0]), (0, 3, m[:, 1, 0] - m[:, 0, 1]),
        (1, 2, m[:, 0, 1] + m[:, 1, 0]), (1, 3, m[:, 0, 2] + m[:, 2, 0]), (2, 3, m[:, 1, 2] + m[:, 2, 1]),
    ):  # fmt: skip
        outer[:, i, j] = outer[:, j, i] = value
    return outer[np.arange(len(m)), np.argmax(np.einsum("fii->fi", outer), axis=1)]


def rotation_angle(rotations: ArrayLike) -> Array:
    """Rotation angle of each matrix, rad in [0, pi]; shape (..., 3, 3) to (...)."""
    r = np.asarray(rotations, dtype=np.float64)
    # atan2 of sine and cosine: arccos of the trace alone loses half the digits at small angles.
    sine = 0.5 * np.linalg.norm(
        np.stack([r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]], axis=-1),
        axis=-1,
    )
    return np.arctan2(sine, 0.5 * (np.trace(r, axis1=-2, axis2=-1) - 1.0))


def rotation_vector(rotations: ArrayLike) -> Array:
    """Rotation vectors (axis times angle, rad) of rotation matrices; (F, 3, 3) to (F, 3)."""
    q = quaternion_from_rotation(rotations)
    q = np.where(q[:, :1] < 0, -q, q)
    sine = np.linalg.norm(q[:, 1:], axis=1, keepdims=True)
    half = np.arctan2(sine, q[:, :1])
    return q[:, 1:] * np.where(sine > 1e-150, 2 * half / np.where(sine > 1e-150, sine, 1.0), 2.0)


def mean_rotation(rotations: ArrayLike) -> Array:
    """Chordal mean of rotations, NaN frames left out: the rotation nearest to their mean matrix.

    Hartley et al., "Rotation averaging", IJCV 103 (2013), doi:10.1007/s11263-012-0601-0.
    """
    array = np.asarray(rotations, dtype=np.float64)
    known = np.isfinite(array[:, 0, 0])
    return nearest_rotation((array if known.all() else array[known]).mean(axis=0))


def apply_motion(rotations: ArrayLike, translations: ArrayLike, points: ArrayLike) -> Array:
    """World positions ``x = R P + T`` of points (M, 3) or (F, M, 3) under motions (F, 3, 3), (F, 3)."""
    r = np.asarray(rotations, dtype=np.float64)
    t = np.asarray(translations, dtype=np.float64)
    return np.asarray(points, dtype=np.float64) @ r.transpose(0, 2, 1) + t[:, None, :]


def undo_motion(rotations: ArrayLike, translations: ArrayLike, points: ArrayLike) -> Array:
    """Reference-pose positions ``P = R' (x - T)`` of world points (F, M, 3)."""
    r, t = np.asarray(rotations, dtype=np.float64), np.asarray(translations, dtype=np.float64)
    x = np.asarray(points, dtype=np.float64)
    out = np.empty(x.shape)
    # Blocks that fit the cache: a take of a million frames does not, and twice the time goes by.
    for block in blocks(len(x)):
        np.matmul(x[block] - t[block, None, :], r[block], out=out[block])
    return out
