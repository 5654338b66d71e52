"""How far an estimate is from the truth. Pure functions; the truth itself scores zero.

A head frame is a convention: an estimate may use another reference pose than the truth. Rotations are therefore
compared after the one constant rotation that fits best, positions after the one constant rigid motion.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from evalkit.geometry import Array, mean_rotation, nearest_rotation, rotation_angle

REGIONS = {
    "forehead": ("Forehead", "Temple"),
    "brows": ("Brow",),
    "lids": ("Lid", "Eye"),
    "nose": ("Nose", "Nasion"),
    "cheeks": ("Cheek", "Fold"),
    "mouth": ("UpperLip", "LowerLip", "Mouth"),
    "chin": ("Chin", "Jaw"),
}
"""Region of the face -> how the labels of its markers begin, in the layouts of the synthetic takes."""


def rotation_error_deg(estimate: ArrayLike, truth: ArrayLike, ok: ArrayLike | None = None) -> Array:
    """Angle between estimated and true head rotation of every frame, gauge-aligned.

    ``angle(R_est Q' R_true')`` with the constant Q that is the chordal mean of ``R_true' R_est``.

    Parameters
    ----------
    estimate, truth : array_like, shape (F, 3, 3)
    ok : array_like of bool, shape (F,), optional
        Frames to compare; by default those without NaN in the estimate.

    Returns
    -------
    ndarray, shape (F,), deg, NaN in other frames
    """
    est, true = np.asarray(estimate, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    used = np.isfinite(est).all(axis=(1, 2)) if ok is None else np.asarray(ok, dtype=bool)
    out = np.full(len(est), np.nan)
    if used.any():
        gauge = mean_rotation(true[used].transpose(0, 2, 1) @ est[used])
        out[used] = np.degrees(rotation_angle(est[used] @ gauge.T @ true[used].transpose(0, 2, 1)))
    return out


def absolute_rotation_error_deg(estimate: ArrayLike, truth: ArrayLike) -> Array:
    """Angle of ``R_est R_true'`` of every frame, deg, shape (F,), without any alignment."""
    est, true = np.asarray(estimate, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    return np.degrees(rotation_angle(est @ true.transpose(0, 2, 1)))


def pivot_error_mm(
    pivot: ArrayLike, sway: ArrayLike, true_pivot: ArrayLike, true_sway: ArrayLike, ok: ArrayLike | None = None
) -> float:
    """Distance between the estimated and true mean position of the pivot in the world, mm.

    The pivot's path ``O + s`` does not depend on how O and s are split; its mean over the frames is compared.

    Parameters
    ----------
    pivot, true_pivot : array_like, shape (3,), mm
    sway, true_sway : array_like, shape (F, 3), mm
    ok : array_like of bool, shape (F,), optional
    """
    s, true_s = np.asarray(sway, dtype=np.float64), np.asarray(true_sway, dtype=np.float64)
    used = np.isfinite(s).all(axis=1) if ok is None else np.asarray(ok, dtype=bool)
    if not used.any():
        return float("nan")
    path = np.asarray(pivot, dtype=np.float64) + s[used].mean(axis=0)
    true_path = np.asarray(true_pivot, dtype=np.float64) + true_s[used].mean(axis=0)
    return float(np.linalg.norm(path - true_path))


def expression_error_mm(compensated: ArrayLike, truth: ArrayLike) -> Array:
    """Distance of every compensated marker from its true place in the head frame, after one rigid alignment.

    The alignment is the single rotation and translation, for all frames and markers together, that brings the
    compensated take nearest to the truth (Umeyama without scale, doi:10.1109/34.88573): it removes the choice
    of reference pose and nothing else.

    Parameters
    ----------
    compensated, truth : array_like, shape (F, M, 3), mm
        Head-frame positions; NaN where missing in the estimate.

    Returns
    -------
    ndarray, shape (F, M), mm, NaN where missing
    """
    est, true = np.asarray(compensated, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    seen = np.isfinite(est).all(axis=2)
    out = np.full(seen.shape, np.nan)
    if not seen.any():
        return out
    a, b = est[seen], true[seen]
    mean_a, mean_b = a.mean(axis=0), b.mean(axis=0)
    rotation = nearest_rotation((b - mean_b).T @ (a - mean_a))
    out[seen] = np.linalg.norm((a - mean_a) @ rotation.T + mean_b - b, axis=1)
    return out


def error_by_region_mm(errors: ArrayLike, labels: Sequence[str]) -> dict[str, float]:
    """Error of the markers of each region of the face: ``sqrt(mean e²)`` over its markers and all frames.

    Parameters
    ----------
    errors : array_like, shape (F, M), mm
        As of :func:`expression_error_mm`, NaN where missing: one alignment for the whole face, so that the region
        that a wrong head motion spoils most is seen to be.
    labels : sequence of str, length M

    Returns
    -------
    dict of str to float
        Region, every one of :data:`REGIONS`, to mm; NaN where no marker of it was seen. Markers of no region are
        left out.
    """
    e = np.asarray(errors, dtype=np.float64)
    return {
        region: rms(e[:, [label.startswith(beginnings) for label in labels]]) for region, beginnings in REGIONS.items()
    }


def translation_error_mm(
    rotations: ArrayLike,
    translations: ArrayLike,
    true_rotations: ArrayLike,
    true_translations: ArrayLike,
    point: ArrayLike,
    ok: ArrayLike | None = None,
) -> Array:
    """Distance of a point of the head, carried by the estimated motion, from its true place in every frame.

    ``|R_est h + T_est - x|`` with ``x = R_true c + T_true`` the true path of the point c, and h the one point that
    follows this path best in the estimate, ``h = (sum_i R_est' R_est)^-1 sum_i R_est' (x - T_est)``. T by itself is the
    path of the world's origin and says as much of the rotation as of the head's place; choosing h removes the choice
    of reference pose and nothing else.

    Parameters
    ----------
    rotations, true_rotations : array_like, shape (F, 3, 3)
    translations, true_translations : array_like, shape (F, 3), mm
    point : array_like, shape (3,), mm
        c, in the true head frame: the rigid markers' centroid, say.
    ok : array_like of bool, shape (F,), optional
        Frames to compare; by default those without NaN in the estimate.

    Returns
    -------
    ndarray, shape (F,), mm, NaN in other frames
    """
    r, t = np.asarray(rotations, dtype=np.float64), np.asarray(translations, dtype=np.float64)
    true_r, true_t = np.asarray(true_rotations, dtype=np.float64), np.asarray(true_translations, dtype=np.float64)
    path = true_r @ np.asarray(point, dtype=np.float64) + true_t
    used = np.isfinite(r).all(axis=(1, 2)) & np.isfinite(t).all(axis=1) if ok is None else np.asarray(ok, dtype=bool)
    out = np.full(len(r), np.nan)
    if used.any():
        r, t, path = r[used], t[used], path[used]
        here = np.linalg.solve(np.einsum("fji,fjk->ik", r, r), np.einsum("fji,fj->i", r, path - t))
        out[used] = np.linalg.norm(r @ here + t - path, axis=1)
    return out


def rms(values: ArrayLike) -> float:
    """Root mean square of the finite values; NaN if there is none."""
    array = np.asarray(values, dtype=np.float64)
    array = array[np.isfinite(array)]
    return float(np.sqrt(np.mean(array**2))) if array.size else float("nan")


def normalised_square(error: ArrayLike, covariance: ArrayLike) -> float:
    """Squared error in units of a stated covariance, per coordinate: ``e' C^-1 e / d``.

    d is the number of coordinates with a finite variance; only those count. If the covariance is honest and the
    error Gaussian, d times this follows a chi-square distribution with d degrees of freedom, and its mean is 1.

    Parameters
    ----------
    error : array_like, shape (n,)
    covariance : array_like, shape (n, n)
        Infinite where nothing is known.

    Returns
    -------
    float
        NaN if no coordinate has a finite variance.
    """
    e, cov = np.asarray(error, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    shown = np.isfinite(np.diag(cov))
    if not shown.any():
        return float("nan")
    return float(e[shown] @ np.linalg.solve(cov[np.ix_(shown, shown)], e[shown])) / int(shown.sum())


def evaluations_to(positions: ArrayLike, evaluations: ArrayLike, target: ArrayLike, tolerance_mm: float) -> float:
    """Evaluations after which the best point of a search has come near a target to stay.

    Parameters
    ----------
    positions : array_like, shape (K, 3), mm
        Best point so far, in order.
    evaluations : array_like, shape (K,)
        Calls of the objective made by then.
    target : array_like, shape (3,), mm
    tolerance_mm : float

    Returns
    -------
    float
        Evaluations at the first point from which all are within the tolerance; NaN if the last one is not.
    """
    x, calls = np.asarray(positions, dtype=np.float64), np.asarray(evaluations, dtype=np.float64)
    near = np.linalg.norm(x - np.asarray(target, dtype=np.float64), axis=1) <= tolerance_mm
    if not near.size or not near[-1]:
        return float("nan")
    return float(calls[len(near) - np.argmin(near[::-1])] if not near.all() else calls[0])


def vertex_error_mm(estimate: ArrayLike, truth: ArrayLike) -> Array:
    """Distance of every vertex from its true place, ``|v_est - v_true|``, without any alignment.

    Parameters
    ----------
    estimate, truth : array_like, shape (F, V, 3), mm

    Returns
    -------
    ndarray, shape (F, V), mm
    """
    difference = np.asarray(estimate, dtype=np.float64) - np.asarray(truth, dtype=np.float64)
    return np.sqrt(np.einsum("fvi,fvi->fv", difference, difference))


def inverted_triangles(vertices: ArrayLike, reference: ArrayLike, triangles: ArrayLike) -> Array:
    """Number of triangles that are turned over: ``n · n_ref < 0`` for the normals n of a triangle.

    Parameters
    ----------
    vertices : array_like, shape (F, V, 3)
    reference : array_like, shape (F, V, 3) or (V, 3)
        The truth, or the rest pose where there is none; triangles without area in it are left out.
    triangles : array_like of int, shape (T, 3)

    Returns
    -------
    ndarray of int, shape (F,)
    """
    t = np.asarray(triangles)
    normal, expected = (_normals(np.asarray(v, dtype=np.float64), t) for v in (vertices, reference))
    return np.asarray((np.einsum("...ti,...ti->...t", normal, expected) < 0.0).sum(axis=-1))


def _normals(vertices: Array, triangles: Array) -> Array:
    a, b, c = (vertices[..., triangles[:, k], :] for k in range(3))
    return np.cross(b - a, c - a)


def lip_penetration_mm(
    vertices: ArrayLike, reference: ArrayLike, lower: ArrayLike, upper: ArrayLike, share: ArrayLike
) -> Array:
    """How deep the lips have gone through each other, at each pair of places that touch at rest.

    ``max(0, min(0, g_ref) - g)`` with the gap ``g = y((1 - s) v[upper_0] + s v[upper_1]) - y(v[lower])``, upward in the
    head's axes; what overlaps in the reference already does not count.

    Parameters
    ----------
    vertices : array_like, shape (F, V, 3), mm
        In the head's axes.
    reference : array_like, shape (F, V, 3) or (V, 3), mm
        The truth, or the rest pose where there is none.
    lower : array_like of int, shape (P,)
        Vertices of the lower lip.
    upper : array_like of int, shape (P, 2)
        The two vertices of the upper lip opposite each.
    share : array_like, shape (P,)
        s: where between the two.

    Returns
    -------
    ndarray, shape (F, P), mm
    """
    low, up, s = np.asarray(lower), np.asarray(upper), np.asarray(share, dtype=np.float64)

    def gap(heights: Array) -> Array:
        return np.asarray(
            (1.0 - s) * heights[..., up[:, 0]] + s * heights[..., up[:, 1]] - heights[..., low], dtype=np.float64
        )

    now, before = (gap(np.asarray(v, dtype=np.float64)[..., 1]) for v in (vertices, reference))
    return np.maximum(0.0, np.minimum(before, 0.0) - now)
