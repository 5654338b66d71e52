"""What the studies of head motion share: the data of a cell, the methods by name, the errors against the truth."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from evalkit.capture import Capture
from evalkit.capture.origin import local_origin
from evalkit.geometry import Array, cross_matrix, undo_motion
from evalkit.metrics import expression_error_mm, normalised_square, rms, rotation_error_deg
from evalkit.pivot import Pivot, pivot_estimators
from evalkit.pivot.bound import full_pivot_bound, inertia
from evalkit.pivot.spline import constant, cubic
from evalkit.pose import Pose, pose_estimators, reference_pose
from evalkit.pose.smooth import smooth
from evalkit.synthetic import Truth, synthesize

PAPER = "paper"
"""The paper's method as written: its rotations and its search, both with frame 0 as the reference."""

SMOOTHED = "joint smoothed"
"""``joint`` with its rotations smoothed over time about the pivot that it found."""


def told(doc: str | None) -> tuple[str, str]:
    """Question and finding of a study: the paragraphs of its docstring that begin with these words.

    They are written once, where a reader of the file looks for them.
    """
    # Python strips docstrings under -OO; a study runs without its words.
    paragraphs = [" ".join(text.split()) for text in inspect.cleandoc(doc or "").split("\n\n")]
    found = {head: text for head, colon, text in (text.partition(": ") for text in paragraphs) if colon}
    return found.get("Question", ""), found.get("Finding", "")


@dataclass(frozen=True, eq=False)
class HeadTake:
    """A synthetic take as the estimators see it, and its truth beside it.

    Attributes
    ----------
    take : Capture
    truth : Truth
    columns, others : ndarray of int
        Rigid markers, and the rest.
    points : ndarray, shape (F, R, 3), mm
        The rigid markers.
    origin : ndarray, shape (3,), mm
        Where searches start: the local origin from anatomy.
    free : Pose
        Each frame's pose by least squares, what pivot estimators start from.
    """

    take: Capture
    truth: Truth
    columns: Array
    others: Array
    points: Array
    origin: Array
    free: Pose


def head_take(preset: str = "talking", seed: int = 0, **overrides: Any) -> HeadTake:
    """The data of a cell: a synthetic take and what every pivot estimator gets."""
    take, truth = synthesize(preset, seed=seed, **overrides)
    columns = np.asarray(take.indices(truth.rigid))
    points = take.points[:, columns]
    others = np.setdiff1d(np.arange(len(take.labels)), columns)
    free = reference_pose(pose_estimators["svd"], points)
    return HeadTake(take, truth, columns, others, points, local_origin(take, columns), free)


def own(table: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of a table's entries that are this package's own, without peers and plugins."""
    return tuple(name for name, entry in table.items() if not entry.origin)


def one_per_family() -> tuple[str, ...]:
    """Pivot estimators, peers included, but of those that minimise the paper's objective only the paper's search."""
    return tuple(name for name in pivot_estimators if not name.startswith("nlopt-"))


def estimate_pivot(data: HeadTake, method: str, **options: Any) -> tuple[Pivot, Pose]:
    """Pivot, and the pose of every frame that goes with it.

    Methods are the names of the table of pivot estimators; :data:`PAPER`; :data:`SMOOTHED`; and ``joint`` followed by
    what it is told of the sway: ``joint none``, ``joint 1.25 s``.
    """
    if method == PAPER:
        pose = reference_pose(pose_estimators["translation-invariants"], data.points, 0)
        finder = pivot_estimators["six-directions"]
        return finder(data.points, pose, initial=data.origin, origin=data.origin, reference=0, **options), pose
    if method == SMOOTHED:
        pivot, pose = estimate_pivot(data, "joint", **options)
        return pivot, smooth(pose, data.points, rate=data.take.rate, about=pivot.position).pose
    name, _, sway = method.partition(" ")
    given: dict[str, Any] = {"initial": data.origin, "origin": data.origin, "rate": data.take.rate, "sway": "auto"}
    if sway:
        given["sway"] = sway if sway in ("none", "auto") else float(sway.removesuffix(" s"))
    pivot = pivot_estimators[name](data.points, data.free, **{**given, **options})
    return pivot, data.free if pivot.pose is None else pivot.pose


PIVOT_COLUMNS = {
    "pivot_mm": "distance of the pivot from its true mean place |O - O*|, mm",
    "bound_mm": "Cramér-Rao bound of that distance, sqrt(trace B), mm",
    "form": "e' B^-1 e / 3 of the error e; 1 on average at the bound",
    "stated": "e' C^+ e / d for the stated covariance C over its d finite axes; 1 on average if honest",
    "verdict": "what the estimator says of itself",
    "spacing_s": "knot spacing of the sway that was modelled, s; empty for none",
}
"""Columns of :func:`score_pivot`."""


def score_pivot(data: HeadTake, result: tuple[Pivot, Pose]) -> dict[str, Any]:
    """Errors of a pivot against truth and bound; the bound knows as much of the sway as the estimator modelled."""
    pivot = result[0]
    truth, frames = data.truth, data.take.frames
    spacing = pivot.sway_spacing_s
    basis = constant(frames) if np.isinf(spacing) else cubic(frames, data.take.rate, spacing)
    visible = truth.visible[:, data.columns]
    shape = truth.neutral[data.columns] - truth.pivot
    noise = max(truth.noise_mm, 1e-12)
    bound = full_pivot_bound(shape, truth.rotations, noise, None if visible.all() else visible, basis)
    error = pivot.position - (truth.pivot + truth.sway.mean(axis=0))
    return {
        "pivot_mm": float(np.linalg.norm(error)),
        "bound_mm": float(np.sqrt(np.trace(bound))),
        "form": normalised_square(error, bound),
        "stated": normalised_square(error, pivot.covariance),
        "verdict": pivot.status,
        "spacing_s": None if np.isinf(spacing) else float(spacing),
    }


HEAD_COLUMNS = {
    "rotation_deg": "rotation error, rms over the frames after the one constant rotation that fits best, deg",
    "expression_mm": "error of the compensated markers that the pose did not see, rms after one rigid alignment, mm",
    "expression_bound_mm": "smallest such error with each frame's turn unknown and all else known, mm",
}
"""Columns of :func:`score_head`."""


def score_head(data: HeadTake, pose: Pose) -> dict[str, Any]:
    """Errors of the head motion, and of the expression that is left when it is undone."""
    truth = data.truth
    undone = undo_motion(pose.rotations, pose.translations, data.take.points[:, data.others])
    clean = truth.clean[:, data.others]
    shape = truth.neutral[data.columns] - truth.pivot
    return {
        "rotation_deg": rms(rotation_error_deg(pose.rotations, truth.rotations)),
        "expression_mm": rms(expression_error_mm(undone, clean)),
        "expression_bound_mm": expression_bound(shape, clean - truth.pivot, truth.noise_mm),
    }


def expression_bound(shape: Array, markers: Array, sigma_mm: float) -> float:
    """Smallest rms error of compensated markers, mm: shape and path of the pivot known, each frame's turn not.

    ``3 sigma² + sigma² trace([d]x J_p^-1 [d]x')`` on average over the markers d about the pivot, (F, M, 3): their
    own noise, and the turn estimated from rigid markers of inertia J_p. Frames that share what they know of the
    turn, by a model of how a head moves, could do better.
    """
    lever = cross_matrix(markers.reshape(-1, 3))
    turned = np.einsum("nij,jk,nik->n", lever, np.linalg.inv(inertia(shape)), lever, optimize=True)
    return sigma_mm * float(np.sqrt(3.0 + turned.mean()))
