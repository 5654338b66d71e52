"""``evalkit track`` on a painted face: tables, overlay, report, and one clear line for what cannot be tracked."""

from __future__ import annotations

import hashlib
import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from oracles.painted_face import DISTANCE_MM, FOCAL, HEIGHT, WIDTH, Act, Painter, depth, exposed, moved
from scipy.spatial.transform import Rotation

from evalkit import cli
from evalkit.cli import video_source
from evalkit.errors import EvalkitError
from evalkit.render.colours import GREEN, VERMILION
from evalkit.render.overlay import STATUS_COLOURS, Overlay
from evalkit.render.video_file import written_video
from evalkit.report.track import FILES, POSE_COLUMNS
from evalkit.report.track_page import chosen_stills
from evalkit.seeds import generator
from evalkit.vision import trackers, video
from evalkit.vision.angles import head_angles_deg
from evalkit.vision.camera import Camera
from evalkit.vision.initial import start_from_points
from evalkit.vision.parameters import NAMES, PARAMETERS
from evalkit.vision.points import FACE_POINTS, mean_face_points
from evalkit.vision.track import Track
from evalkit.vision.tracker import HeadTrack, TrackStatus

command = sys.modules[cli.track.callback.__module__]

CAMERA = Camera(WIDTH, HEIGHT, FOCAL, (WIDTH / 2, HEIGHT / 2))
VIEW_DEG = float(2 * np.degrees(np.arctan(0.5 * HEIGHT / FOCAL)))
FRAMES, GONE, JAW_MM = 20, range(13, 17), 9.0
RATE_HZ = 20.0


def pose(yaw_deg):
    rotation = Rotation.from_euler("y", yaw_deg, degrees=True).as_matrix()
    return rotation, np.array([0.0, -5.0, -DISTANCE_MM - 100.0])


@pytest.fixture(scope="module")
def film():
    """Frames of a face that turns, opens its mouth, and is away for some frames; points of the first; jaw, mm."""
    painter, random = Painter(generator("painted face")), generator("sensor")
    jaw = JAW_MM * np.sin(np.linspace(0, np.pi, FRAMES)) ** 2
    yaw = 8.0 * np.sin(np.linspace(0, np.pi, FRAMES))
    empty = 90.0 + 30.0 * np.add.outer(np.sin(np.arange(HEIGHT) / 7.0), np.sin(np.arange(WIDTH) / 9.0))
    frames = [
        exposed(empty if k in GONE else painter.picture(*pose(yaw[k]), Act(jaw=jaw[k])), random) for k in range(FRAMES)
    ]
    points = moved(mean_face_points()[:, :2], Act())
    space = np.concatenate([points, depth(points[:, 0], points[:, 1])[:, None]], axis=1)
    rotation, translation = pose(0.0)
    return frames, CAMERA.project(space @ rotation.T + translation), jaw


@pytest.fixture
def folder(tmp_path, monkeypatch, film):
    """talk.mp4 and points.json, in the current folder."""
    monkeypatch.chdir(tmp_path)
    frames, points, _ = film
    with written_video(tmp_path / "talk.mp4", (WIDTH, HEIGHT), RATE_HZ, crf=8) as add:
        for frame in frames:
            add(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    write_points(tmp_path / "points.json", points)
    return tmp_path


def write_points(path, points, **facts):
    places = dict(zip(FACE_POINTS, np.asarray(points).tolist(), strict=True))
    path.write_text(json.dumps({"points": places, **facts}), encoding="utf-8")


def run(*words):
    done = CliRunner().invoke(cli.app, ["track", *map(str, words)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def refusal(*words):
    """The one line that a user's mistake is told in; nothing is written."""
    before = sorted(Path.cwd().rglob("*"))
    with pytest.raises(EvalkitError) as caught:
        run(*words)
    assert "\n" not in str(caught.value)
    assert sorted(Path.cwd().rglob("*")) == before
    return str(caught.value)


# --- what is written ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def made(tmp_path_factory, film):
    """The folder that the command makes of the film, and its summary."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("track"))
        frames, points, _ = film
        with written_video(Path("talk.mp4"), (WIDTH, HEIGHT), RATE_HZ, crf=8) as add:
            for frame in frames:
                add(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
        write_points(Path("points.json"), points)
        told = json.loads(
            run("talk.mp4", "-o", "out", "--points", "points.json", "--camera-fov", VIEW_DEG, "--json")
        )  # fmt: skip
        return Path("out").resolve(), told


def table(made, name):
    return pd.read_csv(made[0] / f"{name}.csv")


def test_all_files_are_there_and_the_summary_is_what_is_printed(made):
    folder, told = made
    assert sorted(path.name for path in folder.iterdir()) == sorted(FILES)
    assert json.loads((folder / "summary.json").read_text()) == {k: v for k, v in told.items() if k != "written"}
    assert told["input"]["sha256"] == hashlib.sha256((folder.parent / "talk.mp4").read_bytes()).hexdigest()
    assert told["input"]["frames"] == FRAMES and not told["camera"]["assumed"]
    assert sum(told["frames"].values()) == FRAMES and told["points"]["from"] == "file"
    assert told["neutral"].keys() == set(NAMES)


def test_every_frame_has_a_status_and_a_lost_one_no_numbers(made):
    found = table(made, "pose")
    assert list(found) == list(POSE_COLUMNS) and list(found["frame"]) == list(range(FRAMES))
    np.testing.assert_allclose(found["time_s"], np.arange(FRAMES) / RATE_HZ)
    # An encoder needs no frame to see that the face is gone, but a pose may be carried over for one.
    away = found.loc[GONE.start + 1 : GONE.stop - 1, "status"]
    assert (away == "lost").all()
    assert (found.loc[: GONE.start - 1, "status"] == "tracked").all()
    lost = found["status"] == "lost"
    assert found.loc[lost].iloc[:, 4:].isna().all(axis=None) and not found.loc[~lost].iloc[:, 4:].isna().any(axis=None)
    for name in ("parameters", "parameters_normalised"):
        assert table(made, name).loc[lost, list(NAMES)].isna().all(axis=None)
    spans = made[1]["lost"]
    assert [k for first, last in spans for k in range(first, last + 1)] == list(found.index[lost])


def test_quaternion_angles_and_rotation_are_one(made):
    found = table(made, "pose").dropna()
    turns = Rotation.from_quat(found[["qx", "qy", "qz", "qw"]].to_numpy()).as_matrix()
    angles = found[["pitch_deg", "yaw_deg", "roll_deg"]].to_numpy()
    # Six decimals are written.
    np.testing.assert_allclose(head_angles_deg(turns), angles, atol=1e-3)
    # The turn is to the person's left, as it was painted, and is no nod.
    assert found["yaw_deg"].max() - found["yaw_deg"].iloc[0] > 4.0
    assert np.ptp(found["yaw_deg"]) > 2 * np.ptp(found["roll_deg"])


def test_angles_have_the_signs_that_are_promised():
    nose, top = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    for axis, order in enumerate(("x", "y", "z")):
        turn = Rotation.from_euler(order, 10.0, degrees=True).as_matrix()
        assert head_angles_deg(turn[None])[0] == pytest.approx(10.0 * np.eye(3)[axis], abs=1e-9)
        # Chin down; nose to the person's left; top of the head to the person's right.
        assert ((turn @ nose)[1] < 0, (turn @ nose)[0] > 0, (turn @ top)[0] < 0)[axis]


def test_parameters_follow_the_face(made, film):
    jaw = film[2]
    found, normal = table(made, "parameters"), table(made, "parameters_normalised")
    assert list(found)[2:] == list(NAMES) == list(normal)[2:]
    opening = found["lip_opening"].to_numpy()
    known = np.isfinite(opening[: GONE.start])
    assert known.sum() > 8
    together = np.corrcoef(opening[: GONE.start][known], jaw[: GONE.start][known])[0, 1]
    assert together > 0.9
    # Control: the brows were not painted to move.
    still = np.ptp(found["brow_distance"].dropna()) / found["brow_distance"].median()
    assert np.ptp(opening[: GONE.start][known]) / np.nanmedian(opening) > 4 * still
    neutral = made[1]["neutral"]
    for parameter in PARAMETERS:
        rest, raw = neutral[parameter.name], found[parameter.name]
        expected = raw / rest - 1 if parameter.form == "ratio" else raw - rest
        np.testing.assert_allclose(normal[parameter.name], expected, atol=1e-4)


def test_points_start_where_they_were_put(made, film):
    found = table(made, "points")
    assert len(found) == FRAMES * len(FACE_POINTS) and list(found["point"][: len(FACE_POINTS)]) == list(FACE_POINTS)
    np.testing.assert_allclose(found[["x_px", "y_px"]][: len(FACE_POINTS)], film[1], atol=1e-3)


# --- overlay and report ------------------------------------------------------------------------------------


def frames_of(path):
    return list(video.read_video(path))


def like(picture, colour):
    """Pixels of about a colour: an encoder blurs and shifts it."""
    wanted = np.array([*bytes.fromhex(colour.removeprefix("#"))])[::-1]
    return (np.abs(picture.astype(int) - wanted).max(axis=2) < 40).sum()


def test_the_overlay_has_all_frames_and_says_plainly_that_the_face_is_lost(made):
    shown = frames_of(made[0] / "overlay.mp4")
    assert len(shown) == FRAMES
    # Small pictures are enlarged.
    assert shown[0].shape == (3 * HEIGHT, 3 * WIDTH, 3)
    edge = np.ones(shown[0].shape[:2], dtype=bool)
    edge[4:-4, 4:-4] = False
    away, there = shown[GONE.start + 2], shown[5]
    frame = like(away[edge][None], VERMILION) / edge.sum()
    # Control: a tracked frame has no such border.
    assert frame > 0.9 > 0.1 > like(there[edge][None], VERMILION) / edge.sum()
    assert like(there, GREEN) > 1000 > like(away, GREEN)


def one_frame_track(status, rotation=None):
    rotation = np.eye(3) if rotation is None else rotation
    translation = np.array([0.0, 0.0, -600.0])
    camera = Camera.assumed_for(320, 240)
    lost = status == TrackStatus.LOST
    head = HeadTrack(
        np.full((1, 3, 3), np.nan) if lost else rotation[None],
        np.full((1, 3), np.nan) if lost else translation[None],
        np.array([status], dtype=np.int8), np.array([0.5]), np.array([0.0]), camera, "cylinder",
    )  # fmt: skip
    points = np.full((1, 19, 2), np.nan) if lost else np.full((1, 19, 2), [20.25, 30.75])
    return Track(head, points, points, np.ones((1, 19)), np.zeros((1, 15)), 60.0)


def test_points_and_axes_are_drawn_where_they_are():
    track = one_frame_track(TrackStatus.TRACKED)
    seen = track.head.camera.project(mean_face_points() + np.array([0.0, 0.0, -600.0]))
    surface = start_from_points(seen, track.head.camera).surface
    black = np.zeros((240, 320, 3), dtype=np.uint8)
    picture = Overlay(track, surface).drawn(black, 0)
    assert picture.shape == (480, 640, 3)
    white = np.argwhere((picture > 200).all(axis=2))
    dot = white[(white[:, 0] < 100) & (white[:, 1] < 100)]
    # The middle of the dot is the place, to a pixel: pixels count from the corner, array rows from the middle.
    np.testing.assert_allclose(dot.mean(axis=0) + 0.5, [2 * 30.75, 2 * 20.25], atol=0.6)
    # x goes to the person's left, to the right in the picture; y goes up.
    red, green = (np.argwhere(mask) for mask in (_of(picture, "#D55E00"), _of(picture, "#009E73")))
    assert red[:, 1].mean() > 320 and abs(red[:, 0].mean() - 240) < 10
    assert green[green[:, 0] < 470][:, 0].min() < 200
    # Control: lost, and nothing but the border and the words is drawn.
    lost = Overlay(one_frame_track(TrackStatus.LOST), surface).drawn(black, 0)
    assert not lost[20:440, 20:-20].any()
    assert {*STATUS_COLOURS} == {*TrackStatus}


def _of(picture, colour):
    wanted = np.array([*bytes.fromhex(colour.removeprefix("#"))])[::-1]
    return np.abs(picture.astype(int) - wanted).max(axis=2) < 12


class Page(HTMLParser):
    """Texts and pictures of a page, and what it would load."""

    def __init__(self, text):
        super().__init__()
        self.pictures, self.loads, self.words = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        if tag == "img":
            self.pictures.append(given["alt"])
        source = given.get("src") or given.get("href") or "data:"
        if not source.startswith("data:"):
            self.loads.append(source)

    def handle_data(self, data):
        self.words.append(data)


def test_the_report_says_what_was_lost_and_loads_nothing(made):
    page = Page((made[0] / "report.html").read_text(encoding="utf-8"))
    text = " ".join(" ".join(page.words).split())
    assert page.loads == []
    first, last = made[1]["lost"][0]
    assert f"frames {first} to {last}" in text and "the face is lost" in text
    assert made[1]["input"]["sha256"] in text
    assert all(name in text for name in NAMES)
    stills = [alt for alt in page.pictures if alt.startswith("Frame")]
    assert any(alt.endswith("lost") for alt in stills) and any(alt.endswith("tracked") for alt in stills)
    assert len(page.pictures) == len(stills) + 2


def test_the_stills_show_every_status():
    status = np.zeros(1000, dtype=np.int8)
    status[503:506] = TrackStatus.LOST
    chosen = chosen_stills(status)
    assert chosen[0] == 0 and chosen[-1] == 999 and 504 in chosen
    assert chosen_stills(np.zeros(1, dtype=np.int8)) == [0]


# --- choices -----------------------------------------------------------------------------------------------


def test_part_of_a_video_another_tracker_and_no_overlay(folder):
    run("talk.mp4", "-o", "all", "--points", "points.json", "--frames", 3, "--method", "pyrlk", "--no-overlay")
    found = pd.read_csv(folder / "all" / "pose.csv")
    assert len(found) == 3 and not (folder / "all" / "overlay.mp4").exists()
    told = json.loads((folder / "all" / "summary.json").read_text())
    assert told["method"]["pose"] == "pyrlk" and told["camera"]["assumed"]
    run("talk.mp4", "-o", "later", "--points", "points.json", "--start", 2, "--frames", 2, "--rate", 10, "--no-overlay")
    later = pd.read_csv(folder / "later" / "pose.csv")
    assert list(later["frame"]) == [2, 3] and later["time_s"].tolist() == [0.2, 0.3]


def test_eyes_and_a_folder_of_pictures(folder, film):
    pictures = folder / "pictures"
    pictures.mkdir()
    for k, frame in enumerate(film[0][:2]):
        cv2.imwrite(str(pictures / f"{k}.png"), frame)
    at = dict(zip(FACE_POINTS, film[1], strict=True))
    eyes = [0.5 * (at[f"eye inner {side}"] + at[f"eye outer {side}"]) for side in ("left", "right")]
    words = run("pictures", "-o", "out", "--eyes", ",".join(f"{x:.1f}" for x in np.ravel(eyes)), "--no-overlay")
    assert re.search(r"2 frames at 25 per second: \d+ tracked", words) and "points from eyes" in words
    told = json.loads((folder / "out" / "summary.json").read_text())
    content = b"".join((pictures / f"{k}.png").read_bytes() for k in range(2))
    assert told["input"]["sha256"] == hashlib.sha256(content).hexdigest()


def test_the_first_frame_as_a_picture_to_place_points_on(folder):
    run("talk.mp4", "--first-frame", "first.png", "--start", 3)
    np.testing.assert_array_equal(cv2.imread("first.png"), frames_of(folder / "talk.mp4")[3])
    assert "is there already" in refusal("talk.mp4", "--first-frame", "first.png")


def test_a_camera_is_recorded_and_then_tracked(folder, monkeypatch):
    opened = video._open
    monkeypatch.setattr(video, "_open", lambda source: opened(folder / "talk.mp4" if source == 0 else source))
    words = run("0", "-o", "me", "--frames", 2, "--points", "points.json", "--no-overlay")
    assert re.search(r"^2 frames", words) and (folder / "me" / "recording.mp4").is_file()
    assert "there is no terminal to type q in" in refusal("0", "-o", "other", "--points", "points.json")


def test_the_default_is_the_tables():
    from evalkit.cli.track import track

    (option,) = (option for option in track.params if option.name == "method")
    assert option.default == trackers.DEFAULT and trackers.DEFAULT in trackers.trackers


def test_all_trackers_speak_of_the_same_point_of_the_head(film):
    frames, points, _ = film
    started = {
        name: method.build().start(frames[0], CAMERA, points)
        for name, method in trackers.trackers.items()
        if not trackers.missing(name)
    }
    assert {"cylinder", "pyrlk"} <= started.keys()
    reach = max(np.linalg.norm(pose.translation - started["cylinder"].translation) for pose in started.values())
    # Depth of one face from one picture differs by a few percent; the origin of the mean face is 42 mm away.
    assert reach < 25.0


# --- mistakes ----------------------------------------------------------------------------------------------


def test_bad_input_is_one_line_and_nothing_is_written(folder, film, monkeypatch):
    (folder / "words.mp4").write_text("no video")
    assert "not a video" in refusal("words.mp4", "-o", "out", "--points", "points.json")
    assert "no such file" in refusal("nothing.mp4", "-o", "out", "--points", "points.json")
    (folder / "empty").mkdir()
    assert "no pictures" in refusal("empty", "-o", "out", "--points", "points.json")
    (folder / "sizes").mkdir()
    for k, size in enumerate(((HEIGHT, WIDTH), (40, 40))):
        cv2.imwrite(str(folder / "sizes" / f"{k}.png"), cv2.resize(film[0][0], size[::-1]))
    assert "frame 1 has 40 x 40" in refusal("sizes", "-o", "out", "--points", "points.json")
    assert "has no frame 99" in refusal("talk.mp4", "-o", "out", "--points", "points.json", "--start", 99)
    assert "known are cylinder" in refusal("talk.mp4", "-o", "out", "--points", "points.json", "--method", "magic")
    assert "field of view" in refusal("talk.mp4", "-o", "out", "--points", "points.json", "--camera-fov", 200)


def test_points_that_cannot_be_are_named(folder, film):
    far = film[1].copy()
    far[FACE_POINTS.index("nose tip")] = WIDTH + 3.0, 20.0
    write_points(folder / "far.json", far)
    assert "'nose tip' (153, 20) is outside of the frame" in refusal("talk.mp4", "-o", "out", "--points", "far.json")
    write_points(folder / "other.json", film[1], photo={"width": 640, "height": 480})
    assert "width is 640" in refusal("talk.mp4", "-o", "out", "--points", "other.json")
    write_points(folder / "mirrored.json", film[1] * [-1.0, 1.0] + [WIDTH, 0.0])
    assert refusal("talk.mp4", "-o", "out", "--points", "mirrored.json").startswith("talk.mp4, from frame 0: no face")
    (folder / "short.json").write_text(json.dumps({"points": {"nose tip": [1, 2]}}))
    assert "point 'brow inner left' is missing" in refusal("talk.mp4", "-o", "out", "--points", "short.json")
    for text, reason in (("{", "no valid JSON"), ("[]", "'points' is missing"), ('{"points": {"a": [1]}}', "no")):
        (folder / "odd.json").write_text(text)
        assert reason in refusal("talk.mp4", "-o", "out", "--points", "odd.json")
    assert "outside of the frame" in refusal("talk.mp4", "-o", "out", "--eyes", "10,10,900,10")


def test_without_points_and_detector_both_ways_are_named(folder, monkeypatch):
    monkeypatch.setattr(trackers, "find_spec", lambda name: None if name == "mediapipe" else object())
    words = refusal("talk.mp4", "-o", "out")
    assert all(way in words for way in ("--points", "evalkit head edit", "--eyes", "pip install 'evalkit[vision]'"))
    monkeypatch.setattr(command, "find_spec", lambda name: None)
    assert refusal("talk.mp4", "-o", "out") == "OpenCV is missing: pip install 'evalkit[vision]'"


def test_an_input_is_not_overwritten(folder):
    (folder / "talk.mp4").rename(folder / "overlay.mp4")
    before = (folder / "overlay.mp4").read_bytes()
    assert "overwrite its own input" in refusal("overlay.mp4", "-o", ".", "--points", "points.json")
    assert (folder / "overlay.mp4").read_bytes() == before


@pytest.mark.parametrize("where", ["_followed", "_draw"])
def test_ctrl_c_leaves_nothing_behind(folder, monkeypatch, where):
    def interrupted(*given):
        if where == "_draw":
            (given[3].parent / "overlay.mp4").write_bytes(b"half")
        raise KeyboardInterrupt

    before = sorted(folder.rglob("*"))
    monkeypatch.setattr(command, where, interrupted)
    done = CliRunner().invoke(cli.app, ["track", "talk.mp4", "-o", "out", "--points", "points.json"])
    assert done.exit_code == 1 and sorted(folder.rglob("*")) == before


def test_a_bar_whose_total_proves_wrong_goes_on_without(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    with video_source.progress("tracking", 2) as done:
        for k in range(1, 6):
            done(k)
    with video_source.progress("tracking", None) as done:
        done(3)
