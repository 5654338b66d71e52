"""What scene figures share: the built-in head, and rows to places and back."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evalkit.figures.files import raster
from evalkit.geometry import Array
from evalkit.head import Head, load_head
from evalkit.head.model import Indices
from evalkit.render.face_maps import Camera

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 240
"""Of scenes that are put together with plots."""

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


def local_triangles(triangles: Indices, vertices: Indices) -> Indices:
    """Those triangles of which all corners are among some vertices, sorted, by their positions there."""
    inside = triangles[np.isin(triangles, vertices).all(axis=1)]
    return np.searchsorted(vertices, inside)


def close_up(axes: Axes, picture: NDArray[np.uint8], camera: Camera, bar_mm: float) -> None:
    """A picture from the front on axes in mm, below it a bar of this length; what is drawn beyond it is cut off."""
    half, half_x = camera.half_mm, camera.half_mm * picture.shape[1] / picture.shape[0]
    x, y = camera.middle[:2]
    axes.imshow(picture, extent=(x - half_x, x + half_x, y - half, y + half))
    axes.set(xlim=(x - half_x, x + half_x), ylim=(y - half, y + half), autoscale_on=False)
    axes.set_axis_off()
    left, low = x - half_x, y - 1.08 * half
    axes.plot([left, left + bar_mm], [low, low], "k-", linewidth=2.0, solid_capstyle="butt", clip_on=False)
    axes.text(left + 1.2 * bar_mm, low, f"{bar_mm:g} mm", va="center")


def printed(made: Figure) -> NDArray[np.uint8]:
    """A page of scenes as one picture."""
    return raster(made, DPI)
