"""The fifteen control parameters of a video against those of the true vertices, by what moves.

Mean error over the frames that have a value, mean of the videos: (a) of the tracked head, (b) with the true pose.
Lengths in % of the face at rest, the place of the mouth in % of the distance between the eyes, angles in degrees. A
head that only turns or nods should change nothing. A darker cell is worse; lengths and angles have their own
colours.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.style import PAGE_IN, canvas, heat, lettered, shades
from evalkit.figures.table import Table

NAME = "control-parameters"
STUDY = "parameters"
SHOWN = ("tracked", "true pose")


def draw(table: Table) -> Any:
    """The figure."""
    rows = table.rows[table.rows["status"] == "ok"]
    methods = [method for method in SHOWN if method in set(rows["method"])]
    columns = [name for name in rows.columns if name.endswith(("_percent", "_deg")) and _is_parameter(name)]
    motions = list(dict.fromkeys(rows["motion"]))
    tables = [
        np.array([[rows[(rows["method"] == m) & (rows["motion"] == motion)][c].mean() for motion in motions]
                  for c in columns])
        for m in methods
    ]  # fmt: skip
    percent = np.array([name.endswith("_percent") for name in columns])
    both = np.stack(tables)
    colours = np.full_like(both, np.nan)
    for kind in (percent, ~percent):
        colours[:, kind] = shades(both[:, kind])
    made, panels = canvas(PAGE_IN, 3.8, ncols=len(methods), sharey=True, squeeze=False)
    for panel, method, values, tint in zip(panels[0], methods, both, colours, strict=True):
        heat(panel, values, [_words(name) for name in columns], motions, tint, "{:.1f}")
        panel.set_title(method)
        panel.set_xlabel("what moves")
    panels[0, 0].set_ylabel("parameter")
    lettered(panels[0])
    return made


def _is_parameter(column: str) -> bool:
    from evalkit.vision.parameters import NAMES

    return column.rpartition("_")[0] in NAMES


def _words(column: str) -> str:
    name, _, unit = column.rpartition("_")
    return f"{name.replace('_', ' ')}, {'%' if unit == 'percent' else 'deg'}"
