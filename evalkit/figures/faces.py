"""What figures of characters share: the paper-like character, and its face with eyes and mouth."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evalkit.figures.scenes import XYZ
from evalkit.geometry import Array
from evalkit.head.model import Indices
from evalkit.render.offscreen import offscreen_plotter

if TYPE_CHECKING:
    import pandas as pd

    from evalkit.dense.anatomy import Front
    from evalkit.studies.transfers import Task

HALF_MM = 110.0
"""Half the height of what is seen."""

MIDDLE = (3.0, -7.0, 60.0)
YAW_DEG = 14.0
"""The camera stands to the face's left, where depth can be seen."""

TILE = (350, 400)
"""Width and height of one face, pixels."""

BEHIND_MM = 22.0
"""What is further back at rest (z) is not drawn: the ragged edge of the front of the head."""

SKIN = (0.83, 0.79, 0.75)
POCKET = (0.30, 0.16, 0.15)
"""Colours of a face that shows nothing, and of the lining of the mouth, always."""

ERROR_MAP = "YlOrRd"
"""Light where there is no error, so that the shape is seen; told apart with every kind of colour vision."""

IRIS = (0.75, 0.28)
"""Radius of a ball in the eyeball, and how far it is moved forward, over the radius of the eyeball: its cap shows."""

LID_MM = 0.5
"""The eyeball is so much smaller than the nearest place of a lid."""

BORDER_MM = 0.6
"""Lines between regions are drawn so far in front of the skin."""


class Face(NamedTuple):
    """One face of a sheet.

    Attributes
    ----------
    places : ndarray, shape (V, 3), mm
    triangles : ndarray of int, shape (T, 3)
    eyes : sequence of (ndarray, float)
        Middle (3,), mm, and radius, mm, of the eyeballs.
    colours : ndarray, shape (V, 3) or (T, 3), 0 to 1
        Of vertices or triangles.
    borders : ndarray of int, shape (E, 2), optional
        Edges that are drawn as lines.
    line_px : float
        Their width.
    """

    places: Array
    triangles: Indices
    eyes: Sequence[tuple[Array, float]]
    colours: Array
    borders: Indices | None = None
    line_px: float = 2.0


@cache
def front() -> Front:
    """The part of the built-in head that characters with its topology keep."""
    from evalkit.dense.actors import TEMPLATE_VERTICES
    from evalkit.dense.anatomy import front_of
    from evalkit.head import load_head

    return front_of(load_head("template", vertices=TEMPLATE_VERTICES))


@cache
def lining() -> NDArray[np.bool_]:
    """Which vertices of :func:`front` are in the mouth."""
    from evalkit.dense.actors import TEMPLATE_VERTICES
    from evalkit.head import load_head

    head = load_head("template", vertices=TEMPLATE_VERTICES)
    outside = head.part_vertices("skin", "lids")
    return np.isin(front().kept, np.setdiff1d(head.part_vertices("mouth pocket"), outside))


def paper_like() -> Task:
    """A face of very different proportions, as the monkey of the paper, and rough shapes by Deformation Transfer.

    Both faces have the same triangles: what is measured is the methods and not a correspondence.
    """
    from evalkit.dense.characters import muzzle_character
    from evalkit.studies.transfers import own_training
    from evalkit.transfer.correspondence import Correspondence, topology_hash
    from evalkit.transfer.deformation_transfer import DeformationTransfer, still_vertices

    def transfer(rest: Array, triangles: Indices, shapes: Array, there: Array) -> Array:
        own, name = np.arange(len(triangles)), topology_hash(triangles)
        same = Correspondence(own, own, name, name)
        still = still_vertices(rest, triangles, shapes, triangles, same)
        return DeformationTransfer(rest, triangles, there, triangles, same, still).transfer(shapes)

    return own_training(muzzle_character(transfer=transfer), 0)


def rest_rows(rest: Array, which: Indices) -> list[dict[str, Any]]:
    """A row for each of these vertices at rest, and one for each eyeball: number, x_mm, y_mm, z_mm, radius_mm."""
    places = [
        {"number": int(number), **dict(zip(XYZ, place, strict=True))}
        for number, place in zip(which, np.round(rest[which], 1).tolist(), strict=True)
    ]
    return places + [
        {"number": number, **dict(zip(XYZ, np.round(middle, 1).tolist(), strict=True)),
         "radius_mm": round(radius, 1)}
        for number, (middle, radius) in enumerate(_eyeballs(rest))
    ]  # fmt: skip


def _eyeballs(rest: Array) -> list[tuple[Array, float]]:
    """Spheres behind the margins of the lids: these are a loop around a hole, near the eyeball all around."""
    from evalkit.dense.actors import muscle_actor

    actor = muscle_actor()
    found = []
    for middle in actor.anatomy.eyes.values():
        lids = actor.regions["lids"]
        near = lids[np.sign(actor.rest[lids, 0]) == np.sign(middle[0])]
        # An affine map of this side's lids takes the middle of the eye along.
        known = np.c_[actor.rest[near], np.ones(len(near))]
        affine = np.linalg.lstsq(known, rest[near], rcond=None)[0]
        there = np.r_[middle, 1.0] @ affine
        found.append((there, float(np.linalg.norm(rest[near] - there, axis=1).min()) - LID_MM))
    return found


def vertex_rows(rows: pd.DataFrame) -> pd.DataFrame:
    """Those of such rows that are a vertex, in order."""
    return rows[rows["radius_mm"].isna() & rows["x_mm"].notna()].sort_values("number")


def rest_of(rows: pd.DataFrame) -> tuple[Indices, Array, list[tuple[Array, float]]]:
    """Numbers and places (V, 3), mm, of the vertices, and the eyeballs, of such rows."""
    vertices = vertex_rows(rows)
    balls = [
        (np.array(place), float(radius))
        for *place, radius in rows.dropna(subset=["radius_mm"])[[*XYZ, "radius_mm"]].itertuples(index=False)
    ]
    return vertices["number"].to_numpy(dtype=int), vertices[list(XYZ)].to_numpy(dtype=float), balls


def seen_triangles(rest: Array) -> Indices:
    """Triangles of :func:`front` that are drawn, by the places (V, 3), mm, of all its vertices at rest."""
    triangles = front().triangles
    return np.asarray(triangles[(rest[triangles, 2] > BEHIND_MM).all(axis=1)])


def shaded(vertices: Indices, values: Array | None) -> Array:
    """Colours (V, 3) of some vertices by values (V,) from 0 to 1, or of bare skin; the lining of the mouth is dark."""
    from matplotlib import colormaps

    colours = np.tile(SKIN, (len(vertices), 1))
    if values is not None:
        colours = colormaps[ERROR_MAP](np.clip(values, 0.0, 1.0))[:, :3]
    colours[lining()[vertices]] = POCKET
    return np.asarray(colours)


def drawn(
    faces: Sequence[Face], columns: int, middle: tuple[float, float, float] | None = None, half_mm: float | None = None
) -> list[NDArray[np.uint8]]:
    """Pictures (H, W, 3) of faces, all from one window: to open one takes longer than to draw.

    Other than the whole face is seen with a ``middle``, mm, and half the height, mm.

    Raises
    ------
    EvalkitError
        If nothing can be drawn without a screen here.
    """
    width, height = TILE
    rows = -(-len(faces) // columns)
    with offscreen_plotter(columns * width, rows * height, shape=(rows, columns), border=False) as opened:
        plotter: Any = opened
        plotter.suppress_rendering = True
        for k, face in enumerate(faces):
            plotter.subplot(k // columns, k % columns)
            plotter.set_background("white")
            _add(plotter, face, middle or MIDDLE, half_mm or HALF_MM)
        plotter.suppress_rendering = False
        plotter.render_window.SetMultiSamples(8)
        sheet = np.asarray(plotter.screenshot(None, return_img=True))
    return [
        sheet[height * (k // columns) :, width * (k % columns) :][:height, :width].copy() for k in range(len(faces))
    ]


def _add(plotter: Any, face: Face, middle: tuple[float, float, float], half_mm: float) -> None:
    import pyvista

    yaw = np.deg2rad(YAW_DEG)
    toward = np.array([np.sin(yaw), 0.0, np.cos(yaw)])
    mesh = pyvista.PolyData.from_regular_faces(np.asarray(face.places, dtype=np.float64), face.triangles.astype(int))
    of_vertices = len(face.colours) == len(face.places)
    (mesh.point_data if of_vertices else mesh.cell_data)["rgb"] = np.rint(255 * face.colours).astype(np.uint8)
    plotter.add_mesh(
        mesh, scalars="rgb", rgb=True, smooth_shading=True, split_sharp_edges=False, ambient=0.35, diffuse=0.7
    )
    if face.borders is not None:
        lines = np.c_[np.full(len(face.borders), 2), face.borders].ravel()
        drawn_lines = pyvista.PolyData(face.places + BORDER_MM * toward, lines=lines)
        plotter.add_mesh(drawn_lines, color="black", line_width=face.line_px, lighting=False)
    for centre, radius in face.eyes:
        share, ahead = IRIS
        iris = centre + np.array([0.0, 0.0, ahead * radius])
        plotter.add_mesh(pyvista.Sphere(radius=radius, center=centre), color="#f4f2ee", ambient=0.4, diffuse=0.6)
        plotter.add_mesh(pyvista.Sphere(radius=share * radius, center=iris), color="#3a332e", ambient=0.5)
    plotter.camera.parallel_projection = True
    plotter.camera.focal_point = middle
    plotter.camera.position = np.array(middle) + 500.0 * toward
    plotter.camera.up = (0.0, 1.0, 0.0)
    plotter.camera.parallel_scale = half_mm
    plotter.camera.clipping_range = (50.0, 1500.0)


def areas(rest: Array, triangles: Indices) -> Array:
    """Area of each triangle mm²."""
    a, b, c = (rest[triangles[:, k]] for k in range(3))
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


def tints(count: int) -> Array:
    """Colours (count, 3) for regions: hues in turn at three lightnesses, so that neighbours differ in both."""
    from colorsys import hls_to_rgb

    golden = 0.381966
    light = (0.75, 0.45, 0.6)
    return np.array([hls_to_rgb((0.6 + k * golden) % 1.0, light[k % 3], 0.65) for k in range(count)])


def region_face(
    rest: Array, triangles: Indices, eyes: Sequence[tuple[Array, float]], labels: Indices, colours: Array
) -> Face:
    """A face at rest with the regions (T,) of its triangles in their colours, and lines where they meet."""
    seen = (rest[triangles, 2] > BEHIND_MM).all(axis=1)
    triangles, labels = triangles[seen], labels[seen]
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, which = np.unique(sides, axis=0, return_inverse=True)
    low, high = np.full(len(edges), np.inf), np.full(len(edges), -np.inf)
    np.minimum.at(low, which.ravel(), np.repeat(labels, 3))
    np.maximum.at(high, which.ravel(), np.repeat(labels, 3))
    shown = colours[labels]
    shown[lining()[triangles].all(axis=1)] = POCKET
    return Face(rest, triangles, eyes, shown, edges[low < high])
