"""TRC and CSV: round trips, files of other programs, and errors that name line and column."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from evalkit.capture import MILLIMETRES, Capture, read_capture, write_capture
from evalkit.errors import CaptureError

RNG = np.random.default_rng(3)

TRC = """PathFileType\t4\t(X/Y/Z)\ttake.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames
100\t100\t3\t2\tmm\t100\t1\t3
Frame#\tTime\tHead\t\t\tNose\t\t
\t\tX1\tY1\tZ1\tX2\tY2\tZ2

1\t0.00\t1.5\t2\t3\t4\t5\t6
2\t0.01\t\t\t\t4\t5\t6
3\t0.02\t1\t2\t3\t-4e1\t5\t6
"""

CSV = """frame,time_s,Head_x_mm,Head_y_mm,Head_z_mm,Nose_x_mm,Nose_y_mm,Nose_z_mm
7,0.0,1.5,2,3,4,5,6
8,0.01,,,,4,5,6
9,0.02,1,2,3,-4e1,5,6
"""

EXPECTED = np.array([[[1.5, 2, 3], [4, 5, 6]], [[np.nan] * 3, [4, 5, 6]], [[1, 2, 3], [-40, 5, 6]]])


def save(folder: Path, text: str, name: str, encoding: str = "utf-8") -> Path:
    path = folder / name
    path.write_bytes(text.encode(encoding))
    return path


def refuse(folder: Path, text: str, name: str, *words: str) -> None:
    path = save(folder, text, name)
    with pytest.raises(CaptureError) as caught:
        read_capture(path)
    message = str(caught.value)
    assert "\n" not in message and message.startswith(str(path)), message
    for word in words:
        assert word in message, message


def some_take(frames: int = 40, **rest) -> Capture:
    points = RNG.normal(0, 300, (frames, 3, 3))
    points[RNG.random((frames, 3)) < 0.2] = np.nan
    return Capture(points, rest.pop("labels", ["A", "B b", "Ü,x"]), rest.pop("rate", 59.94), **rest)


@pytest.mark.parametrize("extension", ["trc", "csv"])
@pytest.mark.parametrize("unit", list(MILLIMETRES))
def test_round_trip(tmp_path, extension, unit):
    take = some_take(unit=unit, first_frame=12)
    path = tmp_path / f"take.{extension}"
    assert write_capture(take, path) == []
    again = read_capture(path)
    np.testing.assert_allclose(again.points, take.points, rtol=0, atol=1e-9)
    for name in ("labels", "rate", "unit", "first_frame", "quantities"):
        assert getattr(again, name) == getattr(take, name)
    assert not again.warnings


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    values=st.lists(st.floats(-1e7, 1e7) | st.just(float("nan")), min_size=6, max_size=6),
    labels=st.lists(
        st.text(st.characters(exclude_categories=("C", "Z")), min_size=1), min_size=2, max_size=2, unique=True
    ),
    rate=st.floats(1, 1000),
    extension=st.sampled_from(["trc", "csv"]),
)
def test_round_trip_of_anything(tmp_path, values, labels, rate, extension):
    points = np.array([values, [1.0] * 6]).reshape(2, 2, 3)
    take = Capture(points, labels, rate)
    path = tmp_path / f"any.{extension}"
    write_capture(take, path)
    again = read_capture(path)
    assert again.labels == labels
    np.testing.assert_array_equal(again.points, take.points)
    assert again.rate == pytest.approx(rate, rel=1e-12)


def test_trc_of_other_programs(tmp_path):
    for name, text in (
        ("plain", TRC),
        ("windows", TRC.replace("\n", "\r\n")),
        ("trailing tabs", TRC.replace("\n", "\t\n")),
        ("blank lines", TRC.replace("\n", "\n\n") + "\n\n"),
        ("spaces", TRC.replace("\t", " \t ").replace("(X/Y/Z)", " (X/Y/Z) ")),
        ("mark", "\ufeff" + TRC),
        ("case", TRC.replace("DataRate\t", "DATARATE\t").replace("Frame#", "FRAME#")),
        ("no axis names", TRC.replace("\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n", "")),
        ("last line open", TRC.rstrip("\n")),
    ):
        take = read_capture(save(tmp_path, text, "take.trc"))
        np.testing.assert_array_equal(take.points, EXPECTED, err_msg=name)
        assert (take.labels, take.rate, take.unit, take.first_frame) == (["Head", "Nose"], 100.0, "mm", 1)
        assert not take.warnings


def test_trc_units_and_labels(tmp_path):
    take = read_capture(save(tmp_path, TRC.replace("\tmm\t", "\tm\t"), "take.trc"))
    np.testing.assert_allclose(take.points, EXPECTED * 1000)
    take = read_capture(save(tmp_path, TRC.replace("Nose", "Head"), "take.trc"))
    assert take.labels == ["Head", "Head_2"] and len(take.warnings) == 1
    take = read_capture(save(tmp_path, TRC.replace("Head", ""), "take.trc"))
    assert take.labels == ["unnamed_1", "Nose"]
    take = read_capture(save(tmp_path, TRC.replace("Head", "Tête"), "take.trc", "latin-1"))
    assert take.labels == ["Tête", "Nose"]
    take = read_capture(save(tmp_path, TRC.replace("1.5\t2", "\t2"), "take.trc"))
    assert np.isnan(take.points[0, 0]).all() and "'Head' lacks a coordinate in 1 frames" in take.warnings[0]


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("PathFileType", "Something", ["PathFileType"]),
        ("DataRate\tCamera", "Rate\tCamera", ["DataRate"]),
        ("\tmm\t", "\tell\t", [":3:", "Units 'ell'"]),
        ("100\t100\t3", "0\t100\t3", ["frame rate"]),
        ("100\t100\t3", "x\t100\t3", [":3: column 1 (DataRate): 'x' is no number"]),
        ("100\t100\t3", "100\t100\t4", ["promises 4 frames, the file holds 3"]),
        ("100\t100\t3", "100\t100\t2", ["promises 2 frames, the file holds 3"]),
        ("100\t100\t3", "100\t100\t0", ["nothing to read"]),
        ("\t2\tmm", "\t3\tmm", [":4: 2 labels, NumMarkers is 3"]),
        ("\t2\tmm", "\t1\tmm", [":4: 2 labels, NumMarkers is 1"]),
        ("Frame#", "What", [":4:", "Frame#"]),
        ("1.5\t2", "1.5\tabc", [":7: column 4 (Head y): 'abc' is no number"]),
        ("1.5\t2", "1.5\tnan", [":7: column 4 (Head y): 'nan' is not finite"]),
        ("1.5\t2", "1.5\tinf", [":7: column 4 (Head y): 'inf' is not finite"]),
        ("1.5\t2", "1.5\t1e999", [":7: column 4 (Head y): '1e999' is not finite"]),
        ("1.5\t2", "1.5\t1_0", [":7: column 4 (Head y): '1_0' is no number"]),
        ("\t5\t6\n2\t", "\t5\n2\t", [":7: 7 columns, expected 8"]),
        ("\t5\t6\n2\t", "\t5\t6\t7\n2\t", [":7: 9 columns, expected 8"]),
        ("3\t0.02", "4\t0.02", [":9: column 1 (frame): 4, expected 3"]),
        ("1\t0.00", "\t0.00", [":7: column 1 (frame)"]),
        ("1\t0.00", "1.5\t0.00", [":7: column 1 (frame)"]),
    ],
)
def test_trc_errors_name_the_place(tmp_path, old, new, words):
    assert old in TRC
    refuse(tmp_path, TRC.replace(old, new, 1), "bad.trc", *words)


def test_trc_has_no_place_for_what_is_no_position(tmp_path):
    take = some_take(quantities=["position", "angle", "position"])
    notes = write_capture(take, tmp_path / "take.trc")
    assert notes == ["1 points that are no positions were left out of the TRC file"]
    again = read_capture(tmp_path / "take.trc")
    assert again.labels == ["A", "Ü,x"]
    np.testing.assert_array_equal(again.points, take.points[:, [0, 2]])


def test_csv_reads_columns_in_any_order(tmp_path):
    plain = read_capture(save(tmp_path, CSV, "take.csv"))
    np.testing.assert_array_equal(plain.points, EXPECTED)
    assert (plain.labels, plain.first_frame, plain.unit) == (["Head", "Nose"], 7, "mm")
    assert plain.rate == 100.0 and not plain.warnings
    table = pd.read_csv(tmp_path / "take.csv")
    for columns in (sorted(table.columns), sorted(table.columns, reverse=True)):
        table[columns].to_csv(tmp_path / "sorted.csv", index=False)
        take = read_capture(tmp_path / "sorted.csv")
        order = [take.labels.index(label) for label in plain.labels]
        np.testing.assert_array_equal(take.points[:, order], plain.points)
    table["note"] = 'good, "so\nfar"'
    table.to_csv(tmp_path / "noted.csv", index=True)
    take = read_capture(tmp_path / "noted.csv")
    np.testing.assert_array_equal(take.points, plain.points)
    assert len(take.warnings) == 2 and "note" in take.warnings[1]


@pytest.mark.parametrize("change", [("\n", "\r\n"), ("\n", "\n\n"), (",", " , "), ("frame", "\ufeffframe")])
def test_csv_of_other_programs(tmp_path, change):
    take = read_capture(save(tmp_path, CSV.replace(*change), "take.csv"))
    np.testing.assert_array_equal(take.points, EXPECTED)
    assert not take.warnings


def test_csv_keeps_quantities_and_quotes_labels(tmp_path):
    take = some_take(unit="cm", quantities=["position", "angle", "moment"])
    write_capture(take, tmp_path / "take.csv")
    header = pd.read_csv(tmp_path / "take.csv").columns
    assert list(header[:3]) == ["frame", "time_s", "A_x_cm"] and header[-1] == "Ü,x_z_moment"
    again = read_capture(tmp_path / "take.csv")
    assert again.quantities == take.quantities and again.labels == take.labels
    np.testing.assert_allclose(again.points, take.points, rtol=0, atol=1e-9)


def test_csv_is_friendly_to_pandas(tmp_path):
    take = some_take()
    write_capture(take, tmp_path / "take.csv")
    table = pd.read_csv(tmp_path / "take.csv")
    assert table["frame"].dtype.kind == "i"
    np.testing.assert_allclose(table["A_x_mm"], take.points[:, 0, 0], rtol=1e-15)
    np.testing.assert_allclose(table["time_s"], take.times, rtol=1e-15)


def test_csv_of_one_frame(tmp_path):
    write_capture(some_take(1), tmp_path / "one.csv")
    take = read_capture(tmp_path / "one.csv")
    assert take.frames == 1 and take.rate == 1.0 and "1 Hz is assumed" in take.warnings[0]


@pytest.mark.parametrize(
    "old, new, words",
    [
        (CSV, "\n\n", [":1:", "columns"]),
        (CSV, "a;b;c\n1;2;3\n", [":1:", "separated by commas"]),
        (CSV, CSV.split("\n")[0] + "\n", ["no frames"]),
        (CSV, "frame,time_s\n1,0\n", ["no columns of coordinates"]),
        ("time_s", "time", [":1:", "time_s"]),
        ("Head_y_mm", "Head_x_mm", [":1: column 4 ('Head_x_mm') is there twice"]),
        ("Head_y_mm", "Heady_mm", [":1: column Head_y_mm is missing"]),
        ("Nose_x_mm,Nose_y_mm,Nose_z_mm", "Nose_x_m,Nose_y_m,Nose_z_m", ["m and mm"]),
        ("1.5,2", "1.5,abc", [":2: column 4 (Head_y_mm): 'abc' is no number"]),
        ("1.5,2", "1.5,NaN", [":2: column 4 (Head_y_mm): 'NaN' is not finite"]),
        ("1.5,2", "1.5,-inf", [":2: column 4 (Head_y_mm): '-inf' is not finite"]),
        ("1.5,2", "1.5,1_0", [":2: column 4 (Head_y_mm): '1_0' is no number"]),
        ("1.5,2", "1.5", [":2: 7 columns, expected 8"]),
        ("1.5,2", "1.5,2,9", [":2: 9 columns, expected 8"]),
        ("1.5,2", '1.5,"2', ["not a CSV file"]),
        ("8,0.01", "9,0.01", [":3: column 1 (frame): 9, expected 8"]),
        ("8,0.01", "8,", [":3: column 2 (time_s): empty"]),
        ("8,0.01", "8,0.019", [":3: column 2 (time_s): 0.019 s is out of step"]),
        ("9,0.02", "9,0.0", [":4: column 2 (time_s): times do not increase"]),
    ],
)
def test_csv_errors_name_the_place(tmp_path, old, new, words):
    assert old in CSV
    refuse(tmp_path, CSV.replace(old, new, 1), "bad.csv", *words)


@pytest.mark.parametrize("extension", ["trc", "csv"])
def test_what_is_no_text_is_refused(tmp_path, extension):
    path = tmp_path / f"take.{extension}"
    for raw, words in ((b"", "empty"), (b"\x02\x50\0\0" * 300, "not a text file"), (b"\xff" * 100, path.name)):
        path.write_bytes(raw)
        with pytest.raises(CaptureError, match=words) as caught:
            read_capture(path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("extension, text", [("trc", TRC), ("csv", CSV)])
def test_damaged_text_is_refused_or_read_in_full(tmp_path, extension, text):
    path = tmp_path / f"take.{extension}"
    for k in range(1500):
        rng = np.random.default_rng([5, k])
        raw = bytearray(text.encode())
        for at in rng.integers(0, len(raw), rng.integers(1, 4)):
            raw[at] = rng.choice(list(b"\t\n\r,;\"'0123456789.-+eExnaif_ \x00\xff")) if k % 2 else rng.integers(256)
        if k % 5 == 0:
            del raw[int(rng.integers(len(raw))) :]
        path.write_bytes(raw)
        try:
            take = read_capture(path)
        except CaptureError as error:
            assert "\n" not in str(error)
        else:
            assert take.points.shape[1:] == (2, 3)
            if extension == "trc":
                assert take.frames == 3


@pytest.mark.timing
@pytest.mark.parametrize("extension", ["trc", "csv"])
def test_long_takes_take_seconds(tmp_path, extension):
    take = Capture(RNG.normal(0, 200, (20_000, 23, 3)), [f"M{k}" for k in range(23)], 120.0)
    start = time.perf_counter()
    write_capture(take, tmp_path / f"long.{extension}")
    again = read_capture(tmp_path / f"long.{extension}")
    # Some 3 s; the bound only tells seconds from minutes on a slow machine.
    assert time.perf_counter() - start < 40
    np.testing.assert_allclose(again.points, take.points, rtol=0, atol=1e-9)
