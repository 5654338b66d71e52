"""Static pictures of the report: matplotlib without pyplot, as data URIs."""

from __future__ import annotations

import base64
import io
import warnings
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from PIL import Image

from evalkit.geometry import Array
from evalkit.render import colours
from evalkit.report.measures import View, envelope, runs, signed_axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH_IN = 9.6
"""Width of a full-width picture; shown 960 pixels wide, so that 9 points of text are 12 pixels."""

TRAJECTORY_FRAMES = 1500
BINS = 1600
MOST_BARS = 60
SVG_POINTS = 8000
"""Pictures with more points than this are smaller as PNG."""

PNG_DPI = 150

STYLE: Any = {
    "font.size": 9, "axes.titlesize": 10, "axes.labelsize": 9, "legend.fontsize": 8.5, "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
    "grid.color": "#e4e4e4", "grid.linewidth": 0.6, "axes.axisbelow": True, "legend.frameon": False,
    "axes.unicode_minus": True, "svg.hashsalt": "evalkit", "savefig.facecolor": "white",
}  # fmt: skip


def figure(height: float, **grid: Any) -> tuple[Figure, Any]:
    """A figure of full width with its axes."""
    made = Figure(figsize=(WIDTH_IN, height), layout="constrained")
    return made, made.subplots(**grid)


def data_uri(made: Figure, points: int) -> str:
    """The figure as SVG if it is simple, else as PNG with a palette, a third of the size of one without."""
    file = io.BytesIO()
    with warnings.catch_warnings():
        # A label in a script that the font lacks is drawn as boxes; the tables have it right.
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        if points <= SVG_POINTS:
            made.savefig(file, format="svg", metadata={"Date": None})
            mime = "image/svg+xml"
        else:
            made.set_dpi(PNG_DPI)
            canvas = FigureCanvasAgg(made)
            canvas.draw()
            picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
            picture.quantize(128, dither=Image.Dither.NONE).save(file, "png")
            mime = "image/png"
    return f"data:{mime};base64,{base64.b64encode(file.getvalue()).decode()}"


def plain(text: str) -> str:
    """A label as it stands: matplotlib would read mathematics between dollar signs."""
    return text.replace("$", r"\$")


def trajectories(view: View) -> str:
    """Paths of the markers before and after, as a data URI."""
    return data_uri(trajectory_figure(view), 6 * len(view.frames(TRAJECTORY_FRAMES)) * len(view.columns))


def trajectory_figure(view: View) -> Figure:
    """Paths of the markers before and after, seen from three sides, on one scale."""
    some = view.frames(TRAJECTORY_FRAMES)
    sides = (
        ("from the front", view.left, view.up, "to the left", "up", False),
        ("from the right", view.forward, view.up, "forward", "up", False),
        ("from above", view.left, view.forward, "to the left", "forward", True),
    )
    clouds = [view.before(some) - view.centre, view.after(some) - view.centre]
    with matplotlib.rc_context(STYLE):
        made, axes = figure(6.9, nrows=2, ncols=3)
        for column, (title, across, along, across_word, along_word, flipped) in enumerate(sides):
            flat = [np.stack([points @ across, points @ along], axis=2) for points in clouds]
            both = np.concatenate([f[np.isfinite(f[:, :, 0])] for f in flat])
            low, high = both.min(axis=0), both.max(axis=0)
            half = 0.54 * max(high - low) + 2.0
            middle = 0.5 * (low + high)
            for row, (points, when) in enumerate(zip(flat, ("before", "after"), strict=True)):
                ax: Axes = axes[row, column]
                for is_rigid, colour in ((False, colours.FREE), (True, colours.RIGID)):
                    lines = list(points[:, view.rigid == is_rigid].transpose(1, 0, 2))
                    ax.add_collection(LineCollection(lines, colors=colour, linewidths=0.6, alpha=0.75))
                ax.set_xlim(middle[0] - half, middle[0] + half)
                ax.set_ylim(middle[1] - half, middle[1] + half)
                if flipped:
                    ax.invert_yaxis()
                ax.set_aspect("equal")
                ax.set_title(f"{when}, {title}")
                if row:
                    ax.set_xlabel(f"{signed_axis(across)}, {across_word} (mm)")
                ax.set_ylabel(f"{signed_axis(along)}, {along_word} (mm)")
        handles = [
            Line2D([], [], color=colours.FREE, label="other markers"),
            Line2D([], [], color=colours.RIGID, label="rigid markers"),
        ]
        made.legend(handles=handles, loc="outside upper right", ncols=2)
    return made


def motion(view: View) -> str:
    """Rotation, displacement, sway and residual of the head over time; frames without a pose are shaded."""
    turns, names = view.turns()
    times = view.take.times
    xyz = ["x", "y", "z"]
    panels = [
        (turns, names, "head rotation (deg)"),
        (np.where(view.ok[:, None], view.path, np.nan), xyz, "head displacement (mm)"),
        (np.where(view.ok[:, None], view.result.sway, np.nan), xyz, "sway of the pivot (mm)"),
        (view.result.frame_residual[:, None], ["rigid markers"], "residual (mm rms)"),
    ]
    lost = ~view.ok
    if view.take.frames > 2 * BINS:
        lost = np.repeat(np.add.reduceat(lost, np.arange(0, len(lost), 2)) > 0, 2)[: len(lost)]
    spans = [(times[a], (b - a) / view.take.rate) for a, b in runs(lost)]
    with matplotlib.rc_context(STYLE):
        made, axes = figure(7.6, nrows=4, sharex=True, height_ratios=(3, 3, 3, 2))
        for ax, (values, labels, title) in zip(axes, panels, strict=True):
            short, lines = envelope(times, values, BINS)
            _shade(ax, spans)
            styles = ("-", (0, (5, 1.2)), (0, (1.5, 1)))
            tints = colours.AXES if len(labels) == 3 else (colours.BLACK,)
            for k, label in enumerate(labels):
                ax.plot(short, lines[:, k], color=tints[k], linestyle=styles[k], linewidth=1.0, label=label)
            ax.set_ylabel(title)
            handles, _ = ax.get_legend_handles_labels()
            if spans:
                handles.append(Patch(color="#d9d9d9", label="no head pose"))
            ax.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 0.97), ncols=4, borderaxespad=0.0)
        axes[-1].set_ylim(bottom=0)
        axes[-1].set_xlabel("time (s)")
        axes[-1].set_xlim(0, max(times[-1], 1.0 / view.take.rate))
        made.align_ylabels(axes)
        return data_uri(made, 10 * min(len(times), 2 * BINS) + 4 * len(spans))


def _shade(ax: Axes, spans: list[tuple[float, float]]) -> None:
    """Grey stretches over the whole height."""
    if spans:
        ax.broken_barh(spans, (0, 1), transform=ax.get_xaxis_transform(), color="#d9d9d9", linewidth=0, zorder=0)


def marker_movement(labels: list[str], rigid: np.ndarray, before: Array, after: Array) -> str:
    """Movement of every marker about its mean place, before and after."""
    with matplotlib.rc_context(STYLE):
        made, ax = figure(3.9)
        place = np.arange(len(labels))
        ax.bar(place - 0.21, before, 0.42, color=colours.SKY, label="before")
        ax.bar(
            place + 0.21, after, 0.42, color=colours.BLUE, hatch="///", edgecolor="white", label="after", linewidth=0
        )
        ax.set_xticks(place, [plain(name) for name in labels], rotation=90)
        for text, is_rigid in zip(ax.get_xticklabels(), rigid, strict=True):
            text.set_fontsize(8.5 if len(labels) <= 45 else 7)
            if is_rigid:
                text.set_color(colours.RIGID)
                text.set_fontweight("bold")
        ax.set_ylabel("movement about the mean (mm rms)")
        if np.nanmedian(before) > 30.0 * np.nanmedian(after) > 0:
            ax.set_yscale("log")
            ax.set_ylabel("movement about the mean\n(mm rms, logarithmic)")
        ax.grid(axis="x", visible=False)
        ax.set_xlim(-0.8, len(labels) - 0.2)
        handles, _ = ax.get_legend_handles_labels()
        handles.append(
            Line2D([], [], linestyle="none", marker="s", color=colours.RIGID, label="name of a rigid marker")
        )
        ax.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2)
        return data_uri(made, 8 * len(labels))


def search(trace: Array) -> str:
    """Objective and pivot of every iteration of a search."""
    iteration, objective = trace[:, 0], trace[:, 4]
    with matplotlib.rc_context(STYLE):
        made, (left, right) = figure(2.9, ncols=2)
        left.plot(iteration, objective, color=colours.BLACK, linewidth=1.2)
        left.set_ylabel("objective")
        if objective.min() > 0 and objective.max() > 50 * objective.min():
            left.set_yscale("log")
        for k, name in enumerate("xyz"):
            right.plot(iteration, trace[:, 1 + k] - trace[-1, 1 + k], color=colours.AXES[k], label=name, linewidth=1.2)
        right.set_ylabel("pivot less its last place (mm)")
        right.legend(ncols=3)
        for ax in (left, right):
            ax.set_xlabel("iteration")
        return data_uri(made, 4 * len(trace))


def errors(times: Array, rotation_deg: Array, expression_mm: Array) -> str:
    """Errors against truth over time."""
    with matplotlib.rc_context(STYLE):
        made, axes = figure(3.4, nrows=2, sharex=True)
        axes[0].set_xlim(0, max(times[-1], times[0] + 0.1))
        for ax, values, title in zip(
            axes, (rotation_deg, expression_mm), ("rotation error (deg)", "expression error\n(mm rms)"), strict=True
        ):
            short, line = envelope(times, values[:, None], BINS)
            ax.plot(short, line[:, 0], color=colours.BLACK, linewidth=0.9)
            ax.set_ylabel(title)
            ax.set_ylim(bottom=0)
        axes[-1].set_xlabel("time (s)")
        made.align_ylabels(axes)
        return data_uri(made, 2 * min(len(times), 2 * BINS))
