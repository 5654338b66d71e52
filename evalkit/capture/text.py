"""Captures as text: TRC files of Motion Analysis and OpenSim, and plain CSV."""

from __future__ import annotations

import csv
import io
import re
from array import array
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from evalkit.capture.c3d_read import QUANTITIES, SAMPLES_AT_ONCE, UNIT_NAMES, factors
from evalkit.capture.files import FileSource, read_bytes, replacing, shown
from evalkit.capture.labels import check_labels, printable, unique_labels
from evalkit.capture.model import MILLIMETRES, Capture
from evalkit.errors import CaptureError

AXES = "xyz"

TRC_KEYS = (
    "DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame",
    "OrigNumFrames",
)  # fmt: skip

COLUMN = re.compile(rf"(.+)_([xyz])_({'|'.join([*MILLIMETRES, *QUANTITIES.values()])})", re.DOTALL)
"""A column of coordinates in a CSV file: label, axis, and unit or kind of quantity."""


def read_trc(path: Path) -> Capture:
    """Read a TRC file; see :func:`evalkit.capture.read_capture`.

    The header's DataRate, NumFrames, NumMarkers and Units count; NumFrames must be the number of lines.
    """
    name = shown(path)
    lines = _text(path).splitlines()
    rows = _trc_rows(lines)
    header = [next(rows, (len(lines), [])) for _ in range(4)]
    if not header[0][1] or not header[0][1][0].lower().startswith("pathfiletype"):
        raise CaptureError(f"{name}: not a TRC file (it does not begin with PathFileType)")
    keys, values = (header[k][1] for k in (1, 2))
    stated = {key.lower(): value for key, value in zip(keys, values, strict=False)}
    missing = [key for key in ("DataRate", "NumFrames", "NumMarkers", "Units") if not stated.get(key.lower())]
    if missing:
        raise CaptureError(f"{name}:{header[2][0]}: the header does not state {', '.join(missing)}")
    rate, frames, markers = (
        _number(stated[key.lower()], path, header[2][0], keys_at + 1, key)
        for key in ("DataRate", "NumFrames", "NumMarkers")
        for keys_at in [[k.lower() for k in keys].index(key.lower())]
    )
    unit = next((u for u, names in UNIT_NAMES.items() if stated["units"].lower() in names), None)
    if unit is None:
        raise CaptureError(
            f"{name}:{header[2][0]}: Units '{printable(stated['units'])}' is none of {', '.join(MILLIMETRES)}"
        )
    if markers < 1 or frames < 1 or markers != int(markers) or frames != int(frames):
        raise CaptureError(f"{name}:{header[2][0]}: states {frames:g} frames of {markers:g} markers; nothing to read")

    at, cells = header[3]
    if len(cells) < 3 or not cells[0].lower().startswith("frame") or not cells[1].lower().startswith("time"):
        raise CaptureError(f"{name}:{at}: the line of labels must begin with Frame# and Time")
    labels = [cell for cell in cells[2:] if cell]
    if len(labels) != markers:
        # A marker without a name leaves a gap among the labels, which stand in every third column.
        labels = (cells[2::3] + [""] * int(markers))[: int(markers)]
        if not 3 * markers < len(cells) <= 4 + 3 * markers or not any(labels):
            raise CaptureError(f"{name}:{at}: {len([c for c in cells[2:] if c])} labels, NumMarkers is {markers:g}")
    warnings: list[str] = []
    labels = unique_labels(labels, warnings)

    columns = [cells[0], cells[1], *(f"{label} {axis}" for label in labels for axis in AXES)]
    table, at_lines = _table(_without_axis_names(rows), columns, path)
    if len(table) != frames:
        raise CaptureError(f"{name}: NumFrames promises {frames:g} frames, the file holds {len(table)}")
    first = _first_frame(table[:, 0], at_lines, path, 1)
    points = _points(table[:, 2:], labels, warnings) * MILLIMETRES[unit]
    return _take(path, points=points, labels=labels, rate=rate, unit=unit, first_frame=first, warnings=warnings)


def write_trc(take: Capture, path: Path) -> list[str]:
    """Write a TRC file of the positions; see :func:`evalkit.capture.write_capture`."""
    kept = [k for k, kind in enumerate(take.quantities) if kind == "position"]
    if not kept or take.frames == 0:
        raise CaptureError(
            f"a capture of {take.frames} frames and {len(kept)} positions cannot be written as TRC; "
            "it needs at least one of each"
        )
    labels = [take.labels[k] for k in kept]
    check_labels(labels)
    notes = []
    if len(kept) < len(take.labels):
        notes.append(f"{len(take.labels) - len(kept)} points that are no positions were left out of the TRC file")
    rate, count = repr(take.rate), len(kept)
    head = [
        ["PathFileType", "4", "(X/Y/Z)", path.name],
        list(TRC_KEYS),
        [rate, rate, str(take.frames), str(count), take.unit, rate, str(take.first_frame), str(take.frames)],
        ["Frame#", "Time", *(cell for label in labels for cell in (label, "", ""))],
        ["", "", *(f"{axis}{k + 1}" for k in range(count) for axis in "XYZ")],
    ]
    with replacing(path) as stream:
        stream.write("".join("\t".join(row) + "\n" for row in head).encode() + b"\n")
        points = take.points if len(kept) == len(take.labels) else take.points[:, kept]
        _write_rows(take, points, MILLIMETRES[take.unit], "\t", stream)
    return notes


def read_csv(path: Path) -> Capture:
    """Read a CSV file; see :func:`evalkit.capture.read_capture`.

    The first line names the columns, in any order: ``time_s``, from which the rate follows, ``frame``
    (optional), and ``<label>_x_mm``, ``<label>_y_mm``, ``<label>_z_mm`` for every marker, with the unit of
    the file in place of mm, or with ``angle``, ``force``, ``moment``, ``power`` or ``scalar`` for points
    that are no positions. Other columns are left out with a warning.
    """
    name = shown(path)
    rows = _csv_rows(_text(path), path)
    at, cells = next(rows, (1, []))
    header = [cell.strip() for cell in cells]
    if len(header) < 2:
        raise CaptureError(f"{name}:{at}: the first line must name the columns, separated by commas")
    twice = next((k for k, cell in enumerate(header) if cell in header[:k]), None)
    if twice is not None:
        raise CaptureError(f"{name}:{at}: column {twice + 1} ('{printable(header[twice])}') is there twice")
    if "time_s" not in header:
        raise CaptureError(f"{name}:{at}: there is no column time_s, from which the frame rate follows")
    markers: dict[tuple[str, str], dict[str, int]] = {}
    warnings: list[str] = []
    for k, cell in enumerate(header):
        found = COLUMN.fullmatch(cell)
        if found:
            label, axis, unit = found.groups()
            markers.setdefault((label, unit), {})[axis] = k
        elif cell not in ("frame", "time_s"):
            warnings.append(f"column {k + 1} ('{printable(cell)}') is no coordinate and is left out")
    if not markers:
        raise CaptureError(f"{name}:{at}: no columns of coordinates such as NoseTop_x_mm")
    for (label, unit), columns in markers.items():
        if len(columns) < 3:
            lacking = ", ".join(f"{label}_{axis}_{unit}" for axis in AXES if axis not in columns)
            raise CaptureError(f"{name}:{at}: column {lacking} is missing")
    units = {unit for _, unit in markers if unit in MILLIMETRES}
    if len(units) > 1:
        raise CaptureError(f"{name}:{at}: coordinates in {' and '.join(sorted(units))}; use one unit of length")
    unit = units.pop() if units else "mm"
    labels = unique_labels([label for label, _ in markers], warnings)
    quantities = ["position" if kind in MILLIMETRES else kind for _, kind in markers]

    wanted = [k for k, cell in enumerate(header) if cell in ("frame", "time_s") or COLUMN.fullmatch(cell)]
    table, at_lines = _table(rows, header, path, wanted)
    if len(table) == 0:
        raise CaptureError(f"{name}: holds no frames; there are no lines after the first")
    first = 1
    if "frame" in header:
        first = _first_frame(table[:, header.index("frame")], at_lines, path, header.index("frame") + 1)
    rate = _rate(table[:, header.index("time_s")], at_lines, path, header.index("time_s") + 1, warnings)
    order = [columns[axis] for columns in markers.values() for axis in AXES]
    points = _points(table[:, order], labels, warnings) * factors(unit, quantities)[:, None]
    return _take(
        path, points=points, labels=labels, rate=rate, unit=unit, first_frame=first, quantities=quantities,
        warnings=warnings,
    )  # fmt: skip


def write_csv(take: Capture, path: Path) -> list[str]:
    """Write a CSV file; see :func:`evalkit.capture.write_capture`."""
    if take.frames == 0 or not take.labels:
        raise CaptureError(
            f"a capture of {take.frames} frames and {len(take.labels)} markers cannot be written as CSV; "
            "it needs at least one of each"
        )
    check_labels(take.labels)
    suffixes = [take.unit if kind == "position" else kind for kind in take.quantities]
    head = io.StringIO()
    csv.writer(head, lineterminator="\n").writerow(
        ["frame", "time_s"]
        + [f"{label}_{axis}_{suffix}" for label, suffix in zip(take.labels, suffixes, strict=True) for axis in AXES]
    )
    divisor = factors(take.unit, take.quantities)[:, None]
    with replacing(path) as stream:
        stream.write(head.getvalue().encode())
        _write_rows(take, take.points, divisor, ",", stream)
    return []


def _text(path: Path) -> str:
    raw = read_bytes(path)
    if b"\0" in raw:
        raise CaptureError(f"{shown(path)}: not a text file; give the capture the extension of its format")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _trc_rows(lines: list[str]) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of every line that is not blank."""
    for number, line in enumerate(lines, 1):
        if line and not line.isspace():
            yield number, [cell.strip() for cell in line.split("\t")]


def _without_axis_names(rows: Iterator[tuple[int, list[str]]]) -> Iterator[tuple[int, list[str]]]:
    """Leave out the line ``X1 Y1 Z1 X2 ...`` below the labels."""
    for k, (number, cells) in enumerate(rows):
        if k or not all(re.fullmatch(r"[XYZxyz]\d*", cell) for cell in cells if cell):
            yield number, cells


def _csv_rows(text: str, path: Path) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of every line that is not blank."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        for cells in reader:
            if len(cells) > 1 or (cells and cells[0].strip()):
                yield reader.line_num, cells
    except csv.Error as error:
        raise CaptureError(f"{shown(path)}:{reader.line_num}: not a CSV file ({printable(str(error))})") from None


def _number(cell: str, path: Path, line: int, column: int, what: str) -> float:
    """The number in a cell; `line` and `column` count from 1."""
    problem = "is no number"
    try:
        value = float("nan" if "_" in cell else cell)
        if np.isfinite(value):
            return value
        if "_" not in cell:
            problem = "is not finite; leave the cell empty for an occluded marker"
    except ValueError:
        pass
    where = f"{shown(path)}:{line}: column {column} ({printable(what)})"
    raise CaptureError(f"{where}: '{printable(cell.strip())}' {problem}")


def _table(
    rows: Iterable[tuple[int, list[str]]], columns: Sequence[str], path: Path, wanted: Sequence[int] = ()
) -> tuple[NDArray[np.float64], list[int]]:
    """Numbers of all lines, shape (F, columns), NaN where a cell is empty; and the line of every row.

    Where `wanted` names columns, the others may hold anything and become NaN.
    """
    values = array("d")
    lines: list[int] = []
    width = len(columns)
    careful = len(wanted) not in (0, width)
    nan = float("nan")
    for number, cells in rows:
        if len(cells) != width:
            if len(cells) > width and not any(map(str.strip, cells[width:])):
                cells = cells[:width]
            else:
                raise CaptureError(
                    f"{shown(path)}:{number}: {len(cells)} columns, expected {width} (up to '{printable(columns[-1])}')"
                )
        row = None
        if not careful:
            try:
                row = [float(cell) if cell else nan for cell in cells]
            except ValueError:
                row = None
            # Python reads 1_000 and nan as numbers; a look at the cells is needed only where that may be.
            if row is not None and (
                not abs(sum(row)) < float("inf") or any("_" in cell for cell in cells)
            ):  # fmt: skip
                row = None
        if row is None:
            chosen = set(wanted) if careful else None
            row = [
                _number(cell, path, number, k + 1, columns[k])
                if cell.strip() and (chosen is None or k in chosen)
                else nan
                for k, cell in enumerate(cells)
            ]
        values.extend(row)
        lines.append(number)
    return np.frombuffer(values, np.float64).reshape(-1, width), lines


def _points(
    table: NDArray[np.float64], labels: Sequence[str], warnings: list[str]
) -> NDArray[np.float64]:  # fmt: skip
    """Coordinates as points; a marker with some coordinates only is occluded, and that is told."""
    points = table.reshape(len(table), len(labels), 3)
    empty = np.isnan(points)
    partial = (empty.any(axis=2) & ~empty.all(axis=2)).sum(axis=0)
    for k in np.flatnonzero(partial).tolist():
        warnings.append(f"marker '{labels[k]}' lacks a coordinate in {partial[k]} frames and counts as occluded there")
    return points


def _first_frame(numbers: NDArray[np.float64], lines: Sequence[int], path: Path, column: int) -> int:
    """First frame number; the others must follow one by one."""
    expected = numbers[0] + np.arange(len(numbers))
    wrong = np.flatnonzero(~(numbers == expected))
    if numbers[0] != np.rint(numbers[0]) or abs(numbers[0]) > 2**53:
        wrong = np.array([0])
    if wrong.size:
        k = int(wrong[0])
        told = f"expected {expected[k]:.0f}" if k else "expected a whole number"
        raise CaptureError(f"{shown(path)}:{lines[k]}: column {column} (frame): {numbers[k]:g}, {told}")
    return int(numbers[0])


def _rate(times: NDArray[np.float64], lines: Sequence[int], path: Path, column: int, warnings: list[str]) -> float:
    """Frames per second from evenly spaced times, s."""
    name = shown(path)
    if not np.isfinite(times).all():
        k = int(np.flatnonzero(~np.isfinite(times))[0])
        raise CaptureError(f"{name}:{lines[k]}: column {column} (time_s): empty; every frame needs a time")
    if len(times) == 1:
        warnings.append("a single frame does not tell the frame rate; 1 Hz is assumed")
        return 1.0
    span = times[-1] - times[0]
    if not (span > 0 and np.isfinite(span)):
        raise CaptureError(f"{name}:{lines[-1]}: column {column} (time_s): times do not increase")
    rate = (len(times) - 1) / span
    uneven = np.flatnonzero(np.abs((times - times[0]) * rate - np.arange(len(times))) > 0.5)
    if uneven.size:
        raise CaptureError(
            f"{name}:{lines[uneven[0]]}: column {column} (time_s): {times[uneven[0]]:g} s is out of step "
            f"with {rate:g} frames a second; frames must be evenly spaced"
        )
    # Times are rounded: prefer the shortest rate that fits them no worse than the one from their ends.
    steps, since = np.arange(len(times)), times - times[0]
    tolerance = max(np.abs(steps / rate - since).max(), 4 * np.finfo(float).eps * np.abs(times).max())
    for digits in range(1, 17):
        short = float(f"{rate:.{digits}g}")
        if np.abs(steps / short - since).max() <= tolerance:
            return short
    return float(rate)


def _take(path: Path, **contents: Any) -> Capture:
    """The take of a file; what is wrong with it is told together with the file's name."""
    try:
        return Capture(**contents, source=FileSource(path.absolute()))
    except CaptureError as error:
        raise CaptureError(f"{shown(path)}: {error}") from None


def _write_rows(
    take: Capture,
    points: NDArray[np.float64],
    divisor: NDArray[np.float64] | float,
    separator: str,
    stream: BinaryIO,
) -> None:
    """One line a frame: number, time and coordinates, with all the digits that reading back takes."""
    times = take.times.tolist()
    step = max(1, SAMPLES_AT_ONCE // points.shape[1])
    for start in range(0, take.frames, step):
        run = (points[start : start + step] / divisor).reshape(-1, 3 * points.shape[1])
        holes: NDArray[np.bool_] = np.asarray(np.isnan(run).any(axis=1))
        lines = []
        for k, (row, hole) in enumerate(zip(run.tolist(), holes, strict=True), start):
            cells = ["" if value != value else repr(value) for value in row] if hole else map(repr, row)
            lines.append(f"{take.first_frame + k}{separator}{times[k]!r}{separator}{separator.join(cells)}\n")
        stream.write("".join(lines).encode())
