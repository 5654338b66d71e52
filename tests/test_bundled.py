"""The committed takes are what the generator makes today, and the files are those of the manifest."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

import evalkit
from evalkit.bundled import bundled_take
from evalkit.synthetic import Truth

FOLDER = Path(__file__).parent.parent / "data" / "synthetic"
TAKES = {entry["preset"]: entry for entry in json.loads((FOLDER / "MANIFEST.json").read_text())["takes"]}


def test_every_file_is_in_the_manifest():
    listed = {name for entry in TAKES.values() for name in entry["sha256"]}
    assert listed == {p.name for p in FOLDER.iterdir()} - {"MANIFEST.json", "README.md"}


@pytest.mark.parametrize("name", TAKES)
def test_checksums(name):
    for file, expected in TAKES[name]["sha256"].items():
        assert hashlib.sha256((FOLDER / file).read_bytes()).hexdigest() == expected, file


@pytest.mark.parametrize("name", TAKES)
def test_the_generator_still_makes_them(name):
    capture, truth = bundled_take(name)
    overrides = {k: tuple(v) if isinstance(v, list) else v for k, v in TAKES[name]["parameters"].items()}
    take, made = evalkit.synthesize(name, seed=TAKES[name]["seed"], **overrides)
    # 24 bits of a coordinate of up to 2 m are 0.0001 mm.
    np.testing.assert_allclose(evalkit.read_capture(capture).points, take.points, atol=1.3e-4)
    stored = Truth.load(truth)
    for part in ("rotations", "translations", "pivot", "sway", "neutral", "expression"):
        # Sines of another processor's library may differ in the last digit.
        np.testing.assert_allclose(getattr(stored, part), getattr(made, part), atol=1e-9)
    assert (stored.visible == made.visible).all()
    other, _ = evalkit.synthesize(name, seed=TAKES[name]["seed"] + 1, **overrides)  # control: another seed differs
    assert np.nanmax(np.abs(other.points - take.points)) > 1.0
