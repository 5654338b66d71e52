"""``evalkit control``: a video of a face in, a character that does the same out."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from evalkit import __version__
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
from evalkit.geometry import blocks

if TYPE_CHECKING:
    from evalkit.control.character import Character
    from evalkit.control.database import Database
    from evalkit.control.signals import Signal
    from evalkit.control.stream import ControlMotion
    from evalkit.geometry import Array
    from evalkit.vision.video import Video

FILE = click.Path(path_type=Path)

BLOCK = 64
"""Frames whose vertices are computed at a time."""


@click.command()
@click.argument("source", required=False, metavar="VIDEO|FOLDER|CAMERA")
@click.option("--from", "table", type=FILE, metavar="CSV|DIR", help="Control parameters instead of a video.")
@click.option("--database", "folder", required=True, type=FILE, metavar="DB", help="Of evalkit database build.")
@click.option("--head", "head_name", default="template", show_default=True, metavar="HEAD", help="Who acts.")
@click.option("--names", type=FILE, metavar="JSON", help="Landmarks of the head, if it is a mesh file.")
@click.option("--identity", metavar="NAME", help="Shape of the head that makes it another person.")
@click.option("-o", "--output", required=True, type=FILE, metavar="VIDEO.mp4", help="The character beside the video.")
@click.option("--points", type=FILE, metavar="POINTS.json", help="The 19 points of the first frame.")
@click.option("--eyes", metavar="X,Y,X,Y", help="Middles of both eyes in the first frame: a mean face is put on them.")
@click.option("--start", default=0, show_default=True, metavar="FRAME", help="First frame, from 0: face at rest.")
@click.option("--frames", type=click.IntRange(min=1), metavar="N", help="Frames at most.")
@click.option("--rate", type=float, metavar="HZ", help="Frames per second, if not as the file says.")
@click.option("--camera-fov", type=float, metavar="DEG", help="Of the picture's longer side  [default: assumed, 50]")
@click.option("--search", metavar="NAME", help="How the database is searched; see evalkit methods.")
@click.option("--still", is_flag=True, help="Leave the head motion off.")
@click.option("--alone", is_flag=True, help="The character without the video beside it.")
@click.option("--size", default=480, show_default=True, metavar="PIXELS", help="Height of the video.")
@click.option("--coefficients", type=FILE, metavar="CSV", help="Also write coefficients of the head's own shapes.")
@click.option("--json", "as_json", is_flag=True, help="Print what was done as JSON instead of text.")
def control(
    source: str | None, table: Path | None, folder: Path, head_name: str, names: Path | None, identity: str | None,
    output: Path, points: Path | None, eyes: str | None, start: int, frames: int | None, rate: float | None,
    camera_fov: float | None, search: str | None, still: bool, alone: bool, size: int, coefficients: Path | None,
    as_json: bool,
) -> None:  # fmt: skip
    """Let a character do what the face in VIDEO does.

    The face is followed (as by evalkit track); what a motion database knows of faces takes the noise out of its
    parameters and adds the detail, which moves every vertex of the head. VIDEO may be a folder of pictures or the
    number of a camera, which is recorded first. --from takes parameters.csv of evalkit track, or its folder, in place
    of a video. HEAD is template, makehuman, a folder of evalkit head fit, or a mesh file with a JSON of landmarks.

    \b
    Examples:
        evalkit database build takes/*.c3d -o db
        evalkit control talk.mp4 --database db --head me -o me.mp4
        evalkit control --from talk --database db --head makehuman -o talk.mp4 --coefficients talk.csv
    """
    if (source is None) == (table is None):
        raise click.UsageError("give a video or --from, and not both")
    _check(output, size, start, search, [source, table, folder, points, coefficients], coefficients)
    from evalkit.cli.compensate import working
    from evalkit.control.character import Character
    from evalkit.control.database import open_database
    from evalkit.control.targets import target_head

    database = open_database(folder)
    with working("making the head"):
        character = Character.of(database, target_head(head_name, names, identity))
    video, signal = None, None
    if table is not None:
        from evalkit.control.signals import read_signal

        signal = read_signal(table, rate)
    else:
        video, signal = _watched(str(source), output, points, eyes, start, frames, rate, camera_fov)
    normalised, notes = signal.against_neutral(database.spread)
    with working("searching the database"):
        played = _played(database, normalised, signal.rate_hz, search)
    with _finished(output) as path:
        _draw(character, signal, played, path, size, None if alone else video, start, still)
    content = _summary(database, character, signal, played, notes)
    content["written"] = [str(output)]
    if coefficients is not None:
        content["shapes"] = _write_coefficients(character, played.displacements, signal.rate_hz, coefficients)
        content["written"].append(str(coefficients))
    click.echo(json.dumps(content, indent=2) if as_json else describe(content))


def _check(output: Path, size: int, start: int, search: str | None, inputs: Sequence[Any], more: Path | None) -> None:
    """Refuse what cannot be done before any work is done."""
    from evalkit.control.search import searchers
    from evalkit.render.offscreen import require_offscreen
    from evalkit.render.playback import check_video
    from evalkit.report.transfer import protect_inputs
    from evalkit.results import check_output

    if find_spec("cv2") is None:
        raise EvalkitError("OpenCV is missing: pip install 'evalkit[vision]'")
    check_video(output, size)
    if output.suffix.lower() != ".mp4":
        raise EvalkitError(f"{output}: this video is written as .mp4")
    if search is not None and search not in searchers:
        raise EvalkitError(f"--search {search}: known are {', '.join(searchers)}")
    if start < 0:
        raise EvalkitError(f"--start {start}: frames count from 0")
    for path in (output, more):
        if path is not None:
            if path.is_dir():
                raise EvalkitError(f"{path}: is a folder, not a file")
            if not path.parent.is_dir():
                raise EvalkitError(f"{path.parent}: no such folder; make it first")
            check_output(path.parent)
            protect_inputs(path.parent, [path.name], [Path(given) for given in inputs if given is not None])
    require_offscreen()


def _watched(
    source: str, output: Path, points: Path | None, eyes: str | None, start: int, frames: int | None,
    rate: float | None, view_deg: float | None,
) -> tuple[Video, Signal]:  # fmt: skip
    """The video, and what the face in it does."""
    from evalkit.control.signals import Signal
    from evalkit.vision.track import track
    from evalkit.vision.trackers import DEFAULT, trackers

    video = opened(source, rate, output.with_suffix(""), frames)
    first = frame_of(video, start)
    places, _ = first_points(video, first, start, points, eyes)
    camera = camera_of(video, view_deg)
    with about(video, start), progress("tracking", expected_frames(video, start, frames)) as done:
        found = track(
            part_of(video, start, frames), places, camera, trackers[DEFAULT].build(), rate_hz=video.rate_hz,
            progress=done,
        )  # fmt: skip
    return video, Signal(found.parameters, found.head.rotations, video.rate_hz)


def _played(database: Database, normalised: Array, rate_hz: float, search: str | None) -> ControlMotion:
    from evalkit.control.stream import Control, Settings
    from evalkit.vision.parameters import NAMES

    settings = Settings() if search is None else Settings(searcher=search)
    given = [name for name, column in zip(NAMES, normalised.T, strict=True) if np.isfinite(column).any()]
    return Control(database, rate_hz, settings, given).run(normalised)


@contextmanager
def _finished(path: Path) -> Iterator[Path]:
    """A file under another name until it is whole."""
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _draw(
    character: Character, signal: Signal, played: ControlMotion, path: Path, size: int, video: Video | None,
    start: int, still: bool,
) -> None:  # fmt: skip
    from evalkit.control.signal_windows import SignalStatus
    from evalkit.control.signals import held_rotations
    from evalkit.render.control_video import SideBySide
    from evalkit.render.video_file import written_video

    count = len(played.status)
    lost = played.status == SignalStatus.LOST
    turns = held_rotations(np.full_like(signal.rotations, np.nan) if still else signal.rotations)
    frames: Iterator[Any] = itertools.repeat(None) if video is None else part_of(video, start, count)
    with (
        SideBySide(character.head, size + size % 2, None if video is None else video.size) as pair,
        written_video(path, pair.size, signal.rate_hz) as add,
        progress("drawing", count) as done,
    ):
        for part in blocks(count, BLOCK):
            for k, vertices in zip(range(count)[part], character.vertices(played.displacements[part]), strict=True):
                add(pair.drawn(vertices, turns[k], next(frames), bool(lost[k])))
                done(k + 1)


def _write_coefficients(character: Character, displacements: Array, rate_hz: float, path: Path) -> dict[str, Any]:
    from evalkit.control.shape_coefficients import fit_shapes

    moves = np.nan_to_num(displacements)
    found = fit_shapes(character.head, character.retargeting.bases, character.coefficients(moves))
    found.save(path, rate_hz)
    return {"count": len(found.names), "text": found.text}


def _summary(
    database: Database, character: Character, signal: Signal, played: ControlMotion, notes: list[str]
) -> dict[str, Any]:  # fmt: skip
    from evalkit.control.signal_windows import SignalStatus

    report, folds = character.retargeting.report, character.retargeting.folds
    return {
        "evalkit": __version__,
        "database": {"folder": str(database.folder), "digest": database.digest, "rows": database.rows},
        "head": character.head.name,
        "rate_hz": signal.rate_hz,
        "frames": {status.text: int((played.status == status).sum()) for status in SignalStatus},
        "bases_keep": character.kept,
        "correspondence": report.text,
        "folds": folds.text,
        "warnings": notes,
    }


def describe(content: dict[str, Any]) -> str:
    """What was done, in a few lines of text."""
    counts = content["frames"]
    lines = [
        f"{sum(counts.values()):,} frames at {content['rate_hz']:g} per second: "
        + ", ".join(f"{number:,} {name}" for name, number in counts.items()),
        f"database of {content['database']['rows']:,} frames on {content['head']}; "
        f"its bases keep {100 * content['bases_keep']:.1f} % of the motion",
        *content["correspondence"].splitlines(),
        *content["folds"].splitlines(),
        *([content["shapes"]["text"]] if "shapes" in content else []),
    ]
    lines += [f"warning: {note}" for note in content["warnings"]]
    return "\n".join([*lines, *(f"wrote {path}" for path in content["written"])])
