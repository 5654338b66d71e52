"""Head trackers on filmed heads, one difficulty at a time.

(a) Mean error of yaw and (b) of pitch, (c) the worst frame, of the turn since the first frame; one line for every head
and for every difficulty of the first head: larger turns, light, what comes before the face, picture, size and frame
rate. 95 % intervals over the videos.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import PAGE_IN, canvas, dots, keyed, lettered, lines, looked, plain_log
from evalkit.figures.table import Table

NAME = "head-pose"
STUDY = "head-pose"
PANELS = {"yaw": "yaw error, deg", "pitch": "pitch error, deg", "worst frame": "worst frame, deg"}
UNITS = {"turn_deg": "turns to {:g} deg", "rate_hz": "{:g} frames/s"}


def draw(table: Table) -> Any:
    """The figure."""
    axes = list(table.study.axes) if table.study else []
    usual = {axis: table.rows[axis].iloc[0] for axis in axes}
    found = {statistic: table.of(statistic).copy() for statistic in PANELS}
    for part in found.values():
        part["line"] = [_name(row, usual) for _, row in part[axes].iterrows()]
    order = list(dict.fromkeys(found["yaw"]["line"]))
    methods = looked(table.methods)
    made, panels = canvas(PAGE_IN, 1.4 + 0.17 * len(order), ncols=len(PANELS), sharey=True)
    for panel, (statistic, label) in zip(panels, PANELS.items(), strict=True):
        lines(panel, order)
        for k, method in enumerate(methods):
            part = found[statistic]
            dots(panel, part[part["method"] == method], "line", order, method, 0.6 * ((k + 0.5) / len(methods) - 0.5))
        ends = found[statistic]["value"].dropna()
        plain_log(panel.xaxis, 0.7 * ends.min(), 1.4 * ends.max())
        panel.set_xlabel(label)
    panels[0].set_ylabel("head, and difficulty")
    lettered(panels)
    keyed(made, table, (panels[0],), ncols=4)
    return made


def _name(row: Any, usual: dict[str, Any]) -> str:
    """The value that is not as usual; the head where all are."""
    other = [axis for axis in usual if row[axis] != usual[axis] and axis != "head"]
    if not other:
        return str(row["head"])
    return UNITS.get(other[0], "{}").format(row[other[0]])
