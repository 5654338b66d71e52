"""The parameter section of a C3D file, walked with every bound checked.

Structure after "The C3D file format user guide", Motion Lab Systems: a chain of groups and parameters,
each with the distance to the next, a name, and for parameters a type, up to seven dimensions, the values
and a description.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import prod

import numpy as np
from numpy.typing import NDArray

from evalkit.capture.c3d_format import Processor
from evalkit.errors import CaptureError

MOST_ENTRIES = 20_000
"""More groups and parameters than any file has; a crafted chain of millions would take minutes to walk."""

UNIQUE_GROUPS = ("POINT", "ANALOG", "TRIAL")
"""Groups in which a repeated parameter changes how the data are read."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter as stored: `kind` -1 (characters), 1 (bytes), 2 (integers) or 4 (reals)."""

    group: int
    name: str
    kind: int
    shape: tuple[int, ...]
    offset: int
    raw: bytes
    processor: Processor

    def numbers(self) -> NDArray[np.float64]:
        """Its values as float64, flat; integers as unsigned, for counts in C3D files go up to 65,535."""
        if self.kind == 4:
            return self.processor.decode(np.frombuffer(self.raw, self.processor.real_type))
        if self.kind == 2:
            return np.frombuffer(self.raw, self.processor.order + "u2").astype(np.float64)
        return np.frombuffer(self.raw, np.uint8).astype(np.float64)

    def texts(self) -> list[str]:
        """Its character strings without padding; the first dimension is their width."""
        width = self.shape[0] if self.shape else 1
        if not self.raw:
            # Without characters the other dimensions are bound by nothing.
            return []
        count = prod(self.shape[1:])
        return [text(self.raw[k * width : (k + 1) * width]) for k in range(count)]


@dataclass(slots=True)
class ParameterSection:
    """All groups and parameters of a file, in its order."""

    processor: Processor
    groups: dict[int, str] = field(default_factory=dict)
    parameters: list[Parameter] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    end: int = 0
    """Byte after the last entry."""

    _by_name: dict[tuple[str, str], Parameter] = field(default_factory=dict)

    def find(self, group: str, name: str) -> Parameter | None:
        """The parameter of that name (upper case), or None."""
        return self._by_name.get((group, name))

    def number(self, group: str, name: str) -> float | None:
        """First value of a numeric parameter, or None where there is none."""
        found = self.find(group, name)
        if found is None or found.kind == -1:
            return None
        values = found.numbers()
        return float(values[0]) if values.size else None

    def count(self, group: str, name: str) -> int | None:
        """A numeric parameter that must be a whole number, or None where there is none."""
        value = self.number(group, name)
        if value is None:
            return None
        if not 0 <= value < 2**53 or value != int(value):
            raise CaptureError(f"{group}:{name} is {value:g}, not a count; the file is damaged")
        return int(value)

    def series(self, group: str, name: str) -> list[str]:
        """Strings of NAME, NAME2, NAME3 ... in one list, as files with over 255 points continue them."""
        joined: list[str] = []
        number = 1
        while (found := self.find(group, name if number == 1 else f"{name}{number}")) is not None:
            if found.kind == -1:
                joined += found.texts()
            number += 1
        return joined


def text(raw: bytes) -> str:
    """Characters up to the first NUL without surrounding blanks: UTF-8 where valid, else Latin-1."""
    raw = raw.split(b"\0", 1)[0].strip()
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def walk(raw: bytes, start: int, limit: int, processor: Processor) -> ParameterSection:
    """Read the chain of groups and parameters.

    Parameters
    ----------
    raw : bytes
        The file, at least up to `limit`.
    start : int
        Byte of the section's 4-byte preamble.
    limit : int
        First byte that is no longer part of the section: where the data start.

    Raises
    ------
    CaptureError
        If a name, pointer, dimension, value or description leaves its entry or the section.
    """
    section = ParameterSection(processor)
    at = start + 4
    for _ in range(MOST_ENTRIES):
        if at == limit:
            break
        if at + 2 > limit:
            raise CaptureError(f"parameter section runs into the data at byte {at}; the file is damaged")
        length = raw[at] - 256 if raw[at] > 127 else raw[at]
        if length == 0:
            break
        following = _entry(raw, at, abs(length), limit, section)
        if following is None:
            at = section.end
            break
        at = following
    else:
        raise CaptureError(f"over {MOST_ENTRIES} parameters; the file is damaged")
    section.end = at
    _index(section)
    return section


def _entry(raw: bytes, at: int, length: int, limit: int, section: ParameterSection) -> int | None:
    """Read one group or parameter at byte `at`; return where the next one starts, or None for the last."""
    identifier = raw[at + 1] - 256 if raw[at + 1] > 127 else raw[at + 1]
    pointer_at = at + 2 + length
    if pointer_at + 3 > limit:
        raise CaptureError(f"parameter name at byte {at} runs into the data; the file is damaged")
    name_bytes = raw[at + 2 : pointer_at]
    if identifier == 0 or any(letter < 32 or letter == 127 for letter in name_bytes):
        raise CaptureError(f"parameter entry at byte {at} has no valid name or group; the file is damaged")
    name = name_bytes.decode("latin-1").strip().upper()
    order = "big" if section.processor is Processor.MIPS else "little"
    pointer = int.from_bytes(raw[pointer_at : pointer_at + 2], order)  # type: ignore[arg-type]
    end = pointer_at + pointer if pointer else limit
    if end > limit:
        raise CaptureError(f"parameter {name} points {end - limit} bytes beyond the section; the file is damaged")
    cursor = pointer_at + 2
    parameter = None
    if identifier > 0:
        kind = raw[cursor] - 256 if raw[cursor] > 127 else raw[cursor]
        if cursor + 2 > end or kind not in (-1, 1, 2, 4) or raw[cursor + 1] > 7:
            raise CaptureError(f"parameter {name} has an impossible type or number of dimensions; file damaged")
        shape = tuple(raw[cursor + 2 : cursor + 2 + raw[cursor + 1]])
        cursor += 2 + len(shape)
        size = prod(shape) * abs(kind)
        if cursor + size > end:
            raise CaptureError(f"values of parameter {name} ({size} bytes) leave its entry; the file is damaged")
        parameter = Parameter(identifier, name, kind, shape, cursor, raw[cursor : cursor + size], section.processor)
        cursor += size
    if cursor >= end or cursor + 1 + raw[cursor] > end:
        raise CaptureError(f"description of parameter {name} leaves its entry; the file is damaged")
    cursor += 1 + raw[cursor]
    if pointer:
        _check_gap(raw, cursor, end, name, section)
    if parameter is not None:
        section.parameters.append(parameter)
    elif -identifier in section.groups:
        raise CaptureError(f"two parameter groups have the number {-identifier}; the file is damaged")
    else:
        section.groups[-identifier] = name
    section.end = end if pointer else cursor
    return end if pointer else None


def _check_gap(raw: bytes, start: int, end: int, name: str, section: ParameterSection) -> None:
    """Refuse a pointer that jumps over further entries; other bytes left in an entry are only odd."""
    gap = raw[start:end]
    if not gap.strip(b"\0 "):
        return
    length = abs(gap[0] - 256 if gap[0] > 127 else gap[0])
    hidden = gap[2 : 2 + length]
    if 0 < length < len(gap) - 4 and gap[1] and all(32 < letter < 127 for letter in hidden):
        raise CaptureError(f"parameter {name} points past the next entry; the file is damaged")
    section.warnings.append(f"parameter {name} is followed by {len(gap)} stray bytes")


def _index(section: ParameterSection) -> None:
    """Make parameters findable by name, and judge duplicates."""
    names = list(section.groups.values())
    twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
    if twice is not None:
        raise CaptureError(f"parameter group {twice} is there twice; the file is damaged")
    orphans = sorted({p.group for p in section.parameters} - set(section.groups))
    if orphans:
        section.warnings.append(f"parameters of undefined group {', '.join(map(str, orphans))}")
    for parameter in section.parameters:
        key = (section.groups.get(parameter.group, ""), parameter.name)
        if key in section._by_name:
            if key[0] in UNIQUE_GROUPS:
                raise CaptureError(f"parameter {key[0]}:{key[1]} is there twice; the file is damaged")
            section.warnings.append(f"parameter {key[0]}:{key[1]} is there twice; the first counts")
        else:
            section._by_name[key] = parameter
