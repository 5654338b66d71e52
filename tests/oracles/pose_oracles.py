"""Slow, obvious versions of the pose estimators: one frame at a time, nothing shared with evalkit."""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.optimize
from scipy.spatial.transform import Rotation


def align_frame(template, observed, weights=None):
    """Rotation and translation of one frame by scipy's own Kabsch, from the markers that are seen."""
    weights = np.ones(len(template)) if weights is None else np.asarray(weights, dtype=float)
    seen = np.isfinite(observed).all(axis=1) & (weights > 0)
    p, x, w = template[seen], observed[seen], weights[seen]
    p_mean = (w[:, None] * p).sum(axis=0) / w.sum()
    x_mean = (w[:, None] * x).sum(axis=0) / w.sum()
    rotation = Rotation.align_vectors(x - x_mean, p - p_mean, weights=w)[0].as_matrix()
    return rotation, x_mean - rotation @ p_mean


def align_frames(template, points, weights=None):
    """:func:`align_frame` over all frames, in a loop."""
    weights = np.ones(len(template)) if weights is None else np.asarray(weights, dtype=float)
    rows = np.broadcast_to(weights, points.shape[:2])
    found = [align_frame(template, x, w) for x, w in zip(points, rows, strict=True)]
    return np.array([r for r, _ in found]), np.array([t for _, t in found])


def minimise_frame(template, observed, start, weights=None):
    """One frame by a general least-squares solver over a rotation vector and a translation.

    The rotation vector is relative to `start`, so that no parametrisation is near its singularity.
    """
    weights = np.ones(len(template)) if weights is None else np.asarray(weights, dtype=float)
    seen = np.isfinite(observed).all(axis=1)

    def difference(parameters):
        rotation = Rotation.from_rotvec(parameters[:3]).as_matrix() @ start
        fitted = template[seen] @ rotation.T + parameters[3:]
        return (np.sqrt(weights[seen])[:, None] * (observed[seen] - fitted)).ravel()

    centre = np.concatenate([np.zeros(3), observed[seen].mean(axis=0) - start @ template[seen].mean(axis=0)])
    found = scipy.optimize.least_squares(
        difference, centre, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale=np.repeat([0.01, 1.0], 3)
    )
    return Rotation.from_rotvec(found.x[:3]).as_matrix() @ start, found.x[3:]


def paper_matrix(template, observed):
    """Eq. (2)-(3) of the paper for one frame, every row of R solved on its own; no projection."""

    def unit(v):
        return v / np.sqrt((v**2).sum())

    p1, p2, p3 = template
    q1, q2, q3 = observed
    m1, m2 = unit(p2 - p1), unit(p3 - p2)
    n1, n2 = unit(q2 - q1), unit(q3 - q2)
    m3, n3 = np.cross(m1, m2), np.cross(n1, n2)
    system = np.array([m1, m2, m3])
    rotation = np.empty((3, 3))
    for row in range(3):
        rotation[row] = np.linalg.solve(system, np.array([n1[row], n2[row], n3[row]]))
    return rotation


def paper_rotation(template, observed):
    """The same, brought to the nearest rotation by scipy's polar decomposition."""
    return scipy.linalg.polar(paper_matrix(template, observed))[0]


def procrustes_mean(points, rounds=200):
    """Mean shape of complete frames: align all to the shape, average, repeat; placed in frame 0's pose."""
    shape = points[0].copy()
    for _ in range(rounds):
        total = np.zeros_like(shape)
        for observed in points:
            rotation, translation = align_frame(shape, observed)
            total += (observed - translation) @ rotation
        shape = total / len(points)
    rotation, translation = align_frame(shape, points[0])
    return shape @ rotation.T + translation


def angle_between(a, b):
    """Angle of ``a b'`` per frame, rad, by scipy's rotation vectors."""
    return np.linalg.norm(Rotation.from_matrix(a @ np.swapaxes(b, -1, -2)).as_rotvec(), axis=-1)
