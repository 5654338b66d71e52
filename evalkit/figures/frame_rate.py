"""Frames per second of an animated head, and where their time goes.

(a) Frames per second over the vertices of the head, for pictures of several sizes: deformed, uploaded, drawn and read
back (filled signs), and drawn and read back alone, the limit of the renderer (open). Textured, without multisampling;
the title names the renderer. Dashed: the 30 frames per second that Huang et al. (2000) report. (b) Median time of each
stage; lines reach up by what the 95th percentile of the drawing, the largest part, has over its median; above every
bar the size of the picture in pixels. One run.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.figures.style import LOOKS, ORANGE, PAGE_IN, at_values, canvas, lettered
from evalkit.figures.style import plain_log as log_axis
from evalkit.figures.table import Table
from evalkit.render.colours import BLUE, GREEN, SKY, VERMILION

NAME = "frame-rate"
STAGES = {"deform": BLUE, "upload": ORANGE, "render": SKY, "read_back": GREEN}
COLUMNS = (
    "vertices", "width", "status", "frames", "frames_per_second", "bare_frames_per_second",
    *(f"{stage}_ms_p50" for stage in STAGES), "render_ms_p95", "renderer",
)  # fmt: skip

PAPER_HZ = 30.0
"""Frames per second that Huang et al. (2000) report, for a texture of 1024 x 1024 on a Pentium III of 500 MHz."""

SIGNS = {0: (BLUE, "o"), 1: (VERMILION, "s"), 2: (GREEN, "^")}
"""Colour and sign of the first, second and third size."""


def measure(budget: str) -> list[dict[str, Any]]:
    """A row per resolution of the head and size of the picture.

    Raises
    ------
    EvalkitError
        If nothing can be drawn without a screen here.
    """
    from evalkit.render import benchmark
    from evalkit.render.offscreen import require_offscreen

    require_offscreen()
    vertices: tuple[int, ...] = benchmark.FULL_VERTICES if budget == "full" else (1_000, 5_000, 20_000)
    frames = benchmark.FULL_FRAMES if budget == "full" else 20
    wanted = benchmark.settings(vertices, benchmark.SIZES, (True,), (0,))
    return [{column: row[column] for column in COLUMNS} for row in benchmark.benchmark(wanted, frames)]


def draw(table: Table) -> Any:
    """The figure.

    Raises
    ------
    EvalkitError
        If no row has a rate.
    """
    rows = table.rows[table.rows["status"] == "ok"]
    if not len(rows):
        raise EvalkitError("frame-rate: in no row every frame was drawn; there is no rate to show")
    sizes, counts = sorted(rows["width"].unique()), sorted(rows["vertices"].unique())
    made, (a, b) = canvas(PAGE_IN, 3.3, ncols=2)
    at_values(a, counts)
    for k, size in enumerate(sizes):
        part = rows[rows["width"] == size].sort_values("vertices")
        colour, sign = SIGNS[k % len(SIGNS)]
        a.plot(part["vertices"], part["frames_per_second"], color=colour, marker=sign, label=f"{size} x {size}")
        a.plot(part["vertices"], part["bare_frames_per_second"], color=colour, marker=sign, linestyle=":",
               markerfacecolor="white", label=f"{size} x {size}, drawing alone")  # fmt: skip
        _stages(b, part, counts, k, len(sizes), int(size))
    a.axhline(PAPER_HZ, color=LOOKS["bound"].colour, linestyle="--", label="Huang et al. (2000)")
    rates = rows[["frames_per_second", "bare_frames_per_second"]]
    log_axis(a.yaxis, 0.7 * min(PAPER_HZ, rates.min(axis=None)), 1.4 * max(PAPER_HZ, rates.max(axis=None)))
    a.set_xlabel("vertices")
    a.set_ylabel("frames per second")
    a.set_title(str(rows["renderer"].iloc[0]).partition(" (")[0])
    b.set_xticks(range(len(counts)), [f"{count:g}" for count in counts])
    b.set_xlabel("vertices")
    b.set_ylabel("time of a frame, ms")
    lettered((a, b))
    for panel in (a, b):
        panel.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2)
    return made


def _stages(panel: Any, part: Any, counts: list[int], k: int, sizes: int, size: int) -> None:
    """One size's bars: the stages upon each other."""
    width = 0.8 / sizes
    at = np.array([counts.index(v) for v in part["vertices"]]) + width * (k - (sizes - 1) / 2)
    base = np.zeros(len(part))
    for stage, colour in STAGES.items():
        height = part[f"{stage}_ms_p50"].to_numpy(dtype=float)
        panel.bar(at, height, 0.9 * width, bottom=base, color=colour, label=None if k else stage.replace("_", " "))
        base += height
    late = (part["render_ms_p95"] - part["render_ms_p50"]).to_numpy(dtype=float)
    tops = base + late
    panel.errorbar(at, base, yerr=[np.zeros(len(at)), late], linestyle="", color=LOOKS["bound"].colour, elinewidth=0.8)
    for x, top in zip(at, tops, strict=True):
        panel.annotate(f"{size}", (x, top), xytext=(0, 1), textcoords="offset points", ha="center", va="bottom",
                       fontsize=5.5)  # fmt: skip
