"""How the cylinder's template is kept up to date, over short and long videos.

(a) Mean error of yaw since the first frame, (b) mean angle to the truth in the last third of the video, where drift has
gathered: the first frame as the only template, a template that follows the last frame, and the same with references.
95 % intervals over the videos.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import PAGE_IN, canvas, dots, keyed, lettered, lines, looked
from evalkit.figures.table import Table

NAME = "template-update"
STUDY = "template-update"
PANELS = {"yaw": "yaw error, deg", "last third": "angle in the last third, deg"}


def draw(table: Table) -> Any:
    """The figure."""
    methods = looked(table.methods)
    found = {statistic: table.of(statistic).copy() for statistic in PANELS}
    for part in found.values():
        part["line"] = [
            f"{head}, {light}, {frames} frames"
            for head, light, frames in part[["head", "light", "frames"]].itertuples(index=False)
        ]
    order = list(dict.fromkeys(found["yaw"]["line"]))
    made, panels = canvas(PAGE_IN, 1.3 + 0.22 * len(order), ncols=2, sharey=True)
    for panel, (statistic, label) in zip(panels, PANELS.items(), strict=True):
        lines(panel, order)
        for k, method in enumerate(methods):
            part = found[statistic]
            dots(panel, part[part["method"] == method], "line", order, method, 0.6 * ((k + 0.5) / len(methods) - 0.5))
        panel.set_xlim(left=0)
        panel.set_xlabel(label)
    panels[0].set_ylabel("head, light, length")
    lettered(panels)
    keyed(made, table, (panels[0],))
    return made
