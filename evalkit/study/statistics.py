"""Statistics over seeds, each with a bootstrap interval."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evalkit.geometry import Array
from evalkit.seeds import generator

RESAMPLES = 2000
"""Bootstrap draws; the ends of a 95 % interval then vary by some 3 % of its width."""


@dataclass(frozen=True)
class Statistic:
    """A number made of columns over the seeds of one condition and method.

    Attributes
    ----------
    name, unit : str
    text : str
        Its formula in words.
    columns : tuple of str
    formula : callable
        From the columns (..., N, K) over N seeds to the statistic (...).
    against : str
        A method whose same columns, of the same seeds, are appended to this one's: K doubles.
    less : bool or None
        Whether less is better; None where neither is.
    """

    name: str
    unit: str
    text: str
    columns: tuple[str, ...]
    formula: Callable[[Array], Array]
    against: str = ""
    less: bool | None = True


def _root(x: Array) -> Array:
    return np.asarray(np.sqrt((x[..., 0] ** 2).mean(axis=-1)))


def _mean(x: Array) -> Array:
    return np.asarray(x[..., 0].mean(axis=-1))


def _median(x: Array) -> Array:
    return np.asarray(np.median(x[..., 0], axis=-1))


def _largest(x: Array) -> Array:
    return np.asarray(x[..., 0].max(axis=-1))


def _ratio_of_roots(x: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.sqrt((x[..., 0] ** 2).mean(axis=-1) / (x[..., 1] ** 2).mean(axis=-1)))


def _efficiency(x: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((x[..., 1] ** 2).mean(axis=-1) / (x[..., 0] ** 2).mean(axis=-1))


def _reciprocal(x: Array) -> Array:
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / x[..., 0].mean(axis=-1))


def root_mean_square(column: str, name: str, unit: str) -> Statistic:
    """``sqrt(mean x²)`` over the seeds."""
    return Statistic(name, unit, f"root mean square of {column}", (column,), _root)


def mean(column: str, name: str, unit: str, less: bool | None = True) -> Statistic:
    """``mean x`` over the seeds; of a column of 0 and 1, a share."""
    return Statistic(name, unit, f"mean of {column}", (column,), _mean, less=less)


def median(column: str, name: str, unit: str, less: bool | None = True) -> Statistic:
    """Median over the seeds, for columns with a long tail."""
    return Statistic(name, unit, f"median of {column}", (column,), _median, less=less)


def largest(column: str, name: str, unit: str) -> Statistic:
    """The worst seed. Its interval is only that of the seeds drawn."""
    return Statistic(name, unit, f"largest {column}", (column,), _largest)


def error_over_bound(error: str, bound: str, name: str = "error over bound") -> Statistic:
    """``sqrt(mean error² / mean bound²)``: 1 is as good as any unbiased estimator can be."""
    return Statistic(name, "", f"rms {error} over rms {bound}", (error, bound), _ratio_of_roots)


def efficiency(error: str, bound: str, name: str = "efficiency") -> Statistic:
    """``mean bound² / mean error²``, bound² the trace of the Cramér-Rao bound; 1 is the best an unbiased one can do."""
    text = f"mean squared {bound} over mean squared {error}"
    return Statistic(name, "", text, (error, bound), _efficiency, less=False)


def efficiency_of_form(form: str, name: str = "efficiency") -> Statistic:
    """``1 / mean(e' B^-1 e / d)``, B the bound and d its size: the efficiency in the bound's own metric."""
    return Statistic(name, "", f"reciprocal of the mean of {form}", (form,), _reciprocal, less=False)


def relative_to(column: str, method: str, name: str) -> Statistic:
    """Rms of a column over that of another method on the same takes."""
    text = f"rms {column} over that of {method} on the same takes"
    return Statistic(name, "", text, (column,), _ratio_of_roots, against=method)


def with_interval(statistic: Statistic, columns: Array) -> tuple[float, float, float, float]:
    """A statistic with its bootstrap 95 % interval and standard error over the seeds.

    Parameters
    ----------
    statistic : Statistic
    columns : ndarray, shape (N, K)
        One row per seed, finite.

    Returns
    -------
    (float, float, float, float)
        Statistic, lower and upper end, standard error; the last three NaN with fewer than two seeds, all NaN with none.

    References
    ----------
    Efron & Tibshirani, "An introduction to the bootstrap" (1993), chapter 13: the percentile interval.
    """
    nothing = float("nan")
    if not len(columns):
        return nothing, nothing, nothing, nothing
    value = float(statistic.formula(columns))
    if len(columns) < 2:
        return value, nothing, nothing, nothing
    random = generator("figure", "bootstrap", len(columns))
    drawn = statistic.formula(columns[random.integers(0, len(columns), (RESAMPLES, len(columns)))])
    with np.errstate(invalid="ignore"):
        low, high = np.quantile(drawn, [0.025, 0.975])
        return value, float(low), float(high), float(drawn.std())
