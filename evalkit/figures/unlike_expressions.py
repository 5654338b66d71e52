"""Expressions that no example is like, and all others.

Error of all vertices over that of the rough shapes, learnt from a character's own four examples; 95 % intervals over
the seeds. Right of the dashed line a method does harm.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import PAGE_IN, canvas, dots, keyed, lettered, lines, looked
from evalkit.figures.table import Table

NAME = "unlike-expressions"
STUDY = "unlike-expressions"

PANELS = {"unlike": "unlike the examples", "others": "other expressions"}


def draw(table: Table) -> Any:
    """The figure."""
    characters = list(dict.fromkeys(table.rows["character"]))
    methods = [name for name in looked(table.methods) if name != "rough"]
    made, panels = canvas(PAGE_IN, 1.4 + 0.45 * len(characters), ncols=2, sharey=True, sharex=True)
    for panel, (part, title) in zip(panels, PANELS.items(), strict=True):
        for k, method in enumerate(methods):
            found = table.of("all over rough", method, expressions=part)
            dots(panel, found, "character", characters, method, 0.65 * (k / max(1, len(methods) - 1) - 0.5))
        lines(panel, characters)
        panel.axvline(1.0, color="black", linestyle="--", linewidth=0.8)
        panel.set_title(title)
        panel.set_xlabel("error over that of rough shapes")
    panels[0].set_ylabel("character")
    lettered(panels)
    keyed(made, table, (panels[0],), ncols=3)
    return made
