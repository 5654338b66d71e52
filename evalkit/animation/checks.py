"""What can be seen to be wrong with an animation without a truth to compare with."""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.animation.lips import find_lips, overlap
from evalkit.animation.performance import Animation
from evalkit.geometry import Array

CROSSING_MM = 0.2
"""Lips that are this far through each other show it; less is hidden by their rounding."""

JUMP_MM_S = 600.0
"""No skin moves so fast: a jaw that snaps shut makes 300 mm/s."""

CHECKED_PARTS = ("skin", "mouth pocket")
"""Lids roll over the eyeball and turn round on purpose."""


def check(animation: Animation) -> dict[str, Any]:
    """Go through all frames once.

    Parameters
    ----------
    animation : Animation

    Returns
    -------
    dict
        ``mouth_correlation``: between the take's distance from the bridge of the nose to the chin and the opening of
        the head's lips, None where one of them is not there or does not move. ``largest_step_mm`` and
        ``largest_step_frame``: of a vertex of the skin from one frame to the next, head motion left out, and the
        later frame. ``crossing_frames``: frames in which the lips are more than :data:`CROSSING_MM` through each
        other. ``flipped_triangles`` and ``flipped_frames``: of skin and mouth, the most in a frame that face the
        other way than at rest, and frames with any. ``warnings``: of these, what a user should look at, in words.
    """
    head, lips = animation.head, find_lips(animation.head)
    triangles = head.part_triangles(*CHECKED_PARTS)
    skin = head.part_vertices("skin")
    at_rest = _normals(head.vertices[None], triangles)[0]
    touching = None if lips is None else np.maximum(overlap(lips, head.vertices[None])[0], 0.0)
    opening, crossing, flipped = np.full(animation.frames, np.nan), 0, np.zeros(animation.frames, dtype=int)
    step, step_frame, before = 0.0, 0, None
    for start, part in animation.batches():
        rows = slice(start, start + len(part))
        if lips is not None and touching is not None:
            gap = -overlap(lips, part)
            opening[rows] = np.median(gap, axis=1)
            crossing += int(((-gap - touching) > CROSSING_MM).any(axis=1).sum())
        flipped[rows] = (np.einsum("fti,ti->ft", _normals(part, triangles), at_rest) < 0.0).sum(axis=1)
        moved = np.concatenate([part[:1, skin] if before is None else before, part[:, skin]])
        jump = np.linalg.norm(np.diff(moved, axis=0), axis=2).max(axis=1)
        if jump.max() > step:
            step, step_frame = float(jump.max()), start + int(jump.argmax())
        before = part[-1:, skin].copy()
    words = []
    if step * animation.rate_hz > JUMP_MM_S:
        words.append(
            f"the face jumps by {step:.0f} mm at frame {step_frame}: labels exchanged, or a marker comes back elsewhere"
        )
    if flipped.any():
        words.append(
            f"{int((flipped > 0).sum())} frames have triangles that are turned over, most in frame "
            f"{int(flipped.argmax())}: markers nearer to each other than they can be"
        )
    return {
        "mouth_correlation": mouth_correlation(animation, opening),
        "largest_step_mm": step,
        "largest_step_frame": step_frame,
        "crossing_frames": crossing,
        "flipped_triangles": int(flipped.max(initial=0)),
        "flipped_frames": int((flipped > 0).sum()),
        "warnings": words,
    }


def mouth_correlation(animation: Animation, opening: Array) -> float | None:
    """Correlation of the take's nose to chin distance with the head's opening (F,) of the lips."""
    names = animation.report["marker_order"]
    if not {"NoseBridge", "Chin"} <= set(names):
        return None
    nose, chin = (animation.still_markers[:, names.index(name)] for name in ("NoseBridge", "Chin"))
    distance = np.linalg.norm(chin - nose, axis=1)
    known = np.isfinite(distance) & np.isfinite(opening)
    if known.sum() < 3 or min(np.std(distance[known]), np.std(opening[known])) < 1e-6:
        return None
    return float(np.corrcoef(distance[known], opening[known])[0, 1])


def _normals(vertices: Array, triangles: np.ndarray) -> Array:
    a, b, c = (vertices[:, triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a)
