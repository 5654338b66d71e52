"""Missing markers, singly and in bursts of half a second.

Over the share of samples that is missing: above, share of the frames that have a head pose, dashed the share in which
three rigid markers are seen; below, rotation error in the frames posed, root mean square. 95 % intervals over the
takes. Three (paper-23) and seven (dense-63) rigid markers; least-squares methods lie on each other. Grey: other
packages.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.grid import Row, grid
from evalkit.figures.style import LOOKS, keyed
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "gaps"
STUDY = "gaps"
SMALL = Budget(seeds=1, axes={"gaps": (0.02, 0.3)}, methods=("svd", "robust", "peer-scipy", "joint"))

COLUMNS = {
    f"{layout}, {word}": {"layout": layout, "burst_frames": burst}
    for layout in ("paper-23", "dense-63")
    for word, burst in (("single", 1), ("bursts", 30))
}


def draw(table: Table) -> Any:
    """The figure."""
    rows = (Row("frames posed", "share of frames posed", log=False), Row("rotation", "rotation error, deg rms"))
    made, panels = grid(table, "gaps", "share missing", rows, COLUMNS, 4.6)
    for panel, where in zip(panels[0], COLUMNS.values(), strict=True):
        part = table.rows
        for axis, value in where.items():
            part = part[part[axis] == value]
        could = part.groupby("gaps")["could"].mean()
        panel.plot(could.index, could, color=LOOKS["bound"].colour, linestyle="--", label="three markers seen")
    panels[0, 0].set_ylim(0.0, 1.03)
    keyed(made, table, panels[0], ncols=4)
    return made
