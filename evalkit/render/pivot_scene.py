"""The head, its rigid markers and the pivot, as in Fig. 1(a) of Huang et al. (2000)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from evalkit.capture import Capture
from evalkit.capture.origin import screen_axes
from evalkit.compensation import Compensation
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.render import colours
from evalkit.render.markers import HEAD_MM, head_columns, median_places, position_columns
from evalkit.render.offscreen import offscreen_plotter

if TYPE_CHECKING:
    import pyvista

STANDARD_DEVIATIONS = 2.0
"""Half axes of the ellipsoid."""

LONGEST_MM = 150.0
"""Half axes of the ellipsoid are cut here: a longer one says "not known" and would only hide the head."""

THINNEST_MM = 2.0
"""A rod is drawn at least this thick, half of it, or it could not be seen."""

DOT_MM = 3.0
"""Radius of the dot at the pivot."""

MOST_LABELS = 12
"""More names than this cannot be read."""

FAR_MM = 600.0
"""A pivot further from the rigid markers is not drawn where it is, but as a line towards it."""


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """The pivot's uncertainty as it can be drawn.

    Attributes
    ----------
    axes : ndarray, shape (3, 3)
        Unit vectors as rows.
    half : ndarray, shape (3,), mm
        Half axes, :data:`STANDARD_DEVIATIONS` standard deviations, not above :data:`LONGEST_MM`.
    clipped : ndarray of bool, shape (3,)
        Half axes that were cut.
    """

    axes: Array
    half: Array
    clipped: np.ndarray


def pivot_ellipsoid(result: Compensation) -> Ellipsoid:
    """The covariance ellipsoid of the pivot, cut where it is larger than a head."""
    std = np.asarray(result.estimate.principal_std, dtype=np.float64)
    half = np.where(np.isnan(std), np.inf, STANDARD_DEVIATIONS * std)
    clipped = half > LONGEST_MM
    axes = np.asarray(result.estimate.principal_axes, dtype=np.float64)
    return Ellipsoid(axes, np.clip(half, THINNEST_MM if clipped.any() else 0.0, LONGEST_MM), clipped)


def ellipsoid_caption(result: Compensation) -> str:
    """What the drawn ellipsoid means, in words."""
    if pivot_is_far(result):
        return (
            f"The pivot lies {pivot_distance(result):.0f} mm from the rigid markers, outside the picture, and is not "
            "drawn; the lines point towards it."
        )
    shape = pivot_ellipsoid(result)
    words = f"Ellipsoid: {STANDARD_DEVIATIONS:g} standard deviations of the pivot."
    if shape.clipped.any():
        std = result.estimate.principal_std
        ends = [
            "not observable" if not np.isfinite(std[k]) else f"standard deviation {std[k]:.0f} mm"
            for k in np.flatnonzero(shape.clipped)
        ]
        words += (
            f" It is cut at ±{LONGEST_MM:.0f} mm along {'one axis' if len(ends) == 1 else f'{len(ends)} axes'} "
            f"({', '.join(dict.fromkeys(ends))}): the pivot may lie anywhere along the rod and beyond."
        )
    elif shape.half.max() < DOT_MM:
        words += f" It is smaller than the dot that marks the pivot ({2 * DOT_MM:.0f} mm)."
    return words


def pivot_distance(result: Compensation) -> float:
    """Distance of the pivot from the middle of the rigid markers, mm."""
    return float(np.linalg.norm(result.pivot - np.nanmean(result.template, axis=0)))


def pivot_is_far(result: Compensation) -> bool:
    """Whether the pivot is too far from the head to be drawn with it."""
    return not pivot_distance(result) <= FAR_MM


def pivot_as_drawn(result: Compensation) -> Array:
    """The pivot, or where a line towards one that is too far away ends."""
    if not pivot_is_far(result):
        return result.pivot
    centre = np.nanmean(result.template, axis=0)
    return centre + (result.pivot - centre) * (0.4 * FAR_MM / pivot_distance(result))


def pivot_scene_png(
    result: Compensation, path: str | Path, *, take: Capture | None = None, width: int = 1600, height: int = 800
) -> str:
    """Draw markers, rigid polygon and pivot from the front and from the side.

    Parameters
    ----------
    result : Compensation
    path : str or Path
        PNG to write.
    take : Capture, optional
        Where to take the screen axes and the kinds of points from; by default the compensated capture.
    width, height : int
        Pixels, for both views together.

    Returns
    -------
    str
        The caption: what is drawn, and what had to be cut.

    Raises
    ------
    EvalkitError
        If nothing can be drawn without a screen here, or the file cannot be written.
    """
    take = result.capture if take is None else take
    up, forward = screen_axes(take)
    left = np.cross(up, forward)
    content = _Content.of(take, result)
    views = (View("front", forward, up), View("from the right", -left, up))
    half = 1.2 * max(0.5 * content.spans(view).max() for view in views) + 10.0
    with offscreen_plotter(width, height, shape=(1, 2), border=False) as plotter:
        plotter.suppress_rendering = True  # every label would draw the whole picture anew
        for k, view in enumerate(views):
            plotter.subplot(0, k)
            _draw(plotter, content, view, half, height)
        plotter.suppress_rendering = False
        image = plotter.screenshot(None, return_img=True)
    import matplotlib.image

    try:
        matplotlib.image.imsave(path, np.ascontiguousarray(image))
    except OSError as error:
        raise EvalkitError(f"{path}: cannot write the picture ({error.strerror or error})") from error
    left_out = len(position_columns(take)) - len(content.rigid) - len(content.free)
    words = (
        f"Reference pose; {len(content.rigid)} rigid and {len(content.free)} other markers, both views on one scale. "
    )
    if left_out:
        words += f"{left_out} points further than {HEAD_MM:.0f} mm from the rigid markers are not drawn. "
    if result.chosen.weighted:
        words += "Rigid: the weighted markers that tell most of the rotation. "
    if len(result.chosen.leading) > MOST_LABELS:
        words += "There are too many rigid markers to write their names. "
    return words + ellipsoid_caption(result)


@dataclass(frozen=True, eq=False)
class View:
    """From where the picture is taken: ``side`` points to the camera."""

    title: str
    side: Array
    up: Array

    @property
    def right(self) -> Array:
        """To the right in the picture."""
        return np.cross(self.up, self.side)

    def flat(self, points: Array) -> Array:
        """Places in the picture, mm, shape (..., 2)."""
        return points @ np.stack([self.right, self.up], axis=1)


@dataclass(frozen=True, eq=False)
class _Content:
    """What is drawn, in mm and world axes of the reference pose."""

    rigid: Array
    free: Array
    names: list[str]
    pivot: Array
    far: bool
    corners: Array
    faces: np.ndarray

    @classmethod
    def of(cls, take: Capture, result: Compensation) -> _Content:
        leading = result.chosen.leading
        rigid = result.template[leading]
        rest = np.setdiff1d(head_columns(take, result), np.array(result.chosen.columns)[leading])
        free = median_places(result.capture.points[:, rest])
        far = pivot_is_far(result)
        pivot = pivot_as_drawn(result)
        corners, faces = ellipsoid_surface(pivot_ellipsoid(result), pivot)
        if far:
            corners, faces = corners[:0], faces[:0]
        names = [result.rigid[k] for k in leading] if len(leading) <= MOST_LABELS else []
        return cls(rigid, free, names, pivot, far, corners, faces)

    @property
    def everything(self) -> Array:
        return np.vstack([self.rigid, self.free, self.pivot[None], self.corners])

    def spans(self, view: View) -> Array:
        return np.ptp(view.flat(self.everything), axis=0)


def _draw(plotter: Any, content: _Content, view: View, half: float, height: int) -> None:
    import pyvista

    size = 0.014 * half
    if len(content.free):
        plotter.add_mesh(_balls(content.free, size), color=colours.FREE, smooth_shading=True, ambient=0.3)
    plotter.add_mesh(_balls(content.rigid, 1.4 * size), color=colours.RIGID, smooth_shading=True, ambient=0.3)
    plotter.add_mesh(_polygon(content.rigid), color=colours.RIGID, opacity=0.25, lighting=False)
    for point in content.rigid:
        plotter.add_mesh(pyvista.Line(point, content.pivot), color=colours.GREY, line_width=2, lighting=False)
    named, names = list(content.rigid[: len(content.names)]), list(content.names)
    if not content.far:
        dot = pyvista.Sphere(radius=DOT_MM, center=content.pivot)
        plotter.add_mesh(dot, color=colours.BLACK, smooth_shading=True)
        surface = pyvista.PolyData.from_regular_faces(content.corners, content.faces)
        plotter.add_mesh(surface, color=colours.PIVOT, opacity=0.4, smooth_shading=True, ambient=0.55, diffuse=0.5)
    named.append(content.pivot)
    names.append("towards the pivot" if content.far else "pivot")
    flat = view.flat(content.everything)
    across, along = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    middle = across * view.right + along * view.up + (content.everything @ view.side).mean() * view.side
    _scale_bar(plotter, middle, view, half, height // 40)
    _labels(plotter, np.array(named), names, view, half, height)
    plotter.add_text(view.title, position="upper_left", font_size=height // 60, color="black")
    plotter.set_background("white")
    plotter.enable_parallel_projection()
    plotter.camera.position = middle + 5.0 * half * view.side
    plotter.camera.focal_point = middle
    plotter.camera.up = view.up
    plotter.camera.parallel_scale = half
    # Set by hand: labels do not count as content, and those in front of it would be cut off.
    plotter.camera.clipping_range = (0.5 * half, 12.0 * half)


def _labels(plotter: Any, points: Array, names: list[str], view: View, half: float, height: int) -> None:
    """Names beside their points: above, below, right or left, wherever they hide the fewest others."""
    font = height // 40
    per_pixel = 2.0 * half / height
    gap = 0.035 * half
    places = (
        ("center", "bottom", 0, 1),
        ("center", "top", 0, -1),
        ("left", "center", 1, 0),
        ("right", "center", -1, 0),
    )
    taken: list[tuple[float, float, float, float]] = []
    for k, (point, name) in enumerate(zip(points, names, strict=True)):
        x, y = view.flat(point)
        wide, tall = 0.62 * font * len(name) * per_pixel, 1.3 * font * per_pixel
        options = []
        for horizontal, vertical, dx, dy in places:
            cx, cy = x + dx * (gap + 0.5 * wide), y + dy * (gap + 0.5 * tall)
            box = (cx - 0.5 * wide, cx + 0.5 * wide, cy - 0.5 * tall, cy + 0.5 * tall)
            options.append((sum(_overlap(box, other) for other in taken), horizontal, vertical, dx, dy, box))
        _, horizontal, vertical, dx, dy, box = min(options, key=lambda option: option[0])
        taken.append(box)
        # Towards the camera, so that no sphere hides a label.
        place = point + gap * (dx * view.right + dy * view.up) + 0.5 * half * view.side
        plotter.add_point_labels(
            place[None], [name], font_size=font, text_color="black", shape=None, show_points=False,
            always_visible=True, justification_horizontal=horizontal, justification_vertical=vertical,
            name=f"{view.title} {k}",
        )  # fmt: skip


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Common area of two boxes (left, right, bottom, top)."""
    return max(0.0, min(a[1], b[1]) - max(a[0], b[0])) * max(0.0, min(a[3], b[3]) - max(a[2], b[2]))


def _balls(points: Array, radius: float) -> pyvista.PolyData:
    import pyvista

    ball = pyvista.Sphere(radius=radius, theta_resolution=16, phi_resolution=16)
    return pyvista.PolyData(points).glyph(geom=ball, scale=False, orient=False)


def _polygon(points: Array) -> pyvista.PolyData:
    """The rigid markers joined in the order in which they stand around their middle."""
    import pyvista

    centred = points - points.mean(axis=0)
    _, _, axes = np.linalg.svd(centred)
    order = np.argsort(np.arctan2(centred @ axes[1], centred @ axes[0]))
    return pyvista.PolyData(points, faces=np.concatenate([[len(points)], order])).triangulate()


def ellipsoid_surface(shape: Ellipsoid, centre: Array, rings: int = 16, segments: int = 32) -> tuple[Array, np.ndarray]:
    """Corners (V, 3), mm, and triangles (T, 3) of the ellipsoid."""
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, segments, endpoint=False), indexing="ij"
    )
    ball = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=2)
    corners = centre + (ball.reshape(-1, 3) * shape.half) @ shape.axes
    ring, step = np.meshgrid(np.arange(rings), np.arange(segments), indexing="ij")
    a, b = ring * segments + step, ring * segments + (step + 1) % segments
    faces = np.concatenate([np.stack([a, b, a + segments], 2), np.stack([b, b + segments, a + segments], 2)])
    return corners, faces.reshape(-1, 3)


def _scale_bar(plotter: Any, middle: Array, view: View, half: float, font: int) -> None:
    """A bar of a round length in mm, bottom left, and the world's axes in the picture, bottom right."""
    import pyvista

    length = max((step for step in (10, 20, 50, 100, 200, 500) if step <= 0.6 * half), default=10)
    start = middle - 0.9 * half * view.right - 0.88 * half * view.up
    corner = middle + 0.68 * half * view.right - 0.88 * half * view.up
    plotter.add_mesh(pyvista.Line(start, start + length * view.right), color="black", line_width=5, lighting=False)
    places, names = [start + 0.5 * length * view.right + 0.02 * half * view.up], [f"{length} mm"]
    for name, axis, colour in zip("xyz", np.eye(3), colours.AXES, strict=True):
        if abs(axis @ view.side) > 0.5:
            continue
        end = corner + 0.16 * half * axis
        plotter.add_mesh(pyvista.Line(corner, end), color=colour, line_width=5, lighting=False)
        places.append(end + 0.05 * half * axis - (0.02 * half * view.up if axis @ view.up < 0.5 else 0.0))
        names.append(name)
    plotter.add_point_labels(
        np.array(places), names, font_size=font, text_color="black", shape=None, show_points=False,
        always_visible=True, justification_horizontal="center", justification_vertical="bottom",
    )  # fmt: skip
