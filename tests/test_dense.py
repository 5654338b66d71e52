"""Dense performances: what is true of them by construction, and that no deformation map could have made them."""

from __future__ import annotations

import numpy as np
import pytest
from realdata import real_data
from scipy.spatial import cKDTree

from evalkit import metrics
from evalkit.deform import deformation_map
from evalkit.dense import Turn, lip_contact, muscle_face, perform, skin_of_ict, unit_face
from evalkit.dense.face import about_x
from evalkit.dense.face_units import hinge
from evalkit.errors import EvalkitError
from evalkit.geometry import undo_motion
from evalkit.head import load_head
from evalkit.synthetic.expression import JAW_DEG, JAW_GLIDE

ROUNDING = 1e-9

# The skin is mirrored to rounding, but the lining of the mouth is cut along other diagonals on its two sides, and paths
# along its edges differ by that: 0.0005 mm of motion. A tenth of the gap between the lips at rest is room enough.
MIRRORED_MM = 0.01

# Half the smallest step that a renderer at 0.1 mm per pixel would show; the lips are 0.1 mm apart at rest.
LIPS_MM = 0.05

FULL = np.array([1.0])


@pytest.fixture(scope="module")
def face():
    return muscle_face(load_head("template", vertices=2000))


@pytest.fixture(scope="module")
def performance(face):
    return perform(face, frames=240, seed=3)


def both(face, unit, strength=FULL):
    return {name: strength for name in face.units if name in (unit, f"{unit} left", f"{unit} right")}


UNITS = ("jaw", "smile", "pucker", "lip_stretch", "upper_lip_up", "lower_lip_down", "brow_up", "brow_down", "lid_down")


@pytest.mark.parametrize("unit", UNITS)
def test_units_of_both_sides_are_symmetric_and_of_one_side_are_not(face, unit):
    vertices = face.head.vertices
    # The right half is the mirror image of the left, vertex by vertex.
    gap, other = cKDTree(vertices).query(vertices * [-1.0, 1.0, 1.0])
    assert gap.max() < ROUNDING
    moved = face.positions(both(face, unit))[0]
    assert np.abs(moved - vertices).max() > 2.0
    np.testing.assert_allclose(moved[other] * [-1.0, 1.0, 1.0], moved, atol=MIRRORED_MM)
    if f"{unit} left" in face.units:
        one = face.positions({f"{unit} left": FULL})[0]
        assert np.abs(one[other] * [-1.0, 1.0, 1.0] - one).max() > 1.0


def test_the_jaw_turns_about_its_axis(face):
    jaw, turn = face.head.jaw, face.turns["jaw"]
    follows = np.flatnonzero(jaw.weights == 1.0)
    assert len(follows) > 20
    steps = np.linspace(0.0, 1.0, 7)
    # Without the glide of the condyles every vertex stays on its circle and turns by its share of the angle.
    still = Turn(turn.which, turn.centre, turn.angle, np.zeros_like(turn.shift))
    moved = np.repeat(face.head.vertices[None], len(steps), axis=0)
    still.apply(moved, steps)
    arm = moved[:, turn.which] - jaw.axis
    radius = np.hypot(arm[..., 1], arm[..., 2])
    np.testing.assert_allclose(radius, np.broadcast_to(radius[0], radius.shape), atol=ROUNDING)
    np.testing.assert_array_equal(arm[..., 0], np.broadcast_to(arm[0, :, 0], arm[..., 0].shape))
    before, after = moved[0, follows] - jaw.axis, moved[-1, follows] - jaw.axis
    cosine = (before[:, 1:] * after[:, 1:]).sum(axis=1) / (radius[0] ** 2)[np.isin(turn.which, follows)]
    np.testing.assert_allclose(np.degrees(np.arccos(cosine)), JAW_DEG, atol=1e-6)
    # With it, what follows the jaw altogether moves as one rigid body, about a point that has glided.
    opened = face.positions({"jaw": FULL})[0, follows]
    expected = jaw.axis + JAW_GLIDE + about_x(face.head.vertices[follows] - jaw.axis, np.deg2rad(JAW_DEG))
    np.testing.assert_allclose(opened, expected, atol=ROUNDING)
    # Control: a straight line to the same place, as a linear unit has it, is no rotation.
    half = 0.5 * (face.head.vertices[follows] + opened)
    assert np.abs(half - face.positions({"jaw": FULL / 2})[0, follows]).max() > 0.5


def test_lids_close_as_those_of_the_head_do(face):
    closed = face.head.posed(lids_closed=0.7)
    np.testing.assert_allclose(face.positions({"lid_down": 0.7 * FULL})[0], closed, atol=ROUNDING)


def test_a_turn_through_a_goal_reaches_it_and_keeps_to_the_arc():
    rest = np.array([[0.0, -60.0, 100.0], [10.0, -30.0, 90.0], [0.0, 20.0, 30.0], [5.0, 5.0, 5.0]])
    axis = np.array([0.0, 18.0, 25.0])
    goal = (
        axis
        + about_x(rest - axis, np.deg2rad([15.0, 7.0, 0.0, 0.0]))
        + [[0.0] * 3, [1.0, 0, 0], [0, 2.0, 0], [0.0] * 3]
    )
    turn = Turn.through(rest, goal, axis)
    assert turn.which.tolist() == [0, 1, 2]
    moved = np.stack([rest, rest])
    turn.apply(moved, np.array([1.0, 0.5]))
    np.testing.assert_allclose(moved[0], goal, atol=ROUNDING)
    np.testing.assert_allclose(moved[1, 0], axis + about_x(rest[0] - axis, np.deg2rad(7.5)), atol=ROUNDING)
    # Too near to the axis for an angle: straight.
    np.testing.assert_allclose(moved[1, 2], rest[2] + [0.0, 1.0, 0.0], atol=ROUNDING)


def test_lips_never_cross_and_no_skin_is_turned_over(face, performance):
    head, contact = face.head, lip_contact(face.head)
    assert len(contact.lower) > 10
    triangles = head.part_triangles("skin")

    def deepest(vertices):
        return metrics.lip_penetration_mm(vertices, head.vertices, contact.lower, contact.upper, contact.share).max()

    for part, vertices in performance.batches():
        assert deepest(vertices) < LIPS_MM
        assert metrics.inverted_triangles(vertices[::8], head.vertices, triangles).max() == 0, part
    for unit in UNITS:
        assert deepest(face.positions(both(face, unit))) < LIPS_MM, unit
    # Control: the lower lip alone lifted by a millimetre is seen, by the gap less than that.
    lifted = head.vertices.copy()
    lifted[head.regions["lower lip"], 1] += 1.0
    assert 0.8 < deepest(lifted[None]) <= 1.0


def test_a_muscle_of_one_lip_leaves_the_other(face):
    head, contact = face.head, lip_contact(face.head)
    moved = np.linalg.norm(face.positions(both(face, "lower_lip_down"))[0] - head.vertices, axis=1)
    middle = np.abs(head.vertices[contact.lower, 0]) < 8.0
    # Some 0.1 mm apart, but a mouth's width over the skin.
    assert moved[contact.lower[middle]].min() > 0.5
    assert moved[contact.upper[middle]].max() < 0.01


def test_no_deformation_map_could_have_made_it(face, performance):
    """However the markers moved: the best fit of the truth by the columns of a map leaves a good part of it."""
    head = face.head
    soft = head.soft_vertices
    moved = (performance.vertices(slice(None, None, 6)) - head.vertices)[:, soft]
    data = moved.transpose(1, 0, 2).reshape(len(soft), -1)
    for kernel in ("exponential", "biharmonic", "bilaplacian"):
        for regions in (True, False):
            weights = deformation_map(head, list(head.marker_sites), kernel, regions)[soft]
            left = data - weights @ np.linalg.lstsq(weights, data, rcond=None)[0]
            # A quarter to two fifths of the motion on the template and ICT-FaceKit; rounding would be 1e-12.
            assert np.linalg.norm(left) > 0.1 * np.linalg.norm(data), (kernel, regions)
            # Control: what a map has made, from noisy markers even, is found out.
            made = weights @ np.random.default_rng(0).normal(size=(weights.shape[1], 20))
            left = made - weights @ np.linalg.lstsq(weights, made, rcond=None)[0]
            assert np.linalg.norm(left) < 1e-6 * np.linalg.norm(made)


def test_vertices_are_no_linear_function_of_what_is_done(face):
    strengths = {"jaw": FULL, "pucker": FULL, "smile left": FULL}
    together = face.positions(strengths)[0] - face.head.vertices
    apart = sum(face.positions({unit: FULL})[0] - face.head.vertices for unit in strengths)
    assert np.abs(together - apart).max() > 1.0
    performed = perform(face, frames=200, seed=1)
    alone = perform(face, frames=200, seed=1, actions=("pucker", "speech"))
    # A smile holds a pucker back.
    assert (performed.strengths["pucker"] <= alone.strengths["pucker"] + ROUNDING).all()
    assert (performed.strengths["pucker"] < alone.strengths["pucker"] - 0.05).any()
    assert all(curve.min() >= 0.0 and curve.max() <= 1.0 for curve in performed.strengths.values())


def test_same_seed_same_performance_and_batches_are_the_whole(face, performance):
    again, other = perform(face, frames=240, seed=3), perform(face, frames=240, seed=4)
    assert performance.strengths.keys() == again.strengths.keys()
    for unit, curve in performance.strengths.items():
        np.testing.assert_array_equal(curve, again.strengths[unit])
    assert any(np.abs(curve - other.strengths[unit]).max() > 0.1 for unit, curve in performance.strengths.items())
    whole = performance.vertices()
    for part, vertices in performance.batches():
        # A product of another number of rows may sum in another order.
        np.testing.assert_allclose(vertices, whole[part], atol=ROUNDING)
    which = np.array([10, 500, 1200])
    np.testing.assert_allclose(performance.markers(which), whole[:, which], atol=ROUNDING)


def test_markers_carry_noise_and_head_motion_that_can_be_undone(face, performance):
    sites = face.head.nearest_vertices(face.head.marker_sites)
    true = performance.markers(np.array(list(sites.values())))
    take, rotations, translations = performance.capture(sites, motion_deg=12.0, seed=2)
    assert list(take.labels) == list(sites)
    assert np.abs(take.points - true).max() > 10.0
    np.testing.assert_allclose(undo_motion(rotations, translations, take.points), true, atol=1e-8)
    noisy = performance.capture(sites, noise_mm=0.5, seed=2)[0].points - true
    # 16,560 draws know their spread to 0.6 %.
    assert noisy.std() == pytest.approx(0.5, rel=0.03)


def test_mistakes_get_one_line(face, performance, tmp_path):
    with pytest.raises(EvalkitError, match="no unit 'smirk'"):
        face.positions({"smirk": FULL})
    with pytest.raises(EvalkitError, match="unknown action 'sneeze'"):
        perform(face, actions=("sneeze",))
    with pytest.raises(EvalkitError, match="marker Chin: vertex 99999999"):
        performance.capture({"Chin": 99999999})
    with pytest.raises(EvalkitError, match="no shape"):
        unit_face(face.head)
    broken = tmp_path / "broken.npz"
    broken.write_bytes(b"PK not a zip")
    for path in (broken, tmp_path / "nothing.npz"):
        with pytest.raises(EvalkitError, match=path.name):
            skin_of_ict(path)


def test_ict_acts_by_its_own_shapes():
    head = skin_of_ict(real_data("meshes", "ict_facekit_subset.npz"))
    acting = unit_face(head)
    count = sum(len(which) for which in head.regions.values())
    assert count == len(np.unique(np.concatenate(list(head.regions.values())))) == len(head.vertices)
    opened = acting.positions({"jaw": FULL})[0]
    which, moves = head.blendshapes["jawOpen"]
    np.testing.assert_allclose(opened[which], head.vertices[which] + moves, atol=ROUNDING)
    # Half open, the chin is on its arc: in front of the middle of the chord.
    chin = int(np.argmax(np.linalg.norm(opened - head.vertices, axis=1)))
    half = acting.positions({"jaw": FULL / 2})[0, chin]
    assert half[2] - 0.5 * (opened[chin] + head.vertices[chin])[2] > 0.3
    weights = deformation_map(head, list(head.marker_sites))
    moved = perform(acting, frames=60, seed=0).vertices(slice(None, None, 6)) - head.vertices
    data = moved.transpose(1, 0, 2).reshape(len(head.vertices), -1)
    left = data - weights @ np.linalg.lstsq(weights, data, rcond=None)[0]
    assert np.linalg.norm(left) > 0.1 * np.linalg.norm(data)


def test_the_hinge_of_a_jaw_is_found_from_its_shape():
    """A chin turned about a known axis, the skin above it following less: exact where the chin is stiff."""
    random = np.random.default_rng(2)
    closed = random.uniform((-40.0, -80.0, 40.0), (40.0, 20.0, 110.0), (400, 3))
    axis, angle = np.array([0.0, 18.0, 25.0]), np.radians(14.0)
    share = np.where(closed[:, 1] < -30.0, 1.0, 0.3)
    turn = angle * share
    arm = closed[:, 1:] - axis[1:]
    opened = closed.copy()
    opened[:, 1] = axis[1] + np.cos(turn) * arm[:, 0] - np.sin(turn) * arm[:, 1]
    opened[:, 2] = axis[2] + np.sin(turn) * arm[:, 0] + np.cos(turn) * arm[:, 1]
    np.testing.assert_allclose(hinge(closed, opened), axis, atol=1e-9)
    # Control: the middle of the face is not it.
    assert np.linalg.norm(closed.mean(axis=0) - axis) > 20.0
