"""``evalkit track``: a video of a face in, head pose and control parameters out."""

from __future__ import annotations

import itertools
import json
import select
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from evalkit.errors import EvalkitError

if TYPE_CHECKING:
    from evalkit.geometry import Array
    from evalkit.report.track import TrackedVideo
    from evalkit.vision.camera import Camera
    from evalkit.vision.tracker import Picture
    from evalkit.vision.video import Video

RECORDING = "recording.mp4"
RECORDING_CRF = 12
"""Of what a camera shows: the tracker sees what the encoder left."""

MANY_LOST = 0.5
"""Share of lost frames that asks for a warning."""


@click.command()
@click.argument("source", metavar="VIDEO|FOLDER|CAMERA")
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="DIR", help="Folder for the results.")
@click.option("--points", type=click.Path(path_type=Path), metavar="POINTS.json", help="Of the first frame.")
@click.option("--eyes", metavar="X,Y,X,Y", help="Middles of both eyes in the first frame: a mean face is put on them.")
@click.option("--first-frame", type=click.Path(path_type=Path), metavar="PNG", help="Write that frame and stop.")
@click.option("--start", default=0, show_default=True, metavar="FRAME", help="First frame, from 0: face at rest.")
@click.option("--frames", type=click.IntRange(min=1), metavar="N", help="Frames at most.")
@click.option("--rate", type=float, metavar="HZ", help="Frames per second, if not as the file says (folder: 25).")
@click.option("--camera-fov", type=float, metavar="DEG", help="Of the picture's longer side  [default: assumed, 50]")
@click.option(
    "--method", default="learnt-relief", show_default=True, metavar="NAME", help="Tracker of the head's pose."
)
@click.option(
    "--depth", type=click.Choice(["learnt", "face", "cylinder"]), default="learnt", show_default=True,
    help="Depths of the points.",
)  # fmt: skip
@click.option("--no-overlay", is_flag=True, help="Write no overlay.mp4.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON instead of text.")
def track(
    source: str, output: Path | None, points: Path | None, eyes: str | None, first_frame: Path | None, start: int,
    frames: int | None, rate: float | None, camera_fov: float | None, method: str, depth: str, no_overlay: bool,
    as_json: bool,
) -> None:  # fmt: skip
    """Follow the face in VIDEO, a folder of pictures or a camera (its number, 0 for the first).

    Where the face's points are in the first frame is read from --points, put as a mean face on --eyes, or else found
    by the face detector (pip install 'evalkit[vision]'). Written are pose.csv, parameters.csv and
    parameters_normalised.csv, points.csv, summary.json, overlay.mp4 and report.html; every frame has a status, and
    one that is "lost" has no numbers. A camera is recorded first, into recording.mp4, until q and Enter or --frames.

    \b
    Examples:
        evalkit track talk.mp4 -o talk
        evalkit track talk.mp4 --first-frame first.png
        evalkit head edit first.png --points points.json
        evalkit track talk.mp4 --points points.json -o talk
        evalkit track 0 --frames 300 -o me
    """
    if points is not None and eyes is not None:
        raise click.UsageError("give either --points or --eyes")
    if output is None and first_frame is None:
        raise click.UsageError("say where to: -o DIR (or --first-frame PNG)")
    if find_spec("cv2") is None:
        raise EvalkitError("OpenCV is missing: pip install 'evalkit[vision]'")
    _check(method, start)
    if first_frame is not None:
        _write_first(_opened(source, rate, None, None), start, first_frame)
        click.echo(f"wrote {first_frame}")
        return
    assert output is not None
    from evalkit.report.track import FILES, TrackedVideo, summary, write_summary, write_tables
    from evalkit.report.transfer import protect_inputs
    from evalkit.results import check_output, staged

    check_output(output)
    inputs = [Path(source), *([points] if points else [])]
    protect_inputs(output, FILES, inputs)
    video = _opened(source, rate, output, frames)
    first = _frame(video, start)
    places, origin = _points(video, first, start, points, eyes)
    camera = _camera(video, camera_fov)
    with _about(video, start):
        surface = _surface(places, camera)
    found = _followed(video, places, camera, method, depth, start, frames)
    tracked = TrackedVideo(video, found, start, places, origin, depth, _warnings(video, found, start, frames))
    content = summary(tracked)
    with staged(output) as stage:
        write_tables(tracked, stage)
        _draw(tracked, surface, content, None if no_overlay else stage / "overlay.mp4", stage / "report.html")
        write_summary(content, stage)
        written = [str(output / path.name) for path in sorted(stage.iterdir())]
    if as_json:
        click.echo(json.dumps({**content, "written": written}, indent=2))
    else:
        click.echo(describe(content, written))


def _check(method: str, start: int) -> None:
    from evalkit.vision.trackers import missing, trackers

    if method not in trackers:
        raise EvalkitError(f"--method {method}: known are {', '.join(trackers)}")
    if lacking := missing(method):
        raise EvalkitError(f"--method {method}: {lacking}")
    if start < 0:
        raise EvalkitError(f"--start {start}: frames count from 0")


def _opened(source: str, rate: float | None, output: Path | None, frames: int | None) -> Video:
    """The video; of a camera, what it shows until the user has enough, as a file in the output folder."""
    from evalkit.vision.video import read_video

    if not source.isdecimal() or Path(source).exists():
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

    typed = sys.stdin.isatty()
    if frames is None and not typed:
        raise EvalkitError(f"camera {live.source}: say how long with --frames N; there is no terminal to type q in")
    if typed:
        click.echo("recording; q and Enter to stop", err=True)
    times: list[float] = []
    with (
        staged(output) as stage,
        written_video(stage / RECORDING, live.size, live.rate_hz, RECORDING_CRF) as add,
        _progress("recording", frames) as done,
    ):
        for frame in itertools.islice(live, frames):
            add(frame)
            times.append(time.monotonic())
            done(len(times))
            if typed and select.select([sys.stdin], [], [], 0)[0] and sys.stdin.readline().strip() == "q":
                break
    if not times:
        raise EvalkitError(f"camera {live.source}: shows nothing")
    return (len(times) - 1) / (times[-1] - times[0]) if times[-1] > times[0] else live.rate_hz


def _frame(video: Video, index: int) -> Picture:
    found = next(itertools.islice(video, index, None), None)
    if found is None:
        raise EvalkitError(f"{video.source}: has no frame {index} to start from")
    return found


def _write_first(video: Video, start: int, path: Path) -> None:
    """A frame as a picture, for placing points on."""
    import cv2

    if path.suffix.lower() != ".png":
        raise EvalkitError(f"--first-frame {path}: give the name of a .png file")
    if path.exists():
        raise EvalkitError(f"{path}: is there already; choose another name")
    coded = cv2.imencode(".png", _frame(video, start))[1]
    try:
        path.write_bytes(coded.tobytes())
    except OSError as error:
        raise EvalkitError(f"{path}: cannot be written ({error.strerror or error})") from error


def _points(video: Video, first: Picture, start: int, file: Path | None, eyes: str | None) -> tuple[Array, str]:
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


def _camera(video: Video, view_deg: float | None) -> Camera:
    import dataclasses

    from evalkit.vision.camera import ASSUMED_VIEW_DEG, Camera

    made = Camera.assumed_for(*video.size, view_deg=ASSUMED_VIEW_DEG if view_deg is None else view_deg)
    return made if view_deg is None else dataclasses.replace(made, assumed=False)


def _surface(points_px: Array, camera: Camera) -> Any:
    from evalkit.vision.initial import start_from_points

    return start_from_points(points_px, camera).surface


@contextmanager
def _about(video: Video, start: int) -> Iterator[None]:
    """Errors say which video they are about."""
    try:
        yield
    except EvalkitError as error:
        text = str(error)
        known = text.startswith(str(video.source))
        raise EvalkitError(text if known else f"{video.source}, from frame {start}: {text}") from error


def _followed(
    video: Video, places: Array, camera: Camera, method: str, depth: str, start: int, frames: int | None
) -> Any:  # fmt: skip
    from evalkit.vision.track import track as follow
    from evalkit.vision.trackers import trackers

    with _about(video, start), _progress("tracking", _expected(video, start, frames)) as done:
        return follow(
            _part(video, start, frames), places, camera, trackers[method].build(), method, depth, video.rate_hz, done
        )


def _part(video: Video, start: int, frames: int | None) -> Iterator[Picture]:
    return itertools.islice(video, start, None if frames is None else start + frames)


def _expected(video: Video, start: int, frames: int | None) -> int | None:
    """Frames to come, as far as the file can be believed."""
    if video.claimed_count is None or video.claimed_count <= start:
        return frames
    left = video.claimed_count - start
    return left if frames is None else min(left, frames)


def _warnings(video: Video, found: Any, start: int, frames: int | None) -> list[str]:
    from evalkit.vision.tracker import TrackStatus

    out = []
    count = len(found.head.status)
    claimed = _expected(video, start, frames)
    if claimed is not None and count < claimed:
        out.append(f"the file speaks of {claimed + start:,} frames; {count + start:,} could be read")
    lost = float((found.head.status == TrackStatus.LOST).mean())
    if lost > MANY_LOST:
        out.append(f"the face is lost in {lost:.0%} of the frames; look at overlay.mp4, and try another --start")
    return out


def _draw(
    tracked: TrackedVideo, surface: Any, content: dict[str, Any], film: Path | None, page: Path
) -> None:  # fmt: skip
    """The overlay of every frame into a video, and some of them into the report."""
    from contextlib import nullcontext

    from evalkit.render.overlay import Overlay
    from evalkit.render.video_file import written_video
    from evalkit.report.track_page import chosen_stills, write_track_report

    video, head = tracked.video, tracked.track.head
    overlay, count = Overlay(tracked.track, surface, tracked.start), len(head.status)
    wanted, stills = set(chosen_stills(head.status)), []
    size = overlay.size(*video.size)
    opened: Any = nullcontext() if film is None else written_video(film, size, video.rate_hz)
    with opened as add, _progress("drawing", count) as done:
        for k, frame in enumerate(_part(video, tracked.start, count)):
            if add is None and k not in wanted:
                continue
            picture = overlay.drawn(frame, k)
            if k in wanted:
                stills.append((k, picture))
            if add is not None:
                add(picture)
            done(k + 1)
    write_track_report(tracked, content, stills, page)


@contextmanager
def _progress(label: str, length: int | None) -> Iterator[Callable[[int], None]]:
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


def describe(content: dict[str, Any], written: list[str]) -> str:
    """What was done, in a few lines of text."""
    source, counts, camera = content["input"], content["frames"], content["camera"]
    lines = [
        f"{source['frames']:,} frames at {source['rate_hz']:g} per second: {counts['tracked']:,} tracked, "
        f"{counts['weak']:,} weak, {counts['lost']:,} lost",
        f"points from {content['points']['from']}; {100 * content['parameters_known']:.0f} % of the parameters known",
        f"camera: field of view {camera['view_deg']:.1f} deg ({'assumed' if camera['assumed'] else 'given'})",
    ]
    if content["lost"]:
        spans = [f"{a} to {b}" for a, b in content["lost"]]
        lines.append(f"lost in frames {', '.join(spans[:6])}" + (", ..." if len(spans) > 6 else ""))
    lines += [f"warning: {note}" for note in content["warnings"]]
    return "\n".join([*lines, *(f"wrote {path}" for path in written)])
