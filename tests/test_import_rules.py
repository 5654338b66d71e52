"""Who may import whom, read from the source; and that importing evalkit stays cheap."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "evalkit"

LEVELS = [
    {"errors", "seeds", "geometry", "bundled", "plugins"},
    {"capture", "synthetic", "meshes"},
    {"pose", "pivot", "peers"},
    {"compensation", "published", "leak", "deform", "transfer", "control", "vision", "head", "animation", "results"},
    {"metrics", "dense"},
    {"study", "render"},
    {"figures", "studies"},
    {"cli", "editor", "report", "__main__"},
]
"""Parts of the package from the bottom up: imports go down, or stay within a level."""

JUDGED = {
    "capture",
    "pose",
    "pivot",
    "peers",
    "compensation",
    "published",
    "leak",
    "deform",
    "transfer",
    "control",
    "vision",
    "head",
    "animation",
    "geometry",
}
JUDGES = {"synthetic", "dense", "metrics"}
"""Methods never see the truth nor what judges them."""

HEAVY = {"vtk", "vtkmodules", "pyvista", "nlopt", "matplotlib", "scipy", "pandas", "plotly"}


def level_of(part: str) -> int:
    for level, parts in enumerate(LEVELS):
        if part in parts:
            return level
    raise LookupError(f"evalkit.{part} has no level in {Path(__file__).name}: add it where it belongs")


def imported_parts(source: str, package: str) -> set[tuple[str, str]]:
    """(part, name) of every import of evalkit in a module, wherever it stands, relative ones included.

    The name is what is imported from the root or a part, so that ``from evalkit import synthesize`` counts as
    an import of the part that it comes from.
    """
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            dotted = [(alias.name, "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                home = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*home, *([base] if base else [])])
            dotted = [(base, alias.name) for alias in node.names]
        else:
            continue
        for module, name in dotted:
            root, *rest = module.split(".")
            if root == "evalkit":
                found.add((rest[0] if rest else name, name))
    return found


def breaches(part: str, source: str, package: str = "evalkit") -> list[str]:
    """What in a module of this part is against the rules."""
    from evalkit import _HOMES

    found = []
    for other, name in imported_parts(source, package):
        # A public name of the root stands for the part that it is loaded from; its version for nothing.
        target = _HOMES[other].split(".")[1] if other in _HOMES else other
        if target in ("", part, "__version__", "EvalkitError", "CaptureError", "FrameStatus"):
            continue
        if level_of(target) > level_of(part):
            found.append(f"imports up: evalkit.{part} -> evalkit.{target} ({name})")
        if part in JUDGED and target in JUDGES:
            found.append(f"a method sees the truth: evalkit.{part} -> evalkit.{target} ({name})")
        if "Truth" in name and part in JUDGED:
            found.append(f"a method sees the truth: evalkit.{part} imports {name}")
    return found


def modules() -> list[Path]:
    return [path for path in sorted(PACKAGE.rglob("*.py")) if path != PACKAGE / "__init__.py"]


@pytest.mark.parametrize("path", modules(), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_imports_go_down_and_methods_do_not_see_the_truth(path):
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    package = ".".join(["evalkit", *parts[:-1]])
    assert breaches(parts[0], path.read_text(encoding="utf-8"), package) == []


@pytest.mark.parametrize(
    ("part", "source", "package"),
    [
        ("pose", "from evalkit.synthetic import synthesize", "evalkit.pose"),
        ("pivot", "def f():\n    from evalkit.metrics import rms", "evalkit.pivot"),
        ("pivot", "import evalkit.synthetic.truth", "evalkit.pivot"),
        ("pose", "from evalkit import synthesize", "evalkit.pose"),
        ("pose", "from ..synthetic import synthesize", "evalkit.pose"),
        ("pivot", "from .. import metrics", "evalkit.pivot"),
        ("capture", "from evalkit.synthetic.truth import Truth", "evalkit.capture"),
        ("geometry", "from evalkit.pose import svd", "evalkit"),
        ("pose", "from evalkit.compensation import compensate", "evalkit.pose"),
        ("compensation", "from evalkit.report import write_report", "evalkit"),
        ("metrics", "from evalkit.render import pictures", "evalkit"),
    ],
)
def test_control_forbidden_imports_are_noticed(part, source, package):
    assert breaches(part, source, package)


@pytest.mark.parametrize(
    ("part", "source", "package"),
    [
        ("pose", "import numpy\nfrom evalkit.geometry import Array\nfrom .model import Pose", "evalkit.pose"),
        ("pivot", "from evalkit.pose import Pose", "evalkit.pivot"),
        ("metrics", "from evalkit.synthetic import Truth", "evalkit"),
        ("synthetic", "import evalkit\nfrom evalkit import __version__", "evalkit.synthetic"),
        ("cli", "from evalkit import compensate, synthesize", "evalkit.cli"),
    ],
)
def test_control_allowed_imports_pass(part, source, package):
    assert breaches(part, source, package) == []


def test_control_an_unknown_part_must_be_given_a_level():
    with pytest.raises(LookupError, match="no level"):
        breaches("pose", "from evalkit.unheard_of import thing")


def loaded_by(statement: str) -> set[str]:
    """Top-level modules that a fresh interpreter has loaded after a statement."""
    code = f"import sys\n{statement}\nprint(' '.join(sorted({{name.split('.')[0] for name in sys.modules}})))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=PACKAGE.parent, check=True)
    return set(run.stdout.split())


def test_importing_evalkit_loads_nothing_heavy():
    assert loaded_by("import evalkit") & HEAVY == set()
    # Control: the measure sees what is loaded.
    assert "scipy" in loaded_by("import evalkit, scipy.linalg")


def test_reading_and_compensating_need_no_pictures():
    statement = (
        "import evalkit, numpy as np\n"
        "take = evalkit.Capture(np.random.default_rng(0).normal(size=(9, 4, 3)), list('abcd'), 60.0)\n"
        "evalkit.compensate(take, rigid=list('abcd'), pivot='score')"
    )
    assert loaded_by(statement) & {"vtk", "vtkmodules", "pyvista", "matplotlib", "plotly", "pandas"} == set()


def test_public_names_are_there():
    import evalkit

    assert set(evalkit.__all__) <= set(dir(evalkit))
    for name in evalkit.__all__:
        assert getattr(evalkit, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'unheard_of'"):
        evalkit.unheard_of  # noqa: B018
