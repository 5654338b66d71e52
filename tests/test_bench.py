"""The frame-rate benchmark: what it reports, and that a scene which does not draw is found out."""

from __future__ import annotations

import csv
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from small_head import head_to_draw, small_head

from evalkit.cli import app
from evalkit.deform import Deformer
from evalkit.head import Head
from evalkit.render import benchmark
from evalkit.render.benchmark import Animation, animate, deformation_rates, measure, settings
from evalkit.render.head_scene import HeadScene

KEYS = {
    "vertices", "width", "height", "textured", "multisamples", "frames", "distinct_frames", "frames_per_second",
    "bare_frames_per_second", "gemm_gflops", "peak_gflops", "renderer",
    *(f"{stage}_ms_p{p}" for stage in ("deform", "upload", "render", "read_back") for p in (50, 95, 99)),
}  # fmt: skip
FRAMES = 12


@pytest.fixture(scope="module")
def head() -> Head:
    return head_to_draw()


@pytest.fixture(scope="module")
def animation(head: Head) -> Animation:
    return animate(head, FRAMES + benchmark.WARM_UP)


class Stale(HeadScene):
    """Draws at first, then returns the picture that is there: what a screenshot without rendering does."""

    good = benchmark.WARM_UP

    def render(self) -> None:
        if self.good > 0:
            self.good -= 1
            super().render()


class Deaf(HeadScene):
    """Draws every frame, but shows none of the vertices that it is given."""

    def show(self, vertices: object, markers: object = None) -> None:
        super().show(small_head().vertices)


def test_every_frame_is_drawn_and_the_rates_are_those_of_the_stages(head: Head, animation: Animation) -> None:
    with HeadScene(head, (96, 96)) as scene:
        row = measure(scene, animation)
    assert row["status"] == "ok"
    assert row["distinct_frames"] == row["bare_distinct_frames"] == row["frames"] == FRAMES
    for stage in benchmark.STAGES:
        assert 0 < row[f"{stage}_ms_p50"] <= row[f"{stage}_ms_p95"] <= row[f"{stage}_ms_p99"]
    # A frame takes no less than each of its stages, and the slowest no more than all slowest together.
    longest = 1e-3 * sum(row[f"{stage}_ms_p99"] for stage in benchmark.STAGES)
    assert 1 / row["frames_per_second"] < 1.1 * longest
    assert row["bare_frames_per_second"] > 0


@pytest.mark.parametrize("fault", [Stale, Deaf])
def test_control_a_scene_that_does_not_draw_the_frames_has_no_rates(
    head: Head, animation: Animation, fault: type[HeadScene]
) -> None:
    with fault(head, (96, 96), textured=False) as scene:
        row = measure(scene, animation)
    assert row["distinct_frames"] == 1 < row["frames"]
    assert row["status"] == benchmark.NOT_DRAWN
    assert row["frames_per_second"] is row["bare_frames_per_second"] is row["render_ms_p50"] is None


def test_the_animation_is_that_of_a_talking_face(head: Head, animation: Animation) -> None:
    assert animation.displacements.shape == (FRAMES + benchmark.WARM_UP, 43, 3)
    moved = np.linalg.norm(animation.displacements, axis=2)
    # The static centres stay; the markers move by what talking moves a face, the mouth more than the forehead.
    assert (moved[:, 23:] == 0).all()
    longer = animate(head, 600)
    assert np.array_equal(longer.displacements[: len(animation.displacements)], animation.displacements)
    reach = np.linalg.norm(longer.displacements, axis=2).max(axis=0)
    assert 2.0 < reach[:23].max() < 30.0
    # Forehead markers come first in the layout, the lower lip and the chin last.
    assert reach[:3].max() < reach[19:23].min()
    with_rest = Deformer(animation.weights, head.vertices)(animation.displacements)
    assert np.isfinite(with_rest).all()


def test_rates_of_the_deformation_count_what_was_computed(animation: Animation) -> None:
    rates = deformation_rates(animation, repeats=2)
    flops = 2 * 3 * animation.weights.size * rates["deform_frames_per_second_batched"]
    assert rates["gemm_gflops"] == pytest.approx(1e-9 * flops)
    assert rates["peak_gflops"] > 0
    assert rates["deform_frames_per_second_one"] > 0


def test_settings_are_all_combinations_one_head_after_the_other() -> None:
    found = settings((1000, 5000), (512, 1024), (True, False), (0, 8))
    assert len(set(found)) == len(found) == 16
    assert [setting.vertices for setting in found] == [1000] * 8 + [5000] * 8


@pytest.fixture
def one_head(monkeypatch: pytest.MonkeyPatch, head: Head) -> None:
    """The command with a head that is already made, and arithmetic measured once."""
    monkeypatch.setattr(benchmark, "load_head", lambda vertices: head)
    monkeypatch.setattr(benchmark, "deformation_rates", partial(deformation_rates, repeats=1))


@pytest.mark.usefixtures("one_head")
def test_the_command_prints_rows_and_writes_them_with_the_machine(tmp_path: Path) -> None:
    options = ["--frames", "4", "--size", "64", "--size", "96", "--multisamples", "0", "--vertices", "1000"]
    done = CliRunner().invoke(app, ["bench", *options, "--json", "-o", str(tmp_path / "new")])
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)
    assert [(row["width"], row["height"]) for row in rows] == [(64, 64), (96, 96)]
    for row in rows:
        assert row.keys() >= KEYS
        assert row["distinct_frames"] == row["frames"] == 4
        assert row["vertices"] == len(small_head().vertices)
        assert row["renderer"]
        assert row["vtk"]
    facts = json.loads((tmp_path / "new" / "bench.json").read_text())
    assert facts["rows"] == rows
    assert facts["cpu"]
    assert "numpy" in facts["packages"]
    with (tmp_path / "new" / "bench.csv").open() as file:
        table = list(csv.DictReader(file))
    assert float(table[1]["render_ms_p95"]) == rows[1]["render_ms_p95"]


@pytest.mark.usefixtures("one_head")
def test_the_command_prints_a_table_and_ends_with_one_where_nothing_was_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    options = ["bench", "--frames", "4", "--size", "64", "--multisamples", "0"]
    done = CliRunner().invoke(app, options)
    assert done.exit_code == 0, done.output
    assert "4/4" in done.output
    assert "frames/s" in done.output
    monkeypatch.setattr(benchmark, "HeadScene", Stale)
    stale = CliRunner().invoke(app, options)
    assert stale.exit_code == 1
    assert "1/4" in stale.output
    assert "1 of 1 settings" in str(stale.exception)


def test_an_output_that_cannot_be_written_is_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = CliRunner().invoke(app, ["bench", "-o", str(tmp_path / "file")])
    assert done.exit_code == 1
    assert "file" in str(done.exception)
