"""The paper's objective minimised by the algorithms of NLopt: the baselines of the six-directions search."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from evalkit.geometry import Array
from evalkit.pivot.model import Pivot, PivotEstimator, judge
from evalkit.pivot.objective import Objective
from evalkit.pivot.six_directions import start_and_origin
from evalkit.pivot.sphere import length_covariance
from evalkit.pose.model import Pose
from evalkit.pose.reference import Reference

ALGORITHMS = {
    "neldermead": ("LN_NELDERMEAD", "Nelder & Mead 1965"),
    "sbplx": ("LN_SBPLX", "Rowan 1990"),
    "bobyqa": ("LN_BOBYQA", "Powell 2009"),
    "cobyla": ("LN_COBYLA", "Powell 1994"),
    "newuoa": ("LN_NEWUOA", "Powell 2004"),
    "direct": ("GN_DIRECT_L", "Gablonsky & Kelley 2001"),
    "lbfgs": ("LD_LBFGS", "Liu & Nocedal 1989"),
    "mma": ("LD_MMA", "Svanberg 2002"),
    "slsqp": ("LD_SLSQP", "Kraft 1994"),
}
"""Short name to NLopt algorithm and its source. LN and GN minimise Eq. (5), LD its smooth squared variant."""

BOX_MM = 300.0
"""Half the edge of the box about the start that the global search covers."""


def search(
    points: Array,
    pose: Pose,
    *,
    algorithm: str,
    initial: ArrayLike | None = None,
    reference: Reference = "mean",
    origin: ArrayLike | None = None,
    angle_weight: float = 1.0,
    length_weight: float = 1.0,
    pull_weight: float = 1.0,
    length_scale_mm: float = 100.0,
    pull_scale_mm: float = 100.0,
    step_mm: float = 10.0,
    max_evaluations: int = 2000,
    resolution_mm: float = 1e-4,
    **_: object,
) -> Pivot:
    """Minimise the objective of the paper with one algorithm of NLopt.

    Parameters
    ----------
    points, pose, initial, reference, origin, *_weight, *_scale_mm
        As in :func:`evalkit.pivot.six_directions.six_directions`.
    algorithm : str
        Key of :data:`ALGORITHMS`.
    step_mm, max_evaluations, resolution_mm
        Initial step, budget, and the absolute tolerance on the position.

    Returns
    -------
    Pivot
        With one row of trace per evaluation (the best so far; step 0).

    References
    ----------
    Johnson, The NLopt nonlinear-optimization package, https://github.com/stevengj/nlopt.
    """
    import nlopt

    start, pull_to = start_and_origin(points, initial, origin)
    objective = Objective(
        points, reference, pull_to, angle_weight, length_weight, pull_weight, length_scale_mm, pull_scale_mm
    )
    name = ALGORITHMS[algorithm][0]
    best = (np.inf, start)
    trace: list[tuple[float, ...]] = []

    def value_at(position: Array, gradient: Array) -> float:
        nonlocal best
        if gradient.size:
            value, slope = objective.squared(position + start)
            gradient[:] = slope / points.size
        else:
            value = float(objective((position + start)[None])[0])
        if value < best[0]:
            best = (value, position + start)
        trace.append((float(len(trace)), *best[1], best[0], 0.0))
        # Per coordinate: the searches by gradient judge their steps against a slope of about one.
        return value / points.size

    # Positions relative to the start: NLopt's relative measures then do not depend on where the laboratory is.
    optimiser = nlopt.opt(getattr(nlopt, name), 3)
    optimiser.set_min_objective(value_at)
    optimiser.set_xtol_abs(resolution_mm)
    optimiser.set_ftol_rel(1e-14)
    optimiser.set_maxeval(max_evaluations)
    if name.startswith("GN"):
        optimiser.set_lower_bounds(np.full(3, -BOX_MM))
        optimiser.set_upper_bounds(np.full(3, BOX_MM))
    elif name.startswith("LN"):
        optimiser.set_initial_step(step_mm)
    converged = True
    try:
        optimiser.optimize(np.zeros(3))
        converged = optimiser.last_optimize_result() in (
            nlopt.SUCCESS, nlopt.FTOL_REACHED, nlopt.XTOL_REACHED,
        ) or name.startswith("GN")  # fmt: skip
    except nlopt.RoundoffLimited:
        pass  # The point is as good as floating point allows.
    except (nlopt.runtime_error, ValueError, RuntimeError):
        converged = False
    position = np.array(best[1])
    covariance = length_covariance(points, pose, position)
    return judge(position, covariance, points, pose, converged=converged, evaluations=len(trace), trace=np.array(trace))


def entries() -> dict[str, PivotEstimator]:
    """Rows ``nlopt-*`` of the table of pivot estimators."""
    return {
        f"nlopt-{key}": PivotEstimator(
            partial(search, algorithm=key),
            f"{'squared ' if name.startswith('LD') else ''}objective of the paper by {name}",
            source,
        )
        for key, (name, source) in ALGORITHMS.items()
    }
