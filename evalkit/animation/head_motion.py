"""The head's own motion put back on the animated head, or small motions of its own."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from evalkit.geometry import Array, rotation_angle, rotation_from_vector
from evalkit.seeds import generator

LIMIT_DEG = 30.0
"""A half-cut mask before a plate looks right up to this turn; Huang et al. 2000, section 3.1."""

TRAVEL_MM = 60.0
"""A head that travels further from its middle place leaves the picture; then only its turns are shown."""

NECK_MM = (0.0, -40.0, -20.0)
"""About where a head turns in its own axes: the upper neck, below and behind the middle between the ears."""

IDLE = ((0, 2.0, 5.1), (1, 2.5, 7.3), (2, 1.0, 11.7))
"""Axis of the head (nod, shake, tilt), amplitude in degrees, period in s: slow enough to be no gesture."""


def idle_motion(times_s: Array, seed: int = 0) -> tuple[Array, Array]:
    """Nods and shakes of a listener: rotations (F, 3, 3) and translations (F, 3) mm about the neck."""
    random = generator("idle head motion", seed=seed)
    turn = np.zeros((len(times_s), 3))
    for axis, amplitude_deg, period_s in IDLE:
        # Three tones whose periods have no common measure: it never repeats within a take.
        for share, faster in ((0.6, 1.0), (0.3, 1.618), (0.1, 2.718)):
            phase = random.uniform(0.0, 2.0 * np.pi)
            turn[:, axis] += np.deg2rad(amplitude_deg) * share * np.sin(2 * np.pi * faster * times_s / period_s + phase)
    rotations = rotation_from_vector(turn)
    return rotations, np.array(NECK_MM) - rotations @ np.array(NECK_MM)


def within_picture(rotations: Array, translations: Array, middle: Array) -> tuple[Array, Array, bool]:
    """The motion about the head's middle place, and whether its travel was taken out.

    Parameters
    ----------
    rotations, translations : ndarray, shapes (F, 3, 3) and (F, 3), mm
    middle : ndarray, shape (3,), mm
        A point in the middle of the head whose place in the picture counts.
    """
    place = rotations @ middle + translations
    moved = place - np.median(place, axis=0)
    if np.abs(moved).max(initial=0.0) <= TRAVEL_MM:
        return rotations, translations - np.median(place, axis=0) + middle, False
    neck = np.array(NECK_MM)
    return rotations, neck - rotations @ neck, True


def beyond_limit(rotations: Array) -> np.ndarray:
    """Frames (F,) in which the head turns further from the front than a 2.5D head bears."""
    return np.asarray(np.rad2deg(rotation_angle(rotations)) > LIMIT_DEG)


def resample_rotations(rotations: Array, at: Array) -> Array:
    """Rotations (F, 3, 3) at fractional frames, along the shortest turn."""
    from scipy.spatial.transform import Slerp

    if len(rotations) == 1:
        return np.repeat(rotations, len(at), axis=0)
    return np.asarray(Slerp(np.arange(len(rotations)), Rotation.from_matrix(rotations))(at).as_matrix())
