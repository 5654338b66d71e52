"""A take played on a head: labels, rest, gaps, lids, jaw, lips and head motion."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from realdata import real_data
from small_head import small_head

import evalkit
from evalkit.animation import animate
from evalkit.animation.alignment import align
from evalkit.animation.checks import check, mouth_correlation
from evalkit.animation.gaps import SHORT_GAP_S, fill_gaps, fill_rotations
from evalkit.animation.head_motion import LIMIT_DEG, idle_motion
from evalkit.animation.jaw import jaw_motion
from evalkit.animation.labels import label_sets, match_labels, read_label_map
from evalkit.animation.lids import EVERY_S, blink_times, blink_track
from evalkit.animation.lips import find_lips, overlap
from evalkit.animation.rest import rest_pose
from evalkit.bundled import bundled_take
from evalkit.errors import EvalkitError
from evalkit.geometry import rotation_from_vector

HEAD = small_head()
SITES = np.array(list(HEAD.marker_sites.values()))
NAMES = list(HEAD.marker_sites)


def still_take(moved=None, labels=None, rate=60.0):
    """A take of the head's own marker sites, whose displacement on the head is the one given."""
    moved = np.zeros((60, len(NAMES), 3)) if moved is None else moved
    return evalkit.Capture(SITES + moved, labels or NAMES, rate)


def opening_take(frames=90, largest_mm=20.0):
    """Rest for a third of the time, then the mouth opens and closes twice, as a jaw that turns about its axis."""
    moved = np.zeros((frames, len(NAMES), 3))
    active = np.clip(np.arange(frames) - frames // 3, 0, None) / (frames - frames // 3)
    amount = np.sin(2 * np.pi * active) ** 2
    at = HEAD.nearest_vertices(HEAD.marker_sites)
    arm = SITES - HEAD.jaw.axis
    share = HEAD.jaw.weights[[at[name] for name in NAMES]]
    angle = np.deg2rad(largest_mm / 5.0) * amount[:, None] * share
    moved[..., 1] = np.cos(angle) * arm[:, 1] - np.sin(angle) * arm[:, 2] - arm[:, 1]
    moved[..., 2] = np.sin(angle) * arm[:, 1] + np.cos(angle) * arm[:, 2] - arm[:, 2]
    return still_take(moved)


@pytest.fixture(scope="module")
def talking():
    take = evalkit.read_capture(bundled_take("talking")[0])
    # Four seconds: the first turn beyond 30 degrees and two blinks are in them.
    return evalkit.Capture(take.points[:240], take.labels, take.rate)


@pytest.fixture(scope="module")
def played(talking):
    return animate(talking, HEAD)


# ---- labels ----------------------------------------------------------------------------------------------------


def test_labels_of_the_public_set_are_known_as_data():
    known = label_sets()["animface"]
    assert sorted(known.values()) == sorted(NAMES)
    assert match_labels(list(known), NAMES)[1] == "by the labels of animface"


@pytest.mark.parametrize("style", ["{}", "Subject:{}", "  {}"])
def test_site_names_are_found_with_prefix_and_other_letters(style):
    labels = [style.format(name).strip() for name in NAMES]
    assert match_labels(labels, NAMES)[0] == dict(zip(NAMES, labels, strict=True))
    assert match_labels([label.lower().replace("lip", "_lip") for label in labels], NAMES)[1] == "by their names"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Chin", "neither a file"),
        ("Chin=", "is not Label=Site"),
        ("Chn=Chin,a=LidL,b=LidR,c=CheekL", "no marker 'Chn'; did you mean Chin"),
        ("Chin=Chinn", "no marker site 'Chinn'; did you mean Chin"),
        ("Chin=Chin,LidL=Chin", "both Chin and LidL are put on Chin"),
    ],
)
def test_a_wrong_mapping_is_one_line_with_the_nearest_name(text, words):
    with pytest.raises(EvalkitError, match=words) as error:
        match_labels(NAMES, NAMES, read_label_map(text))
    assert "\n" not in str(error.value)


def test_a_mapping_file_is_read_and_refused(tmp_path):
    path = tmp_path / "map.json"
    path.write_text(json.dumps({"a": "Chin"}))
    assert read_label_map(str(path)) == {"a": "Chin"}
    for bad in ("[1]", "{", '{"a": 1}'):
        path.write_text(bad)
        with pytest.raises(EvalkitError, match=r"map\.json"):
            read_label_map(str(path))


def test_unknown_labels_get_the_nearest_sites_suggested():
    labels = [f"mk_{k}" for k in range(len(NAMES))]
    labels[3] = "UpLip_C"
    with pytest.raises(EvalkitError, match=r"--map UpLip_C=UpperLipC.*position"):
        animate(still_take(labels=labels), HEAD, compensated=True)


def test_markers_are_found_by_position_under_any_pose_and_size():
    labels = [f"mk_{k}" for k in range(len(NAMES))]
    turn = rotation_from_vector(np.deg2rad([8.0, -12.0, 6.0]))
    rng = np.random.default_rng(0)
    # 3 mm: a face of other proportions, less than half the least distance between sites.
    places = 1.2 * SITES @ turn.T + [300.0, -200.0, 900.0] + rng.normal(scale=3.0, size=SITES.shape)
    take = evalkit.Capture(np.repeat(places[None], 20, axis=0), labels, 60.0)
    found = animate(take, HEAD, compensated=True, label_map="position").report["markers"]
    assert found == dict(zip(NAMES, labels, strict=True))
    # Control: a cloud that is no face is refused.
    cloud = evalkit.Capture(np.repeat(rng.normal(scale=80, size=(1, 23, 3)), 20, axis=0), labels, 60.0)
    with pytest.raises(EvalkitError, match="do not lie like those of a face"):
        animate(cloud, HEAD, compensated=True, label_map="position")


def test_too_few_markers_and_a_head_without_a_site_are_one_line():
    take = still_take()
    with pytest.raises(EvalkitError, match="at least 4"):
        animate(take, HEAD, compensated=True, label_map={name: name for name in NAMES[:3]})
    gone = np.array(take.points)
    gone[:, 4:] = np.nan
    gone[3:, 0] = np.nan
    with pytest.raises(EvalkitError, match=r"3 markers of the take can drive the head"):
        animate(evalkit.Capture(gone, NAMES, 60.0), HEAD, compensated=True)
    sites = {name: place for name, place in HEAD.marker_sites.items() if name != "Chin"}
    with pytest.raises(EvalkitError, match="no marker site Chin"):
        animate(take, dataclasses.replace(HEAD, marker_sites=sites), compensated=True)


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"gaps": "x"}, "gaps 'x'"),
        ({"head_motion": "x"}, "head motion 'x'"),
        ({"unmapped": "x"}, "unmapped 'x'"),
        ({"fps": 0.0}, "0 frames per second"),
        ({"neutral": 60}, "neutral frame 60 is not one of the take's 0 to 59"),
        ({"neutral": "x"}, "neutral 'x'"),
        ({"kernel": "exponentiel"}, "did you mean exponential"),
    ],
)
def test_wrong_options_are_one_line(option, words):
    with pytest.raises(EvalkitError, match=words):
        animate(still_take(), HEAD, compensated=True, **option)


# ---- rest, alignment, placing ----------------------------------------------------------------------------------


def test_rest_is_the_closed_mouth_also_when_it_is_mostly_open():
    moved = np.zeros((200, 4, 3))
    moved[40:, 1, 1] = -10.0 - 5.0 * np.sin(np.arange(160))
    # A closed smile for a few frames is not the rest.
    moved[:8, 2, 0] = 6.0
    points = np.array([[0.0, 0, 0], [0, -10, 0], [20, 0, 0], [0, 50, 0]]) + moved
    rest, frame = rest_pose(points, (0, 1))
    np.testing.assert_allclose(rest, points[20], atol=1e-12)
    assert 8 <= frame < 40
    # Control: without regard to the lips the rest is not closed.
    assert rest_pose(points, None)[0][1, 1] < -15


def test_alignment_recovers_a_similarity_and_refuses_a_line():
    turn = rotation_from_vector([0.3, -0.5, 0.2])
    found = align((SITES - 5.0) @ turn / 1.3, SITES)
    assert found.scale == pytest.approx(1.3)
    assert found.residual_mm < 1e-9
    with pytest.raises(EvalkitError, match="not in one line"):
        align(np.outer(np.arange(5.0), [1, 2, 3]), np.zeros((5, 3)))


def test_unmapped_markers_are_placed_where_they_lie_or_left_out():
    extra = {"jaw side": [42.0, -42.0, 90.0], "helmet": [0.0, 200.0, 90.0], "twin": SITES[0] + [0, 1.0, 0]}
    labels = [*NAMES, *extra]
    points = np.repeat(np.vstack([SITES, *extra.values()])[None], 30, axis=0)
    made = animate(evalkit.Capture(points, labels, 60.0), HEAD, compensated=True)
    assert list(made.report["placed"]) == ["jaw side"]
    assert set(made.report["left_out"]) == {"helmet", "twin"}
    # It is put on the skin, at most as far as it was off it.
    assert np.linalg.norm(made.placed["jaw side"] - extra["jaw side"]) < 8.0
    ignored = animate(evalkit.Capture(points, labels, 60.0), HEAD, compensated=True, unmapped="ignore")
    assert not ignored.report["placed"]


# ---- gaps ------------------------------------------------------------------------------------------------------


def test_short_gaps_are_bridged_and_long_ones_held_then_eased():
    rate, track = 60.0, np.arange(100.0)
    values = np.repeat(track[:, None, None], 3, axis=2)
    short = int(SHORT_GAP_S * rate)
    values[10 : 10 + short] = np.nan
    values[40:70] = np.nan
    held = fill_gaps(values, rate, "hold")
    # A straight line through a gap in a straight line is exact but for rounding.
    np.testing.assert_allclose(held.values[10 : 10 + short, 0, 0], track[10 : 10 + short], atol=1e-9)
    assert held.short.sum() == short
    assert held.long.sum() == 30
    assert (held.values[40 : 70 - short, 0, 0] == 39).all()
    steps = np.diff(held.values[:, 0, 0])
    assert steps.max() <= 31 / short + 1e-9
    np.testing.assert_allclose(fill_gaps(values, rate, "interpolate").values[:, 0, 0], track, atol=1e-9)


def test_gaps_at_the_ends_hold_and_rotations_stay_rotations():
    values = np.full((50, 2, 3), np.nan)
    values[20:30] = 1.0
    assert (fill_gaps(values, 60.0).values == 1.0).all()
    turns = rotation_from_vector(np.linspace(0, 1, 50)[:, None] * [0.0, 1.0, 0.0])
    gappy = turns.copy()
    gappy[[0, *range(10, 40), 49]] = np.nan
    for mode in ("hold", "interpolate"):
        filled = fill_rotations(gappy, 60.0, mode)
        np.testing.assert_allclose(
            filled @ filled.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (50, 3, 3)), atol=1e-9
        )
    # One axis at constant speed: the shortest turn through the gap is the motion itself, but for the ends.
    np.testing.assert_allclose(filled[1:-1], turns[1:-1], atol=1e-9)


@pytest.mark.parametrize("mode", ["hold", "interpolate"])
def test_no_missing_marker_reaches_the_screen_and_its_frames_are_marked(talking, mode):
    points = np.array(talking.points[:150])
    rng = np.random.default_rng(1)
    points[rng.random(points.shape[:2]) < 0.1] = np.nan
    chin = talking.labels.index("Chin")
    points[50:80, chin] = np.nan
    points[100:120] = np.nan
    made = animate(evalkit.Capture(points, talking.labels, 60.0), HEAD, gaps=mode)
    assert np.isfinite(made.vertices(range(0, 150, 5))).all()
    assert np.isfinite(made.rotations).all()
    assert np.isfinite(made.translations).all()
    assert made.held[60]
    assert made.held[105:115].all()
    assert not made.held.all()
    assert made.report["gaps"]["marked_frames"] == made.held.sum()
    assert np.isnan(made.raw_markers).any()


# ---- lids, jaw, lips -------------------------------------------------------------------------------------------


def test_blinks_come_about_every_four_seconds_irregularly_and_by_seed():
    starts = blink_times(4000.0, seed=1)
    gaps = np.diff(starts)
    # 1000 gaps whose spread is 1.3 s: their mean is known to 0.04 s, three of which are allowed.
    assert abs(gaps.mean() - EVERY_S) < 0.13
    assert 0.8 < gaps.std() < 2.0
    assert gaps.min() > 0.5
    np.testing.assert_array_equal(starts, blink_times(4000.0, seed=1))
    assert len(np.intersect1d(starts, blink_times(4000.0, seed=2))) == 0
    track = blink_track(np.arange(0.0, 100.0, 1 / 30), blink_times(100.0))
    assert track.max() > 0.95
    assert track.min() == 0.0
    # Open most of the time: a blink takes a third of a second out of four.
    assert (track > 0.5).mean() < 0.1


def test_lid_markers_drive_the_lids_where_they_blink_and_only_there(played):
    assert played.report["lids"]["source"] == "markers"
    still = animate(still_take(np.zeros((600, 23, 3))), HEAD, compensated=True)
    assert still.report["lids"]["source"] == "generated"
    assert still.report["lids"]["blinks"] == len(blink_times(599 / 60.0)) > 0
    shut = int(still.lids_closed[:, 0].argmax())
    closed = still.vertices([shut])[0]
    expected = HEAD.posed(lids_closed=float(still.lids_closed[shut, 0]))
    # Single precision over 200 mm.
    np.testing.assert_allclose(closed, expected, atol=1e-4)


def test_lower_teeth_follow_the_jaw_that_the_chin_shows():
    made = animate(opening_take(), HEAD, compensated=True)
    widest = int(made.jaw_deg.argmax())
    # The marker is moved by the jaw alone, so its angle comes back; the rest is rounding.
    assert made.jaw_deg[widest] == pytest.approx(4.0, abs=0.02)
    teeth = HEAD.part_vertices("lower teeth")
    expected = HEAD.posed(jaw_deg=made.jaw_deg[widest])[teeth]
    np.testing.assert_allclose(made.vertices([widest])[0][teeth], expected, atol=0.05)
    upper = HEAD.part_vertices("upper teeth")
    np.testing.assert_allclose(made.vertices([widest])[0][upper], HEAD.vertices[upper], atol=1e-4)
    angle, glide = jaw_motion(HEAD, {"Chin": np.array([[3.0, 0.0, 0.0], [0.0, 5.0, 0.0]])})
    # Sideways is a glide; upwards the teeth are in the way.
    np.testing.assert_allclose(angle, 0.0, atol=1e-9)
    assert glide[0, 0] == 3.0


def test_lips_pressed_together_touch_and_do_not_cross(monkeypatch):
    moved = np.zeros((40, 23, 3))
    for name in ("LowerLipC", "LowerLipL", "LowerLipR"):
        moved[20:, NAMES.index(name), 1] = 6.0
    take = still_take(moved)
    made = animate(take, HEAD, compensated=True, neutral=0)
    assert check(made)["crossing_frames"] == 0
    # Control: without the contact they go through each other, by most of what the markers moved.
    monkeypatch.setattr("evalkit.animation.performance.part_lips", lambda *_: None)
    assert check(made)["crossing_frames"] == 20
    assert overlap(find_lips(HEAD), made.vertices([30])).max() > 2.0


# ---- the whole -------------------------------------------------------------------------------------------------


def test_the_mouth_opens_when_the_take_opens_it():
    take = opening_take()
    found = check(animate(take, HEAD, compensated=True))
    # The same rotation drives both; the lips' own field is not exactly proportional to it.
    assert found["mouth_correlation"] > 0.99
    assert found["flipped_frames"] == 0
    assert found["crossing_frames"] == 0
    # Control: chin and forehead exchanged, the mouth no longer follows.
    swapped = {name: name for name in NAMES} | {"Chin": "ForeheadC", "ForeheadC": "Chin"}
    swapped |= {"UpperLipC": "LowerLipC", "LowerLipC": "UpperLipC"}
    made = animate(take, HEAD, compensated=True, label_map=swapped)
    assert (check(made)["mouth_correlation"] or 0.0) < 0.5


def test_left_and_right_exchanged_show_up(talking, played):
    exchanged = {}
    for name in NAMES:
        exchanged[name] = name[:-1] + {"L": "R", "R": "L"}.get(name[-1], name[-1])
    names = {name: name for name in NAMES}
    good = animate(talking, HEAD, label_map=names)
    bad = animate(talking, HEAD, label_map=exchanged)
    # A mirrored face cannot be turned onto a face: what is left of the distances is millimetres, not centimetres.
    assert good.report["alignment"]["residual_mm"] < 3.0
    assert bad.report["alignment"]["residual_mm"] > 10.0
    assert any("exchanged" in note for note in bad.notes)
    assert not any("exchanged" in note for note in good.notes)
    assert played.report["markers"] == names


def test_a_head_without_jaw_lids_and_mouth_still_moves():
    parts = {"skin": HEAD.parts["skin"]}
    bare = dataclasses.replace(HEAD, jaw=None, lids=None, parts=parts)
    made = animate(opening_take(), bare, compensated=True)
    assert made.report["lids"]["blinks"] == 0
    assert made.jaw_deg.max() == 0
    found = check(made)
    assert found["mouth_correlation"] is None
    assert found["largest_step_mm"] > 0.1


def test_a_popping_marker_shows_in_the_largest_step():
    smooth = check(animate(opening_take(), HEAD, compensated=True))
    points = np.array(opening_take().points)
    points[60:, NAMES.index("CheekL")] += [0.0, 15.0, 0.0]
    popped = check(animate(evalkit.Capture(points, NAMES, 60.0), HEAD, compensated=True))
    assert smooth["largest_step_mm"] < 3.0
    assert not smooth["warnings"]
    assert popped["largest_step_mm"] > 8.0
    assert popped["largest_step_frame"] == 60
    assert "frame 60" in popped["warnings"][0]
    # Control: for a frame or two it is an outlier, taken as missing and bridged.
    points[62:] = opening_take().points[62:]
    bridged = animate(evalkit.Capture(points, NAMES, 60.0), HEAD, compensated=True)
    assert bridged.report["gaps"]["spikes"] == 2
    assert check(bridged)["largest_step_mm"] < 3.0


def test_head_motion_is_put_back_left_off_or_idle(talking, played):
    nose = HEAD.nearest_vertices({"n": HEAD.landmarks["nose tip"]})["n"]
    vertices = played.vertices(range(0, 240, 30))
    shown = np.einsum("fij,fj->fi", played.rotations[::30], vertices[:, nose]) + played.translations[::30]
    bridge = NAMES.index("NoseBridge")
    # The nose on screen goes where the raw marker beside it goes: 3 mm for skin, other lever arm and the median.
    moved = played.raw_markers[::30, bridge] - played.raw_markers[0, bridge]
    np.testing.assert_allclose(shown - shown[0], moved, atol=0.25 * np.abs(moved).max())
    still = animate(talking, HEAD, head_motion="still")
    assert (still.rotations == np.eye(3)).all()
    rotations, _ = idle_motion(np.arange(0, 60, 0.1), seed=0)
    assert 0.01 < np.abs(rotations - np.eye(3)).max() < 0.15


def test_turns_beyond_the_limit_are_said_with_their_frames(talking, played):
    angle = np.rad2deg(np.arccos(np.clip((np.trace(played.rotations, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    assert played.report["frames_beyond_2.5d"] == (angle > LIMIT_DEG).sum() > 0
    assert any("30 degrees" in note for note in played.notes)
    still = animate(talking, HEAD, head_motion="still")
    assert not any("30 degrees" in note for note in still.notes)


def test_other_rates_show_the_take_at_their_instants(talking, played):
    made = animate(talking, HEAD, fps=25.0)
    assert made.frames == int((talking.frames - 1) / talking.rate * 25.0) + 1
    at = made.source_frames
    whole = np.isclose(at, np.rint(at))
    np.testing.assert_allclose(
        made.displacements[whole], played.displacements[np.rint(at[whole]).astype(int)], atol=1e-9
    )
    low = played.displacements[np.floor(at).astype(int)]
    high = played.displacements[np.ceil(at).astype(int)]
    share = (at - np.floor(at))[:, None, None]
    np.testing.assert_allclose(made.displacements, low + share * (high - low), atol=1e-9)


def test_the_same_input_gives_the_same_vertices_and_batches_equal_single_frames(talking, played):
    again = animate(talking, HEAD)
    frames = [3, 119, 211]
    np.testing.assert_array_equal(played.vertices(frames), again.vertices(frames))
    for k, frame in enumerate(frames):
        # Single precision products in another order of summation.
        np.testing.assert_allclose(played.vertices(frames)[k], played.vertices([frame])[0], atol=1e-4)


def test_a_performer_of_other_size_and_axes_drives_the_same_face(talking):
    named = {name: name for name in NAMES}
    here = animate(talking, HEAD, compensated=False, label_map=named)
    turn = rotation_from_vector([0.2, 1.0, -0.3])
    other = evalkit.Capture(1.15 * talking.points @ turn.T + 500.0, talking.labels, talking.rate)
    there = animate(other, HEAD, label_map=named)
    # The chosen scale undoes the size, the alignment the axes; sampling noise of the estimates is all that is left.
    np.testing.assert_allclose(here.displacements, there.displacements, atol=0.6)


def test_a_real_take_moves_the_mouth_and_nothing_breaks():
    whole = evalkit.read_capture(real_data("captures", "animface_jaw.c3d"))
    # Seven seconds with the widest opening of the take in them.
    take = evalkit.Capture(whole.points[:450], whole.labels, whole.rate, whole.unit)
    made = animate(take, HEAD)
    found = check(made)
    assert len(made.report["markers"]) == 23
    assert len(made.report["placed"]) >= 15
    # 0.98 on the full head; the chin also glides sideways in this take, which opens no mouth.
    assert found["mouth_correlation"] > 0.95
    assert found["crossing_frames"] == 0
    # A fast jaw closes at some 200 mm/s: 3 mm from frame to frame at 60 Hz.
    assert found["largest_step_mm"] < 3.0
    assert found["flipped_frames"] == 0
    assert not found["warnings"]
    assert not any("exchanged" in note for note in made.notes)
    # Control: the chin's track played backwards.
    backwards = np.array(made.still_markers)
    chin = made.report["marker_order"].index("Chin")
    backwards[:, chin] = backwards[::-1, chin]
    opening = -overlap(find_lips(HEAD), made.vertices(range(0, made.frames, 10)))
    track = np.interp(np.arange(made.frames), np.arange(0, made.frames, 10), np.median(opening, axis=1))
    assert mouth_correlation(dataclasses.replace(made, still_markers=backwards), track) < 0.5
