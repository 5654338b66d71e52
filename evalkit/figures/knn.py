"""How many of the hundred nearest windows searches find, and how fast.

Recall over queries a second, one line a search, one sign for every size of the database, the largest marked by a ring:
(a) a database in which nothing comes twice, (b) one sentence again and again. (c) Recall along the stream in the
largest database of (a), of those that do not find all. Dotted: 0.9. Speeds are wall-clock time of one thread, one
query after the other, in one run.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.style import PAGE_IN, canvas, keyed, lettered, look, looked, plain_log
from evalkit.figures.table import Table
from evalkit.render.colours import BLACK
from evalkit.studies.knn import BLOCKS

NAME = "knn"
STUDY = "knn"
LIMIT = 0.9


def draw(table: Table) -> Any:
    """The figure."""
    rows = table.rows[table.rows["status"] == "ok"]
    # The study's first number of neighbours is the one that all sizes are measured with.
    rows = rows[rows["nearest"] == rows["nearest"].iloc[0]]
    kinds, methods = list(dict.fromkeys(rows["database"])), looked(list(dict.fromkeys(rows["method"])))
    largest = rows["windows"].max()
    made, panels = canvas(PAGE_IN, 3.1, ncols=len(kinds) + 1, sharey=True)
    ends = rows["queries_per_second"].dropna()
    for panel, kind in zip(panels, kinds, strict=False):
        for method in methods:
            part = rows[(rows["database"] == kind) & (rows["method"] == method)]
            found = part.groupby("windows")[["queries_per_second", "recall"]].mean()
            how = look(method)
            panel.plot(
                found["queries_per_second"], found["recall"], label=how.name, color=how.colour, marker=how.marker,
                linestyle=how.line,
            )  # fmt: skip
            if largest in found.index:
                panel.plot(*found.loc[largest], "o", markersize=8, markerfacecolor="none", color=how.colour)
        plain_log(panel.xaxis, 0.7 * ends.min(), 1.4 * ends.max())
        panel.set_xlabel("queries a second")
        panel.set_title(f"{kind} database", loc="right")
    along = rows[(rows["database"] == kinds[0]) & (rows["windows"] == largest)]
    at = (np.arange(BLOCKS) + 0.5) / BLOCKS * along["frames"].max()
    for method in methods:
        part = along[along["method"] == method]
        how = look(method)
        if len(part) and part["recall"].min() < 1.0:
            values = part[[f"recall_{k + 1}" for k in range(BLOCKS)]].mean().to_numpy()
            panels[-1].plot(
                at, values, label=how.name, color=how.colour, marker=how.marker, linestyle=how.line, markersize=3.0
            )
    panels[-1].set_xlabel("frame of the stream")
    panels[-1].set_title(f"{kinds[0]}, {largest:,} windows", loc="right")
    for panel in panels:
        panel.axhline(LIMIT, color=BLACK, linestyle=":", linewidth=0.8)
        panel.set_ylim(0.0, 1.04)
    panels[0].set_ylabel("recall of the nearest windows")
    lettered(panels)
    keyed(made, table, panels, ncols=4)
    return made
