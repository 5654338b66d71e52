"""Every measure scores the truth zero and a known error by its size, whatever the reference pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from evalkit import metrics
from evalkit.synthetic import synthesize

# Angles and lengths of about one, through a handful of products of matrices.
ROUNDING = 1e-9


@pytest.fixture(scope="module")
def truth():
    return synthesize("sway", seed=4, frames=200)[1]


def turned(degrees, axis=(0.2, -0.5, 0.8)):
    return Rotation.from_rotvec(np.radians(degrees) * np.array(axis) / np.linalg.norm(axis)).as_matrix()


def test_truth_scores_zero(truth):
    r = truth.rotations
    assert metrics.rms(metrics.rotation_error_deg(r, r)) < ROUNDING
    assert metrics.rms(metrics.absolute_rotation_error_deg(r, r)) < ROUNDING
    assert metrics.pivot_error_mm(truth.pivot, truth.sway, truth.pivot, truth.sway) < ROUNDING
    assert metrics.rms(metrics.expression_error_mm(truth.clean, truth.clean)) < ROUNDING


def test_another_reference_pose_is_no_error_but_for_the_absolute_measure(truth):
    gauge = turned(17.0)
    assert metrics.rms(metrics.rotation_error_deg(truth.rotations @ gauge, truth.rotations)) < ROUNDING
    absolute = metrics.absolute_rotation_error_deg(truth.rotations @ gauge, truth.rotations)
    np.testing.assert_allclose(absolute, 17.0, atol=ROUNDING)
    assert metrics.rms(metrics.expression_error_mm(truth.clean @ gauge.T + [1.0, 2.0, 3.0], truth.clean)) < ROUNDING
    shift = np.array([5.0, 0.0, 1.0])
    assert metrics.pivot_error_mm(truth.pivot - shift, truth.sway + shift, truth.pivot, truth.sway) < ROUNDING


def test_known_errors_are_measured_by_their_size(truth):
    # Two degrees to either side in turn: no constant rotation takes any of it away.
    sign = np.where(np.arange(200) % 2, 1.0, -1.0)
    wrong = truth.rotations @ Rotation.from_rotvec(np.radians(2.0) * sign[:, None] * [0.0, 1.0, 0.0]).as_matrix()
    np.testing.assert_allclose(metrics.rotation_error_deg(wrong, truth.rotations), 2.0, atol=ROUNDING)
    assert metrics.pivot_error_mm(
        truth.pivot + np.array([0.0, 3.0, 4.0]), truth.sway, truth.pivot, truth.sway
    ) == pytest.approx(5)
    noise = np.random.default_rng(0).normal(scale=0.5, size=truth.clean.shape)
    # Six parameters of the alignment out of 13,800 coordinates; the sample's own spread is 0.6 %.
    error = metrics.rms(metrics.expression_error_mm(truth.clean + noise, truth.clean))
    assert error == pytest.approx(0.5 * 3**0.5, rel=0.02)


def test_missing_frames_and_markers_are_left_out(truth):
    rotations, still = truth.rotations.copy(), truth.clean.copy()
    rotations[3], still[5, 2] = np.nan, np.nan
    found = metrics.rotation_error_deg(rotations, truth.rotations)
    assert np.isnan(found[3]) and np.isfinite(np.delete(found, 3)).all()
    seen = metrics.expression_error_mm(still, truth.clean)
    assert np.isnan(seen[5, 2]) and np.isfinite(seen).sum() == seen.size - 1
    assert np.isnan(metrics.rms([np.nan]))
