"""Write C3D files: processed copies of a source, and fresh files.

Structure after "The C3D file format user guide", Motion Lab Systems.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from evalkit.capture.c3d_format import BLOCK, KEY, LARGEST, Processor
from evalkit.capture.c3d_read import QUANTITIES, SATURATED, C3DSource, Layout, blocks, factors
from evalkit.capture.files import replacing
from evalkit.capture.labels import check_labels
from evalkit.capture.model import MILLIMETRES, Capture
from evalkit.errors import CaptureError

LONGEST_LABEL = 127
"""Bytes; many readers take a parameter's dimensions for signed bytes."""

MOST_STRINGS = 255
"""Strings in one parameter, whose dimensions are bytes; further ones go to LABELS2, LABELS3 ..."""

GRID_TOLERANCE = 1e-6
"""How far from a whole multiple of the integer scale a coordinate still lies on the grid."""

NEARLY_ZERO = 1e-30
"""Written as x of a visible point at the very origin, for all coordinates 0 mean an occluded point."""


def write_c3d(take: Capture, path: Path) -> list[str]:
    """Write a C3D file; see :func:`evalkit.capture.write_capture`."""
    if take.frames == 0 or not take.labels:
        raise CaptureError(
            f"a capture of {take.frames} frames and {len(take.labels)} markers cannot be written as C3D; "
            "it needs at least one of each"
        )
    source = take.source
    if not isinstance(source, C3DSource):
        with replacing(path) as stream:
            return _write_fresh(take, stream)
    changed = _changes(take, source)
    with replacing(path) as stream:
        if changed:
            return [
                f"{', '.join(changed)} changed since the take was read: a new file was written without the "
                "other contents of the source",
                *_write_fresh(take, stream),
            ]
        return _write_copy(take, source, stream)


def _changes(take: Capture, source: C3DSource) -> list[str]:
    """What keeps a take from being written as a processed copy."""
    pairs = {
        "number of frames": (take.frames, source.layout.frames),
        "labels": (tuple(take.labels), source.labels),
        "frame rate": (take.rate, source.rate),
        "unit": (take.unit, source.unit),
        "first frame": (take.first_frame, source.first_frame),
        "axes": (take.axes, source.axes),
        "quantities": (tuple(take.quantities), source.quantities),
    }
    return [name for name, (now, then) in pairs.items() if now != then]


def _divisor(take: Capture) -> NDArray[np.float64] | float:
    """What to divide a take's numbers by to get those of its file."""
    values = factors(take.unit, take.quantities)
    return float(values[0]) if np.ptp(values) == 0 else values


def _fill_points(
    stored: NDArray[Any], points: NDArray[np.float64], divisor: NDArray[np.float64] | float, processor: Processor
) -> None:
    """Replace x, y, z in stored samples, shape (n, M, 4), and the residual of points that came or went."""
    dtype = stored.dtype
    seen = ~np.isnan(points[..., 0])
    hidden = ~seen
    origin = seen.copy()
    for axis in range(3):
        values = points[..., axis] / divisor
        values[hidden] = 0.0
        if not np.abs(values).max(initial=0.0) < LARGEST:
            raise CaptureError(f"a coordinate is not below {LARGEST:g}; nothing was written")
        stored[..., axis] = processor.encode(values, dtype)
        # Zero is the same pattern in all formats, but reals also have a negative one.
        origin &= (stored[..., axis] == 0) if dtype.kind != "f" else (np.abs(stored[..., axis]) < 1e-38)
    if origin.any():
        stored[..., 0][origin] = processor.encode(np.array([NEARLY_ZERO]), dtype)[0]
    minus_one, zero = processor.encode(np.array([-1.0, 0.0]), dtype)
    residual = stored[..., 3]
    residual[seen & ~(processor.decode(residual) >= 0)] = zero
    residual[hidden] = minus_one


def _fits_grid(take: Capture, layout: Layout, divisor: NDArray[np.float64] | float) -> bool:
    """Whether every visible coordinate is a whole multiple of the integer scale within 16 bits."""
    step = divisor * layout.scale
    for run in blocks(layout):
        points = take.points[run]
        seen = ~np.isnan(points[..., 0])
        origin = seen.copy()
        for axis in range(3):
            values = points[..., axis] / step
            values[~seen] = 0.0
            nearest = np.rint(values)
            if np.abs(values - nearest).max() > GRID_TOLERANCE or np.abs(nearest).max() > 32_767:
                return False
            origin &= nearest == 0
        if origin.any():
            return False
    return True


def _write_copy(take: Capture, source: C3DSource, stream: BinaryIO) -> list[str]:
    """The source with other positions."""
    layout, raw = source.layout, source.raw
    divisor = _divisor(take)
    promote = layout.integer and not _fits_grid(take, layout, divisor)
    if promote:
        grid = layout.scale * MILLIMETRES[take.unit]
        notes = [f"written in reals: the source's integers would round positions to {grid:.3g} mm"]
        stream.write(_head_for_reals(source))
    else:
        notes = []
        stream.write(memoryview(raw)[: layout.start])
    samples = layout.samples(raw)
    analog = samples.view(layout.processor.order + "u2") if promote and _unsigned_analog(source) else samples
    step = divisor if promote or not layout.integer else divisor * layout.scale
    for run in blocks(layout):
        if promote:
            block = np.empty((run.stop - run.start, layout.columns), layout.processor.real_type)
            block[:, : 4 * layout.markers] = layout.processor.encode(samples[run, : 4 * layout.markers], block.dtype)
            block[:, 4 * layout.markers :] = layout.processor.encode(analog[run, 4 * layout.markers :], block.dtype)
        else:
            block = samples[run].copy()
        part = block[:, : 4 * layout.markers].reshape(-1, layout.markers, 4)
        _fill_points(part, take.points[run], step, layout.processor)
        stream.write(block.data)
    if promote:
        _pad(stream, take.first_frame + take.frames - 1)
    else:
        stream.write(memoryview(raw)[layout.end :])
    return notes


def _head_for_reals(source: C3DSource) -> bytes:
    """Header and parameters of an integer file with the sign of both scales turned: samples are reals."""
    head = bytearray(source.raw[: source.layout.start])
    scale = source.section.find("POINT", "SCALE")
    assert scale is not None
    head[scale.offset + source.layout.processor.sign_byte] |= 0x80
    head[12:16] = head[scale.offset : scale.offset + 4]
    return bytes(head)


def _unsigned_analog(source: C3DSource) -> bool:
    stated = source.section.series("ANALOG", "FORMAT")
    return bool(stated) and stated[0].upper() == "UNSIGNED"


def _pad(stream: BinaryIO, last: int) -> None:
    """Fill the last block, unless frame numbers need more than 2 bytes: then readers count to the file's end."""
    if last < SATURATED:
        stream.write(bytes(-stream.tell() % BLOCK))


def _write_fresh(take: Capture, stream: BinaryIO) -> list[str]:
    """A new file: PC byte order, reals, groups POINT and ANALOG, for long takes also TRIAL."""
    if not take.rate < LARGEST:
        raise CaptureError(f"frame rate {take.rate:g} Hz cannot be written as C3D")
    layout = Layout(Processor.PC, False, 1.0, 0, take.frames, len(take.labels), 0)
    notes = []
    first = max(1, take.first_frame)
    if first != take.first_frame:
        notes.append(f"frames are counted from 1, not {take.first_frame}: C3D has no frame 0")
    stream.write(_head(take, first))
    divisor = _divisor(take)
    for run in blocks(layout):
        block = np.zeros((run.stop - run.start, layout.markers, 4), layout.dtype)
        _fill_points(block, take.points[run], divisor, layout.processor)
        stream.write(block.data)
    _pad(stream, first + take.frames - 1)
    return notes


def _entry(group: int, name: str, kind: int, shape: Sequence[int], values: bytes) -> bytes:
    """One parameter, with an empty description."""
    body = struct.pack("<bB", kind, len(shape)) + bytes(shape) + values + b"\0"
    return struct.pack("<bb", len(name), group) + name.encode() + struct.pack("<H", len(body) + 2) + body


def _group(number: int, name: str) -> bytes:
    return struct.pack("<bb", len(name), -number) + name.encode() + struct.pack("<HB", 3, 0)


def _strings(group: int, name: str, encoded: Sequence[bytes]) -> bytes:
    """Strings of one width, in as many parameters as it takes: NAME, NAME2, NAME3 ..."""
    entries = b""
    for start in range(0, len(encoded), MOST_STRINGS):
        part = encoded[start : start + MOST_STRINGS]
        width = max(1, *(len(item) for item in part))
        number = start // MOST_STRINGS + 1
        entries += _entry(
            group, name if number == 1 else f"{name}{number}", -1, (width, len(part)),
            b"".join(item.ljust(width) for item in part),
        )  # fmt: skip
    return entries


def _encoded_labels(take: Capture) -> list[bytes]:
    """Labels as UTF-8, which is ASCII for nearly every file."""
    check_labels(take.labels)
    encoded = []
    for k, label in enumerate(take.labels):
        item = label.encode("utf-8", "replace")
        if len(item) > LONGEST_LABEL:
            raise CaptureError(
                f"label '{label[:30]}...' of marker {k + 1} has {len(item)} bytes; "
                f"shorten it to the {LONGEST_LABEL} that C3D files hold"
            )
        encoded.append(item)
    return encoded


def _head(take: Capture, first: int) -> bytes:
    """Header and parameter section of a fresh file whose first frame has the number `first`."""
    markers, frames = len(take.labels), take.frames
    last = first + frames - 1
    long = last >= SATURATED
    if markers > 16_383:
        raise CaptureError(f"{markers} markers do not fit a C3D file; write fewer than 16,384")
    if last >= 2**31:
        raise CaptureError(f"frames {first} to {last} do not fit a C3D file; set first_frame to 1")
    labels = _encoded_labels(take)

    def section(data_block: int) -> bytes:
        entries = _group(1, "POINT")
        entries += _entry(1, "USED", 2, (), struct.pack("<H", markers))
        entries += _entry(1, "SCALE", 4, (), struct.pack("<f", -1.0))
        entries += _entry(1, "RATE", 4, (), struct.pack("<f", take.rate))
        entries += _entry(1, "DATA_START", 2, (), struct.pack("<H", data_block))
        entries += _entry(1, "FRAMES", 2, (), struct.pack("<H", min(frames, SATURATED)))
        if long:
            entries += _entry(1, "LONG_FRAMES", 4, (), struct.pack("<f", frames))
        entries += _strings(1, "LABELS", labels)
        entries += _strings(1, "DESCRIPTIONS", [b""] * markers)
        entries += _strings(1, "UNITS", [take.unit.encode()])
        if take.axes is not None:
            entries += _strings(1, "X_SCREEN", [take.axes[0].encode()])
            entries += _strings(1, "Y_SCREEN", [take.axes[1].encode()])
        for name, quantity in QUANTITIES.items():
            listed = [label for label, kind in zip(labels, take.quantities, strict=True) if kind == quantity]
            entries += _strings(1, name, listed)
        entries += _group(2, "ANALOG")
        entries += _entry(2, "USED", 2, (), struct.pack("<H", 0))
        entries += _entry(2, "GEN_SCALE", 4, (), struct.pack("<f", 1.0))
        entries += _entry(2, "RATE", 4, (), struct.pack("<f", 0.0))
        if long:
            entries += _group(3, "TRIAL")
            for name, frame in (("ACTUAL_START_FIELD", first), ("ACTUAL_END_FIELD", last)):
                entries += _entry(3, name, 2, (2,), struct.pack("<HH", frame % 65_536, frame // 65_536))
        used = 4 + len(entries) + 2
        count = -(-used // BLOCK)
        if count > 255:
            raise CaptureError(
                f"{markers} labels of up to {max(map(len, labels))} bytes do not fit the parameters of a "
                "C3D file; shorten them or write fewer markers"
            )
        return (bytes((1, KEY, count, Processor.PC)) + entries).ljust(count * BLOCK, b"\0")

    data_block = 2 + len(section(0)) // BLOCK
    header = struct.pack(
        "<BBHHHHHfHHf", 2, KEY, markers, 0, min(first, SATURATED), min(last, SATURATED), 0, -1.0,
        data_block, 0, take.rate,
    )  # fmt: skip
    header = header.ljust(294, b"\0") + struct.pack("<HHHH", 0, 0, 12_345, 0)
    return header.ljust(BLOCK, b"\0") + section(data_block)
