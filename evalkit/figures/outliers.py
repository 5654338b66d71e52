"""Samples that are not where their marker is: displaced by 10 or 50 mm on average, or labels exchanged.

Rotation error, root mean square over the takes with its 95 % interval, over the share of samples spoilt. Above three
rigid markers, nothing of which contradicts an outlier, below seven. The automatic weighting of all markers was asked at
the middle share alone.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import PAGE_IN, at_values, canvas, curve, keyed, lettered, looked, plain_log
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "outliers"
STUDY = "outliers"
SMALL = Budget(
    seeds=1, axes={"share": (0.01, 0.15)}, methods=("svd", "qcp", "robust", "joint", "robust joint"),
)  # fmt: skip

RIGID = {"paper-23": "three", "dense-63": "seven"}


def draw(table: Table) -> Any:
    """The figure."""
    faults = list(dict.fromkeys(table.rows["fault"]))
    made, panels = canvas(PAGE_IN, 4.6, nrows=2, ncols=len(faults), sharex=True, sharey=True, squeeze=False)
    for line, layout in zip(panels, RIGID, strict=True):
        for panel, fault in zip(line, faults, strict=True):
            at_values(panel, table.rows["share"])
            for method in looked(table.methods):
                curve(panel, table.of("rotation", method, layout=layout, fault=fault), "share", method)
            panel.set_title(f"{'labels exchanged' if fault == 'swap' else fault}, {RIGID[layout]} rigid")
        line[0].set_ylabel("rotation error, deg rms")
    for panel in panels[1]:
        panel.set_xlabel("share of samples spoilt")
    ends = table.of("rotation")[["value", "low", "high"]]
    plain_log(panels[0, 0].yaxis, 0.8 * ends.min(axis=None), 1.25 * ends.max(axis=None))
    lettered(panels.ravel())
    keyed(made, table, (panels[1, 0],))
    return made
