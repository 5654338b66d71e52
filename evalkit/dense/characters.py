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

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from evalkit.dense.actors import Actor, as_person, ict_actor, makehuman_actor, modes_of, muscle_actor, targets_of
from evalkit.dense.anatomy import SIDES
from evalkit.dense.muzzle import carried, muzzle_warp
from evalkit.dense.sculptor import HUMAN, MUZZLE, Manner, drawn_manner, sculpt
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import Head
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

PULSE_FRAMES = 27
"""From nothing to the top of an expression, or back: about a second."""

Transfer = Callable[[Array, Indices, Array, Array], Array]
"""A method that makes rough shapes: rest (V, 3), triangles and shapes (N, V, 3) of one face and the rest of another, to
the shapes (N, V, 3) of that one."""


def template_character(style: float = 1.0) -> Character:
    """The built-in head with muscles."""
    return _sculpted("template", muscle_actor(), HUMAN, style)


def makehuman_character(style: float = 1.0) -> Character:
    """MakeHuman's head with its face units."""
    return _sculpted("makehuman", makehuman_actor(), HUMAN, style)


def makehuman_identity(style: float = 1.0, person: int = 0) -> Character:
    """A person drawn from MakeHuman's identity targets, and a sculptor of their own."""
    name = f"makehuman identity {person}"
    return _sculpted(name, as_person(makehuman_actor(), targets_of(person)), drawn_manner(name), style)


def ict_character(style: float = 1.0) -> Character:
    """ICT-FaceKit's head with its expressions, from the folder that EVALKIT_REAL_DATA names."""
    return _sculpted("ict", ict_actor(), HUMAN, style)


def ict_identity(style: float = 1.0, person: int = 0) -> Character:
    """A person drawn from ICT-FaceKit's identity modes as that model defines them, and a sculptor of their own."""
    name = f"ict identity {person}"
    return _sculpted(name, as_person(ict_actor(), modes_of(person)), drawn_manner(name), style)


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
    actor = muscle_actor() if base == "template" else makehuman_actor()
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
    actor = muscle_actor()
    change = np.zeros((len(actor.rest), 3, 3))
    for part, matrix in LINEAR.items():
        change += actor.anatomy.weights[part][:, None, None] * np.array(matrix)
    fine = actor.rough + style * np.einsum("vij,nvj->nvi", change, actor.rough - actor.rest)
    return _character("linear", actor, fine)


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


def _sculpted(name: str, actor: Actor, manner: Manner, style: float) -> Character:
    return _character(name, actor, sculpt(actor.rest, actor.rough, actor.anatomy, manner, style))


def _character(name: str, actor: Actor, fine: Array) -> Character:
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
