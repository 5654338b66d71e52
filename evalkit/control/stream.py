"""From control parameters to moving markers: filter and synthesis, a whole signal at once or frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.control.filtering import DEFAULT_METHOD, NEIGHBOURS, LocalFilter, checked_signal
from evalkit.control.search import DEFAULT, searchers
from evalkit.control.signal_windows import BATCH, Layout, SignalStatus, WindowStream, over_windows
from evalkit.control.synthesis import DEFAULT_SYNTHESISER, EXAMPLES, Motions, Synthesis
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.vision.parameters import NAMES

FEWEST_COMMON = 3
"""Parameters that signal and database must share: with fewer, most faces look alike."""


class MotionDatabase(Motions, Protocol):
    """What control needs of a :class:`~evalkit.control.database.Database`."""

    @property
    def rate_hz(self) -> float:
        """Frames a second."""


@dataclass(frozen=True)
class Settings:
    """How a signal drives the markers.

    Attributes
    ----------
    layout : Layout
        Its ratio is set from the rates; latency and step are cut to what a window then reaches back.
    searcher : str
        Of :data:`evalkit.control.search.searchers`.
    method : str
        Of :data:`evalkit.control.filtering.methods`.
    neighbours : int
        Of the filter.
    synthesiser : str
        Of :data:`evalkit.control.synthesis.synthesisers`.
    examples : int
        Of the synthesis.
    """

    layout: Layout = field(default_factory=Layout)
    searcher: str = DEFAULT
    method: str = DEFAULT_METHOD
    neighbours: int = NEIGHBOURS
    synthesiser: str = DEFAULT_SYNTHESISER
    examples: int = EXAMPLES


PAPER = Settings(
    layout=Layout(window=20, latency=19, blend=5, step=15), searcher="graph", method="projection",
    neighbours=100, synthesiser="inverse distance",
)  # fmt: skip
"""As in Chai, Xiao & Hodgins (2003): segments that overlap by 5 frames, local PCA, distance weights, their graph. How
long its segments are the notes on the paper do not say; 20 frames are a third of a second at 60 Hz."""


VIDEO = Settings(synthesiser="inverse distance")
"""For parameters that a tracker reads from a video: what they are wrong by is slow and of the size of expressions, so
that no filter takes it out, and a linear map carries it on to the markers. A mean of motions that the database has does
not (study ``end-to-end``)."""


class ControlFrame(NamedTuple):
    """One frame of moving markers.

    Attributes
    ----------
    frame : int
        Of the signal, from 0.
    parameters : ndarray, shape (15,)
        Filtered; NaN where lost and in columns that signal or database do not have.
    displacements : ndarray, shape (M, 3), mm
        From rest, in the database's axes. Held from the last known frame where lost, NaN before the first.
    status : SignalStatus
    """

    frame: int
    parameters: Array
    displacements: Array
    status: SignalStatus


class ControlMotion(NamedTuple):
    """A whole signal's moving markers; as :class:`ControlFrame`, with a first axis of frames."""

    parameters: Array
    displacements: Array
    status: NDArray[np.int8]


class Control:
    """Control parameters in, marker displacements out.

    Windows of the signal are filtered and what they move is synthesised, one window for every frame, sampled at the
    database's rate (:mod:`evalkit.control.signal_windows`); there is one frame out for every frame in, at the signal's
    own rate. A frame comes out ``latency`` frames after it came in.

    Parameters
    ----------
    database : Database
    rate_hz : float, optional
        Of the signal; the database's by default.
    settings : Settings
    given : sequence of str, optional
        Names of the parameters that the signal gives (:data:`evalkit.vision.parameters.NAMES`); all by default. Those
        that the database does not know are not used, and the markers follow the others (:attr:`unused`).

    Raises
    ------
    EvalkitError
        If fewer than three parameters are common, the rate is not positive, the database has no windows of that
        length, or a setting is not known.

    Examples
    --------
    ``control = Control(database, rate_hz=30.0)``, then ``control.step(parameters)`` for every frame, which gives a
    frame or None, and ``control.finish()`` for the last ones; or ``control.run(parameters)`` for all frames at once.
    """

    def __init__(
        self,
        database: MotionDatabase,
        rate_hz: float | None = None,
        settings: Settings | None = None,
        given: Sequence[str] | None = None,
    ) -> None:
        chosen = settings or Settings()
        rate = database.rate_hz if rate_hz is None else rate_hz
        if not (np.isfinite(rate) and rate > 0):
            raise EvalkitError(f"the signal's rate is {rate} Hz; it must be a number > 0")
        if chosen.searcher not in searchers:
            raise EvalkitError(f"searcher '{chosen.searcher}' is not known; known are {', '.join(searchers)}")
        for name in given or ():
            if name not in NAMES:
                raise EvalkitError(f"'{name}' is no control parameter; they are {', '.join(NAMES)}")
        told = np.array([given is None or name in given for name in NAMES])
        known = np.asarray(database.known, dtype=bool)
        self.columns = np.flatnonzero(told & known)
        self.unused = [name for name, has in zip(NAMES, told & ~known, strict=True) if has]
        """Parameters of the signal that the database does not know."""
        if len(self.columns) < FEWEST_COMMON:
            common = ", ".join(NAMES[k] for k in self.columns) or "none"
            raise EvalkitError(
                f"signal and database share too few control parameters ({common}), fewer than {FEWEST_COMMON}; "
                "build the database from takes with more of the 19 face points"
            )
        self.database, self.rate_hz = database, float(rate)
        self.layout = chosen.layout.at(database.rate_hz / rate)
        window = self.layout.window
        rows: Any = database.parameters if len(self.columns) == len(NAMES) else database.parameters[:, self.columns]
        self._exact = searchers[chosen.searcher].exact
        self.searcher = searchers[chosen.searcher](rows, database.segments, window)
        self.filter = LocalFilter(database, self.searcher, window, self.columns, chosen.method, chosen.neighbours)
        self.synthesis = Synthesis(
            database, self.searcher, window, self.columns, chosen.synthesiser, chosen.examples
        )  # fmt: skip
        self.reset()

    @property
    def latency_s(self) -> float:
        """Time by which a frame comes out later than it came in, computing aside, s."""
        return self.layout.latency / self.rate_hz

    def reset(self) -> None:
        """Begin another signal."""
        self.searcher.reset()
        self._stream = WindowStream(self.layout, self._answer)
        self._held = np.full(self.database.motions.shape[1:], np.nan)

    def step(self, parameters: ArrayLike) -> ControlFrame | None:
        """One frame in and, as soon as there is one, one out.

        Parameters
        ----------
        parameters : array_like, shape (15,)
            Normalised against the person's neutral and by the database's spread
            (:func:`evalkit.vision.parameters.normalise`); NaN where nothing is known, all of them for a lost frame.

        Returns
        -------
        ControlFrame or None
            The frame ``latency`` frames ago; None for the first ones.

        Raises
        ------
        EvalkitError
            If there are not 15 parameters.
        """
        row = checked_signal(np.asarray(parameters, dtype=np.float64)[None], len(NAMES))[0]
        out = self._stream.step(row[self.columns])
        return None if out is None else self._frame(*out)

    def finish(self) -> list[ControlFrame]:
        """The last frames, when no more come in; another signal can begin."""
        found = [self._frame(*out) for out in self._stream.finish()]
        self.reset()
        return found

    def run(self, parameters: ArrayLike) -> ControlMotion:
        """A whole signal (F, 15) at once: what :meth:`step` and :meth:`finish` give.

        Raises
        ------
        EvalkitError
            If the signal has another number of columns, or no frame of it is known.
        """
        rows = checked_signal(parameters, len(NAMES))
        self.searcher.reset()
        # A searcher that follows the stream must be asked in the order of the stream.
        batch = BATCH if self._exact else 1
        values, status = over_windows(rows[:, self.columns], self.layout, self._answer, batch)
        self.searcher.reset()
        told = status != SignalStatus.LOST
        last = np.maximum.accumulate(np.where(told, np.arange(len(values)), 0))
        filtered = np.full(rows.shape, np.nan)
        filtered[:, self.columns] = values[:, : len(self.columns)]
        # Before the first known frame, frame 0 is "held", which is NaN itself.
        return ControlMotion(filtered, values[last, len(self.columns) :].reshape(len(values), -1, 3), status)

    def _answer(self, windows: Array) -> Array:
        """Filtered parameters and displacements side by side, of the last samples of windows."""
        filtered = self.filter(windows)
        moved = self.synthesis(filtered, self.layout.samples)
        return np.concatenate([filtered.reshape(windows.shape)[:, -self.layout.samples :], moved], axis=2)

    def _frame(self, frame: int, values: Array, status: SignalStatus) -> ControlFrame:
        filtered = np.full(len(NAMES), np.nan)
        if status != SignalStatus.LOST:
            filtered[self.columns] = values[: len(self.columns)]
            self._held = values[len(self.columns) :].reshape(-1, 3)
        return ControlFrame(frame, filtered, self._held.copy(), status)
