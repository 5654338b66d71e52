"""Slow, obvious versions of factorisation and alignment: one frame at a time, nothing shared with evalkit."""

from __future__ import annotations

import itertools

import numpy as np
import scipy.linalg
from scipy.spatial.transform import Rotation


def mixed_shapes(frames, markers, count, seed, degrees=25.0, noise=0.0, first_mm=0.0):
    """Points (F, M, 3) ``R_f sum_l c_fl B_l + t_f`` of random full-rank bases; their rotations and shapes.

    ``first_mm`` makes the first basis a constant shape of that size, as a face has one.
    """
    rng = np.random.default_rng(seed)
    bases = rng.normal(scale=5.0, size=(count, markers, 3))
    amounts = rng.normal(size=(frames, count))
    if first_mm:
        bases[0] *= first_mm / 5.0
        amounts[:, 0] = 1.0
    rotations = Rotation.from_rotvec(np.radians(degrees) * rng.normal(size=(frames, 3))).as_matrix()
    shapes = np.tensordot(amounts, bases, axes=1)
    points = np.einsum("fij,fmj->fmi", rotations, shapes) + rng.normal(scale=100.0, size=(frames, 1, 3))
    return points + noise * rng.normal(size=points.shape), rotations, shapes


def factor_of(points, count):
    """Rows (F, 3, 3L) of the left factor of the centred positions, by the whole decomposition."""
    matrix = np.vstack([(frame - frame.mean(axis=0)).T for frame in points])
    left, size, _ = np.linalg.svd(matrix, full_matrices=False)
    return (left[:, : 3 * count] * size[: 3 * count]).reshape(len(points), 3, 3 * count)


def rotations_frame_by_frame(factor, chosen):
    """Rotations against that of the first chosen frame, (F, 3, 3), from exact data.

    Every frame's block against the first chosen frame is d R_f R_1'; its amount is the cube root of its determinant.
    """
    inverse = scipy.linalg.inv(np.vstack([factor[k] for k in chosen]))
    found = []
    for rows in factor:
        block = (rows @ inverse)[:, :3]
        amount = np.cbrt(np.linalg.det(block))
        found.append(block / amount if abs(amount) > 1e-6 else np.full((3, 3), np.nan))
    return np.array(found)


def rotation_constraints(factor):
    """Matrix of the linear constraints ``Q_f H Q_f' = number * I`` on the upper triangle of a symmetric H.

    Returns the matrix and the pairs (i, j) that its columns stand for.
    """
    size = factor.shape[2]
    pairs = list(itertools.combinations_with_replacement(range(size), 2))
    rows = []
    for q in factor:
        for a, b, c, d in ((0, 1, None, None), (0, 2, None, None), (1, 2, None, None), (0, 0, 1, 1), (0, 0, 2, 2)):
            row = []
            for i, j in pairs:
                value = q[a, i] * q[b, j] + (q[a, j] * q[b, i] if i != j else 0.0)
                if c is not None:
                    value -= q[c, i] * q[d, j] + (q[c, j] * q[d, i] if i != j else 0.0)
                row.append(value)
            rows.append(row)
    return np.array(rows), pairs


def weighted_alignment(points, noise, rounds=60):
    """Rotations of frames laid on their mean shape, weights 1 / (variance + noise²) made anew; all markers seen."""
    template, weights = points[0].copy(), np.ones(points.shape[1])
    for _ in range(rounds):
        for _ in range(30):
            still = []
            rotations = []
            p = template - (weights[:, None] * template).sum(axis=0) / weights.sum()
            for frame in points:
                x = frame - (weights[:, None] * frame).sum(axis=0) / weights.sum()
                turn = Rotation.align_vectors(x, p, weights=weights)[0].as_matrix()
                rotations.append(turn)
                still.append(x @ turn)
            change = np.abs(np.mean(still, axis=0) - p).max()
            template = np.mean(still, axis=0)
            if change < 1e-9:
                break
        before, weights = weights, 1.0 / (np.var(still, axis=0).mean(axis=1) + noise**2)
        weights /= weights.max()
        if np.abs(weights - before).max() < 1e-9:
            break
    return np.array(rotations)


def most_probable_amounts(row, axes, spread, rest):
    """Amounts a that minimise ``|x - A a|² / rest + sum a² / spread`` over the values of a row that are seen."""
    seen = np.isfinite(row)
    stacked = np.vstack([axes[seen] / np.sqrt(rest), np.diag(1.0 / np.sqrt(spread))])
    return scipy.linalg.lstsq(stacked, np.concatenate([row[seen] / np.sqrt(rest), np.zeros(len(spread))]))[0]
