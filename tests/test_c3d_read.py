"""Reading C3D: all encodings alike, agreement with other readers, counts, units, and files that lie."""

from __future__ import annotations

import ast
import os
import struct
import sys
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest
from oracles import c3d_slow
from oracles.c3d_slow import DEC, MIPS, PC, Entry, build
from realdata import real_captures, real_data

from evalkit import capture
from evalkit.capture import MILLIMETRES, read_capture
from evalkit.capture.c3d_format import Processor, float64_to_vax, vax_to_float64
from evalkit.errors import CaptureError

RNG = np.random.default_rng(7)


def points_of(frames: int, markers: int, grid: float = 0.5) -> list:
    values = np.round(RNG.uniform(-900, 900, (frames, markers, 3)) / grid) * grid
    return [[(*values[i, m], 3.0) for m in range(markers)] for i in range(frames)]


def save(folder: Path, raw: bytes, name: str = "take.c3d") -> Path:
    path = folder / name
    path.write_bytes(raw)
    return path


def positions(points: list, factor: float = 1.0) -> np.ndarray:
    return np.array([[(np.nan,) * 3 if p is None else p[:3] for p in frame] for frame in points]) * factor


def refuse(folder: Path, raw: bytes, *words: str) -> str:
    path = save(folder, raw, "refused.c3d")
    with pytest.raises(CaptureError) as caught:
        read_capture(path)
    message = str(caught.value)
    assert "\n" not in message and message.startswith(str(path)), message
    for word in words:
        assert word in message, message
    return message


# --- encodings ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("processor", [PC, DEC, MIPS])
@pytest.mark.parametrize("integer", [False, True])
@pytest.mark.parametrize("channels", [0, 6])
def test_every_encoding_reads_what_was_built(tmp_path, processor, integer, channels):
    points = points_of(9, 4)
    points[2][1] = None
    points[5][0] = (0.0, 0.0, 0.0, 5.0)
    points[6][2] = (12.5, -3.0, 8.0, -1.0)
    analog = [[float(v) for v in range(channels)] for _ in points] if channels else None
    raw = build(
        points,
        processor=processor,
        integer=integer,
        scale=0.5,
        analog=analog,
        per_frame=3,
        first=11,
        rate=59.94,
    )
    take = read_capture(save(tmp_path, raw))
    expected = positions(points)
    expected[5, 0] = expected[6, 2] = np.nan
    if processor == DEC or integer:
        np.testing.assert_allclose(take.points, expected, rtol=1e-7)
    else:
        np.testing.assert_array_equal(take.points, expected)
    assert (take.first_frame, take.unit, take.labels) == (11, "mm", ["M0", "M1", "M2", "M3"])
    assert take.rate == pytest.approx(59.94, rel=1e-6)
    assert take.points.dtype == np.float64 and not take.warnings


def test_six_encodings_of_one_real_trial_read_alike():
    names = ("pi", "pr", "si", "sr", "vi", "vr")
    takes = {name: read_capture(real_data("c3d_encodings", f"Eb015{name}.c3d")) for name in names}
    first = takes["pi"]
    assert first.points.shape == (450, 26, 3) and first.rate == 50 and first.axes == ("+Y", "+Z")
    for name, take in takes.items():
        # Integers of one scale are the same numbers, whatever their byte order.
        tolerance = 0 if name.endswith("i") else 0.0834
        assert np.nanmax(np.abs(take.points - first.points)) <= tolerance, name
        np.testing.assert_array_equal(take.visible, first.visible)
        assert (take.labels, take.unit, take.rate, take.axes) == (first.labels, "mm", 50.0, first.axes)
        assert not take.warnings
    for name in ("sr", "vr"):
        np.testing.assert_allclose(takes[name].points, takes["pr"].points, rtol=1e-6)


def test_vax_reals_against_their_definition():
    patterns = RNG.integers(0, 2**32, 4000, dtype=np.uint64).astype("<u4")
    patterns[:6] = [0, 0x8000, 0xFFFF7FFF, 0x00000080, 0x0000FFFF, 0x00004080]
    values = vax_to_float64(patterns)
    for pattern, value in zip(patterns, values, strict=True):
        expected = c3d_slow.get_real(struct.pack("<I", pattern), DEC)
        assert value == expected or (np.isnan(value) and np.isnan(expected))
    ordinary = (np.abs(values) < 8e37) & (np.abs(values) > 1e-37)
    np.testing.assert_array_equal(float64_to_vax(values[ordinary]), patterns[ordinary])
    assert float64_to_vax(np.array([-0.0]))[0] == 0
    assert Processor.DEC.decode(Processor.DEC.encode([-1.0], np.dtype("<u4")))[0] == -1.0


def test_agreement_with_ezc3d():
    ezc3d = pytest.importorskip("ezc3d")
    for path in real_captures():
        if path.name in ("Eb015si.c3d", "Eb015sr.c3d"):
            continue  # ezc3d refuses MIPS
        take = read_capture(path)
        other = ezc3d.c3d(str(path))
        points = other["data"]["points"][:3].transpose(2, 1, 0)
        factor = np.array([MILLIMETRES[take.unit] if q == "position" else 1.0 for q in take.quantities])
        points = points * factor[:, None]
        assert points.shape == take.points.shape
        # ezc3d leaves coordinates of occluded points as they are; some files store a position there.
        seen = take.visible
        np.testing.assert_allclose(take.points[seen], points[seen], rtol=1e-6, atol=1e-4)
        assert (np.isnan(points) | (points == 0)).all(axis=2)[~seen].all()
        assert take.labels == other["parameters"]["POINT"]["LABELS"]["value"][: len(take.labels)]
        assert take.rate == other["header"]["points"]["frame_rate"]


def test_agreement_with_py_c3d():
    c3d = pytest.importorskip("c3d")
    for path in real_captures():
        take = read_capture(path)
        with warnings.catch_warnings(), path.open("rb") as stream:
            warnings.simplefilter("ignore")
            frames = [points.copy() for _, points, _ in c3d.Reader(stream).read_frames()]
        points = np.array(frames)
        factor = np.array([MILLIMETRES[take.unit] if q == "position" else 1.0 for q in take.quantities])
        seen = take.visible
        assert points.shape[:2] == seen.shape
        np.testing.assert_allclose(take.points[seen], (points[..., :3] * factor[:, None])[seen], rtol=1e-6, atol=1e-4)
        assert ((points[..., 3] < 0) | (points[..., :3] == 0).all(axis=2))[~seen].all()


def test_agreement_with_the_slow_walker(tmp_path):
    for path in real_captures():
        take = read_capture(path)
        raw = path.read_bytes()
        slow = c3d_slow.take_apart(raw)
        scale = c3d_slow.get_real(slow.parameter("POINT", "SCALE").values, slow.processor) if slow.integer else 1.0
        words = np.array([[[slow.word(w) for w in p] for p in frame] for frame in slow.points[:40]])
        seen = (words[..., 3] >= 0) & (words[..., :3] != 0).any(axis=2)
        np.testing.assert_array_equal(seen, take.visible[:40])
        factor = np.array([MILLIMETRES[take.unit] if q == "position" else 1.0 for q in take.quantities])
        np.testing.assert_allclose(take.points[:40][seen], (words[..., :3] * scale * factor[:, None])[seen], rtol=1e-12)


def test_model_outputs_are_no_positions():
    take = read_capture(real_data("captures", "pycgm_movement_trial.c3d"))
    kinds = dict(zip(take.labels, take.quantities, strict=True))
    assert kinds["LHipAngles"] == "angle" and kinds["LAnkleForce"] == "force" and kinds["LFHD"] == "position"
    assert kinds["LHipPower"] == "power" and kinds["LAnkleMoment"] == "moment"
    assert take.first_frame == 695 and take.frames == 323 and take.unit == "mm"


# --- units, labels, axes -----------------------------------------------------------------------------------


@pytest.mark.parametrize("unit, factor", [("mm", 1.0), ("cm", 10.0), ("m", 1000.0), ("in", 25.4), ("CM", 10.0)])
def test_units_become_millimetres(tmp_path, unit, factor):
    points = points_of(3, 2)
    take = read_capture(save(tmp_path, build(points, unit=unit)))
    np.testing.assert_allclose(take.points, positions(points, factor), rtol=1e-12)
    assert take.unit == unit.lower() and not take.warnings


@pytest.mark.parametrize("unit", [None, "", "ell"])
def test_unknown_unit_is_assumed_and_told(tmp_path, unit):
    points = points_of(3, 2)
    take = read_capture(save(tmp_path, build(points, unit=unit)))
    np.testing.assert_array_equal(take.points, positions(points))
    assert take.unit == "mm" and len(take.warnings) == 1 and "millimetres are assumed" in take.warnings[0]


def test_quantities_keep_their_numbers(tmp_path):
    points = points_of(3, 4)
    listed = [
        Entry(1, b"ANGLES", False, -1, (2, 1), b"M1"), Entry(1, b"ANGLES2", False, -1, (2, 1), b"M2"),
        Entry(1, b"FORCES", False, -1, (2, 1), b"M3"),
    ]  # fmt: skip
    take = read_capture(save(tmp_path, build(points, unit="cm", extra=listed)))
    assert take.quantities == ["position", "angle", "angle", "force"]
    np.testing.assert_allclose(take.points, positions(points) * np.array([10.0, 1, 1, 1])[:, None], rtol=1e-12)


def test_labels_continue_are_trimmed_and_made_unique(tmp_path):
    points = points_of(2, 4)
    more = [Entry(1, b"LABELS2", False, -1, (3, 3), b"A  A_2zzz")]
    take = read_capture(save(tmp_path, build(points, labels=["A", ""], extra=more)))
    assert take.labels == ["A", "unnamed_2", "A_3", "A_2"]
    assert len(take.warnings) == 2
    vast = {"LABELS": Entry(1, b"LABELS", False, -1, (0,) + (255,) * 6, b"")}
    take = read_capture(save(tmp_path, build(points, change=vast), "vast.c3d"))
    assert take.labels == [f"unnamed_{k}" for k in range(1, 5)]
    assert len(read_capture(save(tmp_path, build(points_of(1, 60), labels=[]), "none.c3d")).warnings) == 12
    few = read_capture(save(tmp_path, build(points, labels=["A", "B"]), "few.c3d"))
    assert few.labels == ["A", "B", "unnamed_3", "unnamed_4"]
    assert "2 of 4 markers have no label" in few.warnings[0]
    latin = Entry(1, b"LABELS", False, -1, (6, 2), b"N\xe9z\0xxAB\tC  ")
    take = read_capture(save(tmp_path, build(points_of(2, 2), change={"LABELS": latin}), "latin.c3d"))
    assert take.labels == ["Néz", "AB_C"]


def test_axes(tmp_path):
    def axes(right: bytes, up: bytes):
        extra = [Entry(1, b"X_SCREEN", False, -1, (2,), right), Entry(1, b"Y_SCREEN", False, -1, (2,), up)]
        return read_capture(save(tmp_path, build(points_of(2, 1), extra=extra)))

    assert axes(b"+X", b"+Z").axes == ("+X", "+Z")
    assert axes(b"-y", b"Z ").axes == ("-Y", "+Z")
    assert axes(b"  ", b"  ").axes is None
    odd = axes(b"+X", b"-X")
    assert odd.axes is None and "ignored" in odd.warnings[0]


# --- how many frames ---------------------------------------------------------------------------------------


def test_a_first_frame_of_zero_does_not_add_a_frame(tmp_path):
    points = points_of(7, 2)
    words = struct.pack("<HH", 0, 7)
    take = read_capture(save(tmp_path, build(points, header={6: words})))
    assert take.frames == 7 and take.first_frame == 1 and "first frame is 0" in take.warnings[0]
    zero_based = read_capture(save(tmp_path, build(points, header={6: struct.pack("<HH", 0, 6)})))
    assert zero_based.frames == 7
    refuse(tmp_path, build(points, header={6: words}, change={"FRAMES": None}), "each would fit")


@pytest.mark.parametrize("cut", [1, 31, 32, 33, 512, 1000])
def test_a_shortened_file_tells_how_much_is_there(tmp_path, cut):
    raw = build(points_of(50, 2), pad=False)
    message = refuse(tmp_path, raw[:-cut], "cut short", "promises 50 frames")
    assert f"holds {50 - -(-cut // 32)}" in message


def test_surplus_of_a_block_is_refused_and_padding_is_not(tmp_path):
    raw = build(points_of(10, 2), pad=False)
    assert read_capture(save(tmp_path, raw + bytes(511))).frames == 10
    refuse(tmp_path, raw + bytes(512), "promises 10 frames")
    wide = build(points_of(10, 60), pad=False)
    assert read_capture(save(tmp_path, wide + bytes(959))).frames == 10
    refuse(tmp_path, wide + bytes(960))


def test_counts_that_disagree(tmp_path):
    points = points_of(40, 2)

    def count(value: int) -> dict:
        return {"FRAMES": Entry(1, b"FRAMES", True, 2, (), struct.pack("<H", value))}

    refuse(tmp_path, build(points, change=count(38)), "header says 40", "POINT:FRAMES says 38")
    take = read_capture(save(tmp_path, build(points, change=count(4))))
    assert take.frames == 40 and "confirms 40" in take.warnings[0]
    trial = [
        Entry(-3, b"TRIAL", False),
        Entry(3, b"ACTUAL_START_FIELD", False, 2, (2,), struct.pack("<HH", 101, 0)),
        Entry(3, b"ACTUAL_END_FIELD", False, 2, (2,), struct.pack("<HH", 140, 0)),
    ]
    take = read_capture(save(tmp_path, build(points, extra=trial)))
    assert take.frames == 40 and take.first_frame == 101
    refuse(tmp_path, build(points, header={6: struct.pack("<HH", 5, 3)}, change={"FRAMES": None}), "no frames")


def test_a_long_take_cut_to_what_its_header_can_say_is_refused(tmp_path):
    points = points_of(1, 1) * 70_000
    extra = [Entry(1, b"LONG_FRAMES", False, 4, (), struct.pack("<f", 70_000))]
    raw = build(points, extra=extra, pad=False)
    assert read_capture(save(tmp_path, raw)).frames == 70_000
    cut = bytearray(raw[: -16 * (70_000 - 65_535)])
    refuse(tmp_path, bytes(cut), "promises 70000 frames", "holds 65535")
    cut[6:8] = bytes(2)
    refuse(tmp_path, bytes(cut), "promises 70000 frames", "holds 65535")


# --- files that lie ----------------------------------------------------------------------------------------


def real_entry(name: bytes, value: float) -> dict:
    return {name.decode(): Entry(1, name, True, 4, (), struct.pack("<f", value))}


@pytest.mark.parametrize(
    "change, words",
    [
        ({"change": {"USED": None}}, ["POINT:USED says nothing"]),
        ({"change": {"SCALE": None}}, ["POINT:SCALE says nothing"]),
        ({"change": real_entry(b"SCALE", 0.1)}, ["differ in sign"]),
        ({"change": real_entry(b"SCALE", float("nan"))}, ["POINT:SCALE"]),
        ({"integer": True, "scale": 0.5, "change": real_entry(b"SCALE", 0.5001)}, ["0.5001"]),
        ({"change": real_entry(b"RATE", 61.0)}, ["60 Hz", "61 Hz"]),
        ({"change": real_entry(b"RATE", 59.94)}, ["60 Hz", "59.94 Hz"]),
        ({"change": real_entry(b"RATE", float("inf"))}, ["frame rate"]),
        ({"rate": 0.0}, ["frame rate"]),
        ({"header": {2: b"\x03\0"}}, ["3 markers"]),
        ({"header": {4: b"\x05\0"}}, ["analog"]),
        ({"analog": [[1.0, 2.0]] * 6, "header": {4: bytes(2), 18: bytes(2)}}, ["ANALOG:USED 2"]),
        ({"header": {16: b"\x04\0"}}, ["data"]),
        ({"header": {16: b"\xff\xff"}}, ["cut short"]),
        ({"header": {0: b"\x01"}}, ["parameters"]),
        ({"header": {0: b"\xff"}}, ["cut short"]),
        ({"header": {1: b"\x51"}}, ["not a C3D"]),
        ({"change": real_entry(b"USED", float("nan"))}, ["POINT:USED is nan"]),
        ({"change": real_entry(b"USED", 2.5)}, ["POINT:USED is 2.5"]),
        ({"change": real_entry(b"DATA_START", float("inf"))}, ["POINT:DATA_START is inf"]),
        ({"extra": [Entry(-1, b"AGAIN", False)]}, ["number 1"]),
        ({"extra": [Entry(-9, b"POINT", False)]}, ["there twice"]),
        ({"extra": [Entry(1, b"RATE", False, 2, (), b"\0\0")]}, ["POINT:RATE is there twice"]),
        ({"extra": [Entry(1, b"BAD", False, 3, (), b"\0\0\0")]}, ["BAD"]),
        ({"extra": [Entry(1, b"BAD", False, 1, (1,) * 8, b"\0")]}, ["BAD"]),
        ({"extra": [Entry(1, b"BAD", False, 4, (255, 255, 255, 255, 255, 255, 255), b"\0")]}, ["BAD"]),
        ({"extra": [Entry(1, b"B\x01D", False, 1, (), b"\0")]}, ["no valid name"]),
        ({"extra": [Entry(0, b"BAD", False, 1, (), b"\0")]}, ["no valid name"]),
    ],
)  # fmt: skip
def test_contradictions_are_refused(tmp_path, change, words):
    refuse(tmp_path, build(points_of(6, 2), **change), *words)


def test_harmless_oddities_are_told(tmp_path):
    points = points_of(6, 2)

    def told(**change) -> list[str]:
        take = read_capture(save(tmp_path, build(points, **change)))
        np.testing.assert_array_equal(take.points, positions(points))
        return take.warnings

    assert "POINT:RATE is missing" in told(change={"RATE": None})[0]
    assert "states no rate" in told(header={20: bytes(4)})[0]
    assert "states no scale" in told(header={12: bytes(4)})[0]
    assert "undefined group 9" in told(extra=[Entry(9, b"LOST", False, 1, (), b"\0")])[0]
    twice = [Entry(-3, b"OWN", False), *[Entry(3, b"X", False, 1, (), b"\0")] * 2]
    assert "OWN:X is there twice" in told(extra=twice)[0]
    assert not told(header={16: bytes(2)})
    zero = {"DATA_START": Entry(1, b"DATA_START", False, 2, (), bytes(2))}
    assert not told(change=zero)
    refuse(tmp_path, build(points, header={16: bytes(2)}, change=zero), "where the data are")


def test_pointers_that_skip_or_end_early_are_refused(tmp_path):
    raw = bytearray(build(points_of(6, 2)))
    at = raw.index(b"RATE") + 4
    for pointer, words in (
        (0, "ends early"),
        (40_000, "beyond the section"),
        (2, "impossible type"),
        (5, "leave its entry"),
        (8, "description"),
    ):
        raw[at : at + 2] = struct.pack("<H", pointer)
        refuse(tmp_path, bytes(raw), words)
    following = raw.index(b"DATA_START") - 2
    second = following + 2 + 10
    jump = second + struct.unpack("<H", raw[second : second + 2])[0] - at
    raw[at : at + 2] = struct.pack("<H", jump)
    refuse(tmp_path, bytes(raw), "past the next entry")


def test_a_chain_of_countless_parameters_is_refused_at_once(tmp_path):
    one = c3d_slow.entry_bytes(Entry(1, b"X", False, 1, (0,), b""), PC)
    raw = bytearray(build(points_of(6, 2)))
    raw[16:18] = struct.pack("<H", 8000)
    raw = bytes(raw[:516]) + one * (8000 * 512 // len(one))
    refuse(tmp_path, raw, "over 20000 parameters")


def test_a_lying_header_allocates_nothing(tmp_path):
    raw = build(points_of(6, 2), header={8: b"\xfe\xff"}, change={"FRAMES": None})
    tracemalloc.start()
    try:
        refuse(tmp_path, raw, "promises 65534 frames")
        assert tracemalloc.get_traced_memory()[1] < 2**24
    finally:
        tracemalloc.stop()


# --- files that are none -----------------------------------------------------------------------------------


def test_what_is_no_capture_is_told_in_one_line(tmp_path):
    def message(path) -> str:
        with pytest.raises(CaptureError) as caught:
            read_capture(path)
        assert "\n" not in str(caught.value)
        return str(caught.value)

    assert "no such file" in message(tmp_path / "none.c3d")
    assert "no such file" in message(str(tmp_path / "bad\nname.c3d"))
    assert "not a valid file name" in message("\ud800.c3d")
    folder = tmp_path / "folder.c3d"
    folder.mkdir()
    assert "a directory" in message(folder)
    assert "empty" in message(save(tmp_path, b"", "empty.c3d"))
    assert "not a C3D file" in message(save(tmp_path, b"x" * 4000, "text.c3d"))
    assert "not a C3D file" in message(save(tmp_path, b"x", "one.c3d"))
    assert "cut short" in message(save(tmp_path, b"\x02\x50" + bytes(500), "head.c3d"))
    assert "0x50" not in message(save(tmp_path, b"\x02\x50" + bytes(4000), "zeros.c3d"))
    assert ".c3d, .trc, .csv" in message(tmp_path / "take.bvh")
    assert ".c3d, .trc, .csv" in message(tmp_path / "take")
    assert "not a valid file name" in message("a\0b.c3d")
    fifo = tmp_path / "pipe.c3d"
    os.mkfifo(fifo)
    assert "not a regular file" in message(fifo)
    locked = save(tmp_path, build(points_of(2, 1)), "locked.c3d")
    locked.chmod(0)
    if not os.access(locked, os.R_OK):
        assert "permission denied" in message(locked)


def test_extension_in_any_case(tmp_path):
    assert read_capture(save(tmp_path, build(points_of(2, 1)), "TAKE.C3D")).frames == 2


def test_importing_captures_stays_light():
    allowed = {"numpy", "evalkit"} | set(sys.stdlib_module_names)
    for file in sorted(Path(capture.__file__).parent.glob("*.py")):
        if file.stem in ("rigid", "origin"):
            continue
        for node in ast.walk(ast.parse(file.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) else []
            assert {name.split(".")[0] for name in names} <= allowed, file.name


def test_the_walker_and_the_builder_agree():
    points = points_of(4, 3)
    points[1][1] = None
    for processor in (PC, DEC, MIPS):
        raw = build(points, processor=processor, analog=[[1.0, 2.0]] * 4, events=2)
        slow = c3d_slow.take_apart(raw)
        assert slow.frames == 4 and slow.analog == 2
        for frame, stored in zip(points, slow.points, strict=True):
            for marker, words in zip(frame, stored, strict=True):
                assert tuple(slow.word(w) for w in words) == (marker or (0.0, 0.0, 0.0, -1.0))
