"""Damaged C3D files: each is refused in one line or read whole, fast and in little memory.

Mutations are drawn from seeds, so a failure can be repeated. What a file holds is not judged by the reader:
every base is known, and a mutation may not change its number of frames or markers unnoticed.
"""

from __future__ import annotations

import itertools
import signal
import struct
import time
import tracemalloc
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from oracles import c3d_slow
from oracles.c3d_slow import DEC, MIPS, PC, Entry, build
from realdata import real_captures

from evalkit.capture import Capture, read_capture, write_capture
from evalkit.errors import CaptureError

TOO_LONG = 5.0
TOO_LARGE = 2**30


@dataclass
class Base:
    """An intact file and what it holds."""

    name: str
    raw: bytes
    take: Capture
    data: int
    """Where its samples start."""


@dataclass
class Outcome:
    """What became of a set of damaged files."""

    counts: Counter = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    slowest: float = 0.0
    peak: int = 0


def crafted(folder: Path) -> list[Base]:
    """Small files of every encoding, with events, analog data, further groups; and two of our own writer."""
    rng = np.random.default_rng(1)
    trial = [
        Entry(-3, b"TRIAL", False), Entry(3, b"ACTUAL_START_FIELD", False, 2, (2,), b"\1\0\0\0"),
        Entry(3, b"ACTUAL_END_FIELD", False, 2, (2,), b"\x1e\0\0\0"), Entry(-7, b"NOTES", False),
        Entry(7, b"TEXT", False, -1, (8, 2), b"one     two     ", b"free text"),
    ]  # fmt: skip
    files = {}
    for processor, integer, channels in itertools.product((PC, DEC, MIPS), (False, True), (0, 4)):
        frames, markers = (30, 3) if channels else (30, 9)
        values = np.round(rng.uniform(-400, 400, (frames, markers, 3)) * 4) / 4
        points = [
            [(*values[i, m], 2.0) if rng.random() > 0.05 else None for m in range(markers)] for i in range(frames)
        ]
        files[f"{processor} {'integer' if integer else 'real'} {channels}"] = build(
            points, processor=processor, integer=integer, scale=0.25, rate=59.94, events=3,
            analog=[[float(k) for k in range(channels)]] * frames if channels else None, per_frame=2,
            extra=trial if processor == PC else None,
        )  # fmt: skip
    for name, shape, first in (
        ("own", (40, 5, 3), 1),
        ("own long", (66_000, 1, 3), 1),
        ("own one", (1, 2, 3), 7),
    ):
        take = Capture(rng.normal(0, 100, shape), [f"M{k}" for k in range(shape[1])], 120.0, "cm", first)
        write_capture(take, folder / "own.c3d")
        files[name] = (folder / "own.c3d").read_bytes()
    return [base(name, raw, folder) for name, raw in files.items()]


def base(name: str, raw: bytes, folder: Path) -> Base:
    path = folder / "base.c3d"
    path.write_bytes(raw)
    take = read_capture(path)
    long = take.frames if take.frames >= 65_535 else None
    slow = c3d_slow.take_apart(raw, long)
    assert (slow.frames, slow.markers) == take.points.shape[:2]
    return Base(name, raw, take, slow.data)


def mutate(base: Base, rng: np.random.Generator) -> tuple[bytes, str, bool]:
    """A damaged copy, what was done, and whether the samples are as they were."""
    raw = bytearray(base.raw)
    size, data = len(raw), base.data
    kind = rng.choice(["flip", "bytes", "word", "header", "real", "cut", "extend", "swap", "move", "zero"])
    if kind == "flip":
        for at in rng.integers(0, data, rng.integers(1, 4)):
            raw[at] ^= 1 << rng.integers(8)
    elif kind == "bytes":
        for at in rng.integers(0, data, rng.integers(1, 9)):
            raw[at] = rng.integers(256)
    elif kind == "word":
        at = int(rng.integers(0, data - 2))
        raw[at : at + 2] = struct.pack(
            "<H", rng.choice([0, 1, 2, 255, 32767, 32768, 65534, 65535, rng.integers(65536)])
        )
    elif kind == "header":
        at = 2 * int(rng.integers(0, 12))
        value = struct.unpack("<H", raw[at : at + 2])[0] + int(rng.choice([-2, -1, 1, 2, 256, -256, 32768]))
        raw[at : at + 2] = struct.pack("<H", value % 65536)
    elif kind == "real":
        names = [n for n in (b"SCALE", b"RATE", b"USED", b"FRAMES", b"DATA_START", b"LABELS") if n in raw[:data]]
        name = names[rng.integers(len(names))]
        at = raw.index(name) + len(name) + int(rng.integers(0, 8))
        raw[at : at + 4] = rng.bytes(4)
    elif kind == "cut":
        del raw[int(rng.choice([rng.integers(0, size), rng.integers(data, size), size - rng.integers(1, 600)])) :]
    elif kind == "extend":
        raw += rng.bytes(int(rng.choice([1, 16, 511, 512, 513, 4096, 70_000])))
    elif kind == "swap":
        a, b = 512 * rng.integers(0, max(1, size // 512), 2)
        raw[a : a + 512], raw[b : b + 512] = raw[b : b + 512], raw[a : a + 512]
    elif kind == "move":
        at, by = int(rng.integers(512, data)), int(rng.integers(1, 40))
        raw = raw[:at] + (raw[at + by :] if rng.random() < 0.5 else rng.bytes(by) + raw[at:])
    else:
        at = int(rng.integers(0, data))
        length = int(rng.integers(1, 64))
        raw[at : at + length] = bytes(len(raw[at : at + length]))
    return bytes(raw), str(kind), raw[data:] == base.raw[data:]


def judge(read: Callable[[Path], Capture], base: Base, path: Path, kind: str, same_samples: bool) -> str | None:
    """What is wrong with how a damaged file was read, or None."""
    try:
        take = read(path)
    except CaptureError as error:
        return None if "\n" not in str(error) and path.name in str(error) else f"message: {error!s}"
    except Exception as error:  # the harness names whatever a reader lets through
        return f"{type(error).__name__}: {error}"
    if take.points.shape != base.take.points.shape:
        return f"read {take.points.shape}, the file holds {base.take.points.shape}"
    if kind == "cut" and path.stat().st_size < base.data + base.take.frames * frame_bytes(base):
        return "samples are missing and nothing was said"
    if same_samples and (take.unit, take.quantities) == (base.take.unit, base.take.quantities):
        # The last bit of the scale may differ between header and parameters, with a warning.
        tolerance = 1e-6 if take.warnings else 0.0
        if not np.allclose(take.points, base.take.points, rtol=tolerance, atol=0.0, equal_nan=True):
            return "other coordinates from the same samples"
        if abs(take.rate / base.take.rate - 1) > 1e-5:
            return f"read {take.rate} Hz, the file has {base.take.rate} Hz"
    return None


def frame_bytes(base: Base) -> int:
    slow = base.take.source.layout
    return slow.frame_bytes


def attack(
    read: Callable[[Path], Capture], bases: list[Base], number: int, seed: int, folder: Path
) -> Outcome:  # fmt: skip
    """Read `number` damaged files; every read is limited in time, all of them in memory."""

    def too_long(*_: object) -> None:
        raise TimeoutError

    outcome = Outcome()
    path = folder / "mutant.c3d"
    before = signal.signal(signal.SIGALRM, too_long)
    tracemalloc.start(1)
    try:
        for k in range(number):
            base = bases[k % len(bases)]
            rng = np.random.default_rng([seed, k])
            raw, kind, same = mutate(base, rng)
            path.write_bytes(raw)
            start = time.perf_counter()
            signal.setitimer(signal.ITIMER_REAL, TOO_LONG)
            fault = judge(read, base, path, kind, same)
            signal.setitimer(signal.ITIMER_REAL, 0)
            outcome.slowest = max(outcome.slowest, time.perf_counter() - start)
            outcome.counts[kind] += 1
            if fault is not None:
                outcome.faults.append(f"{base.name}, seed [{seed}, {k}], {kind}: {fault}")
        outcome.peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    return outcome


def assert_clean(outcome: Outcome) -> None:
    assert not outcome.faults, f"{len(outcome.faults)} faults, such as:\n" + "\n".join(outcome.faults[:10])
    assert outcome.slowest < TOO_LONG
    assert outcome.peak < TOO_LARGE
    assert len(outcome.counts) == 10


def naive_reader(path: Path) -> Capture:
    """Believes header and parameters, and takes what is there: the reader that the harness must catch."""
    raw = path.read_bytes()
    words = np.frombuffer(raw, "<u2", 10)
    markers, analog, first, last = (int(words[k]) for k in (1, 2, 3, 4))
    start, columns = 512 * (int(words[8]) - 1), 4 * markers + analog
    scale = float(np.frombuffer(raw, "<f4", 1, 12)[0])
    samples = np.frombuffer(raw[start:], "<f4" if scale < 0 else "<i2", -1 if scale < 0 else (len(raw) - start) // 2)
    samples = samples[: columns * min(len(samples) // columns, last - first + 1)].reshape(-1, columns)
    words4 = samples[:, : 4 * markers].reshape(-1, markers, 4).astype(float)
    points = np.where(words4[..., 3:] >= 0, words4[..., :3] * (scale if scale > 0 else 1.0), np.nan)
    return Capture(points, [f"M{k}" for k in range(markers)], 59.94)


@pytest.fixture(scope="module")
def bases(tmp_path_factory) -> list[Base]:
    return crafted(tmp_path_factory.mktemp("fuzz"))


def test_damaged_crafted_files(bases, tmp_path):
    assert_clean(attack(read_capture, bases, 2_100, 1, tmp_path))


def test_damaged_real_files(tmp_path):
    real = [base(path.name, path.read_bytes(), tmp_path) for path in real_captures()]
    assert_clean(attack(read_capture, real, 300, 2, tmp_path))


@pytest.mark.slow
def test_many_more_damaged_files(bases, tmp_path):
    assert_clean(attack(read_capture, bases, 10_000, 3, tmp_path))


@pytest.mark.filterwarnings("ignore")
def test_the_harness_catches_a_reader_that_believes_the_header(bases, tmp_path):
    pc = [base for base in bases if base.name in ("84 real 0", "84 integer 0", "84 real 4")]
    outcome = attack(naive_reader, pc, 300, 4, tmp_path)
    faults = Counter(fault.split(": ")[1].split(" ")[0] for fault in outcome.faults)
    assert faults["read"] > 30, faults
    assert any("cut: read" in fault for fault in outcome.faults)


def test_every_truncation_of_a_file_is_refused(tmp_path):
    """Byte by byte through a small file: only the padding may go."""
    raw = build([[(1.0 + i, 2.0, 3.0, 0.0)] * 2 for i in range(12)], events=1)
    whole = base("small", raw, tmp_path)
    end = whole.data + 12 * 32
    path = tmp_path / "cut.c3d"
    for size in range(len(raw)):
        path.write_bytes(raw[:size])
        if size >= end:
            assert read_capture(path).frames == 12
        else:
            with pytest.raises(CaptureError):
                read_capture(path)
