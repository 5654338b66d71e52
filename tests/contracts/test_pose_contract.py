"""What every entry of the table of pose estimators promises; new entries are picked up from the table."""

from __future__ import annotations

import numpy as np
import pytest
from heads import SHAPE, lose, seen, turning
from scipy.spatial.transform import Rotation

from evalkit.errors import EvalkitError, FrameStatus
from evalkit.pose import PoseEstimator, pose_estimators

# Rounding: coordinates of 1e3 mm, a shape of 50 mm, some operations: 1e3 * 2e-16 * 10 / 50 is 4e-14 rad.
EXACT = 1e-9

JUDGES_BY_THE_TAKE = {"robust"}
"""Estimators whose cutoff is the noise of the whole take: frames alone or in other company differ under noise."""

PROMISED = {name: estimator for name, estimator in pose_estimators.items() if not estimator.peer}
"""Peers answer as their packages do: tests/test_peers.py asks of them what these promise."""

everyone = pytest.mark.parametrize("estimator", PROMISED.values(), ids=PROMISED.keys())


def shape_for(estimator):
    return SHAPE if estimator.markers is None else SHAPE[: estimator.markers]


def take_for(estimator, noise=0.4, frames=60):
    return seen(turning(frames), shape_for(estimator), noise=noise)


def same(a, b, tolerance=1e-12):
    np.testing.assert_array_equal(a.status, b.status)
    np.testing.assert_allclose(a.rotations, b.rotations, atol=tolerance)
    # A translation is an arm of about 150 mm times the rotation's error, and rounding of metres.
    np.testing.assert_allclose(a.translations, b.translations, atol=1e3 * tolerance)


# Each check is a function of its own, so that broken estimators can be run through it below.


def recovers_exactly(estimator):
    shape, truth = shape_for(estimator), turning()
    pose = estimator(shape, seen(truth, shape))
    assert pose.ok.all()
    np.testing.assert_allclose(pose.rotations, truth, atol=EXACT)
    fitted = np.einsum("fij,mj->fmi", pose.rotations, shape) + pose.translations[:, None]
    np.testing.assert_allclose(fitted, seen(truth, shape), atol=1e3 * EXACT)


def follows_the_world(estimator):
    """Turning and shifting the world by metres turns and shifts the pose, noise and all."""
    shape, points = shape_for(estimator), take_for(estimator)
    turn, shift = Rotation.from_rotvec([0.4, -0.9, 1.3]).as_matrix(), np.array([2e3, -1.5e3, 3e3])
    a, b = estimator(shape, points), estimator(shape, points @ turn.T + shift)
    np.testing.assert_allclose(b.rotations, turn @ a.rotations, atol=EXACT)
    np.testing.assert_allclose(b.translations, a.translations @ turn.T + shift, atol=1e3 * EXACT)


def follows_the_template(estimator):
    """The template's own axes and origin are free, too."""
    shape, points = shape_for(estimator), take_for(estimator)
    turn, shift = Rotation.from_rotvec([-1.1, 0.3, 0.8]).as_matrix(), np.array([-900.0, 400.0, 1300.0])
    a, b = estimator(shape, points), estimator(shape @ turn.T + shift, points)
    np.testing.assert_allclose(b.rotations @ turn, a.rotations, atol=EXACT)


def follows_the_unit(estimator):
    shape, points = shape_for(estimator), take_for(estimator)
    a, b = estimator(shape, points), estimator(10 * shape, 10 * points)
    np.testing.assert_allclose(b.rotations, a.rotations, atol=EXACT)
    np.testing.assert_allclose(b.translations, 10 * a.translations, atol=1e4 * EXACT)


def bears_missing_markers(estimator):
    shape, truth = shape_for(estimator), turning()
    points = lose(seen(truth, shape), 0.05)
    pose = estimator(shape, points)
    enough = np.isfinite(points[:, :, 0]).sum(axis=1) >= 3
    assert 0 < enough.sum() < len(points) if len(shape) == 3 else enough.any()
    np.testing.assert_array_equal(pose.ok, enough)
    np.testing.assert_allclose(pose.rotations[enough], truth[enough], atol=EXACT)
    assert (pose.status[~enough] == FrameStatus.TOO_FEW_MARKERS).all()
    assert np.isnan(pose.rotations[~enough]).all() and np.isnan(pose.translations[~enough]).all()


def frames_stand_alone(estimator):
    """One batch equals frames one by one, and the order of the frames does not matter."""
    shape = shape_for(estimator)
    noise = 0.0 if any(estimator is pose_estimators[name] for name in JUDGES_BY_THE_TAKE) else 0.4
    points = lose(take_for(estimator, noise), 0.1)
    batch = estimator(shape, points)
    for i in range(len(points)):
        one = estimator(shape, points[i : i + 1])
        assert one.status[0] == batch.status[i]
        # Matrix products over one frame and over many are summed in another order.
        np.testing.assert_allclose(one.rotations[0], batch.rotations[i], atol=1e-12)
        np.testing.assert_allclose(one.translations[0], batch.translations[i], atol=EXACT)
    order = np.random.default_rng(3).permutation(len(points))
    shuffled = estimator(shape, points[order])
    np.testing.assert_allclose(shuffled.rotations, batch.rotations[order], atol=1e-12)
    np.testing.assert_array_equal(shuffled.status, batch.status[order])


CHECKS = [
    recovers_exactly,
    follows_the_world,
    follows_the_template,
    follows_the_unit,
    bears_missing_markers,
    frames_stand_alone,
]


@everyone
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_contract(estimator, check):
    check(estimator)


@everyone
def test_order_of_frames_does_not_matter_under_noise(estimator):
    shape, points = shape_for(estimator), take_for(estimator)
    order = np.random.default_rng(3).permutation(len(points))
    a, b = estimator(shape, points), estimator(shape, points[order])
    np.testing.assert_allclose(b.rotations, a.rotations[order], atol=1e-12)


@everyone
def test_twice_gives_the_same_bits_and_leaves_the_input_alone(estimator):
    shape, points = shape_for(estimator).copy(), lose(take_for(estimator))
    weights = np.linspace(0.5, 2.0, len(shape))
    kept = shape.copy(), points.copy(), weights.copy()
    for array in (shape, points, weights):
        array.setflags(write=False)
    first, second = estimator(shape, points, weights), estimator(shape, points, weights)
    np.testing.assert_array_equal(first.rotations, second.rotations)
    np.testing.assert_array_equal(first.translations, second.translations)
    np.testing.assert_array_equal(first.status, second.status)
    for array, before in zip((shape, points, weights), kept, strict=True):
        np.testing.assert_array_equal(array, before)


@everyone
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_other_memory_layouts_and_types(estimator, order, kind):
    shape, points = shape_for(estimator), take_for(estimator)
    given = np.asarray(points, dtype=kind, order=order)
    # Single precision in: 165 mm to 1e-5 mm.
    same(estimator(shape, given), estimator(shape, points), 1e-12 if kind is np.float64 else 1e-5)


@everyone
def test_frames_without_an_answer_get_the_right_status(estimator):
    shape = shape_for(estimator)
    points = np.repeat(take_for(estimator, noise=0.0)[:1], 6, axis=0)
    points[1] = np.nan
    points[2, 1:] = np.nan
    points[3, 2:] = np.nan
    points[4, 0] = np.inf
    points[4, 3:] = np.nan
    pose = estimator(shape, points)
    expected = [FrameStatus.OK, *[FrameStatus.TOO_FEW_MARKERS] * 4, FrameStatus.OK]
    assert pose.status.tolist() == expected
    assert (np.isnan(pose.rotations).all(axis=(1, 2)) == ~pose.ok).all()


@everyone
def test_markers_in_one_line_have_no_rotation(estimator):
    along = np.linspace(0.0, 60.0, len(shape_for(estimator)))
    line = np.outer(along, [0.6, 0.8, 0.0]) + np.array([0.0, 100.0, 90.0])
    pose = estimator(line, seen(turning(10), line, noise=0.3))
    assert (pose.status == FrameStatus.COLLINEAR).all()
    assert np.isnan(pose.rotations).all()
    # Control: the same markers with one of them beside the line.
    line[0] += [0.0, 0.0, 20.0]
    assert estimator(line, seen(turning(10), line, noise=0.3)).ok.all()


@everyone
def test_markers_that_remain_in_one_line(estimator):
    """A triangle and two more markers on one of its sides: without the corner only a line is left."""
    if estimator.markers is not None:
        pytest.skip("takes exactly three markers: none may be lost")
    side = np.outer([0.0, 1.0, 2.0, 3.0], [15.0, 5.0, 0.0]) + np.array([0.0, 90.0, 95.0])
    shape = np.vstack([[0.0, 140.0, 90.0], side])
    points = seen(turning(4), shape)
    points[2, 0] = np.nan
    pose = estimator(shape, points)
    assert pose.status.tolist() == [0, 0, FrameStatus.COLLINEAR, 0]


@everyone
@pytest.mark.parametrize("frames", [0, 1, 2])
def test_short_takes(estimator, frames):
    shape, truth = shape_for(estimator), turning(5)[:frames]
    pose = estimator(shape, seen(truth, shape))
    assert pose.rotations.shape == (frames, 3, 3) and pose.status.shape == (frames,)
    np.testing.assert_allclose(pose.rotations, truth, atol=EXACT)


@everyone
@pytest.mark.parametrize("per_frame", [False, True])
def test_weights(estimator, per_frame):
    shape, points = shape_for(estimator), take_for(estimator)
    weights = np.random.default_rng(4).uniform(0.2, 3.0, points.shape[:2] if per_frame else len(shape))
    pose = estimator(shape, points, weights)
    # Only their ratios count.
    same(estimator(shape, points, 1e3 * weights), pose, 1e-10)
    same(estimator(shape, points, np.ones_like(weights)), estimator(shape, points), 1e-12)
    # A marker without weight is an absent one.
    weights[..., -1] = 0.0
    without = points.copy()
    without[:, -1] = np.nan
    same(estimator(shape, points, weights), estimator(shape, without, weights), 1e-10)


@everyone
def test_a_still_head(estimator):
    shape = shape_for(estimator)
    pose = estimator(shape, np.repeat(shape[None], 5, axis=0))
    np.testing.assert_allclose(pose.rotations, np.broadcast_to(np.eye(3), (5, 3, 3)), atol=EXACT)
    np.testing.assert_allclose(pose.translations, 0.0, atol=1e3 * EXACT)


@everyone
def test_result_is_a_rotation_where_the_table_says_so(estimator):
    pose = estimator(shape_for(estimator), take_for(estimator, noise=2.0))
    off = np.abs(pose.rotations @ pose.rotations.transpose(0, 2, 1) - np.eye(3)).max()
    assert off < EXACT if estimator.orthogonal else off > 1e-3
    if estimator.orthogonal:
        np.testing.assert_allclose(np.linalg.det(pose.rotations), 1.0, atol=EXACT)


# --- the checks themselves must be able to fail ------------------------------------------------------------


def broken(change):
    """The svd estimator with a fault."""
    whole = pose_estimators["svd"]

    def function(template, points, weights=None):
        return change(whole, np.asarray(template), np.asarray(points))

    return PoseEstimator(function, "broken", "nowhere")


def rotated(pose, rotations):
    return type(pose)(rotations, pose.translations, pose.status, pose.template, pose.weights)


def slightly_transposed(whole, template, points):
    pose = whole(template, points)
    return rotated(pose, pose.rotations.transpose(0, 2, 1))


def smoothed(whole, template, points):
    """A running mean over the frames: exact for a still head, and no longer frame by frame."""
    pose = whole(template, points)
    return rotated(pose, (pose.rotations + np.roll(pose.rotations, 1, axis=0)) / 2)


def with_a_floor_in_mm(whole, template, points):
    """A regularisation in absolute units, towards the world's axes."""
    pose = whole(template, points)
    mixed = pose.rotations * np.ptp(template) ** 2 + 0.01 * np.eye(3)
    left, _, right = np.linalg.svd(np.where(pose.ok[:, None, None], mixed, np.eye(3)))
    return rotated(pose, np.where(pose.ok[:, None, None], left @ right, np.nan))


def with_holes_at_zero(whole, template, points):
    return whole(template, np.nan_to_num(points))


@pytest.mark.parametrize(
    ("change", "noticed_by"),
    [
        (slightly_transposed, recovers_exactly),
        (slightly_transposed, follows_the_world),
        (slightly_transposed, follows_the_template),
        (smoothed, recovers_exactly),
        (smoothed, frames_stand_alone),
        (with_a_floor_in_mm, follows_the_unit),
        (with_a_floor_in_mm, follows_the_world),
        (with_holes_at_zero, bears_missing_markers),
    ],
    ids=lambda function: function.__name__,
)
def test_control_a_broken_estimator_is_noticed(change, noticed_by):
    with pytest.raises((AssertionError, EvalkitError, ValueError)):
        noticed_by(broken(change))
