"""Heads that turn about a fixed pivot, for the contract tests: small, exact, and made without evalkit."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

SHAPE = np.array(
    [[0.0, 104.5, 90.5], [22.5, 76.5, 100.5], [-22.5, 76.5, 100.5], [0.0, 35.5, 108.5], [47.0, 60.5, 92.0]]
)
"""Three forehead markers, the nose bridge and a brow, head frame, mm."""

PIVOT = np.array([5.0, -60.0, -10.0])
"""Neck pivot, mm; about 165 mm from the markers."""


def turning(frames=120, degrees=20.0, axes=(1.0, 0.8, 0.6), seed=0):
    """Smooth rotations (F, 3, 3) about all the axes whose share is not zero."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 1.0, frames)[:, None]
    angle = sum(np.sin(2 * np.pi * (k * time + rng.random(3))) for k in (1, 2.3, 3.7)) / 2.0
    return Rotation.from_rotvec(np.radians(degrees) * angle * np.asarray(axes)).as_matrix()


def about_one_axis(axis, frames=120, degrees=20.0):
    """Rotations about a single axis through the pivot."""
    axis = np.asarray(axis, dtype=float)
    angle = np.radians(degrees) * np.sin(np.linspace(0.0, 9.0, frames))
    return Rotation.from_rotvec(angle[:, None] * axis / np.linalg.norm(axis)).as_matrix()


def seen(rotations, shape=SHAPE, pivot=PIVOT, noise=0.0, seed=1):
    """Markers in the world (F, M, 3): ``R (P - O) + O`` and white noise."""
    x = np.einsum("fij,mj->fmi", rotations, shape - pivot) + pivot
    return x + noise * np.random.default_rng(seed).standard_normal(x.shape)


def lose(points, share=0.05, seed=2):
    """The same points with a share of the markers missing at random."""
    out = points.copy()
    out[np.random.default_rng(seed).random(points.shape[:2]) < share] = np.nan
    return out
