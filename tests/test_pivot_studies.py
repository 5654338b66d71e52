"""The studies of the pivot: finite figures on a small cut, methods ranked as they must be, controls that are seen."""

from __future__ import annotations

import importlib
import math
from dataclasses import replace

import numpy as np
import pytest

from evalkit.errors import EvalkitError
from evalkit.geometry import undo_motion
from evalkit.pivot import pivot_estimators
from evalkit.pose import pose_estimators
from evalkit.studies import studies, takes
from evalkit.study.cell import measure
from evalkit.study.description import Budget
from evalkit.study.runner import run
from evalkit.study.table import verdicts
from evalkit.synthetic import synthesize

# The package's attributes of these names are the studies themselves.
bold_driver, covariance_calibration, objective_terms, optimisers = (
    importlib.import_module(f"evalkit.studies.{name}")
    for name in ("bold_driver", "covariance_calibration", "objective_terms", "optimisers")
)

ROUNDING = 1e-9

CUTS = {
    "pivot-noise": Budget(2, {"noise_mm": (0.3,)}, ("joint none", "joint", "svd", "score")),
    "pivot-range-of-motion": Budget(1, {"range_deg": (5.0,)}, ("joint none", "sphere", "gamage-lasenby")),
    "pivot-sway": Budget(2, {"sway_mm": (20.0,)}, ("joint", "joint 1.25 s", "svd", takes.SMOOTHED)),
    "covariance-calibration": Budget(2, {"take": ("talking", "gaps 20 %")}, ("joint", "svd", takes.SMOOTHED)),
    "objective-terms": Budget(
        1, {"terms": ("all", "length alone")}, ("six-directions, mean", "six-directions, frame 0")
    ),
    "optimisers": Budget(
        1, {"terms": ("all",), "start_mm": (30.0,)}, ("six-directions", "nlopt-neldermead", "nlopt-lbfgs")
    ),
    "bold-driver": Budget(1, {"step_mm": (10.0,)}, ("rho 1.2, sigma 0.5", "rho 1.5, sigma 0.5")),
}
"""The cheapest cut of each study that has everything its figures need."""


@pytest.fixture(scope="module")
def tables():
    return {name: run(studies[name], budget=cut, jobs=1) for name, cut in CUTS.items()}


@pytest.mark.parametrize("name", CUTS)
def test_every_method_answers_with_finite_figures(tables, name):
    table = tables[name]
    assert not table.failed
    summary = table.summary + table.machine_summary
    assert {row["method"] for row in summary} == set(table.study.methods)
    for row in summary:
        # What may be missing: a search that never got near the minimum, a method that predicts no rotation error.
        if not math.isfinite(row["value"]):
            assert row["statistic"] in ("evaluations to the minimum", "rotation error over stated"), row
        else:
            assert row["seeds"] > 0


@pytest.mark.parametrize("name", CUTS)
def test_question_and_finding_are_told_in_the_files_own_words(name):
    study = studies[name]
    assert study.question.endswith("?") and len(study.finding) > 100
    # Whoever quotes a number says how it was measured.
    assert "seeds" in study.finding


def test_expectations_belong_to_statistics_and_methods_of_their_study():
    for name in CUTS:
        study = studies[name]
        for limit in study.expected:
            assert limit.method in study.methods
            assert limit.statistic in {statistic.name for statistic in study.statistics}
            assert all(value in study.axes[axis] for axis, value in limit.where.items())


def test_small_budgets_are_cuts_of_the_study():
    for name in CUTS:
        study = studies[name]
        cut = study.at("small")
        assert 1 <= cut.full.seeds <= study.full.seeds
        assert all(set(values) <= set(study.axes[axis]) for axis, values in cut.axes.items())
        assert len(cut.cells()) <= 20


def value_of(table, method, figure):
    (found,) = {row["value"] for row in table.summary if (row["method"], row["statistic"]) == (method, figure)}
    return found


def test_joint_beats_the_algebra_and_the_sway_model_the_free_poses(tables):
    # A tenth of the error of svd at rest in the full study; a third leaves room for two seeds.
    assert value_of(tables["pivot-noise"], "joint none", "pivot error") < (
        value_of(tables["pivot-noise"], "svd", "pivot error") / 3
    )
    sway = tables["pivot-sway"]
    assert value_of(sway, "joint", "pivot error") < value_of(sway, "svd", "pivot error") / 3
    # The lever arm halves the rotation error; smoothing takes more of it.
    assert value_of(sway, "joint", "rotation over per-frame") < 0.7
    assert value_of(sway, takes.SMOOTHED, "rotation over per-frame") < value_of(
        sway, "joint", "rotation over per-frame"
    )
    assert value_of(sway, "svd", "expression over per-frame") == 1.0


def test_predicted_rotation_errors_are_those_of_the_frames_that_were_seen(tables):
    rows = tables["covariance-calibration"].rows
    ratios = [row["rotation_deg"] / row["rotation_stated_deg"] for row in rows]
    # Within a tenth in the full study; frames bridged over a gap, if they were counted, would make it 5 to 20.
    assert len(ratios) == 2 * 2 * 3 and min(ratios) > 0.8 and max(ratios) < 1.25


def test_frame_zero_as_the_reference_is_worse_than_the_mean(tables):
    lengths = [row for row in tables["objective-terms"].rows if row["terms"] == "length alone"]
    error = {row["method"]: row["pivot_mm"] for row in lengths}
    assert error["six-directions, frame 0"] > error["six-directions, mean"]


def test_the_same_cell_gives_the_same_bits():
    cut = studies["pivot-sway"].at(CUTS["pivot-sway"])
    first, second = (measure(cut, cut.cells()[0])[0] for _ in range(2))
    assert first == second


def broken(points, pose, **options):
    """The joint estimate, put 50 mm to the side, with its covariance as it was."""
    found = pivot_estimators["joint"].function(points, pose, **options)
    return replace(found, position=found.position + np.array([50.0, 0.0, 0.0]))


def refusing(points, pose, **options):
    raise EvalkitError("this estimator has no answer")


def test_a_broken_estimator_is_seen_and_a_raising_one_is_a_failed_row(monkeypatch):
    """Controls: the studies judge what stands in the table, whatever its name."""
    right = pivot_estimators["joint"]
    table = {**pivot_estimators, "svd": replace(right, function=broken), "score": replace(right, function=refusing)}
    monkeypatch.setattr(takes, "pivot_estimators", table)
    cut = Budget(2, {"noise_mm": (0.3,)}, ("joint none", "joint", "svd", "score"))
    found = run(studies["pivot-noise"], budget=cut, jobs=1)
    assert value_of(found, "svd", "pivot error") == pytest.approx(50.0, abs=1.0)  # the right one is 0.2 mm off
    assert value_of(found, "svd", "efficiency") < 1e-3
    assert {(row["method"], row["message"]) for row in found.failed} == {("score", "this estimator has no answer")}
    assert all(met for words, met in verdicts(found.study, found.summary) if "over that" in words)

    cut = Budget(2, {"take": ("talking",)}, ("joint", "svd"))
    found = run(studies["covariance-calibration"], budget=cut, jobs=1)
    assert value_of(found, "svd", "inside 95 %, honest 0.95") == 0.0
    assert value_of(found, "svd", "normalised error², honest 1") > 100 * (
        value_of(found, "joint", "normalised error², honest 1")
    )


def test_a_drawn_error_lies_in_its_own_ellipsoid_as_often_as_it_should():
    """The score of covariance-calibration on errors drawn from the covariance that is stated, and from one twice it."""
    data = covariance_calibration.prepare(0, "talking")
    pivot, pose = takes.estimate_pivot(data, "joint")
    random = np.random.default_rng(0)
    axes, std = pivot.principal_axes, np.array([3.0, 2.0, 0.5])
    inside = {1.0: [], 2.0: []}
    for scale, found in inside.items():
        for error in random.standard_normal((400, 3)) * std * scale:
            drawn = replace(pivot, position=data.truth.pivot + error @ axes, principal_std=std)
            scored = covariance_calibration.score(data, (drawn, pose, float("nan")))
            found.append([scored["inside_50"], scored["inside_95"], scored["normalised"]])
    honest, bold = (np.mean(found, axis=0) for found in inside.values())
    # Three standard deviations of 400 draws: shares by the binomial, the mean of chi-square / 3 has sqrt(2 / 3).
    assert abs(honest[0] - 0.5) < 0.075 and abs(honest[1] - 0.95) < 0.033 and abs(honest[2] - 1.0) < 0.125
    assert bold[0] < 0.25 and bold[1] < 0.75 and bold[2] > 3.0  # control


def test_hidden_axes_do_not_count():
    data = covariance_calibration.prepare(0, "talking")
    pivot, pose = takes.estimate_pivot(data, "joint")
    std = np.array([np.inf, 2.0, 1.0])
    error = np.array([1e6, 2.0, 1.0]) @ pivot.principal_axes
    drawn = replace(pivot, position=data.truth.pivot + error, principal_std=std)
    scored = covariance_calibration.score(data, (drawn, pose, float("nan")))
    assert scored["axes"] == 2 and scored["normalised"] == pytest.approx(1.0) and scored["inside_95"] == 1
    silent = replace(drawn, principal_std=np.full(3, np.nan))
    scored = covariance_calibration.score(data, (silent, pose, float("nan")))
    assert scored["axes"] == 0 and scored["normalised"] is None and scored["inside_95"] is None


def test_a_search_is_measured_against_the_minimum_of_what_it_minimises():
    data = optimisers.search_from(0, "all", 30.0)
    assert np.linalg.norm(data.start - data.head.truth.pivot) == pytest.approx(30.0)
    plain, squared = data.minima
    # Each minimum is lower than the other by its own measure, or one of them is not the minimum.
    assert data.objective(plain, False) < data.objective(squared, False)
    assert data.objective(squared, True) < data.objective(plain, True)
    at_minimum = replace(optimisers.searched(data, "six-directions"), position=plain)
    scored = optimisers.score_search(data, at_minimum)
    assert scored["minimum_mm"] == 0 and scored["excess"] == 0 and scored["reached"] and not scored["astray"]
    away = replace(at_minimum, position=plain + np.array([0.0, 2000.0, 0.0]))
    scored = optimisers.score_search(data, away)
    assert scored["astray"] and not scored["reached"] and scored["excess"] > 0
    lost = replace(at_minimum, position=np.full(3, np.nan))
    assert optimisers.score_search(data, lost)["astray"]


def test_calls_are_counted_from_the_trace_of_rounds_and_of_calls():
    data = optimisers.search_from(1, "all", 30.0)
    for method in ("six-directions", "nlopt-neldermead"):
        found = optimisers.searched(data, method)
        calls = np.linspace(1, found.evaluations, len(found.trace))
        np.testing.assert_allclose(np.diff(calls), 6 if method == "six-directions" else 1, rtol=ROUNDING)


def test_drivers_reach_the_search():
    data = bold_driver.prepare(0, 10.0)
    one, other = (bold_driver.run(data, method) for method in ("rho 1, sigma 0.25", "rho 2, sigma 0.75"))
    # After the first step that was taken, a has grown by rho.
    assert set(one.trace[:2, 5]) == {10.0} and set(other.trace[:2, 5]) == {10.0, 20.0}


def test_references_reach_the_objective():
    data = objective_terms.prepare(0, "length alone")
    ends = [objective_terms.run(data, f"six-directions, {name}").position for name in objective_terms.REFERENCES]
    assert min(np.linalg.norm(a - b) for k, a in enumerate(ends) for b in ends[:k]) > 1e-3


def test_words_are_the_paragraphs_that_begin_with_them():
    doc = """One line.

    Question: what is
    asked: this?

    Finding: 3 mm.

    Command: none.
    """
    assert takes.told(doc) == ("what is asked: this?", "3 mm.")
    assert takes.told(None) == ("", "")


def test_expression_bound_is_what_a_known_pivot_leaves():
    """Monte Carlo: the turn from the rigid markers about a known pivot, applied to the others with noise of their own.

    600 frames of 20 markers share a turn per frame: about 1800 squares, 3.3 %; three of these for the variance.
    """
    take, truth = synthesize("talking", seed=3)
    columns = take.indices(truth.rigid)
    others = np.setdiff1d(np.arange(len(take.labels)), columns)
    shape = truth.neutral[columns] - truth.pivot
    # The pivot as a marker of a million times the weight.
    points = np.concatenate([take.points[:, columns], np.broadcast_to(truth.pivot, (take.frames, 1, 3))], axis=1)
    pose = pose_estimators["svd"](np.vstack([shape, np.zeros(3)]), points, np.r_[1.0, 1.0, 1.0, 1e6])
    undone = undo_motion(pose.rotations, pose.translations, take.points[:, others])
    error = undone - (truth.clean[:, others] - truth.pivot)
    measured = np.sqrt((error**2).sum(axis=2).mean())
    bound = takes.expression_bound(shape, truth.clean[:, others] - truth.pivot, 0.3)
    assert abs(measured**2 / bound**2 - 1) < 3 * 0.033
    assert abs(measured**2 / (1.1 * bound) ** 2 - 1) > 3 * 0.033  # control
