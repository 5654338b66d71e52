"""Character Transfer: what sculpted examples say about a character, applied to rough shapes.

T. Kato, S. Saito, M. Kawai, T. Iwao, A. Maejima, S. Morishima, "Character Transfer: example-based individuality
retargeting for facial animations", WSCG 2014.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.transfer.blending import blends
from evalkit.transfer.coefficients import RIDGE, kinds, region_coefficients
from evalkit.transfer.gradients import (
    Indices,
    checked_mesh,
    checked_shapes,
    deformation_gradients,
    mesh_size,
    without_area,
)
from evalkit.transfer.matrices import inverse, product
from evalkit.transfer.segmentation import LEVELS, segment, vertex_regions
from evalkit.transfer.solver import MeshSolver

STILL = 1e-4
"""A vertex that no example moves by more than this share of the mesh's diagonal is pinned."""

BATCH = 10_000
"""Triangles, over all shapes of a batch, that are worked on at a time: what fits the processor's cache."""


class CharacterTransfer:
    """The mapping from rough to fine that some examples of a character define.

    Everything that depends on the examples alone is done once, the factorisation included.

    Parameters
    ----------
    rest : array_like, shape (V, 3)
        The character at rest, in any unit.
    rough, fine : array_like, shape (M, V, 3)
        Examples: rough shapes, and what a sculptor made of each.
    triangles : array_like of int, shape (T, 3)
    regions : array_like of int, shape (V,), or int, optional
        Region of each vertex, or how many levels of splits (2 to the power of it regions); by default the paper's four.
    coefficients : str
        Of :data:`~evalkit.transfer.coefficients.kinds`.
    ridge : float
        See :func:`~evalkit.transfer.coefficients.region_coefficients`.
    blend : str
        Of :data:`~evalkit.transfer.blending.blends`.
    side : {"left", "right"}
        ``G = Q G_rough`` with ``Q = G_fine G_rough^-1``, as in the paper, or ``G = G_rough Q`` with
        ``Q = G_rough^-1 G_fine``. Only the latter is the same in any axes of the new shape: the former needs heads
        without head motion.

    Attributes
    ----------
    regions : ndarray of int, shape (V,)
    pinned : ndarray of bool, shape (V,)
        Vertices that no example moves: they follow the rough shapes.

    Raises
    ------
    EvalkitError
        If a mesh or shape cannot be used (with the number of shape, vertex or triangle), the topologies differ, or
        there is no example.
    """

    def __init__(
        self,
        rest: ArrayLike,
        rough: ArrayLike,
        fine: ArrayLike,
        triangles: ArrayLike,
        *,
        regions: ArrayLike | int = LEVELS,
        coefficients: str = "ridge",
        ridge: float = RIDGE,
        blend: str = "rotation-stretch",
        side: str = "left",
    ) -> None:
        self.rest, self.triangles, self.rough, self.fine = checked_examples(rest, rough, fine, triangles)
        for name, value, known in (
            ("coefficients", coefficients, kinds), ("blend", blend, blends), ("side", side, ("left", "right")),
        ):  # fmt: skip
            if value not in known:
                raise EvalkitError(f"{name} '{value}' is not known; use {', '.join(known)}")
        self._kind, self._ridge, self._left = coefficients, ridge, side == "left"
        self.regions = self._regions(regions)
        collapsed = np.argwhere(without_area(self.rough, self.triangles))
        if len(collapsed):
            raise EvalkitError(f"rough example {collapsed[0, 0]}: triangle {collapsed[0, 1]} has collapsed; mend it")
        back = inverse(deformation_gradients(self.rest, self.rough, self.triangles))
        fine_gradients = deformation_gradients(self.rest, self.fine, self.triangles)
        pair = (fine_gradients, back) if self._left else (back, fine_gradients)
        self._mappings = blends[blend].of(product(*pair))
        reach = np.linalg.norm(np.concatenate([self.rough, self.fine]) - self.rest, axis=2).max(axis=0)
        self.pinned = reach <= STILL * mesh_size(self.rest)
        self._solver = MeshSolver(self.rest, self.triangles, self.pinned)

    def _regions(self, regions: ArrayLike | int) -> NDArray[np.intp]:
        if isinstance(regions, int | np.integer):
            labels = segment(self.rest, self.triangles, self.fine, int(regions))[-1]
            return vertex_regions(self.triangles, labels, len(self.rest))
        given = np.asarray(regions)
        if given.shape != (len(self.rest),) or not np.issubdtype(given.dtype, np.integer):
            raise EvalkitError(f"regions have shape {given.shape}; expected {len(self.rest)} whole numbers")
        return np.unique(given, return_inverse=True)[1]

    def coefficients(self, shapes: ArrayLike) -> Array:
        """Coefficients (N, R, M) of the examples for rough shapes (N, V, 3), region by region."""
        new = checked_shapes(shapes, len(self.rest), "rough shapes")
        moves = self.rough - self.rest, new - self.rest
        return region_coefficients(*moves, self.regions, self._kind, self._ridge)

    def __call__(self, shapes: ArrayLike, coefficients: ArrayLike | None = None) -> Array:
        """Fine shapes.

        Parameters
        ----------
        shapes : array_like, shape (N, V, 3)
            Rough shapes.
        coefficients : array_like, shape (N, R, M), optional
            In place of estimated ones.

        Returns
        -------
        ndarray, shape (N, V, 3)

        Raises
        ------
        EvalkitError
            If shapes or coefficients do not fit.
        """
        new = checked_shapes(shapes, len(self.rest), "rough shapes")
        weights = self.coefficients(new) if coefficients is None else _numbers(coefficients)
        expected = (len(new), int(self.regions.max()) + 1, len(self.rough))
        if weights.shape != expected:
            raise EvalkitError(
                f"coefficients have shape {weights.shape}; expected {expected} (shapes, regions, examples)"
            )
        bad = np.argwhere(~np.isfinite(weights))
        if len(bad):
            raise EvalkitError("coefficients: shape {}, region {}, example {}: not finite".format(*bad[0]))
        out = np.empty_like(new)
        size = max(1, BATCH // len(self.triangles))
        for start in range(0, len(new), size):
            batch = slice(start, start + size)
            out[batch] = self._fine(new[batch], weights[batch])
        return out

    def _fine(self, new: Array, weights: Array) -> Array:
        at_vertices = weights[:, self.regions].transpose(0, 2, 1)
        mapping = self._mappings.blended(at_vertices[:, :, self.triangles].mean(axis=3))
        gradients = deformation_gradients(self.rest, new, self.triangles)
        pair = (mapping, gradients) if self._left else (gradients, mapping)
        # What pinned vertices and loose parts are held to: exact where the coefficients are those of an example.
        guess = new + np.einsum("nmv,mvi->nvi", at_vertices, self.fine - self.rough)
        return self._solver.solve(product(*pair), guess)


def _numbers(coefficients: ArrayLike) -> Array:
    try:
        return np.asarray(coefficients, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise EvalkitError("coefficients must be an array of numbers (shapes, regions, examples)") from error


def checked_examples(
    rest: ArrayLike, rough: ArrayLike, fine: ArrayLike, triangles: ArrayLike
) -> tuple[Array, Indices, Array, Array]:
    """Rest mesh, triangles, rough and fine examples that fit together.

    Raises
    ------
    EvalkitError
        As :class:`CharacterTransfer` says.
    """
    v, t = checked_mesh(rest, triangles)
    a, b = (checked_shapes(s, len(v), name) for s, name in ((rough, "rough examples"), (fine, "fine examples")))
    if len(a) != len(b):
        raise EvalkitError(f"{len(a)} rough and {len(b)} fine examples; every rough example needs its fine one")
    if not len(a):
        raise EvalkitError("no example; sculpt at least one expression, rough and fine")
    return v, t, a, b


def transfer_character(
    rest: ArrayLike, rough_examples: ArrayLike, fine_examples: ArrayLike, rough_new: ArrayLike, triangles: ArrayLike
) -> Array:
    """A character's own expressions out of rough ones, as in the paper.

    Parameters
    ----------
    rest : array_like, shape (V, 3)
        The character at rest, in any unit.
    rough_examples, fine_examples : array_like, shape (K, V, 3)
        Examples: rough shapes, and what a sculptor made of each.
    rough_new : array_like, shape (N, V, 3)
        Rough shapes of other expressions, made in the same way as the rough examples, without head motion.
    triangles : array_like of int, shape (T, 3)

    Returns
    -------
    ndarray, shape (N, V, 3)

    Raises
    ------
    EvalkitError
        If the topologies differ, a position is not finite, a triangle has no area, or there is no example; with the
        number of what is wrong.

    Examples
    --------
    A bump that its sculptor has made half as high again, and a new rough one of half the height. (Not 0.75: rotations
    and stretches are blended, not heights.)

    >>> import numpy as np
    >>> import evalkit
    >>> x, y = np.meshgrid(np.arange(9.0), np.arange(9.0))
    >>> rest = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    >>> corner = np.flatnonzero((x < 8) & (y < 8))[:, None]
    >>> triangles = np.concatenate([corner + [0, 1, 10], corner + [0, 10, 9]])
    >>> bump = np.exp(-((rest - rest[40]) ** 2).sum(axis=1, keepdims=True) / 4) * [0, 0, 1]
    >>> found = evalkit.transfer_character(rest, [rest + bump], [rest + 1.5 * bump], [rest + 0.5 * bump], triangles)
    >>> found.shape, round(float(found[0, 40, 2]), 2)
    ((1, 81, 3), 0.74)
    """
    return CharacterTransfer(rest, rough_examples, fine_examples, triangles)(rough_new)
