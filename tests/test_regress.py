"""The regression gate: it passes on what did not change and fails on methods made worse on purpose."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from evalkit.cli import app
from evalkit.errors import EvalkitError
from evalkit.geometry import rotation_from_vector, rotation_vector
from evalkit.head import fitting
from evalkit.pivot import pivot_estimators
from evalkit.pose import pose_estimators
from evalkit.studies import regression, takes
from evalkit.study.baselines import compare, read_baseline, report
from evalkit.study.description import Budget
from evalkit.study.runner import run

BASELINES = Path(__file__).resolve().parent / "baselines"
STUDY = regression.study
PART = {
    "rotation svd": "talking", "pivot joint": "talking", "pivot score": "talking", "expression forehead": "sway",
    "fit reprojection": "person", "fit landmarks across": "person",
}  # fmt: skip
"""Methods that the tests measure again, on one preset each: the whole takes a minute, by ``evalkit regress``."""


def baseline():
    return [row for row in read_baseline(BASELINES / "regression.csv") if PART.get(row["method"]) == row["preset"]]


def measured(*methods):
    part = replace(STUDY, applies=lambda condition, method: PART.get(method) == condition["preset"])
    presets = tuple(dict.fromkeys(PART[method] for method in methods))
    rows = run(part, budget=Budget(seeds=STUDY.full.seeds, axes={"preset": presets}, methods=methods), jobs=1).rows
    return {change.method: change for change in compare(STUDY, baseline(), rows) if change.method in methods}


def test_unchanged_methods_pass():
    found = measured(*PART)
    assert {change.verdict for change in found.values()} == {"same"}
    # The same code gives the same numbers, up to what processors and libraries round differently.
    assert max(abs(change.change) for change in found.values()) < 1e-3


def test_a_rotation_that_falls_short_by_six_percent_is_caught(monkeypatch):
    """A gain of 0.94: every rotation is measured too small."""
    whole = pose_estimators["svd"]

    def short(template, points, weights=None):
        pose = whole(template, points, weights)
        return replace(pose, rotations=rotation_from_vector(0.94 * rotation_vector(pose.rotations)))

    monkeypatch.setattr(regression, "pose_estimators", {**pose_estimators, "svd": replace(whole, function=short)})
    change = measured("rotation svd")["rotation svd"]
    assert change.verdict == "worse", change


def test_a_pivot_from_half_of_the_take_is_caught(monkeypatch):
    """An estimator that looks at the first half only."""
    whole = pivot_estimators["joint"]

    def half(points, pose, **options):
        cut = slice(0, len(points) // 2)
        part = replace(
            pose, rotations=pose.rotations[cut], translations=pose.translations[cut], status=pose.status[cut]
        )
        return whole(points[cut], part, **options)

    monkeypatch.setattr(takes, "pivot_estimators", {**pivot_estimators, "joint": replace(whole, function=half)})
    change = measured("pivot joint")["pivot joint"]
    assert change.verdict == "worse", change


def test_a_compensation_that_forgets_the_sway_is_caught(monkeypatch):
    monkeypatch.setitem(regression.COMPENSATIONS, "forehead", {"sway": "none"})
    change = measured("expression forehead")["expression forehead"]
    assert change.verdict == "worse", change


def rows(values, method="m"):
    return [{"preset": "p", "method": method, "seed": k, "error": v} for k, v in enumerate(values)]


BEFORE = np.array([1.0, 1.2, 0.8, 1.1, 0.9, 1.3, 0.7, 1.05])


@pytest.mark.parametrize(
    ("after", "verdict"),
    [
        (BEFORE, "same"),
        (BEFORE * 1.009, "same"),  # below the floor
        (BEFORE * 1.02, "worse"),  # every seed by the same 2 %: no luck of the draw
        (BEFORE * np.where(np.arange(8) % 2, 1.2, 1 / 1.2), "same"),  # reshuffled
        (np.where(np.arange(8) == 3, 50.0, BEFORE), "worse"),  # one seed went astray
        (BEFORE * 0.9, "better"),
        ([None, *BEFORE[1:]], "worse"),  # one seed has no answer any more
        ([None] * 8, "worse"),
    ],
)
def test_verdicts(after, verdict):
    (change,) = compare(STUDY, rows(BEFORE), rows(after))
    assert change.verdict == verdict, change


def test_errors_of_rounding_are_no_change():
    (change,) = compare(STUDY, rows([1e-13] * 8), rows([1e-9] * 8))
    assert change.verdict == "same"
    (change,) = compare(STUDY, rows([1e-13] * 8), rows([1e-3] * 8))
    assert change.verdict == "worse"


def test_false_alarms_are_rare_and_real_losses_are_seen():
    """All errors drawn anew, the worst that a harmless change can do: 5 % as stated, 2 standard errors more in 1000."""
    random = np.random.default_rng(3)
    alarms = losses = 0
    for _ in range(1000):
        a, b = np.abs(random.standard_normal((2, 12)))
        alarms += compare(STUDY, rows(a), rows(b))[0].verdict == "worse"
        losses += (
            compare(STUDY, rows(a), rows(a * 1.1 * np.exp(0.05 * random.standard_normal(12))))[0].verdict == "worse"
        )
    assert alarms <= 64
    assert losses >= 900


def test_a_warp_that_follows_the_points_loosely_is_caught(monkeypatch):
    monkeypatch.setattr("evalkit.head.photo_warp.RELAXATIONS", (0.3,))
    change = measured("fit reprojection")["fit reprojection"]
    assert change.verdict == "worse", change


def test_a_fit_that_moves_the_face_half_the_way_is_caught(monkeypatch):
    whole = fitting.carried

    def half(head, warp):
        return whole(head, lambda places: 0.5 * (places + warp(places)))

    monkeypatch.setattr(fitting, "carried", half)
    change = measured("fit landmarks across")["fit landmarks across"]
    assert change.verdict == "worse", change


def test_new_and_gone_methods_are_told():
    changes = compare(STUDY, rows(BEFORE, "old"), rows(BEFORE, "new"))
    assert {c.method: c.verdict for c in changes} == {"old": "gone", "new": "new"}
    assert report(changes).splitlines()[-1] == "1 new, 1 gone"


def test_the_baseline_holds_every_figure_of_the_study():
    kept = {(row["preset"], row["method"], row["seed"]) for row in read_baseline(BASELINES / "regression.csv")}
    due = {
        (condition["preset"], method, seed)
        for condition in STUDY.conditions(STUDY.axes)
        for method in STUDY.methods_of(condition)
        for seed in range(STUDY.full.seeds)
    }
    assert kept == due


def test_the_command_fails_updates_and_passes(tmp_path, monkeypatch):
    part = replace(STUDY, axes={"preset": ("talking",)}, methods=("rotation svd",), full=Budget(seeds=3))
    monkeypatch.setattr(regression, "study", part)

    def call(*arguments):
        return CliRunner().invoke(app, ["regress", "--baselines", str(tmp_path), "--jobs", "1", *arguments])

    missing = call()
    assert isinstance(missing.exception, EvalkitError)
    assert str(missing.exception).startswith(f"{tmp_path / 'regression.csv'}: no baseline there; run in a checkout")
    first = call("--update")
    assert first.exit_code == 0 and "1 new" in first.output
    assert call().output == "1 same\n"
    path = tmp_path / "regression.csv"
    lines = path.read_text().splitlines()
    better = [line.rpartition(",")[0] + f",{0.5 * float(line.rpartition(',')[2]):.9g}" for line in lines[1:]]
    path.write_text("\n".join([lines[0], *better]) + "\n")
    worse = call()
    assert isinstance(worse.exception, EvalkitError)
    assert "1 of 1 figures are worse than" in str(worse.exception)
    found = call("--json")
    assert json.loads(found.output)[0]["verdict"] == "worse"
    updated = call("--update")
    assert updated.exit_code == 0 and "->" in updated.output
    assert call().exit_code == 0


def test_a_damaged_baseline_is_one_line(tmp_path):
    path = tmp_path / "regression.csv"
    path.write_text("preset,method,seed,error\ntalking,rotation svd,x,1\n")
    with pytest.raises(EvalkitError, match=r"regression.csv, line 2: not a row of a baseline"):
        read_baseline(path)
