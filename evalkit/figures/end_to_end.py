"""From a video to every vertex of a head: what is left of the error, and which step it comes from.

Root mean square errors over the motion in truth, of (a) all vertices of the skin that move and (b) the height between
the lips in mm, for each filmed head with a database of its own motion, with 95 % intervals over videos. Grey: the head
at rest, which is 1 in (a) by definition. The lighter bar: the same chain with a database of another performer's motion.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.style import ORANGE, PAGE_IN, reach
from evalkit.figures.table import Table
from evalkit.render.colours import BLUE, GREEN, GREY, SKY, VERMILION

NAME = "end-to-end"
STUDY = "end-to-end"

BARS: dict[tuple[str, str | None], tuple[str, str]] = {
    ("rest", None): ("head at rest", GREY),
    ("points alone", None): ("19 tracked points alone", ORANGE),
    ("whole chain", "own"): ("whole chain", BLUE),
    ("whole chain", "another's"): ("another's database", SKY),
    ("true points", "own"): ("true 19 points", GREEN),
    ("true markers", "own"): ("true markers", VERMILION),
}
"""Method and database, if it needs one -> its name and colour, from what knows nothing to what knows most."""

PANELS = {
    "over rest": ("(a) skin", "error over motion"), "lip opening": ("(b) lip opening", "error, mm"),
}  # fmt: skip


def draw(table: Table) -> Any:
    """The figure."""
    from matplotlib.figure import Figure

    made = Figure(figsize=(PAGE_IN, 2.6), layout="constrained")
    heads = list(dict.fromkeys(table.rows["head"]))
    for axes, (statistic, (title, what)) in zip(made.subplots(1, len(PANELS)), PANELS.items(), strict=True):
        width = 0.84 / len(BARS)
        for k, ((method, database), (label, colour)) in enumerate(BARS.items()):
            where = {} if database is None else {"database": database}
            found = table.of(statistic, method=method, rows=int(table.rows["rows"].iloc[0]), **where)
            found = found.set_index("head").reindex(heads)
            at = np.arange(len(heads)) + (k - 0.5 * (len(BARS) - 1)) * width
            axes.bar(at, found["value"], 0.94 * width, color=colour, label=label)
            axes.errorbar(at, found["value"], reach(found), color="black", linestyle="", elinewidth=0.7)
        axes.set_xticks(range(len(heads)), [head.replace("-", "\n", 1) for head in heads])
        axes.set_title(title)
        axes.set(xlabel="filmed head", ylabel=what)
        axes.set_ylim(bottom=0.0)
        axes.grid(axis="x", visible=False)
    handles, labels = axes.get_legend_handles_labels()
    made.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7)
    return made
