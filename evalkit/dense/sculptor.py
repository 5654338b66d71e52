"""A sculptor who gives a face its own expressions, by rules that bend a rough shape as a stylising artist would.

Each rule looks at what the rough shape does (how far a region goes, how far the mouth is open, an eye closed) and
answers not in proportion: it saturates, turns along an arc, or begins late. None of them maps triangles or blends
examples, which is what is judged with these shapes. Rules that act where lips or lids meet move both alike, so that
what is closed stays closed. In order:

1. the amplitude of every region is eased, the corners of the mouth more on one side;
2. the corners travel on a curve: the further, the more upward;
3. lids close slowly at first, and open wider;
4. the jaw turns about another axis, comes forward, and saturates;
5. lips that part roll outward about their own axis and grow stiff; lips that narrow grow thick;
6. cheeks that are squashed between mouth and eye bulge;
7. the inner ends of brows go further; brows that come down fold the skin between them, those that rise the forehead;
8. lids meet higher, the lower one taking its share of the way, with a crease above.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from evalkit.dense.anatomy import SIDES, Anatomy, elevation, narrowed
from evalkit.dense.face import about_x
from evalkit.geometry import Array
from evalkit.seeds import generator


@dataclass(frozen=True)
class Manner:
    """The numbers of a sculptor's rules.

    Attributes
    ----------
    left, right : float
        Gain of the corner of the mouth at a strong smile, less one.
    brows, cheeks, nose, mouth : float
        Gain of a region that goes far, less one.
    curve_rad : float
        By which the way of the corner is turned upward.
    lids_late : float
        Part of the way that lids lag behind, at half closed.
    jaw_gain : float
        How much faster the jaw starts to open.
    jaw_limit_rad : float
        Where it ends.
    hinge_mm : (float, float)
        Height and depth of its axis above and before the head's own.
    jaw_forward_mm : float
    upper_roll_rad, lower_roll_rad : float
        Of lips wide apart.
    stiff : float
        Part of its own shape that a lip loses, 0 to 1.
    thick_mm : float
        By which narrowed lips come forward.
    bulge_mm : float
        Of squashed cheeks.
    tilt_mm : float
        By which the inner ends of brows go further than the outer ones.
    fold_mm, wrinkle_mm : float
        Of the skin between the brows, of the forehead.
    lids_meet_rad : float
        About the middle of the eye, by which lids meet higher.
    crease_mm : float
    """

    left: float = 0.15
    right: float = -0.30
    brows: float = 0.45
    cheeks: float = 0.30
    nose: float = 0.60
    mouth: float = -0.25
    curve_rad: float = 0.28
    lids_late: float = 0.35
    jaw_gain: float = 0.30
    jaw_limit_rad: float = 0.42
    hinge_mm: tuple[float, float] = (14.0, 16.0)
    jaw_forward_mm: float = 7.0
    upper_roll_rad: float = 0.60
    lower_roll_rad: float = 0.80
    stiff: float = 0.50
    thick_mm: float = 4.5
    bulge_mm: float = 5.0
    tilt_mm: float = 2.5
    fold_mm: float = 1.6
    wrinkle_mm: float = 0.9
    lids_meet_rad: float = 0.18
    crease_mm: float = 0.8


HUMAN = Manner()

MUZZLE = Manner(
    left=0.10, right=-0.15, brows=0.6, mouth=0.20, curve_rad=-0.30, jaw_gain=0.4, hinge_mm=(4.0, -8.0),
    jaw_forward_mm=10.0, upper_roll_rad=0.80, lower_roll_rad=1.00, stiff=0.6, thick_mm=7.0, bulge_mm=6.0,
    fold_mm=2.0, lids_meet_rad=0.18,
)  # fmt: skip
"""A thick-lipped one, whose corners of the mouth go back rather than up."""

FAR_MM = {"brow": 2.5, "corner": 4.0, "cheek": 2.0, "nose": 1.2, "mouth": 3.0}
"""A region whose root mean square way is this has half of its gain."""

SMILE_MM, PART_MM, NARROW = 8.0, 9.0, 0.15
"""Corners turn upward, lips roll, lips thicken: ``tanh`` of the way over this (for lips: of the share of the width)."""

THINNED = 0.4
"""By how much of the way by which narrowed lips come forward, lips that are drawn apart go back."""

SQUASH = 0.12
"""Of the distance from mouth to eye, at which a cheek bulges by ``tanh(1)`` of its full height."""

BROW_MM = 4.0
"""Way of a brow at which folds have ``tanh(1)`` of their depth; they grow with its square."""

WAVE_MM, FOLD_MM = 18.0, 4.0
"""Distance of the wrinkles of the forehead, and width of the fold between the brows."""

LID_RAD = 0.35
"""Width, seen from the middle of the eye, of the skin that goes along where lids meet higher."""

JAW_RAD = 0.15
"""Angle at which the jaw has come forward by ``tanh(1)`` of its way."""

STILL_MM = 1e-9
"""Below this all is rounding: of turning the jaw back and forth."""

OUTWARD = {side: np.array([0.45 * sign, 0.20, 0.87]) for side, sign in SIDES.items()}
"""Where a cheek bulges to."""


def drawn_manner(*names: object, seed: int = 0) -> Manner:
    """Another sculptor: every number of :data:`HUMAN` times 0.6 to 1.4, the stronger side either one."""
    random = generator("manner", *names, seed=seed)
    drawn: dict[str, Any] = {}
    for one in fields(Manner):
        value, factor = getattr(HUMAN, one.name), random.uniform(0.6, 1.4)
        drawn[one.name] = tuple(factor * part for part in value) if isinstance(value, tuple) else factor * value
    if random.random() < 0.5:
        drawn["left"], drawn["right"] = drawn["right"], drawn["left"]
    return replace(HUMAN, **drawn)


def sculpt(rest: Array, rough: Array, anatomy: Anatomy, manner: Manner = HUMAN, style: float = 1.0) -> Array:
    """Fine shapes of rough ones.

    Parameters
    ----------
    rest : ndarray, shape (V, 3), mm
    rough : ndarray, shape (N, V, 3), mm
    anatomy : Anatomy
        Of this face.
    manner : Manner
    style : float
        Strength of the individuality: 0 leaves the rough shapes as they are, 1 is the full manner.

    Returns
    -------
    ndarray, shape (N, V, 3), mm
    """
    if style == 0.0:
        return rough.copy()
    angle = jaw_angle(rest, rough, anatomy)
    moves = without_jaw(rest, rough, anatomy, angle)
    moves = moves + style * _eased(rest, moves, anatomy, manner)
    moves = moves + style * _lids_late(rest, moves, anatomy, manner)
    out = with_jaw(rest + moves, anatomy, angle) + style * _jaw(rest, rough, moves, angle, anatomy, manner)
    out = _lips(rest, rough, out, anatomy, manner, style)
    out += style * (_cheeks(rest, out, anatomy, manner) + _brows(rest, rough, anatomy, manner))
    out = _lids_meet(rest, rough, out, anatomy, manner, style)
    return settled(rough, out)


def settled(still: Array, moved: Array) -> Array:
    """Shapes that are exactly the still ones where they differ by rounding only: what no rule moves must not move."""
    return np.where(np.abs(moved - still) > STILL_MM, moved, still)


def jaw_angle(rest: Array, shapes: Array, anatomy: Anatomy) -> Array:
    """Angle about the hinge by which the jaw has turned, rad, shape (N,); least squares over what follows it."""
    bone = anatomy.share > 0.9
    a, b = rest[bone] - anatomy.hinge, shapes[:, bone] - anatomy.hinge
    sine = (a[:, 1] * b[..., 2] - a[:, 2] * b[..., 1]).sum(axis=-1)
    cosine = (a[:, 1] * b[..., 1] + a[:, 2] * b[..., 2]).sum(axis=-1)
    return np.asarray(np.arctan2(sine, cosine))


def without_jaw(rest: Array, shapes: Array, anatomy: Anatomy, angle: Array) -> Array:
    """Displacements (N, V, 3) that are left when the jaw is turned back by angles (N,)."""
    return about_x(shapes - anatomy.hinge, -angle[:, None] * anatomy.share) + anatomy.hinge - rest


def with_jaw(shapes: Array, anatomy: Anatomy, angle: Array) -> Array:
    """Shapes (N, V, 3) whose jaw is turned by angles (N,)."""
    return about_x(shapes - anatomy.hinge, angle[:, None] * anatomy.share) + anatomy.hinge


def _eased(rest: Array, moves: Array, anatomy: Anatomy, manner: Manner) -> Array:
    """Rules 1 and 2: what every region adds to its own way."""
    gains = {"nose": manner.nose, "mouth": manner.mouth}
    for side in SIDES:
        gains |= {f"brow {side}": manner.brows, f"cheek {side}": manner.cheeks}
    gains |= {"corner left": manner.left, "corner right": manner.right}
    out = np.zeros_like(moves)
    square = (moves**2).sum(axis=2)
    for part, gain in gains.items():
        weight = anatomy.weights[part]
        far = square @ weight / weight.sum() / FAR_MM[part.split()[0]] ** 2
        out += (gain * far / (1.0 + far))[:, None, None] * weight[:, None] * moves
    for side, sign in SIDES.items():
        corner = moves[:, anatomy.places[f"corner {side}"]]
        upward = 0.5 + 0.5 * np.tanh(corner[:, 1] / 3.0)
        turn = sign * manner.curve_rad * np.tanh(np.linalg.norm(corner, axis=1) / SMILE_MM) * upward
        by = turn[:, None] * anatomy.weights[f"corner {side}"]
        cos, sin = np.cos(by), np.sin(by)
        x, y = moves[..., 0], moves[..., 1]
        out[..., 0] += cos * x - sin * y - x
        out[..., 1] += sin * x + cos * y - y
    return out


def closure(rest: Array, shapes: Array, anatomy: Anatomy, side: str) -> Array:
    """How far an eye is closed, shape (N,): 0 as at rest, 1 as the head closes it, below 0 wider."""
    lids = [anatomy.places[f"{lid} lid {side}"] for lid in ("upper", "lower")]
    return narrowed(rest, shapes, anatomy.eyes[side], lids) / anatomy.shut[side]


def _lids_late(rest: Array, moves: Array, anatomy: Anatomy, manner: Manner) -> Array:
    out = np.zeros_like(moves)
    for side in SIDES:
        closed = np.clip(closure(rest, rest + moves, anatomy, side), -1.0, 1.0)
        factor = np.where(
            closed > 0.0, -4.0 * manner.lids_late * closed * (1.0 - closed), -manner.lids_late * np.tanh(closed / 0.3)
        )
        out += factor[:, None, None] * anatomy.weights[f"eye {side}"][:, None] * moves
    return out


def _jaw(rest: Array, rough: Array, moves: Array, angle: Array, anatomy: Anatomy, manner: Manner) -> Array:
    """Rule 4: what the jaw adds to shapes that are turned as the rough ones are."""
    limit = manner.jaw_limit_rad
    eased = limit * np.tanh((1.0 + manner.jaw_gain) * angle / limit)
    centre = anatomy.hinge + np.array([0.0, *manner.hinge_mm])
    shapes = rest + moves
    out = about_x(shapes - centre, eased[:, None] * anatomy.share) + centre - with_jaw(shapes, anatomy, angle)
    out[..., 2] += manner.jaw_forward_mm * np.tanh(eased / JAW_RAD)[:, None] * anatomy.share
    # Lips that are held closed over an open jaw stay where they are, or they would go through each other.
    held = 1.0 - np.tanh(parted(rest, rough, anatomy) / PART_MM)
    return np.asarray(out * (1.0 - held[:, None] * anatomy.weights["mouth"])[..., None])


def parted(rest: Array, shapes: Array, anatomy: Anatomy) -> Array:
    """How far the lips have parted in the middle, mm, shape (N,); 0 for closed ones."""
    lower, upper = anatomy.contact
    now = np.linalg.norm(shapes[:, upper] - shapes[:, lower], axis=2).mean(axis=1)
    return np.asarray(np.maximum(now - np.linalg.norm(rest[upper] - rest[lower], axis=1).mean(), 0.0))


def _lips(rest: Array, rough: Array, shapes: Array, anatomy: Anatomy, manner: Manner, style: float) -> Array:
    """Rule 5, about the axis of each lip: the mean of its skin along the mouth."""
    apart = np.tanh(parted(rest, rough, anatomy) / PART_MM)
    weight = anatomy.weights["lips"]
    corners = [anatomy.places[f"corner {side}"] for side in SIDES]
    middle, half = rest[corners, 0].mean(), 0.5 * abs(rest[corners[0], 0] - rest[corners[1], 0])
    # At the corners there is one lip only, which cannot roll both ways.
    taper = np.clip(1.0 - ((rest[:, 0] - middle) / half) ** 2, 0.0, 1.0)
    out = shapes.copy()
    for share, roll in ((1.0 - anatomy.share, -manner.upper_roll_rad), (anatomy.share, manner.lower_roll_rad)):
        own = anatomy.gather * share**2
        own /= own.sum(axis=1, keepdims=True)
        axis = anatomy.spread @ (own @ shapes)
        shape = shapes - axis - (rest - anatomy.spread @ (own @ rest))
        lip = (style * weight * taper * share**2)[None] * apart[:, None]
        arm = shapes - axis - manner.stiff * lip[..., None] * shape
        out += about_x(arm, roll * lip) + axis - shapes
    width = np.abs(rough[:, corners[0], 0] - rough[:, corners[1], 0])
    narrow = np.tanh((1.0 - width / (2.0 * half)) / NARROW)
    # Drawn apart they lie against the teeth, and have less far to go.
    narrow = np.where(narrow < 0.0, THINNED * narrow, narrow)
    out[..., 2] += style * manner.thick_mm * narrow[:, None] * weight
    return out


def _cheeks(rest: Array, shapes: Array, anatomy: Anatomy, manner: Manner) -> Array:
    out = np.zeros_like(shapes)
    for side in SIDES:
        corner, lid = (anatomy.places[f"{place} {side}"] for place in ("corner", "lower lid"))
        before = np.linalg.norm(rest[corner] - rest[lid])
        squash = 1.0 - np.linalg.norm(shapes[:, corner] - shapes[:, lid], axis=1) / before
        height = manner.bulge_mm * np.tanh(np.maximum(squash, 0.0) / SQUASH)
        out += height[:, None, None] * anatomy.weights[f"cheek {side}"][:, None] * OUTWARD[side]
    return out


def _brows(rest: Array, rough: Array, anatomy: Anatomy, manner: Manner) -> Array:
    out = np.zeros_like(rough)
    x, y = rest[:, 0], rest[:, 1]
    inner = [anatomy.places[f"brow inner {side}"] for side in SIDES]
    line = rest[inner, 1].mean()
    fold = -np.exp(-0.5 * (x / FOLD_MM) ** 2) + 0.5 * np.exp(-0.5 * ((np.abs(x) - 2.0 * FOLD_MM) / FOLD_MM) ** 2)
    wave = np.sin(2.0 * np.pi * (y - line) / WAVE_MM)
    down = np.maximum(-(rough[:, inner, 1] - rest[inner, 1]).mean(axis=1), 0.0)
    depth = manner.fold_mm * np.tanh((down / BROW_MM) ** 2)
    out[..., 2] += depth[:, None] * anatomy.weights["glabella"] * fold
    for side, sign in SIDES.items():
        ends = [anatomy.places[f"brow {end} {side}"] for end in ("inner", "outer")]
        way = (rough[:, ends, 1] - rest[ends, 1]).mean(axis=1)
        from_outer = np.clip((x - rest[ends[1], 0]) / (rest[ends[0], 0] - rest[ends[1], 0]), 0.0, 1.0)
        # Between a brow that comes down and the lid there is less room than above it.
        tilt = manner.tilt_mm * np.tanh(way / BROW_MM) * np.abs(np.tanh(way / BROW_MM)) * np.where(way < 0, 0.4, 1.0)
        out[..., 1] += tilt[:, None] * anatomy.weights[f"brow {side}"] * (1.5 * from_outer - 0.5)
        height = manner.wrinkle_mm * np.tanh((np.maximum(way, 0.0) / BROW_MM) ** 2)
        half = 0.5 + 0.5 * np.tanh(sign * x / 8.0)
        out[..., 2] += height[:, None] * anatomy.weights["forehead"] * half * wave
    return out


def _lids_meet(rest: Array, rough: Array, shapes: Array, anatomy: Anatomy, manner: Manner, style: float) -> Array:
    """Rule 8: the skin is turned about the eye by an angle that depends on where it is, so that no two places meet."""
    out = shapes
    for side in SIDES:
        eye = anatomy.eyes[side]
        closed = np.clip(closure(rest, rough, anatomy, side), 0.0, 1.0)
        smooth = closed**2 * (3.0 - 2.0 * closed)
        lower = elevation(rest[None], eye, anatomy.places[f"lower lid {side}"])
        upper = elevation(rest[None], eye, anatomy.places[f"upper lid {side}"])
        now = elevation(out, eye)
        weight = anatomy.weights[f"eye {side}"]
        near = np.exp(-0.5 * ((now - lower) / LID_RAD) ** 2) * weight
        arm = out - eye
        crease = np.exp(-0.5 * ((now - upper - LID_RAD) / (0.5 * LID_RAD)) ** 2) * weight
        length = np.linalg.norm(arm, axis=2)
        arm = arm * (1.0 - style * manner.crease_mm * smooth[:, None] * crease / length)[..., None]
        out = about_x(arm, -style * manner.lids_meet_rad * smooth[:, None] * near) + eye
    return out
