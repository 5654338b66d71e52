"""``evalkit demo``: the main job, end to end, on the bundled capture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from evalkit.errors import EvalkitError

if TYPE_CHECKING:
    from evalkit.capture import Capture

BUNDLED = "talking"

VIDEO_HZ, VIDEO_SIZE = 25.0, 360
"""Small, so that the demo stays short on a machine without a graphics card."""


@click.command()
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=Path("demo"),
    show_default=True,
    metavar="DIR",
    help="Folder for the results.",
)
def demo(output: Path) -> None:
    """Compensate the bundled synthetic take, compare all methods on it, move a head by it; report, pictures, video.

    \b
    Example:
        evalkit demo -o demo
    """
    from evalkit import compensation
    from evalkit.bundled import bundled_take
    from evalkit.capture import read_capture
    from evalkit.cli.compensate import describe, errors_against, read_truth, working
    from evalkit.report import compare_methods, write_pictures, write_report
    from evalkit.results import check_output, staged, write_results

    check_output(output)
    path, truth_path = bundled_take(BUNDLED)
    click.echo(f"reading the bundled take {path.name}: 23 markers of a talking face whose truth is known")
    take = read_capture(path)
    truth = read_truth(truth_path, take)
    result = compensation.compensate(take, truth.rigid)
    with staged(output) as stage:
        content = write_results(result, stage, path, errors_against(result, truth))
        with working("comparing methods and writing the report"):
            rows = compare_methods(take, result, truth=truth)
            write_report(take, result, stage / "report.html", methods=rows, truth=truth, source=path)
            missing = write_pictures(take, result, stage)
        with working("moving a head by the take"):
            missing += _faces(take, truth.rigid, stage)
    click.echo(describe(content, output, True))
    click.echo("")
    click.echo(methods_table(rows))
    for line in missing:
        click.echo(line)
    click.echo(
        f"\npictures: {output / 'markers.png'}, {output / 'pivot.png'}; open {output / 'report.html'} in a browser"
    )
    if (output / "face.png").exists():
        click.echo(f"the take on a head: {output / 'face.mp4'}, {output / 'face.png'}")


def _faces(take: Capture, rigid: Sequence[str], folder: Path) -> list[str]:
    """The take on the built-in head as a video, and on every head at hand as pictures; what could not be drawn."""
    from PIL import Image

    from evalkit import animation
    from evalkit.head import load_head
    from evalkit.head.makehuman import cached_head
    from evalkit.render.face_figures import snapshots_of
    from evalkit.render.playback import write_video

    try:
        made = animation.animate(take, load_head("template"), rigid=rigid, fps=VIDEO_HZ)
        write_video(made, folder / "face.mp4", size=VIDEO_SIZE)
        Image.fromarray(snapshots_of(made)).save(folder / "face.png")
        if cached_head().exists():
            other = animation.animate(take, load_head("makehuman"), rigid=rigid, fps=VIDEO_HZ)
            Image.fromarray(snapshots_of(other)).save(folder / "face-makehuman.png")
    except EvalkitError as error:
        return [f"the head was not drawn: {error}"]
    return []


def methods_table(rows: list[dict[str, Any]]) -> str:
    """The comparison of methods as text."""
    header = (
        f"{'method':<32}{'status':<20}{'pivot error':>12}{'rotation':>10}{'expression':>12}{'time':>9}\n"
        f"{'':<32}{'':<20}{'mm':>12}{'deg rms':>10}{'mm rms':>12}{'ms':>9}"
    )
    lines = [header]
    for row in rows:
        name = f"{row['kind']} {row['method']}{' *' if row['chosen'] else ''}"
        name = "no compensation" if row["kind"] == "none" else name
        cells = [
            _cell(row[key], width, digits)
            for key, width, digits in (
                ("pivot_error_mm", 12, 2), ("rotation_error_deg", 10, 3), ("expression_error_mm", 12, 3),
            )
        ]  # fmt: skip
        lines.append(f"{name:<32}{row['status']:<20}{''.join(cells)}{_cell(1000 * row['seconds'], 9, 1)}")
    return "\n".join([*lines, "* chosen for the result; each line changes only the method it names"])


def _cell(value: float, width: int, digits: int) -> str:
    return f"{value:>{width}.{digits}f}" if math.isfinite(value) else f"{'-':>{width}}"
