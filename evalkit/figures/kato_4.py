"""Linear blending against blending by rotation and stretch, as in Fig. 4 of Kato et al. (2014).

A cheek that one example twists by up to 90 degrees one way (a) and another the other way (b): both mappings at once,
coefficients 1, blended entry by entry (c) and by rotation and stretch (d). Red triangles are turned over, orange ones
have less than a tenth of their area. (e) Triangles of either kind over the coefficients of both examples.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.faces import SKIN, Face, areas, drawn, front
from evalkit.figures.files import raster
from evalkit.figures.scenes import XYZ, local_triangles
from evalkit.figures.style import PAGE_IN
from evalkit.figures.table import Table
from evalkit.geometry import Array
from evalkit.head.model import Indices
from evalkit.render.colours import BLUE, VERMILION

NAME = "kato-4"
BLENDS = {"linear": "linear", "rotation-stretch": "rotation and stretch"}
SHAPES = {"one way": "example", "other way": "example", **BLENDS}
COUNTS = ("turned", "collapsed")
COLUMNS = ("vertex", *(f"{shape} {axis}" for shape in SHAPES for axis in XYZ), "blend", "times", *COUNTS)
TIMES = tuple(np.round(np.arange(0.0, 2.01, 0.25), 2).tolist())
SHOWN = 1.0
COLLAPSED = 0.1
"""Share of its area at rest below which a triangle counts as collapsed."""

SPOT_MM = (36.0, 2.0, 84.0)
TWIST_MM = 14.0
"""Middle of the twist, and the standard deviation of its angle over the distance from there."""

REACH_MM = 34.0
"""Rows are kept of the skin so far from there; beyond, nothing moves that could be seen."""

HALF_MM = 20.0
DPI = 136
TURNED, SMALL = (0.84, 0.1, 0.1), (0.96, 0.68, 0.15)


def measure(budget: str) -> list[dict[str, Any]]:
    """The cheek in both examples and both blends, and how many triangles are spoilt by how large a coefficient."""
    from evalkit.geometry import rotation_from_vector
    from evalkit.transfer.character import CharacterTransfer

    rest, triangles = front().rest, front().triangles
    off = rest - rest[np.linalg.norm(rest - SPOT_MM, axis=1).argmin()]
    axis = normal_at(rest, triangles, off)
    share = np.exp(-0.5 * (off**2).sum(axis=1) / TWIST_MM**2)[:, None]
    turns = [rotation_from_vector(sign * 0.5 * np.pi * share * axis) for sign in (1.0, -1.0)]
    fine = np.array([rest - off + np.einsum("vij,vj->vi", turn, off) for turn in turns])
    rough = np.array([rest, rest])
    weights = np.array(TIMES)[:, None, None] * np.ones((1, 1, 2))
    new = np.array([rest] * len(TIMES))
    found = {}
    for blend in BLENDS:
        transfer = CharacterTransfer(rest, rough, fine, triangles, regions=0, blend=blend)
        found[blend] = transfer(new, weights)
    at = TIMES.index(SHOWN)
    shapes = dict(zip(SHAPES, [*fine, *(found[blend][at] for blend in BLENDS)], strict=True))
    which = np.flatnonzero((off**2).sum(axis=1) < REACH_MM**2)
    rows: list[dict[str, Any]] = [
        {"vertex": int(vertex), **{
            f"{shape} {axis}": round(float(places[vertex, k]), 3)
            for shape, places in shapes.items() for k, axis in enumerate(XYZ)
        }}
        for vertex in which
    ]  # fmt: skip
    for blend, every in found.items():
        for times, places in zip(TIMES, every, strict=True):
            turned, collapsed = spoilt(rest, places, triangles)
            rows.append(
                {"blend": blend, "times": times, "turned": int(turned.sum()), "collapsed": int(collapsed.sum())}
            )
    return rows


def normal_at(rest: Array, triangles: Indices, off: Array) -> Array:
    """Mean direction (3,) of the skin where it is less than the width of the twist ``off`` its middle."""
    near = triangles[((off[triangles] ** 2).sum(axis=2) < TWIST_MM**2).all(axis=1)]
    a, b, c = (rest[near[:, k]] for k in range(3))
    total = np.cross(b - a, c - a).sum(axis=0)
    return np.asarray(total / np.linalg.norm(total))


def spoilt(rest: Array, places: Array, triangles: Indices) -> tuple[Any, Any]:
    """Which triangles (T,) are turned over, and which have less than a tenth of their area at rest."""
    from evalkit.transfer.gradients import flipped

    before, after = areas(rest, triangles), areas(places, triangles)
    return flipped(rest, places[None], triangles)[0], after < COLLAPSED * before


def draw(table: Table) -> Any:
    """The figure."""
    from matplotlib.figure import Figure

    cheek = table.rows.dropna(subset=["vertex"]).sort_values("vertex")
    counts = table.rows.dropna(subset=["blend"])
    vertices = cheek["vertex"].to_numpy(dtype=int)
    rest, triangles = front().rest[vertices], local_triangles(front().triangles, vertices)
    faces, titles = [], []
    for letter, (shape, name) in zip("abcd", SHAPES.items(), strict=True):
        places = cheek[[f"{shape} {axis}" for axis in XYZ]].to_numpy(dtype=float)
        turned, collapsed = spoilt(rest, places, triangles)
        colours = np.tile(SKIN, (len(triangles), 1))
        colours[collapsed], colours[turned] = SMALL, TURNED
        edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
        faces.append(Face(places, triangles, (), colours, edges, 1.4))
        here = counts[(counts["blend"] == shape) & (counts["times"] == SHOWN)]
        told = ", ".join(f"{int(here[what].iloc[0])} {what}" for what in COUNTS) if len(here) else shape
        titles.append(f"({letter}) {name}\n{told}")
    made = Figure(figsize=(PAGE_IN, 4.5))
    made.subplots_adjust(0.0, 0.01, 0.99, 0.93, wspace=0.04, hspace=0.22)
    layout = made.add_gridspec(2, 4, width_ratios=(1.0, 1.0, 0.25, 1.1))
    for k, (picture, title) in enumerate(zip(drawn(faces, 4, SPOT_MM, HALF_MM), titles, strict=True)):
        axes = made.add_subplot(layout[k // 2, k % 2])
        axes.imshow(picture)
        axes.set_axis_off()
        axes.set_title(title, loc="center", fontsize=7)
    curves = made.add_axes((0.68, 0.38, 0.3, 0.5))
    for blend, colour in zip(BLENDS, (VERMILION, BLUE), strict=True):
        part = counts[counts["blend"] == blend].sort_values("times")
        for what, line, sign in zip(COUNTS, ("-", "--"), "os", strict=True):
            curves.plot(
                part["times"], part[what], color=colour, linestyle=line, marker=sign, label=f"{BLENDS[blend]}, {what}"
            )
    curves.set(xlabel="coefficient of both examples", ylabel="triangles", title="(e)")
    curves.legend(loc="upper left", bbox_to_anchor=(0.0, -0.2))
    return raster(made, DPI)
