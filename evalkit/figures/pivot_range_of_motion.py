"""Error of the pivot against the Cramér-Rao bound over the head's range of motion.

As in the figure over noise, with 0.3 mm of noise; the range is the largest angle to either side. Grey: other
packages.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.pivot_noise import against_bound
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "pivot-range-of-motion"
STUDY = "pivot-range-of-motion"
SMALL = Budget(seeds=3)


def draw(table: Table) -> Any:
    """The figure."""
    return against_bound(table, "range_deg", "range of motion, deg")
