"""Pictures of a head at rest and in motion: the contact sheet that shows what a head looks like."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.model import JAW_LIMIT_DEG, Head
from evalkit.render.offscreen import offscreen_plotter

if TYPE_CHECKING:
    import pyvista

BACKGROUND = "#cdd1d6"

SKIN = "#d8a68a"
PLAIN = {
    "eyeballs": "#eae6e2",
    "upper teeth": "#e8e0cc",
    "lower teeth": "#e8e0cc",
    "mouth pocket": "#3c1414",
    "tongue": "#b05a5a",
}
"""Colours of the parts of a head without a texture."""


VIEW_ANGLE_DEG = 20.5
"""Of the camera, where the zoom is 1."""

WIRE_PARTS = ("skin", "lids", "eyeballs", "ears")
WIRE: dict[str, Any] = {
    "color": "#f2efe9", "lighting": False, "culling": "back", "show_edges": True, "edge_color": "#28323c",
}  # fmt: skip
"""Parts and look of a wireframe: lines behind the surface are hidden."""

PHOTO_LIGHT = {"ambient": 0.8, "diffuse": 0.25, "specular": 0.0}
"""A photo has its light in it: shading it once more would draw a dark line around the mask before its plate."""

SEE_THROUGH = ("plate", "upper teeth", "lower teeth")
"""Parts whose texture is transparent in places; drawn after the others, the plate first."""


class View(NamedTuple):
    """One picture of the sheet.

    Attributes
    ----------
    yaw_deg, pitch_deg : float
        Where the camera stands: to the head's left, and above.
    jaw_deg, lids_closed : float
    wireframe : bool
    textured : bool
    zoom : float
    """

    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    jaw_deg: float = 0.0
    lids_closed: float = 0.0
    wireframe: bool = False
    textured: bool = True
    zoom: float = 1.0


SHEET = (
    View(), View(yaw_deg=28.0), View(yaw_deg=-15.0, pitch_deg=12.0), View(yaw_deg=88.0),
    View(jaw_deg=15.0), View(yaw_deg=28.0, jaw_deg=30.0), View(lids_closed=1.0),
    View(yaw_deg=20.0, wireframe=True, zoom=1.8),
)  # fmt: skip
"""Front, three-quarter, from above, profile; mouth half and wide open, lids closed, wireframe."""

FITTED_SHEET = (
    View(zoom=1.02), View(yaw_deg=20.0, zoom=1.02), View(yaw_deg=-20.0, zoom=1.02), View(jaw_deg=15.0, zoom=1.02),
    View(lids_closed=1.0, zoom=1.02),
)  # fmt: skip
"""What a head fitted to a photo is judged by: front, turned to both sides, mouth open, lids closed."""


def head_mesh(head: Head, part: str, vertices: Array) -> pyvista.PolyData:
    """One part of a head with its texture coordinates."""
    import pyvista

    triangles = head.part_triangles(part)
    used, local = np.unique(triangles, return_inverse=True)
    local = local.reshape(-1, 3)
    mesh = pyvista.PolyData(vertices[used], np.hstack([np.full((len(local), 1), 3), local]).ravel())
    if head.uv is not None:
        mesh.active_texture_coordinates = head.uv[used]
    return mesh


def draw_head(plotter: Any, head: Head, view: View, *, without: tuple[str, ...] = (), flat: str | None = None) -> None:
    """Add a posed head to a plotter and point its camera.

    Parameters
    ----------
    plotter : pyvista.Plotter
    head : Head
    view : View
    without : tuple of str
        Parts left out.
    flat : str, optional
        One colour for everything, unlit and seen from outside only: for tests of what covers what.
    """
    import pyvista

    vertices = posed(head, view)
    texture = head.texture if view.textured and flat is None else None
    skin = _with_normals(head, vertices)
    # The pass that sorts transparent layers leaves the background's colour in pixels that an edge before the plate
    # covers in part: a light line around the hair. Plate before teeth is order enough.
    plotter.renderer.SetUseOIT(False)
    for part in sorted(head.parts, key=lambda name: (name in SEE_THROUGH, name)):
        if part in without or (view.wireframe and part not in WIRE_PARTS):
            continue
        mesh = head_mesh(head, part, vertices)
        if flat is not None:
            plotter.add_mesh(mesh, color=flat, lighting=False, culling="back")
        elif view.wireframe:
            plotter.add_mesh(mesh, **WIRE)
        else:
            mesh.point_data.active_normals = skin[np.unique(head.part_triangles(part))]
            look: dict[str, Any] = {"smooth_shading": True, "ambient": 0.2, "diffuse": 0.85, "specular": 0.06}
            if part == "eyeballs":
                look |= {"specular": 0.3, "specular_power": 40.0, "ambient": 0.35}
            if head.photographed:
                look |= PHOTO_LIGHT
            if texture is not None:
                # With an opacity channel VTK sorts no depths: only parts that need it get it.
                channels = 4 if part in SEE_THROUGH else 3
                picture = pyvista.Texture(np.ascontiguousarray(texture[..., :channels]))
                picture.interpolate = picture.mipmap = True
                plotter.add_mesh(mesh, texture=picture, **look)
            elif part != "plate":
                plotter.add_mesh(mesh, color=PLAIN.get(part, SKIN), **look)
    _aim(plotter, view)


def posed(head: Head, view: View) -> Array:
    """Jaw and lids as the view wants them; by named units where a head has no joints for them."""
    units: dict[str, float] = {}
    if head.jaw is None:
        units |= {name: view.jaw_deg / JAW_LIMIT_DEG for name in head.blendshapes if name == "jawOpen"}
    if head.lids is None:
        units |= {name: view.lids_closed for name in head.blendshapes if name.startswith("eyeBlink")}
    return head.posed(
        jaw_deg=view.jaw_deg if head.jaw else 0.0, lids_closed=view.lids_closed if head.lids else 0.0, units=units
    )


def _with_normals(head: Head, vertices: Array) -> Array:
    """Vertex normals over all parts together, so that parts that share vertices show no seam."""
    corners = vertices[head.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    out = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(out, head.triangles[:, k], normals)
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)


def _aim(plotter: Any, view: View) -> None:
    yaw, pitch = np.deg2rad(view.yaw_deg), np.deg2rad(view.pitch_deg)
    side = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    middle = np.array([0.0, 8.0, 30.0])
    plotter.camera.position = middle + 900.0 * side
    plotter.camera.focal_point = middle
    plotter.camera.up = (0.0, 1.0, 0.0)
    plotter.camera.view_angle = VIEW_ANGLE_DEG / view.zoom
    plotter.camera.clipping_range = (300.0, 1500.0)


def head_sheet_png(
    head: Head, path: str | Path, *, views: tuple[View, ...] = SHEET, columns: int = 4, size: int = 480
) -> None:
    """Draw a head from several sides into one picture.

    Parameters
    ----------
    head : Head
    path : str or Path
        PNG to write.
    views : tuple of View
    columns : int
    size : int
        Pixels of each view.

    Raises
    ------
    EvalkitError
        If nothing can be drawn without a screen here, or the file cannot be written.
    """
    rows = -(-len(views) // columns)
    with offscreen_plotter(columns * size, rows * size, shape=(rows, columns), border=False) as opened:
        plotter: Any = opened
        plotter.suppress_rendering = True
        for k, view in enumerate(views):
            plotter.subplot(k // columns, k % columns)
            plotter.set_background(BACKGROUND)
            draw_head(plotter, head, view)
        plotter.suppress_rendering = False
        plotter.render_window.SetMultiSamples(0)
        image = np.asarray(plotter.screenshot(None, return_img=True))
    from PIL import Image

    try:
        Image.fromarray(image).save(path, optimize=True)
    except OSError as error:
        raise EvalkitError(f"{path}: cannot write the picture ({error.strerror or error})") from error
