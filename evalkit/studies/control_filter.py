"""The data-driven filter of control parameters against filters that know no database.

Question: how much nearer to the truth does a database bring noisy control parameters, and what does it take away from
expressions that it does not have?

Finding: in the database every one of its filters meets the aim of half of the error; outside it local PCA, the paper's
filter, does not, and the posterior mean does on the same performer, though not on a real take of other movements. One
seed, MakeHuman's head, five minutes at 60 Hz; errors in spreads under Gaussian noise of 0.1 / 0.3 / 1.0. In the
database: local PCA 0.028 / 0.077 / 0.25, posterior mean 0.045 / 0.10 / 0.25, with a local prior 0.030 / 0.077 / 0.21,
Savitzky-Golay 0.063 / 0.16 / 0.53. Another performance: local PCA 0.11 / 0.14 / 0.29, posterior mean 0.048 / 0.11 /
0.26. Emotions that the database does not have: 0.26 / 0.27 / 0.34 and 0.048 / 0.10 / 0.25. A clean signal shows the
bias: local PCA 0.015, 0.11 and 0.26 in the three, posterior mean at most 0.022, PCA of all windows at most 0.058.
Weighing the neighbours by distance changes nothing. Drift of 0.3 no filter halves: local PCA 0.19 in the database and
0.22 held out, posterior mean 0.30 and 0.32, since smooth errors pass for motion. Outliers are where it gains most (held
out 0.62 to 0.12). From a real take of the jaw to one of the cheeks, which is far outside, local PCA takes the
expression away (0.89 even of a clean signal) and the posterior mean brings next to nothing (0.08 / 0.31 / 0.93); there
a moving average is best (0.05 / 0.10 / 0.34).

Command: ``evalkit study run filter --budget full --seeds 1``, the real takes with ``EVALKIT_REAL_DATA`` set
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from evalkit.control.filtering import LocalFilter, WindowPrior, filter_parameters, methods
from evalkit.control.search import DEFAULT, searchers
from evalkit.control.signal_windows import Layout, over_windows
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.seeds import generator
from evalkit.studies.control_examples import MOTIONS, Examples, examples, motions_here
from evalkit.studies.takes import told
from evalkit.study.command import script
from evalkit.study.description import Budget, Condition, Expected, Scalar, Study
from evalkit.study.statistics import mean

NONE = "held"
"""The signal as it is; where it is lost, the last value."""

LAYOUT = Layout()

CLEAN, USUAL = 0.0, 0.3
"""Levels of noise, in spreads: none, which shows a filter's own bias, and that of kinds other than Gaussian."""

DRIFT_S = 0.5
"""Time after which drift has forgotten where it was."""

OUTLIERS, OUTLIER_LEVEL = 0.03, 10.0
"""Share of samples that are outliers, and their standard deviation over the noise's."""

LOST_FRAMES, LOST_RUN, LOST_SAMPLES = 0.08, 3.0, 0.05
"""Share of lost frames and mean length of their runs; share of single parameters that are missing besides."""


@dataclass(frozen=True, eq=False)
class Noisy:
    """A signal with noise, and what it is filtered with."""

    data: Examples
    signal: Array

    @property
    def columns(self) -> Any:
        """Parameters that count."""
        return np.flatnonzero(self.data.known)


def conditions(axes: Mapping[str, tuple[Scalar, ...]]) -> Iterator[Condition]:
    """Gaussian noise of all levels; the other kinds at the usual one, or at the last there is."""
    fixed = {axis: axes[axis][0] for axis in ("head", "rows", "frames")}
    for motion in motions_here(axes["motion"]):
        for kind in axes["kind"]:
            levels = axes["level"]
            if kind != "gaussian":
                levels = (CLEAN,) if kind == "clean" else (USUAL,) if USUAL in levels else levels[-1:]
            for level in levels:
                yield {"motion": motion, "kind": kind, "level": level, **fixed}


def prepare(seed: int, motion: str, kind: str, level: float, head: str, rows: int, frames: int) -> Noisy:
    """Signal and database of a cell."""
    data = examples(motion, seed, head, rows, frames)
    random = generator("filter", motion, kind, level, seed=seed)
    noise = level * random.standard_normal(data.signal.shape)
    if kind == "drift":
        kept = np.exp(-1.0 / (DRIFT_S * data.rate_hz))
        # White noise through one pole, scaled to the level it has in the long run.
        from scipy.signal import lfilter

        first = noise[:1] * kept
        noise = lfilter([np.sqrt(1.0 - kept**2)], [1.0, -kept], noise, axis=0, zi=first)[0]
    elif kind == "outliers":
        noise += (random.random(noise.shape) < OUTLIERS) * OUTLIER_LEVEL * level * random.standard_normal(noise.shape)
    signal = data.signal + noise
    if kind == "dropouts":
        signal[random.random(signal.shape) < LOST_SAMPLES] = np.nan
        begins = np.flatnonzero(random.random(len(signal)) < LOST_FRAMES / LOST_RUN)
        for begin, length in zip(begins, random.geometric(1.0 / LOST_RUN, len(begins)), strict=True):
            signal[begin : begin + length] = np.nan
    return Noisy(data, signal)


def run(noisy: Noisy, method: str) -> Array:
    """Filtered parameters (F, 15)."""
    if method in BASELINES:
        return BASELINES[method](noisy)
    window = LAYOUT.window
    columns = noisy.columns
    searcher = searchers[DEFAULT](noisy.data.parameters[:, columns], noisy.data.segments, window)
    local = LocalFilter(noisy.data, searcher, window, columns, method)
    return filter_parameters(noisy.signal, local, LAYOUT)[0]


def _held(noisy: Noisy) -> Array:
    known = np.isfinite(noisy.signal)
    last = np.maximum.accumulate(np.where(known, np.arange(len(known))[:, None], 0), axis=0)
    return np.take_along_axis(noisy.signal, last, axis=0)


def _interpolated(noisy: Noisy) -> Array:
    frames = np.arange(len(noisy.signal))
    out = noisy.signal.copy()
    for column in out.T:
        known = np.isfinite(column)
        column[~known] = np.interp(frames[~known], frames[known], column[known])
    return out


def _moving_average(noisy: Noisy) -> Array:
    from scipy.ndimage import uniform_filter1d

    return np.asarray(uniform_filter1d(_interpolated(noisy), 2 * LAYOUT.latency + 1, axis=0, mode="nearest"))


def _savitzky_golay(noisy: Noisy) -> Array:
    from scipy.signal import savgol_filter

    return np.asarray(savgol_filter(_interpolated(noisy), 2 * LAYOUT.latency + 1, 2, axis=0, mode="nearest"))


def _global_pca(noisy: Noisy) -> Array:
    columns = noisy.columns
    prior = WindowPrior.of(noisy.data, LAYOUT.window, columns)
    kept = int(np.searchsorted(np.cumsum(prior.variances), 0.99 * prior.variances.sum())) + 1
    axes = prior.axes[:, :kept]

    def answer(windows: Array) -> Array:
        flat = windows.reshape(len(windows), -1)
        onto = prior.mean + (flat - prior.mean) @ axes @ axes.T
        return onto.reshape(windows.shape)[:, -LAYOUT.samples :]

    out = np.zeros(noisy.signal.shape)
    out[:, columns] = over_windows(_interpolated(noisy)[:, columns], LAYOUT, answer)[0]
    return out


BASELINES = {
    NONE: _held,
    "moving average": _moving_average,
    "savitzky-golay": _savitzky_golay,
    "global pca": _global_pca,
}
"""Filters that need no neighbours; they wait as long as the others do, gaps bridged in a straight line first."""


def score(noisy: Noisy, found: Array) -> dict[str, Any]:
    """Errors of the parameters that count, in frames that were not given up.

    Raises
    ------
    EvalkitError
        If no frame has an answer.
    """
    columns = noisy.columns
    true, errors = noisy.data.signal[:, columns], (found - noisy.data.signal)[:, columns]
    given = np.isfinite(errors).all(axis=1)
    if not given.any():
        raise EvalkitError("no frame has an answer")
    squares = float((errors[given] ** 2).mean())
    power = float(((true - true.mean(axis=0)) ** 2).mean())
    speed = np.diff(true, axis=0).std()
    own = float(((_held(noisy) - noisy.data.signal)[:, columns][given] ** 2).mean())
    return {
        "error": squares**0.5,
        "ratio": (squares / own) ** 0.5 if own > 0 else None,
        "snr_db": 10.0 * np.log10(power / squares) if squares > 0 else None,
        "offset": float(np.abs(errors[given].mean(axis=0)).mean()),
        "size": float(np.std(found[given][:, columns]) / np.std(true[given])),
        "jitter": float(np.diff(errors[given], axis=0).std() / speed),
        "lost": float(1.0 - given.mean()),
    }


QUESTION, FINDING = told(__doc__)

study = Study(
    name="filter",
    question=QUESTION,
    finding=FINDING,
    axes={
        "motion": MOTIONS,
        "kind": ("clean", "gaussian", "drift", "outliers", "dropouts"),
        "level": (0.1, 0.3, 1.0),
        "head": ("",),
        "rows": (18_000,),
        "frames": (300,),
    },
    methods=(*BASELINES, *methods),
    prepare=prepare,
    run=run,
    score=score,
    columns={
        "error": "rms error of the parameters that signal and database know, in spreads of the database",
        "ratio": "error over that of the signal as it is, its last value held where it is lost, in the same frames; "
        "empty for a clean signal",
        "snr_db": "10 log10 of the variance of the true signal over the mean squared error; empty if there is no error",
        "offset": "mean over the parameters of the absolute mean error, in spreads",
        "size": "standard deviation of what comes out over that of the true signal",
        "jitter": "standard deviation of the errors' change from frame to frame over that of the true signal",
        "lost": "share of frames that have no answer",
    },
    statistics=(
        mean("error", "error", "spreads"),
        mean("ratio", "error over the signal's own", ""),
        mean("snr_db", "signal to noise", "dB", less=False),
        mean("offset", "offset", "spreads"),
        mean("size", "size", "", less=None),
        mean("jitter", "jitter", ""),
        mean("lost", "lost", ""),
    ),
    full=Budget(seeds=2),
    small=Budget(
        seeds=1,
        axes={
            "motion": ("in database", "unseen"),
            "kind": ("clean", "gaussian"),
            "level": (0.3,),
            "head": ("template",),
            "rows": (3600,),
            "frames": (90,),
        },
        methods=(NONE, "savitzky-golay", "global pca", "projection", "posterior", "local posterior"),
    ),
    conditions=conditions,
    expected=tuple(
        Expected("error over the signal's own", method, 0.5, where={"motion": "in database", "kind": "gaussian"})
        for method in ("posterior", "local posterior", "projection")
    ),
)

if __name__ == "__main__":
    script(study)
