"""The calibration study: its figures from known errors, its interval, its files and its command line."""

from __future__ import annotations

import csv
import subprocess
import sys

import numpy as np
import pytest

from evalkit.studies import calibration as study
from evalkit.synthetic import synthesize


@pytest.fixture(scope="module")
def rows():
    """Two takes of three conditions, the first without and the others with all the figures of sway."""
    work = [("still", 0.3, 20.0, 0.0), ("sway", 0.3, 20.0, 0.0), ("sway", 0.3, 20.0, 20.0)]
    return [row for cell in work for seed in range(2) for row in study.measured((*cell, seed))]


def test_cells_are_the_whole_grid_once():
    work = study.cells(3)
    assert len(work) == len(set(work)) == 3 * (len(study.NOISES) * len(study.RANGES) + len(study.SWAYS))


def test_rows_are_the_same_bits_every_time(rows):
    again = study.measured(("sway", 0.3, 20.0, 20.0, 1))
    assert [row for row in rows if row["sway_mm"] == 20.0 and row["seed"] == 1] == again


def test_every_method_has_a_row_with_finite_errors(rows):
    for row in rows:
        assert np.isfinite([row["square_mm2"], row["bound_mm2"], row["normalised"]]).all()
        assert ("expression_mm" in row) == (row["experiment"] == "sway")
    assert {row["method"] for row in rows if row["experiment"] == "still"} == set(study.STILL_METHODS)
    assert {row["method"] for row in rows if row["experiment"] == "sway"} == set(study.SWAY_METHODS)
    assert "joint" in {name.split()[0] for name in study.STILL_METHODS}


def test_an_unknown_method_is_an_error_and_not_a_row():
    with pytest.raises(KeyError):
        study._estimated("no-such-method", *[None] * 4)


def made_up(errors, bounds, method="joint none"):
    return [
        {
            "experiment": "still", "noise_mm": 0.3, "range_deg": 20.0, "sway_mm": 0.0, "seed": seed, "method": method,
            "status": "ok", "sway_spacing_s": np.inf, "square_mm2": error**2, "bound_mm2": bound**2,
            "normalised": error**2 / bound**2, "stated": error**2 / bound**2,
        }
        for seed, (error, bound) in enumerate(zip(errors, bounds, strict=True))
    ]  # fmt: skip


def test_figures_from_made_up_errors():
    rows = made_up([3.0, 4.0], [1.0, 2.0]) + made_up([6.0, 8.0], [1.0, 2.0], "joint auto")
    found = {(row["method"], row["figure"]): row["value"] for row in study.summarised(rows)}
    # By hand: mean squares 12.5 and 2.5.
    expected = {
        "pivot error mm": np.sqrt(12.5),
        "bound mm": np.sqrt(2.5),
        "efficiency": 1 / np.mean([9.0, 4.0]),
        "efficiency of the trace": 0.2,
        "error over bound": np.sqrt(5.0),
        "error over stated": np.sqrt(6.5),
        "over no sway": 1.0,
    }
    for name, value in expected.items():
        assert found["joint none", name] == pytest.approx(value, rel=1e-12), name
    assert found["joint auto", "over no sway"] == pytest.approx(2.0)


def test_the_interval_covers_as_often_as_it_says(record_property):
    """300 samples of 50 squared normal errors, the figure a root mean square."""
    random = np.random.default_rng(0)
    inside = 0
    for _ in range(300):
        squares = random.standard_normal((50, 1)) ** 2
        value, low, high = study.interval(squares, lambda means: np.sqrt(means[..., 0]))
        assert low <= value <= high
        inside += low <= 1.0 <= high
    record_property("coverage", inside / 300)
    # A percentile interval of 50 skew values covers some 92 %; 300 draws know that to 1.6 %, three of these.
    assert 0.87 <= inside / 300 <= 0.98


def test_a_figure_that_does_not_vary_has_no_width():
    assert study.interval(np.full((9, 1), 4.0), lambda means: means[..., 0]) == (4.0, 4.0, 4.0)
    assert np.isnan(study.interval(np.empty((0, 1)), lambda means: means[..., 0])).all()


def test_verdicts_can_be_met_and_not_met():
    good = made_up([0.2, 0.3, 0.25], [0.3, 0.3, 0.3])
    bad = made_up([2.0, 3.0, 2.5], [0.3, 0.3, 0.3])
    for rows, met in ((good, True), (bad, False)):
        found = [verdict for words, verdict in study.verdicts(study.summarised(rows)) if "efficiency" in words]
        assert found == [met]


def test_every_expectation_belongs_to_a_figure_of_the_study():
    conditions = {(e, f"noise {n:g}, range {r:g}, sway {s:g}") for e, n, r, s, _ in study.cells(1)}
    for experiment, condition, method, figure, _ in study.REQUIRED:
        assert (experiment, condition) in conditions
        assert method in (study.STILL_METHODS if experiment == "still" else study.SWAY_METHODS)
        assert figure.endswith((" at least", " at most"))


def test_expression_bound_is_what_a_known_pivot_leaves():
    """Monte Carlo: the turn from the rigid markers about a known pivot, applied to the others with noise of their own.

    600 frames of 20 markers share a turn per frame: about 1800 squares, 3.3 %; three of these for the variance.
    """
    from evalkit.geometry import undo_motion
    from evalkit.pose import pose_estimators

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
    bound = study.expression_bound(shape, truth.clean[:, others] - truth.pivot, 0.3)
    assert abs(measured**2 / bound**2 - 1) < 3 * 0.033
    assert abs(measured**2 / (1.1 * bound) ** 2 - 1) > 3 * 0.033  # control


def test_tables_name_every_method_and_its_seeds(rows):
    text = study.printed(study.summarised(rows))
    for method in (*study.STILL_METHODS, *study.SWAY_METHODS):
        assert f"\n{method} " in text
    assert text.count("2 seeds") == len({(row["experiment"], row["sway_mm"], row["method"]) for row in rows})
    assert "nan" not in text


def test_files_and_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(study, "cells", lambda seeds: [("still", 0.3, 20.0, 0.0, seed) for seed in range(seeds)])
    code = study.main(["--seeds", "2", "--jobs", "1", "-o", str(tmp_path / "out")])
    shown = capsys.readouterr()
    assert code in (0, 1) and "expected" in shown.out and not shown.err
    with (tmp_path / "out" / "calibration.csv").open(encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    assert {row["method"] for row in table} == set(study.STILL_METHODS)
    assert all(row["seeds"] == "2" for row in table if row["figure"] == "pivot error mm")
    assert all(float(row["low"]) <= float(row["value"]) <= float(row["high"]) for row in table)
    with (tmp_path / "out" / "calibration-takes.csv").open(encoding="utf-8", newline="") as file:
        assert len(list(csv.DictReader(file))) == 2 * len(study.STILL_METHODS)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["calibration-takes.csv", "calibration.csv"]


@pytest.mark.parametrize("wrong", [["--seeds", "1"], ["--seeds", "many"], ["--jobs", "0"], ["--unheard-of"]])
def test_wrong_usage_is_refused(wrong, capsys):
    with pytest.raises(SystemExit) as refused:
        study.main(wrong)
    assert refused.value.code == 2
    assert "usage:" in capsys.readouterr().err


def test_an_output_that_cannot_be_written_is_refused_before_any_work(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(study, "run", lambda *_: pytest.fail("the work was done"))
    (tmp_path / "file").write_text("here already")
    assert study.main(["-o", str(tmp_path / "file")]) == 1
    shown = capsys.readouterr().err
    assert shown.startswith("error: ") and shown.count("\n") == 1


def test_help_has_an_example_and_loads_nothing_heavy():
    code = (
        "import sys\nfrom evalkit.studies import calibration\n"
        "try:\n    calibration.main(['--help'])\nexcept SystemExit:\n    pass\n"
        "print(sorted({name.split('.')[0] for name in sys.modules} & {'nlopt', 'scipy', 'pandas', 'vtk'}))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "Example: python -m evalkit.studies.calibration" in run.stdout
    assert run.stdout.endswith("[]\n")
