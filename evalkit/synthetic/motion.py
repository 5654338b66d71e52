"""Head motion: smooth angles of nod, turn and tilt.

Angles are made of what people do with their heads: postures that are held and then left for another one
(minimum-jerk changes with pauses between them), short bursts of nodding or shaking, and a slight wander, so that
a head is never perfectly still. A `Profile` says how much of each; `PROFILES` names them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evalkit.seeds import generator

AXES = ("nod", "turn", "tilt")
"""The three angles: nod about x (positive: face down), turn about y (positive: to the performer's left),
tilt about z (positive: towards the right shoulder)."""

WANDER_HZ = (0.1, 0.8)
"""Band of the slight wander, Hz."""

WANDER = 0.015
"""Size of the slight wander, a share of the range."""

Pair = tuple[float, float]


@dataclass(frozen=True)
class Profile:
    """How a head moves in time. Pairs are the lowest and highest of a uniform draw, unless they say otherwise.

    Parameters
    ----------
    text : str
        One line on what it is.
    hold_s : (float, float)
        Shortest hold of a posture and the mean of what comes on top (exponential), s.
    shortest_s : float
        Shortest change of posture, s.
    pace, pace_back : (float, float)
        Fastest speed of a change of posture, relative to the parameter ``speed``; changes take the two in turn.
    to_and_fro : bool
        Postures lie on alternate sides, beyond half the range; otherwise anywhere in it.
    postures : float
        Size of the postures, a share of the range.
    burst_wait_s : (float, float)
        Mean time (exponential) before the first burst and between two, s.
    burst_hz : (float, float)
        Cycles per second in a burst.
    burst_cycles : (int, int)
        Fewest cycles of a burst, and one more than the most.
    burst_size : (float, float)
        Amplitude, a share of the range.
    burst_pace : float
        Fastest speed in a burst, relative to the parameter ``speed``.
    """

    text: str
    hold_s: Pair = (0.2, 0.7)
    shortest_s: float = 0.3
    pace: Pair = (0.4, 1.0)
    pace_back: Pair = (0.4, 1.0)
    to_and_fro: bool = False
    postures: float = 1.0
    burst_wait_s: Pair = (3.0, 3.5)
    burst_hz: Pair = (1.2, 2.4)
    burst_cycles: tuple[int, int] = (1, 4)
    burst_size: Pair = (0.06, 0.18)
    burst_pace: float = 0.5


PROFILES: dict[str, Profile] = {
    "talk": Profile("conversation: postures, pauses, now and then a burst of nodding or shaking"),
    "held": Profile(
        "postures held for seconds, slow changes, no bursts",
        hold_s=(1.5, 1.5),
        pace=(0.2, 0.4),
        pace_back=(0.2, 0.4),
        burst_size=(0.0, 0.0),
    ),
    "shaking": Profile(
        "fast nodding and shaking, again and again, up to the full range",
        postures=0.25,
        burst_wait_s=(0.3, 0.4),
        burst_cycles=(3, 9),
        burst_size=(0.5, 1.0),
        burst_pace=1.0,
    ),
    "reading": Profile(
        "line after line: slowly one way, quickly back",
        hold_s=(0.05, 0.1),
        pace=(0.15, 0.25),
        pace_back=(0.6, 1.0),
        to_and_fro=True,
        burst_size=(0.0, 0.0),
    ),
}
"""Name -> speed profile."""


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
    times: NDArray[np.float64], reach: float, speed: float, profile: Profile, random: np.random.Generator
) -> NDArray[np.float64]:
    """Held postures and the changes between them, deg, reaching ±`reach` at least once, shape (F,)."""
    length = float(times[-1])
    # Enough postures of the shortest duration for the take on either side of the middle one.
    count = 2 * int(np.ceil((length + 4.0) / (profile.hold_s[0] + profile.shortest_s))) + 1
    extreme = count // 2
    targets = random.uniform(-1.0, 1.0, count)
    if profile.to_and_fro:
        targets = (0.5 + 0.5 * np.abs(targets)) * np.resize([1.0, -1.0], count)
    targets[extreme] = 1.0 if targets[extreme] >= 0 else -1.0
    targets *= reach
    shortest, further = profile.hold_s
    holds = shortest + random.exponential(further, count)
    slowest, fastest = np.resize([profile.pace, profile.pace_back], (count - 1, 2)).T
    peak_speeds = speed * random.uniform(slowest, fastest)
    changes = np.maximum(profile.shortest_s, 1.875 * np.abs(np.diff(targets)) / peak_speeds)
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


def _bursts(
    times: NDArray[np.float64], reach: float, speed: float, profile: Profile, random: np.random.Generator
) -> NDArray[np.float64]:
    """Short bursts of nodding (or shaking), deg, shape (F,)."""
    angles = np.zeros(len(times))
    length = float(times[-1])
    onset = random.exponential(profile.burst_wait_s[0])
    while onset < length:
        frequency = random.uniform(*profile.burst_hz)
        duration = random.integers(*profile.burst_cycles) / frequency
        size = min(random.uniform(*profile.burst_size) * reach, profile.burst_pace * speed / (2 * np.pi * frequency))
        first, last = np.searchsorted(times, (onset, onset + duration))
        since = times[first:last] - onset
        angles[first:last] += size * np.sin(2 * np.pi * frequency * since) * np.sin(np.pi * since / duration) ** 2
        onset += duration + 0.5 + random.exponential(profile.burst_wait_s[1])
    return angles


def head_angles(
    times: NDArray[np.float64], range_deg: Sequence[float], speed: float, seed: int, profile: str = "talk"
) -> NDArray[np.float64]:
    """Nod, turn and tilt over time.

    Parameters
    ----------
    times : ndarray, shape (F,)
        Time of every frame, s, from 0.
    range_deg : sequence of 3 float
        Largest size of the angle of nod, turn and tilt from neutral in the take, deg. An axis with 0 stays
        exactly at 0.
    speed : float
        Fastest change of posture about one axis, deg/s.
    seed : int
        Seed; every axis has its own stream.
    profile : str
        Name in `PROFILES`.

    Returns
    -------
    ndarray, shape (F, 3)
        Nod, turn, tilt, deg.
    """
    how = PROFILES[profile]
    angles = np.zeros((len(times), 3))
    for axis, (name, reach) in enumerate(zip(AXES, range_deg, strict=True)):
        if reach == 0:
            continue
        angle = how.postures * _postures(times, reach, speed, how, generator("motion", name, "postures", seed=seed))
        angle += _bursts(times, reach, speed, how, generator("motion", name, "bursts", seed=seed))
        angle += WANDER * reach * hum(times, WANDER_HZ, generator("motion", name, "wander", seed=seed))
        angles[:, axis] = angle * (reach / np.abs(angle).max())
    return angles


def rotations_from_angles(angles_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Head rotation R = R_y(turn) R_x(nod) R_z(tilt) from angles (F, 3) in degrees; shape (F, 3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("YXZ", angles_deg[:, [1, 0, 2]], degrees=True).as_matrix())
