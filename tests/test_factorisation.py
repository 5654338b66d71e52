"""Head pose apart from deformation: exact where theory says so, refused where it fails, and alignment beside it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from realdata import real_data
from scipy.spatial.transform import Rotation

from evalkit.capture import Capture, read_capture
from evalkit.compensation import compensate
from evalkit.control.alignment import align, aligned_bases, rigid_share
from evalkit.control.denoising import denoised, elbow, noise_level, principal, scores
from evalkit.control.factorisation import factorise, independent_frames, rotations_and_coefficients
from evalkit.errors import EvalkitError, FrameStatus
from evalkit.geometry import mean_rotation
from evalkit.metrics import expression_error_mm, rms, rotation_error_deg
from evalkit.pose import pose_estimators, reference_pose
from evalkit.studies import studies
from evalkit.study.description import Budget
from evalkit.study.runner import run
from evalkit.synthetic import synthesize

sys.path.insert(0, str(Path(__file__).parent / "oracles"))
from factorisation_oracles import (
    factor_of,
    mixed_shapes,
    most_probable_amounts,
    rotation_constraints,
    rotations_frame_by_frame,
    weighted_alignment,
)

# Rounding of 1e-16 times the condition number of the chosen frames (at most some 1e3) and of the matrix, in degrees.
EXACT_DEG = 1e-7

quick = settings(derandomize=True, deadline=None, max_examples=15, database=None)

TURN, SHIFT = Rotation.from_rotvec([0.4, -0.9, 1.3]).as_matrix(), np.array([2e3, -1.5e3, 3e3])


@pytest.fixture(scope="module")
def talking():
    """Ten seconds of talk, 63 markers, 0.5 mm of noise: the jaw turns about its joint."""
    return synthesize("talking", seed=0, layout="dense-63", noise=0.5)


def off_deg(rotations, truth):
    return rms(rotation_error_deg(rotations, truth))


# Factorisation


@quick
@given(count=st.integers(1, 4), spare=st.integers(0, 20), seed=st.integers(0, 10**6))
def test_random_full_rank_bases_are_recovered_exactly(count, spare, seed):
    points, rotations, shapes = mixed_shapes(40, 3 * count + 2 + spare, count, seed)
    found = factorise(points, count)
    assert off_deg(found.rotations, rotations) < EXACT_DEG
    assert np.linalg.det(found.rotations) == pytest.approx(1.0, abs=1e-9)
    assert found.misfit < 1e-9 < found.condition < found.largest_condition
    centred = shapes - shapes.mean(axis=1, keepdims=True)
    # Coordinates of 10 mm: a thousandth of a micrometre is what their rounding comes to.
    assert expression_error_mm(found.shapes, centred).max() < 1e-6
    rebuilt = np.einsum("fij,fmj->fmi", found.rotations, found.shapes) + found.translations[:, None]
    np.testing.assert_allclose(rebuilt, points, atol=1e-6)


def test_frame_by_frame_oracle_gives_the_same():
    points, *_ = mixed_shapes(50, 20, 4, seed=1)
    factor = factor_of(points, 4)
    chosen = independent_frames(factor, 4)
    slow = rotations_frame_by_frame(factor, chosen)
    seen = np.isfinite(slow[:, 0, 0])
    assert seen.sum() > 40
    assert off_deg(factorise(points, 4).rotations[seen], slow[seen]) < EXACT_DEG


@pytest.mark.parametrize("count", [1, 2, 3])
def test_rotation_constraints_alone_leave_the_gauge_that_theory_says(count):
    points, *_ = mixed_shapes(60, 3 * count + 4, count, seed=2)
    factor = factor_of(points, count)
    constraints, pairs = rotation_constraints(factor)
    size = np.linalg.svd(constraints, compute_uv=False)
    # Zero but for rounding, against constraints that bind.
    assert (size < 1e-9 * size[0]).sum() + len(pairs) - len(size) == 2 * count**2 - count
    # What the basis constraints choose out of it is the true one: the first three columns of G give G_1 G_1'.
    turns, amounts, _ = rotations_and_coefficients(factor, independent_frames(factor, count))
    q = np.einsum("fk,fij->fikj", amounts, turns).reshape(-1, 3 * count)
    g = np.linalg.lstsq(factor.reshape(-1, 3 * count), q, rcond=None)[0][:, :3]
    h = g @ g.T
    assert np.abs(constraints @ np.array([h[i, j] for i, j in pairs])).max() < 1e-7 * size[0] * np.abs(h).max()


@quick
@given(seed=st.integers(0, 10**6))
def test_gauge_gives_the_same_shapes_and_poses(seed):
    """D (x) T, and any other invertible matrix: the factor is only known up to it."""
    rng = np.random.default_rng(seed)
    points, *_ = mixed_shapes(40, 16, 3, seed=3)
    factor = factor_of(points, 3)
    chosen = independent_frames(factor, 3)
    turns, amounts, _ = rotations_and_coefficients(factor, chosen)
    # Not nearly singular, or rounding is all that is seen.
    d = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.3, 3.0, 3)
    whole = np.linalg.qr(rng.normal(size=(9, 9)))[0] * rng.uniform(0.3, 3.0, 9)
    for gauge in (np.kron(d, Rotation.random(random_state=seed).as_matrix()), whole):
        other, mixed, _ = rotations_and_coefficients(factor @ gauge, chosen)
        np.testing.assert_allclose(other, turns, atol=1e-9)
        np.testing.assert_allclose(mixed, amounts, atol=1e-9)
    # Control: other frames for a basis are other amounts, and still the same rotations.
    elsewhere = np.array([0, 1, 2]) if 0 not in chosen else np.array([3, 4, 5])
    other, mixed, _ = rotations_and_coefficients(factor, elsewhere)
    assert off_deg(other, turns) < 1e-4 and np.abs(mixed - amounts).max() > 1e-3


@pytest.mark.parametrize("noise", [0.0, 0.5])
@pytest.mark.parametrize("count", [2, 5, 12])
def test_a_face_that_talks_is_refused_with_the_condition_number_and_does_fail(count, noise):
    take, truth = synthesize("talking", seed=0, layout="dense-63", noise=noise)
    with pytest.raises(EvalkitError, match="condition number") as caught:
        factorise(take.points, count)
    assert "\n" not in str(caught.value)
    forced = factorise(take.points, count, refuse=False)
    assert off_deg(forced.rotations, truth.rotations) > 20.0
    assert forced.condition > forced.largest_condition or forced.misfit > 0.1
    assert np.linalg.det(forced.rotations) == pytest.approx(1.0, abs=1e-9)


def test_a_take_that_is_no_such_mixture_is_refused_by_its_misfit():
    rng = np.random.default_rng(0)
    with pytest.raises(EvalkitError, match=r"no rotations|nearly dependent"):
        factorise(rng.normal(scale=50.0, size=(80, 12, 3)), 3)


def test_noise_is_told_and_costs_little_where_shapes_are_independent():
    points, rotations, _ = mixed_shapes(400, 40, 5, seed=0, noise=0.1, first_mm=50.0)
    found = factorise(points, 5)
    assert found.noise_mm == pytest.approx(0.1, rel=0.05)
    # 0.1 mm against 5 mm of deformation on 40 markers: 0.12 deg measured, a fifth of a degree is another method.
    assert off_deg(found.rotations, rotations) < 0.2


def test_frames_that_lack_a_marker_are_left_out_and_come_back_empty():
    points, rotations, _ = mixed_shapes(60, 16, 3, seed=4)
    points[[3, 20], [5, 7]] = np.nan
    found = factorise(points, 3)
    lost = ~np.isfinite(found.rotations[:, 0, 0])
    assert np.flatnonzero(lost).tolist() == [3, 20]
    assert np.isnan(found.coefficients[lost]).all() and np.isnan(found.shapes[lost]).all()
    assert off_deg(found.rotations, rotations) < EXACT_DEG


def never(points):
    points = points.copy()
    points[:, 2] = np.nan
    return points


@pytest.mark.parametrize(
    ("change", "count", "words"),
    [
        (lambda x: x, 0, "ask for 1 to 5"),
        (lambda x: x, 6, "ask for 1 to 5"),
        (lambda x: x[:3], 3, "3 of 3 frames have every marker, 3 bases need 4"),
        (never, 3, "leave out marker 2, which is seen in 0%"),
        (lambda x: x[..., :2], 3, "expected"),
    ],
)
def test_a_mistake_is_one_clear_line(change, count, words):
    points, *_ = mixed_shapes(40, 16, 3, seed=5)
    with pytest.raises(EvalkitError, match=words) as caught:
        factorise(change(points), count)
    assert "\n" not in str(caught.value)


# What both ways promise


def by_factorisation(points):
    found = factorise(points, 3, centre=(0, 1, 2, 3))
    return found.rotations, found.translations, found.shapes


def by_alignment(points):
    found = align(Capture(points, [f"m{k}" for k in range(points.shape[1])], 60.0), ["m0", "m1", "m2", "m3"])
    return found.rotations, found.translations, found.shapes


WAYS = {"factorisation": by_factorisation, "alignment": by_alignment}


def mixture_for(way):
    """Random shapes for the one; a face whose first four markers hardly move for the other."""
    if way == "factorisation":
        return mixed_shapes(80, 16, 3, seed=6, noise=0.05)[0]
    take, truth = synthesize("talking", seed=1, layout="reduced-12", noise=0.3, frames=120)
    columns = take.indices(truth.rigid)
    return take.points[:, [*columns, *(k for k in range(12) if k not in columns)]]


@pytest.mark.parametrize("way", WAYS)
def test_contract(way):
    separate, points = WAYS[way], mixture_for(way)
    kept = points.copy()
    r, t, s = separate(points)
    np.testing.assert_array_equal(points, kept)
    for a, b in zip(separate(points), (r, t, s), strict=True):
        np.testing.assert_array_equal(a, b)
    assert np.linalg.det(r) == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(mean_rotation(r), np.eye(3), atol=1e-9)
    # Other axes: the mean orientation is the identity in them, too. Metres away, 1e-16 of 1e3 mm over 50 mm.
    r2, t2, s2 = separate(points @ TURN.T + SHIFT)
    np.testing.assert_allclose(r2, TURN @ r @ TURN.T, atol=1e-7)
    np.testing.assert_allclose(t2, t @ TURN.T + SHIFT, atol=1e-4)
    np.testing.assert_allclose(s2, s @ TURN.T, atol=1e-4)
    # Another unit.
    r3, t3, s3 = separate(10.0 * points)
    np.testing.assert_allclose(r3, r, atol=1e-7)
    np.testing.assert_allclose(t3, 10.0 * t, atol=1e-4)
    np.testing.assert_allclose(s3, 10.0 * s, atol=1e-4)


# Alignment


def test_a_talking_face_with_half_a_millimetre_of_noise(talking):
    take, truth = talking
    named = align(take, truth.rigid)
    # The bound asked of the default mode; one frame of seven markers by itself has 0.67 deg.
    assert off_deg(named.rotations, truth.rotations) < 0.35
    assert named.noise_mm == pytest.approx(0.5, rel=0.03)
    shapes = rms(expression_error_mm(named.shapes, truth.clean))
    # Control: the noise kept, and all markers taken for rigid.
    kept = align(take, truth.rigid, truncate=False)
    assert off_deg(kept.rotations, truth.rotations) > 0.5
    pose = reference_pose(pose_estimators["svd"], take.points)
    assert off_deg(pose.rotations, truth.rotations) > 1.0
    # Control: centred on the mean of all markers, which moves with the jaw.
    centroid = (take.points - take.points.mean(axis=1, keepdims=True)) @ named.rotations
    assert rms(expression_error_mm(centroid, truth.clean)) > 1.5 * shapes


def test_weighted_automatically_the_bound_is_kept_without_being_told_what_is_rigid(talking):
    whole, truth = talking
    # Every sixth frame: what is left of the smoothness would count as noise.
    found = align(Capture(whole.points[::6], whole.labels, whole.rate), noise_mm=0.5)
    assert off_deg(found.rotations, truth.rotations[::6]) < 0.35
    assert found.chosen.weighted and found.rounds == 0


def test_without_the_cut_it_is_the_compensation():
    take, _ = synthesize("talking", seed=4, noise=0.3, frames=60)
    # The one is turned to its mean orientation about the markers' mean, the other about the pivot.
    assert off_deg(align(take, truncate=False).rotations, compensate(take).rotations) < 1e-6


def test_slow_oracle_of_the_weighted_alignment():
    take, truth = synthesize("skin", seed=3, layout="dense-63", noise=0.3, frames=25)
    found = align(take, truth.rigid, noise_mm=0.3, truncate=False)
    slow = weighted_alignment(take.points[:, take.indices(truth.rigid)], 0.3)
    # Weights settle to a thousandth, which moves a pose by less than that part of its own error of half a degree.
    assert off_deg(found.rotations, slow) < 1e-3
    # Control: without weights it is another pose.
    plain = reference_pose(pose_estimators["svd"], take.points[:, take.indices(truth.rigid)])
    assert off_deg(plain.rotations, slow) > 0.01


def test_missing_markers_survive():
    take, truth = synthesize("talking", seed=0, layout="dense-63", noise=0.5, gaps=0.05, frames=200)
    assert np.isfinite(take.points[:, :, 0]).all(axis=1).mean() < 0.2
    found = align(take, truth.rigid)
    there = np.isfinite(take.points) & (found.frame_status == FrameStatus.OK)[:, None, None]
    np.testing.assert_array_equal(np.isfinite(found.shapes), there)
    assert (
        off_deg(found.rotations, truth.rotations)
        < 0.35
        < off_deg(align(take, truth.rigid, truncate=False).rotations, truth.rotations)
    )
    bases = aligned_bases(found.shapes, 8)
    assert np.isfinite(bases.coefficients[there.any(axis=(1, 2))]).all()
    full = aligned_bases(truth.clean, 4)
    # The span of the strongest four is that of the true ones but for some degrees, by noise and gaps.
    overlap = np.linalg.svd(bases.bases[:8].reshape(8, -1) @ full.bases.reshape(4, -1).T, compute_uv=False)
    assert overlap.min() > 0.95


@pytest.mark.parametrize(
    ("rigid", "noise", "words"),
    [
        (["ForeheadC", "ForeheadL"], None, "at least three"),
        (["ForeheadC", "ForeheadL", "Nobody"], None, "Nobody"),
        (["ForeheadC", "ForeheadL", "ForeheadR"], -1.0, "above 0"),
        (["ForeheadC", "ForeheadL", "ForeheadR"], float("nan"), "above 0"),
    ],
)
def test_a_mistake_in_an_alignment_is_one_clear_line(rigid, noise, words):
    take, _ = synthesize("talking", frames=30)
    with pytest.raises(EvalkitError, match=words) as caught:
        align(take, rigid, noise)
    assert "\n" not in str(caught.value)


# Noise cut off


def test_the_threshold_is_the_published_one():
    # Gavish & Donoho, Table of lambda(b): 4/sqrt(3) for a square, sqrt(2) for a long matrix.
    assert elbow([4 / np.sqrt(3) * 1.001, 4 / np.sqrt(3) * 0.999], 1, 1, 1.0) == 1
    assert elbow([1.42 * 1e4, 1.41 * 1e4], 10**8, 1, 1.0) == 1
    rng = np.random.default_rng(0)
    signal = rng.normal(size=(900, 5)) @ rng.normal(size=(5, 40))
    size = np.linalg.svd(signal + 0.3 * rng.normal(size=signal.shape), compute_uv=False)
    assert elbow(size, 900, 40, 0.3) == 5
    # Control: noise that is thought to be a third of itself.
    assert elbow(size, 900, 40, 0.1) == 40


def test_noise_is_read_off_differences_in_time(talking):
    take, truth = talking
    assert noise_level(truth.clean) < 0.01 < 0.485 < noise_level(take.points) < 0.515
    assert noise_level(np.full((9, 4, 3), np.nan)) == 0.0 == noise_level(np.zeros((2, 4, 3)))


def test_denoised_positions_are_nearer_to_the_truth(talking):
    take, truth = talking
    middle = truth.translations[:, None] + np.einsum("fij,j->fi", truth.rotations, truth.neutral.mean(axis=0))[:, None]
    middle = middle - truth.translations[:, None]
    exact = np.einsum("fij,fmj->fmi", truth.rotations, truth.clean) + truth.translations[:, None]
    found, rank = denoised(take.points - middle, 0.5)
    before, after = rms(take.points - exact), rms(found + middle - exact)
    # Of 63 dimensions so many are kept, and with them their share of the noise; the rest of the error is what was cut.
    assert 5 < rank < 20
    assert np.sqrt(rank / 63) * before * 0.9 < after < 0.6 * before


def test_amounts_of_rows_with_gaps_are_the_most_probable_ones():
    rng = np.random.default_rng(0)
    axes, spread = np.linalg.qr(rng.normal(size=(12, 3)))[0], np.array([9.0, 4.0, 1.0])
    rows = (rng.normal(size=(30, 3)) * np.sqrt(spread)) @ axes.T + 0.1 * rng.normal(size=(30, 12))
    rows[rng.random(rows.shape) < 0.4] = np.nan
    found = scores(rows, axes, spread, 0.01)
    for row, amounts in zip(rows, found, strict=True):
        if np.isnan(row).any():
            np.testing.assert_allclose(amounts, most_probable_amounts(row, axes, spread, 0.01), atol=1e-9)


def test_axes_are_found_through_gaps():
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(500, 4)) * [8.0, 4.0, 2.0, 1.0] @ np.linalg.qr(rng.normal(size=(30, 4)))[0].T
    whole = principal(rows, lambda *_: 4)[0]
    rows[rng.random(rows.shape) < 0.2] = np.nan
    found = principal(rows, lambda *_: 4)[0]
    # Four dimensions and no noise: what is missing follows from what is seen, up to the rounds' tolerance.
    assert np.linalg.svd(whole.T @ found, compute_uv=False).min() > 1.0 - 1e-6


# Bases


def test_bases_of_aligned_shapes_and_both_variance_figures(talking):
    _, truth = talking
    shapes = truth.clean
    found = aligned_bases(shapes, 6)
    flat = found.bases.reshape(6, -1)
    np.testing.assert_allclose(flat @ flat.T, np.eye(6), atol=1e-9)
    rebuilt = found.mean + np.tensordot(found.coefficients, found.bases, axes=1)
    square = ((shapes - found.mean) ** 2).sum()
    assert found.kept == pytest.approx(1.0 - ((shapes - rebuilt) ** 2).sum() / square, abs=1e-9)
    assert aligned_bases(shapes, variance=found.kept - 1e-6).bases.shape[0] == 6
    assert aligned_bases(shapes, variance=found.kept + 1e-6).bases.shape[0] == 7
    # The figure of the factorisation does not depend on the pose, and is vacuous from 21 bases on.
    matrix = np.einsum("fij,fmj->fim", truth.rotations, shapes).reshape(-1, 63)
    size = np.linalg.svd(matrix, compute_uv=False) ** 2
    assert found.kept_by_factor == pytest.approx(size[:18].sum() / size.sum(), abs=1e-9)
    assert not found.vacuous and aligned_bases(shapes, 21).vacuous and aligned_bases(shapes, 21).kept_by_factor == 1.0
    # Displacements and their rest are the same shapes.
    apart = aligned_bases(shapes - truth.neutral, 6, rest_mm=truth.neutral)
    np.testing.assert_allclose(apart.bases, found.bases, atol=1e-9)
    assert apart.kept_by_factor == pytest.approx(found.kept_by_factor, abs=1e-12)
    np.testing.assert_allclose(apart.rigid_share, found.rigid_share, atol=1e-9)


def test_an_opening_jaw_can_pass_for_a_nod_and_brows_cannot(talking):
    neutral = talking[1].neutral - talking[1].neutral.mean(axis=0)
    nod = np.cross([1.0, 0.0, 0.0], neutral)
    tilt = np.cross([0.0, 0.0, 1.0], neutral)
    # A basis that is a nod, translated or not, and nothing else.
    np.testing.assert_allclose(rigid_share(neutral, [nod + 3.0])[0], 1.0, atol=1e-9)
    assert rigid_share(neutral, [nod, tilt])[2] == pytest.approx(1.0, abs=1e-9)
    shares = {}
    for actions in (("speech",), ("brow_raise",)):
        _, truth = synthesize("talking", seed=0, layout="dense-63", frames=300, actions=actions)
        shares[actions[0]] = aligned_bases(truth.clean, 2).rigid_share
    # A lower face that turns about the jaw's joint is a third of a whole that nods; brows are a hundredth, and neither
    # turns the head to a side.
    assert shares["speech"][0] > 0.2 > 0.05 > shares["brow_raise"][0]
    assert max(shares["speech"][1], shares["brow_raise"][1]) < 1e-3


@pytest.mark.parametrize(
    ("given_", "words"),
    [
        ({}, "either"),
        ({"count": 2, "variance": 0.9}, "either"),
        ({"count": 0}, "ask for 1 to 9"),
        ({"count": 10}, "ask for 1 to 9"),
        ({"variance": 0.0}, "above 0"),
        ({"variance": 1.1}, "up to 1"),
    ],
)
def test_a_mistake_in_asking_for_bases_is_one_clear_line(given_, words):
    with pytest.raises(EvalkitError, match=words) as caught:
        aligned_bases(np.random.default_rng(0).normal(size=(10, 6, 3)), **given_)
    assert "\n" not in str(caught.value)


def test_a_marker_that_is_never_seen_cannot_have_a_basis():
    shapes = never(np.random.default_rng(0).normal(size=(10, 6, 3)))
    with pytest.raises(EvalkitError, match="marker 2"):
        aligned_bases(shapes, 2)


# Study and real takes


def test_the_study_says_what_it_asks_and_shows_the_refusal_as_a_row():
    study = studies["factorisation"]
    assert study.question.endswith("?") and len(study.finding) > 100
    study.at("small")
    cut = Budget(
        1,
        {"layout": ("dense-63",), "bases": ("nonlinear", "gaussian"), "noise_mm": (0.5,)},
        ("factorisation", "factorisation, not refused", "Procrustes of all"),
    )
    table = run(study, None, cut, jobs=1)
    assert [(row["bases"], row["method"]) for row in table.failed] == [("nonlinear", "factorisation")]
    assert "condition number" in table.failed[0]["message"]
    value = {(row["bases"], row["method"]): row["rotation_deg"] for row in table.rows}
    assert value["nonlinear", "factorisation, not refused"] > 20.0
    assert value["gaussian", "factorisation"] < 1.0 < value["gaussian", "Procrustes of all"]


def test_a_real_face_is_refused_and_aligned():
    whole = read_capture(real_data("captures", "animface_jaw.c3d"))
    take = Capture(whole.points[::3], whole.labels, whole.rate / 3)
    with pytest.raises(EvalkitError, match="condition number"):
        factorise(take.points, 5)
    found = align(take, ["ForeHead_M", "ForeHead_L", "ForeHead_R", "NoseTop"])
    assert (found.frame_status == FrameStatus.OK).all()
    turned = rms(rotation_error_deg(found.rotations, np.broadcast_to(np.eye(3), found.rotations.shape)))
    # The head is said to turn by 2 to 6 degrees in all.
    assert 0.5 < turned < 3.0
    bases = aligned_bases(found.shapes, 25)
    assert bases.vacuous and bases.kept > 0.99
