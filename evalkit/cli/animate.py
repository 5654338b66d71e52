"""``evalkit animate``: a take in, a moving head out."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import click

from evalkit.errors import EvalkitError

MESH = ".glb"


@click.command()
@click.argument("capture", type=click.Path(path_type=Path), metavar="CAPTURE")
@click.option(
    "--head", "head_name", default="template", show_default=True, metavar="HEAD|template", help="Head to move."
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Video (.mp4, .gif), or the moving mesh for other programs (.glb).",
)
@click.option("--snapshots", type=click.Path(path_type=Path), metavar="DIR", help="Pictures of head and markers.")
@click.option("--compensated", is_flag=True, help="CAPTURE has no head motion left.")
@click.option(
    "--rigid", default="auto", show_default=True, metavar="A,B,C|auto", help="Markers that move with the skull."
)
@click.option(
    "--map",
    "mapping",
    metavar="FILE|A=Site,...|NAME",
    help="Which label is which marker site of the head: a JSON file, pairs, the name of a known set (animface), or "
    "'position' to go by where the markers are.",
)
@click.option(
    "--unmapped",
    type=click.Choice(["place", "ignore"]),
    default="place",
    show_default=True,
    help="Markers without a site: put on the head where they come to lie, or left out.",
)
@click.option("--neutral", default="auto", show_default=True, metavar="auto|FRAME", help="The face at rest, from 0.")
@click.option(
    "--gaps",
    type=click.Choice(["hold", "interpolate"]),
    default="hold",
    show_default=True,
    help="A marker missing for more than 0.1 s: held, or bridged in a straight line; marked in the picture.",
)
@click.option("--still", "motion", flag_value="still", help="Leave the head motion off (default: it is put back on).")
@click.option("--idle", "motion", flag_value="idle", help="Small nods and shakes instead of the take's head motion.")
@click.option("--fps", default="take", show_default=True, metavar="take|NUMBER", help="Frames shown per second.")
@click.option("--kernel", default="exponential", show_default=True, metavar="NAME", help="See: evalkit methods.")
@click.option("--size", default=720, show_default=True, metavar="PIXELS", help="Height of the video.")
@click.option("--side-by-side", is_flag=True, help="Raw markers, compensated markers and head.")
@click.option("--markers", is_flag=True, help="Draw the markers on the head.")
@click.option("--wireframe", is_flag=True, help="Lines instead of skin.")
@click.option("--seed", default=0, show_default=True, help="Of blinks and idle motion.")
@click.option("--json", "as_json", is_flag=True, help="Print what was done as JSON instead of text.")
def animate(
    capture: Path, head_name: str, output: Path | None, snapshots: Path | None, compensated: bool, rigid: str,
    mapping: str | None, unmapped: str, neutral: str, gaps: str, motion: str | None, fps: str, kernel: str, size: int,
    side_by_side: bool, markers: bool, wireframe: bool, seed: int, as_json: bool,
) -> None:  # fmt: skip
    """Move a head by the markers of CAPTURE, a .c3d, .trc or .csv file.

    The head's motion is taken out of the take, what is left drives the face, and the motion is put back on.
    Labels that are neither marker sites of the head nor of a known set are named with --map. --snapshots
    writes the pictures of Huang et al. 2000: markers.png (Fig. 1), head.png (Fig. 3), landmarks.png (Fig. 4 b),
    snapshots.png (Fig. 5) and sheet.png, the course of the take.

    \b
    Examples:
        evalkit animate take.c3d -o face.mp4
        evalkit animate take.c3d -o face.mp4 --side-by-side --fps 30
        evalkit animate take.c3d -o face.glb
        evalkit animate take.c3d --snapshots pictures
        evalkit animate take.c3d -o face.mp4 --map "Mouth_Up=UpperLipC,Mouth_Low=LowerLipC,..."
    """
    if output is None and snapshots is None:
        raise click.UsageError("say what to write: -o face.mp4, -o face.glb or --snapshots DIR")
    _check_outputs(output, snapshots, size, capture)
    from evalkit import animation
    from evalkit.animation.checks import check
    from evalkit.animation.labels import BY_POSITION, read_label_map
    from evalkit.capture import read_capture
    from evalkit.cli.compensate import working
    from evalkit.head import load_head

    take = read_capture(capture)
    with working("making the head"):
        head = load_head(head_name)
    try:
        with working("taking the head motion out and the markers to the head"):
            made = animation.animate(
                take, head, compensated=compensated,
                rigid=rigid if rigid == "auto" else [part.strip() for part in rigid.split(",") if part.strip()],
                label_map=mapping if mapping in (None, BY_POSITION) else read_label_map(mapping),
                unmapped=unmapped, neutral=_number(neutral, "auto", "--neutral"), gaps=gaps,
                head_motion=motion or "take", fps=_rate(fps), kernel=kernel, seed=seed,
            )  # fmt: skip
    except EvalkitError as error:
        raise EvalkitError(f"{capture}: {error}") from error
    with working("checking the motion"):
        made.report["checks"] = check(made)
    written = []
    if output is not None:
        made.report["output"] = _write(made, output, size, side_by_side, markers, wireframe)
        written.append(str(output))
    if snapshots is not None:
        from evalkit.render.face_figures import write_snapshots
        from evalkit.results import staged

        with staged(snapshots) as stage, working("drawing pictures"):
            names = write_snapshots(made, stage)
        written += [str(snapshots / name) for name in names]
    if as_json:
        click.echo(json.dumps({**made.report, "written": written}, indent=2))
    else:
        click.echo(describe(made.report, written))


def _check_outputs(output: Path | None, snapshots: Path | None, size: int, capture: Path) -> None:
    from evalkit.render.playback import check_video
    from evalkit.results import check_output

    if output is not None:
        if output.suffix.lower() != MESH:
            check_video(output, size)
        check_output(output.parent)
        if not output.parent.is_dir():
            raise EvalkitError(f"{output.parent}: no such folder; make it first")
        if output.is_dir():
            raise EvalkitError(f"{output}: is a folder, not a file")
    if snapshots is not None:
        check_output(snapshots)
    if not capture.exists():
        raise EvalkitError(f"{capture}: no such file")


def _write(made: Any, output: Path, size: int, side_by_side: bool, markers: bool, wireframe: bool) -> dict[str, Any]:
    from evalkit.cli.compensate import working

    if output.suffix.lower() == MESH:
        from evalkit.animation.gltf import write_glb

        with working("writing the moving mesh"):
            return write_glb(made, output)
    from evalkit.render.playback import write_video

    look: dict[str, Any] = {"size": size, "side_by_side": side_by_side, "markers": markers, "wireframe": wireframe}
    if sys.stderr.isatty():
        with click.progressbar(length=made.frames, label="drawing", file=sys.stderr, show_eta=True) as bar:
            write_video(made, output, **look, advance=bar.update)
    else:
        write_video(made, output, **look)
    return {"frames": made.frames, "rate_hz": made.rate_hz, "size": size}


def _number(text: str, word: str, option: str) -> str | int:
    if text == word:
        return text
    try:
        return int(text)
    except ValueError:
        raise EvalkitError(f"{option} {text}: use {word} or a frame number from 0") from None


def _rate(text: str) -> float | None:
    if text == "take":
        return None
    try:
        return float(text)
    except ValueError:
        raise EvalkitError(f"--fps {text}: use take or a number of frames per second") from None


def describe(report: dict[str, Any], written: list[str]) -> str:
    """What was done, in a few lines of text."""
    placed, left = report["placed"], report["left_out"]
    lines = [
        f"{len(report['markers'])} markers matched {report['matched']}"
        + (f", {len(placed)} more placed by position" if placed else "")
        + (f", {len(left)} left out ({', '.join(f'{k}: {v}' for k, v in list(left.items())[:3])})" if left else ""),
        f"rest: frame {report['neutral_frame']} ({report['neutral']})",
    ]
    if report["scaling"]:
        lines.append("performer to head:")
        lines += [
            f"  {key:<8} {r['distance']:<28} {r['performer_mm']:>7.1f} -> {r['head_mm']:>6.1f} mm   x {r['ratio']:.2f}"
            for key, r in report["scaling"].items()
        ]
    gaps = report["gaps"]
    if gaps["short_values"] or gaps["long_values"]:
        done = "held" if gaps["mode"] == "hold" else "bridged"
        lines.append(
            f"missing markers: {gaps['short_values']} values in short gaps bridged, {gaps['long_values']} in long gaps "
            f"{done}; {gaps['marked_frames']} frames marked"
        )
    lids = report["lids"]
    lines.append(
        f"lids: driven by {', '.join(lids['markers'])}"
        if lids["source"] == "markers"
        else f"lids: {lids['blinks']} blinks generated (seed {lids['seed']})"
    )
    shown = "" if report["resampling"] == "none" else f", {report['resampling']} of {report['take_rate_hz']:g} Hz"
    lines.append(f"{report['frames']} frames at {report['rate_hz']:g} per second{shown}")
    checks = report["checks"]
    follows = checks["mouth_correlation"]
    lines.append(
        ("" if follows is None else f"mouth follows the chin with correlation {follows:.3f}; ")
        + f"largest step {checks['largest_step_mm']:.1f} mm; {checks['crossing_frames']} frames with lips through each "
        f"other, {checks['flipped_frames']} with turned triangles"
    )
    out = report.get("output", {})
    if "targets" in out:
        lines.append(
            f"{out['targets']} morph targets; vertices within {out['largest_error_mm']:.2f} mm of the animation "
            f"({out['rms_error_mm']:.3f} mm rms)"
        )
    lines += [f"warning: {note}" for note in [*report["notes"], *checks["warnings"]]]
    lines += [f"wrote {path}" for path in written]
    return "\n".join(lines)
