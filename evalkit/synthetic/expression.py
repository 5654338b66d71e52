"""Facial expressions: muscle-like displacement fields, and the action patterns that activate them.

A *unit* is what one muscle group does at full strength: a sum of pulls, each a displacement that is largest
at its centre and fades with distance over the skin (Gaussian). The jaw is the exception: it turns about its
hinge axis, taking the chin and the lower lip with it. Being functions of position, the units move any marker
layout. Their full strength (directions and millimetres) follows the expression shapes of ICT-FaceKit at the
same places: raised brow 5 to 7 mm, closed lid 8 mm, smile 15 mm at the mouth corner.

A *pattern* is what a performer does: a set of units with the times of attack, hold and release, and how
often it comes. Speech is a pattern of its own: phrases of syllables, four to six a second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evalkit.seeds import generator
from evalkit.synthetic.motion import minimum_jerk
from evalkit.synthetic.noise import BLOCK
from evalkit.synthetic.performer import Performer

JAW_DEG = 15.0
"""Jaw opening at full strength, deg."""

JAW_GLIDE = np.array([0.0, -1.0, 4.0])
"""Glide of the hinge axis at full strength, mm: the condyles slide forward and down as the jaw opens.

With `JAW_DEG` the chin goes 20 mm down and 20 mm back.
"""

JAW_LINE_MM = (-29.5, -44.0)
"""Height in the head frame over which skin begins to follow the jaw (upper lip 0, lower lip 1), mm."""

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Pull:
    """A local displacement of skin, by default on both sides of the face.

    Parameters
    ----------
    centre : (float, float, float)
        Where the displacement is largest, left side, head frame, mm.
    move : (float, float, float)
        Displacement there at full strength, mm.
    radius : float
        Standard deviation of the Gaussian over which it fades, mm.
    """

    centre: Vector
    move: Vector
    radius: float


UNITS: dict[str, tuple[Pull, ...]] = {
    "jaw": (),  # a rotation, see `jaw_share`
    "brow_up": (Pull((15, 60, 107), (0.3, 4.5, -0.5), 13), Pull((47, 60, 92), (1.5, 6.5, -2.0), 15)),
    "brow_down": (Pull((15, 60, 107), (-1.8, -2.2, 1.0), 12), Pull((40, 62, 97), (-4.0, -3.5, 2.5), 13)),
    "lid_down": (Pull((32, 40, 95.5), (0.0, -8.0, -0.6), 9),),
    "smile": (
        Pull((27, -35, 102), (6.5, 9.5, -8.5), 14),
        Pull((45, 0, 93.5), (1.5, 5.0, 2.5), 16),
        Pull((16, -6, 112.5), (1.8, 1.6, -1.2), 9),
    ),
    "pucker": (
        Pull((27, -35, 102), (-5.0, 1.5, 8.0), 14),
        Pull((0, -23.5, 117.5), (0.0, 2.0, 5.5), 10),
        Pull((0, -45.5, 113.5), (0.0, -1.0, 4.5), 9),
    ),
    "lip_stretch": (Pull((27, -35, 102), (5.5, -1.5, -4.5), 13),),
    "upper_lip_up": (Pull((12, -25, 115), (0.3, 4.0, -0.6), 10), Pull((16, -6, 112.5), (0.8, 2.0, -0.6), 8)),
    "lower_lip_down": (Pull((13, -43.5, 111.5), (0.4, -4.0, -1.0), 10),),
    # The skin of the forehead follows the brow muscles, less with distance; along the surface, in mm per mm
    # of skin slide. It acts on the rigid markers, and only if skin slide is asked for.
    "forehead_up": (Pull((0, 60, 104), (0.0, 1.1, -0.35), 42),),
    "forehead_down": (Pull((0, 60, 104), (0.0, -0.7, 0.25), 42), Pull((40, 66, 97), (-0.5, 0.0, 0.2), 25)),
}
"""Unit -> its pulls."""

SLIDES = {"brow_up": "forehead_up", "brow_down": "forehead_down"}
"""Brow unit -> unit by which the forehead skin, and the rigid markers on it, slide with it."""


ONE_SIDED = ("brow_up", "brow_down", "smile")
"""Units that differ between the sides if asymmetry is asked for."""

SIDE_BLEND_MM = 15.0
"""Distance from the middle of the face over which one side's strength passes into the other's, mm."""

BONE_LINE_MM = (60.0, 36.0)
"""Height in the head frame over which the slide of rigid markers fades, from the brows down to the bridge of the
nose, where skin is thin and holds to the bone, mm."""


@dataclass(frozen=True)
class Pattern:
    """What a performer does now and then.

    Parameters
    ----------
    units : dict
        Unit -> strength.
    attack, hold, release : (float, float)
        Shortest and longest duration of each phase, s.
    interval : float
        Mean time between two occurrences, s.
    """

    units: dict[str, float]
    attack: tuple[float, float]
    hold: tuple[float, float]
    release: tuple[float, float]
    interval: float


PATTERNS: dict[str, Pattern] = {
    "jaw_open": Pattern({"jaw": 0.9}, (0.25, 0.5), (0.2, 0.8), (0.3, 0.6), 9.0),
    "smile": Pattern({"smile": 0.9, "lid_down": 0.15}, (0.3, 0.6), (0.6, 2.0), (0.5, 1.0), 8.0),
    "pucker": Pattern({"pucker": 0.9}, (0.2, 0.4), (0.3, 0.8), (0.3, 0.5), 9.0),
    "brow_raise": Pattern({"brow_up": 1.0, "lid_down": -0.15}, (0.15, 0.35), (0.3, 1.2), (0.3, 0.6), 4.5),
    "frown": Pattern({"brow_down": 1.0}, (0.25, 0.5), (0.4, 1.5), (0.4, 0.8), 8.0),
    "blink": Pattern({"lid_down": 1.0}, (0.08, 0.11), (0.02, 0.06), (0.14, 0.22), 3.5),
}
"""Pattern -> when and how it comes. ``speech`` is the one more, see `speech`."""

SYLLABLE_UNITS: dict[str, tuple[float, float]] = {
    "jaw": (0.08, 0.38),
    "pucker": (-0.35, 0.55),
    "lip_stretch": (-0.3, 0.5),
    "upper_lip_up": (-0.2, 0.5),
    "lower_lip_down": (-0.1, 0.8),
}
"""Unit -> range from which its strength in a syllable is drawn; a draw below 0 leaves the unit out."""

SPEECH = "speech"
ACTION_NAMES = (*PATTERNS, SPEECH)
"""Every action pattern by name."""


def jaw_share(sites: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far each site follows the jaw: 0 above the mouth, 1 below it, smooth between, shape (M,)."""
    top, bottom = JAW_LINE_MM
    return minimum_jerk((top - sites[:, 1]) / (top - bottom))


def displacement_field(pulls: Sequence[Pull], sites: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacement of each site at full strength, mm, shape (M, 3)."""
    field = np.zeros_like(sites)
    for pull in pulls:
        for side in (1.0, -1.0) if pull.centre[0] else (1.0,):
            mirror = np.array([side, 1.0, 1.0])
            distance2 = ((sites - mirror * pull.centre) ** 2).sum(axis=1)
            field += np.exp(-distance2 / (2 * pull.radius**2))[:, None] * (mirror * pull.move)
    return field


def bone_share(sites: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far the skin at each site can slide over the bone: 1 on the forehead, 0 on the nose, shape (M,)."""
    top, bottom = BONE_LINE_MM
    return minimum_jerk((sites[:, 1] - bottom) / (top - bottom))


def side_strength(sites: NDArray[np.float64], asymmetry: float) -> NDArray[np.float64]:
    """Strength of a one-sided expression at each site, shape (M,).

    Parameters
    ----------
    sites : ndarray, shape (M, 3)
        Head frame, mm.
    asymmetry : float
        0: both sides at full strength. 1: the performer's left alone; -1: the right alone.
    """
    left, right = min(1.0, 1.0 + asymmetry), min(1.0, 1.0 - asymmetry)
    return right + (left - right) * minimum_jerk(0.5 + 0.5 * sites[:, 0] / SIDE_BLEND_MM)


def _event(
    curve: NDArray[np.float64], times: NDArray[np.float64], onset: float, phases: tuple[float, float, float]
) -> slice:
    """Raise `curve` by one event of strength 1 (attack, hold, release, s); return the frames it touches."""
    attack, hold, release = phases
    first, last = np.searchsorted(times, (onset, onset + attack + hold + release))
    since = times[first:last] - onset
    curve[first:last] = minimum_jerk(since / attack) - minimum_jerk((since - attack - hold) / release)
    return slice(int(first), int(last))


def pattern_events(
    pattern: Pattern, times: NDArray[np.float64], liveliness: float, random: np.random.Generator
) -> NDArray[np.float64]:
    """Activation of one pattern over time, shape (F,).

    The first occurrence falls into the first half of the take if that is long enough, so that a take of a
    few seconds shows every pattern; the waiting times between the next ones are exponential.
    """
    curve = np.zeros(len(times))
    length = float(times[-1])
    interval = pattern.interval / liveliness
    onset = random.random() * min(0.5 * length, interval)
    while onset < length:
        attack, hold, release = (random.uniform(*phase) for phase in (pattern.attack, pattern.hold, pattern.release))
        frames = _event(curve, times, onset, (attack, hold, release))
        curve[frames] *= random.uniform(0.6, 1.0)
        busy = attack + hold + release
        onset += busy + 0.1 + random.exponential(max(interval - busy, 0.2))
    return curve


def speech(times: NDArray[np.float64], liveliness: float, random: np.random.Generator) -> NDArray[np.float64]:
    """Activation of the units of `SYLLABLE_UNITS` in speech, shape (F, 5).

    Phrases of 1 to 3 s with pauses between them; within a phrase four to six syllables a second, each a
    smooth bump of a random mixture of units that overlaps with the next one (coarticulation).
    """
    curves = np.zeros((len(times), len(SYLLABLE_UNITS)))
    lowest, highest = np.array(list(SYLLABLE_UNITS.values())).T
    length = float(times[-1])
    onset = random.uniform(0.0, 0.4)
    while onset < length:
        end = onset + random.uniform(1.0, 3.0)
        while onset < end:
            duration = random.uniform(0.22, 0.40)
            strength = np.maximum(random.uniform(lowest, highest), 0.0)
            first, last = np.searchsorted(times, (onset, onset + duration))
            bump = np.sin(np.pi * (times[first:last] - onset) / duration) ** 2
            curves[first:last] += bump[:, None] * strength
            onset += random.uniform(0.16, 0.26)
        onset += 0.2 + random.exponential(0.5 / liveliness)
    return curves


def activations(
    times: NDArray[np.float64], actions: Sequence[str], liveliness: float, seed: int
) -> dict[str, NDArray[np.float64]]:
    """Activation of every unit that the actions use: unit -> (F,), 1 at full strength.

    Every action has its own stream; leaving one out does not change the others.
    """
    units: dict[str, NDArray[np.float64]] = {}
    for action in actions:
        random = generator("expression", action, seed=seed)
        if action == SPEECH:
            parts = dict(zip(SYLLABLE_UNITS, speech(times, liveliness, random).T, strict=True))
        else:
            curve = pattern_events(PATTERNS[action], times, liveliness, random)
            parts = {unit: strength * curve for unit, strength in PATTERNS[action].units.items()}
        for unit, part in parts.items():
            units[unit] = units[unit] + part if unit in units else part
    return units


def express(
    performer: Performer,
    times: NDArray[np.float64],
    actions: Sequence[str],
    amplitude: float = 1.0,
    liveliness: float = 1.0,
    skin: float = 0.0,
    seed: int = 0,
    asymmetry: float = 0.0,
) -> NDArray[np.float64]:
    """Expression displacements E of every marker in the head frame.

    Parameters
    ----------
    performer : Performer
        Who performs.
    times : ndarray, shape (F,)
        Time of every frame, s, from 0.
    actions : sequence of str
        Action patterns, names in `ACTION_NAMES`.
    amplitude : float
        Strength relative to ordinary expressions; 0 gives exact zeros. It does not scale the skin slide.
    liveliness : float
        How often patterns come, relative to ordinary talk.
    skin : float
        How far the forehead skin, and the rigid markers on it, slide at the brows while these work at full
        strength, mm. At 0 the rigid markers have E = 0 exactly.
    seed : int
        Seed.
    asymmetry : float
        How one-sided smiles and brows are, -1 (right only) to 1 (left only), see `side_strength`.

    Returns
    -------
    ndarray, shape (F, M, 3)
        E, mm.
    """
    sites = performer.sites / performer.size
    shape = (len(times), *sites.shape)
    units = activations(times, actions, liveliness, seed)
    rigid = np.isin(performer.labels, performer.rigid)
    curves, fields = [], []
    for unit, curve in units.items():
        field = amplitude * displacement_field(UNITS[unit], sites)
        field[rigid] = skin * displacement_field(UNITS[SLIDES[unit]], sites[rigid]) if unit in SLIDES else 0.0
        field[rigid] *= bone_share(sites[rigid])[:, None]
        if unit in ONE_SIDED:
            field *= side_strength(sites, asymmetry)[:, None]
        if field.any():
            curves.append(curve)
            fields.append((field * performer.size).ravel())
    jaw = units.get("jaw", np.zeros(len(times)))
    share = np.where(rigid, 0.0, jaw_share(sites))
    follows = np.flatnonzero(share)
    lever = performer.sites[follows] - performer.jaw_axis
    expression = np.zeros(shape)
    for start in range(0, len(times), BLOCK):
        block = expression[start : start + BLOCK]
        frames = slice(start, start + len(block))
        if fields:
            np.matmul(
                np.column_stack([curve[frames] for curve in curves]),
                fields,
                out=block.reshape(len(block), -1),
            )
        # Opening the jaw is a positive turn about x: down and back. Partial followers turn by a part of it.
        opening = amplitude * jaw[frames, None] * share[follows]
        cos, sin = np.cos(np.deg2rad(JAW_DEG) * opening), np.sin(np.deg2rad(JAW_DEG) * opening)
        y, z = lever[:, 1], lever[:, 2]
        block[:, follows, 1] += y * (cos - 1) - z * sin + JAW_GLIDE[1] * opening
        block[:, follows, 2] += y * sin + z * (cos - 1) + JAW_GLIDE[2] * opening
    return expression
