"""Windows of a control signal, and frames put together again out of what is known of its windows.

One window ends at every frame (or every few). Its samples lie as far apart as those of the database, whatever the rate
of the signal: between two frames the signal is taken to be linear. What comes back for a window is read at the times of
the signal's frames, by linear interpolation too, so that there is one frame out for every frame in.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array

Answer = Callable[[Array], Array]
"""From windows (Q, W, P), NaN where nothing is known, to what is to be told of them (Q, R, C): their last R samples."""

LEAST_KNOWN = 0.5
"""Share of its parameters under which a frame counts as lost: a window that is mostly filled in finds its own filling
in the database, not the face. A hand on the mouth takes 6 of 15."""

BATCH = 64
"""Windows that are answered at a time. A hundred neighbours of 20 samples of 50 markers are 1.2 MB for each."""


class SignalStatus(IntEnum):
    """Where a frame that comes out has its values from.

    Attributes
    ----------
    OK
        All parameters were measured.
    FILLED
        Some were missing; the database filled them in.
    BRIDGED
        Nothing (or too little, :data:`LEAST_KNOWN`) was measured in this frame, but shortly before and after it.
    LOST
        Nothing is known; what comes out is held, or NaN before anything was known.
    """

    OK = 0
    FILLED = 1
    BRIDGED = 2
    LOST = 3

    @property
    def text(self) -> str:
        """The status as it is written in tables."""
        return self.name.lower()


@dataclass(frozen=True)
class Layout:
    """Where windows lie and how they are put together.

    Attributes
    ----------
    window : int
        Samples of a window, W, at the database's rate.
    latency : int
        Frames after a frame that its value waits for: it is made of the windows that end at it or up to so many frames
        later. More is smoother and later.
    blend : int
        Samples over which a window fades in and out: weights ``0.5 cos(pi b) + 0.5``, b from 0 to 1, as in section 5.3
        of Chai, Xiao & Hodgins (2003), doi:10.2312/SCA03/193-206. Two windows that overlap by as many samples are
        cross-blended by exactly that; where more overlap, weights are divided by their sum.
    step : int
        Frames from the end of one window to that of the next. The paper's segments are ``window - blend``; frames
        after the last whole one before a loss are then lost too.
    bridge : int
        Longest run of lost frames that a window may reach over. After a longer one the signal starts anew.
    ratio : float
        Rate of the database over that of the signal.
    """

    window: int = 10
    latency: int = 4
    blend: int = 5
    step: int = 1
    bridge: int = 5
    ratio: float = 1.0

    def __post_init__(self) -> None:
        if self.window < 2:
            raise EvalkitError(f"a window of {self.window} frames has no motion; at least 2 are needed")
        if not (np.isfinite(self.ratio) and self.ratio > 0):
            raise EvalkitError(f"the rates' ratio is {self.ratio}; both rates must be numbers > 0")
        if not 0 <= self.latency <= self.reach:
            raise EvalkitError(
                f"latency of {self.latency} frames; a window of {self.window} samples of the database reaches back "
                f"{self.reach} frames of the signal: use 0 to {self.reach}"
            )
        if not 1 <= self.step <= self.latency + 1:
            raise EvalkitError(f"windows every {self.step} frames leave frames without one: use 1 to latency + 1")
        if not 1 <= self.blend < self.window or self.bridge < 0:
            raise EvalkitError(
                f"blend {self.blend} and bridge {self.bridge}: blend must be 1 to {self.window - 1}, bridge at least 0"
            )

    def at(self, ratio: float) -> Layout:
        """The same for another signal, latency and step cut to what a window reaches back."""
        latency = min(self.latency, _reach(self.window, ratio)) if ratio > 0 else 0
        return replace(self, ratio=ratio, latency=latency, step=min(self.step, latency + 1))

    @property
    def reach(self) -> int:
        """Frames of the signal before its last that a window reaches back."""
        return _reach(self.window, self.ratio)

    @cached_property
    def back(self) -> Array:
        """How far before the window's end its samples are, (W,), in frames of the signal."""
        return np.round(np.arange(self.window - 1, -1, -1) / self.ratio, 9)

    @cached_property
    def readout(self) -> Array:
        """What linear interpolation makes the frames 0, 1, ... latency before the end of, (latency + 1, R)."""
        at = np.round(self.window - 1 - np.arange(self.latency + 1) * self.ratio, 9)
        samples = np.arange(int(np.floor(at[-1])), self.window)
        return np.maximum(0.0, 1.0 - np.abs(at[:, None] - samples))

    @property
    def samples(self) -> int:
        """R, the last samples of a window that are ever read."""
        return self.readout.shape[1]

    @cached_property
    def shares(self) -> Array:
        """Weight of a window in the frames 0, 1, ... latency before its end, (latency + 1,)."""
        edge = np.arange(1, self.blend + 1) / (self.blend + 1)
        fade = 0.5 * np.cos(np.pi * edge) + 0.5
        taper = np.ones(self.window)
        taper[-self.blend :] = fade
        # Where a window is shorter than two blends, the smaller of the two.
        taper[: self.blend] = np.minimum(taper[: self.blend], fade[::-1])
        return self.readout @ taper[-self.samples :]

    def ends(self, frames: int) -> NDArray[np.bool_]:
        """Frames at which a window is due, (frames,), should they be known."""
        return np.arange(frames) % self.step == self.step - 1

    def cut(self, signal: Array, ends: NDArray[np.intp], anchors: NDArray[np.intp]) -> Array:
        """Windows (Q, W, P) that end at frames (Q,) of a signal (F, P); before its anchor it is taken to rest."""
        at = np.maximum(ends[:, None] - self.back, anchors[:, None])
        low = np.floor(at).astype(np.intp)
        share = (at - low)[..., None]
        before, after = signal[low], signal[np.minimum(low + 1, len(signal) - 1)]
        # A frame that is hit exactly is known even if the next one is not.
        return np.where(share > 0, (1.0 - share) * before + share * after, before)


def _reach(window: int, ratio: float) -> int:
    # Rounding must not cut the last frame off where the rates divide.
    return int(np.floor((window - 1) / ratio + 1e-9))


def anchored(lost: NDArray[np.bool_], bridge: int) -> NDArray[np.intp]:
    """First frame (F,) that a window which ends at a frame may look at; -1 where that frame is lost itself."""
    out = np.full(len(lost), -1, dtype=np.intp)
    known = np.flatnonzero(~lost)
    if len(known):
        anew = np.diff(known, prepend=-bridge - 2) > bridge + 1
        anew[0] = True
        out[known] = np.maximum.accumulate(np.where(anew, known, 0))
    return out


def without_lost(signal: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The signal (F, P) with NaN for all that is not a number, and which frames (F,) are lost."""
    known = np.isfinite(signal)
    lost = known.mean(axis=1) < LEAST_KNOWN
    return np.where(known & ~lost[:, None], signal, np.nan), lost


def over_windows(signal: Array, layout: Layout, answer: Answer, batch: int = BATCH) -> tuple[Array, NDArray[np.int8]]:
    """What is told of every frame of a signal by its windows.

    Parameters
    ----------
    signal : ndarray, shape (F, P)
        NaN where nothing is known.
    layout : Layout
    answer : callable
        See :data:`Answer`.
    batch : int
        Windows that are answered at a time.

    Returns
    -------
    values : ndarray, shape (F, C)
        NaN where the status is LOST.
    status : ndarray of int8, shape (F,)
        :class:`SignalStatus`.
    """
    signal, lost = without_lost(signal)
    frames = len(signal)
    anchors = anchored(lost, layout.bridge)
    due = layout.ends(frames)
    # The last frame always ends a window. In a stream, what is `latency` before it is out by then.
    reach = np.where(due, layout.latency, layout.latency - 1)
    ends = np.flatnonzero((due | (np.arange(frames) == frames - 1)) & ~lost)
    total, weight = np.zeros((0, 0)), np.zeros(frames)
    for start in range(0, len(ends), batch):
        some = ends[start : start + batch]
        found = layout.readout @ answer(layout.cut(signal, some, anchors[some]))
        if not total.size:
            total = np.zeros((frames, found.shape[2]))
        for ago, share in enumerate(layout.shares):
            inside = (some - ago >= anchors[some]) & (ago <= reach[some])
            total[some[inside] - ago] += share * found[inside, ago]
            weight[some[inside] - ago] += share
    if not total.size:
        raise EvalkitError("no frame of the signal has as much as half of its parameters; was the face found at all?")
    with np.errstate(invalid="ignore", divide="ignore"):
        values = total / weight[:, None]
    return values, statuses(signal, lost, weight > 0)


def statuses(signal: Array, lost: NDArray[np.bool_], told: NDArray[np.bool_]) -> NDArray[np.int8]:
    """Status of frames from what was measured (F, P), what counts as lost and what a window tells something of (F,)."""
    filled = np.where(np.isnan(signal).any(axis=1), SignalStatus.FILLED, SignalStatus.OK)
    status = np.where(lost, SignalStatus.BRIDGED, filled)
    return np.where(told, status, SignalStatus.LOST).astype(np.int8)


class WindowFrame(NamedTuple):
    """One frame out of :class:`WindowStream`."""

    frame: int
    values: Array
    status: SignalStatus


class WindowStream:
    """:func:`over_windows` frame by frame: what comes out is the same, ``latency`` frames later.

    Parameters
    ----------
    layout : Layout
    answer : callable
        See :data:`Answer`; called with one window at a time.
    """

    def __init__(self, layout: Layout, answer: Answer) -> None:
        self.layout, self.answer = layout, answer
        kept = max(int(np.ceil(layout.back[0])), layout.latency) + 1
        self._rows: deque[Array] = deque(maxlen=kept)
        self._lost: deque[bool] = deque(maxlen=layout.latency + 1)
        self._sums: deque[tuple[Array | None, float]] = deque(maxlen=layout.latency + 1)
        self._count, self._anchor, self._last_known = 0, -1, -1
        self._last_end = -1

    def step(self, row: Array) -> WindowFrame | None:
        """One frame (P,) in; the frame ``latency`` before it out, or None as long as there is none."""
        cleaned, lost = without_lost(np.asarray(row, dtype=np.float64)[None])
        self._rows.append(cleaned[0])
        self._lost.append(bool(lost[0]))
        self._sums.append((None, 0.0))
        here, self._count = self._count, self._count + 1
        if not lost[0]:
            if self._last_known < 0 or here - self._last_known > self.layout.bridge + 1:
                self._anchor = here
            self._last_known = here
            if here % self.layout.step == self.layout.step - 1:
                self._tell(here)
        return self._out(self.layout.latency) if here >= self.layout.latency else None

    def finish(self) -> list[WindowFrame]:
        """The last frames, when no more are to come."""
        last = self._count - 1
        if last >= 0 and not self._lost[-1] and self._last_end != last:
            self._tell(last)
        return [self._out(ago) for ago in range(min(self.layout.latency, self._count) - 1, -1, -1)]

    def _tell(self, end: int) -> None:
        """Add what the window that ends here says of the last frames; after all have come in, of those not yet out."""
        self._last_end = end
        first = self._count - len(self._rows)
        at = np.array([end - first])
        window = self.layout.cut(np.stack(self._rows), at, np.array([max(self._anchor - first, 0)]))
        found = self.layout.readout @ self.answer(window)
        for ago in range(min(self.layout.latency, end - self._anchor) + 1):
            total, weight = self._sums[-1 - ago]
            share = self.layout.shares[ago]
            value = share * found[0, ago]
            self._sums[-1 - ago] = (value if total is None else total + value, weight + share)

    def _out(self, ago: int) -> WindowFrame:
        total, weight = self._sums[-1 - ago]
        lost = np.array([self._lost[-1 - ago]])
        status = statuses(self._rows[-1 - ago][None], lost, np.array([total is not None]))[0]
        values = np.full(0, np.nan) if total is None else total / weight
        return WindowFrame(self._count - 1 - ago, values, SignalStatus(status))
