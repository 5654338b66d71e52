"""Character Transfer step by step and as a whole: against slow versions of it, and what it promises."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest
from contracts.sculpts import patch, push, roll, sculpts, uneven_face
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from oracles import transfer_oracles as slow
from scipy.spatial.transform import Rotation

from evalkit import EvalkitError
from evalkit.transfer import solver as solver_module
from evalkit.transfer.blending import LEAST_STRETCH, Linear, RotationStretch, blends
from evalkit.transfer.character import STILL, CharacterTransfer, transfer_character
from evalkit.transfer.coefficients import QUIET, RIDGE, kinds, region_coefficients
from evalkit.transfer.gradients import checked_mesh, checked_shapes, deformation_gradients, flipped
from evalkit.transfer.rigging import _mixtures_step, _shapes_step, example_based_rig
from evalkit.transfer.segmentation import LEAST_VERTICES, segment, two_means, vertex_regions
from evalkit.transfer.solver import MeshSolver

quick = settings(derandomize=True, deadline=None, max_examples=40, database=None)
close = functools.partial(np.testing.assert_allclose, rtol=0.0)

EXACT = 1e-9
"""Of the mesh's size, as the project promises: sixteen digits, less four for the condition number of a Laplacian of a
few hundred vertices, less three to spare."""

PATCH, FACE = sculpts(patch()), sculpts()
TURN = Rotation.from_euler("xyz", [20, -35, 50], degrees=True).as_matrix()


def stacked(gradients):
    """(3, 3, T) to (T, 3, 3)."""
    return np.moveaxis(gradients, (0, 1), (-2, -1))


def one_hot(transfer):
    """Coefficients (M, R, M) of the examples themselves."""
    count, regions = len(transfer.rough), int(transfer.regions.max()) + 1
    return np.repeat(np.eye(count)[:, None], regions, axis=1)


# --- deformation gradients ----------------------------------------------------------------------------------


def test_gradients_are_those_of_one_triangle_after_the_other():
    found = deformation_gradients(FACE.rest, FACE.fine, FACE.triangles)
    for k, shape in enumerate(FACE.fine):
        expected = slow.gradients(FACE.rest, shape, FACE.triangles)
        # Condition numbers of the frames of these triangles stay below a hundred.
        close(stacked(found[:, :, k]), expected, atol=1e-12)


def test_the_gradient_of_a_scaled_mesh_is_its_scale_in_every_direction():
    for scale in (0.01, 2.0, 30.0):
        found = deformation_gradients(PATCH.rest, scale * PATCH.rest, PATCH.triangles)
        close(stacked(found), np.broadcast_to(scale * np.eye(3), (len(PATCH.triangles), 3, 3)), atol=1e-12 * scale)
        # Controls: the fourth vertices of public ports, a unit normal or the cross product as it is.
        for kind, across in (("unit", 1.0), ("raw", scale**2)):
            wrong = slow.gradients(PATCH.rest, scale * PATCH.rest, PATCH.triangles, kind)
            assert np.abs(wrong - scale * np.eye(3)).max() > 0.1 * abs(across - scale)
            values = np.sort(np.linalg.eigvals(wrong[0]).real)
            close(values, np.sort([scale, scale, across]), atol=1e-9 * max(scale, across))


def test_the_gradient_of_a_turned_mesh_is_the_rotation():
    found = deformation_gradients(PATCH.rest, PATCH.rest @ TURN.T + [5.0, 0.0, 900.0], PATCH.triangles)
    # Positions of 900 mm leave thirteen digits to edges of 10 mm.
    close(stacked(found), np.broadcast_to(TURN, (len(PATCH.triangles), 3, 3)), atol=1e-11)


def test_a_triangle_that_a_shape_collapses_has_a_flat_gradient_and_no_warning():
    shape = PATCH.rest.copy()
    a, b, c = PATCH.triangles[20]
    shape[c] = 0.5 * (shape[a] + shape[b])
    found = stacked(deformation_gradients(PATCH.rest, shape, PATCH.triangles))
    assert np.isfinite(found).all() and abs(np.linalg.det(found[20])) < 1e-9


def test_flipped_counts_the_triangle_that_turned_over():
    rest, triangles = patch()
    assert not flipped(rest, rest[None], triangles).any()
    shape = rest.copy()
    inner = next(t for t in triangles if 20 in t)
    a, b = (v for v in inner if v != 20)
    # Across the opposite edge: this triangle turns over.
    edge = rest[b] - rest[a]
    foot = rest[a] + edge * ((rest[20] - rest[a]) @ edge) / (edge @ edge)
    shape[20] += 2.0 * (foot - rest[20])
    found = flipped(rest, np.array([rest, shape]), triangles)
    assert not found[0].any() and 1 <= found[1].sum() <= 3
    # Control: a mesh turned as a whole has none, though every normal has turned.
    assert not flipped(rest, (rest @ TURN.T)[None], triangles).any()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda v, t: (v[:, :2], t), ["vertices have shape (72, 2)", "(V, 3)"]),
        (lambda v, t: (v[:0], t), ["vertices have shape (0, 3)"]),
        (lambda v, t: (v, t[:, :2]), ["triangles have shape (112, 2)"]),
        (lambda v, t: (v, t[:0]), ["triangles have shape (0, 3)"]),
        (lambda v, t: (v, t.astype(float)), ["float64", "integers"]),
        (lambda v, t: (np.where(np.arange(72)[:, None] == 7, np.nan, v), t), ["vertex 7 is not finite"]),
        (lambda v, t: (v, np.where(t == 20, 99, t)), ["triangle", "99", "of 72"]),
        (lambda v, t: (v, np.where(t == 20, -1, t)), ["triangle", "-1", "of 72"]),
        (lambda v, t: (v, np.vstack([t, [[3, 4, 4]]])), ["triangle 112 (3, 4, 4) has no area", "remove it"]),
        (lambda v, t: (np.where(np.arange(72)[:, None] == 1, v[0], v), t), ["has no area", "such"]),
        (lambda v, t: ("head", t), ["arrays of numbers"]),
        (lambda v, t: ([[1, 2, 3], [4]], t), ["arrays of numbers"]),
    ],
)
def test_a_mesh_that_cannot_be_used_is_one_line(change, words):
    with pytest.raises(EvalkitError) as caught:
        checked_mesh(*change(*patch()), "neutral.obj")
    line = str(caught.value)
    assert line.startswith("neutral.obj: ") and "\n" not in line
    assert [word for word in words if word not in line] == []


def test_shapes_that_do_not_fit_are_one_line():
    for shapes, words in (
        (PATCH.rough[:, :-1], "(3, 71, 3); expected (shapes, 72, 3)"),
        (PATCH.rough[0], "(72, 3)"),
        ([PATCH.rough[0], PATCH.rough[0][:5]], "differ in their number of vertices"),
        (np.where(np.arange(72)[:, None] == 5, np.inf, PATCH.rough), "shape 0: vertex 5 is not finite (3 such)"),
    ):
        with pytest.raises(EvalkitError) as caught:
            checked_shapes(shapes, 72, "rough")
        assert words in str(caught.value) and "\n" not in str(caught.value)


# --- solve --------------------------------------------------------------------------------------------------


def two_parts():
    """The patch twice, apart, and two vertices without a triangle."""
    rest, triangles = patch()
    both = np.concatenate([rest, rest * [1.1, 0.9, 1.0] + [200.0, 0.0, 30.0], [[0.0, 0.0, 90.0], [1.0, 80.0, 0.0]]])
    return both, np.concatenate([triangles, triangles + len(rest)])


def wanted_gradients(count, triangles, seed=5):
    """Near the identity and of no mesh: (3, 3, count, T)."""
    rng = np.random.default_rng(seed)
    return np.eye(3)[:, :, None, None] + 0.2 * rng.normal(size=(3, 3, count, len(triangles)))


@pytest.mark.parametrize("case", ["pins", "no pins", "one pin", "two parts", "two parts, one without a pin"])
def test_the_solve_is_the_full_system_with_its_fourth_vertices(case):
    rest, triangles = two_parts() if "two" in case else patch()
    pinned = np.zeros(len(rest), dtype=bool)
    pinned[{"pins": [0, 1, 2, 9, 40], "one pin": [30], "two parts": [3, 4, 100],
            "two parts, one without a pin": [3, 4]}.get(case, [])] = True  # fmt: skip
    wanted = wanted_gradients(2, triangles)
    guess = rest + np.random.default_rng(6).normal(size=(2, *rest.shape))
    found = MeshSolver(rest, triangles, pinned).solve(wanted, guess)
    size = np.linalg.norm(np.ptp(rest, axis=0))
    for k in range(2):
        expected = slow.solve(rest, triangles, stacked(wanted[:, :, k]), pinned, guess[k])
        close(found[k], expected, atol=EXACT * size)
    np.testing.assert_array_equal(found[:, pinned], guess[:, pinned])
    # Control: who forgets the fourth vertices' share of the gradient has another minimum only across the plane, so it
    # is the pins that must matter here.
    if pinned.any():
        other = slow.solve(rest, triangles, stacked(wanted[:, :, 0]), np.zeros_like(pinned), guess[0])
        assert np.abs(found[0] - other).max() > 1e-3 * size


def test_gradients_of_a_shape_give_the_shape():
    pinned = np.zeros(len(FACE.rest), dtype=bool)
    pinned[:5] = True
    solver = MeshSolver(FACE.rest, FACE.triangles, pinned)
    gradients = deformation_gradients(FACE.rest, FACE.fine, FACE.triangles)
    guess = np.where(pinned[:, None], FACE.fine, FACE.rest)
    close(solver.solve(gradients, guess), FACE.fine, atol=EXACT * FACE.size)


def test_everything_pinned_and_no_shapes():
    solver = MeshSolver(PATCH.rest, PATCH.triangles, np.ones(len(PATCH.rest), dtype=bool))
    np.testing.assert_array_equal(solver.solve(wanted_gradients(3, PATCH.triangles), PATCH.fine), PATCH.fine)
    free = MeshSolver(PATCH.rest, PATCH.triangles, np.zeros(len(PATCH.rest), dtype=bool))
    assert free.solve(np.empty((3, 3, 0, len(PATCH.triangles))), np.empty((0, 72, 3))).shape == (0, 72, 3)


# --- regions ------------------------------------------------------------------------------------------------


def as_sets(labels):
    return {frozenset(np.flatnonzero(labels == k).tolist()) for k in range(labels.max() + 1)}


def test_regions_are_those_of_plain_lloyd_loops():
    levels = segment(FACE.rest, FACE.triangles, FACE.fine)
    expected = slow.segment(FACE.rest, FACE.triangles, FACE.fine, 4, LEAST_VERTICES)
    for labels, parts in zip(levels, expected, strict=True):
        assert as_sets(labels) == {frozenset(part) for part in parts}
        assert np.array_equal(np.unique(labels), np.arange(labels.max() + 1))
    # Every level splits regions of the one before it; only small ones stay.
    for before, after in itertools.pairwise(levels):
        for part in as_sets(after):
            (home,) = np.unique(before[list(part)])
            if len(np.unique(FACE.triangles[before == home])) < LEAST_VERTICES:
                assert part == frozenset(np.flatnonzero(before == home).tolist())
    assert levels[-1].max() + 1 > 4
    # Control: motion counts, so other examples have other regions.
    assert as_sets(segment(FACE.rest, FACE.triangles, FACE.fine[:1])[-1]) != as_sets(levels[-1])


def test_regions_know_neither_the_unit_nor_the_axes_nor_the_order_of_vertices():
    expected = as_sets(segment(FACE.rest, FACE.triangles, FACE.fine)[-1])
    turned = FACE.mapped(lambda v: 0.001 * v @ TURN.T + [1.0, 2.0, 3.0])
    assert as_sets(segment(turned.rest, turned.triangles, turned.fine)[-1]) == expected
    order = np.random.default_rng(7).permutation(len(FACE.rest))
    again = segment(FACE.rest[order], np.argsort(order)[FACE.triangles], FACE.fine[:, order])[-1]
    assert as_sets(again) == expected


def test_two_means_of_points_that_cannot_be_split():
    assert not two_means(np.ones((5, 3))).any()
    assert two_means(np.array([[5.0], [0.1], [0.0]])).tolist() == [1, 0, 0]
    assert two_means(np.array([[5.0], [0.1]])).tolist() == two_means(np.array([[0.1], [5.0]])).tolist() == [0, 1]


def test_the_region_of_a_vertex_is_that_of_most_of_its_triangles():
    labels = segment(FACE.rest, FACE.triangles, FACE.fine)[-1]
    found = vertex_regions(FACE.triangles, labels, len(FACE.rest) + 1)
    for vertex in range(0, len(FACE.rest), 7):
        around = [labels[t] for t in range(len(labels)) if vertex in FACE.triangles[t]]
        most = max(around.count(k) for k in around)
        assert found[vertex] == min(k for k in around if around.count(k) == most)
    assert found[-1] == 0


# --- coefficients -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", kinds)
def test_coefficients_are_those_of_the_stacked_least_squares(kind):
    rng = np.random.default_rng(8)
    regions = rng.integers(0, 3, 40)
    examples = rng.normal(size=(4, 40, 3))
    examples[1] = examples[0] + 0.2 * rng.normal(size=(40, 3))
    new = np.einsum("nm,mvi->nvi", rng.normal(0.2, 0.8, (25, 4)), examples) + 0.3 * rng.normal(size=(25, 40, 3))
    found = region_coefficients(examples, new, regions, kind)
    for region in range(3):
        system = examples[:, regions == region].reshape(4, -1).T
        weight = RIDGE * (system**2).sum(axis=0).mean()
        for k in range(25):
            expected = slow.coefficients(system, new[k, regions == region].ravel(), weight, kind)
            # The normal equations square a condition number of about 1e2.
            close(found[k, region], expected, atol=1e-11)
    bounded = {"non-negative": found >= 0.0, "sum-to-one": np.isclose(found.sum(axis=2), 1.0, rtol=0.0, atol=1e-12),
               "convex": (found >= 0.0).all(axis=2) & (found.sum(axis=2) <= 1.0 + 1e-12), "ridge": True}  # fmt: skip
    assert np.all(bounded[kind])
    if kind == "convex":
        # Inside the simplex and on its face: both happen.
        assert 0.1 < (found.sum(axis=2) > 1.0 - 1e-9).mean() < 0.9
    elif kind == "ridge":
        # Control: without bounds they are broken, so the bounds above say something.
        assert found.min() < -0.1 and np.abs(found.sum(axis=2) - 1.0).max() > 0.1


def test_without_the_ridge_alike_examples_fight_each_other():
    rng = np.random.default_rng(9)
    base, noise = rng.normal(size=(50, 3)), rng.normal(size=(3, 50, 3))
    examples = np.stack([base, base + 1e-3 * noise[0]])
    new = (base + 0.05 * noise[1])[None]
    regions = np.zeros(50, dtype=int)
    free, held = (np.abs(region_coefficients(examples, new, regions, ridge=r)).max() for r in (0.0, RIDGE))
    # Measured 5.9 and 0.5.
    assert free > 3.0 and held < 1.0, (free, held)


def test_a_region_that_rough_examples_hardly_move_has_small_coefficients():
    """Rounding in the rough examples is no evidence, however well a new shape goes along with it."""
    regions = np.repeat([0, 1], 20)
    rng = np.random.default_rng(10)
    shape = rng.normal(size=(40, 3))
    for noise in (0.0, 1e-12, 1e-6):
        examples = np.array([shape * np.where(regions == 0, 5.0, noise)[:, None]])
        found = region_coefficients(examples, 5.0 * shape[None], regions)[0, :, 0]
        close(found[0], 1.0 / (1.0 + RIDGE), atol=1e-12)
        # noise 25 / (RIDGE QUIET 12.5 overall), at most.
        assert 0.0 <= found[1] <= 2.0 * noise / (RIDGE * QUIET)
        if noise:
            # Control: with the region's own mean alone, it is how often the noise goes into the new shape.
            alone = region_coefficients(examples[:, 20:], 5.0 * shape[None, 20:], regions[20:] - 1)[0, 0, 0]
            assert alone > 1e3 and alone > 1e2 * found[1]


@pytest.mark.parametrize(
    ("options", "words"),
    [({"ridge": -1.0}, "ridge is -1"), ({"ridge": np.nan}, "ridge is nan"), ({"ridge": 0.0}, "do not differ")],
)
def test_ridges_that_cannot_work_are_one_line(options, words):
    twice = np.stack([np.ones((5, 3)), np.ones((5, 3))])
    with pytest.raises(EvalkitError, match=words):
        region_coefficients(twice, twice, np.zeros(5, dtype=int), **options)


# --- blending -----------------------------------------------------------------------------------------------


def mappings(count, triangles, seed=11, mirrored=False):
    """(3, 3, count, triangles) with determinants of one sign, turned by any angle and stretched up to e^1."""
    rng = np.random.default_rng(seed)
    r = Rotation.random(count * triangles, random_state=seed).as_matrix()
    s = Rotation.random(count * triangles, random_state=seed + 1).as_matrix()
    values = np.exp(rng.uniform(-1.0, 1.0, (count * triangles, 1, 3)))
    values[:, :, 2] *= -1.0 if mirrored else 1.0
    return np.moveaxis((r @ (s * values) @ s.swapaxes(1, 2)).reshape(count, triangles, 3, 3), (2, 3), (0, 1))


def test_blends_are_those_of_one_triangle_after_the_other():
    q, weights = mappings(3, 15), np.random.default_rng(12).uniform(-0.5, 1.2, (2, 3, 15))
    found = RotationStretch.of(q).blended(weights)
    linear = Linear.of(q).blended(weights)
    for n in range(2):
        for t in range(15):
            each, w = np.moveaxis(q[:, :, :, t], 2, 0), weights[n, :, t]
            expected = slow.blend(each, w)
            close(found[:, :, n, t], expected, atol=1e-11 * np.abs(expected).max())
            straight = np.eye(3) + np.einsum("m,mij->ij", w, each - np.eye(3))
            close(linear[:, :, n, t], straight, atol=1e-12)


@pytest.mark.parametrize("name", blends)
def test_blends_pass_through_the_examples_and_the_identity(name):
    q = mappings(3, 500)
    hot = np.repeat(np.eye(3)[:, :, None], 500, axis=2)
    blend = blends[name].of(q)
    close(blend.blended(hot), q, atol=1e-12)
    nothing = blend.blended(np.zeros((1, 3, 500)))
    close(nothing, np.broadcast_to(np.eye(3)[:, :, None, None], nothing.shape), atol=1e-15)


def test_one_example_is_the_spherical_interpolation_from_the_identity():
    from scipy.spatial.transform import Slerp

    r = Rotation.from_rotvec(np.radians(170.0) * np.array([0.6, 0.0, 0.8]))
    q = r.as_matrix()[:, :, None, None]
    for share in (0.1, 0.5, 0.9):
        expected = Slerp([0, 1], Rotation.concatenate([Rotation.identity(), r]))(share).as_matrix()
        close(RotationStretch.of(q).blended(np.full((1, 1, 1), share))[:, :, 0, 0], expected, atol=1e-12)
        # Control: the straight way between them loses its volume.
        assert np.linalg.det(Linear.of(q).blended(np.full((1, 1, 1), share))[:, :, 0, 0]) < 0.7


@quick
@given(arrays(np.float64, (1, 3, 20), elements=st.floats(-3.0, 4.0)), st.integers(0, 50))
def test_the_determinant_is_positive_for_any_coefficients(weights, seed):
    found = RotationStretch.of(mappings(3, 20, seed)).blended(weights)
    assert (np.linalg.det(stacked(found)) > 0.0).all()


def test_control_linear_blends_turn_space_over():
    """Shares of a third, a half and all of three examples turned by up to half a turn."""
    q = mappings(3, 2000)
    for share in (1 / 3, 0.5, 1.0):
        w = np.full((1, 3, 2000), share)
        linear, ours = (np.linalg.det(stacked(b.of(q).blended(w))) for b in (Linear, RotationStretch))
        assert (linear < 0.0).mean() > 0.05 and (ours > 0.0).all(), ((linear < 0.0).mean(), share)


def test_mappings_that_turn_over_or_collapse_have_a_logarithm_all_the_same():
    for q in (mappings(2, 50, mirrored=True), np.zeros((3, 3, 2, 5)), np.eye(3)[:, [0, 1, 1]][:, :, None, None]):
        found = RotationStretch.of(q).blended(np.full((1, q.shape[2], q.shape[3]), 0.5))
        assert np.isfinite(found).all() and (np.linalg.det(stacked(found)) > 0.0).all()
    # The size of the negative stretch counts; the rotation stays.
    flat = RotationStretch.of(np.diag([1.0, 1.0, -0.5])[:, :, None, None]).blended(np.ones((1, 1, 1)))[:, :, 0, 0]
    close(flat, np.diag([1.0, 1.0, 0.5]), atol=1e-12)
    # However far a triangle is squeezed, its inverse does not explode beyond what is said.
    for squeezed in (1e-5, 1e-8, 1e-13, 0.0):
        back = RotationStretch.of(np.diag([1.0, 1.0, squeezed])[:, :, None, None]).blended(-np.ones((1, 1, 1)))
        assert np.abs(back).max() <= (1.0 + 1e-9) / max(squeezed, LEAST_STRETCH)


# --- all of it ----------------------------------------------------------------------------------------------


def test_the_whole_is_its_steps_one_after_the_other():
    transfer = CharacterTransfer(*PATCH.examples)
    assert transfer.regions.max() == 1
    new = PATCH.new[:1]
    expected = slow.transfer(
        PATCH.rest, PATCH.triangles, PATCH.rough, PATCH.fine, new[0], transfer.regions,
        still=STILL, ridge=RIDGE, quiet=QUIET,
    )  # fmt: skip
    found = transfer_character(PATCH.rest, PATCH.rough, PATCH.fine, new, PATCH.triangles)
    close(found[0], expected, atol=EXACT * PATCH.size)
    # Control: it is not the rough shape.
    assert np.abs(found - new).max() > 1e-3 * PATCH.size


def violent():
    """Examples whose fine shapes are rolled by 170 degrees, and one of them with a triangle turned over."""
    made = sculpts(turn_deg=170.0, seed=1)
    fine = made.fine.copy()
    vertex = made.triangles[np.argmin(np.linalg.norm(made.rest[made.triangles[:, 0]] - [0, 40, 110], axis=1)), 0]
    opposite = [v for v in made.triangles[(made.triangles == vertex).any(axis=1)][0] if v != vertex]
    fine[0, vertex] = 2.0 * fine[0, opposite].mean(axis=0) - fine[0, vertex]
    return made.rest, made.rough, fine, made.triangles


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("blend", blends)
@pytest.mark.parametrize("levels", [0, 4])
def test_one_hot_coefficients_give_the_sculpts(side, blend, levels):
    for examples in (FACE.examples, PATCH.examples, violent()):
        rest, rough, fine, _ = examples
        transfer = CharacterTransfer(*examples, side=side, blend=blend, regions=levels)
        close(transfer(rough, one_hot(transfer)), fine, atol=EXACT * np.linalg.norm(np.ptp(rest, axis=0)))
        # Control: others do not.
        assert np.abs(transfer(rough, 0.9 * one_hot(transfer)) - fine).max() > 1e-3


def test_the_violent_examples_are_violent():
    rest, _, fine, triangles = violent()
    turns = Rotation.from_matrix(
        [slow.polar(g)[0] for k in range(3) for g in stacked(deformation_gradients(rest, fine, triangles)[:, :, k])]
    )
    assert np.degrees(turns.magnitude().max()) > 165.0
    assert flipped(rest, fine, triangles)[0].any()


def test_rest_in_rest_out_and_no_change_no_change():
    transfer = CharacterTransfer(*FACE.examples)
    close(transfer(FACE.rest[None])[0], FACE.rest, atol=EXACT * FACE.size)
    same = CharacterTransfer(FACE.rest, FACE.rough, FACE.rough, FACE.triangles)
    close(same(FACE.new), FACE.new, atol=EXACT * FACE.size)
    # Also where nothing in the examples moves at all.
    still = np.repeat(FACE.rest[None], 2, axis=0)
    np.testing.assert_array_equal(transfer_character(FACE.rest, still, still, FACE.new, FACE.triangles), FACE.new)


@pytest.mark.parametrize("side", ["left", "right"])
def test_common_motions_of_everything_and_the_unit_go_through(side):
    expected = CharacterTransfer(*FACE.examples, side=side)(FACE.new)
    for function in (
        lambda v: v + np.array([140.0, 1520.0, 260.0]),
        lambda v: 0.001 * v,
        lambda v: 1000.0 * v,
        lambda v: v @ TURN.T,
    ):
        moved = FACE.mapped(function)
        found = CharacterTransfer(*moved.examples, side=side)(moved.new)
        # A translation of 1.5 m costs a digit of a face of 0.3 m, times the condition of the coefficients.
        close(found, np.array([function(s) for s in expected]), atol=EXACT * moved.size)


def test_only_the_right_product_turns_with_the_new_shape():
    """With the same coefficients; nothing but the new shapes is turned."""
    for side, same in (("right", True), ("left", False)):
        transfer = CharacterTransfer(*FACE.examples, side=side)
        weights = transfer.coefficients(FACE.new)
        straight, turned = transfer(FACE.new, weights), transfer(FACE.new @ TURN.T, weights)
        pinned = transfer.pinned
        # Still vertices do not move in any example, so that a turn of the new shape is theirs, too.
        np.testing.assert_array_equal(straight[:, pinned], FACE.new[:, pinned])
        off = np.abs(turned - straight @ TURN.T).max()
        assert bool(off < EXACT * FACE.size) is same, (side, off)
        assert same or off > 1e-3 * FACE.size


def test_opposite_bends_cancel_where_linear_blending_turns_triangles_over():
    """Two examples bent by +90 and -90 degrees about each axis, in equal shares from none to all of each."""
    rest, triangles = uneven_face(31, 41)
    centre = rest[np.argmin(np.linalg.norm(rest - [0.0, 40.0, 115.0], axis=1))]
    shares = np.linspace(0.0, 1.0, 6)
    counts = dict.fromkeys(blends, 0)
    for axis in np.eye(3):
        rough = np.array([rest + push(rest, centre, 25.0, sign * 3.0 * axis) for sign in (1, -1)])
        fine = np.array([rest + roll(rest, centre, 25.0, sign * 0.5 * np.pi * axis) for sign in (1, -1)])
        assert not flipped(rest, fine, triangles).any()
        new = np.repeat(rest[None], len(shares), axis=0)
        for name in blends:
            transfer = CharacterTransfer(rest, rough, fine, triangles, regions=0, blend=name)
            shapes = transfer(new, np.broadcast_to(shares[:, None, None], (len(shares), 1, 2)))
            counts[name] += int(flipped(rest, shapes, triangles).sum())
    # Measured 0 and 60.
    assert counts["rotation-stretch"] == 0 and counts["linear"] > 30, counts


def test_one_factorisation_for_any_number_of_shapes(monkeypatch):
    counted = []
    original = solver_module.factorised
    monkeypatch.setattr(solver_module, "factorised", lambda matrix: counted.append(1) or original(matrix))
    transfer = CharacterTransfer(*FACE.examples)
    for count in (1, 2, 70):
        transfer(np.repeat(FACE.new[:1], count, axis=0))
    assert len(counted) == 1
    # Control: another character has its own.
    CharacterTransfer(*PATCH.examples)
    assert len(counted) == 2


def test_many_at_once_are_one_after_the_other():
    transfer = CharacterTransfer(*FACE.examples)
    many = np.concatenate([FACE.new, FACE.rough, FACE.fine, FACE.new[::-1]] * 5)
    together = transfer(many)
    for k in (0, 3, 11, len(many) - 1):
        # The same sums in other blocks of the processor's width.
        close(together[k], transfer(many[k : k + 1])[0], atol=1e-12 * FACE.size)
    assert transfer(np.empty((0, len(FACE.rest), 3))).shape == (0, len(FACE.rest), 3)


def test_twice_gives_the_same_bits_and_leaves_its_input_alone():
    arrays_ = [np.array(a) for a in (FACE.rest, FACE.rough, FACE.fine, FACE.new, FACE.triangles)]
    for array in arrays_:
        array.setflags(write=False)
    first, second = (transfer_character(*arrays_) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    for array, before in zip(arrays_, (FACE.rest, FACE.rough, FACE.fine, FACE.new, FACE.triangles), strict=True):
        np.testing.assert_array_equal(array, before)


def test_the_order_of_vertices_triangles_and_examples_does_not_matter():
    rng = np.random.default_rng(13)
    order, other = rng.permutation(len(FACE.rest)), rng.permutation(len(FACE.triangles))
    expected = transfer_character(FACE.rest, FACE.rough, FACE.fine, FACE.new, FACE.triangles)
    found = transfer_character(
        FACE.rest[order], FACE.rough[::-1, order], FACE.fine[::-1, order], FACE.new[:, order],
        np.argsort(order)[FACE.triangles[other]],
    )  # fmt: skip
    close(found, expected[:, order], atol=EXACT * FACE.size)


def test_regions_and_coefficients_of_a_user():
    middle = FACE.rest[np.linalg.norm(FACE.fine[0] - FACE.rough[0], axis=1).argmax(), 1]
    regions = (FACE.rest[:, 1] > middle).astype(int)
    transfer = CharacterTransfer(*FACE.examples, regions=3 * regions + 2)
    np.testing.assert_array_equal(transfer.regions, regions)
    weights = np.zeros((1, 2, 3))
    weights[0, 1, 0] = 1.0
    found = transfer(FACE.rough[:1], weights)[0]
    without = transfer(FACE.rough[:1], np.zeros((1, 2, 3)))[0]
    close(without, FACE.rough[0], atol=EXACT * FACE.size)
    # One region of two is neither nothing nor the sculpt.
    assert np.abs(found - without).max() > 1.0 and np.abs(found - FACE.fine[0]).max() > 1.0


BAD = {
    "no example": (lambda e: (e[0], e[1][:0], e[2][:0], e[3]), {}, ["no example", "at least one"]),
    "unpaired": (lambda e: (e[0], e[1], e[2][:2], e[3]), {}, ["3 rough and 2 fine"]),
    "topology": (lambda e: (e[0], e[1], e[2][:, :-1], e[3]), {}, ["fine examples", "(3, 395, 3)", "396"]),
    "nan": (lambda e: (e[0], np.where(np.arange(396)[:, None] == 9, np.nan, e[1]), e[2], e[3]), {},
            ["rough examples", "shape 0: vertex 9 is not finite"]),
    "collapsed": (lambda e: (e[0], collapsed(e, 1, 100), e[2], e[3]), {}, ["rough example 1", "has collapsed"]),
    "rest": (lambda e: (np.where(np.arange(396)[:, None] == 9, np.inf, e[0]), *e[1:]), {}, ["rest", "vertex 9"]),
    "kind": (lambda e: e, {"coefficients": "rigde"}, ["coefficients 'rigde' is not known", "ridge, non-negative"]),
    "blend": (lambda e: e, {"blend": "cubic"}, ["blend 'cubic'", "rotation-stretch, linear"]),
    "side": (lambda e: e, {"side": "up"}, ["side 'up'", "left, right"]),
    "regions": (lambda e: e, {"regions": np.zeros(7, dtype=int)}, ["regions have shape (7,)", "396"]),
    "region names": (lambda e: e, {"regions": ["lips"] * 396}, ["whole numbers"]),
}  # fmt: skip


def collapsed(examples, which, triangle):
    rough = examples[1].copy()
    a, b, c = examples[3][triangle]
    # Rounding leaves a little area, as it does in a file.
    rough[which, c] = rough[which, a] + 0.3 * (rough[which, b] - rough[which, a])
    return rough


@pytest.mark.parametrize("name", BAD)
def test_examples_that_cannot_be_used_are_one_line(name):
    change, options, words = BAD[name]
    with pytest.raises(EvalkitError) as caught:
        CharacterTransfer(*change(FACE.examples), **options)
    line = str(caught.value)
    assert "\n" not in line and [word for word in words if word not in line] == [], line


@pytest.mark.parametrize(
    ("shapes", "coefficients", "words"),
    [
        (FACE.new[:, :5], None, "rough shapes: shape (2, 5, 3); expected (shapes, 396, 3)"),
        (FACE.new[0], None, "rough shapes"),
        (FACE.new * np.nan, None, "rough shapes: shape 0: vertex 0 is not finite"),
        (FACE.new, np.zeros((2, 1, 3)), "coefficients have shape (2, 1, 3); expected (2, "),
        (FACE.new, np.full((2, 99, 3), np.nan), "coefficients have shape"),
        (FACE.new, "none", "coefficients must be an array of numbers"),
    ],
)
def test_shapes_and_coefficients_that_cannot_be_used_are_one_line(shapes, coefficients, words):
    transfer = CharacterTransfer(*FACE.examples)
    with pytest.raises(EvalkitError) as caught:
        transfer(shapes, coefficients)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_coefficient_that_is_not_a_number_is_named():
    transfer = CharacterTransfer(*FACE.examples)
    weights = transfer.coefficients(FACE.new)
    weights[1, 2, 0] = np.nan
    with pytest.raises(EvalkitError, match="shape 1, region 2, example 0: not finite"):
        transfer(FACE.new, weights)


# --- example-based rigging ----------------------------------------------------------------------------------


def test_the_steps_of_the_rig_are_dense_least_squares():
    rng = np.random.default_rng(14)
    mixtures = rng.uniform(0.0, 1.0, (3, 5))
    goal, prior = rng.normal(size=(3, 9, 7)), rng.normal(size=(5, 9, 7))
    looseness = rng.uniform(0.01, 3.0, (5, 7))
    found = _shapes_step(mixtures, goal, prior, looseness)
    for t in range(7):
        for entry in range(9):
            expected = slow.rig_shapes(mixtures, goal[:, entry, t], prior[:, entry, t], looseness[:, t])
            close(found[:, entry, t], expected, atol=1e-12)
    start, moves, goals = np.eye(3, 5), rng.normal(size=(5, 20, 3)), rng.normal(size=(3, 20, 3))
    goals += np.einsum("ki,ivj->kvj", rng.uniform(-0.3, 1.3, (3, 5)), moves)
    mixed = _mixtures_step(start, moves, goals, 0.3)
    weight = 0.3 * (moves**2).sum() / 5
    for k in range(3):
        # lsq_linear stops when the gradient is 1e-10 of its start.
        close(mixed[k], slow.rig_mixture(start[k], moves.reshape(5, -1), goals[k].ravel(), weight), atol=1e-7)
    assert mixed.min() < 1e-6 and mixed.max() <= 1.0


def test_a_rig_moves_new_shapes_only_where_mixtures_use_them():
    found = example_based_rig(FACE.rest, FACE.triangles, FACE.rough, FACE.rough, FACE.new)
    # Fine examples that are the rough ones are met by the first guess; it stays.
    close(found, FACE.new, atol=EXACT * FACE.size)
    other = example_based_rig(FACE.rest, FACE.triangles, FACE.rough, FACE.fine, FACE.new)
    assert np.abs(other - FACE.new).max() > 1e-3
