"""What every command about a video needs: to open it, to find its first points, its camera, and a bar of progress."""

from __future__ import annotations

import itertools
import select
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from evalkit.errors import EvalkitError

if TYPE_CHECKING:
    from evalkit.geometry import Array
    from evalkit.vision.camera import Camera
    from evalkit.vision.tracker import Picture
    from evalkit.vision.video import Video

RECORDING = "recording.mp4"
RECORDING_CRF = 12
"""Of what a camera shows: the tracker sees what the encoder left."""


def is_camera(source: str | None) -> bool:
    """Whether it is the number of a camera, and no file of that name."""
    return source is not None and source.isdecimal() and not Path(source).exists()


def watched(camera: Video, frames: int | None) -> Iterator[Picture]:
    """Frames of a camera as they come, until there are enough or q and Enter are typed."""
    typed = sys.stdin.isatty()
    if frames is None and not typed:
        raise EvalkitError(f"camera {camera.source}: say how long with --frames N; there is no terminal to type q in")
    if typed:
        click.echo("q and Enter to stop", err=True)
    return itertools.takewhile(lambda _: not (typed and _stopped()), itertools.islice(camera, frames))


def _stopped() -> bool:
    return bool(select.select([sys.stdin], [], [], 0)[0]) and sys.stdin.readline().strip() == "q"


def opened(source: str, rate: float | None, output: Path | None, frames: int | None) -> Video:
    """The video; of a camera, what it shows until the user has enough, as a file in the output folder."""
    from evalkit.vision.video import read_video

    if not is_camera(source):
        return read_video(source, rate)
    live = read_video(int(source), rate)
    if output is None:
        return live
    rate_hz = _record(live, output, frames)
    return read_video(output / RECORDING, rate or rate_hz)


def _record(live: Video, output: Path, frames: int | None) -> float:
    """Write what a camera shows to a file; its rate as the clock has it, which is seldom what cameras say."""
    from evalkit.render.video_file import written_video
    from evalkit.results import staged

    seen = watched(live, frames)
    times: list[float] = []
    with (
        staged(output) as stage,
        written_video(stage / RECORDING, live.size, live.rate_hz, RECORDING_CRF) as add,
        progress("recording", frames) as done,
    ):
        for frame in seen:
            add(frame)
            times.append(time.monotonic())
            done(len(times))
    if not times:
        raise EvalkitError(f"camera {live.source}: shows nothing")
    return (len(times) - 1) / (times[-1] - times[0]) if times[-1] > times[0] else live.rate_hz


def frame_of(video: Video, index: int) -> Picture:
    """One frame; an error in one line if there is no such frame."""
    found = next(itertools.islice(video, index, None), None)
    if found is None:
        raise EvalkitError(f"{video.source}: has no frame {index} to start from")
    return found


def first_points(video: Video, first: Picture, start: int, file: Path | None, eyes: str | None) -> tuple[Array, str]:
    """The 19 points in the first frame, and where they are from."""
    if file is not None:
        from evalkit.vision.points_file import read_face_points

        return read_face_points(file, video.size), "file"
    if eyes is not None:
        return _on_eyes(video, first, eyes), "eyes"
    return _detected(video, first, start), "detector"


def _on_eyes(video: Video, first: Picture, eyes: str) -> Array:
    """The points of a mean face on both eyes."""
    import numpy as np

    from evalkit.cli.head import eyes_of
    from evalkit.head.photo import Photo
    from evalkit.head.points import propose_points
    from evalkit.vision.points import face_points
    from evalkit.vision.points_file import check_inside

    placed = eyes_of(eyes)
    if not all(0 <= x <= wide for place in placed for x, wide in zip(place, video.size, strict=True)):
        raise EvalkitError(f"--eyes {eyes}: outside of the frame, {video.size[0]} x {video.size[1]} pixels")
    photo = Photo(np.ascontiguousarray(first[..., ::-1]), video.size, str(video.source), "")
    points = face_points(propose_points(photo, placed).places)
    check_inside(points, video.size, f"--eyes {eyes}")
    return points


def _detected(video: Video, first: Picture, start: int) -> Array:
    """The points of the largest face that the detector finds."""
    import numpy as np

    from evalkit.head.detector import DETECTED, landmarker
    from evalkit.vision.points import face_points
    from evalkit.vision.trackers import missing_detector

    if lacking := missing_detector():
        raise EvalkitError(
            f"{video.source}: where is the face? give --points (place them with --first-frame first.png and evalkit "
            f"head edit first.png) or --eyes, or let the face detector find it: {lacking}"
        )
    with landmarker() as detect:
        faces = detect(np.ascontiguousarray(first[..., ::-1]))
    if not faces:
        raise EvalkitError(
            f"{video.source}: the detector finds no face in frame {start}; choose another with --start, or give "
            "--points or --eyes"
        )
    largest = max(faces, key=lambda face: float(np.ptp(face.landmarks[:, 1])))
    return face_points({name: largest.landmarks[k, :2] for name, k in DETECTED.items()})


def camera_of(video: Video, view_deg: float | None) -> Camera:
    """The video's camera, with the field of view that is given or assumed."""
    import dataclasses

    from evalkit.vision.camera import ASSUMED_VIEW_DEG, Camera

    made = Camera.assumed_for(*video.size, view_deg=ASSUMED_VIEW_DEG if view_deg is None else view_deg)
    return made if view_deg is None else dataclasses.replace(made, assumed=False)


@contextmanager
def about(video: Video, start: int) -> Iterator[None]:
    """Errors say which video they are about."""
    try:
        yield
    except EvalkitError as error:
        text = str(error)
        known = text.startswith(str(video.source))
        raise EvalkitError(text if known else f"{video.source}, from frame {start}: {text}") from error


def part_of(video: Video, start: int, frames: int | None) -> Iterator[Picture]:
    """Frames from the first one on, at most as many as asked for."""
    return itertools.islice(video, start, None if frames is None else start + frames)


def expected_frames(video: Video, start: int, frames: int | None) -> int | None:
    """Frames to come, as far as the file can be believed."""
    if video.claimed_count is None or video.claimed_count <= start:
        return frames
    left = video.claimed_count - start
    return left if frames is None else min(left, frames)


@contextmanager
def progress(label: str, length: int | None) -> Iterator[Callable[[int], None]]:
    """A bar on the terminal; without a total where nobody knows it, or as soon as it proves wrong."""
    if not sys.stderr.isatty():
        yield lambda done: None
        return
    counting: Any = click.progressbar(
        itertools.repeat(None) if length is None else None, length, label, file=sys.stderr, show_pos=True
    )
    with counting as bar:

        def tell(done: int) -> None:
            if bar.length is not None and done > bar.length:
                bar.length = None
            bar.update(done - bar.pos)

        yield tell
