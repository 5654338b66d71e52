"""The files of a figure: ``NAME.svg`` and ``NAME.pdf``, or ``NAME.png``; what it shows: ``NAME.csv`` and ``.json``."""

from __future__ import annotations

import hashlib
import io
import json
import warnings
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit.figures.style import ruled
from evalkit.figures.table import Table, budget_of
from evalkit.results import staged
from evalkit.study.table import write_csv

VECTOR = ("svg", "pdf")

LARGEST_BYTES = 600_000
"""A scene in full colour that is larger gets a palette: textures need it, and colour maps, which suffer, do not."""


def draw(figure: ModuleType, table: Table) -> Any:
    """A figure from its table: a matplotlib figure, or a picture (H, W, 3) of a scene."""
    with ruled():
        return figure.draw(table)


def raster(picture: Any, dpi: int = 150) -> NDArray[np.uint8]:
    """A drawn figure as pixels (H, W, 3)."""
    if isinstance(picture, np.ndarray):
        return picture
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with ruled():
        canvas = FigureCanvasAgg(picture)
        picture.set_dpi(dpi)
        canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def save(figure: ModuleType, table: Table, folder: Path, with_table: bool = True) -> list[Path]:
    """Draw a figure and write its files, all or none; the same table gives the same bytes.

    Raises
    ------
    EvalkitError
        If the folder cannot be written, or a scene cannot be drawn here.
    """
    picture = draw(figure, table)
    with staged(folder) as stage:
        if with_table:
            _write_table(figure, table, stage)
        if isinstance(picture, np.ndarray):
            from PIL import Image

            path = stage / f"{figure.NAME}.png"
            scene = Image.fromarray(picture)
            scene.save(path, optimize=True)
            if path.stat().st_size > LARGEST_BYTES:
                # A palette takes a third, and is off by one part in 255 on average.
                few = scene.quantize(256, Image.Quantize.MEDIANCUT, kmeans=1, dither=Image.Dither.NONE)
                few.save(path, optimize=True)
        else:
            for kind in VECTOR:
                (stage / f"{figure.NAME}.{kind}").write_bytes(vector(picture, kind))
        names = sorted(path.name for path in stage.iterdir())
    return [folder / name for name in names]


def vector(picture: Any, kind: str) -> bytes:
    """A matplotlib figure as the bytes of an SVG or PDF without a date."""
    file = io.BytesIO()
    dates: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with ruled(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        picture.savefig(file, format=kind, metadata=dates[kind])
    return file.getvalue()


def _write_table(figure: ModuleType, table: Table, stage: Path) -> None:
    path = stage / f"{figure.NAME}.csv"
    empty = table.rows.astype(object).where(table.rows.notna(), None)
    write_csv(empty.to_dict("records"), list(table.rows.columns), path)
    facts = {
        "name": figure.NAME,
        "caption": caption(figure),
        "command": command(figure, table),
        "csv_sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        **{key: value for key, value in table.facts.items() if key not in ("name", "caption", "command", "csv_sha256")},
    }
    text = json.dumps(facts, indent=2) + "\n"
    (stage / f"{figure.NAME}.json").write_text(text, encoding="utf-8")


def command(figure: ModuleType, table: Table) -> str:
    """The command that measures these rows anew and draws them; files of axes are where the user has them."""
    study, facts = table.study, table.facts
    if study is None or "seeds" not in facts:
        return f"evalkit figures {figure.NAME} --run --budget {facts.get('budget', 'full')}"
    for budget in (facts["budget"],) if "budget" in facts else ("full", "small"):
        part = study.at(budget_of(figure, budget))
        other = {axis: found for axis, found in facts["axes"].items() if list(part.axes[axis]) != found}
        axes = "".join(f' --axis "{axis}={",".join(map(str, found))}"' for axis, found in other.items())
        if len(facts["seeds"]) == part.full.seeds:
            return f"evalkit figures {figure.NAME} --run --budget {budget}{axes}"
    seeds = f"evalkit study run {study.name} --budget full --seeds {len(facts['seeds'])}{axes} -o results"
    return f"{seeds} && evalkit figures {figure.NAME} --tables results"


def caption(figure: ModuleType) -> str:
    """What a figure shows: its docstring as one paragraph."""
    return " ".join((figure.__doc__ or "").split())
