"""The examples in the docstrings of the public names and in the README run, and give what they say."""

from __future__ import annotations

import doctest
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import evalkit
from evalkit.animation.labels import label_sets
from evalkit.bundled import bundled_take
from evalkit.plugins import Table

README = Path(__file__).resolve().parents[1] / "README.md"


def example_of(name: str) -> doctest.DocTest:
    """The examples of one public name; those of a table stand at the head of its module, where its entries are."""
    value = getattr(evalkit, name)
    home = sys.modules[evalkit._HOMES.get(name, "evalkit") if isinstance(value, Table) else value.__module__]
    text = home.__doc__ if isinstance(value, Table) else value.__doc__
    # No names but those that the example imports: a reader who copies it has no others either.
    return doctest.DocTestParser().get_doctest(text or "", {}, name, home.__file__, None)


def failures(test: doctest.DocTest) -> str:
    """What the examples gave instead of what they say; empty if nothing."""
    found: list[str] = []
    # IGNORE_EXCEPTION_DETAIL stays off: the line that a user sees is the example.
    doctest.DocTestRunner(optionflags=doctest.REPORT_NDIFF).run(test, out=found.append, clear_globs=False)
    return "".join(found)


def python_blocks(text: str) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("name", evalkit.__all__)
def test_example_of_the_public_name(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    test = example_of(name)
    assert test.examples, f"evalkit.{name} has no example"
    # A class may be what a function gives; everything else is called by its name.
    shown = any(f"evalkit.{name}" in example.source for example in test.examples)
    assert shown or isinstance(getattr(evalkit, name), type), "the example is about something else"
    assert not any(doctest.SKIP in example.options for example in test.examples)
    assert failures(test) == ""


def test_control_a_wrong_number_is_noticed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    test = example_of("compensate")
    right = test.examples[-1].want
    assert right == "[20.8, 1.5]\n"
    test.examples[-1].want = "[20.8, 1.6]\n"
    assert right in failures(test)


@pytest.fixture
def readers_folder(tmp_path, monkeypatch):
    """Where the README's reader works: take.c3d is his own, its labels those that the README names."""
    theirs = {site: label for label, site in label_sets()["animface"].items()}
    take = evalkit.read_capture(bundled_take("talking")[0])
    evalkit.write_capture(
        evalkit.Capture(take.points, [theirs[label] for label in take.labels], take.rate), tmp_path / "take.c3d"
    )
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_blocks(text: str) -> dict[str, object]:
    """The Python of a text in order, as one program; displacements of the markers are its reader's."""
    names: dict[str, object] = {"displacements": np.tile([0.0, 1.0, 0.0], (23, 1))}
    for block in python_blocks(text):
        exec(compile(block, str(README), "exec"), names)
    return names


def test_python_of_the_readme_runs(readers_folder):
    text = README.read_text(encoding="utf-8")
    assert len(python_blocks(text)) == text.count("```python") > 0
    names = run_blocks(text)
    assert names["result"].status == "ok"
    # Blocks that are taken out of the README take the claims about them along; what is there must have worked.
    for file in re.findall(r'write_capture\([^)]*"([^"]+)"\)', "".join(python_blocks(text))):
        assert evalkit.read_capture(readers_folder / file).frames == 600


def test_control_a_wrong_name_in_the_readme_is_noticed(readers_folder):
    text = README.read_text(encoding="utf-8")
    with pytest.raises(AttributeError, match="read_captures"):
        run_blocks(text.replace("evalkit.read_capture(", "evalkit.read_captures("))
