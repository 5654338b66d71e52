"""The fifteen control parameters: against plain trigonometry, under mirrors and scales, at closure and in blinks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.parameter_oracles import frame_parameters
from realdata import real_data

import evalkit
from evalkit.errors import EvalkitError
from evalkit.seeds import generator
from evalkit.vision.markers import frontal_markers
from evalkit.vision.parameters import (
    NAMES,
    PARAMETERS,
    control_parameters,
    denormalise,
    eye_distance,
    neutral_parameters,
    normalise,
)
from evalkit.vision.points import FACE_POINTS, mean_face_points

quick = settings(derandomize=True, deadline=None, max_examples=60, database=None)
ROUND_OFF = 1e-10
"""Parameters are of order 1 to 100 and a few sums and one arctangent long: 1e-13 of each, with room."""

NEUTRAL = mean_face_points()[:, :2]
UNIT = float(eye_distance(NEUTRAL))


def row(name):
    return FACE_POINTS.index(name)


def faces(seed, frames=4, strength=4.0):
    """The mean face with every point moved by some millimetres."""
    return NEUTRAL + strength * generator("parameters", seed).standard_normal((frames, *NEUTRAL.shape))


def mirrored(points):
    """The face in a mirror: x turned round and every point given the name of its partner."""
    swap = {"left": "right", "right": "left"}
    order = [row(" ".join(swap.get(word, word) for word in name.split())) for name in FACE_POINTS]
    return points[:, order] * [-1.0, 1.0]


seeds = st.integers(0, 10_000)


def test_there_are_fifteen_six_of_the_mouth_two_of_the_nose_two_of_the_eyes_five_of_the_brows():
    groups = [name.split("_")[0].replace("lip", "mouth") for name in NAMES]
    assert [groups.count(group) for group in ("mouth", "nose", "eye", "brow")] == [6, 2, 2, 5]
    assert len(set(NAMES)) == 15


@quick
@given(seeds)
def test_they_are_those_of_the_oracle(seed):
    points = faces(seed)
    found = control_parameters(points, UNIT)
    for frame, values in zip(points, found, strict=True):
        wanted = frame_parameters(dict(zip(FACE_POINTS, frame, strict=True)), UNIT)
        np.testing.assert_allclose(values, [wanted[name] for name in NAMES], atol=ROUND_OFF)


@quick
@given(seeds, st.floats(-300, 300), st.floats(-300, 300), st.floats(0.05, 50))
def test_place_and_size_of_the_frontal_view_do_not_count(seed, x, y, scale):
    points = faces(seed)
    moved = scale * points + [x, y]
    # The shift is subtracted again: what is lost are the digits that it takes, 1e-13 of it in units of the face.
    loss = 1e-12 * (1 + np.hypot(x, y) / (scale * UNIT)) * 100
    np.testing.assert_allclose(
        control_parameters(moved, scale * UNIT), control_parameters(points, UNIT), atol=ROUND_OFF + loss
    )


@quick
@given(seeds)
def test_a_mirror_swaps_the_sides_and_turns_round_what_has_a_side(seed):
    points = faces(seed)
    seen = dict(zip(NAMES, control_parameters(points, UNIT).T, strict=True))
    mirror = dict(zip(NAMES, control_parameters(mirrored(points), UNIT).T, strict=True))
    for name in NAMES:
        partner = name.replace("left", "#").replace("right", "left").replace("#", "right")
        sign = -1.0 if name in ("mouth_x", "lip_angle", "mouth_angle") else 1.0
        np.testing.assert_allclose(mirror[name], sign * seen[partner], atol=ROUND_OFF)


def blinking(frames=9):
    points = np.repeat(NEUTRAL[None], frames, axis=0)
    for side in ("left", "right"):
        upper, lower = row(f"upper lid {side}"), row(f"lower lid {side}")
        closed = np.linspace(0, 1, frames)
        points[:, upper, 1] += closed * (NEUTRAL[lower, 1] - NEUTRAL[upper, 1])
    return points


def test_a_blink_moves_the_lids_parameters_and_no_other():
    found = control_parameters(blinking(), UNIT)
    moved = {NAMES[k] for k in np.flatnonzero(np.ptp(found, axis=0) > 0)}
    assert moved == {"eye_left", "eye_right"}
    # The two lids' middles are 0.3 mm apart sideways.
    assert found[-1, NAMES.index("eye_left")] < 0.3 / UNIT + 1e-9


def test_a_brow_measured_from_the_lids_would_move_in_a_blink():
    """Control: the height above the middle of the lids, as it is often written."""
    points = blinking() / UNIT
    lids = points[:, [row("upper lid left"), row("lower lid left")], 1].mean(axis=1)
    brow = points[:, [row("brow inner left"), row("brow outer left")], 1].mean(axis=1)
    assert np.ptp(brow - lids) > 0.05


def lips_closing_askew(opening):
    """Lips that meet while the lower one passes to the side: openings in eye distances."""
    points = np.repeat(NEUTRAL[None], len(opening), axis=0)
    turn = np.linspace(0, 3 * np.pi, len(opening))
    points[:, row("lower lip")] = points[:, row("upper lip")] + UNIT * opening[:, None] * np.stack(
        [np.sin(turn), -np.cos(turn)], axis=1
    )
    return points


def test_the_lips_angle_goes_to_zero_with_their_opening_instead_of_jumping():
    opening = np.concatenate([np.linspace(0.2, 0, 400), np.linspace(0, 0.2, 401)[1:]])
    points = lips_closing_askew(opening)
    angle = control_parameters(points, UNIT)[:, NAMES.index("lip_angle")]
    assert angle[399] == 0.0
    # Around the closure the factor is at most opening / 0.1, and no angle is over 180 degrees.
    near = opening < 0.01
    assert np.abs(angle[near]).max() <= 180 * 0.01 / 0.1 + 1e-9
    # Control: without the factor the angle turns by far more than that.
    lips = points[near, row("upper lip")] - points[near, row("lower lip")]
    assert np.ptp(np.degrees(np.arctan2(lips[:, 0], lips[:, 1]))) > 40


@pytest.mark.parametrize("name", FACE_POINTS)
def test_a_missing_point_empties_the_parameters_made_from_it_and_no_others(name):
    points = faces(1)
    whole = control_parameters(points, UNIT)
    points[2, row(name)] = np.nan
    found = control_parameters(points, UNIT)
    needs = np.array([name in parameter.points for parameter in PARAMETERS])
    assert needs.any()
    assert np.isnan(found[2]).tolist() == needs.tolist()
    found[2, needs] = whole[2, needs]
    assert (found == whole).all()


@quick
@given(seeds)
def test_normalising_makes_the_neutral_zero_and_can_be_undone(seed):
    found = control_parameters(faces(seed, strength=2.0), UNIT)
    neutral = control_parameters(NEUTRAL[None], UNIT)[0]
    spread = generator("spread", seed).uniform(0.1, 3.0, 15)
    np.testing.assert_allclose(normalise(neutral[None], neutral, spread), 0.0, atol=ROUND_OFF)
    np.testing.assert_allclose(denormalise(normalise(found, neutral, spread), neutral, spread), found, atol=1e-9)


def test_another_persons_proportions_do_not_count_for_lengths_after_normalising():
    """A mouth twice as wide that gets wider by a tenth says what a small one says that does."""
    found = []
    for width in (1.0, 2.0):
        points = np.repeat(NEUTRAL[None], 2, axis=0)
        for name in ("mouth corner left", "mouth corner right"):
            points[:, row(name), 0] *= width
            points[1, row(name), 0] *= 1.1
        p = control_parameters(points, UNIT)
        found.append(normalise(p, p[0])[1, NAMES.index("lip_width")])
    np.testing.assert_allclose(found, 0.1, atol=1e-12)


def test_the_robust_neutral_is_that_of_rest_and_the_median_is_not():
    """Sixty frames of rest, forty of an open mouth that all differ."""
    stream = generator("neutral")
    p = np.repeat(control_parameters(NEUTRAL[None], UNIT), 100, axis=0) + 0.002 * stream.standard_normal((100, 15))
    rest = p[0].copy()
    p[60:, 0] += np.linspace(0.1, 1.0, 40)
    p[7, 3] = np.nan
    # The mean of about fifty values that scatter by 0.002, off by what half of the values leaves out of the rest.
    np.testing.assert_allclose(neutral_parameters(p), rest, atol=0.006)
    assert abs(p[:, 0].mean() - rest[0]) > 0.15
    assert np.isclose(neutral_parameters(p, frames=[3])[0], p[3, 0])
    p[:, 5] = np.nan
    assert np.isnan(neutral_parameters(p)).tolist() == [k == 5 for k in range(15)]


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: control_parameters(np.zeros((3, 18, 2)), 1.0), "expected (..., 19"),
        (lambda: control_parameters(np.zeros((3, 19, 3)), 1.0), "expected (frames, 19, 2)"),
        (lambda: control_parameters(np.zeros((3, 19, 2)), np.nan), "distance between the eyes"),
        (lambda: normalise(np.ones((2, 15)), np.r_[1e-3, np.ones(14)]), "neutral lip_opening is 0.0010"),
        (lambda: normalise(np.ones((2, 15)), np.ones(15), np.zeros(15)), "spread of lip_opening is 0"),
        (lambda: normalise(np.ones((2, 14)), np.ones(15)), "expected (frames, 15)"),
        (lambda: normalise(np.ones((2, 15)), np.ones(14)), "neutral has shape (14,)"),
        (lambda: neutral_parameters(np.ones((2, 15)), [2]), "frame 2 is not in the take"),
        (lambda: neutral_parameters(np.ones((2, 15)), []), "no frame is named"),
    ],
)
def test_bad_input_gets_one_line(call, told):
    with pytest.raises(EvalkitError) as caught:
        call()
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def expressive_take(rotation=None, labels=FACE_POINTS):
    """A capture of the mean face that opens its mouth, blinks and raises its brows; its frontal truth."""
    space = np.repeat(mean_face_points()[None], 40, axis=0)
    phase = np.linspace(0, 1, 40)
    space[:, row("lower lip"), 1] -= 12 * phase
    for side in ("left", "right"):
        space[:, row(f"upper lid {side}"), 1] -= 8 * phase
        space[:, row(f"brow inner {side}"), 1] += 5 * phase
    frontal = space[:, :, :2].copy()
    if rotation is not None:
        space = space @ rotation.T + [400.0, -20.0, 1000.0]
    keep = [row(name) for name in labels]
    return evalkit.Capture(space[:, keep], labels=list(labels), rate=60), frontal


def test_markers_give_the_parameters_of_the_frontal_view_whatever_axes_the_capture_has():
    turn = evalkit.geometry.rotation_from_vector(np.array([[1.2, -0.7, 2.0]]))[0]
    take, frontal = expressive_take(turn)
    face = frontal_markers(take)
    assert face.text == "all 19 points have a marker"
    # The mean expression pulls the similarity a little off the mean face: under 2 degrees, which shortens a height by
    # 0.06 % and shifts it by the depth between points (25 mm) times its sine, 0.012 eye distances.
    lengths = [k for k, p in enumerate(PARAMETERS) if p.unit == "iod"]
    wanted = control_parameters(frontal, UNIT)
    np.testing.assert_allclose(face.parameters[:, lengths], wanted[:, lengths], atol=0.015)
    # Control: read without being turned to the front they are something else.
    unturned = control_parameters(take.points[:, :, :2], UNIT)
    assert np.abs(unturned[:, lengths] - wanted[:, lengths]).max() > 0.3


def test_what_has_no_marker_is_said_in_one_line_and_empties_its_parameters():
    labels = [n for n in FACE_POINTS if n not in ("nose tip", "eye outer left")]
    face = frontal_markers(expressive_take(labels=labels)[0])
    assert face.text == (
        "no marker on nose tip: nose_tip stay empty; no marker on eye outer left: placed as on the mean face"
    )
    assert np.isnan(face.parameters).all(axis=0).tolist() == [name == "nose_tip" for name in NAMES]
    whole = frontal_markers(expressive_take()[0])
    assert abs(face.unit - whole.unit) < 0.02 * whole.unit


def test_the_users_own_labels_go_before_the_known_ones():
    take, _ = expressive_take()
    renamed = evalkit.Capture(take.points, labels=[f"M{k}" for k in range(19)], rate=60)
    own = {name: f"M{k}" for k, name in enumerate(FACE_POINTS)}
    np.testing.assert_array_equal(frontal_markers(renamed, own).parameters, frontal_markers(take).parameters)
    with pytest.raises(EvalkitError, match="only 0 of the 19 face points"):
        frontal_markers(renamed)
    with pytest.raises(EvalkitError, match="'nosetip' is no point of the face; did you mean nose tip"):
        frontal_markers(renamed, {"nosetip": "M3"})
    with pytest.raises(EvalkitError, match="marker 'Q' is not in the capture"):
        frontal_markers(renamed, own | {"nose tip": "Q"})


def test_markers_in_a_line_have_no_front():
    take = evalkit.Capture(np.outer(np.arange(4.0), [1.0, 2.0, 3.0])[None], labels=list(FACE_POINTS[:4]), rate=60)
    with pytest.raises(EvalkitError, match="lie in one line"):
        frontal_markers(take)


def test_a_real_performers_face_is_seen_whole_and_squarely():
    take = evalkit.read_capture(real_data("captures", "animface_jaw.c3d"))
    face = frontal_markers(evalkit.compensate(take).capture)
    assert face.text == "all 19 points have a marker"
    p = dict(zip(NAMES, face.parameters.T, strict=True))
    assert np.isfinite(face.parameters).all()
    # The eyes of adults are 54 to 74 mm apart (Gordon et al. 2014, ANSUR II: 1st to 99th percentile); markers stand
    # outside of the corners by their own radius and more.
    assert 54 < face.unit < 80
    # A jaw exercise: the mouth opens by more than its rest opening, the brows stay.
    assert np.ptp(p["lip_opening"]) > 0.3
    assert np.ptp(p["brow_height_left"]) < 0.06
