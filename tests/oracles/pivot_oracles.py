"""Slow, obvious versions of the pivot estimators and the paper's objective; nothing shared with evalkit."""

from __future__ import annotations

import math

import numpy as np
import scipy.optimize


def paper_objective(
    points, candidate, reference, origin, weights=(1.0, 1.0, 1.0), length_scale=100.0, pull_scale=100.0
):
    """Eq. (5), term by term; `reference` is a frame, "mean" or "median"; missing markers have no terms."""
    frames, markers = points.shape[:2]
    angle = [[math.nan] * markers for _ in range(frames)]
    length = [[math.nan] * markers for _ in range(frames)]
    for i in range(frames):
        for j in range(markers):
            arm, after = points[i, j] - candidate, points[i, (j + 1) % markers] - candidate
            length[i][j] = math.sqrt(arm @ arm)
            cosine = arm @ after / (math.sqrt(arm @ arm) * math.sqrt(after @ after))
            angle[i][j] = math.acos(max(-1.0, min(1.0, cosine))) if math.isfinite(cosine) else math.nan
    total = weights[2] * math.sqrt(((candidate - origin) ** 2).sum()) / pull_scale
    for j in range(markers):
        for values, weight in ((angle, weights[0] * length_scale), (length, weights[1])):
            column = [values[i][j] for i in range(frames)]
            known = [v for v in column if math.isfinite(v)]
            if isinstance(reference, str):
                compared = sum(known) / len(known) if reference == "mean" else float(np.median(known))
            else:
                compared = column[reference]
            for v in known:
                total += weight * abs(v - compared)
    return total


def squared_objective(points, candidate, origin, weights=(1.0, 1.0, 1.0), length_scale=100.0, pull_scale=100.0):
    """The squared variant of Eq. (5) about the mean over frames."""
    arm = points - candidate
    length = np.linalg.norm(arm, axis=2)
    after = np.roll(arm, -1, axis=1)
    angle = np.arctan2(np.linalg.norm(np.cross(arm, after), axis=2), (arm * after).sum(axis=2))
    return (
        weights[0] * length_scale**2 * ((angle - angle.mean(axis=0)) ** 2).sum()
        + weights[1] * ((length - length.mean(axis=0)) ** 2).sum()
        + weights[2] * ((candidate - origin) ** 2).sum() / pull_scale**2
    )


def finite_difference(function, at, step=1e-3):
    """Gradient by central differences."""
    gradient = np.empty(3)
    for k in range(3):
        up, down = at.copy(), at.copy()
        up[k] += step
        down[k] -= step
        gradient[k] = (function(up) - function(down)) / (2 * step)
    return gradient


def second_difference(function, at, step=0.05):
    """Matrix of second derivatives, the gradient's central differences."""
    columns = []
    for unit in np.eye(3):
        up, down = (finite_difference(function, at + sign * step * unit, step) for sign in (1, -1))
        columns.append((up - down) / (2 * step))
    return np.array(columns)


def pivot_least_squares(rotations, translations):
    """``(I - R_i) O = T_i`` stacked row by row."""
    rows, right = [], []
    for r, t in zip(rotations, translations, strict=True):
        for k in range(3):
            rows.append(np.eye(3)[k] - r[k])
            right.append(t[k])
    return np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0]


def symmetric_centre(rotations, translations):
    """Two centres, one fixed in the head, one in the world: ``R_i b + T_i = a``; gives a."""
    rows, right = [], []
    for r, t in zip(rotations, translations, strict=True):
        rows.append(np.hstack([np.eye(3), -r]))
        right.append(t)
    return np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)[0][:3]


def sphere_fit(points, start):
    """Centre with every radius as an unknown of its own, by a general solver."""
    origin = points.reshape(-1, 3).mean(axis=0)

    def difference(parameters):
        return (np.linalg.norm(points - origin - parameters[:3], axis=2) - parameters[3:]).ravel()

    radii = np.linalg.norm(points - start, axis=2).mean(axis=0)
    found = scipy.optimize.least_squares(
        difference, np.concatenate([start - origin, radii]), xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    return origin + found.x[:3]


def gamage_lasenby(points):
    """Eq. (6) of Gamage & Lasenby (2002) by loops, without bias correction."""
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for j in range(points.shape[1]):
        marker = points[:, j]
        mean = sum(marker) / len(marker)
        mean_square = sum(v @ v for v in marker) / len(marker)
        mean_cube = sum(v * (v @ v) for v in marker) / len(marker)
        normal += 2.0 * (sum(np.outer(v, v) for v in marker) / len(marker) - np.outer(mean, mean))
        right += mean_cube - mean * mean_square
    return np.linalg.solve(normal, right)


def gamage_lasenby_corrected(points, sigma):
    """The same with the expectation of white noise of known sigma taken out (Halvorsen 2003).

    With x = y + e: E[x x'] grows by sigma² I, E[x |x|²] by 5 sigma² E[y], and E[x] E[|x|²] by 3 sigma² E[y].
    """
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for j in range(points.shape[1]):
        marker = points[:, j]
        mean = sum(marker) / len(marker)
        mean_square = sum(v @ v for v in marker) / len(marker)
        mean_cube = sum(v * (v @ v) for v in marker) / len(marker)
        second = sum(np.outer(v, v) for v in marker) / len(marker)
        normal += 2.0 * (second - sigma**2 * np.eye(3) - np.outer(mean, mean))
        right += (mean_cube - 5 * sigma**2 * mean) - mean * (mean_square - 3 * sigma**2)
    return np.linalg.solve(normal, right)
