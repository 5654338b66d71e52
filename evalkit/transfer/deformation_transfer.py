"""Deformation Transfer: the shapes of one mesh for another of any topology.

Sumner and Popovic, "Deformation transfer for triangle meshes", SIGGRAPH 2004, doi:10.1145/1015706.1015736.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.transfer.correspondence import Correspondence
from evalkit.transfer.gradients import Indices, checked_mesh, checked_shapes, deformation_gradients, mesh_size
from evalkit.transfer.solver import MeshSolver

STILL = 1e-6
"""Vertices that move by less than this share of the mesh's diagonal stand still: rounding of mesh files."""


class DeformationTransfer:
    """Transfer of shapes with one factorisation.

    The gradient of a target triangle is the mean of those of its partners. Gradients have no unit, so the two meshes
    may differ in size. They carry rotations over: the two must face the same way at rest, and a source shape that is
    turned as a whole turns the target, about the pinned vertices if there are any. They carry no translation: without
    a pinned vertex the mean of the target's vertices stays where it is at rest.

    Parameters
    ----------
    source_rest : array_like, shape (Vs, 3)
    source_triangles : array_like of int, shape (Ts, 3)
    target_rest : array_like, shape (Vt, 3)
    target_triangles : array_like of int, shape (Tt, 3)
    correspondence : Correspondence
    pinned : array_like of bool, shape (Vt,), optional
        Vertices of the target that stay at rest exactly; see :func:`still_vertices`.

    Raises
    ------
    EvalkitError
        If a mesh is broken or the correspondence or the pins are for another.
    """

    def __init__(
        self,
        source_rest: ArrayLike,
        source_triangles: ArrayLike,
        target_rest: ArrayLike,
        target_triangles: ArrayLike,
        correspondence: Correspondence,
        pinned: ArrayLike | None = None,
    ) -> None:
        from scipy import sparse

        self.source_rest, self.source_triangles = checked_mesh(source_rest, source_triangles, "source rest")
        self.target_rest, self.target_triangles = checked_mesh(target_rest, target_triangles, "target rest")
        correspondence.check(self.source_triangles, self.target_triangles)
        held = np.zeros(len(self.target_rest), dtype=bool) if pinned is None else np.asarray(pinned)
        if held.shape != (len(self.target_rest),) or held.dtype != bool:
            raise EvalkitError(
                f"pinned: {held.shape} of {held.dtype}; expected one bool for each of {len(self.target_rest)} vertices"
            )
        share = 1.0 / np.bincount(correspondence.target, minlength=len(self.target_triangles))
        self._mean = sparse.csr_matrix(
            (share[correspondence.target], (correspondence.target, correspondence.source)),
            shape=(len(self.target_triangles), len(self.source_triangles)),
        )
        self._solver = MeshSolver(self.target_rest, self.target_triangles, held)

    def transfer(self, shapes: ArrayLike) -> Array:
        """Shapes of the target.

        Parameters
        ----------
        shapes : array_like, shape (N, Vs, 3)
            Positions.

        Returns
        -------
        ndarray, shape (N, Vt, 3)

        Raises
        ------
        EvalkitError
            If the shapes are of another mesh or not finite.
        """
        given = checked_shapes(shapes, len(self.source_rest), "source shapes")
        gradients = deformation_gradients(self.source_rest, given, self.source_triangles)
        partners = (self._mean @ gradients.reshape(-1, gradients.shape[-1]).T).T
        guess = np.broadcast_to(self.target_rest, (len(given), *self.target_rest.shape))
        return self._solver.solve(partners.reshape(3, 3, len(given), len(self.target_triangles)), guess)


def still_vertices(
    source_rest: Array,
    source_triangles: Indices,
    shapes: Array,
    target_triangles: Indices,
    correspondence: Correspondence,
) -> NDArray[np.bool_]:
    """Vertices of the target that no shape of the source moves: all triangles around them have still partners only.

    Parameters
    ----------
    source_rest : ndarray, shape (Vs, 3)
    source_triangles : ndarray of int, shape (Ts, 3)
    shapes : ndarray, shape (N, Vs, 3)
    target_triangles : ndarray of int, shape (Tt, 3)
    correspondence : Correspondence

    Returns
    -------
    ndarray of bool, shape (Vt,)
        Vt is one past the highest vertex of the target's triangles.
    """
    moves = np.abs(shapes - source_rest).max(axis=(0, 2), initial=0.0) > STILL * mesh_size(source_rest)
    partner = moves[source_triangles].any(axis=1)
    moving = np.zeros(len(target_triangles), dtype=bool)
    moving[correspondence.target[partner[correspondence.source]]] = True
    out = np.ones(int(target_triangles.max()) + 1, dtype=bool)
    out[target_triangles[moving].ravel()] = False
    return out
