"""Characters of a formula for the tests of Character Transfer: rough and fine examples, and new rough shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from contracts.faces import face
from scipy.spatial.transform import Rotation


@dataclass(frozen=True, eq=False)
class Sculpts:
    """What :func:`~evalkit.transfer.character.transfer_character` takes."""

    rest: np.ndarray
    triangles: np.ndarray
    rough: np.ndarray
    fine: np.ndarray
    new: np.ndarray

    @property
    def examples(self):
        return self.rest, self.rough, self.fine, self.triangles

    @property
    def size(self):
        return float(np.linalg.norm(np.ptp(self.rest, axis=0)))

    def mapped(self, function):
        """With a function of positions applied to everything."""
        shapes = (np.array([function(s) for s in block]) for block in (self.rough, self.fine, self.new))
        return Sculpts(function(self.rest), self.triangles, *shapes)


def patch(columns=9, rows=8):
    """A bent, uneven patch of so many vertices, mm; no symmetry, so that nothing is a tie."""
    x, y = np.meshgrid(np.linspace(-40.0, 40.0, columns), np.linspace(-35.0, 35.0, rows))
    x, y = x + 2.0 * np.sin(0.13 * y + 0.4), y + 1.5 * np.cos(0.11 * x)
    z = 20.0 - 0.006 * x**2 - 0.004 * y**2 + 3.0 * np.sin(0.09 * x + 0.05 * y)
    index = np.arange(columns * rows).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]))
    triangles = np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), triangles


def uneven_face(columns=17, rows=23):
    """The face of a formula without its mirror symmetry."""
    head = face(columns, rows)
    v = head.vertices
    bent = v + np.stack([2.0 * np.sin(0.02 * v[:, 1] + 1.0), 1.5 * np.cos(0.03 * v[:, 0]), 0.02 * v[:, 0]], axis=1)
    return bent, head.triangles


def push(vertices, centre, width, by):
    """Displacements that fall off from a centre, zero beyond three widths."""
    away = np.linalg.norm(vertices - centre, axis=1) / width
    return (np.exp(-(away**2)) * (away < 3.0))[:, None] * np.asarray(by, dtype=float)


def roll(vertices, centre, width, turn):
    """Displacements of a rotation (rotation vector, rad) about a centre whose angle falls off."""
    away = np.linalg.norm(vertices - centre, axis=1) / width
    share = np.exp(-(away**2)) * (away < 3.0)
    return Rotation.from_rotvec(share[:, None] * turn).apply(vertices - centre) + centre - vertices


def sculpts(mesh=None, examples=3, new=2, seed=0, turn_deg=25.0):
    """Rough shapes push; fine ones push elsewhere, too, and roll. Two sides of the mesh stay still."""
    rest, triangles = uneven_face() if mesh is None else mesh
    rng = np.random.default_rng(seed)
    low, span = rest.min(axis=0), np.ptp(rest, axis=0)
    # Three widths from here to the nearest edge of the mesh, nearly.
    inside = rest[np.all(np.abs(rest - low - 0.5 * span)[:, :2] < 0.25 * span[:2], axis=1)]
    width = 0.12 * span[:2].min()

    def rough_one():
        centre = inside[rng.integers(len(inside))]
        shape = rest + push(rest, centre, 1.5 * width, rng.normal(0.0, 0.35 * width, 3))
        return shape + push(rest, inside[rng.integers(len(inside))], 1.5 * width, rng.normal(0.0, 0.2 * width, 3))

    rough = np.array([rough_one() for _ in range(examples)])
    fine = []
    for shape in rough:
        centre, axis = inside[rng.integers(len(inside))], rng.normal(size=3)
        turn = np.radians(turn_deg) * axis / np.linalg.norm(axis)
        moved = roll(rest, centre, width, turn) + push(rest, centre, width, rng.normal(0.0, 0.2 * width, 3))
        fine.append(shape + moved)
    # New shapes are of what the examples show, in other shares, and of a little that they do not.
    shares = rng.uniform(-0.2, 0.8, (new, examples))
    other = np.array([rough_one() - rest for _ in range(new)])
    mixed = rest + np.einsum("nm,mvi->nvi", shares, rough - rest) + 0.1 * other
    shapes = np.concatenate([rough, fine, mixed])
    # What hardly moves does not move at all: still vertices are still everywhere.
    still = np.linalg.norm(shapes - rest, axis=2).max(axis=0) < 3e-4 * np.linalg.norm(span)
    shapes[:, still] = rest[still]
    return Sculpts(rest, triangles, *np.split(shapes, [examples, 2 * examples]))
