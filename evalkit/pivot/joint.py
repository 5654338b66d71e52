"""Maximum likelihood for shape, pivot, sway and every rotation together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import EvalkitError
from evalkit.geometry import Array, blocks
from evalkit.pivot.algebraic import score
from evalkit.pivot.bound import inertia
from evalkit.pivot.information import Information, information
from evalkit.pivot.model import Motion, Pivot, block_covariance, judge, motion_spread
from evalkit.pivot.spline import Basis, constant, cubic, roughness
from evalkit.pose.model import Pose
from evalkit.pose.qcp import best_rotations
from evalkit.pose.reference import Reference

MAX_ITERATIONS = 50
TOLERANCE = 1e-8
"""Relative fall of the sum of squares at which the iteration stops: a thousandth of what one parameter is worth."""

COARSEST = 4
"""Fewest spans of a spline that is tried as sway."""

CHOICE_FRAMES = 20_000
"""Frames, spread evenly, on which the sway is chosen; the fit itself takes all."""

SLOWEST_S = 8.0
"""Widest knots tried in long takes, s."""

ALWAYS_S = 1.5
"""Knots down to this spacing are tried whatever the coarser ones showed, s."""

FINEST_S = 0.25
"""Closest knots tried, s: a torso has no faster motion of its own, and noise has."""

FREE_MM2 = 1e9
"""Variance that stands for no knowledge at all, mm²."""

OUTLIER = 0.1
"""Part of its weight below which a robust fit has left a sample out."""

INFLATED = 1.5
"""Ratio of the scatter between stretches of time to that of white noise above which it is believed; white noise
passes it once in a few hundred takes."""


@dataclass(frozen=True, eq=False)
class Fit:
    """One maximum-likelihood fit: ``x = R p + c``.

    Attributes
    ----------
    rotations : ndarray, shape (F, 3, 3)
    shape : ndarray, shape (M, 3), mm
        p, markers about the pivot in head axes.
    coefficients : ndarray, shape (K, 3), mm
        Of the pivot's path c.
    basis : Basis
    cost : float
        Weighted sum of squared residuals.
    observations, parameters : int
        Coordinates less the turns of the frames, and parameters of shape and path.
    iterations : int
    converged : bool
    matrix : Information
        At the solution, in units of ``unit``.
    """

    rotations: Array
    shape: Array
    coefficients: Array
    basis: Basis
    cost: float
    observations: int
    parameters: int
    iterations: int
    converged: bool
    matrix: Information

    def criterion(self, price: float) -> float:
        """``n log(cost / n) + price k``: Akaike's criterion for a price of 2, Schwarz's for ``log n``."""
        n = max(self.observations, 1)
        return n * float(np.log(max(self.cost, 1e-300) / n)) + price * self.parameters


def joint(
    points: Array,
    pose: Pose,
    *,
    sway: str | float = "auto",
    rate: float = 60.0,
    weights: ArrayLike | None = None,
    robust: bool = False,
    prior: tuple[ArrayLike, ArrayLike] | None = None,
    reference: Reference = "mean",
    **_: object,
) -> Pivot:
    """Maximum likelihood for shape, pivot, sway and rotations under white noise of each marker's own size.

    Minimises ``sum_ij w_ij |x_ij - R_i p_j - c_i|²`` over the shape p, the rotations R_i and the path
    ``c_i = O + s_i`` of the pivot: a point, or a cubic B-spline. The rotations are eliminated in every frame
    (variable projection), shape and path follow by Gauss-Newton with Levenberg's damping from the solution of
    ``score``; the cost of an iteration is linear in frames.

    Parameters
    ----------
    points : ndarray, shape (F, M, 3), mm
        Rigid markers in world axes, NaN where missing.
    pose : Pose
        Where to start, and which frames can be used.
    sway : "auto", "none" or float
        Path of the pivot: a point, a spline with knots so many seconds apart, or a choice. A spline is chosen
        only if one of those tried, knots halved again and again, beats the point by the criterion of Schwarz
        (1978, doi:10.1214/aos/1176344136), which rarely sees a sway where there is none; which one, by that of
        Akaike (1974, doi:10.1109/TAC.1974.1100705), since knots too far apart cost more than knots too close.
    rate : float
        Hz.
    weights : array_like, shape (M,), optional
        Relative inverse variances of the markers; those of the pose if not given.
    robust : bool
        Re-weight every marker in every frame by the Geman-McClure loss at four times its noise.
    prior : (mean, covariance), optional
        What anatomy says of the pivot's position, mm and mm², world axes; combined with what the take says,
        each by its covariance. An axis that the motion does not show takes the coordinate of the prior; its
        variance stays infinite, since the take said nothing.
    reference : "mean", "median" or int
        Whether the pivot is reported at its mean position or at that of a frame.

    Returns
    -------
    Pivot
        With the pose of every frame turned about the pivot, and the sway. Its covariance is the inverse of the
        normal matrix, scaled up where stretches of time scatter more than white noise would let them.

    Raises
    ------
    EvalkitError
        If fewer than two frames have a pose, or the sway is not one of the above.

    References
    ----------
    Golub & Pereyra, "The differentiation of pseudo-inverses and nonlinear least squares problems whose
    variables separate", SIAM J. Numer. Anal. 10 (1973), doi:10.1137/0710036; Triggs et al. (2000),
    doi:10.1007/3-540-44480-7_21.
    """
    if isinstance(sway, str) and sway not in ("auto", "none"):
        raise EvalkitError(f"sway '{sway}' is not known; use auto, none or a knot spacing in seconds")
    motion = motion_spread(points, pose)
    hidden = motion.hidden_in_world
    start = score(points, pose)
    position = start.position
    if prior is not None:
        # A walking performer's algebraic pivot may lie metres away; what it is worth, its covariance knows.
        mean, wide = (np.asarray(part, dtype=np.float64) for part in prior)
        spread = np.where(np.isfinite(start.covariance), start.covariance, 0.0) + FREE_MM2 * hidden.T @ hidden
        position = position + spread @ np.linalg.solve(spread + wide, mean - position)
    used = np.flatnonzero(pose.ok)
    x = points[used] if len(used) < len(points) else points
    given = pose.weights if weights is None else np.asarray(weights, dtype=np.float64)
    given = given[used] if given.ndim == 2 and len(given) == len(points) and len(used) < len(points) else given
    w = _seen_weights(x, given)
    # About the start and in units of the lever arm, so that the normal matrix is near one whatever the laboratory.
    origin = position
    arms = pose.template - _head_pivot(pose, origin)
    unit = max(float(np.linalg.norm(arms, axis=1).mean()), 1e-9)
    x = x - origin
    x /= unit
    x[~np.isfinite(x)] = 0.0
    problem = _Problem(x, w, origin, unit, _functional(reference, used), hidden)
    rotations = pose.rotations[used]
    still = Fit(rotations, arms / unit, np.zeros((1, 3)), constant(len(used)), np.inf, 0, 0, 0, False, None)  # type: ignore[arg-type]
    if len(hidden):
        # Poses turned about a pivot at rest are less noisy than free ones, and outliers have lost their weight: what
        # such poses show is shown.
        bold = replace(problem, hidden=hidden[:0])
        trimmed, rest = _fitted(bold, still, used, len(points), rate, "none", robust)
        own = _own_motion(trimmed, rest)
        if rest.converged and own.hidden.sum() < motion.hidden.sum():
            motion, problem = own, replace(problem, hidden=own.hidden_in_world)
    problem, fit = _fitted(problem, still, used, len(points), rate, sway, robust)
    return _reported(points, pose, problem, fit, used, motion, prior)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Points (F, M, 3) about ``origin`` in units of ``unit`` mm, zero where missing, their weights, the frame in which
    the pivot is reported (None: its mean), and the axes (K, 3) along which the motion does not show it.
    """

    points: Array
    weights: Array
    origin: Array
    unit: float
    frame: int | None
    hidden: Array

    def part(self, frames: np.ndarray) -> _Problem:
        """The same problem on some of the frames, for choosing between models."""
        if len(frames) == len(self.points):
            return self
        weights = self.weights[frames] if self.weights.ndim == 2 else self.weights
        return replace(self, points=self.points[frames], weights=weights, frame=None)


def _seen_weights(x: Array, given: Array) -> Array:
    """Weights (M,) where every marker is seen, else (F, M) with zeros where not; the largest is one."""
    seen = np.isfinite(x[:, :, 0])
    scaled = given / given.max()
    return scaled if seen.all() and scaled.ndim == 1 else np.where(seen, scaled, 0.0)


def _functional(reference: Reference, used: np.ndarray) -> int | None:
    if isinstance(reference, str):
        return None
    at = np.flatnonzero(used == reference)
    if not len(at):
        raise EvalkitError(f"reference frame {reference} has no head pose; choose another frame, or mean")
    return int(at[0])


def _head_pivot(pose: Pose, position: Array) -> Array:
    """The pivot in the template's coordinates: the mean of ``R' (O - T)`` over the frames."""
    r, t = pose.rotations[pose.known], pose.translations[pose.known]
    return np.einsum("fji,fj->i", r, position - t) / len(r)


def _fitted(
    problem: _Problem, start: Fit, used: np.ndarray, frames: int, rate: float, sway: str | float, robust: bool
) -> tuple[_Problem, Fit]:
    """The fit, and the problem without the samples that it found to be outliers."""
    fit = _choose(problem, start, used, frames, rate, sway)
    return _robust(problem, fit) if robust else (problem, fit)


def _own_motion(problem: _Problem, fit: Fit) -> Motion:
    """What the rotations of a fit say about the pivot, by the noise that is left in them: ``sigma² J_p^-1``.

    Like :func:`evalkit.pivot.model.motion_spread` for free poses, whose rotations have the noise ``sigma² J_c^-1``.
    """
    share = problem.weights if problem.weights.ndim == 1 else problem.weights.mean(axis=0)
    lever = inertia(fit.shape * np.sqrt(share)[:, None])
    noise = fit.cost / max(fit.observations - fit.parameters, 1) * np.linalg.pinv(lever, hermitian=True)
    frames, mean = len(fit.rotations), fit.rotations.mean(axis=0)
    floor = frames * (np.trace(noise) * np.eye(3) - noise)
    spread = frames * (np.eye(3) - mean.T @ mean) - floor
    turn, axes = np.linalg.eigh(spread)
    along = np.einsum("ik,ij,jk->k", axes, floor, axes)
    hidden = turn <= 4.0 * np.sqrt(2.0 / frames) * along + 1e-12 * frames
    return Motion(spread, floor, mean, frames, turn, axes, hidden)


def _choose(problem: _Problem, start: Fit, used: np.ndarray, frames: int, rate: float, sway: str | float) -> Fit:
    """The fit with the sway asked for, or the one of smallest criterion among ever finer splines."""
    if sway == "none":
        return _fit(problem, start)
    if not isinstance(sway, str):
        return _fit(problem, _on(start, problem, cubic(frames, rate, float(sway)), used))
    some = np.unique(np.linspace(0, len(used) - 1, min(len(used), CHOICE_FRAMES)).astype(int))
    thin, begin = problem.part(some), replace(start, rotations=start.rotations[some])
    begin = replace(begin, basis=constant(len(some)))
    still = last = _fit(thin, begin, max_iterations=10)
    splines: list[tuple[Fit, float]] = []
    seconds = (frames - 1) / rate
    spans = max(COARSEST, int(np.ceil(seconds / SLOWEST_S)))
    # Residuals at the rounding of the arithmetic leave nothing for a sway to explain.
    while still.cost > 1e-24 * still.observations and seconds / spans >= max(FINEST_S, 2.0 / rate):
        finer = cubic(frames, rate, seconds / spans)
        # From the free poses or from the coarser spline; a fit that held a swaying pivot still may be far off.
        starts = [_on(fit, thin, finer, used[some]) for fit in ((begin, last) if splines else (begin,))]
        costs = [_projected(thin, fit.shape, fit.basis.evaluate(fit.coefficients))[2] for fit in starts]
        last = _fit(thin, starts[int(np.argmin(costs))], max_iterations=12, tolerance=1e-3)
        splines.append((last, seconds / spans))
        worse = len(splines) > 1 and last.criterion(2.0) > splines[-2][0].criterion(2.0)
        if worse and seconds / spans < ALWAYS_S:
            break
        spans *= 2
    best, spacing = still, np.inf
    log_n = float(np.log(max(still.observations, 2)))
    if any(fit.criterion(log_n) < still.criterion(log_n) for fit, _ in splines):
        best, spacing = min(splines, key=lambda entry: entry[0].criterion(2.0))
    if len(some) == len(used):
        return _fit(problem, best)
    basis = cubic(frames, rate, spacing) if np.isfinite(spacing) else constant(frames)
    basis = replace(basis, first=basis.first[used], values=basis.values[used])
    return _fit(problem, replace(best, rotations=start.rotations, basis=basis))


def _on(fit: Fit, problem: _Problem, basis: Basis, used: np.ndarray) -> Fit:
    """A start on another basis: the spline nearest to the pivot's path of a fit, or of its rotations alone."""
    from scipy.linalg import solveh_banded

    basis = replace(basis, first=basis.first[used], values=basis.values[used])
    bands = basis.bands(np.ones((len(used), 1)))[:, :, 0]
    bands = bands + 1e-9 * bands[0].max() * roughness(basis.size, len(bands))
    bands[0] += 1e-12 * bands[0].max()
    if np.isfinite(fit.cost):
        path = fit.basis.evaluate(fit.coefficients)
    else:
        weights = np.broadcast_to(problem.weights, problem.points.shape[:2])[:, :, None]
        offset = problem.points - fit.shape @ fit.rotations.transpose(0, 2, 1)
        path = (weights * offset).sum(axis=1) / weights.sum(axis=1)
    return replace(fit, basis=basis, coefficients=solveh_banded(bands, basis.gather(path), lower=True))


def _fit(problem: _Problem, fit: Fit, max_iterations: int = MAX_ITERATIONS, tolerance: float = TOLERANCE) -> Fit:
    """Gauss-Newton with damping from a start; rotations are optimal for shape and path at every step."""
    rotations, pull, cost = _projected(problem, fit.shape, fit.basis.evaluate(fit.coefficients))
    shape, coefficients, basis = fit.shape, fit.coefficients, fit.basis
    damping, converged, iterations = 0.0, False, 0
    matrix = information(shape, rotations, problem.weights, basis)
    while iterations < max_iterations and not converged:
        iterations += 1
        da, dp = _step(problem, matrix, shape, rotations, pull, basis, damping)
        trial = _projected(problem, shape + dp, basis.evaluate(coefficients + da))
        if trial[2] <= cost * (1.0 + 1e-14):
            fell = cost - trial[2]
            shape, coefficients = shape + dp, coefficients + da
            rotations, pull, cost = trial
            damping = 0.0 if damping < 1e-4 else damping / 10
            converged = fell <= tolerance * cost or cost < 1e-26 * len(rotations)
            matrix = information(shape, rotations, problem.weights, basis)
        else:
            damping = max(10 * damping, 1e-4)
            converged = damping > 1e6
    seen = int((problem.weights > 0).sum()) * (len(rotations) if problem.weights.ndim == 1 else 1)
    observations = 3 * seen - 3 * len(rotations)
    parameters = 3 * basis.size + 3 * len(shape) - 3
    return Fit(rotations, shape, coefficients, basis, cost, observations, parameters, iterations, converged, matrix)


@dataclass(frozen=True, eq=False)
class _Pull:
    """Sums of the weighted residuals in head axes, which are too many to keep: by frame (F, 3), by marker (M, 3)."""

    frames: Array
    markers: Array


def _projected(problem: _Problem, shape: Array, path: Array) -> tuple[Array, _Pull, float]:
    """Best rotations for shape and path, what their residuals pull at, and the weighted cost."""
    rotations = np.empty((len(path), 3, 3))
    pull, cost = _Pull(np.empty((len(path), 3)), np.zeros(shape.shape)), 0.0
    for part in blocks(len(path)):
        w = _column(problem.weights, part)
        arm = problem.points[part] - path[part, None, :]
        weighted = arm * w
        total = (w[..., 0] * (shape**2).sum(axis=1)).sum(axis=-1)
        square = np.einsum("fmi,fmi->f", weighted, arm) + total
        rotations[part] = best_rotations(weighted.transpose(0, 2, 1) @ shape, square)
        residual = arm @ rotations[part] - shape
        weighted = residual * w
        pull.frames[part] = weighted.sum(axis=1)
        pull.markers[:] += weighted.sum(axis=0)
        cost += float(np.einsum("fmi,fmi->", weighted, residual))
    return rotations, pull, cost


def _column(weights: Array, part: slice) -> Array:
    """Weights of some frames in the shape that multiplies points: (M, 1) or (B, M, 1)."""
    return (weights if weights.ndim == 1 else weights[part])[..., None]


def _step(
    problem: _Problem, matrix: Information, shape: Array, rotations: Array, pull: _Pull, basis: Basis, damping: float
) -> tuple[Array, Array]:
    """Change of coefficients and shape."""
    right_path = basis.gather((rotations @ pull.frames[:, :, None])[:, :, 0]).reshape(-1, 1)
    right_shape = pull.markers.reshape(-1, 1)
    if damping:
        matrix = replace(
            matrix,
            band=np.concatenate([matrix.band[:1] * (1 + damping), matrix.band[1:]]),
            corner=matrix.corner + damping * np.diag(np.diag(matrix.corner)),
        )
    if len(problem.hidden):
        # The pivot stays where it started along axes of which only noise would speak: the constrained minimum.
        functional = matrix.path_weights(problem.frame) @ problem.hidden.T
        path, markers = matrix.solve(
            np.hstack([right_path, functional]),
            np.hstack([right_shape, np.zeros((len(right_shape), len(problem.hidden)))]),
        )
        back = np.linalg.pinv(functional.T @ path[:, 1:], hermitian=True) @ (functional.T @ path[:, :1])
        da, dp = path[:, :1] - path[:, 1:] @ back, markers[:, :1] - markers[:, 1:] @ back
    else:
        da, dp = matrix.solve(right_path, right_shape)
    dp = dp.reshape(-1, 3)
    # The head's axes are free. Held by the markers about their own middle, a pivot that moves far moves straight;
    # held about the pivot, the shape would have to turn with it and the linear step would be good for little.
    about = shape - shape.mean(axis=0)
    turn = np.linalg.pinv(inertia(about), hermitian=True) @ np.cross(about, dp).sum(axis=0)
    return da.reshape(-1, 3), dp - np.cross(turn, shape)


def _robust(problem: _Problem, fit: Fit) -> tuple[_Problem, Fit]:
    """Re-weighted fits: every marker of every frame by the Geman-McClure loss at four times its noise.

    The problem comes back without the samples of next to no weight, some six times the noise off, and the fit with
    the normal matrix of that: what is said of its uncertainty must not count them.
    """
    base = np.broadcast_to(problem.weights, problem.points.shape[:2])
    for _ in range(10):
        arm = problem.points - fit.basis.evaluate(fit.coefficients)[:, None, :]
        square = base * ((arm @ fit.rotations - fit.shape) ** 2).sum(axis=2)
        # 2.366 is the median of chi-square with three degrees of freedom; six in 3 M are absorbed by the pose.
        noise = np.median(square[base > 0]) / 2.366 * base.shape[1] / max(base.shape[1] - 1, 1)
        share = (16 * noise / (square + 16 * noise + 1e-300)) ** 2
        before = fit
        fit = _fit(replace(problem, weights=base * share), fit, max_iterations=4)
        if np.abs(fit.shape - before.shape).max() < 1e-7:
            break
    kept = np.where(share > OUTLIER, base, 0.0)
    return replace(problem, weights=kept), replace(fit, matrix=information(fit.shape, fit.rotations, kept, fit.basis))


def _reported(
    points: Array,
    pose: Pose,
    problem: _Problem,
    fit: Fit,
    used: np.ndarray,
    motion: Motion,
    prior: tuple[ArrayLike, ArrayLike] | None,
) -> Pivot:
    functional = fit.matrix.path_weights(problem.frame)
    va, vp = fit.matrix.solve(functional, np.zeros((3 * len(fit.shape), 3)))
    spread = functional.T @ va
    spread = 0.5 * (spread + spread.T)
    variance, influence = _influence(problem, fit, va, vp)
    white = variance * spread
    blocks = block_covariance(influence, pose.ok)
    inflation = float(np.trace(np.linalg.pinv(white, hermitian=True) @ blocks)) / 3.0
    covariance = problem.unit**2 * white * (inflation if inflation > INFLATED else 1.0)
    position = problem.origin + problem.unit * (functional.T @ fit.coefficients.ravel())
    if prior is not None:
        anchor, wide = (np.asarray(part, dtype=np.float64) for part in prior)
        # Hidden axes already stand at the prior's coordinate.
        shown = np.eye(3) - problem.hidden.T @ problem.hidden
        covariance = shown @ covariance @ shown
        gain = covariance @ np.linalg.inv(covariance + wide)
        fit = _moved(problem, fit, (va, vp), spread, gain @ (anchor - position))
        covariance = covariance - gain @ covariance
    position = problem.origin + problem.unit * (functional.T @ fit.coefficients.ravel())
    path = np.full((len(points), 3), np.nan)
    path[used] = problem.origin + problem.unit * fit.basis.evaluate(fit.coefficients)
    rotations = np.full((len(points), 3, 3), np.nan)
    rotations[used] = fit.rotations
    translations = path - (rotations.reshape(-1, 3) @ position).reshape(-1, 3)
    template = problem.unit * fit.shape + position
    weights = problem.weights
    if weights.ndim == 2 and len(used) < len(points):
        weights = np.zeros((len(points), len(template)))
        weights[used] = problem.weights
    own = Pose(rotations, translations, pose.status, template, weights)
    verdict = judge(
        position, covariance, points, own, converged=fit.converged, evaluations=fit.iterations, motion=motion,
        anchor=position,
    )  # fmt: skip
    return replace(verdict, pose=own, sway_spacing_s=fit.basis.spacing_s)


def _influence(problem: _Problem, fit: Fit, va: Array, vp: Array) -> tuple[float, Array]:
    """Noise variance of a coordinate of unit weight, in squared units of the problem, and the influence (F, 3) of each
    frame on the pivot: its own part of the right side through the inverse.
    """
    rotations, _, _ = _projected(problem, fit.shape, fit.basis.evaluate(fit.coefficients))
    influence = np.empty((len(rotations), 3))
    cost, seen = 0.0, 0
    for part in blocks(len(influence)):
        basis, met = fit.basis.part(part)
        w = _column(problem.weights, part)
        arm = problem.points[part] - basis.evaluate(fit.coefficients[met])[:, None, :]
        residual = (arm @ rotations[part] - fit.shape) * (w > 0)
        weighted = residual * w
        cost += float(np.einsum("fmi,fmi->", weighted, residual))
        seen += int(np.broadcast_to(w[..., 0] > 0, residual.shape[:2]).sum())
        turned = (fit.rotations[part] @ weighted.sum(axis=1)[:, :, None])[:, :, 0]
        response = basis.evaluate(va.reshape(-1, 9)[met]).reshape(-1, 3, 3)
        influence[part] = np.einsum("fi,fik->fk", turned, response) + weighted.reshape(len(turned), -1) @ vp
    return cost / max(3 * seen - 3 * len(influence), 1), influence


def _moved(problem: _Problem, fit: Fit, response: tuple[Array, Array], spread: Array, by: Array) -> Fit:
    """The best fit whose pivot lies elsewhere: shape and path follow as they are correlated with it."""
    change = np.linalg.pinv(spread, rcond=1e-12, hermitian=True) @ (by / problem.unit)
    coefficients = fit.coefficients + (response[0] @ change).reshape(-1, 3)
    shape = fit.shape + (response[1] @ change).reshape(-1, 3)
    rotations, _, cost = _projected(problem, shape, fit.basis.evaluate(coefficients))
    return replace(fit, rotations=rotations, shape=shape, coefficients=coefficients, cost=cost)
