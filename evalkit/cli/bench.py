"""``evalkit bench``: frames per second of an animated head, with the proof that they were drawn."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click

COLUMNS = (
    ("vertices", "vertices", 0), ("size", "pixels", 0), ("textured", "texture", 0), ("multisamples", "samples", 0),
    ("frames_per_second", "frames/s", 1), ("bare_frames_per_second", "bare loop", 1), ("ratio", "ratio", 2),
    ("deform_ms_p50", "deform", 2), ("upload_ms_p50", "upload", 2), ("render_ms_p50", "render", 2),
    ("read_back_ms_p50", "read", 2), ("distinct", "distinct", 0), ("deform_frames_per_second_batched", "batched/s", 0),
    ("gemm", "of peak", 2),
)  # fmt: skip
"""Column -> heading and digits of the printed table."""

HUGE = 200_000
"""The template is not made finer than this: it would take minutes and gigabytes."""


@click.command()
@click.option("--frames", type=click.IntRange(min=2), help="Frames of each setting. [default: 100; 300 with --full]")
@click.option(
    "--size",
    "sizes",
    type=click.IntRange(16, 8192),
    multiple=True,
    metavar="PIXELS",
    help="Width and height of the picture; repeatable. [default: 512 and 1024]",
)
@click.option(
    "--vertices",
    type=click.IntRange(500, HUGE),
    multiple=True,
    help="Resolution of the head; repeatable. [default: that of the template; 1 k to 100 k with --full]",
)
@click.option("--textured/--no-textured", default=None, help="[default: textured; both with --full]")
@click.option(
    "--multisamples",
    type=click.IntRange(0, 32),
    multiple=True,
    help="Samples per pixel; repeatable. [default: 0 and 8]",
)
@click.option("--full", is_flag=True, help="The whole sweep: minutes instead of one.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder for bench.csv and bench.json with versions and machine.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the rows as JSON.")
def bench(
    frames: int | None, sizes: Sequence[int], vertices: Sequence[int], textured: bool | None,
    multisamples: Sequence[int], full: bool, output: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Measure how fast a head is animated: deform, upload, render, read the pixels back.

    Each line is measured against the limit of the same run: the same scene drawn by a bare loop with nothing
    deformed. A line in which not every frame gave a picture of its own has a status and no rates, and makes the
    exit code 1.

    \b
    Examples:
        evalkit bench
        evalkit bench --size 1024 --multisamples 0 --frames 300 --json
        evalkit bench --full -o results
    """  # fmt: skip
    from evalkit.errors import EvalkitError
    from evalkit.render import benchmark
    from evalkit.render.offscreen import require_offscreen
    from evalkit.results import check_output

    if output is not None:
        check_output(output)
    require_offscreen()
    wanted = benchmark.settings(
        vertices or (benchmark.FULL_VERTICES if full else (None,)),
        sizes or benchmark.SIZES,
        (textured,) if textured is not None else ((True, False) if full else (True,)),
        multisamples or benchmark.MULTISAMPLES,
    )
    count = frames or (benchmark.FULL_FRAMES if full else benchmark.FRAMES)
    rows = list(_with_progress(benchmark.benchmark(wanted, count), len(wanted)))
    if output is not None:
        _write(rows, output)
    click.echo(json.dumps(rows, indent=2) if as_json else table(rows))
    bad = [row for row in rows if row["status"] != "ok"]
    if bad:
        raise EvalkitError(
            f"{len(bad)} of {len(rows)} settings gave the same picture twice ({bad[0]['distinct_frames']} different "
            f"ones of {bad[0]['frames']} frames): something did not draw, and there is no rate to tell"
        )


def table(rows: Sequence[dict[str, Any]]) -> str:
    """The rows as text."""
    cells = [[heading for _, heading, _ in COLUMNS]]
    for row in rows:
        rate, bare = row["frames_per_second"], row["bare_frames_per_second"]
        shown = {
            **row,
            "size": f"{row['width']}x{row['height']}",
            "textured": "yes" if row["textured"] else "no",
            "ratio": None if rate is None else rate / bare,
            "distinct": f"{row['distinct_frames']}/{row['frames']}",
            "gemm": row["gemm_gflops"] / row["peak_gflops"],
        }
        cells.append([_cell(shown[name], digits) for name, _, digits in COLUMNS])
    widths = [max(len(line[k]) for line in cells) for k in range(len(COLUMNS))]
    lines = ["  ".join(f"{cell:>{width}}" for cell, width in zip(line, widths, strict=True)) for line in cells]
    notes = [
        "",
        "deform, upload, render, read: median milliseconds of a frame; distinct: different pictures of all frames.",
        "bare loop: frames/s of rendering and reading alone. batched/s: frames/s of the deformation alone, in batches;",
        "of peak: its share of what a matrix product reaches on this machine.",
        f"renderer: {', '.join(dict.fromkeys(row['renderer'] for row in rows))}",
    ]
    return "\n".join(lines + notes)


def _cell(value: Any, digits: int) -> str:
    if value is None:
        return "-"
    return value if isinstance(value, str) else f"{value:.{digits}f}"


def _write(rows: Sequence[dict[str, Any]], output: Path) -> None:
    from evalkit.results import staged
    from evalkit.study.provenance import environment
    from evalkit.study.table import write_csv

    with staged(output) as stage:
        write_csv(rows, list(rows[0]), stage / "bench.csv")
        facts = {**environment(), "rows": rows}
        (stage / "bench.json").write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    click.echo(f"wrote {output / 'bench.csv'}, {output / 'bench.json'}", err=True)


def _with_progress(work: Iterator[dict[str, Any]], total: int) -> Iterator[dict[str, Any]]:
    """The same with a bar on a terminal; silent elsewhere."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (TextColumn("bench"), BarColumn(), MofNCompleteColumn(), TextColumn("settings,"), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=total)
        for row in work:
            yield row
            bar.advance(task)
