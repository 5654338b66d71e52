"""Filmed heads: the truth is where the picture shows it, faults do what they say, and nothing depends on the order."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evalkit.cli import app
from evalkit.errors import EvalkitError
from evalkit.geometry import apply_motion
from evalkit.head.photo import Photo
from evalkit.head.points import read_points
from evalkit.render.camera_scene import LIGHTS, CameraScene, texels_per_mm
from evalkit.render.offscreen import require_offscreen
from evalkit.studies.filmed import (
    VIDEO_PRESETS,
    VideoParameters,
    film,
    manifest,
    parse_video_overrides,
    video_parameters,
    write_video,
)
from evalkit.studies.filmed_heads import ASTRONAUT_POINTS, filmed_face, point_sources, wearing_photo
from evalkit.studies.picture_faults import clutter, compressed, covered, gains, occluder_sprite, sensed
from evalkit.vision.angles import head_angles_deg
from evalkit.vision.parameters import control_parameters, eye_distance, normalise

MANIFEST = Path(__file__).resolve().parents[1] / "data" / "videos" / "MANIFEST.json"

PLAIN = VideoParameters(head="template-small", frames=6, expression=0.0, light="even", noise=0.0, crf=0)


@pytest.fixture(scope="module", autouse=True)
def drawable():
    try:
        require_offscreen()
    except EvalkitError as error:
        pytest.skip(str(error))


def outline(image, behind):
    """Left, top, right and bottom edge of what differs from the background, pixels."""
    rows, columns = np.nonzero((np.abs(image.astype(int) - behind) > 60).any(axis=2))
    return np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1], dtype=float)


@pytest.mark.parametrize("yaw", [0.0, 30.0])
def test_vertices_are_seen_where_the_camera_projects_them(yaw):
    head = filmed_face("template-small").head
    # The plate behind the head is transparent at its edges.
    head = replace(head, parts={name: ends for name, ends in head.parts.items() if name != "plate"})
    camera = VideoParameters().camera
    behind = np.full((camera.height, camera.width, 3), (0, 255, 0), dtype=np.uint8)
    angle = np.deg2rad(yaw)
    rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    translation = np.array([20.0, -15.0, -620.0])
    with CameraScene(head, camera, "camera", behind, 620.0) as scene:
        scene.pose(rotation, translation)
        seen = outline(scene.frame(head.vertices), behind)

    drawn = head.vertices[head.part_vertices(*head.parts)]

    def expected(r, t):
        at = camera.project(drawn @ r.T + t)
        return np.concatenate([at.min(axis=0), at.max(axis=0)])

    # The edge of an outline is drawn to a pixel, and a pixel that it covers by less than a quarter stays background.
    assert np.abs(seen - expected(rotation, translation)).max() < 1.5
    # Controls: another distance, the transposed rotation, axes of a picture with y down.
    assert np.abs(seen - expected(rotation, translation + np.array([0, 0, 15.0]))).max() > 1.5
    assert np.abs(seen - expected(rotation, translation * [1, -1, 1])).max() > 1.5
    if yaw:
        assert np.abs(seen - expected(rotation.T, translation)).max() > 1.5


def test_points_are_on_the_features_that_they_are_named_after():
    video = film(PLAIN)
    picture, at = video.frames[0].astype(float), video.truth.points_px[0]
    from evalkit.vision.points import FACE_POINTS

    def around(*names):
        x, y = np.mean([at[FACE_POINTS.index(name)] for name in names], axis=0).astype(int)
        return picture[y - 2 : y + 3, x - 2 : x + 3].reshape(-1, 3)

    # Blue, green, red: between their outer edges lips are redder than the tip of the nose; lids are dark at the lashes.
    def redness(*names):
        b, g, r = around(*names).mean(axis=0)
        return r / (g + b)

    assert redness("upper lip", "lower lip") > 1.1 * redness("nose tip")
    assert around("upper lid left").min() < 0.6 * around("nose tip").min()


def test_the_same_seed_gives_the_same_video_and_another_one_another():
    film.cache_clear()
    p = replace(PLAIN, frames=3, noise=3.0, light="lamp", flicker=0.2, expression=0.8, crf=23)
    one = film(p, 7)
    film.cache_clear()
    again, other = film(p, 7), film(p, 8)
    assert np.array_equal(one.frames, again.frames) and one.truth.digest() == again.truth.digest()
    assert not np.array_equal(one.frames, other.frames) and one.truth.digest() != other.truth.digest()


def test_the_head_starts_anywhere_near_straight_and_goes_as_far_as_it_is_told():
    starts, reached = [], []
    for seed in range(8):
        truth = made(replace(PLAIN, frames=90, range_deg=(10.0, 30.0, 5.0)), seed)
        angles = head_angles_deg(truth.rotations)
        starts.append(angles[0])
        reached.append(np.abs(angles).max(axis=0))
        assert np.abs(np.linalg.det(truth.rotations) - 1.0).max() < 1e-12
    # Eight draws from normal distributions of 4, 5 and 3 degrees: none is straight, none is beyond four of them.
    assert (np.abs(starts).max(axis=0) > 0.5).all() and (np.abs(starts) < 4 * np.array([4.0, 5.0, 3.0])).all()
    # The extreme posture may fall into the first tenths of a second, in which the motion has hardly begun.
    assert np.median(reached, axis=0)[1] > 25.0 and np.max(reached, axis=0)[1] < 36.0


def called(*arguments):
    """A command as the command line runs it, in this process."""
    app(list(arguments), standalone_mode=False)


def made(parameters, seed=0):
    """The truth alone: no picture is drawn."""
    from evalkit.studies.filmed import _acted, _shot

    return _shot(parameters, *_acted(parameters, seed), seed)[0]


def test_what_does_not_move_has_no_parameters_and_what_acts_has():
    def parameters(preset):
        truth = made(video_parameters(preset, {"head": "template-small"}))
        neutral = truth.neutral_mm[None, :, :2]
        unit = float(eye_distance(neutral)[0])
        base = control_parameters(neutral, unit)[0]
        return truth, normalise(control_parameters(truth.face_mm[..., :2], unit), base)

    turning, still = parameters("video-turning")
    assert np.abs(still).max() < 1e-9 and np.abs(head_angles_deg(turning.rotations)[:, 1]).max() > 15.0
    jaw, acted = parameters("video-jaw")
    assert np.ptp(jaw.rotations, axis=0).max() == 0.0
    # The lips part by more than half of their distance at rest, and nothing happens to the brows.
    assert acted[:, 0].max() > 0.5 and np.abs(acted[:, 10:]).max() < 0.02
    assert np.abs(acted[0]).max() < 1e-9  # the first frame is at rest


def test_an_occluder_hides_what_the_truth_says_and_nothing_else():
    p = replace(PLAIN, frames=13, occluder="hand", drift_mm=0.0)
    with_hand, without = film(p), film(replace(p, occluder="none"))
    truth = with_hand.truth
    assert truth.covered.max() > 0.3 and truth.covered[0] == truth.covered[-1] == 0.0
    hidden = without.truth.visible & ~truth.visible
    frames, points = np.nonzero(without.truth.visible)
    x, y = np.moveaxis(truth.points_px[frames, points].astype(int), 1, 0)
    changed = np.abs(with_hand.frames[frames, y, x].astype(int) - without.frames[frames, y, x]).max(axis=1) > 8
    said = hidden[frames, points]
    # A pixel at the sprite's edge may be called either way, and skin may have the hand's colour: one in ten.
    assert said.sum() > 10 and (changed == said).mean() > 0.95 and changed[said].mean() > 0.9


def test_a_face_that_leaves_is_not_in_the_picture():
    p = replace(PLAIN, frames=15, away=0.6, rate_hz=10.0)
    video = film(p)
    away = np.flatnonzero(~video.truth.present)
    assert 3 <= len(away) < 15 and video.truth.present[0] and video.truth.present[-1]
    background = clutter((p.width, p.height), 0)[..., ::-1].astype(int)
    middle = away[len(away) // 2]
    assert np.abs(video.frames[middle] - background).mean() < 1.0 < 5.0 < np.abs(video.frames[0] - background).mean()
    assert not video.truth.visible[middle].any()


def test_lamps_that_stay_shade_a_head_that_turns():
    head, camera = filmed_face("template-small").head, VideoParameters().camera
    behind = np.zeros((camera.height, camera.width, 3), dtype=np.uint8)
    cheeks, jaws = {}, {}
    vertices = head.nearest_vertices({s: head.marker_sites[f"Cheek{s}"] for s in "LR"})
    sides = head.nearest_vertices({s: head.landmarks[f"jaw {s}"] for s in ("left", "right")})
    for light in LIGHTS:
        with CameraScene(head, camera, light, behind, 600.0) as scene:
            scene.pose(np.eye(3), [0.0, 0.0, -600.0])
            picture = scene.frame(head.vertices)
            x, y = camera.project(head.vertices[list(vertices.values())] + [0, 0, -600.0]).astype(int).T
            cheeks[light] = picture[y, x].astype(float).mean(axis=1)
            x, y = camera.project(head.vertices[list(sides.values())] + [0, 0, -600.0]).astype(int).T
            jaws[light] = picture[y, x].astype(float).mean()
    # The lamp is on the person's left; even light and one at the camera know no sides.
    assert cheeks["lamp"][0] > 1.3 * cheeks["lamp"][1]
    for light in ("even", "camera"):
        assert 0.9 < cheeks[light][0] / cheeks[light][1] < 1.1
    # A lamp beside the camera leaves darker what turns away from it.
    assert jaws["camera"] / cheeks["camera"].mean() < 0.9 * jaws["even"] / cheeks["even"].mean()


def test_sensor_light_and_encoder():
    grey = np.full((40, 60, 3), 100, dtype=np.uint8)
    random = np.random.default_rng(0)
    assert np.array_equal(sensed(grey, 1.0, 0.0, random), grey)
    spread = sensed(grey, 1.0, 2.0, random).std()
    # sqrt(1 + 0.6 * 100 / 25) times two levels, and a twelfth of a level for rounding; 7,200 samples give it to 1 %.
    assert spread == pytest.approx(np.sqrt(4.0 * (1 + 0.6 * 4) + 1 / 12), rel=0.04)
    times = np.arange(90) / 30.0
    assert gains(times, 0.0, 1).tolist() == [1.0] * 90
    flicker = gains(times, 0.15, 1)
    assert flicker[0] == 1.0 and 0.05 < np.log(flicker).std() < 0.3
    frames = [np.roll(clutter((64, 48), 3), k, axis=1) for k in range(4)]
    assert np.array_equal(compressed(frames, 30.0, 0), frames)

    # Of the brightness: at any factor the file keeps a quarter of the colours.
    def brightness(pictures):
        return np.asarray(pictures, dtype=float) @ [0.299, 0.587, 0.114]

    fine, coarse = (
        np.abs(brightness(compressed(frames, 30.0, crf)) - brightness(frames)).mean() for crf in (15, 40)
    )  # fmt: skip
    assert 0.0 < fine < 2.0 < coarse


def test_a_sprite_covers_where_it_is():
    picture = np.zeros((50, 60, 3), dtype=np.uint8)
    sprite = occluder_sprite("bar", 20.0, 0)
    shown, hidden = covered(picture, sprite, 30.0, -5.0)
    columns = np.flatnonzero(hidden.any(axis=0))
    assert columns.min() == 30 and len(columns) == sprite.shape[1]
    assert (shown[~hidden] == 0).all() and shown[hidden].min() > 0


def test_a_photo_is_worn_at_its_points():
    head = filmed_face("template-small").head
    names = list(head.landmarks)
    front = np.array([head.landmarks[name][:2] for name in names])
    random = np.random.default_rng(1)
    # A photo whose colour tells its place, and points turned and scaled against the head, each off by a little.
    turn = 1.5 * np.array([[0.96, 0.28], [0.28, -0.96]])
    pixels = front @ turn.T + [200.0, 250.0] + random.normal(0, 2.0, front.shape)
    columns, rows = np.meshgrid(np.arange(400), np.arange(500))
    photo = Photo(np.stack([columns % 256, rows % 256, columns // 256], axis=2).astype(np.uint8), (400, 500), "x", "")
    worn = wearing_photo(head, photo, type("Some", (), {"places": dict(zip(names, pixels, strict=True))}))
    near = head.nearest_vertices(head.landmarks)
    at = worn.uv[[near[name] for name in names]] * [400, -500] + [0, 500]
    # A vertex is as far from its landmark as vertices are apart, up to 3 mm, which is some 5 pixels.
    off = np.linalg.norm(at - pixels, axis=1)
    assert np.median(off) < 3.0 and off.max() < 8.0
    assert 1.0 < texels_per_mm(worn) < 2.0
    assert worn.photographed and np.isfinite(worn.uv).all() and worn.uv.min() >= 0.0 and worn.uv.max() <= 1.0


def test_every_head_has_its_points_where_they_belong():
    sources = point_sources(filmed_face("template-small").head)
    head = filmed_face("template-small").head
    places = np.array([head.vertices[which].mean(axis=0) for which in sources])
    from evalkit.vision.points import FACE_POINTS, mean_face_points

    assert np.linalg.norm(places - mean_face_points(), axis=1).max() < 4.0  # the nearest vertex of few
    # MakeHuman's head names half of the landmarks; the others follow by a warp.
    few = {name: place for name, place in head.landmarks.items() if "lid" not in name and "wing" not in name}
    guessed = point_sources(replace(head, landmarks=few))
    off = [np.linalg.norm(head.vertices[a].mean(0) - head.vertices[b].mean(0)) for a, b in
           zip(sources, guessed, strict=True)]  # fmt: skip
    assert max(off) < 6.0, dict(zip(FACE_POINTS, off, strict=True))


def test_the_manifest_is_what_the_generator_makes():
    """After a deliberate change: python -m evalkit.studies.filmed > data/videos/MANIFEST.json."""
    kept = json.loads(MANIFEST.read_text(encoding="utf-8"))
    assert kept == json.loads(json.dumps(manifest()))
    assert [video["preset"] for video in kept["videos"]] == list(VIDEO_PRESETS)
    # Control: another seed has other checksums.
    assert kept["videos"][0]["sha256_of_truth"] != made(VIDEO_PRESETS["video-talking"].parameters, 1).digest()


def test_files_hold_the_video_its_truth_and_the_points(tmp_path):
    pytest.importorskip("cv2", reason="pip install evalkit[vision]")
    from evalkit.vision.video import read_video

    settings = ["--set", "head=template-small", "--set", "frames=3"]
    called("synth", "video-talking", "-o", str(tmp_path), "--seed", "3", *settings)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"video-talking.{end}" for end in ("json", "mp4", "points.json", "truth.csv", "truth.npz")]
    video = film(video_parameters("video-talking", {"head": "template-small", "frames": 3}), 3)
    read = read_video(tmp_path / "video-talking.mp4")
    assert read.size == (360, 288) and read.rate_hz == 30.0
    # Two decoders turn the same colours back in different ways, by a level or two.
    assert np.abs(np.stack(list(read)).astype(int) - video.frames).mean() < 2.0
    points = json.loads((tmp_path / "video-talking.points.json").read_text())["points"]
    assert np.abs(np.array(list(points.values())) - video.truth.clicked_px).max() < 0.006  # two decimals
    with np.load(tmp_path / "video-talking.truth.npz") as stored:
        assert np.array_equal(stored["rotations"], video.truth.rotations)
        assert np.array_equal(stored["face_mm"], video.truth.face_mm)
    table = np.loadtxt(tmp_path / "video-talking.truth.csv", delimiter=",", skiprows=1)
    assert np.abs(table[:, [2, 3, 4]] - head_angles_deg(video.truth.rotations)).max() < 1e-5
    about = json.loads((tmp_path / "video-talking.json").read_text())
    assert about["seed"] == 3 and about["sha256_of_truth"] == video.truth.digest()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["video-talking", "--set", "head=elephant"], "elephant"),
        (["video-talking", "--set", "frames=1"], "frames"),
        (["video-talking", "--set", "frames=many"], "whole number"),
        (["video-talking", "--set", "width=361"], "even"),
        (["video-talking", "--set", "wdith=360"], "width"),
        (["video-talking", "--set", "range_deg=10"], "range_deg"),
        (["video-talking", "--set", "actions=sneeze"], "sneeze"),
        (["video-talkin"], "video-talking"),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing(tmp_path, arguments, word):
    with pytest.raises(EvalkitError) as caught:
        called("synth", *arguments, "-o", str(tmp_path / "out"))
    assert word in str(caught.value) and "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_settings_are_read_as_they_are_written():
    for preset in VIDEO_PRESETS.values():
        given = parse_video_overrides(preset.parameters.settings().split())
        assert VideoParameters().replaced(given) == preset.parameters


def test_points_of_the_portrait_are_complete():
    points = read_points(ASTRONAUT_POINTS)
    assert not points.missing and len(points.places) == 39


def test_points_in_the_head_and_in_the_picture_agree():
    truth = made(replace(PLAIN, expression=0.8))
    seen = truth.camera.project(apply_motion(truth.rotations, truth.translations, truth.face_mm))
    assert np.abs(seen - truth.points_px).max() < 1e-9
    assert np.linalg.norm(truth.clicked_px - truth.points_px[0], axis=1).mean() == pytest.approx(1.25, abs=0.5)
    with pytest.raises(EvalkitError, match="preset"):
        write_video("video-nothing", "nowhere")
