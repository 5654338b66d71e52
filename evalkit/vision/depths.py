"""How deep each of the 19 points of a person lies, learnt while his head turns.

Seen along a line of sight with slope ``m`` (mm sideways and up for each mm forward, in the head's axes), a point whose
depth is wrong by ``d`` seems to stand ``d m`` beside its place. Expression moves a point with the head still; a wrong
depth moves it with the turn. The depth that makes a point move least::

    d = -sum (m - mean m) . (x - mean x) / (sum |m - mean m|^2 + r),

with places ``x`` at the depth assumed so far, is therefore the depth that the video itself speaks for. The ridge ``r``
is that of a Gaussian prior: depths of persons scatter about those of the mean face. Points that are as deep as each
other, as the two sides of a face are, share the sums.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evalkit.geometry import Array

PERSONS_MM = 8.0
"""Standard deviation of a point's depth about the mean face's, noses, brows and chins of adults taken together."""

LIKE_FRAMES = 6
"""Frames in a row that show one expression and count once: 0.2 s at 30 Hz."""

LARGEST_MM = 15.0
"""No depth is further off than that."""


class LearntDepths:
    """Depths of points, relative to what was assumed, from all frames so far.

    Parameters
    ----------
    spread_mm : array_like, shape (N, 2)
        Spread of the points' ways in expressions: what a turn has to be told from.
    groups : array_like of int, shape (N,)
        Points with the same number have one depth.
    """

    def __init__(self, spread_mm: Array, groups: NDArray[np.intp]) -> None:
        variance = (0.5 * np.asarray(spread_mm, dtype=np.float64)) ** 2
        _, self._groups = np.unique(groups, return_inverse=True)
        ridge = LIKE_FRAMES * (variance.mean(axis=1) + 1.0) / PERSONS_MM**2
        self._ridge = np.bincount(self._groups, ridge) / np.bincount(self._groups)
        count = len(groups)
        self._weight = np.zeros(count)
        self._slope, self._place = np.zeros((count, 2)), np.zeros((count, 2))
        self._square, self._product = np.zeros(count), np.zeros(count)

    def learn(self, slopes: Array, places_mm: Array, weight: Array) -> None:
        """Take in one frame.

        Parameters
        ----------
        slopes : ndarray, shape (N, 2)
            Of the lines of sight.
        places_mm : ndarray, shape (N, 2)
            Of the points at the assumed depths; anything where the weight is 0.
        weight : ndarray, shape (N,)
            How sure each place is, 0 to 1.
        """
        seen = weight > 0
        w = weight[seen]
        total = self._weight[seen] + w
        # Means and sums about them are carried on together (Welford), which a million frames do not hurt.
        slope, place = slopes[seen] - self._slope[seen], places_mm[seen] - self._place[seen]
        part = (w / total)[:, None]
        self._slope[seen] += part * slope
        self._place[seen] += part * place
        share = w * self._weight[seen] / total
        self._square[seen] += share * (slope * slope).sum(axis=1)
        self._product[seen] += share * (slope * place).sum(axis=1)
        self._weight[seen] = total

    @property
    def offset_mm(self) -> Array:
        """Depth of each point beyond the assumed one, shape (N,)."""
        product, square = (np.bincount(self._groups, sums) for sums in (self._product, self._square))
        return np.clip(-product / (square + self._ridge), -LARGEST_MM, LARGEST_MM)[self._groups]
