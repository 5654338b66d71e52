"""Figures: each is drawn from its CSV alone, to the byte the same, says what it shows; the command that makes them."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import types
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from small_study import study as small_study

import evalkit.figures
import evalkit.studies
import evalkit.study.runner
from evalkit.cli.figures import figures as command
from evalkit.errors import EvalkitError
from evalkit.figures import figure_named, figures, show
from evalkit.figures.files import VECTOR, caption, draw, raster, save, vector
from evalkit.figures.style import canvas, curve
from evalkit.figures.table import from_csv, from_tables, measured, shares
from evalkit.study.runner import run

COMMITTED = Path(__file__).resolve().parents[1] / "paper_figures"
PLOTS = [name for name in figures if (COMMITTED / f"{name}.svg").exists()]
FOLDERS = re.compile(rb"(?<![\w.])/(?:work|tmp|root|home|Users|mnt|var)/|[A-Z]:\\\\")
"""How folders of somebody's machine begin."""


def strays(data: bytes) -> list[bytes]:
    return FOLDERS.findall(data)


def unlabelled(picture) -> list[str]:
    """Panels whose axes do not say what they show; a shared axis says it at the edge of the grid."""
    lacking = []
    for number, axes in enumerate(picture.axes):
        at = axes.get_subplotspec()
        edge = {"x": axes.get_shared_x_axes(), "y": axes.get_shared_y_axes()}
        for which, group in edge.items():
            if not len(getattr(axes, f"get_{which}ticks")()):  # a drawing, not a scale
                continue
            told = [getattr(one, f"get_{which}label")() for one in group.get_siblings(axes)]
            line = [
                getattr(one, f"get_{which}label")()
                for one in picture.axes
                if one.get_subplotspec() is not None
                and at is not None
                and (one.get_subplotspec().rowspan if which == "y" else one.get_subplotspec().colspan)
                == (at.rowspan if which == "y" else at.colspan)
            ]
            # Panels side by side with the same lines to them name the lines once, at the left.
            if not any(told) and not any(line):
                lacking.append(f"panel {number} {which}")
    return lacking


@pytest.fixture
def nothing_measured(monkeypatch):
    """A study that runs, or a figure that measures, is an error."""

    def refuse(*given, **named):
        raise AssertionError("a figure was measured where it should have been drawn from its CSV")

    monkeypatch.setattr(evalkit.study.runner, "run", refuse)
    for figure in figures.values():
        if hasattr(figure, "measure"):
            monkeypatch.setattr(figure, "measure", refuse)


@pytest.fixture
def little(monkeypatch):
    """A figure of the small study of the tests, in the table of figures."""
    figure = types.ModuleType("little")
    figure.__doc__ = "Error over size.\n\nOf a study that takes no time."
    figure.NAME, figure.STUDY = "little", "small"

    def drawn(table):
        made, axes = canvas()
        for method in table.methods:
            curve(axes, table.of("error", method, place="here"), "size", method)
        axes.set(xlabel="size", ylabel="error, mm")
        return made

    figure.draw = drawn
    monkeypatch.setitem(evalkit.studies.studies, "small", small_study)
    monkeypatch.setitem(figures, "little", figure)
    return figure


@pytest.mark.parametrize("name", figures)
def test_committed_files_belong_together(name):
    facts = json.loads((COMMITTED / f"{name}.json").read_text(encoding="utf-8"))
    data = (COMMITTED / f"{name}.csv").read_bytes()
    assert facts["name"] == name
    assert facts["csv_sha256"] == hashlib.sha256(data).hexdigest()
    assert facts["command"].split("&&")[-1].split()[:3] == ["evalkit", "figures", name]
    # The control: one digit of the table changed.
    spoilt = data[:-3] + bytes([data[-3] ^ 1]) + data[-2:]
    assert facts["csv_sha256"] != hashlib.sha256(spoilt).hexdigest()


def test_every_figure_is_committed_with_its_picture():
    for name in figures:
        kinds = {path.suffix[1:] for path in COMMITTED.glob(f"{name}.*")}
        assert kinds in ({"csv", "json", *VECTOR}, {"csv", "json", "png"}), name
    assert {path.stem for path in COMMITTED.glob("*.csv")} <= set(figures)


def test_no_committed_file_names_a_folder_of_a_machine():
    for path in COMMITTED.iterdir():
        if path.suffix in (".csv", ".json", ".svg"):
            assert not strays(path.read_bytes()), path.name
    assert strays(b'"take": "/home/me/a.c3d"')  # the control


@pytest.mark.parametrize("name", PLOTS)
def test_a_plot_is_drawn_from_its_csv_alone_and_its_axes_say_what_they_show(name, nothing_measured):
    figure = figure_named(name)
    table = from_csv(figure, COMMITTED)
    picture = draw(figure, table)
    assert not unlabelled(picture)
    # A column or a page of a journal; more than a page high could not be printed.
    assert picture.get_size_inches()[0] in (3.5, 7.16) and picture.get_size_inches()[1] < 9.0


@pytest.mark.parametrize("name", figures)
def test_captions_say_what_is_shown(name):
    words = caption(figure_named(name))
    assert len(words) > 80 and words.partition(". ")[2]
    assert json.loads((COMMITTED / f"{name}.json").read_text(encoding="utf-8"))["caption"] == words


def test_labels_are_missed_where_they_lack():
    figure = figure_named("pivot-noise")
    picture = draw(figure, from_csv(figure, COMMITTED))
    for axes in picture.axes:
        axes.set_xlabel("")
    assert unlabelled(picture) == ["panel 0 x", "panel 1 x"]


def test_the_same_table_gives_the_same_bytes():
    figure = figure_named("static-points")
    table = from_csv(figure, COMMITTED)
    for kind in VECTOR:
        first, second = (vector(draw(figure, table), kind) for _ in range(2))
        assert first == second
    # The control: one number of the table a tenth larger.
    rows = table.rows.copy()
    rows.loc[0, "rim_mm"] *= 1.1
    other = type(table)(rows, table.study, table.facts)
    assert vector(draw(figure, other), "svg") != vector(draw(figure, table), "svg")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace("bound_mm", "bound_cm", 1), "column 'bound_mm' is missing"),
        (lambda text: text.partition("\n")[0] + "\n", "no rows"),
        (lambda text: "", "cannot be read as a table"),
        (lambda text: 'a,"b\n' + text, "cannot be read as a table"),
    ],
    ids=["column", "rows", "empty", "quotes"],
)
def test_a_spoilt_table_is_one_clear_line(change, words, tmp_path):
    for kind in ("csv", "json"):
        shutil.copy(COMMITTED / f"pivot-noise.{kind}", tmp_path)
    path = tmp_path / "pivot-noise.csv"
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(EvalkitError, match=words) as found:
        from_csv(figure_named("pivot-noise"), tmp_path)
    assert str(path) in str(found.value) and "\n" not in str(found.value)


def test_list_and_help():
    listed = CliRunner().invoke(command, ["--list"])
    assert listed.exit_code == 0
    assert [line.split()[0] for line in listed.output.splitlines()] == list(figures)
    assert "--tables" in CliRunner().invoke(command, ["--help"]).output


def test_an_unknown_name_is_told_with_the_nearest():
    with pytest.raises(EvalkitError, match=r"'pivot-nose' is not known; did you mean pivot-noise"):
        CliRunner().invoke(command, ["pivot-nose"], catch_exceptions=False)
    with pytest.raises(EvalkitError, match="known are"):
        figure_named("zzz")


def test_tables_of_a_study_give_the_figure_that_is_measured(little, tmp_path):
    run(small_study, tmp_path / "tables", jobs=1)
    done = CliRunner().invoke(
        command, ["little", "--tables", str(tmp_path / "tables"), "-o", str(tmp_path / "a")], catch_exceptions=False
    )
    assert done.exit_code == 0
    save(little, measured(little, "full", jobs=1), tmp_path / "b")
    one, other = ((tmp_path / folder / "little.svg").read_bytes() for folder in "ab")
    assert one == other
    fewer = tmp_path / "c"
    save(little, measured(little, "small", jobs=1), fewer)
    assert (fewer / "little.svg").read_bytes() != one  # the control: another table is another picture
    again = from_csv(little, tmp_path / "a")
    assert vector(draw(little, again), "svg") == one
    with pytest.raises(EvalkitError, match="no table there; run: evalkit study run small"):
        from_tables(little, tmp_path / "nowhere")


def test_an_interrupted_run_goes_on(little, tmp_path, monkeypatch):
    whole, stopped = small_study.score, []

    def interrupted(data, result):
        stopped.append(1)
        if len(stopped) == 6:
            raise KeyboardInterrupt
        return whole(data, result)

    at = ["little", "--run", "--budget", "full", "--jobs", "1", "-o", str(tmp_path / "f"), "--results", str(tmp_path)]
    cut = dict(vars(small_study)) | {"score": interrupted}
    monkeypatch.setitem(evalkit.studies.studies, "small", type(small_study)(**cut))
    with pytest.raises(EvalkitError, match=r"little: stopped; .* the same command goes on"):
        CliRunner().invoke(command, at, catch_exceptions=False)
    assert not (tmp_path / "f" / "little.svg").exists()
    monkeypatch.setitem(evalkit.studies.studies, "small", small_study)
    done = CliRunner().invoke(command, at, catch_exceptions=False)
    # Two methods a cell: the third cell was cut off.
    assert "2 of 20 cells were done before" in done.output and (tmp_path / "f" / "little.svg").exists()


def test_folders_of_files_are_left_out_of_a_figure(little, tmp_path, monkeypatch):
    take = tmp_path / "deep" / "take.txt"
    take.parent.mkdir()
    take.write_text("here", encoding="utf-8")
    axes = {"size": (10,), "place": (str(take),)}
    table = measured(little, "small", jobs=1, axes=axes)
    assert set(table.rows["place"]) == {"take.txt"} and not strays(json.dumps(table.facts).encode())
    save(little, table, tmp_path / "out")
    facts = json.loads((tmp_path / "out" / "little.json").read_text(encoding="utf-8"))
    assert facts["command"] == 'evalkit figures little --run --budget small --axis "place=take.txt"'


def test_a_figure_that_needs_files_says_so():
    with pytest.raises(EvalkitError, match=r"figure real-takes needs files of yours: --axis take="):
        measured(figure_named("real-takes"), "small")


def test_one_call_for_a_notebook(little):
    picture = show("little")
    assert raster(picture, 40).shape == (104, 140, 3)
    with pytest.raises(EvalkitError, match="budget 'tiny' is not known"):
        show("little", "tiny")


def test_shares_have_intervals_with_a_width():
    import pandas as pd

    found = shares(pd.DataFrame({"value": [1.0, 0.5, np.nan], "seeds": [16, 16, 0], "low": 1.0, "high": 1.0}))
    # Wilson: (p + z²/2n -+ z sqrt(p(1-p)/n + z²/4n²)) / (1 + z²/n), by hand.
    z2 = 1.959964**2
    assert found["low"].iloc[0] == pytest.approx(1 / (1 + z2 / 16), abs=1e-6) and found["high"].iloc[0] == 1.0
    assert found["low"].iloc[1] + found["high"].iloc[1] == pytest.approx(1.0) and len(found) == 2
