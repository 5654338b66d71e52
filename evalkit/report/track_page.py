"""One self-contained page about one tracked video."""

from __future__ import annotations

import base64
import datetime
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from evalkit.geometry import Array
from evalkit.render import colours
from evalkit.render.overlay import STATUS_COLOURS
from evalkit.report import plots
from evalkit.report.measures import envelope, runs
from evalkit.report.page import page_template, write_page
from evalkit.report.track import TrackedVideo, normalised_parameters
from evalkit.vision.angles import AXES, head_angles_deg
from evalkit.vision.parameters import PARAMETERS
from evalkit.vision.tracker import Picture, TrackStatus

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STILLS = 6
"""Frames that are shown."""

STILL_WIDTH = 480
JPEG_QUALITY = 85

MEANING = {
    "tracked": "the face supports the pose",
    "weak": "little of the face supports the pose, or it is carried over: take it with care",
    "lost": "no pose; nothing is written for the frame",
}


def chosen_stills(status: Any, count: int = STILLS) -> list[int]:
    """Frames worth a look: the first, those with the ends of the track, and one of every status that there is."""
    frames = len(status)
    wanted = {int(k) for k in np.linspace(0, frames - 1, count).round()}
    for code in (TrackStatus.WEAK, TrackStatus.LOST):
        stretches = runs(status == code)
        if stretches and not any(status[k] == code for k in wanted):
            first, end = max(stretches, key=lambda stretch: stretch[1] - stretch[0])
            wanted.add((first + end) // 2)
    return sorted(wanted)


def still_uri(picture: Picture) -> str:
    """A picture, at most :data:`STILL_WIDTH` pixels wide, as a data URI."""
    height, width = picture.shape[:2]
    if width > STILL_WIDTH:
        size = (STILL_WIDTH, max(round(height * STILL_WIDTH / width), 1))
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    return f"data:image/jpeg;base64,{base64.b64encode(coded.tobytes()).decode()}"


def write_track_report(
    tracked: TrackedVideo, content: dict[str, Any], stills: Sequence[tuple[int, Picture]], path: Path
) -> None:
    """Write the report of a tracked video as a single HTML file that needs no network.

    Parameters
    ----------
    tracked : TrackedVideo
    content : dict
        Its :func:`evalkit.report.track.summary`.
    stills : sequence of (int, ndarray)
        Frames of the track, by their index in it, with what was found drawn over them.
    path : Path
        File to write.

    Raises
    ------
    EvalkitError
        If it cannot be written.
    """
    head = tracked.track.head
    page = page_template("track.html.j2").render(
        title=content["input"]["file"],
        headline=_headline(content),
        trouble=content["frames"]["lost"] + content["frames"]["weak"] > 0,
        cards=_cards(tracked, content),
        meaning=[(name, content["frames"][name], MEANING[name]) for name in MEANING],
        lost=[
            (first, last, first / tracked.video.rate_hz, (last + 1 - first) / tracked.video.rate_hz)
            for first, last in content["lost"]
        ],
        warnings=content["warnings"],
        assumed=content["camera"]["assumed"],
        stills=[
            (still_uri(picture), tracked.start + k, TrackStatus(int(head.status[k])).text) for k, picture in stills
        ],
        pose=_pose_plot(tracked),
        parameters=_parameter_plot(tracked),
        table=_parameter_rows(tracked, content),
        provenance=_provenance(content),
    )
    write_page(path, page)


def _headline(content: dict[str, Any]) -> str:
    counts, frames = content["frames"], content["input"]["frames"]
    if counts["lost"] == frames:
        return "The face was lost in every frame."
    text = f"The head was followed through {counts['tracked']:,} of {frames:,} frames"
    text += f"; in {counts['weak']:,} its pose is weak" if counts["weak"] else ""
    return text + (f"; in {counts['lost']:,} the face is lost, and nothing is given." if counts["lost"] else ".")


def _cards(tracked: TrackedVideo, content: dict[str, Any]) -> list[tuple[str, str, str]]:
    head, frames = tracked.track.head, content["input"]["frames"]
    known = np.isfinite(head.rotations[:, 0, 0])
    cards = [
        (f"{content['frames'][status.text]:,} of {frames:,}", "", f"frames {status.text}") for status in TrackStatus
    ]
    if known.any():
        angles = head_angles_deg(head.rotations[known])
        for k, axis in enumerate(AXES):
            low, high = angles[:, k].min(), angles[:, k].max()
            cards.append((f"{low:.0f} to {high:.0f}".replace("-", "−"), "deg", axis))
    cards.append((f"{100 * content['parameters_known']:.0f} %", "", "of all parameters and frames have a value"))
    return cards


def _spans(tracked: TrackedVideo) -> list[tuple[str, list[tuple[float, float]]]]:
    """Stretches of weak and of lost frames: colour, and (start, length) in seconds."""
    status, rate = tracked.track.head.status, tracked.video.rate_hz
    return [
        (STATUS_COLOURS[code], [(tracked.times_s[a] - 0.5 / rate, (b - a) / rate) for a, b in runs(status == code)])
        for code in (TrackStatus.WEAK, TrackStatus.LOST)
    ]


def _shade(ax: Axes, spans: list[tuple[str, list[tuple[float, float]]]]) -> None:
    for colour, stretches in spans:
        if stretches:
            ax.broken_barh(
                stretches, (0, 1), transform=ax.get_xaxis_transform(), color=colour, alpha=0.25, linewidth=0, zorder=0
            )


def _keys(spans: list[tuple[str, list[tuple[float, float]]]]) -> list[Patch]:
    return [
        Patch(color=colour, alpha=0.25, label=word)
        for (colour, stretches), word in zip(spans, ("weak", "lost"), strict=True)
        if stretches
    ]


def _drawn(ax: Axes, times: Array, values: Array, labels: Sequence[str], tints: Sequence[str]) -> None:
    short, lines = envelope(times, values, plots.BINS)
    # A frame that stands alone between two lost ones would be no line.
    mark = "." if len(times) < plots.BINS / 4 else ""
    for line, label, tint, style in zip(lines.T, labels, tints, ("-", (0, (5, 1.2)), (0, (1.5, 1))), strict=False):
        ax.plot(short, line, color=tint, linestyle=style, linewidth=1.0, marker=mark, markersize=2.5, label=label)


def _limits(ax: Axes, tracked: TrackedVideo) -> None:
    half = 0.5 / tracked.video.rate_hz
    ax.set_xlim(tracked.times_s[0] - half, tracked.times_s[-1] + half)


def _pose_plot(tracked: TrackedVideo) -> str:
    """Angles, place and confidence over time; weak and lost frames are shaded."""
    head, spans, times = tracked.track.head, _spans(tracked), tracked.times_s
    place = head.translations - np.nanmean(head.translations, axis=0) if np.isfinite(head.translations).any() else (
        head.translations
    )  # fmt: skip
    panels = [
        (head_angles_deg(head.rotations), AXES, "angles of the head (deg)"),
        (place, ("x", "y", "z"), "place about its mean (mm)"),
        (head.confidence[:, None], ("confidence",), "confidence"),
    ]
    with matplotlib.rc_context(plots.STYLE):
        made, axes = plots.figure(6.2, nrows=3, sharex=True, height_ratios=(3, 3, 1.6))
        for ax, (values, labels, title) in zip(axes, panels, strict=True):
            _shade(ax, spans)
            tints = colours.AXES if len(labels) == 3 else (colours.BLACK,)
            _drawn(ax, times, values, labels, tints)
            ax.set_ylabel(title)
            handles = [*ax.get_legend_handles_labels()[0], *_keys(spans)]
            ax.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 0.97), ncols=5, borderaxespad=0.0)
        axes[-1].set_ylim(0, 1.05)
        axes[-1].set_xlabel("time (s)")
        _limits(axes[-1], tracked)
        made.align_ylabels(axes)
        return plots.data_uri(made, 7 * min(len(times), 2 * plots.BINS))


def _parameter_plot(tracked: TrackedVideo) -> str:
    """The fifteen parameters against the face at rest, a small panel each."""
    values, spans = normalised_parameters(tracked), _spans(tracked)
    with matplotlib.rc_context(plots.STYLE):
        # No layout engine: fitting fifteen panels to their labels takes longer than tracking ten seconds of video.
        made = Figure(figsize=(plots.WIDTH_IN, 8.6))
        axes = made.subplots(5, 3, sharex=True, gridspec_kw={"hspace": 0.38, "wspace": 0.27})
        made.subplots_adjust(left=0.07, right=0.99, bottom=0.06, top=0.94)
        for ax, parameter, line in zip(axes.T.ravel(), PARAMETERS, values.T, strict=True):
            _shade(ax, spans)
            scale = 100.0 if parameter.unit == "iod" else 1.0
            _drawn(ax, tracked.times_s, scale * line[:, None], [parameter.name], (colours.BLUE,))
            ax.axhline(0.0, color=colours.GREY, linewidth=0.6, zorder=1)
            ax.set_title(parameter.name, loc="left")
            ax.set_ylabel({"deg": "deg", "ratio": "% of rest", "difference": "% of eyes"}[_kind(parameter)])
        for ax in axes[-1]:
            ax.set_xlabel("time (s)")
            _limits(ax, tracked)
        if keys := _keys(spans):
            made.legend(handles=keys, loc="upper right", ncols=2)
        return plots.data_uri(made, 15 * min(len(tracked.times_s), 2 * plots.BINS))


def _kind(parameter: Any) -> str:
    return "deg" if parameter.unit == "deg" else str(parameter.form)


def _parameter_rows(tracked: TrackedVideo, content: dict[str, Any]) -> list[dict[str, Any]]:
    values = tracked.track.parameters
    rows = []
    for parameter, line in zip(PARAMETERS, values.T, strict=True):
        known = np.isfinite(line)
        rows.append(
            {
                "name": parameter.name, "formula": parameter.formula,
                "unit": "eye distances" if parameter.unit == "iod" else "deg",
                "rest": content["neutral"][parameter.name], "known": float(known.mean()),
                "low": float(line[known].min()) if known.any() else None,
                "high": float(line[known].max()) if known.any() else None,
            }
        )  # fmt: skip
    return rows


def _provenance(content: dict[str, Any]) -> list[tuple[str, str]]:
    source, camera, versions = content["input"], content["camera"], content["versions"]
    return [
        ("file", source["file"]),
        ("SHA-256", source["sha256"] or "–"),
        ("frames, size, rate", f"{source['frames']:,} from frame {source['first_frame']}, {source['width']} x "
         f"{source['height']}, {source['rate_hz']:g} Hz"),
        ("tracker, depths", f"{content['method']['pose']}, {content['method']['depth']}"),
        ("points", f"from {content['points']['from']}"),
        ("camera", f"field of view {camera['view_deg']:.1f} deg ({'assumed' if camera['assumed'] else 'given'})"),
        ("evalkit", content["evalkit"]),
        ("Python, NumPy, OpenCV", f"{versions['python']}, {versions['numpy']}, {versions['opencv']}"),
        ("written", datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")),
    ]  # fmt: skip
