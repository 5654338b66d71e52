"""The 19 points in painted faces whose every place is known: expression, blinks, light, loss, occlusion, turns."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.painted_face import DISTANCE_MM, FOCAL, HEIGHT, WIDTH, Act, Painter, depth, exposed, moved
from scipy.spatial.transform import Rotation

from evalkit.errors import EvalkitError
from evalkit.seeds import generator
from evalkit.vision import anatomy, features, patches
from evalkit.vision.camera import Camera
from evalkit.vision.depths import LearntDepths
from evalkit.vision.features import FeatureTracker
from evalkit.vision.frontal import FrontalView
from evalkit.vision.parameters import NAMES, PARAMETERS, control_parameters, eye_distance
from evalkit.vision.points import FACE_POINTS, mean_face_points
from evalkit.vision.track import track
from evalkit.vision.tracker import LOST, HeadPose, TrackStatus

NEUTRAL = mean_face_points()[:, :2]
UNIT = float(eye_distance(NEUTRAL))
CAMERA = Camera(WIDTH, HEIGHT, FOCAL, (WIDTH / 2, HEIGHT / 2))
PIXEL_MM = (DISTANCE_MM) / FOCAL
"""A pixel of the pictures on the face, about 1.4 mm: what is followed to a millimetre is followed within a pixel."""

LENGTHS = [k for k, parameter in enumerate(PARAMETERS) if parameter.unit == "iod"]
LIDS = [row for pair in anatomy.LIDS for row in pair]


def row(name):
    return FACE_POINTS.index(name)


def pose_of(angles_deg=(0.0, 0.0, 0.0)):
    rotation = Rotation.from_euler("xyz", angles_deg, degrees=True).as_matrix()
    # The head turns about a point behind the face, as heads do.
    pivot = np.array([0.0, -20.0, 20.0])
    return HeadPose(
        rotation, pivot - rotation @ pivot + [0.0, -5.0, -DISTANCE_MM - 100.0], TrackStatus.TRACKED, 1.0
    )  # fmt: skip


def pixels(points, pose, person=0.0):
    space = np.concatenate([points, depth(points[:, 0], points[:, 1], person)[:, None]], axis=1)
    return CAMERA.project(space @ pose.rotation.T + pose.translation)


@lru_cache(maxsize=100)
def painted(act, angles_deg, person):
    pose = pose_of(angles_deg)
    return Painter(generator("painted face")).picture(pose.rotation, pose.translation, act, person)


class Film:
    """Painted frames with what is true of them."""

    def __init__(self, acts, angles=None, person=0.0, **light):
        turns = [(0.0, 0.0, 0.0)] * len(acts) if angles is None else [tuple(a) for a in angles]
        self.poses = [pose_of(turn) for turn in turns]
        self.points = np.array([moved(NEUTRAL, act) for act in acts])
        self.pixels = np.array([pixels(p, pose, person) for p, pose in zip(self.points, self.poses, strict=True)])
        random = generator("sensor")
        self.frames = [
            exposed(painted(act, turn, person), random, **light) for act, turn in zip(acts, turns, strict=True)
        ]


def followed(film, poses=None, **options):
    """Points (F, 19, 2) and confidences by the tracker under test, the head's pose being known."""
    tracker = FeatureTracker(CAMERA, origin_mm=0.0, **options)
    poses = poses or film.poses
    found = [tracker.start(film.frames[0], poses[0], film.pixels[0])]
    found += [tracker.step(frame, pose) for frame, pose in zip(film.frames[1:], poses[1:], strict=True)]
    return np.array([points for points, _ in found]), np.array([confidence for _, confidence in found])


def followed_by_flow(film):
    """The same points by pyramidal Lucas-Kanade from frame to frame through the same frontal view."""
    view = FrontalView.of(film.poses[0], CAMERA, film.pixels[0], origin_mm=0.0)
    at = view.pixels(view.from_picture(film.pixels[0], film.poses[0])).astype(np.float32)
    out, last = [view.places(at)], None
    for frame, pose in zip(film.frames, film.poses, strict=True):
        seen = view.warp(frame, pose).astype(np.uint8)
        if last is not None:
            at, _, _ = cv2.calcOpticalFlowPyrLK(last, seen, at, None, winSize=(15, 15), maxLevel=2)
            out.append(view.places(at))
        last = seen
    return np.array(out)


def errors(found, film):
    """Distances (F, 19), mm, of the ways from the first frame."""
    return np.linalg.norm((found - found[0]) - (film.points - film.points[0]), axis=2)


def acting(count=40):
    """Talk, two blinks, a raise of the brows, a smile, glances; it begins and ends at rest."""
    t = np.linspace(0, 1, count)
    pulse = lambda at, width: np.exp(-0.5 * ((t - at) / width) ** 2) * (t > 0) * (t < 1)  # noqa: E731
    blink = np.clip(1.15 * pulse(0.25, 0.035) + 1.15 * pulse(0.7, 0.035), 0, 1)
    jaw, brow = 18 * pulse(0.4, 0.06) + 10 * pulse(0.6, 0.05), 8 * pulse(0.35, 0.1)
    smile, gaze = 6 * pulse(0.8, 0.06), 4 * np.sin(9 * t) * (t < 1)
    return [Act(*(float(v) for v in values)) for values in zip(brow, blink, jaw, smile, gaze, strict=True)]


@lru_cache(maxsize=1)
def acted():
    return Film(acting())


@lru_cache(maxsize=1)
def acted_found():
    return followed(acted())


@lru_cache(maxsize=1)
def acted_by_flow():
    return followed_by_flow(acted())


def test_expressions_are_followed_within_a_pixel_and_better_than_by_flow():
    film, (found, confidence) = acted(), acted_found()
    off = errors(found, film)
    assert np.isfinite(off).mean() > 0.97
    # Half a pixel in the middle; a pixel in the mean square, in which the lips' torn edges weigh most.
    assert np.nanmedian(off) < 0.5 * PIXEL_MM
    assert np.sqrt(np.nanmean(off**2)) < PIXEL_MM
    # Control: the baseline is worse on the same pictures.
    assert np.sqrt((errors(acted_by_flow(), film) ** 2).mean()) > 1.5 * np.sqrt(np.nanmean(off**2))
    assert (confidence[0] == 1).all()
    assert confidence.min() >= 0


def test_there_is_no_drift_at_rest_after_it_all_and_flow_has_some():
    film, (found, _) = acted(), acted_found()
    # Half a pixel: the neutral face is compared with itself, what is left is noise.
    assert errors(found, film)[-1].max() < 0.5 * PIXEL_MM
    assert errors(acted_by_flow(), film)[-1].max() > PIXEL_MM


def test_a_blink_closes_the_eyes_parameters_and_moves_no_brow():
    film = Film([Act(blink=b) for b in (0, 0, 0.4, 1, 1, 0.6, 0.1, 0, 0)])
    found, _ = followed(film)
    parameters, wanted = control_parameters(found, UNIT), control_parameters(film.points, UNIT)
    for name in ("eye_left", "eye_right"):
        gap, true = (p[:, NAMES.index(name)] for p in (parameters, wanted))
        # The difference of two places, each within a pixel, of an opening of six pixels.
        np.testing.assert_allclose(gap, true, atol=np.sqrt(2) * PIXEL_MM / UNIT)
        assert gap[3:5].max() < 0.3 * gap[0]
    brows = parameters[:, [k for k, name in enumerate(NAMES) if name.startswith("brow_height")]]
    # A pixel: where the lashes end, the corners' patches change with the lids, and heights are taken from the corners.
    assert np.nanmax(np.abs(brows - brows[0])) < PIXEL_MM / UNIT
    # Control: taken from the lids themselves, they would go up by half of the eyes' opening.
    lids = found[:, LIDS, 1].mean(axis=1)
    assert np.ptp(lids) > 2 * PIXEL_MM


def test_lids_go_up_and_down_only_and_without_that_rule_they_follow_the_gaze(monkeypatch):
    film = Film([Act(gaze=g) for g in (0, 1.5, 3, 4.5, 4.5, 3, 0, -3, -4.5)])

    def sideways():
        found, _ = followed(film)
        return np.nanmax(np.abs(found - found[0])[:, LIDS, 0])

    # Lids may move by a fifth of a millimetre against the corners, which noise moves by a few tenths.
    assert sideways() < 0.6
    free = anatomy.SPREAD_MM.copy()
    free[LIDS, 0] = 8.0
    monkeypatch.setattr(anatomy, "SPREAD_MM", free)
    monkeypatch.setattr(patches, "UPRIGHT", np.zeros(19, dtype=bool))
    monkeypatch.setattr(features, "_STIFFNESS", features.RESIDUAL * features.PIXEL_MM**2 * anatomy.ways_precision())
    monkeypatch.setattr(features, "_SPREAD", free / features.PIXEL_MM)
    assert sideways() > 1.2


def test_expressions_met_before_become_references_and_without_them_points_are_less_sure():
    film = acted()
    (_, confidence), (alone, confidence_alone) = acted_found(), followed(film, references=False)
    mouth = [row(name) for name in ("upper lip", "lower lip", "mouth corner left", "mouth corner right")]
    assert confidence[:, LIDS + mouth].mean() > confidence_alone[:, LIDS + mouth].mean()
    # On this face, in whose mouth nothing is to be seen, the neutral patches find the places alone.
    assert np.nanmedian(errors(alone, film)) < 0.5 * PIXEL_MM


def opening(points):
    """How much wider the gap between the lips is than in the first frame (F,), mm."""
    gap = points[:, row("upper lip"), 1] - points[:, row("lower lip"), 1]
    return gap - gap[0]


def test_a_mouth_that_opens_wide_is_followed_and_without_its_contrast_the_inner_edge_is_taken(monkeypatch):
    film = Film([Act(jaw=jaw) for jaw in (0.0, 0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 28.0, 28.0, 20.0, 10.0, 0.0)])
    wanted = opening(film.points)

    def short():
        found, _ = followed(film)
        return np.nanmax(np.abs(opening(found) - wanted))

    # A tenth of the opening: the skin below the lip, by which it is followed, goes less far than its edge.
    assert short() < 0.1 * wanted.max()
    monkeypatch.setattr(features, "CONTRAST", 1e6)
    # The lip is as thick as that.
    assert short() > 8.0


def test_a_jaw_that_opens_in_every_nod_is_not_taken_for_depth_and_with_a_depth_of_its_own_it_is(monkeypatch):
    swing = np.sin(np.linspace(0, np.pi, 12)) ** 2
    film = Film([Act(jaw=24 * s) for s in swing], np.stack([-12 * swing, 0 * swing, 0 * swing], axis=1))
    film.frames, film.poses, film.points = 5 * film.frames, 5 * film.poses, np.tile(film.points, (5, 1, 1))
    wanted = opening(film.points)

    def off():
        found, _ = followed(film)
        return np.nanmax(np.abs(opening(found) - wanted)[-12:])

    shared = off()
    # Two pixels each for upper and lower lip: the painted jaw goes forward along the hill, which no depth here knows.
    assert shared < 4 * PIXEL_MM
    lower = row("lower lip")
    monkeypatch.setattr(features, "LIPS", [lower, lower])
    assert off() > 1.5 * shared


@pytest.mark.parametrize("light", [{"gain": 0.6}, {"gain": 1.3, "slope": 0.5}, {"noise": 6.0}])
def test_light_and_noise_of_the_sensor_hardly_matter(light):
    acts = acting()[8:20]
    acts[0] = Act()
    clean = Film(acts)
    film = Film(acts, **light)
    # The first frame is the well-lit one: the light changes while the face is tracked.
    film.frames[0] = clean.frames[0]
    off = errors(followed(film)[0], film)
    # A pixel and a half: brightness and contrast of a patch are normalised, its slope and the noise are not.
    assert np.sqrt(np.nanmean(off**2)) < 1.5 * PIXEL_MM
    assert np.isfinite(off).mean() > 0.95


def test_a_lost_head_has_no_points_and_they_are_back_at_once():
    acts = acting()
    film = acted()
    gone = slice(9, 16)
    poses = [LOST if 9 <= k < 16 else pose for k, pose in enumerate(film.poses)]
    found, confidence = followed(film, poses)
    assert np.isnan(found[gone]).all()
    assert (confidence[gone] == 0).all()
    # Lost with open eyes and a closed mouth, found with an open one.
    assert acts[16].jaw > 10
    off = errors(found, film)
    assert np.nanmedian(off[16]) < PIXEL_MM
    assert np.sqrt(np.nanmean(off[20:] ** 2)) < 1.2 * PIXEL_MM


def test_what_a_hand_covers_is_not_known_and_the_rest_is():
    film = Film([Act()] * 8)
    hand = 40 + 10 * generator("hand").standard_normal((70, WIDTH))
    for frame in film.frames[3:6]:
        frame[90:160] = np.clip(hand, 0, 255)
    found, confidence = followed(film)
    covered = (film.pixels[0, :, 1] > 106) & (film.pixels[0, :, 1] < 144)
    free = film.pixels[0, :, 1] < 78
    assert covered.sum() >= 3
    assert (confidence[3:6, covered] == 0).all()
    assert np.isnan(found[3:6, covered]).all()
    assert confidence[3:6, free].min() > 0.4
    # Nobody moved: what was covered is where it was, within noise.
    assert np.abs(found[6:] - found[0]).max() < 0.5 * PIXEL_MM


def turned(count=24, person=6.0):
    """A face that looks to and fro and nods, without expression, and is another one than the mean face."""
    t = np.linspace(0, 2 * np.pi, count)
    angles = np.stack([8 * np.sin(2 * t), 18 * np.sin(t), 3 * np.sin(3 * t)], axis=1)
    return Film([Act()] * count, angles, person)


def test_a_turn_of_the_head_moves_no_parameter_by_three_percent_and_on_a_cylinder_it_does():
    film = turned()
    change = {}
    for name in ("learnt", "face", "cylinder"):
        tracker = FeatureTracker(CAMERA, name, origin_mm=0.0)
        found = [tracker.start(film.frames[0], film.poses[0], film.pixels[0])[0]]
        slopes, offsets = [tracker.slopes.copy()], [tracker.offset_mm.copy()]
        for frame, pose in zip(film.frames[1:], film.poses[1:], strict=True):
            found.append(tracker.step(frame, pose)[0])
            slopes.append(tracker.slopes.copy())
            offsets.append(tracker.offset_mm.copy())
        settled = np.array(found) + (offsets[-1] - np.array(offsets))[:, :, None] * np.array(slopes)
        p = control_parameters(settled, UNIT)[:, LENGTHS]
        change[name] = np.nanmax(np.abs(p - p[0]))
    assert change["learnt"] < 0.03
    assert change["cylinder"] > 2 * change["learnt"]
    assert change["learnt"] < change["face"]


@settings(derandomize=True, deadline=None, max_examples=40, database=None)
@given(st.integers(0, 10_000), st.integers(3, 30))
def test_learnt_depths_are_those_of_weighted_least_squares_with_a_prior(seed, frames):
    random = generator("depths", seed)
    slopes, places = random.normal(0, 0.3, (frames, 4, 2)), random.normal(0, 2, (frames, 4, 2))
    weight = random.uniform(0, 1, (frames, 4)) * (random.random((frames, 4)) > 0.2)
    spread = np.full((4, 2), 3.0)
    groups = np.array([0, 1, 0, 3])
    learnt = LearntDepths(spread, groups)
    for values in zip(slopes, places, weight, strict=True):
        learnt.learn(*values)
    ridge = 6 * ((0.5 * 3.0) ** 2 + 1.0) / 8.0**2
    for group in (0, 1, 3):
        # Unknown: the group's depth and two coordinates of each of its points; the prior is a further row.
        members = np.flatnonzero(groups == group)
        rows, wanted = [np.sqrt(ridge) * np.eye(1 + 2 * len(members))[0]], [0.0]
        for n, k in enumerate(members):
            for m, x, w in zip(slopes[:, k], places[:, k], weight[:, k], strict=True):
                for axis in (0, 1):
                    line = np.zeros(1 + 2 * len(members))
                    line[0], line[1 + 2 * n + axis] = -m[axis], 1.0
                    rows.append(np.sqrt(w) * line)
                    wanted.append(np.sqrt(w) * x[axis])
        best = np.linalg.lstsq(np.array(rows), np.array(wanted))[0][0]
        np.testing.assert_allclose(learnt.offset_mm[members], np.clip(best, -15, 15), atol=1e-9)


def test_places_of_the_frontal_view_and_of_the_frame_are_each_others_inverse():
    view = FrontalView.of(pose_of(), CAMERA, pixels(NEUTRAL, pose_of()), origin_mm=0.0)
    pose = pose_of((6, 14, 4))
    back = view.from_picture(view.to_picture(NEUTRAL, pose), pose)
    # A twentieth of the view's pixel: depths between the view's pixels are interpolated.
    np.testing.assert_allclose(back, NEUTRAL, atol=0.05)
    np.testing.assert_allclose(view.places(view.pixels(NEUTRAL)), NEUTRAL, atol=1e-9)


def test_a_large_picture_is_made_smaller_before_it_is_warped():
    """A picture four times as large must not be read at one pixel in sixteen: noise averages out."""
    random = generator("large")
    large = Camera(4 * WIDTH, 4 * HEIGHT, 4 * FOCAL, (2 * WIDTH, 2 * HEIGHT))
    noise = np.clip(128 + 20 * random.standard_normal((4 * HEIGHT, 4 * WIDTH)), 0, 255).astype(np.uint8)
    view = FrontalView.of(pose_of(), large, 4 * pixels(NEUTRAL, pose_of()), origin_mm=0.0)
    assert view.warp(noise, pose_of()).std() < 12


class Known:
    """A tracker that is told the poses."""

    def __init__(self, poses):
        self.poses = list(poses)

    def start(self, frame, camera, points_px):
        return self.poses.pop(0)

    def step(self, frame):
        return self.poses.pop(0)


def test_a_whole_video_gives_poses_points_and_parameters():
    film = acted()
    poses = [LOST if k == 12 else pose for k, pose in enumerate(film.poses)]
    done = []
    result = track(film.frames, film.pixels[0], CAMERA, Known(poses), progress=done.append, rate_hz=30)
    count = len(film.frames)
    assert done == list(range(1, count + 1))
    shapes = [a.shape for a in (result.points_px, result.frontal_mm, result.confidence, result.parameters)]
    assert shapes == [(count, 19, 2), (count, 19, 2), (count, 19), (count, 15)]
    assert result.head.status.tolist() == [2 if k == 12 else 0 for k in range(count)]
    assert result.head.times_s[-1] == pytest.approx((count - 1) / 30)
    assert np.isnan(result.parameters[12]).all()
    assert np.isnan(result.points_px[12]).all()
    off = np.linalg.norm(result.points_px - film.pixels, axis=2)
    # Half a pixel in the middle, as through the frontal view.
    assert np.nanmedian(off) < 0.5
    found = result.parameters - result.parameters[0]
    wanted = control_parameters(film.points, UNIT)
    assert np.sqrt(np.nanmean((found - wanted + wanted[0])[:, LENGTHS] ** 2)) < PIXEL_MM / UNIT


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda f: track([], f.pixels[0], CAMERA), "no frames"),
        (lambda f: FeatureTracker(CAMERA).step(f.frames[0], f.poses[0]), "start before the first step"),
        (lambda f: FeatureTracker(CAMERA).start(f.frames[0], LOST, f.pixels[0]), "head is lost"),
        (lambda f: FeatureTracker(CAMERA, "bones").start(f.frames[0], f.poses[0], f.pixels[0]), "depth 'bones'"),
        (lambda f: FeatureTracker(CAMERA).start(f.frames[0], f.poses[0], f.pixels[0][:5]), "expected 19"),
        (lambda f: FeatureTracker(CAMERA).start(f.frames[0], f.poses[0], 0 * f.pixels[0] + 4), "no head's"),
    ],
)
def test_bad_input_gets_one_line(call, told):
    with pytest.raises(EvalkitError) as caught:
        call(acted())
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)
