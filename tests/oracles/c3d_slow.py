"""C3D files built and taken apart byte by byte, slowly and without the package: the oracle of its tests.

Written from "The C3D file format user guide", Motion Lab Systems.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field

PC, DEC, MIPS = 84, 85, 86


def order(processor: int) -> str:
    return ">" if processor == MIPS else "<"


def put_int(value: int, processor: int) -> bytes:
    return struct.pack(order(processor) + "H", value & 0xFFFF)


def get_int(raw: bytes, processor: int) -> int:
    return struct.unpack(order(processor) + "h", raw)[0]


def put_real(value: float, processor: int) -> bytes:
    if processor != DEC:
        return struct.pack(order(processor) + "f", value)
    if value == 0:
        return bytes(4)
    fraction, exponent = math.frexp(abs(value))
    mantissa = round(fraction * 2**24)
    if mantissa == 2**24:
        mantissa, exponent = 2**23, exponent + 1
    biased = exponent + 128
    assert 0 < biased < 256
    mantissa -= 2**23
    upper = (0x8000 if value < 0 else 0) | (biased << 7) | (mantissa >> 16)
    return struct.pack("<HH", upper, mantissa & 0xFFFF)


def get_real(raw: bytes, processor: int) -> float:
    if processor != DEC:
        return struct.unpack(order(processor) + "f", raw)[0]
    upper, lower = struct.unpack("<HH", raw)
    sign = -1.0 if upper & 0x8000 else 1.0
    biased = (upper >> 7) & 0xFF
    if biased == 0:
        return math.nan if sign < 0 else 0.0
    return sign * math.ldexp(2**23 + ((upper & 0x7F) << 16) + lower, biased - 128 - 24)


@dataclass
class Entry:
    """A group (`values` None) or parameter, with the bytes as they stand in the file."""

    group: int
    name: bytes
    locked: bool
    kind: int = 0
    shape: tuple[int, ...] = ()
    values: bytes | None = None
    description: bytes = b""


@dataclass
class Taken:
    """A C3D file taken apart."""

    raw: bytes
    processor: int
    header: bytes
    entries: list[Entry]
    data: int
    markers: int
    analog: int
    integer: bool
    frames: int
    points: list[list[list[bytes]]] = field(default_factory=list)
    """Four stored words of every marker of every frame."""
    samples: list[bytes] = field(default_factory=list)
    """Analog bytes of every frame."""

    @property
    def width(self) -> int:
        return 2 if self.integer else 4

    def group_names(self) -> dict[int, str]:
        return {-e.group: e.name.decode().upper() for e in self.entries if e.values is None}

    def parameter(self, group: str, name: str) -> Entry | None:
        numbers = [n for n, text in self.group_names().items() if text == group]
        for entry in self.entries:
            if entry.values is not None and entry.group in numbers and entry.name.decode().upper() == name:
                return entry
        return None

    def word(self, raw: bytes) -> float:
        return get_int(raw, self.processor) if self.integer else get_real(raw, self.processor)


def take_apart(raw: bytes, frames: int | None = None) -> Taken:
    """Every part of a well-formed file; `frames` where the header cannot say how many there are."""
    at = (raw[0] - 1) * 512
    processor = raw[at + 3]
    assert raw[1] == 0x50
    entries = []
    at += 4
    while raw[at] != 0:
        length = struct.unpack("b", raw[at : at + 1])[0]
        group = struct.unpack("b", raw[at + 1 : at + 2])[0]
        name = raw[at + 2 : at + 2 + abs(length)]
        place = at + 2 + abs(length)
        pointer = struct.unpack(order(processor) + "H", raw[place : place + 2])[0]
        entry = Entry(group, name, length < 0)
        cursor = place + 2
        if group > 0:
            entry.kind = struct.unpack("b", raw[cursor : cursor + 1])[0]
            entry.shape = tuple(raw[cursor + 2 : cursor + 2 + raw[cursor + 1]])
            cursor += 2 + len(entry.shape)
            size = abs(entry.kind)
            for extent in entry.shape:
                size *= extent
            entry.values = raw[cursor : cursor + size]
            cursor += size
        entry.description = raw[cursor + 1 : cursor + 1 + raw[cursor]]
        entries.append(entry)
        if pointer == 0:
            break
        at = place + pointer
    words = [struct.unpack(order(processor) + "H", raw[k : k + 2])[0] for k in range(2, 20, 2)]
    markers, analog, first, last = words[:4]
    data = (words[7] - 1) * 512
    integer = get_real(raw[12:16], processor) > 0
    taken = Taken(raw, processor, raw[:512], entries, data, markers, analog, integer, frames or last - first + 1)
    width = taken.width
    cursor = data
    for _ in range(taken.frames):
        frame = []
        for _ in range(markers):
            frame.append([raw[cursor + k * width : cursor + (k + 1) * width] for k in range(4)])
            cursor += 4 * width
        taken.points.append(frame)
        taken.samples.append(raw[cursor : cursor + analog * width])
        cursor += analog * width
    assert cursor <= len(raw)
    return taken


def entry_bytes(entry: Entry, processor: int, pointer: int | None = None) -> bytes:
    body = b""
    if entry.values is not None:
        body = struct.pack("bB", entry.kind, len(entry.shape)) + bytes(entry.shape) + entry.values
    body += bytes([len(entry.description)]) + entry.description
    length = -len(entry.name) if entry.locked else len(entry.name)
    distance = len(body) + 2 if pointer is None else pointer
    return struct.pack("bb", length, entry.group) + entry.name + put_int(distance, processor) + body


def build(
    points: list[list[tuple[float, float, float, float] | None]],
    *,
    processor: int = PC,
    integer: bool = False,
    scale: float = 0.1,
    rate: float = 60.0,
    first: int = 1,
    analog: list[list[float]] | None = None,
    per_frame: int = 1,
    labels: list[str] | None = None,
    unit: str | None = "mm",
    events: int = 0,
    extra: list[Entry] | None = None,
    header: dict[int, bytes] | None = None,
    change: dict[str, Entry | None] | None = None,
    pad: bool = True,
) -> bytes:
    """A C3D file.

    `points` holds for every frame and marker x, y, z (in the file's unit) and the fourth word, or None
    for an occluded one. `header` replaces bytes at offsets of the header, `change` parameters of group
    POINT (None leaves one out).
    """
    frames, markers = len(points), len(points[0])
    channels = len(analog[0]) if analog else 0
    labels = [f"M{k}" for k in range(markers)] if labels is None else labels
    stored_scale = put_real(scale if integer else -scale, processor)
    width = max([1, *(len(label.encode()) for label in labels)])

    def strings(name: str, values: list[str], extent: int) -> Entry:
        text = b"".join(value.encode().ljust(extent) for value in values)
        return Entry(1, name.encode(), False, -1, (extent, len(values)), text, b"")

    point = {
        "USED": Entry(1, b"USED", True, 2, (), put_int(markers, processor), b"* number of points"),
        "SCALE": Entry(1, b"SCALE", True, 4, (), stored_scale),
        "RATE": Entry(1, b"RATE", True, 4, (), put_real(rate, processor), b"* frames a second"),
        "DATA_START": Entry(1, b"DATA_START", True, 2, (), put_int(0, processor)),
        "FRAMES": Entry(1, b"FRAMES", True, 2, (), put_int(min(frames, 65535), processor)),
        "LABELS": strings("LABELS", labels, width),
        "DESCRIPTIONS": strings("DESCRIPTIONS", ["marker"] * len(labels), 8),
    }
    if unit is not None:
        point["UNITS"] = Entry(1, b"UNITS", False, -1, (4,), unit.encode().ljust(4), b"unit of length")
    for name, entry in (change or {}).items():
        if entry is None:
            point.pop(name, None)
        else:
            point[name] = entry
    entries = [
        Entry(-1, b"POINT", False, description=b"3-D points"),
        *point.values(),
        Entry(-2, b"ANALOG", False),
        Entry(2, b"USED", True, 2, (), put_int(channels // per_frame, processor)),
        Entry(2, b"RATE", True, 4, (), put_real(rate * per_frame, processor)),
        Entry(2, b"GEN_SCALE", True, 4, (), put_real(1.0, processor)),
        *(extra or []),
    ]

    def section(block: int) -> bytes:
        if "DATA_START" in point and not (change and "DATA_START" in change):
            point["DATA_START"].values = put_int(block, processor)
        body = b"".join(entry_bytes(entry, processor) for entry in entries) + b"\0\0"
        blocks = math.ceil((len(body) + 4) / 512)
        return (bytes([1, 0x50, blocks, processor]) + body).ljust(512 * blocks, b"\0")

    block = 2 + len(section(0)) // 512
    head = bytearray(512)
    head[0:2] = bytes([2, 0x50])
    head[2:12] = b"".join(
        put_int(value, processor) for value in (markers, channels, first, min(first + frames - 1, 65535), 10)
    )
    head[12:16] = stored_scale
    head[16:18] = put_int(block, processor)
    head[18:20] = put_int(per_frame if channels else 0, processor)
    head[20:24] = put_real(rate, processor)
    head[294:302] = b"".join(put_int(value, processor) for value in (0, 0, 12345, events))
    for k in range(events):
        head[304 + 4 * k : 308 + 4 * k] = put_real(0.5 + k, processor)
        head[376 + k] = 1
        head[396 + 4 * k : 400 + 4 * k] = f"EV{k:02d}".encode()
    for offset, raw in (header or {}).items():
        head[offset : offset + len(raw)] = raw

    data = bytearray()
    for number, frame in enumerate(points):
        for marker in frame:
            x, y, z, word = (0.0, 0.0, 0.0, -1.0) if marker is None else marker
            if integer:
                data += b"".join(put_int(round(value / scale), processor) for value in (x, y, z))
                data += put_int(int(word), processor)
            else:
                data += b"".join(put_real(value, processor) for value in (x, y, z, word))
        for value in analog[number] if analog else ():
            data += put_int(int(value), processor) if integer else put_real(value, processor)
    if pad:
        data += bytes(-len(data) % 512)
    return bytes(head) + section(block) + bytes(data)
