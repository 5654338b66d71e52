"""What a capture system loses and spoils: missing markers, outliers, exchanged labels, a coarse grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.seeds import generator

LARGEST_INTEGER = 32_767
"""Largest coordinate of a C3D file of integers, in steps of its scale."""

CONFUSABLE_MM = 40.0
"""Distance up to which two markers are mistaken for one another, mm."""


def _runs(frames: int, fraction: float, mean_length: float, random: np.random.Generator) -> NDArray[np.bool_]:
    """Affected frames of one marker as a stationary chain of runs with geometric lengths, shape (F,)."""
    # Where most is affected, runs are long enough for the sound ones between them to last a frame.
    mean_length = max(mean_length, fraction / (1 - fraction))
    mean_sound = mean_length * (1 - fraction) / fraction
    per_cycle = mean_length + mean_sound
    affected_first = bool(random.random() < fraction)
    lengths = np.zeros(0, dtype=np.int64)
    while lengths.sum() < frames:
        count = int(frames / per_cycle) + 8
        pair = random.geometric([min(1 / mean_length, 1.0), min(1 / mean_sound, 1.0)], size=(count, 2))
        lengths = np.concatenate([lengths, (pair if affected_first else pair[:, ::-1]).ravel()])
    states = np.resize([affected_first, not affected_first], len(lengths))
    return np.repeat(states, lengths)[:frames]


def faulty_samples(
    kind: str, frames: int, markers: int, fraction: float, burst_share: float, burst_length: float, seed: int
) -> NDArray[np.bool_]:
    """Which samples a fault befalls: single frames at random, and bursts.

    Parameters
    ----------
    kind : str
        Name of the fault, that of its streams: "gaps" or "outliers".
    frames, markers : int
        F and M.
    fraction : float
        Expected share of affected marker samples, 0 to 0.9.
    burst_share : float
        Share of that which bursts take; the rest are single frames at random.
    burst_length : float
        Mean length of a burst, frames.
    seed : int
        Seed; every marker has its own stream.

    Returns
    -------
    ndarray of bool, shape (F, M)
        True where a sample is affected.
    """
    affected = np.zeros((frames, markers), dtype=bool)
    in_bursts = fraction * burst_share
    # Of the samples that no burst covers, this share is affected singly, so that the total is `fraction`.
    singly = 1 - (1 - fraction) / (1 - in_bursts)
    for marker in range(markers):
        if in_bursts > 0:
            random = generator(kind, "bursts", marker, seed=seed)
            affected[:, marker] = _runs(frames, in_bursts, burst_length, random)
        if singly > 0:
            affected[:, marker] |= generator(kind, "singles", marker, seed=seed).random(frames) < singly
    return affected


def displace(points: NDArray[np.float64], outliers: NDArray[np.bool_], size: float, seed: int) -> None:
    """Move outlier samples away from their true places, in place.

    Consecutive outliers of one marker are moved alike, as by a reflection taken for the marker (a ghost); a single
    one is a spike. Directions are uniform on the sphere, distances uniform from half to one and a half of `size`.

    Parameters
    ----------
    points : ndarray, shape (F, M, 3)
        Positions, mm; changed.
    outliers : ndarray of bool, shape (F, M)
        Which samples to move.
    size : float
        Mean distance, mm.
    seed : int
        Seed; every marker has its own stream.
    """
    for marker in np.flatnonzero(outliers.any(axis=0)):
        spoilt = outliers[:, marker]
        run = np.cumsum(np.diff(spoilt, prepend=False) & spoilt)[spoilt] - 1
        random = generator("outliers", "offsets", int(marker), seed=seed)
        offsets = random.standard_normal((run[-1] + 1, 3))
        offsets *= (size * random.uniform(0.5, 1.5, len(offsets)) / np.sqrt((offsets**2).sum(axis=1)))[:, None]
        points[spoilt, marker] += offsets[run]


def neighbour_pairs(sites: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Pairs of markers that can be confused, nearest pairs first, each marker in one pair at most."""
    first, second = np.triu_indices(len(sites), 1)
    squares = ((sites[first] - sites[second]) ** 2).sum(axis=1)
    pairs: list[tuple[int, int]] = []
    free = np.ones(len(sites), dtype=bool)
    for k in np.argsort(squares, kind="stable"):
        a, b = int(first[k]), int(second[k])
        if free[a] and free[b] and squares[k] <= CONFUSABLE_MM**2:
            pairs.append((a, b))
            free[[a, b]] = False
    return pairs


def label_swaps(
    frames: int, sites: NDArray[np.float64], fraction: float, mean_length: float, seed: int
) -> NDArray[np.int64]:
    """Which marker each label carries: now and then two neighbours exchange their labels for a while.

    Parameters
    ----------
    frames : int
        F.
    sites : ndarray, shape (M, 3)
        Where the markers sit, mm; neighbours are those of `neighbour_pairs`.
    fraction : float
        Expected share of the time that a pair is exchanged, 0 to 0.5. Markers without a neighbour keep theirs.
    mean_length : float
        Mean length of a swap, frames.
    seed : int
        Seed; every pair has its own stream.

    Returns
    -------
    ndarray of int, shape (F, M)
        Index of the marker that is seen under each label.
    """
    identity = np.tile(np.arange(len(sites)), (frames, 1))
    pairs = neighbour_pairs(sites) if fraction > 0 else []
    for a, b in pairs:
        swapped = _runs(frames, fraction, mean_length, generator("swaps", a, b, seed=seed))
        identity[swapped, a], identity[swapped, b] = b, a
    return identity


def quantise(points: NDArray[np.float64], step: float) -> None:
    """Round every coordinate to the grid of a C3D file of integers, in place.

    Parameters
    ----------
    points : ndarray, shape (F, M, 3)
        Positions, mm; changed. NaN stays.
    step : float
        Scale of the file: the distance of two neighbouring values, mm.

    Raises
    ------
    EvalkitError
        If 16-bit integers cannot hold the take at this scale.
    """
    largest = float(np.nanmax(np.abs(points), initial=0.0))
    if largest > LARGEST_INTEGER * step:
        enough = np.ceil(largest / LARGEST_INTEGER * 1e3) / 1e3
        raise EvalkitError(
            f"quantum_mm = {step:g} holds coordinates of up to {LARGEST_INTEGER * step:.0f} mm in a C3D file of "
            f"integers, and this take reaches {largest:.0f} mm: use {enough:g} or more"
        )
    points /= step
    np.rint(points, out=points)
    points *= step
