"""Which markers of a take belong to the head, for pictures that would drown in a whole body."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from evalkit.capture import Capture
from evalkit.compensation import Compensation

HEAD_MM = 300.0
"""Markers further from the middle of the rigid ones are not on the same head."""


def head_columns(take: Capture, result: Compensation) -> NDArray[np.intp]:
    """Columns of the markers within a head's size of the rigid ones, the rigid ones included.

    Points that are no positions (angles, forces) and markers never seen in a frame with a head pose are left
    out. Distances are taken in the reference pose, where head markers keep their place.
    """
    columns = position_columns(take)
    places = median_places(result.capture.points[:, columns])
    with np.errstate(invalid="ignore"):
        near = np.linalg.norm(places - np.nanmean(result.template, axis=0), axis=1) <= HEAD_MM
    # A marker without a place compares as far away.
    return np.union1d(columns[near], result.chosen.columns)


def position_columns(take: Capture) -> NDArray[np.intp]:
    """Columns of the points that are positions."""
    return np.flatnonzero([kind == "position" for kind in take.quantities])


def median_places(points: np.ndarray, most: int = 2001) -> np.ndarray:
    """Median place (M, 3) of every marker over at most so many evenly spread frames, NaN if never seen."""
    some = points[np.unique(np.linspace(0, len(points) - 1, min(len(points), most)).astype(int))]
    with warnings.catch_warnings():
        # A marker that is never seen has no median; NaN says so.
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nanmedian(some, axis=0)
