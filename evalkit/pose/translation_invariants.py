"""The paper's rotation: a linear system in the unit edge vectors of three markers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import EvalkitError, FrameStatus
from evalkit.geometry import Array, nearest_rotation
from evalkit.pose.model import Pose, check, moments


def _edges(points: Array) -> Array:
    """Rows m1 = p1->p2, m2 = p2->p3 of unit length, and the pseudo-correspondence m3 = m1 x m2."""
    edges = np.diff(points, axis=-2)
    edges = edges / np.linalg.norm(edges, axis=-1, keepdims=True)
    return np.concatenate([edges, np.cross(edges[..., 0, :], edges[..., 1, :])[..., None, :]], axis=-2)


def translation_invariants_raw(template: ArrayLike, points: ArrayLike, weights: ArrayLike | None = None) -> Pose:
    """The paper's own matrix, Eq. (2)-(3): rows of R from the 3x3 system in the unit edges. Exactly three markers.

    ``M R' = M'`` where the rows of M and M' are the unit edges before and after. Under noise the result is not
    orthogonal. T follows by substitution into Eq. (1), averaged over the three markers.

    Parameters
    ----------
    template : array_like, shape (3, 3), mm
    points : array_like, shape (F, 3, 3), mm, NaN where missing
    weights : array_like, optional
        Checked, then not used: three edges leave no freedom to weight.

    Raises
    ------
    EvalkitError
        If there are not exactly three markers.

    References
    ----------
    Huang, Lin & Ouhyoung, "High resolution calibration of motion capture data for realistic facial
    animation", J. Software 11 (2000), Eq. (1)-(3); Blostein & Huang, "Algorithms for motion estimation
    based on 3-D correspondences" (1988).
    """
    shape, observed = check(template, points)
    if len(shape) != 3:
        raise EvalkitError(f"translation-invariants takes exactly three rigid markers, not {len(shape)}; name three")
    sums = moments(shape, observed, weights)
    if weights is not None:
        sums = moments(shape, observed, (np.asarray(weights) > 0).astype(float))
    ok = sums.status == FrameStatus.OK
    r = np.full((len(observed), 3, 3), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        if ok.any():
            r[ok] = np.linalg.solve(_edges(shape), _edges(observed[ok])).transpose(0, 2, 1)
    # Two markers at one place have no direction between them.
    bad = ok & ~np.isfinite(r).all(axis=(1, 2))
    sums.status[bad] = FrameStatus.COLLINEAR
    return sums.pose(r)


def translation_invariants(template: ArrayLike, points: ArrayLike, weights: ArrayLike | None = None) -> Pose:
    """The paper's matrix projected onto the nearest rotation (polar factor). Exactly three markers.

    Parameters, errors and references as in :func:`translation_invariants_raw`.
    """
    raw = translation_invariants_raw(template, points, weights)
    sums = moments(raw.template, points, raw.weights)
    sums.status[:] = raw.status
    return sums.pose(nearest_rotation(raw.rotations))
