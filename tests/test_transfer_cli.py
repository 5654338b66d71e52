"""``evalkit transfer`` over files: results are those of the Python call, nothing is lost or half written."""

from __future__ import annotations

import csv
import json
import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from small_head import head_to_draw, small_head
from small_meshes import dome, expressions, write_glb, write_obj, write_ply

from evalkit import cli
from evalkit.errors import EvalkitError
from evalkit.geometry import rotation_from_vector
from evalkit.meshes import read_mesh_file
from evalkit.meshes.model import Mesh
from evalkit.render import offscreen
from evalkit.report import transfer as report
from evalkit.transfer.character import CharacterTransfer
from evalkit.transfer.choosing import choose_examples
from evalkit.transfer.files import Shape, odd_shapes, read_regions

SINGLE = 2.0**-23
"""Rounding of numbers stored in single precision, over values up to 2."""


def run(*words: object) -> str:
    """Output of a command that succeeds."""
    done = CliRunner().invoke(cli.app, ["transfer", *map(str, words)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def refusal(*words: object) -> str:
    """The one line that a user's mistake is told in."""
    with pytest.raises(EvalkitError) as caught:
        run(*words)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """rest.obj, rough/ with four shapes, fine/ with two of them, all/ with all four fine ones."""
    monkeypatch.chdir(tmp_path)
    v, quads = dome()
    rough, fine = expressions(v)
    write_obj(tmp_path / "rest.obj", v, quads)
    for name, shapes in (("rough", rough), ("all", fine), ("fine", {k: fine[k] for k in ("smile", "frown")})):
        (tmp_path / name).mkdir()
        for key, shape in shapes.items():
            write_obj(tmp_path / name / f"{key}.obj", shape, quads)
    return tmp_path


ARGUMENTS = ("apply", "rough", "--fine", "fine", "--rest", "rest.obj", "-o", "out", "--no-pictures")


def of_files() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rest, rough and fine examples, new shapes and triangles, as the files have them."""
    rest = read_mesh_file("rest.obj")
    names = (("rough", "frown"), ("rough", "smile")), (("fine", "frown"), ("fine", "smile"))
    rough, fine = (np.stack([read_mesh_file(f"{a}/{b}.obj").vertices for a, b in some]) for some in names)
    new = np.stack([read_mesh_file(f"rough/{name}.obj").vertices for name in ("grin", "wink")])
    return rest.vertices, rough, fine, new, rest.triangles()


def test_results_are_those_of_the_python_call_to_the_last_bit(folder):
    summary = json.loads(run(*ARGUMENTS, "--json"))
    rest, rough, fine, new, triangles = of_files()
    transfer = CharacterTransfer(rest, rough, fine, triangles)
    for name, expected, before in zip(("grin", "wink"), transfer(new), new, strict=True):
        written = read_mesh_file(f"out/{name}.obj")
        assert np.array_equal(written.vertices, expected)
        assert np.abs(expected - before).max() > 0.05
        assert written.sizes.tolist() == [4] * 121
    assert sorted(p.name for p in Path("out").iterdir()) == [
        "coefficients.csv", "grin.obj", "regions.json", "summary.json", "wink.obj"
    ]  # fmt: skip
    assert summary == json.loads(Path("out/summary.json").read_text())
    weights = transfer.coefficients(new)
    told = summary["coefficients"]["wink"]
    assert [list(row.values()) for row in told.values()] == weights[1].tolist()
    assert summary["mesh"]["pinned_vertices"] == transfer.pinned.sum() > 0
    assert summary["mesh"]["loose_parts"] == 0 and summary["mesh"]["parts"] == 1
    assert len(summary["examples"][0]["rough"]["sha256"]) == 64


def test_regions_and_coefficients_can_be_given_back(folder):
    run(*ARGUMENTS)
    run(*ARGUMENTS[:-2], "again", "--no-pictures", "--regions", "out/regions.json")
    assert Path("again/wink.obj").read_bytes() == Path("out/wink.obj").read_bytes()
    # One-hot coefficients are the example itself; the other shape keeps those that were found.
    regions = list(json.loads(Path("out/regions.json").read_text())["regions"])
    rows = [("wink", region, example, example == "smile") for region in regions for example in ("smile", "frown")]
    text = "".join(f"{a},{b},{c},{int(d)}\n" for a, b, c, d in rows)
    Path("mine.csv").write_text("shape,region,example,weight\n" + text)
    # The example's own rough shape is put in place of the new one: then its fine shape must come out.
    Path("rough/wink.obj").write_bytes(Path("rough/smile.obj").read_bytes())
    output = run(*ARGUMENTS[:-2], "hot", "--no-pictures", "--coefficients", "mine.csv")
    hot, goal = (read_mesh_file(name).vertices for name in ("hot/wink.obj", "fine/smile.obj"))
    # Of the size of the mesh: the solver's rounding.
    assert np.abs(hot - goal).max() < 1e-9
    assert np.abs(read_mesh_file("out/wink.obj").vertices - goal).max() > 0.1
    # Shapes are solved together: the others of a batch change the rounding.
    assert np.abs(read_mesh_file("hot/grin.obj").vertices - read_mesh_file("out/grin.obj").vertices).max() < 1e-12
    assert "coefficients taken from the file" in output
    with Path("hot/coefficients.csv").open() as file:
        assert [float(row["weight"]) for row in csv.DictReader(file) if row["shape"] == "wink"] == [
            float(example == "smile") for _ in regions for example in ("frown", "smile")
        ]


def test_regions_drawn_by_hand_have_names(folder):
    Path("mine.json").write_text(json.dumps({"regions": {"left": list(range(60)), "nose": [70]}}))
    summary = json.loads(run(*ARGUMENTS, "--regions", "mine.json", "--json"))
    assert summary["method"]["regions"] == {"left": 60, "nose": 1, "rest of the mesh": 83}
    assert {name: len(which) for name, which in read_regions(Path("out/regions.json"), 144).items()} == {
        "left": 60, "nose": 1, "rest of the mesh": 83,
    }  # fmt: skip
    rest, rough, fine, new, triangles = of_files()
    labels = np.repeat([0, 2, 1, 2], [60, 10, 1, 73])
    expected = CharacterTransfer(rest, rough, fine, triangles, regions=labels)(new)
    assert np.array_equal(read_mesh_file("out/grin.obj").vertices, expected[0])


def test_errors_are_measured_against_references(folder):
    Path("names.json").write_text(json.dumps({"landmarks": {"eye inner left": 30, "eye inner right": 33}}))
    summary = json.loads(run(*ARGUMENTS, "--reference", "all", "--names", "names.json", "--json"))
    rest = read_mesh_file("rest.obj").vertices
    distance = np.linalg.norm(rest[30] - rest[33])
    for shape in summary["shapes"]:
        result, rough, goal = (
            read_mesh_file(f"{where}/{shape['name']}.obj").vertices for where in ("out", "rough", "all")
        )
        rms, before = (np.sqrt(((a - goal) ** 2).sum(axis=1).mean()) for a in (result, rough))
        # Rounding of a mean.
        assert shape["rms"] == pytest.approx(rms, rel=1e-12) and shape["rms_of_rough"] == pytest.approx(before)
        assert shape["rms_over_eye_distance"] == pytest.approx(rms / distance, rel=1e-12)
        # The wink is like neither example.
        assert rms < before or shape["name"] == "wink"


@pytest.mark.parametrize("method", ["rough", "gain", "local regression"])
def test_other_methods_have_no_coefficients(folder, method):
    summary = json.loads(run(*ARGUMENTS, "--method", method, "--json"))
    assert summary["coefficients"] is None and not Path("out/regions.json").exists()
    if method == "rough":
        assert np.array_equal(read_mesh_file("out/wink.obj").vertices, read_mesh_file("rough/wink.obj").vertices)
    assert "go with the method" in refusal(*ARGUMENTS, "--method", method, "--regions", "out/regions.json")


def split(v: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles with a seam down the middle, as texture coordinates make it; the first stay in place."""
    left = v[triangles][:, :, 0].mean(axis=1) < 0.0
    twins = np.intersect1d(triangles[left], triangles[~left])
    number = np.arange(len(v))
    number[twins] = len(v) + np.arange(len(twins))
    return np.concatenate([np.arange(len(v)), twins]), np.where(left[:, None], number[triangles], triangles)


@pytest.mark.parametrize("ending", [".glb", ".gltf", ".ply"])
def test_seams_of_other_formats_do_not_tear(folder, ending):
    v, quads = dome()
    triangles = Mesh(folder, v, np.full(len(quads), 4), quads.ravel(), lambda *_: b"").triangles()
    every, faces = split(v, triangles)
    rough, fine = expressions(v)
    rough, fine = ({name: shape[every] for name, shape in shapes.items()} for shapes in (rough, fine))
    both = {**rough, "smile.fine": fine["smile"], "frown.fine": fine["frown"]}
    if ending == ".ply":
        (folder / "ply").mkdir()
        for name, shape in {"rest": v[every], **both}.items():
            write_ply(folder / "ply" / f"{name}.ply", shape, faces.tolist(), "binary_little_endian")
        source, rest = "ply", ["--rest", "ply/rest.ply"]
    else:
        source, rest = f"face{ending}", []
        write_glb(folder / source, v[every], faces, both, sparse=True)
    summary = json.loads(run("apply", source, *rest, "--fine-suffix", ".fine", "-o", "out", "--no-pictures", "--json"))
    assert summary["mesh"]["vertices_welded"] == len(every) - len(v) > 10
    if ending == ".ply":
        made = {name: read_mesh_file(f"out/{name}.ply").vertices for name in ("grin", "wink")}
    else:
        file = read_mesh_file(f"out/{source}")
        made = file.targets
        assert list(made) == list(both)
        # The rig is complete: examples are what was sculpted.
        assert np.abs(made["smile"] - fine["smile"]).max() <= 2 * SINGLE
    pair = (np.float32(np.stack([s["smile"], s["frown"]])).astype(float)[:, : len(v)] for s in (rough, fine))
    new = np.float32(np.stack([rough["grin"], rough["wink"]])).astype(float)[:, : len(v)]
    whole = CharacterTransfer(np.float32(v).astype(float), *pair, triangles)(new)
    for name, expected in zip(("grin", "wink"), whole, strict=True):
        assert np.array_equal(made[name][len(v) :], made[name][every[len(v) :]])
        # Rest and displacement are in single precision, coefficients magnify their rounding.
        assert np.abs(made[name][: len(v)] - expected).max() < 20 * SINGLE
    # Control: without welding the two sides come apart.
    torn = CharacterTransfer(
        v[every], [rough[k] for k in ("smile", "frown")], [fine[k] for k in ("smile", "frown")], faces
    )
    gap = torn([rough["wink"]])[0]
    assert np.abs(gap[len(v) :] - gap[every[len(v) :]]).max() > 1e-3


def changed(path: str, line: int, text: str) -> None:
    lines = Path(path).read_bytes().split(b"\r\n")
    lines[line] = text.encode()
    Path(path).write_bytes(b"\r\n".join(lines))


def fewer(name: str) -> None:
    v, quads = dome(11)
    write_obj(Path(name), v, quads)


def other_faces(name: str) -> None:
    v, quads = dome()
    write_obj(Path(name), v, np.roll(quads, 1, axis=1))


MISTAKES = {
    "fewer vertices": (lambda: fewer("rough/grin.obj"), [r"rough/grin.obj has 121 vertices, rest.obj has 144"]),
    "other faces": (lambda: other_faces("fine/smile.obj"), [r"fine/smile.obj: face 0 has vertices .* in rest.obj"]),
    "no number": (lambda: changed("rough/wink.obj", 8, "v nan 0 0"), [r"rough/wink.obj: vertex 5 is not finite"]),
    "no area": (
        lambda: [changed("rest.obj", k, "v 0 0 0") for k in (3, 4, 15, 16)], [r"rest.obj: triangle 0 \(.*no area"]
    ),
    "collapsed": (
        lambda: [changed("rough/smile.obj", k, "v 0 0 0") for k in (3, 4, 15)], [r"rough/smile.obj: triangle 0 has col"]
    ),
    "twice": (
        lambda: write_ply(Path("rough/wink.ply"), *dome(), "ascii"),
        [r"rough/wink.obj and rough/wink.ply have the same name"],
    ),
    "empty folder": (lambda: [p.unlink() for p in Path("fine").iterdir()], [r"fine: no mesh file"]),
    "no new shape": (
        lambda: [Path("rough", n).unlink() for n in ("grin.obj", "wink.obj")], ["nothing to transfer"]
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_line_that_names_the_file(folder, name):
    spoil, patterns = MISTAKES[name]
    spoil()
    line = refusal(*ARGUMENTS)
    assert all(re.search(pattern, line) for pattern in patterns), line
    assert not Path("out").exists()


def test_names_must_pair_up_and_be_unique(folder):
    v, quads = dome()
    write_obj(folder / "fine" / "shout.obj", v, quads)
    assert "fine/shout.obj: no rough shape is named 'shout'" in refusal(*ARGUMENTS)
    (folder / "fine" / "shout.obj").rename(folder / "wink.obj")
    assert "same name" in refusal("apply", "wink.obj", *ARGUMENTS[1:])
    assert "no method 'magic'" in refusal(*ARGUMENTS, "--method", "magic")
    assert "no rest mesh" in refusal("apply", "rough", "--fine", "fine", "-o", "out")
    assert "nobody.obj: cannot be read" in refusal("apply", "nobody.obj", *ARGUMENTS[1:])
    assert "rough.stl: '.stl' is no mesh file" in refusal("apply", "rough.stl", *ARGUMENTS[1:])


REGIONS = {
    '{"regions": {"a": [1, 999]}}': "region 'a' uses vertex 999, of 144",
    '{"regions": {"a": [1], "b": [2, 1]}}': "vertex 1 is in the regions 'a' and 'b'",
    '{"regions": {"a": [1.5]}}': "must be a list of vertex numbers",
    '{"region": 1}': "'regions' is missing",
    "{": "no valid JSON",
}
COEFFICIENTS = {
    "shape,region,weight\n": "must name the columns",
    "shape,region,example,weight\nwonk,0,smile,1\n": "line 2: no shape 'wonk'",
    "shape,region,example,weight\nwink,99,smile,1\n": "line 2: no region '99'",
    "shape,region,example,weight\nwink,0,wink,1\n": "line 2: no example 'wink'",
    "shape,region,example,weight\nwink,0,smile,much\n": "line 2: weight 'much' is no number",
    "shape,region,example,weight\nwink,0,smile,inf\n": "line 2: weight 'inf' is not finite",
    "shape,region,example,weight\nwink,0,smile,1\nwink,0,smile,1\n": "line 3: this shape",
}


@pytest.mark.parametrize(
    ("option", "text"), [("--regions", t) for t in REGIONS] + [("--coefficients", t) for t in COEFFICIENTS]
)
def test_a_mistake_in_an_override_is_one_line(folder, option, text):
    Path("mine").write_text(text)
    line = refusal(*ARGUMENTS, option, "mine")
    assert {**REGIONS, **COEFFICIENTS}[text] in line and line.startswith("mine: ")
    assert not Path("out").exists()


def test_odd_units_and_head_motion_are_warned_of(folder):
    v, quads = dome()
    write_obj(folder / "rough" / "wink.obj", 100.0 * v, quads)
    write_obj(folder / "rough" / "grin.obj", v @ rotation_from_vector([0.0, np.radians(15.0), 0.0]).T, quads)
    output = run(*ARGUMENTS)
    assert re.search(r"warning: rough/wink.obj is 100 times as large as rest.obj", output)
    assert re.search(r"warning: rough/grin.obj is turned by 15 degrees", output)
    assert output.count("warning") == 2


def test_a_wide_open_jaw_is_not_taken_for_head_motion():
    head = small_head()
    rest = Mesh(Path("rest"), head.vertices, np.zeros(0), np.zeros(0), lambda *_: b"")
    assert odd_shapes(rest, [Shape("open", head.posed(jaw_deg=30.0, lids_closed=1.0), rest)]) == []
    turned = head.vertices @ rotation_from_vector([0.2, 0.0, 0.0]).T
    assert len(odd_shapes(rest, [Shape("nod", turned, rest)])) == 1


def test_a_loose_part_is_told_of(folder):
    v, quads = dome()
    ball, more = dome(6)
    places = np.concatenate([v, 0.3 * ball + [5.0, 0.0, 0.0]])
    faces = np.concatenate([quads, more + len(v)])
    rough, fine = expressions(v)

    def whole(shape: np.ndarray, by: float) -> np.ndarray:
        return np.concatenate([shape, places[len(v) :] + np.array([0.0, by, 0.0])])

    write_obj(folder / "rest.obj", places, faces)
    for name in rough:
        write_obj(folder / "rough" / f"{name}.obj", whole(rough[name], 0.1), faces)
    for name in ("smile", "frown"):
        write_obj(folder / "fine" / f"{name}.obj", whole(fine[name], 0.2), faces)
    summary = json.loads(run(*ARGUMENTS, "--json"))
    assert (summary["mesh"]["parts"], summary["mesh"]["loose_parts"]) == (2, 1)
    assert np.isfinite(read_mesh_file("out/wink.obj").vertices).all()


def test_an_interrupted_run_leaves_nothing(folder, monkeypatch):
    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(report, "write_regions", stopped)
    done = CliRunner().invoke(cli.app, ["transfer", *ARGUMENTS])
    assert done.exit_code != 0 and not Path("out").exists()


def test_an_input_is_never_overwritten(folder):
    before = Path("rough/wink.obj").read_bytes()
    assert "would overwrite its own input" in refusal(*ARGUMENTS[:-2], "rough")
    assert Path("rough/wink.obj").read_bytes() == before
    run(*ARGUMENTS)
    assert "would overwrite" in refusal(*ARGUMENTS, "--regions", "out/regions.json")


def test_exit_codes(folder, monkeypatch, capsys):
    for words, code in (
        (ARGUMENTS, 0), ((*ARGUMENTS, "--method", "magic"), 1), (("apply", "rough", "-o", "out"), 2),
    ):  # fmt: skip
        monkeypatch.setattr(sys, "argv", ["evalkit", "transfer", *words])
        with pytest.raises(SystemExit) as caught:
            cli.main()
        assert caught.value.code == code
    assert "evalkit: no method 'magic'" in capsys.readouterr().err


def test_meshes_are_written_where_nothing_can_be_drawn(folder, monkeypatch):
    def never() -> None:
        raise EvalkitError("no picture can be drawn")

    monkeypatch.setattr(offscreen, "require_offscreen", never)
    output = run(*ARGUMENTS[:-1])
    assert "warning: no picture can be drawn" in output
    assert "wrote into out: grin.obj, wink.obj, coefficients.csv, regions.json, summary.json" in output
    assert json.loads(Path("out/summary.json").read_text())["warnings"] == ["no picture can be drawn"]


def test_pictures_show_the_shapes(folder):
    head_to_draw()
    run(*ARGUMENTS[:-1], "--reference", "all/wink.obj")
    from PIL import Image

    sheet = np.asarray(Image.open("out/sheet-1.png")).astype(float)
    width = sheet.shape[1] // 5
    body = sheet[30:-60].reshape(2, -1, 5, width, 3).transpose(0, 2, 1, 3, 4)
    coloured = np.ptp(body, axis=-1).max(axis=(2, 3)) > 60
    # Columns: rough, result, reference, both errors; rows: grin, without a reference, and wink.
    assert coloured.tolist() == [[False] * 5, [False, False, False, True, True]]
    assert (body[0, 2:] == 255).all()
    assert np.abs(body[1, 0] - body[1, 1]).mean() > 1.0


# Deformation Transfer ------------------------------------------------------------------------------------------------


@pytest.fixture
def two_meshes(tmp_path, monkeypatch) -> Path:
    """a.obj and other/ with its shapes, b.obj with more vertices and other proportions; landmarks beside them."""
    monkeypatch.chdir(tmp_path)
    places = [(0.0, 0.0), (0.6, 0.6), (-0.6, 0.6), (0.5, -0.7), (-0.5, -0.7), (0.0, 0.9)]
    for name, n, scale in (("a", 12, [1.0, 1.0, 1.0]), ("b", 17, [13.0, 10.0, 10.0])):
        v, quads = dome(n)
        write_obj(tmp_path / f"{name}.obj", v * scale, quads)
        near = [int(((v[:, :2] - at) ** 2).sum(axis=1).argmin()) for at in places]
        landmarks = {f"place {k}": vertex for k, vertex in enumerate(near)}
        (tmp_path / f"{name}.json").write_text(json.dumps({"landmarks": landmarks}))
        if name == "a":
            (tmp_path / "other").mkdir()
            for key, shape in expressions(v)[0].items():
                write_obj(tmp_path / "other" / f"{key}.obj", shape, quads)
    return tmp_path


DEFORM = ("deform", "other", "--source-rest", "a.obj", "--target-rest", "b.obj", "--no-pictures")


def test_shapes_of_another_mesh_and_the_correspondence_again(two_meshes):
    summary = json.loads(run(*DEFORM, "-o", "out", "--json"))
    rest, smile = (read_mesh_file(name) for name in ("b.obj", "out/smile.obj"))
    assert smile.corners.tolist() == rest.corners.tolist() and smile.sizes.tolist() == [4] * 256
    move = smile.vertices - rest.vertices
    top = rest.vertices[np.linalg.norm(move, axis=1).argmax()]
    # The push is at (0.5, -0.6) by 0.27 there; the target is 13 and 10 times as large. Half of it would be a failure.
    assert np.abs(top[:2] / [13.0, 10.0] - [0.5, -0.6]).max() < 0.25
    assert 1.35 < np.linalg.norm(move, axis=1).max() < 4.0
    assert summary["pinned_vertices"] < 256
    run(*DEFORM, "-o", "again", "--correspondence", "out/correspondence.npz")
    assert Path("again/smile.obj").read_bytes() == Path("out/smile.obj").read_bytes()
    Path("b.obj").write_bytes(Path("a.obj").read_bytes())
    assert "made for another target mesh" in refusal(*DEFORM, "-o", "x", "--correspondence", "out/correspondence.npz")
    assert not Path("x").exists()


def test_deform_says_what_is_missing(two_meshes):
    assert "would overwrite its own input" in refusal("deform", "other/wink.obj", *DEFORM[2:], "-o", "other")
    Path("b.json").write_text('{"landmarks": {"place 0": 0, "place 1": 5}}')
    assert "2 landmarks of the same name" in refusal(*DEFORM, "-o", "out")
    Path("b.json").unlink()
    assert refusal(*DEFORM, "-o", "out").startswith("b.json: cannot be read")


def test_heads_that_face_different_ways_are_warned_of(two_meshes):
    v, quads = dome(17)
    upright = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    write_obj(two_meshes / "b.obj", v @ upright.T, quads)
    assert re.search(r"warning: b.obj faces 90 degrees away from a.obj", run(*DEFORM, "-o", "out"))


# Choice --------------------------------------------------------------------------------------------------------------


def test_the_choice_is_that_of_the_python_call(folder):
    rest, names = read_mesh_file("rest.obj"), ("frown", "grin", "smile", "wink")
    rough = [read_mesh_file(f"rough/{name}.obj").vertices for name in names]
    order = choose_examples(rest.vertices, rough, rest.triangles(), 3)
    assert json.loads(run("choose", "rough", "--rest", "rest.obj", "-k", "3", "--json")) == [names[k] for k in order]
    assert run("choose", "rough", "--rest", "rest.obj", "-k", "1").split() == [names[order[0]]]
    assert "9 examples cannot be chosen among 4" in refusal("choose", "rough", "--rest", "rest.obj", "-k", "9")


# Help ----------------------------------------------------------------------------------------------------------------


def examples(command: str) -> list[str]:
    text = run(command, "--help").partition("Example")[2].partition(":")[2].partition("Options:")[0]
    return [line.strip() for line in text.splitlines() if line.strip()]


def test_examples_of_the_help_run_as_written(folder, two_meshes):
    v, quads = dome()
    rough, fine = expressions(v)
    for name, shape in (("grin", fine["smile"]), ("wide", rough["smile"])):
        write_obj(folder / f"{name}.obj", shape, quads)
    Path("mine.json").write_text('{"regions": {"left": [1, 2, 3]}}')
    Path("sculpts").symlink_to("all")
    Path("more").symlink_to("other")
    write_glb(Path("face.glb"), v, quads[:, :3], {**rough, "smile.fine": fine["smile"]})
    shown = [*examples("apply"), *examples("deform")]
    assert len(shown) == 6
    assert len(run(*shlex.split(*examples("choose"))[2:]).split()) == 3
    for k, line in enumerate(shown):
        words = shlex.split(line)
        if "kept.npz" in words:
            Path("kept.npz").write_bytes(Path("out4/correspondence.npz").read_bytes())
        at = words.index("-o") + 1
        words[at] = f"out{k}"
        run(*words[2:], "--no-pictures")
        assert Path(f"out{k}/summary.json").exists()
