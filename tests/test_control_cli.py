"""``evalkit control``: a table or a video drives a character, frame for frame, and mistakes are told in one line."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from oracles.painted_face import DISTANCE_MM, FOCAL, HEIGHT, WIDTH, Act, Painter, depth, exposed, moved

from evalkit import cli
from evalkit.control.character import Character
from evalkit.control.database import build_database, open_database
from evalkit.control.signals import held_rotations, read_signal
from evalkit.control.stream import Control
from evalkit.errors import EvalkitError
from evalkit.head import load_head
from evalkit.render.video_file import written_video
from evalkit.seeds import generator
from evalkit.studies.control_takes import RIGID_SITES, control_take
from evalkit.vision import video
from evalkit.vision.camera import Camera
from evalkit.vision.markers import frontal_markers
from evalkit.vision.parameters import NAMES, normalise
from evalkit.vision.points import FACE_POINTS, mean_face_points

PERFORMER, RATE_HZ, FRAMES = "template 3000", 30.0, 24


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A folder with a database, parameters of another performance and a short video; and that performance."""
    folder = tmp_path_factory.mktemp("control")
    takes = {f"take{k}": control_take(PERFORMER, seed=k, frames=900).still for k in range(2)}
    build_database(takes, folder / "db", compensated=True, rigid=tuple(RIGID_SITES))
    load_head("template", vertices=3000).save(folder / "small.npz")
    acted = control_take(PERFORMER, seed=7, frames=60, rate_hz=RATE_HZ)
    table = pd.DataFrame(frontal_markers(acted.still).parameters, columns=list(NAMES))
    table.insert(0, "time_s", np.arange(60) / RATE_HZ)
    table.to_csv(folder / "talk.csv", index=False)
    table[:24].to_csv(folder / "start.csv", index=False)
    painter, random = Painter(generator("painted face")), generator("sensor")
    rotation, translation = np.eye(3), np.array([0.0, -5.0, -DISTANCE_MM - 100.0])
    with written_video(folder / "talk.mp4", (WIDTH, HEIGHT), 20.0, crf=8) as add:
        for jaw in 9.0 * np.sin(np.linspace(0, np.pi, FRAMES)) ** 2:
            frame = exposed(painter.picture(rotation, translation, Act(jaw=jaw)), random)
            add(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    points = moved(mean_face_points()[:, :2], Act())
    space = np.concatenate([points, depth(points[:, 0], points[:, 1])[:, None]], axis=1)
    pixels = Camera(WIDTH, HEIGHT, FOCAL, (WIDTH / 2, HEIGHT / 2)).project(space @ rotation.T + translation)
    places = dict(zip(FACE_POINTS, pixels.tolist(), strict=True))
    (folder / "points.json").write_text(json.dumps({"points": places}), encoding="utf-8")
    return folder, acted


@pytest.fixture
def folder(world, monkeypatch):
    monkeypatch.chdir(world[0])
    return world[0]


def run(*words):
    given = ["control", "--head", "small.npz", *map(str, words)]
    done = CliRunner().invoke(cli.app, given, catch_exceptions=False)
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


def frames_of(path):
    capture, found = cv2.VideoCapture(str(path)), []
    while (read := capture.read())[0]:
        found.append(read[1])
    return found


def test_a_character_does_what_the_parameters_say(world):
    folder, acted = world
    database = open_database(folder / "db")
    signal = read_signal(folder / "talk.csv")
    assert signal.rate_hz == pytest.approx(RATE_HZ)
    neutral = frontal_markers(control_take(PERFORMER, seed=7, frames=2).still).parameters
    normalised = normalise(signal.parameters, np.nanmedian(neutral, axis=0), database.spread)
    found = Control(database, RATE_HZ).run(normalised).displacements
    character = Character.of(database, load_head("template", vertices=3000))
    made, truth = character.vertices(found), acted.performance.vertices()
    near = character.head.nearest_vertices(
        {name: character.head.landmarks[name] for name in ("upper lip", "lower lip")}
    )

    def opening(vertices):
        return vertices[:, near["upper lip"], 1] - vertices[:, near["lower lip"], 1]

    assert np.corrcoef(opening(made), opening(truth))[0, 1] > 0.9
    # Control: another second of the same performance does not say it.
    assert np.corrcoef(opening(made), np.roll(opening(truth), 25))[0, 1] < 0.6
    assert character.kept > 0.99


def test_a_table_becomes_a_video(folder):
    words = run("--from", "start.csv", "--database", "db", "-o", "face.mp4", "--size", 96, "--sheet", "sheet.png")
    assert words.startswith("24 frames at 30 per second: 24 ok") and "wrote face.mp4" in words
    drawn = frames_of("face.mp4")
    assert cv2.imread("sheet.png").shape == (2 * 96, 3 * drawn[0].shape[1], 3)
    assert len(drawn) == 24 and drawn[0].shape[0] == 96
    # Control: a face that stays as it is would draw one picture again and again.
    assert max(np.abs(drawn[0].astype(int) - frame).mean() for frame in drawn) > 0.5


def test_a_video_is_shown_beside_the_character(folder):
    told = json.loads(
        run("talk.mp4", "--database", "db", "-o", "pair.mp4", "--points", "points.json", "--size", 96, "--json")
    )
    drawn = frames_of("pair.mp4")
    assert sum(told["frames"].values()) == len(drawn) == FRAMES
    assert told["frames"]["lost"] < FRAMES // 2
    seen = cv2.resize(frames_of("talk.mp4")[3], (round(96 * WIDTH / HEIGHT), 96), interpolation=cv2.INTER_AREA)
    left = drawn[3][:, : seen.shape[1]]
    assert np.abs(left.astype(int) - seen).mean() < 6.0
    assert np.abs(drawn[12][:, : seen.shape[1]].astype(int) - seen).mean() > np.abs(left.astype(int) - seen).mean()


def test_a_camera_is_followed_live(folder, monkeypatch):
    opened = video._open
    monkeypatch.setattr(video, "_open", lambda source: opened(folder / "talk.mp4" if source == 0 else source))
    told = json.loads(
        run(
            "0", "--database", "db", "-o", "live.mp4", "--frames", 12, "--points", "points.json", "--size", 96, "--json"
        )
    )
    assert sum(told["frames"].values()) == len(frames_of("live.mp4")) == 12
    assert "there is no terminal to type q in" in refusal("0", "--database", "db", "-o", "no.mp4")


def test_what_cannot_be_done_is_one_line(folder):
    def table(text):
        (folder / "odd.csv").write_text(text)
        return "--from", "odd.csv", "--database", "db", "-o", "odd.mp4", "--size", 96

    (folder / "odd.csv").write_text("")
    assert "holds no motion database" in refusal("--from", "talk.csv", "--database", ".", "-o", "x.mp4")
    assert "no column is a control parameter" in refusal(*table("time_s,smile\n0,1\n"))
    assert "is 'wide', no number" in refusal(*table("time_s,lip_opening\n0,wide\n0.1,1\n"))
    assert "does not grow by even steps" in refusal(*table("time_s,lip_opening\n0,1\n0.1,1\n0.5,1\n"))
    assert "share too few control parameters" in refusal(*table("time_s,lip_opening\n0,1\n0.1,1\n"))
    assert "no control parameter is known" in refusal(*table("time_s,lip_opening\n0,\n0.1,\n"))
    frame = "time_s," + ",".join(NAMES) + "\n" + "".join(f"{0.1 * k}" + ",1" * 15 + "\n" for k in range(2))
    (folder / "two.csv").write_text(frame)
    words = ("--from", "two.csv", "--database", "db", "--size", 96)
    assert "--neutral 9: '9' is no frame" in refusal(*words, "-o", "x.mp4", "--neutral", 9)
    assert "known are pruned" in refusal(*words, "-o", "x.mp4", "--search", "magic")
    assert "videos are written as" in refusal(*words, "-o", "x.avi")
    assert "no such folder" in refusal(*words, "-o", "away/x.mp4")
    assert "it has no shapes" in refusal(*words, "-o", "x.mp4", "--coefficients", "x.csv")
    assert CliRunner().invoke(cli.app, ["control", "--database", "db", "-o", "x.mp4"]).exit_code == 2


def test_poses_that_are_not_known_are_held():
    turns = np.stack([np.full((3, 3), np.nan), np.eye(3), np.full((3, 3), np.nan), -np.eye(3)])
    np.testing.assert_array_equal(held_rotations(turns), np.stack([np.eye(3)] * 3 + [-np.eye(3)]))
