"""One self-contained page about one take."""

from __future__ import annotations

import base64
import datetime
import os
import platform
import tempfile
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
import matplotlib
import numpy as np
from markupsafe import Markup

from evalkit import __version__
from evalkit.capture import Capture
from evalkit.compensation import Compensation
from evalkit.errors import EvalkitError
from evalkit.geometry import rotation_angle
from evalkit.leak import Leak, expression_leak
from evalkit.metrics import expression_error_mm, pivot_error_mm, rms, rotation_error_deg
from evalkit.render import pivot_scene_png
from evalkit.render.markers import HEAD_MM
from evalkit.render.pivot_scene import ellipsoid_caption
from evalkit.report import plots, words
from evalkit.report.compare import TRUTH_COLUMNS, UNCOMPENSATED, compare_methods
from evalkit.report.measures import View, movement_rms
from evalkit.report.scene import scene, script_json
from evalkit.results import file_sha256

if TYPE_CHECKING:
    from evalkit.synthetic import Truth

COMPARED_FRAMES = 300
"""Frames that the methods are compared on when the caller brings no comparison."""

MOST_PAIRS = 21


def write_report(
    take: Capture,
    result: Compensation,
    path: str | Path,
    *,
    methods: Sequence[dict[str, Any]] | None = None,
    truth: Truth | None = None,
    title: str | None = None,
    source: str | Path | None = None,
    leak: Leak | None = None,
) -> None:
    """Write the report of one take as a single HTML file that needs no network.

    Parameters
    ----------
    take : Capture
        As it was observed.
    result : Compensation
        Of this take.
    path : str or Path
        File to write; replaced if it exists.
    methods : sequence of dict, optional
        Rows of :func:`~evalkit.report.compare.compare_methods`. By default the methods are compared here, on at
        most :data:`COMPARED_FRAMES` frames; an empty sequence leaves the table out.
    truth : Truth, optional
        Of a synthetic take; adds the errors.
    title : str, optional
        By default the name of the source file.
    source : str or Path, optional
        The capture file, for its name and SHA-256.
    leak : Leak, optional
        Computed here if not given.

    Raises
    ------
    EvalkitError
        If the take and the result do not fit together, or a file cannot be read or written.
    """
    if take.points.shape != result.capture.points.shape:
        raise EvalkitError(f"the take has shape {take.points.shape}, the result {result.capture.points.shape}")
    if truth is not None and truth.visible.shape != take.points.shape[:2]:
        raise EvalkitError(f"the truth is of {truth.visible.shape} frames and markers, not {take.points.shape[:2]}")
    path = Path(path)
    if not path.parent.is_dir():
        raise EvalkitError(f"{path}: cannot write the report (no such folder)")
    provenance = _provenance(take, source)
    if methods is None:
        methods = compare_methods(take, result, truth=truth, max_frames=COMPARED_FRAMES)
    view = View.of(take, result)
    leak = expression_leak(take, result) if leak is None else leak
    name = title or (Path(source).name if source is not None else "Head motion of a take")
    page = page_template().render(
        title=name,
        headline=words.headline(result, view.left_out > 0),
        cards=_cards(view, leak),
        leak=leak,
        status=result.status,
        meaning=words.PIVOT_MEANING.get(result.status, ""),
        message=result.estimate.message,
        lost=not view.ok.all(),
        warnings=result.warnings,
        parameters=_parameters(view),
        trajectories=plots.trajectories(view),
        trajectory_frames=min(take.frames, plots.TRAJECTORY_FRAMES),
        frames=take.frames,
        shown=len(view.columns),
        left_out=view.left_out,
        head_mm=HEAD_MM,
        walking=view.walking,
        screen_axes=take.axes,
        motion=plots.motion(view),
        envelope=take.frames > 2 * plots.BINS,
        plotly=_plotly(),
        scene=Markup(script_json(scene(view))),
        picture=_picture(view),
        ellipsoid=ellipsoid_caption(result),
        pivot=_pivot_rows(result),
        movement=_movement(view),
        weighted=result.chosen.weighted,
        rigid=_rigid_rows(view),
        rigid_reason=result.chosen.reason,
        pairs=_pair_rows(result),
        most_pairs=MOST_PAIRS,
        methods=methods,
        raw=UNCOMPENSATED,
        truth_columns=truth is not None or any(np.isfinite(row[key]) for row in methods for key in TRUTH_COLUMNS),
        errors=None if truth is None else _errors(view, truth),
        trace=plots.search(result.estimate.trace) if len(result.estimate.trace) > 1 else None,
        evaluations=result.estimate.evaluations,
        outer=result.outer,
        provenance=provenance,
    )
    write_page(path, page)


def write_pictures(take: Capture, result: Compensation, folder: str | Path) -> list[str]:
    """The report's main pictures as files of their own: markers.png (paths before and after) and pivot.png.

    Parameters
    ----------
    take : Capture
    result : Compensation
        Of this take.
    folder : path
        Where to write.

    Returns
    -------
    list of str
        What could not be drawn, and what to do about it.
    """
    view = View.of(take, result)
    with matplotlib.rc_context(plots.STYLE):
        plots.trajectory_figure(view).savefig(Path(folder) / "markers.png", dpi=plots.PNG_DPI)
    try:
        pivot_scene_png(result, Path(folder) / "pivot.png", take=take)
    except EvalkitError as error:
        return [f"pivot.png was not drawn: {error}"]
    return []


def page_template(name: str = "report.html.j2") -> jinja2.Template:
    """A page of this folder, with the filters that pages use."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        loader=jinja2.FunctionLoader(
            lambda file: resources.files("evalkit.report").joinpath(file).read_text(encoding="utf-8")
        ),
    )  # fmt: skip
    environment.filters.update(number=words.number, coordinate=words.coordinate)
    return environment.get_template(name)


def _plotly() -> Markup:
    """plotly.js itself; its own text is trusted, and must not end the script element."""
    from plotly.offline import get_plotlyjs

    return Markup(get_plotlyjs().replace("</script", "<\\/script"))


def write_page(path: Path, page: str) -> None:
    """Whole or not at all."""
    stage = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        stage.write_text(page, encoding="utf-8")
        stage.replace(path)
    except OSError as error:
        stage.unlink(missing_ok=True)
        raise EvalkitError(f"{path}: cannot write the report ({error.strerror or error})") from error


def _cards(view: View, leak: Leak) -> list[tuple[str, str, str]]:
    """The few numbers that a reader wants first: value, unit, what it is."""
    result, ok = view.result, view.ok
    angles = np.degrees(rotation_angle(result.rotations[ok]))
    cards = [
        (f"{ok.sum():,} of {len(ok):,}", "", "frames with a head pose"),
        (words.number(rms(angles)), "deg rms", f"head rotation, at most {words.number(angles.max())} deg"),
        (words.number(rms(np.linalg.norm(view.path[ok], axis=1))), "mm rms", "head displacement"),
        (words.number(rms(result.frame_residual)), "mm rms", "residual of the rigid markers"),
    ]
    free = view.columns[~view.rigid]
    if len(free):
        before = rms(movement_rms(view.take.points[ok][:, free]))
        after = rms(movement_rms(result.capture.points[ok][:, free]))
        moved = f"{words.number(before)} → {words.number(after)}"
        cards.insert(3, (moved, "mm rms", "movement of the other markers, before → after"))
    if leak.status == "ok":
        cards.append((words.number(leak.score), "of 1", f"expression leak, p = {leak.p_value:.2g}"))
    return cards


def _parameters(view: View) -> list[tuple[str, str]]:
    result = view.result
    reference = result.reference if isinstance(result.reference, str) else f"frame {result.reference}"
    how = "found automatically" if result.chosen.automatic else "named"
    return [
        ("rigid markers", f"{', '.join(result.rigid)} ({how})"),
        ("pose method", result.pose_method),
        ("pivot method", result.pivot_method),
        ("reference pose", reference),
        ("sway", f"{result.sway_mode}: {words.sway_words(result)}"),
        ("smoothing", words.smoothing_words(result)),
        ("local origin of searches", f"({', '.join(words.coordinate(v) for v in result.origin)}) mm"),
    ]


def _pivot_rows(result: Compensation) -> list[tuple[str, str]]:
    rows = [("position x, y, z", f"{', '.join(words.coordinate(v) for v in result.pivot)} mm")]
    estimate = result.estimate
    for axis, std in zip(estimate.principal_axes, estimate.principal_std, strict=True):
        direction = ", ".join(f"{v:+.2f}".replace("-", "−") for v in axis)
        value = words.number(float(std))
        rows.append((f"standard deviation along ({direction})", value if np.isinf(std) else f"{value} mm"))
    turn = ", ".join(words.number(float(v)) for v in estimate.turn_deg)
    rows.append(("turn of the head about its three principal axes", f"{turn} deg rms"))
    return rows


def _movement(view: View) -> dict[str, Any]:
    """The picture of every marker's movement, and how many markers it leaves out."""
    ok = np.flatnonzero(view.ok)
    before = movement_rms(view.take.points[np.ix_(ok, view.columns)])
    after = movement_rms(view.result.capture.points[np.ix_(ok, view.columns)])
    kept = np.arange(len(view.columns))
    if len(kept) > plots.MOST_BARS:
        order = np.lexsort((-np.nan_to_num(after), ~view.rigid))
        kept = np.sort(order[: plots.MOST_BARS])
    labels = [view.labels[k] for k in kept]
    picture = plots.marker_movement(labels, view.rigid[kept], before[kept], after[kept])
    return {"picture": picture, "shown": len(kept), "all": len(view.columns)}


def _rigid_rows(view: View) -> list[dict[str, Any]]:
    result, ok = view.result, np.flatnonzero(view.ok)
    columns = np.array(result.chosen.columns)
    seen = view.take.visible[:, columns].mean(axis=0)
    before = movement_rms(view.take.points[np.ix_(ok, columns)])
    after = movement_rms(result.capture.points[np.ix_(ok, columns)])
    largest = np.nanmax(result.marker_residual, initial=0.0) or 1.0
    return [
        {
            "label": label,
            "seen": seen[k],
            "residual": float(result.marker_residual[k]),
            "share": float(np.nan_to_num(result.marker_residual[k] / largest)),
            "skin": float(result.chosen.skin_std[k]),
            "told": float(result.chosen.share[k]),
            "before": float(before[k]),
            "after": float(after[k]),
        }
        for k, label in enumerate(result.rigid)
    ]


def _pair_rows(result: Compensation) -> dict[str, Any]:
    """Distances between rigid markers, those that vary most first."""
    leading = result.chosen.leading
    first, second = (leading[part] for part in np.triu_indices(len(leading), 1))
    mean, std = result.chosen.pair_mean[first, second], result.chosen.pair_std[first, second]
    order = np.argsort(-np.nan_to_num(std), kind="stable")
    rows = [
        {
            "pair": f"{result.rigid[first[k]]} – {result.rigid[second[k]]}",
            "mean": float(mean[k]),
            "std": float(std[k]),
            "part": float(std[k] / mean[k]),
        }
        for k in order[:MOST_PAIRS]
    ]
    return {"rows": rows, "all": len(order)}


def _errors(view: View, truth: Truth) -> dict[str, Any]:
    """Errors against truth: a table and their course over time."""
    result = view.result
    rotation = rotation_error_deg(result.rotations, truth.rotations, view.ok)
    expression = expression_error_mm(result.capture.points, truth.clean)
    free = ~np.isin(result.capture.labels, truth.rigid)
    seen = np.isfinite(expression)
    count = seen.sum(axis=1)
    square = np.where(seen, expression, 0.0) ** 2
    per_frame = np.sqrt(np.where(count > 0, square.sum(axis=1) / np.maximum(count, 1), np.nan))
    rows = [
        ("rotation, rms (after the one constant rotation that fits best)", f"{words.number(rms(rotation))} deg"),
        ("rotation, largest", f"{words.number(float(np.nanmax(rotation, initial=0.0)))} deg"),
        (
            "pivot, distance of its mean place",
            f"{words.number(pivot_error_mm(result.pivot, result.sway, truth.pivot, truth.sway, view.ok))} mm",
        ),
        ("expression, rms over the markers that are not rigid", f"{words.number(rms(expression[:, free]))} mm"),
        ("expression, rms over the rigid markers", f"{words.number(rms(expression[:, ~free]))} mm"),
        ("noise of the observed markers, rms length", f"{words.number(truth.noise_mm * 3**0.5)} mm"),
    ]
    return {"rows": rows, "picture": plots.errors(view.take.times, rotation, per_frame)}


def _picture(view: View) -> dict[str, str]:
    """The static picture of the pivot, or why there is none."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "pivot.png"
        try:
            caption = pivot_scene_png(view.result, file, take=view.take)
        except EvalkitError as error:
            return {"uri": "", "caption": str(error)}
        return {"uri": f"data:image/png;base64,{base64.b64encode(file.read_bytes()).decode()}", "caption": caption}


def _provenance(take: Capture, source: str | Path | None) -> list[tuple[str, str]]:
    rows = [
        ("frames, points, rate", f"{take.frames:,}, {len(take.labels)}, {take.rate:g} Hz"),
        ("unit of the file", take.unit),
    ]
    if source is not None:
        try:
            digest = file_sha256(Path(source))
        except OSError as error:
            raise EvalkitError(f"{source}: cannot be read for its checksum ({error.strerror or error})") from error
        rows = [("file", Path(source).name), ("SHA-256", digest), *rows]
    return [
        *rows,
        ("evalkit", __version__),
        ("Python, NumPy", f"{platform.python_version()}, {np.__version__}"),
        ("written", datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")),
    ]
