"""A head before a real camera: pinhole intrinsics, a picture behind it, lamps that stay where they are."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.head.model import Head
from evalkit.render.head_scene import HeadScene
from evalkit.render.head_views import SEE_THROUGH
from evalkit.vision.camera import Camera

LIGHTS: dict[str, tuple[float, float, tuple[float, float, float] | None]] = {
    "even": (1.0, 0.0, None),
    "camera": (0.35, 0.75, None),
    "lamp": (0.4, 0.75, (900.0, 500.0, 700.0)),
}
"""Light -> ambient and diffuse share, and where the lamp stands in the world, mm; None is beside the camera. Both
lamps stay where they are while the head turns, so that its shading is not part of its texture."""

CLIPPING_MM = (50.0, 5000.0)
"""Nearest and furthest that is drawn. A depth buffer of 24 bits still tells hairs apart at the distance of a face."""

WORN = ("skin", "lids", "eyeballs", "ears", "plate")
"""Parts that wear a head's texture where it is projected; what is inside the mouth has its own colours."""


class CameraScene(HeadScene):
    """A head in front of a pinhole camera that stands at the world's origin.

    World axes are the camera's, see :mod:`evalkit.vision.camera`: a vertex p of a head at R, T is at R p + T.

    Parameters
    ----------
    head : Head
    camera : Camera
        Its principal point must be the middle of the picture.
    light : str
        Key of :data:`LIGHTS`.
    behind : ndarray of uint8, shape (H, W, 3)
        What is seen behind the head.
    distance_mm : float
        At which the head is, about: its texture is made as coarse as it is seen from there.
    projected : bool
        Whether the texture belongs on :data:`WORN` only.

    Raises
    ------
    EvalkitError
        If the light is not known, or nothing can be drawn without a screen here.
    """

    def __init__(
        self, head: Head, camera: Camera, light: str, behind: NDArray[np.uint8], distance_mm: float,
        projected: bool = False,
    ) -> None:  # fmt: skip
        if light not in LIGHTS:
            raise EvalkitError(f"unknown light '{light}'; known are {', '.join(LIGHTS)}")
        self._camera, self._light, self._behind, self._projected = camera, LIGHTS[light], behind, projected
        self._head, self._pixels_per_mm = head, camera.focal_px / distance_mm
        super().__init__(head, (camera.width, camera.height), multisamples=4)

    def _prepare(self, background: str, multisamples: int) -> None:
        import pyvista

        super()._prepare(background, multisamples)
        self._plotter.renderer.SetBackgroundTexture(pyvista.Texture(np.ascontiguousarray(self._behind)))
        self._plotter.renderer.SetTexturedBackground(True)
        self._plotter.remove_all_lights()
        place = self._light[2]
        lamp = pyvista.Light(light_type="headlight") if place is None else pyvista.Light(position=place)
        self._plotter.add_light(lamp)

    def _add(self, data: Any, part: str, picture: Any, wireframe: bool) -> None:
        worn = picture is not None and (part in WORN or not self._projected)
        super()._add(data, part, self._picture(part in SEE_THROUGH) if worn else None, wireframe)

    def _picture(self, see_through: bool) -> Any:
        """The texture with no more texels than are seen: a face in a video is small, and would shimmer as it moves.

        Mipmaps would do the same at three times the cost of all the rest, by software.
        """
        import pyvista
        from PIL import Image

        texture = self._head.texture
        assert texture is not None
        finer = int(texels_per_mm(self._head) / self._pixels_per_mm)
        if finer > 1:
            texture = np.asarray(Image.fromarray(texture).reduce(finer))
        picture = pyvista.Texture(np.ascontiguousarray(texture[..., : 4 if see_through else 3]))
        picture.interpolate, picture.repeat = True, False
        return picture

    def _add_actor(self, data: Any, texture: Any = None, **look: Any) -> None:
        ambient, diffuse, _ = self._light
        super()._add_actor(data, texture, **(look | {"ambient": ambient, "diffuse": diffuse}))

    def _aim(self, head: Head, yaw_deg: float) -> None:
        camera = self._plotter.camera
        camera.position, camera.focal_point, camera.up = (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)
        camera.view_angle = 2.0 * float(np.degrees(np.arctan2(0.5 * self.height, self._camera.focal_px)))
        camera.clipping_range = CLIPPING_MM
        self._plotter.renderer.GetCullers().RemoveAllItems()


def texels_per_mm(head: Head) -> float:
    """How fine the texture of a head is on its face: median over the triangles of the ratio of edges."""
    assert head.uv is not None
    assert head.texture is not None
    inside = np.isin(head.triangles, head.regions["face"]).all(axis=1)
    corners = head.triangles[inside]
    height, width = head.texture.shape[:2]
    texels = np.linalg.norm((head.uv[corners[:, 1]] - head.uv[corners[:, 0]]) * [width, height], axis=1)
    lengths = np.linalg.norm(head.vertices[corners[:, 1]] - head.vertices[corners[:, 0]], axis=1)
    return float(np.median(texels / np.maximum(lengths, 1e-9)))
