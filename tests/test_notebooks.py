"""Notebooks: stored clean, each asserts a value, they name only what exists; one is run, `make notebooks` runs all."""

from __future__ import annotations

import ast
import re
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

from evalkit.figures import figures
from evalkit.studies import studies

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
SHORT = "07_your_own_estimator"
"""Executed here: it draws nothing and starts no processes."""

METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
CLEAN = (
    "jupyter nbconvert --inplace --ClearOutputPreprocessor.enabled=True --ClearMetadataPreprocessor.enabled=True "
    "notebooks/*.ipynb"
)
"""What takes outputs, counts and metadata out of a notebook that was saved in JupyterLab."""


def read(path):
    return nbformat.read(path, as_version=4)


def code(book):
    return [cell.source for cell in book.cells if cell.cell_type == "code"]


def prose(book):
    return "\n".join(cell.source for cell in book.cells if cell.cell_type == "markdown")


every = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def test_they_are_numbered_and_there():
    assert [path.name[:3] for path in NOTEBOOKS] == [f"{k:02d}_" for k in range(1, len(NOTEBOOKS) + 1)]
    assert len(NOTEBOOKS) >= 7


# --- stored clean ------------------------------------------------------------------------------------------


def stains(book):
    """What a notebook must not be stored with."""
    found = [f"metadata {name}" for name in {*book.metadata} - {*METADATA}]
    found += [f"metadata {name}" for name in METADATA if book.metadata.get(name, METADATA[name]) != METADATA[name]]
    for cell in book.cells:
        if cell.metadata:
            found.append(f"{cell.id}: metadata")
        if cell.cell_type == "code" and cell.outputs:
            found.append(f"{cell.id}: outputs")
        if cell.cell_type == "code" and cell.execution_count is not None:
            found.append(f"{cell.id}: execution count")
    return found


@every
def test_stored_without_outputs_counts_and_metadata(path):
    book = read(path)
    assert (book.nbformat, book.nbformat_minor) == (4, 5)
    nbformat.validate(book)
    assert not stains(book), f"clean it with: {CLEAN}"
    ids = [cell.id for cell in book.cells]
    assert len(set(ids)) == len(ids) and all(re.fullmatch(r"[a-z0-9-]+", name) for name in ids)


def test_control_stains_are_found():
    book = read(NOTEBOOKS[0])
    first = next(cell for cell in book.cells if cell.cell_type == "code")
    first.execution_count, first.metadata["collapsed"] = 3, True
    first.outputs = [nbformat.v4.new_output("stream", text="/home/me")]
    book.metadata["language_info"] = {"name": "python", "version": "3.11.7"}
    assert len(stains(book)) == 4


# --- each says what it teaches and asserts a value -------------------------------------------------------------


def asserted_values(source):
    """Assertions that compare something with something."""
    found = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Assert)]
    return [node for node in found if any(isinstance(part, ast.Compare) for part in ast.walk(node.test))]


@every
def test_begins_with_what_the_reader_will_learn_and_how_long_it_takes(path):
    first = read(path).cells[0]
    assert first.cell_type == "markdown" and first.source.startswith("# ")
    assert "**You will learn**" in first.source and "**Time:**" in first.source


@every
def test_asserts_a_value(path):
    assert sum(len(asserted_values(source)) for source in code(read(path))) >= 1


def test_control_assertions_on_no_value_do_not_count():
    assert not asserted_values("assert True\nassert found\nassert isinstance(a, int), 'a < b'\nif a < b:\n    pass")
    assert len(asserted_values("assert error_mm < 0.5\nassert (a == b).all()")) == 2


# --- only what exists and is public ------------------------------------------------------------------------


def imports(source):
    """(module, name) of every import of evalkit."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names if alias.name.split(".")[0] == "evalkit")
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "evalkit":
            yield from ((node.module, alias.name) for alias in node.names)


def exists(module, name):
    """Whether a module is there and has this attribute or submodule."""
    try:
        found = import_module(module)
    except ModuleNotFoundError:
        return False
    inside = hasattr(found, "__path__") and find_spec(f"{module}.{name}") is not None
    return not name or hasattr(found, name) or inside


def strange_imports(source):
    """Imports of evalkit that are private or do not exist, and private attributes that are used."""
    found = []
    for module, name in imports(source):
        parts = [*module.split("."), *([name] if name else [])]
        if any(part.startswith("_") for part in parts) or not exists(module, name):
            found.append(".".join(parts))
    names = (node.attr for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Attribute))
    return found + [name for name in names if name.startswith("_") and name != "__file__"]


@every
def test_imports_public_names_that_exist(path):
    assert not [name for source in code(read(path)) for name in strange_imports(source)]


def test_control_private_and_missing_names_are_found():
    source = "from evalkit.pose import _hidden, svd_of_old\nimport evalkit._secret\nresult._cache"
    assert len(strange_imports(source)) == 4


def studies_named(text):
    """Names after ``evalkit study run`` and keys of ``studies[...]``."""
    found = re.findall(r"studies\[\"([^\"]+)\"\]", text)
    for words in re.findall(r"evalkit study run ([^`\n]+)", text):
        # Names come first; what follows an option is its value.
        found += re.match(r"[a-z0-9 -]*?(?= --|$)", words).group().split()
    return set(found)


def figures_named(text):
    return set(re.findall(r"\bshow\(\"([^\"]+)\"", text))


@every
def test_studies_and_figures_that_are_named_exist(path):
    book = read(path)
    text = prose(book) + "\n" + "\n".join(code(book))
    assert studies_named(text) <= {*studies}
    assert figures_named(text) <= {*figures}


def test_control_names_are_found_in_text_and_code():
    text = '`evalkit study run skin old-study --budget full` and studies["gone"] and show("no-figure", \'small\')'
    assert studies_named(text) == {"skin", "old-study", "gone"} and figures_named(text) == {"no-figure"}


@every
def test_links_between_notebooks_lead_somewhere(path):
    links = re.findall(r"\]\((?!https?:)([^)#]+)", prose(read(path)))
    assert links and all((FOLDER / link).is_file() for link in links), links


# --- execution ---------------------------------------------------------------------------------------------


def execute(book, folder):
    """Run a notebook in a folder of no importance; what it wrote to the error stream."""
    NotebookClient(book, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(folder)}}).execute()
    outputs = [output for cell in book.cells if cell.cell_type == "code" for output in cell.outputs]
    return "".join(output.text for output in outputs if output.output_type == "stream" and output.name == "stderr")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_notebook_runs_from_any_folder_without_a_warning(tmp_path):
    assert execute(read(FOLDER / f"{SHORT}.ipynb"), tmp_path) == ""
    assert not [*tmp_path.iterdir()]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_control_a_failing_assertion_stops_the_execution(tmp_path):
    cells = ["error_mm = 0.1", "assert error_mm < 0.05, 'too far off'", "assert error_mm < 0.2"]
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source) for source in cells])
    with pytest.raises(CellExecutionError, match="too far off"):
        execute(book, tmp_path)
