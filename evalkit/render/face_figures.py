"""Still pictures of an animation: the markers, the head, its feature points, and snapshots.

They show what Fig. 1, 3, 4 (b) and 5 of Huang, Lin & Ouhyoung (2000) show.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

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

MODEL_VIEW = View(yaw_deg=24.0, pitch_deg=6.0)
"""Of the model and its wireframe."""

SHEET_FRAMES = 12

FONT = 34
"""The letters of names are so many times lower than a picture: 6 points, where the picture is 2.8 inches high."""

LETTERS = "abcdefghijklmnop"


class Window(NamedTuple):
    """What a picture in parallel projection shows: its middle (3,), mm, and half of its height, mm."""

    middle: Array
    half_mm: float

    @classmethod
    def around(cls, points: Array) -> Window:
        """All of some points (n, 3), with room about them."""
        low, high = points.min(axis=0), points.max(axis=0)
        return cls((low + high) / 2, float((high - low).max()) * 0.62)


def write_snapshots(animation: Animation, directory: Path) -> list[str]:
    """Draw all pictures of an animation into a folder; returns their names.

    Raises
    ------
    EvalkitError
        If nothing can be drawn without a screen here.
    """
    from PIL import Image as Pillow

    head = animation.head
    drawings: dict[str, Callable[[], Image]] = {
        "markers.png": lambda: beside(_markers_in_space(animation), _markers_on_face(animation)),
        "head.png": lambda: beside(head_model(head), plate_wireframe(head)),
        "landmarks.png": lambda: feature_points(head, head.landmarks),
        "snapshots.png": lambda: snapshots_of(animation),
        "sheet.png": lambda: contact_sheet(animation),
    }
    for name, draw in drawings.items():
        Pillow.fromarray(draw()).save(directory / name, optimize=True)
    return list(drawings)


def _markers_in_space(animation: Animation) -> Image:
    places = np.nanmedian(animation.still_markers, axis=0)
    return markers_in_space(dict(zip(animation.report["marker_order"], places, strict=True)), animation.pivot)


def _markers_on_face(animation: Animation) -> Image:
    sites = animation.head.marker_sites
    return markers_on_face(
        animation.head, {name: sites[name] for name in animation.report["markers"] if name in sites},
        [animation.placed[label] for label in animation.report["placed"]],
    )  # fmt: skip


def markers_in_space(places: Mapping[str, Array], pivot: Array | None, window: Window | None = None) -> Image:
    """The markers at rest with the edges between neighbours, the triangle on the forehead, and the pivot; Fig. 1 (a).

    Parameters
    ----------
    places : mapping of str to ndarray, shape (3,), mm
        Marker to where it is at rest; those of :data:`TRIANGLE` are the rigid ones.
    pivot : ndarray, shape (3,), mm, or None
    window : Window, optional
        What is in the picture; by default, all of it.
    """
    import pyvista

    points = np.array(list(places.values()))
    rigid = [k for k, name in enumerate(places) if name in TRIANGLE]
    everything = points if pivot is None else np.vstack([points, pivot])
    middle, half = window or Window.around(everything)
    with _canvas("white", 3 * SIZE // 4) as plotter:
        for a, b in face_edges(points):
            plotter.add_mesh(pyvista.Line(points[a], points[b]), color=colours.GREY, line_width=2, lighting=False)
        free = np.delete(points, rigid, axis=0)
        if len(free):
            plotter.add_mesh(_balls(free, 2.4), color=colours.FREE, smooth_shading=True)
        if rigid:
            plotter.add_mesh(_balls(points[rigid], 3.0), color=colours.RIGID, smooth_shading=True)
        if len(rigid) == 3:
            plotter.add_mesh(pyvista.Triangle(points[rigid]), color=colours.RIGID, opacity=0.35, lighting=False)
        if pivot is not None:
            for k in rigid or range(len(points)):
                plotter.add_mesh(pyvista.Line(points[k], pivot), color=colours.RIGID, line_width=2, lighting=False)
            plotter.add_mesh(pyvista.Sphere(radius=4.0, center=pivot), color=colours.BLACK, smooth_shading=True)
        side = _rotation(48.0, -8.0)
        plotter.camera.parallel_projection = True
        plotter.camera.position = middle + 8.0 * half * side[:, 2]
        plotter.camera.focal_point = middle
        plotter.camera.up = (0.0, 1.0, 0.0)
        plotter.camera.parallel_scale = half
        plotter.camera.clipping_range = (half, 20.0 * half)
        picture, at = _taken(plotter), _seen_at(plotter, {} if pivot is None else {"pivot": pivot})
    return _with_scale_bar(_worded(picture, at), 2.0 * half / SIZE)


def markers_on_face(head: Head, sites: Mapping[str, Array], others: Sequence[Array] = ()) -> Image:
    """Where the markers sit on a head, their names beside it, as Fig. 1 (b); markers without a name in another colour.

    Parameters
    ----------
    head : Head
    sites : mapping of str to ndarray, shape (3,), mm
    others : sequence of ndarray, shape (3,), mm
    """
    triangle = [sites[name] for name in TRIANGLE if name in sites]
    return _named(*_face_with_points(head, sites, triangle=triangle, others=others))


def head_model(head: Head, parts: Collection[str] | None = None) -> Image:
    """The 2.5D head, as Fig. 3 (a); all parts by default."""
    with _canvas(BACKGROUND) as plotter:
        draw_head(plotter, head, MODEL_VIEW, without=_lacking(head, parts))
        return _upright(_taken(plotter))


def plate_wireframe(head: Head, parts: Collection[str] | None = None) -> Image:
    """The wireframe with the hair in the plate behind it, as Fig. 3 (b); all parts by default."""
    with _canvas(BACKGROUND) as plotter:
        lacking = _lacking(head, parts)
        if "plate" not in lacking:
            draw_head(plotter, head, MODEL_VIEW, without=tuple(part for part in head.parts if part != "plate"))
        draw_head(plotter, head, MODEL_VIEW._replace(wireframe=True), without=lacking)
        return _upright(_taken(plotter))


def _lacking(head: Head, parts: Collection[str] | None) -> tuple[str, ...]:
    return () if parts is None else tuple(part for part in head.parts if part not in parts)


def feature_points(head: Head, points: Mapping[str, Array]) -> Image:
    """The head with the points (3,), mm, that are placed on a photo, as Fig. 4 (b)."""
    return _named(*_face_with_points(head, points))


def snapshots_of(animation: Animation) -> Image:
    """Telling frames of an animation, as Fig. 5."""
    return snapshots(animation.head, animation.vertices(telling_frames(animation)))


def snapshots(
    head: Head, vertices: Array, views_deg: Sequence[tuple[float, float]] = VIEWS_DEG, size: int | None = None
) -> Image:
    """Several views and mouth shapes, the last one as a wireframe, as Fig. 5 (a) to (g).

    Parameters
    ----------
    head : Head
    vertices : ndarray, shape (f, V, 3), mm
        One frame for each view.
    views_deg : sequence of (float, float)
        Yaw and pitch of each.
    size : int, optional
        Height of each, pixels; :data:`SIZE` by default.
    """
    pictures = []
    size, last = size or SIZE, len(views_deg) - 1
    for wireframe, which in ((False, range(last)), (True, range(last, last + 1))):
        with HeadScene(head, (size, size), multisamples=8, wireframe=wireframe) as scene:
            for k in which:
                scene.pose(*_turned(head, *views_deg[k]))
                pictures.append(_upright(scene.frame(vertices[k])))
    return in_rows(pictures, 4)


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
            pictures.append(_titled(_upright(scene.frame(vertices[k])), f"{seconds:.2f} s", SIZE // 30))
    return _filled(pictures, columns)


def _face_with_points(
    head: Head, points: Mapping[str, Array], *, triangle: Sequence[Array] = (), others: Sequence[Array] = ()
) -> tuple[Image, dict[str, Array]]:
    """The head from the front with dots on it, and where in the picture the named ones are."""
    import pyvista

    lift = np.array([0.0, 0.0, 2.0])
    with _canvas(BACKGROUND) as plotter:
        draw_head(plotter, head, View())
        places = np.array(list(points.values()))
        if len(triangle) == 3:
            corners = np.array(triangle) + 2.0 * lift
            for a, b in ((0, 1), (1, 2), (2, 0)):
                plotter.add_mesh(pyvista.Line(corners[a], corners[b]), color="white", line_width=4, lighting=False)
        plotter.add_mesh(_balls(places + lift, 2.2), color="white", lighting=False)
        plotter.add_mesh(_balls(places + 2.0 * lift, 1.4), color=colours.VERMILION, lighting=False)
        if len(others):
            plotter.add_mesh(_balls(np.array(others) + lift, 1.3), color=colours.SKY, lighting=False)
        return _taken(plotter), _seen_at(plotter, points)


def _seen_at(plotter: Any, points: Mapping[str, Array]) -> dict[str, Array]:
    """Where in the picture, in pixels from its upper left, points (3,) are."""
    at = {}
    for name, place in points.items():
        plotter.renderer.SetWorldPoint(*place, 1.0)
        plotter.renderer.WorldToDisplay()
        x, y, _ = plotter.renderer.GetDisplayPoint()
        at[name] = np.array([x, SIZE - 1 - y])
    return at


def _named(picture: Image, at: Mapping[str, Array]) -> Image:
    """Names in a column on either side with lines to their points; the performer's left is on the right."""
    from PIL import Image as Pillow
    from PIL import ImageDraw

    size, side = picture.shape[0], 17 * picture.shape[0] // 60
    font = size // FONT
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
    rotation = _rotation(yaw_deg, pitch_deg)
    return rotation, middle - rotation @ middle


def _rotation(yaw_deg: float, pitch_deg: float) -> Array:
    """Yaw about y, then pitch about x."""
    yaw, pitch = np.deg2rad([yaw_deg, pitch_deg])
    return rotation_from_vector(np.array([pitch, 0.0, 0.0])) @ rotation_from_vector(np.array([0.0, yaw, 0.0]))


def _balls(points: Array, radius: float) -> Any:
    import pyvista

    ball = pyvista.Sphere(radius=radius, theta_resolution=20, phi_resolution=20)
    return pyvista.PolyData(np.asarray(points, dtype=np.float64)).glyph(geom=ball, scale=False, orient=False)


@contextmanager
def _canvas(background: str, width: int | None = None) -> Iterator[Any]:
    """A plotter of the height :data:`SIZE`; square by default."""
    with offscreen_plotter(width or SIZE, SIZE, border=False) as plotter:
        canvas: Any = plotter
        canvas.set_background(background)
        yield canvas


def _taken(plotter: Any) -> Image:
    plotter.render_window.SetMultiSamples(8)
    return np.asarray(plotter.screenshot(None, return_img=True))


def _upright(picture: Image) -> Image:
    """Without the left and right eighth, where a head never is."""
    edge = picture.shape[1] // 8
    return picture[:, edge:-edge]


def beside(*pictures: Image) -> Image:
    """Pictures of one height in a row, lettered (a), (b) and so on."""
    return np.concatenate(_lettered(pictures), axis=1)


def in_rows(pictures: Sequence[Image], columns: int, first: int = 0) -> Image:
    """Pictures of one size in rows, lettered (a), (b) and so on, or from another letter on."""
    return _filled(_lettered(pictures, LETTERS[first:]), columns)


def _filled(pictures: Sequence[Image], columns: int) -> Image:
    """Pictures of one size in rows, the last of them filled up with the background."""
    blank = np.broadcast_to(pictures[0][-1, -1], pictures[0].shape)
    every = [*pictures, *[blank] * (-len(pictures) % columns)]
    rows = [np.concatenate(every[k : k + columns], axis=1) for k in range(0, len(every), columns)]
    return np.concatenate(rows)


def _lettered(pictures: Sequence[Image], letters: str = LETTERS) -> list[Image]:
    return [_titled(one, f"({letter})", len(one) // 22) for one, letter in zip(pictures, letters, strict=False)]


def _titled(picture: Image, text: str, font: int) -> Image:
    """A text at the upper left."""
    return _worded(picture, {text: np.array([0.6 * font, 0.4 * font])}, "la", font)


def _worded(picture: Image, at: Mapping[str, Array], anchor: str = "mt", font: int = 0) -> Image:
    """Words at places in a picture; by default below them."""
    from PIL import Image as Pillow
    from PIL import ImageDraw

    sheet = Pillow.fromarray(np.ascontiguousarray(picture))
    for text, (x, y) in at.items():
        below = 0.02 * SIZE if anchor == "mt" else 0.0
        ImageDraw.Draw(sheet).text((x, y + below), text, fill="black", anchor=anchor, font_size=font or SIZE // FONT)
    return np.asarray(sheet)


def _with_scale_bar(picture: Image, mm_per_pixel: float, length_mm: float = 50.0) -> Image:
    """A bar with its length, at the lower left."""
    from PIL import Image as Pillow
    from PIL import ImageDraw

    sheet = Pillow.fromarray(picture)
    draw = ImageDraw.Draw(sheet)
    x, y = 0.05 * SIZE, 0.95 * SIZE
    long = length_mm / mm_per_pixel
    draw.line([x, y, x + long, y], fill="black", width=SIZE // 150)
    draw.text((x + long / 2, y - SIZE / 75), f"{length_mm:g} mm", fill="black", anchor="mb", font_size=SIZE // FONT)
    return np.asarray(sheet)
