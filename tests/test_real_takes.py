"""Automatic weighting on real takes: the leave-one-out table.

A marker that should sit on the skull is taken out of the take, the head motion is estimated from the markers that
remain, and the held-out marker is stabilised by it. How far it still moves (root mean square of its distance from
its mean, mm) is its own motion over the skull plus the error of the estimate. The study ``real-takes`` does this; here
its figures on two takes are held, and those of methods that are no choice for a user beside them.
"""

from __future__ import annotations

import numpy as np
import pytest
from realdata import real_data

from evalkit.capture import read_capture
from evalkit.compensation import compensate
from evalkit.geometry import undo_motion
from evalkit.metrics import rms
from evalkit.pose import pose_estimators, reference_pose
from evalkit.pose.skin import SkinModel, automatic_rigid, skin_estimator
from evalkit.studies.real_takes import AND, left_out, run, score

TAKES = ("jaw", "cheeks")
HELD_OUT = ("NoseTop", "Leye_Inside", "Reye_Inside")
TRIANGLE = ("ForeHead_M", "ForeHead_L", "ForeHead_R")
STUDY = ("raw", "svd triangle", "svd candidates")
"""Methods of the study real-takes that are measured by it."""
CANDIDATES = (*TRIANGLE, "NoseTop", "Eyebrow_Center", "Leye_Inside", "Reye_Inside")


def wander(pose, path):
    """Root-mean-square distance of a stabilised marker (F, 3) from its mean, mm."""
    still = undo_motion(pose.rotations, pose.translations, path[:, None, :])[:, 0]
    return rms(np.linalg.norm(still - still.mean(axis=0), axis=1))


def shuffled(model, points):
    """Poses by the same scatters, each given to another marker, in four ways."""
    for seed in range(4):
        order = np.random.default_rng(seed).permutation(len(model.scatter))
        wrong = SkinModel(**{**vars(model), "scatter": model.scatter[order]})
        yield skin_estimator(wrong)(model.template, points)


@pytest.fixture(scope="module")
def takes():
    return {name: read_capture(real_data("captures", f"animface_{name}.c3d")) for name in TAKES}


@pytest.fixture(scope="module")
def table(takes):
    """Method -> score of the three held-out markers in each of the takes, shape (2, 3)."""
    rows = {method: [] for method in (*STUDY, "auto", "weights", "shuffled")}
    for take in takes.values():
        for label in HELD_OUT:
            one = left_out(take, label, AND.join(CANDIDATES), AND.join(TRIANGLE))
            for method in STUDY:
                rows[method].append(score([one], run([one], method))["motion_mm"])
            result = compensate(one.rest)  # what the study calls auto, here for its model, too
            rows["auto"].append(wander(result, one.path))
            chosen = result.chosen
            x, model = one.rest.points[:, chosen.columns], chosen.model
            weighted = reference_pose(pose_estimators["svd"], x, weights=chosen.weights)
            rows["weights"].append(wander(weighted, one.path))
            rows["shuffled"].append(np.mean([wander(p, one.path) for p in shuffled(model, x)]))
    scores = {method: np.reshape(values, (len(TAKES), len(HELD_OUT))) for method, values in rows.items()}
    for method, values in scores.items():
        print(f"{method:10s} {np.round(values, 2).tolist()} mean {values.mean():.3f}")
    return scores


@pytest.mark.slow
def test_the_yardsticks_are_those_measured_before(table):
    np.testing.assert_allclose(table["raw"][:, 0], [2.85, 3.62], atol=0.01)
    np.testing.assert_allclose(table["svd triangle"], [[1.04, 1.01, 1.26], [2.49, 2.30, 2.19]], atol=0.01)
    np.testing.assert_allclose(table["svd candidates"], [[0.72, 0.71, 1.06], [1.77, 1.74, 1.20]], atol=0.01)


@pytest.mark.slow
def test_automatic_weighting_is_as_good_as_it_was(table):
    np.testing.assert_allclose(table["auto"], [[0.54, 0.57, 0.94], [1.46, 1.76, 1.11]], atol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "weights"])
def test_never_worse_than_nothing_or_than_the_forehead_triangle(table, method):
    assert (table[method] < table["raw"]).all()
    assert (table[method] < table["svd triangle"]).all()


@pytest.mark.slow
def test_better_than_the_candidates_with_equal_weights(table):
    assert table["auto"].mean() <= 0.9 * table["svd candidates"].mean()
    assert table["weights"].mean() <= 0.95 * table["svd candidates"].mean()


@pytest.mark.slow
def test_control_covariances_given_to_the_wrong_markers(table):
    assert table["shuffled"].mean() > 1.2 * table["auto"].mean()


@pytest.mark.slow
def test_control_variances_without_the_leverage_correction_collapse(takes):
    """Residual variances alone: the marker that counts most has the smallest residual and counts even more."""
    take = takes["cheeks"]
    points, variance = take.points[::5], np.ones(len(take.labels))
    template = points[0]
    for _ in range(200):
        pose = pose_estimators["qcp"](template, points, 1 / variance)
        still = undo_motion(pose.rotations, pose.translations, points)
        template = still.mean(axis=0)
        variance = np.maximum(((still - template) ** 2).mean(axis=(0, 2)), 1e-12)
    naive = np.sort(1 / variance)[::-1] / (1 / variance).sum()
    ours = np.sort(automatic_rigid(take).weights)[::-1]
    assert naive[:3].sum() > 0.99
    assert ours[:3].sum() < 0.6 * ours.sum()


def test_the_choice_says_why(takes):
    chosen = automatic_rigid(takes["jaw"])
    assert "ForeHead_R" in chosen.reason and "of the information about rotation" in chosen.reason
    assert not chosen.warnings
    # Jaw and lower lip move most and are of no use; they are not listed.
    assert not {"Chin", "Mouth_Down"} & set(chosen.labels)
    assert 0.98 < chosen.share.sum() < 1.0
    assert chosen.weights.max() == 1.0 and (chosen.weights > 0).all()
    assert len(chosen.weights) == len(chosen.skin_std) == len(chosen.share) == len(chosen.labels)


def test_a_whole_body_take_is_no_face():
    take = read_capture(real_data("captures", "pycgm_movement_trial.c3d"))
    chosen = automatic_rigid(take)
    assert chosen.model is None and (chosen.weights == 1.0).all() and np.isnan(chosen.skin_std).all()
    assert all(take.quantities[c] == "position" for c in chosen.columns)
    assert any("more than a head" in text for text in chosen.warnings)
