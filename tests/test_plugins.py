"""Entries of other packages: the example to copy, installed and used; and broken ones, which cost one line each."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import evalkit
from evalkit.errors import EvalkitError
from evalkit.pivot import OWN as OWN_PIVOTS
from evalkit.plugins import PluginWarning, Table, plugins
from evalkit.pose import OWN as OWN_POSES
from evalkit.pose import PoseEstimator

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "tests" / "plugin_example"
ORIGIN = "evalkit-example 1.2.3"


def install(project: Path, target: Path) -> Path:
    """What ``pip install --target`` leaves of a pure Python project, without a build backend to fetch."""
    meta = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    info = target / f"{meta['name'].replace('-', '_')}-{meta['version']}.dist-info"
    info.mkdir(parents=True)
    text = f"Metadata-Version: 2.1\nName: {meta['name']}\nVersion: {meta['version']}\n"
    (info / "METADATA").write_text(text, encoding="utf-8")
    lines = []
    for group, entries in meta["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {value}" for name, value in entries.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    for module in project.glob("*.py"):
        shutil.copy(module, target)
    return target


def declare(target: Path, name: str, entries: dict[str, str], source: str = "") -> None:
    """A package with these pose entries and one module, named as the package with underscores."""
    project = target / f"{name}-source"
    project.mkdir(parents=True)
    table = "\n".join(f'{entry} = "{value}"' for entry, value in entries.items())
    text = f'[project]\nname = "{name}"\nversion = "0.1"\n[project.entry-points."evalkit.pose"]\n{table}\n'
    (project / "pyproject.toml").write_text(text, encoding="utf-8")
    (project / f"{name.replace('-', '_')}.py").write_text(source, encoding="utf-8")
    install(project, target)


def fresh(*arguments: str | Path, path: Path, strict: bool = True) -> subprocess.CompletedProcess[str]:
    """A fresh interpreter that sees a folder of installed packages; if strict, it must succeed, no plugin left out."""
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(path), str(ROOT)]), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, *map(str, arguments)]
    ran = subprocess.run(command, capture_output=True, text=True, env=env, cwd=ROOT, check=False)
    if strict:
        assert ran.returncode == 0, ran.stderr
        assert "PluginWarning" not in ran.stderr
    return ran


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    return install(EXAMPLE, tmp_path_factory.mktemp("site"))


# --- the example -------------------------------------------------------------------------------------------


def test_tables_have_the_example_whatever_is_imported_first(example):
    """The plugin imports the modules whose tables load it: no order may lose an entry."""
    code = """
import sys, json
if sys.argv[1] == "evalkit":
    from evalkit import compensate
else:
    import evalkit_example
from evalkit.deform.kernels import kernels
from evalkit.pivot import pivot_estimators
from evalkit.pose import pose_estimators
from evalkit.synthetic import PRESETS
tables = pose_estimators, pivot_estimators, kernels, PRESETS
print(json.dumps([[table['example'].origin, len(table), list(table)[-1]] for table in tables]))
"""
    for first in ("evalkit", "evalkit_example"):
        found = json.loads(fresh("-c", code, first, path=example).stdout)
        assert [origin for origin, *_ in found] == [ORIGIN] * 4
        # Own entries first: a plugin changes neither their order nor their number.
        assert all(last == "example" and count > 5 for _, count, last in found)


def test_control_without_the_package_there_is_no_example(tmp_path):
    code = "from evalkit.pose import pose_estimators; print('example' in pose_estimators)"
    assert fresh("-c", code, path=tmp_path).stdout.strip() == "False"


def test_plugins_are_loaded_at_the_first_look_not_at_the_import(example):
    code = (
        "import sys, evalkit.pose\nbefore = 'evalkit_example' in sys.modules\nlen(evalkit.pose.pose_estimators)\n"
        "print(before, 'evalkit_example' in sys.modules)"
    )
    assert fresh("-c", code, path=example).stdout.split() == ["False", "True"]


def test_command_line_lists_and_uses_the_example(example, tmp_path):
    listed = fresh("-m", "evalkit", "methods", path=example).stdout.splitlines()
    # A pose estimator, a pivot estimator, a kernel and a preset.
    assert sum(line.split()[:1] == ["example"] and ORIGIN in line for line in listed) == 4

    rigid = ["ForeheadL", "ForeheadC", "ForeheadR", "NoseBridge"]
    fresh("-m", "evalkit", "synth", "example", "-o", tmp_path, path=example)
    fresh(
        "-m", "evalkit", "compensate", tmp_path / "example.c3d", "-o", tmp_path / "out", "--no-report",
        "--pose", "example", "--pivot", "example", "--rigid", ",".join(rigid), path=example,
    )  # fmt: skip
    method = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))["method"]
    assert (method["pose"], method["pivot"]) == ("example", "example")
    motion = np.genfromtxt(tmp_path / "out" / "motion.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    theirs = Rotation.from_quat(np.stack([motion[f"q{k}"] for k in "xyzw"], axis=1))
    take = evalkit.read_capture(tmp_path / "example.c3d")
    ours = Rotation.from_matrix(evalkit.compensate(take, rigid, pose="svd", pivot="score").rotations)
    assert len(motion) == take.frames == 240
    # The same optimum by another route; the file keeps nine decimals of the quaternion.
    assert (theirs * ours.inv()).magnitude().max() < 1e-8
    # Control: a frame late.
    assert (theirs[1:] * ours[:-1].inv()).magnitude().max() > 1e-3


@pytest.mark.slow
def test_contract_holds_for_the_example(example):
    """The contract tests take their entries from the tables: with the package there, they run over it, too."""
    ran = fresh(
        "-m", "pytest", "tests/contracts", "-k", "example", "-q", "-p", "no:cacheprovider", "-p", "no:xdist",
        "-o", "addopts=", path=example,
    )  # fmt: skip
    passed = re.search(r"(\d+) passed", ran.stdout)
    # Every check of both tables: the suites have some twenty functions each.
    assert passed is not None and int(passed[1]) >= 40, ran.stdout


# --- broken plugins ----------------------------------------------------------------------------------------

GOOD = "from evalkit.pose import PoseEstimator\nmine = PoseEstimator(print, 'mine', 'nowhere')\n"

BROKEN = {
    "no module": ({"odd": "not_there:thing"}, "", "ModuleNotFoundError"),
    "no attribute": ({"odd": "broken_plugin:thing"}, GOOD, "AttributeError"),
    "fails at import": ({"odd": "broken_plugin:mine"}, "raise RuntimeError('two\\nlines')", "RuntimeError: two lines"),
    "leaves at import": ({"odd": "broken_plugin:mine"}, "raise SystemExit(3)", "SystemExit"),
    "does not parse": ({"odd": "broken_plugin:mine"}, "def", "SyntaxError"),
    "another type": ({"odd": "broken_plugin:other"}, "other = 3.0", "type float, not evalkit.pose.model.PoseEstimator"),
    "the class itself": ({"odd": "evalkit.pose:PoseEstimator"}, "", "type type"),
    "name taken": ({"svd": "broken_plugin:mine"}, GOOD, "the name is taken"),
}


@pytest.fixture
def site(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path
    for name in ("broken_plugin", "a_first", "b_second"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize(("entries", "source", "reason"), BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_entry_is_left_out_with_one_line(site, entries, source, reason):
    declare(site, "broken-plugin", {**entries, "whole": "broken_plugin:mine"}, source)
    whole_too = source == GOOD
    with pytest.warns(PluginWarning) as caught:
        found = plugins("evalkit.pose", PoseEstimator, taken=OWN_POSES)
    assert list(found) == (["whole"] if whole_too else [])
    (name,) = entries
    told = [str(warning.message) for warning in caught]
    assert len(told) == (1 if whole_too else 2)
    (line,) = (line for line in told if f"'{name}'" in line)
    assert line.startswith("broken-plugin 0.1: evalkit.pose entry") and reason in line and "\n" not in line


def test_control_a_whole_entry_is_taken_without_a_word(site):
    declare(site, "broken-plugin", {"mine": "broken_plugin:mine"}, GOOD)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = plugins("evalkit.pose", PoseEstimator, taken=OWN_POSES)
    assert found["mine"].origin == "broken-plugin 0.1" and found["mine"].summary == "mine"


def test_of_two_packages_with_one_name_the_first_by_name_is_taken(site):
    for name in ("b-second", "a-first"):
        declare(site, name, {"mine": f"{name.replace('-', '_')}:mine"}, GOOD)
    with pytest.warns(PluginWarning, match=r"b-second 0\.1.*the name is taken"):
        found = plugins("evalkit.pose", PoseEstimator, taken=OWN_POSES)
    assert found["mine"].origin == "a-first 0.1"


def test_the_program_goes_on_without_broken_plugins(tmp_path):
    """On the command line, each is one line on standard error, and everything else is there."""
    for k, (entries, source, _) in enumerate(BROKEN.values()):
        value = {name: text.replace("broken_plugin", f"broken_{k}") for name, text in entries.items()}
        declare(tmp_path, f"broken-{k}", value, source)
    ran = fresh("-m", "evalkit", "methods", "--json", path=tmp_path, strict=False)
    assert ran.returncode == 0, ran.stderr
    lines = ran.stderr.splitlines()
    assert len(lines) == len(BROKEN), ran.stderr
    assert all("PluginWarning" in line and f"broken-{k} 0.1" in line for k, line in enumerate(lines))
    listed = {(row["kind"], row["name"]) for row in json.loads(ran.stdout)}
    assert listed >= {("pose", name) for name in OWN_POSES} | {("pivot", name) for name in OWN_PIVOTS}


def test_an_entry_added_at_run_time_is_used_and_may_be_replaced():
    table = Table({"svd": OWN_POSES["svd"]}, "evalkit.nothing", PoseEstimator)
    first, second = OWN_POSES["horn"], OWN_POSES["qcp"]
    table.add("mine", first)
    table.add("mine", second)
    assert table["mine"] is second and list(table) == ["svd", "mine"]
    with pytest.raises(EvalkitError, match="the name 'svd' is taken"):
        table.add("svd", first)
    with pytest.raises(EvalkitError, match="'other' is of type function; this table takes PoseEstimator"):
        table.add("other", first.function)
    assert list(table) == ["svd", "mine"]


def test_a_table_reads_like_a_dict():
    table = Table({"a": 1, "b": 2}, "evalkit.nothing", int)
    assert dict(table) == {"a": 1, "b": 2} and list(table) == ["a", "b"] and len(table) == 2
    assert "a" in table and "c" not in table and table.get("c") is None
    with pytest.raises(KeyError):
        table["c"]
    assert repr(table) == "Table({'a': 1, 'b': 2})"
