"""What a capture system adds and loses: noise and missing markers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evalkit.seeds import generator

BLOCK = 65536
"""Frames handled at once, so that working memory stays small in long takes."""


def add_white_noise(points: NDArray[np.float64], sigma: float, seed: int) -> None:
    """Add independent Gaussian noise to every coordinate, in place.

    The draws do not depend on `sigma`: twice the level is twice the same noise.

    Parameters
    ----------
    points : ndarray, shape (F, M, 3)
        Positions, mm; changed.
    sigma : float
        Standard deviation per axis, mm.
    seed : int
        Seed.
    """
    if sigma == 0:
        return
    random = generator("noise", seed=seed)
    for start in range(0, len(points), BLOCK):
        block = points[start : start + BLOCK]
        block += sigma * random.standard_normal(block.shape)


def _runs(frames: int, fraction: float, mean_length: float, random: np.random.Generator) -> NDArray[np.bool_]:
    """Missing frames of one marker as a stationary chain of runs with geometric lengths, shape (F,)."""
    # Where most is missing, gaps are long enough for the visible runs between them to last a frame.
    mean_length = max(mean_length, fraction / (1 - fraction))
    mean_seen = mean_length * (1 - fraction) / fraction
    per_cycle = mean_length + mean_seen
    missing_first = bool(random.random() < fraction)
    lengths = np.zeros(0, dtype=np.int64)
    while lengths.sum() < frames:
        count = int(frames / per_cycle) + 8
        pair = random.geometric([min(1 / mean_length, 1.0), min(1 / mean_seen, 1.0)], size=(count, 2))
        lengths = np.concatenate([lengths, (pair if missing_first else pair[:, ::-1]).ravel()])
    states = np.resize([missing_first, not missing_first], len(lengths))
    return np.repeat(states, lengths)[:frames]


def occlusions(
    frames: int, markers: int, fraction: float, burst_share: float, burst_length: float, seed: int
) -> NDArray[np.bool_]:
    """Which markers are missing: single frames at random, and bursts.

    Parameters
    ----------
    frames, markers : int
        F and M.
    fraction : float
        Expected share of missing marker samples, 0 to 0.9.
    burst_share : float
        Share of that which bursts take; the rest are single frames at random.
    burst_length : float
        Mean length of a burst, frames.
    seed : int
        Seed; every marker has its own stream.

    Returns
    -------
    ndarray of bool, shape (F, M)
        True where a marker is missing.
    """
    missing = np.zeros((frames, markers), dtype=bool)
    in_bursts = fraction * burst_share
    # Of the samples that no burst covers, this share is lost singly, so that the total is `fraction`.
    singly = 1 - (1 - fraction) / (1 - in_bursts)
    for marker in range(markers):
        if in_bursts > 0:
            random = generator("gaps", "bursts", marker, seed=seed)
            missing[:, marker] = _runs(frames, in_bursts, burst_length, random)
        if singly > 0:
            missing[:, marker] |= generator("gaps", "singles", marker, seed=seed).random(frames) < singly
    return missing
