"""Rotations smoothed over time: the most probable trajectory under a spline prior, its strength from the data."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from evalkit.geometry import Array, apply_motion, blocks, cross_matrix, rotation_from_vector, rotation_vector
from evalkit.pose.model import Pose, check, whole_markers

MAX_ITERATIONS = 20

TOLERANCE_RAD = 1e-12
"""Largest turn of any frame in the last iteration."""

FEWEST = 4
"""Known frames below which there is no second difference to learn the strength from."""

WEAKEST, STRONGEST = 1e-4, 1e10
"""Range of the prior's weight relative to the mean information of one frame: at one end nothing is smoothed, at the
other everything below a cycle in some 2,000 frames remains; beyond it the arithmetic would run out of digits."""

STEP = 2.0
"""Of the first search of the strength, in its logarithm."""

NOISELESS_RAD = 1e-9
"""Noise of the rotation below which it is rounding, and nothing is smoothed."""


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A smoothed trajectory, and what was done to the measured one.

    Attributes
    ----------
    pose : Pose
        Status as measured. Frames whose pose is not known hold the bridge between their neighbours if that was
        asked for, and NaN otherwise.
    acceleration_deg_s2 : float
        Strength of the prior: standard deviation per axis of the angular acceleration that it allows, deg/s²; the
        smaller, the smoother. Infinite if nothing was smoothed.
    noise_mm : float
        Noise of a rigid marker of unit weight per axis, from the residuals.
    freedom : float
        Effective degrees of freedom, the trace of the influence matrix: 3 for every known frame if nothing is
        smoothed, down to 6 for a head that turns evenly.
    measured_deg, smoothed_deg : float
        Predicted root-mean-square rotation error over the known frames, before and after, deg. A mean over the
        take: in stillness the error is smaller, in nods much faster than the rest it is larger.
    iterations : int
    """

    pose: Pose
    acceleration_deg_s2: float
    noise_mm: float
    freedom: float
    measured_deg: float
    smoothed_deg: float
    iterations: int


def smooth(
    pose: Pose, points: ArrayLike, *, rate: float = 60.0, about: ArrayLike | None = None, bridge: bool = True
) -> Smoothed:
    """Most probable trajectory of the head's rotation, given that of every frame by itself.

    Minimises over the rotations R_i of all frames

        ``sum_i d_i' (J_i / sigma²) d_i + sum_i |w_{i+1} - w_i|² / q``, ``d_i = log(R_i' Rhat_i)``,
        ``w_i = log(R_i' R_{i+1})``,

    with Rhat_i the measured rotation, ``J_i = sum_m |x|² I - x x'`` the inertia of the markers seen in frame i (in
    head axes, so that ``sigma² J_i^-1`` is the covariance of Rhat_i), sigma² their noise, from the residuals, and
    w_i the turn from one frame to the next. The acceleration is taken as white with variance q, a cubic smoothing
    spline on SO(3); q is that of greatest marginal likelihood. Gauss-Newton, to first order in the noise of a frame,
    every step one banded solve: cost and memory are linear in frames.

    It is an option and no default. One q holds for the whole take, so a movement much faster than the rest loses
    some of its peak; the errors it leaves are correlated over frames; and an error that is itself smooth, skin that
    slides for one, passes as motion.

    Parameters
    ----------
    pose : Pose
        Rotations proper; not the paper's raw matrix.
    points : array_like, shape (F, M, 3), mm
        The rigid markers that the pose was fitted to, NaN where missing.
    rate : float
        Hz; only the unit of the reported acceleration depends on it.
    about : array_like, shape (3,), mm, optional
        The point in the template's coordinates whose path through the world is kept, and about which the inertia is
        taken: for poses turned about a pivot, that pivot. By default the centroid of the markers seen.
    bridge : bool
        Give frames whose pose is not known the most probable rotation, with the kept point interpolated linearly.

    Returns
    -------
    Smoothed
        With fewer than four known frames, or without noise, the pose as it was.

    Raises
    ------
    EvalkitError
        If shapes do not fit.

    Notes
    -----
    Rotation error in deg (rms over 20 takes of ``talking``, forehead triangle, 60 Hz), by each frame, smoothed, turned
    about the pivot (``joint``), and both; ``pytest -m slow tests/test_smooth.py -k table`` prints all of it:

    ============= ===== ========== ========== ========== ==========
    speed, deg/s  noise each frame smoothed   joint      both
    ============= ===== ========== ========== ========== ==========
    30            0.3   0.99       0.29       0.47       0.15
    100           0.3   0.98       0.36       0.46       0.18
    400           0.3   0.99       0.43       0.46       0.21
    400           0.1   0.33       0.18       0.16       0.09
    ============= ===== ========== ========== ========== ==========

    A nod of 0.2 s within 20 s of stillness, at 0.3 mm, is off by 5 deg where each frame by itself is off by 1.

    References
    ----------
    Wahba, "Improper priors, spline smoothing and the problem of guarding against model errors in regression",
    J. R. Stat. Soc. B 40 (1978), doi:10.1111/j.2517-6161.1978.tb01050.x, the spline as a posterior mean; Wecker &
    Ansley, "The signal extraction approach to nonlinear regression and spline smoothing", J. Am. Stat. Assoc. 78
    (1983), doi:10.1080/01621459.1983.10477935, its strength by likelihood; Barfoot, Tong & Sarkka, "Batch
    continuous-time trajectory estimation as exactly sparse Gaussian process regression", RSS (2014),
    doi:10.15607/RSS.2014.X.001, the same prior for poses.
    """
    x = whole_markers(check(pose.template, points)[1])
    weights = np.where(np.isfinite(x[:, :, 0]) & pose.ok[:, None], np.broadcast_to(pose.weights, x.shape[:2]), 0.0)
    centre = None if about is None else np.asarray(about, dtype=np.float64)
    inertia, middle = _inertia(pose.template, weights, centre)
    noise_mm = _noise(pose, x, weights, turned=centre is not None)
    del points, x, weights
    known = np.flatnonzero(pose.ok)
    variances = noise_mm**2 * np.trace(np.linalg.inv(inertia[known]), axis1=1, axis2=2)
    measured = float(np.sqrt(variances.mean())) if len(known) else np.nan
    if len(known) < FEWEST or not measured > NOISELESS_RAD:
        return Smoothed(pose, np.inf, noise_mm, 3.0 * len(known), np.degrees(measured), np.degrees(measured), 0)
    inertia /= noise_mm**2
    problem = _Problem(_bridged(pose.rotations, known), inertia)
    path, strength, iterations = problem.solved()
    freedom, variance = problem.spread(path, strength, known)
    acceleration = float(np.degrees(rate**2 / np.sqrt(strength)))
    own = replace(pose, rotations=path, translations=_translations(pose, path, middle, known))
    if not bridge:
        lost = ~pose.ok[:, None]
        own = replace(
            own,
            rotations=np.where(lost[:, :, None], np.nan, own.rotations),
            translations=np.where(lost, np.nan, own.translations),
        )
    return Smoothed(
        own, acceleration, noise_mm, freedom, np.degrees(measured), float(np.degrees(np.sqrt(variance))), iterations
    )


def _inertia(template: Array, weights: Array, about: Array | None) -> tuple[Array, Array]:
    """Weighted inertia (F, 3, 3) about the point kept in each frame, zero without markers, and the point (F, 3)."""
    shape = np.where(np.isfinite(template), template, 0.0)
    total = weights.sum(axis=1)
    mean = (weights @ shape) / np.maximum(total, 1e-300)[:, None]
    mean[total == 0] = shape.mean(axis=0)
    middle = mean if about is None else np.broadcast_to(about, mean.shape)
    origin = shape.mean(axis=0)
    arms, offset = shape - origin, middle - origin
    # sum w (a - o)(a - o)' from the moments about a near origin, which keeps the digits.
    second = (weights @ np.einsum("mi,mj->mij", arms, arms).reshape(len(arms), 9)).reshape(-1, 3, 3)
    first = np.einsum("fi,fj->fij", weights @ arms, offset)
    second = second - first - first.transpose(0, 2, 1) + total[:, None, None] * offset[:, :, None] * offset[:, None, :]
    return np.trace(second, axis1=1, axis2=2)[:, None, None] * np.eye(3) - second, middle


def _noise(pose: Pose, points: Array, weights: Array, turned: bool) -> float:
    """Standard deviation per axis of a marker of unit weight, mm: each frame's pose takes three or six freedoms."""
    square = 0.0
    for part in blocks(len(points)):
        fitted = apply_motion(pose.rotations[part], pose.translations[part], pose.template)
        residual = np.nan_to_num(points[part] - fitted)
        square += float(np.einsum("fm,fmi,fmi->", weights[part], residual, residual))
    frames = int((weights > 0).any(axis=1).sum())
    freedom = 3 * int((weights > 0).sum()) - (3 if turned else 6) * frames
    return float(np.sqrt(square / max(freedom, 1)))


def _bridged(rotations: Array, known: np.ndarray) -> Array:
    """Rotations with the missing ones between two known turned evenly, and held before the first and last."""
    if len(known) == len(rotations):
        return rotations
    frames = np.arange(len(rotations))
    after = np.searchsorted(known, frames).clip(0, len(known) - 1)
    before = (np.searchsorted(known, frames, side="right") - 1).clip(0)
    first, last = rotations[known[before]], rotations[known[after]]
    span = np.maximum(known[after] - known[before], 1)
    part = np.where(known[after] > known[before], (frames - known[before]) / span, 0.0)
    turn = rotation_vector(first.transpose(0, 2, 1) @ last)
    path = first @ rotation_from_vector(part[:, None] * turn)
    path[known] = rotations[known]
    return path


def _translations(pose: Pose, rotations: Array, middle: Array, known: np.ndarray) -> Array:
    """Translations (F, 3) that keep the path of the middle (F, 3), interpolated where it is not known."""
    out = np.empty(middle.shape)
    at = middle[known]
    placed = np.einsum("fij,fj->fi", pose.rotations[known], at) + pose.translations[known]
    # Between known frames one and the same point of the head has to be followed.
    fixed = middle.mean(axis=0)
    path = np.einsum("fij,j->fi", rotations[known], fixed) - np.einsum("fij,fj->fi", rotations[known], at) + placed
    for axis in range(3):
        out[:, axis] = np.interp(np.arange(len(out)), known, path[:, axis])
    return out - np.einsum("fij,j->fi", rotations, fixed)


class _Problem:
    """The posterior of a trajectory (F, 3, 3) and of its strength, the prior's weight ``1 / q`` in rad^-2 per frame."""

    def __init__(self, measured: Array, information: Array) -> None:
        self.measured, self.information = measured, information
        self.scale = float(np.trace(information, axis1=1, axis2=2).mean()) / 3.0

    def solved(self) -> tuple[Array, float, int]:
        """Path of greatest posterior density, strength and iterations."""
        path = self.measured.copy()
        low, high = np.log(self.scale * np.array([WEAKEST, STRONGEST]))
        log_strength = np.nan
        for iteration in range(1, MAX_ITERATIONS + 1):
            step, deviance = self._linearised(path)
            # The second search sees the curvature of a smooth path; later changes of the path are too small to matter.
            if iteration == 1:
                log_strength = _minimum(deviance, np.arange(low, high, STEP))
            elif iteration == 2:
                log_strength = _minimum(deviance, log_strength + np.array([-0.5, 0.0, 0.5]))
            turn = step(log_strength)
            for part in blocks(len(path)):
                path[part] = path[part] @ rotation_from_vector(turn[part])
            if np.abs(turn).max() < TOLERANCE_RAD:
                break
        return path, float(np.exp(log_strength)), iteration

    def spread(self, path: Array, strength: float, known: np.ndarray) -> tuple[float, float]:
        """Effective degrees of freedom, and mean trace of the posterior covariance over the known frames, rad².

        Both are traces of an inverse that is full: ``tr(H^-1 A) = d log|H + t A| / dt`` needs only determinants.
        """
        prior = _normal(_turns(path))

        def log_determinant(more: float, alike: float) -> float:
            bands = self._posterior(prior, strength, 1.0 + more)
            bands[0].reshape(-1, 3)[known] += alike
            return 2.0 * float(np.log(_factor(bands)[0]).sum())

        t, s = 1e-3, 1e-3 * float(np.linalg.eigvalsh(self.information[known])[:, 0].min())
        freedom = (log_determinant(t, 0.0) - log_determinant(-t, 0.0)) / (2.0 * t)
        return freedom, (log_determinant(0.0, s) - log_determinant(0.0, -s)) / (2.0 * s) / len(known)

    def _posterior(self, prior: Array, strength: float, part: float = 1.0) -> Array:
        """Lower bands (9, 3 F) of the data's information, or a part of it, and of the prior's."""
        bands = np.multiply(strength, prior, order="F")
        _add(bands, part * self.information, 0)
        return bands

    def _linearised(self, path: Array) -> tuple[Callable[[float], Array], Callable[[float], float]]:
        """Gauss-Newton step (F, 3) from a path, and twice the negative log marginal likelihood, by log strength."""
        from scipy.linalg import cho_solve_banded

        offset = np.empty(path.shape[:2])
        for part in blocks(len(path)):
            offset[part] = rotation_vector(path[part].transpose(0, 2, 1) @ self.measured[part])
        pull = np.einsum("fij,fj->fi", self.information, offset)
        turns = _turns(path)
        bend, push = np.diff(turns, axis=0), np.zeros_like(offset)
        for start, derivatives in _derivatives(turns):
            for k, block in enumerate(derivatives, start):
                push[k : k + len(block)] -= np.einsum("fji,fj->fi", block, bend[start : start + len(block)])
        prior = _normal(turns)

        def solve(log_strength: float) -> tuple[Array, float]:
            strength = np.exp(log_strength)
            factor = _factor(self._posterior(prior, strength))
            right = (pull + strength * push).ravel()
            turn = cho_solve_banded((factor, True), right, overwrite_b=True, check_finite=False)
            return turn.reshape(-1, 3), 2.0 * float(np.log(factor[0]).sum())

        def deviance(log_strength: float) -> float:
            turn, log_determinant = solve(log_strength)
            bent = bend.copy()
            for start, derivatives in _derivatives(turns):
                for k, block in enumerate(derivatives, start):
                    bent[start : start + len(block)] += np.einsum("fij,fj->fi", block, turn[k : k + len(block)])
            left = turn - offset
            cost = np.einsum("fi,fij,fj->", left, self.information, left) + np.exp(log_strength) * (bent**2).sum()
            # The prior says nothing of six freedoms, an even turn: its determinant is that of the others.
            return float(cost + log_determinant - 3 * len(bend) * log_strength)

        return lambda log_strength: solve(log_strength)[0], deviance


def _turns(path: Array) -> Array:
    """Turns from one frame to the next, shape (F - 1, 3), rad."""
    turns = np.empty((len(path) - 1, 3))
    for part in blocks(len(turns)):
        turns[part] = rotation_vector(path[part].transpose(0, 2, 1) @ path[part.start + 1 : part.stop + 1])
    return turns


def _derivatives(turns: Array) -> Iterator[tuple[int, tuple[Array, Array, Array]]]:
    """Derivatives (B, 3, 3) of ``w_{i+1} - w_i`` by turns of its three frames, in runs from frame ``start``.

    ``log(exp(-a) exp(w) exp(b)) = w + (I + [w]x / 2) b - (I - [w]x / 2) a`` but for parts of w² / 12, which is a
    ten-thousandth where the head turns by 2 deg from one frame to the next.
    """
    one = np.eye(3)
    for part in blocks(len(turns) - 1):
        half = 0.5 * cross_matrix(turns[part.start : part.stop + 1])
        yield part.start, (one - half[:-1], half[1:] - half[:-1] - 2.0 * one, one + half[1:])


def _normal(turns: Array) -> Array:
    """Lower bands (9, 3 F) of ``D' D`` for the matrix D of the second difference's derivatives."""
    bands = np.zeros((9, 3 * (len(turns) + 1)), order="F")
    for start, derivatives in _derivatives(turns):
        for later in range(3):
            for earlier in range(later + 1):
                product = derivatives[later].transpose(0, 2, 1) @ derivatives[earlier]
                _add(bands[:, 3 * (start + earlier) :], product, later - earlier)
    return bands


def _add(bands: Array, blocks: Array, apart: int) -> None:
    """Add 3 x 3 blocks (N, 3, 3), ``apart`` block rows below the diagonal, to lower bands, the first at its start."""
    for row in range(3):
        for column in range(3):
            band = 3 * apart + row - column
            if band >= 0:
                bands[band, column : column + 3 * len(blocks) : 3] += blocks[:, row, column]


def _factor(bands: Array) -> Array:
    """Cholesky factor of a matrix in lower bands; in their place if they are in Fortran's order."""
    from scipy.linalg import cholesky_banded

    return np.asarray(cholesky_banded(bands, overwrite_ab=True, lower=True, check_finite=False))


def _minimum(function: Callable[[float], float], grid: Array) -> float:
    """Where a function of one variable is least: the best of a grid, then within its neighbours."""
    from scipy.optimize import minimize_scalar

    best = float(grid[int(np.argmin([function(float(at)) for at in grid]))])
    step = float(grid[1] - grid[0])
    found = minimize_scalar(function, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-3})
    return float(found.x)
