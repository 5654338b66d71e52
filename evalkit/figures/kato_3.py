"""Hierarchical segmentation of a face, as in Fig. 3 of Kato et al. (2014).

(a) Tree of splits; at level l motion weighs λ = l times as much as place. Circles are regions, their area how much of
the surface they are. (b) to (e) Regions of the triangles after each level, on the face of the figures beside, from its
four examples. Colours are those of the tree; lines are where regions meet.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.compared import DPI
from evalkit.figures.faces import Face, areas, drawn, front, paper_like, region_face, rest_of, rest_rows, tints
from evalkit.figures.files import raster
from evalkit.figures.scenes import XYZ
from evalkit.figures.style import PAGE_IN
from evalkit.figures.table import Table
from evalkit.geometry import Array
from evalkit.transfer.segmentation import LEVELS, segment

NAME = "kato-3"
SPLITS = tuple(f"level_{level}" for level in range(1, LEVELS + 1))
COLUMNS = ("number", *XYZ, "radius_mm", "triangle", *SPLITS)


def measure(budget: str) -> list[dict[str, Any]]:
    """The face at rest, and the region of every triangle at every level."""
    task = paper_like()
    one = task.one
    levels = segment(one.rest, one.triangles, task.examples.fine)[1:]
    return rest_rows(one.rest, np.arange(len(one.rest))) + [
        {"triangle": number, **dict(zip(SPLITS, map(int, labels), strict=True))}
        for number, labels in enumerate(np.stack(levels, axis=1))
    ]


def draw(table: Table) -> Any:
    """The figure."""
    from matplotlib.figure import Figure

    rows = table.rows
    _, rest, eyes = rest_of(rows)
    parts = rows.dropna(subset=["triangle"])
    which = parts["triangle"].to_numpy(dtype=int)
    labels = parts[list(SPLITS)].to_numpy(dtype=int)
    colours = tree_colours(labels)
    triangles = front().triangles[which]
    faces: list[Face] = [region_face(rest, triangles, eyes, labels[:, k], colours[k]) for k in range(LEVELS)]
    made = Figure(figsize=(PAGE_IN, 2.1))
    made.subplots_adjust(0.0, 0.01, 1.0, 0.84, wspace=0.0)
    tree, *grid = made.subplots(1, 1 + LEVELS, gridspec_kw={"width_ratios": (1.25, *[1.0] * LEVELS)})
    draw_tree(tree, labels, colours, areas(rest, triangles))
    for axes, picture, letter, level in zip(grid, drawn(faces, LEVELS), "bcde", range(LEVELS), strict=True):
        axes.imshow(picture)
        axes.set_axis_off()
        count = len(np.unique(labels[:, level]))
        axes.set_title(f"({letter}) level {level + 1} (λ = {level + 1}.0)\n{count} regions", loc="center", fontsize=7)
    return raster(made, DPI)


def tree_colours(labels: Any) -> list[Array]:
    """Colours (regions, 3) of every level: those of the leaves, and of a region that of its largest leaf."""
    leaves = labels[:, -1]
    sizes, own = np.bincount(leaves), tints(int(leaves.max()) + 1)
    found = []
    for level in labels.T:
        inside = [np.unique(leaves[level == region]) for region in range(int(level.max()) + 1)]
        found.append(np.array([own[some[sizes[some].argmax()]] for some in inside]))
    return found


def draw_tree(axes: Any, labels: Any, colours: list[Array], area: Array) -> None:
    """The splits from the top down, with the level and its weight at the left."""
    leaves = labels[:, -1]
    shares = area / area.sum()
    above = {0: 0.5 * float(leaves.max())}
    axes.scatter([above[0]], [0], s=80, color="0.75", edgecolors="black", linewidths=0.5, zorder=3)
    for depth, level in enumerate(labels.T, start=1):
        parent = labels[:, depth - 2] if depth > 1 else np.zeros(len(labels), dtype=int)
        here = {}
        for region in range(int(level.max()) + 1):
            inside = level == region
            here[region] = float(np.unique(leaves[inside]).mean())
            axes.plot([above[parent[inside][0]], here[region]], [1 - depth, -depth], color="0.3", linewidth=0.7)
            size = 12.0 + 260.0 * float(shares[inside].sum())
            axes.scatter(
                [here[region]], [-depth], s=min(size, 80.0), color=[colours[depth - 1][region]], edgecolors="black",
                linewidths=0.5, zorder=3,
            )  # fmt: skip
        above = here
        axes.text(-1.6, -depth, f"level {depth}", va="center", ha="right", fontsize=6.5)
    axes.set(xlim=(-5.5, leaves.max() + 1.0), ylim=(-len(labels.T) - 0.6, 0.6))
    axes.set_axis_off()
    axes.set_title("(a) tree of splits\n16 leaves", loc="center", fontsize=7)
