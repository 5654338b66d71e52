"""Synthesis: markers move as they did in the windows of the database that are most like the control signal.

Section 5.3 of Chai, Xiao & Hodgins (2003), doi:10.2312/SCA03/193-206: the motions of the nearest windows are combined,
weighted by distance, and consecutive windows are blended (:class:`~evalkit.control.signal_windows.Layout`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.control.filtering import Searcher, Windows, checked_signal, even, gathered, local_plane, on_plane
from evalkit.control.signal_windows import Layout, over_windows
from evalkit.errors import EvalkitError
from evalkit.geometry import Array

EXAMPLES = 30
"""Nearest windows whose motions are combined."""


MAP_ROWS = 20_000
"""Frames that the linear map is fitted to at most: a thousand times as many as it has parameters."""


MAP_RIDGE = 1e-2
"""Ridge over the mean variance of the parameters. Held-out performances of one head are 0.66 mm off by the map alone,
with 1e-3 0.69 and with 0.1 0.79."""

MAP_SHARE = 0.999
"""Share of the database that counts as what it covers. Without a limit, a map learnt on a real take of a jaw was 9.7 mm
off on one of cheeks, whose face at rest is 6.3 mm off."""


class Motions(Windows, Protocol):
    """What the synthesis needs of a :class:`~evalkit.control.database.Database`."""

    @property
    def motions(self) -> Any:
        """(N, M, 3), mm."""


class Synthesiser(NamedTuple):
    """A way to weigh examples.

    Attributes
    ----------
    text : str
    weights : callable
        From windows (Q, D) and their examples (Q, K, D) to weights (Q, K) that add up to 1.
    corrected : bool
        What the combination of the examples' parameters leaves of the window's is not dropped: it moves the markers by
        the linear map from parameters to motion that fits the whole database best.
    """

    text: str
    weights: Callable[[Array, Array], Array]
    corrected: bool = False


def _distances(windows: Array, examples: Array) -> Array:
    return np.sqrt(((examples - windows[:, None]) ** 2).sum(axis=2))


def _inverse_distance(windows: Array, examples: Array) -> Array:
    distances = _distances(windows, examples)
    # An example that is hit exactly: nearer than a millionth of the furthest is no different from it.
    near = np.maximum(distances, np.maximum(1e-6 * distances.max(axis=1, keepdims=True), np.finfo(float).tiny))
    weights = 1.0 / near - 1.0 / near.max(axis=1, keepdims=True)
    total = weights.sum(axis=1, keepdims=True)
    # All at one distance (or a single example): they weigh alike.
    return np.where(total > 0, weights / np.where(total > 0, total, 1.0), 1.0 / weights.shape[1])


def _gaussian(windows: Array, examples: Array) -> Array:
    distances = _distances(windows, examples)
    width = np.maximum(distances.mean(axis=1, keepdims=True) / 2.0, np.finfo(float).tiny)
    # The nearest one's is taken off first, so that far from all examples not all weights are 0.
    weights = np.exp(-0.5 * (distances**2 - distances.min(axis=1, keepdims=True) ** 2) / width**2)
    return weights / weights.sum(axis=1, keepdims=True)


def _local_components(windows: Array, examples: Array) -> Array:
    plane = local_plane(examples, even(_distances(windows, examples)))
    return on_plane(plane, examples, windows)


def _nearest(windows: Array, examples: Array) -> Array:
    weights = np.zeros(examples.shape[:2])
    np.put_along_axis(weights, _distances(windows, examples).argmin(axis=1)[:, None], 1.0, axis=1)
    return weights


synthesisers: dict[str, Synthesiser] = {
    "inverse distance": Synthesiser("1/d - 1/d_K, over their sum: the furthest example has none", _inverse_distance),
    "gaussian weights": Synthesiser("exp(-d²/2s²) over their sum, s half the mean distance", _gaussian),
    "local components": Synthesiser(
        "linear regression of the motion on the principal components of the examples' parameters", _local_components
    ),
    "nearest": Synthesiser("the nearest example alone", _nearest),
    "corrected inverse distance": Synthesiser(
        "1/d - 1/d_K, and what that leaves of the parameters by one linear map", _inverse_distance, True
    ),
    "corrected local components": Synthesiser(
        "local components, and what that leaves of the parameters by one linear map", _local_components, True
    ),
}
"""Name -> a way to weigh examples. The notes on the paper say no more of its weights than that they follow from the
distances; ``inverse distance`` is what Allen, Curless & Popovic (2002), doi:10.1145/566654.566626, use for K nearest
examples, and stands for the paper here."""

DEFAULT_SYNTHESISER = "corrected inverse distance"


class Synthesis:
    """The synthesis of one database.

    Parameters
    ----------
    database : Motions
    searcher : Searcher
        Over windows of ``window`` frames of the columns.
    window : int
    columns : sequence of int, optional
        Parameters that signals give; by default all that the database knows.
    synthesiser : str
        Of :data:`synthesisers`.
    examples : int

    Raises
    ------
    EvalkitError
        If the synthesiser is not known or there are no examples.
    """

    def __init__(
        self,
        database: Motions,
        searcher: Searcher,
        window: int,
        columns: ArrayLike | None = None,
        synthesiser: str = DEFAULT_SYNTHESISER,
        examples: int = EXAMPLES,
    ) -> None:
        if synthesiser not in synthesisers:
            raise EvalkitError(f"synthesiser '{synthesiser}' is not known; known are {', '.join(synthesisers)}")
        if examples < 1:
            raise EvalkitError(f"{examples} examples make no motion; use 1 or more")
        self.database, self.searcher, self.window, self.examples = database, searcher, window, examples
        self.columns = np.flatnonzero(database.known) if columns is None else np.asarray(columns, dtype=np.intp)
        self.weights = synthesisers[synthesiser].weights
        self.map = linear_map(database, self.columns) if synthesisers[synthesiser].corrected else None

    def __call__(self, windows: Array, samples: int) -> Array:
        """Marker displacements (Q, samples, 3 M) in the last samples of windows (Q, W P), mm."""
        starts = self.searcher.nearest(windows, self.examples)[1]
        near = gathered(self.database.parameters, starts, 0, self.window)[..., self.columns]
        points = near.reshape(*starts.shape, -1).astype(np.float64)
        weights = self.weights(windows, points)
        moved = gathered(self.database.motions, starts, self.window - samples, self.window)
        flat = moved.reshape(*starts.shape, -1)
        motion = (weights[:, None].astype(flat.dtype) @ flat).reshape(len(starts), samples, -1)
        if self.map is None:
            return motion
        shape = (len(windows), self.window, -1)
        combined = (weights[:, None] @ points).reshape(shape)[:, -samples:]
        return motion + (self.map.within(windows.reshape(shape)[:, -samples:]) - combined) @ self.map.matrix


@dataclass(frozen=True, eq=False)
class LinearMap:
    """Linear map from parameters to marker displacements, and how far it is known to hold.

    Attributes
    ----------
    mean : ndarray, shape (P,)
        Of the parameters.
    matrix : ndarray, shape (P, 3 M)
        Displacements, mm, for a difference from the mean.
    precision : ndarray, shape (P, P)
        Inverse covariance of the parameters, with the ridge.
    limit : float
        Mahalanobis distance from the mean within which :data:`MAP_SHARE` of the database lies.
    """

    mean: Array
    matrix: Array
    precision: Array
    limit: float

    def within(self, parameters: Array) -> Array:
        """Parameters (..., P), those further out than the database moved towards the mean until they are not.

        A line that is followed beyond its data says anything: markers would fly off the face.
        """
        off = parameters - self.mean
        distance = np.sqrt(((off @ self.precision) * off).sum(axis=-1, keepdims=True))
        return self.mean + off * (self.limit / np.maximum(distance, self.limit))


def linear_map(database: Motions, columns: NDArray[np.intp]) -> LinearMap:
    """The map that fits a database's frames best, by ridge regression: parameters that always move together share."""
    rows = np.unique(np.linspace(0, len(database.parameters) - 1, MAP_ROWS).astype(np.intp))
    x = np.asarray(database.parameters[rows][:, columns], dtype=np.float64)
    y = np.asarray(database.motions[rows], dtype=np.float64).reshape(len(rows), -1)
    mean = x.mean(axis=0)
    x, y = x - mean, y - y.mean(axis=0)
    covariance = x.T @ x / len(x)
    ridge = MAP_RIDGE * np.trace(covariance) / len(covariance) + np.finfo(float).tiny ** 0.5
    precision = np.linalg.inv(covariance + ridge * np.eye(len(covariance)))
    distances = np.sqrt(((x @ precision) * x).sum(axis=1))
    limit = max(float(np.quantile(distances, MAP_SHARE)), np.finfo(float).tiny)
    return LinearMap(mean, precision @ (x.T @ y) / len(x), precision, limit)


def synthesise(signal: ArrayLike, synthesis: Synthesis, layout: Layout) -> tuple[Array, NDArray[np.int8]]:
    """Marker displacements of a signal that needs no filter.

    Parameters
    ----------
    signal : array_like, shape (F, 15)
        Normalised parameters. Frames in which one of the columns is not known are lost: only the filter fills in.
    synthesis : Synthesis
    layout : Layout
        With the synthesis's window.

    Returns
    -------
    displacements : ndarray, shape (F, M, 3), mm
        From the performer's rest, in the database's axes; NaN in lost frames.
    status : ndarray of int8, shape (F,)
        :class:`~evalkit.control.signal_windows.SignalStatus`.

    Raises
    ------
    EvalkitError
        If the signal has another number of columns than the database, or no frame of it is known.
    """
    rows = checked_signal(signal, len(synthesis.database.known))[:, synthesis.columns]
    rows = np.where(np.isfinite(rows).all(axis=1, keepdims=True), rows, np.nan)

    def answer(windows: Array) -> Array:
        return synthesis(windows.reshape(len(windows), -1), layout.samples)

    # A window that reached over a lost frame would have a hole.
    values, status = over_windows(rows, replace(layout, bridge=0), answer)
    return values.reshape(len(values), -1, 3), status
