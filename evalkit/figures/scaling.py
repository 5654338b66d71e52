"""Time and memory over the length of a take.

(a) Time of one run, (b) peak of the memory beyond the take itself, over the frames of a take of 23 markers, on one
core; grey: proportional to the frames. Each is the best of up to five runs, or one where a run takes seconds, so that
there are no intervals. Memory of short takes is a lower limit: what making the take had freed serves first, and where
nothing new was needed there is no sign.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.style import LOOKS, PAGE_IN, Look, at_values, canvas, keyed, lettered, plain_log
from evalkit.figures.table import Table
from evalkit.render.colours import GREY
from evalkit.study.description import Budget

NAME = "scaling"
STUDY = "scaling"
SMALL = Budget(
    seeds=1, axes={"frames": (1_000, 10_000)}, methods=("pose svd", "pivot svd", "pivot joint", "compensate"),
)  # fmt: skip

WORKS = {
    "pose svd": LOOKS["svd"]._replace(name="pose, SVD"),
    "pivot svd": LOOKS["svd"]._replace(name="pivot, SVD", line=":", marker="d"),
    "pivot score": LOOKS["score"]._replace(name="pivot, SCoRE"),
    "pivot joint": LOOKS["joint"]._replace(name="pivot, joint"),
    "compensate": Look("compensation", LOOKS["paper"].colour, "D"),
    "compensate auto": LOOKS["auto"]._replace(name="compensation, automatic weights"),
}


def draw(table: Table) -> Any:
    """The figure."""
    rows = table.rows[table.rows["status"] == "ok"]
    rows = rows.assign(seconds_whole=1e-6 * rows["us_per_frame"] * rows["frames"], peak=rows["peak_mb"])
    made, panels = canvas(PAGE_IN, 3.2, ncols=2)
    for panel, column, label in zip(panels, ("seconds_whole", "peak"), ("time, s", "memory, MB"), strict=True):
        at_values(panel, rows["frames"])
        shown = rows[rows[column] > 0]
        for method, how in WORKS.items():
            found = shown[shown["method"] == method].groupby("frames")[column].median()
            panel.plot(found.index, found, color=how.colour, marker=how.marker, linestyle=how.line, label=how.name)
        if len(shown):
            plain_log(panel.yaxis, 0.5 * shown[column].min(), 2.0 * shown[column].max())
            x = np.array([rows["frames"].min(), rows["frames"].max()], dtype=float)
            for start in np.geomspace(shown[column].min(), shown[column].max(), 4) / x[-1]:
                panel.plot(x, start * x, color=GREY, linewidth=0.5, alpha=0.6, zorder=0, label="proportional")
        panel.set_xlabel("frames")
        panel.set_ylabel(label)
    for panel in panels:
        ticks = panel.get_xticks()
        panel.set_xticks(ticks, [f"$10^{{{np.log10(t):.0f}}}$" if np.log10(t) % 1 < 1e-9 else f"{t:g}" for t in ticks])
    lettered(panels)
    keyed(made, table, (panels[0],), ncols=4)
    return made
