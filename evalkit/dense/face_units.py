"""Units of a head that brings its own named shapes, such as MakeHuman's 52 face units or ICT-FaceKit's expressions.

Shapes are known by the names of ARKit's blendshapes, with the side as ``_L`` or ``Left`` at the end.
"""

from __future__ import annotations

import numpy as np

from evalkit.dense.face import Face, Turn
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import Head
from evalkit.synthetic.expression import side_strength

MIXTURES: dict[str, dict[str, float]] = {
    "brow_up": {"browInnerUp": 0.9, "browOuterUp": 1.0},
    "brow_down": {"browDown": 1.0, "eyeSquint": 0.2},
    "lid_down": {"eyeBlink": 1.0},
    "smile": {"mouthSmile": 1.0, "cheekSquint": 0.6, "mouthDimple": 0.15},
    "pucker": {"mouthPucker": 0.8, "mouthFunnel": 0.3},
    "lip_stretch": {"mouthStretch": 0.8, "mouthDimple": 0.3},
    "upper_lip_up": {"mouthUpperUp": 0.8, "noseSneer": 0.3},
    "lower_lip_down": {"mouthLowerDown": 0.8, "mouthShrugLower": 0.1},
}
"""Unit of :data:`evalkit.synthetic.expression.UNITS` -> shapes that make it. The jaw is ``jawOpen`` on its axis."""

SIDES = {"left": ("_L", "Left"), "right": ("_R", "Right")}


def unit_face(head: Head) -> Face:
    """A head with units mixed from its own shapes; its jaw turns about its axis.

    Parameters
    ----------
    head : Head
        With blendshapes and a jaw.

    Returns
    -------
    Face

    Raises
    ------
    EvalkitError
        If it has no jaw, or none of the shapes of a unit.
    """
    if head.jaw is None or "jawOpen" not in head.blendshapes:
        raise EvalkitError(f"{head.name}: it has no jaw axis or no shape 'jawOpen'; its units cannot be made")
    fields = {}
    for unit, shapes in MIXTURES.items():
        for side in SIDES:
            parts = [amount * moves for shape, amount in shapes.items() for moves in _of_side(head, shape, side)]
            if not parts:
                raise EvalkitError(f"{head.name}: it has no shape of {', '.join(shapes)}; unit {unit} cannot be made")
            fields[f"{unit} {side}"] = np.sum(parts, axis=0)
    for unit in ("pucker", "lid_down"):  # these have no side in a performance
        fields[unit] = fields.pop(f"{unit} left") + fields.pop(f"{unit} right")
    opened = head.vertices + _moves(head, "jawOpen")
    return Face(head, fields, {"jaw": Turn.through(head.vertices, opened, head.jaw.axis)})


def _of_side(head: Head, shape: str, side: str) -> list[Array]:
    """Displacements (V, 3) of a shape on one side: its own shape of that side, or that side's part of a whole one."""
    own = [_moves(head, shape + ending) for ending in SIDES[side] if shape + ending in head.blendshapes]
    if own or shape not in head.blendshapes:
        return own
    share = side_strength(head.vertices, 1.0 if side == "left" else -1.0)
    return [share[:, None] * _moves(head, shape)]


def _moves(head: Head, shape: str) -> Array:
    which, moves = head.blendshapes[shape]
    out = np.zeros_like(head.vertices)
    out[which] = moves
    return out
