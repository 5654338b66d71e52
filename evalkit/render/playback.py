"""An animation as a video file: the head alone, or beside the markers that drive it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit.animation import Animation
from evalkit.errors import EvalkitError
from evalkit.render import colours
from evalkit.render.head_scene import HeadScene
from evalkit.render.offscreen import require_offscreen

Image = NDArray[np.uint8]

FORMATS = {
    ".mp4": ("libx264", "yuv420p", ("-crf", "18", "-movflags", "+faststart")),
    # One palette from the whole film: one per frame flickers.
    ".gif": ("gif", "pal8", ("-filter_complex", "split[a][b];[a]palettegen=stats_mode=full[p];[b][p]paletteuse")),
}
"""Extension -> encoder, pixel format, further options of ffmpeg."""

SMALLEST, LARGEST = 64, 2048

MULTISAMPLES = 4
"""Against jagged outlines, which crawl when a head turns."""

HELD_MARK = (213, 94, 0)
"""Colour of the bar over frames in which something is held or bridged."""

EDGE_MM = 55.0
"""Longer lines between markers do not follow the face."""


def write_video(
    animation: Animation, path: str | Path, *, size: int = 720, side_by_side: bool = False, markers: bool = False,
    wireframe: bool = False, textured: bool = True, advance: Callable[[int], Any] | None = None,
) -> None:  # fmt: skip
    """Draw every frame of an animation into a video file.

    Parameters
    ----------
    animation : Animation
    path : str or Path
        ``.mp4`` (H.264) or ``.gif``.
    size : int
        Height of the video and width of each picture in it, pixels; made even, as the encoder wants it.
    side_by_side : bool
        The raw and the compensated markers to the left of the head.
    markers : bool
        Draw the markers that drive the head on it.
    wireframe, textured : bool
        As for :class:`~evalkit.render.head_scene.HeadScene`.
    advance : callable, optional
        Called with 1 after each frame.

    Raises
    ------
    EvalkitError
        If the extension or size is not known, nothing can be drawn here, or the file cannot be written. A file that
        is not complete is removed.
    """
    path = Path(path)
    check_video(path, size)
    require_offscreen()
    import imageio_ffmpeg

    codec, pixels, options = FORMATS[path.suffix.lower()]
    size += size % 2
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")
    width = 3 * size if side_by_side else size
    try:
        writer = imageio_ffmpeg.write_frames(
            str(temporary), (width, size), fps=animation.rate_hz, codec=codec, pix_fmt_out=pixels, quality=None,
            macro_block_size=2, ffmpeg_log_level="error", output_params=list(options),
        )  # fmt: skip
        writer.send(None)
        try:
            for picture in pictures(
                animation, size=size, side_by_side=side_by_side, markers=markers, wireframe=wireframe, textured=textured
            ):
                writer.send(np.ascontiguousarray(picture))
                if advance is not None:
                    advance(1)
        finally:
            writer.close()
        temporary.replace(path)
    except OSError as error:
        reason = str(error).strip().splitlines()[-1] if str(error).strip() else "no reason given"
        raise EvalkitError(f"{path}: the video cannot be written ({error.strerror or reason})") from error
    finally:
        temporary.unlink(missing_ok=True)


def check_video(path: Path, size: int) -> None:
    """Refuse a video that cannot be written, before any work is done.

    Raises
    ------
    EvalkitError
        If the extension is not in :data:`FORMATS` or the size out of range.
    """
    if path.suffix.lower() not in FORMATS:
        raise EvalkitError(f"{path}: videos are written as {' or '.join(FORMATS)}")
    if not SMALLEST <= size <= LARGEST:
        raise EvalkitError(f"a video of {size} pixels height; use {SMALLEST} to {LARGEST}")


def pictures(
    animation: Animation, *, size: int = 720, side_by_side: bool = False, markers: bool = False,
    wireframe: bool = False, textured: bool = True,
) -> Iterator[Image]:  # fmt: skip
    """Every frame of an animation as a picture, (size, size or 3 size, 3)."""
    labels = list(animation.deformation.labels)
    places = animation.deformation.centres
    panels = MarkerPanels(animation, size) if side_by_side else None
    with HeadScene(
        animation.head, (size, size), textured, MULTISAMPLES, wireframe=wireframe,
        markers=places if markers and labels else None,
    ) as scene:  # fmt: skip
        for start, batch in animation.batches():
            for k, vertices in enumerate(batch):
                frame = start + k
                scene.pose(animation.rotations[frame], animation.translations[frame])
                drawn = scene.frame(vertices, places + animation.displacements[frame] if markers else None)
                picture = drawn if panels is None else np.concatenate([*panels(frame), drawn], axis=1)
                if animation.held[frame]:
                    picture = picture.copy()
                    picture[: max(size // 90, 2)] = HELD_MARK
                yield picture


class MarkerPanels:
    """The raw and the compensated markers of each frame, seen from the front, both on one scale.

    Parameters
    ----------
    animation : Animation
    size : int
        Pixels of each panel.
    """

    def __init__(self, animation: Animation, size: int) -> None:
        self.size = size
        self._tracks = {"raw markers": animation.raw_markers, "compensated markers": animation.still_markers}
        rest = np.nanmedian(animation.still_markers, axis=0)
        self._edges = face_edges(rest)
        flat = animation.raw_markers[..., :2].reshape(-1, 2)
        flat = flat[np.isfinite(flat[:, 0])]
        # A marker that flies off for a moment must not make the face small.
        low, high = np.percentile(flat, [0.5, 99.5], axis=0) if len(flat) else (rest[:, :2].min(0), rest[:, :2].max(0))
        self._middle = (low + high) / 2
        self._scale = 0.8 * size / max(float((high - low).max()), 1.0)

    def __call__(self, frame: int) -> list[Image]:
        """Both panels of a frame."""
        return [self._draw(name, track[frame]) for name, track in self._tracks.items()]

    def _draw(self, name: str, places: NDArray[np.float64]) -> Image:
        from PIL import Image as Pillow
        from PIL import ImageDraw

        # Drawn twice as large and halved: smooth lines and dots.
        sheet = Pillow.new("RGB", (2 * self.size, 2 * self.size), "white")
        draw = ImageDraw.Draw(sheet)
        at = 2 * (self.size / 2 + self._scale * (places[:, :2] - self._middle) * [1.0, -1.0])
        seen = np.isfinite(at[:, 0])
        for a, b in self._edges:
            if seen[a] and seen[b]:
                draw.line([*at[a], *at[b]], fill=colours.GREY, width=max(self.size // 240, 1))
        radius = max(self.size / 75, 2.0)
        for x, y in at[seen]:
            draw.ellipse([x - radius, y - radius, x + radius, y + radius], fill=colours.FREE)
        draw.text((self.size // 20, self.size // 20), name, fill="black", font_size=max(self.size // 14, 8))
        return np.asarray(sheet.reduce(2))


def face_edges(places: NDArray[np.float64]) -> NDArray[np.intp]:
    """Pairs (E, 2) of neighbouring markers, seen from the front; none where there are too few to have neighbours."""
    from scipy.spatial import Delaunay, QhullError

    seen = np.flatnonzero(np.isfinite(places[:, 0]))
    try:
        corners = Delaunay(places[seen, :2]).simplices
    except (QhullError, ValueError):
        return np.zeros((0, 2), dtype=np.intp)
    pairs = np.unique(np.sort(np.concatenate([corners[:, :2], corners[:, 1:], corners[:, ::2]]), axis=1), axis=0)
    pairs = seen[pairs]
    return pairs[np.linalg.norm(places[pairs[:, 0]] - places[pairs[:, 1]], axis=1) <= EDGE_MM]
