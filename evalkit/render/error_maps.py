"""Shapes side by side, and how far each vertex is from where a sculptor has put it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evalkit.geometry import Array
from evalkit.head.model import Indices
from evalkit.render.face_maps import COLOUR_MAP, Camera, add_skin
from evalkit.render.offscreen import offscreen_plotter

Image = NDArray[np.uint8]

TILE = 300
"""Pixels of one picture."""

FONT = TILE // 20
MARGIN = 2 * FONT
"""Height of a line of words."""

HALF_MM = 100.0
"""Half the height of what is seen: meshes in any unit are scaled to it, since the camera's distances are in mm."""

ROOM = 1.1
"""About what moves."""

MOVES = 0.05
"""Vertices that move by this share of the furthest are what is looked at."""

YAW_DEG = 15.0
"""The camera stands to the left of the face, where its depth can be seen."""

MOST_ROWS = 8
"""Shapes on one sheet."""

SCALE_PERCENTILE = 99.0
"""Of the errors of the rough shapes, at the end of the colour bar: a few vertices must not darken the rest."""

FRONTS = {"y": np.eye(3), "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])}
"""Turns a mesh whose this axis points up so that y is up and the face looks along z; with z up it looks along -y, as in
Blender."""


class Part(NamedTuple):
    """What of a mesh is looked at: the middle (3,) of what moves, and half of its size."""

    middle: Array
    half: float

    @classmethod
    def moving(cls, rest: Array, shapes: Array) -> Part:
        """What shapes (N, V, 3) move of a rest mesh (V, 3)."""
        reach = np.linalg.norm(shapes - rest, axis=2).max(axis=0)
        which = reach >= MOVES * reach.max()
        seen = np.concatenate([rest[which], shapes[:, which].reshape(-1, 3)])
        low, high = seen.min(axis=0), seen.max(axis=0)
        return cls((low + high) / 2.0, 0.5 * ROOM * float((high - low).max()))


class Column(NamedTuple):
    """Pictures one below the other.

    Attributes
    ----------
    title : str
    shapes : sequence of ndarray, shape (V, 3), or None
        None leaves a place empty.
    triangles : ndarray of int, shape (T, 3)
    part : Part
    errors : sequence of ndarray, shape (V,), or None, optional
        Distance of each vertex from where it belongs, for the colour.
    """

    title: str
    shapes: Sequence[Array | None]
    triangles: Indices
    part: Part
    errors: Sequence[Array | None] | None = None


def error_columns(
    rest: Array, rough: Array, results: Array, triangles: Indices, references: Sequence[Array | None]
) -> list[Column]:
    """Rough shapes, results and, where there are references, these and the errors of both.

    Parameters
    ----------
    rest : ndarray, shape (V, 3)
    rough, results : ndarray, shape (N, V, 3)
    triangles : ndarray of int, shape (T, 3)
    references : sequence of ndarray, shape (V, 3), or None
        Of each shape.
    """
    part = Part.moving(rest, np.concatenate([rough, results]))
    out = [Column("rough", [*rough], triangles, part), Column("result", [*results], triangles, part)]
    if all(goal is None for goal in references):
        return out
    off = [
        [
            None if goal is None else np.linalg.norm(one - goal, axis=1)
            for one, goal in zip(some, references, strict=True)
        ]
        for some in (rough, results)
    ]
    return [
        *out,
        Column("reference", references, triangles, part),
        Column("error of rough", references, triangles, part, off[0]),
        Column("error of result", references, triangles, part, off[1]),
    ]


def sheets(
    names: Sequence[str], columns: Sequence[Column], up: str = "y", drawn: Callable[[int], object] = lambda rows: None
) -> Iterator[Image]:
    """Pictures of shapes, one shape to a row, with a bar that says what colours mean.

    Parameters
    ----------
    names : sequence of str
        Of the rows.
    columns : sequence of Column
        The first that has errors decides the end of the colour bar.
    up : {"y", "z"}
        Which axis points up in the files.
    drawn : callable
        Called after every sheet with the number of its rows.

    Yields
    ------
    ndarray of uint8, shape (H, W, 3)
        One for every eight shapes.

    Raises
    ------
    EvalkitError
        If nothing can be drawn without a screen here.
    """
    coloured = [column.errors for column in columns if column.errors is not None]
    told = [values for values in coloured[0] if values is not None] if coloured else []
    worst = float(np.percentile(np.concatenate(told), SCALE_PERCENTILE)) if told else 0.0
    head = _words([column.title for column in columns])
    foot = [_bar(worst, len(columns))] if told else []
    for first in range(0, len(names), MOST_ROWS):
        rows = range(first, min(first + MOST_ROWS, len(names)))
        picture = _tiles(columns, rows, worst, up)
        titles = [(FONT // 2, FONT // 2 + TILE * k, "la", names[row]) for k, row in enumerate(rows)]
        yield np.concatenate([head, _written(picture, titles), *foot])
        drawn(len(rows))


def _tiles(columns: Sequence[Column], rows: Sequence[int], worst: float, up: str) -> Image:
    """All pictures of a sheet in one window: to open one takes longer than to draw it."""
    size, shape = (TILE * len(columns), TILE * len(rows)), (len(rows), len(columns))
    with offscreen_plotter(*size, shape=shape, border=False) as opened:
        plotter: Any = opened
        plotter.suppress_rendering = True
        for k, row in enumerate(rows):
            for n, column in enumerate(columns):
                plotter.subplot(k, n)
                plotter.set_background("white")
                if (places := column.shapes[row]) is None:
                    continue
                turned = HALF_MM / (column.part.half or 1.0) * (places - column.part.middle) @ FRONTS[up].T
                values = None if column.errors is None else column.errors[row]
                camera = Camera((0.0, 0.0, 0.0), HALF_MM, yaw_deg=YAW_DEG)
                add_skin(plotter, turned, column.triangles, values, camera, limits=(0.0, worst or 1.0))
        plotter.suppress_rendering = False
        plotter.render_window.SetMultiSamples(8)
        return np.asarray(plotter.screenshot(None, return_img=True))


def _words(titles: Sequence[str]) -> Image:
    blank = np.full((MARGIN, TILE * len(titles), 3), 255, dtype=np.uint8)
    return _written(blank, [(TILE * k + TILE // 2, MARGIN // 2, "mm", title) for k, title in enumerate(titles)])


def _bar(worst: float, columns: int) -> Image:
    """What the colours mean, below the last two columns."""
    from matplotlib import colormaps

    bar = np.full((2 * MARGIN, TILE * columns, 3), 255, dtype=np.uint8)
    left, right = TILE * (columns - 2), TILE * columns
    shades = colormaps[COLOUR_MAP](np.linspace(0.0, 1.0, right - left - 2 * FONT))[:, :3]
    bar[FONT // 2 : FONT // 2 + FONT, left + FONT : right - FONT] = np.rint(255.0 * shades)
    y = 2 * FONT
    ends = [(left + FONT, y, "la", "0"), (right - FONT, y, "ra", f"{worst:.3g} and more")]
    return _written(bar, [*ends, ((left + right) // 2, y, "ma", "distance, unit of the file")])


def _written(picture: Image, texts: Sequence[tuple[int, int, str, str]]) -> Image:
    """Words (x, y, anchor, text) in a picture."""
    from PIL import Image as Pillow
    from PIL import ImageDraw

    sheet = Pillow.fromarray(np.ascontiguousarray(picture))
    for x, y, anchor, text in texts:
        ImageDraw.Draw(sheet).text((x, y), text, fill="black", anchor=anchor, font_size=FONT)
    return np.asarray(sheet)
