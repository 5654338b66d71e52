"""The built-in head: its landmarks against real heads, openings without holes, motion without crossings.

The control throughout is an ellipsoid without relief that wears the same texture and carries the same names:
what it passes says nothing about the shape of a head.
"""

from __future__ import annotations

import dataclasses
import json
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from realdata import real_data
from scipy.spatial import cKDTree

import evalkit
import evalkit.geometry
from evalkit.errors import EvalkitError
from evalkit.head import Head, load_head, turned_too_far
from evalkit.head import proportions as table
from evalkit.head.check import check_head
from evalkit.head.mesh import closest_points, components, directed_edges, triangle_normals
from evalkit.head.places import all_landmarks
from evalkit.head.surface import field
from evalkit.head.template import make_grid, make_template
from evalkit.synthetic.layouts import PAPER_23

JAW_DEG = (0.0, 7.5, 15.0, 30.0)
CLOSED = (0.0, 0.25, 0.5, 0.75, 1.0)


@lru_cache(maxsize=4)
def template(vertices: int = 11_000) -> Head:
    return make_template(vertices)


@lru_cache(maxsize=1)
def ellipsoid() -> Head:
    """The control: the template's skin moved radially onto the ellipsoid nearest to it."""
    head = template()
    skin = head.skin_vertices
    middle = np.array([0.0, 15.0, 0.0])
    arms = head.vertices - middle
    squares, *_ = np.linalg.lstsq(arms[skin] ** 2, np.ones(len(skin)), rcond=None)
    reach = 1.0 / np.sqrt((arms**2 * squares).sum(axis=1))
    vertices = head.vertices.copy()
    soft = head.soft_vertices
    vertices[soft] = middle + arms[soft] * reach[soft, None]
    nearest = head.nearest_vertices(head.landmarks)
    return dataclasses.replace(
        head,
        vertices=vertices,
        landmarks={name: vertices[k] for name, k in nearest.items()},
        marker_sites={name: vertices[k] for name, k in head.nearest_vertices(head.marker_sites).items()},
    )


# ---- (a) against real heads ---------------------------------------------------------------------------------------


def similarity(points: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Points moved, turned and scaled onto the target in the least-squares sense (Umeyama 1991)."""
    a, b = points - points.mean(axis=-2, keepdims=True), target - target.mean(axis=0)
    u, s, vt = np.linalg.svd(np.swapaxes(a, -1, -2) @ b)
    sign = np.ones_like(s)
    sign[..., 2] = np.sign(np.linalg.det(u @ vt))
    scale = (s * sign).sum(axis=-1) / (a**2).sum(axis=(-2, -1))
    return scale[..., None, None] * (a @ (u * sign[..., None, :] @ vt)) + target.mean(axis=0)


@lru_cache(maxsize=1)
def real_heads() -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names, mean landmarks, and per landmark the distance within which 99 % of drawn real heads lie.

    Heads are drawn as the model that they come from defines them: neutral face plus identity modes with
    standard normal weights. Only the first eight modes are used, so the true spread is larger than this.
    """
    facts = json.loads(Path(evalkit.head.__file__).with_name("real_heads.json").read_text())
    mean, modes = np.array(facts["mean"]), np.array(facts["modes"])
    weights = evalkit.seeds.generator("head landmarks", seed=0).standard_normal((2000, len(modes)))
    heads = similarity(mean + np.tensordot(weights, modes, axes=1), mean)
    return facts["names"], mean, np.quantile(np.linalg.norm(heads - mean, axis=2), 0.99, axis=0)


def outside_spread(head: Head) -> list[str]:
    """Landmarks of a head that lie outside the spread of real ones."""
    names, mean, radius = real_heads()
    moved = similarity(np.array([head.landmarks[name] for name in names]), mean)
    distance = np.linalg.norm(moved - mean, axis=1)
    return [name for name, d, r in zip(names, distance, radius, strict=True) if d > r]


def test_landmarks_lie_within_the_spread_of_real_heads():
    assert outside_spread(template()) == []


def test_control_of_an_ellipsoid_they_do_not():
    outside = outside_spread(ellipsoid())
    assert {"nose tip", "chin"} <= set(outside)
    assert len(outside) > 10


def test_real_heads_themselves_pass_as_often_as_they_should():
    # Otherwise the radius would mean nothing: 99 % per landmark, by construction on other draws.
    names, mean, radius = real_heads()
    facts = json.loads(Path(evalkit.head.__file__).with_name("real_heads.json").read_text())
    weights = evalkit.seeds.generator("head landmarks", seed=1).standard_normal((1000, len(facts["modes"])))
    heads = similarity(mean + np.tensordot(weights, np.array(facts["modes"]), axes=1), mean)
    inside = (np.linalg.norm(heads - mean, axis=2) <= radius).mean(axis=0)
    # Three standard errors of a share of 0.99 among 1,000, and those of the quantile itself.
    assert (inside > 0.975).all()
    assert len(names) == len(radius)


def ict_skin() -> tuple[np.ndarray, np.ndarray]:
    """Neutral face (mm) and its skin's quadrilaterals."""
    with np.load(real_data("meshes", "ict_facekit_subset.npz")) as file:
        vertices, quads = file["neutral"].astype(float) * 10.0, file["quads"]
        skin = json.loads(str(file["parts"]))["head_and_neck"][1]
    return vertices, quads[(quads < skin).all(axis=1)]


def test_the_surface_fits_the_face_it_was_measured_on():
    vertices, quads = ict_skin()
    faces = vertices[np.unique(quads)]
    x, y, z = np.abs(faces[:, 0]), faces[:, 1], faces[:, 2]
    # Front of the face without nostrils, insides of lips and lids, which the surface does not have.
    front = (z > 60) & (y > -75) & (y < 110)
    openings = (
        ((x > 16) & (x < 47) & (y > 27) & (y < 44))
        | ((x < 27) & (y > -41) & (y < -27))
        | ((x < 15) & (y > -15) & (y < 5) & (z < 115))
    )
    distance = np.abs(field(faces[front & ~openings], table.PRIMITIVES))
    # What the fit left: a third of a millimetre rms; the bounds leave room for rounding the table to 0.1 mm.
    assert np.sqrt((distance**2).mean()) < 0.4
    assert np.quantile(distance, 0.99) < 1.5


def test_landmark_table_is_that_of_the_measured_face():
    names, mean, _ = real_heads()
    places = all_landmarks()
    assert np.abs(np.array([places[name] for name in names]) - mean).max() < 0.06  # rounded to 0.1 mm


# ---- (c) mesh -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("vertices", [1_000, 2_500, 11_000])
def test_every_resolution_is_sound(vertices):
    head = template(vertices)
    assert check_head(head) == []
    # Rows and columns are whole numbers: few of them at 1,000 leave the largest error.
    assert 0.85 * vertices < len(head.vertices) < 1.45 * vertices


@pytest.mark.slow
@pytest.mark.parametrize("vertices", [25_000, 100_000])
def test_large_resolutions_are_sound(vertices):
    head = template(vertices)
    assert check_head(head) == []
    assert 0.85 * vertices < len(head.vertices) < 1.15 * vertices


@pytest.mark.parametrize("vertices", [999, 100_001, -5])
def test_a_resolution_out_of_range_is_refused(vertices):
    with pytest.raises(EvalkitError, match="1,000 to 100,000"):
        load_head("template", vertices=vertices)


def test_skin_is_one_surface_that_is_open_at_the_rim_and_inside_the_eyeballs():
    head = template()
    soft = head.part_triangles("skin", "lids", "mouth pocket")
    edges = directed_edges(soft)
    _, inverse, counts = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    assert counts.max() == 2
    rim = edges[counts[inverse.ravel()] == 1]
    loops, _ = components(np.stack([rim[:, 0], rim[:, 1], rim[:, 0]], axis=1))
    assert loops == 3
    for side in head.lids.centres:
        ring = np.unique(rim)
        near = ring[np.linalg.norm(head.vertices[ring] - side, axis=1) < 25]
        assert (np.linalg.norm(head.vertices[near] - side, axis=1) < head.lids.radius).all()
        assert len(near) > 10


def test_it_is_symmetric_and_the_same_every_time():
    head = template()
    distance, _ = cKDTree(head.vertices).query(head.vertices * [-1, 1, 1])
    assert distance.max() < 1e-9
    again = make_template()
    assert (again.vertices == head.vertices).all() and (again.triangles == head.triangles).all()
    assert (again.texture == head.texture).all()


def same(one, other):
    """Whether two heads, or parts of them, are equal to the last bit."""
    if dataclasses.is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in dataclasses.fields(one))
    if isinstance(one, dict):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other)
    return one == other


def test_a_kept_template_is_the_template(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made = make_template(1000)
    assert same(load_head("template", vertices=1000), made)
    assert len(list((tmp_path / "evalkit").iterdir())) == 1
    # Control: nothing is made any more, and what is read is held against the truth.
    monkeypatch.setattr(evalkit.head.template, "make_template", lambda vertices: pytest.fail("made again"))
    read = load_head("template", vertices=1000)
    assert same(read, made)
    assert not same(read, dataclasses.replace(made, vertices=made.vertices + 1e-12))


def test_a_damaged_or_forbidden_cache_costs_only_time(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made = load_head("template", vertices=1000)
    (kept,) = (tmp_path / "evalkit").iterdir()
    kept.write_bytes(kept.read_bytes()[:1000])
    assert same(load_head("template", vertices=1000), made)
    assert kept.stat().st_size > 1000
    monkeypatch.setenv("XDG_CACHE_HOME", str(kept))  # a file: no folder can be made in it
    assert same(load_head("template", vertices=1000), made)


def test_names():
    head = evalkit.load_head("template")
    assert set(head.marker_sites) == set(PAPER_23)
    # The markers of synthetic performers were placed on the same face: the surface is that near to it.
    off = [np.linalg.norm(head.marker_sites[name] - np.array(PAPER_23[name])) for name in PAPER_23]
    assert max(off) < 2.5
    assert len(head.landmarks) == 35
    skin = head.part_triangles("skin", "lids")
    places = np.array([*head.landmarks.values(), *head.marker_sites.values()])
    assert closest_points(places, head.vertices, skin)[1].max() < 1e-6


def test_control_markers_are_not_on_the_ellipsoid():
    head = ellipsoid()
    off = [np.linalg.norm(head.marker_sites[name] - np.array(PAPER_23[name])) for name in PAPER_23]
    assert max(off) > 10.0


def folded(head: Head, vertices: np.ndarray) -> int:
    """Pairs of neighbouring triangles of the outer skin that are folded onto each other."""
    # The sheet alone: at the edges of the lids and lips the rings turn inward sharply, as they should.
    skin = head.part_triangles("skin", "lids")
    skin = skin[(skin < make_grid(1.0).count).all(axis=1)]
    normals = triangle_normals(vertices, skin)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    edges = np.sort(directed_edges(skin), axis=1)
    owner = np.tile(np.arange(len(skin)), 3)
    order = np.lexsort(edges.T)
    edges, owner = edges[order], owner[order]
    twins = np.flatnonzero((edges[1:] == edges[:-1]).all(axis=1))
    along = (normals[owner[twins]] * normals[owner[twins + 1]]).sum(axis=1)
    # Beyond 120 degrees: no crease of a face is so sharp.
    return int((along < -0.5).sum())


@pytest.mark.parametrize("jaw_deg", JAW_DEG)
def test_no_face_is_folded(jaw_deg):
    head = template()
    assert folded(head, head.posed(jaw_deg=jaw_deg)) == 0


def test_control_a_fold_is_seen():
    head = template()
    vertices = head.vertices.copy()
    k = head.nearest_vertices({"cheek": np.array([45.0, 0.0, 93.5])})["cheek"]
    vertices[k] += [9.0, 0.0, 0.0]
    assert folded(head, vertices) > 0


# ---- motion -------------------------------------------------------------------------------------------------------


def edges_of(opening: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Upper and lower edge of each opening of the default template, corners included, in order."""
    grid = make_grid(1.0)
    if opening == "mouth":
        return [(grid.ids["middle"][-1, grid.mouth], grid.ids["lower"][0, grid.mouth])]
    return [(grid.ids["upper"][-1, columns], grid.ids["middle"][0, columns]) for columns in grid.eyes]


def gap(vertices: np.ndarray, upper: np.ndarray, lower: np.ndarray) -> float:
    """Smallest height of the upper edge above the lower one along both, mm; negative where they cross."""
    a, b = vertices[upper], vertices[lower]
    a, b = a[np.argsort(a[:, 0])], b[np.argsort(b[:, 0])]
    x = np.union1d(a[:, 0], b[:, 0])
    x = x[(x >= max(a[0, 0], b[0, 0])) & (x <= min(a[-1, 0], b[-1, 0]))]
    return float((np.interp(x, a[:, 0], a[:, 1]) - np.interp(x, b[:, 0], b[:, 1])).min())


def test_lips_never_cross_and_open():
    head = template()
    ((upper, lower),) = edges_of("mouth")
    for jaw_deg in JAW_DEG:
        # A rounding error is no crossing.
        assert gap(head.posed(jaw_deg=jaw_deg), upper, lower) > -1e-9
    middle = len(upper) // 2
    opened = head.posed(jaw_deg=30.0)
    # Upper and lower incisors of adults open about 40 to 60 mm; here 30 degrees about the condyles.
    assert 35.0 < opened[upper[middle], 1] - opened[lower[middle], 1] < 65.0
    assert np.isclose(head.jaw.weights[upper[0]], 0.42)


def test_control_lips_with_exchanged_weights_cross():
    head = template()
    ((upper, lower),) = edges_of("mouth")
    weights = head.jaw.weights.copy()
    weights[upper], weights[lower] = head.jaw.weights[lower], head.jaw.weights[upper]
    wrong = dataclasses.replace(head, jaw=dataclasses.replace(head.jaw, weights=weights))
    assert gap(wrong.posed(jaw_deg=10.0), upper, lower) < -1.0


@pytest.mark.parametrize("closed", CLOSED)
def test_lids_close_never_cross_and_stay_off_the_eyeball(closed):
    head = template()
    vertices = head.posed(lids_closed=closed)
    for (upper, lower), side in zip(edges_of("eyes"), head.lids.centres, strict=True):
        assert gap(vertices, upper, lower) > -1e-9
        if closed == 1.0:
            assert (vertices[upper, 1] - vertices[lower, 1]).max() < 0.5
        sheet = np.arange(make_grid(1.0).count)
        # 0.5 mm: about half of the lid's thickness is left everywhere.
        assert np.linalg.norm(vertices[sheet] - side, axis=1).min() > head.lids.radius + 0.5


def lids_off_eyeball(head: Head) -> float:
    """Largest distance of the edges of the left lids from the eyeball, mm."""
    edge = np.concatenate(edges_of("eyes")[0])
    return float(np.linalg.norm(head.vertices[edge] - head.lids.centres[0], axis=1).max() - head.lids.radius)


def test_lids_rest_on_the_eyeballs():
    # Furthest off is the inner corner, 4 mm before the ball on the measured face.
    assert lids_off_eyeball(template()) < 5.0


def test_control_the_lids_of_an_ellipsoid_do_not():
    assert lids_off_eyeball(ellipsoid()) > 5.0


@pytest.mark.parametrize(("motion", "match"), [({"jaw_deg": 31}, "30"), ({"lids_closed": 1.2}, "between 0 and 1")])
def test_motion_out_of_range_is_refused(motion, match):
    with pytest.raises(EvalkitError, match=match):
        template().posed(**motion)


def test_a_view_from_too_far_aside_is_told():
    turns = evalkit.geometry.rotation_from_vector(
        np.deg2rad([[0, 0, 0], [0, 29, 0], [0, 31, 0], [-31, 0, 0], [0, 0, 90]])
    )
    assert turned_too_far(turns).tolist() == [False, False, True, True, False]
    assert turned_too_far(turns[2], to_camera=turns[2][:, 2]).tolist() is False


# ---- files and checks ---------------------------------------------------------------------------------------------


def test_saved_and_read_back(tmp_path):
    head = template(1_000)
    head.save(tmp_path / "head.npz")
    again = evalkit.load_head(tmp_path / "head.npz")
    assert (again.vertices == head.vertices).all() and (again.triangles == head.triangles).all()
    assert again.parts == head.parts and list(again.regions) == list(head.regions)
    assert (again.posed(jaw_deg=20, lids_closed=0.5) == head.posed(jaw_deg=20, lids_closed=0.5)).all()
    assert (again.texture == head.texture).all()
    assert [path.name for path in tmp_path.iterdir()] == ["head.npz"]


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04 cut short"], ids=["empty", "text", "cut"])
def test_a_file_that_is_no_head_is_one_line(tmp_path, content):
    path = tmp_path / "x.npz"
    path.write_bytes(content)
    with pytest.raises(EvalkitError, match="not a head file") as caught:
        load_head(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(EvalkitError, match="no such file"):
        load_head(tmp_path / "y.npz")


def spoiled(head: Head, how: str) -> Head:
    vertices, triangles, first = head.vertices.copy(), head.triangles.copy(), head.triangles[0]
    change: dict[str, object] = {}
    if how == "not finite":
        vertices[5] = np.nan
    elif how == "degenerate":
        vertices[first[1]] = vertices[first[0]]
    elif how == "flipped":
        triangles[7] = triangles[7, ::-1]
    elif how == "inside out":
        triangles = triangles[:, ::-1].copy()
    elif how == "manifold":
        triangles[0] = [triangles[40][0], triangles[40][1], triangles[400][0]]
    elif how == "components":
        vertices = np.concatenate([vertices, vertices[first]])
        triangles[0] = len(head.vertices) + np.arange(3)
    elif how == "do not exist":
        triangles[3, 1] = len(vertices)
    elif how == "missing landmarks":
        change["landmarks"] = {name: place for name, place in head.landmarks.items() if name != "nose tip"}
    elif how == "off the skin":
        change["marker_sites"] = head.marker_sites | {"Chin": head.marker_sites["Chin"] + [0, 0, 8.0]}
    elif how == "are in several":
        change["regions"] = head.regions | {"neck": np.append(head.regions["neck"], head.regions["face"][0])}
    elif how == "are in none":
        change["regions"] = head.regions | {"face": head.regions["face"][1:]}
    return dataclasses.replace(head, vertices=vertices, triangles=triangles, **change)


@pytest.mark.parametrize(
    "how",
    ["not finite", "degenerate", "flipped", "inside out", "manifold", "components", "do not exist",
     "missing landmarks", "off the skin", "are in several", "are in none"],
)  # fmt: skip
def test_check_says_what_is_wrong(how):
    lines = check_head(spoiled(template(1_000), how))
    assert any(how in line for line in lines), lines
    assert all("\n" not in line for line in lines)
