"""Retargeting: warps and their Jacobians, correspondence, spread of markers, bases, coefficients of a head's shapes."""

from __future__ import annotations

import json
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from realdata import real_data
from scipy.optimize import lsq_linear
from small_head import small_head

from evalkit.control.cylindrical import Cylinder, correspond, covering, cylinder_about
from evalkit.control.retargeting import TargetBases, Transfer, retarget
from evalkit.control.shape_coefficients import fit_shapes
from evalkit.control.slits import vertex_sides
from evalkit.control.source import DEFAULT_SPREAD, barycentric_spread, performer_surface, point_places, spreads
from evalkit.control.targets import as_identity, checked_target, target_head
from evalkit.control.warp import WARP_KERNELS, find_folds, fit_warp
from evalkit.errors import EvalkitError
from evalkit.geometry import rotation_from_vector
from evalkit.head.model import Head
from evalkit.head.places import all_landmarks
from evalkit.seeds import generator
from evalkit.studies.retarget import DENSE, JACOBIAN, STILL, WITHOUT, WRONG, prepare, score
from evalkit.studies.retarget import run as run_method

SEEDS = st.integers(0, 10_000)
MATRIX = rotation_from_vector([0.2, -0.5, 0.1]) @ np.array([[1.3, 0.2, 0.0], [0.0, 0.8, 0.1], [0.1, 0.0, 1.1]])


def bent(seed, size_mm=4.0):
    """A face's landmarks, and where an affine map and a random way of some millimetres take them."""
    draw, places = generator("bent", seed=seed), all_landmarks()
    there = {name: MATRIX @ place + draw.normal(0.0, size_mm, 3) + [30.0, 0.0, 9.0] for name, place in places.items()}
    return places, there, draw


@pytest.mark.parametrize("kernel", WARP_KERNELS)
@settings(max_examples=5, deadline=None)
@given(seed=SEEDS)
def test_an_affine_warp_is_affine_everywhere(kernel, seed):
    places, there, draw = bent(seed, 0.0)
    warp, points = fit_warp(places, there, kernel), draw.normal(0.0, 100.0, (50, 3))
    # Rounding of lengths of 100 mm times a condition number of up to 1e4 (cubic): 1e-10 mm; measured 1e-11.
    np.testing.assert_allclose(warp(points), points @ MATRIX.T + [30.0, 0.0, 9.0], atol=1e-8)
    np.testing.assert_allclose(warp.jacobian(points), np.broadcast_to(MATRIX, (50, 3, 3)), atol=1e-9)


@pytest.mark.parametrize("kernel", WARP_KERNELS)
@settings(max_examples=5, deadline=None)
@given(seed=SEEDS)
def test_a_warp_meets_its_places_and_its_jacobian_is_its_derivative(kernel, seed):
    places, there, draw = bent(seed)
    warp = fit_warp(places, there, kernel)
    np.testing.assert_allclose(warp(np.array(list(places.values()))), list(there.values()), atol=1e-7)
    points = np.array(list(places.values())) + draw.normal(0.0, 15.0, (len(places), 3))
    step = 1e-3
    columns = [(warp(points + step * e) - warp(points - step * e)) / (2.0 * step) for e in np.eye(3)]
    # Rounding of 100 mm, some 1e-13, over the step, and the square of the step over that of the distance to a centre.
    np.testing.assert_allclose(warp.jacobian(points), np.stack(columns, axis=-1), atol=2e-5)
    other = "cubic" if kernel != "cubic" else "gaussian"
    assert np.abs(fit_warp(places, there, other).jacobian(points) - np.stack(columns, axis=-1)).max() > 1e-3


def test_at_its_own_centre_a_jacobian_is_finite():
    places, there, _ = bent(0)
    for kernel in WARP_KERNELS:
        assert np.isfinite(fit_warp(places, there, kernel).jacobian(np.array(list(places.values())))).all()


def test_folds_are_counted_and_named():
    places, _, _ = bent(0)
    share = np.linspace(0.05, 0.95, 20)[:, None]
    between = (1.0 - share) * places["upper lip"] + share * places["lower lip"]
    points = np.vstack([between, between + np.array([0.0, 60.0, 0.0])])
    smooth = fit_warp(places, places)
    none = find_folds(smooth, smooth.jacobian(points), points, places)
    assert not none.folded.any() and none.least == pytest.approx(1.0) and "no fold" in none.text
    crossed = places | {"upper lip": places["lower lip"], "lower lip": places["upper lip"]}
    warp = fit_warp(places, crossed)
    found = find_folds(warp, warp.jacobian(points), points, places)
    assert found.folded.any() and found.least < 0.0
    assert f"folded at {found.folded.sum()} of {len(points)}" in found.text and "lip" in found.text


def test_a_warp_that_cannot_be_is_one_line():
    places, there, _ = bent(0)
    with pytest.raises(EvalkitError, match="did you mean thin-plate"):
        fit_warp(places, there, "thin plate")
    with pytest.raises(EvalkitError, match="in one plane on the target"):
        fit_warp(places, {name: place * [1, 1, 0] for name, place in there.items()})
    with pytest.raises(EvalkitError, match="the 3 places of the same name"):
        fit_warp(dict(list(places.items())[:3]), there)


@settings(max_examples=8, deadline=None)
@given(seed=SEEDS)
def test_covering_finds_what_trying_all_triangles_finds(seed):
    draw = generator("covering", seed=seed)
    vertices, points = draw.uniform(0.0, 10.0, (30, 2)), draw.uniform(-1.0, 11.0, (40, 2))
    triangles = np.array([draw.choice(30, 3, replace=False) for _ in range(25)])
    found = covering(points, vertices, triangles)
    expected = set()
    for k, point in enumerate(points):
        for t, corners in enumerate(vertices[triangles]):
            ways = [(corners[(i + 1) % 3] - corners[i], point - corners[i]) for i in range(3)]
            side = [a[0] * b[1] - a[1] * b[0] for a, b in ways]
            if min(side) >= 0.0 or max(side) <= 0.0:
                expected.add((k, t))
    assert set(zip(found.point.tolist(), found.triangle.tolist(), strict=True)) == expected
    back = np.einsum("pk,pkd->pd", found.shares, vertices[triangles[found.triangle]])
    np.testing.assert_allclose(back, points[found.point], atol=1e-9)


def patch(radius=60.0, steps=21):
    """A grid on a cylinder of this radius, 60 degrees to both sides of the front and 80 mm high."""
    angle, height = np.meshgrid(np.linspace(-1.0, 1.0, steps), np.linspace(-40.0, 40.0, steps))
    points = np.stack([radius * np.sin(angle), height, radius * np.cos(angle)], axis=-1).reshape(-1, 3)
    at = np.arange(steps * steps).reshape(steps, steps)
    a, b, c, d = at[:-1, :-1].ravel(), at[:-1, 1:].ravel(), at[1:, 1:].ravel(), at[1:, :-1].ravel()
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


AXIS = Cylinder(np.zeros(3), np.eye(3), 60.0)


def corresponding(source, faces, target, target_faces):
    none = [np.zeros((len(points), 3), dtype=np.int8) for points in (source, target)]
    return correspond(AXIS, source, faces, target, target_faces, *none)


def test_a_patch_corresponds_to_itself_one_to_one():
    points, faces = patch()
    found = corresponding(points, faces, 1.1 * points * [1, 1 / 1.1, 1], faces)
    assert not found.report.overlaps.any() and not found.report.holes.any()
    assert found.report.turned_source == found.report.turned_target == 0
    np.testing.assert_allclose(found.matrix(len(points)) @ points, points, atol=1e-9)
    assert "441 of 441 vertices correspond one to one" in found.report.text


def test_a_surface_that_lies_over_itself_and_one_with_a_hole_are_reported():
    points, faces = patch()
    rows = np.arange(len(points)) // 21
    # A roll: rows 8 to 12 go back down by as much as they would go up, 10 mm further out, as a lip that hangs over.
    folded = points.copy()
    back = (rows > 8) & (rows <= 12)
    folded[back, 1] = points[rows == 8][0, 1] - (points[back, 1] - points[rows == 8][0, 1])
    folded[rows > 12, 1] -= 32.0
    folded[(rows > 8)] *= [70 / 60, 1, 70 / 60]
    found = corresponding(folded, faces, points, faces).report
    low, high = points[rows == 4][0, 1], points[rows == 8][0, 1]
    over = (points[:, 1] > low + 1e-6) & (points[:, 1] < high - 1e-6)
    assert found.overlaps[over].all() and not found.overlaps[(points[:, 1] < low - 1e-6)].any()
    assert found.turned_source == 2 * 20 * 4 and found.turned_target == 0
    # 32 mm shorter, so that the upper rows lie beside it.
    assert found.holes.sum() == (points[:, 1] > 8.0 + 1e-6).sum()
    assert f"{found.holes.sum()} beside it" in found.text


def test_opposite_lips_are_never_matched():
    head = small_head()
    sides = vertex_sides(head)
    skin = head.skin_vertices
    number = np.full(len(head.vertices), -1)
    number[skin] = np.arange(len(skin))
    # Lips of the target 6 mm too high: by place alone its lower lip would lie on the source's upper one.
    dense = correspond(
        cylinder_about(head.landmarks), head.vertices, head.part_triangles("skin", "lids"),
        head.vertices[skin] + [0.0, 6.0, 0.0], number[head.part_triangles("skin", "lids")], sides, sides[skin],
    )  # fmt: skip
    mean = np.sign(sides[dense.corners].sum(axis=1))
    assert not (mean * sides[skin] < 0).any()
    blind = correspond(
        cylinder_about(head.landmarks), head.vertices, head.part_triangles("skin", "lids"),
        head.vertices[skin] + [0.0, 6.0, 0.0], number[head.part_triangles("skin", "lids")], 0 * sides, 0 * sides[skin],
    )  # fmt: skip
    assert (np.sign(sides[blind.corners].sum(axis=1)) * sides[skin] < 0)[:, 0].any(), "control"


def moves_of(head, count=3):
    draw = generator("moves", seed=0)
    return draw.normal(0.0, 3.0, (count, *head.vertices.shape))


def test_a_head_s_motion_on_itself_is_itself():
    head = small_head()
    made, moves = Transfer(head, head), moves_of(head)
    found = made.displacements(moves)
    skin = np.setdiff1d(head.skin_vertices, head.skin_vertices[made.report.holes | made.report.overlaps])
    assert len(skin) > 0.85 * len(head.skin_vertices)
    np.testing.assert_allclose(found[:, skin], moves[:, skin], atol=1e-8)
    assert not found[:, head.part_vertices("eyeballs")].any()


def test_motion_on_an_affine_image_is_that_motion_transformed():
    head = small_head()
    there = affine_image(head)
    made, moves = Transfer(head, there), moves_of(head)
    skin = head.skin_vertices[~(made.report.holes | made.report.overlaps)]
    off = made.displacements(moves)[:, skin] - moves[:, skin] @ MATRIX.T
    # The circle about a sheared head cuts triangles elsewhere: places agree where surfaces do, to rounding.
    assert np.median(np.abs(off)) < 1e-8
    bare = Transfer(head, there, jacobian=False).displacements(moves)[:, skin]
    assert np.median(np.abs(bare - moves[:, skin] @ MATRIX.T)) > 0.3, "control"


def affine_image(head: Head) -> Head:
    def there(places):
        return {name: MATRIX @ place + [30.0, 0.0, 9.0] for name, place in places.items()}

    return replace(
        head, vertices=head.vertices @ MATRIX.T + [30.0, 0.0, 9.0], landmarks=there(head.landmarks),
        marker_sites=there(head.marker_sites), jaw=None, lids=None,
    )  # fmt: skip


def markers(head):
    """Labels and rest positions of all known points and sites of a head."""
    near = head.nearest_vertices(point_places(head) | head.marker_sites)
    return list(near), head.vertices[list(near.values())]


def test_a_blend_of_the_target_s_bases_is_the_direct_way():
    head = small_head()
    labels, rest = markers(head)
    draw = generator("blend", seed=0)
    bases, coefficients = draw.normal(0.0, 4.0, (6, len(labels), 3)), draw.normal(0.0, 1.0, (40, 6))
    target = affine_image(head)
    made = retarget(labels, rest, bases, target)
    source = performer_surface(labels, rest)
    marks = np.tensordot(coefficients, bases, axes=1)
    weights = spreads[DEFAULT_SPREAD](source)
    spread = np.stack([weights @ one for one in marks])
    direct = Transfer(source.head, target).displacements(spread)
    found = made.bases.displacements(coefficients)
    # Of the largest motion; float32 has 6e-8, summed over six bases.
    assert np.abs(found - direct).max() < 1e-5 * np.abs(direct).max()
    # Positions of 250 mm are rounded to 8e-6 mm at half a last place.
    np.testing.assert_allclose(made.vertices(coefficients), target.vertices + direct, atol=1e-4)
    np.testing.assert_allclose(made.coefficients(marks), coefficients, atol=1e-9)
    assert len(made.text.splitlines()) == 3
    jaw = np.abs(made.bases.displacements(1.1 * coefficients) - direct).max()
    assert jaw > 1e-3 * np.abs(direct).max(), "control"


def test_bases_take_frames_in_batches_and_one_by_one():
    draw = generator("batches", seed=0)
    bases = TargetBases(draw.normal(0.0, 90.0, (70, 3)), draw.normal(0.0, 3.0, (4, 70, 3)))
    coefficients = draw.normal(0.0, 1.0, (71, 4))
    out = np.empty((1, 70, 3), dtype=np.float32)
    alone = np.concatenate([bases.vertices(row[None], out).copy() for row in coefficients])
    # A product of one row may sum in another order: one last place of 300 mm.
    np.testing.assert_allclose(bases.vertices(coefficients), alone, atol=1e-4)
    with pytest.raises(EvalkitError, match=r"expected \(frames, 4\)"):
        bases.vertices(np.zeros((2, 5)))
    with pytest.raises(EvalkitError, match=r"expected \(bases, 70, 3\)"):
        TargetBases(np.zeros((70, 3)), np.zeros((4, 69, 3)))


@pytest.mark.parametrize("spread", spreads)
def test_lips_keep_apart_lids_stay_and_the_edge_of_the_face_is_held(spread):
    head = small_head()
    labels, rest = markers(head)
    source = performer_surface(labels, rest)
    weights = spreads[spread](source).toarray()
    lower = [k for k, label in enumerate(labels) if label.startswith("LowerLip") or label in ("lower lip", "Chin")]
    mouth = [k for k, label in enumerate(labels) if "lip" in label.lower() or label.startswith(("mouth", "Mouth"))]
    near = source.head.nearest_vertices(source.head.landmarks)
    pull = np.abs(weights[near["upper lip"], lower]).sum()
    if spread == "barycentric without slits":
        margin = np.intersect1d(source.head.regions["upper lip"], source.head.skin_vertices)
        assert np.abs(weights[margin][:, lower]).sum(axis=1).max() > 0.3, "control"
    elif spread == "barycentric":
        own = np.intersect1d(source.head.regions["upper lip"], source.head.skin_vertices)
        share = vertex_sides(source.head)[own, 0]
        assert (share == 1).all() and np.abs(weights[own][:, lower]).sum(axis=1).max() < 1e-9
    else:
        assert pull < 0.05
    for lid in ("upper lid inner left", "lower lid outer right"):
        assert np.abs(weights[near[lid], mouth]).sum() < 0.05
    held = np.concatenate([source.head.regions["neck"], source.head.regions["hindbrain"]])
    if spread != "kernel":
        assert not weights[held].any()


def test_the_mouth_of_a_target_opens_as_far_as_the_performer_s():
    pair = prepare(0, "template to person of 1000", "barycentric")
    right = score(pair, run_method(pair, JACOBIAN))
    # The markers of lips and chin move as truth does; what is between them bends. Measured 0.90 to 1.00.
    assert 0.8 < right["opening_share"] < 1.2 and abs(right["upper_lip_mm"]) < 0.3
    assert abs(right["lids_follow_mm"]) < 0.2
    torn = score(pair, run_method(replace(pair, motion="barycentric without slits"), JACOBIAN))
    # The middles of the lips have markers; between these, lips without slits stick together. Measured 1.6 times.
    assert torn["lips_share"] > 1.25 * right["lips_share"]


def test_the_study_tells_right_from_wrong():
    pair = prepare(1, "template to muzzle of 1000", DENSE)
    share = {name: score(pair, run_method(pair, name))["all_share"] for name in (STILL, JACOBIAN, WITHOUT, WRONG)}
    assert share[STILL] == pytest.approx(1.0)
    assert share[JACOBIAN] < 0.5 * share[WITHOUT] < 0.5 * share[STILL] < 0.5 * share[WRONG]
    truth = score(pair, pair.truth)
    assert truth["all_mm"] == truth["lids_mm"] == truth["lids_follow_mm"] == 0.0 and truth["opening_share"] == 1.0


def test_markers_that_are_not_on_the_face_are_left_out_and_told():
    head = small_head()
    labels, rest = markers(head)
    source = performer_surface([*labels, "Helmet"], np.vstack([rest, [0.0, 220.0, 0.0]]))
    assert "Helmet" in source.text and len(labels) not in source.used
    weights = barycentric_spread(source)
    assert not weights[:, [len(labels)]].toarray().any()
    # The skin passes through the markers.
    near = source.head.nearest_vertices(dict(zip(map(str, source.used), source.places, strict=True)))
    off = np.linalg.norm(source.head.vertices[list(near.values())] - source.places, axis=1)
    # Half an edge of a mesh of 1,400 vertices.
    assert np.median(off) < 4.0


def test_what_cannot_be_retargeted_is_one_line(tmp_path):
    head = small_head()
    labels, rest = markers(head)
    none = np.zeros((1, len(labels), 3))
    with pytest.raises(EvalkitError, match=r"only 0 markers are on a known point"):
        retarget([f"M{k}" for k in range(len(labels))], rest, none, head)
    broken = rest.copy()
    broken[3, 1] = np.nan
    with pytest.raises(EvalkitError, match=f"marker {labels[3]} has no rest position"):
        retarget(labels, broken, none, head)
    with pytest.raises(EvalkitError, match="bases have shape"):
        retarget(labels, rest, none[:, :-1], head)
    with pytest.raises(EvalkitError, match="spread 'linear' is not known; known are barycentric"):
        retarget(labels, rest, none, head, spread="linear")
    with pytest.raises(EvalkitError, match="motion has shape"):
        Transfer(head, head).displacements(np.zeros((2, 5, 3)))
    with pytest.raises(EvalkitError) as told:
        checked_target(replace(head, landmarks={"chin": head.landmarks["chin"]}, name="mine"))
    assert "mine: cannot be a target, 11 of 12 landmarks are missing (nose tip" in str(told.value)
    assert '{"landmarks": {"nose tip": 1225' in str(told.value) and "\n" not in str(told.value)
    with pytest.raises(EvalkitError, match="no identity 'identity009'; it has none"):
        as_identity(head, "identity009")
    with pytest.raises(EvalkitError, match="no such file"):
        target_head(tmp_path / "none.npz")
    (tmp_path / "torn.npz").write_bytes(b"PK\x03\x04 torn")
    with pytest.raises(EvalkitError, match="not a head file"):
        target_head(tmp_path / "torn.npz")


def user_mesh(folder, head):
    """A head's skin as somebody's mesh file, in centimetres, and its landmarks as JSON."""
    which = head.skin_vertices
    number = np.full(len(head.vertices), -1)
    number[which] = np.arange(len(which))
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in 0.1 * head.vertices[which]]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in number[head.part_triangles("skin", "lids")]]
    (folder / "face.obj").write_text("\n".join(lines) + "\n")
    places = {name: (0.1 * place).tolist() for name, place in head.landmarks.items()}
    (folder / "face.json").write_text(json.dumps({"unit_mm": 10.0, "landmarks": places}))
    return which


def test_a_user_s_mesh_with_landmarks_is_a_target(tmp_path):
    head = small_head()
    which = user_mesh(tmp_path, head)
    mesh = target_head(tmp_path / "face.obj")
    assert all(len(mesh.regions[lip]) > 5 for lip in ("upper lip", "lower lip"))
    moves = moves_of(head)
    made = Transfer(head, mesh)
    sure = ~(made.report.holes | made.report.overlaps)
    # Its lips are found anew, by distance over the skin: where they end they may be told otherwise.
    assert np.median(np.abs(made.displacements(moves) - moves[:, which])[:, sure]) < 1e-3
    (tmp_path / "face.json").unlink()
    with pytest.raises(EvalkitError, match="a mesh needs a JSON of landmarks"):
        target_head(tmp_path / "face.obj")


def test_the_canonical_face_and_an_identity_of_ict_are_targets():
    folder = real_data() / "meshes"
    canonical = target_head(folder / "mediapipe_canonical_face.obj")
    made = Transfer(small_head(), canonical)
    assert made.report.vertices == 468 and made.report.holes.mean() < 0.1 and not made.folds.folded.any()
    mean = target_head(folder / "ict_facekit_subset.npz")
    person = as_identity(mean, "identity003")
    assert np.linalg.norm(person.landmarks["chin"] - mean.landmarks["chin"]) > 0.5
    assert any((person.vertices == person.landmarks["chin"]).all(axis=1))


def test_a_head_file_is_a_target_as_itself_and_as_another_person(tmp_path):
    shaped_head().save(tmp_path / "head.npz")
    head, other = target_head(tmp_path), target_head(tmp_path / "head.npz", identity="identity000")
    which, moves = head.blendshapes["identity000"]
    # Shapes are kept in single precision.
    np.testing.assert_allclose(other.vertices[which], head.vertices[which] + moves, atol=1e-5)


def shaped_head():
    """The small head with four shapes, two of which overlap, an identity, and a shape of the eyeballs."""
    head, draw = small_head(), generator("shapes", seed=0)
    shapes = {}
    for k, name in enumerate(("jawOpen", "mouthSmileLeft", "browInnerUp", "mouthFunnel")):
        which = head.skin_vertices[200 * (k % 3) : 200 * (k % 3) + 300]
        shapes[name] = (which, draw.normal(0.0, 2.0, (len(which), 3)))
    balls = head.part_vertices("eyeballs")
    others = {"identity000": shapes["jawOpen"], "eyeLookUpLeft": (balls, draw.normal(0.0, 2.0, (len(balls), 3)))}
    return replace(head, blendshapes=shapes | others)


def test_coefficients_of_a_head_s_own_shapes_are_found(tmp_path):
    head, draw = shaped_head(), generator("amounts", seed=0)
    bases = np.zeros((4, *head.vertices.shape))
    names = [name for name in head.blendshapes if not name.startswith(("identity", "eyeLook"))]
    for k, name in enumerate(names):
        bases[k, head.blendshapes[name][0]] = head.blendshapes[name][1]
    target, amounts = TargetBases(head.vertices, bases), draw.uniform(0.0, 1.0, (30, 4))
    found = fit_shapes(head, target, amounts)
    assert found.names == tuple(names)
    # The ridge of 1e-4 of a shape's size holds each back by as much, a little more where shapes overlap.
    np.testing.assert_allclose(found.values, amounts, atol=1e-3)
    assert found.residual_mm.max() < 1e-3 * found.motion_mm.max()
    beyond = fit_shapes(head, target, amounts + 1.0)
    assert beyond.values.max() <= 1.0 and beyond.residual_mm.min() > 0.1
    found.save(tmp_path / "out.csv", rate_hz=30.0)
    lines = (tmp_path / "out.csv").read_text().splitlines()
    assert lines[0] == "frame,time_s,jawOpen,mouthSmileLeft,browInnerUp,mouthFunnel,residual_mm" and len(lines) == 31
    assert float(lines[4].split(",")[1]) == 0.1
    np.testing.assert_allclose([float(x) for x in lines[1].split(",")[2:6]], found.values[0], atol=1e-5)
    with pytest.raises(EvalkitError, match="cannot write the coefficients"):
        found.save(tmp_path / "none" / "out.csv", rate_hz=30.0)
    with pytest.raises(EvalkitError, match="has no shapes"):
        fit_shapes(small_head(), target, amounts)


@settings(max_examples=8, deadline=None)
@given(seed=SEEDS)
def test_bounded_coefficients_are_those_of_least_squares(seed):
    from evalkit.control.shape_coefficients import bounded

    draw = generator("bounded", seed=seed)
    matrix, goals = draw.normal(0.0, 1.0, (40, 7)) * draw.uniform(0.2, 5.0, 7), draw.normal(0.0, 4.0, (5, 40))
    found = bounded(matrix.T @ matrix, goals @ matrix)
    expected = [lsq_linear(matrix, goal, bounds=(0.0, 1.0), method="bvls").x for goal in goals]
    np.testing.assert_allclose(found, expected, atol=1e-5)


@pytest.mark.timing
def test_a_frame_of_50000_vertices_and_25_bases_takes_no_longer_than_copying_the_bases(record_property):
    """15 MB: 3 ms on the machine on which one frame took 0.7 to 1.1 ms, and 0.5 ms in batches."""
    draw = generator("speed", seed=0)
    bases = TargetBases(draw.normal(0.0, 90.0, (50_000, 3)), draw.normal(0.0, 3.0, (25, 50_000, 3)))
    coefficients = draw.normal(0.0, 1.0, (32, 25)).astype(np.float32)
    one, many = (np.empty((count, 50_000, 3), dtype=np.float32) for count in (1, 32))
    other = np.empty_like(bases.bases)
    times = []
    for _ in range(20):
        start = time.perf_counter()
        np.copyto(other, bases.bases)
        copied = time.perf_counter()
        bases.vertices(coefficients[:1], one)
        alone = time.perf_counter()
        bases.vertices(coefficients, many)
        times.append((copied - start, alone - copied, (time.perf_counter() - alone) / 32))
    # Each at its best: of a single pair, either may have been interrupted.
    copy, frame, batch = np.min(times, axis=0)
    told = {"copy_ms": 1e3 * copy, "frame_ms": 1e3 * frame, "of_batch_ms": 1e3 * batch}
    for name, value in told.items():
        record_property(name, value)
    print(told)
    assert frame < copy and batch < 0.5 * copy, told
