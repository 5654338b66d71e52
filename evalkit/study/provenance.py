"""Where the numbers of a table come from: code, packages, machine, data."""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
import os
import platform
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

from evalkit import __version__
from evalkit.deform.kernels import kernels
from evalkit.pivot import pivot_estimators
from evalkit.pose import pose_estimators
from evalkit.study.description import Study

PACKAGE = Path(__file__).resolve().parents[1]


def fingerprint(study: Study) -> str:
    """SHA-256 of what may change a study's numbers: evalkit's source, the study's own, packages, data files.

    The budget and the axes' values are not in it: a larger budget goes on from a smaller one.
    """
    facts = {
        "study": study.name,
        "source": source_digest(),
        "outside": _outside(study),
        "python": platform.python_version(),
        "packages": packages(),
        "origins": origins(study),
        "data": data_files(study),
    }
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


@functools.cache
def source_digest() -> str:
    """SHA-256 over the source files of evalkit, names and contents."""
    digest = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py")):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _outside(study: Study) -> str:
    """SHA-256 of the study's own source file if that is not a part of evalkit."""
    try:
        path = Path(inspect.getfile(study.prepare)).resolve()
        return "" if PACKAGE in path.parents else hashlib.sha256(path.read_bytes()).hexdigest()
    except (TypeError, OSError):
        return ""


@functools.cache
def packages() -> dict[str, str]:
    """Installed versions of everything that evalkit names among its requirements, peers and other extras included."""
    try:
        required = metadata.requires("evalkit") or []
    except metadata.PackageNotFoundError:
        required = ["numpy", "scipy", "nlopt"]
    found = {}
    for line in required:
        name = re.split(r"[^A-Za-z0-9_.-]", line, maxsplit=1)[0]
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return dict(sorted(found.items()))


def origins(study: Study) -> dict[str, str]:
    """Package and version that a method comes from, of those that are peers or plugins."""
    entries: dict[str, Any] = {**pose_estimators, **pivot_estimators, **kernels}
    return {method: entries[method].origin for method in study.methods if method in entries and entries[method].origin}


def data_files(study: Study) -> dict[str, str]:
    """SHA-256 of every file that is named as the value of an axis."""
    found = {}
    for values in study.axes.values():
        for value in values:
            if isinstance(value, str) and Path(value).is_file():
                found[value] = hashlib.sha256(Path(value).read_bytes()).hexdigest()
    return found


def provenance(study: Study) -> dict[str, Any]:
    """The facts that stand beside a study's table, as JSON types."""
    return {
        "study": study.name,
        "question": study.question,
        "axes": {axis: list(values) for axis, values in study.axes.items()},
        "methods": list(study.methods),
        "seeds": list(range(study.full.seeds)),
        "columns": dict(study.columns),
        "machine_columns": {"seconds": "wall time of the method's run, s", **study.machine},
        "statistics": {statistic.name: statistic.text for statistic in study.statistics},
        "fingerprint": fingerprint(study),
        **environment(),
        "origins": origins(study),
        "threads_per_cell": 1,
        "data_sha256": data_files(study),
    }


def environment() -> dict[str, Any]:
    """The code, the packages and the machine that this process runs with, as JSON types."""
    from threadpoolctl import threadpool_info

    commit, dirty = _commit()
    return {
        "evalkit": {"version": __version__, "commit": commit, "dirty": dirty, "source_sha256": source_digest()},
        "packages": packages(),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cpu": _processor(),
        "cores": os.cpu_count(),
        "blas": [
            {key: info.get(key) for key in ("internal_api", "version", "architecture")} for info in threadpool_info()
        ],
    }


def _commit() -> tuple[str | None, bool | None]:
    """Commit of the checkout that evalkit is imported from, and whether its files differ; None outside of one."""
    try:
        root = _git("rev-parse", "--show-toplevel").strip()
        if Path(root) != PACKAGE.parent:
            return None, None  # installed into an environment that lies inside somebody else's checkout
        return _git("rev-parse", "HEAD").strip(), bool(_git("status", "--porcelain", "--", "evalkit", "data"))
    except (OSError, subprocess.SubprocessError):
        return None, None


def _git(*arguments: str) -> str:
    run = subprocess.run(
        ["git", *arguments], cwd=PACKAGE.parent, capture_output=True, text=True, check=True, timeout=30
    )
    return run.stdout


def _processor() -> str:
    """Model name of the processor."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or sys.platform
