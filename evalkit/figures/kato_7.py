"""Regions drawn by hand against those that the method finds, as in Fig. 7 of Kato et al. (2014).

(a) Regions as a user would draw them and (b) the method's own, of the vertices. (c) and (d) Error of Character Transfer
with either: root mean square at each vertex over all other expressions of the face, learnt from its four examples; in
the titles over all vertices as well, in cm where the inner corners of the eyes are 50 cm apart.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.compared import DPI, EYES_CM, colour_bar
from evalkit.figures.faces import (
    BEHIND_MM,
    Face,
    drawn,
    front,
    paper_like,
    region_face,
    rest_of,
    rest_rows,
    shaded,
    tints,
    vertex_rows,
)
from evalkit.figures.files import raster
from evalkit.figures.scenes import XYZ, local_triangles
from evalkit.figures.style import PAGE_IN
from evalkit.figures.table import Table

NAME = "kato-7"
KINDS = {"drawn": "drawn by hand", "found": "found"}
COLUMNS = ("number", *XYZ, "radius_mm", *(f"{kind}_{what}" for kind in KINDS for what in ("region", "rms_cm")))
LIMIT_CM = 2.5


def measure(budget: str) -> list[dict[str, Any]]:
    """The face at rest; region and error of every vertex."""
    from evalkit.studies.transfers import drawn_labels
    from evalkit.transfer.character import CharacterTransfer
    from evalkit.transfer.segmentation import LEVELS

    task = paper_like()
    one, known = task.one, task.examples
    rows: list[dict[str, Any]] = rest_rows(one.rest, np.arange(len(one.rest)))
    for kind, regions in (("drawn", drawn_labels(one)), ("found", LEVELS)):
        transfer = CharacterTransfer(known.rest, known.rough, known.fine, known.triangles, regions=regions)
        off = np.linalg.norm(transfer(task.rough) - task.fine, axis=2) * EYES_CM / one.eye_distance_mm
        rms = np.sqrt((off**2).mean(axis=0))
        # Eyeballs come after the vertices.
        for row, region, error in zip(rows, transfer.regions, rms, strict=False):
            row |= {f"{kind}_region": int(region), f"{kind}_rms_cm": round(float(error), 3)}
    return rows


def draw(table: Table) -> Any:
    """The figure."""
    from matplotlib.figure import Figure

    rows = table.rows
    vertices, rest, eyes = rest_of(rows)
    triangles = local_triangles(front().triangles, vertices)
    triangles = triangles[(rest[triangles, 2] > BEHIND_MM).all(axis=1)]
    maps, errors, above, below = [], [], [], []
    for letters, (kind, name) in zip(("ac", "bd"), KINDS.items(), strict=True):
        part = vertex_rows(rows)
        regions, off = part[f"{kind}_region"].to_numpy(dtype=int), part[f"{kind}_rms_cm"].to_numpy(dtype=float)
        # Of three regions of its corners a triangle is in the middle one: that of two where two are the same.
        labels = np.sort(regions[triangles], axis=1)[:, 1]
        maps.append(region_face(rest, triangles, eyes, labels, tints(int(regions.max()) + 1)))
        errors.append(Face(rest, triangles, eyes, shaded(vertices, off / LIMIT_CM)))
        above.append(f"({letters[0]}) {name}\n{len(np.unique(regions))} regions")
        below.append(f"({letters[1]}) {name}\n{np.sqrt((off**2).mean()):.3f} cm rms")
    made = Figure(figsize=(PAGE_IN, 2.45))
    made.subplots_adjust(0.0, 0.01, 0.88, 0.86, wspace=0.0)
    grid = made.subplots(1, 4)
    for axes, picture, title in zip(grid, drawn(maps + errors, 4), above + below, strict=True):
        axes.imshow(picture)
        axes.set_axis_off()
        axes.set_title(title, loc="center", fontsize=7)
    colour_bar(made, (0.895, 0.09, 0.012, 0.56), LIMIT_CM)
    return raster(made, DPI)
