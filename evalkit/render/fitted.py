"""The folder of a head that was fitted to a photo."""

from __future__ import annotations

import json
from pathlib import Path

from evalkit.head.fit_report import FitReport
from evalkit.head.model import Head
from evalkit.head.photo import Photo
from evalkit.head.points import Points, write_points
from evalkit.render.head_views import FITTED_SHEET, head_sheet_png
from evalkit.results import staged


def write_fitted(
    head: Head, report: FitReport, points: Points, photo: Photo, folder: Path, picture: bool = True
) -> list[Path]:
    """Write head.npz, points.json, fit.json with the measures, and head.png, a contact sheet; all or none.

    Raises
    ------
    EvalkitError
        If the folder cannot be written, or nothing can be drawn without a screen here.
    """
    facts = {"points_from": points.source, **report.as_dict()}
    with staged(folder) as stage:
        head.save(stage / "head.npz")
        write_points(stage / "points.json", points, photo)
        (stage / "fit.json").write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
        if picture:
            head_sheet_png(head, stage / "head.png", views=FITTED_SHEET, columns=5)
        names = sorted(path.name for path in stage.iterdir())
    return [folder / name for name in names]
