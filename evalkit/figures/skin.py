"""Forehead skin that slides under the rigid markers.

Root mean square over the takes, 95 % intervals, over the slide when the brows work at full strength: expression error
above, below the leak score, the share of the head motion that the face explains beyond chance. 23 markers with three
rigid ones and 63 with seven; 0.3 mm of noise.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.grid import Row, grid
from evalkit.figures.style import keyed
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "skin"
STUDY = "skin"
SMALL = Budget(seeds=1, axes={"slide_mm": (0, 4)})

COLUMNS = {"23 markers": {"layout": "paper-23"}, "63 markers": {"layout": "dense-63"}}


def draw(table: Table) -> Any:
    """The figure."""
    rows = (Row("expression", "expression error, mm rms"), Row("leak", "leak score", log=False))
    made, panels = grid(table, "slide_mm", "slide of the skin, mm", rows, COLUMNS, 4.6, log_x=False)
    panels[1, 0].set_ylim(0.0, 1.0)
    keyed(made, table, panels[0])
    return made
