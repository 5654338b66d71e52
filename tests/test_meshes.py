"""Mesh files: read as they are, written back with other positions and nothing else changed."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest
import trimesh
from small_meshes import dome, expressions, write_glb, write_obj, write_ply

from evalkit.errors import EvalkitError
from evalkit.meshes import read_mesh_file
from evalkit.meshes.gltf import _Document
from evalkit.meshes.model import Mesh, check_same_faces, seams_welded, welded
from evalkit.seeds import generator

FORMS = ("ascii", "binary_little_endian", "binary_big_endian")
SINGLE = 2.0**-23
"""Rounding of numbers stored in single precision, over values up to 2."""


def test_obj_keeps_every_line_but_positions_and_normals(tmp_path):
    v, quads = dome()
    write_obj(tmp_path / "a.obj", v, quads)
    mesh = read_mesh_file(tmp_path / "a.obj")
    assert (mesh.sizes == 4).all() and (mesh.corners.reshape(-1, 4) == quads).all()
    places = mesh.vertices * np.pi
    text = mesh.rewritten(places, {})
    (tmp_path / "b.obj").write_bytes(text)
    again = read_mesh_file(tmp_path / "b.obj")
    # To the last bit: a position is written with all the digits it takes.
    assert np.array_equal(again.vertices, places)
    check_same_faces(mesh, again)
    before, after = (tmp_path / "a.obj").read_bytes().split(b"\n"), text.split(b"\n")
    kept = [line for line in before if not line.startswith((b"v ", b"vn ", b"f "))]
    assert kept == [line for line in after if not line.startswith((b"v ", b"f "))]
    assert all(line.endswith(b"\r") for line in after[:-1])
    assert after[-2] == before[-2].replace(b"/121", b"")


def test_obj_counts_back_continues_lines_and_keeps_colours(tmp_path):
    path = tmp_path / "odd.obj"
    path.write_bytes(b"v 0 0 0 1 0.5 0\nv 1 0 \\\n 0 0 1 0\n  v 1 1 0\nf -3 -2 -1 # all\nv 0 1 0\nf 1//1 3//1 -1//1\n")
    mesh = read_mesh_file(path)
    assert mesh.corners.tolist() == [0, 1, 2, 0, 2, 3]
    text = mesh.rewritten(mesh.vertices + 1.0, {}).decode()
    assert "v 1.0 1.0 1.0 1 0.5 0\n" in text and "f 1 3 -1\n" in text and "f -3 -2 -1 # all" in text


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("mixed", [False, True])
def test_ply_keeps_all_but_positions_and_normals(tmp_path, form, mixed):
    v, quads = dome()
    faces = quads.tolist()
    if mixed:
        faces[3:4] = [faces[3][:3], [faces[3][0], *faces[3][2:]]]
    write_ply(tmp_path / "a.ply", v, faces, form)
    mesh = read_mesh_file(tmp_path / "a.ply")
    assert np.abs(mesh.vertices - v).max() <= (0.0 if form == "ascii" else SINGLE)
    assert mesh.corners.tolist() == [c for face in faces for c in face]
    places = np.float32(mesh.vertices * 1.7).astype(np.float64)
    (tmp_path / "b.ply").write_bytes(mesh.rewritten(places, {}))
    again = read_mesh_file(tmp_path / "b.ply")
    assert np.array_equal(again.vertices, places)
    check_same_faces(mesh, again)
    if mixed and form != "ascii":
        return  # more than the other reader can
    oracle = trimesh.load(tmp_path / "b.ply", process=False)
    assert np.abs(oracle.vertices - places).max() <= SINGLE
    assert (oracle.visual.vertex_colors[:, 0] == np.arange(len(v)) % 256).all()
    # The file's own normals, all along z, have given way to those of the shape.
    assert np.abs(oracle.vertex_normals[:, 0]).max() > 0.1


@pytest.mark.parametrize("ending", [".glb", ".gltf"])
def test_gltf_targets_keep_their_order(tmp_path, ending):
    v, quads = dome()
    triangles = Mesh(tmp_path, v, np.full(len(quads), 4), quads.ravel(), lambda *_: b"").triangles()
    rough, fine = expressions(v)
    source, target = tmp_path / f"a{ending}", tmp_path / "new" / f"b{ending}"
    write_glb(source, v, triangles, rough, sparse=True)
    mesh = read_mesh_file(source)
    assert list(mesh.targets) == list(rough)
    assert (mesh.corners.reshape(-1, 3) == triangles).all()
    # Base and displacement are rounded one by one.
    assert all(np.abs(mesh.targets[name] - rough[name]).max() <= 2 * SINGLE for name in rough)
    target.parent.mkdir()
    target.write_bytes(mesh.rewritten(mesh.vertices, {"grin": fine["grin"]}))
    again = read_mesh_file(target)
    assert np.array_equal(again.vertices, mesh.vertices)
    assert np.array_equal(again.targets["smile"], mesh.targets["smile"])
    assert np.abs(again.targets["grin"] - fine["grin"]).max() <= 2 * SINGLE
    assert np.abs(mesh.targets["grin"] - fine["grin"]).max() > 0.05
    oracle = trimesh.load(target, process=False, force="mesh")
    half = trimesh.load(target, process=False).geometry
    assert len(half) == 2 and len(oracle.vertices) == 2 * len(v)
    assert np.abs(oracle.vertices[: len(v)] - v).max() <= SINGLE


def test_gltf_without_targets_gets_new_positions_and_normals(tmp_path):
    v, quads = dome()
    triangles = quads[:, :3]
    write_glb(tmp_path / "a.glb", v, triangles, {})
    mesh = read_mesh_file(tmp_path / "a.glb")
    (tmp_path / "b.glb").write_bytes(mesh.rewritten(2.0 * v, {}))
    oracle = trimesh.load(tmp_path / "b.glb", process=False, force="mesh")
    assert np.abs(oracle.vertices[: len(v)] - 2.0 * v).max() <= 2 * SINGLE
    written = _Document(tmp_path / "b.glb", (tmp_path / "b.glb").read_bytes())
    (attributes, other) = (p["attributes"] for p in written.json["meshes"][0]["primitives"])
    assert attributes == other
    normals = written.array(attributes["NORMAL"])
    # Stored in single precision.
    assert np.abs(np.linalg.norm(normals, axis=1) - 1.0).max() < 1e-6
    assert np.abs(normals[:, 0]).max() > 0.1


def test_gltf_of_parts_that_the_scene_moves_apart_is_refused(tmp_path):
    v, quads = dome(4)
    write_glb(tmp_path / "a.gltf", v, quads[:, :3], {})
    scene = json.loads((tmp_path / "a.gltf").read_text())
    for second, fits in (({"mesh": 0}, True), ({"mesh": 0, "translation": [0.0, 1.0, 0.0]}, False)):
        (tmp_path / "a.gltf").write_text(json.dumps({**scene, "nodes": [{"mesh": 0}, second]}))
        if fits:
            read_mesh_file(tmp_path / "a.gltf")
        else:
            with pytest.raises(EvalkitError, match="apply their transforms"):
                read_mesh_file(tmp_path / "a.gltf")


def test_gltf_takes_its_pictures_along(tmp_path):
    v, quads = dome(4)
    write_glb(tmp_path / "a.gltf", v, quads[:, :3], {})
    scene = json.loads((tmp_path / "a.gltf").read_text())
    (tmp_path / "skin 1.png").write_bytes(b"picture")
    images = [{"uri": "skin%201.png"}, {"uri": "nowhere.jpg"}]
    (tmp_path / "a.gltf").write_text(json.dumps({**scene, "images": images}))
    mesh = read_mesh_file(tmp_path / "a.gltf")
    written = json.loads(mesh.rewritten(v + 1.0, {}))["images"]
    assert base64.b64decode(written[0]["uri"].removeprefix("data:image/png;base64,")) == b"picture"
    assert written[1] == {"uri": "nowhere.jpg"}


def test_a_face_is_split_where_no_triangle_turns_over(tmp_path):
    notch = np.array([[0.0, 0, 0], [2, 0, 0], [0.4, 0.4, 0], [0, 2, 0]])
    line = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 2, 0]])
    star = np.array([[np.cos(a + 0.3) * r, np.sin(a + 0.3) * r, 0.0] for a, r in enumerate([2, 2, 2, 2, 2, 0.3])])
    for places in (notch, np.roll(line, 1, axis=0), star, np.roll(notch, 1, axis=0)):
        n = len(places)
        triangles = Mesh(tmp_path, places, np.array([n]), np.arange(n), lambda *_: b"").triangles()
        a, b, c = (places[triangles[:, k]] for k in range(3))
        assert (np.cross(b - a, c - a)[:, 2] > 0.1).all()
    # Control: a fan from the first corner turns a triangle over.
    first, second = (np.cross(places[k] - places[0], places[k + 1] - places[0])[2] for k in (1, 2))
    assert min(first, second) < 0.0


def test_seams_are_welded_where_nothing_parts():
    v, _ = dome(4)
    twin = np.concatenate([v, v[:3], v[5:6]])
    apart = twin.copy()
    apart[-1] += 1.0
    kept, of = welded(np.stack([twin, apart]))
    assert kept.tolist() == [*range(16), 19] and of.tolist() == [*range(16), 0, 1, 2, 16]
    # By one shape alone, only along open edges: vertex 5 is inside the sheet.
    quads = dome(4)[1]
    kept, of = seams_welded(twin, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]], [[16, 17, 18]]]))
    assert of[16:19].tolist() == [0, 1, 2]


WRONG = {
    "empty.obj": (b" \n", "the file is empty"),
    "photo.obj": (b"\x89PNG\r\n\x1a\n", "holds no vertices"),
    "word.obj": (b"v 0 0 0\nv 1 x 0\n", "line 2 is no vertex: 'v 1 x 0'"),
    "bare.obj": (b"v 0 0 0\nv\n", "line 2 is no vertex"),
    "short.obj": (b"v 0 0 0\nv 1 0\n", "line 2 is no vertex"),
    "nan.obj": (b"v 0 0 0\nv 1 0 0\nv nan 0 0\nf 1 2 3\n", "vertex 2 is not finite"),
    "zero.obj": (b"v 0 0 0\nf 0 1 1\n", "line 2 names vertex 0"),
    "face.obj": (b"v 0 0 0\nf a b c\n", "line 2 is no face"),
    "range.obj": (b"v 0 0 0\nv 1 0 0\nf 1 2 9\n", "face 0 names vertex 8, of 2"),
    "two.obj": (b"v 0 0 0\nv 1 0 0\nf 1 2\n", "face 0 has 2 corners"),
    "points.obj": (b"v 0 0 0\n", "holds no faces"),
    "photo.ply": (b"\x89PNG", "no PLY file"),
    "cut.ply": (b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
                b"end_header\n0 0 0\n", "ends within the vertex list"),
    "cut2.ply": (b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nproperty float y\n"
                 b"property float z\nend_header\n0 0 0\n", "ends within the vertex list"),
    "kind.ply": (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\nend_header\n", "cannot be read as a PLY"),
    "flat.ply": (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n", "no x, y and z"),
    "photo.glb": (b"\x89PNG", "is no glTF"),
    "old.glb": (b"glTF\x01\0\0\0\x14\0\0\0", "is glTF 1"),
    "draco.gltf": (b'{"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco_mesh_compression"]}', "compress"),
    "none.gltf": (b'{"asset": {"version": "2.0"}}', "holds no triangles"),
    "lost.gltf": (b'{"asset": {"version": "2.0"}, "buffers": [{"uri": "x.bin", "byteLength": 4}]}', "x.bin"),
    "list.gltf": (b"[1]", "cannot be read as glTF"),
    "mesh.fbx": (b"x", "'.fbx' is no mesh file"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_file_that_cannot_be_used_is_one_line(tmp_path, name):
    content, text = WRONG[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(EvalkitError) as caught:
        read_mesh_file(tmp_path / name)
    assert text in str(caught.value) and str(tmp_path / name) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "b.ply", "a.glb"])
def test_damaged_files_are_refused_or_read_but_never_crash(tmp_path, name):
    v, quads = dome(5)
    if name.endswith(".obj"):
        write_obj(tmp_path / name, v, quads)
    elif name.endswith(".ply"):
        write_ply(tmp_path / name, v, quads.tolist(), FORMS[name[0] == "b"])
    else:
        write_glb(tmp_path / name, v, quads[:, :3], expressions(v)[0], sparse=True)
    whole = (tmp_path / name).read_bytes()
    random, refused = generator("damaged meshes", name, seed=0), 0
    for k in range(60):
        content = bytearray(whole)
        if k % 3 == 0:
            del content[int(random.integers(len(content))) :]
        for at in random.integers(len(content), size=k % 4) if content else ():
            content[int(at)] = int(random.integers(256))
        (tmp_path / name).write_bytes(content)
        try:
            read_mesh_file(tmp_path / name)
        except EvalkitError as error:
            refused += 1
            assert "\n" not in str(error)
    assert 10 < refused < 60
