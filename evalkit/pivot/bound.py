"""How well any estimator can do: the Cramér-Rao bounds of pivot, rotation and target."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evalkit.geometry import Array, cross_matrix
from evalkit.pivot.information import RANK, information
from evalkit.pivot.spline import Basis, constant


def inertia(points: ArrayLike) -> Array:
    """``J = sum |x|² I - x x'`` of points (M, 3), mm², shape (3, 3)."""
    x = np.asarray(points, dtype=np.float64)
    return (x**2).sum() * np.eye(3) - x.T @ x


def pivot_bound(shape: ArrayLike, rotations: ArrayLike, sigma_mm: float) -> Array:
    """Smallest covariance of a pivot at rest, shape (3, 3), mm²: white noise, all markers seen, shape unknown.

    ``Cov >= sigma² [sum_i (R_i - Rbar) K (R_i - Rbar)']^-1`` with
    ``K = (I / M - [xbar]x J_c^-1 [xbar]x)^-1``, J_c the inertia about the mean xbar of the markers x_j, which are
    taken relative to the pivot in head axes, and Rbar the mean matrix.

    Parameters
    ----------
    shape : array_like, shape (M, 3), mm
        Markers about the pivot, head axes.
    rotations : array_like, shape (F, 3, 3)
    sigma_mm : float
        Standard deviation of the noise per axis.

    Returns
    -------
    ndarray, shape (3, 3), mm²
        Infinite along axes that the rotations do not show.
    """
    x, r = np.asarray(shape, dtype=np.float64), np.asarray(rotations, dtype=np.float64)
    mean = x.mean(axis=0)
    lever = cross_matrix(mean)
    k = np.linalg.inv(np.eye(3) / len(x) - lever @ np.linalg.inv(inertia(x - mean)) @ lever)
    about = r - r.mean(axis=0)
    values, vectors = np.linalg.eigh((about @ k @ about.transpose(0, 2, 1)).sum(axis=0))
    seen = values > RANK * len(r) * np.linalg.norm(k, 2)
    cov = sigma_mm**2 * (vectors[:, seen] / values[seen]) @ vectors[:, seen].T
    return _infinite_along(cov, vectors[:, ~seen].T)


def _infinite_along(cov: Array, axes: Array) -> Array:
    """A covariance (3, 3), made symmetric to the last digit, with infinite variance along unit vectors (N, 3)."""
    cov = 0.5 * (cov + cov.T)
    if len(axes) == 3:
        return np.diag(np.full(3, np.inf))
    for axis in axes:
        outer = np.outer(axis, axis)
        # An axis is known to the square root of what counts as no information.
        cov = np.where(np.abs(outer) > np.sqrt(RANK), np.copysign(np.inf, outer), cov)
    return cov


def full_pivot_bound(
    shape: ArrayLike,
    rotations: ArrayLike,
    sigma_mm: ArrayLike,
    visible: ArrayLike | None = None,
    basis: Basis | None = None,
    frame: int | None = None,
) -> Array:
    """Smallest covariance of the pivot with missing markers, a noise of its own for each, and sway; (3, 3), mm².

    Parameters
    ----------
    shape, rotations
        As in :func:`pivot_bound`.
    sigma_mm : float or array_like, shape (M,)
    visible : array_like of bool, shape (F, M), optional
    basis : Basis, optional
        Functions of time of the pivot's path; a constant if not given.
    frame : int, optional
        Bound the pivot's position in this frame instead of its mean position over the take.

    Returns
    -------
    ndarray, shape (3, 3), mm²
        Infinite along axes that the motion does not show.

    Notes
    -----
    Positions of the path are in the world and do not depend on the choice of the head's axes, so neither does
    the bound: any gauge gives the same.
    """
    x, r = np.asarray(shape, dtype=np.float64), np.asarray(rotations, dtype=np.float64)
    weights = np.broadcast_to(1.0 / np.asarray(sigma_mm, dtype=np.float64) ** 2, (len(x),))
    if visible is not None:
        weights = np.where(np.asarray(visible, dtype=bool), weights, 0.0)
    # Scaled so that lengths and weights are near one: the bands and the border then share their digits.
    unit = float(np.sqrt((x**2).mean()))
    heavy = float(weights.max())
    matrix = information(x / unit, r, weights / heavy, constant(len(r)) if basis is None else basis)
    functional = matrix.path_weights(frame)
    path, _ = matrix.solve(functional, np.zeros((3 * len(x), 3)))
    cov = functional.T @ path / heavy
    return _infinite_along(cov, matrix.unseen(functional))


def rotation_bound(shape: ArrayLike, sigma_mm: float, pivot_known: bool = False, noisy_template: bool = False) -> Array:
    """Smallest covariance of one frame's rotation, head axes, rad², shape (3, 3).

    ``sigma² J_c^-1`` with the translation free, ``sigma² J_p^-1`` with the pivot known (J about the centroid and
    about the pivot); a template that is one noisy frame doubles it.

    Parameters
    ----------
    shape : array_like, shape (M, 3), mm
        Markers about the pivot, head axes.
    sigma_mm : float
    pivot_known, noisy_template : bool
    """
    x = np.asarray(shape, dtype=np.float64)
    about = inertia(x if pivot_known else x - x.mean(axis=0))
    doubled = 2.0 if noisy_template else 1.0
    return np.asarray(doubled * sigma_mm**2 * np.linalg.inv(about))


def target_bound(shape: ArrayLike, target: ArrayLike, sigma_mm: float) -> Array:
    """Smallest covariance of a stabilised point, head axes, mm², shape (3, 3), from one frame's free pose.

    ``sigma² (I / M - [d]x J_c^-1 [d]x)`` for a point d from the markers' centroid: the error of the pose alone,
    without the point's own noise.

    Parameters
    ----------
    shape : array_like, shape (M, 3), mm
    target : array_like, shape (3,), mm
        In the axes and origin of the shape.
    sigma_mm : float
    """
    x = np.asarray(shape, dtype=np.float64)
    mean = x.mean(axis=0)
    lever = cross_matrix(np.asarray(target, dtype=np.float64) - mean)
    return sigma_mm**2 * (np.eye(3) / len(x) - lever @ np.linalg.inv(inertia(x - mean)) @ lever)
