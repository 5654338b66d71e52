"""From a performer's proportions to the head's: how much larger a marker's displacement is on the head.

Huang, Lin & Ouhyoung 2000, section 4: the upper face is scaled by the distance between the lower eyelids (x) and
from forehead to nose tip (y), the lower face by the width of the mouth (x) and from nose tip to chin (y), both by
the distance between cheeks and lips (z).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from evalkit.deform.centres import HeadLike, site_positions
from evalkit.errors import EvalkitError
from evalkit.geometry import Array

USUAL_RATIO = (0.5, 2.0)
"""Ratios outside are almost always a wrong unit or a swapped label."""

NOSE_TIP = ("NoseL", "NoseR")
"""A marker on the tip of the nose itself is rare; the middle between the wings is at its height."""

LOWER_FACE = frozenset(
    ("UpperLipC", "UpperLipL", "UpperLipR", "MouthL", "MouthR", "LowerLipC", "LowerLipL", "LowerLipR", "Chin")
)
"""Marker sites of the lower face; all others belong to the upper face."""


class ScaleWarning(UserWarning):
    """A ratio between head and performer that is hardly that of two faces."""


@dataclass(frozen=True)
class Measure:
    """A distance that exists on performer and head: between the means of two groups of sites, along one axis."""

    name: str
    axis: int
    first: tuple[str, ...]
    second: tuple[str, ...]

    def of(self, sites: Mapping[str, Array]) -> float:
        """The distance, in the unit of the positions."""
        ends = [np.mean([sites[name][self.axis] for name in group]) for group in (self.first, self.second)]
        return float(abs(ends[1] - ends[0]))


MEASURES: dict[str, Measure] = {
    "upper x": Measure("between the lower eyelids", 0, ("LidL",), ("LidR",)),
    "upper y": Measure("from forehead to nose tip", 1, ("ForeheadC",), NOSE_TIP),
    "lower x": Measure("width of the mouth", 0, ("MouthL",), ("MouthR",)),
    "lower y": Measure("from nose tip to chin", 1, NOSE_TIP, ("Chin",)),
    "z": Measure("depth from cheeks to lips", 2, ("CheekL", "CheekR"), ("UpperLipC", "LowerLipC")),
}
"""What each scale is taken from. Every distance is measured along its own axis (x performer's left, y up, z
forward), so that a face that is wider and not longer changes the scale of x alone."""


@dataclass(frozen=True)
class Ratio:
    """One distance on performer and head."""

    name: str
    performer_mm: float
    head_mm: float

    @property
    def ratio(self) -> float:
        """Head to performer."""
        return self.head_mm / self.performer_mm if self.performer_mm else float("inf")

    @property
    def usual(self) -> bool:
        """Whether it lies within `USUAL_RATIO`."""
        return USUAL_RATIO[0] <= self.ratio <= USUAL_RATIO[1]


@dataclass(frozen=True, eq=False)
class Scaling:
    """How displacements of a performer's markers are scaled for a head.

    Attributes
    ----------
    labels : tuple of str, length n
    scales : ndarray, shape (n, 3)
        Factor of each marker and axis: displacement on the head = scales * displacement of the performer.
    ratios : mapping of str to Ratio
        By the keys of `MEASURES`.
    """

    labels: tuple[str, ...]
    scales: Array
    ratios: Mapping[str, Ratio]


def performer_scaling(head: HeadLike, neutral: Mapping[str, Array]) -> Scaling:
    """Scales from a performer's neutral markers to a head's marker sites.

    Parameters
    ----------
    head : HeadLike
    neutral : mapping of str to ndarray, shape (3,), mm
        The performer's markers at rest, head motion removed, in axes along those of the head.

    Returns
    -------
    Scaling

    Warns
    -----
    ScaleWarning
        One line with both distances for each ratio outside `USUAL_RATIO`.

    Raises
    ------
    EvalkitError
        If a site that a distance is taken from is missing, or not finite, or the performer's distance is zero.

    References
    ----------
    Huang, Lin & Ouhyoung 2000, section 4.
    """
    sites = site_positions(head)
    markers = {name: np.asarray(position, dtype=np.float64) for name, position in neutral.items()}
    for measure in MEASURES.values():
        for name in (*measure.first, *measure.second):
            for whose, places in (("performer", markers), ("head", sites)):
                if name not in places or not np.isfinite(places[name]).all():
                    raise EvalkitError(f"the {whose} has no marker {name}, which the distance {measure.name} needs")
    ratios = {key: Ratio(measure.name, measure.of(markers), measure.of(sites)) for key, measure in MEASURES.items()}
    for key, ratio in ratios.items():
        if ratio.performer_mm <= 0:
            raise EvalkitError(f"the performer's distance {ratio.name} is zero; no scale for {key}")
        if not ratio.usual:
            warnings.warn(
                f"{key} is scaled by {ratio.ratio:.3g}: {ratio.name} is {ratio.performer_mm:.4g} mm on the performer "
                f"and {ratio.head_mm:.4g} mm on the head; check units and labels",
                ScaleWarning,
                stacklevel=2,
            )
    halves = {
        half: [ratios[f"{half} x"].ratio, ratios[f"{half} y"].ratio, ratios["z"].ratio] for half in ("upper", "lower")
    }
    scales = [halves["lower" if name in LOWER_FACE else "upper"] for name in neutral]
    return Scaling(tuple(neutral), np.array(scales), ratios)
