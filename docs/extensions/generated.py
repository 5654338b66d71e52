"""Parts of pages that are made from evalkit's own tables when the site is built, so that they cannot go stale.

A line ``% generated: NAME ARGUMENTS`` in a page is replaced by the Markdown of the function of that name below.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import inspect
import json
import pkgutil
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import click
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.nodes import make_refnode

log = logging.getLogger(__name__)

ROOT = Path(__file__).resolve().parents[2]
LINE = re.compile(r"^% generated: (\S+) ?(.*)$", re.MULTILINE)


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", r"\|") for cell in line) + " |" for line in lines)


def methods(kind: str) -> str:
    """Own estimators of a kind, ``pose`` or ``pivot``, with a line each."""
    own = import_module(f"evalkit.{kind}").OWN
    return table(
        ("name", "method", "source"), [(f"`{name}`", entry.summary, entry.source) for name, entry in own.items()]
    )


def kernels() -> str:
    """Kernels of the deformation map."""
    own = import_module("evalkit.deform.kernels").OWN
    rows = []
    for name, kernel in own.items():
        phi = (inspect.getdoc(kernel.phi) or "").rstrip(".") if kernel.phi else "no radial functions"
        order = "" if kernel.order is None else kernel.order
        rows.append((f"`{name}`", phi, kernel.degree, order, kernel.scale or "", kernel.summary, kernel.source))
    header = ("name", "phi(r)", "degree", "order", "scale, eye distances", "what it is", "source")
    return table(header, rows)


def searches() -> str:
    """Searches of a motion database."""
    own = import_module("evalkit.control.search").searchers
    rows = [
        (f"`{name}`", method.text, "yes" if method.exact else "no", method.package, method.source)
        for name, method in own.items()
    ]
    return table(("search", "what it does", "always the nearest", "needs", "source"), rows)


def presets() -> str:
    """Presets of synthetic takes."""
    own = import_module("evalkit.synthetic.presets").OWN
    return table(("preset", "what it is"), [(f"`{name}`", preset.text) for name, preset in own.items()])


def parameters() -> str:
    """Parameters of synthetic takes, as ``--set`` takes them."""
    fields = import_module("evalkit.synthetic.parameters").FIELDS
    rows = [(f"`{name}`", field.group, field.unit, field.text) for name, field in fields.items()]
    return table(("parameter", "part", "unit", "meaning"), rows)


def studies() -> str:
    """Every study: question, finding, axes, methods, command."""
    parts = []
    package = import_module("evalkit.studies")
    for module, study in zip(package.MODULES, package.studies.values(), strict=True):
        axes = "; ".join(f"`{axis}`: {', '.join(map(str, values))}" for axis, values in study.axes.items())
        listed = ", ".join(f"`{method}`" for method in study.methods)
        parts.append(
            f"(study-{study.name})=\n## {study.name}\n\n"
            f"**Question.** {_sentence(study.question)}\n\n**Finding.** {_sentence(study.finding)}\n\n"
            f"**Axes.** {axes or 'none'}. Full budget: {study.full.seeds} seeds.\n\n**Methods.** {listed}\n\n"
            f"```console\n$ evalkit study run {study.name} --budget full\n"
            f"$ python -m evalkit.studies.{module} --budget full\n```\n"
        )
    return "\n".join(parts)


def _sentence(text: str) -> str:
    text = " ".join(text.split())
    return text[:1].upper() + text[1:]


def commands() -> str:
    """The help of every command, as the command line prints it."""
    from evalkit.cli import app

    parts = []

    def tell(command: click.Command, name: str, parent: click.Context | None, level: int) -> None:
        settings = {"max_content_width": 100, "terminal_width": 100, "help_option_names": ["-h", "--help"]}
        context = click.Context(command, info_name=name.rpartition(" ")[2], parent=parent, **settings)
        label = "command-" + name.replace(" ", "-")
        parts.append(f"({label})=\n{'#' * level} {name}\n\n```text\n{command.get_help(context)}\n```\n")
        if isinstance(command, click.Group):
            for child in command.list_commands(context):
                tell(command.commands[child], f"{name} {child}", context, min(level + 1, 3))

    tell(app, "evalkit", None, 2)
    return "\n".join(parts)


def figures() -> str:
    """Every figure of ``paper_figures/`` with its caption and command."""
    folder = ROOT / "paper_figures"
    names = list(import_module("evalkit.figures").figures)
    parts = []
    for name in names:
        facts = folder / f"{name}.json"
        picture = next((p for p in (folder / f"{name}.svg", folder / f"{name}.png") if p.exists()), None)
        if not facts.exists() or picture is None:
            continue
        known = json.loads(facts.read_text(encoding="utf-8"))
        files = [path for path in sorted(folder.glob(f"{name}.*")) if path != picture]
        links = ", ".join(f"{{download}}`{p.suffix[1:].upper()} <../../paper_figures/{p.name}>`" for p in files)
        parts.append(
            f"(figure-{name})=\n## {name}\n\n```{{image}} ../../paper_figures/{picture.name}\n:alt: {name}\n```\n\n"
            f"{_sentence(known['caption'])}\n\n```console\n$ {known['command']}\n```\n\nData: {links}\n"
        )
    return "\n".join(parts) if parts else "No figure has been drawn yet: `evalkit figures` draws them."


def public() -> str:
    """Every public name, by kind."""
    evalkit = import_module("evalkit")
    kinds: dict[str, list[str]] = {"autofunction": [], "autoclass": [], "autoexception": [], "autodata": []}
    for name in sorted(evalkit.__all__, key=str.lower):
        value = getattr(evalkit, name)
        if inspect.isclass(value):
            kind = "autoexception" if issubclass(value, Exception) else "autoclass"
        else:
            kind = "autofunction" if inspect.isfunction(value) else "autodata"
        kinds[kind].append(name)
    headings = {"autofunction": "Functions", "autoclass": "Classes", "autoexception": "Errors", "autodata": "Tables"}
    parts = []
    for kind, heading in headings.items():
        parts.append(f"## {heading}\n\n```{{eval-rst}}")
        for name in kinds[kind]:
            members = "   :members:\n" if kind == "autoclass" else ""
            parts.append(
                f".. {kind}:: evalkit.{name}\n{members}   :no-value:\n"
                if kind == "autodata"
                else f".. {kind}:: evalkit.{name}\n{members}"
            )
        parts.append("```\n")
    return "\n".join(parts)


def modules(*names: str) -> str:
    """Docstrings of modules and of what each defines; public names of evalkit stand on their own page."""
    public_ones = set(import_module("evalkit").__all__)
    parts = []
    for name in names:
        for module in _with_children(name):
            own = [n for n in _defined(module) if not (n in public_ones and _is_public(module, n))]
            members = f"   :members: {', '.join(own)}\n" if own else "   :no-members:\n"
            parts.append(f"## {module}\n\n```{{eval-rst}}\n.. automodule:: {module}\n{members}```\n")
    return "\n".join(parts)


def _is_public(module: str, name: str) -> bool:
    return getattr(import_module("evalkit"), name) is getattr(import_module(module), name)


def _defined(module: str) -> list[str]:
    """Functions, classes and explained constants that a module's own source defines, in its order."""
    body = ast.parse(inspect.getsource(import_module(module))).body
    found = []
    for statement, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(statement, ast.FunctionDef | ast.ClassDef):
            found.append(statement.name)
        explained = isinstance(after, ast.Expr) and isinstance(getattr(after.value, "value", None), str)
        alias = isinstance(getattr(statement, "value", None), ast.Subscript)  # of a type: its words are NumPy's
        if explained and not alias and isinstance(statement, ast.Assign | ast.AnnAssign):
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            found += [target.id for target in targets if isinstance(target, ast.Name)]
    return [name for name in found if not name.startswith("_")]


def _with_children(name: str) -> list[str]:
    module = import_module(name)
    found = [name]
    for child in pkgutil.iter_modules(getattr(module, "__path__", [])):
        if not child.name.startswith("_") and not child.ispkg:
            found.append(f"{name}.{child.name}")
    return found


def changelog() -> str:
    """The changelog of the project."""
    path = ROOT / "CHANGELOG.md"
    return path.read_text(encoding="utf-8") if path.exists() else "# Changelog\n\nNothing has been released yet."


def tutorials() -> str:
    """The notebooks that there are."""
    listed = sorted(path.stem for path in (ROOT / "notebooks").glob("*.ipynb"))
    entries = "\n".join(listed)
    return f"```{{toctree}}\n:maxdepth: 1\n\n{entries}\n```" if listed else ""


GENERATORS: dict[str, Callable[..., str]] = {
    function.__name__: function
    for function in (
        methods, kernels, searches, presets, parameters, studies, commands, figures, public, modules, changelog,
        tutorials,
    )
}  # fmt: skip


def replace(app: Sphinx, page: str, source: list[str]) -> None:
    """Put the generated parts into a page."""

    def made(found: re.Match[str]) -> str:
        name, arguments = found[1], found[2].split()
        if name not in GENERATORS:
            log.warning("nothing generates '%s'", name, location=page)
            return ""
        return GENERATORS[name](*arguments)

    if app.env.doc2path(page).suffix == ".md":
        source[0] = LINE.sub(made, source[0])


def resolve(app: Sphinx, env: Any, node: Any, content: Any) -> Any:
    """Follow a reference to where the thing is documented: under its public name, or in the module that defines it.

    What exists but has no entry (a constant without words of its own, another project's class) stays plain text, since
    inventories of other projects would have to be fetched. What does not exist remains a warning.
    """
    if node.get("refdomain") != "py":
        return None
    target, module, owner = node["reftarget"].lstrip("."), node.get("py:module"), node.get("py:class")
    places = [target, f"{module}.{target}", f"{module}.{owner}.{target}", *(f"{m}.{target}" for m in _documented(env))]
    for place in places:
        found = _import(place)
        if found is None:
            continue
        domain = env.domains["py"]
        names = [f"{getattr(found, '__module__', None)}.{getattr(found, '__qualname__', None)}"]
        names.append(f"evalkit.{place.rpartition('.')[2]}")
        for name in names:
            if name in domain.objects and _import(name) is found:
                entry = domain.objects[name]
                return make_refnode(app.builder, node["refdoc"], entry.docname, entry.node_id, content, name)
        return content
    return None


def _documented(env: Any) -> list[str]:
    """Modules that have an entry."""
    return list(env.domains["py"].modules)


@functools.cache
def _import(path: str) -> Any:
    """What a dotted path stands for in evalkit or in a module that is loaded, or None."""
    parts = path.split(".")
    found: Any = None
    for end in range(1, len(parts) + 1):
        name = ".".join(parts[:end])
        with contextlib.suppress(ImportError, KeyError):  # a page may have been read in another process
            found = import_module(name) if parts[0] == "evalkit" else sys.modules[name]
            continue
        break
    else:
        return found
    for part in parts[end - 1 :]:
        # Attributes of a dataclass without a default are annotations only.
        annotated = part in getattr(found, "__annotations__", {})
        found = getattr(found, part, part if annotated else None)
    return found


def plain_citations(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Numbered sources of modules and constants as plain text: numpydoc does it for functions and classes alone."""
    if what not in ("module", "data"):
        return
    text = re.sub(r"(\[\d+\])_", r"\1", "\n".join(lines))
    text = re.sub(r"^([A-Z]\w+)\n-{4,}$", r".. rubric:: \1\n", text, flags=re.MULTILINE)
    lines[:] = re.sub(r"^\.\. (\[\d+\])", r"\n\1", text, flags=re.MULTILINE).replace("\n   ", "\n").split("\n")


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to the reading of pages."""
    app.connect("source-read", replace)
    app.connect("missing-reference", resolve)
    app.connect("autodoc-process-docstring", plain_citations, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
