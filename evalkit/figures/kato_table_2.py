"""Errors of an animation of 270 frames by fourteen transferred blendshapes, beside Table 2 of Kato et al. (2014).

Root mean square over all vertices and frames, four examples that are none of the fourteen, mean over the seeds; (a) in
cm where the inner corners of the eyes are 50 cm apart, (b) over the rough shapes. The darker, the more of the error is
left. The first column is the paper's own character and animation, with rough shapes by Deformation Transfer, as those
between two artists are here; those of the other characters are the face's own shapes before its sculptor.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.character_transfer_tables import error_table
from evalkit.figures.table import Table

NAME = "kato-table-2"
STUDY = "transfer-animation"

PAPER_CM = {"rough": 1.032, "character transfer": 0.726}


def draw(table: Table) -> Any:
    """The figure."""
    return error_table(table, PAPER_CM, 2.5)
