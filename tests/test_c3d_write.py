"""Writing C3D: copies byte for byte, fresh files that others read, long takes, nothing left half."""

from __future__ import annotations

import pickle
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
from oracles import c3d_slow
from oracles.c3d_slow import DEC, MIPS, PC, Entry, build
from realdata import real_captures, real_data

from evalkit.capture import MILLIMETRES, Capture, read_capture, write_capture
from evalkit.capture import files as capture_files
from evalkit.errors import CaptureError

RNG = np.random.default_rng(11)


def some_take(frames: int = 20, markers: int = 5, **rest) -> Capture:
    points = RNG.normal(0, 200, (frames, markers, 3))
    points[RNG.random((frames, markers)) < 0.1] = np.nan
    return Capture(points, [f"M{k}" for k in range(markers)], rest.pop("rate", 120.0), **rest)


def crafted(folder: Path, processor: int, integer: bool) -> Path:
    """A file with header events, analog samples, camera masks, occluded points and groups of its own."""
    values = np.round(RNG.uniform(-400, 400, (25, 4, 3)) * 4) / 4
    points = [[(*values[i, m], float(256 * (m + 1) + 7)) for m in range(4)] for i in range(25)]
    points[3][1] = None
    points[4][2] = (0.0, 0.0, 0.0, 9.0)
    notes = [
        Entry(-9, b"Notes", True, description=b"the user's own"),
        Entry(9, b"Free_Text", True, -1, (6, 2), b"one   two   ", b"kept"),
        Entry(9, b"EMPTY", False, 4, (3, 0), b""),
        Entry(2, b"SCALE", False, 4, (3,), b"".join(c3d_slow.put_real(v, processor) for v in (0.5, -2.0, 1e-3))),
        Entry(9, b"BYTES", False, 1, (2, 2), b"\x01\xff\x80\x00"),
    ]
    analog = [[float(17 * i + k) for k in range(6)] for i in range(25)]
    raw = build(
        points, processor=processor, integer=integer, scale=0.25, analog=analog, per_frame=2,
        events=4, first=31, extra=notes,
    )  # fmt: skip
    path = folder / f"crafted{processor}{integer}.c3d"
    path.write_bytes(raw)
    return path


def assert_copy(source: Path, copy: Path, take: Capture, promoted: bool = False) -> None:
    """Everything but the points as it was, judged by the slow walker; the points as in `take`."""
    old, new = c3d_slow.take_apart(source.read_bytes()), c3d_slow.take_apart(copy.read_bytes())
    assert (new.processor, new.frames, new.markers, new.analog) == (
        old.processor,
        old.frames,
        old.markers,
        old.analog,
    )
    assert new.data == old.data
    if promoted:
        assert old.integer and not new.integer
        assert new.header[:12] == old.header[:12] and new.header[16:] == old.header[16:]
        scale = c3d_slow.get_real(old.header[12:16], old.processor)
        assert c3d_slow.get_real(new.header[12:16], new.processor) == -scale
    else:
        assert new.header == old.header and new.integer == old.integer
    assert len(new.entries) == len(old.entries)
    for before, after in zip(old.entries, new.entries, strict=True):
        if promoted and before is old.parameter("POINT", "SCALE"):
            assert after == new.parameter("POINT", "SCALE")
            assert c3d_slow.get_real(after.values, new.processor) == -scale
            continue
        assert after == before
    for before, after in zip(old.samples, new.samples, strict=True):
        if promoted:
            width = range(0, len(before), 2)
            ints = [c3d_slow.get_int(before[k : k + 2], old.processor) for k in width]
            assert ints == [c3d_slow.get_real(after[2 * k : 2 * k + 4], new.processor) for k in width]
        else:
            assert after == before
    divisor = [MILLIMETRES[take.unit] if kind == "position" else 1.0 for kind in take.quantities]
    scale = c3d_slow.get_real(new.parameter("POINT", "SCALE").values, new.processor) if new.integer else 1.0
    for i in range(new.frames):
        for m in range(new.markers):
            words, was = new.points[i][m], old.points[i][m]
            if np.isnan(take.points[i, m, 0]):
                assert [new.word(w) for w in words] == [0, 0, 0, -1]
                continue
            for word, value in zip(words, take.points[i, m].tolist(), strict=False):
                value /= divisor[m]
                assert abs(new.word(word) * scale - value) <= 2e-7 * abs(value) + 1e-6
            if old.word(was[3]) < 0:
                assert new.word(words[3]) == 0
            elif promoted:
                assert new.word(words[3]) == old.word(was[3])
            else:
                assert words[3] == was[3]


# --- processed copies --------------------------------------------------------------------------------------


def test_an_unchanged_real_take_is_written_as_it_was(tmp_path):
    for path in real_captures():
        assert write_capture(read_capture(path), tmp_path / "copy.c3d") == []
        assert (tmp_path / "copy.c3d").read_bytes() == path.read_bytes(), path.name


def test_processed_copies_of_real_takes(tmp_path):
    for path in real_captures():
        take = read_capture(path)
        moved = take.points + RNG.normal(0, 3, take.points.shape)
        moved[3, 2] = np.nan
        moved[5, 0] = (1.0, -2.0, 3.25)
        processed = take.with_points(moved)
        notes = write_capture(processed, tmp_path / "copy.c3d")
        promoted = path.stem.endswith("i")
        assert len(notes) == promoted and (not promoted or "0.0833 mm" in notes[0])
        assert_copy(path, tmp_path / "copy.c3d", processed, promoted)
        again = read_capture(tmp_path / "copy.c3d")
        np.testing.assert_allclose(again.points, processed.points, rtol=2e-7, atol=1e-5)
        for name in ("labels", "rate", "unit", "axes", "quantities", "first_frame", "warnings"):
            assert getattr(again, name) == getattr(take, name)


@pytest.mark.parametrize("processor", [PC, DEC, MIPS])
@pytest.mark.parametrize("integer", [False, True])
def test_processed_copies_of_crafted_files(tmp_path, processor, integer):
    path = crafted(tmp_path, processor, integer)
    take = read_capture(path)
    assert np.isnan(take.points[4, 2]).all()
    points = take.points.copy()
    points[0, 0] = np.nan
    points[3, 1] = (0.5, 1.5, -2.25)
    points[10:] += 0.75
    processed = take.with_points(points)
    assert write_capture(processed, tmp_path / "copy.c3d") == []
    assert_copy(path, tmp_path / "copy.c3d", processed)
    again = read_capture(tmp_path / "copy.c3d")
    np.testing.assert_allclose(again.points, points, rtol=2e-7)
    assert c3d_slow.take_apart((tmp_path / "copy.c3d").read_bytes()).integer == integer
    # 0.1 mm is off the grid of 0.25.
    off = take.with_points(points + 0.1)
    notes = write_capture(off, tmp_path / "off.c3d")
    assert ["written in reals" in note for note in notes] == [True] * integer
    assert_copy(path, tmp_path / "off.c3d", off, promoted=integer)
    np.testing.assert_allclose(read_capture(tmp_path / "off.c3d").points, points + 0.1, rtol=2e-7, atol=1e-6)


def test_other_readers_see_the_same_parameters_and_analog_data_in_a_copy(tmp_path):
    ezc3d, c3d = pytest.importorskip("ezc3d"), pytest.importorskip("c3d")
    for path in real_captures():
        take = read_capture(path)
        copy = tmp_path / "copy.c3d"
        write_capture(take.with_points(take.points + 0.5), copy)
        if path.stem not in ("Eb015si", "Eb015sr"):
            old, new = ezc3d.c3d(str(path)), ezc3d.c3d(str(copy))
            np.testing.assert_array_equal(new["data"]["analogs"], old["data"]["analogs"])
            assert old["parameters"].keys() == new["parameters"].keys()
            for group, parameters in old["parameters"].items():
                for name, parameter in parameters.items():
                    if name == "__METADATA__" or (group, name) == ("POINT", "SCALE"):
                        continue
                    np.testing.assert_array_equal(parameter["value"], new["parameters"][group][name]["value"])
            np.testing.assert_allclose(
                new["data"]["points"][0][take.visible.T] * MILLIMETRES[take.unit]
                if set(take.quantities) == {"position"}
                else new["data"]["points"][0][take.visible.T],
                (take.points + 0.5)[..., 0].T[take.visible.T],
                rtol=1e-6, atol=1e-3,
            )  # fmt: skip
        readers = []
        for file in (path, copy):
            with warnings.catch_warnings(), file.open("rb") as stream:
                warnings.simplefilter("ignore")
                reader = c3d.Reader(stream)
                readers.append((reader, [(n, p.copy(), a.copy()) for n, p, a in reader.read_frames()]))
        assert len(readers[0][1]) == len(readers[1][1]) == take.frames
        for (n, _, analog), (number, _, copied) in zip(readers[0][1], readers[1][1], strict=True):
            assert n == number
            np.testing.assert_array_equal(analog, copied)
        assert list(readers[0][0].point_labels) == list(readers[1][0].point_labels)


def test_analog_samples_without_sign_keep_their_values_in_reals(tmp_path):
    points = [[(1.0, 2.0, 3.0, 0.0)]] * 4
    unsigned = Entry(2, b"FORMAT", False, -1, (8,), b"UNSIGNED")
    (tmp_path / "a.c3d").write_bytes(build(points, integer=True, scale=0.5, analog=[[40_000.0]] * 4, extra=[unsigned]))
    take = read_capture(tmp_path / "a.c3d")
    write_capture(take.with_points(take.points + 0.1), tmp_path / "b.c3d")
    slow = c3d_slow.take_apart((tmp_path / "b.c3d").read_bytes())
    assert c3d_slow.get_real(slow.samples[0], PC) == 40_000.0


def test_coordinates_beyond_the_integer_range_become_reals(tmp_path):
    take = read_capture(crafted(tmp_path, PC, True))
    far = take.with_points(take.points + 0.25 * 32_768)
    assert "reals" in write_capture(far, tmp_path / "far.c3d")[0]
    np.testing.assert_allclose(read_capture(tmp_path / "far.c3d").points, far.points, rtol=2e-7)


@pytest.mark.parametrize("kind", ["fresh", PC, DEC, MIPS])
@pytest.mark.parametrize("integer", [False, True])
def test_a_visible_point_at_the_origin_stays_visible(tmp_path, kind, integer):
    take = some_take() if kind == "fresh" else read_capture(crafted(tmp_path, kind, integer))
    points = take.points.copy()
    points[2, 1] = 0.0
    points[3, 0] = -0.0
    write_capture(take.with_points(points), tmp_path / "zero.c3d")
    again = read_capture(tmp_path / "zero.c3d").points
    np.testing.assert_array_equal(np.isnan(again), np.isnan(points))
    assert np.abs(again[[2, 3], [1, 0]]).max() < 1e-12


@pytest.mark.parametrize(
    "change",
    [{"rate": 100.0}, {"unit": "m"}, {"first_frame": 2}, {"labels": list("abcd")}, {"axes": ("+X", "+Y")},
     {"points": np.ones((3, 4, 3))}, {"quantities": ["angle"] + ["position"] * 3}],
)  # fmt: skip
def test_what_no_longer_matches_its_source_is_written_afresh_and_told(tmp_path, change):
    take = read_capture(crafted(tmp_path, PC, False))
    values = {n: getattr(take, n) for n in ("points", "labels", "rate", "unit", "first_frame", "axes", "quantities")}
    other = Capture(**(values | change), source=take.source)
    notes = write_capture(other, tmp_path / "new.c3d")
    assert len(notes) == 1 and "changed since the take was read" in notes[0]
    again = read_capture(tmp_path / "new.c3d")
    for name in ("labels", "rate", "unit", "first_frame", "axes", "quantities"):
        assert getattr(again, name) == getattr(other, name)
    np.testing.assert_allclose(again.points, other.points, rtol=2e-7)


# --- fresh files -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", list(MILLIMETRES))
def test_a_fresh_file_reads_back(tmp_path, unit):
    kinds = ["position", "angle", "force", "power", "scalar", "moment"]
    take = some_take(30, 6, unit=unit, first_frame=5, axes=("-X", "+Z"), quantities=kinds, rate=59.94)
    assert write_capture(take, tmp_path / "new.c3d") == []
    again = read_capture(tmp_path / "new.c3d")
    np.testing.assert_allclose(again.points, take.points, rtol=1e-7)
    for name in ("labels", "unit", "first_frame", "axes", "quantities"):
        assert getattr(again, name) == getattr(take, name)
    assert again.rate == pytest.approx(59.94, rel=1e-7) and not again.warnings
    slow = c3d_slow.take_apart((tmp_path / "new.c3d").read_bytes())
    assert not slow.integer and slow.frames == 30 and slow.parameter("POINT", "UNITS").values == unit.encode()
    assert {slow.word(words[3]) for frame in slow.points for words in frame} == {0.0, -1.0}


def read_by_others(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Points, shape (F, M, 4), by ezc3d and by py-c3d."""
    ezc3d, c3d = pytest.importorskip("ezc3d"), pytest.importorskip("c3d")
    with warnings.catch_warnings(), path.open("rb") as stream:
        warnings.simplefilter("ignore")
        frames = [points.copy() for _, points, _ in c3d.Reader(stream).read_frames(copy=False)]
    return ezc3d.c3d(str(path))["data"]["points"].transpose(2, 1, 0), np.array(frames)


@pytest.mark.parametrize(
    "frames, markers, first", [(1, 1, 1), (40, 300, 1), (5_000, 2, 63_000), (65_535, 1, 1), (10, 2, 100_000)]
)
def test_others_read_fresh_files(tmp_path, frames, markers, first):
    take = some_take(frames, markers, first_frame=first)
    write_capture(take, tmp_path / "new.c3d")
    again = read_capture(tmp_path / "new.c3d")
    np.testing.assert_allclose(again.points, take.points, rtol=1e-7)
    assert again.labels == take.labels and again.first_frame == first and not again.warnings
    for points in read_by_others(tmp_path / "new.c3d"):
        assert points.shape[:2] == (frames, markers)
        np.testing.assert_allclose(points[..., :3][take.visible], take.points[take.visible], rtol=1e-6)


def test_frames_that_begin_before_1_are_renumbered_and_told(tmp_path):
    take = some_take(first_frame=0)
    assert "counted from 1" in write_capture(take, tmp_path / "new.c3d")[0]
    again = read_capture(tmp_path / "new.c3d")
    assert again.first_frame == 1 and again.frames == take.frames


def check_long(folder: Path, frames: int) -> None:
    take = some_take(frames, 2)
    write_capture(take, folder / "long.c3d")
    raw = (folder / "long.c3d").read_bytes()
    slow_start = 512 * (struct.unpack("<H", raw[16:18])[0] - 1)
    assert len(raw) == slow_start + frames * 2 * 16
    again = read_capture(folder / "long.c3d")
    np.testing.assert_allclose(again.points, take.points, rtol=1e-7)
    assert not again.warnings and again.first_frame == 1
    write_capture(again.with_points(again.points + 1.0), folder / "copy.c3d")
    np.testing.assert_allclose(read_capture(folder / "copy.c3d").points, take.points + 1.0, rtol=1e-6, atol=1e-4)
    for points in read_by_others(folder / "long.c3d"):
        assert points.shape[:2] == (frames, 2)
        np.testing.assert_allclose(points[..., :3][take.visible], take.points[take.visible], rtol=1e-6)


def test_70000_frames_are_read_whole_by_all(tmp_path):
    check_long(tmp_path, 70_000)


@pytest.mark.slow
def test_200000_frames_are_read_whole_by_all(tmp_path):
    check_long(tmp_path, 200_000)


def test_labels(tmp_path):
    names = ["Néz", "鼻", "a b", "x" * 127, "Subject:LFHD"]
    write_capture(Capture(np.ones((3, 5, 3)), names, 60.0), tmp_path / "l.c3d")
    assert read_capture(tmp_path / "l.c3d").labels == names
    for label, words in (("x" * 128, "128 bytes"), ("", "blank"), (" a", "padded"), ("a\tb", "control")):
        with pytest.raises(CaptureError, match=words) as caught:
            write_capture(Capture(np.ones((3, 1, 3)), [label], 60.0), tmp_path / "bad.c3d")
        assert "\n" not in str(caught.value)
    with pytest.raises(CaptureError, match="do not fit the parameters"):
        many = [f"{k:0127d}" for k in range(1100)]
        write_capture(Capture(np.ones((1, 1100, 3)), many, 60.0), tmp_path / "bad.c3d")
    assert not (tmp_path / "bad.c3d").exists()


@pytest.mark.parametrize("extension", ["c3d", "trc", "csv"])
def test_nothing_to_write_is_told(tmp_path, extension):
    for shape in ((0, 2, 3), (2, 0, 3)):
        take = Capture(np.ones(shape), [f"M{k}" for k in range(shape[1])], 60.0)
        with pytest.raises(CaptureError, match="at least one of each"):
            write_capture(take, tmp_path / f"none.{extension}")
    assert list(tmp_path.iterdir()) == []


def test_coordinates_that_no_real_holds(tmp_path):
    with pytest.raises(CaptureError, match="1e\\+37"):
        write_capture(Capture(np.full((2, 1, 3), 1e40), ["A"], 60.0), tmp_path / "far.c3d")
    assert list(tmp_path.iterdir()) == []


# --- files and folders -------------------------------------------------------------------------------------


@pytest.mark.parametrize("extension", ["c3d", "trc", "csv"])
def test_the_file_read_is_never_overwritten(tmp_path, extension):
    path = tmp_path / f"take.{extension}"
    write_capture(some_take(), path)
    before = path.read_bytes()
    take = read_capture(path)
    (tmp_path / f"link.{extension}").symlink_to(path)
    (tmp_path / f"hard.{extension}").hardlink_to(path)
    for name in ("take", "link", "hard"):
        with pytest.raises(CaptureError, match="never overwritten"):
            write_capture(take.with_points(take.points + 1), tmp_path / f"{name}.{extension}")
    with pytest.raises(CaptureError, match="never overwritten"):
        write_capture(take, tmp_path / "." / ".." / tmp_path.name / path.name)
    assert path.read_bytes() == before
    write_capture(take, tmp_path / f"other.{extension}")
    write_capture(some_take(), tmp_path / f"other.{extension}")


@pytest.mark.parametrize("extension", ["c3d", "trc", "csv"])
def test_a_failure_while_writing_leaves_nothing(tmp_path, monkeypatch, extension):
    take = some_take()
    target = tmp_path / f"out.{extension}"
    target.write_bytes(b"older")
    replace = Path.replace

    def full(self, to):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(capture_files.Path, "replace", full)
    with pytest.raises(CaptureError, match="no space left on device") as caught:
        write_capture(take, target)
    assert "\n" not in str(caught.value)
    monkeypatch.setattr(capture_files.Path, "replace", replace)
    with pytest.raises(KeyboardInterrupt), capture_files.replacing(target) as stream:
        stream.write(b"half")
        raise KeyboardInterrupt
    assert [p.name for p in tmp_path.iterdir()] == [target.name] and target.read_bytes() == b"older"


def test_a_failure_in_the_middle_of_the_points_leaves_nothing(tmp_path, monkeypatch):
    from evalkit.capture import c3d_write

    calls = []
    fill = c3d_write._fill_points

    def fails(*arguments):
        calls.append(1)
        if len(calls) == 2:
            raise OSError(5, "Input/output error")
        return fill(*arguments)

    monkeypatch.setattr(c3d_write, "_fill_points", fails)
    monkeypatch.setattr(c3d_write, "blocks", lambda layout: [slice(0, 10), slice(10, 20)])
    with pytest.raises(CaptureError, match="input/output error"):
        write_capture(some_take(), tmp_path / "out.c3d")
    assert len(calls) == 2 and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("extension", ["c3d", "trc", "csv"])
def test_places_that_cannot_be_written(tmp_path, extension):
    take = some_take()
    (tmp_path / f"folder.{extension}").mkdir()
    (tmp_path / "file").write_bytes(b"")
    for path, words in (
        (tmp_path / "none" / f"a.{extension}", "does not exist"),
        (tmp_path / "file" / f"a.{extension}", "does not exist"),
        (tmp_path / f"folder.{extension}", "a directory"),
        (tmp_path / f"a\0b.{extension}", "not a valid file name"),
        (Path(f"/proc/evalkit.{extension}"), "cannot be written"),
        (tmp_path / ("n" * 300 + f".{extension}"), "cannot be written"),
    ):
        with pytest.raises(CaptureError, match=words) as caught:
            write_capture(take, path)
        assert "\n" not in str(caught.value)
    with pytest.raises(CaptureError, match=r"\.c3d, \.trc, \.csv"):
        write_capture(take, tmp_path / "take.bvh")


def test_a_take_survives_pickling_with_its_source(tmp_path):
    path = crafted(tmp_path, MIPS, False)
    take = pickle.loads(pickle.dumps(read_capture(path)))
    write_capture(take, tmp_path / "copy.c3d")
    assert_copy(path, tmp_path / "copy.c3d", take)


def test_writing_changes_neither_take_nor_source(tmp_path):
    take = read_capture(crafted(tmp_path, DEC, True))
    points, raw = take.points.copy(), take.source.raw
    write_capture(take.with_points(take.points + 0.1), tmp_path / "copy.c3d")
    write_capture(take, tmp_path / "same.c3d")
    np.testing.assert_array_equal(take.points, points)
    assert take.source.raw is raw


def test_formats_from_one_to_the_other(tmp_path):
    take = read_capture(real_data("captures", "animface_jaw.c3d"))
    for extension in ("trc", "csv", "c3d"):
        write_capture(take, tmp_path / f"jaw.{extension}")
        take = read_capture(tmp_path / f"jaw.{extension}")
    original = read_capture(real_data("captures", "animface_jaw.c3d"))
    np.testing.assert_allclose(take.points, original.points, rtol=1e-7)
    assert take.labels == original.labels and take.unit == "cm" and take.rate == original.rate
