"""Choosing from the rough shapes alone which expressions to sculpt, against drawing them at random.

Error of all vertices of the whole set, what is sculpted being exact, over that of the rough shapes; 95 % intervals over
the draws. A choice has no draw: its interval is that of the characters' strengths, or has no width.
"""

from __future__ import annotations

from textwrap import fill
from typing import Any

from evalkit.figures.style import PAGE_IN, at_values, canvas, curve, keyed, lettered, looked
from evalkit.figures.table import Table

NAME = "example-choice"
STUDY = "example-choice"


def draw(table: Table) -> Any:
    """The figure."""
    rows = table.rows
    characters, transfers = (list(dict.fromkeys(rows[axis])) for axis in ("character", "transfer"))
    made, panels = canvas(
        PAGE_IN, 1.0 + 1.4 * len(transfers), nrows=len(transfers), ncols=len(characters), sharex=True, sharey="row",
        squeeze=False,
    )  # fmt: skip
    for line, transfer in zip(panels, transfers, strict=True):
        for panel, character in zip(line, characters, strict=True):
            at_values(panel, rows["examples"])
            for method in looked(table.methods):
                found = table.of("whole set over rough", method, character=character, transfer=transfer)
                curve(panel, found, "examples", method)
        line[0].set_ylabel(fill(f"{transfer}, over rough", 18))
    for panel, character in zip(panels[0], characters, strict=True):
        panel.set_title(str(character))
    for panel in panels[-1]:
        panel.set_xlabel("sculpted examples")
    lettered(panels.ravel())
    keyed(made, table, panels.ravel(), ncols=2)
    return made
