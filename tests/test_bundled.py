"""The committed takes are what the generator makes today, and the check that says so notices when they are not."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import evalkit
from evalkit.bundled import bundled_folder, bundled_take
from evalkit.cli.synth import synth
from evalkit.errors import EvalkitError
from evalkit.synthetic import PRESETS, Truth
from evalkit.synthetic.reference import CAPTURE_TOLERANCE_MM, FRAMES, check_reference, write_reference

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "data" / "synthetic"


def differing(folder):
    return {verdict.file: verdict.text for verdict in check_reference(folder) if not verdict.same}


@pytest.fixture
def small(tmp_path):
    """A folder with the first take of the set alone, to be spoilt."""
    manifest = json.loads((FOLDER / "MANIFEST.json").read_text())
    manifest["takes"] = [take for take in manifest["takes"] if take["preset"] == "gaps"]
    (tmp_path / "MANIFEST.json").write_text(json.dumps(manifest))
    for name in manifest["takes"][0]["sha256"]:
        shutil.copy(FOLDER / name, tmp_path)
    return tmp_path


def test_the_set_is_small_and_has_a_take_of_every_preset():
    assert bundled_folder() == FOLDER
    listed = [take["preset"] for take in json.loads((FOLDER / "MANIFEST.json").read_text())["takes"]]
    own = [name for name, preset in PRESETS.items() if not preset.origin]
    assert sorted(listed) == sorted(own) == sorted(name for names in FRAMES.values() for name in names)
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 5e6


def test_the_generator_makes_every_file_of_the_set():
    verdicts = list(check_reference(FOLDER))
    assert len(verdicts) == 2 * len(PRESETS)
    assert [verdict for verdict in verdicts if not verdict.same] == []


def test_what_each_take_is_for_shows_in_it():
    truths = {name: Truth.load(bundled_take(name)[1]) for name in PRESETS}
    assert {name for name, truth in truths.items() if truth.outliers.any()} == {"outliers"}
    assert {name for name, truth in truths.items() if truth.swapped.any()} == {"label-swaps"}
    assert {name for name, truth in truths.items() if not truth.visible.all()} == {"gaps", "worst-day"}
    assert {name for name, truth in truths.items() if truth.sway.any()} == {"sway", "two-joints", "worst-day"}
    assert {name for name, truth in truths.items() if truth.rigid_slide_mm > 1} == {"skin", "one-sided", "worst-day"}


def test_the_set_is_written_anew_by_one_command(tmp_path):
    ran = CliRunner().invoke(synth, ["--reference", "-o", str(tmp_path / "new")])
    assert ran.exit_code == 0, ran.output
    names = {path.name for path in FOLDER.iterdir()} - {"README.md"}
    assert {path.name for path in (tmp_path / "new").iterdir()} == names
    assert differing(tmp_path / "new") == {}
    stored, new = (json.loads((folder / "MANIFEST.json").read_text()) for folder in (FOLDER, tmp_path / "new"))
    for one, other in zip(stored["takes"], new["takes"], strict=True):
        assert one["parameters"] == other["parameters"]


def test_damaged_missing_and_unknown_files_are_noticed(small):
    assert differing(small) == {}
    capture = small / "gaps.c3d"
    whole = capture.read_bytes()
    for place, text in ((len(whole) // 2 + 2, "DIFFERS"), (len(whole) - 1, "SHA-256")):  # a sample; the padding
        spoilt = bytearray(whole)
        spoilt[place] ^= 0x41
        capture.write_bytes(spoilt)
        assert list(differing(small)) == ["gaps.c3d"]
        assert text in differing(small)["gaps.c3d"]
    capture.write_bytes(whole[:3000])
    assert list(differing(small)) == ["gaps.c3d"]
    capture.unlink()
    (small / "other.c3d").write_bytes(whole)
    assert differing(small) == {"gaps.c3d": "DIFFERS: missing", "other.c3d": "DIFFERS: not in MANIFEST.json"}
    ran = CliRunner().invoke(synth, ["--check", str(small)])
    assert ran.exit_code == 1
    assert [line.split()[0] for line in ran.output.splitlines()] == ["gaps.c3d", "gaps.truth.npz", "other.c3d"]


@pytest.mark.parametrize(("change_mm", "same"), [(0.4 * CAPTURE_TOLERANCE_MM, True), (3 * CAPTURE_TOLERANCE_MM, False)])
def test_another_machines_last_digits_pass_and_no_more(small, change_mm, same):
    """A take written anew with coordinates a little off, and its own checksum in the manifest."""
    capture = small / "gaps.c3d"
    take = evalkit.read_capture(FOLDER / "gaps.c3d")
    take.points[5, 3] += change_mm
    evalkit.write_capture(take, capture)
    manifest = json.loads((small / "MANIFEST.json").read_text())
    manifest["takes"][0]["sha256"]["gaps.c3d"] = hashlib.sha256(capture.read_bytes()).hexdigest()
    (small / "MANIFEST.json").write_text(json.dumps(manifest))
    verdict = next(verdict for verdict in check_reference(small) if verdict.file == "gaps.c3d")
    assert verdict.same == same
    assert ("equal within" in verdict.text) == same


def test_a_generator_that_changed_is_noticed(small):
    manifest = json.loads((small / "MANIFEST.json").read_text())
    manifest["takes"][0]["seed"] = 1
    (small / "MANIFEST.json").write_text(json.dumps(manifest))
    assert set(differing(small)) == {"gaps.c3d", "gaps.truth.npz"}
    manifest["takes"][0]["parameters"]["no_such"] = 1
    (small / "MANIFEST.json").write_text(json.dumps(manifest))
    assert all("cannot be made again" in text for text in differing(small).values())


def test_a_truth_that_says_something_else_is_noticed(small):
    path = small / "gaps.truth.npz"
    with np.load(path) as archive:
        parts = dict(archive)
    parts["outliers"][7, 2] = True
    np.savez_compressed(path, **parts)
    assert differing(small) == {"gaps.truth.npz": "DIFFERS: outliers: not that of the take"}


@pytest.mark.parametrize("content", [None, "", "[]", '{"takes": 3}', '{"takes": [{"preset": "gaps"}]}'])
def test_a_manifest_that_is_none_is_one_clear_line(tmp_path, content):
    if content is not None:
        (tmp_path / "MANIFEST.json").write_text(content)
    with pytest.raises(EvalkitError, match=r"MANIFEST\.json: ") as caught:
        list(check_reference(tmp_path))
    assert "\n" not in str(caught.value)


def test_a_place_that_cannot_be_written_is_one_clear_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(EvalkitError, match="cannot write there"):
        write_reference(tmp_path / "file" / "set")


def test_the_check_works_where_a_wheel_puts_the_files(tmp_path_factory, small):
    site = tmp_path_factory.mktemp("site")
    shutil.copytree(ROOT / "evalkit", site / "evalkit", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(small, site / "evalkit" / "data" / "synthetic")
    code = "import evalkit, sys; print(evalkit.__file__); from evalkit.cli import main; main()"
    ran = subprocess.run(
        [sys.executable, "-c", code, "synth", "--check"],
        cwd=site,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    first, *lines = ran.stdout.splitlines()
    assert Path(first).is_relative_to(site)
    assert [line.split() for line in lines] == [["gaps.c3d", "identical"], ["gaps.truth.npz", "identical"]]


@pytest.mark.parametrize(
    "arguments", [["--check", "--list"], [], ["talking"], ["talking", "--check"], ["--seed", "3", "--list"]]
)
def test_contradictory_arguments_are_refused(arguments):
    ran = CliRunner().invoke(synth, [*arguments])
    assert ran.exit_code == 2


def test_the_list_names_every_preset_and_parameter():
    ran = CliRunner().invoke(synth, ["--list"])
    assert ran.exit_code == 0
    for name in (*PRESETS, *evalkit.synthetic.Parameters().as_dict()):
        assert f" {name} " in ran.output
