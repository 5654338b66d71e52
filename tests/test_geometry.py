"""Geometry against SciPy, at any angle and for any batch."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from evalkit.geometry import (
    apply_motion,
    cross_matrix,
    mean_rotation,
    nearest_rotation,
    quaternion_from_rotation,
    rotation_angle,
    rotation_from_vector,
    rotation_vector,
    undo_motion,
)

quick = settings(derandomize=True, deadline=None, max_examples=150, database=None)

directions = hnp.arrays(float, 3, elements=st.floats(-1, 1, width=32)).filter(lambda v: np.linalg.norm(v) > 0.05)
angles = st.one_of(
    st.floats(0.0, np.pi),
    st.sampled_from([0.0, np.pi, np.pi / 2, 1e-300, 1e-160, 1e-20, 1e-9]),
    st.floats(1e-15, 1e-6),
    st.floats(np.pi - 1e-6, np.pi),
)


def vector(direction, angle):
    return angle * direction / np.linalg.norm(direction)


@quick
@given(directions, angles)
def test_rotation_vectors_there_and_back(direction, angle):
    v = vector(direction, angle)
    r = rotation_from_vector(v)
    # Rodrigues' formula in double precision.
    np.testing.assert_allclose(r, Rotation.from_rotvec(v).as_matrix(), atol=4e-15)
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=4e-15)
    back = rotation_vector(r[None])[0]
    # At 180 degrees both signs are the same rotation; elsewhere the vector itself, small ones to their own digits.
    assert min(np.linalg.norm(back - v), np.linalg.norm(back + v) if angle > 3.1 else np.inf) < 1e-14 + 1e-13 * angle
    assert rotation_angle(r) == pytest.approx(angle, abs=1e-14 + 1e-13 * angle)


@quick
@given(directions, angles)
def test_quaternions_there_and_back(direction, angle):
    r = rotation_from_vector(vector(direction, angle))
    w, x, y, z = quaternion_from_rotation(r[None])[0]
    assert w >= 0
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), r, atol=1e-14)


def test_small_angles_keep_their_digits():
    """The arc cosine of the trace, the usual way, would give 0 or 1.5e-8 here."""
    for angle in (1e-9, 1e-12, 1e-15):
        r = rotation_from_vector([angle, 0.0, 0.0])
        assert rotation_angle(r) == pytest.approx(angle, rel=1e-6)
        naive = np.arccos(np.clip((np.trace(r) - 1) / 2, -1, 1))
        assert abs(naive - angle) > 0.1 * angle  # control


def test_quaternions_are_continuous_through_half_a_turn_and_gaps():
    angle = np.linspace(0.0, 4 * np.pi, 400)
    r = Rotation.from_rotvec(angle[:, None] * np.array([0.6, 0.0, 0.8])).as_matrix()
    q = quaternion_from_rotation(r)
    # Steps of 4 pi / 400 = 0.03 rad are half of that in the quaternion.
    assert np.linalg.norm(np.diff(q, axis=0), axis=1).max() < 0.017
    assert q[-1, 0] == pytest.approx(1.0) or q[-1, 0] == pytest.approx(-1.0)
    r[100:120] = np.nan
    holed = quaternion_from_rotation(r)
    assert np.isnan(holed[100:120]).all()
    np.testing.assert_allclose(holed[120:], q[120:], atol=1e-14)
    # Control: SciPy's are not continuous here.
    plain = Rotation.from_rotvec(angle[:, None] * np.array([0.6, 0.0, 0.8])).as_quat(canonical=True)
    assert np.linalg.norm(np.diff(plain, axis=0), axis=1).max() > 1.0


@quick
@given(hnp.arrays(float, (3, 3), elements=st.floats(-10, 10, width=32)))
def test_nearest_rotation_is_a_rotation_and_the_nearest(matrix):
    r = nearest_rotation(matrix)
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-13)
    assert np.linalg.det(r) == pytest.approx(1.0, abs=1e-13)
    rng = np.random.default_rng(0)
    distance = np.linalg.norm(matrix - r)
    for other in Rotation.random(20, random_state=0).as_matrix():
        assert distance <= np.linalg.norm(matrix - other) + 1e-12
    for step in rng.normal(scale=1e-3, size=(10, 3)):
        assert distance <= np.linalg.norm(matrix - rotation_from_vector(step) @ r) + 1e-12
    if np.linalg.det(matrix) > 1e-3:
        # SciPy's polar factor; both lose digits as the matrix nears a singular one.
        np.testing.assert_allclose(r, scipy.linalg.polar(matrix)[0], atol=1e-9)


def test_nearest_rotation_of_batches_reflections_and_what_is_not_known():
    matrices = np.stack([np.eye(3), -np.eye(3), np.full((3, 3), np.nan), np.diag([1.0, 1.0, np.inf]), np.zeros((3, 3))])
    r = nearest_rotation(matrices)
    np.testing.assert_allclose(np.linalg.det(r[[0, 1, 4]]), 1.0, atol=1e-14)
    assert np.isnan(r[[2, 3]]).all()
    assert nearest_rotation(np.empty((0, 3, 3))).shape == (0, 3, 3)
    assert nearest_rotation(np.broadcast_to(np.eye(3), (2, 5, 3, 3))).shape == (2, 5, 3, 3)
    np.testing.assert_allclose(nearest_rotation(3.0 * np.eye(3)), np.eye(3), atol=1e-15)


def test_cross_matrix_is_the_cross_product():
    rng = np.random.default_rng(1)
    v, w = rng.normal(size=(2, 4, 5, 3))
    np.testing.assert_allclose((cross_matrix(v) @ w[..., None])[..., 0], np.cross(v, w), atol=1e-15)
    assert np.abs((cross_matrix(w) @ v[..., None])[..., 0] - np.cross(v, w)).max() > 0.1  # control: the other sign


def test_mean_rotation_is_scipys_and_leaves_out_what_is_unknown():
    r = Rotation.from_rotvec(np.random.default_rng(2).normal(scale=0.5, size=(50, 3)))
    holed = np.concatenate([r.as_matrix(), np.full((3, 3, 3), np.nan)])
    np.testing.assert_allclose(mean_rotation(holed), r.mean().as_matrix(), atol=1e-12)
    one = r[0].as_matrix()
    np.testing.assert_allclose(mean_rotation(one[None]), one, atol=1e-14)


@quick
@given(st.integers(0, 2**32 - 1), st.integers(0, 6), st.integers(1, 5), st.booleans())
def test_motion_done_and_undone(seed, frames, markers, moving):
    rng = np.random.default_rng(seed)
    r = rotation_from_vector(rng.normal(size=(frames, 3)))
    t = rng.normal(scale=1e3, size=(frames, 3))
    p = rng.normal(scale=100.0, size=(frames, markers, 3) if moving else (markers, 3))
    x = apply_motion(r, t, p)
    rows = np.broadcast_to(p, (frames, markers, 3))
    for i in range(frames):
        for m in range(markers):
            # Millimetres of 1e3: 1e-13 each.
            np.testing.assert_allclose(x[i, m], r[i] @ rows[i, m] + t[i], atol=1e-11)
    np.testing.assert_allclose(undo_motion(r, t, x), rows, atol=1e-11)


def test_unknown_frames_stay_unknown():
    r = np.stack([np.eye(3), np.full((3, 3), np.nan)])
    t = np.array([[1.0, 2.0, 3.0], [np.nan] * 3])
    x = apply_motion(r, t, np.ones((4, 3)))
    assert np.isfinite(x[0]).all() and np.isnan(x[1]).all()
    assert np.isnan(quaternion_from_rotation(r)[1]).all() and np.isnan(rotation_vector(r)[1]).all()
    assert np.isnan(rotation_angle(r)[1])
    assert quaternion_from_rotation(np.full((3, 3, 3), np.nan)).shape == (3, 4)
