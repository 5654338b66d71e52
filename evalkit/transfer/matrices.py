"""Functions of many 3x3 matrices at once, in closed form or a fixed number of products.

Matrices are stored frames last, shape (3, 3, ...): every operation then runs along contiguous memory. A loop of
``scipy.linalg`` over ten thousand triangles takes seconds where these take milliseconds; the tests compare the two.
"""

from __future__ import annotations

import numpy as np

from evalkit.geometry import Array, det3

SMALL_NORM = 1.0
"""The series of the exponential below is exact to rounding for matrices up to this norm."""

SERIES = 18

NEAR_IDENTITY = 0.2
"""Roots are taken until a matrix is so near to the identity, in the Frobenius norm; then eight terms of the series are
exact to rounding."""

NEWTON_STEPS = 12
"""The scaled iteration meets rounding in nine steps for any condition number up to 1e16."""

MOST_ROOTS = 12
"""Eigenvalues up to exp(NEAR_IDENTITY 2^12) come near the identity with so many."""

TOO_FLAT = 1e-10
"""Matrices whose determinant is below this share of their norm cubed go to the singular value decomposition."""


def product(a: Array, b: Array) -> Array:
    """Matrix products, (3, 3, ...) by (3, 3, ...)."""
    return np.asarray(np.einsum("ij...,jk...->ik...", a, b))


def inverse(m: Array) -> Array:
    """Inverses by cofactors, (3, 3, ...); infinite or NaN where a matrix is singular."""
    cofactor = _cofactors(m)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(cofactor.swapaxes(0, 1) / (m[0] * cofactor[0]).sum(axis=0))


def _cofactors(m: Array) -> Array:
    """det(m) times the inverse transpose: its rows are cross products of the rows of m."""
    out = np.empty_like(m)
    for i in range(3):
        a, b = m[(i + 1) % 3], m[(i + 2) % 3]
        for j in range(3):
            k, n = (j + 1) % 3, (j + 2) % 3
            out[i, j] = a[k] * b[n] - a[n] * b[k]
    return out


def polar(m: Array) -> tuple[Array, Array]:
    """Rotation R and symmetric S with ``m = R S``.

    R is the nearest rotation, det R = +1 always. S is positive definite where det m > 0. Where det m < 0 (a triangle
    that has turned over) the smallest singular direction is flipped: R stays a rotation and that eigenvalue of S is
    negative, so that the product is m still.

    Parameters
    ----------
    m : ndarray, shape (3, 3, ...)

    Returns
    -------
    (ndarray, ndarray), shape (3, 3, ...) each

    References
    ----------
    Higham, SIAM J. Sci. Stat. Comput. 7 (1986), doi:10.1137/0907079: Newton's iteration with scaling.
    """
    shape = m.shape
    x = np.array(m.reshape(3, 3, -1), dtype=np.float64)
    norm = np.sqrt(np.einsum("ijn,ijn->n", x, x))
    awkward = ~(det3(x) > TOO_FLAT * norm**3)
    x[:, :, awkward] = np.eye(3)[:, :, None]
    for _ in range(NEWTON_STEPS):
        cofactor = _cofactors(x)
        other = cofactor / (x[0] * cofactor[0]).sum(axis=0)
        scale = np.sqrt(np.sqrt(np.einsum("ijn,ijn->n", other, other) / np.einsum("ijn,ijn->n", x, x)))
        after = 0.5 * (scale * x + other / scale)
        done = np.abs(after - x).max(initial=0.0) < 1e-14
        x = after
        if done:
            break
    flat = m.reshape(3, 3, -1)
    if awkward.any():
        left, _, right = np.linalg.svd(flat[:, :, awkward].transpose(2, 0, 1))
        left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
        x[:, :, awkward] = (left @ right).transpose(1, 2, 0)
    s = product(x.swapaxes(0, 1), flat)
    s = 0.5 * (s + s.swapaxes(0, 1))
    return x.reshape(shape), s.reshape(shape)


def exp_symmetric(m: Array) -> Array:
    """Exponentials of symmetric matrices, (3, 3, ...): the Taylor series after halving, squared back.

    By Cayley and Hamilton every power of a matrix is a quadratic polynomial in it, so that the series runs over three
    numbers a matrix: with ``x^3 = a x^2 - b x + c`` the polynomial ``p + q x + r x^2`` times x is
    ``c r + (p - b r) x + (q + a r) x^2``.

    References
    ----------
    Moler and Van Loan, SIAM Review 45 (2003), doi:10.1137/S00361445024180, methods 3 and 8.
    """
    largest = float(np.sqrt(np.einsum("ij...,ij...->...", m, m).max(initial=0.0)))
    halvings = max(0, int(np.ceil(np.log2(largest / SMALL_NORM)))) if largest > 0.0 else 0
    x = m / 2.0**halvings
    square = product(x, x)
    trace = x[0, 0] + x[1, 1] + x[2, 2]
    minors = 0.5 * (trace**2 - (square[0, 0] + square[1, 1] + square[2, 2]))
    determinant = det3(x)
    p, q, r = np.zeros_like(trace), np.zeros_like(trace), np.zeros_like(trace)
    # Horner's rule from the last term: the polynomial times x, over k, plus one.
    for k in range(SERIES, 0, -1):
        p, q, r = determinant * r / k + 1.0, (p - minors * r) / k, (q + trace * r) / k
    out = _plus_identity(q * x + r * square, p)
    for _ in range(halvings):
        out = product(out, out)
    return out


def log_positive(m: Array) -> Array:
    """Logarithms of symmetric positive definite matrices, (3, 3, ...); NaN for others.

    Square roots bring a matrix near the identity; there ``log m = 2 artanh((m - 1) (m + 1)^-1)`` by its series.

    References
    ----------
    Higham, "Functions of Matrices", SIAM 2008, doi:10.1137/1.9780898717778, chapters 6 and 11.
    """
    shape = m.shape
    x = np.array(m.reshape(3, 3, -1), dtype=np.float64)
    # By the leading minors. Newton's roots of a negative eigenvalue wander, and may end up at a number that looks good.
    bad = ~((x[0, 0] > 0.0) & (x[0, 0] * x[1, 1] > x[0, 1] ** 2) & (det3(x) > 0.0))
    x[:, :, bad] = np.eye(3)[:, :, None]
    factor = np.full(x.shape[2], 2.0)
    for _ in range(MOST_ROOTS):
        off = _plus_identity(x, -1.0)
        far = np.flatnonzero(np.einsum("ijn,ijn->n", off, off) > NEAR_IDENTITY**2)
        if not len(far):
            break
        x[:, :, far] = _root_positive(x[:, :, far])
        factor[far] *= 2.0
    z = product(_plus_identity(x, -1.0), inverse(_plus_identity(x)))
    square = product(z, z)
    terms = _plus_identity(np.zeros_like(z), 1.0 / 15.0)
    for k in range(13, 0, -2):
        terms = _plus_identity(product(square, terms), 1.0 / k)
    out = factor * product(z, terms)
    # Too nearly singular for its roots to come near the identity.
    out[:, :, bad | ~(np.abs(z).max(axis=(0, 1), initial=0.0) < NEAR_IDENTITY)] = np.nan
    return np.asarray(out.reshape(shape))


def _root_positive(m: Array) -> Array:
    """Square roots of positive definite matrices: Denman and Beavers' iteration in its product form.

    Higham 2008, section 6.3, with determinantal scaling.
    """
    x, residual = m, m
    for _ in range(NEWTON_STEPS):
        with np.errstate(invalid="ignore"):
            scale = np.abs(det3(residual)) ** (-1.0 / 6.0)
        residual, x = scale**2 * residual, scale * x
        other = inverse(residual)
        x = 0.5 * product(x, _plus_identity(other))
        residual = 0.5 * (_plus_identity(0.5 * (residual + other)))
        if not np.abs(_plus_identity(residual, -1.0)).max(initial=0.0) > 1e-14:
            break
    return x


def log_rotation(r: Array) -> Array:
    """Rotation vectors (axis times angle, rad) of rotations, (3, 3, ...) to (3, ...).

    The largest component of the quaternion divides, so that half turns are as exact as small ones.
    """
    flat = r.reshape(3, 3, -1)
    trace = flat[0, 0] + flat[1, 1] + flat[2, 2]
    squares = np.stack([1.0 + trace, *(1.0 + 2.0 * flat[i, i] - trace for i in range(3))])
    skew = np.stack([flat[2, 1] - flat[1, 2], flat[0, 2] - flat[2, 0], flat[1, 0] - flat[0, 1]])
    both = [flat[i, j] + flat[j, i] for i, j in ((0, 1), (0, 2), (1, 2))]
    rows = np.array(
        [[squares[0], *skew], [skew[0], squares[1], both[0], both[1]], [skew[1], both[0], squares[2], both[2]],
         [skew[2], both[1], both[2], squares[3]]]
    )  # fmt: skip
    q = np.take_along_axis(rows, squares.argmax(axis=0)[None, None], axis=0)[0]
    q = q / np.sqrt(np.einsum("in,in->n", q, q))
    q = np.where(q[0] < 0.0, -q, q)
    sine = np.sqrt(np.einsum("in,in->n", q[1:], q[1:]))
    safe = np.where(sine > 1e-150, sine, 1.0)
    scale = np.where(sine > 1e-150, 2.0 * np.arctan2(sine, q[0]) / safe, 2.0)
    return np.asarray((q[1:] * scale).reshape(3, *r.shape[2:]))


def exp_rotation(v: Array) -> Array:
    """Rotations of rotation vectors by Rodrigues' formula, (3, ...) to (3, 3, ...)."""
    angle = np.sqrt(np.einsum("i...,i...->...", v, v))
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    out = second * (v[:, None] * v[None])
    diagonal = 1.0 - second * angle**2
    for i in range(3):
        out[i, i] += diagonal
        j, k = (i + 1) % 3, (i + 2) % 3
        out[k, j] += first * v[i]
        out[j, k] -= first * v[i]
    return out


def _plus_identity(m: Array, share: float | Array = 1.0) -> Array:
    out = m.copy()
    for i in range(3):
        out[i, i] += share
    return out
