"""What scene figures share: the built-in head, and rows to places and back."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

from evalkit.geometry import Array
from evalkit.head import Head, load_head

if TYPE_CHECKING:
    import pandas as pd

XYZ = ("x_mm", "y_mm", "z_mm")


@cache
def built_in_head() -> Head:
    """The template at its own resolution, made once for all figures."""
    return load_head()


def place_rows(places: Mapping[str, Array], **others: Any) -> list[dict[str, Any]]:
    """A row for each place (3,), mm, to a thousandth: label, x_mm, y_mm, z_mm, and what is the same for all."""
    return [
        {**others, "label": label, **{axis: round(float(v), 3) for axis, v in zip(XYZ, place, strict=True)}}
        for label, place in places.items()
    ]


def places(rows: pd.DataFrame) -> dict[str, Array]:
    """Label to place (3,), mm, of such rows."""
    return dict(zip(rows["label"], rows[list(XYZ)].to_numpy(dtype=float), strict=True))
