"""Batched 3x3 matrix functions against scipy.linalg, one matrix at a time, and in their awkward places."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from oracles import transfer_oracles as slow
from scipy.spatial.transform import Rotation

from evalkit.transfer.matrices import (
    exp_rotation,
    exp_symmetric,
    inverse,
    log_positive,
    log_rotation,
    polar,
    product,
)

COUNT, SAMPLE = 10_000, 25
"""So many at once, of which so many are compared with a loop of scipy.linalg."""

EXACT = 1e-12
"""Sixteen digits, less one for nine or ten products, less two for condition numbers up to e^4, and one to spare."""

quick = settings(derandomize=True, deadline=None, max_examples=60, database=None)

entries = st.floats(-1e3, 1e3, allow_subnormal=False)


close = functools.partial(np.testing.assert_allclose, rtol=0.0)


def rotations(count, seed=0):
    """(3, 3, count), of every angle."""
    return np.moveaxis(Rotation.random(count, random_state=seed).as_matrix(), 0, -1)


def symmetric(count, size=2.0, seed=1):
    """(3, 3, count) with eigenvalues within +-size."""
    r, values = rotations(count, seed), np.random.default_rng(seed).uniform(-size, size, (3, count))
    return np.einsum("ikn,kn,jkn->ijn", r, values, r)


def sampled(count=COUNT):
    return np.linspace(0, count - 1, SAMPLE).astype(int)


def singular_values(values, seed=3):
    left, right = rotations(1, seed)[..., 0], rotations(1, seed + 1)[..., 0]
    return left @ np.diag(values) @ right


# --- against scipy, one by one -----------------------------------------------------------------------------


def test_exponential_and_logarithm_of_many_symmetric_matrices():
    s = symmetric(COUNT)
    e = exp_symmetric(s)
    back = log_positive(e)
    for n in sampled():
        expected = scipy.linalg.expm(s[..., n])
        close(e[..., n], expected, atol=EXACT * np.abs(expected).max())
        close(back[..., n], scipy.linalg.logm(expected), atol=EXACT)
    close(back, s, atol=EXACT)
    # Control: the first two terms of the series alone are not it.
    assert np.abs(e - (np.eye(3)[..., None] + s)).max() > 0.1


def test_half_of_a_logarithm_is_the_square_root():
    e = exp_symmetric(symmetric(COUNT, seed=2))
    root = exp_symmetric(0.5 * log_positive(e))
    for n in sampled():
        close(root[..., n], scipy.linalg.sqrtm(e[..., n]), atol=10 * EXACT)


def test_polar_decomposition_of_many_matrices():
    m = np.random.default_rng(4).normal(size=(3, 3, COUNT))
    r, s = polar(m)
    # Half of random matrices turn space over; their smallest eigenvalue is negative, their R still a rotation.
    assert 0.4 < (np.linalg.det(np.moveaxis(m, -1, 0)) < 0.0).mean() < 0.6
    close(np.linalg.det(np.moveaxis(r, -1, 0)), 1.0, atol=EXACT)
    close(product(r, s), m, atol=EXACT * np.abs(m).max())
    np.testing.assert_array_equal(s, s.swapaxes(0, 1))
    for n in sampled():
        left, values, right = np.linalg.svd(m[..., n])
        # How well the rotation is determined: by the smallest sum of two singular values, with their signs.
        sign = np.sign(np.linalg.det(left @ right))
        tolerance = EXACT * values[0] / (values[1] + sign * values[2])
        expected = slow.polar(m[..., n])
        close(r[..., n], expected[0], atol=tolerance)
        close(s[..., n], expected[1], atol=values[0] * tolerance)
        if sign > 0.0:
            close(r[..., n], scipy.linalg.polar(m[..., n])[0], atol=tolerance)
    # Control: without the flip the orthogonal factor of half of them is a mirror.
    mirrors = [np.linalg.det(scipy.linalg.polar(m[..., n])[0]) < 0.0 for n in sampled()]
    assert any(mirrors)


def test_logarithm_and_exponential_of_many_rotations():
    r = rotations(COUNT)
    v = log_rotation(r)
    close(v, Rotation.from_matrix(np.moveaxis(r, -1, 0)).as_rotvec().T, atol=EXACT)
    close(exp_rotation(v), r, atol=EXACT)
    for n in sampled():
        skew = np.cross(np.eye(3), v[:, n])
        close(exp_rotation(v)[..., n], scipy.linalg.expm(skew), atol=EXACT)


def test_products_and_inverses():
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 3, 3, 4, 50))
    close(
        np.moveaxis(product(a, b), (0, 1), (2, 3)),
        np.moveaxis(a, (0, 1), (2, 3)) @ np.moveaxis(b, (0, 1), (2, 3)),
        atol=EXACT,
    )
    expected = np.linalg.inv(np.moveaxis(a, (0, 1), (2, 3)))
    close(np.moveaxis(inverse(a), (0, 1), (2, 3)), expected, atol=EXACT * np.abs(expected).max())
    # A singular matrix among others is nobody else's trouble, and no warning.
    a[:, :, 0, 0] = 0.0
    assert not np.isfinite(inverse(a)[:, :, 0, 0]).any() and np.isfinite(inverse(a)[:, :, 1:]).all()


# --- awkward places ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("off_deg", [0.0, 1e-7, 1e-4, 1.0, 10.0])
def test_rotations_near_half_a_turn(off_deg):
    """About every kind of axis; at exactly half a turn the axis may point either way."""
    axes = np.array([[1, 0, 0], [0, 1, 0], [0, 0, -1], [1, 1, 0], [-1, 2, 3], [1e-8, 1, 0]], dtype=float)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    v = np.radians(180.0 - off_deg) * axes.T
    r = exp_rotation(v)
    close(exp_rotation(log_rotation(r)), r, atol=EXACT)
    if off_deg >= 1e-4:
        close(log_rotation(r), v, atol=EXACT)
    # Control: the textbook formula, which divides by the sine, has lost these digits.
    angle = np.arccos(np.clip((np.trace(r) - 1.0) / 2.0, -1.0, 1.0))
    skew = np.stack([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    with np.errstate(divide="ignore", invalid="ignore"):
        textbook = skew * angle / (2.0 * np.sin(angle))
    if off_deg <= 1e-4:
        assert not np.abs(exp_rotation(np.nan_to_num(textbook)) - r).max() < EXACT


def test_small_rotations_keep_their_digits():
    for size in (1e-300, 1e-160, 1e-12, 1e-8, 1e-4):
        v = size * np.array([[0.6], [-0.8], [0.3]])
        close(log_rotation(exp_rotation(v)), v, atol=1e-14 * size)
    np.testing.assert_array_equal(log_rotation(np.eye(3)), np.zeros(3))
    np.testing.assert_array_equal(exp_rotation(np.zeros(3)), np.eye(3))


@pytest.mark.parametrize(
    "values",
    [(1, 1, 1), (1, 1, 1e-3), (1, 1, 1e-9), (1, 1, 1e-13), (1, 1, 0), (1, 1e-9, 0), (1, 0, 0), (0, 0, 0),
     (1e6, 1e6, 1e-6), (1e-9, 1e-9, 1e-9), (1e9, 2e9, 3e9)],
)  # fmt: skip
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_polar_of_flat_and_badly_scaled_matrices(values, sign):
    m = singular_values(np.array(values) * [1, 1, sign])
    r, s = polar(m)
    assert np.isfinite(r).all() and abs(np.linalg.det(r) - 1.0) < EXACT
    close(r @ r.T, np.eye(3), atol=EXACT)
    close(r @ s, m, atol=EXACT * max(values))


def test_one_flat_matrix_does_not_spoil_its_neighbours():
    m = np.random.default_rng(6).normal(size=(3, 3, 7))
    alone = [polar(m[..., n : n + 1]) for n in range(7)]
    m[..., 3] = 0.0
    together = polar(m)
    for n in (0, 1, 2, 4, 5, 6):
        for one, many in zip(alone[n], together, strict=True):
            close(many[..., n], one[..., 0], atol=EXACT)


@pytest.mark.parametrize("values", [(-1, 2, 3), (-1, -2, 3), (-1, -2, -3), (0, 1, 2), (0, 0, 0), (-1e-9, 1, 1)])
def test_logarithm_of_what_is_not_positive_is_not_a_number(values):
    """For every orientation, and beside matrices that have one."""
    r = rotations(500, seed=7)
    m = np.einsum("ikn,kn,jkn->ijn", r, np.broadcast_to(np.array(values, float)[:, None], (3, 500)), r)
    if min(values) == 0:
        # Rounding makes a singular matrix one of either sign: only axes make it exact.
        m = np.diag(np.array(values, float))[..., None]
    both = np.concatenate([m, np.eye(3)[..., None]], axis=2)
    out = log_positive(both)
    assert np.isnan(out[..., :-1]).all()
    np.testing.assert_array_equal(out[..., -1], 0.0)


@pytest.mark.parametrize("power", [1e-9, 1e-3, 1.0, 30.0, 200.0])
def test_logarithms_far_from_the_identity(power):
    """Of matrices with a condition number of one, up to e^200, and of ill-conditioned ones."""
    m = np.exp(power) * np.eye(3)
    close(log_positive(m), power * np.eye(3), atol=1e-13 * power + 1e-15)
    # Relative to the entries of the matrix: what an eigenvalue of e^-12 keeps beside one of e^12 is twelve digits less.
    d = np.array([12.0, 0.0, -12.0])
    close(np.diag(log_positive(np.diag(np.exp(d)))), d, atol=1e-12)


def test_shapes_of_batches():
    r = rotations(24)
    for shape in ((), (1,), (24,), (2, 12), (2, 3, 4)):
        batch = r[..., : int(np.prod(shape, dtype=int))].reshape(3, 3, *shape)
        assert log_rotation(batch).shape == (3, *shape)
        assert exp_rotation(log_rotation(batch)).shape == (3, 3, *shape)
        assert all(part.shape == batch.shape for part in polar(batch))
        s = polar(batch)[1]
        assert exp_symmetric(s).shape == log_positive(s).shape == inverse(batch).shape == batch.shape
    empty = np.empty((3, 3, 0))
    assert log_rotation(empty).shape == (3, 0)
    assert exp_symmetric(empty).shape == log_positive(empty).shape == polar(empty)[0].shape == (3, 3, 0)


def test_matrices_that_are_given_stay_as_they_are():
    m = np.abs(np.random.default_rng(8).normal(size=(3, 3, 9)))
    s = exp_symmetric(symmetric(9))
    for function, given_ in ((polar, m), (inverse, m), (log_positive, s), (exp_symmetric, s), (log_rotation, s)):
        given_.setflags(write=False)
        before = given_.copy()
        function(given_)
        np.testing.assert_array_equal(given_, before)


# --- any matrix ---------------------------------------------------------------------------------------------


@quick
@given(arrays(np.float64, (3, 3), elements=entries))
def test_polar_of_any_matrix(m):
    r, s = polar(m)
    size = np.abs(m).max()
    close(r @ r.T, np.eye(3), atol=EXACT)
    assert np.linalg.det(r) > 0.0
    close(r @ s, m, atol=EXACT * size)
    np.testing.assert_array_equal(s, s.T)
    values = np.linalg.eigvalsh(s)
    # Nearest rotation: no other has a larger trace of R' m; at most the smallest eigenvalue is negative.
    assert values[0] + values[1] >= -EXACT * size


@quick
@given(arrays(np.float64, (3, 3), elements=st.floats(-3, 3)), st.floats(1e-6, 1e6))
def test_logarithm_undoes_the_exponential(m, scale):
    s = 0.5 * (m + m.T)
    e = exp_symmetric(s)
    # Relative to the largest eigenvalue of e: what its smallest has lost by then, its logarithm has lost, too.
    lost = np.exp(np.ptp(np.linalg.eigvalsh(s)))
    close(log_positive(e), s, atol=1e-15 * lost + EXACT)
    close(log_positive(scale * e), s + np.log(scale) * np.eye(3), atol=1e-15 * lost + EXACT)


@quick
@given(arrays(np.float64, 3, elements=st.floats(-1.8, 1.8)))
def test_logarithm_undoes_rotations_below_half_a_turn(v):
    close(log_rotation(exp_rotation(v)), v, atol=EXACT)
