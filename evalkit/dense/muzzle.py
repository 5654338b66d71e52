"""A face of very different proportions: the head of a person bent into one with a long muzzle.

The monkey of Kato et al. (2014) is such a face. Space itself is bent, smoothly, so the mesh keeps its vertices and
every expression of the person can be carried over without any method of transfer.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import RBFInterpolator

from evalkit.dense.anatomy import Anatomy
from evalkit.dense.sculptor import jaw_angle, settled, with_jaw, without_jaw
from evalkit.geometry import Array
from evalkit.head import Head

Warp = Callable[[Array], Array]

MOVES_MM: dict[str, tuple[float, float, float]] = {
    "forehead": (0, -8, -16),
    "nasion": (0, -2, -2),
    "nose tip": (0, 8, 6),
    "Nose": (-4, 6, 16),
    "subnasale": (0, 6, 24),
    "upper lip": (0, 6, 40),
    "lower lip": (0, -7, 38),
    "chin": (0, -8, 22),
    "mouth corner": (15, -3, 22),
    "eye inner": (-2, 1, -1),
    "eye outer": (-3, 0, 1),
    "brow inner": (0, 0, 7),
    "brow outer": (1, -1, 6),
    "Cheek": (2, 2, 4),
}
"""Landmark or marker site -> its way, left side; both sides where there are two."""

LIP_LINE_MM = (0.0, -0.5, 40.0)
"""Way of the middle of the line between the lips, so that both grow thick."""

STILL_MM = ((75.0, 37.0, 37.0), (70.0, -45.0, 35.0), (60.0, 100.0, 60.0), (40.0, -90.0, 40.0), (60.0, 20.0, -40.0))
"""Places on the left, and mirrored on the right, beyond which the head stays as it is."""

STEP_MM = 1e-3
"""Of the central differences of the warp; its curvature is over tens of millimetres."""


def muzzle_warp(head: Head, lip_line: Array) -> Warp:
    """The map of space by thin-plate splines through moved landmarks.

    Parameters
    ----------
    head : Head
    lip_line : ndarray, shape (3,), mm
        The middle of the line between the lips.

    Returns
    -------
    callable
        Places (N, 3), mm, to places (N, 3).
    """
    known = head.marker_sites | head.landmarks
    places, moves = [lip_line], [np.array(LIP_LINE_MM)]
    for name, move in MOVES_MM.items():
        if name in known:
            places.append(known[name])
            moves.append(np.array(move, dtype=np.float64))
        for ends, sign in (((" left", "L"), 1.0), ((" right", "R"), -1.0)):
            for found in [known[name + end] for end in ends if name + end in known]:
                places.append(found)
                moves.append(np.array(move) * [sign, 1.0, 1.0])
    for still in STILL_MM:
        places += [np.array(still), np.array(still) * [-1.0, 1.0, 1.0]]
        moves += [np.zeros(3)] * 2
    spline = RBFInterpolator(np.array(places), np.array(moves), kernel="thin_plate_spline")

    def warp(points: Array) -> Array:
        return np.asarray(points + spline(points))

    return warp


def jacobian(warp: Warp, points: Array) -> Array:
    """Derivative of a warp at places (N, 3), shape (N, 3, 3)."""
    steps = STEP_MM * np.eye(3)
    columns = [(warp(points + step) - warp(points - step)) / (2.0 * STEP_MM) for step in steps]
    return np.stack(columns, axis=2)


def carried(rest: Array, shapes: Array, anatomy: Anatomy, warp: Warp, bent: Anatomy) -> Array:
    """Expressions of a person in the geometry of a bent face.

    The jaw turns by the same angle about the bent face's hinge; what else moves is stretched with the skin, by the
    derivative of the warp.

    Parameters
    ----------
    rest : ndarray, shape (V, 3), mm
    shapes : ndarray, shape (N, V, 3), mm
    anatomy : Anatomy
        Of the person.
    warp : callable
    bent : Anatomy
        Of the bent face.

    Returns
    -------
    ndarray, shape (N, V, 3), mm
    """
    angle = jaw_angle(rest, shapes, anatomy)
    moves = np.einsum("vij,nvj->nvi", jacobian(warp, rest), without_jaw(rest, shapes, anatomy, angle))
    there = warp(rest)
    return settled(there, with_jaw(there + moves, bent, angle))
