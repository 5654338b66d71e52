"""Vertices from wanted deformation gradients: one factorisation for any number of shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit.geometry import Array
from evalkit.transfer.gradients import Indices, edge_frames
from evalkit.transfer.matrices import inverse


class MeshSolver:
    """Least squares of vertices against gradients, ``min_x sum_t |grad_t x - G_t|^2``.

    In Sumner and Popovic's form every triangle has a fourth vertex of its own among the unknowns. Setting the
    derivative by it to zero takes it out exactly: what is left is the part of the gradient within the triangle's plane,
    ``grad_t x = sum_k x_k (grad phi_k)'`` with the hat functions phi_k of its corners, so the unknowns are the mesh's
    vertices alone and the normal equations are a Laplacian.

    Pinned vertices are eliminated, not penalised. A connected part without a pin can be anywhere: it is put so that the
    mean of its vertices is where the guess has it.

    Parameters
    ----------
    rest : ndarray, shape (V, 3)
    triangles : ndarray of int, shape (T, 3)
    pinned : ndarray of bool, shape (V,)

    Attributes
    ----------
    parts : ndarray of int, shape (V,)
        Connected part of each vertex.
    """

    def __init__(self, rest: Array, triangles: Indices, pinned: NDArray[np.bool_]) -> None:
        from scipy import sparse
        from scipy.sparse.csgraph import connected_components

        count, corners = len(rest), triangles.ravel()
        # Rows one and two of the inverse frame are the hat functions' gradients of the second and third corner.
        rows = inverse(edge_frames(rest, triangles))[:2]
        hats = np.stack([-rows[0] - rows[1], rows[0], rows[1]])
        entries = np.ascontiguousarray(hats.transpose(2, 0, 1))
        columns = np.broadcast_to(np.arange(3 * len(triangles)).reshape(-1, 1, 3), entries.shape)
        self._divergence = sparse.csr_matrix(
            (entries.ravel(), (np.repeat(corners, 3), columns.ravel())), shape=(count, 3 * len(triangles))
        )
        laplacian = (self._divergence @ self._divergence.T).tocsr()
        number, self.parts = connected_components(laplacian, directed=False)
        held = np.array(pinned, dtype=bool)
        first = np.full(number, count)
        np.minimum.at(first, self.parts, np.arange(count))
        has_pin = np.zeros(number, dtype=bool)
        has_pin[self.parts[held]] = True
        held[first[~has_pin]] = True
        self._loose = np.flatnonzero(~has_pin[self.parts])
        of = self.parts[self._loose]
        share = 1.0 / np.bincount(self.parts)[of]
        self._means = sparse.csr_matrix((share, (of, np.arange(len(of)))), shape=(number, len(of)))
        self._free, self._held = np.flatnonzero(~held), np.flatnonzero(held)
        self._coupling = laplacian[self._free][:, self._held]
        self._factor = factorised(laplacian[self._free][:, self._free]) if len(self._free) else None

    def solve(self, gradients: Array, guess: Array) -> Array:
        """Vertices of shapes.

        Parameters
        ----------
        gradients : ndarray, shape (3, 3, N, T)
            Wanted, row i for the coordinate i of a shape.
        guess : ndarray, shape (N, V, 3)
            Pinned vertices go where it has them.

        Returns
        -------
        ndarray, shape (N, V, 3)
        """
        out = np.array(guess, dtype=np.float64)
        count = len(out)
        if self._factor is None or not count:
            return out
        wanted = np.ascontiguousarray(gradients.transpose(3, 1, 2, 0)).reshape(-1, 3 * count)
        right = (self._divergence @ wanted)[self._free]
        if len(self._held):
            right -= self._coupling @ out[:, self._held].transpose(1, 0, 2).reshape(-1, 3 * count)
        out[:, self._free] = self._factor.solve(right).reshape(-1, count, 3).transpose(1, 0, 2)
        if len(self._loose):
            off = (guess - out)[:, self._loose].transpose(1, 0, 2).reshape(-1, 3 * count)
            shift = (self._means @ off)[self.parts[self._loose]]
            out[:, self._loose] += shift.reshape(-1, count, 3).transpose(1, 0, 2)
        return out


def factorised(matrix: Any) -> Any:
    """Factorisation of a sparse symmetric positive definite matrix; kept apart so that tests can count them."""
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu

    options = {"SymmetricMode": True}
    return splu(csc_matrix(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
