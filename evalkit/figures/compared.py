"""A sheet of expressions: the sculpt, and what methods make of rough shapes, in the colour of the error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evalkit.figures.faces import (
    ERROR_MAP,
    Face,
    drawn,
    front,
    paper_like,
    rest_of,
    rest_rows,
    seen_triangles,
    shaded,
    vertex_rows,
)
from evalkit.figures.files import raster
from evalkit.figures.scenes import XYZ, local_triangles
from evalkit.figures.style import PAGE_IN
from evalkit.figures.table import Table
from evalkit.geometry import Array

if TYPE_CHECKING:
    import pandas as pd

SCULPT = "sculpt"
METHODS = {
    "rough": "Deformation Transfer",
    "character transfer": "Character Transfer",
    "local regression": "local regression (ours)",
}
LIMIT_CM = 5.0
"""End of the colours, as in the paper."""

EYES_CM = 50.0
"""Distance of the inner corners of the eyes."""


DPI = 160
"""Of the picture: shaded faces in full colour take many bytes."""


def columns(expressions: Sequence[str]) -> tuple[str, ...]:
    """Of the CSV: rows are a vertex that is seen, an eyeball, or the error of one method in one expression.

    Of a vertex there are its place at rest, how the sculptor moves it, and how far off from there the methods have it.
    """
    return (
        "number", *XYZ, "radius_mm", "expression", "method", "rms_cm", "eye_distance_mm",
        *(f"{one} {shape} {axis}" for one in expressions for shape in (SCULPT, *METHODS) for axis in XYZ),
    )  # fmt: skip


def rows_of(expressions: Sequence[str]) -> list[dict[str, Any]]:
    """Measure: errors of all vertices, and places to a tenth of a mm, with nothing in place of a zero."""
    from evalkit.transfer.methods import methods

    task = paper_like()
    one, which = task.one, task.one.rows(tuple(expressions))
    off = {method: methods[method](task.examples, one.rough[which]) - one.fine[which] for method in METHODS}
    moved = {shape: np.round(moves, 1) for shape, moves in {SCULPT: one.fine[which] - one.rest, **off}.items()}
    rows: list[dict[str, Any]] = rest_rows(one.rest, np.unique(seen_triangles(one.rest)))
    for row in rows:
        for k, name in enumerate(expressions):
            for shape, moves in moved.items():
                for axis, column in enumerate(XYZ):
                    here = float(moves[k, row["number"], axis]) if "radius_mm" not in row else 0.0
                    row[f"{name} {shape} {column}"] = here or None
    eyes = one.eye_distance_mm
    return rows + [
        {"expression": name, "method": method, "eye_distance_mm": round(eyes, 3),
         "rms_cm": round(EYES_CM / eyes * float(np.sqrt((found[k] ** 2).sum(axis=1).mean())), 4)}
        for method, found in off.items()
        for k, name in enumerate(expressions)
    ]  # fmt: skip


def _moves(rows: pd.DataFrame, expression: str, shape: str) -> Array:
    found = vertex_rows(rows)[[f"{expression} {shape} {axis}" for axis in XYZ]].fillna(0.0)
    return found.to_numpy(dtype=float)


def sheet(table: Table, expressions: Sequence[str]) -> NDArray[np.uint8]:
    """The picture: a row for each expression."""
    from matplotlib.figure import Figure

    rows = table.rows
    vertices, rest, eyes = rest_of(rows)
    triangles = local_triangles(front().triangles, vertices)
    errors = rows.dropna(subset=["rms_cm"])
    rms = {(name, method): value for name, method, value in errors[["expression", "method", "rms_cm"]].to_numpy()}
    to_cm = EYES_CM / float(errors["eye_distance_mm"].iloc[0])
    faces, titles = [], []
    for name in expressions:
        sculpt = rest + _moves(rows, name, SCULPT)
        faces.append(Face(sculpt, triangles, eyes, shaded(vertices, None)))
        titles.append("")
        for method in METHODS:
            off = _moves(rows, name, method)
            cm = to_cm * np.linalg.norm(off, axis=1)
            faces.append(Face(sculpt + off, triangles, eyes, shaded(vertices, cm / LIMIT_CM)))
            titles.append(f"{rms[name, method]:.2f} cm rms ({rms[name, method] / EYES_CM:.4f})")
    count = 1 + len(METHODS)
    pictures = drawn(faces, count)
    made = Figure(figsize=(PAGE_IN, 0.55 + 1.95 * len(expressions)))
    height = float(made.get_figheight())
    made.subplots_adjust(0.02, 0.2 / height, 0.875, 1.0 - 0.3 / height, wspace=0.0, hspace=0.1)
    grid = made.subplots(len(expressions), count, squeeze=False)
    for axes, picture, title in zip(grid.ravel(), pictures, titles, strict=True):
        axes.imshow(picture)
        axes.set_axis_off()
        axes.text(0.5, -0.01, title, transform=axes.transAxes, ha="center", va="top", fontsize=7)
    for axes, name in zip(grid[0], ("sculpt", *METHODS.values()), strict=True):
        axes.set_title(name, loc="center", fontsize=8)
    for axes, name in zip(grid[:, 0], expressions, strict=True):
        axes.text(0.0, 0.5, name, transform=axes.transAxes, rotation=90, ha="center", va="center", fontsize=8)
    colour_bar(made, (0.895, 0.16, 0.012, 0.6))
    return raster(made, DPI)


def colour_bar(made: Any, place: tuple[float, float, float, float], limit_cm: float = LIMIT_CM) -> None:
    """What colours of errors mean, in cm at 50 cm between the eyes and, at its left, as share of that distance."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    colours = ScalarMappable(Normalize(0.0, limit_cm), ERROR_MAP)
    bar = made.colorbar(colours, cax=made.add_axes(place), extend="max")
    ticks = np.linspace(0.0, limit_cm, 6)
    bar.set_ticks(ticks, labels=[f"{tick:g}\n[{tick / EYES_CM:g}]" for tick in ticks], fontsize=6)
    words = f"distance from\nthe sculpt, cm\n({EYES_CM:g} cm between\nthe eyes)\n[share of it]"
    bar.ax.set_title(words, fontsize=6, loc="left", pad=12)
