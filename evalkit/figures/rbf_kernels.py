"""Kernels of the deformation map, with one field for all vertices and with regions for the lips.

23 markers, without noise and with 0.5 mm of it: error of all moving vertices of the outer skin and of the lips, mm rms,
and frames in which the lips cross, %. Small: plus or minus half of the 95 % interval over the takes. A darker cell is
worse; errors and shares have colours of their own.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.style import PAGE_IN, canvas, heat, lettered, look, looked, shades
from evalkit.figures.table import Table
from evalkit.studies.dense_takes import KERNELS, STILL
from evalkit.studies.rbf_kernels import WITHOUT
from evalkit.study.description import Budget

NAME = "rbf-kernels"
STUDY = "rbf-kernels"
SMALL = Budget(seeds=1, axes={"head": ("template 3000",)})

STATISTICS = {
    "all moving": ("all skin, mm", "{:.2f}", True),
    "lips": ("lips, mm", "{:.2f}", True),
    "frames with crossed lips": ("lips crossed, %", "{:.0f}", False),
}
"""Statistic to its words, its digits, and whether its colours are logarithmic."""


def draw(table: Table) -> Any:
    """The figure."""
    kernels = looked([name for name in KERNELS if name in table.methods])
    kernels += [STILL] if STILL in table.methods else []
    noises = sorted(table.rows["noise_mm"].unique())
    made, panels = canvas(PAGE_IN, 5.4, ncols=len(STATISTICS), sharey=True, width_ratios=(1, 1, 0.8))
    for panel, (statistic, (words, digits, log)) in zip(panels, STATISTICS.items(), strict=True):
        parts = [(noise, end) for noise in noises for end in (WITHOUT, "")]
        values, reach = (np.full((len(kernels), len(parts)), np.nan) for _ in range(2))
        for row, kernel in enumerate(kernels):
            for column, (noise, end) in enumerate(parts):
                found = table.of(statistic, kernel if kernel == STILL else kernel + end, noise_mm=noise)
                if len(found):
                    entry = found.iloc[0]
                    values[row, column], reach[row, column] = entry["value"], (entry["high"] - entry["low"]) / 2
        heads = [f"{'one' if end else 'regions'}\n{noise:g} mm" for noise, end in parts]
        heat(panel, values, [_name(k) for k in kernels], heads, shades(values, log), digits, reach)
        panel.set_title(words)
        panel.set_xlabel("fields, noise of a marker")
    panels[0].set_ylabel("kernel")
    lettered(panels)
    return made


def _name(kernel: str) -> str:
    return kernel if kernel == STILL else look(kernel).name
