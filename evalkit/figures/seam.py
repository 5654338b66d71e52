"""Four treatments of the seam between face and lips, at the corner of an open mouth.

Above, the skin about the left corner, in the colour of its displacement; below, the displacement along the line that
is drawn above, from over the corner to under it. Fields that meet hard tear the skin there; ramp and spline close it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.scenes import XYZ, built_in_head, close_up, local_triangles, printed
from evalkit.figures.style import PAGE_IN
from evalkit.figures.table import Table
from evalkit.geometry import Array
from evalkit.head.model import Indices
from evalkit.render.colours import BLACK, BLUE, GREEN, VERMILION
from evalkit.render.face_maps import COLOUR_MAP, Camera, coloured_skin

NAME = "seam"
COLUMNS = ("frame", "treatment", "vertex", *XYZ)
KERNEL = "exponential"
TREATMENTS = {"none": "no regions", "hard": "hard", "ramp": "ramp", "spline": "spline"}
LOOKS = {"none": (BLACK, ":"), "hard": (VERMILION, "-"), "ramp": (BLUE, "-"), "spline": (GREEN, "--")}
REACH_MM = 32.0
"""Rows are kept of the skin so far from the corner."""

LINE_MM = 1.6
"""The line runs straight down, so far inside of the marker at the corner: where the slit of the mouth has just ended
and the fields of both lips meet."""

HALF_MM = 14.0


def measure(budget: str) -> list[dict[str, Any]]:
    """Displacements of the skin about the corner in the frame in which hard fields jump most."""
    from evalkit.deform import Deformer, seam_jump
    from evalkit.studies.dense_takes import build_map, dense_take

    data = dense_take("template", seed=0)
    head = data.face.head
    skin = head.part_vertices("skin")
    away = np.linalg.norm(head.vertices[skin] - head.marker_sites["MouthL"], axis=1)
    shown = skin[away < REACH_MM]
    maps = {name: build_map(data, KERNEL, seam=name)[0] for name in TREATMENTS}
    every = slice(None, None, 5)
    jump = seam_jump(head, Deformer(maps["hard"])(data.displacement[every])).max(axis=1)
    frame = 5 * int(jump.argmax())
    return [
        {
            "frame": frame, "treatment": name, "vertex": int(vertex),
            **dict(zip(XYZ, np.round(moved, 3).tolist(), strict=True)),
        }
        for name, weights in maps.items()
        for vertex, moved in zip(shown, weights[shown] @ data.displacement[frame], strict=True)
    ]  # fmt: skip


def draw(table: Table) -> Any:
    """The figure."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    head, rows = built_in_head(), table.rows
    corner = head.marker_sites["MouthL"]
    made = Figure(figsize=(PAGE_IN, 4.3), layout="constrained")
    halves: Any = made.subfigures(2, 1, height_ratios=(2.1, 2.2))
    above, below = halves
    grid, curves = above.subplots(1, len(TREATMENTS)), below.subplots()
    most = float(np.linalg.norm(rows[list(XYZ)].to_numpy(), axis=1).max())
    for axes, letter, (treatment, name) in zip(grid, "abcd", TREATMENTS.items(), strict=True):
        part = rows[rows["treatment"] == treatment].sort_values("vertex")
        vertices, moved = part["vertex"].to_numpy(), part[list(XYZ)].to_numpy(dtype=float)
        triangles = local_triangles(head.part_triangles("skin"), vertices)
        rest, length = head.vertices[vertices], np.linalg.norm(moved, axis=1)
        near = moved[np.linalg.norm(rest - corner, axis=1).argmin()]
        camera = Camera(tuple(np.round(corner + near)), HALF_MM)
        picture = coloured_skin(rest + moved, triangles, length, camera, limits=(0.0, most), edges=True)
        close_up(axes, picture, camera, 5.0)
        axes.set_title(f"({letter}) {name}")
        down, places, along = crossing(rest, moved, triangles, corner[0] - LINE_MM)
        axes.plot(places[:, 0], places[:, 1], color="white", linewidth=1.5)
        colour, style = LOOKS[treatment]
        curves.plot(down - corner[1], np.linalg.norm(along, axis=1), color=colour, linestyle=style, label=name)
    colours = ScalarMappable(Normalize(0.0, most), COLOUR_MAP)
    above.colorbar(colours, ax=grid, label="displacement, mm", pad=0.01)
    curves.set(xlabel="height above the corner at rest, mm", ylabel="displacement, mm", title="(e)")
    curves.legend(ncols=4)
    return printed(made)


def crossing(rest: Array, moved: Array, triangles: Indices, x_mm: float) -> tuple[Array, Array, Array]:
    """Where a surface crosses the plane of this x at rest: heights (n,), places after the motion (n, 3), motion."""
    from evalkit.deform.surface import edges

    a, b = edges(triangles).T
    cut = (rest[a, 0] - x_mm) * (rest[b, 0] - x_mm) < 0
    a, b = a[cut], b[cut]
    share = ((x_mm - rest[a, 0]) / (rest[b, 0] - rest[a, 0]))[:, None]
    at, by = (both[a] + share * (both[b] - both[a]) for both in (rest, moved))
    order = np.argsort(at[:, 1])
    return at[order, 1], (at + by)[order], by[order]
