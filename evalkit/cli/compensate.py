"""``evalkit compensate``: a take in, the same take without the head's motion out."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import click

from evalkit.errors import EvalkitError


@click.command()
@click.argument("capture", type=click.Path(path_type=Path), metavar="CAPTURE")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Folder for the results."
)
@click.option(
    "--rigid",
    default="auto",
    show_default=True,
    metavar="A,B,C|auto",
    help="Markers that move with the skull, or auto.",
)
@click.option("--pose", default="svd", show_default=True, metavar="NAME", help="Pose estimator; see: evalkit methods.")
@click.option(
    "--pivot", default="joint", show_default=True, metavar="NAME", help="Pivot estimator; see: evalkit methods."
)
@click.option(
    "--sway",
    default="auto",
    show_default=True,
    metavar="auto|none|per-frame|SECONDS",
    help="Motion of the pivot itself: chosen from the data, held still, anything, or smooth with knots SECONDS apart.",
)
@click.option(
    "--reference",
    default="mean",
    show_default=True,
    metavar="mean|median|FRAME",
    help="Pose to bring everything back to; frames count from 0.",
)
@click.option(
    "--smooth",
    is_flag=True,
    help="Smooth the rotations over time, by as much as the take asks for; blurs single jerks.",
)
@click.option(
    "--paper",
    is_flag=True,
    help="The method of Huang et al. 2000 as published, against frame 0 unless --reference says otherwise; three "
    "rigid markers.",
)
@click.option(
    "--truth",
    type=click.Path(path_type=Path),
    metavar="TRUTH.npz",
    help="Truth of a synthetic take: adds the errors.",
)
@click.option("--report/--no-report", default=True, show_default=True, help="Write report.html.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON instead of text.")
def compensate(
    capture: Path, output: Path, rigid: str, pose: str, pivot: str, sway: str, reference: str, smooth: bool,
    paper: bool, truth: Path | None, report: bool, as_json: bool,
) -> None:  # fmt: skip
    """Take the head's motion out of CAPTURE, a .c3d, .trc or .csv file.

    Writes into DIR: compensated.c3d (the expression alone, everything else of the file kept), motion.csv (head
    motion per frame), summary.json (pivot with its uncertainty, status, warnings) and report.html (pictures of
    all of it).

    \b
    Example:
        evalkit compensate take.c3d -o out --rigid ForeHead_M,ForeHead_L,ForeHead_R,NoseTop
    """
    given = click.get_current_context().get_parameter_source
    for name in ("pose", "pivot", "sway", "smooth"):
        if paper and given(name) is not click.core.ParameterSource.DEFAULT:
            raise click.UsageError(f"--paper is the method as published; leave --{name} out")
    if paper and given("reference") is click.core.ParameterSource.DEFAULT:
        reference = "0"
    from evalkit import compensation, published
    from evalkit.capture import read_capture
    from evalkit.results import check_output, staged, write_results

    check_output(output)
    target = output / "compensated.c3d"
    if target.exists() and capture.exists() and target.samefile(capture):
        raise EvalkitError(f"{capture}: the result would overwrite its own input; choose another output folder")
    take = read_capture(capture)
    known = read_truth(truth, take) if truth else None
    labels: str | list[str] = rigid if rigid == "auto" else [part.strip() for part in rigid.split(",") if part.strip()]
    try:
        if paper:
            result = published.compensate_as_published(take, labels, reference=parse_reference(reference))
        else:
            result = compensation.compensate(
                take, labels, pose=pose, pivot=pivot, sway=parse_sway(sway), reference=parse_reference(reference),
                smooth=smooth,
            )  # fmt: skip
    except EvalkitError as error:
        raise EvalkitError(f"{capture}: {error}") from error
    errors = errors_against(result, known) if known is not None else None
    leak = None
    if report:
        from evalkit.leak import expression_leak

        with working("looking for expression in the head motion"):
            leak = expression_leak(take, result)
    with staged(output) as stage:
        content = write_results(result, stage, capture, errors, leak)
        if report:
            from evalkit.report import write_report

            with working("comparing methods and writing the report"):
                write_report(take, result, stage / "report.html", truth=known, source=capture, leak=leak)
    if as_json:
        click.echo(json.dumps(content, indent=2))
    else:
        click.echo(describe(content, output, report))


def parse_sway(text: str) -> str | float:
    """``auto``, ``none``, ``per-frame`` or a number of seconds."""
    if text in ("auto", "none", "per-frame"):
        return text
    try:
        return float(text)
    except ValueError:
        raise EvalkitError(f"--sway {text}: use auto, none, per-frame or a knot spacing in seconds") from None


def parse_reference(text: str) -> str | int:
    """``mean``, ``median`` or a frame number."""
    if text in ("mean", "median"):
        return text
    try:
        return int(text)
    except ValueError:
        raise EvalkitError(f"--reference {text}: use mean, median or a frame number") from None


def read_truth(path: Path, take: Any) -> Any:
    """Truth of a synthetic take, checked against the take."""
    from evalkit.synthetic import Truth

    truth = Truth.load(path)
    if truth.expression.shape != take.points.shape:
        frames, markers = truth.expression.shape[:2]
        raise EvalkitError(
            f"{path}: truth of {frames} frames x {markers} markers; the capture has "
            f"{take.frames} x {len(take.labels)}: give the truth of this take"
        )
    return truth


def errors_against(result: Any, truth: Any) -> dict[str, float]:
    """Root-mean-square errors of a result against the truth of its take."""
    from evalkit import metrics

    expression = metrics.expression_error_mm(result.capture.points, truth.clean)
    others = [k for k, label in enumerate(result.capture.labels) if label not in truth.rigid]
    return {
        "rotation_rms_deg": metrics.rms(metrics.rotation_error_deg(result.rotations, truth.rotations)),
        "pivot_mm": metrics.pivot_error_mm(result.pivot, result.sway, truth.pivot, truth.sway),
        "expression_rms_mm": metrics.rms(expression[:, others]),
    }


def describe(content: dict[str, Any], output: Path, report: bool) -> str:
    """The summary in a few lines of text."""
    pivot, frames = content["pivot"], content["frames"]
    position = ", ".join(f"{x:.1f}" for x in pivot["position_mm"])
    total, labels = sum(frames.values()), content["rigid"]["labels"]
    lines = [
        f"head pose in {frames['ok']} of {total} frames from "
        + (", ".join(labels) if len(labels) <= 8 else f"{len(labels)} markers"),
        f"pivot ({position}) mm: {pivot['status']}",
    ]
    if content["rigid"]["automatic"]:
        lines.insert(1, content["rigid"]["reason"])
    if content["errors_against_truth"]:
        e = content["errors_against_truth"]
        lines.append(
            f"against truth: rotation {e['rotation_rms_deg']:.3f} deg rms, pivot {e['pivot_mm']:.2f} mm, "
            f"expression {e['expression_rms_mm']:.3f} mm rms"
        )
    if content["expression_leak"]:
        lines.append(f"expression leak: {content['expression_leak']['message']}")
    lines += [f"warning: {warning}" for warning in content["warnings"]]
    lines.append(f"wrote {output / ('report.html' if report else 'compensated.c3d')}")
    return "\n".join(lines)


class working:
    """A spinner with a text while something takes seconds; silent where nobody watches."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.status: Any = None

    def __enter__(self) -> None:
        if sys.stderr.isatty():
            from rich.console import Console

            self.status = Console(stderr=True).status(self.text)
            self.status.__enter__()

    def __exit__(self, *details: Any) -> None:
        if self.status is not None:
            self.status.__exit__(*details)
