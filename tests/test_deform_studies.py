"""The studies of deformation on tiny cuts: every method answers, truth scores zero, what must matter does."""

from __future__ import annotations

import importlib
import math

import numpy as np
import pytest
from realdata import real_data

from evalkit.deform import Deformer
from evalkit.errors import EvalkitError
from evalkit.studies import dense_takes, studies
from evalkit.study.description import Budget
from evalkit.study.runner import run

HEAD = "template 2000"

CUTS = {
    "rbf-kernels": Budget(1, {"head": (HEAD,), "noise_mm": (0.0,)}),
    "regions": Budget(1, {"head": (HEAD,), "kernel": ("exponential",)}),
    "static-points": Budget(1, {"head": (HEAD,), "static": (0, 20)}, ("exponential",)),
    "marker-count": Budget(1, {"head": (HEAD,), "markers": (8, 23, 48)}, ("exponential",)),
    "kernel-scale": Budget(1, {"head": (HEAD,), "scale": (0.5, 4.0)}, ("exponential", "gaussian")),
    "units": Budget(1, {"head": (HEAD,)}),
}
"""The cheapest cut of each study that has everything its figures need."""


@pytest.fixture(scope="module", autouse=True)
def short_takes():
    """Performances of three seconds instead of ten."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dense_takes, "FRAMES", 90)
        yield


@pytest.fixture(scope="module")
def tables(short_takes):
    return {name: run(studies[name], budget=cut, jobs=1) for name, cut in CUTS.items()}


@pytest.fixture(scope="module")
def take(short_takes):
    return dense_takes.dense_take(HEAD, 0)


def value(table, method, figure, **where):
    (found,) = (
        row["value"]
        for row in table.summary
        if (row["method"], row["statistic"]) == (method, figure) and all(row[axis] == at for axis, at in where.items())
    )
    return found


@pytest.mark.parametrize("name", CUTS)
def test_every_method_answers_with_finite_figures(tables, name):
    table = tables[name]
    assert not table.failed
    assert {row["method"] for row in table.rows} == set(table.study.methods)
    for row in table.summary:
        assert math.isfinite(row["value"]) and row["seeds"] == 1, row


@pytest.mark.parametrize("name", CUTS)
def test_question_and_finding_are_told_and_small_budgets_are_cuts(name):
    study = studies[name]
    assert study.question.endswith("?") and len(study.finding) > 100 and "seeds" in study.finding
    assert len(study.at("small").cells()) <= 6
    for limit in study.expected:
        assert limit.method in study.methods
        assert limit.statistic in {statistic.name for statistic in study.statistics}


def test_truth_scores_zero_and_no_motion_the_size_of_the_motion(take):
    """A map that knew every vertex: markers on all of them, each moving its own."""
    head = take.face.head
    everywhere = dense_takes.dense_take(HEAD, 0, markers={str(v): v for v in range(len(head.vertices))})
    found = dense_takes.score_map(everywhere, (np.eye(len(head.vertices)), 1.0))
    # The truth is kept in single precision: 1e-5 mm at 200 mm.
    assert found.pop("condition") == 1.0
    assert all(number is None or number < 2e-5 for number in found.values()), found
    still = dense_takes.score_map(take, dense_takes.build_map(take, dense_takes.STILL))
    seen = np.intersect1d(np.flatnonzero(take.moving), head.skin_vertices)
    moved = np.linalg.norm(take.truth - head.vertices, axis=2)[:, seen]
    assert still["all_mm"] == pytest.approx(np.sqrt((moved**2).mean()), rel=1e-5)
    assert still["worst_mm"] == pytest.approx(moved.max(), rel=1e-5)
    assert still["rim_mm"] < 0.1 < still["lips_mm"]


def test_control_wrong_maps_are_noticed(take):
    weights, condition = dense_takes.build_map(take, "exponential")
    right = dense_takes.score_map(take, (weights, condition))
    # Every marker taken for the next one of the list.
    wrong = dense_takes.score_map(take, (np.roll(weights, 1, axis=1), condition))
    assert wrong["all_mm"] > 1.2 * right["all_mm"] and wrong["lips_mm"] > 2.0 * right["lips_mm"]
    # Everything moves the other way, twice as far: the lower lip goes up through the upper one.
    back = dense_takes.score_map(take, (-2.0 * weights, condition))
    assert back["all_mm"] > 2.0 * right["all_mm"] and back["penetration_mm"] > 1.0 and back["inverted"] > 1.0


def test_markers_that_are_driven_arrive(take):
    """At its own vertex an interpolant gives what the marker did, in the face's field."""
    weights, _ = dense_takes.build_map(take, "exponential", regions=False)
    which = list(take.markers.values())
    moved = Deformer(weights)(take.displacement)[:, which]
    np.testing.assert_allclose(moved, take.displacement, atol=1e-6)


def test_regions_matter_on_the_lips(tables):
    table = tables["rbf-kernels"]
    for kernel in ("exponential", "thin-plate", "biharmonic"):
        assert value(table, kernel, "lips") < 0.9 * value(table, f"{kernel} alone", "lips")
    for method in table.study.methods:
        if method != dense_takes.STILL:
            assert value(table, method, "lips") < 0.7 * value(table, dense_takes.STILL, "lips"), method


def test_a_hard_seam_jumps_and_a_ramp_does_not(tables):
    table = tables["regions"]
    jump = {seam: value(table, seam, "jump at the corners") for seam in table.study.methods}
    assert jump["ramp"] < 0.05 < jump["hard"]


def test_static_centres_hold_the_rim(tables):
    table = tables["static-points"]
    loose, held = (value(table, "exponential", "drift of the rim", static=count) for count in (0, 20))
    assert held < 0.5 * loose


def test_more_markers_are_the_paper_s_and_then_others(take):
    sites = dense_takes.paper_markers(take.face)
    few, all_, many = (dense_takes.more_markers(take.face, count) for count in (8, 23, 48))
    assert set(few) < set(sites) and dict(all_) == {name: sites[name] for name in all_} and set(all_) == set(sites)
    assert list(many)[:23] == list(all_) and len(set(many.values())) == 48
    assert {"UpperLipC", "LowerLipC", "MouthL", "MouthR"} <= set(few)


def test_more_markers_help(tables):
    table = tables["marker-count"]
    errors = [value(table, "exponential", "all moving", markers=count) for count in (8, 23, 48)]
    assert errors[0] > errors[1] > errors[2]


def test_a_long_kernel_is_badly_conditioned(tables):
    table = tables["kernel-scale"]
    for method in table.study.methods:
        short, long = (value(table, method, "condition number", scale=scale) for scale in (0.5, 4.0))
        assert long > 3.0 * short


def test_the_unit_does_not_matter_unless_a_length_is_taken_literally(tables):
    table = tables["units"]
    module = importlib.import_module("evalkit.studies.units")
    for unit in module.PER_MM:
        # Rounding, times a condition number of some 1e2.
        assert value(table, module.DEFAULT, "difference from mm", model_unit=unit) < 1e-10
    literal = [value(table, module.LITERAL, "difference from mm", model_unit=unit) for unit in ("mm", "cm", "m")]
    # A length that is ten times too long turns the exponential into a straight line: that shows little, but shows.
    assert literal[0] < 0.01 and min(literal[1:]) > 0.05, literal
    figure = "condition of the paper's system"
    saddle = [value(table, module.LITERAL, figure, model_unit=unit) for unit in ("mm", "cm", "m")]
    assert saddle[2] > 10.0 * max(saddle[:2])


def test_heads_that_are_not_there_are_named(monkeypatch):
    monkeypatch.delenv("EVALKIT_REAL_DATA", raising=False)
    with pytest.raises(EvalkitError, match="EVALKIT_REAL_DATA"):
        dense_takes.dense_face("ict")
    with pytest.raises(EvalkitError, match="a number of vertices"):
        dense_takes.dense_face("template large")
    with pytest.raises(EvalkitError, match=r"nobody\.npz"):
        dense_takes.dense_face("nobody.npz")


def test_ict_is_a_head_of_the_studies(monkeypatch):
    monkeypatch.setenv("EVALKIT_REAL_DATA", str(real_data()))
    take = dense_takes.dense_take("ict", 0)
    right, still = (
        dense_takes.score_map(take, dense_takes.build_map(take, kernel))
        for kernel in ("exponential", dense_takes.STILL)
    )
    assert right["all_mm"] < 0.6 * still["all_mm"] and right["lips_mm"] < 0.6 * still["lips_mm"]
    assert right["inside_mm"] is None and right["penetration_mm"] is not None
