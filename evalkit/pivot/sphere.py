"""Pivot from the distances alone: every rigid marker moves on a sphere about it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.pivot.model import Pivot, block_covariance, judge
from evalkit.pose.model import Pose

MAX_ITERATIONS = 100


def gamage_lasenby(points: Array, pose: Pose, *, correct_bias: bool = True, **_: object) -> Pivot:
    """Closed-form sphere fit: minimises ``sum_j sum_i (|x_ij - O|² - mean_i |x_ij - O|²)²``, linear in O.

    White noise of variance sigma² adds ``2 M sigma² I`` to the normal matrix ``2 sum_j Cov(x_j)`` and
    ``2 sigma² sum_j xbar_j`` to its right side; the correction takes both away, sigma² from the lengths'
    own scatter about the solution.

    Parameters
    ----------
    points : ndarray, shape (F, M, 3), mm
        Rigid markers in world axes, NaN where missing.
    pose : Pose
        Used for the verdict only.
    correct_bias : bool
        Apply the correction.

    Raises
    ------
    EvalkitError
        If no marker is seen in four frames.

    References
    ----------
    Gamage & Lasenby, J. Biomechanics 35 (2002), doi:10.1016/S0021-9290(01)00160-9;
    Halvorsen, "Bias compensated least squares estimate of the center of rotation",
    J. Biomechanics 36 (2003), doi:10.1016/S0021-9290(03)00070-8.
    """
    solution = closed_form(points, correct_bias=correct_bias)
    return judge(solution, length_covariance(points, pose, solution), points, pose)


def sphere(points: Array, pose: Pose, *, initial: ArrayLike | None = None, **_: object) -> Pivot:
    """Geometric sphere fit: minimises ``sum_j sum_i (|x_ij - O| - r_j)²`` over O and the radii r_j.

    Maximum likelihood for the distances under white noise; Levenberg-Marquardt from the closed form, the
    radii eliminated as means.

    Parameters
    ----------
    points : ndarray, shape (F, M, 3), mm
        Rigid markers in world axes, NaN where missing.
    pose : Pose
        Used for the verdict only.
    initial : array_like, shape (3,), mm, optional
        Where to start, instead of the closed form.

    Raises
    ------
    EvalkitError
        If no marker is seen in four frames.

    References
    ----------
    Halvorsen et al., J. Biomechanics 32 (1999), doi:10.1016/S0021-9290(99)00120-7.
    """
    start = closed_form(points) if initial is None else np.asarray(initial, dtype=np.float64)
    solution, converged, evaluations = length_optimum(points, start)
    cov = block_covariance(*_length_influence(points, solution))
    return judge(solution, cov, points, pose, converged=converged, evaluations=evaluations)


def closed_form(points: Array, *, correct_bias: bool = True) -> Array:
    """Centre by Gamage & Lasenby, shape (3,), mm; see :func:`gamage_lasenby`."""
    seen = np.isfinite(points[:, :, 0])
    used = seen.sum(axis=0) >= 4
    if not used.any():
        raise EvalkitError("no rigid marker is seen in four frames; a pivot cannot be estimated")
    x = points[:, used]
    origin = np.nanmean(x, axis=(0, 1))
    x = np.nan_to_num(x - origin)
    count = seen[:, used].sum(axis=0)
    square = np.einsum("fmi,fmi->fm", x, x)
    mean = x.sum(axis=0) / count[:, None]
    centred = np.where(seen[:, used, None], x - mean, 0.0)
    normal = 2.0 * np.einsum("fmi,fmj,m->ij", centred, centred, 1.0 / count, optimize=True)
    right = np.einsum("fmi,fm,m->i", centred, square, 1.0 / count, optimize=True)
    # A marker that stays within a ten-millionth of the extent has not moved: what is left is rounding.
    least = 1e-14 * float(square.sum() / count.sum())
    solution = _solve(normal, right, least)
    rows = float(used.sum())
    variance = 0.0
    for _ in range(20 if correct_bias else 0):
        lengths = np.where(seen[:, used], np.linalg.norm(x - solution, axis=2), np.nan)
        before = variance
        variance = float(np.nanmean(np.nanvar(lengths, axis=0)))
        solution = _solve(normal - 2 * rows * variance * np.eye(3), right - 2 * variance * mean.sum(axis=0), least)
        if abs(variance - before) <= 1e-12 * variance:
            break
    return origin + solution


def _solve(normal: Array, right: Array, least: float) -> Array:
    """Solution of least norm in the directions in which the markers moved at all."""
    values, vectors = np.linalg.eigh(normal)
    shown = values > max(1e-12 * values[-1], least)
    return (vectors[:, shown] / values[shown]) @ (vectors[:, shown].T @ right)


def length_residuals(points: Array, centre: Array) -> tuple[Array, Array]:
    """Distances from the centre less their mean over frames (F, M), and unit vectors likewise (F, M, 3)."""
    arm = centre - points
    length = np.sqrt(np.einsum("fmi,fmi->fm", arm, arm))
    unit = arm / np.maximum(length, 1e-300)[:, :, None]
    seen = np.isfinite(length)
    count = np.maximum(seen.sum(axis=0), 1)
    length, unit = np.where(seen, length, 0.0), np.where(seen[:, :, None], unit, 0.0)
    residual = np.where(seen, length - length.sum(axis=0) / count, 0.0)
    return residual, np.where(seen[:, :, None], unit - unit.sum(axis=0) / count[:, None], 0.0)


def length_optimum(points: Array, start: Array) -> tuple[Array, bool, int]:
    """Least-squares centre of the distances by Levenberg-Marquardt: (position, converged, evaluations)."""
    centre = start.copy()
    residual, slope = length_residuals(points, centre)
    value, damping, evaluations = float((residual**2).sum()), 1e-6, 1
    for _ in range(MAX_ITERATIONS):
        normal = np.einsum("fmi,fmj->ij", slope, slope, optimize=True)
        gradient = np.einsum("fmi,fm->i", slope, residual, optimize=True)
        step = -np.linalg.pinv(normal + damping * np.trace(normal) * np.eye(3), rcond=1e-14) @ gradient
        trial_residual, trial_slope = length_residuals(points, centre + step)
        trial = float((trial_residual**2).sum())
        evaluations += 1
        small = np.linalg.norm(step) <= 1e-9 * (1.0 + np.linalg.norm(centre - np.nanmean(points, axis=(0, 1))))
        if trial <= value:
            centre, residual, slope, value = centre + step, trial_residual, trial_slope, trial
            damping = max(damping / 10, 1e-15)
        else:
            damping *= 10
        if small or not np.isfinite(damping) or damping > 1e12:
            return centre, bool(np.isfinite(centre).all()), evaluations
    return centre, False, evaluations


def length_covariance(points: Array, pose: Pose, solution: Array) -> Array:
    """Covariance of any estimate that minimises some function of the distances, shape (3, 3), mm².

    That of the least-squares centre, plus the squared distance to it: an estimate that another function of
    the same lengths puts elsewhere is off by at least about that much.
    """
    best, _, _ = length_optimum(points, closed_form(points))
    apart = solution - best
    return block_covariance(*_length_influence(points, best)) + np.outer(apart, apart)


def _length_influence(points: Array, centre: Array) -> tuple[Array, np.ndarray]:
    """Influence of every frame on the least-squares centre (N, 3), mm, and which frames these are."""
    residual, slope = length_residuals(points, centre)
    normal = np.einsum("fmi,fmj->ij", slope, slope, optimize=True)
    scores = np.einsum("fmi,fm->fi", slope, residual)
    ok = np.asarray(np.isfinite(points[:, :, 0]).any(axis=1))
    return scores[ok] @ np.linalg.pinv(normal, rcond=1e-14), ok
