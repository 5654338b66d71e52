"""Head motion: smooth angles of nod, turn and tilt, and the slow sway of the neck itself.

Angles are made of what people do with their heads in conversation: postures that are held and then left
for another one (minimum-jerk changes with pauses between them), short bursts of nodding or shaking at one
to two cycles a second, and a slight wander, so that a head is never perfectly still.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evalkit.seeds import generator

AXES = ("nod", "turn", "tilt")
"""The three angles: nod about x (positive: face down), turn about y (positive: to the performer's left),
tilt about z (positive: towards the right shoulder)."""

BURST_HZ = (1.2, 2.4)
"""Cycles per second of a nodding or shaking burst."""

WANDER_HZ = (0.1, 0.8)
"""Band of the slight wander, Hz."""

SWAY_SHARE = np.array([1.0, 0.4, 0.8])
"""Relative size of the sway along x, y and z: a standing body sways sideways and to and fro, less up."""


def minimum_jerk(phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """The smoothest step from 0 to 1 while `phase` goes from 0 to 1 (Flash & Hogan 1985); constant outside.

    Its first and second derivatives vanish at both ends; its steepest slope is 1.875.
    """
    p = np.clip(phase, 0.0, 1.0)
    return np.asarray(p * p * p * (10.0 - p * (15.0 - 6.0 * p)))


def hum(
    times: NDArray[np.float64], band: tuple[float, float], random: np.random.Generator, tones: int = 10
) -> NDArray[np.float64]:
    """A band-limited random signal of mean square about 1, a sum of sines, shape (F,)."""
    # One frequency from each equal part of the band, so that no draw leaves the band empty.
    frequencies = band[0] + (band[1] - band[0]) * (np.arange(tones) + random.random(tones)) / tones
    phases = 2 * np.pi * random.random(tones)
    total = np.zeros(len(times))
    for frequency, phase in zip(frequencies, phases, strict=True):
        total += np.sin(2 * np.pi * frequency * times + phase)
    return total * np.sqrt(2.0 / tones)


def _postures(
    times: NDArray[np.float64], reach: float, speed: float, random: np.random.Generator
) -> NDArray[np.float64]:
    """Held postures and the changes between them, deg, reaching ±`reach` at least once, shape (F,)."""
    length = float(times[-1])
    # No posture with its change takes less than 0.5 s: enough for the take on either side of the middle.
    count = 2 * int(np.ceil((length + 4.0) / 0.5)) + 1
    extreme = count // 2
    targets = random.uniform(-1.0, 1.0, count)
    targets[extreme] = 1.0 if targets[extreme] >= 0 else -1.0
    targets *= reach
    holds = 0.2 + random.exponential(0.7, count)
    peak_speeds = speed * random.uniform(0.4, 1.0, count - 1)
    changes = np.maximum(0.3, 1.875 * np.abs(np.diff(targets)) / peak_speeds)
    leaves = np.cumsum(holds) + np.concatenate([[0.0], np.cumsum(changes)])
    # The take is laid over the sequence so that the extreme posture falls inside it.
    shift = leaves[extreme] - 0.5 * holds[extreme] - length * random.uniform(0.15, 0.85)
    now = times + shift
    k = np.searchsorted(leaves, now, side="right") - 1
    before = k < 0
    k = np.clip(k, 0, count - 2)
    step = minimum_jerk((now - leaves[k]) / changes[k])
    angles = targets[k] + (targets[k + 1] - targets[k]) * step
    return np.where(before, targets[0], angles)


def _bursts(times: NDArray[np.float64], reach: float, speed: float, random: np.random.Generator) -> NDArray[np.float64]:
    """Short bursts of nodding (or shaking), deg, shape (F,)."""
    angles = np.zeros(len(times))
    length = float(times[-1])
    onset = random.exponential(3.0)
    while onset < length:
        frequency = random.uniform(*BURST_HZ)
        duration = random.integers(1, 4) / frequency
        size = min(random.uniform(0.06, 0.18) * reach, 0.5 * speed / (2 * np.pi * frequency))
        first, last = np.searchsorted(times, (onset, onset + duration))
        since = times[first:last] - onset
        angles[first:last] += size * np.sin(2 * np.pi * frequency * since) * np.sin(np.pi * since / duration) ** 2
        onset += duration + 0.5 + random.exponential(3.5)
    return angles


def head_angles(times: NDArray[np.float64], range_deg: Sequence[float], speed: float, seed: int) -> NDArray[np.float64]:
    """Nod, turn and tilt over time.

    Parameters
    ----------
    times : ndarray, shape (F,)
        Time of every frame, s, from 0.
    range_deg : sequence of 3 float
        Largest |angle| from neutral that nod, turn and tilt reach in the take, deg. An axis with 0 stays
        exactly at 0.
    speed : float
        Fastest change of posture about one axis, deg/s.
    seed : int
        Seed; every axis has its own stream.

    Returns
    -------
    ndarray, shape (F, 3)
        Nod, turn, tilt, deg.
    """
    angles = np.zeros((len(times), 3))
    for axis, (name, reach) in enumerate(zip(AXES, range_deg, strict=True)):
        if reach == 0:
            continue
        angle = _postures(times, reach, speed, generator("motion", name, "postures", seed=seed))
        angle += _bursts(times, reach, speed, generator("motion", name, "bursts", seed=seed))
        angle += 0.015 * reach * hum(times, WANDER_HZ, generator("motion", name, "wander", seed=seed))
        angles[:, axis] = angle * (reach / np.abs(angle).max())
    return angles


def rotations_from_angles(angles_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Head rotation R = R_y(turn) R_x(nod) R_z(tilt) from angles (F, 3) in degrees; shape (F, 3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("YXZ", angles_deg[:, [1, 0, 2]], degrees=True).as_matrix())


def neck_sway(times: NDArray[np.float64], size: float, fastest: float, seed: int) -> NDArray[np.float64]:
    """Slow translation of the pivot.

    Parameters
    ----------
    times : ndarray, shape (F,)
        Time of every frame, s.
    size : float
        Largest distance of the pivot from its mean place, mm; 0 gives exact zeros.
    fastest : float
        Upper end of the sway's band, Hz.
    seed : int
        Seed.

    Returns
    -------
    ndarray, shape (F, 3)
        Sway s, mm, with zero mean over the frames.
    """
    sway = np.zeros((len(times), 3))
    if size == 0:
        return sway
    for axis in range(3):
        random = generator("sway", "xyz"[axis], seed=seed)
        sway[:, axis] = SWAY_SHARE[axis] * hum(times, (0.1 * fastest, fastest), random, tones=6)
    sway -= sway.mean(axis=0)
    largest = np.sqrt((sway**2).sum(axis=1)).max()
    if largest > 0:
        sway *= size / largest
        sway -= sway.mean(axis=0)  # takes the last rounding out of the mean
    return sway
