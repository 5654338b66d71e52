"""Scattered-data interpolation as a matrix from values at centres to values at points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from evalkit.geometry import Array

FLAT_RATIO = 0.05
"""Centres that spread less than this part of their largest spread in some direction say nothing about slopes in
that direction: 3 mm over a face. Dividing by less would turn their noise into displacements of other vertices."""


@dataclass(frozen=True, eq=False)
class Interpolant:
    """Linear map from values at N centres to values at K points.

    Attributes
    ----------
    weights : ndarray, shape (K, N)
    condition : float
        Condition number of the matrix that was solved, with lengths measured in inter-eye distances.
    affine_rank : int
        Directions, 0 to 3, in which the affine part has a slope.
    truncated : int
        Dimensions of the data that double precision could not tell apart; these are not interpolated.
    """

    weights: Array
    condition: float = 1.0
    affine_rank: int = 0
    truncated: int = 0


def rbf(among: Array, towards: Array, centres: Array, points: Array, degree: int, slopes: int = 3) -> Interpolant:
    """Weights of a radial basis function interpolant with its polynomial part, Eq. (10-11).

    With A = phi among the centres and P the polynomials at them, ``A c + P d = u`` and ``P' c = 0``. The side
    condition is met by ``c = Z b``, Z an orthonormal basis of the null space of P': then ``Z' A Z b = Z' u`` is
    symmetric, and definite for a kernel that is conditionally positive definite of an order up to ``degree + 1``.

    Parameters
    ----------
    among : ndarray, shape (N, N)
        phi between the centres.
    towards : ndarray, shape (K, N)
        phi between points and centres.
    centres, points : ndarray, shape (N, 3) and (K, 3)
        Positions, for the polynomials.
    degree : int
        Of the polynomial part: -1 none, 0 a constant, 1 affine. Slopes across a plane or a line in which the
        centres lie (`FLAT_RATIO`) are left out.
    slopes : int
        Directions in which the affine part may have a slope, those of the largest spread first.

    Returns
    -------
    Interpolant

    References
    ----------
    Huang, Lin & Ouhyoung 2000, Eq. (10-11); the null-space method: Wendland, "Scattered Data Approximation",
    Cambridge 2005, ch. 8, doi:10.1017/CBO9780511617539.
    """
    count = len(centres)
    basis, at_points = _polynomials(centres, points, degree, slopes)
    rank = basis.shape[1]
    if rank:
        left, right = np.linalg.qr(basis, mode="complete")
        null, project = left[:, rank:], scipy.linalg.solve_triangular(right[:rank], left[:, :rank].T)
    else:
        null, project = np.eye(count), np.zeros((0, count))
    values, vectors = np.linalg.eigh(null.T @ among @ null)
    size = np.abs(values)
    largest = size.max(initial=0.0)
    # Rounding is that of phi itself, which may be far larger than what the side conditions leave of it.
    kept = size > count * np.finfo(float).eps * np.abs(among).max()
    vectors = null @ vectors[:, kept]
    coefficients = (vectors / values[kept]) @ vectors.T
    weights = towards @ coefficients + at_points @ (project @ (np.eye(count) - among @ coefficients))
    with np.errstate(divide="ignore"):
        condition = float(largest / size.min()) if size.size else 1.0
    return Interpolant(weights, condition, max(rank - 1, 0), int((~kept).sum()))


def _polynomials(centres: Array, points: Array, degree: int, slopes: int) -> tuple[Array, Array]:
    """Polynomials at the centres and at the points: none, a constant, or that and the slopes that centres show."""
    if degree < 0:
        return np.zeros((len(centres), 0)), np.zeros((len(points), 0))
    mean = centres.mean(axis=0)
    if degree == 0:
        axes = np.zeros((0, 3))
    else:
        _, spread, axes = np.linalg.svd(centres - mean, full_matrices=False)
        axes = axes[spread > max(FLAT_RATIO * spread.max(initial=0.0), 1e-12)]
        axes = axes[: min(slopes, len(centres) - 1)]
    return tuple(np.hstack([np.ones((len(x), 1)), (x - mean) @ axes.T]) for x in (centres, points))  # type: ignore[return-value]


def shepard(distance: Array, power: float = 2.0) -> Array:
    """Inverse-distance weights (K, N): a weighted mean, exact at the centres, flat around them.

    References
    ----------
    Shepard, "A two-dimensional interpolation function for irregularly-spaced data", Proc. ACM 1968,
    doi:10.1145/800186.810616.
    """
    # Relative to the nearest centre, so that no power of a small distance overflows.
    nearest = distance.min(axis=1, keepdims=True)
    weights = (np.maximum(nearest, 1e-12) / np.maximum(distance, 1e-12)) ** power
    weights[distance <= 1e-12] = 1.0
    weights[(nearest <= 1e-12) & (distance > 1e-12)] = 0.0
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
