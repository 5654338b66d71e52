"""The paper's search for the pivot: six axis steps and a bold driver."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evalkit.geometry import Array
from evalkit.pivot.model import Pivot, judge
from evalkit.pivot.objective import Objective
from evalkit.pivot.sphere import closed_form, length_covariance
from evalkit.pose.model import Pose
from evalkit.pose.reference import Reference

DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])[[0, 3, 1, 4, 2, 5]]


def six_directions(
    points: Array,
    pose: Pose,
    *,
    initial: ArrayLike | None = None,
    reference: Reference = "mean",
    origin: ArrayLike | None = None,
    angle_weight: float = 1.0,
    length_weight: float = 1.0,
    pull_weight: float = 1.0,
    length_scale_mm: float = 100.0,
    pull_scale_mm: float = 100.0,
    growth: float = 1.2,
    shrink: float = 0.5,
    step_mm: float = 10.0,
    max_iterations: int = 1000,
    epsilon: float = 0.0,
    resolution_mm: float = 1e-4,
    **_: object,
) -> Pivot:
    """Minimise Eq. (5) by the best of six axis steps, Eq. (8), with the bold driver of Eq. (7).

    A step of length a that lowers the objective is taken and ``a *= growth`` (rho); otherwise the point stays
    and ``a *= shrink`` (sigma). It stops after ``max_iterations`` (N), below ``epsilon``, or, which the paper
    leaves out but the method needs, when a falls below ``resolution_mm``.

    Parameters
    ----------
    points : ndarray, shape (F, M, 3), mm
        Rigid markers in world axes, NaN where missing.
    pose : Pose
        Used for the verdict only.
    initial : array_like, shape (3,), mm, optional
        Start of the search; the origin by default.
    reference, angle_weight, length_weight, pull_weight, length_scale_mm, pull_scale_mm, origin
        As in :class:`~evalkit.pivot.objective.Objective`. The default origin is the start, and without either
        both are the closed-form sphere centre.
    growth, shrink, step_mm, max_iterations, epsilon, resolution_mm
        The search.

    Returns
    -------
    Pivot
        With the trace of every iteration. The covariance is that of the least-squares centre of the same
        lengths plus the squared distance to it.

    References
    ----------
    Huang, Lin & Ouhyoung (2000), section 2.2.
    """
    start, pull_to = start_and_origin(points, initial, origin)
    objective = Objective(
        points, reference, pull_to, angle_weight, length_weight, pull_weight, length_scale_mm, pull_scale_mm
    )
    position, step = start.copy(), float(step_mm)
    value = float(objective(position[None])[0])
    evaluations, converged = 1, False
    trace = [(0.0, *position, value, step)]
    for iteration in range(1, max_iterations + 1):
        if value < epsilon or step < resolution_mm:
            converged = True
            break
        candidates = position + step * DIRECTIONS
        values = _evaluate(objective, candidates)
        evaluations += 6
        best = int(np.argmin(values))
        if values[best] < value:
            position, value = candidates[best], float(values[best])
            step *= growth
        else:
            step *= shrink
        trace.append((float(iteration), *position, value, step))
    covariance = length_covariance(points, pose, position)
    return judge(
        position, covariance, points, pose, converged=converged, evaluations=evaluations, trace=np.array(trace)
    )


def _evaluate(objective: Objective, candidates: Array) -> Array:
    """All candidates at once while they fit the cache, one by one in long takes."""
    if objective.points.size * len(candidates) <= 200_000:
        return objective(candidates)
    return np.concatenate([objective(c[None]) for c in candidates])


def start_and_origin(points: Array, initial: ArrayLike | None, origin: ArrayLike | None) -> tuple[Array, Array]:
    """Start of a search and the point that the pull draws towards; each stands in for the other."""
    given = next((p for p in (initial, origin) if p is not None), None)
    fallback = closed_form(points) if given is None else np.asarray(given, dtype=np.float64)
    start = fallback if initial is None else np.asarray(initial, dtype=np.float64)
    return start.astype(np.float64), fallback if origin is None else np.asarray(origin, dtype=np.float64)
