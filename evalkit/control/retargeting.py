"""Expression retargeting: a performer's motion on any head, with all that does not change in it computed beforehand.

Chai, Xiao and Hodgins, "Vision-based control of 3D facial animation", SCA 2003, section 6: the target's bases follow
from the source's once; a frame is one linear blend of them, whatever the source was made of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from evalkit.control.cylindrical import Bijectivity, correspond, cylinder_about
from evalkit.control.slits import vertex_sides
from evalkit.control.source import DEFAULT_SPREAD, Source, performer_surface, spreads
from evalkit.control.targets import checked_target
from evalkit.control.warp import DEFAULT, Folds, find_folds, fit_warp
from evalkit.errors import EvalkitError
from evalkit.geometry import Array, blocks
from evalkit.head import Head
from evalkit.head.model import SOFT, Indices

BLOCK = 32
"""Frames in one product: the bases are read once for so many."""

JAW_PARTS = ("lower teeth", "tongue")
"""Parts that follow the jaw bone."""


class Transfer:
    """Motion of one head's surface as motion of another's: ``dx_t = J(x_s) dx_s`` at corresponding places.

    Parameters
    ----------
    source, target : Head
        With landmarks; see :func:`evalkit.control.targets.checked_target`. Any size, and any way they face.
    kernel : str
        Of the warp, one of :data:`evalkit.control.warp.WARP_KERNELS`.
    jacobian : bool
        Whether motion is multiplied by the warp's Jacobian; without, it is only carried over.

    Attributes
    ----------
    map : sparse array, shape (V, Vs)
        From the source's vertices to the target's: where each takes its motion from.
    jacobians : ndarray, shape (V, 3, 3)
        Zero for what stands still.
    report : Bijectivity
        Of the outer skin.
    folds : Folds

    Raises
    ------
    EvalkitError
        If a head cannot be used, or the two share too few landmarks.

    Notes
    -----
    The paper learns the map anew from the dense correspondence before it takes the derivative. Here it is the warp of
    the landmarks: one through hundreds of near places of two different surfaces folds between them.

    Where the warp folds, its affine part stands for its Jacobian, and `folds` says where. The lining of the mouth and
    of the eyes follows the skin nearest to it on its side of the slit; lower teeth and tongue turn about the jaw with
    the chin, to first order; eyeballs and upper teeth stand still.

    References
    ----------
    Chai et al. 2003, section 6; Noh and Neumann 2001, doi:10.1145/383259.383290.
    """

    def __init__(self, source: Head, target: Head, kernel: str = DEFAULT, jacobian: bool = True) -> None:
        source, target = checked_target(source), checked_target(target)
        self.target = target
        warp = fit_warp(source.landmarks, target.landmarks, kernel)
        skin, soft = target.skin_vertices, target.part_vertices(*SOFT)
        sides = vertex_sides(target)
        number = np.full(len(target.vertices), -1)
        number[skin] = np.arange(len(skin))
        dense = correspond(
            cylinder_about(target.landmarks, target.name), warp(source.vertices), source.part_triangles("skin", "lids"),
            target.vertices[skin], number[target.part_triangles("skin", "lids")], vertex_sides(source), sides[skin],
        )  # fmt: skip
        self.report: Bijectivity = dense.report
        matrix = dense.matrix(len(source.vertices))
        at = matrix @ source.vertices
        local = warp.jacobian(at)
        self.folds: Folds = find_folds(warp, local, at, source.landmarks)
        local[self.folds.folded] = warp.matrix
        if not jacobian:
            local[:] = np.eye(3)
        followed = number.copy()
        lining = np.setdiff1d(soft, skin)
        followed[lining] = _nearest_on_side(target.vertices, lining, skin, sides)
        moving = np.flatnonzero(followed >= 0)
        pick = csr_array((np.ones(len(moving)), (moving, followed[moving])), shape=(len(target.vertices), len(skin)))
        self.map = pick @ matrix
        self.jacobians = np.zeros((len(target.vertices), 3, 3))
        self.jacobians[moving] = local[followed[moving]]
        self._jaw = _jaw_followers(target)

    def displacements(self, moves: Array) -> Array:
        """Displacements (N, V, 3), mm, of the target for those (N, Vs, 3) of the source."""
        given = np.asarray(moves, dtype=np.float64)
        if given.ndim != 3 or given.shape[1:] != (self.map.shape[1], 3):
            raise EvalkitError(f"motion has shape {given.shape}; expected (shapes, {self.map.shape[1]}, 3)")
        flat = given.transpose(1, 0, 2).reshape(given.shape[1], -1)
        carried = (self.map @ flat).reshape(-1, len(given), 3)
        out = np.einsum("vij,vnj->nvi", self.jacobians, carried, optimize=True)
        if self._jaw is not None:
            which, follow, chin = self._jaw
            out[:, which] = np.einsum("kij,nj->nki", follow, out[:, chin])
        return np.asarray(out)


def _nearest_on_side(vertices: Array, which: Indices, skin: Indices, sides: NDArray[np.int8]) -> Indices:
    """Number among the skin of the vertex nearest to each; for the lips' lining one of the same lip."""
    out = cKDTree(vertices[skin]).query(vertices[which])[1].astype(np.intp)
    for side in (1, -1):
        mine, there = sides[which, 0] == side, np.flatnonzero(sides[skin, 0] == side)
        if mine.any() and len(there):
            out[mine] = there[cKDTree(vertices[skin[there]]).query(vertices[which[mine]])[1]]
    return out


def _jaw_followers(head: Head) -> tuple[Indices, Array, int] | None:
    """Vertices of the jaw's parts, matrices (K, 3, 3) from the chin's displacement to theirs, and the chin's vertex.

    The turn about the axis, parallel to x, that takes the chin along to first order: ``w = (a x d)_x / |a|^2``.
    """
    which = head.part_vertices(*JAW_PARTS)
    if head.jaw is None or not len(which):
        return None
    chin = head.nearest_vertices({"chin": head.landmarks["chin"]})["chin"]
    arm = (head.vertices[chin] - head.jaw.axis)[1:]
    turn = np.array([0.0, -arm[1], arm[0]]) / (arm @ arm)
    own = head.vertices[which] - head.jaw.axis
    follow = np.column_stack([np.zeros(len(own)), -own[:, 2], own[:, 1]])[:, :, None] * turn
    follow[:, 0, 0] = 1.0
    return which, follow, chin


class TargetBases:
    """A head and the displacements of all its vertices for each basis: a frame is one linear blend.

    Parameters
    ----------
    rest : array_like, shape (V, 3), mm
    bases : array_like, shape (L, V, 3), mm
        Displacements at coefficient one.
    """

    def __init__(self, rest: ArrayLike, bases: ArrayLike) -> None:
        self.rest = np.asarray(rest, dtype=np.float32)
        moves = np.asarray(bases)
        if moves.ndim != 3 or moves.shape[1:] != self.rest.shape:
            raise EvalkitError(f"bases have shape {moves.shape}; expected (bases, {len(self.rest)}, 3)")
        self.bases = np.ascontiguousarray(moves, dtype=np.float32)
        self._flat = self.bases.reshape(len(moves), -1)

    def displacements(self, coefficients: ArrayLike, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """``coefficients @ bases``: displacements (F, V, 3), mm, for coefficients (F, L).

        Parameters
        ----------
        coefficients : array_like, shape (F, L)
        out : ndarray of float32, shape (F, V, 3), optional
            Written to, so that a stream uses the same memory again.
        """
        given = np.ascontiguousarray(coefficients, dtype=np.float32)
        if given.ndim != 2 or given.shape[1] != len(self.bases):
            raise EvalkitError(f"coefficients have shape {given.shape}; expected (frames, {len(self.bases)})")
        if out is None:
            out = np.empty((len(given), *self.rest.shape), dtype=np.float32)
        flat = out.reshape(len(given), -1)
        for part in blocks(len(given), BLOCK):
            np.matmul(given[part], self._flat, out=flat[part])
        return out

    def vertices(self, coefficients: ArrayLike, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """Positions (F, V, 3), mm, in the head's own axes; head motion is the caller's."""
        found = self.displacements(coefficients, out)
        found += self.rest
        return found


@dataclass(frozen=True, eq=False)
class Retargeting:
    """A performer's bases on a head.

    Attributes
    ----------
    target : Head
    bases : TargetBases
    markers : ndarray, shape (L, M * 3)
        The performer's bases.
    source : Source
    report : Bijectivity
    folds : Folds
    """

    target: Head
    bases: TargetBases
    markers: Array
    source: Source
    report: Bijectivity
    folds: Folds

    def coefficients(self, displacement: ArrayLike) -> Array:
        """Least-squares coefficients (F, L) of the performer's bases for marker displacements (F, M, 3), mm."""
        given = np.asarray(displacement, dtype=np.float64)
        if given.ndim != 3 or given.shape[1] * given.shape[2] != self.markers.shape[1]:
            markers = self.markers.shape[1] // 3
            raise EvalkitError(f"displacements have shape {given.shape}; expected (frames, {markers}, 3)")
        return np.asarray(given.reshape(len(given), -1) @ self._inverse)

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.pinv(self.markers))

    def vertices(self, coefficients: ArrayLike) -> NDArray[np.float32]:
        """Positions (F, V, 3), mm, of the head for coefficients (F, L)."""
        return self.bases.vertices(coefficients)

    @property
    def text(self) -> str:
        """What a user should know, line by line."""
        return "\n".join((self.source.text, self.report.text, self.folds.text))


def retarget(
    labels: Sequence[str], rest_mm: ArrayLike, bases: ArrayLike, head: Head, *, kernel: str = DEFAULT,
    jacobian: bool = True, spread: str = DEFAULT_SPREAD,
) -> Retargeting:  # fmt: skip
    """Bases of a performer's markers as bases of a head's vertices.

    Parameters
    ----------
    labels : sequence of str
        Of the M markers.
    rest_mm : array_like, shape (M, 3), mm
        Frontal axes: x to the performer's left, y up, z forward.
    bases : array_like, shape (L, M, 3), mm
        Displacements of the markers.
    head : Head
    kernel, jacobian
        As for :class:`Transfer`.
    spread : str
        One of :data:`evalkit.control.source.spreads`.

    Raises
    ------
    EvalkitError
        If shapes do not fit, a name is not known, or the head has no landmarks.
    """
    if spread not in spreads:
        raise EvalkitError(f"spread '{spread}' is not known; known are {', '.join(spreads)}")
    moves = np.asarray(bases, dtype=np.float64)
    if moves.ndim != 3 or moves.shape[1:] != (len(labels), 3):
        raise EvalkitError(f"bases have shape {moves.shape}; expected (bases, {len(labels)}, 3)")
    target = checked_target(head)
    source = performer_surface(labels, rest_mm)
    transfer = Transfer(source.head, target, kernel, jacobian)
    weights = spreads[spread](source)
    spread_moves = (weights @ moves.transpose(1, 0, 2).reshape(len(labels), -1)).reshape(-1, len(moves), 3)
    found = transfer.displacements(spread_moves.transpose(1, 0, 2))
    return Retargeting(
        target, TargetBases(target.vertices, found), moves.reshape(len(moves), -1), source, transfer.report,
        transfer.folds,
    )  # fmt: skip
