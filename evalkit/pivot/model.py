"""What a pivot estimator gets and gives, how sure it is, and what the motion cannot tell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array, apply_motion, blocks, nearest_rotation
from evalkit.pose.model import Pose, whole_markers

BLOCKS = 24
"""Stretches of time whose sums are compared to see how much the take itself scatters."""

POOR = 0.1
"""A pivot whose standard deviation in some direction exceeds this part of its distance from the markers is called
poorly observable: a guess from anatomy is about as good."""

HEAD_MM = 200.0
"""The distance counts up to about the size of a head only, or a pivot metres away would pass as well known."""

TRACE_COLUMNS = ("iteration", "x_mm", "y_mm", "z_mm", "objective", "step_mm")


@dataclass(frozen=True, eq=False)
class Pivot:
    """An estimated centre of rotation and how far it can be trusted.

    Attributes
    ----------
    position : ndarray, shape (3,), mm
        In the world axes of the pose that the points were given in.
    covariance : ndarray, shape (3, 3), mm²
        Spread of the estimate as the take's own scatter shows it; infinite along unobservable axes.
    status : str
        ``ok``, ``poorly-observable``, ``unobservable`` or ``not-converged``.
    message : str
        The verdict in words.
    principal_axes : ndarray, shape (3, 3)
        Unit vectors as rows, the most uncertain first.
    principal_std : ndarray, shape (3,), mm
        Standard deviation along them, infinite where the motion says nothing.
    turn_deg : ndarray, shape (3,)
        Root-mean-square turn of the head about its three principal axes, largest first, deg: what the
        observability verdict rests on.
    evaluations : int
        Calls of the objective, for searches.
    trace : ndarray, shape (K, 6)
        Every iteration of a search, columns :data:`TRACE_COLUMNS`; empty for closed forms.
    pose : Pose or None
        The pose of every frame, where the estimator turns the head about the pivot rather than freely.
    sway_spacing_s : float
        Knot spacing of the pivot's path in that pose, s; infinite for a point.
    """

    position: Array
    covariance: Array
    status: str = "ok"
    message: str = ""
    principal_axes: Array = field(default_factory=lambda: np.eye(3))
    principal_std: Array = field(default_factory=lambda: np.full(3, np.nan))
    turn_deg: Array = field(default_factory=lambda: np.full(3, np.nan))
    evaluations: int = 0
    trace: Array = field(default_factory=lambda: np.empty((0, 6)))
    pose: Pose | None = None
    sway_spacing_s: float = np.inf


@dataclass(frozen=True)
class PivotEstimator:
    """One entry of the table of pivot estimators; call it as ``estimator(points, pose, **options)``.

    Attributes
    ----------
    function : callable
        ``(points (F, M, 3) mm, pose, *, initial, reference, **own) -> Pivot``: the rigid markers in the
        world, their :class:`~evalkit.pose.model.Pose`, a starting point (3,) mm for searches and the
        reference (``"mean"``, ``"median"`` or a frame number) of objectives that have one.
    summary, source : str
        One line on the method, and the paper it comes from.
    turns : bool
        Whether it gives poses of its own, turned about the pivot, and models the sway.
    origin : str
        Name and version of the package it comes from, empty for evalkit's own.
    peer : bool
        Whether another package's method is called for comparison: such entries answer as that package does.
    """

    function: Callable[..., Pivot]
    summary: str
    source: str
    turns: bool = False
    origin: str = ""
    peer: bool = False

    def __call__(self, points: Array, pose: Pose, **options: Any) -> Pivot:
        """Estimate the pivot."""
        return self.function(whole_markers(points), pose, **options)


@dataclass(frozen=True, eq=False)
class Motion:
    """What the rotations alone say about the pivot: ``c_i = a - R_i b`` for the markers' centroids c_i.

    Attributes
    ----------
    spread : ndarray, shape (3, 3)
        ``sum_i (R_i - Rbar)'(R_i - Rbar)`` less what the noise of the rotations adds to it, in the head's axes.
    floor : ndarray, shape (3, 3)
        What the noise of the rotations adds.
    mean : ndarray, shape (3, 3)
        Mean matrix Rbar of the known rotations.
    frames : int
        Frames whose pose is known.
    turn : ndarray, shape (3,)
        Eigenvalues of ``spread``, ascending.
    axes : ndarray, shape (3, 3)
        Their eigenvectors as columns, in the head's axes.
    hidden : ndarray of bool, shape (3,)
        Axes along which the turn does not stand out from the noise of the rotations by four standard
        deviations: the pivot's coordinate along them is free.
    """

    spread: Array
    floor: Array
    mean: Array
    frames: int
    turn: Array
    axes: Array
    hidden: np.ndarray

    @property
    def hidden_in_world(self) -> Array:
        """Hidden axes as rows, in the world axes of the mean pose, shape (K, 3)."""
        return (nearest_rotation(self.mean) @ self.axes[:, self.hidden]).T


def rotation_noise(points: Array, pose: Pose) -> Array:
    """Covariance of a frame's rotation error in head axes, rad², shape (3, 3): ``sigma² J_c^-1``.

    sigma² is the mean squared residual of the rigid fit over its degrees of freedom (3 per marker less 6 per
    frame), J_c the second moment ``sum |p|² I - p p'`` of the template about its centroid. Skin that moves
    with the rotation leaves no residual and is not seen here.
    """
    square, seen = 0.0, 0
    for part in blocks(len(points)):
        # NaN where the pose is not known, too.
        residual = points[part] - apply_motion(pose.rotations[part], pose.translations[part], pose.template)
        square += float(np.nansum(residual**2))
        seen += int(np.isfinite(residual[:, :, 0]).sum())
    variance = square / max(3.0 * seen - 6.0 * int(pose.ok.sum()), 1.0)
    shape = pose.template - pose.template.mean(axis=0)
    inertia = (shape**2).sum() * np.eye(3) - shape.T @ shape
    return variance * np.linalg.pinv(inertia)


def motion_spread(points: Array, pose: Pose) -> Motion:
    """Second moment of the rotations about their mean, corrected for the noise in them.

    With ``R_i = (true)(I + [w]x)`` the noise adds ``E[w.w I - w w'] = tr(S) I - S`` per frame, S the rotation
    covariance in head axes: the errors-in-variables correction of Fuller, "Measurement error models" (1987).
    """
    rotations = pose.rotations[pose.known]
    if len(rotations) < 2:
        raise EvalkitError("fewer than two frames have a head pose; a pivot needs the head to turn")
    if not np.allclose(rotations[0].T @ rotations[0], np.eye(3), atol=1e-9):
        rotations = nearest_rotation(rotations)  # stretch is no turn
    mean = rotations.mean(axis=0)
    raw = len(rotations) * (np.eye(3) - mean.T @ mean)  # R'R = I spares the sum over frames
    noise = rotation_noise(points, pose)
    floor = len(rotations) * (np.trace(noise) * np.eye(3) - noise)
    turn, axes = np.linalg.eigh(raw - floor)
    along = np.einsum("ik,ij,jk->k", axes, floor, axes)
    hidden = turn <= 4.0 * np.sqrt(2.0 / len(rotations)) * along + 1e-12 * len(rotations)
    return Motion(raw - floor, floor, mean, len(rotations), turn, axes, hidden)


def block_covariance(influence: Array, ok: np.ndarray) -> Array:
    """Covariance of the sum of each frame's influence on an estimate, from sums over consecutive stretches.

    Frames close in time share their error (skin slides, a torso sways), so frames cannot be counted as
    independent; sums over stretches much longer than the correlation can.

    Parameters
    ----------
    influence : ndarray, shape (N, 3), mm
        Influence of every frame that was used, in order of time.
    ok : ndarray of bool, shape (F,)
        Which frames of the take these are.

    Returns
    -------
    ndarray, shape (3, 3), mm²

    References
    ----------
    Batch means: Flegal & Jones, Annals of Statistics 38 (2010), doi:10.1214/09-AOS735.
    """
    blocks = min(BLOCKS, max(len(ok) // 3, 2))
    which = (np.flatnonzero(ok) * blocks) // len(ok)
    sums = np.stack([np.bincount(which, influence[:, k], blocks) for k in range(3)], axis=1)
    sums -= sums.mean(axis=0)
    return sums.T @ sums * blocks / (blocks - 1)


def judge(
    position: Array,
    covariance: Array,
    points: Array,
    pose: Pose,
    *,
    converged: bool = True,
    evaluations: int = 0,
    trace: Array | None = None,
    motion: Motion | None = None,
    anchor: Array | None = None,
) -> Pivot:
    """Attach the verdict on observability to an estimate.

    Along an axis that the motion does not show (:class:`Motion`), the variance is infinite and the position is
    that of the markers' centroid, or of ``anchor`` (3,): a convention, not an estimate.
    """
    motion = motion_spread(points, pose) if motion is None else motion
    hidden_axes = motion.hidden_in_world
    scale = np.degrees(np.sqrt(np.maximum(motion.turn.sum() / 2.0 - motion.turn, 0.0) / motion.frames))
    centroid = (motion.mean @ pose.template.mean(axis=0)) + pose.translations[pose.known].mean(axis=0)
    position = position + ((centroid if anchor is None else anchor) - position) @ hidden_axes.T @ hidden_axes
    reach = float(np.linalg.norm(position - centroid))
    cov, axes, std = _with_infinite(covariance, hidden_axes)
    if len(hidden_axes):
        along = ", ".join(describe_axis(axis) for axis in hidden_axes)
        status = "unobservable"
        message = f"the head does not turn in a way that shows the pivot along {along}: that coordinate is free"
    elif np.isfinite(position).all() and std[0] > POOR * min(reach, HEAD_MM):
        status = "poorly-observable"
        message = (
            f"the pivot is uncertain by {std[0]:.1f} mm (one standard deviation) along {describe_axis(axes[0])}, "
            + (f"{std[0] / reach:.0%} of" if reach > 1.0 else "many times")
            + f" its distance from the markers ({reach:.0f} mm)"
            + ("" if converged else "; the search for it had not settled")
        )
    elif not (converged and np.isfinite(position).all()):
        status, message = "not-converged", "the search stopped before it settled; the position is its last point"
    else:
        status = "ok"
        message = f"largest standard deviation {std[0]:.2f} mm, along {describe_axis(axes[0])}"
    return Pivot(
        np.asarray(position, dtype=np.float64), cov, status, message, axes, std, np.sort(scale)[::-1],
        evaluations, np.empty((0, 6)) if trace is None else trace,
    )  # fmt: skip


def describe_axis(axis: Array) -> str:
    """An axis in words: its name if it lies within 15 degrees of a world axis, and its components."""
    axis = axis if axis[np.argmax(np.abs(axis))] > 0 else -axis
    k = int(np.argmax(np.abs(axis)))
    numbers = f"({axis[0]:+.2f}, {axis[1]:+.2f}, {axis[2]:+.2f})"
    return f"{'xyz'[k]} {numbers}" if abs(axis[k]) > np.cos(np.radians(15)) else numbers


def _with_infinite(covariance: Array, hidden: Array) -> tuple[Array, Array, Array]:
    """Covariance with infinite variance along the hidden axes, and its principal axes and deviations."""
    # Projecting the hidden axes out leaves a matrix whose other axes are what the motion does show.
    keep = np.eye(3) - hidden.T @ hidden
    values, vectors = np.linalg.eigh(keep @ np.where(np.isfinite(covariance), covariance, 0.0) @ keep)
    shown = [k for k in np.argsort(values)[::-1] if np.linalg.norm(hidden @ vectors[:, k]) < 0.5][: 3 - len(hidden)]
    axes = np.vstack([hidden, vectors[:, shown].T])
    std = np.concatenate([np.full(len(hidden), np.inf), np.sqrt(np.maximum(values[shown], 0.0))])
    cov = covariance.copy()
    for axis in hidden:
        outer = np.outer(axis, axis)
        cov = np.where(np.abs(outer) > 1e-12, np.copysign(np.inf, outer), cov)
    return cov, axes, std
