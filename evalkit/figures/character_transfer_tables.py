"""A table of methods and characters: errors as numbers, in the paper's unit and over those of rough shapes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from evalkit.figures.style import PAGE_IN, canvas, heat, lettered, look, looked
from evalkit.figures.table import Table

ROUGH = "rough"
PANELS = {"all": "rms error of all vertices, cm", "all over rough": "the same over that of rough shapes"}
PAPER = "Kato et al."


def error_table(table: Table, paper_cm: Mapping[str, float], height_in: float) -> Any:
    """Means over the seeds; the first column is what the paper has, on a face and examples of its own."""
    characters = list(dict.fromkeys(table.rows["character"]))
    methods = looked(table.methods)
    names = [PAPER, *map(str, characters)]
    made, panels = canvas(PAGE_IN, height_in, ncols=2, sharey=True)
    for panel, (statistic, label) in zip(panels, PANELS.items(), strict=True):
        base = paper_cm[ROUGH] if statistic != "all" else 1.0
        values = np.full((len(methods), 1 + len(characters)), np.nan)
        for i, method in enumerate(methods):
            values[i, 0] = paper_cm.get(method, np.nan) / base
            for j, character in enumerate(characters, start=1):
                found = table.of(statistic, method, character=character)["value"]
                values[i, j] = found.iloc[0] if len(found) else np.nan
        rough = values[methods.index(ROUGH)]
        heat(panel, values, [look(method).name for method in methods], names,
             np.clip(values / rough, 0.0, 1.2) / 1.2)  # fmt: skip
        panel.set_xticks(panel.get_xticks(), names, rotation=60, ha="right", rotation_mode="anchor")
        panel.axvline(1.0, color="black", linewidth=0.8)
        panel.set_title(label)
        panel.set_xlabel("character")
    panels[0].set_ylabel("method")
    lettered(panels)
    return made
