"""Takes with the head motion undone: methods by name, and what is left of the motion in every part of the face."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from evalkit.compensation import Compensation, compensate
from evalkit.geometry import Array
from evalkit.metrics import (
    REGIONS,
    error_by_region_mm,
    expression_error_mm,
    normalised_square,
    pivot_error_mm,
    rms,
    rotation_error_deg,
    translation_error_mm,
)
from evalkit.published import compensate_as_published
from evalkit.studies.takes import PAPER, HeadTake
from evalkit.study.statistics import Statistic, mean, root_mean_square

SMOOTH = " smooth"
"""Behind the name of a method: its rotations smoothed over time."""


def compensate_by(data: HeadTake, method: str, rigid: str | Sequence[str] | None = None) -> Compensation:
    """A take without its head motion, by the name of a method.

    Methods are :data:`PAPER`; ``auto``, markers weighted automatically; ``joint``, turned about the pivot; ``joint
    none``, the same told that the neck stands still; ``robust joint``, the same with the weights that ``robust`` gave
    each marker in each frame; and the names of pose estimators, each frame by itself. All but the first may have
    :data:`SMOOTH` behind.

    Parameters
    ----------
    data : HeadTake
    method : str
    rigid : "auto" or sequence of str, optional
        Rigid markers; those of the layout if not given.
    """
    markers: str | Sequence[str] = data.truth.rigid if rigid is None else rigid
    if method == PAPER:
        return compensate_as_published(data.take, markers)
    name = method.removesuffix(SMOOTH)
    options: dict[str, Any] = {"smooth": name != method}
    if name == "auto":
        markers = "auto"
    elif name == "joint none":
        options["sway"] = "none"
    elif name == "robust joint":
        options["pose"] = "robust"
    elif name != "joint":
        options.update(pose=name, pivot="svd", sway="per-frame")
    return compensate(data.take, markers, **options)


COMPENSATION_COLUMNS = {
    "posed": "share of the frames with a head pose",
    "rotation_deg": "rms over those frames of the angle between estimated and true rotation, gauge-aligned, deg",
    "translation_mm": "rms distance of the rigid markers' centroid from its true place, one fixed offset aside, mm",
    "expression_mm": "rms error of the compensated markers that are not rigid, after one rigid alignment, mm",
    "pivot_mm": "distance of the pivot's mean place from the true one, mm",
    "stated": "e' C^+ e / d for the stated covariance C of the pivot over its d finite axes; 1 on average if honest",
    "sound": "1 if the pivot's status is ok, else 0",
    "verdict": "the pivot's status",
    "translation": "what the translation was taken to be: none, per-frame or knots that many seconds apart",
}
"""Columns of :func:`score_compensation`."""

REGION_COLUMNS = {
    f"{region}_mm": f"the same error of the markers of the {region}, rigid ones included, mm" for region in REGIONS
}
"""Columns of :func:`score_regions`."""

COMPENSATION_STATISTICS: tuple[Statistic, ...] = (
    mean("posed", "frames posed", "", less=False),
    root_mean_square("rotation_deg", "rotation", "deg"),
    root_mean_square("translation_mm", "translation", "mm"),
    root_mean_square("expression_mm", "expression", "mm"),
)
REGION_STATISTICS: tuple[Statistic, ...] = tuple(
    root_mean_square(column, column[:-3], "mm") for column in REGION_COLUMNS
)


def _errors(data: HeadTake, result: Compensation) -> Array:
    """Expression error of every sample (F, M), NaN where the capture shows another marker or a ghost."""
    truth = data.truth
    # Which place a spoilt sample has is no question to a head motion.
    spoilt = truth.outliers | truth.swapped
    still = np.where(spoilt[:, :, None], np.nan, result.capture.points)
    return expression_error_mm(still, truth.clean)


def score_compensation(data: HeadTake, result: Compensation) -> dict[str, Any]:
    """Errors of rotation, translation, expression and pivot against the truth."""
    truth, r, t = data.truth, result.rotations, result.translations
    centroid = truth.neutral[data.columns].mean(axis=0)
    error = result.pivot + np.nanmean(result.sway, axis=0) - (truth.pivot + truth.sway.mean(axis=0))
    return {
        "posed": float((result.frame_status == 0).mean()),
        "rotation_deg": rms(rotation_error_deg(r, truth.rotations)),
        "translation_mm": rms(translation_error_mm(r, t, truth.rotations, truth.translations, centroid)),
        "expression_mm": rms(_errors(data, result)[:, data.others]),
        "pivot_mm": pivot_error_mm(result.pivot, result.sway, truth.pivot, truth.sway),
        "stated": normalised_square(error, result.pivot_covariance),
        "sound": int(result.status == "ok"),
        "verdict": result.status,
        "translation": str(result.sway_used),
    }


def score_regions(data: HeadTake, result: Compensation) -> dict[str, float]:
    """Expression error of each region of the face."""
    found = error_by_region_mm(_errors(data, result), data.truth.labels)
    return {f"{region}_mm": value for region, value in found.items()}
