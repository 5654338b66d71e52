"""The jaw behind the skin: what lower teeth and tongue do when the chin is seen to move."""

from __future__ import annotations

import numpy as np

from evalkit.geometry import Array
from evalkit.head import Head
from evalkit.head.model import JAW_LIMIT_DEG, SOFT, Indices

LEADING_SITES = ("Chin", "LowerLipC")
"""The chin is skin on the jaw; the lower lip has a mind of its own and stands in only where no chin is marked."""

GLIDE_LIMIT_MM = 8.0
"""A jaw slides sideways and forward by about so much at most."""


def jaw_followers(head: Head) -> tuple[Indices, Array]:
    """Vertices that no marker moves and that follow the jaw, with their share of it."""
    if head.jaw is None:
        return np.zeros(0, dtype=np.intp), np.zeros(0)
    rigid = head.part_vertices(*(name for name in head.parts if name not in SOFT))
    which = np.setdiff1d(rigid[head.jaw.weights[rigid] > 0], head.soft_vertices)
    return which, head.jaw.weights[which]


def jaw_motion(head: Head, displacement: dict[str, Array]) -> tuple[Array, Array]:
    """Opening and glide of the jaw from the displacement of the chin.

    The opening turns the chin about the axis of the jaw as far as it was seen to move; the glide is what remains
    sideways and along the arm from the axis to the chin.

    Parameters
    ----------
    head : Head
    displacement : dict of str to ndarray, shape (F, 3), mm
        Of marker sites, in the head's axes and size.

    Returns
    -------
    angle_deg : ndarray, shape (F,)
        0 to :data:`~evalkit.head.model.JAW_LIMIT_DEG`.
    glide : ndarray, shape (F, 3), mm
    """
    frames = len(next(iter(displacement.values())))
    lead = next((name for name in LEADING_SITES if name in displacement), None)
    if head.jaw is None or lead is None:
        return np.zeros(frames), np.zeros((frames, 3))
    place, moved = head.marker_sites[lead], displacement[lead]
    share = float(head.jaw.weights[head.nearest_vertices({lead: place})[lead]]) or 1.0
    arm = (place - head.jaw.axis)[1:]
    now = arm + moved[:, 1:]
    # Opening lowers what lies in front of the axis: from z towards -y.
    turned = np.arctan2(now[:, 1] * arm[0] - now[:, 0] * arm[1], now @ arm)
    angle = np.clip(np.rad2deg(turned) / share, 0.0, JAW_LIMIT_DEG)
    length = np.linalg.norm(now, axis=1)
    forward = np.where(turned[:, None] > 0, now / length[:, None], arm / np.linalg.norm(arm))
    along = np.einsum("fi,fi->f", now, forward) - np.linalg.norm(arm)
    glide = np.column_stack([moved[:, 0], forward * along[:, None]])
    return angle, np.clip(glide, -GLIDE_LIMIT_MM, GLIDE_LIMIT_MM)


def follow_jaw(places: Array, share: Array, axis: Array, angle_deg: Array, glide: Array) -> Array:
    """Places (N, 3) that follow the jaw by a share (N,), in every frame (F,); returns (F, N, 3), mm."""
    angle = np.deg2rad(angle_deg)[:, None] * share
    y, z = (places - axis)[:, 1], (places - axis)[:, 2]
    out = places + share[:, None] * glide[:, None, :]
    out[:, :, 1] += (np.cos(angle) - 1.0) * y - np.sin(angle) * z
    out[:, :, 2] += np.sin(angle) * y + (np.cos(angle) - 1.0) * z
    return out
