"""Read C3D files: every bound is checked before the data block is touched.

Structure after "The C3D file format user guide", Motion Lab Systems.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit.capture.c3d_format import BLOCK, KEY, LARGEST, Processor
from evalkit.capture.c3d_parameters import ParameterSection, walk
from evalkit.capture.files import FileSource, read_bytes, shown, size_of_regular_file
from evalkit.capture.labels import printable, unique_labels
from evalkit.capture.model import MILLIMETRES, Capture
from evalkit.errors import CaptureError

SATURATED = 65_535
"""The largest count that a 2-byte field can state; longer takes state it and give the truth elsewhere."""

QUANTITIES = {
    "ANGLES": "angle", "FORCES": "force", "MOMENTS": "moment", "POWERS": "power", "SCALARS": "scalar",
}  # fmt: skip
"""Parameters of POINT that list points which are no positions, and what these measure."""

UNIT_NAMES = {
    "mm": ("mm", "millimeter", "millimeters", "millimetre", "millimetres"),
    "cm": ("cm", "centimeter", "centimeters", "centimetre", "centimetres"),
    "m": ("m", "meter", "meters", "metre", "metres"),
    "in": ("in", "inch", "inches"),
}

SAMPLES_AT_ONCE = 1 << 17
"""Samples converted at a time: few enough to stay in the cache, many enough to cost no overhead."""


@dataclass(frozen=True)
class Layout:
    """Where the samples of a C3D file are, and how they are stored."""

    processor: Processor
    integer: bool
    """Whether samples are 2-byte integers, to be multiplied by `scale`; else 4-byte reals."""
    scale: float
    start: int
    """First byte of the data."""
    frames: int
    markers: int
    analog: int
    """Analog samples in one 3-D frame, all channels together."""

    @property
    def dtype(self) -> np.dtype:
        """Type of one stored sample."""
        return self.processor.integer_type if self.integer else self.processor.real_type

    @property
    def columns(self) -> int:
        """Samples of one frame: four a marker, then the analog ones."""
        return 4 * self.markers + self.analog

    @property
    def frame_bytes(self) -> int:
        """Bytes of one frame."""
        return self.columns * self.dtype.itemsize

    @property
    def end(self) -> int:
        """Byte after the last frame."""
        return self.start + self.frames * self.frame_bytes

    def samples(self, raw: bytes) -> NDArray[Any]:
        """All samples as stored, a view of `raw`, shape (F, columns)."""
        count = self.frames * self.columns
        return np.frombuffer(raw, self.dtype, count, self.start).reshape(self.frames, self.columns)


@dataclass(frozen=True, eq=False)
class C3DSource(FileSource):
    """What a processed copy of a C3D file needs of the original.

    `labels` to `quantities` repeat what the take said when it was read: a copy that replaces only the
    points is possible as long as they still hold.
    """

    raw: bytes
    section: ParameterSection
    layout: Layout
    labels: tuple[str, ...]
    rate: float
    unit: str
    first_frame: int
    axes: tuple[str, str] | None
    quantities: tuple[str, ...]


def read_c3d(path: Path) -> Capture:
    """Read a C3D file; see :func:`evalkit.capture.read_capture`."""
    try:
        return _read(path)
    except CaptureError as error:
        text = str(error)
        raise (error if text.startswith(shown(path)) else CaptureError(f"{shown(path)}: {text}")) from None
    except MemoryError:
        raise CaptureError(f"{shown(path)}: does not fit into memory; cut the take into parts") from None


def _read(path: Path) -> Capture:
    size = size_of_regular_file(path)
    try:
        with path.open("rb") as stream:
            head = stream.read(2)
    except OSError as error:
        raise CaptureError(f"cannot be read ({(error.strerror or '').lower()})") from None
    # Whatever large file was named by mistake is refused before it is loaded.
    if len(head) < 2 or head[1] != KEY:
        raise CaptureError("not a C3D file (its second byte is not 0x50); name a .c3d capture")
    if size < 2 * BLOCK:
        raise CaptureError(f"cut short: {size} bytes, and a C3D file has at least {2 * BLOCK}; get a complete copy")
    raw = read_bytes(path)
    if len(raw) < size:
        raise CaptureError("became shorter while it was read; try again")
    warnings: list[str] = []
    layout, section, rate, first = _layout(raw, warnings)
    labels = _labels(section, layout.markers, warnings)
    quantities = _quantities(section, labels)
    unit = _unit(section, warnings)
    axes = _axes(section, warnings)
    source = C3DSource(path.absolute(), raw, section, layout, tuple(labels), rate, unit, first, axes, tuple(quantities))
    return Capture._adopt(
        _points(raw, layout, unit, quantities),
        labels=labels, rate=rate, unit=unit, first_frame=first, axes=axes, quantities=quantities,
        warnings=warnings, source=source,
    )  # fmt: skip


def _layout(raw: bytes, warnings: list[str]) -> tuple[Layout, ParameterSection, float, int]:
    """Find the samples from header and parameters, which must agree; also the rate and the first frame."""
    if raw[0] < 2:
        raise CaptureError(f"header points to the parameters at block {raw[0]}, inside itself; the file is damaged")
    start = BLOCK * (raw[0] - 1)
    if start + BLOCK > len(raw):
        raise CaptureError(
            f"cut short: its parameters start at byte {start}, the file has {len(raw)}; get a complete copy"
        )
    code = raw[start + 3]
    if code not in tuple(Processor):
        raise CaptureError(f"unknown processor code {code} (expected 84, 85 or 86); the file is damaged or no C3D")
    processor = Processor(code)
    words = np.frombuffer(raw, processor.order + "u2", 10)
    markers, analog, first, last, data_block, per_frame = (int(words[k]) for k in (1, 2, 3, 4, 8, 9))
    scale, rate = processor.decode(np.frombuffer(raw, processor.real_type, 256)[[3, 5]])

    limit = BLOCK * (data_block - 1) if data_block else len(raw)
    if limit > len(raw) or (data_block and limit <= start):
        raise CaptureError(
            f"cut short or damaged: the header puts the data at byte {limit}, the file has {len(raw)}; "
            "get a complete copy"
        )
    section = walk(raw, start, limit, processor)
    warnings += section.warnings
    if "POINT" not in section.groups.values():
        raise CaptureError("parameter group POINT is missing; the file is damaged or holds no markers")
    data_start = _data_start(section, data_block)
    if data_start > len(raw) or data_start < section.end:
        raise CaptureError(f"its data cannot start at byte {data_start}; the file is damaged")
    if raw[section.end : data_start].strip(b"\0 "):
        raise CaptureError(f"parameter list ends early at byte {section.end}; the file is damaged")

    used = section.count("POINT", "USED")
    if used != markers:
        raise CaptureError(f"header says {markers} markers, POINT:USED says {_said(used)}; the file is damaged")
    if markers == 0:
        raise CaptureError("holds no markers (POINT:USED is 0); name a capture with 3-D points")
    layout = Layout(
        processor, *_scale(section, scale, warnings), data_start, 0, markers,
        _analog(section, analog, per_frame, warnings),
    )  # fmt: skip
    frames, first = _frames(section, layout, len(raw) - data_start, first, last, warnings)
    layout = Layout(processor, layout.integer, layout.scale, data_start, frames, markers, layout.analog)
    return layout, section, _rate(section, float(rate), warnings), first


def _said(value: float | None) -> str:
    return "nothing" if value is None else f"{value:g}"


def _data_start(section: ParameterSection, header: int) -> int:
    stated = section.count("POINT", "DATA_START") or 0
    if header and stated and header != stated:
        raise CaptureError(f"header says data block {header}, POINT:DATA_START {stated}; the file is damaged")
    if not (header or stated):
        raise CaptureError("neither header nor POINT:DATA_START say where the data are; the file is damaged")
    return BLOCK * ((header or stated) - 1)


def _scale(section: ParameterSection, header: float, warnings: list[str]) -> tuple[bool, float]:
    """Whether samples are integers, and their scale (POINT:SCALE; its sign tells the two apart)."""
    stated = section.number("POINT", "SCALE")
    if stated is None or not 1e-12 < abs(stated) < 1e12:
        raise CaptureError(f"POINT:SCALE says {_said(stated)}, no usable scale; the file is damaged")
    integer = stated > 0
    if header == 0:
        warnings.append("the header states no scale; POINT:SCALE is used")
    elif not np.isfinite(header) or (header > 0) != integer:
        raise CaptureError(f"header scale {header:g} and POINT:SCALE {stated:g} differ in sign; the file is damaged")
    elif integer and abs(header - stated) > 1e-6 * stated:
        raise CaptureError(f"header scale is {header:g}, POINT:SCALE {stated:g}; the file is damaged")
    elif integer and header != stated:
        warnings.append(f"header scale is {header:.9g}, POINT:SCALE {stated:.9g}; the latter is used")
    return integer, abs(stated)


def _rate(section: ParameterSection, header: float, warnings: list[str]) -> float:
    stated = section.number("POINT", "RATE")
    rate = header if stated is None else stated
    if not 1e-3 <= rate <= 1e6:
        raise CaptureError(f"frame rate {rate:g} Hz is not possible; correct POINT:RATE")
    if stated is None:
        warnings.append("POINT:RATE is missing; the header's rate is used")
    elif header == 0:
        warnings.append("the header states no rate; POINT:RATE is used")
    elif not abs(header - stated) <= 1e-5 * stated:
        raise CaptureError(f"header says {header:g} Hz, POINT:RATE {stated:g} Hz; correct one of them")
    elif header != stated:
        warnings.append(f"the header says {header:.9g} Hz, POINT:RATE {stated:.9g} Hz; the latter is used")
    return rate


def _analog(section: ParameterSection, header: int, per_frame: int, warnings: list[str]) -> int:
    """Analog samples in a frame: what the header says, if ANALOG:USED agrees."""
    used = section.count("ANALOG", "USED")
    if header and (per_frame == 0 or header % per_frame):
        raise CaptureError(f"{header} analog samples a frame cannot be {per_frame} a channel; the file is damaged")
    if used is not None and (used * per_frame != header if header else used > 0):
        raise CaptureError(
            f"header says {header} analog samples a frame, ANALOG:USED {used} x {per_frame}; file damaged"
        )
    rates = section.number("ANALOG", "RATE"), section.number("POINT", "RATE")
    if header and rates[0] and rates[1] and abs(rates[0] / rates[1] - per_frame) > 1e-3 * per_frame:
        warnings.append(f"ANALOG:RATE {rates[0]:g} Hz is not {per_frame} times the frame rate")
    return header


def _field(section: ParameterSection, name: str) -> int | None:
    """A frame number of group TRIAL: two words, the lower first (or one number)."""
    found = section.find("TRIAL", name)
    if found is None or found.kind == -1:
        return None
    values = found.numbers()
    if values.size == 0 or not np.isfinite(values[0]):
        return None
    high = values[1] if found.kind == 2 and values.size > 1 else 0.0
    return int(values[0] + 65_536.0 * high)


def _frames(
    section: ParameterSection, layout: Layout, room: int, first: int, last: int, warnings: list[str]
) -> tuple[int, int]:
    """Number of frames, and the number of the first one.

    Header, TRIAL, LONG_FRAMES and FRAMES may all state a count. A saturated 2-byte field only counts where
    nothing else is stated. Exactly one stated count must fill the file to less than one frame or block.
    """
    stated: dict[str, int] = {}
    start, end = _field(section, "ACTUAL_START_FIELD"), _field(section, "ACTUAL_END_FIELD")
    if start is not None and end is not None and end >= start:
        stated["TRIAL"] = end - start + 1
    for name in ("LONG_FRAMES", "FRAMES"):
        value = section.number("POINT", name)
        # A float32 holds whole numbers only up to 2**24.
        if value is not None and 0 < value <= 2**24:
            stated[f"POINT:{name}"] = int(value)
    if last >= first:
        stated["header"] = last - first + 1
    if first == 0 and "header" in stated:
        # Frames count from 1: a header that starts at 0 may mean the first `last` frames or one more.
        stated["header, counting from 1"] = last
        others = [n for name, n in stated.items() if not name.startswith("header")]
        if last in others:
            del stated["header"]
        elif last + 1 in others:
            del stated["header, counting from 1"]
        warnings.append("the header's first frame is 0")
    if not stated:
        raise CaptureError(f"holds no frames (header: {first} to {last}); the file is empty or damaged")

    saturated = {"header", "header, counting from 1"} if last == SATURATED else set()
    saturated |= {name for name, count in stated.items() if name == "POINT:FRAMES" and count == SATURATED}
    certain = {name: count for name, count in stated.items() if name not in saturated} or stated
    surplus = max(BLOCK, layout.frame_bytes)
    fitting = {n for n in certain.values() if 0 <= room - n * layout.frame_bytes < surplus}
    if len(fitting) > 1:
        raise CaptureError(f"{_list(certain)}, and each would fit; the file is damaged")
    if not fitting:
        whole = room // layout.frame_bytes
        name, count = max(certain.items(), key=lambda item: item[1])
        if count > whole:
            raise CaptureError(
                f"cut short: {name} promises {count} frames, the file holds {whole}; get a complete copy"
            )
        raise CaptureError(
            f"{name} promises {count} frames, but the file has room for {whole}; its header or size is wrong"
        )
    frames = fitting.pop()
    if any(n != frames for n in certain.values()):
        warnings.append(f"{_list(certain)}; the size of the file confirms {frames}")
    if stated.get("TRIAL") == frames and start:
        return frames, start
    return frames, max(first, 1)


def _list(stated: dict[str, int]) -> str:
    return ", ".join(f"{name} says {count} frames" for name, count in stated.items())


def _labels(section: ParameterSection, markers: int, warnings: list[str]) -> list[str]:
    """One unique, printable label a marker."""
    labels = section.series("POINT", "LABELS")[:markers]
    if len(labels) < markers:
        warnings.append(f"{markers - len(labels)} of {markers} markers have no label in POINT:LABELS")
        labels += [""] * (markers - len(labels))
    return unique_labels(labels, warnings)


def _quantities(section: ParameterSection, labels: list[str]) -> list[str]:
    kinds = {name: quantity for key, quantity in QUANTITIES.items() for name in section.series("POINT", key)}
    kinds.pop("", None)
    return [kinds.get(label, "position") for label in labels]


def _unit(section: ParameterSection, warnings: list[str]) -> str:
    stated = (section.series("POINT", "UNITS") or [""])[0]
    for unit, names in UNIT_NAMES.items():
        if stated.lower() in names:
            return unit
    warnings.append(
        f"POINT:UNITS is '{printable(stated)}', no known unit; millimetres are assumed"
        if stated
        else "POINT:UNITS is missing or blank; millimetres are assumed"
    )
    return "mm"


def _axes(section: ParameterSection, warnings: list[str]) -> tuple[str, str] | None:
    right, up = ((section.series("POINT", name) or [""])[0].upper() for name in ("X_SCREEN", "Y_SCREEN"))
    if not (right or up):
        return None
    pattern = re.compile(r"[+-]?[XYZ]")
    if not (pattern.fullmatch(right) and pattern.fullmatch(up)) or right[-1] == up[-1]:
        warnings.append("POINT:X_SCREEN and Y_SCREEN name no two axes and are ignored")
        return None
    return (right if len(right) > 1 else f"+{right}", up if len(up) > 1 else f"+{up}")


def factors(unit: str, quantities: tuple[str, ...] | list[str]) -> NDArray[np.float64]:
    """What to multiply a file's numbers with to get a take's, shape (M,): only positions have a length."""
    return np.array([MILLIMETRES[unit] if kind == "position" else 1.0 for kind in quantities])


def blocks(layout: Layout) -> list[slice]:
    """Runs of frames that together make the take."""
    step = max(1, SAMPLES_AT_ONCE // layout.columns)
    return [slice(k, min(k + step, layout.frames)) for k in range(0, layout.frames, step)]


def _points(raw: bytes, layout: Layout, unit: str, quantities: list[str]) -> NDArray[np.float64]:
    """Positions of the whole take, mm, NaN where occluded: residual below 0 or all coordinates 0."""
    scale = layout.scale if layout.integer else 1.0
    each = factors(unit, quantities) * scale
    multiplier = float(each[0]) if np.ptp(each) == 0 else each
    samples = layout.samples(raw)
    points = np.empty((layout.frames, layout.markers, 3))
    for run in blocks(layout):
        stored = samples[run, : 4 * layout.markers]
        if stored.dtype.kind == "u":
            stored = layout.processor.decode(stored)
        stored = stored.reshape(-1, layout.markers, 4)
        out = points[run]
        with np.errstate(invalid="ignore", over="ignore"):
            for axis in range(3):
                np.multiply(stored[..., axis], multiplier, out=out[..., axis], dtype=np.float64)
            reach = np.abs(out[..., 0])
            reach += np.abs(out[..., 1])
            reach += np.abs(out[..., 2])
            # Comparisons with NaN are false: a damaged coordinate is no position either.
            seen = (reach > 0) & (reach < LARGEST) & (stored[..., 3] >= 0)
        if not seen.all():
            out[~seen] = np.nan
    return points
