"""Faces with the rough shapes of their expressions, before a sculptor has seen them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from evalkit.dense.anatomy import SIDES, Anatomy, anatomy_of, front_of, hand_drawn_regions, scored_regions
from evalkit.dense.face import Face, Turn
from evalkit.dense.muscles import muscle_face
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import Head, load_head
from evalkit.head.ict import read_ict
from evalkit.head.model import Indices
from evalkit.seeds import generator

MUSCLE_EXPRESSIONS: dict[str, dict[str, float]] = {
    "jaw open": {"jaw": 1.0},
    "jaw half open": {"jaw": 0.5},
    "smile": {"smile": 1.0},
    "faint smile": {"smile": 0.5},
    "smile left": {"smile left": 1.0},
    "smile right": {"smile right": 1.0},
    "pucker": {"pucker": 1.0},
    "funnel": {"pucker": 0.8, "jaw": 0.4, "upper_lip_up": 0.5, "lower_lip_down": 0.5},
    "lips stretched": {"lip_stretch": 1.0},
    "lips stretched left": {"lip_stretch left": 1.0},
    "upper lip up": {"upper_lip_up": 1.0},
    "sneer left": {"upper_lip_up left": 1.0, "brow_down left": 0.4},
    "lower lip down": {"lower_lip_down": 1.0},
    "brows up": {"brow_up": 1.0},
    "brow up left": {"brow_up left": 1.0},
    "brow up right": {"brow_up right": 1.0},
    "brows down": {"brow_down": 1.0},
    "eyes closed": {"lid_down": 1.0},
    "eyes half closed": {"lid_down": 0.5},
    "wink left": {"lid_down left": 1.0},
    "wink right": {"lid_down right": 1.0},
    "grin": {"smile": 0.7, "lip_stretch": 0.6, "upper_lip_up": 0.6, "lower_lip_down": 0.8},
    "laugh": {"smile": 1.0, "jaw": 0.7, "lid_down": 0.4},
    "surprise": {"brow_up": 1.0, "jaw": 0.8, "lid_down": -0.15},
    "anger": {"brow_down": 1.0, "upper_lip_up": 0.6, "lower_lip_down": 0.9, "lip_stretch": 0.4},
    "kiss": {"pucker": 1.0, "lid_down": 1.0},
    "shout": {"jaw": 0.9, "lip_stretch": 0.8, "brow_down": 0.8},
    "yawn": {"jaw": 1.1, "lid_down": 0.9, "brow_up": 0.5},
    "smirk": {"smile left": 1.0, "brow_up right": 1.0, "lid_down": 0.3},
    "disgust": {"upper_lip_up": 1.0, "brow_down": 0.7, "lid_down": 0.4, "jaw": 0.2},
}
"""Expression -> strengths of the units of a face with muscles; a unit without its side is that of both sides."""

MUSCLE_TRAINING = ("surprise", "grin", "kiss", "anger")
MUSCLE_UNLIKE = ("smirk", "wink left", "yawn")

SHAPE_COMBINATIONS: dict[str, dict[str, float]] = {
    "eyes closed": {"eyeBlink": 1.0},
    "smile": {"mouthSmile": 1.0},
    "faint smile": {"mouthSmile": 0.5},
    "grin": {"mouthSmile": 0.7, "mouthStretch": 0.4, "mouthUpperUp": 0.5, "mouthLowerDown": 0.8, "cheekSquint": 0.5},
    "laugh": {"mouthSmile": 0.9, "jawOpen": 0.5, "cheekSquint": 0.7, "eyeSquint": 0.6},
    "surprise": {"browInnerUp": 1.0, "browOuterUp": 0.8, "jawOpen": 0.6, "eyeWide": 0.8},
    "anger": {"browDown": 1.0, "mouthUpperUp": 0.5, "mouthLowerDown": 0.8, "noseSneer": 0.6, "eyeSquint": 0.4},
    "kiss": {"mouthPucker": 1.0, "eyeBlink": 1.0},
    "shout": {"jawOpen": 0.8, "mouthStretch": 0.7, "browDown": 0.8},
    "yawn": {"jawOpen": 1.0, "eyeBlink": 0.9, "browInnerUp": 0.5},
    "smirk": {"mouthSmileLeft": 1.0, "mouthDimpleLeft": 0.5, "browOuterUpRight": 1.0},
    "disgust": {"noseSneer": 1.0, "mouthUpperUp": 0.6, "browDown": 0.6, "eyeSquint": 0.6},
    "sadness": {"browInnerUp": 1.0, "mouthFrown": 1.0, "mouthShrugLower": 0.5},
}
"""Expression -> amounts of shapes of a head that brings its own; a shape without its side is that of both sides. All
single shapes are expressions, too."""

SHAPE_TRAINING = ("surprise", "grin", "kiss", "anger")
SHAPE_UNLIKE = ("smirk", "eyeBlinkLeft", "yawn", "mouthLeft")

CORRECTIVE = {"mouthClose": "jawOpen"}
"""A shape that is made to go together with another: alone it would push the lips through each other."""

MOVES_MM = 1.0
"""A shape that moves the front of the face by less (the tongue, the pupils) is no expression."""

TEMPLATE_VERTICES = 8000
"""Resolution of the template whose front has about 5,000 vertices, as the face in the paper."""

IDENTITY_TARGETS, IDENTITY_SPREAD = 24, 0.45
"""Identity targets of MakeHuman that make up one person, and the largest amount of each."""

ICT_FILE = ("meshes", "ict_facekit_subset.npz")
"""Where in the folder of real data ICT-FaceKit's arrays are."""


@dataclass(frozen=True, eq=False)
class Actor:
    """A face with its rough shapes.

    Attributes
    ----------
    head : Head
        The whole head that it is the front of.
    kept : ndarray of int, shape (V,)
        Its vertices in the head.
    rest : ndarray, shape (V, 3), mm
    triangles : ndarray of int, shape (T, 3)
    shapes : dict of str to ndarray, shape (V, 3), mm
        Expression to positions.
    anatomy : Anatomy
    regions, hand_drawn : dict of str to ndarray of int
    training, unlike : tuple of str
        As of a :class:`evalkit.dense.characters.Character`.
    """

    head: Head
    kept: Indices
    rest: Array
    triangles: Indices
    shapes: dict[str, Array]
    anatomy: Anatomy
    regions: dict[str, Indices]
    hand_drawn: dict[str, Indices]
    training: tuple[str, ...]
    unlike: tuple[str, ...]

    @property
    def rough(self) -> Array:
        """All shapes, (N, V, 3), mm."""
        return np.stack(list(self.shapes.values()))


@lru_cache(maxsize=1)
def muscle_actor() -> Actor:
    """The front of the built-in head, with muscles."""
    head = load_head("template", vertices=TEMPLATE_VERTICES)
    face = muscle_face(head)
    lids = face.turns.pop("lid_down")
    for side, sign in SIDES.items():
        own = sign * lids.centre[:, 0] > 0.0
        turn = Turn(lids.which[own], lids.centre[own], lids.angle[own], lids.shift[own])
        face.turns[f"lid_down {side}"] = turn
    shapes = {name: _acted(face, mixture) for name, mixture in MUSCLE_EXPRESSIONS.items()}
    return _actor(head, shapes, shapes["jaw open"], shapes["eyes closed"], MUSCLE_TRAINING, MUSCLE_UNLIKE)


def _acted(face: Face, mixture: Mapping[str, float]) -> Array:
    strengths = {
        unit: np.array([amount])
        for part, amount in mixture.items()
        for unit in ([part] if part in face.units else [f"{part} {side}" for side in SIDES])
    }
    return face.positions(strengths)[0]


@lru_cache(maxsize=1)
def makehuman_actor() -> Actor:
    """The front of MakeHuman's head, with its face units."""
    return _shape_actor(load_head("makehuman"))


@lru_cache(maxsize=1)
def ict_actor() -> Actor:
    """The front of ICT-FaceKit's head, with its expressions, from the folder that EVALKIT_REAL_DATA names."""
    folder = os.environ.get("EVALKIT_REAL_DATA")
    if not folder:
        raise EvalkitError("character ict: set EVALKIT_REAL_DATA to the folder that holds " + "/".join(ICT_FILE))
    return _shape_actor(read_ict(Path(folder, *ICT_FILE)))


def _shape_actor(head: Head) -> Actor:
    """Every hand-made shape that moves the skin, then the combinations."""
    front = front_of(head)
    own = [name for name in head.blendshapes if not name.startswith("identity")]
    mixtures = {name: {name: 1.0, CORRECTIVE.get(name, name): 1.0} for name in own} | SHAPE_COMBINATIONS
    shapes = {name: head.vertices + _mixed(head, mixture) for name, mixture in mixtures.items()}
    far = {name: np.linalg.norm((shape - head.vertices)[front.kept], axis=1).max() for name, shape in shapes.items()}
    shapes = {name: shape for name, shape in shapes.items() if far[name] > MOVES_MM}
    unlike = tuple(name if name in shapes else name.replace("Left", "_L") for name in SHAPE_UNLIKE)
    return _actor(head, shapes, shapes["jawOpen"], shapes["eyes closed"], SHAPE_TRAINING, unlike)


def _mixed(head: Head, mixture: Mapping[str, float]) -> Array:
    """Displacement (V, 3) of the whole head by amounts of its shapes."""
    out = np.zeros_like(head.vertices)
    for shape, amount in mixture.items():
        stem = shape.removesuffix("Left").removesuffix("Right")
        if shape in head.blendshapes:
            names = [shape]
        elif stem == shape:
            names = [shape + end for end in ("Left", "Right", "_L", "_R") if shape + end in head.blendshapes]
        else:
            names = [stem + ("_L" if shape.endswith("Left") else "_R")]
        for name in names:
            if name not in head.blendshapes:
                raise EvalkitError(f"{head.name}: no shape '{name}'; it cannot be a character")
            which, moves = head.blendshapes[name]
            out[which] += amount * moves
    return out


def _actor(
    head: Head,
    shapes: dict[str, Array],
    opened: Array,
    closed: Array,
    training: tuple[str, ...],
    unlike: tuple[str, ...],
) -> Actor:
    front = front_of(head)
    anatomy = anatomy_of(head, front, opened[front.kept], closed[front.kept])
    return Actor(
        head=head,
        kept=front.kept,
        rest=front.rest,
        triangles=front.triangles,
        shapes={name: shape[front.kept] for name, shape in shapes.items()},
        anatomy=anatomy,
        regions=scored_regions(head, front, anatomy),
        hand_drawn=hand_drawn_regions(head, front, anatomy),
        training=training,
        unlike=unlike,
    )


def targets_of(person: int) -> dict[str, float]:
    """Amounts of MakeHuman's identity targets; those of one side go together with the other side's."""
    head = makehuman_actor().head
    pool = [
        name
        for name in head.blendshapes
        if name.startswith("identity/") and "/r-" not in name and name.split("/")[1] not in ("ears", "neck")
    ]
    random = generator("makehuman identity", person)
    chosen = random.choice(len(pool), IDENTITY_TARGETS, replace=False)
    amounts = {pool[k]: float(random.uniform(0.0, IDENTITY_SPREAD)) for k in chosen}
    return amounts | {name.replace("/l-", "/r-"): amount for name, amount in amounts.items()}


def modes_of(person: int) -> dict[str, float]:
    """Amounts of ICT-FaceKit's identity modes: standard normal, as that model defines them."""
    modes = [shape for shape in ict_actor().head.blendshapes if shape.startswith("identity")]
    amounts = generator("ict identity", person).standard_normal(len(modes))
    return dict(zip(modes, map(float, amounts), strict=True))


def as_person(actor: Actor, identity: Mapping[str, float]) -> Actor:
    """The same expressions on another person: the identity is added to all shapes, and moves the eyes."""
    moves = _mixed(actor.head, identity)
    balls = actor.head.part_vertices("eyeballs")
    eyes = {
        side: eye + moves[balls[sign * actor.head.vertices[balls, 0] > 0.0]].mean(axis=0)
        for (side, sign), eye in zip(SIDES.items(), actor.anatomy.eyes.values(), strict=True)
    }
    return replace(
        actor,
        rest=actor.rest + moves[actor.kept],
        shapes={name: shape + moves[actor.kept] for name, shape in actor.shapes.items()},
        anatomy=replace(actor.anatomy, eyes=eyes),
    )
