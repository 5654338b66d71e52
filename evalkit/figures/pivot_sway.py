"""What a drifting neck does to pivot, rotation and expression.

Three rigid markers, 0.3 mm of noise; root mean square over the takes with its 95 % interval over the amplitude of the
sway: (a) pivot error, (b) rotation and (c) expression error over those of each frame by itself (SVD, 1). Dotted in (c):
what the study expected of joint at the largest sway, and whether it was met. joint with forced knots: seconds between
them. Dashed in (a): Cramér-Rao bound, with the sway that joint modelled; that joint lies below it is the luck of the
takes, as the figure over noise shows with more of them. Methods that give a pivot and no poses are in (a) alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from evalkit.figures.style import LOOKS, PAGE_IN, at_values, canvas, curve, keyed, lettered, looked, plain_log
from evalkit.figures.table import Table
from evalkit.render.colours import BLUE
from evalkit.study.description import Budget

NAME = "pivot-sway"
STUDY = "pivot-sway"
SMALL = Budget(seeds=2)

OWN_POSES = ("joint", "paper")
"""How methods begin that have rotations of their own."""

FORCED = {"joint 2.5 s": "v", "joint 1.25 s": "^", "joint 0.625 s": "<", "joint 0.3125 s": ">"}
"""Method to its sign: the knots of the spline forced."""

PANELS = {
    "pivot error": "pivot error, mm rms",
    "rotation over per-frame": "rotation error over per-frame",
    "expression over per-frame": "expression error over per-frame",
}


def draw(table: Table) -> Any:
    """The figure."""
    made, panels = canvas(PAGE_IN, 4.2, ncols=3, width_ratios=(1.4, 1, 1))
    for panel, (statistic, label) in zip(panels, PANELS.items(), strict=True):
        panel.set_xscale("function", functions=(_root, _square))
        at_values(panel, table.rows["sway_mm"], log=False)
        panel.set_xlim(-0.1, 1.1 * table.rows["sway_mm"].max())
        shown = [m for m in looked(table.methods) if panel is panels[0] or m.startswith(OWN_POSES)]
        for method in shown:
            forced: Any = {"marker": FORCED[method], "color": BLUE, "alpha": 0.45} if method in FORCED else {}
            curve(panel, table.of(statistic, method), "sway_mm", method, **forced)
        found = table.of(statistic)
        found = found[found["method"].isin(shown)]
        plain_log(panel.yaxis, 0.8 * found["value"].min(), 1.4 * found["high"].fillna(found["value"]).max())
        panel.set_xlabel("sway, mm")
        panel.set_ylabel(label)
    for panel in panels[1:]:
        panel.axhline(1.0, color=LOOKS["svd"].colour, linewidth=0.8)
    rows = table.rows[table.rows["method"] == "joint"]
    bound = np.sqrt((rows.set_index("sway_mm")["bound_mm"].astype(float) ** 2).groupby("sway_mm").mean())
    panels[0].plot(bound.index, bound, color=LOOKS["bound"].colour, linestyle="--", label="Cramér-Rao bound")
    _expected(table, panels[2])
    lettered(panels)
    keyed(made, table, (panels[0],), ncols=4)
    return made


def _expected(table: Table, panel: Any) -> None:
    """The limit that the study set, and what came of it."""
    assert table.study is not None
    statistic = "expression over per-frame"
    limit = next(e for e in table.study.expected if e.statistic == statistic and e.method == "joint")
    reached = table.of(statistic, limit.method, **limit.where)["value"]
    word = "met" if len(reached) and reached.max() <= limit.limit else "not met"
    panel.axhline(limit.limit, color=LOOKS["bound"].colour, linestyle=":")
    panel.annotate(f"{limit.limit:g} expected: {word}", (0.12, limit.limit), xycoords=("axes fraction", "data"),
                   xytext=(0, -2), textcoords="offset points", ha="left", va="top", fontsize=6.5)  # fmt: skip


def _root(x: ArrayLike) -> Any:
    """A scale that shows 0 and tells small amplitudes apart."""
    return np.sign(x) * np.sqrt(np.abs(x))


def _square(x: ArrayLike) -> Any:
    return np.sign(x) * np.square(x)
