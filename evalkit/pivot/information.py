"""Fisher information of shape, pivot and sway with every frame's rotation eliminated; solved in linear time.

The model is ``x_ij = R_i p_j + c_i`` with the markers p_j about the pivot in the head's axes and the pivot's path
``c_i = sum_k B_ik a_k`` in the world (one constant function: a resting pivot). With a small turn w_i of frame i the
residual in head axes changes by ``-(dp_j + R_i' dc_i) + [p_j]x w_i``. Eliminating w_i by its Schur complement
leaves a matrix in (a, p): banded in a, since a B-spline meets its neighbours only, with a border for the p of a
few markers. Frames enter through sums, so that the cost is linear in their number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from evalkit.geometry import Array, blocks, cross_matrix
from evalkit.pivot.spline import Basis, roughness

CHUNK = 1 << 19
"""Numbers in the frames' own matrices (3 M, 3 M) that are worked on at a time."""

RANK = 1e-13
"""Part of the largest information below which a direction counts as unseen."""


@dataclass(frozen=True, eq=False)
class Information:
    """The reduced normal matrix ``[[D, C], [C', S]]`` of path coefficients (K, 3) and markers (M, 3).

    Attributes
    ----------
    band : ndarray, shape (3 Q, 3 K)
        D in the lower banded form of ``scipy.linalg.cholesky_banded``.
    border : ndarray, shape (3 K, 3 M)
        C.
    corner : ndarray, shape (3 M, 3 M)
        S, with the free choice of the head's axes (three directions) made positive: they carry no information
        and stay where they are in a solution.
    basis : Basis
    """

    band: Array
    border: Array
    corner: Array
    basis: Basis

    def solve(self, path: Array, markers: Array) -> tuple[Array, Array]:
        """Solution for right sides (3 K, N) and (3 M, N), the least one where the frames do not determine it."""
        by_path, by_border, schur = self._eliminated(path)
        p = np.asarray(np.linalg.lstsq(schur, markers - self.border.T @ by_path, rcond=RANK)[0], dtype=np.float64)
        return by_path - by_border @ p, p

    def unseen(self, functional: Array) -> Array:
        """Unit vectors as rows along which a functional (3 K, 3) of the path is free, shape (N, 3)."""
        _, by_border, schur = self._eliminated(functional)
        values, vectors = np.linalg.eigh(schur)
        free = vectors[:, values <= RANK * values[-1]]
        moves = free.T @ by_border.T @ functional
        _, lengths, axes = np.linalg.svd(moves, full_matrices=False)
        return axes[lengths > 1e-6]

    def _eliminated(self, path: Array) -> tuple[Array, Array, Array]:
        """``D^-1`` times right sides and border, and the markers' own matrix once the path is eliminated."""
        from scipy.linalg import cho_solve_banded, cholesky_banded

        factor = (cholesky_banded(self.band, lower=True, check_finite=False), True)
        both = cho_solve_banded(factor, np.hstack([path, self.border]), check_finite=False)
        by_path, by_border = both[:, : path.shape[1]], both[:, path.shape[1] :]
        return by_path, by_border, self.corner - self.border.T @ by_border

    def path_weights(self, frame: int | None = None) -> Array:
        """The functional that takes the coefficients to the pivot: mean over the frames, or one frame; (3 K, 3)."""
        basis = self.basis
        if frame is None:
            per = basis.gather(np.full((len(basis.first), 1), 1.0 / len(basis.first)))[:, 0]
        else:
            per = np.zeros(basis.size)
            per[basis.first[frame] + np.arange(basis.values.shape[1])] = basis.values[frame]
        return np.asarray(np.kron(per[:, None], np.eye(3)), dtype=np.float64)


def information(shape: ArrayLike, rotations: Array, weights: Array, basis: Basis) -> Information:
    """Sum of the frames' information about shape and path, their rotations eliminated.

    Parameters
    ----------
    shape : array_like, shape (M, 3), mm
        Markers about the pivot in head axes.
    rotations : ndarray, shape (F, 3, 3)
    weights : ndarray, shape (M,) or (F, M)
        Inverse variances, 1/mm²; zero where a marker was not seen.
    basis : Basis
        Of the pivot's path, for the same F frames.

    Returns
    -------
    Information

    References
    ----------
    Triggs et al., "Bundle adjustment - a modern synthesis" (2000), doi:10.1007/3-540-44480-7_21, section 6.
    """
    p = np.asarray(shape, dtype=np.float64)
    count, frames = len(p), len(rotations)
    corner = np.zeros((3 * count, 3 * count))
    border = np.zeros((basis.size, 9 * count))
    diagonals = np.zeros((basis.values.shape[1], basis.size, 9))
    for block in blocks(frames, max(CHUNK // (3 * count) ** 2, 1)):
        r = rotations[block]
        if weights.ndim == 1:
            rows, which = weights[None], np.zeros(len(r), dtype=int)
        else:
            rows, which = np.unique(weights[block], axis=0, return_inverse=True)
            which = np.ravel(which)
        pp, dp, dd = _reduced(p, rows)
        corner += np.einsum("u,uab->ab", np.bincount(which, minlength=len(rows)).astype(np.float64), pp)
        # The functions that these frames meet and no others, or the cost would be quadratic in a take's length.
        part, met = basis.part(block)
        if len(rows) == 1:
            border[met] += (part.gather(r.reshape(-1, 9)).reshape(-1, 3, 3) @ dp[0]).reshape(part.size, -1)
            path = r @ dd[0] @ r.transpose(0, 2, 1)
        else:
            border[met] += part.gather((r @ dp[which]).reshape(len(r), -1))
            path = r @ dd[which] @ r.transpose(0, 2, 1)
        diagonals[:, met] += part.bands(path.reshape(-1, 9))
    band = np.zeros((3 * len(diagonals), 3 * basis.size))
    for m, block_row in enumerate(diagonals.reshape(-1, basis.size, 3, 3)):
        for row in range(3):
            for column in range(3):
                if 3 * m + row >= column:
                    band[3 * m + row - column, column::3] += block_row[:, row, column]
    largest = float(band[0].max(initial=0.0))
    smooth = roughness(basis.size, len(diagonals))
    for m in range(len(diagonals)):
        band[3 * m] += np.repeat(1e-15 * largest * smooth[m], 3)
    band[0] += 1e-16 * largest
    turn = cross_matrix(p).reshape(-1, 3)
    corner += float(np.trace(corner)) / (3 * count) * turn @ turn.T / max(float((turn**2).sum()) / 3.0, 1e-300)
    return Information(band, border.reshape(basis.size, 3, -1).reshape(3 * basis.size, -1), corner, basis)


def _reduced(p: Array, weights: Array) -> tuple[Array, Array, Array]:
    """Information of one frame with each row of weights (U, M): blocks pp (U, 3M, 3M), dp (U, 3, 3M), dd (U, 3, 3)."""
    rows, count = weights.shape
    cross = cross_matrix(p)
    inertia = np.einsum("um,mki,mkj->uij", weights, cross, cross, optimize=True)
    inverse = np.linalg.pinv(inertia, rcond=1e-12, hermitian=True)
    marker = weights[:, :, None, None] * cross  # minus the mixed derivative of a marker and the turn
    both = marker.sum(axis=1)
    flat = marker.reshape(rows, 3 * count, 3)
    pp = -flat @ inverse @ flat.transpose(0, 2, 1)
    index = np.arange(3 * count)
    pp[:, index, index] += np.repeat(weights, 3, axis=1)
    dp = np.einsum("um,ij->uimj", weights, np.eye(3)).reshape(rows, 3, 3 * count)
    dp = dp - both @ inverse @ flat.transpose(0, 2, 1)
    dd = weights.sum(axis=1)[:, None, None] * np.eye(3) - both @ inverse @ both.transpose(0, 2, 1)
    return pp, dp, dd
