"""One look for all plots: printed sizes, and one colour, sign and name for a method wherever it is shown."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

from evalkit.render.colours import BLACK, BLUE, GREEN, GREY, SKY, VERMILION

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
    "joint": Look("joint", BLUE, "o"),
    "joint none": Look("joint, no sway", BLUE, "D", ":"),
    "joint smoothed": Look("joint, smoothed", BLUE, "P", "-."),
    "sphere": Look("sphere fit", SKY, "s"),
    "score": Look("SCoRE", GREEN, "^"),
    "gamage-lasenby": Look("Gamage-Lasenby", ORANGE, "v", "-."),
    "svd": Look("SVD", VERMILION, "X"),
    "six-directions": Look("six-directions, mean", PURPLE, "<"),
    "paper": Look("paper, frame 0", PURPLE, ">", "--"),
    "translation-invariants": Look("translation invariants", PURPLE, ">", "--"),
}
"""A method keeps its look from figure to figure."""

_SPARE = [Look("", GREY, marker, line) for line, marker in itertools.product(("-", "--", ":"), "*hpd+x1234")]


def look(method: str) -> Look:
    """How a method is drawn; methods of other packages are grey and told apart by their signs."""
    if method in LOOKS:
        return LOOKS[method]
    spare = _SPARE[sum(map(ord, method)) % len(_SPARE)]
    return spare._replace(name=method)


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


def curve(axes: Axes, found: pd.DataFrame, x: str, method: str, **changes: Any) -> None:
    """A statistic of a method over an axis, with its 95 % intervals; in order of ``x``, NaN left out."""
    found = found.dropna(subset=["value"]).sort_values(x)
    if not len(found):
        return
    how = look(method)
    below, above = found["value"] - found["low"], found["high"] - found["value"]
    drawn = {"label": how.name, "color": how.colour, "marker": how.marker, "linestyle": how.line, **changes}
    axes.errorbar(found[x], found["value"], [below.fillna(0.0), above.fillna(0.0)], elinewidth=0.8, **drawn)


def lettered(axes: Any) -> None:
    """(a), (b), ... at the upper left of each panel."""
    for letter, one in zip("abcdefghijklmnop", axes, strict=False):
        one.set_title(f"({letter}) {one.get_title(loc='left')}".rstrip(), loc="left")
