"""A user's program over the whole public interface passes mypy --strict, and one with wrong types does not."""

from __future__ import annotations

from pathlib import Path

import pytest

import evalkit

ROOT = Path(__file__).resolve().parents[1]

RIGHT = """
from typing import assert_type

import numpy as np
from numpy.typing import NDArray

import evalkit
from evalkit.pivot import PivotEstimator
from evalkit.synthetic import Truth


def program() -> NDArray[np.float64]:
    take: evalkit.Capture = evalkit.read_capture("take.c3d")
    take = evalkit.Capture(points=take.points, labels=["a"], rate=60.0, unit="mm")
    assert_type(take.points, NDArray[np.float64])
    assert_type(take.labels, list[str])
    words: list[str] = evalkit.write_capture(take, "copy.c3d")
    result = evalkit.compensate(take, rigid="auto", pose="svd", pivot="joint", sway="auto", reference="mean")
    assert_type(result, evalkit.Compensation)
    assert_type(result.capture, evalkit.Capture)
    motion = result.rotations, result.translations, result.pivot, result.pivot_covariance, result.sway
    first: NDArray[np.float64] = motion[0]
    status: str = result.status
    bad = result.frame_status != evalkit.FrameStatus.OK
    published: evalkit.Compensation = evalkit.compensate_as_published(take, rigid=["a", "b", "c"], reference=0)
    take, truth = evalkit.synthesize("talking", seed=0, noise=0.3)
    assert_type(truth, Truth)
    made = truth.rotations, truth.pivot, truth.sway, truth.expression, truth.visible
    estimator: PivotEstimator = evalkit.pivot_estimators["joint"]
    names: list[str] = [*evalkit.pose_estimators, *evalkit.kernels]
    head: evalkit.Head = evalkit.load_head("template")
    try:
        weights = evalkit.deformation_map(head, list(head.marker_sites), kernel="exponential", regions=True)
    except evalkit.CaptureError:
        raise
    except evalkit.EvalkitError as error:
        print(error, words, first, status, bad, published, made, estimator, names, head.regions, head.landmarks)
        raise
    examples = [head.vertices], [head.vertices]
    fine = evalkit.transfer_character(head.vertices, *examples, head.vertices[None], head.triangles)
    assert_type(fine, NDArray[np.float64])
    return head.vertices + weights @ np.zeros((len(head.marker_sites), 3))
"""

WRONG = {
    "evalkit.compensate('take.c3d')": "arg-type",
    "evalkit.read_capture(3)": "arg-type",
    "evalkit.load_head('template', vertices='many')": "arg-type",
    "evalkit.deformation_map(evalkit.load_head(), ['Chin'], seams='ramp')": "call-arg",
    "evalkit.read_capture('take.c3d').positions": "attr-defined",
    "evalkit.synthesize('talking')[1].pivots": "attr-defined",
    "evalkit.read_captures('take.c3d')": "attr-defined",
    "evalkit.kernels['exponential'].radius": "attr-defined",
}


def complaints(folder: Path, programs: dict[str, str]) -> dict[str, list[str]]:
    """What mypy --strict says of each program; one run, because most of it goes into reading evalkit and NumPy."""
    api = pytest.importorskip("mypy.api")
    for name, text in programs.items():
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    paths = [str(folder / f"{name}.py") for name in programs]
    # The project's own settings and cache: after 'make types' next to nothing is left to read.
    config = ["--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(ROOT / ".mypy_cache")]
    out, problem, _ = api.run([*config, "--strict", "--no-error-summary", *paths])
    assert problem == ""
    lines = [line for line in out.splitlines() if " error: " in line]
    return {name: [line for line in lines if f"{name}.py:" in line] for name in programs}


def test_a_users_program_is_checked_against_the_types(tmp_path):
    assert (Path(evalkit.__file__).parent / "py.typed").is_file()
    for name in evalkit.__all__:
        assert f"evalkit.{name}" in RIGHT, f"the program does not use evalkit.{name}"
    wrong = "import evalkit\n" + "\n".join(WRONG)
    found = complaints(tmp_path, {"right": RIGHT, "wrong": wrong})
    assert found["right"] == []
    # Control: every line of the wrong program is refused, for its own reason.
    codes = [(int(line.split(":")[1]) - 2, line.rsplit("[", 1)[1].rstrip("]")) for line in found["wrong"]]
    assert codes == list(enumerate(WRONG.values()))
