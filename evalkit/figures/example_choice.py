"""Choosing from the rough shapes alone which expressions to sculpt, against drawing them at random.

Error of all vertices of the whole set, what is sculpted being exact, over that of the rough shapes; 95 % intervals over
the draws. A choice has no draw: its interval is that of the characters' strengths, or has no width.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.grid import Row, grid
from evalkit.figures.style import keyed, look
from evalkit.figures.table import Table

NAME = "example-choice"
STUDY = "example-choice"


def draw(table: Table) -> Any:
    """The figure."""
    pairs = dict.fromkeys(zip(table.rows["character"], table.rows["transfer"], strict=True))
    columns = {
        f"{character},\n{look(transfer).name}": {"character": character, "transfer": transfer}
        for character, transfer in pairs
    }
    rows = (Row("whole set over rough", "error over that of rough shapes", log=False),)
    made, panels = grid(table, "examples", "sculpted examples", rows, columns, 2.7)
    keyed(made, table, panels.ravel(), ncols=2)
    return made
