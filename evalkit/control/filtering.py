"""Data-driven filter: a noisy window of control parameters becomes one that the database's motion could have made.

Two kinds. Projection is that of section 5.2 of Chai, Xiao & Hodgins (2003), doi:10.2312/SCA03/193-206: windows of
natural motion lie near a manifold of few dimensions; around a noisy window it is taken to be the plane through the
nearest windows of the database that keeps 99 % of their variance. What is off the plane is noise, or an expression that
the database does not have: projection cannot tell these apart, and takes away both.

The posterior mean can, where noise is rough and expressions are smooth: it takes the window for a draw from a Gaussian
prior with independent noise in every sample, whose variance it measures in the window itself, by third differences.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.control.motion_windows import legal_starts
from evalkit.control.signal_windows import Layout, over_windows
from evalkit.errors import EvalkitError
from evalkit.geometry import Array

Indices = NDArray[np.intp]

NEIGHBOURS = 100
"""Nearest windows that make the plane; the paper takes 50 to 150."""

KEPT_VARIANCE = 0.99
"""Share of the neighbours' variance that the plane keeps, as in the paper."""

PRIOR_VARIANCE = 0.9999
"""Share of the variance of all windows that their prior keeps; what it leaves is lost even of a clean signal."""

STRANGE = 0.01
"""Variance, over that of the database, with which a parameter may move against the others as it never does there, no
quicker than parameters move. Without it even a clean signal would lose what the database does not have."""

PRIOR_WINDOWS = 20_000
"""Windows that the prior is made from: many more than it has dimensions."""

NOISE_FLOOR = 1e-6
"""Least variance of noise, in squared spreads: a thousandth of a spread is less than any tracker knows."""


class Windows(Protocol):
    """What the filter needs of a :class:`~evalkit.control.database.Database`."""

    @property
    def parameters(self) -> Any:
        """(N, 15), NaN-free, in units of their spread."""

    @property
    def known(self) -> Any:
        """(15,), parameters that the database knows."""

    @property
    def segments(self) -> Any:
        """(S, 2), rows [start, stop) of unbroken motion."""


class Searcher(Protocol):
    """What finds the nearest windows (:mod:`evalkit.control.search`)."""

    def nearest(self, queries: Array, k: int) -> tuple[Array, NDArray[np.int64]]:
        """Distances and first rows (Q, k) of the windows nearest to queries (Q, W P), nearest first."""


@dataclass(frozen=True, eq=False)
class Plane:
    """Planes through neighbours of Q windows, as weights of the neighbours: ``x = mean + directions c``.

    Everything is a weighted sum of the neighbours, so that what the plane says of the parameters says it of whatever
    else is known of the neighbours too.

    Attributes
    ----------
    mean : ndarray, shape (Q, K)
        Weights whose sum is the middle; they add up to 1.
    directions : ndarray, shape (Q, K, M)
        Weights of orthonormal directions; each adds up to 0. Unused ones are 0.
    variances : ndarray, shape (Q, M)
        Along the directions, relative to the weights; 0 where unused.
    rest : ndarray, shape (Q,)
        Variance that is left off the plane, per number (Tipping & Bishop, "Probabilistic principal component
        analysis", 1999, equation 3.13), doi:10.1111/1467-9868.00196.
    """

    mean: Array
    directions: Array
    variances: Array
    rest: Array


def local_plane(neighbours: Array, weights: Array, kept: float = KEPT_VARIANCE) -> Plane:
    """Principal components of neighbours (Q, K, D) under weights (Q, K) that add up to 1.

    Eigenvectors of the K x K matrix of inner products: K is smaller than D = W P.
    """
    centred = neighbours - weights[:, None] @ neighbours
    root = np.sqrt(weights)[..., None]
    scaled = centred * root
    values, vectors = np.linalg.eigh(scaled @ scaled.transpose(0, 2, 1))
    values, vectors = np.maximum(values[:, ::-1], 0.0), vectors[:, :, ::-1]
    total = values.sum(axis=1, keepdims=True)
    before = np.cumsum(values, axis=1) - values
    # Rounding leaves the rest of a window that all neighbours share some 1e-16 of its size: no direction.
    used = (before < kept * total) & (values > 1e-12 * total)
    most = max(int(used.sum(axis=1).max(initial=0)), 1)
    values, vectors, used = values[:, :most], vectors[:, :, :most], used[:, :most]
    variances = np.where(used, values, 0.0)
    scale = np.where(used, 1.0 / np.sqrt(np.where(used, values, 1.0)), 0.0)
    directions = root * vectors * scale[:, None]
    directions -= weights[..., None] * directions.sum(axis=1, keepdims=True)
    left = np.maximum(total[:, 0] - variances.sum(axis=1), 0.0)
    return Plane(weights, directions, variances, left / np.maximum(neighbours.shape[2] - used.sum(axis=1), 1))


def even(distances: Array) -> Array:
    """Every neighbour weighs alike, as in the paper."""
    return np.full(distances.shape, 1.0 / distances.shape[1])


def by_distance(distances: Array) -> Array:
    """``exp(-d² / (2 m²))``, m the median distance of the neighbours: nearer ones weigh more."""
    scale = np.maximum(np.median(distances, axis=1, keepdims=True), np.finfo(float).tiny)
    weights = np.exp(-0.5 * (distances / scale) ** 2)
    return weights / weights.sum(axis=1, keepdims=True)


@dataclass(frozen=True)
class Method:
    """A way to filter.

    Attributes
    ----------
    text : str
    weights : callable, optional
        From distances (Q, K) to the weights of the neighbours in a local model; None uses no neighbours.
    posterior : bool
        Posterior mean; otherwise projection.
    """

    text: str
    weights: Callable[[Array], Array] | None
    posterior: bool = False


methods: dict[str, Method] = {
    "projection": Method("on the plane of the nearest windows (the paper's)", even),
    "weighted projection": Method("the same, nearer windows weighing more", by_distance),
    "posterior": Method("posterior mean, prior from all windows", None, posterior=True),
    "local posterior": Method("posterior mean, prior from the nearest windows and all", even, posterior=True),
}
"""Name -> a way to filter."""

DEFAULT_METHOD = "posterior"


def on_plane(plane: Plane, neighbours: Array, windows: Array) -> Array:
    """Weights (Q, K) of the neighbours (Q, K, D) that make the place in the plane nearest to windows (Q, D).

    Of windows with gaps only what is known counts. The plane alone may then leave a direction open, which the
    neighbours' own variance closes: the posterior mean with the variance off the plane as noise.
    """
    known = np.isfinite(windows)
    axes = neighbours.transpose(0, 2, 1) @ plane.directions
    offset = np.where(known, windows - (plane.mean[:, None] @ neighbours)[:, 0], 0.0)
    onto = axes.transpose(0, 2, 1) @ offset[..., None]
    if not known.all():
        used = plane.variances > 0
        noise = np.maximum(plane.rest, 1e-9 * np.maximum(plane.variances[:, 0], np.finfo(float).tiny))
        prior = np.where(used, noise[:, None] / np.where(used, plane.variances, 1.0), 1.0)
        seen = axes * known[..., None]
        system = seen.transpose(0, 2, 1) @ seen + prior[:, None] * np.eye(prior.shape[1])
        # Whole windows are projected as they are, whoever they share the batch with.
        gaps = ~known.all(axis=1)
        onto[gaps] = np.linalg.solve(system[gaps], onto[gaps])
    return plane.mean + (plane.directions @ onto)[..., 0]


def noise_variance(windows: Array) -> Array:
    """Variance of independent noise in windows (Q, W, P), for each parameter (Q, P).

    Third differences of noise have 1 + 9 + 9 + 1 = 20 times its variance, those of a smooth motion next to none. A
    parameter with too many gaps has the mean of the others. Of a signal that is slower than the database, whose samples
    lie between frames, it is told too small.
    """
    if windows.shape[1] < 4:
        raise EvalkitError("noise cannot be told from motion in windows of fewer than 4 frames; use longer ones")
    squares = np.diff(windows, 3, axis=1) ** 2 / 20.0
    known = np.isfinite(squares)
    count = known.sum(axis=1)
    total = np.where(known, squares, 0.0).sum(axis=1)
    together = total.sum(axis=1, keepdims=True) / np.maximum(count.sum(axis=1, keepdims=True), 1)
    return np.where(count > 0, total / np.maximum(count, 1), together)


@dataclass(frozen=True, eq=False)
class WindowPrior:
    """Gaussian of all windows of a database and, with :data:`STRANGE`, of others, in its principal components.

    Attributes
    ----------
    mean : ndarray, shape (W P,)
    axes : ndarray, shape (W P, n)
        Orthonormal, the strongest first; n keep :data:`PRIOR_VARIANCE`.
    variances : ndarray, shape (n,)
    rest : float
        Variance of each number that the components leave: noise as far as they are concerned. Without it what is
        missing would be told from differences that they do not mean.
    """

    mean: Array
    axes: Array
    variances: Array
    rest: float

    @classmethod
    def of(cls, database: Windows, window: int, columns: Indices) -> WindowPrior:
        """From windows spread evenly over a database."""
        starts = legal_starts(database.segments, window)
        some = starts[np.unique(np.linspace(0, len(starts) - 1, min(len(starts), PRIOR_WINDOWS)).astype(np.intp))]
        rows = gathered(database.parameters, some, 0, window)[..., columns]
        points = rows.reshape(len(some), -1).astype(np.float64)
        mean = points.mean(axis=0)
        points -= mean
        covariance = points.T @ points / len(points)
        # Correlation over time, as the parameters have it in the mean, for each of them alone.
        apart = covariance.reshape(window, len(columns), window, len(columns)).trace(axis1=1, axis2=3) / len(columns)
        covariance += STRANGE * np.kron(apart, np.eye(len(columns)))
        values, vectors = np.linalg.eigh(covariance)
        values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
        count = int(np.searchsorted(np.cumsum(values), PRIOR_VARIANCE * values.sum())) + 1
        rest = float(values[count:].sum()) / max(len(values) - count, 1)
        return cls(mean, vectors[:, :count], values[:count], rest)

    def posterior(self, windows: Array, noise: Array, local: tuple[Array, Array] | None = None) -> Array:
        """Posterior mean of windows (Q, W P), NaN where nothing is known, with noise variances of the same shape.

        Parameters
        ----------
        local : (ndarray (Q, W P), ndarray (Q, n, n)), optional
            Mean and covariance, the latter in the components, of each window's own prior.
        """
        known = np.isfinite(windows)
        precision = np.where(known, 1.0 / (noise + max(self.rest, NOISE_FLOOR)), 0.0)
        mean, covariance = (self.mean, np.diag(self.variances)[None]) if local is None else local
        offset = np.where(known, windows - mean, 0.0)
        scaled = self.axes.T @ (precision[..., None] * self.axes)
        # (S^-1 + A) z = b as (I + S A) z = S b: S need not be inverted.
        right = covariance @ ((precision * offset) @ self.axes)[..., None]
        found = np.linalg.solve(np.eye(len(self.variances)) + covariance @ scaled, right)[..., 0]
        return mean + found @ self.axes.T


def gathered(rows: Any, starts: Indices, first: int, stop: int) -> Array:
    """Samples ``first`` to ``stop`` of windows that start at rows (Q, K): (Q, K, stop - first, ...)."""
    return np.asarray(rows[starts[..., None] + np.arange(first, stop)])


class LocalFilter:
    """The filter of one database.

    Parameters
    ----------
    database : Windows
    searcher : Searcher
        Over windows of ``window`` frames of the columns.
    window : int
    columns : sequence of int, optional
        Parameters that signals give; by default all that the database knows.
    method : str
        Of :data:`methods`.
    neighbours : int
    kept : float

    Raises
    ------
    EvalkitError
        If the method is not known or numbers make no sense.
    """

    def __init__(
        self,
        database: Windows,
        searcher: Searcher,
        window: int,
        columns: ArrayLike | None = None,
        method: str = DEFAULT_METHOD,
        neighbours: int = NEIGHBOURS,
        kept: float = KEPT_VARIANCE,
    ) -> None:
        if method not in methods:
            raise EvalkitError(f"filter '{method}' is not known; known are {', '.join(methods)}")
        if neighbours < 2:
            raise EvalkitError(f"{neighbours} neighbours make no plane; use 2 or more (the paper: 50 to 150)")
        if not 0 < kept <= 1:
            raise EvalkitError(f"kept variance {kept} is not a share from 0 to 1")
        self.database, self.searcher, self.window = database, searcher, window
        self.columns = np.flatnonzero(database.known) if columns is None else np.asarray(columns, dtype=np.intp)
        self.method, self.count, self.kept = methods[method], neighbours, kept
        self.prior = WindowPrior.of(database, window, self.columns) if self.method.posterior else None

    def __call__(self, windows: Array) -> Array:
        """Filtered windows (Q, W P) of windows (Q, W, P), NaN where nothing is known.

        For a search, what is missing is first held from before, or after; then filled in from what was found, and
        searched for once more.
        """
        flat = windows.reshape(len(windows), -1)
        if self.prior is not None:
            noise = np.repeat(noise_variance(windows)[:, None], windows.shape[1], axis=1).reshape(flat.shape)
            smooth = self.prior.posterior(flat, noise)
            if self.method.weights is None:
                return smooth
            return self.prior.posterior(flat, noise, self._local(flat, smooth, noise))
        found = self._projected(flat, _held(windows).reshape(flat.shape))
        gaps = np.flatnonzero(~np.isfinite(flat).all(axis=1))
        if len(gaps):
            filled = np.where(np.isfinite(flat[gaps]), flat[gaps], found[gaps])
            found[gaps] = self._projected(flat[gaps], filled)
        return found

    def _near(self, queries: Array) -> tuple[Array, Array]:
        """Neighbours (Q, K, W P) and their weights."""
        distances, starts = self.searcher.nearest(queries, self.count)
        rows = gathered(self.database.parameters, starts, 0, self.window)[..., self.columns]
        assert self.method.weights is not None
        return rows.reshape(*starts.shape, -1).astype(np.float64), self.method.weights(distances)

    def _projected(self, windows: Array, queries: Array) -> Array:
        neighbours, weights = self._near(queries)
        onto = on_plane(local_plane(neighbours, weights, self.kept), neighbours, windows)
        return (onto[:, None] @ neighbours)[:, 0]

    def _local(self, windows: Array, smooth: Array, noise: Array) -> tuple[Array, Array]:
        """Prior of each window: its neighbours', and that of all as far as it is further from them than noise says."""
        assert self.prior is not None
        neighbours, weights = self._near(smooth)
        onto = on_plane(local_plane(neighbours, weights, self.kept), neighbours, windows)
        mean = (weights[:, None] @ neighbours)[:, 0]
        inside = (neighbours - mean[:, None]) @ self.prior.axes
        covariance = inside.transpose(0, 2, 1) @ (weights[..., None] * inside)
        off = np.nanmean((windows - (onto[:, None] @ neighbours)[:, 0]) ** 2 - noise, axis=1)
        scale = np.maximum(off, NOISE_FLOOR) / (self.prior.variances.sum() / windows.shape[1])
        return mean, covariance + scale[:, None, None] * np.diag(self.prior.variances)


def filter_parameters(signal: ArrayLike, local: LocalFilter, layout: Layout) -> tuple[Array, NDArray[np.int8]]:
    """A whole signal through the filter.

    Parameters
    ----------
    signal : array_like, shape (F, 15)
        Normalised parameters, NaN where nothing is known.
    local : LocalFilter
    layout : Layout
        With the filter's window.

    Returns
    -------
    parameters : ndarray, shape (F, 15)
        Filtered; NaN in columns that the filter does not have, and in lost frames.
    status : ndarray of int8, shape (F,)
        :class:`~evalkit.control.signal_windows.SignalStatus`.

    Raises
    ------
    EvalkitError
        If the signal has another number of columns than the database or no frame of it is known.
    """
    rows = checked_signal(signal, len(local.database.known))

    def answer(windows: Array) -> Array:
        found = local(windows).reshape(windows.shape)
        return found[:, layout.window - layout.samples :]

    values, status = over_windows(rows[:, local.columns], layout, answer)
    out = np.full(rows.shape, np.nan)
    out[:, local.columns] = values
    return out, status


def checked_signal(signal: ArrayLike, columns: int) -> Array:
    """The signal as (F, columns) numbers.

    Raises
    ------
    EvalkitError
        If it is not that.
    """
    rows = np.asarray(signal, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != columns:
        raise EvalkitError(f"the signal has shape {rows.shape}; expected (frames, {columns}), one column a parameter")
    if not len(rows):
        raise EvalkitError("the signal has no frames")
    return rows


def _held(windows: Array) -> Array:
    """Windows (Q, W, P) with the value before, else the one after, else 0 (the neutral) where there is none."""
    for order in (slice(None), slice(None, None, -1)):
        turned = windows[:, order]
        known = np.isfinite(turned)
        last = np.maximum.accumulate(np.where(known, np.arange(turned.shape[1])[:, None], 0), axis=1)
        windows = np.take_along_axis(turned, last, axis=1)[:, order]
    return np.nan_to_num(windows)
