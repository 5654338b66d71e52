"""A performance in which the place of every vertex is known at every frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from evalkit.capture import Capture
from evalkit.dense.face import Face
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.model import Indices
from evalkit.seeds import generator
from evalkit.synthetic.expression import ACTION_NAMES, ONE_SIDED, activations
from evalkit.synthetic.motion import head_angles, rotations_from_angles
from evalkit.synthetic.noise import add_noise
from evalkit.synthetic.performer import PIVOT

BATCH_BYTES = 16_000_000
"""Size of one batch of true vertices."""

ANTAGONISTS = {"pucker": {"smile": 0.6, "lip_stretch": 0.4}, "brow_down": {"brow_up": 0.5}}
"""Unit -> units that hold it back: its strength is multiplied by one less their share of it."""

SPEED_DEG_S = 40.0
"""Fastest change of the head's posture."""


@dataclass(frozen=True, eq=False)
class Performance:
    """Strengths of a face's units over time; the vertices follow from them, as many at a time as are wanted.

    Attributes
    ----------
    face : Face
    strengths : dict of str to ndarray, shape (F,)
    rate : float, Hz
    """

    face: Face
    strengths: dict[str, Array]
    rate: float

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(next(iter(self.strengths.values())))

    def vertices(self, frames: slice | Sequence[int] = slice(None)) -> Array:
        """True vertices (f, V, 3) of some frames, mm, in the head's axes."""
        return self.face.positions({unit: np.asarray(curve)[frames] for unit, curve in self.strengths.items()})

    def batches(self) -> Iterator[tuple[slice, Array]]:
        """Frames and true vertices (f, V, 3) of one batch after the other, so that memory does not grow with them."""
        size = max(BATCH_BYTES // self.face.head.vertices.nbytes, 1)
        for start in range(0, self.frames, size):
            part = slice(start, min(start + size, self.frames))
            yield part, self.vertices(part)

    def capture(
        self, sites: Mapping[str, int], noise_mm: float = 0.0, motion_deg: float = 0.0, seed: int = 0
    ) -> tuple[Capture, Array, Array]:
        """What a capture system sees of markers on the face.

        Parameters
        ----------
        sites : mapping of str to int
            Label to the vertex that wears it.
        noise_mm : float
            Standard deviation per axis.
        motion_deg : float
            Largest nod, turn and tilt of the head about the neck; 0 keeps it still.
        seed : int

        Returns
        -------
        capture : Capture
        rotations : ndarray, shape (F, 3, 3)
        translations : ndarray, shape (F, 3), mm
            Head motion ``x = R P + T``.

        Raises
        ------
        EvalkitError
            If a vertex is not one of the head's.
        """
        which = np.array([int(vertex) for vertex in sites.values()], dtype=np.intp)
        count = len(self.face.head.vertices)
        for label, vertex in sites.items():
            if not 0 <= int(vertex) < count:
                raise EvalkitError(f"marker {label}: vertex {vertex} is not one of the head's {count}")
        points = self.markers(which)
        times = np.arange(self.frames) / self.rate
        angles = head_angles(times, (motion_deg,) * 3, SPEED_DEG_S, seed) if motion_deg else np.zeros((self.frames, 3))
        rotations = rotations_from_angles(angles)
        translations = PIVOT - rotations @ PIVOT
        points = np.einsum("fij,fnj->fni", rotations, points) + translations[:, None]
        add_noise(points, noise_mm, seed)
        return Capture(points=points, labels=list(sites), rate=self.rate), rotations, translations

    def markers(self, which: Indices) -> Array:
        """True places (F, n, 3) of some vertices at every frame, mm."""
        return self.face.positions(self.strengths, np.asarray(which))


def perform(
    face: Face,
    frames: int = 300,
    rate: float = 30.0,
    actions: Sequence[str] = ACTION_NAMES,
    amplitude: float = 1.0,
    liveliness: float = 2.0,
    asymmetry: float = 0.3,
    seed: int = 0,
) -> Performance:
    """Let a face talk and make faces.

    The strengths are those of :func:`evalkit.synthetic.expression.activations`. They are not simply added up: a unit
    never goes beyond its full strength, and antagonists hold each other back, so that vertices are no linear function
    of what is done.

    Parameters
    ----------
    face : Face
    frames : int
    rate : float, Hz
    actions : sequence of str
        Names in :data:`evalkit.synthetic.expression.ACTION_NAMES`.
    amplitude, liveliness : float
        How strong and how often, relative to ordinary talk.
    asymmetry : float
        Largest share by which one side of a smile or brow is weaker; which one and how much is drawn.
    seed : int

    Returns
    -------
    Performance

    Raises
    ------
    EvalkitError
        If an action is not known.
    """
    for action in actions:
        if action not in ACTION_NAMES:
            raise EvalkitError(f"unknown action '{action}'; known are {', '.join(ACTION_NAMES)}")
    curves = activations(np.arange(frames) / rate, tuple(actions), liveliness, seed)
    curves = {unit: np.clip(amplitude * curve, 0.0, 1.0) for unit, curve in curves.items()}
    # All factors from the curves as they were: the order of the table must not matter.
    held = {
        unit: np.prod([1.0 - share * curves[other] for other, share in others.items() if other in curves], axis=0)
        for unit, others in ANTAGONISTS.items()
    }
    strengths = {}
    for unit, curve in curves.items():
        curve = curve * held.get(unit, 1.0)
        if unit in face.units:
            strengths[unit] = curve
            continue
        uneven = generator("performance", "side", unit, seed=seed).uniform(-asymmetry, asymmetry)
        uneven = uneven if unit in ONE_SIDED else 0.0
        for side, sign in (("left", 1.0), ("right", -1.0)):
            if f"{unit} {side}" in face.units:
                strengths[f"{unit} {side}"] = curve * min(1.0, 1.0 + sign * uneven)
    if not strengths:
        raise EvalkitError("nothing to perform: the face has none of the units of these actions")
    return Performance(face, strengths, rate)
