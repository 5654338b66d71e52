"""Time of a frame of 360 x 288 pixels by stage, on one core, decoding included.

One bar a tracker, of the fastest of three rounds, median of the videos; the last is the whole: the pose, the 19
points and the fifteen parameters. Dotted: 60 frames a second. (a) The face in sight, and, where it was measured, (b)
away for two fifths of the video.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.style import ORANGE, PAGE_IN, canvas, lettered
from evalkit.figures.table import Table
from evalkit.render.colours import BLACK, BLUE, GREEN, GREY

NAME = "tracker-speed"
STUDY = "tracker-speed"
STAGES = {"read": ("decoding", GREY), "pose": ("pose", BLUE), "features": ("points", GREEN),
          "parameters": ("parameters", ORANGE)}  # fmt: skip
FLOOR_MS = 1000.0 / 60.0


def draw(table: Table) -> Any:
    """The figure."""
    rows = table.rows[table.rows["status"] == "ok"]
    cases = list(dict.fromkeys(rows["disturbed"]))
    methods = list(dict.fromkeys(rows["method"]))
    made, panels = canvas(PAGE_IN, 1.3 + 0.25 * len(methods), ncols=len(cases), sharey=True, squeeze=False)
    for panel, case in zip(panels[0], cases, strict=True):
        start = np.zeros(len(methods))
        for stage, (words, colour) in STAGES.items():
            part = rows[rows["disturbed"] == case].groupby("method")[f"{stage}_us"].median().reindex(methods)
            wide = 1e-3 * part.fillna(0.0).to_numpy(dtype=float)
            panel.barh(methods, wide, 0.6, left=start, color=colour, label=words)
            start += wide
        panel.axvline(FLOOR_MS, color=BLACK, linestyle=":", linewidth=0.8)
        panel.set_title("face in sight" if case == "nothing" else case)
        panel.set_xlabel("time of a frame, ms")
        panel.grid(visible=False, axis="y")
    panels[0, 0].invert_yaxis()
    panels[0, 0].set_ylabel("tracker")
    lettered(panels[0])
    handles, names = panels[0, 0].get_legend_handles_labels()
    made.legend(handles, names, loc="outside lower center", ncols=len(STAGES))
    return made
