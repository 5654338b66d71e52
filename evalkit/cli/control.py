"""``evalkit control``: a video of a face in, a character that does the same out."""

from __future__ import annotations

import itertools
import json
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from numpy.typing import NDArray

from evalkit import __version__
from evalkit.cli.video_source import (
    about,
    camera_of,
    expected_frames,
    first_points,
    frame_of,
    is_camera,
    opened,
    part_of,
    progress,
    watched,
)
from evalkit.errors import EvalkitError

if TYPE_CHECKING:
    from evalkit.control.character import Character
    from evalkit.control.database import Database
    from evalkit.control.live import LiveFrame
    from evalkit.control.signal_windows import SignalStatus
    from evalkit.control.signals import Signal
    from evalkit.control.stream import Settings
    from evalkit.geometry import Array
    from evalkit.vision.tracker import Picture
    from evalkit.vision.video import Video

FILE = click.Path(path_type=Path)

SHEET = 6
"""Frames of ``--sheet``."""


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
@click.option(
    "--neutral", metavar="FRAMES", help="Frames of the face at rest, from 0: 3 or 0,1,2  [default: the first]"
)
@click.option("--search", metavar="NAME", help="How the database is searched; see evalkit methods.")
@click.option("--still", is_flag=True, help="Leave the head motion off.")
@click.option("--alone", is_flag=True, help="The character without the video beside it.")
@click.option("--size", default=480, show_default=True, metavar="PIXELS", help="Height of the video.")
@click.option("--sheet", type=FILE, metavar="PNG", help="Also draw six frames, evenly spaced, into one picture.")
@click.option("--coefficients", type=FILE, metavar="CSV", help="Also write coefficients of the head's own shapes.")
@click.option("--json", "as_json", is_flag=True, help="Print what was done as JSON instead of text.")
def control(
    source: str | None, table: Path | None, folder: Path, head_name: str, names: Path | None, identity: str | None,
    output: Path, points: Path | None, eyes: str | None, start: int, frames: int | None, rate: float | None,
    camera_fov: float | None, neutral: str | None, search: str | None, still: bool, alone: bool, size: int,
    sheet: Path | None, coefficients: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Let a character do what the face in VIDEO does.

    The face is followed (as by evalkit track); what a motion database knows of faces takes the noise out of its
    parameters and adds the detail, which moves every vertex of the head. VIDEO may be a folder of pictures or the
    number of a camera, whose face is followed live until q and Enter or --frames. --from takes parameters.csv of
    evalkit track, or its folder, in place of a video. HEAD is template, makehuman, a folder of evalkit head fit, or a
    mesh file with a JSON of landmarks.

    \b
    Examples:
        evalkit database build takes/*.c3d -o db
        evalkit control talk.mp4 --database db --head me -o me.mp4
        evalkit control --from talk --database db --head makehuman -o talk.mp4 --coefficients talk.csv
    """
    if (source is None) == (table is None):
        raise click.UsageError("give a video or --from, and not both")
    _check(output, size, start, search, [source, table, folder, points], sheet, coefficients)
    from evalkit.cli.compensate import working
    from evalkit.control.character import Character
    from evalkit.control.database import open_database
    from evalkit.control.signals import read_signal
    from evalkit.control.stream import VIDEO
    from evalkit.control.targets import target_head

    database = open_database(folder)
    settings = VIDEO if search is None else replace(VIDEO, searcher=search)
    signal = None if table is None else read_signal(table, rate)
    with working("making the head"):
        head = target_head(head_name, names, identity)
    if coefficients is not None:
        from evalkit.control.shape_coefficients import shape_names

        shape_names(head)
    video: Video | None = None
    notes: list[str] = []
    shots: Iterator[Shot]
    if is_camera(source):
        video, shots = _live(str(source), database, settings, points, eyes, frames, rate, camera_fov)
        rate_hz, count = video.rate_hz, frames
    else:
        if signal is None:
            video, signal = _watched(str(source), points, eyes, start, frames, rate, camera_fov)
        rate_hz, count = signal.rate_hz, len(signal.parameters)
        with working("searching the database"):
            shots, notes = _played(database, signal, settings, neutral)
        if video is not None:
            pictures = part_of(video, start, count)
            shots = (replace(shot, frame=picture) for shot, picture in zip(shots, pictures, strict=False))
    with working("putting the database's motion on the head"):
        character = Character.of(database, head)
    written = [str(output)]
    with _finished(output) as path:
        beside = None if alone or video is None else video.size
        drawn = _draw(character, shots, path, size, beside, rate_hz, count, still)
        content = _summary(database, character, rate_hz, drawn.status, notes)
        if coefficients is not None:
            content["shapes"] = _write_coefficients(character, drawn.displacements, rate_hz, coefficients)
            written.append(str(coefficients))
    if sheet is not None:
        _write_sheet(drawn.pictures, sheet)
        written.append(str(sheet))
    content["written"] = written
    click.echo(json.dumps(content, indent=2) if as_json else describe(content))


@dataclass(frozen=True, eq=False)
class Shot:
    """One frame that is to be drawn: where the markers are, how the head is turned, and the video's picture."""

    displacements: Array
    rotation: Array
    status: SignalStatus
    frame: Picture | None = None


@dataclass(frozen=True, eq=False)
class Drawn:
    """Displacements (F, M, 3), mm, and status (F,) of what was drawn, and a few of the pictures."""

    displacements: Array
    status: NDArray[np.int8]
    pictures: list[Picture]


def _check(
    output: Path, size: int, start: int, search: str | None, inputs: Sequence[Any], sheet: Path | None,
    coefficients: Path | None,
) -> None:  # fmt: skip
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
    if sheet is not None and sheet.suffix.lower() != ".png":
        raise EvalkitError(f"--sheet {sheet}: give the name of a .png file")
    for path in (output, sheet, coefficients):
        if path is not None:
            if path.is_dir():
                raise EvalkitError(f"{path}: is a folder, not a file")
            if not path.parent.is_dir():
                raise EvalkitError(f"{path.parent}: no such folder; make it first")
            check_output(path.parent)
            protect_inputs(path.parent, [path.name], [Path(given) for given in inputs if given is not None])
    require_offscreen()


def _watched(
    source: str, points: Path | None, eyes: str | None, start: int, frames: int | None, rate: float | None,
    view_deg: float | None,
) -> tuple[Video, Signal]:  # fmt: skip
    """The video, and what the face in it does."""
    from evalkit.control.signals import Signal
    from evalkit.vision.track import track
    from evalkit.vision.trackers import DEFAULT, trackers

    video = opened(source, rate, None, None)
    places, _ = first_points(video, frame_of(video, start), start, points, eyes)
    camera = camera_of(video, view_deg)
    with about(video, start), progress("tracking", expected_frames(video, start, frames)) as done:
        found = track(
            part_of(video, start, frames), places, camera, trackers[DEFAULT].build(), rate_hz=video.rate_hz,
            progress=done,
        )  # fmt: skip
    return video, Signal(found.parameters, found.head.rotations, video.rate_hz)


def _live(
    source: str, database: Database, settings: Settings, points: Path | None, eyes: str | None, frames: int | None,
    rate: float | None, view_deg: float | None,
) -> tuple[Video, Iterator[Shot]]:  # fmt: skip
    """A camera, and what its face does as long as it is watched."""
    from evalkit.control.live import LiveControl

    camera = opened(source, rate, None, None)
    seen = watched(camera, frames)

    def shots() -> Iterator[Shot]:
        first = next(seen, None)
        if first is None:
            raise EvalkitError(f"camera {source}: shows nothing")
        with about(camera, 0):
            places, _ = first_points(camera, first, 0, points, eyes)
            chain = LiveControl(database, camera_of(camera, view_deg), camera.rate_hz, first, places, settings)
        waiting = deque([first])
        found: Iterable[LiveFrame | None] = itertools.chain([chain.first], map(chain.step, _kept(seen, waiting)))
        for out in found:
            if out is not None:
                yield Shot(out.displacements, out.pose.rotation, out.status, waiting.popleft())
        for out in chain.finish():
            yield Shot(out.displacements, out.pose.rotation, out.status, waiting.popleft())

    return camera, shots()


def _kept(frames: Iterator[Picture], waiting: deque[Picture]) -> Iterator[Picture]:
    for frame in frames:
        waiting.append(frame)
        yield frame


def _frames(neutral: str | None, count: int) -> list[int] | None:
    """Frames of ``--neutral``."""
    if neutral is None:
        return None
    parts = [part.strip() for part in neutral.split(",")]
    odd = next((part for part in parts if not part.isdecimal() or int(part) >= count), None)
    if odd is not None:
        raise EvalkitError(f"--neutral {neutral}: '{odd}' is no frame; they go from 0 to {count - 1}")
    return [int(part) for part in parts]


def _played(
    database: Database, signal: Signal, settings: Settings, neutral: str | None
) -> tuple[Iterator[Shot], list[str]]:
    """A whole signal's frames, and what was left out of it."""
    from evalkit.control.signal_windows import SignalStatus
    from evalkit.control.stream import Control
    from evalkit.vision.parameters import NAMES

    normalised, notes = signal.against_neutral(database.spread, _frames(neutral, len(signal.parameters)))
    given = [name for name, column in zip(NAMES, normalised.T, strict=True) if np.isfinite(column).any()]
    control = Control(database, signal.rate_hz, settings, given)
    if control.unused:
        notes.append(f"the database does not know {', '.join(control.unused)}; the face follows the others")
    found = control.run(normalised)
    rows = zip(found.displacements, signal.rotations, found.status, strict=True)
    return (Shot(moves, rotation, SignalStatus(int(status))) for moves, rotation, status in rows), notes


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
    character: Character, shots: Iterator[Shot], path: Path, size: int, video_size: tuple[int, int] | None,
    rate_hz: float, count: int | None, still: bool,
) -> Drawn:  # fmt: skip
    """Draw every frame into a video; one in which the head's pose is not known has that of the frame before."""
    from evalkit.control.signal_windows import SignalStatus
    from evalkit.render.control_video import SideBySide
    from evalkit.render.video_file import written_video

    made: list[Shot] = []
    kept: list[Picture] = []
    every = 1
    turn = np.eye(3)
    with (
        SideBySide(character.head, size + size % 2, video_size) as pair,
        written_video(path, pair.size, rate_hz) as add,
        progress("drawing", count) as done,
    ):
        for shot in shots:
            if np.isfinite(shot.rotation).all() and not still:
                turn = shot.rotation
            vertices = character.vertices(shot.displacements[None])[0]
            picture = pair.drawn(vertices, turn, shot.frame, shot.status == SignalStatus.LOST)
            add(picture)
            # Nobody knows how many come: as soon as there are twice as many as wanted, every other one goes.
            if len(made) % every == 0:
                kept.append(picture)
            if len(kept) == 4 * SHEET:
                kept, every = kept[::2], 2 * every
            made.append(replace(shot, frame=None))
            done(len(made))
    if not made:
        raise EvalkitError("there are no frames to draw")
    status = np.array([shot.status for shot in made], dtype=np.int8)
    return Drawn(np.stack([shot.displacements for shot in made]), status, kept)


def _write_sheet(pictures: list[Picture], path: Path) -> None:
    """Pictures evenly spaced, in two rows."""
    import cv2

    chosen = [pictures[k] for k in np.linspace(0, len(pictures) - 1, SHEET).round().astype(int)]
    half = SHEET // 2
    sheet = np.concatenate([np.concatenate(chosen[k : k + half], axis=1) for k in (0, half)], axis=0)
    with _finished(path) as temporary:
        temporary.write_bytes(cv2.imencode(".png", sheet)[1].tobytes())


def _write_coefficients(character: Character, displacements: Array, rate_hz: float, path: Path) -> dict[str, Any]:
    from evalkit.control.shape_coefficients import fit_shapes

    moves = np.nan_to_num(displacements)
    found = fit_shapes(character.head, character.retargeting.bases, character.coefficients(moves))
    found.save(path, rate_hz)
    return {"count": len(found.names), "text": found.text}


def _summary(
    database: Database, character: Character, rate_hz: float, found: NDArray[np.int8], notes: list[str]
) -> dict[str, Any]:
    from evalkit.control.signal_windows import SignalStatus

    report, folds = character.retargeting.report, character.retargeting.folds
    return {
        "evalkit": __version__,
        "database": {"folder": str(database.folder), "digest": database.digest, "rows": database.rows},
        "head": character.head.name,
        "rate_hz": rate_hz,
        "frames": {status.text: int((found == status).sum()) for status in SignalStatus},
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
