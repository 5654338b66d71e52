"""The lips under three kernels, with and without regions, where the mouth is open widest.

Dense truth of the built-in head, and what a map from the 23 markers makes of it; dots are markers, colours the
distance from truth. Without regions either lip is held back by the markers of the other one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.scenes import XYZ, built_in_head, close_up, local_triangles, printed
from evalkit.figures.style import PAGE_IN
from evalkit.figures.table import Table
from evalkit.render.face_maps import COLOUR_MAP, Camera, coloured_skin

NAME = "kernels-lips"
COLUMNS = ("frame", "panel", "regions", "vertex", "marker", *XYZ)
KERNELS = {"exponential": "exponential", "thin-plate": "thin plate", "bilaplacian": "bi-Laplacian"}
TRUTH = "truth"
LOW, HIGH = np.array([-38.0, -76.0]), np.array([38.0, -8.0])
"""Rows are kept of the skin that is between these x and y at rest, mm."""

MIDDLE = (0.0, -45.0, 110.0)
HALF_MM = 32.0
BACKDROP_MM = 60.0
LIMIT_MM = 10.0


def measure(budget: str) -> list[dict[str, Any]]:
    """Places of the skin about the mouth in the frame in which the lips are furthest apart."""
    from evalkit.studies.dense_takes import build_map, dense_take

    data = dense_take("template", seed=0)
    head = data.face.head
    middle = head.nearest_vertices({name: head.marker_sites[name] for name in ("UpperLipC", "LowerLipC")})
    frame = int((data.truth[:, middle["UpperLipC"], 1] - data.truth[:, middle["LowerLipC"], 1]).argmax())
    skin = head.part_vertices("skin")
    at_rest = head.vertices[skin, :2]
    shown = skin[((at_rest > LOW) & (at_rest < HIGH)).all(axis=1)]
    panels = {(TRUTH, ""): data.truth[frame, shown]}
    for kernel in KERNELS:
        for regions in (True, False):
            weights, _ = build_map(data, kernel, regions=regions)
            panels[kernel, str(regions)] = head.vertices[shown] + weights[shown] @ data.displacement[frame]
    names = {vertex: name for name, vertex in data.markers.items()}
    return [
        {
            "frame": frame, "panel": panel, "regions": regions, "vertex": int(vertex),
            "marker": names.get(int(vertex)), **dict(zip(XYZ, np.round(place, 2).tolist(), strict=True)),
        }
        for (panel, regions), places in panels.items()
        for vertex, place in zip(shown, places, strict=True)
    ]  # fmt: skip


def draw(table: Table) -> Any:
    """The figure."""
    from matplotlib.figure import Figure

    head, rows, camera = built_in_head(), table.rows, Camera(MIDDLE, HALF_MM)
    true = rows[rows["panel"] == TRUTH].sort_values("vertex")
    vertices = true["vertex"].to_numpy()
    triangles = local_triangles(head.part_triangles("skin"), vertices)
    lips = np.isin(vertices, np.concatenate([head.regions["upper lip"], head.regions["lower lip"]]))
    made = Figure(figsize=(PAGE_IN, 4.6))
    made.subplots_adjust(0.01, 0.06, 0.99, 0.92, wspace=0.05, hspace=0.35)
    grid = made.subplots(2, 1 + len(KERNELS))
    wanted = [(grid[0, 0], true, "(a) truth\n", None)]
    letters = iter("bcdefg")
    for row, regions in enumerate((True, False)):
        for column, (kernel, name) in enumerate(KERNELS.items(), start=1):
            part = rows[(rows["panel"] == kernel) & (rows["regions"].astype(str) == str(regions))]
            part = part.sort_values("vertex")
            off = np.linalg.norm(part[list(XYZ)].to_numpy() - true[list(XYZ)].to_numpy(), axis=1)
            words = f"({next(letters)}) {name}, {'regions' if regions else 'no regions'}"
            rms = np.sqrt((off[lips] ** 2).mean())
            wanted.append((grid[row, column], part, f"{words}\nlips {rms:.1f} mm rms", off))
    for axes, part, title, off in wanted:
        places = part[list(XYZ)].to_numpy(dtype=float)
        picture = coloured_skin(places, triangles, off, camera, limits=(0.0, LIMIT_MM), backdrop_mm=BACKDROP_MM)
        close_up(axes, picture, camera, 10.0)
        worn = part[part["marker"].notna()]
        axes.scatter(worn["x_mm"], worn["y_mm"], s=9, c="white", edgecolors="black", linewidths=0.6)
        axes.set_title(title, fontsize=7)
    grid[1, 0].set_axis_off()
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    colours = ScalarMappable(Normalize(0.0, LIMIT_MM), COLOUR_MAP)
    bar = grid[1, 0].inset_axes((0.1, 0.5, 0.8, 0.08))
    made.colorbar(colours, cax=bar, orientation="horizontal", label="distance from truth, mm", extend="max")
    return printed(made)
