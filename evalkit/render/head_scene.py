"""A head on screen whose vertices move: upload, render, read the pixels back, frame after frame."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.model import Head, Indices
from evalkit.render.head_views import BACKGROUND, PHOTO_LIGHT, PLAIN, SEE_THROUGH, SKIN, WIRE, WIRE_PARTS
from evalkit.render.offscreen import offscreen_plotter

YAW_DEG = {"front": 0.0, "three-quarter": 28.0, "profile": 88.0}
"""Name of a view -> where its camera stands, to the head's left. 28 is within the 30 up to which a half-cut head
looks right; at 90 the plate behind it would be a line."""

VIEW_ANGLE_DEG = 20.0
"""Of the camera: narrow, as a portrait lens, so that the nose is not made larger."""

MARGIN = 1.15
"""The picture is so many times as wide as the head is large: room for its motion."""

MARKER_PIXELS = 9.0
"""Diameter of a marker."""

MARKER = "#0072B2"

SHADINGS = ("smooth", "flat")

AWAY_MM = 1e6
"""Where a marker is put that is missing: behind every camera."""


class HeadScene:
    """An offscreen scene with one head, built once and drawn for many frames.

    :meth:`show` writes a frame's positions and normals in place; nothing else is made anew from frame to frame. The
    camera stays where the head at rest puts it. Use it as a context manager, or :meth:`close` it.

    Parameters
    ----------
    head : Head
    size : (int, int)
        Width and height of the picture, pixels.
    textured : bool
        Draw the head's texture, if it has one; otherwise one colour for each part.
    multisamples : int
        Samples per pixel against jagged edges; 0 for none.
    view : str
        Key of :data:`YAW_DEG`.
    wireframe : bool
        The edges of skin, lids, eyeballs and ears, without what lies behind them.
    markers : array_like, shape (n, 3), mm, optional
        Markers to draw as dots; :meth:`show` moves them.
    background : str
        Colour.
    shading : str
        ``smooth`` computes the normals of every vertex anew in every frame; ``flat`` leaves them to the graphics
        card, one for each triangle, and costs no time here.
    without : tuple of str
        Parts left out.

    Raises
    ------
    EvalkitError
        If an argument is not known or does not fit, or nothing can be drawn without a screen here.
    """

    def __init__(
        self,
        head: Head,
        size: tuple[int, int] = (1024, 1024),
        textured: bool = True,
        multisamples: int = 0,
        view: str = "front",
        wireframe: bool = False,
        markers: ArrayLike | None = None,
        background: str = BACKGROUND,
        shading: str = "smooth",
        without: tuple[str, ...] = (),
    ) -> None:
        if view not in YAW_DEG:
            raise EvalkitError(f"unknown view '{view}'; known are {', '.join(YAW_DEG)}")
        if shading not in SHADINGS:
            raise EvalkitError(f"unknown shading '{shading}'; known are {', '.join(SHADINGS)}")
        if min(size) < 1 or multisamples < 0:
            raise EvalkitError(f"a picture of {size[0]} x {size[1]} pixels, {multisamples} samples each: too few")
        unknown = [part for part in without if part not in head.parts]
        if unknown:
            raise EvalkitError(f"{head.name}: no part named '{unknown[0]}'; it has {', '.join(head.parts)}")
        self.width, self.height = size
        self.vertices = len(head.vertices)
        with ExitStack() as stack:
            self._plotter: Any = stack.enter_context(offscreen_plotter(*size, lighting="none", border=False))
            self._prepare(background, multisamples)
            self._build(head, textured, wireframe, shading, without)
            self._build_markers(markers)
            self._aim(head, YAW_DEG[view])
            self.show(head.vertices)
            self._closing = stack.pop_all()

    def _prepare(self, background: str, multisamples: int) -> None:
        """The window and its light."""
        import pyvista

        self._plotter.set_background(background)
        self._window: Any = self._plotter.render_window
        self._window.SetMultiSamples(multisamples)
        # Pictures are read from the buffer that is drawn into: there is no screen to copy them to.
        self._window.SetSwapBuffers(0)
        # One light beside the camera: by software every further one costs a sixth of a frame.
        self._plotter.add_light(pyvista.Light(position=(0.25, 0.4, 1.0), light_type="camera light"))
        # The pass that puts transparent layers into order blends in buffers of its own, at nearly the cost of the head.
        # Here the plate comes before the teeth, and no more order is needed.
        self._plotter.renderer.SetUseOIT(False)

    def _build(self, head: Head, textured: bool, wireframe: bool, shading: str, without: tuple[str, ...]) -> None:
        from vtkmodules.vtkCommonMath import vtkMatrix4x4

        self._positions = np.empty((self.vertices, 3), dtype=np.float32)
        self._normals = None
        if shading == "smooth" and not wireframe:
            self._normals = VertexNormals(head.triangles, self.vertices)
        pictures: dict[bool, Any] = {}
        uv = None
        if textured and head.uv is not None and head.texture is not None and not wireframe:
            pictures, uv = _pictures(head.texture), head.uv
        self._matrix = vtkMatrix4x4()
        self._photographed = head.photographed
        self._parts = []
        for part in sorted(head.parts, key=lambda name: (name in SEE_THROUGH, name)):
            # Hair and outline are all in the plate's picture: without one it is a board.
            if part in without or (part == "plate" and not pictures) or (wireframe and part not in WIRE_PARTS):
                continue
            self._parts.append(PartMesh(head.part_triangles(part), uv, normals=self._normals is not None))
            self._add(self._parts[-1].data, part, pictures.get(part in SEE_THROUGH), wireframe)

    def _add(self, data: Any, part: str, picture: Any, wireframe: bool) -> None:
        look: dict[str, Any] = {"ambient": 0.3, "diffuse": 0.75}
        look["interpolation"] = "flat" if self._normals is None else "phong"
        if part == "eyeballs":
            look |= {"specular": 0.3, "specular_power": 40.0, "ambient": 0.45}
        if self._photographed and picture is not None:
            look |= PHOTO_LIGHT
        if part == "skin":
            # Its inside is never seen, and takes as many pixels as its outside.
            look["culling"] = "back"
        look["color"] = "white" if picture is not None else PLAIN.get(part, SKIN)
        self._add_actor(data, picture, **(WIRE if wireframe else look))

    def _add_actor(self, data: Any, texture: Any = None, **look: Any) -> None:
        import pyvista
        from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

        # The mapper of PyVista's own actors takes any kind of mesh, for which it copies this one in every frame.
        mapper = vtkPolyDataMapper()
        mapper.SetInputData(data)
        mapper.ScalarVisibilityOff()
        # Positions are uploaded as they are: centring and scaling them would be another pass over them.
        mapper.SetVBOShiftScaleMethod(0)
        actor = vtkActor()
        actor.SetMapper(mapper)
        actor.SetProperty(pyvista.Property(**look))
        if texture is not None:
            actor.SetTexture(texture)
        actor.SetUserMatrix(self._matrix)
        self._plotter.add_actor(actor, reset_camera=False, render=False)

    def _build_markers(self, markers: ArrayLike | None) -> None:
        self._markers: Any = None
        if markers is None:
            return
        import pyvista

        places = np.asarray(markers, dtype=np.float64)
        if places.ndim != 2 or places.shape[1] != 3:
            raise EvalkitError(f"markers have shape {places.shape}; expected (markers, 3)")
        self._markers = pyvista.PolyData(places.astype(np.float32))
        self._place_markers(places)
        self._add_actor(self._markers, color=MARKER, point_size=MARKER_PIXELS, render_points_as_spheres=True)

    def _aim(self, head: Head, yaw_deg: float) -> None:
        """Point the camera at the middle of the head at rest, as far away as shows all of it."""
        low, high = head.vertices.min(axis=0), head.vertices.max(axis=0)
        middle, extent = (low + high) / 2, float((high - low)[:2].max())
        # From the side of the picture that is narrower.
        shorter = min(1.0, self.width / self.height)
        away = MARGIN * extent / 2 / np.tan(np.deg2rad(VIEW_ANGLE_DEG) / 2) / shorter
        yaw = np.deg2rad(yaw_deg)
        camera = self._plotter.camera
        camera.position = middle + away * np.array([np.sin(yaw), 0.0, np.cos(yaw)])
        camera.focal_point = middle
        camera.up = (0.0, 1.0, 0.0)
        camera.view_angle = VIEW_ANGLE_DEG
        camera.clipping_range = (max(away - 2 * extent, 0.05 * away), away + 2 * extent)
        # What decides which parts are in the picture looks at all vertices of each part, in every frame.
        self._plotter.renderer.GetCullers().RemoveAllItems()

    def show(self, vertices: ArrayLike, markers: ArrayLike | None = None) -> None:
        """Upload the positions of a frame; nothing is drawn yet.

        Parameters
        ----------
        vertices : array_like, shape (V, 3), mm
            Copied; in single precision, as the graphics card takes them.
        markers : array_like, shape (n, 3), mm, optional
            As many as the scene was made with; a missing one (NaN) is not drawn.

        Raises
        ------
        EvalkitError
            If a shape does not fit.
        """
        places = np.asarray(vertices)
        if places.shape != self._positions.shape:
            raise EvalkitError(f"vertices have shape {places.shape}; this scene's head has ({self.vertices}, 3)")
        np.copyto(self._positions, places, casting="same_kind")
        normals = None if self._normals is None else self._normals(self._positions)
        for part in self._parts:
            part.show(self._positions, normals)
        if markers is not None:
            self._place_markers(np.asarray(markers, dtype=np.float64))
        self._drawn = False

    def _place_markers(self, places: Array) -> None:
        if self._markers is None or self._markers.points.shape != places.shape:
            count = 0 if self._markers is None else len(self._markers.points)
            raise EvalkitError(f"markers have shape {places.shape}; this scene was made with {count} of them")
        self._markers.points[:] = np.where(np.isfinite(places).all(axis=1, keepdims=True), places, AWAY_MM)
        self._markers.GetPoints().Modified()

    def pose(self, rotation: ArrayLike, translation: ArrayLike) -> None:
        """Move the whole head, markers included: a vertex p is drawn at R p + T.

        Parameters
        ----------
        rotation : array_like, shape (3, 3)
        translation : array_like, shape (3,), mm
        """
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, translation
        self._matrix.DeepCopy(matrix.ravel().tolist())
        self._drawn = False

    def render(self) -> None:
        """Draw the scene, and wait until it is drawn: else the time would be spent in :meth:`read`."""
        self._window.Render()
        self._window.WaitForCompletion()
        self._drawn = True

    def read(self) -> NDArray[np.uint8]:
        """The pixels of the frame that :meth:`render` has drawn; what changed since is drawn first.

        Returns
        -------
        ndarray of uint8, shape (H, W, 3)
            Red, green, blue, first row on top; an array of its own.
        """
        if not self._drawn:
            self.render()
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

        pixels = vtkUnsignedCharArray()
        self._window.GetPixelData(0, 0, self.width - 1, self.height - 1, 0, pixels, 0)
        return vtk_to_numpy(pixels).reshape(self.height, self.width, 3)[::-1]

    def frame(self, vertices: ArrayLike, markers: ArrayLike | None = None) -> NDArray[np.uint8]:
        """Upload, render and read back one frame; as :meth:`show` and :meth:`read`."""
        self.show(vertices, markers)
        self.render()
        return self.read()

    @property
    def renderer(self) -> str:
        """Name and version of what draws."""
        facts = dict(
            line.split(":", 1) for line in self._window.ReportCapabilities().splitlines() if line.count(":") >= 1
        )
        names = ("OpenGL renderer string", "OpenGL version string")
        return ", ".join(facts[name].strip() for name in names if name in facts)

    def close(self) -> None:
        """Give back the window and its memory; once is enough, twice does no harm."""
        self._closing.close()

    def __enter__(self) -> HeadScene:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class PartMesh:
    """One part of a head with arrays of its own, which are filled anew in place.

    Every mapper uploads all of its mesh's arrays: parts that shared those of the head would upload them all, once
    each.

    Parameters
    ----------
    triangles : ndarray of int, shape (T, 3)
        Of the head's vertices.
    uv : ndarray, shape (V, 2), optional
        Texture coordinates of the head.
    normals : bool
        Whether it has normals.

    Attributes
    ----------
    data : pyvista.PolyData
    """

    def __init__(self, triangles: Indices, uv: Array | None, *, normals: bool) -> None:
        import pyvista
        from vtkmodules.vtkCommonCore import vtkPoints

        self._used, local = np.unique(triangles, return_inverse=True)
        local = local.reshape(-1, 3)
        self._columns = [_column(len(self._used), 3) for _ in range(2 if normals else 1)]
        points = vtkPoints()
        points.SetData(self._columns[0][0])
        self.data = pyvista.PolyData()
        self.data.SetPoints(points)
        self.data.faces = np.hstack([np.full((len(local), 1), 3), local]).ravel()
        if normals:
            self.data.GetPointData().SetNormals(self._columns[1][0])
        if uv is not None:
            array, values = _column(len(self._used), 2)
            array.SetName("uv")
            values[:] = uv[self._used]
            self.data.GetPointData().SetTCoords(array)

    def show(self, positions: NDArray[np.float32], normals: NDArray[np.float32] | None) -> None:
        """Take over this part's share of all positions and normals, both (V, 3); what stayed the same stays there."""
        for (array, values), new in zip(self._columns, (positions, normals), strict=False):
            if new is None:
                continue
            share = np.take(new, self._used, axis=0)
            if not np.array_equal(values, share):
                values[:] = share
                array.Modified()


def _column(rows: int, components: int) -> tuple[Any, NDArray[np.float32]]:
    """An array of VTK's, zeros, and NumPy's view of it."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkFloatArray

    array = vtkFloatArray()
    array.SetNumberOfComponents(components)
    array.SetNumberOfTuples(rows)
    array.Fill(0.0)
    return array, vtk_to_numpy(array)


class VertexNormals:
    """Unit normals of the vertices of a mesh, the mean over the triangles around weighted by their areas.

    Parameters
    ----------
    triangles : ndarray of int, shape (T, 3)
    vertices : int
    """

    def __init__(self, triangles: Indices, vertices: int) -> None:
        from scipy.sparse import csr_array

        count = len(triangles)
        self._corners = np.ascontiguousarray(triangles.T)
        # One product with the incidence of vertices and triangles instead of a scattered sum: fifteen times as fast.
        ones = np.ones(3 * count, dtype=np.float32)
        pairs = (triangles.T.ravel(), np.tile(np.arange(count), 3))
        self._around = csr_array((ones, pairs), shape=(vertices, count), dtype=np.float32)

    def __call__(self, positions: NDArray[np.float32]) -> NDArray[np.float32]:
        """Normals (V, 3) at these positions (V, 3)."""
        # np.take: indexing by an array of rows is several times slower.
        a, b, c = (np.take(positions, corner, axis=0) for corner in self._corners)
        b -= a
        c -= a
        normals = np.empty_like(a)
        for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
            normals[:, k] = b[:, i] * c[:, j] - b[:, j] * c[:, i]
        sums = self._around @ normals
        length = np.sqrt(np.einsum("vi,vi->v", sums, sums))
        # A vertex of no triangle, or of triangles without area, has no normal.
        sums /= np.maximum(length, np.float32(1e-20))[:, None]
        return np.asarray(sums)


def _pictures(texture: NDArray[np.uint8]) -> dict[bool, Any]:
    """Whether seen through -> the texture; with an opacity channel VTK would sort no depths."""
    import pyvista

    found = {}
    for see_through, channels in ((False, 3), (True, 4)):
        picture = pyvista.Texture(np.ascontiguousarray(texture[..., :channels]))
        # Without mipmaps: by software they cost more than all the rest, and a face fills the picture anyway.
        picture.interpolate = True
        found[see_through] = picture
    return found
