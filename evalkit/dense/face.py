"""A face that acts: how far every vertex goes for given strengths of its units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import Head
from evalkit.head.model import Indices


@dataclass(frozen=True, eq=False)
class Turn:
    """Vertices that turn about axes parallel to x: the jaw about its hinge, lids about the eyeballs.

    At strength a, a vertex goes to ``c + R(a angle) (v - c + a shift)``: on an arc, where a linear unit would cut the
    corner.

    Attributes
    ----------
    which : ndarray of int, shape (N,)
    centre : ndarray, shape (N, 3), mm
        A point of each one's axis.
    angle : ndarray, shape (N,), rad
        At full strength; positive lowers what lies in front.
    shift : ndarray, shape (N, 3), mm
        At full strength, before the turn.
    """

    which: Indices
    centre: Array
    angle: Array
    shift: Array

    @classmethod
    def through(cls, rest: Array, goal: Array, axis: Array, nearest_mm: float = 20.0) -> Turn:
        """The turn about an axis through a point that takes vertices from rest to a goal (V, 3) at full strength.

        Vertices nearer to the axis than ``nearest_mm`` go straight: their angle is not well defined.
        """
        which = np.flatnonzero((goal != rest).any(axis=1))
        centre = np.broadcast_to(np.asarray(axis, dtype=np.float64), (len(which), 3))
        before, after = rest[which] - centre, goal[which] - centre
        angle = np.arctan2(after[:, 2], after[:, 1]) - np.arctan2(before[:, 2], before[:, 1])
        angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
        angle[np.linalg.norm(before[:, 1:], axis=1) < nearest_mm] = 0.0
        return cls(which, centre, angle, about_x(after, -angle) - before)

    def apply(self, vertices: Array, strength: Array) -> None:
        """Turn the vertices (f, V, 3) of frames in place by their strengths (f,)."""
        amount = strength[:, None]
        arm = vertices[:, self.which] - self.centre + amount[..., None] * self.shift
        vertices[:, self.which] = self.centre + about_x(arm, amount * self.angle)

    def among(self, chosen: Indices) -> Turn:
        """The same turn for a choice of vertices, which get new numbers."""
        row = {int(vertex): k for k, vertex in enumerate(self.which)}
        pairs = [(new, row[int(old)]) for new, old in enumerate(chosen) if int(old) in row]
        new, rows = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
        return Turn(new, self.centre[rows], self.angle[rows], self.shift[rows])


def about_x(arms: Array, angle: Array) -> Array:
    """Arms (..., 3) turned about the x axis by angles (...), rad."""
    cos, sin = np.cos(angle), np.sin(angle)
    y, z = arms[..., 1], arms[..., 2]
    return np.stack([arms[..., 0], cos * y - sin * z, sin * y + cos * z], axis=-1)


@dataclass(frozen=True, eq=False)
class Face:
    """A head with units that move it.

    A unit is named as in :data:`evalkit.synthetic.expression.UNITS`; one that has two sides is two units, with
    `` left`` and `` right`` at the end. Fields add up; then the turns follow in their order, and carry along what the
    fields have moved.

    Attributes
    ----------
    head : Head
    fields : dict of str to ndarray, shape (V, 3)
        Displacement at full strength, mm.
    turns : dict of str to Turn
    """

    head: Head
    fields: dict[str, Array]
    turns: dict[str, Turn]

    @property
    def units(self) -> tuple[str, ...]:
        """Names of all units."""
        return (*self.fields, *self.turns)

    def positions(self, strengths: Mapping[str, Array], which: Indices | None = None) -> Array:
        """Vertices of frames.

        Parameters
        ----------
        strengths : mapping of str to ndarray, shape (f,)
            Unit to its strength, 1 at full; units that are left out rest.
        which : ndarray of int, shape (n,), optional
            These vertices only; by default all.

        Returns
        -------
        ndarray, shape (f, V or n, 3), mm

        Raises
        ------
        EvalkitError
            If the face has no such unit.
        """
        for unit in strengths:
            if unit not in self.fields and unit not in self.turns:
                raise EvalkitError(f"the face has no unit '{unit}'; it has {', '.join(self.units)}")
        chosen = slice(None) if which is None else np.asarray(which)
        rest = self.head.vertices[chosen]
        frames = len(next(iter(strengths.values()))) if strengths else 1
        out = np.repeat(rest[None], frames, axis=0)
        moved = [unit for unit in self.fields if unit in strengths]
        if moved:
            amounts = np.column_stack([strengths[unit] for unit in moved])
            basis = np.stack([self.fields[unit][chosen].ravel() for unit in moved])
            out += (amounts @ basis).reshape(out.shape)
        for unit, turn in self.turns.items():
            if unit in strengths:
                (turn if which is None else turn.among(np.asarray(which))).apply(out, np.asarray(strengths[unit]))
        return out
