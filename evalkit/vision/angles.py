"""Rotations of a head as the three angles that people speak of."""

from __future__ import annotations

import numpy as np

from evalkit.geometry import Array

AXES = ("pitch", "yaw", "roll")


def head_angles_deg(rotations: Array) -> Array:
    """Pitch, yaw and roll of ``R = R_y(yaw) R_x(pitch) R_z(roll)``, degrees.

    Parameters
    ----------
    rotations : ndarray, shape (F, 3, 3)
        From the head to the camera's axes (:mod:`evalkit.vision.camera`), NaN where unknown.

    Returns
    -------
    ndarray, shape (F, 3)
        Positive pitch: the chin goes down. Positive yaw: to the person's left. Positive roll: the top of the head goes
        to the person's right. NaN where there is no rotation.
    """
    from scipy.spatial.transform import Rotation

    known = np.isfinite(rotations).all(axis=(1, 2))
    out = np.full((len(rotations), 3), np.nan)
    if known.any():
        out[known] = Rotation.from_matrix(rotations[known]).as_euler("YXZ", degrees=True)[:, [1, 0, 2]]
    return out
