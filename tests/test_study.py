"""The study engine: what is measured does not depend on how it was run, and nothing that fails is lost."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import small_study

from evalkit.errors import EvalkitError
from evalkit.study import runner
from evalkit.study.command import run_studies
from evalkit.study.description import Budget, Expected
from evalkit.study.runner import run
from evalkit.study.statistics import efficiency, root_mean_square, with_interval
from evalkit.study.table import printed, read_summary, verdicts

HERE = Path(__file__).resolve().parent
STUDY = small_study.study
SAME = ("small.csv", "small-summary.csv")
"""Files that are the same in every run."""


def texts(folder):
    return [(folder / name).read_text() for name in SAME]


@pytest.fixture(scope="module")
def serial(tmp_path_factory):
    folder = tmp_path_factory.mktemp("serial")
    return folder, run(STUDY, folder, jobs=1)


@pytest.fixture
def importable(monkeypatch):
    """Worker processes find the small study by its name."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])]))


def test_every_cell_and_method_is_a_row(serial):
    _, table = serial
    assert len(table.rows) == len(table.machine) == 2 * 2 * 5 * 2
    keys = [(row["size"], row["place"], row["seed"], row["method"]) for row in table.rows]
    assert len(set(keys)) == len(keys)
    assert keys == sorted(keys, key=lambda k: (k[0], k[1], k[2], STUDY.methods.index(k[3])))
    assert not table.failed
    assert all(row["seconds"] >= 0 for row in table.machine)


def test_the_statistics_are_those_of_a_plain_calculation(serial):
    folder, table = serial
    frame = pd.read_csv(folder / "small.csv")
    found = {(r["size"], r["place"], r["method"], r["statistic"]): r for r in table.summary}
    for (size, place), group in frame.groupby(["size", "place"]):
        error = {m: g.sort_values("seed")["error"].to_numpy() for m, g in group.groupby("method")}
        rms = {m: np.sqrt((e**2).mean()) for m, e in error.items()}
        for method in STUDY.methods:
            row = found[size, place, method, "error"]
            assert row["value"] == pytest.approx(rms[method], rel=1e-12)
            assert row["low"] <= row["value"] <= row["high"]
            assert (row["seeds"], row["failed"]) == (5, 0)
            eff = found[size, place, method, "efficiency"]["value"]
            assert eff == pytest.approx(1 / size / (error[method] ** 2).mean(), rel=1e-12)
        assert found[size, place, "mean", "over first"]["value"] == pytest.approx(rms["mean"] / rms["first"], rel=1e-12)
        assert found[size, place, "first", "over first"]["value"] == 1.0


def test_the_interval_covers_the_truth_as_often_as_it_says():
    """500 repetitions of 30 seeds: 95 % within 3 standard errors (1 % each), less some for a percentile interval."""
    random = np.random.default_rng(1)
    statistic = root_mean_square("x", "x", "")
    inside = 0
    for _ in range(500):
        _, low, high, _ = with_interval(statistic, random.standard_normal((30, 1)))
        inside += low <= 1.0 <= high
    assert 0.87 < inside / 500 < 0.98
    # Control: the interval of something else does not.
    assert with_interval(statistic, 2.0 * random.standard_normal((30, 1)))[1] > 1.0


def test_one_seed_has_no_interval():
    value, low, high, error = with_interval(efficiency("a", "b"), np.array([[2.0, 1.0]]))
    assert value == 0.25
    assert np.isnan([low, high, error]).all()
    assert np.isnan(with_interval(efficiency("a", "b"), np.empty((0, 2)))).all()


def test_two_processes_give_the_same_bits(serial, tmp_path, importable):
    table = run(STUDY, tmp_path, jobs=2)
    assert texts(tmp_path) == texts(serial[0])
    assert len({row["process"] for row in table.machine}) == 2
    # Control: another seed's numbers are not these.
    other = replace(STUDY, prepare=lambda seed, **axes: small_study.prepare(seed + 1, **axes))
    assert [r["error"] for r in run(other, jobs=1).rows] != [r["error"] for r in serial[1].rows]


def test_reading_a_table_gives_back_every_bit(serial):
    folder, table = serial
    with (folder / "small.csv").open(newline="") as file:
        assert [float(row["error"]) for row in csv.DictReader(file)] == [row["error"] for row in table.rows]
    again = read_summary(folder / "small-summary.csv")
    assert [row["value"] for row in again] == [row["value"] for row in table.summary]


def test_a_killed_run_goes_on_and_ends_with_the_same_table(serial, tmp_path, importable):
    """SIGKILL once a few cells are done; the second run measures only the rest."""
    journal = tmp_path / "small.journal.jsonl"
    slow = {**os.environ, "SMALL_STUDY_SLEEP": "0.05"}
    process = subprocess.Popen(
        [sys.executable, str(HERE / "small_study.py"), str(tmp_path), "1"], env=slow, start_new_session=True
    )
    deadline = time.monotonic() + 60
    while not (journal.exists() and journal.read_text().count("\n") > 4):
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert not (tmp_path / "small.csv").exists()
    with journal.open("a") as file:
        file.write('{"cell": "small|cut o')  # what a crash in the middle of a line leaves
    # The interrupted run's study was __main__'s; only the file's content may count.
    said = []
    table = run(STUDY, tmp_path, jobs=1, tell=said.append)
    before = table.provenance["cells_done_before"]
    assert 4 <= before < table.provenance["cells"]
    assert said == [f"small: {before} of 20 cells were done before"]
    assert texts(tmp_path) == texts(serial[0])
    processes = [row["process"] for row in table.machine]
    assert processes.count(process.pid) == 2 * before


def test_a_finished_run_has_nothing_to_do_and_a_larger_one_adds_to_it(tmp_path):
    small = run(STUDY, tmp_path, "small", jobs=1)
    assert len(small.rows) == 2 * 2 * 2
    broken = replace(STUDY, run=lambda data, method: 1 / 0)
    again = run(broken, tmp_path, "small", jobs=1)
    assert again.rows == small.rows  # nothing was measured: it would have failed
    full = run(STUDY, tmp_path, "full", jobs=1)
    assert full.provenance["cells_done_before"] == 4
    assert full.rows == run(STUDY, jobs=1).rows
    fresh = run(broken, tmp_path, "small", jobs=1, fresh=True)
    assert all(row["status"] == "failed" for row in fresh.rows)
    assert (tmp_path / "small.journal.jsonl.previous").exists()


def test_cells_of_other_code_are_not_mixed_in(tmp_path, monkeypatch):
    run(STUDY, tmp_path, "small", jobs=1)
    monkeypatch.setattr("evalkit.study.provenance.source_digest", lambda: "another version")
    said = []
    table = run(STUDY, tmp_path, "small", jobs=1, tell=said.append)
    assert table.provenance["cells_done_before"] == 0
    assert said == ["small: code, packages or data changed since the last run; all cells are measured anew"]


def test_a_new_method_is_measured_beside_the_old(tmp_path):
    run(STUDY, tmp_path, Budget(seeds=1, methods=("first",)), jobs=1)
    table = run(STUDY, tmp_path, Budget(seeds=1), jobs=1)
    assert table.rows == run(STUDY, budget=Budget(seeds=1), jobs=1).rows


def test_failures_are_rows_with_their_reason(tmp_path):
    failing = replace(
        STUDY, methods=("mean", "refuses", "breaks"), axes={"size": (10,), "place": ("here", "nowhere")}
    )  # fmt: skip
    table = run(failing, tmp_path, Budget(seeds=2), jobs=1)
    assert len(table.rows) == 2 * 2 * 3
    messages = {(row["place"], row["method"]): row["message"] for row in table.rows}
    assert messages["here", "mean"] == ""
    assert messages["here", "refuses"] == "refuses to answer"
    assert messages["here", "breaks"].startswith("IndexError: list index out of range (small_study.py, line ")
    assert messages["nowhere", "mean"] == "no data: nowhere has no data"
    failed = {(row["place"], row["method"]): (row["seeds"], row["failed"]) for row in table.summary}
    assert failed["here", "mean"] == (2, 0)
    assert failed["here", "breaks"] == failed["nowhere", "mean"] == (0, 2)
    assert pd.read_csv(tmp_path / "small.csv")["status"].value_counts()["failed"] == 10
    assert "breaks (2 failed)" in printed(table.study, table.summary)


def test_a_study_without_any_answer_is_written_and_then_an_error(tmp_path, capsys):
    failing = replace(STUDY, methods=("refuses", "first"))
    rest = ("small", 1, (), "refuses", 1, None, False, False)
    with pytest.raises(EvalkitError, match=r"no method gave an answer in small \(refuses to answer\)"):
        run_studies([failing], tmp_path, *rest)
    assert "refuses to answer" in (tmp_path / "small.csv").read_text(encoding="utf-8")
    # Control: one that answers is enough.
    run_studies([replace(failing, methods=("first",))], tmp_path, "small", 1, (), None, 1, None, False, False)
    assert "first" in capsys.readouterr().out


def test_a_score_that_does_not_fit_its_columns_is_a_failure():
    wrong = replace(STUDY, score=lambda data, result: {"error": 1.0, "surplus": 2.0})
    row = run(wrong, budget="small", jobs=1).rows[0]
    assert row["status"] == "failed"
    assert row["message"] == "the study's score and its columns differ in bound, process, surplus, word"


def test_a_worker_that_dies_costs_nothing(serial, tmp_path, importable, monkeypatch):
    token = tmp_path / "token"
    token.touch()
    monkeypatch.setenv("SMALL_STUDY_TOKEN", str(token))
    said = []
    _fresh_workers()
    table = run(STUDY, tmp_path / "out", jobs=2, tell=said.append)
    assert not token.exists()
    assert said == ["small: a worker process died; its cells are measured again"]
    assert texts(tmp_path / "out") == texts(serial[0])
    assert not table.failed


def test_a_method_that_kills_its_worker_is_a_failed_row(tmp_path, importable):
    deadly = replace(STUDY, methods=("mean", "dies"), applies=lambda where, m: m == "mean" or where["size"] == 10)
    table = run(deadly, tmp_path, Budget(seeds=1, axes={"place": ("here",)}), jobs=2)
    assert {(row["size"], row["method"]): row["status"] for row in table.rows} == {
        (10, "mean"): "failed",  # its data went down with the process
        (10, "dies"): "failed",
        (90, "mean"): "ok",
    }


def _fresh_workers():
    """Processes that are started from now on: they see the environment as it is."""
    from joblib.externals.loky import get_reusable_executor

    get_reusable_executor().shutdown(wait=True)


@pytest.fixture
def cluster(tmp_path, monkeypatch, importable):
    """A dask scheduler and two worker processes of their own, one cell at a time each."""
    monkeypatch.setenv("SMALL_STUDY_SLEEP", "0.03")
    processes = []

    def start(*arguments):
        command = [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]]
        with (tmp_path / f"{len(processes)}.log").open("w") as log:
            processes.append(subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, cwd=tmp_path))
        return processes[-1]

    file = tmp_path / "scheduler.json"
    start("dask_scheduler", "--port", "0", "--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", str(file))
    workers = [
        start("dask_worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-nanny", "--no-dashboard",
              "--local-directory", str(tmp_path))
        for _ in range(2)
    ]  # fmt: skip
    try:
        yield _address(file), workers
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _address(file):
    """Where the scheduler listens, once both workers have come."""
    from distributed import Client

    deadline = time.monotonic() + 60
    while not file.exists() or not file.read_text():
        assert time.monotonic() < deadline
        time.sleep(0.05)
    address = json.loads(file.read_text())["address"]
    with Client(address, timeout="60s", set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
    return address


@pytest.mark.filterwarnings("ignore:.*:DeprecationWarning")
def test_a_cluster_of_two_gives_the_serial_bits_though_a_worker_is_killed(serial, tmp_path, cluster, monkeypatch):
    address, workers = cluster
    seen = []

    with_progress = runner._with_progress

    def killing(work, *rest):
        for item in with_progress(work, *rest):
            seen.append(item)
            if len(seen) == 5:
                workers[0].kill()
            yield item

    monkeypatch.setattr(runner, "_with_progress", killing)
    table = run(STUDY, tmp_path / "out", scheduler=address)
    assert workers[0].wait(timeout=30) == -signal.SIGKILL
    assert workers[1].poll() is None
    assert texts(tmp_path / "out") == texts(serial[0])
    assert {row["process"] for row in table.machine} <= {worker.pid for worker in workers}
    assert len({row["process"] for row in table.machine}) == 2


def test_no_cluster_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "ANSWER_S", 0.5)
    with pytest.raises(EvalkitError, match=r"^tcp://127.0.0.1:9: no dask scheduler answers there; start one"):
        run(STUDY, tmp_path, "small", scheduler="tcp://127.0.0.1:9")


def test_provenance_tells_where_the_numbers_come_from(serial):
    folder, _ = serial
    facts = json.loads((folder / "small.json").read_text())
    assert facts["seeds"] == [0, 1, 2, 3, 4]
    assert facts["axes"] == {"size": [10, 90], "place": ["here", "there"]}
    assert facts["packages"]["numpy"] == np.__version__
    assert len(facts["evalkit"]["source_sha256"]) == 64
    assert facts["rows"] == 40 and facts["failed"] == 0 and facts["wall_s"] > 0
    assert {"commit", "dirty", "version"} <= facts["evalkit"].keys()
    assert facts["cpu"] and facts["blas"]


def test_expectations_are_judged():
    expected = (
        Expected("error", "mean", 0.5, where={"size": 90}),
        Expected("over first", "mean", 0.01, where={"size": 90, "place": "here"}),
        Expected("efficiency", "mean", 0.2, least=True, where={"size": 10, "place": "here"}),
    )
    table = run(replace(STUDY, expected=expected), jobs=1)
    assert [met for _, met in verdicts(table.study, table.summary)] == [True, True, False, True]


@pytest.mark.parametrize(
    ("budget", "message"),
    [
        ("huge", "budget 'huge' is not known; use small or full"),
        (Budget(seeds=0), "study small: 0 seeds; at least one is needed"),
        (Budget(seeds=1, axes={"colour": (1,)}), "study small has no axis 'colour'; its axes are size, place"),
        (Budget(seeds=1, methods=("median",)), "study small has no method 'median'; it has mean, first"),
    ],
)
def test_budgets_that_do_not_fit_are_refused(budget, message):
    with pytest.raises(EvalkitError) as error:
        run(STUDY, budget=budget)
    assert str(error.value) == message


def test_descriptions_that_contradict_themselves_are_refused():
    with pytest.raises(EvalkitError, match="'seed' names two columns"):
        replace(STUDY, columns={**STUDY.columns, "seed": "x"})
    with pytest.raises(EvalkitError, match="statistic 'error' needs the column 'error'"):
        replace(STUDY, columns={"bound": "", "word": ""})
    with pytest.raises(EvalkitError, match="neither a number nor a text"):
        replace(STUDY, axes={"size": (None,)})


def test_a_folder_that_cannot_be_written_is_refused_before_any_work(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(EvalkitError, match="is a file, not a folder"):
        run(replace(STUDY, prepare=None), tmp_path / "file", jobs=1)
