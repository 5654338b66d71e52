"""The head, its rigid markers and the pivot, as in Fig. 1(a) of Huang et al. (2000)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from evalkit.capture import Capture
from evalkit.capture.origin import screen_axes
from evalkit.compensation import Compensation
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.render import colours
from evalkit.render.markers import HEAD_MM, head_columns, median_places
from evalkit.render.offscreen import offscreen_plotter

if TYPE_CHECKING:
    import pyvista

STANDARD_DEVIATIONS = 2.0
"""Half axes of the ellipsoid."""

LONGEST_MM = 150.0
"""Half axes of the ellipsoid are cut here: a longer one says "not known" and would only hide the head."""

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
    return Ellipsoid(axes, np.clip(half, 0.5, LONGEST_MM), clipped)


def ellipsoid_caption(result: Compensation) -> str:
    """What the drawn ellipsoid means, in words."""
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
    if pivot_is_far(result):
        words += (
            f" The pivot itself lies {pivot_distance(result):.0f} mm from the rigid markers, outside the picture; "
            "the line points towards it."
        )
    return words


def pivot_distance(result: Compensation) -> float:
    """Distance of the pivot from the middle of the rigid markers, mm."""
    return float(np.linalg.norm(result.pivot - np.nanmean(result.template, axis=0)))


def pivot_is_far(result: Compensation) -> bool:
    """Whether the pivot is too far from the head to be drawn with it."""
    return not pivot_distance(result) <= FAR_MM


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
    columns = head_columns(take, result)
    with offscreen_plotter(width, height, shape=(1, 2), border=False) as plotter:
        for k, (title, side) in enumerate((("front", forward), ("from the left", left))):
            plotter.subplot(0, k)
            _draw(plotter, result, columns, title, side, up, height)
        image = plotter.screenshot(None, return_img=True)
    import matplotlib.image

    try:
        matplotlib.image.imsave(path, np.ascontiguousarray(image))
    except OSError as error:
        raise EvalkitError(f"{path}: cannot write the picture ({error.strerror or error})") from error
    left_out = sum(kind == "position" for kind in take.quantities) - len(columns)
    words = f"Reference pose; {len(columns)} markers, of which {len(result.rigid)} rigid. "
    if left_out:
        words += f"{left_out} points further than {HEAD_MM:.0f} mm from the rigid markers are not drawn. "
    return words + ellipsoid_caption(result)


def _draw(
    plotter: pyvista.Plotter, result: Compensation, columns: list[int], title: str, side: Array, up: Array, height: int
) -> None:
    import pyvista

    centre = np.nanmean(result.template, axis=0)
    rigid = result.template
    rest = [c for c in columns if c not in set(result.chosen.columns)]
    free = median_places(result.capture.points[:, rest]) if rest else np.empty((0, 3))
    free = free[np.isfinite(free).all(axis=1)]
    far = pivot_is_far(result)
    pivot = result.pivot if not far else centre + (result.pivot - centre) * (0.4 * FAR_MM / pivot_distance(result))
    size = 3.0
    if len(free):
        plotter.add_mesh(_balls(free, size), color=colours.FREE, smooth_shading=True)
    plotter.add_mesh(_balls(rigid, 1.4 * size), color=colours.RIGID, smooth_shading=True)
    plotter.add_mesh(_polygon(rigid), color=colours.RIGID, opacity=0.25, show_edges=False, lighting=False)
    for point in rigid:
        line = pyvista.Line(point, pivot)
        plotter.add_mesh(line, color=colours.GREY, line_width=2, lighting=False)
    extent = [rigid, free, pivot[None]]
    if not far:
        plotter.add_mesh(pyvista.Sphere(radius=1.4 * size, center=pivot), color=colours.BLACK, smooth_shading=True)
        shape = pivot_ellipsoid(result)
        mesh = ellipsoid_mesh(pivot, shape)
        plotter.add_mesh(mesh, color=colours.PIVOT, opacity=0.35, smooth_shading=True)
        extent.append(np.asarray(mesh.points))
    everything = np.vstack(extent)
    right = np.cross(up, side)
    span = [np.array([(everything @ axis).min(), (everything @ axis).max()]) for axis in (right, up)]
    half = 0.5 * max(np.ptp(span[0]), np.ptp(span[1])) * 1.28 + 10.0
    middle = span[0].mean() * right + span[1].mean() * up + (everything @ side).mean() * side
    _scale_bar(plotter, middle, right, up, half)
    points, names = [*rigid], list(result.rigid)
    if not far:
        points, names = [*points, pivot], [*names, "pivot"]
    # Towards the camera, so that no sphere hides a label.
    plotter.add_point_labels(
        np.array(points) + 2.5 * size * side + 1.6 * size * up, names, font_size=height // 40, text_color="black",
        shape=None, show_points=False, always_visible=True, justification_horizontal="center",
        justification_vertical="bottom",
    )  # fmt: skip
    plotter.add_text(title, position="upper_left", font_size=height // 70, color="black")
    plotter.set_background("white")
    plotter.enable_parallel_projection()
    plotter.camera.position = middle + 5.0 * half * side
    plotter.camera.focal_point = middle
    plotter.camera.up = up
    plotter.camera.parallel_scale = half
    plotter.renderer.ResetCameraClippingRange()


def _balls(points: Array, radius: float) -> pyvista.PolyData:
    import pyvista

    ball = pyvista.Sphere(radius=radius, theta_resolution=16, phi_resolution=16)
    return pyvista.PolyData(points).glyph(geom=ball, scale=False, orient=False)


def _polygon(points: Array) -> pyvista.PolyData:
    """The rigid markers' surface: a triangle, or the hull of more."""
    import pyvista

    order = np.arange(len(points))
    centred = points - points.mean(axis=0)
    _, _, axes = np.linalg.svd(centred)
    order = np.argsort(np.arctan2(centred @ axes[1], centred @ axes[0]))
    return pyvista.PolyData(points, faces=np.concatenate([[len(points)], order])).triangulate()


def ellipsoid_mesh(centre: Array, shape: Ellipsoid, resolution: int = 24) -> pyvista.PolyData:
    """The ellipsoid as triangles; a cut one looks like a rod with the true cross-section."""
    import pyvista

    ball = pyvista.Sphere(radius=1.0, theta_resolution=resolution, phi_resolution=resolution)
    ball.points = centre + (np.asarray(ball.points, dtype=np.float64) * shape.half) @ shape.axes
    return ball


def _scale_bar(plotter: pyvista.Plotter, middle: Array, right: Array, up: Array, half: float) -> None:
    """A bar of a round length in mm, bottom left, and the world's axes in the directions of the picture."""
    import pyvista

    length = max(step for step in (10, 20, 50, 100, 200, 500) if step <= 0.6 * half or step == 10)
    start = middle - 0.9 * half * right - 0.88 * half * up
    plotter.add_mesh(pyvista.Line(start, start + length * right), color="black", line_width=5, lighting=False)
    names = {}
    for axis, colour in zip(np.eye(3), colours.AXES, strict=True):
        k = "xyz"[int(np.argmax(axis))]
        if abs(axis @ right) < 0.5 and abs(axis @ up) < 0.5:
            continue
        corner = middle + 0.68 * half * right - 0.88 * half * up
        end = corner + 0.16 * half * axis
        plotter.add_mesh(pyvista.Line(corner, end), color=colour, line_width=5, lighting=False)
        names[k] = end + 0.05 * half * axis
    places = [start + 0.5 * length * right + 0.02 * half * up, *names.values()]
    plotter.add_point_labels(
        np.array(places), [f"{length} mm", *names], font_size=20, text_color="black", shape=None, show_points=False,
        always_visible=True, justification_horizontal="center", justification_vertical="bottom",
    )  # fmt: skip
