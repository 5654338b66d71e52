"""The HTML report: complete, self-contained, true to its take, and alive in a browser."""

from __future__ import annotations

import base64
import json
import re
import time
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chromium import open_page
from realdata import real_data

import evalkit
from evalkit.errors import EvalkitError
from evalkit.render import offscreen
from evalkit.report import compare_methods, write_report
from evalkit.report.compare import COLUMNS, UNCOMPENSATED, held_out_rms
from evalkit.report.measures import envelope, movement_rms, runs
from evalkit.report.scene import script_json
from evalkit.report.words import number


class Page(HTMLParser):
    """Text outside scripts, and what the page would load."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.raw = path.read_text(encoding="utf-8")
        self.words: list[str] = []
        self.loads: list[str] = []
        self.tags: list[str] = []
        self.skipped = 0
        self.feed(self.raw)
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.skipped += tag in ("script", "style")
        self.loads += [value or "" for key, value in attrs if key in ("src", "href", "srcset", "data", "poster")]

    def handle_endtag(self, tag: str) -> None:
        self.skipped -= tag in ("script", "style")

    def handle_data(self, data: str) -> None:
        if not self.skipped:
            self.words.append(data)

    @property
    def scene(self) -> Any:
        """Data of the 3D view."""
        return json.loads(re.search(r'id="scene-data">(.*?)</script>', self.raw, re.DOTALL)[1])


@pytest.fixture(scope="module")
def talking(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any, Any, Page]:
    """A synthetic take with its truth, and its report."""
    take, truth = evalkit.synthesize("talking", seed=0, frames=180)
    result = evalkit.compensate(take, truth.rigid)
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(take, result, path, truth=truth, title="a take")
    return take, result, truth, Page(path)


def written(path: Path, take: Any, result: Any, **options: Any) -> Page:
    """The report without a comparison of methods."""
    write_report(take, result, path / "report.html", methods=[], **options)
    return Page(path / "report.html")


def test_everything_is_there(talking: tuple[Any, Any, Any, Page]) -> None:
    take, result, _, page = talking
    for section in (
        "Markers before and after", "Head motion over time", "Pivot", "Errors against the truth",
        "Movement of every marker", "Rigid markers", "All methods on this take", "Parameters and provenance",
    ):  # fmt: skip
        assert section in page.text
    assert f"all {take.frames} frames" in page.text
    for label in result.rigid:
        assert label in page.text
    for warning in result.warnings:
        assert warning in page.text
    tables = evalkit.pose_estimators, evalkit.pivot_estimators
    for method in [*(name for table in tables for name, entry in table.items() if not entry.peer), UNCOMPENSATED]:
        assert method in page.text
    assert evalkit.__version__ in page.text
    assert len(page.raw) < 7_000_000


def test_nothing_is_loaded_from_elsewhere(talking: tuple[Any, Any, Any, Page]) -> None:
    page = talking[3]
    assert page.loads
    assert all(value.startswith("data:") for value in page.loads)
    styles = " ".join(re.findall(r"<style.*?</style>", page.raw, re.DOTALL))
    assert "url(" not in styles
    assert "@import" not in styles


def test_pictures_are_pictures(talking: tuple[Any, Any, Any, Page]) -> None:
    for value in talking[3].loads:
        kind, _, data = value.partition(",")
        if "base64" in kind:
            begin = base64.b64decode(data)[:8]
            assert begin.startswith(b"\x89PNG" if "png" in kind else b"<?xml")


def test_the_3d_view_has_the_markers_in_mm(talking: tuple[Any, Any, Any, Page]) -> None:
    take, result, _, page = talking
    scene = page.scene
    after = next(trace for trace in scene["data"] if trace["name"] == "after, this frame: rigid")
    shown = np.array([after["x"], after["y"], after["z"]]).T
    np.testing.assert_allclose(shown, result.capture.points[0, result.chosen.columns], atol=0.051)
    assert after["text"] == result.rigid
    pivot = next(trace for trace in scene["data"] if trace["name"] == "pivot")
    np.testing.assert_allclose([pivot[k][0] for k in "xyz"], result.pivot, atol=0.051)
    assert 2 <= len(scene["frames"]) <= take.frames


def test_the_browser_draws_it_without_errors_or_network(talking: tuple[Any, Any, Any, Page]) -> None:
    seen = open_page(talking[3].raw)
    assert seen["errors"] == []
    assert seen["requests"] == []
    assert seen["drawn"] > 200
    assert seen["frames"] == len(talking[3].scene["frames"])


def test_the_browser_test_notices_a_broken_page(talking: tuple[Any, Any, Any, Page]) -> None:
    page = talking[3].raw
    broken = page.replace(
        "<main>", '<main><img src="http://example.invalid/a.png"><script>undefinedFunction();</script>', 1
    )
    scene = talking[3].scene
    for trace in scene["data"]:
        trace |= {key: [] for key in "xyz"}
    empty = re.sub(
        r'(id="scene-data">).*?(</script>)', lambda m: m[1] + script_json(scene) + m[2], broken, flags=re.DOTALL
    )
    seen = open_page(empty)
    assert any("undefinedFunction" in error for error in seen["errors"])
    assert any("example.invalid" in request for request in seen["requests"])
    assert seen["drawn"] < 20


def test_labels_of_a_file_are_text_and_nothing_else(tmp_path: Path) -> None:
    take, _ = evalkit.synthesize("talking", seed=0, frames=60)
    evil = ["</script><script>alert(1)</script>", "<img src=x onerror=alert(1)>", "$\\frac{", "a & b", "額"]
    labels = [*evil, *take.labels[5:]]
    named = evalkit.Capture(take.points, labels, take.rate)
    page = written(tmp_path, named, evalkit.compensate(named, labels[:3]), title="<b>bold</b>")
    assert page.tags.count("script") == 3
    assert "<b>bold</b>" in page.text
    assert all(label in page.text for label in evil[:3])
    assert all(value.startswith("data:") for value in page.loads)
    texts = next(trace for trace in page.scene["data"] if trace["name"].endswith("rigid"))["text"]
    assert not any("<" in text for text in texts)


def test_unusable_frames_are_counted_and_left_empty(tmp_path: Path) -> None:
    take, truth = evalkit.synthesize("gaps", seed=0)
    result = evalkit.compensate(take, truth.rigid)
    ok = int((result.frame_status == 0).sum())
    assert ok < take.frames
    page = written(tmp_path, take, result, truth=truth)
    assert f"{ok} of {take.frames} frames ({ok / take.frames:.0%})" in page.text
    assert "Grey: frames without a head pose." in page.text


def test_an_axis_that_cannot_be_seen_is_called_not_observable(tmp_path: Path) -> None:
    take, truth = evalkit.synthesize("single-axis", seed=0)
    page = written(tmp_path, take, evalkit.compensate(take, truth.rigid))
    assert "Pivot: unobservable." in page.text
    assert "not observable" in page.text
    assert re.search(r"\b(inf|nan)\b", page.text) is None


def test_the_published_alternation_shows_its_outer_iterations_and_search(tmp_path: Path) -> None:
    take, truth = evalkit.synthesize("talking", seed=0, frames=120)
    result = evalkit.compensate_as_published(take, truth.rigid)
    page = written(tmp_path, take, result)
    assert "Outer iterations" in page.text
    assert "evaluations of the objective" in page.text
    assert f"{result.outer[0]['evaluations']:,}" in page.text


@pytest.mark.parametrize(
    ("file", "rigid"),
    [
        pytest.param(
            "animface_cheeks.c3d", ["ForeHead_M", "ForeHead_L", "ForeHead_R", "NoseTop"], marks=pytest.mark.slow
        ),
        ("pycgm_movement_trial.c3d", ["LFHD", "RFHD", "LBHD", "RBHD"]),
    ],
)
def test_real_takes(tmp_path: Path, file: str, rigid: list[str]) -> None:
    source = real_data("captures", file)
    take = evalkit.read_capture(source)
    result = evalkit.compensate(take, rigid)
    page = written(tmp_path, take, result, source=source)
    assert file in page.text
    assert re.search(r"\b[0-9a-f]{64}\b", page.text)
    assert ("relative to the head" in page.text) == file.startswith("pycgm")
    assert len(page.raw) < 7_000_000


@pytest.mark.parametrize("markers", [3, pytest.param(41, marks=pytest.mark.slow)])
def test_few_and_many_markers_and_automatic_choice(tmp_path: Path, markers: int) -> None:
    take, truth = evalkit.synthesize("talking", seed=1, frames=60)
    columns = take.indices(truth.rigid)
    if markers == 3:
        some = evalkit.Capture(take.points[:, columns], list(truth.rigid), take.rate)
    else:
        more = take.points[:, :18] + 3.0
        points = np.concatenate([take.points, more], axis=1)
        some = evalkit.Capture(points, [*take.labels, *(f"extra{k}" for k in range(18))], take.rate)
    result = evalkit.compensate(some, "auto" if markers == 3 else truth.rigid)
    page = written(tmp_path, some, result)
    assert f"Paths of {markers} markers" in page.text
    assert ("other markers, before → after" in page.text) == (markers > 3)


def test_without_the_libraries_the_report_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offscreen, "EGL_LIBRARY", "libEGL-that-is-not-there.so.1")
    take, truth = evalkit.synthesize("talking", seed=0, frames=60)
    page = written(tmp_path, take, evalkit.compensate(take, truth.rigid))
    assert "sudo apt-get install libegl1 libgl1-mesa-dri" in page.text


@pytest.mark.timing
def test_long_takes_are_drawn_in_reasonable_time(tmp_path: Path) -> None:
    take, truth = evalkit.synthesize("talking", seed=0, frames=120)
    repeats = 60_000 // take.frames
    long = evalkit.Capture(np.tile(take.points, (repeats, 1, 1)), take.labels, take.rate)
    result = evalkit.compensate(long, truth.rigid)
    start = time.perf_counter()
    page = written(tmp_path, long, result)
    assert time.perf_counter() - start < 20
    assert "smallest and the largest value" in page.text
    assert len(page.raw) < 7_000_000


def test_what_does_not_fit_together_is_an_error(tmp_path: Path) -> None:
    take, truth = evalkit.synthesize("talking", seed=0, frames=60)
    result = evalkit.compensate(take, truth.rigid)
    other = evalkit.Capture(take.points[1:], take.labels, take.rate)
    with pytest.raises(EvalkitError, match="shape"):
        write_report(other, result, tmp_path / "report.html")
    with pytest.raises(EvalkitError, match="cannot write"):
        write_report(take, result, tmp_path / "no" / "report.html", methods=[])
    with pytest.raises(EvalkitError, match="checksum"):
        write_report(take, result, tmp_path / "report.html", methods=[], source=tmp_path / "none.c3d")
    assert list(tmp_path.iterdir()) == []


def test_comparison_has_a_row_for_every_method() -> None:
    take, truth = evalkit.synthesize("talking", seed=0, frames=120)
    result = evalkit.compensate(take, [*truth.rigid, "NoseBridge"])
    told: list[tuple[int, int, str]] = []
    rows = compare_methods(
        take, result, truth=truth, progress=lambda done, total, name: told.append((done, total, name)), max_frames=60
    )
    assert all(tuple(row) == COLUMNS for row in rows)
    assert [(row["kind"], row["method"]) for row in rows] == [
        ("none", UNCOMPENSATED),
        *(("pose", name) for name, entry in evalkit.pose_estimators.items() if not entry.peer),
        *(("pivot", name) for name, entry in evalkit.pivot_estimators.items() if not entry.peer),
    ]
    assert len(told) == told[0][1] == len(rows) - 1
    assert all(row["frames"] == 60 for row in rows)
    three = [row for row in rows if row["method"].startswith("translation-invariants")]
    assert {row["status"] for row in three} == {"not-applicable"}
    assert all("exactly 3" in row["message"] for row in three)
    by = {(row["kind"], row["method"]): row for row in rows}
    assert by["pose", "svd"]["held_out_mm"] < 0.2 * by["none", UNCOMPENSATED]["held_out_mm"]
    assert by["pose", "svd"]["rotation_error_deg"] < 2
    assert [row["method"] for row in rows if row["chosen"]] == [result.pose_method, result.pivot_method]


def test_comparison_keeps_a_reference_frame_and_reports_failures() -> None:
    take, truth = evalkit.synthesize("clean", seed=0, frames=120)
    result = evalkit.compensate(take, truth.rigid, reference=7, sway="none")
    rows = compare_methods(take, result, truth=truth, max_frames=20)
    done = [row for row in rows if row["status"] == "ok" and row["kind"] != "none"]
    assert done
    assert all(row["frames"] == 21 for row in rows)
    # Without noise the closed forms are exact, from any reference.
    assert next(row for row in done if row["method"] == "score")["expression_error_mm"] < 1e-3
    still = evalkit.Capture(np.repeat(take.points[:1], 30, axis=0), take.labels, take.rate)
    failed = compare_methods(still, evalkit.compensate(still, truth.rigid), max_frames=1)
    assert {row["status"] for row in failed if row["kind"] == "pose"} == {"failed"}
    assert all(row["message"] for row in failed if row["status"] == "failed")


def test_held_out_movement_is_that_of_the_marker_left_out() -> None:
    take, truth = evalkit.synthesize("clean", seed=0, frames=60)
    first, second, third = (take.points[:, c] for c in take.indices(truth.rigid))
    fourth = first + 0.02 * np.cross(second - first, third - first)
    points = np.stack([first, second, third, fourth], axis=1)
    shaken = points.copy()
    shaken[::2, 3, 1] += 2.0
    for sway in ("auto", "none"):
        options = {"rigid": list("abcd"), "sway": sway, "reference": "mean"}
        exact = held_out_rms(evalkit.Capture(points, list("abcd"), take.rate), "svd", "score", **options)
        assert exact < 1e-3
        # One marker of four moves by 1 mm about its mean; the three others suffer where it helps to estimate.
        moved = held_out_rms(evalkit.Capture(shaken, list("abcd"), take.rate), "svd", "score", **options)
        assert 0.5 < moved < 3.0
    three = evalkit.Capture(points, list("abcd"), take.rate)
    assert np.isnan(held_out_rms(three, "svd", "score", rigid=list("abc"), sway="auto", reference="mean"))


def test_envelope_keeps_every_extreme_and_every_gap() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(size=(10_007, 2))
    values[3000:5000] = np.nan
    times = np.arange(len(values)) / 60.0
    short, lines = envelope(times, values, 100)
    assert len(short) == len(lines) <= 204
    assert (np.diff(short) > 0).all()
    np.testing.assert_array_equal(np.nanmin(lines, axis=0), np.nanmin(values, axis=0))
    np.testing.assert_array_equal(np.nanmax(lines, axis=0), np.nanmax(values, axis=0))
    inside = (short > times[3150]) & (short < times[4850])
    assert np.isnan(lines[inside]).all()


def test_movement_is_about_the_mean_of_what_was_seen() -> None:
    points = np.zeros((4, 2, 3))
    points[:, 0, 0] = [1, -1, 1, -1]
    points[:, 1] = np.nan
    points[0, 1] = 5.0
    np.testing.assert_allclose(movement_rms(points), [1.0, 0.0])


def test_runs() -> None:
    assert runs(np.array([True, False, True, True])) == [(0, 1), (2, 4)]
    assert runs(np.zeros(3, dtype=bool)) == []


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.inf, "not observable"), (np.nan, "–"), (None, "–"), (0.0, "0"), (1234.5, "1,234"), (12.345, "12.3"),
        (-0.01234, "−0.0123"), (0.99, "0.990"),
    ],
)  # fmt: skip
def test_numbers_have_sensible_digits(value: float | None, text: str) -> None:
    assert number(value) == text
