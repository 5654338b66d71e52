"""A piece of skin close up, coloured by a value of each vertex."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evalkit.geometry import Array
from evalkit.head.model import Indices
from evalkit.render.offscreen import offscreen_plotter

COLOUR_MAP = "viridis"
"""Perceptually uniform, and told apart with every kind of colour vision."""


class Camera(NamedTuple):
    """A camera in parallel projection, so that lengths can be read from the picture.

    Attributes
    ----------
    middle : (float, float, float), mm
        In the middle of the picture.
    half_mm : float
        Half the height of what is seen.
    yaw_deg, pitch_deg : float
        Where it stands: to the head's left, and above.
    """

    middle: tuple[float, float, float]
    half_mm: float
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0


def coloured_skin(
    vertices: Array,
    triangles: Indices,
    values: Array | None,
    camera: Camera,
    *,
    size: tuple[int, int] = (480, 480),
    limits: tuple[float, float] = (0.0, 1.0),
    edges: bool = False,
    backdrop_mm: float | None = None,
) -> NDArray[np.uint8]:
    """Draw a surface, each vertex in the colour of its value.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), mm
    triangles : ndarray of int, shape (T, 3)
    values : ndarray, shape (V,), or None
        Grey without.
    camera : Camera
    size : (int, int)
        Width and height, pixels.
    limits : (float, float)
        Values at the ends of :data:`COLOUR_MAP`.
    edges : bool
        Draw the edges of the triangles.
    backdrop_mm : float, optional
        Height (z) of a black board behind the skin, which shows where it is open.

    Returns
    -------
    ndarray of uint8, shape (H, W, 3)

    Raises
    ------
    EvalkitError
        If nothing can be drawn without a screen here.
    """
    with offscreen_plotter(*size, border=False) as opened:
        plotter: Any = opened
        plotter.set_background("white")
        add_skin(plotter, vertices, triangles, values, camera, limits=limits, edges=edges)
        if backdrop_mm is not None:
            import pyvista

            middle = np.array([camera.middle[0], camera.middle[1], backdrop_mm])
            board = pyvista.Plane(center=middle, direction=(0, 0, 1), i_size=6e2, j_size=6e2)
            plotter.add_mesh(board, color="black", lighting=False, reset_camera=False)
        plotter.render_window.SetMultiSamples(8)
        return np.asarray(plotter.screenshot(None, return_img=True))


def add_skin(
    plotter: Any,
    vertices: Array,
    triangles: Indices,
    values: Array | None,
    camera: Camera,
    *,
    limits: tuple[float, float] = (0.0, 1.0),
    edges: bool = False,
) -> None:
    """Add a surface to a plotter as :func:`coloured_skin` draws it, and point its camera."""
    import pyvista

    yaw, pitch = np.deg2rad([camera.yaw_deg, camera.pitch_deg])
    side = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    mesh = pyvista.PolyData.from_regular_faces(np.asarray(vertices, dtype=np.float64), triangles.astype(int))
    look: dict[str, Any] = {"color": "#c9c4be"}
    if values is not None:
        mesh.point_data["value"] = values
        look = {"scalars": "value", "clim": limits, "cmap": COLOUR_MAP, "show_scalar_bar": False}
    if edges:
        look |= {"show_edges": True, "edge_color": "#202020", "line_width": 1}
    # Mostly ambient: the colour must be that of the bar, and the light only shows the shape.
    plotter.add_mesh(mesh, smooth_shading=True, split_sharp_edges=False, ambient=0.5, diffuse=0.55, **look)
    plotter.camera.parallel_projection = True
    plotter.camera.position = np.array(camera.middle) + 500.0 * side
    plotter.camera.focal_point = camera.middle
    plotter.camera.up = (0.0, 1.0, 0.0)
    plotter.camera.parallel_scale = camera.half_mm
    plotter.camera.clipping_range = (50.0, 1500.0)
