"""Noise cut off where singular values come down to it, gaps or not.

The centred positions of a take as a matrix, a column for every marker and three rows for every frame, have few
dimensions: three for the shape, one or two for each thing that the face does. Turning frames does not change the right
singular vectors, so that the head's rotation need not be known, and soft markers help to place rigid ones.
"""

from __future__ import annotations

from collections.abc import Callable
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from evalkit.geometry import Array, blocks

DIFFERENCES = 3
"""Order of the differences in time that the noise is read from: a marker that speeds up evenly has none."""

CHI_SQUARE_MEDIAN = 2.365974
"""With three degrees of freedom."""

RUNS = 10
"""Runs of frames, spread over the take, that it is read from."""

SUBSET = 5000
"""Rows, spread over the take, that principal axes are taken from: their error is then a seventieth of the noise."""

FIRST, STEP = 4, 2
"""Axes of the first round where values are missing, and how many more there may be in each one after it."""

MAX_ROUNDS = 40
TOLERANCE = 1e-4
"""Largest change of a filled value in the last round, relative to the spread of all."""


def noise_level(points: ArrayLike) -> float:
    """Standard deviation per axis of white noise on smooth motion, from third differences in time.

    ``sigma² = median |d|² / (20 * 2.366)`` over all markers and frames: the third difference of white noise has
    1 + 9 + 9 + 1 times its variance, 2.366 is the median of chi-square with three degrees of freedom, and a median does
    not mind quick movements. Noise that neighbouring frames
    share is missed in part: less is then cut off than could be.

    Parameters
    ----------
    points : array_like, shape (F, M, 3), mm, NaN where missing

    Returns
    -------
    float
        Zero where no four frames in a row show a marker.

    References
    ----------
    Hall, Kay & Titterington, "Asymptotically optimal difference-based estimation of variance in nonparametric
    regression", Biometrika 77 (1990), doi:10.1093/biomet/77.3.521.
    """
    x = np.asarray(points, dtype=np.float64)
    runs = list(blocks(len(x)))
    runs = runs[:: max(len(runs) // RUNS, 1)]
    # Lengths, not coordinates: the figure must not depend on the axes.
    squares = [(np.diff(x[run], n=DIFFERENCES, axis=0) ** 2).sum(axis=2).ravel() for run in runs]
    known = np.concatenate([*squares, np.zeros(0)])
    known = known[np.isfinite(known)]
    gain = sum(comb(DIFFERENCES, k) ** 2 for k in range(DIFFERENCES + 1))
    return float(np.sqrt(np.median(known) / (gain * CHI_SQUARE_MEDIAN))) if known.size else 0.0


def elbow(strength: ArrayLike, rows: int, columns: int, noise_mm: float) -> int:
    """How many singular values of a matrix stand out of its noise, by the optimal hard threshold.

    ``lambda(b) sqrt(n) sigma`` with n the longer side, b the shorter over the longer, and
    ``lambda(b)² = 2 (b + 1) + 8 b / (b + 1 + sqrt(b² + 14 b + 1))``: the cut with the least mean squared error. Their
    rule for unknown noise, a multiple of the median singular value, is not used: it takes half of the dimensions for
    noise, and of 23 markers a face moves more than half.

    Parameters
    ----------
    strength : array_like
        Singular values.
    rows, columns : int
        Of the matrix.
    noise_mm : float
        sigma.

    References
    ----------
    Gavish & Donoho, "The optimal hard threshold for singular values is 4/sqrt(3)", IEEE Trans. Inf. Theory 60 (2014),
    doi:10.1109/TIT.2014.2323359.
    """
    longer = max(rows, columns)
    b = min(rows, columns) / longer
    factor = np.sqrt(2.0 * (b + 1.0) + 8.0 * b / (b + 1.0 + np.sqrt(b * b + 14.0 * b + 1.0)))
    return int((np.asarray(strength) > factor * np.sqrt(longer) * noise_mm).sum())


def denoised(centred: ArrayLike, noise_mm: float) -> tuple[Array, int]:
    """Positions brought into the dimensions that stand out of the noise; what is missing stays missing.

    Parameters
    ----------
    centred : array_like, shape (F, M, 3), mm, NaN where missing
        The head's place taken off.
    noise_mm : float

    Returns
    -------
    points : ndarray, shape (F, M, 3), mm
    rank : int
        Dimensions kept.
    """
    x = np.asarray(centred, dtype=np.float64)
    markers = x.shape[1]
    rows = x.transpose(0, 2, 1).reshape(-1, markers)

    def kept(strength: Array, count: int) -> int:
        # Three dimensions are the head itself.
        return max(elbow(strength, count, markers, noise_mm), min(3, markers))

    axes, spread, rest = principal(rows, kept)
    flat = scores(rows, axes, spread, rest) @ axes.T
    return np.where(np.isfinite(x), flat.reshape(len(x), 3, markers).transpose(0, 2, 1), np.nan), axes.shape[1]


def principal(rows: Array, kept: Callable[[Array, int], int]) -> tuple[Array, Array, float]:
    """Principal axes of rows (N, D) about zero, NaN where missing.

    Where values are missing, axes and values are found in turns, from the second moments of what is seen together:
    the expectation-maximisation algorithm for probabilistic principal components.

    Parameters
    ----------
    rows : ndarray, shape (N, D)
        Rows without any value are left out, and of very many some are taken.
    kept : callable
        From the singular values and the number of rows to the number of axes.

    Returns
    -------
    axes : ndarray, shape (D, L)
    spread : ndarray, shape (L,)
        Variance along each.
    rest : float
        Variance along each of the others.

    References
    ----------
    Tipping & Bishop, "Probabilistic principal component analysis", J. R. Stat. Soc. B 61 (1999),
    doi:10.1111/1467-9868.00196.
    """
    seen = np.isfinite(rows)
    used = np.flatnonzero(seen.any(axis=1))
    used = used[np.unique(np.linspace(0, len(used) - 1, min(len(used), SUBSET)).astype(int))] if len(used) else used
    x, seen = rows[used], seen[used]
    if seen.all():
        strength, right = np.linalg.svd(np.linalg.qr(x, mode="r"), full_matrices=False)[1:]
        return _axes(strength, right, len(x), kept(strength, len(x)))
    zero = np.where(seen, x, 0.0)
    together = seen.T.astype(np.float64) @ seen
    values, vectors = np.linalg.eigh(zero.T @ zero / np.maximum(together, 1.0))
    strength, right = np.sqrt(np.maximum(values[::-1], 0.0) * len(x)), vectors[:, ::-1].T
    size, filled = np.sqrt(float((zero**2).sum()) / max(int(seen.sum()), 1)), zero
    for limit in range(FIRST, FIRST + STEP * MAX_ROUNDS, STEP):
        wanted = kept(strength, len(x))
        # From few axes to many: a gap filled from all axes at once is explained by any of them, and stays as it is.
        found = _axes(strength, right, len(x), min(wanted, limit))
        before, filled = filled, np.where(seen, zero, scores(x, *found) @ found[0].T)
        if wanted <= limit and np.abs(filled - before).max() <= TOLERANCE * size:
            break
        strength, right = np.linalg.svd(np.linalg.qr(filled, mode="r"), full_matrices=False)[1:]
    return found


def _axes(strength: Array, right: Array, rows: int, count: int) -> tuple[Array, Array, float]:
    """Axes, variances and the variance of the others from singular values and right vectors, signs fixed."""
    count = min(count, len(right))
    axes = right[:count].T
    axes = axes * np.sign(axes[np.argmax(np.abs(axes), axis=0), np.arange(count)])
    variance = strength**2 / max(rows, 1)
    return axes, variance[:count], float(variance[count:].sum()) / max(right.shape[1] - count, 1)


def scores(rows: Array, axes: Array, spread: Array, rest: float) -> Array:
    """Amounts (N, L) of axes (D, L) in rows (N, D): the projection, or where values are missing its expectation.

    ``(A' A + rest / spread)^-1 A' x`` with A the rows of the axes that are seen; zero where nothing is.
    """
    seen = np.isfinite(rows)
    whole = seen.all(axis=1)
    count = axes.shape[1]
    if whole.all():
        return rows @ axes
    out = np.empty((len(rows), count))
    out[whole] = rows[whole] @ axes
    outer = (axes[:, :, None] * axes[:, None, :]).reshape(len(axes), -1)
    # A touch more than the rest: rows in which hardly anything is seen must have an answer without any noise, too.
    ridge = np.diag(rest / np.maximum(spread, 1e-300) + 1e-12)
    broken = np.flatnonzero(~whole)
    for part in blocks(len(broken)):
        some = broken[part]
        normal = (seen[some].astype(np.float64) @ outer).reshape(-1, count, count) + ridge
        right = np.where(seen[some], rows[some], 0.0) @ axes
        out[some] = np.linalg.solve(normal, right[..., None])[..., 0]
    return out
