"""Still pictures of an animation: the markers, the head, its feature points, and snapshots.

They show what Fig. 1, 3, 4 (b) and 5 of Huang, Lin & Ouhyoung (2000) show.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit.animation import Animation
from evalkit.geometry import Array, rotation_from_vector
from evalkit.head.model import Head
from evalkit.render import colours
from evalkit.render.head_scene import HeadScene
from evalkit.render.head_views import BACKGROUND, View, draw_head
from evalkit.render.offscreen import offscreen_plotter
from evalkit.render.playback import face_edges

Image = NDArray[np.uint8]

SIZE = 900
"""Pixels of one picture."""

TRIANGLE = ("ForeheadC", "ForeheadL", "ForeheadR")

VIEWS_DEG = ((0.0, 0.0), (24.0, 0.0), (-24.0, 0.0), (12.0, -12.0), (-15.0, 12.0), (0.0, 0.0), (20.0, 0.0))
"""Yaw and pitch of the snapshots (a) to (g): within the 30 degrees that a 2.5D head bears."""

SHEET_FRAMES = 12


def write_snapshots(animation: Animation, directory: Path) -> list[str]:
    """Draw all pictures of an animation into a folder; returns their names.

    Raises
    ------
    EvalkitError
        If nothing can be drawn without a screen here.
    """
    from PIL import Image as Pillow

    drawings: dict[str, Callable[[Animation], Image]] = {
        "markers.png": lambda made: _beside([markers_in_space(made), markers_on_face(made)]),
        "head.png": lambda made: _beside([head_model(made.head), plate_wireframe(made.head)]),
        "landmarks.png": lambda made: feature_points(made.head),
        "snapshots.png": snapshots,
        "sheet.png": contact_sheet,
    }
    for name, draw in drawings.items():
        Pillow.fromarray(draw(animation)).save(directory / name, optimize=True)
    return list(drawings)


def markers_in_space(animation: Animation) -> Image:
    """The markers at rest with the edges between neighbours and to the pivot, as Fig. 1 (a)."""
    import pyvista

    places = np.nanmedian(animation.still_markers, axis=0)
    names = animation.report["marker_order"]
    rigid = [names.index(name) for name in TRIANGLE if name in names]
    lines = [(places[a], places[b]) for a, b in face_edges(places)]
    pivot = animation.pivot
    with offscreen_plotter(SIZE, SIZE, border=False) as plotter:
        _background(plotter, "white")
        for a, b in lines:
            plotter.add_mesh(pyvista.Line(a, b), color=colours.GREY, line_width=2, lighting=False)
        plotter.add_mesh(_balls(np.delete(places, rigid, axis=0), 2.4), color=colours.FREE, smooth_shading=True)
        everything = places
        if rigid:
            plotter.add_mesh(_balls(places[rigid], 3.0), color=colours.RIGID, smooth_shading=True)
        if pivot is not None:
            everything = np.vstack([places, pivot])
            for k in rigid or range(len(places)):
                plotter.add_mesh(pyvista.Line(places[k], pivot), color=colours.RIGID, line_width=2, lighting=False)
            plotter.add_mesh(pyvista.Sphere(radius=4.0, center=pivot), color=colours.BLACK, smooth_shading=True)
        middle = (everything.min(axis=0) + everything.max(axis=0)) / 2
        half = float((everything.max(axis=0) - everything.min(axis=0)).max()) * 0.62
        side = rotation_from_vector(np.deg2rad([-8.0, 0.0, 0.0])) @ rotation_from_vector(np.deg2rad([0.0, 48.0, 0.0]))
        plotter.camera.parallel_projection = True
        plotter.camera.position = middle + 8.0 * half * side[:, 2]
        plotter.camera.focal_point = middle
        plotter.camera.up = (0.0, 1.0, 0.0)
        plotter.camera.parallel_scale = half
        plotter.camera.clipping_range = (half, 20.0 * half)
        if pivot is not None:
            plotter.add_point_labels(
                (pivot - [0.0, 0.08 * half, 0.0])[None], ["pivot"], font_size=22, text_color="black", shape=None,
                show_points=False, always_visible=True,
            )  # fmt: skip
        return _lettered(_taken(plotter), "(a)")


def markers_on_face(animation: Animation) -> Image:
    """Where the markers sit on the head, their names beside it, as Fig. 1 (b)."""
    sites = animation.head.marker_sites
    names = [name for name in animation.report["markers"] if name in sites]
    others = [animation.placed[label] for label in animation.report["placed"]]
    triangle = [sites[name] for name in TRIANGLE if name in names]
    picture, at = _face_with_points(
        animation.head, {name: sites[name] for name in names}, triangle=triangle, others=others
    )
    return _lettered(_named(picture, at), "(b)")


def head_model(head: Head) -> Image:
    """The 2.5D head, as Fig. 3 (a)."""
    with offscreen_plotter(SIZE, SIZE, border=False) as plotter:
        _background(plotter, BACKGROUND)
        draw_head(plotter, head, View(yaw_deg=24.0, pitch_deg=6.0))
        return _lettered(_taken(plotter), "(a)")


def plate_wireframe(head: Head) -> Image:
    """The wireframe with the hair in the plate behind it, as Fig. 3 (b)."""
    view = View(yaw_deg=24.0, pitch_deg=6.0)
    with offscreen_plotter(SIZE, SIZE, border=False) as plotter:
        _background(plotter, BACKGROUND)
        draw_head(plotter, head, view, without=tuple(part for part in head.parts if part != "plate"))
        draw_head(plotter, head, view._replace(wireframe=True))
        return _lettered(_taken(plotter), "(b)")


def feature_points(head: Head) -> Image:
    """The head with the points that are placed on a photo, as Fig. 4 (b)."""
    picture, at = _face_with_points(head, head.landmarks)
    return _named(picture, at)


def snapshots(animation: Animation) -> Image:
    """Several views and mouth shapes of the take, and the wireframe, as Fig. 5 (a) to (g)."""
    frames = telling_frames(animation)
    vertices = animation.vertices(frames)
    pictures = []
    for wireframe, which in ((False, range(6)), (True, range(6, 7))):
        with HeadScene(animation.head, (SIZE, SIZE), multisamples=8, wireframe=wireframe) as scene:
            for k in which:
                scene.pose(*_turned(animation.head, *VIEWS_DEG[k]))
                pictures.append(_lettered(_upright(scene.frame(vertices[k])), f"({'abcdefg'[k]})"))
    blank = np.broadcast_to(pictures[0][-1, -1], pictures[0].shape)
    return np.concatenate([np.concatenate(pictures[:4], axis=1), np.concatenate([*pictures[4:], blank], axis=1)])


def telling_frames(animation: Animation) -> list[int]:
    """Seven frames: rest, mouth widest open, broadest, roundest, half open, brows highest, and widest open again."""
    track = {name: animation.displacements[:, k] for k, name in enumerate(animation.deformation.labels)}
    none = np.zeros((animation.frames, 3))
    opening = -(track.get("LowerLipC", none) - track.get("UpperLipC", none))[:, 1]
    breadth = (track.get("MouthL", none) - track.get("MouthR", none))[:, 0]
    brows = sum((track.get(name, none)[:, 1] for name in ("BrowInL", "BrowInR", "BrowOutL", "BrowOutR")), none[:, 0])
    # Eyes open, where there is a choice: a blink looks like a mistake in a still picture.
    awake = np.where(animation.lids_closed.max(axis=1) < 0.1, 0.0, 1e6)
    still = np.abs(animation.displacements).max(axis=(1, 2))
    wide = int((opening - awake).argmax())
    half = int((np.abs(opening - 0.5 * opening.max()) + awake).argmin())
    return [
        int((still + awake).argmin()), wide, int((breadth - awake - 0.5 * np.abs(opening)).argmax()),
        int((-breadth - awake).argmax()), half, int((brows - awake).argmax()), wide,
    ]  # fmt: skip


def contact_sheet(animation: Animation, columns: int = 4) -> Image:
    """Frames spread over the animation, the one with the mouth widest open among them, with their numbers."""
    count = min(SHEET_FRAMES, animation.frames)
    frames = np.linspace(0, animation.frames - 1, count).astype(int)
    widest = telling_frames(animation)[1]
    frames[int(np.abs(frames - widest).argmin())] = widest
    vertices = animation.vertices(list(frames))
    pictures = []
    with HeadScene(animation.head, (SIZE // 2, SIZE // 2), multisamples=8) as scene:
        for k, frame in enumerate(frames):
            scene.pose(animation.rotations[frame], animation.translations[frame])
            seconds = frame / animation.rate_hz
            pictures.append(_lettered(_upright(scene.frame(vertices[k])), f"{seconds:.2f} s", small=True))
    while len(pictures) % columns:
        pictures.append(np.full_like(pictures[0], 255))
    rows = [np.concatenate(pictures[k : k + columns], axis=1) for k in range(0, len(pictures), columns)]
    return np.concatenate(rows)


def _face_with_points(
    head: Head, points: Mapping[str, Array], *, triangle: list[Array] | None = None, others: list[Array] | None = None
) -> tuple[Image, dict[str, Array]]:
    """The head from the front with dots on it, and where in the picture the named ones are."""
    import pyvista

    lift = np.array([0.0, 0.0, 2.0])
    with offscreen_plotter(SIZE, SIZE, border=False) as plotter:
        _background(plotter, BACKGROUND)
        draw_head(plotter, head, View())
        places = np.array(list(points.values()))
        if triangle and len(triangle) == 3:
            corners = np.array(triangle) + 2.0 * lift
            for a, b in ((0, 1), (1, 2), (2, 0)):
                plotter.add_mesh(pyvista.Line(corners[a], corners[b]), color="white", line_width=4, lighting=False)
        plotter.add_mesh(_balls(places + lift, 1.8), color="white", lighting=False)
        plotter.add_mesh(_balls(places + 1.2 * lift, 1.1), color=colours.VERMILION, lighting=False)
        if others:
            plotter.add_mesh(_balls(np.array(others) + lift, 1.3), color=colours.SKY, lighting=False)
        picture = _taken(plotter)
        at = {}
        for name, place in points.items():
            plotter.renderer.SetWorldPoint(*place, 1.0)
            plotter.renderer.WorldToDisplay()
            x, y, _ = plotter.renderer.GetDisplayPoint()
            at[name] = np.array([x, SIZE - 1 - y])
    return picture, at


def _named(picture: Image, at: Mapping[str, Array]) -> Image:
    """Names in a column on either side with lines to their points; the performer's left is on the right."""
    from PIL import Image as Pillow
    from PIL import ImageDraw

    size, side = picture.shape[0], 200
    font = size // 48
    sheet = Pillow.new("RGB", (picture.shape[1] + 2 * side, size), BACKGROUND)
    sheet.paste(Pillow.fromarray(picture), (side, 0))
    draw = ImageDraw.Draw(sheet)
    middle = size / 2
    ordered = sorted(at, key=lambda name: (at[name][1], name))
    central = [name for name in ordered if abs(at[name][0] - middle) < size / 200]
    left = sorted([n for n in ordered if at[n][0] < middle and n not in central] + central[::2], key=ordered.index)
    right = [name for name in ordered if name not in left]
    for names, x, anchor in ((left, side - 12, "rm"), (right, side + size + 12, "lm")):
        if not names:
            continue
        wanted = np.array([at[name][1] for name in names])
        rows = _spread(wanted, 1.45 * font, size)
        elbow = side + (0.16 if anchor == "rm" else 0.84) * size
        ends = [at[name] + [side, 0] for name in names]
        for k, y in zip(_uncrossed(elbow, rows, ends), rows, strict=True):
            name, end = names[k], ends[k]
            draw.line([x, y, elbow, y, *end], fill=(70, 70, 70), width=1)
            draw.text((x - 6 if anchor == "rm" else x + 6, y), name, fill="black", anchor=anchor, font_size=font)
    return np.asarray(sheet)


def _uncrossed(elbow: float, rows: Array, ends: list[Array]) -> list[int]:
    """Which point each row of text belongs to, so that no two lines from the elbow to their points cross."""
    order = list(range(len(ends)))

    def crossing(k: int) -> bool:
        (x0, y0), (x1, y1) = ends[order[k]], ends[order[k + 1]]
        # Compared where the nearer of both points is: that is as far as both lines go.
        at = x0 if abs(x0 - elbow) < abs(x1 - elbow) else x1
        first = rows[k] + (y0 - rows[k]) * (at - elbow) / (x0 - elbow or 1.0)
        second = rows[k + 1] + (y1 - rows[k + 1]) * (at - elbow) / (x1 - elbow or 1.0)
        return bool(first > second)

    for _ in range(len(ends)):
        for k in range(len(ends) - 1):
            if crossing(k):
                order[k], order[k + 1] = order[k + 1], order[k]
    return order


def _spread(wanted: Array, apart: float, size: int) -> Array:
    """Heights of lines of text, in order, near where they are wanted and at least so far apart."""
    rows = wanted.copy()
    for k in range(1, len(rows)):
        rows[k] = max(rows[k], rows[k - 1] + apart)
    rows -= max(rows[-1] - (size - apart), 0.0)
    # Pushed up at the lower end, they push on those above.
    for k in range(len(rows) - 2, -1, -1):
        rows[k] = min(rows[k], rows[k + 1] - apart)
    # Half-way back, so that a crowd is centred on its points.
    shift = float(np.mean(rows - wanted))
    return rows - np.clip(shift, 0.0, max(rows[0] - apart, 0.0))


def _turned(head: Head, yaw_deg: float, pitch_deg: float) -> tuple[Array, Array]:
    """Motion that turns the head about its middle."""
    middle = (head.vertices.min(axis=0) + head.vertices.max(axis=0)) / 2
    rotation = rotation_from_vector(np.deg2rad([pitch_deg, 0.0, 0.0])) @ rotation_from_vector(
        np.deg2rad([0.0, yaw_deg, 0.0])
    )
    return rotation, middle - rotation @ middle


def _balls(points: Array, radius: float) -> Any:
    import pyvista

    ball = pyvista.Sphere(radius=radius, theta_resolution=20, phi_resolution=20)
    return pyvista.PolyData(np.asarray(points, dtype=np.float64)).glyph(geom=ball, scale=False, orient=False)


def _background(plotter: Any, colour: str) -> None:
    plotter.set_background(colour)


def _taken(plotter: Any) -> Image:
    plotter.render_window.SetMultiSamples(8)
    return np.asarray(plotter.screenshot(None, return_img=True))


def _upright(picture: Image) -> Image:
    """Without the left and right eighth, where a head never is."""
    edge = picture.shape[1] // 8
    return picture[:, edge:-edge]


def _lettered(picture: Image, text: str, small: bool = False) -> Image:
    from PIL import Image as Pillow
    from PIL import ImageDraw

    sheet = Pillow.fromarray(np.ascontiguousarray(picture))
    size = sheet.height
    ImageDraw.Draw(sheet).text((size // 40, size // 50), text, fill="black", font_size=size // (18 if small else 24))
    return np.asarray(sheet)


def _beside(pictures: list[Image]) -> Image:
    return np.concatenate(pictures, axis=1)
