"""Errors of every way from rough to fine shapes, beside Table 1 of Kato et al. (2014).

Root mean square over all vertices of all new expressions, four examples, mean over the seeds; (a) in cm where the inner
corners of the eyes are 50 cm apart, (b) over the rough shapes. The darker, the more of the error is left. The first
column is the paper's own character, whose data are not public and whose rough shapes are by Deformation Transfer; here
they are the face's own shapes before its sculptor, the muzzles' carried over by the warp that made them. In the column
"linear" position deltas are right by construction.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.character_transfer_tables import error_table
from evalkit.figures.table import Table

NAME = "kato-table-1"
STUDY = "transfer-methods"

PAPER_CM = {"rough": 3.629, "hand-drawn regions": 0.764, "character transfer": 0.611}


def draw(table: Table) -> Any:
    """The figure."""
    return error_table(table, PAPER_CM, 3.1)
