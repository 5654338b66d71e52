"""Skin-aware weighting against synthetic takes whose head rotation and skin motion are known."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from evalkit.capture import Capture
from evalkit.errors import EvalkitError, FrameStatus
from evalkit.metrics import rms, rotation_error_deg
from evalkit.pose import pose_estimators, reference_pose
from evalkit.pose.skin import FLOOR, SkinModel, automatic_rigid, rotation_share, skin_estimator, skin_model
from evalkit.synthetic import synthesize

SUBSETS = (
    ("ForeheadC", "ForeheadL", "ForeheadR"),
    ("ForeheadC", "ForeheadL", "ForeheadR", "NoseBridge"),
    ("ForeheadC", "ForeheadL", "ForeheadR", "NoseBridge", "NoseL", "NoseR"),
)


def posed(take, chosen):
    return reference_pose(skin_estimator(chosen.model), take.points[:, chosen.columns], "mean", labels=chosen.labels)


def error(take, truth, chosen=None):
    """Root-mean-square rotation error with automatic weights, deg."""
    pose = posed(take, chosen or automatic_rigid(take))
    return rms(rotation_error_deg(pose.rotations, truth.rotations, pose.ok))


def error_of(take, truth, labels):
    pose = reference_pose(pose_estimators["svd"], take.points[:, take.indices(labels)], "mean")
    return rms(rotation_error_deg(pose.rotations, truth.rotations, pose.ok))


@pytest.mark.parametrize("preset", [pytest.param("talking", marks=pytest.mark.slow), "skin", "worst-day", "gaps"])
def test_better_than_every_subset_a_user_would_name(preset):
    ours, theirs = [], []
    for seed in range(3):
        take, truth = synthesize(preset, seed=seed, performer=seed)
        ours.append(error(take, truth))
        theirs.append([error_of(take, truth, labels) for labels in (*SUBSETS, take.labels)])
        assert ours[-1] < theirs[-1][0], "worse than the forehead triangle"
    assert rms(ours) < 0.85 * np.sqrt(np.mean(np.square(theirs), axis=0)).min()


def test_variances_are_those_of_the_truth():
    """Markers that only have noise are recognised, and those that move get about the variance of their motion."""
    take, truth = synthesize("talking", seed=3, frames=1500)
    model = skin_model(take.points, take.labels)
    true = truth.expression.var(axis=0).mean(axis=1) + truth.noise_mm**2
    ratio = model.variance / true
    still = np.isin(take.labels, truth.rigid)
    np.testing.assert_allclose(ratio[still], 1.0, atol=0.35)
    np.testing.assert_allclose(np.log2(ratio), 0.0, atol=1.0)


def test_directions_in_which_skin_does_not_move_are_found():
    """A marker that slides up and down only: its scatter is large along that line and small across."""
    take, truth = synthesize("talking", seed=0, expression=0.0, range_deg=10.0)
    rng, points = np.random.default_rng(5), take.points.copy()
    slide = np.convolve(rng.normal(size=take.frames + 30), np.ones(31) / np.sqrt(31), "valid")[: take.frames]
    moving = take.labels.index("ForeheadC")
    points[:, moving] += 4.0 * slide[:, None] * truth.rotations[:, :, 1]
    model = skin_model(points)
    values, vectors = np.linalg.eigh(model.scatter[moving])
    assert values[2] > 20 * values[1]
    # The template stands in the pose of one frame, whose up is a few degrees off the world's.
    assert abs(vectors[1, 2]) > 0.97


@pytest.mark.parametrize("gaps", [0.05, 0.2])
def test_missing_markers(gaps):
    take, truth = synthesize("skin", seed=1, gaps=gaps)
    assert not take.visible.all()
    assert error(take, truth) < 0.6 * error_of(take, truth, truth.rigid)


def test_same_bits_every_time():
    take, _ = synthesize("worst-day", seed=2, frames=200)
    first, second = automatic_rigid(take), automatic_rigid(take)
    assert first.labels == second.labels and first.reason == second.reason
    np.testing.assert_array_equal(first.weights, second.weights)
    np.testing.assert_array_equal(posed(take, first).rotations, posed(take, second).rotations)


def test_axes_and_units_do_not_matter():
    take, _ = synthesize("skin", seed=4, frames=300, gaps=0.05)
    turn, shift = Rotation.from_rotvec([0.4, -0.9, 1.3]).as_matrix(), np.array([2e3, -1.5e3, 3e3])
    first = automatic_rigid(take)
    # Not ten times: a face of more than half a metre would be taken for a body.
    for scale in (0.1, 1.0, 2.0):
        other = take.with_points(scale * take.points @ turn.T + shift)
        second = automatic_rigid(other)
        assert second.labels == first.labels
        np.testing.assert_allclose(second.weights, first.weights, rtol=1e-5)
        np.testing.assert_allclose(second.skin_std, scale * first.skin_std, rtol=1e-5)
        turned = turn.T @ posed(other, second).rotations
        np.testing.assert_allclose(rotation_error_deg(turned, posed(take, first).rotations), 0.0, atol=1e-4)


def test_order_of_the_markers_does_not_matter():
    take, _ = synthesize("skin", seed=4, frames=300)
    order = np.random.default_rng(0).permutation(len(take.labels))
    other = Capture(take.points[:, order], [take.labels[k] for k in order], take.rate)
    first, second = automatic_rigid(take), automatic_rigid(other)
    assert set(first.labels) == set(second.labels)
    weights = dict(zip(second.labels, second.weights, strict=True))
    np.testing.assert_allclose([weights[label] for label in first.labels], first.weights, rtol=1e-6)


# --- the estimator of a given model ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fitted():
    take, truth = synthesize("skin", seed=0, frames=200)
    return take, truth, skin_model(take.points)


def test_each_frame_stands_alone(fitted):
    take, _, model = fitted
    points = take.points[:40].copy()
    points[np.random.default_rng(1).random(points.shape[:2]) < 0.2] = np.nan
    estimator = skin_estimator(model)
    batch = estimator(model.template, points)
    for i in (0, 7, 39):
        one = estimator(model.template, points[i : i + 1])
        np.testing.assert_allclose(one.rotations[0], batch.rotations[i], atol=1e-9)
    back = estimator(model.template, points[::-1])
    np.testing.assert_allclose(back.rotations[::-1], batch.rotations, atol=1e-9)


def test_exact_motion_of_the_template_is_recovered(fitted):
    _, truth, model = fitted
    points = model.template @ truth.rotations.transpose(0, 2, 1) + truth.translations[:, None]
    points[np.random.default_rng(1).random(points.shape[:2]) < 0.3] = np.nan
    pose = skin_estimator(model)(model.template, points)
    assert pose.ok.all()
    np.testing.assert_allclose(pose.rotations, truth.rotations, atol=1e-9)
    np.testing.assert_allclose(pose.translations, truth.translations, atol=1e-5)


def test_the_template_may_have_axes_of_its_own(fitted):
    take, _, model = fitted
    turn, shift = Rotation.from_rotvec([-1.1, 0.3, 0.8]).as_matrix(), np.array([-900.0, 400.0, 1300.0])
    first = skin_estimator(model)(model.template, take.points)
    second = skin_estimator(model)(model.template @ turn.T + shift, take.points)
    np.testing.assert_allclose(second.rotations @ turn, first.rotations, atol=1e-8)


def test_weights_multiply(fitted):
    take, _, model = fitted
    estimator, weights = skin_estimator(model), np.linspace(0.5, 2.0, len(model.template))
    first = estimator(model.template, take.points, weights)
    np.testing.assert_allclose(
        estimator(model.template, take.points, 7 * weights).rotations, first.rotations, atol=1e-9
    )
    weights[3] = 0.0
    hidden = take.points.copy()
    hidden[:, 3] = np.nan
    np.testing.assert_allclose(
        estimator(model.template, take.points, weights).rotations,
        estimator(model.template, hidden, weights).rotations,
        atol=1e-9,
    )


def test_frames_without_an_answer_get_a_status(fitted):
    take, _, model = fitted
    points = take.points[:3].copy()
    points[1, 2:] = np.nan
    pose = skin_estimator(model)(model.template, points)
    assert pose.status.tolist() == [FrameStatus.OK, FrameStatus.TOO_FEW_MARKERS, FrameStatus.OK]
    assert np.isnan(pose.rotations[1]).all() and (pose.weights[1] == 0).all()
    with pytest.raises(EvalkitError, match="markers"):
        skin_estimator(model)(model.template[:4], take.points[:, :4])


def test_swapped_markers_are_outvoted(fitted):
    take, truth, model = fitted
    points = take.points.copy()
    points[50:90, [1, 12]] = points[50:90, [12, 1]]
    pose = skin_estimator(model)(model.template, points)
    plain = pose_estimators["svd"](model.template, points, model.weights)
    ours, theirs = (rms(rotation_error_deg(p.rotations, truth.rotations)[50:90]) for p in (pose, plain))
    assert ours < 0.5 * theirs


def test_share_of_information_is_that_of_the_inverse_covariance():
    """By its meaning: without a marker the information about rotation, translation unknown, falls by its share."""
    rng = np.random.default_rng(0)
    jacobian = rng.normal(size=(400, 3, 6))
    information = jacobian.transpose(0, 2, 1) @ jacobian
    share = rotation_share(information)
    assert share.sum() == pytest.approx(1.0) and (share > 0).all()
    whole = np.linalg.inv(np.linalg.inv(information.sum(axis=0))[:3, :3])
    rest = np.linalg.inv(np.linalg.inv(information[1:].sum(axis=0))[:3, :3])
    fall = np.trace(np.linalg.solve(whole, whole - rest)) / 3
    assert share[0] == pytest.approx(fall, rel=0.05)


# --- takes that cannot answer, or only partly ---------------------------------------------------------------


def test_a_perfect_take_is_exact_but_for_the_floor():
    take, truth = synthesize("clean", seed=0)
    chosen = automatic_rigid(take)
    assert set(truth.rigid) <= set(chosen.labels)
    assert error(take, truth, chosen) < np.degrees(FLOOR)


@pytest.mark.parametrize("count", [3, 4])
def test_three_or_four_markers_count_the_same(count):
    take, truth = synthesize("talking", seed=0, expression=0.0)
    few = Capture(take.points[:, :count], take.labels[:count], take.rate)
    chosen = automatic_rigid(few)
    assert chosen.model is None and (chosen.weights == 1.0).all() and chosen.automatic
    assert "not modelled" in chosen.warnings[0]
    assert error_of(few, truth, chosen.labels) < 1.5


def test_copies_of_a_marker_prove_nothing():
    take, _ = synthesize("skin", seed=1, frames=300)
    chin = take.labels.index("Chin")
    points = np.concatenate([take.points, take.points[:, [chin, chin, 0]]], axis=1)
    chosen = automatic_rigid(Capture(points, [*take.labels, "copy1", "copy2", "copy3"], take.rate))
    assert "copy1, copy2, copy3" in chosen.warnings[0]
    np.testing.assert_array_equal(chosen.weights, automatic_rigid(take).weights)


def test_virtual_markers_at_constant_distances_on_the_lip():
    """Computed from three lip markers, they keep their distances exactly and still must not carry the head away."""
    take, truth = synthesize("skin", seed=1)
    left, right, chin = (take.points[:, take.labels.index(name)] for name in ("LowerLipL", "LowerLipR", "Chin"))
    middle = (left + right + chin) / 3
    x = (left - right) / np.linalg.norm(left - right, axis=1, keepdims=True)
    y = np.cross(chin - middle, x)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    virtual = np.stack([middle, middle + 30 * x, middle + 30 * y, middle + 30 * np.cross(x, y)], axis=1)
    more = Capture(np.concatenate([take.points, virtual], axis=1), [*take.labels, *"abcd"], take.rate)
    # The choice by constant distances falls for them.
    assert error(more, truth) < error_of(take, truth, truth.rigid)


def test_nothing_rigid_is_said():
    rng = np.random.default_rng(0)
    cloud = Capture(40.0 * rng.normal(size=(300, 12, 3)), [f"m{k}" for k in range(12)], 60.0)
    assert any("no marker stays with the others" in text for text in automatic_rigid(cloud).warnings)


def test_a_still_head_with_noise_has_no_rotation_to_speak_of():
    take, truth = synthesize("talking", seed=0)
    noise = np.random.default_rng(0).normal(scale=0.3, size=take.points.shape)
    still = take.with_points(truth.neutral + noise)
    assert any("cannot be told from skin motion" in text for text in automatic_rigid(still).warnings)
    quiet = automatic_rigid(take.with_points(np.broadcast_to(truth.neutral, take.points.shape)))
    assert not quiet.warnings


@pytest.mark.parametrize("points", [0, 1, 5])
def test_short_takes(points):
    take, _ = synthesize("talking", seed=0)
    short = Capture(take.points[:points], take.labels, take.rate)
    if points < 2:
        with pytest.raises(EvalkitError, match="name"):
            automatic_rigid(short)
    else:
        assert "frames" in automatic_rigid(short).warnings[0]


def test_a_model_needs_five_markers_and_ten_frames():
    take, _ = synthesize("talking", seed=0)
    with pytest.raises(EvalkitError, match="at least 5"):
        skin_model(take.points[:, :4])
    with pytest.raises(EvalkitError, match="at least 10"):
        skin_model(take.points[:9])


def test_control_shuffled_scatters_are_worse():
    take, truth = synthesize("skin", seed=0)
    model = skin_model(take.points)
    order = np.random.default_rng(0).permutation(len(model.scatter))
    wrong = SkinModel(**{**vars(model), "scatter": model.scatter[order]})
    right, shuffled = (
        rms(rotation_error_deg(skin_estimator(m)(m.template, take.points).rotations, truth.rotations))
        for m in (model, wrong)
    )
    assert shuffled > 2 * right


@pytest.mark.timing
def test_cost_is_that_of_a_fixed_number_of_frames_and_one_pass():
    take, _ = synthesize("talking", seed=0, frames=20_000)
    start = time.perf_counter()
    chosen = automatic_rigid(take)
    posed(take, chosen)
    assert time.perf_counter() - start < 20.0
