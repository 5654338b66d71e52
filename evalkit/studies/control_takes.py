"""Captures for the studies of control: performers with markers on all 19 face points and more, and their truth.

The markers are sampled from a dense face that acts (:mod:`evalkit.dense`); only the vertices under them are ever
computed, so that takes of 70,000 frames cost seconds.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from evalkit.capture import Capture, write_capture
from evalkit.deform.surface import edge_distance, edge_graph
from evalkit.dense import Face, Performance, perform
from evalkit.errors import EvalkitError
from evalkit.geometry import Array, blocks
from evalkit.head.model import Indices
from evalkit.results import staged
from evalkit.seeds import generator
from evalkit.studies.dense_takes import dense_face
from evalkit.studies.filmed_heads import missing_head, point_sources
from evalkit.synthetic.faults import faulty_samples
from evalkit.synthetic.motion import head_angles, minimum_jerk, rotations_from_angles
from evalkit.synthetic.noise import add_noise
from evalkit.synthetic.parameters import unknown
from evalkit.synthetic.performer import PIVOT
from evalkit.vision.points import FACE_POINTS

RIGID_SITES: dict[str, tuple[float, float, float]] = {
    "ForeheadC": (0, 105, 92), "ForeheadM": (0, 85, 100), "ForeheadL": (32, 98, 85), "ForeheadR": (-32, 98, 85),
    "TempleL": (70, 75, 50), "TempleR": (-70, 75, 50),
    "NoseBridge": (0, 36, 107), "BridgeL": (8, 30, 104), "BridgeR": (-8, 30, 104),
}  # fmt: skip
"""Markers over bone, at the skin nearest to these places in the head's axes, mm. On the built-in head they stand
still to 0.2 mm, on MakeHuman's and ICT-FaceKit's they move by up to 2 mm at full strength, as skin over bone does."""

SOFT_SITES = (
    "CheekL", "CheekR", "Chin", "UpperLipL", "UpperLipR", "LowerLipL", "LowerLipR",
)  # fmt: skip
"""Marker sites of every head that are no face point and move."""

MARKERS = 51
"""Of a performer: the 19 points, the rigid and the soft sites, and skin far from all others."""

EMOTIONS: dict[str, dict[str, float]] = {
    "calm": {},
    "happy": {"smile": 0.5, "lid_down": 0.1},
    "angry": {"brow_down": 0.6, "lip_stretch": 0.3, "upper_lip_up": 0.25},
    "sad": {"brow_up": 0.35, "lid_down": 0.25, "lower_lip_down": 0.15},
    "surprised": {"brow_up": 0.7, "jaw": 0.2},
    "doubtful": {"pucker": 0.45, "brow_down": 0.3},
}
"""Emotion -> strengths that units keep for as long as it lasts, on top of talk, blinks and what else the face does."""

PASSAGE_S, CHANGE_S = (3.0, 8.0), 0.8
"""Shortest and longest time that an emotion lasts; time in which it goes over to the next."""

SPEED_DEG_S = 60.0
"""Fastest change of the head's posture."""


@dataclass(frozen=True, eq=False)
class ControlTake:
    """A capture and its truth.

    Attributes
    ----------
    capture : Capture
        As a capture system sees it: head motion, noise and gaps, where asked for.
    rigid : tuple of str
        Labels of the markers over bone.
    expression : ndarray, shape (F, M, 3), mm
        True places of the markers in the head's axes (x to the performer's left, y up, z forward): without head
        motion, noise and gaps.
    rest : ndarray, shape (M, 3), mm
        The same of the face at rest.
    rotations : ndarray, shape (F, 3, 3)
    translations : ndarray, shape (F, 3), mm
        Head motion ``x = R P + T``.
    performance : Performance
        Strengths of the units; its ``vertices(frames)`` and ``batches()`` are the true vertices.
    emotion : ndarray of int, shape (F,)
        Which of :data:`EMOTIONS` a frame is nearest to.
    """

    capture: Capture
    rigid: tuple[str, ...]
    expression: Array
    rest: Array
    rotations: Array
    translations: Array
    performance: Performance
    emotion: Indices

    @property
    def still(self) -> Capture:
        """The true markers without head motion, noise and gaps."""
        return Capture(points=self.expression, labels=self.capture.labels, rate=self.capture.rate)


def performer() -> str:
    """The head that performs where none is named: MakeHuman's if it is here, else the built-in one."""
    return "template" if missing_head("makehuman") else "makehuman"


@lru_cache(maxsize=4)
def marker_sources(head: str, markers: int = MARKERS) -> dict[str, Indices]:
    """Label -> vertices in whose middle the marker is.

    The 19 points come first, under their own names, then :data:`RIGID_SITES`, :data:`SOFT_SITES`, and skin of face and
    lips, each time the vertex that is furthest, over the surface, from all those before.

    Raises
    ------
    EvalkitError
        If the head is not known, or fewer markers are asked for than there are fixed ones.
    """
    fewest = len(FACE_POINTS) + len(RIGID_SITES) + len(SOFT_SITES)
    if markers < fewest:
        raise EvalkitError(f"{markers} markers are too few for a performer; at least {fewest}")
    own = dense_face(head).head
    found = dict(zip(FACE_POINTS, point_sources(own), strict=True))
    places = {name: np.array(place, dtype=np.float64) for name, place in RIGID_SITES.items()}
    near = own.nearest_vertices(places | {name: own.marker_sites[name] for name in SOFT_SITES})
    found |= {name: np.array([vertex]) for name, vertex in near.items()}
    regions = np.concatenate([own.regions[name] for name in ("face", "upper lip", "lower lip")])
    skin = np.intersect1d(regions, own.skin_vertices)
    graph = edge_graph(own.vertices, own.triangles)
    distance = edge_distance(graph, [int(vertex) for vertices in found.values() for vertex in vertices])
    while len(found) < markers:
        vertex = int(skin[np.argmax(np.where(np.isfinite(distance[skin]), distance[skin], -1.0))])
        found[f"Skin{len(found) + 1:02d}"] = np.array([vertex])
        distance = np.minimum(distance, edge_distance(graph, [vertex]))
    return found


def control_take(
    head: str | None = None,
    seed: int = 0,
    frames: int = 1800,
    rate_hz: float = 60.0,
    emotions: tuple[str, ...] = tuple(EMOTIONS),
    amplitude: float = 1.0,
    motion_deg: float = 0.0,
    noise_mm: float = 0.0,
    gaps: float = 0.0,
    markers: int = MARKERS,
) -> ControlTake:
    """A performance of a performer, as it is captured.

    Parameters
    ----------
    head : str, optional
        Who performs: what :func:`evalkit.studies.dense_takes.dense_face` takes; :func:`performer` by default.
    seed : int
        Another seed is another performance of the same performer.
    frames : int
    rate_hz : float
    emotions : tuple of str
        Names in :data:`EMOTIONS`, which come in passages of random order and length.
    amplitude : float
        Strength of talk and gestures; emotions keep theirs.
    motion_deg : float
        Largest nod, turn and tilt of the head; 0 keeps it still.
    noise_mm : float
        Standard deviation per axis.
    gaps : float
        Expected share of marker samples that are missing, four fifths of it in gaps of a tenth of a second on average.
    markers : int

    Returns
    -------
    ControlTake

    Raises
    ------
    EvalkitError
        If head or emotion are not known.
    """
    for emotion in emotions:
        if emotion not in EMOTIONS:
            raise EvalkitError(f"unknown emotion '{emotion}'; known are {', '.join(EMOTIONS)}")
    name = head or performer()
    face = dense_face(name)
    weights = _passages(np.arange(frames) / rate_hz, len(emotions), seed)
    spoken = perform(face, frames, rate_hz, amplitude=amplitude, seed=seed)
    performance = Performance(face, _in_mood(face, spoken.strengths, emotions, weights), rate_hz)
    sources = marker_sources(name, markers)
    expression = _places(performance, list(sources.values()))
    rest = np.stack([face.head.vertices[vertices].mean(axis=0) for vertices in sources.values()])
    times = np.arange(frames) / rate_hz
    angles = head_angles(times, (motion_deg,) * 3, SPEED_DEG_S, seed)
    rotations = rotations_from_angles(angles)
    translations = PIVOT - rotations @ PIVOT
    points = expression @ rotations.transpose(0, 2, 1) + translations[:, None]
    add_noise(points, noise_mm, seed)
    if gaps:
        points[faulty_samples("gaps", frames, len(sources), gaps, 0.8, 0.1 * rate_hz, seed)] = np.nan
    order = np.array([tuple(EMOTIONS).index(emotion) for emotion in emotions])
    return ControlTake(
        capture=Capture(points=points, labels=list(sources), rate=rate_hz),
        rigid=tuple(RIGID_SITES),
        expression=expression,
        rest=rest,
        rotations=rotations,
        translations=translations,
        performance=performance,
        emotion=order[weights.argmax(axis=1)],
    )


def _passages(times: Array, count: int, seed: int) -> Array:
    """How much of each emotion is in every frame, (F, count), adding up to 1."""
    random = generator("control take", "emotions", seed=seed)
    weights = np.zeros((len(times), count))
    onset, before = 0.0, int(random.integers(count))
    weights[:, before] = 1.0
    while True:
        onset += random.uniform(*PASSAGE_S)
        if onset >= times[-1] or count == 1:
            return weights
        after = int((before + random.integers(1, count)) % count)
        step = minimum_jerk((times - onset) / CHANGE_S)
        weights *= (1.0 - step)[:, None]
        weights[:, after] += step
        before = after


def _in_mood(face: Face, spoken: dict[str, Array], emotions: tuple[str, ...], weights: Array) -> dict[str, Array]:
    """Strengths of talk on top of what the emotions hold; no unit goes beyond its full strength."""
    held = np.array(
        [[EMOTIONS[emotion].get(unit.removesuffix(" left").removesuffix(" right"), 0.0) for unit in face.units]
         for emotion in emotions]
    )  # fmt: skip
    kept = dict(zip(face.units, (weights @ held).T, strict=True))
    # What is already drawn in goes the less further: full strength stays full strength.
    return {unit: kept[unit] + (1.0 - kept[unit]) * curve for unit, curve in spoken.items()}


SETTINGS: dict[str, Any] = {
    "head": "", "frames": 3600, "rate_hz": 60.0, "amplitude": 1.0, "motion_deg": 15.0, "noise_mm": 0.1, "gaps": 0.0,
    "markers": MARKERS,
}  # fmt: skip
"""What :func:`write_control_take` can be told, and its defaults; see :func:`control_take`."""


def parse_settings(settings: Iterable[str]) -> dict[str, Any]:
    """Settings from ``name=value`` texts, as on a command line.

    Raises
    ------
    EvalkitError
        If a text has no ``=``, the name is not known, or the value does not read as its type.
    """
    found = {}
    for text in settings:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals:
            raise EvalkitError(f"setting {text!r} is not of the form name=value")
        if name not in SETTINGS:
            raise EvalkitError(unknown("parameter", name, list(SETTINGS)))
        try:
            found[name] = type(SETTINGS[name])(value)
        except ValueError:
            kind = "a whole number" if isinstance(SETTINGS[name], int) else "a number"
            raise EvalkitError(f"{name} = {value!r} does not read as {kind}") from None
    return found


def write_control_take(folder: str | Path, seed: int = 0, **settings: Any) -> list[Path]:
    """Write a take for a motion database: ``performer-SEED.c3d``, and its truth as ``performer-SEED.truth.npz``.

    The truth has rotations (F, 3, 3), translations (F, 3), expression (F, M, 3) and rest (M, 3), mm, and the labels of
    the markers over bone.

    Raises
    ------
    EvalkitError
        If a setting does not fit or the folder cannot be written.
    """
    chosen = {**SETTINGS, **settings}
    take = control_take(chosen.pop("head") or None, seed, **chosen)
    stem = f"performer-{seed}"
    with staged(Path(folder)) as stage:
        write_capture(take.capture, stage / f"{stem}.c3d")
        np.savez_compressed(
            stage / f"{stem}.truth.npz", rotations=take.rotations, translations=take.translations,
            expression=take.expression, rest=take.rest, rigid=np.array(take.rigid),
        )  # fmt: skip
    return [Path(folder) / f"{stem}.c3d", Path(folder) / f"{stem}.truth.npz"]


def _places(performance: Performance, sources: list[Indices]) -> Array:
    """Middle of some vertices at every frame, (F, M, 3), mm."""
    which = np.concatenate(sources)
    first = np.concatenate([[0], np.cumsum([len(vertices) for vertices in sources])[:-1]])
    counts = np.array([len(vertices) for vertices in sources])
    out = np.empty((performance.frames, len(sources), 3))
    for part in blocks(performance.frames, 8192):
        strengths = {unit: curve[part] for unit, curve in performance.strengths.items()}
        out[part] = np.add.reduceat(performance.face.positions(strengths, which), first, axis=1)
    return out / counts[:, None]
