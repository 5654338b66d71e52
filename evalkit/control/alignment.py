"""Head pose apart from deformation, by what does not deform: the default way to prepare a take for a database.

Three steps. The noise of all markers is cut off where singular values come down to it (:func:`denoised`): the rows of
the centred positions lie in a space of few dimensions, rotation or not, so that soft markers help to place rigid ones.
Every frame is then laid on the rigid shape, each marker with the inverse of its variance (:func:`align`). Last, the
principal components of the aligned shapes are the bases (:func:`aligned_bases`).

Unlike a factorisation (:mod:`evalkit.control.factorisation`) this needs markers that stay on the skull, and no more
dimensions of deformation than there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.capture import Capture
from evalkit.capture.rigid import MIN_SEEN, RigidMarkers, choose_rigid
from evalkit.compensation import pose_or_error
from evalkit.control.denoising import denoised, noise_level, principal, scores
from evalkit.errors import EvalkitError
from evalkit.geometry import Array, apply_motion, cross_matrix, mean_rotation, undo_motion
from evalkit.pose import Pose, PoseEstimator, pose_estimators, reference_pose
from evalkit.pose.model import whole_markers
from evalkit.pose.skin import SkinMarkers, automatic_rigid, skin_estimator

FLOOR = 1e-5
"""Smallest standard deviation of a rigid marker relative to the size of their shape, in takes without noise."""

MAX_ROUNDS = 50
TOLERANCE = 1e-3
"""Largest relative change of a weight in the last round."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """A take as ``x = R_f p_f + t_f``, p the deformed shape in the head's axes.

    Attributes
    ----------
    rotations : ndarray, shape (F, 3, 3)
        Determinant +1; their mean rotation is the identity. NaN in frames without a pose.
    translations : ndarray, shape (F, 3), mm
        Where the mean of the rigid markers' template is: the origin of the shapes.
    shapes : ndarray, shape (F, M, 3), mm
        Every marker with the head motion undone, as measured (not denoised); NaN where it or the pose is missing.
    frame_status : ndarray of int8, shape (F,)
        :class:`~evalkit.errors.FrameStatus` of every frame.
    chosen : RigidMarkers
        The markers that the head was laid on, with their weights.
    template : ndarray, shape (R, 3), mm
        Their shape.
    noise_mm : float
        Standard deviation per axis of the noise.
    rank : int
        Dimensions that were kept of the centred positions, at most the number of markers.
    rounds : int
        How often the weights were made anew; 0 for those of the skin model.
    warnings : list of str
    """

    rotations: Array
    translations: Array
    shapes: Array
    frame_status: NDArray[np.int8]
    chosen: RigidMarkers
    template: Array
    noise_mm: float
    rank: int
    rounds: int
    warnings: list[str] = field(default_factory=list)


def align(
    take: Capture,
    rigid: str | Sequence[str] = "auto",
    noise_mm: float | None = None,
    truncate: bool = True,
) -> Alignment:
    """Lay every frame of a take on its rigid shape, with the noise cut off first.

    Parameters
    ----------
    take : Capture
    rigid : "auto" or sequence of str
        Markers over bone: weights ``1 / (variance + noise²)`` from what is left of their motion, made anew until they
        settle. ``"auto"``: all markers, each weighted by how its skin moves, as in :func:`evalkit.compensate`
        (:mod:`evalkit.pose.skin`); where that cannot be had, the set whose distances vary least.
    noise_mm : float, optional
        Standard deviation per axis; estimated by :func:`noise_level` if not given.
    truncate : bool
        Cut the noise off. Without it this is the toolkit's ordinary compensation.

    Returns
    -------
    Alignment

    Raises
    ------
    EvalkitError
        If a label is not known, no three markers can serve, or the noise is not a positive number. Frames that cannot
        answer get a status instead.
    """
    positions = np.flatnonzero([kind == "position" for kind in take.quantities])
    points = whole_markers(take.points)
    if noise_mm is None:
        noise_mm = noise_level(points[:, positions])
    elif not np.isfinite(noise_mm) or noise_mm <= 0:
        raise EvalkitError(f"noise of {noise_mm} mm; give a standard deviation above 0, or leave it out")
    chosen, estimator = _markers(take, rigid)
    warnings = [*take.warnings, *chosen.warnings]
    columns = np.asarray(chosen.columns)
    first = pose_or_error(pose_estimators["svd"], points[:, columns], "mean", chosen, "svd")
    used, rank = points, len(positions)
    if truncate:
        middle = apply_motion(first.rotations, first.translations, first.template.mean(axis=0)[None])[:, 0]
        # Markers seldom seen are not part of the matrix; those that the pose needs always are.
        often = positions[np.isfinite(points[:, positions, 0]).mean(axis=0) >= MIN_SEEN]
        kept = np.union1d(often, columns)
        used = points.copy()
        cut, rank = denoised(points[:, kept] - middle[:, None], noise_mm)
        # Frames without a pose keep what they have: their status is to come from it.
        used[:, kept] = np.where(first.ok[:, None, None], cut + middle[:, None], points[:, kept])
    if estimator is not None:
        posed, rounds = reference_pose(estimator, used[:, columns], labels=chosen.labels), 0
    else:
        posed, rounds = _procrustes(used[:, columns], noise_mm, chosen.labels)
    origin, middle_turn = posed.template.mean(axis=0), mean_rotation(posed.rotations)
    rotations = posed.rotations @ middle_turn.T
    translations = apply_motion(posed.rotations, posed.translations, origin[None])[:, 0]
    shapes = np.full(points.shape, np.nan)
    shapes[:, positions] = undo_motion(rotations, translations, points[:, positions])
    return Alignment(
        rotations, translations, shapes, posed.status, chosen, (posed.template - origin) @ middle_turn.T,
        noise_mm, rank, rounds, warnings,
    )  # fmt: skip


def _markers(take: Capture, rigid: str | Sequence[str]) -> tuple[RigidMarkers, PoseEstimator | None]:
    """Markers over bone, and the estimator that knows how their skin moves, if they were weighted automatically."""
    if not (isinstance(rigid, str) and rigid == "auto"):
        return choose_rigid(take, rigid), None
    found: SkinMarkers = automatic_rigid(take)
    return found, None if found.model is None else skin_estimator(found.model)


def _procrustes(points: Array, noise_mm: float, labels: Sequence[str]) -> tuple[Pose, int]:
    """Poses by least squares with weights ``1 / (variance + floor²)``, made anew until they settle, and the rounds."""
    svd = pose_estimators["svd"]
    posed = reference_pose(svd, points, labels=labels)
    size = float(np.sqrt(((posed.template - posed.template.mean(axis=0)) ** 2).sum(axis=1).mean()))
    # Without a floor the weights collapse onto three markers, which any pose fits.
    floor = max(noise_mm, FLOOR * size) ** 2
    before: Array = np.zeros(points.shape[1])
    for k in range(MAX_ROUNDS):
        still = undo_motion(posed.rotations, posed.translations, points)
        inverse = 1.0 / (np.nanvar(still, axis=0).mean(axis=1) + floor)
        inverse /= inverse.max()
        if np.abs(inverse - before).max() < TOLERANCE:
            return posed, k
        before = inverse
        posed = reference_pose(svd, points, weights=inverse, labels=labels)
    return posed, MAX_ROUNDS


@dataclass(frozen=True, eq=False)
class AlignedBases:
    """Principal components of aligned shapes: ``mean + sum_l a_fl B_l``.

    Attributes
    ----------
    mean : ndarray, shape (M, 3), mm
    bases : ndarray, shape (L, M, 3)
        Orthonormal, the strongest first; the element of the largest size is positive.
    coefficients : ndarray, shape (F, L), mm
        NaN in frames without any marker.
    kept : float
        Part of the variance about the mean that the bases keep, 0 to 1: by the aligned shapes.
    kept_by_factor : float
        Part of the sum of squares of the matrix M of a factorisation, as given here, that rank 3L keeps: the paper's
        figure. It does not depend on the pose, and is 1 whatever moves once 3L reaches the number of markers.
    vacuous : bool
        Whether it has.
    rigid_share : ndarray, shape (3,)
        Of a small nod, turn and tilt of the mean shape about its origin (axes x, y, z), the part (by its square, the
        translation left out) that lies in the span of the bases: how much of it could as well be an expression. An
        opening jaw gives much to the nod. Shapes that were laid on all of their markers have 0, which proves nothing:
        there the expression has been taken for the nod.
    """

    mean: Array
    bases: Array
    coefficients: Array
    kept: float
    kept_by_factor: float
    vacuous: bool
    rigid_share: Array


def aligned_bases(
    shapes: ArrayLike, count: int | None = None, variance: float | None = None, rest_mm: ArrayLike | None = None
) -> AlignedBases:
    """Principal components of aligned shapes.

    Parameters
    ----------
    shapes : array_like, shape (F, M, 3), mm, NaN where missing
        Positions in the head's axes, such as :attr:`Alignment.shapes`; or displacements from a rest.
    count : int, optional
        L, how many to keep.
    variance : float, optional
        Or as many as keep this part of the variance, 0 to 1. One of the two is needed.
    rest_mm : array_like, shape (M, 3), mm, optional
        The rest that displacements are counted from, so that ``kept_by_factor`` and ``rigid_share`` are those of the
        positions.

    Returns
    -------
    AlignedBases

    Raises
    ------
    EvalkitError
        If neither or both of count and variance are given, they are out of range, or a marker is never seen.

    Notes
    -----
    Where markers are missing, bases and coefficients are those of probabilistic principal components, from what is seen
    (:func:`evalkit.control.denoising.principal`), and ``kept`` counts what is seen.
    """
    x = whole_markers(shapes)
    if x.ndim != 3 or x.shape[2] != 3:
        raise EvalkitError(f"shapes have shape {x.shape}; expected (frames, markers, 3)")
    if (count is None) == (variance is None):
        raise EvalkitError("give either the count of bases or the variance to keep")
    frames, markers = x.shape[:2]
    rest = np.zeros((markers, 3)) if rest_mm is None else np.asarray(rest_mm, dtype=np.float64)
    seen = np.isfinite(x[:, :, 0])
    never = np.flatnonzero(~seen.any(axis=0))
    if len(never):
        raise EvalkitError(f"marker {never[0]} of {markers} is missing in every frame; leave it out")
    most = min(int(seen.any(axis=1).sum()) - 1, 3 * markers)
    if count is not None and not 1 <= count <= most:
        raise EvalkitError(f"{count} bases of {markers} markers in {frames} frames; ask for 1 to {most}")
    if variance is not None and not 0.0 < variance <= 1.0:
        raise EvalkitError(f"variance {variance} to keep; give a part above 0 and up to 1")

    def kept(strength: Array, _: int) -> int:
        if count is not None:
            return count
        power = np.cumsum(strength**2) / max(float((strength**2).sum()), 1e-300)
        # Rounding of the sum must not ask for one more than there are.
        return min(int(np.searchsorted(power, float(variance or 1.0) - 1e-12)) + 1, most)

    mean = np.nanmean(x, axis=0)
    rows = (x - mean).reshape(frames, -1)
    axes, spread, others = principal(rows, kept)
    coefficients = scores(rows, axes, spread, others)
    coefficients[~seen.any(axis=1)] = np.nan
    total, left = np.nansum(rows**2), np.nansum((rows - coefficients @ axes.T) ** 2)
    bases = axes.T.reshape(-1, markers, 3)
    vacuous = 3 * len(bases) >= markers
    # What the bases say of markers that are missing stands in for them.
    positions = np.where(np.isfinite(x), x, mean + np.tensordot(coefficients, bases, axes=1))[seen.any(axis=1)] + rest
    squares = np.linalg.svd(np.linalg.qr(positions.transpose(0, 2, 1).reshape(-1, markers), mode="r"), compute_uv=False)
    squares = squares**2
    return AlignedBases(
        mean, bases, coefficients, float(1.0 - left / total) if total > 0 else 1.0,
        1.0 if vacuous else float(squares[: 3 * len(bases)].sum() / squares.sum()), vacuous,
        rigid_share(mean + rest, bases),
    )  # fmt: skip


def rigid_share(shape: ArrayLike, bases: ArrayLike) -> Array:
    """Part of a small turn of a shape about each axis through the origin that lies in the span of bases.

    ``|P (d - t)|² / |d - t|²`` for the field ``d_m = e x p_m`` of the turn about the axis e, its mean t left out (of
    shape and bases: a translation is free), and P the projection on the span of the bases.

    Parameters
    ----------
    shape : array_like, shape (M, 3), mm
    bases : array_like, shape (L, M, 3)

    Returns
    -------
    ndarray, shape (3,)
        For x, y and z: nod, turn and tilt in frontal axes.
    """
    p, b = np.asarray(shape, dtype=np.float64), np.asarray(bases, dtype=np.float64)
    turns = np.einsum("eij,mj->emi", cross_matrix(np.eye(3)), p)
    turns -= turns.mean(axis=1, keepdims=True)
    spanning, size, _ = np.linalg.svd((b - b.mean(axis=1, keepdims=True)).reshape(len(b), -1).T, full_matrices=False)
    # A basis that is a translation spans nothing here.
    spanning = spanning[:, size > 1e-9 * size.max(initial=1e-300)]
    inside = turns.reshape(3, -1) @ spanning
    return np.asarray((inside**2).sum(axis=1) / np.maximum((turns**2).sum(axis=(1, 2)), 1e-300))
