"""Where real captures are, for tests that want them: they are never part of the project."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


def real_data(*names: str) -> Path:
    """A file or folder of the real data; the test is skipped where there is none.

    The folder is ``EVALKIT_REAL_DATA``, or ``shared/data`` beside the project.
    """
    project = Path(__file__).resolve().parents[1]
    root = Path(os.environ.get("EVALKIT_REAL_DATA") or project.parent / "shared" / "data")
    path = root.joinpath(*names)
    if not path.exists():
        pytest.skip(f"no real data: {path} does not exist; set EVALKIT_REAL_DATA")
    return path


def real_captures() -> list[Path]:
    """Every real C3D file; the test is skipped where there are none."""
    files = sorted(real_data().glob("*/*.c3d"))
    if not files:
        pytest.skip("no real C3D files; set EVALKIT_REAL_DATA")
    return files
