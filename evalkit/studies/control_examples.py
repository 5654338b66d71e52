"""Databases of control and signals to try them on, for the studies of filter and synthesis."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evalkit.control.database import STILL
from evalkit.control.takes import DatabaseTake, TakeOptions, database_take
from evalkit.geometry import Array
from evalkit.studies.control_takes import RIGID_SITES, control_take, performer

REAL = "captures"
"""Motion of :func:`examples` that is a real performer's: a database from one capture, a signal from another."""

REAL_FILES = ("captures/animface_jaw.c3d", "captures/animface_cheeks.c3d")
"""Below the folder that ``EVALKIT_REAL_DATA`` names."""

SEEN, UNSEEN = ("calm", "happy", "sad"), ("angry", "surprised", "doubtful")
"""Emotions of a database, and of signals that it is not made for."""

OTHER_ROWS = 1800
"""Frames of the take that a signal is cut out of: what is neutral can be told from half a minute, not from a word."""

MOTIONS = ("in database", "held out", "unseen", REAL)


@dataclass(frozen=True, eq=False)
class Examples:
    """A database in memory and a signal of the same performer, whose motion is known.

    Attributes
    ----------
    parameters, known, segments, motions, rate_hz
        As of :class:`evalkit.control.database.Database`.
    signal : ndarray, shape (F, 15)
        Without noise, in the database's spreads; 0 where not known.
    truth : ndarray, shape (F, M, 3), mm
        Displacement of the markers.
    """

    parameters: NDArray[np.float32]
    known: NDArray[np.bool_]
    segments: NDArray[np.int64]
    motions: NDArray[np.float32]
    rate_hz: float
    signal: Array
    truth: Array


def real_files() -> list[Path]:
    """The two real captures; empty where they are not."""
    folder = os.environ.get("EVALKIT_REAL_DATA")
    found = [Path(folder, name) for name in REAL_FILES] if folder else []
    return found if all(path.is_file() for path in found) else []


def motions_here(wanted: tuple[object, ...]) -> list[str]:
    """Motions that can be had on this machine."""
    return [str(motion) for motion in wanted if motion != REAL or real_files()]


@lru_cache(maxsize=8)
def examples(motion: str, seed: int, head: str, rows: int, frames: int) -> Examples:
    """Database and signal of a cell.

    Parameters
    ----------
    motion : str
        ``in database``: the signal is a part of the database. ``held out``: another performance of the same
        performer. ``unseen``: database and signal with emotions that the other does not have. ``captures``: real ones.
    seed : int
    head : str
        Who performs; empty for the head that is here.
    rows, frames : int
        Of database and signal. Real captures are as long as they are; the signal is cut to ``frames``, from a place
        that the seed draws.
    """
    if motion == REAL:
        base, other = (database_take(path, path.name, TakeOptions()) for path in real_files())
        start = (seed * 7919 + 300) % max(len(other.changes) - frames, 1)
    elif motion == "unseen":
        base, other = _performed(head, seed, rows, SEEN), _performed(head, seed + 1000, OTHER_ROWS + frames, UNSEEN)
        start = OTHER_ROWS // 2
    else:
        base = _performed(head, seed, rows)
        other = base if motion == "in database" else _performed(head, seed + 1000, OTHER_ROWS + frames)
        start = (rows if motion == "in database" else OTHER_ROWS) // 2
    spread = np.where(base.known, np.maximum(base.changes.std(axis=0), STILL), 1.0)
    part = slice(start, start + frames)
    return Examples(
        parameters=(base.changes / spread).astype(np.float32),
        known=base.known & other.known,
        segments=base.segments,
        motions=base.motions,
        rate_hz=base.rate_hz,
        signal=other.changes[part].astype(np.float64) / spread,
        truth=other.motions[part].astype(np.float64),
    )


def _performed(head: str, seed: int, frames: int, emotions: tuple[str, ...] = (*SEEN, *UNSEEN)) -> DatabaseTake:
    take = control_take(head or performer(), seed, frames, emotions=emotions).still
    return database_take(take, "take", TakeOptions(), compensated=True, rigid=tuple(RIGID_SITES))
