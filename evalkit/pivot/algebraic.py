"""Pivot from the poses alone, by linear least squares."""

from __future__ import annotations

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.pivot.model import Pivot, block_covariance, judge, motion_spread
from evalkit.pose.model import Pose


def svd(points: Array, pose: Pose, **_: object) -> Pivot:
    """Least squares of the stacked ``(I - R_i) O = T_i`` by singular values; no sway, the reference pose exact.

    Any error of the reference pose stays in every T_i and is taken for motion about a shifted pivot: compare
    :func:`score`, which frees it. The covariance adds the squared distance to that estimate.

    Parameters
    ----------
    points : ndarray, shape (F, M, 3), mm
        Rigid markers in world axes, NaN where missing.
    pose : Pose

    Raises
    ------
    EvalkitError
        If fewer than two frames have a pose.

    References
    ----------
    Ehrig et al., "A survey of formal methods for determining the centre of rotation of ball joints",
    J. Biomechanics 39 (2006), doi:10.1016/j.jbiomech.2005.10.002.
    """
    _need_two(pose)
    r, t = pose.rotations[pose.known], pose.translations[pose.known]
    # About the markers' own centroid: the laboratory's origin may be metres away and would cost digits.
    origin = pose.template.mean(axis=0)
    stacked = (np.eye(3) - r).reshape(-1, 3)
    local = t - (origin - r @ origin)
    solution = origin + np.linalg.lstsq(stacked, local.ravel(), rcond=1e-10)[0]
    better = score(points, pose)
    apart = solution - better.position
    cov = np.where(np.isfinite(better.covariance), better.covariance, 0.0) + np.outer(apart, apart)
    return judge(solution, cov, points, pose)


def score(points: Array, pose: Pose, *, correct_bias: bool = True, **_: object) -> Pivot:
    """Symmetric centre of rotation: least squares of ``a - R_i b = c_i`` with the pivot free in head and world.

    c_i is the markers' centroid, so its error is independent of the rotation's, and the normal matrix can be
    freed from the noise of the rotations (errors in variables), which otherwise draws the pivot towards the
    markers. Sway is not modelled; it enters the covariance through the scatter between stretches of time.

    Parameters
    ----------
    points : ndarray, shape (F, M, 3), mm
        Rigid markers in world axes, NaN where missing.
    pose : Pose
    correct_bias : bool
        Subtract the noise of the rotations from the normal matrix.

    Raises
    ------
    EvalkitError
        If fewer than two frames have a pose.

    References
    ----------
    Ehrig et al., J. Biomechanics 39 (2006), doi:10.1016/j.jbiomech.2005.10.002;
    Fuller, "Measurement error models" (1987), for the correction.
    """
    _need_two(pose)
    r, t = pose.rotations[pose.known], pose.translations[pose.known]
    origin = pose.template.mean(axis=0)
    c = t + r @ origin
    motion = motion_spread(points, pose)
    centred, offset = r - motion.mean, c - c.mean(axis=0)
    normal = motion.spread if correct_bias else motion.spread + motion.floor
    right = -centred.reshape(-1, 3).T @ offset.ravel()
    # Along hidden axes b stays zero, level with the centroid.
    shown = motion.axes[:, ~motion.hidden]
    inverse = shown @ np.linalg.inv(shown.T @ normal @ shown) @ shown.T
    b = inverse @ right
    position = c.mean(axis=0) + motion.mean @ b
    residual = offset + (centred.reshape(-1, 3) @ b).reshape(-1, 3)
    # Influence of one frame on the pivot in the world: through b, and through the mean.
    through_b = (centred * residual[:, :, None]).sum(axis=1) @ inverse @ motion.mean.T
    influence = residual / len(r) - through_b
    return judge(position, block_covariance(influence, pose.ok), points, pose, motion=motion)


def _need_two(pose: Pose) -> None:
    if pose.ok.sum() < 2:
        raise EvalkitError("fewer than two frames have a head pose; a pivot needs the head to turn")
