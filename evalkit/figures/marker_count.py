"""Fewer and more markers than the paper's 23.

(a) Error of all moving vertices of the outer skin, (b) of the lips, root mean square, and (c) frames in which the lips
cross, over the number of markers; 0.3 mm of noise, regions for the lips, 95 % intervals over the takes. Dotted: 23.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import LOOKS, PAGE_IN, at_values, canvas, curve, keyed, lettered, looked, plain_log
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "marker-count"
STUDY = "marker-count"
SMALL = Budget(seeds=1, axes={"head": ("template 3000",), "markers": (8, 23, 63)})

PAPER = 23
PANELS = {
    "all moving": "error of all moving skin, mm rms",
    "lips": "error of the lips, mm rms",
    "frames with crossed lips": "frames with crossed lips, %",
}


def draw(table: Table) -> Any:
    """The figure."""
    made, panels = canvas(PAGE_IN, 2.9, ncols=3)
    for panel, (statistic, label) in zip(panels, PANELS.items(), strict=True):
        at_values(panel, table.rows["markers"])
        for method in looked(table.methods):
            curve(panel, table.of(statistic, method), "markers", method)
        panel.axvline(PAPER, color=LOOKS["bound"].colour, linestyle=":", linewidth=0.8)
        panel.set_xlabel("markers")
        panel.set_ylabel(label)
        if not statistic.startswith("frames"):
            ends = table.of(statistic)[["value", "low", "high"]]
            plain_log(panel.yaxis, 0.8 * ends.min(axis=None), 1.25 * ends.max(axis=None))
    lettered(panels)
    keyed(made, table, (panels[0],))
    return made
