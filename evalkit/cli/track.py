"""``evalkit track``: a video of a face in, head pose and control parameters out."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from evalkit.cli.video_source import (
    about,
    camera_of,
    expected_frames,
    first_points,
    frame_of,
    opened,
    part_of,
    progress,
)
from evalkit.errors import EvalkitError

if TYPE_CHECKING:
    from evalkit.geometry import Array
    from evalkit.report.track import TrackedVideo
    from evalkit.vision.camera import Camera
    from evalkit.vision.video import Video

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
        _write_first(opened(source, rate, None, None), start, first_frame)
        click.echo(f"wrote {first_frame}")
        return
    assert output is not None
    from evalkit.report.track import FILES, TrackedVideo, summary, write_summary, write_tables
    from evalkit.report.transfer import protect_inputs
    from evalkit.results import check_output, staged

    check_output(output)
    inputs = [Path(source), *([points] if points else [])]
    protect_inputs(output, FILES, inputs)
    video = opened(source, rate, output, frames)
    first = frame_of(video, start)
    places, origin = first_points(video, first, start, points, eyes)
    camera = camera_of(video, camera_fov)
    with about(video, start):
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


def _write_first(video: Video, start: int, path: Path) -> None:
    """A frame as a picture, for placing points on."""
    import cv2

    if path.suffix.lower() != ".png":
        raise EvalkitError(f"--first-frame {path}: give the name of a .png file")
    if path.exists():
        raise EvalkitError(f"{path}: is there already; choose another name")
    coded = cv2.imencode(".png", frame_of(video, start))[1]
    try:
        path.write_bytes(coded.tobytes())
    except OSError as error:
        raise EvalkitError(f"{path}: cannot be written ({error.strerror or error})") from error


def _surface(points_px: Array, camera: Camera) -> Any:
    from evalkit.vision.initial import start_from_points

    return start_from_points(points_px, camera).surface


def _followed(
    video: Video, places: Array, camera: Camera, method: str, depth: str, start: int, frames: int | None
) -> Any:  # fmt: skip
    from evalkit.vision.track import track as follow
    from evalkit.vision.trackers import trackers

    with about(video, start), progress("tracking", expected_frames(video, start, frames)) as done:
        return follow(
            part_of(video, start, frames), places, camera, trackers[method].build(), method, depth, video.rate_hz, done
        )


def _warnings(video: Video, found: Any, start: int, frames: int | None) -> list[str]:
    from evalkit.vision.tracker import TrackStatus

    out = []
    count = len(found.head.status)
    claimed = expected_frames(video, start, frames)
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
    writing: Any = nullcontext() if film is None else written_video(film, size, video.rate_hz)
    with writing as add, progress("drawing", count) as done:
        for k, frame in enumerate(part_of(video, tracked.start, count)):
            if add is None and k not in wanted:
                continue
            picture = overlay.drawn(frame, k)
            if k in wanted:
                stills.append((k, picture))
            if add is not None:
                add(picture)
            done(k + 1)
    write_track_report(tracked, content, stills, page)


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
