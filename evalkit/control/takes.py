"""A take as a database keeps it: control parameters and marker displacements of every frame, in unbroken segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evalkit.animation.gaps import SHORT_GAP_S, fill_gaps, spikes
from evalkit.capture import Capture, read_capture
from evalkit.capture.rigid import choose_rigid
from evalkit.compensation import compensate
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.vision.markers import frontal_markers
from evalkit.vision.parameters import PARAMETERS, SMALLEST_LENGTH, neutral_parameters, normalise

SHORTEST_S = 0.5
"""Runs of unbroken motion that are shorter are left out: a window of motion would hardly fit into one."""

REST_SHARE, FEWEST_REST = 0.02, 10
"""Share and least number of the frames whose median is the rest, where it has to be found."""


@dataclass(frozen=True)
class TakeOptions:
    """How captures become takes of a database; the same for all takes of one.

    Attributes
    ----------
    labels : tuple of str
        Markers that are kept; empty keeps those of the first take.
    rate_hz : float
        Frames a second; 0 keeps that of the first take. Other takes are resampled, linearly.
    gap_s : float
        Longest gap of a marker that is bridged in a straight line, s; longer ones end a segment.
    shortest_s : float
        Shortest segment that is kept, s.
    neutral_s : float
        The face is at rest for so long at the beginning of every capture, s; at 0 the rest is found.
    """

    labels: tuple[str, ...] = ()
    rate_hz: float = 0.0
    gap_s: float = SHORT_GAP_S
    shortest_s: float = SHORTEST_S
    neutral_s: float = 0.0


@dataclass(frozen=True, eq=False)
class DatabaseTake:
    """What a database keeps of a take.

    Attributes
    ----------
    name : str
    labels : tuple of str, length M
    rate_hz, own_rate_hz : float
        Of the rows here, and of the capture.
    frames : int
        Of the capture.
    neutral : ndarray, shape (15,)
        Neutral control parameters; NaN where the markers do not give a parameter, or its neutral is too small for a
        ratio.
    rest_mm : ndarray, shape (M, 3)
        The face at rest in frontal axes (x to the performer's left, y up, z forward), from the mean of its rigid
        markers.
    changes : ndarray of float32, shape (N, 15)
        Control parameters against the neutral, without a spread; 0 where not known.
    motions : ndarray of float32, shape (N, M, 3), mm
        Displacement of every marker from its rest, frontal axes.
    segments : ndarray of int, shape (S, 2)
        Rows [start, stop) of unbroken motion; together they are all rows.
    rigid : tuple of str
        Markers from whose mean the rest is counted.
    bridged : float
        Share of the marker samples of these rows that stand for missing ones.
    warnings : list of str
    """

    name: str
    labels: tuple[str, ...]
    rate_hz: float
    own_rate_hz: float
    frames: int
    neutral: Array
    rest_mm: Array
    changes: NDArray[np.float32]
    motions: NDArray[np.float32]
    segments: NDArray[np.int64]
    rigid: tuple[str, ...]
    bridged: float
    warnings: list[str] = field(default_factory=list)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Parameters that the take gives, shape (15,)."""
        return np.isfinite(self.neutral)


def database_take(
    capture: Capture | str | Path,
    name: str,
    options: TakeOptions,
    compensated: bool = False,
    rigid: str | Sequence[str] = "auto",
) -> DatabaseTake:
    """Prepare a capture for a database.

    Head motion is undone first; each frame's markers are turned to the frontal view, where they give the control
    parameters as a video's points do (:func:`evalkit.vision.markers.frontal_markers`). The same frames give the rest
    and the neutral parameters, so that both mean the same face: those of the beginning, if it is at rest then, or those
    nearest to where the parameters dwell. Samples that jump by more than skin does count as missing.

    Parameters
    ----------
    capture : Capture or path
    name : str
        For messages.
    options : TakeOptions
    compensated : bool
        The capture has no head motion any more.
    rigid : "auto" or sequence of str
        Markers over bone, as of :func:`evalkit.compensate`.

    Returns
    -------
    DatabaseTake

    Raises
    ------
    EvalkitError
        If the capture cannot be read or compensated, lacks a marker, shows fewer than four face points, or has no
        stretch of motion in which all markers are seen.
    """
    # Readers name the file by themselves.
    take = read_capture(capture) if isinstance(capture, str | Path) else capture
    try:
        return _prepared(take, name, options, compensated, rigid)
    except EvalkitError as error:
        raise EvalkitError(f"{name}: {error}") from error


def _prepared(
    take: Capture, name: str, options: TakeOptions, compensated: bool, rigid: str | Sequence[str]
) -> DatabaseTake:
    if compensated:
        bone = choose_rigid(take, rigid).labels
    else:
        result = compensate(take, rigid)
        # All markers count where skin motion is modelled, each with its weight; the light ones are no bone.
        bone = [label for label, w in zip(result.rigid, result.chosen.weights, strict=True) if w >= 0.1]
        take = result.capture
    labels = options.labels or tuple(
        label for label, what in zip(take.labels, take.quantities, strict=True) if what == "position"
    )
    missing = [label for label in labels if label not in take.labels]
    if missing:
        raise EvalkitError(
            f"no marker '{missing[0]}', which the database has{_more(missing)}; name the common ones with --markers"
        )
    rate_hz = options.rate_hz or take.rate
    face = frontal_markers(take)
    points = _resampled(take.points[:, take.indices(labels)] @ face.rotation.T, take.rate, rate_hz)
    seen = np.isfinite(points[:, :, 0])
    never = [label for k, label in enumerate(labels) if not seen[:, k].any()]
    if never:
        raise EvalkitError(f"marker '{never[0]}' is never seen{_more(never)}; leave it out with --markers")
    points[_jumps(points, seen, rate_hz)] = np.nan
    points, usable, bridged = _bridged(points, rate_hz, options.gap_s)
    segments = _segments(usable, max(round(options.shortest_s * rate_hz), 1))
    if not len(segments):
        raise EvalkitError(
            f"no {options.shortest_s:g} s of motion in which all {len(labels)} markers are seen; leave out the ones "
            "that are often missing with --markers"
        )
    rows = np.concatenate([np.arange(start, stop) for start, stop in segments])
    points = points[rows]
    parameters = frontal_markers(Capture(points @ face.rotation, labels, rate_hz)).parameters
    calm = _calm(parameters, rows / rate_hz, options.neutral_s)
    neutral, rest = _neutral(parameters, calm), np.median(points[calm], axis=0)
    known = np.isfinite(neutral)
    changes = np.zeros_like(parameters)
    changes[:, known] = normalise(parameters, neutral)[:, known]
    stops = np.cumsum(segments[:, 1] - segments[:, 0])
    origin = rest[[labels.index(label) for label in bone if label in labels] or slice(None)].mean(axis=0)
    lost = 1.0 - len(rows) / len(usable)
    return DatabaseTake(
        name=name,
        labels=tuple(labels),
        rate_hz=rate_hz,
        own_rate_hz=take.rate,
        frames=take.frames,
        neutral=neutral,
        rest_mm=rest - origin,
        changes=changes.astype(np.float32),
        motions=(points - rest).astype(np.float32),
        segments=np.column_stack([np.concatenate([[0], stops[:-1]]), stops]).astype(np.int64),
        rigid=tuple(label for label in bone if label in labels),
        bridged=float(bridged[rows].mean()),
        warnings=[f"{100 * lost:.0f} % of the frames are left out: markers are missing in them"] if lost > 0.2 else [],
    )


def _more(labels: Sequence[str]) -> str:
    return f" (and {len(labels) - 1} more)" if len(labels) > 1 else ""


def _resampled(points: Array, own_hz: float, rate_hz: float) -> Array:
    """Points at another rate, in straight lines between frames; a missing sample on either side gives a missing one."""
    if own_hz == rate_hz:
        return points
    at = np.arange(int((len(points) - 1) * rate_hz / own_hz + 1e-9) + 1) * (own_hz / rate_hz)
    before = np.minimum(at.astype(np.int64), len(points) - 1)
    after = np.minimum(before + 1, len(points) - 1)
    share = (at - before)[:, None, None]
    # A frame that is hit exactly does not need the next one.
    return np.where(share < 1e-9, points[before], (1.0 - share) * points[before] + share * points[after])


def _jumps(points: Array, seen: NDArray[np.bool_], rate_hz: float) -> NDArray[np.bool_]:
    """Samples (F, M) that are seen where no skin can be."""
    return np.asarray(spikes(fill_gaps(points, rate_hz, "interpolate").values, rate_hz) & seen)


def _bridged(points: Array, rate_hz: float, gap_s: float) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Points with short gaps bridged, frames (F,) without any other gap, and the samples (F, M) that are bridges."""
    missing = ~np.isfinite(points[:, :, 0])
    bridged = missing & _no_longer(missing, round(gap_s * rate_hz))
    values = np.where(bridged[:, :, None], fill_gaps(points, rate_hz, "interpolate").values, points)
    return values, np.asarray((~missing | bridged).all(axis=1)), bridged


def _no_longer(missing: NDArray[np.bool_], most: int) -> NDArray[np.bool_]:
    """Which samples (F, M) lie in runs of at most so many, with something known on both sides."""
    frames = np.arange(len(missing))[:, None]
    before = np.maximum.accumulate(np.where(missing, -1, frames), axis=0)
    after = np.minimum.accumulate(np.where(missing, len(missing), frames)[::-1], axis=0)[::-1]
    return np.asarray((after - before - 1 <= most) & (before >= 0) & (after < len(missing)))


def _segments(usable: NDArray[np.bool_], shortest: int) -> NDArray[np.int64]:
    """Runs [start, stop) of usable frames, without the short ones."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], usable, [False]]).astype(np.int8)))
    runs = edges.reshape(-1, 2)
    return runs[runs[:, 1] - runs[:, 0] >= shortest].astype(np.int64)


def _calm(parameters: Array, times_s: Array, neutral_s: float) -> NDArray[np.int64]:
    """Rows in which the face is at rest."""
    if neutral_s:
        found = np.flatnonzero(times_s < neutral_s)
        if not len(found):
            raise EvalkitError(f"no frame of its first {neutral_s:g} s shows all markers; the rest is not known")
        return found
    # Parameter by parameter where a face dwells; then the frames that are near to it in all of them at once.
    known = np.isfinite(parameters).all(axis=0)
    away = parameters[:, known] - neutral_parameters(parameters)[known]
    away /= np.maximum(away.std(axis=0), 1e-9)
    count = min(max(round(REST_SHARE * len(away)), FEWEST_REST), len(away))
    return np.sort(np.argpartition((away**2).sum(axis=1), count - 1)[:count])


def _neutral(parameters: Array, calm: NDArray[np.int64]) -> Array:
    """Neutral parameters (15,); NaN where a length is too small for a ratio."""
    neutral = neutral_parameters(parameters, calm.tolist())
    ratio = np.array([parameter.form == "ratio" for parameter in PARAMETERS])
    neutral[ratio & (np.abs(neutral) < SMALLEST_LENGTH)] = np.nan
    return neutral
