"""A face's control signal: parameters and head pose of every frame, out of a tracked video or a table."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.vision.parameters import NAMES, PARAMETERS, SMALLEST_LENGTH, neutral_parameters, normalise

if TYPE_CHECKING:
    import pandas as pd

TABLE, POSES = "parameters.csv", "pose.csv"
"""Files of ``evalkit track`` that a signal is read from."""

QUATERNION = ("qw", "qx", "qy", "qz")

RATIO = np.array([parameter.form == "ratio" for parameter in PARAMETERS])


@dataclass(frozen=True, eq=False)
class Signal:
    """What a face did.

    Attributes
    ----------
    parameters : ndarray, shape (F, 15)
        In the units of :data:`evalkit.vision.parameters.PARAMETERS`; NaN where not known.
    rotations : ndarray, shape (F, 3, 3)
        Of the head, in the camera's axes; NaN where not known.
    rate_hz : float
    """

    parameters: Array
    rotations: Array
    rate_hz: float

    def against_neutral(self, spread: Array, frames: list[int] | None = None) -> tuple[Array, list[str]]:
        """Parameters as a database has them, (F, 15), and what was left out.

        Parameters
        ----------
        spread : ndarray, shape (15,)
            Of the database.
        frames : list of int, optional
            Frames in which the face is at rest; by default the first in which anything is known.

        Raises
        ------
        EvalkitError
            If nothing is known in any frame, or there is no such frame.
        """
        neutral = neutral_of_first(self.parameters) if frames is None else neutral_parameters(self.parameters, frames)
        sure = usable(neutral)
        notes = [
            f"{NAMES[k]} is {neutral[k]:.3f} eye distances at rest, too small for a ratio; left to the database"
            for k in np.flatnonzero(np.isfinite(neutral) & np.isnan(sure))
        ]
        return normalise(self.parameters, sure, spread), notes


def neutral_of_first(parameters: Array) -> Array:
    """The neutral face (15,) out of parameters (F, 15): of each the first value that is known.

    Raises
    ------
    EvalkitError
        If nothing is known in any frame.
    """
    known = np.isfinite(parameters)
    if not known.any():
        raise EvalkitError("no control parameter is known in any frame; was the face found?")
    first = known.argmax(axis=0)
    return np.asarray(parameters[first, np.arange(parameters.shape[1])])


def usable(neutral: Array) -> Array:
    """A neutral face (15,) without the lengths that are too small for a ratio."""
    return np.where(RATIO & (np.abs(neutral) < SMALLEST_LENGTH), np.nan, neutral)


def held_rotations(rotations: Array) -> Array:
    """Rotations (F, 3, 3) with those that are not known (NaN) held from before, else from after, else straight."""
    known = np.isfinite(rotations).all(axis=(1, 2))
    if not known.any():
        return np.broadcast_to(np.eye(3), rotations.shape)
    first = int(np.argmax(known))
    last = np.maximum.accumulate(np.where(known, np.arange(len(rotations)), first))
    return np.asarray(rotations[last])


def read_signal(source: str | Path, rate_hz: float | None = None) -> Signal:
    """Read a control signal from a table.

    Parameters
    ----------
    source : str or Path
        The folder of ``evalkit track``, or a CSV file: a row a frame, a column for each parameter that is known, under
        the names of :data:`evalkit.vision.parameters.NAMES`; ``time_s``; and, in it or in a ``pose.csv`` beside it,
        the head's unit quaternion ``qw, qx, qy, qz``. Empty cells are not known.
    rate_hz : float, optional
        Frames per second; by default what ``time_s`` says.

    Returns
    -------
    Signal

    Raises
    ------
    EvalkitError
        If a file cannot be read, no column is a parameter, a cell is no number, or the rate is not known.
    """
    path = Path(source)
    if path.is_dir():
        path = path / TABLE
    table = _table(path)
    known = [name for name in NAMES if name in table]
    if not known:
        raise EvalkitError(f"{path}: no column is a control parameter; they are called {', '.join(NAMES)}")
    values = np.full((len(table), len(NAMES)), np.nan)
    for name in known:
        values[:, NAMES.index(name)] = _numbers(table, name, path)
    return Signal(values, _rotations(table, path), rate_hz or _rate(table, path))


def _table(path: Path) -> pd.DataFrame:
    import pandas as pd

    try:
        table = pd.read_csv(path)
    except OSError as error:
        raise EvalkitError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (ValueError, pd.errors.ParserError) as error:
        raise EvalkitError(f"{path}: no table of comma-separated values ({str(error).splitlines()[0]})") from error
    if not len(table):
        raise EvalkitError(f"{path}: has no frames")
    return table


def _numbers(table: pd.DataFrame, name: str, path: Path) -> Array:
    import pandas as pd

    numbers: Any = pd.to_numeric(table[name], errors="coerce")
    odd = np.flatnonzero(numbers.isna() & table[name].notna())
    if len(odd):
        raise EvalkitError(f"{path}: {name} in row {odd[0] + 2} is '{table[name].iloc[odd[0]]}', no number")
    return np.asarray(numbers, dtype=np.float64)


def _rotations(table: pd.DataFrame, path: Path) -> Array:
    if not set(QUATERNION) <= set(table):
        beside = path.with_name(POSES)
        if not beside.is_file() or beside == path:
            return np.full((len(table), 3, 3), np.nan)
        poses = _table(beside)
        if len(poses) != len(table) or not set(QUATERNION) <= set(poses):
            raise EvalkitError(f"{beside}: is not the pose of the {len(table)} frames of {path.name}")
        table, path = poses, beside
    quaternions = np.stack([_numbers(table, name, path) for name in QUATERNION], axis=1)
    out = np.full((len(table), 3, 3), np.nan)
    sure = np.isfinite(quaternions).all(axis=1) & (np.linalg.norm(quaternions, axis=1) > 0)
    if sure.any():
        out[sure] = Rotation.from_quat(quaternions[sure][:, [1, 2, 3, 0]]).as_matrix()
    return out


def _rate(table: pd.DataFrame, path: Path) -> float:
    if "time_s" not in table or len(table) < 2:
        raise EvalkitError(f"{path}: without a column time_s of two rows or more the rate is not known; give --rate HZ")
    steps = np.diff(_numbers(table, "time_s", path))
    step = float(np.median(steps))
    if not (np.isfinite(step) and step > 0 and np.abs(steps - step).max() < 0.5 * step):
        raise EvalkitError(f"{path}: time_s does not grow by even steps; give --rate HZ and a row for every frame")
    return 1.0 / step
