"""Smooth motion of the pivot itself: a constant, or a uniform cubic B-spline over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array


@dataclass(frozen=True, eq=False)
class Basis:
    """Functions of time of which a few, next to each other, are not zero in any one frame.

    Attributes
    ----------
    first : ndarray of int, shape (F,)
        Index of the first function that is not zero, ascending.
    values : ndarray, shape (F, Q)
        Values of functions ``first`` to ``first + Q - 1``.
    size : int
        Number of functions K.
    spacing_s : float
        Distance of the knots, s; infinite for the constant.
    """

    first: np.ndarray
    values: Array
    size: int
    spacing_s: float

    def evaluate(self, coefficients: Array) -> Array:
        """Sum of the functions, shape (K, D) to (F, D)."""
        return sum(self.values[:, q, None] * coefficients[self.first + q] for q in range(self.values.shape[1]))

    def part(self, frames: slice) -> tuple[Basis, slice]:
        """The functions that consecutive frames meet, in these frames, and which functions they are."""
        first, values = self.first[frames], self.values[frames]
        met = slice(int(first[0]), int(first[-1]) + values.shape[1])
        return Basis(first - met.start, values, met.stop - met.start, self.spacing_s), met

    def gather(self, data: Array) -> Array:
        """Transposed product ``B' data``, shape (F, D) to (K, D)."""
        out = np.zeros((self.size, data.shape[1]))
        starts, spans = self._spans()
        for q in range(self.values.shape[1]):
            out[spans + q] += np.add.reduceat(self.values[:, q, None] * data, starts, axis=0)
        return out

    def bands(self, data: Array) -> Array:
        """Diagonals of ``B' diag(data) B``: entry [m, k] is ``sum_i B_ik B_i,k+m data_i``; (F, D) to (Q, K, D)."""
        count = self.values.shape[1]
        out = np.zeros((count, self.size, data.shape[1]))
        starts, spans = self._spans()
        for q in range(count):
            for r in range(q, count):
                product = (self.values[:, q] * self.values[:, r])[:, None] * data
                out[r - q, spans + q] += np.add.reduceat(product, starts, axis=0)
        return out

    def _spans(self) -> tuple[np.ndarray, np.ndarray]:
        spans, starts = np.unique(self.first, return_index=True)
        return starts, spans


def constant(frames: int) -> Basis:
    """The pivot at rest."""
    return Basis(np.zeros(frames, dtype=int), np.ones((frames, 1)), 1, np.inf)


def cubic(frames: int, rate: float, spacing_s: float) -> Basis:
    """Uniform cubic B-splines over the take, knots about ``spacing_s`` apart.

    Raises
    ------
    EvalkitError
        If the spacing is not positive or shorter than two frames.

    References
    ----------
    de Boor, "A practical guide to splines" (1978).
    """
    if not (np.isfinite(spacing_s) and spacing_s * rate >= 2):
        raise EvalkitError(f"sway knots {spacing_s} s apart are shorter than two frames at {rate:g} Hz")
    spans = max(round((frames - 1) / (spacing_s * rate)), 1)
    at = np.arange(frames) * (spans / max(frames - 1, 1))
    first = np.minimum(at.astype(int), spans - 1)
    u = at - first
    values = np.stack([(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3], axis=1) / 6
    return Basis(first, values, spans + 3, (frames - 1) / rate / spans)


def roughness(size: int, count: int) -> Array:
    """Diagonals (count, K) of the normal matrix of second differences, zero where there are too few functions."""
    out = np.zeros((count, size))
    row = np.array([1.0, -2.0, 1.0])
    for m in range(min(3, count)):
        for a in range(3 - m):
            if size > 2:
                out[m, a : a + size - 2] += row[a] * row[a + m]
    return out


def smoothed(path: Array, ok: np.ndarray, rate: float, spacing_s: float) -> Array:
    """Least-squares spline through the pivot's displacement, shape (F, 3), mm; it bridges frames that are not ok.

    A light penalty on second differences (Eilers & Marx 1996, doi:10.1214/ss/1038425655) decides where no
    frame is known.

    Raises
    ------
    EvalkitError
        As :func:`cubic`.
    """
    from scipy.linalg import solveh_banded

    basis = cubic(len(path), rate, spacing_s)
    bands = basis.bands(ok[:, None].astype(np.float64))[:, :, 0]
    largest = max(float(bands[0].max()), 1e-9)
    bands = bands + 1e-6 * largest * roughness(basis.size, len(bands))
    bands[0] += 1e-12 * largest
    right = basis.gather(np.where(ok[:, None], path, 0.0))
    return basis.evaluate(solveh_banded(bands, right, lower=True))
