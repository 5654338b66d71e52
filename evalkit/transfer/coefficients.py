"""How much of each example a new shape is, region by region."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array

RIDGE = 1e-3
"""Weight of ``|w|^2`` over the mean diagonal of ``D'D``: without it coefficients of alike examples reach several units
with opposite signs."""

QUIET = 1e-2
"""A region's mean diagonal counts as at least this share of what as many moving vertices have in the whole mesh: where
rough examples hardly move, coefficients would say how their rounding grows into the new shape."""

Solver = Callable[[Array, Array], Array]


def region_coefficients(
    rough: Array, new: Array, regions: NDArray[np.intp], kind: str = "ridge", ridge: float = RIDGE
) -> Array:
    """Coefficients of the examples for new shapes, ``w_r = argmin |D_r w - d_r|^2 + lambda |w|^2``.

    D_r are the displacements of the rough examples at the vertices of region r, d_r those of the new shape.

    Parameters
    ----------
    rough : ndarray, shape (M, V, 3)
        Displacements of the rough examples from the rest mesh.
    new : ndarray, shape (N, V, 3)
        Displacements of the new rough shapes.
    regions : ndarray of int, shape (V,)
        Region of each vertex, 0 to R - 1.
    kind : {"ridge", "non-negative", "sum-to-one", "convex"}
        ``convex``: non-negative with a sum of at most one, the rest of it being the rest mesh.
    ridge : float
        lambda over the mean diagonal of ``D_r'D_r``, or over :data:`QUIET` where the region hardly moves.

    Returns
    -------
    ndarray, shape (N, R, M)
        Zero where no example moves the region.

    Raises
    ------
    EvalkitError
        If ``ridge`` is negative, or is zero while examples do not differ in a region.

    References
    ----------
    Kato et al. 2014, section 3.4, eq. 6 and 7.
    """
    if not 0.0 <= ridge < np.inf:
        raise EvalkitError(f"ridge is {ridge:g}; it must be zero or positive")
    solve = kinds[kind]
    count = int(regions.max()) + 1
    out = np.zeros((len(new), count, len(rough)))
    moving = rough.any(axis=(0, 2))
    least = QUIET * float((rough**2).sum()) / max(1, len(rough) * int(moving.sum()))
    for region in range(count):
        which = regions == region
        d = rough[:, which].reshape(len(rough), -1)
        gram = d @ d.T
        mean = np.trace(gram) / len(rough)
        if mean > 0.0:
            gram[np.diag_indices(len(rough))] += ridge * max(mean, least * int((which & moving).sum()))
            try:
                out[:, region] = solve(gram, new[:, which].reshape(len(new), d.shape[1]) @ d.T)
            except np.linalg.LinAlgError as error:
                raise EvalkitError(f"region {region}: examples do not differ; use a ridge above {ridge:g}") from error
    return out


def _ridge(gram: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(gram, right.T).T, dtype=np.float64)


def _sum_to_one(gram: Array, right: Array) -> Array:
    """With the Lagrange multiplier of ``sum w = 1``."""
    free, pull = _ridge(gram, right), np.linalg.solve(gram, np.ones(len(gram)))
    return np.asarray(free + (1.0 - free.sum(axis=1, keepdims=True)) / pull.sum() * pull)


def _non_negative(gram: Array, right: Array) -> Array:
    """Normal equations as least squares with the Cholesky factor: the same minimum, of the size of the examples."""
    from scipy.linalg import solve_triangular
    from scipy.optimize import nnls

    lower = np.linalg.cholesky(gram)
    goals = solve_triangular(lower, right.T, lower=True)
    return np.array([nnls(lower.T, goal)[0] for goal in goals.T]).reshape(right.shape)


def _convex(gram: Array, right: Array) -> Array:
    """Where the sum of non-negative coefficients exceeds one, it is one: the nearest point of a simplex.

    With ``sum w = 1`` what is to be least is a quadratic form, and its minimum over that plane has the direction of the
    minimum of ``form + s (sum w - 1)^2`` without it, for any s > 0 (Lawson and Hanson 1974, chapter 23).
    """
    out = _non_negative(gram, right)
    for row in np.flatnonzero(out.sum(axis=1) > 1.0):
        mean, side = np.trace(gram) / len(gram), right[row]
        form = gram - side - side[:, None] + side @ np.linalg.solve(gram, side) + mean
        free = _non_negative(form, np.full((1, len(gram)), mean))[0]
        out[row] = free / free.sum()
    return out


kinds: dict[str, Solver] = {
    "ridge": _ridge,
    "non-negative": _non_negative,
    "sum-to-one": _sum_to_one,
    "convex": _convex,
}
"""How coefficients are bound, name to ``solve(D'D + lambda, d'D (N, M)) -> (N, M)``."""
