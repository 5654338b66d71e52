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

STIFF = 0.85
"""Vertices that move by this part of the largest way belong to the jaw bone and not to skin that stretches after it."""

SIDES = {"left": ("_L", "Left"), "right": ("_R", "Right")}


def unit_face(head: Head) -> Face:
    """A head with units mixed from its own shapes; its jaw turns about its axis.

    Parameters
    ----------
    head : Head
        With blendshapes, ``jawOpen`` among them. A head whose jaw has no axis gets the one that this shape turns about.

    Returns
    -------
    Face

    Raises
    ------
    EvalkitError
        If it has no ``jawOpen``, or none of the shapes of a unit.
    """
    if "jawOpen" not in head.blendshapes:
        raise EvalkitError(f"{head.name}: it has no shape 'jawOpen'; its units cannot be made")
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
    axis = hinge(head.vertices, opened) if head.jaw is None else head.jaw.axis
    return Face(head, fields, {"jaw": Turn.through(head.vertices, opened, axis)})


def hinge(closed: Array, opened: Array) -> Array:
    """A point of the axis, parallel to x, about which the chin turns between two shapes, mm, shape (3,).

    The fixed point ``c = (I - R)^-1 (b - R a)`` of the planar rigid motion of what moves furthest, a and b its means;
    R by least squares (doi:10.1109/34.88573).

    Parameters
    ----------
    closed, opened : ndarray, shape (V, 3), mm
    """
    way = np.linalg.norm(opened - closed, axis=1)
    chin = way > STIFF * way.max()
    a, b = closed[chin, 1:], opened[chin, 1:]
    from_a, to_b = a - a.mean(axis=0), b - b.mean(axis=0)
    angle = np.arctan2((from_a[:, 0] * to_b[:, 1] - from_a[:, 1] * to_b[:, 0]).sum(), (from_a * to_b).sum())
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    centre = np.linalg.solve(np.eye(2) - turn, b.mean(axis=0) - turn @ a.mean(axis=0))
    return np.array([0.0, *centre])


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
