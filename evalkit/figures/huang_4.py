"""Points that are placed on a photo to fit the head to it, as Fig. 4 (b) of Huang et al.

The picture of the editor, Fig. 4 (a), is not among them.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.scenes import XYZ, built_in_head, place_rows, places
from evalkit.figures.table import Table
from evalkit.render.face_figures import feature_points

NAME = "huang-4"
COLUMNS = ("label", *XYZ)


def measure(budget: str) -> list[dict[str, Any]]:
    """The landmarks of the head."""
    return place_rows(built_in_head().landmarks)


def draw(table: Table) -> Any:
    """The figure."""
    return feature_points(built_in_head(), places(table.rows))
