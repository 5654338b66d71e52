"""A head fitted to a photo whose truth is known, beside the same photo on an ellipsoid.

(a) The photo with its points: needed (orange), others (blue). The person is drawn by code: the built-in head with the
proportions of a real one. (b) to (d) The fitted head from 20 degrees to its right, the front and 20 degrees to its
left, (e) mouth open, (f) lids closed. (g) The control from where (d) is seen: the photo on the ellipsoid nearest to the
fitted head, which has no relief. The table holds how far each landmark of the fitted and of the unfitted head lies from
the person's, across the view and along it, after a similarity: a photo shows no depth.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from evalkit.figures.table import Table
from evalkit.geometry import Array
from evalkit.head import Head
from evalkit.head.fitting import fit_head
from evalkit.head.photo import Photo
from evalkit.head.points import LANDMARK_POINTS, REQUIRED, Points
from evalkit.render.colours import BLUE, VERMILION
from evalkit.render.face_figures import Image, beside, in_rows
from evalkit.render.head_views import BACKGROUND, View, draw_head
from evalkit.render.offscreen import offscreen_plotter
from evalkit.studies.persons import Person, landmarks_off_mm, person, portrait
from evalkit.studies.photo_fit import on_ellipsoid

NAME = "photo-fit"
OFF = tuple(f"{head}_{way}_mm" for head in ("fitted", "unfitted") for way in ("across", "along"))
COLUMNS = ("person", "name", "role", "x_px", "y_px", *OFF)
NUMBER = 7
"""Of the person: of the first twelve the one whose landmarks are furthest from the built-in head's."""

HEIGHT = 880
"""Of the figure, pixels: the photo, and two rows of views beside it."""

DOT = 6
"""Radius, pixels."""

VIEWS = (
    View(yaw_deg=-20.0, zoom=1.1), View(zoom=1.1), View(yaw_deg=20.0, zoom=1.1),
    View(jaw_deg=15.0, zoom=1.1), View(lids_closed=1.0, zoom=1.1),
)  # fmt: skip


def measure(budget: str) -> list[dict[str, Any]]:
    """A row for each point: where it is in the photo, and how far the landmark is from the truth in the end."""
    who = person(NUMBER)
    fitted = _fitted(who, who.points)
    off = dict(zip(LANDMARK_POINTS, _off(fitted, who), strict=True))
    return [
        {
            "person": NUMBER, "name": name, "role": "needed" if name in REQUIRED else "other",
            **{key: round(float(value), 3) for key, value in zip(("x_px", "y_px"), place, strict=True)},
            **dict(zip(OFF, off.get(name, [None] * len(OFF)), strict=True)),
        }
        for name, place in who.points.places.items()
    ]  # fmt: skip


def _off(fitted: Head, who: Person) -> list[list[float]]:
    """Per landmark, across and along the view, of the fitted and of the unfitted head."""
    both = (landmarks_off_mm(head, who) for head in (fitted, who.generic))
    parts = [np.column_stack([np.linalg.norm(off[:, :2], axis=1), np.abs(off[:, 2])]) for off in both]
    found: list[list[float]] = np.round(np.column_stack(parts), 3).tolist()
    return found


@cache
def _portrait(number: int) -> tuple[Person, Photo]:
    who = person(number)
    return who, portrait(who)


def _fitted(who: Person, points: Points, photo: Photo | None = None) -> Head:
    return fit_head(photo or portrait(who), points, who.generic)[0]


def draw(table: Table) -> Any:
    """The figure."""
    rows = table.rows
    who, photo = _portrait(int(rows["person"].iloc[0]))
    places = dict(zip(rows["name"], rows[["x_px", "y_px"]].to_numpy(dtype=float), strict=True))
    head = _fitted(who, Points(places), photo)
    seen = [*(_view(head, view) for view in VIEWS), _view(on_ellipsoid(head), VIEWS[2])]
    needed = rows["role"].to_numpy() == "needed"
    dotted = _with_points(photo, list(places.values()), needed)
    # Lettered as one of two rows, so that all letters are of one size.
    left = np.concatenate([beside(dotted[: HEIGHT // 2]), dotted[HEIGHT // 2 :]])
    return np.concatenate([left, in_rows(seen, 3, first=1)], axis=1)


def _view(head: Head, view: View) -> Image:
    with offscreen_plotter(HEIGHT // 2, HEIGHT // 2, border=False) as opened:
        plotter: Any = opened
        plotter.set_background(BACKGROUND)
        draw_head(plotter, head, view)
        plotter.render_window.SetMultiSamples(8)
        return np.asarray(plotter.screenshot(None, return_img=True))


def _with_points(photo: Photo, places: list[Array], needed: Any) -> Image:
    """The photo as high as the figure, with dots on it."""
    from PIL import Image as Pillow
    from PIL import ImageDraw

    scale = HEIGHT / photo.size[1]
    sheet = Pillow.fromarray(photo.pixels).resize((round(scale * photo.size[0]), HEIGHT), Pillow.Resampling.LANCZOS)
    for place, colour in zip(places, np.where(needed, VERMILION, BLUE), strict=True):
        ImageDraw.Draw(sheet).circle(tuple(scale * place), DOT, fill=str(colour), outline="white", width=2)
    return np.asarray(sheet)
