"""Which expressions an artist should sculpt: those from which most of the others can be told."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.transfer.gradients import Indices, checked_mesh, checked_shapes, mesh_size
from evalkit.transfer.local import FLOOR, KERNELS, STILL, Windows, mirror_image

KERNEL = KERNELS[1]
"""Of the kernels between the sharpest and the nearly linear, with mirrored examples."""


def choose_examples(rest: ArrayLike, rough: ArrayLike, triangles: ArrayLike, count: int) -> NDArray[np.intp]:
    """The most useful examples among rough shapes, most useful first.

    Sculpted examples are regressed on local motion; how uncertain a shape's difference between fine and rough remains
    follows from the rough shapes alone. In turn, the shape is taken that leaves the least of that variance over all
    shapes and the face: large motions that others are like come first, and of a mirrored pair only one. The order does
    not depend on how many are asked for.

    Parameters
    ----------
    rest : array_like, shape (V, 3)
    rough : array_like, shape (N, V, 3)
        Rough shapes of all expressions that the character is to have.
    triangles : array_like of int, shape (T, 3)
    count : int
        How many to choose, 1 to N.

    Returns
    -------
    ndarray of int, shape (count,)

    Raises
    ------
    EvalkitError
        If the mesh or a shape cannot be used, or there are fewer shapes than asked for.

    References
    ----------
    Rasmussen and Williams, "Gaussian Processes for Machine Learning", MIT Press 2006, eq. 2.26; greedy choice of
    A-optimal designs, Krause, Singh and Guestrin, JMLR 9 (2008).
    """
    v, t = checked_mesh(rest, triangles)
    shapes = checked_shapes(rough, len(v), "rough shapes")
    if not 1 <= count <= len(shapes):
        raise EvalkitError(f"{count} examples cannot be chosen among {len(shapes)} rough shapes")
    moves = shapes - v
    image = mirror_image(v, t)
    both = moves if image is None else np.concatenate([moves, moves[:, image] * [-1.0, 1.0, 1.0]])
    covariance = _covariance(v, t, both)
    pairs = [np.arange(n, len(both), len(moves)) for n in range(len(moves))]
    chosen: list[int] = []
    for _ in range(count):
        left = [-np.inf if n in chosen else _told(covariance, pairs[n], len(moves)) for n in range(len(moves))]
        best = int(np.argmax(left))
        chosen.append(best)
        covariance = _given(covariance, pairs[best])
    return np.array(chosen, dtype=np.intp)


def _covariance(rest: Array, triangles: Indices, moves: Array) -> Array:
    """Prior covariance (C, N, N) of the differences of shapes in windows, over the typical energy of motion."""
    moving = np.abs(moves).max(axis=(0, 2)) > STILL * mesh_size(rest)
    windows = Windows.over(rest, triangles, moving)
    products = windows.products(moves, moves, windows.weights(KERNEL.width))
    floor = FLOOR * float(np.einsum("cnn->cn", products).max(initial=0.0)) or 1.0
    size = np.sqrt(np.einsum("cnn->cn", products) + floor)
    both = size[:, :, None] * size[:, None]
    return np.asarray(both * np.exp((products / both - 1.0) / KERNEL.tau))


def _given(covariance: Array, which: NDArray[np.intp]) -> Array:
    """Covariance when the differences of some shapes are known up to the ridge."""
    return np.asarray(covariance - _explained(covariance, which, np.arange(covariance.shape[1])))


def _explained(covariance: Array, which: NDArray[np.intp], at: NDArray[np.intp]) -> Array:
    inner = covariance[:, which][:, :, which]
    noise = KERNEL.ridge * np.einsum("ckk->ck", inner)[:, :, None] * np.eye(len(which))
    cross = covariance[:, which][:, :, at]
    # A shape that is known already has no variance left, and neither has what it says of others.
    scale = np.einsum("ckk->c", inner)[:, None, None] * 1e-12 + 1e-300
    return np.asarray(cross.swapaxes(1, 2) @ np.linalg.solve(inner + noise + scale * np.eye(len(which)), cross))


def _told(covariance: Array, which: NDArray[np.intp], count: int) -> float:
    """Variance of the shapes, not of their mirror images, that knowing some of them takes away."""
    inner = covariance[:, which][:, :, which]
    noise = KERNEL.ridge * np.einsum("ckk->ck", inner)[:, :, None] * np.eye(len(which))
    scale = np.einsum("ckk->c", inner)[:, None, None] * 1e-12 + 1e-300
    cross = covariance[:, which, :count]
    return float((cross * np.linalg.solve(inner + noise + scale * np.eye(len(which)), cross)).sum())
