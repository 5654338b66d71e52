"""A performer's expression on another head, and how far it is from that head's own.

(a) The performer, the built-in head. The same expression on that head bent to a muzzle: (b) truth, which is bent with
it; from all vertices of the performer (c) with the Jacobian and (d) without it; from 38 markers, spread (e) by the
toolkit's map and (f) barycentrically without regard to the slit of the mouth. Below, root mean square errors over the
motion in truth of all vertices of the face (wide bars) and of its lips (narrow ones), with 95 % intervals over
expressions and persons; 1 is a face that does not move. (g) Ways to carry the motion of all vertices; (h) ways to
spread that of markers, with the Jacobian.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from evalkit.figures.scenes import printed
from evalkit.figures.style import ORANGE, PAGE_IN, reach
from evalkit.figures.table import Table
from evalkit.head import Head
from evalkit.render.colours import BLUE, GREEN, GREY, SKY, VERMILION
from evalkit.render.head_views import BACKGROUND, View, draw_head
from evalkit.render.offscreen import offscreen_plotter

NAME = "retarget"
STUDY = "retarget"

VERTICES = 4000
"""Of the built-in head in the pictures."""

EXPRESSION = {"jaw": 0.55, "smile left": 0.9, "smile right": 0.5, "brow_up left": 1.0, "upper_lip_up left": 0.6}

VIEW = View(yaw_deg=24.0, pitch_deg=4.0, zoom=1.3)
TILE = (330, 400)
"""Width and height of a head, pixels."""

HEADS = (
    "(a) performer", "(b) truth", "(c) with Jacobian", "(d) without", "(e) from markers", "(f) markers, no slits",
)  # fmt: skip

CARRIED = {
    "jacobian": ("with Jacobian", BLUE), "no jacobian": ("without", SKY),
    "deformation transfer": ("Deformation Transfer", ORANGE), "wrong landmarks": ("wrong landmarks (control)", GREY),
}  # fmt: skip
SPREAD = {
    "kernel": ("the toolkit's map", GREEN), "barycentric": ("barycentric", VERMILION),
    "barycentric without slits": ("the same without slits (the paper's)", ORANGE),
}  # fmt: skip
"""Method or motion -> its name and colour."""

PARTS = {"all over motion": "face", "lips over motion": "lips"}
MOST = 1.3
"""Of the error axis: the control goes beyond it and is cut off."""


@cache
def heads() -> list[Head]:
    """The heads of the pictures."""
    from evalkit.dense import muscle_face
    from evalkit.head import load_head
    from evalkit.studies.retarget import JACOBIAN, WITHOUT, run, to_muzzle

    head = load_head("template", vertices=VERTICES)
    acted = muscle_face(head).positions({unit: np.array([amount]) for unit, amount in EXPRESSION.items()})
    pair = to_muzzle(head, acted - head.vertices)
    results = [
        run(replace(pair, motion=motion), method)
        for method, motion in (
            (JACOBIAN, "dense"), (WITHOUT, "dense"), (JACOBIAN, "kernel"), (JACOBIAN, "barycentric without slits"),
        )
    ]  # fmt: skip
    there = pair.target.vertices
    shown = [replace(pair.target, vertices=there + moves[0]) for moves in (pair.truth, *results)]
    return [replace(head, vertices=acted[0]), *shown]


def draw(table: Table) -> Any:
    """The figure."""
    from matplotlib.figure import Figure

    made = Figure(figsize=(PAGE_IN, 4.9))
    grid = made.add_gridspec(
        2, len(HEADS), height_ratios=(1.0, 1.25), left=0.065, right=0.995, top=0.95, bottom=0.2, wspace=0.03, hspace=0.3
    )
    for k, (picture, title) in enumerate(zip(_pictures(), HEADS, strict=True)):
        axes = made.add_subplot(grid[0, k])
        axes.imshow(picture)
        axes.set_axis_off()
        axes.set_title(title, fontsize=7)
    half = len(HEADS) // 2
    left, right = made.add_subplot(grid[1, :half]), made.add_subplot(grid[1, half:])
    pairs = list(dict.fromkeys(table.rows["pair"]))
    carried = {name: {"method": name, "motion": "dense"} for name in CARRIED}
    spread = {name: {"method": "jacobian", "motion": name} for name in SPREAD}
    _bars(left, table, pairs, carried, CARRIED)
    _bars(right, table, pairs, spread, SPREAD)
    left.set_title("(g) motion of all vertices")
    right.set_title("(h) motion of markers")
    left.set_ylabel("error over motion")
    right.set_yticklabels([])
    return printed(made)


def _bars(
    axes: Any, table: Table, pairs: list[str], wanted: dict[str, dict[str, str]], looks: dict[str, tuple[str, str]]
) -> None:
    """Bars of the face, and narrow ones of the lips in front of them."""
    width = 0.8 / len(wanted)
    for k, (name, where) in enumerate(wanted.items()):
        label, colour = looks[name]
        at = np.arange(len(pairs)) + (k - 0.5 * (len(wanted) - 1)) * width
        for number, statistic in enumerate(PARTS):
            found = table.of(statistic, **where).set_index("pair").reindex(pairs)
            wide = width * (0.95, 0.42)[number]
            axes.bar(
                at, found["value"].clip(upper=MOST), wide, color=colour, alpha=(0.5, 1.0)[number],
                label=f"{label}" if number else None,
            )  # fmt: skip
            shown = found[found["value"] < MOST]
            axes.errorbar(
                at[(found["value"] < MOST).to_numpy()] + (number - 0.5) * 0.3 * width, shown["value"], reach(shown),
                color="black", linestyle="", elinewidth=0.6,
            )  # fmt: skip
    axes.axhline(1.0, color="black", linewidth=0.6, linestyle=":")
    axes.set(xlim=(-0.5, len(pairs) - 0.5), ylim=(0.0, MOST))
    axes.set_xticks(range(len(pairs)), [pair.replace(" to ", "\nto ").split(" of ")[0] for pair in pairs], fontsize=6)
    axes.grid(axis="x", visible=False)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, fontsize=6)


def _pictures() -> list[Any]:
    """The heads, all from one window."""
    shown, (width, height) = heads(), TILE
    with offscreen_plotter(len(shown) * width, height, shape=(1, len(shown)), border=False) as opened:
        plotter: Any = opened
        plotter.suppress_rendering = True
        for k, head in enumerate(shown):
            plotter.subplot(0, k)
            plotter.set_background(BACKGROUND)
            draw_head(plotter, head, VIEW)
        plotter.suppress_rendering = False
        plotter.render_window.SetMultiSamples(8)
        sheet = np.asarray(plotter.screenshot(None, return_img=True))
    return [sheet[:, k * width : (k + 1) * width] for k in range(len(shown))]
