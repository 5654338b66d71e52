"""Characters with truth: rough shapes of many expressions, and beside each what a sculptor made of it.

Methods that give a character its own expressions [1]_ are judged on these. The rough shapes are the head's own
hand-made shapes or its muscles; the fine ones come from :mod:`evalkit.dense.sculptor`, whose rules are no mapping of
triangles and no blend of examples. Only the front of the head is kept, as in the paper: skin with lids and lining of
the mouth as the head has them, one connected component, without teeth and eyeballs.

References
----------
.. [1] T. Kato, S. Saito, M. Kawai, T. Iwao, A. Maejima, S. Morishima, "Character Transfer: Example-based individuality
   retargeting for facial animations", WSCG 2014.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from evalkit.dense.anatomy import SIDES, Anatomy, anatomy_of, front_of, hand_drawn_regions, scored_regions
from evalkit.dense.face import Face, Turn
from evalkit.dense.muscles import muscle_face
from evalkit.dense.muzzle import carried, muzzle_warp
from evalkit.dense.sculptor import HUMAN, MUZZLE, Manner, drawn_manner, sculpt
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import Head, load_head
from evalkit.head.ict import read_ict
from evalkit.head.model import Indices
from evalkit.seeds import generator


@dataclass(frozen=True, eq=False)
class Character:
    """A face, rough shapes of its expressions, and the sculptor's truth.

    Attributes
    ----------
    name : str
    rest : ndarray, shape (V, 3), mm
        One connected component.
    triangles : ndarray of int, shape (T, 3)
    names : tuple of str
        Of the N expressions.
    rough, fine : ndarray, shape (N, V, 3), mm
        Positions.
    regions : dict of str to ndarray of int
        Vertices of ``lips``, ``lids``, ``brows``, ``cheeks`` and ``nose`` to tell errors apart; they do not cover all.
    hand_drawn : dict of str to ndarray of int
        A partition of the vertices as a user would draw it.
    eye_distance_mm : float
        Between the inner corners of the eyes; 50 cm in the paper.
    training, unlike : tuple of str
        Four expressions to learn from, as many as in the paper, and those that none of the four is like (its Fig. 8).
    """

    name: str
    rest: Array
    triangles: Indices
    names: tuple[str, ...]
    rough: Array
    fine: Array
    regions: dict[str, Indices]
    hand_drawn: dict[str, Indices]
    eye_distance_mm: float
    training: tuple[str, ...]
    unlike: tuple[str, ...]

    def rows(self, names: tuple[str, ...]) -> Indices:
        """Numbers of expressions.

        Raises
        ------
        EvalkitError
            If there is no such expression.
        """
        for name in names:
            if name not in self.names:
                raise EvalkitError(f"character {self.name}: no expression '{name}'; it has {', '.join(self.names)}")
        return np.array([self.names.index(name) for name in names], dtype=np.intp)


class Movement(NamedTuple):
    """A random facial movement.

    Attributes
    ----------
    names : tuple of str
        The expressions that take part.
    weights : ndarray, shape (F, len(names))
        0 to 1; a frame is ``rest + sum of weight times (shape - rest)``.
    """

    names: tuple[str, ...]
    weights: Array


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

Transfer = Callable[[Array, Indices, Array, Array], Array]
"""A method that makes rough shapes: rest (V, 3), triangles and shapes (N, V, 3) of one face and the rest of another, to
the shapes (N, V, 3) of that one."""


@dataclass(frozen=True, eq=False)
class _Actor:
    """A face with its rough shapes, before a sculptor has seen it."""

    head: Head
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
        return np.stack(list(self.shapes.values()))


def template_character(style: float = 1.0) -> Character:
    """The built-in head with muscles."""
    return _sculpted("template", _muscle_actor(), HUMAN, style)


def makehuman_character(style: float = 1.0) -> Character:
    """MakeHuman's head with its face units."""
    return _sculpted("makehuman", _makehuman_actor(), HUMAN, style)


def makehuman_identity(style: float = 1.0, person: int = 0) -> Character:
    """A person drawn from MakeHuman's identity targets, and a sculptor of their own."""
    name = f"makehuman identity {person}"
    return _sculpted(name, _as_person(_makehuman_actor(), _targets(person)), drawn_manner(name), style)


def ict_character(style: float = 1.0) -> Character:
    """ICT-FaceKit's head with its expressions, from the folder that EVALKIT_REAL_DATA names."""
    return _sculpted("ict", _ict_actor(), HUMAN, style)


def ict_identity(style: float = 1.0, person: int = 0) -> Character:
    """A person drawn from ICT-FaceKit's identity modes as that model defines them, and a sculptor of their own."""
    name = f"ict identity {person}"
    actor = _ict_actor()
    modes = [shape for shape in actor.head.blendshapes if shape.startswith("identity")]
    amounts = generator(name).standard_normal(len(modes))
    person_of = dict(zip(modes, map(float, amounts), strict=True))
    return _sculpted(name, _as_person(actor, person_of), drawn_manner(name), style)


def muzzle_character(style: float = 1.0, base: str = "template", transfer: Transfer | None = None) -> Character:
    """A face of very different proportions, as the monkey in the paper.

    Parameters
    ----------
    style : float
    base : str
        The person who is bent: ``template`` or ``makehuman``.
    transfer : callable, optional
        Makes the rough shapes from the person's. By default the person's shapes are carried over by the warp itself,
        from which the sculptor starts in any case: the truth does not depend on this.
    """
    actor = _muscle_actor() if base == "template" else _makehuman_actor()
    human = actor.anatomy
    lower, upper = human.contact
    warp = muzzle_warp(actor.head, 0.5 * (actor.rest[lower] + actor.rest[upper]).mean(axis=0) * [0.0, 1.0, 1.0])
    bent = replace(human, eyes={side: warp(eye[None])[0] for side, eye in human.eyes.items()})
    shapes = carried(actor.rest, actor.rough, human, warp, bent)
    there = replace(actor, rest=warp(actor.rest), anatomy=bent, shapes=dict(zip(actor.shapes, shapes, strict=True)))
    name = "muzzle" if base == "template" else f"{base} muzzle"
    found = _sculpted(name, there, MUZZLE, style)
    if transfer is None:
        return found
    return replace(found, rough=transfer(actor.rest, actor.triangles, actor.rough, there.rest))


def linear_character(style: float = 1.0) -> Character:
    """A control: every vertex goes ``(1 + style A) d`` where the rough one goes d, with a fixed matrix A of the place.

    Differences of positions are then linear in the strengths of the expressions, so that whatever blends them by region
    wins by construction.
    """
    actor = _muscle_actor()
    change = np.zeros((len(actor.rest), 3, 3))
    for part, matrix in LINEAR.items():
        change += actor.anatomy.weights[part][:, None, None] * np.array(matrix)
    fine = actor.rough + style * np.einsum("vij,nvj->nvi", change, actor.rough - actor.rest)
    return _character("linear", actor, fine)


LINEAR = {
    "mouth": ((0.25, 0.0, 0.0), (0.0, -0.15, 0.0), (0.0, 0.10, 0.2)),
    "corner left": ((0.1, 0.2, 0.0), (0.1, 0.3, 0.0), (0.0, 0.0, 0.1)),
    "corner right": ((-0.1, 0.0, 0.0), (0.1, -0.2, 0.0), (0.0, 0.0, 0.0)),
    "brow left": ((0.0, 0.2, 0.0), (0.0, 0.4, 0.0), (0.0, 0.0, 0.2)),
    "brow right": ((0.0, 0.1, 0.0), (0.0, -0.3, 0.0), (0.0, 0.0, 0.1)),
    "eye left": ((0.0, 0.0, 0.0), (0.0, -0.2, 0.0), (0.0, 0.1, 0.0)),
    "eye right": ((0.0, 0.0, 0.0), (0.0, -0.1, 0.0), (0.0, 0.1, 0.0)),
}
"""Soft part -> what it adds to the way of its skin, per mm, in the linear control."""

CHARACTERS: dict[str, Callable[..., Character]] = {
    "template": template_character,
    "makehuman": makehuman_character,
    "makehuman identity": makehuman_identity,
    "ict": ict_character,
    "ict identity": ict_identity,
    "muzzle": muzzle_character,
    "makehuman muzzle": lambda style=1.0: muzzle_character(style, "makehuman"),
    "linear": linear_character,
}
"""Name -> how it is made; identities take the number of a person."""


@lru_cache(maxsize=4)
def character(name: str, style: float = 1.0) -> Character:
    """A character by name.

    Parameters
    ----------
    name : str
        One of :data:`CHARACTERS`; after ``identity`` the number of a person, from 0.
    style : float
        Strength of the individuality: with 0 the fine shapes are the rough ones.

    Returns
    -------
    Character

    Raises
    ------
    EvalkitError
        If there is no such character, or its head is not on this machine.

    Examples
    --------
    >>> from evalkit.dense import character
    >>> one = character("template")
    >>> one.fine.shape == one.rough.shape, len(one.names)
    (True, 30)
    """
    kind, _, number = name.rpartition(" ")
    if kind.endswith("identity") and kind in CHARACTERS and number.isdigit():
        return CHARACTERS[kind](style, int(number))
    if name not in CHARACTERS or name.endswith("identity"):
        known = ", ".join(f"{one} N" if one.endswith("identity") else one for one in CHARACTERS)
        raise EvalkitError(f"no character '{name}'; there are {known}")
    return CHARACTERS[name](style)


def animation(one: Character, frames: int = 270, shapes: int = 14, seed: int = 0) -> Movement:
    """Random facial movement: expressions that come and go, about three at a time.

    Parameters
    ----------
    one : Character
    frames, shapes : int
        As in the paper by default.
    seed : int

    Returns
    -------
    Movement

    Raises
    ------
    EvalkitError
        If the character has fewer expressions.
    """
    if not 1 <= shapes <= len(one.names):
        raise EvalkitError(f"character {one.name}: {shapes} expressions asked for, it has {len(one.names)}")
    random = generator("facial movement", one.name, shapes, seed=seed)
    chosen = np.sort(random.choice(len(one.names), shapes, replace=False))
    time = np.arange(frames)[:, None]
    # Each expression comes at random times, a fifth of all the time: of 14, about three at once.
    weights = np.zeros((frames, shapes))
    for _ in range(max(1, round(0.2 * frames / PULSE_FRAMES))):
        middle = random.uniform(0.0, frames, shapes)
        half = PULSE_FRAMES * random.uniform(0.6, 1.4, shapes)
        top = random.uniform(0.4, 1.0, shapes)
        weights = np.maximum(weights, top * np.cos(0.5 * np.pi * np.clip((time - middle) / half, -1.0, 1.0)) ** 2)
    return Movement(tuple(one.names[k] for k in chosen), weights)


PULSE_FRAMES = 27
"""From nothing to the top of an expression, or back: about a second."""


def shared_names(ict: Head, makehuman: Head) -> dict[str, tuple[str, ...]]:
    """Expressions that both ICT-FaceKit and MakeHuman have by hand.

    Parameters
    ----------
    ict, makehuman : Head

    Returns
    -------
    dict
        MakeHuman's name -> the shapes of ICT-FaceKit whose sum it is: one, or two where MakeHuman has both sides in
        one. 51 for the heads as they are published.
    """
    found: dict[str, tuple[str, ...]] = {}
    for name in makehuman.blendshapes:
        if name.startswith("identity/"):
            continue
        one = name
        for ending, mark in (("Left", "_L"), ("Right", "_R")):
            # jawLeft and mouthLeft are ways, not sides, and ICT-FaceKit writes them the same.
            if name.endswith(ending) and name not in ict.blendshapes:
                one = name.removesuffix(ending) + mark
        parts = (one,) if one in ict.blendshapes else (f"{one}_L", f"{one}_R")
        if all(part in ict.blendshapes for part in parts):
            found[name] = parts
    return found


def _sculpted(name: str, actor: _Actor, manner: Manner, style: float) -> Character:
    return _character(name, actor, sculpt(actor.rest, actor.rough, actor.anatomy, manner, style))


def _character(name: str, actor: _Actor, fine: Array) -> Character:
    inner = [actor.anatomy.places[f"eye inner {side}"] for side in SIDES]
    return Character(
        name=name,
        rest=actor.rest,
        triangles=actor.triangles,
        names=tuple(actor.shapes),
        rough=actor.rough,
        fine=fine,
        regions=actor.regions,
        hand_drawn=actor.hand_drawn,
        eye_distance_mm=float(np.linalg.norm(actor.rest[inner[0]] - actor.rest[inner[1]])),
        training=actor.training,
        unlike=actor.unlike,
    )


@lru_cache(maxsize=1)
def _muscle_actor() -> _Actor:
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
def _makehuman_actor() -> _Actor:
    return _shape_actor(load_head("makehuman"))


@lru_cache(maxsize=1)
def _ict_actor() -> _Actor:
    folder = os.environ.get("EVALKIT_REAL_DATA")
    if not folder:
        raise EvalkitError("character ict: set EVALKIT_REAL_DATA to the folder that holds " + "/".join(ICT_FILE))
    return _shape_actor(read_ict(Path(folder, *ICT_FILE)))


def _shape_actor(head: Head) -> _Actor:
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
) -> _Actor:
    front = front_of(head)
    anatomy = anatomy_of(head, front, opened[front.kept], closed[front.kept])
    return _Actor(
        head=head,
        rest=front.rest,
        triangles=front.triangles,
        shapes={name: shape[front.kept] for name, shape in shapes.items()},
        anatomy=anatomy,
        regions=scored_regions(head, front, anatomy),
        hand_drawn=hand_drawn_regions(head, front, anatomy),
        training=training,
        unlike=unlike,
    )


def _targets(person: int) -> dict[str, float]:
    """Amounts of MakeHuman's identity targets; those of one side go together with the other side's."""
    head = _makehuman_actor().head
    pool = [
        name
        for name in head.blendshapes
        if name.startswith("identity/") and "/r-" not in name and name.split("/")[1] not in ("ears", "neck")
    ]
    random = generator("makehuman identity", person)
    chosen = random.choice(len(pool), IDENTITY_TARGETS, replace=False)
    amounts = {pool[k]: float(random.uniform(0.0, IDENTITY_SPREAD)) for k in chosen}
    return amounts | {name.replace("/l-", "/r-"): amount for name, amount in amounts.items()}


def _as_person(actor: _Actor, identity: Mapping[str, float]) -> _Actor:
    """The same expressions on another person: the identity is added to all shapes, and moves the eyes."""
    moves = _mixed(actor.head, identity)
    kept = front_of(actor.head).kept
    balls = actor.head.part_vertices("eyeballs")
    eyes = {
        side: eye + moves[balls[sign * actor.head.vertices[balls, 0] > 0.0]].mean(axis=0)
        for (side, sign), eye in zip(SIDES.items(), actor.anatomy.eyes.values(), strict=True)
    }
    return replace(
        actor,
        rest=actor.rest + moves[kept],
        shapes={name: shape + moves[kept] for name, shape in actor.shapes.items()},
        anatomy=replace(actor.anatomy, eyes=eyes),
    )
