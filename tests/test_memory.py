"""Memory of a whole compensation, reading included, as a multiple of the positions: each in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import peak_memory
import pytest

LIMIT = 4.0
"""Peak over the size of the positions: the file's bytes (two thirds), the positions, the result's, and some to work."""

FIXED_MB = 20.0
"""What does not grow with the take: modules loaded late, blocks of frames, the allocator's arenas. It is left out at a
million frames, where it would be a thirtieth of the positions."""

pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="peak memory is read from /proc")


def measured(way: str, path: Path) -> dict[str, float]:
    script = Path(peak_memory.__file__)
    done = subprocess.run([sys.executable, script, path, way], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    path = tmp_path_factory.mktemp("memory") / "take.c3d"
    peak_memory.long_capture(path, 60_000, gaps=0.02)
    return path


@pytest.mark.parametrize("way", ["score", "command-score"])
def test_memory_stays_below_four_times_the_positions(capture, way, record_property):
    found = measured(way, capture)
    record_property("peak", found)
    assert found["ok"] > 50_000
    assert found["peak_mb"] < LIMIT * found["positions_mb"] + FIXED_MB


def test_hoarding_is_noticed(capture):
    """Control: the same run that keeps four copies of the positions."""
    found = measured("hoard-score", capture)
    assert found["peak_mb"] > LIMIT * found["positions_mb"] + FIXED_MB


@pytest.mark.slow
@pytest.mark.parametrize("way", [*peak_memory.WAYS, *peak_memory.COMMANDS])
def test_memory_of_a_million_frames(tmp_path, way, record_property):
    path = tmp_path / "take.c3d"
    peak_memory.long_capture(path, 1_000_000, gaps=0.02)
    found = measured(way, path)
    print(way, found)
    record_property("peak", found)
    assert found["ok"] > 900_000
    assert found["peak_mb"] < LIMIT * found["positions_mb"]
