"""Characters with truth: what a sculptor makes of rough shapes, and that it is neither linear nor torn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from realdata import real_data
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from evalkit.deform.surface import edge_graph, edges
from evalkit.dense import animation, character, muzzle_character, shared_names
from evalkit.dense.actors import ICT_FILE, Actor, ict_actor, makehuman_actor, modes_of, muscle_actor, targets_of
from evalkit.dense.anatomy import front_of
from evalkit.dense.sculptor import HUMAN, closure, drawn_manner, jaw_angle, parted, sculpt
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import load_head
from evalkit.metrics import inverted_triangles, rms

# The lining of the mouth is cut along other diagonals on its two sides (see test_dense.py), and the paths along its
# edges by which muscles fade differ by that: 0.0005 mm of motion, some of which the rules enlarge.
MIRRORED_MM = 0.01

# Lips that touch may slide over one another; half of what a renderer shows at 0.5 mm per pixel.
TOUCH_MM = 0.25

# A triangle whose edge is half or twice as long as in the rough shape is a fold or a bulge of skin; a tear would be
# many times as long. The muzzle's jaw and lips do more than a human's.
STRETCH = {"template": (0.4, 2.0), "muzzle": (0.3, 2.5)}

ROUNDING = 1e-9


@pytest.fixture(scope="module")
def actor() -> Actor:
    return muscle_actor()


@pytest.fixture(scope="module")
def human():
    return character("template")


def makehuman() -> Actor:
    try:
        return makehuman_actor()
    except EvalkitError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("name", ["template", "muzzle", "linear"])
def test_a_character_is_one_piece_of_skin_in_named_regions(name):
    one = character(name)
    count = len(one.rest)
    assert 4000 < count < 6000
    assert one.rough.shape == one.fine.shape == (len(one.names), count, 3)
    assert len(set(one.names)) == len(one.names) >= 20
    assert np.isfinite(one.fine).all()
    assert connected_components(edge_graph(one.rest, one.triangles))[0] == 1
    np.testing.assert_array_equal(np.unique(one.triangles), np.arange(count))
    # Something must hold a solution in place: the rim stands still in rough and fine shapes alike.
    still = (one.rough == one.rest).all(axis=(0, 2)) & (one.fine == one.rest).all(axis=(0, 2))
    assert still.sum() > 0.05 * count
    np.testing.assert_array_equal(np.sort(np.concatenate(list(one.hand_drawn.values()))), np.arange(count))
    assert 10 <= len(one.hand_drawn) <= 16
    assert min(map(len, one.hand_drawn.values())) > 20
    assert {"lips", "lids", "brows", "cheeks"} < set(one.regions)
    assert min(map(len, one.regions.values())) > 20
    assert len(one.training) == 4
    assert not set(one.training) & set(one.unlike)
    assert set(one.rows(one.training + one.unlike)) <= set(range(len(one.names)))
    assert 20.0 < one.eye_distance_mm < 50.0


def test_strength_of_the_individuality(human):
    np.testing.assert_array_equal(character("template", 0.0).fine, human.rough)
    changes = [rms(character("template", style).fine - human.rough) for style in (0.5, 1.0)]
    assert 0.0 < changes[0] < changes[1]
    # In the paper rough and sculpted shapes are 7 % of the distance between the eyes apart, over the whole vector.
    assert 0.01 < np.sqrt(3.0) * changes[1] / human.eye_distance_mm < 0.1


def bend(actor: Actor, fine: Array, whole: str, half: str) -> float:
    """How much the change at half strength differs from half of the change at full strength, as a share of that."""
    names = list(actor.shapes)
    change = fine - actor.rough
    goal = 0.5 * change[names.index(whole)]
    return float(np.linalg.norm(change[names.index(half)] - goal) / np.linalg.norm(goal))


@pytest.mark.parametrize(("whole", "half"), [("smile", "faint smile"), ("eyes closed", "eyes half closed")])
def test_the_truth_is_not_linear_but_that_of_the_control_is(actor, human, whole, half):
    rough = dict(zip(human.names, human.rough, strict=True))
    # Lids turn about the eyeball in the rough shapes, too; half way on an arc is a little off half of the way.
    np.testing.assert_allclose(rough[half] - human.rest, 0.5 * (rough[whole] - human.rest), atol=1.5)
    assert bend(actor, human.fine, whole, half) > 0.15
    linear = character("linear").fine
    if whole == "smile":  # fields of muscles are linear themselves
        assert bend(actor, linear, whole, half) < ROUNDING
    assert bend(actor, linear, whole, half) < 0.5 * bend(actor, human.fine, whole, half)


def test_what_two_expressions_change_together_is_not_the_sum(actor, human):
    both = human.rough[human.rows(("smile", "jaw open"))]
    rough = np.concatenate([both, human.rest + (both - human.rest).sum(axis=0, keepdims=True)])
    change = sculpt(human.rest, rough, actor.anatomy) - rough
    apart = change[:2].sum(axis=0)
    assert np.linalg.norm(change[2] - apart) > 0.1 * np.linalg.norm(apart)


def turned_over(rough: Array, fine: Array, triangles: Array) -> int:
    """Triangles of all shapes (N, V, 3) that are turned over against the rough shape."""
    a, b, c = triangles.T
    normals = [np.cross(v[:, b] - v[:, a], v[:, c] - v[:, a]) for v in (rough, fine)]
    return int(((normals[0] * normals[1]).sum(axis=2) < 0.0).sum())


def stretch(rough: Array, fine: Array, triangles: Array) -> tuple[float, float]:
    """The smallest and the largest ratio of the lengths of an edge."""
    a, b = edges(triangles).T
    ratio = np.linalg.norm(fine[:, a] - fine[:, b], axis=2) / np.linalg.norm(rough[:, a] - rough[:, b], axis=2)
    return float(ratio.min()), float(ratio.max())


@pytest.mark.parametrize("name", ["template", "muzzle"])
def test_nothing_is_turned_over_or_torn(name):
    one = character(name)
    assert turned_over(one.rough, one.fine, one.triangles) == 0
    least, most = stretch(one.rough, one.fine, one.triangles)
    assert STRETCH[name][0] < least <= most < STRETCH[name][1]


def test_a_sculptor_who_goes_too_far_is_found_out(actor, human):
    wild = sculpt(human.rest, human.rough, actor.anatomy, replace(HUMAN, left=4.0, bulge_mm=60.0, lids_meet_rad=1.5))
    assert turned_over(human.rough, wild, human.triangles) > 0
    least, most = stretch(human.rough, wild, human.triangles)
    assert least < STRETCH["template"][0] or most > STRETCH["template"][1]


def test_closed_lips_and_lids_stay_closed(actor, human):
    lower, upper = actor.anatomy.contact
    rough, fine = (shapes[:, upper, 1] - shapes[:, lower, 1] for shapes in (human.rough, human.fine))
    assert (fine > np.minimum(rough, 0.0) - TOUCH_MM - 0.01).all()
    shut = parted(human.rest, human.rough, actor.anatomy) < 0.01
    assert shut.sum() > 5
    assert parted(human.rest, human.fine, actor.anatomy)[shut].max() < TOUCH_MM
    assert parted(human.rest, human.fine, actor.anatomy)[human.names.index("jaw open")] > 5.0
    row = human.names.index("eyes closed")
    for side in ("left", "right"):
        assert closure(human.rest, human.fine[[row]], actor.anatomy, side)[0] == pytest.approx(1.0, abs=0.05)


def test_rules_are_mirrored_with_the_face(actor, human):
    gap, other = cKDTree(human.rest).query(human.rest * [-1.0, 1.0, 1.0])
    assert gap.max() < ROUNDING
    rows = human.rows(("smile left", "wink left", "brow up left", "jaw open", "grin", "sneer left"))
    flip = human.rough[rows][:, other] * [-1.0, 1.0, 1.0]
    swapped = sculpt(human.rest, flip, actor.anatomy, replace(HUMAN, left=HUMAN.right, right=HUMAN.left))
    np.testing.assert_allclose(swapped[:, other] * [-1.0, 1.0, 1.0], human.fine[rows], atol=MIRRORED_MM)
    # With the same preferred side it must not be mirrored: this smile is meant to be crooked.
    crooked = sculpt(human.rest, flip, actor.anatomy)
    assert np.abs(crooked[:, other] * [-1.0, 1.0, 1.0] - human.fine[rows]).max() > 0.5


def test_rules_keep_to_their_place(human):
    change = np.linalg.norm(human.fine - human.rough, axis=2)
    right = human.rest[:, 0] < -20.0
    assert change[human.names.index("wink left"), right].max() < 0.1
    assert change[human.names.index("wink left")].max() > 1.0
    high = human.rest[:, 1] > 70.0
    assert change[human.names.index("jaw open"), high].max() < 0.1
    assert change[human.names.index("brows up"), high].max() > 0.5


def test_the_same_character_every_time(human):
    character.cache_clear()
    np.testing.assert_array_equal(character("template").fine, human.fine)
    assert drawn_manner("somebody") == drawn_manner("somebody") != drawn_manner("somebody else")
    assert drawn_manner("somebody") != HUMAN


def test_the_muzzle_has_other_proportions_and_a_truth_that_no_transfer_has_made(actor, human):
    one = character("muzzle")
    corners = [actor.anatomy.places[f"corner {side}"] for side in ("left", "right")]
    width, before = (abs(np.subtract(*mesh[corners, 0])) / d for mesh, d in
                     ((one.rest, one.eye_distance_mm), (human.rest, human.eye_distance_mm)))  # fmt: skip
    assert width > 1.5 * before
    assert one.rest[:, 2].max() > human.rest[:, 2].max() + 20.0
    assert inverted_triangles(one.rest[None], human.rest, one.triangles)[0] == 0
    # The jaw turns by the same angle; what else moves there, stretched with the skin, changes the fit by a hundredth.
    row = [one.names.index("jaw open")]
    angles = [jaw_angle(c.rest, c.rough[row], actor.anatomy)[0] for c in (one, human)]
    assert angles[0] == pytest.approx(angles[1], rel=0.02)

    def lazy(rest, triangles, shapes, goal):
        return goal + (shapes - rest)

    other = muzzle_character(transfer=lazy)
    np.testing.assert_array_equal(other.fine, one.fine)
    np.testing.assert_allclose(other.rough - one.rest, human.rough - human.rest, atol=ROUNDING)
    assert rms(other.fine - other.rough) > rms(one.fine - one.rough)


def test_animation_is_smooth_and_of_its_seed(human):
    movement = animation(human)
    assert movement.weights.shape == (270, 14)
    assert len(set(movement.names)) == 14
    assert set(movement.names) <= set(human.names)
    assert movement.weights.min() >= 0.0
    assert 0.8 < movement.weights.max() <= 1.0
    # The steepest: cos² to the top in 0.6 of 27 frames goes by at most pi / 2 / 16 a frame.
    assert np.abs(np.diff(movement.weights, axis=0)).max() < 0.1
    assert (movement.weights.max(axis=0) > 0.2).all()
    assert 1.0 < (movement.weights > 0.1).sum(axis=1).mean() < 7.0
    np.testing.assert_array_equal(animation(human).weights, movement.weights)
    assert (animation(human, seed=1).weights != movement.weights).any()
    with pytest.raises(EvalkitError, match="31 expressions asked for, it has 30"):
        animation(human, shapes=31)


def test_errors_are_one_clear_line(human, monkeypatch):
    for name in ("nobody", "ict identity", "makehuman identity x", "template 3", ""):
        with pytest.raises(EvalkitError, match=f"no character '{name}'; there are template"):
            character(name)
    with pytest.raises(EvalkitError, match="no expression 'jump'"):
        human.rows(("jump",))
    monkeypatch.delenv("EVALKIT_REAL_DATA", raising=False)
    with pytest.raises(EvalkitError, match="set EVALKIT_REAL_DATA to the folder that holds meshes/ict"):
        character("ict")
    head = load_head("template", vertices=1000)
    with pytest.raises(EvalkitError, match="no region 'face'"):
        front_of(replace(head, regions={}))


def test_makehuman_and_its_people():
    makehuman()
    one, person, other = (character(name) for name in ("makehuman", "makehuman identity 1", "makehuman identity 2"))
    assert len(one.names) == 64
    assert "tongueOut" not in one.names
    assert set(one.training + one.unlike) <= set(one.names)
    # At most one triangle in a thousand, deep in a fold that the rough shape has already.
    for c in (one, person):
        assert turned_over(c.rough, c.fine, c.triangles) < 1e-3 * len(c.names) * len(c.triangles)
    assert 0.5 < rms(person.rest - one.rest) < 10.0
    assert rms(other.rest - person.rest) > 0.5
    # The rough shapes are the same ways on another face; the sculptor is another one.
    np.testing.assert_allclose(person.rough - person.rest, one.rough - one.rest, atol=ROUNDING)
    assert rms((person.fine - person.rough) - (one.fine - one.rough)) > 0.05
    sides = {name: amount for name, amount in targets_of(1).items() if "/l-" in name}
    assert all(targets_of(1)[name.replace("/l-", "/r-")] == amount for name, amount in sides.items())


def test_ict_and_what_it_shares_with_makehuman(monkeypatch):
    path = real_data(*ICT_FILE)
    monkeypatch.setenv("EVALKIT_REAL_DATA", str(path.parents[1]))
    pairs = shared_names(ict_actor().head, makehuman().head)
    assert len(pairs) == 51
    assert pairs["mouthSmileLeft"] == ("mouthSmile_L",)
    assert pairs["mouthLeft"] == ("mouthLeft",)
    assert pairs["browInnerUp"] == ("browInnerUp_L", "browInnerUp_R")
    assert "tongueOut" not in pairs
    one, person = character("ict"), character("ict identity 0", 0.0)
    assert set(one.training + one.unlike) <= set(one.names)
    assert rms(person.rest - one.rest) > 0.5
    assert len(modes_of(0)) == 8
    assert turned_over(one.rough, one.fine, one.triangles) < 1e-3 * len(one.names) * len(one.triangles)
