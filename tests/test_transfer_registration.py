"""Meshes of different topology: registration, triangle correspondence, Deformation Transfer; two artists' heads."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from realdata import real_data
from scipy.spatial import Delaunay

from evalkit.errors import EvalkitError
from evalkit.seeds import generator
from evalkit.transfer.correspondence import (
    Correspondence,
    correspondence_of,
    corresponding,
    read_correspondence,
    same_topology,
    topology_hash,
)
from evalkit.transfer.deformation_transfer import DeformationTransfer, still_vertices
from evalkit.transfer.gradients import deformation_gradients
from evalkit.transfer.registration import (
    Surface,
    border,
    closest_on_triangles,
    neighbours,
    register,
    vertex_normals,
)

WIDTH, HEIGHT = 80.0, 100.0


def face_like(uv):
    """A bumpy sheet over (u, v) in the unit square, mm: a brow, a nose, a chin."""
    x, y = WIDTH * (uv[:, 0] - 0.5), HEIGHT * (uv[:, 1] - 0.5)
    z = 40.0 - x**2 / 60.0 - y**2 / 200.0
    for at, size, height in (((0.0, 0.0), 9.0, 16.0), ((0.0, 30.0), 14.0, 4.0), ((0.0, -35.0), 11.0, 6.0)):
        z += height * np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / (2.0 * size**2))
    return np.stack([x, y, z], axis=1)


def warp(points):
    """A smooth change of proportions, a longer nose, fuller cheeks, and another size and place."""
    x, y, z = (points / 50.0).T
    for at, size, height in (((0.0, -0.1), 0.2, 0.15), ((0.4, -0.35), 0.17, 0.1), ((-0.4, -0.35), 0.17, 0.1)):
        z = z + height * np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / (2.0 * size**2))
    bent = np.stack([x * (1.0 + 0.15 * y), y + 0.12 * np.sin(1.5 * x), z * 1.1 + 0.1 * x * y], axis=1)
    return 60.0 * bent + [5.0, -8.0, 3.0]


def grid(columns, rows):
    u, v = np.meshgrid(np.linspace(0.0, 1.0, columns), np.linspace(0.0, 1.0, rows))
    k = np.arange(columns * rows).reshape(rows, columns)
    a, b, c, d = k[:-1, :-1].ravel(), k[:-1, 1:].ravel(), k[1:, 1:].ravel(), k[1:, :-1].ravel()
    return np.stack([u.ravel(), v.ravel()], axis=1), np.concatenate([np.c_[a, b, c], np.c_[a, c, d]])


def scattered(count):
    """Random places of the unit square with its rim, triangulated: no topology of a grid."""
    along = np.linspace(0.0, 1.0, 24)
    rim = np.concatenate([np.c_[along, 0 * along], np.c_[along, 0 * along + 1.0], np.c_[0 * along, along][1:-1],
                          np.c_[0 * along + 1.0, along][1:-1]])  # fmt: skip
    uv = np.concatenate([rim, generator("scattered places").uniform(0.02, 0.98, (count, 2))])
    triangles = Delaunay(uv).simplices.astype(np.intp)
    a, b, c = (uv[triangles[:, k]] for k in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    triangles[area < 0.0] = triangles[area < 0.0][:, ::-1]
    return uv, triangles[np.abs(area) > 1e-6]


MARKS = np.array([(u, v) for v in (0.08, 0.35, 0.65, 0.92) for u in (0.1, 0.5, 0.9)])


@lru_cache(maxsize=1)
def bent_pair():
    """A sheet, and its warped copy with another triangulation; landmarks on both."""
    uv, triangles = grid(25, 31)
    other_uv, other = scattered(900)
    # A landmark stands for a vertex of the source: its true place on the target is that of this vertex.
    held = [int(np.linalg.norm(uv - mark, axis=1).argmin()) for mark in MARKS]
    rest = face_like(uv)
    source = Surface(rest, triangles, {str(k): rest[i] for k, i in enumerate(held)})
    target = Surface(
        warp(face_like(other_uv)), other, {str(k): warp(face_like(uv[i : i + 1]))[0] for k, i in enumerate(held)}
    )
    return source, target, warp(rest)


@lru_cache(maxsize=1)
def bent_registered():
    source, target, _ = bent_pair()
    return register(source, target)


@lru_cache(maxsize=1)
def bent_correspondence():
    source, target, _ = bent_pair()
    return correspondence_of(replace(source, vertices=bent_registered()), target)


def rms(a):
    return float(np.sqrt((np.asarray(a) ** 2).sum(axis=-1).mean()))


def median_edge(vertices, triangles):
    return float(np.median(np.linalg.norm(vertices[triangles[:, 0]] - vertices[triangles[:, 1]], axis=1)))


def test_registration_finds_a_known_warp_of_another_triangulation():
    source, target, truth = bent_pair()
    edge = median_edge(truth, source.triangles)
    inner = ~border(source.triangles, len(truth))
    normals = vertex_normals(truth, source.triangles)[inner]

    def errors(moved):
        off = (moved - truth)[inner]
        return rms(off) / edge, rms(np.einsum("vi,vi->v", off, normals)[:, None]) / edge

    everywhere, outward = errors(bent_registered())
    _, outward_without_surface = errors(register(source, target, closest=()))
    four = {name: source.landmarks[name] for name in ("0", "1", "2", "4")}
    without_landmarks, _ = errors(register(replace(source, landmarks=four), target))
    # Along the surface only landmarks and smoothness tell where a point belongs (0.14 edges here); across it the other
    # surface does, up to the facets of the two triangulations (0.02).
    assert everywhere < 0.2
    assert outward < 0.03
    assert outward_without_surface > 4.0 * outward
    assert without_landmarks > 3.0 * everywhere


def test_registration_does_not_depend_on_pose_or_unit():
    source, target, _ = bent_pair()
    turn = np.linalg.qr(generator("turn").standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))

    def elsewhere(points):
        return 0.01 * points @ turn + [3.0, 4.0, 5.0]

    moved = Surface(
        elsewhere(source.vertices), source.triangles, {k: elsewhere(v) for k, v in source.landmarks.items()}
    )
    # Only rounding differs; matches that flip by it move a vertex by far less than this share of the face.
    assert np.abs(register(moved, target) - bent_registered()).max() < 1e-6 * WIDTH


def test_landmarks_are_met_exactly():
    source, target, _ = bent_pair()
    held = [int(np.linalg.norm(source.vertices - place, axis=1).argmin()) for place in source.landmarks.values()]
    moved = bent_registered()
    np.testing.assert_array_equal(moved[held], [target.landmarks[name] for name in source.landmarks])


def slit_sheet(columns, rows, height):
    """A flat sheet with a slit from a quarter to three quarters of the width; its lips touch.

    Returns vertices, triangles, labels, and the pairs of vertices on the two lips.
    """
    uv, triangles = grid(columns, rows)
    row = round(height * (rows - 1))
    on = np.flatnonzero((np.arange(len(uv)) // columns == row) & (np.abs(uv[:, 0] - 0.5) < 0.25))
    twin = np.arange(len(uv))
    twin[on] = len(uv) + np.arange(len(on))
    below = uv[triangles].mean(axis=1)[:, 1] < row / (rows - 1)
    triangles = np.where(below[:, None], twin[triangles], triangles)
    uv = np.concatenate([uv, uv[on]])
    lower = (uv[:, 1] < row / (rows - 1) - 1e-9) | (np.arange(len(uv)) >= len(twin))
    near = (np.abs(uv[:, 1] - row / (rows - 1)) < 0.2) & (np.abs(uv[:, 0] - 0.5) < 0.3)
    labels = np.where(near, np.where(lower, "lower lip", "upper lip"), "skin")
    return face_like_flat(uv), triangles, labels, (on, np.arange(len(twin), len(uv)))


def face_like_flat(uv):
    """A gently bent sheet: its normals do not tell the lips apart."""
    x, y = WIDTH * (uv[:, 0] - 0.5), HEIGHT * (uv[:, 1] - 0.5)
    return np.stack([x, y, -(x**2) / 120.0], axis=1)


def corners(vertices):
    """Landmarks at the sheet's corners and the middles of its sides: none at the lips."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    out = {}
    for a in (0.0, 0.5, 1.0):
        for b in (0.0, 1.0):
            place = np.array([low[0] + a * (high[0] - low[0]), low[1] + b * (high[1] - low[1])])
            out[f"{a} {b}"] = vertices[np.linalg.norm(vertices[:, :2] - place, axis=1).argmin()]
    return out


def opened_gap(labelled):
    """How far the target's lips part when the source's part by 20 mm; their slits are not at the same height."""
    rest, triangles, labels, (_, lower) = slit_sheet(33, 41, 0.4)
    on, faces, kinds, (upper_there, lower_there) = slit_sheet(25, 31, 0.5)
    source = Surface(rest, triangles, corners(rest), labels if labelled else None)
    target = Surface(on, faces, corners(on), kinds if labelled else None)
    shape = rest.copy()
    slit = rest[lower[0], 1]
    belongs = (rest[:, 1] < slit - 1e-9) | (np.arange(len(rest)) >= lower[0])
    drop = np.cos(np.pi * np.clip(np.abs(rest[:, 0]) / (0.5 * WIDTH), 0.0, 0.5)) ** 2
    shape[:, 1] -= np.where(belongs, 20.0 * drop * np.clip(1.0 - (slit - rest[:, 1]) / 35.0, 0.0, 1.0), 0.0)
    between = correspondence_of(replace(source, vertices=register(source, target)), target)
    pinned = still_vertices(rest, triangles, shape[None], faces, between)
    out = DeformationTransfer(rest, triangles, on, faces, between, pinned).transfer(shape[None])[0]
    middle = np.abs(on[upper_there, 0]).argmin()
    return float(out[upper_there[middle], 1] - out[lower_there[middle], 1])


def test_lips_open_on_the_target_and_glue_without_labels():
    with_labels, without = opened_gap(True), opened_gap(False)
    print(with_labels, without)
    assert 14.0 < with_labels < 26.0
    assert without < 0.5 * with_labels


def shapes_of(rest, number=3):
    """Smooth bumps that move no border."""
    random = generator("bumps")
    out = []
    for _ in range(number):
        at, way = random.uniform(-15.0, 15.0, 2), 8.0 * random.standard_normal(3)
        reach = np.linalg.norm(rest[:, :2] - at, axis=1) / 22.0
        out.append(rest + np.clip(1.0 - reach**2, 0.0, None)[:, None] ** 2 * way)
    return np.array(out)


def test_another_numbering_of_the_same_mesh_gives_its_shapes_back():
    uv, triangles = grid(15, 17)
    rest = face_like(uv)
    random = generator("renumbered")
    order, row = random.permutation(len(rest)), random.permutation(len(triangles))
    number = np.argsort(order)
    other, faces = rest[order], np.roll(number[triangles[row]], 1, axis=1)
    between = correspondence_of(Surface(rest, triangles), Surface(other, faces), both=False)
    assert (between.source != between.target).any()
    shapes = shapes_of(rest)
    pinned = still_vertices(rest, triangles, shapes, faces, between)
    moved = DeformationTransfer(rest, triangles, other, faces, between, pinned).transfer(shapes)
    # The least squares problem has a solution without error: only the rounding of a solve is left.
    np.testing.assert_allclose(moved, shapes[:, order], atol=1e-9 * WIDTH)


def test_a_finer_copy_takes_the_shapes():
    uv, triangles = grid(15, 17)
    rest = face_like(uv)
    fine_uv, faces = grid(29, 33)
    fine = face_like(fine_uv)
    source, target = Surface(rest, triangles), Surface(fine, faces)
    shapes, truth = shapes_of(rest), shapes_of(fine)
    error = {}
    for both in (True, False):
        between = correspondence_of(source, target, both=both)
        pinned = still_vertices(rest, triangles, shapes, faces, between)
        moved = DeformationTransfer(rest, triangles, fine, faces, between, pinned).transfer(shapes)
        error[both] = rms(moved - truth) / rms(truth - fine)
    shuffled = generator("shuffled").permutation(len(triangles))
    wrong = replace(between, source=shuffled[between.source])
    moved = DeformationTransfer(rest, triangles, fine, faces, wrong, pinned).transfer(shapes)
    print(error)
    # A coarse triangle has one gradient where the bump has all between; a quarter of its slope at the most.
    assert max(error.values()) < 0.15
    assert rms(moved - truth) / rms(truth - fine) > 5.0 * max(error.values())


def test_identity_and_scale():
    source, target, _ = bent_pair()
    between = bent_correspondence()
    big = DeformationTransfer(7.0 * source.vertices, source.triangles, target.vertices, target.triangles, between)
    same = DeformationTransfer(source.vertices, source.triangles, target.vertices, target.triangles, between)
    rest = same.transfer(source.vertices[None])
    np.testing.assert_allclose(rest[0], target.vertices, atol=1e-9 * WIDTH)
    shapes = shapes_of(source.vertices)
    np.testing.assert_allclose(big.transfer(7.0 * shapes), same.transfer(shapes), atol=1e-9 * WIDTH)
    assert same.transfer(np.zeros((0, *source.vertices.shape))).shape == (0, *target.vertices.shape)


def test_a_rigid_motion_turns_the_target_about_its_mean():
    source, target, _ = bent_pair()
    between = bent_correspondence()
    angle = 0.4
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    transfer = DeformationTransfer(source.vertices, source.triangles, target.vertices, target.triangles, between)
    moved = transfer.transfer((source.vertices @ turn.T + [40.0, 0.0, 9.0])[None])[0]
    middle = target.vertices.mean(axis=0)
    np.testing.assert_allclose(moved, (target.vertices - middle) @ turn.T + middle, atol=1e-9 * WIDTH)


def test_transfer_is_the_paper_s_full_system():
    """The oracle has every fourth vertex among its unknowns and is solved densely."""
    uv, triangles = grid(4, 5)
    rest = face_like(uv)
    other_uv, faces = grid(5, 4)
    other = warp(face_like(other_uv))
    shapes = shapes_of(rest, 2)
    between = correspondence_of(Surface(warp(rest), triangles), Surface(other, faces))
    pinned = np.zeros(len(other), dtype=bool)
    pinned[[0, 7]] = True
    ours = DeformationTransfer(rest, triangles, other, faces, between, pinned).transfer(shapes)
    for shape, found in zip(shapes, ours, strict=True):
        wanted = deformation_gradients(rest, shape, triangles)
        count = len(other)
        rows, right = [], []
        for t, (i, j, k) in enumerate(faces):
            a, b = other[j] - other[i], other[k] - other[i]
            c = np.cross(a, b)
            inverse = np.linalg.inv(np.stack([a, b, c / np.sqrt(np.linalg.norm(c))], axis=1))
            partners = between.source[between.target == t]
            mean = np.mean([wanted[:, :, p] for p in partners], axis=0)
            for axis in range(3):
                row = np.zeros(count + len(faces))
                row[[j, k, count + t]] = inverse[:, axis]
                row[i] = -inverse[:, axis].sum()
                rows.append(row)
                right.append(mean[:, axis])
        matrix, right = np.array(rows), np.array(right)
        free = np.r_[np.flatnonzero(~pinned), count : count + len(faces)]
        solved = np.linalg.lstsq(matrix[:, free], right - matrix[:, :count][:, pinned] @ other[pinned], rcond=None)[0]
        expected = other.copy()
        expected[~pinned] = solved[: (~pinned).sum()]
        np.testing.assert_allclose(found, expected, atol=1e-9 * WIDTH)


def test_closest_points_of_triangles_are_no_farther_than_any_other():
    random = generator("closest points")
    a, b, c, p = random.standard_normal((4, 200, 3))
    found = closest_on_triangles(p, a, b, c)
    share = random.dirichlet([0.5, 0.5, 0.5], 3000)
    dense = np.einsum("sk,kti->sti", share, np.stack([a, b, c]))
    nearest = np.linalg.norm(dense - p, axis=2).min(axis=0)
    off = np.linalg.norm(found - p, axis=1)
    assert (off <= nearest + 1e-12).all()
    # Samples lie about 0.05 apart: the closest of them is hardly farther than the closest point.
    assert (nearest - off).max() < 0.05


def test_neighbours_share_an_edge():
    _, triangles = scattered(60)
    pairs = neighbours(triangles)
    slow = [
        (i, j)
        for i in range(len(triangles))
        for j in range(i + 1, len(triangles))
        if len(set(triangles[i]) & set(triangles[j])) == 2
    ]
    assert sorted(map(tuple, np.sort(pairs, axis=1).tolist())) == slow


def test_a_correspondence_is_kept_and_belongs_to_its_meshes(tmp_path):
    source, target, _ = bent_pair()
    between = bent_correspondence()
    path = tmp_path / "pairs.npz"
    between.save(path)
    again = read_correspondence(path, source.triangles, target.triangles)
    np.testing.assert_array_equal(again.source, between.source)
    np.testing.assert_array_equal(again.target, between.target)
    assert [file.name for file in tmp_path.iterdir()] == ["pairs.npz"]
    with pytest.raises(EvalkitError, match=r"pairs\.npz: was made for another source mesh"):
        read_correspondence(path, source.triangles[:-1], target.triangles)
    with pytest.raises(EvalkitError, match=r"pairs\.npz: was made for another target mesh"):
        read_correspondence(path, source.triangles, target.triangles[::-1])
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(EvalkitError, match=r"pairs\.npz: not a correspondence file"):
        read_correspondence(path, source.triangles, target.triangles)
    with pytest.raises(EvalkitError, match=r"none\.npz: no such file"):
        read_correspondence(tmp_path / "none.npz", source.triangles, target.triangles)
    with pytest.raises(EvalkitError, match="cannot write the correspondence"):
        between.save(tmp_path / "no folder" / "pairs.npz")


def test_what_was_registered_is_not_registered_again(tmp_path, monkeypatch):
    calls = []

    def counted(*surfaces):
        calls.append(surfaces)
        return register(*surfaces)

    monkeypatch.setattr("evalkit.transfer.correspondence.register", counted)
    monkeypatch.setattr("evalkit.transfer.correspondence.cache_folder", lambda: tmp_path / "cache")
    source, target, _ = bent_pair()
    first, again = corresponding(source, target), corresponding(source, target)
    np.testing.assert_array_equal(first.source, again.source)
    assert len(calls) == 1
    moved = source.vertices.copy()
    moved[400] += 0.1
    corresponding(replace(source, vertices=moved), target)
    assert len(calls) == 2
    # The other way round is known from the same registration, in which the coarser is bent.
    back = corresponding(target, source)
    assert len(calls) == 2
    assert all(len(one.vertices) <= len(other.vertices) for one, other in calls)
    assert back.source_hash == first.target_hash


def test_a_correspondence_of_a_user_is_checked():
    _, triangles = grid(3, 3)
    known = topology_hash(triangles)
    whole = np.arange(len(triangles))
    same_topology(triangles).check(triangles, triangles)
    for source, target, message in (
        (whole[1:], whole[1:], "target triangle 0 has no partner"),
        (whole + 1, whole, "pair 7 names source triangle 8, of 8"),
        (whole[1:], whole, "no pairs"),
    ):
        with pytest.raises(EvalkitError, match=message):
            Correspondence(source, target, known, known).check(triangles, triangles, "mine.npz")


def test_what_cannot_be_registered_is_said_in_one_line():
    source, target, _ = bent_pair()
    three = dict(list(source.landmarks.items())[:3])
    line = {str(k): np.array([15.0 * k - 30.0, 0.0, 40.0]) for k in range(5)}
    twice = source.landmarks | {"again": source.landmarks["0"]}
    broken = source.vertices.copy()
    broken[17, 1] = np.nan
    flat = source.triangles.copy()
    flat[40, 1] = flat[40, 0]
    loose = np.concatenate([source.vertices, [[0.0, 0.0, 90.0]]])
    for one, message in (
        (replace(source, landmarks=three, name="a.obj"), "a.obj and mesh: 3 landmarks of the same name"),
        (replace(source, landmarks=line, name="a.obj"), "a.obj: the 5 shared landmarks lie on a line"),
        (replace(source, landmarks=twice, name="a.obj"), "a.obj: landmarks '0' and 'again' are the same vertex"),
        (replace(source, vertices=broken, name="a.obj"), "a.obj: vertex 17 is not finite"),
        (replace(source, triangles=flat, name="a.obj"), "a.obj: triangle 40 .* has no area"),
        (replace(source, vertices=loose, name="a.obj"), "a.obj: the part with vertex 775 has no landmark"),
        (replace(source, labels=np.array(["skin"]), name="a.obj"), "a.obj: 1 labels for 775 vertices"),
    ):
        other = replace(target, landmarks={**target.landmarks, "again": np.zeros(3), "3": target.vertices[3]})
        with pytest.raises(EvalkitError, match=message) as raised:
            register(one, other)
        assert "\n" not in str(raised.value)


def test_what_cannot_be_transferred_is_said_in_one_line():
    _, triangles = grid(4, 4)
    rest = face_like(grid(4, 4)[0])
    between = same_topology(triangles)
    transfer = DeformationTransfer(rest, triangles, rest, triangles, between)
    bad = np.stack([rest, rest])
    bad[1, 5] = np.inf
    with pytest.raises(EvalkitError, match="source shapes: shape 1: vertex 5 is not finite"):
        transfer.transfer(bad)
    with pytest.raises(EvalkitError, match="source shapes"):
        transfer.transfer(bad[:, :-1])
    with pytest.raises(EvalkitError, match="pinned"):
        DeformationTransfer(rest, triangles, rest, triangles, between, [True])


@lru_cache(maxsize=1)
def both_heads():
    """Artists by name."""
    from evalkit.dense.two_artists import artists

    return artists(ict_path())


def ict_path() -> Path:
    from evalkit.head.makehuman import cached_head

    if not cached_head().is_file():
        pytest.skip(f"no MakeHuman head: {cached_head()} does not exist")
    return real_data("meshes", "ict_facekit_subset.npz")


@lru_cache(maxsize=2)
def two_artists_face(direction):
    from evalkit.dense.two_artists import two_artists

    return two_artists(direction, ict_path())


NEAR_MISSES = 0.2


@pytest.mark.parametrize("direction", ["ict to makehuman", "makehuman to ict"])
def test_shapes_of_one_name_agree_and_shuffled_ones_do_not(direction):
    face = two_artists_face(direction)
    assert len(face.names) == 51
    rough, fine = face.rough - face.rest, face.fine - face.rest
    length = np.sqrt((rough**2).sum(axis=(1, 2))[:, None] * (fine**2).sum(axis=(1, 2)))
    correlation = np.einsum("avi,bvi->ab", rough, fine) / length
    own = np.diag(correlation)
    random = generator("pairings", direction)
    shuffled = [np.median(correlation[np.arange(51), random.permutation(51)]) for _ in range(20)]
    # Two artists differ most in mouthRollLower and mouthPress (0.26 and 0.35); a wrong pairing is about zero.
    assert own.min() > NEAR_MISSES
    assert np.median(own) > 0.6
    assert max(shuffled) < 0.2


WAYS = ("jawLeft", "jawRight", "mouthLeft", "mouthRight")
"""Not sides of the face but ways to go."""


def test_left_is_left_on_both_heads():
    for artist in both_heads().values():
        for name, moves in artist.shapes.items():
            if name.endswith(("Left", "Right")):
                size = np.linalg.norm(moves[artist.soft], axis=1) ** 2
                rest = artist.surface.vertices[:, 0]
                sign = 1.0 if name.endswith("Left") else -1.0
                across = (moves[artist.soft][:, 0] * size).sum() if name in WAYS else (rest * size).sum()
                assert sign * across > 0.0, (artist.surface.name, name)


@pytest.mark.parametrize("direction", ["ict to makehuman", "makehuman to ict"])
def test_the_transferred_jaw_opens_the_lips_and_the_blink_closes_the_lids(direction):
    face, (source, target) = two_artists_face(direction), (both_heads()[name] for name in direction.split(" to "))
    from evalkit.dense.anatomy import front_of

    front = front_of(target.head)
    number = np.searchsorted(front.kept, target.soft)

    def gap(shapes, kind, artist, numbers):
        """Between the middles of the margins, mm."""
        ends = [artist.curves[f"{half} {kind} left"] for half in ("upper", "lower")]
        # The lips' curves begin at the middle of the face; the lids' middle is half along.
        at = [curve[0] if "lip" in kind else curve[len(curve) // 2] for curve in ends]
        places = [shapes[numbers[k]] for k in at]
        return places[0][1] - places[1][1]

    rows = {name: face.names.index(name) for name in ("jawOpen", "eyeBlinkLeft")}
    lips, lids = "lip inner", "lid"
    everything = np.arange(len(source.soft))
    given = {name: source.surface.vertices + source.shapes[name][source.soft] for name in rows}
    opening = gap(given["jawOpen"], lips, source, everything)
    assert gap(face.rough[rows["jawOpen"]], lips, target, number) > 0.7 * opening > 15.0
    at_rest = gap(face.rest, lids, target, number)
    left = gap(face.rough[rows["eyeBlinkLeft"]], lids, target, number)
    print(direction, "lips", opening, gap(face.rough[rows["jawOpen"]], lips, target, number), "lids", at_rest, left)
    assert abs(left) < 0.35 * at_rest
