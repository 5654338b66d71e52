"""The Cramér-Rao bounds against a dense Fisher matrix and against what estimators reach; the splines beneath."""

from __future__ import annotations

import time

import numpy as np
import pytest
from contracts.heads import PIVOT, SHAPE, about_one_axis, seen, turning
from oracles import bound_oracles as slow
from scipy.spatial.transform import Rotation

from evalkit.errors import EvalkitError
from evalkit.pivot import pivot_estimators
from evalkit.pivot.bound import full_pivot_bound, inertia, pivot_bound, rotation_bound, target_bound
from evalkit.pivot.spline import Basis, constant, cubic, roughness, smoothed
from evalkit.pose import pose_estimators, reference_pose

ARM = SHAPE - PIVOT
SIGMA = 0.3


def relative(found, expected):
    """Largest difference in units of the expected covariance's largest entry."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def dense(basis):
    """The functions of a basis as a matrix (F, K)."""
    out = np.zeros((len(basis.first), basis.size))
    for i, (first, values) in enumerate(zip(basis.first, basis.values, strict=True)):
        out[i, first : first + len(values)] = values
    return out


# --- the bound of the pivot --------------------------------------------------------------------------------


@pytest.mark.parametrize("markers", [3, 5])
@pytest.mark.parametrize("degrees", [20.0, 2.0])
def test_closed_form_full_information_and_dense_fisher_agree(markers, degrees):
    arm, r = ARM[:markers], turning(frames=24, degrees=degrees)
    expected = slow.dense_bound(arm, r, SIGMA)
    # The dense matrix has a condition of some 1e6 at two degrees: 1e6 * 1e-16, and a hundred for its sums.
    assert relative(pivot_bound(arm, r, SIGMA), expected) < 1e-9
    assert relative(full_pivot_bound(arm, r, SIGMA), expected) < 1e-9


@pytest.mark.parametrize("gauge", ["frame 7", "markers"])
def test_the_bound_does_not_depend_on_the_gauge(gauge):
    r = turning(frames=24)
    assert relative(slow.dense_bound(ARM, r, SIGMA, gauge=gauge), slow.dense_bound(ARM, r, SIGMA)) < 1e-9
    functions = dense(cubic(24, 60.0, 0.1))
    paths = [slow.dense_path_bound(ARM, r, SIGMA, functions, gauge=name) for name in (gauge, "frame 0")]
    assert relative(*paths) < 1e-7  # a spline in a short take: the condition is a hundred times higher


def test_control_a_wrong_number_of_markers_or_noise_is_noticed():
    r = turning(frames=24)
    expected = slow.dense_bound(ARM, r, SIGMA)
    assert relative(pivot_bound(ARM[:4], r, SIGMA), expected) > 0.01
    assert relative(pivot_bound(ARM, r, 1.1 * SIGMA), expected) == pytest.approx(0.21, rel=1e-6)
    # M counted once too often in K, the slip that the closed form invites.
    mean = ARM.mean(axis=0)
    lever = slow.crossing(mean)
    k = np.linalg.inv(np.eye(3) / (len(ARM) + 1) - lever @ np.linalg.inv(inertia(ARM - mean)) @ lever)
    about = r - r.mean(axis=0)
    slip = SIGMA**2 * np.linalg.inv((about @ k @ about.transpose(0, 2, 1)).sum(axis=0))
    assert relative(slip, expected) > 1e-3


def test_both_forms_of_k_are_the_same():
    """``(I/M - [x]J_c^-1[x])^-1 = M I + M² [x] J_p^-1 [x]``, and ``J_p = J_c + M (|x|² I - x x')``."""
    m, mean = len(ARM), ARM.mean(axis=0)
    lever, about_mean = slow.crossing(mean), inertia(ARM - mean)
    np.testing.assert_allclose(inertia(ARM), about_mean - m * lever @ lever, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(
        np.linalg.inv(np.eye(3) / m - lever @ np.linalg.inv(about_mean) @ lever),
        m * np.eye(3) + m**2 * lever @ np.linalg.inv(inertia(ARM)) @ lever,
        rtol=1e-9,
        atol=1e-9,
    )


@pytest.mark.parametrize("own_noise", [False, True])
@pytest.mark.parametrize("missing", [False, True])
@pytest.mark.parametrize("spacing", [None, 0.1])
@pytest.mark.parametrize("frame", [None, 0, 11])
def test_full_information_with_gaps_noises_sway_and_frames(own_noise, missing, spacing, frame):
    frames = 30
    r = turning(frames=frames)
    sigma = np.array([0.2, 0.3, 0.5, 1.0, 0.1]) if own_noise else SIGMA
    visible = np.random.default_rng(3).random((frames, 5)) > 0.25 if missing else None
    basis = None if spacing is None else cubic(frames, 60.0, spacing)
    functions = np.ones((frames, 1)) if spacing is None else slow.spline_matrix(frames, basis.size - 3)
    expected = slow.dense_path_bound(ARM, r, sigma, functions, frame, visible)
    found = full_pivot_bound(ARM, r, sigma, visible, basis, frame)
    # Without sway as above; a spline in half a second of motion has a condition of some 1e9.
    assert relative(found, expected) < (1e-9 if spacing is None else 1e-6)
    # Controls: without the gaps, with the mean noise, or without the sway it is another bound.
    if missing:
        assert relative(full_pivot_bound(ARM, r, sigma, None, basis, frame), expected) > 0.01
    if own_noise:
        assert relative(full_pivot_bound(ARM, r, float(np.mean(sigma)), visible, basis, frame), expected) > 0.01
    if spacing is not None:
        assert relative(full_pivot_bound(ARM, r, sigma, visible, None, frame), expected) > 0.1


def test_a_frame_with_two_or_no_markers_still_counts_for_what_it_shows():
    r = turning(frames=30)
    visible = np.ones((30, 5), dtype=bool)
    visible[4, 2:] = visible[9, 1:] = visible[17] = False
    found = full_pivot_bound(ARM, r, SIGMA, visible)
    # The dense matrix is singular for the turns that nothing shows, and solved by singular values.
    assert relative(found, slow.dense_bound(ARM, r, SIGMA, visible)) < 1e-8
    # Control: the frames that show two markers or one are not left out.
    whole = np.setdiff1d(np.arange(30), [4, 9, 17])
    assert relative(found, full_pivot_bound(ARM, r[whole], SIGMA)) > 1e-4


def test_more_information_lowers_the_bound():
    """No data hurts: fewer markers, fewer frames, sway, gaps each raise every direction's variance."""
    r = turning(frames=120)
    full = full_pivot_bound(ARM, r, SIGMA)
    visible = np.random.default_rng(0).random((120, 5)) > 0.2
    for poorer in (
        full_pivot_bound(ARM[:4], r, SIGMA),
        full_pivot_bound(ARM, r[:100], SIGMA),
        full_pivot_bound(ARM, r, SIGMA, visible),
        full_pivot_bound(ARM, r, SIGMA, basis=cubic(120, 60.0, 0.5)),
    ):
        assert np.linalg.eigvalsh(poorer - full).min() > 0


def test_the_bound_follows_axes_unit_and_noise():
    r, turn = turning(frames=60), Rotation.from_rotvec([0.3, -0.8, 1.1]).as_matrix()
    found = pivot_bound(ARM, r, SIGMA)
    # Rounding, magnified by the condition of a 3 x 3 matrix of some 1e2.
    np.testing.assert_allclose(pivot_bound(ARM, turn @ r, SIGMA), turn @ found @ turn.T, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(pivot_bound(ARM @ turn.T, r @ turn.T, SIGMA), found, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(pivot_bound(10 * ARM, r, 10 * SIGMA), 100 * found, rtol=1e-9)
    np.testing.assert_allclose(pivot_bound(ARM, r, 2 * SIGMA), 4 * found, rtol=1e-9)
    # Every frame twice: half the variance.
    np.testing.assert_allclose(pivot_bound(ARM, np.concatenate([r, r]), SIGMA), found / 2, rtol=1e-9)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 2.0, -1.5)], ids=["x", "y", "oblique"])
@pytest.mark.parametrize("which", ["closed form", "full", "gaps", "sway"])
def test_the_bound_along_a_single_axis_is_infinite(axis, which):
    """Pitfall 2 in the bound: exactly unobservable along the axis, as well known as ever across."""
    direction = np.asarray(axis) / np.linalg.norm(axis)
    r = about_one_axis(axis)
    visible = np.random.default_rng(0).random((len(r), len(ARM))) > 0.2 if which == "gaps" else None
    basis = cubic(len(r), 60.0, 0.5) if which == "sway" else None
    bound = pivot_bound(ARM, r, SIGMA) if which == "closed form" else full_pivot_bound(ARM, r, SIGMA, visible, basis)
    assert not np.isnan(bound).any()
    np.testing.assert_array_equal(bound, bound.T)
    along = int(np.argmax(axis))
    if max(axis) > 1.0:
        assert direction @ bound @ direction == np.inf
        return
    assert bound[along, along] == np.inf
    across = np.arange(3) != along
    # A little turning about the other axes, 2e-3 degrees, tells hardly more about the coordinates across.
    expected = full_pivot_bound(ARM, r @ turning(frames=len(r), degrees=2e-3), SIGMA, visible, basis)
    assert np.isfinite(expected).all()  # control: not infinite as soon as there is anything to go by
    assert expected[along, along] > 1e4
    known = np.linalg.inv(np.linalg.inv(expected)[np.ix_(across, across)])  # given the coordinate along the axis
    # The turns differ by 3e-5 rad, and the sides of the head that they show by a part of that.
    np.testing.assert_allclose(bound[np.ix_(across, across)], known, rtol=1e-2, atol=1e-3 * known.max())


@pytest.mark.parametrize("basis", [None, cubic(60, 60.0, 0.2)], ids=["point", "sway"])
def test_the_bound_of_a_still_head_is_infinite(basis):
    r = np.repeat(turning(frames=3)[:1], 60, axis=0)
    expected = np.diag(np.full(3, np.inf))
    np.testing.assert_array_equal(full_pivot_bound(ARM, r, SIGMA, basis=basis), expected)
    np.testing.assert_array_equal(pivot_bound(ARM, r, SIGMA), expected)


def normalised_scatter(bound, errors):
    """Mean squared error in units of a bound: one for an efficient estimator."""
    return float(np.einsum("ni,ij,nj->", errors, np.linalg.inv(bound), errors)) / (3 * len(errors))


@pytest.fixture(scope="module")
def joint_errors():
    """Errors of the joint estimate over 400 draws of the noise on one motion."""
    r = turning(frames=120)
    errors = []
    for seed in range(400):
        points = seen(r, noise=SIGMA, seed=seed)
        found = pivot_estimators["joint"](points, reference_pose(pose_estimators["svd"], points), sway="none")
        errors.append(found.position - PIVOT)
    return r, np.array(errors)


def test_an_efficient_estimator_reaches_the_bound(joint_errors, record_property):
    """1200 squared normal errors know their mean to sqrt(2 / 1200) = 4.1 %: three of these.

    At 0.3 mm and 165 mm the second order adds (0.3 / 165 / sin 20°)², which is nothing.
    """
    r, errors = joint_errors
    allowed = 3 * np.sqrt(2 / errors.size)
    scatter = normalised_scatter(pivot_bound(ARM, r, SIGMA), errors)
    record_property("scatter_over_bound", scatter)
    assert abs(scatter - 1) < allowed
    # Each direction for itself, at 400 draws: sqrt(2 / 400) = 7 %, and the largest of three counts.
    spread = np.linalg.eigvalsh(np.linalg.solve(pivot_bound(ARM, r, SIGMA), np.cov(errors.T)))
    assert (abs(spread - 1) < 4 * np.sqrt(2 / len(errors))).all()
    # Controls: noise off by ten percent either way, or another number of markers.
    for wrong in (0.9 * SIGMA, 1.1 * SIGMA):
        assert abs(normalised_scatter(pivot_bound(ARM, r, wrong), errors) - 1) > allowed
    assert abs(normalised_scatter(pivot_bound(ARM[:4], r, SIGMA), errors) - 1) > allowed


def test_no_unbiased_estimator_is_below_the_bound(joint_errors):
    """The mean error is nought within three standard errors: the bound is for estimators without bias."""
    r, errors = joint_errors
    mean = errors.mean(axis=0)
    # 3 degrees of freedom: 16.3 is the chi-square that one in a thousand exceeds.
    assert mean @ np.linalg.solve(pivot_bound(ARM, r, SIGMA) / len(errors), mean) < 16.3


# --- rotation and target -----------------------------------------------------------------------------------


def turned(found, truth):
    """Small turns (N, 3) of estimated against true rotations, head axes, rad."""
    return Rotation.from_matrix(truth.transpose(0, 2, 1) @ found).as_rotvec()


def poses(noise=SIGMA, frames=20_000, shape=ARM, weights=None, exact=None, seed=5):
    """True rotations and the svd pose against the true shape; ``exact`` are extra points without noise."""
    r = Rotation.random(frames, random_state=seed).as_matrix()
    points = np.einsum("fij,mj->fmi", r, shape)
    points = points + noise * np.random.default_rng(seed).standard_normal(points.shape)
    if exact is not None:
        shape, points = np.vstack([shape, exact]), np.concatenate([points, np.zeros((frames, 1, 3))], axis=1)
    return r, pose_estimators["svd"](shape, points, weights)


@pytest.mark.parametrize("markers", [3, 5])
@pytest.mark.parametrize("pivot_known", [False, True])
def test_the_bound_of_the_rotation_is_reached(markers, pivot_known):
    arm = ARM[:markers]
    if pivot_known:
        # The pivot as one more marker of a million times the weight.
        r, pose = poses(shape=arm, exact=np.zeros((1, 3)), weights=np.r_[np.ones(markers), 1e6])
    else:
        r, pose = poses(shape=arm)
    errors = turned(pose.rotations, r)
    bound = rotation_bound(arm, SIGMA, pivot_known=pivot_known)
    # 60,000 squares know their mean to 0.6 %: three of these; the second order is (0.3 / 20 mm)² = 0.02 %.
    allowed = 3 * np.sqrt(2 / errors.size)
    assert abs(normalised_scatter(bound, errors) - 1) < allowed
    for wrong in (
        rotation_bound(arm, 1.1 * SIGMA, pivot_known=pivot_known),
        rotation_bound(arm, SIGMA, pivot_known=not pivot_known),
        rotation_bound(arm, SIGMA, pivot_known=pivot_known, noisy_template=True),
    ):
        assert abs(normalised_scatter(wrong, errors) - 1) > 2 * allowed


def test_a_template_of_one_noisy_frame_doubles_the_variance():
    rng = np.random.default_rng(8)
    errors = []
    for r in turning(frames=3000, degrees=40.0):
        template, points = (
            ARM + SIGMA * rng.standard_normal(ARM.shape),
            ARM @ r.T + SIGMA * rng.standard_normal(ARM.shape),
        )
        errors.append(turned(pose_estimators["svd"](template, points[None]).rotations, r[None])[0])
    errors = np.array(errors)
    # 9,000 squares: 1.5 %, three of these.
    allowed = 3 * np.sqrt(2 / errors.size)
    assert abs(normalised_scatter(rotation_bound(ARM, SIGMA, noisy_template=True), errors) - 1) < allowed
    assert abs(normalised_scatter(rotation_bound(ARM, SIGMA), errors) - 1) > 0.8  # control: not the single variance


@pytest.mark.parametrize("target", [ARM.mean(axis=0), ARM[3], np.array([30.0, 20.0, 150.0]), np.zeros(3)])
def test_the_bound_of_a_target_is_reached(target):
    r, pose = poses()
    there = r @ target
    errors = np.einsum("fji,fj->fi", pose.rotations, there - pose.translations) - target
    bound = target_bound(ARM, target, SIGMA)
    # As for the rotation: 0.6 % times three.
    allowed = 3 * np.sqrt(2 / errors.size)
    assert abs(normalised_scatter(bound, errors) - 1) < allowed
    assert abs(normalised_scatter(bound * 1.21, errors) - 1) > 2 * allowed
    if np.allclose(target, ARM.mean(axis=0)):
        np.testing.assert_allclose(bound, SIGMA**2 / len(ARM) * np.eye(3), rtol=1e-9, atol=1e-12)


# --- splines -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("frames", "spacing"), [(2, 0.1), (3, 0.05), (61, 0.1), (600, 1.5), (601, 0.25), (50, 30.0)])
def test_cubic_is_the_b_spline_of_scipy(frames, spacing):
    basis = cubic(frames, 60.0, spacing)
    # Powers of u below one: a few roundings.
    np.testing.assert_allclose(dense(basis), slow.spline_matrix(frames, basis.size - 3), atol=1e-13)
    np.testing.assert_allclose(basis.values.sum(axis=1), 1.0, atol=1e-14)
    assert (basis.values >= -1e-16).all()
    spans = basis.size - 3
    assert basis.spacing_s * spans == pytest.approx((frames - 1) / 60.0)
    # The nearest whole number of spans: off by half a span at most.
    assert spans == max(round((frames - 1) / 60.0 / spacing), 1)


@pytest.mark.parametrize("spacing", [0.0, -1.0, np.nan, np.inf, 1.9 / 60])
def test_a_spacing_that_makes_no_sense_is_refused(spacing):
    with pytest.raises(EvalkitError, match="knots"):
        cubic(100, 60.0, spacing)


@pytest.mark.parametrize(
    "basis", [constant(50), cubic(50, 60.0, 0.1), cubic(50, 60.0, 30.0)], ids=lambda b: str(b.size)
)
def test_gather_and_bands_are_dense_products(basis):
    matrix, data = dense(basis), np.random.default_rng(0).normal(size=(50, 4))
    # Sums of fifty terms near one, in another order.
    np.testing.assert_allclose(basis.gather(data), matrix.T @ data, atol=1e-12)
    np.testing.assert_allclose(basis.evaluate(data[: basis.size]), matrix @ data[: basis.size], atol=1e-12)
    bands = basis.bands(data)
    for column in range(data.shape[1]):
        whole = matrix.T @ (data[:, column, None] * matrix)
        for m in range(len(bands)):
            np.testing.assert_allclose(bands[m, : basis.size - m, column], np.diagonal(whole, -m), atol=1e-12)
            assert not bands[m, basis.size - m :].any()
        # Nothing lies beyond the bands.
        assert abs(np.tril(whole, -len(bands))).max(initial=0) == 0


def test_gather_and_bands_of_some_of_the_frames():
    whole = cubic(200, 60.0, 0.2)
    kept = np.flatnonzero(np.random.default_rng(1).random(200) > 0.5)
    kept = kept[(kept < 60) | (kept > 110)]  # several spans without a frame
    basis = Basis(whole.first[kept], whole.values[kept], whole.size, whole.spacing_s)
    matrix, data = dense(basis), np.random.default_rng(0).normal(size=(len(kept), 2))
    np.testing.assert_allclose(basis.gather(data), matrix.T @ data, atol=1e-12)
    np.testing.assert_allclose(basis.bands(data)[2, : basis.size - 2, 1], np.diagonal(
        matrix.T @ (data[:, 1, None] * matrix), -2), atol=1e-12)  # fmt: skip


@pytest.mark.parametrize("size", [1, 2, 3, 4, 9])
def test_roughness_is_that_of_second_differences(size):
    differences = np.diff(np.eye(size), 2, axis=0)
    whole, found = differences.T @ differences, roughness(size, 4)
    for m in range(4):
        expected = np.zeros(size)
        expected[: max(size - m, 0)] = np.diagonal(whole, -m) if m < size else 0.0
        np.testing.assert_array_equal(found[m], expected)


def test_smoothed_bridges_gaps():
    time_s = np.arange(600) / 60.0
    path = np.stack([10 * np.sin(2 * np.pi * 0.2 * time_s), 3 * time_s, np.full(600, 4.0)], axis=1)
    ok = np.ones(600, dtype=bool)
    ok[200:260] = False  # a second, two knots
    holes = np.where(ok[:, None], path, np.nan)
    found = smoothed(holes, ok, 60.0, 0.5)
    assert np.isfinite(found).all()
    # A spline of spacing h follows a sine of frequency f to (2 pi f h)^4 / 384: 0.01 mm here, and the penalty's pull.
    assert np.abs(found - path)[ok].max() < 0.05
    # In the gap the penalty draws the straightest line: off by up to a^2 |s''| / 8 = 1 / 8 * 1.58 * 10 = 2 mm.
    assert np.abs(found - path)[~ok].max() < 2.0
    # A straight line costs no roughness: exact but for the penalty's last digits, in the gap too.
    assert np.abs(found - path)[:, 1:].max() < 1e-4
    # Control: filled with zeros instead of bridged, the gap shows.
    assert np.abs(smoothed(np.nan_to_num(holes), np.ones(600, bool), 60.0, 0.5) - path)[~ok].max() > 4.0
    # Frames that are not ok do not count, whatever they hold.
    np.testing.assert_array_equal(smoothed(np.where(ok[:, None], path, 1e6), ok, 60.0, 0.5), found)


def test_smoothed_with_hardly_a_frame():
    path = np.full((100, 3), np.nan)
    ok = np.zeros(100, dtype=bool)
    assert np.isfinite(smoothed(path, ok, 60.0, 0.3)).all()
    path[30], ok[30] = [1.0, 2.0, 3.0], True
    found = smoothed(path, ok, 60.0, 0.3)
    assert np.isfinite(found).all()
    # One frame: the spline passes through it, but for the ridge of 1e-6.
    np.testing.assert_allclose(found[30], path[30], rtol=1e-3)


def best_time(function, *arguments, rounds=5):
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        function(*arguments)
        times.append(time.perf_counter() - start)
    return min(times)


@pytest.mark.timing
def test_the_bound_and_the_spline_are_linear_in_frames(record_property):
    """Five times the frames: a quadratic cost would be 25 times as long, a linear one five, and caches cost some."""
    ratios = {}
    for what in ("bound", "smoothed"):
        times = []
        for frames in (4_000, 20_000):
            r = turning(frames=frames)
            if what == "bound":
                times.append(best_time(full_pivot_bound, ARM, r, SIGMA, None, cubic(frames, 60.0, 0.5)))
            else:
                times.append(best_time(smoothed, r[:, 0], np.ones(frames, dtype=bool), 60.0, 0.5))
        ratios[what] = times[1] / times[0]
        record_property(f"{what}_times_for_5_times_the_frames", ratios[what])
    assert max(ratios.values()) < 12
