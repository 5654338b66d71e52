"""How good a fit to a photo is, in numbers and in words."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from evalkit.geometry import Array
from evalkit.head.model import Head
from evalkit.head.photo import Photo
from evalkit.head.photo_warp import Similarity, Warp


@dataclass(frozen=True)
class FitReport:
    """Measures of a fit; :meth:`as_dict` gives them for JSON.

    Attributes
    ----------
    reprojection_rms_px, reprojection_max_px : float, pixels of the photo
        Distance of the fitted head's landmarks from the points given.
    worst_point : str
    relaxed : float
        Weight of smoothness against the points; 0 where they are followed exactly.
    pixels_per_mm, roll_deg : float
        Of the similarity.
    eyes_px : float
        Between the outer corners of the eyes.
    """

    reprojection_rms_px: float
    reprojection_max_px: float
    worst_point: str
    relaxed: float
    pixels_per_mm: float
    roll_deg: float
    eyes_px: float
    status: dict[str, str] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """All measures as numbers, words and lists."""
        return asdict(self)

    def lines(self) -> list[str]:
        """The measures for people."""
        return [
            f"points followed within {self.reprojection_rms_px:.2f} px rms, {self.reprojection_max_px:.2f} at most "
            f"({self.worst_point})",
            *(f"warning: {word}: {text}" for word, text in self.status.items()),
        ]


def report_fit(
    before: Head, fitted: Head, photo: Photo, view: Similarity, warp: Warp, places: dict[str, Array]
) -> FitReport:
    """Measure a fit."""
    names = [name for name in places if name in fitted.landmarks]
    seen = view.to_photo(np.array([fitted.landmarks[name] for name in names]))
    off = np.linalg.norm(seen - np.array([places[name] for name in names]), axis=1)
    return FitReport(
        float(np.sqrt((off**2).mean())), float(off.max()), names[int(off.argmax())], warp.relaxed, view.pixels_per_mm,
        view.roll_deg, float(np.linalg.norm(places["eye outer left"] - places["eye outer right"])),
    )  # fmt: skip
