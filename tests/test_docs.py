"""The documentation: recipes run, commands exist, numbers say where they come from, links lead somewhere."""

from __future__ import annotations

import json
import os
import re
import shlex
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import click
import pytest
from click.testing import CliRunner

import evalkit
from evalkit.cli import app
from evalkit.cli.synth import PERFORMER
from evalkit.control.database import build_database
from evalkit.deform.kernels import kernels
from evalkit.figures import figures
from evalkit.head.fit_report import FitReport
from evalkit.pivot import pivot_estimators
from evalkit.pose import pose_estimators
from evalkit.results import MOTION_COLUMNS, summary
from evalkit.studies import MODULES, studies
from evalkit.studies.control_takes import SETTINGS
from evalkit.studies.filmed import VIDEO_PRESETS, VideoParameters
from evalkit.study.command import options as study_options
from evalkit.study.table import SUMMARY_COLUMNS
from evalkit.synthetic import PRESETS
from evalkit.synthetic.parameters import FIELDS
from evalkit.synthetic.truth import ARRAYS

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md")), *sorted(DOCS.glob("*/*.md"))]
RECIPES = sorted((DOCS / "howto").glob("*.md"))
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)

page = pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))


# Commands ------------------------------------------------------------------------------------------------------------


def commands(text: str) -> list[tuple[str, bool]]:
    """Commands that a page shows, and whether each is complete: mentions within a line may leave arguments out."""
    found = []
    for language, body in FENCE.findall(text):
        for line in body.splitlines():
            if language in ("console", "sh", ""):
                found += [
                    (part.strip().removeprefix("$ "), True) for part in re.split(r"&&|;", line.partition(" #")[0])
                ]
    for span in re.findall(r"`([^`\n]+(?:\n[^`\n]+)?)`", FENCE.sub("", text)):
        found += [(part.strip(), False) for part in re.split(r"&&|;", " ".join(span.split()))]
    return [(text, whole) for text, whole in found if re.match(r"(evalkit |make |python -m evalkit\.)\S", text)]


def problem(text: str, whole: bool = True) -> str:
    """What is wrong with a command, empty if nothing is."""
    words = shlex.split(text, comments=True)
    if words[0] == "make":
        targets = set(re.findall(r"^([a-z][a-z-]*):", (ROOT / "Makefile").read_text(), re.MULTILINE))
        return ", ".join(f"no target {word}" for word in words[1:] if "=" not in word and word not in targets)
    try:
        if words[0] == "python":
            module = words[2].removeprefix("evalkit.studies.")
            if module == "NAME":
                return ""
            if module not in MODULES:
                return f"no study module {module}"
            command = study_options(click.Command("study", callback=lambda **_: None))
            given = command.make_context("study", words[3:]).params
            return wrong_names({**given, "names": (studies_by_module()[module],)}, "study run")
        command, path, rest = app, "", words[1:]
        while isinstance(command, click.Group) and rest and not rest[0].startswith("-"):
            if rest[0] == "COMMAND":
                return ""
            if rest[0] not in command.commands:
                return f"no command {path} {rest[0]}"
            command, path, rest = command.commands[rest[0]], f"{path} {rest[0]}".strip(), rest[1:]
        return wrong_names(command.make_context(path, list(rest)).params, path)
    except click.exceptions.Exit:  # --help and --version
        return ""
    except click.MissingParameter as error:
        return error.format_message() if whole else ""
    except click.UsageError as error:
        return error.format_message() if whole or "No such" in error.format_message() else ""


def studies_by_module() -> dict[str, str]:
    """Module of a study -> its name."""
    return dict(zip(MODULES, studies, strict=True))


def wrong_names(given: dict, path: str) -> str:
    """Names that are in no table: of studies, figures, presets, estimators, kernels, axes, methods, parameters."""
    tables = {
        "pose": pose_estimators, "pivot": pivot_estimators, "kernel": kernels,
        "preset": (*PRESETS, *VIDEO_PRESETS, PERFORMER),
        "names": figures if path == "figures" else studies, "name": studies if path == "study show" else None,
    }  # fmt: skip
    wrong = []
    for key, table in tables.items():
        value = given.get(key)
        # A word in capitals stands for a name; the presets of another package are its own.
        for name in value if isinstance(value, tuple) else (value,):
            if table is not None and isinstance(name, str) and not name.isupper() and name not in (*table, "example"):
                wrong.append(f"no {key} {name}")
    preset = given.get("preset")
    known = SETTINGS if preset == PERFORMER else vars(VideoParameters()) if preset in VIDEO_PRESETS else FIELDS
    wrong += [f"no parameter {s}" for s in given.get("settings") or () if s.partition("=")[0] not in known]
    if path == "study run":
        asked = [studies[name] for name in given["names"] if name in studies]
        for axis in given["axes"]:
            wrong += [f"{s.name} has no axis {axis}" for s in asked if axis.partition("=")[0] not in s.axes]
        for method in (given["methods"] or "").split(","):
            wrong += [f"{s.name} has no method {method}" for s in asked if method.strip() not in (*s.methods, "")]
    return ", ".join(wrong)


@page
def test_every_command_exists(path):
    shown = commands(path.read_text(encoding="utf-8"))
    wrong = {text: problem(text, whole) for text, whole in shown if problem(text, whole)}
    assert not wrong


@pytest.mark.parametrize(
    "text",
    [
        "evalkit compensat take.c3d -o out",
        "evalkit compensate take.c3d -o out --rigids A,B,C",
        "evalkit compensate take.c3d",
        "evalkit compensate take.c3d -o out --pose kabsh",
        "evalkit compensate take.c3d -o out --pivot scores",
        "evalkit head built",
        "evalkit synth talkin -o takes",
        "evalkit synth talking -o takes --set noises=1",
        "evalkit synth performer -o takes --set noise=1",
        "evalkit synth video-talkin -o videos",
        "evalkit synth video-talking -o videos --set sway=1",
        "evalkit study run pivot-nose",
        "evalkit study run pivot-noise --budget medium",
        "evalkit study run pivot-noise --axis sway_mm=1",
        "evalkit study run pivot-noise --methods joined",
        "evalkit study show pivot-nose",
        "evalkit figures pivot-nose",
        "python -m evalkit.studies.pivot_nose",
        "python -m evalkit.studies.pivot_noise --budgets full",
        "make demos",
    ],
)
def test_a_wrong_command_is_caught(text):
    assert problem(text)
    assert commands(f"```console\n$ {text}\n```\n") == [(text, True)]
    assert commands(f"Text with `{text}` in it.\n") == [(text, False)]


def test_most_commands_are_seen():
    """A pattern that matches nothing would let everything pass: some twenty pages show more than five each."""
    assert sum(len(commands(path.read_text(encoding="utf-8"))) for path in PAGES) > 100


# Numbers -------------------------------------------------------------------------------------------------------------

MEASURED = re.compile(r"(?<![\w.±])\d+(?:\.\d+)?(?: ?%| (?:mm|deg|times|µm|frames/s)\b)")
STATED = (
    "64.0 mm apart", "0.1 µm", "of 200 mm", "0.05 was aimed at", "0.1 mm", "10 mm off", "4 mm of", "2 mm of",
    "20 mm of", "0.3 mm of noise", "0.3 mm noise", "at 0.3 mm", "at 0.1, 0.3 and 1 mm", "5 % of the samples",
    "by 20 mm", "at 15 %", "(95 %)", "95 % ellipsoid", "0.1 s",
)  # fmt: skip
"""Conditions, limits and definitions: numbers that were chosen, not measured."""


def unexplained(text: str) -> list[str]:
    """Sections with numbers that look measured and no command that prints them."""
    text = re.sub(
        r"^(#+ .*)$", r"\0\1", FENCE.sub(lambda found: found[0] if commands(found[0]) else "", text), flags=re.M
    )
    wrong = []
    for section in text.split("\0"):
        bare = section
        for words in STATED:
            bare = re.sub(re.escape(words), "", bare, flags=re.IGNORECASE)
        if MEASURED.search(re.sub(r"`[^`]*`", "", FENCE.sub("", bare))) and not commands(section):
            wrong.append(section.strip().splitlines()[0])
    return wrong


@page
def test_numbers_have_their_command(path):
    assert not unexplained(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", ["choosing.md", "limits.md"])
def test_every_statement_has_its_own_command(name):
    """In the pages that others decide by, each list item and each row of a table."""
    text = (DOCS / "explanation" / name).read_text(encoding="utf-8")
    items = re.findall(r"^(?:- |\| [^-]).*(?:\n  .*)*", text, re.MULTILINE)
    assert len(items) > 10
    assert not [item for item in items if unexplained(item)]


def test_a_number_without_command_is_caught():
    assert unexplained("# Page\n\nIt is off by 0.17 mm.\n") == ["# Page"]
    assert unexplained("# Page\n\n| a | 7 deg |\n\n## Next\n\n`evalkit bench` prints it.\n") == ["# Page"]
    assert not unexplained("# Page\n\nIt is off by 0.17 mm (`evalkit study run pivot-noise`).\n")


# Recipes -------------------------------------------------------------------------------------------------------------


def run_recipe(text: str, folder: Path) -> None:
    """Run the blocks of Python and commands of a page in order."""
    names: dict = {"__name__": "recipe"}
    for language, body in FENCE.findall(text):
        if language == "python":
            exec(compile(body, "recipe", "exec"), names)
        elif language == "sh":
            for line in body.splitlines():
                words = shlex.split(line, comments=True)
                assert words[0] == "evalkit", f"only evalkit's commands are run: {line}"
                result = CliRunner().invoke(app, words[1:], catch_exceptions=False)
                assert result.exit_code == 0, f"{line}\n{result.output}"


HEAVY = ("add-kernel", "control-character", "drive-a-head", "import-head")
"""Recipes that build a head; ``make docs`` runs them, too."""


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=[pytest.mark.slow] if path.stem in HEAVY else []) for path in RECIPES],
    ids=lambda path: path.stem,
)
def test_recipe_runs(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    run_recipe(path.read_text(encoding="utf-8"), tmp_path)


def test_a_broken_recipe_fails(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(AssertionError):
        run_recipe("```python\nassert 1 == 2\n```\n", tmp_path)
    with pytest.raises(evalkit.EvalkitError):
        run_recipe("```sh\nevalkit study show pivot-nose\n```\n", tmp_path)


# File formats --------------------------------------------------------------------------------------------------------


def part(title: str) -> str:
    """A section of the page on files."""
    text = (DOCS / "reference" / "files.md").read_text(encoding="utf-8")
    return re.split(rf"^##+ {re.escape(title)}$", text, flags=re.MULTILINE)[1].split("\n##")[0]


def first_cells(text: str) -> list[str]:
    """Names in code in the first column of a table."""
    rows = [line.split("|")[1] for line in text.splitlines() if line.startswith("| `")]
    return [name for row in rows for name in re.findall(r"`([^`]+)`", row)]


def test_files_are_described_as_they_are_written(tmp_path):
    take, truth = evalkit.synthesize("talking", frames=90)
    result = evalkit.compensate(take, rigid=list(truth.rigid))
    written = summary(result)
    told = part("summary.json")
    assert first_cells(part("motion.csv")) == list(MOTION_COLUMNS)
    assert sorted(first_cells(told)) == sorted(written)
    inner = {key for name in ("input", "method", "pivot", "frames", "head", "rigid") for key in written[name]}
    assert not {key for key in inner if f"`{key}`" not in told}
    assert sorted(first_cells(part("truth.npz"))) == sorted([*ARRAYS, "facts"])
    assert not [column for column in SUMMARY_COLUMNS if f"`{column}`" not in part("What a study writes")]
    build_database([result.capture], tmp_path / "db", compensated=True, rigid=truth.rigid)
    manifest, told = json.loads((tmp_path / "db" / "takes.json").read_text()), part("takes.json")
    assert sorted(first_cells(told)) == sorted(manifest)
    assert not [key for key in (*manifest["options"], *manifest["takes"][0]) if f"`{key}`" not in told]
    assert sorted(first_cells(part("fit.json"))) == sorted(["points_from", *FitReport.__dataclass_fields__])


# The built site ------------------------------------------------------------------------------------------------------

SITE = os.environ.get("EVALKIT_SITE")
"""Where ``make docs`` has built the site; it runs these tests after it."""


class Links(HTMLParser):
    """What a page points to, and the places in it that can be pointed to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        known = dict(attrs)
        self.anchors |= {known[key] for key in ("id", "name") if known.get(key)}
        for key in ("href", "src", "data"):
            if known.get(key):
                self.links.append(known[key])
                if tag != "a" and known.get("rel") not in ("canonical",):
                    self.loaded.append(known[key])


def outside(link: str) -> bool:
    return bool(re.match(r"[a-z][a-z0-9+.-]*:|//", link))


def broken(site: Path) -> list[str]:
    """Internal links of a site that lead nowhere, and whatever it would load from elsewhere."""
    pages = {path.resolve(): Links(path.read_text(encoding="utf-8")) for path in sorted(site.rglob("*.html"))}
    wrong = []
    for path, found in pages.items():
        wrong += [
            f"{path.name}: loads {link}" for link in found.loaded if outside(link) and not link.startswith("data:")
        ]
        for link in found.links:
            if outside(link):
                continue
            target, _, anchor = unquote(link).partition("#")
            file = (path.parent / target.partition("?")[0]).resolve() if target else path
            if not file.is_file() or (anchor and file in pages and anchor not in pages[file].anchors):
                wrong.append(f"{path.name}: {link}")
    return wrong


@pytest.mark.skipif(not SITE, reason="make docs builds the site and runs this")
def test_links_of_the_site_lead_somewhere():
    site = Path(str(SITE))
    assert len(list(site.rglob("*.html"))) > 30
    assert not broken(site)


@pytest.mark.skipif(not SITE, reason="make docs builds the site and runs this")
def test_every_public_name_and_command_has_an_entry():
    reference = Path(str(SITE)) / "reference"
    public = Links((reference / "public.html").read_text(encoding="utf-8")).anchors
    assert not [name for name in evalkit.__all__ if f"evalkit.{name}" not in public]
    told = Links((reference / "commands.html").read_text(encoding="utf-8")).anchors
    assert not [name for name in app.commands if f"command-evalkit-{name}" not in told]
    listed = Links((reference / "studies.html").read_text(encoding="utf-8")).anchors
    assert not [name for name in studies if f"study-{name}" not in listed]


def test_a_broken_link_is_caught(tmp_path):
    (tmp_path / "a.html").write_text('<h1 id="top"></h1><a href="b.html#there">b</a><a href="https://x.org/">x</a>')
    (tmp_path / "b.html").write_text('<a href="a.html#top" id="there">a</a>')
    assert not broken(tmp_path)
    (tmp_path / "b.html").write_text(
        '<a href="a.html#bottom"></a><a href="c.html"></a><img src="d.png"><script src="https://x.org/x.js"></script>'
    )
    assert broken(tmp_path) == [
        "a.html: b.html#there", "b.html: loads https://x.org/x.js", "b.html: a.html#bottom", "b.html: c.html",
        "b.html: d.png",
    ]  # fmt: skip
