"""Pictures without a screen: what they show, and what is said where none can be drawn."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from realdata import real_data

import evalkit
from evalkit.errors import EvalkitError
from evalkit.render import offscreen, pivot_scene_png, require_offscreen
from evalkit.render.markers import head_columns, median_places
from evalkit.render.pivot_scene import LONGEST_MM, ellipsoid_surface, pivot_ellipsoid

APT = r"sudo apt-get install libegl1 libgl1-mesa-dri"


@pytest.fixture
def drawing() -> None:
    """Skip where nothing can be drawn."""
    try:
        require_offscreen()
    except EvalkitError as error:
        pytest.skip(str(error))


def test_importing_the_package_does_not_load_vtk() -> None:
    code = "import sys, evalkit.render; sys.exit('vtkmodules' in sys.modules or 'pyvista' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parents[1]).returncode == 0


def test_a_missing_library_is_one_line_with_the_apt_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offscreen, "EGL_LIBRARY", "libEGL-that-is-not-there.so.1")
    with pytest.raises(EvalkitError, match=APT) as caught:
        require_offscreen()
    assert "libEGL-that-is-not-there.so.1 is missing" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("probe", "reason"),
    [
        ("import sys; sys.exit('EGL finds no driver to draw with')", "no driver"),
        ("import os; os.abort()", "crashes"),
    ],
)
def test_a_driver_that_fails_or_crashes_does_not_take_the_process_along(
    monkeypatch: pytest.MonkeyPatch, probe: str, reason: str
) -> None:
    monkeypatch.setattr(offscreen, "PROBE", probe)
    offscreen._probe.cache_clear()
    with pytest.raises(EvalkitError, match=reason):
        require_offscreen()
    offscreen._probe.cache_clear()


def test_with_egl_hidden_the_process_survives() -> None:
    """The real thing: the library hidden from a process by a mount of its own."""
    library = next(iter(sorted(Path("/usr/lib").glob("*-linux-gnu/libEGL.so.1"))), None)
    unshare = shutil.which("unshare")
    if library is None or unshare is None:
        pytest.skip("no libEGL.so.1 or no unshare to hide it with")
    if subprocess.run([unshare, "-m", "true"], capture_output=True).returncode:
        pytest.skip("mounts cannot be unshared without privileges")
    code = (
        "import evalkit\nfrom evalkit.render import offscreen_plotter\n"
        "try:\n    with offscreen_plotter(8, 8): pass\nexcept evalkit.EvalkitError as error: print(error)"
    )
    done = subprocess.run(
        [unshare, "-m", "sh", "-c", 'mount --bind /dev/null "$1" && exec "$2" -c "$3"',
         "sh", library, sys.executable, code],
        capture_output=True, text=True, cwd=Path(__file__).parents[1],
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "libegl1 libgl1-mesa-dri" in done.stdout


@pytest.mark.parametrize("preset", ["talking", "single-axis"])
def test_picture_shows_markers_and_pivot(drawing: None, tmp_path: Path, preset: str) -> None:
    take, truth = evalkit.synthesize(preset, seed=0)
    caption = pivot_scene_png(evalkit.compensate(take, truth.rigid), tmp_path / "a.png", take=take)
    image = matplotlib.image.imread(tmp_path / "a.png")[:, :, :3]
    assert image.shape == (800, 1600, 3)
    for view in (image[:, :800], image[:, 800:]):
        red, green, blue = np.moveaxis(view, 2, 0)
        assert ((red - blue > 0.3) & (red - green > 0.15)).sum() > 100, "rigid markers"
        assert (blue - red > 0.3).sum() > 500, "other markers"
        assert (view.max(axis=2) < 0.1).sum() > 300, "pivot, names and scale bar"
        assert (view.min(axis=2) > 0.99).mean() > 0.7, "white background"
    assert ("not observable" in caption) == (preset == "single-axis")


def test_whole_body_picture_is_restricted_to_the_head(drawing: None, tmp_path: Path) -> None:
    take = evalkit.read_capture(real_data("captures", "pycgm_movement_trial.c3d"))
    result = evalkit.compensate(take, ["LFHD", "RFHD", "LBHD", "RBHD"])
    columns = head_columns(take, result)
    assert {take.quantities[c] for c in columns} == {"position"}
    assert set(result.rigid) <= {take.labels[c] for c in columns}
    assert len(columns) < 40
    assert "not drawn" in pivot_scene_png(result, tmp_path / "a.png", take=take)


def test_ellipsoid_has_the_covariance_and_is_cut() -> None:
    take, truth = evalkit.synthesize("talking", seed=0)
    result = evalkit.compensate(take, truth.rigid)
    corners, faces = ellipsoid_surface(pivot_ellipsoid(result), result.pivot)
    offset = corners - result.pivot
    # Every corner lies two standard deviations out.
    mahalanobis = np.einsum("vi,ij,vj->v", offset, np.linalg.inv(result.pivot_covariance), offset)
    np.testing.assert_allclose(mahalanobis, 4.0, rtol=1e-6)
    assert faces.max() < len(corners)
    take, truth = evalkit.synthesize("single-axis", seed=0)
    result = evalkit.compensate(take, truth.rigid)
    shape = pivot_ellipsoid(result)
    assert shape.clipped.tolist() == [True, False, False]
    assert shape.half[0] == LONGEST_MM


def test_markers_never_seen_have_no_place() -> None:
    points = np.ones((4, 2, 3))
    points[:, 1] = np.nan
    places = median_places(points)
    assert np.isnan(places[1]).all()
    assert (places[0] == 1).all()


def test_a_picture_that_cannot_be_written_is_an_error(drawing: None, tmp_path: Path) -> None:
    take, truth = evalkit.synthesize("talking", seed=0)
    with pytest.raises(EvalkitError, match="cannot write the picture"):
        pivot_scene_png(evalkit.compensate(take, truth.rigid), tmp_path / "no" / "a.png")
