"""Regions of a face that move as one: two-means, level by level, over where triangles are and how examples move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evalkit.geometry import Array
from evalkit.transfer.gradients import Indices

LEVELS = 4
"""Of the paper's Fig. 3: 16 regions. Motion weighs 1, 2, 3, 4 times as much as place at its levels."""

LEAST_VERTICES = 60
"""A region with fewer is not split."""

MOST_STEPS = 100
"""Lloyd's iteration stops here if it has not come to rest; it does within twenty or so."""


def segment(rest: Array, triangles: Indices, fine: Array, levels: int = LEVELS) -> tuple[NDArray[np.intp], ...]:
    """Regions of triangles, level by level.

    A triangle's vector is ``[places of its corners at rest (9), displacements in the M fine examples (9 M)]``, both
    blocks scaled to unit total variance, the second times the number of the level. Each region of a level is split in
    two by two-means, started from the sign along its principal axis, so that nothing is random.

    Parameters
    ----------
    rest : ndarray, shape (V, 3)
    triangles : ndarray of int, shape (T, 3)
    fine : ndarray, shape (M, V, 3)
    levels : int
        At most two to the power of it regions.

    Returns
    -------
    tuple of ndarray of int, shape (T,)
        Region of every triangle before any split and after each level; numbers are contiguous from 0.

    References
    ----------
    Kato et al. 2014, section 3.3, eq. 5.
    """
    place = rest[triangles].reshape(len(triangles), 9)
    moves = (fine - rest)[:, triangles].transpose(1, 0, 2, 3).reshape(len(triangles), -1)
    place, moves = _unit_variance(place), _unit_variance(moves)
    labels = np.zeros(len(triangles), dtype=np.intp)
    found = [labels]
    vectors = np.concatenate([place, moves], axis=1)
    for weight in range(1, levels + 1):
        vectors[:, 9:] = weight * moves
        split = np.zeros_like(labels)
        for region in range(labels.max() + 1):
            which = np.flatnonzero(labels == region)
            if _vertices(triangles[which]) >= LEAST_VERTICES:
                split[which] = two_means(vectors[which])
        labels = np.unique(2 * labels + split, return_inverse=True)[1]
        found.append(labels)
    return tuple(found)


def _vertices(triangles: Indices) -> int:
    return int(np.count_nonzero(np.bincount(triangles.ravel())))


def _unit_variance(block: Array) -> Array:
    centred = block - block.mean(axis=0)
    total = np.sqrt((centred**2).sum(axis=1).mean())
    return np.asarray(centred / total if total > 0.0 else centred)


def two_means(vectors: Array) -> NDArray[np.intp]:
    """Cluster 0 or 1 of each vector (n, d): Lloyd's iteration from the sign along the principal axis.

    Cluster 0 is the larger one, or has the first vector.
    """
    centred = vectors - vectors.mean(axis=0)
    axis = np.linalg.eigh(centred.T @ centred)[1][:, -1]
    second = centred @ axis > 0.0
    for _ in range(MOST_STEPS):
        count = int(second.sum())
        if not 0 < count < len(vectors):
            break
        total = second.astype(np.float64) @ centred
        # The mean of all is zero: both centres follow from one sum.
        high, low = total / count, -total / (len(vectors) - count)
        after = centred @ (high - low) > 0.5 * (high @ high - low @ low)
        if np.array_equal(after, second):
            break
        second = after
    # The sign of an eigenvector is arbitrary and changes with the axes of the world; sizes do not.
    if (2 * second.sum(), second[0]) > (len(vectors), False):
        second = ~second
    return second.astype(np.intp)


def vertex_regions(triangles: Indices, labels: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """Region of every vertex: that of most triangles around it, the lowest number among equals.

    Parameters
    ----------
    triangles : ndarray of int, shape (T, 3)
    labels : ndarray of int, shape (T,)
    count : int
        Vertices of the mesh; one without a triangle is in region 0.

    Returns
    -------
    ndarray of int, shape (V,)
    """
    votes = np.zeros((count, int(labels.max()) + 1), dtype=np.intp)
    np.add.at(votes, (triangles, labels[:, None]), 1)
    return np.asarray(votes.argmax(axis=1))
