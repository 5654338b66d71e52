"""The 19 points of a face out of a marker capture, seen from the front as a video's points are.

Everything that a database of control parameters is built from goes through here, so that it says the same of a face as
the video does.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from evalkit.capture import Capture
from evalkit.errors import EvalkitError
from evalkit.geometry import Array, nearest_rotation
from evalkit.vision.parameters import EYE_CORNERS, PARAMETERS, control_parameters, eye_distance
from evalkit.vision.points import FACE_POINTS, SIDES, mean_face_points

FEWEST = 4
"""Points that must have a marker: three give a rotation to the front, and a fourth something to measure."""


def _both_sides(labels: Mapping[str, str]) -> dict[str, str]:
    """Labels with ``?`` for the first letter of the side -> the points of both sides."""
    return {label.replace("?", side[0].upper()): f"{point} {side}" for label, point in labels.items() for side in SIDES}


KNOWN_LABELS = {
    # AnimFace, 41 markers
    **_both_sides({
        "?eyebrow_Inside": "brow inner", "?eyebrow_Outside": "brow outer", "?eye_Inside": "eye inner",
        "?eye_Outside": "eye outer", "?eye_Up": "upper lid", "?eye_Down": "lower lid", "NoseHead_?": "nose wing",
        "Mouth_?end": "mouth corner",
    }),
    "NoseHead": "nose tip", "Mouth_Up": "upper lip", "Mouth_Down": "lower lip",
    # the 23 markers of Huang, Lin & Ouhyoung (2000), and the denser layouts around them
    **_both_sides({
        "BrowIn?": "brow inner", "BrowOut?": "brow outer", "EyeIn?": "eye inner", "EyeOut?": "eye outer",
        "Lid?": "upper lid", "LidLow?": "lower lid", "Nose?": "nose wing", "Mouth?": "mouth corner",
    }),
    "NoseTip": "nose tip", "UpperLipC": "upper lip", "LowerLipC": "lower lip",
    # points by their own names
    **{name: name for name in FACE_POINTS},
}  # fmt: skip
"""Label of a marker -> point, for layouts that are known."""


@dataclass(frozen=True, eq=False)
class MarkerPoints:
    """The 19 points of every frame of a capture, from the front.

    Attributes
    ----------
    points : ndarray, shape (F, 19, 2), mm
        x to the performer's left, y up; NaN where a marker is missing or occluded.
    unit : float, mm
        Distance between the eyes in the take's median shape.
    rotation : ndarray, shape (3, 3)
        From the take's axes to the frontal view's (x left, y up, z forward).
    labels : dict of str to str
        Point -> label of its marker.
    missing : list of str
        Points without a marker, whose place is NaN.
    assumed : list of str
        Corners of the eyes without a marker: they stand where the mean face, laid on the markers, has them. That is
        no guess at a movement, since corners of the eyes do not move on the skull, but their height is a guess.
    """

    points: Array
    unit: float
    rotation: Array
    labels: dict[str, str]
    missing: list[str]
    assumed: list[str]

    @property
    def text(self) -> str:
        """One line: what is missing and which parameters stay empty for it."""
        told = []
        if self.missing:
            empty = [p.name for p in PARAMETERS if set(p.points) & set(self.missing)]
            told.append(f"no marker on {', '.join(self.missing)}: {', '.join(empty)} stay empty")
        if self.assumed:
            told.append(f"no marker on {', '.join(self.assumed)}: placed as on the mean face")
        return "; ".join(told) if told else "all 19 points have a marker"

    @property
    def parameters(self) -> Array:
        """The control parameters of every frame, shape (F, 15)."""
        return control_parameters(self.points, self.unit)


def frontal_markers(take: Capture, labels: Mapping[str, str] | None = None) -> MarkerPoints:
    """The 19 points of a compensated capture, projected to the frontal view.

    The front is where the mean face looks when it is laid on the markers: one similarity (rotation, scale, shift; least
    squares over the points that have a marker) between its points and the median of the markers over time.

    Parameters
    ----------
    take : Capture
        Without head motion (:func:`evalkit.compensate`): what is left of it would be taken for expression.
    labels : mapping of str to str, optional
        Point out of :data:`evalkit.vision.points.FACE_POINTS` -> label of its marker. Points that it leaves out, and
        all without it, go by :data:`KNOWN_LABELS`; a prefix up to a colon does not count.

    Returns
    -------
    MarkerPoints

    Raises
    ------
    EvalkitError
        If a given point or label is unknown, fewer than four points have a marker, or they lie in one line.

    Examples
    --------
    >>> import evalkit
    >>> from evalkit.vision.markers import frontal_markers
    >>> take, truth = evalkit.synthesize("talking", frames=60)
    >>> face = frontal_markers(evalkit.compensate(take, truth.rigid).capture)
    >>> face.missing
    ['lower lid left', 'lower lid right', 'nose tip']
    """
    found = _by_label(take, labels or {})
    if len(found) < FEWEST:
        raise EvalkitError(
            f"only {len(found)} of the 19 face points have a known marker, at least {FEWEST} are needed; say which "
            f"marker is which point (points: {', '.join(FACE_POINTS)}; markers: {', '.join(take.labels[:12])} ...)"
        )
    columns = take.indices(list(found.values()))
    rows = [FACE_POINTS.index(name) for name in found]
    space = np.full((take.frames, len(FACE_POINTS), 3), np.nan)
    space[:, rows] = take.points[:, columns]
    seen = np.isfinite(space[:, :, 0]).any(axis=0)
    median = np.full((len(FACE_POINTS), 3), np.nan)
    median[seen] = np.nanmedian(space[:, seen], axis=0)
    if seen.sum() < FEWEST:
        raise EvalkitError(f"only {seen.sum()} of the 19 face points are ever seen, at least {FEWEST} are needed")
    rotation, mean_face = _laid_on(median, seen)
    frontal = space @ rotation.T
    assumed = [name for name in EYE_CORNERS if not seen[FACE_POINTS.index(name)]]
    for name in assumed:
        frontal[:, FACE_POINTS.index(name)] = mean_face[FACE_POINTS.index(name)]
    rest = median @ rotation.T
    rest[~seen] = mean_face[~seen]
    missing = [name for k, name in enumerate(FACE_POINTS) if not seen[k] and name not in assumed]
    return MarkerPoints(frontal[:, :, :2], float(eye_distance(rest[:, :2])), rotation, found, missing, assumed)


def _by_label(take: Capture, given: Mapping[str, str]) -> dict[str, str]:
    unknown = next((name for name in given if name not in FACE_POINTS), None)
    if unknown is not None:
        near = difflib.get_close_matches(unknown, FACE_POINTS, n=2)
        hint = f"did you mean {' or '.join(near)}?" if near else f"the points are {', '.join(FACE_POINTS)}"
        raise EvalkitError(f"'{unknown}' is no point of the face; {hint}")
    take.indices(list(given.values()))
    found = dict(given)
    # The first of two subjects' markers counts.
    for label in take.labels:
        point = KNOWN_LABELS.get(label.rpartition(":")[2])
        if point is not None and label not in given.values():
            found.setdefault(point, label)
    return {name: found[name] for name in FACE_POINTS if name in found}


def _laid_on(shape: Array, known: np.ndarray) -> tuple[Array, Array]:
    """Rotation of a face to the front, and the mean face laid on it there, (19, 3)."""
    mean = mean_face_points()
    source, target = mean[known] - mean[known].mean(axis=0), shape[known] - shape[known].mean(axis=0)
    spread = np.linalg.svd(target, compute_uv=False)
    # Points in a line leave the turn about it open; 2 % of a face's width is what a marker's own place is uncertain by.
    if spread[1] < 0.02 * spread[0]:
        raise EvalkitError("the face points that have a marker lie in one line; the front of the face is not known")
    rotation = nearest_rotation(source.T @ target)
    turned = target @ rotation.T
    scale = float((source * turned).sum() / (source**2).sum())
    return rotation, scale * (mean - mean[known].mean(axis=0)) + shape[known].mean(axis=0) @ rotation.T
