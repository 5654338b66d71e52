"""What was observed: takes of markers, and the files that hold them."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from evalkit.capture.c3d_read import read_c3d
from evalkit.capture.c3d_write import write_c3d
from evalkit.capture.files import refuse_own_source, shown
from evalkit.capture.model import MILLIMETRES, Capture
from evalkit.capture.text import read_csv, read_trc, write_csv, write_trc
from evalkit.errors import CaptureError

__all__ = ["MILLIMETRES", "Capture", "read_capture", "write_capture"]

_READERS: dict[str, Callable[[Path], Capture]] = {".c3d": read_c3d, ".trc": read_trc, ".csv": read_csv}
_WRITERS: dict[str, Callable[[Capture, Path], list[str]]] = {
    ".c3d": write_c3d, ".trc": write_trc, ".csv": write_csv,
}  # fmt: skip


def _format(path: Path) -> str:
    extension = path.suffix.lower()
    if extension not in _READERS:
        raise CaptureError(
            f"{shown(path)}: extension '{extension}' is no capture format; use one of {', '.join(_READERS)}"
        )
    return extension


def read_capture(path: str | os.PathLike[str]) -> Capture:
    """Read a marker capture; the format follows from the extension, in any case.

    ``.c3d`` files of all three processors, integer or real, are read by a reader that checks every bound
    before it touches the data ("The C3D file format user guide", Motion Lab Systems). ``.trc`` is the
    tab-separated format of Motion Analysis and OpenSim, ``.csv`` the columns that
    :func:`write_capture` writes, in any order.

    A point is occluded (NaN) where its residual is negative or all its coordinates are 0 in a C3D file, and
    where a cell is empty in a text file. What is odd but does no harm (missing labels or unit, counts that
    contradict each other but not the file's size) is told in ``take.warnings``.

    Parameters
    ----------
    path : str or path-like
        The file to read.

    Returns
    -------
    Capture
        Positions in mm whatever the file's unit; ``take.source`` keeps what a processed copy needs.

    Raises
    ------
    CaptureError
        If there is no such file or it cannot be read whole. The message is one line that names the file.
        A file is never read as a shorter take than it states.

    Notes
    -----
    Labels in a C3D file are UTF-8 where that is valid, else Latin-1.

    C3D files have no checksum. Damaged samples in an otherwise well-formed file therefore cannot be told
    from data; neither can a parameter whose value was changed into another plausible one that the file
    states only once, such as the unit or a label.

    Examples
    --------
    The talking face that comes with evalkit:

    >>> import evalkit
    >>> from evalkit.bundled import bundled_take
    >>> capture, truth = bundled_take("talking")
    >>> take = evalkit.read_capture(capture)
    >>> take.points.shape, take.rate, take.unit
    ((600, 23, 3), 60.0, 'mm')
    >>> take.labels[:3]
    ['ForeheadC', 'ForeheadL', 'ForeheadR']
    """
    file = Path(path)
    return _READERS[_format(file)](file)


def write_capture(take: Capture, path: str | os.PathLike[str]) -> list[str]:
    """Write a marker capture; the format follows from the extension: ``.c3d``, ``.trc`` or ``.csv``.

    A take that was read from a C3D file, and whose frames, labels, rate, unit, axes and quantities are
    still the same, is written to ``.c3d`` as a processed copy: only the positions change (and the residual
    where a point vanished or appeared); header, events, every parameter, the analog samples and their order
    stay as they were, byte for byte. Only if the new positions do not lie on the grid of an integer file is
    the copy written in reals. Any other take becomes a new file in reals (PC byte order), in the take's own
    unit.

    The file is written under a temporary name in the same folder and then renamed.

    Parameters
    ----------
    take : Capture
        What to write.
    path : str or path-like
        Where to. An existing file is replaced, but never the one that the take was read from.

    Returns
    -------
    list of str
        What the reader of the new file should know, in words: integers that became reals, points that the
        format cannot hold. Empty if everything is as it was.

    Raises
    ------
    CaptureError
        If the take does not fit the format or the file cannot be written. Nothing is left behind then.

    Examples
    --------
    Positions are millimetres in memory and in the take's own unit in the file:

    >>> import evalkit
    >>> take = evalkit.Capture([[[0, 0, 0], [0, -40, 5]]], labels=["Nose", "Chin"], rate=60, unit="cm")
    >>> evalkit.write_capture(take, "take.csv")
    []
    >>> again = evalkit.read_capture("take.csv")
    >>> again.points[0, 1], again.unit
    (array([  0., -40.,   5.]), 'cm')
    """
    file = Path(path)
    writer = _WRITERS[_format(file)]
    refuse_own_source(file, take.source)
    return writer(take, file)
