"""Fifteen numbers that say what a face expresses, from 19 points seen squarely from the front.

They are those of Chai, Xiao & Hodgins (2003), doi:10.2312/SCA03/193-206, section 3.2, and the same function makes them
from a video's points and from the markers of a capture. The axes of the frontal view are those of the head: x to the
person's left, y up. The unit of length is the neutral distance between the eyes, each eye being the middle of its two
corners: corners stay where they are when the lids close.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.vision.points import FACE_POINTS

EYE_CORNERS = tuple(name for name in FACE_POINTS if name.startswith(("eye inner", "eye outer")))
LIPS = ("upper lip", "lower lip", "mouth corner left", "mouth corner right")

CLOSED_LIPS = 0.1
"""Opening under which the lips' angle fades to zero, in distances between the eyes: about 6 mm, a few pixels in a
small picture. Two points this near to each other have no direction that can be measured."""

SMALLEST_LENGTH = 0.02
"""Neutral length under which no ratio is taken: about 1 mm, which is no more than what tracking is wrong by."""


class Parameter(NamedTuple):
    """One control parameter.

    Attributes
    ----------
    name : str
    unit : str
        ``iod``, the neutral distance between the eyes, or ``deg``.
    form : str
        How it is compared with the neutral: ``ratio`` or ``difference``.
    formula : str
        LT, LB: middle of upper and lower lip; ML, MR: corners of the mouth; NL, NR: wings of the nose; NT: its tip;
        EU, EL: upper and lower lid; BI, BO: inner and outer end of the brow; C: middle of the corners of both eyes
        or, for one brow, of the eye under it.
    points : tuple of str
        What it is made from; without any one of them it is NaN.
    """

    name: str
    unit: str
    form: str
    formula: str
    points: tuple[str, ...]


def _of_side(side: str, *names: str) -> tuple[str, ...]:
    return tuple(f"{name} {side}" for name in names)


_WINGS = ("nose wing left", "nose wing right")
_MOUTH_ENDS = ("mouth corner left", "mouth corner right")

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("lip_opening", "iod", "ratio", "|LT - LB|", ("upper lip", "lower lip")),
    Parameter("lip_width", "iod", "ratio", "|ML - MR|", _MOUTH_ENDS),
    Parameter("mouth_x", "iod", "difference", "x of mean(LT, LB, ML, MR) - C", (*LIPS, *EYE_CORNERS)),
    Parameter("mouth_y", "iod", "difference", "y of mean(LT, LB, ML, MR) - C", (*LIPS, *EYE_CORNERS)),
    Parameter(
        "lip_angle", "deg", "difference",
        "angle of LB->LT from the vertical, positive to the person's left, times min(1, |LT - LB| / 0.1)",
        ("upper lip", "lower lip"),
    ),
    Parameter("mouth_angle", "deg", "difference", "angle of MR->ML from the horizontal, positive upwards", _MOUTH_ENDS),
    Parameter("nose_width", "iod", "ratio", "|NL - NR|", _WINGS),
    Parameter("nose_tip", "iod", "ratio", "|NT - mean(NL, NR)|", ("nose tip", *_WINGS)),
    Parameter("eye_left", "iod", "ratio", "|EU - EL|, left", _of_side("left", "upper lid", "lower lid")),
    Parameter("eye_right", "iod", "ratio", "|EU - EL|, right", _of_side("right", "upper lid", "lower lid")),
    Parameter(
        "brow_angle_left", "deg", "difference", "angle of BI->BO from the horizontal, left, positive upwards",
        _of_side("left", "brow inner", "brow outer"),
    ),
    Parameter(
        "brow_angle_right", "deg", "difference", "angle of BI->BO from the horizontal, right, positive upwards",
        _of_side("right", "brow inner", "brow outer"),
    ),
    Parameter(
        "brow_height_left", "iod", "ratio", "y of mean(BI, BO) - C, left",
        _of_side("left", "brow inner", "brow outer", "eye inner", "eye outer"),
    ),
    Parameter(
        "brow_height_right", "iod", "ratio", "y of mean(BI, BO) - C, right",
        _of_side("right", "brow inner", "brow outer", "eye inner", "eye outer"),
    ),
    Parameter("brow_distance", "iod", "ratio", "|BI left - BI right|", ("brow inner left", "brow inner right")),
)  # fmt: skip
"""The parameters in the order of every array of them: six of the mouth, two of the nose, two of the eyes, five of the
brows."""

NAMES = tuple(parameter.name for parameter in PARAMETERS)
_RATIO = np.array([parameter.form == "ratio" for parameter in PARAMETERS])


def eye_distance(points: ArrayLike) -> Array:
    """Distance between the eyes, each the middle of its two corners.

    Parameters
    ----------
    points : array_like, shape (..., 19, D)
        In the order of :data:`evalkit.vision.points.FACE_POINTS`, any unit.

    Returns
    -------
    ndarray, shape (...)
        In the unit of the points; NaN where a corner is missing.
    """
    p = _checked(points)
    return np.linalg.norm(_middle(p, _of_side("left", "eye inner", "eye outer"))
                          - _middle(p, _of_side("right", "eye inner", "eye outer")), axis=-1)  # fmt: skip


def control_parameters(points: ArrayLike, unit: float) -> Array:
    """The fifteen control parameters of every frame.

    Parameters
    ----------
    points : array_like, shape (F, 19, 2)
        In the frontal view, x to the person's left and y up, in any unit, in the order of
        :data:`evalkit.vision.points.FACE_POINTS`. NaN where a point is missing.
    unit : float
        Distance between the eyes in the neutral face, in the unit of the points (:func:`eye_distance`).

    Returns
    -------
    ndarray, shape (F, 15)
        In the order and units of :data:`PARAMETERS`; NaN where a point that the parameter is made from is missing.

    Raises
    ------
    EvalkitError
        If the unit is not a positive number or the points have another shape.
    """
    p = _checked(points)
    if p.ndim != 3 or p.shape[2] != 2:
        raise EvalkitError(f"points of the frontal view have shape {p.shape}; expected (frames, {len(FACE_POINTS)}, 2)")
    if not (np.isfinite(unit) and unit > 0):
        raise EvalkitError(f"the distance between the eyes is {unit}; it must be a number > 0: are the corners known?")
    p = p / unit
    at = dict(zip(FACE_POINTS, p.transpose(1, 0, 2), strict=True))
    lips = at["upper lip"] - at["lower lip"]
    opening = _length(lips)
    mouth = at["mouth corner left"] - at["mouth corner right"]
    centre = _middle(p, LIPS) - _middle(p, EYE_CORNERS)
    brows = {side: at[f"brow outer {side}"] - at[f"brow inner {side}"] for side in ("left", "right")}
    heights = {
        side: _middle(p, _of_side(side, "brow inner", "brow outer"))
        - _middle(p, _of_side(side, "eye inner", "eye outer"))
        for side in ("left", "right")
    }
    values = {
        "lip_opening": opening,
        "lip_width": _length(mouth),
        "mouth_x": centre[:, 0],
        "mouth_y": centre[:, 1],
        "lip_angle": _degrees(lips[:, 0], lips[:, 1]) * np.minimum(1.0, opening / CLOSED_LIPS),
        "mouth_angle": _degrees(mouth[:, 1], mouth[:, 0]),
        "nose_width": _length(at["nose wing left"] - at["nose wing right"]),
        "nose_tip": _length(at["nose tip"] - _middle(p, _WINGS)),
        "eye_left": _length(at["upper lid left"] - at["lower lid left"]),
        "eye_right": _length(at["upper lid right"] - at["lower lid right"]),
        "brow_angle_left": _degrees(brows["left"][:, 1], brows["left"][:, 0]),
        # Mirrored, so that the same movement of both brows gives the same sign.
        "brow_angle_right": _degrees(brows["right"][:, 1], -brows["right"][:, 0]),
        "brow_height_left": heights["left"][:, 1],
        "brow_height_right": heights["right"][:, 1],
        "brow_distance": _length(at["brow inner left"] - at["brow inner right"]),
    }
    return np.stack([values[name] for name in NAMES], axis=1)


def neutral_parameters(parameters: ArrayLike, frames: Sequence[int] | None = None) -> Array:
    """Parameters of the neutral face.

    Parameters
    ----------
    parameters : array_like, shape (F, 15)
    frames : sequence of int, optional
        Frames, counted from 0, in which the face is at rest: their median is taken. Without it, every parameter's
        shorth, the mean of the shortest interval that holds half of its values, which stays with the rest position
        while the median follows talk and blinks (Andrews et al., "Robust estimates of location", 1972).

    Returns
    -------
    ndarray, shape (15,)
        NaN for parameters that are missing in all those frames.

    Raises
    ------
    EvalkitError
        If a frame is not in the take, or there are none.
    """
    p = _parameter_rows(parameters)
    if frames is not None:
        outside = [frame for frame in frames if not 0 <= frame < len(p)]
        if outside or not len(frames):
            what = f"frame {outside[0]} is not in the take" if outside else "no frame is named"
            raise EvalkitError(f"neutral face: {what}; frames go from 0 to {len(p) - 1}")
        p = p[list(frames)]
    known = np.isfinite(p).any(axis=0)
    out = np.full(p.shape[1], np.nan)
    if frames is not None:
        out[known] = np.nanmedian(p[:, known], axis=0)
        return out
    for k in np.flatnonzero(known):
        values = np.sort(p[np.isfinite(p[:, k]), k])
        half = len(values) // 2 + 1
        start = int(np.argmin(values[half - 1 :] - values[: len(values) - half + 1]))
        out[k] = values[start : start + half].mean()
    return out


def normalise(parameters: ArrayLike, neutral: ArrayLike, spread: ArrayLike | None = None) -> Array:
    """Parameters of any person against those of his own neutral face, and in units of a database's spread.

    Parameters
    ----------
    parameters : array_like, shape (F, 15)
    neutral : array_like, shape (15,)
        Of the same person (:func:`neutral_parameters`).
    spread : array_like, shape (15,), optional
        Standard deviation of the database's parameters, normalised against its own neutral without a spread.

    Returns
    -------
    ndarray, shape (F, 15)
        Lengths as the ratio to the neutral less 1, angles and the mouth's centre as the difference from it, divided by
        the spread: the neutral face is 0 throughout.

    Raises
    ------
    EvalkitError
        If a neutral length is too small for a ratio or a spread is not positive.
    """
    base, scale = _normal(neutral, spread)
    return (_parameter_rows(parameters) - base) / scale


def denormalise(normalised: ArrayLike, neutral: ArrayLike, spread: ArrayLike | None = None) -> Array:
    """Inverse of :func:`normalise`: parameters of the person whose neutral face is given; shape (F, 15)."""
    base, scale = _normal(neutral, spread)
    return _parameter_rows(normalised) * scale + base


def _normal(neutral: ArrayLike, spread: ArrayLike | None) -> tuple[Array, Array]:
    """What to take off and what to divide by."""
    base = np.asarray(neutral, dtype=np.float64)
    wide = np.ones(len(PARAMETERS)) if spread is None else np.asarray(spread, dtype=np.float64)
    for name, values in (("neutral", base), ("spread", wide)):
        if values.shape != (len(PARAMETERS),):
            raise EvalkitError(
                f"{name} has shape {values.shape}; expected ({len(PARAMETERS)},), one for each parameter"
            )
    small = np.flatnonzero(_RATIO & (np.abs(base) < SMALLEST_LENGTH))
    if len(small):
        raise EvalkitError(
            f"neutral {NAMES[small[0]]} is {base[small[0]]:.4f} eye distances, too small for a ratio; name neutral "
            "frames with eyes open and points apart"
        )
    still = np.flatnonzero(wide <= 0)
    if len(still):
        raise EvalkitError(
            f"spread of {NAMES[still[0]]} is {wide[still[0]]:g}, not > 0; where the database does not move, give it 1"
        )
    return base, np.where(_RATIO, base, 1.0) * wide


def _checked(points: ArrayLike) -> Array:
    p = np.asarray(points, dtype=np.float64)
    if p.ndim < 2 or p.shape[-2] != len(FACE_POINTS):
        raise EvalkitError(f"points have shape {p.shape}; expected (..., {len(FACE_POINTS)}, dimensions)")
    return p


def _parameter_rows(parameters: ArrayLike) -> Array:
    p = np.asarray(parameters, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != len(PARAMETERS):
        raise EvalkitError(f"parameters have shape {p.shape}; expected (frames, {len(PARAMETERS)})")
    return p


def _middle(points: Array, names: Sequence[str]) -> Array:
    return points[..., [FACE_POINTS.index(name) for name in names], :].mean(axis=-2)


def _length(vectors: Array) -> Array:
    return np.hypot(vectors[:, 0], vectors[:, 1])


def _degrees(rise: Array, run: Array) -> Array:
    return np.degrees(np.arctan2(rise, run))
