"""A character's expressions as sculpted, by Deformation Transfer, by Character Transfer and by local regression.

A face of very different proportions with a sculptor of its own, as the monkey in Fig. 5 of Kato et al. (2014): rough
shapes by Deformation Transfer from the built-in head with known correspondence, four other expressions to learn from.
Colours are the distance of each vertex from the sculpt; below each face its root mean square over all vertices, the
lining of the mouth included, in cm where the inner corners of the eyes are 50 cm apart and as a share of that distance.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.compared import columns, rows_of, sheet
from evalkit.figures.table import Table

NAME = "kato-5"
EXPRESSIONS = ("shout", "disgust")
"""One much like the examples, and one that they tell less of."""

COLUMNS = columns(EXPRESSIONS)


def measure(budget: str) -> list[dict[str, Any]]:
    """Shapes of two expressions."""
    return rows_of(EXPRESSIONS)


def draw(table: Table) -> Any:
    """The figure."""
    return sheet(table, EXPRESSIONS)
