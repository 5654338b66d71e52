"""The photo as the texture of a fitted head: skin, eyes, ears and the plate with the hair.

The head keeps its own texture coordinates; each pixel of the texture takes the photo's colour at the place where it is
seen along z, which is what orthographic texture coordinates would show. That leaves room for what a photo does not
have: the inside of the mouth, lids that close, hair behind the mask. The picture is half as high again as the head's
own; the upper third holds the plate, the right eye and both ears.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evalkit.head.mesh import triangle_normals
from evalkit.head.model import Head, Indices
from evalkit.head.photo import Photo
from evalkit.head.photo_cutout import doubled, filled, foreground, sampled, silhouette
from evalkit.head.photo_warp import Similarity
from evalkit.head.texture import Array, mix, ramp

SKIN_LOWEST_V = 0.25
"""Heads of this package have their skin above this height of the picture, and tiles of other parts below."""

FINE_PX_PER_MM = 4.0
"""Photos that are finer get a picture of 2048 pixels instead of 1024, where the skin has about so many a millimetre."""

HAIR_MM = 75.0
"""Hair is looked for so far around the mask."""

SURE_MM = 12.0
"""What the mask covers is taken as head for sure only so far within its outline."""

NECK_MM = 25.0
"""So far aside from the middle of the chin the neck is sure to be there."""

OUTLINE = (
    "forehead", "brow outer left", "ear left", "jaw left", "chin", "jaw right", "ear right", "brow outer right",
)  # fmt: skip
"""Landmarks around the face, in order."""

SIDEWAYS = (0.05, 0.22)
"""Skin whose normal's part along the view is below the first is not taken from the photo, above the second it is."""

LASHES_MM = 2.0
"""The upper lid takes its colour from so much above its edge: the lashes would be drawn out when it closes."""

CLEAR_MM = 2.5
"""The plate is painted over behind the mask and so far beside it."""

FADING_MM = (-50.0, -5.0)
"""Heights above the chin between which the plate fades out: below hang collars and not only hair."""

PLATE_ALONG = 0.75
"""Part of the picture's width that the plate takes."""


def textured(head: Head, photo: Photo, view: Similarity, places: dict[str, Array]) -> Head:
    """The head with the photo on it, seen along z.

    Parameters
    ----------
    head : Head
        Fitted to the photo.
    photo : Photo
    view : Similarity
        Head to photo.
    places : dict of str to ndarray, shape (2,), pixels
        Points in the photo; inner lips and pupils are used where they are there.
    """
    assert head.uv is not None and head.texture is not None
    from PIL import Image

    size = 2048 if view.pixels_per_mm * photo.scale >= FINE_PX_PER_MM else 1024
    picture = np.zeros((size + size // 2, size, 4), dtype=np.float32)
    picture[size // 2 :] = np.asarray(Image.fromarray(head.texture).resize((size, size), Image.Resampling.BICUBIC))
    picture[: size // 2, :, 3] = 255.0
    look = Look(head, photo, view)
    head, plate = _with_plate(head, look, size)
    picture[: size // 2, : plate.shape[1]] = plate
    assert head.uv is not None
    uv = head.uv.copy()
    uv[:, 1] *= 2.0 / 3.0
    if "plate" in head.parts:
        which = head.part_vertices("plate")
        uv[which] = head.uv[which] * [PLATE_ALONG, 1.0 / 3.0] + [0.0, 2.0 / 3.0]
    _paint_skin(picture[size // 2 :], head, look, _shifts(head, look, places))
    _paint_eyes(picture, uv, head, look, places)
    _paint_ears(picture, uv, head, look)
    return replace(head, uv=uv, texture=np.clip(np.rint(picture), 0, 255).astype(np.uint8))


class Look:
    """The photo in the head's plane: colours at places, and how surely they are of the head.

    Parameters
    ----------
    head : Head
    photo : Photo
    view : Similarity
    """

    def __init__(self, head: Head, photo: Photo, view: Similarity) -> None:
        self.photo, self.view = photo, view
        mask = head.part_triangles("skin", "lids", "ears")
        self.triangles = head.vertices[mask][..., :2]
        reach = np.array([HAIR_MM, HAIR_MM])
        self.low = self.triangles.min(axis=(0, 1)) - reach * [1.0, 0.0]
        self.high = self.triangles.max(axis=(0, 1)) + reach
        self.face = np.array([head.landmarks[name][:2] for name in OUTLINE if name in head.landmarks])
        self.nose, self.chin = float(head.landmarks["nose tip"][1]), head.landmarks["chin"]
        self.share = self._head_share((160, round(160 * (self.high - self.low)[0] / (self.high - self.low)[1])))

    def colours(self, places: Array, pixels_per_mm: float) -> Array:
        """Colours (..., 3) at places (..., 2 or 3), mm, of which a picture has so many pixels a millimetre."""
        finer = self.view.pixels_per_mm * self.photo.scale / pixels_per_mm
        return sampled(self.photo.pixels, self.view.to_photo(places) * self.photo.scale, 0.4 * (finer - 1.0))

    def belongs(self, places: Array) -> Array:
        """How surely places (..., 2 or 3), mm, show the head and not what is behind it, 0 to 1."""
        from scipy.ndimage import map_coordinates

        height, width = self.share.shape
        unit = (places[..., :2] - self.low) / (self.high - self.low)
        at = [(1.0 - unit[..., 1]) * height - 0.5, unit[..., 0] * width - 0.5]
        return np.asarray(map_coordinates(self.share, at, order=1, mode="nearest"))

    def grid(self, shape: tuple[int, int]) -> Array:
        """Places (H, W, 2), mm, of the pixels of a picture of the whole rectangle."""
        height, width = shape
        unit = np.stack(np.meshgrid((np.arange(width) + 0.5) / width, 1.0 - (np.arange(height) + 0.5) / height), -1)
        return np.asarray(self.low + unit * (self.high - self.low))

    def _head_share(self, shape: tuple[int, int]) -> Array:
        from matplotlib.path import Path
        from scipy.ndimage import distance_transform_edt

        per_mm = shape[0] / float((self.high - self.low)[1])
        covered = silhouette(self.triangles, self.low, self.high, shape)
        places = self.grid(shape)
        # Beside jaw and neck the mask is wider than many a head: there only the face within its points is sure.
        face = Path(self.face).contains_points(places.reshape(-1, 2)).reshape(shape)
        neck = np.abs(places[..., 0] - self.chin[0]) < NECK_MM
        seen = self.view.to_photo(places)
        in_photo = ((seen >= 0) & (seen <= self.photo.size)).all(axis=-1)
        depth = distance_transform_edt(covered) / per_mm
        away = distance_transform_edt(~covered) / per_mm
        below = places[..., 1] < self.chin[1]
        inside = in_photo & (((depth > SURE_MM) & (places[..., 1] > self.nose)) | face | (neck & below & covered))
        outside = ~in_photo | (away > HAIR_MM - 4.0) | (below & (away > 0.3 * HAIR_MM))
        share = foreground(self.colours(places, per_mm), inside, outside & ~inside)
        return np.asarray(np.where(in_photo, ramp(share, 0.4, 0.6), 0.0))


# ---- plate -----------------------------------------------------------------------------------------------------


def _with_plate(head: Head, look: Look, size: int) -> tuple[Head, Array]:
    """The head with its plate as large as the hair, the plate's texture coordinates within it, and its picture."""
    from scipy.ndimage import binary_fill_holes, distance_transform_edt, gaussian_filter

    shape = (size // 2, round(PLATE_ALONG * size))
    places = look.grid(shape)
    per_mm = float(np.mean(np.array(shape[::-1]) / (look.high - look.low)))
    colours, share = look.colours(places, per_mm), look.belongs(places)
    covered = binary_fill_holes(silhouette(look.triangles, look.low, look.high, shape))
    # The skin's own edge must not be seen beside the mask a second time.
    clear = (distance_transform_edt(~covered) / per_mm > CLEAR_MM).astype(np.float64)
    painted = filled(colours, clear * ramp(share, 0.5, 0.9))
    nearest = distance_transform_edt(clear == 0, return_distances=False, return_indices=True)
    behind = gaussian_filter(share[tuple(nearest)], 4.0 * per_mm)
    opacity = np.where(clear > 0, share, behind)
    shown = np.where(clear[..., None] > 0, share[..., None] * colours + (1 - share[..., None]) * painted, painted)
    edge = np.minimum.reduce(
        [places[..., 0] - look.low[0], look.high[0] - places[..., 0], look.high[1] - places[..., 1]]
    )
    opacity *= ramp(edge, 2.0, 12.0) * ramp(places[..., 1] - look.chin[1], *FADING_MM)
    if "plate" in head.parts and head.uv is not None:
        which = head.part_vertices("plate")
        vertices, uv = head.vertices.copy(), head.uv.copy()
        unit = (vertices[which, :2] - vertices[which, :2].min(axis=0)) / np.ptp(vertices[which, :2], axis=0)
        # Not to the last pixel: pictures repeat, and what lies at the other end would show as a line.
        unit = 0.003 + 0.994 * unit
        vertices[which, :2] = look.low + unit * (look.high - look.low)
        uv[which] = unit
        head = replace(head, vertices=vertices, uv=uv)
    return head, np.dstack([shown, 255.0 * opacity])


# ---- skin ------------------------------------------------------------------------------------------------------


def _paint_skin(picture: Array, head: Head, look: Look, shifts: Array) -> None:
    """The photo on skin and lids; the picture's own colours stay within the openings."""
    from scipy.ndimage import gaussian_filter

    assert head.uv is not None
    size = picture.shape[1]
    rows = round((1.0 - SKIN_LOWEST_V) * size)
    skin = head.part_triangles("skin", "lids")
    used = np.unique(skin)
    normals = np.zeros_like(head.vertices)
    for corner in skin.T:
        np.add.at(normals, corner, triangle_normals(head.vertices, skin))
    facing = normals[used, 2] / np.maximum(np.linalg.norm(normals[used], axis=1), 1e-9)
    values = np.column_stack([head.vertices[used, :2] + shifts[used], facing, _lid_share(head)[used]])
    # Places change slowly over the texture: every other pixel is enough.
    half = (np.arange(size // 2) + 0.5) / (size // 2)
    found = _spread_in_plane(head.uv[used], values, np.stack(np.meshgrid(half, 1.0 - half[: rows // 2]), axis=-1))
    known = np.isfinite(found[..., 0])
    found = filled(np.nan_to_num(found), known.astype(np.float64))
    found = doubled(found)
    places, facing, lid = found[..., :2], found[..., 2], found[..., 3]
    colours = look.colours(places, size / 1024 * FINE_PX_PER_MM)
    # A little trust in much background would outweigh all else around it.
    trusted = ramp(ramp(facing, *SIDEWAYS) * look.belongs(places), 0.5, 0.9)
    colours = filled(colours, trusted)
    mix(colours, 0.3 * colours.mean(axis=(0, 1)), 0.7 * ramp(lid, 0.82, 0.97))
    opening = silhouette(
        head.uv[head.part_triangles("mouth pocket")], np.array([0.0, SKIN_LOWEST_V]), np.ones(2), (rows, size)
    )
    inside = gaussian_filter(opening.astype(np.float32), size / 1024)[..., None] * opening[..., None]
    picture[:rows, :, :3] = colours + inside * (picture[:rows, :, :3] - colours)


def _spread_in_plane(places: Array, values: Array, wanted: Array) -> Array:
    """Values (N, K) at places (N, 2) interpolated linearly at others (..., 2); NaN outside of their convex hull."""
    from matplotlib.path import Path
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import ConvexHull

    # For what lies outside SciPy tries every triangle: a tenth of the places would take nearly all of the time.
    outline = Path(places[ConvexHull(places).vertices])
    inside = outline.contains_points(wanted.reshape(-1, 2)).reshape(wanted.shape[:-1])
    out = np.full((*wanted.shape[:-1], values.shape[1]), np.nan)
    out[inside] = LinearNDInterpolator(places, values)(wanted[inside])
    return out


def _lid_share(head: Head) -> Array:
    """From the crease (0) to the edge (1) of the upper lids, 0 elsewhere, (V,)."""
    out = np.zeros(len(head.vertices))
    if head.lids is None:
        return out
    for eye in (0, 1):
        moving = np.flatnonzero((head.lids.eye == eye) & (head.lids.turn > 0.01))
        x, turn = head.vertices[moving, 0], head.lids.turn[moving]
        # The edge of each column is what turns most within a millimetre.
        edge = np.array([turn[np.abs(x - here) < 1.0].max() for here in x])
        out[moving] = turn / edge
    return out


def _shifts(head: Head, look: Look, places: dict[str, Array]) -> Array:
    """By how much, mm, vertices look aside (V, 2): lids above their lashes, lips at the photo's lips."""
    out = np.zeros((len(head.vertices), 2))
    view = look.view
    # A coarse photo has the lashes' dark in the pixels around them, too.
    out[:, 1] = (LASHES_MM + 1.0 / (view.pixels_per_mm * look.photo.scale)) * _lid_share(head)
    if "upper lip inner" in places and "lower lip inner" in places and "mouth pocket" in head.parts:
        edge = np.intersect1d(head.part_vertices("skin"), head.part_vertices("mouth pocket"))
        for lip in ("upper lip", "lower lip"):
            inner = view.to_head(places[f"{lip} inner"])
            _shift_lip(out, head, head.regions[lip], edge, head.landmarks[lip], inner)
    return out


def _shift_lip(out: Array, head: Head, lip: Indices, edge: Indices, border: Array, inner: Array) -> None:
    """Let a lip's vertices look where the photo's lip is: from its border, which stays, to its inner edge.

    The inner edge is a parabola through the corners of the mouth and the point in its middle.
    """
    ends = np.array([head.landmarks["mouth corner right"], head.landmarks["mouth corner left"]])
    order = edge[np.argsort(head.vertices[edge, 0])]
    line = np.interp(head.vertices[lip, 0], head.vertices[order, 0], head.vertices[order, 1])
    across = (head.vertices[lip, 0] - ends[:, 0].mean()) / (0.5 * np.ptp(ends[:, 0]))
    taper = np.clip(1.0 - across**2, 0.0, 1.0)
    into = np.sign(border[1] - inner[1]) * INTO_LIP_MM * np.sqrt(taper)
    middle = float(np.interp(border[0], head.vertices[order, 0], head.vertices[order, 1]))
    thick = np.maximum(np.abs(border[1] - middle) * taper, 1e-6)
    share = np.clip(1.0 - np.abs(head.vertices[lip, 1] - line) / thick, 0.0, 1.0)
    level = np.interp(head.vertices[lip, 0], ends[:, 0], ends[:, 1])
    seen = level + (inner[1] - ends[:, 1].mean()) * taper
    out[lip, 1] += share * (seen - line + into) * (taper > 0)


# ---- eyes and ears ---------------------------------------------------------------------------------------------

IRIS_MM = 5.9
"""Half of the 11.8 mm that the visible iris measures across in adults (Rufer, Schroder & Erb, Cornea 24, 2005,
doi:10.1097/01.ico.0000148312.01805.53)."""

INTO_LIP_MM = 1.2
"""The edge of a lip takes its colour from so much inside it: beside it are teeth, or the dark between the lips."""

PUPIL_SHARE = 0.36


def _paint_eyes(picture: Array, uv: Array, head: Head, look: Look, places: dict[str, Array]) -> None:
    """Eyeballs: the photo within the opening of the lids, around it an eye in its colours."""
    from matplotlib.path import Path
    from scipy.interpolate import CubicSpline
    from scipy.ndimage import distance_transform_edt

    if head.lids is None or "eyeballs" not in head.parts:
        return
    size = picture.shape[1]
    tile = size // 4
    balls = head.part_vertices("eyeballs")
    right = balls[head.vertices[balls, 0] < 0]
    uv[right] += [0.75, 5.0 / 6.0]
    unit = (np.arange(tile) + 0.5) / tile * 0.25 - 0.125
    u, v = np.meshgrid(unit, -unit)
    polar, around = np.hypot(u, v) / 0.118 * np.pi, np.arctan2(v, u)
    for eye, side in enumerate(("left", "right")):
        centre, radius = head.lids.centres[eye], head.lids.radius
        aside = radius * np.sin(np.minimum(polar, np.pi / 2))
        at = centre[:2] + np.stack([aside * np.cos(around), aside * np.sin(around)], axis=-1)
        names = ("eye inner", "upper lid inner", "upper lid outer", "eye outer", "lower lid outer", "lower lid inner")
        corners = np.array([head.landmarks[f"{name} {side}"][:2] for name in names])
        outline = CubicSpline(np.arange(7), np.vstack([corners, corners[:1]]), bc_type="periodic")(
            np.linspace(0, 6, 61)
        )
        open_here = (Path(outline).contains_points(at.reshape(-1, 2)).reshape(tile, tile)) & (polar < 1.4)
        if not open_here.any():
            continue
        colours = look.colours(at, tile / 0.25 * 0.118 / (np.pi * radius))
        middle = view_place(look, places, f"pupil {side}", centre)
        off = np.linalg.norm(at - middle, axis=-1) + 100.0 * (polar > np.pi / 2)
        made = _eye(colours, open_here, off, polar)
        # Lids and lashes throw their shadow over the rim: the photo there is no eye.
        per_mm = tile / 0.25 * 0.118 / (np.pi * radius)
        within = ramp(distance_transform_edt(open_here) / per_mm, 0.3, 1.3)[..., None]
        made += within * (colours - made)
        rows, left = (slice(-tile, None), 0) if eye == 0 else (slice(0, tile), 3 * tile)
        picture[rows, left : left + tile, :3] = made


def view_place(look: Look, places: dict[str, Array], name: str, otherwise: Array) -> Array:
    """Where a point of the photo is in the head's plane, (2,), mm."""
    return look.view.to_head(places[name]) if name in places else otherwise[:2]


def _eye(colours: Array, open_here: NDArray[np.bool_], off: Array, polar: Array) -> Array:
    """A whole eye in the colours of what is seen of it; ``off`` is the distance from the pupil's middle, mm."""
    light = colours.sum(axis=-1)
    ring = open_here & (off > 0.5 * IRIS_MM) & (off < 0.85 * IRIS_MM)
    white = open_here & (off > 1.25 * IRIS_MM)
    iris = np.median(colours[ring], axis=0) if ring.any() else np.array([90.0, 64.0, 40.0])
    # The upper half of the light ones: the rest lies in the shade of the lids.
    bright = white & (light >= np.median(light[white])) if white.any() else white
    sclera = np.median(colours[bright], axis=0) if bright.any() else np.array([215.0, 208.0, 202.0])
    made = np.empty_like(colours)
    made[:] = sclera
    mix(made, sclera * [0.96, 0.72, 0.68], 0.55 * ramp(np.rad2deg(polar), 45.0, 80.0))
    mix(made, iris, 1.0 - ramp(off, 0.93 * IRIS_MM, 1.05 * IRIS_MM))
    mix(made, 0.4 * iris, 0.6 * np.exp(-0.5 * ((off - 0.95 * IRIS_MM) / (0.07 * IRIS_MM)) ** 2))
    mix(made, np.array([14.0, 10.0, 9.0]), 1.0 - ramp(off, 0.9 * PUPIL_SHARE * IRIS_MM, 1.1 * PUPIL_SHARE * IRIS_MM))
    return made


def _paint_ears(picture: Array, uv: Array, head: Head, look: Look) -> None:
    """Ears that are parts of their own: the photo straight from the front, one tile for each."""
    if "ears" not in head.parts:
        return
    tile = picture.shape[1] // 8
    ears = head.part_vertices("ears")
    for k, mine in enumerate((ears[head.vertices[ears, 0] > 0], ears[head.vertices[ears, 0] < 0])):
        low, high = head.vertices[mine, :2].min(axis=0), head.vertices[mine, :2].max(axis=0)
        margin = 0.03 * (high - low)
        low, high = low - margin, high + margin
        uv[mine] = (head.vertices[mine, :2] - low) / (high - low) * [0.125, 1.0 / 6.0] + [0.75 + 0.125 * k, 2.0 / 3.0]
        unit = np.stack(np.meshgrid((np.arange(tile) + 0.5) / tile, 1.0 - (np.arange(2 * tile) + 0.5) / (2 * tile)), -1)
        at = low + unit * (high - low)
        colours, share = look.colours(at, tile / float((high - low)[0])), look.belongs(at)
        rows, left = slice(2 * tile, 4 * tile), 6 * tile + k * tile
        picture[rows, left : left + tile, :3] = filled(colours, ramp(share, 0.5, 0.9))
