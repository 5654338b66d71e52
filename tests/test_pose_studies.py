"""Studies of pose and compensation on tiny cuts: finite figures, the order that theory demands, failures as rows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from realdata import real_data

from evalkit.capture import Capture, write_capture
from evalkit.errors import EvalkitError
from evalkit.studies import studies
from evalkit.studies.real_takes import AND, METHODS, conditions, left_out
from evalkit.studies.scaling import WORK, measure
from evalkit.studies.scaling import run as run_apart
from evalkit.study.command import run_studies
from evalkit.study.description import Budget
from evalkit.study.runner import run
from evalkit.synthetic import synthesize

MINE = (
    "pose-noise", "gaps", "outliers", "skin", "two-joint-neck",
    "marker-layout", "capture-rate", "real-takes", "scaling",
)  # fmt: skip


def measured(name, *methods, seeds=1, **axes):
    """Figures of a tiny cut: (condition without single values, method, figure) -> value; and the table."""
    axes = {axis: value if isinstance(value, tuple) else (value,) for axis, value in axes.items()}
    table = run(studies[name], None, Budget(seeds, axes, methods), jobs=1)
    varied = [axis for axis in table.study.axes if len({row[axis] for row in table.rows}) > 1]
    found = {
        (*(row[axis] for axis in varied), row["method"], row["statistic"]): row["value"]
        for row in table.summary + table.machine_summary
    }
    return found, table


def finite(found, but=()):
    return all(math.isfinite(value) for key, value in found.items() if key[-1] not in but)


@pytest.mark.parametrize("name", MINE)
def test_every_study_says_what_it_asks_and_found(name):
    study = studies[name]
    assert study.question.endswith("?") and len(study.finding) > 100
    assert study.small.seeds <= study.full.seeds
    study.at("small")  # names only axes and methods that it has
    study.at("full")


def test_estimators_meet_the_bound_of_what_they_know():
    found, table = measured(
        "pose-noise", "svd", "translation-invariants", "translation-invariants-raw", "svd smooth", "joint",
        layout="paper-23", noise="white", noise_mm=0.3,
    )  # fmt: skip
    assert finite(found) and not table.failed
    # 600 frames of three angles, mostly about one axis: a standard deviation of 3 %, and three of them.
    assert found["svd", "over bound of one frame"] == pytest.approx(1.0, abs=0.1)
    assert found["joint", "with pivot known"] == pytest.approx(1.0, abs=0.1)
    assert found["svd", "translation over bound"] == pytest.approx(1.0, abs=0.1)
    # Control: what knows the pivot is below the bound of what does not.
    assert found["joint", "over bound of one frame"] < 0.7
    assert found["svd smooth", "rotation"] < 0.7 * found["svd", "rotation"]
    assert found["translation-invariants-raw", "not orthogonal"] > 0.01 > 1e-12 > found["svd", "not orthogonal"]
    # The mean shape fixes the frame of reference so well that alignment takes hardly anything away.
    assert found["svd", "absolute"] == pytest.approx(found["svd", "rotation"], rel=0.02)


def test_gaps_are_answered_and_a_peer_that_cannot_is_a_failed_row():
    found, table = measured(
        "gaps", "svd", "peer-scipy", layout=("paper-23", "dense-63"), gaps=0.1, burst_frames=30
    )  # fmt: skip
    assert {row["method"] for row in table.failed} == {"peer-scipy"}
    assert all("scipy" in row["message"] and row["rotation_deg"] is None for row in table.failed)
    # Three markers, each seen nine times out of ten in bursts of its own: 73 % of the frames, give or take the few
    # bursts that a take of ten seconds has. Seven: all.
    assert 0.4 < found["paper-23", "svd", "frames posed"] < 0.95
    assert found["dense-63", "svd", "frames posed"] > 0.99
    for row in table.rows:
        if row["status"] == "ok":
            assert row["posed"] == row["could"]


def test_robust_holds_against_what_pulls_least_squares_away():
    found, _ = measured(
        "outliers", "svd", "qcp", "robust", "joint", "robust joint",
        layout="dense-63", fault=("50 mm", "swap"), share=0.05,
    )  # fmt: skip
    assert finite(found)
    for fault in ("50 mm", "swap"):
        assert found[fault, "robust joint", "rotation"] < 0.7 * found[fault, "joint", "rotation"]
        assert found[fault, "robust", "rotation"] < 0.7 * found[fault, "svd", "rotation"]
        assert found[fault, "qcp", "rotation"] == pytest.approx(found[fault, "svd", "rotation"], rel=1e-6)


def test_control_with_three_markers_nothing_contradicts_an_outlier():
    found, _ = measured("outliers", "svd", "robust", layout="paper-23", fault="50 mm", share=0.05)
    assert found["robust", "rotation"] == pytest.approx(found["svd", "rotation"], rel=1e-6)


def test_sliding_skin_costs_the_triangle_most():
    found, _ = measured("skin", "svd triangle", "auto", layout="paper-23", slide_mm=(0, 6))
    assert finite(found)
    assert found[6, "svd triangle", "expression"] > 1.3 * found[0, "svd triangle", "expression"]
    assert found[6, "svd triangle", "leak"] > found[0, "svd triangle", "leak"]
    assert found[6, "auto", "expression over triangle"] < 0.8
    # Turned about the forehead, the chin has the longest arm.
    assert found[0, "svd triangle", "chin"] > 2 * found[0, "svd triangle", "brows"]


def test_one_pivot_helps_a_neck_of_one_joint_and_hurts_a_neck_of_two():
    found, _ = measured("two-joint-neck", "svd", "joint none", "joint", layout="paper-23", gap_mm=(0, 40))
    assert finite(found, but=("normalised error",))
    assert found[0, "joint none", "expression over svd"] < 0.7
    assert found[40, "joint none", "expression over svd"] > 1.5
    assert found[40, "joint", "expression over svd"] < 1.05
    assert found[0, "joint", "taken as still"] == 1 and found[40, "joint", "taken as still"] == 0


def test_more_rigid_markers_off_the_forehead_turn_the_head_better():
    found, table = measured("marker-layout", "svd", markers=("3 forehead", "4 with bridge", "7 with bridge"))
    assert finite(found)
    rotation = [found[markers, "svd", "rotation"] for markers in table.study.axes["markers"]]
    assert rotation == sorted(rotation, reverse=True)
    assert all(found[markers, "svd", "rotation over bound"] == pytest.approx(1.0, abs=0.1) for markers, *_ in found)


def test_rate_and_length_leave_each_frame_alone_and_serve_the_pivot():
    found, _ = measured("capture-rate", "svd", "joint", rate_hz=(30, 120), length_s=10)
    assert finite(found)
    assert found[120, "svd", "rotation"] == pytest.approx(found[30, "svd", "rotation"], rel=0.15)
    assert found[120, "joint", "expression"] < found[120, "svd", "expression"]


def test_scaling_measures_in_a_process_of_its_own():
    found, table = measured("scaling", "pivot svd", frames=10_000)
    assert finite(found) and not table.failed and table.study.serial
    assert 0 < found["pivot svd", "time a frame"] < 1e4  # microseconds, not seconds
    assert not table.summary  # nothing of it is the same in every run


def test_memory_that_is_held_is_seen(monkeypatch):
    def hoard(take, columns):
        return lambda: take.points + np.arange(4.0)[:, None, None, None]

    monkeypatch.setitem(WORK, "pose svd", hoard)
    # Four copies of 100,000 frames, 220 MB, beside which what else the process does is small.
    assert measure(100_000, 0, "pose svd")["multiple"] == pytest.approx(4.0, rel=0.05)


def test_a_measuring_process_that_fails_is_told_in_one_line():
    with pytest.raises(EvalkitError, match=r"no-such-work.*KeyError") as caught:
        run_apart((1000, 0), "no-such-work")
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def reduced():
    """Four seconds of twelve markers, four of them rigid, 0.3 mm noise."""
    return synthesize("talking", seed=2, layout="reduced-12", frames=240)


@pytest.fixture(scope="module")
def file(reduced, tmp_path_factory):
    path = tmp_path_factory.mktemp("own") / "own take.c3d"
    write_capture(reduced[0], path)
    return str(path)


def test_own_take_without_truth(file):
    three = ("ForeheadC", "ForeheadL", "ForeheadR")
    found, table = measured("real-takes", take=file, held_out="NoseBridge", candidates=three)
    # Three candidates are too few to tell their skin apart, said in a row.
    assert {row["method"] for row in table.failed} == {"svd weighted"}
    assert "at least 5" in table.failed[0]["message"]
    assert finite({key: value for key, value in found.items() if key[0] != "svd weighted"})
    assert found["raw", "over raw"] == 1.0 and found["raw", "motion left"] > 10.0
    # A rigid marker 50 mm from the triangle: its own noise of sqrt(3) 0.3 mm, and the error of the pose.
    assert 0.52 < found["svd triangle", "motion left"] < 2.5
    assert found["auto", "motion left"] < found["svd triangle", "motion left"]


def test_by_default_every_marker_called_rigid_is_left_out_in_turn(file):
    (condition,) = conditions({**studies["real-takes"].axes, "take": (file,)})
    labels = condition["held_out"].split(AND)
    assert len(labels) >= 3 and len(set(labels)) == len(labels)
    found, table = measured("real-takes", "raw", "svd candidates", take=file)
    assert finite(found)
    (row,) = [row for row in table.rows if row["method"] == "svd candidates"]
    each = [float(text.split()[-1]) for text in row["each_mm"].split(", ")]
    assert row["motion_mm"] == pytest.approx(np.sqrt(np.mean(np.square(each))), abs=1e-3)
    assert row["worst_mm"] == pytest.approx(max(each), abs=1e-3)
    for label, used in zip(labels, row["candidates_used"].split("; "), strict=True):
        assert label not in used.split(AND)


@pytest.mark.parametrize("method", [name for name in METHODS if name != "svd weighted"])
def test_the_left_out_marker_never_enters_its_own_estimate(reduced, method):
    take = reduced[0]

    def spoilt(label):
        points = take.points.copy()
        points[:, take.labels.index(label)] += np.random.default_rng(0).normal(scale=20.0, size=(take.frames, 3))
        return Capture(points, take.labels, take.rate)

    def motion(capture):
        one = left_out(capture, "ForeheadL", "auto", "auto")
        return METHODS[method](one)[0]

    np.testing.assert_array_equal(motion(take), motion(spoilt("ForeheadL")))
    if method != "raw":  # control: another marker would be noticed
        one = left_out(take, "ForeheadL", "auto", "auto")
        used = one.triangle[0] if method == "svd triangle" else one.candidates[0]
        assert np.abs(motion(take) - motion(spoilt(used))).max() > 1e-3


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ([], "name your files"),
        (["take=missing.c3d"], "missing.c3d"),
        (["take={file}", "held_out=Nosebrigde"], "did you mean NoseBridge"),
        (["take={file}", "candidates=ForeheadC,ForeheadL,Brow"], "'Brow' is not in the capture"),
        (["take={file}", "triangle=ForeheadC,ForeheadL,Nobody"], "'Nobody' is not in the capture"),
    ],
)
def test_a_mistake_is_one_line_and_nothing_is_written(file, tmp_path, axes, words):
    given = [axis.format(file=file) for axis in axes]
    with pytest.raises(EvalkitError, match=words) as caught:
        run_studies([studies["real-takes"]], tmp_path / "out", "small", None, given, None, 1, None, False, False)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_without_files_the_study_is_left_out_of_all():
    assert not all(studies["real-takes"].axes.values())
    assert all(all(studies[name].axes.values()) for name in MINE if name != "real-takes")


def test_a_real_take_from_the_command_line(capsys, tmp_path):
    path = real_data("captures", "animface_jaw.c3d")
    run_studies(
        [studies["real-takes"]], tmp_path, "small", None, [f"take={path}", "held_out=NoseTop"],
        "raw,svd triangle", 1, None, False, False,
    )  # fmt: skip
    text = capsys.readouterr().out
    assert "held_out NoseTop" in text and "motion left, mm" in text
    table = (tmp_path / "real-takes-summary.csv").read_text()
    assert "svd triangle,motion left,mm,1.04" in table
