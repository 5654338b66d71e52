"""One look for all plots: printed sizes, and one colour, sign and name for a method wherever it is shown."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

from evalkit.render.colours import BLACK, BLUE, GREEN, GREY, SKY, VERMILION

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from evalkit.figures.table import Table

COLUMN_IN, PAGE_IN = 3.5, 7.16
"""Widths of one and of two columns of a journal, inches: pictures are made at the size at which they are printed."""

ORANGE, PURPLE = "#E69F00", "#CC79A7"

RULES: Any = {
    "font.family": "DejaVu Sans", "font.size": 7.5, "axes.titlesize": 8, "axes.labelsize": 7.5, "legend.fontsize": 6.5,
    "xtick.labelsize": 7, "ytick.labelsize": 7, "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True, "grid.color": "#e4e4e4", "grid.linewidth": 0.5, "axes.axisbelow": True, "axes.linewidth": 0.6,
    "lines.linewidth": 1.2, "lines.markersize": 4.0, "legend.frameon": False, "legend.handlelength": 2.2,
    "errorbar.capsize": 1.5, "axes.unicode_minus": True, "savefig.facecolor": "white", "svg.hashsalt": "evalkit",
    "pdf.fonttype": 42, "axes.titlelocation": "left",
}  # fmt: skip


class Look(NamedTuple):
    """How a method is drawn."""

    name: str
    colour: str
    marker: str
    line: str = "-"


LOOKS = {
    "bound": Look("Cramér-Rao bound", BLACK, "", "--"),
    # Pivots and head motion
    "joint": Look("joint", BLUE, "o"),
    "joint none": Look("joint, told of no sway", BLUE, "D", ":"),
    "joint smooth": Look("joint, smoothed", BLUE, "P", "-."),
    "joint smoothed": Look("joint, smoothed", BLUE, "P", "-."),
    "robust joint": Look("joint, robust weights", SKY, "D", "--"),
    "auto": Look("all markers, automatic weights", ORANGE, "*"),
    "sphere": Look("sphere fit", SKY, "s"),
    "score": Look("SCoRE", GREEN, "^"),
    "gamage-lasenby": Look("Gamage-Lasenby", ORANGE, "v", "-."),
    "svd": Look("SVD", VERMILION, "X"),
    "svd smooth": Look("SVD, smoothed", VERMILION, "P", "-."),
    "svd triangle": Look("SVD, forehead triangle", PURPLE, ">", "--"),
    "svd candidates": Look("SVD, rigid markers", VERMILION, "X"),
    "svd weighted": Look("SVD, weighted by skin", VERMILION, "P", "-."),
    "robust": Look("robust", GREEN, "d", "--"),
    "raw": Look("no compensation", GREY, "|", ":"),
    "six-directions": Look("six-directions, mean", PURPLE, "<"),
    "paper": Look("paper, frame 0", PURPLE, ">", "--"),
    "translation-invariants": Look("translation invariants", PURPLE, ">", "--"),
    "translation-invariants-raw": Look("the same, raw matrix", PURPLE, "<", ":"),
    "horn": Look("Horn", GREEN, "1", ""),
    "qcp": Look("QCP", ORANGE, "2", ""),
    # Methods of other packages
    "peer-scipy": Look("SciPy", GREY, "3", ""),
    "peer-kineticstoolkit": Look("Kinetics Toolkit", GREY, "4", ""),
    "peer-scikit-surgery-aos": Look("SciKit-Surgery, algebraic", GREY, "h", "-"),
    "peer-scikit-surgery-sphere": Look("SciKit-Surgery, sphere", GREY, "p", "--"),
    "peer-biobuddy-score": Look("biobuddy, SCoRE", GREY, "*", ":"),
    # Searches
    "nlopt-neldermead": Look("Nelder-Mead", BLUE, "o"),
    "nlopt-sbplx": Look("Subplex", SKY, "s"),
    "nlopt-bobyqa": Look("BOBYQA", GREEN, "^"),
    "nlopt-newuoa": Look("NEWUOA", GREEN, "v", "--"),
    "nlopt-cobyla": Look("COBYLA", ORANGE, "D"),
    "nlopt-direct": Look("DIRECT", GREY, "p"),
    "nlopt-lbfgs": Look("L-BFGS (squared variant)", VERMILION, "X"),
    "nlopt-mma": Look("MMA (squared variant)", VERMILION, "d", "--"),
    "nlopt-slsqp": Look("SLSQP (squared variant)", VERMILION, "P", ":"),
    # Kernels
    "exponential": Look("exponential (the paper's)", BLUE, "o"),
    "geodesic-exponential": Look("exponential, geodesic", BLUE, "P", ":"),
    "biharmonic": Look("biharmonic", SKY, "s", "--"),
    "bilaplacian": Look("bi-Laplacian, surface", VERMILION, "X"),
    "thin-plate": Look("thin plate", GREEN, "^"),
    "cubic": Look("cubic", GREEN, "v", "--"),
    "matern-3-2": Look("Matérn 3/2", PURPLE, ">"),
    "matern-5-2": Look("Matérn 5/2", PURPLE, "<", "--"),
    "gaussian": Look("Gaussian", ORANGE, "D"),
    "multiquadric": Look("multiquadric", BLACK, "h", "-."),
    "inverse-multiquadric": Look("inverse multiquadric", BLACK, "p", ":"),
    "wendland-c2": Look("Wendland C2", GREY, "d"),
    "shepard": Look("Shepard", GREY, "*", "--"),
    # Character Transfer
    "rough": Look("rough shapes as they are", BLACK, "", "--"),
    "gain": Look("one gain", GREY, "s", ":"),
    "position deltas": Look("position deltas", GREEN, "^"),
    "position deltas of one region": Look("position deltas of one region", GREEN, "v", "--"),
    "one region": Look("Character Transfer, one region", SKY, "s", "--"),
    "hand-drawn regions": Look("Character Transfer, hand-drawn regions", SKY, "D", "-."),
    "character transfer": Look("Character Transfer (the paper's)", BLUE, "o"),
    "example-based rigging": Look("example-based rigging", ORANGE, "P"),
    "local regression": Look("local regression (ours)", VERMILION, "*"),
    "rotation-stretch": Look("rotation and stretch (the paper's)", BLUE, "o"),
    "linear": Look("linear", VERMILION, "X", "--"),
    "ridge": Look("ridge", BLUE, "o"),
    "hardly a ridge": Look("hardly a ridge", BLUE, "D", ":"),
    "strong ridge": Look("strong ridge", SKY, "s"),
    "non-negative": Look("non-negative", GREEN, "^"),
    "sum-to-one": Look("sum to one", ORANGE, "P"),
    "convex": Look("convex", VERMILION, "X"),
    "left": Look("from the left (the paper's)", BLUE, "o"),
    "right": Look("from the right", VERMILION, "X"),
    "left, true coefficients": Look("from the left, coefficients before turning", BLUE, "s", "--"),
    "right, true coefficients": Look("from the right, coefficients before turning", VERMILION, "P", "--"),
    "random": Look("drawn at random", VERMILION, "s"),
    "chosen": Look("chosen", BLUE, "o"),
    # Head pose apart from deformation
    "centroid of all": Look("centred on all markers", BLACK, "h", "--"),
    "factorisation": Look("factorisation (the paper's)", PURPLE, ">"),
    "factorisation, not refused": Look("factorisation, not refused", PURPLE, "<", ":"),
    "aligned": Look("aligned, weighted automatically", BLUE, "o"),
    "aligned, rigid found": Look("aligned, rigid markers found", SKY, "s", "--"),
    "aligned, rigid named": Look("aligned, rigid markers named", GREEN, "^"),
    "rigid named, noise kept": Look("the same, noise kept", GREEN, "v", ":"),
    "compensation": Look("compensation", ORANGE, "*"),
    "Procrustes of all": Look("Procrustes over all markers", VERMILION, "X"),
    # Seams
    "none": Look("no regions", GREY, "o"),
    "hard": Look("hard seam", VERMILION, "X"),
    "ramp": Look("ramp", BLUE, "s"),
    "spline": Look("spline", GREEN, "^"),
    # Searches for the nearest windows
    "pruned": Look("pruned (default, exact)", BLUE, "o"),
    "exact": Look("brute force", BLACK, "s", ":"),
    "k-d tree": Look("k-d tree", ORANGE, "v", "-."),
    "graph": Look("neighbour graph, random windows", VERMILION, "X"),
    "graph only": Look("neighbour graph (the paper's)", PURPLE, ">", "--"),
    "faiss": Look("faiss, brute force", GREY, "h"),
    "hnsw": Look("faiss, HNSW", GREEN, "^"),
    # Head trackers
    "cylinder": Look("cylinder", BLUE, "o"),
    "face-surface": Look("cylinder with the mean face's relief", SKY, "s", "--"),
    "learnt-relief": Look("cylinder with a learnt relief", GREEN, "^"),
    "pyrlk": Look("optical flow and PnP", ORANGE, "D"),
    "mediapipe": Look("MediaPipe", GREY, "h"),
    "static": Look("first frame", VERMILION, "X"),
    "dynamic": Look("last frame", GREEN, "^"),
    "references": Look("last frame, references", BLUE, "o"),
    # Filters of control parameters
    "held": Look("none", GREY, "|", ":"),
    "moving average": Look("moving average", GREY, "s", "--"),
    "savitzky-golay": Look("Savitzky-Golay", GREY, "^"),
    "global pca": Look("PCA of all windows", GREEN, "v", "--"),
    "projection": Look("local PCA (the paper's)", BLUE, "o"),
    "weighted projection": Look("local PCA, weighted", SKY, "s", "--"),
    "posterior": Look("posterior mean (ours)", VERMILION, "*"),
    "local posterior": Look("posterior mean, local", ORANGE, "D"),
    # Synthesis of markers
    "rest": Look("face at rest", GREY, "|", ":"),
    "random windows": Look("random windows", GREY, "x", ":"),
    "nearest possible": Look("nearest possible frame", BLACK, "D", "--"),
    "linear map": Look("linear map alone", GREEN, "v"),
    "inverse distance": Look("inverse distance (the paper's)", BLUE, "o"),
    "gaussian weights": Look("Gaussian weights", SKY, "s"),
    "local components": Look("local components", PURPLE, ">"),
    "nearest": Look("nearest window", ORANGE, "P"),
    "corrected inverse distance": Look("inverse distance, corrected (ours)", VERMILION, "*"),
    "corrected local components": Look("local components, corrected", PURPLE, "<", "--"),
}  # fmt: skip
"""A method keeps its look from figure to figure; those of other packages are grey."""

_SPARE = [Look("", GREY, marker, line) for line, marker in itertools.product(("-", "--", ":"), "*hpd+x1234")]


def look(method: str) -> Look:
    """How a method is drawn; one that is not in the table is grey, with a sign of its own as far as signs go."""
    if method in LOOKS:
        return LOOKS[method]
    spare = _SPARE[sum(map(ord, method)) % len(_SPARE)]
    return spare._replace(name=method)


def looked(methods: Sequence[str]) -> list[str]:
    """Methods in the order of :data:`LOOKS`, unknown ones after them."""
    known = [method for method in LOOKS if method in methods]
    return known + [method for method in methods if method not in LOOKS]


@contextmanager
def ruled() -> Iterator[None]:
    """Drawing by :data:`RULES`."""
    import matplotlib

    with matplotlib.rc_context(RULES):
        yield


def canvas(width_in: float = COLUMN_IN, height_in: float = 2.6, **grid: Any) -> tuple[Figure, Any]:
    """A figure at the size at which it is printed, and its axes (as ``Figure.subplots(**grid)`` gives them)."""
    from matplotlib.figure import Figure

    made = Figure(figsize=(width_in, height_in), layout="constrained")
    return made, made.subplots(**grid)


def curve(axes: Axes, found: pd.DataFrame, x: str, method: str, dodge: float = 0.0, **changes: Any) -> None:
    """A statistic of a method over an axis, with its 95 % intervals; in order of ``x``, NaN left out.

    Signs that would lie on each other are moved aside: by ``dodge``, a factor less one on a logarithmic axis.
    """
    found = found.dropna(subset=["value"]).sort_values(x)
    if not len(found):
        return
    how = look(method)
    at = found[x] * (1.0 + dodge) if axes.get_xscale() == "log" else found[x] + dodge
    drawn = {"label": how.name, "color": how.colour, "marker": how.marker, "linestyle": how.line, **changes}
    axes.errorbar(at, found["value"], reach(found), elinewidth=0.8, **drawn)


def dots(axes: Axes, found: pd.DataFrame, by: str, order: Sequence[Any], method: str, shift: float = 0.0) -> None:
    """A statistic of a method, its 95 % intervals lying, one line for every value of ``by``, the first on top."""
    found = found.dropna(subset=["value"])
    if not len(found):
        return
    how = look(method)
    at = [list(order).index(value) + shift for value in found[by]]
    axes.errorbar(
        found["value"], at, xerr=reach(found), label=how.name, color=how.colour, marker=how.marker, linestyle="",
        elinewidth=0.8,
    )  # fmt: skip


def reach(found: pd.DataFrame) -> list[Any]:
    """How far intervals reach below and above their values; nothing where there is one seed."""
    below, above = found["value"] - found["low"], found["high"] - found["value"]
    return [below.fillna(0.0).clip(lower=0.0), above.fillna(0.0).clip(lower=0.0)]


def lines(axes: Axes, names: Sequence[str]) -> None:
    """The lines of :func:`dots`, named, with faint rules between them."""
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    for k in range(1, len(names)):
        axes.axhline(k - 0.5, color=RULES["grid.color"], linewidth=0.5, zorder=0)


def heat(
    axes: Axes, values: Any, rows: Sequence[str], columns: Sequence[str], colours: Any, text: str = "{:.2f}",
    reach: Any = None,
) -> None:  # fmt: skip
    """A table of numbers (rows, columns) on their colours; ``reach`` is what goes below each, plus or minus.

    ``colours`` are numbers of the same shape from 0 to 1, a dark one is a large number; NaN is an empty cell.
    """
    import numpy as np
    from matplotlib import colormaps

    table, shades = np.asarray(values, dtype=float), np.asarray(colours, dtype=float)
    map_ = colormaps["Blues"]
    # Cells as shapes: an image would be pixels in a vector file.
    axes.pcolormesh(np.ma.masked_invalid(shades), cmap=map_, vmin=-0.05, vmax=1.3, edgecolors="white", linewidth=0.8)
    for (i, j), value in np.ndenumerate(table):
        if not np.isfinite(value):
            axes.text(j + 0.5, i + 0.5, "-", ha="center", va="center", fontsize=6)
            continue
        ink = "white" if shades[i, j] > 0.75 else "black"
        below = reach is not None and np.isfinite(reach[i, j])
        axes.text(j + 0.5, i + (0.38 if below else 0.5), text.format(value), ha="center", va="center", fontsize=6,
                  color=ink)  # fmt: skip
        if below:
            words = "±" + text.format(reach[i, j])
            axes.text(j + 0.5, i + 0.74, words, ha="center", va="center", fontsize=4.8, color=ink)
    axes.set_xticks(np.arange(len(columns)) + 0.5, columns)
    axes.set_yticks(np.arange(len(rows)) + 0.5, rows)
    axes.set_ylim(len(rows), 0)
    axes.grid(visible=False)
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)


def shades(values: Any, log: bool = True) -> Any:
    """Numbers from 0 to 1 for :func:`heat`: the place of each between the least and the greatest."""
    import numpy as np

    x = np.asarray(values, dtype=float)
    x = np.log(np.maximum(x, np.nanmin(x[x > 0], initial=1.0))) if log else x
    low, high = np.nanmin(x), np.nanmax(x)
    return (x - low) / (high - low) if high > low else np.where(np.isfinite(x), 0.0, np.nan)


def at_values(axes: Axes, values: Sequence[Any], log: bool = True) -> None:
    """The x axis with ticks at the values that were measured, as plain numbers."""
    from matplotlib.ticker import NullLocator

    ticks = sorted(set(values))
    if log:
        axes.set_xscale("log")
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.xaxis.set_minor_locator(NullLocator())


def plain_log(axis: Any, low: float, high: float) -> None:
    """A logarithmic axis from low to high with readable ticks: plain numbers, powers of ten where it spans many."""
    import numpy as np
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    axis.axes.set(**{f"{axis.axis_name}lim": (low, high)})
    decades = float(np.log10(high / low))
    subs: tuple[float, ...] = (1.0,)
    if decades < 2.2:
        subs = (1.0, 2.0, 5.0) if decades > 0.9 else (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)
    axis.set_major_locator(LogLocator(subs=subs, numticks=9))
    axis.set_minor_locator(NullLocator())
    plain = np.log10(low) > -4 and np.log10(high) < 5
    axis.set_major_formatter(
        FuncFormatter(lambda value, _: f"{value:g}" if plain else f"$10^{{{np.log10(value):.0f}}}$")
    )


def keyed(made: Figure, table: Table, axes: Sequence[Axes], ncols: int = 3) -> None:
    """One legend below all panels, covering none of them; above it, how many rows of which method have no answer."""
    entries: dict[str, Any] = {}
    for one in axes:
        handles, names = one.get_legend_handles_labels()
        entries.update(zip(names, handles, strict=True))
    lost = failures(table)
    made.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=ncols, title=lost or None,
                title_fontsize=6.5)  # fmt: skip


def failures(table: Table) -> str:
    """Rows without an answer, in words; empty if there are none."""
    rows = table.rows
    if "status" not in rows.columns:
        return ""
    lost = rows[rows["status"] != "ok"].groupby("method", sort=False).size()
    told = [f"{look(method).name} {count} of {(rows['method'] == method).sum()}" for method, count in lost.items()]
    return f"takes without an answer: {', '.join(told)}" if told else ""


def lettered(axes: Any) -> None:
    """(a), (b), ... at the upper left of each panel."""
    for letter, one in zip("abcdefghijklmnop", axes, strict=False):
        one.set_title(f"({letter}) {one.get_title(loc='left')}".rstrip(), loc="left")
