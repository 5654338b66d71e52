"""Every measure scores the truth zero and a known error by its size, whatever the reference pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from evalkit import metrics
from evalkit.synthetic import synthesize
from evalkit.synthetic.layouts import LAYOUTS

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


def test_truth_has_no_translation_error_whatever_the_reference_pose(truth):
    r, t, point = truth.rotations, truth.translations, truth.neutral[:3].mean(axis=0)
    assert metrics.rms(metrics.translation_error_mm(r, t, r, t, point)) < 1e-9 * np.abs(t).max()  # digits of metres
    gauge, shift = turned(17.0), np.array([30.0, -20.0, 10.0])
    other = metrics.translation_error_mm(r @ gauge, r @ shift + t, r, t, point)
    assert metrics.rms(other) < 1e-9 * np.abs(t).max()


def test_a_head_put_beside_its_place_is_as_far_off_as_it_was_put(truth):
    r, t, point = truth.rotations, truth.translations.copy(), truth.neutral[:3].mean(axis=0)
    sign = np.where(np.arange(200) % 2, 1.0, -1.0)[:, None]
    # In head axes and to either side in turn: no other point of the head explains any of it.
    off = np.einsum("fij,fj->fi", r, sign * [0.0, 3.0, 4.0])
    np.testing.assert_allclose(metrics.translation_error_mm(r, t + off, r, t, point), 5.0, atol=1e-6)
    t[7] = np.nan
    found = metrics.translation_error_mm(r, t, r, truth.translations, point)
    assert np.isnan(found[7]) and np.isfinite(np.delete(found, 7)).all()


def test_errors_are_told_apart_by_region(truth):
    exact = metrics.expression_error_mm(truth.clean, truth.clean)
    assert max(metrics.error_by_region_mm(exact, truth.labels).values()) < ROUNDING
    errors = np.zeros((10, len(truth.labels)))
    errors[:, [label.startswith(("BrowIn", "BrowOut")) for label in truth.labels]] = 2.0
    errors[:, truth.labels.index("Chin")] = [3.0, np.nan] * 5
    found = metrics.error_by_region_mm(errors, truth.labels)
    assert found.pop("brows") == 2.0 and found.pop("chin") == 3.0
    assert set(found.values()) == {0.0}
    assert np.isnan(metrics.error_by_region_mm(errors[:, :3], truth.labels[:3])["mouth"])


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_marker_of_the_layouts_has_one_region(layout):
    for label in LAYOUTS[layout].sites:
        assert sum(label.startswith(beginnings) for beginnings in metrics.REGIONS.values()) == 1, label


def test_evaluations_to_counts_to_the_last_entry_into_the_tolerance():
    away = np.array([9.0, 0.5, 3.0, 0.4, -0.2, 0.0])
    positions = np.array([1.0, 2.0, 3.0]) + away[:, None] * [0.0, 0.6, 0.8]
    calls = [1, 7, 13, 19, 25, 31]
    # By hand: inside at 7, out again at 13, inside from 19 on.
    assert metrics.evaluations_to(positions, calls, [1.0, 2.0, 3.0], 0.5 + ROUNDING) == 19
    assert metrics.evaluations_to(positions, calls, [1.0, 2.0, 3.0], 10.0) == 1
    assert np.isnan(metrics.evaluations_to(positions, calls, [1.0, 2.0, 4.0], 0.5))
    assert np.isnan(metrics.evaluations_to(np.empty((0, 3)), [], [0.0, 0.0, 0.0], 1.0))


def fan(frames=3):
    """A flat square of four triangles around a vertex, moving forward, and the triangles."""
    square = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    motion = np.arange(frames)[:, None, None] * np.array([0.0, 0.0, 2.0])
    return square + motion, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]])


def test_true_vertices_score_zero_and_displaced_ones_their_distance():
    vertices, _ = fan()
    assert metrics.vertex_error_mm(vertices, vertices).max() == 0.0
    wrong = vertices.copy()
    wrong[1, 2] += [3.0, 0.0, 4.0]
    errors = metrics.vertex_error_mm(wrong, vertices)
    assert errors[1, 2] == pytest.approx(5.0) and np.count_nonzero(errors) == 1


def test_turned_over_triangles_are_counted():
    vertices, triangles = fan()
    assert metrics.inverted_triangles(vertices, vertices, triangles).tolist() == [0, 0, 0]
    assert metrics.inverted_triangles(vertices, vertices[0], triangles).tolist() == [0, 0, 0]
    wrong = vertices.copy()
    # The middle dragged across the edge between 1 and 2 turns that triangle over, and no other.
    wrong[1, 0, :2] = [0.8, 0.8]
    assert metrics.inverted_triangles(wrong, vertices, triangles).tolist() == [0, 1, 0]


def test_lips_in_each_other_are_measured_by_their_depth():
    rest = np.array([[-1.0, 0.1, 0], [1.0, 0.3, 0], [0.5, 0.0, 0]])
    lips = {"lower": [2], "upper": [[0, 1]], "share": [0.75]}
    moved = np.stack([rest] * 4)
    moved[1, 2, 1] += 0.25  # touching
    moved[2, 2, 1] += 1.0
    moved[3, :2, 1] += 1.0  # apart
    assert metrics.lip_penetration_mm(moved, moved, **lips).max() == 0.0
    np.testing.assert_allclose(metrics.lip_penetration_mm(moved, rest, **lips)[:, 0], [0, 0, 0.75, 0], atol=ROUNDING)
    # What overlaps in the reference does not count: from 0.25 deep to 0.75 deep is 0.5.
    overlapping = rest.copy()
    overlapping[2, 1] += 0.5
    depth = metrics.lip_penetration_mm(moved, overlapping, **lips)[:, 0]
    np.testing.assert_allclose(depth, [0, 0, 0.5, 0], atol=ROUNDING)


def test_honest_errors_are_one_on_average_and_follow_chi_square():
    """4,000 draws: the mean of chi-square with 3 degrees, over 3, scatters by 0.013; three times that is allowed."""
    random = np.random.default_rng(5)
    mix = random.standard_normal((3, 3))
    covariance = mix @ mix.T
    errors = random.standard_normal((4000, 3)) @ mix.T
    found = np.array([metrics.normalised_square(error, covariance) for error in errors])
    assert abs(found.mean() - 1.0) < 0.04
    # 95 % of chi-square with three degrees lie below 7.815; 4,000 draws scatter by 0.0034.
    assert abs((3.0 * found < 7.815).mean() - 0.95) < 0.011
    # Control: a covariance that is half of what it should be is found out.
    assert np.mean([metrics.normalised_square(error, 0.5 * covariance) for error in errors]) > 1.8
    assert metrics.normalised_square(np.zeros(3), covariance) == 0.0


def test_coordinates_of_which_nothing_is_stated_do_not_count():
    half_known = np.diag([4.0, np.inf, 1.0])
    assert metrics.normalised_square([2.0, 900.0, 1.0], half_known) == 1.0
    assert np.isnan(metrics.normalised_square([1.0, 2.0, 3.0], np.diag([np.inf] * 3)))
