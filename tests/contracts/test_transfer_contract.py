"""What every way from rough to fine shapes must do, and broken ways that must not get through."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from contracts.sculpts import patch, sculpts
from scipy.spatial.transform import Rotation

from evalkit.transfer.methods import Examples, methods

FACE = sculpts()

EXACT = 1e-9
"""Of the mesh's size: sixteen digits, less four for the condition number of a Laplacian of a few hundred vertices, less
three to spare."""

ITERATED = 1e-6
"""The same for a method whose inner solver stops when its gradient is 1e-10 of its start, ten rounds in a row; measured
2e-8."""

TOLERANCE = {"example-based rigging": ITERATED}


def examples_of(made, **changes):
    """Hand-drawn regions: above and below the middle."""
    drawn = (made.rest[:, 1] > np.median(made.rest[:, 1])).astype(np.intp)
    return dataclasses.replace(Examples(made.rest, made.triangles, made.rough, made.fine, drawn), **changes)


def tolerance(name):
    return TOLERANCE.get(name, EXACT)


def near(found, expected, name, size):
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance(name) * size)


def no_change_in_the_examples_is_no_change(method, name):
    found = method(examples_of(FACE, fine=FACE.rough), FACE.new)
    near(found, FACE.new, name, FACE.size)


def rest_in_is_rest_out(method, name):
    near(method(examples_of(FACE), FACE.rest[None])[0], FACE.rest, name, FACE.size)


def knows_neither_the_unit_nor_the_place_nor_the_axes(method, name):
    expected, drawn = method(examples_of(FACE), FACE.new), examples_of(FACE).hand_drawn
    turn = Rotation.from_euler("xyz", [20, -35, 50], degrees=True).as_matrix()
    for function in (
        lambda v: 0.001 * v,
        lambda v: 1000.0 * v,
        lambda v: v + np.array([140.0, 1520.0, 260.0]),
        lambda v: v @ turn.T,
    ):
        moved = FACE.mapped(function)
        # Vertices that hardly move are told by a share of the bounding box: these do not move at all.
        near(
            method(examples_of(moved, hand_drawn=drawn), moved.new),
            np.array([function(s) for s in expected]),
            name,
            moved.size,
        )


def twice_gives_the_same_bits(method, name):
    first, second = (method(examples_of(FACE), FACE.new) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def leaves_its_input_alone(method, name):
    kept = examples_of(FACE)
    arrays = [np.array(a) for a in (kept.rest, kept.triangles, kept.rough, kept.fine, kept.hand_drawn)]
    new = FACE.new.copy()
    for array in (*arrays, new):
        array.setflags(write=False)
    found = method(Examples(*arrays), new)
    assert found is not new and not np.shares_memory(found, new)
    for array, before in zip(arrays, (kept.rest, kept.triangles, kept.rough, kept.fine, kept.hand_drawn), strict=True):
        np.testing.assert_array_equal(array, before)
    np.testing.assert_array_equal(new, FACE.new)


TOGETHER = {"example-based rigging"}
"""Methods that fit all new shapes at once: one shape is helped by the others, so one alone may differ."""


def many_are_one_after_the_other(method, name):
    together = method(examples_of(FACE), FACE.new)
    alone = np.concatenate([method(examples_of(FACE), FACE.new[k : k + 1]) for k in range(len(FACE.new))])
    if name in TOGETHER:
        assert np.isfinite(alone).all() and alone.shape == together.shape
    else:
        near(alone, together, name, FACE.size)


def bears_a_single_example(method, name):
    one = examples_of(FACE, rough=FACE.rough[:1], fine=FACE.fine[:1])
    found = method(one, FACE.new)
    assert found.shape == FACE.new.shape and np.isfinite(found).all()
    # Examples in which nothing moves, too: there is nothing to learn, so the rough shapes stay.
    still = np.repeat(FACE.rest[None], 1, axis=0)
    near(method(examples_of(FACE, rough=still, fine=still), FACE.new), FACE.new, name, FACE.size)


def bears_vertices_without_triangles(method, name):
    """They are shapes' too: finite, and nobody else's trouble."""
    extra = np.array([[0.0, 0.0, 200.0], [10.0, 90.0, 0.0]])

    def with_extra(shapes):
        return np.concatenate([shapes, np.broadcast_to(extra, (len(shapes), 2, 3))], axis=1)

    expected = method(examples_of(FACE), FACE.new)
    more = examples_of(
        FACE, rest=np.vstack([FACE.rest, extra]), rough=with_extra(FACE.rough), fine=with_extra(FACE.fine),
        hand_drawn=np.append(examples_of(FACE).hand_drawn, [1, 1]),
    )  # fmt: skip
    found = method(more, with_extra(FACE.new))
    np.testing.assert_allclose(found[:, -2:], with_extra(FACE.new)[:, -2:], rtol=0.0, atol=EXACT * FACE.size)
    near(found[:, :-2], expected, name, FACE.size)


def bears_a_part_without_a_pin(method, name):
    """Eyes or teeth that move as a whole in every example: they stay with the rough shapes, in one piece."""
    rest, triangles = patch()
    both = sculpts()
    count = len(both.rest)
    part = 0.2 * rest + np.array([0.0, 60.0, 150.0])
    moves = np.array([[0.0, 2.0, 0.0], [1.0, -1.0, 3.0], [0.0, 0.0, 4.0]])

    def joined(shapes, moves):
        return np.concatenate([shapes, part + moves[: len(shapes), None]], axis=1)

    loose = Examples(
        np.vstack([both.rest, part]), np.concatenate([both.triangles, triangles + count]), joined(both.rough, moves),
        joined(both.fine, moves), np.append(examples_of(both).hand_drawn, np.zeros(len(part), dtype=np.intp)),
    )  # fmt: skip
    new = joined(both.new, 0.5 * moves)
    found = method(loose, new)[:, count:]
    if name in SCALES:
        assert np.isfinite(found).all()
    else:
        near(found, new[:, count:], name, both.size)


SCALES = {"gain", "local regression"}
"""Methods with a gain: what an example leaves as it is moves a little less or more, too."""

CHECKS = [
    no_change_in_the_examples_is_no_change,
    rest_in_is_rest_out,
    knows_neither_the_unit_nor_the_place_nor_the_axes,
    twice_gives_the_same_bits,
    leaves_its_input_alone,
    many_are_one_after_the_other,
    bears_a_single_example,
    bears_vertices_without_triangles,
    bears_a_part_without_a_pin,
]


@pytest.mark.parametrize("name", methods)
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_contract(name, check):
    check(methods[name], name)


def test_exceptions_are_of_methods_that_exist():
    for table in (TOLERANCE, TOGETHER, SCALES):
        assert set(table) <= set(methods)


# Controls: methods that are wrong in one way, and the check that must notice.


def _spoiling(examples, new):
    new -= new.mean(axis=1, keepdims=True)
    return new.copy()


def _drifting():
    random = np.random.default_rng(0)
    return lambda examples, new: new + 1e-12 * random.random()


BROKEN = [
    (lambda e, new: e.rest + 1.01 * (new - e.rest), no_change_in_the_examples_is_no_change),
    (lambda e, new: new + 1e-3, rest_in_is_rest_out),
    (lambda e, new: new + 1e-3 * np.sign(new), knows_neither_the_unit_nor_the_place_nor_the_axes),
    (_drifting(), twice_gives_the_same_bits),
    (_spoiling, leaves_its_input_alone),
    (lambda e, new: new + 0.01 * (new.mean(axis=0) - new), many_are_one_after_the_other),
    (lambda e, new: new * np.float64(np.ptp(e.fine, axis=0).any() or np.nan), bears_a_single_example),
    (lambda e, new: new + (e.rest.mean(axis=0) - e.rest[-1]), bears_vertices_without_triangles),
    (lambda e, new: e.rest + 0.9 * (new - e.rest), bears_a_part_without_a_pin),
]


@pytest.mark.parametrize("which", range(len(BROKEN)), ids=[check.__name__ for _, check in BROKEN])
def test_control_a_broken_method_does_not_get_through(which):
    method, check = BROKEN[which]
    with pytest.raises((AssertionError, ValueError)):
        check(method, "broken")
