"""The commands as a user runs them: results on disk, exit codes, one line for every mistake."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import evalkit
from evalkit.bundled import bundled_take
from evalkit.deform.kernels import kernels
from evalkit.results import MOTION_COLUMNS
from evalkit.studies import studies
from evalkit.synthetic import PRESETS

ROOT = Path(__file__).parent.parent
RIGID = "ForeheadC,ForeheadL,ForeheadR"


def run(*arguments, **options):
    return subprocess.run(
        [sys.executable, "-m", "evalkit", *map(str, arguments)], capture_output=True, text=True, timeout=120, **options
    )


@pytest.fixture(scope="module")
def take_path():
    return bundled_take("gaps")[0]


@pytest.fixture(scope="module")
def done(tmp_path_factory, take_path):
    """One compensated take with some unusable frames, without report, and its summary."""
    out = tmp_path_factory.mktemp("compensate") / "new" / "out"
    truth = bundled_take("gaps")[1]
    ran = run("compensate", take_path, "-o", out, "--rigid", RIGID, "--no-report", "--truth", truth, "--json")
    assert ran.returncode == 0, ran.stderr
    return out, json.loads(ran.stdout)


def test_writes_the_files_and_nothing_else(done):
    out, _ = done
    assert sorted(p.name for p in out.iterdir()) == ["compensated.c3d", "motion.csv", "summary.json"]


def test_summary_on_disk_is_what_was_printed_and_strict_json(done):
    out, printed = done

    def refuse(name):
        raise AssertionError(f"{name} is no JSON number")

    assert json.loads((out / "summary.json").read_text(), parse_constant=refuse) == printed
    assert printed["pivot"]["status"] == "ok"
    assert set(printed["errors_against_truth"]) == {"rotation_rms_deg", "pivot_mm", "expression_rms_mm"}


def test_frames_without_pose_are_marked_and_the_take_goes_on(done, take_path):
    out, content = done
    motion = pd.read_csv(out / "motion.csv")
    assert tuple(motion.columns) == MOTION_COLUMNS
    take = evalkit.read_capture(take_path)
    seen = take.visible[:, take.indices(RIGID.split(","))].sum(axis=1)
    lost = seen < 3
    assert 0 < lost.sum() < len(lost)
    assert ((motion.status == "too-few-markers").to_numpy() == lost).all()
    assert motion.qw.isna().to_numpy()[lost].all() and motion.qw.notna().to_numpy()[~lost].all()
    assert content["frames"]["too-few-markers"] == lost.sum()
    assert np.isnan(evalkit.read_capture(out / "compensated.c3d").points[lost]).all()


def test_motion_table_undoes_the_take(done, take_path):
    """The written rotation and translation, read back by pandas and SciPy, give the written compensated take."""
    out, _ = done
    motion = pd.read_csv(out / "motion.csv")
    take, still = evalkit.read_capture(take_path), evalkit.read_capture(out / "compensated.c3d")
    ok = (motion.status == "ok").to_numpy()
    rotation = Rotation.from_quat(motion.loc[ok, ["qw", "qx", "qy", "qz"]].to_numpy(), scalar_first=True).as_matrix()
    moved = take.points[ok] - motion.loc[ok, ["tx_mm", "ty_mm", "tz_mm"]].to_numpy()[:, None, :]
    back = np.einsum("fji,fmj->fmi", rotation, moved)
    # Quaternions are written to 1e-9, T to 1e-4 mm, and C3D holds 24 bits of about 2 m.
    np.testing.assert_allclose(back, still.points[ok], atol=1e-3)


@pytest.mark.parametrize(
    ("text", "value"),
    [("-0.0000", -0.00001), ("12.3400", 12.34), ("-1.0000", -1.0), ("", np.nan), ("99999999.1250", 99999999.125)],
)
def test_fixed_decimals(text, value):
    from evalkit.results import _decimal, _joined

    expected = text.replace("-0.0000", "0.0000")
    assert _joined([_decimal(np.array([value]), 4)]).decode() == expected + "\n"


def test_fixed_decimals_agree_with_formatting():
    from evalkit.results import _decimal, _joined

    rng = np.random.default_rng(0)
    values = rng.normal(size=5000) * 10.0 ** rng.integers(-6, 9, 5000)
    for digits in (0, 4, 9):
        written = _joined([_decimal(values, digits)]).decode().splitlines()
        # Half a unit of the last digit, and a unit of the 53 bits that scaling by ten to the digits may cost.
        np.testing.assert_allclose(np.array(written, float), values, rtol=3e-16, atol=0.5000001 * 10.0**-digits)
    assert _joined([_decimal(np.array([1e30, 1.0]), 2)]).decode().split() == [
        "1000000000000000019884624838656.00",
        "1.00",
    ]


def bad_inputs(tmp_path, take_path):
    content = take_path.read_bytes()
    (tmp_path / "empty.c3d").write_bytes(b"")
    (tmp_path / "not.c3d").write_bytes(b"this is no capture\n" * 100)
    (tmp_path / "short.c3d").write_bytes(content[: len(content) - 60_000])
    (tmp_path / "file").write_text("in the way")
    take = evalkit.read_capture(take_path)
    rigid = take.indices(RIGID.split(","))
    line = take.points.copy()
    line[:, rigid] = line[:, rigid[:1]] + np.arange(3)[:, None] * np.array([20.0, 5.0, 0.0])
    evalkit.write_capture(evalkit.Capture(line, take.labels, take.rate), tmp_path / "line.c3d")
    gone = take.points.copy()
    gone[:, rigid] = np.nan
    evalkit.write_capture(evalkit.Capture(gone, take.labels, take.rate), tmp_path / "gone.c3d")
    out = tmp_path / "out"
    return {
        "missing file": (["absent.c3d", "-o", out], ["absent.c3d"]),
        "empty file": (["empty.c3d", "-o", out], ["empty.c3d", "empty"]),
        "not a C3D": (["not.c3d", "-o", out], ["not.c3d"]),
        "cut short": (["short.c3d", "-o", out], ["short.c3d", "600"]),
        "unknown label": ([take_path, "-o", out, "--rigid", "ForeheadC,ForeheadL,ForheadR"], ["ForheadR", "ForeheadR"]),
        "two markers": ([take_path, "-o", out, "--rigid", "ForeheadC,ForeheadL"], ["ForeheadC", "three"]),
        "collinear": (["line.c3d", "-o", out, "--rigid", RIGID], ["line.c3d", "one line"]),
        "all missing": (["gone.c3d", "-o", out, "--rigid", RIGID], ["gone.c3d", "missing in every frame"]),
        "folder is a file": ([take_path, "-o", tmp_path / "file" / "out"], ["file", "folder"]),
        "unknown pose": ([take_path, "-o", out, "--pose", "svdd"], ["svdd", "svd"]),
        "unknown pivot": ([take_path, "-o", out, "--pivot", "scor"], ["scor", "score"]),
        "bad sway": ([take_path, "-o", out, "--sway", "much"], ["much", "seconds"]),
        "bad reference": ([take_path, "-o", out, "--reference", "9999"], ["9999", "599"]),
        "wrong truth": ([take_path, "-o", out, "--truth", take_path], ["gaps.c3d"]),
        "four for three": (
            [take_path, "-o", out, "--rigid", f"{RIGID},NoseBridge", "--pose", "translation-invariants"], ["exactly 3"],
        ),
    }  # fmt: skip


CASES = (
    "missing file", "empty file", "not a C3D", "cut short", "unknown label", "two markers", "collinear", "all missing",
    "folder is a file", "unknown pose", "unknown pivot", "bad sway", "bad reference", "wrong truth", "four for three",
)  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_bad_input_is_one_line_exit_1_and_nothing_written(case, tmp_path, take_path):
    arguments, words = bad_inputs(tmp_path, take_path)[case]
    before = sorted(tmp_path.rglob("*"))
    ran = run("compensate", *arguments, cwd=tmp_path)
    assert ran.returncode == 1, (ran.stdout, ran.stderr)
    assert ran.stderr.count("\n") == 1 and ran.stderr.startswith("evalkit: "), ran.stderr
    assert ran.stdout == ""
    assert not [word for word in words if word not in ran.stderr], ran.stderr
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_folder_without_permission(tmp_path, take_path):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o555)
    ran = run("compensate", take_path, "-o", locked / "out")
    assert ran.returncode == 1 and ran.stderr.count("\n") == 1 and "permission" in ran.stderr


def test_a_failed_report_leaves_nothing(tmp_path, take_path, monkeypatch):
    """Files are staged: a fault after the first of them was written leaves no folder behind."""
    from evalkit import results

    with pytest.raises(RuntimeError), results.staged(tmp_path / "a" / "b") as stage:
        (stage / "first").write_text("half")
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []
    with results.staged(tmp_path / "a" / "b") as stage:  # control: without the fault it does arrive
        (stage / "first").write_text("whole")
    assert [p.name for p in (tmp_path / "a" / "b").iterdir()] == ["first"]


def test_the_input_is_never_overwritten(tmp_path, take_path):
    source = tmp_path / "compensated.c3d"
    source.write_bytes(take_path.read_bytes())
    ran = run("compensate", source, "-o", tmp_path, "--no-report")
    assert ran.returncode == 1 and "own input" in ran.stderr
    assert source.read_bytes() == take_path.read_bytes()


def test_paper_method(tmp_path, take_path):
    ran = run(
        "compensate", bundled_take("talking")[0], "-o", tmp_path / "p", "--paper", "--rigid", RIGID, "--no-report"
    )
    assert ran.returncode == 0, ran.stderr
    content = json.loads((tmp_path / "p" / "summary.json").read_text())
    assert content["method"]["pivot"] == "six-directions" and content["method"]["reference"] == 0
    assert 1 <= len(content["outer_iterations"]) <= 2
    trace = pd.read_csv(tmp_path / "p" / "trace.csv")
    assert (np.diff(trace.objective) <= 0).all()


@pytest.mark.parametrize("arguments", [["compensate"], ["nothing"], ["synth"], ["compensate", "x.c3d", "--wrong"]])
def test_wrong_usage_is_exit_2(arguments):
    ran = run(*arguments)
    assert ran.returncode == 2 and ran.stderr


@pytest.mark.parametrize("verb", ["demo", "compensate", "synth", "methods"])
def test_help_has_an_example(verb):
    ran = run(verb, "--help")
    assert ran.returncode == 0 and "Example" in ran.stdout and f"evalkit {verb}" in ran.stdout


def test_methods_lists_every_entry():
    rows = json.loads(run("methods", "--json").stdout)
    named: dict[str, set[str]] = {}
    for row in rows:
        named.setdefault(row["kind"], set()).add(row["name"])
    assert named["pose"] == set(evalkit.pose_estimators) and named["pivot"] == set(evalkit.pivot_estimators)
    assert named["kernel"] == set(kernels)
    assert named["preset"] == set(PRESETS) and named["study"] == set(studies)
    assert all(row["summary"] for row in rows)
    assert all(row["source"] for row in rows if row["kind"] in ("pose", "pivot", "kernel"))
    # What comes from another package says which.
    assert all(row["origin"] for row in rows if row["name"].startswith("peer-"))


def test_synth_writes_take_and_truth(tmp_path):
    ran = run("synth", "clean", "-o", tmp_path, "--seed", 3, "--set", "frames=120", "--set", "noise=0.2")
    assert ran.returncode == 0, ran.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["clean.c3d", "clean.json", "clean.truth.npz"]
    take, _truth = evalkit.synthesize("clean", seed=3, frames=120, noise=0.2)
    np.testing.assert_allclose(evalkit.read_capture(tmp_path / "clean.c3d").points, take.points, atol=1e-3)
    ran = run("synth", "claen", "-o", tmp_path)
    assert ran.returncode == 1 and "clean" in ran.stderr and ran.stderr.count("\n") == 1


def test_smoothing_and_leak_reach_the_summary(tmp_path):
    take_path, truth = bundled_take("talking")
    arguments = ["compensate", take_path, "--rigid", RIGID, "--truth", truth]
    plain = run(*arguments, "-o", tmp_path / "plain", "--no-report")
    smooth = run(*arguments, "-o", tmp_path / "smooth", "--smooth")
    assert plain.returncode == smooth.returncode == 0, plain.stderr + smooth.stderr
    before, after = (json.loads((tmp_path / way / "summary.json").read_text()) for way in ("plain", "smooth"))
    assert before["method"]["smoothing"] is None and before["expression_leak"] is None
    assert after["method"]["smoothing"]["effective_freedom"] > 0
    # The head of this take moves slowly beside its noise: smoothing has to help, and by a lot.
    errors = [content["errors_against_truth"]["rotation_rms_deg"] for content in (before, after)]
    assert errors[1] < 0.6 * errors[0]
    leak = after["expression_leak"]
    assert leak["status"] == "ok" and leak["p_value"] > 0.05  # the forehead of this take does not slide
    assert sorted(p.name for p in (tmp_path / "smooth").iterdir())[-2:] == ["report.html", "summary.json"]


@pytest.mark.parametrize("extra", [["--smooth"], ["--pose", "svd"], ["--pivot", "joint"], ["--sway", "auto"]])
def test_the_published_method_refuses_what_it_would_ignore(extra, tmp_path, take_path):
    ran = run("compensate", take_path, "-o", tmp_path / "out", "--paper", *extra)
    assert ran.returncode == 2 and extra[0] in ran.stderr and not (tmp_path / "out").exists()


def test_the_published_method_takes_the_reference_that_is_asked_for(tmp_path):
    arguments = [
        bundled_take("talking")[0],
        "--paper",
        "--reference",
        "mean",
        "--rigid",
        RIGID,
        "--no-report",
        "--json",
    ]
    ran = run("compensate", *arguments, "-o", tmp_path / "out")
    assert ran.returncode == 0 and json.loads(ran.stdout)["method"]["reference"] == "mean", ran.stderr


@pytest.mark.timing
@pytest.mark.slow
def test_60000_frames_take_half_the_time_of_ezc3d(tmp_path):
    """Reading, SVD poses and pivot, and every file written, as one process, beside bare reading and writing."""
    import time

    import ezc3d

    evalkit.write_capture(evalkit.synthesize("talking", frames=60_000)[0], tmp_path / "take.c3d")
    ratios = []
    for _ in range(5):
        start = time.perf_counter()
        ran = run(
            "compensate", tmp_path / "take.c3d", "-o", tmp_path / "out", "--rigid", RIGID, "--pose", "svd",
            "--pivot", "svd", "--no-report",
        )  # fmt: skip
        ours = time.perf_counter() - start
        assert ran.returncode == 0, ran.stderr
        start = time.perf_counter()
        ezc3d.c3d(str(tmp_path / "take.c3d")).write(str(tmp_path / "copy.c3d"))
        ratios.append(ours / (time.perf_counter() - start))
    print(f"evalkit compensate / ezc3d read and write: {np.round(ratios, 2)}")
    # The best of five pairs: a shared machine only ever adds time.
    assert min(ratios) <= 0.5
