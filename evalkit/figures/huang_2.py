"""What a rotation about the pivot leaves as it is, as Fig. 2 of Huang et al.

The three rigid markers of a synthetic talking take and the pivot O, (a) in the frame in which the head is turned least
and (b) in the one in which it is turned furthest. The lengths l of the edges to the pivot and the angles between them
stay the same but for the noise of the markers.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.scenes import XYZ, place_rows, places
from evalkit.figures.style import COLUMN_IN, canvas
from evalkit.figures.table import Table
from evalkit.geometry import Array
from evalkit.render.colours import BLACK, GREY, RIGID

NAME = "huang-2"
COLUMNS = ("panel", "frame", "turn_deg", "label", *XYZ)
RIGHT, UP = np.array([0.93, 0.0, -0.37]), np.array([0.07, 0.98, 0.18])
"""Directions in the picture: seen from the front and the left, a little from above."""

ARCS_MM = (45.0, 62.0, 79.0)
"""Radii of the arcs, one for each angle."""


def measure(budget: str) -> list[dict[str, Any]]:
    """Rigid markers as they were seen, and the true pivot, in two frames."""
    from evalkit.geometry import rotation_angle
    from evalkit.synthetic import synthesize

    take, truth = synthesize("talking", seed=0)
    turn = np.rad2deg(rotation_angle(truth.rotations))
    rows = []
    for panel, frame in (("a", int(turn.argmin())), ("b", int(turn.argmax()))):
        seen = take.points[frame, list(take.indices(truth.rigid))]
        shown = {f"P{k}": place for k, place in enumerate(seen, start=1)} | {"O": truth.pivot + truth.sway[frame]}
        rows += place_rows(shown, panel=panel, frame=frame, turn_deg=round(float(turn[frame]), 2))
    return rows


def draw(table: Table) -> Any:
    """The figure."""
    made, panels = canvas(COLUMN_IN, 3.0, ncols=2, sharex=True, sharey=True)
    for axes, (letter, rows) in zip(panels, table.rows.groupby("panel"), strict=True):
        found = places(rows)
        pivot = found.pop("O")
        markers = np.array(list(found.values()))
        edges = markers - pivot
        corners = flat(np.vstack([markers, markers[:1]]) - pivot)
        axes.fill(*corners.T, color=RIGID, alpha=0.3, linewidth=0)
        axes.plot(*corners.T, color=GREY, linewidth=0.8)
        words = []
        for k, edge in enumerate(edges):
            after, radius = (k + 1) % len(edges), ARCS_MM[k]
            axes.plot(*flat(np.array([np.zeros(3), edge])).T, color=RIGID)
            axes.plot(*flat(edge), color=RIGID, marker="o")
            axes.annotate(f"$P_{k + 1}$", flat(edge), (0, 5), textcoords="offset points", ha="center")
            curve = flat(arc(edge, edges[after], radius))
            axes.plot(*curve.T, color=BLACK, linewidth=0.8)
            end = curve[np.argmax(curve[:, 0] * (1 if k == 0 else -1))]
            how = {"ha": "left" if k == 0 else "right", "va": "center", "textcoords": "offset points"}
            axes.annotate(f"$θ_{k + 1}$", end, (4 if k == 0 else -4, 0), **how)
            theta = np.rad2deg(np.arccos(edge @ edges[after] / np.linalg.norm(edge) / np.linalg.norm(edges[after])))
            words.append(f"$l_{k + 1}$ = {np.linalg.norm(edge):.1f} mm   $θ_{k + 1}$ = {theta:.2f}°")
        axes.plot(0.0, 0.0, color=BLACK, marker="o")
        axes.annotate("O", (0.0, 0.0), (5, -2), textcoords="offset points", va="top")
        axes.set(aspect="equal", title=f"({letter}) turned by {rows['turn_deg'].iloc[0]:.1f}°")
        axes.set_xlabel("\n".join(words))
        axes.set(xticks=[], yticks=[])
        axes.spines[:].set_visible(False)
    return made


def flat(points: Array) -> Array:
    """Points (..., 3) about the pivot in the picture, (..., 2)."""
    return points @ np.stack([RIGHT, UP], axis=1)


def arc(a: Array, b: Array, radius: float) -> Array:
    """Points (n, 3) of the arc of a radius from the direction a to the direction b."""
    share = np.linspace(0.0, 1.0, 30)[:, None]
    between = (1.0 - share) * a / np.linalg.norm(a) + share * b / np.linalg.norm(b)
    return radius * between / np.linalg.norm(between, axis=1, keepdims=True)
