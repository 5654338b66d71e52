"""Head motion out of a take: rotation, pivot and sway together, and their undoing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from evalkit.capture import Capture
from evalkit.capture.origin import local_origin
from evalkit.capture.rigid import RigidMarkers, choose_rigid
from evalkit.errors import EvalkitError, FrameStatus
from evalkit.geometry import Array, apply_motion, blocks, mean_rotation, rotation_angle, undo_motion
from evalkit.pivot import Pivot, PivotEstimator, pivot_estimators
from evalkit.pivot.spline import smoothed
from evalkit.pose import Pose, PoseEstimator, pose_estimators, reference_pose
from evalkit.pose.reference import Reference
from evalkit.pose.skin import SkinModel, automatic_rigid, skin_estimator
from evalkit.pose.smooth import Smoothed
from evalkit.pose.smooth import smooth as smooth_rotations

DEFAULT_POSE = "svd"
DEFAULT_PIVOT = "joint"

PRIOR_STD_MM = 50.0
"""Standard deviation per axis of what anatomy says of the pivot: necks differ by less, and forehead markers sit
differently by centimetres; a guess, and a wide one."""

HELD_OUT_FRAMES = 2000
HELD_OUT_MARKERS = 8
"""Frames and rigid markers on which the pivot-constrained and the free pose are compared."""

ASIDE = 0.05
"""Part of its weight to which a robust loss has taken a sample that counts as set aside."""

DISPLACED = 8.0
"""A frame in which the rigid markers fit so many times worse than in the ordinary one has a displaced sample."""

STILL = 0.5
"""Part of the path that turning gives the markers which the pivot's own path may have, in a neck at rest."""


@dataclass(frozen=True, eq=False)
class Compensation:
    """A take without its head motion, and the motion.

    Every position is in mm and world axes; ``x = R P + T`` with ``T = (I - R) O + s``.

    Attributes
    ----------
    capture : Capture
        Expression only: every marker in the reference pose, NaN in frames whose head pose is unknown.
    rotations : ndarray, shape (F, 3, 3)
    translations : ndarray, shape (F, 3)
    pivot : ndarray, shape (3,)
        O, in the reference pose.
    pivot_covariance : ndarray, shape (3, 3), mm²
        Infinite along axes that the motion does not show.
    sway : ndarray, shape (F, 3)
        s, the pivot's own displacement.
    rigid : list of str
        Labels used.
    status : str
        The pivot's: ``ok``, ``poorly-observable``, ``unobservable`` or ``not-converged``.
    frame_status : ndarray of int8, shape (F,)
        :class:`~evalkit.errors.FrameStatus` of every frame.
    frame_residual, marker_residual : ndarray, shapes (F,) and (R,)
        Root-mean-square distance of the rigid markers from the fitted motion, per frame (weighted as in the
        fit, where markers were weighted) and per marker.
    warnings : list of str
        What a user should know before trusting the result, in words.
    template : ndarray, shape (R, 3)
        The rigid shape in the reference pose.
    chosen : RigidMarkers
        With the evidence for the choice.
    estimate : Pivot
        What the pivot estimator gave, with its trace.
    pose_method, pivot_method, reference, sway_mode, origin
        How it was done; origin is the local origin that searches start from and are pulled towards.
    sway_used : str or float
        What the translation was taken to be in the end: ``none``, ``per-frame`` or a knot spacing in seconds.
    outer : list of dict
        Outer iterations of the paper's alternation; empty otherwise.
    smoothing : Smoothed or None
        What smoothing did to the rotations, where it was asked for.

    Examples
    --------
    Putting the motion back gives the take again:

    >>> import numpy as np
    >>> import evalkit
    >>> take, truth = evalkit.synthesize("talking", frames=120)
    >>> result = evalkit.compensate(take, truth.rigid)
    >>> still = result.capture.points
    >>> moved = np.einsum("fij,fmj->fmi", result.rotations, still) + result.translations[:, None]
    >>> np.allclose(moved, take.points, rtol=0, atol=1e-6)
    True
    """

    capture: Capture
    rotations: Array
    translations: Array
    pivot: Array
    pivot_covariance: Array
    sway: Array
    rigid: list[str]
    status: str
    frame_status: np.ndarray
    frame_residual: Array
    marker_residual: Array
    warnings: list[str]
    template: Array
    chosen: RigidMarkers
    estimate: Pivot
    pose_method: str
    pivot_method: str
    reference: Reference
    sway_mode: str | float
    sway_used: str | float
    origin: Array
    outer: list[dict[str, Any]] = field(default_factory=list)
    smoothing: Smoothed | None = None


def compensate(
    take: Capture,
    rigid: str | Sequence[str] = "auto",
    pose: str = DEFAULT_POSE,
    pivot: str = DEFAULT_PIVOT,
    sway: str | float = "auto",
    reference: Reference = "mean",
    origin: ArrayLike | None = None,
    prior: bool = True,
    smooth: bool = False,
    **pivot_options: Any,
) -> Compensation:
    """Estimate the head's motion from the rigid markers and undo it for every marker.

    Parameters
    ----------
    take : Capture
    rigid : "auto" or sequence of str
        Markers that move with the skull, at least three not in one line. ``"auto"``: all markers of the take,
        each weighted by how its skin moves over the skull, which is estimated with the motion
        (:mod:`evalkit.pose.skin`); in takes that do not allow it, those whose distances vary least.
    pose, pivot : str
        Names in ``evalkit.pose_estimators`` and ``evalkit.pivot_estimators``. With ``rigid="auto"`` the least
        squares of ``svd`` take each marker's own covariance (the result's method is then called ``skin``), other
        estimators its mean variance.
    sway : "auto", "none", "per-frame" or float
        What the pivot's own displacement may be. ``"none"``: the neck stands still. A number: a cubic B-spline
        with knots that many seconds apart. ``"per-frame"``: anything, each frame's pose by itself. ``"auto"``:
        with a pivot estimator that models the sway (``joint``), its own choice between still and splines, unless
        rigid markers that were left out of the estimate move less with free poses; with others, and where skin
        motion is modelled, ``"per-frame"``.
    reference : "mean", "median" or int
        The pose that everything is brought back to, and what the shape is taken from. ``"mean"`` and
        ``"median"``: shape from all frames, the head turned to its mean orientation about the pivot. A number:
        that frame, counted from 0, with its own noise; the paper's way.
    origin : array_like, shape (3,), mm, optional
        Local origin near the pivot, where searches start and what Eq. (5) pulls towards; from the rigid
        markers by :func:`evalkit.capture.origin.local_origin` if not given.
    prior : bool
        Tell the pivot estimator what anatomy says: the local origin, give or take :data:`PRIOR_STD_MM` in every
        direction. Only ``joint`` uses it, and only takes that hardly show the pivot feel it.
    smooth : bool
        Smooth the rotations over time (:func:`evalkit.pose.smooth.smooth`), last of all: by as much as the take asks
        for, which suits talk and blurs single quick movements in stillness. Frames without a pose stay empty.
    **pivot_options
        Handed to the pivot estimator.

    Returns
    -------
    Compensation

    Raises
    ------
    EvalkitError
        If a name is unknown, or the rigid markers cannot give a pose in any frame. Frames that cannot answer
        get a status instead.

    Notes
    -----
    The undoing is ``p = R' (p' - O - s) + O``; Eq. (9) of Huang et al. (2000) has the sign of the translation
    and the pivot wrong.

    Examples
    --------
    Ten seconds of talk with 0.3 mm of noise, three markers on the forehead: the pivot is found to a tenth of a
    millimetre, and less than a tenth of the markers' motion is left, which is the expression.

    >>> import numpy as np
    >>> import evalkit
    >>> take, truth = evalkit.synthesize("talking", seed=0, noise=0.3)
    >>> result = evalkit.compensate(take, rigid=["ForeheadC", "ForeheadL", "ForeheadR"])
    >>> result.status
    'ok'
    >>> round(float(np.linalg.norm(result.pivot - truth.pivot)), 2)
    0.08
    >>> [round(float(points.std(axis=0).mean()), 1) for points in (take.points, result.capture.points)]
    [20.8, 1.5]
    """
    if not isinstance(take, Capture):
        raise EvalkitError(
            f"compensate takes a Capture, not {type(take).__name__}: read a file by evalkit.read_capture"
        )
    estimator = _lookup(pose_estimators, pose, "pose estimator")
    finder = _lookup(pivot_estimators, pivot, "pivot estimator")
    _check_sway(sway)
    chosen, model = _markers(take, rigid, estimator)
    weighted = False
    if model is not None and pose == "svd":
        estimator, pose, weighted = skin_estimator(model), "skin", True
    columns = np.array(chosen.columns)
    warnings = [*take.warnings, *chosen.warnings]
    posed = pose_or_error(estimator, take.points[:, columns], reference, chosen, pose)
    aside = None if weighted else _set_aside(posed, chosen)
    if aside is not None:
        warnings.append(
            f"{aside.sum()} samples of rigid markers in {aside.any(axis=1).sum()} frames lie so far off that pose "
            f"method {pose} set them aside; the pivot was estimated without them"
        )

    def seen(which: np.ndarray | slice = slice(None)) -> Array:
        """Rigid markers, without what was set aside; made when needed: with automatic weights nearly the whole take."""
        points = take.points[:, columns[which]]
        return points if aside is None else np.where(aside[:, which, None], np.nan, points)

    free = sway == "per-frame" or (sway == "auto" and weighted)
    # Markers on skin that tell little of the pose tell less of the pivot.
    lead = chosen.leading if free else np.arange(len(chosen.columns))
    start = local_origin(take, columns[lead]) if origin is None else checked_point(origin)
    known = (start, PRIOR_STD_MM**2 * np.eye(3)) if prior else None
    options = {
        "initial": start, "origin": start, "reference": reference, "rate": take.rate, "prior": known,
        "sway": "auto" if sway == "per-frame" else sway, **pivot_options,
    }  # fmt: skip
    leading = replace(posed, template=posed.template[lead], weights=posed.weights[..., lead])
    if not smooth:
        # Nothing after the pivot weighs single samples, and their weights are a third of the positions.
        posed = replace(posed, weights=chosen.weights)
    estimate = finder(seen(lead), leading, **options)
    del leading
    used: str | float = "per-frame" if sway == "auto" else sway
    if estimate.pose is not None and not free:
        used = "none" if np.isinf(estimate.sway_spacing_s) else estimate.sway_spacing_s
        words = ""
        if sway == "auto":
            words = _free_is_better(seen(), posed, estimate, estimator, finder, take.rate, used)
        if words:
            warnings.append(words)
            used = "per-frame"
            if estimate.status == "not-converged":
                text = "no pivot, still or swaying, explains the motion of this take"
                estimate = replace(estimate, status="poorly-observable", message=text)
        else:
            posed = estimate.pose
    smoothing = None
    if smooth:
        if not estimator.orthogonal and posed is not estimate.pose:
            raise EvalkitError(f"pose method {pose} gives matrices that are no rotations; they cannot be smoothed")
        about = estimate.position if posed is estimate.pose else None
        smoothing = smooth_rotations(posed, seen(), rate=take.rate, about=about, bridge=False)
        if posed is estimate.pose:
            estimate = replace(estimate, pose=smoothing.pose)
        posed = smoothing.pose
    result = finish(take, chosen, posed, estimate, (sway, used), reference, start, pose, pivot, warnings, [])
    return replace(result, smoothing=smoothing)


def _set_aside(posed: Pose, chosen: RigidMarkers) -> np.ndarray | None:
    """Samples (F, R) that the pose estimator took the weight of because they lie far off; None if there are none."""
    if posed.weights.ndim < 2:
        return None
    aside = (posed.weights > 0) & (posed.weights < ASIDE * chosen.weights)
    return aside if aside.any() else None


def _markers(
    take: Capture, rigid: str | Sequence[str], estimator: PoseEstimator
) -> tuple[RigidMarkers, SkinModel | None]:
    """The rigid markers, and how their skin moves if they were weighted automatically."""
    if isinstance(rigid, str) and rigid == "auto" and estimator.markers is None:
        found = automatic_rigid(take)
        return found, found.model
    return choose_rigid(take, rigid, estimator.markers), None


def pose_or_error(
    estimator: PoseEstimator, points: Array, reference: Reference, chosen: RigidMarkers, name: str
) -> Pose:
    """Pose of every frame, or an EvalkitError where the estimator does not fit or no frame has a pose."""
    if estimator.markers is not None and points.shape[1] != estimator.markers:
        raise EvalkitError(
            f"pose method {name} takes exactly {estimator.markers} rigid markers, "
            f"not {points.shape[1]} ({', '.join(chosen.labels)}); name {estimator.markers} with rigid"
        )
    # The skin estimator has its markers' covariances; weights on top would count them twice.
    weights = None if name == "skin" or (chosen.weights == 1.0).all() else chosen.weights
    posed = reference_pose(estimator, points, reference, weights, labels=chosen.labels)
    if not posed.ok.any():
        worst = FrameStatus(int(np.bincount(posed.status).argmax())).text
        raise EvalkitError(
            f"no frame gives a head pose from {', '.join(chosen.labels)} ({worst}); choose other rigid markers"
        )
    return posed


def _free_is_better(
    points: Array, free: Pose, estimate: Pivot, estimator: PoseEstimator, finder: PivotEstimator, rate: float,
    used: str | float,
) -> str:  # fmt: skip
    """Why poses free in every frame are to be preferred to those turned about the pivot; empty if they are not.

    With four rigid markers or more, by cross-validation: markers are left out one by one, and the pose that
    keeps them stiller wins. With three nothing can be left out, and Mallows's criterion decides (Technometrics
    15 (1973), doi:10.1080/00401706.1973.10489103): cost plus twice the variance for every parameter.
    """
    joint = estimate.pose
    assert joint is not None
    some = np.unique(np.linspace(0, len(points) - 1, min(len(points), HELD_OUT_FRAMES)).astype(int))
    count = points.shape[1]
    if count > 3 and estimator.markers is None:
        x, thin_rate = points[some], rate * (len(some) - 1) / max(len(points) - 1, 1)
        moved = np.zeros(2)
        for k in np.unique(np.linspace(0, count - 1, min(count, HELD_OUT_MARKERS)).astype(int)):
            others = np.delete(x, k, axis=1)
            try:
                posed = reference_pose(estimator, others)
                turned = finder(others, posed, rate=thin_rate, sway=used).pose
            except EvalkitError:
                return ""
            assert turned is not None
            for way, by in enumerate((turned, posed)):
                still = undo_motion(by.rotations, by.translations, x[:, [k]])[:, 0]
                moved[way] += np.nansum((still - np.nanmean(still, axis=0)) ** 2)
        turned_mm, free_mm = np.sqrt(moved / (np.isfinite(x[:, :, 0]).sum() * min(count, HELD_OUT_MARKERS) / count))
        if free_mm < turned_mm:
            return (
                f"rigid markers left out of the estimate move {turned_mm:.3f} mm (rms) with the head turned about its "
                f"pivot and {free_mm:.3f} mm with each frame's pose free: the free poses were used"
            )
        return ""
    cost = [float(np.nansum(pose.residuals(points)[free.known] ** 2)) for pose in (joint, free)]
    frames = int(free.ok.sum())
    variance = cost[1] / max(3 * int(np.isfinite(points[free.known][:, :, 0]).sum()) - 6 * frames, 1)
    splines = 1 if used == "none" else int((len(points) - 1) / rate / float(used)) + 3
    rounding = 1e-18 * float(np.nansum(joint.template**2)) * frames
    if cost[0] - cost[1] > max(2.0 * variance * (3 * frames - 3 * splines), rounding):
        return (
            f"the rigid markers fit {np.sqrt(cost[0] / frames):.2f} mm (rms per frame) with the head turned about its "
            f"pivot and {np.sqrt(cost[1] / frames):.2f} mm with each frame's pose free, more than the freedom "
            "explains: the free poses were used"
        )
    return ""


def finish(
    take: Capture, chosen: RigidMarkers, posed: Pose, estimate: Pivot, sway: tuple[str | float, str | float],
    reference: Reference, origin: Array, pose: str, pivot: str, warnings: list[str], outer: list[dict[str, Any]],
) -> Compensation:  # fmt: skip
    """Fix the reference pose, model the translation, undo the motion, and say what came of it."""
    used = sway[1]
    turned = posed is estimate.pose
    # The published alternation keeps the pivot that its last pass found.
    keep = used == "none" or bool(outer)
    o, r, t, template = _in_reference(posed, estimate.position, reference, pose, turned, keep)
    s = t - o + _rotated(r, o)
    if used == "none":
        s = np.where(posed.ok[:, None], np.zeros(3), np.nan)
    elif not isinstance(used, str) and not turned:
        s = np.where(posed.ok[:, None], smoothed(s, posed.ok, take.rate, float(used)), np.nan)
    t = o - _rotated(r, o) + s
    frame_residual, marker_residual = _residuals(take, chosen, r, t, template)
    warnings = warnings + _warnings(take, chosen, posed, estimate, r, s, sway) + _displaced(frame_residual, pose)
    inverse = r.transpose(0, 2, 1) if turned else _inverse(r, pose)
    return Compensation(
        _undone(take, inverse, t), r, t, o, estimate.covariance, s, list(chosen.labels), estimate.status,
        posed.status, frame_residual, marker_residual, warnings, template, chosen, estimate, pose, pivot,
        reference, *sway, origin, outer,
    )  # fmt: skip


def _residuals(
    take: Capture, chosen: RigidMarkers, rotations: Array, translations: Array, template: Array
) -> tuple[Array, Array]:
    """Root-mean-square residual of every frame (F,), weighted, and of every rigid marker (R,)."""
    by_frame = np.empty(take.frames)
    total, count = np.zeros((2, len(chosen.columns)))
    with np.errstate(invalid="ignore", divide="ignore"):
        for part in blocks(take.frames):
            observed = take.points[part][:, chosen.columns]
            residual = observed - apply_motion(rotations[part], translations[part], template)
            square = np.einsum("fmi,fmi->fm", residual, residual)
            seen = np.isfinite(square)
            square[~seen] = 0.0
            by_frame[part] = np.sqrt(square @ chosen.weights / (seen @ chosen.weights))
            total += square.sum(axis=0)
            count += seen.sum(axis=0)
        return by_frame, np.sqrt(total / count)


def _in_reference(
    posed: Pose, pivot: Array, reference: Reference, pose: str, turned: bool, keep: bool
) -> tuple[Array, Array, Array, Array]:
    """Pivot, rotations, translations and template in the reference pose."""
    if isinstance(reference, str):
        return pivot, *_turned_to_mean(posed, pivot, "svd" if turned else pose)
    if turned:
        here, there = posed.rotations[reference], posed.translations[reference]
        r = (posed.rotations.reshape(-1, 3) @ here.T).reshape(-1, 3, 3)
        return pivot, r, posed.translations - _rotated(r, there), posed.template @ here.T + there
    if not keep:
        # Where the head carries its pivot in that frame: the estimate is its mean place in the world.
        ok = posed.known
        in_head = np.einsum("fij,fj->i", _inverse(posed.rotations[ok], pose), pivot - posed.translations[ok])
        pivot = in_head / len(posed.rotations[ok])
    return pivot, posed.rotations, posed.translations, posed.template


def _rotated(rotations: Array, vector: Array) -> Array:
    """``R v`` for one vector: (F, 3, 3), (3,) to (F, 3)."""
    return (rotations.reshape(-1, 3) @ vector).reshape(-1, 3)


def _turned_to_mean(posed: Pose, pivot: Array, pose: str) -> tuple[Array, Array, Array]:
    """Rotations, translations and template in the reference pose of mean orientation, turned about the pivot.

    Any other turn, about the markers' centroid say, would leave the head's pivot beside the world's, and
    ``T = (I - R) O + s`` with a resting neck would need a sway that was never there.
    """
    ok = posed.known
    inverse = _inverse(posed.rotations[ok], pose)
    in_head = np.einsum("fij,fj->i", inverse, pivot - posed.translations[ok]) / len(inverse)
    middle = mean_rotation(posed.rotations[ok])
    rotations = (posed.rotations.reshape(-1, 3) @ middle.T).reshape(-1, 3, 3)
    translations = posed.translations + _rotated(posed.rotations, in_head) - _rotated(rotations, pivot)
    return rotations, translations, (posed.template - in_head) @ middle.T + pivot


def _undone(take: Capture, inverse: Array, translations: Array) -> Capture:
    """The take with every position brought to the reference pose; angles, forces and the like as they were."""
    positions = [k for k, kind in enumerate(take.quantities) if kind == "position"]
    if len(positions) == len(take.labels):
        return take.with_points(undo_motion(inverse.transpose(0, 2, 1), translations, take.points), copy=False)
    moved = take.points.copy()
    moved[:, positions] = undo_motion(inverse.transpose(0, 2, 1), translations, moved[:, positions])
    return take.with_points(moved, copy=False)


def _inverse(rotations: Array, pose: str) -> Array:
    """Inverse matrices; the paper's raw matrix is not orthogonal, so its transpose would not undo it."""
    if pose not in pose_estimators or pose_estimators[pose].orthogonal:
        return rotations.transpose(0, 2, 1)
    known = np.isfinite(rotations).all(axis=(1, 2))
    inverse = np.full_like(rotations, np.nan)
    inverse[known] = np.linalg.pinv(rotations[known])
    return inverse


def _warnings(
    take: Capture, chosen: RigidMarkers, posed: Pose, estimate: Pivot, r: Array, s: Array,
    sway: tuple[str | float, str | float],
) -> list[str]:  # fmt: skip
    found = []
    other = sorted({kind for kind in take.quantities if kind != "position"})
    if other:
        count = sum(kind != "position" for kind in take.quantities)
        found.append(f"{count} points hold {', '.join(other)} values, not positions: left as they were")
    lost = int((~posed.ok).sum())
    if lost:
        kinds = np.bincount(posed.status, minlength=len(FrameStatus))
        parts = ", ".join(f"{kinds[k]} {FrameStatus(k).text}" for k in range(1, len(kinds)) if kinds[k])
        found.append(f"{lost} of {take.frames} frames have no head pose ({parts}); they are marked and left empty")
    if estimate.status != "ok":
        found.append(f"pivot {estimate.status}: {estimate.message}")
    if len(chosen.labels) == 3:
        found.append("three rigid markers: an error of one cannot be told from a rotation; four or more are safer")
    drift = float(np.sqrt(np.mean((s[posed.known] ** 2).sum(axis=1))))
    turned = float(np.sqrt(np.mean(rotation_angle(r[posed.known]) ** 2)))
    arm = float(np.linalg.norm(estimate.position - posed.template.mean(axis=0)))
    modelled = not isinstance(sway[1], str)
    if sway[0] == "auto" and (modelled or drift > STILL * turned * arm):
        found.append(
            f"the pivot itself moves by {drift:.1f} mm (rms) while the head turns {np.degrees(turned):.1f} deg (rms)"
            + (f", modelled by a spline with knots {sway[1]:.2g} s apart" if modelled else "")
            + ": the neck did not stand still, and one fixed pivot does not explain the motion"
        )
    return found


def _displaced(residual: Array, pose: str) -> list[str]:
    """A warning that samples are displaced, where least squares let them pull the head."""
    known = residual[np.isfinite(residual)]
    far = residual > DISPLACED * np.median(known) if len(known) else np.zeros(0, dtype=bool)
    if pose == "robust" or not far.any() or not np.median(known) > 0:
        return []
    worst = int(np.nanargmax(residual))
    return [
        f"in {far.sum()} frames the rigid markers fit more than {DISPLACED:g} times worse than usual (worst: frame "
        f"{worst}, {residual[worst]:.1f} mm): samples are displaced or labels exchanged; try the pose method robust"
    ]


def _lookup(table: Mapping[str, Any], name: str, what: str) -> Any:
    if name not in table:
        import difflib

        near = difflib.get_close_matches(name, table, n=2, cutoff=0.4)
        hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(table)}"
        raise EvalkitError(f"{what} '{name}' is not known; {hint}")
    return table[name]


def _check_sway(sway: str | float) -> None:
    seconds = isinstance(sway, Real) and not isinstance(sway, bool) and np.isfinite(sway) and sway > 0
    if not seconds and not (isinstance(sway, str) and sway in ("auto", "none", "per-frame")):
        raise EvalkitError(f"sway '{sway}' is not known; use auto, none, per-frame or a knot spacing in seconds")


def checked_point(value: ArrayLike) -> Array:
    """A local origin (3,), mm, or an EvalkitError."""
    point = np.asarray(value, dtype=np.float64)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise EvalkitError(f"origin {value!r} is not three coordinates in mm")
    return point
